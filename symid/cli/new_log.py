"""What `symid new` makes of a log: which column is what, and what to say of it.

Input: the path of a log, the robot, texts of the command line. Output: `LogPart`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from symid.cli.output import format_table
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.data.proposal import Proposal
    from symid.robot.description import Robot

__all__ = ["LogPart", "describe_robot", "read_log_part", "split_names", "split_numbers"]

_EXAMPLES = {"--gear": "100,100,50", "--torque-constant": "0.12,0.12,0.05"}


@dataclass(frozen=True, slots=True, kw_only=True)
class LogPart:
    """The robot with the map of its log, and what is said of it.

    Args:
        text, result: columns and units.
        assumed: what was taken for granted, for the file too.
        doubts: what is odd about the log, read so.
    """

    robot: "Robot"
    text: str
    result: dict[str, object]
    assumed: tuple[Notice, ...]
    doubts: tuple[Notice, ...]


def split_numbers(option: str, text: str | None) -> tuple[float, ...]:
    """Return the numbers of an option, with commas between; none where it is not given.

    Raises:
        UsageError: one of them is no number of a robot file, or zero.
    """
    from decimal import Decimal, InvalidOperation

    from symid.formats.section import to_decimal

    if text is None:
        return ()
    try:
        numbers = [to_decimal(Decimal(part.strip())) for part in text.split(",")]
    except InvalidOperation:
        numbers = [None]
    if not all(numbers):
        message = f"{option} {text}: expected numbers other than 0 with commas between, one for each joint"
        raise UsageError(
            Notice(code="usage.numbers", text=f"{message}, such as {option} {_EXAMPLES[option]}")
        )
    return tuple(float(number) for number in numbers if number is not None)


def split_names(option: str, texts: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return what an option says of each quantity, from texts such as position=q1,q2.

    Raises:
        UsageError: a text is not of that form, there is no such quantity, or it is there twice.
    """
    from symid.data.proposal import QUANTITIES
    from symid.formats.section import find_nearest

    found: dict[str, tuple[str, ...]] = {}
    mistakes = []
    for text in texts:
        quantity, sign, value = (part.strip() for part in text.partition("="))
        names = tuple(part.strip() for part in value.split(","))
        if not sign or not all(names):
            example = "deg" if option == "--units" else "NAME,NAME"
            mistakes.append(f"expected QUANTITY=..., such as {option} position={example}")
        elif quantity not in QUANTITIES:
            hint = find_nearest(quantity, QUANTITIES) or f"known are {', '.join(QUANTITIES)}"
            mistakes.append(f"there is no quantity {quantity!r}; {hint}")
        elif quantity in found:
            mistakes.append(f"{quantity} is given twice; give it once")
        else:
            found[quantity] = names
            continue
        mistakes[-1] = f"{option} {text}: {mistakes[-1]}"
    if mistakes:
        raise UsageError(*(Notice(code="usage.quantity", text=text) for text in mistakes))
    return found


def read_log_part(robot: "Robot", log: Path, columns: Sequence[str], units: Sequence[str]) -> LogPart:
    """Return the robot with a `[log]` table for a log, and without the rows that tell nothing.

    Raises:
        UsageError: the options are not what they should be.
        LogError: the log cannot be read, or its columns cannot be told.
    """
    from symid.data.proposal import propose_log
    from symid.data.readers import read_raw

    named, of_units = split_names("--columns", columns), split_names("--units", units)
    found = propose_log(
        read_raw(log),
        robot,
        str(log),
        columns=named,
        units=of_units,
    )
    robot, chosen, doubts = _add_processing(replace(robot, log=found.log), log)
    assumed = (*found.assumed, *_note_unused(found, log), *chosen, *_note_silence(robot))
    header = ("quantity", "columns", "unit")
    told = {name: ", ".join(found.units[name]) for name in found.read}
    rows = [(name, ", ".join(entry.columns), told[name]) for name, entry in found.read.items()]
    return LogPart(
        robot=robot,
        text=f"log: {log}{_name_preset(found)}\n{format_table(header, rows, left=(0, 1, 2))}",
        result={
            "file": log,
            "preset": found.log.preset,
            "columns": {name: list(entry.columns) for name, entry in found.read.items()},
            "units": told,
            "unused": list(found.unused),
            "standstill": robot.processing.standstill,
            "dropped": robot.processing.drop_first,
        },
        assumed=assumed,
        doubts=doubts,
    )


def _name_preset(found: "Proposal") -> str:
    return "" if found.log.preset is None else f" (columns of {found.log.preset})"


def _add_processing(robot: "Robot", log: Path) -> tuple["Robot", tuple[Notice, ...], tuple[Notice, ...]]:
    """Return the robot with what is left out of a log, why it is, and what is odd about the log."""
    from symid.data.checks import check_recording
    from symid.data.proposed_processing import ENDS, SLOW, propose_processing
    from symid.data.readers import read_recording
    from symid.data.resampling import make_even

    recording = make_even(read_recording(log, robot, uneven=True))
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


def _note_unused(found: "Proposal", log: Path) -> tuple[Notice, ...]:
    if not found.unused:
        return ()
    # The heading of a column that nobody filled in is empty.
    names = ", ".join(name or "''" for name in found.unused)
    text = f"columns that are not used: {names}; --columns QUANTITY=NAME,... names others"
    return (Notice(code="new.unused-columns", text=text, file=str(log)),)


def _note_silence(robot: "Robot") -> tuple[Notice, ...]:
    """Say what is missing of the robot without which no log fits."""
    from symid.robot.description import FrictionKind

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


def describe_robot(robot: "Robot") -> str:
    """Return name and number of joints."""
    plural = "s" if len(robot.joints) != 1 else ""
    return f"{robot.name}, {len(robot.joints)} joint{plural}"
