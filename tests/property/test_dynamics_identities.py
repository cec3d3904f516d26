"""Laws that the dynamics of any tree obeys: with followers, coupled drives, springs, rational geometry.

Everything is compared with Pinocchio's torques of the joints, folded onto the coordinates, drives added by
their formulas (`tests.chains.regress`). Derivatives in time are complex steps, exact to rounding.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from symid.codegen.casadi_functions import build_functions
from symid.dynamics import regressors
from symid.dynamics.algebra import FloatAlgebra
from symid.dynamics.base_parameters import build_standard_parameters, derive_base_parameters
from symid.dynamics.bodies import compute_drive_energy, compute_mass_matrix, list_drive_parameters
from symid.dynamics.newton_euler import compute_inverse_dynamics
from symid.dynamics.recursion import build_recursion, fold_matrix, fold_vector
from symid.notation import INERTIAL
from symid.robot.geometry import ZERO
from tests import chains
from tests.chains import (
    RATIONAL_ANGLES,
    RATIONAL_LENGTHS,
    build_chain,
    build_pinocchio,
    draw_parameters,
    fold,
    name_parameters,
    regress,
    spread,
    trees,
)
from tests.float_algebra import build_float_state

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

STEP = 1e-30
TREES = trees(
    most=4,
    angles=st.one_of(st.sampled_from([0.0, np.pi / 2, -np.pi / 2]), RATIONAL_ANGLES),
    lengths=RATIONAL_LENGTHS,
    rotors=True,
    followers=True,
    couplings=True,
    springs=True,
)
SEEDS = st.integers(0, 999)


@dataclass(frozen=True)
class Case:
    """A robot with bodies and drives, and a state of its coordinates."""

    robot: object
    pi: np.ndarray
    values: dict
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray

    @property
    def keys(self):
        return tuple(self.values)


def draw_case(robot, seed):
    rng = np.random.default_rng(seed)
    pi = draw_parameters(rng, robot.size)
    values = name_parameters(pi)
    for label in list_drive_parameters(robot):
        values[label] = rng.uniform(-2, 2) if label[1] == "KR" else rng.uniform(0.1, 2)
    return Case(robot, pi, values, *rng.uniform(-2, 2, (3, robot.freedom)))


CASES = st.builds(draw_case, TREES, SEEDS)


def over_cases(examples):
    return lambda test: settings(max_examples=examples, deadline=None)(given(case=CASES)(test))


def build(robot, q, dq, ddq):
    """Return the recursion over floats, or complex numbers, in a state of the coordinates."""
    state = build_float_state(*(spread(robot, values) for values in (q, dq, ddq)))
    return build_recursion(robot, FloatAlgebra(dict(robot.symbols)), state)


def assert_close(found, expected, tolerance=1e-11):
    expected = np.asarray(expected, dtype=float)
    chains.assert_close(np.asarray(found, dtype=float).reshape(expected.shape), expected, tolerance)


def find_torques(case):
    """Return the torques of the coordinates by Pinocchio, drives and springs by their formulas."""
    robot = case.robot
    model = build_pinocchio(robot, case.pi)
    state = (spread(robot, values) for values in (case.q, case.dq, case.ddq))
    torque = fold(robot, pin.rnea(model, model.createData(), *state))
    columns = regress(robot, case.q, case.dq, case.ddq, friction=False)
    drives = [columns[label] * value for label, value in case.values.items() if label[1] not in INERTIAL]
    return torque + sum(drives, np.zeros(robot.freedom))


def stack(case, columns):
    """Return the folded columns of a regressor as a matrix."""
    algebra = FloatAlgebra()
    return np.array([fold_vector(case.robot, algebra, columns[key]) for key in case.keys]).T


def find_mass(case, recursion):
    """Return the mass matrix of the coordinates."""
    return np.array(fold_matrix(case.robot, recursion.algebra, compute_mass_matrix(recursion, case.values)))


def find_inverse(robot, recursion, values):
    """Return the torques of the coordinates by Newton and Euler."""
    return np.array(fold_vector(robot, recursion.algebra, compute_inverse_dynamics(recursion, values)))


def measure_energy(case, q, dq):
    """Return kinetic and potential energy of links, rotors and springs."""
    recursion = build(case.robot, q, dq, 0 * dq)
    kinetic = potential = 0.0
    for link, motion in enumerate(recursion.motions):
        moving, resting = regressors.compute_energy_regressor(recursion.algebra, motion)
        kinetic = kinetic + np.dot(moving, case.pi[link])
        potential = potential + np.dot(resting, case.pi[link])
    for label, value in case.values.items():
        if label[1] not in INERTIAL:
            parts = compute_drive_energy(recursion, label)
            kinetic, potential = kinetic + parts[0] * value, potential + parts[1] * value
    return kinetic, potential


def group(case):
    """Return beta = K pi."""
    base = derive_base_parameters(case.robot)
    return np.array([sum(float(c) * case.values[label] for label, c in p.terms) for p in base.parameters])


def call(robot, *names, **options):
    built = build_functions(robot, names=names or None, **options)
    return {function.name(): function for function in built.functions}


@over_cases(25)
def test_regressor_newton_euler_and_pinocchio_give_the_same_torques(case):
    robot = case.robot
    recursion = build(robot, case.q, case.dq, case.ddq)
    regressor = stack(case, regressors.compute_torque_columns(recursion, case.keys))
    expected = find_torques(case)
    assert_close(regressor @ np.array(list(case.values.values())), expected)
    assert_close(find_inverse(robot, recursion, case.values), expected)
    oracle = regress(robot, case.q, case.dq, case.ddq, friction=False)
    assert_close(regressor, np.array([oracle[key] for key in case.keys]).T)
    reference = (recursion.state.velocity, recursion.state.acceleration)
    assert_close(stack(case, regressors.compute_torque_columns(recursion, case.keys, reference)), regressor)


@over_cases(25)
def test_generated_functions_in_base_parameters_give_the_same_torques(case):
    robot = case.robot
    beta, expected = group(case), find_torques(case)
    q, dq, ddq = case.q, case.dq, case.ddq
    functions = call(
        robot,
        "torque_regressor",
        "inverse_dynamics",
        "slotine_li_regressor",
        "bias",
        "mass_matrix",
        "gravity",
    )
    assert_close(np.array(functions["torque_regressor"](q, dq, ddq)) @ beta, expected)
    assert_close(functions["inverse_dynamics"](q, dq, ddq, beta), expected)
    assert_close(np.array(functions["slotine_li_regressor"](q, dq, dq, ddq)) @ beta, expected)
    mass = np.array(functions["mass_matrix"](q, beta))
    assert_close(mass @ ddq + np.array(functions["bias"](q, dq, beta)).ravel(), expected)
    still = replace(case, dq=0 * dq, ddq=0 * ddq)
    assert_close(functions["gravity"](q, beta), find_torques(still))


@over_cases(25)
def test_mass_matrix_is_symmetric_positive_definite_and_pinocchios(case):
    robot = case.robot
    recursion = build(robot, case.q, case.dq, case.ddq)
    mass = find_mass(case, recursion).astype(float)
    np.testing.assert_array_equal(mass, mass.T)
    assert np.linalg.eigvalsh(mass).min() > 0
    still = replace(
        case,
        robot=replace(robot, gravity=(ZERO, ZERO, ZERO)),
        values={label: 0.0 if label[1] in ("KS", "KR") else value for label, value in case.values.items()},
        dq=0 * case.dq,
    )
    # Pinocchio's crba wants its joints depth first; its rnea does not.
    units = np.eye(robot.freedom)
    expected = np.array([find_torques(replace(still, ddq=unit)) for unit in units]).T
    assert_close(mass, expected)
    assert_close(call(robot, "mass_matrix")["mass_matrix"](case.q, group(case)), expected)


@over_cases(25)
def test_power_of_the_torques_is_the_change_of_the_energy(case):
    energies = measure_energy(case, case.q + 1j * STEP * case.dq, case.dq + 1j * STEP * case.ddq)
    change = complex(sum(energies)).imag / STEP
    torque = find_torques(case)
    scale = np.abs(torque) @ np.abs(case.dq)
    assert abs(change - torque @ case.dq) < 1e-12 * max(1.0, scale)


@over_cases(20)
def test_energy_of_the_functions_is_that_of_links_drives_and_springs(case):
    """The kinetic energy itself, the potential energy up to a constant."""
    robot = case.robot
    beta = group(case)
    functions = call(robot, "energy", "energy_regressor")
    kinetic, potential = (float(value) for value in functions["energy"](case.q, case.dq, beta))
    expected = [float(value) for value in measure_energy(case, case.q, case.dq)]
    still = 0 * case.q
    start = float(functions["energy"](still, still, beta)[1])
    assert_close(kinetic, expected[0])
    assert_close(potential - start, expected[1] - float(measure_energy(case, still, still)[1]), 1e-10)
    rows = [np.array(row).ravel() @ beta for row in functions["energy_regressor"](case.q, case.dq)]
    assert_close(rows, [kinetic, potential])


@over_cases(25)
def test_momentum_and_lagrange_regressors_make_the_torque(case):
    """dp/dt - dL/dq = tau, p = M dq."""
    robot = case.robot
    values = np.array(list(case.values.values()))
    moving = build(robot, case.q + 1j * STEP * case.dq, case.dq + 1j * STEP * case.ddq, case.ddq)
    momentum = stack(case, regressors.compute_momentum_columns(moving, case.keys)).astype(complex)
    recursion = build(robot, case.q, case.dq, case.ddq)
    lagrange = stack(case, regressors.compute_lagrange_columns(recursion, case.keys))
    assert_close(momentum.imag @ values / STEP - lagrange @ values, find_torques(case))
    mass = find_mass(case, recursion).astype(float)
    assert_close(momentum.real @ values, mass @ case.dq)
    beta = group(case)
    functions = call(robot, "momentum_regressor", "lagrange_regressor")
    assert_close(np.array(functions["momentum_regressor"](case.q, case.dq)) @ beta, mass @ case.dq)
    assert_close(np.array(functions["lagrange_regressor"](case.q, case.dq)) @ beta, lagrange @ values)


@over_cases(20)
def test_forward_dynamics_undoes_inverse_dynamics(case):
    robot = case.robot
    beta = group(case)
    forward = call(robot, "forward_dynamics")["forward_dynamics"]
    assert_close(forward(case.q, case.dq, find_torques(case), beta), case.ddq, 1e-7)


FRICTIONAL = trees(
    most=3,
    angles=st.sampled_from([0.0, np.pi / 2, -np.pi / 2]),
    rotors=True,
    friction=True,
    followers=True,
    couplings=True,
    springs=True,
)


@settings(max_examples=25, deadline=None)
@given(robot=FRICTIONAL, seed=SEEDS)
def test_friction_and_inertial_functions_make_up_all_torques(robot, seed):
    """Offsets may stand in a group of weights: the sum of both is what must be right."""
    case, base = draw_case(robot, seed), derive_base_parameters(robot)
    oracle = regress(robot, case.q, case.dq, case.ddq)
    rng = np.random.default_rng(seed)
    values = {label: case.values.get(label, rng.uniform(-2, 2)) for label in base.labels}
    expected = sum((value * oracle[label] for label, value in values.items()), np.zeros(robot.freedom))
    beta, f = (
        np.array([sum(float(c) * values[label] for label, c in p.terms) for p in group])
        for group in (base.parameters, base.friction)
    )
    names = ("inverse_dynamics", "friction", "friction_regressor")
    functions = call(robot, *(names if base.friction else names[:1]))
    torque = np.array(functions["inverse_dynamics"](case.q, case.dq, case.ddq, beta)).ravel()
    if base.friction:
        torque = torque + np.array(functions["friction"](case.dq, f)).ravel()
        rows = np.array(functions["friction_regressor"](case.dq))
        assert_close(rows, np.array([oracle[p.label] for p in base.friction]).T)
    assert_close(torque, expected)


@over_cases(20)
def test_functions_in_standard_parameters_take_them_one_by_one(case):
    robot = case.robot
    functions = call(robot, "torque_regressor", "inverse_dynamics", "mass_matrix", standard=True)
    oracle = regress(robot, case.q, case.dq, case.ddq, friction=False)
    labels = [p.label for p in build_standard_parameters(robot).parameters]
    assert sorted(labels) == sorted(oracle)
    expected = np.array([oracle[label] for label in labels]).T
    assert_close(functions["torque_regressor"](case.q, case.dq, case.ddq), expected)
    values = np.array([case.values[label] for label in labels])
    assert_close(functions["inverse_dynamics"](case.q, case.dq, case.ddq, values), expected @ values)


@over_cases(15)
def test_derivatives_of_the_torques_are_those_by_complex_step(case):
    robot = case.robot
    (derive,) = call(robot, "inverse_dynamics_derivatives").values()
    found = derive(case.q, case.dq, case.ddq, group(case))
    for k, matrix in enumerate(found):
        columns = []
        for unit in 1j * STEP * np.eye(robot.freedom):
            state = [values + (unit if k == j else 0) for j, values in enumerate((case.q, case.dq, case.ddq))]
            recursion = build(robot, *state)
            columns.append(find_inverse(robot, recursion, case.values).astype(complex).imag / STEP)
        assert_close(matrix, np.array(columns).T)


@over_cases(20)
def test_kinematics_are_pinocchios(case):
    robot = case.robot
    functions = call(robot, "forward_kinematics", "jacobian")
    rotations, origins = (np.array(value) for value in functions["forward_kinematics"](case.q))
    model = build_pinocchio(robot)
    data = model.createData()
    joints = spread(robot, case.q)
    pin.forwardKinematics(model, data, joints)
    for link, frame in enumerate(data.oMi[1:]):
        assert_close(rotations[link].reshape(3, 3), frame.rotation)
        assert_close(origins[link], frame.translation)
    # Pinocchio gives a vector for a single joint.
    jacobian = pin.computeJointJacobian(model, data, joints, robot.size).reshape(6, robot.size)
    turn = data.oMi[robot.size].rotation
    world = np.vstack([turn @ jacobian[:3], turn @ jacobian[3:]])
    assert_close(functions["jacobian"](case.q), fold(robot, world.T).T)


def test_a_machine_of_parallel_slides_has_all_functions():
    """Hardly anything in its functions is a variable: the smallest programs there are."""
    for rows in ([(0.0, 0, "q", 0.0)] * 2, [(0.0, 0, 0, "q")] * 2):
        robot = build_chain(rows)
        case = draw_case(robot, 1)
        functions = call(robot)
        torque = functions["inverse_dynamics"](case.q, case.dq, case.ddq, group(case))
        assert_close(torque, find_torques(case))
        assert_close(functions["coriolis_matrix"](case.q, case.dq, group(case)), np.zeros((2, 2)))
