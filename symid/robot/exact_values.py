"""Exact numbers, angles and placements as a robot file writes them, both ways.

A decimal or a text such as "-L1", "1/3", "1/2*sqrt(3)*L1 + 0.1" -> `Exact`, a linear form over the file's
symbols. "pi/2", "90 deg", "2*atan(1/3)" -> `Angle`. A row (alpha, a, d, theta), or a table { xyz = [..],
rpy = [..] } (angles about fixed axes, as in URDF) or with quaternion = [w, x, y, z] of any length but zero
-> the joint's frame, whose z axis is its axis, seen from the link before it at q = 0. The writers give
texts that are read back exactly: a frame is a row where it is one, else an origin with roll, pitch and yaw,
else an origin with a quaternion.

Supported: sums of products of decimals, fractions, sqrt(2), sqrt(3), sqrt(6) and at most one symbol each; a
symbol is a length, a mass, an inertia or an acceleration, whichever it is used as first; constants with pi
and degrees, read as floats. Modified rows, Rot(x, alpha) Trans(x, a) Rot(z, theta) Trans(z, d), with alpha
and a of the link before; standard rows, Rot(z, theta) Trans(z, d) Trans(x, a) Rot(x, alpha), converted
without rounding.
Not supported: products of symbols, brackets; symbols in constants of a log; the extra parameters of Khalil
and Kleinfinger for trees whose branches need them.
"""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction

from symid.robot.geometry import (
    IDENTITY,
    ZERO,
    Angle,
    Exact,
    ExactMatrix,
    Placement,
    build_exact_angle,
    build_tangent_angle,
    compose_placements,
    compute_half_tangent,
    compute_quaternion,
    compute_rotation,
    compute_rpy,
    place_modified_dh,
    rotate_rpy,
    rotate_x,
    rotate_z,
    translate,
)
from symid.robot.toml_values import (
    ANY,
    Range,
    Section,
    explain_number,
    get_element,
    has_list,
    read_table,
    suggest_names,
    to_decimal,
)

_FACTOR = r"(?:\d+(?:\.\d+)?(?:[eE][-+]?\d{1,2})?|sqrt\(\s*[236]\s*\)|[A-Za-z][A-Za-z0-9_]*)"
_TERM = re.compile(rf"\s*(?P<sign>[-+]?)\s*(?P<first>{_FACTOR})(?P<others>(?:\s*[*/]\s*{_FACTOR})*)\s*")
_NEXT = re.compile(rf"\s*(?P<operator>[*/])\s*(?P<factor>{_FACTOR})")
_FRACTION = re.compile(r"\s*[-+]?\d{1,18}(?:\.\d{1,18})?(?:\s*/\s*\d{1,18})?\s*")
_LONGEST = 2000
_ROOTS = {
    2: Exact.surd(Fraction(0), 1),
    3: Exact.surd(Fraction(0), 0, 1),
    6: Exact.surd(Fraction(0), 0, 0, 1),
}
_EXAMPLES = {"m": "L1", "kg": "m1", "kg*m^2": "I1", "m/s^2": "-g"}
_NOUNS = {"m": "a length", "kg": "a mass", "kg*m^2": "an inertia", "m/s^2": "an acceleration"}
_TYPICAL = {"m": "0.5", "kg": "2.5", "kg*m^2": "0.01", "m/s^2": "9.81"}


@dataclass(frozen=True, slots=True)
class Symbols:
    """The symbols of a file, and what each turned out to be while the file is read."""

    values: Mapping[str, float]
    units: dict[str, str] = field(default_factory=dict)


def parse_linear_form(text: str) -> Exact | None:
    """Return the linear form that `text` writes, or None if it writes none."""
    if len(text) > _LONGEST or not text.strip():
        return None
    total, position = ZERO, 0
    while position < len(text):
        match = _TERM.match(text, position)
        if not match or (position and not match["sign"]):
            return None
        term = _parse_product(match["first"], match["others"])
        if term is None:
            return None
        total += -term if match["sign"] == "-" else term
        position = match.end()
    return total


def _parse_product(first: str, others: str) -> Exact | None:
    product = _parse_factor(first)
    for operator, factor in _NEXT.findall(others):
        other = _parse_factor(factor)
        if operator == "/":
            if not other or not other.is_number:
                return None
            # A factor is a rational number or a root; 1 / sqrt(n) is sqrt(n) / n.
            square = (other * other).coefficient("")[0]
            other = other * Exact.surd(1 / square)
        if not (product.is_number or other.is_number):
            return None
        product = product * other
    return product


def _parse_factor(text: str) -> Exact:
    if text.startswith("sqrt("):
        return _ROOTS[int(text[5:-1])]
    return Exact.of(text) if text[0].isdigit() else Exact.symbol(text)


def read_linear_form(
    section: Section,
    key: str,
    symbols: Symbols,
    unit: str,
    *inner: int,
    allowed: Range = ANY,
    code: str = "robot.wrong-type",
) -> Exact | None:
    """Return the number or form at `key`, or at its element `inner`; None where it is absent or wrong.

    Args:
        section: the table.
        key: the name of the value.
        symbols: those of the file; the first use of a symbol says what it is.
        unit: "m", "kg", "kg*m^2" or "m/s^2".
        inner: the index of an element, where the value is a list.
        allowed: what the number may be, with the symbols' values put in.
        code: of the notice that tells a value which is neither number nor form.
    """
    value = get_element(section, key, *inner)
    if value is None:
        return None
    number = to_decimal(value)
    form = Exact.of(str(number)) if number is not None else None
    if form is None and isinstance(value, str):
        form = parse_linear_form(value)
    if form is None:
        got = f"{section.show(key, *inner)}{explain_number(value, unit)}"
        expected = f'expected a number in {unit} or a symbol such as "{_EXAMPLES[unit]}"'
        section.refuse(code, key, f"{expected}, got {got}", *inner)
        return None
    if not _check_symbols(section, key, form, symbols, unit, *inner):
        return None
    if (size := form.to_float(symbols.values)) not in allowed:
        shown = section.show(key, *inner) + ("" if form.is_number else f", which is {size:g}")
        section.refuse("robot.out-of-range", key, f"must be {allowed} {unit}, got {shown}", *inner)
        return None
    return form


def _check_symbols(section: Section, key: str, form: Exact, symbols: Symbols, unit: str, *inner: int) -> bool:
    good = True
    for name in form.symbols:
        if name not in symbols.values:
            hint = suggest_names(name, symbols.values)
            hint = hint or f"write {name} = {_TYPICAL[unit]} (its value in {unit}) there"
            text = f"the symbol {name} has no value in [symbols]; {hint}"
            section.refuse("robot.unknown-symbol", key, text, *inner)
            good = False
        elif symbols.units.setdefault(name, unit) != unit:
            before = symbols.units[name]
            text = f"{name} was {_NOUNS[before]} ({before}) before, and is {_NOUNS[unit]} ({unit}) here"
            section.refuse("robot.symbol-unit", key, f"{text}; give each quantity its own symbol", *inner)
            good = False
    return good


def read_fraction(section: Section, key: str, instead_of_zero: str) -> Fraction | None:
    """Return the number at `key` exactly, a decimal or a text such as "1/3".

    Args:
        section: the table.
        key: the name of the value.
        instead_of_zero: what to do where it is 0, which it must not be.
    """
    value = section.values.get(key)
    if value is None:
        return None
    number = to_decimal(value)
    found = None if number is None else Fraction(number)
    if isinstance(value, str) and _FRACTION.fullmatch(value):
        above, _, below = value.partition("/")
        divisor = Fraction(below.strip() or 1)
        found = Fraction(above.strip()) / divisor if divisor else None
    if found is None:
        section.refuse(
            "robot.wrong-type", key, f'expected a number or a fraction "1/3", got {section.show(key)}'
        )
    elif not found:
        section.refuse("robot.out-of-range", key, f"must not be 0; {instead_of_zero}")
        return None
    return found


_CONSTANT_DEGREES = re.compile(r"\s*(?P<degrees>[-+]?\d+(?:\.\d+)?)\s*deg\s*")


def read_constant(section: Section, key: str, expected: str, *inner: int) -> float | None:
    """Return the number at `key`, or at its element `inner`; None where it is absent or wrong.

    Args:
        section: the table.
        key: the name of the value.
        expected: in words what is wanted there, for the message.
        inner: indices of an element, where the value is a list.
    """
    value = get_element(section, key, *inner)
    if value is None:
        return None
    found = _parse_constant(value)
    if found is None:
        examples = 'such as 0.5, "-pi/2" or "90 deg"'
        text = f"expected {expected}, {examples}; got {section.show(key, *inner)}"
        section.refuse("robot.wrong-type", key, text, *inner)
    return found


def _parse_constant(value: object) -> float | None:
    number = to_decimal(value)
    if number is not None:
        return float(number)
    if not isinstance(value, str):
        return None
    if match := _CONSTANT_DEGREES.fullmatch(value):
        return math.radians(float(match["degrees"]))
    form = parse_linear_form(value)
    if form is None or any(name != "pi" for name in form.symbols):
        return None
    return form.to_float({"pi": math.pi})


_FRACTION_OF_PI = re.compile(
    r"(?P<sign>[-+]?)\s*(?:(?P<times>\d+(?:\.\d+)?)\s*\*?\s*)?pi\s*(?:/\s*(?P<by>\d+(?:\.\d+)?))?"
)
_DEGREES = re.compile(r"(?P<degrees>[-+]?\d+(?:\.\d+)?)\s*deg")
_TANGENT = re.compile(r"2\s*\*?\s*atan\((?P<tangent>.+)\)")
ZERO_ANGLE = build_exact_angle(0.0)
DH_KEYS = ("alpha", "a", "d", "theta")
_LARGEST_ANGLE = 12.0
_LARGEST_LENGTH = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class DhRow:
    """A row of a Denavit-Hartenberg table; the joint's coordinate is added to `theta` or `d`."""

    alpha: Angle = ZERO_ANGLE
    a: Exact = ZERO
    d: Exact = ZERO
    theta: Angle = ZERO_ANGLE


def build_row_frames(row: DhRow, convention: str) -> tuple[Placement, Placement]:
    """Return the joint's frame at q = 0 seen from the link before it, and the link's seen from the joint's.

    Args:
        row: the joint's row.
        convention: "modified" or "standard". A modified row ends in the joint's frame, which is the
            link's; a standard row goes on to the far end of the link, Trans(x, a) Rot(x, alpha).
    """
    if convention == "modified":
        return place_modified_dh(row.alpha, row.a, row.d, row.theta), IDENTITY
    near = place_modified_dh(ZERO_ANGLE, ZERO, row.d, row.theta)
    return near, compose_placements(translate(row.a, ZERO, ZERO), rotate_x(row.alpha))


def read_dh_row(section: Section, symbols: Symbols) -> DhRow:
    """Return the row of a joint's table; what cannot be read is reported and taken as zero."""
    return DhRow(
        alpha=read_angle(section, "alpha"),
        a=read_length(section, "a", symbols),
        d=read_length(section, "d", symbols),
        theta=read_angle(section, "theta"),
    )


def _parse_radians(value: object) -> float | None:
    """Return the angle in rad: a number, a fraction of pi such as "3*pi/4", or "90 deg"."""
    number = to_decimal(value)
    if number is not None:
        return float(number)
    if not isinstance(value, str):
        return None
    if match := _FRACTION_OF_PI.fullmatch(value.strip()):
        by = float(match["by"] or 1)
        size = float(match["times"] or 1) * math.pi / by if by else None
        return -size if size and match["sign"] == "-" else size
    if match := _DEGREES.fullmatch(value.strip()):
        return math.radians(float(match["degrees"]))
    return None


def _parse_tangent_angle(value: object) -> Angle | None:
    """Return the angle of a text such as "2*atan(1/3)", whose cosine and sine are those of the text."""
    match = _TANGENT.fullmatch(value.strip()) if isinstance(value, str) else None
    tangent = parse_linear_form(match["tangent"]) if match else None
    return build_tangent_angle(tangent) if tangent is not None and tangent.is_number else None


def read_angle(section: Section, key: str, *inner: int) -> Angle:
    """Return the angle at `key`, or at its element `inner`; zero where there is none.

    A number within 1e-5 rad of a multiple of pi/2 is taken as that multiple, and a warning says so.
    """
    value = get_element(section, key, *inner)
    if value is None:
        return ZERO_ANGLE
    if (exact := _parse_tangent_angle(value)) is not None:
        return exact
    radians = _parse_radians(value)
    shown = section.show(key, *inner)
    if radians is None:
        allowed = 'a number in rad, "pi/2", "-3*pi/4" or "90 deg"'
        section.refuse("robot.bad-angle", key, f"expected an angle, {allowed}; got {shown}", *inner)
        return ZERO_ANGLE
    if abs(radians) > _LARGEST_ANGLE and not isinstance(value, str):
        text = f'{shown} rad is about {radians / math.tau:.1f} turns; degrees are written "90 deg"'
        section.warn("robot.large-angle", key, text, *inner)
    angle = build_exact_angle(radians)
    if angle.snapped_by:
        quarters = round(angle.radians / (math.pi / 2))
        exact_text = {0: "0", 1: "pi/2", -1: "-pi/2", 2: "pi", -2: "-pi"}.get(quarters, f"{quarters}*pi/2")
        text = f'{shown} was moved by {angle.snapped_by:.2e} rad; write it as "{exact_text}"'
        section.warn("robot.angle-snapped", key, text, *inner)
    return angle


def read_length(section: Section, key: str, symbols: Symbols, *inner: int) -> Exact:
    """Return the length at `key` in m, or at its element `inner`: a number or a form; zero by default."""
    length = read_linear_form(section, key, symbols, "m", *inner, code="robot.bad-length")
    if length is None:
        return ZERO
    number = to_decimal(get_element(section, key, *inner))
    if number is not None and abs(number) > _LARGEST_LENGTH:
        text = f"{section.show(key, *inner)} m is long; lengths are in m"
        section.warn("robot.long-length", key, text, *inner)
    return length


def read_origin(section: Section, key: str, symbols: Symbols) -> Placement:
    """Return the frame at `key`; the identity where there is none or it is wrong."""
    table = read_table(section, key, ("xyz", "rpy", "quaternion"))
    if table is None:
        return IDENTITY
    x, y, z = (ZERO, ZERO, ZERO)
    if has_list(table, "xyz", 3, "lengths in m"):
        x, y, z = (read_length(table, "xyz", symbols, index) for index in range(3))
    if "rpy" in table.values and "quaternion" in table.values:
        text = "stands next to rpy, which says the same; keep one of the two"
        table.refuse_key("robot.two-forms", "quaternion", text)
    rotation = IDENTITY.rotation
    if has_list(table, "rpy", 3, "angles"):
        roll, pitch, yaw = (read_angle(table, "rpy", index) for index in range(3))
        rotation = rotate_rpy(roll, pitch, yaw).rotation
    if has_list(table, "quaternion", 4, "numbers w, x, y, z"):
        rotation = _read_quaternion(table)
    return Placement(rotation=rotation, translation=(x, y, z))


def _read_quaternion(table: Section) -> ExactMatrix:
    parts = []
    for index in range(4):
        value = get_element(table, "quaternion", index)
        number = to_decimal(value)
        form = Exact.of(str(number)) if number is not None else None
        if isinstance(value, str):
            form = parse_linear_form(value)
        if form is None or not form.is_number:
            got = table.show("quaternion", index)
            text = f'expected a number or a text such as "1+sqrt(2)", got {got}'
            table.refuse("robot.wrong-type", "quaternion", text, index)
            return IDENTITY.rotation
        parts.append(form)
    if not any(parts):
        table.refuse("robot.out-of-range", "quaternion", "must not be zero; no turn is [1, 0, 0, 0]")
        return IDENTITY.rotation
    return compute_rotation(parts)


_TWELFTHS = tuple((k, build_exact_angle(k * math.pi / 12)) for k in range(-11, 13))
_MOST_PLACES = 40
_COMMENT_COLUMN = 35
# Outside of this a number is a slip for the reader; a fraction in quotes is not.
_SMALLEST = Fraction(1, 10**30)
_LARGEST_WHOLE = 1e15


def write_number(value: float) -> str:
    """Return a number that is read back as the same float."""
    return str(int(value)) if value == int(value) and abs(value) < _LARGEST_WHOLE else repr(float(value))


def write_known(value: float | None) -> str:
    """Return a number, or the text that stands for one to be identified."""
    return '"unknown"' if value is None else write_number(value)


def add_comment(line: str, comment: str) -> str:
    """Return a line with a comment behind it, comments under each other where they can be."""
    return f"{line:<{_COMMENT_COLUMN}}# {comment}" if len(line) < _COMMENT_COLUMN else f"{line}  # {comment}"


def write_fraction(value: Fraction) -> str:
    """Return a rational number: a decimal where it ends soon, else a text such as "1/3"."""
    size = abs(value)
    if 10**_MOST_PLACES % value.denominator == 0 and (not size or _SMALLEST < size < 1 / _SMALLEST):
        places = next(k for k in range(_MOST_PLACES + 1) if 10**k % value.denominator == 0)
        whole = abs(value.numerator) * 10**places // value.denominator
        digits = f"{whole:0{places + 1}d}"
        point = len(digits) - places
        text = f"{digits[:point]}.{digits[point:]}" if places else digits
        return f"-{text}" if value < 0 else text
    return f'"{value}"'


def write_exact(value: Exact) -> str:
    """Return a number or form, such as 0.5, "L1" or "1/2*sqrt(3)"."""
    return write_fraction(value.coefficient("")[0]) if value.is_rational else f'"{value}"'


def write_angle(angle: Angle) -> str:
    """Return an angle that is read back with the same cosine and sine."""
    for k, twelfth in _TWELFTHS:
        if (angle.cosine, angle.sine) == (twelfth.cosine, twelfth.sine):
            return _write_twelfths(Fraction(k, 12))
    radians = math.atan2(angle.sine.to_float(), angle.cosine.to_float())
    found = build_exact_angle(radians)
    if (found.cosine, found.sine) == (angle.cosine, angle.sine):
        return repr(radians)
    return f'"2*atan({compute_half_tangent(angle.cosine, angle.sine)})"'


def _write_twelfths(part: Fraction) -> str:
    """Return a fraction of pi."""
    if not part:
        return "0"
    times = {1: "", -1: "-"}.get(part.numerator, f"{part.numerator}*")
    return f'"{times}pi"' if part.denominator == 1 else f'"{times}pi/{part.denominator}"'


def write_value(value: object) -> str:
    """Return a plain value: text, flag, number, list or table."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case int():
            return str(value)
        case float() | Decimal():
            return write_number(float(value))
        case Mapping():
            inner = ", ".join(f"{write_key(key)} = {write_value(entry)}" for key, entry in value.items())
            return f"{{ {inner} }}"
        case list() | tuple():
            return f"[{', '.join(write_value(entry) for entry in value)}]"
    message = f"no TOML for {type(value).__name__}"
    raise TypeError(message)


def write_key(key: str) -> str:
    """Return a key, in quotes where it needs them."""
    bare = key and all(letter.isascii() and (letter.isalnum() or letter in "_-") for letter in key)
    return key if bare else write_value(key)


def _keep_nonzero(entries: Mapping[str, str]) -> dict[str, str]:
    return {key: text for key, text in entries.items() if text != "0"}


def write_modified_row(placement: Placement) -> dict[str, str] | None:
    """Return alpha, a, d, theta of a frame, those that are zero left out; None where it is no such row.

    The rotation is Rx(alpha) Rz(theta), the translation (a, -sin(alpha) d, cos(alpha) d).
    """
    r, t = placement.rotation, placement.translation
    alpha = Angle.of(r[2][2], -r[1][2])
    theta = Angle.of(r[0][0], -r[0][1])
    d = alpha.cosine * t[2] - alpha.sine * t[1]
    if place_modified_dh(alpha, t[0], d, theta) != placement:
        return None
    texts = {"alpha": write_angle(alpha), "a": write_exact(t[0]), "d": write_exact(d)}
    return _keep_nonzero(texts | {"theta": write_angle(theta)})


def write_standard_row(near: Placement, frame: Placement) -> dict[str, str] | None:
    """Return alpha, a, d, theta of a joint's frame and its link's; None where they are no such row.

    Args:
        near: the joint's frame seen from the link before, Rz(theta) Tz(d).
        frame: the link's frame seen from the joint's, Tx(a) Rx(alpha).
    """
    theta = Angle.of(near.rotation[0][0], near.rotation[1][0])
    alpha = Angle.of(frame.rotation[1][1], frame.rotation[2][1])
    d, a = near.translation[2], frame.translation[0]
    turned = compose_placements(translate(ZERO, ZERO, d), rotate_z(theta))
    far = compose_placements(translate(a, ZERO, ZERO), rotate_x(alpha))
    if (turned, far) != (near, frame):
        return None
    texts = {"alpha": write_angle(alpha), "a": write_exact(a), "d": write_exact(d)}
    return _keep_nonzero(texts | {"theta": write_angle(theta)})


def write_origin(placement: Placement) -> str:
    """Return the table of a frame: xyz, and rpy or quaternion where it is turned."""
    parts = []
    if any(placement.translation):
        parts.append(f"xyz = [{', '.join(write_exact(entry) for entry in placement.translation)}]")
    if placement.rotation != IDENTITY.rotation:
        angles = compute_rpy(placement.rotation)
        if angles is not None:
            parts.append(f"rpy = [{', '.join(write_angle(angle) for angle in angles)}]")
        else:
            entries = compute_quaternion(placement.rotation)
            parts.append(f"quaternion = [{', '.join(write_exact(entry) for entry in entries)}]")
    return f"{{ {', '.join(parts)} }}" if parts else "{}"
