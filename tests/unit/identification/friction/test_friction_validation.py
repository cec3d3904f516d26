"""What becomes of identified friction: predictions of other logs, and the friction of robot files."""

from dataclasses import replace

import numpy as np
import pytest

from symid.dynamics import compute_friction_columns
from symid.errors import EstimateError, IdentifiabilityError
from symid.identification.estimators.estimate import check_model
from symid.identification.friction.identify import (
    FrictionTask,
    build_robot_friction,
    identify_friction,
    read_known_parameters,
    validate_friction,
)
from symid.joint_models.carriers import build_numpy_carrier
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_friction_torque
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.friction_forms import EVERY_LAW
from tests.recovery.closed_form import build_two_link
from tests.refusals import tell
from tests.unit.identification.friction.cosine_rigs import BETA, DECIMATED, RAW, load_recording, record

LIBRARY = build_two_link()
TASK = FrictionTask(model="stribeck+offset", poses=False)


@pytest.fixture(scope="module")
def found():
    return identify_friction(LIBRARY, [record(0.15), record(1.0, seed=1)], RAW, TASK)


def find_codes(validation):
    return [entry.code for entry in validation.notices]


def test_a_log_of_the_same_motion_leaves_noise_alone(found):
    validation = validate_friction(found, LIBRARY, record(0.6, seed=7), RAW)
    (entry,) = validation.residual
    assert (entry.joint, entry.unit) == ("joint1", "N m")
    assert entry.std == pytest.approx(0.05, rel=0.05)
    assert entry.norm == pytest.approx(entry.std * np.sqrt(entry.samples))
    (series,) = validation.series
    assert entry.relative_percent == pytest.approx(100.0 * entry.norm / np.linalg.norm(series.measured))
    assert find_codes(validation) == ["validate.friction-pose"]
    # The fitted log is told from others, and so are speeds beyond those fitted.
    again = validate_friction(found, LIBRARY, record(1.0, seed=1), RAW)
    assert again.fitted
    assert "validate.fitted-log" in find_codes(again)
    fast = validate_friction(found, LIBRARY, record(2.0, seed=4), RAW)
    assert "validate.friction-range" in find_codes(fast)


def test_the_prediction_is_that_of_the_written_formula(found):
    recording = record(0.6, seed=7, noise=0.0)
    (series,) = validate_friction(found, LIBRARY, recording, RAW).series
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


def test_the_very_log_gives_the_residual_of_the_fit():
    recording, task = record(1.0), replace(TASK, model="asymmetric")
    for processing in (RAW, DECIMATED):
        found = identify_friction(LIBRARY, [recording], processing, task)
        found = replace(found, sources=("elsewhere",))
        (entry,) = validate_friction(found, LIBRARY, recording, processing).residual
        expected = found.joints[0].residual
        assert entry.relative_percent == pytest.approx(expected.relative_percent, rel=1e-12)
        assert entry.samples == expected.samples


def test_base_parameters_that_were_known_are_subtracted_again():
    task = replace(TASK, beta=BETA, model="coulomb-viscous-offset")
    found = identify_friction(LIBRARY, [record(1.0, law="coulomb-viscous-offset")], RAW, task)
    known = {entry.name: value for entry, value in zip(LIBRARY.card.beta, BETA.tolist(), strict=True)}
    told = replace(found, settings={**found.settings, "known_values": known})
    assert read_known_parameters(told, LIBRARY.card).tolist() == BETA.tolist()
    # At a pose that was not fitted: known base parameters hold everywhere.
    other = record(0.8, pose=(-0.5, 1.9), seed=3, law="coulomb-viscous-offset")
    validation = validate_friction(told, LIBRARY, other, RAW)
    assert validation.residual[0].std == pytest.approx(0.05, rel=0.06)
    assert find_codes(validation) == []
    with pytest.raises(EstimateError, match="known_values"):
        validate_friction(found, LIBRARY, other, RAW)


def move_both():
    """Return the recording of a motion of both joints."""
    time = np.arange(3000) / 500.0
    angle = np.array([0.0, 0.3]) + np.outer(time, [2.0, 3.1])
    size, rate = np.array([0.5, 0.6]), np.array([2.0, 3.1])
    q, dq = size * np.sin(angle), size * rate * np.cos(angle)
    return load_recording(time, q, dq, -(rate**2) * q, law="stribeck+offset")


def test_columns_that_stand_for_groups_are_told_and_parameters_told_apart_hold_at_every_pose():
    found = identify_friction(LIBRARY, [move_both()], RAW, replace(TASK, model="coulomb-viscous-offset"))
    (joint,) = (entry for entry in found.joints if entry.joint == "joint1")
    assert {entry.name for entry in joint.estimate.extra} == {entry.name for entry in LIBRARY.card.beta}
    found = replace(found, joints=(joint,))
    assert find_codes(validate_friction(found, LIBRARY, record(1.0, pose=(0.9, -1.0)), RAW)) == []
    found = identify_friction(LIBRARY, [record(1.0), record(1.0, pose=(0.3, 1.2), seed=2)], RAW, TASK)
    (joint,) = found.joints
    assert not {"J", "a", "b"} & {entry.name for entry in joint.estimate.extra}
    told = tell(validate_friction(found, LIBRARY, record(0.8, seed=4), RAW).notices)
    assert f"({len(joint.estimate.other)} columns)" in told["validate.friction-pose"]


def test_another_kind_of_motion_is_refused_where_its_rigid_part_is_not_known(found):
    with pytest.raises(IdentifiabilityError, match="rigid part") as caught:
        validate_friction(found, LIBRARY, move_both(), RAW)
    assert {entry.code for entry in caught.value.notices} == {"validate.friction-joint"}
    # Here the other joint moves, this one rests.
    recording = record(1.0)
    still = replace(
        recording, position=recording.position[:, ::-1].copy(), torque=recording.torque[:, ::-1].copy()
    )
    with pytest.raises(IdentifiabilityError, match=r"joint1.* not move"):
        validate_friction(found, LIBRARY, still, RAW)


def test_refused_parameters_leave_the_speeds_that_were_fitted():
    slow = replace(RAW, standstill=0.2)
    found = identify_friction(LIBRARY, [record(1.0), record(0.6, seed=3)], slow, TASK)
    assert {name for name, _ in found.joints[0].estimate.refused} >= {"fS", "vs"}
    validation = validate_friction(found, LIBRARY, record(0.8, seed=9), RAW)
    assert np.min(np.abs(validation.series[0].velocity)) >= 0.2
    assert validation.residual[0].std == pytest.approx(0.05, rel=0.1)
    assert "fS, vs" in tell(validation.notices)["validate.friction-refused"]
    with pytest.raises(IdentifiabilityError, match=r"processing\.standstill.* fitted"):
        validate_friction(found, LIBRARY, record(0.15, seed=9), RAW)


def test_a_rigid_part_without_numbers_is_told(found):
    (joint,) = found.joints
    extra = tuple(entry for entry in joint.estimate.extra if entry.name != "J")
    refused = (("J", "the joint hardly accelerates"),)
    untold = replace(joint.estimate, extra=extra, refused=refused)
    changed = replace(found, joints=(replace(joint, estimate=untold),))
    validation = validate_friction(changed, LIBRARY, record(0.6, seed=7), RAW)
    # Its value still takes part in the prediction.
    assert validation.residual[0].std == pytest.approx(0.05, rel=0.05)
    assert find_codes(validation) == ["validate.friction-beside"]


def test_another_model_is_refused(found):
    changed, (joint,) = replace(LIBRARY.card, signature="0" * 64), found.joints
    unknown, strange = (
        replace(joint, estimate=replace(joint.estimate, **fields))
        for fields in ({"joint": "wheel"}, {"other": (1.0,)})
    )
    for card, joints, words in (
        (changed, (joint,), "changed"),
        (replace(changed, robot="other"), (joint,), r"'two_link'.*'other'"),
        (LIBRARY.card, (unknown,), r"'wheel' .*'two_link'"),
        (LIBRARY.card, (joint, joint), r"each once"),
    ):
        with pytest.raises(EstimateError, match=words):
            check_model(replace(found, joints=joints), card, "friction.json")
    with pytest.raises(EstimateError, match=r"joint1.* 1 values"):
        validate_friction(replace(found, joints=(strange,)), LIBRARY, record(0.6, seed=7), RAW)


def test_rows_below_standstill_are_counted_apart(found):
    """What a validation left out, and the residual as it would be with it."""
    log = record(0.6, seed=7)
    slow = replace(RAW, standstill=0.1)
    part, whole = (validate_friction(found, LIBRARY, log, settings) for settings in (slow, RAW))
    (entry,), (kept,), (plain,) = part.motion, part.residual, whole.residual
    assert entry.left_out == plain.samples - kept.samples > 0
    assert sum(entry.rows) == plain.samples
    assert entry.whole == pytest.approx(plain.norm / np.sqrt(plain.samples))
    assert (entry.joint, entry.unit) == ("joint1", "N m")
    assert whole.motion[0].left_out == 0
    assert whole.motion[0].rms == pytest.approx(entry.rms, nan_ok=True)


# What papers print, with static friction below Coulomb friction and above.
VALUES = {"fC": 2.3, "fV": 1.7, "fS": 3.1, "vs": 0.07, "offset": -0.4, "gamma": 1.37, "fP": 0.3, "dq0": 0.02}
VALUES |= {"fCp": 2.0, "fVp": 1.1, "fCn": 2.4, "fVn": 1.9, "fE": -0.8, "fV2": -0.3, "fV3": 0.2, "fD": 1.3}
VALUES |= {"delta": 0.4, "fM": 0.9, "g2": 90.0, "g3": 11.0, "g5": 70.0, "dqs": 0.03, "TV": 25.0}
# Standstill is among them, and speeds from far below the zone to far above all shape values.
SPEEDS = np.concatenate([[0.0], np.logspace(-6.0, 1.0, 200), -np.logspace(-6.0, 1.0, 200)])
INPUTS = {
    "velocity": SPEEDS,
    "load": np.linspace(-30.0, 20.0, len(SPEEDS)),
    "position": np.linspace(-2.0, 5.0, len(SPEEDS)),
    "temperature": np.linspace(60.0, 15.0, len(SPEEDS)),
}
ROBOT = """
name = "slide"
convention = "modified"
gravity = [0, 0, -9.81]

[[joint]]
name = "first"
kind = "{kind}"
alpha = "pi/2"
"""


@pytest.fixture(scope="module")
def identified():
    task = FrictionTask(model="coulomb-viscous-offset", poses=False)
    (joint,) = identify_friction(build_two_link(), [record(1.0)], RAW, task).joints
    return joint


def give(joint, name, *, smoothing=0.0, refused=(), **values):
    """Return a joint with these values of a law, 0.1 where none are given."""
    law = get_law(name)
    told = {**VALUES, **values}
    linear, shape = law.from_physical([told.get(entry.name, 0.1) for entry in law.physical])
    estimate = replace(joint.estimate, law=name, linear=linear, shape=shape, refused=refused)
    return replace(joint, estimate=estimate, smoothing=smoothing)


def write_and_read(friction, kind="prismatic"):
    """Return the friction of a robot file that is written and read."""
    robot = parse_robot(ROBOT.format(kind=kind))
    text = write_robot(replace(robot, joints=(replace(robot.joints[0], friction=friction),)))
    return parse_robot(text).joints[0].friction


@pytest.mark.parametrize("smoothing", [0.0, 0.013])
@pytest.mark.parametrize("name", EVERY_LAW)
def test_a_written_law_has_the_torque_of_the_identified_one(identified, name, smoothing):
    joint = give(identified, name, smoothing=smoothing)
    friction = build_robot_friction(joint)
    assert friction.law == name
    law = get_law(name, smoothing=smoothing)
    inputs = {key: INPUTS[key] for key in law.inputs}
    expected = compute_friction_torque(law, inputs, joint.estimate.linear, joint.estimate.shape)
    read = write_and_read(friction)
    assert read == friction == write_and_read(friction, "revolute")
    columns = compute_friction_columns(read, build_numpy_carrier(), inputs)
    found = sum(value * column for value, column in zip(read.values, columns, strict=True))
    assert np.max(np.abs(found - expected)) <= 1e-12 * np.max(np.abs(expected))


def test_values_names_and_smoothing_are_those_of_robot_files(identified):
    """Static friction is the step above Coulomb friction; laws without a sign have no smoothing."""
    friction = build_robot_friction(give(identified, "stribeck+offset"))
    assert friction.values == pytest.approx((1.7, 2.3, 3.1 - 2.3, -0.4), abs=1e-15)
    assert friction.shape == (0.07,)
    below = build_robot_friction(give(identified, "stribeck", fS=1.9))
    assert below.values == pytest.approx((1.7, 2.3, 1.9 - 2.3), abs=1e-15)
    searched = build_robot_friction(give(identified, "stribeck-exponent"))
    assert (searched.law, searched.shape) == ("stribeck-exponent", (0.07, 1.37))
    for name, smoothing in (("makkar", 0.0), ("improved-stribeck", 0.0), ("stribeck", 0.01)):
        assert build_robot_friction(give(identified, name, smoothing=0.01)).smoothing == smoothing
    # A law of an earlier fit is written with the name of today.
    joint = give(identified, "stribeck+offset")
    old = replace(joint, estimate=replace(joint.estimate, law="stribeck_offset"))
    assert build_robot_friction(old) == friction


def test_values_that_were_refused_stay_out(identified):
    slow, other = ("vs", "no row is slow enough"), ("fS", "nor here")
    for refused, told in (
        ((slow,), "vs was refused: no row is slow enough"),
        ((slow, other), "vs was refused: no row is slow enough; fS was refused: nor here"),
    ):
        assert build_robot_friction(give(identified, "stribeck", refused=refused)) == told
    beside = give(identified, "stribeck", refused=(("J", "the joint hardly accelerates"),))
    assert build_robot_friction(beside).law == "stribeck"


@pytest.mark.parametrize("name", EVERY_LAW)
def test_files_take_all_shape_values_that_a_fit_may_find(identified, name):
    for entry in get_law(name).shape:
        low = entry.lower if entry.lower_is_allowed else max(entry.lower, 1e-12)
        for value in (low, min(entry.upper, 1e6)):
            friction = build_robot_friction(give(identified, name, **{entry.name: value}))
            assert write_and_read(friction) == friction
