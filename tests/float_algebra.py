"""The recursion over arrays of doubles, many states at once: what tests check formulas and code against."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from symid.dynamics.algebra import OperatorAlgebra, RobotState


@dataclass(frozen=True)
class FloatAlgebra(OperatorAlgebra):
    """Arrays of doubles; `symbols` holds the values of symbolic lengths in m."""

    symbols: Mapping[str, float] = field(default_factory=dict)
    zero = np.float64(0.0)
    one = np.float64(1.0)

    def constant(self, value):
        """Return the double nearest to `value`."""
        return np.float64(value.to_float(self.symbols))

    def half(self, value):
        """Return value / 2."""
        return 0.5 * value


def build_float_state(q, dq, ddq):
    """Return the coordinates from arrays (n, ...) in rad or m and their derivatives."""
    return RobotState(
        sine=tuple(np.sin(q)),
        cosine=tuple(np.cos(q)),
        position=tuple(q),
        velocity=tuple(dq),
        acceleration=tuple(ddq),
    )
