"""A robot from the name or path of its file, in any format, with settings of a call put over the file's.

A path, or a name in ./robots or among the robots that come with symid; texts such as
("processing.filter_cutoff", "50") -> `Robot`, checked like the file itself. `complete_robot` adds what
neither a URDF nor a table of rows holds: friction, rotors, gears, torque constants.

Supported: robot files (TOML), URDF, xacro, MJCF, tables of Denavit-Hartenberg rows (CSV); settings under
`log`, `processing` and `controller`, and one friction model for all joints.
Not supported: settings of geometry, drives and link values, which belong into the
file; values that contradict the source.
"""

import codecs
import contextlib
import difflib
import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal, DecimalException
from pathlib import Path
from typing import Any, TypeAlias

from symid.environment import locate_resource_folder, read_file
from symid.errors import Notice, RobotError, UsageError
from symid.joint_models import NO_FRICTION, FrictionValues, get_law, list_value_names, name_values
from symid.notation import get_unit_factor
from symid.robot.description import UNKNOWN, Drive, Joint, Robot, free_mounting
from symid.robot.geometry import Exact
from symid.robot.toml_settings import SETTING_TABLES, describe_settings, list_controller, read_settings
from symid.robot.toml_values import LARGEST_FILE, KeyPath, Place, Places, Section, suggest_names, to_decimal

_SUFFIX = ".toml"
# Behind the XML declaration and comments; what was passed once is not tried again in another way.
_FIRST_TAG = re.compile(rb"(?:\s++|<\?.*?\?>|<!--.*?-->)*+<([\w:]+)", re.DOTALL)
_XML_SUFFIXES = (".urdf", ".xml", ".mjcf")
Vector: TypeAlias = str | Sequence[float]
"""Three numbers, or a text such as "0,0,-9.81"."""


def _list_robot_folders() -> tuple[Path, ...]:
    return (Path("robots"), locate_resource_folder("robots"))


def is_xml(path: Path) -> bool:
    """Return whether a file is a URDF, MJCF or xacro by its suffix, or begins with <, as only XML does."""
    if path.suffix.lower() in (*_XML_SUFFIXES, ".xacro"):
        return True
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except (OSError, ValueError):
        return False
    return head.removeprefix(codecs.BOM_UTF8).lstrip().startswith(b"<")


def is_mjcf(path: Path) -> bool:
    """Return whether a file is an MJCF model by its outermost tag; False where it cannot be read."""
    try:
        text = read_file(path, LARGEST_FILE)
    except (OSError, ValueError):
        return False
    # URDFs may have a <mujoco> inside.
    first = _FIRST_TAG.match(text.removeprefix(codecs.BOM_UTF8))
    return first is not None and first[1] in (b"mujoco", b"mujocoinclude")


def list_robots() -> tuple[str, ...]:
    """Return the names of all robots in ./robots and of those that come with symid, sorted."""
    stems = {path.stem for folder in _list_robot_folders() for path in folder.glob(f"*{_SUFFIX}")}
    return tuple(sorted(stems))


def locate_robot_file(name_or_path: str) -> Path:
    """Return the file at a path, or of a name in ./robots or installed; a UsageError has the nearest."""
    path = Path(name_or_path)
    if _is_file(path):
        return path
    if path.name == name_or_path:
        stem = name_or_path.removesuffix(_SUFFIX)
        for folder in _list_robot_folders():
            candidate = folder / f"{stem}{_SUFFIX}"
            if _is_file(candidate):
                return candidate
    ends, remedy = (_SUFFIX, *_XML_SUFFIXES), "give the path of a .toml, .urdf or .xml file"
    known = ", ".join(list_robots())
    siblings = [str(other) for end in ends for other in sorted(path.parent.glob(f"*{end}"))]
    near = difflib.get_close_matches(str(path), siblings, n=3, cutoff=0.6)
    if os.path.isdir(path):  # noqa: PTH112  the same as for files
        text = f"'{path}' is a folder; give a robot file (.toml, .urdf, .xml) or a robot's name: {known}"
    elif path.parent != Path():
        hint = f"did you mean {' or '.join(near)}?" if near else remedy
        text = f"there is no robot file '{path}'; {hint}"
    else:
        stem = path.name.lower().removesuffix(_SUFFIX)
        near += difflib.get_close_matches(stem, list_robots(), n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        text = f"there is no robot '{path}'; {hint}known are {known}, or {remedy}"
    raise UsageError(Notice(code="usage.unknown-robot", text=text))


def name_for_commands(robot: Robot) -> str:
    """Return what a command line calls a robot: its name where that finds its file, else the file."""
    if not robot.path:
        return robot.name
    path = Path(robot.path)
    stem = path.name.removesuffix(_SUFFIX)
    candidates = (folder / f"{stem}{_SUFFIX}" for folder in _list_robot_folders())
    first = next(filter(_is_file, candidates), None)
    return stem if first is not None and first.resolve() == path.resolve() else robot.path


def _is_file(path: Path) -> bool:
    # Path.is_file fails on names that are longer than a file system takes.
    return os.path.isfile(path)  # noqa: PTH113


def override_robot(robot: Robot, settings: Sequence[tuple[str, str]], friction: str | None = None) -> Robot:
    """Return `robot` with other settings.

    Args:
        robot: as read from its file.
        settings: pairs of a dotted key below `log`, `processing` or `controller`, or "friction", and a
            value as in TOML; a text needs no quotes, a list no brackets. "settings" and a name put a set of
            the robot file below all other keys.
        friction: the name of a friction model for all joints that follow no other. Values that the file
            states are dropped where the model differs.

    Raises:
        UsageError: a key cannot be overridden, or there is no such set or friction model.
        RobotError: the values do not fit; all mistakes at once.
    """
    known = {entry.name: entry for entry in robot.settings}
    for name in (value for key, value in settings if key == "settings"):
        if name not in known:
            listed = f"it has {', '.join(known)}" if known else "it has none; they are tables [settings.NAME]"
            hint = suggest_names(name, known, before="; ")
            text = f"the robot file has no settings named '{name}': {listed}{hint}"
            raise UsageError(Notice(code="usage.unknown-settings", text=text, file=robot.path))
        stated = {table: getattr(known[name], table) for table in SETTING_TABLES}
        changed: dict[str, Any] = {table: entry for table, entry in stated.items() if entry is not None}
        robot = replace(robot, **changed)
    pairs = [(key, value) for key, value in settings if key not in ("friction", "settings")]
    values: dict[str, Any] = describe_settings(robot)
    if robot.controller is not None:
        values["controller"] = list_controller(robot.controller)
    places: dict[KeyPath, Place] = {}
    for key, value in pairs:
        path = tuple(key.split("."))
        if path[0] not in SETTING_TABLES or not 1 < len(path) <= 3 or not all(path):
            hint = suggest_names(path[0], (*SETTING_TABLES, "friction"))
            text = f"'{key}' cannot be set here; {hint + ' ' if hint else ''}allowed are friction, "
            text += "processing.KEY, controller.KEY and log.QUANTITY.KEY, such as processing.filter_cutoff=50"
            text += "; all else belongs into the robot file"
            raise UsageError(Notice(code="usage.bad-setting", text=text, file=f"--set {key}"))
        parsed = _parse_setting(value)
        if path[0] == "log" and path[2:] == ("unit",):
            # A factor goes when the unit that it belongs to gives way to one of another dimension.
            quantity = values["log"].get(path[1], {})
            with contextlib.suppress(KeyError, TypeError):
                if get_unit_factor(quantity["unit"])[0] != get_unit_factor(str(parsed))[0]:
                    quantity.pop("factor", None)
        # The setting's place is that of its key, and of the tables around it that have none yet.
        place = places[path] = Place(f"--set {key}={value}", 0, 0, value)
        table = values
        for length, name in enumerate(path[:-1], start=1):
            places.setdefault(path[:length], place)
            if not isinstance(table.get(name), dict):
                table[name] = {}
            table = table[name]
        table[path[-1]] = parsed
    if pairs:
        root = Section(values=values, places=Places(keys=places, values=places, whole=Place("--set", 0, 0)))
        log, processing, controller = read_settings(root, robot.axes)
        root.finish()
        robot = replace(robot, log=log, processing=processing, controller=controller)
    laws = [value for key, value in settings if key == "friction"]
    for name in laws if friction is None else (friction, *laws):
        if name == "auto" or "=" in name:
            what = "'auto' is" if name == "auto" else "laws of single joints are"
            text = f"{what} a friction of `symid identify` and `robot.identify` alone, which find laws from "
            text += "logs; otherwise give one law for all joints, or write the laws into the robot file"
            raise UsageError(Notice(code="usage.friction-auto", text=text))
        law = None if name == NO_FRICTION else get_law(name)
        wanted = NO_FRICTION if law is None else law.name
        other = [joint.name for joint in robot.axes if joint.friction.law != wanted]
        if law is not None and (law.shape or law.memory) and other:
            shape = ", ".join(entry.name for entry in (*law.shape, *law.memory))
            text = f"the friction model '{name}' needs {shape} of joint {other[0]!r}, which no option gives; "
            text += "write it into the robot file"
            raise UsageError(Notice(code="usage.friction-shape", text=text))
        joints = tuple(
            replace(joint, friction=FrictionValues(law=wanted)) if joint.name in other else joint
            for joint in robot.joints
        )
        robot = replace(robot, joints=joints)
    return robot


def _parse_setting(text: str) -> object:
    """Return the value that `text` writes in TOML, or else the text itself, or a list of texts."""
    try:
        values = tomllib.loads(f"value = {text}", parse_float=Decimal)
    # A number with too many digits is a ValueError.
    except (tomllib.TOMLDecodeError, ValueError, RecursionError, DecimalException):
        parts = [part.strip() for part in text.split(",")]
        return [_parse_setting(part) for part in parts] if len(parts) > 1 else text
    return values["value"] if len(values) == 1 else text


def complete_robot(
    robot: Robot,
    friction: str | None,
    gears: tuple[float, ...],
    constants: tuple[float, ...],
    *,
    rotors: bool,
) -> Robot:
    """Return `robot` with what is added; a UsageError where numbers do not fit the joints, or the source.

    Args:
        robot: as its source states it.
        friction: the name of a model for all joints, None to leave them.
        gears: motor turns per joint turn, one for each joint or one for all; none to leave them.
        constants: N m/A on the motor's side, likewise.
        rotors: whether every drive gets a rotor of unknown inertia, where none is stated.
    """
    count, names = robot.freedom, ", ".join(joint.name for joint in robot.axes)
    mistakes: list[str] = []
    columns: list[list[float | None]] = []
    for option, values in (("--gear", gears), ("--torque-constant", constants)):
        if len(values) not in (0, 1, count):
            text = f"{option}: {len(values)} numbers for {count} joints ({names})"
            mistakes.append(f"{text}; give one for each, with commas between, or one for all")
        # One number stands for all joints; those without one keep what they have.
        columns.append([*(values * count if len(values) == 1 else values), *((None,) * count)])
    drives: dict[str, Drive] = {}
    for joint, gear, constant in zip(robot.axes, *columns, strict=False):
        drive = joint.drive
        if gear is not None and drive.gear not in (1.0, gear):
            text = f"--gear: joint {joint.name!r} has the gear {drive.gear:g} in its source, not {gear:g}"
            mistakes.append(f"{text}; leave the option out, or correct the source")
        elif gear not in (None, drive.gear) and drive.rotor_inertia is not None:
            text = f"--gear: joint {joint.name!r} has a rotor inertia in its source, but no gear"
            mistakes.append(f"{text}; state the gear in the source")
        drives[joint.name] = replace(
            drive,
            gear=drive.gear if gear is None else gear,
            direct=drive.direct if gear is None else gear == 1.0,
            torque_constant=drive.torque_constant if constant is None else constant,
            has_rotor=drive.has_rotor or rotors,
        )
    if mistakes:
        raise UsageError(*(Notice(code="usage.completion", text=text) for text in mistakes))
    joints = tuple(replace(joint, drive=drives.get(joint.name, joint.drive)) for joint in robot.joints)
    completed = replace(robot, joints=joints)
    if not friction:
        return completed
    # Values of the source that the law has are kept; those that only the new law has are zero.
    after = override_robot(completed, (), friction)
    kept, lost, moved = list[str](), list[str](), list[Joint]()
    for old, new in zip(completed.joints, after.joints, strict=True):
        named, names_of_law = name_values(old.friction), list_value_names(new.friction)
        stated, own = {name for name in named if named[name]}, new.friction
        if old.friction.law != own.law and stated:
            (kept if stated <= set(names_of_law) else lost).append(new.name)
            if stated & set(names_of_law):
                own = replace(own, values=tuple(named.get(name, 0.0) for name in names_of_law))
        moved.append(replace(new, friction=own))
    notices = []
    if kept:
        text = f"the source's friction of {', '.join(kept)} was taken over into the law {friction}"
        notices.append(Notice(code="new.friction-kept", text=text, file=robot.path))
    if lost:
        text = f"the law {friction} lacks some friction of the source, of {', '.join(lost)}; choose another"
        notices.append(Notice(code="new.friction-lost", text=text, file=robot.path))
    return replace(after, joints=tuple(moved), notices=(*after.notices, *notices))


def load_robot(
    name: str,
    settings: Sequence[tuple[str, str]] = (),
    friction: str | None = None,
    *,
    base: str | None = None,
    tip: str | None = None,
    snap: float | None = None,
    xacro: Mapping[str, str] | Sequence[str] = (),
    include_outside: bool = False,
    convention: str | None = None,
    gravity: Vector | None = None,
    zeros: str | Sequence[str] | None = None,
) -> Robot:
    """Return the robot of a name or path, with other settings in place of the file's.

    Args:
        name: a name, or the path of a TOML, URDF, xacro, MJCF or CSV file.
        settings: keys and values.
        friction: the friction model of all joints.
        base: the link of a URDF, or body of an MJCF model, to start from.
        tip: the link or body to end at.
        snap: angle in rad within which rotations of a URDF or MJCF become multiples of pi/2.
        xacro: arguments of a xacro file, by name, or texts such as "prefix:=left_".
        include_outside: read files that an MJCF model includes from other folders than its own.
        convention: of a table of rows, "modified" or "standard"; it is never guessed.
        gravity: in the base frame, m/s^2, or "unknown", in place of the file's.
        zeros: joints whose zeros a fit is to find, by name, or "unknown" for all.

    Raises:
        UsageError: there is no such robot, a setting cannot be made here, or an option does not fit the file.
        RobotError: the file is wrong.
    """
    path = locate_robot_file(name)
    table = path.suffix.lower() == ".csv"
    if table == (convention is None):
        text = "a convention belongs to a table of Denavit-Hartenberg rows (.csv); leave it out"
        if table:
            text = "a table of Denavit-Hartenberg rows: state its convention, 'modified' or 'standard'"
        raise UsageError(Notice(code="usage.convention", text=text, file=str(path)))
    if not table and is_xml(path):
        from symid.robot.mjcf_reader import read_xml_robot
        from symid.robot.urdf_reader import DEFAULT_SNAP

        nearest = DEFAULT_SNAP if snap is None else snap
        given = _list_arguments(xacro)
        ends = {"base": base, "tip": tip}
        robot = read_xml_robot(path, **ends, snap=nearest, xacro=given, outside=include_outside)
        return override_settings(state_mounting(robot, gravity, zeros), settings, friction)
    for option, value in (("base", base), ("tip", tip), ("snap", snap)):
        if value is not None:
            what = "rounded" if option == "snap" else "cut at its links"
            remedy = "write the angles exactly" if option == "snap" else "leave the joints out of the file"
            text = f"--{option} {value}: only a URDF or MJCF is {what}; leave the option out, or {remedy}"
            raise UsageError(Notice(code="usage.no-urdf", text=text, file=str(path)))
    if xacro:
        text = "only a xacro file has arguments; leave --xacro out"
        raise UsageError(Notice(code="usage.xacro", text=text, file=str(path)))
    if convention is not None:
        from symid.robot.toml_reader import read_dh_table

        robot = read_dh_table(path, convention)
    else:
        from symid.robot.toml_reader import read_robot

        robot = read_robot(path)
    return override_settings(state_mounting(robot, gravity, zeros), settings, friction)


def _list_arguments(xacro: Mapping[str, str] | Sequence[str]) -> dict[str, str]:
    """Return the arguments of a xacro file by name; a UsageError for a text that is not NAME:=VALUE."""
    if isinstance(xacro, Mapping):
        return {name: str(value) for name, value in xacro.items()}
    parts = [text.partition(":=") for text in xacro]
    if wrong := [text for text, part in zip(xacro, parts, strict=True) if not (part[0].strip() and part[1])]:
        text = f"--xacro {wrong[0]}: expected NAME:=VALUE, such as prefix:=left_"
        raise UsageError(Notice(code="usage.xacro", text=text))
    return {name.strip(): value for name, _, value in parts}


def override_settings(
    robot: Robot, settings: Sequence[tuple[str, str]], friction: str | None = None
) -> Robot:
    """Return `robot` with other settings; all mistakes, of the call and no file, are a UsageError."""
    if not settings and not friction:
        return robot
    try:
        return override_robot(robot, settings, friction)
    except RobotError as error:
        raise UsageError(*error.notices) from error


def read_gravity(given: Vector) -> tuple[str, str, str]:
    """Return the numbers of a gravity vector as decimals; a UsageError where it is none."""
    plain = given.tolist() if hasattr(given, "tolist") else given
    texts = [part.strip() for part in plain.split(",")] if isinstance(plain, str) else list(map(str, plain))
    try:
        numbers = [to_decimal(Decimal(text)) for text in texts]
    except DecimalException:
        numbers = []
    if len(numbers) != 3 or None in numbers:
        text = f"gravity (--gravity) {','.join(texts)}: expected three numbers in m/s^2 of a sensible size, "
        raise UsageError(Notice(code="usage.gravity", text=f"{text}such as 0,0,-9.81, or {UNKNOWN}"))
    x, y, z = texts
    return x, y, z


def state_mounting(
    robot: Robot, gravity: Vector | None = None, zeros: str | Sequence[str] | None = None
) -> Robot:
    """Return the robot under another gravity, and with joints whose zeros are to be found; see `load_robot`.

    Raises:
        UsageError: gravity is no vector, or a joint is none of the robot.
    """
    if isinstance(gravity, str) and gravity.strip() == UNKNOWN:
        robot = free_mounting(robot, gravity=True)
    elif gravity is not None:
        x, y, z = map(Exact.of, read_gravity(gravity))
        kept = tuple(notice for notice in robot.notices if notice.code != "robot.assumed-gravity")
        robot = replace(robot, gravity=(x, y, z), free_gravity=False, notices=kept)
    if zeros is None:
        return robot
    names = [part.strip() for part in zeros.split(",")] if isinstance(zeros, str) else list(zeros)
    known = [joint.name for joint in robot.axes]
    mistakes = [name for name in names if name not in known] if names != [UNKNOWN] else []
    if mistakes:
        listed = f"joints are {', '.join(known)}, or {UNKNOWN} for all"
        text = f"zeros (--zeros): no joint {mistakes[0]!r}; {listed}"
        text += f"{suggest_names(mistakes[0], known, before='; ')}"
        raise UsageError(Notice(code="usage.zeros", text=text, file=robot.path))
    return free_mounting(robot, zeros=known if names == [UNKNOWN] else names)
