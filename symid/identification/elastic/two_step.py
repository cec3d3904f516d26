"""The two-step method: hysteresis given the dynamics, dynamics given the hysteresis, until both rest.

ElasticProblem -> MethodFit.

    initialisation   y = Yd chi + sum_i k_i Delta(phi_i^2) / 2        linear springs, least squares
    H-step           spring_i <- min |F[tau_Ji](chi) - F[spring(phi_i)]|, torque of the motor equation
    X-step           chi <- min |y - W_e(springs) - Yd chi|, signs constrained
    same cost        min |y - Yd chi - Ae k|^2 in one shot, or over k and chi in turn; no bounds

The two steps minimise different costs, so that descent is not certain: a step whose merit rises by more
than `_RISE` is halved, and where the iteration does not converge the iterate of least merit is kept. With
the same cost it is block coordinate descent: the cost never rises, the limit is the joint solution, and
the error falls by rho = cos^2 of the smallest principal angle between the column spaces of Yd and Ae (von
Neumann).

Supported: springs with and without knees (same cost: without).
Not supported: proof of convergence with two costs; the outcome says how the iteration ended. Energy rows
identify stiffnesses badly in noise, so that the H-step fits them to torques.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.identification.elastic.estimate import HistoryEntry, MethodFit, MethodOutcome
from symid.identification.elastic.problem import ElasticProblem, build_method_fit, build_start_spring
from symid.identification.elastic.regression import (
    compute_window_columns,
    compute_window_work,
    solve_with_signs,
)
from symid.identification.elastic.spring_fit import (
    SpringData,
    compute_filtered_torque,
    fit_spring,
    follow_spring,
    rebuild_spring_data,
    refine_spring,
)
from symid.identification.hysteresis import SpringWeights, build_elasticity
from symid.robot import Elasticity, Stop

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


def init_two_step(problem: ElasticProblem) -> TwoStepState:
    """Return the start: dynamics with a linear spring in every joint."""
    return TwoStepState(chi=fit_linear_spring(problem).chi, data=problem.springs)


def fit_linear_spring(problem: ElasticProblem) -> MethodFit:
    """Return dynamics and linear springs that explain the energy rows best: the initialisation step."""
    _, joints, _ = problem.sizes
    work = compute_square_work(problem)
    solution = solve_with_signs(problem.library.card, np.hstack([problem.design, work]), problem.supplied)
    springs = tuple(Elasticity(stiffness=float(value)) for value in solution[-joints:])
    return build_method_fit(problem, "linear-spring", solution[:-joints], springs)


def compute_square_work(problem: ElasticProblem) -> FloatArray:
    """Return Delta(phi_i^2) / 2 of every window and joint (m, n): a linear spring's work per stiffness."""
    parts = [
        np.diff(part.phi[rows.ends] ** 2, axis=0) / 2.0
        for part, rows in zip(problem.signals, problem.energy, strict=True)
    ]
    return np.vstack(parts)


def step_two_step(problem: ElasticProblem, state: TwoStepState) -> TwoStepState:
    """Return the next iterate."""
    data, springs = _fit_springs(problem, state)
    work = _compute_work(problem, springs)
    goal = solve_with_signs(problem.library.card, problem.design, problem.supplied - work)
    fraction = 1.0
    for _ in range(_HALVINGS):
        chi = state.chi + fraction * (goal - state.chi)
        norms = _compute_norms(problem, chi, data, springs, work)
        scales = state.scales or tuple(max(norm, 1e-300) for norm in norms)
        merit = sum((norm / scale) ** 2 for norm, scale in zip(norms, scales, strict=True))
        if merit <= state.merit * (1.0 + _RISE):
            break
        fraction /= 2.0
    change = _compute_change(problem, chi - state.chi, chi)
    entry = HistoryEntry(merit=merit, change=change, damping=fraction, norms=norms)
    return TwoStepState(
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


def terminate_two_step(problem: ElasticProblem, state: TwoStepState) -> MethodOutcome | None:
    """Return how the iteration ended, None where it goes on."""
    options = problem.options
    if not np.all(np.isfinite(state.chi)):
        return MethodOutcome.DIVERGED
    if len(state.history) > 1:
        # What a residual moves by counts relative to what was measured, not to a residual near zero.
        sizes = [np.linalg.norm(problem.supplied), *np.linalg.norm(problem.torque, axis=0)]
        moved = np.abs(np.subtract(state.norms, state.history[-2].norms)) / np.maximum(sizes, 1e-300)
        if state.change <= options.tolerance and np.all(moved <= options.tolerance):
            return MethodOutcome.CONVERGED
    if len(state.history) >= options.iterations:
        return MethodOutcome.LIMIT
    return None


def fit_two_step(problem: ElasticProblem) -> MethodFit:
    """Return dynamics and hysteresis by the two-step method with two costs."""
    state = init_two_step(problem)
    best, outcome = state, None
    while outcome is None:
        state = step_two_step(problem, state)
        if state.merit < best.merit:
            best = state
        outcome = terminate_two_step(problem, state)
    if outcome is MethodOutcome.CONVERGED and state.merit <= best.merit * (1.0 + _RISE):
        best = state
    return build_method_fit(
        problem,
        "two-step",
        best.chi,
        build_elasticities(best.springs),
        history=state.history,
        outcome=outcome,
    )


def build_elasticities(springs: tuple[SpringWeights, ...]) -> tuple[Elasticity, ...]:
    """Return the springs as records, one a joint."""
    return tuple(map(build_elasticity, springs))


def _fit_springs(
    problem: ElasticProblem, state: TwoStepState
) -> tuple[tuple[SpringData, ...], tuple[SpringWeights, ...]]:
    """Return the H-step: the spring of every joint given chi, and the data for its thresholds."""
    beta, joints, _ = problem.sizes
    target = problem.torque - problem.motor @ state.chi[beta:]
    refine = problem.options.refine and problem.options.thresholds is None
    count = len(state.history)
    settled, springs = [], []
    for joint in range(joints):
        data, aim = state.data[joint], target[:, joint]
        start = (
            state.springs[joint] if state.springs else build_start_spring(problem.options, data, joint, aim)
        )
        if refine and count == _GRID_STEPS:
            start = refine_spring(data, aim, start)
        elif refine and count == _GRID_STEPS + 1:
            start = follow_spring(data, aim, start)
        data = rebuild_spring_data(data, start)
        settled.append(data)
        springs.append(fit_spring(data, aim, start))
    return tuple(settled), tuple(springs)


def _compute_work(problem: ElasticProblem, springs: tuple[SpringWeights, ...]) -> FloatArray:
    elasticity = build_elasticities(springs)
    parts = [
        compute_window_work(elasticity, part, rows)
        for part, rows in zip(problem.signals, problem.energy, strict=True)
    ]
    return np.concatenate(parts)


def _compute_norms(
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
        target[:, joint] - compute_filtered_torque(data[joint], weights)
        for joint, weights in enumerate(springs)
    ]
    return tuple(float(np.linalg.norm(part)) for part in (energy, *torques))


def _compute_change(problem: ElasticProblem, difference: FloatArray, chi: FloatArray) -> float:
    """Return the largest step relative to the size of each parameter.

    A parameter near zero is measured by what its column could explain at most.
    """
    lengths = np.maximum(np.linalg.norm(problem.design, axis=0), 1e-300)
    natural = 0.05 * float(np.linalg.norm(problem.supplied)) / lengths
    return float(np.max(np.abs(difference) / np.maximum(np.abs(chi), natural)))


_LONGEST = 500


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EnergyCost:
    """|supplied - design chi - work k|^2: (m,) J, (m, p + n + pf), (m, sum (m_i + 1))."""

    supplied: FloatArray
    design: FloatArray
    work: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("supplied", "design", "work"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def build_energy_cost(problem: ElasticProblem) -> EnergyCost:
    """Return the energy rows with the work of springs and stops per unit stiffness."""
    parts = [
        compute_window_columns(problem.thresholds, signals, rows)
        for signals, rows in zip(problem.signals, problem.energy, strict=True)
    ]
    return EnergyCost(supplied=problem.supplied, design=problem.design, work=np.vstack(parts))


def compute_convergence_rate(cost: EnergyCost) -> float:
    """Return the factor by which the error falls: the square of the largest singular value of Qd' Qe."""
    cosines = np.linalg.svd(_compute_base(cost.design).T @ _compute_base(cost.work), compute_uv=False)
    return float(min(cosines[0], 1.0) ** 2)


def fit_joint_energy(problem: ElasticProblem) -> MethodFit:
    """Return dynamics and stiffnesses that minimise the energy cost together."""
    cost = build_energy_cost(problem)
    solution = _solve_scaled(np.hstack([cost.design, cost.work]), cost.supplied)
    count = cost.design.shape[1]
    springs = _build_springs(problem, solution[count:])
    return build_method_fit(problem, "joint-energy", solution[:count], springs)


def fit_alternation(problem: ElasticProblem, *, iterations: int = _LONGEST) -> MethodFit:
    """Return the same by alternating between stiffnesses and dynamics, from no springs at all.

    The history's `change` is the relative step of chi, its `merit` the cost in J^2.
    """
    cost = build_energy_cost(problem)
    chi = _solve_scaled(cost.design, cost.supplied)
    stiffness = np.zeros(cost.work.shape[1])
    lengths = np.maximum(np.linalg.norm(cost.design, axis=0), 1e-300)
    history: list[HistoryEntry] = []
    outcome = MethodOutcome.LIMIT
    for _ in range(iterations):
        stiffness = _solve_scaled(cost.work, cost.supplied - cost.design @ chi)
        moved = _solve_scaled(cost.design, cost.supplied - cost.work @ stiffness)
        change = float(np.linalg.norm((moved - chi) * lengths) / np.linalg.norm(moved * lengths))
        chi = moved
        error = cost.supplied - cost.design @ chi - cost.work @ stiffness
        norm = float(np.linalg.norm(error))
        history.append(HistoryEntry(merit=norm**2, change=change, norms=(norm,)))
        if change <= problem.options.tolerance:
            outcome = MethodOutcome.CONVERGED
            break
    springs = _build_springs(problem, stiffness)
    return build_method_fit(problem, "same-cost", chi, springs, history=tuple(history), outcome=outcome)


def _compute_base(matrix: FloatArray) -> FloatArray:
    """Return orthonormal columns (m, r) that span those of `matrix`."""
    lengths = np.linalg.norm(matrix, axis=0)
    left, singular, _ = np.linalg.svd(matrix[:, lengths > 0] / lengths[lengths > 0], full_matrices=False)
    base: FloatArray = left[:, singular > 1e-9 * singular[0]]
    return base


def _solve_scaled(matrix: FloatArray, right: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(matrix, axis=0)
    scales = np.where(lengths > 0.0, lengths, 1.0)
    solution: FloatArray = np.linalg.lstsq(matrix / scales, right, rcond=1e-9)[0] / scales
    return solution


def _build_springs(problem: ElasticProblem, stiffness: FloatArray) -> tuple[Elasticity, ...]:
    springs, at = [], 0
    for grid in problem.thresholds:
        own = stiffness[at : at + len(grid) + 1]
        stops = tuple(
            Stop(threshold=float(radius), stiffness=float(value))
            for radius, value in zip(grid, own[1:], strict=True)
        )
        springs.append(Elasticity(stiffness=float(own[0]), stops=stops))
        at += len(own)
    return tuple(springs)
