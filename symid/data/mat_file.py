"""Columns of a MATLAB file.

Input: a path. Output: `RawLog`; a field of a structure is the column `structure.field`.

Supported: MAT version 4 and 5 to 7.2, structures inside structures; version 7.3 as `hdf5_file` reads it.
Not supported: cells, tables, complex numbers.
"""

import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from symid.data.hdf5_file import read_hdf5
from symid.data.table import RawLog, convert_column, refuse_file

__all__ = ["read_mat"]

_HDF5 = b"\x89HDF\r\n\x1a\n"


def read_mat(path: Path) -> RawLog:
    """Return the columns of the MATLAB file at `path`.

    Raises:
        LogError: the file is not a MAT file that can be read.
    """
    with path.open("rb") as stream:
        head = stream.read(520)
    if _HDF5 in head:
        return read_hdf5(path)
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = loadmat(str(path), struct_as_record=True)
    # SciPy raises any of these on a damaged file, according to where the damage lies.
    except (MatReadError, ValueError, TypeError, NotImplementedError, OSError, KeyError, zlib.error) as error:
        text = f"this is not a MATLAB file that can be read: {error}"
        raise refuse_file(str(path), text, "log.format") from error
    columns, others = {}, []
    for name, value in _flatten(content):
        column = convert_column(value)
        if column is None:
            others.append(name)
        else:
            columns[name] = column
    return RawLog(columns=columns, others=tuple(others))


def _flatten(content: dict[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in content.items():
        if name.startswith("__"):
            continue
        full = prefix + name
        if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
            record = value.reshape(-1)[0]
            yield from _flatten({field: record[field] for field in value.dtype.names}, f"{full}.")
        else:
            yield full, value
