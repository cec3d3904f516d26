"""Parts of the cost: step means of knees against fine sampling and finite differences, sums against loops."""

import numpy as np
import pytest

from symid.identification.elastic.nlp_cost import build_filter_sums, build_knee_steps, build_window_sums
from symid.identification.elastic.regression import filter_held
from symid.joint_models.prandtl_ishlinskii import compute_stop_basis

KNEES = ((-0.8, 1), (-0.3, 0), (0.25, 2), (0.8, 1))
SLOPES = np.array([0.5, -0.2, 0.7])
WEIGHTS = np.array([0.6, 0.4, 0.5])


TIME = np.linspace(0.0, 9.0, 400)
BASIS = compute_stop_basis(np.sin(3.0 * TIME) * np.cos(0.7 * TIME), np.array([0.1, 0.4]))


def find(weights):
    return build_knee_steps(BASIS, weights, KNEES)


def test_means_are_those_of_the_dead_zones_along_each_step():
    torque = BASIS @ WEIGHTS
    fine = torque[:-1, None] + np.diff(torque)[:, None] * ((np.arange(2000) + 0.5) / 2000.0)
    expected = np.zeros((len(fine), 3))
    for knee, slot in KNEES:
        zone = np.maximum(fine - knee, 0.0) if knee > 0 else np.minimum(fine - knee, 0.0)
        expected[:, slot] += zone.mean(axis=1)
    np.testing.assert_allclose(find(WEIGHTS).means, expected, atol=1e-8)
    assert sum(len(steps) for _, steps, *_ in find(WEIGHTS).crossings) > 20
    # A spring without knees has no steps.
    steps = build_knee_steps(BASIS, WEIGHTS, ())
    assert steps.means.shape == (399, 0)
    assert not steps.compute_slopes(np.zeros(0)).any()


def test_slopes_are_the_derivatives_by_the_weights():
    found = find(WEIGHTS).compute_slopes(SLOPES)
    for column, step in enumerate(1e-6 * np.eye(3)):
        before, after = (find(WEIGHTS + sign * step).means @ SLOPES for sign in (-1.0, 1.0))
        np.testing.assert_allclose(found[:, column], (after - before) / 2e-6, atol=2e-5)


def test_cross_terms_and_curvature_are_the_derivatives_of_the_slopes():
    rng = np.random.default_rng(0)
    multipliers = rng.normal(size=399)
    steps = find(WEIGHTS)
    slopes = np.eye(3)
    for slot in range(3):
        expected = multipliers @ steps.compute_slopes(slopes[slot])
        np.testing.assert_allclose(steps.compute_cross(multipliers)[:, slot], expected, rtol=1e-12)
    curvature = steps.compute_curvature(multipliers, SLOPES)
    np.testing.assert_allclose(curvature, curvature.T, rtol=1e-12)
    size = 1e-7
    for column, step in enumerate(size * np.eye(3)):
        before, after = (
            multipliers @ find(WEIGHTS + sign * step).compute_slopes(SLOPES) for sign in (-1.0, 1.0)
        )
        np.testing.assert_allclose(
            (after - before) / (2.0 * size), curvature[:, column], rtol=1e-4, atol=1e-4
        )


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_crossing_by_hand(side):
    basis = side * np.array([[-1.0], [3.0]])
    found = build_knee_steps(basis, np.ones(1), ((side * 1.0, 0),))
    # Half of the step lies beyond the knee and reaches 2: the mean is 2 * 0.5 / 2.
    assert found.means[0] == pytest.approx([side * 0.5])
    ((_, _, place, bend),) = found.crossings
    assert (place[0], bend[0]) == (pytest.approx(0.5), pytest.approx(side * 0.25))
    assert (found.starts[0, 0], found.ends[0, 0]) == (pytest.approx(0.125), pytest.approx(0.375))


RATE, PERIOD, COUNT = 60.0, 1e-3, 997


def check_adjoint(sums, rng):
    steps, rows = rng.normal(size=COUNT), rng.normal(size=len(sums.add(np.zeros(COUNT))))
    assert sums.add(steps) @ rows == pytest.approx(steps @ sums.spread(rows), rel=1e-12)


def test_the_filter_is_that_of_held_signals_and_spreads_as_its_adjoint():
    rng, kept = np.random.default_rng(0), slice(130, None, 7)
    steps = rng.normal(size=(COUNT, 3))
    sums = build_filter_sums(kept, COUNT, float(np.exp(-RATE * PERIOD)))
    whole = filter_held(np.vstack([steps, steps[-1:]]), RATE, PERIOD)
    np.testing.assert_allclose(sums.add(steps), whole[kept], rtol=1e-12, atol=1e-14)
    check_adjoint(sums, rng)


def test_windows_are_weighted_sums_and_spread_as_their_adjoint():
    rng, ends = np.random.default_rng(1), slice(40, 40 + 30 * 31 + 1, 31)
    weights, steps = rng.normal(size=COUNT), rng.normal(size=(COUNT, 2))
    sums = build_window_sums(ends, weights)
    expected = [weights[k : k + 31] @ steps[k : k + 31] for k in range(40, 40 + 30 * 31, 31)]
    np.testing.assert_allclose(sums.add(steps), expected, rtol=1e-12)
    check_adjoint(sums, rng)
    counted = np.arange(30) % 3 > 0
    np.testing.assert_allclose(sums.mask(counted).add(steps), sums.add(steps) * counted[:, None], rtol=1e-12)
