"""The verdict on an elastic identification, in sentences.

Input: an estimate, what it says of logs. Output: `Verdict`.

The judgement rests on held-out logs: what the springs and the dynamics leave unexplained there, and whether
the springs with memory explain more than linear ones. Parameters that were missed, are vague or unknown, and
an iteration that did not rest, hold it back.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.estimate import ElasticEstimate
from symid.elastic.fit import ElasticOutcome
from symid.elastic.trial import ElasticTrial, JointTrial
from symid.estimators.estimate import ParameterEstimate
from symid.report.verdict import Verdict, describe_parameters, find_parameter_caps, weigh

__all__ = ["find_elastic_verdict"]

_LARGE, _HUGE = 10.0, 30.0
"""Percent of a held-out joint torque left unexplained beyond which a model is not good, and poor."""
_BETTER = 0.9
"""Part of the linear springs' residual that springs with memory must stay below to be called better."""
_NEAR = 1.0
"""Percent of its true value within which a parameter counts as met."""
_RESTED = frozenset({ElasticOutcome.SOLVED, ElasticOutcome.CONVERGED})


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shares:
    """Percent left unexplained, the worst of all joints and logs; `linear` by the best linear springs."""

    dynamics: float
    spring: float | None
    linear: float


def find_elastic_verdict(estimate: ElasticEstimate, trials: Sequence[ElasticTrial]) -> Verdict:
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
    caps = find_parameter_caps(tuple(map(_overlook, parameters)), estimate.refused)
    if not estimate.outcome.usable:
        caps.insert(0, ("poor", f"the method did not end well: {estimate.outcome.value}"))
    elif estimate.outcome not in _RESTED:
        caps.insert(0, ("fair", f"the iteration did not come to rest: {estimate.outcome.value}"))
    if held_out:
        level, headline, words = _judge(_find_shares(held_out))
        details += words
    else:
        level = "fair"
        headline = "Dynamics and springs fit their own logs; no held-out log has tested them yet."
    details += describe_parameters(parameters, estimate.refused)
    details += _describe_errors(estimate)
    return weigh(level, headline, details, caps)


def _find_error(entry: ParameterEstimate) -> float | None:
    """Return the error in percent of a true value that is not zero."""
    return 100.0 * abs(entry.value - entry.truth) / abs(entry.truth) if entry.truth else None


def _overlook(entry: ParameterEstimate) -> ParameterEstimate:
    """Return the parameter as met exactly where it is met well enough, whatever chance says.

    A spring on a grid is a model, and what it lacks is no noise.
    """
    error = _find_error(entry)
    return replace(entry, truth=entry.value) if error is not None and error <= _NEAR else entry


def _describe_errors(estimate: ElasticEstimate) -> list[str]:
    errors = [
        (error, entry.name) for entry in estimate.parameters if (error := _find_error(entry)) is not None
    ]
    if not errors:
        return []
    error, name = max(errors)
    return [f"The largest error of a parameter against its true value is {error:.2g} % ({name})."]


def _find_shares(trials: Sequence[ElasticTrial]) -> _Shares:
    joints = [joint for trial in trials for joint in trial.joints]
    found = [_find_share(joint, joint.final) for joint in joints if joint.final is not None]
    dynamics = max(entry.relative_percent for trial in trials for entry in trial.residuals[0][1])
    return _Shares(
        dynamics=dynamics,
        spring=None if len(found) < len(joints) else max(found),
        linear=max(_find_share(joint, joint.straight * joint.torsion) for joint in joints),
    )


def _find_share(joint: JointTrial, values: FloatArray) -> float:
    """Return the share in percent of a joint's torque by its motor that a spring leaves."""
    whole = float(np.linalg.norm(joint.motor))
    return 100.0 * float(np.linalg.norm(joint.motor - values)) / whole if whole else float("inf")


def _judge(shares: _Shares) -> tuple[str, str, list[str]]:
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
