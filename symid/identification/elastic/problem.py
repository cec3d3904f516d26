"""All equations of an elastic identification, built once, and the springs of all joints given joint torques.

Supported: several recordings with sample periods of their own; thresholds and knees on grids, moved to
where they fit best, or given.
Not supported: recordings that lack an encoder; joints that share a spring.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.codegen import Library
from symid.identification.elastic.effects import mark_sliding
from symid.identification.elastic.options import ElasticOptions
from symid.identification.elastic.regression import (
    ElasticSignals,
    EnergyWindows,
    FilteredRows,
    build_energy_windows,
    build_filtered_rows,
)
from symid.identification.hysteresis import (
    SpringData,
    SpringWeights,
    build_elasticity,
    build_knee_grid,
    fit_spring,
    refine_spring,
)
from symid.joint_models import Elasticity

_MEMORY = 3.0
"""Time constants of the filter."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticProblem:
    """The equations of all recordings.

    Args:
        signals, energy, filtered: one entry a recording.
        thresholds, springs: (m_i,) and stop basis of every joint.
        supplied: (m,) J; design: (m, p + n + pf), the energy rows of all recordings.
        limits: (n,) rad/s or m/s, at and below which motors are not trusted to slide; 0 for none.
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
    limits: FloatArray

    @property
    def sizes(self) -> tuple[int, int]:
        """Return the numbers of base parameters and joints."""
        return len(self.library.card.beta), self.library.card.size

    def stack_filtered(self, numbers: Sequence[int] | None = None) -> tuple[FloatArray, FloatArray]:
        """Return design (M, n, p + n + pf) and torque (M, n) of the given recordings, of all by default.

        They are the sum of motor and link equations, in which the joint torques cancel.
        """
        rows = self.filtered if numbers is None else [self.filtered[number] for number in numbers]
        torque = np.concatenate([part.torque - part.drag for part in rows])
        return np.concatenate([part.design for part in rows]), torque

    def compute_motor_side(self, chi: FloatArray) -> FloatArray:
        """Return F[tau_J] (M, n) by the motor equation with the dynamic parameters chi (p + n + pf,)."""
        return np.concatenate([part.compute_motor_side(chi) for part in self.filtered])

    @property
    def slides(self) -> NDArray[np.bool_]:
        """Return at which filtered rows (M, n) a motor slides, for as long as the filter remembers."""
        width = 2.0 * _MEMORY / self.options.rate
        pairs = zip(self.signals, self.filtered, strict=True)
        return np.concatenate([mark_sliding(part, width, self.limits)[rows.keep] for part, rows in pairs])

    def compute_work(self, springs: Sequence[Elasticity]) -> FloatArray:
        """Return the work of all springs in the windows of the energy rows (m,), J."""
        pairs = zip(self.signals, self.energy, strict=True)
        return np.concatenate([rows.compute_work(springs, part) for part, rows in pairs])

    def compute_stop_work(self, thresholds: Sequence[FloatArray]) -> FloatArray:
        """Return the work of springs and stops per unit stiffness in every window (m, sum (m_i + 1)), J."""
        pairs = zip(self.signals, self.energy, strict=True)
        return np.vstack([np.hstack(rows.compute_columns(thresholds, part)) for part, rows in pairs])

    def fit_springs(self, torque: FloatArray) -> tuple[Elasticity, ...]:
        """Return the springs, one a joint, that explain F[tau_J] best: (M, n) in N m at the filtered rows."""
        return tuple(
            build_elasticity(fit_joint_spring(self.options, data, joint, torque[:, joint]))
            for joint, data in enumerate(self.springs)
        )

    def average_sides(self, chi: FloatArray) -> FloatArray:
        """Return F[tau_J] (M, n), the mean of motor and link side, each weighted by 1 / its variance.

        The variances are those about a spring on the grid, so that a side with more noise counts less; chi
        (p + n + pf,) are the dynamic parameters.
        """
        motor = self.compute_motor_side(chi)
        link = np.concatenate([rows.compute_link_side(chi) for rows in self.filtered])
        joined = np.empty_like(motor)
        for joint, data in enumerate(self.springs):
            sides = [motor[:, joint], link[:, joint]]
            if self.limits[joint]:
                # What a motor near rest says holds friction that is not known.
                sides[0] = np.where(self.slides[:, joint], sides[0], sides[1])
            start = build_start_spring(self.options, data, joint, sides[1])
            value = data.compute_torque(fit_spring(data, (sides[0] + sides[1]) / 2.0, start))
            inverse = [1.0 / max(float(np.mean((side - value) ** 2)), 1e-300) for side in sides]
            joined[:, joint] = (inverse[0] * sides[0] + inverse[1] * sides[1]) / (inverse[0] + inverse[1])
        return joined


def build_elastic_problem(
    library: Library,
    signals: Sequence[ElasticSignals],
    options: ElasticOptions,
    limits: FloatArray | None = None,
) -> ElasticProblem:
    """Return energy rows, filtered rows and stop bases; raise UsageError where windows do not fit."""
    energy = tuple(build_energy_windows(library, part, options.window) for part in signals)
    filtered = tuple(build_filtered_rows(library, part, options.rate) for part in signals)
    springs = tuple(
        build_spring_data(options, joint, [part.phi[:, joint] for part in signals], signals, filtered)
        for joint in range(library.card.size)
    )
    return ElasticProblem(
        library=library,
        options=options,
        signals=tuple(signals),
        energy=energy,
        filtered=filtered,
        thresholds=tuple(data.thresholds for data in springs),
        springs=springs,
        supplied=freeze(np.concatenate([rows.supplied for rows in energy])),
        design=freeze(np.vstack([rows.design for rows in energy])),
        limits=freeze(np.zeros(library.card.size) if limits is None else limits),
    )


def build_spring_data(
    options: ElasticOptions,
    joint: int,
    torsions: Sequence[FloatArray],
    signals: Sequence[ElasticSignals],
    rows: Sequence[FilteredRows],
) -> SpringData:
    """Return the stop basis of a joint along its torsions (N,), one a recording, for the rows of each.

    Thresholds are those given, or r_i = i / (m + 1) max |phi|, i = 1 .. m (Kuhnen 2003).
    """
    if options.thresholds is not None:
        grid = freeze(options.thresholds[joint])
    else:
        largest = max(float(np.abs(phi).max()) for phi in torsions)
        grid = freeze(np.arange(1, options.stops + 1) / (options.stops + 1.0) * largest)
    periods, keeps = tuple(part.period for part in signals), tuple(part.keep for part in rows)
    return SpringData(torsions=tuple(torsions), periods=periods, keeps=keeps, rate=options.rate).rebuild(grid)


def fit_joint_spring(
    options: ElasticOptions, data: SpringData, joint: int, target: FloatArray
) -> SpringWeights:
    """Return the spring of one joint that explains F[tau_J] (M,) best."""
    weights = fit_spring(data, target, build_start_spring(options, data, joint, target))
    return refine_spring(data, target, weights) if options.moves_stops else weights


def build_start_spring(
    options: ElasticOptions, data: SpringData, joint: int, target: FloatArray
) -> SpringWeights:
    """Return the best spring without knees for F[tau_J] (M,), with the knees that are to be fitted next."""
    weights = data.fit_stops(target)
    if options.knee_torques is not None:
        torques = np.array(options.knee_torques[joint], dtype=np.float64)
        knees = np.concatenate([torques[torques < 0][::-1], torques[torques > 0]])
    else:
        knees = build_knee_grid([part @ weights.stiffness for part in data.basis], options.knees)
    return replace(weights, knees=knees, slopes=np.ones(len(knees)))
