"""How uncertain dynamic parameters are: from the rows of a fit, and the Cramer-Rao bounds.

    motor   IA ddtheta + F(dtheta) f + S w = tau + noise
    link    Y beta - S w = 0                                     exact, as the states are

Who knows nothing of springs has the sum of both equations. For who knows their form, S are the
derivatives of the springs' torque by all their numbers w: stiffnesses, slopes, places. The link equations
have no noise, so only directions of their null space N stay open, and the bound is N (N' I N)^-1 N' with
the information I of the motor equations (Gorman and Hero 1990). What N holds is the common scale of links
and springs, and what the recordings do not show.

Supported: residuals correlated over less than a hundredth of the rows (Liang and Zeger 1986); rows that
do not identify all parameters, whose variance is then infinite; springs of stops and knees; several
recordings.
Not supported: the uncertainty of springs that a fit took as given; cubic springs, damping; noise of the
encoders, with which one can only do worse.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification.diagnostics import sum_block_scores
from symid.identification.elastic.regression import ElasticSignals, build_equations
from symid.identification.elastic.spring_fit import compute_slips, compute_spring_slopes
from symid.identification.hysteresis import read_weights
from symid.identification.regression import RankRule, ScaledSpectrum, compute_spectrum
from symid.joint_models import compute_stop_basis
from symid.logs import differentiate
from symid.robot import Elasticity

_BLOCKS = 100
_RULE = RankRule()


def measure_identifiability(design: FloatArray) -> tuple[NDArray[np.bool_], float]:
    """Return which parameters (p,) rows F (m, p) tell apart, and the condition number of what they tell."""
    spectrum = compute_spectrum(design, _RULE.zero)
    seen = spectrum.singular > _RULE.singular * spectrum.singular[0]
    return _mask_identifiable(spectrum), float(spectrum.singular[0] / spectrum.singular[seen][-1])


def mark_unidentifiable(covariance: FloatArray, told: NDArray[np.bool_]) -> FloatArray:
    """Return `covariance` (p, p) with infinite variances where not `told` (p,), and no correlations there."""
    marked = covariance.copy()
    marked[~told, :] = 0.0
    marked[:, ~told] = 0.0
    marked[~told, ~told] = np.inf
    return marked


def compute_covariance(design: FloatArray) -> FloatArray:
    """Return (F'F)^-1 (p, p) of rows F (m, p) with noise of size one; infinite variances where not told."""
    spectrum = compute_spectrum(design, _RULE.zero)
    root = _compute_inverse_root(spectrum)
    return mark_unidentifiable(root @ root.T, _mask_identifiable(spectrum))


def compute_clustered_covariance(design: FloatArray, errors: FloatArray) -> FloatArray:
    """Return G (sum_b F_b' e_b e_b' F_b) G with G = (F'F)^-1 over blocks b of rows: (p, p).

    It holds for noise that differs from row to row and is correlated within blocks (Liang and Zeger 1986).

    Args:
        design: F (m, p), in the order of time.
        errors: e (m,).
    """
    spectrum = compute_spectrum(design, _RULE.zero)
    root = _compute_inverse_root(spectrum)
    scores, _ = sum_block_scores(design, errors, np.zeros(len(errors), dtype=np.intp), _BLOCKS)
    return mark_unidentifiable(root @ (root.T @ scores @ root) @ root.T, _mask_identifiable(spectrum))


def compute_elimination_bound(
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
        motor, link = _build_exact_equations(library, part)
        rows = (np.concatenate([link, motor], axis=2) / sigma[:, None]).reshape(-1, count)
        information += rows.T @ rows
    scales = np.sqrt(np.maximum(np.diag(information), 1e-300))
    bound: FloatArray = np.linalg.inv(information / np.outer(scales, scales)) / np.outer(scales, scales)
    return bound


def _build_exact_equations(library: Library, part: ElasticSignals) -> tuple[FloatArray, FloatArray]:
    """Return the motor (N, n, n + pf) and link (N, n, p) columns at all samples of noise-free states."""
    return build_equations(
        library, part, lambda values: differentiate(values, part.period), lambda values: values
    )


def _mask_identifiable(spectrum: ScaledSpectrum) -> NDArray[np.bool_]:
    hidden = spectrum.directions[spectrum.singular <= _RULE.singular * spectrum.singular[0]]
    told: NDArray[np.bool_] = (np.sum(hidden**2, axis=0) <= _RULE.share) & (spectrum.lengths > 0.0)
    return told


def _compute_inverse_root(spectrum: ScaledSpectrum) -> FloatArray:
    """Return a root (p, r) of the pseudo-inverse of F'F, columns scaled, over the directions seen."""
    seen = spectrum.singular > _RULE.singular * spectrum.singular[0]
    root: FloatArray = spectrum.scales[:, None] * spectrum.directions[seen].T / spectrum.singular[seen]
    return root


_WINDOW = 0.02
"""s, over which the link equations are integrated: differences of the momentum would be coarser."""
_EXACT = 1e-4
"""Of the largest singular value of the link equations; integration leaves 1e-5, what is seen a hundred times
more."""
_BLIND = 1e-6
"""Of the largest singular value of what is open in the motor equations; they do not see what is below it."""


def compute_spring_bound(
    library: Library, signals: Sequence[ElasticSignals], noise: Sequence[FloatArray]
) -> FloatArray:
    """Return the least covariance (p + n + pf, p + n + pf) of chi where the form of the springs is known.

    Arguments as those of `compute_elimination_bound`; the card states the true springs of all joints.
    """
    card = library.card
    beta, count = len(card.beta), len(card.beta) + card.size + len(card.friction)
    springs = [spring for spring in card.elasticity if spring is not None]
    motor, link = [], []
    for part, sigma in zip(signals, noise, strict=True):
        torques = _compute_spring_columns(springs, part.phi)
        drive = _build_exact_equations(library, part)[0]
        motor.append(np.concatenate([drive, torques], axis=2) / sigma[:, None])
        link.append(_build_link_rows(library, part, torques))
    motors, links = (
        np.concatenate([rows.reshape(-1, rows.shape[2]) for rows in side]) for side in (motor, link)
    )
    open_ways = _compute_null_space(links)
    # Columns: beta and springs as the link equations leave them, then rotors and friction.
    driven = count - beta
    ways = np.zeros((count + open_ways.shape[0] - beta, open_ways.shape[1] + driven))
    ways[:beta, :-driven], ways[count:, :-driven] = open_ways[:beta], open_ways[beta:]
    ways[beta:count, -driven:] = np.eye(driven)
    rows = np.hstack([np.zeros((len(motors), beta)), motors])
    # The length that a column has unless its parts cancel: what cancels to rounding is not seen.
    lengths = np.linalg.norm(np.linalg.norm(rows, axis=0)[:, None] * ways, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    inverse = np.linalg.pinv(rows @ ways / lengths, rcond=_BLIND)
    root = (ways[:count] / lengths) @ inverse
    bound: FloatArray = root @ root.T
    return bound


def _compute_spring_columns(springs: Sequence[Elasticity], phi: FloatArray) -> FloatArray:
    """Return the derivatives (N, n, w) of the springs' torques by all their numbers."""
    parts = []
    for joint, spring in enumerate(springs):
        weights = read_weights(spring)
        basis = compute_stop_basis(phi[:, joint], weights.thresholds)
        columns = compute_spring_slopes(basis, compute_slips(basis, weights.thresholds), weights)[:, :-1]
        own = np.zeros((len(phi), len(springs), columns.shape[1]))
        own[:, joint] = columns
        parts.append(own)
    return np.concatenate(parts, axis=2)


def _build_link_rows(library: Library, part: ElasticSignals, torques: FloatArray) -> FloatArray:
    """Return the columns (M, n, p + w) of links and springs, integrated over windows."""
    ends = slice(None, None, max(1, round(_WINDOW / part.period)))

    def add(values: FloatArray) -> FloatArray:
        steps = np.cumsum((values[1:] + values[:-1]) / 2.0, axis=0) * part.period
        sums: FloatArray = np.diff(np.concatenate([np.zeros_like(values[:1]), steps])[ends], axis=0)
        return sums

    link = build_equations(library, part, lambda values: np.diff(values[ends], axis=0), add)[1]
    return np.concatenate([link, -add(torques)], axis=2)


def _compute_null_space(rows: FloatArray) -> FloatArray:
    """Return directions (columns, k) that the rows (m, columns) do not see, columns scaled to one length."""
    lengths = np.linalg.norm(rows, axis=0)
    lengths = np.where(lengths > 1e-12 * float(lengths.max()), lengths, np.inf)
    triangle = np.asarray(np.linalg.qr(rows / lengths, mode="r"))
    _, singular, directions = np.linalg.svd(triangle)
    hidden = directions[singular <= _EXACT * singular[0]].T
    ways: FloatArray = hidden / np.where(np.isfinite(lengths), lengths, 1.0)[:, None]
    return ways
