"""Rows behind the samples of one joint: what filters and decimation leave of them, and parts of that.

Input: `FrictionSamples`. Output: `FrictionRows`, their times, velocities and torques; the same samples with
fewer rows.

A part is chosen among the rows, behind the filter, so that what is left out has passed exactly the filter of
what stays.

Supported: several recordings, each filtered by itself.
Not supported: rows of several joints at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.data.signals import decimate_columns
from symid.friction.samples import FrictionSamples, Reduction
from symid.robot.log_map import Decimation

__all__ = ["FrictionRows", "build_reduction", "find_rows", "select_friction_rows"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionRows:
    """Rows of one joint.

    Args:
        time: (M,) s. velocity: (M,) rad/s or m/s. torque: (M,) N m or N. extra: (M, k) of the samples.
        run: (M,) which recording a row belongs to.
    """

    time: FloatArray
    velocity: FloatArray
    torque: FloatArray
    extra: FloatArray
    run: NDArray[np.intp]

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("time", "velocity", "torque", "extra"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Decimated:
    """Decimation of each recording by itself."""

    lengths: tuple[int, ...]
    decimation: Decimation

    def __call__(self, columns: FloatArray) -> FloatArray:
        parts = np.split(columns, np.cumsum(self.lengths)[:-1])
        return np.vstack([decimate_columns(part, self.decimation) for part in parts])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Selected:
    """Some of the rows that another reduction leaves."""

    whole: Reduction
    kept: NDArray[np.intp]

    def __call__(self, columns: FloatArray) -> FloatArray:
        chosen: FloatArray = self.whole(columns)[self.kept]
        return chosen


def build_reduction(lengths: Sequence[int], decimation: Decimation) -> Reduction | None:
    """Return the operator that decimates recordings of these numbers of samples; None for no decimation."""
    if decimation.factor == 1:
        return None
    return _Decimated(lengths=tuple(lengths), decimation=decimation)


def find_rows(samples: FrictionSamples) -> FrictionRows:
    """Return the rows that the samples are fitted as."""
    ones = np.ones(samples.count)
    run = np.zeros(samples.count) if samples.run is None else samples.run
    columns: FloatArray = np.column_stack(
        [ones, samples.time, samples.velocity, run, samples.torque, samples.extra]
    )
    passed = samples.pass_columns(columns)
    # A filter whose gain at rest is not one scales constants, which say where a row is.
    gain = passed[:, 0]
    return FrictionRows(
        time=passed[:, 1] / gain,
        velocity=passed[:, 2] / gain,
        run=np.rint(passed[:, 3] / gain).astype(np.intp),
        torque=passed[:, 4],
        extra=passed[:, 5:],
    )


def select_friction_rows(samples: FrictionSamples, kept: NDArray[np.bool_]) -> FrictionSamples:
    """Return the samples with only the rows `kept` (M,)."""
    index = np.flatnonzero(kept)
    if samples.reduce is not None:
        return replace(samples, reduce=_Selected(whole=samples.reduce, kept=index))
    return replace(
        samples,
        time=samples.time[index],
        velocity=samples.velocity[index],
        torque=samples.torque[index],
        extra=samples.extra[index],
        load=None if samples.load is None else samples.load[index],
        position=None if samples.position is None else samples.position[index],
        run=None if samples.run is None else samples.run[index],
    )
