"""The pose test: does friction of a joint depend on where the other joints stand?

Input: recordings in each of which one joint moves and the others hold a pose. Output: `PoseTest`: a fit per
pose, parameters with their confidence intervals side by side, a verdict.

    chi^2 = sum_p (x_p - mean)^2 / s_p^2,   mean weighted by 1 / s_p^2, poses - 1 degrees of freedom

The deviations s_p are the larger ones of two: for independent noise, and over blocks of consecutive rows
(Liang and Zeger 1986), because a law that misses something leaves a pattern, which would make every pose look
different.

Supported: any number of poses from two on; several recordings of one pose are fitted together.
Not supported: poses that differ in load or temperature without a recording of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.errors import SymidError
from symid.friction.estimate import FrictionEstimate
from symid.friction.estimators import fit_friction
from symid.friction.extraction import JointLogs, extract_joint
from symid.friction.options import FrictionOptions
from symid.friction.reduction import find_rows
from symid.friction.samples import FrictionSamples
from symid.friction.selection import predict_rows
from symid.joint.friction_law import FrictionLaw, find_column_rates, find_columns, find_torque

__all__ = ["Pose", "PoseParameter", "PoseTest", "find_pose_test", "find_poses", "find_robust_deviations"]

CONFIDENCE = 1.959963984540054
"""Standard deviations on either side of a 95 % interval."""
_SIGNIFICANT = 0.01
_SAME_POSE = 0.02
"""Difference of the others' positions, rad or m, up to which poses count as one."""
_BLOCKS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where the other joints stood: (name, rad or m) of each, and in which recordings."""

    others: tuple[tuple[str, float], ...]
    runs: tuple[int, ...]
    sources: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseParameter:
    """A parameter at every pose.

    Args:
        name, unit: of the parameter.
        values, stds: one a pose.
        chance: probability of differences as large as these, if there were none.
    """

    name: str
    unit: str
    values: tuple[float, ...]
    stds: tuple[float, ...]
    chance: float

    @property
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """Return the 95 % interval at every pose."""
        return tuple(
            (value - CONFIDENCE * std, value + CONFIDENCE * std)
            for value, std in zip(self.values, self.stds, strict=True)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseTest:
    """Whether friction depends on the pose.

    Args:
        law: that was fitted at each pose.
        poses: in the order of the recordings.
        parameters: those that every pose can tell.
        change: largest difference of the friction curves between two poses, relative to the largest
            friction, over the speeds that all poses have; None for laws of more than the speed.
        differs: whether a parameter differs more than chance explains.
        verdict: that in words.
    """

    law: str
    poses: tuple[Pose, ...]
    parameters: tuple[PoseParameter, ...]
    change: float | None
    differs: bool
    verdict: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PoseFit:
    """The fit at a pose, with deviations of the law's physical parameters and the range of speeds."""

    estimate: FrictionEstimate
    deviations: dict[str, float]
    slow: float
    fast: float


def find_poses(library: Library, logs: JointLogs, joint: int) -> tuple[Pose, ...]:
    """Return the poses at which a joint was moved alone."""
    names = [card.name for card in library.card.joints]
    others = [k for k in range(len(names)) if k != joint]
    groups: list[tuple[FloatArray, list[int]]] = []
    for run in logs.find_alone(joint):
        place = logs.signals[run].q[:, others].mean(axis=0)
        near = [entry for entry in groups if np.all(np.abs(entry[0] - place) <= _SAME_POSE)]
        if near:
            near[0][1].append(run)
        else:
            groups.append((place, [run]))
    return tuple(
        Pose(
            others=tuple((names[k], float(value)) for k, value in zip(others, place, strict=True)),
            runs=tuple(runs),
            sources=tuple(logs.sources[run] for run in runs),
        )
        for place, runs in groups
    )


def find_pose_test(
    library: Library,
    logs: JointLogs,
    joint: int,
    law: FrictionLaw,
    *,
    options: FrictionOptions | None = None,
    beta: FloatArray | None = None,
) -> PoseTest | None:
    """Return the test, None where the joint was moved alone at less than two poses.

    Args:
        library: as for `extract_joint`.
        logs: of `prepare_joint_logs`.
        joint: its number among those with a coordinate, from 0.
        law: fitted at each pose.
        options: of variable projection.
        beta: (p,) base parameters that are known; None to fit them.
    """
    poses = find_poses(library, logs, joint)
    fits: list[_PoseFit] = []
    fitted: list[Pose] = []
    for pose in poses if len(poses) > 1 else ():
        samples = extract_joint(library, logs, joint, runs=pose.runs, beta=beta).samples
        try:
            estimate = fit_friction(samples, law, options=options or FrictionOptions())
        except SymidError:
            continue
        speeds = np.abs(find_rows(samples).velocity)
        fits.append(
            _PoseFit(
                estimate=estimate,
                deviations=find_robust_deviations(samples, law, estimate),
                slow=float(np.quantile(speeds, 0.02)),
                fast=float(speeds.max()),
            )
        )
        fitted.append(pose)
    if len(fits) < 2:
        return None
    parameters = _compare(law, fits)
    change = _find_change(law, fits)
    return PoseTest(
        law=law.name,
        poses=tuple(fitted),
        parameters=parameters,
        change=change,
        differs=_find_least_chance(parameters) < _SIGNIFICANT,
        verdict=_write_verdict(library.card.joints[joint].name, len(fits), parameters, change),
    )


def find_robust_deviations(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> dict[str, float]:
    """Return standard deviations of the law's physical parameters that hold for noise with a pattern, too."""
    shape = list(estimate.shape)
    columns = [find_columns(law, samples.inputs, shape)]
    if shape:
        rates = find_column_rates(law, samples.inputs, shape)
        columns.append(np.einsum("nps,p->ns", rates, np.array(estimate.linear)))
    jacobian = samples.pass_columns(np.hstack([*columns, samples.extra]))
    rows = find_rows(samples)
    error = rows.torque - predict_rows(samples, law, estimate)
    lengths = np.linalg.norm(jacobian, axis=0)
    scales = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    inverse = np.linalg.pinv((jacobian * scales).T @ (jacobian * scales), rcond=1e-12)
    meat = np.zeros_like(inverse)
    for run in np.unique(rows.run):
        members = np.flatnonzero(rows.run == run)
        for block in np.array_split(members, min(_BLOCKS, len(members))):
            score = (jacobian[block] * scales).T @ error[block]
            meat += np.outer(score, score)
    covariance = scales[:, None] * (inverse @ meat @ inverse) * scales
    mixing = np.array(law.mixing, dtype=np.float64)
    count = mixing.shape[1]
    robust = np.sqrt(np.maximum(np.diag(mixing @ covariance[:count, :count] @ mixing.T), 0.0))
    stated = {entry.name: entry.std for entry in estimate.parameters}
    return {
        entry.name: max(float(robust[k]), stated[entry.name])
        for k, entry in enumerate(law.physical)
        if entry.name in stated
    }


def _compare(law: FrictionLaw, fits: Sequence[_PoseFit]) -> tuple[PoseParameter, ...]:
    from scipy.stats import chi2

    found = []
    for entry in law.physical:
        if not all(entry.name in fit.deviations for fit in fits):
            continue
        values = np.array([fit.estimate.get_value(entry.name) for fit in fits], dtype=np.float64)
        stds = np.array([fit.deviations[entry.name] for fit in fits])
        if not np.all((stds > 0.0) & np.isfinite(stds)):
            continue
        weights = 1.0 / stds**2
        mean = np.sum(weights * values) / np.sum(weights)
        distance = float(np.sum(weights * (values - mean) ** 2))
        unit = next(p.unit for p in fits[0].estimate.parameters if p.name == entry.name)
        found.append(
            PoseParameter(
                name=entry.name,
                unit=unit,
                values=tuple(map(float, values)),
                stds=tuple(map(float, stds)),
                chance=float(chi2.sf(distance, len(fits) - 1)),
            )
        )
    return tuple(found)


def _find_change(law: FrictionLaw, fits: Sequence[_PoseFit]) -> float | None:
    """Return the largest difference of two friction curves, relative to the largest friction."""
    slow, fast = max(fit.slow for fit in fits), min(fit.fast for fit in fits)
    if law.inputs != ("velocity",) or not 0.0 < slow < fast:
        return None
    speeds = np.geomspace(slow, fast, 100)
    inputs = {"velocity": np.concatenate([-speeds[::-1], speeds])}
    curves = np.stack([find_torque(law, inputs, fit.estimate.linear, fit.estimate.shape) for fit in fits])
    return float(np.max(np.ptp(curves, axis=0)) / np.max(np.abs(curves)))


def _find_least_chance(parameters: Sequence[PoseParameter]) -> float:
    """Return the least probability, times how many were looked at (Bonferroni)."""
    return min((entry.chance for entry in parameters), default=1.0) * len(parameters)


def _write_verdict(joint: str, poses: int, parameters: Sequence[PoseParameter], change: float | None) -> str:
    if not parameters:
        return (
            f"friction of {joint!r} at {poses} poses: no parameter is known at all of them, nothing compares"
        )
    size = (
        f"; between poses the friction curve changes by {100.0 * change:.2g} %" if change is not None else ""
    )
    limit = _SIGNIFICANT / len(parameters)
    apart = [entry for entry in parameters if entry.chance < limit]
    if not apart:
        return (
            f"friction of {joint!r} does not depend on the pose as far as these {poses} can tell: all "
            f"differences are within their uncertainty{size}"
        )
    shown = ", ".join(f"{entry.name} ({_spread(entry)})" for entry in apart)
    return f"friction of {joint!r} depends on the pose: {shown}, more than chance explains{size}"


def _spread(entry: PoseParameter) -> str:
    return f"{min(entry.values):.4g} to {max(entry.values):.4g} {entry.unit}".rstrip()
