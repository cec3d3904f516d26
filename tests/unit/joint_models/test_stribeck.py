"""Stribeck friction: one definition, several carriers, its derivatives against SymPy's own."""

import math

import casadi
import numpy as np
import pytest
import sympy

from symid.joint_models.carriers import (
    build_casadi_carrier,
    build_float_carrier,
    build_numpy_carrier,
    build_symbol_carrier,
)
from symid.joint_models.friction_columns import compute_stribeck_derivatives

FLOATS, ARRAYS = build_float_carrier(), build_numpy_carrier()
SYMBOLS, GRAPHS = build_symbol_carrier(), build_casadi_carrier()

VELOCITIES = np.array([-2.0, -0.3, -0.05, 0.0, 0.02, 0.1, 0.7])


def compute_shape(carrier, velocity, speed, smoothing=0.0):
    return compute_stribeck_derivatives(carrier, velocity, speed, smoothing)[0]


def compute_friction(carrier, velocity, excess, speed, smoothing=0.0):
    return carrier.mul(excess, compute_shape(carrier, velocity, speed, smoothing))


@pytest.mark.parametrize("smoothing", [0.0, 0.01])
def test_all_carriers_agree(smoothing):
    array = compute_friction(ARRAYS, VELOCITIES, 0.8, 0.15, smoothing)
    single = [compute_friction(FLOATS, float(v), 0.8, 0.15, smoothing) for v in VELOCITIES]
    np.testing.assert_allclose(array, single, rtol=1e-14)
    v = sympy.Symbol("v")
    expression = compute_friction(SYMBOLS, v, sympy.Float(0.8), sympy.Float(0.15), smoothing)
    np.testing.assert_allclose(
        array, [float(expression.subs(v, float(value))) for value in VELOCITIES], rtol=1e-12, atol=1e-300
    )
    u = casadi.SX.sym("u")
    function = casadi.Function("f", [u], [compute_friction(GRAPHS, u, 0.8, 0.15, smoothing)])
    np.testing.assert_allclose(array, [float(function(value)) for value in VELOCITIES], rtol=1e-12)


def test_it_starts_at_the_excess_falls_to_a_part_e_at_the_stribeck_velocity_and_is_odd():
    assert compute_friction(FLOATS, 1e-12, 0.8, 0.2) == pytest.approx(0.8)
    assert compute_friction(FLOATS, 0.2, 0.8, 0.2) == pytest.approx(0.8 / math.e)
    assert compute_friction(FLOATS, 2.0, 0.8, 0.2) < 1e-40
    assert compute_friction(FLOATS, 0.0, 0.8, 0.2) == 0.0
    np.testing.assert_array_equal(
        compute_shape(ARRAYS, -VELOCITIES, 0.2), -compute_shape(ARRAYS, VELOCITIES, 0.2)
    )


@pytest.mark.parametrize("smoothing", [0.0, 0.05])
def test_rates_are_the_derivatives_by_the_stribeck_velocity(smoothing):
    v, speed = sympy.symbols("v v_s", positive=True)
    shape = compute_shape(SYMBOLS, v, speed, smoothing)
    for order, rate in enumerate(compute_stribeck_derivatives(SYMBOLS, v, speed, smoothing)):
        difference = sympy.diff(shape, speed, order) - rate
        for value, at in ((0.1, 0.2), (0.5, 0.3), (1.3, 2.0)):
            assert abs(float(difference.subs({v: value, speed: at}))) < 1e-12
