"""Samples that are wrong count in no equation, and a log with faults identifies as it did without them."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.diagnostics.residual_structure import (
    compute_band_residual,
    compute_joint_residuals,
)
from symid.identification.friction.extraction import extract_joint, fold_recording, prepare_joint_logs
from symid.identification.regression.preparation import prepare_rows
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.log_check import study_log
from symid.identification.rigid.validation import validate_estimate
from symid.logs.faults import repair_recording
from symid.logs.signals import mask_states
from symid.robot.description import Decimation, Joint, JointKind, Processing
from symid.robot.geometry import IDENTITY
from tests.recovery.closed_form import TWO_LINK_TRUTH
from tests.unit.identification.rigid.two_link_logs import LIBRARY, NAMES, PERIOD, record, record_sticking

STATED = Processing(filter_cutoff=50.0, drop_first=50, drop_last=50, decimation=Decimation(factor=5))
AUTOMATIC = Processing(automatic=True)
JOINTS = tuple(
    Joint(name=f"joint{k}", kind=JointKind.REVOLUTE, parent=k - 2, placement=IDENTITY) for k in (1, 2)
)
KINDS = ["torque", "momentum", "filtered", "energy", "power"]


def spoil(log):
    """Return a log with spikes in both channels, an encoder that hangs, and a torque that is cut off."""
    rng = np.random.default_rng(3)
    position, torque = log.position.copy(), log.torque.copy()
    position[2001:2300, 1] = position[2000, 1]
    top = 0.8 * np.abs(torque[:, 0]).max()
    torque[:, 0] = np.clip(torque[:, 0], -top, top)
    for channel, size in ((position, 0.5), (torque, 80.0)):
        places = rng.choice(np.arange(20, len(position) - 20, 10), 25, replace=False)
        channel[places, rng.integers(0, 2, len(places))] += size
    return replace(log, position=position, torque=torque)


def repair(log):
    return repair_recording(log, JOINTS)


def measure_error(values, truth):
    return np.max(np.abs(values - truth) / np.maximum(np.abs(TWO_LINK_TRUTH), 0.1))


@pytest.mark.parametrize("rows", KINDS)
def test_a_log_with_faults_identifies_as_without_them(rows):
    clean = record(0, torque=0.1)
    assert repair(clean) is clean
    spoilt = spoil(clean)
    mended = repair(spoilt)
    assert {notice.code for notice in mended.notices} == {"log.spikes", "log.stuck", "log.clipped"}

    def fit(log):
        found = identify_parameters(LIBRARY, [log], STATED, rows=rows, estimator="wls")
        return found, np.array(found.assemble(NAMES))

    whole = fit(clean)[1]
    found, values = fit(mended)
    error = measure_error(values, whole)
    assert error < (0.1 if rows in {"torque", "momentum"} else 0.4)
    assert measure_error(fit(spoilt)[1], whole) > 3.0 * error
    told = [notice.text for notice in found.notices if notice.code == "identify.bad-rows"]
    assert len(told) == (1 if rows in {"energy", "power"} else 2)
    assert all("were left out" in text for text in told)


@pytest.mark.parametrize("rows", KINDS)
def test_rows_that_see_wrong_samples_are_left_out(rows):
    log = record(1)
    bad = np.zeros(log.position.shape, dtype=bool)
    bad[2000:2200, 1] = True
    usual = prepare_rows(rows, LIBRARY, log, STATED, window=0.1)
    found = prepare_rows(rows, LIBRARY, replace(log, bad=bad), STATED, window=0.1)
    (notice,) = (entry for entry in found.notices if entry.code == "identify.bad-rows")
    assert notice.file == log.source
    kept = []
    for group in np.unique(usual.group):
        before, after = (entry.time[entry.group == group] for entry in (usual, found))
        stays = np.isin(before, after)
        kept.append(stays)
        if rows not in {"energy", "power"} and group == 0:
            assert stays.all()
            continue
        lost = before[~stays]
        assert np.all((lost > log.time[2000] - 0.25) & (lost < log.time[2199] + 0.25))
        assert not np.any((after >= log.time[2000]) & (after <= log.time[2199]))
    # What is left is the same.
    np.testing.assert_array_equal(found.matrix, usual.matrix[np.concatenate(kept)])
    np.testing.assert_array_equal(found.values, usual.values[np.concatenate(kept)])


def test_settings_chosen_from_a_log_with_faults():
    mended = repair(spoil(record(2, encoder=1e-5)))
    for estimator in (None, "wls"):
        found = identify_parameters(LIBRARY, [mended], AUTOMATIC, estimator=estimator)
        assert measure_error(found.assemble(NAMES), TWO_LINK_TRUTH) < 0.15
        assert found.evidence.unexplained < 2.0
        assert found.evidence.causes == ()
    validation = validate_estimate(found, LIBRARY, mended, STATED)
    assert all(entry.relative_percent < 3.0 for entry in validation.residual)
    values = found.assemble(NAMES)
    band = compute_band_residual(values, LIBRARY, mended, STATED, band=5.0)
    assert band.mean_relative_percent < 2.0
    for _, residual in compute_joint_residuals(values, LIBRARY, [mended], STATED):
        assert np.abs(residual.plain).max() < 1.0


def test_rows_that_do_not_fit_into_memory_leave_out_the_same():
    mended = repair(spoil(record(3)))
    whole, long = (
        identify_parameters(LIBRARY, [mended], STATED, estimator="wls", largest=largest)
        for largest in (2e8, 1.0)
    )
    assert long.samples == whole.samples
    for one, other in zip(whole.parameters, long.parameters, strict=True):
        assert one.value == pytest.approx(other.value, rel=1e-9)


def test_evidence_and_checks_leave_out_what_is_wrong():
    clean, mended = record(4), repair(spoil(record(4)))
    usual, found, blind = (
        identify_parameters(LIBRARY, [log], STATED, estimator="wls").evidence.unexplained
        for log in (clean, mended, replace(mended, bad=None))
    )
    assert found < 2.0 * usual + 0.5
    assert blind > 2.0 * found
    usual, quick = (study_log(LIBRARY, log, AUTOMATIC).motion for log in (clean, mended))
    assert np.mean(quick.kept) < np.mean(usual.kept)


def test_friction_of_a_log_with_faults():
    mended = repair(spoil(record(5)))
    logs = prepare_joint_logs(LIBRARY, [mended], STATED)
    for joint in (0, 1):
        found = extract_joint(logs, joint)
        (notice,) = (entry for entry in found.notices if entry.code == "identify.bad-rows")
        lost = int(np.sum(~found.kept))
        assert f"{lost} of {len(found.kept)} samples" in notice.text
        assert lost == np.sum(logs.mask_bad(joint, (0,)))
    bad = np.zeros(mended.position.shape, dtype=bool)
    bad[700] = True
    repeated = np.tile(mended.position[:500], (4, 1))
    log = replace(mended, time=mended.time[:2000], position=repeated, torque=repeated, bad=bad[:2000])
    folded = fold_recording(log, 500 * PERIOD, margin=0)
    np.testing.assert_array_equal(np.flatnonzero(folded.bad[:, 0]), [200])


def test_states_that_bad_samples_are_noticed_in():
    log = record(6)
    assert mask_states(log, STATED) is None
    bad = np.zeros(log.position.shape, dtype=bool)
    bad[1000] = bad[2000:2020] = True
    wide = mask_states(replace(log, bad=bad), replace(STATED, filter_cutoff=2.0))[:, 0]
    # Half a period of 2 Hz is 63 samples: one of 127 is not noticed, 13 of them are.
    assert not wide[900:1100].any()
    assert wide[2000 - 63 + 13 : 2020 + 63 - 13].all()
    assert wide.sum() == pytest.approx(20 + 2 * (63 - 13), abs=4)
    plain = mask_states(replace(log, bad=bad), replace(STATED, filter_cutoff=None))[:, 0]
    np.testing.assert_array_equal(np.flatnonzero(plain[:1500]), np.arange(998, 1003))


@pytest.mark.parametrize("encoder", [1e-7, 1e-5, 1e-3])
def test_joints_that_stop_and_stick_have_no_faults(encoder):
    log, resting = record_sticking(0, encoder)
    assert np.mean(resting) > 0.1
    assert repair(log) is log
