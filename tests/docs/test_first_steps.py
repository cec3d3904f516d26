"""The first steps from an empty folder: commands run, and print what the pages say."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import symid
from tests.transcripts import compare, list_steps, run_step

PROJECT = Path(__file__).resolve().parents[2]
FILES = PROJECT / "docs" / "first_steps"


def read(name):
    return (PROJECT / "docs" / f"{name}.md").read_text(encoding="utf-8")


@pytest.fixture
def folder(tmp_path):
    shutil.copytree(FILES, tmp_path / "work")
    return tmp_path / "work"


def check(page, folder):
    for command, answer in list_steps(page):
        code, printed = run_step(command, folder, Path(os.environ["XDG_CACHE_HOME"]))
        assert code == 0, printed
        assert not compare(answer, printed), printed


def test_the_first_code_computes_torques(folder, c_compiler):
    page = read("first_code")
    check(page, folder)
    assert (FILES / "main.c").read_text() in page
    assert (FILES / "lever.csv").read_text() in page
    for command in re.findall(r"^symid (?:generate|export) .*$", page, re.MULTILINE):
        code, printed = run_step(command, folder, Path(os.environ["XDG_CACHE_HOME"]))
        assert code == 0, printed
    (build,) = re.findall(r"^cc (.*)$", page, re.MULTILINE)
    subprocess.run(f"{c_compiler} {build}", cwd=folder, shell=True, check=True)  # noqa: S602  as typed
    done = subprocess.run(["./main"], cwd=folder, capture_output=True, text=True, check=True)
    assert f"`{done.stdout.strip()}`" in page


def test_the_first_fit_finds_the_rig(folder, c_compiler):
    assert c_compiler
    check(read("first_fit"), folder)
    fit = symid.load_fit(folder / "fit.json")
    for name, truth in (("MX1", 0.92 * 0.118), ("Fv1", 0.021), ("Fc1", 0.065)):
        assert abs(fit[name].value - truth) < 3.0 * fit[name].std
    assert "Does it predict motions that it was not fitted to?" in (folder / "fit.html").read_text()
