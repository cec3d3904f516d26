"""The report of an identification: one HTML file that needs nothing else.

Input: `Estimate`, and `Validation` of held-out logs. Output: a page with verdict, parameters,
measured and predicted torques, residuals, settings.

Supported: printing, light and dark screens, readers that speak; no scripts, no network.
Not supported: more than one robot on a page.
"""

from dataclasses import dataclass
from pathlib import Path

from symid import __version__
from symid.errors import Notice
from symid.estimators.estimate import Estimate, Series, Validation
from symid.identification.diagnosis import Diagnosis
from symid.identification.storage import write_file
from symid.report.bars import build_histogram
from symid.report.figures import build_line_figure
from symid.report.identification_diagnosis import DiagnosisSection, build_diagnosis
from symid.report.lines import Line
from symid.report.tables import ParameterLine, ResidualLine, list_settings, write_parameter, write_residual
from symid.report.templates import write_page
from symid.report.verdict import Verdict, find_verdict

__all__ = [
    "JointSection",
    "LogSection",
    "ReportPage",
    "build_report",
    "draw_joint",
    "write_report",
]

_TEMPLATE = "identification.html.jinja"
_QUANTITIES = {"torque": "torque", "momentum": "impulse", "energy": "work"}


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
    diagnosis: DiagnosisSection | None
    settings: tuple[tuple[str, str], ...]
    notices: tuple[str, ...]
    origin: tuple[str, ...]


def write_report(
    path: Path,
    estimate: Estimate,
    validations: tuple[Validation, ...] = (),
    notices: tuple[Notice, ...] = (),
    origin: tuple[str, ...] = (),
    *,
    diagnosis: Diagnosis | None = None,
) -> Path:
    """Write the page to `path`, at once or not at all, and return the path.

    `notices` are what else a reader should know: of the robot, its library, and the recordings;
    `origin` says in short texts what the page was made from; `diagnosis` is of the fit and its own logs.

    Raises:
        OutputError: the file cannot be written.
    """
    page = build_report(estimate, validations, notices, origin, diagnosis=diagnosis)
    return write_file(path, write_page(_TEMPLATE, page))


def build_report(
    estimate: Estimate,
    validations: tuple[Validation, ...] = (),
    notices: tuple[Notice, ...] = (),
    origin: tuple[str, ...] = (),
    *,
    diagnosis: Diagnosis | None = None,
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
        parameters=tuple(map(write_parameter, estimate.parameters)),
        refused=estimate.refused,
        fit_residual=tuple(map(write_residual, estimate.residual)),
        logs=tuple(map(_write_log, validations)),
        diagnosis=None if diagnosis is None else build_diagnosis(estimate, diagnosis),
        settings=_write_settings(estimate),
        notices=tuple(dict.fromkeys(map(str, told))),
        origin=(f"Written by symid {__version__}", *origin),
    )


def _write_log(validation: Validation) -> LogSection:
    caption = "Held out: nothing was fitted here."
    if validation.fitted:
        caption = "The log it was fitted to: this is no test."
    return LogSection(
        source=validation.source,
        caption=caption,
        mean_relative=f"{validation.mean_relative_percent:.4f} %",
        residual=tuple(map(write_residual, validation.residual)),
        joints=tuple(draw_joint(series, validation.rows) for series in validation.series),
    )


def draw_joint(series: Series, rows: str) -> JointSection:
    """Return the figures of one joint: measured and predicted, residual, its distribution."""
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
    return head + tuple(list_settings(estimate.settings))
