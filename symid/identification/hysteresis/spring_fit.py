"""The spring that explains a filtered joint torque: weights, then places of stops and knees, then fewer.

    v = sum_i k_i E_i[phi] (E_0 = phi), tau_J = sum_j c_j ramp_j(v);  min |F[tau_J] - target|, k >= 0, c >= c0
    d tau_J / d r_i = -S'(v) k_i D_i,  D_i = d P_i / d r_i = -1, +1 since the play touched phi - r, phi + r
    d tau_J / d R_j = (c_j-1 - c_j) where v is beyond R_j

ramp_j is the part of v between two knees and c_j the slope there; the outer function has slope one at zero,
which fixes the scale of the weights. Non-negative least squares and Gauss-Newton on a grid, then projected
Levenberg-Marquardt with places, then fewer of them while that costs less than matters.
Not supported: cubic springs, damping, an offset of the torsion; adding stops or knees to those of the start.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray, accumulate, compute_triangle
from symid.errors import RobotError
from symid.identification.hysteresis.families import EXACT, GRID, SAMPLES, STARTS, list_lengths
from symid.identification.judge import POLICY, numerics
from symid.joint_models import Elasticity, Knee, PlayPath, Stop


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringWeights:
    """One spring: `thresholds` (m,) of the stops, rad or m, `stiffness` (m + 1,) k_0 .. k_m >= 0.

    `knees` (l,) are signed torques, N m or N: those below zero, then those above, both from zero outwards;
    `slopes` (l,) are those beyond each of them; the slope around zero torque is one.
    """

    thresholds: FloatArray
    stiffness: FloatArray
    knees: FloatArray
    slopes: FloatArray

    @property
    def count(self) -> int:
        """Return the number of stops and knees."""
        return len(self.thresholds) + len(self.knees)

    @property
    def below(self) -> int:
        """Return the number of knees below zero torque."""
        return int(np.count_nonzero(self.knees < 0.0))

    @property
    def before(self) -> FloatArray:
        """Return the slopes (l,) before each knee, coming from zero."""
        before = np.ones_like(self.slopes)
        before[1:] = self.slopes[:-1]
        before[self.below : self.below + 1] = 1.0
        return before

    def move(self, step: FloatArray) -> "SpringWeights":
        """Return this spring with a step added to stiffnesses and slopes, none of the former below zero.

        A longer step also moves thresholds and knees.
        """
        parts = [self.stiffness, self.slopes, self.thresholds, self.knees]
        ends = np.cumsum([len(part) for part in parts])
        whole = np.concatenate(parts)
        whole[: len(step)] += step
        stiffness, slopes, thresholds, knees = np.split(whole, ends[:-1])
        # Places that stay are the same arrays, whose basis is at hand.
        places = (thresholds, knees) if len(step) == ends[-1] else (self.thresholds, self.knees)
        return SpringWeights(
            thresholds=places[0], stiffness=np.maximum(stiffness, 0.0), knees=places[1], slopes=slopes
        )

    def keep_knees(self, kept: NDArray[np.bool_]) -> "SpringWeights":
        """Return this spring with some of its knees (l,) alone."""
        return replace(self, knees=self.knees[kept], slopes=self.slopes[kept])


def compute_ramps(inner: FloatArray, weights: SpringWeights) -> FloatArray:
    """Return the parts of v (N,) that lie beyond each knee and before the next one: (N, knees)."""
    knees = weights.knees
    further = np.copysign(np.inf, knees)
    further[:-1] = np.where(knees[:-1] * knees[1:] > 0.0, knees[1:], further[:-1])
    low, high = (pick(knees, further)[:, None] for pick in (np.minimum, np.maximum))
    return np.asarray((np.clip(inner, low, high) - knees[:, None]).T)


def compute_outer(basis: FloatArray, weights: SpringWeights) -> FloatArray:
    """Return tau_J (N,) of torsion and stops (N, m + 1)."""
    inner = basis @ weights.stiffness
    return inner + compute_ramps(inner, weights) @ (weights.slopes - 1.0)


def hold_knees(knees: FloatArray, lowest: float, highest: float) -> FloatArray:
    """Return knee torques (l,) as those of `SpringWeights`, none so near to zero that it does not matter.

    The slope of one there fixes the scale of the weights. `lowest` is the largest -v, `highest` that of v.
    """
    rank, largest = np.arange(len(knees)), np.where(knees < 0.0, lowest, highest)
    rank = np.where(knees < 0.0, rank, rank - np.count_nonzero(knees < 0.0))
    least = POLICY.relevance * largest * (1 + rank)
    return np.sign(knees) * np.maximum(np.abs(knees), least)


def build_knee_grid(inner: Sequence[FloatArray], count: int, *, odd: bool = False) -> FloatArray:
    """Return knee torques as those of `SpringWeights`: -+ (j - 1/2) / count max(-v or v), j = 1 .. count.

    None lies nearer to zero than `hold_knees` allows; `inner` is v (N,) of every recording, N m or N. Odd
    grids reach as far on both sides.
    """
    low, high = max(0.0, *(-float(v.min()) for v in inner)), max(0.0, *(float(v.max()) for v in inner))
    if odd:
        low = high = max(low, high)
    steps = (np.arange(count) + 0.5) / max(count, 1)
    sides = [sign * steps * edge for sign, edge in ((-1.0, low), (1.0, high)) if edge]
    return hold_knees(np.concatenate([np.zeros(0), *sides]), low, high)


def read_weights(spring: Elasticity) -> SpringWeights:
    """Return the numbers of a spring that has all its values, but for a cubic part and damping."""
    knees = sorted(spring.knees, key=lambda knee: (knee.threshold > 0.0, abs(knee.threshold)))
    sides = [[knee.slope for knee in knees if knee.threshold * side > 0.0] for side in (-1.0, 1.0)]
    return SpringWeights(
        thresholds=np.array([stop.threshold for stop in spring.stops]),
        stiffness=np.array([spring.stiffness or 0.0, *(stop.stiffness or 0.0 for stop in spring.stops)]),
        knees=np.array([knee.threshold for knee in knees]),
        slopes=np.concatenate([1.0 + np.cumsum(side) for side in sides]),
    )


def build_stops(thresholds: FloatArray, stiffness: FloatArray, least: float) -> tuple[Stop, ...]:
    """Return the stops at (m,) rad or m whose stiffness (m,), N m/rad or N/m, is of a size above `least`."""
    pairs = zip(thresholds.tolist(), stiffness.tolist(), strict=True)
    return tuple(Stop(threshold=radius, stiffness=value) for radius, value in pairs if abs(value) > least)


def build_elasticity(weights: SpringWeights) -> Elasticity:
    """Return the spring as a record, without stops of no stiffness and knees that change no slope."""
    whole = float(np.sum(weights.stiffness))
    changes = zip(weights.knees.tolist(), (weights.slopes - weights.before).tolist(), strict=True)
    # Without any stiffness there is no torque, and knees have no effect.
    kept = sorted(pair for pair in changes if whole and abs(pair[1]) > numerics.CONVERGED)
    return Elasticity(
        # A spring that does not rise once all stops slip has no inverse.
        stiffness=max(float(weights.stiffness[0]), numerics.CONVERGED * whole),
        stops=build_stops(weights.thresholds, weights.stiffness[1:], numerics.CONVERGED * whole),
        knees=tuple(Knee(threshold=torque, slope=change) for torque, change in kept),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringData:
    """What does not change while the spring of one joint is fitted; only plays run at full rate.

    Args:
        paths: torsions of every recording, rad or m, for samples that rows are filtered from.
        periods: of the torsions, s; keeps: samples of each that rows belong to.
        rate: of the filter in rad/s.
        thresholds: (m,) rad or m, of the grid; basis: (N', m + 1) for them, phi and the stops, thinned.
        filtered: (M, m + 1), F[basis] at the rows, all recordings stacked.
    """

    paths: tuple[PlayPath, ...]
    periods: tuple[float, ...]
    keeps: tuple[slice, ...]
    rate: float
    thresholds: FloatArray = field(default_factory=lambda: np.zeros(0))
    basis: tuple[FloatArray, ...] = ()
    filtered: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def compute_basis(self, thresholds: FloatArray) -> tuple[FloatArray, ...]:
        """Return phi and the stops of other thresholds, thinned, for every recording."""
        if thresholds is self.thresholds and self.basis:
            return self.basis
        return tuple(path.follow_stops(thresholds)[1] for path in self.paths)

    @classmethod
    def build(
        cls, torsions: Sequence[FloatArray], periods: Sequence[float], keeps: Sequence[slice], rate: float
    ) -> "SpringData":
        """Return the data of torsions (N,), without thresholds; for the rest see the class."""
        # Also samples before the first row, whose filter begins from rest.
        kept = [slice(keep.start % keep.step, None, keep.step) for keep in keeps]
        paths = tuple(map(PlayPath.build, torsions, kept))
        return cls(paths=paths, periods=tuple(periods), keeps=tuple(keeps), rate=rate)

    def rebuild(self, thresholds: FloatArray) -> "SpringData":
        """Return the data with these thresholds (m,) as their grid, so that their basis is at hand."""
        basis = self.compute_basis(thresholds)
        if basis is self.basis:
            return self
        return replace(self, thresholds=thresholds, basis=basis, filtered=filter_parts(self, basis))

    def compute_torque(self, weights: SpringWeights) -> FloatArray:
        """Return F[tau_J] (M,) of a spring at the rows."""
        if weights.thresholds is self.thresholds and not len(weights.knees):
            return self.filtered @ weights.stiffness
        bases = self.compute_basis(weights.thresholds)
        return filter_parts(self, [compute_outer(basis, weights) for basis in bases])

    def compute_cost(self, target: FloatArray, weights: SpringWeights) -> float:
        """Return |target - F[tau_J]|^2 for `target` (M,)."""
        return float(np.sum((target - self.compute_torque(weights)) ** 2))

    def fit_stops(self, target: FloatArray) -> SpringWeights:
        """Return non-negative stiffnesses of spring and stops (no knees) for `target` = F[tau_J] (M,)."""
        stiffness, none = solve_non_negative(self.filtered, target), np.zeros(0)
        return SpringWeights(thresholds=self.thresholds, stiffness=stiffness, knees=none, slopes=none)


def filter_smooth(values: FloatArray, rate: float, period: float, *, held: bool = False) -> FloatArray:
    """Return F[values] (N, ...), from rest, of a signal that is a straight line between samples, or `held`.

    y_k = a y_k-1 + g x_k + (1 - a - g) x_k-1, g = 1 - (1 - a) / (rate period), 0 if x_k holds until t_k+1;
    a = exp(-rate period); rate in rad/s, period in s.
    """
    if np.isinf(rate) and not held:
        return values
    decay = np.exp(-rate * period)
    ahead = 0.0 if held else 1.0 - (1.0 - decay) / (rate * period)
    steps = ahead * values[1:] + (1.0 - decay - ahead) * values[:-1]
    return accumulate(np.concatenate([np.zeros_like(values[:1]), steps]), float(decay))


def filter_parts(data: SpringData, parts: Sequence[FloatArray]) -> FloatArray:
    """Return F[parts] at the rows (M, k), of thinned columns (N', k) for every recording."""
    rows = [
        filter_smooth(part, data.rate, period * keep.step)[keep.start // keep.step :]
        for part, keep, period in zip(parts, data.keeps, data.periods, strict=True)
    ]
    return np.concatenate(rows)


def fit_spring(data: SpringData, target: FloatArray, start: SpringWeights) -> SpringWeights:
    """Return stiffnesses and slopes by a projected Gauss-Newton method from `start`; places stay.

    A step is halved while the cost rises.
    """
    if not len(start.knees) and start.thresholds is data.thresholds:
        return data.fit_stops(target)
    best, cost = start, data.compute_cost(target, start)
    floor = np.append(np.zeros(len(best.stiffness)), np.full(len(best.knees), POLICY.relevance))
    for _ in range(numerics.ROUNDS):
        slopes = [compute_spring_slopes(basis, best) for basis in data.compute_basis(best.thresholds)]
        filtered = filter_parts(data, slopes)
        jacobian, packed = filtered[:, :-1], np.append(best.stiffness, best.slopes)
        right = target - filtered[:, -1] + jacobian @ (packed - floor)
        goal = floor + solve_non_negative(jacobian, right)
        for halving in range(numerics.ROUNDS):
            trial = best.move((goal - packed) / 2.0**halving)
            if (reached := data.compute_cost(target, trial)) <= cost:
                break
        else:
            return best
        fall = (cost - reached) / max(cost, numerics.TINY)
        best, cost = trial, reached
        if fall < numerics.CONVERGED:
            break
    return best


def solve_non_negative(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return argmin |matrix x - right|, x >= 0, with columns scaled to length one; empty columns get zero."""
    triangle = compute_triangle(np.column_stack([matrix, right]))
    lengths = np.linalg.norm(triangle[:, :-1], axis=0)
    longest = max(float(lengths.max(initial=0.0)), numerics.TINY)
    scales = np.where(lengths > numerics.EXACT * longest, lengths, np.inf)
    return np.asarray(scipy.optimize.nnls(triangle[:, :-1] / scales, triangle[:, -1])[0] / scales)


def _evaluate_spring(
    data: SpringData, target: FloatArray, weights: SpringWeights
) -> tuple[SpringWeights, list[tuple[FloatArray, FloatArray]], float]:
    """Return a spring, knees held away from zero, its bases at turns and samples, |target - F[tau_J]|^2."""
    # The torque is largest at turns.
    bases = [path.follow_stops(weights.thresholds) for path in data.paths]
    reach = measure_reach([turns for turns, _ in bases], weights)[1:]
    weights = replace(weights, knees=hold_knees(weights.knees, *reach))
    errors = target - filter_parts(data, [compute_outer(samples, weights) for _, samples in bases])
    return weights, bases, float(errors @ errors)


def measure_reach(bases: Sequence[FloatArray], weights: SpringWeights) -> tuple[float, float, float]:
    """Return the largest torsion, and the largest -v and v: beyond them a place has no effect."""
    inner = [basis @ weights.stiffness for basis in bases]
    torsion = max(float(np.abs(basis[:, 0]).max()) for basis in bases)
    return torsion, max(-float(v.min()) for v in inner), max(float(v.max()) for v in inner)


def _compute_jacobian(
    data: SpringData, bases: Sequence[tuple[FloatArray, FloatArray]], weights: SpringWeights
) -> FloatArray:
    """Return F of `compute_spring_slopes` by all numbers at the rows."""
    parts = []
    for path, (turns, samples) in zip(data.paths, bases, strict=True):
        # Who slipped on the way from a turn slips still.
        now = _find_slipping(samples, weights.thresholds)
        slips = np.where(now, now, np.take(compute_slips(turns, weights.thresholds).T, path.former, axis=1).T)
        parts.append(compute_spring_slopes(samples, weights, slips))
    return filter_parts(data, parts)


def optimise_spring(
    data: SpringData, target: FloatArray, start: SpringWeights, tolerance: float = EXACT
) -> tuple[SpringWeights, float]:
    """Return the best spring from `start` with as many stops and knees, and its cost.

    While springs are compared, steps that lower the squares by less than `EXACT` are no reason to go on.
    """
    (best, bases, cost), damping = _evaluate_spring(data, target, start), 1e-4
    for _ in range(numerics.ROUNDS):
        filtered = _compute_jacobian(data, bases, best)
        jacobian, value = filtered[:, :-1], filtered[:, -1]
        down, up = compute_place_limits([turns for turns, _ in bases], best)
        low = np.concatenate([-best.stiffness, POLICY.relevance - best.slopes, down])
        high = np.concatenate([np.full(len(low) - len(up), np.inf), up])
        # Columns without effect get no step, not a huge one.
        lengths = np.linalg.norm(jacobian, axis=0)
        idle = lengths <= numerics.EXACT * float(lengths.max())
        low, high, lengths = np.where(idle, 0.0, low), np.where(idle, 0.0, high), np.where(idle, 1.0, lengths)
        scaled, fall = compute_triangle(np.column_stack([jacobian / lengths, target - value])), 0.0
        square, right = scaled[: len(lengths), :-1], scaled[: len(lengths), -1]
        # Bounds that meet are held a hair apart, as the solver asks.
        hair = numerics.EXACT * max(float(np.linalg.norm(target)), numerics.TINY)
        low, high = np.minimum(low * lengths, 0.0) - hair, np.maximum(high * lengths, 0.0) + hair
        whole = np.append(right, np.zeros(len(lengths)))
        # Beyond it steps are hardly longer than those of steepest descent.
        while damping <= 1.0:
            matrix = np.vstack([square, np.sqrt(damping) * np.eye(len(lengths))])
            move = scipy.optimize.lsq_linear(matrix, whole, bounds=(low, high), method="bvls").x / lengths
            trial, further, reached = _evaluate_spring(data, target, best.move(move))
            if reached < cost:
                fall = (cost - reached) / cost
                best, bases, cost, damping = trial, further, reached, damping / 10.0
                break
            damping *= 10.0
        if fall < tolerance:
            break
    return best, cost


def compute_place_limits(
    bases: Sequence[FloatArray], weights: SpringWeights
) -> tuple[FloatArray, FloatArray]:
    """Return how far thresholds and knees may each move down and up at once: (m + l,)."""
    torsion, lowest, highest = measure_reach(bases, weights)
    stops = _compute_room(weights.thresholds, 0.0, torsion)
    below = _compute_room(-weights.knees[: weights.below], POLICY.relevance * lowest, lowest)
    above = _compute_room(weights.knees[weights.below :], POLICY.relevance * highest, highest)
    return np.concatenate([stops[0], -below[1], above[0]]), np.concatenate([stops[1], -below[0], above[1]])


def _compute_room(places: FloatArray, least: float, edge: float) -> tuple[FloatArray, FloatArray]:
    """Return how far each of the increasing places (k,) may move down and up between `least` and `edge`."""
    gaps = np.diff(np.concatenate([[min([least, *places[:1]])], places, [max([edge, *places[-1:]])]]))
    return -gaps[:-1] / 3.0, gaps[1:] / 3.0


def compute_spring_slopes(
    basis: FloatArray, weights: SpringWeights, slips: FloatArray | None = None
) -> FloatArray:
    """Return the derivatives of tau_J by stiffnesses, slopes, thresholds and knees, and tau_J: (N, k + 1).

    `basis` (N, m + 1) are torsion and stops; `slips` (N, m) only where thresholds and knees have columns.
    """
    inner = basis @ weights.stiffness
    order = np.argsort(weights.knees)
    slopes = np.insert(weights.slopes[order], weights.below, 1.0)
    local = slopes[np.searchsorted(weights.knees[order], inner)][:, None]
    ramps = compute_ramps(inner, weights)
    columns = [basis * local, ramps]
    if slips is not None:
        beyond = np.sign(weights.knees) * (inner[:, None] - weights.knees) > 0.0
        columns += [slips * weights.stiffness[1:] * local, (weights.before - weights.slopes) * beyond]
    return np.column_stack([*columns, inner + ramps @ (weights.slopes - 1.0)])


def compute_slips(basis: FloatArray, thresholds: FloatArray) -> FloatArray:
    """Return d E_i / d r_i (N, m): the side on which each stop slipped last, 0 before it ever did."""
    side = _find_slipping(basis, thresholds)
    last = np.maximum.accumulate(np.where(side != 0.0, np.arange(len(basis))[:, None], 0), axis=0)
    return np.take_along_axis(side, last, axis=0)


def _find_slipping(basis: FloatArray, thresholds: FloatArray) -> FloatArray:
    """Return the side (N, m) on which each stop slips at this sample, 0 for neither."""
    stops, least = basis[:, 1:], (1.0 - numerics.RANK) * thresholds
    return np.where(stops >= least, 1.0, np.where(stops <= -least, -1.0, 0.0))


def refine_spring(data: SpringData, target: FloatArray, start: SpringWeights) -> SpringWeights:
    """Return the spring of fewest stops and knees at their best places for F[tau_J] (M,), N m.

    `start` is a spring on the grid, and is returned where that is no worse.
    """
    grid_cost = data.compute_cost(target, start)
    thinned, coarse = _thin_data(data, target)
    dense = start
    if len(start.thresholds):
        # Stops on a geometric grid, as many small as large.
        phi = np.concatenate([path.values for path in thinned.paths])
        grid = list_lengths(phi, float(np.abs(phi).max()), GRID)
        spread = replace(start, thresholds=grid, stiffness=np.append(start.stiffness[:1], np.zeros(GRID)))
        dense = fit_spring(thinned.rebuild(grid), coarse, spread)
    # Without stops of no stiffness and knees that change nothing.
    busy = dense.stiffness[1:] > numerics.CONVERGED * np.sum(dense.stiffness)
    kept = dense.keep_knees(np.abs(dense.slopes - dense.before) > numerics.CONVERGED)
    stiffness = dense.stiffness[np.concatenate([[True], busy])]
    lean = replace(kept, thresholds=dense.thresholds[busy], stiffness=stiffness)
    best, cost = optimise_spring(thinned, coarse, lean)
    enough = (EXACT * float(np.linalg.norm(coarse))) ** 2
    simpler = _list_simpler(thinned, coarse, best)
    while simpler:
        trial, reached = optimise_spring(thinned, coarse, simpler.pop(0))
        # Each stop or knee must lower the squares by what matters.
        if reached <= max(cost * (1.0 + POLICY.relevance) ** (best.count - trial.count), enough):
            best, cost = trial, reached
            simpler = _list_simpler(thinned, coarse, best)
    # Knees beyond which hardly a sample lies are not identifiable, and extrapolate.
    inner = np.concatenate([basis @ best.stiffness for basis in data.compute_basis(best.thresholds)])
    beyond = (inner[:, None] - best.knees) * np.sign(best.knees) > 0.0
    best = follow_spring(data, target, best.keep_knees(np.mean(beyond, axis=0) >= POLICY.relevance))
    allowed = max(grid_cost * (1.0 + POLICY.relevance), (EXACT * float(np.linalg.norm(target))) ** 2)
    return best if data.compute_cost(target, best) <= allowed else start


def follow_spring(data: SpringData, target: FloatArray, start: SpringWeights) -> SpringWeights:
    """Return the best spring near `start`, with as many stops and knees, places included."""
    return optimise_spring(data, target, start, numerics.CONVERGED)[0]


def _thin_data(data: SpringData, target: FloatArray) -> tuple[SpringData, FloatArray]:
    """Return about `SAMPLES` rows, with plays at twice as many samples: enough to locate places."""
    torsions, keeps, periods, parts, at = [], [], [], [], 0
    every = max(1, len(target) // SAMPLES)
    for path, keep, period in zip(data.paths, data.keeps, data.periods, strict=True):
        rows = len(path.own) - keep.start // keep.step
        stride = keep.step * (every // 2 if every % 2 == 0 else 1)
        first = keep.start % stride
        torsions.append(np.ascontiguousarray(path.values[first::stride]))
        keeps.append(slice((keep.start - first) // stride, None, every * keep.step // stride))
        parts.append(target[at : at + rows : every])
        periods.append(period * stride)
        at += rows
    return SpringData.build(torsions, periods, keeps, data.rate), np.concatenate(parts)


def _list_simpler(data: SpringData, target: FloatArray, weights: SpringWeights) -> list[SpringWeights]:
    """Return springs with one stop or knee less, those first that cost least once the rest is fitted again.

    What it costs to hold A x = c is (A x - c)' (A H^-1 A')^-1 (A x - c), H = J'J (Hassibi and Stork, Advances
    in Neural Information Processing Systems 5, 1992, 164-171, "optimal brain surgeon").
    """
    jacobian = _compute_jacobian(data, _evaluate_spring(data, target, weights)[1], weights)[:, :-1]
    lengths = np.linalg.norm(jacobian, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    triangle = compute_triangle(jacobian / lengths)
    inverse = np.linalg.pinv(triangle.T @ triangle, rcond=numerics.RANK, hermitian=True)
    inverse /= np.outer(lengths, lengths)
    point = np.concatenate([weights.stiffness, weights.slopes])
    units, stops, knees = np.eye(len(inverse)), len(weights.thresholds), len(weights.knees)

    def cost(*rows: FloatArray, level: float) -> float:
        held = np.array(rows)
        moved = held[:, : len(point)] @ point - level
        return float(moved @ np.linalg.pinv(held @ inverse @ held.T, hermitian=True) @ moved)

    options: list[tuple[float, Callable[[], SpringWeights]]] = [
        (cost(units[1 + place], level=0.0), partial(_leave_stop, data, target, weights, place))
        for place in range(stops)
    ]
    slopes, above = units[stops + 1 : stops + 1 + knees], weights.below
    for place in range(knees):
        # The slope beyond a knee is that before it, which is one within the innermost knees.
        inner = place in {0, above}
        row, level = (slopes[place], 1.0) if inner else (slopes[place] - slopes[place - 1], 0.0)
        options.append((cost(row, level=level), partial(weights.keep_knees, np.arange(knees) != place)))
    if 0 < above < knees:
        # Without the innermost knees of both sides: the slope beyond them is then the one at zero, and scales
        # all weights. Left out one by one, the other would stand in the way.
        pair, slope = (0, above), float(weights.slopes[0] + weights.slopes[above]) / 2.0
        lean = SpringWeights(
            thresholds=weights.thresholds,
            stiffness=weights.stiffness * slope,
            knees=np.delete(weights.knees, pair) * slope,
            slopes=np.delete(weights.slopes, pair) / slope,
        )
        options.append((cost(slopes[0], slopes[above], level=1.0), lambda: lean))
    options.sort(key=lambda option: option[0])
    return [build() for _, build in options[:STARTS]]


def _leave_stop(data: SpringData, target: FloatArray, weights: SpringWeights, place: int) -> SpringWeights:
    """Return a spring without a stop, or merged with its lower neighbour at the mean of both: the better."""
    stiffness = np.delete(weights.stiffness, 1 + place)
    plain = replace(weights, thresholds=np.delete(weights.thresholds, place), stiffness=stiffness)
    if not place:
        return plain
    pair, ends = weights.stiffness[place : 2 + place], weights.thresholds[place - 1 : place + 1]
    stiffness, thresholds = plain.stiffness.copy(), plain.thresholds.copy()
    stiffness[place] = np.sum(pair)
    thresholds[place - 1] = float(pair @ ends / max(np.sum(pair), numerics.TINY))
    merged = replace(weights, thresholds=thresholds, stiffness=stiffness)
    return min(plain, merged, key=lambda spring: data.compute_cost(target, spring))


STEP = 1e-4
"""Of derivatives by differences, relative."""
SpringPlace = tuple[str, int, str]
"""Of a number of a spring: the field, which of its parts, and their field; -1 and "" for a number itself."""


def list_spring_numbers(spring: Elasticity) -> list[tuple[float, SpringPlace]]:
    """Return every number of a spring that data decide, and its place."""
    found = [(getattr(spring, name), (name, -1, "")) for name in ("stiffness", "cubic", "damping")]
    found += [
        (getattr(entry, part.name), (name, index, part.name))
        for name in ("stops", "knees", "branches")
        for index, entry in enumerate(getattr(spring, name))
        for part in fields(entry)
    ]
    return [pair for pair in found if isinstance(pair[0], float) and pair[0]]


def move_spring(spring: Elasticity, place: SpringPlace, value: float) -> Elasticity:
    """Return a spring with another number in a place; raise RobotError where no spring has it."""
    name, index, part = place
    if index < 0:
        return replace(spring, **{name: value})  # type: ignore[arg-type]  # a number of the spring
    whole = list(getattr(spring, name))
    whole[index] = replace(whole[index], **{part: value})
    return replace(spring, **{name: tuple(whole)})  # type: ignore[arg-type]  # stops, knees or branches


def differentiate_spring(spring: Elasticity, compute: Callable[[Elasticity], FloatArray]) -> FloatArray:
    """Return the derivatives (M, k) of what a spring gives (M,) by all its numbers."""
    columns = []
    for number, place in list_spring_numbers(spring):
        step, sides = STEP * abs(number), []
        for value in (number + step, number - step, number):
            # At the edge of what springs can be, such as a knee that all but flattens them, one side is left.
            with suppress(RobotError):
                sides.append((move_spring(spring, place, value), value))
        if len(sides) > 1:
            (above, high), (below, low) = sides[:2]
            columns.append((compute(above) - compute(below)) / (high - low))
    return np.column_stack(columns) if columns else np.empty((len(compute(spring)), 0))
