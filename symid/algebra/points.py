"""The point carrier: exact numbers of one field, the coordinates at one exact point.

Input: numbers of a SymPy field. Output: an algebra over them, to compare exact expressions without
expanding them: two polynomials that agree at a random rational point are the same but for bad luck.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sympy import QQ
from sympy.polys.domains.domain import Domain

from symid.algebra.exact import find_constant
from symid.algebra.scalar import OperatorAlgebra, State, spread_coordinates
from symid.robot.description import Robot
from symid.robot.geometry import Exact

__all__ = ["PointAlgebra", "build_point_state"]


@dataclass(frozen=True, slots=True)
class PointAlgebra(OperatorAlgebra[Any]):
    """Numbers of `domain`; `values` holds those of the symbolic lengths."""

    domain: Domain
    values: Mapping[str, Any]

    @property
    def zero(self) -> Any:  # noqa: ANN401  an element of a SymPy domain has no type of its own
        """Return zero."""
        return self.domain.zero

    @property
    def one(self) -> Any:  # noqa: ANN401  as above
        """Return one."""
        return self.domain.one

    def constant(self, value: Exact) -> Any:  # noqa: ANN401  as above
        """Return an exact number, symbolic lengths replaced by their values."""
        return find_constant(value, self.domain, self.values)

    def half(self, value: Any) -> Any:  # noqa: ANN401  as above
        """Return value / 2."""
        return value * self.domain.convert(QQ(1, 2))


def build_point_state(robot: Robot, algebra: PointAlgebra, values: Mapping[str, Any]) -> State[Any]:
    """Return the state from {s1: .., c1: .., q1: .., dq1: .., ddq1: ..}; s^2 + c^2 = 1 must hold.

    Joints that follow another have their own s and c, or q; their rates follow.
    """

    def take(prefix: str) -> tuple[Any, ...]:
        return tuple(values.get(f"{prefix}{number}", 0) for number in range(1, robot.size + 1))

    def spread(prefix: str) -> tuple[Any, ...]:
        rates = [values.get(f"{prefix}{index + 1}", 0) for index in robot.coordinates]
        return spread_coordinates(robot, algebra, rates)[: robot.size]

    return State(
        sine=take("s"),
        cosine=take("c"),
        position=take("q"),
        velocity=spread("dq"),
        acceleration=spread("ddq"),
    )
