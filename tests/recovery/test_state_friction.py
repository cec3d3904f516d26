"""Identification of robots whose friction has a state: its curve is found, its state values are kept."""

import pytest

import symid
from symid.errors import UsageError
from symid.joint_models import get_law
from tests.refusals import raises
from tests.state_laws import ARM, write_table

LIMITS = """
[joint.limits]
position = [-2.0, 2.0]
velocity = 1.5
acceleration = 8.0
"""
NAMES = ("lugre", "dahl", "maxwell-slip", "generalised-maxwell-slip")
TRUTH = {"ZZ1": 0.03 + 2.0 * 0.04, "MX1": 0.4, "Fv1": 1.1, "Fc1": 2.0, "Fe1": 0.7, "vs1": 0.1, "gamma1": 1.4}


def load(folder, name, **changed):
    (folder / f"{name}.toml").write_text((ARM + LIMITS).format(friction=write_table(name, **changed)))
    return symid.load(folder / f"{name}.toml")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("state")


@pytest.fixture(scope="module")
def logs(folder):
    """Return a simulated log of each law, by its name."""
    return {name: load(folder, name).simulate(duration=12.0, seed=5).log for name in NAMES}


def find_codes(result):
    return {notice.code for notice in result.notices}


@pytest.mark.parametrize("name", NAMES)
def test_the_curve_is_found_and_the_state_values_go_into_the_file(name, logs, folder, tmp_path):
    robot = load(folder, name)
    fit = robot.identify(logs[name])
    (notice,) = (notice for notice in fit.notices if notice.code == "identify.friction-state")
    law = get_law(name)
    assert (
        f"(a: {name} with its {', '.join(entry.name for entry in (*law.shape, *law.memory))})" in notice.text
    )
    for entry in fit.parameters:
        slack = 4.0 * entry.std + 0.02 * abs(TRUTH.get(entry.name, 0.0)) + 5e-3
        assert abs(entry.value - TRUTH.get(entry.name, 0.0)) < slack, entry.name
    written = symid.load(fit.export(tmp_path / "found.toml").file)
    friction, before = (one.description.joints[0].friction for one in (written, robot))
    assert (friction.law, friction.shape, friction.bristles) == (before.law, before.shape, before.bristles)
    known = {entry.name: entry.value for entry in fit.parameters}
    assert friction.values == pytest.approx(
        [known[f"{entry.name}1"] for entry in get_law(name).linear], rel=1e-12
    )
    # The file runs: another simulation, of the values found.
    again = written.simulate(duration=2.0, seed=6)
    assert again.energy_gap < 1e-7
    assert fit.validate(robot.simulate(duration=8.0, seed=7).log).verdict.level in {"good", "usable"}


@pytest.mark.parametrize("named", ["lugre", {"a": "lugre"}])
def test_the_law_of_the_file_by_name_is_the_law_of_the_file(logs, folder, named):
    robot = load(folder, "lugre")
    found, plain = (robot.identify(logs["lugre"], friction=laws) for laws in (named, None))
    assert found.estimate.parameters == plain.estimate.parameters
    assert "identify.friction-state" in find_codes(found)


@pytest.mark.parametrize("friction", ["auto", "stribeck", {"a": "coulomb-viscous"}])
def test_a_search_says_that_it_gives_the_state_up(friction, logs, folder):
    fit = load(folder, "lugre").identify(logs["lugre"], friction=friction)
    (notice,) = (notice for notice in fit.notices if notice.code == "identify.friction-replaced")
    assert "friction with a state (a: lugre) gives way to a static law" in notice.text
    assert "identify.friction-state" not in find_codes(fit)
    assert not any(get_law(law.law).memory for law in fit.estimate.laws)


def test_laws_whose_state_is_not_stated_are_refused_with_what_to_give(logs, folder, tmp_path):
    (tmp_path / "arm.toml").write_text((ARM + LIMITS).format(friction='model = "coulomb-viscous"'))
    for name in NAMES:
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
