"""What `derive`, `base` and `generate` tell of the symbolic core."""

import json
import subprocess
import sys

import casadi as ca
import pytest

from tests.calls import do


def run(*arguments):
    return do(*arguments)["result"]


def test_python_runs_the_package():
    command = [sys.executable, "-m", "symid", "base", "two_link", "--of", "torque", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout
    assert json.loads(done.stdout)["result"] == run("base", "two_link", "--of", "torque")


def test_derive_tells_the_operations_of_all_routes():
    operations = run("derive", "puma560")["operations"]
    inverse = [entry for entry in operations if entry["function"] == "inverse_dynamics"]
    assert len(inverse) > 3
    (chosen,) = [entry for entry in inverse if entry["chosen"]]
    assert chosen["mul"] + chosen["add"] == min(entry["mul"] + entry["add"] for entry in inverse)
    assert set(chosen) == {"function", "route", "chosen", "mul", "add", "trig"}


@pytest.mark.parametrize(("form", "count"), [("torque", 6), ("energy", 6), ("momentum", 4), ("gravity", 4)])
def test_base_of_a_form(form, count):
    result = run("base", "two_link", "--of", form)
    assert (result["of"], result["count"]) == (form, count)
    assert len(result["null_space"]) == len(result["eliminated"])
    names = {entry["name"] for entry in result["eliminated"]}
    assert names == {next(iter(change)) for change in result["null_space"]}
    assert bool(result["friction"]) == (form == "torque")


def test_generated_functions_of_standard_parameters(tmp_path):
    folder = tmp_path / "code"
    result = run("generate", "two_link", "--target", "python", "--parameters", "standard", "-o", folder)
    assert result["selftest"] == "passed"
    (module,) = folder.glob("*.py")
    text = module.read_text()
    assert "Standard parameters pi" in text
    assert "about its frame of the robot file" in text
    assert "pi[9] M1 (kg)" in text
    assert "def torque_regressor(q, dq, ddq" in text


def test_generated_casadi_functions(tmp_path):
    order = ("generate", "two_link", "--target", "casadi", "--function", "gravity", "-o", tmp_path / "code")
    result = run(*order)
    assert (result["target"], result["selftest"]) == ("casadi", "passed")
    assert result["runner"].startswith("CasADi ")
    gravity = ca.Function.load(str(tmp_path / "code" / "gravity.casadi"))
    assert (gravity.name_in(), gravity.name_out()) == (["q", "beta"], ["g"])
    assert run(*order)["unchanged"]


def test_derive_folds_joints_that_follow_others(tmp_path):
    path = tmp_path / "gripper.toml"
    path.write_text(
        'name = "gripper"\nconvention = "modified"\ngravity = [0, 0, -9.81]\n'
        '[[joint]]\nname = "left"\nkind = "prismatic"\nalpha = "pi/2"\n'
        "[joint.spring]\nstiffness = 20\nrest = 0.1\n"
        '[[joint]]\nname = "right"\nkind = "revolute"\nalpha = "pi/2"\na = 0.1\nparent = "base"\n'
        '[joint.mimic]\njoint = "left"\nmultiplier = -2\n'
    )
    steps = {step["title"]: step for step in run("derive", path)["steps"]}
    assert "the same polynomials" in steps["Torques"]["check"]
    assert {formula["left"].split("/")[0] for formula in steps["Torques"]["formulas"]} == {"dtau1"}
