"""All equations of an elastic identification, built once from the recordings.

Library, recordings, ElasticOptions -> ElasticProblem.

Supported: several recordings with sample periods of their own; thresholds of a grid over the torsion of all
recordings, or given ones.
Not supported: recordings that lack an encoder.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.library import Library
from symid.elastic.filtered import FilteredRows, build_filtered_rows
from symid.elastic.fit import ElasticFit, ElasticOutcome, HistoryEntry
from symid.elastic.options import ElasticOptions
from symid.elastic.signals import ElasticSignals
from symid.elastic.spring_fit import SpringData, prepare_spring_data
from symid.elastic.windows import EnergyRows, build_energy_rows
from symid.robot.elasticity import Elasticity

__all__ = ["ElasticProblem", "build_fit", "build_problem", "find_threshold_grid"]


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
    energy: tuple[EnergyRows, ...]
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


def build_problem(
    library: Library, signals: Sequence[ElasticSignals], options: ElasticOptions
) -> ElasticProblem:
    """Return energy rows, filtered rows and stop bases.

    Raises:
        UsageError: thresholds are given for another number of joints; windows do not fit.
    """
    thresholds = _find_thresholds(library, signals, options)
    energy = tuple(build_energy_rows(library, part, options.window) for part in signals)
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


def build_fit(
    problem: ElasticProblem,
    method: str,
    chi: FloatArray,
    elasticity: tuple[Elasticity, ...] = (),
    *,
    history: tuple[HistoryEntry, ...] = (),
    outcome: ElasticOutcome = ElasticOutcome.SOLVED,
    covariance: FloatArray | None = None,
) -> ElasticFit:
    """Return chi (p + n + pf,) and springs as the result of a method."""
    beta, joints, _ = problem.sizes
    return ElasticFit(
        method=method,
        beta=chi[:beta],
        rotor=chi[beta : beta + joints],
        friction=chi[beta + joints :],
        elasticity=elasticity,
        history=history,
        outcome=outcome,
        covariance=covariance,
    )


def find_threshold_grid(largest: float, count: int) -> FloatArray:
    """Return r_i = i / (count + 1) largest, i = 1 .. count (Kuhnen 2003); largest torsion in rad or m."""
    grid: FloatArray = np.arange(1, count + 1) / (count + 1.0) * largest
    return grid


def _find_thresholds(
    library: Library, signals: Sequence[ElasticSignals], options: ElasticOptions
) -> tuple[FloatArray, ...]:
    size = library.card.size
    if options.thresholds is not None:
        return tuple(freeze(grid) for grid in options.thresholds)
    largest = [max(float(np.abs(part.phi[:, joint]).max()) for part in signals) for joint in range(size)]
    return tuple(freeze(find_threshold_grid(value, options.stops)) for value in largest)
