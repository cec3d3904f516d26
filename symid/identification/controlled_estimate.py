"""From a robot file with a controller and logs to an estimate like all others, by way of simulated runs.

Input: a robot whose file states the controller, its library, recordings with references, a `Way`.
Output: `Estimate`.

The iteration begins with an estimate given, with what the way itself begins with, or with a fit of torque
rows by wls to the same recordings. The
result is compared with what it stands on, the simulated runs; see `controlled_report`.

Supported: several recordings, of unequal weight. Not supported: elastic robots.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import ParameterCard
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import Notice, UsageError
from symid.estimators.estimate import Estimate, Outcome, ParameterEstimate
from symid.estimators.statistics import find_residuals
from symid.identification.controlled_report import (
    describe_controller,
    describe_tracking,
    find_controller_residual,
    warn_of_tracking,
)
from symid.identification.controlled_runs import ControlledFit
from symid.identification.identify import identify_parameters
from symid.identification.servo import ServoLoop, build_loop, find_unusable
from symid.residuals.doubts import warn_of_pattern, warn_of_vague
from symid.robot.controller import Controller
from symid.robot.description import Robot
from symid.robot.log_map import Processing
from symid.rows.cutoff import choose_filters
from symid.rows.identifiability import JOINT_AT_REST, RankRule

__all__ = ["Way", "check_controlled", "identify_controlled"]

_OWN_START = "torque rows by wls"


class _Fitting(Protocol):
    """From robot, recordings and controllers to a fit; see `fit_output_error`."""

    def __call__(
        self,
        library: Library,
        recordings: Sequence[Recording],
        loops: Sequence[ServoLoop],
        processing: Processing,
        start: Mapping[str, float],
        *,
        rule: RankRule | None = None,
        weights: Sequence[float] | None = None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> ControlledFit:
        """Return the fit."""


Judge = Callable[
    [ControlledFit, Processing, Sequence[Recording]], tuple[Mapping[str, object], tuple[Notice, ...]]
]
"""From a fit, its processing and the recordings to entries of `settings.fit` and notices."""
Begin = Callable[
    [Library, Sequence[Recording], Sequence[ServoLoop], Processing], tuple[Mapping[str, float], str] | None
]
"""From library, recordings, controllers and processing to parameters by name, and what they are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """How simulated runs become parameters.

    Args:
        name: of the estimator; fit: what it does.
        price: what follows where the simulated robot does not do as the real one.
        judge: adds to `settings.fit`, and notices.
        begin: finds what to begin with, None for a fit by wls.
        kept: codes of notices of the fit by wls that hold here too.
    """

    name: str
    fit: _Fitting
    price: str
    judge: Judge = lambda _found, _how, _recordings: ({}, ())
    begin: Begin = lambda _library, _recordings, _loops, _how: None
    kept: tuple[str, ...] = (JOINT_AT_REST,)


def identify_controlled(
    way: Way,
    robot: Robot,
    library: Library,
    recordings: Sequence[Recording],
    *,
    start: Estimate | None = None,
    start_name: str = "",
    rule: RankRule | None = None,
    weights: Sequence[float] | None = None,
    echo: Mapping[str, object] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> Estimate:
    """Return the parameters that an estimator finds with the help of the simulated robot.

    Args:
        way: the estimator.
        robot: rigid, with a controller; its processing is that of the rows.
        library: its functions.
        recordings: at least one, each with the reference of the controller.
        start: an estimate of the same model to begin with; None for a fit to the same recordings.
        start_name: what the result calls it.
        rule: when a parameter counts as not seen.
        weights: what the squares of each recording's residuals count for; one if None.
        echo: further settings to keep with the result.
        tell: called with a line about each iteration.

    Raises:
        UsageError: no controller or reference, elastic joints, friction that cannot be simulated.
        SolverError: the simulated robot ran away, or the iteration does not settle.
        LogError, IdentifiabilityError: as `identify_parameters`.
    """
    controller = check_controlled(robot, recordings)
    loops = [build_loop(recording, controller, _find_limit(robot)) for recording in recordings]
    first = identify_parameters(
        library, recordings, robot.processing, estimator="wls", rule=rule, weights=weights, echo=echo
    )
    processing = choose_filters(robot.processing, recordings).processing
    begun, begun_with = _list_start(library, start or first), start_name or _OWN_START
    own = None if start else way.begin(library, recordings, loops, processing)
    if own is not None:
        begun, begun_with = {**begun, **own[0]}, own[1]
    found = way.fit(library, recordings, loops, processing, begun, rule=rule, weights=weights, tell=tell)
    told, doubts = way.judge(found, processing, recordings)
    unexplained = find_controller_residual(loops, recordings, processing)
    report = {
        "start": begun_with,
        **describe_tracking(library, found),
        **told,
        "controller": describe_controller(controller, loops, recordings),
        "controller_residual_percent": unexplained,
    }
    kept = (notice for notice in first.notices if notice.code in way.kept)
    tracking = warn_of_tracking(found, unexplained, way.price)
    return replace(
        _build_estimate(library, found, first, (*kept, *_list_doubts(found), *tracking, *doubts)),
        estimator=way.name,
        settings=json.loads(json.dumps({**first.settings, "fit": report})),
    )


def _list_doubts(found: ControlledFit) -> tuple[Notice, ...]:
    """Return what equations and fit of the last iteration say, whatever the way."""
    pattern = warn_of_pattern(found.solution.simulated, found.fit, found.seen)
    return (*found.rows.notices, *found.seen.notices, *found.fit.notices, *pattern)


def _build_estimate(
    library: Library, found: ControlledFit, first: Estimate, notices: Sequence[Notice]
) -> Estimate:
    """Return the estimate of the last iteration; robot, sources and settings are those of `first`."""
    fit, seen = found.fit, found.seen
    kept = np.ix_(seen.learnable, seen.learnable)
    parameters = _list_parameters((*library.card.beta, *library.card.friction), found)
    return replace(
        first,
        rows="torque",
        parameters=parameters,
        residual=find_residuals(found.rows, fit.residuals, fit.spent),
        condition=fit.condition,
        outcome=Outcome.SOME_REFUSED if seen.refused else Outcome.SOLVED,
        samples=len(found.rows.values),
        refused=seen.refused,
        unresolved=_list_unresolved(found),
        covariance=tuple(tuple(row) for row in fit.covariance[kept].tolist()),
        notices=tuple(dict.fromkeys((*notices, *warn_of_vague(parameters)))),
    )


def check_controlled(robot: Robot, recordings: Sequence[Recording]) -> Controller:
    """Return the controller of a robot that can be simulated with it along the recordings.

    Raises:
        UsageError: the file states none, joints are elastic, or recordings have no reference.
    """
    problems = [notice for recording in recordings for notice in find_unusable(recording, robot.controller)]
    if any(robot.elastic):
        names = ", ".join(joint.name for joint, gives in zip(robot.axes, robot.elastic, strict=True) if gives)
        text = (
            f"this estimator simulates rigid robots, and {robot.name!r} gives between motor and link "
            f"({names}): take another one"
        )
        problems.append(Notice(code="usage.controlled-robot", text=text, file=robot.path))
    if robot.controller is None:
        text = (
            f"this estimator simulates the controller, and the file of {robot.name!r} states none: add "
            "[controller] with stiffness = [...] (N m/rad) and damping = [...] (N m s/rad), on the joint "
            "side, or --set controller.stiffness=... --set controller.damping=..."
        )
        problems.append(Notice(code="usage.controlled-robot", text=text, file=robot.path))
    if problems or robot.controller is None:
        raise UsageError(*problems)
    return robot.controller


def _find_limit(robot: Robot) -> FloatArray:
    limits = [joint.limits.torque for joint in robot.axes]
    return np.array([np.inf if entry is None else entry for entry in limits])


def _list_start(library: Library, estimate: Estimate) -> dict[str, float]:
    """Return a value for each parameter: what the estimate refuses is the robot file's, or zero."""
    cards = (*library.card.beta, *library.card.friction)
    known = dict(estimate.unresolved) | {entry.name: entry.value for entry in estimate.parameters}
    return {card.name: known.get(card.name, card.value or 0.0) for card in cards}


def _list_parameters(cards: Sequence[ParameterCard], found: ControlledFit) -> tuple[ParameterEstimate, ...]:
    values, deviations = found.fit.values, np.sqrt(np.diag(found.fit.covariance))
    return tuple(
        ParameterEstimate(
            name=card.name,
            value=float(values[index]),
            std=float(deviations[index]),
            unit=card.unit,
            expression=card.expression,
            reason=card.reason,
            truth=card.value,
        )
        for index, card in enumerate(cards)
        if found.seen.learnable[index]
    )


def _list_unresolved(found: ControlledFit) -> tuple[tuple[str, float], ...]:
    """Return the values of refused parameters that act together with others."""
    acting = found.seen.basis.any(axis=1) & ~found.seen.learnable
    return tuple((found.rows.names[k], float(found.fit.values[k])) for k in np.flatnonzero(acting))
