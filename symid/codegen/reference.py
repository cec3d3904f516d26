"""Reference values for self-tests, the same digits on every machine.

Input: programs and the CasADi functions built from them. Output: random states and the value of
every output there. The values come from the program in 40-digit arithmetic, so no mathematics
library takes part in them; each must agree with what CasADi itself computes.

Supported: all operations of `Op`.
"""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import mpmath
import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard, Port
from symid.codegen.instructions import Instruction, Op, Program
from symid.codegen.options import GenerateOptions
from symid.errors import GenerationError, Notice

__all__ = ["FLOOR", "NEGLIGIBLE", "Reference", "build_references"]

# Errors are measured by the largest value of an output; one below NEGLIGIBLE is zero but for rounding, and
# FLOOR stands in for its size.
NEGLIGIBLE = 1e-12
FLOOR = 0.01

_DIGITS = 40
_AGREEMENT = 1e-8
_DRAWS = 40
_ATTEMPTS = 4
_CONDITION = 1e6
_RANGES = {"q": 3.0, "dq": 2.0, "ddq": 5.0, "tau": 20.0}
_RANGES |= {"dddq": 20.0, "ddddq": 100.0, "phi": 0.02, "P": 0.02, "tau_J": 20.0, "Q": 5.0}
# In place of stiffnesses that the robot file does not know: k0, and those of stops.
_STIFFNESSES = {True: 100.0, False: 20.0}

_RULES: dict[Op, Callable[..., Any]] = {
    Op.ADD: operator.add,
    Op.SUB: operator.sub,
    Op.MUL: operator.mul,
    Op.DIV: operator.truediv,
    Op.SIN: mpmath.sin,
    Op.COS: mpmath.cos,
    Op.TAN: mpmath.tan,
    Op.SQRT: mpmath.sqrt,
    Op.EXP: mpmath.exp,
    Op.TANH: mpmath.tanh,
    Op.POWER: mpmath.power,
    Op.ABS: abs,
    Op.SIGN: mpmath.sign,
    Op.LESS: lambda a, b: mpmath.mpf(int(a < b)),
    Op.LESS_EQUAL: lambda a, b: mpmath.mpf(int(a <= b)),
    Op.IS_ZERO: lambda a: mpmath.mpf(int(a == 0)),
    Op.SELECT: lambda a, b: b if a else mpmath.mpf(0),
    Op.MAXIMUM: max,
    Op.MINIMUM: min,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Inputs and outputs of one function; a shared input has one row, others one a state."""

    inputs: tuple[tuple[tuple[float, ...], ...], ...]
    outputs: tuple[tuple[tuple[float, ...], ...], ...]


def _fail_value(program: Program, why: str) -> GenerationError:
    text = f"function {program.spec.name!r} has no value at a state of the self-test: {why}"
    return GenerationError(Notice(code="codegen.no-reference", text=text))


def _evaluate(program: Program, inputs: Sequence[Sequence[float]]) -> tuple[tuple[float, ...], ...]:
    values: list[Any] = [None]

    def read(ref: int) -> Any:  # noqa: ANN401  mpmath has no types
        return values[ref] if ref > 0 else -values[-ref]

    def compute(instruction: Instruction) -> Any:  # noqa: ANN401
        if instruction.op is Op.INPUT:
            port, element = instruction.args
            return mpmath.mpf(inputs[port][element])
        if instruction.op is Op.CONSTANT:
            return mpmath.mpf(instruction.constant)
        return _RULES[instruction.op](*map(read, instruction.args))

    try:
        with mpmath.workdps(_DIGITS):
            for instruction in program.instructions:
                values.append(compute(instruction))  # noqa: PERF401  later values need earlier ones
            # Adding zero turns a negative zero into zero.
            outputs = tuple(tuple(float(read(ref)) + 0.0 for ref in refs) for refs in program.outputs)
    except (ArithmeticError, ValueError, TypeError) as error:
        # Division by zero, and what mpmath raises or returns outside a function's domain.
        raise _fail_value(program, repr(error)) from error
    if not all(np.isfinite(values).all() for values in outputs):
        raise _fail_value(program, "an output is not finite")
    return outputs


def _draw(port: Port, rng: np.random.Generator) -> tuple[float, ...]:
    reach = _RANGES.get(port.name.removesuffix("r"), 1.0)
    # Three decimals: short to print, and exact in what they say.
    return tuple(float(v) for v in np.round(rng.uniform(-reach, reach, port.size), 3))


def _call(function: ca.Function, program: Program, inputs: Sequence[Sequence[float]]) -> list[FloatArray]:
    def shape(port: Port, values: Sequence[float]) -> FloatArray:
        return np.reshape(values, (port.shape[0], -1)) if values else np.zeros((0, 1))

    arguments = [shape(port, values) for port, values in zip(program.spec.inputs, inputs, strict=True)]
    results = function.call([ca.DM(argument) for argument in arguments])
    return [np.asarray(result.full()).ravel() for result in results]


def _find_candidates(
    card: ModelCard, functions: Sequence[ca.Function], programs: Sequence[Program], rng: np.random.Generator
) -> list[tuple[float, ...]]:
    """Return values of beta to try: the known ones if they are fit, then the best of random ones.

    Random base parameters belong to no robot, and the values in a robot file may leave a joint without
    inertia: a mass matrix close to a singular one would make the forward dynamics a test of rounding.
    """
    stated = [parameter.value for parameter in card.beta]
    known = tuple(float(value) for value in stated if value is not None)
    beta = Port(name=card.vector, shape=(len(stated),), unit="", meaning="", shared=True)
    draws = [_draw(beta, rng) for _ in range(_DRAWS)]
    given = [known] if len(known) == len(stated) else []
    found = [k for k, program in enumerate(programs) if program.spec.name == "mass_matrix"]
    if not found:
        return [*given, *draws][:_ATTEMPTS]
    function, program = functions[found[0]], programs[found[0]]
    states = [_draw(program.spec.inputs[0], rng) for _ in range(4)]

    def find_condition(values: tuple[float, ...]) -> float:
        matrices = [_call(function, program, (q, values))[0].reshape(card.size, -1) for q in states]
        if not all(np.isfinite(matrix).all() for matrix in matrices):
            return np.inf
        return max(float(np.linalg.cond(matrix)) for matrix in matrices)

    kept = [values for values in given if find_condition(values) < _CONDITION]
    return [*kept, *sorted(draws, key=find_condition)][:_ATTEMPTS]


def _find_springs(card: ModelCard) -> dict[str, tuple[float, ...]]:
    """Return h: random numbers would be no springs, and have no inverse."""
    if not card.springs:
        return {}
    values = (
        _STIFFNESSES[parameter.name.startswith("k0")] if parameter.value is None else parameter.value
        for parameter in card.springs
    )
    return {"h": tuple(values)}


def _check(
    function: ca.Function,
    program: Program,
    inputs: Sequence[Sequence[float]],
    exact: Sequence[Sequence[float]],
) -> None:
    for port, mine, theirs in zip(program.spec.outputs, exact, _call(function, program, inputs), strict=True):
        largest = float(np.max(np.abs(mine), initial=0.0))
        scale = FLOOR if largest < NEGLIGIBLE else largest
        # What is not finite there fails the comparison.
        with np.errstate(invalid="ignore"):
            error = float(np.max(np.abs(np.array(mine) - theirs), initial=0.0)) / scale
        if not error <= _AGREEMENT:
            text = (
                f"function {program.spec.name!r}, output {port.name!r}: the program and CasADi differ by "
                f"{error:.1e} of the largest element, allowed is {_AGREEMENT:.0e}"
            )
            raise GenerationError(Notice(code="codegen.disagrees", text=text))


def _build(
    functions: Sequence[ca.Function],
    programs: Sequence[Program],
    shared_values: Mapping[str, tuple[float, ...]],
    options: GenerateOptions,
) -> tuple[Reference, ...]:
    rng = np.random.default_rng(options.seed)
    shared = dict(shared_values)
    references = []
    for function, program in zip(functions, programs, strict=True):
        columns: list[list[tuple[float, ...]]] = [[] for _ in program.spec.inputs]
        results: list[list[tuple[float, ...]]] = [[] for _ in program.spec.outputs]
        for _ in range(options.states):
            for port, column in zip(program.spec.inputs, columns, strict=True):
                if port.shared and port.name not in shared:
                    shared[port.name] = _draw(port, rng)
                column.append(shared[port.name] if port.shared else _draw(port, rng))
            inputs = [column[-1] for column in columns]
            outputs = _evaluate(program, inputs)
            _check(function, program, inputs, outputs)
            for result, values in zip(results, outputs, strict=True):
                result.append(values)
        kept = (c[:1] if port.shared else c for port, c in zip(program.spec.inputs, columns, strict=True))
        references.append(Reference(inputs=tuple(map(tuple, kept)), outputs=tuple(map(tuple, results))))
    return tuple(references)


def build_references(
    card: ModelCard, functions: Sequence[ca.Function], programs: Sequence[Program], options: GenerateOptions
) -> tuple[Reference, ...]:
    """Return inputs and outputs of every function at random states.

    Raises:
        GenerationError: a program does not compute what CasADi computes, or has no value anywhere.
    """
    rng = np.random.default_rng((options.seed, 1))
    failures = []
    for beta in _find_candidates(card, functions, programs, rng):
        try:
            shared = {card.vector: beta, **_find_springs(card)}
            return _build(functions, programs, shared, options)
        except GenerationError as error:
            failures.append(error)
    raise failures[-1]
