"""How an iteration came to its end: merit, change and residual norms over the iterations.

Input: the history of a fit. Output: `ConvergenceSection`, figures and a table ready to print.

Supported: histories without norms. Not supported: one entry only, which is no course to show.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.elastic.fit import HistoryEntry
from symid.report.figures import build_line_figure
from symid.report.lines import STYLES, Line

__all__ = ["ConvergenceSection", "build_convergence"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ConvergenceSection:
    """Figures as SVG, perhaps empty; `names` of the table's columns, one row an iteration."""

    words: str
    course: str
    norms: str
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def build_convergence(
    history: Sequence[HistoryEntry], joints: Sequence[tuple[str, str]], outcome: str
) -> ConvergenceSection | None:
    """Return the section of a history, None where it has fewer than two entries.

    Args:
        history: of the iterations.
        joints: name and unit of torque of every joint.
        outcome: of which method, and how it ended, in words.
    """
    finite = [entry for entry in history if np.isfinite([entry.merit, entry.change, *entry.norms]).all()]
    if len(finite) < 2:
        return None
    count = len(joints)
    heads = ["energy rows (J)", *(f"{name} ({unit})" for name, unit in joints)]
    heads = heads if all(len(entry.norms) == count + 1 for entry in finite) else []
    return ConvergenceSection(
        words=f"{len(history)} iterations of {outcome}.",
        course=_draw_course(finite),
        norms=_draw_norms(finite, heads) if heads else "",
        names=("iteration", "merit", "relative change", "damping", *heads),
        rows=tuple(
            (
                str(number),
                f"{entry.merit:.6g}",
                f"{entry.change:.2e}",
                f"{entry.damping:g}",
                *(f"{norm:.5g}" for norm in (entry.norms if heads else ())),
            )
            for number, entry in enumerate(history, start=1)
        ),
    )


def _draw_course(history: Sequence[HistoryEntry]) -> str:
    number = np.arange(1.0, len(history) + 1.0)
    merit = np.array([entry.merit for entry in history])
    change = np.array([entry.change for entry in history])
    lines = [
        Line(label="merit", style="first", x=number, y=merit, markers=True),
        Line(label="relative change of the parameters", style="second", x=number, y=change, markers=True),
    ]
    lines = [line for line in lines if np.any(line.y > 0.0)]
    if not lines:
        return ""
    return build_line_figure(
        "Convergence",
        "Merit and relative change of the parameters against the number of the iteration, logarithmic.",
        ("iteration", "merit, change (1)"),
        lines,
        logarithmic=True,
        whole=True,
    )


def _draw_norms(history: Sequence[HistoryEntry], heads: Sequence[str]) -> str:
    """Return each norm relative to the first of it, so that units do not matter."""
    number = np.arange(1.0, len(history) + 1.0)
    lines = []
    for index, head in enumerate(heads):
        values = np.array([entry.norms[index] for entry in history])
        if values[0] > 0.0:
            style = STYLES[index % len(STYLES)]
            lines.append(Line(label=head, style=style, x=number, y=values / values[0], markers=True))
    if not lines:
        return ""
    return build_line_figure(
        "Residual norms",
        "Norms of the residuals, relative to the first iteration, against the number of the iteration.",
        ("iteration", "norm / first norm"),
        lines,
        whole=True,
    )
