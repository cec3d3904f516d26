"""All methods for elastic joints but `nlp` run on the generated library alone, without SymPy and CasADi."""

import json
import os
import subprocess
import sys

import numpy as np

from tests.recovery.elastic_runs import prepare_arm, run_arm

SCRIPT = """
import json, sys
from pathlib import Path

class Block:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("sympy", "casadi"):
            raise ImportError(f"{name} is blocked")
        return None

sys.meta_path.insert(0, Block())
import numpy as np
from symid.codegen.cache import prepare_library
from symid.logs.recording import Recording
from symid.identification.elastic.identify import prepare_methods
from symid.identification.elastic.options import ElasticOptions
from symid.robot.toml_reader import read_robot
from symid.identification.stored import read_fit, write_fit

library = prepare_library(read_robot(Path(sys.argv[1])))
data = np.load(sys.argv[2])
log = Recording(**{name: data[name] for name in ("time", "position", "motor_position", "torque")})
estimate = prepare_methods(library, [log], ElasticOptions())("weighted")
path = write_fit(estimate, Path(sys.argv[3]))
assert read_fit(path, library.card) == estimate
errors = [abs(p.value / p.truth - 1.0) for p in estimate.parameters if abs(p.truth) > 1e-9]
loaded = sorted({name.partition(".")[0] for name in sys.modules} & {"sympy", "casadi"})
print(json.dumps({"error": max(errors), "loaded": loaded}))
"""


def test_elastic_identification_runs_without_sympy_and_casadi(tmp_path, project, robots_folder):
    robot, library = prepare_arm(robots_folder)
    log = run_arm(robot, library, noisy=True, duration=8.0).recording
    np.savez(
        tmp_path / "log.npz",
        time=log.time,
        position=log.position,
        motor_position=log.motor_position,
        torque=log.torque,
    )
    files = [robots_folder / "two_link_elastic.toml", tmp_path / "log.npz", tmp_path / "estimate.json"]
    command = [sys.executable, "-W", "error", "-c", SCRIPT, *map(str, files)]
    environment = {**os.environ, "PYTHONPATH": str(project)}
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=120)
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    assert answer["loaded"] == []
    assert answer["error"] < 0.03
