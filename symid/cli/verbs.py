"""How a verb is declared: its options in groups of the help, the types of their values, the common flags."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import click

from symid.cli.call import Answer, Console

P = ParamSpec("P")
R = TypeVar("R")
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


class _GroupedOption(click.Option):
    """An option with a heading in the help."""

    def __init__(self, *arguments: Any, group: str = "", **settings: Any) -> None:  # noqa: ANN401  click's own
        super().__init__(*arguments, **settings)
        self.group = group


@dataclass(frozen=True, slots=True)
class Group:
    """A heading in the help of a verb, with the options below it."""

    heading: str

    def option(
        self,
        names: str,
        meaning: str,
        kind: Any = None,  # noqa: ANN401  click's own
        metavar: str | None = None,
        **settings: Any,  # noqa: ANN401  click's own
    ) -> Decorator:
        """Return an option of click, which shows its default.

        Args:
            names: of the option and, if different, of its argument, separated by blanks.
            meaning: text in the help.
            kind: type of its values.
            metavar: name of its value in the help.
            settings: of click, such as default or multiple.
        """
        settings.setdefault("show_default", settings.get("default") is not None)
        settings |= {"help": meaning, "type": kind, "metavar": metavar}
        return click.option(*names.split(), cls=_GroupedOption, group=self.heading, **settings)


INPUT, PROCESSING, MODEL, METHOD, OUTPUT = _GROUPS = tuple(
    map(Group, ("Input", "Processing", "Model", "Method", "Output"))
)


class Verb(click.Command):
    """A command with grouped options, a summary that is never shortened, and the common flags.

    Its function gets the flags as one `console`.
    """

    flags = OUTPUT

    def __init__(self, *arguments: Any, **settings: Any) -> None:  # noqa: ANN401  click's own
        super().__init__(*arguments, **settings)
        for names, text in (
            (("--json", "as_json"), "Print one JSON object on stdout."),
            (("-q", "--quiet"), "No progress and no warnings."),
            (("-v", "--verbose"), "More progress and all warnings; a traceback when symid fails."),
        ):
            self.params.append(_GroupedOption(names, is_flag=True, help=text, group=self.flags.heading))

    def invoke(self, ctx: click.Context) -> Any:  # noqa: ANN401  click's own
        """Call the function with its console."""
        as_json, quiet, verbose = (ctx.params.pop(name) for name in ("as_json", "quiet", "verbose"))
        # `answer_call` prints the answer, and reads --json and -q itself: it must print errors too.
        ctx.params["console"] = Console(quiet=quiet, verbose=verbose and not (quiet or as_json))
        return super().invoke(ctx)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options by group; those without a group come last."""
        groups: dict[str, list[tuple[str, str]]] = {entry.heading: [] for entry in (*_GROUPS, Group(""))}
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


def add_options(*options: Decorator) -> Decorator:
    """Return a decorator that adds several options in order."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        for entry in reversed(options):
            function = entry(function)
        return function

    return decorate
