"""Figures of symid in axes of matplotlib: the same values, in the reader's own colours and fonts.

`Drawing` with its data, axes -> artists in these axes. They are made by methods of the axes, so nothing of
matplotlib is imported; `pip install 'symid[plot]'` brings it.

Supported: lines, clouds, outlines, values in rows. Not supported: the skeleton of an arm, flow charts and
histograms, which have no such data.
"""

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import Any

from symid.errors import Notice, UsageError
from symid.report.blocks import Drawing
from symid.report.figures import FigureData, Line, Mark

_NEEDED = ("plot", "fill", "axvline", "set_xlabel", "legend")


def list_axes(given: object) -> list[Any]:
    """Return axes of matplotlib: one, or a sequence or array of them.

    Raises:
        UsageError: something else was given; the message says what to install where matplotlib is missing.
    """
    axes = list(_flatten(given))
    if axes and all(hasattr(entry, name) for entry in axes for name in _NEEDED):
        return axes
    text = "expected axes of matplotlib, as `matplotlib.pyplot.subplots()` returns them"
    if find_spec("matplotlib") is None:
        text += "; matplotlib is not installed: pip install 'symid[plot]'"
    raise UsageError(Notice(code="usage.axes", text=f"ax: {text}"))


def _flatten(given: object) -> Iterator[object]:
    inner = getattr(given, "flat", given)
    if inner is not given or (isinstance(inner, Sequence) and not isinstance(inner, str)):
        for entry in inner:  # type: ignore[attr-defined]  # an array's iterator
            yield from _flatten(entry)
    else:
        yield given


def draw_into(axes: object, drawings: Sequence[Drawing]) -> None:
    """Draw the first figures that have data into axes, one into each; axes that are left over stay empty.

    Raises:
        UsageError: `axes` are none of matplotlib.
    """
    shown = (entry.data for entry in drawings if isinstance(entry.data, FigureData))
    for ax, data in zip(list_axes(axes), shown, strict=False):
        known = set[str]()
        for line in data.lines:
            # A legend lists a label once.
            _draw_line(ax, line, f"_{line.label}" if line.label in known else line.label)
            known.add(line.label)
        if data.marks:
            _draw_marks(ax, data.marks)
        if data.limit is not None:
            ax.axvline(data.limit, linestyle="--", color="gray")
        if data.logarithmic:
            (ax.set_xscale if data.marks else ax.set_yscale)("log")
        ax.set_xlabel(data.labels[0])
        ax.set_ylabel(data.labels[1])
        if len(known) > 1:
            ax.legend()


def _draw_line(ax: Any, line: Line, label: str) -> None:  # noqa: ANN401  of matplotlib
    if line.style == "area":
        ax.fill(line.x, line.y, alpha=0.2, label=label)
        return
    marker = "o" if line.markers else None if line.joined else "."
    ax.plot(line.x, line.y, label=label, marker=marker, linestyle="-" if line.joined else "none")


def _draw_marks(ax: Any, marks: Sequence[Mark]) -> None:  # noqa: ANN401  of matplotlib
    rows = range(len(marks))
    ax.plot([entry.value for entry in marks], rows, marker="o", linestyle="none")
    ax.set_yticks(rows, [entry.label for entry in marks])
    ax.invert_yaxis()
