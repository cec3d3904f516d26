"""The methods by name, run on demand, each on the equations it needs, which are built once.

ElasticWork -> MethodResult: dynamics, springs, and the linear rows that the dynamics were fitted to.

Supported: all names of `options.METHODS` but "automatic".
Not supported: other combinations of dynamics and springs.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.elastic.alternation import fit_alternation
from symid.elastic.band import BandFit, BandRows, build_band_rows, find_wide_cutoff, fit_band
from symid.elastic.choice import Candidate, find_folds
from symid.elastic.consistency import solve_consistent
from symid.elastic.covariance import find_clustered_covariance, find_told, mark_untold
from symid.elastic.elimination import find_elimination_rows, fit_elimination
from symid.elastic.filtered import filter_smooth
from symid.elastic.fit import ElasticFit
from symid.elastic.hysteresis import fit_springs, join_sides
from symid.elastic.independent import fit_independent, split_recordings
from symid.elastic.iteration import find_square_work, fit_linear_spring, fit_two_step
from symid.elastic.options import ElasticOptions
from symid.elastic.problem import ElasticProblem, build_fit, build_problem
from symid.elastic.signals import prepare_elastic_signals
from symid.elastic.spring_weights import build_elasticity
from symid.elastic.windows import find_window_work
from symid.joint.plays import find_hysteresis_torque

__all__ = [
    "ENERGY_METHODS",
    "ElasticWork",
    "build_work",
    "find_candidate",
    "find_linear_rows",
    "find_relative_deviations",
    "find_spring_torque",
    "fit_method",
]

ENERGY_METHODS = ("linear-spring", "two-step", "same-cost")
"""The methods whose dynamics come from energy rows."""
_MATTER = 0.05
_FLOOR = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticWork:
    """The equations of all methods.

    Args:
        problem: at the cut-off of the options; wide: the same recordings at a higher one, each at its own.
        rows, band: the weighted elimination in a band, equations and fit.
    """

    problem: ElasticProblem
    wide: ElasticProblem
    rows: BandRows
    band: BandFit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LinearRows:
    """design @ chi = right, with the time of each row from 0 to 1 within its recording."""

    design: FloatArray
    right: FloatArray
    time: FloatArray


def build_work(library: Library, recordings: tuple[Recording, ...], options: ElasticOptions) -> ElasticWork:
    """Return the equations of `recordings`.

    Raises:
        LogError: a recording lacks an encoder, is too short or unevenly sampled.
        UsageError: windows or thresholds do not fit.
    """
    signals = [prepare_elastic_signals(recording, options) for recording in recordings]
    problem = build_problem(library, signals, options)
    wide = problem
    if any(part.cutoff for part in signals):
        # A cut-off that suits fast sampling would be none for a slow one.
        cutoffs = [find_wide_cutoff(part.period) if part.cutoff else 0.0 for part in signals]
        broad = [
            prepare_elastic_signals(recording, replace(options, cutoff=cutoff))
            for recording, cutoff in zip(recordings, cutoffs, strict=True)
        ]
        wide = build_problem(library, broad, options)
    rows = build_band_rows(library, wide.signals)
    return ElasticWork(problem=problem, wide=wide, rows=rows, band=fit_band(library.card, rows))


def fit_method(work: ElasticWork, method: str) -> ElasticFit:
    """Return dynamics and springs by one method, with the covariance of the dynamics.

    What the rows do not tell has an infinite variance.
    """
    makers: dict[str, Callable[[], ElasticFit]] = {
        "linear-spring": lambda: fit_linear_spring(work.problem),
        "two-step": lambda: _fit_iterated(work.problem),
        "elimination": lambda: fit_elimination(work.problem),
        "weighted": lambda: _fit_weighted(work),
        "independent": lambda: fit_independent(work.problem),
        "nlp": lambda: _fit_nlp(work),
    }
    fit = makers[method]()
    rows = find_linear_rows(work, fit)
    if fit.covariance is not None:
        return replace(fit, covariance=mark_untold(fit.covariance, find_told(rows.design)))
    errors = rows.right - rows.design @ fit.chi
    return replace(fit, covariance=find_clustered_covariance(rows.design, errors))


def find_linear_rows(work: ElasticWork, fit: ElasticFit) -> _LinearRows:
    """Return the equations that are linear in the dynamics of `fit`, its springs given."""
    problem = work.problem
    if fit.method in {"elimination", "independent", "nlp"}:
        chosen = split_recordings(problem.signals)[0] if fit.method == "independent" else None
        design, torque = find_elimination_rows(problem, chosen)
        numbers = range(len(problem.signals)) if chosen is None else chosen
        times = [_find_row_times(problem, number) for number in numbers]
        return _LinearRows(design=design, right=torque, time=np.concatenate(times))
    if fit.method == "weighted":
        weights = 1.0 / work.band.scatter[work.rows.group]
        return _LinearRows(
            design=work.rows.design * weights[:, None],
            right=work.rows.torque * weights,
            time=work.rows.time,
        )
    pairs = list(zip(problem.signals, problem.energy, strict=True))
    taken = [find_window_work(fit.elasticity, signals, rows) for signals, rows in pairs]
    times = [np.arange(len(signals.time))[rows.ends][:-1] / len(signals.time) for signals, rows in pairs]
    return _LinearRows(
        design=problem.design,
        right=problem.supplied - np.concatenate(taken),
        time=np.concatenate(times),
    )


def find_candidate(work: ElasticWork, fit: ElasticFit) -> Candidate:
    """Return `fit` as a candidate whose dynamics can be fitted again without a part of the rows."""
    card = work.problem.library.card
    # What no method can tell does not set them apart.
    told = np.isfinite(np.diag(work.band.covariance))
    spread = float(np.max(find_relative_deviations(work, fit)[told], initial=0.0))
    if fit.method == "nlp":
        return Candidate(name=fit.method, refit=_refit_around(work, fit), spread=spread)
    rows = find_linear_rows(work, fit)
    folds = find_folds(rows.time)
    if fit.method == "linear-spring":
        # Its springs are linear too, and are fitted with the dynamics.
        rows = replace(rows, design=np.hstack([work.problem.design, find_square_work(work.problem)]))
        rows = replace(rows, right=work.problem.supplied)
    count = len(fit.chi)

    def refit(fold: int) -> FloatArray:
        kept = folds != fold
        return solve_consistent(card, rows.design[kept], rows.right[kept])[:count]

    return Candidate(name=fit.method, refit=refit, spread=spread)


def _refit_around(work: ElasticWork, fit: ElasticFit) -> Callable[[int], FloatArray]:
    """Return what gives the dynamics of `fit` without the rows of one fold, its springs held.

    chi + (LS of the rows kept - LS of all rows), motor and link equations with the springs' torques, each
    weighted by its scatter: exact where the fit is that least-squares solution, and near to it the influence
    of the rows left out.
    """
    parts = [_build_side_rows(work.wide, fit, number) for number in range(len(work.wide.signals))]
    design, right, time = (np.concatenate(entries) for entries in zip(*parts, strict=True))
    card, folds = work.problem.library.card, find_folds(time)
    whole = solve_consistent(card, design, right)

    def refit(fold: int) -> FloatArray:
        kept = folds != fold
        moved: FloatArray = fit.chi + solve_consistent(card, design[kept], right[kept]) - whole
        return moved

    return refit


def _build_side_rows(
    problem: ElasticProblem, fit: ElasticFit, number: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return weighted motor and link rows (2 M n, p + n + pf), right sides and times of one recording."""
    beta = problem.sizes[0]
    rows = problem.filtered[number]
    spring = find_spring_torque(problem, fit, number)
    design = np.zeros((2, *rows.torque.shape, len(fit.chi)))
    design[0, :, :, beta:], design[1, :, :, :beta] = rows.motor, rows.link
    right = np.stack([rows.torque - spring, spring])
    floor = _FLOOR * max(float(np.sqrt(np.mean(rows.torque**2))), 1e-300)
    scatter = np.maximum(np.sqrt(np.mean((right - design @ fit.chi) ** 2, axis=1)), floor)[:, None, :]
    times = np.tile(_find_row_times(problem, number), 2)
    return (design / scatter[..., None]).reshape(-1, len(fit.chi)), (right / scatter).reshape(-1), times


def find_spring_torque(problem: ElasticProblem, fit: ElasticFit, number: int) -> FloatArray:
    """Return F[tau_J] (M, n) of the springs of `fit` at the filtered rows of recording `number`."""
    signals, keep = problem.signals[number], problem.filtered[number].keep
    torque = [
        find_hysteresis_torque(spring, signals.phi[:, joint]) for joint, spring in enumerate(fit.elasticity)
    ]
    filtered: FloatArray = filter_smooth(np.column_stack(torque), problem.options.rate, signals.period)[keep]
    return filtered


def find_relative_deviations(work: ElasticWork, fit: ElasticFit) -> FloatArray:
    """Return the standard deviation of every dynamic parameter relative to its size (p + n + pf,).

    A parameter near zero is measured by what would matter: 5 % of a joint's torque through its column alone.
    """
    if fit.covariance is None:
        return np.full(len(fit.chi), np.inf)
    size = work.problem.sizes[1]
    design, torque = work.rows.design, work.rows.torque
    matter = np.full(len(fit.chi), np.inf)
    for joint in range(size):
        own = work.rows.group % size == joint
        lengths = np.linalg.norm(design[own], axis=0)
        seen = lengths > 0.0
        matter[seen] = np.minimum(matter[seen], _MATTER * np.linalg.norm(torque[own]) / lengths[seen])
    matter[~np.isfinite(matter)] = 0.0
    deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    relative: FloatArray = deviations / np.maximum(np.maximum(np.abs(fit.chi), matter), 1e-300)
    return relative


def _fit_iterated(problem: ElasticProblem) -> ElasticFit:
    if problem.options.scheme == "same-cost":
        return fit_alternation(problem)
    return fit_two_step(problem)


def _fit_weighted(work: ElasticWork) -> ElasticFit:
    chi = work.band.chi
    springs = fit_springs(work.wide, join_sides(work.wide, chi))
    return build_fit(
        work.problem,
        "weighted",
        chi,
        tuple(map(build_elasticity, springs)),
        covariance=work.band.covariance,
    )


def _fit_nlp(work: ElasticWork) -> ElasticFit:
    # Imported here: it needs CasADi, which the other methods do without.
    from symid.elastic.nlp import fit_nlp

    # Hardly filtered states bend its columns least, and its windows average their noise. Where the options
    # fix the places of stops and knees, the start is its own, which keeps them.
    options = work.problem.options
    start = _fit_weighted(work) if options.refine and options.thresholds is None else None
    return fit_nlp(work.wide, start=start).fit


def _find_row_times(problem: ElasticProblem, number: int) -> FloatArray:
    count = len(problem.signals[number].time)
    times: FloatArray = np.repeat(np.arange(count)[problem.filtered[number].keep] / count, problem.sizes[1])
    return times
