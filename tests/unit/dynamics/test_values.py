"""Values of base parameters from values of links."""

import dataclasses

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.dynamics.base_parameters import compute_parameter_values, derive_base_parameters
from symid.errors import RobotError, UsageError
from symid.joint_models import FrictionValues
from symid.robot.description import Drive
from tests.chains import TWO_LINK, build_chain, draw_parameters
from tests.refusals import raises


def with_values(robot, parameters, **fields):
    joints = tuple(
        dataclasses.replace(joint, inertial=tuple(row), **fields)
        for joint, row in zip(robot.joints, parameters, strict=True)
    )
    return dataclasses.replace(robot, joints=joints)


def test_values_follow_the_grouping():
    parameters = draw_parameters(np.random.default_rng(0), 2)
    robot = with_values(TWO_LINK, parameters)
    values = compute_parameter_values(robot, derive_base_parameters(robot))
    assert values["ZZR1"] == pytest.approx(parameters[0, 5] + 0.25 * parameters[1, 9], rel=1e-15)
    assert values["MXR1"] == pytest.approx(parameters[0, 6] + 0.5 * parameters[1, 9], rel=1e-15)
    assert len(values) == 6


def test_drive_and_friction_values():
    parameters = draw_parameters(np.random.default_rng(0), 2)
    robot = with_values(
        TWO_LINK,
        parameters,
        drive=Drive(has_rotor=True, rotor_inertia=0.2),
        friction=FrictionValues(law="coulomb-viscous", values=(0.3, 0.4)),
    )
    values = compute_parameter_values(robot, derive_base_parameters(robot))
    assert values["ZZR1"] == pytest.approx(parameters[0, 5] + 0.25 * parameters[1, 9] + 0.2, rel=1e-15)
    assert (values["IA2"], values["Fv1"], values["Fc2"]) == (0.2, 0.3, 0.4)


def test_unknown_members_leave_the_group_unknown():
    parameters = draw_parameters(np.random.default_rng(0), 2)
    robot = with_values(TWO_LINK, parameters)
    robot = dataclasses.replace(robot, joints=(robot.joints[0], TWO_LINK.joints[1]))
    # ZZR1 and MXR1 hold M2, which is not known; MY1 is its own.
    assert set(compute_parameter_values(robot, derive_base_parameters(robot))) == {"MY1"}


def test_symbolic_lengths_take_their_values():
    arm = build_chain([(0.0, 0, 0, "q"), (0.0, "L1", 0, "q")], gravity=("0", "-9.81", "0"))
    arm = dataclasses.replace(arm, symbols=(("L1", 0.5),))
    parameters = draw_parameters(np.random.default_rng(0), 2)
    symbolic, numeric = with_values(arm, parameters), with_values(TWO_LINK, parameters)
    assert compute_parameter_values(symbolic, derive_base_parameters(symbolic)) == pytest.approx(
        compute_parameter_values(numeric, derive_base_parameters(numeric)), rel=1e-15
    )
    q, dq, ddq = np.random.default_rng(1).uniform(-2, 2, (3, 2))
    first, second = (
        build_functions(robot, names=("torque_regressor",)).functions[0] for robot in (arm, TWO_LINK)
    )
    np.testing.assert_allclose(first(q, dq, ddq), second(q, dq, ddq), rtol=1e-15)


def test_code_needs_values_of_symbols():
    arm = build_chain([(0.0, 0, 0, "q"), (0.0, "L1", 0, "q")])
    with raises(RobotError, "robot.symbol-without-value", match="value for the symbolic length L1"):
        build_functions(arm)


def test_unknown_function_names_the_catalogue():
    with raises(UsageError, "usage.unknown-function", match="inverse_dynamics"):
        build_functions(TWO_LINK, names=("inverse_dynamic",))
