"""`symid study precision` and `symid study cutoff`: what identification reaches, in tables.

Input: options of `symid study`. Output: an `Answer`.
"""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from symid.cli.inputs import load_robot, load_robot_library, read_one_log
from symid.cli.options import DEFAULT_SEED
from symid.cli.output import Answer, Console, format_table

if TYPE_CHECKING:  # these load numpy
    from symid.study.cutoff import CutoffStudy
    from symid.study.precision import PrecisionStudy

__all__ = ["study_identification"]

_SEEDS = 400


def study_identification(
    console: Console,
    name: str,
    inputs: Sequence[str],
    *,
    seeds: int | None,
    seed: int | None,
    jobs: int | None,
) -> Answer:
    """Return the answer of "precision" or "cutoff"; see `_study_precision` and `_study_cutoff`."""
    if name == "cutoff":
        return _study_cutoff(console, inputs[0], Path(inputs[1]))
    first = DEFAULT_SEED if seed is None else seed
    return _study_precision(console, inputs[0], seeds=seeds, seed=first, jobs=jobs)


def _study_precision(
    console: Console, robot: str, *, seeds: int | None, seed: int, jobs: int | None
) -> Answer:
    """Return errors against the Cramer-Rao bound.

    Args:
        console: told how many tasks are done.
        robot: name or path.
        seeds: draws of the noise; None for the study's own number.
        seed: the first one.
        jobs: processes; None for one a core.
    """
    from symid.study.precision import study_precision

    described = load_robot(robot)
    # The library is made here, with its progress told, before processes look for it.
    load_robot_library(described, console)

    def progress(done: int, whole: int) -> None:
        console.progress(f"{done} of {whole}")

    numbers = range(seed, seed + (seeds or _SEEDS))
    found = study_precision(Path(described.path), numbers, jobs=jobs, progress=progress)
    return Answer(text=_write_precision(found), result=asdict(found), warnings=described.notices)


def _write_precision(study: "PrecisionStudy") -> str:
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
    return f"{title}\n{format_table(heading, rows, (0, 3))}"


def _study_cutoff(console: Console, robot: str, log: Path) -> Answer:
    """Return what fits with different cut-offs foretell.

    Args:
        console: told how many cut-offs are done.
        robot: name or path.
        log: of that robot.
    """
    from symid.elastic.motor_side import build_motor_recording, build_rigid_variant
    from symid.study.cutoff import study_cutoff

    described = load_robot(robot)
    recording = read_one_log(log, described)
    rigid = build_rigid_variant(described) if any(described.elastic) else described
    library = load_robot_library(rigid, console)

    def progress(done: int, whole: int) -> None:
        console.progress(f"{done} of {whole}")

    measured = build_motor_recording(recording, described)
    found = study_cutoff(library, measured, described.processing, progress=progress)
    warnings = (*described.notices, *recording.notices, *library.notices)
    return Answer(text=_write_cutoff(found), result=asdict(found), warnings=warnings)


def _write_cutoff(study: "CutoffStudy") -> str:
    heading = ["cut-off, Hz", f"torque, 1 in {study.factor}", "torque, all", "momentum"]
    rows = [
        [f"{line.cutoff:g}", *map(_show_percent, (line.decimated, line.plain, line.momentum))]
        for line in study.lines
    ]
    title = (
        f"{study.robot}, {study.source}: fitted to the first 60 %, residual of the rest within "
        f"{study.band:g} Hz in percent;\nthe cut-off that identify takes is {study.chosen:g} Hz"
    )
    return f"{title}\n{format_table(heading, rows)}"


def _show_percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
