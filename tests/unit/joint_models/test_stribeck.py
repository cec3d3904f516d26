"""Stribeck friction: one definition, several carriers, its derivatives against SymPy's own."""

import math

import casadi
import numpy as np
import pytest
import sympy

from symid.joint_models.friction_columns import (
    STRIBECK_PARAMETERS,
    StribeckCarrier,
    compute_stribeck_derivatives,
    compute_stribeck_friction,
    compute_stribeck_shape,
)

FLOATS = StribeckCarrier(exp=math.exp, sign=lambda v: math.copysign(1.0, v) if v else 0.0, tanh=math.tanh)
ARRAYS = StribeckCarrier(exp=np.exp, sign=np.sign, tanh=np.tanh)
SYMBOLS = StribeckCarrier(exp=sympy.exp, sign=sympy.sign, tanh=sympy.tanh)
GRAPHS = StribeckCarrier(exp=casadi.exp, sign=casadi.sign, tanh=casadi.tanh)

VELOCITIES = np.array([-2.0, -0.3, -0.05, 0.0, 0.02, 0.1, 0.7])


@pytest.mark.parametrize("smoothing", [0.0, 0.01])
def test_all_carriers_agree(smoothing):
    array = compute_stribeck_friction(ARRAYS, VELOCITIES, 0.8, 0.15, smoothing)
    single = [compute_stribeck_friction(FLOATS, float(v), 0.8, 0.15, smoothing) for v in VELOCITIES]
    np.testing.assert_allclose(array, single, rtol=1e-14)
    v = sympy.Symbol("v")
    expression = compute_stribeck_friction(SYMBOLS, v, sympy.Float(0.8), sympy.Float(0.15), smoothing)
    np.testing.assert_allclose(
        array, [float(expression.subs(v, float(value))) for value in VELOCITIES], rtol=1e-12, atol=1e-300
    )
    u = casadi.SX.sym("u")
    function = casadi.Function("f", [u], [compute_stribeck_friction(GRAPHS, u, 0.8, 0.15, smoothing)])
    np.testing.assert_allclose(array, [float(function(value)) for value in VELOCITIES], rtol=1e-12)


def test_it_starts_at_the_excess_falls_to_a_part_e_at_the_stribeck_velocity_and_is_odd():
    assert compute_stribeck_friction(FLOATS, 1e-12, 0.8, 0.2) == pytest.approx(0.8)
    assert compute_stribeck_friction(FLOATS, 0.2, 0.8, 0.2) == pytest.approx(0.8 / math.e)
    assert compute_stribeck_friction(FLOATS, 2.0, 0.8, 0.2) < 1e-40
    assert compute_stribeck_friction(FLOATS, 0.0, 0.8, 0.2) == 0.0
    np.testing.assert_array_equal(
        compute_stribeck_shape(ARRAYS, -VELOCITIES, 0.2), -compute_stribeck_shape(ARRAYS, VELOCITIES, 0.2)
    )


@pytest.mark.parametrize("smoothing", [0.0, 0.05])
def test_rates_are_the_derivatives_by_the_stribeck_velocity(smoothing):
    v, speed = sympy.symbols("v v_s", positive=True)
    shape = compute_stribeck_shape(SYMBOLS, v, speed, smoothing)
    for order, rate in enumerate(compute_stribeck_derivatives(SYMBOLS, v, speed, smoothing)):
        difference = sympy.diff(shape, speed, order) - rate
        for value, at in ((0.1, 0.2), (0.5, 0.3), (1.3, 2.0)):
            assert abs(float(difference.subs({v: value, speed: at}))) < 1e-12


def test_its_parameters_have_units_and_bounds():
    names = [(p.name, p.unit, p.unit_prismatic, p.lower, p.lower_is_allowed) for p in STRIBECK_PARAMETERS]
    assert names == [("Fs", "N m", "N", 0.0, True), ("vs", "rad/s", "m/s", 0.0, False)]
    assert all(p.meaning and p.latex for p in STRIBECK_PARAMETERS)
