"""The tables of Zhang, Hu and Zou (2021) on synthetic data, and what is asked of our estimators there.

Input: seeds. Output: `FrictionStudy`.

    S1: one direction, all estimators (Table 1)    S2: draws of the improved law (Table 3)
    S3: gains of the improved law (Table 4)        a second robot with published friction
    contests: all estimators on one data set, with what each of them cost

Every seed draws its own noise, so that the results are the same for any number of processes; the time that
estimators take is the only number that differs from run to run, and is measured only where it is asked for.

Supported: at least two seeds. Not supported: the paper's own recordings, which are not public.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from symid.errors import Notice, UsageError
from symid.study.executor import run_tasks
from symid.study.friction_agreement import (
    AgreementStudy,
    Contest,
    build_sweep_scene,
    find_agreement,
    fit_all_estimators,
    run_contest,
)
from symid.study.friction_checks import FrictionCheck, find_checks
from symid.study.friction_data import Scene
from symid.study.friction_gains import GainStudy, build_gain_scene, find_gains, fit_laws
from symid.study.friction_paper import RV_2SQ, SWEEPS, TABLE_3
from symid.study.friction_recovery import (
    Recovery,
    build_recovery_scene,
    build_second_scene,
    find_recovery,
    fit_draws,
)

__all__ = ["DRAWS", "FrictionStudy", "study_friction"]

A = TypeVar("A")
B = TypeVar("B")

DRAWS = 1000
"""Of protocol S2; the others take fewer of the same seeds."""
_AGREEMENT_DRAWS, _GAIN_DRAWS, _SECOND_DRAWS = 20, 100, 100
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
    contests: tuple[Contest, ...]
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
    contests = _run_contests(seeds[0], timed=timed)
    wanted = [build_recovery_scene(index) for index in range(len(TABLE_3))]
    second = [build_second_scene(index) for index in range(len(RV_2SQ))]
    gains = [build_gain_scene(index) for index in range(len(TABLE_3))]
    of_draws = [_split(scene, seeds) for scene in wanted]
    of_draws += [_split(scene, seeds[:_SECOND_DRAWS]) for scene in second]
    of_gains = [_split(scene, seeds[:_GAIN_DRAWS]) for scene in gains]
    of_sweeps = [[(sweep, seed) for seed in seeds[:_AGREEMENT_DRAWS]] for sweep in SWEEPS]
    stages = [sum(map(len, tasks)) for tasks in (of_draws, of_gains, of_sweeps)]
    whole = sum(stages)

    def run(function: Callable[[A], B], groups: Sequence[Sequence[A]], stage: int) -> list[list[B]]:
        before = sum(stages[:stage])
        tell = None if progress is None else lambda done, _: progress(before + done, whole)
        results = iter(run_tasks(function, [x for tasks in groups for x in tasks], jobs=jobs, progress=tell))
        return [[next(results) for _ in tasks] for tasks in groups]

    drawn = [[x for part in parts for x in part] for parts in run(fit_draws, of_draws, 0)]
    recovered = tuple(find_recovery(*pair) for pair in zip((*wanted, *second), drawn, strict=True))
    gained = tuple(
        find_gains(index, [draw for part in parts for draw in part])
        for index, parts in enumerate(run(fit_laws, of_gains, 1))
    )
    agreed = tuple(
        find_agreement(sweep, draws)
        for sweep, draws in zip(SWEEPS, run(fit_all_estimators, of_sweeps, 2), strict=True)
    )
    recovery, others = recovered[: len(wanted)], recovered[len(wanted) :]
    return FrictionStudy(
        seeds=(seeds[0], seeds[-1]),
        agreement=agreed,
        recovery=recovery,
        gains=gained,
        second=others,
        contests=contests,
        checks=find_checks(agreed, recovery, gained, others, contests),
    )


def _run_contests(seed: int, *, timed: bool) -> tuple[Contest, ...]:
    sweep, cosines = build_sweep_scene(SWEEPS[0]), build_recovery_scene(0)
    return (
        run_contest("Table 1, joint 1, one direction", sweep, seed, timed=timed),
        run_contest("Table 3, joint 1, two cosines", cosines, seed, timed=timed),
    )


def _split(scene: Scene, seeds: Sequence[int]) -> list[tuple[Scene, tuple[int, ...]]]:
    """Return the seeds in batches, each worth a message to another process."""
    return [(scene, tuple(seeds[k : k + _BATCH])) for k in range(0, len(seeds), _BATCH)]
