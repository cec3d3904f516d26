"""The simulated loop against closed forms, and against the experiment that it stands for."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter

from symid.codegen.cache import prepare_library
from symid.errors import SolverError, UsageError
from symid.excitation.trajectories import FourierOptions, build_random_fourier
from symid.identification.rigid.closed_loop import (
    build_closed_loop,
    compute_demand,
    compute_settling,
    list_unusable,
    simulate_closed_loop,
)
from symid.logs.recording import Recording
from symid.robot.description import Controller
from symid.robot.toml_reader import read_robot
from symid.simulation.experiment import ExperimentOptions, SensorOptions, simulate_experiment
from tests.refusals import raises

MASS, VISCOUS = 20.0, 60.0
PERIOD, COUNT = 2e-3, 400
GAINS = Controller(stiffness=(9000.0,), damping=(700.0,))
FREE = np.full(2, np.inf)


@pytest.fixture(scope="module")
def axis(robots_folder):
    return prepare_library(read_robot(robots_folder / "emps.toml"))


@pytest.fixture(scope="module")
def robot(robots_folder):
    return read_robot(robots_folder / "two_link.toml")


@pytest.fixture(scope="module")
def arm(robot):
    return prepare_library(robot)


def make_recording():
    time = PERIOD * np.arange(COUNT)
    reference = 0.2 * np.sin(4.0 * time)[:, None] + 0.3
    return Recording(
        time=time,
        position=np.full((COUNT, 1), 0.31),
        torque=np.zeros((COUNT, 1)),
        reference=reference,
        reference_velocity=0.8 * np.cos(4.0 * time)[:, None],
        feedforward=5.0 * np.sin(9.0 * time)[:, None],
    )


def run_mass(recording, controller, start_speed, limit=np.inf):
    """Return positions and held forces of a mass with viscous friction: the exact step of a held force."""
    plant = expm(PERIOD * np.array([[0, 1, 0], [0, -VISCOUS / MASS, 1 / MASS], [0, 0, 0]]))
    q, dq = recording.position[0, 0], start_speed
    slow, last = dq, q - PERIOD * dq
    cutoff = controller.velocity_filter
    keep = 0.0 if cutoff is None else np.exp(-2.0 * np.pi * cutoff * PERIOD)
    positions, forces = [], []
    for k in range(COUNT):
        raw = dq if controller.velocity_source == "sensor" else (q - last) / PERIOD
        slow, last = keep * slow + (1.0 - keep) * raw, q
        wanted = recording.reference_velocity[k, 0] if controller.velocity == "error" else 0.0
        force = controller.offset[0] + recording.feedforward[k, 0]
        force += controller.stiffness[0] * (recording.reference[k, 0] - q)
        force += controller.damping[0] * (wanted - slow)
        force = min(max(force, -limit), limit)
        positions.append(q)
        forces.append(force)
        q, dq, _ = plant @ [q, dq, force]
    return np.array(positions), np.array(forces)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"velocity": "measured"},
        {"velocity_source": "sensor"},
        {"velocity_filter": 60.0},
        {"velocity_source": "sensor", "velocity_filter": 60.0},
        {"torque": "average"},
    ],
)
@pytest.mark.parametrize("limit", [np.inf, 60.0])
def test_a_mass_moves_as_its_closed_form(axis, changes, limit):
    recording, controller = make_recording(), replace(GAINS, offset=(7.0,), **changes)
    loop = build_closed_loop(recording, controller, np.array([limit]))
    values = np.array([MASS, VISCOUS, 0.0, 0.0])
    found = simulate_closed_loop(axis, values, recording, loop)
    positions, forces = run_mass(recording, controller, recording.reference_velocity[0, 0], limit)
    np.testing.assert_allclose(found.q[:, 0], positions, rtol=0, atol=1e-7)
    logged = forces.copy()
    if controller.torque == "average":
        logged[1:] = 0.5 * (forces[1:] + forces[:-1])
    np.testing.assert_allclose(found.tau[:, 0], logged, rtol=0, atol=2e-3)
    assert (np.abs(forces).max() == limit) == (limit == 60.0)


def run_experiment(robot, arm, seed, options, seconds=2.0):
    motion = build_random_fourier(robot, np.random.default_rng(seed), FourierOptions(duration=seconds))
    return simulate_experiment(robot, arm, motion, options, np.random.default_rng(0))


def test_the_loop_is_that_of_the_experiment(robot, arm):
    options = ExperimentOptions(period=2e-3, sensors=SensorOptions(counts_per_turn=None))
    made = run_experiment(robot, arm, 2, options)
    assert made.controller.torque == "average"
    limit = np.array([joint.limits.torque or np.inf for joint in robot.axes])
    values = np.array([entry.value for entry in (*arm.card.beta, *arm.card.friction)])
    loop = build_closed_loop(made.recording, made.controller, limit)
    found = simulate_closed_loop(arm, values, made.recording, loop)
    np.testing.assert_allclose(found.q, made.q, rtol=0, atol=1e-9)
    # An experiment repeats its last torque: nothing follows that it could be held for.
    np.testing.assert_allclose(found.tau[:-1], made.recording.torque[:-1], rtol=0, atol=1e-5)
    demand = compute_demand(loop, made.recording)
    np.testing.assert_allclose(demand[5:-1], made.recording.torque[5:-1], rtol=0, atol=1e-5)
    # A constant torque comes from the log.
    made = run_experiment(robot, arm, 5, ExperimentOptions(period=2e-3), 3.0)
    loop = build_closed_loop(made.recording, replace(made.controller, offset=None), FREE)
    np.testing.assert_allclose(loop.offset, made.controller.offset, rtol=1e-4)


def test_the_experiment_takes_the_controller_of_the_robot_file(robot, arm):
    law = Controller(
        stiffness=(400.0, 60.0),
        damping=(25.0, 3.0),
        velocity="measured",
        velocity_source="sensor",
        velocity_filter=200.0,
        offset=(12.0, 1.0),
    )
    options = ExperimentOptions(period=2e-3, controller=law, sensors=SensorOptions(counts_per_turn=None))
    made = run_experiment(robot, arm, 2, options, 1.0)
    assert made.controller == replace(law, torque="average")
    keep = np.exp(-2.0 * np.pi * 200.0 * 2e-3)
    slow = lfilter([1.0 - keep], [1.0, -keep], made.dq, axis=0)
    held = np.array([12.0, 1.0]) + [400.0, 60.0] * (made.recording.reference - made.q) - [25.0, 3.0] * slow
    np.testing.assert_allclose(made.torque[:-1], held[:-1], rtol=0, atol=1e-9)
    # Gains that are given besides take the place of its own; the rest stays.
    options = replace(options, stiffness=(500.0, 70.0), damping=(30.0, 4.0))
    other = run_experiment(robot, arm, 2, options, 1.0).controller
    assert other == replace(law, stiffness=(500.0, 70.0), damping=(30.0, 4.0), torque="average")


def test_velocities_and_the_settling_time_are_those_of_reference_and_gains():
    recording = replace(make_recording(), reference_velocity=None)
    loop = build_closed_loop(recording, GAINS, FREE[:1])
    np.testing.assert_allclose(loop.velocity[1:-1], make_recording().reference_velocity[1:-1], atol=1e-4)
    assert not build_closed_loop(recording, replace(GAINS, velocity="measured"), FREE[:1]).velocity.any()
    assert compute_settling(GAINS) == pytest.approx(10.0 * 700.0 / 9000.0)
    assert compute_settling(replace(GAINS, stiffness=(0.0,))) == 0.0


@pytest.mark.filterwarnings("error")
def test_what_no_one_can_simulate_is_said(axis):
    recording = make_recording()
    with pytest.raises(UsageError, match="q_ref"):
        build_closed_loop(replace(recording, reference=None), GAINS, FREE[:1])
    broken = recording.reference.copy()
    broken[7] = np.nan
    with pytest.raises(UsageError, match="at sample 7"):
        build_closed_loop(replace(recording, reference=broken), GAINS, FREE[:1])
    (notice,) = list_unusable(replace(recording, reference=recording.reference[:-1]))
    assert f"{COUNT - 1}, 1)" in notice.text
    # Too stiff; and a force whose square is no number any more, within the first period.
    wild = Controller(stiffness=(1e200,), damping=(0.0,), offset=(0.0,))
    for controller in (replace(GAINS, stiffness=(9e6,)), wild):
        loop = build_closed_loop(recording, controller, FREE[:1])
        with raises(SolverError, "solver.runaway"):
            simulate_closed_loop(axis, np.array([MASS, VISCOUS, 0.0, 0.0]), recording, loop)


@pytest.mark.parametrize("factor", [180.0 / np.pi, 50.0, -1.0])
def test_a_reference_of_another_scale_or_sign_is_refused(factor):
    recording = make_recording()
    tracked = replace(recording, position=recording.reference)
    # A reference is not asked of joints that a brake holds.
    assert list_unusable(tracked) == list_unusable(recording) == ()
    (notice,) = list_unusable(replace(tracked, reference=factor * recording.reference))
    assert notice.code == "usage.controlled-robot"
    assert "at joint 1 (" in notice.text
    assert "[log.reference]" in notice.text


def test_a_log_shorter_than_its_loop_takes_to_settle_is_refused():
    """The constant torque would be the mean of nothing."""
    recording = make_recording()
    slow = Controller(stiffness=(1.0,), damping=(0.1 * PERIOD * COUNT,))
    with pytest.raises(UsageError, match=r" 0\.8 s \(10 times"):
        build_closed_loop(recording, slow, FREE[:1])
    quick = replace(slow, damping=(0.09 * PERIOD * COUNT,))
    assert np.isfinite(build_closed_loop(recording, quick, FREE[:1]).offset).all()
