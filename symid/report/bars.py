"""Figures of how often, and how far: histograms, and medians with their 90th percentiles.

Input: values with labels and units. Output: one `<svg>` element, with title and description for readers that
speak.

Supported: names of any length that fits a line; linear and logarithmic axes.
Not supported: values that are not finite.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

import numpy as np

from symid.arrays import FloatArray
from symid.report.axes import (
    WIDTH,
    Axis,
    Frame,
    build_axis,
    draw_axes,
    wrap_figure,
    write_points,
)

__all__ = ["Interval", "build_histogram", "build_interval_figure"]

_HEIGHT = 270.0
_ROW = 34.0
_LOGARITHMIC = 8.0
"""Ratio of the largest to the smallest value from which on the axis is logarithmic."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A value, or the median of several with their 90th percentile.

    Args:
        label: of what.
        middle: the value, or the median.
        high: the 90th percentile, None for a single value.
        text: the figures as they stand next to the mark.
        chosen: whether it is to stand out.
    """

    label: str
    middle: float
    high: float | None = None
    text: str = ""
    chosen: bool = False


def build_histogram(
    title: str, description: str, labels: tuple[str, str], values: FloatArray, *, bins: int = 41
) -> str:
    """Return how often values occur, with the normal distribution of the same mean and deviation.

    Args:
        title: what is shown.
        description: the same in a sentence, for readers that speak.
        labels: of the horizontal and the vertical axis, with units.
        values: (N,), at least one.
        bins: how many of equal width.
    """
    axis = build_axis([values], 0.0)
    low, high = axis.low, axis.high
    counts, edges = np.histogram(values, bins=bins, range=(low, high))
    x = np.linspace(low, high, 201)
    mean, deviation = float(np.mean(values)), float(np.std(values))
    width = (high - low) / bins
    normal = np.zeros_like(x)
    if deviation > 0.0:
        scale = len(values) * width / (deviation * math.sqrt(2.0 * math.pi))
        normal = scale * np.exp(-0.5 * ((x - mean) / deviation) ** 2)
    largest = max(float(counts.max()), float(normal.max()), 1.0)
    frame = Frame(x=axis, y=Axis(low=0.0, high=1.05 * largest), height=_HEIGHT)
    body = draw_axes(frame, labels)
    for count, (left, right) in zip(counts, pairwise(edges), strict=True):
        start, top = frame.place_x(left), frame.place_y(float(count))
        size = f'width="{frame.place_x(right) - start:.1f}" height="{frame.place_y(0.0) - top:.1f}"'
        body.append(f'<rect class="bar" x="{start:.1f}" y="{top:.1f}" {size}/>')
    points = write_points(frame.place_x(x), frame.place_y(normal))
    body.append(f'<polyline class="line predicted" points="{points}"/>')
    return wrap_figure(title, description, frame.height, body)


def build_interval_figure(title: str, description: str, label: str, intervals: Sequence[Interval]) -> str:
    """Return values in rows, a mark for each value or median and a line to its 90th percentile.

    Marks, not bars, because the axis is logarithmic where the values differ by more than a factor.

    Args:
        title: what is shown.
        description: the same in a sentence, for readers that speak.
        label: of the horizontal axis, with its unit.
        intervals: at least one, from top to bottom.
    """
    ends = np.array(
        [value for entry in intervals for value in (entry.middle, entry.high) if value is not None]
    )
    logarithmic = bool(ends.min() > 0.0 and ends.max() / ends.min() > _LOGARITHMIC)
    axis = build_axis([ends] if logarithmic else [np.append(ends, 0.0)], 0.04, logarithmic=logarithmic)
    left = 24.0 + 7.0 * max(len(entry.label) for entry in intervals)
    # The figures stand right of the marks and need room even there.
    room = 18.0 + 6.7 * max(len(entry.text) for entry in intervals)
    axis = _widen(axis, room / (WIDTH - left - room))
    height = 60.0 + _ROW * len(intervals)
    frame = Frame(x=axis, y=Axis(low=float(len(intervals)), high=0.0), height=height, left=left)
    body = draw_axes(frame, (label, ""), names=True)
    for row, entry in enumerate(intervals):
        body += _draw_interval(frame, float(frame.place_y(row + 0.5)), entry)
    return wrap_figure(title, description, height, body)


def _widen(axis: Axis, share: float) -> Axis:
    """Return the axis, longer at its high end by a part of its length."""
    if axis.logarithmic:
        high = axis.high * (axis.high / axis.low) ** share
    else:
        high = axis.high + share * (axis.high - axis.low)
    return Axis(low=axis.low, high=high, logarithmic=axis.logarithmic)


def _draw_interval(frame: Frame, y: float, entry: Interval) -> list[str]:
    style = "chosen" if entry.chosen else "other"
    x = float(frame.place_x(entry.middle))
    end = x
    place = f'x="{frame.left - 9:g}" y="{y + 4:.1f}" text-anchor="end"'
    parts = [
        f'<line class="grid" x1="{frame.left:g}" y1="{y:.1f}" x2="{frame.right:g}" y2="{y:.1f}"/>',
        f'<text class="{style}" {place}>{escape(entry.label)}</text>',
    ]
    if entry.high is not None:
        end = float(frame.place_x(entry.high))
        path = f"M{x:.1f},{y:.1f}H{end:.1f}M{end:.1f},{y - 6:.1f}V{y + 6:.1f}"
        parts.append(f'<path class="whisker {style}" d="{path}"/>')
    parts.append(f'<circle class="mark {style}" cx="{x:.1f}" cy="{y:.1f}" r="5.5"/>')
    parts.append(
        f'<text class="{style}" x="{max(x, end) + 12:.1f}" y="{y + 4:.1f}">{escape(entry.text)}</text>'
    )
    return parts
