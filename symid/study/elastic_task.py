"""One task of a comparison: a dataset with the noise of one seed, and what every method makes of it.

StudyTask -> MethodRun of every method, and of the automatic choice among them.

Supported: robots with two joints whose file states the truth.
Not supported: methods that see other recordings than the rest.
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.cache import prepare_library
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.elastic.fit import ElasticFit
from symid.elastic.independent import fit_independent
from symid.elastic.methods import ElasticWork, build_work, fit_method
from symid.elastic.options import ElasticOptions
from symid.elastic.selection import choose_fit
from symid.robot.description import Robot
from symid.simulation.elastic_run import ElasticRun
from symid.study.elastic_errors import (
    find_excited_errors,
    find_hysteresis_errors,
    find_parameter_error,
    find_truth,
)
from symid.study.elastic_runs import Condition, Dataset, observe_runs, simulate_runs

__all__ = [
    "AUTOMATIC",
    "STUDY_METHODS",
    "Fits",
    "MethodRun",
    "StudyTask",
    "World",
    "fit_all",
    "prepare_world",
    "run_task",
]

AUTOMATIC = "automatic"
_ENCODER = "independent, link encoder"
_RIVALS = ("independent", _ENCODER)
STUDY_METHODS = ("linear-spring", "two-step", "elimination", "weighted", "nlp", *_RIVALS)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyTask:
    """One dataset with the noise of one seed."""

    robot: Robot
    dataset: Dataset
    condition: Condition
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
class World:
    """What all tasks of a process share."""

    library: Library
    truth: FloatArray
    runs: Mapping[str, ElasticRun]


@lru_cache(maxsize=4)
def prepare_world(robot: Robot, condition: Condition, backend: str) -> World:
    """Return library, truth and runs of a robot; made once in every process."""
    library = prepare_library(robot, backend=backend)
    runs = simulate_runs(robot, library, condition)
    return World(library=library, truth=find_truth(library.card), runs=runs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fits:
    """What every method made of the same recordings.

    Args:
        fits: by method, and the one chosen under `AUTOMATIC`.
        seconds: of processor time, the equations that all share included.
        chosen: the method that the automatic choice took, empty where none could be.
    """

    fits: Mapping[str, ElasticFit]
    seconds: Mapping[str, float]
    chosen: str


def fit_all(
    library: Library, recordings: tuple[Recording, ...], options: ElasticOptions, methods: Sequence[str]
) -> Fits:
    """Return the fits of all `methods`, and the automatic choice among those that are no rivals."""
    begin = time.process_time()
    work = build_work(library, recordings, options)
    shared = time.process_time() - begin
    fits: dict[str, ElasticFit] = {}
    seconds: dict[str, float] = {}
    for method in methods:
        begin = time.process_time()
        fits[method] = _fit(work, method)
        seconds[method] = shared + time.process_time() - begin
    begin = time.process_time()
    usable = [fit for name, fit in fits.items() if name not in _RIVALS and fit.outcome.usable]
    if not usable:
        return Fits(fits=fits, seconds=seconds, chosen="")
    best = choose_fit(work, usable).fit.method
    own = sum(seconds[fit.method] - shared for fit in usable)
    seconds[AUTOMATIC] = shared + own + time.process_time() - begin
    return Fits(fits=fits | {AUTOMATIC: fits[best]}, seconds=seconds, chosen=best)


def run_task(task: StudyTask) -> tuple[MethodRun, ...]:
    """Return what every method, and the automatic choice among them, made of one task."""
    world = prepare_world(task.robot, task.condition, task.backend)
    recordings = observe_runs(world.runs, task.dataset.runs, task.condition, task.seed)
    found = fit_all(world.library, recordings, ElasticOptions(), task.methods)
    return tuple(_judge(world, task.dataset, found, method) for method in found.fits)


def _fit(work: ElasticWork, method: str) -> ElasticFit:
    if method == _ENCODER:
        return fit_independent(work.problem, encoder=True)
    return fit_method(work, method)


def _judge(world: World, dataset: Dataset, found: Fits, method: str) -> MethodRun:
    fit = found.fits[method]
    held_out = world.runs["TC"]
    hysteresis = find_hysteresis_errors(fit, held_out)
    truth = [spring for spring in world.library.card.elasticity if spring is not None]
    excited = find_excited_errors(fit, truth, held_out, _find_reach(world, dataset))
    usable = fit.outcome.usable
    return MethodRun(
        method=method,
        parameter_error=find_parameter_error(fit, world.truth) if usable else math.nan,
        hysteresis_error=float(np.max(hysteresis)) if usable else math.nan,
        excited_error=float(np.max(excited)) if usable else math.nan,
        outcome=fit.outcome.name.lower(),
        iterations=max(0, len(fit.history)),
        seconds=found.seconds[method],
        chosen=found.chosen if method == AUTOMATIC else "",
    )


def _find_reach(world: World, dataset: Dataset) -> FloatArray:
    """Return the largest torsion of the dataset's runs (n,), rad or m."""
    reach: FloatArray = np.max([np.abs(world.runs[name].phi).max(axis=0) for name in dataset.runs], axis=0)
    return reach
