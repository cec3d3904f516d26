"""Experiments: what is logged, what is true, and what bad calls get."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from symid.errors import SolverError, UsageError
from symid.excitation.trajectories import build_ta, build_tb
from symid.robot.description import Controller, Limits
from symid.simulation.experiment import (
    ExperimentOptions,
    SensorOptions,
    check_balance,
    compute_flow,
    simulate_experiment,
)
from tests.refusals import raises
from tests.unit.simulation.conftest import Changed

CLEAN = ExperimentOptions(duration=3.0, sensors=SensorOptions(counts_per_turn=None))


def simulate(robot, library, options=CLEAN, seed=1, trajectory=None):
    return simulate_experiment(robot, library, trajectory or build_ta(), options, np.random.default_rng(seed))


@pytest.mark.parametrize("viscous", [(0.0, 0.0, 0.0), (0.8, 0.0, 3.0), (1e4, 1e-3, 50.0)])
@pytest.mark.parametrize("period", [1e-4, 1e-3, 0.02])
def test_a_period_with_viscous_friction_is_the_exponential_of_the_equations(viscous, period):
    half = np.random.default_rng(3).normal(size=(4, 3, 3))
    mass = half @ half.swapaxes(1, 2) + 0.1 * np.eye(3)
    inverse, flow = np.linalg.inv(mass), np.zeros((4, 9, 9))
    flow[:, :3, 3:6] = np.eye(3)
    flow[:, 3:6, 3:6], flow[:, 3:6, 6:] = -inverse * viscous, inverse
    free, pulled = np.split(scipy.linalg.expm(period * flow)[:, :6], [6], axis=2)
    for found, known in zip(compute_flow(mass, np.array(viscous), period), (free, pulled), strict=True):
        np.testing.assert_allclose(found, known, rtol=1e-6, atol=1e-6 * np.abs(known).max())


def test_a_clean_run_closes_its_energy_balance_and_moves_by_its_equation(make_robot, arm):
    run = simulate(make_robot(2), arm)
    assert run.energy_gap < 1e-6
    assert run.events > 2
    assert run.work[0] == run.dissipation[0] == 0.0
    steps = np.einsum("ij,ij->i", run.torque[:-1], np.diff(run.q, axis=0))
    np.testing.assert_allclose(run.work[1:], np.cumsum(steps), rtol=1e-9, atol=1e-10)
    q, dq = run.q, run.dq
    ddq = np.gradient(dq, 1e-3, axis=0)
    # The energies and the losses, anew.
    beta = np.array([entry.value for entry in arm.card.beta])
    parts = [part[:, 0] for part in arm.evaluate("energy", q, dq, beta)]
    energy, still = sum(parts), np.zeros(len(q))
    gap = steps.sum() - (energy[-1] - energy[0]) - run.dissipation[-1]
    assert abs(gap) < 1e-6 * np.abs(steps).sum()
    assert check_balance(*parts, still, run.work, run.dissipation)[1] == pytest.approx(run.energy_gap)
    with raises(SolverError, "simulate.energy"):
        check_balance(*parts, still, run.work, 1.01 * run.dissipation)
    Fv, Fc, offset = np.array([0.8, 0.4]), np.array([1.5, 0.6]), np.array([0.0, 0.1])
    moving = np.abs(dq).min(axis=1) > 0.02
    moving[:2] = moving[-2:] = False
    (mass,), (bias,) = arm.evaluate("mass_matrix", q, beta), arm.evaluate("bias", q, dq, beta)
    predicted = np.einsum("nij,nj->ni", mass, ddq) + bias
    predicted += Fv * dq + Fc * np.sign(dq) + offset
    power = ((Fv * dq + Fc * np.sign(dq) + offset) * dq).sum(axis=1)
    assert np.trapezoid(power, dx=1e-3) == pytest.approx(run.dissipation[-1], rel=1e-3)
    gap = np.abs(predicted - run.recording.torque)[moving]
    # Were the torque logged half a period late, this would be fifty times as much.
    assert gap.max() < 2e-3 * np.abs(run.recording.torque).max()


def test_the_same_seed_gives_the_same_bytes_and_limits_hold(make_robot, arm):
    options = replace(CLEAN, duration=0.5, sensors=SensorOptions(torque_noise=(0.1,)))
    first, second = (simulate(make_robot(2), arm, options, seed=7).recording.torque for _ in range(2))
    assert first.tobytes() == second.tobytes()
    assert simulate(make_robot(2), arm, options, seed=8).recording.torque.tobytes() != first.tobytes()
    # Its weight takes up to 36.3 N m.
    robot = make_robot(2, limits=(Limits(torque=36.0), Limits()))
    run = simulate(robot, arm, replace(CLEAN, duration=1.0))
    assert np.abs(run.torque[:, 0]).max() == 36.0
    # The arm of these tests is not compiled.
    assert [notice.code for notice in run.recording.notices] == ["simulate.slow-plant", "simulate.saturation"]
    assert "joint1" in run.recording.notices[1].text


def test_arms_that_are_not_held_are_refused(make_robot, arm):
    robot = make_robot(2, limits=(Limits(torque=20.0), Limits()))
    with raises(SolverError, "simulate.not-held", match=r"'joint1'.*36.3 N m.*torque limit is 20 N m"):
        simulate(robot, arm, replace(CLEAN, duration=1.0))
    law = Controller(stiffness=(1.0, 1.0), damping=(1.0, 1.0), offset=(0.0, 0.0))
    with raises(SolverError, "simulate.not-held", match=r"gains are too low"):
        simulate(make_robot(2), arm, replace(CLEAN, controller=law))


def test_a_run_begins_without_a_fall_and_says_its_gains(make_robot, arm):
    # The reference does not move yet, and the weight is carried from the first tick on.
    run = simulate(make_robot(2), arm, replace(CLEAN, duration=0.2))
    beta = np.array([entry.value for entry in arm.card.beta])
    weight = arm.evaluate("bias", run.q[:1], np.zeros((1, 2)), beta)[0][0]
    assert np.abs(weight).max() > 20.0
    np.testing.assert_allclose(run.torque[0], weight, rtol=1e-12)
    np.testing.assert_allclose(run.recording.torque[0], weight, rtol=1e-12)
    assert np.abs(run.dq[:20]).max() < 1e-4

    def tell(bandwidth):
        run = simulate(make_robot(2), arm, replace(CLEAN, duration=0.2, bandwidth=bandwidth))
        codes = {notice.code: notice.text for notice in run.recording.notices}
        return codes.get("simulate.bandwidth", ""), run.controller.stiffness[0] / bandwidth**2

    (quiet, mean), (text, lowest) = tell(5.0), tell(60.0)
    assert quiet == ""
    assert lowest != pytest.approx(mean, rel=1e-3)
    assert "is 60 Hz" in text
    assert "lowest inertia" in text


def test_unstable_loops_and_massless_robots_are_errors_with_a_remedy(make_robot, arm, make_library):
    with raises(SolverError, "simulate.unstable", match="400 Hz"):
        simulate(make_robot(2), arm, replace(CLEAN, bandwidth=400.0))
    robot = make_robot(2, limits=(Limits(position=(-0.5, 0.5)), Limits(position=(-0.5, 0.5))))
    # Carried where it hangs on, but pushed by its own speed: the arm leaves its pose and swings through.
    weak = replace(CLEAN, duration=4.0, stiffness=(1e-3, 1e-3), damping=(-6.0, -6.0))
    with raises(SolverError, "simulate.unstable"):
        simulate(robot, arm, weak)
    kinds, friction = ("coulomb-viscous", "coulomb-viscous"), (0.1, 0.1, 0.1, 0.1)
    massless = make_library("arm", (1.0, 0.0, 0.0, 1.0, 0.0), kinds, friction)
    with raises(SolverError, "simulate.massless", match=r"'robot'.*rotor_inertia"):
        simulate(make_robot(2), massless)


def test_balances_that_do_not_close_or_are_not_finite_are_errors(make_robot, arm):
    odd = Changed(arm, {"energy": lambda q, dq, _: ((dq**2).sum(axis=1), np.sin(q[:, 0]))})
    with raises(SolverError, "simulate.energy", match=r"error of \d.*1e-06"):
        simulate(make_robot(2), odd, replace(CLEAN, duration=0.5))
    odd = Changed(arm, {"energy": lambda q, dq, _: (dq[:, 0] + np.nan, q[:, 0])})
    with raises(SolverError, "simulate.not-finite"):
        simulate(make_robot(2), odd, replace(CLEAN, duration=0.1))


def test_all_sizes_that_do_not_fit_are_said_at_once(make_robot, arm):
    options = replace(CLEAN, stiffness=(1.0,), duration=np.nan)
    with raises(UsageError, *["usage.experiment"] * 2) as caught:
        simulate(make_robot(1), arm, options, trajectory=build_tb(0, size=3))
    text = str(caught.value)
    for part in ("robot has 1", "trajectory 3", "library 2"):
        assert part in text
    assert "duration nan" in text
