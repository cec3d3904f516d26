"""Logs, trajectories and payloads, in text for people and as objects for programs.

Checked logs, an exciting trajectory, what a robot carries -> blocks, dictionaries, warnings, the remarks at
the head of a trajectory's file.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.environment import show_path
from symid.errors import Notice
from symid.notation import INERTIAL
from symid.report.blocks import Block, Table, select_fields
from symid.robot import Robot

if TYPE_CHECKING:
    from symid.dynamics import ParameterChange, Payload
    from symid.excitation import OptimisedExcitation
    from symid.identification.diagnostics import LogCheck, LogExcitation, LogsCheck
    from symid.logs import JointSummary, LogTiming, Recording

_SHOWN = 12
_CONVENTIONS = {"urdf": "URDF", "origin": "frames by origin"}


def summarise_robot(robot: "Robot") -> str:
    """Return name, joints and convention."""
    convention = _CONVENTIONS.get(robot.convention, f"{robot.convention} DH")
    return f"{robot.name}, {robot.size} joint{'s'[: robot.size != 1]}, {convention}"


def show_robot_check(robot: "Robot", checked: "LogsCheck") -> tuple[Block, ...]:
    """Return what was read, the joints of every log, and what the logs tell of the parameters."""
    head = f"{robot.path}: {summarise_robot(robot)}: no mistakes"
    if not checked.logs:
        return (head,)
    keys = ("file", "samples", "duration", "period", "has_velocity", "second_encoder")
    header = ("log", "samples", "duration/s", "period/s", "velocity", "second encoder")
    entries = [describe_log(log.recording, log.timing, log.joints) for log in checked.logs]
    blocks: list[Block] = [Table(header, [[e[key] for key in keys] for e in entries], (0, 5), head)]
    blocks += [show_joints(e, log.joints) for e, log in zip(entries, checked.logs, strict=True)]
    if checked.copy is not None:
        file, notice = checked.copy
        blocks.append(f"{show_path(file)}: {notice.text}")
    if checked.excitation is not None:
        blocks += _show_identifiability(checked.excitation)
    return tuple(blocks)


def describe_robot_check(robot: "Robot", checked: "LogsCheck") -> dict[str, object]:
    """Return what was found as `symid check --json` gives it."""
    found: dict[str, object] = {
        "robot": robot.name,
        "file": robot.path,
        "convention": robot.convention,
        "joints": [
            {"name": joint.name, "kind": joint.kind.value, "friction": joint.friction.kind.value}
            for joint in robot.joints
        ],
        "logs": [describe_log(log.recording, log.timing, log.joints) for log in checked.logs],
    }
    if checked.copy is not None:
        file, notice = checked.copy
        found["resampled"] = {"file": str(file), "text": notice.text}
    if checked.excitation is not None:
        names = [joint.name for joint in robot.axes]
        found["dynamics"] = [
            {"file": check.source, **_describe_dynamics(check, names)} for check in checked.dynamics
        ]
        found["excitation"] = _describe_identifiability(checked.excitation)
    return found


def describe_log(
    recording: "Recording", timing: "LogTiming", joints: "tuple[JointSummary, ...]"
) -> dict[str, object]:
    """Return what the log itself says, without the robot's dynamics."""
    from symid.logs import get_second_encoder_side

    return {
        "file": recording.source,
        "samples": timing.samples,
        "duration": timing.duration,
        "period": recording.period,
        "has_velocity": recording.velocity is not None,
        "second_encoder": get_second_encoder_side(recording),
        "timing": {**asdict(timing), "even": timing.even},
        "joints": [asdict(joint) for joint in joints],
    }


def _describe_dynamics(check: "LogCheck", names: list[str]) -> dict[str, object]:
    """Return what the robot's dynamics says of a log."""
    return {
        "signs": [
            {**asdict(entry), "joint": names[entry.joint], "wrong": entry.wrong} for entry in check.signs
        ],
        "exchanges": [
            {**asdict(entry), "first": names[entry.first], "second": names[entry.second]}
            for entry in check.exchanges
        ],
        "torque_delay": None if check.delay is None else {**asdict(check.delay), "late": check.delay.late},
    }


def show_joints(entry: dict[str, object], joints: "tuple[JointSummary, ...]") -> Table:
    """Return the table of a log's joints."""
    header = (
        "joint",
        "from",
        "to",
        "top speed",
        "unit",
        "step",
        "still/%",
        "rms torque",
        "peak",
        "at peak/%",
    )
    rows = [
        (
            joint.name,
            joint.low,
            joint.high,
            joint.speed,
            joint.unit,
            joint.step or None,
            100.0 * joint.standstill,
            joint.torque,
            joint.peak,
            100.0 * joint.saturated,
        )
        for joint in joints
    ]
    return Table(header, rows, left=(0, 4), title=str(entry["file"]))


def _describe_identifiability(found: "LogExcitation") -> dict[str, object]:
    return {
        "parameters": [
            select_fields(entry, "name verdict relative_std_percent reason") for entry in found.parameters
        ],
        **select_fields(found, "singular_values=singular rank condition"),
    }


def _show_identifiability(found: "LogExcitation") -> tuple[Block, ...]:
    """Return what the logs tell of every parameter, and the singular values with the base rank marked."""
    rows = [
        (entry.name, entry.verdict, entry.relative_std_percent, entry.reason) for entry in found.parameters
    ]
    counts = ", ".join(
        f"{len(found.list_names(verdict))} {verdict}"
        for verdict in ("told", "vague", "not told", "refused")
        if found.list_names(verdict)
    )
    first = max(0, found.rank - _SHOWN // 2)
    shown = [f"{value:.2g}" for value in found.singular[first : first + _SHOWN]]
    shown.insert(found.rank - first, "|")
    listed = f"{'... ' if first else ''}{' '.join(shown)}"
    table = Table(("parameter", "verdict", "std/%", "why"), rows, left=(0, 1, 3))
    text = (
        f"What the logs tell: {counts}; condition {found.condition:.3g}\n"
        f"singular values of the scaled matrix about its rank {found.rank} of {len(found.singular)}: {listed}"
    )
    return (text, table)


def list_remarks(robot: "Robot", found: "OptimisedExcitation", seed: int) -> tuple[str, ...]:
    """Return what stands at the head of a trajectory's file."""
    return (
        f"{robot.name}: {found.trajectory.source}, seed {seed}",
        (
            f"condition number of the scaled regressor {found.condition:.4g}, best of random ones "
            f"{found.random_condition:.4g}"
        ),
        f"of every limit at least {1.0 - max(margin.share or 0.0 for margin in found.margins):.1%} is left",
    )


def describe_excitation(robot: "Robot", found: "OptimisedExcitation", seed: int) -> dict[str, object]:
    """Return the trajectory as `symid excite --json` gives it."""
    harmonics = (found.coefficients.shape[1] - 1) // 2
    figures = "condition random_condition random_median factor information random_information parameters"
    return {
        "robot": robot.name,
        "trajectory": found.trajectory.source,
        "duration": found.trajectory.duration,
        "harmonics": harmonics,
        "seed": seed,
        **select_fields(found, figures),
        "joints": [
            {
                "name": joint.name,
                "centre": row[0],
                "sines": row[1 : harmonics + 1],
                "cosines": row[harmonics + 1 :],
            }
            for joint, row in zip(robot.axes, found.coefficients.tolist(), strict=True)
        ],
        "limits": [
            {
                **select_fields(margin, "kind name value limit"),
                "share_percent": None if margin.share is None else 100.0 * margin.share,
                "allowed_percent": 100.0 * margin.allowed,
            }
            for margin in found.margins
        ],
        "runs": [select_fields(run, "start condition iterations status") for run in found.runs],
    }


def show_excitation(found: "OptimisedExcitation") -> tuple[Block, ...]:
    """Return the figures of a trajectory, the part of each limit that it uses, and clearances."""
    shared = [margin for margin in found.margins if margin.share is not None]
    kinds = tuple(dict.fromkeys(margin.kind for margin in shared))
    names = tuple(dict.fromkeys(margin.name for margin in shared))
    shares = {(margin.kind, margin.name): f"{margin.share:.1%}" for margin in shared}
    rows = [[name, *(shares.get((kind, name)) for kind in kinds)] for name in names]
    head = (
        f"{found.trajectory.source}, {found.trajectory.duration:g} s\n"
        f"condition number of the regressor with columns of length one: {found.condition:.4g}\n"
        f"  best of the random feasible trajectories {found.random_condition:.4g}, their median "
        f"{found.random_median:.4g}; {found.factor:.2f} times smaller than the best\n"
        f"information per parameter (mean logarithm): {found.information:.4g}, most of the random ones "
        f"{found.random_information:.4g}"
    )
    title = "part of each limit that is used, at most:"
    blocks: tuple[Block, ...] = (head, Table(("joint", *kinds), rows, title=title))
    places = [[margin.name, margin.value] for margin in found.margins if margin.share is None]
    if places:
        blocks += (Table(("place", "least clearance/m"), places),)
    return blocks


_FAR = 3.0


def describe_payload(robot: Robot, found: "Payload") -> dict[str, object]:
    """Return the payload as `symid payload --json` gives it."""
    by_name = {entry.name: entry for entry in found.quantities}
    return {
        "robot": robot.name,
        "joint": found.joint,
        "mass": by_name["mass"].value,
        "com": [by_name[name].value for name in ("cx", "cy", "cz")],
        "inertia": {name[1:]: entry.value for name, entry in by_name.items() if name.startswith("J")},
        "quantities": [asdict(entry) for entry in found.quantities],
        "standard": dict(zip(INERTIAL, found.standard.tolist(), strict=True)),
        **select_fields(found, "chi2 freedom scale moved"),
        "unexplained": [asdict(entry) for entry in found.unexplained],
        "friction": [asdict(entry) for entry in found.friction],
    }


def show_payload(robot: Robot, found: "Payload") -> tuple[Block, ...]:
    """Return the table of what is told, and what is refused, with the reasons."""
    head = (
        f"{robot.name}: what the link of joint {found.joint!r} carries\n"
        "in the frame that the robot file gives to the link; inertia about the centre of mass"
    )
    table = Table(
        ("quantity", "value", "std", "unit"),
        [
            [entry.name, entry.value, entry.std, entry.unit]
            for entry in found.quantities
            if entry.value is not None
        ],
        left=(0, 3),
    )
    blocks: list[Block] = [head, table]
    refused = [entry for entry in found.quantities if entry.value is None]
    if refused:
        blocks.append("\n".join(f"refused: {entry.name}: {entry.reason}" for entry in refused))
    if found.scale > 1.0:
        blocks.append(f"deviations are {found.scale:.3g} times those of the estimates: chi^2 is too large")
    return tuple(blocks)


def _list_changes(changes: Sequence["ParameterChange"]) -> str:
    return ", ".join(
        f"{entry.name} from {entry.before:.4g} to {entry.after:.4g} ({entry.deviations:+.2g} std)"
        for entry in changes
    )


def warn_payload(found: "Payload") -> tuple[Notice, ...]:
    """Return what speaks against the result."""
    notices = []
    refused = [entry.name for entry in found.quantities if entry.value is None]
    if refused:
        text = f"not told: {', '.join(refused)}; do not take what a controller asks for from a guess"
        notices.append(Notice(code="payload.refused", text=text))
    if found.unexplained and found.doubtful:
        text = (
            f"base parameters changed as no payload changes them: {_list_changes(found.unexplained)}; "
            "something else changed between the logs, or friction and filters bias one of them: use the same "
            "motions"
        )
        notices.append(Notice(code="payload.unexplained", text=text))
    if found.friction:
        changes = _list_changes(found.friction)
        text = f"friction changed: {changes}; gears brake more under load and less when warm"
        notices.append(Notice(code="payload.friction-changed", text=text))
    if found.moved > _FAR:
        text = (
            f"the nearest body that can exist is {found.moved:.2g} standard deviations away from the change "
            "of the base parameters: something else changed between the logs"
        )
        notices.append(Notice(code="payload.inconsistent", text=text))
    return tuple(notices)
