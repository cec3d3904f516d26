"""Friction against velocity: measured rows as a cloud, their means, the law and its 95 % band, as inline SVG.

Input: `JointFriction`. Output: one `<svg>` element, with title and description for readers that speak.

    band: g' Cov g, g = [Phi(v), dPhi/ds c]

The curve ends at the slowest row, in each direction: below it the law is extrapolated, and the band of what
rows do not tell would be too narrow.

Supported: laws of the velocity alone; of others the curve at no load, at angle zero.
Not supported: the scatter of single rows as a band; the residual says how large it is.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.friction.poses import CONFIDENCE
from symid.friction.results import JointFriction
from symid.joint.friction_law import find_column_rates, find_columns
from symid.joint.friction_laws import get_law
from symid.report.axes import (
    Frame,
    build_axis,
    draw_axes,
    draw_legend,
    find_legend_height,
    wrap_figure,
    write_points,
)

__all__ = ["FrictionCurve", "build_friction_figure", "find_friction_curve"]

_HEIGHT = 380.0
_POINTS = 400
_STILL = 1e-3
"""Speed of the slowest row over the fastest up to which rows reach standstill."""
_LABELS = ("law", "95 % band", "mean of measured rows")
_STYLES = ("predicted", "fourth", "link")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionCurve:
    """A law over velocity: torque (V,) in N m or N at velocity (V,), half width (V,) of its 95 % band."""

    velocity: FloatArray
    torque: FloatArray
    half_width: FloatArray


def find_friction_curve(joint: JointFriction) -> FrictionCurve:
    """Return the law of a joint over the velocities that were measured, dense where it bends."""
    law = get_law(joint.estimate.law, smoothing=joint.smoothing)
    fastest = float(np.max(np.abs(joint.velocity_map.cloud_velocity), initial=0.0)) or 1.0
    slowest = joint.velocity_map.slowest
    half = np.geomspace(max(1e-4 * fastest, min(slowest, fastest)), fastest, _POINTS // 2)
    low, high = (float(part(joint.velocity_map.cloud_velocity)) for part in (np.min, np.max))
    rest = [0.0] if slowest <= _STILL * fastest else []
    velocity = np.concatenate([-half[::-1], rest, half])
    velocity = velocity[(velocity >= min(low, 0.0)) & (velocity <= max(high, 0.0))]
    inputs = {name: np.zeros(len(velocity)) for name in law.inputs} | {"velocity": velocity}
    linear, shape = np.array(joint.estimate.linear), list(joint.estimate.shape)
    columns = find_columns(law, inputs, shape)
    slopes = [columns]
    if shape:
        slopes.append(np.einsum("nps,p->ns", find_column_rates(law, inputs, shape), linear))
    gradient = np.hstack(slopes)
    size = gradient.shape[1]
    covariance = np.array(joint.estimate.covariance)[:size, :size]
    variance = np.einsum("ni,ij,nj->n", gradient, covariance, gradient)
    return FrictionCurve(
        velocity=velocity,
        torque=columns @ linear,
        half_width=CONFIDENCE * np.sqrt(np.maximum(variance, 0.0)),
    )


def _find_parts(curve: FrictionCurve, slowest: float) -> list[slice]:
    """Return the pieces of a curve: one, or one a direction where no row is near standstill."""
    cut = int(np.searchsorted(curve.velocity, 0.0))
    if slowest <= _STILL * float(np.max(np.abs(curve.velocity), initial=0.0)):
        return [slice(None)]
    return [part for part in (slice(0, cut), slice(cut, None)) if len(curve.velocity[part])]


def build_friction_figure(joint: JointFriction) -> str:
    """Return the figure of one joint."""
    curve, measured = find_friction_curve(joint), joint.velocity_map
    above = find_legend_height(_LABELS)
    bands = [curve.torque - curve.half_width, curve.torque + curve.half_width]
    frame = Frame(
        x=build_axis([measured.cloud_velocity, curve.velocity], 0.03),
        y=build_axis([measured.cloud_torque, curve.torque], 0.05),
        height=_HEIGHT + above,
        top=14.0 + above,
    )
    body = draw_axes(frame, (f"velocity ({joint.velocity_unit})", f"friction ({joint.unit})"))
    body += [
        f'<circle class="bar" cx="{x:.1f}" cy="{y:.1f}" r="1.3"/>'
        for x, y in zip(
            frame.place_x(measured.cloud_velocity), frame.place_y(measured.cloud_torque), strict=True
        )
    ]
    for part in _find_parts(curve, measured.slowest):
        x = frame.place_x(curve.velocity[part])
        for band in bands:
            inside = np.clip(band[part], frame.y.low, frame.y.high)
            body.append(f'<polyline class="line fourth" points="{write_points(x, frame.place_y(inside))}"/>')
        y = frame.place_y(curve.torque[part])
        body.append(f'<polyline class="line predicted" points="{write_points(x, y)}"/>')
    body += [
        f'<circle class="mark link" cx="{a:.1f}" cy="{b:.1f}" r="2.8"/>'
        for a, b in zip(frame.place_x(measured.velocity), frame.place_y(measured.torque), strict=True)
    ]
    body += draw_legend(_LABELS, _STYLES)
    title = f"{joint.joint}: friction against velocity"
    description = (
        f"Friction of {joint.joint} in {joint.unit} against velocity in {joint.velocity_unit}: measured "
        f"rows, their means, and the law {joint.estimate.law} with its 95 % band, from the slowest row on."
    )
    return wrap_figure(title, description, frame.height, body)
