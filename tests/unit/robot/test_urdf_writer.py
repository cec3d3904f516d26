"""URDFs that symid writes: what is read back, and what stands in comments."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from symid.joint_models import FrictionValues
from symid.joint_models.hysteresis import Elasticity, Knee, Stop
from symid.robot.description import Coupling, Drive, Limits, Mimic, Robot, Spring
from symid.robot.geometry import Exact
from symid.robot.mjcf_reader import parse_xml_robot
from symid.robot.simulator_writers import write_urdf
from symid.robot.toml_reader import read_robot
from tests.chains import build_joint, change_joints


@pytest.fixture
def full():
    """Return a robot with all that a URDF has words for, and what it has none for."""
    joints = [build_joint(index, (np.pi / 2, 0.1, 0.2, "q")) for index in range(3)]
    joints[0] = replace(
        joints[0],
        name='a "b" <c>',
        drive=Drive(gear=-30.0, has_rotor=True, rotor_inertia=0.9),
        friction=FrictionValues(law="coulomb-viscous", values=(0.1, 0.7)),
        limits=Limits(position=(-1.0, 2.5), velocity=3.0, torque=8.0),
    )
    joints[1] = replace(
        joints[1],
        friction=FrictionValues(law="asymmetric", values=(1.0, 2.0, 3.0, 4.0), smoothing=0.01),
        spring=Spring(stiffness=5.0, rest=0.5),
        elasticity=Elasticity(
            stiffness=900.0,
            damping=1.5,
            stops=(Stop(threshold=0.25, stiffness=30.0),),
            knees=(Knee(threshold=3.0, slope=0.5),),
        ),
    )
    joints[2] = replace(joints[2], mimic=Mimic(master=0, multiplier=Fraction(-3, 2)))
    coupling = Coupling(name="wrist--drive", terms=((0, Fraction(1)), (1, Fraction(2))))
    return Robot(
        name="full", joints=tuple(joints), couplings=(coupling,), gravity=(Exact.of("9.81"), Exact(), Exact())
    )


def test_limits_friction_drives_and_followers_come_back(full):
    back = parse_xml_robot(write_urdf(full))
    first, second, third = back.joints
    assert (first.name, first.limits) == (full.joints[0].name, full.joints[0].limits)
    assert first.friction == full.joints[0].friction
    assert (first.drive.gear, first.drive.has_rotor) == (-30.0, True)
    assert first.drive.rotor_inertia == pytest.approx(0.9)
    assert second.limits == Limits()
    assert third.mimic == full.joints[2].mimic
    assert all(joint.inertial is None for joint in back.joints)


def test_what_a_urdf_has_no_words_for_stands_in_comments(full):
    text = write_urdf(full)
    ET.fromstring(text)  # noqa: S314  our own text
    for words in (
        ": 9.81 0.0 0.0 m/s^2",
        "friction model asymmetric, values 1.0 2.0 3.0 4.0",
        "a spring, 5.0 at",
        "elastic, 900.0, damping 1.5, stop of 30.0 to 0.25, knee of 0.5 at 3.0",
        "over 0.01",
        'wrist- -drive: 1 a "b" &lt;c&gt;, 2 joint2',
    ):
        assert words in text


def test_limits_that_are_unknown_come_back_without_a_word(robots_folder):
    panda = read_robot(robots_folder / "panda.toml")
    robot = parse_xml_robot(write_urdf(change_joints(panda, limits=Limits())))
    assert {joint.limits for joint in robot.joints} == {Limits()}
    assert [notice.code for notice in robot.notices] == ["robot.assumed-gravity"]
