"""A plant with curved friction against closed forms: one mass on a slide, driven by a constant force."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from symid.codegen.cache import prepare_library
from symid.errors import UsageError
from symid.formats.toml import parse_robot
from symid.simulation.friction import find_friction_lines
from symid.simulation.plant import Plant, start_state

FILE = """
name = "slide"
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
name = "x"
kind = "prismatic"
alpha = "pi/2"
[joint.link]
mass = 2.0
com = [0, 0, 0]
[joint.friction]
{friction}
"""
STRIBECK = """
model = "stribeck"
Fv = 3.0
Fc = 4.0
Fe = 2.0
vs = 0.05
"""
MAKKAR = """
model = "makkar"
Fm = 1.0
Fc = 4.0
Fv = 3.0
g2 = 90
g3 = 20
g5 = 100
"""


@pytest.fixture(scope="module")
def stribeck(tmp_path_factory):
    return prepare_library(parse_robot(FILE.format(friction=STRIBECK)))


def fall(v):
    return 4.0 * np.sign(v) + 2.0 * np.exp(-((v / 0.05) ** 2)) * np.sign(v) + 3.0 * v


def test_its_levels_are_the_limits_at_standstill(stribeck):
    lines = find_friction_lines(stribeck)
    assert lines.level[:, 0].tolist() == [0.0, 6.0, -6.0]
    assert lines.curved.tolist() == [True]
    for mode in (1, -1):
        for speed in (0.2, 0.01, -0.003):
            # Beyond standstill the line goes on, mirrored.
            expected = fall(speed) if speed * mode > 0 else 12.0 * mode - fall(-speed)
            torque = lines.find_drag((mode,), np.array([speed]))[0] + lines.level[mode, 0]
            assert torque == pytest.approx(expected, rel=1e-14)
    assert lines.find_drag((0,), np.array([0.0])).tolist() == [0.0]


def test_it_sticks_below_the_static_level_and_breaks_away_above(stribeck):
    plant = Plant(stribeck)
    held = plant.advance(start_state(np.zeros(1)), np.array([5.999]), 0.1, 10)
    assert (held.q[0], held.dq[0], held.modes) == (0.0, 0.0, (0,))
    free = plant.advance(start_state(np.zeros(1)), np.array([6.001]), 0.1, 100)
    assert free.dq[0] > 0.0
    assert free.modes == (1,)


def test_it_slides_as_the_equation_of_motion_says(stribeck):
    plant = Plant(stribeck)
    state = plant.advance(start_state(np.zeros(1)), np.array([8.0]), 0.3, 3000)
    exact = solve_ivp(lambda _t, v: (8.0 - fall(v)) / 2.0, (0, 0.3), [1e-12], rtol=1e-11, atol=1e-13)
    assert state.dq[0] == pytest.approx(exact.y[0, -1], rel=1e-7)
    kinetic = 0.5 * 2.0 * state.dq[0] ** 2
    assert state.work == pytest.approx(kinetic + state.dissipation, rel=1e-7)


def test_it_comes_to_rest_and_stays(stribeck):
    plant = Plant(stribeck)
    moving = plant.advance(start_state(np.zeros(1)), np.array([8.0]), 0.3, 300)
    rest = plant.advance(moving, np.array([0.0]), 0.5, 500)
    assert (rest.dq[0], rest.modes) == (0.0, (0,))
    assert rest.events == moving.events + 1
    assert rest.work == pytest.approx(rest.dissipation, rel=1e-6)


def test_friction_that_is_continuous_never_sticks():
    library = prepare_library(parse_robot(FILE.format(friction=MAKKAR)))
    plant = Plant(library)
    state = plant.advance(start_state(np.zeros(1)), np.array([0.5]), 0.5, 1000)

    # It creeps at the speed whose friction is the force.
    def excess(v):
        return np.tanh(90 * v) - np.tanh(20 * v) + 4 * np.tanh(100 * v) + 3 * v - 0.5

    assert state.dq[0] == pytest.approx(brentq(excess, 0.0, 0.1, xtol=1e-15), rel=1e-8)


def test_curved_friction_that_pushes_is_refused():
    text = FILE.format(friction=STRIBECK.replace("Fe = 2.0", "Fe = -5.0"))
    with pytest.raises(UsageError, match="friction must oppose motion") as caught:
        find_friction_lines(prepare_library(parse_robot(text)))
    assert caught.value.notices[0].code == "usage.negative-friction"


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
    with pytest.raises(UsageError, match="Fem") as caught:
        find_friction_lines(prepare_library(parse_robot(text)))
    assert caught.value.notices[0].code == "usage.shared-friction"
