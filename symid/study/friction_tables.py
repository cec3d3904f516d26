"""The tables of Zhang, Hu and Zou (2021) on synthetic data, and which claims about our estimators are met.

Seeds -> `FrictionStudy`, with one `FrictionCheck` a claim.

    S1: one direction, all estimators (Table 1)    S2: draws of the improved law (Table 3)
    S3: gains of the improved law (Table 4)        a second robot with published friction
    contests: all estimators on one data set, with what each of them cost

Every seed draws its own noise, so that the results are the same for any number of processes; the time that
estimators take is the only number that differs from run to run, and is measured only where it is asked for.

Supported: at least two seeds; bars that hold whatever the seeds; those on spreads are judged from 100 draws
on, since fewer give a deviation no better than to 7 percent.
Not supported: the paper's own recordings, which are not public; bars for the gain over the original Stribeck
law, which is a prediction: its misses are named.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from symid.errors import Notice, UsageError
from symid.identification.friction import VariableProjectionOptions
from symid.study.friction_paper import RV_2SQ, SWEEPS, TABLE_3
from symid.study.friction_protocols import (
    AGREEMENT,
    NEARNESS,
    NOT_IDENTIFIABLE,
    AgreementStudy,
    EstimatorComparison,
    GainStudy,
    MeanGain,
    Recovery,
    build_gain_scene,
    build_recovery_scene,
    build_second_scene,
    build_sweep_scene,
    compare_estimators,
    fit_all_estimators,
    fit_draw,
    fit_laws,
    summarise_agreement,
    summarise_gains,
    summarise_recovery,
)
from symid.study.monte_carlo import run_tasks

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


def list_checks(
    agreement: Sequence[AgreementStudy],
    recovery: Sequence[Recovery],
    gains: Sequence[GainStudy],
    second: Sequence[Recovery],
    contests: Sequence[EstimatorComparison],
) -> tuple[FrictionCheck, ...]:
    """Return all claims, in the order of the tables."""
    return (
        *(check for entry in agreement for check in _check_agreement(entry)),
        *_check_recovery(recovery),
        *(_check_gain(entry) for entry in gains),
        *(_report_prediction(entry) for entry in gains),
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


def _report_prediction(study: GainStudy) -> FrictionCheck:
    gain = study.stribeck
    return FrictionCheck(
        name=f"S3, joint {study.joint}: improved against original Stribeck (a prediction)",
        bar=f"{gain.paper:g} % in the paper",
        found=f"{gain.mean:.1f} %: {describe_gain_miss(gain)}",
        met=None,
    )


def describe_gain_miss(gain: MeanGain) -> str:
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
        found += f"; not identifiable, bound beyond {100.0 * NOT_IDENTIFIABLE:g} %: {', '.join(lost)}"
    return FrictionCheck(
        name=f"{study.joint}: parameters within 3 Cramer-Rao deviations of the published ones",
        # Three deviations hold 99.7 percent of normal estimates.
        bar="mean of the draws; 97 % of them",
        found=found,
        met=mean <= 3.0 and inside >= 0.97 * study.draws if study.draws >= _ENOUGH else None,
    )


def _check_default(contest: EstimatorComparison) -> FrictionCheck:
    run = next(entry for entry in contest.runs if entry.estimator == _DEFAULT)
    limit = VariableProjectionOptions().solves
    return FrictionCheck(
        name=f"{contest.title}: {_DEFAULT} has the least objective of all estimators",
        bar=f"{AGREEMENT:g} relative, {limit} linear problems at most",
        found=f"{run.excess:.1e} above the least, {run.solves} linear problems",
        met=run.excess <= AGREEMENT and run.solves <= limit,
    )


A = TypeVar("A")
B = TypeVar("B")

_AGREEMENT_DRAWS, _GAIN_DRAWS, _SECOND_DRAWS = 20, 100, 100
"""Protocol S2 draws all seeds, the others fewer of them."""
_BATCH = 25


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionStudy:
    """What came out.

    Args:
        seeds: first and last one.
        agreement: S1, one a motion; recovery: S2, one a joint; gains: S3, one a joint.
        second: joints of the RV-2SQ; contests: all estimators on one data set each.
        checks: what was asked, and whether it was met.
    """

    seeds: tuple[int, int]
    agreement: tuple[AgreementStudy, ...]
    recovery: tuple[Recovery, ...]
    gains: tuple[GainStudy, ...]
    second: tuple[Recovery, ...]
    contests: tuple[EstimatorComparison, ...]
    checks: tuple[FrictionCheck, ...]


def study_friction(
    seeds: Sequence[int],
    *,
    jobs: int | None = None,
    timed: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> FrictionStudy:
    """Return all tables.

    Args:
        seeds: of the noise, at least two; S2 draws all of them, S1 the first 20, the others the first 100.
        jobs: processes; None for one a core.
        timed: whether the time that each estimator takes is measured.
        progress: told how many tasks are done, of how many.

    Raises:
        UsageError: fewer than two seeds, or jobs is not positive.
    """
    if len(seeds) < 2:
        text = f"{len(seeds)} draw: a standard deviation over draws needs two or more"
        raise UsageError(Notice(code="usage.friction-draws", text=text))
    # Before the processes start: they would share the cores with what is timed.
    contests = tuple(
        compare_estimators(title, scene, seeds[0], timed=timed)
        for title, scene in (
            ("Table 1, joint 1, one direction", build_sweep_scene(SWEEPS[0])),
            ("Table 3, joint 1, two cosines", build_recovery_scene(0)),
        )
    )
    wanted = [build_recovery_scene(index) for index in range(len(TABLE_3))]
    second = [build_second_scene(index) for index in range(len(RV_2SQ))]
    gains = [build_gain_scene(index) for index in range(len(TABLE_3))]
    of_draws = [[(scene, seed) for seed in seeds] for scene in wanted]
    of_draws += [[(scene, seed) for seed in seeds[:_SECOND_DRAWS]] for scene in second]
    of_gains = [[(scene, seed) for seed in seeds[:_GAIN_DRAWS]] for scene in gains]
    of_sweeps = [[(sweep, seed) for seed in seeds[:_AGREEMENT_DRAWS]] for sweep in SWEEPS]
    stages = [sum(map(len, tasks)) for tasks in (of_draws, of_gains, of_sweeps)]
    whole = sum(stages)

    def run(
        function: Callable[[A], B], groups: Sequence[Sequence[A]], stage: int, batch: int = _BATCH
    ) -> list[list[B]]:
        before = sum(stages[:stage])
        tell = None if progress is None else lambda done, _: progress(before + done, whole)
        every = [task for tasks in groups for task in tasks]
        results = iter(run_tasks(function, every, jobs=jobs, batch=batch, progress=tell))
        return [[next(results) for _ in tasks] for tasks in groups]

    drawn = run(fit_draw, of_draws, 0)
    recovered = tuple(summarise_recovery(*pair) for pair in zip((*wanted, *second), drawn, strict=True))
    gained = tuple(summarise_gains(index, draws) for index, draws in enumerate(run(fit_laws, of_gains, 1)))
    compared = run(fit_all_estimators, of_sweeps, 2, batch=1)
    agreed = tuple(summarise_agreement(*pair) for pair in zip(SWEEPS, compared, strict=True))
    recovery, others = recovered[: len(wanted)], recovered[len(wanted) :]
    return FrictionStudy(
        seeds=(seeds[0], seeds[-1]),
        agreement=agreed,
        recovery=recovery,
        gains=gained,
        second=others,
        contests=contests,
        checks=list_checks(agreed, recovery, gained, others, contests),
    )
