"""Reference values for self-tests, the same digits on every machine.

Input: programs and the CasADi functions built from them. Output: random states, which all functions share,
and what the outputs are there: each element at the first states, and at all states sums of the elements
with weights, which hold a table small. The values come from the programs in 50-digit arithmetic; each must
agree with what CasADi itself computes.

Supported: all operations of `Op`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Context, Decimal, localcontext

import casadi as ca
import numpy as np

from symid.arrays import FloatArray
from symid.codegen.exact_values import DIGITS, Exact, compute_exact, find_no_value
from symid.codegen.functions import ModelCard
from symid.codegen.instructions import Program
from symid.codegen.options import GenerateOptions
from symid.codegen.sample_parameters import find_amplification, find_parameters
from symid.codegen.sample_states import LIMITS, States, find_angles, find_values
from symid.errors import GenerationError, Notice

__all__ = ["FLOOR", "NEGLIGIBLE", "WEIGHTS", "WHOLE", "Reference", "Rows", "build_references"]

# Errors are measured by the largest value of an output; one below NEGLIGIBLE is zero but for rounding, and
# FLOOR stands in for its size.
NEGLIGIBLE = 1e-12
FLOOR = 0.01
WHOLE = 2
"""At how many states every element is given."""
WEIGHTS = ((97, 31), (101, 37))
"""Modulus m and step s of a sum: element i weighs m + (s i mod m), between m and 2 m.

No two of 97 x 101 elements weigh the same in both sums, so that two that changed places show; divided by
m, an error of one element shows with its full size at least.
"""
Rows = Sequence[Sequence[float]]
"""A row a state."""

_AGREEMENT = 1e-8
# In place of stiffnesses that the robot file does not know: k0, and those of stops.
_STIFFNESSES = {True: 100.0, False: 20.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Inputs and outputs of one function, by port.

    Attributes:
        tables: names of the inputs; equal ones have equal values, in whichever function.
        inputs: a row a state; a shared input has one row.
        whole: every element, a row for each of the first states.
        sums: the sums of `WEIGHTS`, a row a state.
        scales: the largest element at any state, `FLOOR` for one that is zero but for rounding; times the
            amplification of the forward dynamics.
    """

    tables: tuple[str, ...]
    inputs: tuple[tuple[tuple[float, ...], ...], ...]
    whole: tuple[tuple[tuple[float, ...], ...], ...]
    sums: tuple[tuple[tuple[float, ...], ...], ...]
    scales: tuple[float, ...]


def _find_springs(card: ModelCard) -> dict[str, tuple[float, ...]]:
    """Return h: random numbers would be no springs, and have no inverse."""
    if not card.springs:
        return {}
    values = (
        _STIFFNESSES[parameter.name.startswith("k0")] if parameter.value is None else parameter.value
        for parameter in card.springs
    )
    return {"h": tuple(values)}


def _find_scales(values: FloatArray) -> FloatArray:
    """Return the largest element in each row, `FLOOR` where it is zero but for rounding."""
    largest = np.abs(values).max(axis=1, initial=0.0)
    scales: FloatArray = np.where(largest < NEGLIGIBLE, FLOOR, largest)
    return scales


def _check(program: Program, exact: Sequence[FloatArray], theirs: Sequence[FloatArray]) -> None:
    for port, mine, other in zip(program.spec.outputs, exact, theirs, strict=True):
        # What is not finite there fails the comparison.
        with np.errstate(invalid="ignore"):
            errors = np.abs(mine - other).max(axis=1, initial=0.0) / _find_scales(mine)
        error = float(np.max(errors, initial=0.0))
        if not error <= _AGREEMENT:
            text = (
                f"function {program.spec.name!r}, output {port.name!r}: the program and CasADi differ by "
                f"{error:.1e} of the largest element, allowed is {_AGREEMENT:.0e}"
            )
            raise GenerationError(Notice(code="codegen.disagrees", text=text))


def _to_exact(values: FloatArray) -> Exact:
    exact = np.empty(values.shape, dtype=object)
    exact[...] = np.vectorize(Decimal, otypes=[object])(values) if values.size else exact
    return exact


def _to_rows(values: FloatArray) -> tuple[tuple[float, ...], ...]:
    # Adding zero turns a negative zero into zero.
    return tuple(tuple(row) for row in (np.atleast_2d(values) + 0.0).tolist())


def _add_up(exact: Exact) -> FloatArray:
    """Return the weighted sums of every row, (states, sums), rounded once."""
    places = np.arange(exact.shape[1])
    weights = [[int(w) for w in modulus + step * places % modulus] for modulus, step in WEIGHTS]
    with localcontext(Context(prec=DIGITS)):
        sums = [exact @ np.array(row, dtype=object) for row in weights]
    return np.array(sums, dtype=np.float64).T


def _build_one(function: ca.Function, program: Program, states: States) -> Reference:
    inputs = states.find_all(program)
    exact = compute_exact(program, [_to_exact(values) for values in inputs], states.count)
    outputs = [values.astype(np.float64) for values in exact]
    if not all(np.isfinite(values).all() for values in outputs):
        raise find_no_value(program, "an output is not finite")
    amplification = find_amplification(function, program, states)
    _check(program, outputs, find_values(function, program, inputs, states.count))
    return Reference(
        tables=states.find_tables(program),
        inputs=tuple(map(_to_rows, inputs)),
        whole=tuple(_to_rows(values[:WHOLE]) for values in outputs),
        sums=tuple(_to_rows(_add_up(values)) for values in exact),
        scales=tuple(amplification * float(_find_scales(values.reshape(1, -1))[0]) for values in outputs),
    )


def build_references(
    card: ModelCard, functions: Sequence[ca.Function], programs: Sequence[Program], options: GenerateOptions
) -> tuple[Reference, ...]:
    """Return inputs and outputs of every function at random states.

    Raises:
        GenerationError: a program does not compute what CasADi computes, or has no value anywhere.
    """
    failures = []
    angles, limit = find_angles(programs), LIMITS[options.precision]
    drawn = States(count=options.states, seed=options.seed, shared={}, angles=angles, limit=limit)
    for beta in find_parameters(card, functions, programs, drawn):
        shared = {card.vector: beta, **_find_springs(card)}
        states = replace(drawn, shared=shared)
        try:
            pairs = zip(functions, programs, strict=True)
            return tuple(_build_one(function, program, states) for function, program in pairs)
        except GenerationError as error:
            failures.append(error)
    raise failures[-1]
