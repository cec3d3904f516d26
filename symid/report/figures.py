"""Figures as inline SVG: lines over time, histograms.

Input: arrays with labels and units. Output: one `<svg>` element, with title and description for
readers that speak, in colours that hold on light and dark ground.

Supported: at most 2000 points a line, thinned so that every peak stays.
Not supported: logarithmic axes, values that are not finite.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

import numpy as np

from symid.arrays import FloatArray

__all__ = ["Line", "build_histogram", "build_line_figure", "find_ticks", "thin_line"]

POINTS = 2000
_WIDTH, _HEIGHT = 860, 270
_LEFT, _RIGHT, _TOP, _BOTTOM = 74, 12, 14, 46


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """A line of a figure; `style` is a class of the page's style sheet."""

    label: str
    style: str
    x: FloatArray
    y: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Frame:
    """Maps data to the drawing area, both axes linear."""

    x: tuple[float, float]
    y: tuple[float, float]

    def place_x(self, value: float) -> float:
        share = (value - self.x[0]) / (self.x[1] - self.x[0])
        return _LEFT + share * (_WIDTH - _LEFT - _RIGHT)

    def place_y(self, value: float) -> float:
        share = (value - self.y[0]) / (self.y[1] - self.y[0])
        return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)


def build_line_figure(title: str, description: str, labels: tuple[str, str], lines: Sequence[Line]) -> str:
    """Return lines over a common horizontal axis.

    Args:
        title: what is shown.
        description: the same in a sentence, for readers that speak.
        labels: of the horizontal and the vertical axis, with units.
        lines: at least one, each with at least one point.
    """
    frame = _Frame(
        x=_find_range([line.x for line in lines], 0.0), y=_find_range([line.y for line in lines], 0.05)
    )
    body = _draw_axes(frame, labels)
    for line in lines:
        x, y = thin_line(line.x, line.y)
        points = " ".join(f"{frame.place_x(a):.1f},{frame.place_y(b):.1f}" for a, b in zip(x, y, strict=True))
        body.append(f'<polyline class="line {line.style}" points="{points}"/>')
    if len(lines) > 1:
        body += _draw_legend(lines)
    return _wrap(title, description, body)


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
    low, high = _find_range([values], 0.0)
    counts, edges = np.histogram(values, bins=bins, range=(low, high))
    x = np.linspace(low, high, 201)
    mean, deviation = float(np.mean(values)), float(np.std(values))
    width = (high - low) / bins
    normal = np.zeros_like(x)
    if deviation > 0.0:
        scale = len(values) * width / (deviation * math.sqrt(2.0 * math.pi))
        normal = scale * np.exp(-0.5 * ((x - mean) / deviation) ** 2)
    frame = _Frame(x=(low, high), y=(0.0, 1.05 * max(float(counts.max()), float(normal.max()), 1.0)))
    body = _draw_axes(frame, labels)
    for count, (left, right) in zip(counts, pairwise(edges), strict=True):
        start, top = frame.place_x(left), frame.place_y(count)
        size = f'width="{frame.place_x(right) - start:.1f}" height="{frame.place_y(0.0) - top:.1f}"'
        body.append(f'<rect class="bar" x="{start:.1f}" y="{top:.1f}" {size}/>')
    points = " ".join(
        f"{frame.place_x(a):.1f},{frame.place_y(b):.1f}" for a, b in zip(x, normal, strict=True)
    )
    body.append(f'<polyline class="line predicted" points="{points}"/>')
    return _wrap(title, description, body)


def thin_line(x: FloatArray, y: FloatArray, points: int = POINTS) -> tuple[FloatArray, FloatArray]:
    """Return at most `points` points that keep the smallest and largest value of every stretch."""
    if len(x) <= points:
        return x, y
    edges = np.linspace(0, len(x), points // 2 + 1).astype(int)
    kept: set[int] = set()
    for start, end in pairwise(edges):
        kept |= {int(start + np.argmin(y[start:end])), int(start + np.argmax(y[start:end]))}
    index = np.array(sorted(kept))
    return x[index], y[index]


def find_ticks(low: float, high: float, count: int = 6) -> tuple[float, ...]:
    """Return about `count` round numbers between `low` and `high`.

    Their steps are 1, 2 or 5 times a power of ten.
    """
    raw = (high - low) / count
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return tuple(k * step for k in range(first, last + 1))


def _find_range(arrays: Sequence[FloatArray], margin: float) -> tuple[float, float]:
    low = min(float(np.min(array)) for array in arrays)
    high = max(float(np.max(array)) for array in arrays)
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        # A constant still needs an axis of some length.
        half = 0.5 * max(abs(low), 1.0)
        return low - half, high + half
    return low - margin * (high - low), high + margin * (high - low)


def _draw_axes(frame: _Frame, labels: tuple[str, str]) -> list[str]:
    bottom, right = _HEIGHT - _BOTTOM, _WIDTH - _RIGHT
    parts = []
    for tick in find_ticks(*frame.x, count=8):
        x = frame.place_x(tick)
        parts.append(f'<line class="grid" x1="{x:.1f}" y1="{_TOP}" x2="{x:.1f}" y2="{bottom}"/>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 17}" text-anchor="middle">{_write(tick)}</text>')
    for tick in find_ticks(*frame.y, count=5):
        y = frame.place_y(tick)
        parts.append(f'<line class="grid" x1="{_LEFT}" y1="{y:.1f}" x2="{right}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{_LEFT - 7}" y="{y + 4:.1f}" text-anchor="end">{_write(tick)}</text>')
    parts.append(f'<path class="axis" d="M{_LEFT},{_TOP}V{bottom}H{right}"/>')
    places = (
        f'x="{(_LEFT + right) / 2:.0f}" y="{_HEIGHT - 8}"',
        f'transform="translate(16 {(_TOP + bottom) / 2:.0f}) rotate(-90)"',
    )
    parts += [
        f'<text {place} text-anchor="middle">{escape(label)}</text>'
        for place, label in zip(places, labels, strict=True)
    ]
    return parts


def _draw_legend(lines: Sequence[Line]) -> list[str]:
    parts = []
    x = _WIDTH - _RIGHT - 110 * len(lines)
    for line in lines:
        parts.append(
            f'<line class="line {line.style}" x1="{x}" y1="{_TOP - 4}" x2="{x + 22}" y2="{_TOP - 4}"/>'
        )
        parts.append(f'<text x="{x + 27}" y="{_TOP}">{escape(line.label)}</text>')
        x += 110
    return parts


def _write(value: float) -> str:
    return f"{value:.6g}".replace("-", "\N{MINUS SIGN}") if abs(value) > 1e-300 else "0"


def _wrap(title: str, description: str, body: Sequence[str]) -> str:
    head = (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" xmlns="http://www.w3.org/2000/svg">'
        f"<title>{escape(title)}</title><desc>{escape(description)}</desc>"
    )
    return head + "".join(body) + "</svg>"
