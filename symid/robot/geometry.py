"""Exact numbers, angles, rotations and placements.

Decimals, multiples of pi, names of symbolic lengths, directions of axes -> `Exact` numbers (linear forms
over symbols whose coefficients lie in the field Q(sqrt(2), sqrt(3))), `Angle`, `Placement`; inverses and
square roots in that field; half-angle tangents, roll, pitch and yaw, quaternions and axes, both ways, without
rounding.

Supported: every multiple of pi/12 exactly; any other angle through a rational half-angle tangent, so that
cos^2 + sin^2 = 1 holds exactly. Every rotation matrix over the field has a quaternion in it, not of length
one; roll, pitch and yaw only where the cosine of the pitch lies in the field. Any axis but zero: exactly
where the field holds it, else some 1e-16 rad from what was written.
Not supported: products of two symbolic lengths (no placement needs one).
"""

import decimal
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from fractions import Fraction
from typing import TypeVar

Ratio = Fraction | int
Surd = tuple[Fraction, Fraction, Fraction, Fraction]
"""Coefficients of 1, sqrt(2), sqrt(3), sqrt(6)."""

_RADICANDS = (1, 2, 3, 6)
_ROOT_VALUES = tuple(math.sqrt(radicand) for radicand in _RADICANDS)
_ROOT_NAMES = ("", "sqrt(2)", "sqrt(3)", "sqrt(6)")
# Product of basis elements i and j: (factor, basis element).
_PRODUCTS = (
    ((1, 0), (1, 1), (1, 2), (1, 3)),
    ((1, 1), (2, 0), (1, 3), (2, 2)),
    ((1, 2), (1, 3), (3, 0), (3, 1)),
    ((1, 3), (2, 2), (3, 1), (6, 0)),
)
_NO_SURD: Surd = (Fraction(0),) * 4
# How sqrt(2), sqrt(3) and sqrt(6) change their signs under the four automorphisms of the field.
_SIGNS = ((1, 1, 1, 1), (1, -1, 1, -1), (1, 1, -1, -1), (1, -1, -1, 1))


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
    def surd(one: Ratio, two: Ratio = 0, three: Ratio = 0, six: Ratio = 0) -> "Exact":
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
        """Return the product, or raise a ValueError where both factors hold symbols."""
        number, form = (self, other) if self.is_number else (other, self)
        if not number.is_number:
            message = f"the product of {self} and {other} is not a linear form"
            raise ValueError(message)
        terms = []
        for name, s in form.terms:
            total = list(_NO_SURD)
            for (i, a), (j, b) in itertools.product(enumerate(number.coefficient("")), enumerate(s)):
                if a and b:
                    factor, basis = _PRODUCTS[i][j]
                    total[basis] += factor * a * b
            if any(total):
                terms.append((name, (total[0], total[1], total[2], total[3])))
        return Exact(tuple(terms))

    def to_float(self, values: Mapping[str, float] | None = None) -> float:
        """Return the value in floating point, symbols replaced by `values` (KeyError: one is missing)."""
        total = 0.0
        for name, s in self.terms:
            coefficient = sum(float(c) * root for c, root in zip(s, _ROOT_VALUES, strict=True) if c)
            total += coefficient * ((values or {})[name] if name else 1.0)
        return total

    def __str__(self) -> str:
        """Return the value as a sum, for example `1/2*sqrt(3)*L1`."""
        terms = []
        for name, s in self.terms:
            for c, root in zip(s, _ROOT_NAMES, strict=True):
                factors = [part for part in (root, name) if part]
                if abs(c) != 1 or not factors:
                    factors.insert(0, str(c))
                elif c == -1:
                    factors[0] = "-" + factors[0]
                terms += ["*".join(factors)] if c else []
        return "+".join(terms).replace("+-", "-") or "0"


ZERO = Exact()
ONE = Exact.of(1)
_TWO = Exact.of(2)
N = TypeVar("N", Exact, float)


@dataclass(frozen=True, slots=True, kw_only=True)
class Angle:
    """An angle with exact cosine and sine, and how far it was moved to get them (rad)."""

    cosine: Exact
    sine: Exact
    radians: float
    snapped_by: float = 0.0

    @staticmethod
    def of(cosine: Exact, sine: Exact) -> "Angle":
        """Return the angle with this cosine and sine."""
        return Angle(cosine=cosine, sine=sine, radians=math.atan2(sine.to_float(), cosine.to_float()))


# cos(k * pi/12) for k = 0..6 over (1, sqrt 2, sqrt 3, sqrt 6).
_COSINES = (
    ONE,
    Exact.surd(0, Fraction(1, 4), 0, Fraction(1, 4)),
    Exact.surd(0, 0, Fraction(1, 2)),
    Exact.surd(0, Fraction(1, 2)),
    Exact.surd(Fraction(1, 2)),
    Exact.surd(0, Fraction(-1, 4), 0, Fraction(1, 4)),
    ZERO,
)
ROUNDED = 1e-9
"""Angles below this (rad) are the rounding of what was written."""
_EXACT = 1e-14
"""What is left of zero after a few operations in doubles, in rad: less than this moves nothing."""
_HALF_TANGENT_DENOMINATOR = 10**8
_WRITTEN_DIGITS = 3
"""A number with fewer digits is no rounded multiple of pi/2: 1.6 is 0.03 rad away, 1.57 is 0.0008."""


def _cosine_of_twelfths(k: int) -> Exact:
    k = min(k % 24, -k % 24)
    return _COSINES[k] if k <= 6 else -_COSINES[12 - k]


def get_tolerance(snap: float) -> float:
    """Return the angle (rad) within which rotations are equal: `snap`, or for zero what doubles leave."""
    return max(snap, ROUNDED) if snap else _EXACT


def is_rounded_turn(radians: Decimal) -> bool:
    """Return whether an angle is a multiple of pi/2 but zero, rounded or cut to its digits: 1.57, 3.1415."""
    turn = round(float(radians) / (math.pi / 2)) * Decimal(math.pi) / 2
    _, digits, exponent = radians.as_tuple()
    if not turn or not isinstance(exponent, int) or not -15 < exponent < 0 or len(digits) < _WRITTEN_DIGITS:
        return False
    if abs(turn - radians) < ROUNDED:
        return False
    step = Decimal(1).scaleb(exponent)
    ways = (decimal.ROUND_HALF_EVEN, decimal.ROUND_DOWN)
    return any(turn.quantize(step, rounding=way) == radians for way in ways)


def build_exact_angle(radians: float, *, snap: float = 1e-5) -> Angle:
    """Return the angle with exact cosine and sine.

    Within `snap` (rad) it is moved to a multiple of pi/2, and multiples of pi/12 written to 1e-9 or better
    are met. Zero turns both off: the angle is that of the double, to 1e-15 rad.
    """
    twelfths = round(radians / (math.pi / 12))
    moved = twelfths * (math.pi / 12) - radians
    if abs(moved) <= get_tolerance(snap if twelfths % 6 == 0 else min(snap, ROUNDED)):
        cosine, sine = _cosine_of_twelfths(twelfths), _cosine_of_twelfths(twelfths - 6)
        # Rounding of the input is no move worth a notice.
        snapped_by = moved if abs(moved) > ROUNDED else 0.0
        return Angle(cosine=cosine, sine=sine, radians=twelfths * (math.pi / 12), snapped_by=snapped_by)
    turn = math.remainder(radians, 2 * math.pi)
    # Near a half turn the half-angle tangent is huge: go through the opposite angle.
    opposite = abs(turn) > math.pi / 2
    half = math.remainder(turn - math.pi, 2 * math.pi) / 2 if opposite else turn / 2
    t = Fraction(math.tan(half)).limit_denominator(_HALF_TANGENT_DENOMINATOR ** (1 if snap else 2))
    scale = (-1 if opposite else 1) / (1 + t * t)
    return Angle(cosine=Exact.surd(scale * (1 - t * t)), sine=Exact.surd(scale * 2 * t), radians=radians)


ExactVector = tuple[Exact, Exact, Exact]
ExactMatrix = tuple[ExactVector, ExactVector, ExactVector]


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """A frame seen from another: columns of `rotation` are its axes, `translation` its origin (m)."""

    rotation: ExactMatrix
    translation: ExactVector


_ORIGIN = (ZERO, ZERO, ZERO)
IDENTITY = Placement(rotation=((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE)), translation=_ORIGIN)


def rotate_x(angle: Angle) -> Placement:
    """Return the frame turned about x by `angle`."""
    c, s = angle.cosine, angle.sine
    return Placement(rotation=((ONE, ZERO, ZERO), (ZERO, c, -s), (ZERO, s, c)), translation=_ORIGIN)


def rotate_y(angle: Angle) -> Placement:
    """Return the frame turned about y by `angle`."""
    c, s = angle.cosine, angle.sine
    return Placement(rotation=((c, ZERO, s), (ZERO, ONE, ZERO), (-s, ZERO, c)), translation=_ORIGIN)


def rotate_z(angle: Angle) -> Placement:
    """Return the frame turned about z by `angle`."""
    c, s = angle.cosine, angle.sine
    return Placement(rotation=((c, -s, ZERO), (s, c, ZERO), (ZERO, ZERO, ONE)), translation=_ORIGIN)


def rotate_rpy(roll: Angle, pitch: Angle, yaw: Angle) -> Placement:
    """Return the frame turned by angles about fixed axes, Rz(yaw) Ry(pitch) Rx(roll), as in URDF."""
    return compose_placements(rotate_z(yaw), rotate_y(pitch), rotate_x(roll))


def translate(x: Exact, y: Exact, z: Exact) -> Placement:
    """Return the frame moved by (x, y, z), in m."""
    return Placement(rotation=IDENTITY.rotation, translation=(x, y, z))


def place_joint(
    position: Exact, symbols: Mapping[str, float] | None = None, *, prismatic: bool, snap: float
) -> Placement:
    """Return the frame of a joint at a position (rad or m), seen from its frame at zero."""
    if prismatic:
        return translate(ZERO, ZERO, position)
    return rotate_z(build_exact_angle(position.to_float(symbols), snap=snap))


def _dot(left: ExactVector, right: ExactVector) -> Exact:
    return left[0] * right[0] + left[1] * right[1] + left[2] * right[2]


def compose_placements(outer: Placement, *others: Placement) -> Placement:
    """Return the last frame, each given in the one before it, seen from where `outer` is seen from."""
    for inner in others:
        if IDENTITY in (outer, inner):
            outer = inner if outer == IDENTITY else outer
            continue
        rows, (u, v, w) = outer.rotation, zip(*inner.rotation, strict=True)
        r0, r1, r2 = ((_dot(row, u), _dot(row, v), _dot(row, w)) for row in rows)
        x, y, z = (t + _dot(row, inner.translation) for row, t in zip(rows, outer.translation, strict=True))
        outer = Placement(rotation=(r0, r1, r2), translation=(x, y, z))
    return outer


def place_modified_dh(alpha: Angle, a: Exact, d: Exact, theta: Angle) -> Placement:
    """Return link frame j seen from link frame j-1 for a modified DH row, lengths in m.

    Rot(x, alpha) Trans(x, a) Rot(z, theta) Trans(z, d)   (Khalil and Kleinfinger 1986; Craig 1986).
    """
    steps = (translate(a, ZERO, ZERO), translate(ZERO, ZERO, d), rotate_z(theta))
    return compose_placements(rotate_x(alpha), *steps)


def invert_exact(value: Exact) -> Exact:
    """Return 1 / value, or raise a ZeroDivisionError."""
    others, surd = ONE, value.coefficient("")
    for signs in _SIGNS[1:]:
        others = others * Exact.surd(*(sign * part for sign, part in zip(signs, surd, strict=True)))
    norm = (value * others).coefficient("")[0]
    return others * Exact.surd(1 / norm)


def compute_square_root(value: Exact) -> Exact | None:
    """Return the root of `value` that is not negative, None where it is no number of the field."""
    root = _compute_root(value, (3, 2))
    if root is None:
        return None
    parts = root.coefficient("")
    # Enough digits for the sign, however much cancels: the product of the conjugates is no smaller.
    digits = sum(len(str(part.numerator)) + len(str(part.denominator)) for part in parts)
    with decimal.localcontext(prec=4 * digits + 30):
        terms = (
            Decimal(c.numerator) / c.denominator * Decimal(r).sqrt()
            for c, r in zip(parts, _RADICANDS, strict=True)
        )
        return root if sum(terms) >= 0 else -root


def _compute_root(value: Exact, radicands: tuple[int, ...]) -> Exact | None:
    """Return a root of `value` in Q with the roots of these radicands, (3, 2), (2,) or (); None without one.

    In K(sqrt(r)) it is c + b / (2 c) sqrt(r) of a + b sqrt(r), with c^2 = (a + n) / 2 and n^2 = a^2 - r b^2,
    n (of either sign) and c in K; for b = 0 it is that of a, or sqrt(r) times that of a / r.
    """
    one, two, three, six = value.coefficient("")
    if not radicands:
        root = Exact.surd(Fraction(math.isqrt(abs(one.numerator)), math.isqrt(one.denominator)))
        return root if root * root == value else None
    r, *rest = radicands
    inner = tuple(rest)
    a, b = (Exact.surd(one, two), Exact.surd(three, six)) if inner else (Exact.surd(one), Exact.surd(two))
    root_of_r = Exact.surd(0, 0, 1) if inner else Exact.surd(0, 1)
    if not b:
        found = _compute_root(a, inner)
        if found is None:
            found = _compute_root(a * Exact.surd(Fraction(1, r)), inner)
            found = None if found is None else found * root_of_r
        return found
    norm = _compute_root(a * a - Exact.of(r) * b * b, inner)
    for double in () if norm is None else (a + norm, a - norm):
        c = _compute_root(double * Exact.surd(Fraction(1, 2)), inner)
        if c is not None:
            return c + b * invert_exact(c + c) * root_of_r
    return None


def build_tangent_angle(tangent: Exact) -> Angle:
    """Return the angle 2 atan(t): cos = (1 - t^2) / (1 + t^2), sin = 2 t / (1 + t^2)."""
    square = tangent * tangent
    scale = invert_exact(ONE + square)
    cosine, sine = (ONE - square) * scale, _TWO * tangent * scale
    return Angle(cosine=cosine, sine=sine, radians=2 * math.atan(tangent.to_float()))


def compute_rotation(quaternion: Sequence[Exact]) -> ExactMatrix:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any length but zero."""
    w, x, y, z = quaternion
    scale = _TWO * invert_exact(w * w + x * x + y * y + z * z)
    return (
        (ONE - scale * (y * y + z * z), scale * (x * y - w * z), scale * (x * z + w * y)),
        (scale * (x * y + w * z), ONE - scale * (x * x + z * z), scale * (y * z - w * x)),
        (scale * (x * z - w * y), scale * (y * z + w * x), ONE - scale * (x * x + y * y)),
    )


def list_quaternions(rotation: Sequence[Sequence[N]], one: N) -> tuple[tuple[N, N, N, N], ...]:
    """Return four multiples of the quaternion q = (w, x, y, z) of a rotation, the rows of 4 q q'.

    Their entries are linear in those of the matrix (Bar-Itzhack 2000, Journal of Guidance, Control, and
    Dynamics 23(6)).
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation
    return (
        (one + (a + e + i), h - f, c - g, d - b),
        (h - f, one + a - e - i, b + d, c + g),
        (c - g, b + d, one + e - i - a, f + h),
        (d - b, c + g, f + h, one + i - a - e),
    )


def compute_quaternion(rotation: ExactMatrix) -> tuple[Exact, ...]:
    """Return a quaternion (w, x, y, z) of the matrix, scaled so that its parts have no denominators."""
    rows = list_quaternions(rotation, ONE)
    largest = max(range(4), key=lambda k: rows[k][k].to_float())
    scale = invert_exact(rows[largest][largest])
    scaled = [entry * scale for entry in rows[largest]]
    below = math.lcm(*(part.denominator for entry in scaled for part in entry.coefficient("")))
    return tuple(entry * Exact.of(below) for entry in scaled)


def compute_unit_quaternion(rotation: ExactMatrix) -> list[float]:
    """Return the quaternion (w, x, y, z) of length one in floating point."""
    entries = [entry.to_float() for entry in compute_quaternion(rotation)]
    return [entry / math.hypot(*entries) for entry in entries]


def compute_rpy(rotation: ExactMatrix) -> tuple[Angle, Angle, Angle] | None:
    """Return roll, pitch and yaw of the matrix, None where their cosines and sines are not in the field."""
    sine = -rotation[2][0]
    cosine = compute_square_root(ONE - sine * sine)
    if cosine is None:
        return None
    if cosine:
        scale = invert_exact(cosine)
        roll = Angle.of(rotation[2][2] * scale, rotation[2][1] * scale)
        yaw = Angle.of(rotation[0][0] * scale, rotation[1][0] * scale)
    else:
        # Roll and yaw turn about one axis; the yaw does it all.
        roll, yaw = Angle.of(ONE, ZERO), Angle.of(rotation[1][1], -rotation[0][1])
    angles = (roll, Angle.of(cosine, sine), yaw)
    return angles if rotate_rpy(*angles).rotation == rotation else None


def invert_placement(placement: Placement) -> Placement:
    """Return the outer frame seen from the inner one: R' and -R' p."""
    r0, r1, r2 = zip(*placement.rotation, strict=True)
    x, y, z = (-value for value in placement.translation)
    return compose_placements(Placement(rotation=(r0, r1, r2), translation=_ORIGIN), translate(x, y, z))


def to_floats(placement: Placement) -> tuple[tuple[float, ...], ...]:
    """Return the rotation in floating point, row by row."""
    return tuple(tuple(entry.to_float() for entry in row) for row in placement.rotation)


def build_axis_frame(axis: Sequence[Fraction], *, snap: float = 1e-5) -> tuple[Placement, float]:
    """Return a rotation that takes z to the direction of `axis`, which is not zero, and how far off (rad).

    An axis within `snap` (rad) of a coordinate axis is taken as that axis.
    """
    size = max(map(abs, axis))
    x, y, z = values = [value / size for value in axis]
    index = max(range(3), key=lambda k: abs(values[k]))
    others = math.hypot(*(float(value) for k, value in enumerate(values) if k != index))
    moved = math.atan2(others, abs(float(values[index])))
    if moved <= get_tolerance(snap):
        quarters = 1 if values[index] > 0 else -1
        angle = build_exact_angle((0 if quarters > 0 else math.pi) if index == 2 else quarters * math.pi / 2)
        # z goes to y by a quarter turn back about x.
        return (rotate_y(angle), rotate_x(Angle.of(angle.cosine, -angle.sine)), rotate_x(angle))[index], moved
    flat = compute_square_root(Exact.surd(x * x + y * y))
    length = compute_square_root(Exact.surd(x * x + y * y + z * z))
    if flat and length:
        by_length, by_flat = invert_exact(length), invert_exact(flat)
        pitch = Angle.of(Exact.surd(z) * by_length, flat * by_length)
        yaw = Angle.of(Exact.surd(x) * by_flat, Exact.surd(y) * by_flat)
    else:
        pitch = build_exact_angle(math.atan2(math.hypot(x, y), z), snap=snap)
        yaw = build_exact_angle(math.atan2(y, x), snap=snap)
    placement = compose_placements(rotate_z(yaw), rotate_y(pitch))
    # The angle between the axis and where the rotation takes z.
    u, v = [row[2].to_float() for row in placement.rotation], [float(x), float(y), float(z)]
    cross = [u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3] for k in range(3)]
    return placement, math.atan2(math.hypot(*cross), sum(a * b for a, b in zip(u, v, strict=True)))


def snap_to_quarter_turns(placement: Placement, *, snap: float = 1e-5) -> Placement | None:
    """Return `placement` with the rotation of entries 0, 1 and -1 that it is near, None without one."""
    rows = to_floats(placement)
    moved = max(abs(value - round(value)) for row in rows for value in row)
    if moved > get_tolerance(snap):
        return None
    r0, r1, r2 = ((Exact.of(round(x)), Exact.of(round(y)), Exact.of(round(z))) for x, y, z in rows)
    turned = replace(placement, rotation=(r0, r1, r2))
    return None if turned == placement else turned
