"""Friction on a log that was not fitted: the same rows, the same columns, nothing fitted."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import EstimateError, IdentifiabilityError
from symid.identification.estimators.estimate import check_model
from symid.identification.friction.identify import (
    FrictionTask,
    identify_friction,
    read_known_parameters,
    validate_friction,
)
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_friction_torque
from tests.recovery.closed_form import build_two_link
from tests.refusals import tell
from tests.unit.identification.friction.cosine_rigs import BETA, DECIMATED, RAW, load_recording, record

TASK = FrictionTask(model="stribeck+offset", poses=False)


@pytest.fixture(scope="module")
def library():
    return build_two_link()


@pytest.fixture(scope="module")
def found(library):
    return identify_friction(library, [record(0.15), record(1.0, seed=1)], RAW, TASK)


def find_codes(validation):
    return [entry.code for entry in validation.notices]


def test_a_log_of_the_same_motion_leaves_noise_alone(library, found):
    validation = validate_friction(found, library, record(0.6, seed=7), RAW)
    (entry,) = validation.residual
    assert (entry.joint, entry.unit) == ("joint1", "N m")
    assert entry.std == pytest.approx(0.05, rel=0.05)
    assert entry.norm == pytest.approx(entry.std * np.sqrt(entry.samples))
    (series,) = validation.series
    assert entry.relative_percent == pytest.approx(100.0 * entry.norm / np.linalg.norm(series.measured))
    assert find_codes(validation) == ["validate.friction-pose"]
    # The fitted log is told from others, and so are speeds beyond those fitted.
    again = validate_friction(found, library, record(1.0, seed=1), RAW)
    assert again.fitted
    assert "validate.fitted-log" in find_codes(again)
    fast = validate_friction(found, library, record(2.0, seed=4), RAW)
    assert "validate.friction-range" in find_codes(fast)


def test_the_prediction_is_that_of_the_written_formula(library, found):
    recording = record(0.6, seed=7, noise=0.0)
    (series,) = validate_friction(found, library, recording, RAW).series
    estimate = found.joints[0].estimate
    law = get_law(estimate.law)
    # By hand: central differences of the positions, inner samples, J ddq + a sin q + b cos q.
    q = recording.position[:, 0]
    dt = recording.time[1] - recording.time[0]
    dq, inner = np.gradient(q, dt), slice(20, -20)
    parts = {"J": np.gradient(dq, dt), "a": np.sin(q), "b": np.cos(q)}
    rigid = sum(entry.value * parts[entry.name] for entry in estimate.extra)
    torque = rigid + compute_friction_torque(law, {"velocity": dq}, estimate.linear, estimate.shape)
    assert len(series.predicted) == len(torque[inner])
    assert series.predicted == pytest.approx(torque[inner], abs=1e-3)


def test_the_very_log_gives_the_residual_of_the_fit(library):
    recording, task = record(1.0), replace(TASK, model="asymmetric")
    for processing in (RAW, DECIMATED):
        found = identify_friction(library, [recording], processing, task)
        found = replace(found, sources=("elsewhere",))
        (entry,) = validate_friction(found, library, recording, processing).residual
        expected = found.joints[0].residual
        assert entry.relative_percent == pytest.approx(expected.relative_percent, rel=1e-12)
        assert entry.samples == expected.samples


def test_base_parameters_that_were_known_are_subtracted_again(library):
    task = replace(TASK, beta=BETA, model="coulomb-viscous-offset")
    found = identify_friction(library, [record(1.0, law="coulomb-viscous-offset")], RAW, task)
    known = {entry.name: value for entry, value in zip(library.card.beta, BETA.tolist(), strict=True)}
    told = replace(found, settings={**found.settings, "known_values": known})
    assert read_known_parameters(told, library.card).tolist() == BETA.tolist()
    # At a pose that was not fitted: known base parameters hold everywhere.
    other = record(0.8, pose=(-0.5, 1.9), seed=3, law="coulomb-viscous-offset")
    validation = validate_friction(told, library, other, RAW)
    assert validation.residual[0].std == pytest.approx(0.05, rel=0.06)
    assert find_codes(validation) == []
    with pytest.raises(EstimateError, match="known_values"):
        validate_friction(found, library, other, RAW)


def move_both():
    """Return the recording of a motion of both joints."""
    time = np.arange(3000) / 500.0
    angle = np.array([0.0, 0.3]) + np.outer(time, [2.0, 3.1])
    size, rate = np.array([0.5, 0.6]), np.array([2.0, 3.1])
    q, dq = size * np.sin(angle), size * rate * np.cos(angle)
    return load_recording(time, q, dq, -(rate**2) * q, law="stribeck+offset")


def test_columns_that_stand_for_groups_are_told_and_parameters_told_apart_hold_at_every_pose(library):
    found = identify_friction(library, [move_both()], RAW, replace(TASK, model="coulomb-viscous-offset"))
    (joint,) = (entry for entry in found.joints if entry.joint == "joint1")
    assert {entry.name for entry in joint.estimate.extra} == {entry.name for entry in library.card.beta}
    found = replace(found, joints=(joint,))
    assert find_codes(validate_friction(found, library, record(1.0, pose=(0.9, -1.0)), RAW)) == []
    found = identify_friction(library, [record(1.0), record(1.0, pose=(0.3, 1.2), seed=2)], RAW, TASK)
    (joint,) = found.joints
    assert not {"J", "a", "b"} & {entry.name for entry in joint.estimate.extra}
    told = tell(validate_friction(found, library, record(0.8, seed=4), RAW).notices)
    assert f"({len(joint.estimate.other)} columns)" in told["validate.friction-pose"]


def test_another_kind_of_motion_is_refused_where_its_rigid_part_is_not_known(library, found):
    with pytest.raises(IdentifiabilityError, match="rigid part") as caught:
        validate_friction(found, library, move_both(), RAW)
    assert {entry.code for entry in caught.value.notices} == {"validate.friction-joint"}
    # Here the other joint moves, this one rests.
    recording = record(1.0)
    still = replace(
        recording, position=recording.position[:, ::-1].copy(), torque=recording.torque[:, ::-1].copy()
    )
    with pytest.raises(IdentifiabilityError, match=r"joint1.* not move"):
        validate_friction(found, library, still, RAW)


def test_refused_parameters_leave_the_speeds_that_were_fitted(library):
    slow = replace(RAW, standstill=0.2)
    found = identify_friction(library, [record(1.0), record(0.6, seed=3)], slow, TASK)
    assert {name for name, _ in found.joints[0].estimate.refused} >= {"fS", "vs"}
    validation = validate_friction(found, library, record(0.8, seed=9), RAW)
    assert np.min(np.abs(validation.series[0].velocity)) >= 0.2
    assert validation.residual[0].std == pytest.approx(0.05, rel=0.1)
    assert "fS, vs" in tell(validation.notices)["validate.friction-refused"]
    with pytest.raises(IdentifiabilityError, match=r"processing\.standstill.* fitted"):
        validate_friction(found, library, record(0.15, seed=9), RAW)


def test_a_rigid_part_without_numbers_is_told(library, found):
    (joint,) = found.joints
    extra = tuple(entry for entry in joint.estimate.extra if entry.name != "J")
    refused = (("J", "the joint hardly accelerates"),)
    untold = replace(joint.estimate, extra=extra, refused=refused)
    changed = replace(found, joints=(replace(joint, estimate=untold),))
    validation = validate_friction(changed, library, record(0.6, seed=7), RAW)
    # Its value still takes part in the prediction.
    assert validation.residual[0].std == pytest.approx(0.05, rel=0.05)
    assert find_codes(validation) == ["validate.friction-beside"]


def test_another_model_is_refused(library, found):
    changed, (joint,) = replace(library.card, signature="0" * 64), found.joints
    unknown, strange = (
        replace(joint, estimate=replace(joint.estimate, **fields))
        for fields in ({"joint": "wheel"}, {"other": (1.0,)})
    )
    for card, joints, words in (
        (changed, (joint,), "changed"),
        (replace(changed, robot="other"), (joint,), r"'two_link'.*'other'"),
        (library.card, (unknown,), r"'wheel' .*'two_link'"),
        (library.card, (joint, joint), r"each once"),
    ):
        with pytest.raises(EstimateError, match=words):
            check_model(replace(found, joints=joints), card, "friction.json")
    with pytest.raises(EstimateError, match=r"joint1.* 1 values"):
        validate_friction(replace(found, joints=(strange,)), library, record(0.6, seed=7), RAW)


def test_rows_below_standstill_are_counted_apart(library, found):
    """What a validation left out, and the residual as it would be with it."""
    log = record(0.6, seed=7)
    slow = replace(RAW, standstill=0.1)
    part, whole = (validate_friction(found, library, log, settings) for settings in (slow, RAW))
    (entry,), (kept,), (plain,) = part.motion, part.residual, whole.residual
    assert entry.left_out == plain.samples - kept.samples > 0
    assert sum(entry.rows) == plain.samples
    assert entry.whole == pytest.approx(plain.norm / np.sqrt(plain.samples))
    assert (entry.joint, entry.unit) == ("joint1", "N m")
    assert whole.motion[0].left_out == 0
    assert whole.motion[0].rms == pytest.approx(entry.rms, nan_ok=True)
