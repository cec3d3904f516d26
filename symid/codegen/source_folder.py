"""Generated sources, and how they reach a folder.

`SourceSet` -> files on disk with a manifest that names them; at any moment the folder holds the old files
or the new ones.

A new folder appears by one rename. One that symid wrote before changes places with a new one (renameat2 on
Linux, renamex_np on macOS), in which the files of others are the same. Where that cannot be, on systems
without such a call, for the working folder and for mounted ones, files are moved in one by one, the
manifest last.

One process at a time writes a folder. The lock is one of the system's on a hidden file beside the folder,
so that a process that dies leaves none behind. Where no file can be made there, the folder itself is
locked: it does not change places with another one then.

Supported: new folders, empty ones, and folders that symid wrote before; Linux, macOS, BSD, threads as well
as processes.
Not supported: writing over files that symid did not write, or that were edited since; waiting on systems
and file systems without locks.
"""

import contextlib
import ctypes
import errno
import hashlib
import json
import os
import secrets
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from symid.errors import Notice, OutputError

_AT_WORKING_FOLDER = -100
_RENAME_EXCHANGE = 2


def exchange_folders(first: Path, second: Path) -> bool:
    """Let two folders change places; nobody ever sees one of the names without a folder."""
    library = ctypes.CDLL(None, use_errno=True)
    names = (os.fsencode(first), os.fsencode(second))
    if sys.platform.startswith("linux") and hasattr(library, "renameat2"):
        return bool(
            library.renameat2(_AT_WORKING_FOLDER, names[0], _AT_WORKING_FOLDER, names[1], _RENAME_EXCHANGE)
            == 0
        )
    if sys.platform == "darwin" and hasattr(library, "renamex_np"):
        return bool(library.renamex_np(names[0], names[1], _RENAME_EXCHANGE) == 0)
    return False


def sync_to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, would outlast a power cut.

    Raises:
        OSError: the disk says that it cannot.
    """
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # Some file systems have no such thing for folders.
        if error.errno not in {errno.EINVAL, errno.ENOTSUP}:
            raise
    finally:
        os.close(handle)


def copy_owner(source: Path, target: Path) -> None:
    """Let `target` belong to whom `source` belongs.

    Raises:
        OSError: this user may not give it away.
    """
    wanted, found = source.stat(), target.stat()
    if (wanted.st_uid, wanted.st_gid) != (found.st_uid, found.st_gid):
        os.chown(target, wanted.st_uid, wanted.st_gid)


def link_missing(source: Path, target: Path, left_out: frozenset[Path] = frozenset()) -> bool:
    """Give `target` what `source` has and it has not; files are the same ones under two names.

    Args:
        source: a folder.
        target: a folder on the same file system.
        left_out: paths in `source`, relative to it, that do not go along.

    Returns:
        Whether all could go along; what is neither file, folder nor symbolic link cannot.

    Raises:
        OSError: a file cannot have a second name.
    """
    whole = True
    for entry in sorted(source.iterdir()):
        place = target / entry.name
        within = (path for path in left_out if path.parts[:1] == (entry.name,))
        inner = frozenset(path.relative_to(entry.name) for path in within)
        if Path() in inner:
            continue
        if entry.is_dir() and not entry.is_symlink():
            new = not place.exists()
            place.mkdir(exist_ok=True)
            whole = link_missing(entry, place, inner) and whole
            if new:
                copy_owner(entry, place)
                shutil.copystat(entry, place)
        elif not os.path.lexists(place):
            whole = whole and (entry.is_symlink() or entry.is_file())
            if whole:
                os.link(entry, place, follow_symlinks=False)
    return whole


if sys.platform != "win32":
    import fcntl


_LOCK_PATIENCE = 1.0
_LOCK_STEP = 0.05
_LOCK_TRIES = 100


def _make_parents(folder: Path) -> list[Path]:
    """Make the folder's parents and return those that were missing, the innermost first."""
    missing = [parent for parent in folder.parents if not parent.exists()]
    folder.parent.mkdir(parents=True, exist_ok=True)
    return missing


def _open_lock_file(path: Path, folder: Path, made: list[Path]) -> int | None:
    """Open what is to be locked, its parents made if need be; nothing where that cannot be."""
    # Some file systems, such as /proc, make nothing and say that the parent is missing, ever again.
    for _ in range(_LOCK_TRIES):
        try:
            made += _make_parents(folder)
            # For reading, which is enough for a lock: it may be another user's.
            return os.open(path, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except (FileNotFoundError, FileExistsError):
            # Who made the parents, too, has just removed them; a file in their place stays.
            if any(parent.is_file() for parent in folder.parents):
                break
        except OSError:
            break
    with contextlib.suppress(OSError):
        return os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    return None


def _try_lock(handle: int) -> bool:
    """Return whether there is nothing more to wait for."""
    if sys.platform == "win32":
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True  # not on this file system
    return True


def _is_same_file(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except OSError:
        return False


def _is_lock_current(handle: int, path: Path, folder: Path) -> bool:
    """Return whether what was locked still has its name: who had it before may have removed it."""
    return any(_is_same_file(handle, place) for place in (path, folder))


def _acquire_lock(path: Path, folder: Path, made: list[Path], tell: Callable[[], None]) -> int | None:
    started, told = time.monotonic(), False
    while (handle := _open_lock_file(path, folder, made)) is not None:
        while not _try_lock(handle):
            if not told and time.monotonic() - started > _LOCK_PATIENCE:
                tell()
                told = True
            time.sleep(_LOCK_STEP)
        if _is_lock_current(handle, path, folder):
            return handle
        os.close(handle)
    return None


@contextlib.contextmanager
def lock_folder(folder: Path, tell: Callable[[], None]) -> Iterator[None]:
    """Wait until no other process has `folder`, and keep it from others in the context.

    Args:
        folder: it need not be there yet; parents that nothing came into are removed again.
        tell: called once where the wait takes longer than a second.
    """
    target = folder.resolve()
    path = target.parent / f".{target.name}.symid-lock"
    made: list[Path] = []
    handle = _acquire_lock(path, target, made, tell)
    try:
        yield
    finally:
        # Removed while it is locked: who waits for it sees that it has no name any more, and makes another.
        if handle is not None:
            with contextlib.suppress(OSError):
                if _is_same_file(handle, path):
                    path.unlink()
            os.close(handle)
        for parent in sorted(set(made), reverse=True):
            with contextlib.suppress(OSError):
                parent.rmdir()


MANIFEST = "manifest.json"
_UPDATE_PREFIX = ".symid-update-"
_SYNC_WORKERS = 16

# The digests that a file may have to be as symid wrote it, by its path in the folder.
ListedDigests = Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceSet:
    """Files by their path in the folder, and the text of the manifest that lists them."""

    name: str
    files: tuple[tuple[str, str], ...]
    manifest: str


def compute_digest(content: bytes) -> str:
    """Return the SHA-256 of `content` in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def read_manifest(folder: Path) -> Mapping[str, object] | None:
    """Return the manifest in `folder`, or None where there is none that symid wrote."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    ours = isinstance(manifest, dict) and "symid" in manifest and isinstance(manifest.get("files"), dict)
    return manifest if ours else None


def get_listed_digests(manifest: Mapping[str, object]) -> dict[str, str]:
    """Return the digests of the files that a manifest lists, by their path in the folder."""
    files = manifest.get("files")
    listed = files.items() if isinstance(files, dict) else ()
    return {str(path): str(digest) for path, digest in listed if _is_inside(str(path))}


def _read_listed_digests(folder: Path) -> ListedDigests | None:
    """Return the digests of what symid wrote into `folder`, None if it never did.

    An update that was interrupted leaves the manifest of its files in a folder of its own: until the
    next update succeeds, a file may be as the old manifest or as that one says.
    """
    manifests = [read_manifest(place) for place in (folder, *_list_interrupted_updates(folder))]
    found = [get_listed_digests(manifest) for manifest in manifests if manifest is not None]
    if not found:
        return None
    paths = sorted({path for files in found for path in files})
    return {path: tuple(files[path] for files in found if path in files) for path in paths}


def _list_interrupted_updates(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"{_UPDATE_PREFIX}*")) if folder.is_dir() else []


def _is_inside(path: str) -> bool:
    return not Path(path).is_absolute() and ".." not in Path(path).parts


def is_unchanged(folder: Path, manifest: Mapping[str, object]) -> bool:
    """Return whether every file that `manifest` lists is as it says, and no update was interrupted."""
    try:
        found = (
            compute_digest((folder / path).read_bytes()) == d
            for path, d in get_listed_digests(manifest).items()
        )
        return all(found) and not _list_interrupted_updates(folder)
    except OSError:
        return False


def write_manifest_text(text: str, folder: Path) -> None:
    """Put another manifest into a folder that symid wrote, in one step.

    Raises:
        OutputError: it cannot be written.
    """
    target = folder.resolve()
    staging = target / f"{_UPDATE_PREFIX}{secrets.token_hex(6)}"
    try:
        staging.mkdir()
        (staging / MANIFEST).write_bytes(text.encode())
        sync_to_disk(staging / MANIFEST)
        with contextlib.suppress(OSError):
            copy_owner(target / MANIFEST, staging / MANIFEST)
        (staging / MANIFEST).replace(target / MANIFEST)
        sync_to_disk(target)
    except OSError as error:
        raise _build_write_error(error, folder) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _build_write_error(error: OSError, folder: Path) -> OutputError:
    text = f"cannot be written: {error.strerror or error}"
    return OutputError(Notice(code="output.cannot-write", text=text, file=str(folder)))


def _check_folder(folder: Path, listed: ListedDigests | None, *, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        text = "is a file, not a folder; give the name of a folder"
        raise OutputError(Notice(code="output.not-a-folder", text=text, file=str(folder)))
    if listed is not None or force or not folder.is_dir():
        return
    if set(folder.iterdir()) - set(_list_interrupted_updates(folder)):
        text = "is not empty and holds no manifest of symid; give an empty folder, or force"
        raise OutputError(Notice(code="output.foreign-folder", text=text, file=str(folder)))


def _check_files(folder: Path, sources: SourceSet, listed: ListedDigests, *, force: bool) -> None:
    notices = []
    for path, text in (*sources.files, (MANIFEST, sources.manifest)):
        target = folder / path
        if not os.path.lexists(target) or (path == MANIFEST and listed):
            continue
        found = compute_digest(target.read_bytes()) if target.is_file() and not target.is_symlink() else ""
        if found == compute_digest(text.encode()):
            continue
        if path not in listed:
            why = "stands in the way and was not written by symid; move it, or give another folder"
            notices.append(Notice(code="output.foreign-file", text=why, file=str(target)))
        elif found not in listed[path] and not force:
            why = "was edited since symid wrote it; move it, or force to lose the changes"
            notices.append(Notice(code="output.edited-file", text=why, file=str(target)))
    if notices:
        raise OutputError(*notices)


def _write_staging(sources: SourceSet, staging: Path) -> None:
    staging.mkdir(parents=True)
    # The manifest first: what is left of an interrupted update says what it was about to write.
    for path, text in ((MANIFEST, sources.manifest), *sources.files):
        target = staging / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(text.encode())
    # All are written by now: the disk takes them at once, which is faster than one after another.
    with ThreadPoolExecutor(_SYNC_WORKERS) as pool:
        tuple(pool.map(sync_to_disk, (*staging.rglob("*"), staging)))


def _copy_owner_to_all(folder: Path, staging: Path) -> None:
    """Let what was made for `folder` belong to whom it belongs."""
    for path in (staging, *sorted(staging.rglob("*"))):
        copy_owner(folder, path)


def _list_stale_files(folder: Path, sources: SourceSet, listed: ListedDigests) -> list[Path]:
    """Return the files of the last run that this one does not write, if nobody changed them."""
    kept = {path for path, _ in sources.files}
    stale = []
    for path, digests in sorted(listed.items()):
        target = folder / path
        if path not in kept and target.is_file() and compute_digest(target.read_bytes()) in digests:
            stale.append(target)
    return stale


def _remove_stale_files(folder: Path, sources: SourceSet, listed: ListedDigests) -> None:
    for path in _list_stale_files(folder, sources, listed):
        path.unlink()


def _is_in_use(folder: Path) -> bool:
    """Return whether this process works in `folder`, which must then stay the same one."""
    try:
        return Path.cwd().is_relative_to(folder)
    except OSError:
        return True


def _list_folders(folder: Path) -> list[Path]:
    """Return `folder` and those in it, which name its files."""
    inner = (path for path in sorted(folder.rglob("*")) if path.is_dir() and not path.is_symlink())
    return [folder, *inner]


def _exchange_folder(sources: SourceSet, folder: Path, listed: ListedDigests) -> bool:
    """Write a new folder with the files of others in it, and let it change places with `folder`."""
    if _is_in_use(folder):
        return False
    staging = folder.parent / f".{folder.name}-{secrets.token_hex(6)}"
    dropped = [*_list_stale_files(folder, sources, listed), *_list_interrupted_updates(folder)]
    left_out = frozenset(path.relative_to(folder) for path in dropped)
    try:
        _write_staging(sources, staging)
        _copy_owner_to_all(folder, staging)
        if not link_missing(folder, staging, left_out):
            return False
        shutil.copystat(folder, staging)
        for place in _list_folders(staging):
            sync_to_disk(place)
        if not exchange_folders(folder, staging):
            return False
        with contextlib.suppress(OSError):
            sync_to_disk(folder.parent)
        # What somebody put there in the meantime; where that fails, the new folder is whole all the same.
        with contextlib.suppress(OSError):
            link_missing(staging, folder, left_out)
    except OSError:
        return False
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return True


def _write_folder(sources: SourceSet, folder: Path) -> None:
    """Make `folder` by one rename: it is there with all its files, or not at all."""
    staging = folder.parent / f".{folder.name}-{secrets.token_hex(6)}"
    try:
        _write_staging(sources, staging)
        staging.rename(folder)
        with contextlib.suppress(OSError):
            sync_to_disk(folder.parent)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _update_folder(sources: SourceSet, folder: Path, listed: ListedDigests) -> None:
    """Move the files into `folder` one by one; the folder itself stays what it is."""
    remains = _list_interrupted_updates(folder)
    staging = folder / f"{_UPDATE_PREFIX}{secrets.token_hex(6)}"
    moved = False
    try:
        _write_staging(sources, staging)
        # Who may not give files away leaves them to the user who ran this.
        with contextlib.suppress(OSError):
            _copy_owner_to_all(folder, staging)
        for path, _ in sources.files:
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            moved = True
            (staging / path).replace(folder / path)
        _remove_stale_files(folder, sources, listed)
        for place in sorted({(folder / path).parent for path, _ in sources.files}):
            sync_to_disk(place)
        # Last: until here the old manifest and the one in the staging folder speak for the files.
        (staging / MANIFEST).replace(folder / MANIFEST)
        sync_to_disk(folder)
    except BaseException:
        if not moved:
            shutil.rmtree(staging, ignore_errors=True)
        raise
    for place in (staging, *remains):
        shutil.rmtree(place, ignore_errors=True)


def write_sources(sources: SourceSet, folder: Path, *, force: bool = False) -> tuple[Path, ...]:
    """Write `sources` into `folder` and return the paths of the files, the manifest last.

    Files that the last run wrote and this one does not are removed if nobody changed them. With
    `force`, a folder that is not empty is accepted and edited files are written anew; a file that
    symid did not write is never touched.

    Raises:
        OutputError: the folder or a file in it is not ours, or cannot be written.
    """
    listed = _read_listed_digests(folder)
    _check_folder(folder, listed, force=force)
    _check_files(folder, sources, listed or {}, force=force)
    target = folder.resolve()
    try:
        if not target.is_dir():
            _write_folder(sources, target)
        elif listed is None or not _exchange_folder(sources, target, listed):
            _update_folder(sources, target, listed or {})
    except OSError as error:
        raise _build_write_error(error, folder) from error
    return tuple(folder / path for path, _ in (*sources.files, (MANIFEST, "")))
