"""Methods for elastic joints next to each other, over many seeds of noise.

Input: a robot file, datasets, seeds. Output: `ElasticStudy`: errors of every method on every dataset.

Every task is one dataset with the noise of one seed; all methods see the same recordings. Simulations are
made once in every process. Without noise one seed is enough.

Supported: robots with two joints whose file states the truth.
Not supported: methods that see other recordings than the rest.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.cache import prepare_library
from symid.codegen.library import Library
from symid.elastic.choice import choose_candidate
from symid.elastic.covariance import find_bound
from symid.elastic.fit import ElasticFit
from symid.elastic.independent import fit_independent
from symid.elastic.methods import ElasticWork, build_work, find_candidate, fit_method
from symid.elastic.options import ElasticOptions
from symid.elastic.signals import ElasticSignals
from symid.formats.toml import read_robot
from symid.simulation.elastic_run import ElasticRun
from symid.study.elastic_errors import find_hysteresis_errors, find_parameter_error, find_truth
from symid.study.elastic_runs import DATASETS, Condition, Dataset, observe_runs, simulate_runs
from symid.study.executor import run_tasks
from symid.study.spread import Spread, find_spread

__all__ = [
    "AUTOMATIC",
    "STUDY_METHODS",
    "Cell",
    "ElasticStudy",
    "MethodRun",
    "StudyTask",
    "run_task",
    "study_elastic",
]

AUTOMATIC = "automatic"
_ENCODER = "independent, link encoder"
_RIVALS = ("independent", _ENCODER)
STUDY_METHODS = ("linear-spring", "two-step", "elimination", "weighted", "nlp", *_RIVALS)
_TORQUE_NOISE = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyTask:
    """One dataset with the noise of one seed."""

    robot: Path
    dataset: Dataset
    condition: Condition
    seed: int
    methods: tuple[str, ...] = STUDY_METHODS


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodRun:
    """What one method made of one task.

    Args:
        method: its name; `chosen` the method that the automatic choice took.
        parameter_error, hysteresis_error: percent, the latter of the worse joint; nan where there is none.
        outcome: how it ended; iterations: how many it took; seconds: of processor time.
    """

    method: str
    parameter_error: float
    hysteresis_error: float
    outcome: str
    iterations: int
    seconds: float
    chosen: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One method on one dataset: spreads over the seeds, outcomes and choices with how often they came.

    `seconds` is the median processor time, `iterations` the largest number.
    """

    method: str
    parameter: Spread
    hysteresis: Spread
    seconds: float
    iterations: int
    outcomes: tuple[tuple[str, int], ...]
    choices: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetStudy:
    """All methods on one dataset in one condition.

    `bound` is the largest relative standard deviation of the parameters at the Cramer-Rao bound, in percent:
    torque noise only, states exact; nan without noise.
    """

    dataset: str
    condition: Condition
    seeds: int
    bound: float
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticStudy:
    """The whole comparison for one robot."""

    robot: str
    studies: tuple[DatasetStudy, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _World:
    """What all tasks of a process share."""

    library: Library
    truth: FloatArray
    runs: Mapping[str, ElasticRun]


@lru_cache(maxsize=4)
def _prepare_world(path: Path, condition: Condition) -> _World:
    robot = read_robot(path)
    library = prepare_library(robot)
    runs = simulate_runs(robot, library, condition)
    return _World(library=library, truth=find_truth(library.card), runs=runs)


def run_task(task: StudyTask) -> tuple[MethodRun, ...]:
    """Return what every method, and the automatic choice among them, made of one task."""
    world = _prepare_world(task.robot, task.condition)
    recordings = observe_runs(world.runs, task.dataset.runs, task.condition, task.seed)
    begin = time.process_time()
    work = build_work(world.library, recordings, ElasticOptions())
    shared = time.process_time() - begin
    fits: dict[str, ElasticFit] = {}
    runs = []
    for method in task.methods:
        begin = time.process_time()
        fits[method] = _fit(work, method)
        seconds = shared + time.process_time() - begin
        runs.append(_judge(world, method, fits[method], seconds))
    begin = time.process_time()
    candidates = [find_candidate(work, fit) for name, fit in fits.items() if name not in _RIVALS]
    if candidates:
        best, _ = choose_candidate(candidates, work.rows, work.band.scatter)
        seconds = sum(run.seconds for run in runs if run.method not in _RIVALS)
        seconds += time.process_time() - begin - shared * (len(candidates) - 1)
        runs.append(_judge(world, AUTOMATIC, fits[best], seconds, chosen=best))
    return tuple(runs)


def _fit(work: ElasticWork, method: str) -> ElasticFit:
    if method == _ENCODER:
        return fit_independent(work.problem, encoder=True)
    return fit_method(work, method)


def _judge(world: _World, method: str, fit: ElasticFit, seconds: float, chosen: str = "") -> MethodRun:
    hysteresis = find_hysteresis_errors(fit, world.runs["TC"])
    usable = fit.outcome.usable
    return MethodRun(
        method=method,
        parameter_error=find_parameter_error(fit, world.truth) if usable else math.nan,
        hysteresis_error=float(np.max(hysteresis)) if usable else math.nan,
        outcome=fit.outcome.name.lower(),
        iterations=max(0, len(fit.history)),
        seconds=seconds,
        chosen=chosen,
    )


def study_elastic(
    robot: Path,
    seeds: Sequence[int],
    *,
    datasets: Sequence[Dataset] = DATASETS,
    methods: tuple[str, ...] = STUDY_METHODS,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ElasticStudy:
    """Return the errors of all methods, clean (one run) and noisy (one run a seed).

    Args:
        robot: path of the robot file.
        seeds: of the noise.
        datasets: which recordings are identified together.
        methods: some of `STUDY_METHODS`.
        jobs: processes; None for one a core.
        progress: told how many tasks are done, of how many.

    Raises:
        UsageError: the robot has not two joints, or its file states no truth.
    """
    groups = [(dataset, condition) for condition in Condition for dataset in datasets]
    tasks = [
        StudyTask(robot=robot, dataset=dataset, condition=condition, seed=seed, methods=methods)
        for dataset, condition in groups
        for seed in (seeds if condition is Condition.NOISY else seeds[:1])
    ]
    # Made before the processes start, so that they do not all compile it.
    world = _prepare_world(robot, Condition.NOISY)
    results = run_tasks(run_task, tasks, jobs=jobs, progress=progress)
    found: dict[tuple[str, Condition], list[tuple[MethodRun, ...]]] = {}
    for task, runs in zip(tasks, results, strict=True):
        found.setdefault((task.dataset.name, task.condition), []).append(runs)
    studies = tuple(
        DatasetStudy(
            dataset=dataset.name,
            condition=condition,
            seeds=len(found[dataset.name, condition]),
            bound=_find_bound(world, dataset) if condition is Condition.NOISY else math.nan,
            cells=_summarise(found[dataset.name, condition]),
        )
        for dataset, condition in groups
    )
    return ElasticStudy(robot=world.library.card.robot, studies=studies)


def _summarise(results: Sequence[tuple[MethodRun, ...]]) -> tuple[Cell, ...]:
    """Return a cell for every method; `results` has the runs of every seed."""
    return tuple(
        Cell(
            method=runs[0].method,
            parameter=find_spread(np.array([run.parameter_error for run in runs])),
            hysteresis=find_spread(np.array([run.hysteresis_error for run in runs])),
            seconds=float(np.median([run.seconds for run in runs])),
            iterations=max(run.iterations for run in runs),
            outcomes=_count([run.outcome for run in runs]),
            choices=_count([run.chosen for run in runs if run.chosen]),
        )
        for runs in zip(*results, strict=True)
    )


def _count(words: Sequence[str]) -> tuple[tuple[str, int], ...]:
    return tuple((word, words.count(word)) for word in sorted(set(words)))


def _find_bound(world: _World, dataset: Dataset) -> float:
    """Return the largest relative standard deviation at the bound, percent."""
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
    bound = find_bound(world.library, signals, noise)
    known = world.truth != 0.0
    return float(np.max(100.0 * np.sqrt(np.diag(bound))[known] / np.abs(world.truth[known])))
