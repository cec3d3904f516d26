"""From the arguments of a verb to the products that stages take.

Input: texts of the command line. Output: `Robot`, `Library`, `Recording`, `Estimate`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symid.cli.output import Console
from symid.errors import EstimateError, Notice, OutputError

if TYPE_CHECKING:  # these load numpy, which a usage error must not wait for
    from symid.codegen.library import Library
    from symid.data.recording import Recording
    from symid.identification.estimate import Estimate
    from symid.robot.description import Processing, Robot

__all__ = [
    "check_output",
    "describe_settings",
    "load_robot",
    "load_robot_library",
    "load_robot_of_estimate",
    "read_logs",
    "show_path",
]


def load_robot(name: str, settings: Sequence[tuple[str, str]] = (), friction: str | None = None) -> "Robot":
    """Return the robot of a name or path, with settings of the command line in place of the file's.

    Raises:
        UsageError: there is no such robot, or a setting cannot be made here.
        RobotError: the file is wrong.
    """
    from symid.robot.locate import find_robot_file
    from symid.robot.overrides import override_robot
    from symid.robot.toml import read_robot

    robot = read_robot(find_robot_file(name))
    return override_robot(robot, settings, friction) if settings or friction else robot


def load_robot_library(robot: "Robot", console: Console) -> "Library":
    """Return the robot's compiled functions, from the cache or made now."""
    from symid.codegen.cache import prepare_library

    return prepare_library(robot, progress=console.progress)


def read_logs(paths: Sequence[Path], robot: "Robot") -> tuple["Recording", ...]:
    """Return the recordings; all logs are read before anything is said about one.

    Raises:
        LogError: with what is wrong with any of them.
    """
    from symid.data.readers import read_recording
    from symid.errors import LogError

    recordings: list[Recording] = []
    notices: list[Notice] = []
    for path in paths:
        try:
            recordings.append(read_recording(path, robot))
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    return tuple(recordings)


def load_robot_of_estimate(name: str, estimate: "Estimate", settings: Sequence[tuple[str, str]]) -> "Robot":
    """Return the robot as it was when identified: with the estimate's friction and processing.

    Settings of the command line come last, and win.

    Raises:
        UsageError, RobotError: see `load_robot`.
        EstimateError: what the estimate says of its processing cannot be read.
    """
    from symid.robot.overrides import override_robot

    kinds = set(estimate.friction)
    # Joints with different models have them from the file: the command line sets one for all.
    robot = load_robot(name, friction=kinds.pop() if len(kinds) == 1 else None)
    robot = replace(robot, processing=_read_processing(estimate.settings))
    return override_robot(robot, settings) if settings else robot


def _read_processing(settings: Mapping[str, object]) -> "Processing":
    from symid.robot.description import Decimation, Processing

    table: Any = settings.get("processing")
    try:
        return Processing(**{**table, "decimation": Decimation(**table["decimation"])})
    except (TypeError, KeyError) as error:
        text = f"its settings have no usable 'processing': {error}; identify again"
        raise EstimateError(Notice(code="estimate.settings", text=text)) from error


def describe_settings(robot: "Robot") -> dict[str, object]:
    """Return the log map and the processing as they are used, for the echo in a result."""
    from symid.robot.settings import list_log, list_processing

    return {"log": _simplify(list_log(robot.log)), "processing": _simplify(list_processing(robot.processing))}


def _simplify(value: object) -> object:
    """Return `value` with the reader's decimal numbers as floats."""
    match value:
        case None | bool() | int() | float() | str():
            return value
        case Mapping():
            return {str(key): _simplify(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_simplify(entry) for entry in value]
    return float(str(value))


def check_output(path: Path | None, *, force: bool) -> None:
    """Refuse to write over a file, before the work is done and not after.

    Raises:
        OutputError: the file exists and --force is not given, or its folder does not exist.
    """
    if path is None:
        return
    if path.exists() and not force:
        text = "exists already; give another name, or --force to write over it"
        raise OutputError(Notice(code="output.exists", text=text, file=str(path)))
    if not path.parent.is_dir():
        text = f"the folder {path.parent} does not exist; make it first"
        raise OutputError(Notice(code="output.no-folder", text=text, file=str(path)))


def show_path(path: Path) -> str:
    """Return the path as people type it: relative, where it is below the working folder."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)
