"""Base sets of robots with followers, coupled drives, springs: ranks found without the recursion of base.py.

Numeric: regressors made of Pinocchio's columns, folded, and of drive, spring and friction columns written by
hand (`tests.chains.regress`). Exact: the coefficients of the energy regressor.
"""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from sympy import QQ, Matrix

from symid.dynamics import compute_friction_columns
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.exact_algebra import reduce_rows
from symid.dynamics.recursion import build_recursion
from symid.dynamics.regressors import compute_torque_columns, derive_energy
from symid.joint_models import FrictionValues, list_value_names
from symid.joint_models.carriers import build_numpy_carrier
from symid.notation import INERTIAL
from symid.robot.description import Coupling, Drive, JointKind, Spring
from symid.robot.geometry import ONE, ZERO, Exact
from tests.chains import (
    PANDA,
    PI,
    PLAIN_LAWS,
    PUMA560,
    RATIONAL_ANGLES,
    RATIONAL_LENGTHS,
    RIGHT_ANGLES,
    STANFORD,
    TWO_LINK,
    build_chain,
    change_joints,
    each_robot,
    follow,
    regress,
    trees,
)
from tests.float_algebra import FloatAlgebra, build_float_state
from tests.friction_forms import EVERY_LAW, give_shape

SAMPLES = 60


def stack_regressor(robot, labels, seed, form="torque"):
    """Return the regressor of a form at random states, one row a coordinate and state."""
    rng = np.random.default_rng(seed)
    zero = np.zeros(robot.freedom)
    if form == "momentum":
        robot = dataclasses.replace(robot, gravity=(ZERO, ZERO, ZERO))
    rows = []
    for _ in range(SAMPLES):
        q, dq, ddq = rng.uniform(-2, 2, (3, robot.freedom))
        if form == "torque":
            columns = regress(robot, q, dq, ddq)
        elif form == "gravity":
            columns = regress(robot, q, zero, zero, friction=False)
        else:
            # Without gravity and velocity the torque of ddq is M ddq: put dq in its place. No springs.
            columns = regress(robot, q, zero, dq, friction=False)
            columns |= {label: zero for label in columns if label[1] in ("KS", "KR")}
        assert set(columns) == set(labels)
        rows.append(np.stack([columns[label] for label in labels], axis=1))
    return np.vstack(rows)


def compute_rank(matrix):
    """Return the rank, its columns scaled, after checking that there is a gap in the singular values."""
    sizes = np.linalg.norm(matrix, axis=0)
    # A column that is nothing but rounding must not be blown up.
    shown = sizes > 1e-12 * sizes.max(initial=0.0)
    if not np.any(shown):
        return 0
    values = np.linalg.svd(matrix[:, shown] / sizes[shown], compute_uv=False)
    rank = int(np.sum(values > 1e-10 * max(values[0], 1.0)))
    if 0 < rank < len(values):
        assert values[rank] < 1e-3 * values[rank - 1]
    return rank


def build_matrix(robot, base, labels):
    """Return K in numbers, friction included."""
    lengths = dict(robot.symbols)
    matrix = np.zeros((base.count + len(base.friction), len(labels)))
    for row, parameter in enumerate((*base.parameters, *base.friction)):
        for label, value in parameter.terms:
            matrix[row, labels.index(label)] = float(value.subs(lengths))
    return matrix


def assert_base_set(robot, form="torque", seed=1):
    """The count is the rank, and every column of the regressor is made of the base columns by K."""
    base = derive_base_parameters(robot, form=form)
    labels = list(base.labels)
    regressor = stack_regressor(robot, labels, seed, form)
    assert base.count + len(base.friction) == compute_rank(regressor)
    heads = [labels.index(p.label) for p in (*base.parameters, *base.friction)]
    error = regressor[:, heads] @ build_matrix(robot, base, labels) - regressor
    assert np.abs(error).max(initial=0.0) < 1e-9 * max(1.0, np.abs(regressor).max(initial=0.0))
    eliminated = {entry.label for entry in base.eliminated}
    assert eliminated | {labels[k] for k in heads} == set(labels)
    assert all(entry.reason for entry in base.eliminated)


EVERYTHING = {"rotors": True, "friction": True, "followers": True, "couplings": True, "springs": True}


@settings(max_examples=30, deadline=None)
@given(robot=trees(most=4, angles=RIGHT_ANGLES, **EVERYTHING))
def test_base_set_of_random_trees_with_everything(robot):
    assert_base_set(robot)


@settings(max_examples=15, deadline=None)
@given(robot=trees(most=3, angles=RATIONAL_ANGLES, lengths=RATIONAL_LENGTHS, followers=True, springs=True))
def test_base_set_of_random_trees_of_rational_geometry(robot):
    assert_base_set(robot)


@pytest.mark.parametrize("form", ["torque", "gravity", "momentum"])
@settings(max_examples=15, deadline=None)
@given(robot=trees(most=3, **EVERYTHING))
def test_base_sets_of_all_forms_on_random_trees(form, robot):
    assert_base_set(robot, form)


@pytest.mark.parametrize("form", ["gravity", "momentum"])
@each_robot(TWO_LINK, PUMA560, PANDA, STANFORD)
def test_base_sets_of_gravity_and_momentum(robot, form):
    assert_base_set(change_joints(robot, drive=Drive(has_rotor=True)), form)


def test_sets_of_the_planar_arm():
    """g1 = g ((MX1 + L M2) c1 - ... + MX2 c12 ...): four parameters; no inertia shows at rest.

    M(q) = [ZZR1 + ZZ2 + 2 L (c2 MX2 - s2 MY2), ...]: MX1 and MY1 are the weight's alone.
    """
    sets = {form: derive_base_parameters(TWO_LINK, form=form).parameters for form in ("gravity", "momentum")}
    assert [p.expression for p in sets["gravity"]] == ["MX1 + 0.5*M2", "MY1", "MX2", "MY2"]
    assert [p.name for p in sets["gravity"]] == ["MXR1", "MY1", "MX2", "MY2"]
    assert [p.expression for p in sets["momentum"]] == ["ZZ1 + 0.25*M2", "ZZ2", "MX2", "MY2"]
    with pytest.raises(ValueError, match="'speed'; allowed are torque, energy, momentum, gravity"):
        derive_base_parameters(TWO_LINK, form="speed")


@pytest.mark.parametrize("multiplier", ["-1", "2", "1/2", "-3/4"])
def test_a_follower_of_each_multiplier_in_an_arm(multiplier):
    for pair in ((4, 1), (1, 4), (2, 1), (3, 2)):
        assert_base_set(follow(STANFORD, *pair, multiplier))


def test_a_parallelogram_keeps_its_third_link_upright():
    """q3 = -q2: link 3 only translates, so that of its inertia nothing shows but mass and first moments."""
    arm = build_chain([(0.0, 0, 0, "q"), (PI / 2, 0, 0, "q"), (0.0, 0.4, 0, "q")], name="parallelogram")
    robot = follow(arm, 2, 1, "-1")
    assert_base_set(robot)
    base = derive_base_parameters(robot)
    heads = {p.label for p in base.parameters}
    assert not {(2, "XX"), (2, "XY"), (2, "ZZ"), (2, "XZ")} & heads


def couple(robot, *terms, rotor=True, friction="none", name="m"):
    terms = tuple((index, Fraction(factor)) for index, factor in terms)
    friction = FrictionValues(law=friction)
    coupling = Coupling(name=name, terms=terms, has_rotor=rotor, friction=friction)
    return dataclasses.replace(robot, couplings=(*robot.couplings, coupling))


def test_a_coupled_wrist_adds_one_rotor_and_its_friction():
    """As in a Staubli TX40: the drive of joint 6 turns with joints 5 and 6."""
    kind = "coulomb-viscous"
    arm = change_joints(PUMA560, drive=Drive(has_rotor=True), friction=FrictionValues(law=kind))
    wrist = couple(arm, (4, 1), (5, 1), friction=kind)
    assert_base_set(wrist)
    alone, coupled = derive_base_parameters(arm), derive_base_parameters(wrist)
    assert coupled.count == alone.count + 1
    assert len(coupled.friction) == len(alone.friction) + 2
    assert "IAm" in {p.name for p in coupled.parameters}


def test_a_coupling_to_one_joint_is_its_own_rotor():
    assert_base_set(couple(TWO_LINK, (1, 3)))
    arm = build_chain([(0.0, 0, 0, "q"), (0.0, 0.5, 0, "q")], rotors=True)
    assert_base_set(couple(arm, (1, 3)))
    assert derive_base_parameters(couple(arm, (1, 3))).count == derive_base_parameters(arm).count


@pytest.mark.parametrize("kind", PLAIN_LAWS)
def test_friction_of_followers_and_couplings(kind):
    """A follower's friction adds to that of its master; a negative multiplier turns it round."""
    arm = build_chain([(0.0, 0, 0, "q"), (PI / 2, 0.3, 0, "q"), (0.0, 0.4, "q", 0.0)], friction=kind)
    for multiplier in ("2", "-1"):
        robot = follow(arm, 2, 1, multiplier)
        assert_base_set(robot)
        assert_base_set(couple(robot, (0, 1), (1, "-1/2"), rotor=False, friction=kind))
        assert_base_set(couple(robot, (1, 1), (2, "1/2"), rotor=False, friction=kind))


@pytest.mark.parametrize("law", ["position-torque", "position-dependent"])
@pytest.mark.parametrize("waves", ["1", "1,2,3", "2x0.5", "2,5x0.25", "1x1.5", "3x100"])
@pytest.mark.parametrize("multiplier", ["2", "-1", "1/2"])
def test_waves_next_to_weights(law, waves, multiplier):
    """A torque cos q is like that of a first moment, where a weight turns with q; so are those of sums."""
    kind = f"{law}-{waves}"
    arm = build_chain([(PI / 2, 0, 0, "q"), (0.0, 0.3, 0, "q"), (0.0, 0.4, "q", 0.0)], friction=kind)
    assert_base_set(arm)
    upright = build_chain([(0.0, 0, 0, "q"), (PI / 2, 0.3, 0, "q"), (0.3, 0.3, 0, "q")], friction=kind)
    for form in ("torque", "gravity", "momentum"):
        assert_base_set(follow(upright, 2, 1, multiplier), form)
    assert_base_set(follow(arm, 1, 0, multiplier))
    assert_base_set(follow(arm, 2, 0, multiplier))
    planar = couple(arm, (0, 1), (1, multiplier), rotor=False, friction=kind)
    assert_base_set(planar)
    assert_base_set(couple(planar, (0, 1), (1, 1), rotor=False, friction=kind, name="other"))


@pytest.mark.parametrize("kind", PLAIN_LAWS)
def test_springs_next_to_weights_and_offsets(kind):
    """On a slope a slide feels weight, offset and the spring's own constant as one force."""
    for rows in (*([(angle, 0, "q", 0.0)] for angle in (PI / 4, 0.0, PI / 2)), [(0.3, 0.2, 0, "q")]):
        for rotors in (False, True):
            assert_base_set(change_joints(build_chain(rows, rotors=rotors, friction=kind), spring=Spring()))


TWISTS = [(PI / 4, PI / 4), (PI / 6, PI / 3), (PI / 3, PI / 6), (PI / 4, -PI / 4), (PI / 6, -PI / 6)]


@pytest.mark.parametrize("twists", TWISTS, ids=lambda t: f"{t[0]:.2f} {t[1]:.2f}")
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_twists_that_add_up_to_a_right_angle_or_none(twists, kind):
    middle = (twists[0], 0.2, 0.1, "q") if kind == "revolute" else (twists[0], 0.2, "q", 0.0)
    rows = [(0.0, 0, 0, "q"), middle, (twists[1], 0.1, 0, "q"), (0.0, 0.3, 0, "q")]
    assert_base_set(build_chain(rows, name="twisted"))


def test_a_joint_that_stands_at_45_degrees_hides_nothing():
    """Its twist of 45 degrees and one of 90 give the same count: neither axis is parallel to the other."""
    for twist in (PI / 4, PI / 2):
        rows = [(0.0, 0, 0, "q"), (twist, 0, 0, "q"), (twist, 0, 0, "q")]
        assert derive_base_parameters(build_chain(rows)).count == 15


def find_exact_rank(robot):
    """Rank of the exact energy regressor's coefficient matrix; a constant potential is no information."""
    energy = derive_energy(robot)
    constant = (0,) * len(energy.algebra.ring.gens)
    # T and V are separate functions: a monomial of T holds velocities, one of V does not.
    rows = [
        {
            monomial: value
            for polynomial in (energy.kinetic[key], energy.potential[key])
            for monomial, value in polynomial.items()
            if monomial != constant
        }
        for key in energy.kinetic
    ]
    names = {monomial: k for k, monomial in enumerate({monomial for row in rows for monomial in row})}
    return len(reduce_rows([{names[monomial]: value for monomial, value in row.items()} for row in rows]))


@settings(max_examples=25, deadline=None)
@given(
    robot=trees(most=4, angles=RIGHT_ANGLES, **EVERYTHING | {"friction": False, "followers": False}).filter(
        lambda robot: robot.size > 1
    )
)
def test_count_is_the_exact_rank_of_the_energy(robot):
    rank = find_exact_rank(robot)
    assert derive_base_parameters(robot).count == rank
    assert derive_base_parameters(robot, form="energy").count == rank


@settings(max_examples=10, deadline=None)
@given(robot=trees(most=3, angles=RATIONAL_ANGLES, lengths=RATIONAL_LENGTHS, rotors=True))
def test_count_is_the_exact_rank_of_the_energy_in_rational_geometry(robot):
    assert derive_base_parameters(robot).count == find_exact_rank(robot)


@each_robot(PUMA560, PANDA, STANFORD)
def test_count_of_an_arm_is_the_exact_rank_of_the_energy(robot):
    assert derive_base_parameters(robot).count == find_exact_rank(robot)


def test_prismatic_joints_follow_revolute_ones_and_the_other_way():
    for kinds in ("rp", "pr", "pp", "rr"):
        rows = [(0.0, 0, "q", 0.0) if kind == "p" else (0.0, 0.1, 0, "q") for kind in kinds]
        chain = build_chain([(PI / 2, *rows[0][1:]), (PI / 2, *rows[1][1:])])
        assert [joint.kind is JointKind.PRISMATIC for joint in chain.joints] == [k == "p" for k in kinds]
        assert_base_set(follow(chain, 1, 0, "-3/4"))


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


@pytest.mark.parametrize("name", EVERY_LAW)
@pytest.mark.parametrize("row", [(0.0, 0, "q", 0.0), (PI / 2, 0, 0, "q")], ids=["slide", "pendulum"])
def test_every_law_at_a_joint_that_feels_its_weight(name, row):
    friction = FrictionValues(law=name, shape=give_shape(name, 10.0))
    assert_sampled_rank(change_joints(build_chain([row], rotors=True), friction=friction), 2)


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
