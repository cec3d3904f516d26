"""A friction law fitted to one joint, and which of its parameters are identifiable.

FrictionSamples, FrictionLaw -> problem (one for all) -> search (the estimator) -> FrictionEstimate

A parameter is refused where the columns of the law are dependent on these samples (also where noise alone
makes them independent: one speed, one direction); where the law without the term explains the samples as
well (chi-square); where no row is slower than the Stribeck velocity; where the deviation of a shape value
exceeds 30 % of it; where only refused terms depend on it. "varpro" is the default estimator for its
exact optimum and its few solves.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from symid import joint_models
from symid.arrays import FloatArray, compute_triangle
from symid.errors import Notice, SolverError, UsageError
from symid.identification.estimators import ParameterEstimate
from symid.identification.friction import joint_fit, searches
from symid.identification.friction.joint_fit import FrictionEstimate, FrictionSamples, FrictionSearch
from symid.identification.friction.presliding import fit_memory
from symid.identification.friction.searches import (
    SPEED_UNITS,
    FrictionOptions,
    FrictionProblem,
    build_problem,
)
from symid.identification.judge import POLICY, numerics
from symid.identification.regression import solve_scaled
from symid.ipopt import Ending


def list_refusals(
    problem: FrictionProblem, search: FrictionSearch, uncertainty: joint_fit.Uncertainty
) -> dict[str, str]:
    """Return the reason for every parameter, of the law and beside it, that is refused."""
    law, samples = problem.law, problem.samples
    names = [*(entry.name for entry in law.physical), *samples.extra_names]
    refused: dict[str, str] = {}
    # What the motion lacks, and samples without the motion of noise.
    rows = samples.rows.velocity
    unit = "m/s" if samples.prismatic else "rad/s"
    speeds, lacks, moved, cases = np.abs(rows[rows != 0.0]), list[str](), samples, [uncertainty]
    if joint_fit.is_one_sided(rows):
        direction = 1.0 if np.sum(rows > 0.0) > np.sum(rows < 0.0) else -1.0
        moved, speeds = samples.take(samples.velocity * direction > 0.0), np.abs(rows[rows * direction > 0.0])
        lacks.append(f"in the {'positive' if direction > 0.0 else 'negative'} direction only")
    if len(speeds):
        middle = float(np.median(speeds))
        if float(np.subtract(*np.quantile(speeds, (0.975, 0.025)))) <= 0.05 * middle:
            lacks.append(f"at one speed only, {middle:.3g} {unit}")
            moved = replace(moved, velocity=np.sign(moved.velocity) * middle, reduce=None)
    lack = f"the joint moved {' and '.join(lacks)}" if len(speeds) and lacks else ""
    if lack:
        design = joint_fit.compute_sensitivities(moved, law, search.linear, search.shape)
        cases.append(joint_fit.compute_uncertainty(design, law, 1.0, list(~problem.is_free)))
    reason = lack or "the columns are linearly dependent on these samples"
    for case in cases:
        lost = np.isinf(np.concatenate([case.physical, case.other]))
        together = [name for name, gone in zip(names, lost, strict=True) if gone]
        for name in together:
            others = ", ".join(other for other in together if other != name)
            end = f"it cannot be separated from {others}" if others else "it has no effect"
            refused.setdefault(name, f"{reason}: {end}")
    refused |= {k: v for k, v in _refuse_shapes(problem, search, unit).items() if k not in refused}
    values = law.to_physical(search.linear, search.shape)
    # Shape values, and what depends on a refused one, with large deviations.
    shapes = {entry.name for entry, free in zip(law.shape, problem.is_free, strict=True) if free}
    # A value at its bound is known with the bound, and may well be zero.
    known = {*refused, *(list_active_bounds(problem, search, uncertainty).keys() - shapes)}
    # Values of the shape first: where one is refused, the terms that it bends are uncertain as well.
    for bends in (True, False):
        bent = bool(shapes & refused.keys())
        for entry, value, std in zip(law.physical, values, uncertainty.physical, strict=True):
            other = entry.name.startswith("fS") or (bent and entry.lower == 0.0)
            checked = entry.name in shapes if bends else other and entry.name not in shapes
            if checked and entry.name not in known and 100.0 * std > POLICY.uncertain * abs(value):
                size = f"{std:.3g} {entry.unit_prismatic if samples.prismatic else entry.unit}"
                text = f"its standard deviation, {size}, exceeds {POLICY.uncertain:g} % of its value"
                refused[entry.name] = text
    place = next((k for k, entry in enumerate(law.shape) if entry.name == "dq0"), None)
    if place is not None and "dq0" in refused:
        # What acts only inside the zone about standstill is refused with the zone.
        beyond = np.abs(samples.velocity) >= search.shape[place]
        columns = joint_models.compute_columns(law, samples.inputs, search.shape)
        inside = np.flatnonzero(~np.any(columns[beyond], axis=0)).tolist()
        reason = f"it acts only inside the zone about standstill, and {refused['dq0']}"
        for name in _list_dependents(law, inside, []):
            refused.setdefault(name, reason)
    return refused


def _refuse_shapes(problem: FrictionProblem, search: FrictionSearch, unit: str) -> dict[str, str]:
    """Return the reason for every shape value, and what depends on it, that the samples do not show."""
    law, samples = problem.law, problem.samples
    refused: dict[str, str] = {}
    rates = joint_models.compute_column_derivatives(law, samples.inputs, search.shape)
    size = np.max(np.abs(rates), axis=0, initial=0.0)
    whole = problem.compute_columns(search.shape)
    freedom = max(len(problem.target) - len(law.physical) - len(samples.extra_names), 1)
    variance = search.objective / freedom
    slowest = float(np.min(np.abs(samples.rows.velocity)))
    free = np.flatnonzero(problem.is_free).tolist()
    for place in free:
        entry, value = law.shape[place], float(search.shape[place])
        terms = np.flatnonzero(size[:, place] > 0.0).tolist()
        if entry.name == "dq0":
            edge = np.array(search.shape)
            edge[place] = problem.low[place]
            if _is_as_good(problem, search, problem.compute_columns(edge), variance, 1):
                refused[entry.name] = "a law without a zone about standstill explains the samples as well"
            continue
        reason = ""
        if entry.name == "vs" and slowest >= value:
            reason = f"no sample is slower than the Stribeck velocity; the slowest is at {slowest:.3g} {unit}"
        elif entry.unit in SPEED_UNITS and locate_edge(problem, search, place):
            reason = f"{entry.name} is at the limit of the speeds sampled, {value:.3g} {unit}"
        elif _is_as_good(problem, search, np.delete(whole, terms, axis=1), variance, len(terms) + 1):
            reason = "the law without this term explains the samples as well"
            if entry.name == "vs":
                reason += f"; it acts at low speeds, and the slowest sample is at {slowest:.3g} {unit}"
        if reason:
            inner = [k for k in free if not np.any(np.delete(size[:, k], terms))]
            for name in _list_dependents(law, terms, [place, *inner]):
                refused.setdefault(name, reason)
    return refused


def _list_dependents(law: joint_models.FrictionLaw, terms: list[int], places: list[int]) -> list[str]:
    """Return names of physical parameters that hold one of the shape values or of the linear terms."""
    lost = {*terms, *(len(law.linear) + place for place in places)}
    entries = zip(law.physical, law.mixing, strict=True)
    return [entry.name for entry, row in entries if any(row[index] for index in lost)]


def _is_as_good(
    problem: FrictionProblem, search: FrictionSearch, columns: FloatArray, variance: float, freedom: int
) -> bool:
    """Return whether fewer columns leave J no greater than chance explains."""
    residual = problem.target
    if columns.shape[1]:
        residual = residual - columns @ solve_scaled(columns, residual, rcond=1e-11)
    gain = float(residual @ residual) - search.objective
    rounding = 1e-20 * float(problem.target @ problem.target)
    return gain <= float(scipy.special.chdtri(freedom, POLICY.alarm)) * variance + rounding


def list_fit_notices(
    problem: FrictionProblem, search: FrictionSearch, refused: dict[str, str], held: dict[str, str]
) -> tuple[Notice, ...]:
    """Return the warnings of a fit; `held` is what `list_active_bounds` found."""
    law = problem.law
    found = [("refused", f"{name} is not identifiable: {reason}") for name, reason in refused.items()]
    rows = problem.samples.rows.velocity
    if joint_fit.is_one_sided(rows):
        text = "the joint moves in one direction only: friction in the other direction is not identifiable"
        found.append(("one-direction", text))
    for entry, value in zip(law.shape, search.shape, strict=True):
        slow = int(np.sum(np.abs(rows) < 2.0 * value))
        if entry.name == "vs" and slow < POLICY.folds * POLICY.parts:
            text = f"only {slow} samples are slower than twice the Stribeck velocity, too few for "
            text += "cross-validation: static friction depends on them. Record slower motions"
            found.append(("few-slow", text))
    found += [("at-bound", f"{name} is {text}") for name, text in held.items() if name not in refused]
    # Static friction less Coulomb friction.
    named = zip(law.linear, search.linear, strict=True)
    bumps = [value for entry, value in named if entry.name in {"Fe", "Fep", "Fen", "Fle"}]
    if min(bumps, default=0.0) < 0.0 and not any(name.startswith(("fS", "fE")) for name in refused):
        text = "static friction is estimated below Coulomb friction. This joint may have no break-away "
        text += "friction, or filters smooth the reversal: record slower motions"
        found.append(("static-below-coulomb", text))
    values = law.to_physical(search.linear, search.shape)
    for entry, value in zip(law.physical, values, strict=True):
        if value < entry.lower and entry.name not in refused:
            text = f"{entry.name} = {value:.4g} is below its physical bound, {entry.lower:g}"
            found.append(("beyond-bound", f"{text}; the estimator 'nlp' keeps bounds"))
    if search.outcome not in {Ending.CONVERGED, Ending.STAGNATED}:
        text = f"the search did not converge: {search.ended} ({search.outcome.value})"
        found.append(("outcome", text))
    return tuple(Notice(code=f"friction.{code}", text=text) for code, text in found)


def list_active_bounds(
    problem: FrictionProblem, search: FrictionSearch, uncertainty: joint_fit.Uncertainty
) -> dict[str, str]:
    """Return the physical parameters with an active bound, and which: "at its lower bound, 0: ...".

    That of a linear one is active within two hundredths of its deviation, where J falls beyond.
    """
    law, held = problem.law, {}
    values = law.to_physical(search.linear, search.shape)
    columns = problem.compute_columns(search.shape)
    slope = -columns.T @ (problem.target - columns @ search.linear)
    slopes = slope @ np.array(law.unmixing, dtype=np.float64)[: len(slope)]
    variance = search.objective / max(len(problem.target) - uncertainty.rank, 1)
    places = {entry.name: place for place, entry in enumerate(law.shape)}
    for k, entry in enumerate(law.physical):
        std, bounds = float(uncertainty.physical[k]), {"lower": entry.lower, "upper": entry.upper}
        if entry.name in places:
            place = places[entry.name]
            side = locate_edge(problem, search, place)
            bounds = {"lower": problem.low[place], "upper": problem.high[place]}
        elif not np.isfinite(std) or abs(slopes[k]) * std <= POLICY.relevance * variance:
            continue
        else:
            side = "lower" if slopes[k] > 0.0 else "upper"
            side = side if abs(values[k] - bounds[side]) <= POLICY.relevance * std else ""
        if side:
            bound = bounds[side]
            held[entry.name] = f"at its {side} bound, {bound:.4g}: the optimum lies beyond"
    return held


def locate_edge(problem: FrictionProblem, search: FrictionSearch, place: int) -> str:
    """Return "lower" or "upper" where a shape value is at that bound of its search, else ""."""
    if not problem.is_free[place]:
        return ""
    z, low, high = (problem.encode(values)[place] for values in (search.shape, problem.low, problem.high))
    if z - low <= numerics.CONVERGED * (high - low):
        return "lower"
    return "upper" if high - z <= numerics.CONVERGED * (high - low) else ""


DEFAULT_ESTIMATOR = "varpro"
SEARCHES = {DEFAULT_ESTIMATOR: searches.search_by_projection, "nlp": searches.search_by_nlp}
"""The estimators by name."""


def fit_friction(
    samples: FrictionSamples,
    law: joint_models.FrictionLaw,
    *,
    estimator: str = DEFAULT_ESTIMATOR,
    options: FrictionOptions | None = None,
) -> FrictionEstimate:
    """Return the law's parameters and their uncertainty; those of a law with a state need positions.

    `estimator` is one of `SEARCHES`.

    Raises:
        UsageError: no such estimator, or one that cannot fit this law to these samples.
        IdentifiabilityError: nothing is identifiable.
        SolverError: the search ended without usable numbers.
    """
    options = options or FrictionOptions()
    check_estimator(estimator, law)
    if law.memory:
        return fit_memory(samples, law).estimate
    problem = build_problem(samples, law, options)
    return build_estimate(problem, SEARCHES[estimator](problem, options), estimator)


def check_estimator(estimator: str, law: joint_models.FrictionLaw | None = None) -> None:
    """Raise UsageError for an unknown estimator, or one that cannot fit a law."""
    if law is not None and law.memory and (estimator != DEFAULT_ESTIMATOR or law.smoothing):
        text = f"friction model {law.name!r} has a state: it is fitted without smoothing, by the estimator "
        text += f"{DEFAULT_ESTIMATOR!r}; leave these options out"
        raise UsageError(Notice(code="usage.friction-state", text=text))
    if estimator not in SEARCHES:
        text = f"unknown estimator {estimator!r} of friction; choose one of {', '.join(SEARCHES)}"
        raise UsageError(Notice(code="usage.friction-estimator", text=text))


def build_estimate(problem: FrictionProblem, search: FrictionSearch, estimator: str) -> FrictionEstimate:
    """Return what the end of a search says; raise SolverError where that is nothing."""
    samples, law = problem.samples, problem.law
    if not search.outcome.usable:
        text = f"estimator {estimator!r}, joint {samples.joint!r}: {search.ended} ({search.outcome.value})"
        raise SolverError(Notice(code="friction.solver", text=text))
    # p + s + r rows with the lengths and angles of all columns; factors of least norm beside the law.
    beside = samples.beside
    law_columns = joint_models.compute_law_sensitivities(law, samples.inputs, search.linear, search.shape)
    own = samples.pass_columns(law_columns)
    inside = beside.basis.T @ own
    rest = compute_triangle(own - beside.basis @ inside)
    below = np.zeros((len(rest), beside.parts.shape[1]))
    design = np.vstack([np.hstack([inside, beside.parts]), np.hstack([rest, below])])
    left = samples.rows.torque - samples.pass_law(law, search.shape) @ np.asarray(search.linear)
    other = beside.factors @ (beside.basis.T @ left)
    rows, fixed = len(problem.target), (~problem.is_free).tolist()
    fitted = design.shape[1] - sum(fixed)
    uncertainty = joint_fit.compute_uncertainty(design, law, search.objective / max(rows - fitted, 1), fixed)
    refused = list_refusals(problem, search, uncertainty)
    held = list_active_bounds(problem, search, uncertainty)
    reasons = held | {entry.name: "fixed" for entry, known in zip(law.shape, fixed, strict=True) if known}
    floor = 1e-30 * float(problem.target @ problem.target)
    aicc, bic = joint_fit.compute_criteria(max(search.objective, floor), rows, uncertainty.rank)
    values = law.to_physical(search.linear, search.shape)
    parameters, units = [], samples.extra_units or ("",) * len(samples.extra_names)
    for entry, value, std in zip(law.physical, values, uncertainty.physical.tolist(), strict=True):
        unit, reason = entry.unit_prismatic if samples.prismatic else entry.unit, reasons.get(entry.name, "")
        parameters.append(ParameterEstimate(entry.name, value, std, unit, entry.meaning, reason))
    pairs = zip(samples.extra_names, other.tolist(), uncertainty.other.tolist(), units, strict=True)
    ended: dict[str, Any] = search._asdict()
    if refused and search.outcome in {Ending.CONVERGED, Ending.STAGNATED}:
        ended["outcome"] = Ending.SOME_REFUSED
    return FrictionEstimate(
        **ended,
        joint=samples.joint,
        law=law.name,
        estimator=estimator,
        parameters=tuple(entry for entry in parameters if entry.name not in refused),
        extra=tuple(ParameterEstimate(*entry) for entry in pairs if entry[0] not in refused),
        refused=tuple(refused.items()),
        other=tuple(map(float, other)),
        covariance=tuple(tuple(map(float, row)) for row in uncertainty.covariance),
        sigma=float(np.sqrt(search.objective / max(rows - uncertainty.rank, 1))),
        samples=rows,
        aicc=aicc,
        bic=bic,
        condition=uncertainty.condition,
        notices=list_fit_notices(problem, search, refused, held),
    )
