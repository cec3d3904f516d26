"""Where robot files are: in a path, in ./robots, or among those that come with symid.

Input: a path or a name. Output: the path of a robot file, TOML or URDF.
"""

import codecs
import difflib
import os
from pathlib import Path

from symid.errors import Notice, UsageError
from symid.resources import find_resource_folder

__all__ = ["find_robot_file", "is_urdf", "list_robots"]

_SUFFIX = ".toml"
_HEAD = 4096
_URDF_SUFFIXES = (".urdf", ".xml", ".xacro")


def _find_folders() -> tuple[Path, ...]:
    return (Path("robots"), find_resource_folder("robots"))


def is_urdf(path: Path) -> bool:
    """Return whether a file is a URDF, or a xacro file, which is refused as such.

    Its name says so, or its first letter: TOML never begins with <, and XML always does.
    """
    return path.suffix.lower() in _URDF_SUFFIXES or _begins_as_xml(path)


def _begins_as_xml(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except (OSError, ValueError):
        return False
    return head.removeprefix(codecs.BOM_UTF8).lstrip().startswith(b"<")


def list_robots() -> tuple[str, ...]:
    """Return the names of all robots in ./robots and of those that come with symid, sorted."""
    names = {
        path.stem for folder in _find_folders() if folder.is_dir() for path in folder.glob(f"*{_SUFFIX}")
    }
    return tuple(sorted(names))


def find_robot_file(name_or_path: str) -> Path:
    """Return the robot file at a path, or of a name in ./robots or among the installed robots.

    Raises:
        UsageError: there is none; the message has the nearest names.
    """
    path = Path(name_or_path)
    if _is_file(path):
        return path
    if path.name == name_or_path:
        stem = name_or_path.removesuffix(_SUFFIX)
        for folder in _find_folders():
            candidate = folder / f"{stem}{_SUFFIX}"
            if _is_file(candidate):
                return candidate
    raise UsageError(Notice(code="usage.unknown-robot", text=_explain(path)))


def _is_file(path: Path) -> bool:
    # Path.is_file fails on names that are longer than a file system takes.
    return os.path.isfile(path)  # noqa: PTH113


def _explain(path: Path) -> str:
    if os.path.isdir(path):  # noqa: PTH112  the same
        known = ", ".join(list_robots())
        return f"'{path}' is a folder; give a robot file (.toml, .urdf) or a robot's name: {known}"
    siblings = [str(other) for end in (_SUFFIX, ".urdf") for other in sorted(path.parent.glob(f"*{end}"))]
    near = difflib.get_close_matches(str(path), siblings, n=3, cutoff=0.6)
    if path.parent != Path():
        hint = f"did you mean {' or '.join(near)}?" if near else "give the path of a .toml or .urdf file"
        return f"there is no robot file '{path}'; {hint}"
    names = list_robots()
    near += difflib.get_close_matches(path.name.lower().removesuffix(_SUFFIX), names, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}? " if near else ""
    known = ", ".join(names)
    return f"there is no robot '{path}'; {hint}known are {known}, or give the path of a .toml or .urdf file"
