"""The Gaussian of Stribeck friction and its derivatives by the Stribeck velocity, against SymPy's own."""

import casadi
import numpy as np
import pytest
import sympy

from symid.joint_models.carriers import build_casadi_carrier, build_numpy_carrier, build_symbol_carrier
from symid.joint_models.friction_columns import compute_stribeck_derivatives

SYMBOLS = build_symbol_carrier()
VELOCITIES = np.array([-2.0, -0.3, -0.05, 0.0, 0.02, 0.1, 0.7])


@pytest.mark.parametrize("smoothing", [0.0, 0.05])
def test_rates_are_the_derivatives_by_the_stribeck_velocity(smoothing):
    v, speed = sympy.symbols("v v_s", positive=True)
    shape, *rates = compute_stribeck_derivatives(SYMBOLS, v, speed, smoothing)
    sign = sympy.tanh(v / smoothing) if smoothing else 1
    for order, rate in enumerate((shape, *rates)):
        difference = sympy.diff(sympy.exp(-((v / speed) ** 2)) * sign, speed, order) - rate
        for value, at in ((0.1, 0.2), (0.5, 0.3), (1.3, 2.0)):
            assert abs(float(difference.subs({v: value, speed: at}))) < 1e-12
    arrays = compute_stribeck_derivatives(build_numpy_carrier(), VELOCITIES, 0.15, smoothing)
    u = casadi.SX.sym("u")
    graph = compute_stribeck_derivatives(build_casadi_carrier(), u, 0.15, smoothing)
    function = casadi.Function("f", [u], [casadi.horzcat(*graph)])
    found = np.array([function(value).full().ravel() for value in VELOCITIES]).T
    np.testing.assert_allclose(arrays, found, rtol=1e-12, atol=1e-300)
