"""Experiments with elastic robots: energy, rest at the start, sensors apart from the truth, refusals."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from symid.codegen.cache import prepare_library
from symid.errors import SolverError, UsageError
from symid.excitation.trajectories import build_ta, build_tb, build_tc, scale_trajectory
from symid.joint_models import FrictionValues
from symid.joint_models.hysteresis import Elasticity, Stop
from symid.joint_models.prandtl_ishlinskii import compute_hysteresis_torque, compute_spring_work
from symid.robot.description import Limits
from symid.simulation import elastic_plant
from symid.simulation.elastic_plant import build_plant_robot, compute_rest, get_elastic_values
from symid.simulation.experiment import (
    ExperimentOptions,
    SensorOptions,
    build_clean_options,
    build_noisy_options,
    observe,
    simulate_elastic,
    simulate_experiment,
)
from tests.chains import change_joints
from tests.refusals import raises
from tests.simulations import ELASTIC_CALLED
from tests.unit.simulation.conftest import Changed

CLEAN = build_clean_options()
FAST = scale_trajectory(build_ta(duration=8.0), 10.0)


def simulate(robot, library, trajectory=FAST, options=CLEAN, seed=0, **others):
    return simulate_elastic(robot, library, trajectory, options, np.random.default_rng(seed), **others)


@pytest.fixture(scope="module")
def fast(elastic_robot, elastic_library):
    """Return a clean run of ten times (TA)."""
    return simulate(elastic_robot, elastic_library)


@pytest.fixture(scope="module")
def noisy(elastic_robot, elastic_library):
    """Return a noisy run of (TC)."""
    return simulate(elastic_robot, elastic_library, build_tc(duration=6.0), build_noisy_options())


def test_motors_whose_friction_drives_them_are_refused(elastic_robot, c_compiler):
    """A cubic that pushes from 0.86 rad/s on: refused at once, or when a run gets there."""
    friction = FrictionValues(law="cubic", values=(0.6, 0.0, -0.7, 0.0))
    robot = change_joints(elastic_robot, friction=friction, limits=Limits())
    library = prepare_library(robot, names=ELASTIC_CALLED)
    with raises(UsageError, *["usage.negative-friction"] * 2, match=r"shoulder.* 0\.8[5-9] rad/s"):
        simulate(robot, library)
    slow = change_joints(robot, limits=Limits(velocity=0.5))
    with pytest.raises(UsageError, match=r"shoulder.* 0\.8[5-7] rad/s"):
        simulate(slow, library)
    assert simulate(slow, library, build_ta(duration=2.0)).dtheta.max() < 0.8


def find_spring_work(robot, run):
    """Return the work in J that went into the springs until each sample, from samples of the torsion."""
    pairs = zip(robot.axes, np.ascontiguousarray(run.phi.T), strict=True)
    return sum(compute_spring_work(joint.elasticity, phi) for joint, phi in pairs)


def find_smooth_losses(run):
    """Return what friction took until each sample, from samples of the true speed alone."""
    Fv, Fc = np.array([1.0, 0.5]), np.array([1.5, 0.6])
    power = (Fv * run.dtheta + Fc * np.tanh(run.dtheta / 0.01)) * run.dtheta
    return cumulative_simpson(power, dx=run.recording.period, axis=0, initial=0.0)


@pytest.mark.parametrize(
    "trajectory", [FAST, build_ta(duration=8.0), build_tb(0, duration=12.0), build_tb(1, duration=12.0)]
)
def test_energy_balance_of_windows_with_sums_and_plays_of_the_log(elastic_robot, elastic_library, trajectory):
    # Everything from what a perfect log holds, with exact sums, by code that knows no simulator.
    run = simulate(elastic_robot, elastic_library, trajectory)
    work = np.cumsum(run.torque[:-1] * np.diff(run.theta, axis=0), axis=0).sum(axis=1)
    springs = find_spring_work(elastic_robot, run)
    kinetic, potential = elastic_library.evaluate("energy", run.q, run.dq, run.values.beta)
    spin = 0.5 * (run.values.rotor * run.dtheta**2).sum(axis=1)
    energy = (kinetic + potential).ravel() + spin
    gap = np.concatenate([[0.0], work]) - (energy - energy[0]) - springs
    gap -= run.friction.sum(axis=1)
    window = 500
    assert np.abs(gap[window:] - gap[:-window]).max() < 1e-6
    assert find_window_gap(run, 0.1) < 1e-9
    assert run.energy_gap < 1e-9


def test_friction_and_joint_torque_are_those_of_their_models(elastic_robot, elastic_library, fast):
    slow = simulate(elastic_robot, elastic_library, build_ta(duration=8.0))
    np.testing.assert_allclose(slow.friction, find_smooth_losses(slow), atol=2e-6)
    # Ten times as fast, friction changes its sign within two samples of the log.
    np.testing.assert_allclose(fast.friction, find_smooth_losses(fast), atol=1e-4)
    for index, joint in enumerate(elastic_robot.axes):
        torque = compute_hysteresis_torque(joint.elasticity, np.ascontiguousarray(fast.phi[:, index]))
        # Torsion turns between samples: the plays of the samples miss the last bit of the way.
        np.testing.assert_allclose(fast.joint_torque[:, index], torque, atol=1e-5)


def find_window_gap(run, window, more=0.0):
    """Return the largest gap of the energy balance in J over windows of this length, wherever they begin."""
    samples, gap = round(window / run.recording.period), run.gap - more
    return np.abs(gap[samples:] - gap[:-samples]).max()


def test_a_clean_run_follows_and_its_log_is_the_truth(elastic_robot, fast):
    assert np.abs(fast.theta - fast.desired).max() < 0.02
    assert np.abs(fast.phi).max(axis=0).min() > 0.016
    recording = fast.recording
    np.testing.assert_array_equal(recording.position, fast.q)
    np.testing.assert_array_equal(recording.motor_position, fast.theta)
    np.testing.assert_array_equal(recording.torque, fast.torque)
    assert recording.period == pytest.approx(2e-4)
    assert "times 10" in recording.source
    # One percent more in springs or friction would be seen.
    assert find_window_gap(fast, 0.1, 0.01 * find_spring_work(elastic_robot, fast)) > 1e-4
    assert np.abs(fast.gap - 0.01 * fast.friction.sum(axis=1)).max() > 1e-4


def test_nothing_jumps_at_the_start_whatever_is_carried(elastic_robot, elastic_library):
    lying = replace(build_tc(duration=2.0), centre=np.array([1.2, -0.4]))
    run = simulate(elastic_robot, elastic_library, lying)
    weight = elastic_library.evaluate("gravity", run.q[:1], run.values.beta)[0][0]
    assert np.all(np.abs(weight) > 1.0)
    np.testing.assert_allclose(run.joint_torque[0], weight, rtol=1e-12)
    np.testing.assert_allclose(run.torque[0], weight, rtol=1e-12)
    np.testing.assert_array_equal(run.q[0], lying.centre)
    # The ramp moves by less than 1e-9 rad in the first ticks, and so does the robot.
    assert np.abs(run.dq[:20]).max() < 1e-6
    assert np.abs(run.dtheta[:20]).max() < 1e-4
    torque = compute_hysteresis_torque(elastic_robot.axes[0].elasticity, run.phi[:1, 0])
    assert torque[0] == pytest.approx(weight[0], rel=1e-9)
    run = simulate(elastic_robot, elastic_library, build_tc(duration=0.2))
    np.testing.assert_array_equal(run.torque[0], [0.0, 0.0])


def test_noisy_sensors_give_many_logs_of_one_truth(noisy):
    step = 2.0 * np.pi / 2.0**20
    for values in (noisy.recording.position, noisy.recording.motor_position):
        np.testing.assert_allclose(values / step, np.round(values / step), atol=1e-6)
    rms = np.sqrt((noisy.torque**2).mean(axis=0))
    ratio = (noisy.recording.torque - noisy.torque).std(axis=0) / rms
    np.testing.assert_allclose(ratio, 0.02, rtol=0.05)
    assert noisy.recording.period == pytest.approx(1e-3)
    again = [observe(noisy, build_noisy_options().sensors, np.random.default_rng(seed)) for seed in (0, 0, 5)]
    assert again[0].torque.tobytes() == again[1].torque.tobytes() == noisy.recording.torque.tobytes()
    assert again[2].torque.tobytes() != again[0].torque.tobytes()
    assert again[2].position.tobytes() == again[0].position.tobytes()


def test_delays_offsets_and_noise_of_sensors(fast):
    rng, time = np.random.default_rng(2), fast.recording.time
    late = observe(fast, SensorOptions(counts_per_turn=None, delay=0.00315, link_offset=(0.01, -0.02)), rng)
    wanted = [np.interp(time - 0.00315, time, column) for column in fast.q.T]
    shifted = np.stack(wanted, axis=1) + np.array([0.01, -0.02])
    np.testing.assert_allclose(late.position, shifted, atol=1e-15)
    np.testing.assert_array_equal(late.motor_position, fast.theta)
    early = observe(fast, SensorOptions(counts_per_turn=None, delay=-0.001, motor_offset=(0.5,)), rng)
    np.testing.assert_array_equal(early.position, fast.q)
    np.testing.assert_allclose(early.motor_position[5:], fast.theta[:-5] + 0.5, atol=1e-12)
    loud = observe(fast, SensorOptions(counts_per_turn=None, torque_noise=(0.5, 2.0)), rng)
    np.testing.assert_allclose((loud.torque - fast.torque).std(axis=0), [0.5, 2.0], rtol=0.03)


def test_gains_damp_critically(elastic_robot, elastic_library, monkeypatch):
    found = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr(elastic_plant, "simulate_plant", found)
    trajectory = build_ta(duration=1.0)
    trajectory = replace(trajectory, amplitude=0.0 * trajectory.amplitude)
    with pytest.raises(KeyboardInterrupt):
        simulate(elastic_robot, elastic_library, trajectory, ExperimentOptions(bandwidth=5.0))
    order, values = found.call_args.args[2], get_elastic_values(elastic_robot, elastic_library.card)
    (mass,) = elastic_library.evaluate("mass_matrix", trajectory.evaluate(np.zeros(1))[0], values.beta)
    inertia = 1.0 / np.diagonal(np.linalg.inv(mass[0] + np.diag(values.rotor)))
    # A light rotor would be shaken by its own held torque.
    damping = np.minimum(20.0 * np.pi * inertia, 0.4 * values.rotor / 1e-3)
    np.testing.assert_allclose(order.damping, damping)
    np.testing.assert_allclose(order.stiffness, damping**2 / (4.0 * inertia))


def test_springs_at_rest_carry_the_load_along_the_virgin_curve(elastic_robot, elastic_library):
    robot = build_plant_robot(get_elastic_values(elastic_robot, elastic_library.card))
    phi, play = compute_rest(robot, np.array([12.0, -3.0]), ("a", "b"))
    assert np.sign(phi).tolist() == [1.0, -1.0]
    for index, load in enumerate((12.0, -3.0)):
        torque = compute_hysteresis_torque(elastic_robot.axes[index].elasticity, phi[index : index + 1])
        assert torque[0] == pytest.approx(load, rel=1e-12)
    ahead = np.abs(phi)[:, None] - robot.radius
    np.testing.assert_allclose(np.abs(play), np.maximum(ahead, 0.0))
    phi, play = compute_rest(robot, np.zeros(2), ("a", "b"))
    assert not phi.any()
    assert not play.any()


def test_runs_that_go_wrong_are_errors_with_a_remedy(elastic_robot, elastic_library):
    values = get_elastic_values(elastic_robot, elastic_library.card)
    soft = tuple(replace(spring, cubic=-1e5, knees=()) for spring in values.elasticity)
    robot = build_plant_robot(replace(values, elasticity=soft))
    with raises(SolverError, "simulate.weak-spring", match="springs of hip cannot"):
        compute_rest(robot, np.array([500.0, 0.0]), ("hip", "knee"))
    wild = replace(CLEAN, stiffness=(4000.0, 1500.0), damping=(1e5, 1e5))
    free = change_joints(elastic_robot, limits=Limits())
    with raises(SolverError, "simulate.unstable", match="--stiffness") as caught:
        simulate(free, elastic_library, build_ta(duration=2.0), wild)
    # These gains do not follow from a bandwidth.
    assert "--bandwidth" not in caught.value.notices[0].text
    weak = change_joints(elastic_robot, limits=Limits(torque=1.0))
    with raises(SolverError, "simulate.not-held", match=r"'[a-z]+'.*reference.*torque limit is 1 N m"):
        simulate(weak, elastic_library, replace(build_ta(duration=4.0), centre=np.array([2.0, 0.0])))
    light = tuple(replace(entry, value=0.0) for entry in elastic_library.card.beta)
    with raises(SolverError, "simulate.massless"):
        simulate(elastic_robot, Changed(elastic_library, beta=light))


def test_robots_that_cannot_be_simulated_are_refused(elastic_robot, elastic_library):
    part = replace(
        elastic_robot, joints=(elastic_robot.joints[0], replace(elastic_robot.joints[1], elasticity=None))
    )
    library = Changed(elastic_library, elasticity=(elastic_robot.joints[0].elasticity, None))
    with raises(UsageError, "usage.not-elastic", match=r"without \[joint\.elasticity\] are elbow"):
        simulate(part, library)
    with raises(UsageError, "usage.elastic-robot", match="shoulder, elbow"):
        simulate_experiment(
            elastic_robot, elastic_library, FAST, ExperimentOptions(), np.random.default_rng(0)
        )
    sharp = change_joints(elastic_robot, friction=FrictionValues(law="coulomb-viscous", values=(1.0, 1.5)))
    with raises(UsageError, "usage.sharp-friction", match="Fc1, Fc2") as caught:
        simulate(sharp, elastic_library)
    assert "smoothing" in str(caught.value)
    with pytest.raises(UsageError, match="the trajectory 3"):
        simulate(elastic_robot, elastic_library, build_tc(size=3))


def test_values_that_are_missing_or_that_no_plant_can_have(elastic_robot, elastic_library):
    card = elastic_library.card
    library = Changed(
        elastic_library,
        rotors=card.rotors[:1],
        friction=(replace(card.friction[0], value=None), *card.friction[1:]),
        elasticity=(card.elasticity[0], Elasticity(stiffness=10.0, stops=(Stop(threshold=0.1),))),
    )
    with raises(UsageError, "usage.unknown-values") as caught:
        simulate(elastic_robot, library)
    for part in ("Fv1", "rotor_inertia of 'elbow'", "stiffness of 'elbow' and of its stops"):
        assert part in str(caught.value)
    library = Changed(
        elastic_library,
        rotors=(replace(card.rotors[0], value=0.0), card.rotors[1]),
        elasticity=(card.elasticity[0], Elasticity(stiffness=0.0)),
    )
    with raises(UsageError, *["usage.not-positive"] * 2) as caught:
        simulate(elastic_robot, library)
    assert "rotor_inertia of shoulder" in str(caught.value)
    assert "stiffness of elbow" in str(caught.value)


@pytest.mark.parametrize(
    ("options", "text"),
    [({"period": 0.0}, "period 0 s"), ({"stiffness": (1.0,), "damping": (1.0, 1.0)}, "1 numbers for 2")],
)
def test_options_that_cannot_be(elastic_robot, elastic_library, options, text):
    with raises(UsageError, "usage.experiment", match=text):
        simulate(elastic_robot, elastic_library, options=replace(CLEAN, **options))
