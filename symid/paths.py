"""Paths as people type them, and the endings that say how a file is written."""

from collections.abc import Iterable
from pathlib import Path

from symid.errors import Notice, OutputError

__all__ = ["check_suffix", "show_path"]


def show_path(path: Path) -> str:
    """Return the path as people type it: relative, where it is below the working folder."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


def check_suffix(path: Path, what: str, known: Iterable[str]) -> str:
    """Return the ending of a file that is to be written, in lower case.

    Args:
        path: of the file.
        what: is written, for the message, such as "a log".
        known: endings, with their dots.

    Raises:
        OutputError: it is another one.
    """
    suffix = path.suffix.lower()
    if suffix not in known:
        text = f"{what} is written as {' or '.join(known)}, got {path.suffix or 'no suffix'}"
        raise OutputError(Notice(code="output.unknown-suffix", text=text, file=str(path)))
    return suffix
