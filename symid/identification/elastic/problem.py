"""All equations of an elastic identification, built once, and the springs of all joints given joint torques.

Library, signals, ElasticOptions -> ElasticProblem; filtered joint torques -> one spring a joint.

Supported: several recordings with sample periods of their own; thresholds and knees on grids, moved to
where the data put them, or given.
Not supported: recordings that lack an encoder; joints that share a spring.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen import Library
from symid.identification.elastic.estimate import HistoryEntry, MethodFit, MethodOutcome
from symid.identification.elastic.options import ElasticOptions
from symid.identification.elastic.regression import (
    ElasticSignals,
    EnergyWindows,
    FilteredRows,
    build_energy_windows,
    build_filtered_rows,
)
from symid.identification.elastic.spring_fit import (
    SpringData,
    build_knee_grid,
    compute_filtered_torque,
    fit_spring,
    fit_stops,
    prepare_spring_data,
    refine_spring,
)
from symid.identification.hysteresis import SpringWeights
from symid.robot import Elasticity


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticProblem:
    """The equations of all recordings.

    Args:
        library: functions and model card; options: how to identify.
        signals, energy, filtered: one entry a recording.
        thresholds: (m_i,) of every joint.
        springs: stop basis of every joint.
        supplied: (m,) J; design: (m, p + n + pf), the energy rows of all recordings.
        motor: (M, n, n + pf); link: (M, n, p); torque: (M, n), the filtered rows of all recordings.
    """

    library: Library
    options: ElasticOptions
    signals: tuple[ElasticSignals, ...]
    energy: tuple[EnergyWindows, ...]
    filtered: tuple[FilteredRows, ...]
    thresholds: tuple[FloatArray, ...]
    springs: tuple[SpringData, ...]
    supplied: FloatArray
    design: FloatArray
    motor: FloatArray
    link: FloatArray
    torque: FloatArray

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Return the numbers of base parameters, joints and friction parameters."""
        card = self.library.card
        return len(card.beta), card.size, len(card.friction)


def build_elastic_problem(
    library: Library, signals: Sequence[ElasticSignals], options: ElasticOptions
) -> ElasticProblem:
    """Return energy rows, filtered rows and stop bases.

    Raises:
        UsageError: thresholds are given for another number of joints; windows do not fit.
    """
    thresholds = _choose_thresholds(library, signals, options)
    energy = tuple(build_energy_windows(library, part, options.window) for part in signals)
    filtered = tuple(build_filtered_rows(library, part, options.rate) for part in signals)
    springs = tuple(
        prepare_spring_data(
            [part.phi[:, joint] for part in signals],
            [rows.keep for rows in filtered],
            grid,
            options.rate,
            [part.period for part in signals],
        )
        for joint, grid in enumerate(thresholds)
    )
    return ElasticProblem(
        library=library,
        options=options,
        signals=tuple(signals),
        energy=energy,
        filtered=filtered,
        thresholds=thresholds,
        springs=springs,
        supplied=freeze(np.concatenate([rows.supplied for rows in energy])),
        design=freeze(np.vstack([rows.design for rows in energy])),
        motor=freeze(np.concatenate([rows.motor for rows in filtered])),
        link=freeze(np.concatenate([rows.link for rows in filtered])),
        torque=freeze(np.concatenate([rows.torque for rows in filtered])),
    )


def build_method_fit(
    problem: ElasticProblem,
    method: str,
    chi: FloatArray,
    elasticity: tuple[Elasticity, ...] = (),
    *,
    history: tuple[HistoryEntry, ...] = (),
    outcome: MethodOutcome = MethodOutcome.SOLVED,
    covariance: FloatArray | None = None,
) -> MethodFit:
    """Return chi (p + n + pf,) and springs as the result of a method."""
    beta, joints, _ = problem.sizes
    return MethodFit(
        method=method,
        beta=chi[:beta],
        rotor=chi[beta : beta + joints],
        friction=chi[beta + joints :],
        elasticity=elasticity,
        history=history,
        outcome=outcome,
        covariance=covariance,
    )


def build_threshold_grid(largest: float, count: int) -> FloatArray:
    """Return r_i = i / (count + 1) largest, i = 1 .. count (Kuhnen 2003); largest torsion in rad or m."""
    grid: FloatArray = np.arange(1, count + 1) / (count + 1.0) * largest
    return grid


def _choose_thresholds(
    library: Library, signals: Sequence[ElasticSignals], options: ElasticOptions
) -> tuple[FloatArray, ...]:
    size = library.card.size
    if options.thresholds is not None:
        return tuple(freeze(grid) for grid in options.thresholds)
    largest = [max(float(np.abs(part.phi[:, joint]).max()) for part in signals) for joint in range(size)]
    return tuple(freeze(build_threshold_grid(value, options.stops)) for value in largest)


def fit_springs(problem: ElasticProblem, torque: FloatArray) -> tuple[SpringWeights, ...]:
    """Return the springs, one a joint, that explain F[tau_J] best: (M, n) in N m at the filtered rows."""
    return tuple(
        fit_joint_spring(problem.options, data, joint, torque[:, joint])
        for joint, data in enumerate(problem.springs)
    )


def fit_joint_spring(
    options: ElasticOptions, data: SpringData, joint: int, target: FloatArray
) -> SpringWeights:
    """Return the spring of one joint that explains F[tau_J] (M,) best."""
    weights = fit_spring(data, target, build_start_spring(options, data, joint, target))
    refine = options.refine and options.thresholds is None
    return refine_spring(data, target, weights) if refine else weights


def build_start_spring(
    options: ElasticOptions, data: SpringData, joint: int, target: FloatArray
) -> SpringWeights:
    """Return the best spring without knees, with the knees that are to be fitted next.

    Args:
        options: say which knees.
        data: stop basis of the joint.
        joint: its index.
        target: F[tau_J] of the joint (M,), N m.
    """
    weights = fit_stops(data, target)
    if options.knee_torques is not None:
        torques = np.array(options.knee_torques[joint], dtype=np.float64)
        below, above = torques[torques < 0][::-1], torques[torques > 0]
    elif options.knees:
        below, above = build_knee_grid(data, weights.stiffness, options.knees)
    else:
        return weights
    return replace(
        weights,
        below=below,
        above=above,
        below_slopes=np.ones(len(below)),
        above_slopes=np.ones(len(above)),
    )


def average_sides(problem: ElasticProblem, chi: FloatArray) -> FloatArray:
    """Return F[tau_J] (M, n), the mean of motor and link side, each weighted by the inverse of its variance.

    The variances are those about a spring on the grid, so that a side with more noise counts less.

    Args:
        problem: the filtered rows.
        chi: (p + n + pf,) dynamic parameters.
    """
    beta, joints, _ = problem.sizes
    motor = problem.torque - problem.motor @ chi[beta:]
    link = problem.link @ chi[:beta]
    joined = np.empty_like(motor)
    for joint in range(joints):
        data = problem.springs[joint]
        sides = [motor[:, joint], link[:, joint]]
        shared = fit_spring(
            data, (sides[0] + sides[1]) / 2.0, build_start_spring(problem.options, data, joint, sides[1])
        )
        value = compute_filtered_torque(data, shared)
        inverse = [1.0 / max(float(np.mean((side - value) ** 2)), 1e-300) for side in sides]
        joined[:, joint] = (inverse[0] * sides[0] + inverse[1] * sides[1]) / (inverse[0] + inverse[1])
    return joined
