"""Studies of simulated robots, in tables for people and as objects for programs.

Input: the products of the room `study`. Output: blocks, dictionaries.
"""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.report.blocks import Block, Table, format_table

if TYPE_CHECKING:  # these load numpy
    from symid.study.cutoff import CutoffStudy
    from symid.study.elastic_study import Cell, DatasetStudy, ElasticStudy
    from symid.study.friction_checks import FrictionCheck
    from symid.study.friction_study import FrictionStudy
    from symid.study.many_joints import ManyJointsResult
    from symid.study.precision import PrecisionStudy
    from symid.study.tracking_study import TrackingStudy

__all__ = [
    "describe_elastic_study",
    "describe_many_joints",
    "show_cutoff",
    "show_elastic_study",
    "show_friction_tables",
    "show_many_joints",
    "show_precision",
    "show_tracking",
]

_WIDTH = 110


def show_precision(study: "PrecisionStudy") -> tuple[Block, ...]:
    """Return the errors of every method over the Cramer-Rao bound."""
    heading = ["method", "mean", "worst", "of", "95 % held, %", "price at most, %", "least eigenvalue"]
    rows = [
        [
            entry.method,
            f"{entry.mean_ratio:.3f}",
            f"{entry.worst_ratio:.3f}",
            entry.worst,
            f"{entry.coverage_percent:.1f}",
            f"{entry.worst_price_percent:.2g}",
            "-" if entry.least_eigenvalue is None else f"{entry.least_eigenvalue:.3g}",
        ]
        for entry in study.methods
    ]
    title = (
        f"{study.robot}: {len(study.names)} parameters, five random excitations of {study.samples} "
        f"samples, condition {study.condition:.3g}, {study.seeds} seeds;\n"
        "root-mean-square errors over the Cramer-Rao bound"
    )
    return (format_table(heading, rows, (0, 3), title),)


def show_cutoff(study: "CutoffStudy") -> tuple[Block, ...]:
    """Return what fits with different cut-offs leave of the torque that they were not fitted to."""
    heading = ["cut-off, Hz", f"torque, 1 in {study.factor}", "torque, all", "momentum"]
    rows = [
        [f"{line.cutoff:g}", *map(_show_percent, (line.decimated, line.plain, line.momentum))]
        for line in study.lines
    ]
    title = (
        f"{study.robot}, {study.source}: fitted to the first 60 %, residual of the rest within "
        f"{study.band:g} Hz in percent;\nthe cut-off that identify takes is {study.chosen:g} Hz"
    )
    return (format_table(heading, rows, title=title),)


def _show_percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def describe_elastic_study(study: "ElasticStudy", numbers: range) -> dict[str, object]:
    """Return the errors of every method on every set of logs as `--json` gives them."""
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


def show_elastic_study(study: "ElasticStudy") -> tuple[Block, ...]:
    """Return the errors of every method, a table for each set of logs."""
    head = (
        f"{study.robot}: errors in percent, median and 90th percentile. param: the largest of all dynamic "
        "parameters; hyst: of the worse joint on the held-out motion; in range: on the same, scaled into the "
        "torsion of the logs"
    )
    return (head, *map(_show_dataset, study.studies))


def _show_dataset(entry: "DatasetStudy") -> Table:
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
            _show_error(cell.parameter.median),
            _show_error(cell.parameter.percentile90),
            _show_error(cell.hysteresis.median),
            _show_error(cell.hysteresis.percentile90),
            _show_error(cell.excited.median),
            *([times[cell.method]] if times else []),
            _join(cell.choices or cell.outcomes),
        ]
        for cell in entry.cells
    ]
    heading = ["method", "param", "90th", "hyst", "90th", "in range", *(["s"] if times else []), "outcome"]
    return format_table(heading, rows, title=title)


def _show_error(value: float) -> str:
    return "-" if value == float("inf") else f"{value:.3g}"


def _join(counts: Sequence[tuple[str, int]]) -> str:
    return ", ".join(word if len(counts) == 1 else f"{word} {count}" for word, count in counts)


def show_tracking(study: "TrackingStudy") -> tuple[Block, ...]:
    """Return how links follow with every model, and what is certain of the differences."""
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
    return (
        f"{study.robot}: tracking of the held-out motion, medians over {study.seeds} seeds",
        format_table(heading, rows),
        "paired differences of RMS errors in mrad",
        format_table(["difference", "joint", "mean", "95 % interval", "verdict"], compared),
    )


def describe_many_joints(result: "ManyJointsResult") -> dict[str, object]:
    """Return what each method leaves of a held-out motion as `--json` gives it."""
    return {
        "robot": result.robot,
        "condition": result.condition.value,
        "parameters": result.parameters,
        "joints": result.joints,
        "methods": [asdict(entry) for entry in result.methods],
        "condition_elimination": result.condition_elimination,
        "condition_energy": result.condition_energy,
    }


def show_many_joints(result: "ManyJointsResult") -> Table:
    """Return what each method leaves of a held-out motion, next to what the true parameters leave."""
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
    return format_table(["method", *result.joints], rows, title=title, note=conditions)


def show_friction_tables(study: "FrictionStudy") -> tuple[Block, ...]:
    """Return the tables of joint friction, the paper's and ours, and what is asked of ours."""
    from symid.report.friction_study_tables import list_tables

    tables = (
        format_table(
            table.names,
            table.rows,
            (0, 1) if table.names[1] == "estimator" else (0,),
            table.title,
            "\n".join(textwrap.fill(note, width=_WIDTH) for note in table.notes),
        )
        for table in list_tables(study)
    )
    return (*tables, _show_checks(study.checks))


def _show_checks(checks: "Sequence[FrictionCheck]") -> str:
    from symid.report.friction_study_tables import write_verdict

    lines = [
        textwrap.fill(
            f"{write_verdict(check):6}  {check.name}: {check.found} (asked: {check.bar})",
            width=_WIDTH,
            subsequent_indent=" " * 8,
        )
        for check in checks
    ]
    return "\n".join(("what is asked, and what came out", *lines))
