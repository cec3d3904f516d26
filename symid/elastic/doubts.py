"""What speaks against an elastic identification: recordings that tell nothing, results to be doubted.

Input: recordings, or a fit and its rows. Output: errors with the reason, or notices with what to do.

Supported: standstill, torsion below the encoders' noise, impossible inertias, vague parameters.
Not supported: delays between the channels; `data.alignment` finds them.
"""

from collections.abc import Sequence

import numpy as np

from symid.codegen.functions import ModelCard
from symid.data.recording import Recording
from symid.elastic.fit import ElasticFit, ElasticOutcome
from symid.elastic.methods import ElasticWork, find_relative_deviations
from symid.elastic.signals import find_positions
from symid.errors import IdentifiabilityError, LogError, Notice, UsageError
from symid.identification.doubts import warn_of_mass_matrix

__all__ = ["check_recordings", "warn_of_fit"]

_CLEAR = 10.0
"""Of the torsion's range to the noise of both encoders; less is no torsion to fit."""
_VAGUE = 0.3
_ILL = 300.0


def check_recordings(card: ModelCard, recordings: Sequence[Recording]) -> tuple[Notice, ...]:
    """Return which joints give too little to say anything of their springs, with what to do.

    Raises:
        UsageError: the robot is not elastic, or there is no recording.
        LogError: a recording has another number of joints, or only one encoder.
        IdentifiabilityError: nothing moves, or the torsion of every joint drowns in noise.
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
    return _find_hidden(card, recordings)


def warn_of_fit(work: ElasticWork, fit: ElasticFit, condition: float) -> tuple[Notice, ...]:
    """Return what a reader of the result should doubt."""
    return (
        *_warn_of_outcome(fit),
        *_warn_of_vague(work, fit),
        *_warn_of_condition(fit, condition),
        *_warn_of_mass(work, fit),
    )


def _find_hidden(card: ModelCard, recordings: Sequence[Recording]) -> tuple[Notice, ...]:
    """Return a notice for every joint whose torsion drowns in noise.

    Raises:
        IdentifiabilityError: nothing moves, or all joints are such.
    """
    spans = np.zeros((len(recordings), card.size))
    torsions, noises = spans.copy(), spans.copy()
    for index, recording in enumerate(recordings):
        motor, link = find_positions(recording)
        spans[index] = np.ptp(motor, axis=0)
        torsions[index] = np.ptp(motor - link, axis=0)
        steps = [np.diff(values, n=3, axis=0) for values in (motor, link)]
        noises[index] = np.sqrt(sum(np.mean(step**2, axis=0) for step in steps) / 20.0)
    if np.all(spans <= _CLEAR * noises):
        text = (
            "no joint moves in these logs beyond the noise of its encoders: record motions in which every "
            "joint accelerates, turns both ways and carries load"
        )
        raise IdentifiabilityError(Notice(code="elastic.standstill", text=text))
    hidden = np.flatnonzero(np.all(torsions <= _CLEAR * noises, axis=0))
    notices = tuple(
        _say_hidden(card.joints[joint].name, torsions[:, joint].max(), noises[:, joint].max())
        for joint in hidden
    )
    if len(hidden) == card.size:
        raise IdentifiabilityError(*notices)
    return notices


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
    if fit.covariance is None:
        return ()
    card = work.problem.library.card
    rotors = [f"IA{joint.number}" for joint in card.joints]
    names = [*(entry.name for entry in card.beta), *rotors, *(entry.name for entry in card.friction)]
    relative = find_relative_deviations(work, fit)
    vague = [name for name, ratio in zip(names, relative, strict=True) if ratio > _VAGUE]
    if not vague:
        return ()
    text = (
        f"known to no better than {100 * _VAGUE:g} % (one standard deviation): {', '.join(vague)}; rotor and "
        "link inertias come apart by fast motions only, gravity parameters by poses: add such motions, or "
        "take rotor inertias from data sheets"
    )
    return (Notice(code="elastic.vague", text=text),)


def _warn_of_condition(fit: ElasticFit, condition: float) -> tuple[Notice, ...]:
    if condition <= _ILL:
        return ()
    text = (
        f"the rows of method {fit.method} are badly conditioned ({condition:.3g}, columns scaled): small "
        "errors of the springs become large ones of the dynamics; compare with the method elimination"
    )
    return (Notice(code="elastic.condition", text=text),)


def _warn_of_mass(work: ElasticWork, fit: ElasticFit) -> tuple[Notice, ...]:
    problem = work.problem
    poses = [
        Recording(time=signals.time, position=signals.q, torque=signals.tau) for signals in problem.signals
    ]
    return warn_of_mass_matrix(problem.library, np.asarray(fit.beta), poses)
