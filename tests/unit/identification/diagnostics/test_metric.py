"""The residual within a band: what passes the filter counts, what does not, does not."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import LogError
from symid.identification.diagnostics.residual_structure import compute_band_residual, predict_torques
from symid.identification.diagnostics.stretches import ENDS
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import (
    ONE_AXIS_TRUTH,
    TWO_LINK_TRUTH,
    build_one_axis,
    build_recording,
    build_two_link as build_library,
)

PROCESSING = Processing(decimation=Decimation(factor=10))


def add(recording, frequency, size):
    torque = recording.torque + size * np.sin(2.0 * np.pi * frequency * recording.time)[:, None]
    return replace(recording, torque=torque)


def measure(recording, band, values=TWO_LINK_TRUTH):
    return compute_band_residual(predict_torques(values, build_library(), recording, PROCESSING, band=band))


def test_true_parameters_leave_differences_only():
    recording = build_recording(build_library(), TWO_LINK_TRUTH)
    assert measure(recording, 20.0).mean_relative_percent < 0.1


def test_a_tone_counts_within_the_band_alone():
    """A sine of amplitude 2 has a root mean square of sqrt 2; at the cut-off half of it is left."""
    clean = build_recording(build_library(), TWO_LINK_TRUTH)
    for frequency, share in ((2.0, 1.0), (10.0, 0.5), (100.0, 0.0)):
        found = measure(add(clean, frequency, 2.0), 10.0)
        for joint in found.joints:
            assert joint.std == pytest.approx(share * np.sqrt(2.0), rel=0.02, abs=0.02)


def test_the_figures_are_those_of_their_definitions():
    recording = add(build_recording(build_library(), TWO_LINK_TRUTH), 3.0, 1.0)
    prediction = predict_torques(TWO_LINK_TRUTH, build_library(), recording, PROCESSING, band=10.0)
    found = compute_band_residual(prediction)
    assert prediction.time[0] == pytest.approx(recording.time[0] + ENDS)
    assert prediction.time[-1] == pytest.approx(recording.time[-1] - ENDS)
    for k, joint in enumerate(found.joints):
        measured, error = prediction.measured[:, k], prediction.measured[:, k] - prediction.predicted[:, k]
        assert joint.norm == pytest.approx(np.linalg.norm(error))
        assert joint.relative_percent == pytest.approx(
            100.0 * np.linalg.norm(error) / np.linalg.norm(measured)
        )
        assert found.range_percent[k] == pytest.approx(100.0 * joint.std / (measured.max() - measured.min()))
    assert found.mean_relative_percent == pytest.approx(
        np.mean([joint.relative_percent for joint in found.joints])
    )
    whole = np.linalg.norm(prediction.measured)
    stacked = 100.0 * np.linalg.norm(prediction.measured - prediction.predicted) / whole
    assert found.stacked_percent == pytest.approx(stacked)


def test_measured_and_predicted_torques_pass_the_same_filter():
    """With the true parameters a band that damps the motion's torques leaves as little as a wide one."""
    recording = build_recording(build_library(), TWO_LINK_TRUTH)
    for band in (3.0, 5.0, 20.0):
        assert measure(recording, band).mean_relative_percent < 0.1


def test_cut_ends_are_cut_before_the_band():
    recording = build_recording(build_library(), TWO_LINK_TRUTH)
    cut = replace(PROCESSING, drop_first=1000, drop_last=500)
    prediction = predict_torques(TWO_LINK_TRUTH, build_library(), recording, cut, band=10.0)
    assert prediction.time[0] == pytest.approx(recording.time[1000] + ENDS)
    assert len(prediction.time) == len(recording.time) - 1500 - 1000


def test_a_joint_at_rest_with_friction_does_not_count():
    recording = build_recording(build_library(), TWO_LINK_TRUTH)
    position = recording.position.copy()
    position[:, 1] = 0.3
    still = replace(recording, position=position)
    assert [joint.joint for joint in measure(still, 10.0).joints] == ["joint1"]


def test_too_short_a_log_is_refused():
    library = build_one_axis()
    recording = build_recording(library, ONE_AXIS_TRUTH, samples=900)
    with pytest.raises(LogError, match=r"0\.9 s ") as caught:
        predict_torques(ONE_AXIS_TRUTH, library, recording, Processing(), band=10.0)
    assert caught.value.notices[0].code == "validate.short-log"


def test_a_band_beyond_the_sample_rate_is_refused():
    recording = build_recording(build_library(), TWO_LINK_TRUTH)
    with pytest.raises(LogError, match=r"500 Hz, .* 600 Hz"):
        measure(recording, 600.0)
