"""Energy rows: what the motors put in over a window, less what the springs took, is what the rest got.

ElasticSignals, Library -> EnergyRows.

    sum_i int tau_i dtheta_i - sum_i int tau_Ji dphi_i
        = Delta h_link beta + sum_i IA_i Delta(dtheta_i^2) / 2 + int dtheta' Yf f dt

The motor equation times dtheta plus the link equation times dq, over a window: no acceleration is left.

Supported: torques held between samples, whose work is exact, and sampled smooth ones.
Not supported: friction on the link side.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.library import Library
from symid.elastic.signals import ElasticSignals
from symid.errors import Notice, UsageError
from symid.joint.plays import find_spring_work, find_work_columns
from symid.robot.elasticity import Elasticity

__all__ = ["EnergyRows", "build_energy_rows", "find_window_columns", "find_window_work"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EnergyRows:
    """Energy equations of one recording, one a window.

    Args:
        supplied: (m,) J, the work of the motors.
        design: (m, p + n + pf), columns [beta | rotor | friction].
        ends: (m + 1,) samples of the signals at which windows begin and end.
    """

    supplied: FloatArray
    design: FloatArray
    ends: slice

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("supplied", "design"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def build_energy_rows(library: Library, signals: ElasticSignals, length: float) -> EnergyRows:
    """Return the energy equations of one recording in windows of `length` s.

    Raises:
        UsageError: a window is shorter than a sample or longer than the recording.
    """
    ends = _find_ends(signals, length)
    turn = np.diff(signals.theta, axis=0)
    # A held torque's work is exact with the torque of the step's start.
    torque = signals.tau[:-1] if signals.hold == "zero" else (signals.tau[1:] + signals.tau[:-1]) / 2.0
    supplied = _add_up(np.sum(torque * turn, axis=1), ends)
    kinetic, potential = library.evaluate("energy_regressor", signals.q[ends], signals.dq[ends])
    columns = [
        np.diff(kinetic + potential, axis=0),
        np.diff(signals.dtheta[ends] ** 2, axis=0) / 2.0,
    ]
    if library.card.friction:
        (friction,) = library.evaluate("friction_regressor", signals.dtheta)
        middle = (friction[1:] + friction[:-1]) / 2.0
        columns.append(_add_up(np.einsum("ij,ijk->ik", turn, middle), ends))
    return EnergyRows(supplied=supplied, design=np.hstack(columns), ends=ends)


def find_window_work(
    elasticity: Sequence[Elasticity], signals: ElasticSignals, rows: EnergyRows
) -> FloatArray:
    """Return the work int tau_J dphi of all springs in every window (m,), J."""
    total = np.zeros(len(rows.supplied))
    phi = signals.phi
    for joint, spring in enumerate(elasticity):
        total += np.diff(find_spring_work(spring, phi[:, joint])[rows.ends])
    return total


def find_window_columns(
    thresholds: Sequence[FloatArray], signals: ElasticSignals, rows: EnergyRows
) -> FloatArray:
    """Return the work per unit stiffness in every window (m, sum (m_i + 1)), joint by joint."""
    phi = signals.phi
    columns = [
        np.diff(find_work_columns(phi[:, joint], grid)[rows.ends], axis=0)
        for joint, grid in enumerate(thresholds)
    ]
    return np.hstack(columns)


def _find_ends(signals: ElasticSignals, length: float) -> slice:
    intervals = round(length / signals.period)
    count = (len(signals.time) - 1 - signals.settled) // intervals if intervals else 0
    if count < 1:
        span = (len(signals.time) - 1 - signals.settled) * signals.period
        text = (
            f"window of {length:g} s: must be at least one sample period ({signals.period:g} s) and at most "
            f"the part of the recording that rows come from ({span:g} s)"
        )
        raise UsageError(Notice(code="usage.window", text=text))
    return slice(signals.settled, signals.settled + count * intervals + 1, intervals)


def _add_up(steps: FloatArray, ends: slice) -> FloatArray:
    """Return the sums of `steps` (N - 1, ...) over every window."""
    total = np.concatenate([np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)])
    return np.diff(total[ends], axis=0)
