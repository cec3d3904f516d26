"""Plants by which the judge is measured, beside inverse dynamics by Pinocchio, energy, and half a step."""

import json
import subprocess
import sys

import pytest

# Of torques and energies relative to the largest; MuJoCo's friction is a constraint, smooth about rest.
BOUNDS = {
    "own": {"inverse": 1e-12, "power": 1e-5, "rate": 1e-5, "recursion": 1e-12, "halved": 1e-5},
    "pinocchio": {"inverse": 1e-12, "power": 1e-5, "rate": 1e-5, "recursion": 1e-12, "halved": 1e-5},
    "mujoco": {"inverse": 5e-3, "power": 5e-3, "rate": 1e-5, "recursion": 1e-12},
}


@pytest.fixture(scope="module")
def errors(project, c_compiler):
    assert c_compiler
    pytest.importorskip("pinocchio")
    pytest.importorskip("mujoco")
    script = str(project / "benchmarks" / "judge.py")
    done = subprocess.run(
        [sys.executable, script, "--verify"], capture_output=True, text=True, check=False, cwd=project
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("plant", BOUNDS)
def test_a_plant_obeys_the_laws_that_are_told(errors, plant):
    assert errors[plant].keys() == BOUNDS[plant].keys()
    for name, bound in BOUNDS[plant].items():
        assert errors[plant][name] < bound, name
