"""Bodies that can exist: pseudo-inertias, a prior, and those nearest to it under weighted rows or equations.

Standard parameters (n, 10) -> pseudo-inertias (n, 4, 4), and back: P = [[S, MS], [MS', M]] with the second
moments S = tr(I) / 2 - I (Wensing, Kim and Slotine 2018), positive definite if the body can exist. Prior of a
link: what the robot file states, else a round body whose centre of mass lies half-way to the joints it
carries, with a quarter of the distance to the farthest of them as radius of gyration (of the mean over all
links, or 0.1 m, where it carries none), all of one mass, that nearest to the base values.

`BodyProblem`: rows over blocks (symmetric 4 x 4), positive numbers and others, all scaled so that what is
expected is one (the unit matrix, 1) -> `NearestBodies`.

    minimise  f = |r|^2 / 2 + g D + k |v - v0|^2 / 2,   r_i = sum tr X_i Q + a_i u + c_i v - b_i,
              D = sum w (tr Q - log det Q - 4) + sum w (u - log u - 1)

over Q > 0, u > 0 and v, the first of which must not be negative (a barrier -s log v): Newton's steps C (1 +
E) C', Q = C C', on a falling weight of the distance, from QR of the rows. With Newton's decrement l and b
bounded numbers f - least <= s (-l - log(1 - l)) + s b (Nesterov and Nemirovskii 1994, Interior-point
polynomial algorithms in convex programming, chapter 2). Equations r = 0 are kept in every step instead.

Supported: every rank of the rows; a few hundred of them, dense; fixed bases, symbolic lengths with a value.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray, compute_triangle
from symid.robot import Robot, build_pseudo_inertias

_REACH = 0.1
# Flat and thin bodies lie on the edge of what is possible: there the distance to them is infinite.
_ROUNDED = 1e-3


_UNITS = build_pseudo_inertias(np.eye(10)).reshape(10, 16)
# Symmetric V_k (10, 4, 4) with parameter k = tr(V_k P): entries are 0 (of no sign), 1/2 and 1.
PSEUDO_INERTIA_FORMS = 0.5 * np.rint(2.0 * np.linalg.pinv(_UNITS).T).reshape(10, 4, 4) + 0.0
Weights = tuple[float, float]
"""Of the distance, and of the logarithms of what must not be negative."""
_UPPER = np.triu_indices(4)
_FACTORS = np.where(_UPPER[0] == _UPPER[1], 1.0, np.sqrt(2.0))

_LIMIT = 3000
# Rules of thumb that change no result, only the number of steps.
_FALL = 0.1
_STEEPEST = 1e-3
_FEW = 3
_MANY = 6
_NEAR = 0.3
_KEPT = 0.95
_STEPS_OF_LENGTH = 60
# The last weight of the logarithms of what is bounded, and what of a step may be left undone, in units of g.
_BOUND = 1e-10
_DONE = 1e-30
# Towards the targets of equations: the part of the way to the edge of all bodies in one step, the least step.
_TOWARDS = 0.7
_SHORTEST = 1e-8
# Error that solved equations may have, in units of the sizes of what they add up. Tests reach 3e-14.
_REACHED = 1e-10


def compute_standard_parameters(pseudo_inertias: FloatArray) -> FloatArray:
    """Return the standard parameters (n, 10) of pseudo-inertias (n, 4, 4)."""
    found: FloatArray = np.einsum("kab,nab->nk", PSEUDO_INERTIA_FORMS, pseudo_inertias)
    return found


def _round_off(stated: FloatArray, body: FloatArray) -> FloatArray | None:
    """Return a stated pseudo-inertia, made round where it is flat; None where no body has it."""
    mass = float(stated[3, 3])
    if mass <= 0:
        return None
    inverse = np.linalg.inv(np.linalg.cholesky(mass * body))
    smallest = float(np.linalg.eigvalsh(inverse @ stated @ inverse.T)[0])
    rounded = stated if smallest > _ROUNDED else stated + 2 * _ROUNDED * mass * body
    return None if smallest < -_ROUNDED else rounded


def compute_whitening(covariance: FloatArray, least: float) -> FloatArray | None:
    """Return W with W C W' = 1 of a covariance C (m, m), None where it has no finite, positive variances.

    `least` is the smallest variance of a direction, in units of the largest: rounding can make it zero.
    """
    variances = np.diag(covariance)
    if not (np.all(np.isfinite(covariance)) and np.all(variances > 0.0)):
        return None
    deviations = np.sqrt(variances)
    values, vectors = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    kept = np.maximum(values, least * values[-1])
    return np.asarray((vectors / np.sqrt(kept)).T / deviations, dtype=np.float64)


def build_prior(robot: Robot, grouping: FloatArray, values: Sequence[float] | FloatArray) -> FloatArray:
    """Return a consistent set of standard parameters (n, 10) to start from.

    `grouping` (m, 10 n): the equations' coefficients of the links' parameters; `values` (m,): their sums.
    """
    # Round bodies of unit mass, from the positions of the joints that a link carries.
    symbols = dict(robot.symbols)
    spans: list[list[FloatArray]] = [[] for _ in robot.joints]
    for joint in robot.joints:
        if joint.parent >= 0:
            place = [value.to_float(symbols) for value in joint.placement.translation]
            spans[joint.parent].append(np.array(place))
    lengths = [max((float(np.linalg.norm(point)) for point in points), default=0.0) for points in spans]
    seen = [length for length in lengths if length > 0]
    usual = sum(seen) / len(seen) if seen else _REACH
    bodies = np.empty((robot.size, 4, 4))
    for body, points, length in zip(bodies, spans, lengths, strict=True):
        extended = np.append(0.5 * np.mean(points, axis=0) if points else np.zeros(3), 1.0)
        spread = np.diag([1.0, 1.0, 1.0, 0.0])
        body[:] = np.outer(extended, extended) + ((length or usual) / 4) ** 2 * spread
    stated: list[FloatArray | None] = [
        None
        if joint.inertial is None
        else _round_off(build_pseudo_inertias(np.array([joint.inertial]))[0], body)
        for joint, body in zip(robot.joints, bodies, strict=True)
    ]
    known = np.array([np.zeros((4, 4)) if body is None else body for body in stated])
    unknown = np.array([body if one is None else 0 * body for body, one in zip(bodies, stated, strict=True)])
    unit = compute_standard_parameters(unknown).ravel()
    sizes = np.abs(grouping) @ np.abs(compute_standard_parameters(bodies).ravel())
    used = sizes > 0
    missing = (np.asarray(values) - grouping @ compute_standard_parameters(known).ravel())[used] / sizes[used]
    share = (grouping @ unit)[used] / sizes[used]
    mass = float(share @ missing) / float(share @ share) if np.any(share) else 0.0
    if mass <= 0:
        mass = float(np.abs(missing).max(initial=0.0)) or 1.0
    return compute_standard_parameters(known + mass * unknown)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyProblem:
    """Rows and weights.

    Args:
        blocks: (m, n, 4, 4) symmetric X_i; positive: (m, a) a_i; others: (m, c) c_i.
        target: (m,) b.
        shares: (n + a,) w of the blocks and the positive numbers; weight: g.
        middle: (c,) v0; loose: k; bounded: how many of the others, the first, must not be negative.
    """

    blocks: FloatArray
    positive: FloatArray
    others: FloatArray
    target: FloatArray
    shares: FloatArray
    middle: FloatArray
    weight: float = 1.0
    loose: float = 1.0
    bounded: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NearestBodies:
    """Where Newton's method ended.

    Args:
        factors: (n, 4, 4) C, lower triangular, Q = C C'; positive: (a,) u; others: (c,) v.
        multipliers: (m,) nu = r / g, zero where the rows are equations.
        gap: the cost is above the least by this at most, but for rounding; infinite if not converged.
        gradient: its largest entry, unknowns in units of their standard deviations.
        stationarity: Newton's decrement over the root of the weight: a relative error of the bodies.
        iterations: steps.
    """

    factors: FloatArray
    positive: FloatArray
    others: FloatArray
    multipliers: FloatArray
    gap: float = np.inf
    gradient: float = np.inf
    stationarity: float = np.inf
    iterations: int = 0

    @property
    def blocks(self) -> FloatArray:
        """Q (n, 4, 4)."""
        blocks: FloatArray = self.factors @ self.factors.transpose(0, 2, 1)
        return blocks


class _Step(NamedTuple):
    """E (n, 4, 4), e_u (a,), e of the others (c,); J e (m,); e' H e; the gradient's largest entry."""

    blocks: FloatArray
    positive: FloatArray
    others: FloatArray
    change: FloatArray
    promise: float
    gradient: float


def _flatten(matrices: FloatArray) -> FloatArray:
    """Return symmetric matrices (..., 4, 4) as vectors (..., 10) with the same scalar product."""
    return np.asarray(matrices[..., _UPPER[0], _UPPER[1]] * _FACTORS, dtype=np.float64)


def compute_errors(problem: BodyProblem, state: NearestBodies) -> FloatArray:
    """Return r (m,)."""
    reached = np.einsum("mnab,nab->m", problem.blocks, state.blocks)
    errors: FloatArray = (
        reached + problem.positive @ state.positive + problem.others @ state.others - problem.target
    )
    return errors


def compute_distance(problem: BodyProblem, state: NearestBodies) -> float:
    """Return D."""
    links = len(state.factors)
    traces = np.sum(state.factors**2, axis=(1, 2))
    logs = 2.0 * np.log(np.diagonal(state.factors, axis1=1, axis2=2)).sum(axis=1)
    apart = np.append(traces - logs - 4.0, state.positive - np.log(state.positive) - 1.0)
    return float(problem.shares[:links] @ apart[:links] + problem.shares[links:] @ apart[links:])


def compute_cost(problem: BodyProblem, state: NearestBodies) -> float:
    """Return f."""
    errors, off = compute_errors(problem, state), state.others - problem.middle
    squares = 0.5 * float(errors @ errors) + 0.5 * problem.loose * float(off @ off)
    return squares + problem.weight * compute_distance(problem, state)


def _compute_slopes(problem: BodyProblem, state: NearestBodies, sizes: FloatArray) -> FloatArray:
    """Return the slopes J (m, unknowns) along e, u (1 + e_u) and v + sizes e_v."""
    forms = _flatten(state.factors.transpose(0, 2, 1) @ problem.blocks @ state.factors)
    forms = forms.reshape(len(problem.target), -1)
    return np.hstack([forms, problem.positive * state.positive, problem.others * sizes])


def _compute_pull(state: NearestBodies) -> FloatArray:
    """Return C' C - 1, flat, and u - 1."""
    inner = state.factors.transpose(0, 2, 1) @ state.factors - np.eye(4)
    return np.append(_flatten(inner).ravel(), state.positive - 1.0)


def _split_step(
    at: NearestBodies, step: FloatArray, change: FloatArray, promise: float, gradient: float
) -> _Step:
    first = 10 * len(at.factors)
    second = first + len(at.positive)
    blocks = np.zeros((len(at.factors), 4, 4))
    blocks[:, _UPPER[0], _UPPER[1]] = step[:first].reshape(-1, 10) / _FACTORS
    blocks += np.triu(blocks, 1).transpose(0, 2, 1)
    return _Step(blocks, step[first:second], step[second:], change, promise, gradient)


def _compute_step(problem: BodyProblem, state: NearestBodies, errors: FloatArray, weights: Weights) -> _Step:
    """Return Newton's step e, with the logarithms as rows beside those of the problem.

    min |J e + r|^2 + t sum w (|E + C' C - 1|^2 + (e_u + u - 1)^2) + s sum (e_v - 1)^2 + k |v + v e_v - v0|^2
    """
    links, bounded = len(state.factors), problem.bounded
    second = 10 * links + len(state.positive)
    sizes = np.append(state.others[:bounded], np.ones(len(state.others) - bounded))
    slopes = _compute_slopes(problem, state, sizes)
    roots = np.sqrt(weights[0] * problem.shares)
    roots = np.append(np.repeat(roots[:links], 10), roots[links:])
    held = np.zeros((slopes.shape[1] + bounded, slopes.shape[1]))
    held[range(second), range(second)] = roots
    spots = np.arange(second, slopes.shape[1])
    held[spots, spots] = np.sqrt(problem.loose) * sizes
    edge = np.arange(bounded)
    held[slopes.shape[1] + edge, second + edge] = np.sqrt(weights[1])
    off = -np.sqrt(problem.loose) * (state.others - problem.middle)
    wanted = np.full(bounded, np.sqrt(weights[1]))
    right = np.concatenate([-errors, -roots * _compute_pull(state), off, wanted])
    whole = np.vstack([slopes, held])
    lengths = np.linalg.norm(whole, axis=0)
    whole = whole / lengths
    factor = compute_triangle(np.column_stack([whole, right]))
    size = len(lengths)
    step = np.linalg.solve(factor[:size, :size], factor[:size, size]) / lengths
    promise = float(factor[:size, size] @ factor[:size, size])
    return _split_step(state, step, slopes @ step, promise, float(np.abs(whole.T @ right).max()))


def _compute_length(
    problem: BodyProblem, state: NearestBodies, errors: FloatArray, step: _Step, weights: Weights
) -> float:
    """Return the length of least cost along a step, where its slope, which only grows, is zero."""
    links, bounded = len(state.factors), problem.bounded
    shares = weights[0] * problem.shares
    logs = np.concatenate([np.linalg.eigvalsh(step.blocks).ravel(), step.positive, step.others[:bounded]])
    parts = [np.repeat(shares[:links], 4), shares[links:], np.full(bounded, weights[1])]
    weighted = np.concatenate(parts)
    pulls = state.factors.transpose(0, 2, 1) @ state.factors
    linear = float(shares[:links] @ np.einsum("nab,nab->n", pulls, step.blocks))
    linear += float((shares[links:] * state.positive) @ step.positive)
    moved = step.others * np.append(state.others[:bounded], np.ones(len(step.others) - bounded))
    linear += float(errors @ step.change) + problem.loose * float((state.others - problem.middle) @ moved)
    square = float(step.change @ step.change) + problem.loose * float(moved @ moved)
    lowest = float(logs.min(initial=0.0))
    low, high = 0.0, -_KEPT / lowest if lowest < 0.0 else 1e3
    length = min(1.0, high)
    for _ in range(_STEPS_OF_LENGTH):
        inner = logs / (1.0 + length * logs)
        slope = linear + length * square - float(weighted @ inner)
        low, high = (length, high) if slope < 0.0 else (low, length)
        newton = length - slope / (square + float(weighted @ inner**2))
        following = newton if low < newton < high else 0.5 * (low + high)
        if abs(following - length) < 1e-3 * length:
            return following
        length = following
    return length


def _advance(problem: BodyProblem, state: NearestBodies, step: _Step, length: float) -> NearestBodies:
    bounded = problem.bounded
    held = state.others[:bounded] * (1.0 + length * step.others[:bounded])
    return replace(
        state,
        factors=state.factors @ np.linalg.cholesky(np.eye(4) + length * step.blocks),
        positive=state.positive * (1.0 + length * step.positive),
        others=np.append(held, state.others[bounded:] + length * step.others[bounded:]),
        iterations=state.iterations + 1,
    )


def _centre(problem: BodyProblem, state: NearestBodies, level: float, most: int) -> tuple[NearestBodies, int]:
    """Return where at most `most` steps lead at one weight, and their number; more if they do not arrive."""
    weights = (max(level, problem.weight), level)
    for count in range(most + 1):
        errors = compute_errors(problem, state)
        step = _compute_step(problem, state, errors, weights)
        if step.promise < _NEAR**2 * level * problem.shares.min():
            return state, count
        if not np.isfinite(step.promise):
            break
        state = _advance(problem, state, step, _compute_length(problem, state, errors, step, weights))
    return state, most + 1


def _polish(problem: BodyProblem, state: NearestBodies, level: float) -> NearestBodies:
    """Return the state after whole steps, until they promise no more or rounding lets them gain no more."""
    weights = (problem.weight, level)
    scale = level * float(problem.shares.min())
    last = np.inf
    while True:
        errors = compute_errors(problem, state)
        step = _compute_step(problem, state, errors, weights)
        if not _DONE * problem.weight < step.promise < 0.25 * last:
            left = float(np.sqrt(np.fmin(step.promise, last) / scale))
            return replace(
                state,
                multipliers=errors / problem.weight,
                # -l - log(1 - l) <= l^2 / (2 (1 - l)), without the digits that the left-hand side loses.
                gap=scale * 0.5 * left**2 / (1.0 - left) + level * problem.bounded,
                gradient=step.gradient,
                stationarity=float(np.sqrt(step.promise / problem.weight)),
            )
        state, last = _advance(problem, state, step, 1.0), step.promise


def build_expected_bodies(problem: BodyProblem) -> NearestBodies:
    """Return the bodies expected."""
    return NearestBodies(
        factors=np.tile(np.eye(4), (problem.blocks.shape[1], 1, 1)),
        positive=np.ones(problem.positive.shape[1]),
        others=problem.middle,
        multipliers=np.zeros(len(problem.target)),
    )


def optimise_bodies(
    problem: BodyProblem, start: NearestBodies | None = None, known: float | None = None
) -> NearestBodies:
    """Return the optimum of a problem; its `gap` is infinite where it was not reached.

    `start` are bodies to begin with (None: those expected), the optimum of the weight `known` where given.
    """
    state = start or build_expected_bodies(problem)
    inner = np.maximum(state.others[: problem.bounded], 1.0)
    others = np.append(inner, state.others[problem.bounded :])
    state = replace(state, others=others, gap=np.inf, iterations=0)
    errors, fall = compute_errors(problem, state), _FALL
    end = _BOUND * problem.weight if problem.bounded else problem.weight
    level = max(problem.weight, float(errors @ errors) if known is None else known)
    if not np.isfinite(level):
        return state
    # As short a step along the way that whole Newton steps follow it: it always arrives.
    gentle = 1.0 - _NEAR / np.sqrt(4 * len(state.factors) + len(state.positive) + problem.bounded)
    state, spent = _centre(problem, state, level, _LIMIT)
    while spent < _LIMIT:
        if level <= end:
            return replace(_polish(problem, state, end), iterations=spent)
        below = max(end, fall * level)
        patience = _MANY if fall < gentle else _LIMIT - spent
        reached, count = _centre(problem, state, below, patience)
        spent += count
        if count > patience:
            fall = min(gentle, float(np.sqrt(fall)))
            continue
        state, level = reached, below
        if count <= _FEW:
            fall = max(_STEEPEST, fall**1.5)
    return replace(state, iterations=spent)


def solve_body_equations(problem: BodyProblem) -> NearestBodies | None:
    """Return the bodies nearest to those expected whose rows have their targets; None where there are none.

    Equations that bodies expected come to only from further away than numbers hold count as such, too. The
    weight of the problem does not count, nor what is bounded, and v is weighed as the bodies are (k = g = 1).
    """
    problem = replace(problem, weight=1.0, loose=1.0, middle=np.zeros_like(problem.middle), bounded=0)
    state = build_expected_bodies(problem)
    weights, least, reached, last = (1.0, 1.0), float(problem.shares.min()), False, np.inf
    links, free = len(state.factors), np.ones(len(state.others))
    roots = np.sqrt(problem.shares)
    roots = np.concatenate([np.repeat(roots[:links], 10), roots[links:], free])
    for count in range(_LIMIT):
        lacking = -compute_errors(problem, state)
        slopes = _compute_slopes(problem, state, free) / roots
        aim = -roots * np.append(_compute_pull(state), state.others)
        lengths = np.linalg.norm(slopes, axis=1)
        basis, triangle = np.linalg.qr((slopes / lengths[:, None]).T)
        # The shortest step that changes the rows by what they lack, and Newton's that keeps them.
        along, inner = (
            _split_step(state, moved / roots, np.zeros(0), float(moved @ moved), float(np.abs(moved).max()))
            for moved in (
                basis @ np.linalg.solve(triangle.T, lacking / lengths),
                aim - basis @ (basis.T @ aim),
            )
        )
        if not np.isfinite(inner.promise + along.promise):
            break
        if inner.promise > _NEAR**2 * least:
            length = _compute_length(problem, state, np.zeros(0), inner, weights)
            state = _advance(problem, state, inner, length)
        elif not reached:
            lowest = float(min(np.linalg.eigvalsh(along.blocks).min(), along.positive.min(initial=0.0)))
            length = min(1.0, -_TOWARDS / lowest) if lowest < 0.0 else 1.0
            if not length > _SHORTEST:
                break
            state = _advance(problem, state, along, length)
            reached = length == 1.0
        elif _DONE < inner.promise + along.promise < 0.25 * last:
            last = inner.promise + along.promise
            state = _advance(problem, _advance(problem, state, along, 1.0), inner, 1.0)
        else:
            # Steps that gain no more need not have arrived: rows that nearly contradict each other. The sizes
            # of what a row adds up bound its rounding; |Q_ab| <= sqrt(Q_aa Q_bb), which does not vanish.
            edges = np.sqrt(np.sum(state.factors**2, axis=2))
            sizes = np.einsum("mnab,na,nb->m", np.abs(problem.blocks), edges, edges)
            sizes += np.abs(problem.positive) @ state.positive + np.abs(problem.others) @ np.abs(state.others)
            if not np.all(np.abs(lacking) <= _REACHED * (sizes + np.abs(problem.target))):
                break
            left = float(np.sqrt(inner.promise / least))
            gap, gradient = least * 0.5 * left**2 / (1.0 - left), inner.gradient
            return replace(state, gap=gap, gradient=gradient, stationarity=left, iterations=count)
    return None
