"""Libraries that were made before, found again by a signature of all that went into them.

Input: a robot. Output: `Library`, from the cache or made now.

The signature covers the robot (not its log mapping), the versions of symid, CasADi and SymPy, the
bytes of the templates and of the modules that derive and print, the compiler and its flags. An
entry is a folder that appears by one rename; it is used only if every file in it still has the
digest noted when it was made.

Supported: several processes at once; machines without a compiler, which get the NumPy module.
Not supported: removal of old entries; the folder may be deleted at any time.
"""

import contextlib
import json
import os
import secrets
import shutil
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from symid import __version__
from symid.codegen.compiler import Compiler, compile_sources, find_compiler
from symid.codegen.library import Library, load_library
from symid.codegen.templates import find_template_bytes
from symid.codegen.writer import MANIFEST, find_digest, write_sources
from symid.errors import Notice, OutputError
from symid.provenance import find_signature
from symid.robot.description import Robot

__all__ = ["find_cache_folder", "find_library_key", "prepare_library"]

_SEAL = "seal.json"
_ROOMS = ("robot", "algebra", "joint", "dynamics", "codegen")
_PACKAGE = Path(__file__).resolve().parent.parent


@dataclass(frozen=True, slots=True, kw_only=True)
class _Order:
    """What is to be made, and by what."""

    robot: Robot
    names: tuple[str, ...] | None
    compiler: Compiler | None
    progress: Callable[[str], None]


def find_cache_folder() -> Path:
    """Return `symid` in the user's cache folder, as the XDG base directory specification has it."""
    home = os.environ.get("XDG_CACHE_HOME", "")
    # A relative path there is to be ignored, says the specification.
    root = Path(home) if Path(home).is_absolute() else Path.home() / ".cache"
    return root / "symid"


def _find_version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _find_code_bytes() -> tuple[tuple[str, bytes], ...]:
    paths = sorted(path for room in _ROOMS for path in (_PACKAGE / room).glob("*.py"))
    return tuple((path.relative_to(_PACKAGE).as_posix(), path.read_bytes()) for path in paths)


def find_library_key(robot: Robot, names: tuple[str, ...] | None, compiler: Compiler | None) -> str:
    """Return the signature of all that a library is made from."""
    model = (robot.name, robot.joints, robot.gravity, robot.symbols, robot.convention)
    tools = (__version__, _find_version("casadi"), _find_version("sympy"), _find_version("mpmath"))
    built_by = compiler or f"python {sys.version_info.major}.{sys.version_info.minor}"
    return find_signature(
        model, names, tools, find_template_bytes("c", "python"), _find_code_bytes(), built_by
    )


def _read_digests(folder: Path) -> dict[str, str]:
    # Byte code that Python writes beside a module is not part of the entry.
    paths = sorted(p for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts)
    return {
        path.relative_to(folder).as_posix(): find_digest(path.read_bytes())
        for path in paths
        if path.name != _SEAL
    }


def _find_damage(entry: Path, key: str) -> str:
    """Return what is wrong with `entry`, or nothing."""
    try:
        seal: Mapping[str, object] = json.loads((entry / _SEAL).read_text(encoding="utf-8"))
        found = _read_digests(entry)
    except (OSError, ValueError) as error:
        return f"its seal cannot be read ({type(error).__name__})"
    if not isinstance(seal, dict) or seal.get("key") != key:
        return "it belongs to other inputs"
    listed = seal.get("files")
    if not isinstance(listed, dict) or MANIFEST not in listed:
        return "its seal lists no manifest"
    changed = sorted(path for path in listed.keys() | found.keys() if listed.get(path) != found.get(path))
    return f"changed since it was made: {', '.join(changed)}" if changed else ""


def _make_entry(order: _Order, folder: Path, key: str) -> None:
    # Imported here: a library that is found needs neither CasADi nor SymPy.
    from symid.codegen.c_library import generate_c_library
    from symid.codegen.casadi_functions import build_functions
    from symid.codegen.python_module import generate_python_module

    order.progress(f"deriving the dynamics of {order.robot.name}")
    functions = build_functions(order.robot, names=order.names)
    if order.compiler is None:
        order.progress("writing the NumPy module")
        write_sources(generate_python_module(functions), folder)
    else:
        order.progress("writing C")
        paths = write_sources(generate_c_library(functions), folder)
        prefix = next(path.stem for path in paths if path.suffix == ".h")
        sources = [path for path in paths if path.suffix == ".c" and path.name.startswith(f"{prefix}_")]
        order.progress(f"compiling with {order.compiler.path}")
        compile_sources(order.compiler, sources, folder / f"lib{prefix}.so")
    seal = {"key": key, "files": _read_digests(folder)}
    (folder / _SEAL).write_text(json.dumps(seal, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def _discard(entry: Path) -> None:
    """Move a damaged entry out of the way, then remove it: nobody sees half of it."""
    aside = entry.parent / f".old-{secrets.token_hex(6)}"
    with contextlib.suppress(FileNotFoundError):
        entry.rename(aside)
        shutil.rmtree(aside, ignore_errors=True)


def _store_entry(order: _Order, entry: Path, key: str) -> None:
    staging = entry.parent / f".new-{secrets.token_hex(6)}"
    try:
        _make_entry(order, staging, key)
        # Another process may have been faster: what it made is as good.
        with contextlib.suppress(OSError):
            staging.rename(entry)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _find_notices(order: _Order, damage: str, entry: Path) -> tuple[Notice, ...]:
    notices = []
    if damage:
        text = f"the cached library was not used and made again: {damage}"
        notices.append(Notice(code="codegen.cache-rebuilt", text=text, file=str(entry)))
    if order.compiler is None:
        text = "no C compiler (cc, gcc, clang) was found; the NumPy module is used, which is slower"
        notices.append(Notice(code="codegen.no-compiler", text=text))
    return tuple(notices)


def prepare_library(
    robot: Robot,
    *,
    progress: Callable[[str], None] | None = None,
    names: tuple[str, ...] | None = None,
    cache: Path | None = None,
    compiler: str | None = None,
) -> Library:
    """Return the robot's library; derive, generate and compile it if it is not in the cache.

    Args:
        robot: its log mapping and processing take no part.
        progress: told what is being done, if something has to be done.
        names: functions to include; None for all.
        cache: folder of the cache; None for `find_cache_folder()`.
        compiler: command of the C compiler; None for the first of cc, gcc, clang.

    Raises:
        RobotError: the robot is not supported.
        GenerationError: the compiler fails on generated code.
        OutputError: the cache folder cannot be written.
    """
    found = find_compiler(compiler)
    order = _Order(robot=robot, names=names, compiler=found, progress=progress or (lambda _: None))
    key = find_library_key(robot, names, found)
    folder = cache or find_cache_folder()
    entry = folder / f"{robot.name}-{key[:24]}"
    damage = ""
    if not entry.is_dir() or (damage := _find_damage(entry, key)):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _discard(entry)
            _store_entry(order, entry, key)
        except OSError as error:
            text = f"the cache folder cannot be written: {error.strerror or error}"
            raise OutputError(Notice(code="output.cache", text=text, file=str(folder))) from error
    return load_library(entry, notices=_find_notices(order, damage, entry))
