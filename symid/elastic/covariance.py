"""How uncertain dynamic parameters are: from the rows of a fit, and at best.

Rows and residuals -> covariance; noise-free states and torque noise -> the Cramer-Rao bound.

Supported: residuals that are correlated in time over less than a hundredth of the rows; rows that do not tell
all parameters, whose variance is infinite then.
Not supported: the uncertainty of the springs that a fit took as given.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.filters import differentiate
from symid.elastic.signals import ElasticSignals
from symid.rows.identifiability import RankRule, ScaledSpectrum, find_spectrum

__all__ = ["find_bound", "find_clustered_covariance", "find_covariance", "find_told", "mark_untold"]

_BLOCKS = 100
_RULE = RankRule()


def find_told(design: FloatArray) -> NDArray[np.bool_]:
    """Return which parameters (p,) the rows `design` (m, p) can tell apart from all others."""
    return _find_told(find_spectrum(design, _RULE.zero))


def mark_untold(covariance: FloatArray, told: NDArray[np.bool_]) -> FloatArray:
    """Return `covariance` (p, p) with infinite variances where not `told` (p,), and no correlations there."""
    marked = covariance.copy()
    marked[~told, :] = 0.0
    marked[:, ~told] = 0.0
    marked[~told, ~told] = np.inf
    return marked


def find_covariance(design: FloatArray) -> FloatArray:
    """Return (F'F)^-1 (p, p) of rows F (m, p) with noise of size one; infinite variances where not told."""
    spectrum = find_spectrum(design, _RULE.zero)
    root = _find_inverse_root(spectrum)
    return mark_untold(root @ root.T, _find_told(spectrum))


def find_clustered_covariance(design: FloatArray, errors: FloatArray) -> FloatArray:
    """Return G (sum_b F_b' e_b e_b' F_b) G with G = (F'F)^-1 over blocks b of rows: (p, p).

    It holds for noise that differs from row to row and is correlated within blocks (Liang and Zeger 1986).

    Args:
        design: F (m, p), in the order of time.
        errors: e (m,).
    """
    spectrum = find_spectrum(design, _RULE.zero)
    root = _find_inverse_root(spectrum)
    blocks = np.array_split(np.arange(len(errors)), min(_BLOCKS, len(errors)))
    scores = np.stack([design[block].T @ errors[block] for block in blocks])
    spread = (scores @ root) @ root.T
    return mark_untold(spread.T @ spread, _find_told(spectrum))


def find_bound(
    library: Library, signals: Sequence[ElasticSignals], noise: Sequence[FloatArray]
) -> FloatArray:
    """Return the least covariance (p + n + pf, p + n + pf) that an unbiased estimate of chi can have.

    (sum_k Y_k' Sigma^-1 Y_k)^-1, Y the sum of motor and link equations: torque noise only, white, states
    exact, nothing known of the springs (who knows their form may do better).

    Args:
        library: functions of the robot.
        signals: noise-free states of every recording, at the sample rate of the noisy ones.
        noise: (n,) standard deviation of the torque noise of every recording, N m or N.
    """
    count = len(library.card.beta) + library.card.size + len(library.card.friction)
    information = np.zeros((count, count))
    for part, sigma in zip(signals, noise, strict=True):
        (momentum,) = library.evaluate("momentum_regressor", part.q, part.dq)
        (lagrange,) = library.evaluate("lagrange_regressor", part.q, part.dq)
        rotor = differentiate(part.dtheta, part.period)[:, :, None] * np.eye(library.card.size)
        columns = [differentiate(momentum, part.period) - lagrange, rotor]
        if library.card.friction:
            columns.append(library.evaluate("friction_regressor", part.dtheta)[0])
        rows = (np.concatenate(columns, axis=2) / sigma[:, None]).reshape(-1, count)
        information += rows.T @ rows
    scales = np.sqrt(np.maximum(np.diag(information), 1e-300))
    bound: FloatArray = np.linalg.inv(information / np.outer(scales, scales)) / np.outer(scales, scales)
    return bound


def _find_told(spectrum: ScaledSpectrum) -> NDArray[np.bool_]:
    hidden = spectrum.directions[spectrum.singular <= _RULE.singular * spectrum.singular[0]]
    told: NDArray[np.bool_] = (np.sum(hidden**2, axis=0) <= _RULE.share) & (spectrum.lengths > 0.0)
    return told


def _find_inverse_root(spectrum: ScaledSpectrum) -> FloatArray:
    """Return a root (p, r) of the pseudo-inverse of F'F, columns scaled, over the directions seen."""
    seen = spectrum.singular > _RULE.singular * spectrum.singular[0]
    root: FloatArray = spectrum.scales[:, None] * spectrum.directions[seen].T / spectrum.singular[seen]
    return root
