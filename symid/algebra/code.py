"""The code carrier: CasADi SX scalars.

Input: named SX coordinates. Output: an algebra over SX. SX drops zeros and ones by itself;
equal sub-expressions are merged when the function's instructions are read for printing.

Supported: everything the recursion needs, numbers as doubles nearest to the exact ones.
Not supported: symbolic lengths without a value.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca

from symid.algebra.scalar import Algebra, OperatorAlgebra, State, spread_coordinates
from symid.robot.description import Robot
from symid.robot.geometry import Exact

__all__ = ["CodeAlgebra", "build_code_state"]


@dataclass(frozen=True, slots=True)
class CodeAlgebra(OperatorAlgebra[ca.SX]):
    """SX scalars; `symbols` holds the values of symbolic lengths in m."""

    symbols: Mapping[str, float] = field(default_factory=dict)

    @property
    def zero(self) -> ca.SX:
        """Return zero."""
        return ca.SX(0)

    @property
    def one(self) -> ca.SX:
        """Return one."""
        return ca.SX(1)

    def constant(self, value: Exact) -> ca.SX:
        """Return the double nearest to `value`."""
        return ca.SX(value.to_float(self.symbols))

    def half(self, value: ca.SX) -> ca.SX:
        """Return value / 2."""
        return 0.5 * value

    def sign(self, value: ca.SX) -> ca.SX:
        """Return -1, 0 or 1."""
        return ca.sign(value)

    def absolute(self, value: ca.SX) -> ca.SX:
        """Return |value|."""
        return ca.fabs(value)


def build_code_state(robot: Robot, algebra: Algebra[ca.SX], q: ca.SX, dq: ca.SX, ddq: ca.SX) -> State[ca.SX]:
    """Return the state of the joints from three SX columns of the coordinates."""
    joints, coordinates = range(robot.size), range(q.numel())

    def spread(column: ca.SX) -> tuple[ca.SX, ...]:
        return spread_coordinates(robot, algebra, [column[i] for i in coordinates])[: robot.size]

    position = spread(q)
    return State(
        sine=tuple(ca.sin(position[i]) for i in joints),
        cosine=tuple(ca.cos(position[i]) for i in joints),
        position=position,
        velocity=spread(dq),
        acceleration=spread(ddq),
    )
