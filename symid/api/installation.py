"""Checks of an installation: Python, packages, compiler, cache, shared files."""

import os
import platform
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from symid.errors import Notice, SymidError

_PACKAGES = ("casadi", "click", "filelock", "jinja2", "numpy", "scipy", "sympy")
_OLDEST = (3, 11)


@dataclass(frozen=True, slots=True)
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


def check_installation() -> Iterator[InstallationFinding]:
    """Yield the checks of Python, packages, compiler, calls, make, cache and shared files."""
    from symid.codegen import choose_call_path, locate_cache_folder, locate_compiler
    from symid.environment import locate_resource_folder

    remedy = "" if sys.version_info >= _OLDEST else "install Python 3.11 or later"
    yield InstallationFinding("python", f"{platform.python_version()}, {platform.machine()}", remedy)
    for name in _PACKAGES:
        try:
            found, remedy = version(name), ""
        except PackageNotFoundError:
            found, remedy = "not installed", f"pip install {name}"
        yield InstallationFinding(name, found, remedy)
    compiler = locate_compiler()
    found = "none" if compiler is None else f"{compiler.path}: {compiler.version}"
    remedy = "" if compiler else "install gcc or clang; until then the slower NumPy code is used"
    yield InstallationFinding("C compiler", found, remedy, needed=compiler is not None)
    calls, make = choose_call_path(), shutil.which("make")
    yield InstallationFinding("calls of compiled code", calls.name, calls.remedy, needed=False)
    remedy = "" if make else "install make, to build generated folders and run their self-test"
    yield InstallationFinding("make", make or "none", remedy, needed=False)
    folder = locate_cache_folder()
    entries = [path for path in folder.iterdir() if path.is_dir()] if folder.is_dir() else []
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) if entries else 0
    existing = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    remedy = "" if os.access(existing, os.W_OK) else "make it writable, or set XDG_CACHE_HOME"
    yield InstallationFinding("cache", f"{folder}: {len(entries)} libraries, {size / 1e6:.1f} MB", remedy)
    for name in ("robots", "templates"):
        try:
            found, remedy = str(locate_resource_folder(name)), ""
        except SymidError:
            found, remedy = "missing", "install symid again"
        yield InstallationFinding(name, found, remedy)
