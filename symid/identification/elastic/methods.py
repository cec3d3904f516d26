"""The methods by name, how well each predicts held-out torques, and the automatic choice among them.

    score = mean of ((tau - Y chi) / sigma)^2 over all rows, each predicted by a fit without it
    (chi_nlp - chi_w)' C_w^-1 (chi_nlp - chi_w) <= chi^2_0.999(parameters),   C_w the covariance of chi_w

Rows are the sum of motor and link equations in a band. Every fold leaves blocks of time out, springs held as
they are. Of the methods whose score is within two standard errors of the least one, that of the smallest
deviations is taken. The one-shot problem must first agree with the weighted elimination (Hausman 1978).

Supported: all names of `METHODS`.
Not supported: a choice of springs apart from dynamics; those of the chosen method are taken.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import Notice
from symid.identification.diagnostics import (
    choose_held_out,
)
from symid.identification.elastic.effects import (
    compute_link_torque,
    measure_effects,
    measure_gears,
    measure_offsets,
)
from symid.identification.elastic.elimination import (
    BandFit,
    BandRows,
    build_band_rows,
    choose_sliding_rows,
    compute_speeds,
    fit_band,
    fit_elimination,
    fit_independent,
    get_effect_edge,
    get_wide_cutoff,
    split_recordings,
)
from symid.identification.elastic.estimate import MethodFit, build_method_fit
from symid.identification.elastic.options import ElasticOptions
from symid.identification.elastic.regression import (
    DriveEffect,
    ElasticProblem,
    ElasticSignals,
    build_elastic_problem,
    choose_cutoff,
    compute_joint_torque,
    measure_motion_band,
    prepare_elastic_signals,
    solve_with_signs,
)
from symid.identification.elastic.two_step import fit_alternation, fit_linear_spring, fit_two_step
from symid.identification.elastic.uncertainty import (
    compute_covariance,
    mark_unidentifiable,
    measure_identifiability,
)
from symid.identification.hysteresis import ElementPath, choose_spring, filter_smooth
from symid.logs import Recording, differentiate_smooth

if TYPE_CHECKING:
    from symid.identification.elastic.nlp import NlpFit

_BLOCKS = 8
_FINE = 50
_CLEAR = 2.0
FOLDS = 4


class MethodCandidate(NamedTuple):
    """A method: its chi (p + n + pf,) without the rows of a fold, its largest relative deviation."""

    refit: Callable[[int], FloatArray]
    spread: float


def assign_folds(time: FloatArray) -> NDArray[np.intp]:
    """Return the fold (m,) of rows at `time` (m,), from 0 to 1 within their recording."""
    blocks = np.minimum((np.asarray(time) * _BLOCKS).astype(np.intp), _BLOCKS - 1)
    folds: NDArray[np.intp] = blocks % FOLDS
    return folds


def choose_candidate(
    candidates: Sequence[MethodCandidate], rows: BandRows, scatter: FloatArray
) -> tuple[int, FloatArray, int]:
    """Return the place of the best candidate, the errors (c,) of all, and how many are as good as the best.

    An error is the mean squared one in units of the noise, `scatter` (g,) of the groups of rows, N m or N; 1
    is what noise alone would leave. All candidates are compared on the same rows.
    """
    folds = assign_folds(rows.time)
    blocks = rows.group * _FINE + np.minimum((rows.time * _FINE).astype(np.intp), _FINE - 1)
    losses = []
    for candidate in candidates:
        errors = np.empty(len(rows.torque))
        for fold in range(FOLDS):
            held = folds == fold
            errors[held] = rows.torque[held] - rows.design[held] @ candidate.refit(fold)
        losses.append(np.bincount(blocks, (errors / scatter[rows.group]) ** 2))
    choice = choose_held_out(np.array(losses), [entry.spread for entry in candidates], _CLEAR)
    means = np.sum(losses, axis=1) / len(blocks)
    return choice.taken, means, int(np.count_nonzero(choice.behind <= _CLEAR))


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
        effects: of the drives, taken off the torque of all.
    """

    problem: ElasticProblem
    wide: ElasticProblem
    rows: BandRows
    band: BandFit
    effects: tuple[DriveEffect, ...] = ()

    @property
    def identifiable(self) -> NDArray[np.bool_]:
        """Return which parameters (p + n + pf,) the weighted elimination identifies."""
        return np.isfinite(np.diag(self.band.covariance))


class _LinearRows(NamedTuple):
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
    band = measure_motion_band(recordings)
    broad = _prepare_wide(recordings, options, band)
    effects: tuple[DriveEffect, ...] = ()
    if options.effects:
        edge = get_effect_edge(max(part.period for part in broad), band)
        effects = measure_effects(library, broad, edge)
        broad = _prepare_wide(recordings, options, band, effects) if effects else broad
    rows, share = choose_sliding_rows(library.card, build_band_rows(library, broad, band))
    if options.effects:
        beta = fit_band(library.card, rows).chi[: len(library.card.beta)]
        for measure in (measure_offsets, measure_gears):
            further = measure(library, broad, beta)
            if further:
                effects = (*effects, *further)
                broad = _prepare_wide(recordings, options, band, effects)
    limits = share * compute_speeds(broad)
    signals = [prepare_elastic_signals(recording, options, effects) for recording in recordings]
    problem = build_elastic_problem(library, signals, options, limits)
    wide = problem
    if any(part.cutoff for part in signals):
        wide = build_elastic_problem(library, broad, options, limits)
    fit = fit_band(library.card, rows)
    return ElasticEquations(problem=problem, wide=wide, rows=rows, band=fit, effects=effects)


def _prepare_wide(
    recordings: Sequence[Recording],
    options: ElasticOptions,
    band: float,
    effects: Sequence[DriveEffect] = (),
) -> list[ElasticSignals]:
    """Return signals that pass what `get_wide_cutoff` says, or no filter where the options' pass none."""
    broad = []
    for recording in recordings:
        filtered = choose_cutoff(recording) if options.cutoff is None else options.cutoff
        # A cut-off that suits fast sampling would be none for a slow one.
        cutoff = get_wide_cutoff(recording.period, band) if filtered else 0.0
        broad.append(prepare_elastic_signals(recording, replace(options, cutoff=cutoff), effects))
    return broad


def fit_method(work: ElasticEquations, method: str) -> MethodFit:
    """Return dynamics and springs by one method, with the covariance of the dynamics.

    What the rows do not identify has an infinite variance.
    """
    makers: dict[str, Callable[[ElasticProblem], MethodFit]] = {
        "linear-spring": fit_linear_spring,
        "two-step": fit_alternation if work.problem.options.scheme == "same-cost" else fit_two_step,
        "elimination": fit_elimination,
        "weighted": lambda _: _fit_weighted(work),
        "independent": fit_independent,
    }
    fit = fit_one_shot(work).fit if method == "nlp" else makers[method](work.problem)
    rows = build_linear_rows(work, fit)
    if fit.covariance is None:
        return replace(fit, covariance=compute_covariance(rows.design, rows.right - rows.design @ fit.chi))
    identifiable, _ = measure_identifiability(rows.design)
    return replace(fit, covariance=mark_unidentifiable(fit.covariance, identifiable))


def fit_one_shot(work: ElasticEquations) -> "NlpFit":
    """Return what the one-shot problem gives, with its last round."""
    # Imported here: it needs CasADi, which the other methods do without.
    from symid.identification.elastic.nlp import fit_nlp

    # Hardly filtered states bend its columns least, and its windows average their noise. Where the
    # options fix the places of stops and knees, the start is its own, which keeps them.
    start = _fit_weighted(work) if work.problem.options.moves_stops else None
    return fit_nlp(work.wide, start=start)


def _fit_weighted(work: ElasticEquations) -> MethodFit:
    chi = work.band.chi
    springs = work.wide.fit_springs(work.wide.average_sides(chi))
    fit = build_method_fit("weighted", chi, work.problem.sizes, springs)
    return replace(fit, covariance=work.band.covariance)


def build_linear_rows(work: ElasticEquations, fit: MethodFit) -> _LinearRows:
    """Return the equations that are linear in the dynamics of `fit`, its springs given."""
    problem, band = work.problem, work.rows
    if fit.method in {"elimination", "independent", "nlp"}:
        numbers: Sequence[int] = range(len(problem.signals))
        if fit.method == "independent":
            numbers = split_recordings(problem.signals)[0]
        design, torque = problem.stack_filtered(numbers)
        time = np.concatenate([_list_row_times(problem, number) for number in numbers])
        return _LinearRows(design.reshape(-1, design.shape[2]), torque.reshape(-1), time)
    if fit.method == "weighted":
        weights = 1.0 / work.band.scatter[band.group]
        return _LinearRows(band.design * weights[:, None], band.torque * weights, band.time)
    pairs = list(zip(problem.signals, problem.energy, strict=True))
    times = [np.arange(len(signals.time))[rows.ends][:-1] / len(signals.time) for signals, rows in pairs]
    return _LinearRows(
        problem.design, problem.supplied - problem.compute_work(fit.elasticity), np.concatenate(times)
    )


def build_candidate(work: ElasticEquations, fit: MethodFit) -> MethodCandidate:
    """Return `fit` as a candidate whose dynamics can be fitted again without a part of the rows."""
    card = work.problem.library.card
    # What no method can identify does not set them apart.
    spread = np.max(compute_relative_deviations(work, fit)[work.identifiable], initial=0.0)
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
        work_of_springs = work.problem.compute_stop_work([np.zeros(0)] * card.size)
        rows = _LinearRows(np.hstack([rows.design, work_of_springs]), work.problem.supplied, rows.time)
    folds = assign_folds(rows.time)

    def refit(fold: int) -> FloatArray:
        kept = folds != fold
        return offset + solve_with_signs(card, rows.design[kept], rows.right[kept])[:count]

    return MethodCandidate(refit, float(spread))


def _build_side_rows(problem: ElasticProblem, fit: MethodFit) -> _LinearRows:
    """Return motor and link equations with the springs' torques, each weighted by its scatter.

    Motors that are not trusted to slide have empty rows.
    """
    designs, rights, times = [], [], []
    slides, start = problem.slides, 0
    for number, rows in enumerate(problem.filtered):
        spring = compute_spring_torque(problem, fit, number)
        motor, link = rows.design.copy(), rows.design.copy()
        motor[:, :, : rows.bases], link[:, :, rows.bases :] = 0.0, 0.0
        kept = np.stack([slides[start : start + len(spring)], np.ones(spring.shape, dtype=bool)])
        start += len(spring)
        design = np.where(kept[..., None], np.stack([motor, link]), 0.0)
        right = np.where(kept, np.stack([rows.torque - spring, spring - rows.drag]), 0.0)
        floor = _FLOOR * max(float(np.sqrt(np.mean(rows.torque**2))), 1e-300)
        squares = np.sum((right - design @ fit.chi) ** 2, axis=1) / np.maximum(np.sum(kept, axis=1), 1)
        scatter = np.maximum(np.sqrt(squares), floor)[:, None, :]
        designs.append((design / scatter[..., None]).reshape(-1, len(fit.chi)))
        rights.append((right / scatter).reshape(-1))
        times.append(np.tile(_list_row_times(problem, number), 2))
    return _LinearRows(np.concatenate(designs), np.concatenate(rights), np.concatenate(times))


def _list_row_times(problem: ElasticProblem, number: int) -> FloatArray:
    count = len(problem.signals[number].time)
    return np.repeat(np.arange(count)[problem.filtered[number].keep] / count, problem.sizes[1])


def compute_spring_torque(problem: ElasticProblem, fit: MethodFit, number: int) -> FloatArray:
    """Return F[tau_J] (M, n) of the springs of `fit` at the filtered rows of recording `number`."""
    signals, keep = problem.signals[number], problem.filtered[number].keep
    torque = np.column_stack(
        [compute_joint_torque(spring, signals, joint) for joint, spring in enumerate(fit.elasticity)]
    )
    return filter_smooth(torque, problem.options.rate, signals.period)[keep]


def compute_relative_deviations(work: ElasticEquations, fit: MethodFit) -> FloatArray:
    """Return the standard deviation of every dynamic parameter relative to its size (p + n + pf,).

    A parameter near zero is measured by what would matter: 5 % of a joint's torque through its column alone.
    """
    if fit.covariance is None:
        return np.full(len(fit.chi), np.inf)
    size = work.problem.sizes[1]
    matter = np.full(len(fit.chi), np.inf)
    for joint in range(size):
        own = work.rows.group % size == joint
        lengths = np.linalg.norm(work.rows.design[own], axis=0)
        lengths[lengths == 0.0] = np.nan
        matter = np.fmin(matter, _MATTER * np.linalg.norm(work.rows.torque[own]) / lengths)
    matter[~np.isfinite(matter)] = 0.0
    deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    relative: FloatArray = deviations / np.maximum(np.maximum(np.abs(fit.chi), matter), 1e-300)
    return relative


AUTOMATIC_METHODS = ("linear-spring", "two-step", "elimination", "weighted", "nlp")
_LEVEL = 0.999


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodSelection:
    """The fit taken, the errors of all that could be, by method, why, and what a reader should know."""

    fit: MethodFit
    reason: str
    errors: Mapping[str, float] = field(default_factory=dict)
    notices: tuple[Notice, ...] = ()


def choose_fit(work: ElasticEquations, fits: Sequence[MethodFit]) -> MethodSelection:
    """Return the choice among `fits`, at least one of which is usable."""
    from scipy.special import chdtri

    usable = [fit for fit in fits if fit.outcome.usable and np.all(np.isfinite(fit.chi))]
    limit = float(chdtri(np.count_nonzero(work.identifiable), 1.0 - _LEVEL))
    known = np.flatnonzero(work.identifiable)
    covariance = work.band.covariance[np.ix_(known, known)]
    lengths = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    inverse = np.linalg.pinv(covariance / np.outer(lengths, lengths), rcond=1e-12, hermitian=True)
    shifts = {fit.method: (fit.chi - work.band.chi)[known] / lengths for fit in usable if fit.method == "nlp"}
    chi2 = {method: float(shift @ inverse @ shift) for method, shift in shifts.items()}
    contrary = [fit for fit in usable if not chi2.get(fit.method, 0.0) <= limit]
    kept = [fit for fit in usable if fit not in contrary] or usable
    candidates = [build_candidate(work, fit) for fit in kept]
    taken, errors, close = choose_candidate(candidates, work.rows, work.band.scatter)
    best = kept[taken]
    noise = f"(normalised error {errors[taken]:.3g}; 1 is the noise floor)"
    if close > 1:
        reason = (
            f"{close} of {len(kept)} methods predict held-out torque equally well {noise}. {best.method} has "
            "the smallest uncertainty of these and was chosen"
        )
    else:
        reason = f"{best.method} predicts held-out torque best of {len(kept)} methods {noise} and was chosen"
    text = (
        "the method {} was left out of the choice: its dynamics contradict those identified without springs "
        f"(chi^2 {{:.3g}}, limit {limit:.3g}). Its spring model does not describe these joints well enough"
    )
    notices = tuple(
        Notice(code="elastic.contradiction", text=text.format(fit.method, chi2[fit.method]))
        for fit in contrary
        if fit not in kept
    )
    named = dict(zip((fit.method for fit in kept), errors.tolist(), strict=True))
    return MethodSelection(fit=best, errors=named, reason=reason, notices=notices)


def choose_springs(work: ElasticEquations, fit: MethodFit, hidden: Collection[int]) -> MethodFit:
    """Return the fit with springs of other kinds where these predict the joint torque surely better.

    The torque is that of the links, which no friction of the motors blurs. Joints that are `hidden` keep
    their springs, and so do all where stops or knees were given.
    """
    problem, springs, notices = work.problem, list(fit.elasticity), []
    if problem.options.thresholds is not None or problem.options.knee_torques is not None:
        return fit
    beta = fit.chi[: problem.sizes[0]]
    for joint, card in enumerate(problem.library.card.joints):
        if joint in hidden or not springs:
            continue
        path, torque, kept = _follow_joint(problem, beta, joint)
        spring, name, left, before = choose_spring(path, torque, kept, springs[joint])
        if not name:
            continue
        springs[joint] = spring
        text = (
            f"joint {card.name!r}: a spring of another kind was taken: {name}. It leaves {left:.2g} % of "
            f"held-out joint torque, stops and knees {before:.2g} % of what they were fitted to"
        )
        notices.append(Notice(code="elastic.spring-kind", text=text))
    return replace(fit, elasticity=tuple(springs), notices=(*fit.notices, *notices))


def _follow_joint(
    problem: ElasticProblem, beta: FloatArray, joint: int
) -> tuple[ElementPath, FloatArray, NDArray[np.bool_]]:
    """Return torsion and torque (N,) of all recordings, one after the other, and the samples that count."""
    spans = [float(np.ptp(part.phi[:, joint])) for part in problem.signals]
    paths, torques, masks, speeds, periods = [], [], [], [], []
    for part, span in zip(problem.signals, spans, strict=True):
        if span < _LOADED * max(spans):
            continue
        edge = 1 + int(np.ceil(_EDGE / (part.cutoff * part.period))) if part.cutoff else 1
        index = np.arange(len(part.time))
        paths.append(part.phi[:, joint])
        speeds.append(differentiate_smooth(paths[-1], part.period))
        periods.append(np.full(len(index), part.period))
        torques.append(compute_link_torque(problem.library, part, beta)[:, joint])
        masks.append((index >= max(edge, part.settled)) & (index < len(index) - edge))
    path = ElementPath(
        position=np.concatenate(paths), velocity=np.concatenate(speeds), period=np.concatenate(periods)
    )
    return path, np.concatenate(torques), np.concatenate(masks)


_LOADED = 0.3
"""Of the largest range of the torsion: recordings with less tell little of a spring."""
_EDGE = 2.0
"""Periods of the cut-off at the ends that do not count."""
