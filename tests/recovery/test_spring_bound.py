"""The Cramer-Rao bound of who knows the form of the springs: closed forms, and what comes near it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from symid.identification.elastic.estimate import compute_elimination_bound, compute_spring_bound
from symid.identification.elastic.regression import ElasticSignals
from symid.joint_models.hysteresis import Stop
from symid.logs.signals import differentiate
from tests.recovery.elastic_runs import find_truth, run_arm

SIGMA = np.array([0.2, 0.05])
STATES = ("time", "q", "dq", "theta", "dtheta")


@pytest.fixture(scope="module")
def run(arm):
    return run_arm(*arm, duration=6.0)


@pytest.fixture(scope="module")
def signals(run):
    states = {name: getattr(run, name) for name in STATES}
    period = run.recording.period
    return ElasticSignals(**states, tau=run.torque, period=period, settled=0, hold="zero")


def test_the_scale_of_links_and_springs_is_all_that_exact_links_leave_open(arm, run, signals):
    """With it, rotors and friction: six numbers of the motor equations, a plain least-squares problem."""
    _, library = arm
    bound = compute_spring_bound(library, [signals], [SIGMA])
    truth, beta = find_truth(library), len(library.card.beta)
    (momentum,) = library.evaluate("momentum_regressor", run.q, run.dq)
    (lagrange,) = library.evaluate("lagrange_regressor", run.q, run.dq)
    load = (differentiate(momentum, signals.period) - lagrange) @ truth[:beta]
    rotor = differentiate(run.dtheta, signals.period)[:, :, None] * np.eye(2)
    (friction,) = library.evaluate("friction_regressor", run.dtheta)
    rows = np.concatenate([load[:, :, None], rotor, friction], axis=2) / SIGMA[:, None]
    rows = rows.reshape(-1, rows.shape[2])
    expected = np.linalg.inv(rows.T @ rows)
    known = np.abs(truth[:beta]) > 1e-9
    scale = np.sqrt(np.diag(bound)[:beta][known]) / np.abs(truth[:beta][known])
    np.testing.assert_allclose(scale, np.sqrt(expected[0, 0]), rtol=2e-2)
    deviations = np.sqrt(np.diag(bound)[beta:])
    np.testing.assert_allclose(deviations, np.sqrt(np.diag(expected)[1:]), rtol=2e-2)


def test_who_knows_the_form_can_do_better_and_noise_scales_the_bound(arm, run, signals):
    _, library = arm
    known, unknown = (
        find(library, [signals], [SIGMA]) for find in (compute_spring_bound, compute_elimination_bound)
    )
    assert np.all(np.diag(known) < np.diag(unknown))
    twice = compute_spring_bound(library, [signals], [2.0 * SIGMA])
    np.testing.assert_allclose(twice, 4.0 * known, rtol=1e-6, atol=1e-12 * np.abs(known).max())
    again = compute_spring_bound(library, [signals, signals], [SIGMA, SIGMA])
    np.testing.assert_allclose(again, known / 2.0, rtol=1e-5, atol=1e-9 * np.abs(known).max())
    # A far stop is one with k0, and nobody can tell them apart; links and friction do not care.
    stop = Stop(threshold=1.0, stiffness=10.0)
    far = tuple(
        replace(spring, stiffness=spring.stiffness - 10.0, stops=(*spring.stops, stop))
        for spring in library.card.elasticity
    )
    other = SimpleNamespace(card=replace(library.card, elasticity=far), evaluate=library.evaluate)
    more = compute_spring_bound(other, [signals], [SIGMA])
    np.testing.assert_allclose(np.diag(more), np.diag(known), rtol=1e-3, atol=1e-12)
