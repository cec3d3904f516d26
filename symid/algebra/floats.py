"""The float carrier: NumPy arrays of any shape, many states at once. Meant for tests and checks.

Input: arrays of coordinates. Output: an algebra over float64 arrays.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from symid.algebra.scalar import OperatorAlgebra, State
from symid.arrays import FloatArray
from symid.robot.geometry import Exact

__all__ = ["FloatAlgebra", "build_float_state"]


@dataclass(frozen=True, slots=True)
class FloatAlgebra(OperatorAlgebra[FloatArray]):
    """Arrays of doubles; `symbols` holds the values of symbolic lengths in m."""

    symbols: Mapping[str, float] = field(default_factory=dict)

    @property
    def zero(self) -> FloatArray:
        """Return zero."""
        return np.float64(0.0)  # type: ignore[return-value]  # a scalar broadcasts like an array

    @property
    def one(self) -> FloatArray:
        """Return one."""
        return np.float64(1.0)  # type: ignore[return-value]  # a scalar broadcasts like an array

    def constant(self, value: Exact) -> FloatArray:
        """Return the double nearest to `value`."""
        return np.float64(value.to_float(self.symbols))  # type: ignore[return-value]  # as above

    def half(self, value: FloatArray) -> FloatArray:
        """Return value / 2."""
        return 0.5 * value


def build_float_state(q: FloatArray, dq: FloatArray, ddq: FloatArray) -> State[FloatArray]:
    """Return the coordinates from arrays (n, ...) in rad or m and their derivatives."""
    return State(
        sine=tuple(np.sin(q)),
        cosine=tuple(np.cos(q)),
        position=tuple(q),
        velocity=tuple(dq),
        acceleration=tuple(ddq),
    )
