"""The plant against closed solutions and the energy theorem."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from symid.errors import SolverError, UsageError
from symid.simulation.rigid_plant import RigidPlant, RigidPlantState, build_friction_lines, build_rest_state
from tests.refusals import raises
from tests.unit.simulation.conftest import ARM, Changed

PULL = (0.0,)


def moving(q, dq):
    q, dq = np.array(q, dtype=float), np.array(dq, dtype=float)
    return RigidPlantState(q=q, dq=dq, modes=tuple(int(np.sign(v)) for v in dq))


def run(plant, state, torques, period=1e-3):
    for torque in torques:
        state = plant.advance(state, np.atleast_1d(torque), period)
    return state


def test_wheels_stop_and_slow_down_by_their_closed_forms(make_library):
    # J ddq = -Fc from speed v: stops after J v^2 / (2 Fc), and stays.
    plant = RigidPlant(make_library("pendulum", (0.5, 0.0), ("coulomb-viscous",), (0.0, 2.0)))
    state = run(plant, moving([0.0], [3.0]), PULL * 2000)
    np.testing.assert_allclose(state.q, [0.5 * 9.0 / 4.0], rtol=1e-12)
    assert state.dq[0] == 0.0
    assert state.modes == (0,)
    assert state.events == 1
    np.testing.assert_allclose(state.dissipation, 0.5 * 0.5 * 9.0, rtol=1e-12)
    plant = RigidPlant(make_library("pendulum", (0.5, 0.0), ("coulomb-viscous",), (0.25, 0.0)))
    state = run(plant, moving([0.0], [1.0]), PULL * 1000)
    np.testing.assert_allclose(state.dq, [np.exp(-0.5)], rtol=1e-12)
    np.testing.assert_allclose(state.dissipation, 0.25 * (1 - np.exp(-1.0)), rtol=1e-9)
    plant = RigidPlant(make_library("pendulum", (0.5, 0.0), ("asymmetric",), (0.0, 2.0, 0.0, 4.0)))
    forward = run(plant, moving([0.0], [2.0]), PULL * 1500).q[0]
    backward = run(plant, moving([0.0], [-2.0]), PULL * 1500).q[0]
    np.testing.assert_allclose([forward, backward], [0.5, -0.25], rtol=1e-12)


@pytest.mark.parametrize(("torque", "moves"), [(1.9, False), (2.1, True), (-1.9, False), (-2.1, True)])
def test_a_held_joint_breaks_away_just_beyond_its_band(make_library, torque, moves):
    plant = RigidPlant(make_library("pendulum", (0.5, 0.0), ("coulomb-viscous",), (0.0, 2.0)))
    state = run(plant, build_rest_state(np.zeros(1)), [torque] * 100)
    # From rest under a constant net torque: q = (|tau| - Fc) t^2 / (2 J).
    expected = np.sign(torque) * 0.1 * 0.1**2 / (2 * 0.5) if moves else 0.0
    np.testing.assert_allclose(state.q, [expected], rtol=1e-9)


def test_an_offset_shifts_the_band(make_library):
    plant = RigidPlant(make_library("pendulum", (0.5, 0.0), ("coulomb-viscous-offset",), (0.0, 2.0, 1.0)))
    assert run(plant, build_rest_state(np.zeros(1)), [-0.9] * 10).q[0] == 0.0
    assert run(plant, build_rest_state(np.zeros(1)), [2.9] * 10).q[0] == 0.0
    assert run(plant, build_rest_state(np.zeros(1)), [-1.1] * 10).q[0] < 0.0


def energy_gap(library, torques, state, substeps=1):
    plant = RigidPlant(library)

    def find_energy(state):
        return float(sum(library.evaluate("energy", state.q[None], state.dq[None], plant.beta))[0, 0])

    start, most = find_energy(state), 0.0
    for torque in torques:
        state = plant.advance(state, torque, 1e-3, substeps)
        most = max(most, abs(state.work))
    return abs(state.work - (find_energy(state) - start) - state.dissipation) / most, state


def test_many_reversals_close_the_balance_and_smaller_steps_change_little(arm):
    times = np.arange(2000)[:, None] * 1e-3
    torques = np.array([30.0, 8.0]) * np.sin(np.array([20.0, 33.0]) * times)
    gap, state = energy_gap(arm, torques, build_rest_state(np.array([-np.pi / 2, 0.0])))
    assert state.events > 10
    assert gap < 1e-8
    times = np.arange(500)[:, None] * 1e-3
    torques = np.array([25.0, 6.0]) * np.sin(np.array([15.0, 25.0]) * times)
    start = build_rest_state(np.array([-np.pi / 2, 0.1]))
    _, coarse = energy_gap(arm, torques, start)
    _, fine = energy_gap(arm, torques, start, substeps=8)
    np.testing.assert_allclose(coarse.q, fine.q, atol=2e-5)


def test_frictionless_arm_agrees_with_an_adaptive_integrator(make_library):
    library = make_library("arm", ARM, ("none", "none"), ())
    plant, forward = RigidPlant(library), library.bind("forward_dynamics")
    state = run(plant, moving([0.3, -0.5], [0.4, -1.0]), [np.zeros(2)] * 1000)

    def slope(_t, x):
        return np.concatenate([x[2:], forward(x[:2], x[2:], np.zeros(2), plant.beta)[0]])

    truth = solve_ivp(slope, (0.0, 1.0), [0.3, -0.5, 0.4, -1.0], rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(np.concatenate([state.q, state.dq]), truth, atol=2e-9)


def test_held_joints_do_not_move_and_leave_the_others_free(make_library):
    library = make_library("arm", ARM, ("coulomb-viscous",) * 2, (0.0, 60.0, 0.0, 20.0))
    state = run(RigidPlant(library), build_rest_state(np.array([0.2, 0.4])), [np.zeros(2)] * 50)
    assert state.work == state.dissipation == 0.0
    np.testing.assert_array_equal(state.q, [0.2, 0.4])
    arm = make_library("arm", ARM, ("coulomb-viscous",) * 2, (0.0, 500.0, 0.0, 0.0))
    state = run(RigidPlant(arm), build_rest_state(np.array([0.0, 0.3])), [np.zeros(2)] * 400)
    pendulum = RigidPlant(make_library("pendulum", (0.3, 0.7), ("none",), ()))
    alone = run(pendulum, build_rest_state(np.array([0.3])), PULL * 400)
    assert state.q[0] == 0.0
    np.testing.assert_allclose([state.q[1], state.dq[1]], [alone.q[0], alone.dq[0]], rtol=1e-10)


def test_values_not_stated_and_friction_that_pushes_are_refused(make_library):
    library = make_library("pendulum", (0.5, None), ("none",), ())
    with raises(UsageError, "usage.unknown-values", match="states no value for"):
        RigidPlant(library)
    with raises(UsageError, "usage.negative-friction", match="joint1"):
        RigidPlant(make_library("pendulum", (0.5, 0.0), ("coulomb-viscous",), (0.0, -1.0)))
    library = make_library("arm", ARM, ("coulomb-viscous", "asymmetric"), (-1.0, 0.0, 0.0, 0.0, 0.0, -2.0))
    with raises(UsageError, *["usage.negative-friction"] * 2, match="joint1"):
        build_friction_lines(library)


def couple(library, rate, drives, values):
    """Give the arm drives beside its own friction, of speeds a dq1 + b dq2."""

    def evaluate(*inputs):
        (own,) = library.evaluate("friction_regressor", *inputs)
        felt = (rate(inputs[0] @ np.array(turn))[:, None, None] * np.array(turn)[:, None] for turn in drives)
        return (np.concatenate([own, *felt], axis=2),)

    pairs = enumerate(values, 1)
    cards = (replace(library.card.friction[0], name=f"m{k}", value=value) for k, value in pairs)
    functions = {"friction_regressor": evaluate}
    return Changed(library, functions, friction=(*library.card.friction, *cards))


BOTH, ONE = ((1.0, 1.0), (1.0, -1.0)), ((1.0, -0.5),)


def test_two_drives_whose_shares_cancel_brake_each_joint_alone(make_library):
    arm = make_library("arm", ARM, ("coulomb-viscous",) * 2, (0.1, 0.2, 0.3, 0.4))
    lines = build_friction_lines(couple(arm, np.positive, BOTH, (0.5, 0.5)))
    np.testing.assert_allclose(lines.viscous[1:], [[1.1, 1.3]] * 2, rtol=1e-14)
    np.testing.assert_allclose(lines.level[1:], [[0.2, 0.4], [-0.2, -0.4]], rtol=1e-14)


@pytest.mark.parametrize(
    ("rate", "drives", "values", "found"),
    [
        (np.positive, ONE, (0.2,), r"\(m1\)"),
        (np.sign, ONE, (0.2,), r"\(m1\)"),
        (np.positive, BOTH, (0.5, 0.6), "m1, m2"),
        (np.positive, BOTH, (0.5, 0.0), r"\(m1\)"),
        # At one of them moved alone the other feels nothing, at both moved it does.
        (np.sign, BOTH, (0.5, 0.5), "m1, m2"),
        (np.abs, BOTH, (0.5, 0.5), "m1, m2"),
    ],
)
def test_friction_that_depends_on_another_joint_is_refused(make_library, rate, drives, values, found):
    arm = make_library("arm", ARM, ("coulomb-viscous",) * 2, (0.1, 0.2, 0.3, 0.4))
    with raises(UsageError, "usage.shared-friction", match=found):
        build_friction_lines(couple(arm, rate, drives, values))


def test_endless_stops_are_an_error_with_a_remedy(make_library, monkeypatch):
    monkeypatch.setattr("symid.simulation.rigid_plant._MOST_EVENTS", 0)
    plant = RigidPlant(make_library("pendulum", (0.5, 0.0), ("coulomb-viscous",), (0.0, 2.0)))
    with raises(SolverError, "simulate.chatter", match=r"0 times within 0.001 s"):
        run(plant, moving([0.0], [1e-3]), PULL * 10)
