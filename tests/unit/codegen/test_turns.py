"""Constant turns of joints and the order of instructions: robots and values stay, programs are cheaper."""

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given, settings

from symid.codegen.equation_routes import build_workspace
from symid.codegen.functions import list_robot_specs
from symid.codegen.printing import print_python
from symid.codegen.programs import build_depth_first, count_operations
from symid.codegen.routes import choose_route, list_routes
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.frame_choice import list_constant_rotations
from symid.robot.geometry import Exact, build_exact_angle, place_modified_dh
from tests.chains import PUMA560, STANFORD, build_route_programs, trees
from tests.sx_programs import run_program

ROWS = [(0.0, 0.0, 0.3), (np.pi / 2, 0.1, 0.0), (0.0, 0.4, 0.1), (np.pi / 3, 0.02, 0.0)]


def build_offset_arm(thetas):
    placements = [
        place_modified_dh(build_exact_angle(alpha), Exact.of(a), Exact.of(d), build_exact_angle(theta))
        for (alpha, a, d), theta in zip(ROWS, thetas, strict=True)
    ]
    joints = zip(PUMA560.joints, placements, strict=False)
    return dataclasses.replace(
        PUMA560, joints=tuple(dataclasses.replace(joint, placement=place) for joint, place in joints)
    )


ARM = build_offset_arm([0.4, np.pi / 6, -2.5, np.pi])
PLAIN = build_offset_arm([0.0, 0.0, 0.0, 0.0])


def count(program):
    found = count_operations(program)
    return found.mul + found.add


def find_plain_best(robot, base, spec):
    return min(map(count, build_route_programs(robot, base, spec).values()))


@settings(max_examples=20, deadline=None)
@given(robot=trees(most=3, followers=True, springs=True))
def test_both_ways_give_the_same_numbers_and_the_cheaper_is_taken(robot):
    base = derive_base_parameters(robot)
    turns = list_constant_rotations(robot)
    rng = np.random.default_rng(8)
    for spec in list_robot_specs(robot, base):
        # The mass matrix of random parameters need not be one that can be solved for.
        if spec.name == "forward_dynamics":
            continue
        inputs = {port.name: rng.uniform(-2, 2, port.shape) for port in spec.inputs}
        workspace = build_workspace(robot, base, spec, turns)
        plain = build_route_programs(robot, base, spec)
        for name, build in list_routes(robot, spec.name).items():
            program = workspace.algebra.build_program(spec, workspace.recall(build))
            for mine, theirs in zip(
                run_program(program, inputs), run_program(plain[name], inputs), strict=True
            ):
                scale = max(1.0, np.abs(theirs).max(initial=0.0))
                np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-11 * scale)
        chosen = choose_route(robot, base, spec).program
        best = min(plain.values(), key=count)
        assert count(chosen) <= count(best)
        assert count_operations(chosen).trig <= count_operations(best).trig


def test_a_turn_costs_one_sum_at_most():
    bases = derive_base_parameters(ARM), derive_base_parameters(PLAIN)
    for ours, theirs in zip(*(list_robot_specs(ARM, base) for base in bases), strict=True):
        turned = count(choose_route(ARM, bases[0], ours).program)
        assert turned <= find_plain_best(PLAIN, bases[1], theirs) + 3, ours.name
        assert turned <= find_plain_best(ARM, bases[0], ours), ours.name
    (spec,) = [spec for spec in list_robot_specs(ARM, bases[0]) if spec.name == "inverse_dynamics"]
    assert count(choose_route(ARM, bases[0], spec).program) < 0.88 * find_plain_best(ARM, bases[0], spec)


def count_registers(program):
    found = (re.match(r"t(\d+) =", text) for text in print_python(program))
    return max(int(match[1]) for match in found if match)


@pytest.mark.parametrize("robot", [PUMA560, STANFORD], ids=lambda r: r.name)
def test_the_same_values_with_fewer_alive(robot):
    base = derive_base_parameters(robot)
    rng = np.random.default_rng(1)
    before, after = 0, 0
    for spec in list_robot_specs(robot, base):
        inputs = {port.name: rng.uniform(-1, 1, port.shape) for port in spec.inputs}
        for program in build_route_programs(robot, base, spec).values():
            ordered = build_depth_first(program)
            assert count_operations(ordered) == count_operations(program)
            assert build_depth_first(ordered) == ordered
            for mine, theirs in zip(run_program(ordered, inputs), run_program(program, inputs), strict=True):
                np.testing.assert_array_equal(mine, theirs)
            # Products of full matrices need all entries of both, in any order.
            if spec.name != "forward_dynamics_derivatives":
                before, after = before + count_registers(program), after + count_registers(ordered)
    assert after < 0.8 * before
