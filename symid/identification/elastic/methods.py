"""The methods by name, how well each predicts held-out torques, and the automatic choice among them.

    score = mean of ((tau - Y chi) / sigma)^2 over all rows, each predicted by a fit without it
    (chi_nlp - chi_w)' C_w^-1 (chi_nlp - chi_w) <= chi^2_0.999(parameters),   C_w the covariance of chi_w

The yardstick is common to all methods and needs no spring: the sum of motor and link equations in a band,
in units of its noise. Every fold leaves blocks of time out; the dynamics are fitted to the rest, springs
held as they are. Of the methods whose score is not clearly above the least one (two standard errors of
the difference), the one with the smallest standard deviations is taken. The one-shot problem uses most,
for its springs tie the torques of motors and links together, but only where its springs are right: so it
must first agree with the weighted elimination, which needs none (Hausman 1978). Its score is moved by
what linear least squares with its springs make of the rows left out.

Supported: all names of `METHODS`.
Not supported: a choice of springs apart from dynamics; those of the chosen method are taken.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import Notice
from symid.identification.elastic.elimination import (
    BandFit,
    BandRows,
    build_band_rows,
    build_elimination_rows,
    fit_band,
    fit_elimination,
    fit_independent,
    get_wide_cutoff,
    split_recordings,
)
from symid.identification.elastic.estimate import MethodFit
from symid.identification.elastic.options import ElasticOptions
from symid.identification.elastic.problem import (
    ElasticProblem,
    average_sides,
    build_elastic_problem,
    build_method_fit,
    fit_springs,
)
from symid.identification.elastic.regression import (
    compute_window_work,
    filter_smooth,
    prepare_elastic_signals,
    solve_with_signs,
)
from symid.identification.elastic.two_step import (
    compute_square_work,
    fit_alternation,
    fit_linear_spring,
    fit_two_step,
)
from symid.identification.elastic.uncertainty import (
    compute_clustered_covariance,
    mark_unidentifiable,
    measure_identifiability,
)
from symid.joint_models import compute_hysteresis_torque
from symid.logs import Recording

_BLOCKS = 8
_FINE = 50
_CLEAR = 2.0
FOLDS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodCandidate:
    """A method to choose from.

    Args:
        name: of the method.
        refit: gives chi (p + n + pf,) fitted without the rows of one fold.
        spread: the largest relative standard deviation that it states.
    """

    name: str
    refit: Callable[[int], FloatArray]
    spread: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateScore:
    """The prediction error of a method in units of the noise; 1 is what noise alone would leave.

    `doubt` is the standard error of its distance from the least error, `spread` that of the candidate.
    """

    name: str
    error: float
    doubt: float
    spread: float

    def is_close(self, least: float) -> bool:
        """Return whether the error is not clearly above the least one."""
        return self.error - least <= _CLEAR * self.doubt


def assign_folds(time: FloatArray) -> NDArray[np.intp]:
    """Return the fold (m,) of rows at `time` (m,), from 0 to 1 within their recording."""
    blocks = np.minimum((np.asarray(time) * _BLOCKS).astype(np.intp), _BLOCKS - 1)
    folds: NDArray[np.intp] = blocks % FOLDS
    return folds


def choose_candidate(
    candidates: Sequence[MethodCandidate], rows: BandRows, scatter: FloatArray
) -> tuple[str, tuple[CandidateScore, ...]]:
    """Return the name of the best candidate, and all scores.

    Args:
        candidates: at least one, fitted without a fold on demand.
        rows: the common yardstick.
        scatter: (g,) of its groups, N m or N.
    """
    losses = np.stack([_compute_losses(candidate, rows, scatter) for candidate in candidates])
    least = int(np.argmin(losses.mean(axis=1)))
    blocks = rows.group * _FINE + np.minimum((rows.time * _FINE).astype(np.intp), _FINE - 1)
    scores = tuple(
        CandidateScore(
            name=candidate.name,
            error=float(loss.mean()),
            doubt=float(np.linalg.norm(np.bincount(blocks, loss - losses[least])) / len(loss)),
            spread=candidate.spread,
        )
        for candidate, loss in zip(candidates, losses, strict=True)
    )
    close = [score for score in scores if score.is_close(scores[least].error)]
    return min(close, key=lambda score: score.spread).name, scores


def _compute_losses(candidate: MethodCandidate, rows: BandRows, scatter: FloatArray) -> FloatArray:
    """Return the squared prediction error of every row (m,) in units of the noise."""
    folds = assign_folds(rows.time)
    losses = np.empty(len(rows.torque))
    for fold in range(FOLDS):
        held = folds == fold
        errors = rows.torque[held] - rows.design[held] @ candidate.refit(fold)
        losses[held] = (errors / scatter[rows.group[held]]) ** 2
    return losses


ENERGY_METHODS = ("linear-spring", "two-step", "same-cost")
"""The methods whose dynamics come from energy rows."""
_MATTER = 0.05
_FLOOR = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticEquations:
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


def build_elastic_equations(
    library: Library, recordings: tuple[Recording, ...], options: ElasticOptions
) -> ElasticEquations:
    """Return the equations of `recordings`.

    Raises:
        LogError: a recording lacks an encoder, is too short or unevenly sampled.
        UsageError: windows or thresholds do not fit.
    """
    signals = [prepare_elastic_signals(recording, options) for recording in recordings]
    problem = build_elastic_problem(library, signals, options)
    wide = problem
    if any(part.cutoff for part in signals):
        # A cut-off that suits fast sampling would be none for a slow one.
        cutoffs = [get_wide_cutoff(part.period) if part.cutoff else 0.0 for part in signals]
        broad = [
            prepare_elastic_signals(recording, replace(options, cutoff=cutoff))
            for recording, cutoff in zip(recordings, cutoffs, strict=True)
        ]
        wide = build_elastic_problem(library, broad, options)
    rows = build_band_rows(library, wide.signals)
    return ElasticEquations(problem=problem, wide=wide, rows=rows, band=fit_band(library.card, rows))


def fit_method(work: ElasticEquations, method: str) -> MethodFit:
    """Return dynamics and springs by one method, with the covariance of the dynamics.

    What the rows do not tell has an infinite variance.
    """
    two_step = fit_alternation if work.problem.options.scheme == "same-cost" else fit_two_step
    makers: dict[str, Callable[[], MethodFit]] = {
        "linear-spring": lambda: fit_linear_spring(work.problem),
        "two-step": lambda: two_step(work.problem),
        "elimination": lambda: fit_elimination(work.problem),
        "weighted": lambda: _fit_weighted(work),
        "independent": lambda: fit_independent(work.problem),
        "nlp": lambda: _fit_nlp(work),
    }
    fit = makers[method]()
    rows = build_linear_rows(work, fit)
    if fit.covariance is not None:
        return replace(
            fit, covariance=mark_unidentifiable(fit.covariance, measure_identifiability(rows.design)[0])
        )
    errors = rows.right - rows.design @ fit.chi
    return replace(fit, covariance=compute_clustered_covariance(rows.design, errors))


def build_linear_rows(work: ElasticEquations, fit: MethodFit) -> _LinearRows:
    """Return the equations that are linear in the dynamics of `fit`, its springs given."""
    problem = work.problem
    if fit.method in {"elimination", "independent", "nlp"}:
        chosen = split_recordings(problem.signals)[0] if fit.method == "independent" else None
        design, torque = build_elimination_rows(problem, chosen)
        numbers = range(len(problem.signals)) if chosen is None else chosen
        times = [_list_row_times(problem, number) for number in numbers]
        return _LinearRows(design=design, right=torque, time=np.concatenate(times))
    if fit.method == "weighted":
        weights = 1.0 / work.band.scatter[work.rows.group]
        return _LinearRows(
            design=work.rows.design * weights[:, None],
            right=work.rows.torque * weights,
            time=work.rows.time,
        )
    pairs = list(zip(problem.signals, problem.energy, strict=True))
    taken = [compute_window_work(fit.elasticity, signals, rows) for signals, rows in pairs]
    times = [np.arange(len(signals.time))[rows.ends][:-1] / len(signals.time) for signals, rows in pairs]
    return _LinearRows(
        design=problem.design,
        right=problem.supplied - np.concatenate(taken),
        time=np.concatenate(times),
    )


def build_candidate(work: ElasticEquations, fit: MethodFit) -> MethodCandidate:
    """Return `fit` as a candidate whose dynamics can be fitted again without a part of the rows."""
    card = work.problem.library.card
    # What no method can tell does not set them apart.
    told = np.isfinite(np.diag(work.band.covariance))
    spread = float(np.max(compute_relative_deviations(work, fit)[told], initial=0.0))
    count = len(fit.chi)
    offset = np.zeros(count)
    if fit.method == "nlp":
        # Exact where the fit is the least-squares solution of these rows, and near to it the influence of
        # the rows left out.
        rows = _build_side_rows(work.wide, fit)
        offset = fit.chi - solve_with_signs(card, rows.design, rows.right)
    else:
        rows = build_linear_rows(work, fit)
    if fit.method == "linear-spring":
        # Its springs are linear too, and are fitted with the dynamics.
        design = np.hstack([work.problem.design, compute_square_work(work.problem)])
        rows = _LinearRows(design=design, right=work.problem.supplied, time=rows.time)
    folds = assign_folds(rows.time)

    def refit(fold: int) -> FloatArray:
        kept = folds != fold
        chi: FloatArray = offset + solve_with_signs(card, rows.design[kept], rows.right[kept])[:count]
        return chi

    return MethodCandidate(name=fit.method, refit=refit, spread=spread)


def _build_side_rows(problem: ElasticProblem, fit: MethodFit) -> _LinearRows:
    """Return motor and link equations with the springs' torques, each weighted by its scatter."""
    designs, rights, times = [], [], []
    for number, rows in enumerate(problem.filtered):
        spring = compute_spring_torque(problem, fit, number)
        beta = problem.sizes[0]
        design = np.zeros((2, *rows.torque.shape, len(fit.chi)))
        design[0, :, :, beta:], design[1, :, :, :beta] = rows.motor, rows.link
        right = np.stack([rows.torque - spring, spring])
        floor = _FLOOR * max(float(np.sqrt(np.mean(rows.torque**2))), 1e-300)
        scatter = np.maximum(np.sqrt(np.mean((right - design @ fit.chi) ** 2, axis=1)), floor)[:, None, :]
        designs.append((design / scatter[..., None]).reshape(-1, len(fit.chi)))
        rights.append((right / scatter).reshape(-1))
        times.append(np.tile(_list_row_times(problem, number), 2))
    return _LinearRows(
        design=np.concatenate(designs), right=np.concatenate(rights), time=np.concatenate(times)
    )


def compute_spring_torque(problem: ElasticProblem, fit: MethodFit, number: int) -> FloatArray:
    """Return F[tau_J] (M, n) of the springs of `fit` at the filtered rows of recording `number`."""
    signals, keep = problem.signals[number], problem.filtered[number].keep
    torque = [
        compute_hysteresis_torque(spring, signals.phi[:, joint])
        for joint, spring in enumerate(fit.elasticity)
    ]
    filtered: FloatArray = filter_smooth(np.column_stack(torque), problem.options.rate, signals.period)[keep]
    return filtered


def compute_relative_deviations(work: ElasticEquations, fit: MethodFit) -> FloatArray:
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


def _fit_weighted(work: ElasticEquations) -> MethodFit:
    chi = work.band.chi
    springs = fit_springs(work.wide, average_sides(work.wide, chi))
    return build_method_fit(work.problem, "weighted", chi, springs, covariance=work.band.covariance)


def _fit_nlp(work: ElasticEquations) -> MethodFit:
    # Imported here: it needs CasADi, which the other methods do without.
    from symid.identification.elastic.nlp import fit_nlp

    # Hardly filtered states bend its columns least, and its windows average their noise. Where the options
    # fix the places of stops and knees, the start is its own, which keeps them.
    start = _fit_weighted(work) if work.problem.options.moves_stops else None
    return fit_nlp(work.wide, start=start).fit


def _list_row_times(problem: ElasticProblem, number: int) -> FloatArray:
    count = len(problem.signals[number].time)
    times: FloatArray = np.repeat(np.arange(count)[problem.filtered[number].keep] / count, problem.sizes[1])
    return times


AUTOMATIC_METHODS = ("linear-spring", "two-step", "elimination", "weighted", "nlp")
_LEVEL = 0.999


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodSelection:
    """The fit taken, the scores of all that could be, why, and what a reader should know."""

    fit: MethodFit
    scores: tuple[CandidateScore, ...]
    reason: str
    notices: tuple[Notice, ...] = ()


def fit_candidates(work: ElasticEquations) -> tuple[MethodFit, ...]:
    """Return the fits of all methods that the automatic choice compares."""
    return tuple(fit_method(work, method) for method in AUTOMATIC_METHODS)


def choose_fit(work: ElasticEquations, fits: Sequence[MethodFit]) -> MethodSelection:
    """Return the choice among `fits`, at least one of which is usable."""
    usable = [fit for fit in fits if fit.outcome.usable and np.all(np.isfinite(fit.chi))]
    limit = _compute_limit(work)
    kept = [fit for fit in usable if fit.method != "nlp" or _compute_chi2(work, fit) <= limit] or usable
    candidates = [build_candidate(work, fit) for fit in kept]
    best, scores = choose_candidate(candidates, work.rows, work.band.scatter)
    taken = next(score for score in scores if score.name == best)
    close = sum(score.is_close(min(entry.error for entry in scores)) for score in scores)
    among = f"is the surest of the {close} that foretell" if close > 1 else "foretells"
    reason = (
        f"of {len(scores)} methods {best} {among} best the torques that dynamics were not fitted to, springs "
        f"held as found: mean squared error {taken.error:.4g} in units of the noise"
    )
    notices = tuple(
        Notice(
            code="elastic.contradiction",
            text=f"the method {fit.method} contradicts what the motions show without springs (chi^2 "
            f"{_compute_chi2(work, fit):.3g}, limit {limit:.3g}) and was left out of the choice: its springs "
            "do not describe these joints well enough",
        )
        for fit in usable
        if fit not in kept
    )
    return MethodSelection(
        fit=next(fit for fit in kept if fit.method == best), scores=scores, reason=reason, notices=notices
    )


def _compute_chi2(work: ElasticEquations, fit: MethodFit) -> float:
    """Return (chi - chi_w)' C_w^-1 (chi - chi_w)."""
    told = np.flatnonzero(np.isfinite(np.diag(work.band.covariance)))
    covariance = work.band.covariance[np.ix_(told, told)]
    lengths = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    inverse = np.linalg.pinv(covariance / np.outer(lengths, lengths), rcond=1e-12, hermitian=True)
    scaled = (fit.chi - work.band.chi)[told] / lengths
    return float(scaled @ inverse @ scaled)


def _compute_limit(work: ElasticEquations) -> float:
    from scipy.special import chdtri

    count = np.count_nonzero(np.isfinite(np.diag(work.band.covariance)))
    return float(chdtri(count, 1.0 - _LEVEL))
