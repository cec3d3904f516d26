"""The plant against closed solutions, an adaptive integrator and the energy theorem."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import solve_ivp

from symid.errors import SolverError, UsageError
from symid.simulation.rigid_plant import RigidPlant, RigidPlantState, build_friction_lines, build_rest_state
from tests.refusals import raises

PULL = (0.0,)
ARM = (1.2, 0.3, 0.35, 3.0, 0.7)


def moving(q, dq):
    q, dq = np.array(q, dtype=float), np.array(dq, dtype=float)
    return RigidPlantState(q=q, dq=dq, modes=tuple(int(np.sign(v)) for v in dq))


def run(plant, state, torques, period=1e-3):
    for torque in torques:
        state = plant.advance(state, np.atleast_1d(torque), period)
    return state


def test_frictionless_arm_agrees_with_an_adaptive_integrator(make_library):
    library = make_library("arm", (1.2, 0.3, 0.35, 3.0, 0.7), ("none", "none"), ())
    plant = RigidPlant(library)
    state = run(plant, moving([0.3, -0.5], [0.4, -1.0]), [np.zeros(2)] * 1000)

    def slope(_t, x):
        return np.concatenate(
            [x[2:], library.bind("forward_dynamics")(x[:2], x[2:], np.zeros(2), plant.beta)[0]]
        )

    truth = solve_ivp(slope, (0.0, 1.0), [0.3, -0.5, 0.4, -1.0], rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(np.concatenate([state.q, state.dq]), truth, atol=2e-9)


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
    start, most = sum(library.energy(state.q, state.dq, plant.beta)), 0.0
    for torque in torques:
        state = plant.advance(state, torque, 1e-3, substeps)
        most = max(most, abs(state.work))
    end = sum(library.energy(state.q, state.dq, plant.beta))
    return abs(state.work - (end - start) - state.dissipation) / most, state


@given(seed=st.integers(0, 10_000))
def test_energy_balance_closes_through_stops_and_reversals(seed):
    build_library = energy_gap.builder
    rng = np.random.default_rng(seed)
    kinds = rng.choice(["none", "coulomb-viscous", "coulomb-viscous-offset", "asymmetric"], size=2)
    count = {"none": 0, "coulomb-viscous": 2, "coulomb-viscous-offset": 3, "asymmetric": 4}
    friction = rng.uniform(0.1, 1.0, size=sum(count[kind] for kind in kinds))
    library = build_library("arm", (1.2, 0.3, 0.35, 3.0, 0.7), tuple(kinds), tuple(friction))
    times = np.arange(300)[:, None] * 1e-3
    torques = rng.uniform(2.0, 20.0, 2) * np.sin(rng.uniform(10.0, 60.0, 2) * times + rng.uniform(0, 6, 2))
    gap, _ = energy_gap(library, torques, build_rest_state(rng.uniform(-1, 1, 2)))
    assert gap < 1e-6


@pytest.fixture(autouse=True)
def _bring_builder(make_library):
    # hypothesis wants no function-scoped fixture among a test's own arguments
    energy_gap.builder = make_library


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


def test_held_joints_do_not_move_and_leave_the_others_free(make_library):
    library = make_library(
        "arm", (1.2, 0.3, 0.35, 3.0, 0.7), ("coulomb-viscous",) * 2, (0.0, 60.0, 0.0, 20.0)
    )
    state = run(RigidPlant(library), build_rest_state(np.array([0.2, 0.4])), [np.zeros(2)] * 50)
    assert state.work == state.dissipation == 0.0
    np.testing.assert_array_equal(state.q, [0.2, 0.4])
    arm = make_library("arm", (1.2, 0.3, 0.35, 3.0, 0.7), ("coulomb-viscous",) * 2, (0.0, 500.0, 0.0, 0.0))
    state = run(RigidPlant(arm), build_rest_state(np.array([0.0, 0.3])), [np.zeros(2)] * 400)
    pendulum = RigidPlant(make_library("pendulum", (0.3, 0.7), ("none",), ()))
    alone = run(pendulum, build_rest_state(np.array([0.3])), PULL * 400)
    assert state.q[0] == 0.0
    np.testing.assert_allclose([state.q[1], state.dq[1]], [alone.q[0], alone.dq[0]], rtol=1e-10)


def test_values_not_stated_and_friction_that_pushes_are_refused(make_library):
    library = make_library("pendulum", (0.5, None), ("none",), ())
    with raises(UsageError, "usage.unknown-values", match="states no value for b1"):
        RigidPlant(library)
    with raises(UsageError, "usage.negative-friction", match="joint1"):
        RigidPlant(make_library("pendulum", (0.5, 0.0), ("coulomb-viscous",), (0.0, -1.0)))
    library = make_library("arm", ARM, ("coulomb-viscous", "asymmetric"), (-1.0, 0.0, 0.0, 0.0, 0.0, -2.0))
    with raises(UsageError, *["usage.negative-friction"] * 2, match="joint1"):
        build_friction_lines(library)


@pytest.mark.parametrize("name", ["Fv", "Fc"])
def test_friction_that_depends_on_another_joint_is_refused(make_library, name):
    library = make_library("arm", ARM, ("coulomb-viscous",) * 2, (0.1, 0.2, 0.3, 0.4))
    own, rate = library.friction, {"Fv": lambda v: v, "Fc": np.sign}[name]

    def couple(dq):
        # A drive that turns with both: speed dq1 - dq2 / 2.
        felt = rate(dq[:, :1] - 0.5 * dq[:, 1:]) * [1.0, -0.5]
        return np.concatenate([own(dq), felt[:, :, None]], axis=2)

    library.friction = couple
    shared = replace(library.card.friction[1], name=f"{name}m")
    library.card = replace(library.card, friction=(*library.card.friction, shared))
    with raises(UsageError, "usage.shared-friction", match=rf"{name}m"):
        RigidPlant(library)


def couple_both(library, rate, values):
    """Give the arm two drives beside its own friction, of speeds dq1 + dq2 and dq1 - dq2."""
    own = library.friction

    def couple(dq):
        felt = [rate(dq[:, :1] + sign * dq[:, 1:]) * [1.0, sign] for sign in (1.0, -1.0)]
        return np.concatenate([own(dq), np.stack(felt, axis=2)], axis=2)

    library.friction = couple
    cards = (
        replace(library.card.friction[0], name=f"m{k}", value=value) for k, value in enumerate(values, 1)
    )
    library.card = replace(library.card, friction=(*library.card.friction, *cards))
    return library


def test_two_drives_whose_shares_cancel_brake_each_joint_alone(make_library):
    arm = make_library("arm", ARM, ("coulomb-viscous",) * 2, (0.1, 0.2, 0.3, 0.4))
    lines = build_friction_lines(couple_both(arm, lambda v: v, (0.5, 0.5)))
    np.testing.assert_allclose(lines.viscous[1:], [[1.1, 1.3]] * 2, rtol=1e-14)
    np.testing.assert_allclose(lines.level[1:], [[0.2, 0.4], [-0.2, -0.4]], rtol=1e-14)


@pytest.mark.parametrize(
    ("rate", "values", "found"),
    [
        (lambda v: v, (0.5, 0.6), "m1, m2"),
        (lambda v: v, (0.5, 0.0), r"\(m1\)"),
        # At one of them moved alone the other feels nothing, at both moved it does.
        (np.sign, (0.5, 0.5), "m1, m2"),
        (np.abs, (0.5, 0.5), "m1, m2"),
    ],
)
def test_two_drives_whose_shares_do_not_cancel_are_refused(make_library, rate, values, found):
    arm = make_library("arm", ARM, ("coulomb-viscous",) * 2, (0.1, 0.2, 0.3, 0.4))
    with raises(UsageError, "usage.shared-friction", match=found):
        build_friction_lines(couple_both(arm, rate, values))


def test_endless_stops_are_an_error_with_a_remedy(make_library, monkeypatch):
    monkeypatch.setattr("symid.simulation.rigid_plant._MOST_EVENTS", 0)
    plant = RigidPlant(make_library("pendulum", (0.5, 0.0), ("coulomb-viscous",), (0.0, 2.0)))
    with raises(SolverError, "simulate.chatter", match=r"0 times within 0.001 s"):
        run(plant, moving([0.0], [1e-3]), PULL * 10)
