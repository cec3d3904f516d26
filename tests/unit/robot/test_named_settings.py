"""Named sets of settings: read and checked like the file's own, put over it, written again."""

import pytest

import symid
from symid.errors import UsageError
from symid.robot.description import Controller, Decimation, NamedSettings, Processing
from symid.robot.loading import load_robot, override_robot
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.mistakes import refuse
from tests.refusals import raises

JOINT = """
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
name = "axis"
kind = "revolute"
[processing]
standstill = 0.5
[log]
torque = { columns = ["i"], unit = "N m" }
"""
SETS = """
[settings.slow.processing]
filter_cutoff = 5
decimation = { factor = 20 }
[settings.lab-2.log]
position = { columns = ["counts"], unit = "count", factor = 0.001, offset = 0.25 }
torque = { columns = ["u"], unit = "V", factor = 3 }
[settings.lab-2.controller]
stiffness = 100
damping = [2]
velocity_filter = 175
[settings.bare]
processing = {}
log = {}
"""


@pytest.fixture
def robot():
    return parse_robot(JOINT + SETS, "arm.toml")


def test_sets_are_kept_and_change_nothing_by_themselves(robot):
    assert [entry.name for entry in robot.settings] == ["slow", "lab-2", "bare"]
    slow, lab, bare = robot.settings
    assert slow == NamedSettings(
        name="slow", processing=Processing(filter_cutoff=5.0, decimation=Decimation(factor=20))
    )
    assert lab.processing is None
    assert lab.controller == Controller(stiffness=(100.0,), damping=(2.0,), velocity_filter=175.0)
    assert lab.log.position.offset == (0.25,)
    assert bare.processing == Processing()
    plain = parse_robot(JOINT, "arm.toml")
    assert (robot.log, robot.processing, robot.controller) == (plain.log, plain.processing, None)


def test_a_set_replaces_whole_tables(robot):
    slow = override_robot(robot, [("settings", "slow")])
    assert slow.processing == robot.settings[0].processing
    # The file's own table is not mixed with that of the set; tables that the set lacks stay.
    assert not slow.processing.get_standstill(0)
    assert slow.log == robot.log
    lab = override_robot(robot, [("settings", "lab-2")])
    assert (lab.log, lab.controller) == (robot.settings[1].log, robot.settings[1].controller)
    assert lab.processing == robot.processing
    assert override_robot(robot, [("settings", "bare")]).log.torque is None
    assert slow.settings == robot.settings


def test_sets_are_written_again(robot):
    again = parse_robot(write_robot(robot), "arm.toml")
    assert again.settings == robot.settings
    assert (again.log, again.processing, again.controller) == (robot.log, robot.processing, robot.controller)
    chosen = override_robot(robot, [("settings", "lab-2")])
    again = parse_robot(write_robot(chosen), "arm.toml")
    assert (again.settings, again.log, again.controller) == (robot.settings, chosen.log, chosen.controller)


def test_all_mistakes_of_all_sets_are_told_at_their_places():
    text = """
[settings.one.processing]
filter_cutof = 5
standstill = -1
[settings.two.controller]
stiffness = 1
[settings.two.log]
torque = { columns = ["a", "b"], unit = "N" }
[settings.three]
friction = "asymmetric"
[settings.processing]
filter_cutoff = 5
[settings.empty]
[settings."4th".log]
[settings]
five = 5
"""
    notices, first = refuse(parse_robot, JOINT + text, "arm.toml"), JOINT.count("\n") + 1
    assert [(notice.line - first, notice.code) for notice in notices] == [
        (2, "robot.unknown-key"),
        (3, "robot.out-of-range"),
        (4, "robot.missing-key"),
        (7, "robot.column-count"),
        (7, "robot.missing-factor"),
        (9, "robot.unknown-key"),
        (10, "robot.bad-name"),
        (12, "robot.missing-key"),
        (13, "robot.bad-name"),
        (15, "robot.wrong-type"),
    ]
    texts = [notice.text for notice in notices]
    assert texts[0].startswith("settings: one: processing: filter_cutof: no such key here; did you mean")
    assert "settings: three: friction: no such key here; allowed are log, processing, controller" in texts
    assert "[settings.NAME.processing]" in texts[6]
    notices = refuse(parse_robot, "settings = 3\n" + JOINT, "arm.toml")
    assert [notice.code for notice in notices] == ["robot.wrong-type"]


def test_an_unknown_set_is_refused_with_those_that_there_are(robot, robots_folder):
    with raises(UsageError, "usage.unknown-settings", match="it has slow, lab-2, bare; did you mean slow?"):
        override_robot(robot, [("settings", "slwo")])
    with raises(UsageError, "usage.unknown-settings", match="named 'published': it has none"):
        load_robot(str(robots_folder / "two_link.toml"), [("settings", "published")])


def test_a_text_names_a_set_also_beside_single_settings():
    robot = symid.load("emps", settings="published")
    assert robot.description == symid.load("emps").override(settings="published").description
    found = symid.load("emps", settings={"processing.drop_first": 7, "settings": "published"})
    processing = found.description.processing
    assert (processing.drop_first, processing.filter_cutoff) == (7, 100.0)


def test_a_log_that_was_read_otherwise_is_refused(tmp_path):
    file = tmp_path / "arm.toml"
    file.write_text(JOINT + SETS)
    table = "\n".join(f"{0.001 * k},{k},1,1" for k in range(100))
    (tmp_path / "log.csv").write_text(f"t,counts,i,u\n{table}\n")
    lab = symid.load(file, settings="lab-2")
    log = symid.read_log(tmp_path / "log.csv", lab)
    assert (log.q[4, 0], log.tau[4, 0]) == (pytest.approx(0.254), 3.0)
    with raises(UsageError, "usage.read-before", match="settings 'bare': the log is already read"):
        lab.identify(log, settings="bare")
    # A set that reads the log as it was read, or another table, says nothing of the columns.
    for name in ("lab-2", "slow"):
        assert symid.api.log.list_logs(log, [("settings", name)]) == (log.recording,)
