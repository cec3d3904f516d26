"""Checks of an installation: Python, packages, compiler, cache, shared files."""

import os
import platform
import shutil
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from symid.errors import Notice, SymidError

_PACKAGES = ("casadi", "click", "filelock", "jinja2", "numpy", "scipy", "sympy")
_OLDEST = (3, 11)


@dataclass(frozen=True, slots=True, kw_only=True)
class InstallationFinding:
    """One check.

    Args:
        name: of the item; found: its version or place.
        remedy: what to do; empty if nothing has to be done.
        needed: symid cannot work without it.
    """

    name: str
    found: str
    remedy: str = ""
    needed: bool = True

    def build_notice(self) -> Notice:
        """Return what is missing and what to do."""
        return Notice(code="doctor.missing", text=f"{self.name}: {self.found}; {self.remedy}")


def check_installation() -> tuple[InstallationFinding, ...]:
    """Check Python, packages, compiler, calls, make, cache and shared files."""
    from symid.codegen import choose_call_path

    remedy = "" if sys.version_info >= _OLDEST else "install Python 3.11 or later"
    python = f"{platform.python_version()}, {platform.machine()}"
    calls, make = choose_call_path(), shutil.which("make")
    build = "" if make else "install make, to build generated folders and run their self-test"
    return (
        InstallationFinding(name="python", found=python, remedy=remedy),
        *map(_check_package, _PACKAGES),
        _check_compiler(),
        InstallationFinding(
            name="calls of compiled code", found=calls.name, remedy=calls.remedy, needed=False
        ),
        InstallationFinding(name="make", found=make or "none", remedy=build, needed=False),
        _check_cache(),
        *map(_check_resource, ("robots", "templates")),
    )


def _check_package(name: str) -> InstallationFinding:
    try:
        return InstallationFinding(name=name, found=version(name))
    except PackageNotFoundError:
        return InstallationFinding(name=name, found="not installed", remedy=f"pip install {name}")


def _check_compiler() -> InstallationFinding:
    from symid.codegen import locate_compiler

    compiler = locate_compiler()
    if compiler is None:
        remedy = "install gcc or clang; until then the slower NumPy code is used"
        return InstallationFinding(name="C compiler", found="none", remedy=remedy, needed=False)
    return InstallationFinding(name="C compiler", found=f"{compiler.path}: {compiler.version}")


def _check_cache() -> InstallationFinding:
    from symid.codegen import locate_cache_folder

    folder = locate_cache_folder()
    entries = [path for path in folder.iterdir() if path.is_dir()] if folder.is_dir() else []
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) if entries else 0
    existing = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    remedy = "" if os.access(existing, os.W_OK) else "make it writable, or set XDG_CACHE_HOME"
    found = f"{folder}: {len(entries)} libraries, {size / 1e6:.1f} MB"
    return InstallationFinding(name="cache", found=found, remedy=remedy)


def _check_resource(name: str) -> InstallationFinding:
    from symid.environment import locate_resource_folder

    try:
        folder = locate_resource_folder(name)
    except SymidError:
        return InstallationFinding(name=name, found="missing", remedy="install symid again")
    return InstallationFinding(name=name, found=str(folder))
