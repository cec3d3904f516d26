"""The experiments that methods for elastic joints are compared on, simulated with a known truth.

Input: an elastic robot of two joints, its library. Output: `ElasticRun` by name; recordings of them with the
noise of a seed.

    TA     the exciting trajectory of both joints, 20 s      TA10   the same ten times as large
    TB1, TB2   the decaying trajectory of either joint, 50 s     TC     held out, 20 s

Clean: 5 kHz, perfect sensors. Noisy: 1 kHz, encoders with 2^20 steps a turn, torque noise of 2 % of each
joint's RMS. What moves is the same for all seeds: the noise is on the measurement only.

Supported: robots with two joints. Not supported: noise that the control loop sees.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import Notice, UsageError
from symid.excitation.trajectories import Trajectory, build_scaled, build_ta, build_tb, build_tc
from symid.robot.description import Robot
from symid.simulation.elastic_experiment import simulate_elastic
from symid.simulation.elastic_options import build_clean_options, build_noisy_options
from symid.simulation.elastic_run import ElasticRun, observe

__all__ = ["DATASETS", "Condition", "Dataset", "observe_runs", "simulate_runs"]

_JOINTS = 2
_TEN = 10.0


class Condition(Enum):
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
        "TA10": build_scaled(build_ta(), _TEN),
        "TB1": build_tb(0),
        "TB2": build_tb(1),
        "TC": build_tc(),
    }


def simulate_runs(
    robot: Robot, library: Library, condition: Condition, names: Sequence[str] | None = None
) -> Mapping[str, ElasticRun]:
    """Return the runs called `names`, all by default, without noise on the torque.

    Raises:
        UsageError: the robot has not two joints, or lacks values.
    """
    if robot.freedom != _JOINTS:
        text = f"these experiments are for robots with {_JOINTS} joints; {robot.name!r} has {robot.freedom}"
        raise UsageError(Notice(code="usage.study-robot", text=text))
    options = build_clean_options() if condition is Condition.CLEAN else build_noisy_options()
    trajectories = _list_trajectories()
    # The noise of these recordings is not used: each seed observes the runs anew.
    rng = np.random.default_rng(0)
    return {
        name: simulate_elastic(robot, library, trajectories[name], options, rng)
        for name in names or tuple(trajectories)
    }


def observe_runs(
    runs: Mapping[str, ElasticRun], names: Sequence[str], condition: Condition, seed: int
) -> tuple[Recording, ...]:
    """Return recordings of the runs `names` with the sensors of `condition` and the noise of `seed`.

    A run has the same noise in whatever set it is identified.
    """
    options = build_clean_options() if condition is Condition.CLEAN else build_noisy_options()
    numbers = {name: number for number, name in enumerate(_list_trajectories())}
    return tuple(
        observe(runs[name], options.sensors, np.random.default_rng([seed, numbers[name]])) for name in names
    )
