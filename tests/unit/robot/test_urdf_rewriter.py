"""URDFs with other values: all else stays, and what symid and Pinocchio read in them is the new values."""

import dataclasses
import re

import numpy as np
import pinocchio as pin
import pytest

from symid.joint_models import FrictionValues
from symid.robot.urdf_reader import parse_urdf
from symid.robot.xml_writers import rewrite_urdf
from tests.chains import PANDA, build_pinocchio, draw_parameters
from tests.urdfs import draw_urdf, find_torques, write_odd_urdf

FILE = """<?xml version="1.0"?>
<!-- our arm -->
<robot name="arm">
  <link name="world">
    <inertial><mass value="50"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <link name="upper" note="a > b"><!-- </link> is no end -->
    <visual><geometry><mesh filename="upper.stl"/></geometry></visual>
    <inertial>
      <origin xyz="0.1 0 0"/>
      <mass value="2"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>
    </inertial>
  </link>
  <joint name="base" type="revolute">
    <parent link="world"/>
    <child link="upper"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/>
    <dynamics damping="0.5" friction="0.25"/>
  </joint>
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
  <transmission name="t">
    <type>SimpleTransmission</type>
    <joint name="elbow"/>
    <actuator name="m"><mechanicalReduction>20</mechanicalReduction>
      <motorInertia>1e-4</motorInertia></actuator>
  </transmission>
</robot>
"""


def give_values(robot, seed=1):
    bodies = draw_parameters(np.random.default_rng(seed), robot.size).tolist()
    joints = (
        dataclasses.replace(joint, inertial=tuple(body))
        for joint, body in zip(robot.joints, bodies, strict=True)
    )
    return dataclasses.replace(robot, joints=tuple(joints))


@pytest.fixture
def rewritten():
    robot = give_values(parse_urdf(FILE))
    first, second = robot.joints
    friction = FrictionValues(law="coulomb-viscous-offset", values=(1.5, 0.75, 0.1))
    first = dataclasses.replace(first, friction=friction)
    second = dataclasses.replace(
        second,
        friction=FrictionValues(law="coulomb-viscous", values=(0.3, 0.2)),
        drive=dataclasses.replace(second.drive, rotor_inertia=0.08),
    )
    robot = dataclasses.replace(robot, joints=(first, second))
    return robot, rewrite_urdf(FILE, robot, comments=("by hand -- of us",))


def test_the_new_values_are_read(rewritten):
    robot, text = rewritten
    back = parse_urdf(text)
    for old, new in zip(robot.joints, back.joints, strict=True):
        assert (new.name, new.placement, new.frame, new.limits) == (
            old.name,
            old.placement,
            old.frame,
            old.limits,
        )
        np.testing.assert_allclose(new.inertial, old.inertial, rtol=0, atol=1e-12)
    assert back.joints[0].friction.values == (1.5, 0.75)
    assert back.joints[1].friction.values == (0.3, 0.2)
    assert back.joints[1].drive.rotor_inertia == pytest.approx(0.08)


def test_all_else_stays(rewritten):
    _, text = rewritten
    values = re.compile(
        r"\s*(<inertial>.*?</inertial>|<dynamics[^>]*>|<motorInertia>.*?</motorInertia>)", re.DOTALL
    )
    comments = re.compile(r"\n  <!-- (by hand|joint ).*?-->")
    left = comments.sub("", values.sub("", text)).replace(
        '<link name="lower">\n  </link>', '<link name="lower"/>'
    )
    assert left == values.sub("", FILE)
    assert "<!-- by hand - - of us -->" in text
    assert "friction model coulomb-viscous-offset, values 1.5 0.75 0.1" in text
    # What stands still keeps its values, what is carried gives its own away.
    assert text.count("<inertial>") == 3
    assert '<mass value="50"/>' in text
    assert '<mass value="0.7"/>' not in text
    assert "\n\n" not in text


@pytest.mark.parametrize("seed", range(6))
def test_random_trees_come_back(seed):
    text, _ = draw_urdf(np.random.default_rng(seed), 8)
    robot = give_values(parse_urdf(text), seed)
    back = parse_urdf(rewrite_urdf(text, robot))
    for old, new in zip(robot.joints, back.joints, strict=True):
        assert (new.placement, new.mimic) == (old.placement, old.mimic)
        scale = max(map(abs, old.inertial))
        np.testing.assert_allclose(new.inertial, old.inertial, rtol=0, atol=1e-10 * scale)


def test_pinocchio_reads_the_new_values_in_odd_frames():
    rows = [
        (0, 0, "0.333", "q"),
        (-90, 0, 0, "q"),
        (90, 0, "0.316", "q"),
        (90, "0.0825", 0, "q"),
        (-90, "-0.0825", "0.384", "q"),
        (90, 0, 0, "q"),
        (90, "0.088", 0, "q"),
    ]
    axes = ["0 0 1", "1 0 0", "0 1 0", "0 0 -1", "0 -1 0", "1 1 0", "1 0 0"]
    text = write_odd_urdf(
        rows, [30, 0, 90, 45, 0, -60, 0], ["0.1", "0", "0.25", "0", "-0.05", "0", "0.3"], axes
    )
    robot = give_values(parse_urdf(text))
    theirs = pin.buildModelFromXML(rewrite_urdf(text, robot))
    # Built from the placements alone, without the text.
    assert [joint.kind for joint in robot.joints] == [joint.kind for joint in PANDA.joints]
    ours = build_pinocchio(robot, np.array([joint.inertial for joint in robot.joints]))
    state = np.random.default_rng(2).uniform(-2, 2, (3, 7))
    expected = pin.rnea(ours, ours.createData(), *state)
    np.testing.assert_allclose(find_torques(theirs, robot, state), expected, rtol=1e-9, atol=1e-9)


def test_elements_are_found_behind_comments_and_data():
    text = (
        '<robot name="r"><link name="a"/><link name="b"><note><![CDATA[</link>]]></note><!-- </link> -->'
        '<inertial><mass value="1"/></inertial></link><joint name="j" type="prismatic"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/><dynamics damping="1"><?x </dynamics>?></dynamics>'
        "</joint></robot>"
    )
    robot = give_values(parse_urdf(text))
    joint = dataclasses.replace(
        robot.joints[0], friction=FrictionValues(law="coulomb-viscous", values=(2.0, 0.0))
    )
    found = rewrite_urdf(text, dataclasses.replace(robot, joints=(joint,)))
    back = parse_urdf(found)
    assert back.joints[0].friction.values == (2.0, 0.0)
    np.testing.assert_allclose(back.joints[0].inertial, joint.inertial, atol=1e-12)
    assert found.endswith('<dynamics damping="2.0" friction="0.0"/></joint></robot>')
