"""The compiled rigid plant: against Pinocchio and SciPy, its NumPy twin, Radau's method, its energy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from symid.codegen import RigidExperiment
from symid.codegen.cache import prepare_library
from symid.errors import SolverError
from symid.excitation.trajectories import build_random_fourier
from symid.robot.mjcf_reader import read_xml_robot as read_urdf
from symid.simulation import rigid_plant
from symid.simulation.experiment import ExperimentOptions, SensorOptions, get_limits, simulate_experiment
from symid.simulation.rigid_plant import RigidPlant, simulate_rigid_plant
from tests.refusals import raises
from tests.simulations import CALLED, prepare_slide

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

LINK = """
<link name="{name}"><inertial><origin xyz="0.02 0.01 0.1" rpy="0.1 0 0.2"/><mass value="{mass}"/>
<inertia ixx="{ixx}" ixy="0.001" ixz="0" iyy="{ixx}" iyz="0.0005" izz="0.01"/></inertial></link>
<joint name="j_{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="0.05 0 0.3" rpy="0 0.3 0"/><axis xyz="{axis}"/>
<limit lower="-2.5" upper="2.5" effort="{effort}" velocity="3"/>
<dynamics damping="{damping}" friction="{dry}"/></joint>"""


def write_arm(*, damping=0.4, dry=0.0, last=0.02, effort=0.0):
    """Return a URDF of three links; the last one has the inertia `last`."""
    rows = [("a", "base", "0 0 1", 3.0, 0.03), ("b", "a", "0 1 0", 2.0, 0.03), ("c", "b", "1 0 0", 1.0, last)]
    names = ("name", "parent", "axis", "mass", "ixx")
    shared = {"damping": damping, "dry": dry, "effort": effort}
    links = [LINK.format(**dict(zip(names, row, strict=True)), **shared) for row in rows]
    return f'<robot name="arm"><link name="base"/>{"".join(links)}</robot>'


@pytest.fixture(scope="module")
def make_arm(tmp_path_factory, c_compiler):
    """Return a function of the arm's numbers that gives its robot and its compiled functions."""

    def build(**numbers):
        path = tmp_path_factory.mktemp("arm") / "arm.urdf"
        path.write_text(write_arm(**numbers))
        robot = read_urdf(path)
        rubs = numbers.get("damping", 1.0) or numbers.get("dry", 0.0)
        return robot, prepare_library(robot, names=CALLED if rubs else CALLED[2:])

    return build


def push(torque, q=None, **changes):
    """Return the experiment of a robot at `q` (n,), without controller, under torques (N, n)."""
    size = torque.shape[1]
    rest, free = np.zeros(size), np.full(size, np.inf)
    start = rest if q is None else np.array(q)
    order = RigidExperiment(
        torque=torque,
        **dict.fromkeys(("position", "speed"), np.zeros_like(torque)),
        **dict.fromkeys(("stiffness", "damping", "step", "dq", "velocity"), rest),
        **dict.fromkeys(("limit", "reach"), free),
        **dict.fromkeys(("q", "measured"), start),
        period=1e-3,
        substeps=1,
        blend=1.0,
        sensed=False,
    )
    return replace(order, **changes)


def swing(count, amplitudes, frequency=2.0):
    time = np.arange(count)[:, None] * 1e-3
    return np.array(amplitudes) * np.sin(2.0 * np.pi * frequency * time + np.arange(len(amplitudes)))


def test_a_run_is_that_of_pinocchio_under_the_same_held_torques(make_arm):
    _, library = make_arm()
    torque, start = swing(300, (8.0, 20.0, 3.0)), [0.3, -0.4, 0.5]
    plant = RigidPlant(library)
    found = simulate_rigid_plant(library, plant, push(torque, start, substeps=4))
    model = pin.buildModelFromXML(write_arm())
    data, x = model.createData(), np.array([*start, 0.0, 0.0, 0.0])
    for tau in torque[:-1]:

        def slope(_t, y, tau=tau):
            return np.concatenate([y[3:], pin.aba(model, data, y[:3], y[3:], tau - 0.4 * y[3:])])

        x = solve_ivp(slope, (0.0, 1e-3), x, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    assert plant.code is not None
    np.testing.assert_allclose(np.concatenate([found.q[-1], found.dq[-1]]), x, rtol=0, atol=1e-8)


@pytest.mark.parametrize("controlled", [False, True])
def test_numpy_moves_the_arm_as_the_compiled_plant_does(make_arm, monkeypatch, controlled):
    _, library = make_arm(dry=1.5)
    plant = RigidPlant(library)
    order = push(swing(120, (8.0, 20.0, 3.0), 12.0), [0.3, -0.4, 0.5], controlled=controlled)
    compiled = simulate_rigid_plant(library, plant, order)
    assert (plant.code is not None, plant.notices) == (True, ())
    monkeypatch.setattr(rigid_plant.codegen, "load_plant_code", lambda *_: None)
    plant = RigidPlant(library)
    slow = simulate_rigid_plant(library, plant, order)
    assert plant.code is None
    assert [notice.code for notice in plant.notices] == ["simulate.slow-plant"]
    assert compiled.events == slow.events > 3
    for name in ("q", "dq", "torque", "work", "lost"):
        np.testing.assert_allclose(getattr(compiled, name), getattr(slow, name), rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("friction", "mass"),
    [
        ('model = "stribeck"\nFv = 3\nFc = 4\nFe = 2\nvs = 0.05', 0.5),
        ('model = "lugre"\nsigma0 = 1e4\nsigma1 = 30\nFv = 1\nFc = 4\nFe = 1\nvs = 0.01', 1.0),
        ('model = "maxwell_slip"\nFv = 1\nFc = 4\nstiffness = [2e3, 1e3]\nshare = [0.6, 0.4]', 0.5),
    ],
)
def test_numpy_moves_a_slide_as_the_compiled_plant_does(friction, mass, monkeypatch, c_compiler):
    library = prepare_slide(friction, mass)
    plant, order = RigidPlant(library), push(swing(150, (8.0,), 8.0))
    compiled = simulate_rigid_plant(library, plant, order)
    monkeypatch.setattr(rigid_plant.codegen, "load_plant_code", lambda *_: None)
    slow = simulate_rigid_plant(library, RigidPlant(library), order)
    assert np.ptp(compiled.dq) > 0.1
    np.testing.assert_allclose(compiled.dq, slow.dq, rtol=0, atol=1e-9)
    np.testing.assert_allclose(compiled.z, slow.z, rtol=0, atol=1e-12)


def compute_gap(plant, log, mass):
    stored = plant.bristles.compute_energy(log.z)
    gap = log.work - 0.5 * mass * log.dq[:, 0] ** 2 - stored - log.lost
    return np.abs(gap).max() / np.abs(log.work).max()


@pytest.mark.parametrize(
    ("friction", "mass"),
    [
        # Rates at which friction stops the joint: 1e11, 4e7, 1e5 and, of bristles, 3e5 / s.
        ('model = "improved_stribeck"\nFv = 1\nFc = 4\nFe = 1\nFp = 0\nvs = 0.1\ndq0 = 1e-9', 0.08),
        ('model = "coulomb-viscous"\nFv = 1\nFc = 4\nsmoothing = 1e-3', 1e-4),
        ('model = "coulomb-viscous"\nFv = 10\nFc = 4', 1e-4),
        ('model = "lugre"\nsigma0 = 1e5\nsigma1 = 300\nFv = 1\nFc = 4\nFe = 1\nvs = 0.01', 1e-3),
        ('model = "maxwell_slip"\nFv = 1\nFc = 4\nstiffness = [2e4, 1e4]\nshare = [0.6, 0.4]', 1e-3),
    ],
)
def test_steep_friction_closes_the_energy_balance(friction, mass, c_compiler):
    library = prepare_slide(friction, mass)
    plant, order = RigidPlant(library), push(swing(300, (8.0,), 5.0), controlled=True)
    log = simulate_rigid_plant(library, plant, order)
    assert len(log.q) == 300
    assert log.dq.max() > 0.1 > -0.1 > log.dq.min()
    assert compute_gap(plant, log, mass) < 1e-7


def test_implicit_steps_follow_a_smooth_law_as_radau_does(c_compiler):
    """Steps that explicit ones would need a hundred times as many of: 4 / (1e-2 * 1e-2) = 4e4 / s."""
    library = prepare_slide('model = "coulomb-viscous"\nFv = 1\nFc = 4\nsmoothing = 1e-3', 1e-2)
    torque = swing(150, (8.0,), 8.0)
    log = simulate_rigid_plant(library, RigidPlant(library), push(torque))
    x = np.zeros(2)
    for tau in torque[:-1, 0]:

        def slope(_t, y, tau=tau):
            return [y[1], (tau - y[1] - 4.0 * np.tanh(y[1] / 1e-3)) / 1e-2]

        x = solve_ivp(slope, (0.0, 1e-3), x, "Radau", rtol=1e-9, atol=1e-12).y[:, -1]
    np.testing.assert_allclose([log.q[-1, 0], log.dq[-1, 0]], x, rtol=1e-5)


CLEAN = ExperimentOptions(duration=2.0, sensors=SensorOptions(counts_per_turn=None))


def simulate(arm, options=CLEAN, scale=1.0):
    robot, library = arm
    motion = build_random_fourier(robot, np.random.default_rng(1))
    motion = replace(motion, amplitude=scale * motion.amplitude)
    return simulate_experiment(robot, library, motion, options, np.random.default_rng(1))


def test_light_wrists_and_limits_of_zero_are_simulated(make_arm):
    # The damping stops the last link at 5 / 1e-4 = 5e4 / s, far from stable at steps of 1 ms.
    run = simulate(make_arm(damping=5.0, last=1e-4))
    assert run.energy_gap < 1e-6
    assert np.abs(run.q - run.recording.reference).max() < 0.2
    robot, library = make_arm(dry=1.5, effort=0.0)
    assert np.all(np.isinf(get_limits(robot, "torque")))
    assert np.abs(simulate((robot, library), replace(CLEAN, duration=0.2)).torque).max() > 1.0
    _, library = make_arm(dry=1.5)
    plant, order = RigidPlant(library), push(swing(150, (8.0, 20.0, 3.0), 5.0), [0.3, -0.4, 0.5])
    whole = simulate_rigid_plant(library, plant, order)
    half = simulate_rigid_plant(library, plant, replace(order, substeps=2))
    np.testing.assert_allclose(whole.q, half.q, rtol=0, atol=2e-6)


def test_bandwidths_and_gains_that_are_too_high_are_lowered_or_told(make_arm):
    run = simulate(make_arm(damping=0.0), replace(CLEAN, period=8e-3))
    notice = next(entry for entry in run.recording.notices if entry.code == "simulate.bandwidth")
    assert "--bandwidth" in notice.text
    assert "--period" in notice.text
    assert run.energy_gap < 1e-6
    with raises(
        SolverError, "simulate.unstable", match=r"'j_[abc]'.*--bandwidth \(300 Hz\).*--stiffness.*--period"
    ):
        simulate(make_arm(damping=0.0), replace(CLEAN, bandwidth=300.0))
    wild = replace(CLEAN, stiffness=(9e5,) * 3, damping=(9e3,) * 3)
    with pytest.raises(SolverError, match=r"lower the gains \(--stiffness, --damping\)") as caught:
        simulate(make_arm(damping=0.0), wild)
    assert "--bandwidth" not in caught.value.notices[0].text


def test_damping_far_too_large_for_fixed_steps_is_no_chatter(make_arm):
    """Explicit steps reverse such a joint at every stop; those that their error allows do not."""
    _, library = make_arm(damping=1e6)
    plant, order = RigidPlant(library), push(swing(20, (8.0, 20.0, 3.0), 5.0))
    assert simulate_rigid_plant(library, plant, order).end == "well"


@pytest.mark.parametrize("compiled", [True, False])
def test_no_choice_of_resting_joints_is_an_error_in_both_plants(make_arm, compiled):
    _, library = make_arm(dry=1.5)
    plant = RigidPlant(library)
    # With all masses and inertias negative every joint moves against its torque.
    plant.beta = -plant.beta
    if not compiled:
        plant.code = None
    with raises(SolverError, "simulate.not-converged", match="not positive definite"):
        simulate_rigid_plant(library, plant, push(swing(20, (8.0, 20.0, 3.0), 5.0)))


def test_the_controller_is_the_same_in_both_plants(make_arm, monkeypatch):
    arm = make_arm(dry=1.5, effort=30.0)
    options = replace(CLEAN, duration=0.3, sensors=SensorOptions(counts_per_turn=2.0**14))
    compiled = simulate(arm, options)
    monkeypatch.setattr(rigid_plant.codegen, "load_plant_code", lambda *_: None)
    slow = simulate(arm, options)
    assert slow.backend == "python"
    np.testing.assert_allclose(compiled.recording.torque, slow.recording.torque, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(compiled.recording.position, slow.recording.position)
