"""Identification of elastic joints: recordings of both encoders to dynamics, friction and hysteresis.

    Recording -> signals -> rows -> methods -> choice -> estimate, residuals, warnings

A spring is refused where nothing of the joint torque that the motor equation shows is its doing: where it
leaves `_NOTHING` or more of the scatter of that torque, or has no stiffness at all. Warnings: standstill,
no torque, torsion below the noise of the encoders, impossible inertias, poorly identifiable parameters,
badly conditioned rows, springs at their bounds, stops whose state was not known when the rows began.

Supported: several recordings; one method, or an automatic choice among those that take moments.
Not supported: delays between channels and offsets of encoders (align the recordings first); one encoder
only.
"""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard, ParameterCard
from symid.errors import IdentifiabilityError, LogError, Notice, UsageError
from symid.identification.diagnostics import warn_of_mass_matrix
from symid.identification.elastic.estimate import (
    ElasticEstimate,
    MethodFit,
    MethodTrial,
    SpringEstimate,
    name_friction,
)
from symid.identification.elastic.methods import (
    ENERGY_METHODS,
    ElasticEquations,
    MethodSelection,
    build_elastic_equations,
    build_linear_rows,
    choose_fit,
    compute_relative_deviations,
    compute_spring_torque,
    fit_candidates,
    fit_method,
)
from symid.identification.elastic.options import ElasticOptions, NlpOptions
from symid.identification.elastic.regression import (
    ElasticSignals,
    compute_window_work,
    get_encoder_positions,
    locate_settled,
)
from symid.identification.elastic.uncertainty import measure_identifiability
from symid.identification.estimators import Residual, list_parameters
from symid.identification.regression import warn_of_energy
from symid.ipopt import Ending
from symid.joint_models import compute_hysteresis_torque
from symid.logs import Recording, differentiate

_NOTHING = 0.9
"""Of the joint torque's scatter; a spring that leaves as much explains less than a fifth of its square."""


def compute_torque_residuals(work: ElasticEquations, fit: MethodFit) -> tuple[Residual, ...]:
    """Return, joint by joint, F[tau] less what motor and spring explain, N m or N."""
    problem = work.problem
    target, spring = _compute_joint_torques(work, fit)
    errors = target - spring
    return tuple(
        Residual.measure(card.name, errors[:, joint], problem.torque[:, joint], card.torque_unit)
        for joint, card in enumerate(problem.library.card.joints)
    )


def judge_springs(
    work: ElasticEquations, fit: MethodFit, hidden: Mapping[int, Notice], doubts: Sequence[Notice] = ()
) -> Mapping[int, Notice]:
    """Return, by joint, why its spring is refused; joints whose spring is told are left out.

    Args:
        work: the equations.
        fit: what was made of them.
        hidden: joints whose torsion cannot be seen, with what is said of them.
        doubts: what else may be the cause, to be said where all are refused.

    Raises:
        IdentifiabilityError: no joint has a spring that can be told.
    """
    target, spring = _compute_joint_torques(work, fit)
    left, whole = np.std(target - spring, axis=0), np.std(target, axis=0)
    refused = dict(hidden)
    for joint, card in enumerate(work.problem.library.card.joints):
        stiff = fit.elasticity[joint].initial_stiffness
        if joint not in refused and not (stiff and left[joint] < _NOTHING * whole[joint]):
            share = 100.0 * left[joint] / max(whole[joint], 1e-300)
            text = (
                f"joint {card.name!r}: no spring explains its torque: of the scatter of the joint torque "
                f"that the motor equation shows, the one found leaves {share:.0f} %, and less than "
                f"{100 * _NOTHING:g} % was wanted; check the sign and the factor of the torque, and whether "
                "the positions of motor and link are swapped; where these are right, load the joint more, or "
                "try another method"
            )
            refused[joint] = Notice(code="elastic.no-spring", text=text)
    if len(refused) == work.problem.sizes[1]:
        raise IdentifiabilityError(*(refused[joint] for joint in sorted(refused)), *doubts)
    return {joint: refused[joint] for joint in sorted(refused)}


def _compute_joint_torques(work: ElasticEquations, fit: MethodFit) -> tuple[FloatArray, FloatArray]:
    """Return F[tau_J] (M, n) by the motor equation, and by the springs."""
    problem = work.problem
    spring = [compute_spring_torque(problem, fit, number) for number in range(len(problem.signals))]
    return problem.find_motor_side(fit.chi), np.concatenate(spring)


def compute_energy_residual(work: ElasticEquations, fit: MethodFit) -> Residual:
    """Return the energy supplied less what springs, links, rotors and friction took, J."""
    problem = work.problem
    taken = [
        compute_window_work(fit.elasticity, signals, rows)
        for signals, rows in zip(problem.signals, problem.energy, strict=True)
    ]
    errors = problem.supplied - np.concatenate(taken) - problem.design @ fit.chi
    return Residual.measure("all joints", errors, problem.supplied, "J")


def list_springs(
    work: ElasticEquations, fit: MethodFit, refused: Mapping[int, Notice]
) -> tuple[SpringEstimate, ...]:
    """Return the spring of every joint, and how far it was seen; `refused` comes from `judge_springs`."""
    card, signals = work.problem.library.card, work.problem.signals
    springs = []
    for joint, (entry, elasticity) in enumerate(zip(card.joints, fit.elasticity, strict=True)):
        phi = [part.phi[:, joint] for part in signals]
        torque = [compute_hysteresis_torque(elasticity, part) for part in phi]
        # A stop is sure to have slipped once the torsion's range exceeds twice its threshold.
        span = max(float(np.ptp(part)) for part in phi)
        slipped = [stop.threshold for stop in elasticity.stops if 2.0 * stop.threshold <= span]
        stated = card.elasticity[joint]
        springs.append(
            SpringEstimate(
                joint=entry.name,
                torque_unit=entry.torque_unit,
                position_unit=entry.position_unit,
                elasticity=elasticity,
                torsion=max(float(np.abs(part).max()) for part in phi),
                excited=max(slipped, default=0.0),
                torque=max(float(np.abs(part).max()) for part in torque),
                truth=stated if stated is not None and stated.initial_stiffness is not None else None,
                told=joint not in refused,
                reason=refused[joint].text if joint in refused else "",
            )
        )
    return tuple(springs)


_CLEAR = 10.0
"""Of the torsion's range to the noise of both encoders; less is no torsion to fit."""
_ABOVE = 4.0
"""Of the torsion's standard deviation to that noise, which alone spans eight times its own and more; at
three, the springs of a simulated arm came out a third off."""
_VAGUE = 0.3
_LITTLE = 0.05
"""Of a joint's torque."""
_GRAVITY = 9.81
_ILL = 300.0
_ILL_ENERGY = 100.0
"""Energy rows stand for all joints at once: what they tell badly, no weighting of joints mends."""
_FELT = 0.01
"""Of the largest torque of a spring; stops that carry less do not matter."""


def check_recordings(card: ModelCard, recordings: Sequence[Recording]) -> Mapping[int, Notice]:
    """Return which joints give too little to say anything of their springs, with what to do, by joint.

    Raises:
        UsageError: the robot is not elastic, or there is no recording.
        LogError: a recording has another number of joints, or only one encoder.
        IdentifiabilityError: nothing moves, no torque is measured, or every joint's torsion drowns in noise.
    """
    if not card.elastic:
        text = (
            f"the robot {card.robot!r} has joints that do not give: state [joint.elasticity] for every "
            "joint, or identify it as a rigid robot"
        )
        raise UsageError(Notice(code="usage.not-elastic", text=text))
    if not recordings:
        raise UsageError(Notice(code="usage.no-log", text="no log was given: name at least one"))
    wrong = [
        Notice(
            code="log.joints",
            text=f"the log has {recording.position.shape[1]} joints, "
            f"the robot {card.robot!r} has {card.size}",
            file=recording.source,
        )
        for recording in recordings
        if recording.position.shape[1] != card.size
    ]
    if wrong:
        raise LogError(*wrong)
    if all(np.all(np.ptp(recording.torque, axis=0) == 0.0) for recording in recordings):
        text = (
            "the measured torque of every joint is zero, or the same number, throughout: check the torque "
            "columns of the log and their factors"
        )
        raise IdentifiabilityError(Notice(code="elastic.no-torque", text=text))
    return _list_hidden(card, recordings)


def warn_of_fit(
    work: ElasticEquations, fit: MethodFit, condition: float, refused: Collection[int] = ()
) -> tuple[Notice, ...]:
    """Return what a reader of the result should doubt; nothing of springs that are `refused`, by joint."""
    notices = []
    if fit.outcome not in {Ending.SOLVED, Ending.CONVERGED}:
        text = f"the method {fit.method} ended early: {fit.outcome.value}"
        notices.append(Notice(code="elastic.outcome", text=text))
    poses = [Recording(time=part.time, position=part.q, torque=part.tau) for part in work.problem.signals]
    return (
        *notices,
        *_warn_of_deviations(work, fit),
        *warn_of_condition(work, fit, condition),
        *_warn_of_springs(work, fit, refused),
        *warn_of_mass_matrix(work.problem.library, fit.beta, poses),
    )


def _list_hidden(card: ModelCard, recordings: Sequence[Recording]) -> Mapping[int, Notice]:
    """Return a notice for every joint whose torsion drowns in noise, by joint.

    Raises:
        IdentifiabilityError: nothing moves, or all joints are such.
    """
    spans = np.zeros((len(recordings), card.size))
    torsions, scatters, noises = spans.copy(), spans.copy(), spans.copy()
    for index, recording in enumerate(recordings):
        motor, link = get_encoder_positions(recording)
        spans[index] = np.ptp(motor, axis=0)
        torsions[index] = np.ptp(motor - link, axis=0)
        scatters[index] = np.std(motor - link, axis=0)
        steps = [np.diff(values, n=3, axis=0) for values in (motor, link)]
        noises[index] = np.sqrt(sum(np.mean(step**2, axis=0) for step in steps) / 20.0)
    if np.all(spans <= _CLEAR * noises):
        text = (
            "no joint moves in these logs beyond the noise of its encoders: record motions in which every "
            "joint accelerates, turns both ways and carries load"
        )
        raise IdentifiabilityError(Notice(code="elastic.standstill", text=text))
    drowned = np.all((torsions <= _CLEAR * noises) | (scatters <= _ABOVE * noises), axis=0)
    hidden = _list_dead_encoders(card, recordings)
    for joint in np.flatnonzero(drowned).tolist():
        text = (
            f"joint {card.joints[joint].name!r}: its torsion spans {torsions[:, joint].max():.3g}, the "
            f"encoders' noise is {noises[:, joint].max():.3g}: nothing can be said of its spring; load it "
            "more, use finer encoders, or describe the joint as rigid"
        )
        hidden.setdefault(joint, Notice(code="elastic.no-torsion", text=text))
    if len(hidden) == card.size:
        raise IdentifiabilityError(*hidden.values())
    return hidden


def _list_dead_encoders(card: ModelCard, recordings: Sequence[Recording]) -> dict[int, Notice]:
    """Return a notice for every joint of which one encoder never changes while the other one does."""
    moved = np.array(
        [[np.ptp(side, axis=0) > 0.0 for side in get_encoder_positions(part)] for part in recordings]
    )
    motor, link = np.any(moved, axis=0)
    dead = {}
    for joint in np.flatnonzero(motor != link).tolist():
        side, other = ("link", "motor") if motor[joint] else ("motor", "link")
        text = (
            f"joint {card.joints[joint].name!r}: the {side} encoder never changes while that of the {other} "
            "does: their difference is no torsion, and nothing can be said of its spring; check the column"
        )
        dead[joint] = Notice(code="elastic.dead-encoder", text=text)
    return dead


def _warn_of_deviations(work: ElasticEquations, fit: MethodFit) -> tuple[Notice, ...]:
    """Return what is known badly, and what is not known at all; what has no deviation is refused by name."""
    if fit.covariance is None:
        return ()
    unknown = list_unknown_parameters(work, fit)
    cards, relative = list_parameter_cards(work.problem.library.card), compute_relative_deviations(work, fit)
    vague = [
        card.name
        for card, ratio in zip(cards, relative, strict=True)
        if _VAGUE < ratio < np.inf and card.name not in unknown
    ]
    notices = []
    if unknown:
        text = (
            f"not told by these logs: {', '.join(unknown)}: one standard deviation exceeds the value, so "
            "that the value means nothing; move these joints, fast and slowly, alone and with the others"
        )
        notices.append(Notice(code="elastic.not-told", text=text))
    if vague:
        text = (
            f"known to no better than {100 * _VAGUE:g} % (one standard deviation): {', '.join(vague)}; rotor "
            "and link inertias come apart by fast motions only, gravity parameters by poses: add such "
            "motions, or take rotor inertias from data sheets"
        )
        notices.append(Notice(code="elastic.vague", text=text))
    return tuple(notices)


def list_parameter_cards(card: ModelCard) -> tuple[ParameterCard, ...]:
    """Return the cards of chi; an elastic joint whose file states no rotor has one nevertheless."""
    known = {entry.name: entry for entry in card.rotors}
    rotors = []
    for joint in card.joints:
        name = f"IA{joint.number}"
        unit = "kg" if joint.kind == "prismatic" else "kg m^2"
        plain = ParameterCard(name=name, expression=name, unit=unit, reason="", joint=joint.name)
        rotors.append(known.get(name, plain))
    return (*card.beta, *rotors, *card.friction)


def list_unknown_parameters(work: ElasticEquations, fit: MethodFit) -> Mapping[str, str]:
    """Return the parameters whose deviation exceeds their value and what is little, with the reason.

    Little is what gives 5 % of its joint's torque at most in motions like those of the fastest joint: what
    surely lies below is known to be about zero, and a joint that hardly moves makes nothing little.
    """
    if fit.covariance is None:
        return {}
    card = work.problem.library.card
    deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    torque = np.sqrt(np.mean(np.concatenate([part.tau for part in work.problem.signals]) ** 2, axis=0))
    loads = {joint.name: float(load) for joint, load in zip(card.joints, torque, strict=True)}
    motions = _measure_motions(work.problem.signals)
    unknown = {}
    for entry, value, deviation in zip(
        list_parameter_cards(card), fit.chi.tolist(), deviations.tolist(), strict=True
    ):
        little = _LITTLE * loads[entry.joint] / motions.get(entry.unit, 1.0)
        if max(abs(value), little) < deviation < np.inf:
            unknown[entry.name] = (
                f"its standard deviation of {deviation:.3g} exceeds its value of {value:.3g} {entry.unit}: "
                "these logs do not tell it"
            )
    return unknown


def _measure_motions(signals: Sequence[ElasticSignals]) -> dict[str, float]:
    """Return what a parameter of each unit is multiplied by in the torque, RMS, at the fastest joint."""
    speed = max(float(np.sqrt(np.mean(part.dtheta**2, axis=0)).max()) for part in signals)
    pull = max(
        float(np.sqrt(np.mean(differentiate(part.dtheta, part.period) ** 2, axis=0)).max())
        for part in signals
    )
    return {
        "kg m^2": pull + speed**2,
        "kg m": max(_GRAVITY, pull),
        "kg": max(_GRAVITY, pull),
        "N m s/rad": speed,
        "N s/m": speed,
    }


def warn_of_condition(work: ElasticEquations, fit: MethodFit, condition: float) -> tuple[Notice, ...]:
    """Return what is to be said of rows that tell parameters badly apart."""
    energy = fit.method in ENERGY_METHODS
    notices = warn_of_energy(work.problem.sizes[1]) if energy else ()
    if condition <= (_ILL_ENERGY if energy else _ILL):
        return notices
    text = (
        f"the rows of method {fit.method} are badly conditioned ({condition:.3g}, columns scaled): small "
        "errors of the springs become large ones of the dynamics; compare with the method elimination"
    )
    return (*notices, Notice(code="elastic.condition", text=text))


def _warn_of_springs(work: ElasticEquations, fit: MethodFit, refused: Collection[int]) -> tuple[Notice, ...]:
    notices = []
    for joint, card in enumerate(work.problem.library.card.joints):
        if joint in refused or not fit.elasticity:
            continue
        spring = fit.elasticity[joint]
        if not spring.stiffness:
            text = (
                f"joint {card.name!r}: k0, the stiffness left when all stops slip, is at its bound of zero: "
                "no such spring holds a load, and no robot file can have it; load the joint more, to both "
                "sides, or ask for fewer stops"
            )
            notices.append(Notice(code="elastic.no-stiffness", text=text))
        notices += _warn_of_start(work, fit, joint)
    return tuple(notices)


def _warn_of_start(work: ElasticEquations, fit: MethodFit, joint: int) -> list[Notice]:
    """Return, for every recording, the stops whose state was not known yet when its rows began."""
    card, spring = work.problem.library.card.joints[joint], fit.elasticity[joint]
    notices = []
    for signals in work.problem.signals:
        phi = signals.phi[:, joint]
        most = float(np.max(np.abs(compute_hysteresis_torque(spring, phi))))
        span, before = float(np.ptp(phi)), float(np.ptp(phi[: signals.settled + 1]))
        late = [
            (stop.threshold, stop.stiffness)
            for stop in spring.stops
            if stop.stiffness is not None
            and stop.threshold * stop.stiffness > _FELT * most
            and before < 2.0 * stop.threshold <= 0.95 * span
        ]
        if not late:
            continue
        radius = late[-1][0]
        end = float(signals.time[locate_settled(phi, radius)] - signals.time[0])
        start = float(signals.time[signals.settled] - signals.time[0])
        torque = sum(threshold * stiffness for threshold, stiffness in late)
        text = (
            f"joint {card.name!r}: rows begin at {start:.3g} s, but the state of its stop at {radius:.3g} "
            f"{card.position_unit} is known from {end:.3g} s on only, when the torsion has spanned twice "
            f"that: until then its torque may be wrong by up to {torque:.3g} {card.torque_unit}, which "
            "spring and dynamics inherit; begin logs with the largest load to both sides"
        )
        notices.append(Notice(code="elastic.unsettled", text=text))
    return notices


def identify_elastic(
    library: Library,
    recordings: Sequence[Recording],
    options: ElasticOptions | None = None,
    *,
    echo: Mapping[str, object] | None = None,
) -> ElasticEstimate:
    """Return dynamics, friction and springs that explain the recordings best.

    Args:
        library: the functions of an elastic robot.
        recordings: at least one, each with the positions of motors and links.
        options: method, grids, filters; None for the defaults.
        echo: further settings to keep with the result.

    Raises:
        UsageError: the robot is not elastic, no recording is given, or windows or thresholds do not fit.
        LogError: a recording lacks an encoder, has another number of joints, is too short or uneven.
        IdentifiabilityError: nothing moves, no torque is measured, all torsions drown in the encoders' noise,
            or no spring explains any joint's torque.
    """
    options = options or ElasticOptions()
    hidden = check_recordings(library.card, recordings)
    work = build_elastic_equations(library, tuple(recordings), options)
    fits: tuple[MethodFit, ...]
    if options.method == "automatic":
        fits = fit_candidates(work)
        choice = choose_fit(work, fits)
    else:
        fits = (fit_method(work, options.method),)
        choice = MethodSelection(fit=fits[0], scores=(), reason="the method was asked for")
    fit, errors = choice.fit, {score.name: score.error for score in choice.scores}
    cards = list_parameter_cards(library.card)
    told, condition = measure_identifiability(build_linear_rows(work, fit).design)
    springs = judge_springs(work, fit, hidden, warn_of_condition(work, fit, condition))
    return ElasticEstimate(
        robot=library.card.robot,
        signature=library.card.signature,
        friction=name_friction([entry.name for entry in cards]),
        method=fit.method,
        reason=choice.reason,
        parameters=list_parameters(cards, fit.chi, fit.covariance),
        springs=list_springs(work, fit, springs),
        residual=compute_torque_residuals(work, fit),
        energy=compute_energy_residual(work, fit),
        condition=condition,
        outcome=fit.outcome,
        history=fit.history,
        trials=tuple(
            MethodTrial(
                method=entry.method,
                outcome=entry.outcome,
                error=errors.get(entry.method),
                values=tuple(map(float, entry.chi)),
            )
            for entry in fits
        ),
        sources=tuple(recording.source for recording in recordings),
        settings=_write_settings(work, options, echo or {}),
        refused=_list_refused(library, told, list_unknown_parameters(work, fit), springs),
        covariance=() if fit.covariance is None else tuple(tuple(map(float, row)) for row in fit.covariance),
        notices=(
            *springs.values(),
            *choice.notices,
            *fit.notices,
            *warn_of_fit(work, fit, condition, springs),
        ),
    )


def _list_refused(
    library: Library, told: NDArray[np.bool_], unknown: Mapping[str, str], springs: Mapping[int, Notice]
) -> tuple[tuple[str, str], ...]:
    """Return names and reasons of the parameters and springs that the recordings cannot tell."""
    apart = "the motions of these recordings do not tell it apart from others"
    joints = library.card.joints
    return (
        *(
            (card.name, apart if not known else unknown[card.name])
            for card, known in zip(list_parameter_cards(library.card), told.tolist(), strict=True)
            if not known or card.name in unknown
        ),
        *((f"spring of {joints[joint].name}", notice.text) for joint, notice in springs.items()),
    )


def _write_settings(
    work: ElasticEquations, options: ElasticOptions, echo: Mapping[str, object]
) -> Mapping[str, object]:
    """Return the settings as JSON would give them back, with the cut-offs that were chosen."""
    cutoffs = [part.cutoff for part in work.problem.signals]
    grid = [list(map(float, entry)) for entry in work.problem.thresholds]
    settings = {**echo, **asdict(options), "cutoffs": cutoffs, "grid": grid}
    if options.nlp == NlpOptions():
        del settings["nlp"]
    plain: dict[str, object] = json.loads(json.dumps(settings))
    return plain
