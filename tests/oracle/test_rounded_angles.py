"""What rounding the angles of a URDF costs, against Pinocchio on the file's own numbers."""

import numpy as np
import pytest

import symid
from tests.chains import FROM_PINOCCHIO

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

NAMES = ("shoulder", "upper", "lower", "hand")


def write_arm(*rolls: str, pitch: str = "0.3") -> str:
    """Return an arm whose links turn about z, after the rolls of their joints."""
    lines = ['<robot name="arm"><link name="base"/>']
    before = "base"
    for k, (name, roll) in enumerate(zip(NAMES, ("0", *rolls), strict=False)):
        lines.append(
            f'<link name="{name}"><inertial><origin xyz="0.1 0.0{k + 2} 0.03"/><mass value="{k + 1}"/>'
            '<inertia ixx="0.02" ixy="0.001" ixz="0.002" iyy="0.03" iyz="0" izz="0.04"/></inertial></link>'
            f'<joint name="j{k}" type="revolute"><parent link="{before}"/><child link="{name}"/>'
            f'<axis xyz="0 0 1"/><origin xyz="0.2 0 0.1" rpy="{roll} 0 {pitch}"/>'
            '<limit lower="-2" upper="2" effort="9" velocity="9"/></joint>'
        )
        before = name
    return "".join([*lines, "</robot>"])


def compute_columns(text, count=60):
    """Return Pinocchio's torque regressor, its rank with columns of length one, and its torques."""
    model = pin.buildModelFromXML(text)
    data, rng = model.createData(), np.random.default_rng(5)
    rows, torques = [], []
    for _ in range(count):
        q, v, a = rng.uniform(-2, 2, model.nq), rng.uniform(-2, 2, model.nv), rng.uniform(-5, 5, model.nv)
        rows.append(pin.computeJointTorqueRegressor(model, data, q, v, a).copy())
        torques.append(pin.rnea(model, data, q, v, a).copy())
    matrix = np.vstack(rows)
    assert matrix.shape[1] == len(FROM_PINOCCHIO) * model.nv
    lengths = np.linalg.norm(matrix, axis=0)
    kept = lengths > 1e-9 * lengths.max()
    singular = np.linalg.svd(matrix[:, kept] / lengths[kept], compute_uv=False)
    return int((singular > 1e-9 * singular[0]).sum()), np.array(torques)


ROUNDED = {"1.5708": "1.5707963267948966", "3e-6": "0"}
NEAR, TILTED = ROUNDED
CASES = [(NEAR, "0.7", "0.4"), (NEAR, f"-{NEAR}", "0.7"), (NEAR, TILTED), (NEAR, NEAR)]


def round_angles(rolls):
    for written, meant in ROUNDED.items():
        rolls = tuple(roll.replace(written, meant) for roll in rolls)
    return rolls


@pytest.mark.parametrize("rolls", CASES)
def test_the_reading_keeps_the_number_of_base_parameters(tmp_path, rolls):
    exact, rounded = write_arm(*rolls), write_arm(*round_angles(rolls))
    path = tmp_path / "arm.urdf"
    path.write_text(exact)
    (whole, before), (left, after) = compute_columns(exact), compute_columns(rounded)
    robot = symid.load(path)
    (note,) = [
        entry for entry in robot.notices if entry.code in {"robot.not-rounded", "robot.rounding-price"}
    ]
    assert note.is_note
    assert (note.code == "robot.not-rounded") == (whole != left)
    assert len(robot.base) == whole
    said = float(note.text.partition(" at most ")[2].split()[0])
    change = (np.abs(after - before).max(axis=0) / np.abs(before).max(axis=0)).max()
    assert change / 4 < said < 4 * change
    for count in {whole, left}:
        assert str(count) in note.text
    # An angle that is asked for is not looked at.
    for snap, expected in ((0.0, whole), (1e-5, left)):
        asked = symid.load(path, snap=snap)
        assert len(asked.base) == expected
        assert not {"robot.not-rounded", "robot.rounding-price"} & {entry.code for entry in asked.notices}
    # All commands read the same robot.
    drawn = tmp_path / "arm.toml"
    symid.new_robot(urdf=path).save(drawn)
    assert len(symid.load(drawn).base) == whole
