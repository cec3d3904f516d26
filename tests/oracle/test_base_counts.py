"""Base parameters: known counts, and two independent ways to find the rank."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from sympy import QQ, Matrix

from symid.dynamics import compute_friction_columns
from symid.dynamics.algebra import FloatAlgebra
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.exact_algebra import reduce_rows
from symid.dynamics.recursion import build_recursion
from symid.dynamics.regressors import compute_torque_columns, derive_energy
from symid.joint_models import FrictionValues, list_value_names
from symid.joint_models.carriers import build_numpy_carrier
from symid.notation import INERTIAL
from symid.robot.geometry import ONE, ZERO, Exact
from tests.chains import (
    PANDA,
    PI,
    PLAIN_LAWS,
    PUMA560,
    RIGHT_ANGLES,
    STANFORD,
    TWO_LINK,
    build_chain,
    build_pinocchio,
    draw_parameters,
    each_robot,
    order_regressor,
    trees,
)
from tests.float_algebra import build_float_state
from tests.friction_forms import EVERY_LAW, give_shape

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

SCARA = build_chain(
    [(0.0, 0, 0, "q"), (0.0, 0.35, 0, "q"), (0.0, 0.3, 0, "q"), (0.0, 0, "q", 0.0)], name="scara"
)
PPR = build_chain([(0.0, 0, "q", 0.0), (-PI / 2, 0, "q", -PI / 2), (-PI / 2, 0, 0, "q")], name="ppr")
RRP = build_chain([(0.0, 0, 0, "q"), (PI / 6, 0.2, 0.1, "q"), (PI / 3, 0.1, "q", 0.0)], name="rrp")
KNOWN = [(TWO_LINK, 6), (PUMA560, 36), (PANDA, 43), (STANFORD, 33), (SCARA, 8), (PPR, 5), (RRP, 12)]


def find_energy_rank(robot):
    """Rank of the exact energy regressor's coefficient matrix; a constant potential is no information."""
    energy = derive_energy(robot)
    monomials = {}
    rows = []
    constant = (0,) * len(energy.algebra.ring.gens)
    for key in energy.kinetic:
        row = {}
        # T and V are separate functions: a monomial of T holds velocities, one of V does not.
        for polynomial in (energy.kinetic[key], energy.potential[key]):
            for monomial, value in polynomial.items():
                if monomial != constant:
                    row[monomials.setdefault(monomial, len(monomials))] = value
        rows.append(row)
    return len(reduce_rows(rows))


@pytest.mark.parametrize(("robot", "count"), KNOWN, ids=lambda value: getattr(value, "name", str(value)))
def test_known_counts_are_the_rank_of_the_exact_energy_regressor(robot, count):
    assert derive_base_parameters(robot).count == find_energy_rank(robot) == count


@settings(max_examples=25, deadline=None)
@given(robot=trees(most=4, rotors=True))
def test_count_equals_the_exact_rank_on_random_trees(robot):
    assert derive_base_parameters(robot).count == find_energy_rank(robot)


def assert_sampled_rank(robot, seed):
    """The count is the rank of all parameters' torques, friction included, at random states."""
    base = derive_base_parameters(robot)
    rng = np.random.default_rng(seed)
    states, others = rng.uniform(-2, 2, (3, robot.size, 80)), rng.uniform(20, 50, (2, robot.size, 80))
    given = dict(zip(("position", "velocity", "load", "temperature"), (*states[:2], *others), strict=True))
    algebra = FloatAlgebra()
    inertial = [label for label in base.labels if label[1] in (*INERTIAL, "IA")]
    columns = compute_torque_columns(build_recursion(robot, algebra, build_float_state(*states)), inertial)
    for joint, name in base.labels:
        if (joint, name) not in columns:
            friction = robot.joints[joint].friction
            inputs = {name: values[joint] for name, values in given.items()}
            entries = compute_friction_columns(friction, build_numpy_carrier(), inputs)
            column = entries[list_value_names(friction).index(name)]
            columns[joint, name] = [column if k == joint else 0.0 for k in range(robot.size)]
    stacked = [np.concatenate([np.broadcast_to(e, 80) for e in columns[label]]) for label in base.labels]
    values = np.linalg.svd(np.array(stacked), compute_uv=False)
    assert base.count + len(base.friction) == int(np.sum(values > 1e-9 * values[0]))
    return base


@settings(max_examples=25, deadline=None)
@given(robot=trees(most=3, rotors=True, friction=True, angles=RIGHT_ANGLES))
def test_drives_and_friction_count_right_on_random_trees(robot):
    assert_sampled_rank(robot, 1)


@pytest.mark.parametrize("kind", PLAIN_LAWS)
@pytest.mark.parametrize("rotors", [False, True])
def test_friction_of_a_vertical_slide(kind, rotors):
    base = assert_sampled_rank(build_chain([(0.0, 0, "q", 0.0)], rotors=rotors, friction=kind), 2)
    if rotors and kind == "coulomb-viscous-offset":
        # Force M (ddq + g) + IA ddq + offset + Fv dq + Fc sign dq: ddq, 1, dq, sign dq are all there is.
        assert base.count + len(base.friction) == 4
        assert "offset1" in {parameter.name for parameter in base.eliminated}


@pytest.mark.parametrize("name", EVERY_LAW)
@pytest.mark.parametrize("row", [(0.0, 0, "q", 0.0), (PI / 2, 0, 0, "q")], ids=["slide", "pendulum"])
def test_every_law_at_a_joint_that_feels_its_weight(name, row):
    chain = build_chain([row], rotors=True)
    friction = FrictionValues(law=name, shape=give_shape(name, 10.0))
    joint = dataclasses.replace(chain.joints[0], friction=friction)
    assert_sampled_rank(dataclasses.replace(chain, joints=(joint,)), 2)


@settings(max_examples=25, deadline=None)
@given(robot=trees(most=3, rotors=True, symbols=True))
def test_symbolic_lengths_count_like_generic_numbers(robot):
    def replace_symbol(value):
        return sum(
            (
                Exact.surd(*surd) * (Exact.of(f"0.{ord(name[0])}{name[1:]}7") if name else ONE)
                for name, surd in value.terms
            ),
            ZERO,
        )

    joints = []
    for joint in robot.joints:
        translation = tuple(map(replace_symbol, joint.placement.translation))
        place = dataclasses.replace(joint.placement, translation=translation)
        joints.append(dataclasses.replace(joint, placement=place))
    numeric = dataclasses.replace(robot, joints=tuple(joints))
    symbols, numbers = (derive_base_parameters(each).parameters for each in (robot, numeric))
    assert [p.label for p in symbols] == [p.label for p in numbers]


def sample_regressor(robot, samples, seed):
    rng = np.random.default_rng(seed)
    model = build_pinocchio(robot, draw_parameters(rng, robot.size))
    data = model.createData()
    blocks = []
    for _ in range(samples):
        q, dq, ddq = rng.uniform(-3, 3, (3, robot.size))
        blocks.append(order_regressor(pin.computeJointTorqueRegressor(model, data, q, dq, ddq)))
    return np.vstack(blocks)


@each_robot(TWO_LINK, PUMA560, PANDA, STANFORD, RRP)
def test_grouping_reproduces_every_column_of_pinocchio(robot):
    """Y pi = Y[:, representatives] K pi for all pi: the grouping matrix is right, entry by entry."""
    base = derive_base_parameters(robot)
    column = {label: k for k, label in enumerate(base.labels)}
    grouping = np.zeros((base.count, len(base.labels)))
    for row, parameter in enumerate(base.parameters):
        for label, value in parameter.terms:
            grouping[row, column[label]] = float(value)
    regressor = sample_regressor(robot, 20, 4)
    kept = regressor[:, [column[key] for key in base.keys]]
    np.testing.assert_allclose(kept @ grouping, regressor, rtol=0, atol=1e-11 * np.abs(regressor).max())


def test_drives_and_friction_belong_to_the_set():
    """A WAM-like arm: 43 link parameters, 69 of 98 with IA, Fv, Fc and offset per joint."""
    rows = [(0, 0), (0, 0), (0, 0.55), (0.045, 0), (-0.045, 0.3), (0, 0), (0, 0.06)]
    twists = [0.0, -PI / 2, PI / 2, -PI / 2, PI / 2, -PI / 2, PI / 2]
    arm = [(twist, *row, "q") for twist, row in zip(twists, rows, strict=True)]
    base = derive_base_parameters(build_chain(arm, rotors=True, friction="coulomb-viscous-offset"))
    assert len(base.labels) == 98
    assert base.count + len(base.friction) == 69


def test_elimination_equals_sympy_rref():
    rows = [[1, 2, 0, 3], [2, 4, 1, 1], [3, 6, 1, 4], [0, 0, 2, -10]]
    reduced, pivots = Matrix(rows).rref()
    ours = reduce_rows([{k: QQ(v) for k, v in enumerate(row) if v} for row in rows])
    assert tuple(map(min, ours)) == pivots
    expected = [[reduced[r, c] for c in range(4)] for r in range(len(pivots))]
    assert [[row.get(c, 0) for c in range(4)] for row in ours] == expected
