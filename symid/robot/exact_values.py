"""Exact numbers, angles and placements as a robot file writes them, both ways.

A decimal or a text such as "-L1", "1/3", "1/2*sqrt(3)*L1 + 0.1" -> `Exact`, a linear form over the file's
symbols. "pi/2", "90 deg", "2*atan(1/3)" -> `Angle`. A row (alpha, a, d, theta), or an origin with roll, pitch
and yaw or a quaternion of any length but zero -> the joint's frame, whose z axis is its axis, seen from the
link before it at q = 0. What is written is read back exactly.

Supported: sums of products of decimals, fractions, sqrt(2), sqrt(3), sqrt(6) and at most one symbol each; a
symbol is a length, a mass, an inertia or an acceleration, whichever it is used as first; constants with pi
and degrees, read as floats; modified and standard rows.
Not supported: products of symbols, brackets; symbols in constants of a log; the extra parameters of Khalil
and Kleinfinger for trees whose branches need them.
"""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal, localcontext
from fractions import Fraction

from symid.robot import geometry
from symid.robot.toml_values import ANY, Range, Section, explain_number, suggest_names, to_decimal

_FACTOR = r"(?:\d+(?:\.\d+)?(?:[eE][-+]?\d{1,2})?|sqrt\(\s*[236]\s*\)|[A-Za-z][A-Za-z0-9_]*)"
_STEP = re.compile(rf"\s*(?P<operator>[-+*/])\s*(?P<factor>{_FACTOR})\s*")
_FRACTION = re.compile(r"\s*[-+]?\d{1,18}(?:\.\d{1,18})?(?:\s*/\s*\d{1,18})?\s*")
_LONGEST = 2000
_LARGEST_PART = Fraction(10) ** 30
"""Of a coefficient; numbers in files have the same limit."""
_ROOTS = {2: geometry.Exact.surd(0, 1), 3: geometry.Exact.surd(0, 0, 1), 6: geometry.Exact.surd(0, 0, 0, 1)}
# What a symbol can be, by its unit: an example, in words, a typical value.
_QUANTITIES = {
    "m": ("L1", "a length", "0.5"),
    "kg": ("m1", "a mass", "2.5"),
    "kg*m^2": ("I1", "an inertia", "0.01"),
    "m/s^2": ("-g", "an acceleration", "9.81"),
}
_DEGREES = re.compile(r"\s*(?P<degrees>[-+]?\d+(?:\.\d+)?)\s*deg\s*")
_FRACTION_OF_PI = re.compile(
    r"(?P<sign>[-+]?)\s*(?:(?P<times>\d+(?:\.\d+)?)\s*\*?\s*)?pi\s*(?:/\s*(?P<by>\d+(?:\.\d+)?))?"
)
_TANGENT = re.compile(r"2\s*\*?\s*atan\((?P<tangent>.+)\)")
ZERO_ANGLE = geometry.build_exact_angle(0.0)
DH_KEYS = ("alpha", "a", "d", "theta")
_LARGEST_ANGLE = 12.0
_LARGEST_LENGTH = 10
_TWELFTHS = tuple((k, geometry.build_exact_angle(k * math.pi / 12)) for k in range(-11, 13))
_MOST_PLACES = 40
_COMMENT_COLUMN = 35
# Outside of this a number is a slip for the reader; a fraction in quotes is not.
_SMALLEST = Fraction(1, 10**30)
_LARGEST_WHOLE = 1e15


def parse_linear_form(text: str) -> geometry.Exact | None:
    """Return the linear form that `text` writes, or None if it writes none."""
    if len(text) > _LONGEST or not text.strip():
        return None
    # The sign of the first term may be left out.
    text = text if text.lstrip()[0] in "+-" else f"+{text}"
    total, product, position = geometry.ZERO, geometry.ZERO, 0
    while position < len(text):
        match = _STEP.match(text, position)
        if not match:
            return None
        position, operator, name = match.end(), match["operator"], match["factor"]
        if name.startswith("sqrt("):
            factor = _ROOTS[int(name[5:-1])]
        else:
            factor = geometry.Exact.of(name) if name[0].isdigit() else geometry.Exact.symbol(name)
        if operator in "+-":
            total, product = total + product, factor if operator == "+" else -factor
            continue
        if operator == "/":
            if not factor or not factor.is_number:
                return None
            # A factor is a rational number or a root; 1 / sqrt(n) is sqrt(n) / n.
            factor = factor * geometry.Exact.surd(1 / (factor * factor).coefficient("")[0])
        if not (product.is_number or factor.is_number):
            return None
        product = product * factor
    return total + product


def _parse_value(value: object, largest: Fraction = _LARGEST_PART) -> geometry.Exact | None:
    """Return a value of a file, a number or the text of a linear form with parts up to `largest`."""
    number = to_decimal(value)
    if number is not None:
        return geometry.Exact.of(str(number))
    form = parse_linear_form(value) if isinstance(value, str) else None
    sizes = [abs(part) for _, parts in (form.terms if form else ()) for part in parts if part]
    return form if all(1 / largest <= size <= largest for size in sizes) else None


def read_linear_form(
    section: Section, key: str, unit: str, *inner: int, allowed: Range = ANY, code: str = "robot.wrong-type"
) -> geometry.Exact | None:
    """Return the number or form at `key`, or at its element `inner`; None where it is absent or wrong.

    The first use of a symbol fixes its `unit`, "m", "kg", "kg*m^2" or "m/s^2". `allowed` is what the number
    may be, with the symbols' values put in; `code` that of the notice on what is neither number nor form.
    """
    value = section.get(key, *inner)
    if value is None:
        return None
    form = _parse_value(value)
    example, noun, typical = _QUANTITIES[unit]
    if form is None:
        text = f'expected a number in {unit} or a symbol such as "{example}", got '
        text += f"{section.show(key, *inner)}{explain_number(value, unit)}"
        section.refuse(code, key, text, *inner)
        return None
    errors = len(section.errors)
    for name in form.symbols:
        if name not in section.symbols:
            hint = suggest_names(name, section.symbols)
            text = f"the symbol {name} has no value in [symbols]; "
            text += hint or f"write {name} = {typical} (its value in {unit}) there"
            section.refuse("robot.unknown-symbol", key, text, *inner)
        elif (before := section.used.setdefault(name, unit)) != unit:
            text = f"{name} is used as {_QUANTITIES[before][1]} ({before}) before, and as {noun} ({unit}) "
            text += "here; give each quantity its own symbol"
            section.refuse("robot.symbol-unit", key, text, *inner)
    if len(section.errors) > errors:
        return None
    if (size := form.to_float(section.symbols)) not in allowed:
        shown = section.show(key, *inner) + ("" if form.is_number else f", which is {size:g}")
        section.refuse("robot.out-of-range", key, f"must be {allowed} {unit}, got {shown}", *inner)
        return None
    return form


def read_vector(section: Section, key: str, unit: str) -> geometry.ExactVector:
    """Return the three numbers or forms at `key`; zeros where it is absent or wrong."""
    if not section.has_list(key, 3, f"numbers in {unit}"):
        return (geometry.ZERO, geometry.ZERO, geometry.ZERO)
    x, y, z = (read_linear_form(section, key, unit, index) or geometry.ZERO for index in range(3))
    for index in range(3 if unit == "m" else 0):
        _warn_long(section, key, index)
    return (x, y, z)


def read_fraction(section: Section, key: str, instead_of_zero: str) -> Fraction | None:
    """Return the number at `key` exactly, a decimal or a text such as "1/3"; 0 is refused, with a remedy."""
    value = section.get(key)
    if value is None:
        return None
    number = to_decimal(value)
    found = None if number is None else Fraction(number)
    if isinstance(value, str) and _FRACTION.fullmatch(value):
        above, _, below = value.partition("/")
        divisor = Fraction(below.strip() or 1)
        found = Fraction(above.strip()) / divisor if divisor else None
    if found is None:
        text = f'expected a number or a fraction "1/3", got {section.show(key)}'
        section.refuse("robot.wrong-type", key, text)
    elif not found:
        section.refuse("robot.out-of-range", key, f"must not be 0; {instead_of_zero}")
    return found or None


def _parse_degrees(value: object) -> float | None:
    """Return a number, or what "90 deg" writes, in rad."""
    number = to_decimal(value)
    if number is not None:
        return float(number)
    match = _DEGREES.fullmatch(value) if isinstance(value, str) else None
    return math.radians(float(match["degrees"])) if match else None


def read_constant(section: Section, key: str, expected: str, *inner: int) -> float | None:
    """Return the number at `key`, or at its element `inner`; None where it is absent or not as `expected`."""
    value = section.get(key, *inner)
    if value is None or (found := _parse_degrees(value)) is not None:
        return None if value is None else found
    form = parse_linear_form(value) if isinstance(value, str) else None
    if form is not None and set(form.symbols) <= {"pi"}:
        return form.to_float({"pi": math.pi})
    text = f'expected {expected}, such as 0.5, "-pi/2" or "90 deg"; got {section.show(key, *inner)}'
    section.refuse("robot.wrong-type", key, text, *inner)
    return None


def read_angle(section: Section, key: str, *inner: int) -> geometry.Angle:
    """Return the angle at `key` or its element, zero without; near a multiple of pi/2 it is taken as that."""
    value = section.get(key, *inner)
    if value is None:
        return ZERO_ANGLE
    text = value.strip() if isinstance(value, str) else ""
    if match := _TANGENT.fullmatch(text):
        tangent = parse_linear_form(match["tangent"])
        if tangent is not None and tangent.is_number:
            return geometry.build_tangent_angle(tangent)
    radians = _parse_degrees(value)
    if match := _FRACTION_OF_PI.fullmatch(text):
        by = float(match["by"] or 1)
        size = float(match["times"] or 1) * math.pi / by if by else None
        radians = -size if size and match["sign"] == "-" else size
    elif text and radians is None and (form := parse_linear_form(text)) is not None:
        # A number as a text, "0", or a sum such as "pi/2 - 0.1".
        radians = form.to_float({"pi": math.pi}) if set(form.symbols) <= {"pi"} else None
    shown = section.show(key, *inner)
    if radians is None:
        allowed = 'a number in rad, "pi/2", "-3*pi/4" or "90 deg"'
        section.refuse("robot.bad-angle", key, f"expected an angle, {allowed}; got {shown}", *inner)
        return ZERO_ANGLE
    if abs(radians) > _LARGEST_ANGLE and not text:
        words = f'{shown} rad is about {radians / math.tau:.1f} turns; write degrees as "90 deg"'
        section.warn("robot.large-angle", key, words, *inner)
    angle = geometry.build_exact_angle(radians)
    if angle.snapped_by:
        quarters = round(angle.radians / (math.pi / 2))
        exact = {0: "0", 1: "pi/2", -1: "-pi/2", 2: "pi", -2: "-pi"}.get(quarters, f"{quarters}*pi/2")
        words = f'{shown} was moved by {angle.snapped_by:.2e} rad; write it as "{exact}"'
        section.warn("robot.angle-snapped", key, words, *inner)
    return angle


def read_length(section: Section, key: str, *inner: int) -> geometry.Exact:
    """Return the length at `key` in m, or at its element `inner`: a number or a form; zero by default."""
    length = read_linear_form(section, key, "m", *inner, code="robot.bad-length")
    _warn_long(section, key, *inner)
    return length or geometry.ZERO


def _warn_long(section: Section, key: str, *inner: int) -> None:
    number = to_decimal(section.get(key, *inner))
    if number is not None and abs(number) > _LARGEST_LENGTH:
        text = f"{section.show(key, *inner)} m is too long; write lengths in m"
        section.warn("robot.long-length", key, text, *inner)


def read_position(section: Section, key: str) -> tuple[geometry.Exact, geometry.Placement]:
    """Return the position (rad or m) at `key` of a joint and its frame there; zero where there is none."""
    if section.prismatic:
        length = read_length(section, key)
        return length, geometry.translate(geometry.ZERO, geometry.ZERO, length)
    angle = read_angle(section, key)
    return geometry.Exact.of(angle.radians), geometry.rotate_z(angle)


def read_frames(section: Section, convention: str) -> tuple[geometry.Placement, geometry.Placement]:
    """Return the joint's frame at q = 0 seen from the link before it, and the link's seen from the joint's.

    A modified row ends in the joint's frame, which is the link's; a standard row goes on to the far end of
    the link, Trans(x, a) Rot(x, alpha). What cannot be read is reported and taken as zero.
    """
    general = [key for key in ("origin", "frame") if key in section.values]
    if convention == "origin" or general:
        where = 'in convention = "origin"' if convention == "origin" else f"together with {general[0]}"
        for key in DH_KEYS:
            if key in section.values:
                text = f"not allowed {where}; place the joint by a row or by origin, not by both"
                section.refuse_key("robot.mixed-placement", key, text)
        return _read_origin(section, "origin"), _read_origin(section, "frame")
    alpha, a = read_angle(section, "alpha"), read_length(section, "a")
    d, theta = read_length(section, "d"), read_angle(section, "theta")
    if convention == "modified":
        return geometry.place_modified_dh(alpha, a, d, theta), geometry.IDENTITY
    near = geometry.place_modified_dh(ZERO_ANGLE, geometry.ZERO, d, theta)
    return near, replace(geometry.rotate_x(alpha), translation=(a, geometry.ZERO, geometry.ZERO))


def _read_origin(section: Section, key: str) -> geometry.Placement:
    """Return the frame at `key`; the identity where there is none or it is wrong."""
    table = section.read_table(key, ("xyz", "rpy", "quaternion"))
    if table is None:
        return geometry.IDENTITY
    x, y, z = geometry.IDENTITY.translation
    if table.has_list("xyz", 3, "lengths in m"):
        x, y, z = (read_length(table, "xyz", index) for index in range(3))
    if "rpy" in table.values and "quaternion" in table.values:
        text = "cannot be combined with rpy, which means the same; keep one of the two"
        table.refuse_key("robot.two-forms", "quaternion", text)
    rotation = geometry.IDENTITY.rotation
    if table.has_list("rpy", 3, "angles"):
        roll, pitch, yaw = (read_angle(table, "rpy", index) for index in range(3))
        rotation = geometry.rotate_rpy(roll, pitch, yaw).rotation
    if table.has_list("quaternion", 4, "numbers w, x, y, z"):
        # Only ratios count: the whole numbers of an exact turn may be long.
        forms = [_parse_value(table.get("quaternion", index), _LARGEST_PART**4) for index in range(4)]
        parts = [form for form in forms if form is not None and form.is_number]
        if len(parts) < len(forms):
            index = next(index for index, form in enumerate(forms) if form not in parts)
            text = f'expected a number or a text such as "1+sqrt(2)", got {table.show("quaternion", index)}'
            table.refuse("robot.wrong-type", "quaternion", text, index)
        elif any(parts):
            rotation = geometry.compute_rotation(parts)
        else:
            table.refuse("robot.out-of-range", "quaternion", "must not be zero; no turn is [1, 0, 0, 0]")
    return geometry.Placement(rotation=rotation, translation=(x, y, z))


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
        with localcontext(prec=2 * _MOST_PLACES):
            return f"{Decimal(value.numerator) / value.denominator:f}"
    return f'"{value}"'


def write_exact(value: geometry.Exact) -> str:
    """Return a number or form, such as 0.5, "L1" or "1/2*sqrt(3)"."""
    return write_fraction(value.coefficient("")[0]) if value.is_rational else f'"{value}"'


def write_list(values: tuple[geometry.Exact, ...]) -> str:
    """Return a list of numbers and forms."""
    return f"[{', '.join(map(write_exact, values))}]"


def write_angle(angle: geometry.Angle) -> str:
    """Return an angle that is read back with the same cosine and sine."""
    for k, twelfth in _TWELFTHS:
        if (angle.cosine, angle.sine) == (twelfth.cosine, twelfth.sine):
            part = Fraction(k, 12)
            times = {1: "", -1: "-"}.get(part.numerator, f"{part.numerator}*")
            by = "" if part.denominator == 1 else f"/{part.denominator}"
            return f'"{times}pi{by}"' if part else "0"
    radians = math.atan2(angle.sine.to_float(), angle.cosine.to_float())
    found = geometry.build_exact_angle(radians)
    if (found.cosine, found.sine) == (angle.cosine, angle.sine):
        return repr(radians)
    # tan(angle / 2); a half turn, where it is infinite, is a multiple of pi/12.
    return f'"2*atan({angle.sine * geometry.invert_exact(geometry.ONE + angle.cosine)})"'


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


def _write_row(*row: geometry.Angle | geometry.Exact) -> dict[str, str]:
    """Return those values of a row, alpha, a, d, theta, that are not zero."""
    texts = (write_angle(x) if isinstance(x, geometry.Angle) else write_exact(x) for x in row)
    return {key: text for key, text in zip(DH_KEYS, texts, strict=True) if text != "0"}


def write_modified_row(placement: geometry.Placement) -> dict[str, str] | None:
    """Return alpha, a, d, theta of Rx(alpha) Tx(a) Rz(theta) Tz(d), without zeros; None for other frames."""
    r, t = placement.rotation, placement.translation
    alpha, theta = geometry.Angle.of(r[2][2], -r[1][2]), geometry.Angle.of(r[0][0], -r[0][1])
    d = alpha.cosine * t[2] - alpha.sine * t[1]
    is_row = geometry.place_modified_dh(alpha, t[0], d, theta) == placement
    return _write_row(alpha, t[0], d, theta) if is_row else None


def write_standard_row(near: geometry.Placement, frame: geometry.Placement) -> dict[str, str] | None:
    """Return the row of `near` = Rz(theta) Tz(d) and `frame` = Tx(a) Rx(alpha), no zeros; None for others."""
    theta = geometry.Angle.of(near.rotation[0][0], near.rotation[1][0])
    alpha = geometry.Angle.of(frame.rotation[1][1], frame.rotation[2][1])
    d, a = near.translation[2], frame.translation[0]
    far = replace(geometry.rotate_x(alpha), translation=(a, geometry.ZERO, geometry.ZERO))
    is_row = (geometry.place_modified_dh(ZERO_ANGLE, geometry.ZERO, d, theta), far) == (near, frame)
    return _write_row(alpha, a, d, theta) if is_row else None


def write_origin(placement: geometry.Placement) -> str:
    """Return the table of a frame: xyz, and rpy or quaternion where it is turned."""
    parts = []
    if any(placement.translation):
        parts.append(f"xyz = {write_list(placement.translation)}")
    if placement.rotation != geometry.IDENTITY.rotation:
        if angles := geometry.compute_rpy(placement.rotation):
            parts.append(f"rpy = [{', '.join(map(write_angle, angles))}]")
        else:
            parts.append(f"quaternion = {write_list(geometry.compute_quaternion(placement.rotation))}")
    return f"{{ {', '.join(parts)} }}" if parts else "{}"
