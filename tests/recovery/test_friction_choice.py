"""Friction laws chosen inside the whole robot, with payloads too: torques of an arm written out by hand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import symid
from symid.api.log import Log
from symid.errors import UsageError
from symid.identification import rigid
from symid.identification.regression import fill_loads
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.friction_choice import choose_laws
from symid.logs.recording import Recording
from symid.robot.description import Processing
from tests.recovery import flexible_arm
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_two_link, find_two_link_torque
from tests.recovery.flexible_arm import RATE, find_friction, find_plain_friction, move
from tests.refusals import raises
from tests.unit.identification.rigid.two_link_logs import record_sticking

DURATION = 20.0
BETA = TWO_LINK_TRUTH[:6]
ROBOT = flexible_arm.ROBOT.replace("shoulder", "joint1").replace("elbow", "joint2")
CUT = Processing(drop_first=50, drop_last=50)


def record(friction, seed, noise=0.005, *, payload=0.0, sensed=False, duration=DURATION):
    """Return a log with friction(dq, load) (N, 2), 17 bit encoders and noise of a part of the torque.

    `payload` is added to the base parameters; loads are measured too where they are `sensed`.
    """
    rng = np.random.default_rng(1000 + seed)
    time = np.arange(round(duration * RATE)) / RATE
    q, dq, ddq = move(time, seed)
    load = find_two_link_torque(q, dq, ddq)[0] @ (BETA + payload)
    tau = load + friction(dq, load)
    scatter, step = noise * np.std(tau, axis=0), 2 * np.pi / 2**20
    tau = tau + scatter * rng.normal(size=tau.shape)
    felt = load + scatter * rng.normal(size=tau.shape) if sensed else None
    position = np.round(q / step) * step
    return Recording(time=time, position=position, torque=tau, load=felt, source=f"seed {seed}")


def cubic_and_asymmetric(dq, _load):
    v, w = dq.T
    first = 2.4 * v + 1.0 * np.sign(v) - 2.0 * np.abs(v) * v + 0.9 * v**3
    second = np.where(w > 0, 0.9 * w + 0.8, 1.3 * w - 0.55)
    return np.column_stack([first, second])


def choose(friction, seed):
    log = record(friction, seed)
    found = choose_laws(build_two_link(), [log], CUT, gears=(1.0, 1.0))
    return [law.friction for law in found.joints], found


@pytest.mark.parametrize("seed", range(3))
def test_the_laws_of_both_joints_are_found_with_their_values(seed):
    (first, second), found = choose(find_friction, seed)
    assert (first.law, second.law) == ("stribeck", "load-dependent")
    assert_allclose((*first.values, *first.shape), (1.1, 1.5, 0.6, 0.08), rtol=0.05)
    assert_allclose(second.values, (0.7, 0.4, 0.09), rtol=0.05)
    assert_allclose(found.beta, BETA, rtol=0.05, atol=0.01)
    (first, second), _ = choose(cubic_and_asymmetric, seed)
    assert (first.law, second.law) == ("cubic", "asymmetric")
    assert_allclose(second.values, (0.9, 0.8, 1.3, 0.55), rtol=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_no_richer_law_is_chosen_for_coulomb_and_viscous_friction(seed):
    laws, found = choose(find_plain_friction, seed)
    assert [law.law for law in laws] == ["coulomb-viscous"] * 2
    for law in found.joints:
        assert law.selection.chosen == "coulomb-viscous"
        assert len(law.selection.trials) > 20


@pytest.mark.parametrize("seed", [3, 4, 5, 6])
def test_waves_that_are_like_weights_are_no_friction(seed):
    """A joint without friction fixes the weights, and what a filter makes of them is no wave of the other."""
    laws, found = choose(lambda dq, load: find_plain_friction(dq, load) * [1.0, 0.0], seed)
    assert laws[0].law == "coulomb-viscous"
    trials = {trial.law: trial for trial in found.joints[0].selection.trials}
    assert trials["position-torque"].reason.startswith("not identifiable: A1, B1")
    assert not trials["position-dependent"].reason


def test_a_joint_at_rest_keeps_plain_friction():
    log = record(find_plain_friction, 0)
    still = np.column_stack([log.position[:, 0], np.zeros(len(log.time))])
    velocity = np.gradient(still, log.time, axis=0)
    acceleration = np.gradient(velocity, log.time, axis=0)
    tau = find_two_link_torque(still, velocity, acceleration)[0] @ BETA + find_plain_friction(velocity, None)
    moved = Recording(time=log.time, position=still, torque=tau, source="one joint")
    found = choose_laws(build_two_link(), [moved], CUT, gears=(1.0, 1.0))
    assert found.joints[1].friction.law == "coulomb-viscous-offset"
    assert found.joints[1].selection is None


@pytest.fixture(scope="module")
def robot(load_text):
    return load_text(ROBOT, "two_link")


@pytest.fixture(scope="module")
def logs(robot):
    return [Log(recording=record(find_friction, seed), robot=robot.description) for seed in (0, 1)]


@pytest.fixture(scope="module")
def fit(robot, logs):
    return robot.identify(logs[0], friction="auto")


TRUTH = dict(zip(("ZZR1", "MXR1", "MY1", "ZZ2", "MX2", "MY2"), BETA, strict=True))
TRUTH |= {"Fv1": 1.1, "Fc1": 1.5, "Fe1": 0.6, "vs1": 0.08, "Fv2": 0.7, "Fc2": 0.4, "Fl2": 0.09}


def measure_errors(fit):
    """Return how many deviations values are from the truth."""
    return {entry.name: abs(entry.value - TRUTH[entry.name]) / entry.std for entry in fit.parameters}


def test_values_of_the_whole_robot_lie_within_their_deviations(fit):
    assert [law.law for law in fit.estimate.laws] == ["stribeck", "load-dependent"]
    assert {entry.name for entry in fit.parameters} == set(TRUTH)
    errors = measure_errors(fit)
    assert max(errors.values()) < 4.0, errors
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
    # A law of the load in a robot file needs no search.
    found = written.identify(logs[0])
    assert abs(found["Fl2"].value - 0.09) < 4 * found["Fl2"].std + 0.002
    assert not found.estimate.laws
    assert "Friction laws" in str(fit)
    fit.report(tmp_path / "fit.html")
    assert all("load-dependent" in (tmp_path / name).read_text() for name in ("arm.toml", "fit.html"))


def test_named_laws_have_their_shape_values_found(robot, logs, tmp_path, monkeypatch):
    fits, identify = [], rigid.identify_parameters

    def note(library, *args, plan, **options):
        fits.append((plan.estimator, plan.processing, bool(library.card.searched)))
        return identify(library, *args, plan=plan, **options)

    monkeypatch.setattr(rigid, "identify_parameters", note)
    found = robot.identify(logs[0], friction="stribeck")
    # The last one is about shape values that stay, at the same settings; all of it is stored.
    assert [searched for *_, searched in fits] == [*[True] * (len(fits) - 1), False]
    assert all(one[:2] == fits[0][:2] for one in fits)
    assert symid.load_fit(found.save(tmp_path / "fit.json")).estimate == found.estimate
    assert [law.law for law in found.estimate.laws] == ["stribeck"] * 2
    assert abs(found["vs1"].value - 0.08) < 0.01
    waves = robot.identify(logs[0], friction="joint1=position-dependent-1,2x3,joint2=load-dependent")
    assert [law.law for law in waves.estimate.laws] == ["position-dependent-1,2x3", "load-dependent"]


KEPT = ROBOT.replace(
    "a = 0.5",
    'a = 0.5\nfriction = { model = "load-dependent", Fv = 0.1, Fc = 0.1, Fl = 0.2, smoothing = 1e-4 }',
)


def test_a_joint_that_is_not_named_keeps_its_law_and_shape_values(load_text, logs, tmp_path):
    robot = load_text(KEPT, "arm")
    fit = robot.identify(logs[0], friction={"joint1": "auto"})
    (law,) = fit.estimate.laws
    assert (law.joint, law.law) == ("joint1", "stribeck")
    assert fit.estimate.friction == ("stribeck", "load-dependent")
    errors = measure_errors(fit)
    assert max(errors.values()) < 4.0, errors
    again = symid.load_fit(fit.save(tmp_path / "fit.json"), robot)
    assert again.estimate == fit.estimate
    assert again.validate(logs[1]).verdict.level in {"good", "usable"}
    second = symid.load(fit.export(tmp_path / "out.toml").file).description.joints[1].friction
    assert (second.law, second.smoothing) == ("load-dependent", 1e-4)
    assert second.values == tuple(fit[name].value for name in ("Fv2", "Fc2", "Fl2"))
    text = KEPT.replace("load-dependent", "stribeck").replace("Fl = 0.2", "Fe = 0.2, vs = 0.3")
    fit = load_text(text, "arm").identify(logs[0], friction="joint1=stribeck")
    assert {"vs1", "vs2"} & {entry.name for entry in fit.parameters} == {"vs1"}
    written = symid.load(fit.export(tmp_path / "other.toml").file)
    assert written.description.joints[1].friction.shape == (0.3,)
    assert abs(fit["vs1"].value - 0.08) < 0.01


def test_a_joint_may_have_no_friction(robot, logs, tmp_path):
    seen = record(lambda dq, _load: find_plain_friction(dq, None) * [1.0, 0.0], 3)
    log = Log(recording=seen, robot=robot.description)
    fit = robot.identify(log, friction={"joint1": "coulomb-viscous", "joint2": "none"})
    assert [law.law for law in fit.estimate.laws] == ["coulomb-viscous", "none"]
    assert {entry.name for entry in fit.parameters} == {*list(TRUTH)[:6], "Fv1", "Fc1"}
    assert abs(fit["Fv1"].value - 1.5) < 4 * fit["Fv1"].std
    again = symid.load_fit(fit.save(tmp_path / "fit.json"), robot)
    assert again.validate(log).verdict.level in {"good", "usable"}
    assert "none" in str(fit)


ALLOWED = (
    "'stribek'; did you mean stribeck",
    "Allowed joints are joint1, joint2. Allowed laws are auto, none, coulomb, ",
)


@pytest.mark.parametrize(
    ("friction", "texts"),
    [
        ({"jont1": "auto", "joint2": "stribek"}, ("'jont1': no such joint; did you mean joint1", *ALLOWED)),
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
    assert "jont1" not in friction or len(caught.value.notices) == 2


def test_laws_that_are_unknown_or_cannot_be_searched_are_refused_before_anything_is_fitted(robot, logs):
    for options in ({"estimator": "ridge", "prior": "robot"}, {"estimator": "output-error"}):
        with raises(UsageError, "usage.friction-search", match="auto"):
            robot.identify(logs[0], friction="auto", options=symid.IdentifyOptions(**options))
    with pytest.raises(UsageError, match="did you mean"):
        robot.identify(logs[0], friction="stribek")
    with raises(UsageError, "usage.friction-auto", match="symid identify"):
        symid.load("two_link", friction="auto")
    text = r"friction of single joints \(joint2=coulomb\) is found from the logs"
    with pytest.raises(UsageError, match=text):
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


def test_where_joints_rest_slow_rows_and_those_beside_are_left_out(fit, tmp_path):
    """A law that bends near standstill would follow what dry friction holds there."""
    library = symid.load(fit.export(tmp_path / "arm.toml").file).library
    log, _ = record_sticking(0)
    shares = []
    for recording, rests in ((log, True), (record(find_plain_friction, 0), False)):
        loaded = fill_loads(library, [recording], Processing(), BETA)
        found = identify_parameters(library, loaded, Processing(automatic=True))
        assert not rests or all(speed > 0.0 for speed in found.choice.standstill)
        assert rests == any("joints rest in these logs" in notice.text for notice in found.notices)
        shares.append([entry.share for entry in found.evidence.joints])
    usual = identify_parameters(build_two_link(), [log], Processing(automatic=True))
    for share, entry in zip(shares[0], usual.evidence.joints, strict=True):
        assert share >= entry.share > 0.0


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


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("runs")
    (root / "plain.toml").write_text(ROBOT)
    (root / "laws.toml").write_text(ROBOT[: ROBOT.index('[[joint]]\nname = "joint2"')] + LAWS)
    robot = symid.load(root / "plain.toml")
    for name, payload, seed in (("empty", 0.0, 0), ("with", ADDED, 1), ("sensed", ADDED, 1)):
        log = record(find_friction, seed, payload=payload, sensed=name == "sensed", duration=40.0)
        Log(recording=log, robot=robot.description).save(root / f"{name}.npz")
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
