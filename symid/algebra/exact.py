"""The exact carrier: sparse polynomials over the rationals, in normal form.

Input: a robot description. Output: an algebra whose numbers are elements of
K[s_i, c_i, q_i, dq_i, ddq_i, lengths], with s_i^2 = 1 - c_i^2 applied after every product,
so that equal functions are equal polynomials. K is the rationals, extended by sqrt(2) and
sqrt(3) only where the robot has them.

Supported: revolute joints (s, c), prismatic joints (q), springs, joints that follow others, symbols.
Not supported: division (the recursion has none).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from sympy import QQ, sqrt
from sympy.polys.domains.domain import Domain
from sympy.polys.rings import PolyElement, PolyRing

from symid.algebra.scalar import State, spread_coordinates
from symid.robot.description import JointKind, Robot
from symid.robot.geometry import Exact, Surd

__all__ = [
    "ExactAlgebra",
    "build_exact_algebra",
    "build_exact_state",
    "differentiate",
    "find_constant",
    "find_domain",
    "find_generators",
    "find_number",
    "find_symbols",
    "lift_number",
]


def _constants(robot: Robot) -> Iterable[Exact]:
    for joint in robot.joints:
        for row in joint.placement.rotation:
            yield from row
        yield from joint.placement.translation
    yield from robot.gravity


def find_domain(robot: Robot) -> Domain:
    """Return the smallest of Q, Q(sqrt 2), Q(sqrt 3), Q(sqrt 2, sqrt 3) that holds the geometry."""
    used = [any(surd[k] for value in _constants(robot) for _, surd in value.terms) for k in range(4)]
    roots = [sqrt(root) for root, needed in ((2, used[1] or used[3]), (3, used[2] or used[3])) if needed]
    return QQ.algebraic_field(*roots) if roots else QQ


def find_symbols(robot: Robot) -> tuple[str, ...]:
    """Return the names of the symbolic lengths in use, sorted."""
    return tuple(sorted({name for value in _constants(robot) for name in value.symbols}))


def _find_surd(surd: Surd, domain: Domain) -> Any:  # noqa: ANN401  an element of a SymPy domain has no type of its own
    one, two, three, six = (QQ(part.numerator, part.denominator) for part in surd)
    total = domain.convert(one)
    if two or three or six:
        root_two, root_three = _find_roots(domain)
        total += domain.convert(two) * root_two if two else domain.zero
        total += domain.convert(three) * root_three if three else domain.zero
        total += domain.convert(six) * root_two * root_three if six else domain.zero
    return total


@lru_cache(maxsize=8)
def _find_roots(domain: Domain) -> tuple[Any, Any]:
    """Return sqrt(2) and sqrt(3) in `domain`, zero for one that it lacks; SymPy takes long to find them."""

    def find(root: int) -> Any:  # noqa: ANN401  as above
        return domain.from_sympy(sqrt(root)) if _holds_root(domain, root) else domain.zero

    return find(2), find(3)


def _holds_root(domain: Domain, root: int) -> bool:
    return any(root == generator**2 for generator in domain.orig_ext)


def find_generators(field: Domain) -> dict[str, Any]:
    """Return the symbolic lengths of a field of rational functions; none for a field of numbers."""
    if not field.is_FractionField:
        return {}
    return dict(zip(map(str, field.symbols), field.gens, strict=True))


def find_constant(value: Exact, domain: Domain, symbols: Mapping[str, Any]) -> Any:  # noqa: ANN401  as above
    """Return `value` as a number of `domain`, its symbolic lengths replaced by `symbols`."""
    total = domain.zero
    for name, surd in value.terms:
        number = _find_surd(surd, domain)
        total += number * symbols[name] if name else number
    return total


def lift_number(value: Any, domain: Domain, field: Domain) -> Any:  # noqa: ANN401  as above
    """Return a number of `domain` in `field`: the domain itself, or rational functions over it."""
    # SymPy's own conversion factors a polynomial for each number of an algebraic field.
    return value if field == domain else field.new(field.field.ring.ground_new(value))


def find_number(value: Exact, domain: Domain, field: Domain) -> Any:  # noqa: ANN401  an element of `field`
    """Return `value` in `field`, which contains `domain` and the symbolic lengths of `value`."""
    generators = find_generators(field)
    total = field.zero
    for name, surd in value.terms:
        number = lift_number(_find_surd(surd, domain), domain, field)
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
            number = self.ring.ground_new(_find_surd(surd, self.ring.domain))
            result += number * self.generator(name) if name else number
        return result

    def generator(self, name: str) -> PolyElement:
        """Return the generator `name` of the ring."""
        return self.ring.gens[[str(symbol) for symbol in self.ring.symbols].index(name)]

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
    names += find_symbols(robot)
    return ExactAlgebra(PolyRing(names, domain or find_domain(robot)), tuple(sines))


def build_exact_state(robot: Robot, algebra: ExactAlgebra) -> State[PolyElement]:
    """Return the state of the joints in the generators of the ring."""
    known = {
        str(symbol): generator
        for symbol, generator in zip(algebra.ring.symbols, algebra.ring.gens, strict=True)
    }

    def take(prefix: str) -> tuple[PolyElement, ...]:
        return tuple(known.get(f"{prefix}{number}", algebra.zero) for number in range(1, robot.size + 1))

    def spread(prefix: str) -> tuple[PolyElement, ...]:
        rates = [known[f"{prefix}{index + 1}"] for index in robot.coordinates]
        return spread_coordinates(robot, algebra, rates)[: robot.size]

    return State(
        sine=take("s"),
        cosine=take("c"),
        position=take("q"),
        velocity=spread("dq"),
        acceleration=spread("ddq"),
    )


def differentiate(robot: Robot, algebra: ExactAlgebra, value: PolyElement, coordinate: int) -> PolyElement:
    """Return the derivative by the coordinate of a joint (index): d s = c, d c = -s, at followers too."""
    total = algebra.zero
    known = {
        str(symbol): generator
        for symbol, generator in zip(algebra.ring.symbols, algebra.ring.gens, strict=True)
    }
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
