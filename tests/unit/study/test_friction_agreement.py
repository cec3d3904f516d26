"""Protocol S1: all estimators on one problem."""

import numpy as np
import pytest

from symid.identification.friction.estimators import ESTIMATORS, STOCHASTIC
from symid.study.friction_protocols import (
    AGREEMENT,
    NEARNESS,
    RACERS,
    SWEEPS,
    TABLE_1,
    DrawnFit,
    Sweep,
    build_sweep_scene,
    compare_estimators,
    conclude_races,
    fit_all_estimators,
    race_searches,
    summarise_agreement,
    summarise_race,
)

TRUTH = np.array(TABLE_1[-1].values)


def find_bound(scene):
    """Return the Cramer-Rao deviations of (fC, fS, vs, fV) from derivatives written out by hand."""
    v, (coulomb, static, stribeck, _) = scene.velocity, scene.physical
    bump = np.exp(-((v / stribeck) ** 2))
    slopes = np.column_stack([1.0 - bump, bump, (static - coulomb) * bump * 2.0 * v**2 / stribeck**3, v])
    return scene.noise * np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))


# Printed in the specification of the protocol; three digits at most.
PRINTED = ((0.094, 0.223, 0.0012, 0.254), (0.46, 0.12, 0.0010, 5.0), (0.057, 0.087, 0.0005, 0.249))


@pytest.mark.parametrize(("sweep", "printed"), list(zip(SWEEPS, PRINTED, strict=True)))
def test_the_cramer_rao_bound_of_each_motion(sweep, printed):
    scene = build_sweep_scene(sweep)
    draw = tuple(DrawnFit(scene.physical, 1.0) for _ in ESTIMATORS)
    study = summarise_agreement(sweep, [draw])
    assert study.bound == pytest.approx(find_bound(scene), rel=1e-9)
    assert study.bound == pytest.approx(printed, rel=0.06)
    assert study.expected == pytest.approx(251.0 * (sweep.samples - 4) / sweep.samples)


def test_excess_and_distance_are_the_worst_over_all_draws():
    bound = find_bound(build_sweep_scene(SWEEPS[0]))
    draws = []
    for excess, distance in ((0.0, 1.0), (1e-3, 3.5)):
        away = DrawnFit(tuple(TRUTH + distance * bound), 200.0 * (1.0 + excess))
        draws.append((DrawnFit(tuple(TRUTH), 200.0), *[away] * len(ESTIMATORS[1:])))
    first, *others = summarise_agreement(SWEEPS[0], draws).rows
    assert (first.excess, first.error, first.outside, first.agreed) == (0.0, 0.0, 0, 2)
    for row in others:
        assert row.excess == pytest.approx(1e-3)
        assert row.error == pytest.approx(3.5)
        assert row.outside == 4
        # A thousandth is near enough for a search by chance only.
        assert row.agreed == (2 if row.estimator in STOCHASTIC else 1)
        assert row.by_chance == (row.estimator in STOCHASTIC)


def test_all_estimators_reach_one_optimum():
    draw = fit_all_estimators((Sweep(peak=0.5, samples=200), 7))
    objectives = dict(zip(ESTIMATORS, (found.objective for found in draw), strict=True))
    least = min(objectives.values())
    for name, objective in objectives.items():
        assert objective <= least * (1.0 + (NEARNESS if name in STOCHASTIC else AGREEMENT))


def test_a_contest_names_who_could_not_take_part():
    from symid.study.friction_protocols import FrictionScene, build_whole_cosines

    scene = FrictionScene("1", "stribeck", TRUTH, build_whole_cosines((0.5,), 100), 0.7)
    runs = {run.estimator: run for run in compare_estimators("both directions", scene, 0, timed=True).runs}
    assert tuple(runs) == ESTIMATORS
    refused = runs.pop("root-finding")
    assert "one direction" in refused.reason
    assert refused.values == ()
    for run in runs.values():
        assert not run.reason
        assert run.seconds > 0.0
        assert run.excess <= NEARNESS
    assert runs["varpro"].excess <= AGREEMENT
    assert runs["varpro"].solves <= 150
    assert runs["genetic"].history[-1] == pytest.approx(runs["genetic"].objective, rel=1e-12)


def test_a_race_counts_what_the_searches_took():
    scene = build_sweep_scene(Sweep(peak=0.5, samples=200))
    draw = race_searches((scene, 3))
    assert [fit.population for fit in draw] == [64, 48, 0]
    # All candidates once at the start; in a generation of the hybrid children, and neighbours of survivors.
    for fit, visits in zip(draw, (1, 2), strict=False):
        assert fit.evaluations == fit.population * (1 + visits * fit.generations)
        assert fit.near_evaluations == fit.population * (1 + visits * fit.near_generations)
        assert 0 < fit.near_generations < fit.generations
    again = fit_all_estimators((Sweep(peak=0.5, samples=200), 3))
    assert tuple(again[ESTIMATORS.index(name)] for name in RACERS) == draw[:2]


@pytest.mark.parametrize(
    ("hybrid", "finding", "conclusion"),
    [
        (
            (60, 600),
            ("25 % fewer (fewer in 2 of 2 draws)", "600 against 500 evaluations, 20 % more (fewer in 1)"),
            "25 to 25 % fewer generations, 20 to 20 % more evaluations, in 1 motions",
        ),
        (
            (160, 250),
            ("100 % more (fewer in 0 of 2 draws)", "250 against 500 evaluations, 50 % fewer (fewer in 2)"),
            "100 to 100 % more generations, 50 to 50 % fewer evaluations, in 1 motions",
        ),
    ],
)
def test_a_race_is_said_whichever_way_it_went(hybrid, finding, conclusion):
    def fit(generations, evaluations):
        return DrawnFit((1.0,), 1.0, 8, generations, evaluations, 1, 16)

    generations, evaluations = hybrid
    draws = [
        (fit(70, 400), fit(generations - 5, evaluations + 100 if evaluations > 500 else 200)),
        (fit(90, 600), fit(generations + 5, evaluations - 100 if evaluations > 500 else 300)),
    ]
    race = summarise_race("a motion", draws, RACERS)
    assert race.finding == f"{generations} against 80 generations, {', '.join(finding)}"
    assert conclude_races([race]) == conclusion
    assert [cost.estimator for cost in race.costs] == list(RACERS)
