"""Friction columns against their closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.joint_models.friction_models import FRICTION_MODELS
from symid.notation import get_unit
from symid.robot.description import CurvedFriction, FrictionKind, FrictionValues
from symid.robot.toml_drives import FRICTION_PARAMETERS, FRICTION_SHAPES
from tests.chains import build_chain

VELOCITIES = (-2.0, -0.1, 0.0, 0.3, 1.5)


def closed_form(kind, v, x):
    sign = float(np.sign(v))
    match kind:
        case FrictionKind.VISCOUS_COULOMB:
            return x[0] * v + x[1] * sign
        case FrictionKind.VISCOUS_COULOMB_OFFSET:
            return x[0] * v + x[1] * sign + x[2]
        case FrictionKind.ASYMMETRIC:
            return x[0] * v + x[1] if v > 0 else x[2] * v - x[3] if v < 0 else 0.0


@pytest.mark.parametrize("kind", [kind for kind in FrictionKind if kind is not FrictionKind.NONE])
@pytest.mark.parametrize("velocity", VELOCITIES)
def test_friction_functions_equal_the_closed_form(kind, velocity):
    robot = build_chain([(0.0, 0, 0, "q")], friction=kind)
    friction, regressor = build_functions(robot, names=("friction", "friction_regressor")).functions
    values = np.arange(1.0, 1 + len(FRICTION_MODELS[kind].parameters))
    expected = closed_form(kind, velocity, values)
    assert float(friction(velocity, values)) == pytest.approx(expected, abs=1e-15)
    assert float(regressor(velocity) @ values) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("kind", [kind for kind in FrictionKind if kind is not FrictionKind.NONE])
def test_friction_opposes_motion(kind):
    """With positive coefficients and no offset, power is never negative: friction cannot drive."""
    robot = build_chain([(0.0, 0, 0, "q")], friction=kind)
    (friction,) = build_functions(robot, names=("friction",)).functions
    names = FRICTION_MODELS[kind].parameters
    values = np.array([0.0 if name == "offset" else 1.5 for name in names])
    for velocity in VELOCITIES:
        power = float(friction(velocity, values)) * velocity
        assert power >= 0.0


def test_every_kind_has_a_model_whose_parameters_have_units():
    assert set(FRICTION_MODELS) == {*FrictionKind, *CurvedFriction}
    for model in FRICTION_MODELS.values():
        for name in model.parameters:
            assert get_unit(name)
            assert get_unit(name, prismatic=True) != get_unit(name)


CURVES = {
    CurvedFriction.STRIBECK: (
        (0.3, 1.7),
        lambda v, x: x[0] * v + (x[1] + x[2] * np.exp(-(abs(v / 0.3) ** 1.7))) * np.sign(v),
    ),
    CurvedFriction.STRIBECK_OFFSET: (
        (0.3, 2.0),
        lambda v, x: x[0] * v + (x[1] + x[2] * np.exp(-((v / 0.3) ** 2))) * np.sign(v) + x[3],
    ),
    CurvedFriction.IMPROVED_STRIBECK: (
        (0.3, 0.2, 2.0),
        lambda v, x: (
            x[0] * v
            + (x[1] + x[2] * np.exp(-((max(abs(v), 0.2) / 0.3) ** 2))) * max(-1.0, min(1.0, v / 0.2))
            + x[3]
        ),
    ),
    CurvedFriction.ASYMMETRIC_STRIBECK: (
        (0.3, 1.0),
        lambda v, x: (
            (x[0] * v + x[1] if v > 0 else x[2] * v - x[3] if v < 0 else 0.0)
            + x[4] * np.exp(-abs(v) / 0.3) * np.sign(v)
        ),
    ),
    CurvedFriction.CUBIC: (
        (),
        lambda v, x: x[0] * v + x[1] * np.sign(v) + x[2] * abs(v) * v + x[3] * v**3,
    ),
    CurvedFriction.STRIBECK_CUBIC: (
        (0.3, 2.0),
        lambda v, x: (
            x[0] * v
            + (x[1] + x[2] * np.exp(-((v / 0.3) ** 2))) * np.sign(v)
            + x[3] * abs(v) * v
            + x[4] * v**3
        ),
    ),
    CurvedFriction.POWER_LAW: ((0.6,), lambda v, x: (x[0] + x[1] * abs(v) ** 0.6) * np.sign(v)),
    CurvedFriction.MAKKAR: (
        (9.0, 2.0, 7.0),
        lambda v, x: x[0] * (np.tanh(9 * v) - np.tanh(2 * v)) + x[1] * np.tanh(7 * v) + x[2] * v,
    ),
}


@pytest.mark.parametrize("kind", list(CurvedFriction), ids=lambda kind: kind.value)
def test_functions_of_curved_friction_equal_the_closed_form(kind):
    shape, curve = CURVES[kind]
    robot = build_chain([(0.0, 0, 0, "q")])
    joint = replace(robot.joints[0], friction=FrictionValues(kind=kind, shape=shape))
    built = build_functions(replace(robot, joints=(joint,)), names=("friction", "friction_regressor"))
    friction, regressor = built.functions
    values = np.arange(1.0, 1 + len(FRICTION_MODELS[kind].parameters))
    for velocity in (*VELOCITIES, 0.15, -0.21):
        expected = curve(velocity, values)
        assert float(friction(velocity, values)) == pytest.approx(expected, rel=1e-14, abs=1e-15)
        assert float(regressor(velocity) @ values) == pytest.approx(expected, rel=1e-14, abs=1e-15)
    assert [parameter.name for parameter in built.card.friction] == [
        f"{name}1" for name in FRICTION_MODELS[kind].parameters
    ]


def test_no_two_models_have_the_same_parameters():
    """Stored estimates of elastic joints tell the model by the names of its parameters."""
    listed = [model.parameters for model in FRICTION_MODELS.values()]
    assert len(set(listed)) == len(listed)


def test_reader_and_models_name_the_same_values():
    assert {kind: model.parameters for kind, model in FRICTION_MODELS.items()} == FRICTION_PARAMETERS
    for kind, model in FRICTION_MODELS.items():
        assert tuple(key.name for key in FRICTION_SHAPES.get(kind, ())) == model.shape
        assert set(model.own) <= set(model.parameters)


def test_shape_values_are_part_of_the_model():
    robot = build_chain([(0.0, 0, 0, "q")])
    signatures = set()
    for shape in ((0.3, 2.0), (0.3, 1.5), (0.2, 2.0)):
        friction = FrictionValues(kind=CurvedFriction.STRIBECK, shape=shape)
        changed = replace(robot, joints=(replace(robot.joints[0], friction=friction),))
        signatures.add(build_functions(changed, names=("friction",)).card.signature)
    assert len(signatures) == 3
