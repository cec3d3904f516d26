"""Validation, band and diagnosis process a log as the fit did, unless something else is stated."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from symid.errors import EstimateError
from symid.identification.estimators.least_squares import fit_ols
from symid.identification.judge import POLICY
from symid.identification.regression.equations import stack_rows
from symid.identification.regression.identifiability import analyse_identifiability
from symid.identification.regression.preparation import choose_filters, prepare_rows
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.validation import (
    diagnose_estimate,
    get_fit_overlap,
    get_fit_window,
    get_run_weights,
    read_fit_processing,
    resolve_processing,
    restore_robot,
    validate_estimate,
)
from symid.logs.recording import cut_recording
from symid.logs.signals import choose_processing
from symid.robot.description import Decimation, Processing
from symid.robot.loading import load_robot
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link
from tests.refusals import raises
from tests.unit.identification.rigid.two_link_logs import score

AUTOMATIC = Processing(automatic=True)
LIBRARY = build_two_link()


def record(noise, seed, samples=8001):
    clean = build_recording(LIBRARY, TWO_LINK_TRUTH, samples=samples, seed=seed, source=f"made {seed}")
    encoder, torque = np.random.default_rng(seed).normal(size=(2, *clean.torque.shape))
    return replace(clean, position=clean.position + noise * encoder, torque=clean.torque + torque)


@pytest.fixture(scope="module")
def noisy():
    """Return a log whose noise asks for more than the rule of the sample rate."""
    recording = record(1e-3, 1)
    chosen = choose_filters(AUTOMATIC, [recording]).processing
    usual = choose_processing(AUTOMATIC, recording.period)
    assert chosen.filter_cutoff < usual.filter_cutoff
    assert chosen.decimation.factor > usual.decimation.factor
    return recording


@pytest.fixture(scope="module")
def estimate(noisy):
    return identify_parameters(LIBRARY, [noisy], AUTOMATIC)


def test_the_estimate_says_what_was_chosen(noisy, estimate):
    assert estimate.settings["chosen"] == ["filter_cutoff", "decimation.factor", "standstill"]
    assert estimate.settings["sample_period"] == noisy.period
    used, taken = read_fit_processing(estimate.settings), estimate.choice.chosen
    assert used.left_open == ()
    # Decimation passes what lies within 0.4 of the rate of the rows.
    assert 0.4 / noisy.period / used.decimation.factor == pytest.approx(taken.band, rel=0.25)
    assert (used.instrument_cutoff is not None) == (taken.instruments > 0.0)
    assert (used.standstill is not None) == any(estimate.choice.standstill)
    stated = identify_parameters(LIBRARY, [noisy], used)
    assert "chosen" not in stated.settings
    assert stated.choice is None
    assert stated.estimator == estimate.estimator
    for one, other in zip(stated.parameters, estimate.parameters, strict=True):
        assert one.value == pytest.approx(other.value, rel=1e-9)


def test_a_validation_counts_rows_that_the_fit_leaves_out(noisy, estimate):
    """Slow rows, moving ends cut alike."""
    again = validate_estimate(estimate, LIBRARY, noisy, AUTOMATIC)
    assert again.samples == sum(entry.samples for entry in estimate.residual)
    stated = replace(AUTOMATIC, standstill=0.4)
    found = identify_parameters(LIBRARY, [noisy], stated)
    other = validate_estimate(found, LIBRARY, noisy, stated)
    assert other.samples == sum(entry.samples for entry in found.residual) > 1.05 * found.samples
    for mine, fitted, tolerance in ((again, estimate, 1e-12), (other, found, 1e-9)):
        for one, two in zip(mine.all_rows, fitted.residual, strict=True):
            assert one.norm == pytest.approx(two.norm, rel=tolerance)


def test_a_log_is_judged_within_the_band_that_the_settings_were_chosen_by(estimate):
    """Against a filter of SciPy's on the series; all rows stand beside."""
    log = record(1e-4, 5)
    found = validate_estimate(estimate, LIBRARY, log, AUTOMATIC)
    assert found.scoring == estimate.choice.scoring > 0.0
    for entry, rows, series in zip(found.residual, found.all_rows, found.series, strict=True):
        errors = series.measured - series.predicted
        (measured, inner), (left, _) = (
            score(values, series.time, found.scoring) for values in (series.measured, errors)
        )
        share = np.linalg.norm(left[inner]) / np.linalg.norm(measured[inner])
        assert entry.relative_percent == pytest.approx(100.0 * share, rel=1e-6)
        plain = np.linalg.norm(errors) / np.linalg.norm(series.measured)
        assert rows.relative_percent == pytest.approx(100.0 * plain, rel=1e-9)
        assert entry.relative_percent < rows.relative_percent
    # Long logs have no held-out stretches to compare with.
    assert validate_estimate(replace(estimate, evidence=None), LIBRARY, log, AUTOMATIC).scoring == 0.0
    # Settings that were stated are judged as they stand, those of the log too.
    rows = validate_estimate(estimate, LIBRARY, log, read_fit_processing(estimate.settings))
    assert (rows.scoring, rows.residual) == (0.0, found.all_rows)
    stated = replace(estimate, choice=None)
    again = validate_estimate(stated, LIBRARY, log, AUTOMATIC)
    assert (again.scoring, again.all_rows) == (0.0, ())
    assert again.residual == found.all_rows


def change_processing(estimate, **changes):
    """Return the estimate as if it had been fitted with these settings."""
    table = {**estimate.settings["processing"], **changes}
    return replace(estimate, settings={**estimate.settings, "processing": table})


def test_ends_instruments_and_velocities_are_those_of_the_fit(noisy, estimate):
    changes = {"instrument_cutoff": 3.0, "states": "velocity", "standstill": [0.1, 0.2]}
    fitted = change_processing(estimate, drop_first=30, drop_last=0, **changes)
    moving = replace(noisy, velocity=np.gradient(noisy.position, noisy.period, axis=0))
    found = resolve_processing(fitted, replace(AUTOMATIC, drop_first=10, drop_last=20), moving).processing
    assert (found.drop_first, found.drop_last) == (30, 20)
    assert (found.instrument_cutoff, found.states) == (3.0, "velocity")
    assert [found.get_standstill(joint) for joint in (0, 1)] == [0.1, 0.2]


def test_what_a_fit_chose_is_open_again_and_no_difference_to_the_robot_file(noisy, estimate):
    robot = replace(load_robot("two_link"), processing=AUTOMATIC)
    fitted = change_processing(estimate, instrument_cutoff=3.0, standstill=[0.1, 0.2])
    restored = restore_robot(robot, fitted)
    assert restored.processing.left_open == ("filter_cutoff", "decimation.factor", "standstill")
    assert not [entry for entry in restored.notices if entry.code == "estimate.settings-differ"]
    stated = change_processing(fitted, automatic=False)
    stated = replace(stated, settings={"processing": stated.settings["processing"]})
    assert restore_robot(robot, stated).processing.standstill == (0.1, 0.2)
    differ = [entry.text for entry in restore_robot(robot, stated).notices]
    assert any("processing.instrument_cutoff: 3.0 (file: " in text for text in differ)


def test_a_log_without_velocities_is_predicted_from_its_positions(noisy, estimate):
    fitted = change_processing(estimate, states="velocity")
    restored = restore_robot(replace(load_robot("two_link"), processing=AUTOMATIC), fitted).processing
    velocity = np.gradient(noisy.position, noisy.period, axis=0)
    with_rates = replace(noisy, velocity=velocity)
    assert resolve_processing(fitted, restored, with_rates).processing.states == "velocity"
    holes = velocity.copy()
    holes[3] = np.nan
    for log in (noisy, replace(noisy, velocity=holes)):
        assert resolve_processing(fitted, restored, log).processing.states == "position"
        assert validate_estimate(fitted, LIBRARY, log, restored).samples


def test_another_sample_period_is_chosen_from_the_log(noisy, estimate):
    slow = cut_recording(noisy, slice(None, None, 4))
    settled = resolve_processing(estimate, AUTOMATIC, slow)
    assert settled.processing == choose_filters(AUTOMATIC, [slow]).processing
    assert set(settled.origin.values()) == {"log"}
    assert f" {settled.processing.filter_cutoff:g} Hz; " in settled.describe()
    assert [notice.code for notice in settled.notices] == ["identify.automatic"]
    assert validate_estimate(estimate, LIBRARY, slow, AUTOMATIC).processing == settled
    # An estimate that does not say its period is not followed.
    settings = {key: entry for key, entry in estimate.settings.items() if key != "sample_period"}
    for told in ({}, {"sample_period": "1 ms"}, {"sample_period": -1.0}):
        silent = replace(estimate, settings={**settings, **told})
        assert set(resolve_processing(silent, AUTOMATIC, noisy).origin.values()) == {"log"}


@pytest.mark.parametrize("estimator", ["ols", "wls", "huber", "sequential"])
@pytest.mark.parametrize("rows", [{"rows": "torque"}, {"rows": "momentum", "window": 0.06, "overlap": 0.5}])
def test_a_diagnosis_makes_the_same_fit(noisy, estimator, rows):
    recordings = [noisy, record(1e-3, 3)]
    processing = replace(AUTOMATIC, drop_first=100, standstill=0.01, noise_freedom="one")
    found = identify_parameters(
        LIBRARY, recordings, processing, estimator=estimator, weights=(1.0, 0.25), **rows
    )
    diagnosis = diagnose_estimate(found, LIBRARY, recordings, processing)
    assert diagnosis.refit <= 1e-12
    assert not diagnosis.notices
    # Without one of the settings, it is another fit.
    for name in ("weights", *(rows.keys() & {"overlap", "window"})):
        settings = {key: value for key, value in found.settings.items() if key != name}
        other = diagnose_estimate(replace(found, settings=settings), LIBRARY, recordings, processing)
        assert other.refit > 1e-3
        assert [notice.code for notice in other.notices] == ["diagnosis.other-values"]


def find_held(recordings, weights, judged, fitted):
    """Return what fits to all stretches but one leave of decimated rows of that one, ols, in memory."""
    rows, other = (
        stack_rows([prepare_rows("torque", LIBRARY, entry, how, window=0.1) for entry in recordings], weights)
        for how in (judged, fitted)
    )

    def number(some):
        found = np.empty(len(some.values), dtype=int)
        for group in (0, 1):
            parts = np.array_split(np.flatnonzero(some.group == group), POLICY.folds * POLICY.parts)
            for block, part in enumerate(parts):
                found[part] = block // POLICY.parts
        return found

    left = 0.0
    for fold in range(POLICY.folds):
        train, held = number(other) != fold, number(rows) == fold
        root = np.sqrt(other.weight[train])
        values = np.linalg.lstsq(other.matrix[train] * root[:, None], other.values[train] * root)[0]
        error = (rows.values[held] - rows.matrix[held] @ values) * np.sqrt(rows.weight[held])
        left += error @ error
    return np.sqrt(left)


@pytest.mark.parametrize("freedom", ["band", "parameters", "one"])
def test_the_price_of_decimation_is_that_of_deviations_for_white_noise(noisy, freedom):
    """The oracle: the same fit to every sample, in memory."""
    recordings, weights = [noisy, record(1e-3, 3)], (1.0, 0.25)
    processing = replace(AUTOMATIC, standstill=0.0, noise_freedom=freedom)
    some = identify_parameters(LIBRARY, recordings, processing, estimator="ols", weights=weights)
    *_, held, price = diagnose_estimate(some, LIBRARY, recordings, processing).prices
    assert "standard deviation (for white noise)" in price.of
    fitted = read_fit_processing(some.settings)
    assert price.what.endswith(f" {fitted.decimation.factor}")
    every = replace(fitted, decimation=Decimation())
    deviations = []
    for how in (fitted, every):
        rows = [prepare_rows("torque", LIBRARY, entry, how, window=0.1) for entry in recordings]
        whole = stack_rows(rows, weights)
        fit = fit_ols(whole, analyse_identifiability(whole), freedom)
        deviations.append(np.sqrt(np.diag(fit.covariance)))
    ratio = np.median(deviations[0] / deviations[1])
    assert price.percent == pytest.approx(100.0 * (ratio - 1.0), rel=1e-6)
    assert "held-out" in held.of
    left = [find_held(recordings, weights, fitted, entry) for entry in (fitted, every)]
    assert held.percent == pytest.approx(100.0 * (left[0] / left[1] - 1.0), abs=1e-5)


def test_weights_of_logs_count_in_the_structure_of_the_residual():
    """A second log with a spring that the first has not: of no weight, it is not heard."""
    clean, other = record(0.0, 4), record(0.0, 5)
    spring = np.column_stack([np.zeros(len(other.time)), 30.0 * other.position[:, 1]])
    bent = replace(other, torque=other.torque + spring)
    estimate = identify_parameters(LIBRARY, [clean], AUTOMATIC)
    found = []
    for weights in ((1.0, 1.0), (1.0, 1e-6)):
        weighed = replace(estimate, settings={**estimate.settings, "weights": list(weights)})
        diagnosis = diagnose_estimate(weighed, LIBRARY, [clean, bent], AUTOMATIC)
        found.append({(entry.joint, entry.family) for entry in diagnosis.structure})
    assert any(joint == "joint2" for joint, _ in found[0])
    assert not any(joint == "joint2" for joint, _ in found[1])
    # An estimator that needs more is not fitted again.
    whole = identify_parameters(LIBRARY, [other], AUTOMATIC, estimator="gls")
    assert diagnose_estimate(whole, LIBRARY, [other], AUTOMATIC).refit is None


def get_weights(settings):
    return get_run_weights(settings, 2)


@pytest.mark.parametrize(
    ("read", "settings"),
    [
        *((get_fit_window, {"window": entry}) for entry in (0, "x")),
        *((get_fit_overlap, {"overlap": entry}) for entry in (1.0, True)),
        *((get_weights, {"weights": entry}) for entry in ([1.0], [1.0, -1.0], 3)),
        (read_fit_processing, {}),
        (read_fit_processing, {"processing": 3}),
        (read_fit_processing, {"processing": {**asdict(Processing()), "strange": 1}}),
        *((read_fit_processing, {"processing": {"filter_cutoff": entry}}) for entry in ("80", [80], -80)),
        *((read_fit_processing, {"processing": {"decimation": {"factor": k}}}) for k in ("3", -3, 2.5)),
    ],
)
def test_settings_that_cannot_be_read_are_refused(read, settings):
    words = r"'(processing|filter_cutoff|decimation\.factor|window|overlap|weights)'"
    with raises(EstimateError, "estimate.settings", match=words):
        read(settings)
    # Those that say nothing have defaults.
    assert (get_fit_window({}), get_fit_overlap({}), get_weights({})) == (0.1, 0.0, None)
    assert get_weights({"weights": [2, 0.5]}) == (2.0, 0.5)
