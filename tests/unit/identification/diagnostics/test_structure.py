"""A term that is missing is named; where none is, nothing is."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.diagnostics.residual_structure import (
    FAMILIES,
    OTHER_VALUES,
    analyse_structure,
    compute_profile,
    compute_profiles,
)
from symid.identification.rigid.fit import identify_parameters
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_signals
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
    return estimate, analyse_structure(estimate.assemble(NAMES), LIBRARY, [recording], PROCESSING)


def test_white_noise_and_rounding_have_no_structure():
    estimate, found = diagnose(build())
    assert found == ()
    assert not any(notice.code == "identify.structure" for notice in estimate.notices)
    still = replace(build(), torque=np.zeros((SAMPLES, 2)))
    assert analyse_structure(np.zeros(12), LIBRARY, [still], PROCESSING) == ()


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
    estimate, found = diagnose(build(samples=samples, joint2=term))
    first = next(entry for entry in found if entry.joint == "joint2" and entry.family != OTHER_VALUES)
    assert first.family == family
    assert first.share_percent > 10.0
    assert first.unit == "N m"
    told = [entry.text for entry in estimate.notices if entry.code == "identify.structure"]
    (text,) = (entry for entry in told if "joint2" in entry)
    assert f" a term of {family} explains " in text
    assert text.endswith(FAMILIES[family].advice[1:])


def test_a_delay_of_the_torque_is_named():
    recording = build(noise=(0.01, 0.01))
    lag = 8
    torque = np.vstack([recording.torque[:1].repeat(lag, axis=0), recording.torque[:-lag]])
    _, found = diagnose(replace(recording, torque=torque))
    assert {entry.family for entry in found if entry.share_percent > 40.0} >= {"delay"}


def test_a_held_out_log_tells_as_well():
    """The parameters are true; the log has friction that the model has not, or a load that it has."""
    log = build(seed=5, joint1=lambda s, j: 0.8 * np.abs(s.dq[:, j]) * s.dq[:, j])
    found = analyse_structure(TWO_LINK_TRUTH, LIBRARY, [log], PROCESSING)
    assert "velocity" in {entry.family for entry in found if entry.joint == "joint1"}
    log = build(seed=5, joint2=lambda s, j: 0.5 * np.cos(s.q[:, 0] + s.q[:, j]))
    (finding,) = analyse_structure(TWO_LINK_TRUTH, LIBRARY, [log], PROCESSING)
    assert (finding.joint, finding.family) == ("joint2", OTHER_VALUES)
    assert finding.share_percent > 90.0


def test_profiles_follow_the_missing_term():
    log = build(noise=(0.0, 0.0), joint1=lambda s, j: 2.0 * s.q[:, j])
    first, second = compute_profiles(TWO_LINK_TRUTH, LIBRARY, [log], PROCESSING)
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
