"""Methods next to each other: what each of them reached, which was chosen, and why.

Input: `MethodScore` of every method. Output: `ComparisonSection`, tables and figures ready to print.

Supported: single values, and medians with their 90th percentiles over many runs; methods that failed.
Not supported: measures of which less is not better.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from symid.report.bars import Interval, build_interval_figure

__all__ = ["Comparison", "ComparisonSection", "MethodLine", "MethodScore", "build_comparison"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodScore:
    """What one method reached.

    Args:
        method: its name.
        middles: one a measure, the value or the median; None where it has none.
        highs: one a measure, the 90th percentile; empty where there was one run only.
        outcome: how it ended, in words.
        chosen: whether its result is the one that is reported.
    """

    method: str
    middles: tuple[float | None, ...]
    highs: tuple[float | None, ...] = ()
    outcome: str = ""
    chosen: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Scores of methods on the same logs.

    Args:
        measures: name and unit of each; less is better.
        scores: one a method, in the order of the table.
        words: sentences on the choice, and on what was compared.
    """

    measures: tuple[tuple[str, str], ...]
    scores: tuple[MethodScore, ...]
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodLine:
    """A row of the table of methods, ready to print."""

    method: str
    chosen: bool
    values: tuple[str, ...]
    outcome: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonSection:
    """The table of methods, words on the choice, and a caption and a figure (SVG) a measure."""

    words: tuple[str, ...]
    caption: str
    names: tuple[str, ...]
    lines: tuple[MethodLine, ...]
    has_outcomes: bool
    figures: tuple[tuple[str, str], ...]


def build_comparison(comparison: Comparison) -> ComparisonSection | None:
    """Return the section, None where there is nothing to compare."""
    measures, scores = comparison.measures, comparison.scores
    if len(scores) < 2:
        return None
    many = any(entry.highs for entry in scores)
    what = ": median, and 90th percentile in brackets" if many else ""
    return ComparisonSection(
        words=comparison.words,
        caption=f"Methods on the same logs{what}. Less is better.",
        names=tuple(f"{name} ({unit})" for name, unit in measures),
        lines=tuple(
            MethodLine(
                method=entry.method,
                chosen=entry.chosen,
                values=tuple(_write_score(entry, index) for index in range(len(measures))),
                outcome=entry.outcome,
            )
            for entry in scores
        ),
        has_outcomes=any(entry.outcome for entry in scores),
        figures=tuple(
            (_capitalise(f"{name}: {_describe_marks(many=many)}"), drawing)
            for index, (name, unit) in enumerate(measures)
            if (drawing := _draw_measure(index, f"{name} ({unit})", scores))
        ),
    )


def _capitalise(text: str) -> str:
    return text[:1].upper() + text[1:]


def _describe_marks(*, many: bool) -> str:
    return "median, with a line to the 90th percentile." if many else "a mark for every method."


def _write_score(entry: MethodScore, index: int) -> str:
    middle, high = entry.middles[index], _find_high(entry, index)
    if middle is None:
        return "\N{EN DASH}"
    if not isfinite(middle):
        return "failed"
    if high is None:
        return f"{middle:.4g}"
    return f"{middle:.3g} ({high:.3g})" if isfinite(high) else f"{middle:.3g} (90th failed)"


def _find_high(entry: MethodScore, index: int) -> float | None:
    return entry.highs[index] if entry.highs else None


def _draw_measure(index: int, label: str, scores: Sequence[MethodScore]) -> str:
    """Return the figure of one measure, empty where fewer than two methods have a value."""
    intervals = []
    for entry in scores:
        middle, high = entry.middles[index], _find_high(entry, index)
        if middle is not None and isfinite(middle):
            intervals.append(
                Interval(
                    label=f"{entry.method} (chosen)" if entry.chosen else entry.method,
                    middle=middle,
                    high=high if high is not None and isfinite(high) else None,
                    text=_write_score(entry, index),
                    chosen=entry.chosen,
                )
            )
    if len(intervals) < 2:
        return ""
    kind = "median and 90th percentile" if any(entry.highs for entry in scores) else "value"
    return build_interval_figure(
        f"{label} by method", f"{label}, {kind} of every method; less is better.", label, intervals
    )
