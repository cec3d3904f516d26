"""A plant with curved friction against closed forms: one mass on a slide, driven by a constant force."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from symid.codegen.cache import prepare_library
from symid.errors import SolverError, UsageError
from symid.joint_models import get_law
from symid.robot.toml_reader import parse_robot
from symid.simulation.rigid_plant import (
    RigidPlant,
    build_friction_lines,
    build_rest_state,
    check_friction_at_speeds,
)
from tests.friction_forms import EVERY_LAW, find_linear_torque
from tests.recovery.test_every_law import state_values
from tests.refusals import raises
from tests.simulations import CALLED, prepare_slide

STRIBECK = 'model = "stribeck"\nFv = 3.0\nFc = 4.0\nFe = 2.0\nvs = 0.05'
MAKKAR = 'model = "makkar"\nFm = 1.0\nFc = 4.0\nFv = 3.0\ng2 = 90\ng3 = 20\ng5 = 100'


@pytest.fixture(scope="module")
def stribeck():
    return prepare_slide(STRIBECK)


def fall(v):
    return 4.0 * np.sign(v) + 2.0 * np.exp(-((v / 0.05) ** 2)) * np.sign(v) + 3.0 * v


def test_it_sticks_breaks_away_slides_and_comes_to_rest(stribeck):
    plant = RigidPlant(stribeck)
    held = plant.advance(build_rest_state(np.zeros(1)), np.array([5.999]), 0.1, 10)
    assert (held.q[0], held.dq[0], held.modes) == (0.0, 0.0, (0,))
    free = plant.advance(build_rest_state(np.zeros(1)), np.array([6.001]), 0.1, 100)
    assert free.dq[0] > 0.0
    assert free.modes == (1,)
    state = plant.advance(build_rest_state(np.zeros(1)), np.array([8.0]), 0.3, 3000)
    exact = solve_ivp(lambda _t, v: (8.0 - fall(v)) / 2.0, (0, 0.3), [1e-12], rtol=1e-11, atol=1e-13)
    assert state.dq[0] == pytest.approx(exact.y[0, -1], rel=1e-7)
    kinetic = 0.5 * 2.0 * state.dq[0] ** 2
    assert state.work == pytest.approx(kinetic + state.dissipation, rel=1e-7)
    moving = plant.advance(build_rest_state(np.zeros(1)), np.array([8.0]), 0.3, 300)
    rest = plant.advance(moving, np.array([0.0]), 0.5, 500)
    assert (rest.dq[0], rest.modes) == (0.0, (0,))
    assert rest.events == moving.events + 1
    assert rest.work == pytest.approx(rest.dissipation, rel=1e-6)


def test_friction_that_is_continuous_never_sticks_unless_too_steep():
    plant = RigidPlant(prepare_slide(MAKKAR))
    state = plant.advance(build_rest_state(np.zeros(1)), np.array([0.5]), 0.5, 1000)

    # It creeps at the speed whose friction is the force.
    def excess(v):
        return np.tanh(90 * v) - np.tanh(20 * v) + 4 * np.tanh(100 * v) + 3 * v - 0.5

    assert state.dq[0] == pytest.approx(brentq(excess, 0.0, 0.1, xtol=1e-15), rel=1e-8)
    friction = 'model = "improved_stribeck"\nFv = 1\nFc = 4\nFe = 1\nFp = 0\nvs = 0.1\ndq0 = 1e-9'
    plant = RigidPlant(prepare_slide(friction, backend="python"))
    with raises(SolverError, "simulate.steep-friction", match=r"'x'.* 500 steps"):
        drive(plant, 1e-3, 100)


def write_table(name):
    linear, shape = state_values(get_law(name))
    return "\n".join([f'model = "{name}"', *(f"{key} = {value}" for key, value in (linear | shape).items())])


def test_bias_is_no_push():
    friction = 'model = "improved_stribeck"\nFv = 1\nFc = 1\nFe = 1\nFp = 9\nvs = 0.1\ndq0 = 0.02'
    assert RigidPlant(prepare_slide(friction, backend="python")).size == 1


CUBIC = 'model = "cubic"\nFv = 0.6\nFc = 0.2\nFvq = -1\nFvc = 0'


@pytest.mark.parametrize(
    ("friction", "said"),
    [
        (STRIBECK.replace("Fe = 2.0", "Fe = -5.0"), "joint 'x'"),
        (CUBIC, "joint 'x': .* 0.8[5-7] m/s"),
        ('model = "power_law"\nFc = 0.9\nFd = -0.5\ndelta = 1.5', "1.5 m/s"),
        ('model = "makkar"\nFm = 3\nFc = 0.1\nFv = 0\ng2 = 1\ng3 = 100\ng5 = 10', "from standstill on"),
        ('model = "load-dependent"\nFv = 1\nFc = 1\nFl = -0.2', "'x'"),
        ('model = "position-dependent"\nFv = 1\nFc = 1\nA1 = 0\nB1 = 2\nA2 = 0\nB2 = 0', "'x'"),
        ('model = "temperature"\nFv = 1\nFc = -1\nFvt = 0\nFct = 0', "'x'"),
        ('model = "polynomial-4"\nFv = 1\nFc = 1\nFv4 = -1', "'x'"),
        (None, "'x'"),
    ],
)
def test_a_curve_that_pushes_is_refused(friction, said):
    library = prepare_slide(friction or write_table("improved-stribeck-h4"), backend="python")
    with raises(UsageError, "usage.negative-friction", match=said):
        RigidPlant(library)


def test_a_curve_that_pushes_only_beyond_the_velocity_limit_is_refused_when_it_gets_there():
    library = prepare_slide(CUBIC, backend="python")
    plant = RigidPlant(library, speeds=np.array([0.8]))
    check_friction_at_speeds(plant.friction, library.card.joints, np.array([[0.0], [0.8], [-0.8]]))
    with raises(UsageError, "usage.negative-friction", match=r"0.8\d m/s"):
        check_friction_at_speeds(plant.friction, library.card.joints, np.array([[0.0], [0.8], [-0.9]]))


def find_improved(v, edge):
    fall = np.exp(-((np.maximum(np.abs(v), edge) / 0.01292) ** 2))
    return 8.9 * v + (3.99 + 3.33 * fall) * np.clip(v / edge, -1.0, 1.0) - 0.33


def drive(plant, period, count):
    """Return force, velocity and the end of a run under a force that changes its sign."""
    state, speeds = build_rest_state(np.zeros(1)), [0.0]
    torque = [9.0 * np.sin(2 * np.pi * 2.0 * k * period) for k in range(count)]
    for value in torque:
        state = plant.advance(state, np.array([value]), period)
        speeds.append(float(state.dq[0]))
    return torque, np.array(speeds), state


@pytest.mark.parametrize(("edge", "allowed"), [(0.005, 2e-5), (0.0005, 3e-4)])
def test_a_steep_zone_is_followed_as_an_implicit_solver_does(edge, allowed):
    """A light joint, so that friction stops it at 2e4 and 2e5 / s, against steps of a millisecond."""
    values = "Fv = 8.9\nFc = 3.99\nFe = 3.33\nFp = -0.33\nvs = 0.01292"
    friction = f'model = "improved_stribeck"\n{values}\ndq0 = {edge}'
    period, count = 1e-3, 440
    torque, speeds, state = drive(RigidPlant(prepare_slide(friction, mass=0.08)), period, count)
    exact = [0.0]
    for value in torque:
        done = solve_ivp(
            lambda _t, v, value=value: (value - find_improved(v, edge)) / 0.08,
            (0.0, period),
            [exact[-1]],
            method="LSODA",
            rtol=1e-10,
            atol=1e-13,
        )
        exact.append(float(done.y[0, -1]))
    assert np.ptp(exact) > 0.5
    # Where it breaks away it falls from a knee, which makes much of any difference.
    assert np.abs(speeds - exact).max() < allowed * np.abs(exact).max()
    kinetic = 0.5 * 0.08 * state.dq[0] ** 2
    assert state.work == pytest.approx(kinetic + state.dissipation, rel=1e-7)


def test_curved_friction_of_a_drive_of_two_joints_is_refused():
    joint = """
[[joint]]
name = "{name}"
kind = "prismatic"
alpha = "pi/2"
[joint.link]
mass = 2.0
com = [0, 0, 0]
"""
    text = 'name = "two"\nconvention = "modified"\ngravity = [0, 0, -9.81]\n'
    text += joint.format(name="x") + joint.format(name="y")
    text += '[[coupling]]\nname = "m"\nterms = { x = 1, y = 1 }\n[coupling.friction]\nmodel = "stribeck"\n'
    text += "Fv = 0\nFc = 0\nFe = 1\nvs = 0.01\n"
    with raises(UsageError, "usage.shared-friction", match="Fem"):
        build_friction_lines(prepare_library(parse_robot(text), names=CALLED, backend="python"))


# Reading H4 drives between standstill and its origin.
SIMULATED = [name for name in EVERY_LAW if "h4" not in name]


@pytest.mark.parametrize("name", SIMULATED)
def test_every_law_slides_by_its_equation_and_loses_what_the_drive_gives(name):
    plant = RigidPlant(prepare_slide(write_table(name), backend="python"))
    state = plant.advance(build_rest_state(np.array([0.2])), np.array([12.0]), 0.15, 300)
    values = [list(part.values()) for part in state_values(get_law(name))]

    def find_drag(q, v):
        """Return friction where the gear carries what the drive gives less friction."""
        inputs = get_law(name).inputs
        given = {key: value for key, value in (("position", q), ("temperature", 40.0)) if key in inputs}
        if "load" not in inputs:
            return find_linear_torque(name, *values, v, **given)

        def miss(load):
            return 12.0 - load - find_linear_torque(name, *values, v, load=load, **given)

        return 12.0 - brentq(miss, -50.0, 50.0, xtol=1e-14)

    def slope(_, state):
        return [state[1], (12.0 - find_drag(*state)) / 2.0]

    exact = solve_ivp(slope, (0, 0.15), [0.2, 1e-12], rtol=1e-10, atol=1e-12, method="LSODA").y[:, -1]
    assert (state.q[0], state.dq[0]) == pytest.approx(tuple(exact), rel=3e-6)
    state, speeds = build_rest_state(np.zeros(1)), []
    for k in range(500):
        state = plant.advance(state, np.array([12.0 * np.sin(2 * np.pi * 4.0 * k * 1e-3)]), 1e-3)
        speeds.append(float(state.dq[0]))
    assert max(speeds) > 0.05
    assert min(speeds) < -0.05
    assert state.work == pytest.approx(state.dq[0] ** 2 + state.dissipation, rel=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_weight_that_a_gear_carries_holds_it(side):
    """A slide that stands upright: friction of 4 N and a tenth of the weight, 19.62 N, holds it."""
    friction = 'model = "load-dependent"\nFv = 3\nFc = 4\nFl = 0.1'
    plant = RigidPlant(prepare_slide(friction, alpha="0 deg", backend="python"))
    weight, band = 2.0 * 9.81, 4.0 + 0.1 * 2.0 * 9.81
    held = plant.advance(build_rest_state(np.zeros(1)), np.array([weight + side * (band - 1e-3)]), 0.05, 10)
    assert (held.q[0], held.dq[0], held.modes) == (0.0, 0.0, (0,))
    free = plant.advance(build_rest_state(np.zeros(1)), np.array([weight + side * (band + 1e-3)]), 0.05, 100)
    assert side * free.dq[0] > 0.0
    # Lying flat, its gear carries nothing at rest.
    plant = RigidPlant(prepare_slide(friction, backend="python"))
    for force, moves in ((3.999, False), (4.001, True)):
        state = plant.advance(build_rest_state(np.zeros(1)), np.array([side * force]), 0.05, 100)
        assert bool(state.dq[0]) is moves
