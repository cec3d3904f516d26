"""A plant whose friction has a state: against an implicit solver, closed forms, its energy."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from symid.codegen.cache import prepare_library
from symid.robot.toml_reader import parse_robot
from symid.simulation.rigid_plant import RigidPlant, build_rest_state
from tests.simulations import CALLED
from tests.state_laws import ARM, LAWS, find_level, find_rate, find_torque, give_values, write_table

INERTIA, WEIGHT, PERIOD = 0.03 + 2.0 * 0.2**2, 2.0 * 9.81 * 0.2, 1e-3
STIFF = {"sigma0": 1e5, "sigma1": 100.0}


def prepare(name, **changed):
    robot = parse_robot(ARM.format(friction=write_table(name, **changed)))
    return prepare_library(robot, names=(*CALLED, "friction_step"))


def give_torque(count):
    """Return torques that swing the arm to and fro through its bristles' reach, and let it rest at times."""
    time = np.arange(count) * PERIOD
    return WEIGHT + 5.0 * np.sin(2.0 * np.pi * 4.0 * time) * (np.sin(2.0 * np.pi * time) > -0.5)


def drive(library, torque, substeps=1):
    plant = RigidPlant(library)
    states = [build_rest_state(np.zeros(plant.size), plant.memory)]
    for value in torque:
        states.append(plant.advance(states[-1], np.array([value]), PERIOD, substeps))
    return plant, states


def solve(p, torque):
    """Return q, dq and z at the ticks by Radau's method."""
    x = np.zeros(3)
    rows = [x]
    for value in torque:

        def slope(_t, x, value=value):
            load = value - WEIGHT * np.cos(x[0]) - find_torque(p, x[1], [x[2]])
            return [x[1], load / INERTIA, find_rate(p, x[1], x[2])]

        x = solve_ivp(slope, (0.0, PERIOD), x, "Radau", rtol=1e-9, atol=[1e-13, 1e-12, 1e-16]).y[:, -1]
        rows.append(x)
    return np.array(rows)


@pytest.mark.parametrize("name", ["lugre", "dahl"])
def test_it_moves_as_an_implicit_solver_says_and_the_nearer_the_shorter_the_steps(name):
    """Stick, break-away, slip and reversals; errors relative to the largest of q, dq and z."""
    changed = STIFF if name == "lugre" else {"sigma0": 1e5}
    torque, library = give_torque(250), prepare(name, **changed)
    exact = solve(give_values(name) | changed, torque)
    assert np.ptp(exact[:, 1]) > 0.3
    errors = []
    for substeps in (1, 16, 64):
        _, states = drive(library, torque, substeps)
        found = np.array([[state.q[0], state.dq[0], state.bristles[0]] for state in states])
        errors.append(np.abs(found - exact).max(axis=0) / np.abs(exact).max(axis=0))
    assert np.all(errors[0] <= [1e-5, 1e-5, 1e-4])
    assert np.all(errors[1] <= [1e-6, 1e-6, 1e-5])
    assert np.all(errors[2] <= 1e-7)


@pytest.mark.parametrize("name", LAWS)
def test_work_is_motion_bent_bristles_and_heat_with_long_and_short_steps(name):
    library = prepare(name)
    plant, states = drive(library, give_torque(400))
    q, dq = (np.array([getattr(state, part) for state in states]) for part in ("q", "dq"))
    energy = sum(part.reshape(-1) for part in library.evaluate("energy", q, dq, plant.beta))
    p = give_values(name)
    stiffness = np.atleast_1d(p.get("sigma0", p.get("stiffness")))
    stored = np.array([0.5 * stiffness @ state.bristles**2 for state in states])
    work, lost = (np.array([getattr(state, part) for state in states]) for part in ("work", "dissipation"))
    gap = np.abs(work - (energy - energy[0]) - stored - lost).max()
    assert gap <= 1e-8 * np.abs(work).max()
    # A part of the losses of an offset comes back.
    offset = p.get("offset", 0.0) * np.diff(q[:, 0])
    assert np.all(np.diff(lost) - offset >= -1e-12)
    assert lost[-1] > 10.0 * stored.max()
    # No bristle bends more than the largest level, and no element than its share.
    share = np.atleast_1d(p.get("share", 1.0)) / stiffness * find_level(p, 0.0)
    assert all(np.all(np.abs(state.bristles) <= share * (1.0 + 1e-9)) for state in states)
    torque, library = give_torque(150), prepare(name)
    once, often = (drive(library, torque, substeps)[1] for substeps in (1, 8))
    speeds = np.array([[one.dq[0], other.dq[0]] for one, other in zip(once, often, strict=True)])
    assert np.ptp(speeds[:, 0]) > 0.3
    assert np.abs(np.diff(speeds, axis=1)).max() <= 1e-4 * np.abs(speeds).max()
    p, library = give_values(name), prepare(name)
    most, offset = find_level(p, 0.0), p.get("offset", 0.0)
    for share, slides in ((0.9, False), (1.1, True)):
        # Slowly, or bristles without damping swing beyond it.
        ramp = WEIGHT + offset + share * most * np.minimum(np.arange(600) / 400.0, 1.0)
        _, states = drive(library, ramp)
        assert bool(abs(states[-1].dq[0]) > 0.05) is slides


def test_small_pushes_meet_a_spring_and_a_damper():
    """Bristles that hardly bend: J ddq + (sigma1 + Fv) dq + sigma0 q = push, about the pose held."""
    p = give_values("lugre") | {"sigma0": 2e3, "sigma1": 8.0}
    push, library = 1e-4, prepare("lugre", sigma0=2e3, sigma1=8.0)
    _, states = drive(library, np.full(60, WEIGHT + push))
    decay = (p["sigma1"] + p["Fv"]) / (2.0 * INERTIA)
    turn = np.sqrt(p["sigma0"] / INERTIA - decay**2)
    time = np.arange(61) * PERIOD
    swing = np.exp(-decay * time) * (np.cos(turn * time) + decay / turn * np.sin(turn * time))
    expected = push / p["sigma0"] * (1.0 - swing)
    assert np.abs([state.q[0] for state in states] - expected).max() <= 3e-4 * expected.max()


def test_joints_with_a_state_move_beside_joints_that_stick():
    joints = [
        ARM.split("[[joint]]")[1].replace('"a"', f'"{name}"').format(friction=friction)
        for name, friction in (
            ("a", write_table("maxwell-slip")),
            ("b", 'model = "coulomb-viscous"\nFv = 0.5\nFc = 1.0'),
            ("c", 'model = "load-dependent"\nFv = 0.5\nFc = 1.0\nFl = 0.1'),
        )
    ]
    text = ARM.split("[[joint]]", maxsplit=1)[0] + "[[joint]]" + "[[joint]]".join(joints)
    library = prepare_library(parse_robot(text), names=(*CALLED, "friction_step"))
    plant = RigidPlant(library)
    states = [build_rest_state(np.zeros(3), 3)]
    weight = plant.compute_weight(np.zeros(3))
    for k in range(300):
        push = weight + np.array([6.0, 3.0, 2.0]) * np.sin(0.02 * k + np.arange(3))
        states.append(plant.advance(states[-1], push, PERIOD))
    modes = np.array([state.modes for state in states])
    # Joints without bristles come to rest; one with bristles turns and is never held.
    assert np.any(modes[1:, 1] == 0)
    assert np.all(modes[1:, 0] != 0)
    q, dq = (np.array([getattr(state, part) for state in states]) for part in ("q", "dq"))
    energy = sum(part.reshape(-1) for part in library.evaluate("energy", q, dq, plant.beta))
    stored = np.array([plant.bristles.compute_energy(state.bristles) for state in states])
    gap = [
        state.work - state.dissipation - store - (now - energy[0])
        for state, store, now in zip(states, stored, energy, strict=True)
    ]
    assert np.abs(gap).max() <= 1e-7 * max(abs(state.work) for state in states)
    assert all(after.dissipation >= before.dissipation - 1e-12 for before, after in pairwise(states))
