"""Identified laws as friction of robot files: the torque is the same; refused values stay out."""

from dataclasses import replace

import numpy as np
import pytest

from symid.dynamics import compute_friction_columns
from symid.identification.friction.identify import (
    FrictionTask,
    build_robot_friction,
    identify_friction,
)
from symid.joint_models.carriers import build_numpy_carrier
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_friction_torque
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.friction_forms import EVERY_LAW
from tests.recovery.closed_form import build_two_link
from tests.unit.identification.friction.cosine_rigs import RAW, record

# What papers print, with static friction below Coulomb friction and above.
VALUES = {"fC": 2.3, "fV": 1.7, "fS": 3.1, "vs": 0.07, "offset": -0.4, "gamma": 1.37, "fP": 0.3, "dq0": 0.02}
VALUES |= {"fCp": 2.0, "fVp": 1.1, "fCn": 2.4, "fVn": 1.9, "fE": -0.8, "fV2": -0.3, "fV3": 0.2, "fD": 1.3}
VALUES |= {"delta": 0.4, "fM": 0.9, "g2": 90.0, "g3": 11.0, "g5": 70.0, "dqs": 0.03, "TV": 25.0}
# Standstill is among them, and speeds from far below the zone to far above all shape values.
SPEEDS = np.concatenate([[0.0], np.logspace(-6.0, 1.0, 200), -np.logspace(-6.0, 1.0, 200)])
INPUTS = {
    "velocity": SPEEDS,
    "load": np.linspace(-30.0, 20.0, len(SPEEDS)),
    "position": np.linspace(-2.0, 5.0, len(SPEEDS)),
    "temperature": np.linspace(60.0, 15.0, len(SPEEDS)),
}
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


def write_and_read(friction, kind="prismatic"):
    """Return the friction of a robot file that is written and read."""
    robot = parse_robot(ROBOT.format(kind=kind))
    text = write_robot(replace(robot, joints=(replace(robot.joints[0], friction=friction),)))
    return parse_robot(text).joints[0].friction


@pytest.mark.parametrize("smoothing", [0.0, 0.013])
@pytest.mark.parametrize("name", EVERY_LAW)
def test_a_written_law_has_the_torque_of_the_identified_one(identified, name, smoothing):
    joint = give(identified, name, smoothing=smoothing)
    friction = build_robot_friction(joint)
    assert friction.law == name
    law = get_law(name, smoothing=smoothing)
    inputs = {key: INPUTS[key] for key in law.inputs}
    expected = compute_friction_torque(law, inputs, joint.estimate.linear, joint.estimate.shape)
    read = write_and_read(friction)
    assert read == friction == write_and_read(friction, "revolute")
    columns = compute_friction_columns(read, build_numpy_carrier(), inputs)
    found = sum(value * column for value, column in zip(read.values, columns, strict=True))
    assert np.max(np.abs(found - expected)) <= 1e-12 * np.max(np.abs(expected))


def test_values_names_and_smoothing_are_those_of_robot_files(identified):
    """Static friction is the step above Coulomb friction; laws without a sign have no smoothing."""
    friction = build_robot_friction(give(identified, "stribeck+offset"))
    assert friction.values == pytest.approx((1.7, 2.3, 3.1 - 2.3, -0.4), abs=1e-15)
    assert friction.shape == (0.07,)
    below = build_robot_friction(give(identified, "stribeck", fS=1.9))
    assert below.values == pytest.approx((1.7, 2.3, 1.9 - 2.3), abs=1e-15)
    searched = build_robot_friction(give(identified, "stribeck-exponent"))
    assert (searched.law, searched.shape) == ("stribeck-exponent", (0.07, 1.37))
    for name, smoothing in (("makkar", 0.0), ("improved-stribeck", 0.0), ("stribeck", 0.01)):
        assert build_robot_friction(give(identified, name, smoothing=0.01)).smoothing == smoothing
    # A law of an earlier fit is written with the name of today.
    joint = give(identified, "stribeck+offset")
    old = replace(joint, estimate=replace(joint.estimate, law="stribeck_offset"))
    assert build_robot_friction(old) == friction


def test_values_that_were_refused_stay_out(identified):
    slow, other = ("vs", "no row is slow enough"), ("fS", "nor here")
    for refused, told in (
        ((slow,), "vs was refused: no row is slow enough"),
        ((slow, other), "vs was refused: no row is slow enough; fS was refused: nor here"),
    ):
        assert build_robot_friction(give(identified, "stribeck", refused=refused)) == told
    beside = give(identified, "stribeck", refused=(("J", "the joint hardly accelerates"),))
    assert build_robot_friction(beside).law == "stribeck"


@pytest.mark.parametrize("name", EVERY_LAW)
def test_files_take_all_shape_values_that_a_fit_may_find(identified, name):
    for entry in get_law(name).shape:
        low = entry.lower if entry.lower_is_allowed else max(entry.lower, 1e-12)
        for value in (low, min(entry.upper, 1e6)):
            friction = build_robot_friction(give(identified, name, **{entry.name: value}))
            assert write_and_read(friction) == friction
