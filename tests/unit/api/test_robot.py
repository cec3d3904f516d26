"""`symid.load` and what a robot says of itself."""

import dataclasses
import json

import pytest

import symid
from symid.cli.main import run
from symid.robot import write_robot
from tests.calls import do
from tests.refusals import raises, tell

ROWS = """joint,alpha,a,theta,d,kind
one,0,0,q,0,revolute
two,0,0.5,q,0,revolute
"""

FREE = """convention = "modified"
gravity = "unknown"
zeros = ["elbow"]
[[joint]]
name = "shoulder"
kind = "revolute"
[[joint]]
name = "elbow"
kind = "revolute"
a = 0.5
"""


def test_a_robot_says_in_one_line_what_it_is():
    robot = symid.load("two_link_elastic")
    assert repr(robot).startswith("<RobotModel two_link_elastic: 2 joints, elastic, ")
    assert [joint.name for joint in robot.joints] == ["shoulder", "elbow"]
    assert robot.elastic


def test_a_robot_cannot_be_changed():
    robot = symid.load("two_link")
    with pytest.raises(dataclasses.FrozenInstanceError):
        robot.backend = "python"
    other = robot.override(settings={"processing.filter_cutoff": 12.5, "processing.automatic": False})
    assert other.description.processing.filter_cutoff == 12.5
    assert robot.description.processing.filter_cutoff != 12.5


def test_settings_may_be_values_of_python():
    settings = {
        "log.position.columns": ["a", "b"],
        "log.position.unit": "rad",
        "processing.filter_cutoff": None,
    }
    robot = symid.load("two_link", settings=settings)
    assert robot.description.log.position.columns == ("a", "b")
    assert robot.description.processing.filter_cutoff is None


def test_a_wrong_setting_is_refused_with_its_key():
    with pytest.raises(symid.UsageError, match="processing"):
        symid.load("two_link", settings={"procesing.filter_cutoff": 12})


def test_names_of_shipped_robots_are_listed_and_load():
    names = symid.list_robots()
    assert {"panda", "two_link", "tx40"} <= set(names)
    assert names == tuple(sorted(names))


def test_a_table_of_rows_wants_its_convention(tmp_path):
    table = tmp_path / "arm.csv"
    table.write_text(ROWS)
    with raises(symid.UsageError, "usage.convention"):
        symid.load(table)
    with raises(symid.UsageError, "usage.convention"):
        symid.load("two_link", convention="modified")


@pytest.mark.parametrize("gravity", [(0.0, float("nan"), -9.81), (0.0, 1.0), "0,0", "0,0,down", "unkown"])
def test_gravity_is_three_finite_numbers(tmp_path, gravity):
    table = tmp_path / "arm.csv"
    table.write_text(ROWS)
    with raises(symid.UsageError, "usage.gravity"):
        symid.load(table, convention="modified", gravity=gravity)
    with raises(symid.UsageError, "usage.gravity"):
        symid.load("two_link", gravity=gravity)


@pytest.mark.parametrize("gravity", [(0.0, 9.81, 0.5), "0, 9.81, 0.5", [0, "9.81", 0.5]])
def test_gravity_of_a_call_stands_in_for_that_of_any_file(tmp_path, gravity):
    urdf = tmp_path / "arm.urdf"
    joint = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    urdf.write_text(f'<robot name="arm"><link name="a"/><link name="b"/>{joint}{limit}</robot>')
    for source in ("two_link", urdf):
        robot = symid.load(source, gravity=gravity)
        assert [value.to_float() for value in robot.description.gravity] == [0.0, 9.81, 0.5]
        assert "robot.assumed-gravity" not in [notice.code for notice in robot.notices]


def test_unknown_gravity_and_zeros_are_those_of_the_robot_file(tmp_path):
    file = tmp_path / "arm.toml"
    file.write_text(FREE)
    robot = symid.load(file)
    assert robot.description.free_gravity
    assert robot.description.free_zeros == ("elbow",)
    assert list(tell(robot.notices)) == ["robot.free-gravity"]
    called = symid.load("two_link", gravity="unknown", zeros="unknown").description
    assert [str(value) for value in called.gravity] == ["g_x", "g_y", "g_z"]
    assert called.free_zeros == ("shoulder", "elbow")
    assert {"g_x", "g_y"} <= {str(one) for one in robot.sympy("gravity")["g"].free_symbols}
    # Written and read again it is to be found still.
    again = tmp_path / "again.toml"
    again.write_text(write_robot(called))
    assert symid.load(again).description.free_zeros == called.free_zeros
    assert 'gravity = "unknown"' in again.read_text()
    file.write_text(FREE.replace('["elbow"]', '["wrist"]'))
    with raises(symid.RobotError, "robot.zeros", match="expected .unknown. or a list of joints"):
        symid.load(file)
    with raises(symid.UsageError, "usage.zeros", match="did you mean elbow"):
        symid.load("two_link", zeros="elbov")


def test_a_table_of_rows_is_the_robot_that_new_writes_from_it(tmp_path):
    table, file = tmp_path / "arm.csv", tmp_path / "arm.toml"
    table.write_text(ROWS)
    call = ["new", str(file), "--from-dh", str(table), "--convention", "modified", "--gravity=0,-9.81,0"]
    do(*call)
    robot = symid.load(table, convention="modified", gravity=(0.0, -9.81, 0.0))
    assert tuple(robot.base) == tuple(symid.load(file).base)
    # Two joints about parallel axes, gravity across them: Khalil's planar arm.
    assert tuple(robot.base) == ("ZZR1", "MXR1", "MY1", "ZZ2", "MX2", "MY2")


def test_the_base_set_is_what_the_command_line_prints(capsys):
    base = symid.load("two_link").base
    assert run(["base", "two_link", "-v"]) == 0
    assert capsys.readouterr().out == f"{base.to_text()}\n"
    assert run(["base", "two_link", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["result"] == json.loads(json.dumps(base.to_dict()))


def test_a_base_parameter_is_explained_and_an_eliminated_one_too():
    base = symid.load("two_link").base
    assert base.count == len(base) == 6
    assert "0.25*M2" in base.explain("ZZR1")
    assert "eliminated" in base.explain("M2")
    assert base.explain("ZZ1") == base.explain("ZZR1")
    with raises(symid.UsageError, "usage.unknown-parameter", match="ZZR1"):
        base["ZZ1"]
    with pytest.raises(symid.UsageError, match="ZZR1"):
        base.explain("ZZR11")


def test_values_of_the_base_set_are_the_groups_of_those_of_the_links():
    robot = symid.load("two_link")
    first, second = (joint.inertial for joint in robot.description.joints)
    values = robot.base.values
    # ZZ about the link frame's origin stands sixth, the mass last; joint 2 is 0.5 m from joint 1.
    assert values["ZZR1"] == pytest.approx(first[5] + 0.5**2 * second[9], rel=1e-12)
    assert values["ZZ2"] == pytest.approx(second[5], rel=1e-12)


def test_formulas_of_the_base_set_are_latex():
    text = symid.load("two_link").base._repr_latex_()
    assert text.startswith("$$")
    assert r"ZZR_{1} &= ZZ_{1} + \frac{M_{2}}{4}" in text


def test_other_forms_hold_less():
    robot = symid.load("two_link")
    assert set(robot.derive_base("gravity")) < set(robot.base)
    assert robot.derive_base("torque") is robot.base


def test_fits_share_the_library_while_the_dynamics_are_the_robots_own():
    robot = symid.load("two_link")
    prepare, own = robot.context.prepare, robot.library
    assert prepare(robot.override(settings={"processing.filter_cutoff": 5.0}).description) is own
    other = prepare(robot.override(friction="coulomb").description)
    assert other is not own
    assert {law.friction for law in other.card.joints} == {"coulomb"}
