"""Identification runs on the generated library alone: neither SymPy nor CasADi is there."""

import json
import os
import subprocess
import sys

import pytest

from symid.codegen.cache import prepare_library
from symid.robot.toml_reader import read_robot

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
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.validation import validate_estimate
from symid.report.identification_page import build_identification_page
from symid.report.pages import write_page
from symid.robot.description import Processing
from symid.robot.toml_reader import read_robot
from symid.identification.stored import write_fit
from tests.recovery.closed_form import sample_states

library = prepare_library(read_robot(Path(sys.argv[1])))
card = library.card
truth = np.linspace(0.5, 1.5, len(card.beta) + len(card.friction))
logs = []
for seed in (0, 1):
    time, q, dq, ddq = sample_states(card.size, 5001, 1e-3, seed)
    (rigid,) = library.evaluate("torque_regressor", q, dq, ddq)
    (friction,) = library.evaluate("friction_regressor", dq)
    tau = np.concatenate([rigid, friction], axis=2) @ truth
    logs.append(Recording(time=time, position=q, torque=tau))
processing = Processing(drop_first=5, drop_last=5)
estimate = identify_parameters(library, logs[:1], processing, rows=sys.argv[3])
validation = validate_estimate(estimate, library, logs[1], processing)
write_fit(estimate, Path(sys.argv[2]) / "estimate.json")
write_page(Path(sys.argv[2]) / "report.html", build_identification_page(estimate, (validation,)))
found = estimate.assemble(tuple(p.name for p in card.beta + card.friction))
loaded = sorted({name.partition(".")[0] for name in sys.modules} & {"sympy", "casadi"})
print(json.dumps({"error": float(abs(found - truth).max()), "loaded": loaded}))
"""


@pytest.mark.parametrize("rows", ["torque", "momentum", "energy"])
def test_identification_runs_without_sympy_and_casadi(tmp_path, project, robots_folder, rows):
    robot = robots_folder / "two_link.toml"
    # The library is derived and stored here, where both are there.
    prepare_library(read_robot(robot))
    command = [sys.executable, "-W", "error", "-c", SCRIPT, str(robot), str(tmp_path), rows]
    environment = {**os.environ, "PYTHONPATH": str(project)}
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=120)
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    assert answer["loaded"] == []
    # Velocities come from central differences at 1 kHz, so the result is not exact.
    assert answer["error"] < 5e-3
    assert (tmp_path / "report.html").stat().st_size > 10_000
