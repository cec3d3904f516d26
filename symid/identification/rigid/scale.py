"""The scale of identified torques, against the values that the robot file has, joint by joint.

Values and covariance of base parameters, states -> `JointScale` of every joint that can be compared.

    r = rms(t) / rms(t'),    t = Y b, t' = Y b' over the base parameters whose value the file knows (b')
    s = t' t / t' t', its deviation from the covariance of b

Units, gears and torque constants scale all values alike, and no residual of a fit shows it: only the masses
of the robot file do. Parameters that the file leaves open, as those of rotors and friction, do not count.
Bodies differ from drawings, and robots carry tools: where these may explain s, as in wrists that the file has
balanced, nothing is said.

    std(s)^2 = sum over x (Y_x' t' / t' t')^2 std(x)^2, x the ten parameters of each link, and of a payload

Supported: robots any of whose base parameters is known.
Not supported: joints whose torque has no known part, as a vertical axis with a rotor.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard
from symid.dynamics import evaluate_torque_regressor
from symid.errors import Notice
from symid.identification.estimators import ParameterEstimate
from symid.identification.judge import POLICY, numerics
from symid.notation import INERTIAL
from symid.robot import JointKind, Robot

_POSES = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class JointScale:
    """How many times the torque of a joint is that of the robot file's values.

    `ratio` of rms, `aligned` the part of it that is in proportion, with its standard deviation `std`, and
    `doubt`, the one by which it may differ from 1 by other bodies than the file's.
    """

    joint: str
    ratio: float
    aligned: float
    std: float
    doubt: float

    def is_beyond(self, limit: float = POLICY.scale) -> bool:
        """Return whether the torque surely is more than `limit` times as large or small, and no body's."""
        spread = POLICY.printed * self.std
        differs = abs(self.aligned - 1.0) > POLICY.printed * float(np.hypot(self.std, self.doubt))
        return differs and (abs(self.aligned) - spread > limit or (self.ratio + spread) * limit < 1.0)


def _build_doubts(robot: Robot, states: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return torques (t, n, 10) along q, dq and ddq (t, n) that bodies have per deviation from the file's.

    Of every link, and of a tool.
    """
    bodies = {link: joint.inertial for link, joint in enumerate(robot.joints) if joint.inertial}
    links = [link for link, body in bodies.items() if body[9] > 0.0]
    columns = evaluate_torque_regressor(robot, [(link, name) for link in links for name in INERTIAL], *states)
    table = np.array([bodies[link] for link in links]).reshape(-1, len(INERTIAL))
    mass = table[:, 9]
    # The radius of gyration about the origin of the link's frame.
    radius = np.sqrt(0.5 * (table[:, 0] + table[:, 3] + table[:, 5]) / mass)
    tool, lever = POLICY.drawing * mass.sum(), POLICY.drawing * robot.reach
    sizes = [POLICY.drawing * m * r**_POWERS for m, r in zip(mass, radius, strict=True)]
    last = columns[:, :, -len(INERTIAL) :] * (tool * lever**_POWERS)[: columns.shape[2]]
    return columns * np.concatenate([*sizes, np.zeros(0)]), last


_POWERS = np.array([len(name) - name.startswith("M") for name in INERTIAL])
"""Of a length in the ten parameters of a body: XX, MX, M."""


def compare_scales(  # noqa: PLR0917 - a fit, its states and its robot
    card: ModelCard,
    robot: Robot | None,
    states: Sequence[FloatArray] | FloatArray,
    columns: FloatArray,
    values: FloatArray,
    covariance: FloatArray,
) -> tuple[JointScale, ...]:
    """Return the scales of the joints whose torque has a known part.

    `columns` (t, n, b) of base parameters along the states q, dq and ddq (t, n); their `values` (b,), NaN
    where not identified, with `covariance`. Without the robot no bodies but the file's are thought of.
    """
    file = np.array([np.nan if entry.value is None else entry.value for entry in card.beta])
    known = np.isfinite(file) & np.isfinite(values)
    whole = columns @ np.nan_to_num(values)
    mine, theirs = (columns[:, :, known] @ entry[known] for entry in (values, file))
    found, slopes = list[JointScale](), np.zeros((len(card.joints), int(known.sum())))
    for joint, entry in enumerate(card.joints):
        t, other = mine[:, joint], theirs[:, joint]
        sizes = [float(np.linalg.norm(part)) for part in (t, other, whole[:, joint])]
        # A known part that is nothing beside the torque of rotors and unknown links tells of no scale.
        if (
            sizes[1] <= numerics.EXACT * np.linalg.norm(theirs)
            or max(sizes[:2]) < POLICY.relevance * sizes[2]
        ):
            continue
        slope = columns[:, joint, known].T @ other / sizes[1] ** 2
        spread = float(np.sqrt(max(slope @ covariance[np.ix_(known, known)] @ slope, 0.0)))
        aligned, ratio = float(other @ t) / sizes[1] ** 2, sizes[0] / sizes[1]
        slopes[joint] = slope
        found.append(JointScale(joint=entry.name, ratio=ratio, aligned=aligned, std=spread, doubt=0.0))
    far = [max(entry.ratio, 1.0 / max(entry.ratio, numerics.TINY)) ** 2 > POLICY.scale for entry in found]
    if robot is None or not any(far):
        return tuple(found)
    # Some states are enough for what takes the parameters of links to those of the model.
    some = slice(None, None, max(1, len(columns) // _POSES))
    links, tool = _build_doubts(robot, [np.ascontiguousarray(part[some]) for part in states])
    table = columns[some].reshape(-1, len(card.beta))
    grouped = np.linalg.lstsq(table, np.concatenate([links, tool], axis=2).reshape(len(table), -1))[0]
    parts = {card.joints[joint].name: slope @ grouped[known] for joint, slope in enumerate(slopes)}
    # A tool adds to a torque, and takes nothing off.
    ends = [None if scale.ratio > 1.0 else links.shape[2] for scale in found]
    sizes = [float(np.linalg.norm(parts[scale.joint][:end])) for scale, end in zip(found, ends, strict=True)]
    return tuple(replace(scale, doubt=size) for scale, size in zip(found, sizes, strict=True))


def compare_fit_scales(  # noqa: PLR0917 - a fit, its states and its robot
    library: Library,
    robot: Robot,
    parameters: Sequence[ParameterEstimate],
    covariance: Sequence[Sequence[float]],
    motion: Sequence[Sequence[float]] = (),
    refused: Collection[str] = (),
) -> tuple[JointScale, ...]:
    """Return the scales of a fit, at the states of its logs (t, 3 n), or at random ones where it has none."""
    count, values = len(library.card.beta), {entry.name: k for k, entry in enumerate(parameters)}
    known = {k: values.get(entry.name) for k, entry in enumerate(library.card.beta)}
    pairs = [(k, j) for k, j in known.items() if j is not None and parameters[j].name not in refused]
    own, theirs = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
    found, spreads = np.full(count, np.nan), np.zeros((count, count))
    found[own] = [parameters[j].value for _, j in pairs]
    if covariance:
        spreads[np.ix_(own, own)] = np.array(covariance)[np.ix_(theirs, theirs)]
    if motion:
        states = np.array(motion).reshape(len(motion), 3, -1).transpose(1, 0, 2)
    else:
        # q within the limits or a turn, of the same random motion each time.
        draw, plain = np.random.default_rng(1), {JointKind.PRISMATIC: 1.0}
        spans = [joint.limits.position or (-(a := plain.get(joint.kind, np.pi)), a) for joint in robot.axes]
        low, high = np.array(spans).T
        q = draw.uniform(low, high, (_POSES, len(spans)))
        states = np.stack([q, *draw.standard_normal((2, _POSES, len(spans)))])
    (columns,) = library.evaluate("torque_regressor", *states)
    return compare_scales(library.card, robot, states, columns, found, spreads)


def keep_overloads(
    beyond: Mapping[str, tuple[float, float]], scales: Sequence[JointScale]
) -> dict[str, tuple[float, float]]:
    """Return the joints of `find_overloads`; none where the file's own bodies contradict its limits.

    Where bodies explain such a torque better than they explain the limit, the limits of the file are
    placeholders: many files have 1 or 10 N m everywhere.
    """
    for entry in scales:
        torque, most = beyond.get(entry.joint, (0.0, 0.0))
        sure = entry.std <= 0.01 * POLICY.uncertain * entry.ratio
        if most and sure and abs(np.log(entry.ratio)) < abs(np.log(entry.ratio * most / torque)):
            return {}
    return dict(beyond)


def describe_scales(
    scales: Sequence[JointScale], robot: Robot, code: str, file: str = ""
) -> tuple[Notice, ...]:
    """Return the warning on joints whose torque surely has another scale than the robot file's values."""
    beyond = [entry for entry in scales if entry.is_beyond()]
    if not beyond:
        return ()
    listed = ", ".join(f"{entry.joint!r} {entry.ratio:.3g}" for entry in beyond)
    text = f"the torques differ in scale from the robot file's values ({listed} times): "
    if robot.log.torque is not None and robot.log.torque.unit.endswith("A"):
        text += (
            "torque constants, gears or the side of the currents may be wrong, or these values are; check "
        )
        text += "[joint.drive] and [log.torque]"
    else:
        text += "they may be motor currents, percent, or of the motor side, or these values are wrong; state "
        text += "unit and side in [log.torque], gears and torque constants in [joint.drive], or give --units "
        text += "torque=A to `symid new`"
    return (Notice(code=code, text=text, file=file or robot.path),)
