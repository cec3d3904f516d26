"""Linearly independent functions of a robot's coordinates, and polynomials written in them.

Polynomials in sines, cosines, positions of joints -> {function: coefficient}: a sum of the functions vanishes
for all states only if every coefficient does. A coordinate that moves one joint has the functions s^a c^b
q^e (a < 2); one that moves several has q^e cos(w q) and q^e sin(w q), w the sums of the multipliers.

Supported: any multipliers, revolute and prismatic joints on one coordinate.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import product

from sympy import QQ
from sympy.polys.domains.domain import Domain
from sympy.polys.rings import PolyElement

from symid.dynamics.exact_algebra import ExactAlgebra, Number, get_generators
from symid.robot import Robot

CoordinateFunction = tuple[int, int, int]
"""Function of one coordinate: for one joint (a, b, e) of s^a c^b q^e; for several (w, odd, e), with the
frequency w in the coordinate's own unit."""
BasisFunction = tuple[tuple[CoordinateFunction, ...], tuple[int, ...]]
"""A part for each coordinate, and the exponents of their velocities."""

_Wave = dict[tuple[int, bool], Fraction]
"""Amplitudes of cos(w q), sin(w q): {(w, whether sine): amplitude} with w >= 0."""
_Shares = tuple[tuple[BasisFunction, Number], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Generator:
    """What a generator of the ring is: `kind` s, c, q of a joint, dq of a coordinate, or a symbol.

    `frequency` is the joint's multiplier in the unit of its coordinate, `coordinate` a symbol's number.
    """

    kind: str
    coordinate: int
    multiplier: Fraction = Fraction(1)
    frequency: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class TrigonometricBasis:
    """How the generators of a ring are read; `shared` says which coordinates move several joints.

    `units` of coordinates: frequencies are whole multiples of their inverse. `memory` keeps products of
    generators once expanded: polynomials hold the same ones many times.
    """

    field: Domain
    domain: Domain
    generators: tuple[_Generator, ...]
    symbols: int
    shared: tuple[bool, ...]
    units: tuple[int, ...]
    memory: dict[tuple[int, ...], _Shares] = field(default_factory=dict, compare=False, repr=False)


def build_basis(robot: Robot, algebra: ExactAlgebra, field: Domain) -> TrigonometricBasis:
    """Return the functions that polynomials of `algebra` are written in, coefficients in `field`."""
    known = list(get_generators(field))
    rows = [row[0] for row in robot.transmission[: robot.size]]
    units = [
        math.lcm(*(factor.denominator for other, factor in rows if other == position))
        for position in range(robot.freedom)
    ]
    generators = []
    for name in map(str, algebra.ring.symbols):
        kind = name.rstrip("0123456789")
        if name in known:
            generators.append(_Generator(kind="symbol", coordinate=known.index(name)))
            continue
        position, multiplier = rows[int(name[len(kind) :]) - 1]
        frequency = int(multiplier * units[position])
        generators.append(
            _Generator(kind=kind, coordinate=position, multiplier=multiplier, frequency=frequency)
        )
    moved = [position for position, _ in rows]
    return TrigonometricBasis(
        field=field,
        domain=algebra.ring.domain,
        generators=tuple(generators),
        symbols=len(known),
        shared=tuple(moved.count(position) > 1 for position in range(robot.freedom)),
        units=tuple(units),
    )


def build_power_function(basis: TrigonometricBasis, coordinate: int = -1, exponent: int = 0) -> BasisFunction:
    """Return the function q^exponent of a coordinate; the constant function by default."""
    parts = [(0, 0, exponent if position == coordinate else 0) for position in range(len(basis.shared))]
    return tuple(parts), (0,) * len(basis.shared)


def build_wave_functions(
    basis: TrigonometricBasis, shares: Sequence[tuple[int, Fraction]], *, sine: bool
) -> dict[BasisFunction, Fraction]:
    """Return cos u, or sin u, of a sum u of multiples of coordinates, as {function: amplitude}.

    `shares`: (coordinate, multiple); the multiples are frequencies in the units of the basis.
    """
    still = [(0, 0, 0)] * len(basis.shared)
    result: dict[BasisFunction, Fraction] = {}
    # A product has sin u where the number of its sines is odd, with a minus for every two of them.
    for sines in product((False, True), repeat=len(shares)):
        if sum(sines) % 2 != sine:
            continue
        total = [(list(still), Fraction(-1) ** (sum(sines) // 2))]
        for (position, multiple), odd in zip(shares, sines, strict=True):
            wave = _expand_wave(basis, position, multiple, odd=odd)
            total = [
                ([*parts[:position], part, *parts[position + 1 :]], value * share)
                for part, share in wave.items()
                for parts, value in total
            ]
        for parts, value in total:
            function = (tuple(parts), (0,) * len(still))
            result[function] = result.get(function, Fraction(0)) + value
    return result


def _expand_wave(
    basis: TrigonometricBasis, position: int, multiple: Fraction, *, odd: bool
) -> dict[CoordinateFunction, Fraction]:
    """Return cos(w q), sin(w q) where `odd`, of a coordinate q; |w| a whole number in its unit."""
    frequency, sign = int(abs(multiple) * basis.units[position]), -1 if odd and multiple < 0 else 1
    if basis.shared[position]:
        return {(frequency, int(odd), 0): Fraction(sign)}
    # cos q, sin q to the powers of (c + i s)^w; s^2 = 1 - c^2.
    result: dict[CoordinateFunction, Fraction] = {}
    for power in range(int(odd), frequency + 1, 2):
        half = power // 2
        for k in range(half + 1):
            key = (int(odd), frequency - power + 2 * k, 0)
            share = math.comb(frequency, power) * math.comb(half, k) * (-1) ** (half + k)
            result[key] = result.get(key, Fraction(0)) + sign * share
    return {key: value for key, value in result.items() if value}


def _multiply_wave(wave: _Wave, frequency: int, *, sine: bool) -> _Wave:
    """Return the wave times cos(w q) or sin(w q), by the sums and differences of frequencies."""
    result: _Wave = {}

    def put(w: int, odd: bool, amplitude: Fraction) -> None:  # noqa: FBT001  an inner helper
        if odd and w < 0:
            amplitude = -amplitude
        if not (odd and w == 0):
            key = (abs(w), odd)
            result[key] = result.get(key, Fraction(0)) + amplitude

    for (w, odd), amplitude in wave.items():
        half, is_odd = amplitude / 2, sine != odd
        put(w + frequency, is_odd, -half if sine and odd else half)
        put(w - frequency, is_odd, -half if sine and not odd else half)
    return {key: amplitude for key, amplitude in result.items() if amplitude}


def _list_parts(
    factors: Sequence[tuple[_Generator, int]], *, shared: bool
) -> Iterator[tuple[CoordinateFunction, Fraction]]:
    """Return the functions of one coordinate that a product of its generators is the sum of."""
    if not shared:
        exponents = {generator.kind: exponent for generator, exponent in factors}
        a, b, e = (exponents.get(kind, 0) for kind in ("s", "c", "q"))
        yield (a, b, e), Fraction(1)
        return
    wave: _Wave = {(0, False): Fraction(1)}
    power, scale = 0, Fraction(1)
    for generator, exponent in factors:
        if generator.kind == "q":
            power += exponent
            scale *= generator.multiplier**exponent
            continue
        for _ in range(exponent):
            wave = _multiply_wave(wave, generator.frequency, sine=generator.kind == "s")
    for (frequency, odd), amplitude in wave.items():
        yield (frequency, int(odd), power), scale * amplitude


def _expand(basis: TrigonometricBasis, monomial: tuple[int, ...]) -> _Shares:
    """Return a product of generators, symbols apart, in the functions of the basis."""
    if monomial in basis.memory:
        return basis.memory[monomial]
    coordinates = range(len(basis.shared))
    rates = [0] * len(basis.shared)
    factors: list[list[tuple[_Generator, int]]] = [[] for _ in coordinates]
    for generator, exponent in zip(basis.generators, monomial, strict=True):
        if exponent and generator.kind == "dq":
            rates[generator.coordinate] += exponent
        elif exponent and generator.kind != "symbol":
            factors[generator.coordinate].append((generator, exponent))
    total: list[tuple[tuple[CoordinateFunction, ...], Fraction]] = [((), Fraction(1))]
    for position in coordinates:
        total = [
            ((*parts, part), value * share)
            for part, share in _list_parts(factors[position], shared=basis.shared[position])
            for parts, value in total
        ]
    convert, turning = basis.domain.convert, tuple(rates)
    found = tuple(
        ((parts, turning), convert(QQ(value.numerator, value.denominator))) for parts, value in total
    )
    basis.memory[monomial] = found
    return found


def split_polynomial(basis: TrigonometricBasis, polynomial: PolyElement) -> Mapping[BasisFunction, Number]:
    """Return the coefficients of `polynomial` over independent functions, as elements of the field."""
    total: dict[BasisFunction, dict[tuple[int, ...], Number]] = {}
    for monomial, coefficient in polynomial.items():
        powers = [0] * basis.symbols
        if basis.symbols:
            for generator, exponent in zip(basis.generators, monomial, strict=True):
                if generator.kind == "symbol":
                    powers[generator.coordinate] = exponent
        key = tuple(powers)
        for function, share in _expand(basis, monomial):
            entry = total.setdefault(function, {})
            entry[key] = entry.get(key, basis.domain.zero) + coefficient * share
    result: dict[BasisFunction, Number] = {}
    for function, entry in total.items():
        if kept := {key: value for key, value in entry.items() if value}:
            # Sums in the field would cancel common factors every time.
            whole = basis.field.new(basis.field.field.ring.from_dict(kept)) if basis.symbols else kept[()]
            result[function] = whole
    return result
