"""The equations of elastic joints hold for simulated motions with the true parameters."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import UsageError
from symid.identification.elastic.options import ElasticOptions
from symid.identification.elastic.regression import (
    build_energy_windows,
    build_filtered_rows,
    filter_held,
    prepare_elastic_signals,
)
from symid.identification.hysteresis import filter_smooth
from tests.recovery.elastic_runs import STOPS, find_truth, run_arm
from tests.refusals import raises


@pytest.fixture(scope="module")
def run(arm):
    return run_arm(*arm, duration=5.0)


def prepare_exact(run, **options):
    """Return the signals of a clean run with the velocities as they were, not differentiated."""
    prepared = prepare_elastic_signals(run.recording, ElasticOptions(**options))
    count = len(prepared.time)
    return replace(prepared, dq=run.dq[:count], dtheta=run.dtheta[:count])


@pytest.fixture(scope="module")
def signals(run):
    return prepare_exact(run)


def test_energy_balance_closes_with_the_true_parameters(arm, signals):
    library = arm[1]
    rows = build_energy_windows(library, signals, 0.1)
    taken = rows.compute_work(library.card.elasticity, signals)
    gap = rows.supplied - taken - rows.design @ find_truth(library)
    assert np.abs(rows.supplied).max() > 1.0
    assert np.abs(gap).max() < 1e-6


def test_filtered_equations_give_the_true_joint_torque(arm):
    library = arm[1]
    run = run_arm(*arm, duration=2.0, period=5e-5, step=5e-5)
    signals = prepare_exact(run, cutoff=0.0)
    truth = find_truth(library)
    rows = build_filtered_rows(library, signals, 60.0)
    true = filter_smooth(run.joint_torque[: len(signals.time)], 60.0, signals.period)[rows.keep]
    size = np.sqrt(np.mean(true**2, axis=0))
    for side in (rows.compute_motor_side, rows.compute_link_side):
        assert np.all(np.sqrt(np.mean((side(truth) - true) ** 2, axis=0)) < 8e-7 * size), side
    assert np.allclose(rows.design @ truth, rows.torque, atol=1e-5 * np.abs(rows.torque).max())


@pytest.mark.parametrize("rate", [5.0, 60.0, 400.0])
def test_filters_are_exact_for_the_signals_that_they_assume(rate):
    # Of a ramp from rest F gives t - (1 - exp(-rate t)) / rate; of a step 1 - exp(-rate t).
    period = 1e-2
    time = np.arange(200) * period
    ramp = filter_smooth(time[:, None], rate, period)[:, 0]
    assert np.allclose(ramp, time - (1.0 - np.exp(-rate * time)) / rate, atol=1e-12)
    step = filter_held(np.ones((200, 1)), rate, period)[:, 0]
    assert np.allclose(step, 1.0 - np.exp(-rate * time), atol=1e-12)


def test_a_slower_replay_changes_what_inertias_do_and_not_what_springs_do(arm, signals):
    library = arm[1]
    slow = replace(
        signals,
        time=2.0 * signals.time,
        dq=signals.dq / 2.0,
        dtheta=signals.dtheta / 2.0,
        period=2.0 * signals.period,
    )
    rows, replay = build_energy_windows(library, signals, 0.1), build_energy_windows(library, slow, 0.2)
    grids = [np.array(grid) for grid in STOPS]
    once, twice = rows.compute_columns(grids, signals), replay.compute_columns(grids, slow)
    assert all(map(np.array_equal, once, twice))
    names = [entry.name for entry in library.card.beta]
    for column in (names.index("ZZ2"), len(names), len(names) + 1):
        assert np.allclose(rows.design[:, column], 4.0 * replay.design[:, column], atol=1e-12)
    weight = names.index("MXR1")
    assert np.allclose(rows.design[:, weight], replay.design[:, weight], atol=1e-9)


def test_windows_that_do_not_fit_are_refused(arm, signals):
    with raises(UsageError, "usage.window", match="100 s"):
        build_energy_windows(arm[1], signals, 100.0)


def test_noisy_encoders_ask_for_a_filter_and_clean_ones_do_not(arm, run):
    assert prepare_elastic_signals(run.recording, ElasticOptions()).hold == "zero"
    noisy = run_arm(*arm, duration=3.0, noisy=True)
    prepared = prepare_elastic_signals(noisy.recording, ElasticOptions())
    assert (prepared.hold, prepared.cutoff) == ("first", 25.0)
    # The delay of a held torque is gone: what is left is noise, not a shift by half a period.
    held = (noisy.torque[1:] + noisy.torque[:-1]) / 2.0
    middle = slice(500, len(prepared.time) - 100)
    error = prepared.tau[1:][middle] - held[: len(prepared.time) - 1][middle]
    assert np.all(np.abs(error.mean(axis=0)) < 0.01 * np.sqrt(np.mean(held**2, axis=0)))
    # Either encoder may be the position.
    turned = replace(run.recording, position=run.recording.motor_position, motor_position=None)
    turned = replace(turned, link_position=run.recording.position)
    first, second = (prepare_elastic_signals(part, ElasticOptions()) for part in (run.recording, turned))
    assert np.array_equal(first.phi, second.phi)


def test_a_torque_times_a_number_scales_the_right_sides_alone(arm, signals):
    found = [
        (build_energy_windows(arm[1], part, 0.1), build_filtered_rows(arm[1], part, 60.0))
        for part in (signals, replace(signals, tau=3.0 * signals.tau))
    ]
    (energy, torque), (tripled, thrice) = found
    assert np.array_equal(energy.design, tripled.design)
    assert np.array_equal(torque.design, thrice.design)
    assert np.allclose(3.0 * energy.supplied, tripled.supplied, rtol=1e-12, atol=1e-12)
    assert np.allclose(3.0 * torque.torque, thrice.torque, rtol=1e-12, atol=1e-12)
