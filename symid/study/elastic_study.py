"""Methods for elastic joints next to each other, over many seeds of noise.

Input: a robot, datasets, seeds. Output: `ElasticStudy`: errors of every method on every dataset.

All methods see the same recordings (`elastic_task`). Simulations are made once in every process. Without
noise one seed is enough.

Supported: robots with two joints whose file states the truth.
Not supported: seeds that stop and go on another day.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from symid.elastic.covariance import find_bound
from symid.elastic.signals import ElasticSignals
from symid.elastic.spring_bound import find_spring_bound
from symid.robot.description import Robot
from symid.study.elastic_runs import DATASETS, Condition, Dataset
from symid.study.elastic_task import STUDY_METHODS, MethodRun, StudyTask, World, prepare_world, run_task
from symid.study.executor import run_tasks
from symid.study.spread import Spread, find_spread

__all__ = ["Cell", "DatasetStudy", "ElasticStudy", "study_elastic"]

_TORQUE_NOISE = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
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
    condition: Condition
    seeds: int
    bound: float
    spring_bound: float
    cells: tuple[Cell, ...]


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
    groups = [(dataset, condition) for condition in Condition for dataset in datasets]
    tasks = [
        StudyTask(
            robot=robot, dataset=dataset, condition=condition, seed=seed, backend=backend, methods=methods
        )
        for dataset, condition in groups
        for seed in (seeds if condition is Condition.NOISY else seeds[:1])
    ]
    # Made before the processes start, so that they do not all compile it.
    world = prepare_world(robot, Condition.NOISY, backend)
    results = run_tasks(run_task, tasks, jobs=jobs, progress=progress)
    found: dict[tuple[str, Condition], list[tuple[MethodRun, ...]]] = {}
    for task, runs in zip(tasks, results, strict=True):
        found.setdefault((task.dataset.name, task.condition), []).append(runs)
    studies = []
    for dataset, condition in groups:
        noisy = condition is Condition.NOISY
        bound, spring_bound = _find_bounds(world, dataset) if noisy else (math.nan, math.nan)
        every = found[dataset.name, condition]
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


def _summarise(results: Sequence[tuple[MethodRun, ...]], *, timed: bool) -> tuple[Cell, ...]:
    """Return a cell for every method; `results` has the runs of every seed."""
    return tuple(
        Cell(
            method=runs[0].method,
            parameter=find_spread(np.array([run.parameter_error for run in runs])),
            hysteresis=find_spread(np.array([run.hysteresis_error for run in runs])),
            excited=find_spread(np.array([run.excited_error for run in runs])),
            seconds=float(np.median([run.seconds for run in runs])) if timed else math.nan,
            iterations=max(run.iterations for run in runs),
            outcomes=_count([run.outcome for run in runs]),
            choices=_count([run.chosen for run in runs if run.chosen]),
        )
        for runs in zip(*results, strict=True)
    )


def _count(words: Sequence[str]) -> tuple[tuple[str, int], ...]:
    return tuple((word, words.count(word)) for word in sorted(set(words)))


def _find_bounds(world: World, dataset: Dataset) -> tuple[float, float]:
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
        for find in (find_bound, find_spring_bound)
    )
    return 100.0 * float(np.max(without)), 100.0 * float(np.max(springs))
