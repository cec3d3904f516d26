"""Friction parameters as multiples of w, |w|, sign(w) and one."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from symid.dynamics import compute_friction_columns, get_friction
from symid.dynamics.friction_effects import (
    build_friction_rows,
    compute_position_torques,
    list_friction_parameters,
)
from symid.joint_models import FRICTION_LAWS, FrictionValues, get_law, list_value_names
from symid.joint_models.carriers import build_float_carrier
from symid.robot.description import Coupling, Mimic
from tests.chains import PLAIN_LAWS, build_chain
from tests.friction_forms import EVERY_LAW, give_shape

KINDS = [name for name in PLAIN_LAWS if name != "none"]
# Of the velocity alone: those of several joints can be no others.
CURVED = [
    FrictionValues(law=name, shape=give_shape(name, 10.0 + 0.3 * k))
    for k, name in enumerate(EVERY_LAW)
    if get_law(name).own and get_law(name).inputs == ("velocity",)
]
CATALOGUE = [friction for friction in CURVED if friction.law in FRICTION_LAWS]
ROW = (0.3, 0.1, 0.2, "q")


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
    robot = build_chain([ROW] * 3)
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
        *(
            (one, other, multiplier)
            for one in CATALOGUE
            for other in (*CATALOGUE, FrictionValues(law="asymmetric"))
            if one is not other
            for multiplier in (1, Fraction(-1, 2))
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
        robot = build_chain([ROW])
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
