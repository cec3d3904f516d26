"""The payload of a robot, from estimates or logs with the payload and without it, and what controllers take.

Robot, for both sides an estimate or logs -> `PayloadFinding` <-> file; payload, flange -> `PayloadCommand`:

    c_flange = R' (c - p),  J_flange = R' J R              R, p: the flange in the file's frame of the link

Universal Robots: `set_target_payload(m, cog, inertia)`, cog in m from the tool flange, inertia in kg m^2 as
[Ixx, Iyy, Izz, Ixy, Ixz, Iyz] about the centre, along the axes of the flange, at most 133 each, none of the
first three negative; a zero matrix where it is left out (URScript manual, Software 10.6). From PolyScope 3.15
and 5.10 on (Universal_Robots_Client_Library, pull request 515); before, `set_payload(m, cog)`.
Franka: `setLoad(load_mass, F_x_Cload, load_inertia)` of libfranka (robot.h, robot_state.h), the inertia about
the centre as nine numbers, column by column, in the flange frame; the service franka_msgs/SetLoad of
franka_ros2 has the same; `mass`, `centerOfMass` and `inertia` of an end effector for Desk stand in
endeffector-config.json (RIDE CLI documentation 1.1.1, "End effector commissioning").

Not supported: the limits of a single robot, such as its rated payload; a centre that is not identified.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
import scipy

from symid import dynamics
from symid.arrays import FloatArray
from symid.errors import EstimateError, IdentifiabilityError, Notice, UsageError
from symid.identification.estimators import Estimate
from symid.identification.friction_search import identify_loaded
from symid.identification.identified import Identified, build_frame, build_identified
from symid.identification.identify import TaskContext
from symid.identification.rigid import identify_parameters
from symid.identification.stored import GivenResult, is_kind, read_dynamics, read_result_file
from symid.logs import Recording, check_distinct, check_distinct_samples, read_recordings
from symid.options import PayloadOptions
from symid.robot import Robot, describe_settings, suggest_names

GivenSide = Sequence[GivenResult | Recording]
"""One estimate, or logs: each itself, or its file."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PayloadFinding:
    """The payload, the name of the robot that carries it, and the notices of both sides."""

    robot: str
    payload: dynamics.Payload
    notices: tuple[Notice, ...]


def identify_payload(
    robot: Robot, loaded: GivenSide, empty: GivenSide, options: PayloadOptions, context: TaskContext
) -> PayloadFinding:
    """Return what the robot carries in `loaded` and not in `empty`; errors as of `RobotModel.payload`."""
    check_distinct([Path(entry) for entry in (*loaded, *empty) if isinstance(entry, str | PathLike)])
    first = _read_side("with the payload", robot, loaded, options, context)
    second = _read_side("without it", robot, empty, options, context)
    if first.robot.elastic != second.robot.elastic:
        text = "one side has elastic joints and the other rigid ones; identify both by the same method"
        raise EstimateError(Notice(code="payload.other-model", text=text))
    values = [
        dynamics.build_base_values(
            [entry.name for entry in side.values],
            [entry.value for entry in side.values],
            [entry.std for entry in side.values],
            side.covariance,
        )
        for side in (first, second)
    ]
    found = dynamics.estimate_payload(
        first.robot, first.base, *values, joint=options.joint, mass=options.mass
    )
    return PayloadFinding(robot=first.robot.name, payload=found, notices=(*first.notices, *second.notices))


def read_payload(path: Path) -> PayloadFinding:
    """Return the payload stored at `path`; errors as for `read_result_file`."""
    return read_result_file(PayloadFinding, "payload", path, _list_mistakes)


def _list_mistakes(found: PayloadFinding) -> list[str]:
    names, shape = tuple(entry.name for entry in found.payload.quantities), found.payload.standard.shape
    wrong = [] if shape == (10,) else [f"standard: expected (10,) numbers, got {shape}"]
    if names != dynamics.PAYLOAD_QUANTITIES:
        wrong.append(
            f"quantities: expected {', '.join(dynamics.PAYLOAD_QUANTITIES)}, got {', '.join(names):.80}"
        )
    return wrong + [
        f"{entry.name:.20}: a value needs a deviation that is not negative"
        for entry in found.payload.quantities
        if entry.value is not None and (entry.std is None or entry.std < 0.0)
    ]


def _read_side(
    name: str, robot: Robot, given: GivenSide, options: PayloadOptions, context: TaskContext
) -> Identified:
    """Return the values of an estimate, or of logs; notices of robot and identification name the side."""
    logs: list[Path | Recording] = []
    estimates: list[GivenResult] = []
    for entry in given:
        if isinstance(entry, Recording):
            logs.append(entry)
        elif isinstance(entry, str | PathLike) and not is_kind(Path(entry)):
            logs.append(Path(entry))
        else:
            estimates.append(entry)
    if not estimates:
        if any(robot.elastic):
            text = "the robot has elastic joints: identify both sets of logs first, and give the estimates"
            raise UsageError(Notice(code="usage.payload-elastic", text=text, file=robot.path))
        recordings = read_recordings(logs, robot)
        check_distinct_samples(recordings)
        library = context.prepare(robot)
        names = ", ".join(Path(entry.source).name for entry in recordings)
        context.progress(f"identifying {robot.name} from {names}")

        def fit(logs: Sequence[Recording]) -> Estimate:
            return identify_parameters(
                library,
                logs,
                robot.processing,
                rows=options.rows,
                estimator=options.estimator,
                echo={"log": describe_settings(robot)["log"]},
            )

        # Friction that grows with the load is no payload.
        estimate = identify_loaded(library, recordings, robot.processing, fit)
        side = Identified(
            robot=robot,
            base=dynamics.derive_base_parameters(robot),
            sources=estimate.sources,
            values=estimate.parameters,
            covariance=estimate.covariance,
            notices=(*(note for entry in recordings for note in entry.notices), *estimate.notices),
        )
    elif len(given) > 1:
        first = estimates[0] if isinstance(estimates[0], str | PathLike) else "a fit"
        text = f"{first} is an estimate: give one estimate, or logs (`symid identify` makes one of several "
        text += "logs)"
        raise UsageError(Notice(code="usage.payload-inputs", text=text))
    else:
        side = build_identified(robot, *read_dynamics(estimates[0]))
    named = (
        replace(note, text=f"{name}: {note.text}") if note.code.startswith("identify") else note
        for note in (*side.robot.notices, *side.notices)
    )
    return replace(side, notices=tuple(named))


CONTROLLERS = ("ur", "franka")
"""Controllers that payloads are written for."""

FlangeFrame = str | Sequence[float] | None
"""A link of the URDF, or x, y, z, roll, pitch, yaw in the link frame (m, rad); None for the link frame."""

_LARGEST = 133.0
_LEFT_OUT = {"ur": "left out, which the controller takes as zero", "franka": "written as zero"}
_SCOPE = {
    "ur": (
        "it replaces the active payload as a whole, from PolyScope 3.15 (CB3) or 5.10 (e-Series) on; before, "
        "set_payload has no inertia; compare with the rated payload of the robot"
    ),
    "franka": (
        "a load is added to the end effector that is configured in Desk: enter the payload at one place "
        "only; compare with the rated payload of the robot"
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class PayloadCommand:
    """A payload as a controller, one of `CONTROLLERS`, takes it; `texts` are what to enter, by where.

    `frame` is that of centre and inertia, in words; `mass` kg; `com` centre of mass in m; `inertia` xx xy xz
    yy yz zz about it, kg m^2, None where it is not identified; `notices` say what is left out, and what else
    counts.
    """

    controller: str
    frame: str
    mass: float
    com: tuple[float, ...]
    inertia: tuple[float, ...] | None
    texts: Mapping[str, str]
    notices: tuple[Notice, ...]

    @property
    def text(self) -> str:
        """Return what to enter, and the frame."""
        lines = (f"{place}: {text}" for place, text in self.texts.items())
        return "\n".join((f"for {self.controller}, in {self.frame}:", *lines))


def build_payload_command(
    robot: Robot | None, found: dynamics.Payload, controller: str, frame: FlangeFrame = None
) -> PayloadCommand:
    """Return a payload as a controller takes it; `frame` is its flange, a link only if `robot` is given."""
    if controller not in CONTROLLERS:
        text = f"unknown controller {controller!r}; known are {', '.join(CONTROLLERS)}"
        raise UsageError(Notice(code="usage.controller", text=text))
    values = {entry.name: entry for entry in found.quantities}
    lacking = [entry for entry in found.quantities[:4] if entry.value is None]
    if lacking:
        names = "; ".join(f"{entry.name}: {entry.reason}" for entry in lacking)
        text = f"a payload without an identified centre is not for controllers ({names}): move more joints "
        text += "against gravity, with the payload and without it, or take missing values from a drawing"
        raise IdentifiabilityError(Notice(code="payload.controller-centre", text=text))
    rotation, origin, words = _locate_flange(robot, found.joint, frame)
    mass, *com = (values[name].value or 0.0 for name in ("mass", "cx", "cy", "cz"))
    centre = rotation.T @ (np.array(com) - origin)
    notices = [Notice(code="payload.controller-scope", text=f"{controller}: {_SCOPE[controller]}")]
    if frame is None:
        hint = [] if robot is None else _list_flanges(robot, found.joint)
        text = f"the flange of the controller is taken as {words}; if not, name it by --frame (frame=): "
        text += f"{'one of the links ' + ', '.join(hint) + ', or ' if hint else ''}x,y,z,roll,pitch,yaw"
        notices.insert(0, Notice(code="payload.controller-frame", text=text))
    moments = {entry.name: entry.value for entry in found.quantities if entry.name.startswith("J")}
    inertia = None
    if unknown := [name for name, value in moments.items() if value is None]:
        text = f"inertia {_LEFT_OUT[controller]}: {', '.join(unknown)} not identified; turn the load faster"
        notices.insert(0, Notice(code="payload.controller-inertia", text=text))
    else:
        tensor = np.zeros((3, 3))
        tensor[np.triu_indices(3)] = [float(value or 0.0) for value in moments.values()]
        tensor = rotation.T @ (tensor + np.triu(tensor, 1).T) @ rotation
        inertia = tuple(float(entry) for entry in tensor[np.triu_indices(3)])
        if controller == "ur" and max(map(abs, inertia)) > _LARGEST:
            text = f"Universal Robots take at most {_LARGEST:g} kg m^2 for each component of the inertia, "
            text += f"this payload has {max(inertia, key=abs):.4g}"
            raise EstimateError(Notice(code="payload.controller-limit", text=text))
    kilograms, place = _write_number(float(mass)), ", ".join(map(_write_number, centre.tolist()))
    xx, xy, xz, yy, yz, zz = map(_write_number, inertia or (0.0,) * 6)
    if controller == "ur":
        tail = "" if inertia is None else f", [{xx}, {yy}, {zz}, {xy}, {xz}, {yz}]"
        texts = {
            "URScript": f"set_target_payload({kilograms}, [{place}]{tail})",
            "URScript, older": f"set_payload({kilograms}, [{place}])",
        }
    else:
        columns = f"{xx}, {xy}, {xz}, {xy}, {yy}, {yz}, {xz}, {yz}, {zz}"
        message = f"mass: {kilograms}, center_of_mass: [{place}], load_inertia: [{columns}]"
        entries = f'"mass": {kilograms}, "centerOfMass": [{place}], "inertia": [{columns}]'
        texts = {
            "libfranka": f"robot.setLoad({kilograms}, {{{{{place}}}}}, {{{{{columns}}}}});",
            "franka_msgs/SetLoad": f"{{{message}}}",
            "endeffector-config.json": f"{{{entries}}}",
        }
    return PayloadCommand(
        controller=controller,
        frame=words,
        mass=float(mass),
        com=tuple(float(entry) for entry in centre),
        inertia=inertia,
        texts=texts,
        notices=tuple(notices),
    )


def _list_flanges(robot: Robot, joint: str) -> list[str]:
    """Return the links that a joint moves and that are fixed to each other."""
    return [link.name for link in robot.links if robot.joints[link.joint].name == joint]


def _locate_flange(robot: Robot | None, joint: str, frame: FlangeFrame) -> tuple[FloatArray, FloatArray, str]:
    """Return rotation (3, 3) and origin (3,) of the flange in the file's frame of the link, and words."""
    if frame is not None and not (isinstance(frame, str) and "," not in frame):
        try:
            numbers = [float(entry) for entry in (frame.split(",") if isinstance(frame, str) else frame)]
        except (TypeError, ValueError):
            numbers = []
        if len(numbers) != 6 or not np.all(np.isfinite(numbers)):
            expected = "expected the name of a link, or six numbers x,y,z,roll,pitch,yaw (m, rad)"
            raise UsageError(Notice(code="usage.payload-frame", text=f"--frame {frame}: {expected}"))
        # Rot(z, yaw) Rot(y, pitch) Rot(x, roll).
        rotation = scipy.spatial.transform.Rotation.from_euler("xyz", numbers[3:]).as_matrix()
        listed = ", ".join(f"{number:g}" for number in numbers)
        words = f"the frame at x, y, z, roll, pitch, yaw {listed} of the link frame of joint {joint!r}"
        return rotation, np.array(numbers[:3]), words
    if frame is None:
        return np.eye(3), np.zeros(3), f"the link frame of joint {joint!r}"
    if robot is None:
        text = f"the link {frame!r} is of a robot that is not known here: give it as well "
        text += "(symid.load_payload(path, robot)), or x,y,z,roll,pitch,yaw in the link frame (m, rad)"
        raise UsageError(Notice(code="usage.payload-frame", text=text))
    links = {link.name: link for link in robot.links}
    link = links.get(str(frame))
    if link is None or robot.joints[link.joint].name != joint:
        fixed = _list_flanges(robot, joint)
        text = f"the link {frame!r} is moved by joint {robot.joints[link.joint].name!r}" if link else ""
        hint = suggest_names(str(frame), links, before=", ").rstrip("?")
        text = text or f"there is no link {frame!r}{hint}"
        known = f"a link on joint {joint!r} ({', '.join(fixed)})" if fixed else "no link of this file"
        text += f"; --frame takes {known}, or x,y,z,roll,pitch,yaw in its link frame (m, rad)"
        raise UsageError(Notice(code="usage.payload-frame", text=text))
    inner, outer = build_frame(robot.joints[link.joint].frame, robot), build_frame(link.placement, robot)
    turn, gap = inner[:3, :3].T, outer[:3, 3] - inner[:3, 3]
    return turn @ outer[:3, :3], turn @ gap, f"the frame of the link {link.name!r}"


def _write_number(value: float) -> str:
    """Return a number with nine digits, without an exponent."""
    return np.format_float_positional(value + 0.0, precision=9, unique=False, fractional=False, trim="0")
