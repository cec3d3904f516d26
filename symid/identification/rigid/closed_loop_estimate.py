"""Output error and instrumental variables: robot file with a controller, logs -> an estimate like all others.

Robot whose file states the controller, its library, recordings with references -> `Estimate`.

The iteration begins with an estimate given, with instruments along the references, or with a fit of torque
rows by wls to the same recordings. The result says what it stands on: the controller, and how near the
simulated runs came to the real ones. Where the simulated robot is further from the measured positions than
a tenth of what the controller leaves between these and its reference, the controller is another one.
Instruments add a verdict on least squares.

Supported: several recordings, of unequal weight; the controller's numbers are listed once, what came from a
log for each.
Not supported: elastic robots; saying which gain is the wrong one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import Notice, UsageError
from symid.identification.diagnostics import (
    warn_of_correlated_residuals,
    warn_of_poorly_identifiable,
    warn_of_processing,
)
from symid.identification.estimators import Estimate, Exogeneity, assess_exogeneity
from symid.identification.regression import JOINT_AT_REST, RankRule, choose_filters
from symid.identification.rigid.closed_loop import (
    ClosedLoop,
    build_closed_loop,
    compute_demand,
    list_unusable,
)
from symid.identification.rigid.closed_loop_fit import (
    ClosedLoopFit,
    estimate_start,
    fit_instrumental,
    fit_output_error,
)
from symid.identification.rigid.fit import (
    INSTRUMENTAL,
    OUTPUT_ERROR,
    FittedRows,
    build_estimate,
    identify_parameters,
)
from symid.logs import Recording, decimate
from symid.robot import Controller, Processing, Robot, list_controller

_FAR = 0.1
"""Simulated positions may be this part of the tracking error away from the measured ones."""


def describe_tracking(library: Library, found: ClosedLoopFit) -> dict[str, object]:
    """Return how many simulations it took, and how far positions are apart, joint by joint."""
    joints = library.card.joints
    return {
        "iterations": found.iterations,
        "changes": list(found.changes),
        "tracking": [
            {
                "joint": joint.name,
                "unit": joint.position_unit,
                "simulated_from_measured": gap,
                "reference_from_measured": lag,
            }
            for joint, gap, lag in zip(joints, found.tracking.tolist(), found.lag.tolist(), strict=True)
        ],
    }


def describe_controller(
    controller: Controller, loops: Sequence[ClosedLoop], recordings: Sequence[Recording]
) -> dict[str, object]:
    """Return what the controller was: as stated, and what came from the logs; gains in SI units."""
    stated = list_controller(controller)
    numbers = {key: list(map(float, stated[key])) for key in ("stiffness", "damping")}
    logged = all(recording.reference_velocity is not None for recording in recordings)
    return {
        **stated,
        **numbers,
        "velocity_filter": controller.velocity_filter,
        "offset": [loop.offset.tolist() for loop in loops],
        "offset_from": "log" if controller.offset is None else "robot file",
        "reference_velocity": (
            "none" if controller.velocity == "measured" else "logged" if logged else "differentiated"
        ),
        "torque_limit": [entry if np.isfinite(entry) else None for entry in loops[0].limit.tolist()],
    }


def measure_controller_residual(
    loops: Sequence[ClosedLoop], recordings: Sequence[Recording], processing: Processing
) -> list[float]:
    """Return (n,) percent of the logged torque that the controller does not ask for at measured positions."""
    missing: list[FloatArray] = []
    whole: list[FloatArray] = []
    for loop, recording in zip(loops, recordings, strict=True):
        gap = recording.torque - compute_demand(loop, recording)
        missing.append(decimate(gap, processing.decimation))
        whole.append(decimate(recording.torque, processing.decimation))
    size = np.linalg.norm(np.vstack(whole), axis=0)
    share = 100.0 * np.linalg.norm(np.vstack(missing), axis=0) / np.where(size > 0.0, size, 1.0)
    percents: list[float] = share.tolist()
    return percents


def warn_of_tracking(found: ClosedLoopFit, unexplained: Sequence[float], price: str) -> tuple[Notice, ...]:
    """Return a notice where the simulation follows its reference in another way than the log does.

    Args:
        found: the fit.
        unexplained: (n,) percent of the torque, of `measure_controller_residual`.
        price: what follows for the parameters.
    """
    joints = [
        index
        for index, (gap, lag) in enumerate(zip(found.tracking.tolist(), found.lag.tolist(), strict=True))
        if gap > _FAR * lag
    ]
    if not joints:
        return ()
    told = ", ".join(
        f"{found.rows.group_names[index]!r} {found.tracking[index]:.2g} "
        f"{found.rows.velocity_units[index].removesuffix('/s')} ({found.lag[index]:.2g})"
        for index in joints
    )
    missed = ", ".join(f"{unexplained[index]:.3g} %" for index in joints)
    text = (
        "the simulated robot is far from the measured positions, beside how far these are from their "
        f"reference (in brackets): {told}; model and controller do not track as the log does, and {price}; "
        f"at the measured positions the controller as stated misses {missed} of the logged torque; check "
        "its gains, velocity and filter, integral parts, feed-forward, and the side of the gear"
    )
    return (Notice(code="identify.tracking", text=text),)


_OWN_START = "torque rows by wls"
_REFERENCES = "instruments along the references"
_PRICES = {
    OUTPUT_ERROR: "the parameters bear the difference",
    INSTRUMENTAL: "the instruments are worse for it, which the deviations bear",
}
"""What follows where the simulated robot does not do as the real one."""
_KEPT = {OUTPUT_ERROR: (JOINT_AT_REST,), INSTRUMENTAL: (JOINT_AT_REST, "identify.automatic")}
"""Codes of notices of the fit by wls that hold here too."""
_SHOWN = 4
_ROUNDING = 1e-16
_BLURS = "identify.low-cutoff"


def identify_closed_loop(
    estimator: str,
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
        estimator: one of `SIMULATING`. Output error: the simulated robot needs the torques that were
            measured; the filter of the processing is not used. Instrumental: the equations of the measured
            states, with instruments from the simulated robot.
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
    controller = check_closed_loop(robot, recordings)
    limits = np.array([np.inf if axis.limits.torque is None else axis.limits.torque for axis in robot.axes])
    loops = [build_closed_loop(recording, controller, limits) for recording in recordings]
    first = identify_parameters(
        library, recordings, robot.processing, estimator="wls", rule=rule, weights=weights, echo=echo
    )
    processing = choose_filters(robot.processing, recordings).processing
    begun, begun_with = _list_start(library, start or first), start_name or _OWN_START
    own = None
    if estimator == INSTRUMENTAL and start is None:
        own = estimate_start(library, recordings, loops, processing)
    if own is not None:
        begun, begun_with = {**begun, **own}, _REFERENCES
    fit = fit_instrumental if estimator == INSTRUMENTAL else fit_output_error
    found = fit(library, recordings, loops, processing, begun, rule=rule, weights=weights, tell=tell)
    told, doubts = _judge_instruments(found, processing, recordings)
    unexplained = measure_controller_residual(loops, recordings, processing)
    report = {
        "start": begun_with,
        **describe_tracking(library, found),
        **told,
        "controller": describe_controller(controller, loops, recordings),
        "controller_residual_percent": unexplained,
    }
    fitted = FittedRows(found.rows, found.seen, found.fit)
    estimate = build_estimate(library.card, fitted, estimator, recordings, {**first.settings, "fit": report})
    notices = (
        *(notice for notice in first.notices if notice.code in _KEPT[estimator]),
        *found.rows.notices,
        *found.seen.notices,
        *found.fit.notices,
        *warn_of_correlated_residuals(found.solution.simulated, found.fit, found.seen),
        *warn_of_tracking(found, unexplained, _PRICES[estimator]),
        *doubts,
        *warn_of_poorly_identifiable(estimate.parameters),
    )
    return replace(estimate, notices=tuple(dict.fromkeys(notices)))


def check_closed_loop(robot: Robot, recordings: Sequence[Recording]) -> Controller:
    """Return the controller of a robot that can be simulated with it along the recordings.

    Raises:
        UsageError: the file states none, joints are elastic, or recordings have no reference.
    """
    problems = [notice for recording in recordings for notice in list_unusable(recording, robot.controller)]
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


def _list_start(library: Library, estimate: Estimate) -> dict[str, float]:
    """Return a value for each parameter: what the estimate refuses is the robot file's, or zero."""
    cards = (*library.card.beta, *library.card.friction)
    known = dict(estimate.unresolved) | {entry.name: entry.value for entry in estimate.parameters}
    return {card.name: known.get(card.name, card.value or 0.0) for card in cards}


def _judge_instruments(
    found: ClosedLoopFit, processing: Processing, recordings: Sequence[Recording]
) -> tuple[Mapping[str, object], tuple[Notice, ...]]:
    """Return how good instruments are and what they say of least squares; nothing without any."""
    solution = found.solution.instrumental
    if solution is None:
        return {}, ()
    verdict = assess_exogeneity(found.rows, solution, processing.noise_freedom)
    strong = solution.strength < float("inf")
    told = {
        "instruments": {
            "correlation": solution.correlation,
            "strength": solution.strength if strong else None,
        },
        "wls": {
            "biased": bool(verdict.biased),
            "statistic": verdict.statistic,
            "freedom": list(verdict.freedom),
            "probability": verdict.probability,
            "shifts": dict(verdict.shifts),
            "verdict": _say_verdict(verdict),
        },
    }
    # Raw differences are what instruments are for; a filter that damps the motion is not.
    blurs = (notice for notice in warn_of_processing(processing, recordings) if notice.code == _BLURS)
    return told, (*_warn_of_bias(verdict), *blurs)


def _say_verdict(verdict: Exogeneity) -> str:
    chance = "chance below 1e-16"
    if verdict.probability > _ROUNDING:
        chance = f"chance {verdict.probability:.2g}"
    if verdict.biased:
        names = ", ".join(f"{name} {shift:+.2g}" for name, shift in verdict.biased[:_SHOWN])
        return f"wls of these rows is biased by noise in the states, in its deviations: {names} ({chance})"
    if verdict.told:
        return f"wls of these rows differs, by less than its deviations but by more than chance ({chance})"
    return f"wls of these rows is not biased by noise in the states, as far as can be told ({chance})"


def _warn_of_bias(verdict: Exogeneity) -> tuple[Notice, ...]:
    if not verdict.biased:
        return ()
    text = (
        f"{_say_verdict(verdict)}: the filter leaves too much noise in the states, or blurs where joints "
        "turn around (processing.filter_cutoff, decimation, processing.standstill); all fits of torque rows "
        "of this log but this one bear it"
    )
    return (Notice(code="identify.biased-wls", text=text),)
