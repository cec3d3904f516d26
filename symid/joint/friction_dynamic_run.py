"""Friction with a memory along a motion: the exact step over many samples, and its derivatives.

Input: a law, its values, velocities that are held between samples. Output: torque and deflection at samples.

The deflection enters its own step linearly, z_k = r_k + e_k (z_{k-1} - r_k): r and e are found for all
samples at once. Derivatives by the parameters are complex steps, Im f(p + i eps) / eps, through the same
definition: exact to rounding, since nothing is subtracted (Squire and Trapp, SIAM Review 40 (1998) 110-112).

Supported: a velocity of the step beside that of the sample (way over period, speed at the end); several runs.
Not supported: turning back within a step.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, UsageError
from symid.joint.friction_dynamic import (
    DynamicLaw,
    check_dynamic_values,
    find_dynamic_torque,
    find_step_parts,
)
from symid.joint.friction_law import OperatorFriction, build_numpy_carrier

__all__ = ["DynamicRun", "FrictionPath", "build_held_path", "find_dynamic_run", "find_torque_columns"]

_TINY = 1e-40

Numbers = Any
"""An array of real or complex numbers."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionPath:
    """A motion.

    Args:
        held: (N,) velocity held during the step that ends at the sample, rad/s or m/s: way over period.
        velocity: (N,) velocity at the sample, rad/s or m/s.
        period: (N,) length of the step, s; 0 where a run begins.
        start: (N,) whether the bristles are straight before the step: True where a run begins.
    """

    held: FloatArray
    velocity: FloatArray
    period: FloatArray
    start: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and check them.

        Raises:
            UsageError: their lengths differ, or numbers are not finite, or a period is negative.
        """
        for name in ("held", "velocity", "period", "start"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        arrays = (self.held, self.velocity, self.period, self.start)
        alike = self.held.ndim == 1 and all(array.shape == self.held.shape for array in arrays)
        if not (alike and all(np.all(np.isfinite(array)) for array in arrays) and np.all(self.period >= 0)):
            text = "a path of friction takes as many velocities as periods, all finite, periods not negative"
            raise UsageError(Notice(code="joint.friction-path", text=text))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DynamicRun:
    """Torque (N,) in N m or N, and deflection of the bristles (N,) in rad or m, at the samples."""

    torque: FloatArray
    state: FloatArray


def build_held_path(velocity: FloatArray, period: float) -> FrictionPath:
    """Return the path whose sample k is the end of a step of `period` s at velocity k (N,), rad/s or m/s."""
    velocity = np.asarray(velocity, dtype=np.float64)
    start = np.zeros(velocity.shape)
    start[:1] = 1.0
    return FrictionPath(held=velocity, velocity=velocity, period=np.full(velocity.shape, period), start=start)


def _find_power(base: Numbers, exponent: Numbers) -> Numbers:
    """Return base^exponent; zero to a complex power is not defined in every NumPy."""
    return np.power(base + 1e-300 * (base == 0), exponent)


def _find_states(decay: Numbers, rest: Numbers, start: FloatArray, state: float) -> Numbers:
    """Return z (N,) of the linear recursion, from `state` at the first sample and zero at later starts."""
    result = []
    current: complex = state
    first = True
    for factor, goal, begins in zip(decay.tolist(), rest.tolist(), start.tolist(), strict=True):
        if begins and not first:
            current = 0.0
        first = False
        current = goal + factor * (current - goal)
        result.append(current)
    return np.array(result, dtype=decay.dtype)


def _find_run(law: DynamicLaw, values: Sequence[Numbers], path: FrictionPath, state: float) -> Numbers:
    algebra: OperatorFriction[Numbers] = replace(build_numpy_carrier(), power=_find_power)
    decay, rest = find_step_parts(algebra, law, path.held, path.period, values)
    shape = np.broadcast(path.held, decay).shape
    states = _find_states(np.broadcast_to(decay, shape), np.broadcast_to(rest, shape), path.start, state)
    return find_dynamic_torque(algebra, law, path.velocity, states, values), states


def find_dynamic_run(
    law: DynamicLaw, values: Sequence[float], path: FrictionPath, *, state: float = 0.0
) -> DynamicRun:
    """Return the friction along a path, from deflection `state` rad or m; later runs begin straight.

    Raises:
        UsageError: values that are none of the law.
    """
    check_dynamic_values(law, values)
    torque, states = _find_run(law, [np.float64(value) for value in values], path, state)
    return DynamicRun(torque=freeze(torque), state=freeze(states))


def find_torque_columns(
    law: DynamicLaw, values: Sequence[float], path: FrictionPath, which: Sequence[int]
) -> FloatArray:
    """Return the derivatives (N, p) of the torque by the values numbered `which`; bristles begin straight."""
    columns = np.empty((len(path.held), len(which)))
    for column, k in zip(columns.T, which, strict=True):
        step = _TINY * (abs(values[k]) or 1.0)
        moved = [np.complex128(value) for value in values]
        moved[k] += 1j * step
        torque, _ = _find_run(law, moved, path, 0.0)
        column[:] = np.imag(torque) / step
    return columns
