"""Lines of a figure, thinned so that their shape stays.

Input: arrays. Output: `Line`, and arrays of at most 2000 points.

Supported: functions of one variable, of which every peak stays; curves that turn back on themselves, such as
hysteresis loops, of which the corners stay.
Not supported: gaps in a line.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import pairwise

import numpy as np

from symid.arrays import FloatArray

__all__ = ["STYLES", "Line", "thin_curve", "thin_line"]

STYLES = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh")
"""Of lines of equal rank: told apart by colour and by dashes."""

POINTS = 2000
_INVISIBLE = 0.15
"""Distance in the unit of the drawing below which nobody sees a corner."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """A line of a figure; `style` is a class of the page's style sheet, `markers` draws its points too."""

    label: str
    style: str
    x: FloatArray
    y: FloatArray
    markers: bool = False


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


def thin_curve(
    x: FloatArray, y: FloatArray, points: int = POINTS, invisible: float = _INVISIBLE
) -> tuple[FloatArray, FloatArray]:
    """Return at most `points` points of a curve, its corners first (Ramer 1972, Douglas and Peucker 1973).

    Args:
        x: (N,) horizontal places in the drawing.
        y: (N,) vertical ones.
        points: at most.
        invisible: distance from the chord below which a point is left out in any case.
    """
    count = len(x)
    if count <= 2:
        return x, y
    kept = {0, count - 1}
    waiting: list[tuple[float, int, int, int]] = []
    _push(waiting, x, y, (0, count - 1))
    while waiting and len(kept) < points:
        distance, middle, start, end = heappop(waiting)
        if -distance < invisible:
            break
        kept.add(middle)
        for part in ((start, middle), (middle, end)):
            _push(waiting, x, y, part)
    index = np.array(sorted(kept))
    return x[index], y[index]


def _push(
    waiting: list[tuple[float, int, int, int]], x: FloatArray, y: FloatArray, part: Sequence[int]
) -> None:
    """Add the point between two others that lies farthest from their chord."""
    start, end = part
    if end - start < 2:
        return
    inner = slice(start + 1, end)
    dx, dy = x[inner] - x[start], y[inner] - y[start]
    along = np.array([x[end] - x[start], y[end] - y[start]])
    length = float(np.hypot(*along))
    if length > 0.0:
        # Distance from the chord, not from the line through its ends: loops return to where they began.
        share = np.clip((dx * along[0] + dy * along[1]) / length**2, 0.0, 1.0)
        dx, dy = dx - share * along[0], dy - share * along[1]
    distances = np.hypot(dx, dy)
    farthest = int(np.argmax(distances))
    heappush(waiting, (-float(distances[farthest]), start + 1 + farthest, start, end))
