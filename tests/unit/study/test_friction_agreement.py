"""Protocol S1: all estimators on one problem."""

import numpy as np
import pytest

from symid.identification.friction.estimators import ESTIMATORS, STOCHASTIC
from symid.study.friction_paper import SWEEPS, TABLE_1, Sweep
from symid.study.friction_protocols import (
    AGREEMENT,
    NEARNESS,
    build_sweep_scene,
    compare_estimators,
    fit_all_estimators,
    summarise_agreement,
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
    draw = tuple((scene.physical, 1.0) for _ in ESTIMATORS)
    study = summarise_agreement(sweep, [draw])
    assert study.bound == pytest.approx(find_bound(scene), rel=1e-9)
    assert study.bound == pytest.approx(printed, rel=0.06)
    assert study.expected == pytest.approx(251.0 * (sweep.samples - 4) / sweep.samples)


def test_excess_and_distance_are_the_worst_over_all_draws():
    bound = find_bound(build_sweep_scene(SWEEPS[0]))
    draws = []
    for excess, distance in ((0.0, 1.0), (1e-3, 3.5)):
        others = [(tuple(TRUTH + distance * bound), 200.0 * (1.0 + excess)) for _ in ESTIMATORS[1:]]
        draws.append(((tuple(TRUTH), 200.0), *others))
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
    objectives = dict(zip(ESTIMATORS, (objective for _, objective in draw), strict=True))
    least = min(objectives.values())
    for name, objective in objectives.items():
        assert objective <= least * (1.0 + (NEARNESS if name in STOCHASTIC else AGREEMENT))


def test_a_contest_names_who_could_not_take_part():
    from symid.study.friction_paper import FrictionScene, build_whole_cosines

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
