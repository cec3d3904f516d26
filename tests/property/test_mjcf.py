"""MJCF models of random trees: MuJoCo finds the torques of Pinocchio and of the formulas of drives.

What symid reads in them has the same torques; frames of bodies, however they are written, are MuJoCo's.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from symid.robot.description import Spring
from symid.robot.simulator_writers import write_mjcf
from tests.chains import RATIONAL_ANGLES, draw_parameters, fold, list_values, regress, spread, trees
from tests.mujocos import find_mujoco_torques, parse_mjcf
from tests.urdfs import find_link_poses

mujoco = pytest.importorskip("mujoco", reason="wants the package mujoco")


def fill(robot, rng):
    """Return the robot with values."""

    def draw_rotor(owner):
        return float(rng.uniform(0.1, 1)) if owner.has_rotor else None

    joints = []
    for joint, body in zip(robot.joints, draw_parameters(rng, robot.size).tolist(), strict=True):
        drive = replace(joint.drive, rotor_inertia=draw_rotor(joint.drive))
        spring, friction = None, joint.friction
        if joint.spring is not None:
            spring = Spring(stiffness=float(rng.uniform(1, 9)), rest=float(rng.uniform(-1, 1)))
        if friction.law == "coulomb-viscous":
            friction = replace(friction, values=(float(rng.uniform(0, 1)), 0.0))
        joints.append(replace(joint, inertial=tuple(body), drive=drive, spring=spring, friction=friction))
    couplings = (replace(entry, rotor_inertia=draw_rotor(entry)) for entry in robot.couplings)
    return replace(robot, joints=tuple(joints), couplings=tuple(couplings))


def find_torques(robot, state):
    columns = regress(robot, *state)
    return sum(value * columns[label] for label, value in list_values(robot).items())


def stand_on_one_branch(robot, terms):
    joints = {index for index, _ in terms}
    index = max(joints)
    while index >= 0:
        joints.discard(index)
        index = robot.joints[index].parent
    return not joints


KINDS = ("rotors", "friction", "followers", "couplings", "springs")
TREES = trees(angles=RATIONAL_ANGLES, **dict.fromkeys(KINDS, True))


@settings(max_examples=60)
@given(robot=TREES)
def test_mujoco_finds_the_torques_of_random_trees(robot):
    # MuJoCo has no inertia between branches: the armature of a tendon across them counts at each joint alone.
    assume(all(stand_on_one_branch(robot, entry.terms) for entry in robot.couplings if entry.has_rotor))
    rng = np.random.default_rng(robot.size)
    robot = fill(robot, rng)
    text = write_mjcf(robot)
    assert text == write_mjcf(robot)
    state = rng.uniform(-2, 2, (3, robot.freedom))
    joints = np.array([spread(robot, row) for row in state])
    model = mujoco.MjModel.from_xml_string(text)
    found = fold(robot, find_mujoco_torques(model, [joint.name for joint in robot.joints], joints))
    expected = find_torques(robot, state)
    assert np.abs(found - expected).max() <= 1e-10 * max(1.0, float(np.abs(expected).max()))


@settings(max_examples=40, deadline=None)
@given(robot=TREES)
def test_what_is_written_is_read_back(robot):
    rng = np.random.default_rng(robot.size)
    robot = fill(robot, rng)
    back = parse_mjcf(write_mjcf(robot))
    # In the file bodies stand in the order of branches.
    joints = {joint.name: joint for joint in robot.joints}
    assert sorted(joint.name for joint in back.joints) == sorted(joints)
    for joint in back.joints:
        before = joints[joint.name]
        assert (joint.kind, joint.drive.gear) == (before.kind, before.drive.gear)
        assert name_master(back, joint) == name_master(robot, before)
    assert [value.to_float() for value in back.gravity] == [value.to_float() for value in robot.gravity]
    # A coupled drive without mechanics is nothing that MuJoCo computes with.
    assert name_terms(back) == {name: terms for name, terms in name_terms(robot).items() if terms["rotor"]}
    state = rng.uniform(-2, 2, (3, robot.freedom))
    names = [joint.name for joint in robot.axes]
    order = [names.index(joint.name) for joint in back.axes]
    expected, found = find_torques(robot, state), find_torques(back, state[:, order])
    assert np.abs(found - expected[order]).max() <= 1e-11 * max(1.0, float(np.abs(expected).max()))


def name_master(robot, joint):
    return joint.mimic and (robot.joints[joint.mimic.master].name, joint.mimic.multiplier)


def name_terms(robot):
    """Return rotors and factors of coupled drives by the names of their joints."""
    return {
        entry.name: {"rotor": entry.rotor_inertia}
        | {robot.joints[index].name: factor for index, factor in entry.terms}
        for entry in robot.couplings
    }


# Six decimals, none so small that what it turns lies within 1e-9 rad of a right angle: readers round there.
PARTS = st.floats(-3, 3, allow_nan=False, allow_subnormal=False).map(
    lambda value: round(value, 6) if abs(value) > 1e-3 else 0.0
)
ORIENTATIONS = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}


@st.composite
def orientations(draw):
    """Return an orientation in a model's own words, one that has a direction."""
    name = draw(st.sampled_from(sorted(ORIENTATIONS)))
    values = draw(st.lists(PARTS, min_size=ORIENTATIONS[name], max_size=ORIENTATIONS[name]))
    if name != "euler":
        assume(np.linalg.norm(values[:3]) > 0.1)
    if name == "xyaxes":
        cross = np.cross(values[:3], values[3:])
        assume(np.linalg.norm(cross) > 0.1)
    return f'{name}="{" ".join(map(repr, values))}"'


@settings(max_examples=60, deadline=None)
@given(
    turns=st.lists(orientations(), min_size=3, max_size=3),
    places=st.lists(PARTS, min_size=9, max_size=9),
    sequence=st.text("xyzXYZ", min_size=3, max_size=3),
    unit=st.sampled_from(["degree", "radian"]),
    seed=st.integers(0, 1000),
)
def test_frames_of_bodies_are_those_of_mujoco(turns, places, sequence, unit, seed):
    geom = '<geom type="box" size="0.1 0.2 0.3"/>'
    x, y, z = (" ".join(map(repr, places[3 * k : 3 * k + 3])) for k in range(3))
    text = (
        f'<mujoco><compiler angle="{unit}" eulerseq="{sequence}"/><worldbody><frame pos="{x}" {turns[0]}>'
        f'<body name="a" {turns[1]} pos="{y}"><joint name="j" axis="1 2 -1" pos="{z}" ref="0.5"/>{geom}'
        f'<body name="b" pos="{z}" {turns[2]}><joint name="k" type="slide" axis="0 1 1"/>{geom}</body>'
        "</body></frame></worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = np.random.default_rng(seed).uniform(-2, 2, 2)
    mujoco.mj_forward(model, data)
    poses = find_link_poses(parse_mjcf(text, snap=0.0), data.qpos)
    for name, pose in zip("ab", poses, strict=True):
        np.testing.assert_allclose(pose.translation, data.body(name).xpos, rtol=0, atol=1e-11)
        np.testing.assert_allclose(pose.rotation.ravel(), data.body(name).xmat, rtol=0, atol=1e-12)


def test_angles_below_a_billionth_are_taken_as_rounding():
    """An axis that is 2e-10 rad from a right angle counts as at one, as in URDFs; but nothing moves for 0."""
    text = (
        '<mujoco><worldbody><body name="a"><joint axis="1 2 -1"/><geom size="0.1"/>'
        '<body name="b" quat="2.4e-05 1 1 0"><joint type="slide" axis="0 1 1"/><geom size="0.1"/></body>'
        "</body></worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for snap, least, most in ((1e-9, 1e-11, 1e-9), (0.0, 0.0, 1e-14)):
        pose = find_link_poses(parse_mjcf(text, snap=snap), np.zeros(2))[1]
        assert least <= np.abs(pose.rotation.ravel() - data.body("b").xmat).max() < most
