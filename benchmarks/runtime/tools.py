"""Compilers and valgrind: what is there, and with which flags it is called.

Input: names of compilers. Output: `Compiler`.
"""

import platform
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Compiler", "NotInstalledError", "find_compiler", "find_compilers", "find_count_machine"]

_NEWEST = 40
_OLDEST = 12
_VECTORS = (("avx2", "x86-64-v3"), ("sse4_2", "x86-64-v2"))


class NotInstalledError(Exception):
    """Something that is not installed; the text says what to install."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiler:
    """A C and a C++ compiler that belong together; `name` stands over columns."""

    name: str
    c: str
    cxx: str


def find_compiler(name: str) -> Compiler:
    """Return the compilers called `name`: gcc, clang (the system's own, else the newest), clang-19, gcc-13.

    Raises:
        NotInstalledError: one of the two is missing.
    """
    family, _, number = name.partition("-")
    endings = [f"-{number}"] if number else [""]
    if family == "clang" and not number:
        endings = ["", *(f"-{k}" for k in range(_NEWEST, _OLDEST, -1))]
    plus = {"clang": "clang++", "gcc": "g++"}.get(family, f"{family}++")
    for ending in endings:
        c, cxx = shutil.which(f"{family}{ending}"), shutil.which(f"{plus}{ending}")
        if c and cxx:
            return Compiler(name=f"{family}{ending}", c=c, cxx=cxx)
    package = "clang" if family == "clang" else plus
    text = f"{name} and its C++ compiler are not installed; on Debian: apt-get install {package}"
    raise NotInstalledError(text)


def find_compilers(names: Sequence[str]) -> tuple[list[Compiler], list[str]]:
    """Return the compilers that are there, and a sentence for each that is not."""
    found, missing = [], []
    for name in names:
        try:
            found.append(find_compiler(name))
        except NotInstalledError as error:
            missing.append(str(error))
    return found, missing


def find_count_machine() -> str:
    """Return the machine to compile for where valgrind counts: it knows no AVX-512.

    Raises:
        NotInstalledError: there is no valgrind, or its header callgrind.h is not there.
    """
    header = Path("/usr/include/valgrind/callgrind.h")
    if shutil.which("valgrind") is None or not header.is_file():
        text = "no instruction counts: valgrind with its headers is not installed: apt-get install valgrind"
        raise NotInstalledError(text)
    if platform.machine() not in {"x86_64", "AMD64"}:
        return "native"
    flags = Path("/proc/cpuinfo").read_text(encoding="utf-8").split()
    if "avx512f" not in flags:
        return "native"
    return next(machine for flag, machine in _VECTORS if flag in flags)
