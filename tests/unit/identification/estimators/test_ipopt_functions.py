"""A NumPy cost behind CasADi's interface: same numbers, and CasADi is loaded only when it is used."""

import subprocess
import sys

import numpy as np

from symid.ipopt import build_ipopt_functions

MATRIX = np.array([[2.0, 0.3, -0.1], [0.3, 1.0, 0.2], [-0.1, 0.2, 3.0]])


def test_value_gradient_and_upper_triangle():
    functions = build_ipopt_functions(
        3, lambda x: float(x @ MATRIX @ x) / 2.0, lambda x: MATRIX @ x, lambda _x: MATRIX
    )
    x = np.array([1.0, -2.0, 0.5])
    assert float(functions.value(x)) == float(x @ MATRIX @ x) / 2.0
    value, gradient = functions.gradient(x, [])
    assert float(value) == float(x @ MATRIX @ x) / 2.0
    np.testing.assert_array_equal(np.asarray(gradient).ravel(), MATRIX @ x)
    hessian = functions.hessian(x, [], 2.0, [])
    np.testing.assert_array_equal(np.asarray(hessian), 2.0 * np.triu(MATRIX))
    assert functions.hessian.name_out() == ["triu_hess_gamma_x_x"]


def test_casadi_and_sympy_are_not_loaded_before_they_are_needed():
    code = (
        "import sys, symid.identification.elastic.nlp\n"
        "import symid.identification.hysteresis.prandtl_ishlinskii_fit\n"
        "sys.exit(any(name in sys.modules for name in ('casadi', 'sympy')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
