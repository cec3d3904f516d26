"""A bare element as people read it: its verdict, numbers with intervals, the models that were tried.

`HysteresisRecord` -> `FitVerdict`, blocks, plain types, page; and what it predicts of another recording.

    energy of a cycle      work int y dx from one reversal to the next but one
    Masing's rule          branches after reversals, moved to one point and turned, are one (Masing 1926)
    first-order reversal   branches that begin at reversals of any size and end at the largest input

Supported: text, JSON, HTML with figures. Not supported: reversal curves of a recording without a swing that
grows or shrinks.
"""

import shlex
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy

from symid.arrays import FloatArray
from symid.identification.hysteresis import (
    ElementTrace,
    HysteresisRecord,
    HysteresisTrial,
    describe_inversion,
    find_strokes,
)
from symid.report.blocks import Block, Drawing, Table
from symid.report.figures import Line, build_curve_figure, build_line_figure
from symid.report.pages import Page, format_percent, write_page
from symid.report.verdict import FitVerdict, rate_output
from symid.serialization import describe_record

_SKIPPED = "The first {} samples do not count: no memory at the start explains them like the rest."
_POOR = 0.5
"""Of its value: a deviation beyond it leaves not even the first digit."""
_NORMAL = 1.96


def judge_element(record: HysteresisRecord) -> FitVerdict:
    """Return what an element is worth, from what it predicts of samples that were left out."""
    level = rate_output(record.held_out)
    untimed = "No time was given: models that depend on the speed were not tried."
    return FitVerdict(
        level=level,
        headline=(
            f"{record.model} with {record.candidates[0].count} parameters leaves {record.held_out:.3g} % of "
            "the output unexplained, held out."
        ),
        details=(
            f"Held out: every eighth of the recording in turn; the fit itself leaves {record.fitted:.3g} %.",
            *([_SKIPPED.format(record.skipped)] if record.skipped else []),
            *([] if record.timed else [untimed]),
        ),
        remedy=""
        if level in {"good", "usable"}
        else "Plot output against input, and check columns, signs and units.",
    )


def judge_element_trial(trial: HysteresisTrial) -> FitVerdict:
    """Return what an element predicts of another recording."""
    headline = f"{trial.error:.3g} % of the output of this recording is left unexplained, means removed."
    details = [_SKIPPED.format(trial.skipped)] if trial.skipped else []
    if trial.beyond > 0.0:
        share = f"{100.0 * trial.beyond:.3g} % of its samples"
        details.append(f"{share} lie beyond the input of the fit, where the element extrapolates.")
    if trial.inverse is not None:
        details.append(f"The inverse of the measured output misses the input by {trial.inverse:.3g} % of it.")
    return FitVerdict(level=rate_output(trial.error), headline=headline, details=tuple(details))


def show_element(record: HysteresisRecord) -> tuple[Block, ...]:
    """Return the tables and sentences on an element."""
    shown = [entry for entry in record.parameters if not entry.name.endswith("least")]
    poor = [entry.name for entry in shown if entry.deviation > _POOR * abs(entry.value)]
    rows = []
    for entry in (one for one in shown if one.deviation > 0.0 and one.name not in poor):
        low, high = (entry.value + side * _NORMAL * entry.deviation for side in (-1.0, 1.0))
        digits = (f"{entry.value:.5g}", f"{entry.deviation:.2g}", f"{low:.5g} to {high:.5g}")
        rows.append((entry.name, *digits))
    fixed = [f"{entry.name} = {entry.value:g}" for entry in shown if not entry.deviation and entry.value]
    lists = (("Poorly identifiable, not shown", poor), ("Fixed", fixed))
    note = "\n".join(f"{head}: {', '.join(names)}." for head, names in lists if names)
    form = f" ({record.form})" if record.form else ""
    header = ("parameter", "value", "std", "95 % interval")
    table = Table(header, rows, title=f"{record.model}{form}", note=note)
    tried = Table(
        header=("model", "form", "parameters", "passive", "fitted %", "held out %", "+-"),
        rows=[
            (
                *(entry.model, entry.form, entry.count, ("no", "yes")[entry.passive]),
                *(f"{entry.fitted:.3g}", f"{entry.held_out:.3g}", f"{entry.spread:.2g}"),
            )
            for entry in record.candidates
        ],
        left=(0, 1, 3),
        title="Models that were tried",
        picked=0,
    )
    reason = describe_inversion(record)
    inverse = f"There is none: {reason}." if reason else "It exists, for every output."
    passive = "no motion gets" if record.passive else "some motions may get"
    facts = (
        f"Inverse: {inverse}\nPassivity: {passive} work out of the element.\nStart: {_STARTS[record.start]}."
    )
    return (table, tried, facts)


_LABELS = ("input (unit of the file)", "output (unit of the file)")


def draw_element(record: HysteresisRecord) -> tuple[Drawing, ...]:
    """Return the figures of an element: loops, time, residuals, energy of cycles, branches."""
    trace = record.trace
    curves = (("measured", trace.measured), ("predicted", trace.predicted))
    loops = [
        Line(name, style, trace.position, y, joined=name == "predicted")
        for (name, y), style in zip(curves, ("cloud", "predicted"), strict=True)
    ]
    over_time = [Line(name, name, trace.time, y) for name, y in curves]
    error = trace.measured - trace.predicted
    time, worst = "time (s)" if record.timed else "sample", int(np.argmax(np.abs(error)))
    time_of_worst = f"{trace.time[worst]:.4g} s" if record.timed else f"sample {trace.time[worst]:.0f}"
    first, last = (float(np.mean(part)) for part in np.array_split(error, 2))
    size = float(np.sqrt(np.mean(error**2)))
    drift = 100.0 * abs(last - first) / size if size else 0.0
    moved = f"Does it drift? From half to half the mean residual changes by {drift:.2g} % of its rms."
    caption = f"Output against input: does {record.model} follow the loops? It leaves "
    caption += f"{format_percent(record.fitted)} of the output."

    def draw_cloud(caption: str, label: str, x: FloatArray) -> Drawing:
        line = Line("residual", "cloud", x, error, joined=False)
        return build_curve_figure(caption, (label, "residual"), [line], height=260.0)

    drawn = [
        build_curve_figure(caption, _LABELS, loops),
        build_line_figure(f"When does it miss? Most at {time_of_worst}.", (time, _LABELS[1]), over_time),
        draw_cloud(
            f"Does the model miss at some inputs? Most at {trace.position[worst]:.3g}.",
            _LABELS[0],
            trace.position,
        ),
        build_line_figure(moved, (time, "residual"), [Line("residual", "final", trace.time, error)]),
    ]
    if record.timed:
        rate = np.gradient(trace.position, trace.time)
        fast = np.abs(rate) > np.median(np.abs(rate))
        slow = float(np.mean(np.abs(error[~fast])))
        ratio = float(np.mean(np.abs(error[fast]))) / slow if fast.any() and slow else 1.0
        text = f"Does it depend on the speed? Fast samples miss {ratio:.2g} times as much as slow ones."
        drawn.append(draw_cloud(text, "rate of the input (unit of the file / s)", rate))
    return (*drawn, *_draw_cycles(trace), *_draw_branches(trace))


def compute_cycles(trace: ElementTrace) -> FloatArray:
    """Return width, measured and predicted work (c, 3) of all cycles, from a reversal to the next but one."""
    strokes = find_strokes(trace.position)[1:-1]
    rows = []
    for (low, _), (_, high) in pairwise(strokes):
        part = slice(max(low - 1, 0), high)
        x, curves = trace.position[part], np.stack((trace.measured[part], trace.predicted[part]))
        # What the ends leave open is no loop: closed by the straight line between them.
        gap = 0.5 * (x[0] - x[-1]) * (curves[:, 0] + curves[:, -1])
        rows.append((np.ptp(x), *(scipy.integrate.trapezoid(curves, x) + gap)))
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _draw_cycles(trace: ElementTrace) -> Iterator[Drawing]:
    cycles = compute_cycles(trace)
    if len(cycles) < _FEW:
        return
    width, measured, predicted = cycles.T
    left = float(np.sqrt(np.mean((measured - predicted) ** 2)) / np.sqrt(np.mean(measured**2)))
    yield build_curve_figure(
        f"Is the lost energy right? Work of a cycle against its width: {100.0 * left:.2g} % is left, rms.",
        ("width of the cycle (unit of the input)", "work (units of input and output)"),
        [
            Line("measured", "link", width, measured, markers=True, joined=False),
            Line("predicted", "predicted", width, predicted, markers=True, joined=False),
        ],
        height=260.0,
    )


_FEW = 3


def _draw_branches(trace: ElementTrace) -> Iterator[Drawing]:
    """Yield branches after reversals moved to one point, and first-order reversal curves."""
    parts = [
        slice(low, high) for low, high in find_strokes(trace.position)[1:-1] if high - low >= _FEWEST_POINTS
    ]
    if len(parts) < _FEW:
        return
    moved = []
    for part in parts:
        x, y = trace.position[part], trace.measured[part]
        side = 1.0 if x[-1] > x[0] else -1.0
        name, style = ("upwards", "link") if side > 0.0 else ("downwards", "final")
        moved.append(Line(name, style, side * (x - x[0]), side * (y - y[0])))
    # The rms of the branches about their mean curve, over the rms of that, where several have points.
    places = np.linspace(0.0, max(float(line.x[-1]) for line in moved), _PLACES)
    rows = np.array(
        [
            np.where(places <= x.max(), np.interp(places, np.maximum.accumulate(x), y), np.nan)
            for x, y in ((line.x, line.y) for line in moved)
        ]
    )
    rows = rows[:, np.sum(np.isfinite(rows), axis=0) >= _FEW]
    mean = np.nanmean(rows, axis=0)
    size = float(np.sqrt(np.mean(mean**2))) if mean.size else 0.0
    spread = float(np.sqrt(np.nanmean((rows - mean) ** 2))) / size if size else 0.0
    yield build_curve_figure(
        "Masing's rule? Measured branches after reversals, moved to one point, those downwards "
        f"turned: {100.0 * spread:.2g} % of their rms is spread.",
        ("way from the reversal (unit of the input)", "change of the output"),
        moved,
        height=300.0,
    )
    top = float(trace.position.max()) - _NEAR_TOP * float(np.ptp(trace.position))
    curves = [part for part in parts if trace.position[part][-1] >= top]
    begins = [float(trace.position[part][0]) for part in curves]
    if len(curves) < _FEW or float(np.ptp(begins)) < _NEAR_TOP * float(np.ptp(trace.position)):
        return
    yield build_curve_figure(
        "First-order reversal curves: do they meet? Upward branches from reversals to the largest input.",
        _LABELS,
        [
            *(Line("measured", "cloud", trace.position[p], trace.measured[p], joined=False) for p in curves),
            *(Line("predicted", "predicted", trace.position[p], trace.predicted[p]) for p in curves),
        ],
        height=300.0,
    )


_FEWEST_POINTS = 8
_NEAR_TOP = 0.1
"""Of the range of the input."""


_PLACES = 60


def write_element_page(path: Path, record: HysteresisRecord, *, source: str = "") -> Path:
    """Write the page of an element and return the path; OutputError where it cannot be written."""
    lead, second, *further = draw_element(record)
    _, _, facts = blocks = show_element(record)
    free = [entry for entry in record.parameters if entry.deviation > 0.0]
    known = [entry for entry in free if entry.deviation <= _POOR * abs(entry.value)]
    page = Page(
        robot=source or "element",
        subject="element with hysteresis",
        verdict=judge_element(record),
        numbers=(
            (format_percent(record.held_out), "of the output unexplained in held-out parts of the recording"),
            (format_percent(record.fitted), "in the fit itself"),
            (f"{len(known)} of {len(free)}", "parameters known to half of their value"),
        ),
        lead=lead,
        next_step=(
            f"symid hysteresis {shlex.quote(source or 'FIT')} --input NAME --output NAME --validate FILE",
            "Test it on another recording",
        ),
        blocks=("== Over time ==", second, "== Parameters ==", blocks[0], facts, "== Residual ==", *further),
        more=("== Models that were tried ==", blocks[1]),
        settings=(
            ("model", record.model),
            ("samples", str(record.samples)),
            ("input", f"{record.span[0]:g} to {record.span[1]:g}"),
        ),
        conventions="work is what goes in: output times way of the input",
        units="Units are those of the file",
    )
    return write_page(path, page)


_STARTS = {
    "zero": "at rest at input zero, moved to the first sample",
    "fresh": "at rest at the first sample",
    "below": "come to the first sample from below",
    "above": "come to the first sample from above",
}


def describe_element(record: HysteresisRecord) -> dict[str, object]:
    """Return an element in plain types."""
    return {**describe_record(record), "inverse": describe_inversion(record) or None}
