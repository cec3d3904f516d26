"""The problem of an exciting trajectory: columns, loads and space against independent ways to them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from symid.codegen.cache import prepare_library
from symid.errors import RobotError, UsageError
from symid.excitation.limits import StateValues, build_state_limits, get_motion_limits
from symid.excitation.problem import (
    Criterion,
    Observation,
    build_problem,
    compute_condition,
    compute_criterion,
    compute_information,
)
from symid.excitation.trajectories import build_grid_basis
from symid.options import ExciteOptions
from symid.robot.toml_reader import read_robot
from tests.refusals import raises

WORKSPACE = """
[[sphere]]
centre = [0.5, 0.5, 0.0]
radius = 0.2
point = [0.3, 0.1, 0.2]
size = 0.05

[[sphere]]
keep = "in"
centre = [0.0, 0.1, 0.0]
radius = 1.2
point = [0.3, 0.0, 0.0]
size = 0.1

[[plane]]
normal = [0.0, 0.6, 0.8]
offset = -0.9
links = ["shoulder"]
point = [0.4, 0.0, 0.0]
size = 0.1
"""
USUAL = ExciteOptions()


@pytest.fixture
def workspace(tmp_path):
    (tmp_path / "space.toml").write_text(WORKSPACE)
    return tmp_path / "space.toml"


def limit(robot, **options):
    """Return the limits of the whole state of a robot."""
    given = ExciteOptions(**options)
    return build_state_limits(robot, get_motion_limits(robot, given), given)


def read_values(cards):
    return np.array([entry.value for entry in cards])


@pytest.fixture(scope="module")
def elastic(robots_folder):
    return read_robot(robots_folder / "two_link_elastic.toml")


def random_states(count, size=2, seed=0):
    return np.random.default_rng(seed).normal(size=(3, count, size))


def test_columns_are_those_of_the_library(robot):
    library, states = prepare_library(robot), random_states(30)
    observation = Observation(robot, 30, np.array([2.0, 0.5]))
    found = observation.compute_matrix(states).reshape(30, 2, -1)
    (beta,) = library.evaluate("torque_regressor", *states)
    (friction,) = library.evaluate("friction_regressor", states[1])
    wanted = np.concatenate([beta, friction], axis=2) * np.array([2.0, 0.5])[:, None]
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    names = [entry.name for entry in (*library.card.beta, *library.card.friction)]
    assert list(observation.names) == names


def check_slopes(problem, criterion):
    rng = np.random.default_rng(3)
    (z, ahead), h = rng.normal(size=(2, problem.rows.shape[1])) * [[0.3], [1.0]], 1e-6
    watched = rng.random(problem.compute_state_use(z).shape) < 0.3
    slope = problem.compute_value(z, criterion)[1]
    values = [problem.compute_value(z + share * ahead, criterion)[0] for share in (h, -h)]
    np.testing.assert_allclose(slope @ ahead, (values[0] - values[1]) / (2 * h), rtol=1e-5)
    given = problem.build_constraints(np.zeros(watched.shape[1]), watched)
    constraints = [given.value(z + share * ahead) for share in (h, -h)]
    jacobian = given.jacobian(z)
    found = (constraints[0] - constraints[1]) / (2 * h)
    np.testing.assert_allclose(jacobian @ ahead, found, atol=1e-6 * np.abs(found).max())
    assert not np.any(jacobian[~given.pattern])
    assert given.lower.shape == given.upper.shape == constraints[0].shape


@pytest.mark.parametrize("name", ["condition", "d-optimal"])
def test_all_slopes_of_a_rigid_robot(robot, workspace, name):
    problem = build_problem(robot, ExciteOptions(workspace=workspace, deviations=(2.0, 1.0)))
    kinds = [entry.kind for entry in problem.state_limits.entries]
    assert kinds == ["torque", "torque", "out", "in", "plane"]
    check_slopes(problem, Criterion(name=name))
    check_slopes(problem.build_coarse(), Criterion(name=name))


def test_all_slopes_of_an_elastic_robot(elastic):
    problem = build_problem(elastic, ExciteOptions(torsion=0.05))
    assert "torsion" in {entry.kind for entry in problem.state_limits.entries}
    check_slopes(problem, Criterion(power=4.0))


def test_torque_is_that_of_the_library(robot):
    found = limit(robot)
    states = random_states(20)
    # Where friction is smoothed, the sign is nowhere reached; far from rest it is.
    states[1] = np.sign(states[1]) * (2.0 + np.abs(states[1]))
    values = StateValues(found, 20, 2).compute_values(states)
    card = (library := prepare_library(robot)).card
    (tau,) = library.evaluate("inverse_dynamics", *states, read_values(card.beta))
    (friction,) = library.evaluate("friction", states[1], read_values(card.friction))
    bounds = [entry.limit for entry in found.entries]
    np.testing.assert_allclose(values * bounds, tau + friction, rtol=1e-9)
    np.testing.assert_allclose(bounds, [0.95 * 90, 0.95 * 35])


def test_torsion_and_motor_torque_are_those_of_the_links_and_rotors(elastic):
    states = random_states(10)
    library = prepare_library(elastic)
    beta = read_values(library.card.beta)
    (tau,) = library.evaluate("inverse_dynamics", *states, beta)
    stated = [joint.elasticity.stiffness for joint in elastic.joints]
    for stiffness, wanted in ((None, stated), ((500.0, 200.0),) * 2):
        found = limit(elastic, torsion=0.05, stiffness=stiffness)
        values = StateValues(found, 10, 2).compute_values(states)
        places = [place for place, entry in enumerate(found.entries) if entry.kind == "torsion"]
        np.testing.assert_allclose(values[:, places] * 0.05 * 0.95, tau / wanted, rtol=1e-9)
    found, still = limit(elastic), np.zeros((3, 1, 2))
    states = still + np.array([0.0, 0.0, 3.0])[:, None, None]
    bounds = [entry.limit for entry in found.entries]
    values = [StateValues(found, 1, 2).compute_values(each)[0] * bounds for each in (states, still)]
    rotors = read_values(library.card.rotors)
    (mass,) = library.evaluate("mass_matrix", np.zeros((1, 2)), beta)
    np.testing.assert_allclose(values[0] - values[1], (mass[0] + np.diag(rotors)) @ [3.0, 3.0], rtol=1e-9)


def test_space_is_where_plane_geometry_puts_it(robot, workspace):
    limits = replace(get_motion_limits(robot, USUAL), torque=np.full(2, np.inf))
    found = build_state_limits(robot, limits, ExciteOptions(workspace=workspace))
    assert [entry.kind for entry in found.entries] == ["out", "in", "plane"]
    q = np.random.default_rng(5).uniform(-2, 2, size=(12, 2))
    values = StateValues(found, 12, 2).compute_values(np.array([q, 0 * q, 0 * q]))
    c1, s1, c12, s12 = np.cos(q[:, 0]), np.sin(q[:, 0]), np.cos(q.sum(axis=1)), np.sin(q.sum(axis=1))
    first = np.stack(
        [0.3 * c12 - 0.1 * s12 + 0.5 * c1, 0.3 * s12 + 0.1 * c12 + 0.5 * s1, 0.2 + 0 * c1], axis=1
    )
    second = np.stack([0.3 * c12 + 0.5 * c1, 0.3 * s12 + 0.5 * s1], axis=1)
    np.testing.assert_allclose(
        values[:, 0], 2 - np.sum((first - [0.5, 0.5, 0]) ** 2, axis=1) / 0.25**2, rtol=1e-10
    )
    np.testing.assert_allclose(values[:, 1], np.sum((second - [0, 0.1]) ** 2, axis=1) / 1.1**2, rtol=1e-10)
    np.testing.assert_allclose(values[:, 2], 1 - (0.6 * 0.4 * s1 + 0.9 - 0.1), rtol=1e-10)


def test_without_values_or_stiffness_it_is_said(robot, robots_folder):
    panda = read_robot(robots_folder / "panda.toml")
    found = limit(panda)
    assert found.entries == ()
    assert [notice.code for notice in found.notices] == ["excitation.no-torque"]
    with raises(RobotError, "excitation.no-values"):
        limit(panda, torsion=0.01)
    for stiffness in (None, (100.0,), (100.0, -1.0)):
        with raises(RobotError, "excitation.stiffness"):
            limit(robot, torsion=0.01, stiffness=stiffness)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"deviations": (1.0,)}, r"deviations: .* 2 .* got \[1.0\]"),
        ({"deviations": (1.0, 0.0)}, r"deviations: .* 2 .* got \[1.0, 0.0\]"),
        ({"start": (0.0, 2.55)}, "95% .* joint 2"),
    ],
)
def test_options_that_do_not_fit(robot, options, says):
    with raises(UsageError, "usage.excitation", match=says):
        build_problem(robot, ExciteOptions(**options))


def test_the_grid_of_the_search_is_fine_enough(robots_folder):
    """With friction that has no step, figures on the coarse grid are those on the fine one."""
    panda = read_robot(robots_folder / "panda.toml")
    problem = build_problem(panda, ExciteOptions(share=0.9))
    judge = problem.build_stated(panda)
    for seed in range(3):
        z = 0.5 * np.random.default_rng(seed).normal(size=problem.rows.shape[1])
        found, wanted = problem.compute_gram(z), judge.compute_gram(z)
        assert compute_condition(found) == pytest.approx(compute_condition(wanted), rel=1e-3)
        assert compute_information(found) == pytest.approx(compute_information(wanted), abs=1e-3)
    assert build_grid_basis(problem.space, 10, 3).shape == (3, 10, 11)


def make_matrix(seed, rows=40, columns=7):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, columns)) * 10.0 ** rng.uniform(-2, 2, size=columns)


@given(seed=st.integers(0, 200))
def test_the_condition_number_is_that_of_the_scaled_columns(seed):
    matrix = make_matrix(seed)
    wanted = np.linalg.cond(matrix / np.linalg.norm(matrix, axis=0))
    np.testing.assert_allclose(compute_condition(matrix.T @ matrix), wanted, rtol=1e-8)


def test_information_rank_and_weight_are_those_of_the_matrix():
    matrix = make_matrix(3)
    wanted = np.log(np.linalg.svd(matrix, compute_uv=False)).mean()
    np.testing.assert_allclose(compute_information(matrix.T @ matrix), wanted, rtol=1e-10)
    np.testing.assert_allclose(
        compute_criterion(matrix.T @ matrix, Criterion(name="d-optimal"))[0], -wanted, rtol=1e-10
    )
    gram = make_matrix(7).T @ make_matrix(7)
    plain, more = (compute_criterion(gram, Criterion(power=4.0, weight=w))[0] for w in (0.0, 0.5))
    np.testing.assert_allclose(plain - more, 0.5 * compute_information(gram), rtol=1e-10)
    matrix = make_matrix(4)
    matrix[:, 2] = 3.0 * matrix[:, 5]
    assert compute_condition(matrix.T @ matrix) == np.inf
    assert compute_information(np.zeros((3, 3))) == -np.inf
    # The search may still go on from there.
    assert np.isfinite(compute_criterion(matrix.T @ matrix, Criterion())[0])
    value, slope = compute_criterion(make_matrix(8).T @ make_matrix(8), Criterion(power=400.0))
    assert np.isfinite(value)
    assert np.all(np.isfinite(slope))


@given(seed=st.integers(0, 100), power=st.sampled_from([2.0, 8.0, 40.0]))
def test_the_stand_in_is_above_the_condition_number_and_near_it(seed, power):
    matrix = make_matrix(seed)
    gram = matrix.T @ matrix
    gap = compute_criterion(gram, Criterion(power=power))[0] - np.log(compute_condition(gram))
    assert -1e-9 <= gap <= np.log(7) / power + 1e-9


@pytest.mark.parametrize("name", ["condition", "d-optimal"])
@pytest.mark.parametrize("weight", [0.0, 0.3])
def test_slopes_are_those_of_finite_differences(name, weight):
    matrix = make_matrix(5)
    ahead = np.random.default_rng(6).normal(size=matrix.shape) * np.linalg.norm(matrix, axis=0)
    criterion = Criterion(name=name, power=6.0, weight=weight)

    def compute_value(share):
        moved = matrix + share * ahead
        return compute_criterion(moved.T @ moved, criterion)[0]

    slope = compute_criterion(matrix.T @ matrix, criterion)[1]
    np.testing.assert_allclose(slope, slope.T, atol=1e-12 * np.abs(slope).max())
    h = 1e-5
    found = float(np.sum(2.0 * (matrix @ slope) * ahead))
    np.testing.assert_allclose(found, (compute_value(h) - compute_value(-h)) / (2 * h), rtol=1e-6)
