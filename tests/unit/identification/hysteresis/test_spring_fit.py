"""Springs found again from the torque that they gave, along one log or several."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from symid.identification.hysteresis.families import BoucWenFamily, ElementPath, Stops
from symid.identification.hysteresis.fit import ElementData, choose_spring, predict_output
from symid.identification.hysteresis.spring_fit import (
    SpringData,
    SpringWeights,
    build_elasticity,
    build_knee_grid,
    compute_ramps,
    compute_spring_slopes,
    filter_parts,
    fit_spring,
    follow_spring,
    refine_spring,
)
from symid.identification.judge import POLICY
from symid.joint_models import Elasticity, Stop, run_element
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
    # The torque's derivative by the first stiffness is that slope times the torsion.
    basis = np.outer(middle, [1.0 / TRUE.stiffness[0], 0.0, 0.0, 0.0])
    local = compute_spring_slopes(basis, TRUE)[:, 0] / basis[:, 0]
    np.testing.assert_allclose(slope[inside], local[inside], atol=1e-9)


@pytest.fixture(scope="module")
def phi():
    time = np.arange(6000) * PERIOD
    slow = 0.012 * np.sin(2.0 * np.pi * 0.3 * time) + 0.008 * np.sin(2.0 * np.pi * 0.83 * time + 0.4)
    return slow * np.minimum(1.0, time)


@pytest.fixture(scope="module")
def data(phi):
    return SpringData.build((phi,), (PERIOD,), (KEEP,), RATE).rebuild(GRID)


@pytest.fixture(scope="module")
def target(data):
    return data.compute_torque(TRUE)


def test_stops_and_knees_at_their_places_are_found(data, phi, target):
    # Weights and their record give the same torque.
    torque = compute_hysteresis_torque(build_elasticity(TRUE), phi)
    assert np.allclose(filter_parts(data, [torque[KEEP.start % KEEP.step :: KEEP.step]]), target, atol=1e-12)
    plain = replace(TRUE, thresholds=data.thresholds, knees=np.zeros(0), slopes=np.zeros(0))
    assert np.allclose(data.fit_stops(data.compute_torque(plain)).stiffness, TRUE.stiffness, rtol=1e-9)
    start = replace(data.fit_stops(target), knees=TRUE.knees, slopes=np.ones(3))
    found = fit_spring(data, target, start)
    assert np.allclose(found.stiffness, TRUE.stiffness, rtol=1e-4)
    assert np.allclose(found.slopes, TRUE.slopes, rtol=1e-4)


def refine(phi, target, *, stops=8, knees=4):
    """Return the spring that a grid of so many stops and knees a side leads to."""
    grid = np.arange(1, stops + 1) / (stops + 1.0) * np.abs(phi).max()
    data = SpringData.build((phi,), (PERIOD,), (KEEP,), RATE).rebuild(grid)
    start = data.fit_stops(target)
    grid = build_knee_grid([part @ start.stiffness for part in data.basis], knees)
    start = replace(start, knees=grid, slopes=np.ones(2 * knees))
    found = refine_spring(data, target, fit_spring(data, target, start))
    found = follow_spring(data, target, found)
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
    assert np.all(places > 0.9 * POLICY.relevance * np.abs(target).max() / 1.5)
    assert build_elasticity(found).initial_stiffness > 800.0
    assert len(found.thresholds) <= 4


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


STEP = 1e-3
SPRING = Elasticity(
    stiffness=300.0, stops=(Stop(threshold=0.2, stiffness=90.0), Stop(threshold=0.6, stiffness=60.0))
)


def build_path(*positions):
    whole = np.concatenate(positions)
    begins = np.cumsum([0, *map(len, positions)])[:-1]
    return ElementPath(
        position=whole,
        velocity=np.concatenate([np.gradient(part, STEP) for part in positions]),
        period=np.full(len(whole), STEP),
        begins=tuple(begins.tolist()),
    )


def draw_waves(seed, count=2, length=3000):
    rng = np.random.default_rng(seed)
    time = np.arange(length) * STEP

    def draw(frequency):
        return rng.uniform(0.1, 1.0) * np.sin(2.0 * np.pi * frequency * time + rng.uniform(0.0, 6.0))

    return [draw(0.7) + draw(1.9) for _ in range(count)]


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000))
def test_a_path_of_two_logs_is_followed_as_each_by_itself(seed):
    waves = draw_waves(seed)
    path, parts = build_path(*waves), [build_path(wave) for wave in waves]
    for family in (Stops(count=4), BoucWenFamily()):
        shape = family.list_starts(path)[0]
        joined = family.compute_columns(path, shape)
        apart = np.concatenate([family.compute_columns(part, shape) for part in parts])
        assert np.array_equal(joined, apart)
    time = np.arange(len(waves[0])) * STEP
    torque = np.concatenate([run_element(SPRING, wave, time).output for wave in waves])
    assert predict_output(SPRING, path) == pytest.approx(torque, abs=1e-9)


def test_a_log_that_begins_far_from_the_end_of_another_keeps_its_spring():
    # The second log moves little, so that nothing there erases what the first one would leave.
    large = 0.9 * np.sin(2.0 * np.pi * np.arange(4250) * STEP)
    small = 0.1 * np.sin(2.0 * np.pi * 2.0 * np.arange(6000) * STEP)
    torque = np.concatenate([run_element(SPRING, part).output for part in (large, small)])
    spring, name, left, before = choose(build_path(large, small), torque)
    assert (spring, name) == (SPRING, "")
    assert left == before < 1e-6


def choose(path, torque, known=SPRING):
    return choose_spring(path, torque, np.ones(len(torque), dtype=bool), known, np.zeros(len(torque)))


def test_stops_with_a_cubic_part_are_found():
    path = build_path(*draw_waves(3, length=20000))
    torque = predict_output(replace(SPRING, cubic=150.0), path)
    spring, name, left, before = choose(path, torque, replace(SPRING, stiffness=420.0))
    assert name.startswith("stops, ")
    assert "cubic" in name
    assert left < 0.5 < before
    assert spring.cubic == pytest.approx(150.0, rel=0.02)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_spring_that_is_stiffer_on_one_side_is_found(side):
    path = build_path(*draw_waves(3, length=20000))
    torque = predict_output(SPRING, path) + 150.0 * side * np.maximum(side * path.position, 0.0)
    spring, name, left, before = choose(path, torque)
    assert (name, 10.0 * left < before) == ("sided", True)
    (branch,) = spring.branches
    slopes = np.divide(
        branch.forces, branch.deflections, where=np.array([True, False, True]), out=np.zeros(3)
    )
    assert slopes == pytest.approx(150.0 * np.array([side < 0.0, 0.0, side > 0.0]), rel=0.03)
    np.testing.assert_allclose(predict_output(spring, path), torque, atol=0.02 * np.abs(torque).max())


def test_thinning_keeps_beginnings_and_turning_points():
    def thin(path):
        kept = np.ones(len(path.position), dtype=bool)
        return ElementData(path=path, output=path.position.copy(), kept=kept).thin(400)

    waves = draw_waves(8, length=20000)
    path = build_path(*waves)
    thinned = thin(path).path
    assert [float(thinned.position[k]) for k in thinned.begins] == [float(wave[0]) for wave in waves]
    for wave in waves:
        inner = wave[1:-1]
        peaks = inner[(inner - wave[:-2]) * (inner - wave[2:]) > 0.0]
        assert len(peaks) > 20
        assert set(peaks.tolist()) <= set(thinned.position.tolist())
    assert np.sum(thinned.period[1:]) == pytest.approx(np.sum(path.period[1:]), rel=1e-2)
    assert len(thinned.position) < 700
    # Noise does not keep every sample.
    noise = np.random.default_rng(1).standard_normal(40000)
    assert len(thin(build_path(draw_waves(8, count=1, length=40000)[0] + 0.02 * noise)).output) < 850


def test_a_spring_of_another_scale_stays_of_its_kind():
    # What stops and knees were fitted to differs by a percent from the torque of the links.
    path = build_path(*draw_waves(3, length=8000))
    assert choose(path, 1.01 * predict_output(SPRING, path) + 2.0)[:2] == (SPRING, "")
