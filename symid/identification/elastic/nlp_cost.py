"""Unknowns and cost of the hysteresis-plus-friction problem, exact derivatives, starts, and the covariance.

    x = [beta, IA, friction | Fs_i, vs_i | k0 .. km of joint 1, .. | slopes c of joint 1, ..]
    f(x) = 1 / (2 M) sum_b |r_b(x)|^2 / sigma_b^2,   M rows in all, sigma_b of block b
    H = 1 / M sum_b J_b' J_b / sigma_b^2 + 1 / M sum_b sum_i r_bi / sigma_b^2 d2 r_bi
    covariance  H^-1 (sum_b g_b g_b') H^-1,  H = sum J'J / sigma^2,  g_b = sum of J'r / sigma^2 over stretch b

The slope of the outer function is one at v = 0, which fixes the scale of the weights, and c_j beyond its
j-th knee on each side: rising and passive means c_j > 0 and k_i >= 0. The first term of H alone is the
Gauss-Newton Hessian. Rows within a stretch of time share the same noise (Liang and Zeger 1986).

Supported: knees with slopes of their own on both sides, or odd springs whose sides share them; unknowns
at bounds or without effect, which count as known in the covariance.
Not supported: bounds on base parameters; starts outside the bounds; uncertainty of how many stops and knees.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.codegen import ModelCard
from symid.identification.elastic.nlp_rows import KneeSteps, NlpRecording, RowBlock, build_knee_steps
from symid.identification.elastic.options import NlpOptions
from symid.identification.elastic.regression import (
    average_steps,
    list_lower_bounds,
    list_parameter_cards,
)
from symid.identification.hysteresis import build_stops
from symid.joint_models import Elasticity, Knee, build_numpy_carrier, compute_stribeck_derivatives


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringLayout:
    """One joint's spring among the unknowns.

    Args:
        weights: places of k0 .. km; slopes: places of the slopes.
        thresholds: (m,) of the stops; knees: signed torques.
        slots: for each knee, the entry of `changes` that it belongs to.
        changes: (entries, slopes), differences: change of slope = changes @ c + offset.
        offset: (entries,).
    """

    weights: slice
    slopes: slice
    thresholds: FloatArray
    knees: tuple[float, ...]
    slots: tuple[int, ...]
    changes: FloatArray
    offset: FloatArray

    def compute_changes(self, x: FloatArray) -> FloatArray:
        """Return the changes of slope (entries,) of the unknowns x (x,)."""
        return self.changes @ x[self.slopes] + self.offset

    def build_spring(self, values: FloatArray, least: float) -> Elasticity:
        """Return the spring of the unknowns `values` (x,); weights up to `least` N m/rad are zero."""
        weights, changes = values[self.weights], self.compute_changes(values)
        knees = [
            Knee(threshold=torque, slope=float(changes[slot]))
            for torque, slot in sorted(zip(self.knees, self.slots, strict=True))
            if changes[slot]
        ]
        return Elasticity(
            stiffness=float(weights[0]),
            stops=build_stops(self.thresholds, weights[1:], least),
            knees=tuple(knees),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringGrid:
    """What is fixed of one joint's spring: thresholds (m,) rad or m, signed knee torques N m or N.

    Multiples of `stiffness`, of a linear spring, bound the weights; those of stops beyond `reach`, the
    largest torsion, are zero, as they are one with k0.
    """

    thresholds: FloatArray
    knees: tuple[float, ...]
    stiffness: float
    reach: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpLayout:
    """Places, names and bounds of all unknowns.

    Bounds `lower` and `upper` (x,) are in SI units; `dynamics` are the places of chi, `excess` and `speed`
    those of Fs and vs, empty without Stribeck friction.
    """

    names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    dynamics: slice
    excess: slice
    speed: slice
    springs: tuple[SpringLayout, ...]

    @property
    def size(self) -> int:
        """Return the number of unknowns."""
        return len(self.names)

    @classmethod
    def build(
        cls,
        card: ModelCard,
        grids: Sequence[SpringGrid],
        options: NlpOptions,
        known: FloatArray | None = None,
    ) -> "NlpLayout":
        """Return the unknowns: dynamic parameters of the card, perhaps Stribeck friction, a spring a grid.

        Dynamic parameters that are `known` (p + n + pf,), NaN where not, have two equal bounds.
        """
        joints = range(1, card.size + 1)
        names = [entry.name for entry in list_parameter_cards(card)]
        free = np.full(len(names), True) if known is None else np.isnan(known)
        lower = [np.where(free, list_lower_bounds(card), known if known is not None else 0.0)]
        upper = [np.where(free, np.inf, lower[0])]
        dynamics = slice(0, len(names))
        excess = speed = slice(len(names), len(names))
        if options.stribeck:
            excess = slice(len(names), len(names) + card.size)
            speed = slice(excess.stop, excess.stop + card.size)
            names += [f"{parameter}{joint}" for parameter in ("Fs", "vs") for joint in joints]
            lower += [np.zeros(card.size), np.full(card.size, options.speeds[0])]
            upper += [np.full(card.size, np.inf), np.full(card.size, options.speeds[1])]
        springs = []
        for joint, grid in zip(joints, grids, strict=True):
            # Knees of both sides from zero outwards, or of their sizes where both share slopes.
            knees, odd = grid.knees, options.odd
            sides = [sorted({abs(knee) for knee in knees})]
            if not odd:
                sides = [sorted((knee for knee in knees if knee * side > 0), key=abs) for side in (-1.0, 1.0)]
            places = [knee for side in sides for knee in side]
            # A knee changes the slope from that of the knee before it, or from one.
            changes, offset = np.eye(len(places)) - np.eye(len(places), k=-1), np.zeros(len(places))
            for start in {0, len(sides[0])} - {len(places)}:
                changes[start, :start], offset[start] = 0.0, -1.0
            weights = slice(len(names), len(names) + len(grid.thresholds) + 1)
            springs.append(
                SpringLayout(
                    weights=weights,
                    slopes=slice(weights.stop, weights.stop + len(places)),
                    thresholds=freeze(grid.thresholds),
                    knees=knees,
                    slots=tuple(places.index(abs(knee) if odd else knee) for knee in knees),
                    changes=freeze(changes),
                    offset=freeze(offset),
                )
            )
            names += [f"k{stop} of joint {joint}" for stop in range(len(grid.thresholds) + 1)]
            sign = "+-" if odd else ""
            names += [f"slope beyond {sign}{place:.6g} of joint {joint}" for place in places]
            least, limit = (
                factor * grid.stiffness for factor in (options.least_stiffness, options.weight_limit)
            )
            slopes = np.ones((2, len(places))) * np.array(options.slopes)[:, None]
            lower += [np.array([least]), np.zeros(len(grid.thresholds)), slopes[0]]
            upper += [np.array([limit]), np.where(grid.thresholds < grid.reach, limit, 0.0), slopes[1]]
        return cls(
            names=tuple(names),
            lower=freeze(np.concatenate(lower)),
            upper=freeze(np.concatenate(upper)),
            dynamics=dynamics,
            excess=excess,
            speed=speed,
            springs=tuple(springs),
        )

    def build_start(self, chi: FloatArray, springs: Sequence[Elasticity]) -> FloatArray:
        """Return unknowns (x,) between their bounds: chi (p + n + pf,), springs, no Stribeck friction yet."""
        x = np.zeros(self.size)
        x[self.dynamics] = chi
        x[self.speed] = np.sqrt(self.lower[self.speed] * self.upper[self.speed])
        for place, spring in zip(self.springs, springs, strict=True):
            x[place.weights] = list_weights(spring, place.thresholds)
            slopes = np.zeros(len(place.offset))
            for slot, torque in zip(place.slots, place.knees, strict=True):
                # The slope of the outer function just beyond this knee.
                side = np.sign(torque)
                end = torque * side * (1.0 + 1e-12)
                slopes[slot] = 1.0 + sum(
                    knee.slope for knee in spring.knees if 0.0 < knee.threshold * side <= end
                )
            x[place.slopes] = slopes
        return np.clip(x, self.lower, self.upper)

    def flatten_slopes(self, x: FloatArray, undetermined: Sequence[str]) -> FloatArray:
        """Return x (x,) with slopes of that name as the ones before them: knees that no torque reaches."""
        flat = np.array(x)
        for spring in self.springs:
            for entry, place in enumerate(range(spring.slopes.start, spring.slopes.stop)):
                if self.names[place] in undetermined:
                    before = np.flatnonzero(spring.changes[entry] < 0.0)
                    flat[place] = flat[spring.slopes.start + before[0]] if before.size else 1.0
        return flat

    def read_springs(self, x: FloatArray, least: FloatArray) -> tuple[Elasticity, ...]:
        """Return the springs of the unknowns x (x,); weights up to `least` (n,) N m/rad are zero."""
        pairs = zip(self.springs, least.tolist(), strict=True)
        return tuple(spring.build_spring(x, limit) for spring, limit in pairs)


_LEAST_SIGMA = 1e-6
_LEAST_SHARE = 1e-9
"""Of the size of a block's terms, and of the largest of all blocks: no rows are trusted more."""
_STRETCHES = 100
_NEAR = 1e-6
Places = NDArray[np.intp]
_NUMPY = build_numpy_carrier()


class CostState(NamedTuple):
    """What the cost is made of at one x.

    Args:
        residuals: per block (M_b,) in the unit of its rows; places: unknowns that a block depends on.
        jacobians: per block (M_b, places), d r / dx.
        knees: per recording and joint; friction: per recording and joint the step means of g, g', g''.
    """

    residuals: tuple[FloatArray, ...]
    places: tuple[Places, ...]
    jacobians: tuple[FloatArray, ...]
    knees: tuple[tuple[KneeSteps, ...], ...]
    friction: tuple[tuple[FloatArray, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticNlpCost:
    """The cost; `sigmas` holds one scale for each block, in the order of recordings and their blocks."""

    recordings: tuple[NlpRecording, ...]
    layout: NlpLayout
    sigmas: tuple[float, ...] = ()
    smoothing: float = 0.0

    @property
    def blocks(self) -> tuple[RowBlock, ...]:
        """Return the blocks of all recordings."""
        return tuple(block for part in self.recordings for block in part.blocks)

    @property
    def rows(self) -> int:
        """Return the number of rows."""
        return sum(len(block.values) for block in self.blocks)

    def compute_state(self, x: FloatArray) -> CostState:
        """Return residuals and their derivatives at the unknowns x."""
        layout, blocks, knees, friction = self.layout, [], [], []
        for part in self.recordings:
            steps = tuple(
                build_knee_steps(basis, x[spring.weights], list(zip(spring.knees, spring.slots, strict=True)))
                for spring, basis in zip(layout.springs, part.bases, strict=True)
            )
            # Step means (N - 1, 3) of g, g' and g'' of every joint with Stribeck friction.
            speeds = zip(part.speed.T, x[layout.speed], strict=False)
            rates = (compute_stribeck_derivatives(_NUMPY, *pair, self.smoothing) for pair in speeds)
            means = tuple(average_steps(np.column_stack(derivatives)) for derivatives in rates)
            pairs = zip(steps, layout.springs, strict=True)
            slopes = [own.compute_slopes(spring.compute_changes(x)) for own, spring in pairs]
            # Rows of knees are added up once for all blocks that use them.
            known: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = {}
            for block in part.blocks:
                residual = block.values - block.matrix @ x[layout.dynamics]
                alive = np.flatnonzero(np.any(block.matrix, axis=0))
                places, columns = [alive], [-block.matrix[:, alive]]
                for entry in block.springs:
                    place = layout.springs[entry.joint]
                    torque, slope = entry.columns @ x[place.weights], entry.columns
                    if place.knees:
                        key = entry.joint, id(entry.sums)
                        if key not in known:
                            pair = steps[entry.joint].means, slopes[entry.joint]
                            known[key] = entry.sums.add(pair[0]), entry.sums.add(pair[1])
                        rows, bends = known[key]
                        torque = torque + rows @ place.compute_changes(x)
                        slope = slope + bends
                        places.append(np.arange(place.slopes.start, place.slopes.stop))
                        columns.append(-block.sign * rows @ place.changes)
                    residual = residual - block.sign * torque
                    places.append(np.arange(place.weights.start, place.weights.stop))
                    columns.append(-block.sign * slope)
                for joint, sums in block.friction if means else ():
                    excess, speed = layout.excess.start + joint, layout.speed.start + joint
                    rows = sums.add(means[joint][:, :2])
                    residual = residual - x[excess] * rows[:, 0]
                    places.append(np.array([excess, speed]))
                    columns.append(-rows * np.array([1.0, x[excess]]))
                blocks.append((residual, np.concatenate(places), np.hstack(columns)))
            knees.append(steps)
            friction.append(means)
        return CostState(*zip(*blocks, strict=True), tuple(knees), tuple(friction))

    def compute_value(self, state: CostState) -> float:
        """Return f."""
        parts = zip(state.residuals, self.sigmas, strict=True)
        return sum(float(r @ r) / sigma**2 for r, sigma in parts) / (2.0 * self.rows)

    def compute_gradient(self, state: CostState) -> FloatArray:
        """Return df/dx (x,)."""
        gradient = np.zeros(self.layout.size)
        for r, place, jacobian, sigma in self.list_blocks(state):
            gradient[place] += jacobian.T @ r / sigma**2
        return gradient / self.rows

    def compute_gauss_newton(self, state: CostState) -> FloatArray:
        """Return the Hessian (x, x) without second derivatives of the residuals."""
        hessian = np.zeros((self.layout.size,) * 2)
        for _, place, jacobian, sigma in self.list_blocks(state):
            hessian[np.ix_(place, place)] += jacobian.T @ jacobian / sigma**2
        return hessian / self.rows

    def compute_hessian(self, state: CostState, x: FloatArray) -> FloatArray:
        """Return the exact Hessian (x, x)."""
        hessian = self.compute_gauss_newton(state)
        pending = zip(state.residuals, self.sigmas, strict=True)
        for part, knees, friction in zip(self.recordings, state.knees, state.friction, strict=True):
            pulls = np.zeros((len(knees), len(part.speed) - 1))
            drags = np.zeros_like(pulls)
            for block in part.blocks:
                residual, sigma = next(pending)
                rows = -residual / (sigma**2 * self.rows)
                for entry in block.springs:
                    if self.layout.springs[entry.joint].knees:
                        pulls[entry.joint] += entry.sums.spread(block.sign * rows)
                for joint, sums in block.friction if friction else ():
                    drags[joint] += sums.spread(rows)
            for spring, steps, pull in zip(self.layout.springs, knees, pulls, strict=True):
                if spring.knees:
                    cross = steps.compute_cross(pull) @ spring.changes
                    hessian[spring.weights, spring.slopes] += cross
                    hessian[spring.slopes, spring.weights] += cross.T
                    bend = steps.compute_curvature(pull, spring.compute_changes(x))
                    hessian[spring.weights, spring.weights] += bend
            for joint, rates in enumerate(friction):
                excess, speed = self.layout.excess.start + joint, self.layout.speed.start + joint
                mixed = float(drags[joint] @ rates[:, 1])
                hessian[excess, speed] += mixed
                hessian[speed, excess] += mixed
                hessian[speed, speed] += x[excess] * float(drags[joint] @ rates[:, 2])
        return hessian

    def list_blocks(self, state: CostState) -> Iterator[tuple[FloatArray, Places, FloatArray, float]]:
        """Yield residual, places, Jacobian and scale of every block."""
        return zip(state.residuals, state.places, state.jacobians, self.sigmas, strict=True)

    def weigh(self, residuals: Sequence[FloatArray], chi: FloatArray) -> "ElasticNlpCost":
        """Return the cost with the rms of these residuals (M_b,) of every block as its scale."""
        pairs = zip(self.blocks, residuals, strict=True)
        counts = [len(residual) if block.counted is None else block.counted for block, residual in pairs]
        roots = np.sqrt(np.maximum(counts, 1))
        sizes = np.array([np.linalg.norm(part) for part in residuals]) / roots
        loads = np.array([np.linalg.norm(block.matrix @ chi) for block in self.blocks]) / roots
        # Rows of a joint at rest hold what filters leave of a constant, down to 1e-160: beside the largest
        # load they are rounding, and must not be weighed up to information.
        sigmas = np.maximum(np.maximum(sizes, _LEAST_SIGMA * loads), _LEAST_SHARE * np.max(loads))
        # Without any load all rows are empty and weigh nothing, whatever their scale.
        return replace(self, sigmas=tuple(np.where(sigmas > 0.0, sigmas, 1.0).tolist()))

    def compute_covariance(self, x: FloatArray, places: Sequence[Sequence[FloatArray]] = ()) -> FloatArray:
        """Return the covariance (p + n + pf, p + n + pf) of the dynamic parameters at the optimum `x`.

        `places` has, for each stop or knee, the derivative (M_b,) of every block's residuals by its place.
        """
        inverse, scores = self.invert_normal_equations(x, places)
        spread = scores @ inverse[:, self.layout.dynamics]
        return spread.T @ spread

    def invert_normal_equations(
        self, x: FloatArray, places: Sequence[Sequence[FloatArray]] = ()
    ) -> tuple[FloatArray, FloatArray]:
        """Return H^-1 (s, s) of unknowns x and places behind them, and scores (stretches, s): J'r / sigma^2.

        H^-1 is zero for what has no effect or stands at a bound. Arguments as those of `compute_covariance`.
        """
        state = self.compute_state(x)
        size = len(x) + len(places)
        curvature, scores = np.zeros((size, size)), np.zeros((len(self.recordings), _STRETCHES, size))
        owners = [index for index, part in enumerate(self.recordings) for _ in part.blocks]
        for number, (residual, known, jacobian, sigma) in enumerate(self.list_blocks(state)):
            rows = np.zeros((len(residual), size))
            rows[:, known] = jacobian
            for column, slopes in enumerate(places, start=len(x)):
                rows[:, column] = slopes[number]
            curvature += rows.T @ rows / sigma**2
            stretch = (np.arange(len(residual)) * _STRETCHES) // len(residual)
            np.add.at(scores[owners[number]], stretch, rows * (residual / sigma**2)[:, None])
        lengths = np.sqrt(np.diag(curvature))
        reach = _NEAR * np.maximum(np.abs(x), 1e-12)
        is_free = lengths > 0.0
        is_free[: len(x)] &= (x - self.layout.lower > reach) & (self.layout.upper - x > reach)
        free = np.ix_(is_free, is_free)
        sizes = np.outer(lengths, lengths)[free]
        inverse = np.zeros_like(curvature)
        inverse[free] = np.linalg.pinv(curvature[free] / sizes, rcond=1e-10, hermitian=True) / sizes
        return inverse, scores.reshape(-1, size)


_FIRST_SHARE = 0.7
"""Of a linear spring, for k0; the stops begin with equal parts of the rest."""


def list_weights(spring: Elasticity, thresholds: FloatArray) -> FloatArray:
    """Return k0 .. km (m + 1,) on the thresholds (m,); a linear spring is shared between them."""
    whole = spring.initial_stiffness or 0.0
    if len(thresholds) and not spring.stops:
        weights = np.full(len(thresholds) + 1, (1.0 - _FIRST_SHARE) * whole / len(thresholds))
        weights[0] = _FIRST_SHARE * whole
        return weights
    known = {stop.threshold: stop.stiffness or 0.0 for stop in spring.stops}
    return np.array([spring.stiffness or 0.0, *(known.get(float(value), 0.0) for value in thresholds)])
