"""The consistent fit is the optimum of all bodies, says its price, and never leaves them."""

import dataclasses

import numpy as np
import pytest

from symid.errors import SolverError
from symid.formats.toml import read_robot
from symid.identification import consistent
from symid.identification.bodies import build_bodies
from symid.identification.consistent import fit_consistent, solve_consistent
from symid.identification.consistent_cost import build_cost
from symid.identification.identifiability import find_identifiability
from symid.identification.regression import fit_wls
from symid.identification.rows import Rows
from symid.notation import INERTIAL
from symid.parameters.consistency_prior import FORMS, build_pseudo_inertias
from tests.chains import draw_parameters


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
    return Rows(
        kind="torque",
        matrix=matrix,
        values=matrix @ truth + noise * rng.normal(size=2 * count),
        group=np.repeat([0, 1], count),
        time=np.tile(np.arange(count) * 1.0, 2),
        velocity=np.ones(2 * count),
        names=bodies.names,
        units=("1",) * size,
        group_names=("one", "two"),
        group_units=("N m", "N m"),
        velocity_units=("rad/s", "rad/s"),
    )


def find_smallest(fit):
    bodies = build_pseudo_inertias(np.array(fit.report["standard_parameters"]))
    return float(np.linalg.eigvalsh(bodies).min())


def test_bodies_that_fit_cost_nothing(bodies):
    truth = draw_truth(bodies, 1)
    rows = make_rows(bodies, truth, 1e-3)
    seen = find_identifiability(rows)
    fit, free = fit_consistent(rows, seen, bodies=bodies), fit_wls(rows, seen)
    deviations = np.sqrt(np.diag(free.covariance))
    assert np.abs((fit.values - free.values) / deviations).max() < 0.3
    assert 0.0 <= fit.report["price_percent"] < 0.1
    assert find_smallest(fit) == pytest.approx(fit.report["eigenvalue"], rel=1e-6)
    assert fit.report["eigenvalue"] > 0.0


@pytest.mark.parametrize("seed", range(4))
def test_values_that_no_bodies_have_are_brought_back_at_a_price(bodies, seed):
    truth = draw_truth(bodies, seed)
    truth[bodies.names.index("ZZ2")] *= -0.5
    rows = make_rows(bodies, truth, 0.05, seed)
    seen = find_identifiability(rows)
    fit, free = fit_consistent(rows, seen, bodies=bodies), fit_wls(rows, seen)
    assert free.values[bodies.names.index("ZZ2")] < 0.0
    assert fit.values[bodies.names.index("ZZ2")] > 0.0
    assert find_smallest(fit) > 0.0
    assert fit.report["price_percent"] > 1.0
    price = np.linalg.norm(fit.residuals * fit.weights) / np.linalg.norm(free.residuals * free.weights)
    assert fit.report["price_percent"] == pytest.approx(100.0 * (price - 1.0), rel=1e-6)


def test_friction_never_drives(bodies):
    truth = draw_truth(bodies, 2)
    truth[bodies.names.index("Fc1")] = -0.3
    rows = make_rows(bodies, truth, 0.05)
    fit = fit_consistent(rows, find_identifiability(rows), bodies=bodies)
    assert -1e-9 < fit.values[bodies.names.index("Fc1")] < 1e-3


def test_derivatives_of_the_cost_are_those_of_differences(bodies):
    rng = np.random.default_rng(3)
    size = len(bodies.names)
    triangle = np.triu(rng.normal(size=(size, size + 1)))
    cost = build_cost(triangle, draw_truth(bodies, 3), bodies, 0.1)
    z = cost.start + 0.3 * rng.normal(size=len(cost.start))
    steps = 1e-6 * np.eye(len(z))
    slope = np.array([(cost.find_value(z + h) - cost.find_value(z - h)) / 2e-6 for h in steps])
    bend = np.array([(cost.find_gradient(z + h) - cost.find_gradient(z - h)) / 2e-6 for h in steps])
    gradient, hessian = cost.find_gradient(z), cost.find_hessian(z)
    np.testing.assert_allclose(gradient, slope, atol=1e-6 * np.abs(gradient).max())
    np.testing.assert_allclose(hessian, bend, atol=1e-6 * np.abs(hessian).max())


def test_a_far_start_ends_at_the_same_bodies(bodies):
    truth = draw_truth(bodies, 4)
    truth[bodies.names.index("ZZ2")] *= -0.5
    rows = make_rows(bodies, truth, 0.05)
    free = fit_wls(rows, find_identifiability(rows))
    triangle = np.linalg.qr(np.column_stack([rows.matrix, rows.values]), mode="r") / 0.05
    near = solve_consistent(triangle, free.values, bodies)
    far = solve_consistent(triangle, free.values, bodies, start=np.zeros(len(near.unknowns)))
    np.testing.assert_allclose(far.values, near.values, atol=1e-5 * np.abs(near.values).max())


def test_the_price_is_that_of_a_program_over_matrix_inequalities(bodies):
    """Clarabel minimises |F [K pi; -1]|^2 over all P >= 0: no distance, closed cone, another method."""
    clarabel = pytest.importorskip("clarabel", reason="wants clarabel: pip install clarabel")
    from scipy import sparse

    truth = draw_truth(bodies, 5)
    truth[bodies.names.index("ZZ2")] *= -0.5
    rows = make_rows(bodies, truth, 0.05)
    seen = find_identifiability(rows)
    fit, free = fit_consistent(rows, seen, bodies=bodies), fit_wls(rows, seen)
    design, target = rows.matrix * free.weights[:, None], rows.values * free.weights
    links = bodies.links.shape[1]
    # The pseudo-inertia is linear in the parameters: P = sum of pi_k E_k, by columns of its upper triangle.
    units = build_pseudo_inertias(np.eye(len(INERTIAL)))
    spots = [(i, j) for j in range(4) for i in range(j + 1)]
    cone = np.array([[unit[i, j] * (1.0 if i == j else np.sqrt(2.0)) for unit in units] for i, j in spots])
    whole = np.hstack([bodies.links.reshape(len(truth), -1), bodies.positive, bodies.bounded, bodies.free])
    loose = bodies.positive.shape[1] + bodies.bounded.shape[1]
    front = np.kron(np.eye(links), cone)
    held = np.zeros((len(front) + loose, whole.shape[1]))
    held[: len(front), : 10 * links] = front
    held[len(front) :, 10 * links : 10 * links + loose] = np.eye(loose)
    matrix = design @ whole
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.PSDTriangleConeT(4)] * links + [clarabel.NonnegativeConeT(loose)]
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(matrix.T @ matrix)),
        -matrix.T @ target,
        sparse.csc_matrix(-held),
        np.zeros(len(held)),
        cones,
        settings,
    )
    found = np.array(solver.solve().x)
    best = np.linalg.norm(matrix @ found - target)
    ours = np.linalg.norm(design @ fit.values - target)
    # The distance keeps ours away from the edge, where the optimum of the closed cone is.
    assert best * (1.0 - 1e-7) < ours < best * (1.0 + 5e-4)
    assert np.allclose(np.einsum("kab,nab->nk", FORMS, build_pseudo_inertias(np.eye(10))), np.eye(10))


def test_an_optimum_that_is_not_reached_is_an_error(bodies, monkeypatch):
    monkeypatch.setattr(consistent, "_LIMIT", 0)
    truth = draw_truth(bodies, 4)
    truth[bodies.names.index("Fc1")] = -0.3
    rows = make_rows(bodies, truth, 0.05)
    with pytest.raises(SolverError) as caught:
        fit_consistent(rows, find_identifiability(rows), bodies=bodies)
    assert caught.value.notices[0].code == "solver.consistent"


def test_rotors_stay_positive(robots_folder):
    robot = read_robot(robots_folder / "tx40.toml")
    bodies = build_bodies(robot)
    assert len(bodies.positive_names) == 7
    truth = np.einsum("pnk,nk->p", bodies.links, bodies.stated) + bodies.positive @ np.full(7, -0.2)
    rows = make_rows(dataclasses.replace(bodies), truth, 0.05)
    fit = fit_consistent(rows, find_identifiability(rows), bodies=bodies)
    assert fit.report["eigenvalue"] > 0.0
    assert fit.report["price_percent"] > 0.0
