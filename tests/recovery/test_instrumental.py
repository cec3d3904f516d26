"""Instruments from the simulated robot: wls where states are exact, the truth where they are noisy."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.estimators.least_squares import fit_wls
from symid.identification.regression.identifiability import analyse_identifiability
from symid.identification.regression.preparation import prepare_rows
from symid.identification.rigid.closed_loop import (
    ClosedLoopProblem,
    build_closed_loop,
    estimate_start,
    fit_instrumental,
    identify_closed_loop,
    simulate_closed_loop,
)
from symid.identification.rigid.fit import identify_parameters
from symid.robot.description import Decimation, Processing
from tests.recovery.rigid_runs import GAINS, list_truth, run_fourier

PROCESSING = Processing(filter_cutoff=60.0, drop_first=250, drop_last=10, decimation=Decimation(factor=5))
LATE = replace(PROCESSING, standstill=0.05)
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
    """Return what a run logs without noise, by the seed of its motion."""
    return lambda seed: run_fourier(robot, library, seed, controller=GAINS, period=2e-3).recording


@pytest.fixture(scope="module")
def recording(record):
    return record(3)


@pytest.fixture(scope="module")
def trials(robot, library, recording):
    """Return estimates by instruments and by wls of logs that differ in their noise alone."""
    logs = [spoil(recording, seed) for seed in range(SEEDS)]
    found = [identify_closed_loop("instrumental", robot, library, [log]) for log in logs]
    usual = [identify_parameters(library, [log], LATE, estimator="wls") for log in logs]
    return found, usual


def pose(library, recording, loop, processing):
    return ClosedLoopProblem(library=library, recordings=[recording], loops=[loop], processing=processing)


def spoil(recording, seed, encoder=ENCODER):
    rng = np.random.default_rng(seed)
    shape = recording.position.shape
    return replace(
        recording,
        position=recording.position + encoder * rng.normal(size=shape),
        torque=recording.torque + TORQUE * rng.normal(size=shape),
    )


def find_errors(library, estimates):
    """Return errors (trials, p) in the standard deviations that each estimate states."""
    truth = list_truth(library)
    expected = np.array(list(truth.values()))
    values = np.array([entry.assemble(tuple(truth)) for entry in estimates])
    return (values - expected) / [[found.std for found in entry.parameters] for entry in estimates]


def test_where_states_are_exact_it_is_wls(recording, library):
    """A log of the very states that are simulated; its torque differs by what wls does not see."""
    truth = list_truth(library)
    values = np.array(list(truth.values()))
    loop = build_closed_loop(recording, GAINS, FREE)
    processing = replace(PROCESSING, drop_first=400, decimation=Decimation())
    log = replace(recording, position=simulate_closed_loop(library, values, recording, loop).q)
    rows = prepare_rows("torque", library, log, processing, window=0.1)
    rng = np.random.default_rng(0)
    torque = log.torque.copy()
    for joint in (0, 1):
        matrix = rows.matrix[rows.group == joint]
        noise = rng.normal(size=len(matrix))
        noise -= matrix @ np.linalg.lstsq(matrix, noise, rcond=None)[0]
        torque[processing.drop_first : -processing.drop_last, joint] = matrix @ values + noise
    log = replace(log, torque=torque)
    found = fit_instrumental(pose(library, log, loop, processing), truth)
    rows = prepare_rows("torque", library, log, processing, window=0.1)
    usual = fit_wls(rows, analyse_identifiability(rows))
    assert len(found.changes) == 1
    np.testing.assert_allclose(found.fit.values, usual.values, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.fit.covariance, usual.covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(usual.values, values, rtol=1e-8, atol=1e-10)
    np.testing.assert_array_equal(found.simulated.matrix, found.rows.matrix)


def measure_bias(errors):
    """Return mean errors (p,), and the same in standard deviations of a mean, as the errors scatter."""
    mean, scatter = errors.mean(axis=0), errors.std(axis=0, ddof=1)
    return mean, np.abs(mean) / (scatter / np.sqrt(len(errors)))


def test_noise_of_encoders_biases_wls_and_not_this(trials, library):
    found, usual = (measure_bias(find_errors(library, entries)) for entries in trials)
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
    sizes = np.abs(find_errors(library, trials[0]))
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
    assert np.all(np.abs(find_errors(library, [estimate])) < 4.0)


def test_noise_that_leaves_wls_no_robot_is_no_hindrance(robot, library, recording):
    """With five times that noise the inertia that wls finds is negative: it cannot be simulated."""
    log = spoil(recording, 0, encoder=5e-4)
    usual = identify_parameters(library, [log], LATE, estimator="wls")
    assert any("mass matrix is not positive definite" in text for text in usual.evidence.impossible)
    estimate = identify_closed_loop("instrumental", robot, library, [log])
    assert np.all(np.abs(find_errors(library, [estimate])) < 3.0)
    inertia = {entry.name: entry for entry in estimate.parameters}["ZZ2"]
    assert inertia.value == pytest.approx(inertia.truth, rel=0.15)
    # From wls as the only start it is told in words; see the tests of output error.
    assert estimate_start(pose(library, log, build_closed_loop(log, GAINS, FREE), LATE)) is not None
    # References that stand still are no start.
    still = replace(recording, reference=np.zeros_like(recording.reference), reference_velocity=None)
    assert estimate_start(pose(library, still, build_closed_loop(still, GAINS, FREE), LATE)) is None


def test_wrong_gains_cost_precision_and_not_truth(robot, library, recording):
    """A controller half as stiff: other states, of which the measured ones are still a part."""
    soft = replace(GAINS, stiffness=(200.0, 30.0), damping=(12.0, 1.5))
    log = spoil(recording, 2)
    right = identify_closed_loop("instrumental", robot, library, [log])
    wrong = identify_closed_loop("instrumental", replace(robot, controller=soft), library, [log])
    assert [notice.code for notice in wrong.notices].count("identify.tracking") == 1
    assert np.all(np.abs(find_errors(library, [wrong])) < 3.0)
    assert wrong.settings["fit"]["instruments"]["strength"] < right.settings["fit"]["instruments"]["strength"]
    pairs = zip(wrong.parameters, right.parameters, strict=True)
    assert all(one.std > other.std for one, other in pairs)
