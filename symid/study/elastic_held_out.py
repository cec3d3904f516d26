"""Identified models of elastic robots, judged on a held-out motion.

Robot, seeds -> `TrackingStudy`: how links follow TC in closed loop with feed-forward of each model.

    identified   from 10 x TA + TB with the noise of the seed, by the automatic choice          (Case 1)
    independent  from the same logs, by the procedures that identify dynamics and hysteresis apart (Case 2)
    rigid        dynamics of Case 1, springs left out

Robot, library, seed -> `ManyJointsResult`: the torque that elimination and momentum rows leave unexplained.
Two random motions within the robot's limits are identified together, a third is held out. Energy rows
separate the parameters of many joints badly: their condition number stands beside those of the other rows.

Not supported: noise in the loop; robots whose file lacks values; tracking of other than two joints.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from operator import attrgetter

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import Notice
from symid.excitation import FourierOptions, build_random_fourier, build_tc
from symid.identification.elastic import (
    RIGID,
    ElasticOptions,
    build_elastic_problem,
    fit_elimination,
    fit_momentum,
    prepare_elastic_signals,
    simulate_tracking,
)
from symid.identification.regression import warn_of_energy
from symid.robot import Robot
from symid.serialization import HIDDEN, write_as
from symid.simulation import build_noisy_options, simulate_elastic
from symid.study.elastic_methods import (
    AUTOMATIC,
    DATASETS,
    STUDY_METHODS,
    TRAINING,
    SensorCondition,
    fit_all_methods,
    get_true_parameters,
    observe_runs,
    prepare_elastic_scene,
)
from symid.study.monte_carlo import (
    PairedDifference,
    Spread,
    compute_paired_difference,
    compute_spread,
    run_tasks,
)

_METHODS = {
    "Case 1: identified together": AUTOMATIC,
    "Case 2: identified apart, motor side": "independent",
    "Case 2 with link encoder": "independent, link encoder",
}
CASES = (*_METHODS, RIGID)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingDifference:
    """RMS of `first` less RMS of `second` at one joint, over the seeds, in the unit of its position."""

    joint: str
    first: str
    second: str
    difference: PairedDifference


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingStudy:
    """Tracking errors of all cases.

    Args:
        robot: its name; joints: names; seeds: how many.
        rms: of every case and joint, (case, spreads over the seeds).
        comparisons: of Case 1 with each other case, joint by joint.
    """

    robot: str
    joints: tuple[str, ...]
    seeds: int
    rms: tuple[tuple[str, tuple[Spread, ...]], ...]
    comparisons: tuple[TrackingDifference, ...]


def _run_seed(task: tuple[Robot, str, int]) -> dict[str, tuple[float, ...]]:
    """Return the RMS errors of every case and joint for one seed."""
    robot, backend, seed = task
    scene = prepare_elastic_scene(robot, SensorCondition.NOISY, backend)
    recordings = observe_runs(scene.runs, DATASETS[TRAINING], SensorCondition.NOISY, seed)
    fits, _ = fit_all_methods(scene.library, recordings, ElasticOptions(), STUDY_METHODS)
    models = {case: fits[method] for case, method in _METHODS.items()}
    runs = simulate_tracking(robot, scene.library, models, build_tc(), build_noisy_options())
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

    `seeds` are those of the noise of the logs that models are identified from; `backend` as of
    `prepare_library`, `jobs` and `progress` as of `run_tasks`. A UsageError: the robot has not two joints, or
    its file states no truth.
    """
    prepare_elastic_scene(robot, SensorCondition.NOISY, backend)
    results = run_tasks(_run_seed, [(robot, backend, seed) for seed in seeds], jobs=jobs, progress=progress)
    rms = {case: np.array([result[case] for result in results]) for case in CASES}
    joints = tuple(joint.name for joint in robot.axes)
    return TrackingStudy(
        robot=robot.name,
        joints=joints,
        seeds=len(seeds),
        rms=tuple((case, tuple(compute_spread(column) for column in rms[case].T)) for case in CASES),
        comparisons=tuple(
            TrackingDifference(
                joint=name,
                first=CASES[0],
                second=other,
                difference=compute_paired_difference(rms[CASES[0]][:, index], rms[other][:, index]),
            )
            for other in CASES[1:]
            for index, name in enumerate(joints)
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """What one method leaves of the held-out torque, percent of its RMS, joint by joint.

    `floor` is the same with the true parameters: the noise of the sensors.
    """

    method: str
    residual: tuple[float, ...]
    floor: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ManyJointsResult:
    """One condition of the sensors.

    Args:
        robot: its name; joints: their names; condition: of the sensors.
        parameters: how many dynamic parameters were identified.
        methods: what each of them left.
        condition_elimination, condition_energy: condition numbers of the column-scaled rows.
        notices: warnings of the rows.
    """

    robot: str
    joints: tuple[str, ...]
    condition: SensorCondition = field(metadata=write_as(attrgetter("value")))
    parameters: int
    methods: tuple[HeldOut, ...]
    condition_elimination: float
    condition_energy: float
    notices: tuple[Notice, ...] = field(metadata=HIDDEN)


def study_many_joints(
    robot: Robot, library: Library, condition: SensorCondition, seed: int, *, duration: float = 20.0
) -> ManyJointsResult:
    """Return what elimination and momentum rows leave of a held-out motion.

    `library` has the functions of the robot; `seed` is that of motions and noise, `duration` that of each
    motion in s. A UsageError: the robot file lacks values, or joints are not all elastic.
    """
    truth = get_true_parameters(library.card)
    rng = np.random.default_rng(seed)
    motion = FourierOptions(duration=duration)
    trajectories = [build_random_fourier(robot, rng, motion) for _ in range(3)]
    recordings = [
        simulate_elastic(robot, library, trajectory, condition.build_options(), rng).recording
        for trajectory in trajectories
    ]
    # The springs are not looked at: the coarsest will do.
    options = ElasticOptions(refine=False, knees=0)
    signals = [prepare_elastic_signals(recording, options) for recording in recordings]
    problem = build_elastic_problem(library, signals[:-1], options)
    test = build_elastic_problem(library, signals[-1:], options)
    design, torque = test.stack_filtered()

    def compute_shares(chi: FloatArray) -> tuple[float, ...]:
        left = np.linalg.norm(torque - design @ chi, axis=0)
        return tuple((100.0 * left / np.linalg.norm(torque, axis=0)).tolist())

    rows = problem.stack_filtered()[0].reshape(-1, len(truth))
    return ManyJointsResult(
        robot=robot.name,
        joints=tuple(joint.name for joint in robot.axes),
        condition=condition,
        parameters=len(truth),
        methods=tuple(
            HeldOut(method=fit.method, residual=compute_shares(fit.chi), floor=compute_shares(truth))
            for fit in (fit_elimination(problem), fit_momentum(problem))
        ),
        condition_elimination=_compute_condition(rows),
        condition_energy=_compute_condition(problem.design),
        notices=warn_of_energy(library.card.size),
    )


def _compute_condition(matrix: FloatArray) -> float:
    lengths = np.linalg.norm(matrix, axis=0)
    return float(np.linalg.cond(matrix[:, lengths > 0.0] / lengths[lengths > 0.0]))
