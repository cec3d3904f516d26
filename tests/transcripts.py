"""Pages whose commands and answers are a transcript: run again, compared, and written anew.

A block ```sh holds one command, or a block ```python a script; the block ```text right behind it all that it
prints. Run with the page, the folder of its files, and its scripts in their order, this module
writes the scripts and the answers of this machine into the page; a page without files of its own for
its scripts is its own source:

    PYTHONPATH=. python tests/transcripts.py docs/own_robot.md docs/own_robot
    PYTHONPATH=. python tests/transcripts.py docs/round_trip.md docs/round_trip
    PYTHONPATH=. python tests/transcripts.py docs/api/scripts.md docs/own_robot docs/api/[0-9]*.py
"""

import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from symid.cli.main import run

BLOCK = re.compile(
    r"^```(?:sh\n(?P<command>[^\n]*)\n|python\n(?P<script>(?:(?!```)[^\n]*\n)*))"
    r"```\n\n```text\n(?P<answer>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.]*\w)")
LONGEST = 300


def list_steps(page: str) -> list[tuple[str, str]]:
    """Return commands and their answers."""
    return [(step["command"], step["answer"]) for step in BLOCK.finditer(page) if step["command"]]


def list_scripts(page: str) -> list[tuple[str, str]]:
    """Return scripts and their answers."""
    return [(step["script"], step["answer"]) for step in BLOCK.finditer(page) if step["script"]]


def run_step(command: str, folder: Path, cache: Path) -> tuple[int, str]:
    """Return the exit code of a command, and all that it prints, in the order of a terminal."""
    first, *arguments = shlex.split(command)
    assert first == "symid"
    with _work_in(folder, cache) as printed:
        code = run(arguments)
    return code, printed.getvalue()


@contextmanager
def _work_in(folder: Path, cache: Path) -> Iterator[StringIO]:
    """Give what is printed in a folder, with a cache of its own and without colours."""
    before, printed = dict(os.environ), StringIO()
    os.environ |= {"XDG_CACHE_HOME": str(cache), "NO_COLOR": "1"}
    try:
        with chdir(folder), redirect_stdout(printed), redirect_stderr(printed):
            yield printed
    finally:
        os.environ.clear()
        os.environ.update(before)


def run_python(arguments: list[str], folder: Path, cache: Path) -> tuple[int, str]:
    """Return the exit code of Python with `arguments`, and all that it prints, in the order of a terminal."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache), "PYTHONUNBUFFERED": "1", "NO_COLOR": "1"}
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=LONGEST,
    )
    return done.returncode, done.stdout


def run_scripts(scripts: list[tuple[Path, Path]], cache: Path) -> list[str]:
    """Run scripts in this process, each in its folder as a `__main__` of its own; return what each prints."""
    found = []
    for script, folder in scripts:
        with _work_in(folder, cache) as printed:
            runpy.run_path(str(script), run_name="__main__")
        found.append(printed.getvalue())
    return found


def compare(said: str, found: str) -> list[str]:
    """Return what differs: words at all, numbers by more than one in the last digit that the page prints.

    Or by more than `_SLACK` of a number: simulated joints that stick amplify the last bit of a sum, in which
    processors differ, to a part of the noise.
    """
    differences = []
    lines, others = _list_lines(said), _list_lines(found)
    if len(lines) != len(others):
        differences.append(f"{len(lines)} lines in the page, {len(others)} printed")
    for line, other in zip(lines, others, strict=False):
        if NUMBER.sub("0", line) != NUMBER.sub("0", other) or not _agree(line, other):
            differences.append(f"- {line}\n+ {other}")
    return differences


def _list_lines(text: str) -> list[str]:
    """Return lines without what depends on the machine: the compiler's path, the widths of columns."""
    lines = (re.sub(r"^compiling with .*", "compiling", line) for line in text.strip().splitlines())
    return [re.sub(r"-{2,}", "--", re.sub(r" +", " ", line)).strip() for line in lines]


def _agree(line: str, other: str) -> bool:
    pairs = zip(NUMBER.findall(line), NUMBER.findall(other), strict=True)
    return all(abs(float(said) - float(found)) <= _find_step(said) for said, found in pairs)


def _find_step(number: str) -> float:
    """Return one in the last digit of a number; of more than eight digits the eighth counts."""
    mantissa, _, exponent = number.partition("e")
    places = len(mantissa.partition(".")[2])
    return 1.0001 * max(10.0 ** (int(exponent or 0) - places), _SLACK * abs(float(number)))


_SLACK = 0.15


def write_page(path: Path, files: Path, *scripts: Path) -> None:
    """Write what the commands and scripts of a page print now into the page."""
    page = path.read_text(encoding="utf-8")
    waiting = iter(scripts)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "work"
        shutil.copytree(files, folder)

        def answer(block: re.Match[str]) -> str:
            if block["command"]:
                _, found = run_step(block["command"], folder, Path(scratch) / "cache")
                found = re.sub(r"^compiling with .*", "compiling with /usr/bin/cc", found, flags=re.MULTILINE)
                return f"```sh\n{block['command']}\n```\n\n```text\n{found}```"
            script = next(waiting, None)
            arguments = [str(script.resolve())] if script else ["-c", block["script"]]
            code, found = run_python(arguments, folder, Path(scratch) / "cache")
            assert code == 0, found
            shown = script.read_text(encoding="utf-8") if script else block["script"]
            return f"```python\n{shown}```\n\n```text\n{found}```"

        page = BLOCK.sub(answer, page)
    path.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    write_page(*map(Path, sys.argv[1:]))
