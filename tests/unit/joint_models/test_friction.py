"""Friction as part of the model: functions against closed forms, what samples show of parameters."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.dynamics import compute_friction_columns, get_friction
from symid.dynamics.base_parameters import build_standard_parameters, derive_base_parameters
from symid.dynamics.friction_effects import (
    build_friction_rows,
    compute_position_torques,
    list_friction_parameters,
)
from symid.errors import UsageError
from symid.joint_models import FRICTION_LAWS, FrictionValues, get_law, list_value_names
from symid.joint_models.carriers import build_float_carrier
from symid.robot.description import Coupling, Mimic
from tests.chains import PLAIN_LAWS, build_chain
from tests.friction_forms import EVERY_LAW, find_linear_torque, give_shape
from tests.refusals import raises

VELOCITIES = (-2.0, -0.21, -0.1, 0.0, 0.15, 0.3, 1.5)
OTHERS = {"position": 0.7, "load": -8.0, "temperature": 31.0}
PORTS = {"position": "q", "load": "load", "temperature": "temperature"}
ROW = (0.0, 0, 0, "q")


def give_friction(robot, *frictions):
    joints = tuple(
        replace(joint, friction=friction) for joint, friction in zip(robot.joints, frictions, strict=True)
    )
    return replace(robot, joints=joints)


@pytest.mark.parametrize("standard", [False, True])
@pytest.mark.parametrize("name", EVERY_LAW)
def test_functions_of_friction_equal_the_closed_form(name, standard):
    given = FrictionValues(law=name, shape=give_shape(name, 7.0))
    robot = give_friction(build_chain([ROW]), given)
    built = build_functions(robot, names=("friction", "friction_regressor"), standard=standard)
    friction, regressor = built.functions
    law = get_law(name)
    others = {key: OTHERS[key] for key in law.inputs[1:]}
    values = np.arange(1.0, 1 + len(law.linear))
    own = dict(zip(list_value_names(given), values, strict=True))
    base = build_standard_parameters(robot) if standard else derive_base_parameters(robot)
    grouped = [sum(float(share) * own[entry] for (_, entry), share in p.terms) for p in base.friction]
    for velocity in VELOCITIES:
        if velocity == 0.0 and len(grouped) < len(values):
            # Parameters are grouped by what they do in motion.
            continue
        expected = find_linear_torque(name, values, given.shape, velocity, **others)
        inputs = (velocity, *others.values())
        assert float(friction(*inputs, grouped)) == pytest.approx(expected, rel=1e-13, abs=1e-14)
        assert float(regressor(*inputs) @ grouped) == pytest.approx(expected, rel=1e-13, abs=1e-14)
        columns = compute_friction_columns(given, build_float_carrier(), {"velocity": velocity, **others})
        assert float(np.dot(columns, values)) == pytest.approx(expected, rel=1e-13, abs=1e-14)
    ports = ["dq", *(PORTS[key] for key in law.inputs[1:])]
    assert [friction.name_in(k) for k in range(friction.n_in())] == [*ports, "f"]
    assert [regressor.name_in(k) for k in range(regressor.n_in())] == ports
    assert built.card.friction_inputs == tuple(ports[1:])
    # An offset beside a constant torque of the law is the same.
    double = ("asymmetric+offset", "improved-stribeck+offset", "asymmetric-stribeck-1+offset")
    if standard or name not in double:
        # The number of a wave or a power is kept apart from that of the joint.
        names = [f"{entry}_1" if entry[-1].isdigit() else f"{entry}1" for entry in own]
        assert [parameter.name for parameter in built.card.friction] == names


def test_functions_have_the_inputs_that_any_joint_reads_in_one_order():
    laws = ("temperature", "coulomb-viscous", "position-torque", "none", "load-dependent")
    robot = give_friction(build_chain([(0.3, 0.1, 0.2, "q")] * 5), *(FrictionValues(law=law) for law in laws))
    built = build_functions(robot, names=("friction", "friction_regressor"))
    friction, regressor = built.functions
    ports = ["dq", "q", "load", "temperature"]
    assert [friction.name_in(k) for k in range(friction.n_in())] == [*ports, "f"]
    assert [regressor.name_in(k) for k in range(regressor.n_in())] == ports
    card = built.card
    assert card.friction_inputs == ("q", "load", "temperature")
    rng = np.random.default_rng(8)
    dq, q, load, temperature = (rng.uniform(-2, 2, 5) for _ in ports)
    values = np.arange(1.0, 1 + len(card.friction))
    inputs = card.gather_friction_inputs(dq, temperature=temperature, load=load, q=q)
    found, rest = np.array(friction(*inputs, values)).ravel(), list(values)
    for k, law in enumerate(laws):
        own = [rest.pop(0) for _ in list_value_names(FrictionValues(law=law))]
        all_given = {"position": q[k], "load": load[k], "temperature": temperature[k]}
        used = {} if law == "none" else {key: all_given[key] for key in get_law(law).inputs[1:]}
        expected = 0.0 if law == "none" else find_linear_torque(law, own, (), dq[k], **used)
        assert found[k] == pytest.approx(expected, rel=1e-13)
    with raises(UsageError, "friction.input", match=r"depends on the load and the temperature of the"):
        card.gather_friction_inputs(dq, q=q)
    velocity_only = build_functions(give_friction(robot, *[FrictionValues(law="cubic")] * 5)).card
    assert velocity_only.friction_inputs == ()
    assert velocity_only.gather_friction_inputs(dq, q=q) == (dq,)


@pytest.mark.parametrize("name", EVERY_LAW)
@pytest.mark.parametrize("prismatic", [False, True])
def test_every_law_has_parameters_with_units(name, prismatic):
    robot = build_chain([(0.0, 0, "q", 0.0) if prismatic else ROW])
    robot = give_friction(robot, FrictionValues(law=name, shape=give_shape(name)))
    cards = build_functions(robot, names=("friction",), standard=True).card.friction
    law = get_law(name)
    units = [entry.unit_prismatic if prismatic else entry.unit for entry in law.linear]
    assert [card.unit for card in cards] == units
    # A factor of the load has none.
    assert all(entry.unit != entry.unit_prismatic for entry in law.linear if entry.unit != "1")


def test_shape_values_are_part_of_the_model():
    signatures = set()
    for law, shape in (
        ("stribeck", (0.3,)),
        ("stribeck", (0.2,)),
        ("stribeck-exponent", (0.3, 1.5)),
        ("stribeck-exponent", (0.3, 1.6)),
        ("stribeck-1.5", (0.3,)),
        ("tustin", (0.3,)),
        ("lorentzian", (0.3,)),
    ):
        changed = give_friction(build_chain([ROW]), FrictionValues(law=law, shape=shape))
        signatures.add(build_functions(changed, names=("friction",)).card.signature)
    assert len(signatures) == 7


KINDS = [name for name in PLAIN_LAWS if name != "none"]
# Of the velocity alone: those of several joints can be no others.
CURVED = [
    FrictionValues(law=name, shape=give_shape(name, 10.0 + 0.3 * k))
    for k, name in enumerate(EVERY_LAW)
    if get_law(name).own and get_law(name).inputs == ("velocity",)
]
CATALOGUE = [friction for friction in CURVED if friction.law in FRICTION_LAWS]
TURNED = (0.3, 0.1, 0.2, "q")


def sample_columns(robot):
    """Return the sampled friction regressor, built from the laws and the transmission by hand."""
    rng, blocks = np.random.default_rng(3), []
    labels = list_friction_parameters(robot)
    # Slow and fast, so that all of a curve is seen.
    for dq in rng.uniform(-2, 2, (120, robot.freedom)) ** 3 / 4.0:
        block = np.zeros((robot.freedom, len(labels)))
        for k, (index, name) in enumerate(labels):
            friction = get_friction(robot, index)
            row = robot.transmission[index]
            speed = sum(float(factor) * dq[position] for position, factor in row)
            columns = compute_friction_columns(friction, build_float_carrier(), {"velocity": speed})
            entry = columns[list_value_names(friction).index(name)]
            for position, factor in row:
                block[position, k] += float(factor) * entry
        blocks.append(block)
    return np.concatenate(blocks)


def list_rows(robot):
    labels = list_friction_parameters(robot)
    rows = [[float(row.get(label, 0)) for label in labels] for row in build_friction_rows(robot)]
    # The constant function, at every coordinate, is what `build_friction_rows` leaves to the weights.
    for position in range(robot.freedom):
        shares = [dict(robot.transmission[index]).get(position, 0) for index, _ in labels]
        torques = compute_position_torques(robot)
        pairs = zip(shares, labels, strict=True)
        rows.append(
            [float(share * torques[label].factor) if label in torques else 0.0 for share, label in pairs]
        )
    return np.array(rows)


def assert_rows_show_what_samples_show(robot):
    """The same parameters are hidden, in the same combinations."""
    sampled, rows = sample_columns(robot), list_rows(robot)
    scale = np.linalg.norm(sampled, axis=0)
    parts = (sampled / scale, rows / scale, np.concatenate([sampled, rows]) / scale)
    ranks = [np.linalg.matrix_rank(part / np.linalg.norm(part), tol=1e-10) for part in parts]
    assert ranks[1:] == ranks[:1] * 2


def build_shared(friction, other, multiplier):
    """Return three joints, the last of which follows the first, and a drive of the first two."""
    robot = build_chain([TURNED] * 3)
    joints = [replace(joint, friction=friction) for joint in robot.joints]
    joints[2] = replace(joints[2], mimic=Mimic(master=0, multiplier=multiplier), friction=other)
    coupling = Coupling(name="m", terms=((0, Fraction(1)), (1, Fraction(1))), friction=other)
    return replace(robot, joints=tuple(joints), couplings=(coupling,))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("other", KINDS)
@pytest.mark.parametrize("multiplier", [Fraction(2), Fraction(-1, 2), Fraction(-1)], ids=str)
def test_followers_and_couplings_show_what_samples_show(kind, other, multiplier):
    robot = build_shared(FrictionValues(law=kind), FrictionValues(law=other), multiplier)
    assert_rows_show_what_samples_show(robot)


@pytest.mark.parametrize(
    ("friction", "other", "multiplier"),
    [
        *((one, one, multiplier) for one in CURVED for multiplier in (1, -1, 2, Fraction(-1, 2))),
        # Every law meets every other, and either multiplier with half of them.
        *(
            (one, other, (1, Fraction(-1, 2))[(row + column) % 2])
            for row, one in enumerate(CATALOGUE)
            for column, other in enumerate((*CATALOGUE, FrictionValues(law="asymmetric")))
            if one is not other
        ),
    ],
    ids=lambda value: getattr(value, "law", str(value)),
)
def test_curves_at_several_drives_show_what_samples_show(friction, other, multiplier):
    assert_rows_show_what_samples_show(build_shared(friction, other, Fraction(multiplier)))


@pytest.mark.parametrize(
    ("law", "other"),
    [
        ("stribeck", "stribeck+cubic"),
        ("stribeck-1.6", "asymmetric-stribeck-1.6"),
        ("tustin", "stribeck-1+cubic"),
        ("stribeck", "improved-stribeck-h3"),
        ("lorentzian", "lorentzian+offset"),
        ("stribeck", "asymmetric-stribeck-both"),
    ],
)
@pytest.mark.parametrize("multiplier", [1, -1], ids=str)
def test_two_laws_with_the_same_fall_share_it(law, other, multiplier):
    laws = [FrictionValues(law=name, shape=give_shape(name, 10.0)) for name in (law, other)]
    assert_rows_show_what_samples_show(build_shared(*laws, Fraction(multiplier)))


def test_constant_torques():
    def find(law, shape=()):
        friction = FrictionValues(law=law, shape=shape)
        robot = build_chain([TURNED])
        joint = replace(robot.joints[0], friction=friction)
        found = compute_position_torques(replace(robot, joints=(joint,)))
        return {name: torque for (_, name), torque in found.items()}

    half = Fraction(1, 2)
    assert find("asymmetric") == {"Fcp": (half, 0, False), "Fcn": (-half, 0, False)}
    assert find("coulomb-viscous-offset") == {"offset": (1, 0, False)}
    for name in ("improved-stribeck", "improved-stribeck-h3"):
        assert find(name, give_shape(name)) == {"Fp": (1, 0, False)}
    # With its origin shifted, viscous friction is not zero at standstill.
    shifted = {"Fv": (Fraction(-1, 4), 0, False), "Fp": (1, 0, False)}
    assert find("improved-stribeck-h4", (0.1, 0.25)) == shifted
    # The bias of this one is gone outside of the zone.
    assert find("improved-stribeck-h2", (0.03, 0.01)) == {}
