"""Friction that reads positions, loads and temperatures, identified with the dynamics from logs of files."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.errors import UsageError
from symid.identification.regression import fill_loads
from symid.identification.rigid.fit import identify_parameters
from symid.joint_models import FrictionValues, get_law
from symid.logs import Recording, prepare_signals
from symid.logs.reader import read_recording
from symid.robot.description import Processing
from symid.robot.toml_reader import read_robot
from tests.friction_forms import find_linear_torque
from tests.refusals import raises

PERIOD, COUNT = 2e-3, 8000
VALUES = {
    "load-dependent": ((0.8, 1.1, 0.05), ()),
    "position-dependent-3": ((0.5, 0.9, 0.2, -0.1), ()),
    "position-torque-5": ((0.5, 0.9, 0.2, -0.1), ()),
    "temperature": ((0.5, 0.9, -0.005, -0.004), ()),
    "temperature-viscous": ((0.5, 0.9, 3.0), (25.0,)),
}
PAIRS = (
    ("load-dependent", "position-dependent-3"),
    ("position-torque-5", "temperature"),
    ("temperature-viscous", "load-dependent"),
)

EACH_PAIR = pytest.mark.parametrize("laws", PAIRS, ids=" ".join)
EXACT = Processing(states="acceleration", drop_first=2, drop_last=2)


@pytest.fixture(scope="module")
def arm(robots_folder):
    return read_robot(robots_folder / "two_link.toml")


def prepare(arm, laws):
    """Return the robot, its library and the true values by name."""
    joints = [
        replace(joint, friction=FrictionValues(law=name, values=VALUES[name][0], shape=VALUES[name][1]))
        for joint, name in zip(arm.joints, laws, strict=True)
    ]
    robot = replace(arm, joints=tuple(joints))
    library = prepare_library(robot)
    card = library.card
    return robot, library, {entry.name: entry.value for entry in (*card.beta, *card.friction)}


def record(library, laws):
    """Return the columns of a log without noise; the joints grow warm, their gears carry the rigid torque."""
    time = PERIOD * np.arange(COUNT)
    q, dq, ddq = np.zeros((3, COUNT, 2))
    rng = np.random.default_rng(3)
    for joint in range(2):
        for rate in (0.7, 1.9, 3.1, 4.3):
            size, phase = rng.uniform(0.1, 0.4), rng.uniform(0.0, 6.0)
            q[:, joint] += size * np.sin(rate * time + phase)
            dq[:, joint] += size * rate * np.cos(rate * time + phase)
            ddq[:, joint] -= size * rate**2 * np.sin(rate * time + phase)
    beta = np.array([entry.value for entry in library.card.beta])
    (load,) = library.evaluate("inverse_dynamics", q, dq, ddq, beta)
    temperature = np.column_stack([20.0 + 40.0 * (1.0 - np.exp(-time / 5.0)), 55.0 - 2.0 * time])
    given = {"position": q, "load": load, "temperature": temperature}
    tau = load.copy()
    for joint, name in enumerate(laws):
        for k in range(COUNT):
            others = {key: given[key][k, joint] for key in get_law(name).inputs[1:]}
            tau[k, joint] += find_linear_torque(name, *VALUES[name], dq[k, joint], **others)
    columns = {"t": time, "q": q, "dq": dq, "ddq": ddq, "tau": tau}
    return columns | {"tau_load": load, "temperature": temperature}


def check(estimate, truth, tolerance):
    found = {entry.name: entry.value for entry in estimate.parameters}
    assert found.keys() == truth.keys()
    scale = max(map(abs, truth.values()))
    for name, value in truth.items():
        assert found[name] == pytest.approx(value, rel=tolerance, abs=tolerance * scale), name


def read(folder, robot, columns):
    """Return the log of a file with these columns."""
    np.savez(folder / "log.npz", **columns)
    return read_recording(folder / "log.npz", robot)


@pytest.mark.parametrize("rows", ["torque", "momentum", "filtered", "energy", "power"])
@EACH_PAIR
def test_rows_give_the_true_values(tmp_path, arm, laws, rows):
    """Those without accelerations too."""
    robot, library, truth = prepare(arm, laws)
    recording = read(tmp_path, robot, record(library, laws))
    estimate = identify_parameters(library, [recording], EXACT, rows=rows, estimator="ols")
    check(estimate, truth, 1e-8 if rows == "torque" else 2e-3)
    # An estimate foretells what it was fitted to.
    assert rows != "torque" or max(entry.relative_percent for entry in estimate.residual) < 1e-6


@pytest.mark.parametrize("what", ["tau_load", "temperature"])
def test_what_a_law_reads_must_be_in_the_log(tmp_path, arm, what):
    laws = PAIRS[2]
    robot, library, _ = prepare(arm, laws)
    columns = record(library, laws)
    # One temperature is that of all joints.
    columns["temperature"] = columns["temperature"][:, 0]
    recording = read(tmp_path, robot, columns)
    np.testing.assert_array_equal(recording.temperature, np.column_stack([columns["temperature"]] * 2))
    del columns[what]
    recording = read(tmp_path, robot, columns)
    with raises(UsageError, "friction.input", match=what.removeprefix("tau_")):
        identify_parameters(library, [recording], EXACT, estimator="ols")


@pytest.mark.parametrize("noise", [1e-4, 3e-4])
def test_loads_are_those_of_the_clean_band(arm, noise):
    """Noise of accelerations would lift |load| where it changes its sign."""
    laws = ("load-dependent", "load-dependent")
    _, library, _ = prepare(arm, laws)
    columns = record(library, laws)
    rng = np.random.default_rng(5)
    position = columns["q"] + noise * rng.normal(size=(COUNT, 2))
    log = Recording(time=columns["t"], position=position, torque=columns["tau"], source="noisy")
    beta = np.array([entry.value for entry in library.card.beta])
    (filled,) = fill_loads(library, [log], Processing(filter_cutoff=100.0), beta)
    signals = prepare_signals(log, Processing(filter_cutoff=100.0))
    (wide,) = library.evaluate("inverse_dynamics", signals.q, signals.dq, signals.ddq, beta)
    inner = slice(200, -200)
    errors = [np.std((load - columns["tau_load"])[inner], axis=0) for load in (filled.load, wide)]
    assert np.all(errors[0] < 0.1 * errors[1])
    lifted = [np.mean((np.abs(load) - np.abs(columns["tau_load"]))[inner]) for load in (filled.load, wide)]
    assert abs(lifted[0]) < 0.1 * lifted[1]
