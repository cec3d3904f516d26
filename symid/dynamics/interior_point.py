"""The nearest positive definite matrices under linear equations, by a primal-dual interior-point method.

`BodyProblem`: rows of linear equations over blocks (symmetric 4 x 4), positive and free numbers, all scaled
so that the point to stay near is one (the unit matrix, 1, 0) -> `BodySolution`, or None where no point
fulfils the equations.

    minimise  f = sum w (tr Q - log det Q - 4) + sum w (u - log u - 1) + sum w v^2 / 2
    subject to  tr X_i Q + a_i u + c_i v = b_i,

or, where slack_i > 0, with (what equation i lacks)^2 / (2 slack_i) added to f instead. f is convex, so the
optimum is where, with one multiplier nu_i an equation (Boyd and Vandenberghe 2004, Convex Optimization,
5.5),

    Q^-1 = 1 + S / w,  S = sum nu_i X_i,    1 / u = 1 + a nu / w,    v = -c nu / w,
    and what equation i lacks is -slack_i nu_i.

It is the point where Q Z = w 1 with Z = w 1 + S(nu) on the way that leads, with Q Z = t w 1, from a distant
start to t = 1. Steps are Newton's in the scaling of Nesterov and Todd, where Q and Z are the same diagonal
matrix D, with Mehrotra's second-order term (Todd, Toh and Tutuncu 1998, On the Nesterov-Todd direction in
semidefinite programming, SIAM J. Optimization 8(3)). Unlike Newton's method on either problem alone they
follow the curved edge of what is possible, MX^2 < XX M, in large steps, and lose no digits there.

Supported: a few hundred equations, dense; an infeasible start: the first point need fulfil nothing.
Loads NumPy only.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray

_UPPER = np.triu_indices(4)
_FACTORS = np.where(_UPPER[0] == _UPPER[1], 1.0, np.sqrt(2.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyProblem:
    """Equations and weights.

    Args:
        blocks: (m, n, 4, 4) symmetric X_i; positive: (m, p) a_i; free: (m, f) c_i.
        target: (m,) b; slack: (m,) all positive, or all zero where the equations must hold.
        weights: (n + p + f,) w of the blocks, the positive and the free numbers.
    """

    blocks: FloatArray
    positive: FloatArray
    free: FloatArray
    target: FloatArray
    slack: FloatArray
    weights: FloatArray

    def split(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the parts of an array (n + p + f,) that belong to blocks, positive and free numbers."""
        first = self.blocks.shape[1]
        second = first + self.positive.shape[1]
        return values[:first], values[first:second], values[second:]

    def gather(self, multipliers: FloatArray) -> FloatArray:
        """Return S (n, 4, 4), the blocks times their multipliers."""
        total: FloatArray = np.einsum("i,injk->njk", multipliers, self.blocks)
        return total


@dataclass(frozen=True, slots=True, kw_only=True)
class BodySolution:
    """The optimum: `blocks` Q, `positive` u, `free` v, `multipliers` nu, number of steps.

    `stationarity` is the largest relative error in the conditions of optimality.
    """

    blocks: FloatArray
    positive: FloatArray
    free: FloatArray
    multipliers: FloatArray
    stationarity: float
    iterations: int


def flatten_symmetric(matrices: FloatArray) -> FloatArray:
    """Return symmetric matrices (..., 4, 4) as vectors (..., 10) with the same scalar product."""
    flat: FloatArray = matrices[..., _UPPER[0], _UPPER[1]] * _FACTORS
    return flat


def unflatten_symmetric(vectors: FloatArray) -> FloatArray:
    """Return symmetric matrices (n, 4, 4) from vectors (n, 10); see `flatten_symmetric`."""
    matrices = np.zeros((len(vectors), 4, 4))
    matrices[:, _UPPER[0], _UPPER[1]] = vectors / _FACTORS
    return matrices + np.triu(matrices, 1).transpose(0, 2, 1)


_LIMIT = 80
# Rules of thumb, seen in no result: they only decide how many steps it takes.
_FAR = 1e3
_KEPT = 0.9
_SHORT = 0.1
# Relative errors: what is aimed at, and what is good enough where rounding allows no more.
_AIM = 1e-13
_ACCEPTED = 1e-7
_OUT_OF_REACH = 1e12


@dataclass(frozen=True, slots=True, kw_only=True)
class _InteriorPoint:
    """Q (n, 4, 4) and Z, u (p,) and its partner, nu (m,)."""

    blocks: FloatArray
    partners: FloatArray
    positive: FloatArray
    positive_partners: FloatArray
    multipliers: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scaling:
    """G with Q = G D G^T and Z = G^-T D G^-1; the same for the positive numbers; what the equations lack."""

    roots: FloatArray
    inverse: FloatArray
    values: FloatArray
    positive_roots: FloatArray
    positive_values: FloatArray
    primal: FloatArray
    dual: FloatArray
    positive_dual: FloatArray
    rows: FloatArray
    positive_rows: FloatArray
    factor: FloatArray
    error: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Direction:
    """A step, blocks and positive numbers in the scaling."""

    multipliers: FloatArray
    blocks: FloatArray
    partners: FloatArray
    positive: FloatArray
    positive_partners: FloatArray


def _choose_start(problem: BodyProblem) -> _InteriorPoint:
    w_block, w_positive, _ = problem.split(problem.weights)
    links, positives = len(w_block), len(w_positive)
    size = 10 * max(1.0, float(np.abs(problem.target).max()))
    slack = float(problem.slack.max())
    far = 10 + 1 / slack if slack else _FAR
    return _InteriorPoint(
        blocks=np.tile(size * np.eye(4), (links, 1, 1)),
        partners=far * np.eye(4) * w_block[:, None, None],
        positive=np.full(positives, size),
        positive_partners=far * w_positive,
        multipliers=np.zeros(len(problem.target)),
    )


def _compute_scaling(problem: BodyProblem, state: _InteriorPoint) -> _Scaling:
    """Return the scaling at a state, and the matrix of Newton's equations in it, factorised."""
    w_block, w_positive, w_free = problem.split(problem.weights)
    nu = state.multipliers
    lower = np.linalg.cholesky(state.blocks)
    other = np.linalg.cholesky(state.partners)
    _, values, right = np.linalg.svd(other.transpose(0, 2, 1) @ lower)
    roots = lower @ right.transpose(0, 2, 1) / np.sqrt(values)[:, None, :]
    positive_roots = np.sqrt(state.positive / state.positive_partners)
    free = -(nu @ problem.free) / w_free
    reached = np.einsum("injk,njk->i", problem.blocks, state.blocks)
    reached = reached + problem.positive @ state.positive + problem.free @ free
    rows = flatten_symmetric(roots.transpose(0, 2, 1) @ problem.blocks @ roots).reshape(len(nu), -1)
    positive_rows = problem.positive * positive_roots
    parts = [rows, positive_rows, problem.free / np.sqrt(w_free), np.diag(np.sqrt(problem.slack))]
    primal = problem.target - reached + problem.slack * nu
    dual = np.eye(4) * w_block[:, None, None] + problem.gather(nu) - state.partners
    positive_dual = w_positive + nu @ problem.positive - state.positive_partners
    positive_values = np.sqrt(state.positive * state.positive_partners)
    largest = 1 + float(np.abs(np.append(problem.target, problem.slack * nu)).max())
    errors = [
        primal / (largest + np.einsum("injk,njk->i", np.abs(problem.blocks), np.abs(state.blocks))),
        (values**2 / w_block[:, None]).ravel() - 1,
        positive_values**2 / w_positive - 1,
        (roots.transpose(0, 2, 1) @ dual @ roots / np.sqrt(w_block)[:, None, None]).ravel(),
        positive_dual * positive_roots / np.sqrt(w_positive),
    ]
    return _Scaling(
        roots=roots,
        inverse=np.sqrt(values)[:, :, None] * right @ np.linalg.inv(lower),
        values=values,
        positive_roots=positive_roots,
        positive_values=positive_values,
        primal=primal,
        dual=dual,
        positive_dual=positive_dual,
        rows=rows,
        positive_rows=positive_rows,
        factor=np.linalg.qr(np.hstack(parts).T)[1],
        error=float(np.abs(np.concatenate(errors)).max()),
    )


def _compute_direction(
    problem: BodyProblem, scaling: _Scaling, level: float, second: FloatArray, positive_second: FloatArray
) -> _Direction:
    """Return the step to Q Z = level w: dQ + dZ = K with (D K + K D) / 2 = level w - D^2 - second."""
    w_block, w_positive, _ = problem.split(problem.weights)
    values, across = scaling.values, scaling.roots.transpose(0, 2, 1)
    mean = 0.5 * (values[:, :, None] + values[:, None, :])
    wanted = (level * w_block[:, None] - values**2)[:, :, None] * np.eye(4)
    sums = (wanted - second) / mean
    positive_sums = (
        level * w_positive - scaling.positive_values**2 - positive_second
    ) / scaling.positive_values
    dual = across @ scaling.dual @ scaling.roots
    positive_dual = scaling.positive_dual * scaling.positive_roots
    right = scaling.rows @ flatten_symmetric(sums - dual).ravel()
    right = right + scaling.positive_rows @ (positive_sums - positive_dual) - scaling.primal
    multipliers = np.linalg.solve(scaling.factor, np.linalg.solve(scaling.factor.T, right))
    partners = unflatten_symmetric((multipliers @ scaling.rows).reshape(-1, 10)) + dual
    positive_partners = multipliers @ scaling.positive_rows + positive_dual
    return _Direction(
        multipliers=multipliers,
        blocks=sums - partners,
        partners=partners,
        positive=positive_sums - positive_partners,
        positive_partners=positive_partners,
    )


def _compute_length(scaling: _Scaling, blocks: FloatArray, positive: FloatArray) -> float:
    """Return how far D + t dD stays positive, at most 1."""
    root = 1 / np.sqrt(scaling.values)
    lowest = float(np.linalg.eigvalsh(root[:, :, None] * blocks * root[:, None, :]).min())
    lowest = min(lowest, float((positive / scaling.positive_values).min(initial=0.0)))
    return min(1.0, -_KEPT / lowest) if lowest < 0 else 1.0


def _compute_lengths(scaling: _Scaling, step: _Direction) -> tuple[float, float]:
    return (
        _compute_length(scaling, step.blocks, step.positive),
        _compute_length(scaling, step.partners, step.positive_partners),
    )


def _compute_level(
    problem: BodyProblem, scaling: _Scaling, step: _Direction, lengths: tuple[float, float]
) -> float:
    """Return t of the mean of Q Z / w after the lengths given of a step."""
    w_block, w_positive, _ = problem.split(problem.weights)
    diagonal = scaling.values[:, :, None] * np.eye(4)
    left, right = diagonal + lengths[0] * step.blocks, diagonal + lengths[1] * step.partners
    first = scaling.positive_values + lengths[0] * step.positive
    second = scaling.positive_values + lengths[1] * step.positive_partners
    total = float(np.einsum("nij,nji->", left, right) + first @ second)
    return total / float(4 * w_block.sum() + w_positive.sum())


def _choose_direction(problem: BodyProblem, scaling: _Scaling) -> _Direction:
    """Return Mehrotra's step: look ahead to t = 1, then aim at a t that can be reached."""
    nothing, positive_nothing = np.zeros_like(scaling.dual), np.zeros_like(scaling.positive_values)
    ahead = _compute_direction(problem, scaling, 1.0, nothing, positive_nothing)
    lengths = _compute_lengths(scaling, ahead)
    level = _compute_level(problem, scaling, ahead, (0.0, 0.0))
    if min(lengths) < _SHORT:
        return _compute_direction(problem, scaling, max(1.0, level), nothing, positive_nothing)
    reached = max(0.0, _compute_level(problem, scaling, ahead, lengths))
    product = ahead.blocks @ ahead.partners
    second = 0.5 * (product + product.transpose(0, 2, 1))
    target = max(1.0, level * (reached / level) ** 3)
    return _compute_direction(problem, scaling, target, second, ahead.positive * ahead.positive_partners)


def _advance(
    state: _InteriorPoint, scaling: _Scaling, step: _Direction, lengths: tuple[float, float]
) -> _InteriorPoint:
    roots, inverse = scaling.roots, scaling.inverse
    primal, dual = lengths
    blocks = state.blocks + primal * roots @ step.blocks @ roots.transpose(0, 2, 1)
    partners = state.partners + dual * inverse.transpose(0, 2, 1) @ step.partners @ inverse
    return replace(
        state,
        blocks=0.5 * (blocks + blocks.transpose(0, 2, 1)),
        partners=0.5 * (partners + partners.transpose(0, 2, 1)),
        positive=state.positive + primal * step.positive * scaling.positive_roots,
        positive_partners=state.positive_partners + dual * step.positive_partners / scaling.positive_roots,
        multipliers=state.multipliers + dual * step.multipliers,
    )


def _finish(problem: BodyProblem, state: _InteriorPoint, scaling: _Scaling, iterations: int) -> BodySolution:
    """Return the state; equations without slack are freed from rounding by the smallest change."""
    w_block, _, w_free = problem.split(problem.weights)
    free = -(state.multipliers @ problem.free) / w_free
    blocks, positive = state.blocks, state.positive
    if not np.any(problem.slack):
        rows = np.hstack([scaling.rows, scaling.positive_rows, problem.free])
        change: FloatArray = np.asarray(
            np.linalg.lstsq(rows, scaling.primal, rcond=None)[0], dtype=np.float64
        )
        count = 10 * len(w_block)
        inner = unflatten_symmetric(change[:count].reshape(-1, 10))
        blocks = blocks + scaling.roots @ inner @ scaling.roots.transpose(0, 2, 1)
        positive = positive + change[count : count + len(positive)] * scaling.positive_roots
        free = free + change[count + len(positive) :]
    return BodySolution(
        blocks=blocks,
        positive=positive,
        free=free,
        multipliers=state.multipliers,
        stationarity=scaling.error,
        iterations=iterations,
    )


def _is_lost(state: _InteriorPoint) -> bool:
    parts = (state.blocks, state.partners, state.positive, state.positive_partners, state.multipliers)
    return not all(float(np.abs(part).max(initial=0.0)) < _OUT_OF_REACH for part in parts)


def solve_body_problem(problem: BodyProblem) -> BodySolution | None:
    """Return the solution of `problem`; None where there is none, or none within reach."""
    state = _choose_start(problem)
    best: tuple[_InteriorPoint, _Scaling] | None = None
    for iteration in range(_LIMIT):
        try:
            scaling = _compute_scaling(problem, state)
            improved = best is None or scaling.error < 0.5 * best[1].error
            if best is not None and best[1].error < _ACCEPTED and (not improved or best[1].error < _AIM):
                return _finish(problem, *best, iteration)
            if best is None or scaling.error < best[1].error:
                best = (state, scaling)
            step = _choose_direction(problem, scaling)
            lengths = _compute_lengths(scaling, step)
        except np.linalg.LinAlgError:
            break
        state = _advance(state, scaling, step, lengths)
        if _is_lost(state):
            break
    return _finish(problem, *best, _LIMIT) if best and best[1].error < _ACCEPTED else None
