"""Libraries that were made before, found again by a signature of all that went into them.

Input: a robot. Output: `Library`, from the cache or made now.

The signature covers what of the robot its functions depend on (not limits, motors, logs, prose), the
versions of symid, CasADi and SymPy, the bytes of the templates and of the modules that derive and
print, the compiler and its flags, the machine. An entry is a folder that appears by one rename; it is
used only if every file in it still has the digest noted when it was made.

Supported: several processes at once; machines without a compiler, which get the NumPy module.
Not supported: removal of old entries; the folder may be deleted at any time.
"""

import contextlib
import json
import platform
import secrets
import shutil
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from symid import __version__
from symid.codegen.cache_folder import find_cache_folder, find_user_folder, make_temporary_folder
from symid.codegen.compiler import CANDIDATES, Compiler, compile_sources, find_compiler, find_fault
from symid.codegen.library import Library, load_library
from symid.codegen.names import find_prefix
from symid.codegen.templates import find_template_bytes
from symid.codegen.writer import MANIFEST, find_digest, write_sources
from symid.errors import GenerationError, Notice, OutputError
from symid.provenance import find_signature
from symid.robot.description import Joint, Limits, Robot
from symid.robot.log_map import LogMap, Processing

__all__ = ["find_cache_folder", "find_library_key", "prepare_library"]

_SEAL = "seal.json"
_ROOMS = ("robot", "algebra", "joint", "dynamics", "parameters", "codegen")
_MODULES = ("arrays", "errors", "notation", "provenance", "resources")
_PACKAGE = Path(__file__).resolve().parent.parent


@dataclass(frozen=True, slots=True, kw_only=True)
class _Order:
    """What is to be made, and by what."""

    robot: Robot
    names: tuple[str, ...] | None
    compiler: Compiler | None
    progress: Callable[[str], None]


def _find_version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _find_code_bytes() -> tuple[tuple[str, bytes], ...]:
    paths = sorted(path for room in _ROOMS for path in (_PACKAGE / room).glob("*.py"))
    paths += [_PACKAGE / f"{name}.py" for name in _MODULES]
    return tuple((path.relative_to(_PACKAGE).as_posix(), path.read_bytes()) for path in paths)


def _keep_model(robot: Robot) -> Robot:
    """Return `robot` without what its functions do not depend on."""

    def keep(joint: Joint) -> Joint:
        drive = replace(joint.drive, torque_constant=None)
        return replace(joint, limits=Limits(), drive=drive)

    return replace(
        robot,
        joints=tuple(map(keep, robot.joints)),
        convention="",
        description="",
        source="",
        log=LogMap(),
        processing=Processing(),
        path="",
        notices=(),
    )


def find_library_key(robot: Robot, names: tuple[str, ...] | None, compiler: Compiler | None) -> str:
    """Return the signature of all that a library is made from."""
    tools = (__version__, _find_version("casadi"), _find_version("sympy"), _find_version("mpmath"))
    built_by = compiler or f"python {sys.version_info.major}.{sys.version_info.minor}"
    machine = (platform.system(), platform.machine())
    templates = find_template_bytes("c", "python")
    return find_signature(_keep_model(robot), names, tools, machine, templates, _find_code_bytes(), built_by)


def _read_digests(folder: Path) -> dict[str, str]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != _SEAL)
    return {path.relative_to(folder).as_posix(): find_digest(path.read_bytes()) for path in paths}


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
        try:
            staging.rename(entry)
        except OSError:
            # Another process may have been faster: what it made is as good.
            if _find_damage(entry, key):
                raise
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _obtain_entry(order: _Order, folder: Path, key: str) -> tuple[Path, str]:
    """Return the entry in `folder`, made if it has to be, and what was wrong with the one before."""
    entry = folder / f"{find_prefix(order.robot.name)}-{key[:24]}"
    damage = ""
    try:
        if not entry.is_dir() or (damage := _find_damage(entry, key)):
            folder.mkdir(parents=True, exist_ok=True)
            _discard(entry)
            _store_entry(order, entry, key)
    except OSError as error:
        text = f"the cache folder cannot be written: {error.strerror or error}"
        raise OutputError(Notice(code="output.cache", text=text, file=str(folder))) from error
    return entry, damage


def _obtain_temporary(order: _Order, key: str, reason: str) -> tuple[Path, str, Notice]:
    try:
        folder = make_temporary_folder()
    except OSError as error:
        text = f"{reason}; nor is there a place for temporary files: {error.strerror or error}"
        raise OutputError(Notice(code="output.cache", text=text)) from error
    entry, damage = _obtain_entry(order, folder, key)
    text = f"{reason}; libraries are kept in this temporary folder; set XDG_CACHE_HOME to a folder of yours"
    return entry, damage, Notice(code="codegen.cache-temporary", text=text, file=str(folder))


def _obtain(order: _Order, key: str) -> tuple[Path, str, tuple[Notice, ...]]:
    """Return the entry in the user's cache; in a temporary folder, with a notice, where that cannot be."""
    folder = find_user_folder()
    if folder is None:
        reason = "there is no home folder to keep compiled libraries in"
    else:
        try:
            return (*_obtain_entry(order, folder, key), ())
        except OutputError as error:
            reason = str(error)
    entry, damage, notice = _obtain_temporary(order, key, reason)
    return entry, damage, (notice,)


def _find_notices(
    damage: str, entry: Path, found: Compiler | None, wanted: str | None, *, told: bool
) -> tuple[Notice, ...]:
    notices = []
    if damage:
        text = f"the cached library was not used and made again: {damage}"
        notices.append(Notice(code="codegen.cache-rebuilt", text=text, file=str(entry)))
    if found is None and not told:
        names = f"the C compiler {wanted!r}" if wanted else f"a C compiler ({', '.join(CANDIDATES)})"
        text = f"{names} was not found; the NumPy module is used, which is slower"
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
        cache: folder of the cache; None for `find_cache_folder()`, and if that cannot be written, a
            temporary folder, of which a notice tells.
        compiler: command of the C compiler; None for the first of cc, gcc, clang.

    Raises:
        RobotError: the robot is not supported.
        GenerationError: the compiler fails on generated code.
        OutputError: the folder `cache`, or the temporary one, cannot be written.
    """
    found = find_compiler(compiler)
    order = _Order(robot=robot, names=names, compiler=found, progress=progress or (lambda _: None))
    try:
        return _load(order, cache, compiler, ())
    except GenerationError:
        fault = find_fault(found) if found else ""
        if not fault:
            raise
    # Not the generated code is at fault but the compiler, for example one without the C library's headers.
    text = f"the C compiler cannot be used: {fault}; the NumPy module is used, which is slower"
    notice = Notice(code="codegen.compiler-unusable", text=text)
    return _load(replace(order, compiler=None), cache, compiler, (notice,))


def _load(order: _Order, cache: Path | None, wanted: str | None, notices: tuple[Notice, ...]) -> Library:
    key = find_library_key(order.robot, order.names, order.compiler)
    entry, damage, more = _obtain(order, key) if cache is None else (*_obtain_entry(order, cache, key), ())
    missing = _find_notices(damage, entry, order.compiler, wanted, told=bool(notices))
    return load_library(entry, notices=(*notices, *more, *missing))
