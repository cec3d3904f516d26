"""The least-squares problem of one joint and one law, in the form that all estimators share.

FrictionSamples, FrictionLaw -> FrictionProblem.

    J(linear, shape) = min_extra |R (tau - X extra - Phi(v; shape) linear)|^2
                     = |y - Q_x Phi_R(shape) linear|^2

y and Q_x Phi_R are the torque and the columns of the law behind R, less their parts in the columns of X:
what stands beside friction is eliminated once, whatever searches the rest.

Supported: any number of columns beside friction, also linearly dependent ones.
Not supported: bounds on what multiplies them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.friction.options import FrictionOptions
from symid.friction.samples import FrictionSamples
from symid.joint.friction_law import FrictionLaw, build_numpy_carrier, find_column_rates, find_columns

__all__ = ["SPEED_UNITS", "FrictionProblem", "build_problem"]

_DEPENDENT = 1e-10
"""Singular value of scaled columns below which a direction counts as none."""
SPEED_UNITS = frozenset({"rad/s", "m/s"})
_SLOWNESS_UNITS = frozenset({"s/rad", "s/m"})
_BATCH = 10_000
"""Numbers in an array of torques of many candidates: what caches hold; up to five times faster."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionProblem:
    """What is to be minimised.

    Args:
        samples, law: of which joint and what.
        target: y (M,), N m or N.
        basis: (M, r) orthonormal, of the columns beside friction behind R.
        low, high: (s,) of the shape values; equal where one is fixed.
        size: (p,) the most that a linear parameter may be where a search needs a bound.
    """

    samples: FrictionSamples
    law: FrictionLaw
    target: FloatArray
    basis: FloatArray
    low: FloatArray
    high: FloatArray
    size: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("target", "basis", "low", "high", "size"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    @property
    def is_free(self) -> FloatArray:
        """Return which shape values are searched: (s,), one or zero."""
        return (self.high > self.low).astype(np.float64)

    @property
    def is_logarithmic(self) -> FloatArray:
        """Return which shape values are searched by their logarithm: (s,), one or zero."""
        return (self.low > 0.0).astype(np.float64)

    @property
    def lower(self) -> FloatArray:
        """Return the least linear parameters that a bounded search may try: (p,)."""
        bounds = np.array([entry.lower for entry in self.law.linear])
        return np.asarray(np.maximum(bounds, -self.size))

    @property
    def upper(self) -> FloatArray:
        """Return the greatest linear parameters that a bounded search may try: (p,)."""
        bounds = np.array([entry.upper for entry in self.law.linear])
        return np.asarray(np.minimum(bounds, self.size))

    def find_physical_box(self) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest physical parameters that a bounded search may try: (p + s,) each.

        Physical bounds where they bind, as fS >= 0, else what sums of linear parameters in their box reach.
        """
        mixing = np.array(self.law.mixing, dtype=np.float64)
        low, high = np.concatenate([self.lower, self.low]), np.concatenate([self.upper, self.high])
        up, down = np.maximum(mixing, 0.0), np.minimum(mixing, 0.0)
        least = np.maximum([entry.lower for entry in self.law.physical], up @ low + down @ high)
        most = np.minimum([entry.upper for entry in self.law.physical], up @ high + down @ low)
        return least, most

    def encode(self, shape: Sequence[float] | FloatArray) -> FloatArray:
        """Return coordinates z of shape values (..., s): logarithms where they are positive."""
        values = np.array(shape, dtype=np.float64)
        logarithmic = self.is_logarithmic > 0.0
        values[..., logarithmic] = np.log(values[..., logarithmic])
        return values

    def decode(self, z: FloatArray) -> FloatArray:
        """Return shape values of coordinates z (..., s), between the bounds."""
        values = np.array(z, dtype=np.float64)
        logarithmic = self.is_logarithmic > 0.0
        values[..., logarithmic] = np.exp(values[..., logarithmic])
        return np.clip(values, self.low, self.high)

    def find_columns(self, shape: Sequence[float] | FloatArray) -> FloatArray:
        """Return Q_x Phi_R: (M, p)."""
        columns = find_columns(self.law, self.samples.inputs, [float(value) for value in shape])
        return self._eliminate(self.samples.pass_columns(columns))

    def find_rates(self, shape: Sequence[float] | FloatArray, linear: FloatArray) -> FloatArray:
        """Return the derivatives of Q_x Phi_R linear by the shape values: (M, s)."""
        rates = find_column_rates(self.law, self.samples.inputs, [float(value) for value in shape])
        torque_rates = np.einsum("nps,p->ns", rates, linear)
        return self._eliminate(self.samples.pass_columns(torque_rates))

    def find_objectives(self, linear: FloatArray, shape: FloatArray) -> FloatArray:
        """Return J of many candidates, linear (P, p) and shape (P, s): (P,)."""
        chunk = max(1, _BATCH // self.samples.count)
        parts = [
            self._find_chunk(linear[begin : begin + chunk], shape[begin : begin + chunk])
            for begin in range(0, len(linear), chunk)
        ]
        return np.concatenate(parts)

    def _find_chunk(self, linear: FloatArray, shape: FloatArray) -> FloatArray:
        inputs = {name: values[None, :] for name, values in self.samples.inputs.items()}
        lifted = [shape[:, place, None] for place in range(shape.shape[1])]
        torque = np.zeros((len(linear), self.samples.count))
        for place, column in enumerate(self.law.columns(build_numpy_carrier(), inputs, lifted)):
            torque += linear[:, place, None] * column
        if self.samples.reduce is not None:
            torque = self.samples.pass_columns(np.ascontiguousarray(torque.T)).T
        errors = torque - self.target
        total: FloatArray = np.einsum("pm,pm->p", errors, errors)
        if self.basis.shape[1]:
            # |(1 - B B') e|^2 = |e|^2 - |B' e|^2, for y has no part in B.
            total = total - np.sum((errors @ self.basis) ** 2, axis=1)
        return np.maximum(total, 0.0)

    def _eliminate(self, columns: FloatArray) -> FloatArray:
        return columns - self.basis @ (self.basis.T @ columns)


def build_problem(samples: FrictionSamples, law: FrictionLaw, options: FrictionOptions) -> FrictionProblem:
    """Return the problem.

    Args:
        samples: of one joint.
        law: what is fitted.
        options: `bounds` of shape values are read; a law's own and those of the data otherwise.

    Raises:
        UsageError: the law reads an input that is not known, or a bound is of no use.
        IdentifiabilityError: the joint does not move, or there are fewer rows than unknowns.
    """
    missing = [name for name in law.inputs if name not in samples.inputs]
    if missing:
        text = f"law {law.name!r} reads {' and '.join(missing)}, which the samples of {samples.joint!r} lack"
        raise UsageError(Notice(code="friction.input", text=text))
    speeds = np.sort(np.abs(samples.velocity))
    if speeds[-1] == 0.0:
        text = f"joint {samples.joint!r} does not move: its friction cannot be learnt"
        raise IdentifiabilityError(Notice(code="friction.rest", text=text))
    torque = samples.pass_columns(samples.torque[:, None])[:, 0]
    basis = _find_basis(samples.pass_columns(samples.extra))
    unknowns = len(law.linear) + len(law.shape) + samples.extra.shape[1]
    if len(torque) <= unknowns:
        text = f"joint {samples.joint!r}: {len(torque)} rows cannot tell {unknowns} unknowns"
        raise IdentifiabilityError(Notice(code="friction.few-rows", text=text))
    low, high = _find_bounds(law, speeds, options)
    columns = find_columns(law, samples.inputs, _find_middle(low, high))
    reach = np.max(np.abs(columns), axis=0)
    largest = float(np.max(np.abs(samples.torque)))
    return FrictionProblem(
        samples=samples,
        law=law,
        target=torque - basis @ (basis.T @ torque),
        basis=basis,
        low=low,
        high=high,
        size=options.reach * max(largest, 1e-300) / np.where(reach > 0.0, reach, 1.0),
    )


def _find_middle(low: FloatArray, high: FloatArray) -> list[float]:
    return [
        float(np.sqrt(a * b)) if a > 0.0 else float(0.5 * (a + b)) for a, b in zip(low, high, strict=True)
    ]


def _find_basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis (M, r) of the space of columns (M, k), each scaled to length one."""
    lengths = np.linalg.norm(columns, axis=0)
    kept = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
    if not kept.shape[1]:
        return np.zeros((len(columns), 0))
    left, singular, _ = np.linalg.svd(kept, full_matrices=False)
    return np.asarray(left[:, singular > _DEPENDENT * singular[0]])


def _find_bounds(
    law: FrictionLaw, speeds: FloatArray, options: FrictionOptions
) -> tuple[FloatArray, FloatArray]:
    """Return bounds (s,) of the shape values: those asked for, else the law's as far as data can tell."""
    given = dict(options.bounds)
    unknown = sorted(set(given) - {entry.name for entry in law.shape})
    if unknown:
        names = ", ".join(entry.name for entry in law.shape) or "none"
        text = f"bounds of {', '.join(unknown)}: law {law.name!r} has the shape values {names}"
        raise UsageError(Notice(code="friction.bounds", text=text))
    slowest, fastest = float(speeds[min(4, len(speeds) - 1)]), float(speeds[-1])
    slow, fast = min(max(slowest, 1e-4 * fastest), 1e-2 * fastest), 3.0 * fastest
    pairs = []
    for entry in law.shape:
        low, high = entry.lower, entry.upper
        if entry.unit in SPEED_UNITS:
            low, high = max(low, slow) if low >= 0.0 else max(low, -fastest), min(high, fast)
        elif entry.unit in _SLOWNESS_UNITS:
            low, high = max(low, 0.1 / fastest), min(high, 3.0 / slow)
        else:
            high = min(high, 1e3 * max(1.0, abs(low)))
        pairs.append(given.get(entry.name, (low, high)))
    return np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])
