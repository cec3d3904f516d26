"""The pages of identified parameters: of a rigid robot, and of friction joint by joint.

`Estimate`, `Validation` of held-out logs, perhaps a `Diagnosis` -> `Page`: verdict, parameters, residuals,
identifiability, drift, structure of the residual, measured and predicted torques, settings.

`FrictionIdentification` -> `Page`; the figure of a joint has measured rows, their means, law and 95 % band:

    band: g' Cov g, g = [Phi(v), dPhi/ds c]

The curve ends at the slowest row, in each direction: an extrapolated band would be too narrow.

Supported: friction laws of the velocity alone; of others the curve at no load, at angle zero.
Not supported of friction: the scatter of single rows as a band.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.identification.diagnostics import JointProfiles
from symid.identification.estimators import Estimate, LawTrial, Series, Validation
from symid.identification.friction import (
    CONFIDENCE,
    FrictionIdentification,
    JointFriction,
    compute_law_sensitivities,
)
from symid.identification.rigid import Diagnosis
from symid.joint_models import compute_friction_torque, get_law
from symid.report.blocks import Block, Drawing, Table, tabulate
from symid.report.figures import (
    Line,
    Mark,
    build_curve_figure,
    build_histogram,
    build_line_figure,
    build_mark_figure,
)
from symid.report.fit_text import (
    show_all_rows,
    show_evidence,
    show_law_trials,
    show_motion,
    show_poses,
    show_residual,
    tabulate_laws,
)
from symid.report.pages import (
    Page,
    build_fit_page,
    count_significant,
    draw_certainty,
    format_digits,
    format_percent,
    show_refused,
    tabulate_groupings,
    tabulate_parameters,
    write_unit,
)
from symid.report.verdict import QUANTITIES, judge_friction, judge_identification

_CANDIDATES = 15
"""Settings that are listed."""
UNTESTED = "No held-out log was given: the model is untested. Validate it on another motion (--validation)."
_POINTS = 400
_FLAT = 1.01
"""Ratio of objectives up to which a search has nothing to show."""
_STILL = 1e-3
"""Speed of the slowest row over the fastest up to which rows reach standstill."""
_TRIALS = (
    "Friction laws by their residual on held-out blocks. Squares: squared error relative to Coulomb + "
    "viscous + offset. Behind: difference from the best law in standard errors over the blocks; within one, "
    "the law with the fewest parameters is chosen."
)


def build_identification_page(
    estimate: Estimate,
    validations: Sequence[Validation] = (),
    notices: Sequence[Notice] = (),
    origin: Sequence[str] = (),
    *,
    diagnosis: Diagnosis | None = None,
    **options: Any,  # noqa: ANN401  fields of the page
) -> Page:
    """Return all that the page shows.

    Args:
        estimate: of base parameters.
        validations: what it explains of logs.
        notices: what else a reader should know: of the robot, its library, and the recordings.
        origin: what the page was made from, in short texts.
        diagnosis: of the fit and its own logs.
        options: further fields of the page.
    """
    settings = {
        "rows": estimate.rows,
        "estimator": estimate.estimator,
        "friction": estimate.friction,
        "rows fitted": estimate.samples,
        "condition number (column-scaled)": f"{estimate.condition:.4g}",
        "outcome": estimate.outcome.value,
    }
    blocks = (
        *chain.from_iterable(map(_show_log, validations)),
        "== Parameters ==",
        tabulate_parameters(estimate.parameters),
        *draw_certainty(estimate.parameters),
        *show_refused(estimate.refused),
        *_show_laws(estimate),
        *(() if validations else ("== Held-out logs ==", UNTESTED)),
    )
    more = (
        "== What each parameter groups ==",
        tabulate_groupings(estimate.parameters),
        "== Residual of the fit ==",
        show_residual(estimate.residual, "What the model leaves unexplained of the logs of the fit."),
        *_show_choice(estimate),
        *(() if diagnosis is None else _show_diagnosis(estimate, diagnosis)),
        *chain.from_iterable(map(_show_errors, validations)),
    )
    return build_fit_page(
        estimate,
        subject="identified parameters",
        verdict=judge_identification(estimate, validations),
        numbers=_list_numbers(estimate, validations),
        lead=_draw_lead(estimate, validations),
        blocks=blocks,
        more=more,
        settings=settings,
        notices=notices,
        origin=origin,
        **options,
    )


def _list_numbers(estimate: Estimate, validations: Sequence[Validation]) -> list[tuple[str, str]]:
    """Return the numbers that matter: what is left of held-out motions, where most, what is significant."""
    worst, evidence, numbers = _find_worst(validations), estimate.evidence, []
    if worst is not None:
        numbers += _list_tried(worst)
    elif evidence is not None:
        part = max(evidence.joints, key=lambda entry: entry.held_out)
        numbers += [
            (format_percent(evidence.unexplained), "of the torque unexplained in stretches held out in turn"),
            (format_percent(part.held_out), f"of it at most, at {part.joint}"),
        ]
    else:
        joint = max(estimate.residual, key=lambda entry: entry.relative_percent)
        text = "of the torque unexplained, in the logs of the fit alone"
        numbers.append((format_percent(estimate.mean_relative_percent), text))
        numbers.append((format_percent(joint.relative_percent), f"of it at most, at {joint.joint}"))
    numbers.append(count_significant(estimate.parameters))
    return numbers


def _find_worst(validations: Sequence[Validation]) -> Validation | None:
    """Return the held-out log with most left; None where there is none."""
    held_out = (entry for entry in validations if not entry.fitted)
    return max(held_out, key=lambda entry: entry.mean_relative_percent, default=None)


def _list_tried(worst: Validation) -> list[tuple[str, str]]:
    joint = max(worst.residual, key=lambda entry: entry.relative_percent)
    what = f"of the {QUANTITIES[worst.rows]} unexplained in the held-out log"
    found = [(format_percent(worst.mean_relative_percent), what)]
    if len(worst.residual) == 1:
        return [*found, (f"{format_digits(joint.std)} {write_unit(joint.unit)}", "RMS of it")]
    return [*found, (format_percent(joint.relative_percent), f"of it at most, at {joint.joint}")]


def _draw_worst(worst: Validation) -> Drawing:
    joint = max(worst.residual, key=lambda entry: entry.relative_percent).joint
    series = next((entry for entry in worst.series if entry.joint == joint), worst.series[0])
    most = f" {joint}, the joint with most left." if len(worst.series) > 1 else ""
    question = f"Does it predict motions that it was not fitted to?{most}"
    return draw_prediction(series, worst.rows, question)


def _draw_lead(estimate: Estimate, validations: Sequence[Validation]) -> Drawing:
    """Return the worst joint of a held-out log, measured and predicted; else what is left joint by joint."""
    worst = _find_worst(validations)
    if worst is not None and worst.series:
        return _draw_worst(worst)
    evidence = estimate.evidence
    if evidence is not None:
        pairs = [(entry.joint, entry.held_out) for entry in evidence.joints]
        caption = "How much does it miss, joint by joint? Torque left in stretches that were held out."
    else:
        pairs = [(entry.joint, entry.relative_percent) for entry in estimate.residual]
        caption = "How much does it miss, joint by joint? Torque left in the logs of the fit."
    worst_joint = max(pairs, key=lambda pair: pair[1])[0]
    marks = [Mark(name, value, format_percent(value), name == worst_joint) for name, value in pairs]
    return build_mark_figure(caption, "unexplained (% of the joint's torque)", marks)


def _show_laws(estimate: Estimate) -> Iterator[Block]:
    """Yield the friction laws found, and how that of each joint was chosen."""
    if not estimate.laws:
        return
    yield "== Friction laws =="
    yield from tabulate_laws(estimate.laws)
    for entry in estimate.laws:
        if entry.selection is not None and len(entry.selection.trials) > 1:
            yield f"=== {entry.joint}: {entry.law} ==="
            yield entry.selection.verdict
            yield show_law_trials(entry.selection)


def _show_choice(estimate: Estimate) -> Iterator[Block]:
    """Yield what held-out stretches say of every joint, and the settings that were compared."""
    evidence, choice = estimate.evidence, estimate.choice
    if evidence is not None:
        yield "== Held-out stretches =="
        yield show_evidence(evidence)
    if choice is not None:
        yield "== Choice of the settings =="
        order = sorted(choice.candidates, key=lambda entry: (entry.behind, entry.held_out[-1]))
        first = [choice.chosen, *(entry for entry in order if entry is not choice.chosen)]
        columns = (
            "rows up to/Hz=band:.3g; instruments/Hz=instruments:.3g; slow rows/%=slow:.3g; states; "
            "held out/%=held:.3g; behind/se=behind:.2g; movement=movement:.2g; choice"
        )
        yield tabulate(
            first[:_CANDIDATES],
            columns,
            (3, 7),
            f"The best of {len(first)} settings that were compared, with the one taken.",
            slow=lambda entry: 100.0 * entry.standstill,
            held=lambda entry: entry.held_out[-1],
            choice=lambda entry: "taken" if entry is choice.chosen else "" if entry.still else "moves",
        )


def _show_diagnosis(estimate: Estimate, diagnosis: Diagnosis) -> Iterator[Block]:
    essential, bootstrap = diagnosis.essential, diagnosis.bootstrap
    yield from ("== Identifiability ==", describe_rank(diagnosis), _draw_spectrum(diagnosis))
    if diagnosis.correlated:
        pairs = [(a, b, f"{value:.3f}") for a, b, value in diagnosis.correlated]
        yield Table(("one", "other", "correlation"), pairs, (0, 1), "Strongly correlated parameters.")
    if diagnosis.ellipse is not None:
        first, second, _ = diagnosis.correlated[0]
        outline, level = diagnosis.ellipse.trace(), diagnosis.ellipse.level
        yield build_curve_figure(
            f"The closest pair, {first} and {second}: {level:.0%} confidence ellipse.",
            (first, second),
            (Line("ellipse", "first", outline[:, 0], outline[:, 1]),),
        )
    yield from ("== Significant parameters ==", describe_essential(diagnosis))
    if essential.dropped:
        columns = "name; value / std=ratio:.2g; residual grows by/%=price_percent:.2g"
        yield tabulate(essential.dropped, columns, title="In the order they can be dropped.")
    yield "== Standard deviations by block bootstrap =="
    yield (
        f"{bootstrap.blocks} blocks of the logs, resampled {bootstrap.replicates} times: valid for any "
        "correlation of the residual within a block."
    )
    yield _tabulate_scatter(estimate, diagnosis)
    yield from _show_drift(estimate, diagnosis)
    yield "== Structure of the residual =="
    if diagnosis.structure:
        columns = (
            "joint; function of=family; share of variance/%=share_percent:.3g; RMS=rms:.3g; unit; advice"
        )
        title = "What explains the residual, cross-validated on stretches of time."
        yield tabulate(diagnosis.structure, columns, (0, 1, 4, 5), title)
    else:
        yield (
            "No function of position, velocity, load, acceleration, time or of other joints explains 5 % of "
            "a joint's residual variance."
        )
    for entry in diagnosis.profiles:
        yield f"=== {entry.joint} ==="
        yield from _draw_profiles(entry)
    if diagnosis.prices:
        prices = [(entry.what, entry.of, f"{entry.percent:+.3g} %") for entry in diagnosis.prices]
        yield "== Effect of the choices =="
        yield Table(("choice", "quantity", "change"), prices, (0, 1), "What the choices of the fit change.")


def describe_rank(diagnosis: Diagnosis) -> str:
    """Return rank and condition number of the regressor in a sentence."""
    count, rank = len(diagnosis.singular), diagnosis.rank
    condition = f"{diagnosis.singular[0] / diagnosis.singular[rank - 1]:.3g} (column-scaled)"
    if rank == count:
        return f"The regressor has full rank ({rank} of {count}); its condition number is {condition}."
    return (
        f"The regressor has rank {rank} of {count}: {count - rank} combinations of parameters are not "
        f"identifiable. The condition number of the others is {condition}."
    )


def describe_essential(diagnosis: Diagnosis) -> str:
    """Return how many parameters are significant, and what leaving out the others costs."""
    kept, dropped = len(diagnosis.essential.kept), len(diagnosis.essential.dropped)
    if not dropped:
        return f"All {kept} parameters are significant (> 2 sigma); none can be dropped."
    return (
        f"{kept} of {kept + dropped} parameters are significant (> 2 sigma). Without the others the residual "
        f"grows by {diagnosis.essential.price_percent:.2g} %."
    )


def _draw_spectrum(diagnosis: Diagnosis) -> Drawing:
    values, rank = np.array(diagnosis.singular), diagnosis.rank
    number = np.arange(1.0, len(values) + 1.0)
    lines = [Line("identifiable", "first", number[:rank], values[:rank], markers=True)]
    if np.any(values[rank:] > 0.0):
        lines.append(Line("not identifiable", "second", number[rank:], values[rank:], markers=True))
    return build_line_figure(
        "Singular values of the column-scaled regressor, in falling order.",
        ("number", "singular value"),
        lines,
        logarithmic=True,
        whole=True,
    )


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
            name not in dropped,
        )
        for name, deviation, low, high in zip(
            found.names, found.deviations, found.low, found.high, strict=True
        )
        if name in stated
    ]
    header = ("name", "value", "stated std", "bootstrap std", "from", "to (95 %)", "significant")
    return Table(header, rows, title="Values in SI units.")


def _show_drift(estimate: Estimate, diagnosis: Diagnosis) -> Iterator[Block]:
    drift = diagnosis.drift
    yield "== Drift between logs =="
    if len(drift.runs) < 2:
        yield "Drift needs at least two logs; there is one."
    elif not drift.changed:
        yield f"{drift.compared} parameters agree between {len(drift.runs)} logs within their noise."
    else:
        yield (
            f"{len(drift.changed)} of {drift.compared} parameters differ significantly between the logs: the "
            "robot changed, or the model misses a term."
        )
    rows = []
    for entry in drift.changed:
        if len(entry.values) == len(drift.runs):
            pairs = zip(entry.values, entry.deviations, strict=True)
            rows.append((entry.name, *(f"{value:.4g} ± {format_digits(std)}" for value, std in pairs)))
    if rows:
        header = ("name", *(Path(estimate.sources[run]).name for run in drift.runs))
        yield Table(header, rows, title="Estimates from each log alone, value ± std.")


def _draw_profiles(entry: JointProfiles) -> Iterator[Drawing]:
    unit = entry.position_unit
    for against, label, profile in (
        ("position", f"position ({unit})", entry.position),
        ("velocity", f"velocity ({unit}/s)", entry.velocity),
        ("load", f"predicted torque ({entry.unit})", entry.load),
    ):
        centre, mean, deviation = profile.centre, profile.mean, profile.deviation
        lines = [
            Line("mean", "first", centre, mean, markers=True),
            Line("plus deviation", "second", centre, mean + deviation),
            Line("minus deviation", "third", centre, mean - deviation),
        ]
        yield build_line_figure(
            f"Mean residual of {entry.joint} against {against}, with one standard deviation either side.",
            (label, f"residual ({entry.unit})"),
            lines,
        )


def _show_log(validation: Validation) -> Iterator[Block]:
    caption = "A log of the fit: this is no test." if validation.fitted else "Held out: not used in the fit."
    mean = f"Mean over joints of the relative residual: {validation.mean_relative_percent:.4f} %"
    name = Path(validation.source).name
    yield f"== {'Log of the fit' if validation.fitted else 'Held-out log'} {name} =="
    yield show_residual(validation.residual, f"{validation.source}. {caption} {mean}")
    # The figure of one joint leads the page.
    shown = validation.series if len(validation.series) > 1 or validation.fitted else ()
    yield from (draw_prediction(series, validation.rows) for series in shown)


def _show_errors(validation: Validation) -> Iterator[Block]:
    """Yield the residual of a log: by phases of motion, over time, and its distribution."""
    yield f"== Residual of {Path(validation.source).name} =="
    yield from show_motion(validation.motion)
    if validation.scoring:
        yield f"{_capitalise(show_all_rows(validation))}."
    for series in validation.series:
        error, joint, unit = series.measured - series.predicted, series.joint, series.unit
        quantity = _name_quantity(series, validation.rows)
        yield build_line_figure(
            f"When does it miss? {joint}, measured minus predicted {quantity}.",
            ("time (s)", f"residual ({unit})"),
            (Line("residual", "residual", series.time, error),),
        )
        yield build_histogram(
            f"Is it noise? Residual of {joint}, and the normal distribution of the same deviation.",
            (f"residual ({unit})", "rows"),
            error,
        )


def draw_prediction(series: Series, rows: str, caption: str = "") -> Drawing:
    """Return the figure of what was measured and predicted of one joint."""
    quantity, values = _name_quantity(series, rows), (series.measured, series.predicted)
    return build_line_figure(
        f"{caption} Measured and predicted {quantity} of {series.joint}.".lstrip(),
        ("time (s)", f"{quantity} ({series.unit})"),
        [Line(name, name, series.time, y) for name, y in zip(("measured", "predicted"), values, strict=True)],
    )


def _name_quantity(series: Series, rows: str) -> str:
    return "force" if QUANTITIES[rows] == "torque" and series.unit == "N" else QUANTITIES[rows]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionCurve:
    """A law over velocity: torque (V,) in N m or N at velocity (V,), half width (V,) of its 95 % band."""

    velocity: FloatArray
    torque: FloatArray
    half_width: FloatArray


def compute_friction_curve(joint: JointFriction) -> FrictionCurve:
    """Return the law of a joint over the velocities that were measured, dense where it bends."""
    law = get_law(joint.estimate.law, smoothing=joint.smoothing)
    fastest = float(np.max(np.abs(joint.velocity_map.cloud_velocity), initial=0.0)) or 1.0
    slowest = joint.velocity_map.slowest
    half = np.geomspace(max(1e-4 * fastest, min(slowest, fastest)), fastest, _POINTS // 2)
    low, high = (float(part(joint.velocity_map.cloud_velocity)) for part in (np.min, np.max))
    rest = [0.0] if slowest <= _STILL * fastest else []
    velocity = np.concatenate([-half[::-1], rest, half])
    velocity = velocity[(velocity >= min(low, 0.0)) & (velocity <= max(high, 0.0))]
    inputs = {name: np.zeros(len(velocity)) for name in law.inputs} | {"velocity": velocity}
    linear, shape = list(joint.estimate.linear), list(joint.estimate.shape)
    gradient = compute_law_sensitivities(law, inputs, linear, shape)
    size = gradient.shape[1]
    covariance = np.array(joint.estimate.covariance)[:size, :size]
    variance = np.einsum("ni,ij,nj->n", gradient, covariance, gradient)
    return FrictionCurve(
        velocity=velocity,
        torque=compute_friction_torque(law, inputs, linear, shape),
        half_width=CONFIDENCE * np.sqrt(np.maximum(variance, 0.0)),
    )


def build_friction_figure(joint: JointFriction) -> Drawing:
    """Return the figure of one joint: one curve, or one a direction where no row is near standstill."""
    curve, measured = compute_friction_curve(joint), joint.velocity_map
    shown = np.concatenate([measured.cloud_torque, curve.torque])
    # A band that is wider than all else must not squeeze it.
    bands = [
        np.clip(curve.torque + side * curve.half_width, shown.min(), shown.max()) for side in (-1.0, 1.0)
    ]
    kinds = (*(("95 % band", "fourth", band) for band in bands), ("law", "predicted", curve.torque))
    cut = int(np.searchsorted(curve.velocity, 0.0))
    pieces = [part for part in (slice(0, cut), slice(cut, None)) if len(curve.velocity[part])]
    if measured.slowest <= _STILL * float(np.max(np.abs(curve.velocity), initial=0.0)):
        pieces = [slice(None)]
    lines = [
        Line("measured rows", "cloud", measured.cloud_velocity, measured.cloud_torque, joined=False),
        *(
            Line(label, style, curve.velocity[part], values[part])
            for part in pieces
            for label, style, values in kinds
        ),
        Line("mean of them", "link", measured.velocity, measured.torque, markers=True, joined=False),
    ]
    return build_curve_figure(
        f"Does the law follow the friction of {joint.joint}? Rows that were measured, their means over "
        f"intervals of velocity, and the law {joint.estimate.law} with its 95 % confidence band.",
        (f"velocity ({joint.velocity_unit})", f"friction ({joint.unit})"),
        lines,
        height=380.0,
    )


def build_friction_page(
    found: FrictionIdentification,
    validations: Sequence[Validation] = (),
    notices: Sequence[Notice] = (),
    origin: Sequence[str] = (),
    **options: Any,  # noqa: ANN401  fields of the page
) -> Page:
    """Return all that the page shows.

    Args:
        found: the laws.
        validations: what laws and rigid part predict of logs.
        notices: what else a reader should know.
        origin: what the page was made from, in short texts.
        options: further fields of the page.
    """
    left_out = "\n".join(f"{name}: {reason}" for name, reason in found.refused)
    tried, first = _find_worst(validations), max(found.joints, key=_find_left)
    lead = build_friction_figure(first) if tried is None else _draw_worst(tried)
    blocks = (
        *chain.from_iterable(map(_show_log, validations)),
        *(
            block
            for entry in found.joints
            for block in _show_joint(entry, led=entry is first and tried is None)
        ),
        *(("== Joints without a law ==", left_out) if left_out else ()),
    )
    more = (
        *(block for entry in found.joints for block in _show_search(entry)),
        *chain.from_iterable(map(_show_errors, validations)),
    )
    numbers = _list_left(first) if tried is None else _list_tried(tried)
    numbers.append(count_significant([one for entry in found.joints for one in entry.estimate.parameters]))
    settings = {"requested law": found.model, "estimator": found.estimator}
    return build_fit_page(
        found,
        subject="identified friction",
        verdict=judge_friction(found, validations),
        numbers=numbers,
        lead=lead,
        blocks=blocks,
        more=more,
        settings=settings,
        notices=notices,
        origin=origin,
        **options,
    )


def _get_held_out(entry: JointFriction) -> LawTrial | None:
    """Return what the law of a joint left of held-out blocks, None where there were none."""
    trials = () if entry.selection is None else entry.selection.trials
    found = (trial for trial in trials if entry.selection and trial.law == entry.selection.chosen)
    return next((trial for trial in found if trial.held_percent is not None), None)


def _find_left(entry: JointFriction) -> float:
    trial = _get_held_out(entry)
    return entry.residual.relative_percent if trial is None else trial.held_percent or 0.0


def _list_left(entry: JointFriction) -> list[tuple[str, str]]:
    """Return what the law of a joint leaves: of held-out blocks where they were compared, else of the fit."""
    trial, where = _get_held_out(entry), f"at {entry.joint}, the joint with most left"
    if trial is None:
        text = f"of the torque unexplained in the logs of the fit, {where}"
        found = [(format_percent(entry.residual.relative_percent), text)]
        return [*found, (f"{format_digits(entry.residual.std)} {write_unit(entry.unit)}", "RMS of it")]
    found = [(format_percent(_find_left(entry)), f"of the torque unexplained in held-out blocks, {where}")]
    rms = trial.held_rms
    return found if rms is None else [*found, (f"{format_digits(rms)} {write_unit(entry.unit)}", "RMS of it")]


def _show_joint(entry: JointFriction, *, led: bool) -> Iterator[Block]:
    """Yield the law of a joint; `led` where its figure leads the page."""
    estimate = entry.estimate
    yield f"== {entry.joint}: {estimate.law} =="
    yield f"    {entry.formula}"
    yield from () if led else (build_friction_figure(entry),)
    yield tabulate_parameters(estimate.parameters, formulas=False)
    yield from show_refused(estimate.refused)
    yield show_residual((entry.residual,), "Residual of law and rigid part in the logs of the fit.")
    if entry.selection is not None:
        yield entry.selection.verdict


def _show_search(entry: JointFriction) -> Iterator[Block]:
    """Yield how the law of a joint was found: phases of motion, rigid part, choice, poses, the search."""
    estimate = entry.estimate
    yield f"== {entry.joint}: how it was found =="
    yield from show_motion((entry.motion,) if entry.motion is not None else ())
    yield f"{_capitalise(entry.rigid)}."
    yield (
        f"{_capitalise(estimate.outcome.value)}: {estimate.ended}; evaluations of the objective: "
        f"{estimate.evaluations}, linear problems: {estimate.solves}."
    )
    yield f"AICc {estimate.aicc:.5g}, BIC {estimate.bic:.5g}, condition number {estimate.condition:.3g}."
    if estimate.extra:
        yield from ("=== Rigid part ===", tabulate_parameters(estimate.extra, formulas=False))
    if entry.selection is not None:
        yield from ("=== Choice of the law ===", show_law_trials(entry.selection, _TRIALS))
    if entry.poses is not None:
        yield from ("=== Poses of the other joints ===", f"{_capitalise(entry.poses.verdict)}.")
        yield from show_poses(entry.poses)
    history = [value for value in estimate.history if value > 0.0]
    if len(history) >= 3 and max(history) > _FLAT * min(history):
        number, markers = np.arange(float(len(history))), len(history) < 40
        line = Line("objective", "final", number, np.array(history), markers)
        yield build_line_figure(
            "Did the search settle? Least objective after each iteration or generation.",
            ("iteration or generation", f"objective (({entry.unit})²)"),
            (line,),
            logarithmic=True,
            whole=True,
        )


def _capitalise(text: str) -> str:
    return text[:1].upper() + text[1:]
