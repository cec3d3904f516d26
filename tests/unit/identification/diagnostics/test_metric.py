"""The residual within a band: what passes the filter counts, what does not, does not."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import LogError
from symid.identification.diagnostics.residual_structure import compute_band_residual, predict_torques
from symid.identification.diagnostics.stretches import ENDS
from symid.logs.recording import cut_recording
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording
from tests.refusals import raises
from tests.unit.identification.rigid.two_link_logs import LIBRARY

PROCESSING = Processing(decimation=Decimation(factor=10))
RECORDING = build_recording(LIBRARY, TWO_LINK_TRUTH)


def add(recording, frequency, size):
    torque = recording.torque + size * np.sin(2.0 * np.pi * frequency * recording.time)[:, None]
    return replace(recording, torque=torque)


def measure(recording, band, values=TWO_LINK_TRUTH):
    return compute_band_residual(predict_torques(values, LIBRARY, recording, PROCESSING, band=band))


def test_measured_and_predicted_torques_pass_the_same_filter():
    """With the true parameters a band that damps the motion's torques leaves as little as a wide one."""
    for band in (3.0, 5.0, 20.0):
        assert measure(RECORDING, band).mean_relative_percent < 0.1
    with pytest.raises(LogError, match=r"500 Hz, .* 600 Hz"):
        measure(RECORDING, 600.0)
    short = cut_recording(RECORDING, slice(0, 900))
    with raises(LogError, "validate.short-log", match=r"0\.9 s "):
        measure(short, 10.0)


def test_a_tone_counts_within_the_band_alone():
    """A sine of amplitude 2 has a root mean square of sqrt 2; at the cut-off half of it is left."""
    for frequency, share in ((2.0, 1.0), (10.0, 0.5), (100.0, 0.0)):
        for joint in measure(add(RECORDING, frequency, 2.0), 10.0).joints:
            assert joint.std == pytest.approx(share * np.sqrt(2.0), rel=0.02, abs=0.02)


def test_the_figures_are_those_of_their_definitions():
    recording = add(RECORDING, 3.0, 1.0)
    prediction = predict_torques(TWO_LINK_TRUTH, LIBRARY, recording, PROCESSING, band=10.0)
    found = compute_band_residual(prediction)
    assert prediction.time[0] == pytest.approx(recording.time[0] + ENDS)
    assert prediction.time[-1] == pytest.approx(recording.time[-1] - ENDS)
    for k, joint in enumerate(found.joints):
        measured, error = prediction.measured[:, k], prediction.measured[:, k] - prediction.predicted[:, k]
        share = np.linalg.norm(error) / np.linalg.norm(measured)
        assert joint.norm == pytest.approx(np.linalg.norm(error))
        assert joint.relative_percent == pytest.approx(100.0 * share)
        assert found.range_percent[k] == pytest.approx(100.0 * joint.std / (measured.max() - measured.min()))
    mean = np.mean([joint.relative_percent for joint in found.joints])
    assert found.mean_relative_percent == pytest.approx(mean)
    whole = np.linalg.norm(prediction.measured)
    stacked = 100.0 * np.linalg.norm(prediction.measured - prediction.predicted) / whole
    assert found.stacked_percent == pytest.approx(stacked)


def test_cut_ends_are_cut_before_the_band_and_a_joint_at_rest_does_not_count():
    cut = replace(PROCESSING, drop_first=1000, drop_last=500)
    prediction = predict_torques(TWO_LINK_TRUTH, LIBRARY, RECORDING, cut, band=10.0)
    assert prediction.time[0] == pytest.approx(RECORDING.time[1000] + ENDS)
    assert len(prediction.time) == len(RECORDING.time) - 1500 - 1000
    # Its friction may hold what it likes.
    still = replace(RECORDING, position=RECORDING.position * [1.0, 0.0] + [0.0, 0.3])
    assert [joint.joint for joint in measure(still, 10.0).joints] == ["joint1"]
