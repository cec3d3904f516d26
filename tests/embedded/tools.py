"""Compilers and boards: run a program, build for a Cortex-M, run the result in QEMU, look into an object."""

import hashlib
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

BOARD = Path(__file__).parent / "board"
PACKAGES = {
    "gcc": "gcc",
    "clang": "clang",
    "cppcheck": "cppcheck",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "arm-none-eabi-nm": "binutils-arm-none-eabi",
    "arm-none-eabi-objdump": "binutils-arm-none-eabi",
    "qemu-system-arm": "qemu-system-arm",
}
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion")
STRICT += ("-Wmissing-prototypes", "-Wshadow", "-Werror")
LONGEST = 1200
OBJECTS = "SYMID_TEST_OBJECTS"
"""Variable of the environment with the folder of objects that all processes of a run share."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A processor: what the compiler calls it, and the machine of QEMU that has one."""

    name: str
    flags: tuple[str, ...]
    machine: str


_THUMB = ("-mthumb", "-mfloat-abi=hard")
CORTEX_M4F = Board(
    name="Cortex-M4F", flags=("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", *_THUMB), machine="mps2-an386"
)
CORTEX_M7 = Board(
    name="Cortex-M7", flags=("-mcpu=cortex-m7", "-mfpu=fpv5-d16", *_THUMB), machine="mps2-an500"
)


def find_tool(name: str) -> str:
    """Return the path of a program, or skip with what to install."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"wants {name}: apt-get install {PACKAGES[name]}")
    return found


def run_command(*command: str | Path, folder: Path | None = None) -> str:
    """Return what a program printed on both streams; it must end well."""
    done = subprocess.run(
        list(map(str, command)),
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=LONGEST,
    )
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout[-4000:]}"
    return done.stdout


def compile_object(board: Board, source: Path, target: Path, *options: str) -> Path:
    """Return the object file of a generated source."""
    compiler = find_tool("arm-none-eabi-gcc")
    run_command(compiler, *STRICT, *board.flags, "-O2", *options, "-c", source, "-o", target)
    return target


def keep_object(board: Board, source: Path) -> Path:
    """Return the object of a source of a generated folder, compiled once for all tests of a run."""
    read = (source, *sorted(source.parent.glob("*.h")))
    key = hashlib.sha256(b"".join(path.read_bytes() for path in read)).hexdigest()
    target = Path(os.environ[OBJECTS]) / f"{board.name}-{key}.o"
    if not target.exists():
        # Another process may be at it, too.
        compile_object(board, source, made := target.with_suffix(f".{os.getpid()}"))
        made.rename(target)
    return target


def build_image(board: Board, sources: Sequence[Path], include: Path, target: Path, *options: str) -> Path:
    """Return a program that the board can start: generated sources and a `main`."""
    compiler = find_tool("arm-none-eabi-gcc")
    common = ("-std=c99", "-O2", *board.flags, *options, f"-I{include}")
    ends = (BOARD / "startup.c", "-T", BOARD / "mps2.ld", "--specs=rdimon.specs", "-lm")
    parts = [keep_object(board, path) if path.parent == include else path for path in sources]
    run_command(compiler, *common, *parts, *ends, "-o", target)
    return target


def _start(board: Board, image: Path) -> tuple[str | Path, ...]:
    semihosting = ("-semihosting-config", "enable=on,target=native")
    qemu = find_tool("qemu-system-arm")
    return (qemu, "-machine", board.machine, "-display", "none", *semihosting, "-kernel", image)


def run_image(board: Board, image: Path, folder: Path) -> str:
    """Return what an image printed; it reads and writes files of `folder`, and must return zero."""
    return run_command(*_start(board, image), folder=folder)


def _find_single_step() -> tuple[str, ...]:
    version = re.search(r"version (\d+)\.(\d+)", run_command(find_tool("qemu-system-arm"), "--version"))
    assert version is not None
    new = (int(version[1]), int(version[2])) >= (8, 1)
    return ("-accel", "tcg,one-insn-per-tb=on") if new else ("-singlestep",)


def trace_image(board: Board, image: Path, folder: Path) -> tuple[int, ...]:
    """Return the address of every instruction that an image ran, in order, without a board's clock."""
    log = folder / "trace.log"
    run_command(*_start(board, image), *_find_single_step(), "-d", "exec,nochain", "-D", log, folder=folder)
    text = log.read_text(encoding="ascii", errors="replace")
    log.unlink()
    return tuple(
        int(found, 16) for found in re.findall(r"^Trace .*?\[[0-9a-f]+/([0-9a-f]+)/", text, re.MULTILINE)
    )


def read_sizes(image: Path) -> dict[str, tuple[int, int]]:
    """Return address and size in byte of every function in an object or image."""
    lines = run_command(find_tool("arm-none-eabi-nm"), "--print-size", image).splitlines()
    found = (re.fullmatch(r"([0-9a-f]{8}) ([0-9a-f]{8}) [TtWw] (\S+)", line) for line in lines)
    return {match[3]: (int(match[1], 16), int(match[2], 16)) for match in found if match}


def read_undefined(target: Path) -> set[str]:
    """Return the names that an object asks others for."""
    lines = run_command(find_tool("arm-none-eabi-nm"), "--undefined-only", "--format=posix", target)
    return {line.split()[0] for line in lines.splitlines()}
