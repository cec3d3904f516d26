"""The least-squares problem of one joint and one friction law, and searches for its parameters.

FrictionSamples, FrictionLaw, FrictionOptions -> FrictionProblem -> FrictionSearch

    J(linear, shape) = min_extra |R (tau - X extra - Phi(v; shape) linear)|^2
                     = |y - Q_x Phi_R(shape) linear|^2

y and Q_x Phi_R are the torque and the columns of the law behind R, less their projection on the columns X
beside friction, which are eliminated once for both estimators. X may be dependent (least norm).

Variable projection: the shape is searched, the rest follows by linear least squares.

    J(s) = |P(s) y|^2,   P = 1 - Phi Phi^+        (the linear parameters are Phi^+ y)
    dr/ds ~ -P dPhi/ds c                          (Kaufman's Jacobian; its gradient of J is exact)
    d = argmin |r + F d|^2 + lambda |D d|^2,   D the lengths of the columns of Kaufman's Jacobian F

Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432; Kaufman, BIT 15 (1975) 49-57; Levenberg (1944);
Marquardt (1963). Damped Gauss-Newton steps in the logarithms start from a grid of shapes. A linear zone gives
J a kink wherever its edge passes a sample: the edge is set onto the kinks next to it, and beyond them. Where
friction changes its sign at a velocity that is searched, J jumps: the intervals between jumps are tried.

Between bounds, by Ipopt from the best shapes of a grid, with exact derivatives by CasADi:

    min_x J(x), lower <= x <= upper, over the physical parameters x, so that fS >= 0, fC >= 0 hold
    f(x) = |y - Q R t(x)|^2 / scale, t(x) = sum_k c_k(x) Phi_k(v; s(x)), (c, s) = mixing^-1 x

Optima in a kink are not found to full precision.
Supported: up to three free shape values in variable projection, dependent columns.
Not supported: bounds on the factors of X; weights of single samples.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.identification.friction.joint_fit import FrictionSamples, FrictionSearch
from symid.identification.judge import numerics
from symid.identification.regression import solve_scaled
from symid.ipopt import Ending, IpoptOptions, SmoothProblem, keep_last, minimise
from symid.joint_models import FrictionLaw, build_casadi_carrier, compute_column_derivatives


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionOptions:
    """Options of the estimators of friction.

    Args:
        bounds: (name, (least, greatest)) of shape values; equal where a value is fixed. Default: the law's
            own bounds, for velocities those that the samples can identify.
        starts: that are followed, of variable projection and of the constrained problem.
        solves: linear problems of variable projection at most, a third of them on a grid of shapes spaced by
            equal factors.
        tolerance: relative, of the shape, of Ipopt on the scaled problem.
        iterations: of Ipopt from a start, at most.
    """

    bounds: tuple[tuple[str, tuple[float, float]], ...] = ()
    starts: int = 3
    solves: int = 150
    tolerance: float = numerics.RANK
    iterations: int = 400

    def __post_init__(self) -> None:
        """Check all options; raises UsageError with all mistakes."""
        wrong = [(name, *pair) for name, pair in self.bounds if not -math.inf < pair[0] <= pair[1] < math.inf]
        told = "must be finite, the least first"
        mistakes = [f"bounds of {name} ({low:g}, {high:g}): {told}" for name, low, high in wrong]
        for name in ("starts", "solves", "tolerance", "iterations"):
            value, part = getattr(self, name), name == "tolerance"
            if not 0 < value < (1 if part else math.inf):
                mistakes.append(f"{name} {value:g}: must be {'between 0 and 1' if part else 'positive'}")
        UsageError.refuse(mistakes, code="usage.friction-option")


SPEED_UNITS = frozenset({"rad/s", "m/s"})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionProblem(FrozenArrays):
    """The problem of one joint: y (M,), N m or N.

    `low` and `high` (s,) are bounds of the shape values, equal where one is fixed.
    """

    samples: FrictionSamples
    law: FrictionLaw
    target: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def is_free(self) -> NDArray[np.bool_]:
        """Return which shape values are searched: (s,)."""
        return np.asarray(self.high > self.low)

    @property
    def is_logarithmic(self) -> NDArray[np.bool_]:
        """Return which shape values are searched by their logarithm: (s,)."""
        return np.asarray(self.low > 0.0)

    def encode(self, shape: Sequence[float] | FloatArray) -> FloatArray:
        """Return coordinates z of shape values (..., s): logarithms where they are positive."""
        values = np.array(shape, dtype=np.float64)
        values[..., self.is_logarithmic] = np.log(values[..., self.is_logarithmic])
        return values

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds (s,) of the coordinates."""
        return self.encode(self.low), self.encode(self.high)

    def decode(self, z: FloatArray) -> FloatArray:
        """Return shape values of coordinates z (..., s), between the bounds."""
        values = np.array(z, dtype=np.float64)
        values[..., self.is_logarithmic] = np.exp(values[..., self.is_logarithmic])
        return np.clip(values, self.low, self.high)

    def compute_columns(self, shape: Sequence[float] | FloatArray) -> FloatArray:
        """Return Q_x Phi_R: (M, p)."""
        return self.eliminate(self.samples.pass_law(self.law, shape))

    def compute_rates(self, shape: Sequence[float] | FloatArray, linear: FloatArray) -> FloatArray:
        """Return the derivatives of Q_x Phi_R linear by the coordinates z: (M, s)."""
        rates = compute_column_derivatives(self.law, self.samples.inputs, [float(value) for value in shape])
        rates = self.eliminate(self.samples.pass_columns(np.einsum("nps,p->ns", rates, linear)))
        return rates * np.where(self.is_logarithmic, shape, 1.0)

    def eliminate(self, columns: FloatArray) -> FloatArray:
        """Return columns behind R (M, c), or one of them (M,), less their parts in those beside friction."""
        basis = self.samples.beside.basis
        return columns - basis @ (basis.T @ columns)


def build_problem(samples: FrictionSamples, law: FrictionLaw, options: FrictionOptions) -> FrictionProblem:
    """Return the problem; `bounds` of the options are read.

    Raises:
        UsageError: the law reads an input that the samples lack, or a bound is not of a shape value.
        IdentifiabilityError: the joint does not move, or there are fewer rows than unknowns.
    """
    missing = [name for name in law.inputs if name not in samples.inputs]
    if missing:
        text = f"law {law.name!r} reads {' and '.join(missing)}, which the samples of {samples.joint!r} lack"
        raise UsageError(Notice(code="friction.input", text=text))
    if not np.any(samples.velocity):
        text = f"joint {samples.joint!r} does not move: its friction is not identifiable"
        raise IdentifiabilityError(Notice(code="friction.rest", text=text))
    target, basis = samples.rows.torque, samples.beside.basis
    unknowns = len(law.linear) + len(law.shape) + samples.extra.shape[1]
    if len(target) <= unknowns:
        text = f"joint {samples.joint!r}: {len(target)} samples are too few for {unknowns} unknowns"
        raise IdentifiabilityError(Notice(code="friction.few-rows", text=text))
    # Bounds of the shape values: those given, else the law's within the speeds sampled.
    given = dict(options.bounds)
    unknown = sorted(set(given) - {entry.name for entry in law.shape})
    if unknown:
        names = ", ".join(entry.name for entry in law.shape) or "none"
        text = f"bounds of {', '.join(unknown)}: unknown; the shape values of law {law.name!r} are {names}"
        raise UsageError(Notice(code="friction.bounds", text=text))
    speeds = np.sort(np.abs(samples.velocity))
    # The fifth slowest sample, or a part of the top speed.
    fastest = float(speeds[-1])
    slow, pairs = min(max(float(speeds[:5][-1]), 1e-4 * fastest), 1e-2 * fastest), []
    for entry in law.shape:
        low, high = entry.lower, entry.upper
        if entry.unit in SPEED_UNITS:
            low, high = max(low, slow) if low >= 0.0 else max(low, -fastest), min(high, 3.0 * fastest)
        elif entry.unit in {"s/rad", "s/m"}:
            low, high = max(low, 0.1 / fastest), min(high, 3.0 / slow)
        else:
            high = min(high, 1e3 * max(1.0, abs(low)))
        pairs.append(given.get(entry.name, (low, high)))
    ends = dict(zip(("low", "high"), np.array(pairs, dtype=np.float64).reshape(-1, 2).T, strict=True))
    target = target - basis @ (basis.T @ target)
    return FrictionProblem(samples=samples, law=law, target=target, **ends)


class Projection(NamedTuple):
    """The linear problem at one shape: J, residual (M,), linear (p,), basis of the columns (M, r)."""

    z: FloatArray
    shape: FloatArray
    objective: float
    residual: FloatArray
    linear: FloatArray
    basis: FloatArray


class Projector:
    """Solves linear problems and counts them."""

    def __init__(self, problem: FrictionProblem, limit: int) -> None:
        """Keep the problem; at most `limit` linear problems are solved."""
        self.problem, self.limit, self.solves, self.evaluations = problem, limit, 0, 0
        self.reserve, self.history = 0, list[float]()

    @property
    def exhausted(self) -> bool:
        """Return whether fewer solves are left, without the reserve, than a step with its trial takes."""
        return self.solves + 2 + self.reserve > self.limit

    def project(self, z: FloatArray) -> Projection:
        """Return the least-squares solution at coordinates z (s,), of least norm in scaled columns."""
        self.solves += 1
        self.evaluations += 1
        shape = self.problem.decode(z)
        columns = self.problem.compute_columns(shape)
        lengths = np.linalg.norm(columns, axis=0)
        # The parameter of a column that has all but vanished would be infinite.
        gone = lengths <= 1e-9 * max(float(np.max(lengths)), numerics.TINY)
        columns = np.where(gone, 0.0, columns)
        lengths[gone] = 1.0
        orthonormal, upper = np.linalg.qr(columns / lengths)
        left, singular, right = np.linalg.svd(upper)
        rank = int(np.sum(singular > 1e-11 * max(float(singular[0]), numerics.TINY)))
        basis = orthonormal @ left[:, :rank]
        parts = basis.T @ self.problem.target
        residual = self.problem.target - basis @ parts
        linear = (right[:rank].T @ (parts / singular[:rank])) / lengths
        objective, z = float(residual @ residual), self.problem.encode(shape)
        return Projection(z, shape, objective, residual, linear, basis)

    def compute_jacobian(self, state: Projection) -> FloatArray:
        """Return Kaufman's Jacobian by the coordinates z: (M, s)."""
        rates = self.problem.compute_rates(state.shape, state.linear)
        return np.asarray(state.basis @ (state.basis.T @ rates) - rates)

    def record(self, *states: Projection) -> None:
        """Append the least objective so far to the history."""
        self.history.append(min(*self.history[-1:], *(state.objective for state in states), np.inf))

    def build_search(
        self, state: Projection, outcome: Ending, ended: str, **settings: float
    ) -> FrictionSearch:
        """Return the end of a search at `state`."""
        values = tuple(state.linear.tolist()), tuple(state.shape.tolist()), state.objective
        counts = self.evaluations, self.solves, len(self.history) - 1
        return FrictionSearch(*values, *counts, tuple(self.history), outcome, ended, tuple(settings.items()))

    def compute_side_gain(self, state: Projection, place: int, side: float) -> float:
        """Return how much less J is at the least of its parabola on one side (+-1.0) of a shape value."""
        z, (low, high) = np.array(state.z), self.problem.box
        z[place] += side * 1e-10
        if not low[place] <= z[place] <= high[place]:
            return 0.0
        rate = self.problem.compute_rates(self.problem.decode(z), state.linear)[:, place]
        rate = rate - state.basis @ (state.basis.T @ rate)
        fall, curved = 2.0 * side * float(rate @ state.residual), float(rate @ rate)
        return fall**2 / (4.0 * curved) if fall > 0.0 and curved > 0.0 else 0.0


IntArray = NDArray[np.int64]
_MOST_WANTED = 10.0
_POOR = 0.25
"""Part of the promised gain above which a step in several directions counts as short enough."""


def descend(
    projector: Projector,
    state: Projection,
    free: IntArray,
    *,
    tolerance: float,
    steps: int,
    patience: int = numerics.ROUNDS,
    box: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[Projection, bool]:
    """Return the end of damped Gauss-Newton steps in the coordinates `free`, and whether it converged.

    `patience` is how many steps in a row may fail, `box` where z may go, if not all of the search's.
    """
    problem = projector.problem
    low, high = box or problem.box
    damping, failed = 1e-3, 0
    jacobian, fresh = projector.compute_jacobian(state), False
    for _ in range(steps):
        if projector.exhausted or failed >= patience:
            return state, False
        if fresh:
            jacobian = projector.compute_jacobian(state)
        fresh = False
        slope = jacobian.T @ state.residual
        held = ((state.z <= low) & (slope > 0.0)) | ((state.z >= high) & (slope < 0.0))
        moving = free[~held[free]]
        step = np.zeros(len(low))
        if len(moving):
            step[moving] = solve_scaled(jacobian[:, moving], -state.residual, rcond=1e-13, damping=damping)
            projector.solves += 1
        step *= min(1.0, 1.5 / max(float(np.max(np.abs(step))), numerics.TINY))
        trial_z = np.clip(state.z + step, low, high)
        step = trial_z - state.z
        bend = jacobian @ step
        promised = -float((2.0 * state.residual + bend) @ bend)
        # A smaller relative decrease of J is rounding.
        negligible = damping <= _MOST_WANTED and promised <= 1e-15 * state.objective
        if negligible or float(np.max(np.abs(step), initial=0.0)) <= tolerance:
            return state, True
        trial = projector.project(trial_z)
        # The damping that makes the model of J as curved as J was along the step:
        # J(d) = J + 2 r'F d + (1 + c) |F d|^2 is solved for c; the damping is c |F d|^2 / |D d|^2, with one
        # shape value the step of the secant. Without it, steps that are all too long converge slowly.
        step = trial.z - state.z
        bend = jacobian @ step
        curved, wanted = float(bend @ bend), 0.0
        length = float(np.sum((np.linalg.norm(jacobian, axis=0) * step) ** 2))
        if curved > 1e-11 * state.objective and length != 0.0:
            tilt, gain = 2.0 * float(state.residual @ bend), trial.objective - state.objective
            if np.count_nonzero(step) <= 1 or not gain < _POOR * (tilt + curved):
                wanted = max(gain - tilt - curved, 0.0) / length
        if trial.objective < state.objective:
            damping = max(0.1 * damping, min(wanted, _MOST_WANTED), 1e-12)
            state, fresh, failed = trial, True, 0
            projector.record(state)
        else:
            damping = max(damping * (10.0 if damping > 1e-6 else 1e3), min(wanted, 100.0))
            failed += 1
    return state, False


KINKED = frozenset({"dq0"})
"""Shape values with a kink in J at every speed sampled: the edge of the linear zone."""
JUMPING = frozenset({"dqs"})
"""Shape values at which J jumps whenever they pass a velocity sampled: where friction changes its sign."""
_PATIENCE = 3
"""Steps in a row that may fail near a kink."""
_CANDIDATES = 8
_LINEAR = "the law is linear in what is free"


def search_by_projection(problem: FrictionProblem, options: FrictionOptions) -> FrictionSearch:
    """Return the optimum of a problem with at most three free shape values."""
    projector = Projector(problem, options.solves)
    free = np.flatnonzero(problem.is_free)
    if not len(free):
        best = projector.project(problem.box[0])
        projector.record(best)
        return projector.build_search(best, Ending.CONVERGED, _LINEAR)
    best = _scan_shapes(projector, options, free)
    names, tolerance = {problem.law.shape[place].name for place in free}, options.tolerance
    if not names & (KINKED | JUMPING):
        best, done = descend(projector, best, free, tolerance=tolerance, steps=60)
    else:
        patience = _PATIENCE if names & KINKED else 2 * _PATIENCE
        best, _ = descend(projector, best, free, tolerance=tolerance, steps=10, patience=patience)
        search = _visit_kinks if names & KINKED else _cross_jumps
        best, done = search(projector, best, free, tolerance)
    outcome, ended = Ending.STALLED, "no step made the objective less"
    if done:
        small = "the next step in the shape, or what it promises, fell below the tolerance"
        outcome, ended = Ending.CONVERGED, small if len(projector.history) > 1 else _LINEAR
    elif projector.exhausted:
        outcome, ended = Ending.LIMIT, f"{projector.limit} linear problems were solved"
    return projector.build_search(best, outcome, ended)


def _scan_shapes(projector: Projector, options: FrictionOptions, free: IntArray) -> Projection:
    """Return the least of the ends of short descents from the best points of the grid."""
    problem = projector.problem
    points, spacing = build_shape_grid(problem, options.solves // 3)
    states, (low, high) = [projector.project(z) for z in points], problem.box
    projector.record(*states)
    if any(problem.law.shape[place].name in JUMPING for place in free):
        # The intervals between jumps, ever closer around the best one.
        best = min(states, key=lambda state: state.objective)
        place = next(k for k in free if problem.law.shape[k].name in JUMPING)
        others = free[free != place]
        speeds = np.exp(_list_jumps(problem, int(place)))
        middles = np.log(0.5 * (speeds[1:] + speeds[:-1]))
        reach = float(spacing[place])
        for _ in range(5):
            near = np.flatnonzero(np.abs(middles - best.z[place]) <= reach)
            if not len(near) or projector.solves + 2 * _CANDIDATES > projector.limit:
                break
            chosen = np.unique(np.linspace(0, len(near) - 1, _CANDIDATES).astype(int))
            for middle in middles[near[chosen]]:
                z = np.array(best.z)
                z[place] = np.clip(middle, low[place], high[place])
                best = min(best, projector.project(z), key=lambda state: state.objective)
            best, _ = descend(projector, best, others, tolerance=1e-3, steps=3)
            reach *= 0.4
        states = [best]
    starts: list[Projection] = []
    for state in sorted(states, key=lambda state: state.objective):
        # None next to another one chosen.
        apart = [float(np.max(np.abs((state.z - other.z) / spacing))) for other in starts]
        if len(starts) < options.starts and all(distance > 1.5 for distance in apart):
            starts.append(state)
    ends = [descend(projector, start, free, tolerance=1e-2, steps=6) for start in starts]
    return min((end for end, _ in ends), key=lambda state: state.objective)


def build_shape_grid(problem: FrictionProblem, count: int) -> tuple[list[FloatArray], FloatArray]:
    """Return coordinates (s,) of about `count` shapes on a grid, in order, and its distances (s,)."""
    low, high = problem.box
    free = np.flatnonzero(problem.is_free)
    # Equal numbers would put shapes on the diagonal, where two speeds are one.
    counts = round(count ** (1 / max(len(free), 1))) + np.linspace(1.0, -1.0, len(free)).astype(int)
    counts = np.maximum(counts, 2)
    spacing, axes = np.ones(len(low)), [[float(value)] for value in low]
    spacing[free] = (high - low)[free] / counts
    for place, number in zip(free, counts.tolist(), strict=True):
        # Half a step from the bounds: there a column may vanish.
        axes[place] = (low[place] + spacing[place] * (np.arange(number) + 0.5)).tolist()
    names = [entry.name for entry in problem.law.shape]
    points = [np.array(point) for point in itertools.product(*axes)]
    if {"g2", "g3"} <= set(names):
        # These may be exchanged; bounds around an earlier fit may hold the other order alone.
        points = [point for point in points if point[names.index("g2")] > point[names.index("g3")]] or points
    return points, spacing


def _list_jumps(problem: FrictionProblem, place: int) -> FloatArray:
    """Return coordinates (K,) at which J jumps, rising; speeds that differ by rounding make one jump."""
    speeds = np.unique(problem.samples.velocity[problem.samples.velocity > problem.low[place]])
    jumps = np.log(speeds)
    return np.asarray(jumps[np.diff(jumps, prepend=-np.inf) > numerics.CONVERGED])


def _cross_jumps(
    projector: Projector, best: Projection, free: IntArray, tolerance: float
) -> tuple[Projection, bool]:
    """Return the optimum of an interval between jumps that no neighbour reached by its end undercuts."""
    problem = projector.problem
    low, high = problem.box
    place = next(k for k in free if problem.law.shape[k].name in JUMPING)
    jumps = _list_jumps(problem, int(place))
    jumps = jumps[(jumps > low[place] + numerics.CONVERGED) & (jumps < high[place])]
    edges = np.concatenate([low[[place]], jumps, high[[place]]])
    while True:
        box = np.array(low), np.array(high)
        above = int(np.clip(np.searchsorted(edges, best.z[place], side="right"), 1, len(edges) - 1))
        inside = 1e-8 * (edges[above] - edges[above - 1])
        box[0][place], box[1][place] = edges[above - 1] + inside, edges[above] - inside
        if not np.array_equal(z := np.clip(best.z, *box), best.z):
            best = min(best, projector.project(z), key=lambda state: state.objective)
        best, done = descend(projector, best, free, tolerance=tolerance, steps=60, box=box)
        # Boxes end 1e-8 of their width before the jump.
        width = 3e-8 * (box[1] - box[0])
        across = np.where(best.z >= box[1], best.z + width, best.z)
        across = np.clip(np.where(best.z <= box[0], best.z - width, across), low, high)
        if not done or projector.exhausted or np.array_equal(across, best.z):
            return best, done
        beyond = projector.project(across)
        if beyond.objective >= best.objective:
            return best, done
        best = beyond


def _visit_kinks(
    projector: Projector, best: Projection, free: IntArray, tolerance: float
) -> tuple[Projection, bool]:
    """Return the least of the optima in the kinks around `best` and between them, and whether it is one."""
    problem = projector.problem
    edge = next(k for k in free if problem.law.shape[k].name in KINKED)
    others = free[free != edge]
    # Solves kept for the smooth rest once the kinks were visited.
    projector.reserve = 12
    for _ in range(2):
        if projector.solves + 2 * _CANDIDATES + projector.reserve > projector.limit:
            break
        # Kinks some deviations about the edge, the other coordinates moved along the valley.
        jacobian = projector.compute_jacobian(best)
        normal = jacobian.T @ jacobian
        slide = np.zeros(len(best.z))
        slide[edge] = 1.0
        left = normal[edge, edge]
        if len(others):
            inner = normal[np.ix_(others, others)]
            slide[others] = -np.linalg.lstsq(inner, normal[others, edge], rcond=None)[0]
            left = left + normal[edge, others] @ slide[others]
        spread = np.sqrt(best.objective / len(best.residual) / max(float(left), numerics.TINY))
        low, high = problem.box
        speeds = np.unique(np.abs(problem.samples.velocity))
        kinks = np.log(speeds[speeds > problem.low[edge]])
        near = np.flatnonzero(np.abs(kinks - best.z[edge]) <= 4.0 * spread)
        nearest = int(np.searchsorted(kinks, best.z[edge]))
        near = np.union1d(near, [k for k in (nearest - 1, nearest) if 0 <= k < len(kinks)]).astype(int)
        if len(near) > _CANDIDATES:
            near = near[np.argsort(np.abs(kinks[near] - best.z[edge]), kind="stable")]
            close, far = near[: _CANDIDATES // 2], near[_CANDIDATES // 2 :]
            thinned = np.linspace(0, len(far) - 1, _CANDIDATES - len(close)).astype(int)
            near = np.concatenate([close, far[thinned]])
        moves = [slide * (kinks[k] - best.z[edge]) for k in near]
        tried = [projector.project(np.clip(best.z + move, low, high)) for move in moves]
        tried.sort(key=lambda state: state.objective)
        before = best.objective
        for state in tried[:2]:
            on_kink, _ = descend(projector, state, others, tolerance=tolerance, steps=4)
            beyond, _ = descend(projector, on_kink, free, tolerance=tolerance, steps=6, patience=_PATIENCE)
            best = min(best, on_kink, beyond, key=lambda end: end.objective)
        if before - best.objective <= 1e-9 * before:
            break
    projector.reserve = 0
    # In a kink the edge stays, and the rest converges; J must then rise on both sides of the edge.
    done = False
    for moving in (others, free, others):
        best, done = descend(projector, best, moving, tolerance=tolerance, steps=20, patience=2 * _PATIENCE)
        gain = max(projector.compute_side_gain(best, edge, side) for side in (1.0, -1.0))
        done = done and gain <= 1e-10 * best.objective
        if done:
            break
    projector.record(best)
    return best, done


def build_nlp(
    problem: FrictionProblem, scale: float, low: FloatArray, high: FloatArray
) -> tuple[SmoothProblem, Iterator[int]]:
    """Return f over the physical parameters between bounds (n,), and a counter of the points evaluated."""
    import casadi

    law, calls = problem.law, itertools.count()
    size, count = len(law.physical), len(law.linear)
    x, inputs = casadi.SX.sym("x", size), casadi.SX.sym("inputs", len(law.inputs))
    values = casadi.mtimes(casadi.DM(np.array(law.unmixing, dtype=np.float64)), x)
    named = {name: inputs[place] for place, name in enumerate(law.inputs)}
    shape = [values[count + place] for place in range(len(law.shape))]
    columns = law.columns(build_casadi_carrier(), named, shape)
    torque = casadi.dot(values[:count], casadi.vertcat(*columns))
    hessian, gradient = casadi.hessian(torque, x)
    # x (n), inputs (i, N) -> torque (1, N), gradient (n, N), Hessian (n n, N).
    function = casadi.Function("torque", [x, inputs], [torque, gradient, casadi.densify(casadi.vec(hessian))])
    given = np.vstack([problem.samples.inputs[name] for name in law.inputs])

    @keep_last
    def compute_state(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        # Errors (M,), their derivatives (M, n), and errors' sum over second ones (n, n).
        next(calls)
        rows = [np.asarray(part, dtype=np.float64).T for part in function(x, given)]
        passed = problem.samples.pass_columns(np.hstack(rows))
        errors = problem.eliminate(passed[:, 0] - problem.target)
        bends = (passed[:, 1 + size :].T @ errors).reshape(size, size)
        return errors, problem.eliminate(passed[:, 1 : 1 + size]), bends

    def compute_hessian(x: FloatArray) -> FloatArray:
        _, slopes, bends = compute_state(x)
        return np.asarray((slopes.T @ slopes + bends) * (2.0 / scale))

    smooth = SmoothProblem(
        value=lambda x: float((errors := compute_state(x)[0]) @ errors) / scale,
        gradient=lambda x: compute_state(x)[1].T @ compute_state(x)[0] * (2.0 / scale),
        hessian=compute_hessian,
        lower=low,
        upper=high,
    )
    return smooth, calls


def search_by_nlp(problem: FrictionProblem, options: FrictionOptions) -> FrictionSearch:
    """Return the least of the optima from several starts."""
    law, projector = problem.law, Projector(problem, np.iinfo(np.int64).max)
    # Bounds of the shape are those of the search.
    edges = zip(law.shape, problem.low, problem.high, strict=True)
    box = {entry.name: tuple(pair) for entry, *pair in edges}
    low, high = np.array([box.get(entry.name, (entry.lower, entry.upper)) for entry in law.physical]).T
    states = [projector.project(z) for z in build_shape_grid(problem, 8 * options.starts)[0]]
    states.sort(key=lambda state: state.objective)
    scale = max(states[0].objective, 1e-20 * float(problem.target @ problem.target), numerics.TINY)
    smooth, calls = build_nlp(problem, scale, low, high)
    compute_hessian: Any = smooth.hessian
    limits = IpoptOptions(tolerance=options.tolerance, iterations=options.iterations)
    history, runs, objectives = [states[0].objective], [], []
    for state in states[: options.starts]:
        start = np.clip(law.to_physical(list(state.linear), list(state.shape)), low, high)
        # One unit of a scaled unknown changes the objective by about one.
        bend = np.abs(np.diag(compute_hessian(start)))
        scales = 1.0 / np.sqrt(np.where(bend > 0.0, bend, 1.0))
        runs.append(minimise(smooth, start, limits, scales))
        objectives.append(smooth.value(runs[-1].x) * scale)
        history.append(min(history[-1], objectives[-1]) if runs[-1].outcome.usable else history[-1])
    usable = [place for place, run in enumerate(runs) if run.outcome.usable]
    place = min(usable or range(len(runs)), key=objectives.__getitem__)
    best, objective = runs[place], objectives[place]
    iterations = sum(run.iterations for run in runs)
    linear, shape = law.from_physical(best.x.tolist())
    same = sum(objectives[place] <= objective * (1.0 + 1e-6) for place in usable)
    counts = next(calls) + projector.evaluations, projector.solves + iterations, iterations
    ended = f"Ipopt ended: {best.reason}; {same} of {len(runs)} starts end at this optimum"
    settings = (("starts", len(runs)), ("agreeing", same))
    return FrictionSearch(linear, shape, objective, *counts, tuple(history), best.outcome, ended, settings)
