"""Files of runs: what each run asks for, and the place of every mistake."""

import json

import numpy as np
import pytest

from symid.errors import LogError
from symid.logs.runs import (
    check_one_payload,
    describe_runs,
    get_run_weights,
    list_log_files,
    read_log_runs,
    read_recorded_runs,
)
from tests.refusals import raises

HEAD = '[[run]]\nfile = "a.npz"\n'


@pytest.fixture
def write(tmp_path, columns, write_npz):
    """Return a writer of files of runs beside logs a.npz and b.npz."""
    write_npz("a.npz", **columns)
    write_npz("b.npz", **columns)

    def build(text):
        (tmp_path / "runs.toml").write_text(text)
        return tmp_path / "runs.toml"

    return build


def test_a_log_is_a_run_without_settings(make_robot, columns, write_npz):
    (recording,) = read_log_runs(write_npz(**columns), make_robot())
    assert recording.run is None
    assert get_run_weights([recording]) is None
    assert list(describe_runs([recording])) == ["log_digests"]


def test_every_run_is_cut_and_moved_as_it_asks(make_robot, columns, write):
    path = write(
        HEAD + "weight = 2.5\ndrop_first = 4\ndrop_last = 6\npayload = 'tool'\noffset = [0.1, '-pi/2']\n"
        '[[run]]\nfile = "b.npz"\noffset = "180 deg"\npayload = "tool"\n'
    )
    first, second = read_log_runs(path, make_robot())
    np.testing.assert_array_equal(first.position, columns["q"][4:44] + np.array([0.1, -np.pi / 2]))
    np.testing.assert_array_equal(first.torque, columns["tau"][4:44])
    np.testing.assert_array_equal(second.position, columns["q"] + np.pi)
    assert [notice.code for notice in first.notices] == ["log.cut", "log.offset"]
    assert get_run_weights([first, second]) == (2.5, 1.0)
    echo = describe_runs([first, second])["runs"]
    assert (echo[0]["payload"], echo[0]["weight"], echo[0]["drop_last"]) == ("tool", 2.5, 6)
    check_one_payload([first, second])
    assert [file.name for file in list_log_files(path, make_robot())] == ["a.npz", "b.npz"]


def test_runs_are_read_again_from_what_a_result_tells(make_robot, write):
    path = write(
        HEAD + "weight = 2.5\ndrop_first = 4\ndrop_last = 6\noffset = [0.1, '-pi/2']\n"
        '[[run]]\nfile = "b.npz"\n'
    )
    recordings = read_log_runs(path, make_robot())
    sources = [entry.source for entry in recordings]
    told = json.loads(json.dumps(describe_runs(recordings)))
    again = read_recorded_runs(sources, told, make_robot())
    for first, second in zip(recordings, again, strict=True):
        np.testing.assert_array_equal(first.position, second.position)
        assert first.run == second.run
        assert first.notices == second.notices
    plain = read_recorded_runs(sources, {}, make_robot())
    assert [len(entry.time) for entry in plain] == [50, 50]
    first = {"runs": [told["runs"][0], {}]}
    assert [entry.run for entry in read_recorded_runs(sources, first, make_robot())][1] is None


@pytest.mark.parametrize(
    "change",
    [
        {"drop_first": -1},
        {"drop_last": 1.5},
        {"weight": "two"},
        {"offset": [0.0, 0.0, 0.0]},
        {"offset": ["x"]},
        {"payload": None},
        {"strange": 1},
    ],
)
def test_what_a_result_tells_is_checked(make_robot, write, change):
    recordings = read_log_runs(write(HEAD + "drop_first = 4\n"), make_robot())
    told = json.loads(json.dumps(describe_runs(recordings)))["runs"]
    for broken in ([{**told[0], **change}], told * 2, "x"):
        with raises(LogError, "runs.settings") as caught:
            read_recorded_runs([recordings[0].source], {"runs": broken}, make_robot())
        assert "identify again" in str(caught.value)


def test_payloads_do_not_mix(make_robot, write):
    path = write(HEAD + '[[run]]\nfile = "b.npz"\npayload = "tool"\n')
    with raises(LogError, "log.payloads-differ") as caught:
        check_one_payload(read_log_runs(path, make_robot()))
    assert "(none, 'tool')" in str(caught.value)


@pytest.mark.parametrize(
    "case",
    [
        ("", "runs.no-run", (1, 1), "run: "),
        ("run = 3\n", "runs.no-run", (1, 1), "run: "),
        ("[[run]]\nweight = 2\n", "runs.missing-key", (1, 1), 'write file = "log.npz"'),
        ("[[run]]\nfile = 3\n", "runs.wrong-type", (2, 8), "run 1: file: "),
        (HEAD + "weight = 0\n", "runs.out-of-range", (3, 10), "run 1: weight: "),
        (HEAD + "drop_first = -1\n", "runs.out-of-range", (3, 14), "run 1: drop_first: "),
        (HEAD + "train = '60%'\n", "runs.log-part", (3, 9), "run 1: train: '60%': expected START:END"),
        (HEAD + "train = 3\n", "runs.wrong-type", (3, 9), "run 1: train: "),
        (HEAD + "offset = [1, 2, 3]\n", "runs.column-count", (3, 10), "3 offsets for 2 joints"),
        (HEAD + 'offset = [1, "x"]\n', "runs.wrong-type", (3, 14), 'got "x"'),
        (HEAD + "wieght = 2\n", "runs.unknown-key", (3, 1), "weight"),
        (HEAD + "weight = \n", "runs.syntax", (3, 10), "TOML"),
        ('[[run]]\nfile = "absent.npz"\n', "log.no-such-file", (0, 0), "no such file"),
    ],
)
def test_mistakes_have_places(make_robot, write, case):
    text, code, place, words = case
    with pytest.raises(LogError) as caught:
        read_log_runs(write(text), make_robot())
    notice = caught.value.notices[0]
    assert (notice.code, (notice.line, notice.column)) == (code, place)
    assert words in notice.text


def test_files_and_logs_that_are_not_there(make_robot, tmp_path):
    with raises(LogError, "runs.unreadable"):
        read_log_runs(tmp_path / "absent.toml", make_robot())
    with raises(LogError, *["log.no-such-file"] * 2):
        read_recorded_runs([str(tmp_path / "x.npz"), str(tmp_path / "y.npz")], {}, make_robot())
