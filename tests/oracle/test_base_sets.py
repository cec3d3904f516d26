"""Base sets of robots with followers, coupled drives, springs: ranks found without the recursion of base.py.

Numeric: regressors made of Pinocchio's columns, folded, and of drive, spring and friction columns written by
hand (`tests.chains.regress`). Exact: the coefficients of the energy regressor.
"""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from sympy import GF, QQ, Matrix
from sympy.polys.matrices import DomainMatrix

from symid.dynamics import compute_friction_columns
from symid.dynamics.algebra import FloatAlgebra
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.exact_algebra import reduce_rows
from symid.dynamics.lagrange import derive_energy
from symid.dynamics.recursion import build_recursion
from symid.dynamics.regressors import compute_torque_columns
from symid.joint_models import FrictionValues, list_value_names
from symid.joint_models.carriers import build_numpy_carrier
from symid.notation import INERTIAL
from symid.robot.description import Coupling, Drive, Spring
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
from tests.float_algebra import build_float_state
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


@settings(max_examples=15, deadline=None)
@given(robot=trees(most=3, angles=RATIONAL_ANGLES, lengths=RATIONAL_LENGTHS, followers=True, springs=True))
def test_base_set_of_random_trees_of_rational_geometry(robot):
    assert_base_set(robot)


@pytest.mark.parametrize("form", ["torque", "gravity", "momentum"])
@settings(max_examples=15, deadline=None)
@given(robot=trees(most=3, **EVERYTHING))
def test_base_sets_of_all_forms_on_random_trees(form, robot):
    assert_base_set(robot, form)


@pytest.mark.parametrize("form", ["torque", "gravity", "momentum"])
@each_robot(TWO_LINK, PUMA560, PANDA, STANFORD)
def test_base_sets_of_arms(robot, form):
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


def draw_point(robot, field, rng):
    """Return random values of the generators, sines and cosines of followers in their true relation.

    Multipliers k/4 make cos and sin of k (q/4) rational in the tangent of q/8; q itself is independent.
    """

    def draw():
        return field(int(rng.integers(1, 1 << 60)))

    values, drawn = {}, [(draw(), draw()) for _ in robot.joints]
    for k, joint in enumerate(robot.joints, start=1):
        master, factor = (joint.mimic.master, joint.mimic.multiplier) if joint.mimic else (k - 1, Fraction(1))
        tangent, position = drawn[master]
        cosine, sine, square = field(1), field(0), 1 + tangent**2
        for _ in range(int(abs(4 * factor))):
            turned = (1 - tangent**2) * cosine - 2 * tangent * sine
            cosine, sine = turned / square, ((1 - tangent**2) * sine + 2 * tangent * cosine) / square
        position = position * field(factor.numerator) / field(factor.denominator)
        values |= {f"c{k}": cosine, f"s{k}": sine if factor > 0 else -sine, f"q{k}": position}
        values |= {f"dq{k}": draw(), f"ddq{k}": draw()}
    return values


def find_exact_rank(robot):
    """Rank of T and of V - V(0) at random points of a large prime field; a constant is no information."""
    energy, field, rng = derive_energy(robot), GF(2**61 - 1), np.random.default_rng(1)
    names = [str(symbol) for symbol in energy.algebra.ring.symbols]
    ring, parts = energy.algebra.ring.clone(domain=field), []
    for part in (energy.kinetic, energy.potential):
        terms = [{m: field(c.numerator) / field(c.denominator) for m, c in p.items()} for p in part.values()]
        parts.append([ring.from_dict(entry) for entry in terms])
    rows = []
    for _ in range(len(parts[0]) + 4):
        values = draw_point(robot, field, rng)
        point = [(ring(symbol), values[name]) for symbol, name in zip(ring.gens, names, strict=True)]
        rows.append([[field.convert(p.evaluate(point)) if p else field(0) for p in part] for part in parts])
    still = rows[0][1]
    matrix = [kinetic for kinetic, _ in rows]
    matrix += [[a - b for a, b in zip(potential, still, strict=True)] for _, potential in rows]
    return DomainMatrix(matrix, (len(matrix), len(parts[0])), field).rank()


@settings(max_examples=25, deadline=None)
@given(
    robot=trees(most=4, angles=RIGHT_ANGLES, **EVERYTHING | {"friction": False}).filter(
        lambda robot: robot.size > 1
    )
)
def test_count_is_the_exact_rank_of_the_energy(robot):
    rank = find_exact_rank(robot)
    assert derive_base_parameters(robot).count == rank
    assert derive_base_parameters(robot, form="energy").count == rank


@settings(max_examples=10, deadline=None)
@given(robot=trees(most=3, angles=RATIONAL_ANGLES, lengths=RATIONAL_LENGTHS, rotors=True, followers=True))
def test_count_is_the_exact_rank_of_the_energy_in_rational_geometry(robot):
    assert derive_base_parameters(robot).count == find_exact_rank(robot)


@each_robot(PUMA560, PANDA, STANFORD, follow(STANFORD, 5, 4, "1/2"))
def test_count_of_an_arm_is_the_exact_rank_of_the_energy(robot):
    assert derive_base_parameters(robot).count == find_exact_rank(robot)


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
