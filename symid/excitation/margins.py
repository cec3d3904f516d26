"""How near a motion comes to its limits, looked at on a grid far finer than the one it was made on.

Input: a problem, unknowns. Output: one `Margin` per limit: the largest value, the limit, the share used.

Supported: all limits of `limits` and `loads`. Not supported: what a controller adds to the motion.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.excitation.fourier import find_grid
from symid.excitation.loads import StateValues
from symid.excitation.problem import ExcitationProblem

__all__ = ["SPACE", "Margin", "find_margins", "find_overshoot"]

_POINTS = 400
"""Points per harmonic."""
_ROUNDING = 1e-6
SPACE = "space"
_CLEARANCES: Mapping[str, Callable[[float, float], float]] = {
    "out": lambda value, radius: (math.sqrt(2.0 - value) - 1.0) * radius,
    "in": lambda value, radius: (1.0 - math.sqrt(value)) * radius,
    "plane": lambda value, _: 1.0 - value,
}
_ORDERS = ("position", "velocity", "acceleration", "jerk")


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """One limit: of what, of which joint or place, largest value, limit (SI), and the share that is granted.

    Of positions the value is the distance from the middle of the range; of space it is the clearance that is
    left, m, whose limit is zero.
    """

    kind: str
    name: str
    value: float
    limit: float
    allowed: float

    @property
    def share(self) -> float | None:
        """Return the part of the limit that is used; None for space."""
        return None if self.kind == SPACE else self.value / self.limit

    @property
    def excess(self) -> float:
        """Return by what part of the limit, or by how many metres, more is used than was granted."""
        return -self.value if self.share is None else self.share / self.allowed - 1.0

    @property
    def kept(self) -> bool:
        """Return whether no more is used than was granted, up to the rounding of a solver."""
        return self.excess <= _ROUNDING


def find_margins(
    problem: ExcitationProblem, names: tuple[str, ...], unknowns: FloatArray
) -> tuple[Margin, ...]:
    """Return all limits, joints in the order of `names`, at unknowns (n r,)."""
    limits, states = problem.limits, _find_fine_states(problem, unknowns)
    gaps = np.abs(states - np.array([limits.centre, *np.zeros((3, len(names)))])[:, None, :])
    peaks = gaps.max(axis=1)
    motion = [
        Margin(kind=kind, name=name, value=float(peak), limit=float(bound), allowed=limits.share)
        for kind, row, bounds in zip(_ORDERS, peaks, limits.bounds, strict=True)
        for name, peak, bound in zip(names, row, bounds, strict=True)
        if math.isfinite(bound)
    ]
    return (*motion, *_find_state_margins(problem, _find_peaks(problem, states)))


def find_overshoot(problem: ExcitationProblem, unknowns: FloatArray) -> FloatArray:
    """Return by how much each v (v,) of torque, torsion and space exceeds one; negative within."""
    overshoot: FloatArray = _find_peaks(problem, _find_fine_states(problem, unknowns)) - 1.0
    return overshoot


def _find_fine_states(problem: ExcitationProblem, unknowns: FloatArray) -> FloatArray:
    space = problem.space
    basis = find_grid(space, _POINTS * space.harmonics, 4)
    return space.find_states(unknowns.reshape(space.shape), basis)


def _find_peaks(problem: ExcitationProblem, states: FloatArray) -> FloatArray:
    """Return the largest v (v,) over the states (4, N, n)."""
    found = problem.state_limits
    if not found.names:
        return np.zeros(0)
    values = StateValues(found, states.shape[1], problem.space.size).find_values(states[:3])
    peaks: FloatArray = np.where(found.both, np.abs(values), values).max(axis=0)
    return peaks


def _find_state_margins(problem: ExcitationProblem, peaks: FloatArray) -> list[Margin]:
    found, share = problem.state_limits, problem.limits.share
    margins = []
    for name, kind, limit, peak in zip(found.names, found.kinds, found.limits, peaks.tolist(), strict=True):
        if kind in _CLEARANCES:
            left = _CLEARANCES[kind](peak, limit)
            margins.append(Margin(kind=SPACE, name=name, value=left, limit=0.0, allowed=1.0))
        else:
            margins.append(
                Margin(kind=kind, name=name, value=peak * limit, limit=limit / share, allowed=share)
            )
    return margins
