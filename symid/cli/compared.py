"""An estimate beside another, or beside a table of others: read, brought to the same groups, compared.

Input: paths. Output: `Compared`, one for every other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from symid.cli.compared_side import OurSide, read_ours
from symid.errors import EstimateError, Notice, UsageError

if TYPE_CHECKING:  # these load numpy and sympy
    from sympy import Expr

    from symid.formats.value_table import TableColumns, TableRow
    from symid.identification.comparison import StatedValues, TriedReading, ValueComparison
    from symid.parameters.readings import OpenReading

__all__ = [
    "Compared",
    "ComparedGroup",
    "OtherSide",
    "compare_with_estimate",
    "compare_with_table",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedGroup:
    """A group of the other's: `text` as it stands there, `read_as` what it was read as, if otherwise."""

    text: str
    unit: str
    line: int
    row: tuple["Expr", ...]
    read_as: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OtherSide:
    """What the others say.

    Args:
        source: its path; `columns` those of a table, None of an estimate.
        groups: what it has values for, with `values`; `strange` names what our model does not have.
        shared: logs that both estimates were fitted to; None where nobody knows.
    """

    source: Path
    columns: "TableColumns | None"
    groups: tuple[ComparedGroup, ...]
    values: "StatedValues"
    strange: tuple[str, ...] = ()
    shared: tuple[str, ...] | None = None
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Compared:
    """One other beside ours.

    Args:
        other: the other.
        groups: what both have, in the other's order, with `comparison`.
        not_ours: groups of the other's that we have no value for.
        absent: our parameters that take no part in any group of the other's; `neither` those that ours has
            no value for either; `lacking` how many combinations of ours the other does not tell besides.
        readings: terms that groups may hold without naming them, with what was found of each.
    """

    other: OtherSide
    groups: tuple[ComparedGroup, ...]
    comparison: "ValueComparison"
    not_ours: tuple[str, ...]
    absent: tuple[str, ...]
    neither: tuple[str, ...]
    lacking: int
    readings: tuple[tuple["OpenReading", "TriedReading"], ...] = ()


def compare_with_estimate(ours: OurSide, name: str, path: Path) -> Compared:
    """Return another estimate of the same robot beside ours, parameter by parameter.

    Raises:
        EstimateError: it cannot be read, is of another robot, or has no parameter in common.
    """
    from symid.identification.comparison import build_stated_values, find_shared_logs
    from symid.parameters.regrouping import find_group_row

    read = read_ours(name, path)
    found = read.identified
    terms = {entry.name: dict(entry.terms) for entry in (*found.base.parameters, *found.base.friction)}
    groups, places, strange = [], [], []
    for place, entry in enumerate(found.values):
        try:
            row = find_group_row(ours.identified.base, terms[entry.name], entry.name)
        except UsageError:
            strange.append(entry.name)
            continue
        groups.append(ComparedGroup(text=entry.name, unit=entry.unit, line=0, row=row))
        places.append(place)
    values = build_stated_values(
        [found.values[k].value for k in places],
        [found.values[k].std for k in places],
        [[found.covariance[i][j] for j in places] for i in places if found.covariance],
    )
    other = OtherSide(
        source=path,
        columns=None,
        groups=tuple(groups),
        values=values,
        strange=tuple(strange),
        shared=find_shared_logs(ours.logs, read.logs),
        notices=read.notices,
    )
    return _compare(ours, other)


def compare_with_table(
    ours: OurSide, path: Path, columns: "TableColumns", read_as: Mapping[str, str]
) -> Compared:
    """Return a table of others beside ours, in the table's groups.

    Args:
        ours: our estimate.
        path: of the table.
        columns: which columns to read.
        read_as: groups of the table, by their text without blanks, and what to read them as.

    Raises:
        UsageError: a column is not there; a reading is no sum of ours, or of no group of the table.
        EstimateError: with all that is wrong with the table.
    """
    from symid.formats.value_table import read_value_table
    from symid.identification.comparison import build_stated_values
    from symid.parameters.regrouping import build_regrouping

    base = ours.identified.base
    for text in read_as.values():
        _read_row(ours, text)

    def read_name(text: str) -> tuple["Expr", ...]:
        return _read_row(ours, read_as.get("".join(text.split()), text))

    table = read_value_table(path, columns, read_name)
    _check_read_as(table.rows, read_as, path)
    try:
        build_regrouping(base, [row.name for row in table.rows], [repr(row.text) for row in table.rows])
    except UsageError as error:
        raise EstimateError(*(_place(notice, path, table.rows) for notice in error.notices)) from error
    units = {entry.name: entry.unit for entry in ours.identified.values}
    names = [entry.name for entry in (*base.parameters, *base.friction)]
    groups = tuple(
        ComparedGroup(
            text=row.text,
            unit=next((units.get(n, "") for n, share in zip(names, row.name, strict=True) if share), ""),
            line=row.line,
            row=row.name,
            read_as=read_as.get("".join(row.text.split()), ""),
        )
        for row in table.rows
    )
    values = build_stated_values([row.value for row in table.rows], [row.deviation for row in table.rows])
    other = OtherSide(
        source=path,
        columns=table.columns,
        groups=groups,
        values=values,
        notices=_tell_table(path, table.columns, table.empty, [row.deviation for row in table.rows]),
    )
    return _compare(ours, other, search=True)


def _read_row(ours: OurSide, text: str) -> tuple["Expr", ...]:
    from symid.parameters.regrouping import find_group_row, read_group

    found = ours.identified
    return find_group_row(found.base, read_group(text, found.robot, found.base), repr(text))


def _check_read_as(
    rows: Sequence["TableRow[tuple[Expr, ...]]"], read_as: Mapping[str, str], path: Path
) -> None:
    """Refuse readings of groups that the table does not have.

    Raises:
        UsageError: with all of them.
    """
    known = {"".join(row.text.split()) for row in rows}
    notices = [
        Notice(
            code="usage.read-as",
            text=f"--read-as {text!r}: the table has no such group with a value; write it as it stands there",
            file=str(path),
        )
        for text in read_as
        if text not in known
    ]
    if notices:
        raise UsageError(*notices)


def _place(notice: Notice, path: Path, rows: Sequence["TableRow[tuple[Expr, ...]]"]) -> Notice:
    """Return the notice with the line of the last group that it names."""
    lines = [row.line for row in rows if repr(row.text) in notice.text]
    return replace(notice, file=str(path), line=max(lines, default=0))


def _tell_table(
    path: Path,
    columns: "TableColumns",
    empty: Sequence[tuple[int, str]],
    deviations: Sequence[float | None],
) -> tuple[Notice, ...]:
    notices = []
    if empty:
        text = f"passed over, because they have no value: {', '.join(name for _, name in empty)}"
        notices.append(Notice(code="compare.empty-value", text=text, file=str(path), line=empty[0][0]))
    without = sum(entry is None for entry in deviations)
    if without:
        text = f"{without} of {len(deviations)} values have no deviation; for them ours alone counts"
        if columns.deviation is None:
            text += "; --deviation names the column"
        elif columns.percent:
            text += "; percent of a value of zero are no deviation"
        notices.append(Notice(code="compare.no-deviation", text=text, file=str(path)))
    return tuple(notices)


def _compare(ours: OurSide, other: OtherSide, *, search: bool = False) -> Compared:
    """Return both side by side, in the groups that both have values for.

    Raises:
        EstimateError: there is none.
    """
    from symid.cli.compared_readings import try_readings
    from symid.identification.comparison import find_comparison, find_grouped_values
    from symid.parameters.regrouping import find_change

    base = ours.identified.base
    names = [entry.name for entry in (*base.parameters, *base.friction)]
    known = [names.index(name) for name in ours.names]
    missing = [k for k in range(len(names)) if k not in known]
    kept = [k for k, group in enumerate(other.groups) if not any(group.row[column] for column in missing)]
    if not kept:
        text = f"it has no group in common with {ours.path}: nothing can be compared"
        raise EstimateError(Notice(code="compare.nothing-common", text=text, file=str(other.source)))
    groups = tuple(other.groups[k] for k in kept)
    theirs = other.values.pick(kept)
    change = find_change([[group.row[k] for k in known] for group in groups], ours.identified.robot)
    absent = [name for k, name in enumerate(names) if not any(group.row[k] for group in other.groups)]
    return Compared(
        other=other,
        groups=groups,
        comparison=find_comparison(find_grouped_values(change, ours.values), theirs),
        not_ours=tuple(group.text for k, group in enumerate(other.groups) if k not in kept),
        absent=tuple(name for name in absent if name in ours.names),
        neither=tuple(name for name in absent if name not in ours.names),
        lacking=len(names) - len(absent) - len(other.groups),
        readings=try_readings(ours, [group.row for group in groups], change, theirs) if search else (),
    )
