"""The least-squares problem of one joint and one friction law, its options, and its linear part at one shape.

FrictionSamples, FrictionLaw, FrictionOptions -> FrictionProblem; shape -> Projection.

    J(linear, shape) = min_extra |R (tau - X extra - Phi(v; shape) linear)|^2
                     = |y - Q_x Phi_R(shape) linear|^2
    J(s) = |P(s) y|^2,   P = 1 - Phi Phi^+        (what multiplies the columns is Phi^+ y)
    dr/ds ~ -P dPhi/ds c                          (Kaufman's Jacobian; its gradient of J is exact)

y and Q_x Phi_R are the torque and the columns of the law behind R, less their parts in the columns X:
what stands beside friction is eliminated once, whatever searches the rest. All estimators share this
objective.

Supported: any number of columns beside friction, dependent ones too (least norm); columns that have all
but vanished.
Not supported: bounds on what multiplies the columns beside friction; weights of single samples.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, is_dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.identification.friction.estimate import FrictionSearch
from symid.identification.friction.samples import FrictionSamples
from symid.ipopt import Ending
from symid.joint_models import (
    FrictionLaw,
    build_numpy_carrier,
    compute_column_derivatives,
    compute_columns,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class VariableProjectionOptions:
    """Of variable projection.

    Args:
        grid: values tried of the shape, spaced by equal factors, with one, two and three unknowns:
            so many of each unknown.
        starts: of the least values on the grid that are not neighbours, so many are followed.
        solves: linear problems at most, of all kinds together.
        tolerance: relative step in the shape at which the search ends.
    """

    grid: tuple[tuple[int, ...], ...] = ((24,), (8, 6), (5, 4, 3))
    starts: int = 3
    solves: int = 150
    tolerance: float = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class RootFindingOptions:
    """Of root finding: values of the shape scanned for changes of sign, relative tolerance of a root."""

    points: int = 80
    tolerance: float = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionNlpOptions:
    """Of the constrained problem: starts, Ipopt's tolerance on the scaled problem, iterations a start."""

    starts: int = 6
    tolerance: float = 1e-9
    iterations: int = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class GeneticOptions:
    """Of the genetic algorithm.

    On 200 draws of protocol S1 (500 samples, four unknowns) it ended within 1e-6 of the optimum each time,
    after 65 generations and 20 ms on average. Roulette selection, crossover of pairs and Gaussian mutation of
    single genes stop up to three times above it: they do not follow the narrow valley in which Coulomb and
    viscous friction trade off.

    Args:
        population: candidates per unknown.
        width: of the crossover, in deviations of the population; below 0.8 it converges too soon.
        generations: at most.
        tolerance: (worst - best) / best of the population at which the search ends.
    """

    population: int = 16
    width: float = 0.95
    generations: int = 400
    tolerance: float = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnealingOptions:
    """Of the hybrid of genetic algorithm and simulated annealing.

    On the same draws it took 53 generations and 26 ms; cooling by 0.95 takes half as many again, for the
    temperature then stays above the differences that matter.

    Args:
        population: candidates per unknown.
        width: of the crossover; step: of the neighbours, both in deviations of the population.
        cooling: factor of the temperature from one generation to the next.
        generations: at most.
        tolerance: (worst - best) / best of the population at which the search ends.
    """

    population: int = 12
    width: float = 0.95
    step: float = 0.8
    cooling: float = 0.6
    generations: int = 400
    tolerance: float = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class EvolutionOptions:
    """Of SciPy's differential evolution.

    With its default strategy, best1bin with recombination 0.7, 4 of 40 such draws ended at more than three
    times the optimum; with these, none did.

    Args:
        population: candidates per unknown.
        strategy, recombination: SciPy's.
        generations: at most.
        tolerance: deviation over mean of the objectives at which the search ends.
    """

    population: int = 15
    strategy: str = "randtobest1bin"
    recombination: float = 0.9
    generations: int = 1000
    tolerance: float = 1e-8


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionOptions:
    """All of them, and what they share.

    Args:
        bounds: (name, (least, greatest)) of shape values; equal where a value is fixed. Without an entry
            the law's own bounds hold, and for velocities those that the samples can tell.
        reach: bounded searches try linear parameters up to the one whose column alone would reach so many
            times the largest torque.
        seed: of a stochastic search that is given no generator.
    """

    bounds: tuple[tuple[str, tuple[float, float]], ...] = ()
    reach: float = 3.0
    seed: int = 0
    variable_projection: VariableProjectionOptions = field(default_factory=VariableProjectionOptions)
    root_finding: RootFindingOptions = field(default_factory=RootFindingOptions)
    nlp: FrictionNlpOptions = field(default_factory=FrictionNlpOptions)
    genetic: GeneticOptions = field(default_factory=GeneticOptions)
    annealing: AnnealingOptions = field(default_factory=AnnealingOptions)
    evolution: EvolutionOptions = field(default_factory=EvolutionOptions)

    def __post_init__(self) -> None:
        """Check what every later stage relies on.

        Raises:
            UsageError: with all that is wrong.
        """
        mistakes = [
            f"bounds of {name} ({low:g}, {high:g}): must be finite, the least first"
            for name, (low, high) in self.bounds
            if not -math.inf < low <= high < math.inf
        ]
        if not 0.0 < self.reach < math.inf:
            mistakes.append(f"reach {self.reach:g}: must be a positive number")
        parts = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        for part, record in parts.items():
            for entry in fields(record) if is_dataclass(record) else ():
                name, value = f"{part}.{entry.name}", getattr(record, entry.name)
                least = _LEAST.get(name, 1)
                if entry.name in _COUNTS and value < least:
                    mistakes.append(f"{name} {value}: must be {least} or more")
                if entry.name in {"tolerance", "cooling"} and not 0.0 < value < 1.0:
                    mistakes.append(f"{name} {value:g}: must lie between 0 and 1")
                if entry.name in {"width", "step"} and not 0.0 < value < math.inf:
                    mistakes.append(f"{name} {value:g}: must be a positive number")
        if any(count < 2 for counts in self.variable_projection.grid for count in counts):
            mistakes.append("variable_projection.grid: must be two or more of each unknown")
        if mistakes:
            raise UsageError(*(Notice(code="usage.friction-option", text=text) for text in mistakes))


_COUNTS = frozenset({"starts", "solves", "points", "iterations", "population", "generations"})
_LEAST = {
    "root_finding.points": 3,
    "genetic.population": 4,
    "annealing.population": 4,
    "evolution.population": 2,
}
"""Of the counts that must be more than one."""


_BASIS_RANK = 1e-10
"""Singular value of scaled columns below which a direction counts as none."""
SPEED_UNITS = frozenset({"rad/s", "m/s"})
_SLOWNESS_UNITS = frozenset({"s/rad", "s/m"})
_BATCH = 10_000
"""Numbers in an array of torques of many candidates: what caches hold; up to five times faster."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionProblem(FrozenArrays):
    """What is to be minimised.

    Args:
        samples, law: of which joint and what.
        target: y (M,), N m or N.
        basis: (M, r) orthonormal, of the columns beside friction behind R.
        low, high: (s,) of the shape values; equal where one is fixed.
        lower, upper: (p,) of linear parameters, which only bounded searches keep.
    """

    samples: FrictionSamples
    law: FrictionLaw
    target: FloatArray
    basis: FloatArray
    low: FloatArray
    high: FloatArray
    lower: FloatArray
    upper: FloatArray

    @property
    def is_free(self) -> NDArray[np.bool_]:
        """Return which shape values are searched: (s,)."""
        return np.asarray(self.high > self.low)

    @property
    def is_logarithmic(self) -> NDArray[np.bool_]:
        """Return which shape values are searched by their logarithm: (s,)."""
        return np.asarray(self.low > 0.0)

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
        values[..., self.is_logarithmic] = np.log(values[..., self.is_logarithmic])
        return values

    def decode(self, z: FloatArray) -> FloatArray:
        """Return shape values of coordinates z (..., s), between the bounds."""
        values = np.array(z, dtype=np.float64)
        values[..., self.is_logarithmic] = np.exp(values[..., self.is_logarithmic])
        return np.clip(values, self.low, self.high)

    def find_columns(self, shape: Sequence[float] | FloatArray) -> FloatArray:
        """Return Q_x Phi_R: (M, p)."""
        columns = compute_columns(self.law, self.samples.inputs, [float(value) for value in shape])
        return self.eliminate(self.samples.pass_columns(columns))

    def find_rates(self, shape: Sequence[float] | FloatArray, linear: FloatArray) -> FloatArray:
        """Return the derivatives of Q_x Phi_R linear by the shape values: (M, s)."""
        rates = compute_column_derivatives(self.law, self.samples.inputs, [float(value) for value in shape])
        return self.eliminate(self.samples.pass_columns(np.einsum("nps,p->ns", rates, linear)))

    def eliminate(self, columns: FloatArray) -> FloatArray:
        """Return columns behind R (M, c), or one of them (M,), less their parts in those beside friction."""
        return columns - self.basis @ (self.basis.T @ columns)

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
    basis = _compute_basis(samples.pass_columns(samples.extra))
    unknowns = len(law.linear) + len(law.shape) + samples.extra.shape[1]
    if len(torque) <= unknowns:
        text = f"joint {samples.joint!r}: {len(torque)} rows cannot tell {unknowns} unknowns"
        raise IdentifiabilityError(Notice(code="friction.few-rows", text=text))
    low, high = _list_bounds(law, speeds, options)
    middle = np.where(low > 0.0, np.sqrt(np.abs(low * high)), 0.5 * (low + high))
    reach = np.max(np.abs(compute_columns(law, samples.inputs, middle.tolist())), axis=0)
    largest = max(float(np.max(np.abs(samples.torque))), 1e-300)
    size = options.reach * largest / np.where(reach > 0.0, reach, 1.0)
    return FrictionProblem(
        samples=samples,
        law=law,
        target=torque - basis @ (basis.T @ torque),
        basis=basis,
        low=low,
        high=high,
        lower=np.maximum([entry.lower for entry in law.linear], -size),
        upper=np.minimum([entry.upper for entry in law.linear], size),
    )


def _compute_basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis (M, r) of the space of columns (M, k), each scaled to length one."""
    lengths = np.linalg.norm(columns, axis=0)
    kept = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
    if not kept.shape[1]:
        return np.zeros((len(columns), 0))
    left, singular, _ = np.linalg.svd(kept, full_matrices=False)
    return np.asarray(left[:, singular > _BASIS_RANK * singular[0]])


def _list_bounds(
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


_COLUMN_RANK = 1e-11
_VANISHED = 1e-9
_BESIDE = 1e-10
"""Step in a coordinate to the side of a kink."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Projection:
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
        """Keep the problem; `limit` is the most that may be solved."""
        self.problem, self.limit, self.solves, self.evaluations = problem, limit, 0, 0
        self.reserve = 0

    @property
    def exhausted(self) -> bool:
        """Return whether less is left, beside what is kept in reserve, than a step with its trial takes."""
        return self.solves + 2 + self.reserve > self.limit

    def project(self, z: FloatArray) -> Projection:
        """Return the least-squares solution at coordinates z (s,), of least norm in scaled columns."""
        self.solves += 1
        self.evaluations += 1
        shape = self.problem.decode(z)
        columns = self.problem.find_columns(shape)
        lengths = np.linalg.norm(columns, axis=0)
        # A column that has all but vanished would get a parameter beyond all numbers.
        gone = lengths <= _VANISHED * max(float(np.max(lengths)), 1e-300)
        columns = np.where(gone, 0.0, columns)
        lengths[gone] = 1.0
        orthonormal, upper = np.linalg.qr(columns / lengths)
        left, singular, right = np.linalg.svd(upper)
        rank = int(np.sum(singular > _COLUMN_RANK * max(float(singular[0]), 1e-300)))
        basis = orthonormal @ left[:, :rank]
        parts = basis.T @ self.problem.target
        residual = self.problem.target - basis @ parts
        return Projection(
            z=self.problem.encode(shape),
            shape=shape,
            objective=float(residual @ residual),
            residual=residual,
            linear=(right[:rank].T @ (parts / singular[:rank])) / lengths,
            basis=basis,
        )

    def find_jacobian(self, state: Projection) -> FloatArray:
        """Return Kaufman's Jacobian by the coordinates z: (M, s)."""
        rates = self.problem.find_rates(state.shape, state.linear)
        rates = rates * np.where(self.problem.is_logarithmic, state.shape, 1.0)
        jacobian: FloatArray = state.basis @ (state.basis.T @ rates) - rates
        return jacobian

    def build_search(
        self,
        state: Projection,
        history: Sequence[float],
        outcome: Ending,
        ended: str,
        settings: tuple[tuple[str, float | int | str], ...] = (),
    ) -> FrictionSearch:
        """Return the end of a search at `state`."""
        return FrictionSearch(
            linear=state.linear,
            shape=state.shape,
            objective=state.objective,
            evaluations=self.evaluations,
            solves=self.solves,
            iterations=len(history) - 1,
            history=tuple(history),
            outcome=outcome,
            ended=ended,
            settings=settings,
        )

    def find_side_gain(self, state: Projection, place: int, side: float) -> float:
        """Return how much less J would be at the least of its parabola on one side of a shape value.

        A kink of J has two slopes; `side` is 1.0 or -1.0. Zero where J does not fall to that side, or where
        the search ends there.
        """
        z = np.array(state.z)
        z[place] += side * _BESIDE
        ends = self.problem.encode(self.problem.low)[place], self.problem.encode(self.problem.high)[place]
        if not ends[0] <= z[place] <= ends[1]:
            return 0.0
        shape = self.problem.decode(z)
        rate = self.problem.find_rates(shape, state.linear)[:, place]
        rate = rate * (shape[place] if self.problem.is_logarithmic[place] else 1.0)
        rate = rate - state.basis @ (state.basis.T @ rate)
        fall, curved = 2.0 * side * float(rate @ state.residual), float(rate @ rate)
        return fall**2 / (4.0 * curved) if fall > 0.0 and curved > 0.0 else 0.0
