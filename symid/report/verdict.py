"""The verdict: what an identification is worth, in sentences.

Estimate of rigid or elastic joints and what it explains of held-out logs -> `FitVerdict`; laws of friction,
which were tried on blocks held back when they were chosen, -> `FitVerdict`.

The judgement starts relative: the model is as good on a log it has not seen as on its own, or it is not; of
elastic joints, what springs and dynamics leave unexplained there, and whether springs with memory explain
more than linear ones. A large residual, a true value that was missed, many uncertain parameters, a motion
that hardly separates them, or an iteration that did not converge then hold it back. Whether that is enough
for a use is the reader's to say.

Supported: any number of held-out logs, none included; logs of the fit are not counted as held out.
Not supported: tests of the residual's whiteness; comparison between rows of different kinds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb
from statistics import NormalDist

import numpy as np

from symid.arrays import FloatArray
from symid.identification.elastic import ElasticEstimate, ElasticTrial, JointTrial
from symid.identification.estimators import Estimate, ParameterEstimate, Validation
from symid.identification.friction import FrictionIdentification, JointFriction
from symid.ipopt import Ending

_SAME, _WORSE = 1.2, 2.0
_SHARP, _VAGUE = 10.0, 30.0
_CONDITION = 1000.0
_LARGE, _HUGE = 10.0, 30.0
"""Percent of a torque left unexplained beyond which a model is not good, and poor."""
_VAGUE_SHARE = 1.0 / 3.0
_CHANCE = 0.01
"""A deviation less likely than this is no chance."""
LEVELS = ("poor", "fair", "good")
QUANTITIES = {
    "torque": "torque",
    "filtered": "filtered torque",
    "momentum": "impulse",
    "energy": "work",
    "power": "filtered power",
}
"""What is measured and predicted, by the rows of a fit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitVerdict:
    """`level` is "good", "fair" or "poor"; `headline` one sentence, `details` the rest."""

    level: str
    headline: str
    details: tuple[str, ...]


def judge_identification(estimate: Estimate, validations: tuple[Validation, ...]) -> FitVerdict:
    """Return the verdict on `estimate`."""
    held_out = tuple(validation for validation in validations if not validation.fitted)
    level, headline = _judge_prediction(estimate, held_out)
    caps = _list_caps(estimate, held_out)
    details = [_describe_fit(estimate)]
    if len(held_out) < len(validations):
        details.append("A log given for validation is one it was fitted to, and was not counted as a test.")
    details += describe_parameters(estimate.parameters, estimate.refused)
    if estimate.condition > _CONDITION:
        text = (
            f"The condition number of the scaled matrix is {estimate.condition:.3g}: the motion hardly tells "
            "some parameters apart; a more exciting one would."
        )
        details.append(text)
    return apply_caps(level, headline, details, caps)


def apply_caps(level: str, headline: str, details: list[str], caps: list[tuple[str, str]]) -> FitVerdict:
    """Return the verdict of what speaks for a level, and of `caps`: the best level each allows, and why."""
    level = min((level, *(cap for cap, _ in caps)), key=LEVELS.index)
    if caps:
        headline = f"{headline} But {'; '.join(reason for _, reason in caps)}."
    return FitVerdict(level=level, headline=headline, details=tuple(details))


def describe_parameters(
    parameters: tuple[ParameterEstimate, ...], refused: tuple[tuple[str, str], ...]
) -> list[str]:
    """Return sentences on how well parameters are known, how near the truth they are, and what is refused."""
    details = _describe_precision(parameters) if parameters else []
    truth = _describe_truth(parameters)
    if truth:
        details.append(truth)
    if refused:
        names = ", ".join(name for name, _ in refused)
        details.append(f"Not known from these logs, and left out: {names}.")
    return details


def _judge_prediction(estimate: Estimate, validations: tuple[Validation, ...]) -> tuple[str, str]:
    if not validations:
        text = "The parameters fit their own logs; no held-out log has tested them yet."
        return "fair", text
    same = [validation for validation in validations if validation.rows == estimate.rows]
    if not same:
        worst = max(validations, key=lambda validation: validation.mean_relative_percent)
        text = (
            f"On held-out logs {worst.mean_relative_percent:.3g} % of the {QUANTITIES[worst.rows]} is left "
            f"unexplained; the fit was to {estimate.rows} rows, so this says nothing about carrying over."
        )
        return "fair", text
    ratio, worst_source = max(
        (_compute_held_out_ratio(estimate, validation), validation.source) for validation in same
    )
    percent = max(validation.mean_relative_percent for validation in same)
    quantity = QUANTITIES[estimate.rows]
    if ratio <= _SAME:
        text = (
            "The model predicts motions it has not seen as well as those it was fitted to: "
            f"{percent:.3g} % of the {quantity} is left unexplained."
        )
        return "good", text
    if ratio <= _WORSE:
        text = (
            "The model predicts motions it has not seen less well than those it was fitted to: "
            f"{percent:.3g} % of the {quantity} is left unexplained, a residual {ratio:.2g} times as large "
            f"({worst_source})."
        )
        return "fair", text
    text = (
        f"The model does not carry over: on {worst_source} its residual is {ratio:.2g} times that of the "
        f"fit, {percent:.3g} % of the {quantity}. Something acts there that the model does not know."
    )
    return "poor", text


def _compute_held_out_ratio(estimate: Estimate, validation: Validation) -> float:
    """Return the largest ratio over joints of held-out to fitted deviation, of rows of the same kind."""
    fitted = {entry.joint: entry.std for entry in estimate.residual}
    ratios = [entry.std / fitted[entry.joint] for entry in validation.residual if fitted.get(entry.joint)]
    if not ratios and estimate.mean_relative_percent:
        return validation.mean_relative_percent / estimate.mean_relative_percent
    return max(ratios, default=1.0)


def _list_caps(estimate: Estimate, validations: tuple[Validation, ...]) -> list[tuple[str, str]]:
    """Return what holds the verdict back: the best level that it allows, and why."""
    caps = []
    percent = max((validation.mean_relative_percent for validation in validations), default=0.0)
    if not percent <= _LARGE:
        limit = _LARGE if percent <= _HUGE else _HUGE
        level = "fair" if percent <= _HUGE else "poor"
        caps.append((level, f"more than {limit:g} % of a held-out log is left unexplained"))
    caps += list_parameter_caps(estimate.parameters, estimate.refused)
    if not estimate.condition <= _CONDITION:
        caps.append(("fair", "the motion hardly tells some parameters apart"))
    return caps


def list_parameter_caps(
    parameters: tuple[ParameterEstimate, ...], refused: tuple[tuple[str, str], ...]
) -> list[tuple[str, str]]:
    """Return the best levels that the parameters allow, and why."""
    caps = []
    missed, known = _list_missed(parameters)
    if missed:
        level = "poor" if 2 * len(missed) > known else "fair"
        caps.append((level, f"true values were missed beyond what chance explains: {', '.join(missed)}"))
    vague = sum(not entry.relative_std_percent <= _VAGUE for entry in parameters)
    if vague > _VAGUE_SHARE * len(parameters):
        whole = len(parameters)
        caps.append(("fair", f"{vague} of {whole} parameters are uncertain by more than {_VAGUE:g} %"))
    if refused:
        caps.append(("fair", "some parameters are not known from these logs"))
    return caps


def _list_missed(parameters: tuple[ParameterEstimate, ...]) -> tuple[list[str], int]:
    """Return who lies further than 3 std from the truth, if that is no chance, and how many truths there are.

    It is no chance when one lies beyond what the farthest of so many normal values reaches in all but 1 %
    of cases, or when so many beyond 3 std are less likely than 1 %.
    """
    known = [(entry, entry.truth) for entry in parameters if entry.truth is not None]
    far = [entry for entry, _ in known if not entry.near_truth]
    if not far:
        return [], len(known)
    whole = len(known)
    bound = max(3.0, NormalDist().inv_cdf(1.0 - 0.5 * _CHANCE / whole))
    beyond = any(not abs(entry.value - truth) <= bound * entry.std for entry, truth in known)
    share = 2.0 * NormalDist().cdf(-3.0)
    fewer = sum(comb(whole, k) * share**k * (1.0 - share) ** (whole - k) for k in range(len(far)))
    return ([entry.name for entry in far] if beyond or 1.0 - fewer < _CHANCE else []), whole


def _describe_fit(estimate: Estimate) -> str:
    logs = "one log" if len(estimate.sources) == 1 else f"{len(estimate.sources)} logs"
    return (
        f"Fitted to {logs}, {estimate.samples} {estimate.rows} rows: "
        f"{estimate.mean_relative_percent:.3g} % is left unexplained there."
    )


def _describe_precision(parameters: tuple[ParameterEstimate, ...]) -> list[str]:
    sharp = sum(entry.relative_std_percent <= _SHARP for entry in parameters)
    vague = [entry.name for entry in parameters if entry.relative_std_percent > _VAGUE]
    text = f"{sharp} of {len(parameters)} parameters are known to {_SHARP:g} % or better."
    if not vague:
        return [text]
    verb = "is" if len(vague) == 1 else "are"
    return [f"{text} {', '.join(vague)} {verb} uncertain by more than {_VAGUE:g} %."]


def _describe_truth(parameters: tuple[ParameterEstimate, ...]) -> str:
    known = [entry for entry in parameters if entry.truth is not None]
    if not known:
        return ""
    far = [entry.name for entry in known if not entry.near_truth]
    inside = len(known) - len(far)
    text = (
        f"Of {len(known)} parameters whose true value is stated, {inside} "
        f"{'lies' if inside == 1 else 'lie'} within three standard deviations"
    )
    return f"{text}; not {', '.join(far)}." if far else f"{text}."


_BETTER = 0.9
"""Part of the linear springs' residual that springs with memory must stay below to be called better."""
_NEAR = 1.0
"""Percent of its true value within which a parameter counts as met."""
_CONVERGED = frozenset({Ending.SOLVED, Ending.CONVERGED})


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shares:
    """Percent left unexplained, the worst of all joints and logs; `linear` by the best linear springs."""

    dynamics: float
    spring: float | None
    linear: float


def judge_elastic(estimate: ElasticEstimate, trials: Sequence[ElasticTrial]) -> FitVerdict:
    """Return the verdict on what was found and how that did in `trials`."""
    held_out = [trial for trial in trials if not trial.fitted]
    worst = max(entry.relative_percent for entry in estimate.residual)
    text = (
        f"Found by the method {estimate.method} ({estimate.outcome.value}), which leaves at most "
        f"{worst:.3g} % of a motor's torque in its own logs unexplained."
    )
    details = [text]
    if len(held_out) < len(trials):
        details.append("A log given for validation is one it was fitted to, and was not counted as a test.")
    # Without standard deviations nothing can be said of chance.
    parameters = estimate.parameters if estimate.covariance else ()
    caps = list_parameter_caps(tuple(map(_accept_near_truth, parameters)), estimate.refused)
    if not estimate.outcome.usable:
        caps.insert(0, ("poor", f"the method did not end well: {estimate.outcome.value}"))
    elif estimate.outcome not in _CONVERGED:
        caps.insert(0, ("fair", f"the iteration did not come to rest: {estimate.outcome.value}"))
    if held_out:
        level, headline, words = _judge_held_out(_compute_shares(held_out))
        details += words
    else:
        level = "fair"
        headline = "Dynamics and springs fit their own logs; no held-out log has tested them yet."
    details += describe_parameters(parameters, estimate.refused)
    details += _describe_errors(estimate)
    return apply_caps(level, headline, details, caps)


def _accept_near_truth(entry: ParameterEstimate) -> ParameterEstimate:
    """Return the parameter as met exactly where it is met well enough, whatever chance says.

    A spring on a grid is a model, and what it lacks is no noise.
    """
    error = entry.error_percent
    return replace(entry, truth=entry.value) if error is not None and abs(error) <= _NEAR else entry


def _describe_errors(estimate: ElasticEstimate) -> list[str]:
    errors = [
        (abs(error), entry.name)
        for entry in estimate.parameters
        if (error := entry.error_percent) is not None
    ]
    if not errors:
        return []
    error, name = max(errors)
    return [f"The largest error of a parameter against its true value is {error:.2g} % ({name})."]


def _compute_shares(trials: Sequence[ElasticTrial]) -> _Shares:
    joints = [joint for trial in trials for joint in trial.joints]
    found = [_compute_share(joint, joint.final) for joint in joints if joint.final is not None]
    dynamics = max(entry.relative_percent for trial in trials for entry in trial.residuals[0][1])
    return _Shares(
        dynamics=dynamics,
        spring=None if len(found) < len(joints) else max(found),
        linear=max(_compute_share(joint, joint.straight * joint.torsion) for joint in joints),
    )


def _compute_share(joint: JointTrial, values: FloatArray) -> float:
    """Return the share in percent of a joint's torque by its motor that a spring leaves."""
    whole = float(np.linalg.norm(joint.motor))
    return 100.0 * float(np.linalg.norm(joint.motor - values)) / whole if whole else float("inf")


def _judge_held_out(shares: _Shares) -> tuple[str, str, list[str]]:
    """Return level, headline and further sentences."""
    worst = max(shares.dynamics, shares.spring or 0.0)
    level = "good" if worst <= _LARGE else "fair" if worst <= _HUGE else "poor"
    dynamics = f"{shares.dynamics:.3g} % of a motor's torque"
    if shares.spring is None:
        headline = f"On motions it has not seen, the model leaves at most {dynamics} unexplained."
        return level, headline, ["No spring was found; the torque of the joints cannot be predicted."]
    headline = (
        f"On motions it has not seen, the springs leave at most {shares.spring:.3g} % of a joint's torque "
        f"unexplained, and the dynamics {dynamics}."
    )
    text = f"The linear springs that fit those logs best would leave {shares.linear:.3g} %"
    if shares.spring <= _BETTER * shares.linear:
        return level, headline, [f"{text}: springs with memory explain more."]
    return level, headline, [f"{text}: springs with memory explain no more than that."]


def judge_friction(found: FrictionIdentification) -> FitVerdict:
    """Return what the result is worth: how well what was held back is predicted, what is not known."""
    tried = [entry for entry in found.joints if entry.selection is not None]
    names = ", ".join(f"{entry.joint}: {entry.estimate.law}" for entry in found.joints)
    level, headline = "fair", f"Laws of friction: {names}. Nothing that was held back has tested them."
    if tried and len(tried) == len(found.joints):
        ratio = max(map(_compute_law_ratio, tried))
        same = ratio <= _SAME
        level = "good" if same else "fair"
        headline = (
            f"Laws of friction: {names}. Blocks held back are predicted "
            + ("as well as" if same else f"{ratio:.2g} times worse than")
            + " those fitted."
        )
    caps: list[tuple[str, str]] = []
    worst = max(entry.residual.relative_percent for entry in found.joints)
    if worst > _LARGE:
        cap = "poor" if worst > _HUGE else "fair"
        caps.append((cap, f"{worst:.3g} % of a torque is left unexplained"))
    lost = [f"{name} of {entry.joint}" for entry in found.joints for name, _ in entry.estimate.refused]
    if lost:
        caps.append(("fair", f"these logs do not tell {', '.join(lost)}"))
    details = [entry.selection.verdict for entry in tried if entry.selection is not None]
    details += [f"{entry.poses.verdict}." for entry in found.joints if entry.poses is not None]
    details += [f"{name}: {reason}." for name, reason in found.refused]
    return apply_caps(level, headline, details, caps)


def _compute_law_ratio(entry: JointFriction) -> float:
    """Return the error held back over that fitted, of the law taken."""
    if entry.selection is None:
        return 1.0
    taken = next(trial for trial in entry.selection.trials if trial.law == entry.selection.chosen)
    if not taken.fitted_percent or taken.held_percent is None:
        return 1.0
    return taken.held_percent / taken.fitted_percent
