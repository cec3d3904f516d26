"""Options that several verbs share."""

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import click

from symid.cli.output import Answer, Console
from symid.errors import Notice, UsageError

__all__ = [
    "DEFAULT_SEED",
    "FiniteRange",
    "cut_options",
    "force_folder_option",
    "force_option",
    "friction_option",
    "output_option",
    "processing_options",
    "rows_options",
    "seed_option",
    "set_option",
    "split_settings",
    "verb",
]

P = ParamSpec("P")
R = TypeVar("R")
Decorator = Callable[[Callable[..., Answer]], Callable[..., Answer]]

DEFAULT_SEED = 1
_FRICTION = ("none", "viscous_coulomb", "viscous_coulomb_offset", "asymmetric")


class FiniteRange(click.FloatRange):
    """A range of numbers; "nan" and "inf" are none."""

    def convert(self, value: float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number, or refuse the call."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


force_option = click.option("--force", is_flag=True, help="Write over a file that exists, whoever wrote it.")
force_folder_option = click.option(
    "--force", is_flag=True, help="Write over what symid wrote before; files of others stay refused."
)
seed_option = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=DEFAULT_SEED,
    show_default=True,
    help="Of all random numbers.",
)
friction_option = click.option(
    "--friction", type=click.Choice(_FRICTION), help="Friction model of all joints, in place of the file's."
)
set_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="A setting in place of the file's, such as processing.filter_cutoff=50.",
)


def cut_options(function: Callable[P, R]) -> Callable[P, R]:
    """Give a verb the links between which a URDF is cut, and how its angles are read."""
    options = (
        click.option("--base", "base_link", metavar="LINK", help="Of a URDF: the link to start from."),
        click.option(
            "--tip", "tip_link", metavar="LINK", help="Of a URDF: the link to end at; branches are cut off."
        ),
        click.option(
            "--snap",
            type=FiniteRange(min=0.0, max=0.01),
            metavar="RAD",
            help="Of a URDF: angles this near to a quarter turn become one; 0 for none.  [default: 1e-5]",
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function


def output_option(meaning: str, *, required: bool = False, folder: bool = False) -> Decorator:
    """Return the option -o for a file or folder."""
    kind = click.Path(path_type=Path, file_okay=not folder, dir_okay=folder)
    metavar = "FOLDER" if folder else "FILE"
    return click.option("-o", "--output", type=kind, required=required, metavar=metavar, help=meaning)


def verb(function: Callable[..., Answer]) -> Callable[..., Answer]:
    """Give a verb the options that all have, and its console in place of them."""

    @click.option("--json", "as_json", is_flag=True, help="One JSON object on stdout.")
    @click.option("-q", "--quiet", is_flag=True, help="No progress and no warnings.")
    @click.option("-v", "--verbose", is_flag=True, help="More progress; a traceback when symid fails.")
    @functools.wraps(function)
    def call(*, as_json: bool, quiet: bool, verbose: bool, **options: object) -> Answer:
        # The answer is printed by `main`, which reads --json and -q for itself: it must print errors too.
        return function(Console(quiet=quiet, verbose=verbose and not (quiet or as_json)), **options)

    return call


def rows_options(function: Callable[P, R]) -> Callable[P, R]:
    """Give a verb the options of how measurements become equations, and equations parameters."""
    options = (
        click.option(
            "--rows",
            type=click.Choice(("torque", "momentum", "filtered", "power", "energy", "friction")),
            default="torque",
            show_default=True,
            help="How measurements become equations; friction: a law of friction for every joint that moves.",
        ),
        click.option(
            "--estimator",
            metavar="NAME",
            help="How equations become parameters: ols, wls, gls, huber, ridge, consistent, sequential, "
            "output-error or instrumental; of --rows friction varpro, root-finding, nlp, genetic, annealing "
            "or differential-evolution.  [default: ols, varpro]",
        ),
    )
    for option in options:
        function = option(function)
    return function


def processing_options(function: Callable[P, R]) -> Callable[P, R]:
    """Give a verb short names for the settings of the signals."""
    options = (
        click.option(
            "--cutoff",
            type=FiniteRange(min=0.0, min_open=True),
            metavar="HZ",
            help="Cut-off of the low-pass filter.",
        ),
        click.option("--decimate", type=click.IntRange(min=1), metavar="N", help="Keep one sample in N."),
        click.option(
            "--drop-first", type=click.IntRange(min=0), metavar="N", help="Samples cut off at the start."
        ),
        click.option(
            "--drop-last", type=click.IntRange(min=0), metavar="N", help="Samples cut off at the end."
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function


def split_settings(settings: tuple[str, ...], **named: object) -> tuple[tuple[str, str], ...]:
    """Return pairs of key and value from KEY=VALUE texts and from options of their own.

    Args:
        settings: the texts.
        named: values of options by their processing key, None where not given.

    Raises:
        UsageError: a text has no equals sign.
    """
    pairs = []
    for text in settings:
        key, sign, value = text.partition("=")
        if not sign or not key.strip():
            message = f"--set {text}: expected KEY=VALUE, such as processing.filter_cutoff=50"
            raise UsageError(Notice(code="usage.bad-setting", text=message))
        pairs.append((key.strip(), value.strip()))
    given = [(f"processing.{key}", str(value)) for key, value in named.items() if value is not None]
    return (*pairs, *((key.replace("__", "."), value) for key, value in given))
