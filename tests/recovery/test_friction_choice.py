"""Friction laws chosen inside the whole robot: torques of a hand-written arm with friction written anew."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import symid
from symid.errors import UsageError
from symid.identification.regression import fill_loads
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.friction_choice import choose_laws
from symid.identification.rigid.friction_tables import TangentLaw
from symid.joint_models import compute_column_derivatives, compute_columns, get_law
from symid.logs.recording import Recording
from symid.robot.description import Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_two_link, find_two_link_torque
from tests.unit.identification.rigid.two_link_logs import record_sticking

RATE, DURATION = 500.0, 40.0
BETA = TWO_LINK_TRUTH[:6]


def move(seed):
    """Return times, and exact q, dq, ddq: fast for a while, slow for a while, of two joints."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(DURATION * RATE)) / RATE
    phase, rates = rng.uniform(0, 2 * np.pi, (4, 2)), np.array([0.11, 0.17, 0.31, 0.43])
    q, dq, ddq = (np.zeros((len(time), 2)) for _ in range(3))
    # The amplitude changes over 20 s, between 1 and a twentieth, by a cosine whose rates are exact.
    w = 2 * np.pi / 20.0
    size = 0.525 + 0.475 * np.cos(w * time)
    first, second = -0.475 * w * np.sin(w * time), -0.475 * w * w * np.cos(w * time)
    for k, rate in enumerate(rates):
        omega = 2 * np.pi * rate * rng.uniform(0.95, 1.05, 2)
        angle = np.outer(time, omega) + phase[k]
        a = 0.35 / (1 + k) * np.array([1.0, 1.2])
        x, v, c = np.sin(angle), omega * np.cos(angle), -(omega**2) * np.sin(angle)
        q += a * size[:, None] * x
        dq += a * (size[:, None] * v + first[:, None] * x)
        ddq += a * (size[:, None] * c + 2 * first[:, None] * v + second[:, None] * x)
    return time, q, dq, ddq


def record(friction, seed, noise=0.005):
    """Return a log with friction(dq, load) (N, 2), 17 bit encoders and noise of a part of the torque."""
    rng = np.random.default_rng(1000 + seed)
    time, q, dq, ddq = move(seed)
    load = find_two_link_torque(q, dq, ddq)[0] @ BETA
    tau = load + friction(dq, load)
    tau = tau + noise * np.std(tau, axis=0) * rng.normal(size=tau.shape)
    step = 2 * np.pi / 2**20
    return Recording(time=time, position=np.round(q / step) * step, torque=tau, source=f"seed {seed}")


def stribeck_and_load(dq, load):
    first = 1.1 * dq[:, 0] + (1.5 + 0.6 * np.exp(-((dq[:, 0] / 0.08) ** 2))) * np.sign(dq[:, 0])
    second = 0.7 * dq[:, 1] + (0.4 + 0.09 * np.abs(load[:, 1])) * np.sign(dq[:, 1])
    return np.column_stack([first, second])


def cubic_and_asymmetric(dq, _load):
    v, w = dq.T
    first = 2.4 * v + 1.0 * np.sign(v) - 2.0 * np.abs(v) * v + 0.9 * v**3
    second = np.where(w > 0, 0.9 * w + 0.8, 1.3 * w - 0.55)
    return np.column_stack([first, second])


def plain(dq, _load):
    return np.array([1.5, 0.7]) * dq + np.array([1.8, 0.4]) * np.sign(dq)


def choose(friction, seed):
    log = record(friction, seed)
    found = choose_laws(build_two_link(), [log], Processing(drop_first=50, drop_last=50), gears=(1.0, 1.0))
    return [law.friction for law in found.joints], found


@pytest.mark.parametrize("seed", range(3))
def test_the_laws_of_both_joints_are_found_with_their_values(seed):
    (first, second), found = choose(stribeck_and_load, seed)
    assert (first.law, second.law) == ("stribeck", "load-dependent")
    assert_allclose(first.values, (1.1, 1.5, 0.6), rtol=0.05)
    assert_allclose(first.shape, (0.08,), rtol=0.05)
    assert_allclose(second.values, (0.7, 0.4, 0.09), rtol=0.05)
    assert_allclose(found.beta, BETA, rtol=0.05, atol=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_a_cubic_law_and_one_by_direction_are_found(seed):
    (first, second), _ = choose(cubic_and_asymmetric, seed)
    assert (first.law, second.law) == ("cubic", "asymmetric")
    assert_allclose(second.values, (0.9, 0.8, 1.3, 0.55), rtol=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_no_richer_law_is_chosen_for_coulomb_and_viscous_friction(seed):
    laws, found = choose(plain, seed)
    assert [law.law for law in laws] == ["coulomb-viscous"] * 2
    for law in found.joints:
        assert law.selection.chosen == "coulomb-viscous"
        assert len(law.selection.trials) > 20


@pytest.mark.parametrize("seed", [3, 4, 5, 6])
def test_waves_that_are_like_weights_are_no_friction(seed):
    """A joint without friction fixes the weights, and what a filter makes of them is no wave of the other."""
    laws, found = choose(lambda dq, load: plain(dq, load) * [1.0, 0.0], seed)
    assert laws[0].law == "coulomb-viscous"
    trials = {trial.law: trial for trial in found.joints[0].selection.trials}
    assert trials["position-torque"].reason.startswith("not identifiable: A1, B1")
    assert not trials["position-dependent"].reason


def test_a_joint_at_rest_keeps_plain_friction():
    log = record(plain, 0)
    still = np.column_stack([log.position[:, 0], np.zeros(len(log.time))])
    velocity = np.gradient(still, log.time, axis=0)
    acceleration = np.gradient(velocity, log.time, axis=0)
    tau = find_two_link_torque(still, velocity, acceleration)[0] @ BETA + plain(velocity, None)
    moved = Recording(time=log.time, position=still, torque=tau, source="one joint")
    found = choose_laws(build_two_link(), [moved], Processing(drop_first=50, drop_last=50), gears=(1.0, 1.0))
    assert found.joints[1].friction.law == "coulomb-viscous-offset"
    assert found.joints[1].selection is None


@pytest.mark.parametrize("name", ["stribeck", "load-dependent-stribeck", "improved-stribeck", "makkar"])
def test_a_tangent_law_is_the_law_and_its_slope(name):
    law, rng = get_law(name), np.random.default_rng(2)
    inputs = {"velocity": rng.normal(size=60), "load": rng.normal(size=60)}
    shape = [{"vs": 0.4, "dq0": 0.1, "g2": 9.0, "g3": 2.0, "g5": 7.0}[entry.name] for entry in law.shape]
    values = rng.uniform(0.5, 2.0, len(law.linear))
    tangent = TangentLaw.build(law, shape, values.tolist())
    columns = np.column_stack(tangent.columns(None, inputs, ()))
    step = 1e-6 * np.array(shape)
    for k in range(len(shape)):
        moved = [value + step[k] * (j == k) for j, value in enumerate(shape)]
        slope = (compute_columns(law, inputs, moved) - compute_columns(law, inputs, shape)) @ values / step[k]
        assert_allclose(columns[:, len(values) + k], slope, atol=2e-4 * np.abs(slope).max())
    exact = np.einsum("nps,p->ns", compute_column_derivatives(law, inputs, shape), values)
    assert_allclose(columns[:, len(values) :], exact)


ROBOT = """
name = "two_link"
convention = "modified"
gravity = [0, -9.81, 0]
[[joint]]
name = "joint1"
kind = "revolute"
[[joint]]
name = "joint2"
kind = "revolute"
a = 0.5
"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "two_link.toml"
    path.write_text(ROBOT)
    return symid.load(path)


@pytest.fixture(scope="module")
def logs(robot):
    made = [record(stribeck_and_load, seed) for seed in (0, 1)]
    return [
        symid.build_log(robot, time=one.time, q=one.position, tau=one.torque, source=one.source)
        for one in made
    ]


@pytest.fixture(scope="module")
def fit(robot, logs):
    return robot.identify(logs[0], friction="auto")


TRUTH = dict(zip(("ZZR1", "MXR1", "MY1", "ZZ2", "MX2", "MY2"), BETA, strict=True))
TRUTH |= {"Fv1": 1.1, "Fc1": 1.5, "Fe1": 0.6, "vs1": 0.08, "Fv2": 0.7, "Fc2": 0.4, "Fl2": 0.09}


def test_values_of_the_whole_robot_lie_within_their_deviations(fit):
    assert [law.law for law in fit.estimate.laws] == ["stribeck", "load-dependent"]
    assert {entry.name for entry in fit.parameters} == set(TRUTH)
    far = {e.name: (e.value - TRUTH[e.name]) / e.std for e in fit.parameters}
    assert max(map(abs, far.values())) < 4.0, far
    assert 0.0 < fit["vs1"].std < 0.01


def test_laws_go_into_files_and_come_back(fit, robot, logs, tmp_path):
    path = fit.save(tmp_path / "fit.json")
    again = symid.load_fit(path, robot)
    assert again.estimate == fit.estimate
    assert again.validate(logs[1]).verdict.level in {"good", "usable"}
    written = symid.load(fit.export(tmp_path / "arm.toml").file)
    first, second = (joint.friction for joint in written.description.joints)
    assert (first.law, first.shape) == ("stribeck", (fit.estimate.laws[0].shape))
    assert first.values == tuple(fit[name].value for name in ("Fv1", "Fc1", "Fe1"))
    assert second.values == tuple(fit[name].value for name in ("Fv2", "Fc2", "Fl2"))
    assert "load-dependent" in (tmp_path / "arm.toml").read_text()
    assert "Friction laws" in str(fit)
    fit.report(tmp_path / "fit.html")
    assert "load-dependent" in (tmp_path / "fit.html").read_text()


def test_the_shape_values_of_a_named_law_are_found(robot, logs):
    found = robot.identify(logs[0], friction="stribeck")
    assert [law.law for law in found.estimate.laws] == ["stribeck"] * 2
    assert abs(found["vs1"].value - 0.08) < 0.01


KEPT = ROBOT.replace(
    "a = 0.5",
    'a = 0.5\nfriction = { model = "load-dependent", Fv = 0.1, Fc = 0.1, Fl = 0.2, smoothing = 1e-4 }',
)


def test_a_joint_that_is_not_named_keeps_its_law(logs, tmp_path):
    (tmp_path / "arm.toml").write_text(KEPT)
    robot = symid.load(tmp_path / "arm.toml")
    fit = robot.identify(logs[0], friction={"joint1": "auto"})
    (law,) = fit.estimate.laws
    assert (law.joint, law.law) == ("joint1", "stribeck")
    assert fit.estimate.friction == ("stribeck", "load-dependent")
    far = {e.name: (e.value - TRUTH[e.name]) / e.std for e in fit.parameters}
    assert max(map(abs, far.values())) < 4.0, far
    again = symid.load_fit(fit.save(tmp_path / "fit.json"), robot)
    assert again.estimate == fit.estimate
    assert again.validate(logs[1]).verdict.level in {"good", "usable"}
    second = symid.load(fit.export(tmp_path / "out.toml").file).description.joints[1].friction
    assert (second.law, second.smoothing) == ("load-dependent", 1e-4)
    assert second.values == tuple(fit[name].value for name in ("Fv2", "Fc2", "Fl2"))


def test_shape_values_of_a_joint_that_is_not_named_are_the_robots(logs, tmp_path):
    text = KEPT.replace("load-dependent", "stribeck").replace("Fl = 0.2", "Fe = 0.2, vs = 0.3")
    (tmp_path / "arm.toml").write_text(text)
    fit = symid.load(tmp_path / "arm.toml").identify(logs[0], friction="joint1=stribeck")
    names = {entry.name for entry in fit.parameters}
    assert "vs1" in names
    assert "vs2" not in names
    written = symid.load(fit.export(tmp_path / "out.toml").file)
    assert written.description.joints[1].friction.shape == (0.3,)
    assert abs(fit["vs1"].value - 0.08) < 0.01


def test_a_joint_may_have_no_friction(robot, logs, tmp_path):
    seen = record(lambda dq, _load: plain(dq, None) * [1.0, 0.0], 3)
    log = symid.build_log(robot, time=seen.time, q=seen.position, tau=seen.torque)
    fit = robot.identify(log, friction={"joint1": "coulomb-viscous", "joint2": "none"})
    assert [law.law for law in fit.estimate.laws] == ["coulomb-viscous", "none"]
    assert {entry.name for entry in fit.parameters} == {*list(TRUTH)[:6], "Fv1", "Fc1"}
    assert abs(fit["Fv1"].value - 1.5) < 4 * fit["Fv1"].std
    again = symid.load_fit(fit.save(tmp_path / "fit.json"), robot)
    assert again.validate(log).verdict.level in {"good", "usable"}
    assert "none" in str(fit)


def test_waves_may_be_named_for_a_joint(robot, logs):
    fit = robot.identify(logs[0], friction="joint1=position-dependent-1,2x3,joint2=load-dependent")
    assert [law.law for law in fit.estimate.laws] == ["position-dependent-1,2x3", "load-dependent"]


@pytest.mark.parametrize(
    ("friction", "texts"),
    [
        (
            {"jont1": "auto", "joint2": "stribek"},
            ("'jont1': no such joint; did you mean joint1", "'stribek'; did you mean stribeck"),
        ),
        ({"joint1": "non", "joint2": 3}, ("did you mean none?", "expected the name of a law, got 3")),
        ("joint1=auto, joint1=tustin", ("'joint1' is given twice",)),
        ("joint1=, joint2=autoo", ("unknown friction law ''", "did you mean auto?")),
    ],
)
def test_all_mistakes_in_joints_and_laws_are_told_at_once(robot, logs, friction, texts):
    with pytest.raises(UsageError) as caught:
        robot.identify(logs[0], friction=friction)
    assert {notice.code for notice in caught.value.notices} == {"usage.joint-friction"}
    for text in texts:
        assert text in str(caught.value)
    if texts[0].startswith("'jont1'"):
        assert len(caught.value.notices) == 2
        assert "Allowed joints are joint1, joint2. Allowed laws are auto, none, coulomb, " in str(
            caught.value
        )


def test_laws_of_joints_are_found_from_logs_alone(robot, logs):
    with pytest.raises(
        UsageError, match=r"friction of single joints \(joint2=coulomb\) is found from the logs"
    ):
        robot.identify(logs[0], friction={"joint2": "coulomb"}, estimator="ridge")
    with pytest.raises(UsageError, match="laws of single joints are a friction of"):
        robot.override(friction="joint2=coulomb")


def test_friction_alone_takes_laws_of_joints_too(robot, logs):
    fit = robot.identify_friction(logs[0], model={"joint2": "load-dependent"})
    assert fit.estimate.model == "joint2=load-dependent"
    assert fit.joints["joint1"].selection is not None
    assert fit.joints["joint2"].selection is None
    assert fit.joints["joint2"].estimate.law == "load-dependent"
    with pytest.raises(UsageError, match="unknown friction law 'none'"):
        robot.identify_friction(logs[0], model={"joint2": "none"})


def test_a_law_of_the_load_in_a_robot_file_needs_no_search(fit, logs, tmp_path):
    written = symid.load(fit.export(tmp_path / "arm.toml").file)
    found = written.identify(logs[0])
    assert abs(found["Fl2"].value - 0.09) < 4 * found["Fl2"].std + 0.002
    assert not found.estimate.laws


def test_where_joints_rest_slow_rows_and_those_beside_are_left_out(fit, tmp_path):
    """A law that bends near standstill would follow what dry friction holds there."""
    library = symid.load(fit.export(tmp_path / "arm.toml").file).library
    log, resting = record_sticking(0)
    shares = []
    for recording, rests in ((log, True), (record(plain, 0), False)):
        loaded = fill_loads(library, [recording], Processing(), BETA)
        found = identify_parameters(library, loaded, Processing(automatic=True))
        assert rests == all(entry.standstill > 0.0 for entry in found.choice.candidates)
        assert rests == any("joints rest in these logs" in notice.text for notice in found.notices)
        shares.append([entry.share for entry in found.evidence.joints])
    usual = identify_parameters(build_two_link(), [log], Processing(automatic=True))
    assert min(shares[0]) > resting.mean()
    for share, entry in zip(shares[0], usual.evidence.joints, strict=True):
        assert share > entry.share


@pytest.mark.parametrize("given", [{"estimator": "ridge", "prior": "robot"}, {"estimator": "output-error"}])
def test_where_laws_cannot_be_searched_that_is_said(robot, logs, given):
    with pytest.raises(UsageError, match="auto") as caught:
        robot.identify(logs[0], friction="auto", options=symid.IdentifyOptions(**given))
    assert caught.value.notices[0].code == "usage.friction-search"


def test_an_unknown_law_is_refused_before_anything_is_fitted(robot, logs):
    with pytest.raises(UsageError, match="did you mean"):
        robot.identify(logs[0], friction="stribek")
    with pytest.raises(UsageError, match="symid identify") as caught:
        symid.load("two_link", friction="auto")
    assert caught.value.notices[0].code == "usage.friction-auto"
