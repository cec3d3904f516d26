"""The least-squares problem of one joint and one friction law, its options, and its linear part at one shape.

FrictionSamples, FrictionLaw, FrictionOptions -> FrictionProblem; shape -> Projection.

    J(linear, shape) = min_extra |R (tau - X extra - Phi(v; shape) linear)|^2
                     = |y - Q_x Phi_R(shape) linear|^2
    J(s) = |P(s) y|^2,   P = 1 - Phi Phi^+        (the linear parameters are Phi^+ y)
    dr/ds ~ -P dPhi/ds c                          (Kaufman's Jacobian; its gradient of J is exact)

y and Q_x Phi_R are the torque and the columns of the law behind R, less their projection on the columns X
beside friction, which are eliminated once for both estimators. X may be dependent (least norm).
Not supported: bounds on the factors of X; weights of single samples.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.identification.friction.joint_fit import FrictionSamples, FrictionSearch
from symid.identification.judge import numerics
from symid.ipopt import Ending
from symid.joint_models import FrictionLaw, compute_column_derivatives


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionOptions:
    """Options of the estimators of friction.

    Args:
        bounds: (name, (least, greatest)) of shape values; equal where a value is fixed. Default: the law's
            own bounds, for velocities those that the samples can identify.
        starts: that are followed, of variable projection and of the constrained problem.
        solves: linear problems of variable projection at most, a third of them on a grid of shapes spaced by
            equal factors.
        tolerance: relative, of the shape, of Ipopt on the scaled problem.
        iterations: of Ipopt from a start, at most.
    """

    bounds: tuple[tuple[str, tuple[float, float]], ...] = ()
    starts: int = 3
    solves: int = 150
    tolerance: float = numerics.RANK
    iterations: int = 400

    def __post_init__(self) -> None:
        """Check all options; raises UsageError with all mistakes."""
        wrong = [(name, *pair) for name, pair in self.bounds if not -math.inf < pair[0] <= pair[1] < math.inf]
        told = "must be finite, the least first"
        mistakes = [f"bounds of {name} ({low:g}, {high:g}): {told}" for name, low, high in wrong]
        for name in ("starts", "solves", "tolerance", "iterations"):
            value, part = getattr(self, name), name == "tolerance"
            if not 0 < value < (1 if part else math.inf):
                mistakes.append(f"{name} {value:g}: must be {'between 0 and 1' if part else 'positive'}")
        if mistakes:
            raise UsageError(*(Notice(code="usage.friction-option", text=text) for text in mistakes))


SPEED_UNITS = frozenset({"rad/s", "m/s"})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionProblem(FrozenArrays):
    """The problem of one joint: y (M,), N m or N, and a basis (M, r) of the columns beside friction behind R.

    `low` and `high` (s,) are bounds of the shape values, equal where one is fixed.
    """

    samples: FrictionSamples
    law: FrictionLaw
    target: FloatArray
    basis: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def is_free(self) -> NDArray[np.bool_]:
        """Return which shape values are searched: (s,)."""
        return np.asarray(self.high > self.low)

    @property
    def is_logarithmic(self) -> NDArray[np.bool_]:
        """Return which shape values are searched by their logarithm: (s,)."""
        return np.asarray(self.low > 0.0)

    def encode(self, shape: Sequence[float] | FloatArray) -> FloatArray:
        """Return coordinates z of shape values (..., s): logarithms where they are positive."""
        values = np.array(shape, dtype=np.float64)
        values[..., self.is_logarithmic] = np.log(values[..., self.is_logarithmic])
        return values

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds (s,) of the coordinates."""
        return self.encode(self.low), self.encode(self.high)

    def decode(self, z: FloatArray) -> FloatArray:
        """Return shape values of coordinates z (..., s), between the bounds."""
        values = np.array(z, dtype=np.float64)
        values[..., self.is_logarithmic] = np.exp(values[..., self.is_logarithmic])
        return np.clip(values, self.low, self.high)

    def compute_columns(self, shape: Sequence[float] | FloatArray) -> FloatArray:
        """Return Q_x Phi_R: (M, p)."""
        return self.eliminate(self.samples.pass_law(self.law, shape))

    def compute_rates(self, shape: Sequence[float] | FloatArray, linear: FloatArray) -> FloatArray:
        """Return the derivatives of Q_x Phi_R linear by the coordinates z: (M, s)."""
        rates = compute_column_derivatives(self.law, self.samples.inputs, [float(value) for value in shape])
        rates = self.eliminate(self.samples.pass_columns(np.einsum("nps,p->ns", rates, linear)))
        return rates * np.where(self.is_logarithmic, shape, 1.0)

    def eliminate(self, columns: FloatArray) -> FloatArray:
        """Return columns behind R (M, c), or one of them (M,), less their parts in those beside friction."""
        return columns - self.basis @ (self.basis.T @ columns)


def build_problem(samples: FrictionSamples, law: FrictionLaw, options: FrictionOptions) -> FrictionProblem:
    """Return the problem; `bounds` of the options are read.

    Raises:
        UsageError: the law reads an input that the samples lack, or a bound is not of a shape value.
        IdentifiabilityError: the joint does not move, or there are fewer rows than unknowns.
    """
    missing = [name for name in law.inputs if name not in samples.inputs]
    if missing:
        text = f"law {law.name!r} reads {' and '.join(missing)}, which the samples of {samples.joint!r} lack"
        raise UsageError(Notice(code="friction.input", text=text))
    if not np.any(samples.velocity):
        text = f"joint {samples.joint!r} does not move: its friction is not identifiable"
        raise IdentifiabilityError(Notice(code="friction.rest", text=text))
    target, basis = samples.rows.torque, samples.beside.basis
    unknowns = len(law.linear) + len(law.shape) + samples.extra.shape[1]
    if len(target) <= unknowns:
        text = f"joint {samples.joint!r}: {len(target)} samples are too few for {unknowns} unknowns"
        raise IdentifiabilityError(Notice(code="friction.few-rows", text=text))
    low, high = _list_bounds(law, samples, options)
    target = target - basis @ (basis.T @ target)
    return FrictionProblem(samples=samples, law=law, target=target, basis=basis, low=low, high=high)


def _list_bounds(
    law: FrictionLaw, samples: FrictionSamples, options: FrictionOptions
) -> tuple[FloatArray, FloatArray]:
    """Return bounds (s,) of the shape values: those given, else the law's within the speeds sampled."""
    given = dict(options.bounds)
    unknown = sorted(set(given) - {entry.name for entry in law.shape})
    if unknown:
        names = ", ".join(entry.name for entry in law.shape) or "none"
        text = f"bounds of {', '.join(unknown)}: unknown; the shape values of law {law.name!r} are {names}"
        raise UsageError(Notice(code="friction.bounds", text=text))
    speeds = np.sort(np.abs(samples.velocity))
    # The fifth slowest sample, or a part of the top speed.
    fastest = float(speeds[-1])
    slow, pairs = min(max(float(speeds[:5][-1]), 1e-4 * fastest), 1e-2 * fastest), []
    for entry in law.shape:
        low, high = entry.lower, entry.upper
        if entry.unit in SPEED_UNITS:
            low, high = max(low, slow) if low >= 0.0 else max(low, -fastest), min(high, 3.0 * fastest)
        elif entry.unit in {"s/rad", "s/m"}:
            low, high = max(low, 0.1 / fastest), min(high, 3.0 / slow)
        else:
            high = min(high, 1e3 * max(1.0, abs(low)))
        pairs.append(given.get(entry.name, (low, high)))
    low_ends, high_ends = np.array(pairs, dtype=np.float64).reshape(-1, 2).T
    return low_ends, high_ends


class Projection(NamedTuple):
    """The linear problem at one shape: J, residual (M,), linear (p,), basis of the columns (M, r)."""

    z: FloatArray
    shape: FloatArray
    objective: float
    residual: FloatArray
    linear: FloatArray
    basis: FloatArray


class Projector:
    """Solves linear problems and counts them."""

    def __init__(self, problem: FrictionProblem, limit: int) -> None:
        """Keep the problem; at most `limit` linear problems are solved."""
        self.problem, self.limit, self.solves, self.evaluations = problem, limit, 0, 0
        self.reserve, self.history = 0, list[float]()

    @property
    def exhausted(self) -> bool:
        """Return whether fewer solves are left, without the reserve, than a step with its trial takes."""
        return self.solves + 2 + self.reserve > self.limit

    def project(self, z: FloatArray) -> Projection:
        """Return the least-squares solution at coordinates z (s,), of least norm in scaled columns."""
        self.solves += 1
        self.evaluations += 1
        shape = self.problem.decode(z)
        columns = self.problem.compute_columns(shape)
        lengths = np.linalg.norm(columns, axis=0)
        # The parameter of a column that has all but vanished would be infinite.
        gone = lengths <= 1e-9 * max(float(np.max(lengths)), numerics.TINY)
        columns = np.where(gone, 0.0, columns)
        lengths[gone] = 1.0
        orthonormal, upper = np.linalg.qr(columns / lengths)
        left, singular, right = np.linalg.svd(upper)
        rank = int(np.sum(singular > 1e-11 * max(float(singular[0]), numerics.TINY)))
        basis = orthonormal @ left[:, :rank]
        parts = basis.T @ self.problem.target
        residual = self.problem.target - basis @ parts
        linear = (right[:rank].T @ (parts / singular[:rank])) / lengths
        objective, z = float(residual @ residual), self.problem.encode(shape)
        return Projection(z, shape, objective, residual, linear, basis)

    def compute_jacobian(self, state: Projection) -> FloatArray:
        """Return Kaufman's Jacobian by the coordinates z: (M, s)."""
        rates = self.problem.compute_rates(state.shape, state.linear)
        return np.asarray(state.basis @ (state.basis.T @ rates) - rates)

    def record(self, *states: Projection) -> None:
        """Append the least objective so far to the history."""
        self.history.append(min(*self.history[-1:], *(state.objective for state in states), np.inf))

    def build_search(
        self, state: Projection, outcome: Ending, ended: str, **settings: float
    ) -> FrictionSearch:
        """Return the end of a search at `state`."""
        values = tuple(state.linear.tolist()), tuple(state.shape.tolist()), state.objective
        counts = self.evaluations, self.solves, len(self.history) - 1
        return FrictionSearch(*values, *counts, tuple(self.history), outcome, ended, tuple(settings.items()))

    def compute_side_gain(self, state: Projection, place: int, side: float) -> float:
        """Return how much less J is at the least of its parabola on one side (+-1.0) of a shape value."""
        z, (low, high) = np.array(state.z), self.problem.box
        z[place] += side * 1e-10
        if not low[place] <= z[place] <= high[place]:
            return 0.0
        rate = self.problem.compute_rates(self.problem.decode(z), state.linear)[:, place]
        rate = rate - state.basis @ (state.basis.T @ rate)
        fall, curved = 2.0 * side * float(rate @ state.residual), float(rate @ rate)
        return fall**2 / (4.0 * curved) if fall > 0.0 and curved > 0.0 else 0.0
