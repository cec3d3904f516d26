"""Exact functions of the catalogue: what is refused, and how."""

import pytest

import symid
from tests.refusals import raises


def test_several_outputs_are_taken_by_name():
    energy = symid.load("two_link").sympy("energy")
    with raises(symid.UsageError, "usage.several-outputs"):
        _ = energy.expr
    assert {str(symbol) for symbol in energy["V"].atoms() if symbol.is_Symbol} <= {
        *("q1", "q2"),
        *("ZZR1", "MXR1", "MY1", "ZZ2", "MX2", "MY2"),
    }


def test_formulas_too_long_to_read_are_not_printed():
    dynamics = symid.load("panda").sympy("forward_dynamics")
    with raises(symid.UsageError, "usage.too-long"):
        dynamics.latex()
    assert dynamics._repr_latex_() is None


def test_an_unknown_function_gets_the_nearest_name():
    robot = symid.load("two_link")
    with pytest.raises(symid.UsageError, match="mass_matrix"):
        robot.sympy("mass_matrx")
    with pytest.raises(symid.UsageError, match="mass_matrix"):
        robot.casadi("mass_matrx")
