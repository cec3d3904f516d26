"""The two-step method: hysteresis given the dynamics, dynamics given the hysteresis, until both rest.

ElasticProblem -> ElasticFit, by `init`, `step`, `terminate`.

    initialisation   y = Yd chi + sum_i k_i Delta(phi_i^2) / 2        linear springs, least squares
    H-step           spring_i <- min |F[tau_Ji](chi) - F[spring(phi_i)]|, torque of the motor equation
    X-step           chi <- min |y - W_e(springs) - Yd chi|, signs constrained

The two steps minimise different costs, so that descent is not certain: a step whose merit rises by more than
`_RISE` is halved, and where the iteration does not converge the iterate of least merit is kept.

Supported: springs with and without knees.
Not supported: proof of convergence; the outcome says how the iteration ended.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.consistency import solve_consistent
from symid.elastic.fit import ElasticFit, ElasticOutcome, HistoryEntry
from symid.elastic.hysteresis import start_spring
from symid.elastic.problem import ElasticProblem, build_fit
from symid.elastic.refinement import follow_spring, refine_spring
from symid.elastic.spring_fit import (
    SpringData,
    find_filtered_torque,
    fit_spring,
    settle_spring_data,
)
from symid.elastic.spring_weights import SpringWeights, build_elasticity
from symid.elastic.windows import find_window_work
from symid.robot.elasticity import Elasticity

__all__ = [
    "State",
    "find_elasticity",
    "find_square_work",
    "fit_linear_spring",
    "fit_two_step",
    "init",
    "step",
    "terminate",
]

_RISE = 0.01
_HALVINGS = 4
_GRID_STEPS = 1
"""Iterations on the grid; the next one moves thresholds and knees to their places, one more corrects them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """One iterate.

    Args:
        chi: (p + n + pf,) all dynamic parameters.
        data: stop basis of every joint, for the thresholds that its spring has now.
        springs: one a joint; empty before the first H-step.
        scales: residual sizes that the merit is made of, empty before the first step.
        norms: residual norms, of the energy rows in J, then of the torque rows joint by joint.
        merit: sum of squared norms over squared scales; change: relative step of chi; damping: its factor.
        history: of all iterates so far.
    """

    chi: FloatArray
    data: tuple[SpringData, ...]
    springs: tuple[SpringWeights, ...] = ()
    scales: tuple[float, ...] = ()
    norms: tuple[float, ...] = ()
    merit: float = float("inf")
    change: float = float("inf")
    damping: float = 1.0
    history: tuple[HistoryEntry, ...] = ()


def init(problem: ElasticProblem) -> State:
    """Return the start: dynamics with a linear spring in every joint."""
    return State(chi=fit_linear_spring(problem).chi, data=problem.springs)


def fit_linear_spring(problem: ElasticProblem) -> ElasticFit:
    """Return dynamics and linear springs that explain the energy rows best: the initialisation step."""
    _, joints, _ = problem.sizes
    work = find_square_work(problem)
    solution = solve_consistent(problem.library.card, np.hstack([problem.design, work]), problem.supplied)
    springs = tuple(Elasticity(stiffness=float(value)) for value in solution[-joints:])
    return build_fit(problem, "linear-spring", solution[:-joints], springs)


def find_square_work(problem: ElasticProblem) -> FloatArray:
    """Return Delta(phi_i^2) / 2 of every window and joint (m, n): a linear spring's work per stiffness."""
    parts = [
        np.diff(part.phi[rows.ends] ** 2, axis=0) / 2.0
        for part, rows in zip(problem.signals, problem.energy, strict=True)
    ]
    return np.vstack(parts)


def step(problem: ElasticProblem, state: State) -> State:
    """Return the next iterate."""
    data, springs = _fit_springs(problem, state)
    work = _find_work(problem, springs)
    goal = solve_consistent(problem.library.card, problem.design, problem.supplied - work)
    fraction = 1.0
    for _ in range(_HALVINGS):
        chi = state.chi + fraction * (goal - state.chi)
        norms = _find_norms(problem, chi, data, springs, work)
        scales = state.scales or tuple(max(norm, 1e-300) for norm in norms)
        merit = sum((norm / scale) ** 2 for norm, scale in zip(norms, scales, strict=True))
        if merit <= state.merit * (1.0 + _RISE):
            break
        fraction /= 2.0
    change = _find_change(problem, chi - state.chi, chi)
    entry = HistoryEntry(merit=merit, change=change, damping=fraction, norms=norms)
    return State(
        chi=chi,
        data=data,
        springs=springs,
        scales=scales,
        norms=norms,
        merit=merit,
        change=change,
        damping=fraction,
        history=(*state.history, entry),
    )


def terminate(problem: ElasticProblem, state: State) -> ElasticOutcome | None:
    """Return how the iteration ended, None where it goes on."""
    options = problem.options
    if not np.all(np.isfinite(state.chi)):
        return ElasticOutcome.DIVERGED
    if len(state.history) > 1:
        # What a residual moves by counts relative to what was measured, not to a residual near zero.
        sizes = [np.linalg.norm(problem.supplied), *np.linalg.norm(problem.torque, axis=0)]
        moved = np.abs(np.subtract(state.norms, state.history[-2].norms)) / np.maximum(sizes, 1e-300)
        if state.change <= options.tolerance and np.all(moved <= options.tolerance):
            return ElasticOutcome.CONVERGED
    if len(state.history) >= options.iterations:
        return ElasticOutcome.LIMIT
    return None


def fit_two_step(problem: ElasticProblem) -> ElasticFit:
    """Return dynamics and hysteresis by the two-step method with two costs."""
    state = init(problem)
    best, outcome = state, None
    while outcome is None:
        state = step(problem, state)
        if state.merit < best.merit:
            best = state
        outcome = terminate(problem, state)
    if outcome is ElasticOutcome.CONVERGED and state.merit <= best.merit * (1.0 + _RISE):
        best = state
    return build_fit(
        problem, "two-step", best.chi, find_elasticity(best.springs), history=state.history, outcome=outcome
    )


def find_elasticity(springs: tuple[SpringWeights, ...]) -> tuple[Elasticity, ...]:
    """Return the springs as records, one a joint."""
    return tuple(map(build_elasticity, springs))


def _fit_springs(
    problem: ElasticProblem, state: State
) -> tuple[tuple[SpringData, ...], tuple[SpringWeights, ...]]:
    """Return the H-step: the spring of every joint given chi, and the data for its thresholds."""
    beta, joints, _ = problem.sizes
    target = problem.torque - problem.motor @ state.chi[beta:]
    refine = problem.options.refine and problem.options.thresholds is None
    count = len(state.history)
    settled, springs = [], []
    for joint in range(joints):
        data, aim = state.data[joint], target[:, joint]
        start = state.springs[joint] if state.springs else start_spring(problem.options, data, joint, aim)
        if refine and count == _GRID_STEPS:
            start = refine_spring(data, aim, start)
        elif refine and count == _GRID_STEPS + 1:
            start = follow_spring(data, aim, start)
        data = settle_spring_data(data, start)
        settled.append(data)
        springs.append(fit_spring(data, aim, start))
    return tuple(settled), tuple(springs)


def _find_work(problem: ElasticProblem, springs: tuple[SpringWeights, ...]) -> FloatArray:
    elasticity = find_elasticity(springs)
    parts = [
        find_window_work(elasticity, part, rows)
        for part, rows in zip(problem.signals, problem.energy, strict=True)
    ]
    return np.concatenate(parts)


def _find_norms(
    problem: ElasticProblem,
    chi: FloatArray,
    data: tuple[SpringData, ...],
    springs: tuple[SpringWeights, ...],
    work: FloatArray,
) -> tuple[float, ...]:
    beta, _, _ = problem.sizes
    energy = problem.supplied - work - problem.design @ chi
    target = problem.torque - problem.motor @ chi[beta:]
    torques = [
        target[:, joint] - find_filtered_torque(data[joint], weights) for joint, weights in enumerate(springs)
    ]
    return tuple(float(np.linalg.norm(part)) for part in (energy, *torques))


def _find_change(problem: ElasticProblem, difference: FloatArray, chi: FloatArray) -> float:
    """Return the largest step relative to the size of each parameter.

    A parameter near zero is measured by what its column could explain at most.
    """
    lengths = np.maximum(np.linalg.norm(problem.design, axis=0), 1e-300)
    natural = 0.05 * float(np.linalg.norm(problem.supplied)) / lengths
    return float(np.max(np.abs(difference) / np.maximum(np.abs(chi), natural)))
