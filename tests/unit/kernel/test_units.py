"""The closed table of units."""

import math

import pytest

from symid.notation import UNITS, get_unit_factor, suggest_units


@pytest.mark.parametrize(
    ("name", "dimension", "factor"),
    [
        ("deg", "angle", math.pi / 180),
        ("rpm", "angular velocity", 2 * math.pi / 60),
        ("mm/s", "velocity", 1e-3),
        ("N*m", "torque", 1.0),
        (" N  m ", "torque", 1.0),
        ("N\N{MIDDLE DOT}m", "torque", 1.0),
        ("kg*m**2", "inertia", 1.0),
        ("degC", "temperature", 1.0),
        ("ms", "time", 1e-3),
    ],
)
def test_units_have_their_dimension_and_factor(name, dimension, factor):
    assert get_unit_factor(name) == (dimension, pytest.approx(factor, rel=1e-15))


def test_what_is_not_in_the_table_is_refused():
    for name in ("metre", "", "nm", "degF", "degc"):
        with pytest.raises(KeyError):
            get_unit_factor(name)


def test_the_nearest_units_come_first():
    assert suggest_units("NM")[0] in ("Nm", "mN")
    assert "Nm" in suggest_units("NM")
    assert suggest_units("degre")[0] == "deg"
    assert suggest_units("!!!!") == ()


def test_one_spelling_of_a_unit_is_one_entry():
    assert all(" ".join(name.split()) == name for name in UNITS)
