"""Elastic robots whose motors have friction with a state, against an implicit solver and by their energy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import symid
from symid.codegen.cache import prepare_library
from symid.codegen.compiled_models import PlantExperiment
from symid.robot.toml_reader import parse_robot
from symid.simulation.elastic_plant import build_plant_robot, get_elastic_values, simulate_in_numpy
from tests.simulations import ELASTIC_CALLED
from tests.state_laws import ARM as PENDULUM, LAWS, find_rate, find_torque, give_values, write_table

_SPRING = """
[joint.drive]
rotor_inertia = 0.2
rotor_inertia_side = "joint"
[joint.elasticity]
stiffness = 400.0
damping = 0.5
"""
_LIMITS = """
[joint.limits]
position = [-1.0, 1.0]
velocity = 2.0
acceleration = 10.0
"""
ARM = (
    PENDULUM.replace("[0, -9.81, 0]", "[9.81, 0, 0]").replace(
        "[joint.friction]", f"{_SPRING}[joint.friction]"
    )
    + _LIMITS
)
INERTIA, ROTOR, STIFFNESS, DAMPING, PERIOD = 0.03 + 2.0 * 0.2**2, 0.2, 400.0, 0.5, 1e-3
STIFF = {"sigma0": 2e4, "sigma1": 60.0}


def order_run(substeps, ticks=200):
    """Return an open loop: torques that move the motor to and fro through its bristles' reach."""
    time = np.arange(ticks) * PERIOD
    torque = 7.0 * np.sin(2.0 * np.pi * 6.0 * time)[:, None]
    zero = np.zeros_like(torque)
    return PlantExperiment(
        **dict.fromkeys(("angle", "speed"), zero),
        torque=torque,
        **{name: np.zeros(1) for name in ("stiffness", "damping", "step", "q", "theta")},
        limit=np.full(1, np.inf),
        period=PERIOD,
        substeps=substeps,
        parts=16,
        play=np.zeros((1, 0)),
    )


def solve(p, order):
    """Return q, dq, theta, dtheta and z at the ticks by Radau's method."""
    x, rows = np.zeros(5), []
    for torque in order.torque[:, 0]:
        rows.append(x)

        def slope(_t, x, torque=torque):
            q, dq, theta, dtheta, z = x
            spring = STIFFNESS * (theta - q) + DAMPING * (dtheta - dq)
            ddq = (spring - 2.0 * 9.81 * 0.2 * np.sin(q)) / INERTIA
            spin = (torque - spring - find_torque(p, dtheta, [z])) / ROTOR
            return [dq, ddq, dtheta, spin, find_rate(p, dtheta, z)]

        tight = [1e-12, 1e-11, 1e-12, 1e-11, 1e-15]
        x = solve_ivp(slope, (0.0, PERIOD), x, "Radau", rtol=1e-9, atol=tight).y[:, -1]
    return np.array(rows)


@pytest.mark.parametrize("name", ["lugre", "dahl"])
def test_motors_move_as_an_implicit_solver_says_and_the_nearer_the_shorter_the_steps(name):
    changed = STIFF if name == "lugre" else {"sigma0": 2e4}
    robot = parse_robot(ARM.format(friction=write_table(name, **changed)))
    library = prepare_library(robot, names=(*ELASTIC_CALLED, "friction_step"))
    plant = build_plant_robot(get_elastic_values(robot, library.card))
    exact = solve(give_values(name) | changed, order_run(1))
    assert np.ptp(exact[:, 3]) > 0.3
    errors = []
    for substeps in (10, 40):
        log = simulate_in_numpy(library, plant, order_run(substeps))
        found = np.hstack([log.q, log.dq, log.theta, log.dtheta])
        errors.append((np.abs(found - exact[:, :4]).max(axis=0) / np.abs(exact[:, :4]).max(axis=0)).max())
    assert errors[0] < 1e-3
    assert errors[1] < 1e-4
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("name", LAWS)
def test_an_experiment_balances_and_says_that_it_is_slow(name, tmp_path):
    (tmp_path / "arm.toml").write_text(ARM.format(friction=write_table(name)))
    run = symid.load(tmp_path / "arm.toml").simulate(duration=0.5, seed=2)
    assert run.energy_gap < 1e-6
    (notice,) = (notice for notice in run.notices if notice.code == "simulate.slow-plant")
    assert "friction has a state: the elastic robot is simulated in NumPy" in notice.text
