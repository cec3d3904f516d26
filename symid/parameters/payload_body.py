"""A body as mass, centre of mass and inertia about it, with derivatives with respect to standard parameters.

Input: XX XY XZ YY YZ ZZ MX MY MZ M about the origin of a frame. Output: m, c, J along the same axes:

    c = s / m,   J = I - (s.s 1 - s s') / m,   s = m c the first moments.

Supported: masses that are not zero. A ball of water is the yardstick of how large a body of some mass may be.
"""

import math

import numpy as np

from symid.arrays import FloatArray

__all__ = ["QUANTITIES", "find_ball", "find_quantities", "find_quantity_rates"]

QUANTITIES = ("mass", "cx", "cy", "cz", "Jxx", "Jxy", "Jxz", "Jyy", "Jyz", "Jzz")
"""Mass (kg), centre of mass (m), inertia about it (kg m^2)."""

_PAIRS = tuple(zip(*np.triu_indices(3), strict=True))
_DENSITY = 1000.0


def find_ball(mass: float) -> tuple[float, float]:
    """Return radius (m) and moment of inertia (kg m^2) of a ball of water of a mass (kg)."""
    radius = (3.0 * abs(mass) / (4.0 * math.pi * _DENSITY)) ** (1.0 / 3.0)
    return radius, 0.4 * abs(mass) * radius**2


def find_quantities(parameters: FloatArray) -> FloatArray:
    """Return the ten `QUANTITIES` of standard parameters (10,)."""
    tensor, s, mass = parameters[:6], parameters[6:9], parameters[9]
    shift = [(float(i == j) * (s @ s) - s[i] * s[j]) / mass for i, j in _PAIRS]
    return np.array([mass, *(s / mass), *(tensor - np.array(shift))], dtype=np.float64)


def find_quantity_rates(parameters: FloatArray) -> FloatArray:
    """Return the derivatives (10, 10) of `QUANTITIES` with respect to standard parameters."""
    s, mass = parameters[6:9], float(parameters[9])
    rates = np.zeros((10, 10))
    rates[0, 9] = 1.0
    for axis in range(3):
        rates[1 + axis, 6 + axis] = 1.0 / mass
        rates[1 + axis, 9] = -s[axis] / mass**2
    for row, (i, j) in enumerate(_PAIRS):
        same = float(i == j)
        rates[4 + row, row] = 1.0
        for axis in range(3):
            change = 2.0 * s[axis] * same - s[j] * float(i == axis) - s[i] * float(j == axis)
            rates[4 + row, 6 + axis] = -change / mass
        rates[4 + row, 9] = ((s @ s) * same - s[i] * s[j]) / mass**2
    return rates
