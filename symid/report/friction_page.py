"""The page of friction.

`FrictionIdentification` -> `Page`; the figure of a joint has measured rows, their means, law and 95 % band:

    band: g' Cov g, g = [Phi(v), dPhi/ds c]

The curve ends at the slowest row, in each direction: an extrapolated band would be too narrow.

Supported: laws of the velocity alone; of others the curve at no load, at angle zero.
Not supported: held-out logs besides the blocks of a choice; the scatter of single rows as a band.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.identification.friction import (
    CONFIDENCE,
    FrictionIdentification,
    JointFriction,
    compute_law_sensitivities,
)
from symid.joint_models import compute_friction_torque, get_law
from symid.report.blocks import Block, Drawing
from symid.report.figures import Line, build_curve_figure, build_line_figure
from symid.report.fit_text import show_law_trials, show_motion, show_poses, show_residual
from symid.report.pages import Page, build_fit_page, show_refused, tabulate_parameters
from symid.report.verdict import judge_friction

_POINTS = 400
_STILL = 1e-3
"""Speed of the slowest row over the fastest up to which rows reach standstill."""
_TRIALS = (
    "Friction laws by their residual on held-out blocks. Squares: squared error relative to Coulomb + "
    "viscous + offset. Behind: difference from the best law in standard errors over the blocks; within one, "
    "the law with the fewest parameters is chosen."
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
    linear, shape = list(joint.estimate.linear), list(joint.estimate.shape)
    gradient = compute_law_sensitivities(law, inputs, linear, shape)
    size = gradient.shape[1]
    covariance = np.array(joint.estimate.covariance)[:size, :size]
    variance = np.einsum("ni,ij,nj->n", gradient, covariance, gradient)
    return FrictionCurve(
        velocity=velocity,
        torque=compute_friction_torque(law, inputs, linear, shape),
        half_width=CONFIDENCE * np.sqrt(np.maximum(variance, 0.0)),
    )


def build_friction_figure(joint: JointFriction) -> Drawing:
    """Return the figure of one joint: one curve, or one a direction where no row is near standstill."""
    curve, measured = compute_friction_curve(joint), joint.velocity_map
    shown = np.concatenate([measured.cloud_torque, curve.torque])
    # A band that is wider than all else must not squeeze it.
    bands = [
        np.clip(curve.torque + side * curve.half_width, shown.min(), shown.max()) for side in (-1.0, 1.0)
    ]
    kinds = (*(("95 % band", "fourth", band) for band in bands), ("law", "predicted", curve.torque))
    cut = int(np.searchsorted(curve.velocity, 0.0))
    pieces = [part for part in (slice(0, cut), slice(cut, None)) if len(curve.velocity[part])]
    if measured.slowest <= _STILL * float(np.max(np.abs(curve.velocity), initial=0.0)):
        pieces = [slice(None)]
    lines = [
        Line("measured rows", "cloud", measured.cloud_velocity, measured.cloud_torque, joined=False),
        *(
            Line(label, style, curve.velocity[part], values[part])
            for part in pieces
            for label, style, values in kinds
        ),
        Line("mean of them", "link", measured.velocity, measured.torque, markers=True, joined=False),
    ]
    return build_curve_figure(
        f"Friction of {joint.joint} against velocity: measured rows, their means over intervals of velocity, "
        f"and the law {joint.estimate.law} with its 95 % confidence band.",
        (f"velocity ({joint.velocity_unit})", f"friction ({joint.unit})"),
        lines,
        height=380.0,
    )


def build_friction_page(found: FrictionIdentification) -> Page:
    """Return all that the page shows."""
    left_out = "\n".join(f"{name}: {reason}" for name, reason in found.refused)
    blocks = (
        *(block for entry in found.joints for block in _show_joint(entry)),
        *(("== Joints without a law ==", left_out) if left_out else ()),
    )
    settings = {"requested law": found.model, "estimator": found.estimator}
    verdict = judge_friction(found)
    return build_fit_page(
        found, subject="identified friction", verdict=verdict, blocks=blocks, settings=settings
    )


def _show_joint(entry: JointFriction) -> Iterator[Block]:
    estimate = entry.estimate
    yield f"== {entry.joint}: {estimate.law} =="
    yield f"    {entry.formula}"
    yield build_friction_figure(entry)
    yield tabulate_parameters(estimate.parameters, formulas=False)
    yield from show_refused(estimate.refused)
    yield show_residual((entry.residual,), "Residual of law and rigid part in the logs of the fit.")
    yield from show_motion((entry.motion,) if entry.motion is not None else ())
    yield f"{_capitalise(entry.rigid)}."
    yield (
        f"{_capitalise(estimate.outcome.value)}: {estimate.ended}; evaluations of the objective: "
        f"{estimate.evaluations}, linear problems: {estimate.solves}."
    )
    yield f"AICc {estimate.aicc:.5g}, BIC {estimate.bic:.5g}, condition number {estimate.condition:.3g}."
    if estimate.extra:
        yield from ("=== Rigid part ===", tabulate_parameters(estimate.extra, formulas=False))
    if entry.selection is not None:
        yield from ("=== Choice of the law ===", entry.selection.verdict)
        yield show_law_trials(entry.selection, _TRIALS)
    if entry.poses is not None:
        yield from ("=== Poses of the other joints ===", f"{_capitalise(entry.poses.verdict)}.")
        yield from show_poses(entry.poses)
    history = [value for value in estimate.history if value > 0.0]
    if len(history) >= 3:
        number, markers = np.arange(float(len(history))), len(history) < 40
        line = Line("objective", "final", number, np.array(history), markers)
        yield build_line_figure(
            "The search: least objective after each iteration or generation.",
            ("iteration or generation", f"objective (({entry.unit})²)"),
            (line,),
            logarithmic=True,
            whole=True,
        )


def _capitalise(text: str) -> str:
    return text[:1].upper() + text[1:]
