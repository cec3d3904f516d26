"""Readers: the order of columns does not matter, units and back are the same numbers."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from symid.logs.reader import read_recording
from symid.notation import UNITS, get_unit_factor
from symid.robot.description import Joint, JointKind, LogMap, LogQuantity, Robot
from symid.robot.geometry import IDENTITY

NAMES = ["t", "q1", "q2", "q3", "tau1", "tau2", "tau3", "dq1", "dq2", "dq3", "extra"]
WANTED = {"angle": "position", "angular velocity": "velocity", "torque": "torque", "time": "time"}


def build_robot(size, log=None):
    joints = tuple(
        Joint(name=f"j{index}", kind=JointKind.REVOLUTE, parent=index - 1, placement=IDENTITY)
        for index in range(size)
    )
    return Robot(name="robot", joints=joints, log=log or LogMap())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("logs")


@given(order=st.permutations(NAMES), seed=st.integers(0, 99))
def test_the_order_of_columns_does_not_matter(folder, order, seed):
    table = dict(zip(NAMES, np.random.default_rng(seed).normal(size=(11, 8)), strict=True))
    table["t"] = 0.5 * np.arange(8.0)
    rows = [order, *([repr(float(table[name][k])) for name in order] for k in range(8))]
    path = folder / "log.csv"
    path.write_text("\n".join(",".join(row) for row in rows))
    recording = read_recording(path, build_robot(3))
    for quantity, stem in (("position", "q"), ("velocity", "dq"), ("torque", "tau")):
        expected = np.column_stack([table[f"{stem}{joint}"] for joint in (1, 2, 3)])
        np.testing.assert_array_equal(getattr(recording, quantity), expected)
    assert list(recording.extras) == ["extra"]


@pytest.mark.parametrize("unit", [unit for unit in UNITS if get_unit_factor(unit)[0] in WANTED])
def test_every_unit_brings_the_same_quantity_to_si(folder, unit):
    dimension, factor = get_unit_factor(unit)
    t = np.arange(1.0, 9.0)
    truth = {"time": t, "position": np.sin(t), "velocity": np.cos(t), "torque": t**2}
    names = {"time": "t", "position": "q", "velocity": "dq", "torque": "tau"}
    changed = WANTED[dimension]
    arrays = {names[key]: values / (factor if key == changed else 1.0) for key, values in truth.items()}
    np.savez(folder / "log.npz", **arrays)
    log = LogMap(**{changed: LogQuantity(columns=(names[changed],), unit=unit)})
    recording = read_recording(folder / "log.npz", build_robot(1, log))
    for key, values in truth.items():
        np.testing.assert_allclose(np.ravel(getattr(recording, key)), values, rtol=1e-14)
