"""How sure the parameters of a friction law are, and which of them samples can tell at all.

FrictionSamples, FrictionLaw, values -> Uncertainty; the Cramer-Rao bound of a motion before it is made.

    F = R [Phi(v; s), dPhi/ds c, X],    cov = sigma^2 (F'F)^+,    physical = mixing (c, s)

For white noise of known sigma the same matrix is the Cramer-Rao bound: no unbiased estimator is surer. A
direction in which F has no length cannot be told; a parameter with a part in it has no deviation.

Supported: fixed shape values, dependent columns. Not supported: noise that is correlated behind R.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.friction.samples import FrictionSamples
from symid.joint.friction_law import FrictionLaw, find_column_rates, find_columns

__all__ = ["Uncertainty", "find_cramer_rao", "find_design", "find_uncertainty"]

_DEPENDENT = 1e-9
_PART = 1e-6
_VANISHED = 1e-30
"""Length over the longest column's below which a column is none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncertainty:
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

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("covariance", "physical", "other"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def find_design(
    samples: FrictionSamples,
    law: FrictionLaw,
    linear: Sequence[float] | FloatArray,
    shape: Sequence[float] | FloatArray,
) -> FloatArray:
    """Return F behind R: (M, p + s + k)."""
    inputs, values = samples.inputs, [float(value) for value in shape]
    columns = find_columns(law, inputs, values)
    rates = find_column_rates(law, inputs, values)
    sensitivity = np.einsum("nps,p->ns", rates, np.asarray(linear, dtype=np.float64))
    return samples.pass_columns(np.hstack([columns, sensitivity, samples.extra]))


def find_uncertainty(
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
        physical=_find_deviations(mixing, covariance, blind, lengths),
        other=_find_deviations(np.eye(design.shape[1])[edges:], covariance, blind, lengths),
        rank=rank,
        condition=float(singular[0] / singular[rank - 1]) if rank else np.inf,
    )


def _find_deviations(
    rows: FloatArray, covariance: FloatArray, blind: FloatArray, lengths: FloatArray
) -> FloatArray:
    """Return sqrt(g cov g') for each row g; infinite where g has a part in a blind direction."""
    variances = np.einsum("ij,jk,ik->i", rows, covariance, rows)
    sizes = np.linalg.norm(rows / lengths, axis=1)
    parts = np.linalg.norm(rows @ blind, axis=1)
    deviations = np.sqrt(np.maximum(variances, 0.0))
    return np.where(parts > _PART * np.maximum(sizes, 1e-300), np.inf, deviations)


def find_cramer_rao(
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
    design = find_design(samples, law, linear, shape)
    known = [entry.name in fixed for entry in law.shape]
    return find_uncertainty(design, law, noise**2, known).physical
