"""What an installation has, what it lacks, and what to do about it.

Input: nothing. Output: `Finding`, one for each thing looked at.
"""

import os
import platform
import shutil
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from symid.errors import Notice, SymidError

__all__ = ["Finding", "list_findings"]

_PACKAGES = ("casadi", "click", "jinja2", "numpy", "scipy", "sympy")
_OLDEST = (3, 11)


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing looked at.

    Args:
        name: of the thing; found: what is there.
        remedy: what to do; empty where nothing has to be done.
        needed: whether symid cannot work without.
    """

    name: str
    found: str
    remedy: str = ""
    needed: bool = True

    def tell(self) -> Notice:
        """Return what is missing and what to do."""
        return Notice(code="doctor.missing", text=f"{self.name}: {self.found}; {self.remedy}")


def list_findings() -> tuple[Finding, ...]:
    """Look at Python, packages, compiler, calls, make, cache and shared files."""
    return (
        _look_at_python(),
        *map(_look_at_package, _PACKAGES),
        _look_at_compiler(),
        _look_at_calls(),
        _look_at_make(),
        _look_at_cache(),
        *map(_look_at_resource, ("robots", "templates")),
    )


def _look_at_python() -> Finding:
    remedy = "" if sys.version_info >= _OLDEST else "install Python 3.11 or later"
    return Finding(name="python", found=f"{platform.python_version()}, {platform.machine()}", remedy=remedy)


def _look_at_package(name: str) -> Finding:
    try:
        return Finding(name=name, found=version(name))
    except PackageNotFoundError:
        return Finding(name=name, found="not installed", remedy=f"pip install {name}")


def _look_at_compiler() -> Finding:
    from symid.codegen.compiler import find_compiler

    compiler = find_compiler()
    if compiler is None:
        remedy = "install gcc or clang; until then the slower NumPy code is used"
        return Finding(name="C compiler", found="none", remedy=remedy, needed=False)
    return Finding(name="C compiler", found=f"{compiler.path}: {compiler.version}")


def _look_at_calls() -> Finding:
    from symid.codegen.python_call import find_call_path

    path = find_call_path()
    return Finding(name="calls of compiled code", found=path.name, remedy=path.remedy, needed=False)


def _look_at_make() -> Finding:
    path = shutil.which("make")
    remedy = "" if path else "install make, to build generated folders and run their self-test"
    return Finding(name="make", found=path or "none", remedy=remedy, needed=False)


def _look_at_cache() -> Finding:
    from symid.codegen.cache import find_cache_folder

    folder = find_cache_folder()
    entries = [path for path in folder.iterdir() if path.is_dir()] if folder.is_dir() else []
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) if entries else 0
    remedy = "" if _is_writable(folder) else "make it writable, or set XDG_CACHE_HOME"
    found = f"{folder}: {len(entries)} libraries, {size / 1e6:.1f} MB"
    return Finding(name="cache", found=found, remedy=remedy)


def _is_writable(folder: Path) -> bool:
    existing = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    return os.access(existing, os.W_OK)


def _look_at_resource(name: str) -> Finding:
    from symid.resources import find_resource_folder

    try:
        folder = find_resource_folder(name)
    except SymidError:
        return Finding(name=name, found="missing", remedy="install symid again")
    return Finding(name=name, found=str(folder))
