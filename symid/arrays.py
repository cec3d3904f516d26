"""Names for arrays, and how products keep them: float64, row-major, read-only copies."""

import math
from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
FloatMatrix = Annotated[FloatArray, "matrix"]
"""The same of rows and columns: of a field that is read from a file."""


def freeze(values: object) -> FloatArray:
    """Return a read-only float64 copy of `values`, row-major; an array that is one already is returned.

    Whoever makes an array read-only and hands it over must not make it writable again.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        owner = values if values.base is None else values.base
        alone = type(owner) is np.ndarray and owner.size == values.size and not owner.flags.writeable
        if alone and owner.flags.owndata and values.flags.c_contiguous and not values.flags.writeable:
            return values
    array = np.array(values, dtype=np.float64, order="C")
    array.setflags(write=False)
    return array


_PIECE = 4000
"""Rows of a matrix that are made triangular or copied at a time: few enough for the caches."""


def compute_triangle(matrix: FloatArray) -> FloatArray:
    """Return R (min(N, m), m) of `matrix` = Q R (N, m), Q' Q = E; each row of R may have either sign.

    Householder 1958; pieces of a long matrix first (Demmel, Grigori, Hoemmen and Langou 2012).
    """
    # NumPy's own takes up to three times as long, for copies.
    from scipy.linalg.lapack import dgeqrf

    count, size = matrix.shape
    if not count or not size:
        return np.zeros((min(count, size), size))
    if count >= 4 * max(_PIECE, size):
        pieces = np.array_split(matrix, count // max(_PIECE, size))
        matrix = np.vstack([compute_triangle(piece) for piece in pieces])
    packed = dgeqrf(np.array(matrix, order="F"), lwork=64 * size, overwrite_a=1)[0]
    return np.triu(packed[:size])


def cut_pieces(values: FloatArray, beyond: int = 0) -> Iterator[FloatArray]:
    """Yield pieces (n, k) of long `values` (N, n), a row a column of theirs, that share `beyond` samples."""
    for start in range(0, max(1, len(values) - beyond), _PIECE):
        yield values[start : start + _PIECE + beyond].T.copy()


def measure_top(values: FloatArray, span: int = 0) -> FloatArray:
    """Return the largest |x[k + span] - x[k]| (n,) of long `values` (N, n), |x[k]| where `span` is 0."""
    pieces = cut_pieces(values, span)
    steps = (piece[:, span:] - piece[:, :-span] if span else piece for piece in pieces)
    return np.asarray(np.max([np.abs(step).max(axis=1, initial=0.0) for step in steps], axis=0))


def accumulate(steps: FloatArray, keep: float, length: int = 32) -> FloatArray:
    """Return y_k = keep y_(k-1) + x_k (N, ...) of steps x (N, ...), from zero on; 0 <= `keep` <= 1."""
    # By blocks, then what is left of those before: `scipy.signal` would take longer to load.
    count, size = len(steps), math.prod(steps.shape[1:])
    lags, blocks = np.subtract.outer(np.arange(length), np.arange(length)), -(-count // length)
    sums = np.where(lags < 0, 0.0, np.power(keep, np.maximum(lags, 0))).T
    own = np.zeros((size, blocks * length))
    own[:, :count] = steps.reshape(count, size).T
    own = own.reshape(size, blocks, length) @ sums
    if blocks > 1:
        before = accumulate(own[:, :-1, -1].T, keep**length).T
        own[:, 1:] += before[..., None] * np.power(keep, np.arange(1.0, length + 1))
    return own.reshape(size, blocks * length)[:, :count].T.reshape(steps.shape)


def find_runs(mask: NDArray[np.bool_], least: int = 1) -> NDArray[np.intp]:
    """Return the runs (k, 2) of at least so many samples of a mask (N,): their first ones, those behind."""
    edges = np.flatnonzero(np.diff(np.pad(mask, 1))).reshape(-1, 2)
    return np.asarray(edges[edges[:, 1] - edges[:, 0] >= least])


class FrozenArrays:
    """Base of dataclasses: their fields of the type FloatArray are kept as read-only copies."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        freeze_fields(self)


def freeze_fields(record: object) -> None:
    """Replace the arrays of a dataclass, its fields of the type FloatArray, by read-only copies."""
    kind: Any = type(record)
    array_types = (FloatArray, FloatMatrix, FloatArray | None)
    for name in (field.name for field in fields(kind) if field.type in array_types):
        value = getattr(record, name)
        if value is not None:
            object.__setattr__(record, name, freeze(value))
