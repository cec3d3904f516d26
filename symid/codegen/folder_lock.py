"""One writer at a time: a folder is locked while it is checked, written and tested.

Input: the folder. Output: nothing; a context in which no other process that asks has the folder.

The lock is one of the system's on a hidden file beside the folder, so that a process that dies leaves none
behind; the file is removed by whoever had it. Where no file can be made there, the folder itself is locked:
it is not going to change places with another one then.

Supported: Linux, macOS, BSD, threads as well as processes.
Not supported: systems and file systems without such locks; there nobody waits.
"""

import contextlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

if sys.platform != "win32":
    import fcntl

__all__ = ["lock_folder"]

_PATIENCE = 1.0
_STEP = 0.05
_TRIES = 100


def _make_parents(folder: Path) -> list[Path]:
    """Make the folder's parents and return those that were missing, the innermost first."""
    missing = [parent for parent in folder.parents if not parent.exists()]
    folder.parent.mkdir(parents=True, exist_ok=True)
    return missing


def _open(path: Path, folder: Path, made: list[Path]) -> int | None:
    """Open what is to be locked, its parents made if need be; nothing where that cannot be."""
    # Some file systems, such as /proc, make nothing and say that the parent is missing, ever again.
    for _ in range(_TRIES):
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


def _try(handle: int) -> bool:
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


def _is_same(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except OSError:
        return False


def _is_there(handle: int, path: Path, folder: Path) -> bool:
    """Return whether what was locked still has its name: who had it before may have removed it."""
    return any(_is_same(handle, place) for place in (path, folder))


def _acquire(path: Path, folder: Path, made: list[Path], tell: Callable[[], None]) -> int | None:
    started, told = time.monotonic(), False
    while (handle := _open(path, folder, made)) is not None:
        while not _try(handle):
            if not told and time.monotonic() - started > _PATIENCE:
                tell()
                told = True
            time.sleep(_STEP)
        if _is_there(handle, path, folder):
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
    handle = _acquire(path, target, made, tell)
    try:
        yield
    finally:
        # Removed while it is locked: who waits for it sees that it has no name any more, and makes another.
        if handle is not None:
            with contextlib.suppress(OSError):
                if _is_same(handle, path):
                    path.unlink()
            os.close(handle)
        for parent in sorted(set(made), reverse=True):
            with contextlib.suppress(OSError):
                parent.rmdir()
