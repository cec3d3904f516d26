"""Frames that no Denavit-Hartenberg row gives: the `origin` and `frame` tables of a robot file.

Input: a table `{ xyz = [x, y, z], rpy = [roll, pitch, yaw] }`, angles about fixed axes as in URDF, or with
`quaternion = [w, x, y, z]` of any length but zero. Output: an exact `Placement`.

Supported: lengths and angles as everywhere in robot files; forms such as "1+sqrt(2)" in quaternions.
"""

from symid.formats.dh import read_angle, read_length
from symid.formats.forms import Symbols, parse_form
from symid.formats.section import Section, find_element, read_table, to_decimal
from symid.robot.geometry import IDENTITY, ZERO, Exact, Placement
from symid.robot.rotations import Matrix, find_rotation, rotate_rpy

__all__ = ["read_origin"]


def read_origin(section: Section, key: str, symbols: Symbols) -> Placement:
    """Return the frame at `key`; the identity where there is none or it is wrong."""
    table = read_table(section, key, ("xyz", "rpy", "quaternion"))
    if table is None:
        return IDENTITY
    x, y, z = (ZERO, ZERO, ZERO)
    if _has_list(table, "xyz", "3 lengths in m"):
        x, y, z = (read_length(table, "xyz", symbols, index) for index in range(3))
    if "rpy" in table.values and "quaternion" in table.values:
        text = "stands next to rpy, which says the same; keep one of the two"
        table.refuse_key("robot.two-forms", "quaternion", text)
    rotation = IDENTITY.rotation
    if _has_list(table, "rpy", "3 angles"):
        roll, pitch, yaw = (read_angle(table, "rpy", index) for index in range(3))
        rotation = rotate_rpy(roll, pitch, yaw).rotation
    if _has_list(table, "quaternion", "4 numbers w, x, y, z"):
        rotation = _read_quaternion(table)
    return Placement(rotation=rotation, translation=(x, y, z))


def _has_list(table: Section, key: str, expected: str) -> bool:
    """Return whether there is a list of the right length at `key`; another value is reported."""
    value = table.values.get(key)
    if value is None:
        return False
    good = isinstance(value, list) and len(value) == int(expected[0])
    if not good:
        got = f"a list of {len(value)}" if isinstance(value, list) else table.show(key)
        table.refuse("robot.wrong-type", key, f"expected a list of {expected}, got {got}")
    return good


def _read_quaternion(table: Section) -> Matrix:
    parts = []
    for index in range(4):
        value = find_element(table, "quaternion", index)
        number = to_decimal(value)
        form = Exact.of(str(number)) if number is not None else None
        if isinstance(value, str):
            form = parse_form(value)
        if form is None or not form.is_number:
            got = table.show("quaternion", index)
            text = f'expected a number or a text such as "1+sqrt(2)", got {got}'
            table.refuse("robot.wrong-type", "quaternion", text, index)
            return IDENTITY.rotation
        parts.append(form)
    if not any(parts):
        table.refuse("robot.out-of-range", "quaternion", "must not be zero; no turn is [1, 0, 0, 0]")
        return IDENTITY.rotation
    return find_rotation(parts)
