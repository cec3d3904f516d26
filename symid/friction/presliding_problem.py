"""The problem of fitting friction with a memory: unknowns, residual, exact derivatives.

Input: samples of one joint with positions, a `DynamicLaw`. Output: `PreslidingProblem`.

    residual = R [tau_f(x; p) + X c] - R tau

Between samples the measured way over the period is the velocity of an exact step; at samples the measured
velocity sets damping and viscous friction.

Supported: several recordings, each beginning with straight bristles; columns beside friction; filters.
Not supported: turning back between two samples.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.friction.samples import FrictionSamples
from symid.joint.friction_dynamic import DynamicLaw
from symid.joint.friction_dynamic_run import FrictionPath, find_dynamic_run, find_torque_columns

__all__ = ["LINEAR_PARAMETERS", "PreslidingProblem", "build_path", "build_presliding_problem"]

LINEAR_PARAMETERS = ("sigma1", "fV")
"""Parameters that the torque is linear in; they may be zero, the others not."""


def build_path(samples: FrictionSamples) -> FrictionPath:
    """Return the way that the samples went: each recording of them begins with straight bristles.

    Raises:
        IdentifiabilityError: no positions, or nothing moves.
        UsageError: times that do not increase within a recording.
    """
    run = samples.run
    if samples.position is None or run is None or not np.any(np.diff(samples.position)):
        text = (
            f"joint {samples.joint!r}: stiffness and damping of the bristles are learnt from the way of the "
            "joint while it sticks and begins to slip; these samples have no position, or nothing moves"
        )
        raise IdentifiabilityError(Notice(code="friction.presliding-position", text=text))
    start = np.concatenate([[1.0], (np.diff(run) != 0).astype(np.float64)])
    period = np.diff(samples.time, prepend=samples.time[:1])
    period[start > 0] = 0.0
    if np.any(period[start == 0] <= 0):
        text = f"joint {samples.joint!r}: times must increase within a recording"
        raise UsageError(Notice(code="friction.presliding-time", text=text))
    way = np.diff(samples.position, prepend=samples.position[:1])
    held = np.divide(way, period, out=np.zeros_like(way), where=period > 0)
    return FrictionPath(held=held, velocity=samples.velocity, period=period, start=start)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreslidingProblem:
    """What is fitted: unknowns are the free values of the law, logarithms unless linear, then c.

    Args:
        samples, law, path: what was measured, the model, the way.
        fixed: values that are not fitted, by name.
        target: (M,) R tau; extra: (M, k) R X.
    """

    samples: FrictionSamples
    law: DynamicLaw
    path: FrictionPath
    fixed: dict[str, float]
    target: FloatArray
    extra: FloatArray

    @property
    def free(self) -> list[int]:
        """Return the numbers of the parameters that are fitted."""
        return [k for k, name in enumerate(self.law.names) if name not in self.fixed]

    @property
    def logarithmic(self) -> FloatArray:
        """Return which of them stand as logarithms."""
        return np.array([self.law.names[k] not in LINEAR_PARAMETERS for k in self.free])

    def split(self, unknowns: FloatArray) -> tuple[list[float], FloatArray]:
        """Return the values of the law and c."""
        count = len(self.free)
        own = unknowns[:count].copy()
        own[self.logarithmic] = np.exp(own[self.logarithmic])
        given = dict(zip(self.free, own.tolist(), strict=True))
        names = enumerate(self.law.names)
        return [given[k] if k in given else self.fixed[name] for k, name in names], unknowns[count:]

    def find_residual(self, unknowns: FloatArray) -> FloatArray:
        """Return what the law and the columns beside it give more than was measured, (M,)."""
        values, other = self.split(unknowns)
        torque = find_dynamic_run(self.law, values, self.path).torque
        return self.samples.pass_columns(torque[:, None])[:, 0] + self.extra @ other - self.target

    def find_columns(self, values: Sequence[float]) -> FloatArray:
        """Return the derivatives (M, p + k) by the free values themselves, and by c."""
        columns = find_torque_columns(self.law, values, self.path, self.free)
        return np.hstack([self.samples.pass_columns(columns), self.extra])

    def find_jacobian(self, unknowns: FloatArray) -> FloatArray:
        """Return the derivatives (M, p + k) by the unknowns."""
        values, _ = self.split(unknowns)
        columns = self.find_columns(values)
        factors = np.where(self.logarithmic, np.array(values)[self.free], 1.0)
        columns[:, : len(self.free)] *= factors
        return columns


def build_presliding_problem(
    samples: FrictionSamples, law: DynamicLaw, fixed: Mapping[str, float]
) -> PreslidingProblem:
    """Return the problem; values in `fixed` that the law lacks are ignored.

    Raises:
        IdentifiabilityError: no positions, nothing moves, or there are not more rows than unknowns.
        UsageError: times that do not increase within a recording, or every parameter is fixed.
    """
    if set(law.names) <= set(fixed):
        text = f"all parameters of {law.name!r} are fixed: leave some to be fitted"
        raise UsageError(Notice(code="friction.presliding-options", text=text))
    target = samples.pass_columns(samples.torque[:, None])[:, 0]
    wide = samples.extra.shape[1] > 0
    unknowns = sum(name not in fixed for name in law.names) + samples.extra.shape[1]
    if target.size <= unknowns:
        text = f"joint {samples.joint!r}: {target.size} rows cannot tell {unknowns} unknowns of {law.name!r}"
        raise IdentifiabilityError(Notice(code="friction.few-rows", text=text))
    return PreslidingProblem(
        samples=samples,
        law=law,
        path=build_path(samples),
        fixed={name: value for name, value in fixed.items() if name in law.names},
        target=target,
        extra=samples.pass_columns(samples.extra) if wide else np.zeros((target.size, 0)),
    )
