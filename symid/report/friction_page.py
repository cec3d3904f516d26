"""The report of friction: one HTML file that needs nothing else.

`FrictionIdentification` -> a page with verdict; for each joint friction against velocity, its law and
parameters, how the law was chosen, what the poses say; settings.

The figure of a joint has measured rows as a cloud, their means, the law and its 95 % band:

    band: g' Cov g, g = [Phi(v), dPhi/ds c]

The curve ends at the slowest row, in each direction: below it the law is extrapolated, and the band would be
too narrow.

Supported: printing, light and dark screens, screen readers; no scripts, no network; laws of the velocity
alone; of others the curve at no load, at angle zero.
Not supported: more than one robot on a page; held-out logs besides the blocks that a choice held back; the
scatter of single rows as a band (the residual says how large it is).
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from symid import __version__
from symid.arrays import FloatArray
from symid.identification.estimators import ParameterEstimate
from symid.identification.friction import (
    CONFIDENCE,
    FrictionIdentification,
    JointFriction,
    LawSelection,
    PoseTest,
)
from symid.identification.rigid import write_file
from symid.joint_models import compute_column_derivatives, compute_columns, get_law
from symid.report.figures import (
    Line,
    PlotArea,
    build_axis,
    build_line_figure,
    draw_axes,
    draw_legend,
    format_points,
    measure_legend,
    wrap_figure,
)
from symid.report.pages import (
    ParameterLine,
    ResidualLine,
    build_parameter_line,
    build_residual_line,
    list_settings,
    render_page,
)
from symid.report.verdict import FitVerdict, apply_caps

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
    above = measure_legend(_LABELS)
    bands = [curve.torque - curve.half_width, curve.torque + curve.half_width]
    frame = PlotArea(
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
    for part in _split_at_standstill(curve, measured.slowest):
        x = frame.place_x(curve.velocity[part])
        for band in bands:
            inside = np.clip(band[part], frame.y.low, frame.y.high)
            body.append(f'<polyline class="line fourth" points="{format_points(x, frame.place_y(inside))}"/>')
        y = frame.place_y(curve.torque[part])
        body.append(f'<polyline class="line predicted" points="{format_points(x, y)}"/>')
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


_TEMPLATE = "friction.html.jinja"
_LARGE, _HUGE = 10.0, 30.0
"""Percent of the torque left unexplained beyond which a law is not good, and poor."""
_SAME = 1.2


@dataclass(frozen=True, slots=True, kw_only=True)
class JointPage:
    """What the page shows of a joint; empty texts and tables where there is nothing to show."""

    joint: str
    law: str
    formula: str
    words: tuple[str, ...]
    cloud: str
    search: str
    parameters: tuple[ParameterLine, ...]
    rigid: tuple[ParameterLine, ...]
    refused: tuple[tuple[str, str], ...]
    residual: tuple[ResidualLine, ...]
    choice: str
    trials: tuple[tuple[str, ...], ...]
    pose_verdict: str
    pose_names: tuple[str, ...]
    pose_rows: tuple[tuple[str, ...], ...]
    pose_places: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionPage:
    """The context of the page: its fields are the template's variables."""

    robot: str
    verdict: FitVerdict
    joints: tuple[JointPage, ...]
    left_out: tuple[tuple[str, str], ...]
    settings: tuple[tuple[str, str], ...]
    notices: tuple[str, ...]
    origin: tuple[str, ...]


def write_friction_report(path: Path, found: FrictionIdentification) -> Path:
    """Write the page to `path`, at once or not at all, and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_file(path, render_page(_TEMPLATE, build_friction_report(found)))


def build_friction_report(found: FrictionIdentification) -> FrictionPage:
    """Return all that the page shows."""
    head = (
        ("law asked for", found.model),
        ("estimator", found.estimator),
        ("logs", ", ".join(found.sources)),
        ("signature of the model", found.signature),
    )
    return FrictionPage(
        robot=found.robot,
        verdict=judge_friction(found),
        joints=tuple(map(_build_joint_page, found.joints)),
        left_out=found.refused,
        settings=head + tuple(list_settings(found.settings)),
        notices=tuple(dict.fromkeys(map(str, found.notices))),
        origin=(f"Written by symid {__version__}",),
    )


def _build_joint_page(entry: JointFriction) -> JointPage:
    estimate = entry.estimate
    ending = (
        f"{estimate.outcome.value[:1].upper()}{estimate.outcome.value[1:]}: {estimate.ended}; "
        f"{estimate.evaluations} evaluations of the objective, {estimate.solves} linear problems."
    )
    words = (
        f"{entry.rigid[:1].upper()}{entry.rigid[1:]}.",
        ending,
        f"AICc {estimate.aicc:.5g}, BIC {estimate.bic:.5g}, condition {estimate.condition:.3g}.",
    )
    poses = entry.poses
    return JointPage(
        joint=entry.joint,
        law=estimate.law,
        formula=entry.formula,
        words=words,
        cloud=build_friction_figure(entry),
        search=_draw_search(entry),
        parameters=tuple(build_parameter_line(_put_meaning(line)) for line in estimate.parameters),
        rigid=tuple(map(build_parameter_line, estimate.extra)),
        refused=estimate.refused,
        residual=(build_residual_line(entry.residual),),
        choice="" if entry.selection is None else entry.selection.verdict,
        trials=() if entry.selection is None else _list_trials(entry.selection),
        pose_verdict="" if poses is None else f"{poses.verdict[:1].upper()}{poses.verdict[1:]}.",
        pose_names=() if poses is None else _name_poses(poses),
        pose_rows=() if poses is None else _list_poses(poses),
        pose_places=() if poses is None else _place_poses(poses),
    )


def _put_meaning(entry: ParameterEstimate) -> ParameterEstimate:
    """Return the parameter with its meaning as words, not as a formula."""
    return replace(entry, expression="", reason="; ".join(filter(None, (entry.expression, entry.reason))))


def _draw_search(entry: JointFriction) -> str:
    """Return the least objective over the iterations; nothing where there were none."""
    history = [value for value in entry.estimate.history if value > 0.0]
    if len(history) < 3:
        return ""
    import numpy as np

    line = Line(
        label="least objective",
        style="final",
        x=np.arange(len(history), dtype=np.float64),
        y=np.array(history),
        markers=len(history) < 40,
    )
    return build_line_figure(
        f"{entry.joint}: the search",
        f"Least objective of the search for the law of {entry.joint} after each iteration or generation.",
        ("iteration or generation", f"objective (({entry.unit})²)"),
        (line,),
        logarithmic=True,
        whole=True,
    )


def _list_trials(selection: LawSelection) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (
            trial.law,
            str(trial.unknowns),
            _format_number(trial.fitted_percent, ".4f"),
            _format_number(trial.held_percent, ".4f"),
            _format_number(trial.held_rms, ".4g"),
            _format_number(trial.ratio, ".4f"),
            _format_number(trial.behind, ".1f"),
            "taken" if trial.law == selection.chosen else trial.reason,
        )
        for trial in selection.trials
    )


def _format_number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _name_poses(poses: PoseTest) -> tuple[str, ...]:
    return ("name", *(f"pose {k}" for k in range(1, len(poses.poses) + 1)), "unit", "chance")


def _list_poses(poses: PoseTest) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (
            entry.name,
            *(f"{low:.4g} to {high:.4g}" for low, high in entry.intervals),
            entry.unit,
            f"{entry.chance:.2g}",
        )
        for entry in poses.parameters
    )


def _place_poses(poses: PoseTest) -> tuple[str, ...]:
    places = [
        f"pose {k}: {', '.join(f'{name} at {place:.3g}' for name, place in pose.others)}; "
        f"{', '.join(pose.sources)}"
        for k, pose in enumerate(poses.poses, start=1)
    ]
    return (*places, *(f"left out: {sources}: {reason}" for sources, reason in poses.skipped))


def judge_friction(found: FrictionIdentification) -> FitVerdict:
    """Return what the result is worth: how well what was held back is predicted, what is not known."""
    tried = [entry for entry in found.joints if entry.selection is not None]
    names = ", ".join(f"{entry.joint}: {entry.estimate.law}" for entry in found.joints)
    level, headline = "fair", f"Laws of friction: {names}. Nothing that was held back has tested them."
    if tried and len(tried) == len(found.joints):
        ratio = max(map(_compute_held_out_ratio, tried))
        same = ratio <= _SAME
        level = "good" if same else "fair"
        headline = (
            f"Laws of friction: {names}. Blocks held back are predicted "
            + ("as well as" if same else f"{ratio:.2g} times worse than")
            + " those fitted."
        )
    caps: list[tuple[str, str]] = []
    worst = max(entry.residual.relative_percent for entry in found.joints)
    if worst > _LARGE:
        cap = "poor" if worst > _HUGE else "fair"
        caps.append((cap, f"{worst:.3g} % of a torque is left unexplained"))
    lost = [f"{name} of {entry.joint}" for entry in found.joints for name, _ in entry.estimate.refused]
    if lost:
        caps.append(("fair", f"these logs do not tell {', '.join(lost)}"))
    details = [entry.selection.verdict for entry in tried if entry.selection is not None]
    details += [f"{entry.poses.verdict}." for entry in found.joints if entry.poses is not None]
    details += [f"{name}: {reason}." for name, reason in found.refused]
    return apply_caps(level, headline, details, caps)


def _compute_held_out_ratio(entry: JointFriction) -> float:
    """Return the error held back over that fitted, of the law taken."""
    if entry.selection is None:
        return 1.0
    taken = next(trial for trial in entry.selection.trials if trial.law == entry.selection.chosen)
    if not taken.fitted_percent or taken.held_percent is None:
        return 1.0
    return taken.held_percent / taken.fitted_percent
