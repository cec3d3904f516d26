"""Options of `symid identify` for rows and estimators of rigid robots, and what they come to.

Input: options, a robot, recordings. Output: `EstimatorOptions`.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import click

from symid.cli.options import FiniteRange
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.codegen.library import Library
    from symid.data.recording import Recording
    from symid.estimators.estimators import EstimatorOptions
    from symid.estimators.prior import Prior
    from symid.robot.description import Robot

__all__ = [
    "ESTIMATOR_NAMES",
    "ESTIMATOR_OPTIONS",
    "OUTPUT_ERROR",
    "SIMULATING",
    "build_estimator_options",
    "check_estimator_options",
    "estimator_options",
    "split_estimator_options",
]

P = ParamSpec("P")
R = TypeVar("R")

OUTPUT_ERROR = "output-error"
"""See `symid.identification.output_error_estimate`."""
SIMULATING = (OUTPUT_ERROR, "instrumental")
"""Estimators that simulate the robot; the other one is in `symid.identification.instrumental_estimate`."""
ESTIMATOR_NAMES = ("ols", "wls", "gls", "huber", "ridge", "consistent", "sequential", *SIMULATING)
ESTIMATOR_OPTIONS = ("overlap", "prior", "prior_deviation", "prior_weight", "start", "partial")
_WINDOWED = ("momentum", "filtered", "energy")
_OVERLAPPING = ("momentum", "energy")
_DEVIATION = 20.0
_ROBOT = "robot"


def estimator_options(function: Callable[P, R]) -> Callable[P, R]:
    """Give a verb the options of rows and estimators of rigid robots."""
    options = (
        click.option(
            "--overlap",
            type=FiniteRange(min=0.0, max=0.95),
            metavar="PART",
            help="Of momentum and energy rows: part of a window that the next one shares.  [default: 0]",
        ),
        click.option(
            "--prior",
            metavar="ESTIMATE",
            help="Of --estimator ridge: an earlier estimate to stay near to, or robot for the robot file's "
            "values.  [default: robot]",
        ),
        click.option(
            "--prior-deviation",
            type=FiniteRange(min=0.0, min_open=True),
            metavar="X",
            help="Of --estimator ridge: how well the prior is known, in percent of the robot file's values, "
            "or as a factor on an estimate's deviations.  [default: 20 %; 1]",
        ),
        click.option(
            "--prior-weight",
            type=FiniteRange(min=0.0),
            metavar="W",
            help="Of --estimator ridge: 1 to believe the deviations stated, 0 for no prior; chosen by cross "
            "validation by default.",
        ),
        click.option(
            "--start",
            metavar="ESTIMATE",
            help="Of --estimator output-error and instrumental: an estimate of the same model to begin with. "
            " [default: a fit of the same logs]",
        ),
        click.option(
            "--partial",
            is_flag=True,
            default=None,
            help="Fit what can be told, where logs tell less than three quarters of the parameters.",
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function


def split_estimator_options(options: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the options of `estimator_options` among others, and the others."""
    mine = {name: options[name] for name in ESTIMATOR_OPTIONS}
    return mine, {name: value for name, value in options.items() if name not in mine}


def check_estimator_options(rows: str, estimator: str, options: Mapping[str, object]) -> None:
    """Refuse options that rows or estimator do not read.

    Args:
        rows: kind of rows.
        estimator: its name.
        options: those of `estimator_options`, "window" and "period"; None where not given.

    Raises:
        UsageError: an option belongs to other rows, or to another estimator.
    """
    wanted = {
        "window": (rows in _WINDOWED, f"--rows {', '.join(_WINDOWED)}"),
        "overlap": (rows in _OVERLAPPING, f"--rows {' and '.join(_OVERLAPPING)}"),
        "period": (estimator == "gls", "--estimator gls and --rows friction"),
        **dict.fromkeys(
            ("prior", "prior_deviation", "prior_weight"), (estimator == "ridge", "--estimator ridge")
        ),
        "start": (estimator in SIMULATING, f"--estimator {' and '.join(SIMULATING)}"),
    }
    notices = [
        Notice(
            code="usage.mixed-options",
            text=f"--{name.replace('_', '-')} belongs to {owner}; leave it out, or choose these",
        )
        for name, (fits, owner) in wanted.items()
        if options.get(name) is not None and not fits
    ]
    if estimator in SIMULATING and rows != "torque":
        text = f"--estimator {estimator} is one of torques; leave --rows {rows} out"
        notices.append(Notice(code="usage.mixed-options", text=text))
    if notices:
        raise UsageError(*notices)


def build_estimator_options(
    robot: "Robot",
    library: "Library",
    recordings: "Sequence[Recording]",
    *,
    estimator: str,
    options: Mapping[str, Any],
) -> "EstimatorOptions":
    """Return what the estimator needs.

    Args:
        robot: as it is identified.
        library: its functions.
        recordings: the logs.
        estimator: its name.
        options: as in `check_estimator_options`.

    Raises:
        UsageError: there is no prior, or the motion does not repeat.
        EstimateError: the prior is of another model.
    """
    from symid.estimators.estimators import EstimatorOptions

    if estimator == "ridge":
        prior = _read_prior(library, options["prior"] or _ROBOT, options["prior_deviation"])
        return EstimatorOptions(prior=prior, prior_weight=options["prior_weight"])
    if estimator == "consistent":
        from symid.estimators.bodies import build_bodies

        return EstimatorOptions(bodies=build_bodies(robot))
    if estimator == "gls" and options.get("period"):
        from symid.rows.period_noise import find_period_noise

        return EstimatorOptions(noise=find_period_noise(recordings, robot.processing, options["period"]))
    return EstimatorOptions()


def _read_prior(library: "Library", name: str, deviation: float | None) -> "Prior":
    from symid.estimators.prior import build_prior_of_card, build_prior_of_estimate

    if name == _ROBOT:
        return build_prior_of_card(library.card, (_DEVIATION if deviation is None else deviation) / 100.0)
    from symid.identification.storage import read_estimate

    return build_prior_of_estimate(read_estimate(Path(name), library.card), deviation or 1.0)
