"""The optimum of `consistent_cost` over all bodies, by Newton's method in their own parameters.

Input: `ConsistentCost`. Output: `BodiesFound`: bodies, and how far their cost can be from the least.

In Q the cost is convex, and over its weight self-concordant. With Q = C C' a step C (1 + E) C' solves

    min |J e + r|^2 + t sum (|E + C' B C - 1|^2 + (e_u + b u - 1)^2) + s sum (e_v - 1)^2,

r the weighted errors, J their slopes along e, u (1 + e_u) and v (1 + e_v): the logarithms come to unit
matrices there, and QR of these rows keeps the digits that normal equations lose, near the edge of all bodies
too. The best length along each step is found exactly. The weight t of the distance falls to g from one at
which the bodies expected are next to the optimum, s of -log v, which stands for v >= 0, further, to nearly
nothing. It falls fast where few steps reach the next optimum; where they are many, the way bends, and it
falls again and less. Newton's decrement l bounds what is left, with b numbers v:

    cost - least <= s (-l - log(1 - l)) + s b,   l^2 = e' H e / s

(Nesterov and Nemirovskii 1994, Interior-point polynomial algorithms in convex programming, chapter 2).

Supported: every rank of the rows, any parameters, bodies that exist or not.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.estimators.consistent_cost import LOOSE, ConsistentCost

__all__ = ["BodiesFound", "find_bodies"]

_LIMIT = 3000
# Rules of thumb, seen in no result: they only decide how many steps it takes.
_FALL = 0.1
_STEEPEST = 1e-3
_FEW = 3
_MANY = 6
_NEAR = 0.3
_KEPT = 0.95
_STEPS_OF_LENGTH = 60
# The last weight of the logarithms of friction, and what of a step may be left undone, in units of g.
_BOUND = 1e-10
_DONE = 1e-20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodiesFound:
    """Where Newton's method ended.

    Args:
        factors: (n, 4, 4) C, lower triangular, Q = C C'; rotors: (a,) u; others: (b + c,) v.
        gap: the cost is above the least by this at most, but for rounding; infinite where it did not arrive.
        iterations: steps.
    """

    factors: FloatArray
    rotors: FloatArray
    others: FloatArray
    gap: float = np.inf
    iterations: int = 0


class _Step(NamedTuple):
    """E (n, 4, 4), e_u (a,), e of the others (b + c,); J e (k,); e' H e."""

    blocks: FloatArray
    rotors: FloatArray
    others: FloatArray
    change: FloatArray
    promise: float


class _Weights(NamedTuple):
    """t of the distance, s of what must not be negative."""

    distance: float
    bound: float


def _find_errors(cost: ConsistentCost, state: BodiesFound) -> FloatArray:
    """Return r (k,)."""
    blocks = state.factors @ state.factors.transpose(0, 2, 1)
    values = np.einsum("pnab,nab->p", cost.forms, blocks)
    values = values + cost.positive @ state.rotors + cost.others @ state.others
    errors: FloatArray = cost.triangle @ np.append(values, -1.0)
    return errors


def _find_step(cost: ConsistentCost, state: BodiesFound, errors: FloatArray, weights: _Weights) -> _Step:
    """Return Newton's step."""
    from symid.parameters.consistency_problem import flatten, unflatten

    links, rotors, bounded = len(state.factors), len(state.rotors), cost.bounded
    across = state.factors.transpose(0, 2, 1)
    rows = cost.triangle[:, :-1]
    forms = flatten(across @ cost.forms @ state.factors)
    sizes = np.append(state.others[:bounded], np.ones(len(state.others) - bounded))
    effects = np.hstack([forms.reshape(len(forms), -1), cost.positive * state.rotors, cost.others * sizes])
    slopes = rows @ effects
    first, second = 10 * links, 10 * links + rotors
    pull = flatten(across @ cost.pulls @ state.factors - np.eye(4))
    held = np.zeros((slopes.shape[1] + bounded, slopes.shape[1]))
    aim = np.zeros(len(held))
    root = np.sqrt(weights.distance)
    held[range(second), range(second)] = root
    aim[:first] = -root * pull.ravel()
    aim[first:second] = -root * (cost.rotor_pulls * state.rotors - 1.0)
    spots = np.arange(second, slopes.shape[1])
    held[spots, spots] = np.sqrt(LOOSE) * sizes
    aim[spots] = -np.sqrt(LOOSE) * (state.others - cost.middle)
    edge = np.arange(bounded)
    held[len(aim) - bounded + edge, second + edge] = np.sqrt(weights.bound)
    aim[len(aim) - bounded :] = np.sqrt(weights.bound)
    whole, right = np.vstack([slopes, held]), np.concatenate([-errors, aim])
    lengths = np.linalg.norm(whole, axis=0)
    factor: FloatArray = np.asarray(np.linalg.qr(np.column_stack([whole / lengths, right]), mode="r"))
    size = len(lengths)
    chosen = np.linalg.solve(factor[:size, :size], factor[:size, size])
    step = chosen / lengths
    return _Step(
        blocks=unflatten(step[:first].reshape(links, 10)),
        rotors=step[first:second],
        others=step[second:],
        change=slopes @ step,
        promise=float(factor[:size, size] @ factor[:size, size]),
    )


def _find_length(
    cost: ConsistentCost, state: BodiesFound, errors: FloatArray, step: _Step, weights: _Weights
) -> float:
    """Return the length of least cost along a step, where its slope, which only grows, is zero."""
    bounded = cost.bounded
    own = np.linalg.eigvalsh(step.blocks).ravel()
    logs = np.concatenate([own, step.rotors, step.others[:bounded]])
    shares = np.full(len(logs), weights.distance)
    shares[len(logs) - bounded :] = weights.bound
    pulls = state.factors.transpose(0, 2, 1) @ cost.pulls @ state.factors
    linear = weights.distance * float(
        np.einsum("nab,nab->", pulls, step.blocks) + (cost.rotor_pulls * state.rotors) @ step.rotors
    )
    moved = step.others * np.append(state.others[:bounded], np.ones(len(step.others) - bounded))
    linear += float(errors @ step.change) + LOOSE * float((state.others - cost.middle) @ moved)
    square = float(step.change @ step.change) + LOOSE * float(moved @ moved)
    lowest = float(logs.min(initial=0.0))
    low, high = 0.0, -_KEPT / lowest if lowest < 0.0 else 1e3
    length = min(1.0, high)
    for _ in range(_STEPS_OF_LENGTH):
        inner = logs / (1.0 + length * logs)
        slope = linear + length * square - float(shares @ inner)
        low, high = (length, high) if slope < 0.0 else (low, length)
        newton = length - slope / (square + float(shares @ inner**2))
        following = newton if low < newton < high else 0.5 * (low + high)
        if abs(following - length) < 1e-3 * length:
            return following
        length = following
    return length


def _advance(cost: ConsistentCost, state: BodiesFound, step: _Step, length: float) -> BodiesFound:
    bounded = cost.bounded
    inner = np.linalg.cholesky(np.eye(4) + length * step.blocks)
    held = state.others[:bounded] * (1.0 + length * step.others[:bounded])
    return replace(
        state,
        factors=state.factors @ inner,
        rotors=state.rotors * (1.0 + length * step.rotors),
        others=np.append(held, state.others[bounded:] + length * step.others[bounded:]),
        iterations=state.iterations + 1,
    )


def _centre(cost: ConsistentCost, state: BodiesFound, level: float, limit: int) -> tuple[BodiesFound, int]:
    """Return where at most `limit` steps lead at one weight, and their number; more if they do not arrive."""
    weights = _Weights(max(level, cost.weight), level)
    for count in range(limit + 1):
        errors = _find_errors(cost, state)
        step = _find_step(cost, state, errors, weights)
        if step.promise < _NEAR**2 * level:
            return state, count
        if not np.isfinite(step.promise):
            break
        state = _advance(cost, state, step, _find_length(cost, state, errors, step, weights))
    return state, limit + 1


def _polish(cost: ConsistentCost, state: BodiesFound, level: float) -> BodiesFound:
    """Return the state after whole steps, until they promise no more or rounding lets them gain no more."""
    weights = _Weights(cost.weight, level)
    last = np.inf
    while True:
        step = _find_step(cost, state, _find_errors(cost, state), weights)
        if not _DONE * cost.weight < step.promise < 0.25 * last:
            left = float(np.sqrt(np.fmin(step.promise, last) / level))
            # -l - log(1 - l) <= l^2 / (2 (1 - l)), without the digits that the left-hand side loses.
            return replace(state, gap=level * (0.5 * left**2 / (1.0 - left) + cost.bounded))
        state, last = _advance(cost, state, step, 1.0), step.promise


def _start(cost: ConsistentCost, unknowns: FloatArray) -> BodiesFound:
    factors, rotors, others = cost.split(unknowns)
    inner = np.maximum(others[: cost.bounded], 1.0)
    return BodiesFound(factors=factors, rotors=rotors, others=np.append(inner, others[cost.bounded :]))


def find_bodies(cost: ConsistentCost, start: FloatArray, known: float | None = None) -> BodiesFound:
    """Return the bodies of least cost.

    Args:
        cost: what to minimise.
        start: (u,) unknowns of the cost.
        known: the weight of which `start` is the optimum; None where it is any bodies.
    """
    state, fall = _start(cost, start), _FALL
    errors = _find_errors(cost, state)
    end = _BOUND * cost.weight if cost.bounded else cost.weight
    level = max(cost.weight, float(errors @ errors) if known is None else known)
    # As short a step along the way that whole Newton steps follow it: it always arrives.
    gentle = 1.0 - _NEAR / np.sqrt(4 * len(cost.roots) + len(state.rotors) + cost.bounded)
    state, spent = _centre(cost, state, level, _LIMIT)
    while spent < _LIMIT:
        if level <= end:
            return replace(_polish(cost, state, end), iterations=spent)
        below = max(end, fall * level)
        patience = _MANY if fall < gentle else _LIMIT - spent
        reached, count = _centre(cost, state, below, patience)
        spent += count
        if count > patience:
            fall = min(gentle, float(np.sqrt(fall)))
            continue
        state, level = reached, below
        if count <= _FEW:
            fall = max(_STEEPEST, fall**1.5)
    return replace(state, iterations=spent)
