"""MJCF models with other values: all else stays, and what symid and MuJoCo read in them is the new values."""

import dataclasses
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from symid.errors import RobotError
from symid.joint_models import FrictionValues
from symid.robot.mjcf_rewriter import rewrite_mjcf
from symid.robot.xml_writers import write_mjcf
from tests.chains import draw_parameters
from tests.mujocos import find_mujoco_torques, parse_mjcf

FILE = """<?xml version="1.0"?>
<!-- our arm -->
<mujoco model="arm">
  <compiler angle="degree"/>
  <default>
    <joint damping="0.5"/>
    <default class="small">
      <joint damping='0.25' armature="0.01"/>
    </default>
  </default>
  <worldbody>
    <body name="column"><!-- </body> is no end -->
      <inertial pos="0 0 0" mass="50" diaginertia="1 1 1"/>
      <geom type="sphere" size="0.1" name="a > b"/>
      <body name="upper" pos="0 0 0.5" euler="0 30 0">
        <joint name="base" axis="0 1 0" range="-90 90" armature="0.1"  frictionloss='0.25' stiffness="4"/>
        <inertial mass="2"   pos="0.1 0 0" quat="0.9 0.1 0 0.1" diaginertia="0.1 0.08 0.05"/>
        <body name="cover">
          <inertial pos="0 0 0.2" mass="0.7" diaginertia="0.01 0.01 0.01"/>
          <geom type="box" size="0.1 0.1 0.1"/>
        </body>
        <body name="lower" pos="0.5 0 0" childclass="small">
          <joint name="elbow" axis="1 0 1"></joint>
          <inertial pos="0 0 0.1" mass="1" fullinertia="0.1 0.1 0.1 0 0 0"/>
          <body name="hand" pos="0 0 0.3">
            <joint name="twist" axis="0 0 1" ref="20"
                   springref="5" stiffness="2" />
            <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.02"/>
            <site name="tip"/>
            <body name="nail" pos="0 0 0.2"><geom size="0.01"/></body>
          </body>
          <body name="fin"><joint name="flap" axis="1 0 0"/>
            <inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon><fixed name="belt" damping="0.3"><joint joint="elbow" coef="2"/></fixed></tendon>
  <actuator><motor joint="base" gear="50"/></actuator>
  <keyframe><key qpos="0 0 0 0"/></keyframe>
</mujoco>
"""


def give_values(robot, seed=1):
    rng = np.random.default_rng(seed)
    bodies = draw_parameters(rng, robot.size).tolist()
    joints = tuple(
        dataclasses.replace(
            joint,
            inertial=tuple(body),
            friction=FrictionValues(law="coulomb-viscous", values=tuple(rng.uniform(0.1, 1, 2).tolist())),
            drive=dataclasses.replace(joint.drive, has_rotor=True, rotor_inertia=float(rng.uniform(0.1, 1))),
            spring=joint.spring and dataclasses.replace(joint.spring, stiffness=7.5, rest=0.125),
        )
        for joint, body in zip(robot.joints, bodies, strict=True)
    )
    friction = FrictionValues(law="coulomb-viscous", values=(0.4, 0.2))
    couplings = tuple(
        dataclasses.replace(entry, has_rotor=True, rotor_inertia=0.05, friction=friction)
        for entry in robot.couplings
    )
    return dataclasses.replace(robot, joints=joints, couplings=couplings)


def check_values(robot, back):
    for old, new in zip(robot.joints, back.joints, strict=True):
        assert (new.name, new.placement, new.frame) == (old.name, old.placement, old.frame)
        np.testing.assert_allclose(new.inertial, old.inertial, rtol=0, atol=1e-13)
        assert (new.friction, new.drive, new.mimic) == (old.friction, old.drive, old.mimic)
        if old.spring:
            assert new.spring.stiffness == old.spring.stiffness
            assert new.spring.rest == pytest.approx(old.spring.rest, abs=1e-14)
    assert back.couplings == robot.couplings


@pytest.fixture
def rewritten():
    robot = give_values(parse_mjcf(FILE, "robot.xml"))
    return robot, rewrite_mjcf(FILE, robot).text


def test_the_new_values_are_read(rewritten):
    robot, text = rewritten
    assert [joint.name for joint in robot.joints] == ["base_joint", "elbow", "twist", "flap"]
    check_values(robot, parse_mjcf(text))


def test_mujoco_finds_the_same_torques_as_in_a_new_model(rewritten):
    robot, text = rewritten
    models = [mujoco.MjModel.from_xml_string(entry) for entry in (text, write_mjcf(robot))]
    names = [joint.name for joint in robot.joints]
    for seed in range(5):
        state = np.random.default_rng(seed).uniform(-2, 2, (3, 4))
        own, new = (
            find_mujoco_torques(model, called, state)
            for model, called in zip(models, (["base", *names[1:]], names), strict=True)
        )
        np.testing.assert_allclose(own, new, rtol=0, atol=1e-11 * np.abs(new).max())


def test_all_else_stays(rewritten):
    _, text = rewritten
    # Numbers of what is identified go, and the attributes and elements that were not there.
    for name in ("armature", "damping", "frictionloss", "stiffness", "springref", "quat", "mass", "pos"):
        assert (name in text) == (name in FILE)
    gone = re.compile(r"""\s(armature|damping|frictionloss|stiffness|springref)=["'][^"']*["']""")
    inertial = re.compile(r"\s*<inertial[^>]*>")

    def strip(entry):
        entry = re.sub(r"<(joint|fixed)[^>]*>", lambda match: gone.sub("", match[0]), entry)
        return re.sub(r"\s+", "", inertial.sub("", entry))

    assert strip(text) == strip(FILE)
    # A body that does not move keeps its values, as do classes.
    assert '<inertial pos="0 0 0" mass="50" diaginertia="1 1 1"/>' in text
    assert "<joint damping='0.25' armature=\"0.01\"/>" in text
    assert re.search(
        r"<inertial mass=\"[\d.]+\"   pos=\"[^\"]+\" quat=\"[^\"]+\" diaginertia=\"[^\"]+\"/>", text
    )
    assert re.search(r"<inertial pos=\"[^\"]+\" mass=\"[^\"]+\" fullinertia=\"[^\"]+\"/>", text)


def test_what_does_not_change_is_not_written():
    assert rewrite_mjcf(FILE, parse_mjcf(FILE, "robot.xml")).text == FILE


def test_what_a_body_carries_shares_its_change(rewritten):
    robot, text = rewritten
    assert rewrite_mjcf(FILE, robot).shared == {"upper": ("cover",), "hand": ("nail",)}
    model = mujoco.MjModel.from_xml_string(text)
    masses = {joint.name: joint.inertial[9] for joint in robot.joints}
    for joint, names in (("base_joint", ("upper", "cover")), ("twist", ("hand", "nail"))):
        found = [model.body(name).mass[0] for name in names]
        assert min(found) > 0
        assert sum(found) == pytest.approx(masses[joint])


@pytest.mark.parametrize("unit", ["degree", "radian"])
def test_inertias_from_geoms_alone_become_inertial(unit):
    text = (
        f'<mujoco><compiler inertiafromgeom="true" angle="{unit}"/><worldbody><body name="a">'
        '<joint name="j" springref="1" stiffness="3"/><inertial pos="0 0 0" mass="9" diaginertia="9 9 9"/>'
        '<geom size="0.1"/></body></worldbody></mujoco>'
    )
    robot = parse_mjcf(text)
    assert 'inertiafromgeom="auto"' not in rewrite_mjcf(text, robot).text
    robot = give_values(robot)
    check_values(robot, parse_mjcf(rewrite_mjcf(text, robot).text))


def test_a_follower_keeps_its_offset():
    text = (
        '<mujoco><worldbody><body name="a"><joint name="j"/><geom size="0.1"/><body name="b">'
        '<joint name="k" ref="10" springref="5" stiffness="2"/><geom size="0.1"/></body></body></worldbody>'
        '<equality><joint joint1="k" joint2="j" polycoef="0.5 -2"/></equality></mujoco>'
    )
    robot = give_values(parse_mjcf(text))
    check_values(robot, parse_mjcf(rewrite_mjcf(text, robot).text))


def test_a_mass_between_two_joints_of_a_body_is_refused():
    text = (
        '<mujoco><worldbody><body name="a">\n<joint name="j"/>\n<joint name="k" axis="1 0 0"/>'
        '<geom size="0.1"/></body></worldbody></mujoco>'
    )
    robot = parse_mjcf(text, "arm.xml")
    second = dataclasses.replace(give_values(robot).joints[1])
    check_values(
        dataclasses.replace(robot, joints=(robot.joints[0], second)),
        parse_mjcf(rewrite_mjcf(text, dataclasses.replace(robot, joints=(robot.joints[0], second))).text),
    )
    with pytest.raises(RobotError) as caught:
        rewrite_mjcf(text, give_values(robot))
    (notice,) = caught.value.notices
    assert (notice.code, notice.file, notice.line) == ("robot.mjcf-massless", "arm.xml", 2)
    assert "write a new one (-o FILE)" in notice.text


def test_values_in_an_included_file_are_refused(tmp_path: Path):
    (tmp_path / "parts.xml").write_text(
        '<mujoco><worldbody><body name="a"><joint name="j"/><geom size="0.1"/></body></worldbody></mujoco>',
        encoding="utf-8",
    )
    text, file = '<mujoco><include file="parts.xml"/></mujoco>', str(tmp_path / "arm.xml")
    robot = give_values(parse_mjcf(text, file))
    with pytest.raises(RobotError) as caught:
        rewrite_mjcf(text, robot)
    assert {notice.code for notice in caught.value.notices} == {"robot.mjcf-include"}
    assert "put the model into one file" in caught.value.notices[0].text
