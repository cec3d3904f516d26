"""Settings of the command line: the same checks as in the file, and places that name them."""

import pytest

from symid.errors import UsageError
from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot
from symid.robot.toml_settings import list_log, list_processing
from tests.mistakes import refuse


@pytest.fixture
def emps(robots_folder):
    return read_robot(robots_folder / "emps.toml")


def test_settings_replace_those_of_the_file(emps):
    settings = [
        ("processing.filter_cutoff", "50"),
        ("processing.decimation.factor", "4"),
        ("processing.filter_torque", "true"),
        ("log.torque.columns", "u"),
        ("log.position.unit", "mm"),
    ]
    robot = override_robot(emps, settings)
    assert (robot.processing.filter_cutoff, robot.processing.filter_order) == (50.0, 4)
    assert (robot.processing.decimation.factor, robot.processing.decimation.order) == (4, 8)
    assert robot.processing.filter_torque
    assert (robot.log.torque.columns, robot.log.torque.factor) == (("u",), (35.15065188,))
    assert robot.log.position.unit == "mm"
    assert robot.log.time == emps.log.time
    assert robot.joints == emps.joints


def test_no_setting_changes_nothing(emps):
    assert override_robot(emps, []) == emps
    assert override_robot(emps, [("processing.drop_last", "0")]) == emps
    assert list_processing(emps.processing)["filter_order"] == 4
    assert set(list_log(emps.log)) == {"time", "position", "torque", "reference"}


def test_mistakes_are_told_at_once_and_name_the_setting(emps):
    settings = [
        ("processing.filter_cutoff", "-1"),
        ("processing.filter_ordr", "4"),
        ("log.torque.columns", '["a", "b"]'),
        ("log.position.unit", "metre"),
    ]
    told = {notice.file: notice for notice in refuse(override_robot, emps, settings)}
    assert set(told) == {f"--set {key}={value}" for key, value in settings}
    assert told["--set processing.filter_ordr=4"].code == "robot.unknown-key"
    assert "did you mean filter_order" in told["--set processing.filter_ordr=4"].text
    assert told["--set processing.filter_cutoff=-1"].code == "robot.out-of-range"
    assert "got -1" in told["--set processing.filter_cutoff=-1"].text
    assert told["--set log.position.unit=metre"].code == "robot.unknown-unit"


def test_a_factor_does_not_outlive_the_dimension_of_its_unit(emps):
    robot = override_robot(emps, [("log.torque.unit", "N")])
    assert robot.log.torque.factor == (1.0,)
    assert override_robot(emps, [("log.torque.unit", "mV")]).log.torque.factor == (35.15065188,)
    assert "log: torque: unit: " in refuse(override_robot, emps, [("log.torque.unit", "A")])[0].text


@pytest.mark.parametrize(
    "key", ["gravity", "joint.0.a", "processing", "log.torque.columns.0", "log..unit", "lgo.torque"]
)
def test_a_key_that_cannot_be_set_is_refused(emps, key):
    notice = refuse(override_robot, emps, [(key, "1")], error=UsageError)[0]
    assert notice.code == "usage.bad-setting"
    assert "--set " in str(notice)


def test_a_friction_model_is_set_for_all_joints_and_its_values_forgotten(robots_folder):
    robot = read_robot(robots_folder / "two_link.toml")
    assert robot.joints[0].friction.values is not None
    for arguments in (([], "asymmetric"), ([("friction", "asymmetric")],)):
        changed = override_robot(robot, *arguments)
        assert {joint.friction.law for joint in changed.joints} == {"asymmetric"}
        assert {joint.friction.values for joint in changed.joints} == {None}
    # The name of earlier versions is that of the same law.
    for name in ("coulomb-viscous-offset", "viscous_coulomb_offset"):
        assert override_robot(robot, [], name) == override_robot(robot, [("friction", name)]) == robot
