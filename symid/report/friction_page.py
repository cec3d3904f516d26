"""The page of friction.

`FrictionIdentification` -> `Page` with verdict; for each joint friction against velocity, its law and
parameters, how the law was chosen, what the poses say; settings.

The figure of a joint has measured rows as a cloud, their means, the law and its 95 % band:

    band: g' Cov g, g = [Phi(v), dPhi/ds c]

The curve ends at the slowest row, in each direction: below it the law is extrapolated, and the band would be
too narrow.

Supported: laws of the velocity alone; of others the curve at no load, at angle zero.
Not supported: held-out logs besides the blocks that a choice held back; the scatter of single rows as a band
(the residual says how large it is).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.identification.friction import CONFIDENCE, FrictionIdentification, JointFriction
from symid.joint_models import compute_column_derivatives, compute_columns, get_law
from symid.report.blocks import Block, Drawing, Table
from symid.report.figures import Line, build_curve_figure, build_line_figure
from symid.report.fit_text import show_law_trials, show_poses, show_residual
from symid.report.pages import Page, list_notices, list_origin, list_settings, tabulate_parameters
from symid.report.verdict import judge_friction

_HEIGHT = 380.0
_POINTS = 400
_STILL = 1e-3
"""Speed of the slowest row over the fastest up to which rows reach standstill."""
_CLOUD = (
    "Friction against velocity: single rows as points, means over intervals of velocity as rings, the law "
    "with the band in which its curve lies with 95 % confidence."
)
_TRIALS = (
    "Laws by the torque of blocks held back. Squares: squared error relative to Coulomb, viscous and "
    "constant friction. Behind: difference from the best in its standard errors over the blocks; within "
    "one, the law with the fewest unknowns is taken."
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionCurve:
    """A law over velocity: torque (V,) in N m or N at velocity (V,), half width (V,) of its 95 % band."""

    velocity: FloatArray
    torque: FloatArray
    half_width: FloatArray


def compute_friction_curve(joint: JointFriction) -> FrictionCurve:
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
    columns = compute_columns(law, inputs, shape)
    slopes = [columns]
    if shape:
        slopes.append(np.einsum("nps,p->ns", compute_column_derivatives(law, inputs, shape), linear))
    gradient = np.hstack(slopes)
    size = gradient.shape[1]
    covariance = np.array(joint.estimate.covariance)[:size, :size]
    variance = np.einsum("ni,ij,nj->n", gradient, covariance, gradient)
    return FrictionCurve(
        velocity=velocity,
        torque=columns @ linear,
        half_width=CONFIDENCE * np.sqrt(np.maximum(variance, 0.0)),
    )


def _split_at_standstill(curve: FrictionCurve, slowest: float) -> list[slice]:
    """Return the pieces of a curve: one, or one a direction where no row is near standstill."""
    cut = int(np.searchsorted(curve.velocity, 0.0))
    if slowest <= _STILL * float(np.max(np.abs(curve.velocity), initial=0.0)):
        return [slice(None)]
    return [part for part in (slice(0, cut), slice(cut, None)) if len(curve.velocity[part])]


def build_friction_figure(joint: JointFriction) -> str:
    """Return the figure of one joint."""
    curve, measured = compute_friction_curve(joint), joint.velocity_map
    shown = np.concatenate([measured.cloud_torque, curve.torque])
    # A band that is wider than all else must not squeeze it.
    bands = [
        np.clip(curve.torque + side * curve.half_width, shown.min(), shown.max()) for side in (-1.0, 1.0)
    ]
    kinds = (*(("95 % band", "fourth", band) for band in bands), ("law", "predicted", curve.torque))
    rows, means = (measured.cloud_velocity, measured.cloud_torque), (measured.velocity, measured.torque)
    lines = [
        Line(label="measured rows", style="cloud", x=rows[0], y=rows[1], joined=False),
        *(
            Line(label=label, style=style, x=curve.velocity[part], y=values[part])
            for part in _split_at_standstill(curve, measured.slowest)
            for label, style, values in kinds
        ),
        Line(label="mean of them", style="link", x=means[0], y=means[1], markers=True, joined=False),
    ]
    return build_curve_figure(
        f"{joint.joint}: friction against velocity",
        f"Friction of {joint.joint} in {joint.unit} against velocity in {joint.velocity_unit}: measured "
        f"rows, their means, and the law {joint.estimate.law} with its 95 % band, from the slowest row on.",
        (f"velocity ({joint.velocity_unit})", f"friction ({joint.unit})"),
        lines,
        height=_HEIGHT,
    )


def build_friction_page(found: FrictionIdentification) -> Page:
    """Return all that the page shows."""
    head = (
        ("law asked for", found.model),
        ("estimator", found.estimator),
        ("logs", ", ".join(found.sources)),
        ("signature of the model", found.signature),
    )
    left_out = "\n".join(f"{name}: {reason}" for name, reason in found.refused)
    return Page(
        robot=found.robot,
        subject="identified friction",
        verdict=judge_friction(found),
        blocks=(
            *(block for entry in found.joints for block in _show_joint(entry)),
            *(("== Joints without a law ==", left_out) if left_out else ()),
        ),
        settings=head + tuple(list_settings(found.settings)),
        notices=list_notices(found.notices),
        origin=list_origin(),
    )


def _show_joint(entry: JointFriction) -> Iterator[Block]:
    """Yield what the page shows of a joint."""
    estimate = entry.estimate
    yield f"== {entry.joint}: {estimate.law} =="
    yield f"    {entry.formula}"
    yield Drawing(build_friction_figure(entry), _CLOUD)
    # The meaning of a parameter stands there as words, not as a formula.
    parameters = [
        replace(line, expression="", reason="; ".join(filter(None, (line.expression, line.reason))))
        for line in estimate.parameters
    ]
    yield tabulate_parameters(parameters, "meaning")
    if estimate.refused:
        text = "These logs cannot tell the following parameters, so no value is given."
        yield Table(("name", "reason"), estimate.refused, (0, 1), text)
    yield show_residual(
        (entry.residual,), "What law and rigid part leave unexplained of the logs they were fitted to."
    )
    yield f"{_capitalise(entry.rigid)}."
    yield (
        f"{_capitalise(estimate.outcome.value)}: {estimate.ended}; {estimate.evaluations} evaluations of the "
        f"objective, {estimate.solves} linear problems."
    )
    yield f"AICc {estimate.aicc:.5g}, BIC {estimate.bic:.5g}, condition {estimate.condition:.3g}."
    if estimate.extra:
        yield from ("=== Rigid part fitted along ===", tabulate_parameters(estimate.extra, "meaning"))
    if entry.selection is not None:
        yield from ("=== How the law was chosen ===", entry.selection.verdict)
        yield show_law_trials(entry.selection, _TRIALS)
    if entry.poses is not None:
        yield from ("=== Poses of the other joints ===", f"{_capitalise(entry.poses.verdict)}.")
        yield from show_poses(entry.poses)
    yield from _draw_search(entry)


def _capitalise(text: str) -> str:
    return text[:1].upper() + text[1:]


def _draw_search(entry: JointFriction) -> Iterator[Drawing]:
    """Yield the least objective over the iterations; nothing where there were none."""
    history = [value for value in entry.estimate.history if value > 0.0]
    if len(history) >= 3:
        number = np.arange(float(len(history)))
        markers = len(history) < 40
        figure = build_line_figure(
            f"{entry.joint}: the search",
            f"Least objective of the search for the law of {entry.joint} after each iteration or generation.",
            ("iteration or generation", f"objective (({entry.unit})²)"),
            (Line(label="least objective", style="final", x=number, y=np.array(history), markers=markers),),
            logarithmic=True,
            whole=True,
        )
        yield Drawing(figure, "The search: least objective so far.")
