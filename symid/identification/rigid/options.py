"""Options of rows and estimators of rigid robots, and what goes with what.

Options of a call, robot -> checked options, `EstimatorOptions`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from symid.codegen import Library
from symid.errors import Notice, UsageError
from symid.identification.estimators import (
    ESTIMATORS,
    Estimate,
    EstimatorOptions,
    build_bodies,
    build_prior_of_card,
    build_prior_of_estimate,
    estimate_period_noise,
)
from symid.identification.rigid.plan import FILTERED_INSTRUMENTAL
from symid.logs import Recording
from symid.robot import Robot, suggest_names


def list_unknown(what: str, name: str, allowed: Sequence[str], more: str = "") -> list[Notice]:
    """Return a notice where `name` is not allowed."""
    if name in allowed:
        return []
    hint = suggest_names(name, allowed)
    text = f"unknown {what} {name!r}: {f'{hint} ' if hint else ''}allowed are {', '.join(allowed)}{more}"
    return [Notice(code=f"usage.unknown-{what}", text=text)]


OUTPUT_ERROR, INSTRUMENTAL = "output-error", "instrumental"
SIMULATING = (OUTPUT_ERROR, INSTRUMENTAL)
"""Estimators that simulate the robot, see `closed_loop_estimate`."""
_WINDOWED = ("momentum", "filtered", "energy")
_OVERLAPPING = ("momentum", "energy")
_DEVIATION = 20.0
PRIOR_OF_ROBOT = "robot"
"""The prior that stands in the robot file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigidOptions:
    """Options of rows and estimators; None, or nothing, where not given.

    Args:
        rows: how measurements become equations; torque by default.
        estimator: how equations become parameters; chosen by default.
        window: s, the length of a momentum, filtered or energy row.
        overlap: part of a window that the next one shares.
        period: s, of the motion, once or once a log: noise is what differs between periods (gls).
        prior: an estimate, its file, or "robot" for the robot file's values (ridge).
        prior_deviation: percent of the robot file's values, or a factor on an estimate's deviations.
        prior_weight: 1 to take the stated deviations, 0 for no prior; None to choose it by cross validation.
        start: an estimate, or its file, that a simulating estimator begins with.
        partial: whether to fit what is identifiable where that is less than three quarters.
    """

    rows: str | None = None
    estimator: str | None = None
    window: float | None = None
    overlap: float | None = None
    period: tuple[float, ...] = ()
    prior: Estimate | Path | str | None = None
    prior_deviation: float | None = None
    prior_weight: float | None = None
    start: Estimate | Path | None = None
    partial: bool = False

    def list_given(self) -> tuple[str, ...]:
        """Return the options that were given, as the command line calls them, the windows' length apart."""
        order = ("rows", "estimator", "period", "overlap")
        names = dict.fromkeys((*order, *(entry.name for entry in fields(self) if entry.name != "window")))
        given = (name for name in names if getattr(self, name) not in (None, (), False))
        return tuple(f"--{name.replace('_', '-')}" for name in given)


def check_estimator(rows: str, estimator: str | None) -> None:
    """Refuse an estimator that no rows of a rigid robot know.

    Raises:
        UsageError: there is no such estimator; those of friction laws are others.
    """
    if estimator is None:
        return
    more = f" with {rows} rows; those of friction laws go with --rows friction"
    notices = list_unknown("estimator", estimator, (*ESTIMATORS, FILTERED_INSTRUMENTAL, *SIMULATING), more)
    if notices:
        raise UsageError(*notices)


def check_rigid_options(rows: str, estimator: str | None, options: RigidOptions) -> None:
    """Refuse options that rows or estimator do not use.

    Raises:
        UsageError: an option belongs to other rows or to another estimator, or is out of range.
    """
    ridge = (estimator == "ridge", "--estimator ridge")
    wanted = {
        "window": (rows in _WINDOWED, f"--rows {', '.join(_WINDOWED)}"),
        "overlap": (rows in _OVERLAPPING, f"--rows {' and '.join(_OVERLAPPING)}"),
        "period": (estimator == "gls", "--estimator gls and --rows friction"),
        **dict.fromkeys(("prior", "prior_deviation", "prior_weight"), ridge),
        "start": (estimator in SIMULATING, f"--estimator {' and '.join(SIMULATING)}"),
    }
    found = [
        ("mixed-options", f"--{name.replace('_', '-')} belongs to {owner}; leave it out, or choose these")
        for name, (fits, owner) in wanted.items()
        if getattr(options, name) not in (None, ()) and not fits
    ]
    deviation, weight = options.prior_deviation, options.prior_weight
    if deviation is not None and not 0.0 < deviation < math.inf:
        found.append(("prior", f"prior deviation {deviation:g}: must be a positive number"))
    if weight is not None and not 0.0 <= weight < math.inf:
        found.append(("prior", f"prior weight {weight:g}: must be 0 or a positive number"))
    if estimator in SIMULATING and rows != "torque":
        text = f"--estimator {estimator} needs torque rows; leave --rows {rows} out"
        found.append(("mixed-options", text))
    if found:
        raise UsageError(*(Notice(code=f"usage.{code}", text=text) for code, text in found))


def build_estimator_options(
    robot: Robot,
    library: Library,
    recordings: Sequence[Recording],
    estimator: str | None,
    options: RigidOptions,
    *,
    prior: Estimate | None = None,
) -> EstimatorOptions:
    """Return the options of an estimator; `prior` is of the same model, None for values of the robot file.

    Raises:
        UsageError: there is no prior, or the motion does not repeat.
    """
    if estimator == "ridge":
        deviation = options.prior_deviation
        known = (
            build_prior_of_card(library.card, (deviation or _DEVIATION) / 100.0)
            if prior is None
            else build_prior_of_estimate(prior, deviation or 1.0)
        )
        return EstimatorOptions(prior=known, prior_weight=options.prior_weight)
    if estimator == "consistent":
        return EstimatorOptions(bodies=build_bodies(robot))
    if estimator == "gls" and options.period:
        return EstimatorOptions(noise=estimate_period_noise(recordings, robot.processing, options.period))
    return EstimatorOptions()
