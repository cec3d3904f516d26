"""Log files: columns read from text, NumPy, MATLAB and HDF5 files, and logs written as .npz or .csv.

Path -> RawLog: columns as they stand in the file, with the units that the file states.
Recording, Robot -> file that `read_recording` reads without a `[log]` map; RawLog -> file. Files are
written whole or not at all; the same log gives the same bytes.

    .csv .txt     comma, semicolon or tab between columns; the heading names columns and may state units:
                  `t [s],q1 [rad],tau1 [N m]`; lines that start with # are skipped, an empty cell is NaN,
                  columns of words are passed over. Not supported: a decimal comma, files without a heading.
    .npz          arrays of real numbers, (N,) or (N, k); an array of texts named `units` may state units:
                  `["t [s]", "q [rad]"]`. Not supported: pickled objects, which could run code when loaded.
    .mat          version 4 and 5 to 7.2; a field of a structure is the column `structure.field`; version 7.3
                  is HDF5. Not supported: cells, tables, complex numbers.
    .h5 .hdf5     a data set of a group, or a field of a structure, is the column `group.name`; its attribute
                  `unit` or `units` states its unit. MATLAB stores arrays with their axes in reverse; its
                  files say so by attributes, and are turned. Needs h5py, the extra `hdf5`. Not supported:
                  compound types, external links, cells and tables of MATLAB.

Written are time, position, torque, and velocity, second encoder and the controller's reference where
there are such, in SI units with the units stated. Extras are not written; they belong to the file they
were read from.
"""

import csv
import io
import re
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.environment import check_suffix, write_file
from symid.errors import LogError, Notice, OutputError
from symid.logs.recording import Recording
from symid.notation import get_unit
from symid.robot import JointKind, Robot

_INDEX = re.compile(r"\S\[\d+\]$")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawLog:
    """Numeric columns by name, (N,) or (N, k), with the units that the file itself states.

    `others` are the names of what is in the file and is not a column of real numbers; `line` is the line of
    the file that names the columns, 0 where there is none.
    """

    columns: Mapping[str, FloatArray]
    units: Mapping[str, str] = field(default_factory=dict)
    others: tuple[str, ...] = ()
    line: int = 0


def convert_column(values: object) -> FloatArray | None:
    """Return a column as float64 with axes of length one squeezed, or None if it is not of real numbers."""
    array = np.asarray(values)
    if array.dtype.kind not in "biuf" or not 0 <= array.ndim <= 2:
        return None
    # A MATLAB column is (N, 1), a row (1, N): both are one column.
    if array.ndim == 2 and 1 in array.shape:
        array = array.reshape(-1)
    return freeze(array)


def _build_raw_log(entries: Iterable[tuple[str, object]], units: Mapping[str, str]) -> RawLog:
    """Return what is a column of real numbers, and the names of what is none."""
    columns = {name: convert_column(value) for name, value in entries}
    return RawLog(
        columns={name: column for name, column in columns.items() if column is not None},
        units=units,
        others=tuple(name for name, column in columns.items() if column is None),
    )


def split_heading(heading: str) -> tuple[str, str | None]:
    """Return name and unit of a heading such as `tau1 [N m]`; the unit is None where none is stated.

    A number in brackets right after a name, as in `q[0]`, is part of the name.
    """
    text = heading.strip()
    if text.endswith("]") and "[" in text and not _INDEX.search(text):
        name, _, unit = text[:-1].rpartition("[")
        return name.strip(), unit.strip()
    return text, None


def refuse_file(path: str, text: str, code: str = "log.unreadable") -> LogError:
    """Return the error for a file that cannot be read at all."""
    return LogError(Notice(code=code, text=text, file=path))


_SEPARATORS = ",;\t"
_MOST_LISTED = 5
_LOOKED_AT = 20
_QUOTES = ("[", "(", "/", "'", '"')

TableLines = list[tuple[int, list[str]]]
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
    texts = _list_text_columns(names, lines[1:])
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


def _list_text_columns(names: list[str], lines: TableLines) -> tuple[str, ...]:
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


def _read_lines(path: Path) -> TableLines:
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


def _check_separator(file: str, lines: TableLines) -> None:
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
    file: str, names: list[str], lines: TableLines
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
        problems = _list_bad_cells(file, names, lines)
    if not problems:
        try:
            return np.array([cells for _, cells in lines], dtype=np.float64).reshape(len(lines), len(names))
        except ValueError:
            problems = _list_bad_cells(file, names, lines)
            if not problems:
                filled = [[cell.strip() or "nan" for cell in cells] for _, cells in lines]
                return np.array(filled, dtype=np.float64)
    told = problems[:_MOST_LISTED]
    if len(problems) > len(told):
        text = f"{len(problems) - len(told)} more lines or cells like these"
        told.append(Notice(code="log.more", text=text, file=file))
    raise LogError(*told)


def _list_bad_cells(file: str, names: list[str], lines: TableLines) -> list[Notice]:
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


UNITS_ARRAY = "units"
"""Name of the array that states units."""

_NPY_MAGIC = b"\x93NUMPY"


def read_npz(path: Path) -> RawLog:
    """Return the columns of the NumPy archive at `path`.

    Raises:
        LogError: the file is not a NumPy archive.
    """
    try:
        # A stream of our own: numpy leaves a file open when it is no archive.
        with path.open("rb") as stream:
            if not zipfile.is_zipfile(stream) and stream.seek(0) == 0 and stream.read(6) != _NPY_MAGIC:
                text = "this is not a NumPy archive: archives are written by numpy.savez"
                raise refuse_file(str(path), text, "log.format")
            stream.seek(0)
            archive = np.load(stream, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                text = "this is a single array (.npy), not an archive (.npz)"
                raise refuse_file(str(path), text, "log.format")
            content = {name: _load_array(archive, name) for name in archive.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        text = f"this is not a NumPy archive that can be read: {error}"
        raise refuse_file(str(path), text, "log.format") from error
    stated = content.pop(UNITS_ARRAY, None)
    units = {}
    if isinstance(stated, np.ndarray) and stated.dtype.kind == "U":
        units = {
            name: unit for name, unit in map(split_heading, stated.reshape(-1).tolist()) if unit is not None
        }
    return _build_raw_log(content.items(), units)


def _load_array(archive: "np.lib.npyio.NpzFile", name: str) -> object:
    try:
        return archive[name]
    except ValueError:  # an array of objects; it is reported as no column of numbers
        return None


_MATLAB_CLASS = "MATLAB_class"
_MATLAB_NUMBERS = frozenset(
    ("double", "single", "logical", *(f"{sign}int{size}" for sign in ("", "u") for size in (8, 16, 32, 64)))
)
_UNIT_ATTRIBUTES = ("unit", "units")


def read_hdf5(path: Path) -> RawLog:
    """Return the columns of the HDF5 file at `path`.

    Raises:
        LogError: h5py is not installed, or the file is not HDF5 that can be read.
    """
    try:
        import h5py
    except ImportError as error:
        text = (
            "this is an HDF5 file (MATLAB 7.3 files are), which needs h5py: install it as the extra hdf5, "
            "pip install 'symid[hdf5]', or save the log as .npz, .csv or with save(..., '-v7')"
        )
        raise refuse_file(str(path), text, "log.needs-hdf5") from error
    entries: list[tuple[str, object]] = []
    units = {}
    try:
        with h5py.File(path, "r") as file:
            for name, data in _walk_data_sets(h5py, file):
                entries.append((name, _load_data_set(data)))
                texts = (_decode_text(data.attrs.get(key)) for key in _UNIT_ATTRIBUTES)
                unit = next((text for text in texts if text), None)
                if unit:
                    units[name] = unit
    # h5py raises any of these on a damaged file, according to where the damage lies.
    except (OSError, ValueError, TypeError, KeyError, RuntimeError) as error:
        text = f"this is not an HDF5 file that can be read: {error}"
        raise refuse_file(str(path), text, "log.format") from error
    return _build_raw_log(entries, units)


def _walk_data_sets(h5py: Any, group: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:  # noqa: ANN401  h5py has no types
    """Return every data set below `group`, by name; what MATLAB keeps for itself is passed over."""
    for name in sorted(group):
        if name.startswith("#"):
            continue
        entry = group.get(name)
        if isinstance(entry, h5py.Group):
            yield from _walk_data_sets(h5py, entry, f"{prefix}{name}.")
        elif isinstance(entry, h5py.Dataset):
            yield prefix + name, entry


def _load_data_set(data: Any) -> object:  # noqa: ANN401  h5py has no types
    """Return the numbers of a data set as an array with time first; None where it holds something else."""
    kind = _decode_text(data.attrs.get(_MATLAB_CLASS))
    if kind is not None and (kind not in _MATLAB_NUMBERS or "MATLAB_empty" in data.attrs):
        return None
    if data.dtype.kind not in "biuf" or data.ndim > 2:
        return None
    values = np.asarray(data[()])
    return values.T if kind is not None else values


def _decode_text(value: object) -> str | None:
    if isinstance(value, bytes | np.bytes_):
        return bytes(value).decode("utf-8", "replace")
    return str(value) if isinstance(value, str) else None


_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"


def read_mat(path: Path) -> RawLog:
    """Return the columns of the MATLAB file at `path`.

    Raises:
        LogError: the file is not a MAT file that can be read.
    """
    with path.open("rb") as stream:
        head = stream.read(520)
    if _HDF5_MAGIC in head:
        return read_hdf5(path)
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = loadmat(str(path), struct_as_record=True)
    # SciPy raises any of these on a damaged file, according to where the damage lies.
    except (MatReadError, ValueError, TypeError, NotImplementedError, OSError, KeyError, zlib.error) as error:
        text = f"this is not a MATLAB file that can be read: {error}"
        raise refuse_file(str(path), text, "log.format") from error
    return _build_raw_log(_flatten_structures(content), {})


def _flatten_structures(content: dict[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in content.items():
        if name.startswith("__"):
            continue
        full = prefix + name
        if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
            record = value.reshape(-1)[0]
            yield from _flatten_structures({field: record[field] for field in value.dtype.names}, f"{full}.")
        else:
            yield full, value


_LIKE = {"link_position": "q", "q_ref": "q", "dq_ref": "dq", "tau_ff": "tau"}
"""Columns that have the units of others."""


def write_recording(recording: Recording, path: Path, robot: Robot) -> Path:
    """Write the recording to `path` (.npz or .csv), in place of an older file; return the path.

    Raises:
        OutputError: the suffix is another one, or the folder cannot be written.
    """
    writers = {".npz": _write_npz, ".csv": _write_csv}
    writer = writers[check_suffix(path, "a log", writers)]
    return write_file(path, lambda stream: writer(stream, recording, robot), what="the log", with_folder=True)


def write_raw_log(raw: RawLog, path: Path) -> Path:
    """Write columns as they were logged, with their names and units, to `path` (.npz or .csv).

    Raises:
        OutputError: the suffix is another one, a column does not fit into a line of a .csv, or the folder
            cannot be written.
    """
    writers = {".npz": _write_raw_npz, ".csv": _write_raw_csv}
    writer = writers[check_suffix(path, "a log", writers)]
    shapes = {values.shape for values in raw.columns.values()}
    if writer is _write_raw_csv and (len(shapes) > 1 or any(len(shape) > 1 for shape in shapes)):
        text = "a .csv holds columns of one number a sample; this log has arrays or columns of other lengths"
        raise OutputError(Notice(code="output.no-table", text=f"{text}: write it as .npz", file=str(path)))
    return write_file(path, lambda stream: writer(stream, raw), what="the log", with_folder=True)


def _list_channels(recording: Recording) -> list[tuple[str, FloatArray]]:
    found = [("q", recording.position), ("tau", recording.torque)]
    if recording.velocity is not None:
        found.insert(1, ("dq", recording.velocity))
    if recording.motor_position is not None:
        found.append(("theta", recording.motor_position))
    for name, values in (
        ("link_position", recording.link_position),
        ("q_ref", recording.reference),
        ("dq_ref", recording.reference_velocity),
        ("tau_ff", recording.feedforward),
    ):
        if values is not None:
            found.append((name, values))
    return found


def _list_units(name: str, robot: Robot) -> tuple[str, ...]:
    name = _LIKE.get(name, name)
    return tuple(get_unit(name, prismatic=joint.kind is JointKind.PRISMATIC) for joint in robot.axes)


def _write_npz(stream: IO[bytes], recording: Recording, robot: Robot) -> None:
    arrays: dict[str, np.ndarray] = {"t": recording.time}
    headings = ["t [s]"]
    for name, values in _list_channels(recording):
        arrays[name] = values
        units = set(_list_units(name, robot))
        headings.append(f"{name} [{units.pop() if len(units) == 1 else 'SI'}]")
    arrays[UNITS_ARRAY] = np.array(headings)
    # Arrays go one by one: savez dates its members, and the same recording must give the same bytes.
    _write_archive(stream, arrays)


def _write_raw_npz(stream: IO[bytes], raw: RawLog) -> None:
    arrays: dict[str, np.ndarray] = dict(raw.columns)
    if raw.units:
        arrays[UNITS_ARRAY] = np.array([f"{name} [{unit}]" for name, unit in raw.units.items()])
    _write_archive(stream, arrays)


def _write_raw_csv(stream: IO[bytes], raw: RawLog) -> None:
    headings = [f"{name} [{raw.units[name]}]" if name in raw.units else name for name in raw.columns]
    _write_table(stream, headings, np.stack(list(raw.columns.values()), axis=1))


def _write_archive(stream: IO[bytes], arrays: dict[str, np.ndarray]) -> None:
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in arrays.items():
            member = zipfile.ZipInfo(f"{name}.npy")
            member.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(member, "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.ascontiguousarray(values), allow_pickle=False)


def _write_csv(stream: IO[bytes], recording: Recording, robot: Robot) -> None:
    headings, columns = ["t [s]"], [recording.time[:, None]]
    for name, values in _list_channels(recording):
        units = _list_units(name, robot)
        headings += [f"{name}{number} [{unit}]" for number, unit in enumerate(units, 1)]
        columns.append(values)
    _write_table(stream, headings, np.hstack(columns))


def _write_table(stream: IO[bytes], headings: list[str], values: FloatArray) -> None:
    with io.TextIOWrapper(stream, encoding="utf-8", newline="", write_through=True) as text:
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(headings)
        writer.writerows([repr(value) for value in row] for row in values.tolist())
