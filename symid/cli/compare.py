"""`symid compare ROBOT ESTIMATE OTHER...`: identified values beside those of others, group by group."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import click

from symid.api.comparison import compare_fit
from symid.cli.inputs import NamedRobot
from symid.cli.options import INPUT, METHOD, FiniteRange, Verb, option, robot_argument, verb
from symid.cli.output import Answer, Console, make_answer
from symid.errors import Notice, UsageError

__all__ = ["command"]


@click.command("compare", cls=Verb)
@robot_argument()
@click.argument("estimate", type=click.Path(path_type=Path))
@click.argument("others", nargs=-1, required=True, metavar="OTHER...", type=click.Path(path_type=Path))
@option("--name", metavar="COLUMN", group=INPUT, help="Table column of names or groups.")
@option("--value", metavar="COLUMN", group=INPUT, help="Table column of values.")
@option(
    "--deviation",
    metavar="COLUMN",
    group=INPUT,
    help="Table column of standard deviations.",
)
@option(
    "--deviation-unit",
    type=click.Choice(("absolute", "percent")),
    group=INPUT,
    help="Unit of the table's standard deviations.  [default: by the name of their column]",
)
@option(
    "--read-as",
    multiple=True,
    metavar="GROUP=SUM",
    group=INPUT,
    help='Read a group of a table as another sum, such as "fv5 = fv5 + fvm6".',
)
@option(
    "--gate",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="SIGMA",
    group=METHOD,
    help="Largest acceptable difference, in standard deviations.",
)
@verb
def command(
    console: Console,
    *,
    robot: NamedRobot,
    estimate: Path,
    others: tuple[Path, ...],
    name: str | None,
    value: str | None,
    deviation: str | None,
    deviation_unit: Literal["absolute", "percent"] | None,
    read_as: tuple[str, ...],
    gate: float | None,
) -> Answer:
    """Show how far the values in ESTIMATE are from those of every OTHER.

    OTHER is another estimate of the same robot, or a table (CSV) of values that somebody else found, in
    groups of their own: ours are brought to them exactly. Differences are in standard deviations of both
    sides together. Exit code 1 when the gate is missed.
    """
    found = compare_fit(
        robot.load(console).description,
        estimate,
        others,
        name=name,
        value=value,
        deviation=deviation,
        deviation_unit=deviation_unit,
        read_as=_split_readings(read_as),
        gate=gate,
        progress=console.progress,
    )
    return make_answer(found)


def _split_readings(texts: Sequence[str]) -> dict[str, str]:
    """Return what groups are to be read as, by their text without blanks.

    Raises:
        UsageError: a text has no equals sign, or a group is given twice.
    """
    readings: dict[str, str] = {}
    for text in texts:
        group, sign, other = text.partition("=")
        key = "".join(group.split())
        if not sign or not key or not other.strip():
            message = f'--read-as {text!r}: expected GROUP = SUM, such as "fv5 = fv5 + fvm6"'
            raise UsageError(Notice(code="usage.read-as", text=message))
        if key in readings:
            message = f"--read-as {text!r}: the group is read as {readings[key]!r} already; give it once"
            raise UsageError(Notice(code="usage.read-as", text=message))
        readings[key] = other.strip()
    return readings
