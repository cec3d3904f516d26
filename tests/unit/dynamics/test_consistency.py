"""Bodies with given base values: against the definition, Pinocchio, finite differences and scipy."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import minimize

from symid.dynamics.base_parameters import build_grouping, compute_parameter_values, derive_base_parameters
from symid.dynamics.nearest_bodies import (
    BodyProblem,
    build_prior,
    build_pseudo_inertias,
    compute_errors,
    compute_standard_parameters,
    optimise_bodies,
    solve_body_equations,
)
from symid.dynamics.physical_consistency import StandardOutcome, compute_standard_set
from symid.errors import RobotError, SolverError, UsageError
from symid.joint_models import FrictionValues
from symid.robot import load_robot
from symid.robot.description import Coupling, Drive, Spring
from symid.robot.inertia import explain_impossible_inertia
from symid.robot.toml_reader import read_robot
from tests.chains import (
    PANDA,
    PUMA560,
    RIGHT_ANGLES,
    STANFORD,
    TWO_LINK,
    assert_close,
    build_chain,
    build_pinocchio,
    draw_parameters,
    each_robot,
    name_parameters,
    set_inertia,
    trees,
)
from tests.refusals import raises

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

ROBOTS = [TWO_LINK, PUMA560, PANDA, STANFORD]
EACH_ROBOT = each_robot(*ROBOTS)


def group(robot, pi, drives=None, base=None):
    """Return beta = K pi, summed term by term from the definition."""
    base = base or derive_base_parameters(robot)
    known, lengths = name_parameters(pi) | (drives or {}), dict(robot.symbols)
    return np.array(
        [sum(float(c.subs(lengths)) * known[label] for label, c in p.terms) for p in base.parameters]
    )


def name_values(base, values):
    """Return values in the order of beta and of friction behind it by name."""
    names = [parameter.name for parameter in (*base.parameters, *base.friction)]
    return dict(zip(names, values, strict=False))


def find_set(robot, base, values, **options):
    """Return the set for base values by name, or in the order of beta and of friction behind it."""
    given = values if isinstance(values, dict) else name_values(base, values)
    return compute_standard_set(robot, base, given, **options)


def change_joints(robot, **fields):
    """Return the robot with a value of each field for each joint."""
    rows = [dict(zip(fields, values, strict=True)) for values in zip(*fields.values(), strict=True)]
    joints = [dataclasses.replace(joint, **row) for joint, row in zip(robot.joints, rows, strict=True)]
    return dataclasses.replace(robot, joints=tuple(joints))


def measure(pi, prior):
    """Return the log-det divergence by its formula."""
    ratio = build_pseudo_inertias(pi) @ np.linalg.inv(build_pseudo_inertias(prior))
    return float(np.trace(ratio, axis1=1, axis2=2).sum() - np.linalg.slogdet(ratio)[1].sum() - 4 * len(pi))


def assert_bodies(pi):
    for row in pi:
        assert row[9] > 0
        assert explain_impossible_inertia(row) == ""
    assert np.linalg.eigvalsh(build_pseudo_inertias(pi)).min() > 0


def test_pseudo_inertia_is_the_second_moment_of_point_masses():
    rng = np.random.default_rng(0)
    points, masses = rng.uniform(-1, 1, (5, 3)), rng.uniform(0.1, 1, 5)
    extended = np.hstack([points, np.ones((5, 1))])
    expected = np.einsum("k,ki,kj->ij", masses, extended, extended)
    tensor = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
    pi = np.array([[*tensor[0], *tensor[1, 1:], tensor[2, 2], *(masses @ points), masses.sum()]])
    np.testing.assert_allclose(build_pseudo_inertias(pi)[0], expected, atol=1e-14)
    np.testing.assert_allclose(compute_standard_parameters(build_pseudo_inertias(pi)), pi, atol=1e-14)


@EACH_ROBOT
@pytest.mark.parametrize("own_prior", [True, False])
def test_bodies_have_the_base_values_and_the_same_torques(robot, own_prior):
    rng = np.random.default_rng(3)
    base, truth = derive_base_parameters(robot), draw_parameters(rng, robot.size)
    beta = group(robot, truth, base=base)
    prior = 5 * draw_parameters(rng, robot.size) if own_prior else None
    found = find_set(robot, base, beta, prior=prior)
    assert found.outcome is StandardOutcome.CONSISTENT
    assert_bodies(found.pi)
    assert np.abs(group(robot, found.pi, base=base) - beta).max() < 1e-10
    assert np.abs(found.residual).max() < 1e-10
    assert found.stationarity < 1e-10
    assert (found.blamed, found.reason) == ((), "")
    assert np.abs(found.pi - truth).max() > 1e-2
    ours, theirs = (build_pinocchio(robot, pi) for pi in (found.pi, truth))
    for _ in range(5):
        state = rng.uniform(-3, 3, (3, robot.size))
        torques = pin.rnea(theirs, theirs.createData(), *state)
        np.testing.assert_allclose(pin.rnea(ours, ours.createData(), *state), torques, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(robot=trees(most=4, rotors=True, angles=RIGHT_ANGLES), seed=st.integers(0, 99))
def test_bodies_have_the_base_values_on_random_trees(robot, seed):
    rng = np.random.default_rng(seed)
    base, truth = derive_base_parameters(robot), draw_parameters(rng, robot.size)
    rotors = {label: rng.uniform(0.01, 2) for label in base.labels if label[1] == "IA"}
    beta = group(robot, truth, rotors, base)
    found = find_set(robot, base, beta)
    assert found.outcome is StandardOutcome.CONSISTENT
    assert_bodies(found.pi)
    drives = dict.fromkeys(rotors, 1.0) | dict(found.drives)
    assert min(drives.values(), default=1.0) > 0
    assert_close(group(robot, found.pi, drives, base), beta, 1e-10)


@each_robot(TWO_LINK, PUMA560)
def test_the_distance_is_stationary_along_all_that_base_values_allow(robot):
    """Its gradient, by central differences, is a combination of the rows of K; congruence changes nothing."""
    rng = np.random.default_rng(8)
    base, prior = derive_base_parameters(robot), draw_parameters(rng, robot.size)
    pi = np.array(find_set(robot, base, group(robot, draw_parameters(rng, robot.size)), prior=prior).pi)
    units = 1e-6 * np.eye(pi.size).reshape(-1, *pi.shape)
    slope = np.array([measure(pi + unit, prior) - measure(pi - unit, prior) for unit in units]) / 2e-6
    rows = build_grouping(robot, base).matrix
    rest = slope - rows.T @ np.linalg.lstsq(rows.T, slope, rcond=None)[0]
    assert np.abs(rest).max() < 1e-6 * np.abs(slope).max()
    assert np.abs(slope).max() > 1
    change = rng.normal(size=(4, 4))
    turned = (compute_standard_parameters(change @ build_pseudo_inertias(x) @ change.T) for x in (pi, prior))
    assert measure(*turned) == pytest.approx(measure(pi, prior), rel=1e-9)


def test_values_of_the_robot_file_come_back_from_their_base_values():
    truth = draw_parameters(np.random.default_rng(5), 6)
    drives = [Drive(has_rotor=True, rotor_inertia=0.3 + 0.1 * k) for k in range(6)]
    robot = change_joints(set_inertia(PUMA560, truth), drive=drives)
    base = derive_base_parameters(robot)
    found = find_set(robot, base, compute_parameter_values(robot, base))
    np.testing.assert_allclose(found.pi, truth, atol=1e-10)
    assert [label for label, _ in found.drives] == [(k, "IA") for k in range(6)]
    np.testing.assert_allclose([value for _, value in found.drives], [0.3 + 0.1 * k for k in range(6)])


def unpack(x):
    """Return standard parameters from Cholesky factors with logarithmic diagonals, ten numbers a link."""
    lower = np.zeros((len(x) // 10, 4, 4))
    rows, columns = np.tril_indices(4, -1)
    lower[:, rows, columns] = x.reshape(-1, 10)[:, 4:]
    lower[:, range(4), range(4)] = np.exp(x.reshape(-1, 10)[:, :4])
    return compute_standard_parameters(lower @ lower.transpose(0, 2, 1))


def pack(pi):
    lower = np.linalg.cholesky(build_pseudo_inertias(pi))
    rows, columns = np.tril_indices(4, -1)
    return np.hstack([np.log(lower[:, range(4), range(4)]), lower[:, rows, columns]]).ravel()


def test_the_set_is_the_optimum_that_scipy_finds():
    rng = np.random.default_rng(6)
    base = derive_base_parameters(TWO_LINK)
    truth, prior = draw_parameters(rng, 2), draw_parameters(rng, 2)
    beta = group(TWO_LINK, truth, base=base)
    found = find_set(TWO_LINK, base, beta, prior=prior)
    best = minimize(
        lambda x: measure(unpack(x), prior),
        pack(truth),
        method="SLSQP",
        bounds=([(-6, 2)] * 4 + [(-4, 4)] * 6) * 2,
        constraints={"type": "eq", "fun": lambda x: group(TWO_LINK, unpack(x), base=base) - beta},
        options={"maxiter": 1000, "ftol": 1e-13},
    )
    assert best.success
    assert found.distance == pytest.approx(measure(found.pi, prior), abs=1e-10)
    assert found.distance == pytest.approx(best.fun, abs=1e-6)
    assert found.distance <= best.fun + 1e-9
    np.testing.assert_allclose(found.pi, unpack(best.x), atol=2e-3)


@pytest.mark.parametrize(("scale", "weight"), [(1.0, 1.0), (1000.0, 0.01), (None, 1.0)])
def test_the_nearest_set_is_the_optimum_that_scipy_finds(scale, weight):
    """With a covariance the distance counts a hundredth, and more where values contradict all bodies."""
    rng = np.random.default_rng(7)
    base, prior = derive_base_parameters(TWO_LINK), draw_parameters(rng, 2)
    beta = group(TWO_LINK, draw_parameters(rng, 2), base=base)
    beta[0] = -0.3
    root = (scale or 1.0) * np.diag(rng.uniform(0.01, 0.1, 6)) @ rng.normal(size=(6, 6))
    found = find_set(TWO_LINK, base, beta, prior=prior, covariance=root @ root.T if scale else None)
    assert found.outcome is StandardOutcome.NEAREST
    assert found.blamed[0] == "ZZR1"
    assert found.reason.startswith("ZZR1 = -0.3: ")
    assert "(ZZ1 + 0.25*M2)" in found.reason
    assert_bodies(found.pi)
    if not scale:
        root = np.diag(0.01 * find_sizes(TWO_LINK, base, prior))

    def cost(x):
        pi = unpack(x)
        apart = np.linalg.solve(root, group(TWO_LINK, pi, base=base) - beta)
        return weight * measure(pi, prior) + 0.5 * float(apart @ apart)

    start = pack(found.pi)
    best = minimize(cost, start + 0.05 * rng.normal(size=20), method="BFGS", options={"maxiter": 3000})
    assert cost(start) <= best.fun * (1 + 1e-9)
    assert best.fun == pytest.approx(cost(start), rel=1e-3)
    np.testing.assert_allclose(found.residual, group(TWO_LINK, found.pi, base=base) - beta, atol=1e-12)


def find_sizes(robot, base, prior):
    """Return the size of every row of K, seen from the prior: |L' X L| with row * pi = tr X P."""
    roots = np.linalg.cholesky(build_pseudo_inertias(prior))
    grouping = build_grouping(robot, base).matrix.reshape(base.count, robot.size, 10)
    # tr X P is linear in P: its coefficients from the unit matrices.
    units = np.eye(16).reshape(16, 4, 4)
    units = 0.5 * (units + units.transpose(0, 2, 1))
    forms = (grouping @ compute_standard_parameters(units).T).reshape(base.count, robot.size, 4, 4)
    return np.sqrt(np.sum((roots.transpose(0, 2, 1) @ forms @ roots) ** 2, axis=(1, 2, 3)))


def draw_problem(rng, deviation):
    blocks = rng.normal(size=(3, 2, 4, 4))
    return BodyProblem(
        blocks=(blocks + blocks.transpose(0, 1, 3, 2)) / deviation,
        positive=rng.normal(size=(3, 2)) / deviation,
        others=rng.normal(size=(3, 1)) / deviation,
        target=rng.normal(size=3) / deviation,
        shares=rng.uniform(0.5, 2, 4),
        weight=1.0,
        middle=np.zeros(1),
        loose=1.0,
    )


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("seed", range(8))
def test_the_solver_fulfils_the_conditions_of_optimality(exact, seed):
    rng = np.random.default_rng(seed)
    problem = draw_problem(rng, 1.0 if exact else 0.5)
    solution = solve_body_equations(problem) if exact else optimise_bodies(problem)
    if exact:
        np.testing.assert_allclose(compute_errors(problem, solution), 0.0, atol=1e-13)
        # The multipliers are those of normalised rows: here only their existence counts.
        gradients = problem.shares[:2, None, None] * (np.linalg.inv(solution.blocks) - np.eye(4))
        slopes = [gradients.ravel(), problem.shares[2:] * (1 / solution.positive - 1), -solution.others]
        rows = np.hstack([problem.blocks.reshape(3, -1), problem.positive, problem.others])
        nu = np.linalg.lstsq(rows.T, np.concatenate(slopes), rcond=None)[0]
    else:
        nu = compute_errors(problem, solution)
        np.testing.assert_allclose(solution.multipliers, nu, atol=1e-12)
        assert solution.gap < 1e-12
        assert solution.gradient < 1e-9
    sums = np.einsum("i,injk->njk", nu, problem.blocks) / problem.shares[:2, None, None]
    np.testing.assert_allclose(
        solution.blocks @ (np.eye(4) + sums), np.tile(np.eye(4), (2, 1, 1)), atol=1e-10
    )
    shares = problem.shares[2:]
    np.testing.assert_allclose(solution.positive * (1 + nu @ problem.positive / shares), 1, atol=1e-10)
    np.testing.assert_allclose(solution.others, -nu @ problem.others, atol=1e-10)
    assert np.linalg.eigvalsh(solution.blocks).min() > 0
    assert np.all(solution.positive > 0)
    assert solution.stationarity < 1e-10


def test_equations_that_nothing_fulfils_have_no_solution():
    problem = draw_problem(np.random.default_rng(8), 1.0)
    blocks = np.tile(np.eye(4), (3, 2, 1, 1)) * np.array([1.0, 2.0, 3.0])[:, None, None, None]
    nothing = dataclasses.replace(
        problem, blocks=blocks, positive=np.ones((3, 2)), others=np.zeros((3, 1)), target=-np.ones(3)
    )
    assert solve_body_equations(nothing) is None
    assert optimise_bodies(nothing).gap < 1e-12


def test_base_values_that_contradict_each_other_are_named():
    """A first moment too large for the inertia and the mass that are left."""
    truth = draw_parameters(np.random.default_rng(9), 2)
    base = derive_base_parameters(TWO_LINK)
    beta = name_values(base, group(TWO_LINK, truth, base=base))
    beta |= {"MX2": 30.0, "ZZ2": 0.01, "ZZR1": 1.0}
    found = find_set(TWO_LINK, base, beta)
    assert found.outcome is StandardOutcome.NEAREST
    assert {"MX2", "ZZR1"} <= set(found.blamed)
    assert all(f"{name} = " in found.reason for name in ("MX2", "ZZR1"))
    assert_bodies(found.pi)


def test_base_values_may_be_known_in_part():
    truth = draw_parameters(np.random.default_rng(10), 6)
    base = derive_base_parameters(PUMA560)
    beta = name_values(base, group(PUMA560, truth, base=base))
    known = {name: beta[name] for name in ("ZZR1", "MXR2", "MYR3")}
    found = find_set(PUMA560, base, known)
    assert found.names == ("ZZR1", "MXR2", "MYR3")
    assert found.outcome is StandardOutcome.CONSISTENT
    reached = name_values(base, group(PUMA560, found.pi, base=base))
    assert {name: reached[name] for name in known} == pytest.approx(known, abs=1e-10)


def test_an_offset_that_is_part_of_a_weight_may_have_any_sign():
    slide = build_chain([(0.0, 0, "q", 0.0)], rotors=True, friction="coulomb-viscous-offset")
    base = derive_base_parameters(slide)
    names = [parameter.name for parameter in (*base.parameters, *base.friction)]
    assert len(names) == 4
    values = np.array([2.0, 0.5, 0.3, 0.1])
    found = find_set(slide, base, values)
    assert found.names == tuple(names)
    assert found.outcome is StandardOutcome.CONSISTENT
    drives = dict(found.drives)
    assert {(0, "IA"), (0, "offset")} <= set(drives)
    known = name_parameters(found.pi) | drives
    for parameter, value in zip((*base.parameters, *base.friction), values, strict=True):
        total = sum(float(c) * known[label] for label, c in parameter.terms)
        assert total == pytest.approx(value, abs=1e-12)


def test_friction_values_of_the_file_are_the_start():
    slide = build_chain([(0.0, 0, "q", 0.0)], rotors=True)
    friction = FrictionValues(law="coulomb-viscous-offset", values=(1.0, 2.0, -3.0))
    robot = change_joints(slide, friction=[friction])
    base = derive_base_parameters(robot)
    pi = draw_parameters(np.random.default_rng(0), 1)
    beta = group(robot, pi, {(0, "offset"): -3.0, (0, "IA"): 0.1 * pi[0, 9]}, base)
    found = find_set(robot, base, beta, prior=pi)
    np.testing.assert_allclose(found.pi, pi, atol=1e-12)
    assert dict(found.drives)[0, "offset"] == pytest.approx(-3.0)


def test_symbolic_lengths_need_values():
    arm = build_chain([(0.0, 0, 0, "q"), (0.0, "L1", 0, "q")], gravity=("0", "-9.81", "0"))
    base = derive_base_parameters(arm)
    with raises(RobotError, "robot.symbol-without-value"):
        find_set(arm, base, np.ones(6))
    valued = dataclasses.replace(arm, symbols=(("L1", 0.5),))
    truth, prior = (draw_parameters(np.random.default_rng(seed), 2) for seed in (13, 14))
    beta = group(valued, truth, base=base)
    found = find_set(valued, base, beta, prior=prior)
    same = find_set(TWO_LINK, derive_base_parameters(TWO_LINK), beta, prior=prior)
    np.testing.assert_allclose(found.pi, same.pi, atol=1e-12)


def test_default_prior_takes_the_file_at_its_word_and_rounds_flat_bodies():
    thin = (0.0, 0.0, 0.0, 0.4, 0.0, 0.4, 0.6, 0.0, 0.0, 1.2)
    stated = tuple(draw_parameters(np.random.default_rng(15), 1)[0])
    impossible = (1.0, 0.0, 0.0, 0.1, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)
    nothing = (0.0,) * 10
    chain = build_chain([(0.0, 0, 0, "q"), *[(0.3, 0.4, 0, "q")] * 4])
    robot = change_joints(chain, inertial=(stated, thin, impossible, nothing, None))
    prior = build_prior(robot, np.zeros((1, 50)), [0.0])
    assert_bodies(prior)
    np.testing.assert_allclose(prior[0], stated)
    np.testing.assert_allclose(prior[1], thin, atol=0.01)
    assert prior[1, 0] > 0
    # Half-way to the next joint at 0.4 m, radius of gyration 0.1 m.
    mass = prior[2, 9]
    np.testing.assert_allclose(prior[2] / mass, [0.02, 0, 0, 0.06, 0, 0.06, 0.2, 0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(prior[3], prior[2], atol=1e-12)
    # The last link carries nothing.
    np.testing.assert_allclose(prior[4] / mass, [0.02, 0, 0, 0.02, 0, 0.02, 0, 0, 0, 1], atol=1e-12)


def test_a_rotor_counts_only_as_a_positive_inertia():
    robot = build_chain([(0.0, 0, 0, "q"), (0.0, 0.5, 0, "q")], rotors=True)
    base = derive_base_parameters(robot)
    rng = np.random.default_rng(16)
    rotors = {(0, "IA"): 0.2, (1, "IA"): 0.4}
    beta = group(robot, draw_parameters(rng, 2), rotors, base)
    names = [parameter.name for parameter in base.parameters]
    found = find_set(robot, base, beta)
    assert found.outcome is StandardOutcome.CONSISTENT
    assert names.index("IA2") > 0
    beta[names.index("IA2")] = -0.1
    refused = find_set(robot, base, beta)
    assert refused.outcome is StandardOutcome.NEAREST
    assert refused.blamed[0] == "IA2"
    assert dict(refused.drives)[1, "IA"] > 0


def test_couplings_and_springs_take_part():
    arm = build_chain([(0.0, 0, 0, "q"), (0.0, 0.5, 0, "q"), (0.3, 0.1, "q", 0.0)], rotors=True)
    arm = change_joints(arm, spring=(None, None, Spring(stiffness=40.0, rest=0.1)))
    terms = ((0, Fraction(1)), (1, Fraction(-2)))
    coupling = Coupling(name="m", terms=terms, has_rotor=True, rotor_inertia=0.2)
    robot = dataclasses.replace(arm, couplings=(coupling,))
    base = derive_base_parameters(robot)
    pi = draw_parameters(np.random.default_rng(20), 3)
    usual = [0.1 * pi[0, 5], 0.1 * pi[1, 5], 0.1 * pi[2, 9]]
    drives = {(k, "IA"): value for k, value in enumerate(usual)}
    drives |= {(3, "IA"): 0.2, (2, "KS"): 40.0, (2, "KR"): -4.0}
    beta = group(robot, pi, drives, base)
    found = find_set(robot, base, beta, prior=pi)
    np.testing.assert_allclose(found.pi, pi, atol=1e-10)
    assert dict(found.drives) == pytest.approx(drives, abs=1e-9)
    moved = find_set(robot, base, 1.5 * beta, prior=pi)
    reached = group(robot, moved.pi, drives | dict(moved.drives), base)
    np.testing.assert_allclose(reached, 1.5 * beta, atol=1e-10)
    assert dict(moved.drives)[3, "IA"] > 0


@pytest.mark.parametrize(
    ("values", "covariance", "code"),
    [
        *((values, None, "usage.base-values") for values in ({}, {"ZZ2": np.nan}, [np.inf] * 6)),
        *(
            ({"ZZ2": -1.0}, covariance, "usage.consistency-weights")
            for covariance in (np.zeros((1, 1)), np.eye(2), np.array([[np.nan]]))
        ),
    ],
)
def test_input_that_cannot_be_used_is_refused(values, covariance, code):
    base = derive_base_parameters(TWO_LINK)
    with raises(UsageError, code):
        find_set(TWO_LINK, base, values, covariance=covariance)
    with raises(UsageError, "usage.base-values", match="ZZR1"):
        find_set(TWO_LINK, base, {"ZZ9": 1.0})


def test_numbers_beyond_all_bounds_end_in_an_error_not_in_a_result():
    """Values of 1e200, known to 1e-150: no float holds what the one is in units of the other."""
    base, prior = derive_base_parameters(TWO_LINK), draw_parameters(np.random.default_rng(18), 2)
    with raises(SolverError, "solver.standard-set"):
        find_set(TWO_LINK, base, -1e200 * np.ones(6), prior=prior, covariance=1e-300 * np.eye(6))


HARD = ("two_link", "puma560", "ur5", "tx40")


@settings(max_examples=16, deadline=None)
@given(name=st.sampled_from(HARD), seed=st.integers(0, 999), thin=st.floats(0.0, 8.0))
def test_thin_bodies_are_matched_exactly(name, seed, thin):
    """Bodies next to lines, `thin` decades from round ones, on robots with coupled drives too."""
    rng, robot = np.random.default_rng(seed), load_robot(name)
    base = derive_base_parameters(robot)
    roots = rng.normal(size=(robot.size, 4, 4)) * np.array([0.3, 0.3, 0.3, 1.0])[:, None]
    roots[:, :, 1:] *= 10.0 ** (-0.5 * thin)
    truth = compute_standard_parameters(roots @ roots.transpose(0, 2, 1))
    truth = truth * 10.0 ** rng.uniform(-1, 1, (robot.size, 1))
    rotors = {label: rng.uniform(0.01, 2) for label in base.labels if label[1] == "IA"}
    beta = group(robot, truth, rotors, base)
    found = find_set(robot, base, beta)
    assert found.outcome is StandardOutcome.CONSISTENT
    assert_bodies(found.pi)
    assert np.abs(found.residual).max() < 1e-10 * max(1.0, np.abs(beta).max())
    assert found.stationarity < 1e-4


@settings(max_examples=16, deadline=None)
@given(name=st.sampled_from(HARD), seed=st.integers(0, 999), spread=st.floats(0.0, 1.5), given=st.booleans())
def test_values_of_any_size_end_at_the_nearest_bodies(robots_folder, name, seed, spread, given):
    """Contradicting values over decades, with deviations over decades: always an answer, always optimal."""
    rng = np.random.default_rng(seed)
    robot = read_robot(robots_folder / f"{name}.toml")
    base = derive_base_parameters(robot)
    sizes = 10.0 ** (rng.uniform(-2, 2) + rng.uniform(-spread, spread, base.count))
    beta = rng.normal(size=base.count) * sizes
    names = [parameter.name for parameter in base.parameters]
    known = np.abs(beta) * 10.0 ** rng.uniform(-4, 0, base.count)
    covariance = np.diag(known**2) if given else None
    found = find_set(robot, base, dict(zip(names, beta, strict=True)), covariance=covariance)
    assert_bodies(found.pi)
    assert found.stationarity < 1e-6
    assert bool(found.blamed) == (found.outcome is StandardOutcome.NEAREST)


@settings(max_examples=12, deadline=None)
@given(robot=st.sampled_from(ROBOTS), seed=st.integers(0, 999), noise=st.floats(-3.0, 0.0))
def test_the_written_bodies_are_as_near_to_an_estimate_as_the_truth(robot, seed, noise):
    """The truth is one of the bodies that could be written: the nearest cost at most what it costs."""
    rng = np.random.default_rng(seed)
    base, prior = derive_base_parameters(robot), draw_parameters(rng, robot.size)
    turns = np.eye(4) + 0.1 * rng.normal(size=(robot.size, 4, 4))
    bodies = turns @ build_pseudo_inertias(prior) @ turns.transpose(0, 2, 1)
    truth = compute_standard_parameters(bodies)
    beta = group(robot, truth, base=base)
    root = rng.normal(size=(base.count, base.count)) * (10.0**noise * np.abs(beta))[:, None]
    error = rng.normal(size=base.count)
    order = rng.permutation(base.count)
    named = list(name_values(base, beta + root @ error).items())
    values = dict(named[k] for k in order)
    covariance = (root @ root.T)[np.ix_(order, order)]
    found = find_set(robot, base, values, prior=prior, covariance=covariance)
    assert_bodies(found.pi)
    written = np.linalg.solve(root, found.residual)
    # What the distance to the prior may add, a hundredth beside half of the squares.
    assert written @ written <= error @ error + 0.02 * measure(truth, prior)
