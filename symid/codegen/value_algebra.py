"""The carrier that routes are built and counted with: references to one table of values.

Input: a table and the inputs of a function. Output: an algebra over references, and the state.

It is pure Python and merges equal expressions at once, so that a route is counted in milliseconds.

Supported: everything the recursion needs, numbers as doubles nearest to the exact ones, or exact ones kept as
inputs of their own, symbolic lengths with them.
Not supported: doubles of symbolic lengths without a value.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from symid.algebra.scalar import State, spread_coordinates
from symid.codegen.instructions import Op
from symid.codegen.values import ValueTable
from symid.robot.description import Robot
from symid.robot.geometry import Exact

__all__ = ["NUMBERS", "ValueAlgebra", "build_value_state"]

NUMBERS = -2
"""The port whose elements are the exact numbers of an algebra that keeps them."""
_DYADIC = {Exact.of(value): value for value in (0.0, 0.5, 1.0, 2.0, -0.5, -1.0, -2.0)}
_SHORT_DENOMINATOR = 10**6


@dataclass(frozen=True, slots=True)
class ValueAlgebra:
    """References to `table`; `symbols` holds the values of symbolic lengths in m.

    `numbers` collects the exact numbers that doubles would round, symbolic lengths among them, in the order
    of the elements of the port `NUMBERS`; None where numbers become doubles.
    """

    table: ValueTable
    symbols: Mapping[str, float] = field(default_factory=dict)
    numbers: dict[Exact, int] | None = None

    @property
    def zero(self) -> int:
        """Return zero."""
        return self.table.constant(0.0)

    @property
    def one(self) -> int:
        """Return one."""
        return self.table.constant(1.0)

    def constant(self, value: Exact) -> int:
        """Return `value`, or the double nearest to it."""
        if self.numbers is None:
            return self.table.constant(value.to_float(self.symbols))
        if value in _DYADIC:
            return self.table.constant(_DYADIC[value])
        if -value in self.numbers:
            return -self.numbers[-value]
        if value not in self.numbers:
            self.numbers[value] = self.table.input(NUMBERS, len(self.numbers))
        return self.numbers[value]

    def add(self, left: int, right: int) -> int:
        """Return left + right."""
        return self.table.add(left, right)

    def sub(self, left: int, right: int) -> int:
        """Return left - right."""
        return self.table.add(left, -right)

    def mul(self, left: int, right: int) -> int:
        """Return left * right."""
        return self.table.mul(left, right)

    def div(self, left: int, right: int) -> int:
        """Return left / right."""
        return self.table.div(left, right)

    def maximum(self, left: int, right: int) -> int:
        """Return the greater of two."""
        return self.table.apply(Op.MAXIMUM, left, right)

    def minimum(self, left: int, right: int) -> int:
        """Return the smaller of two."""
        return self.table.apply(Op.MINIMUM, left, right)

    def neg(self, value: int) -> int:
        """Return -value; there is one zero."""
        return value if value == self.zero else -value

    def half(self, value: int) -> int:
        """Return value / 2."""
        return self.table.mul(self.table.constant(0.5), value)

    def sign(self, value: int) -> int:
        """Return -1, 0 or 1."""
        return self.table.apply(Op.SIGN, value)

    def scale(self, factor: float, value: int) -> int:
        """Return factor * value."""
        if self.numbers is None:
            return self.table.mul(self.table.constant(factor), value)
        # The inverse of a decimal is meant as that, 100/3 and not its first sixteen digits.
        short = Fraction(factor).limit_denominator(_SHORT_DENOMINATOR)
        exact = Exact.of(short) if float(short) == factor else Exact.of(factor)
        return self.table.mul(self.constant(exact), value)

    def tanh(self, value: int) -> int:
        """Return the hyperbolic tangent."""
        return self.table.apply(Op.TANH, value)

    def exp(self, value: int) -> int:
        """Return the exponential."""
        return self.table.apply(Op.EXP, value)

    def sin(self, value: int) -> int:
        """Return the sine."""
        return self.table.apply(Op.SIN, value)

    def cos(self, value: int) -> int:
        """Return the cosine."""
        return self.table.apply(Op.COS, value)

    def power(self, base: int, exponent: int) -> int:
        """Return base^exponent for base >= 0, exponent > 0."""
        return self.table.apply(Op.POWER, base, exponent)

    def absolute(self, value: int) -> int:
        """Return |value|."""
        return self.table.apply(Op.ABS, value)


def build_value_state(
    robot: Robot,
    algebra: ValueAlgebra,
    coordinates: tuple[Sequence[int], Sequence[int], Sequence[int]],
    turns: Mapping[int, float],
) -> State[int]:
    """Return the state of the joints from references to the coordinates: q, dq, ddq.

    `turns` are constant angles in rad, by joint, that are added before sine and cosine.
    """
    table = algebra.table

    def spread(values: Sequence[int]) -> tuple[int, ...]:
        return spread_coordinates(robot, algebra, values)[: robot.size]

    position, velocity, acceleration = map(spread, coordinates)
    angles = [table.add(angle, table.constant(turns.get(joint, 0.0))) for joint, angle in enumerate(position)]
    return State(
        sine=tuple(table.apply(Op.SIN, angle) for angle in angles),
        cosine=tuple(table.apply(Op.COS, angle) for angle in angles),
        position=position,
        velocity=velocity,
        acceleration=acceleration,
    )
