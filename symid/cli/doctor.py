"""`symid doctor`: what this installation has, what it lacks, and what to do about it."""

import os
import platform
import shutil
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import click

from symid import __version__
from symid.cli.options import verb
from symid.cli.output import Answer, Console, format_table
from symid.errors import Notice, SymidError

__all__ = ["command"]

_PACKAGES = ("casadi", "click", "jinja2", "numpy", "scipy", "sympy")
_OLDEST = (3, 11)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Finding:
    """One thing looked at: `remedy` is empty where nothing has to be done."""

    name: str
    found: str
    remedy: str = ""
    needed: bool = True


@click.command("doctor")
@verb
def command(console: Console) -> Answer:
    """Look at Python, packages, compiler, cache and shared files, and say what to do.

    Exit code 1 when something is missing that symid cannot work without.
    """
    console.detail(f"python: {sys.executable}")
    findings = (
        _look_at_python(),
        *map(_look_at_package, _PACKAGES),
        _look_at_compiler(),
        _look_at_make(),
        _look_at_cache(),
        *map(_look_at_resource, ("robots", "templates")),
    )
    missing = [entry for entry in findings if entry.remedy and entry.needed]
    rows = [(entry.name, entry.found, entry.remedy or "ok") for entry in findings]
    return Answer(
        text=format_table(("what", "found", "to do"), rows, left=(0, 1, 2)),
        result={
            "version": __version__,
            "findings": [
                {"name": entry.name, "found": entry.found, "ok": not entry.remedy, "remedy": entry.remedy}
                for entry in findings
            ],
        },
        warnings=tuple(map(_tell, (e for e in findings if e.remedy and not e.needed))),
        errors=tuple(map(_tell, missing)),
        exit_code=1 if missing else 0,
    )


def _tell(finding: _Finding) -> Notice:
    return Notice(code="doctor.missing", text=f"{finding.name}: {finding.found}; {finding.remedy}")


def _look_at_python() -> _Finding:
    remedy = "" if sys.version_info >= _OLDEST else "install Python 3.11 or later"
    return _Finding(name="python", found=f"{platform.python_version()}, {platform.machine()}", remedy=remedy)


def _look_at_package(name: str) -> _Finding:
    try:
        return _Finding(name=name, found=version(name))
    except PackageNotFoundError:
        return _Finding(name=name, found="not installed", remedy=f"pip install {name}")


def _look_at_compiler() -> _Finding:
    from symid.codegen.compiler import find_compiler

    compiler = find_compiler()
    if compiler is None:
        remedy = "install gcc or clang; until then the slower NumPy code is used"
        return _Finding(name="C compiler", found="none", remedy=remedy, needed=False)
    return _Finding(name="C compiler", found=f"{compiler.path}: {compiler.version}")


def _look_at_make() -> _Finding:
    path = shutil.which("make")
    remedy = "" if path else "install make, to build generated folders and run their self-test"
    return _Finding(name="make", found=path or "none", remedy=remedy, needed=False)


def _look_at_cache() -> _Finding:
    from symid.codegen.cache import find_cache_folder

    folder = find_cache_folder()
    entries = [path for path in folder.iterdir() if path.is_dir()] if folder.is_dir() else []
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) if entries else 0
    remedy = "" if _is_writable(folder) else "make it writable, or set XDG_CACHE_HOME"
    found = f"{folder}: {len(entries)} libraries, {size / 1e6:.1f} MB"
    return _Finding(name="cache", found=found, remedy=remedy)


def _is_writable(folder: Path) -> bool:
    existing = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    return os.access(existing, os.W_OK)


def _look_at_resource(name: str) -> _Finding:
    from symid.resources import find_resource_folder

    try:
        folder = find_resource_folder(name)
    except SymidError:
        return _Finding(name=name, found="missing", remedy="install symid again")
    return _Finding(name=name, found=str(folder))
