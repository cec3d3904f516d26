"""Searches: their derivatives, their optimum against others, counts, edges, the same bits again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import differential_evolution, least_squares

from symid.identification.friction.searches import (
    FrictionOptions,
    Projector,
    build_nlp,
    build_problem,
    search_by_nlp,
    search_by_projection,
)
from symid.ipopt import Ending
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_friction_torque
from tests.frictions import TABLE_1, build_cosines, draw_s1, draw_s2, draw_samples

OPTIONS = FrictionOptions()
TRUTHS = {
    "tustin": (11.0, 20.0, 0.03, 24.0),
    "stribeck": (11.0, 20.0, 0.03, 24.0),
    "lorentzian": (11.0, 20.0, 0.03, 24.0),
    "power-law": (5.0, 6.0, 0.6),
    "stribeck-exponent": (11.6, 23.2, 0.0277, 1.6, 27.9),
    "improved-stribeck": (11.64, 23.19, 0.02767, 27.88, 0.47, 0.01),
    "improved-stribeck-h2": (11.64, 23.19, 0.02767, 27.88, 0.47, 0.01),
    "improved-stribeck-h4": (11.64, 23.19, 0.02767, 27.88, 0.47, 0.01),
    "improved-stribeck-exponent": (11.64, 23.19, 0.02767, 1.7, 27.88, 0.47, 0.01),
    "makkar": (4.0, 100.0, 15.0, 10.0, 300.0, 8.0),
}


def build(name, options=OPTIONS):
    law = get_law(name)
    samples = draw_samples(law, TRUTHS[name], build_cosines(0.1, 1.0, count=400), noise=0.5)
    return build_problem(samples, law, options)


def find_best(projector, bounds, *, seed, **options):
    """Return the least that a search finds which knows nothing of projections' slopes."""
    answer = differential_evolution(
        lambda z: projector.project(z).objective,
        bounds,
        seed=np.random.default_rng(seed),
        popsize=10,
        **options,
    )
    return answer.fun


@pytest.mark.parametrize("name", sorted(TRUTHS))
def test_kaufmans_gradient_is_exact(name):
    problem = build(name)
    projector = Projector(problem, 10**6)
    z = problem.encode(problem.law.from_physical(TRUTHS[name])[1]) + 0.0123
    state = projector.project(z)
    slope = 2.0 * projector.compute_jacobian(state).T @ state.residual
    step = 1e-6
    for place in range(len(z)):
        move = step * np.eye(len(z))[place]
        rise = projector.project(z + move).objective - projector.project(z - move).objective
        assert slope[place] == pytest.approx(rise / (2.0 * step), rel=1e-4, abs=1e-4)


def test_projection_is_linear_least_squares_and_its_optimum_that_of_all_values_at_once():
    samples, law = draw_s1()
    problem = build_problem(samples, law, OPTIONS)
    state = Projector(problem, 10).project(problem.encode([0.04]))
    expected, rest, *_ = np.linalg.lstsq(problem.compute_columns([0.04]), problem.target, rcond=None)
    np.testing.assert_allclose(state.linear, expected, rtol=1e-10)
    assert state.objective == pytest.approx(float(rest[0]), rel=1e-12)
    search = search_by_projection(problem, OPTIONS)

    def find_errors(x):
        return compute_friction_torque(law, samples.inputs, *law.from_physical(x)) - samples.torque

    answer = least_squares(find_errors, TABLE_1, x_scale=(10, 10, 0.01, 10), xtol=1e-14)
    assert search.objective == pytest.approx(2.0 * answer.cost, rel=1e-9)
    np.testing.assert_allclose(law.to_physical(search.linear, search.shape), answer.x, rtol=1e-4)


@pytest.mark.parametrize("name", ["improved-stribeck", "improved-stribeck-h2"])
def test_the_gain_beside_a_kink_is_that_of_the_slope_there(name):
    problem = build(name)
    projector = Projector(problem, 10**6)
    speed = np.unique(np.abs(problem.samples.velocity))[8]
    state, gains = projector.project(problem.encode([0.03, speed])), []
    for side in (-1.0, 1.0):
        near = projector.project(state.z + np.array([0.0, side * 1e-6]))
        slope = min((near.objective - state.objective) / 1e-6, 0.0)
        rate = projector.compute_jacobian(near)[:, 1]
        gains.append(projector.compute_side_gain(state, 1, side))
        assert gains[-1] == pytest.approx(slope**2 / (4.0 * float(rate @ rate)), rel=1e-2, abs=0.0)
    assert any(gains)


@pytest.mark.parametrize("name", sorted(TRUTHS))
def test_no_other_search_finds_less(name):
    problem = build(name)
    search = search_by_projection(problem, OPTIONS)
    assert search.solves <= 150
    box = list(zip(*problem.box, strict=True))
    best = find_best(Projector(problem, 10**9), box, seed=3, maxiter=40, tol=1e-10)
    assert search.objective <= best * (1.0 + 1e-6)


def test_the_limit_of_linear_problems_is_kept_and_no_more_are_solved_than_needed():
    fixed = FrictionOptions(bounds=(("vs", (0.04, 0.04)),))
    search = search_by_projection(build_problem(*draw_s1(), fixed), OPTIONS)
    assert (search.shape, search.solves, search.outcome) == ((0.04,), 1, Ending.CONVERGED)
    # A linear law is solved at once.
    law = get_law("coulomb-viscous")
    samples = draw_samples(law, (11.0, 20.0), build_cosines(0.5), noise=0.0)
    search = search_by_projection(build_problem(samples, law, OPTIONS), OPTIONS)
    np.testing.assert_allclose(law.to_physical(search.linear, search.shape), (11.0, 20.0), rtol=1e-12)
    assert (search.solves, len(search.history)) == (1, 1)
    problem = build_problem(*draw_s2(), OPTIONS)
    few = FrictionOptions(solves=30)
    # The same samples give the same bits.
    first, second = (search_by_projection(problem, few) for _ in range(2))
    assert first == second
    assert first.solves <= 30
    assert first.outcome is Ending.LIMIT


def test_the_grid_stays_inside_the_bounds():
    # Bounds may hold the other order of two slopes alone, as around an earlier fit with a greater g3.
    bounds = FrictionOptions(bounds=(("g2", (40.0, 700.0)), ("g3", (1000.0, 5000.0)), ("g5", (10.0, 170.0))))
    problem = build("makkar", bounds)
    search = search_by_projection(problem, OPTIONS)
    assert np.all((problem.low <= search.shape) & (search.shape <= problem.high))
    assert search.objective <= min(search.history)


@pytest.mark.parametrize(("name", "size"), [("tustin", 0.5), ("tustin", 2.0), ("stribeck", 0.2)])
def test_steps_that_go_too_far_do_not_alternate_about_the_optimum(name, size):
    law, velocity = get_law("stribeck"), build_cosines(1.0)
    samples = draw_samples(law, (11.0, 20.0, 0.05, 20.0), velocity[np.abs(velocity) > 0.1], noise=0.1)
    # What the law misses bends the objective more than its linear model says.
    rate = 12.0 if name == "tustin" else 20.0
    samples = replace(samples, torque=samples.torque + size * np.sin(rate * samples.velocity))
    problem = build_problem(samples, get_law(name), OPTIONS)
    search = search_by_projection(problem, OPTIONS)
    assert search.outcome is Ending.CONVERGED
    assert search.solves <= 100
    projector = Projector(problem, 10**9)
    z = problem.encode(search.shape)
    around = [projector.project(z + step).objective for step in np.linspace(-1e-2, 1e-2, 21)]
    assert search.objective <= min(around) * (1.0 + 1e-12)


@pytest.mark.parametrize("truth", ["stribeck", "improved-stribeck", "improved-stribeck-h2", "tustin"])
@pytest.mark.parametrize(
    ("name", "slow"),
    [
        ("improved-stribeck", 0.0),
        ("improved-stribeck", 0.02),
        # Without slow rows H2 has no optimum: its zone closes on the slowest row, and fP grows without end.
        ("improved-stribeck-h2", 0.0),
        ("improved-stribeck-h4", 0.0),
        ("improved-stribeck-h4", 0.02),
    ],
)
def test_laws_with_kinks_and_jumps_end_by_their_tolerance_on_samples_of_others(name, truth, slow):
    law, velocity = get_law(truth), build_cosines(0.1, 1.0, count=400)
    samples = draw_samples(law, TRUTHS[truth], velocity[np.abs(velocity) >= slow], noise=0.5, seed=3)
    problem = build_problem(samples, get_law(name), OPTIONS)
    search = search_by_projection(problem, OPTIONS)
    assert search.outcome is Ending.CONVERGED
    assert search.solves <= 150
    projector = Projector(problem, 10**9)
    z = problem.encode(search.shape)
    for move in np.vstack([np.eye(len(z)), -np.eye(len(z))]):
        near = np.clip(z + 1e-7 * move, *problem.box)
        assert search.objective <= projector.project(near).objective * (1.0 + 1e-9)


def thin(columns):
    return 0.5 * (columns[:-1:2] + columns[1::2])


def build_filtered(name, physical):
    law = get_law(name)
    velocity = np.concatenate([build_cosines(0.1, 1.0, count=100), [0.0, 0.0]])
    extra = np.column_stack([np.cos(np.arange(len(velocity))), np.ones(len(velocity))])
    samples = draw_samples(
        law, physical, velocity, noise=0.3, extra=extra, extra_names=("a", "b"), reduce=thin
    )
    return build_problem(samples, law, OPTIONS)


@pytest.mark.parametrize(
    ("name", "physical"),
    [
        ("stribeck-exponent", (11.0, 20.0, 0.03, 1.7, 24.0)),
        # The samples hold rest, where a low exponent has derivatives without bound.
        ("stribeck-exponent", (11.0, 20.0, 0.03, 0.6, 24.0)),
        ("improved-stribeck-exponent", (11.6, 23.2, 0.0277, 1.7, 27.9, 0.47, 0.0101)),
        ("power-law", (5.0, 6.0, 0.6)),
        ("makkar", (4.0, 100.0, 15.0, 10.0, 300.0, 8.0)),
    ],
)
def test_derivatives_are_exact(name, physical):
    problem = build_filtered(name, physical)
    smooth, _ = build_nlp(problem, 7.0, *np.zeros((2, 0)))
    x = np.array(physical) * (1.0 + 0.01 * np.arange(len(physical)))
    linear, shape = problem.law.from_physical(list(x))
    errors = problem.target - problem.compute_columns(shape) @ linear
    assert smooth.value(x) == pytest.approx(errors @ errors / 7.0, rel=1e-12)
    gradient, hessian = smooth.gradient(x), smooth.hessian(x)
    for place in range(len(x)):
        step = 1e-6 * x[place] * np.eye(len(x))[place]
        rise, turn = (
            (function(x + step) - function(x - step)) / (2e-6 * x[place])
            for function in (smooth.value, smooth.gradient)
        )
        assert gradient[place] == pytest.approx(rise, rel=1e-5, abs=1e-6)
        np.testing.assert_allclose(hessian[place], turn, rtol=1e-4, atol=1e-6 * np.abs(hessian).max())


def test_a_limit_of_iterations_is_told():
    problem = build_problem(*draw_s2(), OPTIONS)
    search = search_by_nlp(problem, OPTIONS)
    assert search.outcome is Ending.CONVERGED
    assert dict(search.settings)["agreeing"] >= 1
    search = search_by_nlp(problem, replace(OPTIONS, starts=1, iterations=1))
    assert search.outcome is Ending.LIMIT
    assert "Maximum_Iterations_Exceeded" in search.ended
