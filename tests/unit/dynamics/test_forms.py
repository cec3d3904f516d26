"""Base parameters from values of links: numbers, and formulas in the symbols of the file."""

import dataclasses

import numpy as np
import pytest
import sympy
from hypothesis import given, settings, strategies as st

from symid.codegen.casadi_functions import build_functions
from symid.dynamics.base_parameters import (
    compute_parameter_values,
    derive_base_parameters,
    derive_parameter_formulas,
)
from symid.errors import RobotError
from symid.robot.toml_reader import parse_robot, read_robot
from tests.chains import TWO_LINK, build_chain, draw_parameters
from tests.refusals import raises


def test_the_textbook_arm_has_the_textbook_groups(robots_folder):
    robot = read_robot(robots_folder / "two_link_symbols.toml")
    m1, m2, L1, lc1, lc2, I1, I2 = sympy.symbols("m1 m2 L1 lc1 lc2 I1 I2")
    assert derive_parameter_formulas(robot, derive_base_parameters(robot)) == {
        "ZZR1": I1 + m1 * lc1**2 + m2 * L1**2,
        "MXR1": m1 * lc1 + m2 * L1,
        "ZZ2": I2 + m2 * lc2**2,
        "MX2": m2 * lc2,
    }


HEAD = (
    'convention = "{}"\ngravity = [0, "-g", 0]\n'
    "[symbols]\ng = 9.81\nL1 = 0.5\nm1 = 3\nm2 = 2\nx = 0.25\nI = 0.1\n"
)
JOINTS = """
[[joint]]
kind = "revolute"
alpha = "{}"
a = "L1"
d = 0.1
[joint.link]
mass = "2*m1"
com = ["x", "-1/2*x", 0.1]
inertia = {{ xx = "I", yy = "I", zz = "3/2*I", xy = 0.01 }}
[joint.drive]
rotor_inertia = 0.02
rotor_inertia_side = "joint"
[joint.friction]
model = "coulomb-viscous"
Fv = 1.5
Fc = 2
[[joint]]
kind = "{}"
alpha = "{}"
a = "L1"
theta = "pi/4"
link = {{ mass = "m2", com = [0, "x", 0], inertia = {{ xx = "I", yy = "I", zz = "I" }} }}
"""
ANGLES = st.sampled_from(["0 deg", "pi/2", "pi/6", "-3*pi/4", "2*atan(1/3)"])


@settings(max_examples=25)
@given(st.sampled_from(["modified", "standard"]), ANGLES, st.sampled_from(["revolute", "prismatic"]), ANGLES)
def test_formulas_give_the_numbers(convention, first, kind, second):
    """With the symbols' values put in, every formula is the number found in floating point."""
    robot = parse_robot(HEAD.format(convention) + JOINTS.format(first, kind, second))
    base = derive_base_parameters(robot)
    forms, values = derive_parameter_formulas(robot, base), compute_parameter_values(robot, base)
    assert forms
    numbers = {sympy.Symbol(name): value for name, value in robot.symbols}
    for name, form in forms.items():
        assert float(form.subs(numbers)) == pytest.approx(values[name], rel=1e-12, abs=1e-13)
    # What has no formula holds no symbol.
    assert {"Fv1", "Fc1"} <= set(values) - set(forms)


def test_numbers_and_symbols_meet_in_one_group():
    text = HEAD.format("modified") + (
        '[[joint]]\nkind = "revolute"\ndrive = { rotor_inertia = 0.02, rotor_inertia_side = "joint" }\n'
        "link = { mass = 1.5, com = [0.1, 0, 0], inertia = { yy = 0.03, zz = 0.03 } }\n"
        '[[joint]]\nkind = "revolute"\na = "L1"\nlink = { mass = "m2", com = ["x", 0, 0] }\n'
    )
    robot = parse_robot(text)
    forms = derive_parameter_formulas(robot, derive_base_parameters(robot))
    m2, L1 = sympy.symbols("m2 L1")
    # 0.03 + 1.5 * 0.1^2 + 0.02 of the file's decimals.
    assert forms["ZZR1"] == sympy.Rational(65, 1000) + m2 * L1**2
    assert forms["MXR1"] == sympy.Rational(15, 100) + m2 * L1


def test_a_robot_of_numbers_has_no_formulas(robots_folder):
    robot = read_robot(robots_folder / "two_link.toml")
    assert derive_parameter_formulas(robot, derive_base_parameters(robot)) == {}


def test_springs_and_couplings_have_values():
    text = (
        'convention = "modified"\ngravity = [0, -9.81, 0]\n'
        '[[joint]]\nname = "a"\nkind = "revolute"\nspring = { stiffness = 120, rest = 0.5 }\n'
        '[[joint]]\nname = "b"\nkind = "revolute"\na = 0.5\nspring = { stiffness = 60, rest = "unknown" }\n'
        '[[coupling]]\nname = "m"\nterms = { a = 1, b = 1 }\nrotor_inertia = 0.02\n'
        'friction = { model = "coulomb-viscous", Fv = 0.5, Fc = 1.25 }\n'
    )
    robot = parse_robot(text)
    base = derive_base_parameters(robot)
    values = compute_parameter_values(robot, base)
    # The rotor belongs to ZZR2, of which the link's part is not known.
    assert "ZZ2 + IAm" in {parameter.expression for parameter in base.parameters}
    known = {name: value for name, value in values.items() if name.startswith(("IA", "K", "F"))}
    assert known == pytest.approx({"KS1": 120.0, "KR1": -60.0, "KS2": 60.0, "Fvm": 0.5, "Fcm": 1.25})
    assert np.isfinite(list(known.values())).all()


def with_values(robot, parameters, **fields):
    joints = tuple(
        dataclasses.replace(joint, inertial=tuple(row), **fields)
        for joint, row in zip(robot.joints, parameters, strict=True)
    )
    return dataclasses.replace(robot, joints=joints)


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


def test_code_needs_values_of_symbols():
    arm = build_chain([(0.0, 0, 0, "q"), (0.0, "L1", 0, "q")])
    with raises(RobotError, "robot.symbol-without-value", match="value for the symbolic length L1"):
        build_functions(arm)
