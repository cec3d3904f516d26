"""Dynamics, friction and hysteresis together, in one constrained problem: the one-shot reference.

ElasticProblem -> NlpFit.

    rows         linear parts once, knees and Stribeck friction as steps          (nlp_rows)
    unknowns     chi, weights k >= 0, slopes c > 0, Fs, vs                        (nlp_cost)
    rounds       minimise sum_b |r_b|^2 / sigma_b^2 by Ipopt, then sigma_b <- rms r_b
    places       those of a start move between rounds: [dx; dr] = -H^-1 g,
                 H = sum J'J / sigma^2, g = sum J'r / sigma^2
    certificate  kkt = max_i |z_i - min(u_i, max(l_i, z_i - df/dz_i))|

Unknowns are scaled by the lengths of their columns at the start, x = d z. All constraints are bounds, so
that kkt is zero at a point that satisfies the Karush-Kuhn-Tucker conditions, and nowhere else; it is
computed from our own gradient, whatever the solver says, and a few Newton steps with active bounds end
every run. The Gauss-Newton step of the places is halved until the cost falls; no place moves past its
neighbour, and no knee near zero torque. Stops and knees that are given, or on a grid, stay where they
are; knees of a grid follow the torque that the springs reach. What no motion shows is said: stops beyond
the torsion, knees beyond the torque. Two random starts end at the same optimum where their objectives
differ by at most 1e-6 of the least one.

Supported: energy, filtered and momentum rows; Stribeck friction; odd springs; exact and Gauss-Newton
Hessians.
Not supported: joint damping, cubic springs; another number of stops and knees than that of the start;
proof that no better optimum exists.
"""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice
from symid.identification.elastic.elimination import fit_elimination
from symid.identification.elastic.estimate import HistoryEntry, MethodFit, MethodOutcome
from symid.identification.elastic.nlp_cost import (
    CostState,
    ElasticNlpCost,
    NlpLayout,
    SpringGrid,
    build_layout,
    build_normal_equations,
    build_spring,
    build_start,
    compute_nlp_covariance,
    draw_start,
    estimate_linear_sigmas,
    estimate_sigmas,
    flatten_slopes,
    list_weights,
)
from symid.identification.elastic.nlp_rows import NlpOptions, NlpRecording, build_nlp_recording, move_stops
from symid.identification.elastic.problem import ElasticProblem, build_method_fit
from symid.identification.elastic.two_step import fit_linear_spring
from symid.identification.hysteresis import LEAST_KNEE, hold_knees
from symid.ipopt import build_ipopt_functions, describe_ipopt_status
from symid.robot import Elasticity

LINEAR_SOLVER = "mumps"
"""The one that the wheel of CasADi carries and that works; others end at once or crash."""


def translate_status(status: str, linear_solver: str) -> tuple[MethodOutcome, str]:
    """Return the outcome and the reason in words.

    Args:
        status: Ipopt's return status.
        linear_solver: the one that ran, by Ipopt's own log; empty where none ran.
    """
    name, reason = describe_ipopt_status(status)
    outcome = MethodOutcome[name]
    if outcome.usable and linear_solver != LINEAR_SOLVER:
        text = f"the linear solver that ran is {linear_solver or 'not known'}, not {LINEAR_SOLVER}"
        return MethodOutcome.FAILED, text
    return outcome, reason


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
class NlpRun:
    """One run.

    Args:
        x: (x,) unknowns in SI units; objective: f; start: f at the start.
        outcome, reason: how it ended; iterations: of Ipopt; status: Ipopt's own.
    """

    x: FloatArray
    objective: float
    start: float
    outcome: MethodOutcome
    reason: str
    status: str
    linear_solver: str
    iterations: int
    certificate: Certificate

    def __post_init__(self) -> None:
        """Copy the array and make it read-only."""
        object.__setattr__(self, "x", freeze(self.x))

    @property
    def converged(self) -> bool:
        """Return whether the run ended at an optimum."""
        return self.outcome in {MethodOutcome.CONVERGED, MethodOutcome.ACCEPTABLE}


class _ScaledCost:
    """The cost at scaled unknowns; the last point is kept, as the solver asks for it several times."""

    def __init__(self, cost: ElasticNlpCost, scales: FloatArray, hessian: str) -> None:
        self.cost, self.scales, self.exact = cost, scales, hessian == "exact"
        self.key = b""
        self.kept: CostState | None = None

    def find_state(self, z: FloatArray) -> tuple[FloatArray, CostState]:
        x = z * self.scales
        if self.kept is None or self.key != x.tobytes():
            self.kept, self.key = self.cost.find_state(x), x.tobytes()
        return x, self.kept

    def find_value(self, z: FloatArray) -> float:
        return self.cost.find_value(self.find_state(z)[1])

    def find_gradient(self, z: FloatArray) -> FloatArray:
        return self.cost.find_gradient(self.find_state(z)[1]) * self.scales

    def find_hessian(self, z: FloatArray) -> FloatArray:
        x, state = self.find_state(z)
        hessian = self.cost.find_hessian(state, x) if self.exact else self.cost.find_gauss_newton(state)
        return hessian * self.scales * self.scales[:, None]


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
    begin = np.clip(start, layout.lower, layout.upper) / scales
    evaluator = _ScaledCost(cost, scales, options.hessian)
    first = evaluator.find_value(begin)
    z, status, iterations, solver = _run_ipopt(evaluator, begin, options)
    outcome, reason = translate_status(status, solver)
    if not np.all(np.isfinite(z)):
        z, outcome, reason = begin, MethodOutcome.FAILED, f"the solver returned no finite numbers ({status})"
    x = _polish(evaluator, z, layout.lower / scales, layout.upper / scales) * scales
    x = np.clip(x, layout.lower, layout.upper)
    certificate = compute_certificate(cost, x, scales)
    if outcome is MethodOutcome.CONVERGED and certificate.kkt > _KKT:
        outcome = MethodOutcome.STALLED
        reason = (
            f"Ipopt reports success, but the residual of the optimality conditions is {certificate.kkt:.1e}"
        )
    return NlpRun(
        x=x,
        objective=cost.find_value(cost.find_state(x)),
        start=first,
        outcome=outcome,
        reason=reason,
        status=status,
        linear_solver=solver,
        iterations=iterations,
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


def _polish(evaluator: _ScaledCost, z: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return z (x,) after Newton steps in the unknowns that no bound holds; the others go onto their bounds.

    An interior-point method stays off the bounds by its barrier over the multiplier. A step is kept while our
    own residual falls.
    """
    best = np.clip(z, low, high)
    slope = evaluator.find_gradient(best)
    residual = _compute_kkt(best, slope, low, high)
    for _ in range(_NEWTON_STEPS):
        near = np.minimum(np.abs(slope), _NEAR_BOUND)
        at_low, at_high = (best - low < near) & (slope > 0.0), (high - best < near) & (slope < 0.0)
        trial = np.where(at_low, low, np.where(at_high, high, best))
        free = np.flatnonzero(~(at_low | at_high))
        hessian = evaluator.find_hessian(best)[np.ix_(free, free)]
        away = evaluator.find_gradient(trial)
        trial[free] -= np.linalg.lstsq(hessian, away[free], rcond=1e-12)[0]
        trial = np.clip(trial, low, high)
        slope = evaluator.find_gradient(trial)
        reached = _compute_kkt(trial, slope, low, high)
        if not reached < residual:
            break
        best, residual = trial, reached
    return best


def _compute_kkt(z: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray) -> float:
    return float(np.max(np.abs(z - np.clip(z - slope, low, high))))


def _run_ipopt(
    evaluator: _ScaledCost, begin: FloatArray, options: NlpOptions
) -> tuple[FloatArray, str, int, str]:
    """Return scaled unknowns, Ipopt's status, its iterations, and the linear solver that its log names."""
    import casadi

    layout = evaluator.cost.layout
    functions = build_ipopt_functions(
        layout.size, evaluator.find_value, evaluator.find_gradient, evaluator.find_hessian
    )
    unknowns = casadi.MX.sym("x", layout.size)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "ipopt.txt"
        settings = {
            "grad_f": functions.gradient,
            "hess_lag": functions.hessian,
            "no_nlp_grad": True,
            "print_time": False,
            "error_on_fail": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "output_file": str(log),
                "file_print_level": 5,
                "linear_solver": LINEAR_SOLVER,
                "nlp_scaling_method": "none",
                "bound_relax_factor": 0.0,
                "tol": options.tolerance,
                "max_iter": options.iterations,
                "mu_strategy": "adaptive",
            },
        }
        problem = {"x": unknowns, "f": functions.value(unknowns)}
        solver = casadi.nlpsol("hysteresis", "ipopt", problem, settings)
        scales = evaluator.scales
        answer = solver(x0=begin, lbx=layout.lower / scales, ubx=layout.upper / scales)
        statistics = solver.stats()
        text = log.read_text() if log.is_file() else ""
    solution = np.asarray(answer["x"], dtype=np.float64).ravel()
    return (
        solution,
        str(statistics["return_status"]),
        int(statistics["iter_count"]),
        _read_linear_solver(text),
    )


def _read_linear_solver(log: str) -> str:
    """Return the first word behind "linear solver" in Ipopt's log, in lower case; "" where there is none."""
    _, found, rest = log.partition("running with linear solver ")
    return rest.split()[0].lower().rstrip(".") if found else ""


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
        options = self.problem.options
        return options.refine and options.thresholds is None and self.knees is not None

    @property
    def knees_move(self) -> bool:
        """Return whether the data place the knees; those of odd springs stand in pairs, and stay."""
        return self.stops_move and self.problem.options.knee_torques is None and not self.options.odd

    def lay_out(self, springs: Sequence[Elasticity]) -> NlpLayout:
        """Return the unknowns, with knees for what `springs` reach."""
        knees = self.knees if self.knees is not None else _place_knees(self, springs)
        grids = []
        for joint, thresholds in enumerate(self.thresholds):
            grid = SpringGrid(
                thresholds=thresholds,
                knees=knees[joint],
                stiffness=float(self.stiffness[joint]),
                reach=max(float(np.abs(part.bases[joint][:, 0]).max()) for part in self.recordings),
            )
            grids.append(grid)
        return build_layout(self.problem.library.card, grids, self.options)

    def move(
        self, thresholds: Sequence[FloatArray], knees: tuple[tuple[float, ...], ...] | None
    ) -> "NlpSetting":
        """Return the setting with stops and knees elsewhere; rows are made anew where stops moved."""
        moves = [
            {int(place): float(new[place]) for place in np.flatnonzero(new != old)}
            for old, new in zip(self.thresholds, thresholds, strict=True)
        ]
        if not any(moves):
            return replace(self, knees=knees)
        grids = tuple(map(freeze, thresholds))
        if "filtered" in self.options.rows:
            recordings = _build_recordings(self.problem, grids, self.options)
        else:
            recordings = tuple(
                move_stops(recording, self.problem, number, moves)
                for number, recording in enumerate(self.recordings)
            )
        return replace(self, knees=knees, thresholds=grids, recordings=recordings)


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


def _place_knees(setting: NlpSetting, springs: Sequence[Elasticity]) -> tuple[tuple[float, ...], ...]:
    """Return knees at (j - 1/2) / l of the greatest torque before the knees, on each side, none near zero."""
    count = setting.problem.options.knees
    places = (np.arange(count) + 0.5) / max(count, 1)
    result = []
    for joint, spring in enumerate(springs):
        weights = list_weights(spring, setting.thresholds[joint])
        torque = np.concatenate([part.bases[joint] @ weights for part in setting.recordings])
        low, high = max(0.0, -float(torque.min())), max(0.0, float(torque.max()))
        if setting.options.odd:
            low = high = max(low, high)
        below = hold_knees(-places * low if low else np.zeros(0), low)
        above = hold_knees(places * high if high else np.zeros(0), high)
        result.append(tuple(float(knee) for knee in (*below[::-1], *above)))
    return tuple(result)


REST_WEIGHT = 1e-9
"""Of the linear spring: weights below it are zero."""
_SHIFT = 1e-4
"""Of the place of a stop or knee, for derivatives by it."""
_STEP = 0.4
"""Of the gap to its neighbour that a place may move at once."""
_FRACTIONS = (1.0, 0.5, 0.25, 0.125)


@dataclass(frozen=True, slots=True, kw_only=True)
class NlpPlace:
    """A stop, or a knee, of a joint: the index of its threshold among those of the joint."""

    joint: int
    knee: bool
    index: int


def list_places(setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray) -> tuple[NlpPlace, ...]:
    """Return the stops and knees that the data place."""
    places = []
    for joint, spring in enumerate(cost.layout.springs):
        if setting.stops_move:
            least = REST_WEIGHT * setting.stiffness[joint]
            busy = np.flatnonzero(x[spring.weights][1:] > least)
            places += [NlpPlace(joint=joint, knee=False, index=int(stop)) for stop in busy]
        if setting.knees_move:
            numbers = range(len(spring.knees))
            places += [NlpPlace(joint=joint, knee=True, index=number) for number in numbers]
    return tuple(places)


def compute_place_slopes(
    setting: NlpSetting, cost: ElasticNlpCost, x: FloatArray, places: Sequence[NlpPlace]
) -> list[list[FloatArray]]:
    """Return the derivatives of all residuals (M_b,) of every block by each place."""
    before = cost.find_state(x).residuals
    slopes = []
    for place in places:
        at = _get_position(setting, place)
        step = _SHIFT * abs(at)
        shifted = _shift(setting, [place], np.array([step]))
        moved = _rebuild(cost, shifted).find_state(x).residuals
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
    equations = build_normal_equations(cost, x, compute_place_slopes(setting, cost, x, places))
    step = equations.find_step()
    value = cost.find_value(cost.find_state(x))
    lower, upper = _compute_place_limits(setting, cost, x, places)
    for fraction in _FRACTIONS:
        move = np.clip(fraction * step[len(x) :], lower, upper)
        moved = _shift(setting, places, move)
        trial = _rebuild(cost, moved)
        start = np.clip(x + fraction * step[: len(x)], trial.layout.lower, trial.layout.upper)
        if trial.find_value(trial.find_state(start)) < value:
            return moved, start
    return setting, x


def _get_position(setting: NlpSetting, place: NlpPlace) -> float:
    if place.knee:
        return (setting.knees or ())[place.joint][place.index]
    return float(setting.thresholds[place.joint][place.index])


def _shift(setting: NlpSetting, places: Sequence[NlpPlace], moves: FloatArray) -> NlpSetting:
    """Return the setting with each of the places moved."""
    thresholds = [grid.copy() for grid in setting.thresholds]
    knees = [list(entries) for entries in setting.knees or ()]
    for place, move in zip(places, moves, strict=True):
        if place.knee:
            knees[place.joint][place.index] += float(move)
        else:
            thresholds[place.joint][place.index] += move
    return setting.move(thresholds, None if setting.knees is None else tuple(map(tuple, knees)))


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
        stops = [float(value) for value in setting.thresholds[joint]]
        for index, (down, up) in enumerate(_list_room(stops, 0.0, reach)):
            limits[NlpPlace(joint=joint, knee=False, index=index)] = (down, up)
        for side in (-1.0, 1.0):
            order = [index for index, knee in enumerate(spring.knees) if knee * side > 0.0]
            if side < 0.0:
                order.reverse()
            edge = max(0.0, float(np.max(side * torque)))
            room = _list_room([abs(spring.knees[index]) for index in order], LEAST_KNEE * edge, edge)
            for index, (down, up) in zip(order, room, strict=True):
                ends = (down, up) if side > 0.0 else (-up, -down)
                limits[NlpPlace(joint=joint, knee=True, index=index)] = ends
    found = np.array([limits[place] for place in places])
    return found[:, 0], found[:, 1]


def _list_room(places: Sequence[float], least: float, edge: float) -> Iterator[tuple[float, float]]:
    """Yield how far each of the increasing places may move down and up between `least` and `edge`."""
    ends = [min([least, *places[:1]]), *places, max([edge, *places[-1:]])]
    for before, place, after in zip(ends[:-2], ends[1:-1], ends[2:], strict=True):
        yield -_STEP * (place - before), _STEP * (after - place)


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
        options: rows, friction, bounds, solver; None for the defaults.
        start: dynamics and springs to begin with, whose stops and knees move to better places near where the
            problem refines its grids. None for those of the elimination, or, where it does not, for linear
            springs on the grids.
    """
    options = options or NlpOptions()
    begin = start or _fit_start(problem)
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
        history.append(_build_history_entry(cost, run, x))
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
    )
    fit = replace(fit, notices=tuple(_list_notices(run)))
    return NlpFit(fit=fit, run=run, cost=cost, scales=scales, stiffness=setting.stiffness)


def _fit_start(problem: ElasticProblem) -> MethodFit:
    """Return dynamics and springs to begin with; refined stops and knees are those of the elimination."""
    if problem.options.refine and problem.options.thresholds is None:
        return fit_elimination(problem)
    return fit_linear_spring(problem)


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


def _build_history_entry(cost: ElasticNlpCost, run: NlpRun, start: FloatArray) -> HistoryEntry:
    places = cost.layout.dynamics
    step = run.x[places] - start[places]
    size = np.maximum(np.abs(run.x[places]), 1e-3 * float(np.max(np.abs(run.x[places]))))
    state = cost.find_state(run.x)
    return HistoryEntry(
        merit=run.objective,
        change=float(np.max(np.abs(step) / size)),
        norms=tuple(float(np.linalg.norm(residual)) for residual in state.residuals),
    )


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


def _read_springs(layout: NlpLayout, x: FloatArray, stiffness: FloatArray) -> tuple[Elasticity, ...]:
    return tuple(
        build_spring(spring, x, REST_WEIGHT * whole)
        for spring, whole in zip(layout.springs, stiffness, strict=True)
    )


_SAME = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MultiStart:
    """Runs from random starts, `runs`, besides the one of the fit, `reference`."""

    reference: NlpRun
    runs: tuple[NlpRun, ...]

    @property
    def best(self) -> NlpRun:
        """Return the converged run of least objective; the reference where none converged."""
        ends = [run for run in (self.reference, *self.runs) if run.converged]
        return min(ends, key=lambda run: run.objective, default=self.reference)

    @property
    def agreeing(self) -> tuple[NlpRun, ...]:
        """Return the runs that converged to the best optimum."""
        return tuple(run for run in self.runs if run.converged and self._is_best(run))

    @property
    def others(self) -> tuple[NlpRun, ...]:
        """Return the runs that converged to another optimum."""
        return tuple(run for run in self.runs if run.converged and not self._is_best(run))

    @property
    def failed(self) -> tuple[NlpRun, ...]:
        """Return the runs that did not converge; each has its reason."""
        return tuple(run for run in self.runs if not run.converged)

    def _is_best(self, run: NlpRun) -> bool:
        least = self.best.objective
        return abs(run.objective - least) <= _SAME * abs(least)


def optimise_from_many(
    fit: NlpFit, count: int, generator: np.random.Generator, options: NlpOptions | None = None
) -> MultiStart:
    """Return the ends of `count` random feasible starts of the problem of `fit`.

    Args:
        fit: its last round's cost is minimised again.
        count: of starts.
        generator: of the starts.
        options: of the solver; None for the defaults.
    """
    options = options or NlpOptions()
    runs = []
    for _ in range(count):
        start = draw_start(fit.cost.layout, fit.run.x, generator)
        runs.append(optimise_nlp(fit.cost, start, fit.scales, options))
    return MultiStart(reference=fit.run, runs=tuple(runs))
