"""Identification on code that CasADi generated: the parameters that our own code gives."""

import json
import shlex
from contextlib import chdir

import pytest

from symid.cli.main import run
from tests.golden.freeze import CALLS, Scratch, find_answer, list_needs, read_answer


@pytest.mark.parametrize("name", ["tx40-wls", "elastic-nlp"])
def test_the_parameters_do_not_depend_on_the_generator(name, tmp_path, capsys, shared_data, c_compiler):
    scratch = Scratch(tmp_path)
    for need in list_needs(name):
        find_answer(need, scratch)
    capsys.readouterr()
    with chdir(scratch.folder):
        code = run([*shlex.split(CALLS[name]), "--backend", "casadi", "--json"])
    found = json.loads(capsys.readouterr().out)["result"]
    assert (code, found["backend"]) == (0, "casadi")
    ours = read_answer(name)["result"]
    assert len(ours["parameters"]) > 10
    values = {entry["name"]: entry["value"] for entry in found["parameters"]}
    expected = {entry["name"]: entry["value"] for entry in ours["parameters"]}
    assert values == pytest.approx(expected, rel=1e-7)
