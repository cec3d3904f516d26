"""A table of values in which equal expressions are one entry.

Input: operations on references, in any order. Output: the instructions that the outputs need, or how
many of each kind they need.

Supported: merging of equal operations, folding of constants, 0, 1, -1 and 2, free negation, constant
factors put together, (a - b) + b = a. There is one zero: no reference to its negative is handed out.
Not supported: rules that put sums together in another way.
"""

import math
from collections.abc import Iterable

from symid.codegen.instructions import ELEMENTARY, PRODUCTS, SUMS, Instruction, Op, Operations

__all__ = ["ValueTable"]

_ODD = frozenset({Op.SIN, Op.TAN, Op.TANH, Op.SIGN})
_EVEN = frozenset({Op.COS, Op.ABS, Op.IS_ZERO})
# The first entries of every table.
_ZERO, _ONE, _TWO = 1, 2, 3

Pairs = dict[tuple[int, int], int]


def _is_power_of_two(value: float) -> bool:
    return value != 0.0 and abs(math.frexp(value)[0]) == 0.5


class ValueTable:
    """Hash-consed instructions. Methods take and return references (see `instructions`)."""

    def __init__(self) -> None:
        self._ops: list[Op] = []
        self._args: list[tuple[int, ...]] = []
        self._sources: list[tuple[int, ...]] = []
        self._constants: dict[int, float] = {}
        self._sums: Pairs = {}
        self._differences: Pairs = {}
        self._products: Pairs = {}
        self._others: dict[tuple[str, tuple[int, ...]], int] = {}
        self._literals: dict[float, int] = {}
        for value in (0.0, 1.0, 2.0):
            self.constant(value)

    def _append(self, op: Op, args: tuple[int, ...]) -> int:
        self._ops.append(op)
        self._args.append(args)
        self._sources.append(() if op is Op.INPUT else args)
        return len(self._ops)

    def _intern(self, op: Op, args: tuple[int, ...]) -> int:
        # An enumeration's own hash is slow.
        key = (op.value, args)
        number = self._others.get(key)
        if number is None:
            number = self._others[key] = self._append(op, args)
        return number

    def _find_constant(self, ref: int) -> float | None:
        value = self._constants.get(abs(ref))
        return value if value is None or ref > 0 else -value

    def constant(self, value: float) -> int:
        """Return the constant `value`; its sign stands in the reference."""
        number = self._literals.get(abs(value))
        if number is None:
            number = self._literals[abs(value)] = self._append(Op.CONSTANT, ())
            self._constants[number] = abs(value)
        return -number if value < 0 else number

    def is_constant(self, ref: int) -> bool:
        """Return whether a value is known already."""
        return abs(ref) in self._constants

    def input(self, port: int, element: int) -> int:
        """Return the row-major `element` of input `port`."""
        return self._intern(Op.INPUT, (port, element))

    def _find_rest(self, whole: int, part: int) -> int:
        """Return what remains of the sum `whole` when `part` takes one of its terms away, else 0."""
        number = abs(whole)
        op = self._ops[number - 1]
        if op is not Op.ADD and op is not Op.SUB:
            return 0
        first, second = self._args[number - 1]
        if op is Op.SUB:
            second = -second
        if whole < 0:
            first, second = -first, -second
        if first == -part:
            return second
        return first if second == -part else 0

    def _split_constant(self, ref: int) -> tuple[float, int] | None:
        """Return c and x where `ref` is the product of a constant c and x, None if it is not."""
        op = self._ops[abs(ref) - 1]
        if op is not Op.MUL and op is not Op.ADD:
            return None
        low, high = self._args[abs(ref) - 1]
        if op is Op.ADD:
            return (2.0, low if ref > 0 else -low) if low == high else None
        for factor, other in ((low, high), (high, low)):
            if factor in self._constants:
                return self._constants[factor], other if ref > 0 else -other
        return None

    def _simplify_sum(self, left: int, right: int) -> int:
        """Return a simpler form of left + right, 0 if there is none."""
        a, b = self._find_constant(left), self._find_constant(right)
        if a is not None and b is not None:
            return self.constant(a + b)
        rest = self._find_rest(left, right) or self._find_rest(right, left)
        if rest or left != right:
            return rest
        split = self._split_constant(left)
        return self.mul(self.constant(2.0 * split[0]), split[1]) if split else 0

    def add(self, left: int, right: int) -> int:
        """Return left + right."""
        if left in (_ZERO, -_ZERO):
            return right
        if right in (_ZERO, -_ZERO):
            return left
        if left == -right:
            return _ZERO
        if (left > 0) == (right > 0):
            first, second, op, known = abs(left), abs(right), Op.ADD, self._sums
            positive = left > 0
        else:
            first, second = (left, -right) if left > 0 else (right, -left)
            op, known, positive = Op.SUB, self._differences, first < second
        # x - y and y - x are the same instruction.
        pair = (first, second) if first <= second else (second, first)
        number = known.get(pair)
        if number is None:
            simple = self._simplify_sum(left, right)
            if simple:
                return simple
            number = known[pair] = self._append(op, pair)
        return number if positive else -number

    def _simplify_product(self, left: int, right: int) -> int:
        """Return a simpler form of left * right, 0 if there is none."""
        a, b = self._find_constant(left), self._find_constant(right)
        if a is not None and b is not None:
            return self.constant(a * b)
        if b is not None:
            left, right, a = right, left, b
        if a is None:
            return 0
        if abs(left) == _TWO:
            signed = right if left > 0 else -right
            return self.add(signed, signed)
        split = self._split_constant(right)
        return self.mul(self.constant(a * split[0]), split[1]) if split else 0

    def mul(self, left: int, right: int) -> int:
        """Return left * right."""
        low, high = abs(left), abs(right)
        if low > high:
            low, high = high, low
        if low == _ZERO:
            return _ZERO
        positive = (left > 0) == (right > 0)
        if low == _ONE:
            return high if positive else -high
        number = self._products.get((low, high))
        if number is None:
            simple = self._simplify_product(left, right)
            if simple:
                return simple
            number = self._products[low, high] = self._append(Op.MUL, (low, high))
        return number if positive else -number

    def div(self, left: int, right: int) -> int:
        """Return left / right."""
        a, b = self._find_constant(left), self._find_constant(right)
        if a is not None and b:
            return self.constant(a / b)
        if a == 0.0:
            return _ZERO
        if b is not None and _is_power_of_two(b):
            return self.mul(left, self.constant(1.0 / b))
        number = self._intern(Op.DIV, (abs(left), abs(right)))
        return number if (left > 0) == (right > 0) else -number

    def apply(self, op: Op, *args: int) -> int:
        """Return an elementary function, comparison or selection of `args`."""
        if op in _ODD:
            number = self._intern(op, (abs(args[0]),))
            return number if args[0] > 0 else -number
        if op in _EVEN:
            return self._intern(op, (abs(args[0]),))
        return self._intern(op, args)

    def _find_needed(self, outputs: Iterable[int]) -> list[int]:
        """Return the numbers of the instructions that `outputs` need, in order."""
        needed: set[int] = set()
        waiting = [abs(ref) for ref in outputs]
        while waiting:
            number = waiting.pop()
            if number not in needed:
                needed.add(number)
                waiting.extend(map(abs, self._sources[number - 1]))
        # Sorted, the set's own order takes no part.
        return sorted(needed)

    def walk(self, outputs: Iterable[int]) -> list[tuple[int, Op, tuple[int, ...]]]:
        """Return number, operation and arguments of the instructions that `outputs` need, in order."""
        return [(k, self._ops[k - 1], self._args[k - 1]) for k in self._find_needed(outputs)]

    def count(self, outputs: Iterable[int]) -> Operations:
        """Return the operations that `outputs` need; see `instructions.count_operations`."""
        ops = [self._ops[number - 1] for number in self._find_needed(outputs)]
        # An enumeration's own hash is slow, comparing its members is not.
        return Operations(
            mul=sum(map(ops.count, PRODUCTS)),
            add=sum(map(ops.count, SUMS)),
            trig=sum(map(ops.count, ELEMENTARY)),
        )

    def collect(
        self, outputs: Iterable[Iterable[int]]
    ) -> tuple[tuple[Instruction, ...], tuple[tuple[int, ...], ...]]:
        """Return the instructions that `outputs` need, in order and numbered anew, and the outputs."""
        wanted = [tuple(port) for port in outputs]
        kept = self._find_needed(ref for port in wanted for ref in port)
        renumbered = {old: new for new, old in enumerate(kept, start=1)}

        def move(ref: int) -> int:
            # What a route negated itself may be zero.
            return renumbered[ref] if ref > 0 else -renumbered[-ref] if ref != -_ZERO else renumbered[_ZERO]

        def rewrite(number: int) -> Instruction:
            op, args = self._ops[number - 1], self._args[number - 1]
            if op is Op.CONSTANT:
                return Instruction(op, (), self._constants[number])
            return Instruction(op, args if op is Op.INPUT else tuple(map(move, args)))

        instructions = tuple(map(rewrite, kept))
        return instructions, tuple(tuple(map(move, port)) for port in wanted)
