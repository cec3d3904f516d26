"""URDFs that are right: what the robot holds, and what is said about the rest."""

import numpy as np
import pytest

from symid.robot.description import JointKind, Processing
from symid.robot.geometry import Exact, compose_placements, translate
from symid.robot.inertia import move_parameters
from symid.robot.mjcf_reader import parse_xml_robot, read_xml_robot
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.chains import to_matrix
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


def list_unused(robot):
    return [str(notice) for notice in robot.notices if notice.code == "robot.urdf-unused"]


def list_z(placement):
    """Return where the joint's axis points, in words."""
    return [str(row[2]) for row in placement.rotation]


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


def test_the_axis_is_z_and_the_frame_of_the_file_is_kept(arm):
    lift, push = arm.joints
    assert list_z(lift.placement) == ["0", "1", "0"]
    # The file's y axis is the joint's own z axis.
    assert [str(value) for value in lift.frame.rotation[2]] == ["0", "1", "0"]
    assert [str(value) for value in push.frame.rotation[2]] == ["1", "0", "0"]


def test_inertial_values_stand_about_the_link_frame_of_the_joint(arm):
    lift = arm.joints[0]
    # In the file's frame: the inertial frame is turned by 90 degrees about z, so xx and yy change places.
    expected = move_parameters((0.02, 0, 0, 0.01, 0, 0.025, 0, 0, 0, 2), np.eye(3), np.array([0.1, 0, 0.02]))
    frame = to_matrix(lift.frame)
    moved = move_parameters(expected, frame[:3, :3], frame[:3, 3])
    np.testing.assert_allclose(lift.inertial, moved, atol=1e-15)


def test_what_is_not_used_is_listed_with_its_place(arm):
    looks = "not used, and not needed for the dynamics: <material>, <visual> (2), <collision>"
    assert list_unused(arm) == [
        'arm.urdf:2:31: not used: attribute version="..." of <robot> (once, line 2)',
        f"arm.urdf:3:3: {looks}",
        'arm.urdf:25:54: not used: attribute armature="..." of <dynamics> (once, line 25)',
        "arm.urdf:26:5: not used: <safety_controller> in <joint> (once, line 26)",
        "arm.urdf:35:71: not used: <axis> of a fixed joint (once, line 35)",
    ]


def test_the_rest_is_said(arm):
    assert arm.name == "my_arm"
    # Fixed links are joined.
    assert arm.joints[1].inertial[9] == pytest.approx(1.5)
    assert "tool" in find_text(arm, "robot.lumped")
    assert find_text(arm, "robot.renamed").startswith("arm.urdf:2:14: the robot is renamed to my_arm")
    assert "(0, 0, -9.81)" in find_text(arm, "robot.assumed-gravity")
    assert "robot.bad-limits" not in list_codes(arm)
    places = [(notice.line, notice.column) for notice in arm.notices]
    assert places == sorted(places)


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


def read(inner="", type_="continuous", extra="", **options):
    """Return the robot of one joint."""
    return parse_xml_robot(build(joint("j", "a", "b", inner, type_, **options), "ab", extra))


def transmission(inner):
    return f'<transmission name="t"><joint name="j"/><actuator name="m">{inner}</actuator></transmission>'


def test_what_is_changed_of_an_axis_is_said():
    robot = read(axis="0 2 1e-6")
    assert "length 2 " in find_text(robot, "robot.axis-length")
    assert "5.00e-07 rad" in find_text(robot, "robot.axis-snapped")
    assert "'j'" in find_text(read(axis=""), "robot.default-axis")
    text = build(joint("j", "a", "b"), "ab").replace('<axis xyz="0 0 1"/>', "<axis/>")
    assert "x (1 0 0)" in find_text(parse_xml_robot(text), "robot.default-axis")


def test_rotations_are_snapped_with_a_remark_and_not_with_snap_zero():
    text = build(joint("j", "a", "b", origin='rpy="1.5708 0 0" xyz="0 1e-12 0.5"'), "ab")
    robot = parse_xml_robot(text)
    assert list_z(robot.joints[0].placement) == ["0", "-1", "0"]
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


def test_links_without_inertial_or_fixed_to_the_base_are_said():
    assert read().joints[0].inertial is None
    robot = parse_xml_robot(build(joint("j", "a", "b") + joint("k", "b", "c"), "ab", link("c", 1)))
    assert robot.joints[0].inertial == (0.0,) * 10
    assert "'b'" in find_text(robot, "robot.massless")
    assert "ixy, ixz, iyz missing" in find_text(robot, "robot.incomplete-inertia")
    text = build(joint("f", "a", "c", type_="fixed") + joint("j", "c", "b"), "ab", link("c", 7))
    assert "base: c;" in find_text(parse_xml_robot(text), "robot.fixed-to-base")


def test_odd_inertia_is_kept_and_said():
    skew = "<inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='5'/>"
    links = link("b", 1, skew) + link("c", 0, skew) + link("d", 1, "")
    text = build(joint("j", "a", "b") + joint("k", "b", "c") + joint("l", "c", "d"), "a", links)
    robot = parse_xml_robot(text)
    assert robot.joints[0].inertial[5] == 5
    assert "kg*m^2" in find_text(robot, "robot.impossible-inertia")
    assert "'c'" in find_text(robot, "robot.inertia-without-mass")
    assert "'d'" in find_text(robot, "robot.point-mass")


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


@pytest.mark.parametrize(
    ("parts", "drive"),
    [
        ('<drake:gear_ratio value="3"/><drake:rotor_inertia value="0.5"/>', (3.0, True, 4.5)),
        # Two that agree are one.
        ("<motorInertia>2</motorInertia><rotorInertia>2.0</rotorInertia>", (1.0, True, 2.0)),
    ],
)
def test_gear_and_rotor_may_be_written_otherwise(parts, drive):
    found = read(extra=transmission(parts)).joints[0].drive
    assert (found.gear, found.has_rotor, found.rotor_inertia) == drive


def test_transmissions_that_are_not_simple_are_listed():
    extra = '<transmission name="t"><joint name="j"/><joint name="k"/><actuator name="m"/></transmission>'
    extra += '<transmission name="u"><joint name="nobody"/><actuator name="m"/></transmission>'
    robot = parse_xml_robot(build(joint("j", "a", "b") + joint("k", "b", "c"), "abc", extra))
    assert any("one actuator" in text for text in list_unused(robot))
    assert any("not in the" in text for text in list_unused(robot))


@pytest.mark.parametrize(("given", "name"), [("7dof", "robot_7dof"), ("Ärm-1", "rm_1"), ("", "some")])
def test_names_become_identifiers(given, name):
    text = build(joint("j", "a", "b"), "ab").replace('name="r"', f'name="{given}"')
    assert parse_xml_robot(text, "some.urdf").name == name


@pytest.mark.parametrize(
    ("type_", "ends", "code", "words"),
    [
        ("revolute", 'lower="2" upper="1"', "robot.bad-limits", "lower 2 "),
        ("continuous", 'lower="-3" upper="3"', "robot.urdf-unused", "<limit> of a continuous"),
    ],
)
def test_joint_limits_that_make_no_range_are_not_used(type_, ends, code, words):
    robot = read(f'<limit {ends} effort="1" velocity="1"/>', type_)
    assert robot.joints[0].limits.position is None
    assert words in find_text(robot, code)


def test_friction_that_drives_is_doubted():
    robot = read('<dynamics damping="-1"/>')
    assert robot.joints[0].friction.values == (-1.0, 0.0)
    assert "dynamics " in find_text(robot, "robot.negative-friction")


@pytest.mark.parametrize("ends", ['lower="-inf" upper="0.1"', 'lower="0" upper="Infinity"', 'upper="inf"'])
def test_a_limit_that_is_infinite_is_none_and_no_zero(ends):
    robot = read(f"<limit {ends}/>", "prismatic")
    assert robot.joints[0].limits.position is None
    text = find_text(robot, "robot.endless-limits")
    assert "infinite" in text
    assert text.startswith("robot.urdf:1:1")


def test_limits_of_zero_mean_unknown_and_negative_ones_are_said():
    robot = read('<limit effort="0" velocity="-2"/>')
    assert (robot.joints[0].limits.torque, robot.joints[0].limits.velocity) == (None, None)
    assert "limit velocity negative, taken as unknown" in find_text(robot, "robot.bad-limits")


def test_large_numbers_are_doubted():
    robot = read(origin='rpy="90 0 0" xyz="0 0 300"')
    assert "14.3 turns" in find_text(robot, "robot.large-angle")
    assert "300 m" in find_text(robot, "robot.long-length")
    # Limits in degrees.
    for type_, said in (("revolute", True), ("prismatic", False)):
        robot = read('<limit lower="-170" upper="170"/>', type_)
        assert ("robot.large-angle" in list_codes(robot)) == said, type_


def test_text_between_tags_is_listed():
    robot = read("speed<limit>5</limit>")
    assert [text.partition("not used: ")[2] for text in list_unused(robot)] == [
        'the text "speed" in <joint> (once, line 1)',
        'the text "5" in <limit> (once, line 1)',
    ]


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
    assert "joints 'g': follow a joint before the base, and stand still at their offset" in text
    assert robot.freedom == 1


def test_the_description_says_what_was_read_and_a_log_is_filtered_by_itself():
    robot = parse_xml_robot(build(joint("j", "a", "b"), "ab"), "somewhere/arm.urdf", tip="b")
    assert robot.processing == Processing(automatic=True)
    assert robot.description == "from the URDF arm.urdf, whose link a is the base, b the tip"
