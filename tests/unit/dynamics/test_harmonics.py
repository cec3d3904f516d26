"""Polynomials of joints that share a coordinate, written in independent functions."""

from fractions import Fraction

import numpy as np
import pytest
from sympy import QQ

from symid.dynamics.exact_algebra import (
    build_basis,
    build_exact_algebra,
    build_power_function,
    split_polynomial,
)
from tests.chains import build_chain, follow

MULTIPLIERS = [Fraction(-1), Fraction(2), Fraction(1, 2), Fraction(-3, 4), Fraction(1)]


def build(multiplier, *, sliding=False):
    row = (0.0, 0, "q", 0.0) if sliding else (0.0, 0.3, 0, "q")
    robot = build_chain([(0.0, 0, 0, "q"), row, (0.4, 0.1, 0, "q")])
    return follow(robot, 1, 0, multiplier)


def evaluate(function, multiplier, q):
    """Return the value of a function of the basis; the first coordinate is shared, the second is not."""
    ((frequency, odd, power), (a, b, _)), _ = function
    angle = frequency * q[0] / multiplier.denominator
    return q[0] ** power * (np.sin(angle) if odd else np.cos(angle)) * np.sin(q[1]) ** a * np.cos(q[1]) ** b


@pytest.mark.parametrize("multiplier", MULTIPLIERS, ids=str)
def test_the_sum_of_functions_is_the_polynomial(multiplier):
    robot = build(multiplier)
    algebra = build_exact_algebra(robot)
    s1, c1, s2, c2, s3, c3 = algebra.ring.gens[:6]
    polynomial = 3 * s1 * s2 - c1**2 * c2 * s3 + 2 * c1 * c2**2 + s1 * c2 * c3**2 - 5
    found = split_polynomial(build_basis(robot, algebra, QQ), polynomial)
    for q in np.random.default_rng(1).uniform(-3, 3, (5, 2)):
        angles = [q[0], float(multiplier) * q[0], q[1]]
        values = [f(angle) for angle in angles for f in (np.sin, np.cos)]
        values += [0.0] * (len(algebra.ring.gens) - len(values))
        expected = float(polynomial.evaluate(list(zip(algebra.ring.gens, values, strict=True))))
        total = sum(float(value) * evaluate(function, multiplier, q) for function, value in found.items())
        assert total == pytest.approx(expected, abs=1e-12)


def test_what_is_the_same_function_is_one_entry():
    robot = build(Fraction(-1))
    algebra = build_exact_algebra(robot)
    s1, c1, s2, c2 = algebra.ring.gens[:4]
    basis = build_basis(robot, algebra, QQ)
    assert split_polynomial(basis, s1 + s2) == {}
    assert split_polynomial(basis, c1 - c2) == {}
    assert split_polynomial(basis, c1 * c2 - s1 * s2) == {build_power_function(basis): 1}


def test_slides_keep_their_powers():
    robot = build(Fraction(-3, 4), sliding=True)
    algebra = build_exact_algebra(robot)
    _, c1, q2 = algebra.ring.gens[:3]
    ((function, value),) = split_polynomial(build_basis(robot, algebra, QQ), c1 * q2**2).items()
    assert function[0][0] == (4, 0, 2), "cos(q) in quarters of the coordinate"
    assert value == QQ(9, 16)
