"""Columns of a text file with a heading line.

Input: a path. Output: `RawLog`. The heading names the columns and may state units:
`t [s],q1 [rad],tau1 [N m]`.

Supported: comma, semicolon or tab between columns; lines that start with # are skipped; an
empty cell is a missing number (NaN); columns of words are passed over.
Not supported: a decimal comma, files without a heading.
"""

import csv
from pathlib import Path

import numpy as np

from symid.data.table import RawLog, refuse_file, split_heading
from symid.errors import LogError, Notice

__all__ = ["read_csv"]

_SEPARATORS = ",;\t"
_MOST_TOLD = 5
_LOOKED_AT = 20
_QUOTES = ("[", "(", "/", "'", '"')

Cells = list[tuple[int, list[str]]]
"""Lines of a table: number in the file, counted from one, and cells."""


def read_csv(path: Path) -> RawLog:
    """Return the columns of the text file at `path`.

    Raises:
        LogError: no text, no heading, lines of unequal length, cells that are not numbers (all of them said).
    """
    lines = _read_lines(path)
    if not lines:
        raise refuse_file(str(path), "the file holds no line with column names", "log.format")
    headings = [split_heading(cell) for cell in lines[0][1]]
    names = [name for name, _ in headings]
    _check_separator(str(path), lines)
    _check_heading(str(path), lines[0][0], names)
    texts = _find_texts(names, lines[1:])
    kept = [index for index, name in enumerate(names) if name not in texts]
    if texts:
        lines = [lines[0], *((number, [cells[index] for index in kept]) for number, cells in lines[1:])]
    values = _read_numbers(str(path), [names[index] for index in kept], lines[1:])
    return RawLog(
        columns={names[index]: np.ascontiguousarray(values[:, place]) for place, index in enumerate(kept)},
        units={name: unit for name, unit in headings if unit is not None and name not in texts},
        others=texts,
        line=lines[0][0],
    )


def _find_texts(names: list[str], lines: Cells) -> tuple[str, ...]:
    """Return the columns of words, as of frames: no number in the first lines, nor meant as one."""
    first = lines[:_LOOKED_AT]
    if not first or any(len(cells) != len(names) for _, cells in lines):
        return ()
    words = [
        name
        for index, name in enumerate(names)
        if all(cells[index].strip()[:1].isalpha() and not _is_number(cells[index]) for _, cells in first)
        or all(cells[index].strip()[:1] in _QUOTES for _, cells in first)
    ]
    return tuple(words) if len(words) < len(names) else ()


def _read_lines(path: Path) -> Cells:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (UnicodeDecodeError, OSError) as error:
        raise refuse_file(
            str(path), f"this is not a text file that can be read: {error}", "log.format"
        ) from error
    kept = [
        (number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"
    ]
    if not kept:
        return []
    separator = max(_SEPARATORS, key=kept[0][1].count)
    cells = csv.reader((line for _, line in kept), delimiter=separator, skipinitialspace=True)
    try:
        return [(number, row) for (number, _), row in zip(kept, cells, strict=False)]
    except csv.Error as error:
        text = f"this is not a table that can be read: {error}"
        raise refuse_file(str(path), text, "log.format") from error


def _check_separator(file: str, lines: Cells) -> None:
    """Refuse a table whose columns stand apart by spaces alone: names hold spaces too."""
    first = lines[1][1] if len(lines) > 1 else [""]
    parts = first[0].split() if len(first) == 1 else []
    if len(lines[0][1]) == 1 and len(parts) > 1 and all(map(_is_number, parts)):
        text = "the columns are separated by spaces; separate names and numbers by commas, semicolons or tabs"
        raise LogError(Notice(code="log.separator", text=text, file=file, line=lines[0][0]))


def _check_heading(file: str, line: int, names: list[str]) -> None:
    if all(_is_number(name) for name in names):
        text = "the first line holds numbers; it must name the columns, as in: t [s],q1 [rad],tau1 [N m]"
        raise LogError(Notice(code="log.no-heading", text=text, file=file, line=line))
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        text = f"column names must differ; there is more than one {', '.join(map(repr, twice))}"
        raise LogError(Notice(code="log.duplicate-column", text=text, file=file, line=line))


def _read_numbers(
    file: str, names: list[str], lines: Cells
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    problems = [
        Notice(
            code="log.line-length",
            text=f"{len(cells)} cells, the heading names {len(names)} columns",
            file=file,
            line=number,
        )
        for number, cells in lines
        if len(cells) != len(names)
    ]
    # Python and numpy read 1_000 as a number, no other program does.
    if not problems and any("_" in cell for _, cells in lines for cell in cells):
        problems = _find_bad_cells(file, names, lines)
    if not problems:
        try:
            return np.array([cells for _, cells in lines], dtype=np.float64).reshape(len(lines), len(names))
        except ValueError:
            problems = _find_bad_cells(file, names, lines)
            if not problems:
                filled = [[cell.strip() or "nan" for cell in cells] for _, cells in lines]
                return np.array(filled, dtype=np.float64)
    told = problems[:_MOST_TOLD]
    if len(problems) > len(told):
        text = f"{len(problems) - len(told)} more lines or cells like these"
        told.append(Notice(code="log.more", text=text, file=file))
    raise LogError(*told)


def _find_bad_cells(file: str, names: list[str], lines: Cells) -> list[Notice]:
    return [
        Notice(
            code="log.not-a-number",
            text=f"column {name!r}: {cell!r} is not a number (a decimal point is wanted)",
            file=file,
            line=number,
        )
        for number, cells in lines
        for name, cell in zip(names, cells, strict=True)
        if cell.strip() and not _is_number(cell)
    ]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
