"""Friction with the dynamics of a robot file known: torques and motions are Pinocchio's."""

import json
from dataclasses import replace

import numpy as np
import pytest

import symid
from symid.cli.main import run
from symid.robot.description import Drive, FrictionValues, JointKind, Spring
from symid.robot.geometry import Exact, compose_placements, translate
from symid.robot.toml_writer import write_robot
from tests.chains import build_pinocchio
from tests.unit.identification.pinocchio_arm import ARM, BODIES, FRICTION, draw_motion

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

ROTORS = (0.3, 0.5, 0.2)
LAW = ("fV", "fC", "offset")
EXACT = {"processing.states": "acceleration", "processing.automatic": "false"}


def build_arm(*, known=True, rotors=ROTORS):
    """Return the arm of Pinocchio's torques with values, or without, and with rotors."""
    joints = tuple(
        replace(
            joint,
            inertial=tuple(map(float, body)) if known else None,
            drive=Drive(has_rotor=rotor is not None, rotor_inertia=rotor if known else None),
        )
        for joint, body, rotor in zip(ARM.joints, BODIES, rotors, strict=True)
    )
    return replace(ARM, joints=joints)


def save(robot, path):
    path.write_text(write_robot(robot), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def arm(folder):
    return symid.load(save(build_arm(known=False), folder / "arm.toml"))


@pytest.fixture(scope="module")
def cad(folder):
    return save(build_arm(), folder / "cad.toml")


@pytest.fixture(scope="module")
def motion():
    """Return time, states and noise-free torques with rotors and friction of every joint."""
    time, *states = draw_motion(3)
    model = build_pinocchio(ARM, BODIES)
    model.armature = np.array(ROTORS)
    data = model.createData()
    tau = np.array([pin.rnea(model, data, *state) for state in zip(*states, strict=True)])
    viscous, dry, offset = FRICTION.T
    return time, *states, tau + viscous * states[1] + dry * np.sign(states[1]) + offset


@pytest.fixture(scope="module")
def log(arm, motion):
    time, q, dq, ddq, tau = motion
    return symid.build_log(arm, time=time, q=q, dq=dq, ddq=ddq, tau=tau)


@pytest.mark.parametrize("given", ["file", "robot"])
def test_friction_is_exact_with_the_values_of_a_robot_known(arm, cad, log, given):
    known = cad if given == "file" else symid.load(cad)
    fit = arm.identify_friction(log, model="coulomb-viscous-offset", known=known, settings=EXACT)
    np.testing.assert_allclose(find_values(fit), FRICTION, rtol=1e-8)
    assert fit.estimate.settings["known"] == str(cad)
    assert all("subtracted" in joint.rigid for joint in fit.joints.values())


def test_rotor_inertias_count(arm, folder, log):
    heavier = save(build_arm(rotors=(0.3, 0.5, 0.4)), folder / "heavier.toml")
    fit = arm.identify_friction(log, model="coulomb-viscous-offset", known=heavier, settings=EXACT)
    right, wrong = fit.joints["joint1"].residual, fit.joints["joint3"].residual
    assert right.relative_percent < 1e-6
    assert wrong.relative_percent > 1.0


def test_other_gravity_another_name_and_friction_are_no_other_model(arm, folder, log):
    robot = build_arm()
    joints = tuple(replace(joint, friction=FrictionValues()) for joint in robot.joints)
    other = replace(robot, name="drawing", joints=joints, gravity=(Exact.of("0"),) * 3)
    path = save(other, folder / "drawing.toml")
    fit = arm.identify_friction(log, model="coulomb-viscous-offset", known=path, settings=EXACT)
    np.testing.assert_allclose(find_values(fit), FRICTION, rtol=1e-8)


def test_a_urdf_with_values_is_taken(folder, log, motion):
    """A URDF has no rotors: the torques are those of links alone."""
    without = save(build_arm(rotors=(None, None, None)), folder / "without.toml")
    path = folder / "cad.urdf"
    symid.load(without).export(path)
    robot = symid.load(save(build_arm(known=False, rotors=(None, None, None)), folder / "plain.toml"))
    time, q, dq, ddq, tau = motion
    record = symid.build_log(robot, time=time, q=q, dq=dq, ddq=ddq, tau=tau - np.array(ROTORS) * ddq)
    fit = robot.identify_friction(record, model="coulomb-viscous-offset", known=path, settings=EXACT)
    # The file rounds angles and inertias.
    np.testing.assert_allclose(find_values(fit), FRICTION, rtol=1e-6)


def find_values(fit):
    return [[joint.estimate.get_value(name) for name in LAW] for joint in fit.joints.values()]


def change(**changes):
    """Return the arm with values, its second joint changed."""
    robot = build_arm()
    joints = list(robot.joints)
    joints[1] = replace(joints[1], **changes)
    return replace(robot, joints=tuple(joints))


SHIFTED = compose_placements(
    build_arm().joints[1].placement, translate(Exact.of("0.01"), *[Exact.of("0")] * 2)
)
WRONG = {
    "no values": (build_arm(known=False), ("it states no link values of joint1, joint2, joint3",)),
    "no value of one link": (change(inertial=None), ("no link values of joint2", "base parameters have no")),
    "no value of one rotor": (change(drive=Drive(has_rotor=True)), ("no rotor inertia of joint2",)),
    "no rotor": (change(drive=Drive()), ("'joint2' has a rotor in the robot and none in the file",)),
    "another place": (change(placement=SHIFTED), ("'joint2' stands elsewhere than in 'arm', by 0.01",)),
    "a slide": (change(kind=JointKind.PRISMATIC), ("'joint2' is of another kind",)),
    "a spring": (change(spring=Spring(stiffness=2.0, rest=0.0)), ("'joint2' has a spring in only one",)),
    "another name": (change(name="elbow"), ("its joints are joint1, elbow, joint3, those of 'arm' joint1",)),
}


@pytest.mark.parametrize("case", WRONG)
def test_another_model_is_refused(arm, folder, log, case):
    robot, texts = WRONG[case]
    path = save(robot, folder / "wrong.toml")
    with pytest.raises(symid.EstimateError) as caught:
        arm.identify_friction(log, known=path, settings=EXACT)
    message = str(caught.value)
    assert {notice.code for notice in caught.value.notices} == {"estimate.known-robot"}
    assert all(notice.file == str(path) for notice in caught.value.notices)
    assert all(text in message for text in texts)
    assert "an estimate" in message


def test_the_command_line_takes_a_robot_file(capsys, arm, cad, folder, motion):
    time, q, dq, ddq, tau = motion
    np.savez(folder / "log.npz", t=time, q=q, dq=dq, ddq=ddq, tau=tau)
    arguments = ["identify", arm.path, folder / "log.npz", "--rows", "friction", "--model", "coulomb-viscous"]
    sets = [part for key, value in EXACT.items() for part in ("--set", f"{key}={value}")]
    assert run([*map(str, arguments), *sets, "--known", str(cad), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert "subtracted" in answer["result"]["joints"][0]["rigid"]["text"]
    assert run([*map(str, arguments), *sets, "--known", str(arm.path)]) == 3
    assert f"error: {arm.path}: --known: it states no link values" in capsys.readouterr().err
