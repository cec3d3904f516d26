"""MJCF models that others wrote, and one that uses all of the format: the torques are those of MuJoCo.

Tolerances are relative to the largest torque of all states. Dry friction is a soft constraint in MuJoCo, and
its force the stated one beyond a small speed; these states are well beyond it.
"""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import symid
from symid.codegen import build_casadi_function
from symid.robot.description import JointKind, Robot
from symid.robot.mjcf_reader import read_xml_robot
from symid.robot.simulator_writers import write_mjcf
from tests.chains import build_transmission, fold, spread
from tests.mistakes import find_text
from tests.mujocos import build_model, find_mujoco_torques, parse_mjcf

mujoco = pytest.importorskip("mujoco", reason="wants the package mujoco")

GEARS, UNEVEN = "robot.two-gears", "robot.uneven-limits"
OWN = Path(__file__).parents[2] / "data" / "robots" / "gripper_arm.xml"
FOREIGN = ("reacher", "pusher_v5", "inverted_pendulum", "inverted_double_pendulum", "point")
CLOSE, CLOSE_DRY = 1e-10, 1e-8
OFFSETS = {"right_slide": 0.002 - 0.75 * 0.01}
"""Of followers: joint1 - ref1 = c0 + c1 (joint2 - ref2)."""


def locate_model(name):
    """Return the path of a model of gymnasium, which is not imported; skip where it is missing."""
    if name == OWN.stem:
        return OWN
    found = importlib.util.find_spec("gymnasium")
    if found is None:
        pytest.skip(f"{name}.xml is one of the package gymnasium, which is not installed")
    return Path(found.origin).parent / "envs" / "mujoco" / "assets" / f"{name}.xml"


def load_mujoco(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    # Forces of a medium are not in a robot; the reader says so.
    model.opt.density = model.opt.viscosity = 0.0
    return model


def drop_dry_friction(robot):
    def drop(entry):
        values = entry.friction.values and (entry.friction.values[0], 0.0)
        return replace(entry, friction=replace(entry.friction, values=values))

    joints, couplings = (tuple(map(drop, entries)) for entries in (robot.joints, robot.couplings))
    return replace(robot, joints=joints, couplings=couplings)


def find_torques(robot, states):
    """Return the torques (n, samples) of symid's own functions, with the values of the robot's file."""
    q, dq, ddq = (array.T for array in np.moveaxis(states, 1, 0))
    numbers = {"standard": False, "constant": True}
    total = np.array(build_casadi_function(robot, "inverse_dynamics", **numbers)(q, dq, ddq))
    if any(part.friction.values for part in (*robot.joints, *robot.couplings)):
        total += np.array(build_casadi_function(robot, "friction", **numbers)(dq))
    return total


def find_theirs(model, robot, states, *, dry=False):
    """Return MuJoCo's torques (n, samples), projected onto the coordinates of symid."""
    names, columns = [joint.name for joint in robot.joints], []
    for state in states:
        joints = np.array([spread(robot, row) for row in state])
        joints[0] += [OFFSETS.get(name, 0.0) for name in names]
        columns.append(fold(robot, find_mujoco_torques(model, names, joints, dry=dry)))
    return np.array(columns).T


@pytest.mark.parametrize("name", [*FOREIGN, OWN.stem])
def test_torques_are_those_of_mujoco(name):
    path = locate_model(name)
    robot = drop_dry_friction(read_xml_robot(path))
    states = np.random.default_rng(1).uniform(-2, 2, (100, 3, robot.freedom))
    theirs = find_theirs(load_mujoco(path), robot, states)
    # Rotors and damping of the file count in both.
    assert (
        any(joint.drive.rotor_inertia or joint.friction.values for joint in robot.joints) or name == "point"
    )
    assert np.abs(find_torques(robot, states) - theirs).max() <= CLOSE * np.abs(theirs).max()


@pytest.mark.parametrize("name", [OWN.stem])
def test_dry_friction_is_that_of_mujocos_solver(name):
    path = locate_model(name)
    robot, rng = read_xml_robot(path), np.random.default_rng(2)
    states = rng.uniform(-1, 1, (40, 3, robot.freedom))
    states[:, 1] = rng.choice([-1, 1], states[:, 1].shape) * rng.uniform(1, 3, states[:, 1].shape)
    speeds = states[:, 1] @ build_transmission(robot)[-1]
    states = states[np.abs(speeds) > 0.5]
    theirs = find_theirs(load_mujoco(path), robot, states, dry=True)
    ours = find_torques(robot, states)
    assert np.abs(ours - theirs).max() <= CLOSE_DRY * np.abs(theirs).max()
    without = find_torques(drop_dry_friction(robot), states)
    assert np.abs(without - theirs).max() > 1e-3 * np.abs(theirs).max()


def test_what_stands_on_a_base_body_is_that_part_of_the_whole():
    part = read_xml_robot(OWN, base="upper", tip="left")
    names = [joint.name for joint in part.joints]
    assert names == ["elbow", "bend", "left_slide"]
    assert {"robot.cut-off"} <= set(codes(part))
    spec = mujoco.MjSpec.from_file(str(OWN))
    spec.delete(spec.equalities[0])
    spec.delete(spec.body("right"))
    model = spec.compile()
    # What comes before stands at zero.
    every = ["turn", "lift", "roll", *names]
    states = np.zeros((20, 3, 6))
    states[:, :, 3:] = np.random.default_rng(3).uniform(-2, 2, (20, 3, 3))
    theirs = np.array([find_mujoco_torques(model, every, state)[3:] for state in states]).T
    ours = find_torques(drop_dry_friction(part), states[:, :, 3:])
    assert np.abs(ours - theirs).max() <= CLOSE * np.abs(theirs).max()


def test_limits_gears_and_classes_are_read():
    robot = read_xml_robot(OWN)
    joints = {joint.name: joint for joint in robot.joints}
    assert [joint.drive.gear for joint in robot.joints] == [50, 80, -30, 100, 1, 1, 1]
    torques = {name: joint.limits.torque for name, joint in joints.items() if joint.limits.torque}
    # A motor's control is its force; the joint's own limit comes before that of its actuator.
    assert torques == {"turn": 100.0, "lift": 120.0, "elbow": 60.0}
    np.testing.assert_allclose(joints["elbow"].limits.position, np.radians([-120, 120]))
    assert joints["left_slide"].limits.position == (0.0, 0.04)
    assert joints["roll"].limits.position is None
    assert joints["left_slide"].kind is JointKind.PRISMATIC
    assert joints["bend"].drive.rotor_inertia == 0.02
    assert joints["roll"].friction.values == (0.8, 0.0)
    assert (joints["roll"].inertial is None, any(joints["lift"].inertial)) == (False, False)
    assert [value.to_float() for value in robot.gravity] == [0.5, -0.25, -9.8]
    assert (robot.convention, robot.path, robot.source) == ("mjcf", str(OWN), "gripper arm")
    (unused,) = [notice for notice in robot.notices if notice.code == UNUSED]
    assert unused.is_note
    assert "<sensor>, meshdir of <compiler>, <light>, <geom> (8), <site>" in unused.text


def test_a_model_is_loaded_by_its_content(tmp_path):
    text = write_mjcf(read_xml_robot(OWN))
    for name in ("arm.xml", "arm.mjcf", "arm.urdf", "arm"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        robot = symid.load(tmp_path / name)
        assert (robot.description.convention, len(robot.joints), robot.path.name) == ("mjcf", 6, name)
    draft = symid.new_robot(urdf=tmp_path / "arm.mjcf", options=symid.DraftOptions(tip="elbow_link"))
    assert draft.text.count("[[joint]]") == 4


ONE = '<geom size="0.1"/>'


def codes(robot):
    return [notice.code for notice in robot.notices]


def test_models_without_names_are_read():
    robot = parse_mjcf(
        build_model(f"<body><joint/><joint axis='1 0 0'/>{ONE}<body><joint/>{ONE}</body></body>")
    )
    assert [joint.name for joint in robot.joints] == ["body1_joint1", "body1_joint2", "body2_joint"]
    assert robot.name == "robot"


def test_bodies_without_any_inertia_are_unknown():
    robot = parse_mjcf(build_model("<body><joint name='a'/><joint name='b'/></body>"))
    assert [joint.inertial for joint in robot.joints] == [(0.0,) * 10, None]
    robot = parse_mjcf(build_model(f"<body name='x'><joint/><body><joint/>{ONE}</body></body>"))
    assert robot.joints[0].inertial == (0.0,) * 10
    assert "robot.massless" in codes(robot)


FORCES, UNUSED = "robot.mjcf-forces", "robot.mjcf-unused"
SHARED = "<tendon><fixed stiffness='3'><joint joint='j' coef='1'/></fixed></tendon>"
SKEW = "<inertial pos='0 0 0' mass='1' diaginertia='1 1 3'/>"
TURNED = "euler was moved to a multiple of pi/2, keep it by --snap 0, of bodies (by rad) 'b' (1.7e-06)"


@pytest.mark.parametrize(
    ("code", "part", "words"),
    [
        (FORCES, "<option density='1.2' viscosity='1e-5'/>", "option density"),
        ("robot.mjcf-flag", "<option><flag damper='disable'/></option>", "damper"),
        (FORCES, "<body gravcomp='1'><joint name='k'/><geom size='1'/></body>", "gravcomp"),
        (FORCES, SHARED, "stiffness of a tendon"),
        (FORCES, "<tendon><spatial damping='3'><site site='s'/></spatial></tendon>", "<spatial> tendon"),
        (GEARS, "<actuator><motor joint='j' gear='2'/><motor joint='j' gear='3'/></actuator>", "'j'"),
        (UNEVEN, "<body><joint name='k' actuatorfrcrange='-2 3'/><geom size='1'/></body>", "'k'"),
        ("robot.negative-friction", "<body><joint damping='-2'/><geom size='1'/></body>", "drives"),
        ("robot.impossible-inertia", f"<body name='b'><joint/>{SKEW}</body>", "3 kg*m^2"),
        ("robot.angle-snapped", "<body name='b' euler='0 90.0001 0'><joint/><geom size='1'/></body>", TURNED),
        (UNUSED, "<body name='b'><geom size='1'/></body>", "<geom> (2)"),
        (UNUSED, "<equality><weld body1='a' body2='b' active='false'/></equality>", "that is not active"),
        (UNUSED, "<contact/><keyframe/>", "<contact>, <keyframe>"),
    ],
)
def test_what_is_left_out_is_said(code, part, words):
    arm = f"<body><joint name='j'/>{ONE}</body>"
    text = build_model(arm + part) if part.startswith("<body") else build_model(arm, part)
    assert words in find_text(parse_mjcf(text), code)


def test_gravity_can_be_off():
    arm = f"<body><joint/>{ONE}</body>"
    robot = parse_mjcf(
        build_model(arm, "<option gravity='0 0 -9'/><option><flag gravity='disable'/></option>")
    )
    assert not any(robot.gravity)
    assert parse_mjcf(build_model(arm)).gravity == Robot(name="r", joints=robot.joints).gravity


def test_a_joint_without_a_second_one_is_held():
    body = f"<body><joint name='j'/>{ONE}<body name='b'><joint name='k' ref='10'/>{ONE}</body></body>"
    tail = "<equality><joint joint1='k' polycoef='0.25'/></equality>"
    robot = parse_mjcf(build_model(body, tail=tail))
    assert [joint.name for joint in robot.joints] == ["j"]
    assert {"robot.follower-still", "robot.lumped"} <= set(codes(robot))


def test_inertias_of_some_groups_come_from_geoms_alone():
    head = "<compiler inertiafromgeom='true' inertiagrouprange='1 2'/>"
    inertial = "<inertial pos='0 0 0' mass='5' diaginertia='1 1 1'/>"
    for geoms in ("<geom size='0.2' group='1'/><geom size='0.3'/>", "<geom size='0.3'/>"):
        text = build_model(f"<body name='b'><joint/>{inertial}{geoms}</body>", head)
        mass = mujoco.MjModel.from_xml_string(text).body("b").mass[0]
        assert parse_mjcf(text).joints[0].inertial[9] == pytest.approx(mass, rel=1e-12)


def test_a_coupled_drive_may_lose_joints():
    robot = read_xml_robot(OWN, tip="forearm")
    assert "joints that were cut off, 'bend'" in find_text(robot, "robot.coupling-cut")
    assert [len(coupling.terms) for coupling in robot.couplings] == [1]
