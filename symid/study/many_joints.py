"""Elastic robots with many joints: dynamics without the springs, judged by the torque of a held-out motion.

Input: an elastic robot with values, its library, a seed. Output: `ManyJointsResult`.

Two random motions within the robot's limits are identified together, a third is held out. Energy rows add up
what all joints do, so that they tell the parameters of many joints badly apart; their condition number stands
beside those of the other rows.

Supported: any number of joints, clean and noisy.
Not supported: robots whose file lacks values.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.elastic.elimination import fit_elimination
from symid.elastic.fit import ElasticFit
from symid.elastic.momentum import fit_momentum
from symid.elastic.options import ElasticOptions
from symid.elastic.problem import ElasticProblem, build_problem
from symid.elastic.signals import prepare_elastic_signals
from symid.errors import Notice
from symid.excitation.trajectories import FourierOptions, build_random_fourier
from symid.robot.description import Robot
from symid.rows.rows import warn_of_energy
from symid.simulation.elastic_experiment import simulate_elastic
from symid.simulation.elastic_options import build_clean_options, build_noisy_options
from symid.study.elastic_errors import find_truth
from symid.study.elastic_runs import Condition

__all__ = ["HeldOut", "ManyJointsResult", "study_many_joints"]

_TRAINING = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """What one method leaves of the held-out torque: percent of its RMS, joint by joint.

    `floor` is the same with the true parameters: what the noise of sensors leaves.
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
    condition: Condition
    parameters: int
    methods: tuple[HeldOut, ...]
    condition_elimination: float
    condition_energy: float
    notices: tuple[Notice, ...]


def study_many_joints(
    robot: Robot, library: Library, condition: Condition, seed: int, *, duration: float = 20.0
) -> ManyJointsResult:
    """Return what elimination and momentum rows make of the robot's motions.

    Args:
        robot: elastic, with values.
        library: its functions.
        condition: of the sensors.
        seed: of motions and noise.
        duration: of each motion in s.

    Raises:
        UsageError: the robot file lacks values, or joints are not all elastic.
    """
    truth = find_truth(library.card)
    *training, held_out = _simulate(robot, library, condition, seed, duration)
    # The springs are not looked at: the coarsest will do.
    options = ElasticOptions(refine=False, knees=0)
    problem = _build(library, training, options)
    test = _build(library, [held_out], options)
    design, torque = np.concatenate([test.link, test.motor], axis=2), test.torque

    def judge(fit: ElasticFit) -> HeldOut:
        return HeldOut(
            method=fit.method,
            residual=_find_share(design, torque, fit.chi),
            floor=_find_share(design, torque, truth),
        )

    return ManyJointsResult(
        robot=robot.name,
        joints=tuple(joint.name for joint in robot.axes),
        condition=condition,
        parameters=len(truth),
        methods=tuple(judge(fit) for fit in (fit_elimination(problem), fit_momentum(problem))),
        condition_elimination=_find_condition(
            np.concatenate([problem.link, problem.motor], axis=2).reshape(-1, len(truth))
        ),
        condition_energy=_find_condition(problem.design),
        notices=warn_of_energy(library.card.size),
    )


def _simulate(
    robot: Robot, library: Library, condition: Condition, seed: int, duration: float
) -> list[Recording]:
    rng = np.random.default_rng(seed)
    options = build_clean_options() if condition is Condition.CLEAN else build_noisy_options()
    motion = FourierOptions(duration=duration)
    trajectories = [build_random_fourier(robot, rng, motion) for _ in range(_TRAINING + 1)]
    return [
        simulate_elastic(robot, library, trajectory, options, rng).recording for trajectory in trajectories
    ]


def _build(library: Library, recordings: list[Recording], options: ElasticOptions) -> ElasticProblem:
    signals = [prepare_elastic_signals(recording, options) for recording in recordings]
    return build_problem(library, signals, options)


def _find_share(design: FloatArray, torque: FloatArray, chi: FloatArray) -> tuple[float, ...]:
    left = np.linalg.norm(torque - design @ chi, axis=0)
    return tuple((100.0 * left / np.linalg.norm(torque, axis=0)).tolist())


def _find_condition(matrix: FloatArray) -> float:
    lengths = np.linalg.norm(matrix, axis=0)
    return float(np.linalg.cond(matrix[:, lengths > 0.0] / lengths[lengths > 0.0]))
