"""All equations of an elastic identification, built once, and the springs of all joints given joint torques.

Supported: several recordings with sample periods of their own; thresholds and knees on grids, moved to
where the data put them, or given.
Not supported: recordings that lack an encoder; joints that share a spring.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen import Library
from symid.errors import Notice
from symid.identification.elastic.estimate import HistoryEntry, MethodFit
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
    compute_filtered_torque,
    fit_spring,
    fit_stops,
    prepare_spring_data,
    refine_spring,
)
from symid.identification.hysteresis import SpringWeights, build_elasticity, build_knee_grid
from symid.ipopt import Ending
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

    def find_motor_side(self, chi: FloatArray) -> FloatArray:
        """Return F[tau_J] (M, n) by the motor equation with the dynamic parameters chi (p + n + pf,)."""
        side: FloatArray = self.torque - self.motor @ chi[self.sizes[0] :]
        return side


def build_elastic_problem(
    library: Library, signals: Sequence[ElasticSignals], options: ElasticOptions
) -> ElasticProblem:
    """Return energy rows, filtered rows and stop bases.

    Raises:
        UsageError: windows do not fit.
    """
    grids = options.thresholds or [
        build_threshold_grid(max(float(np.abs(part.phi[:, joint]).max()) for part in signals), options.stops)
        for joint in range(library.card.size)
    ]
    thresholds = tuple(map(freeze, grids))
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
    outcome: Ending = Ending.SOLVED,
    covariance: FloatArray | None = None,
    notices: tuple[Notice, ...] = (),
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
        notices=notices,
    )


def build_threshold_grid(largest: float, count: int) -> FloatArray:
    """Return r_i = i / (count + 1) largest, i = 1 .. count (Kuhnen 2003); largest torsion in rad or m."""
    grid: FloatArray = np.arange(1, count + 1) / (count + 1.0) * largest
    return grid


def fit_springs(problem: ElasticProblem, torque: FloatArray) -> tuple[Elasticity, ...]:
    """Return the springs, one a joint, that explain F[tau_J] best: (M, n) in N m at the filtered rows."""
    return tuple(
        build_elasticity(fit_joint_spring(problem.options, data, joint, torque[:, joint]))
        for joint, data in enumerate(problem.springs)
    )


def fit_joint_spring(
    options: ElasticOptions, data: SpringData, joint: int, target: FloatArray
) -> SpringWeights:
    """Return the spring of one joint that explains F[tau_J] (M,) best."""
    weights = fit_spring(data, target, build_start_spring(options, data, joint, target))
    return refine_spring(data, target, weights) if options.moves_stops else weights


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
        knees = np.concatenate([torques[torques < 0][::-1], torques[torques > 0]])
    else:
        knees = build_knee_grid([part @ weights.stiffness for part in data.basis], options.knees)
    return replace(weights, knees=knees, slopes=np.ones(len(knees)))


def average_sides(problem: ElasticProblem, chi: FloatArray) -> FloatArray:
    """Return F[tau_J] (M, n), the mean of motor and link side, each weighted by the inverse of its variance.

    The variances are those about a spring on the grid, so that a side with more noise counts less.

    Args:
        problem: the filtered rows.
        chi: (p + n + pf,) dynamic parameters.
    """
    motor, link = problem.find_motor_side(chi), problem.link @ chi[: problem.sizes[0]]
    joined = np.empty_like(motor)
    for joint, data in enumerate(problem.springs):
        sides = [motor[:, joint], link[:, joint]]
        shared = fit_spring(
            data, (sides[0] + sides[1]) / 2.0, build_start_spring(problem.options, data, joint, sides[1])
        )
        value = compute_filtered_torque(data, shared)
        inverse = [1.0 / max(float(np.mean((side - value) ** 2)), 1e-300) for side in sides]
        joined[:, joint] = (inverse[0] * sides[0] + inverse[1] * sides[1]) / (inverse[0] + inverse[1])
    return joined
