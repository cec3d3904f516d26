"""The pages with scripts: they are those beside them, and print what the pages show."""

import os
import re
import shutil
from pathlib import Path

import pytest

import symid
from tests.simulations import share_simulations
from tests.transcripts import compare, list_scripts, run_scripts

PROJECT = Path(__file__).resolve().parents[2]
FOLDER = PROJECT / "docs" / "api"
SHORT = sorted(FOLDER.glob("[0-9]*.py"))
PAGES = {"scripts.md": SHORT, "optimal_control.md": [FOLDER / "optimal_control.py", FOLDER / "springs.py"]}
"""The scripts of every page, in its order."""
STEPS = [(script, page, number) for page, scripts in PAGES.items() for number, script in enumerate(scripts)]
MOST_LINES = 10
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def read_steps(page):
    return list_scripts((FOLDER / page).read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", PAGES)
def test_a_page_shows_its_scripts(page):
    assert [script for script, _ in read_steps(page)] == [path.read_text("utf-8") for path in PAGES[page]]
    assert len(PAGES[page]) == (FOLDER / page).read_text(encoding="utf-8").count("```python")


def test_there_are_twelve_short_ones():
    assert [int(path.name[:2]) for path in SHORT] == list(range(1, 13))
    # All that is written counts, the sentence at the head and the imports too; empty lines do not.
    for path in SHORT:
        lines = path.read_text(encoding="utf-8").splitlines()
        assert 0 < len([line for line in lines if line.strip()]) <= MOST_LINES, path


@pytest.fixture
def folder(tmp_path, c_compiler):
    """Return a folder with the files of the page on one's own robot."""
    assert c_compiler
    return shutil.copytree(PROJECT / "docs" / "own_robot", tmp_path / "work")


@pytest.mark.parametrize(("script", "page", "number"), STEPS, ids=[script.stem for script, *_ in STEPS])
def test_scripts_print_what_the_page_shows(script, page, number, folder, monkeypatch):
    share_simulations(monkeypatch)
    (printed,) = run_scripts([(script, folder)], Path(os.environ["XDG_CACHE_HOME"]))
    assert not compare(read_steps(page)[number][1], printed), printed


@pytest.mark.parametrize("page", ["README.md", "docs/api/index.md"])
def test_short_blocks_run(page, folder):
    draft = symid.new_robot(
        urdf=folder / "arm.urdf",
        log=folder / "training.csv",
        friction="coulomb-viscous-offset",
        rotors=True,
        torque_constant=[0.11, 0.11, 0.062],
    )
    draft.save(folder / "arm.toml")
    (block,) = BLOCK.findall((PROJECT / page).read_text(encoding="utf-8"))
    (folder / "block.py").write_text(block, encoding="utf-8")
    (found,) = run_scripts([(folder / "block.py", folder)], Path(os.environ["XDG_CACHE_HOME"]))
    assert "MXR2" in found
    assert (folder / "arm_identified.urdf").exists()


def test_a_wrong_page_is_found():
    assert compare("MX2 = 0.1738 kg m", "MX2 = 0.2138 kg m")
    assert compare("accepted", "refused")
    assert not compare("MX2 = 0.1738 kg m", "MX2 = 0.1739 kg m")
