"""Forward dynamics by articulated bodies: equal to Pinocchio, and the route of robots of many joints."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from symid.codegen.functions import list_robot_specs
from symid.codegen.programs import count_operations
from symid.codegen.routes import choose_route, list_routes
from symid.dynamics.algebra import FloatAlgebra
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.newton_euler import compute_forward_dynamics
from symid.dynamics.recursion import build_recursion
from symid.robot.description import Mimic
from tests.chains import assert_close, build_chain, build_pinocchio, draw_parameters, name_parameters, trees
from tests.float_algebra import build_float_state
from tests.sx_programs import run_program

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

ROTOR = 0.3
ROWS = [(0.3, 0.1, 0.25, "q"), (1.2, 0.05, 0.1, "q"), (np.pi / 2, 0.2, 0.0, "q")]


def compute_pinocchio(robot, links, state):
    model = build_pinocchio(robot, links)
    model.armature = np.array([ROTOR if joint.drive.has_rotor else 0.0 for joint in robot.joints])
    return pin.aba(model, model.createData(), *state)


def build_values(robot, links):
    return name_parameters(links) | {
        (k, "IA"): ROTOR for k, joint in enumerate(robot.joints) if joint.drive.has_rotor
    }


@settings(max_examples=40, deadline=None)
@given(robot=trees(most=15, rotors=True), seed=st.integers(0, 99))
def test_accelerations_of_random_trees_equal_those_of_pinocchio(robot, seed):
    rng = np.random.default_rng(seed)
    links, state = draw_parameters(rng, robot.size), rng.uniform(-2.0, 2.0, (3, robot.size))
    expected = compute_pinocchio(robot, links, state)
    # Accelerations of the state are none of the function's.
    recursion = build_recursion(
        robot, FloatAlgebra(), build_float_state(state[0], state[1], np.full(robot.size, 7.0))
    )
    values = build_values(robot, links)
    found = compute_forward_dynamics(recursion, values, [float(x) for x in state[2]], lambda x: 1.0 / x)
    assert_close(found, expected, 1e-8)


def choose(robot):
    base = derive_base_parameters(robot)
    (spec,) = list_robot_specs(robot, base, ("forward_dynamics",))
    choice = choose_route(robot, base, spec)
    return base, choice, next(entry.route for entry in choice.counts if entry.chosen)


def test_it_is_the_route_of_long_chains_and_grows_with_their_joints():
    counts = []
    for size in (12, 15, 18):
        _, choice, route = choose(build_chain(ROWS * (size // 3)))
        assert route.startswith("articulated bodies")
        count = count_operations(choice.program)
        counts.append(count.mul + count.add)
    # Three joints more are always the same number of operations more.
    assert counts[2] - counts[1] == counts[1] - counts[0] < 1200


def test_code_of_a_long_chain_equals_pinocchio():
    robot = build_chain(ROWS * 5, rotors=True)
    base, choice, _ = choose(robot)
    rng = np.random.default_rng(4)
    links = draw_parameters(rng, robot.size)
    values = build_values(robot, links)
    beta = np.array([sum(float(c) * values[key] for key, c in entry.terms) for entry in base.parameters])
    for _ in range(20):
        state = rng.uniform(-2.0, 2.0, (3, robot.size))
        expected = compute_pinocchio(robot, links, state)
        (found,) = run_program(
            choice.program, dict(zip(("q", "dq", "tau"), state, strict=True)) | {"beta": beta}
        )
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_joints_that_share_a_coordinate_are_not_free_one_by_one():
    robot = build_chain(ROWS * 4)
    assert any(name.startswith("articulated") for name in list_routes(robot, "forward_dynamics"))
    follower = replace(robot.joints[3], mimic=Mimic(master=0, multiplier=Fraction(-1)))
    shared = replace(robot, joints=(*robot.joints[:3], follower, *robot.joints[4:]))
    assert not any(name.startswith("articulated") for name in list_routes(shared, "forward_dynamics"))
