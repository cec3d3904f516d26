"""Reference values for self-tests, the same digits on every machine.

Programs and the CasADi functions built from them -> `Reference`: random states, which all functions share,
each output element at the first states, and weighted sums of the elements at all states. Values come from the
programs in 50-digit arithmetic; each must agree with what CasADi computes in doubles. With random beta, mass
matrices come near to singular ones: a multiple of beta with a positive definite M (alternating projections)
    M_k <- V max(L, 1) V^T of M(q_k, beta) = V L V^T,  beta <- argmin sum_k |M(q_k, beta) - M_k|^2
is added until M is well conditioned at every state. Of several beta the first is taken with which rounding
cannot fail exact code; if there is none, the one with the least rounding, and its bound is allowed for.

Supported: all operations of `Op`; base and standard parameters.
Not supported: values that are not finite (refused); inputs that are matrices; physical consistency of beta.
"""

import decimal
import math
import operator
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Context, Decimal, DecimalException, localcontext
from functools import lru_cache, partial
from typing import Any, TypeVar

import casadi as ca
import mpmath
import numpy as np
import numpy.typing as npt

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard, Port
from symid.codegen.programs import ARITHMETIC, Instruction, Op, Program
from symid.errors import GenerationError, Notice
from symid.options import GenerateOptions

DIGITS = 50
_MORE_DIGITS = 60
_TRAPS = [decimal.DivisionByZero, decimal.InvalidOperation, decimal.Overflow]
_DECIMAL_CONTEXT = Context(prec=DIGITS, traps=_TRAPS)

DecimalArray = npt.NDArray[np.object_]
V = TypeVar("V")
_AGREEMENT = 1e-8
_LONG = 60_000
"""Instructions of all functions together: robots of up to about fifteen joints have fewer."""
_CONVERT_TO_DECIMALS = np.vectorize(Decimal, otypes=[object])
_ATTEMPTS = 4
_PROJECTIONS = 30
_MULTIPLES = (0.0, 4.0, 8.0, 16.0, 64.0)
_GOOD_CONDITION = 1e2
_LARGEST_CONDITION = 1e3
_LARGEST_VALUE = 1e3
_CUTS = (1e-9, 1e-6, 1e-4, 1e-3)
# Where rounding to thousandths has its edges: not at the simple fractions that exact solutions are made of.
_ROUNDING_EDGE = 0.137
# Of matrices that beta is chosen by (18 joints still have all hundred states), and states at least.
_MOST_NUMBERS, _FEWEST_PROJECTED = 2**22, 8
_ANGLE_OPS = frozenset({Op.SIN, Op.COS})

PER_UNIT = 1000
"""Inputs are whole numbers of thousandths, which are short to print."""

_INPUT_RANGES = {"q": 3.0, "dq": 2.0, "ddq": 5.0, "tau": 20.0}
_INPUT_RANGES |= {"dddq": 20.0, "ddddq": 100.0, "phi": 0.02, "P": 0.02, "tau_J": 20.0, "Q": 5.0}
_INPUT_RANGES |= {"way": 0.003, "z": 0.003, "ddq_a": 5.0, "tau_a": 20.0, "tau_p": 5.0}
ANGLE_LIMITS = {"double": 1e6, "float": 1e4}
"""Up to which angle the generated code takes whole turns off by itself, in rad."""

# Ranges of far angles, in rad and then as parts of the limit, within it and beyond.
_FAR_ANGLES = (*[(47.0, 53.0)] * 3, *[(0.89, 0.91)] * 2, *[(1.1, 1.5)] * 2)
# Single precision holds eighths up to 2^21.
_EIGHTHS = 8.0
# Far states are so many apart: in other lanes of a vector, with near ones beside.
_APART = 7
_FEWEST = 60

InputElements = frozenset[tuple[str, int, int]]
"""Elements of inputs: the port's name, its size, the number of the element."""
# Errors are measured by the largest value of an output; one below NEGLIGIBLE is zero but for rounding, and
# FLOOR replaces its size.
NEGLIGIBLE = 1e-12
FLOOR = 0.01
WHOLE = 2
"""Number of states at which every element is given."""
WEIGHTS = ((97, 31), (101, 37))
"""Modulus m and step s of a sum: element i weighs m + (s i mod m), between m and 2 m.

No two of 97 x 101 elements weigh the same in both sums, so that swapped elements show; divided by m, an error
of one element shows with its full size at least.
"""
ReferenceRows = Sequence[Sequence[float]]
"""A row a state."""

TOLERANCES = {"double": "1e-12", "float": "2e-5"}
"""Sound code errs by a few units of the last place, 1e-16 or 6e-8, times the condition of what it solves; a
wrong sign or place, or a wrong digit in a constant, errs by much more."""


@lru_cache(maxsize=1 << 16)
def _call_mpmath(name: str, *operands: Decimal) -> Decimal:
    """Return a function of mpmath; equal sines of many programs are computed once."""
    with mpmath.workdps(_MORE_DIGITS):
        value = getattr(mpmath, name)(*(mpmath.mpf(str(operand)) for operand in operands))
        # A complex value, from outside a function's domain, is no decimal number.
        return +Decimal(mpmath.nstr(value, _MORE_DIGITS))


_TRUTH = (Decimal(0), Decimal(1))
_ELEMENTWISE: dict[Op, tuple[int, Callable[..., Decimal]]] = {
    **{op: (1, partial(_call_mpmath, op.value)) for op in (Op.SIN, Op.COS, Op.EXP, Op.TANH)},
    Op.POWER: (2, partial(_call_mpmath, "power")),
    Op.ABS: (1, abs),
    Op.SIGN: (1, lambda a: _TRUTH[a > 0] - _TRUTH[a < 0]),
    Op.LESS: (2, lambda a, b: _TRUTH[a < b]),
    Op.LESS_EQUAL: (2, lambda a, b: _TRUTH[a <= b]),
    Op.MAXIMUM: (2, max),
    Op.MINIMUM: (2, min),
}
# NumPy walks the states in C; what depends on shared inputs alone stays one number.
_DECIMAL_RULES: dict[Op, Callable[..., Any]] = {
    **ARITHMETIC,
    **{op: np.frompyfunc(rule, count, 1) for op, (count, rule) in _ELEMENTWISE.items()},
}


def _build_no_value_error(program: Program, why: str) -> GenerationError:
    text = f"function {program.spec.name!r} has no value at a state of the self-test: {why}"
    return GenerationError(Notice(code="codegen.no-reference", text=text))


def _run(
    program: Program, evaluate: Callable[[Instruction, list[tuple[V, bool]]], V]
) -> Iterator[tuple[int, int, V, bool]]:
    """Yield port, element, value of all outputs, and whether its sign is turned, as soon as they are there.

    `evaluate` computes an instruction from its operands and whether their signs are turned. A long program
    holds few values at once.
    """
    last = list(range(len(program.instructions) + 1))
    for number, one in enumerate(program.instructions, start=1):
        for operand in one.operands:
            last[operand] = number
    outputs: dict[int, list[tuple[int, int, int]]] = {}
    for port, refs in enumerate(program.outputs):
        for element, ref in enumerate(refs):
            outputs.setdefault(abs(ref), []).append((port, element, ref))
    over: dict[int, list[int]] = {}
    for number, end in enumerate(last[1:], start=1):
        over.setdefault(end, []).append(number)
    values: dict[int, V] = {}
    for number, one in enumerate(program.instructions, start=1):
        refs = () if one.op is Op.INPUT else one.args
        values[number] = evaluate(one, [(values[abs(ref)], ref < 0) for ref in refs])
        for port, element, ref in outputs.get(number, ()):
            yield port, element, values[number], ref < 0
        for old in over.get(number, ()):
            del values[old]


def compute_exact_outputs(program: Program, inputs: Sequence[DecimalArray], count: int) -> list[DecimalArray]:
    """Return the elements per port, (count, size); a GenerationError where a state has no value."""

    def evaluate(one: Instruction, operands: list[tuple[Any, bool]]) -> Any:  # noqa: ANN401 - decimals
        if one.op is Op.INPUT:
            return inputs[one.args[0]][..., one.args[1]]
        if one.op is Op.CONSTANT:
            return Decimal(one.constant)
        return _DECIMAL_RULES[one.op](*(-value if turned else value for value, turned in operands))

    outputs = [np.empty((count, len(refs)), dtype=object) for refs in program.outputs]
    try:
        with localcontext(_DECIMAL_CONTEXT):
            for port, element, value, turned in _run(program, evaluate):
                outputs[port][:, element] = -value if turned else value
    except (DecimalException, ArithmeticError, ValueError, TypeError) as error:
        # Division by zero, and arguments outside a function's domain.
        raise _build_no_value_error(program, repr(error)) from error
    return outputs


def _list_input_uses(program: Program) -> tuple[InputElements, InputElements]:
    """Return the elements whose sines or cosines `program` takes, and those that it uses otherwise."""
    taken, otherwise = set[tuple[str, int, int]](), set[tuple[str, int, int]]()
    elements: dict[int, tuple[str, int, int]] = {}
    for number, instruction in enumerate(program.instructions, start=1):
        if instruction.op is Op.INPUT:
            port = program.spec.inputs[instruction.args[0]]
            elements[number] = (port.name, port.size, instruction.args[1])
            continue
        found = taken if instruction.op in _ANGLE_OPS else otherwise
        found.update(elements[number] for number in instruction.operands if number in elements)
    given = (abs(ref) for refs in program.outputs for ref in refs)
    otherwise.update(elements[ref] for ref in given if ref in elements)
    return frozenset(taken), frozenset(otherwise)


def list_angle_inputs(programs: Sequence[Program]) -> InputElements:
    """Return the elements of which a program takes only the sine and the cosine."""
    return frozenset().union(*(taken - other for taken, other in map(_list_input_uses, programs)))


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleStates:
    """The inputs at `count` states: `shared` ones by name, others drawn by name and size, with `seed`.

    `angles` are inputs that are large at a few states, where there are enough of them, see
    `list_angle_inputs`; `limit` see `ANGLE_LIMITS`, in rad.
    """

    count: int
    seed: int
    shared: Mapping[str, tuple[float, ...]]
    angles: InputElements = frozenset()
    limit: float = ANGLE_LIMITS["double"]

    def find(self, port: Port, near: InputElements = frozenset()) -> FloatArray:
        """Return the port's values: (count, size), or (size,) of a shared port; `near` ones never large."""
        if port.name in self.shared:
            return np.array(self.shared[port.name], dtype=np.float64)
        # A generator a name: the inputs of a function do not depend on which others there are.
        rng = np.random.default_rng((self.seed, zlib.crc32(port.name.encode()), port.size))
        reach = _INPUT_RANGES.get(port.name.removesuffix("r"), 1.0)
        drawn: FloatArray = np.rint(rng.uniform(-reach, reach, (self.count, port.size)) * PER_UNIT) / PER_UNIT
        if port.shared:
            first: FloatArray = drawn[0]
            return first
        columns = [k for k in range(port.size) if (port.name, port.size, k) in self.angles - near]
        if columns and self.count >= _FEWEST:
            for k, (low, high) in enumerate(_FAR_ANGLES):
                unit = 1.0 if low > 1.5 else self.limit
                size = np.rint(rng.uniform(low * unit, high * unit, len(columns)) * _EIGHTHS) / _EIGHTHS
                drawn[self.count - 1 - _APART * k, columns] = size * rng.choice((-1.0, 1.0), len(columns))
        return drawn

    def compute_all(self, program: Program) -> tuple[tuple[str, ...], list[FloatArray]]:
        """Return the values of all inputs of `program`, and names of them: equal names, equal values."""
        _, otherwise = _list_input_uses(program)
        # All of a port stays near, if the program needs one of its elements to.
        ports = {element[:2] for element in otherwise & self.angles}
        near = frozenset(element for element in self.angles if element[:2] in ports)
        names, values = [], []
        for port in program.spec.inputs:
            own = f"_{port.size}_near" if (port.name, port.size) in ports else f"_{port.size}"
            names.append(port.name if port.shared else port.name + own)
            values.append(self.find(port, near))
        return tuple(names), values


def evaluate_casadi(
    function: ca.Function, program: Program, inputs: Sequence[FloatArray], count: int
) -> list[FloatArray]:
    """Return CasADi's outputs (count, size), row-major; inputs (count, size), or (size,) where shared."""
    ports = zip(program.spec.inputs, inputs, strict=True)
    # CasADi takes and gives the samples side by side.
    given = [ca.DM(np.broadcast_to(values, (count, port.size)).T) for port, values in ports]
    outputs = []
    for port, result in zip(program.spec.outputs, function.map(count).call(given), strict=True):
        values: FloatArray = np.asarray(result.full()).reshape(result.shape[0], count, -1)
        outputs.append(values.transpose(1, 0, 2).reshape(count, port.size))
    return outputs


def _project_positive_definite(columns: FloatArray) -> FloatArray:
    """Return beta of a positive definite mass matrix at every state, as far as there is one."""
    # `columns` (states, n, n, b) are matrices of unit vectors. Directions of beta that hardly move the matrix
    # would take huge values: such are cut off until none is.
    states, size, _, count = columns.shape
    # The upper triangle has all; an element that the lower one has too weighs twice in a sum of squares.
    upper = np.triu_indices(size)
    weights = np.where(upper[0] == upper[1], 1.0, np.sqrt(2.0))
    base, small = np.linalg.qr((weights[:, None] * columns[:, *upper]).reshape(-1, count))
    left, singular, right = np.linalg.svd(small)

    def fit(matrices: FloatArray) -> FloatArray:
        """Return the coefficients, of `left`, of the beta next to matrices (states, n, n)."""
        fitted: FloatArray = left.T @ (base.T @ (weights * matrices[:, *upper]).ravel())
        return fitted

    for cut in _CUTS:
        kept = singular > cut * singular[0]
        inverse = right.T * np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)
        beta = inverse @ fit(np.broadcast_to(np.eye(size), (states, size, size)))
        for _ in range(_PROJECTIONS):
            values, vectors = np.linalg.eigh(columns @ beta)
            raised = (vectors * np.maximum(values, 1.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
            beta = inverse @ fit(raised)
        if np.abs(beta).max() <= _LARGEST_VALUE:
            break
    return np.asarray(beta, dtype=np.float64)


def _compute_condition(matrices: FloatArray) -> float:
    """Return the worst condition of symmetric matrices (states, n, n), infinite where one is singular."""
    if not np.isfinite(matrices).all():
        return np.inf
    sizes = np.abs(np.linalg.eigvalsh(matrices))
    least, most = sizes.min(axis=-1, initial=np.inf), sizes.max(axis=-1, initial=0.0)
    return float(np.max(np.where(least > 0.0, most / np.where(least > 0.0, least, 1.0), np.inf)))


def choose_parameters(
    card: ModelCard, functions: Sequence[ca.Function], programs: Sequence[Program], states: SampleStates
) -> Iterator[tuple[float, ...]]:
    """Yield values of beta to try: those of the robot file if they are good, then others.

    The mass matrix must be well conditioned at `states`; without that function, beta is random.
    """
    stated = [parameter.value for parameter in card.beta]
    known = np.array([value for value in stated if value is not None])
    given = [known] if len(known) == len(stated) and np.isfinite(known).all() else []
    drawn = SampleStates(count=_ATTEMPTS, seed=states.seed, shared={})
    draws = drawn.find(Port(name=card.vector, shape=(len(card.beta),), unit="", meaning=""))
    masses = [
        (function, program)
        for function, program in zip(functions, programs, strict=True)
        if program.spec.name == "mass_matrix" and card.vector in {port.name for port in program.spec.inputs}
    ]
    if not (stated and masses):
        yield from (tuple(beta.tolist()) for beta in (*given, *draws))
        return
    function, program = masses[0]
    ports = program.spec.inputs
    _, inputs = replace(states, shared={card.vector: (0.0,) * len(card.beta)}).compute_all(program)
    vector = [port.name for port in ports].index(card.vector)

    def evaluate(beta: FloatArray, count: int) -> FloatArray:
        """Return the mass matrices (states, n, n) at the first states."""
        own = [v if port.shared else v[:count] for port, v in zip(ports, inputs, strict=True)]
        own[vector] = beta
        (matrices,) = evaluate_casadi(function, program, own, count)
        return matrices.reshape(-1, card.size, card.size)

    for beta in given:
        if _compute_condition(evaluate(beta, states.count)) < _LARGEST_CONDITION:
            yield tuple(beta.tolist())
    # What all states of a large robot need would not fit into memory; a part of them determines beta.
    few = max(_FEWEST_PROJECTED, _MOST_NUMBERS // (card.size**2 * len(stated)))
    units = np.eye(len(stated))
    columns = np.stack([evaluate(unit, min(states.count, few)) for unit in units], axis=-1)
    inertia = _project_positive_definite(columns)
    for draw in draws:
        for multiple in _MULTIPLES:
            beta = np.floor((draw + multiple * inertia) * PER_UNIT + _ROUNDING_EDGE) / PER_UNIT + 0.0
            if _compute_condition(evaluate(beta, states.count)) < _GOOD_CONDITION:
                break
        yield tuple(beta.tolist())


_ONE = 1.0
# By operation: its value in doubles, its derivatives by the operands (from these and the value), and its own
# rounding in units of 2^-53 (double) or 2^-24 (float); own sines err by less than 4 units in the last place.
_FLOAT_RULES: Mapping[Op, tuple[Callable[..., Any], Callable[..., tuple[Any, ...]], float]] = {
    Op.ADD: (ARITHMETIC[Op.ADD], lambda *_: (_ONE, _ONE), 1.0),
    Op.SUB: (ARITHMETIC[Op.SUB], lambda *_: (_ONE, _ONE), 1.0),
    Op.MUL: (ARITHMETIC[Op.MUL], lambda a, b, _: (b, a), 1.0),
    Op.DIV: (ARITHMETIC[Op.DIV], lambda _, b, y: (1.0 / b, y / b), 1.0),
    Op.SIN: (np.sin, lambda a, _: (np.cos(a),), 8.0),
    Op.COS: (np.cos, lambda a, _: (np.sin(a),), 8.0),
    Op.EXP: (np.exp, lambda _, y: (y,), 8.0),
    Op.TANH: (np.tanh, lambda _, y: (1.0 - y * y,), 8.0),
    Op.POWER: (np.power, lambda a, b, y: (b * y / a, y * np.log(np.abs(a))), 8.0),
    Op.ABS: (np.abs, lambda *_: (1.0,), 0.0),
    Op.SIGN: (np.sign, lambda *_: (0.0,), 0.0),
    Op.LESS: (np.less, lambda *_: (0.0, 0.0), 0.0),
    Op.LESS_EQUAL: (np.less_equal, lambda *_: (0.0, 0.0), 0.0),
    Op.MAXIMUM: (np.maximum, lambda a, b, _: (a >= b, a < b), 0.0),
    Op.MINIMUM: (np.minimum, lambda a, b, _: (a <= b, a > b), 0.0),
}
_UNITS = {"double": 2.0**-53, "float": 2.0**-24}
_MOST_DEVIATIONS = 16.0
_Bounded = tuple[FloatArray, FloatArray, FloatArray]
"""A value, the sum of the effects of roundings on it, and the sum of their squares."""


def bound_rounding(
    program: Program, inputs: Sequence[FloatArray], precision: str
) -> list[tuple[FloatArray, FloatArray]]:
    """Return per output port the elements in doubles and bounds of their errors, each (size, states).

    Roundings are followed through the program to first order (running error analysis: Higham 2002, section
    3.3), as the sum of their largest effects and as the root of the sum of their squares. The bound is the
    first, or sixteen times the second where that is less: roundings are as good as independent.
    """
    unit, single = _UNITS[precision], precision == "float"
    count = max((len(port) for port in inputs if port.ndim > 1), default=1)
    outputs, errors = ([np.empty((len(refs), count)) for refs in program.outputs] for _ in range(2))

    def evaluate(one: Instruction, operands: list[tuple[_Bounded, bool]]) -> _Bounded:
        slopes: tuple[Any, ...] = ()
        if one.op is Op.INPUT:
            value = inputs[one.args[0]][..., one.args[1]]
            own = value.astype(np.float32) - value if single else 0.0 * value
        elif one.op is Op.CONSTANT:
            value = np.array(one.constant)
            own = value * unit if single else 0.0 * value
        else:
            compute, differentiate, units = _FLOAT_RULES[one.op]
            given = [-entry[0] if turned else entry[0] for entry, turned in operands]
            value = np.asarray(compute(*given), dtype=np.float64)
            own, slopes = units * unit * value, differentiate(*given, value)
        total, square = np.abs(own), own**2
        for slope, ((_, spread, squared), _) in zip(slopes, operands, strict=True):
            if slope is _ONE:
                total, square = total + spread, square + squared
            else:
                total, square = total + np.abs(slope) * spread, square + slope**2 * squared
        return value, total, square

    with np.errstate(all="ignore"):
        for port, element, (value, total, square), turned in _run(program, evaluate):
            outputs[port][element] = -value if turned else value
            errors[port][element] = np.minimum(total, _MOST_DEVIATIONS * np.sqrt(square))
    return list(zip(outputs, errors, strict=True))


def find_ease(program: Program, inputs: Sequence[FloatArray], precision: str) -> tuple[float, ...]:
    """Return by how much rounding alone may exceed the tolerance, per output, as a power of two from one on.

    Of single elements and of the sums of `WEIGHTS`, whose own rounding is that of doubles. In single
    precision it is one where doubles are safe: its tolerance was measured on such functions.
    """
    eases = []
    for values, errors in bound_rounding(program, inputs, precision):
        bound = float(np.max(errors, initial=0.0))
        for modulus, step in WEIGHTS:
            weights = (1.0 + step * np.arange(len(values)) % modulus / modulus).reshape(-1, 1)
            own = np.sqrt(len(values)) * _UNITS["double"] * np.abs(weights * values).sum(axis=0)
            spread = own + np.sqrt(((weights * errors) ** 2).sum(axis=0))
            bound = max(bound, float(np.max(spread, initial=0.0)))
        limit = float(TOLERANCES[precision]) * float(_compute_scales(values.reshape(1, -1))[0])
        eases.append(2.0 ** max(0, math.ceil(math.log2(bound / limit))) if 0.0 < bound < np.inf else 1.0)
    safe = precision == "float" and max(find_ease(program, inputs, "double"), default=1.0) == 1.0
    return (1.0,) * len(eases) if safe else tuple(eases)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Inputs and outputs of one function, by port.

    Attributes:
        tables: names of the inputs; equal names have equal values in all functions.
        inputs: a row a state; a shared input has one row.
        whole: every element, a row for each of the first states.
        sums: the sums of `WEIGHTS`, a row a state.
        scales: the largest element at any state, `FLOOR` for one that is zero but for rounding; times the
            power of two by which rounding alone may exceed the tolerance, see `find_ease`.
    """

    tables: tuple[str, ...]
    inputs: tuple[tuple[tuple[float, ...], ...], ...]
    whole: tuple[tuple[tuple[float, ...], ...], ...]
    sums: tuple[tuple[tuple[float, ...], ...], ...]
    scales: tuple[float, ...]


def _compute_scales(values: FloatArray) -> FloatArray:
    """Return the largest element in each row, `FLOOR` where it is zero but for rounding."""
    largest = np.abs(values).max(axis=1, initial=0.0)
    return np.asarray(np.where(largest < NEGLIGIBLE, FLOOR, largest))


def _convert_to_rows(values: FloatArray) -> tuple[tuple[float, ...], ...]:
    # Adding zero turns a negative zero into zero.
    return tuple(map(tuple, (np.atleast_2d(values) + 0.0).tolist()))


def _build_reference(
    function: ca.Function, program: Program, states: SampleStates, eases: tuple[float, ...]
) -> Reference:
    tables, inputs = states.compute_all(program)
    decimals = [_CONVERT_TO_DECIMALS(values) if values.size else values.astype(object) for values in inputs]
    exact = compute_exact_outputs(program, decimals, states.count)
    outputs = [values.astype(np.float64) for values in exact]
    if not all(np.isfinite(values).all() for values in outputs):
        raise _build_no_value_error(program, "an output is not finite")
    theirs = evaluate_casadi(function, program, inputs, states.count)
    for port, mine, other in zip(program.spec.outputs, outputs, theirs, strict=True):
        # A value of CasADi that is not finite fails the comparison.
        with np.errstate(invalid="ignore"):
            errors = np.abs(mine - other).max(axis=1, initial=0.0) / _compute_scales(mine)
        error = float(np.max(errors, initial=0.0))
        if not error <= _AGREEMENT:
            text = f"function {program.spec.name!r}, output {port.name!r}: the program and CasADi differ by "
            text += f"{error:.1e} of the largest element; the limit is {_AGREEMENT:.0e}"
            raise GenerationError(Notice(code="codegen.disagrees", text=text))
    sums = []
    # Of every row, rounded once.
    with localcontext(Context(prec=DIGITS)):
        for values in exact:
            places = np.arange(values.shape[1])
            weights = [[int(w) for w in modulus + step * places % modulus] for modulus, step in WEIGHTS]
            sums.append([values @ np.array(row, dtype=object) for row in weights])
    return Reference(
        tables=tables,
        inputs=tuple(map(_convert_to_rows, inputs)),
        whole=tuple(_convert_to_rows(values[:WHOLE]) for values in outputs),
        sums=tuple(_convert_to_rows(np.array(rows, dtype=np.float64).T) for rows in sums),
        scales=tuple(
            ease * float(_compute_scales(values.reshape(1, -1))[0])
            for ease, values in zip(eases, outputs, strict=True)
        ),
    )


def build_references(
    card: ModelCard, functions: Sequence[ca.Function], programs: Sequence[Program], options: GenerateOptions
) -> tuple[Reference, ...]:
    """Return inputs and outputs of every function at random states.

    GenerationError where a program does not compute what CasADi computes, or has no value anywhere.
    """
    # In place of unknown stiffnesses: random numbers would be no springs, and have no inverse.
    springs = {}
    if card.springs:
        usual = (100.0 if entry.name.startswith("k0") else 20.0 for entry in card.springs)
        pairs = zip(card.springs, usual, strict=True)
        springs = {"h": tuple(other if entry.value is None else entry.value for entry, other in pairs)}
    if any(spec.name == "friction_step" for spec in card.functions):
        # Bristles slip where dry friction is positive.
        springs |= {"f": tuple(1.0 if entry.value is None else entry.value for entry in card.friction)}
    angles, limit = list_angle_inputs(programs), ANGLE_LIMITS[options.precision]
    drawn = SampleStates(count=options.states, seed=options.seed, shared={}, angles=angles, limit=limit)
    eased: list[tuple[float, SampleStates, list[tuple[float, ...]]]] = []
    failures: list[GenerationError] = []
    # Bounds of long programs take long, and none is without some rounding: the first beta is as good.
    long = sum(len(program.instructions) for program in programs) > _LONG

    def list_attempts() -> Iterator[tuple[SampleStates, list[tuple[float, ...]]]]:
        """Yield states without much rounding; where it is large everywhere, those of the least of all."""
        for beta in choose_parameters(card, functions, programs, drawn):
            states = replace(drawn, shared={card.vector: beta, **springs})
            eases = [find_ease(one, states.compute_all(one)[1], options.precision) for one in programs]
            worst = max((max(ease, default=1.0) for ease in eases), default=1.0)
            if worst == 1.0 or long:
                yield states, eases
            if worst > 1.0:
                eased.append((worst, states, eases))
        for _, states, eases in sorted(eased, key=operator.itemgetter(0)):
            yield states, eases

    for states, eases in list_attempts():
        try:
            return tuple(
                _build_reference(function, program, states, ease)
                for function, program, ease in zip(functions, programs, eases, strict=True)
            )
        except GenerationError as error:
            failures.append(error)
    raise failures[-1]
