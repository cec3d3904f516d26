"""Output error finds the truth from a far start, where coarse encoders spoil what is differentiated."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import SolverError
from symid.identification.rigid.closed_loop import (
    ClosedLoopProblem,
    build_closed_loop,
    fit_output_error,
    identify_closed_loop,
)
from symid.identification.rigid.fit import identify_parameters
from symid.logs.recording import RunSettings
from symid.logs.runs import get_run_weights
from symid.robot.description import Decimation, Processing
from symid.simulation.experiment import SensorOptions
from tests.recovery.rigid_runs import GAINS, PERFECT, list_truth, run_fourier
from tests.refusals import raises

PROCESSING = Processing(drop_first=250, drop_last=10, decimation=Decimation(factor=5))
FREE = np.full(2, np.inf)


@pytest.fixture(scope="module")
def robot(two_link):
    return replace(two_link, processing=PROCESSING, controller=GAINS)


@pytest.fixture(scope="module")
def library(two_link_library):
    return two_link_library


@pytest.fixture(scope="module")
def record(robot, library):
    """Return what a run logs, by the seed of its motion and its sensors."""

    def run(seed, sensors=PERFECT):
        return run_fourier(robot, library, seed, sensors=sensors, controller=GAINS, period=2e-3).recording

    return run


@pytest.fixture(scope="module")
def recording(record):
    return record(3)


@pytest.fixture(scope="module")
def loop(recording):
    return build_closed_loop(recording, GAINS, FREE)


def fit_to(library, recordings, loops, start):
    problem = ClosedLoopProblem(library=library, recordings=recordings, loops=loops, processing=PROCESSING)
    return fit_output_error(problem, start)


def start_off(library):
    """Return values a fifth too large."""
    return {name: 1.2 * value for name, value in list_truth(library).items()}


def find_errors(library, values):
    """Return errors of the inertial parameters and of friction, relative to values of 0.05 at least."""
    truth = np.array(list(list_truth(library).values()))
    errors = np.abs((values - truth) / np.maximum(np.abs(truth), 0.05))
    return errors[: len(library.card.beta)].max(), errors[len(library.card.beta) :].max()


def test_the_truth_comes_back_from_values_a_fifth_too_large(recording, loop, library):
    found = fit_to(library, [recording], [loop], start_off(library))
    assert len(found.changes) <= 12
    assert found.changes[-1] < found.changes[0]
    assert max(find_errors(library, found.fit.values)) < 1e-4
    assert np.all(found.tracking < 1e-6)


def test_noise_of_torque_and_encoder_leaves_a_percent(record, library):
    noisy = record(3, SensorOptions(counts_per_turn=2.0**20, torque_noise=(0.05,)))
    found = fit_to(library, [noisy], [build_closed_loop(noisy, GAINS, FREE)], start_off(library))
    inertial, friction = find_errors(library, found.fit.values)
    assert inertial < 0.01
    assert friction < 0.03
    truth = np.array(list(list_truth(library).values()))
    far = np.abs(found.fit.values - truth) / np.sqrt(np.diag(found.fit.covariance))
    # Twelve parameters: one beyond three deviations is the work of chance, one beyond four is not.
    assert far.max() < 4.0


def test_a_controller_with_another_velocity_shows_in_friction_first(recording, library):
    start = list_truth(library)
    other = replace(GAINS, velocity_source="sensor", velocity_filter=None)
    found = fit_to(library, [recording], [build_closed_loop(recording, other, FREE)], start)
    inertial, friction = find_errors(library, found.fit.values)
    assert 1e-3 < inertial < 0.01
    assert inertial < friction < 0.03


def test_a_coarse_encoder_spoils_differences_and_not_this(recording, loop, library):
    truth = list_truth(library)
    step = 2.0 * np.pi / 500
    coarse = replace(recording, position=step * np.round(recording.position / step))
    found = fit_to(library, [coarse], [loop], start_off(library)).fit.values
    estimate = identify_parameters(library, [coarse], replace(PROCESSING, filter_cutoff=100.0))
    names = tuple(truth)
    expected = np.array(list(truth.values()))
    sizes = np.maximum(np.abs(expected), 0.05)
    errors = [np.linalg.norm((x - expected) / sizes) for x in (found, estimate.assemble(names))]
    assert errors[0] < 0.1 * errors[1]


def test_several_runs_count_by_their_weights(record, robot, library):
    noisy = SensorOptions(counts_per_turn=None, torque_noise=(0.3,))
    good = replace(record(3), run=RunSettings(file="good.npz", weight=1e4))
    bad = replace(record(4, noisy), run=RunSettings(file="bad.npz"))
    weights = get_run_weights([good, bad])
    apart, together, heeded = (
        identify_closed_loop("output-error", robot, library, logs, weights=how)
        for logs, how in (([bad], None), ([good, bad], None), ([good, bad], weights))
    )
    names = tuple(list_truth(library))
    errors = [max(find_errors(library, found.assemble(names))) for found in (apart, together, heeded)]
    assert errors[2] < 0.1 * errors[1]
    assert errors[1] < errors[0]
    assert heeded.settings["weights"] == [1e4, 1.0]
    assert len(heeded.settings["fit"]["controller"]["offset"]) == 2


def test_what_cannot_be_simulated_is_said(recording, loop, library):
    truth = list_truth(library)
    wrong = replace(loop, controller=replace(GAINS, stiffness=(-400.0, -60.0)))
    drives = {name: -value if name.startswith("Fv") else value for name, value in truth.items()}
    # A torque that no robot has is no result.
    names = ("time", "position", "reference", "reference_velocity", "torque")
    start = {name: getattr(recording, name)[:1000] for name in names}
    upside_down = replace(recording, **start | {"torque": -start["torque"]})
    for code, log, loops, values in (
        ("solver.runaway", recording, wrong, truth),
        ("solver.start", recording, loop, drives),
        ("solver.controlled-robot", upside_down, loop, truth),
    ):
        with raises(SolverError, code):
            fit_to(library, [log], [loops], values)
