"""Dynamics, friction and hysteresis together, in one constrained problem: the one-shot reference.

    rows         linear parts once, knees and Stribeck friction as steps          (nlp_rows)
    unknowns     chi, weights k >= 0, slopes c > 0, Fs, vs                        (nlp_cost)
    rounds       minimise sum_b |r_b|^2 / sigma_b^2 by Ipopt, then sigma_b <- rms r_b
    places       those of a start move between rounds: [dx; dr] = -H^-1 g,
                 H = sum J'J / sigma^2, g = sum J'r / sigma^2
    certificate  kkt = max_i |z_i - min(u_i, max(l_i, z_i - df/dz_i))|

Unknowns are scaled by the lengths of their columns at the start, x = d z. All constraints are bounds, so
that kkt is zero at a point that satisfies the Karush-Kuhn-Tucker conditions, and nowhere else; it is
computed from our own gradient, whatever the solver says, and a few Newton steps with active bounds end
every run. Stops and knees that are given, or on a grid, stay where they are; knees of a grid follow the
torque that the springs reach. What no motion shows is said: stops beyond the torsion, knees beyond the
torque.

Supported: energy, filtered and momentum rows; Stribeck friction; odd springs; exact and Gauss-Newton
Hessians.
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
from symid.identification.elastic.estimate import HistoryEntry, MethodFit
from symid.identification.elastic.nlp_cost import (
    ElasticNlpCost,
    NlpLayout,
    SpringGrid,
    build_layout,
    build_spring,
    build_start,
    compute_nlp_covariance,
    estimate_linear_sigmas,
    estimate_sigmas,
    flatten_slopes,
    invert_normal_equations,
    list_weights,
)
from symid.identification.elastic.nlp_rows import NlpRecording, build_nlp_recording, move_stops
from symid.identification.elastic.options import NlpOptions
from symid.identification.elastic.problem import ElasticProblem, build_method_fit
from symid.identification.elastic.spring_fit import compute_room
from symid.identification.elastic.two_step import fit_linear_spring
from symid.identification.hysteresis import LEAST_KNEE, build_knee_grid
from symid.ipopt import Ending, IpoptOptions, SmoothProblem, keep_last, minimise
from symid.robot import Elasticity

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
class ActiveBound:
    """An unknown at a bound: name, "lower" or "upper", its value, and the multiplier in scaled unknowns."""

    name: str
    side: str
    value: float
    multiplier: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """What proves an optimum, computed without the solver.

    Args:
        kkt: scaled residual of the optimality conditions.
        violation: largest distance outside a bound, scaled.
        active: bounds that hold unknowns.
        undetermined: unknowns without any effect at this point, or none apart from k0.
        condition: condition number of the scaled Hessian of all other unknowns that no bound holds.
        curvature: its least eigenvalue; positive at a strict local minimum.
    """

    kkt: float
    violation: float
    active: tuple[ActiveBound, ...]
    undetermined: tuple[str, ...]
    condition: float
    curvature: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpRun(FrozenArrays):
    """One run.

    Args:
        x: (x,) unknowns in SI units; objective: f; start: f at the start.
        outcome, reason: how it ended.
    """

    x: FloatArray
    objective: float
    start: float
    outcome: Ending
    reason: str
    certificate: Certificate

    @property
    def converged(self) -> bool:
        """Return whether the run ended at an optimum."""
        return self.outcome in {Ending.CONVERGED, Ending.ACCEPTABLE}


def build_smooth_problem(cost: ElasticNlpCost, hessian: str) -> SmoothProblem:
    """Return the problem of `cost`, with its "exact" or "gauss-newton" Hessian."""
    state = keep_last(cost.find_state)

    def find_hessian(x: FloatArray) -> FloatArray:
        return cost.find_hessian(state(x), x) if hessian == "exact" else cost.find_gauss_newton(state(x))

    return SmoothProblem(
        value=lambda x: cost.find_value(state(x)),
        gradient=lambda x: cost.find_gradient(state(x)),
        hessian=find_hessian,
        lower=cost.layout.lower,
        upper=cost.layout.upper,
    )


def compute_scales(cost: ElasticNlpCost, x: FloatArray) -> FloatArray:
    """Return d (x,), SI units per scaled unknown: one over the length of each column at x."""
    diagonal = np.diag(cost.find_gauss_newton(cost.find_state(x)))
    # A column that is empty at the start has no length yet: its unknown keeps its own size.
    own = np.maximum(np.abs(x), 1e-3)
    return np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), own)


def optimise_nlp(cost: ElasticNlpCost, start: FloatArray, scales: FloatArray, options: NlpOptions) -> NlpRun:
    """Return the optimum next to `start` (x,), with its certificate.

    Args:
        cost: of the problem.
        start: unknowns, SI; moved between the bounds where it is outside.
        scales: SI units per scaled unknown.
        options: Hessian, tolerance, limit of iterations.
    """
    layout = cost.layout
    scaled = build_smooth_problem(cost, options.hessian).scale(scales)
    begin = np.clip(start, layout.lower, layout.upper) / scales
    first = scaled.value(begin)
    run = minimise(scaled, begin, IpoptOptions(tolerance=options.tolerance, iterations=options.iterations))
    outcome, reason = run.outcome, run.reason
    x = np.clip(_polish(scaled, run.x) * scales, layout.lower, layout.upper)
    certificate = compute_certificate(cost, x, scales)
    if outcome is Ending.CONVERGED and certificate.kkt > _KKT:
        outcome = Ending.STALLED
        reason = (
            f"Ipopt reports success, but the residual of the optimality conditions is {certificate.kkt:.1e}"
        )
    return NlpRun(
        x=x,
        objective=cost.find_value(cost.find_state(x)),
        start=first,
        outcome=outcome,
        reason=reason,
        certificate=certificate,
    )


def compute_certificate(cost: ElasticNlpCost, x: FloatArray, scales: FloatArray) -> Certificate:
    """Return the proof of optimality at x (x,), from our own derivatives."""
    layout = cost.layout
    state = cost.find_state(x)
    slope = cost.find_gradient(state) * scales
    z, low, high = x / scales, layout.lower / scales, layout.upper / scales
    kkt = _compute_kkt(z, slope, low, high)
    violation = float(np.max(np.maximum(np.maximum(low - z, z - high), 0.0)))
    at_low = (z - low <= _AT_BOUND) & (slope > 0.0) & (low < high)
    at_high = (high - z <= _AT_BOUND) & (slope < 0.0) & (low < high)
    active = tuple(
        ActiveBound(
            name=layout.names[place],
            side="lower" if at_low[place] else "upper",
            value=float(x[place]),
            multiplier=float(abs(slope[place])),
        )
        for place in np.flatnonzero(at_low | at_high)
    )
    hessian = cost.find_hessian(state, x) * scales * scales[:, None]
    blind = (np.diag(hessian) <= _BLIND) & (np.abs(slope) <= _BLIND)
    free = ~(at_low | at_high | blind | (low == high))
    values = np.linalg.eigvalsh(hessian[np.ix_(free, free)])
    return Certificate(
        kkt=kkt,
        violation=violation,
        active=active,
        undetermined=tuple(layout.names[place] for place in np.flatnonzero(blind | (low == high))),
        condition=float(values[-1] / values[0]) if values[0] > 0.0 else np.inf,
        curvature=float(values[0]),
    )


def _polish(problem: SmoothProblem, z: FloatArray) -> FloatArray:
    """Return z (x,) after Newton steps in the unknowns that no bound holds; the others go onto their bounds.

    An interior-point method stays off the bounds by its barrier over the multiplier. A step is kept while our
    own residual falls.
    """
    low, high, hessian_of = problem.lower, problem.upper, problem.hessian
    if hessian_of is None:
        return np.clip(z, low, high)
    best = np.clip(z, low, high)
    slope = problem.gradient(best)
    residual = _compute_kkt(best, slope, low, high)
    for _ in range(_NEWTON_STEPS):
        near = np.minimum(np.abs(slope), _NEAR_BOUND)
        at_low, at_high = (best - low < near) & (slope > 0.0), (high - best < near) & (slope < 0.0)
        trial = np.where(at_low, low, np.where(at_high, high, best))
        free = np.flatnonzero(~(at_low | at_high))
        hessian = hessian_of(best)[np.ix_(free, free)]
        away = problem.gradient(trial)
        trial[free] -= np.linalg.lstsq(hessian, away[free], rcond=1e-12)[0]
        trial = np.clip(trial, low, high)
        slope = problem.gradient(trial)
        reached = _compute_kkt(trial, slope, low, high)
        if not reached < residual:
            break
        best, residual = trial, reached
    return best


def _compute_kkt(z: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray) -> float:
    return float(np.max(np.abs(z - np.clip(z - slope, low, high))))


@dataclass(frozen=True, slots=True, kw_only=True)
class NlpPlace:
    """A stop, or a knee, of a joint: the index of its threshold among those of the joint."""

    joint: int
    knee: bool
    index: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpSetting:
    """What all rounds share.

    Args:
        problem, options: of the run.
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

    @property
    def stops_move(self) -> bool:
        """Return whether the data place the stops: not those that are given, or on a grid with the knees."""
        return self.problem.options.moves_stops and self.knees is not None

    @property
    def knees_move(self) -> bool:
        """Return whether the data place the knees; those of odd springs stand in pairs, and stay."""
        return self.stops_move and self.problem.options.knee_torques is None and not self.options.odd

    def lay_out(self, springs: Sequence[Elasticity]) -> NlpLayout:
        """Return the unknowns, with knees for what `springs` reach."""
        grids = []
        for joint, thresholds in enumerate(self.thresholds):
            bases = [part.bases[joint] for part in self.recordings]
            if self.knees is not None:
                knees = self.knees[joint]
            else:
                weights = list_weights(springs[joint], thresholds)
                inner = [basis @ weights for basis in bases]
                count, odd = self.problem.options.knees, self.options.odd
                knees = tuple(sorted(map(float, build_knee_grid(inner, count, odd=odd))))
            grid = SpringGrid(
                thresholds=thresholds,
                knees=knees,
                stiffness=float(self.stiffness[joint]),
                reach=max(float(np.abs(basis[:, 0]).max()) for basis in bases),
            )
            grids.append(grid)
        return build_layout(self.problem.library.card, grids, self.options)

    def shift(self, places: Sequence[NlpPlace], steps: FloatArray) -> "NlpSetting":
        """Return the setting with each of the places moved by a step (places,)."""
        knees = [list(entries) for entries in self.knees or ()]
        moves: list[dict[int, float]] = [{} for _ in self.thresholds]
        for place, step in zip(places, steps.tolist(), strict=True):
            if place.knee:
                knees[place.joint][place.index] += step
            elif step:
                moves[place.joint][place.index] = float(self.thresholds[place.joint][place.index]) + step
        moved = replace(self, knees=None if self.knees is None else tuple(map(tuple, knees)))
        if not any(moves):
            return moved
        grids = [grid.copy() for grid in self.thresholds]
        for grid, entries in zip(grids, moves, strict=True):
            grid[list(entries)] = list(entries.values())
        thresholds = tuple(map(freeze, grids))
        if "filtered" in self.options.rows:
            recordings = _build_recordings(self.problem, thresholds, self.options)
        else:
            recordings = tuple(
                move_stops(recording, self.problem, number, moves)
                for number, recording in enumerate(self.recordings)
            )
        return replace(moved, thresholds=thresholds, recordings=recordings)


def prepare_setting(problem: ElasticProblem, options: NlpOptions, begin: MethodFit) -> NlpSetting:
    """Return the setting of the first round; stops and knees are those of `begin` where it has some."""
    springs = begin.elasticity
    placed = any(spring.stops or spring.knees for spring in springs)
    thresholds = problem.thresholds
    knees = problem.options.knee_torques
    if placed:
        thresholds = tuple(freeze([stop.threshold for stop in spring.stops]) for spring in springs)
        knees = tuple(tuple(knee.threshold for knee in spring.knees) for spring in springs)
    whole = np.array([spring.initial_stiffness or 0.0 for spring in springs])
    return NlpSetting(
        problem=problem,
        options=options,
        recordings=_build_recordings(problem, thresholds, options),
        thresholds=thresholds,
        knees=knees,
        stiffness=np.maximum(whole, 1e-6 * max(float(whole.max()), 1e-6)),
    )


def _build_recordings(
    problem: ElasticProblem, thresholds: Sequence[FloatArray], options: NlpOptions
) -> tuple[NlpRecording, ...]:
    numbers = range(len(problem.signals))
    return tuple(build_nlp_recording(problem, number, thresholds, options.rows) for number in numbers)


REST_WEIGHT = 1e-9
"""Of the linear spring: weights below it are zero."""
_SHIFT = 1e-4
"""Of the place of a stop or knee, for derivatives by it."""
_FRACTIONS = (1.0, 0.5, 0.25, 0.125)


def list_places(setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray) -> tuple[NlpPlace, ...]:
    """Return the stops and knees that the data place."""
    places = []
    for joint, spring in enumerate(cost.layout.springs):
        if setting.stops_move:
            least = REST_WEIGHT * setting.stiffness[joint]
            busy = np.flatnonzero(x[spring.weights][1:] > least)
            places += [NlpPlace(joint=joint, knee=False, index=int(stop)) for stop in busy]
        if setting.knees_move:
            places += [NlpPlace(joint=joint, knee=True, index=knee) for knee in range(len(spring.knees))]
    return tuple(places)


def compute_place_slopes(
    setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray, places: Sequence[NlpPlace]
) -> list[list[FloatArray]]:
    """Return the derivatives of all residuals (M_b,) of every block by each place."""
    before = cost.find_state(x).residuals
    slopes = []
    for place in places:
        grids = (setting.knees or ()) if place.knee else setting.thresholds
        step = _SHIFT * abs(float(grids[place.joint][place.index]))
        moved = _rebuild(cost, setting.shift([place], np.array([step]))).find_state(x).residuals
        slopes.append([(after - now) / step for after, now in zip(moved, before, strict=True)])
    return slopes


def move_places(setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray) -> tuple[NlpSetting, FloatArray]:
    """Return setting and unknowns a step nearer to the optimum of unknowns and places together.

    Args:
        setting: where stops and knees stand.
        cost: of that setting.
        x: (x,) its optimum with these places.
    """
    places = list_places(setting, cost, x)
    if not places:
        return setting, x
    inverse, scores = invert_normal_equations(cost, x, compute_place_slopes(setting, cost, x, places))
    step = -inverse @ scores.sum(axis=0)
    value = cost.find_value(cost.find_state(x))
    lower, upper = _compute_place_limits(setting, cost, x, places)
    for fraction in _FRACTIONS:
        move = np.clip(fraction * step[len(x) :], lower, upper)
        moved = setting.shift(places, move)
        trial = _rebuild(cost, moved)
        start = np.clip(x + fraction * step[: len(x)], trial.layout.lower, trial.layout.upper)
        if trial.find_value(trial.find_state(start)) < value:
            return moved, start
    return setting, x


def _rebuild(cost: ElasticNlpCost, setting: NlpSetting) -> ElasticNlpCost:
    return replace(cost, recordings=setting.recordings, layout=setting.lay_out(()))


def _compute_place_limits(
    setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray, places: Sequence[NlpPlace]
) -> tuple[FloatArray, FloatArray]:
    """Return how far each place may move down and up."""
    limits: dict[NlpPlace, tuple[float, float]] = {}
    for joint, spring in enumerate(cost.layout.springs):
        bases = [part.bases[joint] for part in setting.recordings]
        reach = max(float(np.abs(basis[:, 0]).max()) for basis in bases)
        torque = np.concatenate([basis @ x[spring.weights] for basis in bases])
        for index, ends in enumerate(zip(*compute_room(setting.thresholds[joint], 0.0, reach), strict=True)):
            limits[NlpPlace(joint=joint, knee=False, index=index)] = ends
        for side in (-1.0, 1.0):
            order = [index for index, knee in enumerate(spring.knees) if knee * side > 0.0]
            if side < 0.0:
                order.reverse()
            edge = max(0.0, float(np.max(side * torque)))
            room = compute_room(np.abs([spring.knees[index] for index in order]), LEAST_KNEE * edge, edge)
            for index, down, up in zip(order, *room, strict=True):
                ends = (down, up) if side > 0.0 else (-up, -down)
                limits[NlpPlace(joint=joint, knee=True, index=index)] = ends
    found = np.array([limits[place] for place in places])
    return found[:, 0], found[:, 1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpFit:
    """What the problem gave.

    Args:
        fit: parameters and springs, outcome, one history entry a round.
        run: the last run, with its certificate.
        cost: of the last round; its `sigmas` are the row scales, its `layout` names the unknowns.
        scales: (x,) SI units per scaled unknown.
        stiffness: (n,) of the linear springs that bound the weights.
    """

    fit: MethodFit
    run: NlpRun
    cost: ElasticNlpCost
    scales: FloatArray
    stiffness: FloatArray


def fit_nlp(
    problem: ElasticProblem, options: NlpOptions | None = None, start: MethodFit | None = None
) -> NlpFit:
    """Return the optimum of the hysteresis-plus-friction problem.

    Args:
        problem: recordings, grids, window and filter.
        options: rows, friction, bounds, solver; None for those of the problem.
        start: dynamics and springs to begin with, whose stops and knees move to better places near where the
            problem refines its grids. None for those of the elimination, or, where it does not, for linear
            springs on the grids.
    """
    options = options or problem.options.nlp
    # Refined stops and knees begin where the elimination puts them.
    begin = start or (fit_elimination(problem) if problem.options.moves_stops else fit_linear_spring(problem))
    setting = prepare_setting(problem, options, begin)
    layout = setting.lay_out(begin.elasticity)
    x = build_start(layout, begin.chi, begin.elasticity)
    sigmas = estimate_linear_sigmas(setting.recordings, begin.chi, setting.stiffness)
    history: list[HistoryEntry] = []
    for number in range(options.rounds + 1):
        cost = ElasticNlpCost(
            recordings=setting.recordings, layout=layout, sigmas=sigmas, smoothing=options.smoothing
        )
        scales = compute_scales(cost, x)
        run = optimise_nlp(cost, x, scales, options)
        moved, end = run.x[layout.dynamics] - x[layout.dynamics], np.abs(run.x[layout.dynamics])
        residuals = cost.find_state(run.x).residuals
        entry = HistoryEntry(
            merit=run.objective,
            change=float(np.max(np.abs(moved) / np.maximum(end, 1e-3 * float(np.max(end))))),
            norms=tuple(float(np.linalg.norm(residual)) for residual in residuals),
        )
        history.append(entry)
        if number == options.rounds or not run.outcome.usable:
            break
        sigmas = estimate_sigmas(cost, run.x)
        setting, layout, x = _carry_over(setting, replace(cost, sigmas=sigmas), run)
    run = replace(run, x=flatten_slopes(layout, run.x, run.certificate.undetermined))
    springs = _read_springs(layout, run.x, setting.stiffness)
    slopes = compute_place_slopes(setting, cost, run.x, list_places(setting, cost, run.x))
    fit = build_method_fit(
        problem,
        "nlp",
        run.x[layout.dynamics],
        springs,
        history=tuple(history),
        outcome=run.outcome,
        covariance=compute_nlp_covariance(cost, run.x, slopes),
        notices=(*_list_notices(run), *_describe_stribeck(problem.library.card, layout, run.x)),
    )
    return NlpFit(fit=fit, run=run, cost=cost, scales=scales, stiffness=setting.stiffness)


def _carry_over(
    setting: NlpSetting, cost: ElasticNlpCost, run: NlpRun
) -> tuple[NlpSetting, NlpLayout, FloatArray]:
    """Return setting, layout and start of the next round.

    Stops and knees are a step nearer to their best places; the knees of a grid follow the torque reached.
    """
    layout = cost.layout
    x = flatten_slopes(layout, run.x, run.certificate.undetermined)
    if setting.knees is not None:
        setting, x = move_places(setting, cost, x)
        return setting, setting.lay_out(()), x
    springs = _read_springs(layout, x, setting.stiffness)
    fresh = setting.lay_out(springs)
    start = build_start(fresh, x[layout.dynamics], springs)
    start[fresh.excess], start[fresh.speed] = x[layout.excess], x[layout.speed]
    return setting, fresh, start


def _list_notices(run: NlpRun) -> Iterator[Notice]:
    if not run.converged:
        text = f"the problem was not solved: {run.reason}; parameters and springs are those of its last point"
        yield Notice(code="elastic.nlp-not-converged", text=text)
    unknown = run.certificate.undetermined
    if unknown:
        text = (
            f"the recordings do not show {', '.join(unknown)}: move farther, at other speeds or with more "
            "load, or leave these terms out"
        )
        yield Notice(code="elastic.nlp-undetermined", text=text)
    for bound in run.certificate.active:
        # Zero is a bound of nature; all others are ours.
        if bound.value != 0.0:
            text = f"{bound.name} is at its limit of {bound.value:g}: the recordings do not hold it"
            yield Notice(code="elastic.nlp-limit", text=text)


def _describe_stribeck(card: ModelCard, layout: NlpLayout, x: FloatArray) -> Iterator[Notice]:
    """Yield the Stribeck friction that was found besides: no parameter of the model states it."""
    for joint, excess, speed in zip(card.joints, x[layout.excess], x[layout.speed], strict=False):
        text = f"joint {joint.name!r}: Stribeck friction on top of the model's: "
        if excess > 0.0:
            text += (
                f"Fs = {excess:.4g} {joint.torque_unit}, vs = {speed:.4g} {joint.position_unit}/s; "
                "predictions by the result leave it out"
            )
        else:
            text += "none"
        yield Notice(code="elastic.stribeck", text=text)


def _read_springs(layout: NlpLayout, x: FloatArray, stiffness: FloatArray) -> tuple[Elasticity, ...]:
    return tuple(
        build_spring(spring, x, REST_WEIGHT * whole)
        for spring, whole in zip(layout.springs, stiffness, strict=True)
    )
