"""The pose test: does friction of a joint depend on where the other joints stand?

Input: recordings in each of which one joint moves and the others hold a pose. Output: `PoseTest`: a fit per
pose, parameters with their confidence intervals side by side, a verdict.

    T = sum_p w_p (x_p - mean)^2 / (poses - 1) / (1 + 2 (poses - 2) / (poses^2 - 1) h)
    w_p = 1 / s_p^2,   mean weighted by w_p,   h = sum_p (1 - w_p / sum w)^2 / f_p
    T ~ F(poses - 1, (poses^2 - 1) / (3 h))                                   (Welch 1951)

The deviations s_p, of f_p degrees of freedom, are those of `patterns`: a law that misses something, or noise
with a memory, leaves a pattern, which would make every pose look different.

Supported: any number of poses from two on; several recordings of one pose are fitted together; poses whose
recordings tell too little are left out, with the reason.
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
from symid.friction.patterns import PatternCovariance, find_pattern_covariance, find_robust_deviations
from symid.friction.reduction import find_rows
from symid.joint.friction_law import FrictionLaw, find_column_rates, find_columns, find_torque

__all__ = ["CONFIDENCE", "Pose", "PoseParameter", "PoseTest", "find_chance", "find_pose_test", "find_poses"]

CONFIDENCE = 1.959963984540054
"""Standard deviations on either side of a 95 % interval."""
_SIGNIFICANT = 0.01
_SAME_POSE = 0.02
"""Difference of the others' positions, rad or m, up to which poses count as one."""
_COARSE = 0.2
"""Change of the friction curve, over the largest friction, that a test must be able to see to be one."""


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
        freedom: degrees of freedom of each of `stds`; empty for many.
    """

    name: str
    unit: str
    values: tuple[float, ...]
    stds: tuple[float, ...]
    chance: float
    freedom: tuple[float, ...] = ()

    @property
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """Return the 95 % interval at every pose."""
        half = [CONFIDENCE] * len(self.values)
        if self.freedom:
            from scipy.stats import t

            half = [float(t.ppf(0.975, freedom)) for freedom in self.freedom]
        return tuple(
            (value - factor * std, value + factor * std)
            for value, std, factor in zip(self.values, self.stds, half, strict=True)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseTest:
    """Whether friction depends on the pose.

    Args:
        law: that was fitted at each pose.
        poses: in the order of the recordings.
        parameters: those that every pose can tell.
        change: largest difference of the friction curves between two poses, relative to the largest
            friction, over the speeds that all poses have; None for laws of more than the speed, and where
            a pose leaves a parameter untold.
        differs: whether a parameter differs more than chance explains.
        verdict: that in words.
        skipped: recordings of poses that could not be fitted, with the reason.
    """

    law: str
    poses: tuple[Pose, ...]
    parameters: tuple[PoseParameter, ...]
    change: float | None
    differs: bool
    verdict: str
    skipped: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PoseFit:
    """The fit at a pose: deviations and degrees of freedom of the law's parameters, the range of speeds."""

    estimate: FrictionEstimate
    deviations: dict[str, tuple[float, float]]
    covariance: PatternCovariance
    slow: float
    fast: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Change:
    """Change of the friction curve between poses, and how large it may be by chance (95 %)."""

    size: float
    doubt: float


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
        options: of variable projection, which fits the poses whatever estimator fits the whole.
        beta: (p,) base parameters that are known; None to fit them.
    """
    poses = find_poses(library, logs, joint)
    if len(poses) < 2:
        return None
    fits: list[_PoseFit] = []
    fitted: list[Pose] = []
    skipped: list[tuple[str, str]] = []
    for pose in poses:
        try:
            fits.append(_fit_pose(library, logs, joint, law, pose=pose, options=options, beta=beta))
        except SymidError as error:
            skipped.append((", ".join(pose.sources), "; ".join(entry.text for entry in error.notices)))
        else:
            fitted.append(pose)
    enough = len(fits) > 1
    parameters = _compare(law, fits) if enough else ()
    change = _find_change(law, fits) if enough else None
    return PoseTest(
        law=law.name,
        poses=tuple(fitted),
        parameters=parameters,
        change=None if change is None else change.size,
        differs=_find_least_chance(parameters) < _SIGNIFICANT,
        verdict=_write_verdict(library.card.joints[joint].name, law, fits, parameters, change),
        skipped=tuple(skipped),
    )


def _fit_pose(
    library: Library,
    logs: JointLogs,
    joint: int,
    law: FrictionLaw,
    *,
    pose: Pose,
    options: FrictionOptions | None,
    beta: FloatArray | None,
) -> _PoseFit:
    samples = extract_joint(library, logs, joint, runs=pose.runs, beta=beta).samples
    estimate = fit_friction(samples, law, options=options)
    speeds = np.abs(find_rows(samples).velocity)
    return _PoseFit(
        estimate=estimate,
        deviations=find_robust_deviations(samples, law, estimate),
        covariance=find_pattern_covariance(samples, law, estimate),
        slow=float(np.quantile(speeds, 0.02)),
        fast=float(speeds.max()),
    )


def _compare(law: FrictionLaw, fits: Sequence[_PoseFit]) -> tuple[PoseParameter, ...]:
    found = []
    for entry in law.physical:
        if not all(entry.name in fit.deviations for fit in fits):
            continue
        values = np.array([fit.estimate.get_value(entry.name) for fit in fits], dtype=np.float64)
        stds, freedom = np.array([fit.deviations[entry.name] for fit in fits]).T
        if not np.all((stds > 0.0) & np.isfinite(stds)):
            continue
        unit = next(p.unit for p in fits[0].estimate.parameters if p.name == entry.name)
        found.append(
            PoseParameter(
                name=entry.name,
                unit=unit,
                values=tuple(map(float, values)),
                stds=tuple(map(float, stds)),
                chance=find_chance(values, stds, freedom),
                freedom=tuple(map(float, freedom)),
            )
        )
    return tuple(found)


def find_chance(values: FloatArray, stds: FloatArray, freedom: FloatArray) -> float:
    """Return the probability of such differences if there were none, by Welch's test of several means."""
    from scipy.stats import f

    count = len(values)
    weights = 1.0 / stds**2
    shares = weights / np.sum(weights)
    distance = np.sum(weights * (values - np.sum(shares * values)) ** 2) / (count - 1)
    small = float(np.sum((1.0 - shares) ** 2 / freedom))
    statistic = float(distance / (1.0 + 2.0 * (count - 2) / (count**2 - 1) * small))
    return float(f.sf(statistic, count - 1, (count**2 - 1) / (3.0 * small)))


def _find_change(law: FrictionLaw, fits: Sequence[_PoseFit]) -> _Change | None:
    """Return the largest difference of two friction curves, relative to the largest friction."""
    slow, fast = max(fit.slow for fit in fits), min(fit.fast for fit in fits)
    told = all(entry.name in fit.deviations for fit in fits for entry in law.physical)
    if not told or law.inputs != ("velocity",) or not 0.0 < slow < fast:
        return None
    speeds = np.geomspace(slow, fast, 100)
    inputs = {"velocity": np.concatenate([-speeds[::-1], speeds])}
    curves = np.stack([find_torque(law, inputs, fit.estimate.linear, fit.estimate.shape) for fit in fits])
    bands = np.sort(np.stack([_find_band(law, inputs, fit) for fit in fits]), axis=0)
    largest = float(np.max(np.abs(curves)))
    if largest == 0.0:
        return None
    return _Change(
        size=float(np.max(np.ptp(curves, axis=0))) / largest,
        doubt=float(np.max(np.hypot(bands[-1], bands[-2]))) / largest,
    )


def _find_band(law: FrictionLaw, inputs: dict[str, FloatArray], fit: _PoseFit) -> FloatArray:
    """Return the half width of the 95 % band of a pose's friction curve, N m or N."""
    from scipy.stats import t

    shape = list(fit.estimate.shape)
    slopes = [find_columns(law, inputs, shape)]
    if shape:
        rates = find_column_rates(law, inputs, shape)
        slopes.append(np.einsum("nps,p->ns", rates, np.array(fit.estimate.linear)))
    beside = np.zeros((len(slopes[0]), len(fit.estimate.other)))
    deviations, freedom = fit.covariance.find_deviations(np.hstack([*slopes, beside]))
    return np.asarray(deviations * t.ppf(0.975, freedom))


def _find_least_chance(parameters: Sequence[PoseParameter]) -> float:
    """Return the least probability, times how many were looked at (Bonferroni)."""
    return min((entry.chance for entry in parameters), default=1.0) * max(len(parameters), 1)


def _write_verdict(
    joint: str,
    law: FrictionLaw,
    fits: Sequence[_PoseFit],
    parameters: Sequence[PoseParameter],
    change: _Change | None,
) -> str:
    poses = len(fits)
    if poses < 2:
        return f"friction of {joint!r} can be fitted at {poses or 'none'} of its poses only: nothing compares"
    if not parameters:
        return (
            f"friction of {joint!r} at {poses} poses: no parameter is known at all of them, nothing compares"
        )
    limit = _SIGNIFICANT / len(parameters)
    apart = [entry for entry in parameters if entry.chance < limit]
    size = (
        "" if change is None else f"; between poses the friction curve changes by {100 * change.size:.2g} %"
    )
    if apart:
        shown = ", ".join(f"{entry.name} ({_spread(entry)})" for entry in apart)
        return f"friction of {joint!r} depends on the pose: {shown}, more than chance explains{size}"
    if change is None and all(map(_is_coarse, parameters)):
        shown = ", ".join(f"{entry.name} ({_spread(entry)})" for entry in parameters)
        return (
            f"friction of {joint!r} is too uncertain to compare at these {poses} poses: {shown}, with "
            "intervals wider than the values; record more or longer motions at each"
        )
    if change is not None and change.doubt > _COARSE:
        return (
            f"friction of {joint!r} is too uncertain to compare at these {poses} poses: its curve could "
            f"differ by {100.0 * change.doubt:.2g} % by chance; record more or longer motions at each"
        )
    if any(len(fit.deviations) < len(law.physical) for fit in fits):
        names = ", ".join(entry.name for entry in parameters)
        return (
            f"friction of {joint!r} shows no difference between these {poses} poses in {names}; the others "
            "are not known at all poses, so that the curves do not compare"
        )
    return (
        f"friction of {joint!r} does not depend on the pose as far as these {poses} can tell: all "
        f"differences are within their uncertainty{size}"
    )


def _is_coarse(entry: PoseParameter) -> bool:
    """Return whether a pose tells less of a parameter than that it is there at the surest one."""
    surest = abs(entry.values[int(np.argmin(entry.stds))])
    return max(0.5 * (high - low) for low, high in entry.intervals) > surest


def _spread(entry: PoseParameter) -> str:
    return f"{min(entry.values):.4g} to {max(entry.values):.4g} {entry.unit}".rstrip()
