"""The verdict: what an identification is worth, in sentences.

Estimate of rigid or elastic joints and what it predicts of held-out logs, or friction laws with their
held-out blocks -> `FitVerdict`; what was predicted of a log -> `FitVerdict`; verdict -> text, JSON, notices.

The level starts from the prediction: of rigid joints what fits without a stretch of the logs leave of its
torque, within the band of the motion; of elastic joints what springs and dynamics leave unexplained there.
Estimates from different rows that contradict each other, values that no robot has, a motion that repeats, a
held-out log that is predicted worse, a missed true value, or an iteration that did not converge limit it.

    good      at most 10 %: what sensors and simple friction laws leave of an arm that is modelled right
    usable    at most 30 %: industrial arms with heavy gears and counterbalances reach 15 to 25 %
    doubtful  at most 60 %
    wrong     more, less than two thirds of the squared torque explained: columns, signs, units or the robot
              are not what they seem; or a single mistake explains what is left

Not supported: tests of the residual's whiteness; comparison between rows of different kinds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.identification import AnyValidation, ElasticValidation, FrictionValidation, RigidValidation
from symid.identification.elastic import ElasticEstimate, ElasticEvidence, ElasticTrial, JointTrial
from symid.identification.estimators import (
    SIGNIFICANT,
    Estimate,
    Evidence,
    ParameterEstimate,
    Residual,
    Validation,
    list_shares,
    split_uncertain,
)
from symid.identification.friction import FrictionIdentification
from symid.identification.judge import POLICY
from symid.ipopt import Ending
from symid.serialization import HIDDEN

LEVELS = ("wrong", "doubtful", "usable", "good")
"""Of a verdict, the worst first."""
QUANTITIES = {
    "torque": "torque",
    "filtered": "filtered torque",
    "momentum": "impulse",
    "energy": "work",
    "power": "filtered power",
    "friction": "torque",
}
"""What is measured and predicted, by the rows of a fit."""
_FITTED = "A log given for validation is one of the fit; it does not count as a test."
_LOST_REMEDY = (
    "Run `symid check` on the robot file and the log, and plot measured and predicted torques: is it the log "
    "of this robot, and are order, signs and units of its columns right?"
)

AnyEstimate = Estimate | ElasticEstimate | FrictionIdentification
"""What is judged."""
Caps = list[tuple[str, str]]
"""What limits a verdict: the best level that it allows, and why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitVerdict:
    """What a fit, or what it predicts of a log, is worth.

    Attributes:
        level: "good", "usable", "doubtful" or "wrong".
        headline: one sentence.
        cause: the likeliest single cause in a sentence; empty where none is known.
        remedy: what to do about it.
        details: further sentences.
        reasons: what the headline joins, a sentence each, where that is more than one.
    """

    level: str
    headline: str
    cause: str = ""
    remedy: str = ""
    details: tuple[str, ...]
    reasons: tuple[str, ...] = field(default=(), metadata=HIDDEN)


def show_verdict(verdict: FitVerdict) -> str:
    """Return the verdict in a line, with cause and remedy on lines of their own where there are any."""
    lines = (("verdict", f"{verdict.level} - {verdict.headline}"), ("cause", verdict.cause))
    return "\n".join(f"{name}: {text}" for name, text in (*lines, ("remedy", verdict.remedy)) if text)


def list_verdict_notices(verdict: FitVerdict, file: str = "", *, tried: bool = False) -> tuple[Notice, ...]:
    """Return the error of a wrong verdict, or the warning of a doubtful one; nothing for the others.

    `file` is what was judged; `tried` marks the verdict on a held-out log.
    """
    verb, what = ("validate", "prediction") if tried else ("identify", "fit")
    advice = {
        "wrong": "do not use it; --accept lets a script go on",
        "doubtful": "test it on another motion before you use it",
    }.get(verdict.level)
    text = f"the {what} is {verdict.level}, as its verdict says: {advice}"
    return (Notice(code=f"{verb}.{verdict.level}", text=text, file=file),) if advice else ()


def _limit(level: str, headline: str, details: Sequence[str], caps: Caps) -> FitVerdict:
    level = min((level, *(cap for cap, _ in caps)), key=LEVELS.index)
    wrong = [reason for cap, reason in caps if cap == "wrong"]
    reasons = (headline, *(f"{reason[:1].upper()}{reason[1:]}." for _, reason in caps))
    if wrong:
        headline = f"{wrong[0][:1].upper()}{wrong[0][1:]}."
    elif caps:
        headline = f"{headline} But {'; '.join(reason for _, reason in caps)}."
    remedy = _LOST_REMEDY if level == "wrong" else ""
    return FitVerdict(level=level, headline=headline, details=tuple(details), remedy=remedy, reasons=reasons)


def _rate(percent: float) -> str:
    """Return the level of a residual in percent, doubtful at least."""
    return "good" if percent <= POLICY.good else "usable" if percent <= POLICY.usable else "doubtful"


def rate_output(percent: float) -> str:
    """Return the level of what leaves so much of its output unexplained."""
    return "wrong" if percent > POLICY.lost else _rate(percent)


def _find_lost(residual: Sequence[Residual], logs: str) -> Caps:
    """Return the limit where most of the torque of the `logs` is not explained.

    A joint counts 100 % at most: one whose torque is all noise makes no fit of many joints wrong, nor does
    one with little torque beside others of the same unit.
    """
    shares = list_shares(residual)
    if not shares or not sum(min(100.0, share) for share in shares) > POLICY.lost * len(shares):
        return []
    if len({entry.unit for entry in residual}) == 1 and all(0.0 < share < math.inf for share in shares):
        whole = math.hypot(*(100.0 * entry.norm / entry.relative_percent for entry in residual))
        if not 100.0 * math.hypot(*(entry.norm for entry in residual)) > POLICY.lost * whole:
            return []
    mean = sum(shares) / len(shares)
    text = f"{mean:.3g} % of the torque" if math.isfinite(mean) else "larger than the torque"
    return [("wrong", f"the model does not explain {logs}: the residual is {text} (mean over joints)")]


_OWN = "the logs of the fit"
_LACKING = ("identify.structure", "identify.logs", "robot.no-friction")
"""Codes of causes that are no mistake in a log: terms that the model lacks, logs of different robots."""
_SAME, _DIFFERENT = "same", "different"


def _judge_evidence(evidence: Evidence) -> tuple[str, str, Caps]:
    """Return level, headline and limits: prediction, consistency, physics, data and causes."""
    percent = evidence.unexplained
    parts = f"{evidence.logs} logs" if evidence.logs else f"{evidence.stretches} stretches"
    headline = f"Held-out residual below {evidence.scoring:.3g} Hz: {percent:.3g} % of the torque "
    headline += f"(cross-validation over {parts})."
    level, caps, causes = rate_output(percent), list[tuple[str, str]](), evidence.causes
    if causes:
        # A single mistake that leaves much makes a fit wrong.
        worst, said = max(entry.before for entry in causes), "; or ".join(entry.cause for entry in causes)
        if len(causes) > 1 or causes[0].code in _LACKING:
            said = f"one of these would explain the residual: {said}" if len(causes) > 1 else said
            caps.append((min("usable", _rate(worst), key=LEVELS.index), said))
        else:
            fall = f"from {causes[0].before:.3g} % to {causes[0].after:.3g} %"
            text = f"{said}: corrected, the held-out residual falls {fall}"
            caps.append(("wrong" if worst > POLICY.good else "usable", text))
    if level == "wrong" and evidence.fitted <= POLICY.usable:
        # The model can follow these rows, and they are too few to identify its parameters.
        level = "doubtful"
        caps.append(
            (level, f"the fit itself has {evidence.fitted:.3g} %: the logs are too short for the model")
        )
    elif level == "wrong":
        said = "" if causes else "; no single mistake that was tested explains it"
        text = f"the model does not describe these logs: held-out residual {percent:.3g} %{said}"
        caps.append((level, text))
    least = [entry for entry in evidence.joints if entry.held_out > POLICY.usable]
    if least and len(evidence.joints) > 1:
        # Some joints alone make no fit wrong.
        least.sort(key=lambda entry: -entry.held_out)
        listed = ", ".join(f"{entry.joint} {entry.held_out:.3g} %" for entry in least)
        caps.append(("doubtful", f"single joints have larger residuals: {listed}"))
    caps += _list_contradictions(evidence)
    finds = 'gravity = "unknown" or zeros = "unknown" in the robot file finds it'
    caps += [
        ("usable", f"gravity is turned by {entry.part}, or the zero of a joint is off: {finds}")
        for entry in evidence.tests
        if entry.what == "gravity" and entry.verdict == _DIFFERENT
    ]
    if evidence.impossible:
        bounded = min(_rate(evidence.bounded), "usable", key=LEVELS.index)
        text = f"{'; '.join(evidence.impossible)}; consistent bodies have {evidence.bounded:.3g} %"
        caps.append((bounded, text))
    caps += [
        ("usable", f"{first} and {second} move in proportion: their parameters cannot be separated")
        for first, second in evidence.in_proportion
    ]
    if evidence.period:
        caps.append(
            ("usable", f"the motion repeats every {evidence.period:.3g} s: the fit was tested on no other")
        )
    return level, headline, caps


def _list_scale_caps(record: AnyEstimate) -> Caps:
    """Return the limits by torques of another size than the robot file's values or limits allow."""
    caps: Caps = []
    evidence = record.evidence if isinstance(record, Estimate) else None
    tests = () if evidence is None else evidence.tests
    off = [f"{entry.joint} {entry.part}" for entry in tests if entry.what == "scale"]
    if off:
        text = f"the torques differ in scale from the robot file's values: {', '.join(off)}"
        caps.append(("doubtful", f"{text}; check unit, gear and torque constant, or these values"))
    over = [f"{name} {torque / most:.2g} times" for name, (torque, most) in record.beyond_limit.items()]
    if over:
        text = f"the torques are far beyond the limits of the joints: {', '.join(over)}"
        caps.append(("doubtful", f"{text}; check unit, factor and gear, or these limits"))
    return caps


_WHAT = {
    "halves": "both halves of the log",
    "logs": "the logs",
    "slow rows": "slow and fast motion",
    "band": "the band and half of it",
}
"""What two estimates are from, by the name of their test."""


def _list_contradictions(evidence: Evidence) -> Caps:
    """Return what estimates from different rows contradict, or what cannot be tested."""
    caps: Caps = []
    for what, words in _WHAT.items():
        # Of a joint that is not explained nothing else needs to be tested, but whether one log explains it.
        known = {
            entry.joint for entry in evidence.joints if what == "logs" or entry.held_out <= POLICY.usable
        }
        tests = [entry for entry in evidence.tests if entry.what == what and entry.joint in known]
        differ = [entry for entry in tests if entry.verdict == _DIFFERENT]
        if differ:
            worst = max(entry.size for entry in differ)
            names = ", ".join(dict.fromkeys(entry.joint for entry in differ))
            text = f"{words} contradict each other, by up to {worst:.3g} % of a torque ({names})"
            if what == "logs":
                text += ": a payload, another robot, other friction or units; compare fits to each log alone"
            caps.append(("usable" if worst <= POLICY.good else "doubtful", text))
        elif any(entry.verdict != _SAME for entry in tests):
            worst = max(entry.bound for entry in tests)
            caps.append(
                ("usable", f"too short to test whether {words} agree (within {worst:.2g} % of a torque)")
            )
    return caps


def _list_validation_caps(held_out: Sequence[Validation]) -> Caps:
    caps: Caps = []
    for validation in held_out:
        caps += _find_lost(validation.residual, f"the held-out log {validation.source}")
    percent = max((validation.mean_relative_percent for validation in held_out), default=0.0)
    level = _rate(percent)
    if level != "good":
        limit = POLICY.good if level == "usable" else POLICY.usable
        caps.append((level, f"the residual of a held-out log exceeds {limit:g} %"))
    return caps


def judge_identification(estimate: Estimate, validations: Sequence[Validation]) -> FitVerdict:
    """Return the verdict on `estimate`."""
    held_out = [validation for validation in validations if not validation.fitted]
    evidence = estimate.evidence
    logs = "one log" if len(estimate.sources) == 1 else f"{len(estimate.sources)} logs"
    text = f"Fitted to {logs}, {estimate.samples} {estimate.rows} samples: residual "
    text += f"{estimate.mean_relative_percent:.3g} % (mean over joints)."
    details = [text, *([_FITTED] if len(held_out) < len(validations) else [])]
    # Small parameters of a large robot are uncertain in any log; their deviations say so.
    words, more = _judge_parameters(
        estimate.parameters, estimate.refused, small=evidence is not None, simulated=estimate.simulated
    )
    if evidence is None:
        level, headline = _judge_prediction(estimate, held_out)
        caps: Caps = [*_find_lost(estimate.residual, _OWN), *more]
    else:
        # Held-out logs are other motions, where the logs of the fit repeat one.
        level, headline, caps = _judge_evidence(replace(evidence, period=0.0) if held_out else evidence)
        caps += more
        least = max(evidence.joints, key=lambda entry: entry.held_out, default=None)
        if least is not None:
            details.append(
                f"The least predictable joint is {least.joint}: held-out residual {least.held_out:.3g} % of "
                f"its torque ({least.fitted:.3g} % in the fit, {least.moving:.3g} % in motion)."
            )
        slow = max((entry.share for entry in evidence.joints), default=0.0)
        if slow > 0.0:
            details.append(
                f"Up to {100.0 * slow:.3g} % of a joint's samples are slow and were left out of the fit; the "
                "residuals above include them."
            )
        if evidence.covered:
            ranges = "; ".join(
                f"{entry.joint} {entry.low:.3g} to {entry.high:.3g}, speed {entry.speed:.3g}, acceleration "
                f"{entry.acceleration:.3g}"
                for entry in evidence.covered
            )
            details.append(f"The fit covers these positions, speeds and accelerations (SI): {ranges}.")
        if held_out:
            tried, sentence = _judge_prediction(estimate, held_out)
            level, headline = min(level, tried, key=LEVELS.index), f"{sentence} {headline}"
    mounting: Any = estimate.settings.get("mounting", {})
    if turn := mounting.get("turn", ""):
        headline = f"{headline} {turn[0].upper()}{turn[1:]}."
    caps += [*_list_scale_caps(estimate), *_list_validation_caps(held_out)]
    details += words
    verdict = _limit(level, headline, details, caps)
    causes = () if evidence is None else evidence.causes
    if len(causes) != 1:
        return verdict if not causes else replace(verdict, remedy="")
    cause, remedy = causes[0].cause, causes[0].remedy
    return replace(
        verdict, cause=f"{cause[:1].upper()}{cause[1:]}.", remedy=f"{remedy[:1].upper()}{remedy[1:]}."
    )


def _judge_prediction(estimate: Estimate, validations: Sequence[Validation]) -> tuple[str, str]:
    if not validations:
        return "usable", "The parameters fit their own logs; no held-out log has tested them yet."
    same = [validation for validation in validations if validation.rows == estimate.rows]
    if not same:
        worst = max(validations, key=lambda validation: validation.mean_relative_percent)
        return "usable", (
            f"The residual of held-out logs is {worst.mean_relative_percent:.3g} % of the "
            f"{QUANTITIES[worst.rows]}{_name_band(worst)}; the fit was to {estimate.rows} equations, so the "
            "two residuals cannot be compared."
        )

    def compute_rms(residual: Residual) -> float:
        return residual.norm / math.sqrt(max(residual.samples, 1))

    # The largest ratio over joints of held-out to fitted rms; both count all rows, slow ones too. Within the
    # scoring band it is the rms of the log over that of the stretches that were held out in the fit.
    ratio, joint, sizes, source = -math.inf, "", "", ""
    for entry in same:
        fitted, parts = {one.joint: compute_rms(one) for one in estimate.residual}, "the fit"
        if entry.scoring and estimate.evidence is not None:
            found, parts = estimate.evidence.joints, "stretches held out in the fit"
            fitted = {one.joint: 0.01 * one.held_out * one.torque for one in found if one.torque}
        ratios = []
        for one in entry.residual:
            if fitted.get(one.joint):
                rms, own = compute_rms(one), fitted[one.joint]
                said = f"{rms:.3g} {one.unit} RMS beside {own:.3g} {one.unit} of {parts}"
                ratios.append((rms / own, f"of {one.joint} ", said))
        whole, mean = estimate.mean_relative_percent, entry.mean_relative_percent
        ratios = ratios or [(mean / whole if whole else 1.0, "", f"{mean:.3g} % beside {whole:.3g} %")]
        ratio, joint, sizes, source = max((ratio, joint, sizes, source), (*max(ratios), entry.source))
    percent = max(validation.mean_relative_percent for validation in same)
    left = f"residual {percent:.3g} % of the {QUANTITIES[estimate.rows]}{_name_band(same[0])}"
    if ratio**2 <= POLICY.fall_of_all:
        return "good", f"The model predicts held-out motions as well as those of the fit: {left}."
    larger = f"{left}, that {joint}is {ratio:.2g} times as large ({sizes}; {source})"
    if ratio <= POLICY.fall and percent <= POLICY.good:
        return "good", f"The model predicts held-out motions nearly as well as those of the fit: {larger}."
    if ratio <= POLICY.fall or percent <= POLICY.good:
        return "usable", f"The model predicts held-out motions less well than those of the fit: {larger}."
    return "doubtful", (
        f"The model does not predict held-out motions: on {source} the residual {joint}is {ratio:.2g} times "
        f"as large ({sizes}; {left}). A term may be missing in the model, or the robot has changed."
    )


def _name_band(validation: Validation) -> str:
    return f" below {validation.scoring:.3g} Hz" if validation.scoring else ""


def _judge_parameters(
    parameters: Sequence[ParameterEstimate],
    refused: Sequence[tuple[str, str]],
    tolerance: float = 0.0,
    *,
    small: bool = False,
    simulated: bool = False,
) -> tuple[list[str], Caps]:
    """Return how well parameters are known and how near the truth they are, and what that limits.

    Within `tolerance` percent a true value counts as met, whatever its standard deviation; where parameters
    may be `small`, uncertain ones limit nothing. Only values that logs were `simulated` from are true ones.
    """
    details, caps = [], list[tuple[str, str]]()
    uncertain, zero = split_uncertain(parameters)
    if parameters:
        sharp = sum(entry.relative_std_percent <= POLICY.good for entry in parameters)
        details.append(
            f"{sharp} of {len(parameters)} parameters have a standard deviation of at most {POLICY.good:g} %."
        )
        if uncertain:
            details.append(f"Uncertain by more than {POLICY.uncertain:g} %: {', '.join(uncertain)}.")
        if zero:
            details.append(f"Near zero, within {SIGNIFICANT:g} standard deviations: {', '.join(zero)}.")
    known = [entry for entry in parameters if entry.truth is not None]
    if known and simulated:
        far = [entry.name for entry in known if not entry.near_truth]
        text = f"{len(known) - len(far)} of {len(known)} true values lie within three standard deviations"
        details.append(f"{text}; not {', '.join(far)}." if far else f"{text}.")
    # A spring on a grid is a model, and what it lacks is no noise: hence the tolerance.
    off = [e for e in known if e.error_percent is None or not abs(e.error_percent) <= tolerance]
    missed, whole = [entry.name for entry in off if not entry.near_truth], len(known)
    if simulated and missed:
        # Beyond 3 std, one so far or so many that they are less likely than 1 %.
        bound = max(POLICY.printed, NormalDist().inv_cdf(1.0 - 0.5 * POLICY.alarm / whole))
        beyond = any(not abs(entry.value - (entry.truth or 0.0)) <= bound * entry.std for entry in off)
        share = 2.0 * NormalDist().cdf(-POLICY.printed)
        terms = (math.comb(whole, k) * share**k * (1.0 - share) ** (whole - k) for k in range(len(missed)))
        if beyond or 1.0 - sum(terms) < POLICY.alarm:
            level = "doubtful" if 2 * len(missed) > whole else "usable"
            caps.append((level, f"estimates differ significantly from true values: {', '.join(missed)}"))
    if not small and 2 * len(uncertain) > len(parameters):
        text = f"{len(uncertain)} of {len(parameters)} parameters are uncertain by over {POLICY.uncertain:g} "
        text += "%"
        caps.append(("usable", text))
    if refused:
        names = ", ".join(name for name, _ in refused)
        details.append(f"Not identifiable from these logs: {names}.")
        caps.append(("usable", "some parameters are not identifiable from these logs"))
    return details, caps


def judge_elastic(estimate: ElasticEstimate, trials: Sequence[ElasticTrial]) -> FitVerdict:
    """Return the verdict on dynamics and springs, and on what they predict of logs."""
    held_out = [trial for trial in trials if not trial.fitted]
    worst = max(entry.relative_percent for entry in estimate.residual)
    text = f"Method {estimate.method} ({estimate.outcome.value}): residual at most {worst:.3g} % of a "
    text += "motor's torque in the logs of the fit."
    details = [text, *([_FITTED] if len(held_out) < len(trials) else [])]
    caps: Caps = _find_lost(estimate.residual, _OWN)
    for trial in held_out:
        caps += _find_lost(trial.residuals[0][1], f"the held-out log {trial.source}")
    if not estimate.outcome.usable:
        caps.append(("doubtful", f"the method failed: {estimate.outcome.value}"))
    elif estimate.outcome not in (Ending.SOLVED, Ending.CONVERGED):
        caps.append(("usable", f"the iteration did not converge: {estimate.outcome.value}"))
    level = "usable"
    headline = "Dynamics and springs fit their own logs; no held-out log has tested them yet."
    if estimate.evidence is not None:
        level, headline, more = _judge_stretches(estimate, estimate.evidence)
        caps += more
    if held_out:
        tried, sentence, text = _judge_springs(held_out)
        level = tried if estimate.evidence is None else min(level, tried, key=LEVELS.index)
        headline = sentence if estimate.evidence is None else f"{sentence} {headline}"
        details.append(text)
    # Without standard deviations nothing can be said of chance.
    parameters = estimate.parameters if estimate.covariance else ()
    words, more = _judge_parameters(
        parameters, estimate.refused, 100.0 * POLICY.relevance, simulated=estimate.simulated
    )
    details += words
    errors = [(abs(entry.error_percent or 0.0), entry.name) for entry in estimate.parameters if entry.truth]
    if errors and estimate.simulated:
        error, name = max(errors)
        details.append(f"The largest error against a true value is {error:.2g} % ({name}).")
    return _limit(level, headline, details, caps + more + _list_scale_caps(estimate))


def _judge_stretches(estimate: ElasticEstimate, evidence: ElasticEvidence) -> tuple[str, str, Caps]:
    """Return level, headline and limits by held-out stretches of the logs, and by what springs leave."""
    percent, noise = max(evidence.held_out), max(evidence.noise)
    text = f"Held-out residual of the dynamics at most {percent:.3g} % of a motor's torque, {noise:.2g} "
    text += "times its noise"
    told = {spring.joint for spring in estimate.springs if spring.identifiable}
    joints = zip(evidence.springs, estimate.residual, strict=False)
    springs = [share for share, entry in joints if entry.joint in told]
    if springs:
        text += f"; of the springs at most {max(springs):.3g} % of a joint's torque"
    caps: Caps = []
    # Of a parameter; beyond its limit it is no chance.
    apart, known = (100.0 * POLICY.relevance * ratio for ratio in (evidence.contradiction, evidence.known))
    if _rate(apart) != "good":
        reason = "the dynamics with springs differ from those without: encoders or springs differ from the "
        reason += f"model (a parameter by {apart:.2g} %)"
        caps.append((_rate(apart), reason))
    if evidence.drifting:
        caps.append(("usable", f"friction of {', '.join(evidence.drifting)} changes during the logs"))
    if evidence.known > 1.0:
        reason = f"known parameters contradict the logs (one by {known:.2g} %)"
        caps.append((min("usable", _rate(known), key=LEVELS.index), reason))
    return _rate(max(percent, *springs, 0.0)), f"{text}.", caps


def _judge_springs(trials: Sequence[ElasticTrial]) -> tuple[str, str, str]:
    """Return level, headline and a comparison with linear springs, by the worst of all joints and logs.

    All figures but that of linear springs are those of the trials' tables.
    """
    joints = [joint for trial in trials for joint in trial.joints]
    tables = [entry for trial in trials for entry in trial.residuals[0][1]]
    dynamics, motor = max((entry.relative_percent, entry.joint) for entry in tables)
    whole = f"{dynamics:.3g} % of a motor's torque ({motor})"
    springs = [(joint, joint.final) for joint in joints if joint.final is not None]
    if len(springs) < len(joints):
        headline = f"On held-out motions the residual is at most {whole}."
        return _rate(dynamics), headline, "A joint has no identified spring: its torque cannot be predicted."
    # By the link's torque, which has the noise of encoders alone; the motor's is noise for weak joints.
    spring, worst = max((_compute_share(joint.link, final), joint.joint) for joint, final in springs)
    linear = 0.0
    for joint in joints:
        # What the best linear spring leaves of the joint's torque by its link.
        scale = float(joint.torsion @ joint.torsion)
        stiffness = float(joint.torsion @ joint.link) / scale if scale else 0.0
        linear = max(linear, _compute_share(joint.link, stiffness * joint.torsion))
    headline = f"On held-out motions the residual of the springs is at most {spring:.3g} % of a joint's "
    headline += f"torque ({worst}), of the dynamics {whole}."
    verb = "better" if spring <= (1.0 - POLICY.relevance) * linear else "no better"
    text = f"The residual of the best linear springs is {linear:.3g} %: springs with memory predict {verb}."
    return _rate(max(dynamics, spring)), headline, text


def compute_spring_share(joint: JointTrial) -> float | None:
    """Return the percentage of a joint's torque by its link that its spring leaves; None without a spring."""
    return None if joint.final is None else _compute_share(joint.link, joint.final)


def _compute_share(torque: FloatArray, predicted: FloatArray) -> float:
    """Return the share in percent of a torque that a prediction leaves."""
    whole = float(np.linalg.norm(torque))
    return 100.0 * float(np.linalg.norm(torque - predicted)) / whole if whole else float("inf")


def judge_trial(found: AnyValidation, estimate: AnyEstimate | None = None) -> FitVerdict:
    """Return the verdict on what a fit predicts of a log, by the same limits as on a fit.

    With the `estimate` its own residual counts too, where it is of equations of the same kind.
    """
    percent, own, band = found.mean_relative_percent, False, ""
    if isinstance(found, RigidValidation):
        band = _name_band(found.validation) if found.band is None else f" below {found.band.band:.3g} Hz"
    headline = f"The residual is {percent:.3g} % of the torque{band} (mean over joints)."
    level = _rate(percent)
    details: list[str] = []
    match found:
        case ElasticValidation():
            own = found.trial.fitted
            rated, headline, text = _judge_springs([found.trial])
            level = min(level, rated, key=LEVELS.index)
            details.append(text)
        case RigidValidation(validation=validation, band=None) if (
            isinstance(estimate, Estimate) and validation.rows == estimate.rows and not validation.fitted
        ):
            rated, headline = _judge_prediction(estimate, [validation])
            level = min(level, rated, key=LEVELS.index)
        case RigidValidation(validation=validation) | FrictionValidation(validation=validation):
            own = validation.fitted
    caps = _find_lost(found.residual, "the log")
    if own:
        caps.append(("usable", "the log is one of the fit, so this is no test"))
    caps += [] if estimate is None else _list_scale_caps(estimate)
    return _limit(level, headline, details, caps)


def judge_friction(found: FrictionIdentification, validations: Sequence[Validation] = ()) -> FitVerdict:
    """Return the verdict on friction laws: their held-out residuals, and what is not identifiable.

    `validations` are what laws and rigid part predict of logs; the worst of those held out limits the level.
    """
    held_out = [entry for entry in validations if not entry.fitted]
    texts, ratios = [], []
    for entry in found.joints:
        text, selection = f"{entry.joint}: {entry.estimate.law} friction", entry.selection
        if selection is not None:
            taken = next(trial for trial in selection.trials if trial.law == selection.chosen)
            if taken.held_rms is not None:
                text += f", {taken.held_rms:.3g} {entry.unit} RMS on held-out data"
            better = 0.0 if taken.ratio is None else 100.0 * (1.0 - math.sqrt(taken.ratio))
            if better >= 1.0:
                text += f" ({better:.2g} % less than Coulomb + viscous + offset)"
            known = taken.fitted_percent and taken.held_percent is not None
            # The held-out residual over that of the fit.
            ratios.append((taken.held_percent or 0.0) / (taken.fitted_percent or 1.0) if known else 1.0)
        texts.append(text)
    headline = f"{'; '.join(texts)}."
    percent = max((entry.mean_relative_percent for entry in held_out), default=0.0)
    if len(ratios) < len(texts) or not texts:
        level = _rate(percent) if held_out else "usable"
        headline += "" if held_out else " No held-out data have tested them."
    elif max(ratios) ** 2 <= POLICY.fall_of_all:
        level = "good"
    else:
        level = "usable"
        headline += f" The held-out residual is {max(ratios):.2g} times that of the fit."
    if held_out:
        text = f"The residual of a held-out log is {percent:.3g} % of the torque (mean over joints)"
        headline = f"{headline} {text}."
    caps: Caps = _find_lost([entry.residual for entry in found.joints], _OWN)
    worst = max(entry.residual.relative_percent for entry in found.joints)
    if worst > POLICY.good:
        where = " in the logs of the fit" if held_out else ""
        caps.append((_rate(worst), f"the residual is {worst:.3g} % of a torque{where}"))
    caps += [*_list_scale_caps(found), *_list_validation_caps(held_out)]
    below = [
        entry.joint
        for entry in found.joints
        if any(one.name == "fE" and one.value < -SIGNIFICANT * one.std for one in entry.estimate.parameters)
    ]
    if below:
        text = "friction falls towards zero speed, where a Stribeck law has it rise"
        caps.append(("usable", f"the static excess of {', '.join(below)} is negative: {text}"))
    lost = [f"{name} of {entry.joint}" for entry in found.joints for name, _ in entry.estimate.refused]
    if lost:
        caps.append(("usable", f"not identifiable from these logs: {', '.join(lost)}"))
    details = [entry.selection.verdict for entry in found.joints if entry.selection is not None]
    details += [f"{entry.poses.verdict}." for entry in found.joints if entry.poses is not None]
    details += [f"{name}: {reason}." for name, reason in found.refused]
    details += [_FITTED] if len(held_out) < len(validations) else []
    return _limit(level, headline, details, caps)
