"""Tracking of identified robots: models of two procedures and a rigid one in the same loop, over many seeds.

Input: a robot, seeds. Output: `TrackingStudy`: RMS errors, paired differences with their intervals.

    identified   from 10 x TA + TB with the noise of the seed, by the automatic choice          (Case 1)
    independent  from the same logs, by the procedures that identify dynamics and hysteresis apart (Case 2)
    rigid        dynamics of Case 1, springs left out

Each model drives the true robot along TC, on which nothing was identified.

Supported: robots with two joints whose file states the truth.
Not supported: noise in the loop.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from symid.elastic.fit import ElasticFit
from symid.elastic.options import ElasticOptions
from symid.elastic.tracking import RIGID, simulate_tracking
from symid.excitation.trajectories import build_tc
from symid.robot.description import Robot
from symid.simulation.elastic_options import build_noisy_options
from symid.study.elastic_runs import DATASETS, Condition, observe_runs
from symid.study.elastic_task import AUTOMATIC, STUDY_METHODS, fit_all, prepare_world
from symid.study.executor import run_tasks
from symid.study.spread import PairedDifference, Spread, find_paired_difference, find_spread

__all__ = ["CASES", "Comparison", "TrackingStudy", "study_tracking"]

CASE_1, CASE_2, CASE_2_ENCODER = (
    "Case 1: identified together",
    "Case 2: identified apart, motor side",
    "Case 2 with link encoder",
)
CASES = (CASE_1, CASE_2, CASE_2_ENCODER, RIGID)


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """RMS of `first` less RMS of `second` at one joint, over the seeds, in the unit of its position."""

    joint: str
    first: str
    second: str
    difference: PairedDifference


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingStudy:
    """What came out.

    Args:
        robot: its name; joints: names; seeds: how many.
        rms: of every case and joint, (case, spreads over the seeds).
        comparisons: of Case 1 with each other case, joint by joint.
    """

    robot: str
    joints: tuple[str, ...]
    seeds: int
    rms: tuple[tuple[str, tuple[Spread, ...]], ...]
    comparisons: tuple[Comparison, ...]


def _run_seed(task: tuple[Robot, str, int]) -> dict[str, tuple[float, ...]]:
    """Return the RMS errors of every case and joint for one seed."""
    robot, backend, seed = task
    world = prepare_world(robot, Condition.NOISY, backend)
    recordings = observe_runs(world.runs, DATASETS[-1].runs, Condition.NOISY, seed)
    fits = fit_all(world.library, recordings, ElasticOptions(), STUDY_METHODS).fits
    models: dict[str, ElasticFit] = {
        CASE_1: fits[AUTOMATIC],
        CASE_2: fits["independent"],
        CASE_2_ENCODER: fits["independent, link encoder"],
    }
    runs = simulate_tracking(robot, world.library, models, build_tc(), build_noisy_options())
    return {run.name: tuple(run.rms.tolist()) for run in runs}


def study_tracking(
    robot: Robot,
    seeds: Sequence[int],
    *,
    backend: str = "auto",
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TrackingStudy:
    """Return the tracking errors of all cases.

    Args:
        robot: with elastic joints and all values.
        seeds: of the noise of the logs that models are identified from.
        backend: what computes its functions; see `prepare_library`.
        jobs: processes; None for one a core.
        progress: told how many seeds are done, of how many.

    Raises:
        UsageError: the robot has not two joints, or its file states no truth.
    """
    prepare_world(robot, Condition.NOISY, backend)
    results = run_tasks(_run_seed, [(robot, backend, seed) for seed in seeds], jobs=jobs, progress=progress)
    rms = {case: np.array([result[case] for result in results]) for case in CASES}
    joints = tuple(joint.name for joint in robot.axes)
    return TrackingStudy(
        robot=robot.name,
        joints=joints,
        seeds=len(seeds),
        rms=tuple((case, tuple(find_spread(column) for column in rms[case].T)) for case in CASES),
        comparisons=tuple(
            Comparison(
                joint=name,
                first=CASE_1,
                second=other,
                difference=find_paired_difference(rms[CASE_1][:, index], rms[other][:, index]),
            )
            for other in CASES[1:]
            for index, name in enumerate(joints)
        ),
    )
