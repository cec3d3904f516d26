"""Whatever stands in the place of a value, the reader answers with a robot or with places of mistakes."""

from hypothesis import given, settings, strategies as st

from symid.errors import RobotError
from symid.robot.toml_reader import parse_dh_table, parse_robot
from symid.robot.toml_values import Scanner

TEXT = """name = "arm"
description = "d"
convention = "standard"
gravity = [0, "-g", -9.81]
[symbols]
L1 = 0.25
m1 = 2
I1 = 0.5
g = 1.5
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
friction = { model = "viscous_coulomb", Fv = 1, Fc = 2, smoothing = 0.1 }
limits = { position = [-1, 2], velocity = 3, torque = 4 }
[joint.elasticity]
catalogue = { K1 = 5, K2 = 6, K3 = 7, T1 = 1, T2 = 2 }
damping = 1
stops = [{ threshold = 0.5, stiffness = 2 }]
[[joint]]
name = "b"
kind = "prismatic"
link = { standard = { XX = 1, YY = 1, ZZ = 1, M = 2 } }
mimic = { joint = "a", multiplier = "1/3", offset = 0.1 }
spring = { stiffness = 3, rest = 0.1 }
elasticity = { stiffness = "unknown", cubic = 0, knees = [{ threshold = 4, slope = 0.5 }], symmetric = true }
[[joint]]
name = "c"
kind = "fixed"
origin = { xyz = [0, 0.1, "L1"], rpy = [0, 1, "2*atan(1/3)"] }
frame = { quaternion = [1, 0, 0, "1/2"] }
link = { mass = "m1", com = ["L1", 0, 0], inertia = { zz = "I1", yy = "2*I1", xx = "I1" } }
[[coupling]]
name = "m"
terms = { a = 1, b = "1/2" }
rotor_inertia = 0.1
friction = { model = "viscous_coulomb" }
[log]
time = { column = "t", unit = "ms" }
torque = { columns = ["u"], unit = "V", factor = [2], side = "motor" }
[processing]
filter_cutoff = 50
decimation = { factor = 10, band = 0.8 }
[settings.other]
processing = { filter_cutoff = 5, standstill = 0.1 }
controller = { stiffness = 3, damping = [1] }
"""
PLACES = Scanner(TEXT).scan_document()
# What a header opens cannot be replaced by a value.
VALUES = sorted((place for path, place in PLACES.values.items() if f" = {place.text}" in TEXT), key=repr)
ODD = """
-1 | 0 | 1e400 | nan | -inf | true | "" | "L1" | "x y" | [] | [1] | ["u"] | [[]] | {} | { x = 1 } | 1979-05-27
| "1/0" | "sqrt(2)" | "2*atan(m1)" | "unknown" | "c" | [0, 0, 0, 0] | [1, 2, 3, 4] | "-1/2*m1"
| [0, 0, 0] | "3 mm" | "base" | "A" | [true, nan] | 99999999999999999999999999999999999999
"""


@settings(max_examples=1000)
@given(st.sampled_from(VALUES), st.sampled_from([odd.strip() for odd in ODD.split("|")]))
def test_any_value_is_read_or_told(place, odd):
    lines = TEXT.split("\n")
    line = lines[place.line - 1]
    start = place.column - 1
    lines[place.line - 1] = line[:start] + odd + line[start + len(place.text) :]
    notices = find_notices("\n".join(lines))
    assert all(notice.line and notice.column and notice.text for notice in notices)


def test_the_text_itself_is_read():
    told = {"robot.lumped", "robot.elastic-joint", "robot.implausible-body"}
    assert {notice.code for notice in find_notices(TEXT)} == told


def find_notices(text, read=parse_robot, *options):
    try:
        return read(text, *options).notices
    except RobotError as error:
        return error.notices


CELLS = """
0 | 0.1 | -1 | .5 | 1e-3 | 1e400 | nan | inf | pi/2 | -pi | q | q1 | q+0.1 | q-pi/2 | q- | L1 | 1/3 | 1/0 | "a
| sqrt(2) | x | 90 | 30 deg | revolute | fixed | prismatic | continuous | base | joint1 | 1_000
| 2*atan(1/3) |
"""
HEADERS = ("alpha,a,d,theta", "joint;kind;alpha_deg;a_mm;d_mm;theta_deg", "name,alpha,a,d,theta,kind", "a,b")
LINES = st.lists(st.sampled_from([cell.strip() for cell in CELLS.split("|")]), min_size=1, max_size=7)


@settings(max_examples=500)
@given(st.sampled_from(HEADERS), st.lists(LINES, max_size=4), st.sampled_from(["modified", "standard"]))
def test_any_table_is_read_or_told(header, lines, convention):
    separator = ";" if ";" in header else ","
    text = "\n".join([header, *(separator.join(line) for line in lines)])
    assert all(
        notice.line and notice.column and notice.text
        for notice in find_notices(text, parse_dh_table, convention)
    )
