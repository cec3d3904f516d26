"""Programs of users are checked with full types: what results are, and arguments that do not exist."""

import os
import subprocess
import sys

import pytest

HEAD = """
from pathlib import Path
from typing import assert_type

import numpy as np
import numpy.typing as npt

import symid
from symid.api.fit import ElasticFit, FrictionFit, RigidFit

robot = symid.load("two_link")
"""
GOOD = """
log = symid.read_log("train.csv", robot)
fit = robot.identify([log, "more.csv", Path("other.csv")], estimator="wls", cutoff=50)
friction = robot.identify_friction(log)
validation = fit.validate("test.csv", gate=5.0)
lib = robot.compile()
payload = robot.payload(loaded="with.csv", empty=fit.estimate)

options = symid.IdentifyOptions(prior=fit, prior_factor=2.0, thresholds=((1e-3, 2e-3), (1e-3,)))
again = robot.identify(log, estimator="ridge", options=options)
law = symid.LawOptions(drop_first=100, known=robot)

assert_type(robot, symid.RobotModel)
assert_type(options.prior_weight, float | None)
assert_type(again, RigidFit | ElasticFit)
assert_type(robot.identify_friction(log, options=law), FrictionFit)
assert_type(robot.simulate(options=symid.SimulateOptions(control_period=0.002)).tau, npt.NDArray[np.float64])
assert_type(robot.excite(options=symid.ExciteOptions(velocity=1.5)).condition, float)
assert_type(robot.base, symid.BaseSet)
assert_type(robot.base.count, int)
assert_type(list(robot.base), list[str])
assert_type(robot.joints[0].name, str)
assert_type(log.q, npt.NDArray[np.float64])
assert_type(fit, RigidFit | ElasticFit)
assert_type(fit["ZZ2"].value, float)
assert_type(fit["ZZ2"].std, float)
assert_type(fit.covariance, npt.NDArray[np.float64])
assert_type(friction, FrictionFit)
assert_type(friction.joints["elbow"].formula, str)
assert_type(validation, symid.LogValidation)
assert_type(validation.mean_relative_percent, float)
assert_type(validation.plot().save("torques.svg"), Path)
assert_type(robot.sympy("gravity").operations, int)
robot.casadi("gravity")([0.0, 0.0])  # CasADi has no types
assert_type(lib.mass_matrix([0.1, 0.2], lib.beta), npt.NDArray[np.float64])
assert_type(lib.energy([0.1, 0.2], [0.0, 0.0], lib.beta).T, npt.NDArray[np.float64])
assert_type(payload.mass, float)
assert_type(robot.excite(harmonics=3).save("motion.csv"), Path)
assert_type(robot.simulate("ta").log, symid.Log)
assert_type(symid.load_fit("fit.json"), symid.Fit)
assert_type(symid.doctor().accepted, bool)
"""
BAD = {
    'robot.identify("train.csv", estimater="wls")': "call-arg",
    'robot.identify("train.csv", cutoff="50")': "arg-type",
    'robot.write("fortran", "code")': "arg-type",
    'fit: int = symid.load_fit("fit.json")': "assignment",
    'robot.identify("train.csv", options=symid.IdentifyOptions(threshold=3))': "call-arg",
    'symid.SimulateOptions(control_period="1 ms")': "arg-type",
    "robot.simulate(options=symid.ExciteOptions())": "arg-type",
    "robot.bases": "attr-defined",
    'symid.read_log("train.csv")': "call-arg",
    "symid.loads": "attr-defined",
}


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Return what mypy finds in a good and in a bad program, and nowhere else."""
    folder = tmp_path_factory.mktemp("user")
    (folder / "good.py").write_text(HEAD + GOOD, encoding="utf-8")
    (folder / "bad.py").write_text(HEAD + "\n".join(BAD), encoding="utf-8")
    # The settings of this project would be those of a user otherwise.
    command = ["-m", "mypy", "--strict", "--config-file=", f"--cache-dir={os.devnull}", "good.py", "bad.py"]
    done = subprocess.run([sys.executable, *command], cwd=folder, capture_output=True, text=True, check=False)
    *lines, last = done.stdout.splitlines()
    assert last.endswith("(checked 2 source files)"), done.stdout + done.stderr
    return lines


def test_a_program_sees_full_types(found):
    assert [line for line in found if not line.startswith("bad.py:")] == []


def test_mistakes_are_found(found):
    first = HEAD.count("\n") + 1
    for line, (code, kind) in enumerate(BAD.items(), first):
        said = [text for text in found if text.startswith(f"bad.py:{line}:")]
        assert any(f"[{kind}]" in text for text in said), (code, said)
