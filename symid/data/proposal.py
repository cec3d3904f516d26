"""A `[log]` table proposed from the columns that a log has.

Input: `RawLog`, the robot, what the user says of columns and units. Output: `Proposal`: the map, and what was
taken for granted.

    preset of a known program, else: headings -> columns of each joint -> units -> LogMap

Supported: what `headings` reads, names and units of the user in place of it, the presets.
Not supported: columns of motors, of second encoders and of controllers, unless the user names them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

from symid.data.findings import Findings
from symid.data.headings import read_headings
from symid.data.presets import apply_preset
from symid.data.proposed_columns import NEEDED, check_columns, find_columns
from symid.data.proposed_units import ask_constants, build_quantity
from symid.data.scales import join_names
from symid.data.table import RawLog
from symid.errors import LogError, Notice
from symid.robot.description import Robot
from symid.robot.log_map import LogMap, LogQuantity
from symid.units import UNITS, find_unit_factor

__all__ = ["QUANTITIES", "Proposal", "propose_log"]

QUANTITIES = tuple(entry.name for entry in fields(LogMap) if entry.name not in {"transmission", "preset"})
"""Quantities that columns can be named for."""

_PRESETS = ("ur-rtde", "franka", "ros")
_OWN = {"position": "q", "torque": "tau"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """A map of a log.

    Args:
        log: the table to write.
        read: the columns that it stands for, by quantity.
        units: those of the columns as stated, by quantity; one where all are alike.
        assumed: what was taken for granted.
        unused: the other columns of the log.
    """

    log: LogMap
    read: Mapping[str, LogQuantity]
    units: Mapping[str, tuple[str, ...]]
    assumed: tuple[Notice, ...] = ()
    unused: tuple[str, ...] = ()


def propose_log(
    raw: RawLog,
    robot: Robot,
    file: str,
    *,
    columns: Mapping[str, tuple[str, ...]],
    units: Mapping[str, tuple[str, ...]],
) -> Proposal:
    """Return the `[log]` map of a robot for a log.

    Args:
        raw: the log.
        robot: its torque constants and gears are those that currents are converted by.
        file: the name of the log, for messages.
        columns: names by quantity, in place of what the headings say.
        units: units by quantity, one for each column or one for all, in place of what the headings say.

    Raises:
        LogError: quantities that the log does not have for every joint, or not for certain; units that are
            not stated. All of them, each with what to give.
    """
    findings = Findings(file=file)
    log = None if columns or units else _find_preset(raw, robot, findings)
    if log is not None:
        read = _list_quantities(log)
        told: dict[str, tuple[str, ...]] = {name: (entry.unit,) for name, entry in read.items()}
        log = LogMap(preset=log.preset)
    else:
        read, told = _propose_quantities(raw, robot, columns, units, findings)
        log = replace(LogMap(), **read)  # type: ignore[arg-type]  # the keys are those of quantities
    if not findings.mistakes:
        _note_sides(robot, read, findings)
    mistakes, remarks = (
        tuple(replace(entry, line=raw.line) for entry in found)
        for found in (findings.mistakes, findings.remarks)
    )
    if mistakes:
        raise LogError(*mistakes)
    used = {name for entry in read.values() for name in entry.columns}
    unused = tuple(name for name in (*raw.columns, *raw.others) if name not in used)
    return Proposal(log=log, read=read, units=told, assumed=remarks, unused=unused)


def _list_quantities(log: LogMap) -> dict[str, LogQuantity]:
    entries = {name: getattr(log, name) for name in QUANTITIES}
    return {name: entry for name, entry in entries.items() if entry is not None}


def _find_preset(raw: RawLog, robot: Robot, findings: Findings) -> LogMap | None:
    """Return the columns of a program that the log is of, None where it is of none."""
    own = _find_own(raw, robot)
    if own is not None:
        return own
    for preset in _PRESETS:
        tried = Findings(file=findings.file)
        log = apply_preset(raw, replace(robot, log=LogMap(preset=preset)), tried).log
        read = _list_quantities(log)
        mistakes = [entry for entry in tried.mistakes if entry.code != "log.no-torque-constant"]
        # A heading with a unit of its own was written by somebody else.
        stated = any(name in raw.units for entry in read.values() for name in entry.columns)
        if mistakes or stated or not set(NEEDED) <= set(read):
            continue
        for entry in tried.mistakes:
            findings.refuse("new.torque-constant", f"{entry.text}: {ask_constants(robot.axes)}")
        told = ", ".join(f"{name} in {read[name].unit}" for name in NEEDED)
        text = f"the columns are those of {preset}, so their units are taken as its: {told}"
        findings.remark("new.preset", f"{text} (SI: rad or m, N m or N)")
        return log
    return None


def _find_own(raw: RawLog, robot: Robot) -> LogMap | None:
    """Return the columns that symid itself writes, with their units; None where they are not there."""
    numbers = range(1, robot.freedom + 1)
    names = {"time": ("t",), **{key: tuple(f"{stem}{k}" for k in numbers) for key, stem in _OWN.items()}}
    if robot.freedom > 1 and {"q", "tau"} <= set(raw.columns):
        names = {"time": ("t",), **{key: (stem,) for key, stem in _OWN.items()}}
    columns = [name for entry in names.values() for name in entry]
    if any(name not in raw.columns or not _is_si(raw.units.get(name, "")) for name in columns):
        return None
    # Names of joints may end in other numbers than their order gives; then nobody can tell.
    headings = read_headings(raw, robot.axes)
    if find_columns(headings, "position", robot.axes, Findings(file="")) != names["position"]:
        return None
    read = {key: LogQuantity(columns=entry, unit=raw.units[entry[0]]) for key, entry in names.items()}
    return LogMap(preset="symid", time=read["time"], position=read["position"], torque=read["torque"])


def _is_si(unit: str) -> bool:
    """Return whether a unit is one that symid writes."""
    return unit in UNITS and UNITS[unit][1] == 1.0 and UNITS[unit][0] != "current"


def _propose_quantities(
    raw: RawLog,
    robot: Robot,
    columns: Mapping[str, tuple[str, ...]],
    units: Mapping[str, tuple[str, ...]],
    findings: Findings,
) -> tuple[dict[str, LogQuantity], dict[str, tuple[str, ...]]]:
    """Return all quantities that the headings or the user name, and the units as stated."""
    headings = read_headings(raw, robot.axes)
    found: dict[str, LogQuantity] = {}
    told: dict[str, tuple[str, ...]] = {}
    for quantity in dict.fromkeys((*NEEDED, "velocity", *columns)):
        if quantity in columns:
            names = check_columns(tuple(raw.columns), quantity, columns[quantity], robot.axes, findings)
        else:
            names = find_columns(headings, quantity, robot.axes, findings)
        stated = {entry.column: entry.unit for entry in headings if entry.unit is not None}
        if quantity in units and names:
            stated = _pair_units(quantity, names, units[quantity], findings)
            names = names if stated else ()
        joints = robot.axes[:1] if quantity == "time" else robot.axes
        entry = build_quantity(quantity, names, stated, joints, findings) if names else None
        if entry is not None:
            found[quantity] = entry
            each = tuple(stated[name] for name in names)
            told[quantity] = each[:1] if len(set(each)) == 1 else each
    _check_twice(found, findings)
    for quantity in units:
        if quantity not in (*found, *NEEDED, *columns):
            text = f"--units {quantity}: no column of the log is known as {quantity}; name them"
            findings.refuse(
                "new.unit-of-nothing", f"{text} with --columns {quantity}=NAME,..., or leave it out"
            )
    return found, told


def _pair_units(
    quantity: str, names: tuple[str, ...], units: tuple[str, ...], findings: Findings
) -> dict[str, str]:
    """Return the unit of each column; none, and a mistake noted, where they are not as many."""
    if len(units) not in {1, len(names)}:
        text = f"--units {quantity}: {len(units)} units for {join_names(names)}"
        findings.refuse("new.unit-count", f"{text}; give one for each column, or one for all")
        return {}
    return dict(zip(names, units * len(names) if len(units) == 1 else units, strict=True))


def _check_twice(found: Mapping[str, LogQuantity], findings: Findings) -> None:
    seen: dict[str, str] = {}
    for quantity, entry in found.items():
        for name in entry.columns:
            if name in seen:
                text = f"column {name!r} would be {seen[name]} and {quantity}; give each column once"
                findings.refuse("new.column-twice", text)
            seen[name] = quantity


def _note_sides(robot: Robot, read: Mapping[str, LogQuantity], findings: Findings) -> None:
    """Note what is taken for granted of gears and sides."""
    current = find_unit_factor(read["torque"].unit)[0] == "current"
    plain = tuple(joint.name for joint in robot.axes if joint.drive.gear == 1)
    if current and plain:
        text = f"currents: no gear is known of {join_names(plain)}, and 1 is taken, a direct drive"
        findings.remark("new.assumed-gear", f"{text}; give --gear RATIO,... where there are gears")
    if len(plain) < robot.freedom:
        what = "positions" if current else "positions and torques"
        text = f"{what} are taken as those of the joints, behind the gears"
        findings.remark(
            "new.assumed-side", f'{text}; write side = "motor" in [log] where they are the motors\''
        )
