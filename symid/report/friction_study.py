"""The report of the study of friction: one HTML file that needs nothing else.

Input: `FrictionStudy`. Output: a page with the tables of Zhang, Hu and Zou (2021), theirs and ours side by
side, all estimators on one data set, and counterparts of their figures 1, 2 and 6 to 11.

The figures show the draw of the study's first seed.

Supported: printing, light and dark screens, readers that speak; no scripts, no network.
Not supported: figures 3 (a flow chart), 4 (a photograph) and 5, the test of poses, which is part of
`symid identify --rows friction` and needs recordings.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from symid import __version__
from symid.identification.storage import write_file
from symid.report.friction_study_drawings import Drawing, draw_study
from symid.report.friction_study_tables import StudyTable, list_tables, write_verdict
from symid.report.templates import write_page
from symid.report.verdict import Verdict
from symid.study.friction_checks import FrictionCheck
from symid.study.friction_study import FrictionStudy

__all__ = ["FrictionStudyPage", "build_friction_study_report", "write_friction_study_report"]

_TEMPLATE = "friction_study.html.jinja"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionStudyPage:
    """The context of the page: its fields are the template's variables."""

    robot: str
    verdict: Verdict
    checks: tuple[tuple[str, str, str, str], ...]
    tables: tuple[StudyTable, ...]
    drawings: tuple[Drawing, ...]
    settings: tuple[tuple[str, str], ...]
    notices: tuple[str, ...]
    origin: tuple[str, ...]


def write_friction_study_report(path: Path, study: FrictionStudy) -> Path:
    """Write the page to `path`, at once or not at all, and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_file(path, write_page(_TEMPLATE, build_friction_study_report(study)))


def build_friction_study_report(study: FrictionStudy) -> FrictionStudyPage:
    """Return all that the page shows."""
    first, last = study.seeds
    draws = (
        ("draws of Table 1", study.agreement[0].draws),
        ("draws of Table 3", study.recovery[0].draws),
        ("draws of Table 4", study.gains[0].draws),
        ("draws of the second robot", study.second[0].draws),
    )
    return FrictionStudyPage(
        robot="Zhang, Hu and Zou (2021)",
        verdict=_find_verdict(study.checks),
        checks=tuple((entry.name, entry.bar, entry.found, write_verdict(entry)) for entry in study.checks),
        tables=list_tables(study),
        drawings=draw_study(study),
        settings=(
            ("seeds", f"{first} to {last}"),
            *((name, str(count)) for name, count in draws),
            ("default estimator", "varpro"),
        ),
        notices=(),
        origin=(f"Written by symid {__version__}",),
    )


def _find_verdict(checks: Sequence[FrictionCheck]) -> Verdict:
    """Return how many claims are met; those that are not, and the predictions, in words."""
    judged = [check for check in checks if check.met is not None]
    missed = [check for check in judged if not check.met]
    told = [check for check in checks if check.met is None]
    headline = (
        f"{len(missed)} of {len(judged)} claims are missed."
        if missed
        else f"All {len(judged)} claims that can be judged are met."
    )
    return Verdict(
        level="fair" if missed else "good",
        headline=headline,
        details=tuple(f"{check.name}: {check.found}" for check in (*missed, *told)),
    )
