"""The report of an identification: one HTML file that needs nothing else.

Input: `Estimate`, and `Validation` of held-out logs. Output: a page with verdict, parameters,
measured and predicted torques, residuals, settings.

Supported: printing, light and dark screens, readers that speak; no scripts, no network.
Not supported: more than one robot on a page.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from symid import __version__
from symid.errors import Notice
from symid.identification.estimate import Estimate, ParameterEstimate, Residual, Series, Validation
from symid.identification.storage import write_file
from symid.report.figures import Line, build_histogram, build_line_figure
from symid.report.templates import write_page
from symid.report.verdict import Verdict, find_verdict

__all__ = [
    "JointSection",
    "LogSection",
    "ParameterLine",
    "ReportPage",
    "ResidualLine",
    "build_report",
    "write_report",
]

_TEMPLATE = "identification.html.jinja"
_QUANTITIES = {"torque": "torque", "momentum": "impulse", "energy": "work"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterLine:
    """A row of the parameter table, ready to print; `truth` and `inside` may be empty."""

    name: str
    value: str
    std: str
    relative: str
    unit: str
    truth: str
    inside: str
    expression: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualLine:
    """A row of a residual table, ready to print."""

    joint: str
    norm: str
    relative: str
    std: str
    samples: str
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSection:
    """The figures of one joint on a held-out log, as SVG."""

    joint: str
    prediction: str
    residual: str
    histogram: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSection:
    """A log that was predicted; `caption` says whether it was held out."""

    source: str
    caption: str
    mean_relative: str
    residual: tuple[ResidualLine, ...]
    joints: tuple[JointSection, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportPage:
    """The context of the page: its fields are the template's variables."""

    robot: str
    verdict: Verdict
    has_truth: bool
    parameters: tuple[ParameterLine, ...]
    refused: tuple[tuple[str, str], ...]
    fit_residual: tuple[ResidualLine, ...]
    logs: tuple[LogSection, ...]
    settings: tuple[tuple[str, str], ...]
    notices: tuple[str, ...]
    origin: tuple[str, ...]


def write_report(
    path: Path,
    estimate: Estimate,
    validations: tuple[Validation, ...] = (),
    notices: tuple[Notice, ...] = (),
    origin: tuple[str, ...] = (),
) -> Path:
    """Write the page to `path`, at once or not at all, and return the path.

    `notices` are what else a reader should know: of the robot, its library, and the recordings;
    `origin` says in short texts what the page was made from.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_file(path, write_page(_TEMPLATE, build_report(estimate, validations, notices, origin)))


def build_report(
    estimate: Estimate,
    validations: tuple[Validation, ...] = (),
    notices: tuple[Notice, ...] = (),
    origin: tuple[str, ...] = (),
) -> ReportPage:
    """Return all that the page shows."""
    told = (
        *estimate.notices,
        *notices,
        *(notice for validation in validations for notice in validation.notices),
    )
    return ReportPage(
        robot=estimate.robot,
        verdict=find_verdict(estimate, validations),
        has_truth=any(entry.truth is not None for entry in estimate.parameters),
        parameters=tuple(map(_write_parameter, estimate.parameters)),
        refused=estimate.refused,
        fit_residual=tuple(map(_write_residual, estimate.residual)),
        logs=tuple(map(_write_log, validations)),
        settings=_write_settings(estimate),
        notices=tuple(dict.fromkeys(map(str, told))),
        origin=(f"Written by symid {__version__}", *origin),
    )


def _write_parameter(entry: ParameterEstimate) -> ParameterLine:
    inside = ""
    if entry.truth is not None:
        inside = "yes" if abs(entry.value - entry.truth) <= 3.0 * entry.std else "no"
    return ParameterLine(
        name=entry.name,
        value=f"{entry.value:.5g}",
        std=f"{entry.std:.2g}",
        relative=f"{entry.relative_std_percent:.2g} %",
        unit=entry.unit,
        truth="" if entry.truth is None else f"{entry.truth:.5g}",
        inside=inside,
        expression="" if entry.expression == entry.name else entry.expression,
        reason=entry.reason,
    )


def _write_residual(entry: Residual) -> ResidualLine:
    return ResidualLine(
        joint=entry.joint,
        norm=f"{entry.norm:.5g}",
        relative=f"{entry.relative_percent:.4f} %",
        std=f"{entry.std:.4g}",
        samples=str(entry.samples),
        unit=entry.unit,
    )


def _write_log(validation: Validation) -> LogSection:
    caption = "Held out: nothing was fitted here."
    if validation.fitted:
        caption = "The log it was fitted to: this is no test."
    return LogSection(
        source=validation.source,
        caption=caption,
        mean_relative=f"{validation.mean_relative_percent:.4f} %",
        residual=tuple(map(_write_residual, validation.residual)),
        joints=tuple(_draw_joint(series, validation.rows) for series in validation.series),
    )


def _draw_joint(series: Series, rows: str) -> JointSection:
    quantity = "force" if rows == "torque" and series.unit == "N" else _QUANTITIES[rows]
    error = series.measured - series.predicted
    joint, unit = series.joint, series.unit
    return JointSection(
        joint=joint,
        prediction=build_line_figure(
            f"{joint}: measured and predicted {quantity}",
            f"Measured and predicted {quantity} of {joint} in {unit} against time in s.",
            ("time (s)", f"{quantity} ({unit})"),
            (
                Line(label="measured", style="measured", x=series.time, y=series.measured),
                Line(label="predicted", style="predicted", x=series.time, y=series.predicted),
            ),
        ),
        residual=build_line_figure(
            f"{joint}: residual",
            f"Measured minus predicted {quantity} of {joint} in {unit} against time in s.",
            ("time (s)", f"residual ({unit})"),
            (Line(label="residual", style="residual", x=series.time, y=error),),
        ),
        histogram=build_histogram(
            f"{joint}: distribution of the residual",
            f"How often which residual of {joint} occurs, and the normal distribution of its deviation.",
            (f"residual ({unit})", "rows"),
            error,
        ),
    )


def _write_settings(estimate: Estimate) -> tuple[tuple[str, str], ...]:
    head = (
        ("rows", estimate.rows),
        ("estimator", estimate.estimator),
        ("friction", ", ".join(estimate.friction)),
        ("logs", ", ".join(estimate.sources)),
        ("rows fitted", str(estimate.samples)),
        ("condition of the scaled matrix", f"{estimate.condition:.4g}"),
        ("outcome", estimate.outcome.value),
        ("signature of the model", estimate.signature),
    )
    return head + tuple(_flatten("", estimate.settings))


def _flatten(prefix: str, value: object) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _flatten(f"{prefix}.{key}" if prefix else str(key), entry)
    elif isinstance(value, list | tuple):
        yield prefix, ", ".join(map(str, value))
    else:
        yield prefix, "none" if value is None else str(value)
