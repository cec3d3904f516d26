"""The self-test of a folder that symid generated, run in a copy of it.

Input: a folder. Output: `SelfTestRun`: how the test went, by whom it was run, what was compiled for it.
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from symid.cli.output import Console
from symid.errors import GenerationError, Notice

if TYPE_CHECKING:  # a usage error must not wait for these
    from symid.codegen.code_size import CodeSize
    from symid.codegen.compiler import Compiler

__all__ = ["SelfTestRun", "find_runner", "find_warnings", "run_selftest"]

_TIMEOUT = 600.0
_FLAGS = "-O2"


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfTestRun:
    """How the self-test of a folder went: "passed" or "not run".

    Attributes:
        selftest: how.
        runner: the version of what ran it, empty if nothing did.
        flags: of the compiler.
        sizes: of the functions as they were compiled, where known.
    """

    selftest: str
    runner: str
    flags: str
    sizes: "Mapping[str, CodeSize]"


def find_runner(target: str) -> tuple["Compiler | None", str]:
    """Return the compiler, and what runs the self-test: its version or that of Python; empty for nothing."""
    if target == "python":
        from importlib.metadata import version

        return None, f"Python {platform.python_version()}, NumPy {version('numpy')}"
    from symid.codegen.compiler import find_compiler

    compiler = find_compiler()
    return compiler, compiler.version if compiler is not None and shutil.which("make") else ""


def find_warnings(folder: Path, selftest: str) -> tuple[Notice, ...]:
    """Return what a user must know of a folder whose self-test was not run."""
    if selftest == "passed":
        return ()
    text = "its self-test was not run: no C compiler or no make; install them, then `make check` there"
    return (Notice(code="generate.selftest-not-run", text=text, file=str(folder)),)


def _run(folder: Path, arguments: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        arguments, cwd=folder, capture_output=True, text=True, check=False, timeout=_TIMEOUT
    )


def _run_make(folder: Path, compiler: "Compiler") -> tuple[list[str], subprocess.CompletedProcess[str]]:
    """Compile and run the self-test, with the stack of every function if the compiler can tell it."""
    from symid.codegen.code_size import STACK_FLAG

    command = ["make", f"-j{os.cpu_count() or 1}", "check", f"CC={compiler.path}"]
    done = _run(folder, [*command, f"CFLAGS={_FLAGS} {STACK_FLAG}"])
    # A compiler that does not know the flag fails, and so does wrong code: then once more.
    return (command, _run(folder, command)) if done.returncode else (command, done)


def run_selftest(folder: Path, target: str, console: Console) -> SelfTestRun:
    """Run the folder's own test in a copy of it and return how it went.

    Raises:
        GenerationError: the test failed.
    """
    from symid.codegen.build_record import find_operations
    from symid.codegen.code_size import find_code_sizes
    from symid.codegen.writer import read_manifest

    compiler, runner = find_runner(target)
    if not runner:
        return SelfTestRun(selftest="not run", runner="", flags="", sizes={})
    console.progress("running the self-test of the folder")
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        copy = shutil.copytree(folder, Path(scratch) / "code")
        if compiler is None:
            (module,) = folder.glob("*.py")
            arguments = [sys.executable, module.name]
            done = _run(copy, arguments)
        else:
            arguments, done = _run_make(copy, compiler)
        console.detail(done.stdout)
        if done.returncode:
            text = f"the self-test failed: {' '.join(arguments)}\n{done.stdout}{done.stderr}".rstrip()
            raise GenerationError(Notice(code="generate.selftest-failed", text=text, file=str(folder)))
        manifest = read_manifest(folder) or {}
        prefix, names = str(manifest.get("prefix")), tuple(find_operations(manifest))
        sizes = {} if compiler is None else find_code_sizes(copy, prefix, names)
    return SelfTestRun(selftest="passed", runner=runner, flags=_FLAGS if compiler else "", sizes=sizes)
