"""How well dynamics can be known at best by who knows the form of the springs: a Cramer-Rao bound.

Noise-free states, true springs, torque noise -> covariance of chi.

    motor   IA ddtheta + F(dtheta) f + S w = tau + noise
    link    Y beta - S w = 0                                     exact, as the states are

S are the derivatives of the springs' torque by all their numbers w: stiffnesses, slopes, places of stops and
knees. The link equations have no noise: only directions of their null space N stay open, and the bound is
N (N' I N)^-1 N' with the information I of the motor equations (Gorman and Hero 1990). What N holds is the
common scale of links and springs, and what the recordings do not show.

Supported: springs of stops and knees; several recordings.
Not supported: cubic springs, damping; noise of the encoders, with which one can only do worse.
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.filters import differentiate
from symid.elastic.signals import ElasticSignals
from symid.elastic.spring_descent import find_slips, find_spring_slopes
from symid.elastic.spring_weights import read_weights
from symid.joint.plays import find_stop_basis
from symid.robot.elasticity import Elasticity

__all__ = ["find_spring_bound"]

_WINDOW = 0.02
"""s, over which the link equations are integrated: differences of the momentum would be coarser."""
_EXACT = 1e-4
"""Of the largest singular value of the link equations; integration leaves 1e-5, what is seen a hundred times
more."""
_BLIND = 1e-6
"""Of the largest singular value of what is open in the motor equations; they do not see what is below it."""


def find_spring_bound(
    library: Library, signals: Sequence[ElasticSignals], noise: Sequence[FloatArray]
) -> FloatArray:
    """Return the least covariance (p + n + pf, p + n + pf) of chi where the form of the springs is known.

    Torque noise only, white, states exact; `covariance.find_bound` is that of who knows nothing of springs.

    Args:
        library: functions of the robot, whose card states the true springs of all joints.
        signals: noise-free states of every recording, at the sample rate of the noisy ones.
        noise: (n,) standard deviation of the torque noise of every recording, N m or N.
    """
    card = library.card
    beta, count = len(card.beta), len(card.beta) + card.size + len(card.friction)
    springs = [spring for spring in card.elasticity if spring is not None]
    motor, link = [], []
    for part, sigma in zip(signals, noise, strict=True):
        torques = _find_spring_columns(springs, part.phi)
        motor.append(_build_motor_rows(library, part, torques) / sigma[:, None])
        link.append(_build_link_rows(library, part, torques))
    motors, links = (
        np.concatenate([rows.reshape(-1, rows.shape[2]) for rows in side]) for side in (motor, link)
    )
    open_ways = _find_null_space(links)
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


def _find_spring_columns(springs: Sequence[Elasticity], phi: FloatArray) -> FloatArray:
    """Return the derivatives (N, n, w) of the springs' torques by all their numbers."""
    parts = []
    for joint, spring in enumerate(springs):
        weights = read_weights(spring)
        basis = find_stop_basis(phi[:, joint], weights.thresholds)
        columns = find_spring_slopes(basis, find_slips(basis, weights.thresholds), weights)[:, :-1]
        own = np.zeros((len(phi), len(springs), columns.shape[1]))
        own[:, joint] = columns
        parts.append(own)
    return np.concatenate(parts, axis=2)


def _build_motor_rows(library: Library, part: ElasticSignals, torques: FloatArray) -> FloatArray:
    """Return the columns (N, n, n + pf + w) of rotors, friction and springs."""
    rotor = differentiate(part.dtheta, part.period)[:, :, None] * np.eye(library.card.size)
    columns = [rotor]
    if library.card.friction:
        columns.append(library.evaluate("friction_regressor", part.dtheta)[0])
    return np.concatenate([*columns, torques], axis=2)


def _build_link_rows(library: Library, part: ElasticSignals, torques: FloatArray) -> FloatArray:
    """Return the columns (M, n, p + w) of links and springs, integrated over windows."""
    (momentum,) = library.evaluate("momentum_regressor", part.q, part.dq)
    (lagrange,) = library.evaluate("lagrange_regressor", part.q, part.dq)
    ends = slice(None, None, max(1, round(_WINDOW / part.period)))

    def add(values: FloatArray) -> FloatArray:
        steps = np.cumsum((values[1:] + values[:-1]) / 2.0, axis=0) * part.period
        sums: FloatArray = np.diff(np.concatenate([np.zeros_like(values[:1]), steps])[ends], axis=0)
        return sums

    return np.concatenate([np.diff(momentum[ends], axis=0) - add(lagrange), -add(torques)], axis=2)


def _find_null_space(rows: FloatArray) -> FloatArray:
    """Return directions (columns, k) that the rows (m, columns) do not see, columns scaled to one length."""
    lengths = np.linalg.norm(rows, axis=0)
    lengths = np.where(lengths > 1e-12 * float(lengths.max()), lengths, np.inf)
    triangle = np.asarray(np.linalg.qr(rows / lengths, mode="r"))
    _, singular, directions = np.linalg.svd(triangle)
    hidden = directions[singular <= _EXACT * singular[0]].T
    ways: FloatArray = hidden / np.where(np.isfinite(lengths), lengths, 1.0)[:, None]
    return ways
