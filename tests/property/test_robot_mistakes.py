"""Whatever stands in the place of a value, the reader answers with a robot or with places of mistakes."""

from hypothesis import given
from hypothesis import strategies as st

from symid.errors import RobotError
from symid.robot.positions import find_places
from symid.robot.toml import parse_robot

TEXT = """name = "arm"
description = "d"
convention = "standard"
gravity = [0, 0, -9.81]
[symbols]
L1 = 0.25
[[joint]]
name = "a"
kind = "revolute"
parent = "base"
alpha = "pi/2"
a = "L1"
d = 0.1
theta = 0.3
link = { mass = 1, com = [0, 0.1, 0], inertia = { xx = 1, yy = 1, zz = 1 } }
drive = { gear = 50, rotor_inertia = 1e-5, rotor_inertia_side = "motor", torque_constant = 0.1 }
friction = { model = "viscous_coulomb", Fv = 1, Fc = 2 }
limits = { position = [-1, 2], velocity = 3, torque = 4 }
[[joint]]
name = "b"
kind = "prismatic"
link = { standard = { XX = 1, YY = 1, ZZ = 1, M = 2 } }
[log]
time = { column = "t", unit = "ms" }
torque = { columns = ["u", "v"], unit = "V", factor = [2, 3.5], side = "motor" }
[processing]
filter_cutoff = 50
decimation = { factor = 10, band = 0.8 }
"""
PLACES = find_places(TEXT)
# What a header opens cannot be replaced by a value.
VALUES = sorted((place for path, place in PLACES.values.items() if f" = {place.text}" in TEXT), key=repr)
ODD = """
-1 | 0 | 1e400 | nan | -inf | true | "" | "L1" | "x y" | [] | [1] | ["u"] | [[]] | {} | { x = 1 } | 1979-05-27
| [0, 0, 0] | "3 mm" | "base" | "A" | [true, nan] | 99999999999999999999999999999999999999
"""


@given(st.sampled_from(VALUES), st.sampled_from([odd.strip() for odd in ODD.split("|")]))
def test_any_value_is_read_or_told(place, odd):
    lines = TEXT.split("\n")
    line = lines[place.line - 1]
    start = place.column - 1
    lines[place.line - 1] = line[:start] + odd + line[start + len(place.text) :]
    notices = find_notices("\n".join(lines))
    assert all(notice.line and notice.column and notice.text for notice in notices)


def find_notices(text):
    try:
        return parse_robot(text, "arm.toml").notices
    except RobotError as error:
        return error.notices
