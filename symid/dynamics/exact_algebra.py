"""Exact arithmetic: polynomials of a robot's coordinates, their values, row reduction, and print.

Robot -> an algebra whose numbers are elements of K[s_i, c_i, q_i, dq_i, ddq_i, lengths], with s_i^2 = 1 -
c_i^2 applied after every product, so that equal functions are equal polynomials. K is the rationals,
extended by sqrt(2) and sqrt(3) only where the robot has them.

`PointAlgebra` has the coordinates at one exact point: two polynomials that agree at a random rational point
are the same but for bad luck. `Echelon` reduces sparse rows {column: coefficient} over any field to reduced
row echelon form. Polynomials print as text and LaTeX; of long ones the number of terms left out is shown.

Supported: revolute joints (s, c), prismatic joints (q), springs, joints that follow others, symbols.
Not supported: division of polynomials (the recursion has none).
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from sympy import QQ, Symbol, latex, sqrt
from sympy.polys.domains.domain import Domain
from sympy.polys.rings import PolyElement, PolyRing

from symid.dynamics.algebra import OperatorAlgebra
from symid.robot import Exact, JointKind, Robot, Surd


def _list_constants(robot: Robot) -> Iterable[Exact]:
    for joint in robot.joints:
        for row in joint.placement.rotation:
            yield from row
        yield from joint.placement.translation
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


def _convert_surd(surd: Surd, domain: Domain) -> Any:  # noqa: ANN401  an element of a SymPy domain has no type of its own
    one, two, three, six = (QQ(part.numerator, part.denominator) for part in surd)
    total = domain.convert(one)
    if two or three or six:
        root_two, root_three = _compute_roots(domain)
        total += domain.convert(two) * root_two if two else domain.zero
        total += domain.convert(three) * root_three if three else domain.zero
        total += domain.convert(six) * root_two * root_three if six else domain.zero
    return total


@lru_cache(maxsize=8)
def _compute_roots(domain: Domain) -> tuple[Any, Any]:
    """Return sqrt(2) and sqrt(3) in `domain`, zero for one that it lacks; SymPy takes long to find them."""

    def find(root: int) -> Any:  # noqa: ANN401  as above
        return domain.from_sympy(sqrt(root)) if _holds_root(domain, root) else domain.zero

    return find(2), find(3)


def _holds_root(domain: Domain, root: int) -> bool:
    return any(root == generator**2 for generator in domain.orig_ext)


def get_generators(field: Domain) -> dict[str, Any]:
    """Return the symbolic lengths of a field of rational functions; none for a field of numbers."""
    if not field.is_FractionField:
        return {}
    return dict(zip(map(str, field.symbols), field.gens, strict=True))


def evaluate_constant(value: Exact, domain: Domain, symbols: Mapping[str, Any]) -> Any:  # noqa: ANN401  as above
    """Return `value` as a number of `domain`, its symbolic lengths replaced by `symbols`."""
    total = domain.zero
    for name, surd in value.terms:
        number = _convert_surd(surd, domain)
        total += number * symbols[name] if name else number
    return total


def lift_number(value: Any, domain: Domain, field: Domain) -> Any:  # noqa: ANN401  as above
    """Return a number of `domain` in `field`: the domain itself, or rational functions over it."""
    # SymPy's own conversion factors a polynomial for each number of an algebraic field.
    return value if field == domain else field.new(field.field.ring.ground_new(value))


def convert_number(value: Exact, domain: Domain, field: Domain) -> Any:  # noqa: ANN401  an element of `field`
    """Return `value` in `field`, which contains `domain` and the symbolic lengths of `value`."""
    generators = get_generators(field)
    total = field.zero
    for name, surd in value.terms:
        number = lift_number(_convert_surd(surd, domain), domain, field)
        total += number * generators[name] if name else number
    return total


@dataclass(frozen=True, slots=True)
class ExactAlgebra:
    """Polynomials of one ring; `sines` pairs the index of each s_i with that of its c_i."""

    ring: PolyRing
    sines: tuple[tuple[int, int], ...]

    @property
    def zero(self) -> PolyElement:
        """Return the zero polynomial."""
        return self.ring.zero

    @property
    def one(self) -> PolyElement:
        """Return the polynomial one."""
        return self.ring.one

    def constant(self, value: Exact) -> PolyElement:
        """Return an exact number or linear form of symbolic lengths as a polynomial."""
        result = self.ring.zero
        for name, surd in value.terms:
            number = self.ring.ground_new(_convert_surd(surd, self.ring.domain))
            result += number * self.generator(name) if name else number
        return result

    @property
    def generators(self) -> dict[str, PolyElement]:
        """Return the generators of the ring by name."""
        return dict(zip(map(str, self.ring.symbols), self.ring.gens, strict=True))

    def generator(self, name: str) -> PolyElement:
        """Return the generator `name` of the ring."""
        return self.generators[name]

    def add(self, left: PolyElement, right: PolyElement) -> PolyElement:
        """Return left + right."""
        return left + right

    def sub(self, left: PolyElement, right: PolyElement) -> PolyElement:
        """Return left - right."""
        return left - right

    def neg(self, value: PolyElement) -> PolyElement:
        """Return -value."""
        return -value

    def half(self, value: PolyElement) -> PolyElement:
        """Return value / 2."""
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
            kept = {monomial: c for monomial, c in value.items() if monomial[sine] <= 1}
            value = self.ring.from_dict(kept)
            complement = 1 - self.ring.gens[cosine] ** 2
            for monomial, coefficient in squared.items():
                pairs, rest = divmod(monomial[sine], 2)
                bare = (*monomial[:sine], rest, *monomial[sine + 1 :])
                value += self.ring.from_dict({bare: coefficient}) * complement**pairs
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
class PointAlgebra(OperatorAlgebra[Any]):
    """Numbers of `domain`; `values` holds those of the symbolic lengths."""

    domain: Domain
    values: Mapping[str, Any]

    @property
    def zero(self) -> Any:  # noqa: ANN401  an element of a SymPy domain has no type of its own
        """Return zero."""
        return self.domain.zero

    @property
    def one(self) -> Any:  # noqa: ANN401  as above
        """Return one."""
        return self.domain.one

    def constant(self, value: Exact) -> Any:  # noqa: ANN401  as above
        """Return an exact number, symbolic lengths replaced by their values."""
        return evaluate_constant(value, self.domain, self.values)

    def half(self, value: Any) -> Any:  # noqa: ANN401  as above
        """Return value / 2."""
        return value * self.domain.convert(QQ(1, 2))


Row = dict[int, Any]


def _subtract_row(row: Row, factor: Any, other: Row) -> None:  # noqa: ANN401  a field element has no type of its own
    for column, value in other.items():
        new = row.get(column, 0) - factor * value
        if new:
            row[column] = new
        else:
            row.pop(column, None)


class Echelon:
    """A growing set of independent rows, kept in reduced row echelon form.

    The only mutable object of the derivation: it lives inside one function call.
    """

    __slots__ = ("_by_pivot",)

    def __init__(self) -> None:
        """Start with no row."""
        self._by_pivot: dict[int, Row] = {}

    def insert(self, row: Row) -> bool:
        """Add `row` to the span; return whether it was independent of the rows before."""
        rest = {column: value for column, value in row.items() if value}
        for column in sorted(rest):
            if column in self._by_pivot and column in rest:
                _subtract_row(rest, rest[column], self._by_pivot[column])
        if not rest:
            return False
        pivot = min(rest)
        lead = rest[pivot]
        rest = {column: value / lead for column, value in rest.items()}
        for other in self._by_pivot.values():
            if pivot in other:
                _subtract_row(other, other[pivot], rest)
        self._by_pivot[pivot] = rest
        return True

    @property
    def rows(self) -> tuple[Row, ...]:
        """Return the rows, ordered by pivot."""
        return tuple(dict(sorted(self._by_pivot[pivot].items())) for pivot in sorted(self._by_pivot))

    @property
    def pivots(self) -> tuple[int, ...]:
        """Return the pivot columns in ascending order."""
        return tuple(sorted(self._by_pivot))


def reduce_rows(rows: Iterable[Row] | Sequence[Row]) -> Echelon:
    """Return the reduced row echelon form of `rows`."""
    echelon = Echelon()
    for row in rows:
        echelon.insert(row)
    return echelon


_LETTERS = {"ddq": r"\ddot q", "dq": r"\dot q", "q": "q", "s": "s", "c": "c"}
_COORDINATE = re.compile(r"^(ddq|dq|q|s|c)(\d+)$")
_SLOPE = re.compile(r"^d(T|V|tau)(\d*)/d(\w+)$")
_VELOCITY = re.compile(r"^([wv])(\d+)([xyz])$")
_PARAMETER = re.compile(r"^([A-Za-z]+)(\d+)$")
_MARKED = str.maketrans({character: rf"\{character}" for character in "_%&#$"})


def _cut_terms(value: PolyElement, most: int) -> tuple[PolyElement, int]:
    """Return the leading `most` terms and the number of terms left out."""
    terms = value.terms()
    left_out = max(0, len(terms) - most)
    return value.ring.from_dict(dict(terms[:most])), left_out


def write_polynomial_text(value: PolyElement, *, most: int = 12) -> str:
    """Return `value` as a plain sum; at most `most` terms, then how many more there are."""
    shown, left_out = _cut_terms(value, most)
    text = str(shown.as_expr()).replace("**", "^")
    return f"{text} + ({left_out} more terms)" if left_out else text


def write_polynomial_latex(value: PolyElement, *, most: int = 12) -> str:
    """Return `value` in LaTeX; at most `most` terms, then how many more there are."""
    shown, left_out = _cut_terms(value, most)
    names: dict[Symbol, str] = {}
    for symbol in value.ring.symbols:
        if match := _COORDINATE.match(str(symbol)):
            names[symbol] = f"{_LETTERS[match[1]]}_{{{match[2]}}}"
    text = str(latex(shown.as_expr(), symbol_names=names))
    return rf"{text} + (\text{{{left_out} more terms}})" if left_out else text


def _write_parameter(name: str) -> str:
    """Return a parameter as SymPy prints it: letters, and the number of its joint below."""
    if match := _PARAMETER.match(name):
        return f"{match[1]}_{{{match[2]}}}"
    return rf"\mathit{{{name.translate(_MARKED)}}}"


def write_name_latex(text: str) -> str:
    """Return the left side of a formula in LaTeX: a slope, a velocity, a parameter, or words."""
    if match := _SLOPE.match(text):
        above = rf"\tau_{{{match[2]}}}" if match[1] == "tau" else match[1]
        return rf"\frac{{\partial {above}}}{{\partial {_write_parameter(match[3])}}}"
    if match := _VELOCITY.match(text):
        letter = r"\omega" if match[1] == "w" else "v"
        return rf"{letter}_{{{match[2]},{match[3]}}}"
    return _write_parameter(text) if text.isidentifier() else rf"\text{{{text.translate(_MARKED)}}}"
