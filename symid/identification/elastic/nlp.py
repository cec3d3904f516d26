"""Dynamics, friction and hysteresis together, in one constrained problem: the one-shot reference.

    rows         linear parts once, knees and Stribeck friction as steps          (nlp_rows)
    unknowns     chi, weights k >= 0, slopes c > 0, Fs, vs                        (nlp_cost)
    rounds       minimise sum_b |r_b|^2 / sigma_b^2 by Ipopt, then sigma_b <- rms r_b
    places       those of a start move between rounds: [dx; dr] = -H^-1 g,
                 H = sum J'J / sigma^2, g = sum J'r / sigma^2
    certificate  kkt = max_i |z_i - min(u_i, max(l_i, z_i - df/dz_i))|

Unknowns are scaled by the lengths of their columns at the start, x = d z; all constraints are bounds. Stops
and knees that are given, or on a grid, stay; knees of a grid follow the torque that the springs reach.

Supported: energy, filtered, momentum rows; Stribeck friction; odd springs; exact, Gauss-Newton Hessians.
Not supported: joint damping, cubic springs; another number of stops and knees than that of the start;
proof that no better optimum exists.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.codegen import ModelCard
from symid.errors import Notice
from symid.identification.elastic.elimination import fit_elimination
from symid.identification.elastic.estimate import HistoryEntry, MethodFit, build_method_fit
from symid.identification.elastic.nlp_cost import ElasticNlpCost, NlpLayout, SpringGrid, list_weights
from symid.identification.elastic.nlp_rows import NlpRecording, build_nlp_recording, move_stops
from symid.identification.elastic.options import NlpOptions
from symid.identification.elastic.problem import ElasticProblem
from symid.identification.elastic.two_step import fit_linear_spring
from symid.identification.hysteresis import SpringWeights, build_knee_grid, compute_place_limits
from symid.ipopt import Ending, IpoptOptions, SmoothProblem, keep_last, minimise
from symid.joint_models import Elasticity

_AT_BOUND = 1e-9
"""Distance in scaled unknowns below which a bound that the gradient pushes against is active."""
_NEAR_BOUND = 1e-3
"""Distance in scaled unknowns within which Newton steps try an unknown on its bound."""
_NEWTON_STEPS = 8
_BLIND = 1e-14
"""Scaled gradient and curvature below which an unknown has no effect."""
_KKT = 1e-6
"""The most that our own residual may be for a result to count as converged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """What proves an optimum, computed without the solver.

    Args:
        kkt: scaled residual of the optimality conditions.
        active: unknowns held by a bound, with their values.
        undetermined: unknowns without any effect at this point, or none apart from k0.
        curvature: least eigenvalue of the scaled Hessian of all others; positive at a strict local minimum.
    """

    kkt: float
    active: tuple[tuple[str, float], ...]
    undetermined: tuple[str, ...]
    curvature: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpRun(FrozenArrays):
    """One run: (x,) unknowns in SI units, f, and how it ended."""

    x: FloatArray
    objective: float
    outcome: Ending
    reason: str
    certificate: Certificate

    @property
    def converged(self) -> bool:
        """Return whether the run ended at an optimum."""
        return self.outcome in {Ending.CONVERGED, Ending.ACCEPTABLE}


def compute_scales(cost: ElasticNlpCost, x: FloatArray) -> FloatArray:
    """Return d (x,), SI units per scaled unknown: one over the length of each column at x."""
    diagonal = np.diag(cost.compute_gauss_newton(cost.compute_state(x)))
    # A column that is empty at the start has no length yet: its unknown keeps its own size.
    own = np.maximum(np.abs(x), 1e-3)
    return np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), own)


def optimise_nlp(cost: ElasticNlpCost, start: FloatArray, scales: FloatArray, options: NlpOptions) -> NlpRun:
    """Return the optimum next to `start` (x,), with its certificate; a start outside the bounds is clipped.

    Unknowns are in SI units, `scales` (x,) in SI units per scaled unknown.
    """
    layout, state = cost.layout, keep_last(cost.compute_state)

    def compute_hessian(x: FloatArray) -> FloatArray:
        exact = options.hessian == "exact"
        return cost.compute_hessian(state(x), x) if exact else cost.compute_gauss_newton(state(x))

    scaled = SmoothProblem(
        value=lambda x: cost.compute_value(state(x)),
        gradient=lambda x: cost.compute_gradient(state(x)),
        hessian=compute_hessian,
        lower=layout.lower,
        upper=layout.upper,
    ).scale(scales)
    begin = np.clip(start, layout.lower, layout.upper) / scales
    run = minimise(scaled, begin, IpoptOptions(tolerance=options.tolerance, iterations=options.iterations))
    outcome, reason = run.outcome, run.reason
    x = np.clip(_polish(scaled, run.x) * scales, layout.lower, layout.upper)
    certificate = compute_certificate(cost, x, scales)
    if outcome is Ending.CONVERGED and certificate.kkt > _KKT:
        outcome = Ending.STALLED
        reason = (
            f"Ipopt reports success, but the residual of the optimality conditions is {certificate.kkt:.1e}"
        )
    value = cost.compute_value(cost.compute_state(x))
    return NlpRun(x=x, objective=value, outcome=outcome, reason=reason, certificate=certificate)


def compute_certificate(cost: ElasticNlpCost, x: FloatArray, scales: FloatArray) -> Certificate:
    """Return the proof of optimality at x (x,), from our own derivatives."""
    layout = cost.layout
    state = cost.compute_state(x)
    slope = cost.compute_gradient(state) * scales
    z, low, high = x / scales, layout.lower / scales, layout.upper / scales
    at_low = (z - low <= _AT_BOUND) & (slope > 0.0) & (low < high)
    at_high = (high - z <= _AT_BOUND) & (slope < 0.0) & (low < high)
    hessian = cost.compute_hessian(state, x) * scales * scales[:, None]
    blind = (np.diag(hessian) <= _BLIND) & (np.abs(slope) <= _BLIND)
    free = ~(at_low | at_high | blind | (low == high))
    return Certificate(
        kkt=_compute_kkt(z, slope, low, high),
        active=tuple((layout.names[place], float(x[place])) for place in np.flatnonzero(at_low | at_high)),
        undetermined=tuple(layout.names[place] for place in np.flatnonzero(blind | (low == high))),
        curvature=float(np.linalg.eigvalsh(hessian[np.ix_(free, free)])[0]),
    )


def _polish(problem: SmoothProblem, z: FloatArray) -> FloatArray:
    """Return z (x,) after Newton steps in the unknowns that no bound holds; the others go onto their bounds.

    An interior-point method stays off the bounds by its barrier over the multiplier.
    """
    low, high, hessian_of = problem.lower, problem.upper, problem.hessian
    best = np.clip(z, low, high)
    if hessian_of is None:
        return best
    slope = problem.gradient(best)
    residual = _compute_kkt(best, slope, low, high)
    for _ in range(_NEWTON_STEPS):
        near = np.minimum(np.abs(slope), _NEAR_BOUND)
        at_low, at_high = (best - low < near) & (slope > 0.0), (high - best < near) & (slope < 0.0)
        trial = np.where(at_low, low, np.where(at_high, high, best))
        free = np.flatnonzero(~(at_low | at_high))
        hessian = hessian_of(best)[np.ix_(free, free)]
        trial[free] -= np.linalg.lstsq(hessian, problem.gradient(trial)[free], rcond=1e-12)[0]
        trial = np.clip(trial, low, high)
        slope = problem.gradient(trial)
        reached = _compute_kkt(trial, slope, low, high)
        # A step is kept while our own residual falls.
        if not reached < residual:
            break
        best, residual = trial, reached
    return best


def _compute_kkt(z: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray) -> float:
    return float(np.max(np.abs(z - np.clip(z - slope, low, high))))


@dataclass(frozen=True, slots=True, kw_only=True)
class NlpPlace:
    """A stop or knee of a joint: the index of its threshold among those of the joint."""

    joint: int
    knee: bool
    index: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpSetting:
    """What all rounds share.

    Args:
        recordings: their rows, for these thresholds.
        thresholds: (m,) of each joint's stops, rad or m.
        knees: signed torques of each joint, N m or N; None where they lie on a grid over the torque.
        stiffness: (n,) of the linear springs that bound the weights.
    """

    problem: ElasticProblem
    options: NlpOptions
    recordings: tuple[NlpRecording, ...]
    thresholds: tuple[FloatArray, ...]
    knees: tuple[tuple[float, ...], ...] | None
    stiffness: FloatArray

    def lay_out(self, springs: Sequence[Elasticity]) -> NlpLayout:
        """Return the unknowns, with knees for what `springs` reach."""
        grids = []
        for joint, thresholds in enumerate(self.thresholds):
            bases = [part.bases[joint] for part in self.recordings]
            if self.knees is not None:
                knees = self.knees[joint]
            else:
                weights = list_weights(springs[joint], thresholds)
                count, odd = self.problem.options.knees, self.options.odd
                grid = build_knee_grid([basis @ weights for basis in bases], count, odd=odd)
                knees = tuple(sorted(map(float, grid)))
            stiffness, reach = float(self.stiffness[joint]), max(float(np.abs(b[:, 0]).max()) for b in bases)
            grids.append(SpringGrid(thresholds=thresholds, knees=knees, stiffness=stiffness, reach=reach))
        return NlpLayout.build(self.problem.library.card, grids, self.options)

    def shift(self, places: Sequence[NlpPlace], steps: FloatArray) -> "NlpSetting":
        """Return the setting with each of the places moved by a step (places,)."""
        knees = [list(entries) for entries in self.knees or ()]
        grids = [grid.copy() for grid in self.thresholds]
        moves: list[dict[int, float]] = [{} for _ in self.thresholds]
        for place, step in zip(places, steps.tolist(), strict=True):
            if place.knee:
                knees[place.joint][place.index] += step
            elif step:
                grids[place.joint][place.index] += step
                moves[place.joint][place.index] = float(grids[place.joint][place.index])
        moved = replace(self, knees=None if self.knees is None else tuple(map(tuple, knees)))
        if not any(moves):
            return moved
        recordings = tuple(move_stops(recording, moves) for recording in self.recordings)
        return replace(moved, thresholds=tuple(map(freeze, grids)), recordings=recordings)


def prepare_setting(problem: ElasticProblem, options: NlpOptions, begin: MethodFit) -> NlpSetting:
    """Return the setting of the first round; stops and knees are those of `begin` where it has some."""
    springs = begin.elasticity
    thresholds, knees = problem.thresholds, problem.options.knee_torques
    if any(spring.stops or spring.knees for spring in springs):
        thresholds = tuple(freeze([stop.threshold for stop in spring.stops]) for spring in springs)
        knees = tuple(tuple(knee.threshold for knee in spring.knees) for spring in springs)
    whole = np.array([spring.initial_stiffness or 0.0 for spring in springs])
    numbers = range(len(problem.signals))
    return NlpSetting(
        problem=problem,
        options=options,
        recordings=tuple(build_nlp_recording(problem, i, thresholds, options.rows) for i in numbers),
        thresholds=thresholds,
        knees=knees,
        stiffness=np.maximum(whole, 1e-6 * max(float(whole.max()), 1e-6)),
    )


_REST_WEIGHT = 1e-9
"""Of the linear spring: weights below it are zero."""
_SHIFT = 1e-4
"""Of the place of a stop or knee, for derivatives by it."""
_FRACTIONS = (1.0, 0.5, 0.25, 0.125)


def list_places(setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray) -> tuple[NlpPlace, ...]:
    """Return the stops and knees whose places are optimised: none that are given or on a grid.

    Knees of odd springs stand in pairs, and stay.
    """
    options = setting.problem.options
    if setting.knees is None or not options.moves_stops:
        return ()
    places = []
    for joint, spring in enumerate(cost.layout.springs):
        busy = np.flatnonzero(x[spring.weights][1:] > _REST_WEIGHT * setting.stiffness[joint])
        places += [NlpPlace(joint=joint, knee=False, index=int(stop)) for stop in busy]
        if options.knee_torques is None and not setting.options.odd:
            places += [NlpPlace(joint=joint, knee=True, index=knee) for knee in range(len(spring.knees))]
    return tuple(places)


def compute_place_slopes(
    setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray, places: Sequence[NlpPlace]
) -> list[list[FloatArray]]:
    """Return the derivatives of all residuals (M_b,) of every block by each place."""
    before = cost.compute_state(x).residuals
    slopes = []
    for place in places:
        grids = (setting.knees or ()) if place.knee else setting.thresholds
        step = _SHIFT * abs(float(grids[place.joint][place.index]))
        moved = _rebuild(cost, setting.shift([place], np.array([step]))).compute_state(x).residuals
        slopes.append([(after - now) / step for after, now in zip(moved, before, strict=True)])
    return slopes


def _move_places(setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray) -> tuple[NlpSetting, FloatArray]:
    """Return setting and unknowns a step nearer to the optimum of unknowns x (x,) and places together."""
    places = list_places(setting, cost, x)
    if not places:
        return setting, x
    inverse, scores = cost.invert_normal_equations(x, compute_place_slopes(setting, cost, x, places))
    step = -inverse @ scores.sum(axis=0)
    value = cost.compute_value(cost.compute_state(x))
    limits: dict[NlpPlace, tuple[float, float]] = {}
    for joint, spring in enumerate(cost.layout.springs):
        knees = np.array(spring.knees)
        # Those below zero, then those above, both from zero outwards.
        order = np.lexsort((np.abs(knees), knees > 0.0))
        weights = SpringWeights(
            thresholds=spring.thresholds,
            stiffness=x[spring.weights],
            knees=knees[order],
            slopes=np.ones(len(knees)),
        )
        ends = compute_place_limits([part.bases[joint] for part in setting.recordings], weights)
        known = [NlpPlace(joint=joint, knee=False, index=index) for index in range(len(spring.thresholds))]
        known += [NlpPlace(joint=joint, knee=True, index=index) for index in order.tolist()]
        limits |= dict(zip(known, zip(*(part.tolist() for part in ends), strict=True), strict=True))
    lower, upper = np.array([limits[place] for place in places]).T
    for fraction in _FRACTIONS:
        moved = setting.shift(places, np.clip(fraction * step[len(x) :], lower, upper))
        trial = _rebuild(cost, moved)
        start = np.clip(x + fraction * step[: len(x)], trial.layout.lower, trial.layout.upper)
        if trial.compute_value(trial.compute_state(start)) < value:
            return moved, start
    return setting, x


def _rebuild(cost: ElasticNlpCost, setting: NlpSetting) -> ElasticNlpCost:
    return replace(cost, recordings=setting.recordings, layout=setting.lay_out(()))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpFit:
    """What the problem gave: the fit, with one history entry a round; run and cost of the last round."""

    fit: MethodFit
    run: NlpRun
    cost: ElasticNlpCost


def fit_nlp(
    problem: ElasticProblem, options: NlpOptions | None = None, start: MethodFit | None = None
) -> NlpFit:
    """Return the optimum of the hysteresis-plus-friction problem, with the problem's own `options` if None.

    `start` has the dynamics and springs to begin with; stops and knees move to better places near where the
    problem refines its grids. None for those of the elimination, or, where it does not, for linear springs on
    the grids.
    """
    options = options or problem.options.nlp
    # Refined stops and knees begin where the elimination puts them.
    begin = start or (fit_elimination(problem) if problem.options.moves_stops else fit_linear_spring(problem))
    setting = prepare_setting(problem, options, begin)
    layout = setting.lay_out(begin.elasticity)
    x = layout.build_start(begin.chi, begin.elasticity)
    cost = ElasticNlpCost(recordings=setting.recordings, layout=layout, smoothing=options.smoothing)
    linear = [block.compute_linear_residuals(begin.chi, setting.stiffness) for block in cost.blocks]
    cost = cost.weigh(linear, begin.chi)
    history: list[HistoryEntry] = []
    for number in range(options.rounds + 1):
        run = optimise_nlp(cost, x, compute_scales(cost, x), options)
        residuals, chi = cost.compute_state(run.x).residuals, run.x[layout.dynamics]
        moved, end = chi - x[layout.dynamics], np.abs(chi)
        entry = HistoryEntry(
            merit=run.objective,
            change=float(np.max(np.abs(moved) / np.maximum(end, 1e-3 * float(np.max(end))))),
            norms=tuple(float(np.linalg.norm(residual)) for residual in residuals),
        )
        history.append(entry)
        if number == options.rounds or not run.outcome.usable:
            break
        cost = cost.weigh(residuals, chi)
        x = layout.flatten_slopes(run.x, run.certificate.undetermined)
        if setting.knees is not None:
            setting, x = _move_places(setting, cost, x)
            layout = setting.lay_out(())
        else:
            # The knees of a grid follow the torque reached.
            springs = layout.read_springs(x, _REST_WEIGHT * setting.stiffness)
            dynamics, stribeck = x[layout.dynamics], (x[layout.excess], x[layout.speed])
            layout = setting.lay_out(springs)
            x = layout.build_start(dynamics, springs)
            x[layout.excess], x[layout.speed] = stribeck
        cost = replace(cost, recordings=setting.recordings, layout=layout)
    run = replace(run, x=layout.flatten_slopes(run.x, run.certificate.undetermined))
    springs = layout.read_springs(run.x, _REST_WEIGHT * setting.stiffness)
    slopes = compute_place_slopes(setting, cost, run.x, list_places(setting, cost, run.x))
    fit = replace(
        build_method_fit("nlp", run.x[layout.dynamics], problem.sizes, springs),
        history=tuple(history),
        outcome=run.outcome,
        covariance=cost.compute_covariance(run.x, slopes),
        notices=tuple(_list_notices(run, problem.library.card, layout)),
    )
    return NlpFit(fit=fit, run=run, cost=cost)


def _list_notices(run: NlpRun, card: ModelCard, layout: NlpLayout) -> Iterator[Notice]:
    if not run.converged:
        text = f"nlp did not converge: {run.reason}; parameters and springs are those of its last point"
        yield Notice(code="elastic.nlp-not-converged", text=text)
    unknown = run.certificate.undetermined
    if unknown:
        text = (
            f"not identifiable from these logs: {', '.join(unknown)}; record larger motions, other speeds or "
            "more load, or leave these terms out"
        )
        yield Notice(code="elastic.nlp-undetermined", text=text)
    for name, value in run.certificate.active:
        # Zero is a bound of nature; all others are ours.
        if value != 0.0:
            text = f"{name} is at its limit of {value:g}: the logs do not determine it"
            yield Notice(code="elastic.nlp-limit", text=text)
    # No parameter of the model states Stribeck friction.
    for joint, excess, speed in zip(card.joints, run.x[layout.excess], run.x[layout.speed], strict=False):
        found = (
            f"Fs = {excess:.4g} {joint.torque_unit}, vs = {speed:.4g} {joint.position_unit}/s; "
            "predictions by the result leave it out"
        )
        text = f"joint {joint.name!r}: Stribeck friction on top of the model's: "
        yield Notice(code="elastic.stribeck", text=text + (found if excess > 0.0 else "none"))
