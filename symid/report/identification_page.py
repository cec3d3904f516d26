"""The pages of fits: of a rigid robot, of friction joint by joint, of any kind with the logs it is tried on.

Estimate of any kind, `Validation` of held-out logs, perhaps a `Diagnosis` -> `FitVerdict`, drawings, `Page`.
The figure of a friction law has measured rows, their means, the law and its 95 % band g' Cov g with
g = [Phi(v), dPhi/ds c]. The curve ends at the slowest row in each direction: an extrapolated band would be
too narrow.

Supported: friction laws of the velocity alone; of others the curve at no load, at angle zero.
Not supported of friction: the scatter of single rows as a band.
"""

import math
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from symid import identification
from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.identification import (
    FrictionValidation,
    TaskContext,
    diagnose_fit,
    elastic,
    friction,
    validate_fit,
)
from symid.identification.estimators import (
    SIGNIFICANT,
    Estimate,
    Residual,
    Series,
    Validation,
    check_model,
    warn_of_other_bodies,
)
from symid.identification.rigid import (
    Diagnosis,
    get_fit_overlap,
    get_usable_window,
    restore_robot,
    validate_estimate,
)
from symid.joint_models import compute_friction_torque, compute_law_sensitivities, get_law
from symid.logs import LogPart, Recording, check_recording, read_recordings, take_parts
from symid.report import blocks, figures, pages, texts
from symid.report.blocks import Block, Drawing, Table
from symid.report.drawings import draw_robot
from symid.report.elastic_page import build_elastic_page, draw_branches
from symid.report.verdict import (
    QUANTITIES,
    AnyEstimate,
    FitVerdict,
    judge_elastic,
    judge_friction,
    judge_identification,
)
from symid.robot import Robot, list_robots, name_for_commands

_CANDIDATES = 15
"""Settings that are listed."""
_POINTS = 400
_FLAT = 1.01
"""Ratio of objectives up to which a search has nothing to show."""
_STILL = 1e-3
"""Speed of the slowest row over the fastest up to which rows reach standstill."""
_LEFT = "Residual of the model in the logs of the fit: all equations, at all their frequencies."
_TRIALS = (
    "Friction laws by their residual on held-out parts of the log. Squares: squared error relative to "
    "Coulomb + viscous + offset. Behind: difference from the best law in standard errors over the parts; of "
    "those that are not significantly worse, the law with the fewest parameters is chosen."
)


def build_identification_page(
    estimate: Estimate,
    validations: Sequence[Validation] = (),
    *,
    diagnosis: Diagnosis | None = None,
    **options: Any,  # noqa: ANN401  of `build_fit_page`
) -> pages.Page:
    """Return all that the page shows.

    Args:
        estimate: of base parameters.
        validations: what it explains of logs.
        diagnosis: of the fit and its own logs.
        options: notices, origin and further fields of the page, as of `build_fit_page`.
    """
    # Numbers that matter, and in a sentence how large the residual is, of which joint most.
    tried, evidence, shares = _find_worst(validations), estimate.evidence, _list_left(estimate.residual)
    if evidence is not None:
        shares = [(entry.joint, entry.held_out) for entry in evidence.joints]
    if tried is not None:
        numbers, headline = _tell_tried(tried)
    elif evidence is not None:
        where = "held-out stretches (cross-validation)"
        numbers, headline = _tell_residual(where, evidence.unexplained, shares, band=evidence.scoring)
    else:
        numbers, headline = _tell_residual("its own logs alone", estimate.mean_relative_percent, shares)
    # The worst log leads the page, or else what is left joint by joint; other logs stand behind.
    if tried is not None and tried.series:
        lead = _draw_worst(tried)
    else:
        place = "the logs of the fit" if evidence is None else "stretches that were held out"
        most, _ = max(shares, key=itemgetter(1))
        marks = [
            figures.Mark(name, value, blocks.format_percent(value), name == most) for name, value in shares
        ]
        caption = f"How much does it miss, joint by joint? Residual in {place}."
        lead = figures.build_mark_figure(caption, "residual (% of the joint's torque)", marks)
    worst = tried or next(iter(validations), None)
    shown: Iterable[Block] = ("== Held-out logs ==", pages.UNTESTED) if worst is None else _show_log(worst)
    parameters = pages.tabulate_parameters(estimate.parameters, simulated=estimate.simulated)
    return pages.build_fit_page(
        estimate,
        subject="identified parameters",
        verdict=judge_identification(estimate, validations),
        headline=headline,
        numbers=[*numbers, pages.count_significant(estimate.parameters)],
        lead=lead,
        blocks=(
            *shown,
            "== Parameters ==",
            parameters,
            *pages.draw_certainty(estimate.parameters),
            *pages.show_refused(estimate.refused),
        ),
        more=(
            *chain.from_iterable(_show_log(entry) for entry in validations if entry is not worst),
            *texts.show_laws(estimate.laws),
            *("== What each parameter groups ==", *pages.show_groupings(estimate.parameters)),
            "== Residual of the fit ==",
            pages.tabulate_residual(estimate.residual, _LEFT),
            *_show_choice(estimate),
            *(() if diagnosis is None else _show_diagnosis(estimate, diagnosis)),
            *chain.from_iterable(map(_show_errors, validations)),
        ),
        settings={
            "rows": estimate.rows,
            "estimator": estimate.estimator,
            "friction": estimate.friction,
            "samples fitted": estimate.samples,
            "condition number (column-scaled)": f"{estimate.condition:.4g}",
            "outcome": estimate.ending,
        },
        **options,
    )


def _tell_tried(worst: Validation) -> tuple[list[tuple[str, str]], str]:
    shares, only = _list_left(worst.residual), worst.residual[0]
    what: Any = {"what": QUANTITIES[worst.rows], "band": worst.scoring, "rms": (only.std, only.unit)}
    return _tell_residual("a held-out log", worst.mean_relative_percent, shares, **what)


def _tell_residual(
    where: str,
    whole: float,
    shares: Sequence[tuple[str, float]],
    *,
    what: str = "torque",
    band: float = 0.0,
    rms: tuple[float, str] | None = None,
) -> tuple[list[tuple[str, str]], str]:
    """Return the residual as numbers and in a sentence; its `rms` and unit stand for one joint."""
    joint, most = max(shares, key=itemgetter(1))
    mean, highest = blocks.format_percent(whole), blocks.format_percent(most)
    told = f"On {where} the model has a residual of {mean} of the {what}"
    told += f" below {band:.3g} Hz" * (band > 0.0)
    numbers = [(mean, f"residual of the {what} on {where}")]
    if len(shares) > 1:
        told += f" (mean of the joints); the worst joint is {joint}, with {highest}"
        numbers.append((highest, f"at {joint}, the worst joint"))
    elif rms is not None:
        numbers.append((f"{blocks.format_digits(rms[0])} {blocks.write_unit(rms[1])}", "RMS of it"))
    return numbers, f"{told}."


def _list_left(residual: Sequence[Residual]) -> list[tuple[str, float]]:
    return [(entry.joint, entry.relative_percent) for entry in residual]


def _find_worst(validations: Sequence[Validation]) -> Validation | None:
    """Return the held-out log with most left; None where there is none."""
    held_out = (entry for entry in validations if not entry.fitted)
    return max(held_out, key=lambda entry: entry.mean_relative_percent, default=None)


def _get_worst_joint(validation: Validation) -> str:
    return max(validation.residual, key=lambda entry: entry.relative_percent).joint


def _draw_worst(worst: Validation) -> Drawing:
    joint = _get_worst_joint(worst)
    series = next((entry for entry in worst.series if entry.joint == joint), worst.series[0])
    most = f" {joint}, the worst joint." if len(worst.series) > 1 else ""
    question = f"Does it predict motions that it was not fitted to?{most}"
    return draw_prediction(series, worst.rows, question)


def _show_choice(estimate: Estimate) -> Iterator[Block]:
    """Yield what held-out stretches say of every joint, and the settings that were compared."""
    evidence, choice = estimate.evidence, estimate.choice
    if evidence is not None:
        yield "== Held-out stretches =="
        yield texts.show_evidence(evidence)
        if evidence.tests:
            yield texts.show_tests(evidence)
    if choice is not None:
        yield "== Choice of the settings =="
        order = sorted(choice.candidates, key=lambda entry: entry.held_out)
        first = [choice.chosen, *(entry for entry in order if entry is not choice.chosen)]
        rows = []
        for entry in first[:_CANDIDATES]:
            bands = (texts.write_number(value, ".3g") for value in (entry.band, entry.instruments))
            forms = (".3g", ".3g", ".2g", ".2g")
            sizes = map(format, (entry.held_out, entry.fall, entry.p, entry.consistent), forms)
            rows.append((*bands, entry.states, *sizes, "taken" if entry is choice.chosen else ""))
        title = (
            f"The best of {len(first)} settings that were compared by the torque held out in the band and "
        )
        title += "in a narrower one, with the one taken: of those that "
        title += "predict as well as the best (squared residual over that of the best; p-value) and agree "
        title += "with the lowest instruments (p-value) the one of the widest band."
        header = ("band to/Hz", "instruments/Hz", "states", "both bands/%", "squares", "p", "agrees, p")
        yield Table((*header, "choice"), rows, (2, 7), title)


def _show_diagnosis(estimate: Estimate, diagnosis: Diagnosis) -> Iterator[Block]:
    essential, bootstrap = diagnosis.essential, diagnosis.bootstrap
    yield from ("== Identifiability ==", describe_rank(diagnosis))
    values, rank = np.array(diagnosis.singular), diagnosis.rank
    number = np.arange(1.0, len(values) + 1.0)
    lines = [figures.Line("identifiable", "first", number[:rank], values[:rank], markers=True)]
    if np.any(values[rank:] > 0.0):
        lines.append(figures.Line("not identifiable", "second", number[rank:], values[rank:], markers=True))
    caption = "Singular values of the column-scaled regressor, in falling order."
    yield figures.build_line_figure(
        caption, ("number", "singular value"), lines, logarithmic=True, whole=True
    )
    if diagnosis.correlated:
        pairs = [(a, b, f"{value:.3f}") for a, b, value in diagnosis.correlated]
        yield Table(("one", "other", "correlation"), pairs, (0, 1), "Strongly correlated parameters.")
    if diagnosis.ellipse is not None:
        first, second, _ = diagnosis.correlated[0]
        outline, level = diagnosis.ellipse.trace(), diagnosis.ellipse.level
        caption = f"The closest pair, {first} and {second}: {level:.0%} confidence ellipse."
        line = figures.Line("ellipse", "first", outline[:, 0], outline[:, 1])
        yield figures.build_curve_figure(caption, (first, second), (line,))
    yield from ("== Essential parameters ==", describe_essential(diagnosis))
    if essential.dropped:
        header = ("name", "value / std", "residual grows by/%")
        gone = [(e.name, f"{e.ratio:.2g}", f"{e.price_percent:.2g}") for e in essential.dropped]
        yield Table(header, gone, title="In the order they can be dropped.")
    yield "== Standard deviations by block bootstrap =="
    resampled = f"{bootstrap.blocks} blocks of the logs, resampled {bootstrap.replicates} times"
    yield f"{resampled}: valid for any correlation of the residual within a block."
    stated = {entry.name: entry for entry in estimate.parameters}
    dropped = {entry.name for entry in essential.dropped}
    columns, scatter = (bootstrap.deviations, bootstrap.low, bootstrap.high), list[Sequence[object]]()
    for name, deviation, low, high in zip(bootstrap.names, *columns, strict=True):
        if name in stated:
            both = (blocks.format_pair(stated[name].value, std) for std in (stated[name].std, deviation))
            interval = blocks.format_in_digits((low, high), deviation, " to ") if deviation > 0.0 else ""
            scatter.append((name, *both, interval, "not essential" if name in dropped else ""))
    titles = ("name", "value ± stated std", "value ± bootstrap std", "95 % interval", "remark")
    yield Table(titles, scatter, (0, 4), title="Values in SI units.")
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
    apart = [
        (entry.name, *map(blocks.format_pair, entry.values, entry.deviations))
        for entry in drift.changed
        if len(entry.values) == len(drift.runs)
    ]
    if apart:
        names = ("name", *(Path(estimate.sources[run]).name for run in drift.runs))
        yield Table(names, apart, title="Estimates from each log alone, value ± std.")
    yield "== Structure of the residual =="
    if diagnosis.structure:
        found = ((e, f"{e.share_percent:.3g}", f"{e.rms:.3g}") for e in diagnosis.structure)
        rows = [(e.joint, e.family, share, rms, e.unit, e.advice) for e, share, rms in found]
        title = "What explains the residual, cross-validated on stretches of time."
        heading = ("joint", "function of", "share of variance/%", "RMS", "unit", "advice")
        yield Table(heading, rows, (0, 1, 4, 5), title)
    else:
        yield (
            "No function of position, velocity, load, acceleration, time or of other joints explains 5 % of "
            "a joint's residual variance."
        )
    for entry in diagnosis.profiles:
        yield f"=== {entry.joint} ==="
        unit = entry.position_unit
        for against, label, profile in (
            ("position", f"position ({unit})", entry.position),
            ("velocity", f"velocity ({unit}/s)", entry.velocity),
            ("load", f"predicted torque ({entry.unit})", entry.load),
        ):
            centre, mean, deviation = profile.centre, profile.mean, profile.deviation
            lines = [
                figures.Line("mean", "first", centre, mean, markers=True),
                figures.Line("plus deviation", "second", centre, mean + deviation),
                figures.Line("minus deviation", "third", centre, mean - deviation),
            ]
            caption = f"Mean residual of {entry.joint} against {against}"
            caption += ", with one standard deviation either side."
            yield figures.build_line_figure(caption, (label, f"residual ({entry.unit})"), lines)
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
    """Return how many parameters are essential, and what leaving out the others costs."""
    kept, dropped = len(diagnosis.essential.kept), len(diagnosis.essential.dropped)
    if not dropped:
        return f"All {kept} parameters are essential: none can be dropped."
    return (
        f"{kept} of {kept + dropped} parameters are essential: with these alone, all of them above "
        f"{SIGNIFICANT:g} std, the residual grows by {diagnosis.essential.price_percent:.2g} %."
    )


def _show_log(validation: Validation) -> Iterator[Block]:
    caption = "A log of the fit: this is no test." if validation.fitted else "Held out: not used in the fit."
    mean = f"Mean of the joints: {blocks.format_percent(validation.mean_relative_percent)}."
    name = Path(validation.source).name
    yield f"== {'Log of the fit' if validation.fitted else 'Held-out log'} {name} =="
    yield pages.tabulate_residual(validation.residual, f"{caption} {mean}")
    # The figure of the worst joint leads the page.
    joint = "" if validation.fitted else _get_worst_joint(validation)
    yield from (
        draw_prediction(entry, validation.rows) for entry in validation.series if entry.joint != joint
    )


def _show_errors(validation: Validation) -> Iterator[Block]:
    yield f"== Residual of {Path(validation.source).name} =="
    yield from texts.show_motion(validation.motion)
    if validation.scoring:
        yield f"{_capitalise(texts.show_all_rows(validation))}."
    for series in validation.series:
        error, joint, unit = series.measured - series.predicted, series.joint, series.unit
        quantity = _name_quantity(series, validation.rows)
        caption = f"When does it miss? {joint}, measured minus predicted {quantity}."
        line = figures.Line("residual", "residual", series.time, error)
        yield figures.build_line_figure(caption, (figures.TIME, f"residual ({unit})"), (line,))


def draw_prediction(series: Series, rows: str, caption: str = "") -> Drawing:
    """Return the figure of what was measured and predicted of one joint."""
    quantity, values = _name_quantity(series, rows), (series.measured, series.predicted)
    named = zip(("measured", "predicted"), values, strict=True)
    return figures.build_line_figure(
        f"{caption} Measured and predicted {quantity} of {series.joint}.".lstrip(),
        (figures.TIME, f"{quantity} ({series.unit})"),
        [figures.Line(name, name, series.time, y) for name, y in named],
    )


def _name_quantity(series: Series, rows: str) -> str:
    return "force" if QUANTITIES[rows] == "torque" and series.unit == "N" else QUANTITIES[rows]


def compute_friction_curve(joint: friction.JointFriction) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return velocity, torque and half width of the 95 % band (V,) of a law, dense where it bends."""
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
    half_width = friction.CONFIDENCE * np.sqrt(np.maximum(variance, 0.0))
    return velocity, compute_friction_torque(law, inputs, linear, shape), half_width


def build_friction_figure(joint: friction.JointFriction) -> Drawing:
    """Return the figure of one joint: one curve, or one a direction where no row is near standstill."""
    (velocity, torque, half), measured = compute_friction_curve(joint), joint.velocity_map
    shown = np.concatenate([measured.cloud_torque, torque])
    # A band that is wider than all else must not squeeze it.
    bands = [np.clip(edge, shown.min(), shown.max()) for edge in (torque - half, torque + half)]
    kinds = (*(("95 % band", "fourth", band) for band in bands), ("law", "predicted", torque))
    cut = int(np.searchsorted(velocity, 0.0))
    pieces = [part for part in (slice(0, cut), slice(cut, None)) if len(velocity[part])]
    if measured.slowest <= _STILL * float(np.max(np.abs(velocity), initial=0.0)):
        pieces = [slice(None)]
    cloud, means = (measured.cloud_velocity, measured.cloud_torque), (measured.velocity, measured.torque)
    lines = [figures.Line("samples", "cloud", *cloud, joined=False)]
    for part in pieces:
        lines += [figures.Line(label, style, velocity[part], y[part]) for label, style, y in kinds]
    lines.append(figures.Line("mean of samples", "link", *means, markers=True, joined=False))
    return figures.build_curve_figure(
        f"Does the law follow the friction of {joint.joint}? Samples, their means over intervals of "
        f"velocity, and the law {joint.estimate.law} with its 95 % confidence band.",
        (f"velocity ({joint.velocity_unit})", f"friction ({joint.unit})"),
        lines,
        height=380.0,
    )


def build_friction_page(
    found: friction.FrictionIdentification,
    validations: Sequence[Validation] = (),
    **options: Any,  # noqa: ANN401  of `build_fit_page`
) -> pages.Page:
    """Return all that the page shows; `validations` are what laws and rigid part predict of logs.

    The other arguments are those of `build_identification_page`.
    """
    # What each law leaves: of held-out blocks where laws were compared, else of the fit.
    left = []
    for entry in found.joints:
        part: tuple[float, float | None, str, friction.JointFriction]
        part = (entry.residual.relative_percent, entry.residual.std, "the logs of the fit", entry)
        for trial in () if entry.selection is None else entry.selection.trials:
            if entry.selection and trial.law == entry.selection.chosen and trial.held_percent is not None:
                part = (trial.held_percent, trial.held_rms, "held-out blocks", entry)
                break
        left.append(part)
    _, rms, where, first = max(left, key=itemgetter(0))
    tried = _find_worst(validations)
    blocks: list[Block] = [*chain.from_iterable(map(_show_log, validations))]
    title = "Residual of law and rigid part in the logs of the fit."
    for entry in found.joints:
        blocks += [
            f"== {entry.joint}: {entry.estimate.law} ==",
            f"    {entry.formula}",
            *(() if entry is first and tried is None else (build_friction_figure(entry),)),
            pages.tabulate_parameters(entry.estimate.parameters, formulas=False),
            *pages.show_refused(entry.estimate.refused),
            pages.tabulate_residual((entry.residual,), title),
            *(() if entry.selection is None else (entry.selection.verdict,)),
        ]
    left_out = "\n".join(f"{name}: {reason}" for name, reason in found.refused)
    shares = [(entry.joint, percent) for percent, _, _, entry in left]
    whole = sum(percent for _, percent in shares) / len(shares)
    size = None if rms is None else (rms, first.unit)
    numbers, headline = (
        _tell_residual(where, whole, shares, rms=size) if tried is None else _tell_tried(tried)
    )
    parameters = [one for entry in found.joints for one in entry.estimate.parameters]
    return pages.build_fit_page(
        found,
        subject="identified friction",
        verdict=judge_friction(found, validations),
        headline=headline,
        numbers=[*numbers, pages.count_significant(parameters)],
        lead=build_friction_figure(first) if tried is None else _draw_worst(tried),
        blocks=(*blocks, *(["== Joints without a law ==", left_out] if left_out else [])),
        more=(
            *(block for entry in found.joints for block in _show_search(entry)),
            *chain.from_iterable(map(_show_errors, validations)),
        ),
        settings={"requested law": found.model, "estimator": found.estimator},
        **options,
    )


def _show_search(entry: friction.JointFriction) -> Iterator[Block]:
    """Yield how the law of a joint was found: phases of motion, rigid part, choice, poses, the search."""
    estimate = entry.estimate
    yield f"== {entry.joint}: how it was found =="
    yield from texts.show_motion((entry.motion,) if entry.motion is not None else ())
    yield f"{_capitalise(entry.rigid)}."
    yield (
        f"{_capitalise(estimate.outcome.value)}: {estimate.ended}; evaluations of the objective: "
        f"{estimate.evaluations}, linear problems: {estimate.solves}."
    )
    yield f"AICc {estimate.aicc:.5g}, BIC {estimate.bic:.5g}, condition number {estimate.condition:.3g}."
    if estimate.extra:
        yield from ("=== Rigid part ===", pages.tabulate_parameters(estimate.extra, formulas=False))
    if entry.selection is not None:
        yield from ("=== Choice of the law ===", texts.show_law_trials(entry.selection, _TRIALS))
    if entry.poses is not None:
        yield from ("=== Poses of the other joints ===", f"{_capitalise(entry.poses.verdict)}.")
        yield from texts.show_poses(entry.poses)
    history = [value for value in estimate.history if value > 0.0]
    if len(history) >= 3 and max(history) > _FLAT * min(history):
        number, markers = np.arange(float(len(history))), len(history) < 40
        line = figures.Line("objective", "final", number, np.array(history), markers)
        caption = "Did the search converge? Least objective after each iteration or generation."
        labels = ("iteration or generation", f"objective (({entry.unit})²)")
        yield figures.build_line_figure(caption, labels, (line,), logarithmic=True, whole=True)


def _capitalise(text: str) -> str:
    return text[:1].upper() + text[1:]


def judge_fit(estimate: AnyEstimate) -> FitVerdict:
    """Return what a fit is worth, judged by its own logs alone."""
    match estimate:
        case Estimate():
            return judge_identification(estimate, ())
        case elastic.ElasticEstimate():
            return judge_elastic(estimate, ())
        case friction.FrictionIdentification():
            return judge_friction(estimate)


def draw_fit(estimate: AnyEstimate) -> tuple[Drawing, ...]:
    """Return how certain the parameters are; of elastic joints the springs, of friction its curves."""
    match estimate:
        case elastic.ElasticEstimate():
            return tuple(draw_branches(entry) for entry in estimate.springs if entry.identifiable)
        case friction.FrictionIdentification():
            return tuple(map(build_friction_figure, estimate.joints))
    return pages.draw_certainty(estimate.parameters)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WrittenPage:
    """A page that was written.

    Args:
        file: where; robot: its name; verdict: the page's headline.
        sources: the logs tried; processing: how each was processed, where that was chosen; lines: in words.
        diagnosis: of the fit by its own logs, None where not asked for.
        notices: what a reader should know.
    """

    file: Path
    robot: str
    verdict: FitVerdict
    sources: tuple[str, ...] = ()
    processing: tuple[dict[str, object], ...] | None = None
    lines: tuple[str, ...] = ()
    diagnosis: Diagnosis | None = None
    notices: tuple[Notice, ...] = ()


def _suggest_step(
    estimate: AnyEstimate, level: str, stored: str, known: tuple[Robot, TaskContext] | None, *, tested: bool
) -> tuple[str, str]:
    """Return the command that an expert would type after a verdict, one that works, and what for."""
    name = estimate.file or (estimate.robot if estimate.robot in list_robots() else "ROBOT")
    name = name if known is None else name_for_commands(known[0])
    words = ["export", name, stored, "-o", f"{estimate.robot}_identified.toml"]
    why = "Write a robot file with these values"
    if level in {"wrong", "doubtful"}:
        words, why = ["check", name, *estimate.sources], "Look for the cause"
    elif not tested:
        words, why = ["validate", name, stored, "LOG"], "Test it on a log of another motion"
    elif isinstance(estimate, Estimate) and known is not None:
        # Its names are loaded on use: bodies need SymPy.
        identified = identification.build_identified(known[0], estimate, Path(stored))
        _, costs = identification.build_bodies(identified, known[1].prepare(identified.robot))
        if over := [entry.percent for entry in costs if entry.percent > entry.limit]:
            words += ["--limit", f"{0.1 * math.ceil(10.0 * max(over)):.3g}"]
            why += f", in the nearest bodies: they change the torque of a joint by up to {max(over):.2g} %; "
            why += "identify by --estimator consistent for values that bodies have"
    return shlex.join(["symid", *words]), why


def write_fit_page(
    path: Path,
    estimate: AnyEstimate,
    known: tuple[Robot, TaskContext] | None = None,
    *,
    logs: Sequence[Path | Recording] = (),
    pairs: tuple[tuple[str, str], ...] = (),
    test: Sequence[LogPart] = (),
    diagnose: bool = False,
    file: str = "",
    heading: Mapping[str, Any] | None = None,
) -> WrittenPage:
    """Write the page of a fit of any kind.

    `known` are the robot as read, which is drawn, and what long work with it needs, which logs and diagnosis
    take; `logs` are held out, files or what was read from them, and `test` parts of them, one for all or one
    for each; `pairs` are settings of the call, `diagnose` says whether the logs of the fit are read again,
    `file` is that of the estimate, for messages, and `heading` holds title, author and date of the page.

    Raises:
        UsageError: there are settings or parts and no logs, or the kind of fit has no such logs, setting or
            diagnosis.
        EstimateError: the estimate is of another model.
        LogError: a log does not fit the robot.
        OutputError: the page cannot be written.
    """
    if (pairs or test) and not logs:
        text = "settings apply to the logs of a validation, and none was given; give a log or leave them out"
        part = "is a part of the logs of a validation, and none was given; give a log"
        text = text if pairs else f"--test {test[0].text}: {part}"
        raise UsageError(Notice(code="usage.no-validation", text=text))
    if diagnose and not isinstance(estimate, Estimate):
        text = "--diagnose needs an estimate of base parameters; leave it out"
        raise UsageError(Notice(code="usage.no-diagnosis", text=text, file=file))
    validations, trials = list[Validation](), tuple[elastic.ElasticTrial, ...]()
    diagnosis, notices, origin = None, tuple[Notice, ...](), tuple[str, ...]()
    if isinstance(estimate, elastic.ElasticEstimate):
        elastic.check_settings(pairs, "elastic")
    if known is not None and (logs or diagnose):
        robot, context = known
        described = restore_robot(robot, estimate, pairs)
        if isinstance(estimate, Estimate):
            # What was identified as rigid is tried as rigid, whatever the robot file says of its joints.
            rigid = elastic.build_rigid_estimate(estimate, described)
            described = elastic.build_rigid_variant(described)
        recordings = take_parts(read_recordings(logs, described), test, "--test")
        if not isinstance(estimate, friction.FrictionIdentification):
            library = context.prepare(described)
            notices = (*described.notices, *library.notices)
            for recording in recordings:
                notices += (*recording.notices, *check_recording(recording, described))
            origin = pages.describe_origin(described, library, recordings)
        match estimate:
            case Estimate():
                check_model(rigid, library.card, file)
                notices += warn_of_other_bodies(rigid, described, library.card, file)
                overlap = get_fit_overlap(rigid.settings)
                for recording in recordings:
                    context.progress(f"validating on {recording.source}")
                    # In the rows of the fit: residuals of one kind can be compared.
                    window, longer = get_usable_window(rigid.settings, recording)
                    options: Any = {"rows": rigid.rows, "window": window, "overlap": overlap}
                    found = validate_estimate(rigid, library, recording, described.processing, **options)
                    validations.append(replace(found, notices=(*longer, *found.notices)))
                if diagnose:
                    diagnosis = diagnose_fit(robot, estimate, context)
                    notices += diagnosis.notices
                notices += tuple(notice for entry in validations for notice in entry.notices)
            case elastic.ElasticEstimate():
                check_model(estimate, library.card, file)
                notices += warn_of_other_bodies(estimate, described, library.card, file)
                context.progress(f"trying the model on {len(recordings)} log{'s'[: len(recordings) > 1]}")
                kept = elastic.cut_logs(recordings, described.processing)
                moved, _, aligned = elastic.prepare_aligned(library, kept)
                cut = (notice for entry in kept for notice in entry.notices if notice.code == "log.cut")
                notices += (*aligned, *(notice for notice in cut if notice not in notices))
                limit: Any = {"cutoff": elastic.get_stated_cutoff(described, pairs)}
                trials = tuple(elastic.evaluate_elastic(estimate, library, e, **limit) for e in moved)
            case friction.FrictionIdentification():
                given: Any = {"pairs": pairs, "file": file}
                tried = [validate_fit(robot, estimate, entry, context, **given) for entry in recordings]
                validations = [entry.validation for entry in tried if isinstance(entry, FrictionValidation)]
                notices = tuple(dict.fromkeys(notice for entry in tried for notice in entry.notices))
    told: Any = {"notices": notices, "origin": origin}
    match estimate:
        case Estimate():
            page = build_identification_page(estimate, validations, diagnosis=diagnosis, **told)
        case elastic.ElasticEstimate():
            page = build_elastic_page(estimate, trials, **told)
        case friction.FrictionIdentification():
            page = build_friction_page(estimate, validations, **told)
    tests: tuple[Validation | elastic.ElasticTrial, ...] = (*validations, *trials)
    own = all(entry.fitted for entry in tests)
    step = _suggest_step(estimate, page.verdict.level, file or "ESTIMATE", known, tested=not own)
    # In the middle of the logs, where no joint hides another as it may at zero.
    evidence = estimate.evidence if isinstance(estimate, Estimate) else None
    middle = {} if evidence is None else {e.joint: 0.5 * (e.low + e.high) for e in evidence.covered}
    drawn = None if known is None else draw_robot(known[0], middle)
    page = replace(page, next_step=step, second=drawn, **(heading or {}))
    is_rigid = isinstance(estimate, Estimate)
    settled = [(entry.source, entry.processing) for entry in validations if is_rigid and entry.processing]
    processing = tuple({**asdict(entry.processing), "origin": dict(entry.origin)} for _, entry in settled)
    return WrittenPage(
        file=pages.write_page(path, page),
        robot=page.robot,
        verdict=page.verdict,
        sources=tuple(entry.source for entry in tests),
        processing=processing if is_rigid else None,
        lines=tuple(f"{source}: {entry.describe()}" for source, entry in settled),
        diagnosis=diagnosis,
        notices=notices,
    )
