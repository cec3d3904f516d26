"""Columns of an HDF5 file, MATLAB's version 7.3 among them.

Input: a path. Output: `RawLog`; a data set of a group, or a field of a structure, is the column `group.name`.

An attribute `unit` or `units` of a data set states its unit. MATLAB stores arrays with their axes in reverse;
its files say so by attributes, and are turned.

Supported: data sets of real numbers, groups inside groups, structures.
Not supported: cells and tables of MATLAB, compound types, external links. Needs h5py, the extra `hdf5`.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from symid.data.table import RawLog, convert_column, refuse_file

__all__ = ["read_hdf5"]

_CLASS = "MATLAB_class"
_NUMBERS = frozenset(
    ("double", "single", "logical", *(f"{sign}int{size}" for sign in ("", "u") for size in (8, 16, 32, 64)))
)
_UNITS = ("unit", "units")


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
    columns, units, others = {}, {}, []
    try:
        with h5py.File(path, "r") as file:
            for name, data in _walk(h5py, file):
                column = convert_column(_load(data))
                if column is None:
                    others.append(name)
                    continue
                columns[name] = column
                unit = _find_unit(data)
                if unit:
                    units[name] = unit
    # h5py raises any of these on a damaged file, according to where the damage lies.
    except (OSError, ValueError, TypeError, KeyError, RuntimeError) as error:
        text = f"this is not an HDF5 file that can be read: {error}"
        raise refuse_file(str(path), text, "log.format") from error
    return RawLog(columns=columns, units=units, others=tuple(others))


def _walk(h5py: Any, group: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:  # noqa: ANN401  h5py has no types
    """Return every data set below `group`, by name; what MATLAB keeps for itself is passed over."""
    for name in sorted(group):
        if name.startswith("#"):
            continue
        entry = group.get(name)
        if isinstance(entry, h5py.Group):
            yield from _walk(h5py, entry, f"{prefix}{name}.")
        elif isinstance(entry, h5py.Dataset):
            yield prefix + name, entry


def _load(data: Any) -> object:  # noqa: ANN401  h5py has no types
    """Return the numbers of a data set as an array with time first; None where it holds something else."""
    kind = _read_text(data.attrs.get(_CLASS))
    if kind is not None and (kind not in _NUMBERS or "MATLAB_empty" in data.attrs):
        return None
    if data.dtype.kind not in "biuf" or data.ndim > 2:
        return None
    values = np.asarray(data[()])
    return values.T if kind is not None else values


def _find_unit(data: Any) -> str | None:  # noqa: ANN401  h5py has no types
    for name in _UNITS:
        text = _read_text(data.attrs.get(name))
        if text:
            return text
    return None


def _read_text(value: object) -> str | None:
    if isinstance(value, bytes | np.bytes_):
        return bytes(value).decode("utf-8", "replace")
    return str(value) if isinstance(value, str) else None
