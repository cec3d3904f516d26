"""One joint: its samples, the rows that filters leave of them, and the result of a fit of a friction law.

Arrays in SI units -> FrictionSamples -> FrictionRows, VelocityMap; samples and fitted values -> Uncertainty.

    tau = Phi(v; shape) linear + X extra + noise,    R tau = R [Phi, X] c + R noise
    F = R [Phi(v; s), dPhi/ds c, X],   cov = sigma^2 (F'F)^+,   sigma^2 = J / (M - p - s - k)
    physical = mixing (c, s)
    AICc = M ln(J / M) + 2 k + 2 k (k + 1) / (M - k - 1)      Hurvich and Tsai, Biometrika 76 (1989) 297-307
    BIC  = M ln(J / M) + k ln M                               Schwarz, Ann. Statist. 6 (1978) 461-464

R is a linear operator that the torque and all columns pass alike, recording by recording: a filter, a
decimation, both. In the criteria M is the
number of rows, k that of the unknowns with the variance of the noise as one of them.

Not supported: several joints at once; R that depends on the values it acts on; maps over load or position;
correlated noise behind R (see `poses`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, compute_triangle, freeze, freeze_fields
from symid.errors import IdentifiabilityError, LogError, Notice
from symid.identification.estimators import ParameterEstimate
from symid.identification.judge import POLICY, numerics
from symid.ipopt import Ending
from symid.joint_models import FrictionLaw, compute_columns, compute_law_sensitivities
from symid.logs import decimate
from symid.robot import Decimation
from symid.serialization import HIDDEN, name_key

Values = Sequence[float] | FloatArray
Reduction = Callable[[FloatArray], FloatArray]
"""A linear operator on columns: (N, c) -> (M, c)."""
_VECTORS = ("time", "velocity", "torque", "load", "position", "temperature", "run", "extra")


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionSamples:
    """Samples of one joint.

    Args:
        time: (N,) s; velocity: (N,) rad/s or m/s.
        torque: (N,) N m or N; positive where it drives towards positive velocity.
        extra: (N, k) columns beside friction, as ddq, sin q, cos q; (N, 0) for none.
        extra_names, extra_units: of the factors of these columns; no units where they are not known.
        load: (N,) torque that the gear carries, N m or N; position: (N,) rad or m;
            temperature: (N,) degC; None where not known.
        run: (N,) recording of a sample, from zero; None: all of one.
        reduce: R; None for the identity. prismatic: whether the joint moves along its axis.

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
    temperature: FloatArray | None = None
    run: NDArray[np.int64] | None = None
    reduce: Reduction | None = None
    prismatic: bool = False

    def __post_init__(self) -> None:
        """Copy the arrays, make them read-only, check them."""
        freeze_fields(self)
        run = np.array(np.zeros(len(self.time)) if self.run is None else self.run, dtype=np.int64)
        run.setflags(write=False)
        object.__setattr__(self, "run", run)
        joint, count = f"joint {self.joint!r}", len(self.velocity)
        mistakes = [] if count else [f"{joint}: there are no samples"]
        arrays = {name: getattr(self, name) for name in _VECTORS}
        for name, values in {k: one for k, one in arrays.items() if one is not None}.items():
            shape = (count, len(self.extra_names)) if name == "extra" else (count,)
            if values.shape != shape:
                mistakes.append(f"{joint}: {name} has shape {values.shape}, not {shape}")
            if not np.all(np.isfinite(values)):
                mistakes.append(f"{joint}: {name} holds numbers that are not finite")
        if len(self.extra_units) not in {0, len(self.extra_names)}:
            mistakes.append(f"{joint}: extra_units must be one for each of extra_names, or none")
        LogError.refuse(mistakes, code="friction.samples")

    @property
    def count(self) -> int:
        """Return N, the number of samples."""
        return len(self.velocity)

    @property
    def inputs(self) -> dict[str, FloatArray]:
        """Return the inputs of laws, (N,) each: velocity, and load and position where they are known."""
        names = ("velocity", "load", "position", "temperature")
        return {name: values for name in names if (values := getattr(self, name)) is not None}

    def pass_columns(self, columns: FloatArray) -> FloatArray:
        """Return R applied to columns (N, c): (M, c)."""
        return columns if self.reduce is None else self.reduce(columns)

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> "FrictionSamples":
        """Return some of the samples, without R, which is of all of them."""
        arrays = {name: getattr(self, name) for name in _VECTORS}
        chosen: dict[str, Any] = {k: values[index] for k, values in arrays.items() if values is not None}
        return replace(self, **chosen, reduce=None)

    def select_rows(self, kept: NDArray[np.bool_]) -> "FrictionSamples":
        """Return the samples with only the rows `kept` (M,)."""
        if (whole := self.reduce) is None:
            return self.take(kept)
        return replace(self, reduce=lambda columns: np.asarray(whole(columns)[kept]))

    def pass_law(self, law: FrictionLaw, shape: Sequence[float] | FloatArray) -> FloatArray:
        """Return the columns of a law behind R (M, p), for shape values (s,)."""
        return self.pass_columns(compute_columns(law, self.inputs, [float(value) for value in shape]))

    @cached_property
    def rows(self) -> "FrictionRows":
        """Return the samples behind R, read-only."""
        run = np.asarray(self.run, dtype=np.float64)
        columns = [np.ones(self.count), self.time, self.velocity, run, self.torque, self.extra]
        passed = self.pass_columns(np.column_stack(columns))
        # A filter whose gain at rest is not one scales constants.
        time, velocity, run = passed[:, 1:4].T / passed[:, 0]
        rows = FrictionRows(time, velocity, passed[:, 4], passed[:, 5:], np.rint(run).astype(np.intp))
        for values in rows:
            values.setflags(write=False)
        return rows

    @cached_property
    def beside(self) -> "Beside":
        """Return what X spans; X^+ is that of least norm in scaled columns."""
        lengths = np.linalg.norm(self.rows.extra, axis=0)
        scales = np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)
        left, singular, right = np.linalg.svd(self.rows.extra * scales, full_matrices=False)
        rank = int(np.sum(singular > numerics.RANK * singular.max(initial=0.0)))
        factors = scales[:, None] * (right[:rank].T / singular[:rank])
        parts = (singular[:rank, None] * right[:rank]) * lengths
        return Beside(freeze(left[:, :rank]), freeze(factors), freeze(parts))


class FrictionRows(NamedTuple):
    """Rows of one joint: time, velocity, torque, run (M,) and extra (M, k), as in `FrictionSamples`."""

    time: FloatArray
    velocity: FloatArray
    torque: FloatArray
    extra: FloatArray
    run: NDArray[np.intp]


class Beside(NamedTuple):
    """A basis (M, r) of the columns beside friction behind R, X; X^+ = factors basis', parts = basis' X."""

    basis: FloatArray
    factors: FloatArray
    parts: FloatArray


def build_reduction(lengths: Sequence[int], decimation: Decimation) -> Reduction | None:
    """Return the operator that decimates recordings of these lengths; None for no decimation."""
    if decimation.factor == 1:
        return None
    ends = np.cumsum(lengths)[:-1]

    def reduce(columns: FloatArray) -> FloatArray:
        return np.vstack([decimate(part, decimation) for part in np.split(columns, ends)])

    return reduce


def is_one_sided(velocity: FloatArray) -> bool:
    """Return whether at most one sample in a hundred moves against the others."""
    forward, backward = int(np.sum(velocity > 0.0)), int(np.sum(velocity < 0.0))
    return min(forward, backward) <= 0.01 * max(forward, backward)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VelocityMap(FrozenArrays):
    """Friction torque in intervals of velocity.

    Mean velocity, rising, mean torque, its deviation (`spread`) and rows are (B,); the cloud are (C,) single
    rows, evenly over time; `slowest` is the speed of the slowest row of all, rad/s or m/s.
    """

    velocity: FloatArray
    torque: FloatArray
    spread: FloatArray
    count: FloatArray = field(metadata=name_key("rows"))
    cloud_velocity: FloatArray = field(metadata=HIDDEN)
    cloud_torque: FloatArray = field(metadata=HIDDEN)
    slowest: float = field(metadata=HIDDEN)


def compute_velocity_map(samples: FrictionSamples, other: FloatArray | tuple[float, ...] = ()) -> VelocityMap:
    """Return the map, in intervals of equal numbers of rows, of the torque less `other` (k,) beside it."""
    rows = samples.rows
    torque = rows.torque - rows.extra @ np.asarray(other, dtype=np.float64)
    parts: list[tuple[Any, ...]] = []
    for direction in (-1.0, 1.0):
        index = np.flatnonzero(direction * rows.velocity > 0.0)
        order = index[np.argsort(rows.velocity[index], kind="stable")]
        count = min(20, len(order) // 5)
        for group in np.array_split(order, count) if count else ():
            values = torque[group]
            parts.append((np.mean(rows.velocity[group]), np.mean(values), np.std(values), len(group)))
    table = np.array(parts).reshape(-1, 4)
    kept = np.unique(np.linspace(0, len(torque) - 1, min(600, len(torque))).astype(int))
    return VelocityMap(
        **dict(zip(("velocity", "torque", "spread", "count"), table.T, strict=True)),
        cloud_velocity=rows.velocity[kept],
        cloud_torque=torque[kept],
        slowest=float(np.min(np.abs(rows.velocity), initial=np.inf)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionEstimate:
    """The fit of a law.

    Args:
        joint, law, estimator: their names; `settings` the options and counts of the search.
        parameters: as papers print them, in the order of the law, without those refused; `reason` of an
            entry: that it is at a bound.
        extra: factors of the columns beside friction, without those refused.
        refused: parameters that cannot be identified from these samples, with the reason.
        linear: (p,) of the law; shape: (s,) its nonlinear unknowns; bristles: what a law with a state
            remembers with; other: (k,) values of all columns beside friction. Together they predict torques
            of motions like those fitted; that of a refused one means nothing by itself.
        covariance: of (linear, shape, other), row by row; zero in directions that are not identifiable.
        objective: J, (N m)^2 or N^2; sigma: standard deviation of the residual, N m or N.
        samples: M, rows of the fit.
        evaluations: of J; solves: linear problems; iterations: or generations.
        outcome: how the search ended; ended: the stop rule in words.
        aicc, bic: information criteria; condition: of the column-scaled Jacobian.
        history: the least objective after each iteration or generation.
        notices: warnings.
    """

    joint: str
    law: str
    parameters: tuple[ParameterEstimate, ...]
    extra: tuple[ParameterEstimate, ...] = field(metadata=HIDDEN)
    refused: tuple[tuple[str, str], ...]
    other: tuple[float, ...] = field(metadata=HIDDEN)
    objective: float
    sigma: float
    samples: int = field(metadata=HIDDEN)
    evaluations: int
    outcome: Ending
    notices: tuple[Notice, ...] = field(default=(), metadata=HIDDEN)
    estimator: str
    linear: tuple[float, ...] = field(metadata=HIDDEN)
    shape: tuple[float, ...] = field(metadata=HIDDEN)
    bristles: tuple[float, ...] = field(default=(), metadata=HIDDEN)
    covariance: tuple[tuple[float, ...], ...] = field(metadata=HIDDEN)
    solves: int
    iterations: int
    ended: str
    aicc: float
    bic: float
    condition: float
    history: tuple[float, ...] = field(default=(), metadata=HIDDEN)
    settings: tuple[tuple[str, float | int | str], ...] = field(default=(), metadata=HIDDEN)

    def get_value(self, name: str) -> float | None:
        """Return the value of a parameter; None where it has none."""
        return {entry.name: entry.value for entry in (*self.parameters, *self.extra)}.get(name)


class FrictionSearch(NamedTuple):
    """The end of a search; fields as in `FrictionEstimate`."""

    linear: tuple[float, ...]
    shape: tuple[float, ...]
    objective: float
    evaluations: int
    solves: int
    iterations: int
    history: tuple[float, ...]
    outcome: Ending
    ended: str
    settings: tuple[tuple[str, float | int | str], ...]


def cut_parts(rows: FrictionRows) -> tuple[list[NDArray[np.intp]], NDArray[np.intp]]:
    """Return the rows of every part, and the stretch (b,) that each is left out with.

    Raises IdentifiabilityError where there are fewer rows than parts.
    """
    runs = np.unique(rows.run)
    each, count = max(2, math.ceil(POLICY.folds / len(runs))), len(rows.run)
    pieces, members = each * POLICY.parts, [np.flatnonzero(rows.run == run) for run in runs]
    parts = [part for own in members for part in np.array_split(own, pieces)]
    if count < len(parts):
        text = f"logs with {count} samples cannot be cut into {len(parts)} parts, so no data can be held out "
        text += "to choose a law. Name one with --model, or use longer logs"
        raise IdentifiabilityError(Notice(code="friction.too-few-rows", text=text))
    return parts, np.arange(len(parts)) // POLICY.parts


def compute_criteria(objective: float, rows: int, unknowns: int) -> tuple[float, float]:
    """Return AICc, infinite where there are too few rows, and BIC; `unknowns` is without the variance."""
    count = unknowns + 1
    likelihood = rows * math.log(max(objective, numerics.TINY) / rows)
    spare = rows - count - 1
    aicc = likelihood + 2.0 * count * rows / spare if spare > 0 else math.inf
    return aicc, likelihood + count * math.log(rows)


class Uncertainty(NamedTuple):
    """Covariance (n, n) of linear, shape and other, zero in directions that are not identifiable.

    `physical` (p + s,) and `other` (k,) are standard deviations, infinite where not identifiable, zero where
    fixed; `rank` that of the column-scaled F, `condition` over its range.
    """

    covariance: FloatArray
    physical: FloatArray
    other: FloatArray
    rank: int
    condition: float


def compute_sensitivities(
    samples: FrictionSamples, law: FrictionLaw, linear: Values, shape: Values
) -> FloatArray:
    """Return F behind R: (M, p + s + k)."""
    own = compute_law_sensitivities(law, samples.inputs, linear, shape)
    return np.hstack([samples.pass_columns(own), samples.rows.extra])


def compute_uncertainty(
    design: FloatArray, law: FrictionLaw, variance: float, fixed: Sequence[bool]
) -> Uncertainty:
    """Return the uncertainty that F (M, n) gives.

    `variance` is that of the noise, (N m)^2 or N^2; `fixed` (s,) are the shape values that are not searched.
    """
    count, edges = len(law.linear), len(law.linear) + len(law.shape)
    free = np.ones(design.shape[1], dtype=bool)
    free[count:edges] = ~np.asarray(fixed, dtype=bool)
    lengths = np.linalg.norm(design, axis=0)
    gone = lengths <= 1e-30 * max(float(np.max(lengths)), numerics.TINY)
    lengths[gone] = 1.0
    scaled = (np.where(gone, 0.0, design) / lengths)[:, free]
    _, singular, right = np.linalg.svd(compute_triangle(scaled))
    rank = int(np.sum(singular > 1e-9 * max(float(singular[0]), numerics.TINY)))
    directions = np.zeros((design.shape[1], int(free.sum())))
    directions[free] = right.T
    directions /= lengths[:, None]
    root, null = directions[:, :rank] / singular[:rank], directions[:, rank:]
    mixing = np.eye(design.shape[1])
    mixing[:edges, :edges] = np.array(law.mixing, dtype=np.float64)
    covariance = variance * (root @ root.T)
    variances = np.einsum("ij,jk,ik->i", mixing, covariance, mixing)
    sizes = np.maximum(np.linalg.norm(mixing / lengths, axis=1), numerics.TINY)
    lost = np.linalg.norm(mixing @ null, axis=1) > 1e-6 * sizes
    deviations = np.where(lost, np.inf, np.sqrt(np.maximum(variances, 0.0)))
    condition = float(singular[0] / singular[rank - 1]) if rank else np.inf
    return Uncertainty(covariance, deviations[:edges], deviations[edges:], rank, condition)
