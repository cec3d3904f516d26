"""The verdict: what an identification is worth, in sentences.

Input: an estimate and what it explains of held-out logs. Output: `Verdict`.

The judgement is relative: the model is as good on a log it has not seen as on its own, or it is
not. Whether that is good enough for a use is the reader's to say; the numbers are there.

Supported: any number of held-out logs, none included.
Not supported: tests of the residual's whiteness.
"""

from dataclasses import dataclass

from symid.identification.estimate import Estimate, ParameterEstimate, Validation

__all__ = ["Verdict", "find_verdict"]

_SAME, _WORSE = 1.2, 2.0
_SHARP, _VAGUE = 10.0, 30.0
_CONDITION = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """`level` is "good", "fair" or "poor"; `headline` one sentence, `details` the rest."""

    level: str
    headline: str
    details: tuple[str, ...]


def find_verdict(estimate: Estimate, validations: tuple[Validation, ...]) -> Verdict:
    """Return the verdict on `estimate`."""
    level, headline = _judge_prediction(estimate, validations)
    details = [_describe_fit(estimate), *_describe_precision(estimate.parameters)]
    truth = _describe_truth(estimate.parameters)
    if truth:
        details.append(truth)
    if estimate.refused:
        names = ", ".join(name for name, _ in estimate.refused)
        details.append(f"Not known from these logs, and left out: {names}.")
        level = "fair" if level == "good" else level
    if estimate.condition > _CONDITION:
        text = (
            f"The condition number of the scaled matrix is {estimate.condition:.3g}: the motion hardly tells "
            "some parameters apart; a more exciting one would."
        )
        details.append(text)
    return Verdict(level=level, headline=headline, details=tuple(details))


def _judge_prediction(estimate: Estimate, validations: tuple[Validation, ...]) -> tuple[str, str]:
    if not validations:
        text = "The parameters fit their own logs; no held-out log has tested them yet."
        return "fair", text
    ratio, worst = max((_find_ratio(estimate, validation), validation.source) for validation in validations)
    percent = max(validation.mean_relative_percent for validation in validations)
    if ratio <= _SAME:
        text = (
            "The model predicts motions it has not seen as well as those it was fitted to: "
            f"{percent:.3g} % of the torque is left unexplained."
        )
        return "good", text
    if ratio <= _WORSE:
        text = (
            "The model predicts motions it has not seen less well than those it was fitted to: "
            f"{percent:.3g} % of the torque is left unexplained, a residual {ratio:.2g} times as large "
            f"({worst})."
        )
        return "fair", text
    text = (
        f"The model does not carry over: on {worst} its residual is {ratio:.2g} times that of the fit, "
        f"{percent:.3g} % of the torque. Something acts there that the model does not know."
    )
    return "poor", text


def _find_ratio(estimate: Estimate, validation: Validation) -> float:
    """Return the largest ratio over joints of held-out to fitted residual, both by their deviation.

    Rows of another kind have other units; then relative residuals are compared.
    """
    same = estimate.rows == validation.rows
    fitted = {entry.joint: entry.std if same else entry.relative_percent for entry in estimate.residual}
    ratios = [
        (entry.std if same else entry.relative_percent) / fitted[entry.joint]
        for entry in validation.residual
        if fitted.get(entry.joint)
    ]
    if not ratios and estimate.mean_relative_percent:
        return validation.mean_relative_percent / estimate.mean_relative_percent
    return max(ratios, default=1.0)


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
    known = [(entry.truth, entry) for entry in parameters if entry.truth is not None]
    if not known:
        return ""
    inside = sum(abs(entry.value - truth) <= 3.0 * entry.std for truth, entry in known)
    return (
        f"Of {len(known)} parameters whose true value is stated, {inside} "
        f"{'lies' if inside == 1 else 'lie'} within three standard deviations."
    )
