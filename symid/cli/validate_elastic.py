"""`symid validate` for estimates of elastic joints: torques that they foretell, motions that they lead to.

Input: what the command line says. Output: an answer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from symid.cli.elastic_settings import check_settings, cut_logs, find_asked_cutoff
from symid.cli.elastic_tables import describe_alignment
from symid.cli.inputs import load_robot_library, load_robot_of_estimate, read_one_log
from symid.cli.options import DEFAULT_SEED
from symid.cli.output import Answer, Console, format_table
from symid.cli.simulate import build_trajectory
from symid.cli.stated_values import check_values
from symid.cli.tables import describe_residual, show_residual
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.codegen.library import Library
    from symid.elastic.estimate import ElasticEstimate
    from symid.elastic.tracking import TrackingRun
    from symid.excitation.trajectories import Trajectory
    from symid.report.elastic_trial import ElasticTrial
    from symid.robot.description import Robot

__all__ = ["ElasticCall", "answer_elastic", "find_missed_gate"]

_MISSED = 1
_TC_JOINTS = 2
_BEYOND = 1.05
"""Part of the torsion seen in the fit up to which a spring counts as known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticCall:
    """What the command line says; `seed` None for the trajectory that validation is made for."""

    robot: str
    estimate: Path
    log: Path
    gate: float | None
    pairs: tuple[tuple[str, str], ...]
    tracking: bool = False
    against: Path | None = None
    seed: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Tracking:
    """Closed loops along one trajectory, the first of rigid joints, and the methods of the others."""

    trajectory: "Trajectory"
    runs: tuple["TrackingRun", ...]
    methods: Mapping[str, str]
    seed: int | None


def find_missed_gate(reached: float, gate: float | None, source: str) -> tuple[Notice, ...]:
    """Return what is wrong with a mean relative residual of `reached` percent; nothing without a gate."""
    if gate is None or reached <= gate:
        return ()
    text = f"mean relative residual {reached:.4f} %, the gate is {gate:g} %"
    return (Notice(code="validate.gate-missed", text=text, file=source),)


def _find_missed_gates(trial: "ElasticTrial", gate: float | None) -> tuple[Notice, ...]:
    """Return what misses the gate: dynamics, and each of the two tables that springs take part in."""
    return tuple(
        replace(notice, text=f"{caption.rstrip('.')}: {notice.text}")
        for (caption, _), reached in zip(trial.residuals, trial.means, strict=True)
        for notice in find_missed_gate(reached, gate, trial.source)
    )


def answer_elastic(console: Console, call: ElasticCall) -> Answer:
    """Return what an estimate explains of a log, and how links follow with it.

    Delay and offsets of the log's link encoders are taken out first, as in an identification.
    """
    from symid.elastic.signals import find_positions
    from symid.elastic.storage import read_elastic_estimate
    from symid.elastic.torsion import prepare_aligned
    from symid.report.elastic_trial import try_estimate

    check_settings(call.pairs, "elastic")
    robot = load_robot_of_estimate(call.robot, read_elastic_estimate(call.estimate), call.pairs)
    read = read_one_log(call.log, robot, "an elastic robot")
    (recording,) = cut_logs((read,), robot.processing)
    # A log with one position is refused before minutes go into a library.
    find_positions(recording)
    if call.tracking:
        check_values(robot)
    library = load_robot_library(robot, console)
    found = read_elastic_estimate(call.estimate, library.card)
    cases = _list_cases(call, found, library) if call.tracking else {}
    (moved,), alignment, told = prepare_aligned(library, (recording,))
    console.progress(f"validating on {recording.source}")
    trial = try_estimate(found, library, moved, cutoff=find_asked_cutoff(robot, call.pairs))
    tracking = _track(console, call, robot, library, cases) if call.tracking else None
    joints = [joint.name for joint in library.card.joints]
    units = [joint.position_unit for joint in library.card.joints]
    errors = _find_missed_gates(trial, call.gate)
    result = {
        **_describe_trial(found, trial),
        "alignment": None if alignment is None else describe_alignment(alignment, joints),
        "tracking": None if tracking is None else _describe_tracking(tracking, joints, units),
        "gate": call.gate,
        "accepted": not errors,
    }
    text = [_show_trial(robot, trial), *([_show_tracking(tracking, joints, units)] if tracking else [])]
    return Answer(
        text="\n\n".join(text),
        result=result,
        warnings=(*robot.notices, *library.notices, *recording.notices, *told, *_warn(found, trial)),
        errors=errors,
        exit_code=_MISSED if errors else 0,
    )


def _warn(found: "ElasticEstimate", trial: "ElasticTrial") -> tuple[Notice, ...]:
    """Return what makes the log a poor test: that it is one of the fit, or goes beyond those."""
    notices = []
    if trial.fitted:
        text = "the estimate was fitted to this very log, which is no test of it; validate on another motion"
        notices.append(Notice(code="validate.fitted-log", text=text, file=trial.source))
    reached = {joint.joint: float(abs(joint.torsion).max()) for joint in trial.joints}
    beyond = [
        f"{entry.joint} {reached[entry.joint]:.3g} against {entry.torsion:.3g} {entry.position_unit}"
        for entry in found.springs
        if entry.told and reached[entry.joint] > _BEYOND * entry.torsion
    ]
    if beyond:
        text = (
            f"torsion beyond that of the logs of the fit, where springs are continued as they end: "
            f"{', '.join(beyond)}; identify from logs that reach as far"
        )
        notices.append(Notice(code="validate.beyond-torsion", text=text, file=trial.source))
    return tuple(notices)


def _list_cases(
    call: ElasticCall, found: "ElasticEstimate", library: "Library"
) -> dict[str, "ElasticEstimate"]:
    """Return the estimates whose feed-forward is tried, by name.

    Raises:
        EstimateError: the other estimate is of another model.
        UsageError: an estimate has no springs, which a feed-forward needs.
    """
    from symid.elastic.storage import read_elastic_estimate

    files = {"Case 1": (call.estimate, found)}
    if call.against is not None:
        files["Case 2"] = (call.against, read_elastic_estimate(call.against, library.card))
    lacking = [
        path
        for path, estimate in files.values()
        if not estimate.springs or not all(spring.told for spring in estimate.springs)
    ]
    if lacking:
        text = (
            "the estimate lacks springs, and a feed-forward of elastic joints needs them all; "
            "identify them too"
        )
        raise UsageError(*(Notice(code="usage.no-springs", text=text, file=str(path)) for path in lacking))
    return {f"{name}: {estimate.method}": estimate for name, (_, estimate) in files.items()}


def _track(
    console: Console,
    call: ElasticCall,
    robot: "Robot",
    library: "Library",
    cases: Mapping[str, "ElasticEstimate"],
) -> _Tracking:
    """Return the closed loops of all cases, simulated with the values of the robot file."""
    import numpy as np

    from symid.elastic.tracking import simulate_tracking
    from symid.simulation.elastic_options import build_noisy_options

    plain = call.seed is None and robot.freedom == _TC_JOINTS
    seed = None if plain else DEFAULT_SEED if call.seed is None else call.seed
    trajectory = build_trajectory(robot, "tc" if plain else "fourier", np.random.default_rng(seed or 0))
    console.progress(f"tracking {trajectory.source} with {len(cases) + 1} kinds of feed-forward")
    bases = len(library.card.beta)
    runs = simulate_tracking(
        robot,
        library,
        {name: estimate.build_fit(bases) for name, estimate in cases.items()},
        trajectory,
        build_noisy_options(),
        progress=console.progress,
    )
    methods = {name: estimate.method for name, estimate in cases.items()}
    return _Tracking(trajectory=trajectory, runs=runs, methods=methods, seed=seed)


def _describe_trial(found: "ElasticEstimate", trial: "ElasticTrial") -> dict[str, object]:
    return {
        "robot": found.robot,
        "method": found.method,
        "log": trial.source,
        "samples": len(trial.joints[0].time),
        "residual": describe_residual(trial.residuals[0][1]),
        "mean_relative_percent": trial.mean_relative_percent,
        "tables": [
            {"caption": caption, "residual": describe_residual(entries), "mean_relative_percent": mean}
            for (caption, entries), mean in zip(trial.residuals, trial.means, strict=True)
        ],
    }


def _show_trial(robot: "Robot", trial: "ElasticTrial") -> str:
    """Return the headline, and the tables of residuals under their captions."""
    mean = trial.mean_relative_percent
    head = (
        f"{robot.name} on {trial.source}: mean relative residual {mean:.4f} %, by motors and links together"
    )
    if trial.means[1:]:
        head += f"; with the springs {max(trial.means[1:]):.4f} %"
    parts = [f"{caption}\n\n{show_residual(entries)}" for caption, entries in trial.residuals]
    lacking = [joint.joint for joint in trial.joints if joint.final is None]
    if lacking:
        parts.append(
            f"The estimate has no spring of {', '.join(lacking)}; what it would say of the log is not known, "
            "and the gate says nothing of it."
        )
    return "\n\n".join((head, *parts))


def _describe_tracking(tracking: _Tracking, joints: Sequence[str], units: Sequence[str]) -> dict[str, object]:
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
                        joints, units, run.rms.tolist(), run.peak.tolist(), strict=True
                    )
                ],
            }
            for run in tracking.runs
        ],
    }


def _show_tracking(tracking: _Tracking, joints: Sequence[str], units: Sequence[str]) -> str:
    """Return the table of tracking errors, root mean square and peak of each joint."""
    rows = [
        [joint, run.name, 1e3 * float(run.rms[index]), 1e3 * float(run.peak[index]), f"m{unit}"]
        for index, (joint, unit) in enumerate(zip(joints, units, strict=True))
        for run in tracking.runs
    ]
    head = (
        f"How links follow {tracking.trajectory.source}: closed loop on the values of the robot file, which "
        "the feed-forward does not know. The rigid one has dynamics and friction of Case 1."
    )
    header = ("joint", "feed-forward", "rms", "peak", "unit")
    return f"{head}\n\n{format_table(header, rows, left=(0, 1, 4))}"
