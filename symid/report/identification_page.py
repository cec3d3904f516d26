"""The report of a rigid identification: one HTML file that needs nothing else.

`Estimate`, `Validation` of held-out logs, perhaps a `Diagnosis` -> a page with verdict, parameters, measured
and predicted torques, residuals, identifiability, drift, structure of the residual, settings.

Supported: printing, light and dark screens, screen readers; no scripts, no network; any number of joints and
parameters.
Not supported: more than one robot on a page; interaction: figures are drawn once.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from symid import __version__
from symid.errors import Notice
from symid.identification.diagnostics import JointProfiles, Profile
from symid.identification.estimators import Estimate, Series, Validation
from symid.identification.rigid import Diagnosis, write_file
from symid.report.figures import Line, build_curve_figure, build_histogram, build_line_figure
from symid.report.pages import (
    ParameterLine,
    ResidualLine,
    build_parameter_line,
    build_residual_line,
    format_digits,
    list_settings,
    render_page,
)
from symid.report.verdict import FitVerdict, judge_identification

Cells = tuple[tuple[str, ...], ...]
_SHOWN = 20
"""Rows of a table of pairs, at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileFigures:
    """The residual of a joint against position, velocity and load, as SVG."""

    joint: str
    position: str
    velocity: str
    load: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisSection:
    """The diagnosis as the template shows it: sentences, figures, rows of tables."""

    identifiability: str
    spectrum: str
    correlated: Cells
    ellipse: str
    essential: str
    dropped: Cells
    bootstrap: str
    scatter: Cells
    drift: str
    changed: Cells
    changed_names: tuple[str, ...]
    structure: Cells
    profiles: tuple[ProfileFigures, ...]
    prices: Cells


def build_diagnosis_section(estimate: Estimate, diagnosis: Diagnosis) -> DiagnosisSection:
    """Return all that the page shows of a diagnosis."""
    essential, bootstrap = diagnosis.essential, diagnosis.bootstrap
    return DiagnosisSection(
        identifiability=_describe_rank(diagnosis),
        spectrum=_draw_spectrum(diagnosis),
        correlated=tuple((a, b, f"{value:.3f}") for a, b, value in diagnosis.correlated[:_SHOWN]),
        ellipse=_draw_ellipse(diagnosis),
        essential=(
            f"{len(essential.kept)} of {len(essential.kept) + len(essential.dropped)} parameters stand out "
            "of the noise. Without the others the residual of the fit grows by "
            f"{essential.price_percent:.2g} %."
        ),
        dropped=tuple(
            (entry.name, f"{entry.ratio:.2g}", f"{entry.price_percent:.2g} %") for entry in essential.dropped
        ),
        bootstrap=(
            f"{bootstrap.blocks} blocks of the logs, drawn {bootstrap.replicates} times: deviations that "
            "hold whatever pattern the residual keeps within a block."
        ),
        scatter=_list_scatter(estimate, diagnosis),
        drift=_describe_drift(diagnosis),
        changed=tuple(
            (
                entry.name,
                *(
                    f"{v:.4g} ± {format_digits(d)}"
                    for v, d in zip(entry.values, entry.deviations, strict=True)
                ),
            )
            for entry in diagnosis.drift.changed
            if len(entry.values) == len(diagnosis.drift.runs)
        ),
        changed_names=("name", *(Path(estimate.sources[run]).name for run in diagnosis.drift.runs)),
        structure=tuple(
            (
                entry.joint,
                entry.family,
                f"{entry.share_percent:.3g} %",
                f"{entry.rms:.3g} {entry.unit}",
                entry.advice,
            )
            for entry in diagnosis.structure
        ),
        profiles=tuple(map(_draw_profiles, diagnosis.profiles)),
        prices=tuple((entry.what, entry.of, f"{entry.percent:+.3g} %") for entry in diagnosis.prices),
    )


def _describe_rank(diagnosis: Diagnosis) -> str:
    seen = diagnosis.singular[: diagnosis.rank]
    ratio = seen[0] / seen[-1]
    hidden = len(diagnosis.singular) - diagnosis.rank
    lost = f" {hidden} more directions are not seen." if hidden else ""
    return (
        f"The logs see {diagnosis.rank} directions of the parameters, the last {ratio:.3g} times less.{lost}"
    )


def _draw_spectrum(diagnosis: Diagnosis) -> str:
    values = np.array(diagnosis.singular)
    number = np.arange(1.0, len(values) + 1.0)
    rank = diagnosis.rank
    lines = [Line(label="seen", style="first", x=number[:rank], y=values[:rank], markers=True)]
    if np.any(values[rank:] > 0.0):
        lines.append(Line(label="not seen", style="second", x=number[rank:], y=values[rank:], markers=True))
    return build_line_figure(
        "Singular values",
        "Singular values of the scaled matrix of the fit in falling order.",
        ("number", "singular value"),
        lines,
        logarithmic=True,
        whole=True,
    )


def _draw_ellipse(diagnosis: Diagnosis) -> str:
    if diagnosis.ellipse is None:
        return ""
    first, second, _ = diagnosis.correlated[0]
    outline = diagnosis.ellipse.trace()
    return build_curve_figure(
        f"{first} and {second}",
        f"Where {first} and {second} lie together with a probability of {diagnosis.ellipse.level:.0%}.",
        (first, second),
        (Line(label="ellipse", style="first", x=outline[:, 0], y=outline[:, 1]),),
    )


def _list_scatter(estimate: Estimate, diagnosis: Diagnosis) -> Cells:
    stated = {entry.name: entry for entry in estimate.parameters}
    found = diagnosis.bootstrap
    dropped = {entry.name for entry in diagnosis.essential.dropped}
    return tuple(
        (
            name,
            f"{stated[name].value:.5g}",
            format_digits(stated[name].std),
            format_digits(deviation),
            f"{low:.4g}",
            f"{high:.4g}",
            "no" if name in dropped else "yes",
        )
        for name, deviation, low, high in zip(
            found.names, found.deviations, found.low, found.high, strict=True
        )
        if name in stated
    )


def _describe_drift(diagnosis: Diagnosis) -> str:
    drift = diagnosis.drift
    if len(drift.runs) < 2:
        return "One log alone tells nothing of drift."
    if not drift.changed:
        return f"{len(drift.runs)} logs tell {drift.compared} parameters alike, within their noise."
    return (
        f"{len(drift.changed)} of {drift.compared} parameters differ between the logs beyond what their "
        "noise allows: the robot changed, or the model misses a term."
    )


def _draw_profiles(entry: JointProfiles) -> ProfileFigures:
    unit, speed = entry.position_unit, f"{entry.position_unit}/s"
    return ProfileFigures(
        joint=entry.joint,
        position=_draw_profile(entry, "position", f"position ({unit})", entry.position),
        velocity=_draw_profile(entry, "velocity", f"velocity ({speed})", entry.velocity),
        load=_draw_profile(entry, "load", f"predicted torque ({entry.unit})", entry.load),
    )


def _draw_profile(entry: JointProfiles, against: str, label: str, profile: Profile) -> str:
    return build_line_figure(
        f"{entry.joint}: residual against {against}",
        f"Mean residual of {entry.joint} in {entry.unit} against {against}, with one deviation either side.",
        (label, f"residual ({entry.unit})"),
        (
            Line(label="mean", style="first", x=profile.centre, y=profile.mean, markers=True),
            Line(
                label="plus deviation", style="second", x=profile.centre, y=profile.mean + profile.deviation
            ),
            Line(
                label="minus deviation", style="third", x=profile.centre, y=profile.mean - profile.deviation
            ),
        ),
    )


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
class IdentificationPage:
    """The context of the page: its fields are the template's variables."""

    robot: str
    verdict: FitVerdict
    has_truth: bool
    parameters: tuple[ParameterLine, ...]
    refused: tuple[tuple[str, str], ...]
    fit_residual: tuple[ResidualLine, ...]
    logs: tuple[LogSection, ...]
    diagnosis: DiagnosisSection | None
    settings: tuple[tuple[str, str], ...]
    notices: tuple[str, ...]
    origin: tuple[str, ...]


def write_identification_report(
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
    page = build_identification_report(estimate, validations, notices, origin, diagnosis=diagnosis)
    return write_file(path, render_page(_TEMPLATE, page))


def build_identification_report(
    estimate: Estimate,
    validations: tuple[Validation, ...] = (),
    notices: tuple[Notice, ...] = (),
    origin: tuple[str, ...] = (),
    *,
    diagnosis: Diagnosis | None = None,
) -> IdentificationPage:
    """Return all that the page shows."""
    told = (
        *estimate.notices,
        *notices,
        *(notice for validation in validations for notice in validation.notices),
    )
    return IdentificationPage(
        robot=estimate.robot,
        verdict=judge_identification(estimate, validations),
        has_truth=any(entry.truth is not None for entry in estimate.parameters),
        parameters=tuple(map(build_parameter_line, estimate.parameters)),
        refused=estimate.refused,
        fit_residual=tuple(map(build_residual_line, estimate.residual)),
        logs=tuple(map(_build_log_section, validations)),
        diagnosis=None if diagnosis is None else build_diagnosis_section(estimate, diagnosis),
        settings=_list_page_settings(estimate),
        notices=tuple(dict.fromkeys(map(str, told))),
        origin=(f"Written by symid {__version__}", *origin),
    )


def _build_log_section(validation: Validation) -> LogSection:
    caption = "Held out: nothing was fitted here."
    if validation.fitted:
        caption = "The log it was fitted to: this is no test."
    return LogSection(
        source=validation.source,
        caption=caption,
        mean_relative=f"{validation.mean_relative_percent:.4f} %",
        residual=tuple(map(build_residual_line, validation.residual)),
        joints=tuple(draw_joint_prediction(series, validation.rows) for series in validation.series),
    )


def draw_joint_prediction(series: Series, rows: str) -> JointSection:
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


def _list_page_settings(estimate: Estimate) -> tuple[tuple[str, str], ...]:
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
