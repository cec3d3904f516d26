"""Output error and instrumental variables: robot file with a controller, logs -> an estimate like all others.

Robot whose file states the controller, its library, recordings with references -> `Estimate`.

The iteration begins with an estimate given, with instruments along the references, or with a fit of torque
rows by wls. The result states the controller and the distance of simulated and measured positions; where that
is more than a tenth of the tracking error, a warning says that the controller is another one. Instruments
add a test of least squares for bias.

Supported: several recordings, of unequal weight.
Not supported: elastic robots; locating the gain that is wrong.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import Notice, UsageError
from symid.identification.diagnostics import (
    build_warning,
    warn_of_correlated_residuals,
    warn_of_poorly_identifiable,
    warn_of_processing,
)
from symid.identification.estimators import Estimate, assess_exogeneity
from symid.identification.regression import JOINT_AT_REST, RankRule, choose_filters
from symid.identification.rigid.closed_loop import build_closed_loop, compute_demand, list_unusable
from symid.identification.rigid.closed_loop_fit import (
    ClosedLoopFit,
    ClosedLoopProblem,
    estimate_start,
    fit_instrumental,
    fit_output_error,
)
from symid.identification.rigid.evidence import FittedRows
from symid.identification.rigid.fit import build_estimate, identify_parameters
from symid.identification.rigid.plan import INSTRUMENTAL
from symid.logs import Recording, decimate
from symid.robot import Controller, Robot, list_controller

_FAR = 0.1
"""Part of the tracking error up to which simulated and measured positions may differ."""
_SHOWN = 4
_ROUNDING = 1e-16


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
    progress: Callable[[str], None] = lambda _: None,
) -> Estimate:
    """Return the parameters that an estimator, one of `SIMULATING`, finds with the simulated robot.

    Output error: the simulated torques approach the measured ones; the filter of the processing is not used.
    Instrumental: the equations of the measured states, with instruments from the simulated robot. `start` is
    an estimate of the same model to begin with, None for a fit to the same recordings, and `start_name` its
    name in the result; `progress` is called with a line about each iteration, the others are as for
    `identify_parameters`.

    Raises:
        UsageError: no controller or reference, elastic joints, friction that cannot be simulated.
        SolverError: the simulated robot ran away, or the iteration did not converge.
        LogError, IdentifiabilityError: as `identify_parameters`.
    """
    controller = check_closed_loop(robot, recordings)
    limits = np.array([np.inf if axis.limits.torque is None else axis.limits.torque for axis in robot.axes])
    filters = choose_filters(robot.processing, recordings)
    first = identify_parameters(
        library, recordings, filters.processing, estimator="wls", rule=rule, weights=weights, echo=echo
    )
    problem = ClosedLoopProblem(
        library=library,
        recordings=recordings,
        loops=[build_closed_loop(recording, controller, limits) for recording in recordings],
        processing=filters.processing,
        weights=weights,
    )
    given = start or first
    # What an estimate refuses is taken from the robot file, or is zero.
    known = dict(given.unresolved) | {entry.name: entry.value for entry in given.parameters}
    cards = (*library.card.beta, *library.card.friction)
    begun = {card.name: known.get(card.name, card.value or 0.0) for card in cards}
    begun_with = start_name or "torque rows by wls"
    chosen = filters.notices if estimator == INSTRUMENTAL else ()
    if estimator == INSTRUMENTAL:
        own = estimate_start(problem) if start is None else None
        if own is not None:
            begun, begun_with = {**begun, **own}, "instruments along the references"
    fit = fit_instrumental if estimator == INSTRUMENTAL else fit_output_error
    found = fit(problem, begun, rule=rule, progress=progress)
    verdict, warnings = _assess_instruments(found, problem)
    unexplained = _measure_controller_residual(problem)
    report = {
        "start": begun_with,
        **_describe_tracking(library, found),
        **verdict,
        "controller": _describe_controller(controller, problem),
        "controller_residual_percent": unexplained,
    }
    fitted = FittedRows(found.rows, found.identifiability, found.fit)
    left = robot.processing.left_open
    settings = {**first.settings, **({"chosen": list(left)} if left else {}), "fit": report}
    estimate = build_estimate(library.card, fitted, estimator, recordings, settings)
    notices = (
        *chosen,
        *(notice for notice in first.notices if notice.code == JOINT_AT_REST),
        *found.rows.notices,
        *found.identifiability.notices,
        *found.fit.notices,
        *warn_of_correlated_residuals(found.simulated, found.fit, found.identifiability),
        *_warn_of_tracking(found, unexplained, estimator),
        *warnings,
        *warn_of_poorly_identifiable(estimate.parameters),
    )
    return replace(estimate, notices=tuple(dict.fromkeys(notices)))


def _describe_tracking(library: Library, found: ClosedLoopFit) -> dict[str, object]:
    """Return the number of simulations, and distances of positions, joint by joint."""
    joints = zip(library.card.joints, found.tracking.tolist(), found.lag.tolist(), strict=True)
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
            for joint, gap, lag in joints
        ],
    }


def _describe_controller(controller: Controller, problem: ClosedLoopProblem) -> dict[str, object]:
    """Return the controller as stated, and what came from the logs; gains in SI units."""
    stated = list_controller(controller)
    logged = all(recording.reference_velocity is not None for recording in problem.recordings)
    return {
        **stated,
        **{key: list(map(float, stated[key])) for key in ("stiffness", "damping")},
        "velocity_filter": controller.velocity_filter,
        "offset": [loop.offset.tolist() for loop in problem.loops],
        "offset_from": "log" if controller.offset is None else "robot file",
        "reference_velocity": (
            "none" if controller.velocity == "measured" else "logged" if logged else "differentiated"
        ),
        "torque_limit": [entry if np.isfinite(entry) else None for entry in problem.loops[0].limit.tolist()],
    }


def _measure_controller_residual(problem: ClosedLoopProblem) -> list[float]:
    """Return (n,) percent of the logged torque that the controller does not explain."""
    missing: list[FloatArray] = []
    whole: list[FloatArray] = []
    for loop, recording in zip(problem.loops, problem.recordings, strict=True):
        gap = recording.torque - compute_demand(loop, recording)
        missing.append(decimate(gap, problem.processing.decimation))
        whole.append(decimate(recording.torque, problem.processing.decimation))
    size = np.linalg.norm(np.vstack(whole), axis=0)
    share = 100.0 * np.linalg.norm(np.vstack(missing), axis=0) / np.where(size > 0.0, size, 1.0)
    percents: list[float] = share.tolist()
    return percents


def _warn_of_tracking(
    found: ClosedLoopFit, unexplained: Sequence[float], estimator: str
) -> tuple[Notice, ...]:
    """Return a notice where simulated and measured robot do not follow the reference alike."""
    joints = np.flatnonzero(found.tracking > _FAR * found.lag).tolist()
    if not joints:
        return ()
    listed = ", ".join(
        f"{found.rows.group_names[index]!r} {found.tracking[index]:.2g} "
        f"{found.rows.velocity_units[index].removesuffix('/s')} ({found.lag[index]:.2g})"
        for index in joints
    )
    effect = (
        "the standard deviations are larger" if estimator == INSTRUMENTAL else "the parameters are biased"
    )
    missed = ", ".join(f"{unexplained[index]:.3g} %" for index in joints)
    limit = 100.0 * _FAR
    return (build_warning("identify.tracking", joints=listed, limit=limit, effect=effect, missed=missed),)


def check_closed_loop(robot: Robot, recordings: Sequence[Recording]) -> Controller:
    """Return the controller of a robot that can be simulated with it along the recordings.

    Raises:
        UsageError: the file states none, joints are elastic, or recordings have no reference.
    """
    problems = [notice for recording in recordings for notice in list_unusable(recording, robot.controller)]
    texts = []
    if any(robot.elastic):
        names = ", ".join(joint.name for joint, gives in zip(robot.axes, robot.elastic, strict=True) if gives)
        texts.append(
            f"this estimator simulates rigid robots, and {robot.name!r} has elastic joints ({names}): use "
            "another estimator"
        )
    if robot.controller is None:
        texts.append(
            f"this estimator simulates the controller, and the file of {robot.name!r} states none: add "
            "[controller] with stiffness = [...] (N m/rad) and damping = [...] (N m s/rad), on the joint "
            "side, or --set controller.stiffness=... --set controller.damping=..."
        )
    problems += [Notice(code="usage.controlled-robot", text=text, file=robot.path) for text in texts]
    if problems or robot.controller is None:
        raise UsageError(*problems)
    return robot.controller


def _assess_instruments(
    found: ClosedLoopFit, problem: ClosedLoopProblem
) -> tuple[Mapping[str, object], tuple[Notice, ...]]:
    """Return the quality of instruments and the test of least squares, with warnings; nothing without any."""
    solution, processing = found.instrumental, problem.processing
    if solution is None:
        return {}, ()
    test = assess_exogeneity(found.rows, solution, processing.noise_freedom)
    chance = f"= {test.probability:.2g}" if test.probability > _ROUNDING else "< 1e-16"
    verdict = "not biased by noise in the states"
    if test.biased:
        names = ", ".join(f"{name} {shift:+.2g}" for name, shift in test.biased[:_SHOWN])
        verdict = f"biased by noise in the states, in its standard deviations: {names}"
    elif test.significant:
        verdict = "significantly different, by less than its standard deviations"
    verdict = f"wls of these rows is {verdict} (p {chance})"
    report = {
        "instruments": {
            "correlation": solution.correlation,
            "strength": solution.strength if solution.strength < float("inf") else None,
        },
        "wls": {
            "biased": bool(test.biased),
            "statistic": test.statistic,
            "freedom": list(test.freedom),
            "probability": test.probability,
            "shifts": dict(test.shifts),
            "verdict": verdict,
        },
    }
    # Instruments allow raw differences, but not a filter that damps the motion.
    damping = [
        notice
        for notice in warn_of_processing(processing, problem.recordings)
        if notice.code == "identify.low-cutoff"
    ]
    biased = [build_warning("identify.biased-wls", verdict=verdict)] if test.biased else []
    return report, (*biased, *damping)
