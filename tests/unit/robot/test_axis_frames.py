"""Frames along an axis, and placements in short numbers."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, strategies as st

from symid.robot import geometry
from symid.robot.canonical_frames import has_long_denominator, rationalize_placement

ENTRIES = st.fractions(min_value=-10, max_value=10, max_denominator=10**6)


def is_orthogonal(placement):
    """Return whether the rotation is orthogonal to the last digit."""
    turned = geometry.Placement(rotation=placement.rotation, translation=geometry.IDENTITY.translation)
    return geometry.compose_placements(turned, geometry.invert_placement(turned)) == geometry.IDENTITY


@given(st.tuples(ENTRIES, ENTRIES, ENTRIES).filter(any))
def test_z_goes_to_the_axis(axis):
    turned, moved = geometry.build_axis_frame(axis)
    assert is_orthogonal(turned)
    found = np.array(geometry.to_floats(turned))[:, 2]
    wanted = np.array([float(value) for value in axis])
    wanted /= np.linalg.norm(wanted)
    off = np.linalg.norm(np.cross(found, wanted))
    assert off <= 1e-5
    assert found @ wanted > 0
    assert moved == pytest.approx(off, abs=1e-14)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("index", range(3))
def test_coordinate_axes_are_exact(index, sign):
    axis = [Fraction(0), Fraction(0), Fraction(0)]
    axis[index] = Fraction(sign, 3)
    turned, moved = geometry.build_axis_frame(tuple(axis), snap=0)
    assert moved == 0
    assert [row[2] for row in turned.rotation] == [geometry.Exact.of(3 * value) for value in axis]
    assert is_orthogonal(turned)


def test_quarter_turns_are_found_within_the_tolerance():
    near = geometry.rotate_x(geometry.build_exact_angle(np.pi / 2 + 4e-6, snap=0))
    turned = geometry.snap_to_quarter_turns(near)
    assert turned == geometry.rotate_x(geometry.build_exact_angle(np.pi / 2))
    assert rationalize_placement(near)[1] == pytest.approx(4e-6, rel=1e-3)
    assert geometry.snap_to_quarter_turns(near, snap=0) is None
    assert geometry.snap_to_quarter_turns(turned) is None
    assert geometry.snap_to_quarter_turns(geometry.rotate_x(geometry.build_exact_angle(0.2))) is None


@pytest.mark.parametrize("largest", range(4))
def test_long_numbers_of_any_turn_become_shorter(largest):
    angles = [(0.1, 0.2, 0.3), (3.0, 0.2, 0.1), (0.1, 3.0, 0.2), (0.2, 0.1, 3.0)][largest]
    long = geometry.IDENTITY
    for part in (0.25, 0.5, 0.25):
        step = [geometry.build_exact_angle(part * angle) for angle in angles]
        long = geometry.compose_placements(long, geometry.rotate_rpy(*step))
    assert any(has_long_denominator(entry, 10**36) for row in long.rotation for entry in row)
    settled, _ = rationalize_placement(long)
    assert is_orthogonal(settled)
    assert not any(has_long_denominator(entry, 10**33) for row in settled.rotation for entry in row)
    np.testing.assert_allclose(geometry.to_floats(settled), geometry.to_floats(long), atol=1e-15)


def test_short_numbers_stay():
    placement = geometry.Placement(
        rotation=geometry.rotate_rpy(
            geometry.build_exact_angle(0.3), geometry.build_exact_angle(0.2), geometry.build_exact_angle(0.0)
        ).rotation,
        translation=(
            geometry.Exact.of("0.123456789"),
            geometry.Exact.surd(Fraction(0), Fraction(1, 7)),
            geometry.Exact.of("0.5"),
        ),
    )
    assert rationalize_placement(placement)[0] == placement


def test_lengths_are_rounded_where_they_are_long_and_dust_is_dropped():
    origin = (geometry.Exact.of("0.10000000000000003"), geometry.Exact.of("1e-17"), geometry.Exact.of("0.5"))
    settled, _ = rationalize_placement(
        geometry.Placement(rotation=geometry.IDENTITY.rotation, translation=origin)
    )
    assert [str(value) for value in settled.translation] == ["1/10", "0", "1/2"]
