"""The options of `symid excite` that say what is searched for, and within what."""

from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import click

from symid.cli.options import FiniteRange

__all__ = ["excite_options"]

P = ParamSpec("P")
R = TypeVar("R")

_POSITIVE = FiniteRange(min=0.0, min_open=True)
_COUNT = click.IntRange(min=1)


def excite_options(function: Callable[P, R]) -> Callable[P, R]:
    """Give a verb the options of an exciting trajectory."""
    for option in reversed((*_list_series(), *_list_limits(), *_list_search())):
        function = option(function)
    return function


def _list_series() -> tuple[Callable[[Callable[P, R]], Callable[P, R]], ...]:
    return (
        click.option(
            "--harmonics", type=_COUNT, default=5, show_default=True, metavar="N", help="Of each joint."
        ),
        click.option(
            "--period", type=_POSITIVE, default=10.0, show_default=True, metavar="S", help="Its length."
        ),
        click.option(
            "--criterion",
            type=click.Choice(("condition", "d-optimal")),
            default="condition",
            show_default=True,
            help="Least condition number of the regressor with columns of length one, or most information.",
        ),
        click.option(
            "--weight",
            type=FiniteRange(min=0.0),
            default=0.1,
            show_default=True,
            help="Of the information beside the condition number, which alone may be small for tiny motions.",
        ),
        click.option("--moving", is_flag=True, help="It need not start and end at rest."),
        click.option("--start", metavar="Q1,Q2,...", help="Pose in which it starts and ends, rad or m."),
    )


def _list_limits() -> tuple[Callable[[Callable[P, R]], Callable[P, R]], ...]:
    where = "where the robot file states none"
    return (
        click.option(
            "--share",
            type=FiniteRange(min=0.0, max=1.0, min_open=True),
            default=0.95,
            show_default=True,
            help="Of every limit that may be used.",
        ),
        click.option(
            "--sweep",
            type=_POSITIVE,
            default=1.0,
            show_default=True,
            help=f"Position limit either side of zero {where}, rad or m.",
        ),
        click.option(
            "--velocity", type=_POSITIVE, default=2.0, show_default=True, help=f"Limit {where}, rad/s or m/s."
        ),
        click.option(
            "--acceleration", type=_POSITIVE, default=10.0, show_default=True, help=f"Limit {where}, /s^2."
        ),
        click.option("--jerk", type=_POSITIVE, help=f"Limit {where}, /s^3.  [default: none]"),
        click.option(
            "--workspace",
            type=click.Path(path_type=Path, exists=True, dir_okay=False),
            metavar="FILE",
            help="Spheres and planes that links keep to, .toml.",
        ),
        click.option(
            "--torsion", type=_POSITIVE, metavar="RAD", help="Largest torsion of elastic joints, rad or m."
        ),
        click.option(
            "--stiffness", metavar="K1,K2,...", help="Of all joints, for --torsion; else the robot file's."
        ),
    )


def _list_search() -> tuple[Callable[[Callable[P, R]], Callable[P, R]], ...]:
    return (
        click.option(
            "--deviations", metavar="S1,S2,...", help="Of the torques, N m or N; equal where left out."
        ),
        click.option(
            "--candidates",
            type=_COUNT,
            default=1000,
            show_default=True,
            metavar="N",
            help="Random feasible trajectories to start from, and to beat.",
        ),
        click.option(
            "--starts",
            type=_COUNT,
            default=10,
            show_default=True,
            metavar="N",
            help="How many are optimised.",
        ),
        click.option(
            "--rate",
            type=_POSITIVE,
            default=1000.0,
            show_default=True,
            metavar="HZ",
            help="Samples a second in the file.",
        ),
        click.option(
            "--periods",
            type=_COUNT,
            default=1,
            show_default=True,
            metavar="N",
            help="How often the file runs through it.",
        ),
    )
