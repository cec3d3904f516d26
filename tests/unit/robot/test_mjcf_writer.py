"""MJCF and URDF that symid writes, read by MuJoCo: the torques are those of independent sums."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from symid.joint_models import FrictionValues
from symid.joint_models.hysteresis import Elasticity
from symid.robot.description import Coupling, Drive, Limits, Spring
from symid.robot.simulator_writers import list_mjcf_omissions, write_mjcf, write_urdf
from symid.robot.toml_reader import read_robot
from tests import state_laws
from tests.chains import (
    build_chain,
    build_transmission,
    change_joints,
    fill,
    find_pinocchio_torques,
    follow,
    list_values,
    regress,
)
from tests.mujocos import find_mujoco_torques

mujoco = pytest.importorskip("mujoco", reason="wants the package mujoco")

SHIPPED = "panda iiwa14 kr30 stanford tx40 two_arms quadruped wam7 rrp_twisted scara"
CLOSE = 1e-11


def assert_close(found, expected):
    assert np.abs(found - expected).max() <= CLOSE * np.abs(expected).max()


@pytest.mark.parametrize("write", [write_mjcf, write_urdf])
@pytest.mark.parametrize("name", SHIPPED.split())
def test_mujoco_finds_the_torques_of_the_links(write, name, robots_folder):
    robot = fill(replace(read_robot(robots_folder / f"{name}.toml"), couplings=()))
    robot = change_joints(robot, drive=Drive(), friction=FrictionValues(), limits=Limits())
    names = [joint.name for joint in robot.joints]
    model = mujoco.MjModel.from_xml_string(write(robot))
    if write is write_urdf:
        # A URDF states no gravity.
        model.opt.gravity[:] = [value.to_float() for value in robot.gravity]
    for seed in range(5):
        state = np.random.default_rng(seed).uniform(-2, 2, (3, robot.size))
        assert_close(find_mujoco_torques(model, names, state), find_pinocchio_torques(robot, state))


@pytest.fixture
def wrist():
    """Return a robot whose rotors, coupled drive, friction, springs and limits all have values."""
    rows = [(0.0, 0, 0.3, "q"), (np.pi / 2, 0.2, 0, "q"), (0.3, 0.1, "q", 0.4), (-np.pi / 2, 0.3, 0.1, "q")]
    robot = fill(build_chain(rows, gravity=("0.3", "-0.5", "-9.7")))
    plain, gears = "coulomb-viscous", (30.0, -48.0, 1.0, 12.0)
    joints = [
        replace(
            joint,
            drive=Drive(gear=gears[index], has_rotor=True, rotor_inertia=0.2 + 0.1 * index),
            friction=FrictionValues(law=plain, values=(0.4 + index, 0.7 - 0.1 * index)),
            limits=Limits(position=(-9.0, 8.0), velocity=3.0, torque=80.0),
        )
        for index, joint in enumerate(robot.joints)
    ]
    joints[3] = replace(joints[3], spring=Spring(stiffness=6.0, rest=0.25))
    coupling = Coupling(
        name="m4",
        terms=((0, Fraction(1)), (3, Fraction(-5, 2))),
        has_rotor=True,
        rotor_inertia=0.15,
        friction=FrictionValues(law=plain, values=(0.3, 0.2)),
    )
    return replace(robot, joints=tuple(joints), couplings=(coupling,))


def test_drives_friction_springs_and_couplings_are_read(wrist):
    model = mujoco.MjModel.from_xml_string(write_mjcf(wrist))
    values = list_values(wrist)
    names = [joint.name for joint in wrist.joints]
    rng = np.random.default_rng(5)
    for _ in range(5):
        state = rng.uniform(-1, 1, (3, wrist.size))
        state[1] = rng.choice([-1, 1], wrist.size) * rng.uniform(1, 4, wrist.size)
        # Where the coupled drive hardly moves, its dry friction is not fully there in MuJoCo.
        assert abs(build_transmission(wrist)[-1] @ state[1]) > 0.5
        columns = regress(wrist, *state)
        expected = sum(values[label] * column for label, column in columns.items())
        assert_close(find_mujoco_torques(model, names, state, dry=True), expected)


def test_limits_and_motors_are_read(wrist):
    model = mujoco.MjModel.from_xml_string(write_mjcf(wrist))
    np.testing.assert_array_equal(model.jnt_range, [[-9.0, 8.0]] * 4)
    np.testing.assert_array_equal(model.jnt_actfrcrange, [[-80.0, 80.0]] * 4)
    np.testing.assert_array_equal(model.actuator_gear[:, 0], [30.0, -48.0, 1.0, 12.0])
    np.testing.assert_array_equal(model.opt.gravity, [0.3, -0.5, -9.7])
    assert model.joint("joint2").name == "joint2"
    assert model.actuator("joint2_motor").trnid[0] == model.joint("joint2").id


def test_followers_are_held():
    robot = fill(follow(build_chain([(np.pi / 2, 0.1, 0.2, "q")] * 3), 2, 0, "-3/2"))
    model = mujoco.MjModel.from_xml_string(write_mjcf(robot))
    assert (model.neq, model.nu) == (1, 2)
    np.testing.assert_array_equal(model.eq_data[0, :5], [0, -1.5, 0, 0, 0])
    (follower,), (master,) = model.eq_obj1id, model.eq_obj2id
    assert (model.joint(follower).name, model.joint(master).name) == ("joint3", "joint1")


def test_what_has_no_words_is_told():
    friction = (
        FrictionValues(law="coulomb-viscous-offset", values=(1.0, 2.0, 3.0), smoothing=0.01),
        FrictionValues(law="asymmetric", values=(1.0, 2.0, 3.0, 6.0)),
        FrictionValues(law="stribeck", values=(0.5, 1.5, 0.25), shape=(0.1,)),
        FrictionValues(law="coulomb-viscous", values=(0.1, -0.2)),
        FrictionValues(law="coulomb-viscous"),
    )
    robot = fill(build_chain([(0.1, 0.1, 0, "q")] * 5, name='an "odd" <name>--'))
    joints = [
        replace(joint, friction=entry, spring=Spring() if index == 4 else None)
        for index, (joint, entry) in enumerate(zip(robot.joints, friction, strict=True))
    ]
    joints[3] = replace(joints[3], elasticity=Elasticity(stiffness=900.0))
    robot = replace(robot, joints=tuple(joints), symbols=(("L1", 0.25),))
    text = write_mjcf(robot, comments=("a comment -- of the caller",))
    ET.fromstring(text)  # noqa: S314  our own text
    model = mujoco.MjModel.from_xml_string(text)
    np.testing.assert_array_equal(model.dof_damping, [1.0, 2.0, 0.5, 0.1, 0.0])
    np.testing.assert_array_equal(model.dof_frictionloss, [2.0, 4.0, 1.5, 0.0, 0.0])
    for words in (
        "a comment - - of the caller",
        "L1 = 0.25 m",
        "coulomb-viscous-offset, values 1.0 2.0 3.0 (Fv, Fc, offset)",
        "over 0.01",
        "joint2: friction model asymmetric",
        "joint3: friction model stribeck, values 0.5 1.5 0.25, shape 0.1 (Fv, Fc, Fe; vs)",
        "joint4: negative friction, Fc = -0.2; it is written as 0",
        "joint4: elastic, 900.0;",
        "joint5: friction",
        "joint5: a spring",
    ):
        assert words in text, words
    assert len(list(list_mjcf_omissions(robot))) == 8


def test_a_long_chain_is_written():
    robot = fill(build_chain([(0.0, 0.01, 0, "q")] * 40))
    assert mujoco.MjModel.from_xml_string(write_mjcf(robot)).nv == 40


BENT = {
    "dahl": {"Fv": 1.1, "Fc": 2.0, "sigma0": 900.0},
    "lugre": {"Fv": 1.1, "Fc": 2.0, "Fe": 0.7, "vs": 0.1, "gamma": 2.0, "sigma0": 900.0, "sigma1": 3.0},
}


def bend(name, *, gear=-20.0, **changed):
    """Return a robot of two joints, the first with bristles and a torque limit."""
    p = BENT[name] | changed
    friction = FrictionValues(
        law=name,
        values=tuple(p[key] for key in ("Fv", "Fc", "Fe") if key in p),
        shape=tuple(p[key] for key in ("vs", "gamma") if key in p),
        bristles=tuple(p[key] for key in ("sigma0", "sigma1") if key in p),
    )
    robot = fill(build_chain([(0.3, 0.1, 0, "q")] * 2))
    first = replace(robot.joints[0], friction=friction, limits=Limits(torque=8.0), drive=Drive(gear=gear))
    return p, replace(robot, joints=(first, robot.joints[1]))


@pytest.mark.parametrize("name", BENT)
def test_bristles_are_those_of_the_law(name):
    p, robot = bend(name)
    assert not list(list_mjcf_omissions(robot))
    model = mujoco.MjModel.from_xml_string(write_mjcf(robot))
    # The bristles are an actuator without a control.
    assert (model.na, model.actuator_ctrlnum.tolist()) == (1, [1, 0, 1])
    data = mujoco.MjData(model)
    rng = np.random.default_rng(1)
    for _ in range(20):
        v, z = rng.uniform(-0.3, 0.3), rng.uniform(-2e-3, 2e-3)
        data.qpos[:], data.qvel[:], data.act[:] = rng.uniform(-1, 1, 2), (v, 0.4), z
        mujoco.mj_forward(model, data)
        rate = state_laws.find_rate(p, v, z)
        assert data.act_dot[0] == pytest.approx(rate, rel=1e-9)
        found = -(data.qfrc_actuator[0] + data.qfrc_passive[0])
        assert found == pytest.approx(state_laws.find_torque(p, v, [z]), rel=1e-9)
        assert data.qfrc_constraint[0] == 0.0


def test_a_torque_limit_is_that_of_the_motor_not_of_its_bristles():
    p, robot = bend("lugre")
    model = mujoco.MjModel.from_xml_string(write_mjcf(robot))
    data = mujoco.MjData(model)
    z, v = 1.5e-3, 0.2
    data.qvel[0], data.act[0] = v, z
    friction = state_laws.find_torque(p, v, [z]) - p["Fv"] * v
    for control, torque in ((-0.1, 2.0), (-0.6, 8.0), (0.6, -8.0)):
        data.ctrl[0] = control
        mujoco.mj_forward(model, data)
        assert data.qfrc_actuator[0] == pytest.approx(torque - friction)


@pytest.mark.parametrize("change", [{"gamma": 1.4}, {"Fe": -2.5}, {"Fv": -0.1}])
def test_bristles_that_mujoco_has_not_are_told(change):
    _, robot = bend("lugre", **change)
    (text,) = list_mjcf_omissions(robot)
    assert "friction model lugre" in text
    model = mujoco.MjModel.from_xml_string(write_mjcf(robot))
    assert (model.na, model.dof_frictionloss[0], model.jnt_actfrcrange[0, 1]) == (0, 2.0, 8.0)


@pytest.mark.parametrize(("values", "exact"), [((0.4, 0.7, -0.3, 0.2), True), ((0.4, 0.7, -0.6, 0.2), False)])
def test_curved_damping_is_a_polynomial_where_it_brakes(values, exact):
    made = fill(build_chain([(0.0, 0.1, 0, "q")]))
    joint = replace(made.joints[0], friction=FrictionValues(law="cubic", values=values))
    robot = replace(made, joints=(joint,))
    assert [("friction model cubic" in text) for text in list_mjcf_omissions(robot)] == [True] * (not exact)
    model = mujoco.MjModel.from_xml_string(write_mjcf(robot))
    data = mujoco.MjData(model)
    viscous, _, square, cube = values
    for v in (-2.0, -0.3, 0.7, 1.9):
        data.qvel[0] = v
        mujoco.mj_forward(model, data)
        expected = viscous * v + (square * abs(v) * v + cube * v**3) * exact
        assert -data.qfrc_passive[0] == pytest.approx(expected, rel=1e-12)
    assert model.dof_frictionloss[0] == 0.7
