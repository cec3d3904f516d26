"""A C compiler, if the machine has one, and what it makes of generated sources.

Input: C files. Output: a shared library. On failure the message holds the command and what the
compiler said.

Supported: cc, gcc and clang, or one given by name. Arithmetic stays IEEE: no fast-math.
"""

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from symid.errors import GenerationError, Notice

__all__ = ["CANDIDATES", "FLAGS", "Compiler", "compile_sources", "find_compiler", "find_fault"]

FLAGS = ("-std=c99", "-O2", "-fPIC")
CANDIDATES = ("cc", "gcc", "clang")
_WORKERS = 2
_SMALLEST = "#include <math.h>\ndouble smallest(double x) { return sin(x); }\n"
_TIMEOUT = 600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiler:
    """A compiler: where it is, the first line of its version, the flags it is called with."""

    path: str
    version: str
    flags: tuple[str, ...] = FLAGS


def _run(command: Sequence[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_TIMEOUT)
    except (OSError, subprocess.TimeoutExpired) as error:
        text = f"cannot run the compiler: {' '.join(command)}\n{error}"
        raise GenerationError(Notice(code="codegen.compiler-failed", text=text)) from error
    if done.returncode:
        text = f"the compiler failed ({done.returncode}): {' '.join(command)}\n{done.stderr.strip()}"
        raise GenerationError(Notice(code="codegen.compiler-failed", text=text))
    return done.stdout


def find_compiler(command: str | None = None) -> Compiler | None:
    """Return the first compiler that answers, or None; with `command`, that one alone."""
    for name in (command,) if command else CANDIDATES:
        path = shutil.which(name)
        if path is None:
            continue
        try:
            lines = _run((path, "--version")).splitlines()
        except GenerationError:
            continue
        return Compiler(path=path, version=lines[0] if lines else "")
    return None


def find_fault(compiler: Compiler) -> str:
    """Return why the compiler cannot make a library of the smallest file, or nothing: is it the machine?"""
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        source = Path(scratch) / "smallest.c"
        source.write_text(_SMALLEST, encoding="utf-8")
        try:
            compile_sources(compiler, [source], Path(scratch) / "smallest.so")
        except GenerationError as error:
            return str(error)
    return ""


def compile_sources(compiler: Compiler, sources: Sequence[Path], output: Path) -> Path:
    """Compile C files, each on its own, and link them into the shared library `output`.

    Raises:
        GenerationError: the compiler fails; the message holds the command and its errors.
    """
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        objects = [Path(scratch) / f"{source.stem}.o" for source in sources]
        commands = [
            (compiler.path, *compiler.flags, "-c", str(source), "-o", str(target))
            for source, target in zip(sources, objects, strict=True)
        ]
        with ThreadPoolExecutor(max_workers=_WORKERS) as pool:
            list(pool.map(_run, commands))
        linked = Path(scratch) / output.name
        _run((compiler.path, "-shared", *map(str, objects), "-o", str(linked), "-lm"))
        shutil.copyfile(linked, output)
    return output
