"""Dynamics, friction and hysteresis together, in one constrained problem: the one-shot reference.

As functions of arrays, the cost and unknowns of `nlp_cost`, fitted in rounds:

    rounds       minimise sum_b |r_b|^2 / sigma_b^2 by Ipopt, then sigma_b <- rms r_b, until nothing moves
    places       those of a start move between rounds: [dx; dr] = -H^-1 g,
                 H = sum J'J / sigma^2, g = sum J'r / sigma^2
    certificate  kkt = max_i |z_i - min(u_i, max(l_i, z_i - df/dz_i))|

Unknowns are scaled by the lengths of their columns at the start, x = d z; all constraints are bounds. Stops
and knees that are given, or on a grid, stay; knees of a grid follow the torque that the springs reach.

As expressions of CasADi, the last round open to further unknowns, torques, terms and constraints: columns of
what is linear in the unknowns are numbers, because states are measured; the rest is expressions over samples,
added up to rows by sparse matrices; derivatives are CasADi's. Weights of rows, stops and torques of knees are
those of the fit. An added torque stands beside the spring; its work in energy rows is a sum of trapezoids.

Supported: energy, filtered, momentum rows; Stribeck friction; odd springs; exact, Gauss-Newton Hessians;
torques of any unknowns added to a spring or a motor, such as damping, a cubic spring, a stop whose threshold
is an unknown.
Not supported: another number of stops and knees than that of the start; proof that no better optimum exists;
of expressions: covariance, weights that follow residuals, expressions of SX (its functions take MX).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi
import numpy as np
import scipy

from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.codegen import ModelCard
from symid.errors import Notice, SolverError, UsageError
from symid.identification.elastic.elimination import fit_elimination
from symid.identification.elastic.estimate import HistoryEntry, MethodFit, build_method_fit
from symid.identification.elastic.nlp_cost import (
    ElasticNlpCost,
    NlpLayout,
    NlpRecording,
    RowBlock,
    SpringGrid,
    StepSums,
    build_nlp_recording,
    list_weights,
    move_stops,
)
from symid.identification.elastic.options import NlpOptions
from symid.identification.elastic.regression import ElasticProblem, average_steps
from symid.identification.elastic.together import TRIALS, fit_linear_spring
from symid.identification.hysteresis import STEP, SpringWeights, build_knee_grid, compute_place_limits
from symid.identification.judge import numerics
from symid.ipopt import Ending, GraphProblem, IpoptOptions, SmoothProblem, keep_last, minimise, minimise_graph
from symid.joint_models import Elasticity, build_casadi_carrier, compute_play, compute_stribeck_derivatives
from symid.robot import suggest_names

_TOLERANCE, _NEAR_BOUND = 1e-9, 1e-3
"""Of Ipopt, on the scaled problem; distance within which Newton steps try an unknown on its bound."""


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


@dataclass(frozen=True, slots=True, eq=False)
class NlpRun(FrozenArrays):
    """One run: (x,) unknowns in SI units, f, and how it ended."""

    x: FloatArray
    objective: float
    outcome: Ending
    reason: str
    certificate: Certificate


def compute_scales(cost: ElasticNlpCost, x: FloatArray) -> FloatArray:
    """Return d (x,), SI units per scaled unknown: one over the length of each column at x."""
    diagonal = np.diag(cost.compute_gauss_newton(cost.compute_state(x)))
    # A column that is empty at the start has no length yet: its unknown keeps its own size.
    own = np.maximum(np.abs(x), 1e-3)
    return np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), own)


def optimise_nlp(
    cost: ElasticNlpCost, start: FloatArray, scales: FloatArray, options: NlpOptions, *, near: bool = False
) -> NlpRun:
    """Return the optimum next to `start` (x,), with its certificate; a start outside the bounds is clipped.

    Unknowns are in SI units, `scales` (x,) in SI units per scaled one. From a start that is `near`, Newton
    steps mostly do; else Ipopt begins with a small barrier, and anew with its own, and the better run counts.
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
    if near:
        x = np.clip(_polish(scaled, begin) * scales, layout.lower, layout.upper)
        certificate = compute_certificate(cost, x, scales)
        if certificate.kkt <= _TOLERANCE and certificate.curvature > 0.0:
            return NlpRun(
                x, cost.compute_value(state(x)), Ending.CONVERGED, Ending.CONVERGED.value, certificate
            )
    ipopt = IpoptOptions(tolerance=_TOLERANCE, iterations=options.iterations)
    run = minimise(scaled, begin, replace(ipopt, barrier=ipopt.tolerance) if near else ipopt)
    if near and run.outcome is not Ending.CONVERGED:
        runs = run, minimise(scaled, begin, ipopt)
        endings = [(one.outcome is not Ending.CONVERGED, not one.outcome.usable) for one in runs]
        run = runs[min((0, 1), key=lambda place: (*endings[place], scaled.value(runs[place].x)))]
    outcome, reason = run.outcome, run.reason
    x = np.clip(_polish(scaled, run.x) * scales, layout.lower, layout.upper)
    certificate = compute_certificate(cost, x, scales)
    if outcome is Ending.CONVERGED and certificate.kkt > numerics.CONVERGED:
        outcome = Ending.STALLED
        reason = "Ipopt reports success, but the residual of the optimality conditions is "
        reason += f"{certificate.kkt:.1e}"
    return NlpRun(x, cost.compute_value(state(x)), outcome, reason, certificate)


def compute_certificate(cost: ElasticNlpCost, x: FloatArray, scales: FloatArray) -> Certificate:
    """Return the proof of optimality at x (x,), from our own derivatives."""
    layout = cost.layout
    state = cost.compute_state(x)
    slope = cost.compute_gradient(state) * scales
    z, low, high = x / scales, layout.lower / scales, layout.upper / scales
    at_low = (z - low <= numerics.RANK) & (slope > 0.0) & (low < high)
    at_high = (high - z <= numerics.RANK) & (slope < 0.0) & (low < high)
    hessian = cost.compute_hessian(state, x) * scales * scales[:, None]
    blind = (np.diag(hessian) <= numerics.EXACT) & (np.abs(slope) <= numerics.EXACT)
    free = ~(at_low | at_high | blind | (low == high))
    return Certificate(
        kkt=_compute_kkt(z, slope, low, high),
        active=tuple((layout.names[place], float(x[place])) for place in np.flatnonzero(at_low | at_high)),
        undetermined=tuple(layout.names[place] for place in np.flatnonzero(blind | (low == high))),
        curvature=float(np.linalg.eigvalsh(hessian[np.ix_(free, free)])[0]),
    )


def _polish(problem: SmoothProblem, z: FloatArray) -> FloatArray:
    """Return z (x,) after Newton steps in unknowns that no bound holds; the others go onto their bounds."""
    low, high, hessian_of = problem.lower, problem.upper, problem.hessian
    best = np.clip(z, low, high)
    if hessian_of is None:
        return best
    slope = problem.gradient(best)
    residual = _compute_kkt(best, slope, low, high)
    for _ in range(numerics.ROUNDS):
        near = np.minimum(np.abs(slope), _NEAR_BOUND)
        at_low, at_high = (best - low < near) & (slope > 0.0), (high - best < near) & (slope < 0.0)
        trial = np.where(at_low, low, np.where(at_high, high, best))
        free = np.flatnonzero(~(at_low | at_high))
        hessian = hessian_of(best)[np.ix_(free, free)]
        trial[free] -= np.linalg.lstsq(hessian, problem.gradient(trial)[free], rcond=numerics.EXACT)[0]
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
        grids, problem = [], self.problem
        for joint, thresholds in enumerate(self.thresholds):
            bases = [part.bases[joint] for part in self.recordings]
            if not problem.gives[joint]:
                grids.append(SpringGrid(thresholds=np.zeros(0), knees=(), stiffness=0.0, reach=0.0))
                continue
            if self.knees is None:
                inner = [basis @ list_weights(springs[joint], thresholds) for basis in bases]
                grid = build_knee_grid(inner, problem.options.knees, odd=self.options.odd)
            knees = tuple(sorted(grid.tolist())) if self.knees is None else self.knees[joint]
            stiffness, reach = float(self.stiffness[joint]), max(float(np.abs(b[:, 0]).max()) for b in bases)
            grids.append(SpringGrid(thresholds=thresholds, knees=knees, stiffness=stiffness, reach=reach))
        return NlpLayout.build(problem.library.card, grids, self.options, problem.known)

    def shift(self, places: Sequence[NlpPlace], steps: FloatArray) -> "NlpSetting":
        """Return the setting with each of the places moved by a step (places,)."""
        knees = [list(entries) for entries in self.knees or ()]
        moves: list[dict[int, float]] = [{} for _ in self.thresholds]
        for place, step in zip(places, steps.tolist(), strict=True):
            if place.knee:
                knees[place.joint][place.index] += step
            elif step:
                moves[place.joint][place.index] = float(self.thresholds[place.joint][place.index]) + step
        grids = [grid.copy() for grid in self.thresholds]
        for grid, moved in zip(grids, moves, strict=True):
            grid[list(moved)] = list(moved.values())
        return replace(
            self,
            knees=None if self.knees is None else tuple(map(tuple, knees)),
            thresholds=tuple(map(freeze, grids)),
            recordings=tuple(move_stops(recording, moves) for recording in self.recordings),
        )


def prepare_setting(problem: ElasticProblem, options: NlpOptions, begin: MethodFit) -> NlpSetting:
    """Return the setting of the first round; stops and knees are those of `begin` where it has some."""
    springs = begin.elasticity
    thresholds, knees = tuple(data.thresholds for data in problem.springs), problem.options.knee_torques
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
        stiffness=np.maximum(whole, numerics.CONVERGED * max(float(whole.max()), numerics.CONVERGED)),
    )


def list_places(setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray) -> tuple[NlpPlace, ...]:
    """Return the stops and knees that move: none that are given, on a grid, or knees of odd springs."""
    options = setting.problem.options
    if setting.knees is None or not options.moves_stops:
        return ()
    places = []
    for joint, spring in enumerate(cost.layout.springs):
        busy = np.flatnonzero(x[spring.weights][1:] > numerics.CONVERGED * setting.stiffness[joint])
        places += [NlpPlace(joint=joint, knee=False, index=int(stop)) for stop in busy]
        if options.knee_torques is None and not setting.options.odd:
            places += [NlpPlace(joint=joint, knee=True, index=knee) for knee in range(len(spring.knees))]
    return tuple(places)


def compute_place_slopes(
    setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray, places: Sequence[NlpPlace]
) -> list[list[FloatArray]]:
    """Return the derivatives of all residuals (M_b,) of every block by each place."""
    before, slopes = {joint: cost.compute_spring(x, joint) for joint in {place.joint for place in places}}, []
    for place in places:
        grids = (setting.knees or ()) if place.knee else setting.thresholds
        step = STEP * abs(float(grids[place.joint][place.index]))
        moved = _rebuild(cost, setting.shift([place], np.array([step]))).compute_spring(x, place.joint)
        slopes.append([(now - after) / step for after, now in zip(moved, before[place.joint], strict=True)])
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
        own, ones = x[spring.weights], np.ones(len(knees))
        weights = SpringWeights(thresholds=spring.thresholds, stiffness=own, knees=knees[order], slopes=ones)
        ends = compute_place_limits([part.bases[joint] for part in setting.recordings], weights)
        known = [NlpPlace(joint=joint, knee=False, index=index) for index in range(len(spring.thresholds))]
        known += [NlpPlace(joint=joint, knee=True, index=index) for index in order.tolist()]
        limits |= dict(zip(known, zip(*(part.tolist() for part in ends), strict=True), strict=True))
    lower, upper = np.array([limits[place] for place in places]).T
    for fraction in 0.5 ** np.arange(TRIALS):
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
    cost = cost.weigh(cost.compute_state(x).residuals, begin.chi)
    history: list[HistoryEntry] = []
    before, last = begin.chi, None
    for number in range(options.rounds + 1):
        run = optimise_nlp(cost, x, compute_scales(cost, x), options, near=number > 0)
        if last is not None and not run.outcome.usable:
            run, cost, setting = last
            break
        last = run, cost, setting
        residuals, chi = cost.compute_state(run.x).residuals, run.x[layout.dynamics]
        moved, end = chi - before, np.abs(chi)
        entry = HistoryEntry(
            merit=run.objective,
            change=float(np.max(np.abs(moved) / np.maximum(end, 1e-3 * float(np.max(end))))),
            norms=tuple(float(np.linalg.norm(residual)) for residual in residuals),
        )
        history.append(entry)
        weighed = cost.weigh(residuals, chi)
        scaled = float(np.max(np.abs(np.array(weighed.sigmas) / np.array(cost.sigmas) - 1.0)))
        settled = max(entry.change, scaled) <= problem.options.tolerance
        # Of the start's places nothing is known before a step of theirs.
        if number == options.rounds or not run.outcome.usable or (number > 0 and settled):
            break
        # The next round begins with places a step better, knees of a grid at the torque reached.
        before, layout = chi, weighed.layout
        x = layout.flatten_slopes(run.x, run.certificate.undetermined)
        if setting.knees is not None:
            setting, x = _move_places(setting, weighed, x)
            after = setting.lay_out(())
        else:
            springs = layout.read_springs(x, numerics.CONVERGED * setting.stiffness)
            after = setting.lay_out(springs)
            excess, speed = x[layout.excess], x[layout.speed]
            x = after.build_start(x[layout.dynamics], springs)
            x[after.excess], x[after.speed] = excess, speed
        cost = replace(weighed, recordings=setting.recordings, layout=after)
    layout = cost.layout
    run = replace(run, x=layout.flatten_slopes(run.x, run.certificate.undetermined))
    springs = layout.read_springs(run.x, numerics.CONVERGED * setting.stiffness)
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
    if not run.outcome.converged:
        text = f"nlp did not converge: {run.reason}; its last point may be far off, try other methods"
        yield Notice(code="elastic.nlp-not-converged", text=text)
    # Dynamic parameters with one bound are known, and rigid joints have no spring.
    places = [*range(layout.dynamics.stop), *(entry.weights.start for entry in layout.springs)]
    known = {layout.names[place] for place in places if layout.lower[place] == layout.upper[place]}
    unknown = [name for name in run.certificate.undetermined if name not in known]
    if unknown:
        text = f"not identifiable from these logs: {', '.join(unknown)}; record larger motions, other speeds "
        text += "or more load, or leave these terms out"
        yield Notice(code="elastic.nlp-undetermined", text=text)
    for name, value in run.certificate.active:
        # Zero is a bound of nature; all others are ours.
        if value != 0.0:
            text = f"{name} is at its limit of {value:g}: the logs do not determine it; record larger motions"
            yield Notice(code="elastic.nlp-limit", text=text)
    # No parameter of the model states Stribeck friction.
    for joint, excess, speed in zip(card.joints, run.x[layout.excess], run.x[layout.speed], strict=False):
        found = f"Fs = {excess:.4g} {joint.torque_unit}, vs = {speed:.4g} {joint.position_unit}/s; "
        found += "predictions leave it out; state such a law to keep it"
        text = f"joint {joint.name!r}: Stribeck friction on top of the model's: "
        yield Notice(code="elastic.stribeck", text=text + (found if excess > 0.0 else "none"))


SIDES = ("spring", "motor")


@dataclass(frozen=True, slots=True, eq=False)
class ElasticMotion:
    """One joint along one recording, (N, 1) each, as matrices of CasADi.

    Args:
        q, dq: of the link, rad and rad/s, or m and m/s; theta, dtheta: of the motor, on the joint side.
        phi, dphi: torsion theta - q and its rate.
    """

    q: Any
    dq: Any
    theta: Any
    dtheta: Any
    phi: Any
    dphi: Any

    def play(self, threshold: Any) -> Any:  # noqa: ANN401  # an expression of casadi, or a number
        """Return the play of the torsion (N, 1) for a threshold in rad or m, from the virgin state on."""
        memory, value, radius = (casadi.SX.sym(name) for name in ("memory", "value", "radius"))
        after = compute_play(build_casadi_carrier(), value, radius, memory)
        step, count = casadi.Function("play", [memory, value, radius], [after]), self.phi.shape[0]
        return step.mapaccum(count)(0.0, self.phi.T, casadi.repmat(threshold, 1, count)).T


@dataclass(frozen=True, slots=True, eq=False)
class NlpVariable:
    """An unknown: its symbol of MX, where it starts, its bounds, SI units per scaled unknown (None: open)."""

    symbol: Any
    start: float
    lower: float
    upper: float
    scale: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpGraph:
    """The problem.

    Args:
        variables: by name, in the order of the layout, then those added.
        residuals: (M_b, 1) of each block, in units of its scale; terms: added to the cost; constraints: lower
            limit, expression and upper limit of each, infinite where there is no limit.
        joints: their names; motions: for each block, those of its recording.
        blocks: the rows, each with its scale sigma.
    """

    variables: Mapping[str, NlpVariable]
    residuals: tuple[Any, ...]
    joints: tuple[str, ...]
    motions: tuple[tuple[ElasticMotion, ...], ...]
    blocks: tuple[tuple[RowBlock, float], ...]
    layout: NlpLayout
    options: NlpOptions
    terms: tuple[Any, ...] = ()
    constraints: tuple[tuple[float, Any, float], ...] = ()

    @property
    def rows(self) -> int:
        """Return the number of rows M."""
        return sum(len(block.values) for block, _ in self.blocks)

    @property
    def cost(self) -> Any:  # noqa: ANN401  # an expression of casadi
        """Return what is minimised, an expression (1, 1) of MX."""
        squares = sum(casadi.sumsqr(residual) for residual in self.residuals)
        return squares / (2.0 * self.rows) + sum(self.terms)


def build_nlp_graph(found: NlpFit, problem: ElasticProblem, options: NlpOptions) -> NlpGraph:
    """Return the last round of a one-shot fit: the same cost, starting where the fit ended."""
    cost, start = found.cost, found.run.x
    layout = cost.layout
    numbers = np.array([start, layout.lower, layout.upper, compute_scales(cost, start)]).T.tolist()
    pairs = zip(layout.names, numbers, strict=True)
    variables = {name: NlpVariable(casadi.MX.sym(name), *row) for name, row in pairs}
    x = casadi.vertcat(*(entry.symbol for entry in variables.values()))
    residuals, motions, blocks = [], [], []
    sigmas, carrier = iter(cost.sigmas), build_casadi_carrier()
    for part, signals in zip(cost.recordings, problem.signals, strict=True):
        # Step means (N - 1, 1) of what all knees of a joint add to its torque; 0 for none.
        knees = [0] * len(layout.springs)
        for joint, (place, basis) in enumerate(zip(layout.springs, part.bases, strict=True)):
            torque = casadi.DM(basis) @ x[place.weights]
            changes = casadi.DM(place.changes) @ x[place.slopes] + casadi.DM(place.offset)
            for knee, slot in zip(place.knees, place.slots, strict=True):
                side = 1.0 if knee > 0 else -1.0
                beyond = side * (torque - knee)
                before, after = beyond[:-1], beyond[1:]
                crosses = (before > 0.0) != (after > 0.0)
                # Of the branch that is not taken too, derivatives must be finite.
                width = casadi.if_else(crosses, casadi.fabs(after - before), 1.0)
                across = casadi.fmax(before, after) ** 2 / width
                alone = casadi.fmax(before, 0.0) + casadi.fmax(after, 0.0)
                mean = casadi.if_else(crosses, across, alone) / 2.0
                knees[joint] = knees[joint] + side * changes[slot] * mean
        # Step means (N - 1, 1) of the Stribeck friction of every joint that has some.
        excesses, scales = (casadi.vertsplit(x[place]) for place in (layout.excess, layout.speed))
        drags = []
        for rates, excess, scale in zip(part.speed.T, excesses, scales, strict=False):
            speed = casadi.MX(casadi.DM(rates))
            shape, _, _ = compute_stribeck_derivatives(carrier, speed, scale, cost.smoothing)
            drags.append(excess * average_steps(shape))
        along = []
        for states in zip(signals.q.T, signals.dq.T, signals.theta.T, signals.dtheta.T, strict=True):
            q, dq, theta, dtheta = map(casadi.DM, states)
            along.append(ElasticMotion(q, dq, theta, dtheta, phi=theta - q, dphi=dtheta - dq))
        for block in part.blocks:
            sigma = next(sigmas)
            rows = casadi.DM(block.values) - casadi.DM(block.matrix) @ x[layout.dynamics]
            for spring in block.springs:
                weights = x[layout.springs[spring.joint].weights]
                torque = casadi.DM(spring.columns) @ weights + _add_steps(spring.sums, knees[spring.joint])
                rows = rows - block.sign * torque
            for joint, sums in block.friction if drags else ():
                rows = rows - _add_steps(sums, drags[joint])
            residuals.append(rows / sigma)
            motions.append(tuple(along))
            blocks.append((block, sigma))
    return NlpGraph(
        variables=variables,
        residuals=tuple(residuals),
        joints=tuple(joint.name for joint in problem.library.card.joints),
        motions=tuple(motions),
        blocks=tuple(blocks),
        layout=layout,
        options=options,
    )


def _add_steps(sums: StepSums, steps: Any) -> Any:  # noqa: ANN401
    """Return the rows (M, 1) of step means (N - 1, 1)."""
    if isinstance(steps, int):
        return steps
    rows, count = casadi.DM(scipy.sparse.csc_matrix(sums.inflow)) @ steps, sums.inflow.shape[0]
    if not sums.kept:
        return rows
    # Of each row, what is left of it in all later ones.
    left = sums.kept ** np.arange(min(int(np.log(numerics.EXACT) / np.log(sums.kept)) + 1, count))
    places = [-row for row in range(len(left))]
    return casadi.DM(scipy.sparse.diags(left, places, shape=(count, count), format="csc")) @ rows


def get_variable(graph: NlpGraph, name: str) -> Any:  # noqa: ANN401
    """Return the symbol of an unknown; raise UsageError where there is none of that name."""
    if name not in graph.variables:
        hint = suggest_names(name, graph.variables, otherwise="there are")
        text = f"{name!r} is not a variable of this problem: {hint}"
        raise UsageError(Notice(code="usage.unknown-variable", text=text))
    return graph.variables[name].symbol


def add_variable(graph: NlpGraph, name: str, start: float, lower: float, upper: float) -> NlpGraph:
    """Return the problem with one unknown more, in SI units; raise UsageError for a name that is taken."""
    if name in graph.variables:
        text = f"{name!r} is a variable of this problem already; give the new one another name"
        raise UsageError(Notice(code="usage.variable-name", text=text))
    if not (lower <= start <= upper and lower < upper and np.isfinite(start)):
        text = f"{name}: the start {start:g} must be finite and between the bounds {lower:g} and {upper:g}"
        raise UsageError(Notice(code="usage.variable-bounds", text=text))
    added = NlpVariable(casadi.MX.sym(name), start, lower, upper)
    return replace(graph, variables={**graph.variables, name: added})


def add_torque(graph: NlpGraph, joint: str, torque: Callable[[ElasticMotion], Any], side: str) -> NlpGraph:
    """Return the problem with a torque (N, 1), N m or N, added to a joint's spring or its motor's friction.

    Raises:
        UsageError: no such joint or side; the torque is not one number a sample, or of other symbols.
    """
    if joint not in graph.joints:
        hint = suggest_names(joint, graph.joints, otherwise="there are")
        raise UsageError(Notice(code="usage.unknown-joint", text=f"{joint!r} is not a joint: {hint}"))
    if side not in SIDES:
        text = f"side {side!r}: allowed are {', '.join(SIDES)}"
        raise UsageError(Notice(code="usage.torque-side", text=text))
    number, residuals = graph.joints.index(joint), []
    steps: dict[int, Any] = {}
    for residual, along, (block, sigma) in zip(graph.residuals, graph.motions, graph.blocks, strict=True):
        motion = along[number]
        if id(motion) not in steps:
            count = motion.phi.shape[0]
            steps[id(motion)] = average_steps(_take(graph, torque(motion), f"the torque of {joint}", count))
        pairs = [(own.joint, own.sums) for own in block.springs] if side == "spring" else block.friction
        sign = block.sign if side == "spring" else 1.0
        rows = [_add_steps(sums, steps[id(motion)]) for own, sums in pairs if own == number]
        residuals.append(residual - sign / sigma * sum(rows) if rows else residual)
    return replace(graph, residuals=tuple(residuals))


def add_term(graph: NlpGraph, term: Any) -> NlpGraph:  # noqa: ANN401
    """Return the problem with a term (1, 1) added to its cost; raise UsageError where it is none."""
    return replace(graph, terms=(*graph.terms, _take(graph, term, "the term")))


def add_constraint(graph: NlpGraph, expression: Any, lower: float, upper: float) -> NlpGraph:  # noqa: ANN401
    """Return the problem with lower <= expression (1, 1) <= upper; raise UsageError where it is none."""
    if not lower <= upper or lower == np.inf or upper == -np.inf or (lower, upper) == (-np.inf, np.inf):
        text = f"the limits {lower:g} and {upper:g} of a constraint: give one at least, the lower one first"
        raise UsageError(Notice(code="usage.constraint", text=text))
    added = (lower, _take(graph, expression, "the constraint"), upper)
    return replace(graph, constraints=(*graph.constraints, added))


def _take(graph: NlpGraph, given: Any, what: str, samples: int | None = None) -> Any:  # noqa: ANN401
    """Return a scalar, or a column of `samples`, as MX; refuse other shapes, and symbols of elsewhere."""
    try:
        found = casadi.MX(given)
    except (NotImplementedError, TypeError) as error:
        text = f"{what} is {type(given).__name__}: expected a number, or an expression (MX) of the variables"
        raise UsageError(Notice(code="usage.expression", text=text)) from error
    if not (found.is_scalar() if samples is None else found.shape == (samples, 1)):
        wanted = f"{samples} x 1, a number a sample" if samples else "a scalar: sum its entries"
        text = f"{what} has the shape {found.shape[0]} x {found.shape[1]}: must be {wanted}"
        raise UsageError(Notice(code="usage.expression", text=text))
    known = {hash(entry.symbol) for entry in graph.variables.values()}
    strangers = [symbol.name() for symbol in casadi.symvar(found) if hash(symbol) not in known]
    if strangers:
        text = f"{what} has symbols that are not variables of this problem: {', '.join(strangers)}; add "
        text += f"them, or take {', '.join(graph.variables)}"
        raise UsageError(Notice(code="usage.expression", text=text))
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpAnswer:
    """The optimum: values by name, in SI units, and how the search ended.

    Args:
        levels: of the constraints, in their order; active: which of them are at a limit.
        springs: one a joint, without torques that were added.
    """

    values: Mapping[str, float]
    objective: float
    outcome: Ending
    reason: str
    levels: tuple[float, ...]
    active: tuple[bool, ...]
    springs: tuple[Elasticity, ...]


def solve_nlp_graph(graph: NlpGraph) -> NlpAnswer:
    """Return the optimum next to where the variables start; raise SolverError where there is none."""
    entries = list(graph.variables.values())
    x, cost = casadi.vertcat(*(entry.symbol for entry in entries)), graph.cost
    start, lower, upper = np.array([(entry.start, entry.lower, entry.upper) for entry in entries]).T
    limits = np.array([(low, high) for low, _, high in graph.constraints]).reshape(-1, 2).T
    problem = GraphProblem(
        unknowns=x,
        objective=cost,
        constraints=casadi.vertcat(casadi.MX(0, 1), *(one for _, one, _ in graph.constraints)),
        lower=lower,
        upper=upper,
        floor=limits[0],
        ceiling=limits[1],
    )
    scales = np.ones(len(entries))
    for place, entry in enumerate(entries):
        scale = entry.scale
        if not scale:
            # One over the root of the cost's curvature; its own size where that is none.
            bend = float(casadi.Function("bend", [x], [casadi.hessian(cost, entry.symbol)[0]])(start))
            scale = bend**-0.5 if 0.0 < bend < np.inf else max(abs(entry.start), 1e-3)
        scales[place] = scale
    options = IpoptOptions(tolerance=_TOLERANCE, iterations=graph.options.iterations)
    run = minimise_graph(problem, start, options, scales)
    if not run.outcome.usable:
        text = f"the one-shot problem has no solution: {run.reason}; relax constraints, or start elsewhere"
        raise SolverError(Notice(code="solver.one-shot", text=text))
    found = casadi.Function("found", [x], [cost, problem.constraints])(run.x)
    objective, levels = (np.array(part, dtype=np.float64).ravel() for part in found)
    reach = numerics.CONVERGED * np.maximum(np.abs(limits), 1.0)
    near = np.isfinite(limits) & (np.abs(levels - limits) <= reach)
    own = run.x[: graph.layout.size]
    least = np.array([numerics.CONVERGED * np.sum(own[spring.weights]) for spring in graph.layout.springs])
    return NlpAnswer(
        values=dict(zip(graph.variables, run.x.tolist(), strict=True)),
        objective=float(objective[0]),
        outcome=run.outcome,
        reason=run.reason,
        levels=tuple(levels.tolist()),
        active=tuple(np.any(near, axis=0).tolist()),
        springs=graph.layout.read_springs(own, least),
    )
