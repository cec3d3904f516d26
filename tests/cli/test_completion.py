"""Completion in shells: what click's scripts of bash, zsh and fish ask the command, and what they get."""

import os
import subprocess
import sys

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


def test_help_imports_nothing_heavy():
    found, heavy = ask("--help")
    assert "identify" in found
    assert heavy == "[]"
