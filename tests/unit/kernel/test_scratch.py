"""Scratch files of processes that were killed go with the next run; those of others stay."""

import os
import resource
import subprocess
import sys
import time

import pytest

from symid import environment
from symid.environment import clear_scratch, make_scratch_folder, mark_scratch, write_file
from symid.errors import OutputError
from tests.refusals import raises


@pytest.fixture
def dead():
    """Return the number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_only_what_dead_processes_of_this_machine_left_is_removed(tmp_path, dead):
    machine = environment._mark_machine()
    names = [
        *(f"x-{machine}-{dead}-a", f"x-{machine}-{dead}-b"),
        *(
            f"x-{machine}-{os.getpid()}-a",
            f"x-{machine}-word-a",
            f"x-00000000-{dead}-a",
            f"y-{machine}-{dead}-a",
        ),
    ]
    for name in names:
        (tmp_path / name).mkdir()
    (tmp_path / names[1] / "file").write_text("")
    (tmp_path / "target").mkdir()
    (tmp_path / "target" / "kept").write_text("")
    (tmp_path / f"x-{machine}-{dead}-link").symlink_to(tmp_path / "target")
    clear_scratch(tmp_path, "x-")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*names[2:], "target"])
    assert (tmp_path / "target" / "kept").exists()
    clear_scratch(tmp_path / "none", "x-")


def test_a_folder_of_scratch_is_marked_and_goes(tmp_path, monkeypatch, dead):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    left = tmp_path / mark_scratch("symid-").replace(f"-{os.getpid()}-", f"-{dead}-")
    left.mkdir()
    with make_scratch_folder() as folder:
        assert folder.parent == tmp_path
        assert folder.name.startswith(mark_scratch("symid-"))
        assert [path.name for path in tmp_path.iterdir()] == [folder.name]
    assert list(tmp_path.iterdir()) == []


def test_a_writer_that_is_killed_leaves_nothing_after_the_next(tmp_path, project):
    script = f"""
import sys, time
from pathlib import Path
from symid.environment import write_file
def write(stream):
    stream.write(b"half")
    stream.flush()
    Path({str(tmp_path / "begun")!r}).write_text("x")
    time.sleep(100)
write_file(Path({str(tmp_path / "out" / "fit.json")!r}), write)
"""
    (tmp_path / "out").mkdir()
    process = subprocess.Popen([sys.executable, "-c", script], cwd=project)
    for _ in range(600):
        if (tmp_path / "begun").exists():
            break
        time.sleep(0.05)
    process.kill()
    process.wait()
    assert len(list((tmp_path / "out").iterdir())) == 1
    write_file(tmp_path / "out" / "fit.json", "whole")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["fit.json"]


@pytest.fixture
def small_place(tmp_path):
    """Return a folder in which no file can be longer than 64 kB."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (65536, before[1]))
    yield tmp_path
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_file_that_has_no_room_leaves_the_old_one_and_no_scratch(small_place):
    path = write_file(small_place / "fit.json", "old")
    with raises(OutputError, "output.write", match="File too large"):
        write_file(path, "x" * 10**6)
    assert [entry.name for entry in small_place.iterdir()] == ["fit.json"]
    assert path.read_text() == "old"
