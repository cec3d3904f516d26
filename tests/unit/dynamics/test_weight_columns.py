"""Torques in doubles, per unit of every parameter, and those of gravity along each axis of the base."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

import symid
from symid.dynamics.base_parameters import build_grouping, derive_base_parameters
from symid.dynamics.bodies import list_drive_parameters
from symid.dynamics.regressors import WEIGHED, evaluate_torque_regressor, evaluate_weight_columns
from symid.notation import INERTIAL
from symid.robot import load_robot
from symid.robot.description import JointKind
from symid.robot.geometry import Exact
from tests import chains

AXES = [tuple(Exact.of(int(value)) for value in axis) for axis in np.eye(3)]


def draw_positions(robot, count=5):
    return np.random.default_rng(robot.size).uniform(-2.0, 2.0, (count, robot.freedom))


@settings(max_examples=40)
@given(chains.trees(followers=True, springs=True, rotors=True, couplings=True))
def test_columns_are_those_of_pinocchio(robot):
    q, keys = draw_positions(robot), [(link, name) for link in range(robot.size) for name in INERTIAL]
    keys += list_drive_parameters(robot)
    dq, ddq = np.random.default_rng(0).uniform(-2.0, 2.0, (2, *q.shape))
    found = evaluate_torque_regressor(robot, keys, q, dq, ddq)
    weights, still = evaluate_weight_columns(robot, q), np.zeros(robot.freedom)
    for sample, state in enumerate(zip(q, dq, ddq, strict=True)):
        expected = chains.regress(robot, *state, friction=False)
        chains.assert_close(found[sample], np.column_stack([expected[key] for key in keys]))
        for axis, columns in zip(AXES, weights[:, sample], strict=True):
            expected = chains.regress(replace(robot, gravity=axis), q[sample], still, still, friction=False)
            wanted = [expected[link, name] for link in range(robot.size) for name in WEIGHED]
            chains.assert_close(columns, np.column_stack(wanted))


@pytest.mark.parametrize("name", ["kr30", "ppr", "rrp_twisted", "two_arms", "two_link_symbols"])
def test_weights_are_the_torques_at_rest_of_the_library(name):
    robot = load_robot(name)
    base, q = derive_base_parameters(robot), draw_positions(robot)
    # Standard parameters of the links; drives and springs are left out.
    pi = dict.fromkeys(base.labels, 0.0) | chains.list_values(chains.fill(robot))
    beta = build_grouping(robot, base).matrix @ [pi[label] for label in base.labels]
    library = symid.load(name, backend="python").library
    (rest,) = library.evaluate("torque_regressor", q, np.zeros_like(q), np.zeros_like(q))
    gravity = [value.to_float(dict(robot.symbols)) for value in robot.gravity]
    mass = [pi[link, entry] for link in range(robot.size) for entry in WEIGHED]
    found = np.tensordot(gravity, evaluate_weight_columns(robot, q) @ mass, 1)
    chains.assert_close(found, rest @ beta)


def find_potential(robot, q, pi):
    """Return the energy (3,) of links (links, 10) at q (n,) in gravity along each axis: -g'(M p + R MS)."""
    energy, poses = np.zeros(3), []
    for joint, value, body in zip(robot.joints, q, pi, strict=True):
        motion, (c, s) = np.eye(4), (np.cos(value), np.sin(value))
        if joint.kind is JointKind.REVOLUTE:
            motion[:2, :2] = [[c, -s], [s, c]]
        else:
            motion[2, 3] = value
        before = poses[joint.parent] if joint.parent >= 0 else np.eye(4)
        poses.append(before @ chains.to_matrix(joint.placement) @ motion)
        energy -= (poses[-1] @ body[6:])[:3]
    return energy


@pytest.mark.parametrize("name", ["rrp_twisted", "iiwa14", "two_arms"])
def test_weights_are_slopes_of_the_potential_energy(name):
    robot, step = load_robot(name), 1e-5
    (q,), pi = draw_positions(robot, 1), chains.draw_parameters(np.random.default_rng(2), robot.size)
    found = evaluate_weight_columns(robot, q[None])[:, 0] @ pi[:, 6:].ravel()
    for joint, unit in enumerate(np.eye(robot.size)):
        ends = [find_potential(robot, q + sign * step * unit, pi) for sign in (1.0, -1.0)]
        chains.assert_close(found[:, joint], (ends[0] - ends[1]) / (2.0 * step), 1e-8)


def test_they_need_no_sympy():
    program = (
        "import sys, numpy as np\n"
        "from symid.dynamics import evaluate_weight_columns\n"
        "from symid.robot import load_robot\n"
        "print(*evaluate_weight_columns(load_robot('puma560'), np.zeros((2, 6))).shape)\n"
        "print('sympy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["3", "2", "6", "24", "False"]
