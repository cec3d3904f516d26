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


def test_names_not_in_the_table_are_refused_with_the_nearest():
    for name in ("metre", "", "nm", "degF", "degc"):
        with pytest.raises(KeyError):
            get_unit_factor(name)
    assert suggest_units("NM")[0] in ("Nm", "mN")
    assert "Nm" in suggest_units("NM")
    assert suggest_units("degre")[0] == "deg"
    assert suggest_units("!!!!") == ()
    assert all(" ".join(name.split()) == name for name in UNITS)
