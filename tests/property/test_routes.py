"""Every route to every function gives the same numbers, on trees nobody has seen."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from symid.codegen.casadi_functions import build_functions
from symid.codegen.functions import list_robot_specs, list_specs
from symid.codegen.printing import print_c
from symid.codegen.programs import count_operations
from symid.codegen.routes import ROUTES, choose_route, count_route_operations
from symid.dynamics.base_parameters import derive_base_parameters
from tests import chains
from tests.sx_programs import run_program

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

RANGES = {"q": 3.0, "dq": 2.0, "ddq": 5.0, "dqr": 2.0, "ddqr": 5.0, "tau": 20.0}
SEVERAL = tuple(name for name, routes in ROUTES.items() if len(routes) > 1)
# Six derivatives a second of a solved system are no test of a route: its parts are compared themselves.
SOLVED = ("forward_dynamics", "forward_dynamics_derivatives")


def draw_inputs(robot, base, rng):
    """Return a state, and the base values of consistent link parameters and rotors."""
    values, lengths = chains.name_parameters(chains.draw_parameters(rng, robot.size)), dict(robot.symbols)
    # Rotors, and offsets that are grouped with a weight, are not in the list.
    beta = [
        sum(float(c.subs(lengths)) * values.get(label, 0.5) for label, c in p.terms) for p in base.parameters
    ]
    state = {name: rng.uniform(-reach, reach, robot.freedom) for name, reach in RANGES.items()}
    return {**state, "beta": np.array(beta), "f": rng.uniform(-1, 1, len(base.friction))}


def assert_same(found, expected, tolerance, what):
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    error = float(np.abs(found - expected).max(initial=0.0)) / scale
    assert error < tolerance, f"{what}: differs by {error:.1e}"


def check_routes(robot, seed):
    base = derive_base_parameters(robot)
    inputs = draw_inputs(robot, base, np.random.default_rng(seed))
    for spec in list_robot_specs(robot, base):
        programs = chains.build_route_programs(robot, base, spec)
        (first, reference), *others = [(name, run_program(p, inputs)) for name, p in programs.items()]
        tolerance = 1e-7 if spec.name in SOLVED else 1e-11
        for name, outputs in others:
            for mine, theirs in zip(outputs, reference, strict=True):
                assert_same(mine, theirs, tolerance, f"{spec.name}: {name} and {first}")


@settings(max_examples=25, deadline=None)
@given(robot=chains.trees(most=4, rotors=True, friction=True, followers=True, couplings=True, springs=True))
def test_all_routes_agree_on_random_trees(robot):
    check_routes(robot, 3)


@settings(max_examples=8, deadline=None)
@given(robot=chains.trees(most=3, symbols=True))
def test_all_routes_agree_with_symbolic_lengths(robot):
    values = [(f"{letter}{index}", 0.1 + 0.07 * index) for index in range(robot.size) for letter in "AD"]
    check_routes(replace(robot, symbols=tuple(values)), 4)


@pytest.mark.parametrize(
    "robot", [chains.TWO_LINK, chains.PUMA560, chains.PANDA, chains.STANFORD], ids=lambda r: r.name
)
def test_all_routes_agree_on_known_robots(robot):
    check_routes(robot, 5)


def test_the_route_with_the_fewest_operations_is_emitted():
    counts = count_route_operations(chains.PUMA560)
    base = derive_base_parameters(chains.PUMA560)
    for spec in list_robot_specs(chains.PUMA560, base):
        routes = [count for count in counts if count.function == spec.name]
        assert [count.route for count in routes] == list(ROUTES[spec.name])
        (chosen,) = [count for count in routes if count.chosen]
        sums = [count.operations.mul + count.operations.add for count in routes]
        assert chosen is routes[sums.index(min(sums))], "ties are broken by the order of the table"
        assert choose_route(chains.PUMA560, base, spec).counts == tuple(routes)


def count_written(program):
    """Return products, sums and sines of the C text of a program."""
    values = [text.partition(" = ")[2] for text in print_c(program, "double").statements if text[0] == "c"]
    marks = ((" * ", " / "), (" + ", " - "), ("sin(", "cos("))
    return tuple(sum(any(mark in value for mark in kind) for value in values) for kind in marks)


@settings(max_examples=15, deadline=None)
@given(robot=chains.trees(most=4, rotors=True, friction=True, followers=True, couplings=True, springs=True))
def test_what_is_emitted_has_the_counts_of_the_chosen_routes(robot):
    chosen = {count.function: count.operations for count in count_route_operations(robot) if count.chosen}
    made = build_functions(robot)
    assert {program.spec.name: count_operations(program) for program in made.programs} == chosen
    for program in made.programs:
        operations = chosen[program.spec.name]
        assert count_written(program) == (operations.mul, operations.add, operations.trig)


def test_every_function_of_the_catalogue_has_a_route():
    assert list(ROUTES) == [spec.name for spec in list_specs(dict.fromkeys("nlbpshzauv", 1))]
    assert len(SEVERAL) > 8
