"""Quotients and roots of exact numbers."""

from fractions import Fraction

import pytest
from hypothesis import given, strategies as st

from symid.robot.geometry import ONE, ZERO, Exact, compute_square_root, invert_exact

RATIONALS = st.fractions(min_value=-100, max_value=100, max_denominator=10**9)
NUMBERS = st.builds(Exact.surd, RATIONALS, RATIONALS, RATIONALS, RATIONALS)


@given(NUMBERS.filter(bool))
def test_a_number_times_its_inverse_is_one(value):
    assert value * invert_exact(value) == ONE


@given(NUMBERS)
def test_the_root_of_a_square_is_the_number(value):
    root = compute_square_root(value * value)
    assert root in {value, -value}
    assert root.to_float() >= -1e-9


@pytest.mark.parametrize(
    ("value", "root"),
    [
        (Exact.of("0.5"), "1/2*sqrt(2)"),
        (Exact.of("1/12"), "1/6*sqrt(3)"),
        (Exact.surd(Fraction(1, 2), 0, Fraction(-1, 4)), "-1/4*sqrt(2)+1/4*sqrt(6)"),
        (Exact.of("0.3"), "None"),
        (Exact.of("-1"), "None"),
        (Exact.surd(Fraction(0), 1), "None"),
        (Exact.surd(Fraction(3), 2, 1), "None"),
        (ZERO, "0"),
    ],
)
def test_roots_in_the_field_and_outside(value, root):
    assert str(compute_square_root(value)) == root
