"""Residuals that are correlated, and the pose test: does friction depend on where the other joints stand?

Samples, law, fit -> PatternCovariance, robust deviations, a notice; recordings at several poses ->
PoseTest.

    cov = P J' Omega J P,    P = (J'J)^+,    J: sensitivities of the rows
    T = sum_p w_p (x_p - mean)^2 / (poses - 1) / (1 + 2 (poses - 2) / (poses^2 - 1) h),   w_p = 1 / s_p^2
    mean weighted by w_p,   h = sum_p (1 - w_p / sum w)^2 / f_p
    T ~ F(poses - 1, (poses^2 - 1) / (3 h))                                   (Welch 1951)

Omega is estimated in three ways, and the largest variance holds: white noise; products of the residual
over blocks of consecutive rows (Liang and Zeger 1986); an autoregression of the residual of each
recording, its order by AIC, J' Omega J as an integral of its spectrum, its gain at rest corrected for the
bias of short records (towards one, by (1 + k + 2 order) / rows). A variance f times that of white noise
rests on about 1/f of the rows, its degrees of freedom. These deviations s_p of f_p degrees of freedom
enter the pose test: a law that misses something leaves a pattern, which would make every pose look
different.

Supported: several recordings, each with noise of its own; two poses or more, several recordings of one
pose fitted together; poses whose recordings identify too little are left out, with the reason.
Not supported: noise whose size changes with velocity, other than over blocks; poses that differ in load
or temperature without a recording of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library
from symid.errors import Notice, SymidError
from symid.identification.diagnostics import sum_block_scores
from symid.identification.friction.estimate import (
    FrictionEstimate,
    compute_law_sensitivities,
    compute_sensitivities,
)
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.extraction import JointLogs, extract_joint
from symid.identification.friction.problem import FrictionOptions
from symid.identification.friction.samples import FrictionSamples, build_friction_rows
from symid.identification.friction.selection import predict_rows
from symid.joint_models import FrictionLaw, compute_friction_torque

_BLOCKS = 20
_ORDER = 20
"""Of the autoregression, at most."""
_ROWS_PER_ORDER = 25
_DEPENDENT = 1e-12
_TOO_SMALL = 2.0
"""Deviation over the stated one from which a reader is warned."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PatternCovariance(FrozenArrays):
    """Covariances (n, n) of (linear, shape, other) for three kinds of noise.

    Args:
        white, blocks, memory: for independent noise, over blocks of rows, for an autoregression.
        freedom: rows less unknowns.
        block_freedom: blocks less one.
    """

    white: FloatArray
    blocks: FloatArray
    memory: FloatArray
    freedom: float
    block_freedom: float

    def find_deviations(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the deviations (m,) of combinations `rows` (m, n), and their degrees of freedom (m,)."""
        white, blocks, memory = (
            np.maximum(np.einsum("ij,jk,ik->i", rows, part, rows), 0.0)
            for part in (self.white, self.blocks, self.memory)
        )
        most = np.maximum(np.maximum(white, blocks), memory)
        share = np.where(most > 0.0, white / np.where(most > 0.0, most, 1.0), 1.0)
        freedom = self.freedom * share
        freedom = np.where(
            (blocks >= most) & (most > white), np.minimum(freedom, self.block_freedom), freedom
        )
        return np.sqrt(most), np.maximum(freedom, 1.0)


def estimate_pattern_covariance(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> PatternCovariance:
    """Return the covariances of a fit of `law` to `samples`."""
    design = compute_sensitivities(samples, law, estimate.linear, estimate.shape)
    rows = build_friction_rows(samples)
    error = rows.torque - predict_rows(samples, law, estimate)
    lengths = np.linalg.norm(design, axis=0)
    scales = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    scaled = design * scales
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=_DEPENDENT)
    unknowns = int(np.linalg.matrix_rank(inverse)) if inverse.any() else 0
    freedom = max(len(error) - unknowns, 1)
    blocks, count = sum_block_scores(scaled, error, rows.run, _BLOCKS)
    memory = np.zeros_like(inverse)
    for run in np.unique(rows.run):
        members = np.flatnonzero(rows.run == run)
        memory += _integrate_spectrum(error[members], scaled[members], unknowns) * len(error) / freedom
    blocks *= count / max(count - 1, 1)

    def spread(middle: FloatArray) -> FloatArray:
        found: FloatArray = scales[:, None] * (inverse @ middle @ inverse) * scales
        return found

    return PatternCovariance(
        white=np.array(estimate.covariance, dtype=np.float64),
        blocks=spread(blocks),
        memory=spread(memory),
        freedom=float(freedom),
        block_freedom=float(max(count - 1, 1)),
    )


def _integrate_spectrum(error: FloatArray, design: FloatArray, unknowns: int) -> FloatArray:
    """Return J' Omega J of one recording (n, n), with noise that an autoregression describes."""
    count = len(error)
    factors, variance = _fit_autoregression(error)
    gain = float(factors.sum())
    if gain > 0.0:
        bias = (1 + unknowns + 2 * len(factors)) / count
        factors = factors * (min(gain + bias, 1.0 - 1.0 / count) / gain)
    # Four times the length: what an autocorrelation wraps around must not meet the rows.
    size = int(2 ** np.ceil(np.log2(4 * count)))
    turns = np.exp(-2j * np.pi * np.arange(size // 2 + 1) / size)
    powers = turns[:, None] ** np.arange(1, len(factors) + 1)
    weight = variance / np.abs(1.0 - powers @ factors) ** 2
    weight[1:-1] *= 2.0
    passed = np.fft.rfft(design, size, axis=0)
    found: FloatArray = ((passed.conj() * weight[:, None]).T @ passed).real / size
    return found


def _fit_autoregression(error: FloatArray) -> tuple[FloatArray, float]:
    """Return the factors of an autoregression, of the order that AIC takes, and its noise's variance."""
    most = min(_ORDER, len(error) // _ROWS_PER_ORDER)
    later = error[most:]
    best: tuple[FloatArray, float] = (np.zeros(0), float(np.mean(error**2)))
    # A residual of rounding, or none, has no memory worth a name.
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
) -> dict[str, tuple[float, float]]:
    """Return (deviation, degrees of freedom) of the law's parameters that have a number."""
    return _list_deviations(law, estimate, estimate_pattern_covariance(samples, law, estimate))


def _list_deviations(
    law: FrictionLaw, estimate: FrictionEstimate, covariance: PatternCovariance
) -> dict[str, tuple[float, float]]:
    mixing = np.zeros((len(law.physical), len(covariance.white)))
    mixing[:, : len(law.linear) + len(law.shape)] = np.array(law.mixing, dtype=np.float64)
    deviations, freedom = covariance.find_deviations(mixing)
    told = {entry.name for entry in estimate.parameters}
    found = zip(law.physical, deviations.tolist(), freedom.tolist(), strict=True)
    return {entry.name: (deviation, count) for entry, deviation, count in found if entry.name in told}


def warn_of_friction_pattern(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> tuple[Notice, ...]:
    """Return a notice where the residual keeps a pattern, so that stated deviations are too small."""
    robust = compute_robust_deviations(samples, law, estimate)
    # A fit to the last bit leaves rounding, whose pattern says nothing.
    far = {
        entry.name: robust[entry.name][0] / entry.std
        for entry in estimate.parameters
        if entry.std > 1e-12 * max(abs(entry.value), 1e-300)
        and robust[entry.name][0] > _TOO_SMALL * entry.std
    }
    if not far:
        return ()
    text = (
        f"the residual is not noise but keeps a pattern: the standard deviations of {', '.join(far)} are "
        f"up to {max(far.values()):.2g} times too small; the law misses something, a filter blurs, or rows "
        "lie closer than the noise forgets (--decimate); compare laws with --model auto"
    )
    return (Notice(code="friction.pattern", text=text),)


CONFIDENCE = 1.959963984540054
"""Standard deviations on either side of a 95 % interval."""
_SIGNIFICANT = 0.01
_SAME_POSE = 0.02
"""Difference of the others' positions, rad or m, up to which poses count as one."""
_COARSE = 0.2
"""Change of the friction curve, over the largest friction, that a test must be able to see to be one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldPose:
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
    poses: tuple[HeldPose, ...]
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


def list_poses(library: Library, logs: JointLogs, joint: int) -> tuple[HeldPose, ...]:
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
        HeldPose(
            others=tuple((names[k], float(value)) for k, value in zip(others, place, strict=True)),
            runs=tuple(runs),
            sources=tuple(logs.sources[run] for run in runs),
        )
        for place, runs in groups
    )


def compare_poses(
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
    poses = list_poses(library, logs, joint)
    if len(poses) < 2:
        return None
    fits: list[_PoseFit] = []
    fitted: list[HeldPose] = []
    skipped: list[tuple[str, str]] = []
    for pose in poses:
        try:
            samples = extract_joint(library, logs, joint, runs=pose.runs, beta=beta).samples
            fits.append(_fit_pose(samples, law, options))
        except SymidError as error:
            skipped.append((", ".join(pose.sources), "; ".join(entry.text for entry in error.notices)))
        else:
            fitted.append(pose)
    parameters = _compare_parameters(law, fits) if len(fits) > 1 else ()
    change = _measure_change(law, fits) if len(fits) > 1 else None
    least = min((entry.chance for entry in parameters), default=1.0)
    return PoseTest(
        law=law.name,
        poses=tuple(fitted),
        parameters=parameters,
        change=None if change is None else change[0],
        # Times how many were looked at (Bonferroni).
        differs=least * max(len(parameters), 1) < _SIGNIFICANT,
        verdict=_write_verdict(library.card.joints[joint].name, law, fits, parameters, change),
        skipped=tuple(skipped),
    )


def _fit_pose(samples: FrictionSamples, law: FrictionLaw, options: FrictionOptions | None) -> _PoseFit:
    estimate = fit_friction(samples, law, options=options)
    covariance = estimate_pattern_covariance(samples, law, estimate)
    speeds = np.abs(build_friction_rows(samples).velocity)
    return _PoseFit(
        estimate=estimate,
        deviations=_list_deviations(law, estimate, covariance),
        covariance=covariance,
        slow=float(np.quantile(speeds, 0.02)),
        fast=float(speeds.max()),
    )


def _compare_parameters(law: FrictionLaw, fits: Sequence[_PoseFit]) -> tuple[PoseParameter, ...]:
    found = []
    for entry in law.physical:
        if not all(entry.name in fit.deviations for fit in fits):
            continue
        units = {one.name: one.unit for one in fits[0].estimate.parameters}
        values = np.array([fit.estimate.get_value(entry.name) for fit in fits], dtype=np.float64)
        stds, freedom = np.array([fit.deviations[entry.name] for fit in fits]).T
        if not np.all((stds > 0.0) & np.isfinite(stds)):
            continue
        found.append(
            PoseParameter(
                name=entry.name,
                unit=units[entry.name],
                values=tuple(values.tolist()),
                stds=tuple(stds.tolist()),
                chance=compute_chance(values, stds, freedom),
                freedom=tuple(freedom.tolist()),
            )
        )
    return tuple(found)


def compute_chance(values: FloatArray, stds: FloatArray, freedom: FloatArray) -> float:
    """Return the probability of such differences if there were none, by Welch's test of several means."""
    from scipy.stats import f

    count = len(values)
    weights = 1.0 / stds**2
    shares = weights / np.sum(weights)
    distance = np.sum(weights * (values - np.sum(shares * values)) ** 2) / (count - 1)
    small = float(np.sum((1.0 - shares) ** 2 / freedom))
    statistic = float(distance / (1.0 + 2.0 * (count - 2) / (count**2 - 1) * small))
    return float(f.sf(statistic, count - 1, (count**2 - 1) / (3.0 * small)))


def _measure_change(law: FrictionLaw, fits: Sequence[_PoseFit]) -> tuple[float, float] | None:
    """Return the largest difference of two friction curves, and how large it may be by chance (95 %).

    Both are relative to the largest friction.
    """
    slow, fast = max(fit.slow for fit in fits), min(fit.fast for fit in fits)
    told = all(entry.name in fit.deviations for fit in fits for entry in law.physical)
    if not told or law.inputs != ("velocity",) or not 0.0 < slow < fast:
        return None
    speeds = np.geomspace(slow, fast, 100)
    inputs = {"velocity": np.concatenate([-speeds[::-1], speeds])}
    curves = np.stack(
        [compute_friction_torque(law, inputs, fit.estimate.linear, fit.estimate.shape) for fit in fits]
    )
    bands = np.sort(np.stack([_compute_band(law, inputs, fit) for fit in fits]), axis=0)
    largest = float(np.max(np.abs(curves)))
    if largest == 0.0:
        return None
    size, doubt = np.max(np.ptp(curves, axis=0)), np.max(np.hypot(bands[-1], bands[-2]))
    return float(size) / largest, float(doubt) / largest


def _compute_band(law: FrictionLaw, inputs: dict[str, FloatArray], fit: _PoseFit) -> FloatArray:
    """Return the half width of the 95 % band of a pose's friction curve, N m or N."""
    from scipy.stats import t

    own = compute_law_sensitivities(law, inputs, fit.estimate.linear, fit.estimate.shape)
    beside = np.zeros((len(own), len(fit.estimate.other)))
    deviations, freedom = fit.covariance.find_deviations(np.hstack([own, beside]))
    return np.asarray(deviations * t.ppf(0.975, freedom))


def _write_verdict(
    joint: str,
    law: FrictionLaw,
    fits: Sequence[_PoseFit],
    parameters: Sequence[PoseParameter],
    change: tuple[float, float] | None,
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
    size = "" if change is None else f"; between poses the friction curve changes by {100 * change[0]:.2g} %"
    if apart:
        shown = ", ".join(f"{entry.name} ({_spread(entry)})" for entry in apart)
        return f"friction of {joint!r} depends on the pose: {shown}, more than chance explains{size}"
    if change is None and all(map(_is_coarse, parameters)):
        shown = ", ".join(f"{entry.name} ({_spread(entry)})" for entry in parameters)
        return (
            f"friction of {joint!r} is too uncertain to compare at these {poses} poses: {shown}, with "
            "intervals wider than the values; record more or longer motions at each"
        )
    if change is not None and change[1] > _COARSE:
        return (
            f"friction of {joint!r} is too uncertain to compare at these {poses} poses: its curve could "
            f"differ by {100.0 * change[1]:.2g} % by chance; record more or longer motions at each"
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
