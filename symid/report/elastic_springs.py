"""The springs of an identification: their numbers in tables, their branches in figures, what was not excited.

Input: `SpringEstimate`. Output: `SpringSection`, figures and tables ready to print.

Supported: springs with stops and knees, cubic parts, damping; tables of truth next to the estimate.
Not supported: uncertainties of single stops; they trade with their neighbours.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.estimate import SpringEstimate
from symid.joint.loops import find_first_curve
from symid.joint.plays import find_hysteresis_torque, find_spring_work
from symid.report.figures import build_curve_figure
from symid.report.lines import Line
from symid.report.tables import write_error
from symid.robot.elasticity import Elasticity

__all__ = ["SpringLine", "SpringSection", "build_spring"]

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


def build_spring(estimate: SpringEstimate) -> SpringSection:
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
    return tuple((_sign(f"{torque:.4g}"), f"{slope:.4g}") for torque, slope in sorted(result))


def _find_amplitude(estimate: SpringEstimate) -> float:
    """Return how far the spring is turned for figures and cycles: as far as the logs did."""
    last = max((stop.threshold for stop in estimate.elasticity.stops), default=0.0)
    return estimate.torsion or 1.25 * last or 0.01


def _list_values(estimate: SpringEstimate) -> tuple[SpringLine, ...]:
    """Return the rows that can be compared between springs of other thresholds."""
    amplitude = _find_amplitude(estimate)
    stiffness = f"{estimate.torque_unit}/{estimate.position_unit}"
    found = _measure(estimate.elasticity, amplitude)
    known = None if estimate.truth is None else _measure(estimate.truth, amplitude)
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
                error = write_error(value, known[index])
        lines.append(SpringLine(name=name, value=f"{value:.4g}", unit=unit, truth=truth, error=error))
    extra = (
        ("cubic stiffness", estimate.elasticity.cubic, f"{stiffness}\N{SUPERSCRIPT THREE}"),
        ("damping", estimate.elasticity.damping, f"{estimate.torque_unit} s/{estimate.position_unit}"),
    )
    lines += [SpringLine(name=name, value=f"{value:.4g}", unit=unit) for name, value, unit in extra if value]
    return tuple(lines)


def _measure(spring: Elasticity, amplitude: float) -> tuple[float, float, float, float]:
    """Return k0, k0 + sum k_i, the secant stiffness at `amplitude`, and the loss of a cycle in J."""
    first = float(find_first_curve(spring, np.array([amplitude]))[0])
    # The second cycle is closed: the first one begins on the virgin curve.
    path = _run(amplitude, -amplitude, amplitude)
    work = find_spring_work(spring, path) if not (spring.cubic and spring.knees) else None
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
        names = ", ".join(_sign(f"{value:.3g}") for value in far)
        texts.append(f"Knees that the torque never reached: {names} {unit}; no slope is known beyond.")
    if not estimate.elasticity.stops:
        texts.append("No stop has any stiffness: the logs show a spring without hysteresis.")
    return texts


def _draw_branches(estimate: SpringEstimate) -> str:
    """Return first curve, outer loop, nested loops, all by the spring's own memory."""
    amplitude = _find_amplitude(estimate)
    whole = _run(amplitude, -amplitude, amplitude, *(amplitude * turn for turn in _TURNS), amplitude)
    torque = find_hysteresis_torque(estimate.elasticity, whole)
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
        path = _run(amplitude, -amplitude, amplitude)
        true = find_hysteresis_torque(estimate.truth, path)
        part = slice(_SAMPLES, None)
        lines.insert(0, Line(label="true outer loop", style="truth", x=1e3 * path[part], y=true[part]))
    return build_curve_figure(
        f"{estimate.joint}: branches of the spring",
        f"Torque of {estimate.joint} in {estimate.torque_unit} against its torsion: first curve of a virgin "
        "spring, the outer loop between the largest torsions, and loops nested in it.",
        (f"torsion (m{estimate.position_unit})", f"joint torque ({estimate.torque_unit})"),
        lines,
    )


def _run(*turns: float) -> FloatArray:
    """Return torsions from zero to each of `turns`, `_SAMPLES` steps a way."""
    parts = [np.linspace(start, end, _SAMPLES + 1)[1:] for start, end in pairwise((0.0, *turns))]
    return np.concatenate([np.zeros(1), *parts])


def _sign(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}")
