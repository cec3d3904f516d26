"""Libraries that were made before, found again by a signature of all that went into them.

Input: a robot. Output: `Library`, from the cache or made now.

The signature covers what of the robot its functions depend on (not limits, motors, logs, prose), the
versions of symid, CasADi and SymPy, the bytes of the templates and of the modules that derive and
print, the compiler and its flags, the machine with its processor, for which code is made. An entry is a
folder that appears by one rename; it is used only if every file in it still has the digest noted when it was
made, nobody but the user owns or may write it, and it loads. Else it is made again, and a notice says why.

Supported: several processes at once; machines without a compiler, which get the NumPy module or CasADi's
virtual machine; one cache for machines of many kinds.
Not supported: removal of old entries; the folder may be deleted at any time.
"""

import json
import os
import platform
import secrets
import shutil
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from symid import __version__
from symid.codegen.cache_folder import (
    clear_away,
    clear_remains,
    close_entry,
    close_folder,
    find_cache_folder,
    find_distrust,
    find_user_folder,
    make_cache_folder,
    make_temporary_folder,
)
from symid.codegen.compiler import CANDIDATES, Compiler, compile_sources, find_compiler, find_fault
from symid.codegen.library import Library, Loaded, load_library
from symid.codegen.names import find_prefix
from symid.codegen.options import BACKENDS
from symid.codegen.python_call import find_call_path
from symid.codegen.templates import find_template_bytes
from symid.codegen.writer import MANIFEST, find_digest, write_sources
from symid.errors import GenerationError, Notice, OutputError, UsageError
from symid.provenance import find_signature
from symid.robot.description import Joint, Limits, Robot
from symid.robot.log_map import LogMap, Processing

if TYPE_CHECKING:  # a library that is found needs neither CasADi nor SymPy
    from symid.codegen.casadi_functions import Functions

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
    casadi: bool = False


# A library, and what a user should know of how it was come by.
_Obtained = tuple[Loaded, tuple[Notice, ...]]


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


def find_library_key(
    robot: Robot,
    names: tuple[str, ...] | None,
    compiler: Compiler | None,
    *,
    calls: str = "",
    casadi: bool = False,
) -> str:
    """Return the signature of all that a library is made from.

    Args:
        robot: its functions count, see `prepare_library`.
        names: of functions, None for all.
        compiler: None for none.
        calls: what serves calls from Python.
        casadi: whether CasADi computes the functions.
    """
    tools = (__version__, _find_version("casadi"), _find_version("sympy"), _find_version("mpmath"))
    built_by = (compiler or f"python {sys.version_info.major}.{sys.version_info.minor}", calls, casadi)
    # A library that was linked with a newer C library may not load with an older one.
    runtime = (
        os.confstr("CS_GNU_LIBC_VERSION") if "CS_GNU_LIBC_VERSION" in getattr(os, "confstr_names", ()) else ""
    )
    machine = (platform.system(), platform.machine(), runtime)
    templates = find_template_bytes("c", "python", "casadi")
    return find_signature(_keep_model(robot), names, tools, machine, templates, _find_code_bytes(), built_by)


def _read_digests(folder: Path) -> dict[str, str]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != _SEAL)
    return {path.relative_to(folder).as_posix(): find_digest(path.read_bytes()) for path in paths}


def _find_damage(entry: Path, key: str) -> str:
    """Return what is wrong with `entry`, or nothing."""
    try:
        if distrust := find_distrust(entry):
            return distrust
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
    from symid.codegen.python_call_source import write_python_call
    from symid.codegen.python_module import generate_python_module

    order.progress(f"deriving the dynamics of {order.robot.name}")
    functions = build_functions(order.robot, names=order.names)
    if order.casadi:
        _make_casadi_entry(order, functions, folder)
    elif order.compiler is None:
        order.progress("writing the NumPy module")
        write_sources(generate_python_module(functions), folder)
    else:
        order.progress("writing C")
        prefix = find_prefix(order.robot.name)
        paths = write_sources(generate_c_library(functions), folder)
        sources = [path for path in paths if path.suffix == ".c" and path.name.startswith(f"{prefix}_")]
        flags = find_call_path().flags
        if flags:
            sources.append(folder / "python_call.c")
            sources[-1].write_text(write_python_call(functions.card, prefix), encoding="utf-8")
        order.progress(f"compiling with {order.compiler.path}")
        compiler = replace(order.compiler, flags=(*order.compiler.flags, *flags))
        compile_sources(compiler, sources, folder / f"lib{prefix}.so")
    seal = {"key": key, "files": _read_digests(folder)}
    (folder / _SEAL).write_text(json.dumps(seal, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    close_entry(folder)


def _make_casadi_entry(order: _Order, functions: "Functions", folder: Path) -> None:
    """Write what CasADi loads; compiled without Jacobians, which nobody asks a `Library` for."""
    from symid.codegen.casadi_target import find_casadi_sources, generate_casadi

    order.progress("writing CasADi functions and their C")
    write_sources(generate_casadi(functions), folder)
    if order.compiler is not None:
        prefix = find_prefix(order.robot.name)
        order.progress(f"compiling with {order.compiler.path}")
        sources = [folder / path for path in find_casadi_sources(prefix)]
        compile_sources(order.compiler, sources, folder / f"lib{prefix}_casadi.so")


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


def _make_library(order: _Order, entry: Path, key: str, tries: int = 3) -> Loaded:
    clear_away(entry)
    clear_remains(entry.parent)
    _store_entry(order, entry, key)
    try:
        return load_library(entry)
    except (GenerationError, UsageError):
        # Another process that had found the damage too may just have cleared this entry away.
        if tries <= 1 or entry.is_dir():
            raise
    return _make_library(order, entry, key, tries - 1)


def _obtain_library(order: _Order, entry: Path, key: str) -> tuple[Loaded, str]:
    """Return the library in `entry`, made if it has to be, and what was wrong with the one before."""
    damage = ""
    if os.path.lexists(entry) and not (damage := _find_damage(entry, key)):
        try:
            return load_library(entry), ""
        except (GenerationError, UsageError) as error:
            # It is as its seal says; but whoever can write an entry can write its seal.
            damage = str(error)
    return _make_library(order, entry, key), damage


def _obtain_entry(order: _Order, folder: Path, key: str) -> _Obtained:
    entry = folder / f"{find_prefix(order.robot.name)}-{key[:24]}"
    try:
        make_cache_folder(folder)
        library, damage = _obtain_library(order, entry, key)
    except OSError as error:
        text = f"the cache folder cannot be written: {error.strerror or error}"
        raise OutputError(Notice(code="output.cache", text=text, file=str(folder))) from error
    if not damage:
        return library, ()
    text = f"the cached library was not used and made again: {damage}"
    return library, (Notice(code="codegen.cache-rebuilt", text=text, file=str(entry)),)


def _obtain_temporary(order: _Order, key: str, reason: str) -> _Obtained:
    try:
        folder = make_temporary_folder()
    except OSError as error:
        text = f"{reason}; nor is there a place for temporary files: {error.strerror or error}"
        raise OutputError(Notice(code="output.cache", text=text)) from error
    library, notices = _obtain_entry(order, folder, key)
    text = f"{reason}; libraries are kept in this temporary folder; set XDG_CACHE_HOME to a folder of yours"
    return library, (Notice(code="codegen.cache-temporary", text=text, file=str(folder)), *notices)


def _obtain(order: _Order, key: str) -> _Obtained:
    """Return the library from the cache of the user; with a notice from a temporary one, if need be."""
    folder = find_user_folder()
    if folder is None:
        reason = "there is no home folder to keep compiled libraries in"
    else:
        # It is symid's own, but the umask of many users lets their group write to what they make.
        close_folder(folder)
        try:
            return _obtain_entry(order, folder, key)
        except OutputError as error:
            reason = str(error)
    return _obtain_temporary(order, key, reason)


_INSTEAD = {"auto": "the NumPy module", "casadi": "CasADi's virtual machine"}
"""What serves without a compiler, by backend; where nothing does, that is an error."""


def _find_missing(wanted: str | None) -> str:
    names = f"the C compiler {wanted!r}" if wanted else f"a C compiler ({', '.join(CANDIDATES)})"
    return f"{names} was not found"


def _fall_back(order: _Order, backend: str, cache: Path | None, code: str, reason: str) -> Library:
    """Return the library that needs no compiler, and say so; for "c" there is none."""
    if backend not in _INSTEAD:
        text = f"{reason}; give another backend than {backend!r}, or see `symid doctor`"
        raise GenerationError(Notice(code=code, text=text))
    text = f"{reason}; {_INSTEAD[backend]} is used, which is slower"
    return _load(replace(order, compiler=None), cache, Notice(code=code, text=text))


def prepare_library(
    robot: Robot,
    *,
    progress: Callable[[str], None] | None = None,
    names: tuple[str, ...] | None = None,
    cache: Path | None = None,
    compiler: str | None = None,
    backend: str = "auto",
) -> Library:
    """Return the robot's library; derive, generate and compile it if it is not in the cache.

    Args:
        robot: its log mapping and processing take no part.
        progress: told what is being done, if something has to be done.
        names: functions to include; None for all.
        cache: folder of the cache; None for `find_cache_folder()`, and if that cannot be written, a
            temporary folder, of which a notice tells.
        compiler: command of the C compiler; None for the first of cc, gcc, clang.
        backend: what computes the functions: "c"; "python" for NumPy; "casadi" for the C of CasADi, or where
            there is no compiler for its virtual machine, of which a notice tells; "auto" for C, or where
            there is no compiler for NumPy, of which a notice tells.

    Raises:
        RobotError: the robot is not supported.
        UsageError: there is no such backend.
        GenerationError: the compiler fails on generated code, or there is none and the backend is "c".
        OutputError: the folder `cache`, or the temporary one, cannot be written.
    """
    if backend not in BACKENDS:
        text = f"backend: expected one of {', '.join(BACKENDS)}, got {backend!r}"
        raise UsageError(Notice(code="usage.backend", text=text))
    found = None if backend == "python" else find_compiler(compiler, native=True)
    order = _Order(
        robot=robot,
        names=names,
        compiler=found,
        progress=progress or (lambda _: None),
        casadi=backend == "casadi",
    )
    if backend == "python":
        return _load(order, cache)
    if found is None:
        return _fall_back(order, backend, cache, "codegen.no-compiler", _find_missing(compiler))
    try:
        return _load(order, cache)
    except GenerationError:
        fault = find_fault(found)
        if not fault:
            raise
    # Not the generated code is at fault but the compiler, for example one without the C library's headers.
    reason = f"the C compiler cannot be used: {fault}"
    return _fall_back(order, backend, cache, "codegen.compiler-unusable", reason)


def _load(order: _Order, cache: Path | None, *notices: Notice) -> Library:
    calls = "" if order.casadi else find_call_path().name
    key = find_library_key(order.robot, order.names, order.compiler, calls=calls, casadi=order.casadi)
    library, more = _obtain(order, key) if cache is None else _obtain_entry(order, cache, key)
    library.notices = (*more, *notices)
    return library
