"""The energy theorem on a clean simulated run of the shipped arm: work = gain of energy + losses."""

import numpy as np

from symid.codegen.cache import prepare_library
from symid.excitation.trajectories import FourierOptions, build_random_fourier
from symid.robot.toml_reader import read_robot
from symid.simulation.experiment import ExperimentOptions, SensorOptions, simulate_experiment


def test_work_is_energy_and_losses_to_a_millionth(robots_folder):
    robot = read_robot(robots_folder / "two_link.toml")
    library = prepare_library(robot)
    rng = np.random.default_rng(0)
    trajectory = build_random_fourier(robot, rng, FourierOptions())
    clean = ExperimentOptions(sensors=SensorOptions(counts_per_turn=None))
    run = simulate_experiment(robot, library, trajectory, clean, rng)

    # A held torque does the work tau (q' - q) in every step, whatever the motion within it.
    steps = run.torque[:-1] * np.diff(run.q, axis=0)
    work = steps.sum()
    beta = np.array([parameter.value for parameter in library.card.beta])
    kinetic, potential = library.evaluate("energy", run.q, run.dq, beta)
    energy = (kinetic + potential)[:, 0]
    done = np.abs(steps).sum()
    assert abs(work - (energy[-1] - energy[0]) - run.dissipation[-1]) < 1e-6 * done

    # The losses, anew: friction of the model times velocity, by the trapezoidal rule.
    friction = np.array([parameter.value for parameter in library.card.friction])
    (torque,) = library.evaluate("friction", run.dq, friction)
    losses = np.trapezoid((torque * run.dq).sum(axis=1), run.recording.time)
    assert abs(losses - run.dissipation[-1]) < 1e-3 * run.dissipation[-1]
    assert run.events > 0
