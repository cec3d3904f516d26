"""Shared parts of verbs: help in groups, common options, the robot, checks of outputs."""

import functools
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import click

import symid
from symid.api import BACKENDS
from symid.cli.call import Answer, Console
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


P = ParamSpec("P")
R = TypeVar("R")
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

INPUT, PROCESSING, MODEL, METHOD, OUTPUT = "Input", "Processing", "Model", "Method", "Output"
_GROUPS = (INPUT, PROCESSING, MODEL, METHOD, OUTPUT)
DEFAULT_SEED = 1
_FRICTION = ("none", "viscous_coulomb", "viscous_coulomb_offset", "asymmetric")
_AUTO = BACKENDS[0]


class _GroupedOption(click.Option):
    """An option with a heading in the help."""

    def __init__(self, *arguments: Any, group: str = "", **settings: Any) -> None:  # noqa: ANN401  click's own
        super().__init__(*arguments, **settings)
        self.group = group


class Verb(click.Command):
    """A command with grouped options, and a summary that is never shortened."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options by group; those without a group come last."""
        groups: dict[str, list[tuple[str, str]]] = {name: [] for name in (*_GROUPS, "")}
        for parameter in self.get_params(ctx):
            # Newer versions of click have a record of arguments too, which the usage line names already.
            record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
            if record is not None:
                groups[getattr(parameter, "group", "")].append(record)
        shown = {name: records for name, records in groups.items() if records}
        for name, records in shown.items():
            with formatter.section(name or ("Other options" if len(shown) > 1 else "Options")):
                formatter.write_dl(records)

    def get_short_help_str(self, limit: int = 45) -> str:  # noqa: ARG002  click's interface
        """Return the whole first sentence of the help."""
        return (self.help or "").strip().split("\n\n")[0].replace("\n", " ").removesuffix(".")


class FiniteRange(click.FloatRange):
    """A range of finite numbers."""

    def _describe_range(self) -> str:
        return super()._describe_range() if (self.min, self.max) != (None, None) else ""

    def convert(self, value: float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number, or refuse the call."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


POSITIVE = FiniteRange(min=0.0, min_open=True)
WHOLE, COUNT = click.IntRange(min=0), click.IntRange(min=1)
FILE = click.Path(path_type=Path)


def option(names: str, group: str, meaning: str, **settings: Any) -> Decorator:  # noqa: ANN401  click's own
    """Return an option of click in a `group` of the help, which shows its default.

    Args:
        names: of the option and, if different, of its argument, separated by blanks.
        group: heading in the help.
        meaning: text in the help.
        settings: of click, such as type, metavar, default.
    """
    settings.setdefault("show_default", settings.get("default") is not None)
    return click.option(*names.split(), cls=_GroupedOption, group=group, help=meaning, **settings)


def add_options(*options: Decorator) -> Decorator:
    """Return a decorator that adds several options in order."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        for entry in reversed(options):
            function = entry(function)
        return function

    return decorate


force_option = option("--force", OUTPUT, "Overwrite an existing output file, whoever wrote it.", is_flag=True)
_force_folder_option = option(
    "--force", OUTPUT, "Overwrite files that symid wrote; other files are still refused.", is_flag=True
)
seed_option = option("--seed", METHOD, "Random seed.", type=WHOLE, default=DEFAULT_SEED, metavar="N")
friction_option = option(
    "--friction",
    MODEL,
    "Friction model of all joints; replaces that of the robot file.",
    type=click.Choice(_FRICTION),
)
set_option = option(
    "--set settings",
    PROCESSING,
    "Replace a setting of the robot file, such as processing.filter_cutoff=50.",
    multiple=True,
    metavar="KEY=VALUE",
)
processing_options = add_options(
    option("--cutoff", PROCESSING, "Cut-off frequency of the low-pass filter.", type=POSITIVE, metavar="HZ"),
    option("--decimate", PROCESSING, "Keep one sample in N.", type=COUNT, metavar="N"),
    option("--drop-first", PROCESSING, "Number of samples cut off at the start.", type=WHOLE, metavar="N"),
    option("--drop-last", PROCESSING, "Number of samples cut off at the end.", type=WHOLE, metavar="N"),
)
_CUTS = (
    option("--base base_link", INPUT, "URDF only: first link of the robot.", metavar="LINK"),
    option(
        "--tip tip_link",
        INPUT,
        "URDF only: last link of the robot; other branches are removed.",
        metavar="LINK",
    ),
    option(
        "--snap",
        INPUT,
        "URDF only: round angles within this distance of a quarter turn; 0 for none.  [default: 1e-5]",
        type=FiniteRange(min=0.0, max=0.01),
        metavar="RAD",
    ),
)
backend_option = option(
    "--backend",
    METHOD,
    "Backend of the functions: compiled C, NumPy, or C generated by CasADi.",
    type=click.Choice(BACKENDS),
    default=_AUTO,
)


def robot_argument(*, computes: bool = False) -> Decorator:
    """Return the argument ROBOT and the options for reading it, as one `NamedRobot`.

    Args:
        computes: the verb runs the robot's functions, and has --backend.
    """
    taken = add_options(*((backend_option,) if computes else ()), *_CUTS)
    return lambda function: click.argument("robot")(taken(_name_robot(function)))


def robot_option(meaning: str, default: str | None = None) -> Decorator:
    """Return the option --robot of verbs with a default robot, or with the robot of an estimate.

    Args:
        meaning: text in the help.
        default: the default robot; None for none.
    """
    shown = default is not None
    named = option("--robot", INPUT, meaning, metavar="ROBOT", default=default, show_default=shown)
    return add_options(named, backend_option, *_CUTS, _name_robot)


def _name_robot(function: Callable[..., R]) -> Callable[..., R]:
    @functools.wraps(function)
    def call(
        *arguments: object,
        robot: str | None,
        base_link: str | None,
        tip_link: str | None,
        snap: float | None,
        backend: str = "auto",
        **options: object,
    ) -> R:
        named = None
        if robot is not None:
            named = NamedRobot(name=robot, base=base_link, tip=tip_link, snap=snap, backend=backend)
        else:
            chosen = None if backend == _AUTO else backend
            asked = {"--base": base_link, "--tip": tip_link, "--snap": snap, "--backend": chosen}
            given = [name for name, value in asked.items() if value is not None]
            if given:
                leave = f"leave {'them' if given[1:] else 'it'} out"
                text = f"{', '.join(given)} cannot be used without --robot; name the robot, or {leave}"
                raise UsageError(Notice(code="usage.no-robot", text=text))
        return function(*arguments, robot=named, **options)

    return call


def output_option(
    meaning: str, *between: Decorator, required: bool = False, folder: bool = False
) -> Decorator:
    """Return the option -o for a file or folder, options that follow it, and --force to overwrite it."""
    kind = click.Path(path_type=Path, file_okay=not folder, dir_okay=folder)
    metavar = "FOLDER" if folder else "FILE"
    named = option("-o --output", OUTPUT, meaning, type=kind, required=required, metavar=metavar)
    return add_options(named, *between, _force_folder_option if folder else force_option)


def build_flags(group: str, *, exposed: bool = True) -> Decorator:
    """Return the common flags; `exposed`: pass them to the verb."""
    flags = (
        ("--json as_json", "Print one JSON object on stdout."),
        ("-q --quiet", "No progress and no warnings."),
        ("-v --verbose", "More progress; a traceback when symid fails."),
    )
    return add_options(
        *(option(name, group, text, is_flag=True, expose_value=exposed) for name, text in flags)
    )


def verb(function: Callable[..., Answer]) -> Callable[..., Answer]:
    """Add the common flags to a verb, and pass them as its console."""

    @build_flags(OUTPUT)
    @functools.wraps(function)
    def call(*, as_json: bool, quiet: bool, verbose: bool, **options: object) -> Answer:
        # `answer_call` prints the answer, and reads --json and -q itself: it must print errors too.
        return function(Console(quiet=quiet, verbose=verbose and not (quiet or as_json)), **options)

    return call
