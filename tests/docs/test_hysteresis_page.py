"""The page on hysteresis without a robot: its script prints what it shows, its commands give C code."""

import os
import re
import subprocess

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


def test_three_commands_lead_from_a_file_to_c_code(project, tmp_path, monkeypatch, capsys, c_compiler):
    page = (project / "docs" / "hysteresis.md").read_text(encoding="utf-8")
    commands = [line.split() for line in re.findall(r"^symid (hysteresis .*)$", page, re.MULTILINE)]
    assert len(commands) == 3
    monkeypatch.chdir(tmp_path)
    for name, amplitude in (("damper.csv", 1.0), ("larger.csv", 1.2)):
        t, x = make_input(1, amplitude, 1200)
        table = np.column_stack([t, *measure(t, x, make_stops, 2)])
        np.savetxt(name, table, delimiter=",", header="t,displacement,force", comments="")
    assert run([*commands[0], "--model", "prandtl-ishlinskii"]) == 0
    assert run(commands[1]) == 0
    assert run(commands[2]) == 0
    assert capsys.readouterr().out.count("verdict: good") == 4
    assert "Masing" in (tmp_path / "damper.html").read_text(encoding="utf-8")
    # What the page shows of the code is C that compiles against it.
    (lines,) = re.findall(r"^```c\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    head = '#include "symid_damper_c.h"\n#include <stdio.h>\nint main(void)\n{\ndouble x = 0.3, y = 0.0;\n'
    tail = 'printf("%.3f %.3f %.3f\\n", x, y, energy);\nreturn 0;\n}\n'
    (tmp_path / "main.c").write_text(head + lines + tail)
    sources = [tmp_path / "main.c", tmp_path / "damper_c" / "symid_damper_c.c"]
    program = tmp_path / "program"
    command = [c_compiler, "-std=c99", "-I", tmp_path / "damper_c", *sources, "-o", program, "-lm"]
    subprocess.run(command, check=True)
    shown = subprocess.run([program], capture_output=True, text=True, check=True).stdout.split()
    expected = make_stops(np.zeros(2), np.array([0.0, 0.3]))[1]
    np.testing.assert_allclose(list(map(float, shown[:2])), [0.3, expected], atol=0.01)
    assert float(shown[2]) > 0.0
