"""A table of values in which equal expressions are one entry.

Input: operations on references, in any order. Output: the instructions that the outputs need.

Supported: merging of equal operations, folding of constants, 0, 1, -1 and 2, free negation.
Not supported: rules that change rounding beyond the sign, such as reassociation.
"""

import math
from collections.abc import Iterable

from symid.codegen.instructions import Instruction, Op

__all__ = ["ValueTable"]

_ODD = frozenset({Op.SIN, Op.TAN, Op.TANH, Op.SIGN})
_EVEN = frozenset({Op.COS, Op.ABS, Op.IS_ZERO})


def _is_power_of_two(value: float) -> bool:
    return value != 0.0 and abs(math.frexp(value)[0]) == 0.5


class ValueTable:
    """Hash-consed instructions. Methods take and return references (see `instructions`)."""

    def __init__(self) -> None:
        self._instructions: list[Instruction] = []
        self._numbers: dict[Instruction, int] = {}

    def _intern(self, op: Op, args: tuple[int, ...] = (), constant: float = 0.0) -> int:
        instruction = Instruction(op, args, constant)
        number = self._numbers.get(instruction)
        if number is None:
            self._instructions.append(instruction)
            number = len(self._instructions)
            self._numbers[instruction] = number
        return number

    def _find_constant(self, ref: int) -> float | None:
        instruction = self._instructions[abs(ref) - 1]
        if instruction.op is not Op.CONSTANT:
            return None
        return instruction.constant if ref > 0 else -instruction.constant

    def constant(self, value: float) -> int:
        """Return the constant `value`; its sign stands in the reference."""
        number = self._intern(Op.CONSTANT, (), abs(value))
        return -number if value < 0 else number

    def input(self, port: int, element: int) -> int:
        """Return the row-major `element` of input `port`."""
        return self._intern(Op.INPUT, (port, element))

    def add(self, left: int, right: int) -> int:
        """Return left + right."""
        a, b = self._find_constant(left), self._find_constant(right)
        if a is not None and b is not None:
            return self.constant(a + b)
        if a == 0.0:
            return right
        if b == 0.0:
            return left
        if left == -right:
            return self.constant(0.0)
        if (left > 0) == (right > 0):
            number = self._intern(Op.ADD, tuple(sorted((abs(left), abs(right)))))
            return number if left > 0 else -number
        plus, minus = (left, -right) if left > 0 else (right, -left)
        # x - y and y - x are the same instruction.
        number = self._intern(Op.SUB, tuple(sorted((plus, minus))))
        return number if plus < minus else -number

    def mul(self, left: int, right: int) -> int:
        """Return left * right."""
        a, b = self._find_constant(left), self._find_constant(right)
        if a is not None and b is not None:
            return self.constant(a * b)
        if b is not None:
            left, right, a = right, left, b
        if a is not None and abs(a) in (0.0, 1.0, 2.0):
            signed = right if a > 0 else -right
            return {0.0: self.constant(0.0), 1.0: signed, 2.0: self.add(signed, signed)}[abs(a)]
        number = self._intern(Op.MUL, tuple(sorted((abs(left), abs(right)))))
        return number if (left > 0) == (right > 0) else -number

    def div(self, left: int, right: int) -> int:
        """Return left / right."""
        a, b = self._find_constant(left), self._find_constant(right)
        if a is not None and b:
            return self.constant(a / b)
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

    def collect(
        self, outputs: Iterable[Iterable[int]]
    ) -> tuple[tuple[Instruction, ...], tuple[tuple[int, ...], ...]]:
        """Return the instructions that `outputs` need, in order and numbered anew, and the outputs."""
        wanted = [tuple(port) for port in outputs]
        needed = {abs(ref) for port in wanted for ref in port}
        for number in range(len(self._instructions), 0, -1):
            instruction = self._instructions[number - 1]
            if number in needed and instruction.op is not Op.INPUT:
                needed.update(map(abs, instruction.args))
        # Only membership is asked of the set: its order takes no part.
        kept = [number for number in range(1, len(self._instructions) + 1) if number in needed]
        renumbered = {old: new for new, old in enumerate(kept, start=1)}

        def move(ref: int) -> int:
            return renumbered[ref] if ref > 0 else -renumbered[-ref]

        def rewrite(instruction: Instruction) -> Instruction:
            if instruction.op is Op.INPUT:
                return instruction
            return Instruction(instruction.op, tuple(map(move, instruction.args)), instruction.constant)

        instructions = tuple(rewrite(self._instructions[number - 1]) for number in kept)
        return instructions, tuple(tuple(map(move, port)) for port in wanted)
