"""The tables of Zhang, Hu and Zou (2021) on synthetic data, and which claims about our estimators are met.

Seeds -> `FrictionStudy`: protocols S1 to S3, a second robot with published friction, all estimators on one
data set each, and one `FrictionCheck` a claim.

Every seed draws its own noise: the results are the same for any number of processes, except for times, which
are measured only where they are asked for. Claims on spreads are judged from 100 draws on: fewer give a
deviation no better than to 7 percent.

Not supported: the paper's recordings, which are not public; a limit for the gain over the original Stribeck
law, which is a prediction.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from symid.errors import Notice, UsageError
from symid.identification.friction import ESTIMATORS, VariableProjectionOptions
from symid.study.friction_protocols import (
    AGREEMENT,
    NEARNESS,
    NOT_IDENTIFIABLE,
    RACERS,
    RV_2SQ,
    SWEEPS,
    TABLE_3,
    AgreementStudy,
    EstimatorComparison,
    GainStudy,
    Recovery,
    SearchRace,
    build_gain_scene,
    build_recovery_scene,
    build_second_scene,
    build_sweep_scene,
    compare_estimators,
    conclude_races,
    fit_all_estimators,
    fit_draw,
    fit_laws,
    race_searches,
    summarise_agreement,
    summarise_gains,
    summarise_race,
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
        name: of the claim; bar: what is required; found: the result.
        met: whether it was met; None where there are too few draws to judge, or nothing to meet.
    """

    name: str
    bar: str
    found: str
    met: bool | None


def list_checks(
    *,
    agreement: Sequence[AgreementStudy],
    recovery: Sequence[Recovery],
    gains: Sequence[GainStudy],
    second: Sequence[Recovery],
    contests: Sequence[EstimatorComparison],
    races: Sequence[SearchRace],
) -> tuple[FrictionCheck, ...]:
    """Return all claims, in the order of the tables."""
    checks = [check for entry in agreement for check in _check_agreement(entry)]
    checks.append(
        FrictionCheck(
            name="Table 2: the hybrid against the genetic algorithm",
            bar="far fewer generations and more efficient in the paper, which does not print its algorithms",
            found=conclude_races(races),
            met=None,
        )
    )
    checks += [check for entry in recovery for check in _check_recovery(entry)]
    checks += [
        FrictionCheck(
            name=f"S3, joint {entry.joint}: improved against Coulomb + viscous (the noise was set for this)",
            bar=f"within {_POINTS:g} point of {entry.viscous.paper:g} %",
            found=f"{entry.viscous.mean:.1f} %, mean of {entry.draws} draws",
            met=abs(entry.viscous.miss) <= _POINTS if entry.draws >= _ENOUGH else None,
        )
        for entry in gains
    ]
    checks += [
        FrictionCheck(
            name=f"S3, joint {entry.joint}: improved against original Stribeck (a prediction)",
            bar=f"{entry.stribeck.paper:g} % in the paper",
            found=f"{entry.stribeck.mean:.1f} %: {entry.stribeck.describe_miss()}",
            met=None,
        )
        for entry in gains
    ]
    checks += [_check_second(entry) for entry in second]
    limit = VariableProjectionOptions().solves
    for contest in contests:
        run = next(entry for entry in contest.runs if entry.estimator == _DEFAULT)
        check = FrictionCheck(
            name=f"{contest.title}: {_DEFAULT} has the least objective of all estimators",
            bar=f"{AGREEMENT:g} relative, {limit} linear problems at most",
            found=f"{run.excess:.1e} above the least, {run.solves} linear problems",
            met=run.excess <= AGREEMENT and run.solves <= limit,
        )
        checks.append(check)
    return tuple(checks)


def _check_agreement(study: AgreementStudy) -> list[FrictionCheck]:
    where = f"S1, peak {study.sweep.peak:g} rad/s"
    exact = [row for row in study.rows if not row.by_chance]
    excess, worst = max(row.excess for row in exact), max(row.error for row in exact)
    return [
        FrictionCheck(
            name=f"{where}: {', '.join(row.estimator for row in exact)} agree on the sum of squares",
            bar=f"{AGREEMENT:g} relative",
            found=f"{excess:.1e} in {study.draws} draws",
            met=excess <= AGREEMENT,
        ),
        *(
            FrictionCheck(
                name=f"{where}: {row.estimator} reaches the sum of squares",
                bar=f"within {100.0 * NEARNESS:g} % in every draw",
                found=f"{row.agreed} of {row.draws} draws, worst {100.0 * row.excess:.2g} %",
                met=row.agreed == row.draws,
            )
            for row in study.rows
            if row.by_chance
        ),
        FrictionCheck(
            name=f"{where}: estimates of the deterministic estimators",
            bar="within 3 Cramer-Rao deviations",
            found=f"the farthest of {len(study.truth) * study.draws} is {worst:.2f} away",
            met=worst <= 3.0,
        ),
    ]


def _check_recovery(study: Recovery) -> tuple[FrictionCheck, FrictionCheck]:
    enough = study.draws >= _ENOUGH
    ratio = max(study.parameters, key=lambda parameter: abs(parameter.ratio - 1.0))
    bias = max(study.parameters, key=lambda parameter: abs(parameter.bias))
    return (
        FrictionCheck(
            name=f"S2, joint {study.joint}: standard deviations",
            bar=f"within {100.0 * _RATIO:g} % of the Cramer-Rao bound",
            found=f"{100.0 * (ratio.ratio - 1.0):+.1f} % at most, {ratio.name}, {study.draws} draws",
            met=abs(ratio.ratio - 1.0) <= _RATIO if enough else None,
        ),
        FrictionCheck(
            name=f"S2, joint {study.joint}: bias",
            bar=f"below {_BIAS:g} standard deviations",
            found=f"{bias.bias:+.3f} at most, {bias.name}, {study.draws} draws",
            met=abs(bias.bias) < _BIAS if enough else None,
        ),
    )


def _check_second(study: Recovery) -> FrictionCheck:
    known = [parameter for parameter in study.parameters if parameter.told]
    lost = [parameter.name for parameter in study.parameters if not parameter.told]
    inside = min((parameter.inside for parameter in known), default=0)
    mean = max((abs(entry.mean - entry.truth) / entry.bound for entry in known), default=0.0)
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


_AGREEMENT_DRAWS, _OTHER_DRAWS = 20, 100
_BATCH = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionStudy:
    """All tables.

    Args:
        seeds: first and last one.
        agreement: S1, one a motion; recovery: S2, one a joint; gains: S3, one a joint.
        races: Table 2, one a motion of S1, and one of S2.
        second: joints of the RV-2SQ; contests: all estimators on one data set each.
        checks: claims, and whether they are met.
    """

    seeds: tuple[int, int]
    agreement: tuple[AgreementStudy, ...]
    races: tuple[SearchRace, ...]
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

    `seeds` are those of the noise: S2 draws all of them, S1 and Table 2 the first 20, the others the first
    100. `timed`: whether the time that each estimator takes is measured. `jobs` and `progress` as of
    `run_tasks`. A UsageError: fewer than two seeds, or jobs is not positive.
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
    groups: list[tuple[Callable[[Any], Any], object, Sequence[int]]] = [
        *((fit_draw, scene, seeds) for scene in wanted),
        *((fit_draw, scene, seeds[:_OTHER_DRAWS]) for scene in second),
        *((fit_laws, scene, seeds[:_OTHER_DRAWS]) for scene in gains),
        *((fit_all_estimators, sweep, seeds[:_AGREEMENT_DRAWS]) for sweep in SWEEPS),
        (race_searches, wanted[0], seeds[:_AGREEMENT_DRAWS]),
    ]
    tasks = [(function, (what, seed)) for function, what, numbers in groups for seed in numbers]
    results = iter(run_tasks(_run_draw, tasks, jobs=jobs, batch=_BATCH, progress=progress))
    found = iter([[next(results) for _ in numbers] for _, _, numbers in groups])
    parts: dict[str, Any] = {
        "contests": contests,
        "recovery": tuple(summarise_recovery(scene, next(found)) for scene in wanted),
        "second": tuple(summarise_recovery(scene, next(found)) for scene in second),
        "gains": tuple(summarise_gains(index, next(found)) for index in range(len(gains))),
    }
    swept = [(sweep, next(found)) for sweep in SWEEPS]
    parts["agreement"] = tuple(summarise_agreement(sweep, draws) for sweep, draws in swept)
    races: list[tuple[str, list[Any], tuple[str, ...]]]
    races = [(f"one direction, {sweep.peak:g} rad/s", draws, ESTIMATORS) for sweep, draws in swept]
    races.append(("two directions, Table 3", next(found), RACERS))
    parts["races"] = tuple(summarise_race(*race) for race in races)
    return FrictionStudy(seeds=(seeds[0], seeds[-1]), checks=list_checks(**parts), **parts)


def _run_draw(task: tuple[Callable[[Any], Any], Any]) -> Any:  # noqa: ANN401  as the function has it
    """Return what a protocol finds for one scene or motion and one seed."""
    function, argument = task
    return function(argument)
