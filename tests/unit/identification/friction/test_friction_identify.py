"""Friction of a robot from its recordings: laws, refusals, poses, files."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import ttest_ind

from symid.errors import EstimateError, IdentifiabilityError, LogError, UsageError
from symid.identification.estimators.estimate import ParameterEstimate
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.extraction import extract_joint, prepare_joint_logs
from symid.identification.friction.identify import (
    FrictionTask,
    check_inputs,
    identify_friction,
    warn_of_inertia,
)
from symid.identification.friction.joint_fit import FrictionSamples
from symid.identification.friction.poses import (
    compare_poses,
    compute_chance,
    compute_robust_deviations,
    list_poses,
)
from symid.identification.stored import read_fit, write_fit
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_friction_torque
from symid.robot.description import Processing
from tests.recovery.closed_form import build_two_link
from tests.refusals import raises, tell
from tests.unit.identification.friction.cosine_rigs import (
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
SLOW = Processing(drop_first=20, drop_last=20, standstill=0.1)
FAST_ONLY = Processing(drop_first=20, drop_last=20, standstill=0.25)


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
    assert repr(name) in reason
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


def test_what_a_log_does_not_show_gets_sentences_and_no_number():
    # One direction only.
    recording = build_motion(0.5 + 0.45 * np.cos(2.0 * np.arange(6000) / 500.0))
    (joint,) = identify(recording, model="coulomb-viscous-offset", beta=BETA).joints
    refused = dict(joint.estimate.refused)
    assert set(refused) == {"fC", "offset"}
    assert all("positive direction only" in reason for reason in refused.values())
    assert set(find_values(joint.estimate)) == {"fV"}
    (joint,) = identify(recording, model="asymmetric", beta=BETA).joints
    assert set(dict(joint.estimate.refused)) == {"fCn", "fVn"}
    # One speed only.
    recording = build_motion(np.full(4000, 0.3))
    for options in ({"model": "coulomb-viscous-offset"}, {"model": "stribeck+offset"}, {"candidates": FEW}):
        notices = refuse(recording, beta=BETA, **options)
        assert {notice.code for notice in notices} == {"friction.nothing"}
        assert any("one speed only" in notice.text for notice in notices)
    # No low velocities: the fall of friction gets no number.
    (joint,) = identify(record(1.0), model="stribeck+offset", processing=FAST_ONLY, beta=BETA).joints
    refused = dict(joint.estimate.refused)
    assert {"fS", "vs"} <= set(refused)
    assert "slow" in refused["vs"]
    values = find_values(joint.estimate)
    assert values["fV"] == pytest.approx(1.1, abs=0.1)
    assert values["offset"] == pytest.approx(0.25, abs=0.02)


def test_periods_of_every_log_can_be_averaged():
    # Periods of 3 and 6 s, whose turning points are samples: there the sign is anybody's.
    recordings = [
        record(peak, law="coulomb-viscous-offset", periods=6.1, seed=k)
        for k, peak in enumerate((np.pi / 3.0, np.pi / 6.0))
    ]
    options = {"model": "coulomb-viscous-offset", "processing": replace(SLOW, standstill=0.01)}
    (whole,) = identify(recordings[0], **options).joints
    found = identify(recordings[0], **options, periods=(3.0,))
    (joint,) = found.joints
    assert_near_truth(joint.estimate, PLAIN, deviations=5.0)
    assert joint.residual.samples < whole.residual.samples / 4
    assert joint.residual.std < 0.6 * whole.residual.std
    assert "log.folded" in {notice.code for notice in found.notices}
    (joint,) = identify(*recordings, **options, periods=(3.0, 6.0)).joints
    assert_near_truth(joint.estimate, PLAIN, deviations=5.0)
    # One period of each: no row is used twice.
    assert 4400 < joint.residual.samples <= 4500
    with raises(LogError, "log.not-periodic"):
        identify(*recordings, **options, periods=(3.0,))


def test_doubts_of_a_period_stay_where_no_number_is_found():
    time = np.arange(5000) / 500.0
    dq = 0.3 + 0.02 * np.cos(2.0 * np.pi * time)
    recording = build_motion(dq - 0.3)
    drifting = replace(recording, position=recording.position + 0.0001 * time[:, None] * [[1.0, 0.0]])
    notices = refuse(drifting, model="coulomb-viscous-offset", beta=BETA, periods=(1.0,), processing=SLOW)
    assert [notice.code for notice in notices][-1] == "log.not-periodic"


def test_a_law_of_the_load_needs_a_load():
    """The torque of the first joint is friction only: nothing in it is a load."""
    recording = record(0.3, law="coulomb-viscous-offset")
    speed = np.gradient(recording.position[:, 0], recording.time)
    torque = np.zeros_like(recording.torque)
    noise = 0.05 * np.random.default_rng(1).normal(size=len(speed))
    torque[:, 0] = 1.1 * speed + 1.8 * np.sign(speed) + noise
    weightless = replace(recording, torque=torque)
    (first, *_) = refuse(weightless, model="load-dependent")
    assert (first.code, "load" in first.text) == ("friction.nothing", True)
    # That joint alone does not keep others from such a law.
    samples = extract_joint(prepare_joint_logs(LIBRARY, [weightless], RAW), 0).samples
    assert samples.load is None
    with raises(IdentifiabilityError, "friction.no-load"):
        check_inputs(samples, get_law("load-dependent"))


def test_what_looks_odd_is_told_and_nothing_else():
    def find(*recordings, **options):
        return tell(identify(*recordings, **options).notices)

    right, law = record(1.0, law="coulomb-viscous-offset"), "coulomb-viscous-offset"
    rough = right.torque + 20.0 * np.random.default_rng(0).normal(size=right.torque.shape)
    wrong, noisy = (replace(right, torque=torque) for torque in (-right.torque, rough))
    assert "sign" in find(wrong, model=law)["friction.negative-inertia"]
    assert "degrees" in find(noisy, model=law)["friction.large-residual"]
    assert not {"friction.negative-inertia", "friction.large-residual"} & find(right, model=law).keys()
    assert "fC" in find(*SLOW_AND_FAST, model=law)["friction.pattern"]
    found = find(*SLOW_AND_FAST, model="stribeck+offset", smoothing=1e-4)
    assert not {"friction.pattern", "friction.smoothing-unused"} & found.keys()
    found = find(*SLOW_AND_FAST, candidates=("makkar",), smoothing=0.01)
    assert "friction.smoothing-unused" in found
    # An inertia that is only uncertain is not blamed on the log.
    estimate = SimpleNamespace(extra=(ParameterEstimate(name="J", value=-0.03, std=0.2, unit="kg m^2"),))
    (notice,) = warn_of_inertia(estimate)
    assert "zero" in notice.text


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        ({"model": "makkar", "smoothing": 0.01}, "usage.friction-smoothing", "'makkar'"),
        ({"model": "lugre", "estimator": "nlp"}, "usage.friction-state", "by the estimator 'varpro'"),
        ({"model": "dahl", "smoothing": 0.1}, "usage.friction-state", "without smoothing"),
        ({"recordings": (), "model": "stribeck"}, "usage.no-log", None),
    ],
)
def test_wrong_calls_are_told_with_what_would_do(options, code, words):
    options = dict(options)
    with raises(UsageError, code, match=words):
        identify(*options.pop("recordings", SLOW_AND_FAST), **options)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Return a path of a file of a result, and its text."""
    found = identify(record(1.0, law="coulomb-viscous-offset"), model="coulomb-viscous-offset")
    path = write_fit(found, tmp_path_factory.mktemp("stored") / "friction.json")
    return path, path.read_text()


def test_results_are_read_back_without_loss(tmp_path):
    third = record(1.0, pose=(0.3, 1.2), seed=2)
    found = identify(*SLOW_AND_FAST, third, candidates=FEW)
    assert found.joints[0].poses is not None
    path = write_fit(found, tmp_path / "friction.json")
    again = read_fit(path)
    assert write_fit(again, tmp_path / "again.json").read_text() == path.read_text()
    assert replace(again.joints[0], velocity_map=None) == replace(found.joints[0], velocity_map=None)
    assert again.notices == found.notices


def change_map(data, **columns):
    data["joints"][0]["velocity_map"].update(columns)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda data: data["joints"][0]["estimate"].update(outcome="LUCKY"), "LUCKY"),
        (lambda data: data.update(joints=[]), "joints is empty"),
        (lambda data: data["joints"][0]["estimate"].update(law="zzz"), "friction law 'zzz'"),
        (lambda data: data["joints"][0]["estimate"].update(linear=[1.0]), "linear has 1 entries, not 3"),
        (lambda data: data["joints"][0]["estimate"]["covariance"].pop(), "covariance has 5 entries, not 6"),
        (lambda data: data["joints"][0]["estimate"]["covariance"][0].pop(), "row 0 has 5 entries"),
        (lambda data: data["joints"][0]["velocity_map"]["torque"].pop(), "velocity_map.torque has"),
        (lambda data: change_map(data, cloud_velocity=[], cloud_torque=[]), "cloud_velocity is empty"),
        (lambda data: data["joints"][0]["estimate"].update(linear=[None, 1, 1]), "are not numbers"),
    ],
)
def test_files_that_are_no_results_are_refused(stored, change, told):
    path, data = stored[0], json.loads(stored[1])
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(EstimateError, match=told) as caught:
        read_fit(path)
    assert caught.value.notices[0].code == "estimate.format"


def build_poses(*levels):
    """Return recordings at different poses of the second joint, with these Coulomb levels."""
    law = "coulomb-viscous-offset"
    return [
        record(1.0, law=law, values=PLAIN | {"fC": level}, pose=(0.3, 0.5 * number), seed=number)
        for number, level in enumerate(levels)
    ]


def compare(recordings):
    logs = prepare_joint_logs(LIBRARY, recordings, RAW)
    return compare_poses(logs, 0, get_law("coulomb-viscous-offset"))


def test_friction_that_depends_on_the_pose_is_told_from_equal_friction():
    found = compare(build_poses(1.8, 1.8, 1.8))
    assert (found.differs, " not " in found.verdict, found.change < 0.02) == (False, True, True)
    assert [pose.others[0][1] for pose in found.poses] == pytest.approx([0.0, 0.5, 1.0])
    for entry in found.parameters:
        assert sum(low <= PLAIN[entry.name] <= high for low, high in entry.intervals) >= 2
    found = compare(build_poses(1.8, 2.0, 1.8))
    assert (found.differs, ": fC (" in found.verdict, 0.04 < found.change < 0.12) == (True, True, True)
    level = next(entry for entry in found.parameters if entry.name == "fC")
    assert level.values == pytest.approx((1.8, 2.0, 1.8), abs=0.02)
    assert level.chance < 1e-6


def test_a_pose_that_cannot_be_fitted_is_left_out_and_the_rest_stays():
    options = {"model": "coulomb-viscous-offset", "processing": SLOW}
    fast = record(1.0, law="coulomb-viscous-offset")
    slow = record(0.08, law="coulomb-viscous-offset", pose=(0.3, 1.2), periods=1.0, seed=1)
    found = identify(fast, slow, **options)
    (joint,) = found.joints
    assert joint.estimate.get_value("fC") == pytest.approx(1.8, abs=0.05)
    assert joint.poses.parameters == ()
    assert " 1 " in joint.poses.verdict
    assert not joint.poses.differs
    (text,) = [notice.text for notice in found.notices if notice.code == "friction.pose-skipped"]
    assert "peak 0.08" in text
    assert "slower than processing.standstill" in text
    assert [sources for sources, _ in joint.poses.skipped] == ["peak 0.08"]


def test_poses_that_tell_too_little_are_not_called_alike():
    short = record(0.8, law="coulomb-viscous-offset", pose=(0.3, 1.2), periods=0.16, noise=0.5)
    found = compare([record(1.0, law="coulomb-viscous-offset"), short])
    assert not found.differs
    assert found.change is None or found.change > 0.0
    assert "uncertain" in found.verdict
    # What a pose does not tell makes no change of the curve.
    logs = prepare_joint_logs(LIBRARY, [record(1.0), record(1.0, pose=(0.3, 1.2), seed=1)], FAST_ONLY)
    found = compare_poses(logs, 0, get_law("stribeck+offset"), beta=BETA)
    assert "vs" not in {entry.name for entry in found.parameters}
    assert found.change is None
    assert "not identifiable" in found.verdict


@pytest.mark.parametrize(("memory", "poses"), [(0.0, 2), (0.0, 5), (0.98, 2), (0.98, 5), (0.995, 2)])
def test_noise_with_a_memory_makes_no_difference_of_poses(memory, poses):
    law = get_law("coulomb-viscous-offset")
    linear, shape = law.from_physical((1.8, 1.1, 0.2))
    time = np.arange(2000) / 100.0
    velocity = 0.4 * np.sin(2.0 * np.pi * time / 5.0)
    clean = compute_friction_torque(law, {"velocity": velocity}, linear, shape)
    alarms = 0
    for trial in range(60):
        fits = []
        for pose in range(poses):
            rng = np.random.default_rng([trial, pose])
            noise = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], rng.normal(size=5000))[3000:]
            torque, rest = clean + 0.1 * noise, {"joint": "j", "extra": np.empty((2000, 0))}
            samples = FrictionSamples(time=time, velocity=velocity, torque=torque, **rest)
            estimate = fit_friction(samples, law)
            deviations, _ = compute_robust_deviations(samples, law, estimate)
            fits.append([(estimate.get_value(name), *deviations[name]) for name in ("fC", "fV", "offset")])
        chances = [compute_chance(*np.array([fit[k] for fit in fits]).T) for k in range(3)]
        alarms += 3 * min(chances) < 0.01
    # At 1 % the chance of four or more among sixty is 0.3 %.
    assert alarms <= 3
    # The comparison of two means is that of Welch.
    rng = np.random.default_rng(4)
    one, two = rng.normal(size=7), 0.4 + 3.0 * rng.normal(size=12)
    stds = np.array([np.std(part, ddof=1) / np.sqrt(len(part)) for part in (one, two)])
    chance = compute_chance(np.array([one.mean(), two.mean()]), stds, np.array([6.0, 11.0]))
    assert chance == pytest.approx(ttest_ind(one, two, equal_var=False).pvalue, rel=1e-10)


def test_one_pose_is_no_test_and_recordings_of_one_pose_belong_together():
    recordings = [*build_poses(1.8, 1.8), record(0.3, pose=(0.3, 0.0), seed=7)]
    moving = replace(recordings[0], position=recordings[0].position[:, [0, 0]])
    for logs, runs in ((recordings, [(0, 2), (1,)]), ([moving], [])):
        assert [pose.runs for pose in list_poses(prepare_joint_logs(LIBRARY, logs, RAW), 0)] == runs
    assert compare(build_poses(1.8)) is None
