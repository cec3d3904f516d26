"""What a log adds to a robot file: which column is what, and what is left out of it.

Input: the path of a log, the robot, columns and units by quantity. Output: `LogPart`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from symid.data.checks import check_recording
from symid.data.proposal import QUANTITIES, Proposal, propose_log
from symid.data.proposed_processing import ENDS, SLOW, propose_processing
from symid.data.readers import read_raw, read_recording
from symid.data.resampling import make_even
from symid.errors import Notice, UsageError
from symid.formats.section import find_nearest
from symid.robot.description import FrictionKind, Robot

__all__ = ["LogPart", "Names", "read_log_part"]

Names = Mapping[str, str | Sequence[str]]
"""What is said of each quantity: a list, or a text with commas."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogPart:
    """The robot with the map of its log, and what is said of it.

    Args:
        robot: with the tables `[log]` and `[processing]`.
        file: the log; found: its columns and units.
        assumed: what was taken for granted, for the file too.
        doubts: what is odd about the log, read so.
    """

    robot: Robot
    file: Path
    found: Proposal
    assumed: tuple[Notice, ...]
    doubts: tuple[Notice, ...]


def read_log_part(robot: Robot, log: Path, columns: Names, units: Names) -> LogPart:
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
    found = propose_log(read_raw(log), robot, str(log), columns=named, units=of_units)
    robot, chosen, doubts = _add_processing(replace(robot, log=found.log), log)
    assumed = (*found.assumed, *_note_unused(found, log), *chosen, *_note_silence(robot))
    return LogPart(robot=robot, file=log, found=found, assumed=assumed, doubts=doubts)


def _split_names(option: str, given: Names) -> dict[str, tuple[str, ...]]:
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
            hint = find_nearest(quantity, QUANTITIES) or f"known are {', '.join(QUANTITIES)}"
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


def _add_processing(robot: Robot, log: Path) -> tuple[Robot, tuple[Notice, ...], tuple[Notice, ...]]:
    """Return the robot with what is left out of a log, why it is, and what is odd about the log."""
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


def _note_unused(found: Proposal, log: Path) -> tuple[Notice, ...]:
    if not found.unused:
        return ()
    # The heading of a column that nobody filled in is empty.
    names = ", ".join(name or "''" for name in found.unused)
    text = f"columns that are not used: {names}; --columns QUANTITY=NAME,... names others"
    return (Notice(code="new.unused-columns", text=text, file=str(log)),)


def _note_silence(robot: Robot) -> tuple[Notice, ...]:
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
