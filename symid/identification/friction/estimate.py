"""What a fit of a friction law says: how the search ended, parameters, and how uncertain they are.

    F = R [Phi(v; s), dPhi/ds c, X],   cov = sigma^2 (F'F)^+,   sigma^2 = J / (M - p - s - k)
    physical = mixing (c, s)
    AICc = M ln(J / M) + 2 k + 2 k (k + 1) / (M - k - 1)      Hurvich and Tsai, Biometrika 76 (1989) 297-307
    BIC  = M ln(J / M) + k ln M                               Schwarz, Ann. Statist. 6 (1978) 461-464

For white noise of known sigma the same matrix is the Cramer-Rao bound. A direction in which F has no
length cannot be identified, and a parameter with a part in it has no deviation. In the criteria M is the
number of rows, k that of the unknowns with the variance of the noise as one of them; a common constant is
left out.

Supported: one joint, one law; fixed shape values, dependent columns; deterministic and stochastic
searches.
Not supported: noise that is correlated behind R (see `poses`); time spent, so that equal fits are equal
files.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import Notice
from symid.identification.estimators import ParameterEstimate
from symid.identification.friction.samples import FrictionSamples
from symid.ipopt import Ending
from symid.joint_models import FrictionLaw, compute_column_derivatives, compute_columns


class NamedParameters:
    """Base of results: parameters of a law, and of what stands beside it, by name."""

    __slots__ = ()
    parameters: tuple[ParameterEstimate, ...]
    extra: tuple[ParameterEstimate, ...]

    def get_value(self, name: str) -> float | None:
        """Return the value of a parameter of the law or beside it; None where it has none."""
        return {entry.name: entry.value for entry in (*self.parameters, *self.extra)}.get(name)

    def get_std(self, name: str) -> float | None:
        """Return the standard deviation of a parameter; None where it was refused or not fitted."""
        return {entry.name: entry.std for entry in (*self.parameters, *self.extra)}.get(name)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionEstimate(NamedParameters):
    """The result of a fit.

    Args:
        joint: its name.
        law: name of the law.
        estimator: how it was fitted; `settings` its options, and what the search tells of itself.
        parameters: as papers print them, in the order of the law's `physical`, without those refused;
            `reason` of an entry says that it stands at a bound.
        extra: what multiplies the columns beside friction, without those refused.
        refused: parameters that these samples cannot tell, with the reason.
        linear: (p,) of the law; shape: (s,) its nonlinear unknowns; other: (k,) of all columns beside
            friction. They predict torques of motions like those fitted; the entry of a refused parameter
            means nothing by itself.
        covariance: of (linear, shape, other), row by row; directions that cannot be told have none.
        objective: J, (N m)^2 or N^2.
        sigma: standard deviation of the residual, N m or N.
        samples: M, rows of the fit.
        evaluations: how often J was found; solves: linear problems solved; iterations: or generations.
        outcome: how it ended; `ended` the stop rule in words.
        aicc, bic: information criteria; condition: of the column-scaled Jacobian.
        history: the least objective after each iteration or generation.
        notices: what a reader should know.
    """

    joint: str
    law: str
    estimator: str
    parameters: tuple[ParameterEstimate, ...]
    extra: tuple[ParameterEstimate, ...]
    refused: tuple[tuple[str, str], ...]
    linear: tuple[float, ...]
    shape: tuple[float, ...]
    other: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    objective: float
    sigma: float
    samples: int
    evaluations: int
    solves: int
    iterations: int
    outcome: Ending
    ended: str
    aicc: float
    bic: float
    condition: float
    history: tuple[float, ...] = ()
    settings: tuple[tuple[str, float | int | str], ...] = ()
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionSearch(FrozenArrays):
    """The end of a search.

    Args:
        linear: (p,) and shape: (s,) found; objective: J there.
        evaluations: how often J was found; solves: linear problems solved; iterations: or generations.
        history: the least J after each of them.
        outcome: how it ended; `ended` the stop rule that held, in words.
        settings: what the search tells of itself.
    """

    linear: FloatArray
    shape: FloatArray
    objective: float
    evaluations: int
    solves: int
    iterations: int
    history: tuple[float, ...]
    outcome: Ending
    ended: str
    settings: tuple[tuple[str, float | int | str], ...] = ()


def compute_criteria(objective: float, rows: int, unknowns: int, floor: float = 0.0) -> tuple[float, float]:
    """Return AICc, infinite where there are too few rows, and BIC.

    Args:
        objective: J, (N m)^2 or N^2.
        rows: M.
        unknowns: that were fitted, without the variance.
        floor: the least J that is more than rounding.
    """
    count = unknowns + 1
    likelihood = rows * math.log(max(objective, floor, 1e-300) / rows)
    spare = rows - count - 1
    aicc = likelihood + 2.0 * count * rows / spare if spare > 0 else math.inf
    return aicc, likelihood + count * math.log(rows)


_DEPENDENT = 1e-9
_PART = 1e-6
_VANISHED = 1e-30
"""Length over the longest column's below which a column is none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncertainty(FrozenArrays):
    """Of all unknowns in the order linear, shape, other, and of the physical parameters.

    Args:
        covariance: (n, n); zero in directions that cannot be told.
        physical: (p + s,) standard deviations, infinite where a parameter cannot be told, zero where fixed.
        other: (k,) the same of what multiplies the columns beside friction.
        rank: directions that can be told; condition: of the column-scaled F over these.
    """

    covariance: FloatArray
    physical: FloatArray
    other: FloatArray
    rank: int
    condition: float


def compute_sensitivities(
    samples: FrictionSamples,
    law: FrictionLaw,
    linear: Sequence[float] | FloatArray,
    shape: Sequence[float] | FloatArray,
) -> FloatArray:
    """Return F behind R: (M, p + s + k)."""
    own = compute_law_sensitivities(law, samples.inputs, linear, shape)
    return samples.pass_columns(np.hstack([own, samples.extra]))


def compute_law_sensitivities(
    law: FrictionLaw,
    inputs: Mapping[str, FloatArray],
    linear: Sequence[float] | FloatArray,
    shape: Sequence[float] | FloatArray,
) -> FloatArray:
    """Return the derivatives of a law's torque by (linear, shape): (N, p + s)."""
    values = [float(value) for value in shape]
    rates = compute_column_derivatives(law, inputs, values)
    sensitivity = np.einsum("nps,p->ns", rates, np.asarray(linear, dtype=np.float64))
    return np.hstack([compute_columns(law, inputs, values), sensitivity])


def compute_uncertainty(
    design: FloatArray, law: FrictionLaw, variance: float, fixed: Sequence[bool]
) -> Uncertainty:
    """Return what F tells.

    Args:
        design: F (M, n).
        law: whose physical parameters are meant.
        variance: of the noise, (N m)^2 or N^2.
        fixed: which shape values are not searched (s,).
    """
    count, edges = len(law.linear), len(law.linear) + len(law.shape)
    free = np.ones(design.shape[1], dtype=bool)
    free[count:edges] = ~np.asarray(fixed, dtype=bool)
    lengths = np.linalg.norm(design, axis=0)
    gone = lengths <= _VANISHED * max(float(np.max(lengths)), 1e-300)
    lengths[gone] = 1.0
    scaled = (np.where(gone, 0.0, design) / lengths)[:, free]
    _, singular, right = np.linalg.svd(np.linalg.qr(scaled, mode="r"))
    rank = int(np.sum(singular > _DEPENDENT * max(float(singular[0]), 1e-300)))
    root = np.zeros((design.shape[1], rank))
    root[free] = right[:rank].T / singular[:rank]
    blind = np.zeros((design.shape[1], int(free.sum()) - rank))
    blind[free] = right[rank:].T
    root, blind = root / lengths[:, None], blind / lengths[:, None]
    covariance = variance * (root @ root.T)
    mixing = np.zeros((edges, design.shape[1]))
    mixing[:, :edges] = np.array(law.mixing, dtype=np.float64)
    return Uncertainty(
        covariance=covariance,
        physical=_compute_deviations(mixing, covariance, blind, lengths),
        other=_compute_deviations(np.eye(design.shape[1])[edges:], covariance, blind, lengths),
        rank=rank,
        condition=float(singular[0] / singular[rank - 1]) if rank else np.inf,
    )


def _compute_deviations(
    rows: FloatArray, covariance: FloatArray, blind: FloatArray, lengths: FloatArray
) -> FloatArray:
    """Return sqrt(g cov g') for each row g; infinite where g has a part in a blind direction."""
    variances = np.einsum("ij,jk,ik->i", rows, covariance, rows)
    sizes = np.linalg.norm(rows / lengths, axis=1)
    parts = np.linalg.norm(rows @ blind, axis=1)
    deviations = np.sqrt(np.maximum(variances, 0.0))
    return np.where(parts > _PART * np.maximum(sizes, 1e-300), np.inf, deviations)


def compute_cramer_rao(
    samples: FrictionSamples,
    law: FrictionLaw,
    physical: Sequence[float],
    noise: float,
    fixed: Sequence[str] = (),
) -> FloatArray:
    """Return the least standard deviations (p + s,) that any unbiased estimator can have.

    Args:
        samples: whose motion is meant; their torque is not read.
        law: that holds.
        physical: the true parameters, in the order of the law's.
        noise: standard deviation of the torque behind R, N m or N.
        fixed: names of shape values that are known.
    """
    linear, shape = law.from_physical(physical)
    design = compute_sensitivities(samples, law, linear, shape)
    known = [entry.name in fixed for entry in law.shape]
    return compute_uncertainty(design, law, noise**2, known).physical
