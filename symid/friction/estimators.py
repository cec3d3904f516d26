"""Friction of one joint, fitted by any estimator: the same objective, the same report.

FrictionSamples, FrictionLaw -> FrictionEstimate.

    problem (one for all) -> search (the estimator) -> uncertainty -> refusals, notices -> estimate

Supported: the estimators in `ESTIMATORS`; "varpro" is the default for its exact optimum and its few solves.
Not supported: several joints at once.
"""

import difflib
from collections.abc import Callable

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, SolverError, UsageError
from symid.estimators.estimate import ParameterEstimate
from symid.friction.covariance import Uncertainty, find_design, find_uncertainty
from symid.friction.criteria import find_aicc, find_bic
from symid.friction.doubts import find_active, find_notices, find_refusals
from symid.friction.estimate import FrictionEstimate, FrictionOutcome
from symid.friction.options import FrictionOptions
from symid.friction.problem import FrictionProblem, build_problem
from symid.friction.samples import FrictionSamples
from symid.friction.search import FrictionSearch
from symid.joint.friction_law import FrictionLaw, find_torque

__all__ = ["ESTIMATORS", "STOCHASTIC", "check_estimator", "fit_friction", "search_friction"]

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
    # A law without shape values to search is a linear problem, whatever the estimator.
    if estimator in STOCHASTIC and generator is None:
        generator = np.random.default_rng(options.seed)
    return _load_search(estimator, options)(problem, generator)


Search = Callable[[FrictionProblem, np.random.Generator | None], FrictionSearch]


def _load_search(estimator: str, options: FrictionOptions) -> Search:
    """Return the search; modules of heavy packages are loaded only where they are asked for."""
    match estimator:
        case "varpro":
            from symid.friction.variable_projection import search_by_projection

            return lambda problem, _: search_by_projection(problem, options.variable_projection)
        case "root-finding":
            from symid.friction.root_finding import search_by_roots

            return lambda problem, _: search_by_roots(problem, options.root_finding)
        case "nlp":
            from symid.friction.nlp import search_by_nlp

            return lambda problem, _: search_by_nlp(problem, options.nlp)
        case "genetic":
            from symid.friction.genetic import search_by_genes

            return lambda problem, generator: search_by_genes(problem, options.genetic, _expect(generator))
        case "annealing":
            from symid.friction.annealing import search_by_annealing

            return lambda problem, generator: search_by_annealing(
                problem, options.annealing, _expect(generator)
            )
    from symid.friction.evolution import search_by_evolution

    return lambda problem, generator: search_by_evolution(problem, options.evolution, _expect(generator))


def _expect(generator: np.random.Generator | None) -> np.random.Generator:
    return np.random.default_rng(0) if generator is None else generator


def _build_estimate(problem: FrictionProblem, search: FrictionSearch, estimator: str) -> FrictionEstimate:
    samples, law = problem.samples, problem.law
    design = find_design(samples, law, search.linear, search.shape)
    other = _find_other(problem, search)
    rows, fixed = len(problem.target), [not free for free in problem.is_free]
    fitted = design.shape[1] - sum(fixed)
    told = find_uncertainty(design, law, search.objective / max(rows - fitted, 1), fixed)
    refused, held = find_refusals(problem, search, told), find_active(problem, search, told)
    floor = 1e-30 * float(problem.target @ problem.target)
    outcome = search.outcome
    if refused and outcome in {FrictionOutcome.CONVERGED, FrictionOutcome.STAGNATED}:
        outcome = FrictionOutcome.SOME_REFUSED
    return FrictionEstimate(
        joint=samples.joint,
        law=law.name,
        estimator=estimator,
        parameters=_list_parameters(problem, search, told, refused, held),
        extra=_list_extra(samples, other, told, refused),
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
        aicc=find_aicc(search.objective, rows, told.rank, floor),
        bic=find_bic(search.objective, rows, told.rank, floor),
        condition=told.condition,
        history=search.history,
        settings=search.settings,
        notices=find_notices(problem, search, refused, held),
    )


def _find_other(problem: FrictionProblem, search: FrictionSearch) -> FloatArray:
    """Return what multiplies the columns beside friction, of least norm in scaled columns: (k,)."""
    samples = problem.samples
    if not samples.extra.shape[1]:
        return np.zeros(0)
    friction = find_torque(problem.law, samples.inputs, list(search.linear), list(search.shape))
    passed = samples.pass_columns(np.column_stack([samples.torque - friction, samples.extra]))
    lengths = np.linalg.norm(passed[:, 1:], axis=0)
    lengths[lengths == 0.0] = 1.0
    solution: FloatArray = np.linalg.lstsq(passed[:, 1:] / lengths, passed[:, 0], rcond=1e-10)[0] / lengths
    return solution


def _list_parameters(
    problem: FrictionProblem,
    search: FrictionSearch,
    told: Uncertainty,
    refused: dict[str, str],
    held: dict[str, str],
) -> tuple[ParameterEstimate, ...]:
    law, prismatic = problem.law, problem.samples.prismatic
    fixed = {entry.name for entry, free in zip(law.shape, problem.is_free, strict=True) if not free}
    values = law.to_physical(list(search.linear), list(search.shape))
    return tuple(
        ParameterEstimate(
            name=entry.name,
            value=value,
            std=float(std),
            unit=entry.unit_prismatic if prismatic else entry.unit,
            expression=entry.meaning,
            reason="fixed" if entry.name in fixed else held.get(entry.name, ""),
        )
        for entry, value, std in zip(law.physical, values, told.physical, strict=True)
        if entry.name not in refused
    )


def _list_extra(
    samples: FrictionSamples, other: FloatArray, told: Uncertainty, refused: dict[str, str]
) -> tuple[ParameterEstimate, ...]:
    units = samples.extra_units or ("",) * len(samples.extra_names)
    return tuple(
        ParameterEstimate(name=name, value=float(value), std=float(std), unit=unit)
        for name, value, std, unit in zip(samples.extra_names, other, told.other, units, strict=True)
        if name not in refused
    )
