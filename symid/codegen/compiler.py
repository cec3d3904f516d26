"""A C compiler, if the machine has one, and what it makes of generated sources.

Input: C files. Output: a shared library. On failure the message holds the command and what the
compiler said.

Supported: cc, gcc and clang, or one given by name; code for the processor at hand, on Linux.

Arithmetic stays that of IEEE 754, operation by operation: no fast-math, and no product fused with a sum
(-ffp-contract=off, which is not what every compiler does unasked). So the same input gives the same bytes
whether or not the processor can fuse them, with code for this processor or for any of its kind; what is
left to differ is the C library's sine and cosine. Fusing would save 4 to 13 % of a call's time. GCC 12 fuses
even so where it makes vectors of straight code, hence -fno-tree-slp-vectorize, which costs nothing.
"""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from symid.errors import GenerationError, Notice

__all__ = [
    "CANDIDATES",
    "FLAGS",
    "Compiler",
    "compile_sources",
    "find_compiler",
    "find_fault",
    "find_processor",
]

# -O3 makes the same code of straight lines, in the same time.
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-tree-slp-vectorize", "-fPIC")
_NATIVE = "-march=native"
CANDIDATES = ("cc", "gcc", "clang")
_WORKERS = 2
_SMALLEST = "#include <math.h>\ndouble smallest(double x) { return sin(x); }\n"
_TIMEOUT = 600.0
_PROCESSORS = Path("/proc/cpuinfo")
# What Linux tells of a processor on one kind of machine or another: what it can do, and which one it is;
# not what changes, such as its clock.
_ABILITIES = frozenset({"flags", "Features", "features", "isa", "cpu"})
_NAMES = frozenset(
    {
        *("vendor_id", "cpu family", "model", "model name", "stepping", "uarch", "revision"),
        *("CPU implementer", "CPU architecture", "CPU variant", "CPU part", "CPU revision"),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiler:
    """A compiler: where it is, the first line of its version, the flags it is called with.

    Where `processor` is not empty, code is made for that one, and may not run on others.
    """

    path: str
    version: str
    flags: tuple[str, ...] = FLAGS
    processor: str = ""


def _run(command: Sequence[str]) -> str:
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            timeout=_TIMEOUT,
            # A store of objects that machines share may not know which of them "native" meant.
            env={**os.environ, "CCACHE_DISABLE": "1"},
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        text = f"cannot run the compiler: {' '.join(command)}\n{error}"
        raise GenerationError(Notice(code="codegen.compiler-failed", text=text)) from error
    if done.returncode:
        text = f"the compiler failed ({done.returncode}): {' '.join(command)}\n{done.stderr.strip()}"
        raise GenerationError(Notice(code="codegen.compiler-failed", text=text))
    return done.stdout


def find_processor() -> str:
    """Return what tells this machine's processors from others, or nothing where that cannot be said."""
    try:
        lines = _PROCESSORS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    pairs = (line.partition(":") for line in lines)
    traits = {(name.strip(), value.strip()) for name, _, value in pairs}
    told = sorted((name, value) for name, value in traits if name in _ABILITIES | _NAMES)
    # A name alone does not say what a hypervisor or the system has switched off.
    return "\n".join(f"{n}: {v}" for n, v in told) if any(n in _ABILITIES for n, _ in told) else ""


def find_compiler(command: str | None = None, *, native: bool = False) -> Compiler | None:
    """Return the first compiler that answers, or None.

    Args:
        command: of the compiler to look for; None for the first of cc, gcc, clang.
        native: make code for this machine's processor, where that can be told from others.
    """
    for name in (command,) if command else CANDIDATES:
        path = shutil.which(name)
        if path is None:
            continue
        try:
            lines = _run((path, "--version")).splitlines()
        except GenerationError:
            continue
        processor = find_processor() if native else ""
        return Compiler(path=path, version=lines[0] if lines else "", processor=processor)
    return None


@cache
def _find_native_flags(compiler: Compiler) -> tuple[str, ...]:
    """Return the flags for code of the processor at hand, if such is wanted and the compiler can."""
    if not compiler.processor:
        return ()
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        source = Path(scratch) / "smallest.c"
        source.write_text(_SMALLEST, encoding="utf-8")
        try:
            _run((compiler.path, *compiler.flags, _NATIVE, "-c", str(source), "-o", f"{scratch}/smallest.o"))
        except GenerationError:
            return ()
    return (_NATIVE,)


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
    flags = (*compiler.flags, *_find_native_flags(compiler))
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        objects = [Path(scratch) / f"{source.stem}.o" for source in sources]
        commands = [
            (compiler.path, *flags, "-c", str(source), "-o", str(target))
            for source, target in zip(sources, objects, strict=True)
        ]
        with ThreadPoolExecutor(max_workers=_WORKERS) as pool:
            list(pool.map(_run, commands))
        linked = Path(scratch) / output.name
        _run((compiler.path, "-shared", *map(str, objects), "-o", str(linked), "-lm"))
        shutil.copyfile(linked, output)
    return output
