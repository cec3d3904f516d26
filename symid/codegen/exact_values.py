"""Values of programs in 50-digit arithmetic, at many states at once.

Input: a program and its inputs. Output: every element of its outputs at every state, as decimal numbers.

Sums, products, quotients and roots are those of decimal arithmetic with 50 digits, each rounded correctly;
the other functions are mpmath's with 60 digits. No library of mathematics that a compiler brings takes part.

Supported: all operations of `Op`. Not supported: a value that is not finite; it is refused.
"""

import operator
from collections.abc import Callable, Sequence
from decimal import (
    Context,
    Decimal,
    DecimalException,
    DivisionByZero,
    InvalidOperation,
    Overflow,
    localcontext,
)
from functools import lru_cache
from typing import Any

import mpmath
import numpy as np
import numpy.typing as npt

from symid.codegen.instructions import Instruction, Op, Program
from symid.errors import GenerationError, Notice

__all__ = ["DIGITS", "Exact", "compute_exact", "find_no_value"]

DIGITS = 50
_MORE_DIGITS = 60
_CONTEXT = Context(prec=DIGITS, traps=[DivisionByZero, InvalidOperation, Overflow])
_ZERO, _ONE = Decimal(0), Decimal(1)

Exact = npt.NDArray[np.object_]
"""An array of decimal numbers."""


@lru_cache(maxsize=1 << 16)
def _call(name: str, *operands: Decimal) -> Decimal:
    """Return a function of mpmath; equal sines of many programs are computed once."""
    with mpmath.workdps(_MORE_DIGITS):
        value = getattr(mpmath, name)(*(mpmath.mpf(str(operand)) for operand in operands))
        # A complex value, from outside a function's domain, is no decimal number.
        return +Decimal(mpmath.nstr(value, _MORE_DIGITS))


def _is(condition: bool) -> Decimal:  # noqa: FBT001  the rules below give it as their only operand
    return _ONE if condition else _ZERO


_ELEMENTWISE: dict[Op, tuple[int, Callable[..., Decimal]]] = {
    Op.SIN: (1, lambda a: _call("sin", a)),
    Op.COS: (1, lambda a: _call("cos", a)),
    Op.TAN: (1, lambda a: _call("tan", a)),
    Op.EXP: (1, lambda a: _call("exp", a)),
    Op.TANH: (1, lambda a: _call("tanh", a)),
    Op.POWER: (2, lambda a, b: _call("power", a, b)),
    Op.SQRT: (1, Decimal.sqrt),
    Op.ABS: (1, abs),
    Op.SIGN: (1, lambda a: _is(a > 0) - _is(a < 0)),
    Op.LESS: (2, lambda a, b: _is(a < b)),
    Op.LESS_EQUAL: (2, lambda a, b: _is(a <= b)),
    Op.IS_ZERO: (1, lambda a: _is(a == 0)),
    Op.SELECT: (2, lambda a, b: b if a else _ZERO),
    Op.MAXIMUM: (2, max),
    Op.MINIMUM: (2, min),
}

# NumPy walks the states in C; what depends on shared inputs alone stays one number.
_RULES: dict[Op, Callable[..., Any]] = {
    Op.ADD: operator.add,
    Op.SUB: operator.sub,
    Op.MUL: operator.mul,
    Op.DIV: operator.truediv,
    **{op: np.frompyfunc(rule, count, 1) for op, (count, rule) in _ELEMENTWISE.items()},
}


def find_no_value(program: Program, why: str) -> GenerationError:
    """Return the error that says that `program` has no value at a state."""
    text = f"function {program.spec.name!r} has no value at a state of the self-test: {why}"
    return GenerationError(Notice(code="codegen.no-reference", text=text))


def _run(program: Program, inputs: Sequence[Exact], states: int) -> tuple[Exact, ...]:
    values: list[Any] = [None]

    def read(ref: int) -> Any:  # noqa: ANN401  a number, or an array of them
        return values[ref] if ref > 0 else -values[-ref]

    def compute(instruction: Instruction) -> Any:  # noqa: ANN401
        if instruction.op is Op.INPUT:
            port, element = instruction.args
            given = inputs[port]
            return given[element] if given.ndim == 1 else given[:, element]
        if instruction.op is Op.CONSTANT:
            return Decimal(instruction.constant)
        return _RULES[instruction.op](*map(read, instruction.args))

    for instruction in program.instructions:
        values.append(compute(instruction))  # noqa: PERF401  later values need earlier ones

    def gather(refs: Sequence[int]) -> Exact:
        found = np.empty((states, len(refs)), dtype=object)
        for k, ref in enumerate(refs):
            found[:, k] = read(ref)
        return found

    return tuple(map(gather, program.outputs))


def compute_exact(program: Program, inputs: Sequence[Exact], states: int) -> tuple[Exact, ...]:
    """Return per output port the elements at every state, (states, size).

    Args:
        program: the function.
        inputs: per input port the elements at every state, (states, size); (size,) of a shared one.
        states: how many.

    Raises:
        GenerationError: the function has no value at one of the states.
    """
    try:
        with localcontext(_CONTEXT):
            return _run(program, inputs, states)
    except (DecimalException, ArithmeticError, ValueError, TypeError) as error:
        # Division by zero, and what lies outside a function's domain.
        raise find_no_value(program, repr(error)) from error
