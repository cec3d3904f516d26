"""What verbs share: help in groups, common options, the robot of the call, checks before the work.

Options of the call -> a `Console`, a `NamedRobot`, keys and values of settings; a file that exists is not
overwritten.
"""

import functools
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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


P = ParamSpec("P")
R = TypeVar("R")
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

INPUT, PROCESSING, MODEL, METHOD, OUTPUT = "Input", "Processing", "Model", "Method", "Output"
_GROUPS = (INPUT, PROCESSING, MODEL, METHOD, OUTPUT)
DEFAULT_SEED = 1
_FRICTION = ("none", "viscous_coulomb", "viscous_coulomb_offset", "asymmetric")
_AUTO = BACKENDS[0]


class _GroupedOption(click.Option):
    """An option that knows under which heading of the help it stands."""

    def __init__(self, *arguments: Any, group: str = "", **settings: Any) -> None:  # noqa: ANN401  click's own
        super().__init__(*arguments, **settings)
        self.group = group


class Verb(click.Command):
    """A command whose options stand in groups, and whose summary is never cut off."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, group by group; those of no group come last."""
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
        """Return the first sentence of the help, whole."""
        return (self.help or "").strip().split("\n\n")[0].replace("\n", " ").removesuffix(".")


class FiniteRange(click.FloatRange):
    """A range of numbers; "nan" and "inf" are none."""

    def _describe_range(self) -> str:
        return super()._describe_range() if (self.min, self.max) != (None, None) else ""

    def convert(self, value: float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number, or refuse the call."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


def option(*names: str, group: str = "", **settings: Any) -> Decorator:  # noqa: ANN401  click's own
    """Return an option that stands in `group` of the help; the rest is click's."""
    return click.option(*names, cls=_GroupedOption, group=group, **settings)


def add_options(*options: Decorator) -> Decorator:
    """Return a decorator that gives a verb several options, in their order."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        for entry in reversed(options):
            function = entry(function)
        return function

    return decorate


force_option = option(
    "--force", is_flag=True, group=OUTPUT, help="Overwrite an existing output file, whoever wrote it."
)
force_folder_option = option(
    "--force",
    is_flag=True,
    group=OUTPUT,
    help="Overwrite what symid wrote before; files of others stay refused.",
)
seed_option = option(
    "--seed",
    type=click.IntRange(min=0),
    default=DEFAULT_SEED,
    show_default=True,
    group=METHOD,
    metavar="N",
    help="Random seed.",
)
friction_option = option(
    "--friction",
    type=click.Choice(_FRICTION),
    group=MODEL,
    help="Friction model of all joints, in place of the robot file's.",
)
set_option = option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    group=PROCESSING,
    help="Any setting in place of the robot file's, such as processing.filter_cutoff=50.",
)
processing_options = add_options(
    option(
        "--cutoff",
        type=FiniteRange(min=0.0, min_open=True),
        metavar="HZ",
        group=PROCESSING,
        help="Cut-off frequency of the low-pass filter.",
    ),
    option(
        "--decimate",
        type=click.IntRange(min=1),
        metavar="N",
        group=PROCESSING,
        help="Keep one sample in N.",
    ),
    option(
        "--drop-first",
        type=click.IntRange(min=0),
        metavar="N",
        group=PROCESSING,
        help="Number of samples cut off at the start.",
    ),
    option(
        "--drop-last",
        type=click.IntRange(min=0),
        metavar="N",
        group=PROCESSING,
        help="Number of samples cut off at the end.",
    ),
)
_CUTS = (
    option(
        "--base",
        "base_link",
        metavar="LINK",
        group=INPUT,
        help="URDF only: the link at which the robot starts.",
    ),
    option(
        "--tip",
        "tip_link",
        metavar="LINK",
        group=INPUT,
        help="URDF only: the link at which it ends; branches are cut off.",
    ),
    option(
        "--snap",
        type=FiniteRange(min=0.0, max=0.01),
        metavar="RAD",
        group=INPUT,
        help="URDF only: angles this near to a quarter turn become one; 0 for none.  [default: 1e-5]",
    ),
)
backend_option = option(
    "--backend",
    type=click.Choice(BACKENDS),
    default=_AUTO,
    show_default=True,
    group=METHOD,
    help="What computes the robot's functions: compiled C, the NumPy module, or code that CasADi generated.",
)


def robot_argument(*, computes: bool = False) -> Decorator:
    """Return the argument ROBOT with the options that say how it is read, as one `NamedRobot`.

    Args:
        computes: whether the verb runs the robot's functions, and so takes --backend.
    """
    taken = add_options(*((backend_option,) if computes else ()), *_CUTS)
    return lambda function: click.argument("robot")(taken(_name_robot(function)))


def robot_option(meaning: str, default: str | None = None) -> Decorator:
    """Return the option --robot of verbs that have a robot of their own, or know it by its estimate.

    Args:
        meaning: what it is, for the help.
        default: the robot where none is given; None for none.
    """
    shown = default is not None
    named = option("--robot", metavar="ROBOT", default=default, show_default=shown, group=INPUT, help=meaning)
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
            _refuse_unnamed(base=base_link, tip=tip_link, snap=snap, backend=chosen)
        return function(*arguments, robot=named, **options)

    return call


def _refuse_unnamed(**options: object) -> None:
    """Refuse options of a robot that was not named: they would have no effect.

    Raises:
        UsageError: some were given.
    """
    given = [f"--{name}" for name, value in options.items() if value is not None]
    if given:
        them = "them" if given[1:] else "it"
        text = f"{', '.join(given)} cannot be used without --robot; name the robot, or leave {them} out"
        raise UsageError(Notice(code="usage.no-robot", text=text))


def output_option(meaning: str, *, required: bool = False, folder: bool = False) -> Decorator:
    """Return the option -o for a file or folder."""
    kind = click.Path(path_type=Path, file_okay=not folder, dir_okay=folder)
    metavar = "FOLDER" if folder else "FILE"
    return option("-o", "--output", type=kind, required=required, metavar=metavar, group=OUTPUT, help=meaning)


def verb(function: Callable[..., Answer]) -> Callable[..., Answer]:
    """Give a verb the options that all have, and its console in place of them."""

    @option("--json", "as_json", is_flag=True, group=OUTPUT, help="Print one JSON object on stdout.")
    @option("-q", "--quiet", is_flag=True, group=OUTPUT, help="No progress and no warnings.")
    @option(
        "-v", "--verbose", is_flag=True, group=OUTPUT, help="More progress; a traceback when symid fails."
    )
    @functools.wraps(function)
    def call(*, as_json: bool, quiet: bool, verbose: bool, **options: object) -> Answer:
        # The answer is printed by `main`, which reads --json and -q for itself: it must print errors too.
        return function(Console(quiet=quiet, verbose=verbose and not (quiet or as_json)), **options)

    return call
