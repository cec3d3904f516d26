"""The page of an elastic identification.

`ElasticEstimate`, what it predicts of logs, motions with its feed-forward -> `Page` with verdict, hysteresis
loops, springs, parameters, methods, convergence, tracking, residuals, settings.

Loops show the joint torque against its torsion, measured and by the springs; springs show their numbers,
their branches, and what was not excited, with the truth beside them where it is known.

Supported: springs with stops and knees, cubic parts, damping. Sections without data are left out.
Not supported: uncertainties of single stops: they trade with their neighbours.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.identification.elastic import (
    ElasticEstimate,
    ElasticTrial,
    HistoryEntry,
    JointTrial,
    SpringEstimate,
)
from symid.joint_models import compute_first_curve, compute_hysteresis_torque, compute_spring_work
from symid.report.blocks import Block, Drawing, Table
from symid.report.figures import (
    STYLES,
    Interval,
    Line,
    build_curve_figure,
    build_interval_figure,
    build_line_figure,
)
from symid.report.fit_text import show_residual
from symid.report.pages import (
    Page,
    format_error,
    list_notices,
    list_origin,
    list_settings,
    show_refused,
    tabulate_parameters,
)
from symid.report.verdict import judge_elastic
from symid.robot import Elasticity

if TYPE_CHECKING:
    from symid.identification.elastic import TrackingRun

_LOOPS = (
    "Joint torque against torsion: measured, by the springs, and the truth where it is known. Time runs "
    "clockwise round a loop; its area is energy lost."
)
_BRANCHES = "The identified spring by its own memory: first curve from rest, outer loop, loops nested in it."
_PREDICTION = (
    "The prediction error is the mean square of torques that were left out of the fit, less what it says of "
    "them, in units of the noise: noise alone would leave 1."
)
_SAMPLES = 400
"""Of each branch of a figure."""
_TURNS = (0.6, -0.3, 0.45, -0.1, 0.3)
"""Where the nested loops of the figure turn, in parts of the amplitude."""


def build_elastic_page(
    estimate: ElasticEstimate,
    trials: Sequence[ElasticTrial] = (),
    notices: Sequence[Notice] = (),
    origin: Sequence[str] = (),
    *,
    iterated: ElasticEstimate | None = None,
    tracking: "Sequence[TrackingRun]" = (),
) -> Page:
    """Return all that the page shows.

    Args:
        estimate: of dynamics and springs.
        trials: what it says of logs, held out or not.
        notices: what else a reader should know: of the robot, its library, and the recordings.
        origin: what the page was made from, in short texts.
        iterated: another estimate from the same logs, whose iterations are shown where the result has none.
        tracking: motions with several feed-forwards.
    """
    refused = {name for name, _ in estimate.refused}
    kept = [entry for entry in estimate.parameters if entry.name not in refused]
    if not estimate.covariance:
        kept = [replace(entry, std=math.inf) for entry in kept]
    head = (
        ("method of the result", estimate.method),
        ("outcome", estimate.outcome.value),
        ("logs", ", ".join(estimate.sources)),
        ("rows fitted", str(sum(entry.samples for entry in estimate.residual))),
        ("condition of the scaled matrix", f"{estimate.condition:.4g}"),
        ("signature of the model", estimate.signature),
    )
    springs = [entry for entry in estimate.springs if entry.told]
    # What has no iterations of its own shows those of another method.
    course = iterated if iterated is not None and len(estimate.history) < 2 else estimate
    return Page(
        robot=estimate.robot,
        subject="identified dynamics and springs",
        verdict=judge_elastic(estimate, trials),
        blocks=(
            *_show_trials(trials),
            *(("== Springs ==",) if springs else ()),
            *(block for entry in springs for block in show_spring(entry)),
            *("== Parameters ==", tabulate_parameters(kept), *show_refused(estimate.refused)),
            *("== Methods ==", f"{estimate.reason[:1].upper()}{estimate.reason[1:]}."),
            *_compare_methods(estimate),
            *_show_convergence(course),
            *(_show_tracking(estimate, tracking) if tracking else ()),
            "== Residual of the fit ==",
            show_residual(
                estimate.residual,
                "Torque of the motors by their own dynamics and the springs, in the logs of the fit.",
            ),
            show_residual((estimate.energy,), "Energy over windows, in the logs of the fit."),
        ),
        settings=head + tuple(list_settings(estimate.settings)),
        notices=list_notices((*estimate.notices, *notices)),
        origin=list_origin(origin),
        conventions="torsion is motor less link position, torques and inertias are those of the joint side",
    )


def _show_trials(trials: Sequence[ElasticTrial]) -> Iterator[Block]:
    """Yield loops and residuals log by log."""
    if not trials:
        yield "== Hysteresis loops =="
        yield (
            "No held-out log was given. A model that has only met the logs it was fitted to is not tested: "
            "give another motion with --validation."
        )
    for trial in trials:
        caption = (
            "A log of the fit: this is no test." if trial.fitted else "Held out: nothing was fitted here."
        )
        yield f"== Hysteresis loops: {trial.source} =="
        yield f"{caption} Torques and torsions passed the same filter, so that no loop comes from it."
        for joint in trial.joints:
            yield f"=== {joint.joint} ==="
            yield Drawing(draw_loops(joint), _LOOPS)
            yield Drawing(
                draw_loops(joint, opened=True),
                "The same loops without their common slope, so that they open.",
            )
            if joint.final is not None:
                text = "What the springs leave of the measured joint torque."
                yield Drawing(_draw_spring_error(joint, joint.final), text)
        yield from (show_residual(lines, text) for text, lines in trial.residuals)


def draw_loops(entry: JointTrial, *, opened: bool = False) -> str:
    """Return the joint torque over torsion, or, opened, less the straight line that fits it best."""
    unit, slope = entry.unit, entry.straight if opened else 0.0
    stiffness = f"{entry.straight:.4g} {unit}/{entry.torsion_unit}"
    title = f"{entry.joint}: hysteresis loops"
    description = (
        f"Joint torque of {entry.joint} in {unit} against its torsion: measured from the motor, from the "
        "link, and by the springs."
    )
    label = f"joint torque ({unit})"
    if opened:
        title += ", opened"
        description = (
            f"Joint torque of {entry.joint} less {stiffness} times its torsion, against its torsion."
        )
        label = f"torque less {stiffness} \N{MULTIPLICATION SIGN} torsion ({unit})"
    name, linear = _get_linear_torque(entry)
    # What is to lie on top stands last.
    ways = (
        ("truth", "truth", entry.truth),
        ("measured, motor side", "measured", entry.motor),
        ("measured, link side", "link", entry.link),
        (name, "initial", linear),
        ("identified", "final", entry.final),
    )
    lines = [
        Line(label=name, style=style, x=1e3 * entry.torsion, y=values - slope * entry.torsion)
        for name, style, values in ways
        if values is not None
    ]
    return build_curve_figure(title, description, (f"torsion (m{entry.torsion_unit})", label), lines)


def _get_linear_torque(entry: JointTrial) -> tuple[str, FloatArray]:
    """Return the torque by the linear spring of the start, or else by the one that fits this log best."""
    if entry.initial is not None:
        return "linear start", entry.initial
    return "best linear spring", entry.straight * entry.torsion


def _draw_spring_error(entry: JointTrial, final: FloatArray) -> str:
    label, linear = _get_linear_torque(entry)
    lines = [
        Line(label=label, style="initial", x=entry.time, y=entry.motor - linear),
        Line(label="identified", style="final", x=entry.time, y=entry.motor - final),
    ]
    return build_line_figure(
        f"{entry.joint}: what the spring leaves",
        f"Joint torque of {entry.joint} by the motor equation less that of the springs, in {entry.unit}.",
        ("time (s)", f"difference ({entry.unit})"),
        lines,
    )


def show_spring(estimate: SpringEstimate) -> Iterator[Block]:
    """Yield what the page shows of one joint's spring; all its stiffnesses must be known."""
    torsion, unit = estimate.position_unit, estimate.torque_unit
    yield f"=== {estimate.joint} ==="
    yield from _describe_reach(estimate)
    yield Drawing(draw_branches(estimate), _BRANCHES)
    yield _tabulate_spring(estimate)
    stops, knees = _list_stops(estimate.elasticity), _list_knees(estimate.elasticity)
    if stops:
        header = (f"threshold (m{torsion})", f"stiffness ({unit}/{torsion})", f"slips at ({unit})")
        yield Table(header, stops, title="Stops: springs behind dry friction.")
    if knees:
        text = "Knees: from these torques on the spring is harder or softer, by this factor in all."
        yield Table((f"torque ({unit})", "slope beyond"), knees, title=text)
    if estimate.truth is not None:
        places = [
            f"{value} {unit}/{torsion} at {place} m{torsion}"
            for place, value, _ in _list_stops(estimate.truth)
        ]
        bends = [f"{slope} beyond {place} {unit}" for place, slope in _list_knees(estimate.truth)]
        yield f"True stops: {', '.join(places) or 'none'}."
        yield f"True slopes: {', '.join(bends) or '1'}."


def _list_stops(spring: Elasticity) -> tuple[tuple[str, str, str], ...]:
    """Return threshold, stiffness, and torque at which it slips, of every stop."""
    return tuple(
        (f"{1e3 * stop.threshold:.4g}", f"{stop.stiffness:.4g}", f"{stop.stiffness * stop.threshold:.3g}")
        for stop in spring.stops
        if stop.stiffness is not None
    )


def _list_knees(spring: Elasticity) -> tuple[tuple[str, str], ...]:
    """Return the torque of every knee, and the slope of the outer function beyond it."""
    result = []
    for side in (-1.0, 1.0):
        slope = 1.0
        knees = [knee for knee in spring.knees if knee.threshold * side > 0.0]
        for knee in sorted(knees, key=lambda knee: knee.threshold * side):
            slope += knee.slope
            result.append((knee.threshold, slope))
    return tuple((_write_minus(f"{torque:.4g}"), f"{slope:.4g}") for torque, slope in sorted(result))


def _choose_amplitude(estimate: SpringEstimate) -> float:
    """Return how far the spring is turned for figures and cycles: as far as the logs did."""
    last = max((stop.threshold for stop in estimate.elasticity.stops), default=0.0)
    return estimate.torsion or 1.25 * last or 0.01


def _tabulate_spring(estimate: SpringEstimate) -> Table:
    """Return what can be compared between springs of other thresholds."""
    amplitude = _choose_amplitude(estimate)
    stiffness = f"{estimate.torque_unit}/{estimate.position_unit}"
    found = _measure_spring(estimate.elasticity, amplitude)
    known = None if estimate.truth is None else _measure_spring(estimate.truth, amplitude)
    reach = f"\N{PLUS-MINUS SIGN}{1e3 * amplitude:.4g} m{estimate.position_unit}"
    names = (
        ("stiffness k0 once all stops slip", stiffness),
        ("stiffness right after a reversal", stiffness),
        (f"torque over torsion at {reach}", stiffness),
        (f"energy lost in a cycle of {reach}", "J"),
    )
    rows: list[tuple[object, ...]] = []
    for index, (name, unit) in enumerate(names):
        value = found[index]
        true = () if known is None else (f"{known[index]:.4g}", format_error(value, known[index]))
        rows.append((name, f"{value:.4g}", *true, unit))
    extra = (
        ("cubic stiffness", estimate.elasticity.cubic, f"{stiffness}\N{SUPERSCRIPT THREE}"),
        ("damping", estimate.elasticity.damping, f"{estimate.torque_unit} s/{estimate.position_unit}"),
    )
    empty = () if known is None else ("", "")
    rows += [(name, f"{value:.4g}", *empty, unit) for name, value, unit in extra if value]
    header = ("quantity", "value", *(() if known is None else ("truth", "error")), "unit")
    title = "Values that do not depend on where thresholds were put."
    return Table(header, rows, (0, len(header) - 1), title)


def _measure_spring(spring: Elasticity, amplitude: float) -> tuple[float, float, float, float]:
    """Return k0, k0 + sum k_i, the secant stiffness at `amplitude`, and the loss of a cycle in J."""
    first = float(compute_first_curve(spring, np.array([amplitude]))[0])
    # The second cycle is closed: the first one begins on the virgin curve.
    path = _sweep_torsion(amplitude, -amplitude, amplitude)
    work = compute_spring_work(spring, path) if not (spring.cubic and spring.knees) else None
    loss = float(work[-1] - work[_SAMPLES]) if work is not None else float("nan")
    return spring.stiffness or 0.0, spring.initial_stiffness or 0.0, first / amplitude, loss


def _describe_reach(estimate: SpringEstimate) -> list[str]:
    """Return in words how far the spring was turned and what of it that does not tell."""
    shown, unit = f"m{estimate.position_unit}", estimate.torque_unit
    reach = f"{1e3 * estimate.torsion:.4g} {shown}"
    texts = [f"In the logs its torsion reached {reach}, its torque {estimate.torque:.4g} {unit}."]
    held = [stop.threshold for stop in estimate.elasticity.stops if stop.threshold > estimate.excited]
    if held:
        first = f"{1e3 * min(held):.4g} {shown}"
        texts.append(f"Stops from {first} on never slipped: their stiffness cannot be told from k0.")
    true = () if estimate.truth is None else estimate.truth.stops
    hidden = [stop.threshold for stop in true if stop.threshold > estimate.torsion]
    if hidden:
        first = f"{1e3 * min(hidden):.4g} {shown}"
        texts.append(f"True stops from {first} on never slipped: their stiffness is a part of k0 here.")
    far = [knee.threshold for knee in estimate.elasticity.knees if abs(knee.threshold) > estimate.torque]
    if far:
        names = ", ".join(_write_minus(f"{value:.3g}") for value in far)
        texts.append(f"Knees that the torque never reached: {names} {unit}; no slope is known beyond.")
    if not estimate.elasticity.stops:
        texts.append("No stop has any stiffness: the logs show a spring without hysteresis.")
    return texts


def draw_branches(estimate: SpringEstimate) -> str:
    """Return first curve, outer loop, nested loops, all by the spring's own memory."""
    amplitude = _choose_amplitude(estimate)
    whole = _sweep_torsion(
        amplitude, -amplitude, amplitude, *(amplitude * turn for turn in _TURNS), amplitude
    )
    torque = compute_hysteresis_torque(estimate.elasticity, whole)
    outer, nested = slice(_SAMPLES, 3 * _SAMPLES + 1), slice(3 * _SAMPLES, None)
    pieces = (
        ("nested loops", "minor", nested),
        ("outer loop", "major", outer),
        ("first curve", "virgin", slice(0, _SAMPLES + 1)),
    )
    lines = [
        Line(label=label, style=style, x=1e3 * whole[piece], y=torque[piece])
        for label, style, piece in pieces
    ]
    if estimate.truth is not None:
        path = _sweep_torsion(amplitude, -amplitude, amplitude)
        true = compute_hysteresis_torque(estimate.truth, path)
        part = slice(_SAMPLES, None)
        lines.insert(0, Line(label="true outer loop", style="truth", x=1e3 * path[part], y=true[part]))
    return build_curve_figure(
        f"{estimate.joint}: branches of the spring",
        f"Torque of {estimate.joint} in {estimate.torque_unit} against its torsion: first curve of a virgin "
        "spring, the outer loop between the largest torsions, and loops nested in it.",
        (f"torsion (m{estimate.position_unit})", f"joint torque ({estimate.torque_unit})"),
        lines,
    )


def _sweep_torsion(*turns: float) -> FloatArray:
    """Return torsions from zero to each of `turns`, `_SAMPLES` steps a way."""
    parts = [np.linspace(start, end, _SAMPLES + 1)[1:] for start, end in pairwise((0.0, *turns))]
    return np.concatenate([np.zeros(1), *parts])


def _write_minus(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}")


def _compare_methods(estimate: ElasticEstimate) -> Iterator[Block]:
    """Yield the methods that were tried, by their error of prediction and their distance from the truth."""
    trials = estimate.trials
    if len(trials) < 2:
        return
    truth = [entry.truth for entry in estimate.parameters]
    scores = [(trial.error, _compute_largest_error(trial.values, truth)) for trial in trials]
    measures = ["prediction error (noise = 1)", "largest error of a parameter (%)"]
    if all(distance is None for _, distance in scores):
        del measures[1]
    chosen = [trial.method == estimate.method for trial in trials]
    names = [
        f"{trial.method} (chosen)" if mine else trial.method
        for trial, mine in zip(trials, chosen, strict=True)
    ]
    rows = [
        (name, *map(_format_score, score[: len(measures)]), trial.outcome.value)
        for name, score, trial in zip(names, scores, trials, strict=True)
    ]
    yield _PREDICTION
    yield Table(
        ("method", *measures, "outcome"),
        rows,
        (0, len(measures) + 1),
        "Methods on the same logs. Less is better.",
        picked=chosen.index(True) if any(chosen) else None,
    )
    for index, measure in enumerate(measures):
        intervals = [
            Interval(label=name, middle=score[index] or 0.0, text=_format_score(score[index]), chosen=mine)
            for name, score, mine in zip(names, scores, chosen, strict=True)
            if score[index] is not None and math.isfinite(score[index] or 0.0)
        ]
        if len(intervals) > 1:
            text = f"{measure}, value of every method; less is better."
            figure = build_interval_figure(f"{measure} by method", text, measure, intervals)
            what = measure.partition(" (")[0]
            yield Drawing(figure, f"{what[:1].upper()}{what[1:]}: a mark for every method.")


def _format_score(value: float | None) -> str:
    if value is None:
        return "\N{EN DASH}"
    return f"{value:.4g}" if math.isfinite(value) else "failed"


def _compute_largest_error(values: Sequence[float], truth: Sequence[float | None]) -> float | None:
    """Return the largest relative error in percent over the parameters whose truth is not zero."""
    pairs = [(value, true) for value, true in zip(values, truth, strict=True) if true]
    return max((100.0 * abs(value - true) / abs(true) for value, true in pairs), default=None)


def _show_convergence(estimate: ElasticEstimate) -> Iterator[Block]:
    """Yield the course of the iterations; nothing where there are fewer than two."""
    history = estimate.history
    finite = [entry for entry in history if np.isfinite([entry.merit, entry.change, *entry.norms]).all()]
    if len(finite) < 2:
        return
    heads = ["energy rows (J)", *(f"{entry.joint} ({entry.unit})" for entry in estimate.residual)]
    heads = heads if all(len(entry.norms) == len(heads) for entry in finite) else []
    yield "== Convergence =="
    yield f"{len(history)} iterations of {estimate.method}, {estimate.outcome.value}."
    yield from _draw_course(finite)
    yield from _draw_norms(finite, heads)
    rows = [
        (
            number,
            f"{entry.merit:.6g}",
            f"{entry.change:.2e}",
            f"{entry.damping:g}",
            *(f"{norm:.5g}" for norm in (entry.norms if heads else ())),
        )
        for number, entry in enumerate(history, start=1)
    ]
    header = ("iteration", "merit", "relative change", "damping", *heads)
    yield Table(header, rows, title="Every iteration, with the norms of its residuals.")


def _draw_course(history: Sequence[HistoryEntry]) -> Iterator[Drawing]:
    number = np.arange(1.0, len(history) + 1.0)
    merit = np.array([entry.merit for entry in history])
    change = np.array([entry.change for entry in history])
    lines = [
        Line(label="merit", style="first", x=number, y=merit, markers=True),
        Line(label="relative change of the parameters", style="second", x=number, y=change, markers=True),
    ]
    lines = [line for line in lines if np.any(line.y > 0.0)]
    if lines:
        figure = build_line_figure(
            "Convergence",
            "Merit and relative change of the parameters against the number of the iteration, logarithmic.",
            ("iteration", "merit, change (1)"),
            lines,
            logarithmic=True,
            whole=True,
        )
        yield Drawing(figure, "Merit and relative change of the parameters.")


def _draw_norms(history: Sequence[HistoryEntry], heads: Sequence[str]) -> Iterator[Drawing]:
    """Yield each norm relative to the first of it, so that units do not matter."""
    number = np.arange(1.0, len(history) + 1.0)
    lines = []
    for index, head in enumerate(heads):
        values = np.array([entry.norms[index] for entry in history])
        if values[0] > 0.0:
            style = STYLES[index % len(STYLES)]
            lines.append(Line(label=head, style=style, x=number, y=values / values[0], markers=True))
    if lines:
        figure = build_line_figure(
            "Residual norms",
            "Norms of the residuals, relative to the first iteration, against the number of the iteration.",
            ("iteration", "norm / first norm"),
            lines,
            whole=True,
        )
        yield Drawing(figure, "Norms of the residuals, relative to those of the first iteration.")


def _show_tracking(estimate: ElasticEstimate, runs: "Sequence[TrackingRun]") -> Iterator[Block]:
    """Yield the RMS of the tracking error of every joint, and its course with every feed-forward."""
    joints = [(entry.joint, "m" if entry.unit == "N" else "rad") for entry in estimate.residual]
    rows = [(run.name, *(f"{1e3 * value:.4g}" for value in run.rms.tolist())) for run in runs]
    header = ("feed-forward", *(f"{name} (m{unit})" for name, unit in joints))
    yield "== Tracking =="
    yield Table(header, rows, title="RMS of reached less desired position of the links.")
    for index, (name, unit) in enumerate(joints):
        lines = [
            Line(label=run.name, style=STYLES[number % len(STYLES)], x=run.time, y=1e3 * run.error[:, index])
            for number, run in enumerate(runs)
        ]
        figure = build_line_figure(
            f"{name}: tracking error",
            f"Reached less desired position of {name} in m{unit} against time in s, for every feed-forward.",
            ("time (s)", f"tracking error (m{unit})"),
            lines,
        )
        yield Drawing(figure, f"Tracking error of {name} with every feed-forward.")
