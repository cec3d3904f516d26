"""`symid new ROBOT.toml`: a robot file to complete, from a URDF, a table of rows, or a robot at hand."""

import shlex
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import check_output, show_path
from symid.cli.new_log import LogPart, describe_robot, read_log_part, split_numbers
from symid.cli.new_source import Source, check_source, read_source
from symid.cli.options import force_option, friction_option, verb
from symid.cli.output import Answer, Console
from symid.errors import Notice, RobotError, UsageError

if TYPE_CHECKING:  # these load numpy, which a usage error must not wait for
    from symid.robot.description import Robot

__all__ = ["command"]

_COMMENT = """Made by symid from {source}.
What stands in comments is not known yet: fill in what is, and leave out what does not apply."""
_ASSUMED = "Of the log, to be checked by you:"
_WIDTH = 105


@click.command("new")
@click.argument("file", metavar="ROBOT.toml", type=click.Path(path_type=Path))
@click.option("--from-urdf", "urdf", metavar="FILE", type=click.Path(path_type=Path), help="A URDF.")
@click.option("--base", metavar="LINK", help="Link of the URDF that stands still.  [default: its root]")
@click.option("--tip", metavar="LINK", help="Last link of the URDF to keep; others are cut.")
@click.option(
    "--from-dh", "table", metavar="FILE", type=click.Path(path_type=Path), help="A CSV table of rows."
)
@click.option("--convention", type=click.Choice(("modified", "standard")), help="Of the table's rows.")
@click.option(
    "--gravity", metavar="X,Y,Z", help="In the base frame of the table, m/s^2.  [default: 0,0,-9.81]"
)
@click.option("--from", "name", metavar="ROBOT", help="A robot at hand: a file is copied, a URDF converted.")
@click.option(
    "--log",
    type=click.Path(path_type=Path),
    metavar="LOG",
    help="A log of the robot: its columns and their units become the [log] table.",
)
@click.option(
    "--columns",
    multiple=True,
    metavar="QUANTITY=NAME,...",
    help="Columns of a quantity (time, position, torque, velocity), one for each joint.  [default: by their "
    "names]",
)
@click.option(
    "--units",
    multiple=True,
    metavar="QUANTITY=UNIT,...",
    help="Unit of the columns, one for each or one for all, where the log states none or another one.",
)
@friction_option
@click.option("--rotors", is_flag=True, help="Every drive gets a rotor whose inertia is to be identified.")
@click.option(
    "--gear", metavar="N,...", help="Motor turns per joint turn, one for each joint or one for all."
)
@click.option(
    "--torque-constant", metavar="K,...", help="N m/A at the motor, one for each joint or one for all."
)
@force_option
@verb
def command(
    console: Console,
    *,
    file: Path,
    urdf: Path | None,
    base: str | None,
    tip: str | None,
    table: Path | None,
    convention: str | None,
    gravity: str | None,
    name: str | None,
    log: Path | None,
    columns: tuple[str, ...],
    units: tuple[str, ...],
    friction: str | None,
    rotors: bool,
    gear: str | None,
    torque_constant: str | None,
    force: bool,
) -> Answer:
    """Write a commented robot file, to be completed by hand.

    It comes from a URDF, from a table of Denavit-Hartenberg rows, or from a robot that is at hand. With
    --log it says which column of a log is what; what was taken for granted is told, and stands in the file.
    """
    source = Source(
        urdf=urdf, base=base, tip=tip, table=table, convention=convention, gravity=gravity, name=name
    )
    check_source(source, () if log is not None else _list_given({"--columns": columns, "--units": units}))
    _check_suffix(file)
    inputs = tuple(entry for entry in (urdf, table, log) if entry is not None)
    check_output(file, force=force, inputs=inputs)
    console.progress(f"reading {urdf or table or name}")
    added = _Added(
        log=log,
        columns=columns,
        units=units,
        friction=friction,
        rotors=rotors,
        gear=gear,
        constant=torque_constant,
    )
    if name is not None:
        robot, text, part = _copy(name, file, added, force=force)
    else:
        robot, text, part = _build(read_source(source), added)
    from symid.identification.storage import write_file

    write_file(file, text)
    notices = robot.notices
    if table is not None and gravity is None:
        said = "gravity is taken as 0, 0, -9.81 m/s^2 in the base frame; give --gravity or correct the file"
        notices += (Notice(code="new.gravity", text=said, file=str(file)),)
    return _answer(robot, file, part, notices)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Added:
    """What the command line puts beside the source."""

    log: Path | None
    columns: Sequence[str]
    units: Sequence[str]
    friction: str | None
    rotors: bool
    gear: str | None
    constant: str | None

    def list_given(self) -> tuple[str, ...]:
        """Return the options that were given."""
        return _list_given(
            {
                "--log": self.log,
                "--friction": self.friction,
                "--rotors": self.rotors,
                "--gear": self.gear,
                "--torque-constant": self.constant,
            }
        )


def _list_given(options: Mapping[str, object]) -> tuple[str, ...]:
    """Return the options that have a value; a flag that is not given is False, a list empty."""
    return tuple(option for option, value in options.items() if value not in (None, False, ()))


def _build(robot: "Robot", added: _Added) -> tuple["Robot", str, LogPart | None]:
    """Return the robot with what is added, the text of its file, and what is said of its log."""
    from symid.formats.completion import Completion, complete_robot

    robot = complete_robot(
        robot,
        Completion(
            friction=added.friction,
            rotors=added.rotors,
            gears=split_numbers("--gear", added.gear),
            constants=split_numbers("--torque-constant", added.constant),
        ),
    )
    if added.log is None:
        return robot, _write(robot, ()), None
    part = read_log_part(robot, added.log, added.columns, added.units)
    return part.robot, _write(part.robot, part.assumed), part


def _answer(robot: "Robot", file: Path, part: LogPart | None, notices: tuple[Notice, ...]) -> Answer:
    joints = [{"name": joint.name, "kind": joint.kind.value} for joint in robot.joints]
    text = f"robot file: {show_path(file)} ({describe_robot(robot)})"
    result = {"file": file, "robot": robot.name, "joints": joints}
    if part is None:
        text += f"\nnext: complete it, then symid check {shlex.quote(str(show_path(file)))}"
    else:
        notices += (*part.assumed, *part.doubts)
        given = shlex.join((str(show_path(file)), str(part.result["file"])))
        text = f"{text}\n{part.text}\nnext: symid check {given}"
        result["log"] = part.result
    return Answer(text=text, result={**result, "notices": len(notices)}, warnings=notices)


def _check_suffix(file: Path) -> None:
    """Refuse a name under which no verb would read the file as what it is.

    Raises:
        UsageError: the name does not end in .toml.
    """
    if file.suffix.lower() != ".toml":
        text = f"{file}: a robot file is TOML; give a name that ends in .toml, such as {file.stem}.toml"
        raise UsageError(Notice(code="usage.suffix", text=text))


def _copy(name: str, file: Path, added: _Added, *, force: bool) -> tuple["Robot", str, LogPart | None]:
    """Return a robot at hand and the text of its file; a URDF is converted.

    Raises:
        UsageError: something is to be put beside a robot file, which is copied as it is.
    """
    from symid.formats.locate import find_robot_file, is_urdf
    from symid.formats.toml import read_robot
    from symid.formats.urdf import read_urdf

    found = find_robot_file(name)
    check_output(file, force=force, inputs=(found,))
    if is_urdf(found):
        return _build(read_urdf(found), added)
    if added.list_given():
        listed = ", ".join(added.list_given())
        text = f"{listed}: a robot file is copied as it is; leave this out, and complete the copy by hand"
        raise UsageError(Notice(code="usage.copied", text=text, file=str(found)))
    return read_robot(found), found.read_text(encoding="utf-8-sig"), None


def _write(robot: "Robot", assumed: Sequence[Notice]) -> str:
    """Return the text of the new file, which has been read back; what was assumed stands at its head.

    Raises:
        RobotError: a robot file cannot say what the source says; the message names the source.
    """
    from symid.formats.toml import parse_robot
    from symid.formats.writer import write_robot

    comment = _COMMENT.format(source=Path(robot.path).name)
    lines = [
        line
        for notice in assumed
        for line in textwrap.wrap(notice.text, _WIDTH, initial_indent="* ", subsequent_indent="  ")
    ]
    if lines:
        comment = "\n".join((comment, "", _ASSUMED, *lines))
    text = write_robot(robot, comment=comment, hints=True)
    try:
        parse_robot(text)
    except RobotError as error:
        texts = (f"cannot be written as a robot file: {notice.text}" for notice in error.notices)
        raise RobotError(
            *(Notice(code="new.unwritable", text=words, file=robot.path) for words in texts)
        ) from error
    return text
