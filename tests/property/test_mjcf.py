"""MJCF models of random trees: MuJoCo finds the torques of Pinocchio and of the formulas of drives."""

import dataclasses

import mujoco
import numpy as np
from hypothesis import given, settings

from symid.notation import INERTIAL
from symid.robot.description import Spring
from symid.robot.mjcf_writer import write_mjcf
from tests.chains import RATIONAL_ANGLES, draw_parameters, fold, regress, spread, trees
from tests.mujocos import find_mujoco_torques


def fill(robot, rng):
    """Return the robot with values, and all of them by their labels."""
    values, joints, couplings = {}, [], []
    for index, (joint, body) in enumerate(
        zip(robot.joints, draw_parameters(rng, robot.size).tolist(), strict=True)
    ):
        values |= {(index, name): value for name, value in zip(INERTIAL, body, strict=True)}
        if joint.drive.has_rotor:
            values[index, "IA"] = float(rng.uniform(0.1, 1))
        if joint.spring is not None:
            values[index, "KS"], rest = float(rng.uniform(1, 9)), float(rng.uniform(-1, 1))
            values[index, "KR"] = -values[index, "KS"] * rest
            joint = dataclasses.replace(joint, spring=Spring(stiffness=values[index, "KS"], rest=rest))  # noqa: PLW2901
        drive = dataclasses.replace(joint.drive, rotor_inertia=values.get((index, "IA")))
        friction = joint.friction
        if friction.law == "coulomb-viscous":
            values[index, "Fv"], values[index, "Fc"] = float(rng.uniform(0, 1)), 0.0
            friction = dataclasses.replace(friction, values=(values[index, "Fv"], 0.0))
        joints.append(dataclasses.replace(joint, inertial=tuple(body), drive=drive, friction=friction))
    for number, coupling in enumerate(robot.couplings, start=robot.size):
        if coupling.has_rotor:
            values[number, "IA"] = float(rng.uniform(0.1, 1))
        couplings.append(dataclasses.replace(coupling, rotor_inertia=values.get((number, "IA"))))
    return dataclasses.replace(robot, joints=tuple(joints), couplings=tuple(couplings)), values


@settings(max_examples=60)
@given(
    robot=trees(
        angles=RATIONAL_ANGLES, rotors=True, friction=True, followers=True, couplings=True, springs=True
    )
)
def test_mujoco_finds_the_torques_of_random_trees(robot):
    rng = np.random.default_rng(robot.size)
    robot, values = fill(robot, rng)
    text = write_mjcf(robot)
    assert text == write_mjcf(robot)
    state = rng.uniform(-2, 2, (3, robot.freedom))
    joints = np.array([spread(robot, row) for row in state])
    model = mujoco.MjModel.from_xml_string(text)
    found = fold(robot, find_mujoco_torques(model, [joint.name for joint in robot.joints], joints))
    columns = regress(robot, *state)
    expected = sum(value * columns[label] for label, value in values.items())
    assert np.abs(found - expected).max() <= 1e-10 * max(1.0, float(np.abs(expected).max()))
