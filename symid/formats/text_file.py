"""The text of a file that describes a robot.

Input: a path. Output: its text, without the mark of its encoding; or a notice what is wrong with the file.

Supported: UTF-8.
"""

from pathlib import Path

from symid.errors import Notice, RobotError

__all__ = ["read_text_file"]


def read_text_file(path: Path) -> str:
    """Return the text of the file at `path`.

    Raises:
        RobotError: it cannot be read, or is not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        text = f"cannot be read: {error.strerror or 'it cannot be read'}"
        raise RobotError(Notice(code="robot.unreadable", text=text, file=str(path))) from error
    except UnicodeDecodeError as error:
        text = f"not UTF-8 text (byte {error.start}); save the file as UTF-8"
        raise RobotError(Notice(code="robot.unreadable", text=text, file=str(path))) from error
