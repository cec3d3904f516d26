"""`symid compare ROBOT ESTIMATE OTHER...`: identified values beside those of others, group by group."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import show_path
from symid.cli.options import FiniteRange, verb
from symid.cli.output import Answer, Console
from symid.errors import EstimateError, Notice, UsageError

if TYPE_CHECKING:  # these load numpy and sympy
    from symid.cli.compared import Compared

__all__ = ["command"]

_MISSED = 1
_TABLE_OPTIONS = ("--name", "--value", "--deviation", "--deviation-unit", "--read-as")


@click.command("compare")
@click.argument("robot")
@click.argument("estimate", type=click.Path(path_type=Path))
@click.argument("others", nargs=-1, required=True, metavar="OTHER...", type=click.Path(path_type=Path))
@click.option("--name", metavar="COLUMN", help="Of a table: the column of names or groups.")
@click.option("--value", metavar="COLUMN", help="Of a table: the column of values.")
@click.option("--deviation", metavar="COLUMN", help="Of a table: the column of standard deviations.")
@click.option(
    "--deviation-unit",
    type=click.Choice(("absolute", "percent")),
    help="Of a table: what deviations are in.  [default: by the name of their column]",
)
@click.option(
    "--read-as",
    multiple=True,
    metavar="GROUP=SUM",
    help='Of a table: read a group as another sum, such as "fv5 = fv5 + fvm6".',
)
@click.option(
    "--gate",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="SIGMA",
    help="Largest acceptable difference, in standard deviations.",
)
@verb
def command(
    console: Console,
    *,
    robot: str,
    estimate: Path,
    others: tuple[Path, ...],
    name: str | None,
    value: str | None,
    deviation: str | None,
    deviation_unit: str | None,
    read_as: tuple[str, ...],
    gate: float | None,
) -> Answer:
    """Show how far the values in ESTIMATE are from those of every OTHER.

    OTHER is another estimate of the same robot, or a table (CSV) of values that somebody else found, in
    groups of their own: ours are brought to them exactly. Differences are in standard deviations of both
    sides together. Exit code 1 when the gate is missed.
    """
    _check_files((estimate, *others))
    readings = _split_readings(read_as)
    tables = [path for path in others if not _is_object(path)]
    given = dict(zip(_TABLE_OPTIONS, (name, value, deviation, deviation_unit, read_as), strict=True))
    if not tables and any(given.values()):
        used = ", ".join(option for option, entry in given.items() if entry)
        text = f"{used}: of tables, and there is none among {', '.join(map(str, others))}; leave it out"
        raise UsageError(Notice(code="usage.no-table", text=text))
    console.progress(f"finding the base parameters of {robot}")
    from symid.cli.compared import compare_with_estimate, compare_with_table
    from symid.cli.compared_side import read_ours
    from symid.cli.compared_text import describe_compared, show_compared, warn_compared
    from symid.formats.value_table import TableColumns

    ours = read_ours(robot, estimate)
    percent = None if deviation_unit is None else deviation_unit == "percent"
    columns = TableColumns(name=name, value=value, deviation=deviation, percent=percent)
    found = [
        compare_with_table(ours, path, columns, readings)
        if path in tables
        else compare_with_estimate(ours, robot, path)
        for path in others
    ]
    errors = tuple(notice for entry in found for notice in _find_missed(entry, gate))
    warnings = [note for note in ours.identified.robot.notices if note.code != "estimate.settings-differ"]
    for entry in found:
        warnings += [*ours.notices, *entry.other.notices, *warn_compared(entry)]
    return Answer(
        text="\n\n\n".join(show_compared(ours, entry) for entry in found),
        result={
            "robot": ours.identified.robot.name,
            "estimate": show_path(estimate),
            "others": [describe_compared(entry) for entry in found],
            "gate": gate,
            "accepted": not errors,
        },
        warnings=tuple(dict.fromkeys(warnings)),
        errors=errors,
        exit_code=_MISSED if errors else 0,
    )


def _check_files(paths: Sequence[Path]) -> None:
    """Refuse files that cannot be read, and a file beside itself.

    Raises:
        UsageError: the same file is given twice.
        EstimateError: some are not there, all are told.
    """
    notices = []
    for path in paths:
        try:
            with path.open("rb"):
                pass
        except OSError as error:
            text = f"cannot be read: {error.strerror or error}"
            notices.append(Notice(code="estimate.format", text=text, file=str(path)))
    if notices:
        raise EstimateError(*notices)
    seen: dict[Path, Path] = {}
    for path in paths:
        if path.resolve() in seen:
            text = f"the same file as {seen[path.resolve()]}; give each file once"
            raise UsageError(Notice(code="usage.same-file", text=text, file=str(path)))
        seen[path.resolve()] = path


def _is_object(path: Path) -> bool:
    """Return whether a file is JSON, right or wrong, and so no table."""
    with path.open("rb") as stream:
        return stream.read(4096).lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"[")


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


def _find_missed(found: "Compared", gate: float | None) -> tuple[Notice, ...]:
    """Return what misses the gate."""
    if gate is None:
        return ()
    comparison, file = found.comparison, str(found.other.source)
    if not comparison.judged:
        text = "no deviation is known on either side, so that the gate cannot be judged"
        return (Notice(code="compare.gate", text=text, file=file),)
    if comparison.largest <= gate:
        return ()
    (worst,) = comparison.list_farthest(0.0, 1)
    text = (
        f"{found.groups[worst].text} differs by {comparison.largest:.4g} standard deviations, "
        f"more than the gate of {gate:g}"
    )
    return (Notice(code="compare.gate", text=text, file=file),)
