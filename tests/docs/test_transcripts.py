"""Pages that are transcripts: commands and scripts run from the files beside them, print what they say."""

import importlib.metadata
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import symid
from symid.cli.main import run
from tests.hysteresis_truths import make_input, make_stops, measure
from tests.pages import DOCS
from tests.transcripts import BLOCK, compare, run_scripts, run_step

CACHE = Path(os.environ["XDG_CACHE_HOME"])


def read(page):
    return (DOCS / page).read_text(encoding="utf-8")


def retrace(page, scratch, files=None):
    """Run the blocks of a page in a folder with its files; return the folder, and what each block prints."""
    folder, printed = scratch / "work", []
    shutil.copytree(DOCS / files, folder) if files else folder.mkdir()
    for number, block in enumerate(BLOCK.finditer(read(page))):
        if block["command"]:
            code, found = run_step(block["command"], folder, CACHE)
            # One answer of the student is wrong.
            assert code == int("--check" in block["command"]), found
        else:
            (scratch / f"{number}.py").write_text(block["script"], encoding="utf-8")
            (found,) = run_scripts([(scratch / f"{number}.py", folder)], CACHE)
        assert not compare(block["answer"], found), found
        printed.append(found)
    assert printed
    return folder, printed


def test_first_code_computes_torques(tmp_path, c_compiler):
    folder, _ = retrace("first_code.md", tmp_path, "first_steps")
    page = read("first_code.md")
    assert (folder / "main.c").read_text() in page
    assert (folder / "lever.csv").read_text() in page
    for command in re.findall(r"^symid (?:generate|export) .*$", page, re.MULTILINE):
        code, printed = run_step(command, folder, CACHE)
        assert code == 0, printed
    (build,) = re.findall(r"^cc (.*)$", page, re.MULTILINE)
    subprocess.run(f"{c_compiler} {build}", cwd=folder, shell=True, check=True)  # noqa: S602  as typed
    done = subprocess.run(["./main"], cwd=folder, capture_output=True, text=True, check=True)
    assert f"`{done.stdout.strip()}`" in page


@pytest.mark.usefixtures("c_compiler")
def test_first_fit_finds_the_rig(tmp_path):
    folder, _ = retrace("first_fit.md", tmp_path, "first_steps")
    fit = symid.load_fit(folder / "fit.json")
    for name, truth in (("MX1", 0.92 * 0.118), ("Fv1", 0.021), ("Fc1", 0.065)):
        assert abs(fit[name].value - truth) < 3.0 * fit[name].std
    assert "Does it predict motions that it was not fitted to?" in (folder / "fit.html").read_text()


def test_the_first_lecture(tmp_path):
    folder, printed = retrace("first_lecture.md", tmp_path, "first_lecture")
    assert len(printed) == 5
    assert {"lesson.html", "three_link.html"} <= {path.name for path in folder.iterdir()}
    sheet, filled = (
        [line.partition(" =")[0] for line in (folder / name).read_text("utf-8").splitlines()]
        for name in ("lesson.exercises.txt", "student.txt")
    )
    assert filled == sheet
    assert f"```toml\n{(folder / 'three_link.toml').read_text('utf-8')}```" in read("first_lecture.md")


@pytest.mark.usefixtures("c_compiler")
def test_elastic_joints(tmp_path):
    retrace("elastic.md", tmp_path)


@pytest.mark.usefixtures("c_compiler")
def test_from_urdf_to_urdf(tmp_path):
    pytest.importorskip("pinocchio")
    try:
        importlib.metadata.version("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("example-robot-data is not installed")
    _, printed = retrace("round_trip.md", tmp_path, "round_trip")
    assert len(printed) == 8
    before, after = (
        np.array(re.findall(r"\d+\.\d*", line.partition("[")[2]), dtype=float)
        for line in re.sub(r"\n +", " ", printed[-1]).splitlines()
    )
    assert len(before) == len(after) == 6
    assert all(after < 0.3 * before)


TRUTHS = {"Fc4": 0.3, "Fe4": 0.15, "vs4": 0.3, "g_x": 1.7035, "g_y": 0.0, "g_z": -9.661}
"""Of `docs/questions/rig.toml`, and of the page on gravity."""


@pytest.mark.usefixtures("c_compiler")
@pytest.mark.parametrize(("page", "names"), [("bad_wrist", 3), ("gravity", 3), ("short_log", 0)])
def test_answers_to_questions(page, names, tmp_path):
    _, (printed,) = retrace(f"{page}.md", tmp_path, "questions")
    last = re.findall(r"(\w+) = (-?[\d.]+) \+- ([\d.]+)", printed)[-4:]
    found = [(name, float(value), float(std)) for name, value, std in last if name in TRUTHS]
    assert len(found) == names
    assert all(abs(value - TRUTHS[name]) < 4.0 * std for name, value, std in found)


def test_hysteresis_from_a_file_to_c_code(tmp_path, monkeypatch, capsys, c_compiler):
    folder, _ = retrace("hysteresis.md", tmp_path)
    page = read("hysteresis.md")
    commands = [line.split() for line in re.findall(r"^symid (hysteresis .*)$", page, re.MULTILINE)]
    assert len(commands) == 3
    monkeypatch.chdir(folder)
    for name, amplitude in (("damper.csv", 1.0), ("larger.csv", 1.2)):
        t, x = make_input(1, amplitude, 1200)
        table = np.column_stack([t, *measure(t, x, make_stops, 2)])
        np.savetxt(name, table, delimiter=",", header="t,displacement,force", comments="")
    for command in ([*commands[0], "--model", "prandtl-ishlinskii"], *commands[1:]):
        assert run(command) == 0
    assert capsys.readouterr().out.count("verdict: good") == 3
    assert "Masing" in (folder / "damper.html").read_text(encoding="utf-8")
    # What the page shows of the code is C that compiles against it.
    (lines,) = re.findall(r"^```c\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    head = '#include "symid_damper_c.h"\n#include <stdio.h>\nint main(void)\n{\ndouble x = 0.3, y = 0.0;\n'
    tail = 'printf("%.3f %.3f %.3f\\n", x, y, energy);\nreturn 0;\n}\n'
    (folder / "main.c").write_text(head + lines + tail)
    sources = ["main.c", "damper_c/symid_damper_c.c"]
    subprocess.run([c_compiler, "-std=c99", "-Idamper_c", *sources, "-o", "program", "-lm"], check=True)
    shown = subprocess.run(["./program"], capture_output=True, text=True, check=True).stdout.split()
    expected = make_stops(np.zeros(2), np.array([0.0, 0.3]))[1]
    np.testing.assert_allclose(list(map(float, shown[:2])), [0.3, expected], atol=0.01)
    assert float(shown[2]) > 0.0


def test_files_of_the_round_trip_are_small_and_all_there():
    files = list((DOCS / "round_trip").iterdir())
    assert sorted(path.name for path in files) == ["training.csv", "validation.csv"]
    assert sum(path.stat().st_size for path in files) < 300_000
