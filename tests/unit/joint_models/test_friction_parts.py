"""Friction parameters as multiples of w, |w|, sign(w) and one."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from symid.joint_models.carriers import build_float_carrier
from symid.joint_models.friction_models import (
    FRICTION_MODELS,
    build_friction_rows,
    compute_constant_torques,
    compute_friction_columns,
    get_friction,
    list_friction_parameters,
)
from symid.robot.description import Coupling, CurvedFriction, FrictionKind, FrictionValues, Mimic
from tests.chains import build_chain

SHAPES = {
    CurvedFriction.STRIBECK: (0.4, 1.5),
    CurvedFriction.STRIBECK_OFFSET: (0.7, 2.0),
    CurvedFriction.IMPROVED_STRIBECK: (0.5, 0.3, 2.0),
    CurvedFriction.ASYMMETRIC_STRIBECK: (0.4, 1.0),
    CurvedFriction.CUBIC: (),
    CurvedFriction.STRIBECK_CUBIC: (0.5, 2.0),
    CurvedFriction.POWER_LAW: (0.6,),
    CurvedFriction.MAKKAR: (5.0, 0.8, 3.0),
}
KINDS = [kind for kind in FrictionKind if kind is not FrictionKind.NONE]
CURVED = [FrictionValues(kind=kind, shape=shape) for kind, shape in SHAPES.items()]
ROW = (0.3, 0.1, 0.2, "q")


def compute_rank(robot):
    """Rank of the sampled friction regressor, built from the models and the transmission by hand."""
    rng, blocks = np.random.default_rng(3), []
    labels = list_friction_parameters(robot)
    for dq in rng.uniform(-2, 2, (60, robot.freedom)):
        block = np.zeros((robot.freedom, len(labels)))
        for k, (index, name) in enumerate(labels):
            model = FRICTION_MODELS[get_friction(robot, index).kind]
            row = robot.transmission[index]
            speed = sum(float(factor) * dq[position] for position, factor in row)
            columns = compute_friction_columns(get_friction(robot, index), build_float_carrier(), speed)
            entry = columns[model.parameters.index(name)]
            for position, factor in row:
                block[position, k] += float(factor) * entry
        blocks.append(block)
    return np.linalg.matrix_rank(np.concatenate(blocks), tol=1e-9)


def rank_of_rows(robot):
    labels = list_friction_parameters(robot)
    rows = [[float(row.get(label, 0)) for label in labels] for row in build_friction_rows(robot)]
    # The constant function, at every coordinate, is what `build_friction_rows` leaves to the weights.
    for position in range(robot.freedom):
        shares = [dict(robot.transmission[index]).get(position, 0) for index, _ in labels]
        torques = compute_constant_torques(robot)
        pairs = zip(shares, labels, strict=True)
        rows.append([float(share * torques.get(label, 0)) for share, label in pairs])
    return np.linalg.matrix_rank(np.array(rows), tol=1e-9)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.value)
@pytest.mark.parametrize("other", KINDS, ids=lambda kind: kind.value)
@pytest.mark.parametrize("multiplier", [Fraction(2), Fraction(-1, 2)], ids=str)
def test_followers_and_couplings_show_what_samples_show(kind, other, multiplier):
    robot = build_chain([ROW] * 3, friction=kind)
    joints = list(robot.joints)
    joints[2] = replace(
        joints[2], mimic=Mimic(master=0, multiplier=multiplier), friction=FrictionValues(kind=other)
    )
    coupling = Coupling(
        name="m", terms=((0, Fraction(1)), (1, Fraction(1))), friction=FrictionValues(kind=other)
    )
    robot = replace(robot, joints=tuple(joints), couplings=(coupling,))
    assert rank_of_rows(robot) == compute_rank(robot)


@pytest.mark.parametrize("friction", CURVED, ids=lambda friction: friction.kind.value)
@pytest.mark.parametrize(
    "other", [*CURVED, FrictionValues(kind=FrictionKind.ASYMMETRIC)], ids=lambda f: f.kind.value
)
@pytest.mark.parametrize("multiplier", [Fraction(1), Fraction(-1, 2)], ids=str)
def test_curved_friction_shows_what_samples_show(friction, other, multiplier):
    robot = build_chain([ROW] * 3)
    joints = [replace(joint, friction=friction) for joint in robot.joints]
    joints[2] = replace(joints[2], mimic=Mimic(master=0, multiplier=multiplier), friction=other)
    coupling = Coupling(name="m", terms=((0, Fraction(1)), (1, Fraction(1))), friction=other)
    robot = replace(robot, joints=tuple(joints), couplings=(coupling,))
    assert rank_of_rows(robot) == compute_rank(robot)


def test_constant_torques():
    robot = build_chain([ROW], friction=FrictionKind.ASYMMETRIC)
    half = Fraction(1, 2)
    assert compute_constant_torques(robot) == {(0, "Fcp"): half, (0, "Fcn"): -half}
    robot = build_chain([ROW], friction=FrictionKind.VISCOUS_COULOMB_OFFSET)
    assert compute_constant_torques(robot) == {(0, "offset"): 1}
    joint = replace(robot.joints[0], friction=CURVED[2])
    assert compute_constant_torques(replace(robot, joints=(joint,))) == {(0, "Fp"): 1}
