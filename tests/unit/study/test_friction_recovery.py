"""Protocol S2 and the second robot: parameters that come back."""

import numpy as np
import pytest

from symid.study.friction_protocols import (
    RV_2SQ,
    TABLE_3,
    FrictionScene,
    build_recovery_scene,
    build_second_scene,
    build_whole_cosines,
    fit_draw,
    summarise_recovery,
)

# Printed in the specification: bounds of fC fS vs fV fP dq0, and samples within dq0.
PRINTED = (
    ((0.039, 0.21, 0.0004, 0.069, 0.022, 0.0001), 72),
    ((0.17, 1.68, 0.0005, 0.32, 0.11, 0.0001), 36),
    ((0.07, 1.22, 0.0007, 0.13, 0.045, 0.0001), 72),
)


def find_bound(scene):
    """Return Cramer-Rao deviations by central differences of the law written out by hand."""

    def find_torque(values):
        coulomb, static, stribeck, viscous, bias, edge = values
        speed = np.maximum(np.abs(scene.velocity), edge)
        g = coulomb + (static - coulomb) * np.exp(-((speed / stribeck) ** 2)) + viscous * speed
        return bias + g * np.clip(scene.velocity / edge, -1.0, 1.0)

    truth, slopes = np.array(scene.physical), []
    for k, value in enumerate(truth):
        # No sample crosses the edge of the zone for so small a step.
        step = np.zeros(len(truth))
        step[k] = 1e-7 * abs(value)
        slopes.append((find_torque(truth + step) - find_torque(truth - step)) / (2.0 * step[k]))
    slopes = np.column_stack(slopes)
    return scene.noise * np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))


@pytest.mark.parametrize("index", range(3))
def test_bounds_of_the_three_joints_and_draws_near_the_truth(index):
    scene = build_recovery_scene(index)
    truth = TABLE_3[index].values
    found = summarise_recovery(scene, [(truth, 10), (tuple(1.01 * value for value in truth), 12)])
    bounds, slow = PRINTED[index]
    assert [entry.bound for entry in found.parameters] == pytest.approx(find_bound(scene), rel=1e-5)
    # vs and dq0 are printed with one digit.
    for entry, printed in zip(found.parameters, bounds, strict=True):
        assert entry.bound == pytest.approx(printed, rel=0.04 if printed > 1e-3 else 0.3)
    assert found.slow == slow
    assert (found.draws, found.solves) == (2, 12)
    found = summarise_recovery(
        build_recovery_scene(index), [fit_draw((build_recovery_scene(index), seed)) for seed in range(4)]
    )
    assert all(entry.error < 5.0 for entry in found.parameters)
    assert found.solves <= 150


def test_mean_deviation_and_bias_are_those_of_the_draws():
    scene = build_recovery_scene(0)
    truth = np.array(scene.physical)
    found = summarise_recovery(scene, [(tuple(truth * factor), 1) for factor in (0.9, 1.0, 1.2)])
    for entry, value in zip(found.parameters, truth, strict=True):
        assert entry.mean == pytest.approx(value * 3.1 / 3.0)
        assert entry.deviation == pytest.approx(abs(value) * np.std([0.9, 1.0, 1.2], ddof=1))
        assert entry.ratio == pytest.approx(entry.deviation / entry.bound)
        assert entry.bias == pytest.approx((entry.mean - value) / entry.deviation)
        assert entry.error == pytest.approx(0.2 * abs(value) / entry.bound)
        assert entry.inside == sum(abs(f - 1.0) * abs(value) <= 3.0 * entry.bound for f in (0.9, 1.0, 1.2))


@pytest.mark.parametrize("index", range(4))
def test_the_second_robot_comes_back(index):
    scene = build_second_scene(index)
    assert scene.noise == pytest.approx(0.02 * RV_2SQ[index].values[0])
    assert np.max(np.abs(scene.velocity[:1000])) == pytest.approx(3.0 * RV_2SQ[index].values[2], rel=1e-4)
    found = summarise_recovery(scene, [fit_draw((scene, seed)) for seed in range(3)])
    assert found.law == RV_2SQ[index].law
    assert all(entry.told and entry.error < 5.0 for entry in found.parameters)


def test_what_the_bound_forbids_is_not_told():
    # A bump a hundredth of the noise: nobody can say how wide it is.
    scene = FrictionScene(
        "1", "stribeck", (10.0, 10.01, 0.03, 20.0), build_whole_cosines((0.1, 1.0), 500), 1.0
    )
    found = summarise_recovery(
        scene, [(scene.physical, 1)] * 2 + [(tuple(1.1 * v for v in scene.physical), 1)]
    )
    assert {entry.name: entry.told for entry in found.parameters} == {
        "fC": True,
        "fS": True,
        "vs": False,
        "fV": True,
    }
