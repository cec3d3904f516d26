"""Newton's method over bodies, against closed forms: one link that no row sees, one rotor, one friction."""

import dataclasses

import numpy as np
import pytest

from symid.dynamics import build_expected_bodies, compute_cost, optimise_bodies
from symid.errors import SolverError
from symid.identification.estimators import consistent
from symid.identification.estimators.consistent import Bodies, build_cost, solve_consistent
from tests.refusals import raises

ROUND = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])


def build_one_link(links=None, *, count=2):
    """Return bodies of one link; by default parameters that are its rotor and its viscous friction alone."""
    empty = np.zeros((count, 0))
    unit = np.eye(count)
    return Bodies(
        names=tuple(f"p{index}" for index in range(count)),
        links=np.zeros((count, 1, 10)) if links is None else links,
        positive=unit[:, :1] if links is None else empty,
        bounded=unit[:, 1:] if links is None else empty,
        free=empty,
        stated=ROUND[None, :],
        unit=False,
    )


@pytest.mark.parametrize("weight", [1e-3, 0.5, 1e3])
@pytest.mark.parametrize("steep", [1e-3, 1.0, 1e7])
@pytest.mark.parametrize("wanted", [-5.0, 0.01, 2.0])
def test_a_rotor_and_a_friction_end_where_quadratic_equations_say(weight, steep, wanted):
    """f^2 r (r u - c) + g (1 - 1 / u) = 0 for the rotor u r, max(c, 0) for the friction."""
    bodies = build_one_link()
    triangle = np.array([[steep, 0.0, steep * wanted], [0.0, steep, -steep * wanted]])
    cost = build_cost(triangle, np.array([wanted, -wanted]), bodies, weight)
    found = optimise_bodies(cost.problem)
    unit = float(cost.rotors[0])
    square = (steep * unit) ** 2
    half = 0.5 * (steep**2 * unit * wanted - weight)
    # The positive root, without the difference of large numbers.
    root = np.sqrt(half**2 + square * weight)
    expected = (half + root) / square if half > 0.0 else weight / (root - half)
    assert found.positive[0] == pytest.approx(expected, rel=1e-9)
    friction = float(cost.loose[1, 0] * found.others[0])
    assert friction == pytest.approx(max(-wanted, 0.0), rel=1e-7, abs=np.sqrt(1e-10 * weight) / steep)
    assert friction >= 0.0
    # Nothing tells of the link: it is the one expected.
    np.testing.assert_allclose(found.factors[0], np.eye(4), atol=1e-9)
    short = 0.5 * square * (expected - wanted / unit) ** 2 + weight * (expected - np.log(expected) - 1.0)
    held = 0.5 * (steep * min(-wanted, 0.0)) ** 2
    assert compute_cost(cost.problem, found) - (short + held) <= found.gap + 1e-9 * (short + held)
    assert found.gap <= 1e-9 * weight


@pytest.mark.parametrize("weight", [1e-6, 1e-3, 0.5])
def test_inertias_that_no_body_has_end_where_an_equation_says(weight):
    """Rows want YY + ZZ - XX = 2 a < 0, with a the second moment along x, and see nothing else.

    Q is diagonal, a = u / 2, and f^2 / 2 u (u / 2 - c) + g (u - 1) = 0: a quadratic equation again.
    """
    links = np.zeros((1, 1, 10))
    links[0, 0, [0, 3, 5]] = -0.5, 0.5, 0.5
    bodies = build_one_link(links, count=1)
    triangle = np.array([[10.0, -30.0]])
    cost = build_cost(triangle, np.array([-3.0]), bodies, weight)
    found = optimise_bodies(cost.problem)
    block = found.factors[0] @ found.factors[0].T
    # A round body of unit inertia: second moment one half.
    half = 0.5 * (10.0**2 * 0.5 * -3.0 - weight)
    expected = weight / (np.sqrt(half**2 + (10.0 * 0.5) ** 2 * weight) - half)
    np.testing.assert_allclose(block, np.diag([expected, 1.0, 1.0, 1.0]), rtol=1e-8, atol=1e-9)


def test_a_start_far_away_ends_at_the_same_bodies():
    rng = np.random.default_rng(2)
    links = rng.normal(size=(5, 1, 10))
    bodies = build_one_link(links, count=5)
    triangle = np.column_stack([np.triu(rng.normal(size=(5, 5))), rng.normal(size=5) - 3.0])
    cost = build_cost(triangle, np.linalg.solve(triangle[:, :5], triangle[:, 5]), bodies, 0.01)
    near = optimise_bodies(cost.problem)
    factors = np.tril(3.0 * rng.normal(size=(1, 4, 4)), -1) + np.diag(np.exp(3.0 * rng.normal(size=4)))
    start = dataclasses.replace(build_expected_bodies(cost.problem), factors=factors)
    far = optimise_bodies(cost.problem, start)
    assert compute_cost(cost.problem, far) == pytest.approx(compute_cost(cost.problem, near), rel=1e-10)
    blocks = [found.factors @ found.factors.transpose(0, 2, 1) for found in (far, near)]
    np.testing.assert_allclose(*blocks, rtol=1e-6, atol=1e-8)


def test_what_was_refused_still_counts_for_what_it_tells():
    """A combination that is hardly seen was left at zero without bounds: still the truth costs nothing."""
    rng = np.random.default_rng(3)
    left, right = (np.linalg.qr(rng.normal(size=(4, 4)))[0] for _ in range(2))
    sizes = np.array([10.0, 5.0, 1.0, 1e-7])
    matrix = (left * sizes) @ right
    truth = rng.normal(size=4)
    # One more row: noise that no parameters explain.
    triangle = np.vstack([np.column_stack([matrix, matrix @ truth]), [0.0, 0.0, 0.0, 0.0, 2.0]])
    refused = right[:3].T @ (right[:3] @ truth)
    cost = build_cost(triangle, refused, build_one_link(np.ones((4, 1, 10)), count=4), 1.0)
    np.testing.assert_allclose(cost.problem.target, triangle[:, :-1] @ truth, atol=1e-13)


def test_bodies_beyond_all_numbers_are_an_error(monkeypatch):
    """Rounding of L C may lose the smallest eigenvalue: what is no body in floating point is no answer."""
    flat = np.diag([1.0, 1.0, 1.0, 0.0])[None]
    monkeypatch.setattr(consistent, "build_cost", lambda *call: build_cost(*call)._replace(roots=flat))
    triangle = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    with raises(SolverError, "solver.singular-bodies"):
        solve_consistent(triangle, np.ones(2), build_one_link())
