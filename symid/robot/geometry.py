"""Exact lengths, rotations and placements.

Input: decimal lengths, angles as decimals or multiples of pi, names of symbolic lengths.
Output: `Exact` numbers, a linear form over symbols whose coefficients lie in the
field of the rationals with sqrt(2) and sqrt(3).

Supported: every multiple of pi/12 exactly; any other angle through a rational
half-angle tangent, so that cos^2 + sin^2 = 1 holds exactly.
Not supported: products of two symbolic lengths (no placement needs one).
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction

__all__ = [
    "IDENTITY",
    "ONE",
    "ZERO",
    "Angle",
    "Exact",
    "Placement",
    "Surd",
    "compose_placements",
    "find_angle",
    "place_modified_dh",
    "rotate_x",
    "rotate_z",
    "translate",
]

Surd = tuple[Fraction, Fraction, Fraction, Fraction]
"""Coefficients of 1, sqrt(2), sqrt(3), sqrt(6)."""

_ROOTS = (1.0, math.sqrt(2.0), math.sqrt(3.0), math.sqrt(6.0))
_ROOT_NAMES = ("", "sqrt(2)", "sqrt(3)", "sqrt(6)")
# Product of basis elements i and j: (factor, basis element).
_PRODUCTS = (
    ((1, 0), (1, 1), (1, 2), (1, 3)),
    ((1, 1), (2, 0), (1, 3), (2, 2)),
    ((1, 2), (1, 3), (3, 0), (3, 1)),
    ((1, 3), (2, 2), (3, 1), (6, 0)),
)
_NO_SURD: Surd = (Fraction(0),) * 4


def _multiply_surds(left: Surd, right: Surd) -> Surd:
    total = [Fraction(0)] * 4
    for i, a in enumerate(left):
        for j, b in enumerate(right):
            if a and b:
                factor, basis = _PRODUCTS[i][j]
                total[basis] += factor * a * b
    return (total[0], total[1], total[2], total[3])


@dataclass(frozen=True, slots=True)
class Exact:
    """A linear form over named symbols; the name "" stands for the number one.

    `terms` is sorted by name and holds no zero coefficient, so equal values are equal objects.
    """

    terms: tuple[tuple[str, Surd], ...] = ()

    @staticmethod
    def of(value: float | Fraction | str) -> "Exact":
        """Return the number that `value` writes; a decimal stays the decimal it shows."""
        text = repr(value) if isinstance(value, float) else value
        return Exact.surd(Fraction(text))

    @staticmethod
    def surd(
        one: Fraction, two: Fraction | int = 0, three: Fraction | int = 0, six: Fraction | int = 0
    ) -> "Exact":
        """Return `one + two*sqrt(2) + three*sqrt(3) + six*sqrt(6)`."""
        value = (Fraction(one), Fraction(two), Fraction(three), Fraction(six))
        return Exact((("", value),) if any(value) else ())

    @staticmethod
    def symbol(name: str) -> "Exact":
        """Return the symbolic length `name`."""
        return Exact(((name, (Fraction(1), Fraction(0), Fraction(0), Fraction(0))),))

    @property
    def is_number(self) -> bool:
        """Return whether no symbol takes part."""
        return all(not name for name, _ in self.terms)

    @property
    def is_rational(self) -> bool:
        """Return whether this is a rational number."""
        return self.is_number and not any(self.coefficient("")[1:])

    @property
    def symbols(self) -> tuple[str, ...]:
        """Return the names of the symbols that take part, sorted."""
        return tuple(name for name, _ in self.terms if name)

    def coefficient(self, name: str) -> Surd:
        """Return the coefficient of the symbol `name`; of one for the empty name."""
        return dict(self.terms).get(name, _NO_SURD)

    def __bool__(self) -> bool:
        """Return whether the value differs from zero."""
        return bool(self.terms)

    def __neg__(self) -> "Exact":
        """Return the value with the other sign."""
        return Exact(tuple((name, (-s[0], -s[1], -s[2], -s[3])) for name, s in self.terms))

    def __add__(self, other: "Exact") -> "Exact":
        """Return the sum."""
        total = dict(self.terms)
        for name, s in other.terms:
            o = total.get(name, _NO_SURD)
            total[name] = (o[0] + s[0], o[1] + s[1], o[2] + s[2], o[3] + s[3])
        return Exact(tuple(sorted((name, s) for name, s in total.items() if any(s))))

    def __sub__(self, other: "Exact") -> "Exact":
        """Return the difference."""
        return self + (-other)

    def __mul__(self, other: "Exact") -> "Exact":
        """Return the product, of which one factor must be a number.

        Raises:
            ValueError: both factors hold symbols.
        """
        number, form = (self, other) if self.is_number else (other, self)
        if not number.is_number:
            message = f"the product of {self} and {other} is not a linear form"
            raise ValueError(message)
        factor = number.coefficient("")
        terms = ((name, _multiply_surds(factor, s)) for name, s in form.terms)
        return Exact(tuple((name, s) for name, s in terms if any(s)))

    def to_float(self, values: Mapping[str, float] | None = None) -> float:
        """Return the value in floating point, symbols replaced by `values`.

        Raises:
            KeyError: a symbol has no value.
        """
        total = 0.0
        for name, s in self.terms:
            coefficient = sum(float(c) * root for c, root in zip(s, _ROOTS, strict=True) if c)
            total += coefficient * ((values or {})[name] if name else 1.0)
        return total

    def __str__(self) -> str:
        """Return the value as a sum, for example `1/2*sqrt(3)*L1`."""
        return "+".join(self._write_terms()).replace("+-", "-") or "0"

    def _write_terms(self) -> Iterator[str]:
        for name, s in self.terms:
            for c, root in zip(s, _ROOT_NAMES, strict=True):
                factors = [part for part in (root, name) if part]
                if c and (abs(c) != 1 or not factors):
                    factors.insert(0, str(c))
                elif c == -1:
                    factors[0] = "-" + factors[0]
                if c:
                    yield "*".join(factors)


ZERO = Exact()
ONE = Exact.of(1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Angle:
    """An angle with exact cosine and sine, and how far it was moved to get them (rad)."""

    cosine: Exact
    sine: Exact
    radians: float
    snapped_by: float = 0.0


# cos(k * pi/12) for k = 0..6 over (1, sqrt 2, sqrt 3, sqrt 6).
_COSINES = (
    ONE,
    Exact.surd(Fraction(0), Fraction(1, 4), 0, Fraction(1, 4)),
    Exact.surd(Fraction(0), 0, Fraction(1, 2)),
    Exact.surd(Fraction(0), Fraction(1, 2)),
    Exact.surd(Fraction(1, 2)),
    Exact.surd(Fraction(0), Fraction(-1, 4), 0, Fraction(1, 4)),
    ZERO,
)
_FULL_TURN = 24
_WRITTEN_OUT = 1e-9
_HALF_TANGENT_DENOMINATOR = 10**8


def _cosine_of_twelfths(k: int) -> Exact:
    k = k % _FULL_TURN
    k = min(k, _FULL_TURN - k)
    return _COSINES[k] if k <= 6 else -_COSINES[12 - k]


def find_angle(radians: float, *, snap: float = 1e-5) -> Angle:
    """Return the angle with exact cosine and sine.

    Args:
        radians: the angle as written, in rad.
        snap: distance in rad within which it is moved to a multiple of pi/2; zero turns
            that off. Multiples of pi/12 written to 1e-9 or better are always met.
    """
    twelfths = round(radians / (math.pi / 12))
    moved = twelfths * (math.pi / 12) - radians
    allowed = max(snap, _WRITTEN_OUT) if twelfths % 6 == 0 and snap else _WRITTEN_OUT
    if abs(moved) <= allowed:
        exact = twelfths * (math.pi / 12)
        cosine, sine = _cosine_of_twelfths(twelfths), _cosine_of_twelfths(twelfths - 6)
        # Rounding of the input is no move worth a notice.
        return Angle(
            cosine=cosine, sine=sine, radians=exact, snapped_by=moved if abs(moved) > _WRITTEN_OUT else 0.0
        )
    turn = math.remainder(radians, 2 * math.pi)
    # Near a half turn the half-angle tangent is huge: go through the opposite angle.
    opposite = abs(turn) > math.pi / 2
    half = math.remainder(turn - math.pi, 2 * math.pi) / 2 if opposite else turn / 2
    t = Fraction(math.tan(half)).limit_denominator(_HALF_TANGENT_DENOMINATOR)
    sign = -1 if opposite else 1
    cosine = Exact.surd(sign * (1 - t * t) / (1 + t * t))
    return Angle(cosine=cosine, sine=Exact.surd(sign * 2 * t / (1 + t * t)), radians=radians)


Row = tuple[Exact, Exact, Exact]


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """A frame seen from another: columns of `rotation` are its axes, `translation` its origin (m)."""

    rotation: tuple[Row, Row, Row]
    translation: Row


IDENTITY = Placement(
    rotation=((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE)), translation=(ZERO, ZERO, ZERO)
)


def rotate_x(angle: Angle) -> Placement:
    """Return the frame turned about x by `angle`."""
    c, s = angle.cosine, angle.sine
    rotation = ((ONE, ZERO, ZERO), (ZERO, c, -s), (ZERO, s, c))
    return Placement(rotation=rotation, translation=IDENTITY.translation)


def rotate_z(angle: Angle) -> Placement:
    """Return the frame turned about z by `angle`."""
    c, s = angle.cosine, angle.sine
    rotation = ((c, -s, ZERO), (s, c, ZERO), (ZERO, ZERO, ONE))
    return Placement(rotation=rotation, translation=IDENTITY.translation)


def translate(x: Exact, y: Exact, z: Exact) -> Placement:
    """Return the frame moved by (x, y, z), in m."""
    return Placement(rotation=IDENTITY.rotation, translation=(x, y, z))


def _dot(left: Row, right: Row) -> Exact:
    return left[0] * right[0] + left[1] * right[1] + left[2] * right[2]


def compose_placements(outer: Placement, inner: Placement) -> Placement:
    """Return `inner`, given in the frame `outer`, seen from where `outer` is seen from."""
    columns = list(zip(*inner.rotation, strict=True))
    r0, r1, r2 = (
        (_dot(row, columns[0]), _dot(row, columns[1]), _dot(row, columns[2])) for row in outer.rotation
    )
    t0, t1, t2 = (
        shift + _dot(row, inner.translation)
        for row, shift in zip(outer.rotation, outer.translation, strict=True)
    )
    return Placement(rotation=(r0, r1, r2), translation=(t0, t1, t2))


def place_modified_dh(alpha: Angle, a: Exact, d: Exact, theta: Angle) -> Placement:
    """Return link frame j seen from link frame j-1 for a modified DH row.

    Rot(x, alpha) Trans(x, a) Rot(z, theta) Trans(z, d)   (Khalil and Kleinfinger 1986; Craig 1986).

    Args:
        alpha: twist of the previous link, rad.
        a: length of the previous link, m.
        d: offset along the joint axis, m.
        theta: angle about the joint axis, rad.
    """
    before = compose_placements(rotate_x(alpha), translate(a, ZERO, ZERO))
    return compose_placements(before, compose_placements(translate(ZERO, ZERO, d), rotate_z(theta)))
