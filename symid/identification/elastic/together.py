"""Dynamics and springs of one fit: in turns until convergence, or at once from a fit that has both.

Two steps, hysteresis given the dynamics, dynamics given the hysteresis:

    H-step           spring_i <- min |F[tau_Ji](chi) - F[spring(phi_i)]|, torque of the motor equation
    X-step           chi <- min |y - W_e(springs) - Yd chi|, signs constrained

A step whose merit rises by what matters is halved; without convergence the iterate of least merit is kept.

Simultaneous, for springs of any kind, by Gauss and Newton:

    motor   IA lambda (dtheta~ - F[dtheta~]) + F[Yf] f = F[tau] - F[tau_J(s)]      each over its scatter
    link    {lambda (Yp~ - F[Yp~]) - F[YL]} beta = F[tau_J(s)] - drag

The dynamics are linear and are eliminated: numbers s of springs minimise what is orthogonal to their columns
(variable projection, Golub and Pereyra 1973, in the form of Kaufman 1975), relative to where they begin. Both
equations together tell rotors from links as far as the springs can be trusted.

Supported: two steps for springs with and without knees; simultaneous: all numbers of springs that data
decide, zeros of encoders that are off by little, rigid joints beside elastic ones, known dynamics, motors
near rest, whose equations do not count.
Not supported: proof of convergence with two costs; the outcome says how the iteration ended. Energy rows
identify stiffnesses badly in noise, so that the H-step fits them to torques. Simultaneous: numbers of stops
and knees other than those at the start.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import RobotError
from symid.identification import hysteresis as elements
from symid.identification.elastic import estimate
from symid.identification.elastic.regression import ElasticProblem, solve_with_signs
from symid.identification.judge import POLICY, numerics
from symid.ipopt import Ending, keep_last
from symid.joint_models import Elasticity

TRIALS = 4
"""Of a step, ever shorter ones, or of springs whose sides are weighed, before the next round begins."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TwoStepState:
    """One iterate.

    Args:
        chi: (p + n + pf,) all dynamic parameters.
        data: stop basis of every joint, for the thresholds that its spring has now.
        springs: one a joint; empty before the first H-step.
        history: of all iterates so far.
    """

    chi: FloatArray
    data: tuple[elements.SpringData, ...]
    springs: tuple[elements.SpringWeights, ...] = ()
    history: tuple[estimate.HistoryEntry, ...] = ()

    @property
    def merit(self) -> float:
        """Return the sum of the squared norms over those of the first step, infinite before it."""
        return self.history[-1].merit if self.history else float("inf")


def fit_linear_spring(problem: ElasticProblem) -> estimate.MethodFit:
    """Return dynamics and linear springs that explain the energy rows best: the initialisation step."""
    joints = problem.sizes[1]
    design = np.hstack([problem.design, problem.compute_stop_work([np.zeros(0)] * joints)])
    solution = solve_with_signs(problem.library.card, design, problem.supplied, problem.known)
    springs = tuple(Elasticity(stiffness=float(value)) for value in solution[-joints:])
    return estimate.build_method_fit("linear-spring", solution[:-joints], problem.sizes, springs)


def step_two_step(problem: ElasticProblem, state: TwoStepState) -> TwoStepState:
    """Return the next iterate: the springs of all joints given chi, then chi given the springs."""
    # One iteration on the grid; the next one moves thresholds and knees to their places, one more corrects.
    count = len(state.history) if problem.options.moves_stops else 0
    rigid = elements.read_weights(Elasticity(stiffness=0.0))
    data, springs = list(state.data), list(state.springs) or [rigid] * problem.sizes[1]
    for joint, aim in enumerate(problem.compute_motor_side(state.chi).T):
        if not problem.gives[joint]:
            continue
        known, start = data[joint], springs[joint]
        if not state.springs:
            start = problem.start_spring(joint, known, aim)
        if count == 1:
            start = elements.refine_spring(known, aim, start)
        elif count == 2:
            start = elements.follow_spring(known, aim, start)
        data[joint] = known.rebuild(start.thresholds)
        springs[joint] = elements.fit_spring(data[joint], aim, start)
    work = problem.compute_work(list(map(elements.build_elasticity, springs)))
    goal = solve_with_signs(problem.library.card, problem.design, problem.supplied - work, problem.known)
    torques = np.column_stack([known.compute_torque(own) for known, own in zip(data, springs, strict=True)])
    fraction = 1.0
    for _ in range(TRIALS):
        chi = state.chi + fraction * (goal - state.chi)
        passed = np.where(problem.gives, torques, problem.compute_link_side(chi))
        energy = problem.supplied - work - problem.design @ chi
        errors = [energy, *(problem.compute_motor_side(chi) - passed).T]
        norms = tuple(float(np.linalg.norm(part)) for part in errors)
        first = state.history[0].norms if state.history else norms
        merit = sum((norm / max(one, numerics.TINY)) ** 2 for norm, one in zip(norms, first, strict=True))
        if merit <= state.merit * (1.0 + POLICY.relevance):
            break
        fraction /= 2.0
    # A parameter near zero is measured by what its column could explain at most.
    lengths = np.maximum(np.linalg.norm(problem.design, axis=0), numerics.TINY)
    sizes = np.maximum(np.abs(chi), POLICY.relevance * float(np.linalg.norm(problem.supplied)) / lengths)
    change = float(np.max(np.abs(chi - state.chi) / sizes))
    entry = estimate.HistoryEntry(merit=merit, change=change, damping=fraction, norms=norms)
    history = (*state.history, entry)
    return TwoStepState(chi=chi, data=tuple(data), springs=tuple(springs), history=history)


def fit_two_step(problem: ElasticProblem) -> estimate.MethodFit:
    """Return dynamics and hysteresis by the two-step method with two costs."""
    options, outcome = problem.options, None
    # What a residual moves by counts relative to what was measured, not to a residual near zero.
    torque = problem.stack_filtered()[1]
    sizes = np.maximum([np.linalg.norm(problem.supplied), *np.linalg.norm(torque, axis=0)], numerics.TINY)
    best = state = TwoStepState(chi=fit_linear_spring(problem).chi, data=problem.springs)
    while outcome is None:
        state = step_two_step(problem, state)
        if state.merit < best.merit:
            best = state
        if not np.all(np.isfinite(state.chi)):
            outcome = Ending.DIVERGED
        elif len(state.history) > 1:
            before, now = state.history[-2:]
            moved = np.abs(np.subtract(now.norms, before.norms)) / sizes
            if now.change <= options.tolerance and np.all(moved <= options.tolerance):
                outcome = Ending.CONVERGED
        if outcome is None and len(state.history) >= options.iterations:
            outcome = Ending.LIMIT
    if outcome is Ending.CONVERGED and state.merit <= best.merit * (1.0 + POLICY.relevance):
        best = state
    springs = tuple(map(elements.build_elasticity, best.springs))
    fit = estimate.build_method_fit("two-step", best.chi, problem.sizes, springs)
    return replace(fit, history=state.history, outcome=outcome)


class LinearRows(NamedTuple):
    """design @ chi = right, with the time of each row from 0 to 1 within its recording."""

    design: FloatArray
    right: FloatArray
    time: FloatArray


def list_row_times(problem: ElasticProblem, number: int) -> FloatArray:
    """Return the times (M,) of the filtered rows of recording `number`, from 0 to 1."""
    count = len(problem.signals[number].time)
    return np.arange(count)[problem.filtered[number].keep] / count


def filter_spring(problem: ElasticProblem, spring: Elasticity, joint: int) -> list[FloatArray]:
    """Return F[tau_J] (M,) of a spring at the filtered rows of every recording, N m or N."""
    pairs = zip(problem.signals, problem.filtered, strict=True)
    return [rows.pass_spring(spring, part, joint, problem.options.filter_rate) for part, rows in pairs]


def compute_spring_torques(problem: ElasticProblem, fit: estimate.MethodFit) -> list[FloatArray]:
    """Return F[tau_J] (M, n) at the filtered rows of every recording: of springs, by links if rigid."""
    joints = [filter_spring(problem, spring, joint) for joint, spring in enumerate(fit.elasticity)]
    return [
        np.where(problem.gives, np.column_stack(torques), rows.compute_link_side(fit.chi))
        for torques, rows in zip(zip(*joints, strict=True), problem.filtered, strict=True)
    ]


class _Sides(NamedTuple):
    """Both equations of one recording, motor before link: (M, 2, n, p + n + pf), (M, 2, n).

    `pulls` is what a spring's torque gives to the right sides, 0 where a row does not count.
    """

    design: FloatArray
    right: FloatArray
    pulls: FloatArray

    def free(self, values: FloatArray) -> FloatArray:
        """Return right sides (M, 2, n, ...) without what a constant torque of each spring may give them."""
        pulls = self.pulls.reshape(*self.pulls.shape, *[1] * (values.ndim - 3))
        squares = np.sum(pulls**2, axis=(0, 1))
        shares = np.sum(pulls * values, axis=(0, 1)) / np.where(squares > 0.0, squares, 1.0)
        return np.asarray(values - pulls * shares)


def _build_sides(problem: ElasticProblem, fit: estimate.MethodFit) -> list[_Sides]:
    """Return both equations, over their scatter; rows of rigid links and motors that stick are empty."""
    gives, sides = np.array(problem.gives), []
    ends = np.cumsum([len(rows.torque) for rows in problem.filtered])[:-1]
    torques, slides = compute_spring_torques(problem, fit), np.split(problem.slides, ends)
    for rows, spring, slide in zip(problem.filtered, torques, slides, strict=True):
        motor, link = rows.design.copy(), rows.design.copy()
        # The rows of a rigid joint's motor are those of both sides.
        motor[:, gives, : rows.bases], link[:, :, rows.bases :] = 0.0, 0.0
        kept = np.stack([slide, np.broadcast_to(gives, spring.shape)], axis=1)
        passed = np.where(gives, spring, rows.drag)
        right = np.where(kept, np.stack([rows.torque - passed, spring - rows.drag], axis=1), 0.0)
        design = np.where(kept[..., None], np.stack([motor, link], axis=1), 0.0)
        pulls = np.where(kept & gives, np.array([[-1.0], [1.0]]), 0.0)
        squares = np.sum((right - design @ fit.chi) ** 2, axis=0)
        floor = numerics.CONVERGED * max(float(np.sqrt(np.mean(rows.torque**2))), numerics.TINY)
        scatter = np.maximum(np.sqrt(squares / np.maximum(np.sum(kept, axis=0), 1)), floor)
        sides.append(_Sides(design / scatter[..., None], right / scatter, pulls / scatter))
    return sides


def build_side_rows(problem: ElasticProblem, fit: estimate.MethodFit, *, zeros: bool = False) -> LinearRows:
    """Return motor and link equations with the torques of the springs of `fit`, each over its scatter.

    `zeros`: whether those of the encoders may be off, so that springs have an offset in every recording.
    """
    sides, size = _build_sides(problem, fit), problem.sizes[1]
    times = [np.repeat(list_row_times(problem, number), 2 * size) for number in range(len(sides))]
    return LinearRows(*_stack(sides, zeros=zeros), np.concatenate(times))


def _stack(sides: Sequence[_Sides], *, zeros: bool) -> tuple[FloatArray, FloatArray]:
    """Return design (M, p + n + pf) and right sides (M,) of all recordings; `zeros` as above."""
    pairs = [map(entry.free, entry[:2]) if zeros else entry[:2] for entry in sides]
    design, right = map(np.concatenate, zip(*pairs, strict=True))
    return design.reshape(-1, design.shape[-1]), right.reshape(-1)


def calm_torsions(wide: ElasticProblem, narrow: ElasticProblem, fit: estimate.MethodFit) -> ElasticProblem:
    """Return the problem `wide` with the torsions of `narrow` where springs explain links better with these.

    Noise that turns a torsion back moves springs with memory and no sharp thresholds a little every time;
    a cut-off that takes it away bends fast motion. `fit` has the springs, `narrow` the same recordings.
    """

    def leave(problem: ElasticProblem) -> FloatArray:
        pairs = zip(compute_spring_torques(problem, fit), problem.filtered, strict=True)
        return np.array([np.std(torque - rows.compute_link_side(fit.chi), axis=0) for torque, rows in pairs])

    signals = []
    for part, other, better in zip(wide.signals, narrow.signals, leave(narrow) < leave(wide), strict=True):
        # A lower cut-off cuts more of the end.
        count = min(len(part.time), len(other.time))
        error = part.phi - (part.theta - part.q)
        error[:count] += np.where(better, other.phi[:count] - part.phi[:count], 0.0)
        signals.append(replace(part, error=error))
    return replace(wide, signals=tuple(signals))


def fit_simultaneous(
    wide: ElasticProblem, narrow: ElasticProblem, start: estimate.MethodFit
) -> estimate.MethodFit:
    """Return dynamics and springs that explain both equations best, and the covariance of the dynamics.

    `start` has springs of the kinds wanted, and dynamics near the answer; for problems see `calm_torsions`.
    """
    fit, problem = start, wide
    for _ in range(wide.options.iterations):
        problem = calm_torsions(wide, narrow, fit)
        # Less error for the scatter of both sides as it is about the fit.
        design, springs = _follow_springs(problem, fit)
        free = np.isnan(problem.known)
        given = design[:, ~free] @ problem.known[~free]
        # Residuals and their derivatives ask for the same springs in turn.
        pull_all = keep_last(springs.pull_all)

        def leave(
            factors: FloatArray,
            *,
            slopes: bool,
            own: _Springs = springs,
            pull_all: Callable[[FloatArray], tuple[FloatArray, ...]] = pull_all,
            design: FloatArray = design[:, free],
            given: FloatArray = given,
        ) -> FloatArray:
            # Residuals (M,) that the best dynamics leave, or their derivatives (M, k) by the factors.
            pulls = pull_all(factors)
            scales, ways = own.scale(pulls)
            base = np.linalg.qr(design / scales[:, None], mode="reduced")[0]
            right = (own.move(pulls) - given) / scales
            left = right - base @ (base.T @ right)
            if not slopes:
                return left
            change = own.differentiate(factors, pulls)
            for joint, way in enumerate(ways):
                rows = np.flatnonzero(own.links == joint)
                # A number moves the torque of its own joint alone.
                mine = [place == joint for place, *_ in own.numbers]
                change[rows] -= np.outer(left[rows] * scales[rows], np.where(mine, way @ change, 0.0))
            change /= scales[:, None]
            return np.asarray(change - base @ (base.T @ change))

        found = scipy.optimize.least_squares(
            partial(leave, slopes=False),
            np.ones(len(springs.numbers)),
            partial(leave, slopes=True),
            bounds=(0.0, np.inf),
            max_nfev=TRIALS,
            ftol=None,
            xtol=wide.options.tolerance,
        )
        pulls = springs.pull_all(found.x)
        scales = springs.scale(pulls)[0]
        rows, right = design / scales[:, None], springs.move(pulls) / scales
        chi = solve_with_signs(problem.library.card, rows, right, problem.known)
        fit = estimate.build_method_fit(fit.method, chi, problem.sizes, springs.build(found.x))
        if float(np.max(np.abs(found.x - 1.0), initial=0.0)) < wide.options.tolerance:
            break
    # The covariance of the dynamics, whatever the springs are.
    design, springs = _follow_springs(problem, fit)
    ones = np.ones(len(springs.numbers))
    pulls = springs.pull_all(ones)
    whole = np.hstack([design, -springs.differentiate(ones, pulls)])
    known = np.concatenate([problem.known, np.full(len(springs.numbers), np.nan)])
    dynamics = slice(len(fit.chi))
    errors = springs.move(pulls) - design @ fit.chi
    covariance = estimate.compute_covariance(whole, errors, known)[dynamics, dynamics]
    found = estimate.build_method_fit("simultaneous", fit.chi, wide.sizes, fit.elasticity)
    return replace(found, covariance=covariance, notices=start.notices)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Springs:
    """Right sides of all equations as the springs of `start` change by factors (k,) of their numbers.

    `numbers` are the joint of each, its place and what it begins with; `rest` (M,) the sides without springs;
    `links` (M,) whose link a row belongs to, -1 of motors; `squares` (n,) of the torques at the start.
    """

    problem: ElasticProblem
    start: tuple[Elasticity, ...]
    sides: Sequence[_Sides]
    numbers: Sequence[tuple[int, elements.SpringPlace, float]]
    rest: FloatArray
    links: NDArray[np.intp]
    squares: tuple[float, ...] = ()

    def build(self, factors: FloatArray) -> tuple[Elasticity, ...]:
        springs = list(self.start)
        for (joint, place, value), factor in zip(self.numbers, factors.tolist(), strict=True):
            # At the edge of what springs can be, a number stays.
            with suppress(RobotError):
                springs[joint] = elements.move_spring(springs[joint], place, value * factor)
        return tuple(springs)

    def pull(self, joint: int, spring: Elasticity) -> FloatArray:
        """Return what the spring of a joint gives to the right sides (M,)."""
        parts = []
        for side, torque in zip(self.sides, filter_spring(self.problem, spring, joint), strict=True):
            own = np.zeros_like(side.right)
            own[:, :, joint] = side.pulls[:, :, joint] * torque[:, None]
            parts.append(side.free(own).reshape(-1))
        return np.concatenate(parts)

    def pull_all(self, factors: FloatArray) -> tuple[FloatArray, ...]:
        """Return what the spring of each joint gives to the right sides (M,)."""
        return tuple(self.pull(*pair) for pair in enumerate(self.build(factors)))

    def scale(self, pulls: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the sizes (M,) of the springs' torque in the rows of links over those at the start, else 1.

        With the torques (n, M) there over their squares, which make of derivatives those of the sizes. Unless
        links count relative to them, springs and links without any torque fit best.
        """
        scales, ways = np.ones(len(self.rest)), np.zeros((len(self.start), len(self.rest)))
        for joint, pull in enumerate(pulls):
            rows = np.flatnonzero(self.links == joint)
            square, start = float(pull @ pull), self.squares[joint]
            if square > 0.0 and start > 0.0:
                scales[rows] = math.sqrt(square / start)
                ways[joint] = pull / square
        return scales, ways

    def move(self, pulls: Sequence[FloatArray]) -> FloatArray:
        """Return the right sides (M,)."""
        return sum(pulls, self.rest)

    def differentiate(self, factors: FloatArray, before: Sequence[FloatArray]) -> FloatArray:
        """Return their derivatives (M, k) by the factors, where springs give what is `before`."""
        springs, columns = self.build(factors), []
        for (joint, place, value), factor in zip(self.numbers, factors.tolist(), strict=True):
            column = np.zeros_like(self.rest)
            with suppress(RobotError):
                ahead = elements.move_spring(springs[joint], place, value * (factor + elements.STEP))
                column = (self.pull(joint, ahead) - before[joint]) / elements.STEP
            columns.append(column)
        return np.column_stack(columns)


def _follow_springs(problem: ElasticProblem, fit: estimate.MethodFit) -> tuple[FloatArray, _Springs]:
    """Return the design (M, p + n + pf) of both equations, and how springs move their right sides."""
    sides = _build_sides(problem, fit)
    design, right = _stack(sides, zeros=True)
    numbers = [
        (joint, place, value)
        for joint, spring in enumerate(fit.elasticity)
        if problem.gives[joint]
        for value, place in elements.list_spring_numbers(spring)
    ]
    joints = np.arange(problem.sizes[1])
    links = np.concatenate([np.where(side.pulls > 0.0, joints, -1).reshape(-1) for side in sides])
    springs = _Springs(
        problem=problem, start=fit.elasticity, sides=sides, numbers=numbers, rest=right, links=links
    )
    pulls = springs.pull_all(np.ones(len(numbers)))
    squares = tuple(float(np.sum(pull**2)) for pull in pulls)
    return design, replace(springs, rest=right - sum(pulls), squares=squares)
