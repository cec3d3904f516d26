"""The page of an elastic identification.

`ElasticEstimate`, what it predicts of logs, motions with its feed-forward -> `Page`; sections without data
are left out.

Not supported: uncertainties of single stops: they are strongly correlated with their neighbours.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, cycle, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from symid import joint_models
from symid.arrays import FloatArray
from symid.identification.elastic import ElasticEstimate, ElasticTrial, JointTrial, SpringEstimate
from symid.report import blocks, figures, pages
from symid.report.blocks import Block, Drawing, Table
from symid.report.texts import show_effects, show_laws
from symid.report.verdict import compute_spring_share, judge_elastic

if TYPE_CHECKING:
    from symid.identification.elastic import TrackingRun

_PREDICTION = (
    "The prediction error is the mean square of the held-out torque residual in units of the noise: 1 is the "
    "noise floor."
)
_IN_FIT = "in the logs of the fit"
_SAMPLES = 400
"""Of each branch of a figure."""
_TURNS = (0.6, -0.3, 0.45, -0.1, 0.3)
"""Where the nested loops of the figure turn, in parts of the amplitude."""


def build_elastic_page(
    estimate: ElasticEstimate,
    trials: Sequence[ElasticTrial] = (),
    *,
    iterated: ElasticEstimate | None = None,
    tracking: "Sequence[TrackingRun]" = (),
    **options: Any,  # noqa: ANN401  of `build_fit_page`
) -> pages.Page:
    """Return all that the page shows.

    `trials` are what the estimate predicts of logs, held out or not; iterations of `iterated`, from the same
    logs, are shown where the result has none; `tracking` are motions with several feed-forwards.
    """
    refused = {name for name, _ in estimate.refused}
    kept = [entry for entry in estimate.parameters if entry.name not in refused]
    if not estimate.covariance:
        kept = [replace(entry, std=math.inf) for entry in kept]
    springs = [entry for entry in estimate.springs if entry.identifiable]
    # The loops of the first joint in a held-out log lead, or else its identified spring.
    led = [trial.joints[0] for trial in trials if not trial.fitted and trial.joints]
    return pages.build_fit_page(
        estimate,
        subject="identified dynamics and springs",
        verdict=judge_elastic(estimate, trials),
        numbers=_list_numbers(estimate, trials),
        lead=draw_loops(led[0]) if led else draw_branches(springs[0]) if springs else None,
        blocks=(
            *_show_trials(trials),
            *(("== Springs ==",) if springs else ()),
            *(block for entry in springs for block in show_spring(entry)),
            *("== Parameters ==", pages.tabulate_parameters(kept, simulated=estimate.simulated)),
            *pages.draw_certainty(kept),
            *pages.show_refused(estimate.refused),
            *(("== Drives and sensors ==", show_effects(estimate)) if estimate.effects else ()),
            *(_show_tracking(estimate, tracking) if tracking else ()),
            *(() if trials else ("== Held-out logs ==", pages.UNTESTED)),
        ),
        more=(
            *show_laws(estimate.laws),
            *("== Methods ==", f"{estimate.reason[:1].upper()}{estimate.reason[1:]}."),
            *_compare_methods(estimate),
            # A result without iterations shows those of another method.
            *_show_convergence(iterated if iterated and len(estimate.history) < 2 else estimate),
            *_show_errors(trials),
            "== Residual of the fit ==",
            pages.tabulate_residual(
                estimate.residual, f"Motor torque by motor dynamics and springs, {_IN_FIT}."
            ),
            pages.tabulate_residual((estimate.energy,), f"Energy over windows, {_IN_FIT}."),
            *("== What each parameter groups ==", *pages.show_groupings(kept)),
        ),
        settings={
            "method of the result": estimate.method,
            "outcome": estimate.outcome.value,
            "samples fitted": sum(entry.samples for entry in estimate.residual),
            "condition number (column-scaled)": f"{estimate.condition:.4g}",
        },
        conventions="torsion is motor minus link position; torques and inertias are on the joint side",
        **options,
    )


def _list_numbers(estimate: ElasticEstimate, trials: Sequence[ElasticTrial]) -> list[tuple[str, str]]:
    """Return the numbers that matter: what dynamics and springs leave of torques, and what is significant."""
    held_out = [trial for trial in trials if not trial.fitted]
    told = {spring.joint for spring in estimate.springs if spring.identifiable}
    if held_out:
        dynamics = max(entry.relative_percent for trial in held_out for entry in trial.residuals[0][1])
        springs = [compute_spring_share(joint) for trial in held_out for joint in trial.joints]
        where = "in the held-out log"
    elif estimate.evidence is not None:
        dynamics, where = max(estimate.evidence.held_out), "cross-validated"
        pairs = zip(estimate.evidence.springs, estimate.residual, strict=False)
        springs = [share for share, entry in pairs if entry.joint in told]
    else:
        dynamics, where = max(entry.relative_percent for entry in estimate.residual), _IN_FIT
        springs = []
    numbers = [(blocks.format_percent(dynamics), f"residual of a motor's torque at most, {where}")]
    if springs and all(share is not None for share in springs):
        worst = max(share for share in springs if share is not None)
        numbers.append((blocks.format_percent(worst), "residual of a spring, of its joint's torque, at most"))
    if estimate.covariance:
        numbers.append(pages.count_significant(estimate.parameters))
    return numbers


def _show_trials(trials: Sequence[ElasticTrial]) -> Iterator[Block]:
    for trial in trials:
        yield f"== Hysteresis loops: {trial.source} =="
        what = "A log of the fit: this is no test." if trial.fitted else "Held out: not used in the fit."
        yield f"{what} Torques and torsions passed the same filter."
        for joint in trial.joints:
            yield f"=== {joint.joint} ==="
            yield draw_loops(joint)
            yield draw_loops(joint, opened=True)
        yield from (pages.tabulate_residual(lines, text) for text, lines in trial.residuals)


def _show_errors(trials: Sequence[ElasticTrial]) -> Iterator[Block]:
    for trial in trials:
        yield f"== Residual of {trial.source} =="
        for joint in (joint for joint in trial.joints if joint.final is not None):
            label, linear = _get_linear_torque(joint)
            curves = ((label, "initial", linear), ("identified", "final", joint.final))
            known = [(name, style, y) for name, style, y in curves if y is not None]
            errors = [figures.Line(name, style, joint.time, joint.motor - y) for name, style, y in known]
            caption = f"When does the spring miss? Joint torque of {joint.joint} less that of the spring."
            yield figures.build_line_figure(caption, (figures.TIME, f"difference ({joint.unit})"), errors)


def draw_loops(entry: JointTrial, *, opened: bool = False) -> Drawing:
    """Return the joint torque over torsion, or, opened, less the straight line that fits it best."""
    slope = entry.straight if opened else 0.0
    axis = f"joint torque ({entry.unit})"
    caption = f"Joint torque of {entry.joint} against torsion: measured, by the identified spring, and the "
    caption += "truth where it is known. The area of a loop is the energy lost."
    if opened:
        stiffness = f"{entry.straight:.4g} {entry.unit}/{entry.torsion_unit}"
        axis = f"torque less {stiffness} \N{MULTIPLICATION SIGN} torsion ({entry.unit})"
        caption = f"The loops of {entry.joint} less {stiffness} times the torsion, which opens them."
    name, linear = _get_linear_torque(entry)
    lines = figures.list_lines(
        entry.torsion,
        ("truth", "truth", entry.truth),
        ("measured, motor side", "measured", entry.motor),
        ("measured, link side", "link", entry.link),
        (name, "initial", linear),
        # The last line lies on top.
        ("identified", "final", entry.final),
    )
    lines = [replace(line, x=1e3 * line.x, y=line.y - slope * line.x) for line in lines]
    return figures.build_curve_figure(caption, (f"torsion (m{entry.torsion_unit})", axis), lines)


def _get_linear_torque(entry: JointTrial) -> tuple[str, FloatArray]:
    """Return the torque by the linear spring of the start, or else by the one that fits this log best."""
    if entry.initial is not None:
        return "linear start", entry.initial
    return "best linear spring", entry.straight * entry.torsion


def show_spring(estimate: SpringEstimate) -> Iterator[Block]:
    """Yield what the page shows of one joint's spring; all its stiffnesses must be known."""
    torsion, unit = estimate.position_unit, estimate.torque_unit
    yield f"=== {estimate.joint} ==="
    # How far it was turned in the logs, and which parts of it are not identifiable.
    shown, reach = f"m{torsion}", f"torque {estimate.torque:.4g} {unit}"
    yield f"Torsion reached {1e3 * estimate.torsion:.4g} {shown} in the logs, {reach}."
    held = [stop.threshold for stop in estimate.elasticity.stops if stop.threshold > estimate.excited]
    if held:
        first = f"{1e3 * min(held):.4g} {shown}"
        yield f"Stops from {first} on never slipped: their stiffness cannot be separated from k0."
    true = estimate.truth
    stops = () if true is None else true.stops
    hidden = [stop.threshold for stop in stops if stop.threshold > estimate.torsion]
    if hidden:
        first = f"{1e3 * min(hidden):.4g} {shown}"
        yield f"True stops from {first} on never slipped: their stiffness is a part of k0 here."
    far = [knee.threshold for knee in estimate.elasticity.knees if abs(knee.threshold) > estimate.torque]
    if far:
        names = ", ".join(blocks.write_minus(f"{value:.3g}") for value in far)
        yield f"The torque never reached the knees at {names} {unit}: the slope beyond is not identifiable."
    if not (estimate.elasticity.stops or estimate.elasticity.branches):
        yield "No stop has any stiffness: the identified spring has no hysteresis."
    yield draw_branches(estimate)
    yield _tabulate_spring(estimate)
    if estimate.torque_std is not None and estimate.slope_std is not None:
        place = "at its steepest" if estimate.elasticity.branches else "near zero"
        yield (
            f"Standard deviations: {estimate.slope_std:.2g} {unit}/{torsion} of the slope {place}, "
            f"{estimate.torque_std:.2g} {unit} (rms) of the torque in the logs."
        )
    slips, knees = _list_stops(estimate.elasticity), _list_knees(estimate.elasticity)
    if slips:
        header = (f"threshold (m{torsion})", f"stiffness ({unit}/{torsion})", f"slips at ({unit})")
        yield Table(header, slips, title="Stops: springs behind dry friction.")
    if knees:
        text = "Knees: beyond these torques the spring is stiffer or softer, by this total factor."
        yield Table((f"torque ({unit})", "slope beyond"), knees, title=text)
    if true is not None and not true.is_plain:
        kinds = [f"a branch {branch.kind.replace('_', '-')}" for branch in true.branches]
        kinds += [text for text, value in (("backlash", true.backlash), ("an offset", true.offset)) if value]
        yield f"The true spring of the robot file has {', '.join(kinds)}, which stops and knees imitate."
    elif true is not None:
        places = [f"{value} {unit}/{torsion} at {place} m{torsion}" for place, value, _ in _list_stops(true)]
        bends = [f"{slope} beyond {place} {unit}" for place, slope in _list_knees(true)]
        yield f"True stops: {', '.join(places) or 'none'}."
        yield f"True slopes: {', '.join(bends) or '1'}."


def _list_stops(spring: joint_models.Elasticity) -> tuple[tuple[str, str, str], ...]:
    known = [(stop.threshold, stop.stiffness) for stop in spring.stops if stop.stiffness is not None]
    return tuple((f"{1e3 * place:.4g}", f"{k:.4g}", f"{k * place:.3g}") for place, k in known)


def _list_knees(spring: joint_models.Elasticity) -> tuple[tuple[str, str], ...]:
    """Return the torque of every knee, and the slope of the outer function beyond it."""
    result = []
    for side in (-1.0, 1.0):
        slope = 1.0
        for knee in sorted(spring.knees, key=lambda knee: knee.threshold * side):
            if knee.threshold * side > 0.0:
                slope += knee.slope
                result.append((knee.threshold, slope))
    return tuple((blocks.write_minus(f"{torque:.4g}"), f"{slope:.4g}") for torque, slope in sorted(result))


def _choose_amplitude(estimate: SpringEstimate) -> float:
    """Return how far the spring is turned for figures and cycles: as far as the logs did."""
    last = max((stop.threshold for stop in estimate.elasticity.stops), default=0.0)
    return estimate.torsion or 1.25 * last or 0.01


def _tabulate_spring(estimate: SpringEstimate) -> Table:
    """Return quantities that can be compared between springs with different thresholds."""
    amplitude, spring, true = _choose_amplitude(estimate), estimate.elasticity, _get_traceable(estimate)
    stiffness = f"{estimate.torque_unit}/{estimate.position_unit}"
    found = _measure_spring(spring, amplitude)
    known = () if true is None else _measure_spring(true, amplitude)
    reach = f"\N{PLUS-MINUS SIGN}{1e3 * amplitude:.4g} m{estimate.position_unit}"
    names = (
        ("stiffness k0 once all stops slip", stiffness),
        ("stiffness right after a reversal", stiffness),
        (f"torque over torsion at {reach}", stiffness),
        (f"energy lost in a cycle of {reach}", "J"),
    )
    rows: list[tuple[object, ...]] = []
    for index, (name, unit) in enumerate(names):
        beside = [(f"{one:.4g}", pages.format_error(found[index], one)) for one in known[index : index + 1]]
        rows.append((name, f"{found[index]:.4g}", *chain(*beside), unit))
    extra = (
        ("cubic stiffness", spring.cubic, f"{stiffness}\N{SUPERSCRIPT THREE}"),
        ("damping", spring.damping, f"{estimate.torque_unit} s/{estimate.position_unit}"),
    )
    rows += [(name, f"{x:.4g}", *(("", "") if known else ()), unit) for name, x, unit in extra if x]
    header = ("quantity", "value", *(("truth", "error") if known else ()), "unit")
    return Table(header, rows, (0, len(header) - 1), "Values that do not depend on the chosen thresholds.")


def _measure_spring(spring: joint_models.Elasticity, amplitude: float) -> tuple[float, float, float, float]:
    """Return k0, k0 + sum k_i, the secant stiffness at `amplitude`, and the loss of a cycle in J."""
    # The second cycle is closed: the first one begins on the virgin curve.
    path = _sweep_torsion(amplitude, -amplitude, amplitude)
    if not spring.is_plain:
        torque = joint_models.run_element(spring, path).output
        steepest, cycle = joint_models.find_most_slope(spring), slice(_SAMPLES, None)
        lost = float(scipy.integrate.trapezoid(torque[cycle], path[cycle]))
        return spring.stiffness or 0.0, steepest, float(torque[_SAMPLES]) / amplitude, lost
    first = float(joint_models.compute_hysteresis_torque(spring, np.array([amplitude]))[0])
    work = joint_models.compute_spring_work(spring, path) if not (spring.cubic and spring.knees) else None
    loss = float(work[-1] - work[_SAMPLES]) if work is not None else float("nan")
    return spring.stiffness or 0.0, spring.initial_stiffness or 0.0, first / amplitude, loss


def _get_traceable(estimate: SpringEstimate) -> joint_models.Elasticity | None:
    """Return the true spring; None where it is not known, or its torque depends on the speed of a sweep."""
    true = estimate.truth
    timed = true is not None and not true.is_plain and joint_models.needs_time(replace(true, damping=0.0))
    return None if timed else true


def draw_branches(estimate: SpringEstimate) -> Drawing:
    """Return first curve, outer loop, nested loops, all by the spring's own memory."""
    amplitude = _choose_amplitude(estimate)
    whole = _sweep_torsion(*(amplitude * turn for turn in (1.0, -1.0, 1.0, *_TURNS, 1.0)))
    torque = joint_models.run_element(replace(estimate.elasticity, damping=0.0), whole).output
    pieces = (
        ("nested loops", "minor", slice(3 * _SAMPLES, None)),
        ("outer loop", "major", slice(_SAMPLES, 3 * _SAMPLES + 1)),
        ("first curve", "virgin", slice(0, _SAMPLES + 1)),
    )
    lines = [figures.Line(label, style, 1e3 * whole[piece], torque[piece]) for label, style, piece in pieces]
    true = _get_traceable(estimate)
    if true is not None:
        path = _sweep_torsion(amplitude, -amplitude, amplitude)
        torque = joint_models.run_element(replace(true, damping=0.0), path).output
        lines.insert(0, figures.Line("true outer loop", "truth", 1e3 * path[_SAMPLES:], torque[_SAMPLES:]))
    return figures.build_curve_figure(
        f"The identified spring of {estimate.joint}: first curve from rest, outer loop, nested loops.",
        (f"torsion (m{estimate.position_unit})", f"joint torque ({estimate.torque_unit})"),
        lines,
    )


def _sweep_torsion(*turns: float) -> FloatArray:
    """Return torsions from zero to each of `turns`, `_SAMPLES` steps a way."""
    parts = [np.linspace(start, end, _SAMPLES + 1)[1:] for start, end in pairwise((0.0, *turns))]
    return np.concatenate([np.zeros(1), *parts])


def _compare_methods(estimate: ElasticEstimate) -> Iterator[Block]:
    trials = estimate.trials
    if len(trials) < 2:
        return
    truth = [entry.truth if estimate.simulated else None for entry in estimate.parameters]
    measures = {"prediction error (noise = 1)": [trial.error for trial in trials]}
    known = [place for place, true in enumerate(truth) if true]
    if known and all(len(trial.values) == len(truth) for trial in trials):
        values = np.array([trial.values for trial in trials])[:, known]
        true = np.array([truth[place] for place in known], dtype=np.float64)
        errors = 100.0 * np.max(np.abs(values / true - 1.0), axis=1)
        measures["largest error of a parameter (%)"] = errors.tolist()
    picked = next((k for k, trial in enumerate(trials) if trial.method == estimate.method), None)
    names = [f"{trial.method}{' (chosen)' * (trial.method == estimate.method)}" for trial in trials]
    columns = [
        ["\N{EN DASH}" if x is None else f"{x:.4g}" if math.isfinite(x) else "failed" for x in scores]
        for scores in measures.values()
    ]
    yield _PREDICTION
    rows = tuple(zip(names, *columns, (trial.outcome.value for trial in trials), strict=True))
    header, left = ("method", *measures, "outcome"), (0, len(measures) + 1)
    yield Table(header, rows, left, "Methods on the same logs. Less is better.", picked=picked)


def _show_convergence(estimate: ElasticEstimate) -> Iterator[Block]:
    """Yield the course of the iterations; nothing where there are fewer than two."""
    history = estimate.history
    finite = [entry for entry in history if np.isfinite([entry.merit, entry.change, *entry.norms]).all()]
    if len(finite) < 2:
        return
    heads = ["energy equations (J)", *(f"{entry.joint} ({entry.unit})" for entry in estimate.residual)]
    heads = heads if all(len(entry.norms) == len(heads) for entry in finite) else []
    yield "== Convergence =="
    yield f"{len(history)} iterations of {estimate.method}, {estimate.outcome.value}."
    number = np.arange(1.0, len(finite) + 1.0)
    # Norms relative to their first values, so that units do not matter.
    norms = np.array([entry.norms[: len(heads)] for entry in finite])
    courses = (
        (
            "Merit and relative change of the parameters, by iteration.",
            "merit, change (1)",
            {"merit": [entry.merit for entry in finite]}
            | {"relative change of the parameters": [entry.change for entry in finite]},
        ),
        (
            "Norms of the residuals relative to the first iteration.",
            "norm / first norm",
            {head: y / y[0] for head, y in zip(heads, norms.T, strict=True) if y[0] > 0.0},
        ),
    )
    for place, (caption, label, curves) in enumerate(courses):
        styled = zip(curves.items(), cycle(figures.STYLES), strict=False)
        lines = [
            figures.Line(name, style, number, np.array(y), markers=True)
            for (name, y), style in styled
            if np.any(np.array(y) > 0.0)
        ]
        if lines:
            labels = ("iteration", label)
            yield figures.build_line_figure(caption, labels, lines, logarithmic=not place, whole=True)
    rows = list[Sequence[object]]()
    for place, entry in enumerate(history, start=1):
        shown = (f"{norm:.5g}" for norm in (entry.norms if heads else ()))
        rows.append((place, f"{entry.merit:.6g}", f"{entry.change:.2e}", f"{entry.damping:g}", *shown))
    header = ("iteration", "merit", "relative change", "damping", *heads)
    yield Table(header, rows, title="Every iteration, with the norms of its residuals.")


def _show_tracking(estimate: ElasticEstimate, runs: "Sequence[TrackingRun]") -> Iterator[Block]:
    joints = [(entry.joint, "m" if entry.unit == "N" else "rad") for entry in estimate.residual]
    rows = [(run.name, *(f"{1e3 * value:.4g}" for value in run.rms.tolist())) for run in runs]
    header = ("feed-forward", *(f"{name} (m{unit})" for name, unit in joints))
    yield "== Tracking =="
    yield Table(header, rows, title="RMS tracking error of the links (reached minus desired position).")
    for index, (name, unit) in enumerate(joints):
        styled = zip(runs, cycle(figures.STYLES), strict=False)
        lines = [figures.Line(run.name, style, run.time, 1e3 * run.error[:, index]) for run, style in styled]
        caption = f"Tracking error of {name} with every feed-forward."
        yield figures.build_line_figure(caption, (figures.TIME, f"tracking error (m{unit})"), lines)
