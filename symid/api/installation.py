"""What an installation has, what it lacks, and what to do about it.

Nothing -> `InstallationFinding`, one for each thing looked at.
"""

import os
import platform
import shutil
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from symid.errors import Notice, SymidError

_PACKAGES = ("casadi", "click", "filelock", "jinja2", "numpy", "scipy", "sympy")
_OLDEST = (3, 11)


@dataclass(frozen=True, slots=True, kw_only=True)
class InstallationFinding:
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


def check_installation() -> tuple[InstallationFinding, ...]:
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


def _look_at_python() -> InstallationFinding:
    remedy = "" if sys.version_info >= _OLDEST else "install Python 3.11 or later"
    return InstallationFinding(
        name="python", found=f"{platform.python_version()}, {platform.machine()}", remedy=remedy
    )


def _look_at_package(name: str) -> InstallationFinding:
    try:
        return InstallationFinding(name=name, found=version(name))
    except PackageNotFoundError:
        return InstallationFinding(name=name, found="not installed", remedy=f"pip install {name}")


def _look_at_compiler() -> InstallationFinding:
    from symid.codegen import locate_compiler

    compiler = locate_compiler()
    if compiler is None:
        remedy = "install gcc or clang; until then the slower NumPy code is used"
        return InstallationFinding(name="C compiler", found="none", remedy=remedy, needed=False)
    return InstallationFinding(name="C compiler", found=f"{compiler.path}: {compiler.version}")


def _look_at_calls() -> InstallationFinding:
    from symid.codegen import choose_call_path

    path = choose_call_path()
    return InstallationFinding(
        name="calls of compiled code", found=path.name, remedy=path.remedy, needed=False
    )


def _look_at_make() -> InstallationFinding:
    path = shutil.which("make")
    remedy = "" if path else "install make, to build generated folders and run their self-test"
    return InstallationFinding(name="make", found=path or "none", remedy=remedy, needed=False)


def _look_at_cache() -> InstallationFinding:
    from symid.codegen import locate_cache_folder

    folder = locate_cache_folder()
    entries = [path for path in folder.iterdir() if path.is_dir()] if folder.is_dir() else []
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) if entries else 0
    remedy = "" if _is_writable(folder) else "make it writable, or set XDG_CACHE_HOME"
    found = f"{folder}: {len(entries)} libraries, {size / 1e6:.1f} MB"
    return InstallationFinding(name="cache", found=found, remedy=remedy)


def _is_writable(folder: Path) -> bool:
    existing = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    return os.access(existing, os.W_OK)


def _look_at_resource(name: str) -> InstallationFinding:
    from symid.environment import locate_resource_folder

    try:
        folder = locate_resource_folder(name)
    except SymidError:
        return InstallationFinding(name=name, found="missing", remedy="install symid again")
    return InstallationFinding(name=name, found=str(folder))
