"""Friction of a robot from its recordings: laws, refusals, poses, files."""

import json
from dataclasses import replace

import numpy as np
import pytest

from symid.data.recording import Recording
from symid.errors import EstimateError, IdentifiabilityError, UsageError
from symid.friction.extraction import prepare_joint_logs
from symid.friction.identify import FrictionTask, identify_friction
from symid.friction.poses import find_pose_test, find_poses
from symid.friction.results import is_friction_result, read_friction_result, write_friction_result
from symid.joint.friction_laws import get_law
from symid.robot.log_map import Processing
from tests.recovery.closed_form import build_two_link
from tests.unit.friction.cosine_rigs import (
    BETA,
    PLAIN,
    RAW,
    STRIBECK,
    assert_near_truth,
    find_values,
    load_recording,
    record,
)

LIBRARY = build_two_link()
SLOW_AND_FAST = (record(0.15), record(1.0, seed=1))
FEW = ("coulomb-viscous-offset", "stribeck+offset")


def identify(*recordings, processing=RAW, **options):
    return identify_friction(LIBRARY, recordings, processing, FrictionTask(**options))


def refuse(*recordings, **options):
    with pytest.raises(IdentifiabilityError) as caught:
        identify(*recordings, **options)
    return caught.value.notices


@pytest.mark.parametrize("options", [{"candidates": FEW}, {"model": "stribeck+offset", "beta": BETA}])
def test_slow_and_fast_cosines_together_tell_the_whole_law(options):
    found = identify(*SLOW_AND_FAST, **options)
    (joint,) = found.joints
    assert joint.estimate.law == "stribeck+offset"
    assert not joint.estimate.refused
    assert_near_truth(joint.estimate, STRIBECK)
    assert joint.residual.std == pytest.approx(0.05, rel=0.1)
    assert joint.sources == ("peak 0.15", "peak 1")
    assert (joint.unit, joint.velocity_unit) == ("N m", "rad/s")
    assert (joint.selection is None) == ("model" in options)
    ((name, reason),) = found.refused
    assert name == LIBRARY.card.joints[1].name
    assert "moves in none" in reason
    assert "friction.joint-refused" in {notice.code for notice in found.notices}
    assert found.settings["rigid"] == ("known" if "beta" in options else "fitted along")


def build_motion(dq):
    """Return a recording of the first joint with these velocities, the second at rest."""
    time = np.arange(len(dq)) / 500.0
    q, speed, rate = np.zeros((3, len(dq), 2))
    speed[:, 0] = dq
    q[:, 0] = np.cumsum(dq) / 500.0
    rate[:, 0] = np.gradient(dq, 1 / 500.0)
    return load_recording(time, q, speed, rate, law="stribeck+offset")


def test_one_direction_only_gets_no_number_for_the_other():
    time = np.arange(6000) / 500.0
    recording = build_motion(0.5 + 0.45 * np.cos(2.0 * time))
    (joint,) = identify(recording, model="coulomb-viscous-offset", beta=BETA).joints
    refused = dict(joint.estimate.refused)
    assert set(refused) == {"fC", "offset"}
    assert all("positive direction only" in reason for reason in refused.values())
    assert set(find_values(joint.estimate)) == {"fV"}
    (joint,) = identify(recording, model="asymmetric", beta=BETA).joints
    assert set(dict(joint.estimate.refused)) == {"fCn", "fVn"}


def test_constant_velocity_gets_sentences_and_no_number():
    recording = build_motion(np.full(4000, 0.3))
    for options in ({"model": "coulomb-viscous-offset"}, {"model": "stribeck+offset"}, {"candidates": FEW}):
        notices = refuse(recording, beta=BETA, **options)
        assert {notice.code for notice in notices} == {"friction.nothing"}
        assert any("one speed only" in notice.text for notice in notices)


def test_without_low_velocities_the_fall_of_friction_gets_no_number():
    processing = Processing(drop_first=20, drop_last=20, standstill=0.25)
    (joint,) = identify(record(1.0), model="stribeck+offset", processing=processing, beta=BETA).joints
    refused = dict(joint.estimate.refused)
    assert {"fS", "vs"} <= set(refused)
    assert "slow" in refused["vs"]
    values = find_values(joint.estimate)
    assert values["fV"] == pytest.approx(1.1, abs=0.1)
    assert values["offset"] == pytest.approx(0.25, abs=0.02)


def test_periods_can_be_averaged():
    # The peak is that of a period of 3 s, whose turning points are samples: there the sign is anybody's.
    recording = record(np.pi / 3.0, law="coulomb-viscous-offset", periods=6.1)
    options = {
        "model": "coulomb-viscous-offset",
        "processing": Processing(drop_first=20, drop_last=20, standstill=0.01),
    }
    (whole,) = identify(recording, **options).joints
    found = identify(recording, **options, period=3.0)
    (joint,) = found.joints
    assert_near_truth(joint.estimate, PLAIN, deviations=5.0)
    assert joint.residual.samples < whole.residual.samples / 4
    assert joint.residual.std < 0.6 * whole.residual.std
    assert "log.folded" in {notice.code for notice in found.notices}


def test_names_are_checked_and_near_ones_offered():
    with pytest.raises(UsageError, match="did you mean stribeck") as caught:
        identify(*SLOW_AND_FAST, model="stribek")
    assert caught.value.notices[0].code == "usage.unknown-friction-law"
    with pytest.raises(UsageError, match="did you mean varpro") as caught:
        identify(*SLOW_AND_FAST, estimator="varprow")
    assert caught.value.notices[0].code == "usage.friction-estimator"
    with pytest.raises(UsageError) as caught:
        identify(model="stribeck")
    assert caught.value.notices[0].code == "usage.no-log"


def test_results_are_read_back_without_loss(tmp_path):
    third = record(1.0, pose=(0.3, 1.2), seed=2)
    found = identify(*SLOW_AND_FAST, third, candidates=FEW)
    assert found.joints[0].poses is not None
    path = write_friction_result(found, tmp_path / "friction.json")
    assert is_friction_result(path)
    again = read_friction_result(path)
    assert write_friction_result(again, tmp_path / "again.json").read_text() == path.read_text()
    assert replace(again.joints[0], velocity_map=None) == replace(found.joints[0], velocity_map=None)
    assert again.notices == found.notices


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda data: data.pop("joints"), "joints is missing"),
        (lambda data: data.update(extra=1), "extra is unknown"),
        (lambda data: data.update(robot=3), "robot: expected str"),
        (lambda data: data.update(version=9), "version 9"),
        (lambda data: data.update(format="something"), "no friction of a robot"),
        (lambda data: data["joints"][0]["estimate"].update(outcome="LUCKY"), "LUCKY"),
        (lambda data: data["joints"][0]["estimate"].update(linear=[True]), "expected int or float"),
        (lambda data: data.update(refused=[["a"]]), "expected 2 entries"),
    ],
)
def test_files_that_are_no_results_are_refused(tmp_path, change, told):
    found = identify(record(1.0, law="coulomb-viscous-offset"), model="coulomb-viscous-offset")
    path = write_friction_result(found, tmp_path / "friction.json")
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(EstimateError, match=told) as caught:
        read_friction_result(path)
    assert caught.value.notices[0].code == "estimate.format"


def test_files_that_are_no_json_are_refused(tmp_path):
    path = tmp_path / "friction.json"
    for text in (None, "{"):
        if text is not None:
            path.write_text(text)
        assert not is_friction_result(path)
        with pytest.raises(EstimateError):
            read_friction_result(path)


def build_poses(*levels, noise=0.05):
    """Return recordings at different poses of the second joint, with these Coulomb levels."""
    return [
        record(
            1.0,
            law="coulomb-viscous-offset",
            values=PLAIN | {"fC": level},
            pose=(0.3, 0.5 * number),
            noise=noise,
            seed=number,
        )
        for number, level in enumerate(levels)
    ]


def compare(recordings):
    logs = prepare_joint_logs(LIBRARY, recordings, RAW)
    return find_pose_test(LIBRARY, logs, 0, get_law("coulomb-viscous-offset"))


def test_equal_friction_at_all_poses_is_told():
    found = compare(build_poses(1.8, 1.8, 1.8))
    assert not found.differs
    assert "does not depend on the pose" in found.verdict
    assert found.change < 0.02
    assert [pose.others[0][1] for pose in found.poses] == pytest.approx([0.0, 0.5, 1.0])
    for entry in found.parameters:
        truth = PLAIN[entry.name]
        assert sum(low <= truth <= high for low, high in entry.intervals) >= 2


def test_friction_that_depends_on_the_pose_is_told():
    found = compare(build_poses(1.8, 2.0, 1.8))
    assert found.differs
    assert "depends on the pose: fC" in found.verdict
    level = next(entry for entry in found.parameters if entry.name == "fC")
    assert level.values == pytest.approx((1.8, 2.0, 1.8), abs=0.02)
    assert level.chance < 1e-6
    assert 0.04 < found.change < 0.12


def test_false_alarms_are_rare():
    alarms = 0
    for seed in range(20):
        recordings = [
            record(1.0, law="coulomb-viscous-offset", pose=(0.3, angle), seed=10 * seed + k, periods=1.0)
            for k, angle in enumerate((0.0, 0.8))
        ]
        alarms += compare(recordings).differs
    assert alarms <= 2


def test_one_pose_is_no_test_and_recordings_of_one_pose_belong_together():
    recordings = [*build_poses(1.8, 1.8), record(0.3, pose=(0.3, 0.0), seed=7)]
    logs = prepare_joint_logs(LIBRARY, recordings, RAW)
    assert [pose.runs for pose in find_poses(LIBRARY, logs, 0)] == [(0, 2), (1,)]
    assert compare(build_poses(1.8)) is None
    moving = Recording(
        time=recordings[0].time,
        position=recordings[0].position[:, [0, 0]],
        torque=recordings[0].torque,
    )
    assert find_poses(LIBRARY, prepare_joint_logs(LIBRARY, [moving], RAW), 0) == ()
