"""How sure results of elastic joints are said to be: noise, widened deviations, contradictions, evidence."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from symid.identification.elastic.elimination import BandRows, measure_torque_noise
from symid.identification.elastic.estimate import MethodFit
from symid.identification.elastic.methods import (
    FOLDS,
    MethodCandidate,
    _add_model_error,
    _measure_disagreement,
    _widen,
    assign_folds,
    choose_candidate,
    find_contradiction,
)
from symid.identification.elastic.regression import DriveEffect
from symid.logs import Recording, low_pass

PERIOD = 1e-3
SIGMA = np.array([0.01, 0.02, 0.05])


def build_work(share=0.0, effects=()):
    """Two base parameters and a rotor of one joint, identified without springs as 2, 1 and 0.5."""
    rows = BandRows(
        design=np.eye(3),
        torque=np.array([2.0, 1.0, 0.5]),
        group=np.zeros(3, dtype=np.intp),
        time=np.linspace(0.0, 1.0, 3),
        slide=np.zeros(3, dtype=np.intp),
    )
    beta = [SimpleNamespace(joint="a", unit="kg m")] * 2
    card = SimpleNamespace(beta=beta, joints=[SimpleNamespace(name="a")])
    return SimpleNamespace(
        rows=rows,
        band=SimpleNamespace(chi=np.array([2.0, 1.0, 0.5]), covariance=np.diag(SIGMA**2)),
        identifiable=np.ones(3, dtype=bool),
        problem=SimpleNamespace(sizes=(2, 1), library=SimpleNamespace(card=card), known=np.full(3, np.nan)),
        share=share,
        effects=effects,
    )


def build_fit(chi, covariance):
    chi = np.asarray(chi)
    return MethodFit(
        method="nlp", beta=chi[:2], rotor=chi[2:], friction=np.zeros(0), covariance=np.asarray(covariance)
    )


def test_noise_is_that_which_the_band_of_the_rows_lets_through():
    # A band of 20 Hz; the oracle is the filter itself.
    rng = np.random.default_rng(5)
    time = np.arange(60000) * PERIOD
    noise = np.array([0.3, 2.0]) * rng.standard_normal((len(time), 2))
    motion = 50.0 * np.sin(2.0 * np.pi * np.array([0.7, 3.1]) * time[:, None])
    resonance = 0.5 * np.sin(2.0 * np.pi * 90.0 * time)[:, None]
    # Friction changes its sign with the motion: its harmonics reach far above the band.
    friction = 5.0 * np.sign(np.cos(2.0 * np.pi * 3.1 * time))[:, None]
    tau = motion + resonance + friction + noise
    found = measure_torque_noise([Recording(time=time, position=np.zeros_like(tau), torque=tau)])
    expected = np.std(low_pass(noise, period=PERIOD, cutoff=20.0, order=4), axis=0)
    assert found == pytest.approx(expected, rel=0.15)


def test_deviations_grow_with_the_distance_from_what_needs_no_springs():
    work, raw = build_work(), np.diag([1e-6, 4e-6, 9e-6])
    near = build_fit([2.001, 1.0, 0.5], raw)
    assert np.array_equal(_widen(work, near).covariance, raw)
    # Three deviations in every parameter: chi^2 = 27, nine a parameter.
    together = np.sqrt(SIGMA**2 + np.diag(raw))
    far = build_fit(np.array([2.0, 1.0, 0.5]) + 3.0 * together, raw)
    assert _measure_disagreement(work, far) == (pytest.approx(27.0), 3)
    wide = _widen(work, far)
    assert wide.covariance == pytest.approx(9.0 * raw)
    # Deviations that a contradiction widened do not make it less of one.
    assert _measure_disagreement(work, wide) == _measure_disagreement(work, far)


def test_a_fit_that_says_how_far_it_may_be_off_contradicts_nothing():
    work = build_work()
    fit = build_fit(np.array([2.0, 1.0, 0.5]) + 6.0 * SIGMA, np.diag((6.0 * SIGMA) ** 2))
    assert find_contradiction(work, fit)[0] == ""
    assert np.array_equal(_widen(work, fit).covariance, fit.covariance)
    # What a fit does not identify cannot contradict.
    blind = build_fit([9.0, 1.0, 0.5], np.diag([np.inf, 1e-6, 1e-6]))
    assert find_contradiction(work, blind)[0] == ""
    # Nor what is no matter: a thousandth is far beyond these deviations.
    small = 1e-12 * np.eye(3)
    work.band = SimpleNamespace(chi=work.band.chi, covariance=small)
    assert find_contradiction(work, build_fit([2.001, 1.0, 0.5], small))[0] == ""
    text, ratio = find_contradiction(work, build_fit([2.1, 1.0, 0.5], small))
    assert "contradict" in text
    assert ratio > 5.0


def test_no_parameter_is_surer_than_the_states_that_its_column_is_made_of():
    raw = np.diag([1e-12, 1e-12, 1e-12])
    fit = build_fit([2.0, 0.01, 0.5], raw)
    plain, sticking = (
        np.sqrt(np.diag(_add_model_error(build_work(share), fit).covariance)) for share in (0.0, 0.2)
    )
    # The second is of the first one's kind: it gets a part of that one's size, whatever its own.
    own, largest = np.array([2.0, 0.01, 0.5]), np.array([2.0, 2.0, 0.5])
    assert plain == pytest.approx(np.hypot(1e-4 * own, 3.5e-5 * largest), rel=1e-3)
    assert sticking == pytest.approx(np.hypot((1e-4 + 2.2e-3 * 0.2**2) * own, 3.5e-5 * largest), rel=1e-3)
    sizes = {"values": (0.1, 0.0), "deviations": (0.01, 0.01)}
    rippled = build_work(effects=(DriveEffect(kind="torque-ripple", joint=0, order=100.0, **sizes),))
    for work, method, size in ((rippled, "weighted", 2e-4), (build_work(), "simultaneous", 5e-4)):
        found = np.sqrt(np.diag(_add_model_error(work, replace(fit, method=method)).covariance))
        assert found == pytest.approx(size * np.hypot(own, largest), rel=1e-3)


def test_a_biased_method_is_not_taken_and_among_equals_the_surest_is():
    """However sure the biased one says it is; each fold is predicted by a fit without it."""
    rng, truth = np.random.default_rng(3), np.array([2.0, -1.0])
    design, time = rng.normal(size=(4000, 2)), np.tile(np.arange(2000) / 2000.0, 2)
    rows = BandRows(
        design=design,
        torque=design @ truth + 0.5 * rng.normal(size=4000),
        group=np.repeat([0, 1], 2000),
        time=time,
        slide=np.zeros(4000, dtype=np.intp),
    )

    def choose(*fits):
        asked = []
        candidates = [
            MethodCandidate(lambda fold, chi=chi: asked.append(fold) or np.array(chi), spread)
            for chi, spread in fits
        ]
        found = choose_candidate(candidates, rows, np.array([0.5, 0.5]))
        assert asked == [*range(FOLDS)] * len(fits)
        return found

    best, errors, close = choose(([2.2, -1.0], 1e-6), (truth, 0.1))
    assert (best, close) == (1, 1)
    assert errors[1] == pytest.approx(1.0, abs=0.1)
    assert errors[0] - errors[1] == pytest.approx(0.04 / 0.25, rel=0.3)
    best, _, close = choose((truth, 0.1), (truth + 1e-3, 0.01))
    assert (best, close) == (1, 2)
    assert np.bincount(assign_folds(time)).tolist() == [1000] * FOLDS
