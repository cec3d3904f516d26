"""What predictions of torques miss: a missing term is named, and the residual counts within a band."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import LogError
from symid.identification.diagnostics.residual_structure import (
    OTHER_VALUES,
    analyse_residuals,
    compute_band_residual,
    compute_profile,
)
from symid.identification.regression.condensing import ENDS
from symid.identification.rigid.fit import identify_parameters
from symid.logs.recording import cut_recording
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_signals
from tests.refusals import raises
from tests.unit.identification.rigid.two_link_logs import LIBRARY, NAMES

PROCESSING = Processing(filter_cutoff=100.0, drop_first=300, drop_last=300, decimation=Decimation(factor=20))
SAMPLES = 20001


def build(seed=0, noise=(0.05, 0.05), samples=SAMPLES, **terms):
    """Return a log whose torques have further terms: joint -> function of the exact signals."""
    options = {"samples": samples, "seed": seed}
    recording = build_recording(LIBRARY, TWO_LINK_TRUTH, noise=np.array(noise), **options)
    signals = build_signals(LIBRARY, TWO_LINK_TRUTH, **options)
    torque = recording.torque.copy()
    for joint, term in terms.items():
        index = int(joint[-1]) - 1
        torque[:, index] += term(signals, index)
    return replace(recording, torque=torque)


def diagnose(recording):
    estimate = identify_parameters(LIBRARY, [recording], PROCESSING, estimator="wls")
    return estimate, analyse_residuals(estimate.assemble(NAMES), LIBRARY, [recording], PROCESSING)[0]


def test_white_noise_and_rounding_have_no_structure():
    estimate, found = diagnose(build())
    assert found == ()
    assert estimate.evidence.causes == ()
    still = replace(build(), torque=np.zeros((SAMPLES, 2)))
    assert analyse_residuals(np.zeros(12), LIBRARY, [still], PROCESSING)[0] == ()


@pytest.mark.parametrize(
    ("family", "term"),
    [
        ("position", lambda s, j: 2.0 * s.q[:, j]),
        ("velocity", lambda s, j: 0.8 * np.abs(s.dq[:, j]) * s.dq[:, j]),
        ("load", lambda s, j: 0.1 * np.abs(s.tau[:, j]) * np.sign(s.dq[:, j])),
        ("acceleration", lambda s, j: 0.4 * s.ddq[:, j]),
        ("slow motion", lambda s, j: np.sign(s.dq[:, j]) * np.exp(-((s.dq[:, j] / 0.1) ** 2))),
        ("other joints", lambda s, j: 0.6 * s.dq[:, 1 - j]),
        ("time", lambda s, _: 0.1 * s.time),
    ],
)
def test_a_missing_term_is_named_at_its_joint(family, term):
    # In 20 s there is hardly a reversal in each of the stretches that are held out.
    samples = 2 * SAMPLES if family == "slow motion" else SAMPLES
    _, found = diagnose(build(samples=samples, joint2=term))
    first = next(entry for entry in found if entry.joint == "joint2" and entry.family != OTHER_VALUES)
    assert first.family == family
    assert first.share_percent > 10.0
    assert first.unit == "N m"


def test_a_delay_of_the_torque_is_named():
    recording = build(noise=(0.01, 0.01))
    lag = 8
    torque = np.vstack([recording.torque[:1].repeat(lag, axis=0), recording.torque[:-lag]])
    _, found = diagnose(replace(recording, torque=torque))
    assert {entry.family for entry in found if entry.share_percent > 40.0} >= {"delay"}


def test_a_held_out_log_tells_as_well():
    """The parameters are true; the log has friction that the model has not, or a load that it has."""
    log = build(seed=5, joint1=lambda s, j: 0.8 * np.abs(s.dq[:, j]) * s.dq[:, j])
    found = analyse_residuals(TWO_LINK_TRUTH, LIBRARY, [log], PROCESSING)[0]
    assert "velocity" in {entry.family for entry in found if entry.joint == "joint1"}
    log = build(seed=5, joint2=lambda s, j: 0.5 * np.cos(s.q[:, 0] + s.q[:, j]))
    (finding,) = analyse_residuals(TWO_LINK_TRUTH, LIBRARY, [log], PROCESSING)[0]
    assert (finding.joint, finding.family) == ("joint2", OTHER_VALUES)
    assert finding.share_percent > 90.0


def test_profiles_follow_the_missing_term():
    log = build(noise=(0.0, 0.0), joint1=lambda s, j: 2.0 * s.q[:, j])
    _, (first, second) = analyse_residuals(TWO_LINK_TRUTH, LIBRARY, [log], PROCESSING)
    assert first.position.mean == pytest.approx(2.0 * first.position.centre, abs=0.05)
    assert np.all(np.diff(first.position.centre) > 0.0)
    assert second.load.mean == pytest.approx(np.zeros(24), abs=0.05)
    assert (first.joint, first.unit, first.position_unit) == ("joint1", "N m", "rad")
    # Groups are of equal size.
    x = np.array([3.0, 1.0, 2.0, 4.0])
    found = compute_profile(x, 10.0 * x, bins=2)
    assert found.centre.tolist() == [1.5, 3.5]
    assert found.mean.tolist() == [15.0, 35.0]
    assert found.deviation.tolist() == [5.0, 5.0]


TENTH = Processing(decimation=Decimation(factor=10))
RECORDING = build_recording(LIBRARY, TWO_LINK_TRUTH)


def add(recording, frequency, size):
    torque = recording.torque + size * np.sin(2.0 * np.pi * frequency * recording.time)[:, None]
    return replace(recording, torque=torque)


def measure(recording, band, values=TWO_LINK_TRUTH):
    return compute_band_residual(values, LIBRARY, recording, TENTH, band=band)


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
    found = prediction = compute_band_residual(TWO_LINK_TRUTH, LIBRARY, recording, TENTH, band=10.0)
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
    cut = replace(TENTH, drop_first=1000, drop_last=500)
    prediction = compute_band_residual(TWO_LINK_TRUTH, LIBRARY, RECORDING, cut, band=10.0)
    assert prediction.time[0] == pytest.approx(RECORDING.time[1000] + ENDS)
    assert len(prediction.time) == len(RECORDING.time) - 1500 - 1000
    # Its friction may hold what it likes.
    still = replace(RECORDING, position=RECORDING.position * [1.0, 0.0] + [0.0, 0.3])
    assert [joint.joint for joint in measure(still, 10.0).joints] == ["joint1"]
