"""`symid generate --friction-laws`, and verbs on robots with curved friction."""

import json

import numpy as np
import pytest

from symid.cli.main import run
from symid.joint_models.friction_catalogue import FRICTION_LAWS


def call_json(capsys, *arguments):
    """Run a verb with --json; return its exit code and the object."""
    code = run([*map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_friction_laws_are_part_of_the_library(capsys, tmp_path):
    folder = tmp_path / "code"
    call = ("generate", "emps", "--function", "friction", "--friction-laws", "-o", folder)
    code, answer = call_json(capsys, *call)
    assert code == 0
    result = answer["result"]
    assert result["selftest"] == "passed" or answer["warnings"][-1]["code"] == "generate.selftest-not-run"
    header = (folder / "symid_emps_friction_laws.h").read_text()
    assert header.count("double symid_emps_friction_") == len(FRICTION_LAWS)
    assert "symid_emps_friction_laws.o" in (folder / "Makefile").read_text()
    assert "install(FILES symid_emps.h symid_emps_friction_laws.h" in (folder / "CMakeLists.txt").read_text()
    manifest = json.loads((folder / "manifest.json").read_text())
    assert {"symid_emps_friction_laws.h", "symid_emps_friction_laws.c"} <= set(manifest["files"])


def test_friction_laws_are_in_c_alone(capsys, tmp_path):
    code, answer = call_json(
        capsys, "generate", "emps", "--friction-laws", "--target", "python", "-o", tmp_path / "code"
    )
    assert code == 2
    assert answer["errors"][0]["code"] == "usage.friction-laws"
    assert not (tmp_path / "code").exists()


CURVED = """
name = "slide"
convention = "modified"
gravity = [0, 0, -9.81]

[[joint]]
name = "carriage"
kind = "prismatic"
alpha = "pi/2"

[joint.link]
mass = 95.0
com = [0, 0, 0]

[joint.friction]
model = "stribeck"
Fv = 203
Fc = 20
Fe = 8
vs = 0.05

[joint.limits]
position = [-0.3, 0.3]
velocity = 0.5
torque = 500
"""


@pytest.mark.parametrize("target", ["c", "python"])
def test_a_robot_with_curved_friction_is_generated(capsys, tmp_path, target):
    (tmp_path / "slide.toml").write_text(CURVED.replace("vs =", "gamma = 1.5\nvs ="))
    call = ("generate", tmp_path / "slide.toml", "--target", target, "-o", tmp_path / "code")
    code, answer = call_json(capsys, *call)
    assert code == 0
    assert answer["result"]["selftest"] == "passed" or answer["warnings"]


def test_curved_friction_is_simulated_and_identified(capsys, tmp_path):
    robot, log = tmp_path / "slide.toml", tmp_path / "log.npz"
    robot.write_text(CURVED)
    assert run(["simulate", str(robot), "-o", str(log), "--seed", "1", "--duration", "12", "-q"]) == 0
    capsys.readouterr()
    code, answer = call_json(capsys, "identify", robot, log, "-o", tmp_path / "estimate.json")
    assert code == 0
    found = {entry["name"]: entry["value"] for entry in answer["result"]["parameters"]}
    for name, value in (("Fv1", 203.0), ("Fc1", 20.0), ("Fe1", 8.0)):
        assert found[name] == pytest.approx(value, rel=0.05)
    assert np.isfinite(list(found.values())).all()
