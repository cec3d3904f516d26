"""What rows and estimators of rigid robots take besides logs: which option belongs to which.

Input: options, a robot, its library, recordings. Output: `EstimatorOptions`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from symid.codegen.functions import ModelCard
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import Notice, UsageError
from symid.estimators.bodies import build_bodies
from symid.estimators.estimate import Estimate
from symid.estimators.estimators import EstimatorOptions
from symid.estimators.prior import Prior, build_prior_of_card, build_prior_of_estimate
from symid.identification.storage import read_estimate
from symid.identification.validate import check_model
from symid.robot.description import Robot
from symid.rows.period_noise import find_period_noise

__all__ = [
    "ESTIMATOR_NAMES",
    "OUTPUT_ERROR",
    "SIMULATING",
    "RigidOptions",
    "build_estimator_options",
    "check_estimator",
    "check_rigid_options",
    "find_estimate",
]

OUTPUT_ERROR = "output-error"
"""See `symid.identification.output_error_estimate`."""
SIMULATING = (OUTPUT_ERROR, "instrumental")
"""Estimators that simulate the robot; the other one is in `symid.identification.instrumental_estimate`."""
ESTIMATOR_NAMES = ("ols", "wls", "gls", "huber", "ridge", "consistent", "sequential", *SIMULATING)
_WINDOWED = ("momentum", "filtered", "energy")
_OVERLAPPING = ("momentum", "energy")
_DEVIATION = 20.0
_ROBOT = "robot"


@dataclass(frozen=True, slots=True, kw_only=True)
class RigidOptions:
    """Options of rows and estimators; None, or nothing, where not given.

    Args:
        rows: how measurements become equations; torque by default.
        estimator: how equations become parameters; ols by default.
        window: s, the length of a momentum, filtered or energy row.
        overlap: part of a window that the next one shares.
        period: s, of the motion, once or once a log: noise is what differs between periods (gls).
        prior: an estimate, its file, or "robot" for the robot file's values (ridge).
        prior_deviation: percent of the robot file's values, or a factor on an estimate's deviations.
        prior_weight: 1 to believe the deviations stated, 0 for no prior; None to choose by cross validation.
        start: an estimate, or its file, that a simulating estimator begins with.
        partial: whether to fit what can be told where logs tell less than three quarters.
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
        names = (
            "rows",
            "estimator",
            "period",
            "overlap",
            "prior",
            "prior_deviation",
            "prior_weight",
            "start",
            "partial",
        )
        given = (name for name in names if getattr(self, name) not in (None, (), False))
        return tuple(f"--{name.replace('_', '-')}" for name in given)


def check_estimator(rows: str, estimator: str | None) -> None:
    """Refuse an estimator that no rows of a rigid robot know.

    Raises:
        UsageError: there is no such estimator; those of friction laws are others.
    """
    if estimator not in {None, *ESTIMATOR_NAMES}:
        text = (
            f"estimator {estimator!r}: there is no such estimator of {rows} rows; allowed are "
            f"{', '.join(ESTIMATOR_NAMES)}; those of friction laws go with --rows friction"
        )
        raise UsageError(Notice(code="usage.unknown-estimator", text=text))


def check_rigid_options(rows: str, estimator: str, options: RigidOptions) -> None:
    """Refuse options that rows or estimator do not read.

    Args:
        rows: kind of rows.
        estimator: its name.
        options: those given.

    Raises:
        UsageError: an option belongs to other rows or to another estimator, or is out of range.
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
        if getattr(options, name) not in (None, ()) and not fits
    ]
    if options.prior_deviation is not None and not 0.0 < options.prior_deviation < math.inf:
        text = f"prior deviation {options.prior_deviation:g}: must be a positive number"
        notices.append(Notice(code="usage.prior", text=text))
    if options.prior_weight is not None and not 0.0 <= options.prior_weight < math.inf:
        text = f"prior weight {options.prior_weight:g}: must be 0 or a positive number"
        notices.append(Notice(code="usage.prior", text=text))
    if estimator in SIMULATING and rows != "torque":
        text = f"--estimator {estimator} is one of torques; leave --rows {rows} out"
        notices.append(Notice(code="usage.mixed-options", text=text))
    if notices:
        raise UsageError(*notices)


def build_estimator_options(
    robot: Robot, library: Library, recordings: Sequence[Recording], estimator: str, options: RigidOptions
) -> EstimatorOptions:
    """Return what the estimator needs.

    Args:
        robot: as it is identified.
        library: its functions.
        recordings: the logs.
        estimator: its name.
        options: those given.

    Raises:
        UsageError: there is no prior, or the motion does not repeat.
        EstimateError: the prior is of another model.
    """
    if estimator == "ridge":
        prior = _find_prior(library, options.prior or _ROBOT, options.prior_deviation)
        return EstimatorOptions(prior=prior, prior_weight=options.prior_weight)
    if estimator == "consistent":
        return EstimatorOptions(bodies=build_bodies(robot))
    if estimator == "gls" and options.period:
        return EstimatorOptions(noise=find_period_noise(recordings, robot.processing, options.period))
    return EstimatorOptions()


def _find_prior(library: Library, prior: Estimate | Path | str, deviation: float | None) -> Prior:
    if prior == _ROBOT:
        return build_prior_of_card(library.card, (_DEVIATION if deviation is None else deviation) / 100.0)
    found = find_estimate(Path(prior) if isinstance(prior, str) else prior, library.card)
    return build_prior_of_estimate(found, deviation or 1.0)


def find_estimate(estimate: Estimate | Path, card: ModelCard) -> Estimate:
    """Return an estimate of the model of `card`, read where it is a file.

    Raises:
        EstimateError: it cannot be read, or is of another model.
    """
    if isinstance(estimate, Path):
        return read_estimate(estimate, card)
    check_model(estimate, card)
    return estimate
