"""Columns of a NumPy archive.

Input: a path. Output: `RawLog`.

An array of texts named `units` may state units, as headings do: `["t [s]", "q [rad]"]`.

Supported: arrays of real numbers, (N,) or (N, k).
Not supported: pickled objects, which could run code when they are loaded.
"""

import zipfile
import zlib
from pathlib import Path

import numpy as np

from symid.data.table import RawLog, convert_column, refuse_file, split_heading

__all__ = ["UNITS", "read_npz"]

UNITS = "units"
"""Name of the array that states units."""

_SINGLE = b"\x93NUMPY"


def read_npz(path: Path) -> RawLog:
    """Return the columns of the NumPy archive at `path`.

    Raises:
        LogError: the file is not a NumPy archive.
    """
    try:
        # A stream of our own: numpy leaves a file open when it is no archive.
        with path.open("rb") as stream:
            if not zipfile.is_zipfile(stream) and stream.seek(0) == 0 and stream.read(6) != _SINGLE:
                text = "this is not a NumPy archive: archives are written by numpy.savez"
                raise refuse_file(str(path), text, "log.format")
            stream.seek(0)
            archive = np.load(stream, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                text = "this is a single array (.npy), not an archive (.npz)"
                raise refuse_file(str(path), text, "log.format")
            content = {name: _load(archive, name) for name in archive.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        text = f"this is not a NumPy archive that can be read: {error}"
        raise refuse_file(str(path), text, "log.format") from error
    stated = content.pop(UNITS, None)
    units = {}
    if isinstance(stated, np.ndarray) and stated.dtype.kind == "U":
        units = {
            name: unit for name, unit in map(split_heading, stated.reshape(-1).tolist()) if unit is not None
        }
    columns = {name: convert_column(value) for name, value in content.items()}
    return RawLog(
        columns={name: column for name, column in columns.items() if column is not None},
        units=units,
        others=tuple(name for name, column in columns.items() if column is None),
    )


def _load(archive: "np.lib.npyio.NpzFile", name: str) -> object:
    try:
        return archive[name]
    except ValueError:  # an array of objects; it is reported as no column of numbers
        return None
