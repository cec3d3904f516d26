"""Spaces of Fourier series: demands met by every member, exact derivatives, nothing else excluded."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from symid.errors import UsageError
from symid.excitation.trajectories import build_basis, build_grid_basis, build_series_space
from symid.options import ExciteOptions
from tests.refusals import raises

CENTRE = np.array([0.3, -1.2])


def make_space(*, moving=False, start=None, harmonics=4, period=7.0):
    options = ExciteOptions(harmonics=harmonics, period=period, moving=moving, start=start)
    scales = np.random.default_rng(1).uniform(0.2, 2.0, size=(2, 2 * harmonics + 1))
    return build_series_space(options, CENTRE, scales)


def draw(space, seed):
    return np.random.default_rng(seed).normal(size=space.shape)


def test_the_basis_is_its_formula_and_its_derivatives():
    t = np.linspace(0.0, 3.0, 40)
    basis = build_basis(3, 2.0, t, 4)
    w = np.pi * np.arange(1, 4)
    np.testing.assert_allclose(
        basis[0], np.hstack([np.ones((40, 1)), np.sin(t[:, None] * w), np.cos(t[:, None] * w)]), atol=1e-13
    )
    h = 1e-5
    for order in range(3):
        ahead, behind = build_basis(3, 2.0, t + h, 4), build_basis(3, 2.0, t - h, 4)
        slope = (ahead[order] - behind[order]) / (2 * h)
        np.testing.assert_allclose(basis[order + 1], slope, atol=1e-6 * np.abs(basis[order + 1]).max())


@given(seed=st.integers(0, 100), harmonics=st.integers(2, 8))
def test_every_series_starts_and_ends_at_rest(seed, harmonics):
    space = make_space(harmonics=harmonics)
    ends = build_basis(harmonics, space.period, np.array([0.0, space.period]), 3)
    q, dq, ddq = space.compute_states(draw(space, seed), ends)
    np.testing.assert_allclose(dq, 0.0, atol=1e-8)
    np.testing.assert_allclose(ddq, 0.0, atol=1e-7)
    np.testing.assert_allclose(q[0], q[1], atol=1e-9)


def test_a_start_is_kept_by_every_series():
    space = make_space(start=(0.7, -0.1))
    here = build_basis(4, 7.0, np.zeros(1), 3)
    for seed in range(5):
        q, dq, _ = space.compute_states(draw(space, seed), here)
        np.testing.assert_allclose(q[0], [0.7, -0.1], atol=1e-8)
        np.testing.assert_allclose(dq, 0.0, atol=1e-8)


@pytest.mark.parametrize(
    ("moving", "start", "left"), [(False, None, 7), (True, None, 9), (False, (0.0, 0.0), 6)]
)
def test_demands_take_as_many_unknowns_as_they_are(moving, start, left):
    space = make_space(moving=moving, start=start)
    assert space.shape == (2, left)
    for part in space.maps:
        assert np.linalg.matrix_rank(part) == left


def test_unknowns_give_a_trajectory_and_come_back():
    space = make_space()
    unknowns = draw(space, 3)
    np.testing.assert_allclose(
        space.compute_unknowns(space.compute_coefficients(unknowns)), unknowns, atol=1e-10
    )
    space = make_space(moving=True)
    unknowns = draw(space, 4)
    t = np.linspace(0.0, 7.0, 50)
    states = space.compute_states(unknowns, build_basis(4, 7.0, t, 4))
    trajectory = space.build_trajectory(unknowns, "here")
    for state, wanted in zip(states, trajectory.evaluate_derivatives(t, 3), strict=True):
        np.testing.assert_allclose(state, wanted, atol=1e-10)
    assert (trajectory.source, trajectory.duration, trajectory.size) == ("here", 7.0, 2)
    space = make_space()
    np.testing.assert_array_equal(
        build_grid_basis(space, 8, 2), build_basis(4, 7.0, np.arange(8) * 7.0 / 8, 2)
    )


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"harmonics": 1}, "harmonics: .* 2 .* got 1"),
        ({"start": (0.0,)}, "1 positions, .* 2 joints"),
        ({"start": (0.0, np.nan)}, "not finite"),
    ],
)
def test_options_that_cannot_be(options, says):
    with raises(UsageError, "usage.excitation", match=says):
        build_series_space(ExciteOptions(**options), CENTRE, np.ones((2, 11)))
