"""The report of an elastic identification: one HTML file that needs nothing else.

Input: `ElasticEstimate`, what it says of logs, further comparisons and motions. Output: a page with verdict,
hysteresis loops, springs, parameters, methods, convergence, tracking, residuals, settings.

Supported: printing, light and dark screens, readers that speak; no scripts, no network. Sections without data
are left out.
Not supported: more than one robot on a page.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

from symid import __version__
from symid.elastic.estimate import ElasticEstimate, MethodTrial
from symid.elastic.trial import ElasticTrial
from symid.errors import Notice
from symid.identification.storage import write_file
from symid.report.comparison import Comparison, ComparisonSection, MethodScore, build_comparison
from symid.report.convergence import ConvergenceSection, build_convergence
from symid.report.elastic_loops import TrialSection, build_trial
from symid.report.elastic_springs import SpringSection, build_spring
from symid.report.elastic_verdict import find_elastic_verdict
from symid.report.tables import ParameterLine, ResidualLine, list_settings, write_parameter, write_residual
from symid.report.templates import write_page
from symid.report.tracking import Tracking, TrackingSection, build_tracking
from symid.report.verdict import Verdict

__all__ = ["ElasticExtras", "ElasticPage", "build_elastic_report", "write_elastic_report"]

_TEMPLATE = "elastic.html.jinja"
_PREDICTION = (
    "The prediction error is the mean square of torques that were left out of the fit, less what it says of "
    "them, in units of the noise: noise alone would leave 1."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticExtras:
    """What a report shows besides the estimate.

    Args:
        trials: what it says of logs, held out or not.
        iterated: another estimate from the same logs, whose iterations are shown where the result has none.
        comparisons: of methods, for example over many runs with a known truth.
        tracking: motions with several feed-forwards.
        notices: what else a reader should know: of the robot, its library, and the recordings.
        origin: what the page was made from, in short texts.
    """

    trials: tuple[ElasticTrial, ...] = ()
    iterated: ElasticEstimate | None = None
    comparisons: tuple[Comparison, ...] = ()
    tracking: Tracking | None = None
    notices: tuple[Notice, ...] = ()
    origin: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticPage:
    """The context of the page: its fields are the template's variables."""

    robot: str
    verdict: Verdict
    trials: tuple[TrialSection, ...]
    springs: tuple[SpringSection, ...]
    has_truth: bool
    parameters: tuple[ParameterLine, ...]
    refused: tuple[tuple[str, str], ...]
    reason: str
    comparisons: tuple[ComparisonSection, ...]
    convergence: ConvergenceSection | None
    tracking: TrackingSection | None
    residuals: tuple[tuple[str, tuple[ResidualLine, ...]], ...]
    settings: tuple[tuple[str, str], ...]
    notices: tuple[str, ...]
    origin: tuple[str, ...]


def write_elastic_report(path: Path, estimate: ElasticEstimate, extras: ElasticExtras | None = None) -> Path:
    """Write the page to `path`, at once or not at all, and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_file(path, write_page(_TEMPLATE, build_elastic_report(estimate, extras)))


def build_elastic_report(estimate: ElasticEstimate, extras: ElasticExtras | None = None) -> ElasticPage:
    """Return all that the page shows."""
    extras = extras or ElasticExtras()
    refused = {name for name, _ in estimate.refused}
    kept = [entry for entry in estimate.parameters if entry.name not in refused]
    if not estimate.covariance:
        kept = [replace(entry, std=math.inf) for entry in kept]
    comparisons = map(build_comparison, (_compare_trials(estimate), *extras.comparisons))
    units = [entry.unit for entry in estimate.residual]
    torques = [(entry.joint, entry.unit) for entry in estimate.residual]
    positions = [
        (entry.joint, "m" if unit == "N" else "rad")
        for entry, unit in zip(estimate.residual, units, strict=True)
    ]
    return ElasticPage(
        robot=estimate.robot,
        verdict=find_elastic_verdict(estimate, extras.trials),
        trials=tuple(map(build_trial, extras.trials)),
        springs=tuple(build_spring(entry) for entry in estimate.springs if entry.told),
        has_truth=any(entry.truth is not None for entry in kept),
        parameters=tuple(map(write_parameter, kept)),
        refused=estimate.refused,
        reason=f"{estimate.reason[:1].upper()}{estimate.reason[1:]}.",
        comparisons=tuple(entry for entry in comparisons if entry is not None),
        convergence=_show_iterations(estimate, extras.iterated, torques),
        tracking=build_tracking(extras.tracking, positions),
        residuals=(
            (
                "Torque of the motors by their own dynamics and the springs, in the logs of the fit.",
                tuple(map(write_residual, estimate.residual)),
            ),
            ("Energy over windows, in the logs of the fit.", (write_residual(estimate.energy),)),
        ),
        settings=_list_settings(estimate),
        notices=tuple(dict.fromkeys(map(str, (*estimate.notices, *extras.notices)))),
        origin=(f"Written by symid {__version__}", *extras.origin),
    )


def _show_iterations(
    estimate: ElasticEstimate, other: ElasticEstimate | None, joints: list[tuple[str, str]]
) -> ConvergenceSection | None:
    """Return the iterations of the result or, where it has none, those of another method."""
    shown = other if other is not None and len(estimate.history) < 2 else estimate
    return build_convergence(shown.history, joints, f"{shown.method}, {shown.outcome.value}")


def _compare_trials(estimate: ElasticEstimate) -> Comparison:
    """Return the methods that were tried, by their error of prediction and their distance from the truth."""
    truth = [entry.truth for entry in estimate.parameters]
    scores = []
    for trial in estimate.trials:
        distance = _find_distance(trial, truth)
        scores.append(
            MethodScore(
                method=trial.method,
                middles=(trial.error, distance),
                outcome=trial.outcome.value,
                chosen=trial.method == estimate.method,
            )
        )
    measures: tuple[tuple[str, str], ...] = (
        ("prediction error", "noise = 1"),
        ("largest error of a parameter", "%"),
    )
    if all(score.middles[1] is None for score in scores):
        measures = measures[:1]
        scores = [replace(score, middles=score.middles[:1]) for score in scores]
    return Comparison(measures=measures, scores=tuple(scores), words=(_PREDICTION,))


def _find_distance(trial: MethodTrial, truth: list[float | None]) -> float | None:
    """Return the largest relative error in percent over the parameters whose truth is not zero."""
    pairs = [(value, true) for value, true in zip(trial.values, truth, strict=True) if true]
    return max((100.0 * abs(value - true) / abs(true) for value, true in pairs), default=None)


def _list_settings(estimate: ElasticEstimate) -> tuple[tuple[str, str], ...]:
    head = (
        ("method of the result", estimate.method),
        ("outcome", estimate.outcome.value),
        ("logs", ", ".join(estimate.sources)),
        ("rows fitted", str(sum(entry.samples for entry in estimate.residual))),
        ("condition of the scaled matrix", f"{estimate.condition:.4g}"),
        ("signature of the model", estimate.signature),
    )
    return head + tuple(list_settings(estimate.settings))
