"""Gravity and zeros of encoders found with the parameters, from torques that Pinocchio computes."""

from functools import cache, partial

import numpy as np
import pytest

import symid
from symid.codegen import prepare_library
from symid.errors import IdentifiabilityError, UsageError
from tests.refusals import raises

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

LINK = (
    '<link name="l{0}"><inertial><origin xyz="{1}"/><mass value="{2}"/>'
    '<inertia ixx="0.05" ixy="0.01" ixz="-0.006" iyy="0.04" iyz="0.004" izz="0.06"/></inertial></link>'
)
JOINT = (
    '<joint name="j{0}" type="revolute"><parent link="l{1}"/><child link="l{0}"/><origin {2}/>'
    '<axis xyz="{3}"/><limit lower="-3" upper="3" effort="90" velocity="9"/>'
    '<dynamics damping="0.5" friction="0.7"/></joint>'
)
SPATIAL = (
    ('xyz="0 0 0.3"', "0 0 1", "0.08 0.03 0.1", 4.0),
    ('xyz="0.1 0 0.2" rpy="0.2 0 0"', "0 1 0", "0.15 -0.02 0.04", 3.0),
    ('xyz="0.35 0.05 0" rpy="0 0 0.4"', "0 1 0", "0.12 0.05 0.03", 2.0),
)
PLANAR = (
    ('xyz="0 0 0"', "0 0 1", "0.2 0.02 0", 4.0),
    ('xyz="0.4 0 0"', "0 0 1", "0.15 -0.03 0", 2.0),
)
FRICTION = (0.5, 0.7)
EARTH = (0.0, 0.0, -9.81)
CALLED = ("torque_regressor", "friction_regressor", "inverse_dynamics", "friction")


@pytest.fixture
def few_functions(monkeypatch):
    """Generate what fits to torque rows call and no more: every gravity on the way has its own library."""
    monkeypatch.setattr(symid.codegen, "prepare_library", partial(prepare_library, names=CALLED))


@cache
def write_arm(rows=SPATIAL):
    """Return the URDF of a chain: origin and axis of each joint, centre and mass of its link."""
    lines = ['<link name="l0"/>']
    for number, (origin, axis, centre, mass) in enumerate(rows, start=1):
        lines += [LINK.format(number, centre, mass), JOINT.format(number, number - 1, origin, axis)]
    return f'<robot name="arm">{"".join(lines)}</robot>'


def load_arm(folder, rows=SPATIAL, **options):
    file = folder / "arm.urdf"
    file.write_text(write_arm(rows), encoding="utf-8")
    return symid.load(file, friction="coulomb-viscous", backend="python", **options)


def record(robot, gravity, seed, *, rows=SPATIAL, zeros=None, duration=8.0, noise=0.01):
    """Return the log of an arm under gravity (3,), whose encoders read `zeros` (n,) less than its angles."""
    model = pin.buildModelFromXML(write_arm(rows))
    model.gravity.linear = np.array(gravity, dtype=float)
    data, rng = model.createData(), np.random.default_rng(seed)
    time = np.arange(int(duration * 200.0)) / 200.0
    rates = 2.0 * np.pi / duration * np.arange(1, 8)
    phases, sizes = (
        np.outer(time, rates),
        rng.normal(size=(2, 7, model.nq)) / np.sqrt(np.arange(1, 8))[:, None],
    )
    sizes *= 1.1 / np.abs(np.sin(phases) @ sizes[0] + np.cos(phases) @ sizes[1]).max(axis=0)
    waves = np.stack([np.sin(phases), np.cos(phases)])
    slopes = np.stack([np.cos(phases), -np.sin(phases)]) * rates
    q, dq, ddq = (np.einsum("ktr,krn->tn", part, sizes) for part in (waves, slopes, -waves * rates**2))
    tau = np.array([pin.rnea(model, data, *state) for state in zip(q, dq, ddq, strict=True)])
    tau += FRICTION[0] * dq + FRICTION[1] * np.sign(dq)
    tau += noise * tau.std(axis=0) * rng.normal(size=tau.shape)
    return symid.build_log(robot, time=time, q=q - (0.0 if zeros is None else np.array(zeros)), tau=tau)


def is_near(found, name, truth, *, least=0.0):
    return abs(found[name].value - truth) <= max(3.0 * found[name].std, least)


def find_texts(found):
    return [notice.text for notice in found.notices if notice.code == "identify.mounting"]


@pytest.mark.usefixtures("few_functions")
@pytest.mark.parametrize(
    "gravity",
    [
        pytest.param((2.1, -3.2, -9.032), id="tilted about two axes"),
        pytest.param((0.0, 0.0, 9.81), id="on the ceiling"),
        pytest.param((0.0, -9.81, 0.0), id="on a wall"),
    ],
)
def test_gravity_is_found_with_all_parameters(tmp_path, gravity):
    robot = load_arm(tmp_path, gravity="unknown")
    found = robot.identify(record(robot, gravity, 1))
    for name, truth in zip(("g_x", "g_y", "g_z"), gravity, strict=True):
        if name in found:
            assert is_near(found, name, truth, least=0.01)
            assert found[name].std < 0.1
    assert found.verdict.level == "good"
    assert all(entry.near_truth for entry in found.estimate.parameters if entry.truth is not None)
    assert not found.estimate.refused
    angle = np.degrees(np.arccos(np.dot(gravity, EARTH) / 9.81 / np.linalg.norm(gravity)))
    said = float(found.verdict.headline.partition("Gravity is turned by ")[2].split()[0])
    assert said == pytest.approx(angle, abs=0.5)


def test_under_gravity_along_the_first_axis_the_model_is_that_of_upright_robots(tmp_path):
    robot, upright = load_arm(tmp_path, gravity="unknown"), load_arm(tmp_path)
    found = robot.identify(record(robot, EARTH, 2))
    assert {"g_x", "g_y"} <= set(found)
    assert "g_z" not in found
    assert set(found) - {"g_x", "g_y"} == set(upright.base.names) | {
        f"{part}{k}" for part in ("Fv", "Fc") for k in (1, 2, 3)
    }
    assert is_near(found, "g_x", 0.0)
    assert is_near(found, "g_y", 0.0)


@pytest.mark.usefixtures("few_functions")
def test_another_size_of_gravity_is_found_where_it_is_sure(tmp_path):
    robot = load_arm(tmp_path, gravity="unknown")
    found = robot.identify(record(robot, (0.4, 0.3, -3.65), 3, noise=0.001))
    assert is_near(found, "g_z", -3.65)
    assert found["g_z"].std > 0.001
    assert "its magnitude is 3." in str(found)


def test_a_planar_arm_does_not_show_gravity_across_its_plane(tmp_path):
    robot = load_arm(tmp_path, PLANAR, gravity="unknown")
    found = robot.identify(record(robot, (-6.0, -7.7614, 0.0), 4, rows=PLANAR))
    assert find_texts(found) == ["not identifiable from these motions: gravity along 0, 0, 1; 0 is taken"]
    assert is_near(found, "g_x", -6.0)
    assert is_near(found, "g_y", -7.7614)
    assert "g_z" not in found


def test_one_joint_shows_no_gravity_beside_its_parameters(tmp_path):
    robot = load_arm(tmp_path, PLANAR[:1], gravity="unknown")
    log = record(robot, (0.0, -9.81, 0.0), 5, rows=PLANAR[:1])
    with raises(
        IdentifiabilityError, "identify.no-mounting", match="the magnitude of gravity, which parameters"
    ):
        robot.identify(log)


@pytest.mark.usefixtures("few_functions")
@pytest.mark.parametrize("zero", [0.2, -1.4, np.pi])
def test_zeros_are_found_where_motions_show_them(tmp_path, zero):
    robot = load_arm(tmp_path, zeros="unknown")
    found = robot.identify(record(robot, EARTH, 6, zeros=(0.4, zero, 0.0)))
    missed = (found["zero2"].value - zero + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(missed) <= 3.0 * found["zero2"].std < 0.1
    texts = find_texts(found)
    assert [text.split("'")[1] for text in texts] == ["j1", "j3"]
    assert all("not identifiable from these motions: the zero of joint" in text for text in texts)
    assert f"write offset = [0, {found['zero2'].value:.6g}, 0] below [log.position]" in str(found)
    assert all(
        entry.near_truth for entry in found.estimate.parameters if not entry.name.startswith(("F", "zero"))
    )


@pytest.mark.usefixtures("few_functions")
def test_the_zero_of_a_first_joint_shows_under_gravity_across_its_axis(tmp_path):
    gravity = (0.0, -9.81, 0.0)
    robot = load_arm(tmp_path, gravity=gravity, zeros=["j1"])
    found = robot.identify(record(robot, gravity, 7, zeros=(0.3, 0.0, 0.0)))
    assert is_near(found, "zero1", 0.3)
    # Where gravity is found as well, it takes the turn.
    both = load_arm(tmp_path, gravity="unknown", zeros=["j1"])
    texts = find_texts(both.identify(record(both, gravity, 7)))
    reason = "which gravity or parameters absorb; it stays as stated"
    assert texts == [f"not identifiable from these motions: the zero of joint 'j1', {reason}"]


@pytest.mark.usefixtures("few_functions")
def test_a_fit_with_gravity_and_zeros_is_kept_tested_and_exported(tmp_path):
    gravity, zeros = (1.5, -2.0, -9.4854), (0.0, 0.25, 0.0)
    robot = load_arm(tmp_path, gravity="unknown", zeros=["j2"])
    found = robot.identify(record(robot, gravity, 8, zeros=zeros))
    plain = load_arm(tmp_path)
    again = symid.load_fit(found.save(tmp_path / "fit.json"), plain)
    assert again["zero2"] == found["zero2"]
    test = record(plain, gravity, 9, zeros=zeros)
    assert again.validate(test).product.mean_relative_percent < 1.0
    # What is written needs nothing to be found: it predicts the same log by its values.
    written = symid.load(again.export(tmp_path / "found.toml").file, backend="python")
    assert written.description.gravity[0].to_float() == pytest.approx(1.5, abs=0.1)
    assert not written.description.symbols
    repeated = written.identify(test)
    assert all(entry.near_truth for entry in repeated.estimate.parameters if not entry.name.startswith("F"))


@pytest.mark.parametrize("rows", ["momentum", "energy"])
def test_other_rows_find_gravity_too(tmp_path, rows):
    robot = load_arm(tmp_path, PLANAR, gravity="unknown")
    log = record(robot, (-6.0, -7.7614, 0.0), 10, rows=PLANAR, duration=20.0)
    found = robot.identify(log, rows=rows)
    assert is_near(found, "g_x", -6.0)
    assert found["g_x"].std < 0.2


@pytest.mark.usefixtures("few_functions")
def test_deviations_hold(tmp_path):
    """Of 40 draws the 95 % intervals of gravity and a zero miss 8 at most, which is one chance in 2000."""
    gravity = (-6.0, -7.7614, 0.0)
    robot = load_arm(tmp_path, PLANAR, gravity="unknown")
    settings = {"processing.filter_cutoff": 40, "processing.decimation.factor": 5}
    found = [
        robot.identify(record(robot, gravity, 100 + seed, rows=PLANAR), settings=settings)
        for seed in range(40)
    ]
    for name, truth in (("g_x", -6.0), ("g_y", -7.7614)):
        misses = [abs(fit[name].value - truth) > 1.96 * fit[name].std for fit in found]
        assert sum(misses) <= 8


@pytest.mark.parametrize("options", [{"friction": "auto"}, {"estimator": "ridge"}])
def test_what_does_not_go_with_it_is_refused(tmp_path, options):
    robot = load_arm(tmp_path, PLANAR, gravity="unknown")
    log = record(robot, (0.0, -9.81, 0.0), 11, rows=PLANAR, duration=4.0)
    with raises(UsageError, "usage.mounting", match="gravity or zeros cannot be found w"):
        robot.identify(log, **options)


def test_elastic_joints_are_refused():
    log = symid.load("two_link_elastic").simulate(duration=2.0, seed=1).log
    with raises(UsageError, "usage.mounting", match="with elastic joints"):
        symid.load("two_link_elastic", zeros=["elbow"]).identify(log)


def test_tangents_are_differences_of_models(tmp_path):
    from symid.identification import mounting
    from symid.identification.options import IdentifyOptions

    robot = load_arm(tmp_path, gravity="unknown", zeros="unknown")
    problem = mounting._Problem(robot.description, (), lambda _: None, IdentifyOptions(), {})
    rng = np.random.default_rng(12)
    q, dq, ddq = rng.normal(size=(3, 20, 3))
    where = np.array([1.0, -2.0, -9.0, 0.1, -0.4, 0.3])
    mounted = problem.mount(where)
    beta = rng.normal(size=len(symid.dynamics.derive_base_parameters(mounted).keys))

    def predict(place):
        moved = problem.mount(place)
        model = robot.__class__(description=moved, backend="python").library
        (columns,) = model.evaluate("torque_regressor", q, dq, ddq)
        return columns @ beta, model

    _, library = predict(where)
    found = problem.evaluate_tangents(mounted, library, beta, q, dq, ddq)
    for k in range(6):
        ahead, behind = (predict(where + step * np.eye(6)[k])[0] for step in (1e-4, -1e-4))
        np.testing.assert_allclose(found[..., k], (ahead - behind) / 2e-4, atol=1e-6)
