"""Checked logs, exciting trajectories and payloads as text, objects for JSON and warnings."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.environment import show_path
from symid.errors import Notice
from symid.notation import INERTIAL
from symid.report.blocks import Block, Table, select_fields, tabulate
from symid.robot import Robot

if TYPE_CHECKING:
    from symid.dynamics import ParameterChange, Payload
    from symid.excitation import OptimisedExcitation
    from symid.identification.diagnostics import LogsCheck
    from symid.logs import JointSummary, LogTiming, Recording

_SHOWN = 12
"""Singular values on either side of the rank."""
_VERDICTS = ("identifiable", "poorly identifiable", "not identifiable", "refused")


def summarise_robot(robot: "Robot") -> str:
    """Return name, joints and convention."""
    others = {"urdf": "URDF", "mjcf": "MJCF", "origin": "frames by origin"}
    convention = others.get(robot.convention, f"{robot.convention} DH")
    return f"{robot.name}, {robot.size} joint{'s'[: robot.size != 1]}, {convention}"


def show_robot_check(robot: "Robot", checked: "LogsCheck") -> tuple[Block, ...]:
    """Return what was read, the joints of every log, and which parameters are identifiable."""
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
    found = checked.excitation
    if found is not None:
        verdicts = [entry.verdict for entry in found.parameters]
        counts = ", ".join(f"{verdicts.count(name)} {name}" for name in _VERDICTS if name in verdicts)
        first = max(0, found.rank - _SHOWN // 2)
        shown = [f"{value:.2g}" for value in found.singular[first : first + _SHOWN]]
        shown.insert(found.rank - first, "|")
        columns = "parameter=name; verdict; std/%=relative_std_percent; why=reason"
        blocks += [
            (
                f"Identifiability: {counts}; condition {found.condition:.3g}\n"
                f"singular values of the scaled matrix about its rank {found.rank} of {len(found.singular)}: "
                f"{'... ' if first else ''}{' '.join(shown)}"
            ),
            tabulate(found.parameters, columns, (0, 1, 3)),
        ]
    return tuple(blocks)


def describe_robot_check(robot: "Robot", checked: "LogsCheck") -> dict[str, object]:
    """Return what was found as `symid check --json` gives it."""
    found: dict[str, object] = {
        **select_fields(robot, "robot=name file=path convention"),
        "joints": [
            {"name": joint.name, "kind": joint.kind.value, "friction": joint.friction.law}
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
            {
                "file": check.source,
                "signs": [{**asdict(entry), "joint": names[entry.joint]} for entry in check.signs],
                "mistake": check.mistake and asdict(check.mistake),
                "torque_delay": None
                if check.delay is None
                else {**asdict(check.delay), "late": check.delay.late},
            }
            for check in checked.dynamics
        ]
        verdict = "name verdict relative_std_percent reason"
        found["excitation"] = {
            "parameters": [select_fields(entry, verdict) for entry in checked.excitation.parameters],
            **select_fields(checked.excitation, "singular_values=singular rank condition"),
        }
    return found


def describe_log(
    recording: "Recording", timing: "LogTiming", joints: "tuple[JointSummary, ...]"
) -> dict[str, object]:
    """Return what the log itself says, without the robot's dynamics."""
    from symid.logs import get_second_encoder_side

    return {
        "file": recording.source,
        **select_fields(timing, "samples duration"),
        "period": recording.period,
        "has_velocity": recording.velocity is not None,
        "second_encoder": get_second_encoder_side(recording),
        "timing": {**asdict(timing), "even": timing.even},
        "joints": [asdict(joint) for joint in joints],
    }


def show_joints(entry: dict[str, object], joints: "tuple[JointSummary, ...]") -> Table:
    """Return the table of a log's joints."""
    return tabulate(
        joints,
        "joint=name; from=low; to=high; top speed=speed; unit; step; still/%=still; rms torque=torque; peak; "
        "at peak/%=at_peak",
        (0, 4),
        str(entry["file"]),
        step=lambda joint: joint.step or None,
        still=lambda joint: 100.0 * joint.standstill,
        at_peak=lambda joint: 100.0 * joint.saturated,
    )


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
        **select_fields(found.trajectory, "trajectory=source duration"),
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


def describe_gain(factor: float) -> str:
    """Return how much smaller a condition number is than that of the best random trajectory."""
    return f"{factor:.2f} times smaller" if factor >= 1.0 else "no smaller"


def show_excitation(found: "OptimisedExcitation") -> tuple[Block, ...]:
    """Return the figures of a trajectory, the part of each limit that it uses, and clearances."""
    shares = {
        (margin.kind, margin.name): f"{margin.share:.1%}"
        for margin in found.margins
        if margin.share is not None
    }
    kinds, names = (tuple(dict.fromkeys(key[place] for key in shares)) for place in (0, 1))
    rows = [[name, *(shares.get((kind, name)) for kind in kinds)] for name in names]
    head = (
        f"{found.trajectory.source}, {found.trajectory.duration:g} s\n"
        f"condition number of the regressor (column-scaled): {found.condition:.4g}\n"
        f"  best of the random feasible trajectories {found.random_condition:.4g}, their median "
        f"{found.random_median:.4g}; {describe_gain(found.factor)} than the best\n"
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


def describe_payload(robot: str, found: "Payload") -> dict[str, object]:
    """Return the payload as `symid payload --json` gives it."""
    by_name = {entry.name: entry for entry in found.quantities}
    return {
        "robot": robot,
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


def show_payload(robot: str, found: "Payload") -> tuple[Block, ...]:
    """Return the table of identifiable quantities, and the others with the reasons."""
    head = (
        f"{robot}: payload on the link of joint {found.joint!r}\n"
        "in the link frame of the robot file; inertia about the centre of mass"
    )
    known = [entry for entry in found.quantities if entry.value is not None]
    refused = [entry for entry in found.quantities if entry.value is None]
    blocks: list[Block] = [head, tabulate(known, "quantity=name; value; std; unit", (0, 3))]
    if refused:
        blocks.append("\n".join(f"refused: {entry.name}: {entry.reason}" for entry in refused))
    if found.scale > 1.0:
        text = f"standard deviations are multiplied by {found.scale:.3g}, because chi^2 is too large"
        blocks.append(text)
    return tuple(blocks)


def _list_changes(changes: Sequence["ParameterChange"]) -> str:
    return ", ".join(
        f"{entry.name} from {entry.before:.4g} to {entry.after:.4g} ({entry.deviations:+.2g} std)"
        for entry in changes
    )


def warn_payload(found: "Payload") -> tuple[Notice, ...]:
    """Return the warnings of a payload."""
    notices = []
    refused = [entry.name for entry in found.quantities if entry.value is None]
    if refused:
        text = f"not identifiable: {', '.join(refused)}; do not enter guessed values in a controller"
        notices.append(Notice(code="payload.refused", text=text))
    if found.unexplained and found.doubtful:
        text = (
            f"base parameters changed in a way that no payload explains: {_list_changes(found.unexplained)}. "
            "Something else changed between the logs, or friction and filters bias one of them; use the same "
            "motions"
        )
        notices.append(Notice(code="payload.unexplained", text=text))
    if found.friction:
        changes = _list_changes(found.friction)
        text = f"friction changed: {changes}; gear friction grows with load and falls with temperature"
        notices.append(Notice(code="payload.friction-changed", text=text))
    if found.moved > _FAR:
        text = (
            f"the nearest physically consistent body is {found.moved:.2g} standard deviations away from the "
            "change of the base parameters: something else changed between the logs"
        )
        notices.append(Notice(code="payload.inconsistent", text=text))
    return tuple(notices)
