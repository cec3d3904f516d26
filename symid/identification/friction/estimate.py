"""The result of a fit of a friction law to one joint: parameters, their uncertainty, how the search ended.

    F = R [Phi(v; s), dPhi/ds c, X],   cov = sigma^2 (F'F)^+,   sigma^2 = J / (M - p - s - k)
    physical = mixing (c, s)
    AICc = M ln(J / M) + 2 k + 2 k (k + 1) / (M - k - 1)      Hurvich and Tsai, Biometrika 76 (1989) 297-307
    BIC  = M ln(J / M) + k ln M                               Schwarz, Ann. Statist. 6 (1978) 461-464

For white noise of known sigma the same matrix is the Cramer-Rao bound. In the criteria M is the number of
rows, k that of the unknowns with the variance of the noise as one of them; a common constant is left out.

Supported: fixed shape values, dependent columns (a parameter with a part in the null space of F has no
deviation). Not supported: correlated noise behind R (see `poses`); time spent (equal fits are equal files).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.identification.estimators import ParameterEstimate
from symid.identification.friction.samples import FrictionSamples
from symid.ipopt import Ending
from symid.joint_models import FrictionLaw, compute_column_derivatives, compute_columns

Values = Sequence[float] | FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class LawFit:
    """What fits of all laws, static and with a state, have in common.

    Args:
        joint, law: their names.
        parameters: as papers print them, in the order of the law, without those refused; `reason` of an
            entry: that it is at a bound.
        extra: factors of the columns beside friction, without those refused.
        refused: parameters that cannot be identified from these samples, with the reason.
        other: (k,) values of all columns beside friction; that of a refused one means nothing by itself.
        objective: J, (N m)^2 or N^2; sigma: standard deviation of the residual, N m or N.
        samples: M, rows of the fit.
        evaluations: of J; outcome: how the search ended.
        notices: warnings.
    """

    joint: str
    law: str
    parameters: tuple[ParameterEstimate, ...]
    extra: tuple[ParameterEstimate, ...]
    refused: tuple[tuple[str, str], ...]
    other: tuple[float, ...]
    objective: float
    sigma: float
    samples: int
    evaluations: int
    outcome: Ending
    notices: tuple[Notice, ...] = ()

    def get_value(self, name: str) -> float | None:
        """Return the value of a parameter; None where it has none."""
        return {entry.name: entry.value for entry in (*self.parameters, *self.extra)}.get(name)

    def get_std(self, name: str) -> float | None:
        """Return the standard deviation of a parameter; None where it was refused or not fitted."""
        return {entry.name: entry.std for entry in (*self.parameters, *self.extra)}.get(name)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionEstimate(LawFit):
    """The fit of a static law.

    Args:
        estimator: its name; `settings` the options and counts of the search.
        linear: (p,) of the law; shape: (s,) its nonlinear unknowns. With `other` they predict torques of
            motions like those fitted.
        covariance: of (linear, shape, other), row by row; zero in directions that are not identifiable.
        solves: linear problems solved; iterations: or generations; ended: the stop rule in words.
        aicc, bic: information criteria; condition: of the column-scaled Jacobian.
        history: the least objective after each iteration or generation.
    """

    estimator: str
    linear: tuple[float, ...]
    shape: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    solves: int
    iterations: int
    ended: str
    aicc: float
    bic: float
    condition: float
    history: tuple[float, ...] = ()
    settings: tuple[tuple[str, float | int | str], ...] = ()


class FrictionSearch(NamedTuple):
    """The end of a search; fields as in `FrictionEstimate`."""

    linear: tuple[float, ...]
    shape: tuple[float, ...]
    objective: float
    evaluations: int
    solves: int
    iterations: int
    history: tuple[float, ...]
    outcome: Ending
    ended: str
    settings: tuple[tuple[str, float | int | str], ...]


def compute_criteria(objective: float, rows: int, unknowns: int, floor: float = 0.0) -> tuple[float, float]:
    """Return AICc, infinite where there are too few rows, and BIC.

    `objective` is J, `rows` M, `unknowns` what was fitted without the variance, `floor` the rounding of J.
    """
    count = unknowns + 1
    likelihood = rows * math.log(max(objective, floor, 1e-300) / rows)
    spare = rows - count - 1
    aicc = likelihood + 2.0 * count * rows / spare if spare > 0 else math.inf
    return aicc, likelihood + count * math.log(rows)


class Uncertainty(NamedTuple):
    """Covariance (n, n) of linear, shape and other, zero in directions that are not identifiable.

    `physical` (p + s,) and `other` (k,) are standard deviations, infinite where not identifiable, zero where
    fixed; `rank` that of the column-scaled F, `condition` over its range.
    """

    covariance: FloatArray
    physical: FloatArray
    other: FloatArray
    rank: int
    condition: float


def compute_sensitivities(
    samples: FrictionSamples, law: FrictionLaw, linear: Values, shape: Values
) -> FloatArray:
    """Return F behind R: (M, p + s + k)."""
    values, factors = [float(value) for value in shape], np.asarray(linear, dtype=np.float64)
    rates = np.einsum("nps,p->ns", compute_column_derivatives(law, samples.inputs, values), factors)
    passed = samples.pass_columns(rates)
    return np.hstack([samples.pass_law(law, values), passed, samples.build_rows().extra])


def compute_law_sensitivities(
    law: FrictionLaw, inputs: Mapping[str, FloatArray], linear: Values, shape: Values
) -> FloatArray:
    """Return the derivatives of a law's torque by (linear, shape): (N, p + s)."""
    values = [float(value) for value in shape]
    rates = compute_column_derivatives(law, inputs, values)
    sensitivity = np.einsum("nps,p->ns", rates, np.asarray(linear, dtype=np.float64))
    return np.hstack([compute_columns(law, inputs, values), sensitivity])


def compute_uncertainty(
    design: FloatArray, law: FrictionLaw, variance: float, fixed: Sequence[bool]
) -> Uncertainty:
    """Return the uncertainty that F (M, n) gives.

    `variance` is that of the noise, (N m)^2 or N^2; `fixed` (s,) are the shape values that are not searched.
    """
    count, edges = len(law.linear), len(law.linear) + len(law.shape)
    free = np.ones(design.shape[1], dtype=bool)
    free[count:edges] = ~np.asarray(fixed, dtype=bool)
    lengths = np.linalg.norm(design, axis=0)
    gone = lengths <= 1e-30 * max(float(np.max(lengths)), 1e-300)
    lengths[gone] = 1.0
    scaled = (np.where(gone, 0.0, design) / lengths)[:, free]
    _, singular, right = np.linalg.svd(np.linalg.qr(scaled, mode="r"))
    rank = int(np.sum(singular > 1e-9 * max(float(singular[0]), 1e-300)))
    directions = np.zeros((design.shape[1], int(free.sum())))
    directions[free] = right.T
    directions /= lengths[:, None]
    root, null = directions[:, :rank] / singular[:rank], directions[:, rank:]
    mixing = np.eye(design.shape[1])
    mixing[:edges, :edges] = np.array(law.mixing, dtype=np.float64)
    covariance = variance * (root @ root.T)
    variances = np.einsum("ij,jk,ik->i", mixing, covariance, mixing)
    sizes = np.maximum(np.linalg.norm(mixing / lengths, axis=1), 1e-300)
    lost = np.linalg.norm(mixing @ null, axis=1) > 1e-6 * sizes
    deviations = np.where(lost, np.inf, np.sqrt(np.maximum(variances, 0.0)))
    condition = float(singular[0] / singular[rank - 1]) if rank else np.inf
    return Uncertainty(covariance, deviations[:edges], deviations[edges:], rank, condition)


def compute_cramer_rao(
    samples: FrictionSamples, law: FrictionLaw, physical: Sequence[float], noise: float
) -> FloatArray:
    """Return the least standard deviations (p + s,) that any unbiased estimator can have.

    The torque of `samples` is not read. `physical` are the true parameters in the order of the law, `noise`
    is the standard deviation of the torque behind R, N m or N.
    """
    linear, shape = law.from_physical(physical)
    design = compute_sensitivities(samples, law, linear, shape)
    return compute_uncertainty(design, law, noise**2, [False] * len(shape)).physical
