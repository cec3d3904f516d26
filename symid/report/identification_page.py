"""The page of a rigid identification.

`Estimate`, `Validation` of held-out logs, perhaps a `Diagnosis` -> `Page`: verdict, parameters, residuals,
identifiability, drift, structure of the residual, measured and predicted torques, settings.
"""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from symid.errors import Notice
from symid.identification.diagnostics import JointProfiles
from symid.identification.estimators import Estimate, Series, Validation
from symid.identification.rigid import Diagnosis
from symid.report.blocks import Block, Drawing, Table
from symid.report.figures import Line, build_curve_figure, build_histogram, build_line_figure
from symid.report.fit_text import show_residual
from symid.report.pages import (
    Page,
    format_digits,
    list_notices,
    list_origin,
    list_settings,
    show_refused,
    tabulate_parameters,
)
from symid.report.verdict import QUANTITIES, judge_identification

_SHOWN = 20
"""Rows of a table of pairs, at most."""


def build_identification_page(
    estimate: Estimate,
    validations: tuple[Validation, ...] = (),
    notices: tuple[Notice, ...] = (),
    origin: tuple[str, ...] = (),
    *,
    diagnosis: Diagnosis | None = None,
) -> Page:
    """Return all that the page shows.

    Args:
        estimate: of base parameters.
        validations: what it explains of logs.
        notices: what else a reader should know: of the robot, its library, and the recordings.
        origin: what the page was made from, in short texts.
        diagnosis: of the fit and its own logs.
    """
    told = (*estimate.notices, *notices, *(entry for tried in validations for entry in tried.notices))
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
    untested = (
        "No held-out log was given. A model that has only met the log it was fitted to is not tested: "
        "validate it on another motion."
    )
    return Page(
        robot=estimate.robot,
        subject="identified parameters",
        verdict=judge_identification(estimate, validations),
        blocks=(
            "== Parameters ==",
            tabulate_parameters(estimate.parameters),
            *show_refused(estimate.refused),
            "== Residual of the fit ==",
            show_residual(
                estimate.residual, "What the model leaves unexplained of the logs it was fitted to."
            ),
            *(() if diagnosis is None else _show_diagnosis(estimate, diagnosis)),
            "== Predicted logs ==",
            *(chain.from_iterable(map(_show_log, validations)) if validations else (untested,)),
        ),
        settings=head + tuple(list_settings(estimate.settings)),
        notices=list_notices(told),
        origin=list_origin(origin),
    )


def _show_diagnosis(estimate: Estimate, diagnosis: Diagnosis) -> Iterator[Block]:
    """Yield all that the page shows of a diagnosis."""
    essential, bootstrap = diagnosis.essential, diagnosis.bootstrap
    yield from ("== What the logs can tell ==", _describe_rank(diagnosis), _draw_spectrum(diagnosis))
    if diagnosis.correlated:
        pairs = [(a, b, f"{value:.3f}") for a, b, value in diagnosis.correlated[:_SHOWN]]
        title = "Parameters that trade against each other."
        yield Table(("one", "other", "correlation"), pairs, (0, 1), title)
        yield from _draw_ellipse(diagnosis)
    yield "== Essential parameters =="
    yield (
        f"{len(essential.kept)} of {len(essential.kept) + len(essential.dropped)} parameters stand out of "
        f"the noise. Without the others the residual of the fit grows by {essential.price_percent:.2g} %."
    )
    if essential.dropped:
        dropped = [
            (entry.name, f"{entry.ratio:.2g}", f"{entry.price_percent:.2g} %") for entry in essential.dropped
        ]
        header = ("name", "deviations from zero", "residual grows by")
        yield Table(header, dropped, title="In the order they can go.")
    yield "== Deviations by block bootstrap =="
    yield (
        f"{bootstrap.blocks} blocks of the logs, drawn {bootstrap.replicates} times: deviations that hold "
        "whatever pattern the residual keeps within a block."
    )
    yield _tabulate_scatter(estimate, diagnosis)
    yield from _show_drift(estimate, diagnosis)
    yield "== Structure of the residual =="
    yield _show_structure(diagnosis)
    for entry in diagnosis.profiles:
        yield f"=== {entry.joint} ==="
        yield from _draw_profiles(entry)
    if diagnosis.prices:
        prices = [(entry.what, entry.of, f"{entry.percent:+.3g} %") for entry in diagnosis.prices]
        yield "== Prices =="
        yield Table(("what", "of", "price"), prices, (0, 1), "What was asked of the fit, and what it costs.")


def _describe_rank(diagnosis: Diagnosis) -> str:
    seen = diagnosis.singular[: diagnosis.rank]
    ratio = seen[0] / seen[-1]
    hidden = len(diagnosis.singular) - diagnosis.rank
    lost = f" {hidden} more directions are not seen." if hidden else ""
    return (
        f"The logs see {diagnosis.rank} directions of the parameters, the last {ratio:.3g} times less.{lost}"
    )


def _draw_spectrum(diagnosis: Diagnosis) -> Drawing:
    values = np.array(diagnosis.singular)
    number = np.arange(1.0, len(values) + 1.0)
    rank = diagnosis.rank
    lines = [Line(label="seen", style="first", x=number[:rank], y=values[:rank], markers=True)]
    if np.any(values[rank:] > 0.0):
        lines.append(Line(label="not seen", style="second", x=number[rank:], y=values[rank:], markers=True))
    figure = build_line_figure(
        "Singular values",
        "Singular values of the scaled matrix of the fit in falling order.",
        ("number", "singular value"),
        lines,
        logarithmic=True,
        whole=True,
    )
    return Drawing(figure, "Singular values of the matrix with columns of length one.")


def _draw_ellipse(diagnosis: Diagnosis) -> Iterator[Drawing]:
    if diagnosis.ellipse is not None:
        first, second, _ = diagnosis.correlated[0]
        outline = diagnosis.ellipse.trace()
        figure = build_curve_figure(
            f"{first} and {second}",
            f"Where {first} and {second} lie together with a probability of {diagnosis.ellipse.level:.0%}.",
            (first, second),
            (Line(label="ellipse", style="first", x=outline[:, 0], y=outline[:, 1]),),
        )
        yield Drawing(figure, "The closest pair: they lie within the ellipse with a probability of 95 %.")


def _tabulate_scatter(estimate: Estimate, diagnosis: Diagnosis) -> Table:
    stated = {entry.name: entry for entry in estimate.parameters}
    found = diagnosis.bootstrap
    dropped = {entry.name for entry in diagnosis.essential.dropped}
    rows = [
        (
            name,
            stated[name].value,
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
    ]
    header = ("name", "value", "stated std", "bootstrap std", "from", "to (95 %)", "essential")
    return Table(header, rows, title="Values in SI units.")


def _show_drift(estimate: Estimate, diagnosis: Diagnosis) -> Iterator[Block]:
    drift = diagnosis.drift
    yield "== Drift between logs =="
    if len(drift.runs) < 2:
        yield "One log alone tells nothing of drift."
    elif not drift.changed:
        yield f"{len(drift.runs)} logs tell {drift.compared} parameters alike, within their noise."
    else:
        yield (
            f"{len(drift.changed)} of {drift.compared} parameters differ between the logs beyond what their "
            "noise allows: the robot changed, or the model misses a term."
        )
    rows = []
    for entry in drift.changed:
        if len(entry.values) == len(drift.runs):
            pairs = zip(entry.values, entry.deviations, strict=True)
            rows.append((entry.name, *(f"{value:.4g} ± {format_digits(std)}" for value, std in pairs)))
    if rows:
        header = ("name", *(Path(estimate.sources[run]).name for run in drift.runs))
        yield Table(header, rows, title="What each log tells alone, value ± std.")


def _show_structure(diagnosis: Diagnosis) -> Block:
    if not diagnosis.structure:
        return (
            "No function of position, velocity, load, acceleration, time or of other joints explains 5 % of "
            "a joint's residual."
        )
    rows = [
        (
            entry.joint,
            entry.family,
            f"{entry.share_percent:.3g} %",
            f"{entry.rms:.3g} {entry.unit}",
            entry.advice,
        )
        for entry in diagnosis.structure
    ]
    header = ("joint", "follows", "share of the square", "size", "what it means")
    return Table(header, rows, (0, 1, 4), "What explains the residual of stretches it was not fitted to.")


def _draw_profiles(entry: JointProfiles) -> Iterator[Drawing]:
    """Yield the mean residual of a joint against position, velocity and load."""
    unit = entry.position_unit
    for against, label, profile in (
        ("position", f"position ({unit})", entry.position),
        ("velocity", f"velocity ({unit}/s)", entry.velocity),
        ("load", f"predicted torque ({entry.unit})", entry.load),
    ):
        edges = (
            ("plus deviation", "second", profile.mean + profile.deviation),
            ("minus deviation", "third", profile.mean - profile.deviation),
        )
        figure = build_line_figure(
            f"{entry.joint}: residual against {against}",
            f"Mean residual of {entry.joint} in {entry.unit} against {against}, with one deviation either "
            "side.",
            (label, f"residual ({entry.unit})"),
            (
                Line(label="mean", style="first", x=profile.centre, y=profile.mean, markers=True),
                *(Line(label=name, style=style, x=profile.centre, y=y) for name, style, y in edges),
            ),
        )
        yield Drawing(figure, f"Residual against {against}.")


def _show_log(validation: Validation) -> Iterator[Block]:
    """Yield the residuals and figures of a log that was predicted."""
    fitted = "The log it was fitted to: this is no test."
    caption = fitted if validation.fitted else "Held out: nothing was fitted here."
    mean = f"Mean over joints of the relative residual: {validation.mean_relative_percent:.4f} %"
    yield f"=== {validation.source} ==="
    yield show_residual(validation.residual, f"{caption} {mean}")
    for series in validation.series:
        error = series.measured - series.predicted
        joint, unit = series.joint, series.unit
        yield f"=== {joint} ==="
        yield Drawing(draw_prediction(series, validation.rows), "Measured and predicted.")
        figure = build_line_figure(
            f"{joint}: residual",
            f"Measured minus predicted {_name_quantity(series, validation.rows)} of {joint} in {unit} "
            "against time in s.",
            ("time (s)", f"residual ({unit})"),
            (Line(label="residual", style="residual", x=series.time, y=error),),
        )
        yield Drawing(figure, "Residual, measured minus predicted.")
        figure = build_histogram(
            f"{joint}: distribution of the residual",
            f"How often which residual of {joint} occurs, and the normal distribution of its deviation.",
            (f"residual ({unit})", "rows"),
            error,
        )
        text = "Distribution of the residual; the line is the normal distribution of the same deviation."
        yield Drawing(figure, text)


def draw_prediction(series: Series, rows: str) -> str:
    """Return the figure of what was measured and predicted of one joint."""
    quantity = _name_quantity(series, rows)
    return build_line_figure(
        f"{series.joint}: measured and predicted {quantity}",
        f"Measured and predicted {quantity} of {series.joint} in {series.unit} against time in s.",
        ("time (s)", f"{quantity} ({series.unit})"),
        (
            Line(label="measured", style="measured", x=series.time, y=series.measured),
            Line(label="predicted", style="predicted", x=series.time, y=series.predicted),
        ),
    )


def _name_quantity(series: Series, rows: str) -> str:
    return "force" if rows == "torque" and series.unit == "N" else QUANTITIES[rows]
