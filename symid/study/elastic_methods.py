"""Methods for elastic joints next to each other, over many seeds of noise.

Robot, datasets, seeds -> `ElasticStudy`: errors of every method on every dataset, against the known truth.

    TA     the exciting trajectory of both joints, 20 s      TA10   the same ten times as large
    TB1, TB2   the decaying trajectory of either joint, 50 s     TC     held out, 20 s

    parameters   largest |estimate - truth| / |truth| over the dynamic parameters whose truth is not zero
    hysteresis   joint by joint RMS(tau_J estimate - tau_J) / RMS(tau_J), on the true torsion of a held-out
                 run

Clean: 5 kHz, perfect sensors. Noisy: 1 kHz, encoders with 2^20 steps a turn, torque noise of 2 % of each
joint's RMS. What moves is the same for all seeds: the noise is on the measurement only. All methods see the
same recordings. Simulations are made once in every process. Without noise one seed is enough.

Supported: robots with two joints whose file states the truth; methods that give no hysteresis have no error
of it.
Not supported: noise that the control loop sees; seeds that stop and go on another day.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard, prepare_library
from symid.errors import Notice, UsageError
from symid.excitation import Trajectory, build_ta, build_tb, build_tc, scale_trajectory
from symid.identification.elastic import (
    ElasticOptions,
    ElasticSignals,
    MethodFit,
    build_elastic_equations,
    choose_fit,
    compute_elimination_bound,
    compute_spring_bound,
    fit_independent,
    fit_method,
)
from symid.joint_models import compute_hysteresis_torque
from symid.logs import Recording
from symid.robot import Elasticity, Robot
from symid.simulation import ElasticRun, build_clean_options, build_noisy_options, observe, simulate_elastic
from symid.study.monte_carlo import Spread, compute_spread, run_tasks

_JOINTS = 2
_TEN = 10.0


class SensorCondition(Enum):
    """How good the sensors are."""

    CLEAN = "clean"
    NOISY = "noisy"


@dataclass(frozen=True, slots=True, kw_only=True)
class Dataset:
    """Runs that are identified together."""

    name: str
    runs: tuple[str, ...]


DATASETS = (
    Dataset(name="TA", runs=("TA",)),
    Dataset(name="10 x TA", runs=("TA10",)),
    Dataset(name="TB", runs=("TB1", "TB2")),
    Dataset(name="10 x TA + TB", runs=("TA10", "TB1", "TB2")),
)


def _list_trajectories() -> dict[str, Trajectory]:
    return {
        "TA": build_ta(),
        "TA10": scale_trajectory(build_ta(), _TEN),
        "TB1": build_tb(0),
        "TB2": build_tb(1),
        "TC": build_tc(),
    }


def simulate_runs(
    robot: Robot, library: Library, condition: SensorCondition, names: Sequence[str] | None = None
) -> Mapping[str, ElasticRun]:
    """Return the runs called `names`, all by default, without noise on the torque.

    Raises:
        UsageError: the robot has not two joints, or lacks values.
    """
    if robot.freedom != _JOINTS:
        text = f"these experiments are for robots with {_JOINTS} joints; {robot.name!r} has {robot.freedom}"
        raise UsageError(Notice(code="usage.study-robot", text=text))
    options = build_clean_options() if condition is SensorCondition.CLEAN else build_noisy_options()
    trajectories = _list_trajectories()
    # The noise of these recordings is not used: each seed observes the runs anew.
    rng = np.random.default_rng(0)
    return {
        name: simulate_elastic(robot, library, trajectories[name], options, rng)
        for name in names or tuple(trajectories)
    }


def observe_runs(
    runs: Mapping[str, ElasticRun], names: Sequence[str], condition: SensorCondition, seed: int
) -> tuple[Recording, ...]:
    """Return recordings of the runs `names` with the sensors of `condition` and the noise of `seed`.

    A run has the same noise in whatever set it is identified.
    """
    options = build_clean_options() if condition is SensorCondition.CLEAN else build_noisy_options()
    numbers = {name: number for number, name in enumerate(_list_trajectories())}
    return tuple(
        observe(runs[name], options.sensors, np.random.default_rng([seed, numbers[name]])) for name in names
    )


def get_true_parameters(card: ModelCard) -> FloatArray:
    """Return the true dynamic parameters [beta; rotors; friction] (p + n + pf,).

    Raises:
        UsageError: the robot file does not state all of them.
    """
    values = {entry.name: entry.value for entry in (*card.beta, *card.rotors, *card.friction)}
    # A joint whose file states no rotor has one nevertheless: chi has an entry for it.
    rotors = [f"IA{joint.number}" for joint in card.joints if card.elastic]
    names = [*(entry.name for entry in card.beta), *rotors, *(entry.name for entry in card.friction)]
    unknown = [name for name in names if values.get(name) is None]
    if unknown:
        text = f"robot {card.robot!r} states no value for {', '.join(unknown)}; a study needs the truth"
        raise UsageError(Notice(code="usage.study-robot", text=text))
    return np.array([values[name] for name in names], dtype=np.float64)


def compute_parameter_error(fit: MethodFit, truth: FloatArray) -> float:
    """Return the parameter error of a fit in percent; `truth` (p + n + pf,)."""
    known = truth != 0.0
    return float(100.0 * np.max(np.abs(fit.chi[known] / truth[known] - 1.0)))


def compute_hysteresis_errors(fit: MethodFit, held_out: ElasticRun) -> FloatArray:
    """Return the hysteresis error of each joint in percent (n,), nan where the method gives no spring."""
    return _compare_torques(fit, held_out.phi, held_out.joint_torque)


def compute_excited_errors(
    fit: MethodFit, truth: Sequence[Elasticity], held_out: ElasticRun, reach: FloatArray
) -> FloatArray:
    """Return the same on the held-out torsion scaled down into what the logs excited: (n,) percent.

    A spring cannot be known beyond the torsion that was seen; this is how well it is known within.

    Args:
        fit: what a method found.
        truth: the true springs, one a joint.
        held_out: whose torsion is scaled.
        reach: (n,) largest torsion of the logs, rad or m.
    """
    phi = held_out.phi * np.minimum(1.0, reach / np.abs(held_out.phi).max(axis=0))
    columns = [compute_hysteresis_torque(spring, phi[:, joint]) for joint, spring in enumerate(truth)]
    return _compare_torques(fit, phi, np.column_stack(columns))


def _compare_torques(fit: MethodFit, phi: FloatArray, torque: FloatArray) -> FloatArray:
    if not fit.elasticity:
        return np.full(phi.shape[1], np.nan)
    found = [compute_hysteresis_torque(spring, phi[:, joint]) for joint, spring in enumerate(fit.elasticity)]
    left = np.linalg.norm(np.column_stack(found) - torque, axis=0)
    errors: FloatArray = 100.0 * left / np.linalg.norm(torque, axis=0)
    return errors


AUTOMATIC = "automatic"
_ENCODER = "independent, link encoder"
_RIVALS = ("independent", _ENCODER)
STUDY_METHODS = ("linear-spring", "two-step", "elimination", "weighted", "nlp", *_RIVALS)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyTask:
    """One dataset with the noise of one seed."""

    robot: Robot
    dataset: Dataset
    condition: SensorCondition
    seed: int
    backend: str = "auto"
    methods: tuple[str, ...] = STUDY_METHODS


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodRun:
    """What one method made of one task.

    Args:
        method: its name; `chosen` the method that the automatic choice took.
        parameter_error, hysteresis_error, excited_error: percent, the last two of the worse joint, on the
            held-out torsion and on the same within what the logs excited; nan where there is none.
        outcome: how it ended; iterations: how many it took; seconds: of processor time.
    """

    method: str
    parameter_error: float
    hysteresis_error: float
    excited_error: float
    outcome: str
    iterations: int
    seconds: float
    chosen: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticScene:
    """What all tasks of a process share."""

    library: Library
    truth: FloatArray
    runs: Mapping[str, ElasticRun]


@lru_cache(maxsize=4)
def prepare_elastic_scene(robot: Robot, condition: SensorCondition, backend: str) -> ElasticScene:
    """Return library, truth and runs of a robot; made once in every process."""
    library = prepare_library(robot, backend=backend)
    runs = simulate_runs(robot, library, condition)
    return ElasticScene(library=library, truth=get_true_parameters(library.card), runs=runs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodFits:
    """What every method made of the same recordings.

    Args:
        fits: by method, and the one chosen under `AUTOMATIC`.
        seconds: of processor time, the equations that all share included.
        chosen: the method that the automatic choice took, empty where none could be.
    """

    fits: Mapping[str, MethodFit]
    seconds: Mapping[str, float]
    chosen: str


def fit_all_methods(
    library: Library, recordings: tuple[Recording, ...], options: ElasticOptions, methods: Sequence[str]
) -> MethodFits:
    """Return the fits of all `methods`, and the automatic choice among those that are no rivals."""
    begin = time.process_time()
    work = build_elastic_equations(library, recordings, options)
    shared = time.process_time() - begin
    fits: dict[str, MethodFit] = {}
    seconds: dict[str, float] = {}
    for method in methods:
        begin = time.process_time()
        fits[method] = (
            fit_independent(work.problem, encoder=True) if method == _ENCODER else fit_method(work, method)
        )
        seconds[method] = shared + time.process_time() - begin
    begin = time.process_time()
    usable = [fit for name, fit in fits.items() if name not in _RIVALS and fit.outcome.usable]
    if not usable:
        return MethodFits(fits=fits, seconds=seconds, chosen="")
    best = choose_fit(work, usable).fit.method
    own = sum(seconds[fit.method] - shared for fit in usable)
    seconds[AUTOMATIC] = shared + own + time.process_time() - begin
    return MethodFits(fits=fits | {AUTOMATIC: fits[best]}, seconds=seconds, chosen=best)


def run_study_task(task: StudyTask) -> tuple[MethodRun, ...]:
    """Return what every method, and the automatic choice among them, made of one task."""
    world = prepare_elastic_scene(task.robot, task.condition, task.backend)
    recordings = observe_runs(world.runs, task.dataset.runs, task.condition, task.seed)
    found = fit_all_methods(world.library, recordings, ElasticOptions(), task.methods)
    return tuple(_compute_errors(world, task.dataset, found, method) for method in found.fits)


def _compute_errors(world: ElasticScene, dataset: Dataset, found: MethodFits, method: str) -> MethodRun:
    fit = found.fits[method]
    held_out = world.runs["TC"]
    hysteresis = compute_hysteresis_errors(fit, held_out)
    truth = [spring for spring in world.library.card.elasticity if spring is not None]
    reach = np.max([np.abs(world.runs[name].phi).max(axis=0) for name in dataset.runs], axis=0)
    excited = compute_excited_errors(fit, truth, held_out, reach)
    usable = fit.outcome.usable
    return MethodRun(
        method=method,
        parameter_error=compute_parameter_error(fit, world.truth) if usable else math.nan,
        hysteresis_error=float(np.max(hysteresis)) if usable else math.nan,
        excited_error=float(np.max(excited)) if usable else math.nan,
        outcome=fit.outcome.name.lower(),
        iterations=max(0, len(fit.history)),
        seconds=found.seconds[method],
        chosen=found.chosen if method == AUTOMATIC else "",
    )


_TORQUE_NOISE = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodErrors:
    """One method on one dataset: spreads over the seeds, outcomes and choices with how often they came.

    `seconds` is the median processor time, nan where it was not asked for, `iterations` the largest number.
    """

    method: str
    parameter: Spread
    hysteresis: Spread
    excited: Spread
    seconds: float
    iterations: int
    outcomes: tuple[tuple[str, int], ...]
    choices: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetStudy:
    """All methods on one dataset in one condition.

    `bound` is the largest relative standard deviation of the parameters at the Cramer-Rao bound, in percent:
    torque noise only, states exact, nothing known of the springs; `spring_bound` the same where their form is
    known, as the one-shot problem knows it. Both are nan without noise.
    """

    dataset: str
    condition: SensorCondition
    seeds: int
    bound: float
    spring_bound: float
    cells: tuple[MethodErrors, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticStudy:
    """The whole comparison for one robot."""

    robot: str
    studies: tuple[DatasetStudy, ...]


def study_elastic(
    robot: Robot,
    seeds: Sequence[int],
    *,
    backend: str = "auto",
    datasets: Sequence[Dataset] = DATASETS,
    methods: tuple[str, ...] = STUDY_METHODS,
    jobs: int | None = None,
    timed: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> ElasticStudy:
    """Return the errors of all methods, clean (one run) and noisy (one run a seed).

    Args:
        robot: with elastic joints and all values.
        seeds: of the noise.
        backend: what computes its functions; see `prepare_library`.
        datasets: which recordings are identified together.
        methods: some of `STUDY_METHODS`.
        jobs: processes; None for one a core.
        timed: whether to tell the time that each method took, which differs from run to run.
        progress: told how many tasks are done, of how many.

    Raises:
        UsageError: the robot has not two joints, or its file states no truth.
    """
    groups = [(dataset, condition) for condition in SensorCondition for dataset in datasets]
    tasks = [
        StudyTask(
            robot=robot, dataset=dataset, condition=condition, seed=seed, backend=backend, methods=methods
        )
        for dataset, condition in groups
        for seed in (seeds if condition is SensorCondition.NOISY else seeds[:1])
    ]
    # Made before the processes start, so that they do not all compile it.
    world = prepare_elastic_scene(robot, SensorCondition.NOISY, backend)
    results = run_tasks(run_study_task, tasks, jobs=jobs, progress=progress)
    studies = []
    for dataset, condition in groups:
        noisy = condition is SensorCondition.NOISY
        bound, spring_bound = _compute_bounds(world, dataset) if noisy else (math.nan, math.nan)
        every = [
            runs
            for task, runs in zip(tasks, results, strict=True)
            if (task.dataset, task.condition) == (dataset, condition)
        ]
        studies.append(
            DatasetStudy(
                dataset=dataset.name,
                condition=condition,
                seeds=len(every),
                bound=bound,
                spring_bound=spring_bound,
                cells=_summarise(every, timed=timed),
            )
        )
    return ElasticStudy(robot=world.library.card.robot, studies=tuple(studies))


def _summarise(results: Sequence[tuple[MethodRun, ...]], *, timed: bool) -> tuple[MethodErrors, ...]:
    """Return a cell for every method; `results` has the runs of every seed."""
    return tuple(
        MethodErrors(
            method=runs[0].method,
            parameter=compute_spread(np.array([run.parameter_error for run in runs])),
            hysteresis=compute_spread(np.array([run.hysteresis_error for run in runs])),
            excited=compute_spread(np.array([run.excited_error for run in runs])),
            seconds=float(np.median([run.seconds for run in runs])) if timed else math.nan,
            iterations=max(run.iterations for run in runs),
            outcomes=_count([run.outcome for run in runs]),
            choices=_count([run.chosen for run in runs if run.chosen]),
        )
        for runs in zip(*results, strict=True)
    )


def _count(words: Sequence[str]) -> tuple[tuple[str, int], ...]:
    return tuple((word, words.count(word)) for word in sorted(set(words)))


def _compute_bounds(world: ElasticScene, dataset: Dataset) -> tuple[float, float]:
    """Return the largest relative standard deviation, percent, at the bound without and with springs."""
    signals, noise = [], []
    for name in dataset.runs:
        run = world.runs[name]
        signals.append(
            ElasticSignals(
                time=run.time,
                q=run.q,
                dq=run.dq,
                theta=run.theta,
                dtheta=run.dtheta,
                tau=run.torque,
                period=run.recording.period,
                settled=0,
                hold="zero",
            )
        )
        noise.append(_TORQUE_NOISE * np.sqrt(np.mean(run.torque**2, axis=0)))
    known = world.truth != 0.0
    without, springs = (
        np.sqrt(np.diag(find(world.library, signals, noise)))[known] / np.abs(world.truth[known])
        for find in (compute_elimination_bound, compute_spring_bound)
    )
    return 100.0 * float(np.max(without)), 100.0 * float(np.max(springs))
