"""Completion in shells: what click's scripts of bash, zsh and fish ask the command, and what they get."""

import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.shell_completion import BashComplete

from symid.cli.call import symid

ASK = (
    "import sys\n"
    "from symid.cli.main import run\n"
    "try:\n"
    "    run(sys.argv[1:])\n"
    "finally:\n"
    "    print(sorted({'sympy', 'casadi', 'scipy'} & sys.modules.keys()), file=sys.stderr)\n"
)


def ask(*arguments, **environment):
    """Run the command in a process of its own; return stdout, and which heavy packages were imported."""
    done = subprocess.run(
        [sys.executable, "-c", ASK, *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout, done.stderr.strip()


def complete(words):
    *before, last = words.split(" ")
    found = BashComplete(symid, {}, "symid", "_SYMID_COMPLETE").get_completions(before, last)
    return [(entry.type, entry.value) for entry in found]


def test_verbs_robots_options_choices_and_files_are_completed():
    assert complete("ide") == [("plain", "identify")]
    assert complete("identify two_link_e") == [("file", "two_link_e"), ("plain", "two_link_elastic")]
    assert complete("identify two_link --estim") == [("plain", "--estimator")]
    assert complete("identify two_link --rows mo") == [("plain", "momentum")]
    assert complete("report --robot puma560_") == [("file", "puma560_"), ("plain", "puma560_elastic")]
    assert complete("report est") == [("file", "est")]


def test_a_shell_gets_them_without_anything_heavy():
    words = {"COMP_WORDS": "symid identify two_link_e", "COMP_CWORD": "2"}
    found = ask(_SYMID_COMPLETE="bash_complete", **words)
    assert found == ("file,two_link_e\nplain,two_link_elastic\n", "[]")
    script, heavy = ask(_SYMID_COMPLETE="fish_source")
    assert "_SYMID_COMPLETE=fish_complete" in script
    assert heavy == "[]"


class Terminal:
    """A shell that believes it has a terminal."""

    def __init__(self, program, folder):
        self.place, inner = pty.openpty()
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        self.process = subprocess.Popen(
            [program, "-f", "-i"],
            cwd=folder,
            env={**os.environ, "PATH": path, "TERM": "dumb", "HOME": str(folder)},
            stdin=inner,
            stdout=inner,
            stderr=inner,
            start_new_session=True,
        )
        os.close(inner)

    def type_until(self, typed, expected, seconds=120.0):
        """Type, and return what is shown until `expected` is there, or nothing more for so long."""
        os.write(self.place, typed.encode())
        shown, end = "", time.monotonic() + seconds
        while expected not in shown and time.monotonic() < end:
            if select.select([self.place], [], [], 0.5)[0]:
                shown += os.read(self.place, 65536).decode(errors="replace")
        return shown

    def close(self):
        """End the shell."""
        self.process.kill()
        self.process.wait()
        os.close(self.place)


def test_a_real_zsh_completes_with_the_line_of_the_page(tmp_path, project):
    program = shutil.which("zsh")
    if program is None:
        pytest.skip("wants zsh: apt-get install zsh")
    page = (project / "docs" / "command_line.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^\| zsh \| `~/.zshrc` \| `(.*)` \|$", page, re.MULTILINE)
    (tmp_path / "estimate.json").touch()
    shell = Terminal(program, tmp_path)
    try:
        said = shell.type_until(f"{line}\nprint REA''DY\n", "READY")
        assert "not found" not in said
        for typed, whole in (
            ("symid ide", "symid identify "),
            ("symid identify two_link_e", "two_link_elastic "),
            ("symid identify two_link --rows mo", "--rows momentum "),
            ("symid report est", "estimate.json "),
        ):
            assert whole in shell.type_until(f"{typed}\t", whole)
            os.write(shell.place, b"\x15")
    finally:
        shell.close()
