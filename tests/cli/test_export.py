"""`symid export`: what was identified becomes a robot file whose base parameters are the identified ones."""

import json

import pytest

from symid.cli.main import run
from symid.dynamics.base_parameters import compute_parameter_values, derive_base_parameters
from symid.robot.toml_reader import read_robot
from tests.calls import ask, do, hear, list_codes


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    run(["simulate", "two_link", "--duration", "8", "-o", str(folder / "log.npz"), "-q"])
    run(["identify", "two_link", str(folder / "log.npz"), "-o", str(folder / "estimate.json"), "-q"])
    return folder


def test_the_file_has_the_identified_values(identified, tmp_path):
    estimate = json.loads((identified / "estimate.json").read_text(encoding="utf-8"))
    file = tmp_path / "found.toml"
    answer = do("export", "two_link", identified / "estimate.json", "-o", file)
    assert answer["result"]["outcome"] == "consistent"
    robot = read_robot(file)
    values = compute_parameter_values(robot, derive_base_parameters(robot))
    for entry in estimate["parameters"]:
        assert values[entry["name"]] == pytest.approx(entry["value"], rel=1e-9, abs=1e-9)


def test_values_of_no_bodies_are_said_and_the_nearest_are_written(identified, tmp_path):
    changed = json.loads((identified / "estimate.json").read_text(encoding="utf-8"))
    for entry in changed["parameters"]:
        if entry["name"] == "ZZ2":
            entry["value"] = -abs(entry["value"])
    changed["parameters"] = [entry for entry in changed["parameters"] if entry["name"] != "MY2"]
    changed["refused"] = [["MY2", "for the test"]]
    changed["covariance"] = []
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps(changed), encoding="utf-8")
    text = hear(3, "export.cost", "export", "two_link", broken, "-o", tmp_path / "x.toml")
    assert "of the torque of 'elbow' (limit 2 %)" in text
    assert not (tmp_path / "x.toml").exists()
    code, answer = ask("export", "two_link", broken, "-o", tmp_path / "x.toml", "--limit", 1000)
    codes = list_codes(answer)
    assert code == 0, answer
    assert "export.inconsistent" in codes
    assert "export.not-identified" in codes
    assert "ZZ2" in answer["result"]["blamed"]
