"""MJCF models with other values: all else stays, and what symid and MuJoCo read in them is the new values."""

import re
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from symid.errors import RobotError
from symid.joint_models import FrictionValues
from symid.robot.description import Drive, Spring
from symid.robot.simulator_writers import list_mjcf_omissions, write_mjcf
from symid.robot.xml_rewriters import rewrite_mjcf
from tests.chains import change_joints, fill
from tests.mistakes import refuse
from tests.mujocos import build_model, find_mujoco_torques, parse_mjcf

mujoco = pytest.importorskip("mujoco", reason="wants the package mujoco")

FILE = """<?xml version="1.0"?>
<!-- our arm -->
<mujoco model="arm"><compiler angle="degree"/>
  <default><joint damping="0.5"/>
    <default class="small"><joint damping='0.25' armature="0.01"/></default></default>
  <worldbody>
    <body name="column"><!-- </body> is no end -->
      <inertial pos="0 0 0" mass="50" diaginertia="1 1 1"/>
      <geom type="sphere" size="0.1" name="a > b"/>
      <body name="upper" pos="0 0 0.5" euler="0 30 0">
        <joint name="base" axis="0 1 0" range="-90 90" armature="0.1"  frictionloss='0.25' stiffness="4"/>
        <inertial mass="2"   pos="0.1 0 0" quat="0.9 0.1 0 0.1" diaginertia="0.1 0.08 0.05"/>
        <body name="cover"><geom type="box" size="0.1 0.1 0.1"/>
          <inertial pos="0 0 0.2" mass="0.7" diaginertia="0.01 0.01 0.01"/></body>
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
        </body></body></body>
  </worldbody>
  <tendon><fixed name="belt" damping="0.3"><joint joint="elbow" coef="2"/></fixed></tendon>
  <actuator><motor joint="base" gear="50"/></actuator>
  <keyframe><key qpos="0 0 0 0"/></keyframe>
</mujoco>
"""
GEOM = '<geom size="0.1"/>'
FOLLOW = '<equality><joint joint1="k" joint2="j" polycoef="0.5 -2"/></equality>'
FROM_GEOMS = '<compiler inertiafromgeom="true"/>'
PLAIN = "coulomb-viscous"


def give_values(robot, seed=1):
    rng = np.random.default_rng(seed)
    joints = tuple(
        replace(
            joint,
            friction=FrictionValues(law=PLAIN, values=tuple(rng.uniform(0.1, 1, 2).tolist())),
            drive=replace(joint.drive, has_rotor=True, rotor_inertia=float(rng.uniform(0.1, 1))),
            spring=joint.spring and replace(joint.spring, stiffness=7.5, rest=0.125),
        )
        for joint in fill(robot, seed).joints
    )
    friction = FrictionValues(law=PLAIN, values=(0.4, 0.2))
    couplings = tuple(
        replace(entry, has_rotor=True, rotor_inertia=0.05, friction=friction) for entry in robot.couplings
    )
    return replace(robot, joints=joints, couplings=couplings)


def check_values(robot, text, **options):
    """Rewrite a model with the values of the robot, and read these in it; return the rewriting."""
    found = rewrite_mjcf(text, robot)
    back = parse_mjcf(found.text, **options)
    for old, new in zip(robot.joints, back.joints, strict=True):
        assert (new.name, new.placement, new.frame) == (old.name, old.placement, old.frame)
        np.testing.assert_allclose(new.inertial, old.inertial, rtol=0, atol=1e-13)
        assert (new.friction, new.drive, new.mimic) == (old.friction, old.drive, old.mimic)
        if old.spring:
            assert new.spring.stiffness == old.spring.stiffness
            assert new.spring.rest == pytest.approx(old.spring.rest, abs=1e-14)
    assert back.couplings == robot.couplings
    return found


@pytest.fixture
def rewritten():
    robot = give_values(parse_mjcf(FILE, "robot.xml"))
    return robot, rewrite_mjcf(FILE, robot).text


def test_the_new_values_are_read(rewritten):
    robot, _ = rewritten
    assert [joint.name for joint in robot.joints] == ["base_joint", "elbow", "twist", "flap"]
    check_values(robot, FILE)


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
    text = build_model(
        '<body name="a"><joint name="j" springref="1" stiffness="3"/>'
        f'<inertial pos="0 0 0" mass="9" diaginertia="9 9 9"/>{GEOM}</body>',
        head=f'<compiler inertiafromgeom="true" angle="{unit}"/>',
    )
    robot = parse_mjcf(text)
    assert 'inertiafromgeom="auto"' not in rewrite_mjcf(text, robot).text
    check_values(give_values(robot), text)


def test_a_mass_between_two_joints_of_a_body_is_refused():
    text = build_model(f'<body name="a">\n<joint name="j"/>\n<joint name="k" axis="1 0 0"/>{GEOM}</body>')
    robot = parse_mjcf(text, "arm.xml")
    second = give_values(robot).joints[1]
    check_values(replace(robot, joints=(robot.joints[0], second)), text)
    (notice,) = refuse(rewrite_mjcf, text, give_values(robot))
    assert (notice.code, notice.file, notice.line) == ("robot.mjcf-massless", "arm.xml", 2)
    assert "write a new one (-o FILE)" in notice.text


def test_values_in_an_included_file_are_refused(tmp_path: Path):
    part = build_model(f'<body name="a"><joint name="j"/>{GEOM}</body>')
    (tmp_path / "parts.xml").write_text(part, encoding="utf-8")
    text, file = '<mujoco><include file="parts.xml"/></mujoco>', str(tmp_path / "arm.xml")
    notices = refuse(rewrite_mjcf, text, give_values(parse_mjcf(text, file)))
    assert {notice.code for notice in notices} == {"robot.mjcf-include"}
    assert "put the model into one file" in notices[0].text


def test_neither_what_does_not_change_nor_rounding_is_written():
    robot = parse_mjcf(FILE, "robot.xml")
    assert rewrite_mjcf(FILE, robot).text == FILE
    noise = np.random.default_rng(3).uniform(-1e-13, 1e-13, (robot.size, 10))
    joints = tuple(
        replace(
            joint,
            inertial=tuple((np.array(joint.inertial) + row).tolist()),
            friction=replace(
                joint.friction, values=tuple(value * (1 - 1e-15) for value in joint.friction.values)
            ),
            drive=replace(
                joint.drive,
                rotor_inertia=joint.drive.rotor_inertia and joint.drive.rotor_inertia * (1 + 1e-15),
            ),
            spring=joint.spring
            and Spring(stiffness=joint.spring.stiffness * (1 + 1e-15), rest=joint.spring.rest * (1 - 1e-15)),
        )
        for joint, row in zip(robot.joints, noise, strict=True)
    )
    assert rewrite_mjcf(FILE, replace(robot, joints=joints)).text == FILE
    heavier = (*joints[2].inertial[:9], joints[2].inertial[9] * (1 + 1e-8))
    joints = (*joints[:2], replace(joints[2], inertial=heavier), joints[3])
    assert rewrite_mjcf(FILE, replace(robot, joints=joints)).text != FILE


def test_what_the_robot_has_no_more_becomes_zero():
    robot = change_joints(parse_mjcf(FILE), friction=FrictionValues(), drive=Drive(), spring=None)
    couplings = tuple(
        replace(entry, has_rotor=True, rotor_inertia=0.1, friction=FrictionValues())
        for entry in robot.couplings
    )
    text = rewrite_mjcf(FILE, replace(robot, couplings=couplings)).text
    back = parse_mjcf(text)
    for joint in back.joints:
        assert joint.friction == FrictionValues()
        assert (joint.drive.has_rotor, joint.spring) == (False, None)
    assert back.couplings == couplings
    model = mujoco.MjModel.from_xml_string(text)
    for values in (model.dof_damping, model.dof_frictionloss, model.dof_armature, model.jnt_stiffness):
        assert not values.any()
    assert not model.tendon_damping.any()


def test_unknown_values_leave_those_of_the_file():
    unknown = FrictionValues(law=PLAIN, values=None)
    robot = change_joints(
        parse_mjcf(FILE), friction=unknown, drive=Drive(has_rotor=True), spring=Spring(), inertial=None
    )
    assert rewrite_mjcf(FILE, robot).text == FILE


def test_friction_beyond_damping_and_dry_friction_is_named():
    robot = parse_mjcf(FILE)
    cubic = FrictionValues(law="cubic", values=(0.1, 0.5, 0.2, 0.3))
    dahl = FrictionValues(law="dahl", values=(0.1, 0.5), bristles=(100.0,))
    joints = [replace(robot.joints[k], friction=law) for k, law in enumerate((cubic, dahl))]
    couplings = (replace(robot.couplings[0], friction=cubic),)
    robot = replace(robot, joints=(*joints, *robot.joints[2:]), couplings=couplings)
    assert "dcmotor" not in rewrite_mjcf(FILE, robot).text
    # A new model has polynomials and bristles.
    assert not list(list_mjcf_omissions(robot))
    owners = ("joint base_joint: friction", "joint elbow: friction", "coupled drive belt: friction")
    for owner, words in zip(owners, list_mjcf_omissions(robot, rewritten=True), strict=True):
        assert words.startswith(owner)


@pytest.mark.parametrize("change", ["name", "terms", "none"])
def test_other_coupled_drives_than_those_of_the_file_are_refused(change):
    robot = parse_mjcf(FILE, "arm.xml")
    belt = robot.couplings[0]
    couplings = {
        "name": (replace(belt, name="strap"),),
        "terms": (replace(belt, terms=((1, Fraction(3)),)),),
        "none": (),
    }[change]
    (notice,) = refuse(rewrite_mjcf, FILE, replace(robot, couplings=couplings))
    assert (notice.code, notice.file) == ("robot.mjcf-unsupported", "arm.xml")
    own = {"name": "strap: 2 elbow", "terms": "belt: 3 elbow", "none": "other ones than in the model: none"}
    assert own[change] in notice.text
    assert "in the model: a drive coupled to several joints, belt: 2 elbow" in notice.text
    assert "or write a new model (-o FILE)" in notice.text


def test_a_robot_of_no_file_is_refused():
    robot = replace(parse_mjcf(FILE, "arm.xml"), made_from=None)
    with pytest.raises(RobotError, match=r"was made from no model; write a new one \(-o FILE\)"):
        rewrite_mjcf(FILE, robot)


def test_inertias_of_bodies_that_do_not_belong_to_the_robot_stay():
    other = '<inertial pos="0 0 0" mass="9" diaginertia="9 9 9"/>'
    text = build_model(
        f'\n<body name="a"><joint name="j"/>{GEOM}</body>\n<body name="b"><joint name="k"/>'
        f'{{}}<frame><geom size="1"/></frame></body>\n<body name="post">{GEOM}{{}}</body>',
        head=FROM_GEOMS,
    )
    # A body that does not move has no inertia that counts.
    cut = {"base": "world", "tip": "a"}
    robot = give_values(parse_mjcf(text.format("", other), **cut))
    check_values(robot, text.format("", other), **cut)
    (notice,) = refuse(rewrite_mjcf, text.format(other, other), robot)
    assert (notice.code, notice.line) == ("robot.mjcf-unsupported", 3)
    assert "body 'b': its <inertial>" in notice.text
    assert "remove this <inertial>" in notice.text


def test_polynomials_of_one_number_stay():
    text = build_model(f'<body name="a"><joint name="j" damping="0.5 0 0" stiffness="3 0 0"/>{GEOM}</body>')
    robot = parse_mjcf(text)
    assert rewrite_mjcf(text, robot).text == text
    friction = FrictionValues(law=PLAIN, values=(0.25, 0.0))
    changed = rewrite_mjcf(text, change_joints(robot, friction=friction)).text
    assert changed == text.replace("0.5 0 0", "0.25")


@pytest.mark.parametrize("inside", ["<!-- weighed > twice -->", "", "\n"])
def test_what_stands_inside_an_inertial_stays(inside):
    old = 'mass="1" diaginertia="0.1 0.1 0.1" euler="10 0 0"'
    body = f'<joint name="j"/><inertial pos="0 0 0" {old}>{inside}</inertial\n>{GEOM}'
    text = build_model(f'<body name="a">{body}</body>')
    new = check_values(give_values(parse_mjcf(text)), text).text
    assert f"{inside}</inertial\n><geom" in new
    assert "euler" not in new


def test_springs_that_the_file_lacks_are_written():
    text = build_model(
        f'<body name="a"><joint name="j" ref="3"/>{GEOM}<body name="b"><joint name="k" ref="10"/>{GEOM}'
        f'<body name="c"><joint name="l" type="slide"/>{GEOM}</body></body></body>',
        FOLLOW,
        '<default><joint springref="7"/></default>',
    )
    robot = parse_mjcf(text)
    assert rewrite_mjcf(text, change_joints(robot, spring=Spring(stiffness=0.0, rest=1.0))).text == text
    for rest in (0.0, 0.25):
        sprung = change_joints(robot, spring=Spring(stiffness=4.0, rest=rest))
        model = mujoco.MjModel.from_xml_string(check_values(sprung, text).text)
        assert model.jnt_stiffness.tolist() == [4.0] * 3
        # k - ref(k) = 0.5 - 2 (j - ref(j)), of which the robot's coordinate is -2 j.
        offset = 0.5 + np.radians(10 + 2 * 3)
        np.testing.assert_allclose(model.qpos_spring, [rest, rest + offset, rest], rtol=0, atol=1e-14)


def test_a_follower_of_one_that_stands_still_is_carried_where_both_offsets_put_it():
    geom = '<geom type="box" size="0.1 0.2 0.3" pos="0.3 0 0"/>'
    text = build_model(
        f'<body name="a"><joint name="j" axis="0 1 0"/>{geom}<body name="b" pos="1 0 0">'
        f'<joint name="k" axis="1 0 0"/>{geom}<body name="c" pos="0 1 0"><joint name="l"/>{geom}</body>'
        "</body></body>",
        FOLLOW.replace('joint2="j" polycoef="0.5 -2"', 'polycoef="0.5"')
        + FOLLOW.replace('joint1="k" joint2="j" polycoef="0.5 -2"', 'joint1="l" joint2="k" polycoef="0.2 2"'),
    )
    robot = give_values(parse_mjcf(text))
    assert [joint.name for joint in robot.joints] == ["j"]
    assert check_values(robot, text).shared == {"a": ("b", "c")}
