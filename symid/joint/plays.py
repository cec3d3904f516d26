"""Plays and the springs made of them, for all samples of a recording at once.

Input: torsion or torque (N,), thresholds, elasticity. Output: plays, torque, torsion, work; see `hysteresis`
for the equations. `memory` is the play of each stop before the first sample; None is the virgin spring, all
zero. The first sample is taken as the end of a monotone path from wherever the memory was made.

    work per step, phi monotone: int E_r dphi = change of E_r^2 / 2 + r |change of P_r|

with knees int S(v) dphi = sum_i w'_i int S(v) dP'_i[v], where phi = sum_i w'_i P'_i[v] is the inverse; a
play moves only while v = P'_i + r'_i or v = P'_i - r'_i: each part is a difference of G, the integral of S.

Supported: samples between which the input is monotone: exact, however far apart they are.
Not supported: the inverse of a cubic spring; the work of a spring with a cubic part and knees.
"""

import math
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, RobotError
from symid.joint.play_model import PlayModel, find_play_model, invert_pi
from symid.joint.spring_numbers import (
    SpringNumbers,
    find_outer_integral,
    find_outer_torque,
    find_spring_numbers,
    invert_outer,
)
from symid.robot.elasticity import Elasticity

__all__ = [
    "InversePlays",
    "find_hysteresis_torque",
    "find_inverse_plays",
    "find_pi_output",
    "find_plays",
    "find_spring_work",
    "find_stop_basis",
    "find_work_columns",
    "invert_hysteresis",
]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InversePlays:
    """The torsion as a sum of plays of the torque before the knees: phi = sum_i w'_i P'_i[v].

    Args:
        plays: (N, m + 1) P'_i, N m or N; the first is v itself.
        thresholds: (m + 1,) r'_i, the first zero.
        weights: (m + 1,) w'_i, rad/(N m) or m/N.
    """

    plays: FloatArray
    thresholds: FloatArray
    weights: FloatArray


def find_plays(values: FloatArray, thresholds: FloatArray, memory: FloatArray | None = None) -> FloatArray:
    """Return the plays (N, m) of an input (N,), exactly as sample after sample would give them.

    A step P -> max(a, min(b, P)) is a clamp, and clamps in a row are a clamp: blocks of samples become one
    each, the blocks are run through in order, then all blocks are filled at once.

    Args:
        values: (N,) input.
        thresholds: (m,) of the plays, not negative, in the unit of the input.
        memory: (m,) plays before the first sample; None for zeros.
    """
    values = np.asarray(values, dtype=np.float64)
    radii = np.asarray(thresholds, dtype=np.float64)
    count = values.shape[0]
    state = np.zeros(radii.size) if memory is None else np.asarray(memory, dtype=np.float64)
    if count == 0 or radii.size == 0:
        return np.empty((count, radii.size))
    length = max(1, math.isqrt(count))
    blocks = -(-count // length)
    padded = np.concatenate([values, np.full(blocks * length - count, values[-1])])
    # Samples of one place in their blocks stand together: each turn of the loops works on one slab.
    slabs = padded.reshape(blocks, length).T[:, :, None]
    lower, upper = slabs - radii, slabs + radii
    low, high = lower[0].copy(), upper[0].copy()
    for least, most in zip(lower[1:], upper[1:], strict=True):
        np.maximum(least, np.minimum(most, low, out=low), out=low)
        np.maximum(least, np.minimum(most, high, out=high), out=high)
    entry = np.empty((blocks, radii.size))
    for block in range(blocks):
        entry[block] = state
        state = np.maximum(low[block], np.minimum(high[block], state))
    plays = np.empty((length, blocks, radii.size))
    for least, most, out in zip(lower, upper, plays, strict=True):
        np.maximum(least, np.minimum(most, entry, out=entry), out=entry)
        out[...] = entry
    return np.ascontiguousarray(plays.transpose(1, 0, 2)).reshape(-1, radii.size)[:count]


def find_stop_basis(phi: FloatArray, thresholds: FloatArray, memory: FloatArray | None = None) -> FloatArray:
    """Return [phi, E_1 .. E_m] (N, m + 1); times k0, k_1 .. k_m they are the torque without knees."""
    phi = np.asarray(phi, dtype=np.float64)
    return np.column_stack([phi, phi[:, None] - find_plays(phi, thresholds, memory)])


def find_pi_output(model: PlayModel, values: FloatArray, memory: FloatArray | None = None) -> FloatArray:
    """Return w_0 x + sum_i w_i P_i[x] (N,) for an input (N,) and the plays (m,) before it."""
    values = np.asarray(values, dtype=np.float64)
    plays = find_plays(values, np.array(model.thresholds), memory)
    weights = np.array(model.weights)
    return np.asarray(weights[0] * values + plays @ weights[1:], dtype=np.float64)


def find_hysteresis_torque(
    elasticity: Elasticity,
    phi: FloatArray,
    dphi: FloatArray | None = None,
    memory: FloatArray | None = None,
) -> FloatArray:
    """Return the torque (N,) of an elastic joint along its torsion.

    Args:
        elasticity: the joint.
        phi: (N,) torsion theta - q, rad or m.
        dphi: (N,) its rate; None leaves the damping out.
        memory: (m,) plays before the first sample, rad or m; None for zeros.

    Raises:
        RobotError: a stiffness is not known.
    """
    spring = find_spring_numbers(elasticity)
    torque = find_outer_torque(spring.terms, _find_inner(spring, phi, memory))
    return torque if dphi is None else torque + elasticity.damping * np.asarray(dphi, dtype=np.float64)


def invert_hysteresis(
    elasticity: Elasticity, torque: FloatArray, memory: FloatArray | None = None
) -> FloatArray:
    """Return the torsion (N,) at which an elastic joint has the given torque, damping left out.

    Args:
        elasticity: the joint.
        torque: (N,) N m or N.
        memory: (m,) plays of the torsion before the first sample, as for `find_hysteresis_torque`.

    Raises:
        RobotError: the spring is cubic, or does not rise; a stiffness is not known; no history of the torsion
            leaves such a memory.
    """
    _refuse_cubic(elasticity)
    spring = find_spring_numbers(elasticity)
    model = find_play_model(elasticity)
    inverse, image = invert_pi(model, memory)
    return find_pi_output(inverse, invert_outer(spring.terms, np.asarray(torque, dtype=np.float64)), image)


def find_work_columns(
    phi: FloatArray, thresholds: FloatArray, memory: FloatArray | None = None
) -> FloatArray:
    """Return the work (N, m + 1) since the first sample per unit of k0, k_1 .. k_m.

    phi^2 / 2, and E_i^2 / 2 + r_i times the way of P_i, less their values at the first sample.
    """
    phi = np.asarray(phi, dtype=np.float64)
    radii = np.asarray(thresholds, dtype=np.float64)
    plays = find_plays(phi, radii, memory)
    stored = 0.5 * np.square(np.column_stack([phi, phi[:, None] - plays]))
    lost = radii * np.cumsum(np.abs(np.diff(plays, axis=0, prepend=plays[:1])), axis=0)
    columns = stored - stored[:1]
    columns[:, 1:] += lost
    return columns


def find_spring_work(elasticity: Elasticity, phi: FloatArray, memory: FloatArray | None = None) -> FloatArray:
    """Return the work (N,) in J done on the spring since the first sample, damping left out.

    Raises:
        RobotError: the spring has a cubic part and knees; a stiffness is not known.
    """
    phi = np.asarray(phi, dtype=np.float64)
    spring = find_spring_numbers(elasticity)
    if not elasticity.knees:
        columns = find_work_columns(phi, spring.thresholds, memory)
        quartic = 0.25 * spring.cubic * (phi**4 - phi[:1] ** 4)
        weights = np.concatenate([[spring.stiffness], spring.weights])
        return np.asarray(columns @ weights + quartic, dtype=np.float64)
    inverse = find_inverse_plays(elasticity, phi, memory)
    ways = np.diff(inverse.plays, axis=0, prepend=inverse.plays[:1])
    # While it moves up a play trails its input by the threshold, and leads it while it moves down.
    edges = np.sign(ways) * inverse.thresholds
    ends = find_outer_integral(spring.terms, inverse.plays + edges)
    starts = find_outer_integral(spring.terms, inverse.plays - ways + edges)
    return np.cumsum((ends - starts) @ inverse.weights)


def find_inverse_plays(
    elasticity: Elasticity, phi: FloatArray, memory: FloatArray | None = None
) -> InversePlays:
    """Return the plays of the inverse along the torsion (N,), from those of the torsion itself.

    P'_i = W_i P_i - sum_{j > i} k_j P_j with W_i = k0 + sum_{j > i} k_j; P'_0 = v.

    Raises:
        RobotError: the spring is cubic, or does not rise; a stiffness is not known.
    """
    _refuse_cubic(elasticity)
    inverse, _ = invert_pi(find_play_model(elasticity))
    spring = find_spring_numbers(elasticity)
    phi = np.asarray(phi, dtype=np.float64)
    plays = np.column_stack([phi, find_plays(phi, spring.thresholds, memory)])
    weights = np.concatenate([[0.0], spring.weights])
    slopes = spring.stiffness + np.sum(weights) - np.cumsum(weights)
    shares = np.diag(slopes) - np.tril(np.broadcast_to(weights[:, None], (weights.size,) * 2), -1)
    return InversePlays(
        plays=plays @ shares,
        thresholds=freeze((0.0, *inverse.thresholds)),
        weights=freeze(inverse.weights),
    )


def _refuse_cubic(elasticity: Elasticity) -> None:
    """Refuse a cubic part where the closed form is that of plays.

    Raises:
        RobotError: the spring has a cubic part.
    """
    if elasticity.cubic:
        text = (
            "a cubic spring has no inverse in closed form, nor together with knees one of its work; "
            "describe its hardening by knees alone"
        )
        raise RobotError(Notice(code="robot.cubic-spring", text=text))


def _find_inner(spring: SpringNumbers, phi: FloatArray, memory: FloatArray | None) -> FloatArray:
    """Return v = k0 phi + k3 phi^3 + sum_i k_i E_i (N,)."""
    phi = np.asarray(phi, dtype=np.float64)
    stops = phi[:, None] - find_plays(phi, spring.thresholds, memory)
    inner = spring.stiffness * phi + stops @ spring.weights
    return inner + spring.cubic * phi**3 if spring.cubic else inner
