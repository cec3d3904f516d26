"""A robot from the name or path of its file, whatever it is written in, with settings put over the file's.

Input: a name or a path, settings. Output: `Robot`.

Supported: robot files (TOML), URDF, tables of Denavit-Hartenberg rows (CSV).
Not supported: MJCF and xacro, which are written or refused, not read.
"""

from collections.abc import Sequence
from pathlib import Path

from symid.errors import Notice, RobotError, UsageError
from symid.formats.locate import find_robot_file, is_urdf
from symid.formats.overrides import override_robot
from symid.robot.description import Robot

__all__ = ["LEVEL", "load_robot", "override_settings"]

LEVEL = ("0", "0", "-9.81")
"""Gravity in m/s^2 in the base frame of a table of rows, where nothing else is stated."""
_TABLE = ".csv"


def load_robot(
    name: str,
    settings: Sequence[tuple[str, str]] = (),
    friction: str | None = None,
    *,
    base: str | None = None,
    tip: str | None = None,
    snap: float | None = None,
    convention: str | None = None,
    gravity: tuple[str, str, str] | None = None,
) -> Robot:
    """Return the robot of a name or path, with other settings in place of the file's.

    Args:
        name: a name, or the path of a TOML, URDF or CSV file.
        settings: keys and values.
        friction: the friction model of all joints.
        base: the link of a URDF to start from.
        tip: the link of a URDF to end at.
        snap: angle in rad within which rotations of a URDF become multiples of pi/2.
        convention: of a table of rows, "modified" or "standard"; it is never guessed.
        gravity: of a table of rows, in the base frame, m/s^2.

    Raises:
        UsageError: there is no such robot, a setting cannot be made here, or an option does not fit the file.
        RobotError: the file is wrong.
    """
    path = find_robot_file(name)
    table = path.suffix.lower() == _TABLE
    _refuse_of_table(path, table=table, convention=convention, gravity=gravity)
    if not table and is_urdf(path):
        from symid.formats.urdf import SNAP, read_urdf

        robot = read_urdf(path, base=base, tip=tip, snap=SNAP if snap is None else snap)
    else:
        _refuse_cut(path, base=base, tip=tip, snap=snap)
        robot = _read_plain(path, convention, gravity)
    return override_settings(robot, settings, friction)


def _read_plain(path: Path, convention: str | None, gravity: tuple[str, str, str] | None) -> Robot:
    if convention is not None:
        from symid.formats.dh_table import read_dh_table

        return read_dh_table(path, convention, gravity or LEVEL)
    from symid.formats.toml import read_robot

    return read_robot(path)


def _refuse_of_table(path: Path, *, table: bool, convention: str | None, gravity: object) -> None:
    """Refuse a table of rows without its convention, and what only such a table has for another file."""
    text = ""
    if table and convention is None:
        text = "a table of Denavit-Hartenberg rows: say which they are, convention 'modified' or 'standard'"
    elif not table and (convention is not None or gravity is not None):
        text = "convention and gravity belong to a table of Denavit-Hartenberg rows (.csv); leave them out"
    if text:
        raise UsageError(Notice(code="usage.convention", text=text, file=str(path)))


def _refuse_cut(path: Path, **options: object) -> None:
    for option, value in options.items():
        if value is not None:
            what = "rounded" if option == "snap" else "cut at its links"
            remedy = "write the angles exactly" if option == "snap" else "leave the joints out of the file"
            text = f"--{option} {value}: only a URDF is {what}; leave the option out, or {remedy}"
            raise UsageError(Notice(code="usage.no-urdf", text=text, file=str(path)))


def override_settings(
    robot: Robot, settings: Sequence[tuple[str, str]], friction: str | None = None
) -> Robot:
    """Return `robot` with other settings; what is wrong with one is wrong with the call, not the file.

    Raises:
        UsageError: a setting cannot be made here, or its value does not fit.
    """
    if not settings and not friction:
        return robot
    try:
        return override_robot(robot, settings, friction)
    except RobotError as error:
        raise UsageError(*error.notices) from error
