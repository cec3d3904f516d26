"""Figures as inline SVG: lines, curves, clouds, areas, values in rows; arms.

Lines have at most 2000 points: functions of one variable keep every peak, curves that turn back on
themselves, such as hysteresis loops, keep their corners (Ramer 1972, Douglas and Peucker 1973).

Not supported: values that are not finite; gaps in a line. A logarithmic axis leaves out values that are not
positive.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from html import escape
from itertools import pairwise, product

import numpy as np
import scipy

from symid.arrays import FloatArray
from symid.report.blocks import SUPERSCRIPT, Drawing

WIDTH = 560
"""Of a figure: half a page on a desk, the whole of a telephone, where its letters stay legible."""
_SMALLEST, _LARGEST = 1e-300, 1e300
"""Ends of axes: the least of a logarithmic one, and the greatest. What lies beyond is not in the drawing."""
_RIGHT, _BOTTOM = 14, 46
_LONGEST_LABEL = 24
"""Letters beside a row of a figure."""
_LEAST_ROOM = 40.0
"""Of the marks of such a figure."""
_CHARACTER, _ROW = 7.2, 15.0
"""Width of a character of the legend on average, in the unit of the drawing."""
_DIGIT = 8.1
"""Width of a digit."""
_LEGEND_ROW = 19.0
STYLES = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh")
"""Of lines of equal rank: distinguished by colour and by dashes."""
POINTS = 2000
TIME = "time (s)"
_INVISIBLE = 0.15
"""Distance in the unit of the drawing below which nobody sees a corner."""
_LOGARITHMIC_RATIO = 8.0
"""Ratio of the largest to the smallest value from which on the axis is logarithmic."""
_VIEW = (math.radians(-62.0), math.radians(16.0))
"""From where an arm is seen: turned about the vertical, and from above."""
_ARM_HEIGHT = 400.0
_ROUND = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A range of values; along a logarithmic one equal ratios have equal lengths, a whole one counts."""

    low: float
    high: float
    logarithmic: bool = False
    whole: bool = False

    def compute_shares(self, values: FloatArray | float) -> FloatArray:
        """Return where values lie between the ends: 0 at the low one, 1 at the high one."""
        if self.logarithmic:
            low, high = math.log10(self.low), math.log10(self.high)
            return np.asarray((np.log10(values) - low) / (high - low), dtype=np.float64)
        return np.asarray((values - self.low) / (self.high - self.low), dtype=np.float64)

    def choose_ticks(self, count: int) -> tuple[float, ...]:
        """Return about `count` round numbers between the ends: 1, 2 or 5 times a power of ten.

        On a logarithmic axis powers of ten, every so many; with 2 and 5 times them where there are few.
        """
        low, high = self.low, self.high
        if not self.logarithmic:
            raw = (high - low) / count
            power = 10.0 ** math.floor(math.log10(raw))
            step = next(x * power for x in (1.0, 2.0, 5.0, 10.0) if x * power >= raw * (1 - 1e-9))
            first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
            ticks = tuple(k * step for k in range(first, last + 1))
            # Between two iterations there is none.
            return tuple(tick for tick in ticks if tick == round(tick)) if self.whole else ticks
        powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        inside = [power for power in powers if low <= _raise_ten(power) <= high]
        if len(inside) > 2:
            step = math.ceil(len(inside) / count)
            return tuple(_raise_ten(power) for power in inside if power % step == 0)
        values = [factor * _raise_ten(power) for power in powers for factor in (1.0, 2.0, 5.0)]
        return tuple(value for value in values if low <= value <= high)


def _raise_ten(power: int) -> float:
    # Not 10.0 ** power, which rounds.
    return float(f"1e{power}")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotArea:
    """Maps data to the drawing area; `top` and `left` are its margins, `height` that of the whole figure."""

    x: Axis
    y: Axis
    height: float = 230.0
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
        return self.left + self.x.compute_shares(values) * (self.right - self.left)

    def place_y(self, values: FloatArray | float) -> FloatArray:
        """Return vertical places in the drawing, which grow downwards."""
        return self.bottom - self.y.compute_shares(values) * (self.bottom - self.top)


def build_axis(arrays: Sequence[FloatArray], margin: float, *, logarithmic: bool = False) -> Axis:
    """Return the axis of all values of `arrays`, with `margin` as a part of its length on either side."""
    low = min(float(np.min(array)) for array in arrays)
    high = max(float(np.max(array)) for array in arrays)
    if logarithmic:
        # At least a factor of three, so that there is a tick to read.
        middle, half = math.sqrt(low * high), max(math.sqrt(high / low), math.sqrt(3.0))
        ratio = half ** (1.0 + 2.0 * margin)
        low = min(max(middle / ratio, _SMALLEST), 0.1 * _LARGEST)
        return Axis(low=low, high=min(max(middle * ratio, 10.0 * _SMALLEST), _LARGEST), logarithmic=True)
    # Further apart the length of the axis would be infinite.
    low, high = (min(max(end, -_LARGEST), _LARGEST) for end in (low, high))
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        # A constant still needs an axis of some length.
        half = 0.5 * max(abs(low), 1.0)
        return Axis(low=low - half, high=high + half)
    return Axis(low=low - margin * (high - low), high=high + margin * (high - low))


def _draw_axes(frame: PlotArea, labels: tuple[str, str], *, names: bool = False) -> list[str]:
    """Return grid, numbers and labels; with `names` the rows are named elsewhere, and have no numbers."""
    top, bottom, left, right = frame.top, frame.bottom, frame.left, frame.right
    parts = []
    for tick in frame.x.choose_ticks(5):
        x = frame.place_x(tick)
        text = format_tick(tick, logarithmic=frame.x.logarithmic)
        parts.append(f'<line class="grid" x1="{x:.1f}" y1="{top:g}" x2="{x:.1f}" y2="{bottom:g}"/>')
        # A long number at the end would be cut off.
        middle = min(float(x), WIDTH - 4.0 - 0.5 * _DIGIT * len(text))
        parts.append(f'<text x="{middle:.1f}" y="{bottom + 17:g}" text-anchor="middle">{text}</text>')
    for tick in () if names else frame.y.choose_ticks(max(5, int((bottom - top) / 42))):
        y = frame.place_y(tick)
        text = format_tick(tick, logarithmic=frame.y.logarithmic)
        parts.append(f'<line class="grid" x1="{left:g}" y1="{y:.1f}" x2="{right:g}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{left - 7:g}" y="{y + 4:.1f}" text-anchor="end">{text}</text>')
    parts = ['<g class="ticks">', *parts, "</g>"]
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


def _draw_legend(styles: Mapping[str, str]) -> tuple[list[str], float]:
    """Return a legend of labels and styles in rows flush right, and the height that it needs."""
    if len(styles) < 2:
        return [], 0.0
    rows: list[list[tuple[str, float]]] = [[]]
    for label in styles:
        width = 31.0 + _CHARACTER * len(label) + 16.0
        if rows[-1] and sum(other for _, other in rows[-1]) + width > WIDTH - 30:
            rows.append([])
        rows[-1].append((label, width))
    parts = []
    for number, row in enumerate(rows):
        x = WIDTH - _RIGHT - sum(width for _, width in row)
        y = 14.0 + _LEGEND_ROW * number
        for label, width in row:
            ends = f'x1="{x:.0f}" y1="{y - 4:g}" x2="{x + 26:.0f}" y2="{y - 4:g}"'
            parts.append(f'<line class="line {styles[label]}" {ends}/>')
            parts.append(f'<text x="{x + 31:.0f}" y="{y:g}">{escape(label)}</text>')
            x += width
    return parts, _LEGEND_ROW * len(rows)


def format_tick(value: float, *, logarithmic: bool = False) -> str:
    """Return a number as it stands at an axis."""
    if logarithmic and not 1e-3 <= value < 1e4:
        power = math.floor(math.log10(value) + 1e-9)
        factor = value / _raise_ten(power)
        head = "10" if abs(factor - 1.0) < 1e-6 else f"{factor:g}\N{MULTIPLICATION SIGN}10"
        return head + str(power).translate(SUPERSCRIPT)
    number, _, tens = f"{value:.6g}".partition("e")
    raised = f"\N{MULTIPLICATION SIGN}10{str(int(tens)).translate(SUPERSCRIPT)}" if tens else ""
    return number.replace("-", "\N{MINUS SIGN}") + raised if abs(value) > 1e-300 else "0"


def _format_points(x: FloatArray, y: FloatArray, digits: int = 1) -> str:
    return " ".join(f"{a:.{digits}f},{b:.{digits}f}" for a, b in zip(x, y, strict=True))


def _wrap_figure(caption: str, height: float, body: Sequence[str], more: str = "") -> Drawing:
    head = f'<svg viewBox="0 0 {WIDTH:g} {height:g}" role="img" xmlns="http://www.w3.org/2000/svg"{more}>'
    return Drawing(f"{head}<title>{escape(caption)}</title>{''.join(body)}</svg>", caption)


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A line y (N,) over x (N,), points, or an outline with its inside.

    Args:
        label: for the legend, which lists it once.
        style: a class of the pages' style sheet; "cloud" are points, "area" is an outline.
        x, y: (N,) values along the axes.
        markers: whether points have marks; joined: whether a line joins them.
    """

    label: str
    style: str
    x: FloatArray
    y: FloatArray
    markers: bool = False
    joined: bool = True


def list_lines(x: FloatArray, *curves: tuple[str, str, FloatArray | None]) -> list[Line]:
    """Return a line over `x` (N,) for each label, style and values (N,); None is left out."""
    return [Line(label, style, x, y) for label, style, y in curves if y is not None]


def thin_line(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return at most `POINTS` points that keep the smallest and largest value of every stretch."""
    if len(x) <= POINTS:
        return x, y
    edges = np.linspace(0, len(x), POINTS // 2 + 1).astype(int)
    ends = ((start, y[start:end]) for start, end in pairwise(edges))
    index = np.unique([start + find(part) for start, part in ends for find in (np.argmin, np.argmax)])
    return x[index], y[index]


def thin_curve(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return at most `POINTS` points of a curve, its corners first (Ramer 1972, Douglas and Peucker 1973).

    `x`, `y`: (N,) horizontal and vertical places in the drawing; what nobody sees is left out in any case.
    """
    if len(x) <= 2:
        return x, y
    kept, new = {0, len(x) - 1}, [(0, len(x) - 1)]
    waiting: list[tuple[float, int, int, int]] = []
    while len(kept) < POINTS:
        for start, end in (part for part in new if part[1] - part[0] > 1):
            # The point that lies farthest from the chord of two others.
            inner = slice(start + 1, end)
            dx, dy = x[inner] - x[start], y[inner] - y[start]
            along = np.array([x[end] - x[start], y[end] - y[start]])
            length = float(np.hypot(*along))
            if length > 0.0:
                # From the chord, not from the line through its ends: loops return to where they began.
                share = np.clip((dx * along[0] + dy * along[1]) / length**2, 0.0, 1.0)
                dx, dy = dx - share * along[0], dy - share * along[1]
            distances = np.hypot(dx, dy)
            farthest = int(np.argmax(distances))
            heappush(waiting, (-float(distances[farthest]), start + 1 + farthest, start, end))
        if not waiting or -waiting[0][0] < _INVISIBLE:
            break
        _, middle, start, end = heappop(waiting)
        kept.add(middle)
        new = [(start, middle), (middle, end)]
    index = np.array(sorted(kept))
    return x[index], y[index]


def build_line_figure(
    caption: str,
    labels: tuple[str, str],
    lines: Sequence[Line],
    *,
    logarithmic: bool = False,
    whole: bool = False,
) -> Drawing:
    """Return lines over a common horizontal axis; each has at least one point.

    The caption is also for screen readers; `labels` are those of the horizontal and the vertical axis, with
    units. A `logarithmic` vertical axis needs a positive value; a `whole` horizontal axis counts something.
    Time begins at 0.
    """
    if logarithmic:
        positive = [(line, line.y > 0.0) for line in lines]
        lines = [replace(line, x=line.x[kept], y=line.y[kept]) for line, kept in positive if kept.any()]
    if labels[0] == TIME:
        # Logs count from anywhere, such as from 1970.
        start = min(float(np.min(line.x)) for line in lines)
        lines = [replace(line, x=line.x - start) for line in lines]
    x = replace(build_axis([line.x for line in lines], 0.03 if whole else 0.0), whole=whole)
    y = build_axis([line.y for line in lines], 0.05, logarithmic=logarithmic)
    frame = PlotArea(x=x, y=y, height=230.0)
    return _build_figure(caption, labels, lines, frame, thin_line)


def build_curve_figure(
    caption: str, labels: tuple[str, str], lines: Sequence[Line], *, height: float = 340.0
) -> Drawing:
    """Return curves y(x) that need be no functions of x, such as hysteresis loops, clouds and areas.

    The other arguments are those of `build_line_figure`; later lines lie on top, `height` is without legend.
    """
    x, y = build_axis([line.x for line in lines], 0.03), build_axis([line.y for line in lines], 0.05)
    return _build_figure(caption, labels, lines, PlotArea(x=x, y=y, height=height), thin_curve)


def _build_figure(
    caption: str,
    labels: tuple[str, str],
    lines: Sequence[Line],
    frame: PlotArea,
    thin: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
) -> Drawing:
    """Return a figure with axes and legend; `thin` leaves out points of lines that nobody sees."""
    legend, above = _draw_legend({line.label: line.style for line in lines})
    # Long numbers stand clear of the label at their left.
    ticks = (format_tick(tick, logarithmic=frame.y.logarithmic) for tick in frame.y.choose_ticks(5))
    left = max(frame.left, 34.0 + _DIGIT * max(map(len, ticks), default=0))
    frame = replace(frame, height=frame.height + above, top=frame.top + above, left=left)
    body, more = _draw_axes(frame, labels), ""
    # A script reads time and values from the points: hundredths of the unit of the drawing, and the axes.
    live = labels[0] == TIME and not frame.y.logarithmic
    if live:
        sides = (frame.left, frame.top, frame.right, frame.bottom)
        ends = (*sides, frame.x.low, frame.x.high, frame.y.low, frame.y.high)
        unit = labels[1].partition("(")[2].removesuffix(")")
        more = f' data-frame="{" ".join(f"{end:.10g}" for end in ends)}" data-unit="{escape(unit)}"'
    for line in lines:
        x, y = frame.place_x(line.x), frame.place_y(line.y)
        if line.joined:
            x, y = thin(x, y)
            name = f' data-label="{escape(line.label)}"' if live else ""
            points = _format_points(x, y, 2 if live else 1)
            body.append(f'<polyline class="line {line.style}" points="{points}"{name}/>')
        elif not line.markers:
            # One path of lines without length, which round caps make dots.
            path = "".join(f"M{a:.1f},{b:.1f}h0" for a, b in zip(x, y, strict=True))
            body.append(f'<path class="line {line.style}" d="{path}"/>')
        if line.markers:
            body += [
                f'<circle class="mark {line.style}" cx="{a:.1f}" cy="{b:.1f}" r="3.2"/>'
                for a, b in zip(x, y, strict=True)
            ]
    found = _wrap_figure(caption, frame.height, [*body, *legend], more=more)
    data = FigureData(labels=labels, lines=tuple(lines), logarithmic=frame.y.logarithmic)
    return replace(found, data=data)


@dataclass(frozen=True, slots=True)
class Mark:
    """A value in a row: its name `label`, its digits `text`, and whether it was `chosen`."""

    label: str
    value: float
    text: str = ""
    chosen: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FigureData:
    """What a figure shows: lines, or marks in rows with a limit; the labels of both axes, with units.

    `logarithmic` is the axis of the values: the vertical one of lines, the horizontal one of marks.
    """

    labels: tuple[str, str]
    lines: tuple[Line, ...] = ()
    marks: tuple[Mark, ...] = ()
    limit: float | None = None
    logarithmic: bool = False


def build_mark_figure(
    caption: str, label: str, marks: Sequence[Mark], *, dense: bool = False, limit: float | None = None
) -> Drawing:
    """Return values in rows from top to bottom; `label` names the axis, with its unit.

    Marks, not bars, because the axis is logarithmic where the values differ by more than a factor. `dense`
    rows are as low as letters allow; a line stands at `limit`.
    """
    row_height, radius = (19.0, 4.0) if dense else (30.0, 5.5)
    ends = np.array([entry.value for entry in marks] + ([] if limit is None else [limit]))
    logarithmic = bool(ends.min() > 0.0 and float(ends.max()) / float(ends.min()) > _LOGARITHMIC_RATIO)
    axis = build_axis([ends] if logarithmic else [np.append(ends, 0.0)], 0.04, logarithmic=logarithmic)
    # Labels leave room for the marks: of a long sum stand the first terms, and a pointer shows the whole.
    labels, cut = [entry.label for entry in marks], _LONGEST_LABEL - 1
    for k, text in enumerate(labels):
        if len(text) > _LONGEST_LABEL:
            start = text[:cut].rpartition(" ")[0] or text[: cut - 1]
            labels[k] = f"{start} \N{HORIZONTAL ELLIPSIS}"
    left = 24.0 + 7.6 * max(map(len, labels))
    # The digits stand right of the marks and need room even there.
    room = 18.0 + _DIGIT * max(len(entry.text) for entry in marks)
    share = room / max(WIDTH - left - room, _LEAST_ROOM)
    if logarithmic:
        highest = math.log10(axis.high)
        is_beyond = highest + share * (highest - math.log10(axis.low)) > math.log10(_LARGEST)
        high = _LARGEST if is_beyond else min(axis.high * (axis.high / axis.low) ** share, _LARGEST)
    else:
        high = axis.high + share * (axis.high - axis.low)
    rows = Axis(low=float(len(marks)), high=0.0)
    height = 60.0 + row_height * len(marks)
    frame = PlotArea(x=replace(axis, high=high), y=rows, height=height, left=left)
    body = _draw_axes(frame, (label, ""), names=True)
    if limit is not None:
        x = float(frame.place_x(limit))
        body.append(
            f'<line class="line virgin" x1="{x:.1f}" y1="{frame.top:g}" x2="{x:.1f}" y2="{frame.bottom:g}"/>'
        )
    for row, (entry, name) in enumerate(zip(marks, labels, strict=True)):
        style = "chosen" if entry.chosen else "other"
        x, y = float(frame.place_x(entry.value)), float(frame.place_y(row + 0.5))
        place = f'x="{left - 9:g}" y="{y + 4:.1f}" text-anchor="end"'
        whole = "" if name == entry.label else f"<title>{escape(entry.label)}</title>"
        body += [
            f'<line class="grid" x1="{left:g}" y1="{y:.1f}" x2="{frame.right:g}" y2="{y:.1f}"/>',
            f'<text class="{style}" {place}>{escape(name)}{whole}</text>',
            f'<circle class="mark {style}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}"/>',
        ]
        if entry.text:
            body.append(f'<text class="{style}" x="{x + 12:.1f}" y="{y + 4:.1f}">{escape(entry.text)}</text>')
    data = FigureData(labels=(label, ""), marks=tuple(marks), limit=limit, logarithmic=logarithmic)
    return replace(_wrap_figure(caption, frame.height, body), data=data)


@dataclass(frozen=True, slots=True, eq=False)
class ArmJoint:
    """A joint of an arm as drawn: a drum at `place` (3,) about `axis` (3,), m, as wide as high.

    `label` is its name, `style` a class of the pages' style sheet.
    """

    place: FloatArray
    axis: FloatArray
    label: str
    style: str
    radius: float


def build_arm_figure(
    caption: str,
    links: Sequence[FloatArray],
    joints: Sequence[ArmJoint],
    *,
    frames: Sequence[FloatArray] = (),
) -> Drawing:
    """Return an arm on its base: links as lines (N, 3), joints as drums about their axes, m; z is upwards.

    `frames` (4, 4) are drawn as arrows x, y, z at their origins.
    """
    turn, tilt = _VIEW
    right = np.array([-math.sin(turn), math.cos(turn), 0.0])
    toward = np.array([math.cos(turn) * math.cos(tilt), math.sin(turn) * math.cos(tilt), math.sin(tilt)])
    view = np.vstack([right, -np.cross(toward, right)])
    size = max(joint.radius for joint in joints)
    corners = np.vstack([*links, *(joint.place for joint in joints)]) @ view.T
    room = 3.0 * size
    low, high = corners.min(axis=0) - room, corners.max(axis=0) + room
    whole = np.array([WIDTH, _ARM_HEIGHT])
    scale = float(np.min((whole - 10.0) / (high - low)))
    shift = 0.5 * whole - 0.5 * scale * (low + high)

    def place(points: FloatArray) -> FloatArray:
        return np.asarray(points @ view.T * scale + shift)

    square = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0]])
    ground = links[0][0] + 2.0 * size * square
    body = [f'<polygon class="ground" points="{_format_points(*place(ground).T)}"/>']
    body += [f'<polyline class="limb" points="{_format_points(*place(link).T)}"/>' for link in links]
    # Drums from the farthest to the nearest.
    ordered = sorted(joints, key=lambda joint: float(joint.place @ toward))
    body += [_draw_drum(place, joint, toward) for joint in ordered]
    for frame in frames:
        # The axis z is the longest.
        for k, (name, share) in enumerate((("x", 0.7), ("y", 0.7), ("z", 1.0))):
            tip = frame[:3, 3] + 3.0 * share * size * frame[:3, k]
            (x, y), (tip_x, tip_y) = place(np.array([frame[:3, 3], tip]))
            body.append(f'<path class="line frame-{name}" d="M{x:.1f},{y:.1f}L{tip_x:.1f},{tip_y:.1f}"/>')
    taken = list[tuple[float, float, float]]()
    for joint in (joint for joint in joints if joint.label):
        wide = _CHARACTER * len(joint.label)
        # The first place that is free: on the right, ever higher and lower, and then on the left.
        for side, step in product((1.45, -1.45), range(2 * len(joints) + 1)):
            x, y = place(joint.place + joint.radius * (side * right + (0.0, 0.0, 0.7)))
            left, y = x if side > 0.0 else x - wide, y + (-1) ** step * ((step + 1) // 2) * _ROW
            over = (a < left + wide and left < b and abs(y - c) < _ROW for a, b, c in taken)
            if left >= 0.0 and left + wide <= WIDTH and not any(over):
                break
        taken.append((left, left + wide, y))
        anchor = "start" if side > 0.0 else "end"
        body.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(joint.label)}</text>')
    return _wrap_figure(caption, _ARM_HEIGHT, body)


def _draw_drum(place: Callable[[FloatArray], FloatArray], joint: ArmJoint, toward: FloatArray) -> str:
    """Return the outline of a drum about the joint's axis, its near end, and a dash along the axis."""
    radius = joint.radius
    axis = joint.axis if joint.axis @ toward >= 0.0 else -joint.axis
    across = np.cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.9 else (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across)
    ring = radius * (np.outer(np.cos(_ROUND), across) + np.outer(np.sin(_ROUND), np.cross(axis, across)))
    near, far = (place(joint.place + side * radius * axis + ring) for side in (1.0, -1.0))
    points = np.vstack([near, far])
    hull = points[scipy.spatial.ConvexHull(points).vertices]
    ends = place(joint.place + np.outer([-2.0, 2.0], radius * axis))
    return (
        f'<polyline class="axle" points="{_format_points(*ends.T)}"/>'
        f'<polygon class="box {joint.style}" points="{_format_points(*hull.T)}"/>'
        f'<polygon class="box {joint.style}" points="{_format_points(*near.T)}"/>'
    )
