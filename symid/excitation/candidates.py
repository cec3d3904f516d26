"""Random series that keep all limits, as large as these allow: starts of a search, and what it must beat.

Input: a problem, a random generator. Output: `Candidates`, the best first.

Centres are drawn from the middle half of the positions; sines and cosines of harmonic k from normal
distributions whose deviation falls with 1/k. The motion of each joint is then scaled about its centre until a
limit is reached, and that of all joints together until torque, torsion and space are within theirs as well.

Supported: problems whose centres are feasible somewhere.
Not supported: narrow spaces, which a random pose hardly ever meets; give a start there.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, SolverError
from symid.excitation.limits import find_scales
from symid.excitation.problem import ExcitationProblem

__all__ = ["Candidates", "find_candidates"]

_TRIES = 20
"""Draws per candidate before the search is given up."""
_HALVINGS = 8
"""Of the interval in which the largest common scale lies."""
_SMALLEST = 0.05
"""A common scale below this leaves no motion to speak of."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """Unknowns (N, n r) and condition numbers (N,), sorted by the latter; `drawn`: how many were tried."""

    unknowns: FloatArray
    conditions: FloatArray
    drawn: int

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("unknowns", "conditions"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def find_candidates(problem: ExcitationProblem, count: int, rng: np.random.Generator) -> Candidates:
    """Return `count` random feasible series.

    Raises:
        SolverError: nearly no random pose keeps the limits of torque, torsion and space.
    """
    found: list[FloatArray] = []
    conditions: list[float] = []
    drawn = 0
    worst = np.zeros(len(problem.state_limits.names))
    while len(found) < count:
        if drawn >= _TRIES * max(count, 50):
            raise SolverError(_describe_narrow(problem, worst, drawn))
        drawn += 1
        unknowns, excess = _draw(problem, rng)
        if unknowns is None:
            worst += excess > 0.0
            continue
        found.append(unknowns)
        conditions.append(problem.find_condition(unknowns))
    order = np.argsort(conditions, kind="stable")
    return Candidates(unknowns=np.array(found)[order], conditions=np.array(conditions)[order], drawn=drawn)


def _draw(problem: ExcitationProblem, rng: np.random.Generator) -> tuple[FloatArray | None, FloatArray]:
    """Return a feasible series, None if the draw has none, and the excesses at its centre."""
    space, limits = problem.space, problem.limits
    scales = find_scales(limits, space.harmonics, space.period)
    middle = space.offset.copy()
    middle[:, 0] += 0.5 * limits.share * limits.half * rng.uniform(-1.0, 1.0, size=space.size)
    falling = np.tile(1.0 / np.arange(1, space.harmonics + 1), 2)
    wave = np.zeros_like(middle)
    wave[:, 1:] = rng.normal(size=(space.size, 2 * space.harmonics)) * falling * scales[:, 1:]
    rest = space.find_unknowns(middle).ravel()
    motion = space.find_unknowns(space.offset + wave).ravel()
    excess = problem.find_state_excess(rest)
    if np.any(excess > 0.0) or not _is_within(problem, rest):
        return None, excess
    motion *= np.repeat(_find_largest(problem, rest, motion), space.shape[1])
    share = _find_common(problem, rest, motion)
    return (rest + share * motion if share > _SMALLEST else None), excess


def _is_within(problem: ExcitationProblem, unknowns: FloatArray) -> bool:
    return bool(np.all(np.abs(problem.rows @ unknowns + problem.constants) <= 1.0))


def _find_largest(problem: ExcitationProblem, rest: FloatArray, motion: FloatArray) -> FloatArray:
    """Return for each joint (n,) the largest factor of its motion that keeps the linear limits."""
    here, ahead = problem.rows @ rest + problem.constants, problem.rows @ motion
    tiny = np.finfo(np.float64).tiny
    room = np.where(
        ahead > 0.0, (1.0 - here) / np.maximum(ahead, tiny), (1.0 + here) / np.maximum(-ahead, tiny)
    )
    owner = np.argmax(problem.rows.reshape(len(room), problem.space.size, -1).any(axis=2), axis=1)
    factors = np.full(problem.space.size, np.inf)
    np.minimum.at(factors, owner, room)
    # A joint without any motion has no limit to reach.
    return np.where(factors < 1e6, 0.9999 * factors, 0.0)


def _find_common(problem: ExcitationProblem, rest: FloatArray, motion: FloatArray) -> float:
    """Return the largest factor found by bisection for which torque, torsion and space are within limits."""

    def is_within(factor: float) -> bool:
        return not np.any(problem.find_state_excess(rest + factor * motion) > 0.0)

    if is_within(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_within(middle) else (low, middle)
    return low


def _describe_narrow(problem: ExcitationProblem, worst: FloatArray, drawn: int) -> Notice:
    names = problem.state_limits
    place = int(np.argmax(worst)) if len(worst) else 0
    what = f"; most often broken: {names.kinds[place]} of {names.names[place]}" if len(worst) else ""
    text = (
        f"of {drawn} random poses nearly none keeps all limits{what}; widen them, or give a start pose that "
        "keeps them"
    )
    return Notice(code="excitation.narrow", text=text)
