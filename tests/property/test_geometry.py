"""Exact numbers and placements: axioms, and agreement with floating point."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from symid.robot import geometry
from tests.chains import to_matrix

SMALL = st.fractions(min_value=-3, max_value=3, max_denominator=20)
NUMBERS = st.builds(geometry.Exact.surd, SMALL, SMALL, SMALL, SMALL)
NAMES = st.sampled_from(["L1", "L2", "D3"])
FORMS = st.lists(st.tuples(NUMBERS, NAMES), max_size=3).map(
    lambda parts: sum((factor * geometry.Exact.symbol(name) for factor, name in parts), geometry.ZERO)
)
VALUES = {"L1": 0.7, "L2": -1.3, "D3": 0.21}


@given(a=NUMBERS, b=NUMBERS, c=NUMBERS)
def test_numbers_form_a_commutative_ring(a, b, c):
    assert a + b == b + a
    assert a * b == b * a
    assert (a + b) + c == a + (b + c)
    assert (a * b) * c == a * (b * c)
    assert a * (b + c) == a * b + a * c
    assert a - a == geometry.ZERO
    assert a * geometry.ONE == a
    assert not a * geometry.ZERO


@given(a=NUMBERS, b=NUMBERS, f=FORMS, g=FORMS)
def test_exact_arithmetic_is_float_arithmetic(a, b, f, g):
    assert (a * b).to_float() == pytest.approx(a.to_float() * b.to_float(), abs=1e-9)
    assert (f + g).to_float(VALUES) == pytest.approx(f.to_float(VALUES) + g.to_float(VALUES), abs=1e-9)
    assert (a * f).to_float(VALUES) == pytest.approx(a.to_float() * f.to_float(VALUES), abs=1e-9)
    assert (f - g) + g == f


def test_products_of_symbols_are_refused():
    with pytest.raises(ValueError, match="not a linear form"):
        geometry.Exact.symbol("L1") * geometry.Exact.symbol("L2")


@given(radians=st.floats(-20, 20))
def test_angles_are_on_the_circle_and_close(radians):
    angle = geometry.build_exact_angle(radians)
    assert angle.cosine * angle.cosine + angle.sine * angle.sine == geometry.ONE
    assert angle.cosine.to_float() == pytest.approx(math.cos(radians), abs=1.1e-5)
    assert angle.sine.to_float() == pytest.approx(math.sin(radians), abs=1.1e-5)
    if not angle.snapped_by:
        assert angle.cosine.to_float() == pytest.approx(math.cos(radians), abs=1e-8)


@pytest.mark.parametrize("k", range(-24, 25))
def test_multiples_of_fifteen_degrees_are_exact(k):
    angle = geometry.build_exact_angle(k * math.pi / 12)
    assert angle.snapped_by == 0.0
    assert angle.cosine.to_float() == pytest.approx(math.cos(k * math.pi / 12), abs=1e-15)
    assert angle.sine.to_float() == pytest.approx(math.sin(k * math.pi / 12), abs=1e-15)
    double = geometry.build_exact_angle(2 * k * math.pi / 12)
    assert angle.cosine * angle.cosine - angle.sine * angle.sine == double.cosine


@pytest.mark.parametrize(
    ("radians", "snap", "moved"),
    [(1.5708, 1e-5, True), (1.5708, 0.0, False), (1.571, 1e-5, False), (0.7854, 1e-5, False)],
)
def test_only_right_angles_are_met_loosely(radians, snap, moved):
    angle = geometry.build_exact_angle(radians, snap=snap)
    assert bool(angle.snapped_by) is moved
    assert (angle.cosine == geometry.ZERO) is moved


ANGLES = st.floats(-4, 4).map(geometry.build_exact_angle)
LENGTHS = st.decimals(-2, 2, places=3).map(lambda value: geometry.Exact.of(str(value)))


@given(first=ANGLES, second=ANGLES, x=LENGTHS, y=LENGTHS, z=LENGTHS)
def test_composition_is_the_product_of_matrices(first, second, x, y, z):
    outer = geometry.compose_placements(geometry.rotate_x(first), geometry.translate(x, y, z))
    inner = geometry.compose_placements(geometry.translate(z, x, y), geometry.rotate_z(second))
    product = to_matrix(outer) @ to_matrix(inner)
    np.testing.assert_allclose(to_matrix(geometry.compose_placements(outer, inner)), product, atol=1e-12)
    assert geometry.compose_placements(geometry.IDENTITY, outer) == outer


@given(alpha=ANGLES, theta=ANGLES, a=LENGTHS, d=LENGTHS)
def test_modified_dh_equals_the_printed_matrix(alpha, theta, a, d):
    """Craig 1986, equation 3.6."""
    ca, sa = alpha.cosine.to_float(), alpha.sine.to_float()
    ct, st_ = theta.cosine.to_float(), theta.sine.to_float()
    length, offset = a.to_float(), d.to_float()
    expected = [
        [ct, -st_, 0, length],
        [st_ * ca, ct * ca, -sa, -sa * offset],
        [st_ * sa, ct * sa, ca, ca * offset],
        [0, 0, 0, 1],
    ]
    np.testing.assert_allclose(
        to_matrix(geometry.place_modified_dh(alpha, a, d, theta)), expected, atol=1e-12
    )
