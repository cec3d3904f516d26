"""The transmission matrix of a log: motors that move more than one joint.

Input: `transmission = [[...], ...]` of the `[log]` table. Output: its rows, checked: square, as large as the
robot, invertible by a margin that the digits of a log can pass.

    angles of the motors = T (angles of the joints),   torques of the joints = T' (torques of the motors)

Supported: any invertible matrix; numbers and expressions.
Not supported: transmissions that depend on the position.
"""

from collections.abc import Sequence

from symid.formats.constants import read_constant
from symid.formats.section import Section
from symid.robot.description import Joint
from symid.robot.transmission import Matrix, find_condition

__all__ = ["read_transmission"]

_LARGEST_CONDITION = 1e6


def read_transmission(table: Section, joints: Sequence[Joint]) -> Matrix | None:
    """Return the rows of the matrix at `transmission` of the table; None where it is absent or wrong."""
    value = table.values.get("transmission")
    if value is None:
        return None
    size = len(joints)
    good = isinstance(value, list) and len(value) == size
    if not good or not all(isinstance(row, list) and len(row) == size for row in value):
        text = f"expected {size} rows of {size} numbers, a row for each motor and a column for each joint"
        table.refuse("robot.transmission-shape", "transmission", f"{text}; got {_describe_shape(value)}")
        return None
    found = [
        [read_constant(table, "transmission", "a number", row, column) for column in range(size)]
        for row in range(size)
    ]
    rows = tuple(tuple(entry for entry in row if entry is not None) for row in found)
    if any(len(row) < size for row in rows):
        return None
    if not _check_rank(table, rows):
        return None
    _compare_gears(table, rows, joints)
    return rows


def _describe_shape(value: object) -> str:
    if not isinstance(value, list):
        return "no list of lists"
    lengths = [str(len(row)) if isinstance(row, list) else "no list" for row in value]
    return f"{len(value)} rows ({', '.join(lengths)})"


def _check_rank(table: Section, rows: Matrix) -> bool:
    condition = find_condition(rows)
    if condition is None:
        text = "the matrix has no inverse: two motors turn alike, or a joint is moved by none; correct it"
    elif condition > _LARGEST_CONDITION:
        text = (
            f"the matrix is nearly singular (condition {condition:.2g} after scaling its rows and columns): "
            "two motors turn almost alike, and the joints cannot be told apart; correct it"
        )
    else:
        return True
    table.refuse("robot.transmission-singular", "transmission", text)
    return False


def _compare_gears(table: Section, rows: Matrix, joints: Sequence[Joint]) -> None:
    """Warn where a drive states another gear ratio than the matrix has for its motor."""
    for index, joint in enumerate(joints):
        gear, entry = joint.drive.gear, rows[index][index]
        if gear not in (1.0, entry):
            text = (
                f"motor {index + 1} turns {entry:g} times per turn of joint {joint.name!r}, its drive says "
                f"gear = {gear:g}; logs follow the matrix; correct one of them"
            )
            table.warn("robot.transmission-gear", "transmission", text, index, index)
