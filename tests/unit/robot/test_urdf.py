"""URDFs that are right: what the robot holds, and what is said about the rest."""

from operator import attrgetter

import numpy as np
import pytest

from symid.robot.description import Drive, JointKind, Limits, Processing
from symid.robot.geometry import Exact, compose_placements, translate
from symid.robot.mjcf_reader import parse_xml_robot, read_xml_robot
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.mistakes import find_text

ARM = """<?xml version="1.0"?>
<robot name="my arm" version="1.0">
  <material name="grey"/>
  <link name="base"><visual/></link>
  <link name="upper">
    <visual/><collision/>
    <inertial>
      <origin xyz="0.1 0 0.02" rpy="0 0 1.5707963267948966"/>
      <mass value="2"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.025"/>
    </inertial>
  </link>
  <link name="slide">
    <inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <link name="tool">
    <inertial><origin xyz="0 0 0.1"/><mass value="0.5"/>
      <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>
  </link>
  <joint name="lift" type="revolute">
    <parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.3" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" velocity="3" effort="40"/>
    <dynamics damping="0.5" friction="0.2" armature="1"/>
    <safety_controller k_velocity="1"/>
  </joint>
  <joint name="push" type="prismatic">
    <parent link="upper"/><child link="slide"/>
    <origin xyz="0.25 0 0"/>
    <axis xyz="1 0 0"/>
    <limit effort="0" velocity="inf"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="slide"/><child link="tool"/><origin xyz="0 0 0.05"/><axis xyz="0 0 0"/>
  </joint>
  <transmission name="t">
    <type>transmission_interface/SimpleTransmission</type>
    <joint name="lift"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
    <actuator name="motor"><mechanicalReduction>50</mechanicalReduction>
      <motorInertia>1e-4</motorInertia></actuator>
  </transmission>
</robot>
"""


@pytest.fixture
def arm():
    return parse_xml_robot(ARM, "arm.urdf")


def list_codes(robot):
    return [notice.code for notice in robot.notices]


def test_joints_and_their_numbers(arm):
    lift, push = arm.joints
    assert (lift.name, lift.kind, lift.parent) == ("lift", JointKind.REVOLUTE, -1)
    assert (push.name, push.kind, push.parent) == ("push", JointKind.PRISMATIC, 0)
    assert lift.limits.position == (-1.0, 2.0)
    assert (lift.limits.velocity, lift.limits.torque) == (3.0, 40.0)
    assert (push.limits.velocity, push.limits.torque, push.limits.position) == (None, None, None)
    assert lift.friction.law == "coulomb-viscous"
    assert lift.friction.values == (0.5, 0.2)
    assert push.friction.law == "none"
    assert (lift.drive.gear, lift.drive.has_rotor) == (50.0, True)
    assert lift.drive.rotor_inertia == pytest.approx(1e-4 * 2500)
    assert (arm.convention, arm.path, arm.source) == ("urdf", "arm.urdf", "my arm")
    assert arm.gravity == (Exact(), Exact(), Exact.of("-9.81"))


def test_what_is_not_used_is_listed_with_its_place(arm):
    looks = "not used, and not needed for the dynamics: <material>, <visual> (2), <collision>"
    assert [str(notice) for notice in arm.notices if notice.code == "robot.urdf-unused"] == [
        'arm.urdf:2:31: not used: attribute version="..." of <robot> (once, line 2)',
        f"arm.urdf:3:3: {looks}",
        'arm.urdf:25:54: not used: attribute armature="..." of <dynamics> (once, line 25)',
        "arm.urdf:26:5: not used: <safety_controller> in <joint> (once, line 26)",
        "arm.urdf:35:71: not used: <axis> of a fixed joint (once, line 35)",
    ]


def test_read_urdf_reads_a_file(tmp_path, arm):
    path = tmp_path / "arm.urdf"
    path.write_text("\ufeff" + ARM, encoding="utf-8")
    assert read_xml_robot(path).joints == arm.joints


def build(joints, links=("a", "b", "c", "d"), extra=""):
    """Return a URDF from joint elements; link names are single letters."""
    elements = "".join(f'<link name="{name}"/>' for name in links)
    return f'<robot name="r">{elements}{joints}{extra}</robot>'


def joint(name, parent, child, inner="", type_="continuous", *, origin="", axis="0 0 1"):
    where = f"<origin {origin}/>" if origin else ""
    direction = f'<axis xyz="{axis}"/>' if axis else ""
    return (
        f'<joint name="{name}" type="{type_}"><parent link="{parent}"/><child link="{child}"/>'
        f"{where}{direction}{inner}</joint>\n"
    )


def write_one(inner="", type_="continuous", extra="", **options):
    """Return a URDF of one joint."""
    return build(joint("j", "a", "b", inner, type_, **options), "ab", extra)


def transmission(inner):
    return f'<transmission name="t"><joint name="j"/><actuator name="m">{inner}</actuator></transmission>'


GEAR = transmission('<drake:gear_ratio value="3"/><drake:rotor_inertia value="0.5"/>')
ALIKE = transmission("<motorInertia>2</motorInertia><rotorInertia>2.0</rotorInertia>")


def test_rotations_are_snapped_with_a_remark_and_not_with_snap_zero():
    text = build(joint("j", "a", "b", origin='rpy="1.5708 0 0" xyz="0 1e-12 0.5"'), "ab")
    robot = parse_xml_robot(text)
    assert [str(row[2]) for row in robot.joints[0].placement.rotation] == ["0", "-1", "0"]
    assert "'j' (3.7e-06)" in find_text(robot, "robot.angle-snapped")
    assert "'j'" in find_text(robot, "robot.length-snapped")
    free = parse_xml_robot(text, snap=0)
    assert free.joints[0].placement.rotation[1][2].to_float() == pytest.approx(-np.sin(1.5708), abs=1e-15)
    assert free.joints[0].placement.rotation[2][2]
    assert "robot.angle-snapped" not in list_codes(free)


@pytest.mark.parametrize(
    "inner", ['<mimic joint="first" multiplier="0" offset="0.5"/>', '<mimic joint="still" offset="0.5"/>']
)
def test_followers_of_what_stands_still_stand_still(inner):
    joints = (
        joint("first", "a", "b") + joint("still", "b", "c", type_="fixed") + joint("last", "c", "d", inner)
    )
    robot = parse_xml_robot(build(joints))
    assert [entry.name for entry in robot.joints] == ["first"]
    assert "'last'" in find_text(robot, "robot.follower-still")


def link(name, mass, inertia="<inertia ixx='1' iyy='1' izz='1'/>"):
    return f"<link name='{name}'><inertial><mass value='{mass}'/>{inertia}</inertial></link>"


TREE = build(
    joint("left", "a", "b")
    + joint("right", "a", "c")
    + joint("rightmost", "c", "d", type_="fixed")
    + joint("beyond", "c", "e", '<mimic joint="left"/>'),
    "abcde",
)


def test_a_chain_is_cut_out():
    robot = parse_xml_robot(TREE, tip="e")
    assert [entry.name for entry in robot.joints] == ["right", "beyond"]
    text = find_text(robot, "robot.cut-off")
    assert "links b (0 kg" in text
    # What the follower followed is gone; d is fixed to a link of the chain and stays.
    assert "'beyond'" in find_text(robot, "robot.follower-free")
    assert robot.joints[1].mimic is None
    assert "d" in find_text(robot, "robot.lumped")
    assert [entry.name for entry in parse_xml_robot(TREE, tip="c").joints] == ["right"]
    assert [entry.name for entry in parse_xml_robot(TREE, base="c").joints] == ["beyond"]


def test_the_frame_of_a_fixed_tip_is_that_of_the_last_link(arm):
    robot = parse_xml_robot(ARM, tip="tool")
    assert [joint.inertial for joint in robot.joints] == [joint.inertial for joint in arm.joints]
    moved = compose_placements(arm.joints[-1].frame, translate(Exact(), Exact(), Exact.of("0.05")))
    assert robot.joints[-1].frame == moved


def test_a_floating_joint_may_stand_before_the_base_and_gravity_is_turned_into_its_frame():
    joints = joint("free", "a", "b", type_="floating") + joint("j", "b", "c")
    assert parse_xml_robot(build(joints, "abc"), base="b").size == 1
    joints = joint("m", "a", "b", type_="fixed", origin='rpy="1.5707963267948966 0 0"') + joint("j", "b", "c")
    robot = parse_xml_robot(build(joints, "abc"), base="b")
    assert [str(value) for value in robot.gravity] == ["0", "-981/100", "0"]
    assert "at 0" in find_text(robot, "robot.assumed-gravity")


@pytest.mark.parametrize(("given", "name"), [("7dof", "robot_7dof"), ("Ärm-1", "rm_1"), ("", "some")])
def test_names_become_identifiers(given, name):
    text = build(joint("j", "a", "b"), "ab").replace('name="r"', f'name="{given}"')
    assert parse_xml_robot(text, "some.urdf").name == name


def test_a_joint_called_base_gets_another_name():
    joints = joint("base", "a", "b") + joint("base_joint", "b", "c", '<mimic joint="base"/>')
    robot = parse_xml_robot(build(joints, "abc"))
    assert [entry.name for entry in robot.joints] == ["base_joint_", "base_joint"]
    assert "'base_joint_'" in find_text(robot, "robot.renamed")
    assert parse_robot(write_robot(robot)).joints[0].name == "base_joint_"


def test_axes_that_are_nearly_parallel_leave_the_frames_at_the_robot():
    steps = joint("i", "a", "b") + joint("j", "b", "c", origin='xyz="0.3 0.2 0" rpy="1e-4 0 0"')
    robot = parse_xml_robot(build(steps, "abc"))
    assert all(abs(value.to_float()) < 1 for entry in robot.joints for value in entry.frame.translation)
    assert "of joints (by rad) 'j' (1.0e-04)" in find_text(robot, "robot.nearly-parallel")
    straight = parse_xml_robot(build(steps.replace("1e-4", "0"), "abc"))
    assert "robot.nearly-parallel" not in list_codes(straight)


STANDING = (
    joint("m", "a", "b")
    + joint("f", "b", "c", '<mimic joint="m" multiplier="2" offset="1.5707963267948966"/>', axis="1 0 0")
    + joint("j", "c", "d")
    + joint("g", "d", "e", '<mimic joint="m" multiplier="3" offset="0.25"/>')
)


def test_followers_of_a_joint_before_the_base_stand_still_at_their_offset():
    robot = parse_xml_robot(build(STANDING, "abcde"), base="c")
    assert [str(value) for value in robot.gravity] == ["0", "-981/100", "0"]
    assert [entry.name for entry in robot.joints] == ["j"]
    text = find_text(robot, "robot.follower-still")
    assert "joints 'g': follow a joint before the base, and rest at their offset" in text
    assert robot.freedom == 1


TWO = joint("j", "a", "b") + joint("k", "b", "c")
SKEW = "<inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='5'/>"
LIMIT = '<limit {} effort="1" velocity="1"/>'
UNUSED, LIMITS, ENDLESS = "robot.urdf-unused", "robot.bad-limits", "robot.endless-limits"
NO_ACTUATOR = '<transmission name="t"><joint name="j"/><joint name="k"/><actuator name="m"/></transmission>'
NOBODY = '<transmission name="u"><joint name="nobody"/><actuator name="m"/></transmission>'
# What is read, and what is told of it.
REMARKS = [
    (ARM, "robot.lumped", "tool"),
    (ARM, "robot.renamed", "arm.urdf:2:14: the robot is renamed to my_arm"),
    (ARM, "robot.assumed-gravity", "(0, 0, -9.81)"),
    (write_one(axis="0 2 1e-6"), "robot.axis-length", "length 2 "),
    (write_one(axis="0 2 1e-6"), "robot.axis-snapped", "(5.0e-07)"),
    (write_one(axis=""), "robot.default-axis", "x (1 0 0), of joints 'j'"),
    (write_one().replace('<axis xyz="0 0 1"/>', "<axis/>"), "robot.default-axis", "x (1 0 0)"),
    (build(TWO, "ab", link("c", 1)), "robot.massless", "'b'"),
    (build(TWO, "ab", link("c", 1)), "robot.incomplete-inertia", "ixy, ixz, iyz missing"),
    (
        build(joint("f", "a", "c", type_="fixed") + joint("j", "c", "b"), "ab", link("c", 7)),
        "robot.fixed-to-base",
        "base: c;",
    ),
    (build(joint("j", "a", "b"), "a", link("b", 1, SKEW)), "robot.impossible-inertia", "kg*m^2"),
    (build(TWO, "ab", link("c", 0, SKEW)), "robot.inertia-without-mass", "'c'"),
    (build(joint("j", "a", "b"), "a", link("b", 1, "")), "robot.point-mass", "'b'"),
    (build(TWO, "abc", NO_ACTUATOR), UNUSED, "one actuator"),
    (build(TWO, "abc", NOBODY), UNUSED, "not in the"),
    (write_one(LIMIT.format('lower="2" upper="1"'), "revolute"), LIMITS, "lower 2 "),
    (write_one(LIMIT.format('lower="-3" upper="3"')), UNUSED, "<limit> of a continuous"),
    (write_one('<limit effort="0" velocity="-2"/>'), LIMITS, "limit velocity negative, so that none is kept"),
    (write_one('<limit lower="-inf" upper="0.1"/>', "prismatic"), ENDLESS, "infinite"),
    (write_one('<limit lower="0" upper="Infinity"/>', "prismatic"), ENDLESS, "arm.urdf:1:1"),
    (write_one('<dynamics damping="-1"/>'), "robot.negative-friction", "dynamics "),
    (write_one(origin='rpy="90 0 0"'), "robot.large-angle", "14.3 turns"),
    (write_one(origin='xyz="0 0 300"'), "robot.long-length", "300 m"),
    (write_one('<limit lower="-170" upper="170"/>', "revolute"), "robot.large-angle", "limit: 170 rad"),
    (write_one("speed<limit>5</limit>"), UNUSED, 'the text "speed" in <joint> (once, line 1)'),
    (write_one("<limit>5</limit>"), UNUSED, 'the text "5" in <limit> (once, line 1)'),
]


@pytest.mark.parametrize(("text", "code", "words"), REMARKS)
def test_what_is_assumed_or_not_used_is_said(text, code, words):
    robot = parse_xml_robot(text, "arm.urdf")
    assert words in find_text(robot, code)
    places = [(notice.line, notice.column) for notice in robot.notices]
    assert places == sorted(places)


@pytest.mark.parametrize(
    ("inner", "type_", "extra", "field", "expected"),
    [
        (LIMIT.format('lower="2" upper="1"'), "revolute", "", "limits.position", None),
        (LIMIT.format('lower="-3" upper="3"'), "continuous", "", "limits.position", None),
        ('<limit upper="inf"/>', "prismatic", "", "limits.position", None),
        ('<limit lower="-170" upper="170"/>', "prismatic", "", "limits.position", (-170.0, 170.0)),
        ('<limit effort="0" velocity="-2"/>', "continuous", "", "limits", Limits()),
        ('<dynamics damping="-1"/>', "continuous", "", "friction.values", (-1.0, 0.0)),
        ("", "continuous", "", "inertial", None),
        ("", "continuous", GEAR, "drive", Drive(gear=3.0, has_rotor=True, rotor_inertia=4.5)),
        # Two that agree are one.
        ("", "continuous", ALIKE, "drive", Drive(has_rotor=True, rotor_inertia=2.0)),
    ],
)
def test_values_of_a_joint(inner, type_, extra, field, expected):
    (found,) = parse_xml_robot(write_one(inner, type_, extra)).joints
    assert attrgetter(field)(found) == expected


def test_the_description_says_what_was_read_and_a_log_is_filtered_by_itself():
    robot = parse_xml_robot(build(joint("j", "a", "b"), "ab"), "somewhere/arm.urdf", tip="b")
    assert robot.processing == Processing(automatic=True)
    assert robot.description == "from the URDF arm.urdf, whose link a is the base, b the tip"
