"""The page on the way from URDF to URDF: its commands and scripts run, and print what it says."""

import importlib.metadata
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.transcripts import BLOCK, compare, run_python, run_step

PROJECT = Path(__file__).resolve().parents[2]
FILES = PROJECT / "docs" / "round_trip"


@pytest.fixture(scope="module")
def blocks():
    page = (PROJECT / "docs" / "round_trip.md").read_text(encoding="utf-8")
    return list(BLOCK.finditer(page))


@pytest.fixture(scope="module")
def printed(blocks, tmp_path_factory, c_compiler):
    """Run all blocks in their order and return what each prints."""
    assert c_compiler
    pytest.importorskip("pinocchio")
    try:
        importlib.metadata.version("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("example-robot-data is not installed")
    folder, cache = tmp_path_factory.mktemp("round-trip") / "work", Path(os.environ["XDG_CACHE_HOME"])
    shutil.copytree(FILES, folder)
    found = []
    for block in blocks:
        command = block["command"]
        code, text = (
            run_step(command, folder, cache)
            if command
            else run_python(["-c", block["script"]], folder, cache)
        )
        assert code == 0, text
        found.append(text)
    return found


def test_the_page_shows_what_is_printed(blocks, printed):
    assert len(blocks) == 8
    for block, found in zip(blocks, printed, strict=True):
        assert not compare(block["answer"], found), found


def test_the_identified_file_explains_the_torques(printed):
    before, after = (
        np.array(re.findall(r"\d+\.\d*", line.partition("[")[2]), dtype=float)
        for line in re.sub(r"\n +", " ", printed[-1]).splitlines()
    )
    assert len(before) == len(after) == 6
    assert all(after < 0.3 * before)


def test_files_are_small_and_all_there():
    files = list(FILES.iterdir())
    assert sorted(path.name for path in files) == ["training.csv", "validation.csv"]
    assert sum(path.stat().st_size for path in files) < 300_000
