"""Springs found again from the torque that they gave."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.hysteresis.spring_fit import (
    LEAST_KNEE,
    SpringData,
    SpringWeights,
    build_elasticity,
    build_knee_grid,
    compute_local_slopes,
    compute_ramps,
    filter_parts,
    fit_spring,
    follow_spring,
    hold_knees,
    refine_spring,
    thin_samples,
)
from symid.joint_models.prandtl_ishlinskii import compute_hysteresis_torque, compute_spring_work

PERIOD, RATE = 2e-3, 60.0
KEEP = slice(500, None, 1)
GRID = np.array([0.002, 0.005, 0.010])
TRUE = SpringWeights(
    thresholds=GRID,
    stiffness=np.array([380.0, 120.0, 60.0, 40.0]),
    knees=np.array([-3.0, 2.0, 5.0]),
    slopes=np.array([1.5, 1.4, 0.7]),
)


def test_slopes_are_the_differences_of_the_outer_function():
    inner = np.linspace(-8.0, 8.0, 4001)
    outer, middle = inner + compute_ramps(inner, TRUE) @ (TRUE.slopes - 1.0), (inner[1:] + inner[:-1]) / 2.0
    inside = np.all(np.abs(middle[:, None] - TRUE.knees) > 0.01, axis=1)
    slope = np.diff(outer) / np.diff(inner)
    np.testing.assert_allclose(slope[inside], compute_local_slopes(middle, TRUE)[inside], atol=1e-9)


@pytest.fixture(scope="module")
def phi():
    time = np.arange(6000) * PERIOD
    slow = 0.012 * np.sin(2.0 * np.pi * 0.3 * time) + 0.008 * np.sin(2.0 * np.pi * 0.83 * time + 0.4)
    return slow * np.minimum(1.0, time)


@pytest.fixture(scope="module")
def data(phi):
    return SpringData(torsions=(phi,), periods=(PERIOD,), keeps=(KEEP,), rate=RATE).rebuild(GRID)


@pytest.fixture(scope="module")
def target(data):
    return data.compute_torque(TRUE)


def test_stops_and_knees_at_their_places_are_found(data, phi, target):
    # Weights and their record give the same torque.
    torque = compute_hysteresis_torque(build_elasticity(TRUE), phi)
    assert np.allclose(filter_parts(data, [thin_samples(torque, KEEP)]), target, atol=1e-12)
    plain = replace(TRUE, thresholds=data.thresholds, knees=np.zeros(0), slopes=np.zeros(0))
    assert np.allclose(data.fit_stops(data.compute_torque(plain)).stiffness, TRUE.stiffness, rtol=1e-9)
    start = replace(data.fit_stops(target), knees=TRUE.knees, slopes=np.ones(3))
    found = fit_spring(data, target, start, tolerance=1e-14, iterations=40)
    assert np.allclose(found.stiffness, TRUE.stiffness, rtol=1e-4)
    assert np.allclose(found.slopes, TRUE.slopes, rtol=1e-4)


def refine(phi, target, *, stops=8, knees=4):
    """Return the spring that a grid of so many stops and knees a side leads to."""
    grid = np.arange(1, stops + 1) / (stops + 1.0) * np.abs(phi).max()
    data = SpringData(torsions=(phi,), periods=(PERIOD,), keeps=(KEEP,), rate=RATE).rebuild(grid)
    start = data.fit_stops(target)
    grid = build_knee_grid([part @ start.stiffness for part in data.basis], knees)
    start = replace(start, knees=grid, slopes=np.ones(2 * knees))
    found = refine_spring(data, target, fit_spring(data, target, start))
    found = follow_spring(data, target, found, tolerance=1e-9)
    return found, data.compute_torque(found)


def test_positions_are_found_from_a_grid(phi, target):
    found, torque = refine(phi, target)
    error = torque - target
    assert np.linalg.norm(error) < 3e-3 * np.linalg.norm(target)
    assert len(found.thresholds) <= 5
    assert len(found.knees) <= 6
    whole = build_elasticity(found)
    assert whole.initial_stiffness == pytest.approx(600.0, rel=0.02)


@pytest.mark.parametrize("torque", [0.01, 0.05])
def test_a_knee_at_hardly_any_torque_does_not_set_the_scale(phi, data, torque):
    """Beyond it the true spring is stiffer by half: that is the stiffness at small torsion."""
    knees = {"knees": np.array([-torque, torque]), "slopes": np.array([1.5, 1.5])}
    target = data.compute_torque(replace(TRUE, thresholds=data.thresholds, **knees))
    found, reached = refine(phi, target)
    assert np.linalg.norm(reached - target) < 1e-3 * np.linalg.norm(target)
    places = np.abs(found.knees)
    assert np.all(places > 0.9 * LEAST_KNEE * np.abs(target).max() / 1.5)
    assert build_elasticity(found).initial_stiffness > 800.0
    assert len(found.thresholds) <= 4


@pytest.mark.parametrize(("stops", "knees"), [(0, 4), (8, 0), (0, 0)])
def test_none_means_none(phi, target, stops, knees):
    found, _ = refine(phi, target, stops=stops, knees=knees)
    assert len(found.thresholds) == 0 or stops
    assert not len(found.knees) or knees


def test_knee_grids_lie_between_zero_and_the_torque_reached(data):
    grid = build_knee_grid([part @ TRUE.stiffness for part in data.basis], 3)
    inner = data.basis[0] @ TRUE.stiffness
    assert np.allclose(grid[:3], inner.min() * np.array([1, 3, 5]) / 6.0)
    assert np.allclose(grid[3:], inner.max() * np.array([1, 3, 5]) / 6.0)
    # Knees are held away from zero torque in their order.
    held = hold_knees(np.array([-0.001, -4.0, 0.001, 0.002, 5.0]), 20.0, 10.0)
    assert np.allclose(held, [-0.6, -4.0, 0.3, 0.33, 5.0])


def test_a_spring_that_would_not_rise_gets_a_rest_and_one_without_stiffness_no_torque(phi):
    none = np.zeros(0)
    spring = build_elasticity(
        SpringWeights(thresholds=GRID, stiffness=np.array([0.0, 100.0, 0.0, 0.0]), knees=none, slopes=none)
    )
    assert 0.0 < spring.stiffness < 1e-3
    assert [stop.threshold for stop in spring.stops] == [0.002]
    # Its knees have no effect; left in, they would make a spring that has no inverse.
    none = build_elasticity(replace(TRUE, stiffness=np.zeros_like(TRUE.stiffness)))
    assert (none.stiffness, none.stops, none.knees) == (0.0, (), ())
    assert not compute_hysteresis_torque(none, phi).any()
    assert not compute_spring_work(none, phi).any()
