"""Settings of a call put in place of those of the robot file.

Input: a robot, and texts such as ("processing.filter_cutoff", "50"). Output: the robot with them,
checked like the file itself.

Supported: everything under `log`, `processing` and `controller`, and one friction model for all joints.
Not supported: geometry, drives and link values; they belong into the file.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from typing import Any

from symid.errors import Notice, RobotError, UsageError
from symid.formats.controller import list_controller, read_controller
from symid.formats.joint_friction import FRICTION_PARAMETERS, FRICTION_SHAPES
from symid.formats.positions import KeyPath, Place, Places
from symid.formats.section import Report, Section, find_nearest
from symid.formats.settings import list_log, list_processing, read_log, read_processing
from symid.robot.description import FrictionValues, Robot
from symid.units import find_unit_factor

__all__ = ["override_robot"]

_LONGEST_KEY = 3
_TABLES = ("log", "processing", "controller")


def override_robot(robot: Robot, settings: Sequence[tuple[str, str]], friction: str | None = None) -> Robot:
    """Return `robot` with other settings.

    Args:
        robot: as read from its file.
        settings: pairs of a dotted key below `log`, `processing` or `controller`, or "friction", and a
            value as in TOML; a text needs no quotes, a list no brackets.
        friction: the name of a friction model for all joints that follow no other. What the file knows
            of the values is dropped wherever the model differs.

    Raises:
        UsageError: a key cannot be overridden, or there is no such friction model.
        RobotError: the values do not fit; all of them are told at once.
    """
    kinds = [friction] if friction is not None else []
    kinds += [value for key, value in settings if key == "friction"]
    pairs = [(key, value) for key, value in settings if key != "friction"]
    values: dict[str, Any] = {"log": list_log(robot.log), "processing": list_processing(robot.processing)}
    if robot.controller is not None:
        values["controller"] = list_controller(robot.controller)
    places: dict[KeyPath, Place] = {}
    for key, value in pairs:
        path = _split_key(key)
        _drop_stale_factor(values, path, value)
        _put(values, path, _parse(value))
        _mark(places, path, Place(f"--set {key}={value}", 0, 0, value))
    if pairs:
        robot = _read_again(robot, values, places)
    for kind in kinds:
        robot = _replace_friction(robot, kind)
    return robot


def _read_again(robot: Robot, values: Mapping[str, Any], places: Mapping[KeyPath, Place]) -> Robot:
    report = Report(Places(keys=places, values=places, whole=Place("--set", 0, 0)))
    root = Section(values=values, path=(), report=report)
    log = read_log(root, robot.axes) if values["log"] else robot.log
    processing, controller = read_processing(root), read_controller(root, robot.axes)
    changed = replace(robot, log=log, processing=processing, controller=controller)
    if report.errors:
        raise RobotError(*report.notices())
    return changed


def _split_key(key: str) -> tuple[str, ...]:
    path = tuple(key.split("."))
    if path[0] not in _TABLES or not 1 < len(path) <= _LONGEST_KEY or not all(path):
        hint = find_nearest(path[0], (*_TABLES, "friction"))
        text = (
            f"'{key}' cannot be set here; {hint + ' ' if hint else ''}allowed are friction, processing.KEY, "
            "controller.KEY and log.QUANTITY.KEY, such as processing.filter_cutoff=50; all else belongs into "
            "the robot file"
        )
        raise UsageError(Notice(code="usage.bad-setting", text=text, file=f"--set {key}"))
    return path


def _parse(text: str) -> object:
    """Return the value that `text` writes in TOML, or else the text itself, or a list of texts."""
    try:
        values = tomllib.loads(f"value = {text}", parse_float=Decimal)
    except tomllib.TOMLDecodeError:
        parts = [part.strip() for part in text.split(",")]
        return [_parse(part) for part in parts] if len(parts) > 1 else text
    return values["value"] if len(values) == 1 else text


def _put(values: dict[str, Any], path: tuple[str, ...], value: object) -> None:
    table = values
    for name in path[:-1]:
        inner = table.setdefault(name, {})
        if not isinstance(inner, dict):
            inner = table[name] = {}
        table = inner
    table[path[-1]] = value


def _mark(places: dict[KeyPath, Place], path: tuple[str, ...], place: Place) -> None:
    """Give the setting's place to its key, and to the tables around it that have none yet."""
    for length in range(1, len(path)):
        places.setdefault(path[:length], place)
    places[path] = place


def _drop_stale_factor(values: dict[str, Any], path: tuple[str, ...], value: str) -> None:
    """Forget a factor when the unit that it belongs to gives way to one of another dimension."""
    if path[0] != "log" or path[2:] != ("unit",):
        return
    quantity = values["log"].get(path[1], {})
    try:
        before = find_unit_factor(quantity["unit"])[0]
        after = find_unit_factor(str(_parse(value)))[0]
    except (KeyError, TypeError):
        return
    if before != after:
        quantity.pop("factor", None)


def _replace_friction(robot: Robot, name: str) -> Robot:
    kinds = {kind.value: kind for kind in FRICTION_PARAMETERS}
    if name not in kinds:
        hint = find_nearest(name, kinds) or f"allowed are {', '.join(kinds)}"
        text = f"there is no friction model '{name}'; {hint}"
        raise UsageError(Notice(code="usage.unknown-friction", text=text))
    kind = kinds[name]
    lacking = [joint.name for joint in robot.axes if joint.friction.kind is not kind]
    if kind in FRICTION_SHAPES and lacking:
        shape = ", ".join(key.name for key in FRICTION_SHAPES[kind])
        text = (
            f"the friction model '{name}' needs {shape} of joint {lacking[0]!r}, which no option gives; "
            "write it into the robot file"
        )
        raise UsageError(Notice(code="usage.friction-shape", text=text))
    joints = tuple(
        joint
        if joint.friction.kind is kind or joint.mimic is not None
        else replace(joint, friction=FrictionValues(kind=kind))
        for joint in robot.joints
    )
    return replace(robot, joints=joints)
