"""What friction of one joint is fitted to: velocities, torques, and all else that moves with them.

Input: arrays of one joint, in SI units. Output: `FrictionSamples`, which every estimator reads.

    tau = Phi(v; shape) linear + X extra + noise,    R tau = R [Phi, X] c + R noise

R is a linear operator that the torque and all columns pass alike: a filter, a decimation, both.

Supported: velocity, load and position as inputs of a law; columns of known form beside friction.
Not supported: several joints at once; R that depends on the values it acts on.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.errors import LogError, Notice

__all__ = ["FrictionSamples", "Reduction"]

Reduction = Callable[[FloatArray], FloatArray]
"""A linear operator on columns: (N, c) -> (M, c)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionSamples:
    """Samples of one joint.

    Args:
        joint: its name.
        time: (N,) s.
        velocity: (N,) rad/s or m/s.
        torque: (N,) N m or N; positive where it drives towards positive velocity.
        extra: (N, k) columns that stand beside friction, as ddq, sin q, cos q; (N, 0) for none.
        extra_names: of these columns.
        extra_units: of what multiplies them; empty where they are not known.
        load: (N,) torque that the gear carries, N m or N; None where it is not known.
        position: (N,) rad or m; None where it is not known.
        run: (N,) which recording or pose a sample belongs to, counted from zero; None: all of one.
        reduce: R, which torque and all columns pass; None for the identity.
        prismatic: whether the joint moves along its axis.
        noise: standard deviation of the torque's noise behind R, N m or N; None where it is not known.

    Raises:
        LogError: arrays of different length, empty, or with numbers that are not finite.
    """

    joint: str
    time: FloatArray
    velocity: FloatArray
    torque: FloatArray
    extra: FloatArray
    extra_names: tuple[str, ...] = ()
    extra_units: tuple[str, ...] = ()
    load: FloatArray | None = None
    position: FloatArray | None = None
    run: NDArray[np.int64] | None = None
    reduce: Reduction | None = None
    prismatic: bool = False
    noise: float | None = None

    def __post_init__(self) -> None:
        """Copy the arrays, make them read-only, check them."""
        for name in ("time", "velocity", "torque", "extra", "load", "position"):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, freeze(values))
        run = np.array(np.zeros(len(self.time)) if self.run is None else self.run, dtype=np.int64)
        run.setflags(write=False)
        object.__setattr__(self, "run", run)
        mistakes = _find_mistakes(self)
        if mistakes:
            raise LogError(*(Notice(code="friction.samples", text=text) for text in mistakes))

    @property
    def count(self) -> int:
        """Return N, the number of samples."""
        return len(self.velocity)

    @property
    def inputs(self) -> dict[str, FloatArray]:
        """Return what a law may read: velocity, and load and position where they are known, (N,) each."""
        given = {"velocity": self.velocity, "load": self.load, "position": self.position}
        return {name: values for name, values in given.items() if values is not None}

    def pass_columns(self, columns: FloatArray) -> FloatArray:
        """Return R applied to columns (N, c): (M, c)."""
        return columns if self.reduce is None else self.reduce(columns)


def _find_mistakes(samples: FrictionSamples) -> list[str]:
    mistakes = []
    count = len(samples.velocity)
    if count == 0:
        mistakes.append(f"joint {samples.joint!r}: there are no samples")
    for name in ("time", "velocity", "torque", "load", "position", "run"):
        values = getattr(samples, name)
        if values is not None and values.shape != (count,):
            mistakes.append(f"joint {samples.joint!r}: {name} has shape {values.shape}, not ({count},)")
    wide = (count, len(samples.extra_names))
    if samples.extra.shape != wide:
        mistakes.append(f"joint {samples.joint!r}: extra has shape {samples.extra.shape}, not {wide}")
    if samples.extra_units and len(samples.extra_units) != len(samples.extra_names):
        mistakes.append(f"joint {samples.joint!r}: extra_units must be one for each of extra_names, or none")
    mistakes += [
        f"joint {samples.joint!r}: {name} holds numbers that are not finite"
        for name in ("time", "velocity", "torque", "extra", "load", "position")
        if getattr(samples, name) is not None and not np.all(np.isfinite(getattr(samples, name)))
    ]
    if samples.noise is not None and not 0.0 < samples.noise < np.inf:
        mistakes.append(f"joint {samples.joint!r}: noise {samples.noise:g} must be positive, or not given")
    return mistakes
