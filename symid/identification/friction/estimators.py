"""A friction law fitted to one joint by any estimator, and what the samples cannot identify of it.

FrictionSamples, FrictionLaw -> FrictionEstimate.

    problem (one for all) -> search (the estimator) -> uncertainty -> refusals, notices -> estimate

A parameter gets no number where the columns of the law are dependent on these samples (also where noise
alone keeps them apart: one speed, one direction); where the law without the term explains the samples as
well (chi-square, 0.01 %); where no row is slower than the Stribeck velocity; where the deviation of a
shape value exceeds half of it; where it stands in nothing but a term that is refused. Speeds are those of
rows that are fitted, behind filters and decimation.

Supported: the estimators in `ESTIMATORS`; "varpro" is the default for its exact optimum and its few
solves.
Not supported: several joints at once; naming a law that fits better (`selection`).
"""

import difflib
from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, SolverError, UsageError
from symid.identification.estimators import ParameterEstimate
from symid.identification.friction.bounded_search import (
    search_by_evolution,
    search_by_nlp,
    search_by_population,
)
from symid.identification.friction.estimate import (
    FrictionEstimate,
    FrictionSearch,
    Uncertainty,
    compute_criteria,
    compute_sensitivities,
    compute_uncertainty,
)
from symid.identification.friction.problem import SPEED_UNITS, FrictionOptions, FrictionProblem, build_problem
from symid.identification.friction.samples import FrictionSamples, build_friction_rows, is_one_sided
from symid.identification.friction.variable_projection import search_by_projection, search_by_roots
from symid.identification.regression import solve_scaled
from symid.ipopt import Ending
from symid.joint_models import (
    FrictionLaw,
    compute_column_derivatives,
    compute_columns,
    compute_friction_torque,
)

_FEW = 20
_ONE_SPEED = 0.05
"""Spread of the speeds over their median below which the joint moved at one speed."""
_UNSURE = 0.5
_CHANCE = 1e-4
_EDGE = 1e-6
_NEAR = 0.01
"""Deviations from a bound up to which a value stands at it."""
_PULL = 0.02
"""Deviations that the optimum lies beyond a bound, from which on the bound is what holds the value."""
_BUMPS = frozenset({"Fs", "Fsp", "Fsn", "Fls"})
"""What static friction is beyond Coulomb friction."""


def list_refusals(
    problem: FrictionProblem, search: FrictionSearch, uncertainty: Uncertainty
) -> dict[str, str]:
    """Return the reason for every parameter, of the law and beside it, that gets no number."""
    law, samples = problem.law, problem.samples
    names = [*(entry.name for entry in law.physical), *samples.extra_names]
    refused: dict[str, str] = {}
    lack, moved = _assess_motion(samples, build_friction_rows(samples).velocity)
    told = [uncertainty]
    if lack:
        design = compute_sensitivities(moved, law, search.linear, search.shape)
        told.append(compute_uncertainty(design, law, 1.0, list(~problem.is_free)))
    for entry in told:
        blind = np.isinf(np.concatenate([entry.physical, entry.other]))
        together = [name for name, lost in zip(names, blind, strict=True) if lost]
        reason = lack or "their columns depend on each other in these samples"
        for name in together:
            others = ", ".join(other for other in together if other != name)
            end = f"it cannot be told apart from {others}" if others else "nothing is seen of it"
            refused.setdefault(name, f"{reason}: {end}")
    refused |= {k: v for k, v in _refuse_shapes(problem, search).items() if k not in refused}
    refused |= _refuse_unsure(problem, search, uncertainty, refused)
    return refused | _refuse_inside(problem, search, refused)


def _assess_motion(samples: FrictionSamples, rows: FloatArray) -> tuple[str, FrictionSamples]:
    """Return what the motion of rows, velocities (M,), lacks, and samples without what only noise added."""
    unit = "m/s" if samples.prismatic else "rad/s"
    speeds, reasons = np.abs(rows[rows != 0.0]), []
    clean = samples
    if is_one_sided(rows):
        direction = 1.0 if np.sum(rows > 0.0) > np.sum(rows < 0.0) else -1.0
        clean, speeds = samples.take(samples.velocity * direction > 0.0), np.abs(rows[rows * direction > 0.0])
        reasons.append(f"in the {'positive' if direction > 0.0 else 'negative'} direction only")
    if not len(speeds):
        return "", samples
    middle = float(np.median(speeds))
    spread = float(np.subtract(*np.quantile(speeds, (0.975, 0.025))))
    if spread <= _ONE_SPEED * middle:
        reasons.append(f"at one speed only, {middle:.3g} {unit}")
        clean = replace(clean, velocity=np.sign(clean.velocity) * middle, reduce=None)
    return (f"the joint moved {' and '.join(reasons)}" if reasons else ""), clean


def _refuse_shapes(problem: FrictionProblem, search: FrictionSearch) -> dict[str, str]:
    """Return what these samples do not show of the law's shape, and of what hangs on it."""
    law = problem.law
    refused: dict[str, str] = {}
    rates = compute_column_derivatives(law, problem.samples.inputs, [float(value) for value in search.shape])
    size = np.max(np.abs(rates), axis=0, initial=0.0)
    whole = problem.find_columns(search.shape)
    variance = search.objective / max(
        len(problem.target) - len(law.physical) - len(problem.samples.extra_names), 1
    )
    unit = "m/s" if problem.samples.prismatic else "rad/s"
    slowest = float(np.min(np.abs(build_friction_rows(problem.samples).velocity)))
    for place, entry in enumerate(law.shape):
        if not problem.is_free[place]:
            continue
        value = float(search.shape[place])
        terms = [int(term) for term in np.flatnonzero(size[:, place] > 0.0)]
        if entry.name == "dq0":
            edge = np.array(search.shape)
            edge[place] = problem.low[place]
            if _is_as_good(problem, search, problem.find_columns(edge), variance, 1):
                refused[entry.name] = "a law without a zone about standstill explains the samples as well"
            continue
        reason = ""
        if entry.name == "vs" and slowest >= value:
            reason = f"no row is slower than the Stribeck velocity: the slowest moves at {slowest:.3g} {unit}"
        elif entry.unit in SPEED_UNITS and locate_edge(problem, search, place):
            reason = f"{entry.name} stands at the edge of what the samples can tell, {value:.3g} {unit}"
        elif _is_as_good(problem, search, np.delete(whole, terms, axis=1), variance, len(terms) + 1):
            reason = "the law without this term explains the samples as well"
            if entry.name == "vs":
                reason += f"; it shows at low speeds, and the slowest row moves at {slowest:.3g} {unit}"
        if reason:
            free = [int(k) for k in np.flatnonzero(problem.is_free)]
            inner = [k for k in free if not np.any(np.delete(size[:, k], terms))]
            for name in _list_dependents(law, terms, [place, *inner]):
                refused.setdefault(name, reason)
    return refused


def _list_dependents(law: FrictionLaw, terms: list[int], places: list[int]) -> list[str]:
    """Return names of physical parameters that hold one of the shape values or of the linear terms."""
    lost = {*terms, *(len(law.linear) + place for place in places)}
    return [
        entry.name
        for entry, row in zip(law.physical, law.mixing, strict=True)
        if any(row[index] for index in lost)
    ]


def _refuse_inside(
    problem: FrictionProblem, search: FrictionSearch, refused: dict[str, str]
) -> dict[str, str]:
    """Return what exists only inside the zone about standstill, where the zone itself is refused."""
    law, samples = problem.law, problem.samples
    place = next((k for k, entry in enumerate(law.shape) if entry.name == "dq0"), None)
    if place is None or "dq0" not in refused:
        return {}
    beyond = np.abs(samples.velocity) >= search.shape[place]
    columns = compute_columns(law, samples.inputs, [float(value) for value in search.shape])
    inside = [int(term) for term in np.flatnonzero(~np.any(columns[beyond], axis=0))]
    reason = f"it acts inside the zone about standstill only, and {refused['dq0']}"
    return {name: reason for name in _list_dependents(law, inside, []) if name not in refused}


def _is_as_good(
    problem: FrictionProblem, search: FrictionSearch, columns: FloatArray, variance: float, freedom: int
) -> bool:
    """Return whether fewer columns leave J no greater than chance explains."""
    from scipy.special import chdtri

    residual = problem.target
    if columns.shape[1]:
        residual = residual - columns @ solve_scaled(columns, residual, rcond=1e-11)
    gain = float(residual @ residual) - search.objective
    rounding = 1e-20 * float(problem.target @ problem.target)
    return gain <= float(chdtri(freedom, _CHANCE)) * variance + rounding


def _refuse_unsure(
    problem: FrictionProblem, search: FrictionSearch, uncertainty: Uncertainty, refused: dict[str, str]
) -> dict[str, str]:
    """Return values of the shape, and what hangs on a refused one, with deviations beyond half the value."""
    law = problem.law
    values = law.to_physical(list(search.linear), list(search.shape))
    shapes = {entry.name for entry, free in zip(law.shape, problem.is_free, strict=True) if free}
    # A value at its bound is told with the bound; that it may be zero is then no doubt.
    known = {*refused, *(list_active_bounds(problem, search, uncertainty).keys() - shapes)}
    unsure: dict[str, str] = {}
    # Values of the shape first: where one is refused, the terms that it bends are in doubt as well.
    for bends in (True, False):
        bent = bool(shapes & (refused.keys() | unsure.keys()))
        for entry, value, std in zip(law.physical, values, uncertainty.physical, strict=True):
            other = entry.name.startswith("fS") or (bent and entry.lower == 0.0)
            doubtful = entry.name in shapes if bends else other and entry.name not in shapes
            if doubtful and entry.name not in known and std > _UNSURE * abs(value):
                unit = entry.unit_prismatic if problem.samples.prismatic else entry.unit
                unsure[entry.name] = f"its standard deviation, {std:.3g} {unit}, is more than half its value"
    return unsure


def list_fit_notices(
    problem: FrictionProblem,
    search: FrictionSearch,
    refused: dict[str, str],
    held: dict[str, str],
) -> tuple[Notice, ...]:
    """Return what a reader of the fit should know; `held` is what `list_active_bounds` found."""
    notices = [
        Notice(code="friction.refused", text=f"{name} gets no number: {refused[name]}") for name in refused
    ]
    rows = build_friction_rows(problem.samples).velocity
    if is_one_sided(rows):
        text = "the direction of motion does not change: nothing is known of friction in the other direction"
        notices.append(Notice(code="friction.one-direction", text=text))
    for entry, value in zip(problem.law.shape, search.shape, strict=True):
        slow = int(np.sum(np.abs(rows) < 2.0 * value))
        if entry.name == "vs" and slow < _FEW:
            text = (
                f"{slow} rows are slower than twice the Stribeck velocity, fewer than {_FEW}: what "
                "happens at the start of motion rests on them; record slower motions"
            )
            notices.append(Notice(code="friction.few-slow", text=text))
    notices += [
        Notice(code="friction.at-bound", text=f"{name} stands {reason}")
        for name, reason in held.items()
        if name not in refused
    ]
    notices += _warn_of_values(problem, search, refused)
    if search.outcome.name not in {"CONVERGED", "STAGNATED"}:
        text = f"the search did not end by its tolerances but because {search.ended} ({search.outcome.value})"
        notices.append(Notice(code="friction.outcome", text=text))
    return tuple(notices)


def _warn_of_values(
    problem: FrictionProblem, search: FrictionSearch, refused: dict[str, str]
) -> list[Notice]:
    law, notices = problem.law, []
    if any(
        entry.name in _BUMPS and value < 0.0 for entry, value in zip(law.linear, search.linear, strict=True)
    ) and not any(name.startswith(("fS", "fE")) for name in refused):
        text = (
            "static friction came out below Coulomb friction: friction grows with the first speed. This "
            "axis may have no break-away bump, or filters blur its change of sign; record slower motions"
        )
        notices.append(Notice(code="friction.static-below-coulomb", text=text))
    values = law.to_physical(list(search.linear), list(search.shape))
    for entry, value in zip(law.physical, values, strict=True):
        if value < entry.lower and entry.name not in refused:
            text = (
                f"{entry.name} = {value:.4g} lies below its physical bound, {entry.lower:g}; "
                "the estimator 'nlp' keeps bounds"
            )
            notices.append(Notice(code="friction.beyond-bound", text=text))
    return notices


def list_active_bounds(
    problem: FrictionProblem, search: FrictionSearch, uncertainty: Uncertainty
) -> dict[str, str]:
    """Return the physical parameters that a bound holds, and at which one: "at its lower bound, 0: ...".

    A linear one is held where it stands within a hundredth of its deviation of a bound, and J falls beyond.
    """
    law, held = problem.law, {}
    values = law.to_physical(list(search.linear), list(search.shape))
    columns = problem.find_columns(search.shape)
    slope = -columns.T @ (problem.target - columns @ search.linear)
    slopes = slope @ np.array(law.unmixing, dtype=np.float64)[: len(slope)]
    variance = search.objective / max(len(problem.target) - uncertainty.rank, 1)
    places = {entry.name: place for place, entry in enumerate(law.shape)}
    least, most = problem.find_physical_box()
    for k, entry in enumerate(law.physical):
        std = float(uncertainty.physical[k])
        if entry.name in places:
            side = locate_edge(problem, search, places[entry.name])
        elif not np.isfinite(std) or abs(slopes[k]) * std <= _PULL * variance:
            continue
        elif slopes[k] > 0.0:
            side = "lower" if values[k] - least[k] <= _NEAR * std else ""
        else:
            side = "upper" if most[k] - values[k] <= _NEAR * std else ""
        if side:
            bound = (least if side == "lower" else most)[k]
            held[entry.name] = f"at its {side} bound, {bound:.4g}: its optimum lies beyond"
    return held


def locate_edge(problem: FrictionProblem, search: FrictionSearch, place: int) -> str:
    """Return "lower" or "upper" where a shape value stands at that bound of its search, else ""."""
    if not problem.is_free[place]:
        return ""
    z, low, high = (problem.encode(values)[place] for values in (search.shape, problem.low, problem.high))
    if z - low <= _EDGE * (high - low):
        return "lower"
    return "upper" if high - z <= _EDGE * (high - low) else ""


ESTIMATORS = ("varpro", "root-finding", "nlp", "genetic", "annealing", "differential-evolution")
STOCHASTIC = frozenset({"genetic", "annealing", "differential-evolution"})


def fit_friction(
    samples: FrictionSamples,
    law: FrictionLaw,
    *,
    estimator: str = "varpro",
    options: FrictionOptions | None = None,
    generator: np.random.Generator | None = None,
) -> FrictionEstimate:
    """Return the law's parameters and how sure they are.

    Args:
        samples: of one joint.
        law: what is fitted.
        estimator: one of `ESTIMATORS`.
        options: bounds, effort, tolerances; None for the defaults.
        generator: of a stochastic search; None for a new one from `options.seed`.

    Raises:
        UsageError: no such estimator, or one that cannot fit this law to these samples.
        IdentifiabilityError: nothing can be learnt.
        SolverError: the search ended without usable numbers.
    """
    options = options or FrictionOptions()
    problem = build_problem(samples, law, options)
    search = search_friction(problem, estimator=estimator, options=options, generator=generator)
    if not search.outcome.usable:
        text = f"estimator {estimator!r}, joint {samples.joint!r}: {search.ended} ({search.outcome.value})"
        raise SolverError(Notice(code="friction.solver", text=text))
    return _build_estimate(problem, search, estimator)


def check_estimator(estimator: str) -> None:
    """Refuse a name that is no estimator's.

    Raises:
        UsageError: no such estimator.
    """
    if estimator in ESTIMATORS:
        return
    near = difflib.get_close_matches(estimator, ESTIMATORS, n=1, cutoff=0.4)
    hint = f"; did you mean {near[0]}?" if near else ";"
    text = f"no estimator of friction is called {estimator!r}{hint} there are {', '.join(ESTIMATORS)}"
    raise UsageError(Notice(code="usage.friction-estimator", text=text))


def search_friction(
    problem: FrictionProblem,
    *,
    estimator: str,
    options: FrictionOptions,
    generator: np.random.Generator | None = None,
) -> FrictionSearch:
    """Return what the estimator finds; arguments as for `fit_friction`.

    Raises:
        UsageError: no such estimator, or one that cannot fit this law to these samples.
    """
    check_estimator(estimator)
    if estimator == "varpro":
        return search_by_projection(problem, options.variable_projection)
    if estimator == "root-finding":
        return search_by_roots(problem, options.root_finding)
    if estimator == "nlp":
        return search_by_nlp(problem, options.nlp)
    generator = np.random.default_rng(options.seed) if generator is None else generator
    if estimator == "differential-evolution":
        return search_by_evolution(problem, options.evolution, generator)
    return search_by_population(
        problem, options.genetic if estimator == "genetic" else options.annealing, generator
    )


def _build_estimate(problem: FrictionProblem, search: FrictionSearch, estimator: str) -> FrictionEstimate:
    samples, law = problem.samples, problem.law
    design = compute_sensitivities(samples, law, search.linear, search.shape)
    other = _solve_other(problem, search)
    rows, fixed = len(problem.target), [not free for free in problem.is_free]
    fitted = design.shape[1] - sum(fixed)
    told = compute_uncertainty(design, law, search.objective / max(rows - fitted, 1), fixed)
    refused, held = list_refusals(problem, search, told), list_active_bounds(problem, search, told)
    floor = 1e-30 * float(problem.target @ problem.target)
    aicc, bic = compute_criteria(search.objective, rows, told.rank, floor)
    outcome = search.outcome
    if refused and outcome in {Ending.CONVERGED, Ending.STAGNATED}:
        outcome = Ending.SOME_REFUSED
    units = samples.extra_units or ("",) * len(samples.extra_names)
    beside = zip(samples.extra_names, other, told.other, units, strict=True)
    return FrictionEstimate(
        joint=samples.joint,
        law=law.name,
        estimator=estimator,
        parameters=_list_parameters(problem, search, told, refused, held),
        extra=tuple(
            ParameterEstimate(name=name, value=float(value), std=float(std), unit=unit)
            for name, value, std, unit in beside
            if name not in refused
        ),
        refused=tuple(refused.items()),
        linear=tuple(map(float, search.linear)),
        shape=tuple(map(float, search.shape)),
        other=tuple(map(float, other)),
        covariance=tuple(tuple(map(float, row)) for row in told.covariance),
        objective=search.objective,
        sigma=float(np.sqrt(search.objective / max(rows - told.rank, 1))),
        samples=rows,
        evaluations=search.evaluations,
        solves=search.solves,
        iterations=search.iterations,
        outcome=outcome,
        ended=search.ended,
        aicc=aicc,
        bic=bic,
        condition=told.condition,
        history=search.history,
        settings=search.settings,
        notices=list_fit_notices(problem, search, refused, held),
    )


def _solve_other(problem: FrictionProblem, search: FrictionSearch) -> FloatArray:
    """Return what multiplies the columns beside friction, of least norm in scaled columns: (k,)."""
    samples = problem.samples
    if not samples.extra.shape[1]:
        return np.zeros(0)
    friction = compute_friction_torque(problem.law, samples.inputs, list(search.linear), list(search.shape))
    passed = samples.pass_columns(np.column_stack([samples.torque - friction, samples.extra]))
    return solve_scaled(passed[:, 1:], passed[:, 0], rcond=1e-10)


def _list_parameters(
    problem: FrictionProblem,
    search: FrictionSearch,
    told: Uncertainty,
    refused: dict[str, str],
    held: dict[str, str],
) -> tuple[ParameterEstimate, ...]:
    law, prismatic = problem.law, problem.samples.prismatic
    fixed = {entry.name: "fixed" for entry, free in zip(law.shape, problem.is_free, strict=True) if not free}
    reasons = held | fixed
    values = law.to_physical(list(search.linear), list(search.shape))
    return tuple(
        ParameterEstimate(
            name=entry.name,
            value=value,
            std=float(std),
            unit=entry.unit_prismatic if prismatic else entry.unit,
            expression=entry.meaning,
            reason=reasons.get(entry.name, ""),
        )
        for entry, value, std in zip(law.physical, values, told.physical, strict=True)
        if entry.name not in refused
    )
