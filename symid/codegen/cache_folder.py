"""Where libraries are kept: the user's cache folder, or a private temporary one where that cannot be.

What is in such a folder is run. A digest beside a file tells of accidents, not of malice: who can write the
one can write the other. What keeps others out is who owns the files and who may write them, so that is
looked at: of the folder, of each entry, and of all in it.

Supported: the XDG base directory specification; users without a home.
Not supported: a temporary folder that somebody else made or may write; another one is made then. Guarding
against who may write to the folders above the cache, against the user, or against root.
"""

import contextlib
import os
import secrets
import shutil
import stat
import tempfile
import time
from pathlib import Path

from symid.errors import Notice, OutputError

__all__ = [
    "clear_away",
    "clear_remains",
    "close_entry",
    "close_folder",
    "find_cache_folder",
    "find_distrust",
    "find_user_folder",
    "find_weakness",
    "make_cache_folder",
    "make_temporary_folder",
]

_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_DAY = 86400.0


def find_user_folder() -> Path | None:
    """Return `symid` in the user's cache folder, as the XDG specification has it; None without a home."""
    named = os.environ.get("XDG_CACHE_HOME", "")
    # A relative path there is to be ignored, says the specification.
    if Path(named).is_absolute():
        return Path(named) / "symid"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    return home / ".cache" / "symid" if home.is_absolute() else None


def _name_temporary_folder() -> Path:
    return Path(tempfile.gettempdir()) / f"symid-{os.getuid()}"


def find_cache_folder() -> Path:
    """Return the folder in which libraries are looked for first."""
    return find_user_folder() or _name_temporary_folder()


def _is_private(folder: Path, user: int) -> bool:
    found = folder.lstat()
    others = stat.S_IMODE(found.st_mode) & (stat.S_IRWXG | stat.S_IRWXO)
    return stat.S_ISDIR(found.st_mode) and found.st_uid == user and not others


def make_temporary_folder() -> Path:
    """Return this user's own folder among the temporary ones; what is loaded from it nobody else wrote.

    Raises:
        OSError: there is no place for temporary files.
    """
    folder = _name_temporary_folder()
    try:
        folder.mkdir(mode=stat.S_IRWXU)
    except FileExistsError:
        if not _is_private(folder, os.getuid()) or not os.access(folder, os.W_OK):
            return Path(tempfile.mkdtemp(prefix="symid-"))
    return folder


def find_weakness(path: Path) -> str:
    """Return why what is at `path`, itself, may be the work of others, or nothing.

    Raises:
        OSError: it cannot be looked at.
    """
    found = path.lstat()
    if not (stat.S_ISDIR(found.st_mode) or stat.S_ISREG(found.st_mode)):
        return "is a link or no file"
    # Elsewhere than on POSIX, these numbers mean nothing.
    if not hasattr(os, "getuid"):
        return ""
    if found.st_uid != os.getuid():
        return "belongs to another user"
    return "may be written by others" if found.st_mode & _OTHERS else ""


def find_distrust(entry: Path) -> str:
    """Return why what an entry of the cache holds may be the work of others, or nothing.

    Raises:
        OSError: it cannot be looked at.
    """
    if weakness := find_weakness(entry):
        return f"it {weakness}"
    if not entry.is_dir():
        return "it is no folder"
    weak = ((path, find_weakness(path)) for path in sorted(entry.rglob("*")))
    return next((f"{path.relative_to(entry)} {weakness}" for path, weakness in weak if weakness), "")


def close_folder(folder: Path) -> None:
    """Take from others the right to write to the user's cache folder, if it is there and can be."""
    with contextlib.suppress(OSError):
        found = folder.stat()
        if found.st_mode & _OTHERS and found.st_uid == os.getuid():
            folder.chmod(stat.S_IMODE(found.st_mode) & ~_OTHERS)


def make_cache_folder(folder: Path) -> None:
    """Make the folder of the cache, closed to others, if it is not there.

    Raises:
        OSError: it cannot be made.
        OutputError: others could put entries of theirs in the place of the user's.
    """
    folder.mkdir(mode=stat.S_IRWXU, parents=True, exist_ok=True)
    # A link to a folder is the user's choice, if the folder is the user's.
    place = folder.resolve()
    weakness = find_weakness(place)
    sticky = place.stat().st_mode & stat.S_ISVTX
    if weakness and not (sticky and weakness == "may be written by others"):
        text = f"the cache folder {weakness}; make it yours alone (chmod go-w), or name another one"
        raise OutputError(Notice(code="output.cache", text=text, file=str(folder)))


def close_entry(entry: Path) -> None:
    """Take from others the right to write to an entry, which a user's umask may have left them."""
    entry.chmod(stat.S_IRWXU)
    for path in entry.rglob("*"):
        path.chmod(stat.S_IMODE(path.stat().st_mode) & ~_OTHERS)


def clear_away(path: Path) -> None:
    """Move what is at `path` out of the way, then remove it: nobody sees half of it."""
    aside = path.parent / f".old-{secrets.token_hex(6)}"
    with contextlib.suppress(FileNotFoundError):
        path.rename(aside)
        if aside.is_dir() and not aside.is_symlink():
            shutil.rmtree(aside, ignore_errors=True)
        else:
            aside.unlink()


def clear_remains(folder: Path) -> None:
    """Remove what processes that were killed left behind a day ago or more."""
    for path in (*folder.glob(".new-*"), *folder.glob(".old-*")):
        with contextlib.suppress(OSError):
            if time.time() - path.lstat().st_mtime > _DAY:
                shutil.rmtree(path, ignore_errors=True)
