"""The Coriolis matrix is made of the Christoffel symbols of the mass matrix, and the regressor agrees."""

import numpy as np
from hypothesis import given, settings

from symid.codegen.functions import list_robot_specs
from symid.dynamics.base_parameters import derive_base_parameters
from tests.chains import PANDA, PUMA560, STANFORD, TWO_LINK, build_route_programs, each_robot, trees
from tests.sx_programs import run_program

STEP = 1e-5
NAMES = ("mass_matrix", "coriolis_matrix", "gravity", "slotine_li_regressor")


def find_symbols(mass, q):
    """Return c[i, j, k] = (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) / 2 by central differences."""
    steps = np.eye(len(q)) * STEP
    slopes = np.array([(mass(q + step) - mass(q - step)) / (2 * STEP) for step in steps])
    by_last = np.moveaxis(slopes, 0, 2)
    return (by_last + np.swapaxes(by_last, 1, 2) - np.moveaxis(by_last, 2, 0)) / 2


def check(robot):
    base = derive_base_parameters(robot)
    rng = np.random.default_rng(8)
    n = robot.freedom
    state = {name: rng.uniform(-2, 2, n) for name in ("q", "dq", "dqr", "ddqr")}
    beta = rng.uniform(-1, 1, base.count)
    specs = [spec for spec in list_robot_specs(robot, base) if spec.name in NAMES]
    programs = {spec.name: build_route_programs(robot, base, spec) for spec in specs}

    def mass(q):
        return run_program(programs["mass_matrix"]["composite bodies"], {"q": q, "beta": beta})[0]

    expected = np.einsum("ijk,k->ij", find_symbols(mass, state["q"]), state["dq"])
    scale = max(1.0, np.abs(expected).max())
    for program in programs["coriolis_matrix"].values():
        (found,) = run_program(program, {**state, "beta": beta})
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * scale)
    (gravity,) = run_program(programs["gravity"]["vector recursion"], {**state, "beta": beta})
    torque = mass(state["q"]) @ state["ddqr"] + expected @ state["dqr"] + gravity
    for program in programs["slotine_li_regressor"].values():
        (regressor,) = run_program(program, state)
        np.testing.assert_allclose(regressor @ beta, torque, rtol=0, atol=1e-6 * scale)


@each_robot(TWO_LINK, PUMA560, PANDA, STANFORD)
def test_known_robots(robot):
    check(robot)


@settings(max_examples=20, deadline=None)
@given(robot=trees(most=4, rotors=True, followers=True, springs=True))
def test_random_trees(robot):
    check(robot)
