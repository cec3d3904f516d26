"""`symid study friction-tables`: the tables of Zhang, Hu and Zou (2021), theirs and ours side by side.

Input: options of `symid study`. Output: an `Answer`, and one page with tables and figures where asked for.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from symid.cli.inputs import show_path
from symid.cli.output import Answer, Console, format_table

if TYPE_CHECKING:  # these load numpy
    from symid.report.friction_study_tables import StudyTable
    from symid.study.friction_checks import FrictionCheck

__all__ = ["FRICTION_SEED", "study_friction_tables"]

FRICTION_SEED = 0
"""First seed unless another is asked for."""
_WIDTH = 110


def study_friction_tables(
    console: Console,
    *,
    seeds: int | None,
    seed: int | None,
    jobs: int | None,
    timed: bool,
    output: Path | None,
) -> Answer:
    """Return the tables of friction.

    Args:
        console: told how many tasks are done.
        seeds: draws of the noise; None for the study's own number.
        seed: the first one; None for the study's own.
        jobs: processes; None for one a core.
        timed: whether the time that each estimator takes is measured.
        output: page to write; None for none.
    """
    from symid.report.friction_study import write_friction_study_report
    from symid.report.friction_study_tables import list_tables
    from symid.study.friction_study import DRAWS, study_friction

    first = FRICTION_SEED if seed is None else seed

    def progress(done: int, whole: int) -> None:
        console.progress(f"{done} of {whole}")

    console.progress("all estimators on one data set")
    numbers = range(first, first + (seeds or DRAWS))
    study = study_friction(numbers, jobs=jobs, timed=timed, progress=progress)
    text = [*map(_write_table, list_tables(study)), _write_checks(study.checks)]
    if output is not None:
        text.append(f"report: {show_path(write_friction_study_report(output, study))}")
    return Answer(text="\n\n".join(text), result={**asdict(study), "file": output})


def _write_table(table: "StudyTable") -> str:
    notes = [textwrap.fill(note, width=_WIDTH) for note in table.notes]
    left = (0, 1) if table.names[1] == "estimator" else (0,)
    return "\n".join((table.title, format_table(table.names, table.rows, left), *notes))


def _write_checks(checks: "Sequence[FrictionCheck]") -> str:
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
