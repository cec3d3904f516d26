"""How the process of a call ends: with too little memory, by a signal while C works, by a crash."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from symid.environment import require_memory
from tests.calls import call, fail

WORK = """import os, sys, symid.cli.main as main
def run(arguments):
    import numpy as np
    from symid.environment import make_scratch_folder
    with make_scratch_folder():
        print("begins", file=sys.stderr, flush=True)
        {}
main.run = run
# A test run in the background of a shell ignores Ctrl-C, and its children would too.
main.signal.signal(main.signal.SIGINT, main.signal.default_int_handler)
main.main()
"""
LAPACK = "np.linalg.eig(np.random.default_rng(1).random((2500, 2500)))"
"""A quarter of a minute in one call of LAPACK, which hears nothing."""


def start(project, folder, *command, megabytes="unlimited"):
    """Start Python with a limit of its address space, and scratch in `folder`."""
    limited = f'ulimit -v {megabytes if isinstance(megabytes, str) else megabytes << 10}; exec "$@"'
    return subprocess.Popen(
        ["/bin/sh", "-c", limited, "sh", sys.executable, *map(str, command)],
        env=os.environ | {"PYTHONPATH": str(project), "TMPDIR": str(folder)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize("megabytes", [170, 250, 330])
def test_too_little_memory_is_one_sentence(tmp_path, project, megabytes):
    command = ("-m", "symid", "generate", "two_link", "-o", tmp_path / "code", "-q")
    process = start(project, tmp_path, *command, megabytes=megabytes)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (5, ""), err
    assert re.match(f"error: (probably )?too little memory: ulimit -v allows {megabytes} MB of address", err)
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_linear_algebra_has_its_memory_before_it_runs_out(tmp_path, project):
    program = """import resource, numpy as np
from scipy import linalg
from symid.environment import secure_linear_algebra
matrix = np.random.default_rng(1).random((200, 200))
secure_linear_algebra()
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 8_000_000, used + 8_000_000))
print(np.abs(linalg.qr(matrix)[0]).max() <= 1.0 and np.abs(np.linalg.qr(matrix)[0]).max() <= 1.0)
"""
    out, err = start(project, tmp_path, "-c", program).communicate(timeout=60)
    assert out == "True\n", err


def test_memory_that_nobody_has_is_refused(monkeypatch):
    with pytest.raises(MemoryError, match="MB more are needed"):
        require_memory(1 << 40)

    def raise_it(*_args, **_options):
        raise MemoryError

    monkeypatch.setattr("symid.robot.loading.load_robot", raise_it)
    assert fail("check", "two_link") == (5, "symid.memory")
    _, _, err = call("check", "two_link")
    assert err.startswith("error: memory ran out")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_lapack_works_is_obeyed_at_once(tmp_path, project, number):
    process = start(project, tmp_path, "-c", WORK.format(LAPACK))
    assert process.stderr.readline() == "begins\n"
    time.sleep(0.5)
    began = time.monotonic()
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert time.monotonic() - began < 4.0
    assert (process.returncode, err) == (130, "error: interrupted\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("ending", "megabytes", "expected"),
    [
        (
            "os.abort()",
            "unlimited",
            (70, "error: this is a bug in symid, not in your files: ended by SIGABRT"),
        ),
        ("os.abort()", 500, (5, "error: probably too little memory: ulimit -v allows 500 MB")),
        # As OpenBLAS does; 1 would be the code of a wrong verdict.
        ("os._exit(1)", 500, (5, "error: probably too little memory: ulimit -v allows 500 MB")),
        ("os.kill(os.getpid(), 9)", "unlimited", (5, "error: memory ran out (ended by SIGKILL)")),
    ],
)
def test_a_crash_in_c_is_one_sentence(tmp_path, project, ending, megabytes, expected):
    process = start(project, tmp_path, "-c", WORK.format(ending), megabytes=megabytes)
    _, err = process.communicate(timeout=60)
    assert process.returncode == expected[0]
    assert err.startswith(f"begins\n{expected[1]}")
    assert len(err.splitlines()) == 2
    assert list(tmp_path.iterdir()) == []


def test_the_work_ends_with_its_parent(tmp_path, project):
    process = start(project, tmp_path, "-c", WORK.format(f"print(os.getpid(), flush=True); {LAPACK}"))
    worker = int(process.stdout.readline())
    process.kill()
    process.communicate()
    for _ in range(100):
        # Nobody may be there to collect it.
        stat = Path(f"/proc/{worker}/stat")
        if not stat.exists() or stat.read_text().split()[2] == "Z":
            return
        time.sleep(0.05)
    pytest.fail("the worker lives on")
