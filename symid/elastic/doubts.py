"""What speaks against an elastic identification: recordings that tell nothing, results to be doubted.

Input: recordings, or a fit and its rows. Output: errors with the reason, or notices with what to do.

Supported: standstill, no torque, torsion below the encoders' noise, impossible inertias, vague parameters,
rows that tell them badly apart, springs at their bounds, stops whose state the rows began without.
Not supported: delays between the channels; `data.alignment` finds them.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard, ParameterCard
from symid.data.filters import differentiate
from symid.data.recording import Recording
from symid.elastic.fit import ElasticFit, ElasticOutcome
from symid.elastic.methods import ENERGY_METHODS, ElasticWork, find_relative_deviations
from symid.elastic.signals import ElasticSignals, find_positions, find_settled
from symid.errors import IdentifiabilityError, LogError, Notice, UsageError
from symid.joint.plays import find_hysteresis_torque
from symid.residuals.doubts import warn_of_mass_matrix
from symid.robot.elasticity import Elasticity
from symid.rows.rows import warn_of_energy

__all__ = ["check_recordings", "find_unknown", "list_cards", "warn_of_condition", "warn_of_fit"]

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
    return _find_hidden(card, recordings)


def warn_of_fit(
    work: ElasticWork, fit: ElasticFit, condition: float, refused: Collection[int] = ()
) -> tuple[Notice, ...]:
    """Return what a reader of the result should doubt; nothing of springs that are `refused`, by joint."""
    return (
        *_warn_of_outcome(fit),
        *_warn_of_vague(work, fit),
        *warn_of_condition(work, fit, condition),
        *_warn_of_springs(work, fit, refused),
        *_warn_of_mass(work, fit),
    )


def _find_hidden(card: ModelCard, recordings: Sequence[Recording]) -> Mapping[int, Notice]:
    """Return a notice for every joint whose torsion drowns in noise, by joint.

    Raises:
        IdentifiabilityError: nothing moves, or all joints are such.
    """
    spans = np.zeros((len(recordings), card.size))
    torsions, scatters, noises = spans.copy(), spans.copy(), spans.copy()
    for index, recording in enumerate(recordings):
        motor, link = find_positions(recording)
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
    hidden = _find_dead(card, recordings)
    for joint in np.flatnonzero(drowned).tolist():
        said = _say_hidden(card.joints[joint].name, torsions[:, joint].max(), noises[:, joint].max())
        hidden.setdefault(joint, said)
    if len(hidden) == card.size:
        raise IdentifiabilityError(*hidden.values())
    return hidden


def _find_dead(card: ModelCard, recordings: Sequence[Recording]) -> dict[int, Notice]:
    """Return a notice for every joint of which one encoder never changes while the other one does."""
    moved = np.array([[np.ptp(side, axis=0) > 0.0 for side in find_positions(part)] for part in recordings])
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


def _say_hidden(joint: str, torsion: float, noise: float) -> Notice:
    text = (
        f"joint {joint!r}: its torsion spans {torsion:.3g}, the encoders' noise is {noise:.3g}: nothing can "
        "be said of its spring; load it more, use finer encoders, or describe the joint as rigid"
    )
    return Notice(code="elastic.no-torsion", text=text)


def _warn_of_outcome(fit: ElasticFit) -> tuple[Notice, ...]:
    if fit.outcome in {ElasticOutcome.SOLVED, ElasticOutcome.CONVERGED}:
        return ()
    text = f"the method {fit.method} ended early: {fit.outcome.value}"
    return (Notice(code="elastic.outcome", text=text),)


def _warn_of_vague(work: ElasticWork, fit: ElasticFit) -> tuple[Notice, ...]:
    """Return what is known badly, and what is not known at all; what has no deviation is refused by name."""
    if fit.covariance is None:
        return ()
    cards = list_cards(work.problem.library.card)
    relative = find_relative_deviations(work, fit)
    unknown = find_unknown(work, fit)
    vague = [
        card.name
        for card, ratio in zip(cards, relative, strict=True)
        if _VAGUE < ratio < np.inf and card.name not in unknown
    ]
    return (*_say_unknown(unknown), *_say_vague(vague))


def list_cards(card: ModelCard) -> tuple[ParameterCard, ...]:
    """Return the cards of chi; an elastic joint whose file states no rotor has one nevertheless."""
    known = {entry.name: entry for entry in card.rotors}
    rotors = []
    for joint in card.joints:
        name = f"IA{joint.number}"
        unit = "kg" if joint.kind == "prismatic" else "kg m^2"
        plain = ParameterCard(name=name, expression=name, unit=unit, reason="", joint=joint.name)
        rotors.append(known.get(name, plain))
    return (*card.beta, *rotors, *card.friction)


def find_unknown(work: ElasticWork, fit: ElasticFit) -> Mapping[str, str]:
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
    motions = _find_motions(work.problem.signals)
    unknown = {}
    for entry, value, deviation in zip(list_cards(card), fit.chi.tolist(), deviations.tolist(), strict=True):
        little = _LITTLE * loads[entry.joint] / motions.get(entry.unit, 1.0)
        if max(abs(value), little) < deviation < np.inf:
            unknown[entry.name] = (
                f"its standard deviation of {deviation:.3g} exceeds its value of {value:.3g} {entry.unit}: "
                "these logs do not tell it"
            )
    return unknown


def _find_motions(signals: Sequence[ElasticSignals]) -> dict[str, float]:
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


def _say_unknown(names: Collection[str]) -> tuple[Notice, ...]:
    if not names:
        return ()
    text = (
        f"not told by these logs: {', '.join(names)}: one standard deviation exceeds the value, so that the "
        "value means nothing; move these joints, fast and slowly, alone and with the others"
    )
    return (Notice(code="elastic.not-told", text=text),)


def _say_vague(vague: Sequence[str]) -> tuple[Notice, ...]:
    if not vague:
        return ()
    text = (
        f"known to no better than {100 * _VAGUE:g} % (one standard deviation): {', '.join(vague)}; rotor and "
        "link inertias come apart by fast motions only, gravity parameters by poses: add such motions, or "
        "take rotor inertias from data sheets"
    )
    return (Notice(code="elastic.vague", text=text),)


def warn_of_condition(work: ElasticWork, fit: ElasticFit, condition: float) -> tuple[Notice, ...]:
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


def _warn_of_springs(work: ElasticWork, fit: ElasticFit, refused: Collection[int]) -> tuple[Notice, ...]:
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


def _warn_of_start(work: ElasticWork, fit: ElasticFit, joint: int) -> list[Notice]:
    """Return, for every recording, the stops whose state was not known yet when its rows began."""
    card, spring = work.problem.library.card.joints[joint], fit.elasticity[joint]
    notices = []
    for signals in work.problem.signals:
        phi = signals.phi[:, joint]
        most = float(np.max(np.abs(find_hysteresis_torque(spring, phi))))
        late = _find_late_stops(spring, phi, signals.settled, _FELT * most)
        if not late:
            continue
        radius = late[-1][0]
        end = float(signals.time[find_settled(phi, radius)] - signals.time[0])
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


def _find_late_stops(
    spring: Elasticity, phi: FloatArray, settled: int, least: float
) -> list[tuple[float, float]]:
    """Return thresholds and stiffnesses of the stops that slip at last, though not before sample `settled`.

    Stops that carry less than `least` (N m or N) are left out.
    """
    span, before = float(np.ptp(phi)), float(np.ptp(phi[: settled + 1]))
    return [
        (stop.threshold, stop.stiffness)
        for stop in spring.stops
        if stop.stiffness is not None
        and stop.threshold * stop.stiffness > least
        and before < 2.0 * stop.threshold <= 0.95 * span
    ]


def _warn_of_mass(work: ElasticWork, fit: ElasticFit) -> tuple[Notice, ...]:
    problem = work.problem
    poses = [
        Recording(time=signals.time, position=signals.q, torque=signals.tau) for signals in problem.signals
    ]
    return warn_of_mass_matrix(problem.library, np.asarray(fit.beta), poses)
