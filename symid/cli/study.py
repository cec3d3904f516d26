"""`symid study NAME`: many identifications of a simulated robot with a known truth, in one table."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.friction_study import FRICTION_SEED, study_friction_tables
from symid.cli.inputs import check_output, load_robot, load_robot_library
from symid.cli.options import DEFAULT_SEED, force_option, output_option, verb
from symid.cli.output import Answer, Console, format_table
from symid.cli.study_identification import study_identification
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.study.elastic_study import Cell, DatasetStudy, ElasticStudy
    from symid.study.many_joints import ManyJointsResult
    from symid.study.tracking_study import TrackingStudy

__all__ = ["command"]

_ROBOTS = {"elastic": "two_link_elastic", "tracking": "two_link_elastic", "six-joints": "puma560_elastic"}
_SEEDS = {"elastic": 100, "tracking": 20, "six-joints": 1}
_FRICTION = "friction-tables"
_PRECISION = "precision"
_CUTOFF = "cutoff"
_TIMED = ("elastic", _FRICTION)


@click.command("study")
@click.argument("name", type=click.Choice((*_ROBOTS, _FRICTION, _PRECISION, _CUTOFF)))
@click.argument("inputs", nargs=-1, metavar="[ROBOT [LOG]]")
@click.option("--robot", metavar="ROBOT", help="Another robot with elastic joints and all values stated.")
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    metavar="N",
    help="How many, from --seed on.  [default: 100; 20; 1; 1000; 400]",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    metavar="N",
    help=f"Of all random numbers.  [default: {DEFAULT_SEED}; friction-tables: {FRICTION_SEED}]",
)
@click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Processes; one a core by default.")
@click.option(
    "--times",
    is_flag=True,
    help="Of elastic and friction-tables: what each method took; differs in every run.",
)
@output_option("Of friction-tables: a page with its tables and figures.")
@force_option
@verb
def command(
    console: Console,
    *,
    name: str,
    inputs: tuple[str, ...],
    robot: str | None,
    seeds: int | None,
    seed: int | None,
    jobs: int | None,
    times: bool,
    output: Path | None,
    force: bool,
) -> Answer:
    """Compare methods on simulated robots whose truth is known.

    elastic: errors of every method on four sets of logs, clean and noisy. tracking: how well
    links follow when the controller knows the identified model, another one, or none.
    six-joints: dynamics of an elastic six-axis arm, judged on a held-out motion.
    friction-tables: the tables of Zhang, Hu and Zou (2021) on joint friction, theirs and ours side by side.
    precision ROBOT: errors of identification against the Cramer-Rao bound, on five random excitations.
    cutoff ROBOT LOG: what the cut-off of the position filter does to what a fit foretells.
    """
    _refuse_options(name, robot, output, times=times)
    _refuse_inputs(name, inputs)
    if name in {_CUTOFF, _PRECISION}:
        return study_identification(console, name, inputs, seeds=seeds, seed=seed, jobs=jobs)
    if name == _FRICTION:
        # Minutes before it is written: a page that cannot be is refused now.
        check_output(output, force=force)
        return study_friction_tables(console, seeds=seeds, seed=seed, jobs=jobs, timed=times, output=output)
    described = load_robot(robot or _ROBOTS[name])
    first = DEFAULT_SEED if seed is None else seed
    numbers = range(first, first + (seeds or _SEEDS[name]))

    def progress(done: int, whole: int) -> None:
        console.progress(f"{done} of {whole}")

    path = Path(described.path)
    # The library is made here, with its progress told, before processes look for it.
    library = load_robot_library(described, console)
    match name:
        case "elastic":
            from symid.study.elastic_study import study_elastic

            found = study_elastic(path, numbers, jobs=jobs, timed=times, progress=progress)
            return Answer(text=_write_elastic(found), result=_describe_elastic(found, numbers))
        case "tracking":
            from symid.study.tracking_study import study_tracking

            tracked = study_tracking(path, numbers, jobs=jobs, progress=progress)
            return Answer(text=_write_tracking(tracked), result=asdict(tracked))
    from symid.study.elastic_runs import Condition
    from symid.study.many_joints import study_many_joints

    return _answer_many(
        [study_many_joints(described, library, entry, number) for number in numbers for entry in Condition]
    )


def _answer_many(results: Sequence["ManyJointsResult"]) -> Answer:
    return Answer(
        text="\n\n".join(map(_write_many, results)),
        result={"runs": [_describe_many(result) for result in results]},
        warnings=tuple(dict.fromkeys(notice for result in results for notice in result.notices)),
    )


def _refuse_options(name: str, robot: str | None, output: Path | None, *, times: bool) -> None:
    """Raise where an option was given that the study does not read."""
    if name == _FRICTION and robot is not None:
        text = f"--robot {robot}: {_FRICTION} has joints of its own, those of the paper; leave it out"
        raise UsageError(Notice(code="usage.study-option", text=text))
    if name != _FRICTION and output is not None:
        text = f"-o {output}: only {_FRICTION} writes a page; for the results of {name} use --json"
        raise UsageError(Notice(code="usage.study-option", text=text))
    if times and name not in _TIMED:
        text = f"--times: {name} measures none; {' and '.join(_TIMED)} do"
        raise UsageError(Notice(code="usage.study-option", text=text))


def _refuse_inputs(name: str, inputs: Sequence[str]) -> None:
    """Raise where a study is given inputs that it does not take, or lacks those that it needs.

    Raises:
        UsageError: there are too many, or too few.
    """
    wanted = {_PRECISION: "ROBOT", _CUTOFF: "ROBOT LOG"}.get(name, "")
    if len(inputs) != len(wanted.split()):
        took = f"`symid study {name} {wanted}`".replace(" `", "`")
        text = f"{len(inputs)} arguments after {name!r}; it is called as {took}"
        raise UsageError(Notice(code="usage.study-inputs", text=text))


def _describe_elastic(study: "ElasticStudy", numbers: range) -> dict[str, object]:
    return {
        "robot": study.robot,
        "seeds": list(numbers),
        "studies": [
            {
                "dataset": entry.dataset,
                "condition": entry.condition.value,
                "seeds": entry.seeds,
                "bound_percent": entry.bound,
                "spring_bound_percent": entry.spring_bound,
                "methods": [_describe_cell(cell) for cell in entry.cells],
            }
            for entry in study.studies
        ],
    }


def _describe_cell(cell: "Cell") -> dict[str, object]:
    return {
        "method": cell.method,
        "parameter_error_percent": asdict(cell.parameter),
        "hysteresis_error_percent": asdict(cell.hysteresis),
        "excited_error_percent": asdict(cell.excited),
        "seconds": cell.seconds,
        "iterations": cell.iterations,
        "outcomes": dict(cell.outcomes),
        "choices": dict(cell.choices),
    }


def _write_elastic(study: "ElasticStudy") -> str:
    head = (
        f"{study.robot}: errors in percent, median and 90th percentile. param: the largest of all dynamic "
        "parameters; hyst: of the worse joint on the held-out motion; in range: on the same, scaled into the "
        "torsion of the logs"
    )
    parts = [head]
    parts += [_write_dataset(entry) for entry in study.studies]
    return "\n\n".join(parts)


def _write_dataset(entry: "DatasetStudy") -> str:
    plural = "s" if entry.seeds > 1 else ""
    title = f"{entry.dataset}, {entry.condition.value}, {entry.seeds} run{plural}"
    if entry.bound == entry.bound:
        title += (
            f"; Cramer-Rao: {entry.bound:.3g} % standard deviation of the least certain parameter, "
            f"{entry.spring_bound:.3g} % where the form of the springs is known"
        )
    times = {cell.method: f"{cell.seconds:.2f}" for cell in entry.cells if math.isfinite(cell.seconds)}
    rows = [
        [
            cell.method,
            _show(cell.parameter.median),
            _show(cell.parameter.percentile90),
            _show(cell.hysteresis.median),
            _show(cell.hysteresis.percentile90),
            _show(cell.excited.median),
            *([times[cell.method]] if times else []),
            _join(cell.choices or cell.outcomes),
        ]
        for cell in entry.cells
    ]
    heading = ["method", "param", "90th", "hyst", "90th", "in range", *(["s"] if times else []), "outcome"]
    return f"{title}\n{format_table(heading, rows)}"


def _show(value: float) -> str:
    return "-" if value == float("inf") else f"{value:.3g}"


def _join(counts: Sequence[tuple[str, int]]) -> str:
    return ", ".join(word if len(counts) == 1 else f"{word} {count}" for word, count in counts)


def _write_tracking(study: "TrackingStudy") -> str:
    heading = ["case", *(f"{name} rms/mrad" for name in study.joints)]
    rows = [[case, *(f"{1e3 * spread.median:.4g}" for spread in spreads)] for case, spreads in study.rms]
    compared = [
        [
            f"{entry.first} less {entry.second}",
            entry.joint,
            f"{1e3 * entry.difference.mean:.4g}",
            f"{1e3 * entry.difference.low:.4g} .. {1e3 * entry.difference.high:.4g}",
            entry.difference.verdict,
        ]
        for entry in study.comparisons
    ]
    return "\n\n".join(
        (
            f"{study.robot}: tracking of the held-out motion, medians over {study.seeds} seeds",
            format_table(heading, rows),
            "paired differences of RMS errors in mrad",
            format_table(["difference", "joint", "mean", "95 % interval", "verdict"], compared),
        )
    )


def _describe_many(result: "ManyJointsResult") -> dict[str, object]:
    return {
        "robot": result.robot,
        "condition": result.condition.value,
        "parameters": result.parameters,
        "joints": result.joints,
        "methods": [asdict(entry) for entry in result.methods],
        "condition_elimination": result.condition_elimination,
        "condition_energy": result.condition_energy,
    }


def _write_many(result: "ManyJointsResult") -> str:
    rows = [
        [f"{entry.method}{suffix}", *(f"{value:.4f}" for value in values)]
        for entry in result.methods
        for suffix, values in (("", entry.residual), (", true parameters", entry.floor))
    ]
    title = (
        f"{result.robot}, {result.condition.value}: {result.parameters} parameters; "
        "what is left of the torque of a held-out motion, in percent"
    )
    conditions = (
        f"condition of the column-scaled rows: elimination {result.condition_elimination:.3g}, "
        f"energy {result.condition_energy:.3g}"
    )
    return f"{title}\n{format_table(['method', *result.joints], rows)}\n{conditions}"
