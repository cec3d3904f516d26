"""The drawing area of a figure: axes, ticks, grid, legend, and the SVG element around them.

Input: ranges, labels with units. Output: texts of SVG, and places in the drawing area.

Supported: linear and logarithmic axes, names in place of a vertical axis.
Not supported: values that are not finite; on a logarithmic axis, values that are not positive.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from symid.arrays import FloatArray

__all__ = [
    "Axis",
    "Frame",
    "build_axis",
    "draw_axes",
    "draw_legend",
    "find_legend_height",
    "find_ticks",
    "wrap_figure",
    "write_points",
    "write_tick",
]

WIDTH = 860
_RIGHT, _BOTTOM = 14, 46
_CHARACTER = 6.7
"""Width of a character of the legend on average, in the unit of the drawing."""
_LEGEND_ROW = 19.0
_SUPERSCRIPT = str.maketrans(
    "-0123456789",
    "\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ZERO}\N{SUPERSCRIPT ONE}\N{SUPERSCRIPT TWO}\N{SUPERSCRIPT THREE}"
    "\N{SUPERSCRIPT FOUR}\N{SUPERSCRIPT FIVE}\N{SUPERSCRIPT SIX}\N{SUPERSCRIPT SEVEN}"
    "\N{SUPERSCRIPT EIGHT}\N{SUPERSCRIPT NINE}",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A range of values; along a logarithmic one equal ratios have equal lengths, a whole one counts."""

    low: float
    high: float
    logarithmic: bool = False
    whole: bool = False

    def find_shares(self, values: FloatArray | float) -> FloatArray:
        """Return where values lie between the ends: 0 at the low one, 1 at the high one."""
        if self.logarithmic:
            low, high = math.log10(self.low), math.log10(self.high)
            return np.asarray((np.log10(values) - low) / (high - low), dtype=np.float64)
        return np.asarray((values - self.low) / (self.high - self.low), dtype=np.float64)

    def find_ticks(self, count: int) -> tuple[float, ...]:
        """Return about `count` round numbers between the ends."""
        if not self.logarithmic:
            ticks = find_ticks(self.low, self.high, count)
            # Between two iterations there is none.
            return tuple(tick for tick in ticks if tick == round(tick)) if self.whole else ticks
        return _find_decades(self.low, self.high, count)


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Maps data to the drawing area; `top` and `left` are its margins, `height` that of the whole figure."""

    x: Axis
    y: Axis
    height: float = 270.0
    top: float = 14.0
    left: float = 74.0

    @property
    def bottom(self) -> float:
        """Return where the horizontal axis lies."""
        return self.height - _BOTTOM

    @property
    def right(self) -> float:
        """Return where the drawing area ends."""
        return float(WIDTH - _RIGHT)

    def place_x(self, values: FloatArray | float) -> FloatArray:
        """Return horizontal places in the drawing."""
        return self.left + self.x.find_shares(values) * (self.right - self.left)

    def place_y(self, values: FloatArray | float) -> FloatArray:
        """Return vertical places in the drawing, which grow downwards."""
        return self.bottom - self.y.find_shares(values) * (self.bottom - self.top)


def build_axis(arrays: Sequence[FloatArray], margin: float, *, logarithmic: bool = False) -> Axis:
    """Return the axis of all values of `arrays`, with `margin` as a part of its length on either side."""
    low = min(float(np.min(array)) for array in arrays)
    high = max(float(np.max(array)) for array in arrays)
    if logarithmic:
        # At least a factor of three, so that there is a tick to read.
        middle, half = math.sqrt(low * high), max(math.sqrt(high / low), math.sqrt(3.0))
        ratio = half ** (1.0 + 2.0 * margin)
        return Axis(low=middle / ratio, high=middle * ratio, logarithmic=True)
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        # A constant still needs an axis of some length.
        half = 0.5 * max(abs(low), 1.0)
        return Axis(low=low - half, high=high + half)
    return Axis(low=low - margin * (high - low), high=high + margin * (high - low))


def find_ticks(low: float, high: float, count: int = 6) -> tuple[float, ...]:
    """Return about `count` round numbers between `low` and `high`.

    Their steps are 1, 2 or 5 times a power of ten.
    """
    raw = (high - low) / count
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return tuple(k * step for k in range(first, last + 1))


def _find_decades(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return powers of ten between `low` and `high`, every so many; with 2 and 5 times them where few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    inside = [power for power in range(first, last + 1) if low <= _raise(power) <= high]
    if len(inside) > 2:
        step = math.ceil(len(inside) / count)
        return tuple(_raise(power) for power in inside if power % step == 0)
    values = [factor * _raise(power) for power in range(first, last + 1) for factor in (1.0, 2.0, 5.0)]
    return tuple(value for value in values if low <= value <= high)


def _raise(power: int) -> float:
    return float(f"1e{power}")


def draw_axes(frame: Frame, labels: tuple[str, str], *, names: bool = False) -> list[str]:
    """Return grid, numbers and labels; with `names` the rows are named elsewhere, and have no numbers."""
    top, bottom, left, right = frame.top, frame.bottom, frame.left, frame.right
    parts = []
    for tick in frame.x.find_ticks(8):
        x = frame.place_x(tick)
        text = write_tick(tick, logarithmic=frame.x.logarithmic)
        parts.append(f'<line class="grid" x1="{x:.1f}" y1="{top:g}" x2="{x:.1f}" y2="{bottom:g}"/>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 17:g}" text-anchor="middle">{text}</text>')
    for tick in () if names else frame.y.find_ticks(max(5, int((bottom - top) / 42))):
        y = frame.place_y(tick)
        text = write_tick(tick, logarithmic=frame.y.logarithmic)
        parts.append(f'<line class="grid" x1="{left:g}" y1="{y:.1f}" x2="{right:g}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{left - 7:g}" y="{y + 4:.1f}" text-anchor="end">{text}</text>')
    parts.append(f'<path class="axis" d="M{left:g},{top:g}V{bottom:g}H{right:g}"/>')
    places = (
        f'x="{(left + right) / 2:.0f}" y="{frame.height - 8:g}"',
        f'transform="translate(16 {(top + bottom) / 2:.0f}) rotate(-90)"',
    )
    parts += [
        f'<text {place} text-anchor="middle">{escape(label)}</text>'
        for place, label in zip(places, labels, strict=True)
        if label
    ]
    return parts


def find_legend_height(labels: Sequence[str]) -> float:
    """Return how much the legend of `labels` needs above the drawing area."""
    return _LEGEND_ROW * len(_break_legend(labels)) if len(labels) > 1 else 0.0


def draw_legend(labels: Sequence[str], styles: Sequence[str]) -> list[str]:
    """Return a legend in rows above the drawing area, flush right."""
    parts = []
    for row, indices in enumerate(_break_legend(labels)):
        x = WIDTH - _RIGHT - sum(_find_entry_width(labels[index]) for index in indices)
        y = 14.0 + _LEGEND_ROW * row
        for index in indices:
            ends = f'x1="{x:.0f}" y1="{y - 4:g}" x2="{x + 26:.0f}" y2="{y - 4:g}"'
            parts.append(f'<line class="line {styles[index]}" {ends}/>')
            parts.append(f'<text x="{x + 31:.0f}" y="{y:g}">{escape(labels[index])}</text>')
            x += _find_entry_width(labels[index])
    return parts


def _find_entry_width(label: str) -> float:
    return 31.0 + _CHARACTER * len(label) + 16.0


def _break_legend(labels: Sequence[str]) -> list[list[int]]:
    """Return which labels stand in which row."""
    rows: list[list[int]] = [[]]
    width = 0.0
    for index, label in enumerate(labels):
        need = _find_entry_width(label)
        if rows[-1] and width + need > WIDTH - 90:
            rows.append([])
            width = 0.0
        rows[-1].append(index)
        width += need
    return rows


def write_tick(value: float, *, logarithmic: bool = False) -> str:
    """Return a number as it stands at an axis."""
    if logarithmic and not 1e-3 <= value < 1e4:
        power = math.floor(math.log10(value) + 1e-9)
        factor = value / _raise(power)
        head = "10" if abs(factor - 1.0) < 1e-6 else f"{factor:g}\N{MULTIPLICATION SIGN}10"
        return head + str(power).translate(_SUPERSCRIPT)
    return f"{value:.6g}".replace("-", "\N{MINUS SIGN}") if abs(value) > 1e-300 else "0"


def write_points(x: FloatArray, y: FloatArray) -> str:
    """Return places in the drawing as the points of a polyline."""
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def wrap_figure(title: str, description: str, height: float, body: Sequence[str]) -> str:
    """Return the `<svg>` element, with title and description for readers that speak."""
    head = (
        f'<svg viewBox="0 0 {WIDTH} {height:g}" role="img" xmlns="http://www.w3.org/2000/svg">'
        f"<title>{escape(title)}</title><desc>{escape(description)}</desc>"
    )
    return head + "".join(body) + "</svg>"
