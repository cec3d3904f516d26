"""How uncertain dynamic parameters are: from the rows of a fit, and the Cramer-Rao bounds.

    motor   IA ddtheta + F(dtheta) f + S w = tau + noise
    link    Y beta - S w = 0                                     exact, as the states are

S are the derivatives of the springs' torque by all their numbers w. The bound is N (N' I N)^-1 N', N the null
space of the link equations, I the information of the motor equations (Gorman and Hero 1990).

Supported: residuals correlated over less than a hundredth of the rows (Liang and Zeger 1986); rows that do
not identify all parameters, whose variance is then infinite; springs of stops and knees; several recordings.
Not supported: the uncertainty of springs that a fit took as given; cubic springs, damping; noise of the
encoders, with which one can only do worse.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification.diagnostics import sum_block_scores
from symid.identification.elastic.regression import ElasticSignals, average_steps, build_equations
from symid.identification.hysteresis import compute_slips, compute_spring_slopes, read_weights
from symid.identification.regression import RankRule, compute_spectrum
from symid.joint_models import Elasticity, compute_stop_basis
from symid.logs import differentiate

_BLOCKS = 100
_RULE = RankRule()


def measure_identifiability(design: FloatArray) -> tuple[NDArray[np.bool_], float]:
    """Return which parameters (p,) rows F (m, p) identify, and the condition number of their regressor."""
    spectrum = compute_spectrum(design, _RULE.zero)
    kept = spectrum.singular[spectrum.singular > _RULE.singular * spectrum.singular[0]]
    return spectrum.mask_identifiable(_RULE), float(kept[0] / kept[-1])


def mark_unidentifiable(covariance: FloatArray, identifiable: NDArray[np.bool_]) -> FloatArray:
    """Return `covariance` (p, p), infinite and without correlations where not `identifiable` (p,)."""
    marked = np.where(np.outer(identifiable, identifiable), covariance, 0.0)
    np.fill_diagonal(marked, np.where(identifiable, np.diag(covariance), np.inf))
    return marked


def compute_covariance(design: FloatArray, errors: FloatArray | None = None) -> FloatArray:
    """Return the covariance (p, p) of a least-squares fit, with infinite variances where not identifiable.

    G = (F'F)^-1 of rows F (m, p) for noise of size one; with errors e (m,), in the order of time,
    G (sum_b F_b' e_b e_b' F_b) G over blocks b, which holds for noise that differs from row to row and is
    correlated within blocks (Liang and Zeger 1986).
    """
    spectrum = compute_spectrum(design, _RULE.zero)
    kept = spectrum.singular > _RULE.singular * spectrum.singular[0]
    # A root (p, r) of the pseudo-inverse of F'F.
    root = spectrum.scales[:, None] * spectrum.directions[kept].T / spectrum.singular[kept]
    covariance = root @ root.T
    if errors is not None:
        scores, _ = sum_block_scores(design, errors, np.zeros(len(errors), dtype=np.intp), _BLOCKS)
        covariance = root @ (root.T @ scores @ root) @ root.T
    return mark_unidentifiable(covariance, spectrum.mask_identifiable(_RULE))


def compute_elimination_bound(
    library: Library, signals: Sequence[ElasticSignals], noise: Sequence[FloatArray]
) -> FloatArray:
    """Return the least covariance (p + n + pf, p + n + pf) that an unbiased estimate of chi can have.

    (sum_k Y_k' Sigma^-1 Y_k)^-1, Y the sum of motor and link equations: torque noise only, white, states
    exact, nothing known of the springs (with their form known the bound is lower).

    `signals` are the noise-free states of every recording, at the sample rate of the noisy ones, `noise` (n,)
    the standard deviation of the torque noise of each, N m or N.
    """
    count = len(library.card.beta) + library.card.size + len(library.card.friction)
    pairs = zip(signals, noise, strict=True)
    weighted = [_build_exact_equations(library, part) / sigma[:, None] for part, sigma in pairs]
    rows = np.concatenate(weighted).reshape(-1, count)
    information = rows.T @ rows
    scales = np.sqrt(np.maximum(np.diag(information), 1e-300))
    bound: FloatArray = np.linalg.inv(information / np.outer(scales, scales)) / np.outer(scales, scales)
    return bound


def _build_exact_equations(library: Library, part: ElasticSignals) -> FloatArray:
    """Return the columns (N, n, p + n + pf) at all samples of noise-free states."""
    return build_equations(library, part, lambda states: differentiate(states, part.period), lambda x: x)


_WINDOW = 0.02
"""s, over which the link equations are integrated: differences of the momentum would be coarser."""
_EXACT = 1e-4
"""Of the largest singular value of the link equations; integration leaves 1e-5, what is excited a hundred
times more."""
_BLIND = 1e-6
"""Of the largest singular value of what is open in the motor equations; what is below it has no effect."""


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
        drive = _build_exact_equations(library, part)[:, :, beta:]
        motor.append(np.concatenate([drive, torques], axis=2) / sigma[:, None])
        link.append(_build_link_rows(library, part, torques))
    motors, links = (
        np.concatenate([rows.reshape(-1, rows.shape[2]) for rows in side]) for side in (motor, link)
    )
    # Directions of the null space, with columns scaled to one length.
    lengths = np.linalg.norm(links, axis=0)
    lengths = np.where(lengths > 1e-12 * float(lengths.max()), lengths, np.inf)
    _, singular, directions = np.linalg.svd(np.asarray(np.linalg.qr(links / lengths, mode="r")))
    hidden = directions[singular <= _EXACT * singular[0]].T
    null_space = hidden / np.where(np.isfinite(lengths), lengths, 1.0)[:, None]
    # Columns: beta and springs as the link equations leave them, then rotors and friction.
    driven = count - beta
    ways = np.zeros((count + len(null_space) - beta, null_space.shape[1] + driven))
    ways[:beta, :-driven], ways[count:, :-driven] = null_space[:beta], null_space[beta:]
    ways[beta:count, -driven:] = np.eye(driven)
    rows = np.hstack([np.zeros((len(motors), beta)), motors])
    # The length that a column has unless its parts cancel: what cancels to rounding has no effect.
    lengths = np.linalg.norm(np.linalg.norm(rows, axis=0)[:, None] * ways, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    root = (ways[:count] / lengths) @ np.linalg.pinv(rows @ ways / lengths, rcond=_BLIND)
    return root @ root.T


def _compute_spring_columns(springs: Sequence[Elasticity], phi: FloatArray) -> FloatArray:
    """Return the derivatives (N, n, w) of the springs' torques by all their numbers."""
    parts = []
    for joint, spring in enumerate(springs):
        weights = read_weights(spring)
        basis = compute_stop_basis(phi[:, joint], weights.thresholds)
        columns = compute_spring_slopes(basis, weights, compute_slips(basis, weights.thresholds))[:, :-1]
        own = np.zeros((len(phi), len(springs), columns.shape[1]))
        own[:, joint] = columns
        parts.append(own)
    return np.concatenate(parts, axis=2)


def _build_link_rows(library: Library, part: ElasticSignals, torques: FloatArray) -> FloatArray:
    """Return the columns (M, n, p + w) of links and springs, integrated over windows."""
    ends = slice(None, None, max(1, round(_WINDOW / part.period)))

    def add(values: FloatArray) -> FloatArray:
        steps = np.cumsum(average_steps(values), axis=0) * part.period
        return np.diff(np.concatenate([np.zeros_like(values[:1]), steps])[ends], axis=0)

    columns = build_equations(library, part, lambda values: np.diff(values[ends], axis=0), add)
    return np.concatenate([columns[:, :, : len(library.card.beta)], -add(torques)], axis=2)
