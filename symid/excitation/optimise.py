"""The trajectory that tells most: many starts, Ipopt, limits checked on a fine grid.

Robot, options, random generator -> Excitation.

    random feasible series -> the best of them as starts -> Ipopt on a smooth criterion, ever nearer to the
    condition number, on ever fewer of them -> the best, its limits checked -> Excitation

Torque, torsion and space are limited at points; where they overshoot between these, they are tightened by the
overshoot and the last run is repeated.

Supported: the criteria of `criteria`. Not supported: a limit of time; runs are limited by iterations, so that
the same seed gives the same trajectory on any machine of one kind.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from symid.arrays import FloatArray
from symid.errors import IdentifiabilityError, Notice, SolverError, UsageError
from symid.excitation.candidates import Candidates, find_candidates
from symid.excitation.criteria import CRITERIA, Criterion
from symid.excitation.descent import find_descent
from symid.excitation.figures import Judge
from symid.excitation.ipopt import IpoptOptions
from symid.excitation.margins import Margin, find_margins, find_overshoot
from symid.excitation.problem import ExcitationProblem, ProblemOptions, build_problem
from symid.excitation.trajectories import Trajectory
from symid.robot.description import Robot

__all__ = ["Excitation", "ExcitationOptions", "Run", "optimise_excitation"]

_JUDGED = 20
"""Random series, the best by the figures of the search, whose own figures are found."""
_REPAIRS = 6
"""Times that limits are tightened before a trajectory is given up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationOptions:
    """What is minimised, how hard it is searched.

    Args:
        problem: series, limits, deviations.
        criterion: one of `CRITERIA`.
        weight: of the mean logarithm of the information, beside that of the condition number.
        candidates: random feasible series. starts: how many of them are optimised.
        refined: how many of these are taken further. iterations: of Ipopt, in one run.
    """

    problem: ProblemOptions = field(default_factory=ProblemOptions)
    criterion: str = "condition"
    weight: float = 0.1
    candidates: int = 1000
    starts: int = 10
    refined: int = 4
    iterations: int = 150


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """Where a start led: unknowns (n r,), criterion, condition numbers before and here, Ipopt's status."""

    unknowns: FloatArray
    value: float
    start: float
    condition: float
    iterations: int
    status: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Excitation:
    """A trajectory and what speaks for it.

    Args:
        trajectory: the series. coefficients: (n, 2h + 1) rad or m, centre, sines, cosines of each joint.
        condition: of the columns scaled to length one. information: mean logarithm per parameter.
        parameters: names of the columns.
        random_condition: the best of the random series. random_median: their median.
        random_information: that of the most informative random series.
        runs: one a start, the best first. margins: all limits, on a fine grid.
        notices: what was assumed or could not be limited.
    """

    trajectory: Trajectory
    coefficients: FloatArray
    condition: float
    information: float
    parameters: tuple[str, ...]
    random_condition: float
    random_median: float
    random_information: float
    runs: tuple[Run, ...]
    margins: tuple[Margin, ...]
    notices: tuple[Notice, ...]

    @property
    def factor(self) -> float:
        """Return how many times smaller the condition number is than that of the best random series."""
        return self.random_condition / self.condition


@dataclass(frozen=True, slots=True, kw_only=True)
class _Stage:
    """One round: what is minimised, how many are kept for it, how Ipopt runs, on the coarse grid or not."""

    criterion: Criterion
    kept: int
    ipopt: IpoptOptions
    coarse: bool = False


def optimise_excitation(
    robot: Robot,
    options: ExcitationOptions | None = None,
    *,
    rng: np.random.Generator,
    progress: Callable[[str], None] | None = None,
) -> Excitation:
    """Return the best trajectory found.

    Args:
        robot: the robot; its values count only for limits of torque and torsion.
        options: see there.
        rng: of the random series.
        progress: told what begins.

    Raises:
        UsageError: options out of range, or that do not fit the robot.
        RobotError: the robot file lacks what a limit needs.
        IdentifiabilityError: no trajectory of this family tells all parameters.
        SolverError: no feasible series was found, or none whose limits hold everywhere.
    """
    options = options or ExcitationOptions()
    _check_options(options)
    tell = progress or (lambda _: None)
    tell(f"deriving the regressor of {robot.name}")
    problem = build_problem(robot, options.problem)
    tell(f"drawing {options.candidates} random trajectories within the limits")
    candidates = find_candidates(problem, options.candidates, rng)
    if not np.isfinite(candidates.conditions[0]):
        raise IdentifiabilityError(_describe_rank(problem, candidates))
    names = tuple(joint.name for joint in robot.axes)
    runs = _search(problem, candidates, options, tell)
    unknowns, margins = _secure(problem, names, runs[0], options)
    judge = Judge(robot, problem)
    condition, information = judge.find_figures(unknowns)
    series = options.problem.series
    source = (
        f"optimised finite Fourier series ({options.criterion}), {series.harmonics} harmonics of "
        f"{1.0 / series.period:g} Hz"
    )
    return Excitation(
        trajectory=problem.space.build_trajectory(unknowns.reshape(problem.space.shape), source),
        coefficients=problem.space.find_coefficients(unknowns.reshape(problem.space.shape)),
        condition=condition,
        information=information,
        parameters=problem.observation.names,
        random_condition=min(judge.find_figures(z)[0] for z in candidates.unknowns[:_JUDGED]),
        random_median=judge.find_figures(candidates.unknowns[len(candidates.unknowns) // 2])[0],
        random_information=_find_most(problem, judge, candidates),
        runs=tuple(runs),
        margins=margins,
        notices=_list_notices(problem),
    )


def _find_most(problem: ExcitationProblem, judge: Judge, candidates: Candidates) -> float:
    """Return the most information of a random series."""
    found = [problem.find_information(z) for z in candidates.unknowns]
    best = np.argsort(found, kind="stable")[-_JUDGED:]
    return max(judge.find_figures(candidates.unknowns[place])[1] for place in best)


def _check_options(options: ExcitationOptions) -> None:
    problems = [
        f"{name}: at least one is needed, got {getattr(options, name)}"
        for name in ("candidates", "starts", "refined", "iterations")
        if getattr(options, name) < 1
    ]
    if options.criterion not in CRITERIA:
        problems.append(f"criterion: expected {' or '.join(CRITERIA)}, got {options.criterion!r}")
    if not 0.0 <= options.weight < np.inf:
        problems.append(f"weight: must be finite and not negative, got {options.weight:g}")
    if options.problem.loads.stiffness and options.problem.loads.torsion is None:
        problems.append("--stiffness belongs to --torsion, the largest torsion; give both")
    if options.starts > options.candidates:
        problems.append(f"{options.starts} starts need at least as many candidates, got {options.candidates}")
    if not 0.0 < options.problem.limits.share <= 1.0:
        problems.append(f"share: must be above 0 and at most 1, got {options.problem.limits.share:g}")
    if problems:
        raise UsageError(*(Notice(code="usage.excitation", text=text) for text in problems))


def _list_stages(options: ExcitationOptions) -> tuple[_Stage, ...]:
    def run(barrier: float, iterations: int) -> IpoptOptions:
        return IpoptOptions(iterations=iterations, barrier=barrier)

    many, few, full = options.starts, min(options.refined, options.starts), options.iterations
    short = min(60, full)
    if options.criterion == "d-optimal":
        design = Criterion(name="d-optimal")
        return (
            _Stage(criterion=design, kept=many, ipopt=run(1e-2, short), coarse=True),
            _Stage(criterion=design, kept=few, ipopt=run(1e-3, 2 * full)),
            _Stage(criterion=design, kept=1, ipopt=run(1e-5, 2 * full)),
        )
    return (
        _Stage(
            criterion=Criterion(power=4.0, weight=options.weight),
            kept=many,
            ipopt=run(1e-2, short),
            coarse=True,
        ),
        _Stage(criterion=Criterion(power=16.0, weight=options.weight), kept=few, ipopt=run(1e-3, full)),
        _Stage(
            criterion=Criterion(power=40.0, weight=options.weight), kept=min(2, few), ipopt=run(1e-4, full)
        ),
    )


def _search(
    problem: ExcitationProblem,
    candidates: Candidates,
    options: ExcitationOptions,
    tell: Callable[[str], None],
) -> list[Run]:
    """Return a run of each start, the best first."""
    runs = [
        Run(unknowns=z, value=np.inf, start=float(c), condition=float(c), iterations=0, status="")
        for z, c in zip(candidates.unknowns, candidates.conditions, strict=True)
    ][: options.starts]
    tightening = np.zeros(len(problem.state_limits.names))
    coarse = problem.build_coarse()
    for number, stage in enumerate(_list_stages(options), 1):
        tell(f"round {number}: {stage.kept} trajectories, {_name(stage.criterion)}")
        form = coarse if stage.coarse else problem
        taken = [_advance(form, run, stage, tightening) for run in runs[: stage.kept]]
        runs = sorted((*taken, *runs[stage.kept :]), key=lambda run: _rank(run, options))
        tell(f"  condition number {min(run.condition for run in runs):.4g}")
    return runs


def _advance(problem: ExcitationProblem, run: Run, stage: _Stage, tightening: FloatArray) -> Run:
    descent = find_descent(problem, run.unknowns, stage.criterion, stage.ipopt, tightening)
    return Run(
        unknowns=descent.unknowns,
        value=descent.value,
        start=run.start,
        condition=problem.find_condition(descent.unknowns),
        iterations=run.iterations + descent.iterations,
        status=descent.status,
    )


def _name(criterion: Criterion) -> str:
    return (
        "d-optimal" if criterion.name == "d-optimal" else f"condition number with power {criterion.power:g}"
    )


def _rank(run: Run, options: ExcitationOptions) -> float:
    return run.value if options.criterion == "d-optimal" else run.condition


def _secure(
    problem: ExcitationProblem,
    names: tuple[str, ...],
    run: Run,
    options: ExcitationOptions,
) -> tuple[FloatArray, tuple[Margin, ...]]:
    """Return unknowns whose limits hold on the fine grid, and these limits."""
    stage = _list_stages(options)[-1]
    tightening = np.zeros(len(problem.state_limits.names))
    for _ in range(_REPAIRS):
        margins = find_margins(problem, names, run.unknowns)
        if all(margin.kept for margin in margins):
            return run.unknowns, margins
        beyond = find_overshoot(problem, run.unknowns)
        tightening += 1.2 * np.maximum(beyond, 0.0)
        run = _advance(problem, run, stage, tightening)
    broken = ", ".join(f"{margin.kind} of {margin.name}" for margin in margins if not margin.kept)
    text = f"limits hold at the points of the search and not between them ({broken}); use fewer harmonics"
    raise SolverError(Notice(code="excitation.between", text=text))


def _describe_rank(problem: ExcitationProblem, candidates: Candidates) -> Notice:
    gram = problem.find_gram(candidates.unknowns[0])
    lengths = np.sqrt(np.maximum(np.diag(gram), np.finfo(np.float64).tiny))
    vector = np.abs(np.linalg.eigh(gram / np.outer(lengths, lengths))[1][:, 0])
    which: Sequence[str] = [
        problem.observation.names[place]
        for place in np.argsort(-vector, kind="stable")[:4]
        if vector[place] > 0.1
    ]
    text = (
        f"no trajectory of {problem.space.harmonics} harmonics within these limits tells all parameters "
        f"apart; {', '.join(which)} hang together: widen the limits, or use more harmonics"
    )
    return Notice(code="excitation.rank", text=text)


def _list_notices(problem: ExcitationProblem) -> tuple[Notice, ...]:
    assumed = problem.limits.assumed
    notices = problem.state_limits.notices
    if assumed:
        text = f"the robot file does not state all limits; taken were {'; '.join(assumed)}"
        notices = (*notices, Notice(code="excitation.assumed-limits", text=text))
    return notices
