"""Every friction law, those with a state too, through robot file, fit, file, C and simulation: the same."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import symid
from symid.codegen import prepare_library
from symid.errors import UsageError
from symid.joint_models import get_law
from symid.notation import join_name
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from symid.simulation.rigid_plant import RigidPlant, build_rest_state
from tests.friction_forms import EVERY_LAW, find_torque
from tests.refusals import raises, tell
from tests.state_laws import (
    ARM,
    LAWS,
    count_deflections,
    find_torque as find_bristle_torque,
    give_values,
    take_step,
    write_table,
)

FILE = """
name = "arm"
convention = "modified"
gravity = [0, -9.81, 0]
[[joint]]
name = "swing"
kind = "revolute"
link = {{ mass = 2.0, com = [0.2, 0.01, 0.0], inertia = {{ xx = 0.01, yy = 0.02, zz = 0.03 }} }}
[joint.friction]
{friction}
[[joint]]
name = "slide"
kind = "prismatic"
alpha = "pi/2"
link = {{ mass = 2.0, com = [0.2, 0.01, 0.0], inertia = {{ xx = 0.01, yy = 0.02, zz = 0.03 }} }}
friction = {{ model = "coulomb-viscous", Fv = 3.0, Fc = 2.0 }}
"""
VALUES = {"Fv": 1.1, "Fc": 2.0, "Fe": 0.7, "offset": 0.2, "Fp": 0.2, "Fl": 0.05, "Fle": 0.02, "Fvq": 0.1}
VALUES |= {"Fct": -0.004, "Fvt": -0.006, "Fvl": 0.5, "Fd": 1.3, "Fm": 0.6, "Fep": 0.5, "Fen": 0.4}
VALUES |= {"Fvp": 1.1, "Fvn": 0.9, "Fcp": 2.0, "Fcn": 1.8}
SHAPE = {"vs": 0.1, "dq0": 0.04, "gamma": 1.4, "delta": 0.6, "g2": 20.0, "g3": 5.0, "g5": 15.0, "dqs": 0.01}
SHAPE |= {"TV": 25.0}
PLANT = ("friction", "friction_regressor", "forward_dynamics", "mass_matrix", "bias", "inverse_dynamics")


def state_values(law):
    """Return linear and shape values by their names in robot files; waves get small ones."""
    linear = {entry.name: VALUES.get(entry.name, 0.07) for entry in law.linear}
    return linear, {entry.name: SHAPE[entry.name] for entry in law.shape}


def write_file(path, name):
    law = get_law(name)
    linear, shape = state_values(law)
    lines = [f'model = "{name}"', *(f"{key} = {value}" for key, value in (linear | shape).items())]
    path.write_text(FILE.format(friction="\n".join(lines)))
    return law, linear, shape


@pytest.mark.parametrize("name", EVERY_LAW)
def test_a_law_is_the_same_in_every_place(name, tmp_path):
    law, linear, shape = write_file(tmp_path / "arm.toml", name)
    robot = symid.load(tmp_path / "arm.toml")
    # Written and read again.
    again = parse_robot(write_robot(robot.description)).joints[0].friction
    assert again == robot.description.joints[0].friction
    assert (again.law, again.values, again.shape) == (law.name, tuple(linear.values()), tuple(shape.values()))
    # C against the law's formula, written anew.
    library = prepare_library(robot.description, names=PLANT, backend="c")
    rng = np.random.default_rng(3)
    dq, q, load = (rng.normal(size=(40, 2)) * size for size in (0.4, 1.0, 8.0))
    warm = rng.uniform(15.0, 60.0, (40, 2))
    given = library.card.gather_friction_inputs(dq, q=q, load=load, temperature=warm)
    values = np.array([entry.value for entry in library.card.friction])
    # Waves that are like weights are in base parameters.
    kept = {entry.name for entry in library.card.friction}
    lost = {key for key in linear if key[0] in "AB" and join_name(key, 1) not in kept}
    linear = {key: 0.0 if key in lost else value for key, value in linear.items()}
    (torque,) = library.evaluate("friction", *given, values)
    inputs = {"velocity": dq[:, 0], "load": load[:, 0], "position": q[:, 0], "temperature": warm[:, 0]}
    assert_allclose(torque[:, 0], find_friction(law, (linear, shape), inputs), rtol=1e-12, atol=1e-12)
    # The plant: what drives the joint less what moves it is that friction.
    if not name.startswith("improved-stribeck-h4"):
        check_plant(library, law, (linear, shape))


def find_friction(law, values, inputs):
    """Return the torque by the formula of the law, which is written anew, for printed values."""
    printed = law.to_physical(*(list(part.values()) for part in values))
    named = dict(zip((entry.name for entry in law.physical), printed, strict=True))
    others = [key for key in law.inputs if key != "velocity"]
    columns = zip(*(inputs[key].tolist() for key in ("velocity", *others)), strict=True)
    return np.array(
        [find_torque(law.name, named, v, **dict(zip(others, row, strict=True))) for v, *row in columns]
    )


def check_plant(library, law, values):
    plant = RigidPlant(library)
    state, step = build_rest_state(np.array([0.4, 0.1])), 1e-4
    state = plant.advance(state, np.array([9.0, 25.0]), 0.2, substeps=20)
    assert state.dq[0] > 0.1
    push = np.array([9.0, 25.0])
    after = plant.advance(state, push, step)
    ddq = (after.dq - state.dq) / step
    middle = (0.5 * (state.q + after.q), 0.5 * (state.dq + after.dq))
    (rigid,) = library.evaluate("inverse_dynamics", *(part[None] for part in (*middle, ddq)), plant.beta)
    inputs = {"velocity": middle[1][:1], "load": rigid[0, :1], "position": middle[0][:1]}
    inputs["temperature"] = np.array([40.0])
    friction = find_friction(law, values, inputs)
    assert_allclose(push[0] - rigid[0, 0], friction[0], rtol=2e-6, atol=2e-6)


@pytest.mark.parametrize("name", LAWS)
def test_a_law_with_a_state_is_the_same_in_every_place(name, tmp_path):
    (tmp_path / "arm.toml").write_text(FILE.format(friction=write_table(name)))
    robot, p = symid.load(tmp_path / "arm.toml"), give_values(name)
    again = parse_robot(write_robot(robot.description))
    assert again.joints[0].friction == robot.description.joints[0].friction
    library = prepare_library(again, names=(*PLANT, "friction_step"), backend="c")
    plant, push, step = RigidPlant(library), np.array([9.0, 25.0]), 1e-4
    state = plant.advance(build_rest_state(np.array([0.4, 0.1]), plant.memory), push, 0.2, substeps=20)
    # Along the plant's velocities, held: C, the plant's bristles and the equations, step by step.
    z = in_c = by_plant = np.zeros(count_deflections(name))
    values = np.array([entry.value for entry in library.card.friction])
    for k in range(300):
        state = plant.advance(state, push * np.cos(0.1 * k), step)
        torque = plant.bristles.compute_torque(state.dq, state.bristles)
        assert torque[0] == pytest.approx(find_bristle_torque(p, state.dq[0], state.bristles), rel=1e-12)
        wanted, z = take_step(p, state.dq[0], step, z)
        given = state.dq[None], step * state.dq[None], in_c[None], values
        torque, in_c = (part[0] for part in library.evaluate("friction_step", *given))
        simulated, by_plant = plant.bristles.step(state.dq, step * state.dq, by_plant)
        for found, bent in ((torque, in_c), (simulated, by_plant)):
            assert found[0] == pytest.approx(wanted, rel=1e-12, abs=1e-12)
            assert_allclose(bent, z, rtol=1e-12, atol=1e-16)


LAWS_OF_FITS = ("stribeck-exponent+offset", "load-dependent-stribeck", "position-dependent-1,2x3", "makkar")


@pytest.mark.parametrize("name", LAWS_OF_FITS)
def test_a_fit_writes_the_law_that_it_was_made_with(name, tmp_path):
    write_file(tmp_path / "arm.toml", name)
    robot = symid.load(tmp_path / "arm.toml")
    fit = robot.identify(robot.simulate(duration=10.0, seed=1).log)
    written = symid.load(fit.export(tmp_path / "found.toml").file)
    friction, before = (one.description.joints[0].friction for one in (written, robot))
    assert (friction.law, friction.shape) == (before.law, before.shape)
    known = {entry.name: entry.value for entry in fit.parameters}
    names = [name for name in robot.base.friction if name in known]
    assert len(names) >= len(friction.values)
    own = [known[name] for name in names][: len(friction.values)]
    assert_allclose(friction.values, own, rtol=1e-12)


LIMITS = """
[joint.limits]
position = [-2.0, 2.0]
velocity = 1.5
acceleration = 8.0
"""
STATE_LAWS = ("lugre", "dahl", "maxwell-slip", "generalised-maxwell-slip")
STATED = {"ZZ1": 0.03 + 2.0 * 0.04, "MX1": 0.4, "Fv1": 1.1, "Fc1": 2.0, "Fe1": 0.7, "vs1": 0.1, "gamma1": 1.4}


def load(folder, name, **changed):
    (folder / f"{name}.toml").write_text((ARM + LIMITS).format(friction=write_table(name, **changed)))
    return symid.load(folder / f"{name}.toml")


@pytest.fixture(scope="module")
def logs(folder):
    """Return a simulated log of each law, by its name."""
    return {name: load(folder, name).simulate(duration=12.0, seed=5).log for name in STATE_LAWS}


@pytest.mark.parametrize("name", STATE_LAWS)
def test_the_curve_is_found_and_the_state_values_go_into_the_file(name, logs, folder, tmp_path):
    robot = load(folder, name)
    fit = robot.identify(logs[name])
    (notice,) = (notice for notice in fit.notices if notice.code == "identify.friction-state")
    law = get_law(name)
    assert (
        f"(a: {name} with its {', '.join(entry.name for entry in (*law.shape, *law.memory))})" in notice.text
    )
    for entry in fit.parameters:
        slack = 4.0 * entry.std + 0.02 * abs(STATED.get(entry.name, 0.0)) + 5e-3
        assert abs(entry.value - STATED.get(entry.name, 0.0)) < slack, entry.name
    written = symid.load(fit.export(tmp_path / "found.toml").file)
    friction, before = (one.description.joints[0].friction for one in (written, robot))
    assert (friction.law, friction.shape, friction.bristles) == (before.law, before.shape, before.bristles)
    # Those of the file are of a body that exists: friction may move with it, by far less than its deviation.
    known = {entry.name: entry for entry in fit.parameters}
    for entry, value in zip(get_law(name).linear, friction.values, strict=True):
        found = known[f"{entry.name}1"]
        slack = 0.1 * found.std if known["ZZ1"].value < 0.0 else 1e-12 * abs(found.value)
        assert value == pytest.approx(found.value, rel=0.0, abs=slack), entry.name
    # The file runs: another simulation, of the values found.
    again = written.simulate(duration=2.0, seed=6)
    assert again.energy_gap < 1e-7
    assert fit.validate(robot.simulate(duration=8.0, seed=7).log).verdict.level in {"good", "usable"}


@pytest.mark.parametrize("named", ["lugre", {"a": "lugre"}])
def test_the_law_of_the_file_by_name_is_the_law_of_the_file(logs, folder, named):
    robot = load(folder, "lugre")
    found, plain = (robot.identify(logs["lugre"], friction=laws) for laws in (named, None))
    assert found.estimate.parameters == plain.estimate.parameters
    assert "identify.friction-state" in tell(found.notices)


@pytest.mark.parametrize("friction", ["auto", "stribeck", {"a": "coulomb-viscous"}])
def test_a_search_says_that_it_gives_the_state_up(friction, logs, folder):
    fit = load(folder, "lugre").identify(logs["lugre"], friction=friction)
    (notice,) = (notice for notice in fit.notices if notice.code == "identify.friction-replaced")
    assert "friction with a state (a: lugre) gives way to a static law" in notice.text
    assert "identify.friction-state" not in tell(fit.notices)
    assert not any(get_law(law.law).memory for law in fit.estimate.laws)


def test_laws_whose_state_is_not_stated_are_refused_with_what_to_give(logs, folder, tmp_path):
    (tmp_path / "arm.toml").write_text((ARM + LIMITS).format(friction='model = "coulomb-viscous"'))
    for name in STATE_LAWS:
        law, robot = get_law(name), symid.load(tmp_path / "arm.toml")
        values = ", ".join(entry.name for entry in (*law.shape, *law.memory))
        words = f"needs {values} of joint 'a', which no option gives; write it into the robot file"
        with raises(UsageError, "usage.friction-shape", match=words):
            robot.identify(logs["dahl"], friction=name)
    with raises(UsageError, *["usage.joint-friction"] * 2, match="no such joint") as caught:
        load(folder, "lugre").identify(logs["lugre"], friction={"a": "dahl", "b": "auto"})
    words = "friction of joint 'a': 'dahl' needs sigma0, which no option gives"
    assert caught.value.notices[0].text.startswith(words)


def test_friction_rows_say_that_they_give_the_state_up(logs, folder, tmp_path):
    robot = load(folder, "lugre")
    found = robot.identify_friction(logs["lugre"], model="stribeck", known=robot)
    export = found.export(tmp_path / "found.toml")
    (notice,) = (notice for notice in export.notices if notice.code == "export.friction-replaced")
    assert "joint 'a': stribeck friction, as identified, replaces lugre and its sigma0, sigma1" in notice.text
    assert symid.load(export.file).description.joints[0].friction.law == "stribeck"


@pytest.mark.parametrize("estimator", ["output-error", "instrumental"])
def test_estimators_that_simulate_are_refused(estimator, logs, folder):
    with raises(
        UsageError, "usage.friction-state", match=r"friction with a state \(a: dahl\) moves otherwise"
    ):
        load(folder, "dahl").identify(logs["dahl"], estimator=estimator)
