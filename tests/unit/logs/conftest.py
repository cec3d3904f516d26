"""Robots and logs that the tests of readers share."""

import numpy as np
import pytest

from symid.robot.description import Drive, Joint, JointKind, LogMap, LogQuantity, Robot
from symid.robot.geometry import IDENTITY

R, P = JointKind.REVOLUTE, JointKind.PRISMATIC


@pytest.fixture
def make_robot():
    """Return a builder of robots from kinds, drives and a log map of (columns, unit, factor, side)."""

    def build(kinds=(R, R), gears=(), constants=(), direct=(), **log):
        drives = {"gear": gears, "torque_constant": constants, "direct": direct}
        joints = tuple(
            Joint(
                name=f"joint{index + 1}",
                kind=kind,
                parent=index - 1,
                placement=IDENTITY,
                drive=Drive(**{key: values[index] for key, values in drives.items() if values}),
            )
            for index, kind in enumerate(kinds)
        )
        quantities = {}
        for name, (columns, unit, *rest) in log.items():
            quantities[name] = LogQuantity(
                columns=columns, unit=unit, **dict(zip(("factor", "side"), rest, strict=False))
            )
        return Robot(name="robot", joints=joints, log=LogMap(**quantities))

    return build


@pytest.fixture
def columns():
    """Return t, q (50, 2), tau (50, 2)."""
    rng = np.random.default_rng(4)
    return {"t": np.arange(50) * 0.01, "q": rng.normal(size=(50, 2)), "tau": rng.normal(size=(50, 2))}


@pytest.fixture
def write_npz(tmp_path):
    """Return a writer of archives."""

    def write(name="log.npz", **arrays):
        np.savez(tmp_path / name, **arrays)
        return tmp_path / name

    return write
