"""Identification, but for the method `nlp`, runs on the generated library alone, without SymPy and CasADi."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from tests.recovery.elastic_runs import run_arm

HEAD = """
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
from symid.robot.toml_reader import read_robot
from symid.identification.stored import read_fit, write_fit

library, folder = prepare_library(read_robot(Path(sys.argv[1]))), Path(sys.argv[2])
card = library.card
"""
RIGID = """
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.validation import validate_estimate
from symid.report.identification_page import build_identification_page
from symid.report.pages import write_page
from symid.robot.description import Processing
from tests.recovery.closed_form import sample_states

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
write_page(folder / "report.html", build_identification_page(estimate, (validation,)))
errors = abs(estimate.assemble(tuple(p.name for p in card.beta + card.friction)) - truth)
"""
ELASTIC = """
from symid.identification.elastic.identify import prepare_methods
from symid.identification.elastic.options import ElasticOptions

data = np.load(folder / "log.npz")
log = Recording(**{name: data[name] for name in ("time", "position", "motor_position", "torque")})
estimate = prepare_methods(library, [log], ElasticOptions())("weighted")
errors = [abs(p.value / p.truth - 1.0) for p in estimate.parameters if abs(p.truth) > 1e-9]
"""
TAIL = """
assert read_fit(write_fit(estimate, folder / "estimate.json")) == estimate
loaded = sorted({name.partition(".")[0] for name in sys.modules} & {"sympy", "casadi"})
print(json.dumps({"error": float(max(errors)), "loaded": loaded}))
"""


def run_script(script, project, *arguments):
    """Return the largest error that a script finds without the packages, in a process of its own."""
    command = [sys.executable, "-W", "error", "-c", HEAD + script + TAIL, *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": str(project)}
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=120)
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    assert answer["loaded"] == []
    return answer["error"]


# The libraries are derived and stored by fixtures, where both packages are there.
@pytest.mark.parametrize("rows", ["torque", "momentum", "energy"])
def test_identification_runs_without_sympy_and_casadi(
    tmp_path, project, robots_folder, two_link_library, rows
):
    assert two_link_library.card.beta
    # Velocities come from central differences at 1 kHz, so the result is not exact.
    assert run_script(RIGID, project, robots_folder / "two_link.toml", tmp_path, rows) < 5e-3
    assert (tmp_path / "report.html").stat().st_size > 10_000


def test_elastic_identification_runs_so(tmp_path, project, robots_folder, arm):
    log = run_arm(*arm, noisy=True).recording
    names = ("time", "position", "motor_position", "torque")
    np.savez(tmp_path / "log.npz", **{name: getattr(log, name) for name in names})
    assert run_script(ELASTIC, project, robots_folder / "two_link_elastic.toml", tmp_path) < 0.03
