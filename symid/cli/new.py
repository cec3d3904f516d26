"""`symid new ROBOT.toml`: a robot file to complete, from a URDF, a table of rows, or a robot at hand."""

from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import check_output, show_path
from symid.cli.options import force_option, verb
from symid.cli.output import Answer, Console
from symid.errors import Notice, RobotError, UsageError

if TYPE_CHECKING:  # these load numpy, which a usage error must not wait for
    from symid.robot.description import Robot

__all__ = ["command"]

_LEVEL = ("0", "0", "-9.81")
_COMMENT = """Made by symid from {source}.
What stands in comments is not known yet: fill in what is, and leave out what does not apply."""


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
    force: bool,
) -> Answer:
    """Write a commented robot file, to be completed by hand.

    It comes from a URDF, from a table of Denavit-Hartenberg rows, or from a robot that is at hand.
    """
    _check_options(
        urdf, table, name, {"--base": base, "--tip": tip}, {"--convention": convention, "--gravity": gravity}
    )
    _check_suffix(file)
    source = urdf or table
    check_output(file, force=force, inputs=() if source is None else (source,))
    console.progress(f"reading {source or name}")
    if name is not None:
        robot, text = _copy(name, file, force=force)
    elif urdf is not None:
        from symid.formats.urdf import read_urdf

        robot = read_urdf(urdf, base=base, tip=tip)
        text = _write(robot)
    else:
        from symid.formats.dh_table import read_dh_table

        robot = read_dh_table(table or Path(), convention or "", _split_gravity(gravity))
        text = _write(robot)
    from symid.identification.storage import write_file

    write_file(file, text)
    notices = robot.notices
    if table is not None and gravity is None:
        said = "gravity is taken as 0, 0, -9.81 m/s^2 in the base frame; give --gravity or correct the file"
        notices += (Notice(code="new.gravity", text=said, file=str(file)),)
    return _answer(robot, file, notices)


def _answer(robot: "Robot", file: Path, notices: tuple[Notice, ...]) -> Answer:
    joints = [{"name": joint.name, "kind": joint.kind.value} for joint in robot.joints]
    plural = "s" if len(joints) != 1 else ""
    lines = [
        f"robot file: {show_path(file)} ({robot.name}, {len(joints)} joint{plural})",
        f"next: complete it, then symid check {show_path(file)}",
    ]
    result = {"file": file, "robot": robot.name, "joints": joints, "notices": len(notices)}
    return Answer(text="\n".join(lines), result=result, warnings=notices)


def _check_options(
    urdf: Path | None,
    table: Path | None,
    name: str | None,
    of_urdf: dict[str, str | None],
    of_table: dict[str, str | None],
) -> None:
    """Refuse a call without one source, or with options of another one.

    Raises:
        UsageError: the options do not go together.
    """
    texts = []
    if sum(entry is not None for entry in (urdf, table, name)) != 1:
        texts.append("give one source: --from-urdf FILE, --from-dh FILE or --from ROBOT")
    for options, source, owner in ((of_urdf, urdf, "--from-urdf"), (of_table, table, "--from-dh")):
        texts += [
            f"{option} belongs to {owner}"
            for option, value in options.items()
            if value is not None and source is None
        ]
    if table is not None and of_table["--convention"] is None:
        texts.append("--from-dh needs --convention modified or --convention standard; it is never guessed")
    if texts:
        raise UsageError(*(Notice(code="usage.call", text=text) for text in texts))


def _check_suffix(file: Path) -> None:
    """Refuse a name under which no verb would read the file as what it is.

    Raises:
        UsageError: the name does not end in .toml.
    """
    if file.suffix.lower() != ".toml":
        text = f"{file}: a robot file is TOML; give a name that ends in .toml, such as {file.stem}.toml"
        raise UsageError(Notice(code="usage.suffix", text=text))


def _split_gravity(text: str | None) -> tuple[str, str, str]:
    """Return the three components of --gravity.

    Raises:
        UsageError: they are not three finite numbers of a sensible size.
    """
    if text is None:
        return _LEVEL
    from symid.formats.section import to_decimal

    parts = [part.strip() for part in text.split(",")]
    try:
        good = len(parts) == 3 and all(to_decimal(Decimal(part)) is not None for part in parts)
    except InvalidOperation:
        good = False
    if not good:
        expected = "expected three numbers in m/s^2 of a sensible size"
        message = f"--gravity {text}: {expected}, such as --gravity 0,0,-9.81"
        raise UsageError(Notice(code="usage.gravity", text=message))
    return (parts[0], parts[1], parts[2])


def _copy(name: str, file: Path, *, force: bool) -> tuple["Robot", str]:
    """Return a robot at hand and the text of its file; a URDF is converted."""
    from symid.formats.locate import find_robot_file, is_urdf
    from symid.formats.toml import read_robot
    from symid.formats.urdf import read_urdf

    found = find_robot_file(name)
    check_output(file, force=force, inputs=(found,))
    if is_urdf(found):
        robot = read_urdf(found)
        return robot, _write(robot)
    return read_robot(found), found.read_text(encoding="utf-8-sig")


def _write(robot: "Robot") -> str:
    """Return the text of the new file, which has been read back.

    Raises:
        RobotError: a robot file cannot say what the source says; the message names the source.
    """
    from symid.formats.toml import parse_robot
    from symid.formats.writer import write_robot

    text = write_robot(robot, comment=_COMMENT.format(source=Path(robot.path).name), hints=True)
    try:
        parse_robot(text)
    except RobotError as error:
        texts = (f"cannot be written as a robot file: {notice.text}" for notice in error.notices)
        raise RobotError(
            *(Notice(code="new.unwritable", text=words, file=robot.path) for words in texts)
        ) from error
    return text
