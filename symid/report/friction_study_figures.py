"""Figures of clouds of samples with bands and curves, as inline SVG.

Input: samples, bands, lines, with labels and units. Output: one `<svg>` element, whose classes "cloud" and
"area" the page must style.

Supported: linear axes. Not supported: values that are not finite.
"""

from collections.abc import Sequence
from dataclasses import dataclass

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
from symid.report.lines import Line, thin_curve

__all__ = ["Band", "Cloud", "build_cloud_figure"]

_HEIGHT = 330.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cloud:
    """Samples that no line joins."""

    label: str
    x: FloatArray
    y: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Band:
    """The area between two curves over rising x."""

    label: str
    x: FloatArray
    low: FloatArray
    high: FloatArray


def build_cloud_figure(
    title: str,
    description: str,
    labels: tuple[str, str],
    *,
    clouds: Sequence[Cloud] = (),
    bands: Sequence[Band] = (),
    lines: Sequence[Line] = (),
) -> str:
    """Return bands, samples above them, curves above both.

    Args:
        title: what is shown.
        description: the same in a sentence, for readers that speak.
        labels: of the horizontal and the vertical axis, with units.
        clouds: samples.
        bands: areas.
        lines: curves; at least one of all three, each with at least one point.
    """
    entries = [
        *((cloud.label, "cloud") for cloud in clouds),
        *((band.label, "band") for band in bands),
        *((line.label, line.style) for line in lines),
    ]
    above = find_legend_height([label for label, _ in entries])
    across = [cloud.x for cloud in clouds] + [band.x for band in bands] + [line.x for line in lines]
    heights = [cloud.y for cloud in clouds] + [line.y for line in lines]
    heights += [side for band in bands for side in (band.low, band.high)]
    frame = Frame(
        x=build_axis(across, 0.02), y=build_axis(heights, 0.04), height=_HEIGHT + above, top=14.0 + above
    )
    body = draw_axes(frame, labels)
    body += [_draw_band(frame, band) for band in bands]
    body += [_draw_cloud(frame, cloud) for cloud in clouds]
    for line in lines:
        x, y = thin_curve(frame.place_x(line.x), frame.place_y(line.y))
        body.append(f'<polyline class="line {line.style}" points="{write_points(x, y)}"/>')
    if len(entries) > 1:
        body += draw_legend([label for label, _ in entries], [style for _, style in entries])
    return wrap_figure(title, description, frame.height, body)


def _draw_band(frame: Frame, band: Band) -> str:
    x = frame.place_x(band.x)
    there, back = (
        write_points(x, frame.place_y(band.high)),
        write_points(x[::-1], frame.place_y(band.low)[::-1]),
    )
    return f'<polygon class="area" points="{there} {back}"/>'


def _draw_cloud(frame: Frame, cloud: Cloud) -> str:
    """Return all samples as one path of lines without length, which round caps make dots."""
    places = zip(frame.place_x(cloud.x), frame.place_y(cloud.y), strict=True)
    return f'<path class="line cloud" d="{"".join(f"M{x:.1f},{y:.1f}h0" for x, y in places)}"/>'
