"""The Bouc-Wen spring against closed forms and an ODE solver."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from symid.joint_models.bouc_wen import BoucWen, compute_bouc_wen_torque

from symid.errors import RobotError


def test_the_first_curve_of_sharpness_one_is_an_exponential():
    model = BoucWen(stiffness=100.0, ratio=0.3, loop=40.0, lean=10.0)
    phi = np.linspace(0, 0.2, 30)
    hidden = (1.0 - np.exp(-50.0 * phi)) / 50.0
    np.testing.assert_allclose(compute_bouc_wen_torque(model, phi), 30 * phi + 70 * hidden, rtol=1e-7)
    np.testing.assert_allclose(compute_bouc_wen_torque(model, -phi), -30 * phi - 70 * hidden, rtol=1e-7)


def test_the_first_curve_of_sharpness_two_is_a_hyperbolic_tangent():
    model = BoucWen(stiffness=100.0, ratio=0.0, sharpness=2.0, loop=300.0, lean=100.0)
    phi = np.linspace(0, 0.3, 30)
    np.testing.assert_allclose(compute_bouc_wen_torque(model, phi), 5.0 * np.tanh(20.0 * phi), rtol=1e-7)


@pytest.mark.parametrize("sharpness", [1.0, 1.5, 3.0])
def test_a_path_with_reversals_against_an_ode_solver(sharpness):
    model = BoucWen(stiffness=100.0, ratio=0.2, sharpness=sharpness, scale=1.2, loop=70.0, lean=-20.0)
    turns = [0.0, 0.4, -0.3, 0.1, -0.5]
    phi, state, expected = [0.0], 0.01, [0.01]
    for start, end in itertools.pairwise(turns):
        sign = np.sign(end - start)

        def rate(_, z, sign=sign):
            return model.scale - abs(z) ** sharpness * (model.lean + model.loop * np.sign(z * sign))

        places = np.linspace(start, end, 5)
        done = solve_ivp(rate, (start, end), [state], t_eval=places, rtol=1e-11, atol=1e-13, max_step=1e-3)
        state = done.y[0, -1]
        phi += places[1:].tolist()
        expected += done.y[0, 1:].tolist()
    phi = np.array(phi)
    torque = compute_bouc_wen_torque(model, phi, 0.01)
    np.testing.assert_allclose(torque, 20.0 * phi + 80.0 * np.array(expected), rtol=0, atol=2e-5)
    # Longer steps change nothing but where the path is looked at.
    np.testing.assert_allclose(compute_bouc_wen_torque(model, phi[::4], 0.01), torque[::4], rtol=0, atol=1e-5)


def test_a_cycle_costs_energy_and_the_state_stays_bounded():
    model = BoucWen(stiffness=100.0, ratio=0.1, loop=40.0, lean=40.0)
    cycle = 0.3 * np.sin(np.linspace(0, 6 * np.pi, 3001))
    torque = compute_bouc_wen_torque(model, cycle)
    work = np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(cycle))
    assert work > 0
    assert np.max(np.abs(torque - 10.0 * cycle)) <= 90.0 / 80.0 + 1e-12


def test_parameters_outside_the_class_are_refused():
    with pytest.raises(RobotError) as caught:
        BoucWen(stiffness=-1.0, ratio=2.0, sharpness=0.5, scale=0.0, loop=1.0, lean=3.0)
    assert [notice.code for notice in caught.value.notices] == ["robot.invalid-elasticity"] * 5
