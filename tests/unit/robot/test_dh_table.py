"""Tables of rows: what they mean, and what each mistake is told."""

import pytest

from symid.errors import RobotError
from symid.robot.description import JointKind
from symid.robot.geometry import Exact
from symid.robot.toml_reader import parse_dh_table, parse_robot, read_dh_table
from tests.mistakes import refuse, take_mark

ROWS = """
[[joint]]
name = "shoulder"
kind = "revolute"
d = 0.15
[[joint]]
name = "elbow"
kind = "revolute"
alpha = "-pi/2"
a = 0.25
theta = "-pi/2"
[[joint]]
name = "joint3"
kind = "prismatic"
alpha = "pi/6"
d = 0.1
"""
TABLES = {
    "decimals": (
        "# A table.\njoint,alpha,a,d,theta\n\nshoulder,0,0,0.15,q\nelbow,-pi/2,0.25,0,q2 - pi/2  # turned\n"
        "3,pi/6,0,q+0.1,0\n"
    ),
    "degrees": (
        "name;kind;alpha_deg;a_mm;d_mm;theta_deg\r\nshoulder;revolute;0;0;150;0\r\n"
        "elbow;revolute;-90;250;;-90\r\njoint3;;30;0;q+100;\r\n"
    ),
    "quoted": (
        '"joint","alpha_deg","a","d","theta"\n"shoulder",0,"0",0.15,q\n'
        'elbow,-90, "0.25" ,0,"q2 - pi/2" # turned\n3,30,0,"q+0.1",0\n'
    ),
    "tabs": "joint\talpha_rad\ta_m\td_m\ttheta_rad\nshoulder\t0\t0\t.15\tq1\nelbow\t-pi/2\t.25\t0\tq-pi/2\n"
    "joint3\t30 deg\t0\tq + 0.1\t0\n",
}


@pytest.mark.parametrize("convention", ["modified", "standard"])
@pytest.mark.parametrize("name", sorted(TABLES))
def test_a_table_is_the_robot_file_with_its_rows(name, convention):
    wanted = parse_robot(f'convention = "{convention}"\ngravity = [0, 0, -9.81]\n{ROWS}')
    found = parse_dh_table(TABLES[name], convention)
    assert found.joints == wanted.joints
    assert (found.gravity, found.convention) == (wanted.gravity, convention)
    assert found.notices == ()


def test_gravity_and_name_are_taken(tmp_path):
    path = tmp_path / "my arm.csv"
    path.write_text("\ufeffkind,alpha,a,d,theta\nfixed,0,0,1,0\ncontinuous,0,0,0,q\nprismatic,0,0,0,0\n")
    robot = read_dh_table(path, "modified", ("0.5", "0", "-9.7"))
    assert robot.name == "my_arm"
    assert robot.gravity == (Exact.of("0.5"), Exact(), Exact.of("-9.7"))
    assert [joint.kind for joint in robot.joints] == [JointKind.REVOLUTE, JointKind.PRISMATIC]
    assert [notice.code for notice in robot.notices] == ["robot.lumped"]


HEAD = "joint,kind,alpha,a,d,theta\n"
MISTAKES = [
    ("robot.table-header", "^", "joint,kind,alpha,a,d,theta"),
    ("robot.table-header", "joint,kind,^alfa,a,d,theta,alpha\na,,0,0,0,q,0\n", "did you mean alpha"),
    ("robot.table-header", "alpha,a,d,theta,^a_mm\n0,0,0,q,0\n", '"a_mm" '),
    ("robot.table-header", "^one,,0,0,0,q\ntwo,,0,0,0,q\n", "alpha_deg is"),
    ("robot.table-header", "^alpha,a,theta\n0,0,q\n", "the columns d are missing"),
    ("robot.missing-key", "^" + HEAD, "no rows"),
    ("robot.table-row", HEAD + "^one,,0,0,q\n", "5 cells under 6 columns"),
    ("robot.table-row", HEAD + "one,,0,0,q,^q\n", "one variable"),
    ("robot.table-row", HEAD + "^one,,0,0,0,0\n", "neither q"),
    ("robot.table-row", HEAD + "one,,^q,0,0,0\n", "q under alpha"),
    ("robot.table-row", HEAD + "one,prismatic,0,0,0,^q\n", 'kind is "prismatic"'),
    ("robot.bad-length", HEAD + "one,,0,^L1,0,q\n", 'got "L1"; a letter'),
    ("robot.bad-length", "alpha;a;d;theta\n0;^0,5;0;q\n", 'got "0,5"; decimals'),
    ("robot.bad-angle", HEAD + "one,,^pi half,0,0,q\n", "got pi half"),
    ("robot.bad-choice", HEAD + "one,^revolut,0,0,0,0\n", "did you mean revolute?"),
    ("robot.duplicate-joint", HEAD + "one,,0,0,0,q\n^one,,0,0,0,q\n", "by joint 1;"),
]


@pytest.mark.parametrize(("code", "text", "words"), MISTAKES)
def test_a_mistake_is_told_once_with_its_place(code, text, words):
    text, place = take_mark(text)
    (notice,) = refuse(parse_dh_table, text, "modified", file="arm.csv")
    assert (notice.code, notice.file, (notice.line, notice.column)) == (code, "arm.csv", place)
    assert words in notice.text


def test_what_stands_in_quotes_separates_nothing():
    table = 'joint,alpha,a,d,theta\n"the ""first"", #1",0,0,0,q\n'
    assert parse_dh_table(table, "modified").joints[0].name == 'the "first", #1'
    (notice,) = refuse(parse_dh_table, 'joint,alpha,a,d,theta\n"a, b",0, "x" ,0,q\n', "modified")
    assert (notice.line, notice.column) == (2, 11)


@pytest.mark.parametrize(
    "letters", ["d1 = 0.4\na2=0.3", "a2 = 3e-1,,,,\n# below\nd1 = .4 # m", "d1 = 0.40;\na2 = 0.3;"]
)
def test_letters_of_a_table_stay_symbols_with_values(letters):
    text = f"joint,alpha,a,d,theta\n1,0,0,d1,q1\n2,pi/2,2*a2,0.1 - d1,q2\n{letters}\n"
    robot = parse_dh_table(text, "modified")
    assert dict(robot.symbols) == {"d1": 0.4, "a2": 0.3}
    first, second = (joint.placement for joint in robot.joints)
    assert first.translation[2] == Exact.symbol("d1")
    assert second.translation[0] == Exact.symbol("a2") + Exact.symbol("a2")
    for wrong in (text.replace("d1 = ", "d3 = ").replace("d1=", "d3="), text.replace(",d,", ",d_mm,")):
        with pytest.raises(RobotError, match="a letter needs a value"):
            parse_dh_table(wrong, "modified")
