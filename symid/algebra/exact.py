"""The exact carrier: sparse polynomials over the rationals, in normal form.

Input: a robot description. Output: an algebra whose numbers are elements of
K[s_i, c_i, q_i, dq_i, ddq_i, lengths], with s_i^2 = 1 - c_i^2 applied after every product,
so that equal functions are equal polynomials. K is the rationals, extended by sqrt(2) and
sqrt(3) only where the robot has them.

Supported: revolute joints (s, c), prismatic joints (q), symbolic lengths.
Not supported: division (the recursion has none).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from sympy import QQ, Rational, sqrt
from sympy.polys.domains.domain import Domain
from sympy.polys.rings import PolyElement, PolyRing

from symid.algebra.scalar import State
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
    one, two, three, six = (Rational(part.numerator, part.denominator) for part in surd)
    if not (two or three or six):
        return domain.convert(QQ(one.p, one.q))
    return domain.from_sympy(one + two * sqrt(2) + three * sqrt(3) + six * sqrt(2) * sqrt(3))


def find_generators(field: Domain) -> dict[str, Any]:
    """Return the symbolic lengths of a field of rational functions; none for a field of numbers."""
    names = (str(symbol) for symbol in getattr(field, "symbols", ()) or ())
    return dict(zip(names, getattr(field, "gens", ()) or (), strict=False))


def find_constant(value: Exact, domain: Domain, symbols: Mapping[str, Any]) -> Any:  # noqa: ANN401  as above
    """Return `value` as a number of `domain`, its symbolic lengths replaced by `symbols`."""
    total = domain.zero
    for name, surd in value.terms:
        number = _find_surd(surd, domain)
        total += number * symbols[name] if name else number
    return total


def find_number(value: Exact, domain: Domain, field: Domain) -> Any:  # noqa: ANN401  an element of `field`
    """Return `value` in `field`, which contains `domain` and the symbolic lengths of `value`."""
    generators = find_generators(field)
    total = field.zero
    for name, surd in value.terms:
        number = field.convert_from(_find_surd(surd, domain), domain)
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
    """Return the algebra whose generators are the robot's coordinates and symbolic lengths."""
    names: list[str] = []
    sines: list[tuple[int, int]] = []
    for number, joint in enumerate(robot.joints, start=1):
        if joint.kind is JointKind.REVOLUTE:
            sines.append((len(names), len(names) + 1))
            names += [f"s{number}", f"c{number}"]
        else:
            names.append(f"q{number}")
    numbers = range(1, robot.size + 1)
    names += [f"dq{number}" for number in numbers] + [f"ddq{number}" for number in numbers]
    names += find_symbols(robot)
    return ExactAlgebra(PolyRing(names, domain or find_domain(robot)), tuple(sines))


def build_exact_state(robot: Robot, algebra: ExactAlgebra) -> State[PolyElement]:
    """Return the coordinates as generators of the ring."""

    def take(prefix: str, kind: JointKind | None) -> tuple[PolyElement, ...]:
        return tuple(
            algebra.generator(f"{prefix}{number}") if kind in (None, joint.kind) else algebra.zero
            for number, joint in enumerate(robot.joints, start=1)
        )

    return State(
        sine=take("s", JointKind.REVOLUTE),
        cosine=take("c", JointKind.REVOLUTE),
        position=take("q", JointKind.PRISMATIC),
        velocity=take("dq", None),
        acceleration=take("ddq", None),
    )


def differentiate(robot: Robot, algebra: ExactAlgebra, value: PolyElement, joint: int) -> PolyElement:
    """Return the derivative by the coordinate of `joint` (index from 0): d s = c, d c = -s."""
    number = joint + 1
    if robot.joints[joint].kind is JointKind.PRISMATIC:
        return value.diff(algebra.generator(f"q{number}"))
    sine, cosine = algebra.generator(f"s{number}"), algebra.generator(f"c{number}")
    return algebra.reduce(value.diff(sine) * cosine - value.diff(cosine) * sine)
