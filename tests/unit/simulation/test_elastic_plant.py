"""The elastic plant against an event-driven integrator, closed forms, its NumPy twin, fine quadrature."""

import itertools
from dataclasses import fields, replace
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from symid.codegen.cache import prepare_library
from symid.codegen.compiled_models import PlantExperiment, has_addresses, load_plant_code
from symid.errors import GenerationError, Notice
from symid.joint_models import FrictionValues
from symid.simulation import elastic_plant, rigid_plant
from tests.refusals import tell
from tests.simulations import ELASTIC_CALLED

# The arm of the robot file in closed form, hanging down at q = 0.
L, G, ZZ1, ZZ2, MX1, MX2 = 0.3, 9.81, 0.35, 0.06, 0.9, 0.25
B, FV, FC, V0 = np.array([0.25, 0.05]), np.array([1.0, 0.5]), np.array([1.5, 0.6]), 0.01
K0 = np.array([380.0, 90.0])
RADIUS = np.array([[0.002, 0.005, 0.010], [0.003, 0.008, 0.016]])
WEIGHT = np.array([[120.0, 60.0, 40.0], [30.0, 20.0, 10.0]])
KNEE, SLOPE = np.array([3.0, 1.2]), np.array([0.5, 0.6])


def find_mass(q):
    c = L * MX2 * np.cos(q[1])
    return np.array([[ZZ1 + ZZ2 + 2.0 * c, ZZ2 + c], [ZZ2 + c, ZZ2]])


def find_bias(q, dq):
    h, last = L * MX2 * np.sin(q[1]), G * MX2 * np.sin(q[0] + q[1])
    coriolis = np.array([-h * dq[1] * (2.0 * dq[0] + dq[1]), h * dq[0] ** 2])
    return coriolis + np.array([G * MX1 * np.sin(q[0]) + last, last])


def find_spring(phi, play):
    v = K0 * phi + (WEIGHT * np.clip(phi[:, None] - play, -RADIUS, RADIUS)).sum(axis=1)
    return v + SLOPE * np.sign(v) * np.maximum(np.abs(v) - KNEE, 0.0)


def find_plain_friction(_theta, dtheta, _load):
    return FV * dtheta + FC * np.tanh(dtheta / V0)


def find_slope(x, play, torque, find_friction):
    q, dq, theta, dtheta = x.reshape(4, 2)
    spring = find_spring(theta - q, play)
    friction = find_friction(theta, dtheta, spring)
    ddq = np.linalg.solve(find_mass(q), spring - find_bias(q, dq))
    return np.concatenate([dq, ddq, dtheta, (torque - spring - friction) / B])


def hold(x, play, torque, duration, find_friction):
    """Integrate while `torque` holds, stopping wherever a torsion turns to move the plays."""
    start = 0.0
    while start < duration:
        rate = x[6:] - x[2:4]
        slope = find_slope(x, play, torque, find_friction)
        way = np.where(np.abs(rate) > 1e-9, np.sign(rate), np.sign(slope[6:] - slope[2:4]))
        events = []
        for joint in range(2):

            def turns(_t, y, joint=joint):
                return y[6 + joint] - y[2 + joint]

            turns.terminal, turns.direction = True, -way[joint]
            events.append(turns)
        found = solve_ivp(
            lambda _t, y, play=play: find_slope(y, play, torque, find_friction),
            (start, duration),
            x,
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
            events=events,
        )
        x, start = found.y[:, -1], found.t[-1]
        phi = (x[4:6] - x[:2])[:, None]
        play = phi - np.clip(phi - play, -RADIUS, RADIUS)
    return x, play


def follow(ticks, period):
    """Return references that shake both joints hard from rest."""
    t = np.arange(ticks) * period
    ramp = np.clip(t / 0.1, 0.0, 1.0) ** 3
    angle = np.stack([0.1 * ramp * np.sin(45.0 * t), 0.1 * ramp * np.sin(60.0 * t + 1.0)], axis=1)
    return angle, np.gradient(angle, period, axis=0)


def order_run(ticks=250, period=1e-3, substeps=10, parts=16, **changes):
    angle, speed = follow(ticks, period)
    order = PlantExperiment(
        angle=angle,
        speed=speed,
        torque=np.zeros_like(angle),
        stiffness=np.array([4000.0, 1500.0]),
        damping=np.array([120.0, 40.0]),
        limit=np.array([np.inf, np.inf]),
        **dict.fromkeys(("step", "q", "theta"), np.zeros(2)),
        period=period,
        substeps=substeps,
        parts=parts,
        play=np.zeros((2, 3)),
    )
    return replace(order, **changes)


@pytest.fixture(scope="module")
def values(elastic_robot, elastic_library):
    return elastic_plant.get_elastic_values(elastic_robot, elastic_library.card)


@pytest.fixture(scope="module")
def numbers(values):
    return elastic_plant.build_plant_robot(values)


@pytest.fixture(scope="module")
def plant():
    return load_plant_code()


@pytest.fixture(scope="module")
def truth():
    return find_states(order_run(), find_plain_friction)


def find_states(order, find_friction):
    """Return the states at the ticks of a run, by an adaptive integrator that looks for turns."""
    x, play, states = np.zeros(8), np.zeros((2, 3)), []
    for angle, speed in zip(order.angle, order.speed, strict=True):
        states.append(x)
        torque = order.stiffness * (angle - x[4:6]) + order.damping * (speed - x[6:])
        x, play = hold(x, play, torque, order.period, find_friction)
    return np.array(states)


def stack(log):
    return np.hstack([log.q, log.dq, log.theta, log.dtheta])


def test_the_plant_agrees_with_an_event_driven_integrator_and_keeps_its_order(
    plant, elastic_library, numbers, truth
):
    log = plant.run(elastic_library, numbers, order_run())
    # The torsion reaches every stop and both knees, and turns.
    phi = log.theta - log.q
    assert np.all(np.abs(phi).max(axis=0) > RADIUS[:, -1])
    assert np.all(np.abs(log.spring).max(axis=0) > KNEE)
    assert np.all((np.diff(np.sign(np.diff(phi, axis=0)), axis=0) != 0).sum(axis=0) > 3)
    positions, speeds = [0, 1, 4, 5], [2, 3, 6, 7]
    gap = np.abs(stack(log) - truth)
    assert gap[:, positions].max() < 3e-7
    assert gap[:, speeds].max() < 2e-4
    log = plant.run(elastic_library, numbers, order_run(substeps=40))
    gap = np.abs(stack(log) - truth)
    assert gap[:, positions].max() < 5e-10
    assert gap[:, speeds].max() < 5e-7

    def find_gap(substeps, parts):
        log = plant.run(elastic_library, numbers, order_run(substeps=substeps, parts=parts))
        return np.abs(log.q - truth[:, :2]).max()

    # Bends of the springs alone would leave the second order; friction over 0.01 rad/s wants short steps.
    assert find_gap(20, 16) > 10.0 * find_gap(40, 16)
    assert find_gap(40, 1) > 20.0 * find_gap(40, 16)


def test_numpy_and_compiled_plant_agree(plant, elastic_library, numbers, values):
    cubic = tuple(replace(spring, cubic=2e5, damping=0.4) for spring in values.elasticity)
    for robot in (numbers, elastic_plant.build_plant_robot(replace(values, elasticity=cubic))):
        order = order_run(ticks=120, step=np.full(2, 1e-4), limit=np.array([9.0, 2.5]), substeps=4)
        fast = plant.run(elastic_library, robot, order)
        slow = elastic_plant.simulate_in_numpy(elastic_library, robot, order)
        for field in fields(fast):
            pair = getattr(fast, field.name), getattr(slow, field.name)
            np.testing.assert_allclose(*pair, atol=1e-10, err_msg=field.name)
        assert np.abs(fast.torque).max(axis=0).tolist() == [9.0, 2.5]


def test_spring_work_is_exact_on_any_path(numbers):
    """The integral of the torque over a monotone step, against fine quadrature, from plays anywhere."""
    rng = np.random.default_rng(4)
    for robot, _ in itertools.product((numbers, replace(numbers, cubic=np.array([3e5, -1e4]))), range(40)):
        springs, joint = elastic_plant.Springs(robot), int(rng.integers(2))
        start, end = rng.uniform(-0.03, 0.03, size=2).tolist()
        play = np.tile(start - rng.uniform(-1.0, 1.0, size=3) * RADIUS[joint], (2, 1))
        points = np.linspace(start, end, 20_001)
        wanted = np.trapezoid(springs.compute_torque(points, play, joint), points)
        assert springs.integrate(joint, start, end, play) == pytest.approx(wanted, abs=2e-9)


def dry(v):
    return np.tanh(v / V0)


# The law, its linear values, and its friction at (theta, dtheta, load), by hand.
LOADED = ("load-dependent", (1.0, 1.5, 0.2), lambda _p, v, load: v + (1.5 + 0.2 * abs(load)) * dry(v))
WAVING = (
    "position-dependent-1x8",
    (0.5, 0.6, 0.2, -0.3),
    lambda p, v, _: 0.5 * v + (0.6 + 0.2 * np.cos(8 * p) - 0.3 * np.sin(8 * p)) * dry(v),
)
RIPPLING = (
    "position-torque-2",
    (0.5, 0.6, 0.2, -0.3),
    lambda p, v, _: 0.5 * v + 0.6 * dry(v) + 0.2 * np.cos(2 * p) - 0.3 * np.sin(2 * p),
)
# At the reference temperature its last two values are nothing.
WARM = ("temperature", (0.5, 0.6, 0.2, 0.3), lambda _p, v, _: 0.5 * v + 0.6 * dry(v))
PAIRS = [(LOADED, WAVING), (RIPPLING, WARM), (WARM, LOADED), (WAVING, RIPPLING), (LOADED, LOADED)]


def set_friction(robot, *laws):
    joints = tuple(
        replace(joint, friction=FrictionValues(law=name, values=values, smoothing=V0))
        for joint, (name, values, _) in zip(robot.joints, laws, strict=True)
    )
    return replace(robot, joints=joints)


@pytest.mark.parametrize("laws", PAIRS, ids=lambda laws: f"{laws[0][0]} {laws[1][0]}")
def test_friction_of_load_position_and_temperature_is_that_of_the_integrator(plant, elastic_robot, laws):
    robot = set_friction(elastic_robot, *laws)
    library = prepare_library(robot, names=ELASTIC_CALLED)
    numbers = elastic_plant.build_plant_robot(elastic_plant.get_elastic_values(robot, library.card))
    order = order_run(ticks=80, substeps=20)

    def find_friction(theta, dtheta, load):
        parts = zip(laws, theta, dtheta, load, strict=True)
        return np.array([find(p, v, x) for (_, _, find), p, v, x in parts])

    states = find_states(order, find_friction)
    for log in (plant.run(library, numbers, order), elastic_plant.simulate_in_numpy(library, numbers, order)):
        gap = np.abs(stack(log) - states)
        assert gap[:, [0, 1, 4, 5]].max() < 1e-7
        assert gap[:, [2, 3, 6, 7]].max() < 1e-4


def test_small_free_oscillations_have_the_eigenfrequencies_of_the_linear_robot(
    plant, elastic_library, values
):
    springs = tuple(replace(spring, stops=(), knees=()) for spring in values.elasticity)
    linear = replace(values, elasticity=springs, friction=np.zeros(4))
    robot = elastic_plant.build_plant_robot(linear)
    start = np.array([1e-6, -2e-6, 3e-6, 1e-6])
    still = dict.fromkeys(("angle", "speed", "torque"), np.zeros((500, 2)))
    loose = dict.fromkeys(("stiffness", "damping"), np.zeros(2))
    order = order_run(500, **still, **loose, q=start[:2], theta=start[2:], play=np.zeros((2, 0)))
    log = plant.run(elastic_library, robot, order)
    stiffness = np.diag(K0)
    fall = G * np.array([[MX1 + MX2, MX2], [MX2, MX2]])
    matrix = np.block([[stiffness + fall, -stiffness], [-stiffness, stiffness]])
    inertia = np.zeros((4, 4))
    inertia[:2, :2], inertia[2:, 2:] = find_mass(np.zeros(2)), np.diag(B)
    rates = np.block([[np.zeros((4, 4)), np.eye(4)], [-np.linalg.solve(inertia, matrix), np.zeros((4, 4))]])
    step, x = expm(rates * order.period), np.concatenate([start, np.zeros(4)])
    for q, theta in zip(log.q, log.theta, strict=True):
        np.testing.assert_allclose(np.concatenate([q, theta]), x[:4], atol=2e-11)
        x = step @ x


def test_the_same_order_gives_the_same_bytes_until_a_state_is_not_finite(plant, elastic_library, numbers):
    first, second = (plant.run(elastic_library, numbers, order_run()) for _ in range(2))
    assert first.q.tobytes() == second.q.tobytes()
    assert first.elastic.tobytes() == second.elastic.tobytes()
    order = order_run(stiffness=np.array([-1e9, -1e9]), damping=np.array([-1e6, -1e6]))
    with np.errstate(all="ignore"):
        logs = [run(elastic_library, numbers, order) for run in (plant.run, elastic_plant.simulate_in_numpy)]
    assert all(0 < log.ticks < order.ticks for log in logs)


def test_without_compiled_code_numpy_does_it_and_says_why(arm, numbers, elastic_library, monkeypatch):
    assert not has_addresses(arm)
    beta = np.array([entry.value for entry in arm.card.beta])
    robot = replace(numbers, beta=beta, friction=np.zeros(0))
    order = order_run(ticks=5)
    log, backend, notices = elastic_plant.simulate_plant(arm, robot, order)
    assert (log.ticks, backend) == (5, "python")
    assert "not compiled" in tell(notices)["simulate.slow-plant"]
    with monkeypatch.context() as patch:
        patch.setattr(rigid_plant.codegen, "load_plant_code", lambda *_: None)
        slow, _, notices = elastic_plant.simulate_plant(elastic_library, numbers, order)
    assert "no C compiler" in tell(notices)["simulate.slow-plant"]
    fast, *how = elastic_plant.simulate_plant(elastic_library, numbers, order)
    assert how == ["c", ()]
    np.testing.assert_allclose(slow.theta, fast.theta, atol=1e-14)
    broken = Mock(side_effect=GenerationError(Notice(code="codegen.compiler-failed", text="no headers")))
    monkeypatch.setattr(rigid_plant.codegen, "load_plant_code", broken)
    _, _, notices = elastic_plant.simulate_plant(elastic_library, numbers, order)
    assert "no headers" in tell(notices)["simulate.slow-plant"]


def test_fast_springs_and_friction_shorten_the_steps(elastic_library, values):
    poses = np.zeros((3, 2))

    def count(changed):
        return elastic_plant.count_substeps(elastic_library, changed, poses, 1e-3)

    assert count(values) == 10
    stiff = tuple(replace(spring, stiffness=1e8) for spring in values.elasticity)
    damped = tuple(replace(spring, damping=1e4) for spring in values.elasticity)
    assert count(replace(values, elasticity=stiff)) > 50
    assert count(replace(values, elasticity=damped)) > 50
    assert count(replace(values, friction=100.0 * values.friction)) > 50
    assert elastic_plant.count_substeps(elastic_library, values, poses, 2e-4) == 2
