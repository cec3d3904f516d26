"""Compilers that hang, and calls that are ended while one works: nothing waits, nothing stays."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from symid.codegen import compiler as module
from symid.codegen.compiler import Compiler, compile_sources, locate_compiler
from symid.errors import GenerationError
from tests.builds import write_program

HANG = """[ "$1" = --version ] && echo cc 1 && exit 0
: > "${{TMPDIR:-/tmp}}/stage.s"
sleep 100 & echo $! > {}/pid; wait
exit 1"""
"""A compiler that answers --version only; it works by another process and files in between, as GCC does."""


def is_there(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def test_a_compiler_that_hangs_ends_with_its_children(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_LEAST_TIME", 1.0)
    path = write_program(tmp_path / "bin" / "cc", HANG.format(tmp_path))
    source = tmp_path / "a.c"
    source.write_text("int a;")
    start = time.monotonic()
    with pytest.raises(GenerationError, match=r"timed out after 1\.\d* seconds"):
        compile_sources(Compiler(path=str(path), version="1"), [source], tmp_path / "a.so")
    assert time.monotonic() - start < 50.0
    assert not is_there((tmp_path / "pid").read_text().strip())


def test_a_compiler_that_never_answers_is_not_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_LEAST_TIME", 0.5)
    assert locate_compiler(str(write_program(tmp_path / "cc", "sleep 100"))) is None


@pytest.fixture
def interruptible():
    """Have processes hear SIGINT, which those that a shell has put into the background do not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_call_that_is_ended_ends_its_compiler_and_leaves_no_scratch(tmp_path, project, number):
    path = write_program(tmp_path / "bin" / "cc", HANG.format(tmp_path))
    (tmp_path / "tmp").mkdir()
    environment = os.environ | {
        "PATH": f"{path.parent}:/usr/bin:/bin",
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "TMPDIR": str(tmp_path / "tmp"),
        "PYTHONPATH": str(project),
    }
    command = [sys.executable, "-m", "symid", "simulate", "two_link", "-o", "log.npz"]
    process = subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    for _ in range(1000):
        if (tmp_path / "pid").exists() and (tmp_path / "pid").read_text():
            break
        time.sleep(0.05)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "error: interrupted"
    assert not is_there((tmp_path / "pid").read_text().strip())
    assert list((tmp_path / "tmp").iterdir()) == []
    assert [entry for entry in tmp_path.rglob(".*") if entry.name not in {".", ".."}] == []
