"""What verbs do before they call the API: name a robot, read settings, refuse to destroy a file."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import symid
from symid.cli.output import Console
from symid.errors import Notice, OutputError, UsageError
from symid.paths import check_suffix, show_path

if TYPE_CHECKING:
    from symid import RobotModel

__all__ = ["NamedRobot", "check_output", "check_suffix", "show_path", "split_settings"]


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedRobot:
    """ROBOT of the command line, and what the call says of how to read and to run it."""

    name: str
    base: str | None = None
    tip: str | None = None
    snap: float | None = None
    backend: str = "auto"

    def load(
        self, console: Console, *, settings: dict[str, str] | None = None, friction: str | None = None
    ) -> "RobotModel":
        """Return the robot, whose progress the console tells."""
        return symid.load(
            self.name,
            settings=settings,
            friction=friction,
            base=self.base,
            tip=self.tip,
            snap=self.snap,
            backend=self.backend,
            progress=console.progress,
        )


def split_settings(texts: Sequence[str]) -> dict[str, str]:
    """Return keys and values of KEY=VALUE texts.

    Raises:
        UsageError: a text has no equals sign.
    """
    pairs = {}
    for text in texts:
        key, sign, value = text.partition("=")
        if not sign or not key.strip():
            message = f"--set {text}: expected KEY=VALUE, such as processing.filter_cutoff=50"
            raise UsageError(Notice(code="usage.bad-setting", text=message))
        pairs[key.strip()] = value.strip()
    return pairs


def check_output(path: Path | None, *, force: bool, inputs: Sequence[Path | str] = ()) -> None:
    """Refuse to write over a file, before the work is done and not after.

    Raises:
        OutputError: the file exists and --force is not given, it is one of `inputs` (--force or not),
            or its folder does not exist.
    """
    if path is None:
        return
    if path.resolve() in {Path(entry).resolve() for entry in inputs} or any(
        _is_same_file(path, entry) for entry in inputs
    ):
        text = "is an input of this call and would be destroyed; give another name"
        raise OutputError(Notice(code="output.is-input", text=text, file=str(path)))
    if os.path.lexists(path) and not force:
        text = "exists already; give another name, or --force to write over it"
        raise OutputError(Notice(code="output.exists", text=text, file=str(path)))
    if not os.path.isdir(path.parent):  # noqa: PTH112  Path.is_dir fails on names that are too long
        text = f"the folder {path.parent} does not exist; make it first"
        raise OutputError(Notice(code="output.no-folder", text=text, file=str(path)))


def _is_same_file(path: Path, other: Path | str) -> bool:
    try:
        return path.samefile(other)
    except (OSError, ValueError):
        return False
