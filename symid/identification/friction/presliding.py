"""Friction with a state (Dahl, LuGre) identified: bristle stiffness and damping, and the law of slip.

    J = |R tau - R [tau_f(x; p), X c]|^2   over whole recordings, tau_f simulated along the measured path

Between samples the velocity of an exact step is the measured displacement over the period; at samples the
measured velocity sets damping and viscous friction. With sigma0 / fC, fS / fC and vs held, the torque is
linear in fC, sigma1, fV and c: a grid over these ratios gives starts; the best are refined by bounded
Gauss-Newton steps with exact derivatives.

Supported: several recordings, each beginning with straight bristles; columns beside friction; filters.
Not supported: turning back between two samples; position noise that is not small against the presliding
displacement, fC / sigma0.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import scipy

from symid import joint_models
from symid.arrays import FloatArray
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.identification.estimators import ParameterEstimate
from symid.identification.friction.joint_fit import FrictionRows, FrictionSamples, LawFit
from symid.identification.judge import POLICY, numerics
from symid.ipopt import Ending

LINEAR_PARAMETERS = ("sigma1", "fV")
"""Parameters that the torque is linear in; they may be zero, the others not."""


def build_path(samples: FrictionSamples) -> joint_models.FrictionPath:
    """Return the path of the samples: each recording of them begins with straight bristles."""
    run = samples.run
    if samples.position is None or run is None or not np.any(np.diff(samples.position)):
        text = (
            f"joint {samples.joint!r}: no positions, or nothing moves; stiffness and damping of the "
            "bristles are identified from the displacement of the joint while it sticks and begins to slip"
        )
        raise IdentifiabilityError(Notice(code="friction.presliding-position", text=text))
    start = np.concatenate([[1.0], (np.diff(run) != 0).astype(np.float64)])
    period = np.diff(samples.time, prepend=samples.time[:1])
    period[start > 0] = 0.0
    if np.any(period[start == 0] <= 0):
        text = f"joint {samples.joint!r}: times must increase within a recording"
        raise UsageError(Notice(code="friction.presliding-time", text=text))
    moved = np.diff(samples.position, prepend=samples.position[:1])
    held = np.divide(moved, period, out=np.zeros_like(moved), where=period > 0)
    return joint_models.FrictionPath(held=held, velocity=samples.velocity, period=period, start=start)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreslidingProblem:
    """The unknowns are the free values of the law, logarithms unless linear, then c.

    `fixed` are values that are not fitted, by name; `rows` have R tau and R X.
    """

    samples: FrictionSamples
    law: joint_models.DynamicLaw
    path: joint_models.FrictionPath
    fixed: dict[str, float]
    rows: FrictionRows

    @property
    def free(self) -> list[int]:
        """Return the places of the parameters that are fitted."""
        return [k for k, name in enumerate(self.law.names) if name not in self.fixed]

    @property
    def logarithmic(self) -> FloatArray:
        """Return which of them are logarithms."""
        return np.array([self.law.names[k] not in LINEAR_PARAMETERS for k in self.free])

    def split(self, unknowns: FloatArray) -> tuple[list[float], FloatArray]:
        """Return the values of the law and c."""
        count = len(self.free)
        own = unknowns[:count].copy()
        own[self.logarithmic] = np.exp(own[self.logarithmic])
        given = dict(zip(self.free, own.tolist(), strict=True))
        names = enumerate(self.law.names)
        return [given[k] if k in given else self.fixed[name] for k, name in names], unknowns[count:]

    def compute_residual(self, unknowns: FloatArray) -> FloatArray:
        """Return predicted less measured torque, (M,)."""
        values, other = self.split(unknowns)
        torque = joint_models.simulate_dynamic_friction(self.law, values, self.path).torque
        return self.samples.pass_columns(torque[:, None])[:, 0] + self.rows.extra @ other - self.rows.torque

    def compute_columns(self, values: Sequence[float]) -> FloatArray:
        """Return the derivatives (M, p + k) by the free values themselves, and by c."""
        columns = joint_models.compute_torque_derivatives(self.law, values, self.path, self.free)
        return np.hstack([self.samples.pass_columns(columns), self.rows.extra])

    def compute_jacobian(self, unknowns: FloatArray) -> FloatArray:
        """Return the derivatives (M, p + k) by the unknowns."""
        values, _ = self.split(unknowns)
        columns = self.compute_columns(values)
        columns[:, : len(self.free)] *= np.where(self.logarithmic, np.array(values)[self.free], 1.0)
        return columns


@dataclass(frozen=True, slots=True, kw_only=True)
class PreslidingEstimate(LawFit):
    """The fit of a law with a state; `fixed` parameters were given, `values` are all in the law's order."""

    fixed: tuple[tuple[str, float], ...]
    values: tuple[float, ...]


def _solve_start(problem: PreslidingProblem, values: list[float]) -> tuple[float, FloatArray]:
    """Return J and unknowns for the ratios of `values`: fC, sigma1, fV and c by linear least squares."""
    law, names = problem.law, problem.law.names
    states = joint_models.simulate_dynamic_friction(law, values, problem.path).state
    velocity, carrier = problem.path.velocity, joint_models.build_numpy_carrier()
    numbers: list[FloatArray] = [np.asarray(value) for value in values]
    rates = joint_models.compute_bristle_rate(carrier, law, velocity, states, numbers)
    linear = [name for name in LINEAR_PARAMETERS if name in names and name not in problem.fixed]
    terms = {"sigma1": rates, "fV": velocity}
    own = np.column_stack([values[0] * states, *(terms[name] for name in linear)])
    columns, target = np.hstack([problem.samples.pass_columns(own), problem.rows.extra]), problem.rows.torque
    found, *_ = np.linalg.lstsq(columns, target, rcond=None)
    scale = max(float(found[0]), 1e-3 * float(np.abs(target).max()))
    physical = dict(zip(names, values, strict=True))
    for name in ("sigma0", "fC", "fS"):
        if name in physical and name not in problem.fixed:
            physical[name] *= scale
    for name, value in zip(linear, found[1 : 1 + len(linear)], strict=True):
        physical[name] = max(float(value), 0.0)
    residual = columns @ np.concatenate([[scale], found[1:]]) - target
    start = np.array([physical[names[k]] for k in problem.free])
    start[problem.logarithmic] = np.log(start[problem.logarithmic])
    return float(residual @ residual), np.concatenate([start, found[1 + len(linear) :]])


def fit_presliding(
    samples: FrictionSamples,
    law: joint_models.DynamicLaw,
    *,
    fixed: Mapping[str, float] = MappingProxyType({"gamma": 2.0}),
) -> PreslidingEstimate:
    """Return the parameters of a law with a state, all from the same samples.

    `samples` have positions; `fixed` parameters are not fitted, those that the law lacks are ignored.

    Raises:
        IdentifiabilityError: no positions, nothing moves, or there are fewer rows than unknowns.
        UsageError: times that do not increase within a recording, or all parameters are fixed.
    """
    if set(law.names) <= set(fixed):
        text = f"all parameters of {law.name!r} are fixed: leave some to be fitted"
        raise UsageError(Notice(code="friction.presliding-options", text=text))
    rows = samples.rows
    count, unknowns = rows.extra.shape[0], sum(name not in fixed for name in law.names) + rows.extra.shape[1]
    if count <= unknowns:
        text = f"joint {samples.joint!r}: {count} rows are too few for {unknowns} unknowns of {law.name!r}"
        raise IdentifiabilityError(Notice(code="friction.few-rows", text=text))
    held = {name: value for name, value in fixed.items() if name in law.names}
    problem = PreslidingProblem(samples=samples, law=law, path=build_path(samples), fixed=held, rows=rows)
    # The grid: values of the law with fC = 1 and no damping, viscous friction.
    path, names = problem.path, problem.law.names
    moved = np.abs(path.held) * path.period
    shortest = float(np.quantile(moved[moved > 0], 0.05))
    longest = float(np.ptp(problem.samples.position)) if problem.samples.position is not None else 1.0
    slopes = np.geomspace(0.5 / longest, 1.0 / max(shortest, 1e-6 * longest), 16)
    excesses, speeds = [1.0], np.ones(1)
    if "vs" in names:
        excesses, speeds = [1.0, 1.5], np.quantile(np.abs(path.held)[moved > 0], (0.2, 0.6))
    given = {"fC": 1.0, "sigma1": 0.0, "fV": 0.0, "gamma": 2.0}
    grid = []
    for stiffness, excess, speed in itertools.product(slopes, excesses, speeds):
        named = {**given, "sigma0": stiffness, "fS": excess, "vs": speed, **problem.fixed}
        grid.append(_solve_start(problem, [float(named[name]) for name in names]))
    grid.sort(key=lambda pair: pair[0])
    searches = []
    for _, start in grid[:2]:
        # Logarithms near their start within the law's bounds, c free.
        lower, upper = np.full(start.size, -np.inf), np.full(start.size, np.inf)
        for place, k in enumerate(problem.free):
            parameter, reach = law.parameters[k], -np.log(numerics.CONVERGED)
            lower[place] = parameter.lower
            if problem.logarithmic[place]:
                least = np.log(parameter.lower) if parameter.lower > 0.0 else -np.inf
                lower[place] = max(start[place] - reach, least)
                upper[place] = min(start[place] + reach, np.log(parameter.upper))
        options = {"x_scale": "jac", "max_nfev": 60, "xtol": 1e-9, "ftol": 1e-10, "gtol": 1e-10}
        functions, bounds = (problem.compute_residual, start, problem.compute_jacobian), (lower, upper)
        searches.append(scipy.optimize.least_squares(*functions, bounds, **options))
    best = min(searches, key=lambda search: search.cost)
    evaluations = 2 * len(grid) + sum(int(search.nfev) for search in searches)
    return _build_estimate(problem, np.asarray(best.x), converged=best.status > 0, evaluations=evaluations)


def _build_estimate(
    problem: PreslidingProblem, unknowns: FloatArray, *, converged: bool, evaluations: int
) -> PreslidingEstimate:
    values, other = problem.split(unknowns)
    residual = problem.compute_residual(unknowns)
    objective = float(residual @ residual)
    sigma = float(np.sqrt(objective / max(residual.size - unknowns.size, 1)))
    columns = problem.compute_columns(values)
    sizes = np.maximum(np.linalg.norm(columns, axis=0), 1e-100)
    _, singular, directions = np.linalg.svd(columns / sizes, full_matrices=False)
    # Huge where columns are dependent.
    roots = directions.T / np.maximum(singular, 1e-13 * singular[0]) / sizes[:, None]
    covariance = sigma**2 * roots @ roots.T
    # The damping whose torque at the median speed would equal the torque explained.
    held = problem.path.held
    speed = np.median(np.abs(held[held != 0.0]))
    damping = float(np.sqrt(np.mean((residual + problem.rows.torque) ** 2)) / speed)
    samples, law = problem.samples, problem.law
    fitted, head = [law.parameters[k] for k in problem.free], f"joint {samples.joint!r}: "
    names = [*(entry.name for entry in fitted), *samples.extra_names]
    units = [entry.unit_prismatic if samples.prismatic else entry.unit for entry in fitted]
    units += samples.extra_units or ("",) * len(samples.extra_names)
    found = [*(values[k] for k in problem.free), *other.tolist()]
    flat, difference = False, np.zeros(len(covariance))
    if "fS" in names and "fC" in names:
        # Static and Coulomb friction differ by less than three standard deviations.
        difference[names.index("fS")], difference[names.index("fC")] = 1.0, -1.0
        gap = float(difference[: len(fitted)] @ np.array(values)[problem.free])
        flat = gap**2 < POLICY.printed**2 * float(difference @ covariance @ difference)
    identified, refused = [], []
    stds = np.sqrt(np.diag(covariance)).tolist()
    for name, unit, value, std in zip(names, units, found, stds, strict=True):
        # Zero is accepted only for what would have shown in the torque.
        at_zero = name in LINEAR_PARAMETERS and value <= 1e-6 * std
        at_zero = at_zero and 100.0 * std <= POLICY.uncertain * damping
        if name == "vs" and flat:
            text = "vs is not identifiable: static and Coulomb friction do not differ"
            refused.append((name, head + text))
        elif 100.0 * std > POLICY.uncertain * abs(value) and not at_zero:
            percent = 100.0 * std / abs(value) if value else np.inf
            size = "infinite" if percent > 1e6 else f"{percent:.0f} %"
            need = _NEEDS.get(name, "its column is too small, or others replace it")
            text = f"{name} is not identifiable (relative deviation {size}): {need}"
            refused.append((name, head + text))
        else:
            ends = [end for entry in fitted if entry.name == name for end in (entry.lower, entry.upper)]
            near = any(abs(value - end) <= 1e-4 * abs(end) for end in ends if end)
            reason = "at its bound, zero" if at_zero else f"at its bound, {value:.3g}" if near else ""
            identified.append(ParameterEstimate(name=name, value=value, std=std, unit=unit, reason=reason))
    own = [entry for entry in identified if entry.name in law.names]
    named, lost = dict(zip(law.names, values, strict=True)), {name for name, _ in refused}
    notices = []
    if named.get("fS", np.inf) < named["fC"] and not {"fS", "fC", "vs"} & lost:
        text = (
            f"static friction {named['fS']:.4g} is estimated below Coulomb friction {named['fC']:.4g}: this "
            "joint's friction does not fall with speed"
        )
        notices.append(Notice(code="friction.presliding-static", text=head + text))
    moving, bend = np.abs(held) * problem.path.period, named["fC"] / named["sigma0"]
    inside = int(np.sum((moving > 0) & (moving < bend)))
    if inside < 20 and "sigma0" not in lost:
        text = (
            f"only {inside} samples moved less than the presliding displacement {bend:.3g}: sample faster, "
            "or move slower around reversals"
        )
        notices.append(Notice(code="friction.presliding-few", text=head + text))
    outcome = Ending.CONVERGED if converged else Ending.LIMIT
    return PreslidingEstimate(
        joint=samples.joint,
        law=law.name,
        parameters=tuple(own),
        extra=tuple(entry for entry in identified if entry not in own),
        fixed=tuple(problem.fixed.items()),
        refused=tuple(refused),
        values=tuple(values),
        other=tuple(other.tolist()),
        objective=objective,
        sigma=sigma,
        samples=residual.size,
        evaluations=evaluations,
        outcome=Ending.SOME_REFUSED if converged and refused else outcome,
        notices=tuple(notices),
    )


_NEEDS = {
    "sigma0": "the joint must stick and turn back within the presliding displacement, fC / sigma0",
    "sigma1": "the joint must move fast enough while it sticks: near 1 / s of sigma0 / sigma1",
    "fS": "the joint must break away slowly, or slip at speeds below vs",
    "vs": "the joint must slip at speeds around vs, and its friction must fall there",
    "fC": "the joint must slip",
    "fV": "the joint must slip at speeds far apart",
}
