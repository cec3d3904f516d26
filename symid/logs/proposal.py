"""Proposed `[log]` and `[processing]` tables for a robot file, from a log.

Robot, path of a log, columns and units by quantity -> LogMapDraft: the robot with both tables, and what
was assumed.

    preset of a known program, else: headings -> columns of each joint -> units -> LogMap
    ends         a tenth of a second is left out: derivatives there are one-sided, which filters carry inwards
    standstill   a hundredth of the top speed of the slowest joint that moves, to one digit

Supported: what `headings` reads, names and units of the user in place of it, the presets; robots without
dry friction, which need no standstill.
Not supported: columns of motors, of second encoders and of controllers, unless the user names them; a
standstill speed of its own for each joint, which robot files do not have.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

from symid.errors import LogError, Notice, UsageError
from symid.logs.checks import check_recording, summarise_joints
from symid.logs.columns import Findings, join_names
from symid.logs.files import RawLog
from symid.logs.headings import (
    REQUIRED_QUANTITIES,
    ask_constants,
    build_quantity,
    check_columns,
    choose_columns,
    read_headings,
)
from symid.logs.reader import apply_preset, read_raw, read_recording
from symid.logs.recording import Recording
from symid.logs.sampling import resample_if_uneven
from symid.notation import UNITS, get_unit_factor
from symid.robot import FrictionKind, LogMap, LogQuantity, Processing, Robot, suggest_names

QUANTITIES = tuple(entry.name for entry in fields(LogMap) if entry.name not in {"transmission", "preset"})
"""Quantities that columns can be named for."""

_PRESETS = ("ur-rtde", "franka", "ros")
_OWN = {"position": "q", "torque": "tau"}


@dataclass(frozen=True, slots=True, kw_only=True)
class LogMapProposal:
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


def propose_log_map(
    raw: RawLog,
    robot: Robot,
    file: str,
    *,
    columns: Mapping[str, tuple[str, ...]],
    units: Mapping[str, tuple[str, ...]],
) -> LogMapProposal:
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
    log = None if columns or units else _match_preset(raw, robot, findings)
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
    return LogMapProposal(log=log, read=read, units=told, assumed=remarks, unused=unused)


def _list_quantities(log: LogMap) -> dict[str, LogQuantity]:
    entries = {name: getattr(log, name) for name in QUANTITIES}
    return {name: entry for name, entry in entries.items() if entry is not None}


def _match_preset(raw: RawLog, robot: Robot, findings: Findings) -> LogMap | None:
    """Return the columns of a program that the log is of, None where it is of none."""
    own = _match_symid_columns(raw, robot)
    if own is not None:
        return own
    for preset in _PRESETS:
        tried = Findings(file=findings.file)
        log = apply_preset(raw, replace(robot, log=LogMap(preset=preset)), tried).log
        read = _list_quantities(log)
        mistakes = [entry for entry in tried.mistakes if entry.code != "log.no-torque-constant"]
        # A heading with a unit of its own was written by somebody else.
        stated = any(name in raw.units for entry in read.values() for name in entry.columns)
        if mistakes or stated or not set(REQUIRED_QUANTITIES) <= set(read):
            continue
        for entry in tried.mistakes:
            findings.refuse("new.torque-constant", f"{entry.text}: {ask_constants(robot.axes)}")
        told = ", ".join(f"{name} in {read[name].unit}" for name in REQUIRED_QUANTITIES)
        text = f"the columns are those of {preset}, so their units are taken as its: {told}"
        findings.remark("new.preset", f"{text} (SI: rad or m, N m or N)")
        return log
    return None


def _match_symid_columns(raw: RawLog, robot: Robot) -> LogMap | None:
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
    if choose_columns(headings, "position", robot.axes, Findings(file="")) != names["position"]:
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
    for quantity in dict.fromkeys((*REQUIRED_QUANTITIES, "velocity", *columns)):
        if quantity in columns:
            names = check_columns(tuple(raw.columns), quantity, columns[quantity], robot.axes, findings)
        else:
            names = choose_columns(headings, quantity, robot.axes, findings)
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
    _check_duplicate_columns(found, findings)
    for quantity in units:
        if quantity not in (*found, *REQUIRED_QUANTITIES, *columns):
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


def _check_duplicate_columns(found: Mapping[str, LogQuantity], findings: Findings) -> None:
    seen: dict[str, str] = {}
    for quantity, entry in found.items():
        for name in entry.columns:
            if name in seen:
                text = f"column {name!r} would be {seen[name]} and {quantity}; give each column once"
                findings.refuse("new.column-twice", text)
            seen[name] = quantity


def _note_sides(robot: Robot, read: Mapping[str, LogQuantity], findings: Findings) -> None:
    """Note what is taken for granted of gears and sides."""
    current = get_unit_factor(read["torque"].unit)[0] == "current"
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


ENDS = 0.1
"""Seconds left out at either end."""

SLOW = 0.01
"""Part of the top speed below which a joint counts as standing still."""

_LARGEST_PART = 0.05


def propose_processing(recording: Recording, robot: Robot) -> Processing:
    """Return what is left out of a log; cut-off and decimation follow from the log.

    Args:
        recording: an even one.
        robot: its friction says whether standstill matters.
    """
    ends = round(min(ENDS / recording.period, _LARGEST_PART * len(recording.time)))
    dry = any(joint.friction.kind is not FrictionKind.NONE for joint in robot.joints)
    speeds = [entry.speed for entry in summarise_joints(recording, robot) if entry.speed > 0.0]
    return Processing(
        automatic=True,
        drop_first=ends,
        drop_last=ends,
        standstill=float(f"{SLOW * min(speeds):.1g}") if dry and speeds else 0.0,
    )


NamesByQuantity = Mapping[str, str | Sequence[str]]
"""What is said of each quantity: a list, or a text with commas."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogMapDraft:
    """The robot with the map of its log, and what is said of it.

    Args:
        robot: with the tables `[log]` and `[processing]`.
        file: the log; found: its columns and units.
        assumed: what was taken for granted, for the file too.
        doubts: what is odd about the log, read so.
    """

    robot: Robot
    file: Path
    found: LogMapProposal
    assumed: tuple[Notice, ...]
    doubts: tuple[Notice, ...]


def draft_log_map(robot: Robot, log: Path, columns: NamesByQuantity, units: NamesByQuantity) -> LogMapDraft:
    """Return the robot with a `[log]` table for a log, and without the rows that tell nothing.

    Args:
        robot: whose log it is.
        log: the file.
        columns: names of columns by quantity, where their names do not tell.
        units: by quantity, one for each column or one for all, where the log states none or another one.

    Raises:
        UsageError: there is no such quantity.
        LogError: the log cannot be read, or its columns cannot be told.
    """
    named, of_units = _split_names("--columns", columns), _split_names("--units", units)
    raw = read_raw(log)
    found = propose_log_map(raw, robot, str(log), columns=named, units=of_units)
    robot, chosen, doubts = _add_processing(replace(robot, log=found.log), log, raw)
    assumed = (*found.assumed, *_note_unused(found, log), *chosen, *_note_missing_friction(robot))
    return LogMapDraft(robot=robot, file=log, found=found, assumed=assumed, doubts=doubts)


def _split_names(option: str, given: NamesByQuantity) -> dict[str, tuple[str, ...]]:
    """Return what an option says of each quantity.

    Raises:
        UsageError: there is no such quantity, or nothing is said of it.
    """
    found: dict[str, tuple[str, ...]] = {}
    mistakes = []
    for quantity, names in given.items():
        parts = names.split(",") if isinstance(names, str) else names
        found[quantity] = tuple(part.strip() for part in parts)
        if quantity not in QUANTITIES:
            hint = suggest_names(quantity, QUANTITIES) or f"known are {', '.join(QUANTITIES)}"
            mistake = f"there is no quantity {quantity!r}; {hint}"
        elif not all(found[quantity]) or not found[quantity]:
            example = "deg" if option == "--units" else "NAME,NAME"
            mistake = f"expected QUANTITY=..., such as {option} position={example}"
        else:
            continue
        mistakes.append(f"{option} {quantity}={','.join(parts)}: {mistake}")
    if mistakes:
        raise UsageError(*(Notice(code="usage.quantity", text=text) for text in mistakes))
    return found


def _add_processing(
    robot: Robot, log: Path, raw: RawLog
) -> tuple[Robot, tuple[Notice, ...], tuple[Notice, ...]]:
    """Return the robot with what is left out of a log, why it is, and what is odd about the log."""
    recording = resample_if_uneven(read_recording(log, robot, uneven=True, raw=raw))
    found = propose_processing(recording, robot)
    texts = {
        "new.ends": f"processing.drop_first and drop_last are set to {found.drop_first} samples, {ENDS:g} s "
        "or less: derivatives at the ends of a log are poor"
    }
    if found.standstill:
        texts["new.standstill"] = (
            f"processing.standstill is set to {found.standstill:g} rad/s or m/s, {100.0 * SLOW:g} % of the "
            "top speed of the slowest joint: rows at which a joint is slower, and may stick, are left out"
        )
        if len({joint.kind for joint in robot.axes}) > 1:
            texts["new.standstill"] += "; one number serves what turns and what slides: look whether it does"
    notices = tuple(Notice(code=code, text=text, file=str(log)) for code, text in texts.items())
    return replace(robot, processing=found), notices, check_recording(recording, robot)


def _note_unused(found: LogMapProposal, log: Path) -> tuple[Notice, ...]:
    if not found.unused:
        return ()
    # The heading of a column that nobody filled in is empty.
    names = ", ".join(name or "''" for name in found.unused)
    text = f"columns that are not used: {names}; --columns QUANTITY=NAME,... names others"
    return (Notice(code="new.unused-columns", text=text, file=str(log)),)


def _note_missing_friction(robot: Robot) -> tuple[Notice, ...]:
    """Say what is missing of the robot without which no log fits."""
    notices = []
    plain = [joint.name for joint in robot.axes if joint.friction.kind is FrictionKind.NONE]
    if plain:
        text = f"no friction is known of {', '.join(plain)}; real joints have some: give --friction "
        notices.append(
            Notice(code="new.no-friction", text=f"{text}viscous_coulomb_offset, or write it into the file")
        )
    still = [joint.name for joint in robot.axes if joint.drive.gear != 1 and not joint.drive.has_rotor]
    if still:
        text = f"no rotor is known of {', '.join(still)}, and behind a gear it is felt: give --rotors"
        notices.append(Notice(code="new.no-rotor", text=f"{text}, or write it into the file"))
    return tuple(notices)
