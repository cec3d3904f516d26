"""The consistent fit is the optimum of all bodies, says its price, and never leaves them."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from symid.codegen.cache import prepare_library
from symid.dynamics import compute_cost, compute_errors, nearest_bodies
from symid.dynamics.nearest_bodies import PSEUDO_INERTIA_FORMS, build_pseudo_inertias
from symid.errors import SolverError
from symid.identification.estimators import consistent
from symid.identification.estimators.consistent import (
    build_bodies,
    build_cost,
    fit_consistent,
    solve_consistent,
)
from symid.identification.estimators.least_squares import fit_wls
from symid.identification.judge import numerics
from symid.identification.regression.identifiability import analyse_identifiability
from symid.identification.rigid.fit import identify_parameters
from symid.logs.reader import read_recording
from symid.notation import INERTIAL
from symid.robot.description import Decimation, Processing
from symid.robot.toml_reader import read_robot
from tests.chains import draw_parameters
from tests.recovery.cone_programs import solve_closed_cone, solve_with_distance
from tests.refusals import raises
from tests.unit.identification.row_tables import make_rows as build_rows


@pytest.fixture(scope="module")
def bodies(robots_folder):
    return build_bodies(read_robot(robots_folder / "two_link.toml"))


def draw_truth(bodies, seed):
    rng = np.random.default_rng(seed)
    pi = np.array(draw_parameters(rng, bodies.links.shape[1]))
    values = np.einsum("pnk,nk->p", bodies.links, pi)
    return values + bodies.bounded @ np.full(bodies.bounded.shape[1], 0.5)


def make_rows(bodies, truth, noise, seed=0, count=120):
    rng = np.random.default_rng(seed)
    size = len(truth)
    matrix = rng.normal(size=(2 * count, size))
    values = matrix @ truth + noise * rng.normal(size=2 * count)
    return build_rows(matrix, values, np.repeat([0, 1], count), names=bodies.names)


def spoil_rows(bodies, seed, name, factor, noise, *, rows_seed=0):
    """Return rows whose truth has one value times a factor: no bodies, or friction that drives."""
    truth = draw_truth(bodies, seed)
    index = bodies.names.index(name)
    truth[index] = factor if name == "Fc1" else truth[index] * factor
    rows = make_rows(bodies, truth, noise, rows_seed)
    return rows, analyse_identifiability(rows)


def find_smallest(fit):
    bodies = build_pseudo_inertias(np.array(fit.report["standard_parameters"]))
    return float(np.linalg.eigvalsh(bodies).min())


def test_bodies_that_fit_cost_nothing(bodies):
    truth = draw_truth(bodies, 1)
    rows = make_rows(bodies, truth, 1e-3)
    seen = analyse_identifiability(rows)
    fit, free = fit_consistent(rows, seen, bodies=bodies), fit_wls(rows, seen)
    deviations = np.sqrt(np.diag(free.covariance))
    assert np.abs((fit.values - free.values) / deviations).max() < 0.3
    assert 0.0 <= fit.report["price_percent"] < 0.1
    assert fit.notices == ()
    assert find_smallest(fit) == pytest.approx(fit.report["eigenvalue"], rel=1e-6)
    assert fit.report["eigenvalue"] > 0.0


@pytest.mark.parametrize("seed", range(4))
def test_values_that_no_bodies_have_are_brought_back_at_a_price(bodies, seed):
    rows, seen = spoil_rows(bodies, seed, "ZZ2", -0.5, 0.05, rows_seed=seed)
    fit, free = fit_consistent(rows, seen, bodies=bodies), fit_wls(rows, seen)
    dear = bool(fit.report["price_percent"] > 5.0)
    assert [notice.code for notice in fit.notices] == ["identify.price"] * dear
    assert all(f" {fit.report['price_percent']:.3g} % " in notice.text for notice in fit.notices)
    assert free.values[bodies.names.index("ZZ2")] < 0.0
    assert fit.values[bodies.names.index("ZZ2")] > 0.0
    assert find_smallest(fit) > 0.0
    assert fit.report["price_percent"] > 1.0
    price = np.linalg.norm(fit.residuals * fit.weights) / np.linalg.norm(free.residuals * free.weights)
    assert fit.report["price_percent"] == pytest.approx(100.0 * (price - 1.0), rel=1e-6)


def scale_triangle(rows, free):
    """Return the triangle of the weighted rows over the deviation of their noise."""
    weighted = free.residuals * free.weights
    variance = float(weighted @ weighted) / (len(weighted) - free.spent.sum())
    whole = np.column_stack([rows.matrix, rows.values]) * free.weights[:, None]
    return np.linalg.qr(whole, mode="r") / np.sqrt(variance)


def minimise_by_cones(cost, triangle, bodies, near):
    """Return clarabel's answer, unknowns scaled about those of `near`, and the cost there, written anew."""
    expected = cost.roots @ cost.roots.transpose(0, 2, 1)
    theirs = solve_with_distance(
        triangle,
        bodies,
        expected,
        cost.problem.weight,
        about=cost.roots @ near.factors,
        units=cost.rotors * near.positive,
        rotors=cost.rotors,
        loose=numerics.RIDGE,
        middle=cost.problem.middle,
    )
    inverse = np.linalg.inv(cost.roots)
    scaled = inverse @ theirs.bodies @ inverse.transpose(0, 2, 1)
    distance = np.trace(scaled, axis1=1, axis2=2) - np.linalg.slogdet(scaled)[1] - 4.0
    ratio = theirs.positive / cost.rotors
    errors = triangle[:, :-1] @ theirs.values - cost.problem.target
    apart = distance.sum() + (ratio - np.log(ratio) - 1.0).sum()
    off = theirs.loose - cost.problem.middle
    return theirs, 0.5 * errors @ errors + cost.problem.weight * apart + 0.5 * numerics.RIDGE * off @ off


@pytest.fixture(scope="module")
def contradicted(bodies):
    """Return rows that no bodies have, their fit without bounds, and their triangle."""
    rows, seen = spoil_rows(bodies, 5, "ZZ2", -0.5, 0.05)
    free = fit_wls(rows, seen)
    return rows, free, scale_triangle(rows, free)


@pytest.mark.parametrize("weight", [1e-3, 0.5])
def test_the_optimum_is_that_of_a_cone_program_with_the_same_distance(
    bodies, contradicted, monkeypatch, weight
):
    """Clarabel minimises the same cost, log det as a cone of its own: one convex problem, two methods."""
    pytest.importorskip("clarabel", reason="wants clarabel: pip install clarabel")
    _, free, triangle = contradicted
    monkeypatch.setattr(consistent, "_WEIGHT", weight)
    ours = solve_consistent(triangle, free.values, bodies)
    cost = build_cost(triangle, free.values, bodies, ours.weight)
    theirs, least = minimise_by_cones(cost, triangle, bodies, ours.nearest)
    assert compute_cost(cost.problem, ours.nearest) == pytest.approx(least, rel=1e-7)
    deviations = np.sqrt(np.diag(free.covariance))
    np.testing.assert_allclose(ours.values / deviations, theirs.values / deviations, atol=1e-3)
    errors = triangle[:, :-1] @ ours.values - cost.problem.target
    np.testing.assert_allclose(compute_errors(cost.problem, ours.nearest), errors, rtol=1e-7, atol=1e-9)


def test_the_price_is_that_of_a_program_over_matrix_inequalities(bodies, contradicted, monkeypatch):
    """Clarabel minimises |F [K pi; -1]|^2 over all P >= 0: no distance, closed cone, another method.

    No body has what these rows ask for: a moment of inertia that vanishes, a first moment that does not. The
    least is only approached, with a mass m that no torque shows: the inertia is at least the square of the
    first moment over m, what it adds to the cost falls with 1/m, and the distance grows with g m. So the best
    mass grows with 1/sqrt(g), and with sqrt(g) the fit comes down to what clarabel finds.
    """
    pytest.importorskip("clarabel", reason="wants clarabel: pip install clarabel")
    rows, _, triangle = contradicted
    seen = analyse_identifiability(rows)

    def find_residual(values):
        return np.linalg.norm(triangle @ np.append(values, -1.0))

    best = find_residual(solve_closed_cone(triangle, bodies).values)
    found, masses = [], []
    for weight in (1e-4, 1e-5, 1e-6):
        monkeypatch.setattr(consistent, "_WEIGHT", weight)
        fit = fit_consistent(rows, seen, bodies=bodies)
        found.append(find_residual(fit.values))
        masses.append(fit.report["standard_parameters"][0][INERTIAL.index("M")])
    root = np.sqrt(10.0)
    first, second = -np.diff(found)
    assert first / second == pytest.approx(root, rel=0.02)
    np.testing.assert_allclose(np.array(masses[1:]) / masses[:-1], root, rtol=0.02)
    # Without any weight, and with the default one.
    assert found[-1] - second / (root - 1.0) == pytest.approx(best, rel=3e-6)
    assert best < found[-1] < best * (1.0 + 2e-5)
    assert found[0] < best * (1.0 + 2e-4)
    monkeypatch.undo()
    assert best < find_residual(fit_consistent(rows, seen, bodies=bodies).values) < best * 1.02
    assert np.allclose(
        np.einsum("kab,nab->nk", PSEUDO_INERTIA_FORMS, build_pseudo_inertias(np.eye(10))), np.eye(10)
    )


def test_a_friction_that_would_drive_ends_on_its_bound(bodies, monkeypatch):
    given = spoil_rows(bodies, 4, "Fc1", -0.3, 0.05)
    fit = fit_consistent(*given, bodies=bodies)
    assert fit.report["gap"] < 1e-8
    assert fit.report["gradient"] < 1e-6
    assert 0.0 <= fit.values[bodies.names.index("Fc1")] < 1e-9
    # An optimum that is not reached is an error.
    monkeypatch.setattr(nearest_bodies, "_LIMIT", 5)
    with raises(SolverError, "solver.consistent", match="steps"):
        fit_consistent(*given, bodies=bodies)


SETTLED = {
    "kr300": Processing(filter_cutoff=100.0, decimation=Decimation(factor=3)),
    "tx40": Processing(filter_cutoff=200.0, decimation=Decimation(factor=50)),
}
"""Rows with little noise, slow ones too: what is left there is of the model, and prices can be compared."""


@pytest.mark.parametrize(
    ("name", "logs", "price"),
    [("kr300", "a", 2.0), ("kr300", "ab", 0.5), ("kr300", "abc", 0.5), ("tx40", "", 0.5)],
)
def test_real_recordings_have_bodies(shared_data, robots_folder, name, logs, price):
    """Short logs that tell little, with a counterbalance outside the model: masses that an arm may have."""
    robot = read_robot(robots_folder / f"{name}.toml")
    files = [f"run_{run}.npz" for run in logs] or [f"{name}.npz"]
    recordings = [read_recording(shared_data / name / file, robot) for file in files]
    options = {"bodies": build_bodies(robot)}
    library, processing = prepare_library(robot), SETTLED[name]
    estimate = identify_parameters(library, recordings, processing, estimator="consistent", options=options)
    found = estimate.settings["fit"]
    assert max(found["gradient"], found["gap"]) < 1e-6
    assert found["steps"] < 200
    assert 0.0 < found["price_percent"] < price
    pi = np.array(found["standard_parameters"])
    assert np.linalg.eigvalsh(build_pseudo_inertias(pi)).min() == pytest.approx(found["eigenvalue"], rel=1e-6)
    assert found["eigenvalue"] > 0.0
    # The larger one weighs about a ton, which nothing told the fit.
    assert pi[:, INERTIAL.index("M")].sum() < 2000.0


_ROBOTS = ("two_link", "puma560", "ur5", "tx40")


@st.composite
def contradictions(draw):
    """Draw a robot's name, a seed, decades of the scales of rows, and the rank that they lack."""
    robot = draw(st.sampled_from(_ROBOTS))
    return robot, draw(st.integers(0, 999)), draw(st.floats(0.0, 2.0)), draw(st.integers(0, 3))


@settings(max_examples=12, deadline=None)
@given(contradictions())
def test_any_rows_and_any_values_end_at_the_least_of_all_bodies(robots_folder, contradiction):
    """Values that no bodies have, rows of any condition, some combinations and parameters not seen at all."""
    pytest.importorskip("clarabel", reason="wants clarabel: pip install clarabel")
    name, seed, decades, lacking = contradiction
    bodies = build_bodies(read_robot(robots_folder / f"{name}.toml"))
    rng = np.random.default_rng(seed)
    size = len(bodies.names)
    scales = 10.0 ** rng.uniform(-decades, decades, size=(2, size))
    left = np.linalg.qr(rng.normal(size=(size, size)))[0]
    matrix = (left * scales[0]) @ np.linalg.qr(rng.normal(size=(size, size)))[0] * scales[1]
    matrix[:, rng.permutation(size)[:lacking]] = 0.0
    matrix[:lacking] = 0.0
    target = rng.normal(size=size) * np.abs(matrix).max() * 10.0 ** rng.uniform(-3.0, 1.0)
    noise = np.append(np.zeros(size), np.sqrt(10.0 * size))
    triangle = np.vstack([np.column_stack([matrix, target]), noise])
    centre = np.linalg.lstsq(matrix, target, rcond=1e-8)[0]
    found = solve_consistent(triangle, centre, bodies)
    assert np.all(np.isfinite(found.values))
    assert np.linalg.eigvalsh(build_pseudo_inertias(found.pi)).min() > 0.0
    cost = build_cost(triangle, centre, bodies, found.weight)
    ours = compute_cost(cost.problem, found.nearest)
    theirs, least = minimise_by_cones(cost, triangle, bodies, found.nearest)
    assert ours <= least * (1.0 + 1e-6)
    # Where clarabel does not call its own point an optimum, it may be above it.
    assert theirs.status != "Solved" or ours == pytest.approx(least, rel=1e-6)
