"""Compiled libraries are kept in the user's cache folder, by a signature of all that they were made from.

An entry is a folder that appears by one rename. It is used only if every file still has its digest, the user
alone owns and may write it, and it loads. Else it is made again, with a notice.

Supported: the XDG base directory specification; users without a home, who get a private temporary folder;
several processes at once; machines without a compiler, which get the NumPy module or CasADi's virtual
machine; one cache for machines of many kinds.
Not supported: removal of old entries (the folder may be deleted at any time); guarding against who may
write to the folders above the cache, against the user, or against root.
"""

import contextlib
import errno
import functools
import itertools
import json
import os
import platform
import secrets
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Generic, TypeVar

from filelock import BaseFileLock, FileLock, Timeout

from symid import __version__
from symid.codegen.compiler import (
    CANDIDATES,
    Compiler,
    allow_fusing,
    compile_sources,
    diagnose_compiler,
    locate_compiler,
)
from symid.codegen.functions import FOR_CONTROLLERS
from symid.codegen.library import Library, choose_call_path, load_library
from symid.codegen.source_folder import compute_digest, write_sources
from symid.codegen.source_text import BACKENDS, build_library_prefix, check_choice, read_template_bytes
from symid.environment import clear_scratch, mark_scratch
from symid.errors import GenerationError, Notice, OutputError, UsageError
from symid.robot import Limits, LogMap, Processing, Robot
from symid.serialization import compute_signature

T = TypeVar("T")

_WRITE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_SECONDS_A_DAY = 86400.0
_NEW = ".new-"
_LOCK_PATIENCE = 1.0
_PROCESS = f"{secrets.token_hex(4)}-"
"""In the names of this process's folders: without it they are of one before it that had its number."""


def locate_user_folder() -> Path | None:
    """Return `symid` in the user's cache folder, as the XDG specification has it; None without a home."""
    named = os.environ.get("XDG_CACHE_HOME", "")
    # The specification has relative paths ignored.
    if Path(named).is_absolute():
        return Path(named) / "symid"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    return home / ".cache" / "symid" if home.is_absolute() else None


def locate_cache_folder() -> Path:
    """Return the folder in which libraries are looked for first."""
    return locate_user_folder() or Path(tempfile.gettempdir()) / f"symid-{os.getuid()}"


def make_temporary_folder() -> Path:
    """Return this user's own folder among the temporary ones, closed to others; OSError where none can be."""
    folder = Path(tempfile.gettempdir()) / f"symid-{os.getuid()}"
    try:
        folder.mkdir(mode=stat.S_IRWXU)
    except FileExistsError:
        if not folder.is_dir() or describe_path_risk(folder) or not os.access(folder, os.W_OK):
            return Path(tempfile.mkdtemp(prefix="symid-"))
        # Only the user could write to it, so that its content is sound, but others could read it.
        if stat.S_IMODE(folder.stat().st_mode) != stat.S_IRWXU:
            folder.chmod(stat.S_IRWXU)
    return folder


def describe_path_risk(path: Path) -> str:
    """Return why others may have written `path` itself, or nothing."""
    found = path.lstat()
    if not (stat.S_ISDIR(found.st_mode) or stat.S_ISREG(found.st_mode)):
        return "is a link or no file"
    # Elsewhere than on POSIX, these numbers mean nothing.
    if not hasattr(os, "getuid"):
        return ""
    if found.st_uid != os.getuid():
        return "belongs to another user"
    return "may be written by others" if found.st_mode & _WRITE_BY_OTHERS else ""


def describe_entry_risk(entry: Path) -> str:
    """Return why others may have written a part of an entry of the cache, or nothing."""
    if weakness := describe_path_risk(entry):
        return f"it {weakness}"
    if not entry.is_dir():
        return "it is no folder"
    weak = ((path, describe_path_risk(path)) for path in sorted(entry.rglob("*")))
    return next((f"{path.relative_to(entry)} {weakness}" for path, weakness in weak if weakness), "")


def _is_held(lock: BaseFileLock, file: Path) -> bool:
    """Return whether `lock` is one on the file that now has the name, not on one that was removed."""
    handle = lock._context.lock_file_fd  # noqa: SLF001  filelock offers no other way to it
    try:
        # None: where the system has no such locks, the file itself is the lock.
        return handle is None or os.path.samestat(os.fstat(handle), file.lstat())
    except FileNotFoundError:
        return False


@contextlib.contextmanager
def lock_folder(folder: Path, progress: Callable[[], None]) -> Iterator[None]:
    """Wait until no other process of this user has `folder`, and keep it from others in the context.

    The lock is one of the system's on a file beside the folder or, where none can be written there, in the
    user's cache folder. The file is removed; the file of a process that died does not lock. The folder need
    not be there yet: missing folders above it are made, and removed if they stay empty. `progress` is called
    once where the wait takes longer than a second.

    Raises:
        OutputError: no file for the lock can be written.
    """
    target, tell = folder.resolve(), functools.cache(progress)
    missing = [place for place in target.parents if not place.exists()]
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        file = target.parent / f".{target.name}.symid-lock"
        if not os.access(target.parent, os.W_OK | os.X_OK):
            own = locate_user_folder()
            if own is None:
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(target.parent))
            own.mkdir(mode=stat.S_IRWXU, parents=True, exist_ok=True)
            file = own / f"{compute_digest(os.fsencode(target))[:24]}.lock"
        held = False
        while not held:
            lock = FileLock(file)
            # A run that failed removes the folders that it made.
            with contextlib.suppress(FileNotFoundError):
                target.parent.mkdir(parents=True, exist_ok=True)
                try:
                    lock.acquire(timeout=_LOCK_PATIENCE)
                except Timeout:
                    tell()
                    lock.acquire()
                held = _is_held(lock, file)
                if not held:
                    lock.release()
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        text = f"cannot be locked against other runs: {error.strerror or error}{where}"
        raise OutputError(Notice(code="output.cannot-write", text=text, file=str(folder))) from error
    try:
        yield
    finally:
        # The file goes while the lock is held: who waits for it sees by `_is_held` that it was removed.
        with contextlib.suppress(OSError):
            file.unlink()
        lock.release()
        with contextlib.suppress(OSError):
            for place in missing:
                place.rmdir()


_SEAL = "seal.json"
_HASHED_ROOMS = ("robot", "joint_models", "dynamics", "codegen")
_PACKAGE = Path(__file__).resolve().parent.parent


@dataclass(frozen=True, slots=True, kw_only=True)
class CacheEntry(Generic[T]):
    """What a folder of the cache holds: its name, and the signature `key` of all that it is made from.

    `make` writes it into a folder that is not there yet, `load` reads it, or raises SymidError.
    """

    name: str
    key: str
    make: Callable[[Path], None]
    load: Callable[[Path], T]


def _read_digests(folder: Path) -> dict[str, str]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != _SEAL)
    return {path.relative_to(folder).as_posix(): compute_digest(path.read_bytes()) for path in paths}


def _describe_damage(place: Path, key: str) -> str:
    """Return what is wrong with the entry at `place`, or nothing."""
    try:
        if risk := describe_entry_risk(place):
            return risk
        seal: object = json.loads((place / _SEAL).read_text(encoding="utf-8"))
        found = _read_digests(place)
    except (OSError, ValueError) as error:
        return f"its seal cannot be read ({type(error).__name__})"
    if not isinstance(seal, dict) or seal.get("key") != key:
        return "it belongs to other inputs"
    listed = seal.get("files")
    if not isinstance(listed, dict) or not listed:
        return "its seal lists no files"
    changed = sorted(path for path in listed.keys() | found.keys() if listed.get(path) != found.get(path))
    return f"changed since it was made: {', '.join(changed)}" if changed else ""


def _store_entry(entry: CacheEntry[T], place: Path) -> None:
    """Make the entry beside its place, and move it there by one rename; a sound one there is kept."""
    staging = place.parent / f"{mark_scratch(_NEW)}{_PROCESS}{secrets.token_hex(6)}"
    try:
        entry.make(staging)
        seal = {"key": entry.key, "files": _read_digests(staging)}
        (staging / _SEAL).write_text(json.dumps(seal, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        staging.chmod(stat.S_IRWXU)
        for path in staging.rglob("*"):
            # The user's umask may let others write.
            path.chmod(stat.S_IMODE(path.stat().st_mode) & ~_WRITE_BY_OTHERS)
        try:
            staging.rename(place)
        except OSError:
            # Another process may have been faster: what it made is as good.
            if _describe_damage(place, entry.key):
                raise
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _clear_scraps(folder: Path) -> None:
    """Remove what processes that were killed left behind: of this machine at once, of others after a day."""
    # Sources that are written into a new folder have scratch beside it, under its name with a dot.
    for before in (_NEW, f".{_NEW}"):
        clear_scratch(folder, before)
    own = mark_scratch(_NEW)
    here = own.removesuffix(f"{os.getpid()}-")
    for path in itertools.chain(*(folder.glob(name) for name in (f"{_NEW}*", f".{_NEW}*", ".old-*"))):
        name = path.name.removeprefix(".") if path.name.startswith("..") else path.name
        left = name.startswith(own) and not name.startswith(own + _PROCESS)
        # A clock that was set must not take their work from living processes.
        alive = name.startswith(here) and not left
        with contextlib.suppress(OSError):
            if left or (not alive and time.time() - path.lstat().st_mtime > _SECONDS_A_DAY):
                shutil.rmtree(path, ignore_errors=True)
    for path in folder.glob(".*.symid-lock"):
        lock = FileLock(path)
        with contextlib.suppress(OSError, Timeout, NotImplementedError):
            lock.acquire(timeout=0)
            # Who waits for it sees that the file is gone, and makes another.
            path.unlink(missing_ok=True)
            lock.release()


def _make_alone(entry: CacheEntry[T], place: Path) -> T:
    """Return what one process has made, while others that need the same wait for it."""
    with contextlib.ExitStack() as stack:
        # Where a file system has no locks, several make it, and the first one's stays.
        with contextlib.suppress(OutputError, NotImplementedError):
            stack.enter_context(lock_folder(place, lambda: None))
        if os.path.lexists(place) and not _describe_damage(place, entry.key):
            with contextlib.suppress(GenerationError, UsageError):
                return entry.load(place)
        tries = 3
        while True:
            _store_entry(entry, place)
            try:
                return entry.load(place)
            except (GenerationError, UsageError):
                # Another process that had found the damage too may just have cleared this entry away.
                tries -= 1
                if not tries or place.is_dir():
                    raise


def _obtain_from(entry: CacheEntry[T], folder: Path) -> tuple[T, tuple[Notice, ...]]:
    place = folder / f"{entry.name}-{entry.key[:24]}"
    try:
        folder.mkdir(mode=stat.S_IRWXU, parents=True, exist_ok=True)
        # A link to a folder is the user's choice, if the folder is the user's.
        resolved = folder.resolve()
        weakness = describe_path_risk(resolved)
        sticky = resolved.stat().st_mode & stat.S_ISVTX
        if weakness and not (sticky and weakness == "may be written by others"):
            text = f"the cache folder {weakness}; make it yours alone (chmod go-w), or name another one"
            raise OutputError(Notice(code="output.cache", text=text, file=str(folder)))
        damage = _describe_damage(place, entry.key) if os.path.lexists(place) else ""
        if os.path.lexists(place) and not damage:
            try:
                return entry.load(place), ()
            except (GenerationError, UsageError) as error:
                # It agrees with its seal; but who can write an entry can write its seal.
                damage = str(error)
        # Only a damaged one: another process may have stored a sound entry since.
        if damage:
            # After a rename, so that no process reads half of it.
            aside = folder / f".old-{secrets.token_hex(6)}"
            with contextlib.suppress(FileNotFoundError):
                place.rename(aside)
                if aside.is_dir() and not aside.is_symlink():
                    shutil.rmtree(aside, ignore_errors=True)
                else:
                    aside.unlink()
        _clear_scraps(place.parent)
        found = _make_alone(entry, place)
    except OSError as error:
        text = f"the cache folder cannot be written: {error.strerror or error}"
        raise OutputError(Notice(code="output.cache", text=text, file=str(folder))) from error
    if not damage:
        return found, ()
    text = f"the cached library was damaged and made again, which took its time: {damage}; check the disk"
    return found, (Notice(code="codegen.cache-rebuilt", text=text, file=str(place)),)


def obtain_entry(entry: CacheEntry[T], cache: Path | None) -> tuple[T, tuple[Notice, ...]]:
    """Return what is loaded from an entry, found or made now, and notices.

    `cache` is a folder; None for the user's, and if that cannot be written, a temporary one, with a notice.

    Raises:
        OutputError: the folder `cache`, or the temporary one, cannot be written.
    """
    if cache is not None:
        return _obtain_from(entry, cache)
    folder = locate_user_folder()
    if folder is None:
        reason = "there is no home folder to keep compiled libraries in"
    else:
        with contextlib.suppress(OSError):
            found = folder.stat()
            # The umask of many users lets their group write to what they make.
            if found.st_mode & _WRITE_BY_OTHERS and found.st_uid == os.getuid():
                folder.chmod(stat.S_IMODE(found.st_mode) & ~_WRITE_BY_OTHERS)
        try:
            return _obtain_from(entry, folder)
        except OutputError as error:
            reason = str(error)
    try:
        temporary = make_temporary_folder()
    except OSError as error:
        text = f"{reason}; nor is there a place for temporary files: {error.strerror or error}"
        raise OutputError(Notice(code="output.cache", text=text)) from error
    loaded, notices = _obtain_from(entry, temporary)
    text = f"{reason}; libraries are kept in this temporary folder; set XDG_CACHE_HOME to a folder of yours"
    return loaded, (Notice(code="codegen.cache-temporary", text=text, file=str(temporary)), *notices)


@functools.cache
def _read_code_bytes() -> tuple[tuple[str, bytes], ...]:
    folders = (_PACKAGE, *(_PACKAGE / room for room in _HASHED_ROOMS))
    paths = [path for folder in folders for path in sorted(folder.glob("*.py"))]
    return tuple((path.relative_to(_PACKAGE).as_posix(), path.read_bytes()) for path in paths)


def keep_dynamics(robot: Robot) -> Robot:
    """Return what the functions of a robot depend on: it without limits, controller, logs, names of files."""
    plain = [
        replace(joint, limits=Limits(), drive=replace(joint.drive, torque_constant=None, direct=False))
        for joint in robot.joints
    ]
    model = replace(robot, joints=tuple(plain), log=LogMap(), processing=Processing(), controller=None)
    return replace(model, convention="", description="", source="", path="", notices=(), fixed=())


def compute_library_key(
    robot: Robot,
    names: tuple[str, ...] | None,
    compiler: Compiler | None,
    *,
    calls: str = "",
    casadi: bool = False,
) -> str:
    """Return the signature of all that a library is made from.

    What the functions do not depend on takes no part, see `keep_dynamics`. `names` are those of functions, as
    in `prepare_library`, `calls` says how Python calls them, `casadi` whether CasADi computes them.
    """
    model = keep_dynamics(robot)
    tools = (__version__, *map(version, ("casadi", "sympy", "mpmath")))
    built_by = (compiler or f"python {sys.version_info.major}.{sys.version_info.minor}", calls, casadi)
    # A library that was linked with a newer C library may not load with an older one.
    named = "CS_GNU_LIBC_VERSION" in getattr(os, "confstr_names", ())
    machine = (platform.system(), platform.machine(), os.confstr("CS_GNU_LIBC_VERSION") if named else "")
    templates = read_template_bytes("c", "python", "casadi")
    return compute_signature(model, names, tools, machine, templates, _read_code_bytes(), built_by)


def prepare_library(
    robot: Robot,
    *,
    progress: Callable[[str], None] | None = None,
    names: tuple[str, ...] | None = None,
    cache: Path | None = None,
    compiler: str | None = None,
    backend: str = "auto",
    fused: bool = False,
) -> Library:
    """Return the robot's library; derive, generate and compile it if it is not in the cache.

    Args:
        robot: its log mapping and processing take no part.
        progress: called with what is being done, if something has to be done.
        names: functions to include; None for those that symid's own methods call.
        cache: folder of the cache; None for `locate_cache_folder()`, and if that cannot be written, a
            temporary folder, with a notice.
        compiler: command of the C compiler; None for the first of cc, gcc, clang.
        backend: what computes the functions: "c"; "python" for NumPy; "casadi" for the C of CasADi, or its
            virtual machine where there is no compiler; "auto" for C, or NumPy where there is no compiler.
            A notice names the fallback.
        fused: let the C compiler round a product and a sum once, see `allow_fusing`; a library of its own.

    Raises:
        RobotError: the robot is not supported.
        UsageError: there is no such backend.
        GenerationError: the compiler fails on generated code, or the backend is "c" and there is no compiler.
        OutputError: the folder `cache`, or the temporary one, cannot be written.
    """
    check_choice("backend", backend, BACKENDS)
    casadi, report = backend == "casadi", progress or (lambda _: None)
    prefix, without = build_library_prefix(robot.name), FOR_CONTROLLERS if names is None else ()

    def obtain(compiler: Compiler | None, *notices: Notice) -> Library:
        calls = "" if casadi else choose_call_path().name
        key = compute_library_key(robot, names, compiler, calls=calls, casadi=casadi)

        def make(folder: Path) -> None:
            # Imported here: a library that is found needs neither CasADi nor SymPy.
            from symid.codegen import python_targets as targets
            from symid.codegen.c_library import generate_c_library, write_python_call
            from symid.codegen.casadi_functions import build_functions

            report(f"deriving the dynamics of {robot.name}")
            functions = build_functions(robot, names=names, without=without)
            flags: tuple[str, ...] = ()
            if casadi:
                report("writing CasADi functions and their C")
                write_sources(targets.generate_casadi_target(functions), folder)
                # Without Jacobians, which a `Library` does not have.
                sources = [folder / path for path in targets.list_casadi_sources(prefix)]
            elif compiler is None:
                report("writing the NumPy module")
                write_sources(targets.generate_python_module(functions), folder)
            else:
                report("writing C")
                paths = write_sources(generate_c_library(functions), folder)
                sources = [path for path in paths if path.match(f"{prefix}_*.c")]
                flags = choose_call_path().flags
                if flags:
                    sources.append(folder / "python_call.c")
                    sources[-1].write_text(write_python_call(functions.card, prefix), encoding="utf-8")
            if compiler is not None:
                report(f"compiling with {compiler.path}")
                binary = folder / f"lib{prefix}{'_casadi' if casadi else ''}.so"
                builder = replace(compiler, flags=(*compiler.flags, *flags))
                compile_sources(builder, sources, binary, straight=True)

        library, more = obtain_entry(CacheEntry(name=prefix, key=key, make=make, load=load_library), cache)
        library.notices = (*more, *notices)
        return library

    if backend == "python":
        return obtain(None)
    found = locate_compiler(compiler, native=True)
    if found is None:
        missing = f"the C compiler {compiler!r}" if compiler else f"a C compiler ({', '.join(CANDIDATES)})"
        code, reason = "codegen.no-compiler", f"{missing} was not found"
    else:
        try:
            return obtain(allow_fusing(found) if fused else found)
        except GenerationError:
            fault = diagnose_compiler(found)
            if not fault:
                raise
        # The compiler is at fault, not the generated code: for example one without the C library's headers.
        code, reason = "codegen.compiler-unusable", f"the C compiler cannot be used: {fault}"
    if backend == "c":
        text = f"{reason}; give another backend than {backend!r}, or see `symid doctor`"
        raise GenerationError(Notice(code=code, text=text))
    slower = "CasADi's virtual machine" if casadi else "the NumPy module"
    notice = Notice(code=code, text=f"{reason}: {slower} is used, which is slower; see `symid doctor`")
    return obtain(None, notice)
