"""Cut-off and decimation follow from the noise of the positions; known payloads are taken off."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import LogError
from symid.identification.judge import POLICY
from symid.identification.regression.preparation import (
    choose_filters,
    choose_window,
    compute_payload_torque,
    measure_bands,
)
from symid.identification.rigid.fit import identify_parameters
from symid.logs.recording import Recording, RunSettings, cut_recording
from symid.logs.signals import choose_processing
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_signals, build_two_link
from tests.refusals import raises

AUTOMATIC = Processing(automatic=True)


def record(noise=0.0, seed=0, samples=20001):
    clean = build_recording(build_two_link(), TWO_LINK_TRUTH, samples=samples, seed=seed, source="made")
    spoilt = np.random.default_rng(seed).normal(size=clean.position.shape) * noise
    return replace(clean, position=clean.position + spoilt)


def test_clean_bands_end_where_noise_matters_beside_the_acceleration():
    """Known spectra: one sine of 1 Hz and amplitude a, white noise of deviation s at rate 1 / T."""
    samples, step, size, noise = 40001, 1e-3, 0.3, 1e-4
    time = step * np.arange(samples)
    spoilt = size * np.sin(2.0 * np.pi * time) + noise * np.random.default_rng(0).normal(size=samples)
    position = np.column_stack([spoilt, spoilt])
    (band, _) = measure_bands(Recording(time=time, position=position, torque=position))
    density = 2.0 * step * noise**2
    motion = size**2 / 2.0 * (2.0 * np.pi) ** 4
    expected = (POLICY.relevance * motion * 5.0 / density / (2.0 * np.pi) ** 4) ** 0.2
    assert band.clean == pytest.approx(expected, rel=0.15)
    for band in measure_bands(record(2e-4)):
        assert band.floor == pytest.approx(2e-4 * np.sqrt(2e-3), rel=0.05)


def test_clean_logs_keep_the_rule_of_the_sample_rate_and_noisy_ones_less():
    choice, usual = choose_filters(AUTOMATIC, [record()]), choose_processing(AUTOMATIC, 1e-3)
    assert choice.processing == usual
    (notice,) = choice.notices
    assert notice.code == "identify.automatic"
    assert "rate" in notice.text
    noisy = record(1e-3)
    choice = choose_filters(AUTOMATIC, [noisy])
    assert choice.processing.decimation.factor > 2 * usual.decimation.factor
    assert choice.processing.filter_cutoff < usual.filter_cutoff
    assert "rate" not in choice.notices[0].text
    assert all(5.0 < band.clean < 40.0 for band in measure_bands(noisy))
    # What is stated stays.
    stated, part = Processing(filter_cutoff=60.0), Processing(filter_cutoff=60.0, automatic=True)
    choice = choose_filters(stated, [noisy])
    assert (choice.processing, choice.notices) == (stated, ())
    assert choose_filters(part, [noisy]).processing.filter_cutoff == 60.0


def test_windows_of_momentum_rows_are_as_long_as_torque_rows_are_apart():
    recording = record()
    estimate = identify_parameters(build_two_link(), [recording], AUTOMATIC, rows="momentum")
    factor = estimate.settings["processing"]["decimation"]["factor"]
    assert factor > 1
    assert estimate.settings["window"] == pytest.approx(factor * recording.period)
    # Windows are made of pairs of samples.
    even = Processing(filter_cutoff=100.0, decimation=Decimation(factor=4))
    estimate = identify_parameters(build_two_link(), [recording], even, rows="momentum")
    torque = identify_parameters(build_two_link(), [recording], even)
    assert estimate.samples == pytest.approx(torque.samples, rel=0.01)
    # Where every sample counts, or where long windows are the point, a tenth of a second.
    assert choose_window("momentum", Processing(), 1e-3) == 0.1
    assert choose_window("momentum", Processing(), 1e-3, chosen=True) == pytest.approx(2e-3)
    thinned = Processing(decimation=Decimation(factor=10))
    windows = [choose_window(kind, thinned, 1e-3) for kind in ("momentum", "energy", "filtered")]
    assert windows == [pytest.approx(0.01), 0.1, 0.1]


def test_logs_of_other_rates_are_refused_where_there_is_something_to_choose():
    """What is chosen would be that of the log named first."""
    fine = record()
    coarse = replace(cut_recording(fine, slice(None, None, 2)), source="slow")
    for pair in ([fine, coarse], [coarse, fine]):
        with raises(LogError, "identify.mixed-periods", match="slow every 2 ms"):
            choose_filters(AUTOMATIC, pair)
        stated = Processing(filter_cutoff=60.0, decimation=Decimation(factor=4))
        assert choose_filters(stated, pair).processing == stated


def record_payload(load):
    signals = build_signals(build_two_link(), TWO_LINK_TRUTH, samples=101)
    run = RunSettings(file="log.npz", payload="disc", load=load)
    return signals, Recording(
        time=signals.time, position=signals.q, torque=signals.tau, source="log.npz", run=run
    )


def test_without_one_nothing_changes_and_that_of_another_model_is_refused():
    signals, recording = record_payload(())
    assert compute_payload_torque(build_two_link(), signals, recording) is None
    signals, recording = record_payload((1.0, 2.0))
    with pytest.raises(LogError) as caught:
        compute_payload_torque(build_two_link(), signals, recording)
    (notice,) = caught.value.notices
    assert (notice.code, notice.file) == ("log.payload-model", "log.npz")
    assert [word for word in notice.text.replace(":", "").split() if word.isdigit()] == ["2", "6"]
