# ruff: noqa: D102 - operations are named as what they are

"""Exact arithmetic: polynomials of a robot's coordinates, their values, independent functions, print.

Robot -> an algebra whose numbers are elements of K[s_i, c_i, q_i, dq_i, ddq_i, lengths], with s_i^2 = 1 -
c_i^2 applied after every product, so that equal functions are equal polynomials. K is the rationals,
extended by sqrt(2) and sqrt(3) only where the robot has them. `PointAlgebra` has the coordinates at one
exact point: two polynomials that agree at a random rational point are the same but for bad luck.

In the trigonometric basis, {function: coefficient}, a polynomial vanishes for all states only if every
coefficient does. A coordinate that moves one joint has the functions s^a c^b q^e (a < 2); one that moves
several has q^e cos(w q) and q^e sin(w q), w the sums of the multipliers, which may be any.

Supported: revolute joints (s, c), prismatic joints (q), springs, joints that follow others, symbols.
Not supported: division of polynomials (the recursion has none).
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from itertools import product
from typing import Any

from sympy import QQ, Symbol, latex, sqrt
from sympy.polys.domains.domain import Domain
from sympy.polys.matrices.sdm import sdm_irref
from sympy.polys.rings import PolyElement, PolyRing

from symid.dynamics.algebra import OperatorAlgebra
from symid.robot import Exact, JointKind, Placement, Robot, Surd

Number = Any
"""An element of a SymPy domain, which has no type of its own."""
Row = dict[int, Number]
CoordinateFunction = tuple[int, int, int]
"""Function of one coordinate: for one joint (a, b, e) of s^a c^b q^e; for several (w, odd, e), with the
frequency w in the coordinate's own unit."""
BasisFunction = tuple[tuple[CoordinateFunction, ...], tuple[int, ...]]
"""A part for each coordinate, and the exponents of their velocities."""

_Wave = dict[tuple[int, bool], Fraction]
"""Amplitudes of cos(w q), sin(w q): {(w, whether sine): amplitude} with w >= 0."""
_Shares = tuple[tuple[BasisFunction, Number], ...]
_LETTERS = {"ddq": r"\ddot q", "dq": r"\dot q", "q": "q", "s": "s", "c": "c"}
_COORDINATE = re.compile(r"^(ddq|dq|q|s|c)(\d+)$")
_SLOPE = re.compile(r"^d(T|V|tau)(\d*)/d(\w+)$")
_VELOCITY = re.compile(r"^([wv])(\d+)([xyz])$")
_PARAMETER = re.compile(r"^([A-Za-z]+)(\d+)$")
_MARKED = str.maketrans({character: rf"\{character}" for character in "_%&#$"})


def list_placement_constants(placement: Placement) -> Iterator[Exact]:
    """Yield the exact numbers of a placement."""
    yield from placement.translation
    for row in placement.rotation:
        yield from row


def _list_constants(robot: Robot) -> Iterator[Exact]:
    for joint in robot.joints:
        yield from list_placement_constants(joint.placement)
    yield from robot.gravity


def choose_domain(robot: Robot, further: Iterable[Exact] = ()) -> Domain:
    """Return the smallest of Q, Q(sqrt 2), Q(sqrt 3), Q(sqrt 2, sqrt 3) that holds geometry and `further`."""
    constants = (*_list_constants(robot), *further)
    used = [any(surd[k] for value in constants for _, surd in value.terms) for k in range(4)]
    roots = [sqrt(root) for root, needed in ((2, used[1] or used[3]), (3, used[2] or used[3])) if needed]
    return QQ.algebraic_field(*roots) if roots else QQ


def list_symbols(robot: Robot) -> tuple[str, ...]:
    """Return the names of the symbolic lengths in use, sorted."""
    return tuple(sorted({name for value in _list_constants(robot) for name in value.symbols}))


@lru_cache(maxsize=8)
def _compute_roots(domain: Domain) -> tuple[Number, ...]:
    """Return sqrt(2) and sqrt(3) in `domain`, zero for one that it lacks; slow in SymPy."""
    held = [any(root == generator**2 for generator in domain.orig_ext) for root in (2, 3)]
    pairs = zip((2, 3), held, strict=True)
    return tuple(domain.from_sympy(sqrt(root)) if is_held else domain.zero for root, is_held in pairs)


def _convert_surd(surd: Surd, domain: Domain) -> Number:
    one, two, three, six = (QQ(part.numerator, part.denominator) for part in surd)
    total = domain.convert(one)
    if two or three or six:
        root_two, root_three = _compute_roots(domain)
        total += domain.convert(two) * root_two if two else domain.zero
        total += domain.convert(three) * root_three if three else domain.zero
        total += domain.convert(six) * root_two * root_three if six else domain.zero
    return total


def _sum_terms(
    value: Exact, zero: Number, convert: Callable[[Surd], Number], symbols: Mapping[str, Number]
) -> Number:
    """Return a linear form of symbolic lengths, from its converted coefficients and the `symbols`."""
    total = zero
    for name, surd in value.terms:
        number = convert(surd)
        total += number * symbols[name] if name else number
    return total


def get_generators(field: Domain) -> dict[str, Number]:
    """Return the symbolic lengths of a field of rational functions; none for a field of numbers."""
    return dict(zip(map(str, field.symbols), field.gens, strict=True)) if field.is_FractionField else {}


def convert_number(value: Exact, domain: Domain, field: Domain) -> Number:
    """Return `value` in `field`, which contains `domain` and the symbolic lengths of `value`."""

    def convert(surd: Surd) -> Number:
        number = _convert_surd(surd, domain)
        # SymPy's own conversion factors a polynomial for each number of an algebraic field.
        return number if field == domain else field.new(field.field.ring.ground_new(number))

    return _sum_terms(value, field.zero, convert, get_generators(field))


@dataclass(frozen=True, slots=True)
class ExactAlgebra(OperatorAlgebra):
    """Polynomials of one ring; `sines` pairs the index of each s_i with that of its c_i."""

    ring: PolyRing
    sines: tuple[tuple[int, int], ...]

    @property
    def zero(self) -> PolyElement:
        return self.ring.zero

    @property
    def one(self) -> PolyElement:
        return self.ring.one

    def constant(self, value: Exact) -> PolyElement:
        """Return an exact number or linear form of symbolic lengths as a polynomial."""
        return _sum_terms(
            value,
            self.ring.zero,
            lambda surd: self.ring.ground_new(_convert_surd(surd, self.ring.domain)),
            self.generators if value.symbols else {},
        )

    @property
    def generators(self) -> dict[str, PolyElement]:
        """Return the generators of the ring by name."""
        return dict(zip(map(str, self.ring.symbols), self.ring.gens, strict=True))

    def half(self, value: PolyElement) -> PolyElement:
        return value * self.ring.domain.convert(QQ(1, 2))

    def mul(self, left: PolyElement, right: PolyElement) -> PolyElement:
        """Return the product, in normal form."""
        if not left or not right:
            return self.ring.zero
        return self.reduce(left * right)

    def reduce(self, value: PolyElement) -> PolyElement:
        """Return `value` with every s^2 replaced by 1 - c^2."""
        for sine, cosine in self.sines:
            squared = {monomial: c for monomial, c in value.items() if monomial[sine] > 1}
            if not squared:
                continue
            terms = {monomial: c for monomial, c in value.items() if monomial[sine] <= 1}
            for monomial, coefficient in squared.items():
                pairs, powers = monomial[sine] // 2, list(monomial)
                powers[sine] %= 2
                for k in range(pairs + 1):
                    change, place = coefficient * ((-1) ** k * math.comb(pairs, k)), tuple(powers)
                    terms[place] = terms.get(place, self.ring.domain.zero) + change
                    powers[cosine] += 2
            value = self.ring.from_dict(terms)
        return value


def build_exact_algebra(robot: Robot, domain: Domain | None = None) -> ExactAlgebra:
    """Return the algebra whose generators are the robot's coordinates and symbols.

    Every joint has its own s and c, or q, those that follow another too: what is proved without their
    relation holds with it. Revolute joints have a q where a spring needs it.
    """
    names: list[str] = []
    sines: list[tuple[int, int]] = []
    for number, joint in enumerate(robot.joints, start=1):
        if joint.kind is JointKind.REVOLUTE:
            sines.append((len(names), len(names) + 1))
            names += [f"s{number}", f"c{number}"]
        if joint.kind is JointKind.PRISMATIC or joint.spring is not None:
            names.append(f"q{number}")
    numbers = [index + 1 for index in robot.coordinates]
    names += [f"dq{number}" for number in numbers] + [f"ddq{number}" for number in numbers]
    names += list_symbols(robot)
    return ExactAlgebra(PolyRing(names, domain or choose_domain(robot)), tuple(sines))


def differentiate(robot: Robot, algebra: ExactAlgebra, value: PolyElement, coordinate: int) -> PolyElement:
    """Return the derivative by the coordinate of a joint (index): d s = c, d c = -s, at followers too."""
    total, known = algebra.zero, algebra.generators
    position = robot.coordinates.index(coordinate)
    transmission = robot.transmission[: robot.size]
    for number, (joint, row) in enumerate(zip(robot.joints, transmission, strict=True), start=1):
        factor = dict(row).get(position)
        if factor is None:
            continue
        part = algebra.zero
        if joint.kind is JointKind.REVOLUTE:
            sine, cosine = known[f"s{number}"], known[f"c{number}"]
            part = algebra.reduce(value.diff(sine) * cosine - value.diff(cosine) * sine)
        if f"q{number}" in known:
            part += value.diff(known[f"q{number}"])
        total += part if factor == 1 else algebra.mul(algebra.constant(Exact.of(factor)), part)
    return total


@dataclass(frozen=True, slots=True)
class PointAlgebra(OperatorAlgebra):
    """Numbers of `domain`; `values` holds those of the symbolic lengths."""

    domain: Domain
    values: Mapping[str, Number]

    @property
    def zero(self) -> Number:
        return self.domain.zero

    @property
    def one(self) -> Number:
        return self.domain.one

    def constant(self, value: Exact) -> Number:
        """Return an exact number, symbolic lengths replaced by their values."""
        return _sum_terms(value, self.zero, lambda surd: _convert_surd(surd, self.domain), self.values)

    def half(self, value: Number) -> Number:
        return value * self.domain.convert(QQ(1, 2))


def reduce_rows(rows: Iterable[Row]) -> tuple[Row, ...]:
    """Return the reduced row echelon form of `rows`, ordered by pivot."""
    listed = [{column: value for column, value in row.items() if value} for row in rows]
    reduced, _, _ = sdm_irref(dict(enumerate(filter(None, listed))))
    return tuple(dict(sorted(row.items())) for row in reduced.values())


@dataclass(frozen=True, slots=True)
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
            generators.append(_Generator("symbol", known.index(name)))
            continue
        position, multiplier = rows[int(name[len(kind) :]) - 1]
        generators.append(_Generator(kind, position, multiplier, int(multiplier * units[position])))
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
) -> dict[BasisFunction, int]:
    """Return cos u or sin u as {function: amplitude}, u the sum of `shares`, (coordinate, multiple)."""
    still = [(0, 0, 0)] * len(basis.shared)
    result: dict[BasisFunction, int] = {}
    # A product has sin u where the number of its sines is odd, with a minus for every two of them.
    for sines in product((False, True), repeat=len(shares)):
        if sum(sines) % 2 != sine:
            continue
        total = [(list(still), (-1) ** (sum(sines) // 2))]
        for (position, multiple), odd in zip(shares, sines, strict=True):
            wave = _expand_wave(basis, position, multiple, odd=odd)
            total = [
                ([*parts[:position], part, *parts[position + 1 :]], value * share)
                for part, share in wave.items()
                for parts, value in total
            ]
        for parts, value in total:
            function = (tuple(parts), (0,) * len(still))
            result[function] = result.get(function, 0) + value
    return result


def _expand_wave(
    basis: TrigonometricBasis, position: int, multiple: Fraction, *, odd: bool
) -> dict[CoordinateFunction, int]:
    """Return cos(w q), sin(w q) where `odd`, of a coordinate q; |w| a whole number in its unit."""
    frequency, sign = int(abs(multiple) * basis.units[position]), -1 if odd and multiple < 0 else 1
    if basis.shared[position]:
        return {(frequency, int(odd), 0): sign}
    # Chebyshev: cos(n q) = T_n(cos q), sin(n q) = sin q U_(n - 1)(cos q).
    degree, result = frequency - odd, {}
    for k in range(degree // 2 + 1):
        # The size of the coefficient of x^(n - 2 k), in U_n, and in T_n.
        size = math.comb(degree - k, k) << (degree - 2 * k)
        size = size if odd or not degree else size * degree // (2 * (degree - k))
        result[int(odd), degree - 2 * k, 0] = sign * (-1) ** k * size
    return result


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
    turning, exact = tuple(rates), ((parts, QQ(x.numerator, x.denominator)) for parts, x in total)
    found = tuple(((parts, turning), basis.domain.convert(number)) for parts, number in exact)
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


def write_polynomial(value: PolyElement, *, most: int = 12) -> tuple[str, str]:
    """Return `value` as a plain sum and in LaTeX; at most `most` terms, then how many more there are."""
    terms = value.terms()
    shown = value.ring.from_dict(dict(terms[:most])).as_expr()
    names: dict[Symbol, str] = {}
    for symbol in value.ring.symbols:
        if match := _COORDINATE.match(str(symbol)):
            names[symbol] = f"{_LETTERS[match[1]]}_{{{match[2]}}}"
    text, formula = str(shown).replace("**", "^"), str(latex(shown, symbol_names=names))
    if len(terms) <= most:
        return text, formula
    left_out = f"{len(terms) - most} more terms"
    return f"{text} + ({left_out})", rf"{formula} + (\text{{{left_out}}})"


def write_name_latex(text: str) -> str:
    """Return the left side of a formula in LaTeX: a slope, a velocity, a parameter, or words."""
    if match := _SLOPE.match(text):
        above = rf"\tau_{{{match[2]}}}" if match[1] == "tau" else match[1]
        return rf"\frac{{\partial {above}}}{{\partial {write_name_latex(match[3])}}}"
    if match := _VELOCITY.match(text):
        letter = r"\omega" if match[1] == "w" else "v"
        return rf"{letter}_{{{match[2]},{match[3]}}}"
    # A parameter as SymPy prints it: letters, and the number of its joint below.
    if match := _PARAMETER.match(text):
        return f"{match[1]}_{{{match[2]}}}"
    return rf"\{'mathit' if text.isidentifier() else 'text'}{{{text.translate(_MARKED)}}}"
