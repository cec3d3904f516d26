"""The page on hysteresis without a robot: its script prints what it shows, its command is one."""

import os
import re

import numpy as np

from symid.cli.main import run
from tests.hysteresis_truths import make_input, make_stops, measure
from tests.transcripts import compare, list_scripts, run_scripts


def test_the_script_prints_what_the_page_shows(project, tmp_path):
    ((script, said),) = list_scripts((project / "docs" / "hysteresis.md").read_text(encoding="utf-8"))
    path = tmp_path / "script.py"
    path.write_text(script, encoding="utf-8")
    (printed,) = run_scripts([(path, tmp_path)], project.__class__(os.environ["XDG_CACHE_HOME"]))
    assert not compare(said, printed), printed


def test_the_command_of_the_page(project, tmp_path, monkeypatch, capsys):
    page = (project / "docs" / "hysteresis.md").read_text(encoding="utf-8")
    command = re.search(r"^symid (hysteresis .*)$", page, re.MULTILINE)[1].split()
    monkeypatch.chdir(tmp_path)
    for name, amplitude in (("damper.csv", 1.0), ("larger.csv", 1.2)):
        t, x = make_input(1, amplitude, 1200)
        table = np.column_stack([t, *measure(t, x, make_stops, 2)])
        np.savetxt(name, table, delimiter=",", header="t,displacement,force", comments="")
    assert run([*command, "--model", "prandtl-ishlinskii"]) == 0
    assert capsys.readouterr().out.count("verdict: good") == 2
