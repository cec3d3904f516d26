"""Identified laws as friction of robot files: the torque is the same, and what has no model is named."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.friction.identify import FrictionTask, identify_friction
from symid.identification.friction.results import build_robot_friction, describe_obstacle
from symid.joint_models.carriers import build_numpy_carrier
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_friction_torque
from symid.joint_models.friction_models import compute_friction_columns
from symid.robot.description import CurvedFriction, FrictionKind
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.recovery.closed_form import build_two_link
from tests.unit.identification.friction.cosine_rigs import RAW, record

# What papers print, with static friction below Coulomb friction and above.
VALUES = {"fC": 2.3, "fV": 1.7, "fS": 3.1, "vs": 0.07, "offset": -0.4, "gamma": 1.37, "fP": 0.3, "dq0": 0.02}
VALUES |= {"fCp": 2.0, "fVp": 1.1, "fCn": 2.4, "fVn": 1.9, "fE": -0.8, "fV2": -0.3, "fV3": 0.2, "fD": 1.3}
VALUES |= {"delta": 0.4, "fM": 0.9, "g2": 90.0, "g3": 11.0, "g5": 70.0}
KINDS = {
    "coulomb": FrictionKind.VISCOUS_COULOMB,
    "coulomb+offset": FrictionKind.VISCOUS_COULOMB_OFFSET,
    "coulomb-viscous": FrictionKind.VISCOUS_COULOMB,
    "coulomb-viscous-offset": FrictionKind.VISCOUS_COULOMB_OFFSET,
    "coulomb-viscous+offset": FrictionKind.VISCOUS_COULOMB_OFFSET,
    "asymmetric": FrictionKind.ASYMMETRIC,
    "tustin": CurvedFriction.STRIBECK,
    "tustin+offset": CurvedFriction.STRIBECK_OFFSET,
    "stribeck": CurvedFriction.STRIBECK,
    "stribeck-1.6": CurvedFriction.STRIBECK,
    "stribeck-exponent": CurvedFriction.STRIBECK,
    "stribeck+offset": CurvedFriction.STRIBECK_OFFSET,
    "stribeck-exponent+offset": CurvedFriction.STRIBECK_OFFSET,
    "improved-stribeck": CurvedFriction.IMPROVED_STRIBECK,
    "improved-stribeck-exponent": CurvedFriction.IMPROVED_STRIBECK,
    "improved-stribeck-h3": CurvedFriction.STRIBECK_OFFSET,
    "asymmetric-stribeck": CurvedFriction.ASYMMETRIC_STRIBECK,
    "asymmetric-stribeck-0.7": CurvedFriction.ASYMMETRIC_STRIBECK,
    "cubic": CurvedFriction.CUBIC,
    "polynomial-2": CurvedFriction.CUBIC,
    "polynomial-3": CurvedFriction.CUBIC,
    "polynomial-3,2": CurvedFriction.CUBIC,
    "stribeck+cubic": CurvedFriction.STRIBECK_CUBIC,
    "stribeck-1.6+cubic": CurvedFriction.STRIBECK_CUBIC,
    "power-law": CurvedFriction.POWER_LAW,
    "makkar": CurvedFriction.MAKKAR,
}
# What an answer must name: the law, its relative without an offset, what else it reads.
WITHOUT_MODEL = {
    "lorentzian": "'lorentzian'",
    "asymmetric+offset": "'asymmetric', without",
    "cubic+offset": "'cubic', without",
    "stribeck+cubic+offset": "'stribeck+cubic', without",
    "power-law+offset": "'power-law', without",
    "improved-stribeck-h2": "'improved-stribeck-h2'",
    "improved-stribeck-h4": "'improved-stribeck-h4'",
    "asymmetric-stribeck-both": "'asymmetric-stribeck-both'",
    "polynomial-4": "'polynomial-4'",
    "load-dependent": "the load ",
    "position-dependent": "the position ",
}
# Standstill is among them, and speeds from far below the zone to far above all shape values.
SPEEDS = np.concatenate([[0.0], np.logspace(-6.0, 1.0, 200), -np.logspace(-6.0, 1.0, 200)])
ROBOT = """
name = "slide"
convention = "modified"
gravity = [0, 0, -9.81]

[[joint]]
name = "first"
kind = "{kind}"
alpha = "pi/2"
"""


@pytest.fixture(scope="module")
def identified():
    task = FrictionTask(model="coulomb-viscous-offset", poses=False)
    (joint,) = identify_friction(build_two_link(), [record(1.0)], RAW, task).joints
    return joint


def give(joint, name, *, smoothing=0.0, refused=(), **values):
    """Return a joint with these values of a law, 0.1 where none are given."""
    law = get_law(name)
    told = {**VALUES, **values}
    linear, shape = law.from_physical([told.get(entry.name, 0.1) for entry in law.physical])
    estimate = replace(joint.estimate, law=name, linear=linear, shape=shape, refused=refused)
    return replace(joint, estimate=estimate, smoothing=smoothing)


def find_written_torque(friction, kind):
    """Return the torque of a robot file that is written and read, by the friction of robots."""
    robot = parse_robot(ROBOT.format(kind=kind))
    text = write_robot(replace(robot, joints=(replace(robot.joints[0], friction=friction),)))
    read = parse_robot(text).joints[0].friction
    assert read == friction
    columns = compute_friction_columns(read, build_numpy_carrier(), SPEEDS)
    return sum(value * column for value, column in zip(read.values, columns, strict=True))


@pytest.mark.parametrize("smoothing", [0.0, 0.013])
@pytest.mark.parametrize("name", KINDS)
def test_a_written_law_has_the_torque_of_the_identified_one(identified, name, smoothing):
    joint = give(identified, name, smoothing=smoothing)
    assert not describe_obstacle(joint)
    friction = build_robot_friction(joint)
    assert friction.kind is KINDS[name]
    law = get_law(name, smoothing=smoothing)
    expected = compute_friction_torque(law, {"velocity": SPEEDS}, joint.estimate.linear, joint.estimate.shape)
    found = find_written_torque(friction, "prismatic")
    assert np.max(np.abs(found - expected)) <= 1e-12 * np.max(np.abs(expected))


def test_the_step_above_coulomb_friction_is_what_robot_files_name(identified):
    friction = build_robot_friction(give(identified, "stribeck+offset"))
    assert friction.values == pytest.approx((1.7, 2.3, 3.1 - 2.3, -0.4), abs=1e-15)
    assert friction.shape == (0.07, 2.0)
    below = build_robot_friction(give(identified, "stribeck", fS=1.9))
    assert below.values == pytest.approx((1.7, 2.3, 1.9 - 2.3), abs=1e-15)


def test_laws_without_a_sign_have_no_smoothing_in_the_file(identified):
    assert build_robot_friction(give(identified, "makkar", smoothing=0.01)).smoothing == 0.0
    assert build_robot_friction(give(identified, "improved-stribeck", smoothing=0.01)).smoothing == 0.0
    assert build_robot_friction(give(identified, "stribeck", smoothing=0.01)).smoothing == 0.01


@pytest.mark.parametrize("name", WITHOUT_MODEL)
def test_a_law_that_no_robot_file_has_is_named(identified, name):
    joint = give(identified, name)
    assert WITHOUT_MODEL[name] in describe_obstacle(joint)
    with pytest.raises(ValueError, match=r"robot files"):
        build_robot_friction(joint)


def test_values_that_were_refused_or_that_files_refuse_stay_out(identified):
    refused = give(identified, "stribeck", refused=(("vs", "no row is slow enough"),))
    assert describe_obstacle(refused) == "vs was refused: no row is slow enough"
    beside = give(identified, "stribeck", refused=(("J", "the joint hardly accelerates"),))
    assert not describe_obstacle(beside)
    steep = give(identified, "stribeck-exponent", gamma=12.5)
    assert describe_obstacle(steep).startswith("gamma = 12.5")
    assert " 10" in describe_obstacle(steep)
