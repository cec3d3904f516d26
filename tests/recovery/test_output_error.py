"""Output error finds the truth from a far start, where coarse encoders spoil what is differentiated."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.errors import SolverError, UsageError
from symid.excitation.trajectories import FourierOptions, build_random_fourier
from symid.formats.toml import read_robot
from symid.identification.identify import identify_parameters
from symid.identification.output_error import ServoLoop, fit_output_error
from symid.robot.log_map import Decimation, Processing
from symid.simulation.experiment import ExperimentOptions, simulate_experiment
from symid.simulation.sensors import SensorOptions

GAINS = (np.array([400.0, 60.0]), np.array([25.0, 3.0]))
PROCESSING = Processing(drop_first=250, drop_last=10, decimation=Decimation(factor=5))


@pytest.fixture(scope="module")
def library(robots_folder):
    return prepare_library(read_robot(robots_folder / "two_link.toml"))


@pytest.fixture(scope="module")
def run(library, robots_folder):
    robot = read_robot(robots_folder / "two_link.toml")
    rng = np.random.default_rng(3)
    trajectory = build_random_fourier(robot, rng, FourierOptions(duration=6.0, base_frequency=1.0 / 6.0))
    options = ExperimentOptions(
        stiffness=tuple(GAINS[0]),
        damping=tuple(GAINS[1]),
        velocity_filter=1e4,
        period=2e-3,
        sensors=SensorOptions(counts_per_turn=None),
    )
    return simulate_experiment(robot, library, trajectory, options, rng), trajectory


@pytest.fixture(scope="module")
def loop(run, library):
    made, trajectory = run
    _, speeds, _ = trajectory.evaluate(made.recording.time)
    beta = np.array([entry.value for entry in library.card.beta])
    (weight,) = library.evaluate("gravity", made.desired[:1], beta)
    return ServoLoop(
        reference=made.desired,
        velocity=speeds,
        stiffness=GAINS[0],
        damping=GAINS[1],
        offset=weight.reshape(-1),
    )


def list_truth(library):
    return {entry.name: entry.value for entry in (*library.card.beta, *library.card.friction)}


def test_the_truth_comes_back_from_values_a_fifth_too_large(run, loop, library):
    truth = list_truth(library)
    start = {name: 1.2 * value for name, value in truth.items()}
    recording = run[0].recording
    found = fit_output_error(library, [recording], [loop], PROCESSING, start)
    assert found.iterations <= 12
    assert found.changes[-1] < found.changes[0]
    expected = np.array(list(truth.values()))
    sizes = np.maximum(np.abs(expected), 0.05)
    errors = np.abs((found.fit.values - expected) / sizes)
    # The controller of the log takes its velocity from differences, a sample late: friction shows it first.
    assert errors[: len(library.card.beta)].max() < 0.04
    assert errors.max() < 0.15
    assert np.all(found.tracking < 2e-3)


def test_a_coarse_encoder_spoils_differences_and_not_this(run, loop, library):
    truth = list_truth(library)
    recording = run[0].recording
    step = 2.0 * np.pi / 500
    coarse = replace(recording, position=step * np.round(recording.position / step))
    start = {name: 1.2 * value for name, value in truth.items()}
    found = fit_output_error(library, [coarse], [loop], PROCESSING, start).fit.values
    estimate = identify_parameters(library, [coarse], replace(PROCESSING, filter_cutoff=100.0))
    names = tuple(truth)
    expected = np.array(list(truth.values()))
    sizes = np.maximum(np.abs(expected), 0.05)
    errors = [np.linalg.norm((x - expected) / sizes) for x in (found, estimate.assemble(names))]
    assert errors[0] < 0.3 * errors[1]


def test_what_cannot_be_simulated_is_said(run, loop, library):
    truth = list_truth(library)
    recording = run[0].recording
    with pytest.raises(UsageError) as caught:
        fit_output_error(library, [recording], [], PROCESSING, {})
    assert [notice.code for notice in caught.value.notices] == ["usage.output-error"] * 2
    short = replace(loop, reference=loop.reference[:-1], velocity=loop.velocity[:-1])
    with pytest.raises(UsageError, match="the reference is"):
        fit_output_error(library, [recording], [short], PROCESSING, truth)
    wrong = replace(loop, stiffness=-loop.stiffness)
    with pytest.raises(SolverError, match="left its reference") as lost:
        fit_output_error(library, [recording], [wrong], PROCESSING, truth)
    assert lost.value.notices[0].code == "solver.output-error"
