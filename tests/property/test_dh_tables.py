"""Whatever stands in a table of rows, the reader answers with a robot or with places of mistakes."""

from hypothesis import given, settings, strategies as st

from symid.errors import RobotError
from symid.robot.toml_reader import parse_dh_table

CELLS = """
0 | 0.1 | -1 | .5 | 1e-3 | 1e400 | nan | inf | pi/2 | -pi | q | q1 | q+0.1 | q-pi/2 | q- | L1 | 1/3 | 1/0 | "a
| sqrt(2) | x | 90 | 30 deg | revolute | fixed | prismatic | continuous | base | joint1 | 1_000
| 2*atan(1/3) |
"""
HEADERS = ("alpha,a,d,theta", "joint;kind;alpha_deg;a_mm;d_mm;theta_deg", "name,alpha,a,d,theta,kind", "a,b")
LINES = st.lists(st.sampled_from([cell.strip() for cell in CELLS.split("|")]), min_size=1, max_size=7)


def find_notices(text, convention="modified"):
    try:
        return parse_dh_table(text, convention).notices
    except RobotError as error:
        return error.notices


@settings(max_examples=500)
@given(st.sampled_from(HEADERS), st.lists(LINES, max_size=4), st.sampled_from(["modified", "standard"]))
def test_any_table_is_read_or_told(header, lines, convention):
    separator = ";" if ";" in header else ","
    text = "\n".join([header, *(separator.join(line) for line in lines)])
    assert all(notice.line and notice.column and notice.text for notice in find_notices(text, convention))


@given(st.text(max_size=60))
def test_any_text_is_read_or_told(text):
    assert all(notice.text for notice in find_notices(text))
