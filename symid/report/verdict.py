"""The verdict: what an identification is worth, in sentences.

Estimate of rigid or elastic joints and what it predicts of held-out logs, or friction laws with their
held-out blocks -> `FitVerdict`.

The level starts from the prediction: is the model as good on held-out logs as on its own; of elastic joints,
what springs and dynamics leave unexplained there. A large residual, a missed true value, many uncertain
parameters, a large condition number, or an iteration that did not converge then limit it.

Not supported: tests of the residual's whiteness; comparison between rows of different kinds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from symid.arrays import FloatArray
from symid.identification.elastic import ElasticEstimate, ElasticTrial, JointTrial
from symid.identification.estimators import Estimate, ParameterEstimate, Validation
from symid.identification.friction import FrictionIdentification, JointFriction
from symid.ipopt import Ending

_SAME, _WORSE = 1.2, 2.0
_SHARP, _UNCERTAIN = 10.0, 30.0
_CONDITION = 1000.0
_LARGE, _HUGE = 10.0, 30.0
"""Percent of a torque left unexplained beyond which a model is not good, and poor."""
_UNCERTAIN_SHARE = 1.0 / 3.0
_CHANCE = 0.01
"""A deviation less likely than this is no chance."""
_BETTER = 0.9
"""Part of the linear springs' residual that springs with memory must stay below to be called better."""
_NEAR = 1.0
"""Percent of its true value within which a parameter of elastic joints counts as met."""
_LEVELS = ("poor", "fair", "good")
QUANTITIES = {
    "torque": "torque",
    "filtered": "filtered torque",
    "momentum": "impulse",
    "energy": "work",
    "power": "filtered power",
}
"""What is measured and predicted, by the rows of a fit."""
_FITTED = "A log given for validation is one of the fit; it does not count as a test."

Caps = list[tuple[str, str]]
"""What limits a verdict: the best level that it allows, and why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitVerdict:
    """`level` is "good", "fair" or "poor"; `headline` one sentence, `details` the rest."""

    level: str
    headline: str
    details: tuple[str, ...]


def _limit(level: str, headline: str, details: Sequence[str], caps: Caps) -> FitVerdict:
    """Return the verdict of a level and of what limits it."""
    if caps:
        level = min((level, *(cap for cap, _ in caps)), key=_LEVELS.index)
        headline = f"{headline} But {'; '.join(reason for _, reason in caps)}."
    return FitVerdict(level=level, headline=headline, details=tuple(details))


def _rate(percent: float) -> str:
    """Return the level of what is left unexplained."""
    return "good" if percent <= _LARGE else "fair" if percent <= _HUGE else "poor"


def judge_identification(estimate: Estimate, validations: Sequence[Validation]) -> FitVerdict:
    """Return the verdict on `estimate`."""
    held_out = [validation for validation in validations if not validation.fitted]
    level, headline = _judge_prediction(estimate, held_out)
    logs = "one log" if len(estimate.sources) == 1 else f"{len(estimate.sources)} logs"
    details = [
        (
            f"Fitted to {logs}, {estimate.samples} {estimate.rows} rows: "
            f"{estimate.mean_relative_percent:.3g} % is left unexplained there."
        )
    ]
    if len(held_out) < len(validations):
        details.append(_FITTED)
    caps: Caps = []
    percent = max((validation.mean_relative_percent for validation in held_out), default=0.0)
    if not percent <= _LARGE:
        cap, limit = ("fair", _LARGE) if percent <= _HUGE else ("poor", _HUGE)
        caps.append((cap, f"more than {limit:g} % of a held-out log is left unexplained"))
    words, more = _judge_parameters(estimate.parameters, estimate.refused)
    details += words
    caps += more
    if not estimate.condition <= _CONDITION:
        caps.append(("fair", f"the condition number is {estimate.condition:.3g}"))
        details.append(
            f"The condition number of the column-scaled regressor is {estimate.condition:.3g}: some "
            "parameters are hardly separated. Use a more exciting motion."
        )
    return _limit(level, headline, details, caps)


def _judge_prediction(estimate: Estimate, validations: Sequence[Validation]) -> tuple[str, str]:
    if not validations:
        return "fair", "The parameters fit their own logs; no held-out log has tested them yet."
    same = [validation for validation in validations if validation.rows == estimate.rows]
    if not same:
        worst = max(validations, key=lambda validation: validation.mean_relative_percent)
        return "fair", (
            f"On held-out logs {worst.mean_relative_percent:.3g} % of the {QUANTITIES[worst.rows]} is left "
            f"unexplained; the fit was to {estimate.rows} rows, so the two residuals cannot be compared."
        )
    ratio, source = max((_compute_held_out_ratio(estimate, entry), entry.source) for entry in same)
    percent = max(validation.mean_relative_percent for validation in same)
    left = f"{percent:.3g} % of the {QUANTITIES[estimate.rows]} is left unexplained"
    if ratio <= _SAME:
        return "good", f"The model predicts held-out motions as well as those of the fit: {left}."
    if ratio <= _WORSE:
        return "fair", (
            f"The model predicts held-out motions less well than those of the fit: {left}, a residual "
            f"{ratio:.2g} times as large ({source})."
        )
    return "poor", (
        f"The model does not predict held-out motions: on {source} the residual is {ratio:.2g} times that of "
        f"the fit, {left}. A term is missing in the model."
    )


def _compute_held_out_ratio(estimate: Estimate, validation: Validation) -> float:
    """Return the largest ratio over joints of held-out to fitted deviation, of rows of the same kind."""
    fitted = {entry.joint: entry.std for entry in estimate.residual}
    ratios = [entry.std / fitted[entry.joint] for entry in validation.residual if fitted.get(entry.joint)]
    if not ratios and estimate.mean_relative_percent:
        return validation.mean_relative_percent / estimate.mean_relative_percent
    return max(ratios, default=1.0)


def _judge_parameters(
    parameters: Sequence[ParameterEstimate], refused: Sequence[tuple[str, str]], tolerance: float = 0.0
) -> tuple[list[str], Caps]:
    """Return how well parameters are known and how near the truth they are, and what that limits.

    Within `tolerance` percent a true value counts as met, whatever its standard deviation.
    """
    details, caps = [], []
    uncertain = [entry.name for entry in parameters if not entry.relative_std_percent <= _UNCERTAIN]
    if parameters:
        sharp = sum(entry.relative_std_percent <= _SHARP for entry in parameters)
        details.append(
            f"{sharp} of {len(parameters)} parameters have a standard deviation of at most {_SHARP:g} %."
        )
        if uncertain:
            details.append(f"Uncertain by more than {_UNCERTAIN:g} %: {', '.join(uncertain)}.")
    known = [entry for entry in parameters if entry.truth is not None]
    if known:
        far = [entry.name for entry in known if not entry.near_truth]
        text = f"{len(known) - len(far)} of {len(known)} true values lie within three standard deviations"
        details.append(f"{text}; not {', '.join(far)}." if far else f"{text}.")
    missed = _list_missed(known, tolerance)
    if missed:
        level = "poor" if 2 * len(missed) > len(known) else "fair"
        caps.append((level, f"true values are missed beyond chance: {', '.join(missed)}"))
    if len(uncertain) > _UNCERTAIN_SHARE * len(parameters):
        text = f"{len(uncertain)} of {len(parameters)} parameters are uncertain by more than {_UNCERTAIN:g} %"
        caps.append(("fair", text))
    if refused:
        names = ", ".join(name for name, _ in refused)
        details.append(f"Not identifiable from these logs: {names}.")
        caps.append(("fair", "some parameters are not identifiable from these logs"))
    return details, caps


def _list_missed(known: Sequence[ParameterEstimate], tolerance: float) -> list[str]:
    """Return who lies beyond 3 std of the truth, if one so far or so many are less likely than 1 %."""

    def is_close(entry: ParameterEstimate) -> bool:
        # A spring on a grid is a model, and what it lacks is no noise: hence the tolerance.
        error = entry.error_percent
        return error is not None and abs(error) <= tolerance

    off = [(entry, entry.truth) for entry in known if entry.truth is not None and not is_close(entry)]
    far = [entry.name for entry, _ in off if not entry.near_truth]
    if not far:
        return []
    whole = len(known)
    bound = max(3.0, NormalDist().inv_cdf(1.0 - 0.5 * _CHANCE / whole))
    beyond = any(not abs(entry.value - truth) <= bound * entry.std for entry, truth in off)
    share = 2.0 * NormalDist().cdf(-3.0)
    fewer = sum(math.comb(whole, k) * share**k * (1.0 - share) ** (whole - k) for k in range(len(far)))
    return far if beyond or 1.0 - fewer < _CHANCE else []


def judge_elastic(estimate: ElasticEstimate, trials: Sequence[ElasticTrial]) -> FitVerdict:
    """Return the verdict on dynamics and springs, and on what they predict of logs."""
    held_out = [trial for trial in trials if not trial.fitted]
    worst = max(entry.relative_percent for entry in estimate.residual)
    text = (
        f"Method {estimate.method} ({estimate.outcome.value}): at most {worst:.3g} % of a motor's torque is "
        "left unexplained in the logs of the fit."
    )
    details = [text]
    if len(held_out) < len(trials):
        details.append(_FITTED)
    caps: Caps = []
    if not estimate.outcome.usable:
        caps.append(("poor", f"the method failed: {estimate.outcome.value}"))
    elif estimate.outcome not in (Ending.SOLVED, Ending.CONVERGED):
        caps.append(("fair", f"the iteration did not converge: {estimate.outcome.value}"))
    level, headline = "fair", "Dynamics and springs fit their own logs; no held-out log has tested them yet."
    if held_out:
        level, headline, text = _judge_springs(held_out)
        details.append(text)
    # Without standard deviations nothing can be said of chance.
    parameters = estimate.parameters if estimate.covariance else ()
    words, more = _judge_parameters(parameters, estimate.refused, _NEAR)
    details += words
    errors = [(abs(entry.error_percent or 0.0), entry.name) for entry in estimate.parameters if entry.truth]
    if errors:
        error, name = max(errors)
        details.append(f"The largest error against a true value is {error:.2g} % ({name}).")
    return _limit(level, headline, details, caps + more)


def _judge_springs(trials: Sequence[ElasticTrial]) -> tuple[str, str, str]:
    """Return level, headline and a comparison with linear springs, by the worst of all joints and logs."""
    joints = [joint for trial in trials for joint in trial.joints]
    dynamics = max(entry.relative_percent for trial in trials for entry in trial.residuals[0][1])
    whole = f"{dynamics:.3g} % of a motor's torque"
    shares = [_compute_share(joint, joint.final) for joint in joints if joint.final is not None]
    if len(shares) < len(joints):
        headline = f"On held-out motions the model leaves at most {whole} unexplained."
        return _rate(dynamics), headline, "A joint has no identified spring: its torque cannot be predicted."
    spring = max(shares)
    linear = max(_compute_share(joint, joint.straight * joint.torsion) for joint in joints)
    headline = (
        f"On held-out motions the springs leave at most {spring:.3g} % of a joint's torque unexplained, the "
        f"dynamics {whole}."
    )
    verb = "more" if spring <= _BETTER * linear else "no more"
    text = f"The best linear springs leave {linear:.3g} %: springs with memory explain {verb}."
    return _rate(max(dynamics, spring)), headline, text


def _compute_share(joint: JointTrial, values: FloatArray) -> float:
    """Return the share in percent of a joint's torque by its motor that a spring leaves."""
    whole = float(np.linalg.norm(joint.motor))
    return 100.0 * float(np.linalg.norm(joint.motor - values)) / whole if whole else float("inf")


def judge_friction(found: FrictionIdentification) -> FitVerdict:
    """Return the verdict on friction laws: their held-out residuals, and what is not identifiable."""
    laws = [_judge_law(entry) for entry in found.joints]
    headline = f"{'; '.join(text for text, _ in laws)}."
    ratios = [ratio for _, ratio in laws if ratio is not None]
    if len(ratios) < len(laws) or not laws:
        level, headline = "fair", f"{headline} No held-out data have tested them."
    elif max(ratios) <= _SAME:
        level = "good"
    else:
        level = "fair"
        headline += f" The held-out residual is {max(ratios):.2g} times that of the fit."
    caps: Caps = []
    worst = max(entry.residual.relative_percent for entry in found.joints)
    if worst > _LARGE:
        caps.append((_rate(worst), f"{worst:.3g} % of a torque is left unexplained"))
    lost = [f"{name} of {entry.joint}" for entry in found.joints for name, _ in entry.estimate.refused]
    if lost:
        caps.append(("fair", f"not identifiable from these logs: {', '.join(lost)}"))
    details = [entry.selection.verdict for entry in found.joints if entry.selection is not None]
    details += [f"{entry.poses.verdict}." for entry in found.joints if entry.poses is not None]
    details += [f"{name}: {reason}." for name, reason in found.refused]
    return _limit(level, headline, details, caps)


def _judge_law(entry: JointFriction) -> tuple[str, float | None]:
    """Return the law of a joint with its held-out residual, and that over the residual of the fit.

    The ratio is None where laws were not compared on held-out blocks.
    """
    text = f"{entry.joint}: {entry.estimate.law} friction"
    if entry.selection is None:
        return text, None
    taken = next(trial for trial in entry.selection.trials if trial.law == entry.selection.chosen)
    if taken.held_rms is not None:
        text += f", {taken.held_rms:.3g} {entry.unit} RMS on held-out data"
    better = 0.0 if taken.ratio is None else 100.0 * (1.0 - math.sqrt(taken.ratio))
    if better >= 1.0:
        text += f" ({better:.2g} % less than Coulomb + viscous + offset)"
    if not taken.fitted_percent or taken.held_percent is None:
        return text, 1.0
    return text, taken.held_percent / taken.fitted_percent
