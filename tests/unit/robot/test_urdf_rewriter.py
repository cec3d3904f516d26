"""URDFs with other values: all else stays, and what symid and Pinocchio read in them is the new values."""

import re
from dataclasses import replace

import numpy as np
import pytest

from symid.joint_models import FrictionValues
from symid.robot.inertia import build_pseudo_inertias
from symid.robot.mjcf_reader import parse_xml_robot
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from symid.robot.xml_rewriters import rewrite_urdf
from tests.chains import PANDA, build_pinocchio, fill, find_pinocchio_torques
from tests.mistakes import refuse
from tests.urdfs import draw_urdf, find_torques, write_odd_urdf

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

FILE = """<?xml version="1.0"?>
<!-- our arm -->
<robot name="arm">
  <link name="world">
    <inertial><mass value="50"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <link name="upper" note="a > b"><!-- </link> is no end -->
    <visual><geometry><mesh filename="upper.stl"/></geometry></visual>
    <inertial><origin xyz="0.1 0 0"/><mass value="2"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
  </link>
  <joint name="base" type="revolute"><parent link="world"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/><dynamics damping="0.5" friction="0.25"/></joint>
  <link name="lower"/>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.5 0 0" rpy="0 0.3 0"/>
    <axis xyz="1 0 0"/></joint>
  <joint name="flange" type="fixed"><parent link="lower"/><child link="tool"/><origin xyz="0 0 0.2"/></joint>
  <link name="tool">
    <inertial>
      <mass value="0.7"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>
    </inertial>
    <collision><geometry><box size="1 1 1"/></geometry></collision>
  </link>
  <transmission name="t"><type>SimpleTransmission</type><joint name="elbow"/><actuator name="m">
    <mechanicalReduction>20</mechanicalReduction><motorInertia>1e-4</motorInertia></actuator></transmission>
</robot>
"""


@pytest.fixture
def rewritten():
    robot = fill(parse_xml_robot(FILE))
    first, second = robot.joints
    friction = FrictionValues(law="coulomb-viscous-offset", values=(1.5, 0.75, 0.1))
    first = replace(first, friction=friction)
    second = replace(
        second,
        friction=FrictionValues(law="coulomb-viscous", values=(0.3, 0.2)),
        drive=replace(second.drive, rotor_inertia=0.08),
    )
    robot = replace(robot, joints=(first, second))
    return robot, rewrite_urdf(FILE, robot)


NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def test_only_numbers_change_and_what_was_absent_comes_in(rewritten):
    _, found = rewritten
    assert (
        '<joint name="elbow" type="continuous">\n    <dynamics damping="0.3" friction="0.2"/><parent'
        in found.text
    )
    left = found.text.replace('\n    <dynamics damping="0.3" friction="0.2"/>', "")
    # The tool's centre of mass was its origin.
    head, tool = left.split('<link name="tool">')
    left = head + '<link name="tool">' + re.sub(r'\n *<origin xyz="[^"]*"/>', "", tool, count=1)
    assert NUMBER.sub("#", left) == NUMBER.sub("#", FILE)
    # The world stands still, and what a link carries keeps an inertia of its own.
    assert '<mass value="50"/>' in found.text
    assert '<mass value="0.7"/>' not in found.text
    assert found.shared == {"lower": ("tool",)}


def test_values_that_did_not_change_stay_as_they_are_written():
    text = FILE.replace('value="2"', 'value="+2.0e0"').replace("\n", "\r\n")
    robot = parse_xml_robot(text)
    assert rewrite_urdf(text, robot).text == text
    friction = FrictionValues(law="coulomb-viscous", values=(0.5, 1.0))
    first = replace(robot.joints[0], friction=friction)
    robot = replace(robot, joints=(first, *robot.joints[1:]))
    assert rewrite_urdf(text, robot).text == text.replace('friction="0.25"', 'friction="1.0"')


CARRIER = """<robot name="arm">
  <link name="world"/>
  <link name="arm">
    <inertial><!-- of steel --><origin rpy="0.1 0.2 -0.3" xyz="0.1 0 0"/><mass value="2"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0.01" izz="0.1"/></inertial>
  </link>
  <joint name="a" type="revolute"><parent link="world"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit effort="5" velocity="2" lower="-1" upper="1"/></joint>
  <link name="flange"/>
  <joint name="f" type="fixed"><parent link="arm"/><child link="flange"/>
    <origin xyz="0.4 0 0" rpy="0 0.4 0"/></joint>
  <link name="tool">
    <inertial><origin xyz="0.02 0 0.1"/><mass value="0.5"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.001"/></inertial>
  </link>
  <joint name="g" type="fixed"><parent link="flange"/><child link="tool"/>
    <origin xyz="0 0 0.1" rpy="1 0 0"/></joint>
  <link name="finger">
    <inertial><origin xyz="0 0 0"/><mass value="0.1"/>
      <inertia ixx="0.0001" ixy="0" ixz="0" iyy="0.0002" iyz="0" izz="0.0001"/></inertial>
  </link>
  <joint name="h" type="prismatic"><parent link="tool"/><child link="finger"/>
    <origin xyz="0 0.05 0.1" rpy="0 0 1"/>
    <axis xyz="0 1 0"/><limit effort="5" velocity="2" lower="0" upper="0.1"/></joint>
</robot>
"""


@pytest.mark.parametrize("tip", ["flange", "arm"])
def test_what_was_cut_off_is_part_of_the_link_that_carries_it(tip):
    """Pinocchio sums up what hangs on the link, the finger held at zero: the values of the robot."""
    robot = fill(parse_xml_robot(CARRIER, tip=tip))
    found = rewrite_urdf(CARRIER, robot)
    assert found.shared == {"arm": ("tool", "finger")}
    assert NUMBER.sub("#", found.text) == NUMBER.sub("#", CARRIER)
    model = pin.buildModelFromXML(found.text)
    whole = pin.buildReducedModel(model, [model.getJointId("h")], np.zeros(2)).inertias[1]
    ours = build_pinocchio(robot, np.array([robot.joints[0].inertial])).inertias[1]
    # The axis is z in both frames, but where the frame begins on it is free.
    height = -robot.joints[0].placement.translation[2].to_float()
    shift = pin.SE3(np.eye(3), np.array([0.0, 0.0, height]))
    np.testing.assert_allclose(shift.act(whole).matrix(), ours.matrix(), rtol=0, atol=1e-9)
    for link in ("arm", "tool", "finger"):
        part = re.search(rf'<link name="{link}">.*?</link>', found.text, re.DOTALL)[0]
        alone = parse_xml_robot(
            f'<robot name="r"><link name="w"/>{part}<joint name="j" type="revolute"><parent link="w"/>'
            f'<child link="{link}"/><limit effort="1" velocity="1" lower="0" upper="1"/></joint></robot>'
        )
        sizes = np.linalg.eigvalsh(build_pseudo_inertias(np.array([alone.joints[0].inertial]))[0])
        # The tool is flat: its least one is zero but for rounding.
        assert sizes[0] > -1e-14 * sizes[-1]


def test_flat_links_give_all_to_the_link_that_carries_them():
    text = FILE.replace(
        '<link name="lower"/>',
        '<link name="lower"><inertial><mass value="0"/>'
        '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>',
    )
    flat = re.compile(r'ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"')
    text = flat.sub('ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"', text)
    robot = fill(parse_xml_robot(text))
    back = parse_xml_robot(rewrite_urdf(text, robot).text)
    np.testing.assert_allclose(back.joints[1].inertial, robot.joints[1].inertial, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_random_trees_come_back(seed):
    text, _ = draw_urdf(np.random.default_rng(seed), 8)
    robot = fill(parse_xml_robot(text), seed)
    back = parse_xml_robot(rewrite_urdf(text, robot).text)
    for old, new in zip(robot.joints, back.joints, strict=True):
        assert (new.placement, new.mimic) == (old.placement, old.mimic)
        scale = max(map(abs, old.inertial))
        np.testing.assert_allclose(new.inertial, old.inertial, rtol=0, atol=1e-10 * scale)


def test_pinocchio_reads_the_new_values_in_odd_frames():
    rows = [(0, 0, "0.333"), (-90, 0, 0), (90, 0, "0.316"), (90, "0.0825", 0), (-90, "-0.0825", "0.384")]
    rows = [(*row, "q") for row in [*rows, (90, 0, 0), (90, "0.088", 0)]]
    axes = ["0 0 1", "1 0 0", "0 1 0", "0 0 -1", "0 -1 0", "1 1 0", "1 0 0"]
    text = write_odd_urdf(
        rows, [30, 0, 90, 45, 0, -60, 0], ["0.1", "0", "0.25", "0", "-0.05", "0", "0.3"], axes
    )
    robot = fill(parse_xml_robot(text))
    theirs = pin.buildModelFromXML(rewrite_urdf(text, robot).text)
    # Built from the placements alone, without the text.
    assert [joint.kind for joint in robot.joints] == [joint.kind for joint in PANDA.joints]
    state = np.random.default_rng(2).uniform(-2, 2, (3, 7))
    expected = find_pinocchio_torques(robot, state)
    np.testing.assert_allclose(find_torques(theirs, robot, state), expected, rtol=1e-9, atol=1e-9)


def test_elements_are_found_behind_comments_and_data():
    text = (
        '<robot name="r"><link name="a"/><link name="b"><note><![CDATA[</link>]]></note><!-- </link> -->'
        '<inertial><mass value="1"/></inertial></link><joint name="j" type="prismatic"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/><dynamics damping="1"><?x </dynamics>?></dynamics>'
        "</joint></robot>"
    )
    robot = fill(parse_xml_robot(text))
    joint = replace(robot.joints[0], friction=FrictionValues(law="coulomb-viscous", values=(2.0, 0.0)))
    found = rewrite_urdf(text, replace(robot, joints=(joint,))).text
    back = parse_xml_robot(found)
    assert back.joints[0].friction.values == (2.0, 0.0)
    np.testing.assert_allclose(back.joints[0].inertial, joint.inertial, atol=1e-12)
    changed = '<dynamics damping="2.0" friction="0.0"><?x </dynamics>?></dynamics></joint></robot>'
    assert found.endswith(changed)


def test_rounding_of_a_robot_file_changes_nothing():
    robot = parse_xml_robot(CARRIER, tip="flange")
    back = parse_robot(write_robot(robot))
    joints = (replace(old, inertial=new.inertial) for old, new in zip(robot.joints, back.joints, strict=True))
    robot = replace(robot, joints=tuple(joints))
    assert rewrite_urdf(CARRIER, robot).text == CARRIER


def test_a_rotor_is_written_by_the_reduction_of_the_file():
    robot = fill(parse_xml_robot(FILE))
    drive = replace(robot.joints[1].drive, gear=100.0, rotor_inertia=0.08)
    second = replace(robot.joints[1], drive=drive)
    text = rewrite_urdf(FILE, replace(robot, joints=(robot.joints[0], second))).text
    assert parse_xml_robot(text).joints[1].drive.rotor_inertia == pytest.approx(0.08)
    # A drive of two joints is none that readers take.
    double = FILE.replace('<joint name="elbow"/>', '<joint name="elbow"/><joint name="base"/>')
    found = rewrite_urdf(double, replace(robot, joints=(robot.joints[0], second))).text
    assert "<motorInertia>1e-4</motorInertia>" in found


def test_no_friction_is_written_as_none():
    robot = parse_xml_robot(FILE)
    first = replace(robot.joints[0], friction=FrictionValues())
    found = rewrite_urdf(FILE, replace(robot, joints=(first, robot.joints[1]))).text
    assert found == FILE.replace('damping="0.5" friction="0.25"', 'damping="0.0" friction="0.0"')


def test_a_robot_of_no_file_is_refused():
    notice = refuse(rewrite_urdf, FILE, replace(parse_xml_robot(FILE), made_from=None))[0]
    assert notice.code == "robot.not-made"
