"""Identification on code that CasADi generated: the parameters that our own code gives."""

import json
import shlex
from contextlib import chdir

import pytest

from symid.cli.main import run
from tests.golden.freeze import CALLS, Scratch, read_answer


def list_parameters(result):
    """Return values by name of a fit, or of the fit of a demo."""
    return {entry["name"]: entry["value"] for entry in result.get("estimate", result)["parameters"]}


@pytest.mark.parametrize("name", ["tx40-wls", "demo"])
def test_the_parameters_do_not_depend_on_the_generator(name, tmp_path, capsys, shared_data, c_compiler):
    folder = Scratch(tmp_path).folder
    with chdir(folder):
        code = run([*shlex.split(CALLS[name]), "--backend", "casadi", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert (code, found["result"]["backend"]) == (0, "casadi")
    ours = list_parameters(read_answer(name)["result"])
    assert len(ours) > 10
    assert list_parameters(found["result"]) == pytest.approx(ours, rel=1e-9)
