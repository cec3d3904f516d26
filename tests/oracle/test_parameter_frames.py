"""Standard parameters are those of the file's own frames: against Pinocchio, and a closed form of DH rows."""

import numpy as np
import pytest

import symid
from tests.chains import FROM_PINOCCHIO, draw_parameters, order_regressor

PUMA = (
    ("pi/2", 0.0, 0.0),
    (0, 0.4318, 0.0),
    ("-pi/2", 0.0203, 0.15005),
    ("pi/2", 0.0, 0.4318),
    ("-pi/2", 0.0, 0.0),
    (0, 0.0, 0.05),
)
ARM = (("pi/3", 0.1, 0.2), (0.7, 0.3, 0.0), ("-pi/2", 0.0, 0.4))
TWISTS = {"pi/2": np.pi / 2, "-pi/2": -np.pi / 2, "pi/3": np.pi / 3}
ROBOTS = {"puma": PUMA, "twisted": ARM, "planar": ((0, 0.5, 0.0), (0, 0.4, 0.0))}
URDF = """<robot name="arm"><link name="base"/>{links}
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0.1 0.3" rpy="{turn}"/>
<axis xyz="{axis}"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
<joint name="j2" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0.2 0 0.1" rpy="0.3 0 1"/>
<axis xyz="1 0 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
<joint name="j3" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 0.4 0" rpy="{turn}"/>
<axis xyz="0 -1 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
<joint name="plate" type="fixed"><parent link="c"/><child link="tool"/><origin xyz="0 0 0.2" rpy="0 0.5 0"/>
</joint></robot>"""
LINK = """<link name="{0}"><inertial><origin xyz="0.1 -0.02 0.05" rpy="0.2 0 0"/><mass value="{1}"/>
<inertia ixx="0.04" ixy="0.002" ixz="-0.003" iyy="0.05" iyz="0.001" izz="0.045"/></inertial></link>"""
URDFS = {
    f"{turn} about {axis}": URDF.format(
        links="".join(LINK.format(name, k + 1) for k, name in enumerate(["a", "b", "c", "tool"])),
        turn=turn,
        axis=axis,
    )
    for turn, axis in (("0.1 0.2 0.3", "0 1 0"), ("1.5707963267948966 0 0", "0 0 1"), ("0 0 -1", "1 2 2"))
}


def write_rows(rows, convention="standard"):
    lines = [f'name = "arm"\nconvention = "{convention}"\ngravity = [1, -2, -9.81]']
    for alpha, a, d in rows:
        shown = f'"{alpha}"' if isinstance(alpha, str) else alpha
        lines.append(f'[[joint]]\nkind = "revolute"\nalpha = {shown}\na = {a}\nd = {d}')
    return "\n".join(lines)


def call(robot, name, *inputs, standard=True, constant=False):
    return robot.casadi(name, standard=standard, constant=constant).call(inputs)[0].full().squeeze()


def compute_transforms(rows, q):
    """Return the frames at the ends of standard rows, Rot(z, q) Trans(z, d) Trans(x, a) Rot(x, alpha)."""
    frames, whole = [], np.eye(4)
    for (alpha, a, d), angle in zip(rows, q, strict=True):
        twist = TWISTS.get(alpha, alpha)
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
        step = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        whole = whole @ np.array(step)
        frames.append(whole)
    return frames


def compute_closed_form(rows, q, bodies):
    """Return M and g by Uicker's pseudo-inertias J: M_jk = sum tr(dT/dq_j J dT/dq_k'), V = -sum g'T J e4."""
    size, step = len(rows), 1e-30
    slopes = []
    for k in range(size):
        moved = compute_transforms(rows, q + 1j * step * np.eye(size)[k])
        slopes.append([frame.imag / step for frame in moved])
    down, mass, weight = np.array([1.0, -2.0, -9.81, 0.0]), np.zeros((size, size)), np.zeros(size)
    for link, (xx, xy, xz, yy, yz, zz, mx, my, mz, m) in enumerate(bodies):
        half = (xx + yy + zz) / 2
        pseudo = np.array(
            [[half - xx, -xy, -xz, mx], [-xy, half - yy, -yz, my], [-xz, -yz, half - zz, mz], [mx, my, mz, m]]
        )
        for j in range(size):
            weight[j] -= down @ slopes[j][link] @ pseudo[:, 3]
            for k in range(size):
                mass[j, k] += np.trace(slopes[j][link] @ pseudo @ slopes[k][link].T)
    return mass, weight


@pytest.mark.parametrize("rows", ROBOTS.values(), ids=ROBOTS)
def test_standard_rows_take_the_numbers_of_their_own_frames(tmp_path, rows):
    path = tmp_path / "arm.toml"
    path.write_text(write_rows(rows))
    robot, rng = symid.load(path), np.random.default_rng(4)
    bodies, q = draw_parameters(rng, len(rows)), rng.uniform(-3, 3, len(rows))
    mass, weight = compute_closed_form(rows, q, bodies)
    pi = bodies.ravel()
    assert call(robot, "mass_matrix", q, pi) == pytest.approx(mass, abs=1e-12)
    assert call(robot, "gravity", q, pi) == pytest.approx(weight, abs=1e-12)
    rest = np.zeros(len(rows))
    columns = call(robot, "torque_regressor", q, rest, rest)
    assert columns @ pi == pytest.approx(weight, abs=1e-12)
    kinetic = call(robot, "energy_regressor", q, np.ones(len(rows)))
    assert kinetic @ pi == pytest.approx(mass.sum() / 2, abs=1e-12)
    # The internal frames are others, and so is what they take.
    assert robot.casadi("gravity", standard="internal").name_in(1) == "pi_internal"
    assert np.abs(call(robot, "gravity", q, pi, standard="internal") - weight).max() > 1e-3


@pytest.mark.parametrize("text", URDFS.values(), ids=URDFS)
def test_urdf_links_take_what_pinocchio_takes(tmp_path, text):
    pin = pytest.importorskip("pinocchio", reason="wants the package pin")
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    model = pin.buildModelFromXML(text)
    data, robot, rng = model.createData(), symid.load(path, tip="tool"), np.random.default_rng(2)
    q, v, a = rng.uniform(-2, 2, (3, 3))
    pi = np.concatenate([body.toDynamicParameters()[FROM_PINOCCHIO] for body in list(model.inertias)[1:]])
    tau = pin.rnea(model, data, q, v, a)
    assert call(robot, "inverse_dynamics", q, v, a, pi) == pytest.approx(tau)
    # The file's own numbers, without any given, are the same.
    assert call(robot, "inverse_dynamics", q, v, a, constant=True) == pytest.approx(tau)
    columns = order_regressor(pin.computeJointTorqueRegressor(model, data, q, v, a))
    assert call(robot, "torque_regressor", q, v, a) == pytest.approx(columns, abs=1e-10)


def test_generated_code_names_the_frame(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(write_rows(ARM))
    robot = symid.load(path)
    for kind, vector, words in (
        ("standard", "pi", "robot file"),
        ("internal", "pi_internal", "internal frame"),
    ):
        made = robot.write("c", tmp_path / kind, functions=["gravity"], parameters=kind)
        header = (made.folder / "symid_arm.h").read_text()
        title = next(line for line in header.splitlines() if f"Standard parameters {vector}," in line)
        assert words in title
        assert f"{vector}[0] XX1" in header
        assert words in (made.folder / "README.md").read_text()
    plain = robot.write("c", tmp_path / "base", functions=["gravity"])
    assert "about its frame" not in (plain.folder / "README.md").read_text()


def test_symbols_stay_exact_in_the_files_frames(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(write_rows([(0, '"L1"', 0.0)]) + "\n[symbols]\nL1 = 0.5\n")
    found = symid.load(path).sympy("gravity", standard=True)["g"]
    assert {"L1", "M1", "MX1", "MY1"} <= {symbol.name for symbol in found.free_symbols}


def test_other_words_for_the_frames_are_refused():
    robot = symid.load("two_link")
    for build in (robot.casadi, robot.sympy):
        with pytest.raises(symid.UsageError, match="'internal', got 'file'"):
            build("gravity", standard="file")
