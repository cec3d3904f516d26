"""Equations of elastic joints hold for simulated motions; closed forms of the bound with springs known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from symid.errors import UsageError
from symid.identification.elastic.options import ElasticOptions
from symid.identification.elastic.regression import (
    ElasticSignals,
    build_energy_windows,
    build_filtered_rows,
    prepare_elastic_signals,
)
from symid.identification.hysteresis import filter_smooth
from symid.joint_models.hysteresis import Stop
from symid.logs.signals import differentiate
from symid.study.elastic_methods import compute_elimination_bound, compute_spring_bound
from tests.recovery.elastic_runs import find_truth, run_arm
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
    run = run_arm(*arm, duration=2.0, period=5e-5)
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
    step = filter_smooth(np.ones((200, 1)), rate, period, held=True)[:, 0]
    assert np.allclose(step, 1.0 - np.exp(-rate * time), atol=1e-12)


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


SIGMA = np.array([0.2, 0.05])


@pytest.fixture(scope="module")
def whole(run):
    states = {name: getattr(run, name) for name in ("q", "dq", "theta", "dtheta")}
    time, period = run.recording.time, run.recording.period
    return ElasticSignals(time=time, **states, tau=run.torque, period=period, settled=0, hold="zero")


def test_the_scale_of_links_and_springs_is_all_that_exact_links_leave_open(arm, run, whole):
    """With it, rotors and friction: six numbers of the motor equations, a plain least-squares problem."""
    _, library = arm
    bound = compute_spring_bound(library, [whole], [SIGMA])
    truth, beta = find_truth(library), len(library.card.beta)
    (momentum,) = library.evaluate("momentum_regressor", run.q, run.dq)
    (lagrange,) = library.evaluate("lagrange_regressor", run.q, run.dq)
    load = (differentiate(momentum, whole.period) - lagrange) @ truth[:beta]
    rotor = differentiate(run.dtheta, whole.period)[:, :, None] * np.eye(2)
    (friction,) = library.evaluate("friction_regressor", run.dtheta)
    rows = np.concatenate([load[:, :, None], rotor, friction], axis=2) / SIGMA[:, None]
    rows = rows.reshape(-1, rows.shape[2])
    expected = np.linalg.inv(rows.T @ rows)
    known = np.abs(truth[:beta]) > 1e-9
    scale = np.sqrt(np.diag(bound)[:beta][known]) / np.abs(truth[:beta][known])
    np.testing.assert_allclose(scale, np.sqrt(expected[0, 0]), rtol=2e-2)
    deviations = np.sqrt(np.diag(bound)[beta:])
    np.testing.assert_allclose(deviations, np.sqrt(np.diag(expected)[1:]), rtol=2e-2)


def test_who_knows_the_form_can_do_better_and_noise_scales_the_bound(arm, run, whole):
    _, library = arm
    known, unknown = (
        find(library, [whole], [SIGMA]) for find in (compute_spring_bound, compute_elimination_bound)
    )
    assert np.all(np.diag(known) < np.diag(unknown))
    twice = compute_spring_bound(library, [whole], [2.0 * SIGMA])
    np.testing.assert_allclose(twice, 4.0 * known, rtol=1e-6, atol=1e-12 * np.abs(known).max())
    again = compute_spring_bound(library, [whole, whole], [SIGMA, SIGMA])
    np.testing.assert_allclose(again, known / 2.0, rtol=1e-5, atol=1e-9 * np.abs(known).max())
    # A far stop is one with k0, and nobody can tell them apart; links and friction do not care.
    stop = Stop(threshold=1.0, stiffness=10.0)
    far = tuple(
        replace(spring, stiffness=spring.stiffness - 10.0, stops=(*spring.stops, stop))
        for spring in library.card.elasticity
    )
    other = SimpleNamespace(card=replace(library.card, elasticity=far), evaluate=library.evaluate)
    more = compute_spring_bound(other, [whole], [SIGMA])
    np.testing.assert_allclose(np.diag(more), np.diag(known), rtol=1e-3, atol=1e-12)
