"""The command line's contract: one JSON object, exit codes, no traceback, nothing on the wrong stream."""

import errno
import json
import os
import signal
import subprocess
import sys
import time

import click
import pytest

from symid import errors
from symid.cli.call import VERBS, symid
from tests.calls import ask, call, fail, hear, say

CODES = {
    errors.SymidError: 70,
    errors.UsageError: 2,
    errors.InputError: 3,
    errors.RobotError: 3,
    errors.LogError: 3,
    errors.EstimateError: 3,
    errors.OutputError: 3,
    errors.GenerationError: 70,
    errors.IdentifiabilityError: 4,
    errors.SolverError: 5,
}

FIVE_MISTAKES = """\
name = "wrong"
convention = "modified"
gravity = [0, 0, "down"]

[[joint]]
kind = "rotary"

[[joint]]
kind = "revolute"
alpah = 1.57
parent = "nobody"

[joint.drive]
gear = 100
rotor_inertia = 1e-5
"""


def fail_with(monkeypatch, error):
    """Make `symid check` raise `error`."""

    def raise_it(*_args, **_options):
        raise error

    monkeypatch.setattr("symid.robot.loading.load_robot", raise_it)


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_has_help_and_the_common_options(name):
    out = say(name, "--help")
    for option in ("--json", "--quiet", "--verbose"):
        assert option in out


def test_help_names_every_verb_with_its_first_line():
    out = say("--help")
    listed = "".join(out.split())
    for name in VERBS:
        first = symid.get_command(click.Context(symid), name).get_short_help_str(1000)
        assert name + "".join(first.split()).removesuffix(".") in listed


def test_version():
    out = say("--version")
    assert out.startswith("symid, version ")


@pytest.mark.parametrize("arguments", [("fly",), ("check", "--wings"), ("check",), ("generate", "panda")])
def test_usage_errors_exit_2_and_say_what_to_try(arguments):
    code, out, err = call(*arguments)
    assert (code, out) == (2, "")
    assert "--help" in err
    code, answer = ask(*arguments)
    assert code == 2
    assert answer["ok"] is False
    assert answer["errors"][0]["code"] == "usage.call"


def test_without_a_verb_the_verbs_are_named():
    assert call()[0] == 2
    assert fail() == (2, "usage.call")


def test_unknown_robot_gets_the_nearest_names():
    assert "panda" in hear(2, "usage.unknown-robot", "base", "pando")


def test_five_mistakes_are_said_at_once_each_with_its_place(tmp_path):
    path = tmp_path / "wrong.toml"
    path.write_text(FIVE_MISTAKES)
    code, answer = ask("check", path)
    assert code == 3
    lines = {error["line"] for error in answer["errors"]}
    assert lines >= {3, 6, 10, 11, 15}
    assert all(error["file"] == str(path) and error["column"] > 0 for error in answer["errors"])
    code, out, err = call("check", path)
    assert (code, out) == (3, "")
    assert f"{path}:6:" in err
    assert "Traceback" not in err


@pytest.mark.parametrize(("kind", "expected"), CODES.items())
def test_every_error_has_its_exit_code(monkeypatch, kind, expected):
    error = kind(errors.Notice(code="test.code", text="words", file="a.toml", line=3, column=4))
    with pytest.raises((errors.SymidError, errors.InputError, errors.OutputError, errors.SolverError)):
        raise error
    fail_with(monkeypatch, error)
    code, answer = ask("check", "two_link")
    assert code == expected
    assert answer["errors"] == [
        {"code": "test.code", "text": "words", "file": "a.toml", "line": 3, "column": 4}
    ]


def test_a_bug_is_told_without_a_traceback(monkeypatch):
    fail_with(monkeypatch, ZeroDivisionError("by zero"))
    code, out, err = call("check", "two_link")
    assert (code, out) == (70, "")
    assert "Traceback" not in err
    assert "ZeroDivisionError" in err
    assert fail("check", "two_link") == (70, "symid.bug")
    assert "Traceback" in call("check", "two_link", "-v")[2]


def test_an_interruption_exits_130(monkeypatch):
    fail_with(monkeypatch, KeyboardInterrupt())
    assert fail("check", "two_link") == (130, "symid.interrupted")


def test_ctrl_c_ends_a_running_process_with_130(project, tmp_path):
    # A test run in the background of a shell ignores the signal, and its children would too.
    start = "import signal, runpy; signal.signal(signal.SIGINT, signal.default_int_handler); "
    start += "runpy.run_module('symid', run_name='__main__')"
    command = [sys.executable, "-c", start, "simulate", "two_link", "--duration", "600"]
    environment = {**os.environ, "PYTHONPATH": str(project)}
    process = subprocess.Popen(
        [*command, "-o", str(tmp_path / "log.npz")],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    for line in process.stderr:
        if line.startswith("simulating"):
            break
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("value", "coloured"), [(None, True), ("", True), ("1", False)])
def test_no_color_is_honoured(monkeypatch, project, value, coloured):
    environment = {key: text for key, text in os.environ.items() if key != "NO_COLOR"}
    environment |= {"PYTHONPATH": str(project)} | ({} if value is None else {"NO_COLOR": value})
    reader, terminal = os.openpty()
    command = [sys.executable, "-m", "symid", "check", "nobody_here"]
    done = subprocess.run(command, env=environment, stdout=terminal, stderr=terminal, check=False)
    os.close(terminal)
    text = os.read(reader, 10_000)
    os.close(reader)
    assert done.returncode == 2
    assert b"error" in text
    assert b"nobody_here" in text
    assert (b"\x1b[" in text) is coloured


@pytest.mark.parametrize("ending", ["> /dev/full", ">&-"])
@pytest.mark.parametrize(
    "arguments", ["base two_link --json", "check two_link", "--help", "check nobody --json"]
)
def test_an_answer_that_cannot_be_written_exits_74_with_one_line(project, ending, arguments):
    environment = {**os.environ, "PYTHONPATH": str(project)}
    command = f"exec {sys.executable} -m symid {arguments} {ending}"
    done = subprocess.run(["sh", "-c", command], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 74, done.stderr
    said = [line for line in done.stderr.splitlines() if not line.startswith("deriving")]
    assert len(said) == 1
    assert said[0].startswith("error: ")
    assert os.strerror(errno.ENOSPC) in said[0] or ending == ">&-"


def test_ctrl_c_while_loading_exits_130(project):
    # An import of click that interrupts stands for a signal in that moment.
    start = "import sys, runpy\n"
    start += "class Find:\n def find_spec(self, name, *_):\n  if name == 'click': raise KeyboardInterrupt\n"
    start += "sys.meta_path.insert(0, Find())\nrunpy.run_module('symid', run_name='__main__')"
    environment = {**os.environ, "PYTHONPATH": str(project)}
    done = subprocess.run(
        [sys.executable, "-c", start], env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (130, "error: interrupted\n")


def test_quiet_says_nothing_but_the_result():
    code, out, err = call("base", "two_link", "-q")
    assert (code, err) == (0, "")
    assert "ZZR1" in out


def test_json_is_the_only_thing_on_stdout():
    out = say("check", "two_link", "--json")
    assert set(json.loads(out)) == {"ok", "result", "warnings"}


def test_a_setting_without_equals_sign_is_refused():
    assert fail("check", "two_link", "--set", "processing.drop_first") == (2, "usage.bad-setting")


def test_a_warm_identification_loads_neither_sympy_nor_casadi(log, estimate):
    """The library is in the cache after the first call; of its imports none is symbolic."""
    command = [sys.executable, "-X", "importtime", "-m", "symid", "identify", "two_link", str(log)]
    done = subprocess.run([*command, "--drop-first", "2000"], capture_output=True, text=True, check=False)
    loaded = {line.rsplit("|", 1)[-1].strip().split(".")[0] for line in done.stderr.splitlines()}
    assert estimate.exists()
    assert "verdict" in done.stdout
    assert {"symid", "numpy"} <= loaded
    assert not loaded & {"sympy", "casadi"}
