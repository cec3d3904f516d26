"""Options that several verbs have, and what they stand for: robot, settings, friction model, outputs."""

import functools
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click import shell_completion

import symid
from symid.api import BACKENDS
from symid.cli.call import Answer, Console
from symid.cli.verbs import FILE, INPUT, METHOD, MODEL, OUTPUT, PROCESSING, Decorator, Finite, add_options
from symid.environment import show_path
from symid.errors import Notice, OutputError, UsageError

if TYPE_CHECKING:
    from symid import RobotModel

R = TypeVar("R")
_AUTO = BACKENDS[0]
_Item = shell_completion.CompletionItem


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


force_option = OUTPUT.option("--force", "Overwrite an existing output file, whoever wrote it.", is_flag=True)
_force_folder_option = OUTPUT.option(
    "--force", "Overwrite files that symid wrote; other files are still refused.", is_flag=True
)
friction_option = MODEL.option(
    "--friction",
    "Friction law of all joints, such as coulomb-viscous-offset or none, in place of the robot file's; "
    "identify finds the shape values of others, as stribeck, and with auto chooses the law of each joint; "
    "elbow=stribeck,wrist=auto names single joints.",
    metavar="LAW",
)


def _gather_settings(function: Callable[..., R]) -> Callable[..., R]:
    @functools.wraps(function)
    def call(*, named_settings: str | None, pairs: tuple[str, ...], **options: object) -> R:
        named = {} if named_settings is None else {"settings": named_settings}
        return function(settings=named | split_settings(pairs), **options)

    return call


settings_options = add_options(
    PROCESSING.option(
        "--settings named_settings",
        "Use a named set of settings of the robot file, such as published; --set wins.",
        metavar="NAME",
    ),
    PROCESSING.option(
        "--set pairs",
        "Replace a setting of the robot file, such as processing.filter_cutoff=50.",
        multiple=True,
        metavar="KEY=VALUE",
    ),
    _gather_settings,
)
"""The options --settings and --set, as one `settings` with keys and values."""


def _accept_verdict(function: Callable[..., Answer]) -> Callable[..., Answer]:
    @functools.wraps(function)
    def call(*, accept: bool, **options: object) -> Answer:
        answer = function(**options)
        return answer.accept() if accept else answer

    return call


accept_option = add_options(
    OUTPUT.option(
        "--accept", "Go on although the verdict is wrong: exit code 0, and a warning.", is_flag=True
    ),
    _accept_verdict,
)
page_option = OUTPUT.option("--page", "Write verdict, figures and tables as one HTML page.", FILE, "PAGE")


_open_option = OUTPUT.option("--open opened", "Open the written page in the browser.", is_flag=True)


def open_option(function: Callable[..., Answer]) -> Callable[..., Answer]:
    """Return the function with --open, which shows the file of its answer once it is written."""

    @functools.wraps(function)
    def call(*, opened: bool, **options: object) -> Answer:
        answer = function(**options)
        if opened:
            import webbrowser

            webbrowser.open(Path(str(answer.result["file"])).resolve().as_uri())
        return answer

    return _open_option(call)


def add_page(
    answer: Answer,
    result: Any,  # noqa: ANN401  all that can report
    page: Path | None,
    **options: object,
) -> Answer:
    """Return the answer with the line of a page, which is written, with `options`, if one is asked for."""
    if page is None:
        return answer
    found = result.report(page, **options)
    text = f"{answer.text}\n\npage: {show_path(getattr(found, 'file', found))}"
    return replace(answer, text=text, result={**answer.result, "page": page})


_CUTS = (
    INPUT.option("--base", "URDF, MJCF: first link of the robot.", metavar="LINK"),
    INPUT.option("--tip", "URDF, MJCF: last link of the robot; other branches are removed.", metavar="LINK"),
    INPUT.option(
        "--snap",
        "URDF, MJCF: round angles within this distance of a quarter turn; 0 for none.  [default: 1e-5 where "
        "that changes no number of base parameters, else 0]",
        Finite(min=0.0, max=0.01),
        "RAD",
    ),
)
backend_option = METHOD.option(
    "--backend",
    "Backend of the functions: compiled C, NumPy, or C generated by CasADi.",
    click.Choice(BACKENDS),
    default=_AUTO,
)


def robot_argument(*, computes: bool = False) -> Decorator:
    """Return the argument ROBOT and the options for reading it, as one `NamedRobot`.

    Args:
        computes: the verb runs the robot's functions, and has --backend.
    """
    taken = add_options(*((backend_option,) if computes else ()), *_CUTS)
    argument = click.argument("robot", shell_complete=_complete_robot)
    return lambda function: argument(taken(_name_robot(function)))


def robot_option(meaning: str, default: str | None = None) -> Decorator:
    """Return the option --robot of verbs with a default robot, or with the robot of an estimate.

    Args:
        meaning: text in the help.
        default: the default robot; None for none.
    """
    shown = default is not None
    settings = {"show_default": shown, "shell_complete": _complete_robot}
    named = INPUT.option("--robot", meaning, metavar="ROBOT", default=default, **settings)
    return add_options(named, backend_option, *_CUTS, _name_robot)


def _complete_robot(_: click.Context, __: click.Parameter, incomplete: str) -> list[_Item]:
    """Return the robots whose names begin so, and that files fit too."""
    names = [name for name in symid.list_robots() if name.startswith(incomplete)]
    return [_Item(incomplete, type="file"), *map(_Item, names)]


def _name_robot(function: Callable[..., R]) -> Callable[..., R]:
    @functools.wraps(function)
    def call(
        *,
        robot: str | None,
        base: str | None,
        tip: str | None,
        snap: float | None,
        backend: str = _AUTO,
        **options: object,
    ) -> R:
        chosen = None if backend == _AUTO else backend
        asked = {"--base": base, "--tip": tip, "--snap": snap, "--backend": chosen}
        given = [name for name, value in asked.items() if value is not None]
        if robot is None and given:
            leave = f"leave {'them' if given[1:] else 'it'} out"
            text = f"{', '.join(given)} cannot be used without --robot; name the robot, or {leave}"
            raise UsageError(Notice(code="usage.no-robot", text=text))
        named = robot and NamedRobot(name=robot, base=base, tip=tip, snap=snap, backend=backend)
        return function(robot=named, **options)

    return call


def output_option(
    meaning: str, *between: Decorator, required: bool = False, folder: bool = False
) -> Decorator:
    """Return the option -o for a file or folder, options that follow it, and --force to overwrite it."""
    kind = click.Path(path_type=Path, file_okay=not folder, dir_okay=folder)
    metavar = "FOLDER" if folder else "FILE"
    named = OUTPUT.option("-o --output", meaning, kind, metavar, required=required)
    return add_options(named, *between, _force_folder_option if folder else force_option)
