"""`symid excite ROBOT -o FILE`: a trajectory on which all parameters can be told."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from symid.cli.excite_options import excite_options
from symid.cli.inputs import check_output, load_robot, show_path
from symid.cli.options import force_option, friction_option, output_option, seed_option, verb
from symid.cli.output import Answer, Console, format_table
from symid.errors import Notice, OutputError, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.excitation.margins import Margin
    from symid.excitation.optimise import Excitation, ExcitationOptions
    from symid.robot.description import Robot

__all__ = ["command"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
    """What the command line says of the search; see `excite_options`."""

    harmonics: int
    period: float
    criterion: str
    weight: float
    moving: bool
    start: str | None
    share: float
    sweep: float
    velocity: float
    acceleration: float
    jerk: float | None
    workspace: Path | None
    torsion: float | None
    stiffness: str | None
    deviations: str | None
    candidates: int
    starts: int
    rate: float
    periods: int


@click.command("excite")
@click.argument("robot")
@excite_options
@friction_option
@seed_option
@output_option("Trajectory to write, .csv.")
@force_option
@verb
def command(
    console: Console,
    *,
    robot: str,
    friction: str | None,
    seed: int,
    output: Path | None,
    force: bool,
    **asked: Any,  # noqa: ANN401  the options of the search, typed in `_Asked`
) -> Answer:
    """Find the trajectory on which the parameters of a robot can be told best.

    A finite Fourier series of every joint, within all limits of the robot file at all times. The file is one
    that `symid simulate --trajectory FILE` follows.
    """
    order = _Asked(**asked)
    described = load_robot(robot, friction=friction)
    if output is not None and output.suffix.lower() != ".csv":
        text = f"a trajectory is written as .csv, got {output.suffix or 'no suffix'}"
        raise OutputError(Notice(code="output.unknown-suffix", text=text, file=str(output)))
    check_output(
        output, force=force, inputs=(described.path, *([order.workspace] if order.workspace else []))
    )
    options = _build_options(described, order)
    import numpy as np

    from symid.excitation.optimise import optimise_excitation

    found = optimise_excitation(
        described, options, rng=np.random.default_rng(seed), progress=console.progress
    )
    samples = 0
    if output is not None:
        from symid.excitation.trajectory_file import write_trajectory

        remarks = _list_remarks(described, found, seed)
        samples = write_trajectory(
            found.trajectory, output, described, rate=order.rate, periods=order.periods, remarks=remarks
        )
    result = {**_describe(described, found, seed), "file": output, "samples": samples, "rate": order.rate}
    return Answer(
        text=_write_text(found, output, samples),
        result=result,
        warnings=(*described.notices, *found.notices),
    )


def _build_options(robot: "Robot", order: _Asked) -> "ExcitationOptions":
    from symid.excitation.fourier import SeriesOptions
    from symid.excitation.limits import LimitOptions
    from symid.excitation.loads import LoadOptions
    from symid.excitation.optimise import ExcitationOptions
    from symid.excitation.problem import ProblemOptions
    from symid.excitation.workspace import Workspace, read_workspace

    start = _split("start", order.start, robot)
    series = SeriesOptions(harmonics=order.harmonics, period=order.period, rest=not order.moving, start=start)
    limits = LimitOptions(
        share=order.share,
        sweep=order.sweep,
        speed=order.velocity,
        acceleration=order.acceleration,
        jerk=order.jerk,
    )
    stiffness = _split("stiffness", order.stiffness, robot)
    if stiffness and order.torsion is None:
        text = "--stiffness belongs to --torsion, the largest torsion; give both"
        raise UsageError(Notice(code="usage.excitation", text=text))
    loads = LoadOptions(
        workspace=read_workspace(order.workspace, robot) if order.workspace else Workspace(),
        torsion=order.torsion,
        stiffness=stiffness,
    )
    deviations = _split("deviations", order.deviations, robot)
    return ExcitationOptions(
        problem=ProblemOptions(series=series, limits=limits, loads=loads, deviations=deviations),
        criterion=order.criterion,
        weight=order.weight,
        candidates=order.candidates,
        starts=min(order.starts, order.candidates),
    )


def _split(name: str, text: str | None, robot: "Robot") -> tuple[float, ...] | None:
    """Return the numbers of a list such as 1,2,3."""
    if text is None:
        return None
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError as error:
        message = f"--{name} {text}: expected {robot.freedom} numbers with commas between them"
        raise UsageError(Notice(code="usage.excitation", text=message)) from error
    if len(numbers) != robot.freedom:
        message = f"--{name}: {len(numbers)} numbers for {robot.freedom} joints; give one for each"
        raise UsageError(Notice(code="usage.excitation", text=message))
    return numbers


def _list_remarks(robot: "Robot", found: "Excitation", seed: int) -> tuple[str, ...]:
    return (
        f"{robot.name}: {found.trajectory.source}, seed {seed}",
        (
            f"condition number of the scaled regressor {found.condition:.4g}, best of random ones "
            f"{found.random_condition:.4g}"
        ),
        f"of every limit at least {1.0 - max(margin.share or 0.0 for margin in found.margins):.1%} is left",
    )


def _describe(robot: "Robot", found: "Excitation", seed: int) -> dict[str, object]:
    harmonics = (found.coefficients.shape[1] - 1) // 2
    return {
        "robot": robot.name,
        "trajectory": found.trajectory.source,
        "duration": found.trajectory.duration,
        "harmonics": harmonics,
        "seed": seed,
        "condition": found.condition,
        "random_condition": found.random_condition,
        "random_median": found.random_median,
        "factor": found.factor,
        "information": found.information,
        "random_information": found.random_information,
        "parameters": list(found.parameters),
        "joints": [
            {
                "name": joint.name,
                "centre": row[0],
                "sines": row[1 : harmonics + 1],
                "cosines": row[harmonics + 1 :],
            }
            for joint, row in zip(robot.axes, found.coefficients.tolist(), strict=True)
        ],
        "limits": [_describe_margin(margin) for margin in found.margins],
        "runs": [
            {
                "start": run.start,
                "condition": run.condition,
                "iterations": run.iterations,
                "status": run.status,
            }
            for run in found.runs
        ],
    }


def _describe_margin(margin: "Margin") -> dict[str, object]:
    return {
        "kind": margin.kind,
        "name": margin.name,
        "value": margin.value,
        "limit": margin.limit,
        "share_percent": None if margin.share is None else 100.0 * margin.share,
        "allowed_percent": 100.0 * margin.allowed,
    }


def _write_text(found: "Excitation", output: Path | None, samples: int) -> str:
    shared = [margin for margin in found.margins if margin.share is not None]
    kinds = tuple(dict.fromkeys(margin.kind for margin in shared))
    names = tuple(dict.fromkeys(margin.name for margin in shared))
    shares = {(margin.kind, margin.name): f"{margin.share:.1%}" for margin in shared}
    rows = [[name, *(shares.get((kind, name)) for kind in kinds)] for name in names]
    lines = [
        f"{found.trajectory.source}, {found.trajectory.duration:g} s",
        f"condition number of the regressor with columns of length one: {found.condition:.4g}",
        (
            f"  best of the random feasible trajectories {found.random_condition:.4g}, their median "
            f"{found.random_median:.4g}; {found.factor:.2f} times smaller than the best"
        ),
        (
            f"information per parameter (mean logarithm): {found.information:.4g}, most of the random ones "
            f"{found.random_information:.4g}"
        ),
        "",
        "part of each limit that is used, at most:",
        format_table(("joint", *kinds), rows),
    ]
    places = [[margin.name, margin.value] for margin in found.margins if margin.share is None]
    if places:
        lines += ["", format_table(("place", "least clearance/m"), places)]
    if output is not None:
        lines += ["", f"{show_path(output)}: {samples} samples of t, q, dq, ddq"]
    return "\n".join(lines)
