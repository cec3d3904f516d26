"""The methods by name, how well each predicts held-out torques, and the automatic choice among them.

    score = mean of ((tau - Y chi) / sigma)^2 over all rows, each predicted by a fit without it
    d = (beta, IA)_nlp - (beta, IA)_w,  of covariance C_w + C_nlp: what is sure of it, up to 2 % of the sizes
    C_nlp <- C_nlp max(1, d' (C_w + C_nlp)^-1 d / parameters)     (Birge 1932)

Rows are the sum of motor and link equations in a band. Every fold leaves a stretch of time out, springs held
as they are. Of the methods that do not predict worse than the best one, surely and by what matters, that of
the smallest relative deviations, rms, is taken. Methods that rest on springs, the one-shot problem and the
simultaneous one that takes its place for springs of other kinds, must first agree with the weighted
elimination, of covariance C_w (Hausman 1978), up to what does not matter; friction near rest is not the same
in their rows. What is left of a contradiction widens their deviations.

Not supported: springs of other kinds inside the one-shot problem.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray, compute_triangle
from symid.codegen import Library
from symid.errors import Notice
from symid.identification.elastic import effects as drive_effects, elimination, estimate, regression, together
from symid.identification.elastic.options import RATE, ElasticOptions
from symid.identification.hysteresis import ElementPath, choose_spring
from symid.identification.judge import POLICY, adjust_chances, compare, numerics
from symid.logs import Recording, differentiate_smooth

if TYPE_CHECKING:
    from symid.identification.elastic.nlp import NlpFit


Maker = Callable[[regression.ElasticProblem], estimate.MethodFit]
"""What makes dynamics and springs of equations."""


class MethodCandidate(NamedTuple):
    """A method: its chi (p + n + pf,) without the rows of a fold, and its relative deviations, rms."""

    refit: Callable[[int], FloatArray]
    spread: float


def assign_parts(time: FloatArray, count: int) -> NDArray[np.intp]:
    """Return which of `count` parts (m,) rows at `time` (m,) are in, from 0 to 1 within their recording."""
    return np.asarray(np.minimum((time * count).astype(np.intp), count - 1))


def choose_candidate(
    candidates: Sequence[MethodCandidate], rows: elimination.BandRows, scatter: FloatArray
) -> tuple[int, FloatArray, int]:
    """Return the place of the best candidate, the errors (c,) of all, and how many are as good as the best.

    An error is the mean squared one in units of the noise, `scatter` (g,) of the groups of rows, N m or N; 1
    is what noise alone would leave. All candidates are compared on the same rows.
    """
    count = POLICY.folds * POLICY.parts
    blocks = rows.group * count + assign_parts(rows.time, count)
    losses = []
    for candidate in candidates:
        errors = predict_held_out(candidate, rows)
        losses.append(np.bincount(blocks, (errors / scatter[rows.group]) ** 2).astype(np.float64))
    means = np.sum(losses, axis=1) / len(blocks)
    best = losses[int(np.argmin(means))][:, None]
    gains = [compare(loss[:, None], best) for loss in losses]
    close = [
        index
        for index, gain in enumerate(gains)
        # Errors are torques, of which losses are the squares.
        if gain.p_of_all > POLICY.caution or gain.fall_of_all**0.5 * (1.0 - POLICY.relevance) <= 1.0
    ]
    taken = min(close, key=lambda index: (candidates[index].spread, means[index]))
    return taken, means, len(close)


def predict_held_out(candidate: MethodCandidate, rows: elimination.BandRows) -> FloatArray:
    """Return the errors (m,) of rows, N m or N, each predicted by a fit without its fold."""
    folds, errors = assign_parts(rows.time, POLICY.folds), np.empty(len(rows.torque))
    for fold in range(POLICY.folds):
        held = folds == fold
        errors[held] = rows.torque[held] - rows.design[held] @ candidate.refit(fold)
    return errors


ENERGY_METHODS = ("linear-spring", "two-step")
"""The methods whose dynamics come from energy rows."""
SPRUNG_METHODS = ("nlp", "simultaneous")
"""The methods whose dynamics rest on springs: they must not contradict those that need none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticEquations:
    """The equations of all methods.

    Args:
        problem: at the cut-off of the options; wide: the same recordings at a higher one, each at its own.
        rows, band: the weighted elimination in a band up to `edge` Hz, equations and fit.
        noise: (g,) of the torque in the rows of every group, N m or N.
        effects: of the drives, taken off the torque of all.
    """

    problem: regression.ElasticProblem
    wide: regression.ElasticProblem
    rows: elimination.BandRows
    band: elimination.BandFit
    edge: float
    noise: FloatArray
    effects: tuple[regression.DriveEffect, ...] = ()

    @property
    def identifiable(self) -> NDArray[np.bool_]:
        """Return which parameters (p + n + pf,) the weighted elimination identifies."""
        return np.isfinite(np.diag(self.band.covariance))


def build_elastic_equations(
    library: Library, recordings: tuple[Recording, ...], options: ElasticOptions
) -> ElasticEquations:
    """Return the equations of `recordings`.

    Raises:
        LogError: a recording lacks an encoder, is too short or unevenly sampled.
        UsageError: windows or thresholds do not fit.
    """
    band = regression.measure_motion_band(recordings)
    if options.rate is None:
        options = replace(options, rate=RATE * max(1.0, band / regression.BAND))
    # Recordings that are too short for the options are refused before anything is fitted to them.
    signals = [regression.prepare_elastic_signals(recording, options) for recording in recordings]
    known, bases = regression.read_known(library.card, options.known), len(library.card.beta)
    broader = []
    for recording in recordings:
        # Signals pass no filter where the options' pass none; a cut-off that suits fast sampling would be
        # none for a slow one.
        filtered = regression.choose_cutoff(recording) if options.cutoff is None else options.cutoff
        cutoff = elimination.get_wide_cutoff(recording.period, band) if filtered else 0.0
        broader.append(replace(options, cutoff=cutoff))

    def prepare(effects: tuple[regression.DriveEffect, ...]) -> list[regression.ElasticSignals]:
        pairs = zip(recordings, broader, strict=True)
        return [regression.prepare_elastic_signals(recording, wider, effects) for recording, wider in pairs]

    def free(
        effects: tuple[regression.DriveEffect, ...],
    ) -> tuple[list[regression.ElasticSignals], elimination.BandRows, FloatArray, elimination.BandFit]:
        # Signals without effects, rows in the band of them, up to which speeds motors may stick, and a fit.
        broad = prepare(effects)
        rows = elimination.build_band_rows(library, broad, band)
        rows, share = elimination.choose_sliding_rows(library.card, rows, known)
        limits = share * elimination.compute_speeds(broad)
        return broad, rows, limits, elimination.fit_band(library.card, rows, known)

    effects: tuple[regression.DriveEffect, ...] = ()
    broad, rows, limits, fit = free(effects)
    if options.effects:
        period = max(part.period for part in broad)
        edge = min(elimination.EFFECTS * regression.choose_edge(period, band), POLICY.row_band / period)
        # Friction near rest may be taken for an effect, and effects for it.
        slow = regression.MOVES * elimination.compute_speeds(broad)
        effects = drive_effects.measure_effects(library, broad, edge, slow)
        if effects:
            broad, rows, limits, fit = free(effects)
        # Friction of links that the sum of both sides does not tell from that of motors.
        told = {effect.joint for effect in effects if effect.kind == "link-friction"}
        drags = drive_effects.measure_link_friction(library, broad, fit.chi[:bases])
        drags = tuple(effect for effect in drags if effect.joint not in told)
        if drags:
            effects = (*effects, *drags)
            broad, rows, limits, fit = free(effects)
        # What gears and encoders of the links add.
        discs = drive_effects.measure_eccentricity(library, broad, fit.chi[:bases])
        for _ in range(options.iterations if discs else 0):
            broad, rows, limits, fit = free((*effects, *discs))
            trial = regression.build_elastic_problem(library, broad, options, limits)
            before, discs = discs, drive_effects.refine_eccentricity(trial, fit.chi, discs)
            steps = [np.subtract(disc.values, last.values) for disc, last in zip(discs, before, strict=True)]
            if all(np.all(np.abs(step) <= disc.deviations) for step, disc in zip(steps, discs, strict=True)):
                break
        if discs:
            effects = (*effects, *discs)
            broad, rows, limits, fit = free(effects)
        for measure in (drive_effects.measure_offsets, drive_effects.measure_gears):
            # They move the torsion alone, of which the rows in the band know nothing.
            if further := measure(library, broad, fit.chi[:bases]):
                effects = (*effects, *further)
                broad = prepare(effects)
    if effects:
        signals = [regression.prepare_elastic_signals(log, options, effects) for log in recordings]
    problem = regression.build_elastic_problem(library, signals, options, limits)
    filtered = any(part.cutoff for part in signals)
    return ElasticEquations(
        problem=problem,
        wide=regression.build_elastic_problem(library, broad, options, limits) if filtered else problem,
        rows=rows,
        band=fit,
        edge=regression.choose_edge(max(part.period for part in broad), band),
        noise=elimination.measure_torque_noise(recordings, band),
        effects=effects,
    )


def fit_method(
    work: ElasticEquations, method: str | Maker, start: estimate.MethodFit | None = None
) -> estimate.MethodFit:
    """Return dynamics and springs by one method, with the covariance of the dynamics.

    `method` is one of `AUTOMATIC_METHODS`, "simultaneous", which needs a `start` with springs of the kinds
    wanted ("nlp" takes that of `fit_one_shot`), or a function of the equations. What the rows do not identify
    has an infinite variance.
    """
    problem = work.problem
    match method:
        case "nlp":
            fit = _widen(work, fit_one_shot(work, start).fit)
        case "simultaneous" if start is not None:
            fit = _widen(work, together.fit_simultaneous(work.wide, problem, start))
        case "weighted":
            fit = _fit_weighted(work)
        case _:
            fit = (_MAKERS[method] if isinstance(method, str) else method)(problem)
    # Variances are infinite where the rows do not identify.
    rows = build_linear_rows(work, fit)
    if fit.covariance is None:
        left = rows.right - rows.design @ fit.chi
        covariance = estimate.compute_covariance(rows.design, left, problem.known)
    else:
        identifiable = estimate.measure_identifiability(rows.design, problem.known)[0]
        covariance = estimate.mark_unidentifiable(fit.covariance, identifiable)
    return _add_model_error(work, replace(fit, covariance=covariance))


_MAKERS: dict[str, Maker] = {
    "linear-spring": together.fit_linear_spring,
    "two-step": together.fit_two_step,
    "elimination": elimination.fit_elimination,
}


def fit_one_shot(work: ElasticEquations, weighted: estimate.MethodFit | None = None) -> "NlpFit":
    """Return what the one-shot problem gives, with its last round; `weighted` is that fit, if known."""
    # Imported here: it needs CasADi, which the other methods do without.
    from symid.identification.elastic.nlp import fit_nlp

    # Hardly filtered states bend its columns least, and its windows average their noise. Where the
    # options fix the places of stops and knees, the start is its own, which keeps them.
    start = (weighted or _fit_weighted(work)) if work.problem.options.moves_stops else None
    return fit_nlp(work.wide, start=start)


def _fit_weighted(work: ElasticEquations) -> estimate.MethodFit:
    chi = work.band.chi
    springs = work.wide.fit_springs(work.wide.average_sides(chi))
    fit = estimate.build_method_fit("weighted", chi, work.problem.sizes, springs)
    return replace(fit, covariance=work.band.covariance)


def build_linear_rows(work: ElasticEquations, fit: estimate.MethodFit) -> together.LinearRows:
    """Return the equations that are linear in the dynamics of `fit`, its springs given."""
    problem, band = work.problem, work.rows
    if fit.method == "weighted":
        return together.LinearRows(*band.weigh(work.band.scatter), band.time)
    if fit.method in ENERGY_METHODS:
        pairs = zip(problem.signals, problem.energy, strict=True)
        times = [(np.arange(len(part.time)) / len(part.time))[rows.ends][:-1] for part, rows in pairs]
        right = problem.supplied - problem.compute_work(fit.elasticity)
        return together.LinearRows(problem.design, right, np.concatenate(times))
    numbers = fit.recordings or range(len(problem.signals))
    design, torque = problem.stack_filtered(numbers)
    times = [np.repeat(together.list_row_times(problem, number), problem.sizes[1]) for number in numbers]
    return together.LinearRows(design.reshape(-1, design.shape[2]), torque.reshape(-1), np.concatenate(times))


def build_candidate(work: ElasticEquations, fit: estimate.MethodFit) -> MethodCandidate:
    """Return `fit` as a candidate whose dynamics can be fitted again without a part of the rows."""
    card, known = work.problem.library.card, work.problem.known
    # What no method can identify does not set them apart.
    rivals = [fit]
    if fit.method == "elimination":
        # The same equations, not weighted by their noise, cannot be surer (Gauss and Markov).
        rivals.append(replace(fit, covariance=work.band.covariance))
    relative = np.array([compute_relative_deviations(work, rival) for rival in rivals])
    # What is expected of all errors: a rotor that one method hardly tells from its link counts.
    sizes = np.max(relative[:, work.identifiable], axis=0, initial=0.0)
    spread = float(np.linalg.norm(sizes)) / math.sqrt(max(1, len(sizes)))
    count = len(fit.chi)
    offset = np.zeros(count)
    if fit.method in SPRUNG_METHODS:
        # Exact where the fit is the least-squares solution of these rows, and near to it the influence of
        # the rows left out.
        calm = fit.method == "simultaneous"
        problem = together.calm_torsions(work.wide, work.problem, fit) if calm else work.wide
        rows = together.build_side_rows(problem, fit, zeros=calm)
        offset = fit.chi - regression.solve_with_signs(card, rows.design, rows.right, known)
    else:
        rows = build_linear_rows(work, fit)
    if fit.method == "linear-spring":
        # Its springs are linear too, and are fitted with the dynamics.
        work_of_springs = work.problem.compute_stop_work([np.zeros(0)] * card.size)
        design = np.hstack([rows.design, work_of_springs])
        rows = together.LinearRows(design, work.problem.supplied, rows.time)
    folds, whole = assign_parts(rows.time, POLICY.folds), np.column_stack([rows.design, rows.right])
    triangles = [compute_triangle(whole[folds == fold]) for fold in range(POLICY.folds)]

    def refit(fold: int) -> FloatArray:
        left = np.concatenate([part for place, part in enumerate(triangles) if place != fold])
        return offset + regression.solve_with_signs(card, left[:, :-1], left[:, -1], known)[:count]

    return MethodCandidate(refit, spread)


def weigh_evidence(
    work: ElasticEquations, fit: estimate.MethodFit, contradiction: float, known: float
) -> estimate.ElasticEvidence:
    """Return what fits without a stretch of the logs leave of it, and springs of the links' torque."""
    size, rows = work.problem.sizes[1], work.rows
    errors, joint = predict_held_out(build_candidate(work, fit), rows), rows.group % size
    squares = errors**2, rows.torque**2
    left, whole = (np.bincount(joint, part, minlength=size).astype(np.float64) for part in squares)
    # A joint without torque has no noise either.
    floor = numerics.CONVERGED * max(float(np.sqrt(np.mean(rows.torque**2))), numerics.TINY)
    beyond = np.bincount(joint, (errors / np.maximum(work.noise[rows.group], floor)) ** 2, minlength=size)
    beyond = np.where(whole > 0.0, beyond, 0.0)
    springs: FloatArray = np.zeros(0)
    if fit.elasticity:
        link = work.problem.compute_link_side(fit.chi)
        torque = np.concatenate(together.compute_spring_torques(work.problem, fit))
        springs = 100.0 * _divide(np.linalg.norm(link - torque, axis=0), np.linalg.norm(link, axis=0))
    counts = np.maximum(np.bincount(joint, minlength=size), 1)
    return estimate.ElasticEvidence(
        held_out=tuple((100.0 * np.sqrt(_divide(left, whole))).tolist()),
        noise=tuple(np.sqrt(beyond / counts).tolist()),
        springs=tuple(springs.tolist()),
        contradiction=contradiction,
        known=known,
    )


def _divide(part: FloatArray, whole: FloatArray) -> FloatArray:
    """Return the shares (n,); of nothing, nothing is left."""
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0.0)


def compute_relative_deviations(work: ElasticEquations, fit: estimate.MethodFit) -> FloatArray:
    """Return the standard deviation of every dynamic parameter relative to its size (p + n + pf,)."""
    if fit.covariance is None:
        return np.full(len(fit.chi), np.inf)
    deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    relative: FloatArray = deviations / np.maximum(_measure_sizes(work, fit.chi), numerics.TINY)
    return relative


def _measure_sizes(work: ElasticEquations, chi: FloatArray) -> FloatArray:
    """Return the sizes (p + n + pf,) of the dynamic parameters chi."""
    # One near zero is measured by what would matter: a part of a joint's torque through its column alone.
    size, matter = work.problem.sizes[1], np.full(len(chi), np.inf)
    for joint in range(size):
        own = work.rows.group % size == joint
        lengths = np.linalg.norm(work.rows.design[own], axis=0)
        lengths[lengths == 0.0] = np.nan
        matter = np.fmin(matter, POLICY.relevance * np.linalg.norm(work.rows.torque[own]) / lengths)
    return np.maximum(np.abs(chi), np.where(np.isfinite(matter), matter, 0.0))


AUTOMATIC_METHODS: tuple[str, ...] = ("linear-spring", "two-step", "elimination", "weighted", "nlp")
"""But "simultaneous" in place of "nlp", where a spring is of another kind than stops and knees."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodSelection:
    """The fit taken, the errors of all that could be, by method, why, and what a reader should know.

    `contradiction` is that of `ElasticEvidence`.
    """

    fit: estimate.MethodFit
    reason: str
    errors: Mapping[str, float] = field(default_factory=dict)
    contradiction: float
    notices: tuple[Notice, ...] = ()


def choose_fit(work: ElasticEquations, fits: Sequence[estimate.MethodFit]) -> MethodSelection:
    """Return the choice among `fits`, at least one of which is usable."""
    usable = [fit for fit in fits if fit.outcome.usable and np.all(np.isfinite(fit.chi))]
    found = {fit.method: find_contradiction(work, fit) for fit in usable}
    kept = [fit for fit in usable if not found[fit.method][0]]
    notices = [
        Notice(code="elastic.contradiction", text=f"{why}: {method} is not chosen; name it to have it")
        for method, (why, _) in found.items()
        if why and kept
    ]
    kept = kept or usable
    candidates = [build_candidate(work, fit) for fit in kept]
    taken, errors, close = choose_candidate(candidates, work.rows, work.band.scatter)
    best = kept[taken]
    noise = f"(normalised error {errors[taken]:.3g}; 1 is the noise floor)"
    reason = f"{best.method} predicts held-out torque best of {len(kept)} methods {noise} and was chosen"
    if close > 1:
        reason = f"{close} of {len(kept)} methods predict held-out torque equally well {noise}. "
        reason += f"{best.method} has the smallest uncertainty of these and was chosen"
    return MethodSelection(
        fit=best,
        errors=dict(zip((fit.method for fit in kept), errors.tolist(), strict=True)),
        reason=reason,
        contradiction=max((ratio for _, ratio in found.values()), default=0.0),
        notices=tuple(notices),
    )


def find_contradiction(work: ElasticEquations, fit: estimate.MethodFit) -> tuple[str, float]:
    """Return what speaks against a fit that rests on springs, if any, and how much, over its limit."""
    if fit.method not in SPRUNG_METHODS:
        return "", 0.0
    known, apart, spread = _list_differences(work, fit)
    limits = POLICY.relevance * _measure_sizes(work, work.band.chi)[known]
    ratio = float(np.max(np.abs(_find_sure(apart, spread)) / limits, initial=0.0))
    text = "its dynamics contradict those identified without springs (a parameter by "
    text += f"{100.0 * POLICY.relevance * ratio:.2g} % of its size, limit {100.0 * POLICY.relevance:g} %). "
    text += "Its spring model does not describe these joints well enough"
    return text if ratio > 1.0 else "", ratio


def list_contradicted(work: ElasticEquations) -> tuple[float, tuple[tuple[str, float, float], ...]]:
    """Return how far what was known is from the logs alone, over its limit, and what lies farthest apart.

    The latter are names, what the weighted elimination finds where nothing is known, and its deviations.
    """
    problem, card = work.problem, work.problem.library.card
    rigid = regression.mark_rigid_rotors(card)
    told, unknown = np.isfinite(problem.known) & ~rigid, np.where(rigid, 0.0, np.nan)
    if not np.any(told):
        return 0.0, ()
    alone = elimination.fit_band(card, work.rows, unknown)
    design, torque = work.rows.weigh(alone.scatter)
    # Noise that is not white must not look like a contradiction.
    spread = estimate.compute_covariance(design, torque - design @ alone.chi, unknown)
    known = np.flatnonzero(told & np.isfinite(np.diag(spread)))
    apart, spread = (alone.chi - problem.known)[known], spread[np.ix_(known, known)]
    sizes = np.abs(_find_sure(apart, spread)) / (POLICY.relevance * _measure_sizes(work, alone.chi)[known])
    names = [entry.name for entry in regression.list_parameter_cards(card)]
    order = [k for k in np.argsort(-sizes).tolist() if sizes[k] > 1.0]
    far = ((names[known[k]], float(alone.chi[known[k]]), float(np.sqrt(spread[k, k]))) for k in order)
    return float(np.max(sizes, initial=0.0)), tuple(far)


def _find_sure(apart: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the part of a difference (k,) of covariance (k, k) that is no chance, direction by direction."""
    lengths = np.sqrt(np.maximum(np.diag(spread), numerics.TINY))
    values, vectors = np.linalg.eigh(spread / np.outer(lengths, lengths))
    scores = vectors.T @ (apart / lengths)
    roots = np.sqrt(np.maximum(values, numerics.EXACT))
    chances = adjust_chances((2.0 * scipy.special.ndtr(-np.abs(scores) / roots)).tolist())
    return np.asarray(lengths * (vectors @ np.where(np.array(chances) < POLICY.alarm, scores, 0.0)))


def _list_differences(
    work: ElasticEquations, fit: estimate.MethodFit
) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
    """Return places (k,) in beta and IA, distances from the weighted elimination's, and their covariance."""
    plain = fit.covariance if fit.plain is None else fit.plain
    own = np.zeros_like(work.band.covariance) if plain is None else plain
    both = work.identifiable & np.isfinite(np.diag(own)) & np.isnan(work.problem.known)
    known = np.flatnonzero(both[: sum(work.problem.sizes)])
    return known, (fit.chi - work.band.chi)[known], (work.band.covariance + own)[np.ix_(known, known)]


def _widen(work: ElasticEquations, fit: estimate.MethodFit) -> estimate.MethodFit:
    """Return a fit with deviations that its distance from the weighted elimination allows (Birge 1932)."""
    known, apart, spread = _list_differences(work, fit)
    lengths = np.sqrt(np.maximum(np.diag(spread), numerics.TINY))
    inverse = np.linalg.pinv(spread / np.outer(lengths, lengths), rcond=numerics.EXACT, hermitian=True)
    chi2, count = float(apart / lengths @ inverse @ (apart / lengths)), len(known)
    if fit.covariance is None or not chi2 > count > 0:
        return fit
    return replace(fit, covariance=fit.covariance * (chi2 / count), plain=fit.covariance)


def _add_model_error(work: ElasticEquations, fit: estimate.MethodFit) -> estimate.MethodFit:
    """Return a fit with variances that also count what no row shows: columns are made of measured states."""
    if fit.covariance is None:
        return fit
    # The torque of a joint may be off by a factor, and the direction of a link by an angle, which gives a
    # part of the largest of its kind to every parameter. Friction is what the rows show.
    card = work.problem.library.card
    kinds = [*((entry.joint, entry.unit) for entry in card.beta), *((joint.name,) for joint in card.joints)]
    values = np.abs(fit.chi[: len(kinds)])
    sizes = np.array([max(values[k] for k, other in enumerate(kinds) if other == kind) for kind in kinds])
    variances = np.zeros(len(fit.chi))
    variances[: len(kinds)] = estimate.MODEL_ERROR**2 * (values**2 + sizes**2)
    variances[~np.isnan(work.problem.known)] = 0.0
    plain = fit.covariance if fit.plain is None else fit.plain
    return replace(fit, covariance=fit.covariance + np.diag(variances), shown=fit.covariance, plain=plain)


def choose_springs(
    work: ElasticEquations, fit: estimate.MethodFit, hidden: Collection[int]
) -> tuple[estimate.MethodFit, tuple[str, ...]]:
    """Return the fit with springs of other kinds where these predict the joint torque surely better.

    The torque is that of the links, which no friction of the motors blurs. Joints that are `hidden` keep
    their springs, and so do all where stops or knees were given, or none of either is wanted. The names of
    the kinds, one a joint, are empty where the springs were kept.
    """
    problem, springs, notices = work.problem, list(fit.elasticity), []
    cards, options = problem.library.card.joints, problem.options
    kinds = [""] * len(cards)
    stated = options.thresholds is not None or options.knee_torques is not None
    if stated or not (options.stops or options.knees):
        return fit, tuple(kinds)
    for joint, rows in drive_effects.list_joint_rows(problem.library, problem.signals, fit.beta):
        if joint in hidden:
            continue
        # Torsion and torque of all recordings, one after the other, and the samples that count.
        phi, torque = (np.concatenate([getattr(part, name) for part in rows]) for name in ("phi", "torque"))
        velocity = np.concatenate([differentiate_smooth(part.phi, part.period) for part in rows])
        period = np.concatenate([np.full(len(part.phi), part.period) for part in rows])
        kept = np.zeros(len(phi), dtype=bool)
        begins = np.cumsum([0, *(len(part.phi) for part in rows)]).tolist()
        for start, part in zip(begins, rows, strict=False):
            kept[start + part.kept.start : start + part.kept.stop] = True
        path = ElementPath(position=phi, velocity=velocity, period=period, begins=tuple(begins[:-1]))
        speed = np.concatenate([differentiate_smooth(part.theta - part.phi, part.period) for part in rows])
        spring, name, left, before = choose_spring(path, torque, kept, springs[joint], speed)
        if not name:
            continue
        # Stops are no other kind.
        springs[joint], kinds[joint] = spring, "" if name == "stops" else name
        text = f"joint {cards[joint].name!r}: a spring of another kind was taken: {name}. Its held-out "
        text += f"residual is {left:.2g} % of the joint torque, that of stops and knees {before:.2g} % where "
        text += "fitted"
        notices.append(Notice(code="elastic.spring-kind", text=text))
    return replace(fit, elasticity=tuple(springs), notices=(*fit.notices, *notices)), tuple(kinds)
