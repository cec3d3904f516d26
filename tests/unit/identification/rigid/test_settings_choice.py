"""Band, instruments and standstill that are chosen: on logs whose truth, noise and stops are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from symid.errors import IdentifiabilityError, UsageError
from symid.identification import judge
from symid.identification.regression import mask_fast, prepare_rows
from symid.identification.rigid import settings_choice
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.settings_choice import choose_settings
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH
from tests.refusals import raises
from tests.unit.identification.rigid.two_link_logs import LIBRARY, NAMES, record, record_sticking

AUTOMATIC = Processing(automatic=True)
WIDE = replace(AUTOMATIC, decimation=Decimation(factor=3))
"""Rows at 83 Hz, which keep 33 Hz."""
FRICTION = slice(6, 12)


def choose(*logs, processing=AUTOMATIC, **options):
    return choose_settings(LIBRARY, logs, processing, **options)


def assemble(estimate):
    """Return values and deviations (p,)."""
    found = {entry.name: (entry.value, entry.std) for entry in estimate.parameters}
    return np.array([found[name] for name in NAMES]).T


@pytest.mark.parametrize("seed", [0, 1])
def test_a_clean_log_is_fitted_with_nearly_all_its_rows(seed):
    estimate = identify_parameters(LIBRARY, [record(seed)], AUTOMATIC)
    choice = estimate.choice
    # Rows reach up to a tenth of the sample rate at most.
    assert 0.0 < choice.scoring <= choice.chosen.band <= 25.0
    assert choice.chosen.held_out < 1.0
    values, deviations = assemble(estimate)
    assert np.sqrt(np.mean(((values - TWO_LINK_TRUTH) / deviations) ** 2)) < 2.0
    np.testing.assert_allclose(values, TWO_LINK_TRUTH, rtol=0.03, atol=0.02)
    # What follows: two and a half rows a period of the band, and what was open is filled in.
    processing = estimate.settings["processing"]
    assert 0.4 * 250.0 / processing["decimation"]["factor"] == pytest.approx(choice.chosen.band, rel=0.25)
    assert (processing["standstill"] is None) == (not any(choice.standstill))
    assert (processing["instrument_cutoff"] or 0.0) == pytest.approx(choice.chosen.instruments, rel=0.01)
    assert (estimate.estimator == "wls") == (choice.chosen.instruments == 0.0)
    assert estimate.settings["chosen"] == ["filter_cutoff", "decimation.factor", "standstill"]
    for entry, speed in zip(estimate.evidence.joints, choice.standstill, strict=True):
        assert (entry.share > 0.0) == (speed > 0.0)
        assert entry.share < 0.3


@pytest.mark.parametrize(("seed", "encoder"), [(0, 1e-4), (1, 2e-4)])
def test_noise_of_positions_is_met_with_instruments(seed, encoder):
    """Least squares of the same rows and positions shrinks the inertias by a tenth or more."""
    log = record(seed, encoder=encoder)
    usual = identify_parameters(LIBRARY, [log], replace(WIDE, filter_cutoff=80.0), estimator="ols")
    estimate = identify_parameters(LIBRARY, [log], WIDE)
    assert estimate.estimator == "filtered-instrumental"
    assert estimate.choice.chosen.instruments > 0.0
    assert estimate.choice.chosen.band == usual.choice.chosen.band == pytest.approx(33.3, rel=0.01)
    (values, deviations), (plain, _) = assemble(estimate), assemble(usual)
    # The inertia of the first link.
    assert plain[0] < 0.9 * TWO_LINK_TRUTH[0]
    assert values[0] == pytest.approx(TWO_LINK_TRUTH[0], rel=0.05)
    assert np.sqrt(np.mean(((values - TWO_LINK_TRUTH) / deviations) ** 2)) < 2.0


@pytest.mark.parametrize("seed", [0, 3])
def test_rows_at_which_joints_stick_are_left_out(seed):
    log, resting = record_sticking(seed)
    assert 0.2 < resting.mean() < 0.4
    estimate = identify_parameters(LIBRARY, [log], AUTOMATIC)
    stated = Processing(filter_cutoff=50.0, decimation=Decimation(factor=5), standstill=0.0)
    kept = identify_parameters(LIBRARY, [log], stated)
    truth = TWO_LINK_TRUTH[FRICTION]
    errors = [np.abs(assemble(found)[0][FRICTION] - truth).max() for found in (estimate, kept)]
    assert errors[0] < 0.03
    assert errors[1] > 3.0 * errors[0]
    assert {notice.code for notice in estimate.notices} >= {"identify.automatic", "identify.slow-rows"}
    lost = 1.0 - estimate.samples / sum(entry.samples for entry in estimate.residual)
    assert resting.mean() - 0.05 < lost < resting.mean() + 0.25


@pytest.mark.parametrize(("seed", "encoder"), [(0, 1e-6), (3, 3e-5)])
def test_another_scoring_band_makes_the_same_fit(monkeypatch, seed, encoder):
    measure, found = settings_choice.measure_scoring_band, []
    for factor in (0.5, 1.0, 2.0):
        with monkeypatch.context() as patch:
            patch.setattr(
                settings_choice, "measure_scoring_band", lambda logs, factor=factor: factor * measure(logs)
            )
            found.append(choose(record(seed, encoder=encoder)))
    for study in found:
        deviations = np.sqrt(np.sum(study.fit.changes**2, axis=0))
        assert np.sqrt(np.mean(((study.fit.values - TWO_LINK_TRUTH) / deviations) ** 2)) < 2.5


def test_what_is_stated_is_not_chosen():
    log = record(1, encoder=1e-4, samples=2501)
    assert choose(log).choice == choose(log).choice
    found = choose(log, processing=replace(AUTOMATIC, decimation=Decimation(factor=5))).choice
    assert {entry.band for entry in found.candidates} == {20.0}
    found = choose(log, instruments=(False,)).choice
    assert {entry.instruments for entry in found.candidates} == {0.0}
    found = choose(log, instruments=(True,)).choice
    assert min(entry.instruments for entry in found.candidates) > 0.0
    for speed in (0.05, 0.2):
        found = choose(log, processing=replace(AUTOMATIC, standstill=speed)).choice
        assert found.standstill == (speed, speed)
    found = choose(log, processing=replace(AUTOMATIC, filter_cutoff=30.0))
    assert found.cutoff == 30.0
    assert max(entry.band for entry in found.choice.candidates) <= 15.0
    moving = replace(log, velocity=np.gradient(log.position, log.period, axis=0))
    assert list_states(moving, processing=replace(AUTOMATIC, states="velocity")) == {"velocity"}


def list_states(log, **options):
    return {entry.states for entry in choose(log, **options).choice.candidates}


def test_logged_velocities_and_accelerations_are_taken_where_they_are_better():
    """A slow encoder, and a tachometer without noise; and the other way round."""
    log = record(0, encoder=3e-3, samples=2501)
    rate = np.gradient(record(0, encoder=0.0, samples=2501).position, log.period, axis=0)
    assert choose(replace(log, velocity=rate)).choice.chosen.states == "velocity"
    scatter = np.random.default_rng(1).normal(size=rate.shape)
    clean = record(0, samples=2501)
    assert choose(replace(clean, velocity=rate + 0.3 * scatter)).choice.chosen.states == "position"
    change = np.gradient(rate, log.period, axis=0)
    found = choose(replace(log, velocity=rate + 0.2 * scatter, acceleration=change)).choice
    assert {entry.states for entry in found.candidates} == {"position", "velocity", "acceleration"}
    # Holes leave no choice.
    holes, rates = change.copy(), rate.copy()
    holes[100], rates[7] = np.nan, np.nan
    assert list_states(replace(log, acceleration=holes)) == {"position"}
    # Accelerations go with the velocities of the log, if it has some.
    assert list_states(replace(log, velocity=rates, acceleration=change)) == {"position"}
    assert list_states(replace(log, acceleration=change)) == {"position", "acceleration"}


def test_instruments_without_a_cutoff_are_refused():
    settled = Processing(filter_cutoff=40.0, standstill=0.0, decimation=Decimation(factor=3))
    with raises(UsageError, "usage.no-instruments", match=r"set processing\.instrument_cutoff"):
        identify_parameters(LIBRARY, [record(0)], settled, estimator="filtered-instrumental")
    stated = replace(settled, instrument_cutoff=3.0)
    estimate = identify_parameters(LIBRARY, [record(0)], stated, estimator="filtered-instrumental")
    assert estimate.choice is None
    # All samples would be 1.04 MB of rows, those at 125 Hz are half of it: not too much for instruments.
    estimate = identify_parameters(LIBRARY, [record(1, encoder=1e-3)], AUTOMATIC, largest=8e5)
    assert max(entry.instruments for entry in estimate.choice.candidates) > 0.0


@pytest.mark.parametrize("margin", [0.05, 0.3, 30.0])
def test_rows_beside_slow_ones_are_left_out_unless_they_are_most(margin):
    log, _ = record_sticking(0)
    settings = Processing(decimation=Decimation(factor=5), filter_cutoff=50.0, standstill=(0.02, 0.02))
    rows = prepare_rows("torque", LIBRARY, log, settings, window=0.1, every=True)
    bare, _ = mask_fast(rows, rows.velocity, settings)
    kept, notices = mask_fast(rows, rows.velocity, settings, margin=margin)
    assert not np.any(kept & ~bare)
    for joint in (0, 1):
        own = rows.group == joint
        slow = rows.time[own][~bare[own]]
        away = np.abs(rows.time[own][:, None] - slow).min(axis=1)
        assert np.sum(kept[own]) >= 0.5 * np.sum(bare[own])
        if margin < 1.0:
            # To the nearest row.
            step = np.median(np.diff(rows.time[own]))
            assert away[kept[own]].min() > margin - step / 2.0
            assert away[~kept[own]].max() < margin + step / 2.0 + 1e-9
        else:
            # As far as half of them allow.
            assert away[kept[own]].min() > 0.1
    assert all("or beside such samples" in notice.text for notice in notices)


def test_a_log_all_of_whose_rows_are_bad_leaves_nothing_to_fit():
    log = record(0)
    with pytest.raises(IdentifiabilityError, match="gives no equation"):
        identify_parameters(LIBRARY, [replace(log, bad=np.ones(log.position.shape, dtype=bool))], AUTOMATIC)


@pytest.mark.parametrize(("excess", "taken"), [(1.2, 1), (1.9, 1), (2.2, 0), (50.0, 0)])
def test_a_wider_band_may_predict_a_little_worse_and_not_many_times(excess, taken):
    """The residual is below two percent of the torque in all cases."""
    chance = np.random.default_rng(3)
    losses = 1e-6 * chance.uniform(0.9, 1.1, (12, 2))
    # Parameters are the same: the wide band is consistent.
    fits = [SimpleNamespace(values=np.ones(2), changes=1e-3 * chance.standard_normal((12, 2))) for _ in "ab"]
    fits[1].values = fits[0].values
    trials = [
        settings_choice.BandTrial(level, level, fit, size * losses)
        for level, fit, size in zip((1, 2), fits, (1.0, excess), strict=True)
    ]
    logs = SimpleNamespace(
        torque=np.ones(2), bands=(1.0, 2.0, 4.0), list_grams=lambda: np.stack([np.eye(2)] * 2)
    )
    place, found = settings_choice._choose_trial(logs, trials, "position")
    assert place == taken
    assert found[1].held_out < 2.0
    assert found[1].fall == pytest.approx(excess)
    assert found[1].p < judge.POLICY.caution
