"""Logs with the positions of motors and links: read, checked, written; refused where they are doubtful."""

import numpy as np
import pytest

from symid.errors import LogError, RobotError
from symid.logs.checks import check_recording, get_second_encoder_side
from symid.logs.reader import read_recording
from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot
from tests.refusals import raises

ARM = """name = "arm"
convention = "modified"
gravity = [0, 0, -9.81]

[[joint]]
kind = "revolute"
drive = { gear = 100 }

[[joint]]
kind = "revolute"
a = 0.5
drive = { gear = 50 }
"""
LOG = """
[log]
position = { columns = ["qm"], unit = "rad", side = "motor" }
torque = { columns = ["tau"], unit = "N m" }
link_position = { columns = ["ql1", "ql2"], unit = "mrad" }
"""


@pytest.fixture
def make(tmp_path):
    def make_robot(text):
        path = tmp_path / "arm.toml"
        path.write_text(text)
        return read_robot(path)

    return make_robot


def save(path, **arrays):
    rng = np.random.default_rng(0)
    base = {"t": np.arange(200) / 100.0, "q": rng.normal(size=(200, 2)), "tau": rng.normal(size=(200, 2))}
    np.savez(path, **{key: value for key, value in (base | arrays).items() if value is not None})
    return base | arrays


def test_a_robot_file_names_the_second_encoder_and_its_side(make, tmp_path):
    robot = make(ARM + LOG)
    path = tmp_path / "run.npz"
    rng = np.random.default_rng(1)
    qm, ql = rng.normal(size=(200, 2)), rng.normal(size=(200, 2))
    save(path, q=None, qm=qm, ql1=ql[:, 0], ql2=ql[:, 1])
    recording = read_recording(path, robot)
    np.testing.assert_allclose(recording.position, qm / [100.0, 50.0])
    np.testing.assert_allclose(recording.link_position, 1e-3 * ql)
    assert recording.motor_position is None
    assert get_second_encoder_side(recording) == "link"
    told = [notice.text for notice in recording.notices if notice.code == "log.converted"]
    assert any(
        text.startswith("link_position: 'ql1', 'ql2' in mrad was multiplied by 0.001") for text in told
    )
    settings = (("log.motor_position.columns", "m"), ("log.motor_position.unit", "rev"))
    robot = override_robot(make(ARM), (*settings, ("log.motor_position.side", "motor")))
    turns = np.random.default_rng(2).normal(size=(200, 2))
    save(path, m=turns)
    recording = read_recording(path, robot)
    np.testing.assert_allclose(recording.motor_position, 2.0 * np.pi * turns / [100.0, 50.0])
    robot = override_robot(make(ARM), (("log.position.columns", "theta"), ("log.position.unit", "rad")))
    save(path, q=None, theta=np.random.default_rng(3).normal(size=(200, 2)))
    assert get_second_encoder_side(read_recording(path, robot)) is None


def test_two_second_encoders_and_one_column_twice_are_refused(make, tmp_path):
    path = tmp_path / "run.npz"
    more = np.random.default_rng(4).normal(size=(200, 2))
    save(path, theta=more, link_position=more + 1.0)
    with raises(LogError, "log.two-encoders", match=r"\(theta\) .* \(link_position\) .* \(q\)"):
        read_recording(path, make(ARM))
    with raises(RobotError, "robot.two-encoders", match="position") as caught:
        make(ARM + LOG + 'motor_position = { columns = ["m"], unit = "rad" }\n')
    (notice,) = caught.value.notices
    assert notice.line > 0
    robot = make(ARM + '[log.link_position]\ncolumns = ["q"]\nunit = "rad"\n')
    save(path)
    with raises(LogError, "log.same-encoder") as caught:
        read_recording(path, robot)
    assert "(q)" in caught.value.notices[0].text


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("link_position", "link positions (link_position) but no motor"),
        ("theta", "motor positions (theta) but no link"),
    ],
)
def test_a_log_of_one_side_alone_is_refused_with_what_it_is_good_for(make, tmp_path, name, said):
    path = tmp_path / "run.npz"
    save(path, q=None, **{name: np.random.default_rng(5).normal(size=(200, 2))})
    with raises(LogError, "log.missing-column", "log.one-side", match=f"\\({name}\\)") as caught:
        read_recording(path, make(ARM))
    assert said in caught.value.notices[1].text


def test_channels_with_numbers_that_are_none_or_without_an_encoder(make, tmp_path):
    path = tmp_path / "run.npz"
    values = np.zeros((200, 2))
    values[7, 1] = np.inf
    save(path, theta=values)
    with pytest.raises(LogError, match=r"'theta' has 1 values .* sample 7, column 1"):
        read_recording(path, make(ARM))
    arrays = save(path)
    save(path, theta=np.column_stack([np.zeros(200), arrays["q"][:, 1]]))
    robot = make(ARM)
    found = [
        notice.text
        for notice in check_recording(read_recording(path, robot), robot)
        if notice.code == "log.no-second-encoder"
    ]
    assert len(found) == 2
    assert "is constant for 'joint1'" in found[0]
    assert "repeats the position to the last bit for 'joint2'" in found[1]
