"""Correlated residuals, and the pose test: does friction depend on where the other joints are?

Samples, law, fit -> PatternCovariance, a warning; recordings at several poses -> PoseTest.

    cov = P J' Omega J P,    P = (J'J)^+,    J: sensitivities of the rows
    T = sum_p w_p (x_p - mean)^2 / (poses - 1) / (1 + 2 (poses - 2) / (poses^2 - 1) h),   w_p = 1 / s_p^2
    mean weighted by w_p,   h = sum_p (1 - w_p / sum w)^2 / f_p,   T ~ F(poses - 1, (poses^2 - 1) / (3 h))

(Welch 1951). Omega is the worst of three: white noise; products of the residual over blocks of rows (Liang
and Zeger 1986); the spectrum of an autoregression of each recording's residual, its order by AIC, its gain
at rest corrected for short records by (1 + k + 2 order) / rows. A variance f times that of white noise has
1/f of the rows as degrees of freedom f_p. Recordings of one pose are fitted together.
Not supported: noise whose size changes with velocity, other than over blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy

from symid.arrays import FloatArray
from symid.errors import Notice, SymidError
from symid.identification.diagnostics import build_warning, sum_block_scores
from symid.identification.friction import joint_fit
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.extraction import JointLogs, extract_joint
from symid.identification.friction.joint_fit import FrictionEstimate, FrictionSamples
from symid.identification.friction.selection import predict_rows
from symid.identification.judge import POLICY, adjust_chances, numerics
from symid.joint_models import FrictionLaw, compute_friction_torque, compute_law_sensitivities
from symid.serialization import name_key


class PatternCovariance(NamedTuple):
    """Covariances (n, n) of (linear, shape, other): white noise, blocks of rows, an autoregression.

    `freedom` is rows less unknowns, `block_freedom` blocks less one.
    """

    white: FloatArray
    blocks: FloatArray
    memory: FloatArray
    freedom: float
    block_freedom: float

    def compute_deviations(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the deviations (m,) of combinations `rows` (m, n), and their degrees of freedom (m,)."""
        parts = (
            np.einsum("ij,jk,ik->i", rows, part, rows) for part in (self.white, self.blocks, self.memory)
        )
        white, blocks, memory = np.maximum(list(parts), 0.0)
        most = np.maximum(np.maximum(white, blocks), memory)
        share = np.divide(white, most, out=np.ones_like(most), where=most > 0.0)
        freedom, by_blocks = self.freedom * share, (blocks >= most) & (most > white)
        freedom = np.where(by_blocks, np.minimum(freedom, self.block_freedom), freedom)
        return np.sqrt(most), np.maximum(freedom, 1.0)


def estimate_pattern_covariance(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> PatternCovariance:
    """Return the covariances of a fit of `law` to `samples`."""
    design = joint_fit.compute_sensitivities(samples, law, estimate.linear, estimate.shape)
    rows = samples.rows
    error = rows.torque - predict_rows(samples, law, estimate)
    lengths = np.linalg.norm(design, axis=0)
    scales = np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)
    scaled = design * scales
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12)
    unknowns = int(np.linalg.matrix_rank(inverse)) if inverse.any() else 0
    freedom = max(len(error) - unknowns, 1)
    blocks, count = sum_block_scores(scaled, error, rows.run, 20)
    memory = np.zeros_like(inverse)
    for run in np.unique(rows.run):
        members = np.flatnonzero(rows.run == run)
        # J' Omega J of one recording (n, n), by an autoregression of the residual.
        size, (factors, variance) = len(members), _fit_autoregression(error[members])
        gain = float(factors.sum())
        if gain > 0.0:
            bias = (1 + unknowns + 2 * len(factors)) / size
            factors = factors * (min(gain + bias, 1.0 - 1.0 / size) / gain)
        # Four times the length, so that the circular autocorrelation does not reach the rows.
        wide = int(2 ** np.ceil(np.log2(4 * size)))
        turns = np.exp(-2j * np.pi * np.arange(wide // 2 + 1) / wide)
        powers = turns[:, None] ** np.arange(1, len(factors) + 1)
        weight = variance / np.abs(1.0 - powers @ factors) ** 2
        weight[1:-1] *= 2.0
        passed = np.fft.rfft(scaled[members], wide, axis=0)
        part = ((passed.conj() * weight[:, None]).T @ passed).real / wide
        memory += part * len(error) / freedom
    blocks *= count / max(count - 1, 1)
    spread = scales[:, None] * inverse
    return PatternCovariance(
        white=np.array(estimate.covariance, dtype=np.float64),
        blocks=spread @ blocks @ spread.T,
        memory=spread @ memory @ spread.T,
        freedom=float(freedom),
        block_freedom=float(max(count - 1, 1)),
    )


def _fit_autoregression(error: FloatArray) -> tuple[FloatArray, float]:
    """Return the factors of an autoregression, its order by AIC, and its noise's variance."""
    most = min(20, len(error) // 25)
    later = error[most:]
    best: tuple[FloatArray, float] = (np.zeros(0), float(np.mean(error**2)))
    if not most or not np.any(later):
        return best
    earlier = np.column_stack([error[most - lag : len(error) - lag] for lag in range(1, most + 1)])
    square, gram, cross = float(later @ later), earlier.T @ earlier, earlier.T @ later
    least = len(later) * np.log(square / len(later))
    for order in range(1, most + 1):
        factors = np.linalg.lstsq(gram[:order, :order], cross[:order], rcond=1e-13)[0]
        variance = max((square - float(factors @ cross[:order])) / len(later), 1e-15 * square / len(later))
        score = len(later) * np.log(variance) + 2.0 * order
        if score < least:
            least, best = score, (np.asarray(factors, dtype=np.float64), variance)
    return best


def compute_robust_deviations(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> tuple[dict[str, tuple[float, float]], PatternCovariance]:
    """Return (deviation, degrees of freedom) of the law's identifiable parameters, and all covariances."""
    covariance = estimate_pattern_covariance(samples, law, estimate)
    mixing = np.zeros((len(law.physical), len(covariance.white)))
    mixing[:, : len(law.linear) + len(law.shape)] = np.array(law.mixing, dtype=np.float64)
    found = np.array(covariance.compute_deviations(mixing)).T.tolist()
    known = {entry.name for entry in estimate.parameters}
    pairs = zip(law.physical, found, strict=True)
    return {entry.name: (std, dof) for entry, (std, dof) in pairs if entry.name in known}, covariance


def warn_of_friction_pattern(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> tuple[Notice, ...]:
    """Return a warning where the residual is correlated, so that stated deviations are too small."""
    robust, _ = compute_robust_deviations(samples, law, estimate)
    # A fit to the last bit leaves rounding, whose correlation means nothing.
    known = [one for one in estimate.parameters if one.std > 1e-12 * max(abs(one.value), numerics.TINY)]
    ratios = {entry.name: robust[entry.name][0] / entry.std for entry in known}
    far = {name: ratio for name, ratio in ratios.items() if ratio > 2.0}
    return (build_warning("friction.pattern", names=", ".join(far), ratio=max(far.values())),) if far else ()


CONFIDENCE = float(-scipy.special.ndtri((1.0 - POLICY.confidence) / 2.0))
"""Standard deviations on either side of a 95 % interval."""


@dataclass(frozen=True, slots=True)
class HeldPose:
    """Positions of the other joints, (name, rad or m) of each, and the recordings."""

    others: tuple[tuple[str, float], ...]
    runs: tuple[int, ...]
    sources: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseParameter:
    """A parameter at every pose, degrees of freedom (none for many), and the p-value of equal values."""

    name: str
    unit: str
    values: tuple[float, ...]
    stds: tuple[float, ...] = field(metadata=name_key("std"))
    chance: float
    freedom: tuple[float, ...] = field(default=(), metadata=name_key("degrees_of_freedom"))

    @property
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """Return the 95 % interval at every pose."""
        freedom = self.freedom or (np.inf,) * len(self.values)
        low, high = scipy.stats.t.interval(POLICY.confidence, freedom, self.values, self.stds)
        return tuple(zip(low.tolist(), high.tolist(), strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseTest:
    """Whether friction depends on the pose.

    Args:
        law: that was fitted at each pose; poses: in the order of the recordings.
        parameters: those identifiable at every pose.
        change: largest difference of the friction curves between two poses, relative to the largest friction,
            over common speeds; None for laws of more than the speed, and where a pose has refused parameters.
        differs: whether a parameter differs significantly; verdict: that in words.
        skipped: recordings of poses that could not be fitted, with the reason.
    """

    law: str
    poses: tuple[HeldPose, ...]
    parameters: tuple[PoseParameter, ...]
    change: float | None
    differs: bool
    verdict: str
    skipped: tuple[tuple[str, str], ...] = ()


_PoseFit = tuple[FrictionEstimate, dict[str, tuple[float, float]], PatternCovariance, tuple[float, float]]
"""The fit at a pose, (deviation, degrees of freedom) of parameters, covariances, the range of speeds."""


def list_poses(logs: JointLogs, joint: int) -> tuple[HeldPose, ...]:
    """Return the poses at which a joint was moved alone."""
    names = [card.name for card in logs.library.card.joints]
    others = [k for k in range(len(names)) if k != joint]
    groups: list[tuple[FloatArray, list[int]]] = []
    for run in logs.list_alone(joint):
        place = logs.signals[run].q[:, others].mean(axis=0)
        # Up to 0.02 rad or m apart, poses count as one.
        near = [runs for known, runs in groups if np.all(np.abs(known - place) <= 0.02)]
        if near:
            near[0].append(run)
        else:
            groups.append((place, [run]))
    found = []
    for place, runs in groups:
        pairs = tuple((names[k], value) for k, value in zip(others, place.tolist(), strict=True))
        found.append(HeldPose(pairs, tuple(runs), tuple(logs.sources[run] for run in runs)))
    return tuple(found)


def compare_poses(
    logs: JointLogs, joint: int, law: FrictionLaw, *, beta: FloatArray | None = None
) -> PoseTest | None:
    """Return the test, arguments as of `extract_joint`; None where it moved alone at less than two poses."""
    poses = list_poses(logs, joint)
    if len(poses) < 2:
        return None
    fits, fitted, skipped = list[_PoseFit](), list[HeldPose](), list[tuple[str, str]]()
    for pose in poses:
        try:
            samples = extract_joint(logs, joint, runs=pose.runs, beta=beta).samples
            estimate = fit_friction(samples, law)
        except SymidError as error:
            skipped.append((", ".join(pose.sources), "; ".join(entry.text for entry in error.notices)))
            continue
        deviations, covariance = compute_robust_deviations(samples, law, estimate)
        speeds = np.abs(samples.rows.velocity)
        reach = float(np.quantile(speeds, 0.02)), float(speeds.max())
        fits.append((estimate, deviations, covariance, reach))
        fitted.append(pose)
    units = {one.name: one.unit for fit in fits for one in fit[0].parameters}
    parameters = list[PoseParameter]()
    named = [entry.name for entry in law.physical if all(entry.name in fit[1] for fit in fits)]
    for name in named if len(fits) > 1 else ():
        values = np.array([estimate.get_value(name) for estimate, *_ in fits], dtype=np.float64)
        stds, freedom = np.array([deviations[name] for _, deviations, *_ in fits]).T
        if np.all((stds > 0.0) & np.isfinite(stds)):
            unit, chance = units[name], compute_chance(values, stds, freedom)
            numbers = (tuple(part.tolist()) for part in (values, stds, freedom))
            given = dict(zip(("values", "stds", "freedom"), numbers, strict=True))
            parameters.append(PoseParameter(name=name, unit=unit, chance=chance, **given))
    change = _measure_change(law, fits) if len(fits) > 1 else None
    chances = adjust_chances([entry.chance for entry in parameters])
    apart = [entry for entry, chance in zip(parameters, chances, strict=True) if chance < POLICY.alarm]
    return PoseTest(
        law=law.name,
        poses=tuple(fitted),
        parameters=tuple(parameters),
        change=None if change is None else change[0],
        differs=bool(apart),
        verdict=_write_verdict(logs.library.card.joints[joint].name, law, fits, parameters, apart, change),
        skipped=tuple(skipped),
    )


def compute_chance(values: FloatArray, stds: FloatArray, freedom: FloatArray) -> float:
    """Return the p-value of equal means, by Welch's test."""
    count = len(values)
    weights = 1.0 / stds**2
    shares = weights / np.sum(weights)
    distance = np.sum(weights * (values - np.sum(shares * values)) ** 2) / (count - 1)
    small = float(np.sum((1.0 - shares) ** 2 / freedom))
    statistic = float(distance / (1.0 + 2.0 * (count - 2) / (count**2 - 1) * small))
    return float(scipy.stats.f.sf(statistic, count - 1, (count**2 - 1) / (3.0 * small)))


def _measure_change(law: FrictionLaw, fits: Sequence[_PoseFit]) -> tuple[float, float] | None:
    """Return the largest difference of two friction curves over the largest friction, and its 95 % limit."""
    ranges = np.array([reach for *_, reach in fits])
    slow, fast = float(ranges[:, 0].max()), float(ranges[:, 1].min())
    known = all(entry.name in deviations for _, deviations, *_ in fits for entry in law.physical)
    if not known or law.inputs != ("velocity",) or not 0.0 < slow < fast:
        return None
    speeds = np.geomspace(slow, fast, 100)
    inputs = {"velocity": np.concatenate([-speeds[::-1], speeds])}
    curves, bands = [], []
    for estimate, _, covariance, _ in fits:
        linear, shape = estimate.linear, estimate.shape
        own = compute_law_sensitivities(law, inputs, linear, shape)
        beside = np.zeros((len(own), len(estimate.other)))
        deviations, freedom = covariance.compute_deviations(np.hstack([own, beside]))
        bands.append(deviations * scipy.stats.t.ppf(0.975, freedom))
        curves.append(compute_friction_torque(law, inputs, linear, shape))
    largest = float(np.max(np.abs(curves)))
    if largest == 0.0:
        return None
    wide = np.sort(bands, axis=0)
    size, limit = np.max(np.ptp(curves, axis=0)), np.max(np.hypot(wide[-1], wide[-2]))
    return float(size) / largest, float(limit) / largest


def _write_verdict(  # noqa: PLR0917 - what the test found
    joint: str,
    law: FrictionLaw,
    fits: Sequence[_PoseFit],
    parameters: Sequence[PoseParameter],
    apart: Sequence[PoseParameter],
    change: tuple[float, float] | None,
) -> str:
    poses, head = len(fits), f"friction of {joint!r}"
    if poses < 2:
        return f"{head} can be fitted at {poses or 'none'} of its poses only: there is nothing to compare"
    if not parameters:
        return f"{head}: no parameter is identifiable at all {poses} poses: there is nothing to compare"
    size = "" if change is None else f"; between poses the friction curve changes by {100 * change[0]:.2g} %"
    # The widest interval exceeds the value at the pose with the smallest deviation.
    widths = [(max(0.5 * (high - low) for low, high in one.intervals), one) for one in parameters]
    coarse = change is None and all(wide > abs(one.values[int(np.argmin(one.stds))]) for wide, one in widths)
    shown = ", ".join(
        f"{entry.name} ({min(entry.values):.4g} to {max(entry.values):.4g} {entry.unit}".rstrip() + ")"
        for entry in apart or parameters
    )
    if apart:
        return f"{head} depends on the pose: {shown}, a significant difference{size}"
    uncertain = f"{head} is too uncertain to compare at these {poses} poses: "
    remedy = "Record more or longer motions at each"
    if coarse:
        return f"{uncertain}{shown}, with intervals wider than the values. {remedy}"
    if change is not None and 100.0 * change[1] > POLICY.uncertain:
        limits = f"its curve could differ by {100.0 * change[1]:.2g} % by chance"
        return f"{uncertain}{limits}. {remedy}"
    if any(len(deviations) < len(law.physical) for _, deviations, *_ in fits):
        names = ", ".join(entry.name for entry in parameters)
        rest = "the other parameters are not identifiable at all poses"
        return f"{head} shows no significant difference between these {poses} poses in {names}; {rest}"
    return f"{head} does not depend on the pose: no significant difference between these {poses} poses{size}"
