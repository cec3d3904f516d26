"""How a verb is declared: its options in groups of the help, from records or by hand, and the common flags.

Then the options that several verbs have, and what they stand for: robot, settings, friction model, outputs.
"""

import contextlib
import functools
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import click
from click import shell_completion

import symid
from symid.api import BACKENDS
from symid.cli.call import Answer, Console
from symid.environment import show_path
from symid.errors import Notice, OutputError, UsageError
from symid.options import (
    FLAG,
    FOUND,
    TEXT,
    DraftOptions,
    Kind,
    LogOptions,
    Options,
    inner,
    list_flags,
    list_options,
    number,
    option,
    share,
    words,
)

if TYPE_CHECKING:
    from symid import RobotModel

Given: TypeAlias = Any
"""What click takes and gives, and options of a record: whoever declares them says their types."""
Decorator = Callable[[Callable[..., Given]], Callable[..., Given]]


class _GroupedOption(click.Option):
    def __init__(self, *arguments: Given, group: str = "", **settings: Given) -> None:
        super().__init__(*arguments, **settings)
        self.group = group


def _option(
    group: str, names: str, meaning: str, kind: Given = None, metavar: str | None = None, **settings: Given
) -> Decorator:
    """Return an option of click, which shows its default; `names` may end in that of its argument."""
    settings.setdefault("show_default", settings.get("default") is not None)
    settings |= {"help": meaning, "type": kind, "metavar": metavar}
    return click.option(*names.split(), cls=_GroupedOption, group=group, **settings)


_HEADINGS = ("Input", "Processing", "Model", "Method", "Output", "")
INPUT, PROCESSING, MODEL, METHOD, OUTPUT = (functools.partial(_option, heading) for heading in _HEADINGS[:-1])
"""Options below a heading in the help of a verb."""


class Verb(click.Command):
    """A command with grouped options, a summary that is never shortened, and the common flags.

    Its function gets the flags as one `console`, ROBOT and how it is read as one `robot`, and --settings and
    --set as one `settings`; --accept and --open are for its answer.
    """

    flags = "Output"

    def __init__(self, *arguments: Given, **settings: Given) -> None:
        super().__init__(*arguments, **settings)
        more = "All lines, warnings and notes, more progress; a traceback when symid fails."
        for names, text in (
            (("--json", "as_json"), "Print one JSON object on stdout."),
            (("-q", "--quiet"), "No progress and no warnings."),
            (("-v", "--verbose"), more),
        ):
            self.params.append(_GroupedOption(names, is_flag=True, help=text, group=self.flags))

    def invoke(self, ctx: click.Context) -> Given:
        """Call the function with what the options stand for."""
        # The common flags are read by `answer_call`, which prints answers and errors, and made the console.
        given = ctx.params
        for flag in ("as_json", "quiet", "verbose"):
            del given[flag]
        given["console"] = ctx.obj
        if "robot" in given:
            # ROBOT with its options, which are refused without it.
            source, read, plain = given.pop("robot"), take_record(NamedRobot, given), NamedRobot()
            known = list_options(NamedRobot).items()
            stated = [flag.name_flag(x) for x, flag in known if getattr(read, x) != getattr(plain, x)]
            if source is None and stated:
                leave = f"leave {'them' if stated[1:] else 'it'} out"
                text = f"{', '.join(stated)} cannot be used without --robot; name the robot, or {leave}"
                raise UsageError(Notice(code="usage.no-robot", text=text))
            given["robot"] = None if source is None else replace(read, source=source)
        if "pairs" in given:
            named = given.pop("named_settings")
            expected = "KEY=VALUE, such as processing.filter_cutoff=50"
            single = split_pairs("--set", given.pop("pairs"), expected, "usage.bad-setting")
            if (rate := given.pop("sample_rate", None)) is not None:
                single["log.sample_rate"] = repr(rate)
            given["settings"] = ({} if named is None else {"settings": named}) | single
        accepted, opened = given.pop("accepted", False), given.pop("opened", False)
        answer = super().invoke(ctx)
        if opened:
            import webbrowser

            webbrowser.open(Path(str(answer.result["file"])).resolve().as_uri())
        return answer.accept() if accepted else answer

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options by group; those without a group come last."""
        groups: dict[str, list[tuple[str, str]]] = {heading: [] for heading in _HEADINGS}
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


def verb(name: str) -> Callable[[Callable[..., Answer]], Verb]:
    """Return a decorator that makes a function the verb of a name."""
    return click.command(name, cls=Verb)


class Finite(click.FloatRange):
    """A range of finite numbers."""

    def _describe_range(self) -> str:
        return super()._describe_range() if (self.min, self.max) != (None, None) else ""

    def convert(self, value: float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number, or refuse the call."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


POSITIVE = Finite(min=0.0, min_open=True)
WHOLE, COUNT = click.IntRange(min=0), click.IntRange(min=1)
FILE = click.Path(path_type=Path)


def record_options(record: type[Options], *names: str, beside: type[Options] | None = None) -> Decorator:
    """Return the options of fields of a record: those named, else all that `beside` has not already."""
    known = list_options(record)
    defaults = {entry.name: entry.default for entry in fields(record)}
    made, taken = [], set(list_flags(beside)) if beside else set()
    # A field without a group has no option of its own there.
    shown = [name for name, entry in known.items() if entry.flag != "" and entry.group]
    flags = {name: known[name].name_flag(name).removeprefix("--").replace("-", "_") for name in shown}
    for name in names or [name for name in shown if flags[name] not in taken]:
        entry, default = known[name], defaults[name]
        settings: dict[str, Any] = {"is_flag": True} if entry.kind.name == "flag" else {"default": default}
        if entry.kind.many:
            settings = {"multiple": True}
        elif "[default: " in entry.meaning:
            # None for what is not given.
            settings = {}
        elif not entry.shown:
            settings["show_default"] = False
        of = entry.kind
        kind: Given = {"file": FILE, "percent": click.FLOAT}.get(of.name)
        if of.name == "number":
            low, high = (value if math.isfinite(value) else None for value in (of.least, of.most))
            kind = Finite(min=low, max=high, min_open=of.open)
        elif of.name == "whole":
            kind = click.IntRange(min=int(of.least))
        elif of.name == "words":
            kind = click.Choice((*of.words, *of.beside))
        elif of is FOUND:
            kind = click.Path(path_type=Path, exists=True, dir_okay=False)
        named = f"{entry.name_flag(name)} {name}"
        made.append(_option(entry.group, named, entry.meaning, kind, entry.metavar, **settings))
    return add_options(*made)


T = TypeVar("T", bound=Options)


def take_record(record: type[T], values: dict[str, Any], joints: int = 0) -> T:
    """Return the record with the values of its fields, which are taken out of `values`.

    Lists such as 1,2,3 become numbers, one for each of the `joints`; a UsageError names all mistakes.
    """
    known, code = list_options(record), "usage.excitation"
    given = {name: value for name in known if (value := values.pop(name, None)) is not None}
    for name, text in given.items():
        if known[name].kind.name == "numbers":
            flag = known[name].name_flag(name)
            given[name] = split_numbers(flag, text, code, f"{joints} ")
            if len(given[name]) != joints:
                message = f"{flag}: {len(given[name])} numbers for {joints} joints; give one for each"
                raise UsageError(Notice(code=code, text=message))
    return record(**given)


def split_numbers(flag: str, text: str, code: str, count: str = "") -> tuple[float, ...]:
    """Return the numbers of a list such as 1,2,3; a UsageError with `code` says how many it may have."""
    try:
        return tuple(map(float, text.split(",")))
    except ValueError as error:
        message = f"{flag} {text}: expected {count}numbers with commas between them"
        raise UsageError(Notice(code=code, text=message)) from error


def add_options(*options: Decorator) -> Decorator:
    """Return a decorator that adds several options in order."""
    return lambda function: functools.reduce(lambda made, entry: entry(made), reversed(options), function)


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedRobot(Options):
    """ROBOT of the command line, with the options for reading and running it."""

    source: str = inner("", "Name of the robot, or its file.")
    base: str | None = option(None, "URDF, MJCF: first link of the robot.", "Input", TEXT, "LINK")
    tip: str | None = option(
        None, "URDF, MJCF: last link of the robot; other branches are removed.", "Input", TEXT, "LINK"
    )
    snap: float | None = option(
        None,
        "URDF, MJCF: round angles within this distance of a quarter turn; 0 for none.  [default: 1e-5, more "
        "where base parameters would depend on the last digits of the file]",
        "Input",
        number(0.0, 0.01),
        "RAD",
    )
    xacro: tuple[str, ...] = option(
        (),
        "xacro: value of an argument of the file; may be repeated.",
        "Input",
        Kind(name="text", many=True),
        "NAME:=VALUE",
    )
    include_outside: bool = option(
        False, "MJCF: read included files from other folders than the model's, too.", "Input", FLAG
    )
    gravity: str | None = share(DraftOptions, "gravity")
    zeros: str | None = option(
        None,
        "Joints whose zeros identify finds, by name, or unknown for all.",
        "Input",
        TEXT,
        "JOINT,...",
    )
    backend: str = option(
        BACKENDS[0],
        "Backend of the functions: compiled C, NumPy, or C generated by CasADi.",
        "Method",
        words(*BACKENDS),
    )

    def load(
        self, console: Console, *, settings: dict[str, str] | None = None, friction: str | None = None
    ) -> "RobotModel":
        """Load the robot; the console prints its progress."""
        options = {**asdict(self), "settings": settings, "friction": friction}
        return symid.load(options.pop("source"), progress=console.progress, **options)


def split_pairs(
    name: str, texts: Sequence[str], expected: str, code: str, *, once: bool = False
) -> dict[str, str]:
    """Return key and value of the texts KEY=VALUE of an option; a UsageError names all mistakes."""
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


def check_output(*outputs: Path | None, force: bool, inputs: Sequence[Path | str | None] = ()) -> None:
    """Check output files before the work begins, None for one that is not asked for.

    An OutputError says that a file exists without --force, is one of `inputs`, or has no folder.
    """
    for path in filter(None, outputs):
        for entry in [Path(given) for given in inputs if given]:
            same = path.resolve() == entry.resolve()
            with contextlib.suppress(OSError, ValueError):
                same = same or path.samefile(entry)
            if same:
                text = "is an input of this call and would be overwritten; give another name"
                raise OutputError(Notice(code="output.is-input", text=text, file=str(path)))
        if os.path.lexists(path) and not force:
            text = "exists already; give another name, or --force to overwrite it"
            raise OutputError(Notice(code="output.exists", text=text, file=str(path)))
        if not os.path.isdir(path.parent):  # noqa: PTH112  Path.is_dir fails on names that are too long
            text = f"the folder {path.parent} does not exist; make it first"
            raise OutputError(Notice(code="output.no-folder", text=text, file=str(path)))


force_option = OUTPUT("--force", "Overwrite an existing output file, whoever wrote it.", is_flag=True)
friction_option = MODEL(
    "--friction",
    "Friction law of all joints, such as coulomb-viscous-offset or none, in place of the robot file's; "
    "identify finds the shape values of others, as stribeck, and with auto chooses the law of each joint; "
    "elbow=stribeck,wrist=auto names single joints.",
    metavar="LAW",
)


settings_options = add_options(
    PROCESSING(
        "--settings named_settings",
        "Use a named set of settings of the robot file, such as published; --set wins.",
        metavar="NAME",
    ),
    PROCESSING(
        "--set pairs",
        "Replace a setting of the robot file, such as processing.filter_cutoff=50.",
        multiple=True,
        metavar="KEY=VALUE",
    ),
    record_options(LogOptions),
)
accept_option = OUTPUT(
    "--accept accepted", "Go on although the verdict is wrong: exit code 0, and a warning.", is_flag=True
)
page_option = OUTPUT("--page", "Write verdict, figures and tables as one HTML page.", FILE, "PAGE")
open_option = OUTPUT("--open opened", "Open the written page in the browser.", is_flag=True)


def add_page(answer: Answer, result: Given, page: Path | None, **options: object) -> Answer:
    """Return the answer with the line of a page, which is written, with `options`, if one is asked for."""
    if page is None:
        return answer
    found = result.report(page, **options)
    return answer.write(f"page: {show_path(getattr(found, 'file', found))}", page=page)


def try_log(fit: Given, log: Path, **options: Given) -> list[Given]:
    """Return what a fit predicts of each log in a file, several where time starts again, with `options`."""
    try:
        return [fit.validate(log, **options)]
    except UsageError as error:
        if error.notices[0].code != "usage.one-log":
            raise
    return [fit.validate(entry, **options) for entry in fit.read_logs(log)]


def add_trials(answer: Answer, found: Sequence[Given]) -> Answer:
    """Return the answer with what a fit predicts of further logs, and new notices."""
    if not found:
        return answer
    blocks = (block for entry in found for block in (*entry.opening(), *entry.blocks()))
    return answer.add(found).write(*blocks, validations=[entry.to_dict() for entry in found])


_READING = ("base", "tip", "snap", "xacro", "include_outside", "gravity", "zeros")
backend_option = record_options(NamedRobot, "backend")


def robot_argument(*, computes: bool = False) -> Decorator:
    """Return the argument ROBOT and how it is read, for verbs that compute --backend as well."""
    taken = record_options(NamedRobot, *(("backend", *_READING) if computes else _READING))
    return add_options(click.argument("robot", shell_complete=_complete_robot), taken)


def robot_option(meaning: str, default: str | None = None) -> Decorator:
    """Return the option --robot of verbs with a default robot, or with the robot of an estimate."""
    named = INPUT("--robot", meaning, None, "ROBOT", default=default, shell_complete=_complete_robot)
    return add_options(named, record_options(NamedRobot, "backend", *_READING))


def _complete_robot(
    _: click.Context, __: click.Parameter, incomplete: str
) -> list[shell_completion.CompletionItem]:
    """Return the robots whose names begin so, and that files fit too."""
    names = [name for name in symid.list_robots() if name.startswith(incomplete)]
    item = shell_completion.CompletionItem
    return [item(incomplete, type="file"), *map(item, names)]


def output_option(
    meaning: str, *between: Decorator, required: bool = False, folder: bool = False
) -> Decorator:
    """Return the option -o for a file or folder, options that follow it, and --force to overwrite it."""
    kind = click.Path(path_type=Path, file_okay=not folder, dir_okay=folder)
    named = OUTPUT("-o --output", meaning, kind, "FOLDER" if folder else "FILE", required=required)
    text = "Overwrite files that symid wrote; other files are still refused."
    return add_options(named, *between, OUTPUT("--force", text, is_flag=True) if folder else force_option)
