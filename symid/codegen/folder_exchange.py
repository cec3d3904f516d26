"""Two folders change places in one step, what of one goes along into the other, and what is on the disk.

Input: two folders of one file system. Output: whether they changed places.

Supported: Linux (renameat2) and macOS (renamex_np), on file systems that can.
Not supported: other systems; folders on which something is mounted. There the answer is no.
"""

import ctypes
import errno
import os
import shutil
import sys
from pathlib import Path

__all__ = ["copy_owner", "exchange_folders", "link_missing", "write_through"]

_HERE = -100
_EXCHANGE = 2


def exchange_folders(first: Path, second: Path) -> bool:
    """Let two folders change places; nobody ever sees one of the names without a folder."""
    library = ctypes.CDLL(None, use_errno=True)
    names = (os.fsencode(first), os.fsencode(second))
    if sys.platform.startswith("linux") and hasattr(library, "renameat2"):
        return bool(library.renameat2(_HERE, names[0], _HERE, names[1], _EXCHANGE) == 0)
    if sys.platform == "darwin" and hasattr(library, "renamex_np"):
        return bool(library.renamex_np(names[0], names[1], _EXCHANGE) == 0)
    return False


def write_through(path: Path) -> None:
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
