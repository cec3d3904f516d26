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
def test_a_set_that_hangs_on_rounding_is_not_the_default(tmp_path, rolls):
    written, meant = write_arm(*rolls), write_arm(*round_angles(rolls))
    path = tmp_path / "arm.urdf"
    path.write_text(written)
    (whole, before), (left, after) = compute_columns(written), compute_columns(meant)
    robot = symid.load(path)
    codes = {"robot.rounding-assumed", "robot.rounding-price"}
    (note,) = [entry for entry in robot.notices if entry.code in codes]
    assert note.is_note
    assert note.code == "robot.rounding-assumed" or whole == left
    assert len(robot.base) == left
    said = float(note.text.partition(" at most ")[2].split()[0])
    change = (np.abs(after - before).max(axis=0) / np.abs(before).max(axis=0)).max()
    assert change / 4 < said < 4 * change
    assert str(left) in note.text
    # An angle that is asked for is not looked at.
    for snap, expected in ((0.0, whole), (1e-5, left)):
        asked = symid.load(path, snap=snap)
        assert len(asked.base) == expected
        assert not codes & {entry.code for entry in asked.notices}
    # All commands read the same robot.
    drawn = tmp_path / "arm.toml"
    symid.new_robot(urdf=path).save(drawn)
    assert len(symid.load(drawn).base) == left


FINGERS = """<robot name="gripper"><link name="base"/>{links}
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 0.2"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="3"/></joint>
<joint name="f" type="{kind}"><parent link="l1"/><child link="fl"/><origin xyz="0 -0.0288 0.0743"
rpy="{quarter} {pitch} -{quarter}"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="50" velocity="3"/></joint>
<joint name="g" type="{kind}"><parent link="l1"/><child link="fr"/><origin xyz="0 0.0139 0.0788"
rpy="{quarter} {pitch} {quarter}"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="50" velocity="3"/><mimic joint="f"/></joint></robot>"""
FINGER = (
    '<link name="{}"><inertial><origin xyz="0.1 -0.02 0.05"/><mass value="0.7"/><inertia ixx="0.04" '
    'ixy="0.012" ixz="-0.009" iyy="0.05" iyz="0.007" izz="0.045"/></inertial></link>'
)


def load_fingers(path, quarter, **facts):
    links = "".join(FINGER.format(name) for name in ("l1", "fl", "fr"))
    path.write_text(FINGERS.format(links=links, quarter=quarter, **facts))
    return symid.load(path)


@pytest.mark.parametrize("quarter", ["1.5708", "1.571", "1.57", "1.5707", "1.57079", "4.712"])
@pytest.mark.parametrize(
    ("kind", "pitch"), [("revolute", 0.83776), ("revolute", 0.3), ("prismatic", 0.83776)]
)
def test_mirrored_fingers_have_the_set_of_the_exact_robot(tmp_path, quarter, kind, pitch):
    turns = round(float(quarter) / (np.pi / 2))
    meant = load_fingers(tmp_path / "exact.urdf", repr(turns * np.pi / 2), kind=kind, pitch=pitch)
    found = load_fingers(tmp_path / "rounded.urdf", quarter, kind=kind, pitch=pitch)
    pairs = zip(found.base.product.parameters, meant.base.product.parameters, strict=True)
    assert all(one.expression == other.expression for one, other in pairs)
    said = {entry.code for entry in found.notices}
    assert {"robot.rounding-assumed", "robot.rounding-price"} & said
    far = abs(float(quarter) - turns * np.pi / 2) > 1e-5
    # What is asked for is what is read.
    asked = symid.load(tmp_path / "rounded.urdf", snap=1e-5)
    assert ("robot.angle-rounded" in {entry.code for entry in asked.notices}) == far


def test_an_angle_of_few_digits_stays_where_nothing_hangs_on_it(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(write_arm("1.57", "0.7"))
    robot = symid.load(path)
    assert "robot.rounding-assumed" not in {entry.code for entry in robot.notices}
    assert robot.description.joints[1].placement.rotation[2][2]


AXES = {
    "dust": "-1.3e-9 1 2.2e-10",
    "close": "0.99999999999 -6.1e-17 3e-7",
    "diagonal": "0.70710678 0.70710679 1e-10",
    "coordinate": "0 1e-12 -1",
}


@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
@pytest.mark.parametrize("rpy", ["0.3 0 0.7", "1.5707963 0 1e-10", "0.7853981 1.5707 3.14159265"])
def test_snap_zero_moves_nothing(tmp_path, axis, rpy):
    text = write_arm("0.4", "0").replace('rpy="0.4 0 0.3"', f'rpy="{rpy}"')
    text = text.replace('<axis xyz="0 0 1"/>', f'<axis xyz="{axis}"/>', 2).replace(
        "0.2 0 0.1", "0.2 3e-10 0.1"
    )
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    robot = symid.load(path, snap=0)
    moved = {"robot.angle-snapped", "robot.axis-snapped", "robot.length-snapped"}
    assert not moved & {entry.code for entry in robot.notices}
    model, rng = pin.buildModelFromXML(text), np.random.default_rng(3)
    inverse, data = robot.casadi("inverse_dynamics", constant=True), model.createData()
    for q, v, a in rng.uniform(-2, 2, (5, 3, 3)):
        given = inverse.call([q, v, a])
        theirs = pin.rnea(model, data, q, v, a)
        assert given[0].full().ravel() == pytest.approx(theirs, rel=1e-13, abs=1e-13)
