"""Optimal excitation: many starts, Ipopt, limits checked on a fine grid.

Robot, ExciteOptions, random generator -> OptimisedExcitation.

    random feasible series -> the best of them as starts -> Ipopt on a smooth criterion, ever nearer to the
    condition number, on ever fewer of them -> the best, its limits checked -> OptimisedExcitation

Random series: centres in the middle half of the positions; normal coefficients of deviations that fall with
1/k, scaled to the limits. Ipopt is given torque, torsion and workspace near their limits only; those that a
result breaks are added. Where they overshoot between grid points they are tightened, and the last run is
repeated.

Supported: the criteria of `problem`; starts that break limits; the same seed gives the same trajectory.
Not supported: a limit of time; narrow workspaces, which a random pose hardly ever meets (give a start there).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from operator import attrgetter

import numpy as np

from symid.arrays import FloatArray
from symid.errors import IdentifiabilityError, Notice, SolverError, UsageError
from symid.excitation.limits import compute_coefficient_scales
from symid.excitation.problem import (
    Criterion,
    ExcitationProblem,
    Margin,
    build_problem,
    compute_condition,
    compute_information,
    compute_margins,
    scale_gram,
)
from symid.excitation.trajectories import Trajectory, build_fourier
from symid.ipopt import Ending, IpoptOptions, SmoothProblem, keep_last, minimise
from symid.options import ExciteOptions
from symid.robot import Robot
from symid.serialization import HIDDEN

_TRIES = 20
"""Draws per candidate before the search is given up."""
_HALVINGS = 8
"""Bisections of the largest common scale."""
_SMALLEST = 0.05
"""Least common scale of a series."""
_NEAR = 0.75
"""Share of a limit from which on Ipopt is given it."""
_ROUNDS = 5
"""Runs with ever more limits; the last one has all."""
_SLACK = 1e-6
_TOLERANCE = 1e-4
"""Of Ipopt."""
_REFINED, _ITERATIONS = 4, 150
"""Starts that are taken further; iterations of Ipopt in one run."""
_JUDGED = 20
"""Best random series whose stated figures are computed."""
_REPAIRS = 6
"""Times that limits are tightened before the search fails."""


def draw_candidates(
    problem: ExcitationProblem, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return the unknowns (`count`, n r) of random feasible series, and condition numbers, the least first.

    A SolverError says that nearly no pose keeps the limits.
    """
    found: list[FloatArray] = []
    conditions: list[float] = []
    drawn = 0
    worst = np.zeros(len(problem.state_limits.entries))
    space, limits = problem.space, problem.limits
    scales = compute_coefficient_scales(limits, space.harmonics, space.period)
    falling = np.tile(1.0 / np.arange(1, space.harmonics + 1), 2)
    # The joint of each linear limit.
    owner = np.argmax(problem.rows.reshape(len(problem.rows), space.size, -1).any(axis=2), axis=1)
    while len(found) < count:
        if drawn >= _TRIES * max(count, 50):
            entries = problem.state_limits.entries
            first = entries[int(np.argmax(worst))] if entries else None
            what = f"; most often broken: {first.kind} of {first.name}" if first else ""
            text = f"of {drawn} random poses nearly none keeps all limits{what}"
            text += "; widen them, or give a start pose that keeps them"
            raise SolverError(Notice(code="excitation.narrow", text=text))
        drawn += 1
        middle, wave = space.offset.copy(), np.zeros_like(space.offset)
        middle[:, 0] += 0.5 * limits.share * limits.half * rng.uniform(-1.0, 1.0, size=space.size)
        wave[:, 1:] = rng.normal(size=(space.size, 2 * space.harmonics)) * falling * scales[:, 1:]
        rest, motion = space.compute_unknowns(middle), space.compute_unknowns(space.offset + wave)
        excess = problem.compute_state_excess(rest)
        here, ahead = problem.rows @ rest + problem.constants, problem.rows @ motion
        low = 0.0
        if not (np.any(excess > 0.0) or np.any(np.abs(here) > 1.0)):
            # For each joint the largest factor of its motion that keeps the linear limits.
            free = np.where(ahead > 0.0, 1.0 - here, 1.0 + here)
            room = free / np.maximum(np.abs(ahead), np.finfo(np.float64).tiny)
            factors = np.full(space.size, np.inf)
            np.minimum.at(factors, owner, room)
            # A joint without any motion has no limit to reach.
            motion *= np.repeat(np.where(factors < 1e6, 0.9999 * factors, 0.0), len(motion) // space.size)
            high = half = 1.0
            for _ in range(1 + _HALVINGS):
                within = not np.any(problem.compute_state_excess(rest + half * motion) > 0.0)
                low, high = (half, high) if within else (low, half)
                half = 0.5 * (low + high)
                if low == high:
                    break
        if low > _SMALLEST:
            found.append(rest + low * motion)
            conditions.append(compute_condition(problem.compute_gram(found[-1])))
        else:
            worst += excess > 0.0
    order = np.argsort(conditions, kind="stable")
    return np.array(found)[order], np.array(conditions)[order]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OptimisationRun:
    """End of a start: unknowns (n r,), criterion, condition numbers of start and end, Ipopt's status."""

    unknowns: FloatArray = field(metadata=HIDDEN)
    value: float = field(metadata=HIDDEN)
    start: float
    condition: float
    iterations: int
    status: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OptimisedExcitation:
    """A trajectory and its figures.

    Args:
        trajectory: the series. coefficients: (n, 2h + 1) rad or m, centre, sines, cosines of each joint.
        condition: of the columns scaled to length one. information: mean logarithm per parameter.
        parameters: names of the columns.
        random_condition: the best of the random series. random_median: their median.
        random_information: that of the most informative random series.
        runs: one a start, the best first. margins: all limits, on a fine grid.
        notices: limits that were assumed, or are not kept.
    """

    trajectory: Trajectory = field(metadata=HIDDEN)
    coefficients: FloatArray = field(metadata=HIDDEN)
    condition: float
    information: float
    parameters: tuple[str, ...]
    random_condition: float
    random_median: float
    random_information: float
    runs: tuple[OptimisationRun, ...]
    margins: tuple[Margin, ...] = field(metadata=HIDDEN)
    notices: tuple[Notice, ...] = field(metadata=HIDDEN)

    @property
    def factor(self) -> float:
        """Return how many times smaller the condition number is than that of the best random series."""
        return self.random_condition / self.condition


def optimise_excitation(
    robot: Robot,
    options: ExciteOptions | None = None,
    *,
    rng: np.random.Generator,
    progress: Callable[[str], None] | None = None,
) -> OptimisedExcitation:
    """Return the best trajectory found.

    The values of the robot count only for limits of torque and torsion; `rng` is that of the random series,
    of which no more are optimised than drawn; `progress` receives a line for each step.

    Raises:
        UsageError: options out of range, or that do not fit the robot.
        RobotError: the robot file lacks what a limit needs.
        IdentifiabilityError: the observation matrix of this family has no full column rank.
        SolverError: no feasible series was found, or none whose limits hold at all times.
    """
    options = options or ExciteOptions()
    if options.stiffness and options.torsion is None:
        text = "--stiffness needs --torsion, the largest torsion; give both"
        raise UsageError(Notice(code="usage.excitation", text=text))
    options = replace(options, starts=min(options.starts, options.candidates))
    report = progress or (lambda _: None)
    report(f"deriving the regressor of {robot.name}")
    problem = build_problem(robot, options)
    report(f"drawing {options.candidates} random trajectories within the limits")
    candidates, conditions = draw_candidates(problem, options.candidates, rng)
    if not np.isfinite(conditions[0]):
        # The columns of the weakest direction.
        vector = np.abs(np.linalg.eigh(scale_gram(problem.compute_gram(candidates[0]))[0])[1][:, 0])
        largest = np.argsort(-vector, kind="stable")[:4]
        which = [problem.observation.names[place] for place in largest if vector[place] > 0.1]
        text = f"with {problem.space.harmonics} harmonics within these limits the regressor has no full "
        text += f"rank: {', '.join(which)} are linearly dependent; widen the limits, or use more harmonics"
        raise IdentifiabilityError(Notice(code="excitation.rank", text=text))
    names = tuple(joint.name for joint in robot.axes)
    starts = [
        OptimisationRun(unknowns=z, value=np.inf, start=float(c), condition=float(c), iterations=0, status="")
        for z, c in zip(candidates, conditions, strict=True)
    ]
    runs = starts[: options.starts]
    tightening = np.zeros(len(problem.state_limits.entries))
    # The first round runs on the coarse grid.
    form = problem.build_coarse()
    objective = attrgetter("value" if options.criterion == "d-optimal" else "condition")
    for number, (kept, criterion, ipopt) in enumerate(_list_search_stages(options), 1):
        by_power = f"condition number with power {criterion.power:g}"
        what = "d-optimal" if criterion.name == "d-optimal" else by_power
        report(f"round {number}: {kept} trajectories, {what}")
        taken = [_advance_run(form, run, criterion, ipopt, tightening) for run in runs[:kept]]
        runs = sorted((*taken, *runs[kept:]), key=objective)
        report(f"  condition number {min(run.condition for run in runs):.4g}")
        form = problem
    unknowns, margins = _enforce_limits(problem, names, runs[0], options)
    stated = problem.build_stated(robot).compute_gram
    order = np.argsort([compute_information(problem.compute_gram(z)) for z in candidates], kind="stable")
    notices = problem.state_limits.notices
    if problem.limits.assumed:
        text = f"limits were assumed, which may be too wide: {'; '.join(problem.limits.assumed)}; state them"
        notices = (*notices, Notice(code="excitation.assumed-limits", text=text))
    source = f"optimised finite Fourier series ({options.criterion}), {options.harmonics} harmonics of "
    source += f"{1.0 / options.period:g} Hz"
    coefficients = problem.space.compute_coefficients(unknowns)
    series = build_fourier(coefficients, 1.0 / options.period, duration=options.period, ramp=0.0)
    return OptimisedExcitation(
        trajectory=replace(series, source=source),
        coefficients=coefficients,
        condition=compute_condition(stated(unknowns)),
        information=compute_information(stated(unknowns)),
        parameters=problem.observation.names,
        random_condition=min(compute_condition(stated(z)) for z in candidates[:_JUDGED]),
        random_median=compute_condition(stated(candidates[len(candidates) // 2])),
        random_information=max(compute_information(stated(candidates[at])) for at in order[-_JUDGED:]),
        runs=tuple(runs),
        margins=margins,
        notices=notices,
    )


def _list_search_stages(options: ExciteOptions) -> list[tuple[int, Criterion, IpoptOptions]]:
    """Return how many series take part in each round, its criterion, and options of Ipopt."""
    many, few, full = options.starts, min(_REFINED, options.starts), _ITERATIONS
    # Power of the criterion, series that take part, barrier of Ipopt, iterations.
    plan = [(4.0, many, 1e-2, min(60, full)), (16.0, few, 1e-3, full), (40.0, min(2, few), 1e-4, full)]
    if options.criterion == "d-optimal":
        plan = [(0.0, many, 1e-2, min(60, full)), (0.0, few, 1e-3, 2 * full), (0.0, 1, 1e-5, 2 * full)]
    stages = []
    for power, kept, barrier, iterations in plan:
        criterion = Criterion(name=options.criterion, power=power, weight=options.weight)
        ipopt = IpoptOptions(tolerance=_TOLERANCE, iterations=iterations, barrier=barrier)
        stages.append((kept, criterion, ipopt))
    return stages


def _advance_run(
    problem: ExcitationProblem,
    run: OptimisationRun,
    criterion: Criterion,
    ipopt: IpoptOptions,
    tightening: FloatArray,
) -> OptimisationRun:
    """Return the end of a descent, or its start if no better; `tightening` (v,) is taken off the limits."""
    evaluate = keep_last(lambda z: problem.compute_value(z, criterion))
    start, state_limits = run.unknowns, 1.0 - tightening
    unknowns, iterations, status = start, run.iterations, ""
    free = np.full(len(start), np.inf)
    watched = problem.compute_state_use(start) > _NEAR * state_limits
    for round_ in range(_ROUNDS):
        smooth = SmoothProblem(
            value=lambda z: evaluate(z)[0],
            gradient=lambda z: evaluate(z)[1],
            lower=-free,
            upper=free,
            constraints=problem.build_constraints(tightening, watched),
        )
        ended = minimise(smooth, unknowns, ipopt)
        unknowns, iterations, status = ended.x, iterations + ended.iterations, ended.status
        if ended.outcome is Ending.FAILED or not len(tightening):
            break
        use = problem.compute_state_use(unknowns)
        if not np.any((use > state_limits + _SLACK) & ~watched):
            break
        watched |= (use > _NEAR * state_limits) | (round_ == _ROUNDS - 2)
    before, after = (
        not np.any(np.abs(problem.rows @ z + problem.constants) > 1.0 + _SLACK)
        and not np.any(problem.compute_state_use(z) > state_limits + _SLACK)
        for z in (start, unknowns)
    )
    was, here = evaluate(start)[0], evaluate(unknowns)[0]
    better = (after and not before) or (after == before and here < was)
    return OptimisationRun(
        unknowns=unknowns if better else start,
        value=here if better else was,
        start=run.start,
        condition=compute_condition(problem.compute_gram(unknowns if better else start)),
        iterations=iterations,
        status=status,
    )


def _enforce_limits(
    problem: ExcitationProblem, names: tuple[str, ...], run: OptimisationRun, options: ExciteOptions
) -> tuple[FloatArray, tuple[Margin, ...]]:
    """Return unknowns whose limits hold on the fine grid, and these limits."""
    _, criterion, ipopt = _list_search_stages(options)[-1]
    tightening = np.zeros(len(problem.state_limits.entries))
    for _ in range(_REPAIRS):
        margins, peaks = compute_margins(problem, names, run.unknowns)
        if all(margin.kept for margin in margins):
            return run.unknowns, margins
        tightening += 1.2 * np.maximum(peaks - 1.0, 0.0)
        run = _advance_run(problem, run, criterion, ipopt, tightening)
    broken = ", ".join(f"{margin.kind} of {margin.name}" for margin in margins if not margin.kept)
    text = f"limits hold at the grid points but not between them ({broken}); use fewer harmonics"
    raise SolverError(Notice(code="excitation.between", text=text))
