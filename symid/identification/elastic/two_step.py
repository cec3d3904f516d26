"""The two-step method: hysteresis given the dynamics, dynamics given the hysteresis, until convergence.

    initialisation   y = Yd chi + sum_i k_i Delta(phi_i^2) / 2        linear springs, least squares
    H-step           spring_i <- min |F[tau_Ji](chi) - F[spring(phi_i)]|, torque of the motor equation
    X-step           chi <- min |y - W_e(springs) - Yd chi|, signs constrained
    same cost        min |y - Yd chi - Ae k|^2 over k and chi in turn; no bounds

A step whose merit rises by more than `_RISE` is halved; without convergence the iterate of least merit is
kept. With the same cost it is block coordinate descent, whose error falls by cos^2 of the smallest principal
angle between the column spaces of Yd and Ae (von Neumann).

Supported: springs with and without knees (same cost: without).
Not supported: proof of convergence with two costs; the outcome says how the iteration ended. Energy rows
identify stiffnesses badly in noise, so that the H-step fits them to torques.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.identification.elastic.estimate import HistoryEntry, MethodFit, build_method_fit
from symid.identification.elastic.regression import ElasticProblem, build_start_spring, solve_with_signs
from symid.identification.hysteresis import (
    SpringData,
    SpringWeights,
    build_elasticity,
    build_stops,
    fit_spring,
    follow_spring,
    refine_spring,
)
from symid.identification.regression import solve_scaled
from symid.ipopt import Ending
from symid.joint_models import Elasticity

_RISE = 0.01
_HALVINGS = 4
_GRID_STEPS = 1
"""Iterations on the grid; the next one moves thresholds and knees to their places, one more corrects them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TwoStepState:
    """One iterate.

    Args:
        chi: (p + n + pf,) all dynamic parameters.
        data: stop basis of every joint, for the thresholds that its spring has now.
        springs: one a joint; empty before the first H-step.
        scales: residual sizes that the merit is made of, empty before the first step.
        history: of all iterates so far: sum of squared norms over squared scales, relative step of chi.
    """

    chi: FloatArray
    data: tuple[SpringData, ...]
    springs: tuple[SpringWeights, ...] = ()
    scales: tuple[float, ...] = ()
    history: tuple[HistoryEntry, ...] = ()

    @property
    def merit(self) -> float:
        """Return the merit of this iterate, infinite before the first step."""
        return self.history[-1].merit if self.history else float("inf")


_NO_SPRING = SpringWeights(
    thresholds=np.zeros(0), stiffness=np.zeros(1), knees=np.zeros(0), slopes=np.zeros(0)
)
"""Of a rigid joint."""


def init_two_step(problem: ElasticProblem) -> TwoStepState:
    """Return the start: dynamics with a linear spring in every joint."""
    return TwoStepState(chi=fit_linear_spring(problem).chi, data=problem.springs)


def fit_linear_spring(problem: ElasticProblem) -> MethodFit:
    """Return dynamics and linear springs that explain the energy rows best: the initialisation step."""
    joints = problem.sizes[1]
    design = np.hstack([problem.design, problem.compute_stop_work([np.zeros(0)] * joints)])
    solution = solve_with_signs(problem.library.card, design, problem.supplied, problem.known)
    springs = tuple(Elasticity(stiffness=float(value)) for value in solution[-joints:])
    return build_method_fit("linear-spring", solution[:-joints], problem.sizes, springs)


def step_two_step(problem: ElasticProblem, state: TwoStepState) -> TwoStepState:
    """Return the next iterate: the springs of all joints given chi, then chi given the springs."""
    count = len(state.history) if problem.options.moves_stops else -1
    data: list[SpringData] = []
    springs: list[SpringWeights] = []
    for joint, (known, aim) in enumerate(
        zip(state.data, problem.compute_motor_side(state.chi).T, strict=True)
    ):
        if not problem.gives[joint]:
            data.append(known)
            springs.append(_NO_SPRING)
            continue
        first = not state.springs
        start = build_start_spring(problem.options, known, joint, aim) if first else state.springs[joint]
        if count == _GRID_STEPS:
            start = refine_spring(known, aim, start)
        elif count == _GRID_STEPS + 1:
            start = follow_spring(known, aim, start)
        data.append(known.rebuild(start.thresholds))
        springs.append(fit_spring(data[-1], aim, start))
    work = problem.compute_work(list(map(build_elasticity, springs)))
    goal = solve_with_signs(problem.library.card, problem.design, problem.supplied - work, problem.known)
    spring_torques = [known.compute_torque(spring) for known, spring in zip(data, springs, strict=True)]
    rigid = [joint for joint, gives in enumerate(problem.gives) if not gives]
    fraction = 1.0
    for _ in range(_HALVINGS):
        chi = state.chi + fraction * (goal - state.chi)
        motor_side = problem.compute_motor_side(chi).T
        for joint in rigid:
            spring_torques[joint] = problem.compute_link_side(chi)[:, joint]
        errors = [
            problem.supplied - work - problem.design @ chi,
            *(aim - torque for aim, torque in zip(motor_side, spring_torques, strict=True)),
        ]
        norms = tuple(float(np.linalg.norm(part)) for part in errors)
        scales = state.scales or tuple(max(norm, 1e-300) for norm in norms)
        merit = sum((norm / scale) ** 2 for norm, scale in zip(norms, scales, strict=True))
        if merit <= state.merit * (1.0 + _RISE):
            break
        fraction /= 2.0
    # A parameter near zero is measured by what its column could explain at most.
    lengths = np.maximum(np.linalg.norm(problem.design, axis=0), 1e-300)
    sizes = np.maximum(np.abs(chi), 0.05 * float(np.linalg.norm(problem.supplied)) / lengths)
    change = float(np.max(np.abs(chi - state.chi) / sizes))
    entry = HistoryEntry(merit=merit, change=change, damping=fraction, norms=norms)
    history = (*state.history, entry)
    return TwoStepState(chi=chi, data=tuple(data), springs=tuple(springs), scales=scales, history=history)


def terminate_two_step(problem: ElasticProblem, state: TwoStepState) -> Ending | None:
    """Return how the iteration ended, None where it goes on."""
    options = problem.options
    if not np.all(np.isfinite(state.chi)):
        return Ending.DIVERGED
    if len(state.history) > 1:
        # What a residual moves by counts relative to what was measured, not to a residual near zero.
        torque = problem.stack_filtered()[1]
        sizes = [np.linalg.norm(problem.supplied), *np.linalg.norm(torque, axis=0)]
        before, now = state.history[-2:]
        moved = np.abs(np.subtract(now.norms, before.norms)) / np.maximum(sizes, 1e-300)
        if now.change <= options.tolerance and np.all(moved <= options.tolerance):
            return Ending.CONVERGED
    return Ending.LIMIT if len(state.history) >= options.iterations else None


def fit_two_step(problem: ElasticProblem) -> MethodFit:
    """Return dynamics and hysteresis by the two-step method with two costs."""
    state = init_two_step(problem)
    best, outcome = state, None
    while outcome is None:
        state = step_two_step(problem, state)
        if state.merit < best.merit:
            best = state
        outcome = terminate_two_step(problem, state)
    if outcome is Ending.CONVERGED and state.merit <= best.merit * (1.0 + _RISE):
        best = state
    springs = tuple(map(build_elasticity, best.springs))
    fit = build_method_fit("two-step", best.chi, problem.sizes, springs)
    return replace(fit, history=state.history, outcome=outcome)


_LONGEST = 500
_RANK = 1e-9


def fit_alternation(problem: ElasticProblem, *, iterations: int = _LONGEST) -> MethodFit:
    """Return what minimises the energy cost by turns over stiffnesses and dynamics, from no springs at all.

    The history's `change` is the relative step of chi, its `merit` the cost in J^2.
    """
    free, values = np.isnan(problem.known), np.nan_to_num(problem.known)
    design, supplied = problem.design[:, free], problem.supplied - problem.design @ values
    columns = problem.compute_stop_work(problem.thresholds)
    chi = solve_scaled(design, supplied, rcond=_RANK)
    stiffness = np.zeros(columns.shape[1])
    lengths = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    history: list[HistoryEntry] = []
    outcome = Ending.LIMIT
    for _ in range(iterations):
        stiffness = solve_scaled(columns, supplied - design @ chi, rcond=_RANK)
        moved = solve_scaled(design, supplied - columns @ stiffness, rcond=_RANK)
        size = max(float(np.linalg.norm(moved * lengths)), 1e-300)
        change = float(np.linalg.norm((moved - chi) * lengths)) / size
        chi = moved
        norm = float(np.linalg.norm(supplied - design @ chi - columns @ stiffness))
        history.append(HistoryEntry(merit=norm**2, change=change, norms=(norm,)))
        if change <= problem.options.tolerance:
            outcome = Ending.CONVERGED
            break
    ends = np.cumsum([len(grid) + 1 for grid in problem.thresholds])[:-1]
    springs = tuple(
        Elasticity(stiffness=float(own[0]), stops=build_stops(grid, own[1:], -1.0))
        for grid, own in zip(problem.thresholds, np.split(stiffness, ends), strict=True)
    )
    values[free] = chi
    fit = build_method_fit("same-cost", values, problem.sizes, springs)
    return replace(fit, history=tuple(history), outcome=outcome)
