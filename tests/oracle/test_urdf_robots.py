"""Every URDF of the package example-robot-data: base parameters against the rank of Pinocchio's regressor.

Pinocchio sees the robot as symid writes it back, after snapping, and compares it with the file's own numbers:
torques, relative to the largest, and link frames.
"""

import importlib.metadata
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

import symid
from symid.dynamics.base_parameters import derive_base_parameters
from symid.errors import RobotError
from symid.robot.simulator_writers import write_urdf
from tests import urdfs
from tests.chains import build_transmission

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

pytestmark = pytest.mark.slow

PACKAGE = "example-robot-data"
GAP = 1e8
# What symid refuses, and why: no joints that move, or a joint that follows one that is not in the file.
REFUSED = {
    "alex_psyonic_hands": "robot.unknown-name",
    "iris_simple": "robot.no-joints",
    "quadrotor_base": "robot.no-joints",
    "ur3": "robot.no-joints",
}


def list_files() -> list[Path]:
    try:
        files = importlib.metadata.files(PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:
        return []
    return sorted(Path(str(file.locate())) for file in files if file.suffix == ".urdf")


def compute_rank(robot, model, rng):
    """Return the rank of the torque regressor folded to coordinates, and the gap in its singular values."""
    data, names = model.createData(), [joint.name for joint in robot.joints]
    factors = build_transmission(robot)
    rows = urdfs.list_rows(model, names)
    total = np.zeros((0, 10 * model.nv))
    for _ in range(max(40, 20 * robot.size // robot.freedom)):
        state = rng.uniform(-3, 3, (3, robot.freedom)) @ factors.T
        columns = pin.computeJointTorqueRegressor(model, data, *urdfs.to_configuration(model, names, state))
        total = np.vstack([total, factors.T @ columns.reshape(model.nv, -1)[rows]])
        if len(total) > 4 * total.shape[1]:
            total = np.linalg.qr(total, mode="r")
    norms = np.linalg.norm(total, axis=0)
    seen = norms > 1e-12 * norms.max()
    values = np.linalg.svd(total[:, seen] / norms[seen], compute_uv=False)
    values = np.append(np.maximum(values, 1e-17 * values[0]), 1e-17 * values[0])
    gaps = values[:-1] / values[1:]
    rank = int(np.argmax(gaps)) + 1
    return rank, gaps[rank - 1]


def find_differences(path, robot, model, rng):
    """Return how far the file is from what symid made of it: relative torques, and link frames."""
    original = pin.buildModelFromUrdf(str(path))
    followers = {}
    for joint in ET.parse(path).getroot().findall("joint"):  # noqa: S314  files of a known package
        mimic = joint.find("mimic")
        if mimic is not None:
            numbers = (float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0)))
            followers[joint.get("name")] = (mimic.get("joint"), *numbers)
    factors = build_transmission(robot)
    worst, scale, gap = 0.0, 1e-12, 0.0
    for sample in range(20):
        masters = rng.uniform(-3, 3, (3, robot.freedom))
        state = masters @ factors.T
        own, positions = urdfs.find_positions(robot, followers, masters[0])
        ours = urdfs.find_torques(model, robot, state)
        theirs = urdfs.find_torques(original, robot, np.array([positions, state[1], state[2]]))
        worst = max(worst, float(np.abs(factors.T @ (ours - theirs)).max()))
        scale = max(scale, float(np.abs(factors.T @ theirs).max()))
        if sample < 2:
            gap = max(gap, urdfs.find_largest_gap(original, robot, own, positions))
    return worst / scale, gap


@pytest.mark.parametrize("path", list_files(), ids=lambda path: f"{path.parts[-3]}/{path.stem}")
def test_count_is_the_rank_of_pinocchios_regressor(path):
    if path.stem in REFUSED:
        with pytest.raises(RobotError) as caught:
            symid.load(path)
        assert REFUSED[path.stem] in {notice.code for notice in caught.value.notices}
        return
    robot = symid.load(path).description
    model = pin.buildModelFromXML(write_urdf(robot))
    rng = np.random.default_rng(1)
    rank, gap = compute_rank(robot, model, rng)
    difference, away = find_differences(path, robot, model, rng)
    assert gap > GAP
    assert derive_base_parameters(robot).count == rank
    snapped = {"robot.angle-snapped", "robot.axis-snapped"} & {notice.code for notice in robot.notices}
    assert difference < (1e-3 if snapped else 1e-8)
    assert away < (1e-3 if snapped else 1e-8)


def test_the_package_is_there():
    assert len(list_files()) > 60
