"""Short experiments with rigid arms that recovery tests share."""

import numpy as np

from symid.excitation.trajectories import FourierOptions, build_random_fourier
from symid.robot.description import Controller
from symid.simulation.experiment import ExperimentOptions, SensorOptions, simulate_experiment

GAINS = Controller(
    stiffness=(400.0, 60.0), damping=(25.0, 3.0), velocity_filter=150.0, offset=None, torque="average"
)
PERFECT = SensorOptions(counts_per_turn=None)


def run_fourier(robot, library, seed, *, duration=6.0, periods=1, sensors=PERFECT, **options):
    """Return a run along a random Fourier series."""
    rng = np.random.default_rng(seed)
    shape = FourierOptions(duration=duration, base_frequency=periods / duration)
    motion = build_random_fourier(robot, rng, shape)
    return simulate_experiment(robot, library, motion, ExperimentOptions(sensors=sensors, **options), rng)


def list_truth(library):
    return {entry.name: entry.value for entry in (*library.card.beta, *library.card.friction)}
