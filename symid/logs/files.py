"""Log files: columns of NumPy, MATLAB, HDF5 and Parquet files, and logs written as .npz or .csv.

Path -> RawLog; Recording or RawLog -> file, written whole or not at all, the same bytes for the same log.

    .npz          arrays of real numbers, (N,) or (N, k); an array of texts named `units` may state units:
                  `["t [s]", "q [rad]"]`. Not supported: pickled objects, which could run code when loaded.
    .mat          version 4 and 5 to 7.2; a field of a structure is the column `structure.field`; version 7.3
                  is HDF5. Not supported: cells, tables, complex numbers.
    .h5 .hdf5     data sets and fields are columns `group.name`, with units in an attribute `unit` or `units`.
                  Needs h5py, the extra `hdf5`. Not supported: compound types, external links, MATLAB cells.
    .parquet      columns of numbers, times, lists of one length; fields of a structure as `structure.field`;
                  units of times are those of their types, of others in the metadata of a column, `unit` or
                  `units`, else in its name as in a heading; null is NaN. Needs pyarrow, the extra `parquet`.
                  Not supported: dates without a time, dictionaries.
"""

import csv
import io
import math
import re
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.environment import check_suffix, write_file
from symid.errors import LogError, Notice, OutputError
from symid.logs.recording import Recording
from symid.notation import get_unit
from symid.robot import Robot

_INDEX = re.compile(r"\S\[\d+\]$")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawLog:
    """Numeric columns by name, (N,) or (N, k), with the units that the file itself states.

    Args:
        others: names of what is no column of real numbers.
        line: line of the file that names the columns, 0 where there is none.
        notices: what was done to read them.
    """

    columns: Mapping[str, FloatArray]
    units: Mapping[str, str] = field(default_factory=dict)
    others: tuple[str, ...] = ()
    line: int = 0
    notices: tuple[Notice, ...] = ()


LARGEST_ARRAY, LARGEST_LOG = 10**9, 4 * 10**9
"""Bytes of an array, and of all arrays of a log, that are read: 39 hours of a number at 900 Hz."""


_UNPACKED, _RATIO = 400_000_000, 20
"""Bytes that any file may unpack to, and times its size that it may: motions pack to a third at best."""


def check_unpacked(path: Path, unpacked: float) -> None:
    """Refuse a file that unpacks to far more than it holds, before it does."""
    most = min(LARGEST_LOG, max(_UNPACKED, _RATIO * path.stat().st_size))
    if unpacked > most:
        text = f"the log unpacks to more than {most / 1e9:.3g} GB; cut it into several, or save it not packed"
        raise build_file_error(path, text, "log.too-large")


MOST_COLUMNS = 10_000
"""Columns of a log: of seven joints with every derivative 100 times as many as there are."""


def check_width(path: Path, columns: int) -> None:
    """Refuse a log with more columns than any has."""
    if columns > MOST_COLUMNS:
        text = f"the log has more than {MOST_COLUMNS} columns; if it has a row a quantity, transpose it"
        raise build_file_error(path, text, "log.too-large")


def _build_raw_log(path: Path, entries: Iterable[tuple[str, object]], units: Mapping[str, str]) -> RawLog:
    """Return the columns of real numbers as float64, and the names of everything else."""
    columns: dict[str, FloatArray] = {}
    others: dict[str, None] = {}
    large: dict[str, int] = {}
    unpacked = 0
    for name, values in entries:
        check_width(path, len(columns) + len(others))
        # In place of an array that is too large to be read stands its size in bytes.
        if isinstance(values, int):
            others[name], large[name] = None, values
            continue
        array = np.asarray(values)
        # Arrays of the reader's own need no copy; NumPy's reader has a view of them.
        for part in (array.base, array):
            if isinstance(part, np.ndarray):
                part.setflags(write=False)
        if array.dtype.kind not in "biuf" or not 0 <= array.ndim <= 2:
            others[name] = None
            continue
        # A MATLAB column is (N, 1), a row (1, N): both are one column.
        columns[name] = freeze(array.reshape(-1) if array.ndim == 2 and 1 in array.shape else array)
        unpacked += columns[name].nbytes
        check_unpacked(path, unpacked)
    notices = []
    if large:
        names = ", ".join(f"{name!r} ({size / 1e9:.3g} GB)" for name, size in large.items())
        text = f"not read, for an array may have {LARGEST_ARRAY / 1e9:.3g} GB: {names}; cut the log"
        notices.append(Notice(code="log.too-large", text=text, file=str(path)))
    return RawLog(columns=columns, units=units, others=tuple(others), notices=tuple(notices))


def split_heading(heading: str) -> tuple[str, str | None]:
    """Return name and unit, None if not stated, of a heading such as `tau1 [N m]`; `q[0]` is a name."""
    text = heading.strip()
    if text.endswith("]") and "[" in text and not _INDEX.search(text):
        name, _, unit = text[:-1].rpartition("[")
        return name.strip(), unit.strip()
    return text, None


def build_file_error(path: Path, text: str, code: str = "log.format") -> LogError:
    """Return the error for a file that cannot be read at all."""
    return LogError(Notice(code=code, text=text, file=str(path)))


UNITS_ARRAY = "units"
"""Name of the array that states units."""
SIMULATED = "simulated"
"""Column of a simulated log, whose unit is the signature of the values it was made from."""

_NPY_MAGIC = b"\x93NUMPY"


def read_npz(path: Path) -> RawLog:
    """Return the columns of a NumPy archive, or raise a LogError."""
    content: dict[str, object] = {}
    try:
        # A stream of our own: numpy leaves a file open when it is no archive.
        with path.open("rb") as stream:
            if not zipfile.is_zipfile(stream) and stream.seek(0) == 0 and stream.read(6) != _NPY_MAGIC:
                raise build_file_error(path, "this is not a NumPy archive, as numpy.savez writes it")
            stream.seek(0)
            archive = np.load(stream, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise build_file_error(path, "this is a single array (.npy), not a NumPy archive (.npz)")
            check_width(path, len(archive.files))
            unpacked = 0
            for name in archive.files:
                size = _measure_member(archive, name)
                unpacked += size if size <= LARGEST_ARRAY else 0
                check_unpacked(path, unpacked)
                try:
                    content[name] = size if size > LARGEST_ARRAY else archive[name]
                except ValueError:  # an array of objects; it is reported as no column of numbers
                    content[name] = None
    # NumPy and zipfile raise any of these on a damaged file, according to where the damage lies.
    except (*_DAMAGED, EOFError, zipfile.BadZipFile, zlib.error, SyntaxError, tokenize.TokenError) as error:
        raise build_file_error(path, f"this is not a NumPy archive that can be read: {error}") from error
    stated, units = content.pop(UNITS_ARRAY, None), {}
    if isinstance(stated, np.ndarray) and stated.dtype.kind == "U":
        pairs = map(split_heading, stated.reshape(-1).tolist())
        units = {name: unit for name, unit in pairs if unit is not None}
    return _build_raw_log(path, content.items(), units)


_DAMAGED = (
    *(OSError, ValueError, TypeError, KeyError, IndexError, AttributeError, RuntimeError, OverflowError),
    *(MemoryError, struct.error),
)


def _measure_member(archive: Any, name: str) -> int:  # noqa: ANN401  numpy keeps the type for itself
    """Return how many bytes an array of an archive has in memory; 0 where it is none."""
    members = archive.zip.namelist()
    member = name if name in members else f"{name}.npy"
    with archive.zip.open(member) as stream:
        if stream.read(len(_NPY_MAGIC)) != _NPY_MAGIC:
            return int(archive.zip.getinfo(member).file_size)
        first = stream.read(2)[:1] == b"\x01"
        read = np.lib.format.read_array_header_1_0 if first else np.lib.format.read_array_header_2_0
        try:
            shape, _, kind = read(stream)
        except ValueError:
            return 0
    return math.prod(shape) * max(kind.itemsize, 8)


_MATLAB_NUMBERS = frozenset(
    ("double", "single", "logical", *(f"{sign}int{size}" for sign in ("", "u") for size in (8, 16, 32, 64)))
)


def read_hdf5(path: Path) -> RawLog:
    """Return the columns of an HDF5 file, or raise a LogError, also if h5py is not installed."""
    try:
        import h5py
    except ImportError as error:
        text = "HDF5 files (MATLAB 7.3 files are such) need h5py: install it as the extra hdf5, "
        text += "pip install 'symid[hdf5]', or save the log as .npz, .csv or with save(..., '-v7')"
        raise build_file_error(path, text, "log.needs-hdf5") from error
    entries: list[tuple[str, object]] = []
    units, unpacked = {}, 0
    try:
        with h5py.File(path, "r") as file:
            for name, data in _walk_data_sets(h5py, file):
                check_width(path, len(entries))
                values = _load_data_set(data)
                entries.append((name, values))
                unpacked += values.nbytes if isinstance(values, np.ndarray) else 0
                check_unpacked(path, unpacked)
                texts = (_decode_text(data.attrs.get(key)) for key in ("unit", "units"))
                unit = next((text for text in texts if text), None)
                if unit:
                    units[name] = unit
    # h5py raises any of these on a damaged file, according to where the damage lies.
    except _DAMAGED as error:
        raise build_file_error(path, f"this is not an HDF5 file that can be read: {error}") from error
    return _build_raw_log(path, entries, units)


def _walk_data_sets(h5py: Any, group: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:  # noqa: ANN401  h5py has no types
    """Yield every data set below `group`, by name, but for those that MATLAB keeps for itself."""
    for name in sorted(group):
        if name.startswith("#"):
            continue
        entry = group.get(name)
        if isinstance(entry, h5py.Group):
            yield from _walk_data_sets(h5py, entry, f"{prefix}{name}.")
        elif isinstance(entry, h5py.Dataset):
            yield prefix + name, entry


def _load_data_set(data: Any) -> object:  # noqa: ANN401  h5py has no types
    """Return the numbers of a data set as an array with time first; None where it has something else."""
    kind = _decode_text(data.attrs.get("MATLAB_class"))
    if kind is not None and (kind not in _MATLAB_NUMBERS or "MATLAB_empty" in data.attrs):
        return None
    if data.dtype.kind not in "biuf" or data.ndim > 2:
        return None
    # Of a chunk that was never written there is only its size.
    size = math.prod(data.shape) * max(data.dtype.itemsize, 8)
    if size > LARGEST_ARRAY:
        return size
    values = np.asarray(data[()])
    return values.T if kind is not None else values


def _decode_text(value: object) -> str | None:
    if isinstance(value, bytes | np.bytes_):
        return bytes(value).decode("utf-8", "replace")
    return str(value) if isinstance(value, str) else None


def read_parquet(path: Path) -> RawLog:
    """Return the columns of a Parquet file, or raise a LogError, also if pyarrow is not installed."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        text = "Parquet files need pyarrow: install it as the extra parquet, pip install 'symid[parquet]', "
        text += "or save the log as .npz or .csv"
        raise build_file_error(path, text, "log.needs-parquet") from error
    try:
        found = parquet.read_metadata(str(path))
        check_width(path, found.num_columns)
        check_unpacked(path, 8 * found.num_rows * found.num_columns)
        table = parquet.read_table(str(path), partitioning=None)
        while any(pa.types.is_struct(entry.type) for entry in table.schema):
            table = table.flatten()
        headings = [split_heading(entry.name) for entry in table.schema]
        values = [_convert_column(pa, column.combine_chunks()) for column in table.columns]
    except (pa.ArrowException, OSError, ValueError, TypeError) as error:
        raise build_file_error(path, f"this is not a Parquet file that can be read: {error}") from error
    names = [name for name, _ in headings]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        text = f"more than one column is named {', '.join(map(repr, twice))}; give each its own name"
        raise build_file_error(path, text, "log.duplicate-column")
    units = {}
    for (name, unit), entry in zip(headings, table.schema, strict=True):
        texts = [_decode_text((entry.metadata or {}).get(key)) for key in (b"unit", b"units")]
        # The unit of a time stands in its type, whatever its name or metadata say.
        kind = getattr(entry.type, "value_type", entry.type)
        stated = next((text for text in (getattr(kind, "unit", None), *texts, unit) if text), None)
        if stated:
            units[name] = stated
    return _build_raw_log(path, zip(names, values, strict=True), units)


def _convert_column(pa: Any, column: Any) -> object:  # noqa: ANN401  pyarrow has no types
    """Return the numbers of a column, (N,) or (N, k); None where it has something else."""
    kind, types = column.type, pa.types
    if types.is_timestamp(kind) or types.is_duration(kind) or types.is_time(kind):
        column = column.cast(pa.int32() if types.is_time32(kind) else pa.int64())
    elif types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        column_of_rows = column.drop_null()
        sizes = column_of_rows.value_lengths().unique().to_pylist()
        flat = _convert_column(pa, column_of_rows.flatten())
        if len(sizes) != 1 or not sizes[0] or not isinstance(flat, np.ndarray) or flat.ndim > 1:
            return None
        rows = np.full((len(column), sizes[0]), np.nan)
        rows[np.asarray(column.is_valid())] = flat.reshape(-1, sizes[0])
        return rows
    elif not any(
        (types.is_integer(kind), types.is_floating(kind), types.is_boolean(kind), types.is_decimal(kind))
    ):
        return None
    return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False))


_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"


def read_mat(path: Path) -> RawLog:
    """Return the columns of a MATLAB file, or raise a LogError."""
    with path.open("rb") as stream:
        head = stream.read(520)
    if _HDF5_MAGIC in head:
        return _refuse_objects(path, read_hdf5(path))
    from scipy import io as matlab

    try:
        # Version 4 begins with a number of which some bytes are zero.
        if 0 not in head[:4] and not _has_matlab_elements(path.read_bytes()):
            text = "this is not a MATLAB file that can be read: its elements are damaged, or unpack to far "
            text += "more than the file holds; save it again, by save(..., '-v6')"
            raise build_file_error(path, text)
        content = matlab.loadmat(str(path), struct_as_record=True)
    # SciPy raises any of these on a damaged file, according to where the damage lies.
    except (matlab.matlab.MatReadError, zlib.error, *_DAMAGED) as error:
        reason = "an array is larger than memory" if isinstance(error, MemoryError) else error
        raise build_file_error(path, f"this is not a MATLAB file that can be read: {reason}") from error
    return _refuse_objects(path, _build_raw_log(path, _flatten_structures(content), {}))


def _refuse_objects(path: Path, raw: RawLog) -> RawLog:
    """Return a log of MATLAB, or refuse one that has objects, and no column of numbers."""
    if raw.columns or not raw.others:
        return raw
    text = f"no array or structure of numbers is in the MATLAB file, but {', '.join(map(repr, raw.others))}, "
    text += "as of a timetable, table or timeseries; save its columns: log.t = seconds(T.Time); log.q = T.q; "
    text += "save('log.mat', '-struct', 'log')"
    raise build_file_error(path, text)


_MATLAB_MATRIX, _MATLAB_COMPRESSED = 14, 15
_MATLAB_DATA = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18))
"""Types of elements that hold numbers or letters."""
_MATLAB_CELL, _MATLAB_STRUCTURE, _MATLAB_OBJECT, _MATLAB_TEXT, _MATLAB_SPARSE = range(1, 6)
_MATLAB_NUMERIC = range(6, 16)
_MATLAB_FUNCTION, _MATLAB_OPAQUE = 16, 17
"""Classes of matrices."""
_MATLAB_IS_COMPLEX = 8
_MATLAB_HEADER, _DEEPEST = 128, 100
_MATLAB_UNPACKED = 100_000_000
"""Bytes that any file may unpack to: of cells, each takes ten times as much in memory."""


def _has_matlab_elements(content: bytes) -> bool:
    """Return whether versions 5 to 7.2 have known elements: SciPy takes types as an index, and crashes."""
    order = "<" if content[126:128] == b"IM" else ">"
    room = max(_MATLAB_UNPACKED, _RATIO * len(content))
    return all(
        kind == _MATLAB_MATRIX and _is_matlab_matrix(data, order, 1)
        for kind, data in _list_matlab_elements(content[_MATLAB_HEADER:], order, room)
    )


def _list_matlab_elements(content: bytes, order: str, room: int = 0) -> Iterator[tuple[int, bytes]]:
    """Yield type and data of each element; type 0, which none has, where one is larger than what is left.

    Packed ones are unpacked where there is `room`, bytes, all together, for them.
    """
    place = 0
    while place + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, place)
        start, most = place + 8, len(content) - place - 8
        if kind >> 16:
            # Up to four bytes stand within the tag.
            kind, size, start, most = kind & 0xFFFF, kind >> 16, place + 4, 4
            place += 8
        else:
            place = start + (size if kind == _MATLAB_COMPRESSED else -(-size // 8) * 8)
        data = content[start : start + size]
        if size > most:
            yield 0, b""
        elif kind == _MATLAB_COMPRESSED and room:
            unpacked = zlib.decompressobj().decompress(data, room)
            room -= len(unpacked)
            yield from _list_matlab_elements(unpacked, order) if room > 0 else ((0, b""),)
        else:
            yield kind, data


def _is_matlab_matrix(content: bytes, order: str, depth: int) -> bool:
    """Return whether a matrix has the elements that its class must have; an empty one has none."""
    elements = list(_list_matlab_elements(content, order))
    if not elements:
        return True
    data, inner = _count_matlab_elements([entry for _, entry in elements], order)
    if len(elements) != data + inner or any(kind not in _MATLAB_DATA for kind, _ in elements[:data]):
        return False
    return depth < _DEEPEST and all(
        kind == _MATLAB_MATRIX and _is_matlab_matrix(part, order, depth + 1) for kind, part in elements[data:]
    )


def _count_matlab_elements(elements: Sequence[bytes], order: str) -> tuple[int, int]:
    """Return how many elements of data a matrix must have, and how many matrices then; (0, 0): no matrix."""
    if len(elements) < 3 or len(elements[0]) != 8:
        return 0, 0
    kind, flags = elements[0][:2] if order == "<" else elements[0][3:1:-1]
    if kind == _MATLAB_OPAQUE:
        return 4, 1
    # SciPy takes a matrix without sizes for one, and ends the process.
    if len(elements[1]) < 8 or len(elements[1]) % 4:
        return 0, 0
    sizes = np.frombuffer(elements[1], f"{order}i4").tolist()
    count = math.prod(sizes) if min(sizes, default=-1) >= 0 else -1
    if kind in (_MATLAB_STRUCTURE, _MATLAB_OBJECT):
        # An object has the name of its class before the length of its fields' names.
        data = 5 + (kind == _MATLAB_OBJECT)
        lengths, names = elements[data - 2 : data] if len(elements) >= data else (b"", b"")
        length = int.from_bytes(lengths, "little" if order == "<" else "big", signed=True)
        return (data, count * (len(names) // length)) if length > 0 <= count else (0, 0)
    if kind == _MATLAB_CELL:
        return (3, count) if count >= 0 else (0, 0)
    if kind in _MATLAB_NUMERIC or kind == _MATLAB_SPARSE:
        return 4 + (flags & _MATLAB_IS_COMPLEX > 0) + 2 * (kind == _MATLAB_SPARSE), 0
    return {_MATLAB_TEXT: (4, 0), _MATLAB_FUNCTION: (3, 1)}.get(kind, (0, 0))


_MOST_STRUCTURES = 1000
"""Structures of an array, as of channels of dSPACE, that are columns `array[0].field`."""


def _flatten_structures(content: dict[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in content.items():
        if name.startswith("__"):
            continue
        full = prefix + name
        if type(value).__name__ in ("MatlabOpaque", "MatlabFunction"):
            # SciPy gives objects no name of their own.
            yield str(value.reshape(-1)[0][0], "utf-8") if isinstance(value, np.ndarray) else full, None
        elif isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
            record = value.reshape(-1)[0]
            yield from _flatten_structures({field: record[field] for field in value.dtype.names}, f"{full}.")
        elif isinstance(value, np.ndarray) and value.dtype.names and value.size <= _MOST_STRUCTURES:
            for place, record in enumerate(value.reshape(-1)):
                own = {field: record[field] for field in value.dtype.names}
                yield from _flatten_structures(own, f"{full}[{place}].")
        else:
            yield full, value


DEFAULT_NAMES = {
    "time": ("t", "time"),
    "position": ("q", "position"),
    "velocity": ("dq", "velocity"),
    "acceleration": ("ddq",),
    "torque": ("tau", "torque"),
    "motor_position": ("theta", "motor_position"),
    "link_position": ("link_position",),
    "reference": ("q_ref", "reference"),
    "reference_velocity": ("dq_ref", "reference_velocity"),
    "feedforward": ("tau_ff", "feedforward"),
    "load": ("tau_load",),
    "temperature": ("temperature",),
}
"""Names of a quantity's columns where the robot file states none; numbered ones for single joints. The first
ones are written, in this order."""
_SYMBOLS = {"velocity": "dq", "acceleration": "ddq", "reference_velocity": "dq"}
_SYMBOLS |= dict.fromkeys(("position", "motor_position", "link_position", "reference"), "q")
_SYMBOLS |= dict.fromkeys(("torque", "feedforward", "load"), "tau")
"""Symbols that have the units of what joints measure."""
_SUFFIXES = (".npz", ".csv")


def write_recording(recording: Recording, path: Path, robot: Robot) -> Path:
    """Write all channels but extras in SI units to `path`, and return it; errors as of `write_raw_log`."""
    flat = check_suffix(path, "a log", _SUFFIXES) == ".csv"
    columns: dict[str, FloatArray] = {"t": recording.time}
    units = {"t": "s"}
    for channel, (name, *_) in DEFAULT_NAMES.items():
        values: FloatArray | None = getattr(recording, channel)
        if values is None or channel == "time":
            continue
        own = ["degC"] * robot.freedom
        if channel in _SYMBOLS:
            own = [get_unit(_SYMBOLS[channel], prismatic=joint.prismatic) for joint in robot.axes]
        if flat:
            columns |= {f"{name}{number}": column for number, column in enumerate(values.T, 1)}
            units |= {f"{name}{number}": unit for number, unit in enumerate(own, 1)}
        else:
            columns[name], units[name] = values, own[0] if len(set(own)) == 1 else "SI"
    if recording.simulated:
        # A column, so that every reader of tables gets along with it.
        columns[SIMULATED], units[SIMULATED] = np.ones(len(recording.time)), recording.simulated
    return write_raw_log(RawLog(columns=columns, units=units), path)


def write_raw_log(raw: RawLog, path: Path) -> Path:
    """Write columns as they were logged, with names and units, to `path` (.npz or .csv), and return it.

    An OutputError tells of another suffix, columns that do not fit into a .csv, and a path not written.
    """
    writer = _write_archive
    if check_suffix(path, "a log", _SUFFIXES) == ".csv":
        writer = _write_table
        shapes = {values.shape for values in raw.columns.values()}
        if len(shapes) > 1 or any(len(shape) > 1 for shape in shapes):
            text = "this log has arrays or columns of different lengths, which a .csv cannot hold; write .npz"
            raise OutputError(Notice(code="output.no-table", text=text, file=str(path)))
    return write_file(path, lambda stream: writer(stream, raw), what="the log", with_folder=True)


def _write_archive(stream: IO[bytes], raw: RawLog) -> None:
    arrays: dict[str, np.ndarray] = dict(raw.columns)
    if raw.units:
        arrays[UNITS_ARRAY] = np.array([f"{name} [{unit}]" for name, unit in raw.units.items()])
    # Arrays go one by one: savez dates its members, and the same log must give the same bytes. Digits of
    # sensors hardly get shorter by compression, which takes longer than the simulation of them.
    with zipfile.ZipFile(stream, "w") as archive:
        for name, values in arrays.items():
            member = zipfile.ZipInfo(f"{name}.npy")
            with archive.open(member, "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.ascontiguousarray(values), allow_pickle=False)


def _write_table(stream: IO[bytes], raw: RawLog) -> None:
    with io.TextIOWrapper(stream, encoding="utf-8", newline="", write_through=True) as text:
        writer = csv.writer(text, lineterminator="\n")
        units = raw.units
        writer.writerow([f"{name} [{units[name]}]" if name in units else name for name in raw.columns])
        rows = np.stack(list(raw.columns.values()), axis=1).tolist()
        writer.writerows([repr(value) for value in row] for row in rows)
