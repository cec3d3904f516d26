"""Closed loops: instruments and output error find the truth where noisy or coarse encoders mislead wls."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import SolverError
from symid.identification.rigid.closed_loop import (
    ClosedLoopProblem,
    build_closed_loop,
    estimate_start,
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

WHOLE = Processing(drop_first=250, drop_last=10, decimation=Decimation(factor=5))
LATE = replace(WHOLE, filter_cutoff=60.0, standstill=0.05)
"""Without the rows where the sign of the velocity is noise."""
FREE = np.full(2, np.inf)
SEEDS = 12
ENCODER, TORQUE = 1e-4, 0.05
"""Standard deviations of the noise, rad and N m."""


@pytest.fixture(scope="module")
def robot(two_link):
    return replace(two_link, processing=LATE, controller=GAINS)


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


@pytest.fixture(scope="module")
def trials(robot, library, recording):
    """Return estimates by instruments and by wls of logs that differ in their noise alone."""
    logs = [spoil(recording, seed) for seed in range(SEEDS)]
    found = [identify_closed_loop("instrumental", robot, library, [log]) for log in logs]
    usual = [identify_parameters(library, [log], LATE, estimator="wls") for log in logs]
    return found, usual


def pose(library, recordings, loops, processing):
    return ClosedLoopProblem(library=library, recordings=recordings, loops=loops, processing=processing)


def spoil(recording, seed, encoder=ENCODER):
    rng = np.random.default_rng(seed)
    shape = recording.position.shape
    return replace(
        recording,
        position=recording.position + encoder * rng.normal(size=shape),
        torque=recording.torque + TORQUE * rng.normal(size=shape),
    )


def find_scores(library, estimates):
    """Return errors (trials, p) in the standard deviations that each estimate states."""
    truth = list_truth(library)
    expected = np.array(list(truth.values()))
    values = np.array([entry.assemble(tuple(truth)) for entry in estimates])
    return (values - expected) / [[found.std for found in entry.parameters] for entry in estimates]


def measure_bias(errors):
    """Return mean errors (p,), and the same in standard deviations of a mean, as the errors scatter."""
    mean, scatter = errors.mean(axis=0), errors.std(axis=0, ddof=1)
    return mean, np.abs(mean) / (scatter / np.sqrt(len(errors)))


def test_noise_of_encoders_biases_wls_and_not_this(trials, library):
    found, usual = (measure_bias(find_scores(library, entries)) for entries in trials)
    inertia = [k for k, name in enumerate(list_truth(library)) if name.startswith("ZZ")]
    assert np.all(usual[1][inertia] > 20.0)
    # What errors that follow the motion add to stated deviations nearly covers the bias.
    assert np.all(np.abs(usual[0][inertia]) < 4.0)
    assert np.all(found[1] < 3.0)
    assert np.all(np.abs(found[0]) < 0.15)
    # The verdict names what wls got wrong.
    for estimate in trials[0]:
        told = estimate.settings["fit"]["wls"]
        assert told["biased"]
        assert told["probability"] < 1e-6
        assert {"ZZR1", "ZZ2"} <= {name for name, shift in told["shifts"].items() if shift < -3.0}
        (notice,) = (notice for notice in estimate.notices if notice.code == "identify.biased-wls")
        assert "ZZ2 -" in notice.text
        assert "processing.filter_cutoff" in notice.text
        assert estimate.settings["fit"]["start"] == "instruments along the references"
        assert estimate.settings["fit"]["iterations"] <= 8
    # Deviations cover. They are too large here: what is left is mostly noise of accelerations, whose low part
    # alone counts.
    sizes = np.abs(find_scores(library, trials[0]))
    assert np.mean(sizes < 1.0) > 0.95
    assert np.all(sizes < 3.0)


def test_a_filter_that_is_low_enough_is_called_so(robot, library, recording):
    """Rows that keep 7 Hz of the same log: wls is right, and is told to be."""
    calm = Processing(
        filter_cutoff=35.0, drop_first=250, drop_last=10, standstill=0.05, decimation=Decimation(factor=28)
    )
    estimate = identify_closed_loop(
        "instrumental", replace(robot, processing=calm), library, [spoil(recording, 1)]
    )
    told = estimate.settings["fit"]["wls"]
    assert not told["biased"]
    assert "identify.biased-wls" not in {notice.code for notice in estimate.notices}
    assert max(abs(shift) for shift in told["shifts"].values()) < 1.0
    assert np.all(np.abs(find_scores(library, [estimate])) < 4.0)


def test_noise_that_leaves_wls_no_robot_is_no_hindrance(robot, library, recording):
    """With five times that noise the inertia that wls finds is negative: it cannot be simulated."""
    log = spoil(recording, 0, encoder=5e-4)
    usual = identify_parameters(library, [log], LATE, estimator="wls")
    assert any("mass matrix is not positive definite" in text for text in usual.evidence.impossible)
    estimate = identify_closed_loop("instrumental", robot, library, [log])
    assert np.all(np.abs(find_scores(library, [estimate])) < 3.0)
    inertia = {entry.name: entry for entry in estimate.parameters}["ZZ2"]
    assert inertia.value == pytest.approx(inertia.truth, rel=0.15)
    # From wls as the only start it is told in words; see below.
    assert estimate_start(pose(library, [log], [build_closed_loop(log, GAINS, FREE)], LATE)) is not None
    # References that stand still are no start.
    still = replace(recording, reference=np.zeros_like(recording.reference), reference_velocity=None)
    assert estimate_start(pose(library, [still], [build_closed_loop(still, GAINS, FREE)], LATE)) is None


def test_wrong_gains_cost_precision_and_not_truth(robot, library, recording):
    """A controller half as stiff: other states, of which the measured ones are still a part."""
    soft = replace(GAINS, stiffness=(200.0, 30.0), damping=(12.0, 1.5))
    log = spoil(recording, 2)
    right = identify_closed_loop("instrumental", robot, library, [log])
    wrong = identify_closed_loop("instrumental", replace(robot, controller=soft), library, [log])
    assert [notice.code for notice in wrong.notices].count("identify.tracking") == 1
    assert np.all(np.abs(find_scores(library, [wrong])) < 3.0)
    assert wrong.settings["fit"]["instruments"]["strength"] < right.settings["fit"]["instruments"]["strength"]
    pairs = zip(wrong.parameters, right.parameters, strict=True)
    assert all(one.std > other.std for one, other in pairs)


def fit_to(library, recordings, loops, start):
    return fit_output_error(pose(library, recordings, loops, WHOLE), start)


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
    estimate = identify_parameters(library, [coarse], replace(WHOLE, filter_cutoff=100.0))
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
    plain = replace(robot, processing=WHOLE)
    apart, together, heeded = (
        identify_closed_loop("output-error", plain, library, logs, weights=how)
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
