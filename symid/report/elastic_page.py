"""The report of an elastic identification: one HTML file that needs nothing else.

`ElasticEstimate`, what it predicts of logs, further comparisons and motions -> a page with verdict,
hysteresis loops, springs, parameters, methods, convergence, tracking, residuals, settings.

Loops show the joint torque against its torsion, measured and by the springs; springs show their numbers,
their branches, and what was not excited, with the truth beside them where it is known.

Supported: printing, light and dark screens, screen readers; no scripts, no network; springs with stops and
knees, cubic parts, damping. Sections without data are left out.
Not supported: more than one robot on a page; uncertainties of single stops: they trade with their neighbours.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from symid import __version__
from symid.arrays import FloatArray
from symid.errors import Notice
from symid.identification.elastic import (
    ElasticEstimate,
    ElasticTrial,
    JointTrial,
    MethodTrial,
    SpringEstimate,
)
from symid.identification.rigid import write_file
from symid.joint_models import compute_first_curve, compute_hysteresis_torque, compute_spring_work
from symid.report.figures import Line, build_curve_figure, build_line_figure
from symid.report.pages import (
    ComparedMethod,
    ConvergenceSection,
    MethodComparison,
    MethodSection,
    ParameterLine,
    ResidualLine,
    TrackingRuns,
    TrackingSection,
    build_convergence_section,
    build_method_section,
    build_parameter_line,
    build_residual_line,
    build_tracking_section,
    format_error,
    list_settings,
    render_page,
)
from symid.report.verdict import FitVerdict, judge_elastic
from symid.robot import Elasticity


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopSection:
    """The figures of one joint, as SVG: loops, loops without their common slope, what the spring leaves.

    The last is empty where no spring was found.
    """

    joint: str
    loops: str
    opened: str
    error: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialSection:
    """One log: its figures, and tables of residuals, each with a caption."""

    source: str
    caption: str
    joints: tuple[LoopSection, ...]
    residuals: tuple[tuple[str, tuple[ResidualLine, ...]], ...]


def build_trial_section(trial: ElasticTrial) -> TrialSection:
    """Return the section of one log."""
    caption = "Held out: nothing was fitted here."
    if trial.fitted:
        caption = "A log of the fit: this is no test."
    return TrialSection(
        source=trial.source,
        caption=caption,
        joints=tuple(map(_build_loop_section, trial.joints)),
        residuals=tuple((text, tuple(map(build_residual_line, lines))) for text, lines in trial.residuals),
    )


def _build_loop_section(entry: JointTrial) -> LoopSection:
    slope = entry.straight
    stiffness = f"{slope:.4g} {entry.unit}/{entry.torsion_unit}"
    return LoopSection(
        joint=entry.joint,
        loops=_draw_loops(
            entry,
            0.0,
            f"{entry.joint}: hysteresis loops",
            f"Joint torque of {entry.joint} in {entry.unit} against its torsion: measured from the motor, "
            "from the link, and by the springs.",
            f"joint torque ({entry.unit})",
        ),
        opened=_draw_loops(
            entry,
            slope,
            f"{entry.joint}: hysteresis loops, opened",
            f"Joint torque of {entry.joint} less {stiffness} times its torsion, against its torsion.",
            f"torque less {stiffness} \N{MULTIPLICATION SIGN} torsion ({entry.unit})",
        ),
        error="" if entry.final is None else _draw_spring_error(entry, entry.final),
    )


def _draw_loops(entry: JointTrial, slope: float, title: str, description: str, label: str) -> str:
    return build_curve_figure(
        title,
        description,
        (f"torsion (m{entry.torsion_unit})", label),
        [
            Line(label=name, style=style, x=1e3 * entry.torsion, y=values - slope * entry.torsion)
            for name, style, values in _list_torque_curves(entry)
        ],
    )


def _list_torque_curves(entry: JointTrial) -> list[tuple[str, str, FloatArray]]:
    """Return every way to the joint torque with its style, what is to lie on top last."""
    label, linear = _get_linear_torque(entry)
    ways = (
        ("truth", "truth", entry.truth),
        ("measured, motor side", "measured", entry.motor),
        ("measured, link side", "link", entry.link),
        (label, "initial", linear),
        ("identified", "final", entry.final),
    )
    return [(label, style, values) for label, style, values in ways if values is not None]


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


_SAMPLES = 400
"""Of each branch of a figure."""
_TURNS = (0.6, -0.3, 0.45, -0.1, 0.3)
"""Where the nested loops of the figure turn, in parts of the amplitude."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpringLine:
    """A row of a table of spring values, ready to print; `truth` and `error` may be empty."""

    name: str
    value: str
    unit: str
    truth: str = ""
    error: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpringSection:
    """One joint's spring: what it is like, its values, and its branches as SVG.

    `stops` are rows of threshold, stiffness, torque at which it slips; `knees` of torque, slope beyond.
    `truth` are sentences on the true ones.
    """

    joint: str
    words: tuple[str, ...]
    lines: tuple[SpringLine, ...]
    has_truth: bool
    stops: tuple[tuple[str, str, str], ...]
    knees: tuple[tuple[str, str], ...]
    stop_units: tuple[str, str, str]
    knee_unit: str
    truth: tuple[str, ...]
    branches: str


def build_spring_section(estimate: SpringEstimate) -> SpringSection:
    """Return the section of one joint's spring; all its stiffnesses must be known."""
    torsion, unit = estimate.position_unit, estimate.torque_unit
    stops, knees = _list_stops(estimate.elasticity), _list_knees(estimate.elasticity)
    truth = []
    if estimate.truth is not None:
        places = (
            f"{value} {unit}/{torsion} at {place} m{torsion}"
            for place, value, _ in _list_stops(estimate.truth)
        )
        bends = (f"{slope} beyond {place} {unit}" for place, slope in _list_knees(estimate.truth))
        truth = [f"True stops: {', '.join(places) or 'none'}.", f"True slopes: {', '.join(bends) or '1'}."]
    return SpringSection(
        joint=estimate.joint,
        words=tuple(_describe_reach(estimate)),
        lines=_list_values(estimate),
        has_truth=estimate.truth is not None,
        stops=stops,
        knees=knees,
        stop_units=(f"m{torsion}", f"{unit}/{torsion}", unit),
        knee_unit=unit,
        truth=tuple(truth),
        branches=_draw_branches(estimate),
    )


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


def _list_values(estimate: SpringEstimate) -> tuple[SpringLine, ...]:
    """Return the rows that can be compared between springs of other thresholds."""
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
    lines = []
    for index, (name, unit) in enumerate(names):
        value = found[index]
        truth, error = "", ""
        if known is not None:
            truth = f"{known[index]:.4g}"
            if known[index]:
                error = format_error(value, known[index])
        lines.append(SpringLine(name=name, value=f"{value:.4g}", unit=unit, truth=truth, error=error))
    extra = (
        ("cubic stiffness", estimate.elasticity.cubic, f"{stiffness}\N{SUPERSCRIPT THREE}"),
        ("damping", estimate.elasticity.damping, f"{estimate.torque_unit} s/{estimate.position_unit}"),
    )
    lines += [SpringLine(name=name, value=f"{value:.4g}", unit=unit) for name, value, unit in extra if value]
    return tuple(lines)


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


def _draw_branches(estimate: SpringEstimate) -> str:
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


_TEMPLATE = "elastic.html.jinja"
_PREDICTION = (
    "The prediction error is the mean square of torques that were left out of the fit, less what it says of "
    "them, in units of the noise: noise alone would leave 1."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticExtras:
    """What a report shows besides the estimate.

    Args:
        trials: what it says of logs, held out or not.
        iterated: another estimate from the same logs, whose iterations are shown where the result has none.
        comparisons: of methods, for example over many runs with a known truth.
        tracking: motions with several feed-forwards.
        notices: what else a reader should know: of the robot, its library, and the recordings.
        origin: what the page was made from, in short texts.
    """

    trials: tuple[ElasticTrial, ...] = ()
    iterated: ElasticEstimate | None = None
    comparisons: tuple[MethodComparison, ...] = ()
    tracking: TrackingRuns | None = None
    notices: tuple[Notice, ...] = ()
    origin: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticPage:
    """The context of the page: its fields are the template's variables."""

    robot: str
    verdict: FitVerdict
    trials: tuple[TrialSection, ...]
    springs: tuple[SpringSection, ...]
    has_truth: bool
    parameters: tuple[ParameterLine, ...]
    refused: tuple[tuple[str, str], ...]
    reason: str
    comparisons: tuple[MethodSection, ...]
    convergence: ConvergenceSection | None
    tracking: TrackingSection | None
    residuals: tuple[tuple[str, tuple[ResidualLine, ...]], ...]
    settings: tuple[tuple[str, str], ...]
    notices: tuple[str, ...]
    origin: tuple[str, ...]


def write_elastic_report(path: Path, estimate: ElasticEstimate, extras: ElasticExtras | None = None) -> Path:
    """Write the page to `path`, at once or not at all, and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_file(path, render_page(_TEMPLATE, build_elastic_report(estimate, extras)))


def build_elastic_report(estimate: ElasticEstimate, extras: ElasticExtras | None = None) -> ElasticPage:
    """Return all that the page shows."""
    extras = extras or ElasticExtras()
    refused = {name for name, _ in estimate.refused}
    kept = [entry for entry in estimate.parameters if entry.name not in refused]
    if not estimate.covariance:
        kept = [replace(entry, std=math.inf) for entry in kept]
    comparisons = map(build_method_section, (_compare_trials(estimate), *extras.comparisons))
    units = [entry.unit for entry in estimate.residual]
    torques = [(entry.joint, entry.unit) for entry in estimate.residual]
    positions = [
        (entry.joint, "m" if unit == "N" else "rad")
        for entry, unit in zip(estimate.residual, units, strict=True)
    ]
    return ElasticPage(
        robot=estimate.robot,
        verdict=judge_elastic(estimate, extras.trials),
        trials=tuple(map(build_trial_section, extras.trials)),
        springs=tuple(build_spring_section(entry) for entry in estimate.springs if entry.told),
        has_truth=any(entry.truth is not None for entry in kept),
        parameters=tuple(map(build_parameter_line, kept)),
        refused=estimate.refused,
        reason=f"{estimate.reason[:1].upper()}{estimate.reason[1:]}.",
        comparisons=tuple(entry for entry in comparisons if entry is not None),
        convergence=_show_iterations(estimate, extras.iterated, torques),
        tracking=build_tracking_section(extras.tracking, positions),
        residuals=(
            (
                "Torque of the motors by their own dynamics and the springs, in the logs of the fit.",
                tuple(map(build_residual_line, estimate.residual)),
            ),
            ("Energy over windows, in the logs of the fit.", (build_residual_line(estimate.energy),)),
        ),
        settings=_list_page_settings(estimate),
        notices=tuple(dict.fromkeys(map(str, (*estimate.notices, *extras.notices)))),
        origin=(f"Written by symid {__version__}", *extras.origin),
    )


def _show_iterations(
    estimate: ElasticEstimate, other: ElasticEstimate | None, joints: list[tuple[str, str]]
) -> ConvergenceSection | None:
    """Return the iterations of the result or, where it has none, those of another method."""
    shown = other if other is not None and len(estimate.history) < 2 else estimate
    return build_convergence_section(shown.history, joints, f"{shown.method}, {shown.outcome.value}")


def _compare_trials(estimate: ElasticEstimate) -> MethodComparison:
    """Return the methods that were tried, by their error of prediction and their distance from the truth."""
    truth = [entry.truth for entry in estimate.parameters]
    scores = []
    for trial in estimate.trials:
        distance = _compute_largest_error(trial, truth)
        scores.append(
            ComparedMethod(
                method=trial.method,
                middles=(trial.error, distance),
                outcome=trial.outcome.value,
                chosen=trial.method == estimate.method,
            )
        )
    measures: tuple[tuple[str, str], ...] = (
        ("prediction error", "noise = 1"),
        ("largest error of a parameter", "%"),
    )
    if all(score.middles[1] is None for score in scores):
        measures = measures[:1]
        scores = [replace(score, middles=score.middles[:1]) for score in scores]
    return MethodComparison(measures=measures, scores=tuple(scores), words=(_PREDICTION,))


def _compute_largest_error(trial: MethodTrial, truth: list[float | None]) -> float | None:
    """Return the largest relative error in percent over the parameters whose truth is not zero."""
    pairs = [(value, true) for value, true in zip(trial.values, truth, strict=True) if true]
    return max((100.0 * abs(value - true) / abs(true) for value, true in pairs), default=None)


def _list_page_settings(estimate: ElasticEstimate) -> tuple[tuple[str, str], ...]:
    head = (
        ("method of the result", estimate.method),
        ("outcome", estimate.outcome.value),
        ("logs", ", ".join(estimate.sources)),
        ("rows fitted", str(sum(entry.samples for entry in estimate.residual))),
        ("condition of the scaled matrix", f"{estimate.condition:.4g}"),
        ("signature of the model", estimate.signature),
    )
    return head + tuple(list_settings(estimate.settings))
