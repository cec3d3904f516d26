"""What an estimate explains of a log: tables for people, an object for programs, figures for a notebook.

Input: `RigidTrial`, `ElasticOutcome`, `FrictionTrial`. Output: blocks, dictionaries.
"""

from collections.abc import Sequence
from dataclasses import asdict

from symid.elastic.trial import ElasticTrial
from symid.report.blocks import Block, Drawing, format_table
from symid.report.elastic_loops import build_trial
from symid.report.elastic_text import describe_alignment
from symid.report.estimate_text import (
    describe_band,
    describe_residual,
    describe_validation,
    show_band,
    show_residual,
)
from symid.report.identification import draw_joint
from symid.robot.description import Robot
from symid.tasks.validate import ElasticOutcome, FrictionTrial, RigidTrial, Tracking, Trial

__all__ = ["describe_trial", "draw_trial", "show_trial"]


def show_trial(found: Trial) -> tuple[Block, ...]:
    """Return a headline, and tables of residuals."""
    match found:
        case RigidTrial():
            return _show_rigid(found)
        case FrictionTrial():
            return _show_friction(found)
        case ElasticOutcome():
            followed = () if found.tracking is None else _show_tracking(found.robot, found.tracking)
            return (*_show_elastic(found.robot, found.trial), *followed)


def describe_trial(found: Trial) -> dict[str, object]:
    """Return the trial as `symid validate --json` gives it, but for the gate."""
    match found:
        case RigidTrial():
            return {
                **describe_validation(found.validation),
                **({} if found.band is None else {"band": describe_band(found.band)}),
                "processing": {**asdict(found.settled.processing), "origin": dict(found.settled.origin)},
            }
        case FrictionTrial():
            return {**describe_validation(found.validation), "laws": dict(found.laws)}
        case ElasticOutcome():
            return _describe_elastic(found)


def draw_trial(found: Trial) -> tuple[Drawing, ...]:
    """Return measured and predicted torques against time; of elastic joints torque over torsion."""
    if isinstance(found, ElasticOutcome):
        section = build_trial(found.trial)
        return tuple(
            Drawing(entry.loops, f"{entry.joint}: joint torque over torsion") for entry in section.joints
        )
    drawn = (draw_joint(series, found.validation.rows) for series in found.validation.series)
    return tuple(Drawing(entry.prediction, f"{entry.joint}: measured and predicted") for entry in drawn)


def _show_rigid(found: RigidTrial) -> tuple[Block, ...]:
    """Return the headline with the processing, and the table of residuals."""
    kind = " (joints taken as rigid)" if any(found.robot.elastic) else ""
    within = "" if found.band is None else f" within {found.band.band:g} Hz"
    headline = (
        f"{found.robot.name}{kind} on {found.validation.source}{within}: mean relative residual "
        f"{found.mean_relative_percent:.4f} %"
    )
    table = show_residual(found.validation.residual) if found.band is None else show_band(found.band)
    return (f"{headline}\n{found.settled.tell()}", table)


def _show_friction(found: FrictionTrial) -> tuple[Block, ...]:
    """Return the headline, and the table of residuals with the laws."""
    validation = found.validation
    rows = [
        [
            entry.joint,
            found.laws[entry.joint],
            f"{entry.relative_percent:.4f}",
            entry.std,
            entry.unit,
            entry.samples,
        ]
        for entry in validation.residual
    ]
    head = (
        f"{found.robot.name}, friction and rigid part on {validation.source}: mean relative residual "
        f"{validation.mean_relative_percent:.4f} %"
    )
    return (head, format_table(("joint", "law", "relative/%", "RMS", "unit", "rows"), rows, left=(0, 1, 4)))


def _show_elastic(robot: Robot, trial: ElasticTrial) -> tuple[Block, ...]:
    mean = trial.mean_relative_percent
    head = (
        f"{robot.name} on {trial.source}: mean relative residual {mean:.4f} %, by motors and links together"
    )
    if trial.means[1:]:
        head += f"; with the springs {max(trial.means[1:]):.4f} %"
    blocks: list[Block] = [head]
    for caption, entries in trial.residuals:
        blocks += [caption, show_residual(entries)]
    lacking = [joint.joint for joint in trial.joints if joint.final is None]
    if lacking:
        blocks.append(
            f"The estimate has no spring of {', '.join(lacking)}; what it would say of the log is not known, "
            "and the gate says nothing of it."
        )
    return tuple(blocks)


def _list_joints(robot: Robot) -> tuple[list[str], list[str]]:
    """Return the names of the joints, and the units of their positions."""
    units = ["m" if joint.kind.value == "prismatic" else "rad" for joint in robot.axes]
    return [joint.name for joint in robot.axes], units


def _show_tracking(robot: Robot, tracking: Tracking) -> tuple[Block, ...]:
    """Return the table of tracking errors, root mean square and peak of each joint."""
    rows = [
        [joint, run.name, 1e3 * float(run.rms[index]), 1e3 * float(run.peak[index]), f"m{unit}"]
        for index, (joint, unit) in enumerate(zip(*_list_joints(robot), strict=True))
        for run in tracking.runs
    ]
    head = (
        f"How links follow {tracking.trajectory.source}: closed loop on the values of the robot file, which "
        "the feed-forward does not know. The rigid one has dynamics and friction of Case 1."
    )
    header = ("joint", "feed-forward", "rms", "peak", "unit")
    return (head, format_table(header, rows, left=(0, 1, 4)))


def _describe_elastic(found: ElasticOutcome) -> dict[str, object]:
    trial, (joints, _) = found.trial, _list_joints(found.robot)
    return {
        "robot": found.estimate.robot,
        "method": found.estimate.method,
        "log": trial.source,
        "samples": len(trial.joints[0].time),
        "residual": describe_residual(trial.residuals[0][1]),
        "mean_relative_percent": trial.mean_relative_percent,
        "tables": [
            {"caption": caption, "residual": describe_residual(entries), "mean_relative_percent": mean}
            for (caption, entries), mean in zip(trial.residuals, trial.means, strict=True)
        ],
        "alignment": None if found.alignment is None else describe_alignment(found.alignment, joints),
        "tracking": None if found.tracking is None else _describe_tracking(found.robot, found.tracking),
    }


def _describe_tracking(robot: Robot, tracking: Tracking) -> dict[str, object]:
    joints: tuple[Sequence[str], Sequence[str]] = _list_joints(robot)
    return {
        "trajectory": tracking.trajectory.source,
        "duration": tracking.trajectory.duration,
        "seed": tracking.seed,
        "runs": [
            {
                "feed_forward": run.name,
                "method": tracking.methods.get(run.name),
                "joints": [
                    {"joint": joint, "rms": rms, "peak": peak, "unit": unit}
                    for joint, unit, rms, peak in zip(
                        *joints, run.rms.tolist(), run.peak.tolist(), strict=True
                    )
                ],
            }
            for run in tracking.runs
        ],
    }
