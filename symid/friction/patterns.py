"""How sure parameters are where the residual keeps a pattern: deviations that hold for noise with a memory.

Input: `FrictionSamples`, a law, its fit. Output: `PatternCovariance`, deviations, a notice.

    cov = P J' Omega J P,    P = (J'J)^+,    J: sensitivities of the rows

Omega is estimated in three ways, and the largest variance holds: white noise; products of the residual over
blocks of consecutive rows (Liang and Zeger 1986); an autoregression fitted to the residual of each recording,
its order by AIC, J' Omega J as an integral of its spectrum, its gain at rest corrected for the bias of short
records (towards one, by (1 + k + 2 order) / rows).

A variance that is f times that of white noise rests on about 1/f of the rows, its degrees of freedom.

Supported: several recordings, each with noise of its own.
Not supported: noise whose size changes with velocity, other than over blocks.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice
from symid.friction.covariance import find_design
from symid.friction.estimate import FrictionEstimate
from symid.friction.reduction import find_rows
from symid.friction.samples import FrictionSamples
from symid.friction.selection import predict_rows
from symid.joint.friction_law import FrictionLaw

__all__ = ["PatternCovariance", "find_pattern_covariance", "find_robust_deviations", "warn_of_pattern"]

_BLOCKS = 20
_ORDER = 20
"""Of the autoregression, at most."""
_ROWS_PER_ORDER = 25
_DEPENDENT = 1e-12
_TOO_SMALL = 2.0
"""Deviation over the stated one from which a reader is warned."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PatternCovariance:
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

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("white", "blocks", "memory"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

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


def find_pattern_covariance(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> PatternCovariance:
    """Return the covariances of a fit of `law` to `samples`."""
    design = find_design(samples, law, estimate.linear, estimate.shape)
    rows = find_rows(samples)
    error = rows.torque - predict_rows(samples, law, estimate)
    lengths = np.linalg.norm(design, axis=0)
    scales = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    scaled = design * scales
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=_DEPENDENT)
    unknowns = int(np.linalg.matrix_rank(inverse)) if inverse.any() else 0
    freedom = max(len(error) - unknowns, 1)
    blocks, memory = np.zeros_like(inverse), np.zeros_like(inverse)
    count = 0
    for run in np.unique(rows.run):
        members = np.flatnonzero(rows.run == run)
        parts = np.array_split(members, min(_BLOCKS, len(members)))
        count += len(parts)
        for part in parts:
            score = scaled[part].T @ error[part]
            blocks += np.outer(score, score)
        memory += _find_memory(error[members], scaled[members], unknowns) * len(error) / freedom
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


def _find_memory(error: FloatArray, design: FloatArray, unknowns: int) -> FloatArray:
    """Return J' Omega J of one recording (n, n), with noise that an autoregression describes."""
    count = len(error)
    factors, variance = _fit_memory(error)
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


def _fit_memory(error: FloatArray) -> tuple[FloatArray, float]:
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


def find_robust_deviations(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> dict[str, tuple[float, float]]:
    """Return (deviation, degrees of freedom) of the law's parameters that have a number."""
    found = find_pattern_covariance(samples, law, estimate)
    deviations, freedom = found.find_deviations(_build_mixing(law, len(found.white)))
    told = {entry.name for entry in estimate.parameters}
    return {
        entry.name: (float(deviations[k]), float(freedom[k]))
        for k, entry in enumerate(law.physical)
        if entry.name in told
    }


def _build_mixing(law: FrictionLaw, size: int) -> FloatArray:
    mixing = np.zeros((len(law.physical), size))
    mixing[:, : len(law.linear) + len(law.shape)] = np.array(law.mixing, dtype=np.float64)
    return mixing


def warn_of_pattern(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> tuple[Notice, ...]:
    """Return a notice where the residual keeps a pattern, so that stated deviations are too small."""
    robust = find_robust_deviations(samples, law, estimate)
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
