"""What verbs do with their arguments: load the robot, read pairs of key and value, check outputs."""

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import symid
from symid.cli.call import Console
from symid.errors import Notice, OutputError, UsageError

if TYPE_CHECKING:
    from symid import RobotModel


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedRobot:
    """ROBOT of the command line, with the options for reading and running it."""

    name: str
    base: str | None = None
    tip: str | None = None
    snap: float | None = None
    backend: str = "auto"

    def load(
        self, console: Console, *, settings: dict[str, str] | None = None, friction: str | None = None
    ) -> "RobotModel":
        """Load the robot; the console prints its progress."""
        options = {**asdict(self), "settings": settings, "friction": friction}
        return symid.load(options.pop("name"), progress=console.progress, **options)


def split_settings(texts: Sequence[str]) -> dict[str, str]:
    """Return keys and values of --set KEY=VALUE; a later one wins.

    Raises:
        UsageError: a text has no equals sign.
    """
    expected = "KEY=VALUE, such as processing.filter_cutoff=50"
    return split_pairs("--set", texts, expected, "usage.bad-setting")


def split_pairs(
    name: str, texts: Sequence[str], expected: str, code: str, *, once: bool = False
) -> dict[str, str]:
    """Return key and value of every KEY=VALUE text of the option `name`.

    Raises:
        UsageError: with `code`, for each text without key or equals sign, and for repeated keys if `once`.
    """
    pairs: dict[str, str] = {}
    mistakes = []
    for text in texts:
        key, sign, value = (part.strip() for part in text.partition("="))
        if not sign or not key:
            mistakes.append(f"{name} {text}: expected {expected}")
        elif once and key in pairs:
            mistakes.append(f"{name} {text}: {key} is given twice; give it once")
        pairs[key] = value
    if mistakes:
        raise UsageError(*(Notice(code=code, text=mistake) for mistake in mistakes))
    return pairs


def check_output(path: Path | None, *, force: bool, inputs: Sequence[Path | str] = ()) -> None:
    """Check an output file before the work begins.

    Raises:
        OutputError: the file exists and --force is not given, it is one of `inputs`, or its folder does not
            exist.
    """
    if path is None:
        return
    same = (path.resolve() == Path(entry).resolve() or _is_same_file(path, entry) for entry in inputs)
    if any(same):
        text = "is an input of this call and would be overwritten; give another name"
        raise OutputError(Notice(code="output.is-input", text=text, file=str(path)))
    if os.path.lexists(path) and not force:
        text = "exists already; give another name, or --force to overwrite it"
        raise OutputError(Notice(code="output.exists", text=text, file=str(path)))
    if not os.path.isdir(path.parent):  # noqa: PTH112  Path.is_dir fails on names that are too long
        text = f"the folder {path.parent} does not exist; make it first"
        raise OutputError(Notice(code="output.no-folder", text=text, file=str(path)))


def _is_same_file(path: Path, other: Path | str) -> bool:
    try:
        return path.samefile(other)
    except (OSError, ValueError):
        return False
