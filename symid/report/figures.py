"""Figures of lines as inline SVG: over time, over iterations, as curves in a plane.

Input: lines with labels and units. Output: one `<svg>` element, with title and description for readers that
speak, in colours that hold on light and dark ground.

Supported: linear and logarithmic axes; at most 2000 points a line, thinned so that its shape stays.
Not supported: values that are not finite; values on a logarithmic axis that are not positive are left out.
"""

from collections.abc import Sequence
from dataclasses import replace

from symid.arrays import FloatArray
from symid.report.axes import (
    Frame,
    build_axis,
    draw_axes,
    draw_legend,
    find_legend_height,
    wrap_figure,
    write_points,
)
from symid.report.lines import Line, thin_curve, thin_line

__all__ = ["build_curve_figure", "build_line_figure"]

_HEIGHT, _CURVE_HEIGHT = 251.0, 420.0


def build_line_figure(
    title: str,
    description: str,
    labels: tuple[str, str],
    lines: Sequence[Line],
    *,
    logarithmic: bool = False,
    whole: bool = False,
) -> str:
    """Return lines over a common horizontal axis.

    Args:
        title: what is shown.
        description: the same in a sentence, for readers that speak.
        labels: of the horizontal and the vertical axis, with units.
        lines: at least one, each with at least one point.
        logarithmic: whether the vertical axis is; at least one value must be positive then.
        whole: whether the horizontal axis counts something.
    """
    if logarithmic:
        lines = [entry for entry in map(_keep_positive, lines) if len(entry.x)]
    frame = _build_frame(lines, (0.03 if whole else 0.0, 0.05), _HEIGHT, logarithmic=logarithmic)
    if whole:
        frame = replace(frame, x=replace(frame.x, whole=True))
    body = draw_axes(frame, labels)
    for line in lines:
        x, y = thin_line(line.x, line.y)
        body += _draw_line(line, frame.place_x(x), frame.place_y(y))
    return _finish(title, description, frame, body, lines)


def build_curve_figure(title: str, description: str, labels: tuple[str, str], lines: Sequence[Line]) -> str:
    """Return curves y(x) that need be no functions of x, such as hysteresis loops.

    Args:
        title: what is shown.
        description: the same in a sentence, for readers that speak.
        labels: of the horizontal and the vertical axis, with units.
        lines: at least one, each with at least one point.
    """
    frame = _build_frame(lines, (0.03, 0.05), _CURVE_HEIGHT)
    body = draw_axes(frame, labels)
    for line in lines:
        body += _draw_line(line, *thin_curve(frame.place_x(line.x), frame.place_y(line.y)))
    return _finish(title, description, frame, body, lines)


def _keep_positive(line: Line) -> Line:
    kept = line.y > 0.0
    return replace(line, x=line.x[kept], y=line.y[kept])


def _build_frame(
    lines: Sequence[Line], margins: tuple[float, float], height: float, *, logarithmic: bool = False
) -> Frame:
    above = find_legend_height([line.label for line in lines])
    return Frame(
        x=build_axis([line.x for line in lines], margins[0]),
        y=build_axis([line.y for line in lines], margins[1], logarithmic=logarithmic),
        height=height + above,
        top=14.0 + above,
    )


def _draw_line(line: Line, x: FloatArray, y: FloatArray) -> list[str]:
    """Return the line through places in the drawing."""
    parts = [f'<polyline class="line {line.style}" points="{write_points(x, y)}"/>']
    if line.markers:
        parts += [
            f'<circle class="mark {line.style}" cx="{a:.1f}" cy="{b:.1f}" r="3.2"/>'
            for a, b in zip(x, y, strict=True)
        ]
    return parts


def _finish(title: str, description: str, frame: Frame, body: list[str], lines: Sequence[Line]) -> str:
    if len(lines) > 1:
        body += draw_legend([line.label for line in lines], [line.style for line in lines])
    return wrap_figure(title, description, frame.height, body)
