"""Straight-line programs: what a function computes, one operation after another.

Output: `Program`, from which C and Python are printed, and its operation counts.

A reference is the one-based number of an instruction; a minus sign in front of it means the
value with the other sign, so that negation costs no instruction.

Supported: sums, products, quotients, elementary functions, sign, selection, greater and smaller of two.
Not supported: loops, branches, calls.
"""

from dataclasses import dataclass
from enum import Enum

from symid.codegen.functions import FunctionSpec

__all__ = [
    "ELEMENTARY",
    "PRODUCTS",
    "SUMS",
    "Instruction",
    "Op",
    "Operations",
    "Program",
    "count_operations",
]


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
    TAN = "tan"
    SQRT = "sqrt"
    EXP = "exp"
    TANH = "tanh"
    POWER = "power"
    ABS = "abs"
    SIGN = "sign"
    LESS = "less"
    LESS_EQUAL = "less_equal"
    IS_ZERO = "is_zero"
    SELECT = "select"
    MAXIMUM = "maximum"
    MINIMUM = "minimum"


PRODUCTS = frozenset({Op.MUL, Op.DIV})
SUMS = frozenset({Op.ADD, Op.SUB})
ELEMENTARY = frozenset({Op.SIN, Op.COS, Op.TAN, Op.SQRT, Op.EXP, Op.TANH, Op.POWER})


@dataclass(frozen=True, slots=True)
class Instruction:
    """One operation.

    `args` are references; for INPUT they are the port's number and the row-major element.
    `constant` is the value of a CONSTANT, never negative.
    """

    op: Op
    args: tuple[int, ...] = ()
    constant: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """A function in static single assignment form.

    `outputs` holds, per output port, the references of its elements in row-major order.
    """

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
    ops = [instruction.op for instruction in program.instructions]
    return Operations(
        mul=sum(op in PRODUCTS for op in ops),
        add=sum(op in SUMS for op in ops),
        trig=sum(op in ELEMENTARY for op in ops),
    )
