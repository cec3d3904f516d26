"""The cost of the hysteresis-plus-friction problem, its gradient and its Hessian, exact.

NlpRecording, NlpLayout, row weights -> NlpCost; unknowns -> CostState.

    f(x) = 1 / (2 M) sum_b |r_b(x)|^2 / sigma_b^2,   M rows in all, sigma_b of block b
    H = 1 / M sum_b J_b' J_b / sigma_b^2 + 1 / M sum_b sum_i r_bi / sigma_b^2 d2 r_bi

The first term alone is the Gauss-Newton Hessian. The second has closed forms too: unknowns meet only in the
products of slopes and weights, at crossings of knees, and in the Stribeck velocity.

Supported: any rows that add up steps (`nlp_sums`).
Not supported: rows that depend on each other's noise.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.elastic.nlp_layout import NlpLayout, SpringLayout
from symid.elastic.nlp_rows import NlpRecording, RowBlock
from symid.elastic.nlp_springs import KneeSteps, find_knee_steps
from symid.elastic.nlp_sums import StepSums
from symid.joint.stribeck import StribeckCarrier, find_stribeck_rates

__all__ = ["CostState", "NlpCost"]

Places = NDArray[np.intp]
_NUMPY = StribeckCarrier(exp=np.exp, sign=np.sign, tanh=np.tanh)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CostState:
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
class NlpCost:
    """The cost; `sigmas` holds one scale for each block, in the order of recordings and their blocks."""

    recordings: tuple[NlpRecording, ...]
    layout: NlpLayout
    sigmas: tuple[float, ...]
    smoothing: float = 0.0

    @property
    def blocks(self) -> tuple[RowBlock, ...]:
        """Return the blocks of all recordings."""
        return tuple(block for part in self.recordings for block in part.blocks)

    @property
    def rows(self) -> int:
        """Return the number of rows."""
        return sum(len(block.values) for block in self.blocks)

    def find_state(self, x: FloatArray) -> CostState:
        """Return residuals and their derivatives at the unknowns x."""
        residuals: list[FloatArray] = []
        places: list[Places] = []
        jacobians: list[FloatArray] = []
        knees, friction = [], []
        for part in self.recordings:
            knees.append(self._find_knees(part, x))
            friction.append(self._find_friction(part, x))
            shared = _Shared(self.layout, x, knees[-1], friction[-1])
            for block in part.blocks:
                residual, place, jacobian = shared.find_block(block)
                residuals.append(residual)
                places.append(place)
                jacobians.append(jacobian)
        return CostState(
            residuals=tuple(residuals),
            places=tuple(places),
            jacobians=tuple(jacobians),
            knees=tuple(knees),
            friction=tuple(friction),
        )

    def find_value(self, state: CostState) -> float:
        """Return f."""
        parts = zip(state.residuals, self.sigmas, strict=True)
        return sum(float(r @ r) / sigma**2 for r, sigma in parts) / (2.0 * self.rows)

    def find_gradient(self, state: CostState) -> FloatArray:
        """Return df/dx (x,)."""
        gradient = np.zeros(self.layout.size)
        for r, place, jacobian, sigma in self._walk(state):
            gradient[place] += jacobian.T @ r / sigma**2
        return gradient / self.rows

    def find_gauss_newton(self, state: CostState) -> FloatArray:
        """Return the Hessian (x, x) without second derivatives of the residuals."""
        hessian = np.zeros((self.layout.size,) * 2)
        for _, place, jacobian, sigma in self._walk(state):
            hessian[np.ix_(place, place)] += jacobian.T @ jacobian / sigma**2
        return hessian / self.rows

    def find_hessian(self, state: CostState, x: FloatArray) -> FloatArray:
        """Return the exact Hessian (x, x)."""
        hessian = self.find_gauss_newton(state)
        pending = list(zip(state.residuals, self.sigmas, strict=True))
        for part, knees, friction in zip(self.recordings, state.knees, state.friction, strict=True):
            pulls = np.zeros((len(knees), len(part.speed) - 1))
            drags = np.zeros_like(pulls)
            for block in part.blocks:
                residual, sigma = pending.pop(0)
                rows = -residual / (sigma**2 * self.rows)
                for spring in block.springs:
                    if self.layout.springs[spring.joint].knees:
                        pulls[spring.joint] += spring.sums.spread(block.sign * rows)
                for joint, sums in block.friction if friction else ():
                    drags[joint] += sums.spread(rows)
            for joint, steps in enumerate(knees):
                _add_knees(hessian, self.layout.springs[joint], steps, pulls[joint], x)
            for joint, rates in enumerate(friction):
                excess, speed = self.layout.excess.start + joint, self.layout.speed.start + joint
                cross = float(drags[joint] @ rates[:, 1])
                hessian[excess, speed] += cross
                hessian[speed, excess] += cross
                hessian[speed, speed] += x[excess] * float(drags[joint] @ rates[:, 2])
        return hessian

    def _walk(self, state: CostState) -> Iterator[tuple[FloatArray, Places, FloatArray, float]]:
        return zip(state.residuals, state.places, state.jacobians, self.sigmas, strict=True)

    def _find_knees(self, part: NlpRecording, x: FloatArray) -> tuple[KneeSteps, ...]:
        return tuple(
            find_knee_steps(
                basis, middle, x[spring.weights], tuple(zip(spring.knees, spring.slots, strict=True))
            )
            for spring, basis, middle in zip(self.layout.springs, part.bases, part.middles, strict=True)
        )

    def _find_friction(self, part: NlpRecording, x: FloatArray) -> tuple[FloatArray, ...]:
        """Return the step means (N - 1, 3) of g, g' and g'' of every joint with Stribeck friction."""
        means = []
        for joint, speed in enumerate(x[self.layout.speed]):
            rates = find_stribeck_rates(_NUMPY, part.speed[:, joint], speed, self.smoothing)
            columns = np.column_stack(rates)
            means.append((columns[1:] + columns[:-1]) / 2.0)
        return tuple(means)


class _Shared:
    """Rows of knees and friction of one recording, each added up once for all blocks that use them."""

    def __init__(
        self, layout: NlpLayout, x: FloatArray, knees: Sequence[KneeSteps], friction: Sequence[FloatArray]
    ) -> None:
        self.layout, self.x, self.knees, self.friction = layout, x, knees, friction
        self.known: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = {}
        self.steps: dict[int, tuple[FloatArray, FloatArray]] = {}

    def find_block(self, block: RowBlock) -> tuple[FloatArray, Places, FloatArray]:
        """Return residual, places and Jacobian of a block."""
        layout, x = self.layout, self.x
        residual = block.values - block.matrix @ x[layout.dynamics]
        alive = np.flatnonzero(np.any(block.matrix, axis=0))
        places, columns = [alive], [-block.matrix[:, alive]]
        for spring in block.springs:
            place = layout.springs[spring.joint]
            torque = spring.columns @ x[place.weights]
            slope = spring.columns
            if place.knees:
                means, bends = self._add_knees(spring.joint, spring.sums)
                torque = torque + means @ (place.changes @ x[place.slopes] + place.offset)
                slope = slope + bends
                places.append(np.arange(place.slopes.start, place.slopes.stop))
                columns.append(-block.sign * means @ place.changes)
            residual = residual - block.sign * torque
            places.append(np.arange(place.weights.start, place.weights.stop))
            columns.append(-block.sign * slope)
        for joint, sums in block.friction if self.friction else ():
            excess, speed = layout.excess.start + joint, layout.speed.start + joint
            rows = sums.add(self.friction[joint][:, :2])
            residual = residual - x[excess] * rows[:, 0]
            places.append(np.array([excess, speed]))
            columns.append(-rows * np.array([1.0, x[excess]]))
        return residual, np.concatenate(places), np.hstack(columns)

    def _add_knees(self, joint: int, sums: StepSums) -> tuple[FloatArray, FloatArray]:
        """Return rows (M, entries) of the dead zones and (M, m + 1) of their derivatives by the weights."""
        key = (joint, id(sums))
        if key not in self.known:
            if joint not in self.steps:
                place, steps = self.layout.springs[joint], self.knees[joint]
                changes = place.changes @ self.x[place.slopes] + place.offset
                self.steps[joint] = steps.find_means(), steps.find_slopes(changes)
            means, bends = self.steps[joint]
            self.known[key] = sums.add(means), sums.add(bends)
        return self.known[key]


def _add_knees(
    hessian: FloatArray, spring: SpringLayout, steps: KneeSteps, pull: FloatArray, x: FloatArray
) -> None:
    """Add what the knees of one joint bend to the Hessian, in place; `pull` (N - 1,) multiplies steps."""
    if not spring.knees:
        return
    cross = steps.find_cross(pull) @ spring.changes
    hessian[spring.weights, spring.slopes] += cross
    hessian[spring.slopes, spring.weights] += cross.T
    changes = spring.changes @ x[spring.slopes] + spring.offset
    hessian[spring.weights, spring.weights] += steps.find_curvature(pull, changes)
