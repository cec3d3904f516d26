"""What is asked of the tables of friction, and whether it was met.

Input: the parts of a study. Output: `FrictionCheck`, one a claim, with the measured number.

Supported: bars that hold whatever the seeds; those on spreads are judged from 100 draws on, since fewer tell
a deviation no better than to 7 percent.
Not supported: bars for the gain over the original Stribeck law, which is a prediction: its misses are named.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from symid.friction.options import VariableProjectionOptions
from symid.study.friction_agreement import AGREEMENT, NEARNESS, AgreementStudy, Contest
from symid.study.friction_gains import GainStudy, MeanGain
from symid.study.friction_recovery import UNTOLD, Recovery

__all__ = ["FrictionCheck", "find_checks", "find_gain_sentence"]

_ENOUGH = 100
_RATIO, _BIAS = 0.2, 0.2
_POINTS = 1.0
_DEFAULT = "varpro"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionCheck:
    """A claim.

    Args:
        name: what is asked; bar: how much of it; found: what came out.
        met: whether it was met; None where there are too few draws to judge, or nothing to meet.
    """

    name: str
    bar: str
    found: str
    met: bool | None


def find_checks(
    agreement: Sequence[AgreementStudy],
    recovery: Sequence[Recovery],
    gains: Sequence[GainStudy],
    second: Sequence[Recovery],
    contests: Sequence[Contest],
) -> tuple[FrictionCheck, ...]:
    """Return all claims, in the order of the tables."""
    return (
        *(check for entry in agreement for check in _check_agreement(entry)),
        *_check_recovery(recovery),
        *(_check_gain(entry) for entry in gains),
        *(_tell_prediction(entry) for entry in gains),
        *(_check_second(entry) for entry in second),
        *(_check_default(entry) for entry in contests),
    )


def _check_agreement(study: AgreementStudy) -> list[FrictionCheck]:
    where = f"S1, peak {study.sweep.peak:g} rad/s"
    exact = [row for row in study.rows if not row.by_chance]
    excess = max(row.excess for row in exact)
    checks = [
        FrictionCheck(
            name=f"{where}: {', '.join(row.estimator for row in exact)} agree on the sum of squares",
            bar=f"{AGREEMENT:g} relative",
            found=f"{excess:.1e} in {study.draws} draws",
            met=excess <= AGREEMENT,
        )
    ]
    checks += [
        FrictionCheck(
            name=f"{where}: {row.estimator} reaches the sum of squares",
            bar=f"within {100.0 * NEARNESS:g} % in every draw",
            found=f"{row.agreed} of {row.draws} draws, worst {100.0 * row.excess:.2g} %",
            met=row.agreed == row.draws,
        )
        for row in study.rows
        if row.by_chance
    ]
    worst = max(row.error for row in exact)
    checks.append(
        FrictionCheck(
            name=f"{where}: estimates of the deterministic estimators",
            bar="within 3 Cramer-Rao deviations",
            found=f"the farthest of {len(study.truth) * study.draws} is {worst:.2f} away",
            met=worst <= 3.0,
        )
    )
    return checks


def _check_recovery(recovery: Sequence[Recovery]) -> list[FrictionCheck]:
    checks = []
    for entry in recovery:
        enough = entry.draws >= _ENOUGH
        ratio = max(entry.parameters, key=lambda parameter: abs(parameter.ratio - 1.0))
        bias = max(entry.parameters, key=lambda parameter: abs(parameter.bias))
        checks += [
            FrictionCheck(
                name=f"S2, joint {entry.joint}: standard deviations",
                bar=f"within {100.0 * _RATIO:g} % of the Cramer-Rao bound",
                found=f"{100.0 * (ratio.ratio - 1.0):+.1f} % at most, {ratio.name}, {entry.draws} draws",
                met=abs(ratio.ratio - 1.0) <= _RATIO if enough else None,
            ),
            FrictionCheck(
                name=f"S2, joint {entry.joint}: bias",
                bar=f"below {_BIAS:g} standard deviations",
                found=f"{bias.bias:+.3f} at most, {bias.name}, {entry.draws} draws",
                met=abs(bias.bias) < _BIAS if enough else None,
            ),
        ]
    return checks


def _check_gain(study: GainStudy) -> FrictionCheck:
    gain = study.viscous
    return FrictionCheck(
        name=f"S3, joint {study.joint}: improved against Coulomb + viscous (the noise was set for this)",
        bar=f"within {_POINTS:g} point of {gain.paper:g} %",
        found=f"{gain.mean:.1f} %, mean of {study.draws} draws",
        met=abs(gain.miss) <= _POINTS if study.draws >= _ENOUGH else None,
    )


def _tell_prediction(study: GainStudy) -> FrictionCheck:
    gain = study.stribeck
    return FrictionCheck(
        name=f"S3, joint {study.joint}: improved against original Stribeck (a prediction)",
        bar=f"{gain.paper:g} % in the paper",
        found=f"{gain.mean:.1f} %: {find_gain_sentence(gain)}",
        met=None,
    )


def find_gain_sentence(gain: MeanGain) -> str:
    """Return by how much a gain misses the paper's, in words."""
    side = "above" if gain.miss > 0.0 else "below"
    size = abs(gain.miss)
    return f"{size:.1f} points {side} the paper" + (
        "" if size > gain.deviation else ", within the deviation of a draw"
    )


def _check_second(study: Recovery) -> FrictionCheck:
    told = [parameter for parameter in study.parameters if parameter.told]
    lost = [parameter.name for parameter in study.parameters if not parameter.told]
    inside = min((parameter.inside for parameter in told), default=0)
    mean = max((abs(entry.mean - entry.truth) / entry.bound for entry in told), default=0.0)
    found = f"means {mean:.2f} bounds off at most; {inside} of {study.draws} draws within 3"
    if lost:
        found += f"; not identifiable, bound beyond {100.0 * UNTOLD:g} %: {', '.join(lost)}"
    return FrictionCheck(
        name=f"{study.joint}: parameters within 3 Cramer-Rao deviations of the published ones",
        # Three deviations hold 99.7 percent of normal estimates.
        bar="mean of the draws; 97 % of them",
        found=found,
        met=mean <= 3.0 and inside >= 0.97 * study.draws if study.draws >= _ENOUGH else None,
    )


def _check_default(contest: Contest) -> FrictionCheck:
    run = next(entry for entry in contest.runs if entry.estimator == _DEFAULT)
    limit = VariableProjectionOptions().solves
    return FrictionCheck(
        name=f"{contest.title}: {_DEFAULT} has the least objective of all estimators",
        bar=f"{AGREEMENT:g} relative, {limit} linear problems at most",
        found=f"{run.excess:.1e} above the least, {run.solves} linear problems",
        met=run.excess <= AGREEMENT and run.solves <= limit,
    )
