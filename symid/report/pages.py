"""What the pages of results share: templates, rows of tables, and sections on methods, iterations, tracking.

Parameters, residuals, settings -> rows of strings; scores, histories, tracking runs -> sections, ready to
print; a frozen dataclass whose fields equal the template's variables -> HTML, with every text escaped but
those that a template marks as safe.

Supported: loops, joins and plain conditions in templates; methods that failed, medians with their 90th
percentiles; histories without norms. The same input gives the same texts.
Not supported: an undefined name in a template, which is an error; measures of which less is not better; one
entry of a history only, which is no course to show.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from symid.codegen import Library
from symid.environment import locate_resource_folder
from symid.errors import GenerationError, Notice
from symid.identification.elastic import HistoryEntry
from symid.identification.estimators import ParameterEstimate, Residual
from symid.logs import Recording
from symid.report.figures import STYLES, Interval, Line, build_interval_figure, build_line_figure
from symid.robot import Robot

if TYPE_CHECKING:
    from _typeshed import DataclassInstance
    from jinja2 import Environment

    from symid.identification.elastic import TrackingRun


@cache
def _build_environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(locate_resource_folder("templates") / "report"),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


@cache
def list_template_variables(name: str) -> frozenset[str]:
    """Return the names that the template `name` and those it builds on want from its context."""
    from jinja2 import meta

    source = (locate_resource_folder("templates") / "report" / name).read_text(encoding="utf-8")
    tree = _build_environment().parse(source)
    others = (list_template_variables(other) for other in meta.find_referenced_templates(tree) if other)
    return frozenset(meta.find_undeclared_variables(tree)).union(*others)


def render_page(name: str, context: "DataclassInstance") -> str:
    """Return the template `name`, for example "identification.html.jinja", filled with `context`.

    Raises:
        GenerationError: the context's fields and the template's variables are not the same.
    """
    values: dict[str, Any] = {field.name: getattr(context, field.name) for field in fields(context)}
    wanted = list_template_variables(name)
    if wanted != values.keys():
        missing, unused = sorted(wanted - values.keys()), sorted(values.keys() - wanted)
        text = f"template {name}: its context lacks {missing} and has {unused} that it does not use"
        raise GenerationError(Notice(code="report.template-context", text=text))
    return _build_environment().get_template(name).render(values)


_UNKNOWN = "\N{EN DASH}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterLine:
    """A row of the parameter table; `truth`, `error` and `inside` may be empty."""

    name: str
    value: str
    std: str
    relative: str
    unit: str
    truth: str
    error: str
    inside: str
    expression: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualLine:
    """A row of a residual table."""

    joint: str
    norm: str
    relative: str
    std: str
    samples: str
    unit: str


def build_parameter_line(entry: ParameterEstimate) -> ParameterLine:
    """Return the row of one parameter; its error is relative to the true value, where that is not zero."""
    truth, error, inside = "", "", ""
    relative = entry.relative_std_percent
    if entry.truth is not None:
        truth = f"{entry.truth:.5g}"
        if math.isfinite(entry.std):
            inside = "yes" if abs(entry.value - entry.truth) <= 3.0 * entry.std else "no"
        if entry.truth:
            error = format_error(entry.value, entry.truth)
    return ParameterLine(
        name=entry.name,
        value=f"{entry.value:.5g}",
        std=format_digits(entry.std) if math.isfinite(entry.std) else _UNKNOWN,
        relative=f"{format_digits(relative)} %" if math.isfinite(relative) else _UNKNOWN,
        unit=entry.unit,
        truth=truth,
        error=error,
        inside=inside,
        expression="" if entry.expression == entry.name else entry.expression,
        reason=entry.reason,
    )


def format_error(value: float, truth: float) -> str:
    """Return the error relative to a true value that is not zero, with its sign."""
    percent = 100.0 * (value - truth) / abs(truth)
    sign = "\N{MINUS SIGN}" if percent < 0.0 else "+"
    return f"{sign}{format_digits(abs(percent))} %"


def format_digits(value: float) -> str:
    """Return two digits, more from 100 on, where two would need a power of ten."""
    return f"{value:.0f}" if 99.5 <= value < 1e6 else f"{value:.2g}"


def build_residual_line(entry: Residual) -> ResidualLine:
    """Return the row of one joint's residual."""
    return ResidualLine(
        joint=entry.joint,
        norm=f"{entry.norm:.5g}",
        relative=f"{entry.relative_percent:.4f} %",
        std=f"{entry.std:.4g}",
        samples=str(entry.samples),
        unit=entry.unit,
    )


def list_settings(value: object, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield every setting of nested tables with its dotted name."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from list_settings(entry, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(value, list | tuple):
        yield prefix, ", ".join(map(str, value))
    else:
        yield prefix, "none" if value is None else str(value)


def describe_origin(robot: Robot, library: Library, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return in short texts what a report was made from; the same input gives the same texts."""
    texts = [f"robot {robot.name} of {robot.path}"]
    if robot.source:
        texts.append(f"its source: {robot.source}")
    texts.append(f"functions run as {library.backend}")
    texts += [
        f"{entry.source}: {entry.time[-1] - entry.time[0]:.6g} s at {1.0 / entry.period:.6g} Hz"
        for entry in recordings
    ]
    return tuple(texts)


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedMethod:
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
class MethodComparison:
    """Scores of methods on the same logs.

    Args:
        measures: name and unit of each; less is better.
        scores: one a method, in the order of the table.
        words: sentences on the choice, and on what was compared.
    """

    measures: tuple[tuple[str, str], ...]
    scores: tuple[ComparedMethod, ...]
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodLine:
    """A row of the table of methods, ready to print."""

    method: str
    chosen: bool
    values: tuple[str, ...]
    outcome: str


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodSection:
    """The table of methods, words on the choice, and a caption and a figure (SVG) a measure."""

    words: tuple[str, ...]
    caption: str
    names: tuple[str, ...]
    lines: tuple[MethodLine, ...]
    has_outcomes: bool
    figures: tuple[tuple[str, str], ...]


def build_method_section(comparison: MethodComparison) -> MethodSection | None:
    """Return the section, None where there is nothing to compare."""
    measures, scores = comparison.measures, comparison.scores
    if len(scores) < 2:
        return None
    many = any(entry.highs for entry in scores)
    what = ": median, and 90th percentile in brackets" if many else ""
    return MethodSection(
        words=comparison.words,
        caption=f"Methods on the same logs{what}. Less is better.",
        names=tuple(f"{name} ({unit})" for name, unit in measures),
        lines=tuple(
            MethodLine(
                method=entry.method,
                chosen=entry.chosen,
                values=tuple(_format_score(entry, index) for index in range(len(measures))),
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


def _format_score(entry: ComparedMethod, index: int) -> str:
    middle, high = entry.middles[index], _get_high(entry, index)
    if middle is None:
        return "\N{EN DASH}"
    if not isfinite(middle):
        return "failed"
    if high is None:
        return f"{middle:.4g}"
    return f"{middle:.3g} ({high:.3g})" if isfinite(high) else f"{middle:.3g} (90th failed)"


def _get_high(entry: ComparedMethod, index: int) -> float | None:
    return entry.highs[index] if entry.highs else None


def _draw_measure(index: int, label: str, scores: Sequence[ComparedMethod]) -> str:
    """Return the figure of one measure, empty where fewer than two methods have a value."""
    intervals = []
    for entry in scores:
        middle, high = entry.middles[index], _get_high(entry, index)
        if middle is not None and isfinite(middle):
            intervals.append(
                Interval(
                    label=f"{entry.method} (chosen)" if entry.chosen else entry.method,
                    middle=middle,
                    high=high if high is not None and isfinite(high) else None,
                    text=_format_score(entry, index),
                    chosen=entry.chosen,
                )
            )
    if len(intervals) < 2:
        return ""
    kind = "median and 90th percentile" if any(entry.highs for entry in scores) else "value"
    return build_interval_figure(
        f"{label} by method", f"{label}, {kind} of every method; less is better.", label, intervals
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ConvergenceSection:
    """Figures as SVG, perhaps empty; `names` of the table's columns, one row an iteration."""

    words: str
    course: str
    norms: str
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def build_convergence_section(
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


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingRuns:
    """Runs of one motion, and sentences on how they differ, for example with intervals of many runs."""

    runs: tuple["TrackingRun", ...]
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingLine:
    """A row of the table: a feed-forward and the RMS error of every joint."""

    name: str
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingSection:
    """The table of RMS errors, one figure a joint as SVG, and what else is said of them."""

    names: tuple[str, ...]
    lines: tuple[TrackingLine, ...]
    figures: tuple[tuple[str, str], ...]
    words: tuple[str, ...]


def build_tracking_section(
    tracking: TrackingRuns | None, joints: Sequence[tuple[str, str]]
) -> TrackingSection | None:
    """Return the section, None where nothing was run; `joints` are names and units of position."""
    if tracking is None or not tracking.runs:
        return None
    runs = tracking.runs
    return TrackingSection(
        names=tuple(f"{name} (m{unit})" for name, unit in joints),
        lines=tuple(
            TrackingLine(
                name=run.name,
                values=tuple(f"{1e3 * value:.4g}" for value in run.rms.tolist()),
            )
            for run in runs
        ),
        figures=tuple(
            (name, _draw_tracking_error(index, name, unit, runs)) for index, (name, unit) in enumerate(joints)
        ),
        words=tracking.words,
    )


def _draw_tracking_error(index: int, name: str, unit: str, runs: Sequence["TrackingRun"]) -> str:
    return build_line_figure(
        f"{name}: tracking error",
        f"Reached less desired position of {name} in m{unit} against time in s, for every feed-forward.",
        ("time (s)", f"tracking error (m{unit})"),
        [
            Line(
                label=run.name,
                style=STYLES[number % len(STYLES)],
                x=run.time,
                y=1e3 * run.error[:, index],
            )
            for number, run in enumerate(runs)
        ],
    )
