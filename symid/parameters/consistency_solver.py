"""A primal-dual interior-point method for the problem of `consistency_problem`.

Input: `Problem`. Output: `Solution`, or None where no point fulfils the equations.

The optimum is the point where Q Z = w 1 with Z = w 1 + S(nu) on the way that leads, with Q Z = t w 1, from
a distant start to t = 1. Steps are Newton's in the scaling of Nesterov and Todd, where Q and Z are the same
diagonal matrix D, with Mehrotra's second-order term (Todd, Toh and Tutuncu 1998, On the Nesterov-Todd
direction in semidefinite programming, SIAM J. Optimization 8(3)). Unlike Newton's method on either problem
alone they follow the curved edge of what is possible, MX^2 < XX M, in large steps, and lose no digits there.

Supported: infeasible start: the first point need fulfil nothing.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.parameters.consistency_problem import Problem, Solution, flatten, unflatten

__all__ = ["find_nearest"]

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
class _State:
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


def _start(problem: Problem) -> _State:
    w_block, w_positive, _ = problem.split(problem.weights)
    links, positives = len(w_block), len(w_positive)
    size = 10 * max(1.0, float(np.abs(problem.target).max()))
    slack = float(problem.slack.max())
    far = 10 + 1 / slack if slack else _FAR
    return _State(
        blocks=np.tile(size * np.eye(4), (links, 1, 1)),
        partners=far * np.eye(4) * w_block[:, None, None],
        positive=np.full(positives, size),
        positive_partners=far * w_positive,
        multipliers=np.zeros(len(problem.target)),
    )


def _scale(problem: Problem, state: _State) -> _Scaling:
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
    rows = flatten(roots.transpose(0, 2, 1) @ problem.blocks @ roots).reshape(len(nu), -1)
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


def _find_direction(
    problem: Problem, scaling: _Scaling, level: float, second: FloatArray, positive_second: FloatArray
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
    right = scaling.rows @ flatten(sums - dual).ravel()
    right = right + scaling.positive_rows @ (positive_sums - positive_dual) - scaling.primal
    multipliers = np.linalg.solve(scaling.factor, np.linalg.solve(scaling.factor.T, right))
    partners = unflatten((multipliers @ scaling.rows).reshape(-1, 10)) + dual
    positive_partners = multipliers @ scaling.positive_rows + positive_dual
    return _Direction(
        multipliers=multipliers,
        blocks=sums - partners,
        partners=partners,
        positive=positive_sums - positive_partners,
        positive_partners=positive_partners,
    )


def _find_length(scaling: _Scaling, blocks: FloatArray, positive: FloatArray) -> float:
    """Return how far D + t dD stays positive, at most 1."""
    root = 1 / np.sqrt(scaling.values)
    lowest = float(np.linalg.eigvalsh(root[:, :, None] * blocks * root[:, None, :]).min())
    lowest = min(lowest, float((positive / scaling.positive_values).min(initial=0.0)))
    return min(1.0, -_KEPT / lowest) if lowest < 0 else 1.0


def _find_lengths(scaling: _Scaling, step: _Direction) -> tuple[float, float]:
    return (
        _find_length(scaling, step.blocks, step.positive),
        _find_length(scaling, step.partners, step.positive_partners),
    )


def _find_level(problem: Problem, scaling: _Scaling, step: _Direction, lengths: tuple[float, float]) -> float:
    """Return t of the mean of Q Z / w after the lengths given of a step."""
    w_block, w_positive, _ = problem.split(problem.weights)
    diagonal = scaling.values[:, :, None] * np.eye(4)
    left, right = diagonal + lengths[0] * step.blocks, diagonal + lengths[1] * step.partners
    first = scaling.positive_values + lengths[0] * step.positive
    second = scaling.positive_values + lengths[1] * step.positive_partners
    total = float(np.einsum("nij,nji->", left, right) + first @ second)
    return total / float(4 * w_block.sum() + w_positive.sum())


def _choose_direction(problem: Problem, scaling: _Scaling) -> _Direction:
    """Return Mehrotra's step: look ahead to t = 1, then aim at a t that can be reached."""
    nothing, positive_nothing = np.zeros_like(scaling.dual), np.zeros_like(scaling.positive_values)
    ahead = _find_direction(problem, scaling, 1.0, nothing, positive_nothing)
    lengths = _find_lengths(scaling, ahead)
    level = _find_level(problem, scaling, ahead, (0.0, 0.0))
    if min(lengths) < _SHORT:
        return _find_direction(problem, scaling, max(1.0, level), nothing, positive_nothing)
    reached = max(0.0, _find_level(problem, scaling, ahead, lengths))
    product = ahead.blocks @ ahead.partners
    second = 0.5 * (product + product.transpose(0, 2, 1))
    target = max(1.0, level * (reached / level) ** 3)
    return _find_direction(problem, scaling, target, second, ahead.positive * ahead.positive_partners)


def _advance(state: _State, scaling: _Scaling, step: _Direction, lengths: tuple[float, float]) -> _State:
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


def _finish(problem: Problem, state: _State, scaling: _Scaling, iterations: int) -> Solution:
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
        inner = unflatten(change[:count].reshape(-1, 10))
        blocks = blocks + scaling.roots @ inner @ scaling.roots.transpose(0, 2, 1)
        positive = positive + change[count : count + len(positive)] * scaling.positive_roots
        free = free + change[count + len(positive) :]
    return Solution(
        blocks=blocks,
        positive=positive,
        free=free,
        multipliers=state.multipliers,
        stationarity=scaling.error,
        iterations=iterations,
    )


def _is_lost(state: _State) -> bool:
    parts = (state.blocks, state.partners, state.positive, state.positive_partners, state.multipliers)
    return not all(float(np.abs(part).max(initial=0.0)) < _OUT_OF_REACH for part in parts)


def find_nearest(problem: Problem) -> Solution | None:
    """Return the solution of `problem`; None where there is none, or none within reach."""
    state = _start(problem)
    best: tuple[_State, _Scaling] | None = None
    for iteration in range(_LIMIT):
        try:
            scaling = _scale(problem, state)
            improved = best is None or scaling.error < 0.5 * best[1].error
            if best is not None and best[1].error < _ACCEPTED and (not improved or best[1].error < _AIM):
                return _finish(problem, *best, iteration)
            if best is None or scaling.error < best[1].error:
                best = (state, scaling)
            step = _choose_direction(problem, scaling)
            lengths = _find_lengths(scaling, step)
        except np.linalg.LinAlgError:
            break
        state = _advance(state, scaling, step, lengths)
        if _is_lost(state):
            break
    return _finish(problem, *best, _LIMIT) if best and best[1].error < _ACCEPTED else None
