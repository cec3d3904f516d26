"""What a fit is worth, and figures of it, for a notebook: the verdict of its page, without held-out logs.

Input: an estimate, rigid or elastic, or friction of joints. Output: `Verdict`, drawings.
"""

import math

from symid.elastic.estimate import ElasticEstimate
from symid.estimators.estimate import Estimate
from symid.friction.results import FrictionIdentification
from symid.report.bars import Interval, build_interval_figure
from symid.report.blocks import Drawing
from symid.report.elastic_springs import build_spring
from symid.report.elastic_verdict import find_elastic_verdict
from symid.report.friction import find_friction_verdict
from symid.report.friction_cloud import build_friction_figure
from symid.report.tables import write_digits
from symid.report.verdict import Verdict, find_verdict

__all__ = ["draw_fit", "judge_fit"]

_MOST = 12
"""Parameters in the figure of the least certain ones."""


def judge_fit(estimate: Estimate | ElasticEstimate | FrictionIdentification) -> Verdict:
    """Return what a fit is worth, judged by its own logs alone."""
    match estimate:
        case Estimate():
            return find_verdict(estimate, ())
        case ElasticEstimate():
            return find_elastic_verdict(estimate, ())
        case FrictionIdentification():
            return find_friction_verdict(estimate)


def draw_fit(estimate: Estimate | ElasticEstimate | FrictionIdentification) -> tuple[Drawing, ...]:
    """Return the least certain parameters; of elastic joints the springs, of friction its curves."""
    match estimate:
        case Estimate():
            return _draw_deviations(estimate)
        case ElasticEstimate():
            springs = (build_spring(entry) for entry in estimate.springs if entry.told)
            return tuple(Drawing(entry.branches, f"{entry.joint}: torque over torsion") for entry in springs)
        case FrictionIdentification():
            return tuple(
                Drawing(build_friction_figure(entry), f"{entry.joint}: {entry.estimate.law}")
                for entry in estimate.joints
            )


def _draw_deviations(estimate: Estimate) -> tuple[Drawing, ...]:
    known = [entry for entry in estimate.parameters if 0.0 < entry.relative_std_percent < math.inf]
    least = sorted(known, key=lambda entry: -entry.relative_std_percent)[:_MOST]
    if not least:
        return ()
    intervals = [
        Interval(
            label=entry.name,
            middle=entry.relative_std_percent,
            text=f"{write_digits(entry.relative_std_percent)} %",
        )
        for entry in least
    ]
    title = f"{estimate.robot}: least certain parameters"
    words = "Standard deviations of the parameters that are known worst, in percent of their values."
    figure = build_interval_figure(title, words, "relative standard deviation (%)", intervals)
    return (Drawing(figure, title),)
