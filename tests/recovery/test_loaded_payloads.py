"""Known payloads and friction that grows with the load: torques of a hand-written arm that carries a body."""

import numpy as np
import pytest

import symid
from tests.recovery.closed_form import find_two_link_torque
from tests.recovery.flexible_arm import RATE, find_friction, move
from tests.recovery.test_friction_choice import BETA, DURATION, ROBOT, TRUTH, measure_errors

MASS, CENTRE, INERTIA = 6.0, (0.15, 0.03), 0.02
X, Y = CENTRE
ADDED = np.array([0.25 * MASS, 0.5 * MASS, 0.0, INERTIA + MASS * (X * X + Y * Y), MASS * X, MASS * Y])
"""What the body on the second link adds to ZZR1, MXR1, MY1, ZZ2, MX2, MY2 of an arm with a = 0.5 m."""
RUN = '[[run]]\nfile = "{file}"\n'
PAYLOAD = (
    f'payload = {{ name = "disc", joint = "joint2", mass = {MASS}, com = [{X}, {Y}, 0], '
    f"inertia = {{ xx = 0.01, yy = 0.01, zz = {INERTIA} }} }}\n"
)
LAWS = """friction = { model = "stribeck", Fv = 1, Fc = 1, Fe = 0.5, vs = 0.08 }
[[joint]]
name = "joint2"
kind = "revolute"
a = 0.5
friction = { model = "load-dependent", Fv = 1, Fc = 1, Fl = 0.05 }
"""


def record(seed, payload, noise=0.02, *, load=False):
    rng = np.random.default_rng(seed)
    time = np.arange(round(DURATION * RATE)) / RATE
    q, dq, ddq = move(time, seed)
    torque = find_two_link_torque(q, dq, ddq)[0] @ (BETA + payload)
    tau = torque + find_friction(dq, torque)
    step = 2 * np.pi / 2**20
    given = {"load": torque + noise * rng.normal(size=tau.shape)} if load else {}
    position = np.round(q / step) * step
    return given | {"time": time, "q": position, "tau": tau + noise * rng.normal(size=tau.shape)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("runs")
    (root / "plain.toml").write_text(ROBOT)
    (root / "laws.toml").write_text(ROBOT[: ROBOT.index('[[joint]]\nname = "joint2"')] + LAWS)
    robot = symid.load(root / "plain.toml")
    for name, payload, seed in (("empty", 0.0, 0), ("with", ADDED, 1)):
        symid.build_log(robot, **record(seed, payload)).save(root / f"{name}.npz")
    symid.build_log(robot, **record(1, ADDED, load=True)).save(root / "sensed.npz")
    (root / "alone.toml").write_text(RUN.format(file="with.npz") + PAYLOAD)
    (root / "sensed.toml").write_text(RUN.format(file="sensed.npz") + PAYLOAD)
    (root / "both.toml").write_text(RUN.format(file="empty.npz") + RUN.format(file="with.npz") + PAYLOAD)
    return root


@pytest.mark.parametrize("runs", ["alone", "both", "sensed"])
def test_laws_of_the_load_are_found_with_a_known_payload(folder, runs):
    fit = symid.load(folder / "plain.toml").identify(folder / f"{runs}.toml", friction="auto")
    assert [law.law for law in fit.estimate.laws] == ["stribeck", "load-dependent"]
    errors = measure_errors(fit)
    assert set(errors) == set(TRUTH)
    assert max(errors.values()) < 4.0, errors


@pytest.mark.parametrize("runs", ["alone", "both"])
def test_laws_of_a_robot_file_read_the_load_of_a_payload(folder, runs):
    robot = symid.load(folder / "laws.toml")
    fit = robot.identify(folder / f"{runs}.toml")
    errors = measure_errors(fit)
    assert max(errors.values()) < 4.0, errors
    assert fit.validate(folder / "alone.toml").verdict.level in {"good", "usable"}
    # The same log without its payload is another load.
    told, untold = (
        fit.validate(folder / name).to_dict()["mean_relative_percent"] for name in ("alone.toml", "with.npz")
    )
    assert told < 0.2 * untold


def test_a_payload_is_found_where_friction_reads_the_load(folder):
    robot = symid.load(folder / "laws.toml")
    found = robot.payload(folder / "with.npz", empty=folder / "empty.npz")
    mass = next(entry for entry in found.product.payload.quantities if entry.name == "mass")
    assert abs(mass.value - MASS) < 4.0 * mass.std
