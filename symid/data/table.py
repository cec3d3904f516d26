"""The columns of a log file as they stand in it, before anyone says what they mean.

Output of the readers of each format; input of `readers.read_recording`.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import LogError, Notice

__all__ = ["RawLog", "convert_column", "refuse_file", "split_heading"]

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
