"""Where libraries are kept: the user's cache folder, or a private temporary one where that cannot be.

Supported: the XDG base directory specification; users without a home.
Not supported: a temporary folder that somebody else made or may write; another one is made then.
"""

import os
import stat
import tempfile
from pathlib import Path

__all__ = ["find_cache_folder", "find_user_folder", "make_temporary_folder"]


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
