"""Straight-line programs, and the table of expressions in which they are built.

A reference is the one-based number of an instruction; a minus sign in front of it negates the value, so that
negation costs no instruction. In a table equal expressions are one entry: constants are folded, 0, 1, -1 and
2 cost nothing, constant factors are put together, (a - b) + b = a, and there is one zero. Derivatives are
written into the same table, forward or backward (Griewank and Walther 2008).

Supported: all operations of `Op`; numbers as the nearest doubles, or exact ones kept as inputs of their own.
Not supported: loops, branches, calls; derivatives of other operations than sums, products, quotients, sine
and cosine (TypeError).
"""

import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from typing import Any

from symid.codegen.functions import FunctionSpec, Port
from symid.dynamics import Algebra
from symid.robot import Exact


class Op(Enum):
    """What an instruction does; comparisons give one or zero; where an operand is NaN, the result is NaN."""

    INPUT = "input"
    CONSTANT = "constant"
    ADD = "add"
    SUB = "sub"
    MUL = "mul"
    DIV = "div"
    SIN = "sin"
    COS = "cos"
    EXP = "exp"
    TANH = "tanh"
    POWER = "power"
    ABS = "abs"
    SIGN = "sign"
    LESS = "less"
    LESS_EQUAL = "less_equal"
    MAXIMUM = "maximum"
    MINIMUM = "minimum"


ARITHMETIC: Mapping[Op, Callable[..., Any]] = {
    Op.ADD: operator.add,
    Op.SUB: operator.sub,
    Op.MUL: operator.mul,
    Op.DIV: operator.truediv,
}
"""What the four operators are in Python, for numbers and expressions alike."""
_PRODUCTS = (Op.MUL, Op.DIV)
_SUMS = (Op.ADD, Op.SUB)
_MOST_ORDERED = 600
_ELEMENTARY = (Op.SIN, Op.COS, Op.EXP, Op.TANH, Op.POWER)


@dataclass(frozen=True, slots=True)
class Instruction:
    """One operation.

    `args` are references; for INPUT they are the port's number and the row-major element.
    `constant` is the value of a CONSTANT, never negative.
    """

    op: Op
    args: tuple[int, ...] = ()
    constant: float = 0.0

    @property
    def operands(self) -> tuple[int, ...]:
        """Return the numbers of the instructions whose values it takes."""
        return () if self.op is Op.INPUT else tuple(map(abs, self.args))


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """A function in static single assignment form; `outputs` are row-major references per port."""

    spec: FunctionSpec
    instructions: tuple[Instruction, ...]
    outputs: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Operations:
    """Arithmetic of a program: `mul` with squares and divisions, `add` with doublings, `trig` apart."""

    mul: int
    add: int
    trig: int


def count_operations(program: Program) -> Operations:
    """Return the operations of `program`; a^2 is one product, a + a one sum, negation is free.

    `trig` counts sines, cosines and the other elementary functions; comparisons are not counted.
    """
    return _count([instruction.op for instruction in program.instructions])


def _count(ops: list[Op]) -> Operations:
    # An enumeration's own hash is slow, comparing its members is not.
    mul, add, trig = (sum(map(ops.count, kinds)) for kinds in (_PRODUCTS, _SUMS, _ELEMENTARY))
    return Operations(mul=mul, add=add, trig=trig)


def order_by_growth(program: Program) -> list[int]:
    """Return the numbers of the outputs, next always the one that needs the fewest values not yet there.

    Entries of several matrices that share values follow one another; where outputs are very many, they stay
    port by port.
    """
    rest = dict.fromkeys(map(abs, itertools.chain(*program.outputs)))
    if len(rest) > _MOST_ORDERED:
        return list(rest)
    # Bit k of an entry: whether it needs value k.
    needed, present, order = [0], 0, list[int]()
    for number, instruction in enumerate(program.instructions, start=1):
        needed.append(functools.reduce(operator.or_, (needed[k] for k in instruction.operands), 1 << number))
    while rest:
        missing = [((needed[ref] & ~present).bit_count(), ref) for ref in rest]
        _, ref = min(missing, key=operator.itemgetter(0))
        del rest[ref]
        order.append(ref)
        present |= needed[ref]
    return order


def build_depth_first(program: Program, outputs: Iterable[int] | None = None) -> Program:
    """Return `program` with its instructions in depth-first order, so that few values are alive at a time.

    A value is computed when the first that needs it is next; of two operands first the one that needs more
    values itself (Sethi and Ullman 1970, for trees). `outputs` is another order of the outputs than that of
    the ports.
    """
    # How many values are alive at once while a value is computed, were none used twice.
    needs = [0]
    for instruction in program.instructions:
        below = sorted((needs[k] for k in set(instruction.operands)), reverse=True)
        needs.append(max([1, *(need + k for k, need in enumerate(below))]))
    order: dict[int, None] = {}
    for ref in itertools.chain(*program.outputs) if outputs is None else outputs:
        waiting = [abs(ref)]
        while waiting:
            operands = program.instructions[waiting[-1] - 1].operands
            missing = [k for k in reversed(operands) if k not in order]
            if missing:
                # The last one on the stack comes first; of equal needs the first operand.
                waiting.extend(sorted(missing, key=needs.__getitem__))
            else:
                order[waiting.pop()] = None
    instructions = {number: program.instructions[number - 1] for number in order}
    return _renumber(program.spec, instructions, program.outputs)


def _renumber(
    spec: FunctionSpec, instructions: Mapping[int, Instruction], outputs: Iterable[Iterable[int]]
) -> Program:
    """Return the program of `instructions`, by their numbers so far, in the order of the mapping."""
    renumbered = {old: new for new, old in enumerate(instructions, start=1)}

    def move(ref: int) -> int:
        return renumbered[ref] if ref > 0 else -renumbered[-ref]

    return Program(
        spec=spec,
        instructions=tuple(
            one if one.op is Op.INPUT else Instruction(one.op, tuple(map(move, one.args)), one.constant)
            for one in instructions.values()
        ),
        outputs=tuple(tuple(map(move, refs)) for refs in outputs),
    )


_ODD = frozenset({Op.SIN, Op.TANH, Op.SIGN})
_EVEN = frozenset({Op.COS, Op.ABS})
# The first entries of every table.
_ZERO, _ONE = 1, 2
NUMBERS = -2
"""The port whose elements are the exact numbers of a table that keeps them."""
_DYADIC = {Exact.of(value): value for value in (0.0, 0.5, 1.0, 2.0, -0.5, -1.0, -2.0)}
_SHORT_DENOMINATOR = 10**6


class ExpressionTable(Algebra[int]):
    """Hash-consed instructions, an algebra of references (see above).

    `symbols` holds the values of symbolic lengths in m. `numbers` collects the exact numbers that doubles
    would round, symbolic lengths among them, as elements of the port `NUMBERS`; None where numbers become
    doubles.
    """

    zero, one = _ZERO, _ONE

    def __init__(self, symbols: Mapping[str, float] | None = None, *, exact: bool = False) -> None:
        self.symbols = symbols or {}
        self.numbers: dict[Exact, int] | None = {} if exact else None
        self._ops: list[Op] = []
        self._args: list[tuple[int, ...]] = []
        self._sources: list[tuple[int, ...]] = []
        self._constants: dict[int, float] = {}
        self._sums: dict[tuple[int, int], int] = {}
        self._differences: dict[tuple[int, int], int] = {}
        self._products: dict[tuple[int, int], int] = {}
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

    def _get_constant(self, ref: int) -> float | None:
        value = self._constants.get(abs(ref))
        return value if value is None or ref > 0 else -value

    def constant(self, value: Exact | float) -> int:
        """Return `value`, or the double nearest to it; its sign stands in the reference."""
        if isinstance(value, Exact):
            if self.numbers is not None and value not in _DYADIC:
                if -value in self.numbers:
                    return -self.numbers[-value]
                if value not in self.numbers:
                    self.numbers[value] = self.input(NUMBERS, len(self.numbers))
                return self.numbers[value]
            value = value.to_float(self.symbols)
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

    def _locate_rest(self, whole: int, part: int) -> int:
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
            a, b = self._get_constant(left), self._get_constant(right)
            if a is not None and b is not None:
                return self.constant(a + b)
            if rest := self._locate_rest(left, right) or self._locate_rest(right, left):
                return rest
            if left == right and (split := self._split_constant(left)):
                return self.mul(self.constant(2.0 * split[0]), split[1])
            number = known[pair] = self._append(op, pair)
        return number if positive else -number

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
            a, b = self._get_constant(left), self._get_constant(right)
            if a is not None and b is not None:
                return self.constant(a * b)
            factor, value = (a, right) if b is None else (b, left)
            if factor is not None and abs(factor) == 2.0:
                signed = value if factor > 0 else -value
                return self.add(signed, signed)
            if factor is not None and (split := self._split_constant(value)):
                return self.mul(self.constant(factor * split[0]), split[1])
            number = self._products[low, high] = self._append(Op.MUL, (low, high))
        return number if positive else -number

    def sub(self, left: int, right: int) -> int:
        """Return left - right."""
        return self.add(left, -right)

    def neg(self, value: int) -> int:
        """Return -value; there is one zero."""
        return value if value == _ZERO else -value

    def half(self, value: int) -> int:
        """Return value / 2."""
        return self.mul(self.constant(0.5), value)

    def scale(self, factor: float, value: int) -> int:
        """Return factor * value."""
        if self.numbers is None:
            return self.mul(self.constant(factor), value)
        # The inverse of a decimal is meant as that, 100/3 and not its first sixteen digits.
        short = Fraction(factor).limit_denominator(_SHORT_DENOMINATOR)
        exact = Exact.of(short) if float(short) == factor else Exact.of(factor)
        return self.mul(self.constant(exact), value)

    def div(self, left: int, right: int) -> int:
        """Return left / right."""
        a, b = self._get_constant(left), self._get_constant(right)
        if a is not None and b:
            return self.constant(a / b)
        if a == 0.0:
            return _ZERO
        # A power of two has an exact inverse.
        if b and abs(math.frexp(b)[0]) == 0.5:
            return self.mul(left, self.constant(1.0 / b))
        number = self._intern(Op.DIV, (abs(left), abs(right)))
        return number if (left > 0) == (right > 0) else -number

    def apply(self, op: Op, *args: int) -> int:
        """Return an elementary function, comparison or selection of `args`."""
        number = self._intern(op, (abs(args[0]),) if op in _ODD or op in _EVEN else args)
        return -number if op in _ODD and args[0] < 0 else number

    sin, cos, tanh, exp, power, absolute, sign, maximum, minimum = map(
        functools.partial(functools.partialmethod, apply),
        (Op.SIN, Op.COS, Op.TANH, Op.EXP, Op.POWER, Op.ABS, Op.SIGN, Op.MAXIMUM, Op.MINIMUM),
    )

    def walk(self, outputs: Iterable[int]) -> list[tuple[int, Op, tuple[int, ...]]]:
        """Return number, operation and arguments of the instructions that `outputs` need, in order."""
        needed: set[int] = set()
        waiting = [abs(ref) for ref in outputs]
        while waiting:
            number = waiting.pop()
            if number not in needed:
                needed.add(number)
                waiting.extend(map(abs, self._sources[number - 1]))
        # Sorted, the set's own order takes no part.
        return [(k, self._ops[k - 1], self._args[k - 1]) for k in sorted(needed)]

    def count(self, outputs: Iterable[int]) -> Operations:
        """Return the operations that `outputs` need; see `count_operations`."""
        return _count([op for _, op, _ in self.walk(outputs)])

    def build_program(self, spec: FunctionSpec, outputs: Iterable[Iterable[int]]) -> Program:
        """Return the instructions that `outputs` (by port, row-major) need, in order and numbered anew."""

        def clean(refs: Iterable[int]) -> tuple[int, ...]:
            # What a route negated itself may be zero.
            return tuple(_ZERO if ref == -_ZERO else ref for ref in refs)

        wanted = [clean(port) for port in outputs]
        for port, refs in zip(spec.outputs, wanted, strict=True):
            if len(refs) != port.size:
                message = f"{spec.name}, {port.name}: expected {port.size} values, got {len(refs)}"
                raise ValueError(message)
        instructions = {
            k: Instruction(op, args if op is Op.INPUT else clean(args), self._constants.get(k, 0.0))
            for k, op, args in self.walk(itertools.chain(*wanted))
        }
        return _renumber(spec, instructions, wanted)

    def build_vector_program(
        self, name: str, inputs: Mapping[str, int], outputs: Mapping[str, Sequence[int]]
    ) -> Program:
        """Return the program of vectors without units, by their names; of inputs the sizes are given."""
        taken, made = (
            tuple(Port(name=port, shape=(size,), unit="mixed", meaning=port) for port, size in sizes.items())
            for sizes in (inputs, {port: len(refs) for port, refs in outputs.items()})
        )
        spec = FunctionSpec(name=name, inputs=taken, outputs=made, meaning=name)
        return self.build_program(spec, outputs.values())


def _list_slopes(table: ExpressionTable, number: int, op: Op, args: tuple[int, ...]) -> tuple[int, ...]:
    """Return the derivative of an instruction by each of its arguments."""
    if op is Op.ADD:
        return _ONE, _ONE
    if op is Op.SUB:
        return _ONE, -_ONE
    if op is Op.MUL:
        return args[1], args[0]
    if op is Op.DIV:
        return table.div(_ONE, args[1]), -table.div(number, args[1])
    if op is Op.SIN:
        return (table.apply(Op.COS, args[0]),)
    if op is Op.COS:
        return (-table.apply(Op.SIN, args[0]),)
    message = f"no derivative of {op.value}: write it with sums, products, sine and cosine"
    raise TypeError(message)


def differentiate_along(
    table: ExpressionTable, values: Sequence[int], directions: Sequence[Mapping[int, int]]
) -> list[list[int]]:
    """Return the derivatives of `values` for each direction, in which inputs, no constants, move by seeds."""
    zero, steps = table.zero, table.walk(values)
    users: dict[int, list[int]] = {}
    for index, (_, op, args) in enumerate(steps):
        for ref in () if op is Op.INPUT else args:
            users.setdefault(abs(ref), []).append(index)
    results = []
    for seeds in directions:
        moving = [pair for pair in seeds.items() if not table.is_constant(pair[0]) and abs(pair[1]) != zero]
        rates = {abs(ref): seed if ref > 0 else -seed for ref, seed in moving}
        dependent: set[int] = set()
        waiting = list(rates)
        while waiting:
            new = [index for index in users.get(waiting.pop(), ()) if index not in dependent]
            dependent.update(new)
            waiting.extend(steps[index][0] for index in new)
        for index in sorted(dependent):
            number, op, args = steps[index]
            if number in rates:
                continue
            total = zero
            for ref, slope in zip(args, _list_slopes(table, number, op, args), strict=True):
                rate = rates.get(abs(ref), zero)
                total = table.add(total, table.mul(slope, rate if ref > 0 else -rate))
            rates[number] = total
        results.append([rates.get(ref, zero) if ref > 0 else -rates.get(-ref, zero) for ref in values])
    return results


def differentiate_backward(table: ExpressionTable, value: int, inputs: Sequence[int]) -> list[int]:
    """Return the derivatives of `value` by each of `inputs`; by a constant it is zero."""
    zero, slopes = table.zero, {abs(value): table.one if value > 0 else -table.one}
    for number, op, args in reversed(table.walk([value])):
        outer = slopes.get(number, zero)
        if op in (Op.INPUT, Op.CONSTANT) or abs(outer) == zero:
            continue
        for ref, inner in zip(args, _list_slopes(table, number, op, args), strict=True):
            change = table.mul(outer, inner if ref > 0 else -inner)
            slopes[abs(ref)] = table.add(slopes.get(abs(ref), zero), change)
    found = [zero if table.is_constant(ref) else slopes.get(abs(ref), zero) for ref in inputs]
    return [slope if ref > 0 else -slope for ref, slope in zip(inputs, found, strict=True)]
