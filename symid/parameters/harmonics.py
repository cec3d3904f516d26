"""Independent functions of a robot's coordinates, and polynomials written in them.

Input: polynomials in sines, cosines, positions of joints. Output: {function: coefficient}; the functions are
linearly independent, so that a sum of them vanishes for all states only if every coefficient does.

A coordinate that moves one joint has the functions s^a c^b q^e (a < 2). Where several joints follow one
coordinate their sines and cosines are not independent: products are written as q^e cos(w q) and q^e sin(w q)
with exact frequencies w, the sums of the multipliers.

Supported: any multipliers, revolute and prismatic joints on one coordinate.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

from sympy import QQ
from sympy.polys.domains.domain import Domain
from sympy.polys.rings import PolyElement

from symid.algebra.exact import ExactAlgebra, find_generators, lift_number
from symid.robot.description import Robot

__all__ = ["Basis", "Function", "build_basis", "find_power", "split_polynomial"]

Part = tuple[Fraction, Fraction, int]
"""Function of one coordinate: for one joint (a, b, e) of s^a c^b q^e; for several (frequency, odd, e)."""
Function = tuple[tuple[Part, ...], tuple[int, ...]]
"""A part for each coordinate, and the exponents of their velocities."""

_Wave = dict[tuple[Fraction, bool], Fraction]
"""Amplitudes of cos(w q), sin(w q): {(w, whether sine): amplitude} with w >= 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Generator:
    """What a generator of the ring is: `kind` s, c, q of a joint, dq of a coordinate, or a symbol."""

    kind: str
    coordinate: int
    multiplier: Fraction


@dataclass(frozen=True, slots=True, kw_only=True)
class Basis:
    """How the generators of a ring are read; `shared` says which coordinates move several joints."""

    field: Domain
    domain: Domain
    generators: tuple[_Generator, ...]
    symbols: tuple[Any, ...]
    shared: tuple[bool, ...]


def build_basis(robot: Robot, algebra: ExactAlgebra, field: Domain) -> Basis:
    """Return the functions that polynomials of `algebra` are written in, coefficients in `field`."""
    known = find_generators(field)
    generators, symbols = [], []
    for name in map(str, algebra.ring.symbols):
        kind = name.rstrip("0123456789")
        if name in known:
            generators.append(_Generator(kind="symbol", coordinate=-1, multiplier=Fraction(1)))
        else:
            ((position, multiplier),) = robot.transmission[int(name[len(kind) :]) - 1]
            generators.append(_Generator(kind=kind, coordinate=position, multiplier=multiplier))
        symbols.append(known.get(name))
    moved = [row[0][0] for row in robot.transmission[: robot.size]]
    return Basis(
        field=field,
        domain=algebra.ring.domain,
        generators=tuple(generators),
        symbols=tuple(symbols),
        shared=tuple(moved.count(position) > 1 for position in range(robot.freedom)),
    )


def find_power(basis: Basis, coordinate: int = -1, exponent: int = 0) -> Function:
    """Return the function q^exponent of a coordinate; the constant function by default."""
    zero = Fraction(0)
    parts = [(zero, zero, exponent if position == coordinate else 0) for position in range(len(basis.shared))]
    return tuple(parts), (0,) * len(basis.shared)


def _multiply(wave: _Wave, frequency: Fraction, *, sine: bool) -> _Wave:
    """Return the wave times cos(w q) or sin(w q), by the sums and differences of frequencies."""
    result: _Wave = {}

    def put(w: Fraction, odd: bool, amplitude: Fraction) -> None:  # noqa: FBT001  an inner helper
        if odd and w < 0:
            amplitude = -amplitude
        if not (odd and w == 0):
            key = (abs(w), odd)
            result[key] = result.get(key, Fraction(0)) + amplitude

    for (w, odd), amplitude in wave.items():
        half = amplitude / 2
        if sine and odd:
            put(w - frequency, False, half)
            put(w + frequency, False, -half)
        elif sine:
            put(w + frequency, True, half)
            put(w - frequency, True, -half)
        elif odd:
            put(w + frequency, True, half)
            put(w - frequency, True, half)
        else:
            put(w + frequency, False, half)
            put(w - frequency, False, half)
    return {key: amplitude for key, amplitude in result.items() if amplitude}


@lru_cache(maxsize=4096)
def _list_parts(
    factors: tuple[tuple[_Generator, int], ...],
    shared: bool,  # noqa: FBT001  a cached function is called by position
) -> tuple[tuple[Part, Fraction], ...]:
    """Return the functions of one coordinate that a product of its generators is the sum of."""
    if not shared:
        exponents = {generator.kind: exponent for generator, exponent in factors}
        a, b, e = (exponents.get(kind, 0) for kind in ("s", "c", "q"))
        return (((Fraction(a), Fraction(b), e), Fraction(1)),)
    wave: _Wave = {(Fraction(0), False): Fraction(1)}
    power, scale = 0, Fraction(1)
    for generator, exponent in factors:
        if generator.kind == "q":
            power += exponent
            scale *= generator.multiplier**exponent
            continue
        for _ in range(exponent):
            wave = _multiply(wave, generator.multiplier, sine=generator.kind == "s")
    return tuple(
        ((frequency, Fraction(odd), power), scale * amplitude) for (frequency, odd), amplitude in wave.items()
    )


def _expand(basis: Basis, monomial: Sequence[int]) -> dict[Function, Fraction]:
    """Return a product of generators, symbols apart, in the functions of the basis."""
    coordinates = range(len(basis.shared))
    rates = [0] * len(basis.shared)
    factors: list[list[tuple[_Generator, int]]] = [[] for _ in coordinates]
    for generator, exponent in zip(basis.generators, monomial, strict=True):
        if exponent and generator.kind == "dq":
            rates[generator.coordinate] += exponent
        elif exponent and generator.kind != "symbol":
            factors[generator.coordinate].append((generator, exponent))
    total: dict[tuple[Part, ...], Fraction] = {(): Fraction(1)}
    for position in coordinates:
        total = {
            (*parts, part): value * share
            for parts, value in total.items()
            for part, share in _list_parts(tuple(factors[position]), basis.shared[position])
        }
    return {(parts, tuple(rates)): value for parts, value in total.items()}


def split_polynomial(basis: Basis, polynomial: PolyElement) -> Mapping[Function, Any]:
    """Return the coefficients of `polynomial` over independent functions, as elements of the field."""
    field = basis.field
    result: dict[Function, Any] = {}
    for monomial, coefficient in polynomial.items():
        value = lift_number(coefficient, basis.domain, field)
        for symbol, exponent in zip(basis.symbols, monomial, strict=True):
            if symbol is not None and exponent:
                value *= symbol**exponent
        for function, share in _expand(basis, monomial).items():
            part = value if share == 1 else value * field.convert(QQ(share.numerator, share.denominator))
            result[function] = result.get(function, field.zero) + part
    return {function: value for function, value in result.items() if value}
