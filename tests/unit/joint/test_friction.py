"""Friction columns against their closed forms."""

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.joint.friction import FRICTION_MODELS
from symid.notation import find_unit
from symid.robot.description import FrictionKind
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
    assert set(FRICTION_MODELS) == set(FrictionKind)
    for model in FRICTION_MODELS.values():
        for name in model.parameters:
            assert find_unit(name)
            assert find_unit(name, prismatic=True) != find_unit(name)
