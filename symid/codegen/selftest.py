"""The self-test of a folder that symid generated, run in a copy of what its manifest lists.

Input: a folder. Output: `SelfTestRun`: how the test went, by whom it was run, what was compiled for it.

A test counts as passed where the program itself ran, ended with zero and said so in its last line; what
`make` says of its own run proves nothing, as variables of the environment can keep it from doing anything.

Supported: all targets. Not supported: files of others in the folder; they take no part.
"""

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from symid.errors import GenerationError, Notice

if TYPE_CHECKING:  # a usage error must not wait for these
    from symid.codegen.code_size import CodeSize
    from symid.codegen.compiler import Compiler

__all__ = ["SelfTestRun", "find_runner", "find_warnings", "run_selftest"]

_TIMEOUT = 600.0
_FLAGS = "-O2"
# What an outer `make` was told is not meant for this one: it may build nothing, or look over all errors.
_MAKE_VARIABLES = frozenset({"MAKEFLAGS", "MFLAGS", "GNUMAKEFLAGS", "MAKELEVEL", "MAKEFILES"})
_PASSED = re.compile(r"0 of [1-9][0-9]* functions failed")


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfTestRun:
    """How the self-test of a folder went: "passed" or "not run".

    Attributes:
        selftest: how.
        runner: the version of what ran it, empty if nothing did.
        flags: of the compiler.
        sizes: of the functions as they were compiled, where known.
        printed: what the test printed.
    """

    selftest: str
    runner: str
    flags: str
    sizes: "Mapping[str, CodeSize]"
    printed: str = ""


def find_runner(target: str) -> tuple["Compiler | None", str]:
    """Return the compiler, and what runs the self-test: its version or that of Python; empty for nothing."""
    if target == "python":
        from importlib.metadata import version

        return None, f"Python {platform.python_version()}, NumPy {version('numpy')}"
    from symid.codegen.compiler import find_compiler

    compiler = find_compiler()
    built_by = compiler.version if compiler is not None and shutil.which("make") else ""
    if target == "casadi":
        from importlib.metadata import version

        # Without a compiler the .casadi files are tested all the same.
        runners = (f"CasADi {version('casadi')}", built_by)
        return compiler if built_by else None, ", ".join(filter(None, runners))
    return compiler, built_by


def find_warnings(folder: Path, selftest: str) -> tuple[Notice, ...]:
    """Return what a user must know of a folder whose self-test was not run."""
    if selftest == "passed":
        return ()
    text = "its self-test was not run: no C compiler or no make; install them, then `make check` there"
    return (Notice(code="generate.selftest-not-run", text=text, file=str(folder)),)


def _fail(folder: Path, text: str) -> NoReturn:
    raise GenerationError(Notice(code="generate.selftest-failed", text=text, file=str(folder)))


def _copy_listed(folder: Path, manifest: Mapping[str, object], copy: Path) -> None:
    """Copy the files that `manifest` lists, and no others: a folder may hold anything of its owner's."""
    from symid.codegen.writer import find_digest, find_listed

    copy.mkdir()
    for path, digest in find_listed(manifest).items():
        try:
            content = (folder / path).read_bytes()
        except OSError as error:
            _fail(folder, f"the self-test could not be run: {path}: {error.strerror or error}")
        if find_digest(content) != digest:
            _fail(folder, f"the self-test could not be run: {path} was changed since it was written")
        target = copy / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)


def _run(folder: Path, copy: Path, command: list[str]) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name not in _MAKE_VARIABLES}
    try:
        return subprocess.run(
            command,
            cwd=copy,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=_TIMEOUT,
        )
    except subprocess.TimeoutExpired:
        _fail(folder, f"the self-test failed: `{' '.join(command)}` did not end within {_TIMEOUT:g} s")
    except OSError as error:
        _fail(folder, f"the self-test failed: `{' '.join(command)}` cannot be run: {error.strerror or error}")


def _fail_run(folder: Path, done: subprocess.CompletedProcess[str]) -> NoReturn:
    how = f"the self-test failed: `{' '.join(done.args)}` ended with {done.returncode}"
    _fail(folder, f"{how}\n{done.stdout}{done.stderr}".rstrip())


def _build(folder: Path, copy: Path, compiler: "Compiler", goal: str) -> None:
    """Make `goal`, with the stack of every function if the compiler can tell it."""
    from symid.codegen.code_size import STACK_FLAG

    command = ["make", f"-j{os.cpu_count() or 1}", goal, f"CC={compiler.path}"]
    done = _run(folder, copy, [*command, f"CFLAGS={_FLAGS} {STACK_FLAG}"])
    # A compiler that does not know the flag fails, and so does wrong code: then once more.
    if done.returncode:
        done = _run(folder, copy, command)
    if done.returncode:
        _fail_run(folder, done)


def run_selftest(folder: Path, target: str, progress: Callable[[str], None]) -> SelfTestRun:
    """Run the folder's own test in a copy of it and return how it went.

    Args:
        folder: as `write_sources` wrote it.
        target: its language.
        progress: told what begins.

    Raises:
        GenerationError: the test failed, or did not run to its end.
    """
    from symid.codegen.build_record import find_operations
    from symid.codegen.code_size import find_code_sizes
    from symid.codegen.writer import read_manifest

    compiler, runner = find_runner(target)
    if not runner:
        return SelfTestRun(selftest="not run", runner="", flags="", sizes={})
    progress("running the self-test of the folder")
    manifest = read_manifest(folder) or {}
    prefix, names = str(manifest.get("prefix")), tuple(find_operations(manifest))
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        copy = Path(scratch) / "code"
        _copy_listed(folder, manifest, copy)
        if compiler is not None:
            _build(folder, copy, compiler, "shared" if target == "casadi" else "selftest")
        command = {
            "python": [sys.executable, f"{prefix}.py"],
            "casadi": [sys.executable, f"{prefix}_casadi.py"],
        }.get(target, [str(copy / "selftest")])
        done = _run(folder, copy, command)
        if done.returncode or not _PASSED.fullmatch(done.stdout.rstrip("\n").rpartition("\n")[2]):
            _fail_run(folder, done)
        sizes = find_code_sizes(copy, prefix, names) if target == "c" else {}
    return SelfTestRun(selftest="passed", runner=runner, flags=_FLAGS if compiler else "", sizes=sizes)
