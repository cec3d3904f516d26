"""Values of a robot's parameters in files: ours as JSON and as a C header, tables that others publish.

JSON is an object of plain types, SI units, format 1, links in the frames of the URDF that symid writes:

    format, version, robot, signature
    vectors: {"beta": [{name, value, unit, expression, identified, std}], "f": ..., "IA": ..., "h": ...}
    gravity: [x, y, z]
    links: [{joint, kind, parent, mass, com, inertia {xx xy xz yy yz zz about com}, standard {XX ... M}}]
    drives: [{name, gear, rotor_inertia, friction {model, values {}, shape {}, smoothing}}], couplings last

The header has an array for each vector, such as `symid_arm_beta`, for each entry its place in it, such as
`SYMID_ARM_BETA_ZZR1`, and the model's signature. Several in one program have names of their own; a second
one of the same names does not compile. An unknown value is null in JSON, and 0 with a comment in C.

A published table is a text file with a line of column names, such as parameter,ols,ols_std_percent, and one
line a parameter, such as Izz1 + 1.0*Ia1,1.247,0.98 -> `PublishedTable`, or one `EstimateError` with all
mistakes and their lines.

Supported: comma, semicolon or tab between columns; comments from # at the start of a line; cells in double
quotes; deviations in the unit of the value or in percent of it; columns chosen by name, or guessed where
there is no other; lines without a value are skipped and listed. The minus of typography counts as a minus.
Not supported: a decimal comma, a percent sign behind each number, cells of several lines.
"""

import csv
import math
import re
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

from symid.errors import EstimateError, Notice, RobotError, UsageError
from symid.joint_models import get_friction_law, list_value_names, name_bristles, name_shape, name_values
from symid.notation import INERTIAL
from symid.robot.description import Coupling, Joint, Robot
from symid.robot.inertia import TENSOR, split_body
from symid.robot.toml_values import read_text_file, sort_notices

N = TypeVar("N")

_NAMES = ("name", "parameter", "base_parameter", "group", "grouping", "expression")
_VALUES = ("value", "estimate", "estimated", "identified")
_DEVIATIONS = {"std", "stdev", "stddev", "sd", "sigma", "deviation", "error"}
_PERCENT = ("percent", "pct", "%")
_MINUS = "\N{MINUS SIGN}"
_LARGEST = 1e100
_NUMBER_LIKE = re.compile(r"[+-]?[\d.,]*\d[\d.,]*([eE][+-]?\d+)?\s*%?")
"""What somebody took for a number, whether it can be read or not."""

_Names = Sequence[str]
_Line = tuple[int, list[str]]
"""Number and cells of a line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueRow:
    """A parameter: its value in SI units, what it groups, its identified value and standard deviation."""

    name: str
    value: float | None
    unit: str
    expression: str = ""
    identified: float | None = None
    std: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueVector:
    """One argument of generated functions: its name there, its meaning, its entries in order."""

    name: str
    title: str
    rows: tuple[ValueRow, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotValues:
    """All vectors of a robot, `signature` that of its model, `prefix` how names of its C library begin."""

    robot: str
    prefix: str
    signature: str
    vectors: tuple[ValueVector, ...]


def build_json_values(
    robot: Robot, values: RobotValues, *, outcome: str, sources: Sequence[str] = ()
) -> dict[str, object]:
    """Return the object of a robot with values of links and drives, which `values` has as vectors.

    `outcome` says in one word how they were estimated, `sources` are the logs they come from.
    """
    symbols = dict(robot.symbols)
    links: list[dict[str, object]] = []
    for joint in robot.joints:
        parent = robot.joints[joint.parent].name if joint.parent >= 0 else None
        links.append({"joint": joint.name, "kind": joint.kind.value, "parent": parent})
        links[-1] |= dict.fromkeys(("mass", "com", "inertia", "standard"))
        if joint.inertial is not None:
            mass, com, central = split_body(joint.inertial)
            standard = dict(zip(INERTIAL, joint.inertial, strict=True))
            inertia = dict(zip(TENSOR, central, strict=True))
            links[-1] |= {"mass": mass, "com": com, "inertia": inertia, "standard": standard}
    drives: list[dict[str, object]] = []
    owners: tuple[Joint | Coupling, ...] = (*robot.joints, *robot.couplings)
    for owner in owners:
        moves: dict[str, object]
        if isinstance(owner, Joint):
            moves, rotor = {"gear": owner.drive.gear}, owner.drive.rotor_inertia
        else:
            terms = {robot.joints[index].name: float(factor) for index, factor in owner.terms}
            moves, rotor = {"turns_with": terms}, owner.rotor_inertia
        law = get_friction_law(owner.friction)
        bristles = name_bristles(law, owner.friction.bristles) if law is not None and law.memory else {}
        friction = {
            "model": owner.friction.law,
            "values": dict.fromkeys(list_value_names(owner.friction)) | name_values(owner.friction),
            "shape": name_shape(owner.friction),
            "smoothing": owner.friction.smoothing,
            **({"bristles": {name: list(part) for name, part in bristles.items()}} if bristles else {}),
        }
        drives.append({"name": owner.name, **moves, "rotor_inertia": rotor, "friction": friction})
    return {
        "format": "symid values",
        "version": 1,
        "robot": robot.name,
        "signature": values.signature,
        "outcome": outcome,
        "sources": list(sources),
        "gravity": [value.to_float(symbols) for value in robot.gravity],
        "vectors": {one.name: [asdict(row) for row in one.rows] for one in values.vectors if one.rows},
        "links": links,
        "drives": drives,
    }


def write_c_values(
    values: RobotValues, *, comments: Sequence[str] = (), precision: str = "double", name: str | None = None
) -> str:
    """Return the header, with `comments` fit for C at its head; names begin with `name`, or as the library's.

    `precision` is the type of the numbers.
    """
    prefix, library = name or values.prefix, values.prefix.upper()
    macro, vectors = prefix.upper(), [vector for vector in values.vectors if vector.rows]
    lines = [
        f"/** The model that these numbers belong to: {values.prefix}_signature() must be the same. */",
        f'#define {macro}_VALUES_SIGNATURE "{values.signature}"',
    ]
    # Where the library's header was included before, the number of parameters is checked.
    names = {"beta": "BETA", "f": "FRICTION"}
    counts = [(names[vector.name], len(vector.rows)) for vector in vectors if vector.name in names]
    if counts:
        terms = " && ".join(f"{library}_{size} == {count}" for size, count in counts)
        lines += ["", f"#ifdef {library}_H"]
        lines.append("/* This does not compile where the library has other parameters. */")
        lines += [f"typedef char {prefix}_values_fit[({terms}) ? 1 : -1];", "#endif"]
    for vector in vectors:
        vector_name = _to_identifier(vector.name)
        places = [_to_identifier(row.name) for row in vector.rows]
        lines.append("")
        for index, entry in enumerate(places):
            place = entry if places.count(entry) == 1 else f"{entry}_{index}"
            lines.append(f"#define {macro}_{vector_name.upper()}_{place} {index}")
        lines += ["", f"/** {vector.title}. */"]
        lines.append(f"static const {precision} {prefix}_{vector_name}[{len(vector.rows)}] = {{")
        end = "F" if precision == "float" else ""
        texts = [f"{float(row.value or 0.0) + 0.0!r}{end}," for row in vector.rows]
        width = max(map(len, texts))
        for index, (row, text) in enumerate(zip(vector.rows, texts, strict=True)):
            lines.append(f"    {text:<{width}} /* [{index}] {_describe(row)} */")
        lines.append("};")
    guard, digest = f"{macro}_VALUES_H", f"0x{zlib.crc32(chr(10).join(lines).encode()):08x}"
    head = [
        "/**",
        f" * @file {prefix}_values.h",
        f" * @brief Parameters of {values.robot}, SI units, for the library {values.prefix}.",
        *(f" * {text}" for text in ("", *comments)),
        " */",
        f"#if defined {guard} && {guard} != {digest}",
        f'#error "other values are called {prefix} too: export one of them with --name"',
        "#endif",
        f"#ifndef {guard}",
        f"#define {guard} {digest}",
        "",
    ]
    return "\n".join((*[line.rstrip() for line in (*head, *lines)], "", "#endif", ""))


def _to_identifier(name: str) -> str:
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _describe(row: ValueRow) -> str:
    text = row.name if row.expression in ("", row.name) else f"{row.name} = {row.expression}"
    text += f", {row.unit}"
    if row.value is None:
        return f"{text}; unknown, left at 0"
    if row.identified is not None and abs(row.identified - row.value) > 1e-12 * abs(row.value):
        text += f"; identified as {row.identified:.9g}"
    if row.std is not None:
        percent = f" ({100 * row.std / abs(row.value):.2g} %)" if row.value else ""
        text += f"; std {row.std:.3g}{percent}"
    return text


@dataclass(frozen=True, slots=True, kw_only=True)
class TableColumns:
    """Which columns to read: their names, None where they are to be guessed.

    `percent`: whether deviations are in percent of the value; None: by the name of their column.
    """

    name: str | None = None
    value: str | None = None
    deviation: str | None = None
    percent: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow(Generic[N]):
    """A line of the table: the name as it is written and as it was read, value and deviation."""

    line: int
    text: str
    name: N
    value: float
    deviation: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedTable(Generic[N]):
    """The rows, the columns they were read from, and number and name of lines without a value."""

    columns: TableColumns
    rows: tuple[TableRow[N], ...]
    empty: tuple[tuple[int, str], ...]


def read_value_table(path: Path, columns: TableColumns, read_name: Callable[[str], N]) -> PublishedTable[N]:
    """Return the table at `path` from these columns; a UsageError if one is missing, or several may be meant.

    `read_name` returns the meaning of a name; its UsageError is reported with its line. An EstimateError has
    all mistakes in the file.
    """
    file = str(path)
    (first, heading), lines = _read_lines(path)
    text = "no line has a value; write one line a parameter below the line of column names"
    nothing = Notice(code="table.no-rows", text=text, file=file, line=first)
    if not lines:
        raise EstimateError(nothing)
    chosen = _choose_columns(file, heading, lines, columns)
    notices: list[Notice] = []
    rows: list[TableRow[N]] = []
    empty: list[tuple[int, str]] = []
    known: dict[str, int] = {}
    for number, cells in lines:
        wrong: list[Notice] = []
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(heading):
            text = f"{len(cells)} cells, but the first line names {len(heading)} columns"
            notices.append(Notice(code="table.line-length", text=text, file=file, line=number))
            continue
        row = {column: cell.strip() for column, cell in zip(heading, cells, strict=True)}
        keys = (chosen.name, chosen.value, chosen.deviation)
        text, raw, shown = ("" if key is None else row[key] for key in keys)
        name = None
        try:
            name = read_name(text)
        except UsageError as error:
            wrong += error.notices
        value = _read_number(str(chosen.value), raw, wrong) if raw else None
        deviation = _read_number(str(chosen.deviation), shown, wrong) if raw and shown else None
        if deviation is not None and deviation < 0.0:
            words = f"column {chosen.deviation!r}: {shown!r} is negative"
            wrong.append(Notice(code="table.not-a-number", text=words))
        if name is None or value is None:
            empty.append((number, text))
        else:
            if deviation is not None and chosen.percent:
                # A part of zero is zero, and is no bound of a rounded value.
                deviation = deviation * abs(value) / 100.0 if value else None
            rows.append(TableRow(line=number, text=text, name=name, value=value, deviation=deviation))
            before = known.setdefault("".join(text.split()), number)
            if before != number:
                text = f"{text!r} is already in line {before}"
                wrong.append(Notice(code="table.repeated", text=text))
        notices += [replace(notice, file=file, line=number) for notice in wrong]
    if notices or not rows:
        raise EstimateError(*(sort_notices(notices) or (nothing,)))
    return PublishedTable(columns=chosen, rows=tuple(rows), empty=tuple(empty))


def _read_lines(path: Path) -> tuple[_Line, list[_Line]]:
    """Return the line of column names, and those below it that hold more than a comment."""
    try:
        text = read_text_file(path, noun="table").replace("\r\n", "\n")
    except RobotError as error:
        raise EstimateError(*(replace(entry, code="table.unreadable") for entry in error.notices)) from error
    lines = [
        (number, line)
        for number, line in enumerate(text.split("\n"), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    separator = max((",", ";", "\t"), key=lines[0][1].count) if lines else ","
    found: list[_Line] = []
    for number, line in lines:
        try:
            found.append((number, next(csv.reader([line], delimiter=separator, skipinitialspace=True))))
        except csv.Error as error:
            text = f"this is no line of a table: {error}"
            notice = Notice(code="table.unreadable", text=text, file=str(path), line=number)
            raise EstimateError(notice) from error
    first, heading = (found[0][0], [cell.strip() for cell in found[0][1]]) if found else (1, [])
    twice = [name for name in dict.fromkeys(heading) if heading.count(name) > 1]
    problem = ""
    if not found:
        problem = "empty; the first line names the columns, as in: parameter,value,std"
    elif any(_to_number(cell) is not None for cell in heading):
        problem = "the first line holds a number; it must name the columns, as in: parameter,value,std"
    elif twice:
        problem = f"there is more than one column {', '.join(map(repr, twice))}; column names must differ"
    if problem:
        raise EstimateError(Notice(code="table.header", text=problem, file=str(path), line=first))
    return (first, heading), found[1:]


def _choose_columns(file: str, heading: _Names, rows: Sequence[_Line], columns: TableColumns) -> TableColumns:
    """Return the columns to read, with those that were left open guessed."""
    # A column of cells that were meant as numbers is not skipped.
    found = ([cells[place] for _, cells in rows if place < len(cells)] for place in range(len(heading)))
    numeric = [
        name
        for name, cells in zip(heading, found, strict=True)
        if any(
            _to_number(cell) is not None or _NUMBER_LIKE.fullmatch(cell.replace(_MINUS, "-").strip())
            for cell in cells
        )
    ]
    # In lower case, with _ between words.
    words = {entry: re.sub(r"[ \-\[(]", "_", entry.strip().lower()) for entry in heading}
    names = [name for name in heading if words[name] in _NAMES]
    names = names or [name for name in heading if name not in numeric]
    name = _choose_column(file, "--name", columns.name, heading, names)
    marked = [entry for entry in heading if any(mark in words[entry] for mark in _PERCENT)]
    meant = [entry for entry in heading if not _DEVIATIONS.isdisjoint(words[entry].split("_"))]
    spreads = [entry for entry in numeric if entry != name and entry in (*marked, *meant)]
    values = [entry for entry in numeric if entry not in (name, *spreads, columns.deviation)]
    likely = [entry for entry in values if words[entry] in _VALUES] or values
    value = _choose_column(file, "--value", columns.value, heading, likely)
    beside = [entry for entry in spreads if words[entry].startswith(words[value])]
    # A deviation that belongs to another column of values is not that of this one.
    free = [entry for entry in spreads if not any(words[entry].startswith(words[v]) for v in values)]
    likely = [entry for entry in (beside or free) if entry != value]
    deviation, percent = columns.deviation, columns.percent
    if deviation is not None or likely:
        deviation = _choose_column(file, "--deviation", deviation, heading, likely)
    if deviation is not None and percent is None:
        percent = deviation in marked
        if not percent and {"rel", "relative"} & set(words[deviation].split("_")):
            text = f"column {deviation!r} is relative, without its reference; give --deviation-unit"
            raise UsageError(Notice(code="usage.table-column", text=text, file=file))
    return TableColumns(name=name, value=value, deviation=deviation, percent=bool(percent))


def _choose_column(file: str, option: str, given: str | None, heading: _Names, likely: _Names) -> str:
    if given in heading or (given is None and len(likely) == 1):
        return likely[0] if given is None else given
    text = f"{option} {given}: there is no such column; the table has {', '.join(heading)}"
    if given is None:
        which = f"could be any of {', '.join(likely)}" if likely else f"is none of {', '.join(heading)}"
        text = f"the column for {option} {which}; name it by {option} COLUMN"
    raise UsageError(Notice(code="usage.table-column", text=text, file=file))


def _to_number(text: str) -> float | None:
    # Python reads 1_000 as a number, no other program does.
    try:
        number = float(text.replace(_MINUS, "-")) if "_" not in text else math.nan
    except ValueError:
        return None
    return number if abs(number) <= _LARGEST else None


def _read_number(column: str, text: str, notices: list[Notice]) -> float | None:
    number = _to_number(text)
    if number is None:
        sign = ", with percent in the name of the column" if "%" in text else ""
        what = f"is not a number up to 1e100 (a decimal point is expected{sign})"
        notices.append(Notice(code="table.not-a-number", text=f"column {column!r}: {text!r} {what}"))
    return number
