"""Readers: what they make of good logs, and the sentence every bad log gets."""

import sys
from functools import partial

import numpy as np
import pytest
from scipy.io import savemat

from symid.errors import LogError
from symid.logs.reader import read_recording
from symid.robot.description import Decimation, JointKind, Processing, Robot
from symid.robot.toml_reader import read_robot
from tests.refusals import raises, refuse, tell

P = JointKind.PRISMATIC
HDF5, PARQUET = b"\x89HDF\r\n\x1a\n", (b"", b"PAR1", b"PAR1" + b"\0" * 50 + b"PAR1")
BAGS = (b"", b"no bag", b"SQLite format 3\0" + b"\0" * 100)

problems = partial(refuse, LogError, read_recording)


def test_arrays_under_their_own_names_are_read_also_in_rows(make_robot, columns, write_npz):
    recording = read_recording(write_npz(**columns), make_robot())
    np.testing.assert_array_equal(recording.position, columns["q"])
    np.testing.assert_array_equal(recording.torque, columns["tau"])
    assert recording.velocity is None
    assert recording.notices == ()
    assert recording.period == pytest.approx(0.01)
    recording = read_recording(write_npz(t=columns["t"], q=columns["q"].T, tau=columns["tau"]), make_robot())
    np.testing.assert_array_equal(recording.position, columns["q"])
    assert "'q'" in tell(recording.notices)["log.transposed"]
    recording = read_recording(
        write_npz(**columns, current=columns["t"], note=np.array("hello")), make_robot()
    )
    assert tell(recording.notices)["log.unused-columns"].endswith(": current, note")
    np.testing.assert_array_equal(recording.extras["current"], columns["t"])


def test_velocities_are_read_where_they_are_and_may_have_holes(make_robot, columns, write_npz):
    more = {"dq": 2.0 * columns["q"], "ddq": 3.0 * columns["q"]}
    recording = read_recording(write_npz(**columns, **more), make_robot())
    np.testing.assert_array_equal(recording.velocity, more["dq"])
    np.testing.assert_array_equal(recording.acceleration, more["ddq"])
    assert "(columns dq)" in tell(recording.notices)["log.unused-columns"]
    assert "(columns ddq)" in tell(recording.notices)["log.unused-columns"]
    dq = columns["q"].copy()
    dq[3, 1] = np.nan
    recording = read_recording(write_npz(**columns, dq=dq, extra=columns["t"]), make_robot())
    assert np.isnan(recording.velocity[3, 1])
    assert ": extra; velocity" in tell(recording.notices)["log.unused-columns"]


def write_csv(tmp_path, heading):
    path = tmp_path / "log.csv"
    width = heading.count(",") + 1
    path.write_text(heading + "\n" + "".join(f"{k}{',1' * (width - 1)}\n" for k in range(9)))
    return path


def test_units_that_differ_or_are_of_another_dimension(make_robot, tmp_path, columns, write_npz):
    found = problems(write_csv(tmp_path, "t,q1 [deg],q2,tau1,tau2"), make_robot())
    assert "for 'q2', but deg for" in found["log.mixed-units"]
    path = tmp_path / "log.csv"
    path.write_text("t,q1 [deg],q2 [rad],tau1,tau2\n" + "".join(f"{k},1,1,1,1\n" for k in range(9)))
    assert "different units: deg, rad" in problems(path, make_robot())["log.mixed-units"]
    found = problems(write_csv(tmp_path, "t,q1,q2,tau1 [V],tau2 [V]"), make_robot())
    assert "a unit of voltage, " in found["log.wrong-unit"]
    path = write_csv(tmp_path, "t,q1,q2,tau1 [A],tau2 [A]")
    robot = make_robot(torque=(("tau1", "tau2"), "N m"))
    assert (
        "'A' in the log, 'N m' in the robot file: current is not torque"
        in problems(path, robot)["log.unit-differs"]
    )
    found = problems(write_npz(**columns), make_robot(time=(("t",), "m")))
    assert "time is in 'm', a unit of length" in found["log.wrong-unit"]


@pytest.mark.parametrize(
    ("heading", "text"),
    [
        ("t,q1,q3,tau1,tau2", "position: 'q1', 'q3' "),
        ("t,q2,q3,tau1,tau2", "position: 'q2', 'q3' "),
        ("t,q1,q_1,tau1,tau2", "position: 'q1', 'q_1' "),
        ("t,q0,q1,tau1,tau2", "from 1 ('tau1', 'tau2'), position from 0"),
        ("t,q1,q2,dq0,dq1,tau1,tau2", "velocity is numbered from 0"),
    ],
)
def test_numbered_columns_must_count_the_joints(make_robot, tmp_path, heading, text):
    assert text in problems(write_csv(tmp_path, heading), make_robot())["log.joint-numbers"]


def test_columns_are_counted_and_go_by_number(make_robot, tmp_path, write_npz, columns):
    assert read_recording(write_csv(tmp_path, "t,q0,q1,tau0,tau1"), make_robot()).position.shape == (9, 2)
    q1, q2 = columns["q"].T
    found = problems(write_npz(t=columns["t"], q1=q1, q2=q2, q3=q1, tau=columns["tau"]), make_robot())
    assert "position has 3 columns ('q1', 'q2', 'q3'), the robot 2 joints" in found["log.joint-count"]
    names = {f"q{k}": np.full(30, float(k)) for k in (10, 2, 1, 3, 4, 5, 6, 7, 8, 9)}
    path = write_npz(t=np.arange(30.0), **names, tau=np.zeros((30, 10)))
    recording = read_recording(path, make_robot((JointKind.REVOLUTE,) * 10))
    np.testing.assert_array_equal(recording.position[0], np.arange(1.0, 11.0))
    found = problems(write_npz(**columns), make_robot((JointKind.REVOLUTE,) * 3))
    assert "has 2 columns ('q'), the robot 3 joints" in dict(found)["log.joint-count"].replace("tau", "q")


def test_factors_constants_and_gears_are_said(make_robot, columns, write_npz):
    recording = read_recording(write_npz(**columns), make_robot(torque=(("tau",), "V", (1.0,))))
    np.testing.assert_array_equal(recording.torque, columns["tau"])
    assert "'tau' in V was multiplied by 1" in tell(recording.notices)["log.converted"]
    robot = make_robot(torque=(("tau",), "N m", (1.0,), "motor"))
    said = tell(read_recording(write_npz(**columns), robot).notices)["log.converted"]
    assert "multiplied by 1 (motor side, gear included" in said
    torque = (("tau",), "mA", (5.0, 16.0))
    robot = make_robot(gears=(50.0, 80.0), constants=(0.1, 0.2), torque=torque)
    said = tell(read_recording(write_npz(**columns), robot).notices)["log.converted"]
    assert "by 0.005, 0.016 (torque constant 0.1, 0.2 N m/A" in said
    robot = make_robot(torque=(("tau",), "V", (1.0, 2.0, 3.0)))
    assert "3 factors for 2 joints" in problems(write_npz(**columns), robot)["log.factor-count"]


def test_mat_structures_are_reached_with_a_dot(make_robot, columns, tmp_path):
    path = tmp_path / "log.mat"
    log = {
        "run": {"time": columns["t"] * 1e3, "deep": {"q": columns["q"]}},
        "tau": columns["tau"],
        "name": "x",
    }
    savemat(path, log)
    robot = make_robot(
        time=(("run.time",), "ms"), position=(("run.deep.q",), "rad"), torque=(("tau",), "N m")
    )
    recording = read_recording(path, robot)
    np.testing.assert_allclose(recording.time, columns["t"])
    np.testing.assert_array_equal(recording.position, columns["q"])
    assert "name" in tell(recording.notices)["log.unused-columns"]
    assert "in ms was multiplied by 0.001" in tell(recording.notices)["log.converted"]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_csv_units_stand_in_the_heading(make_robot, tmp_path, separator):
    path = tmp_path / "log.csv"
    rows = (
        ["t [ms]", "q1 [deg]", "q2 [deg]", "tau1 [N m]", "tau2 [N m]"],
        *[map(str, (10 * k, 180, k, 0.5, -k)) for k in range(40)],
    )
    path.write_text("# made by hand\n" + "\n".join(separator.join(row) for row in rows) + "\n\n")
    recording = read_recording(path, make_robot())
    np.testing.assert_allclose(recording.time, np.arange(40) * 0.01)
    np.testing.assert_allclose(recording.position[:, 0], np.pi)
    np.testing.assert_array_equal(recording.torque[:, 1], -np.arange(40))


def test_the_robot_file_wins_over_units_of_the_heading(make_robot, tmp_path, robots_folder):
    path = tmp_path / "log.csv"
    path.write_text("t,q1 [deg],tau1\n" + "".join(f"{k},{k},1\n" for k in range(9)))
    recording = read_recording(path, make_robot((JointKind.REVOLUTE,), position=(("q1",), "rad")))
    np.testing.assert_array_equal(recording.position[:, 0], np.arange(9))
    assert "'deg' in the log, 'rad' in the robot file" in tell(recording.notices)["log.unit-differs"]
    rows = "\n".join(f"{k * 1e-3},0,0,0,0" for k in range(3000))
    path.write_text(f"t [s],q1 [radd],q2 [rad],tau1 [N m],tau2 [N m]\n{rows}\n", encoding="utf-8")
    with raises(LogError, "log.unknown-unit", match="'radd'"):
        read_recording(path, read_robot(robots_folder / "two_link.toml"))
    rows = "\n".join(f"{k * 1e-3},{k * 1e-3},0" for k in range(3000))
    path.write_text(f"t [s],qm [ticks],vir [V]\n{rows}\n", encoding="utf-8")
    recording = read_recording(path, read_robot(robots_folder / "emps.toml"))
    assert recording.position[5, 0] == 5e-3
    assert "log.unit-differs" in {notice.code for notice in recording.notices}


def test_all_mistakes_are_said_at_once_with_names_and_settings(make_robot, columns, write_npz, tmp_path):
    t = columns["t"].copy()
    t[20] = t[18]
    tau = columns["tau"].copy()
    tau[[7, 9, 11, 12], [1, 0, 0, 1]] = np.nan, np.inf, 1e300, -1e101
    robot = make_robot(position=(("theta",), "rad"), torque=(("tau",), "N m"))
    found = problems(write_npz(t=t, thetas=columns["q"], tau=tau), robot)
    assert "'theta'; did you mean 'thetas'" in found["log.missing-column"]
    assert "'t', 'thetas', 'tau'" in found["log.missing-column"]
    assert "sample 20 (counted from 0) is at 0.18 s" in found["log.time-order"]
    assert (
        "'tau' has 4 values that are not finite numbers (NaN, infinite, beyond 1e+100)"
        in found["log.not-finite"]
    )
    assert "sample 7, column 1" in found["log.not-finite"]
    found = problems(write_csv(tmp_path, "stamp,a,b,tau1,tau2"), make_robot())["log.missing-column"]
    assert "[log.position] it must be named q or q1, q2 ... or position or position1" in found
    assert "--set log.position.columns=NAME,NAME --set log.position.unit=UNIT" in found


@pytest.mark.parametrize(
    "case",
    [
        ("Nmm", "log.unknown-unit", "torque: unknown unit 'Nmm'; did you mean 'mm'"),
        ("qwzx", "log.unknown-unit", "torque: unknown unit 'qwzx'; leave"),
        ("rad", "log.wrong-unit", "of angle; joint 'joint1' needs torque"),
        ("N", "log.wrong-unit", "of force; joint 'joint1' needs torque"),
    ],
)
def test_units_that_do_not_exist_or_do_not_fit(make_robot, columns, write_npz, case):
    unit, code, text = case
    assert text in problems(write_npz(**columns), make_robot(torque=(("tau",), unit)))[code]


def test_a_prismatic_joint_wants_metres(make_robot, columns, write_npz):
    path = write_npz(t=columns["t"], q=columns["q"][:, :1], tau=columns["tau"][:, :1])
    recording = read_recording(path, make_robot((P,), position=(("q",), "mm"), torque=(("tau",), "kN")))
    np.testing.assert_allclose(recording.position, columns["q"][:, :1] * 1e-3)
    np.testing.assert_allclose(recording.torque, columns["tau"][:, :1] * 1e3)
    assert "needs length" in problems(path, make_robot((P,), position=(("q",), "deg")))["log.wrong-unit"]


def test_arrays_that_are_no_log(make_robot, columns, write_npz):
    short = {**columns, "tau": columns["tau"][:-3]}
    assert "has 47 samples, " in problems(write_npz(**short), make_robot())["log.unequal-length"]
    robot = make_robot(position=(("a", "b"), "rad"))
    path = write_npz(t=columns["t"], a=np.zeros(50), b=np.zeros(49), tau=columns["tau"])
    assert "shape: a (50,), b (49,)" in problems(path, robot)["log.unequal-length"]
    path = write_npz(t=np.zeros(0), q=np.zeros(0), tau=np.zeros(0))
    assert " 0 samples; " in problems(path, make_robot((JointKind.REVOLUTE,)))["log.too-short"]
    empty, text = {"t": np.zeros(0), "q": np.zeros((0, 2)), "tau": np.zeros((0, 2))}, np.full((50, 2), "a")
    late = columns["t"] + 0.3 * (np.arange(50) > 30)
    for changed, code, words in (
        ({"t": columns["q"]}, "log.time-columns", "time has 2 columns"),
        (empty, "log.too-short", " 0 samples; "),
        ({"q": text}, "log.missing-column", "column 'q' of the log"),
        ({"q": np.array([{}] * 50, dtype=object)}, "log.missing-column", "column 'q' of the log"),
        ({"t": late}, "log.gap", "sample 30 (counted from 0), from 0.3 s to 0.61 s"),
    ):
        assert words in problems(write_npz(**(columns | changed)), make_robot())[code]


def test_a_log_too_short_for_its_processing(make_robot, columns, write_npz):
    base = make_robot()
    robot = Robot(
        name="r", joints=base.joints, processing=Processing(drop_first=40, decimation=Decimation(factor=2))
    )
    found = problems(write_npz(**columns), robot)["log.too-short"]
    assert "50 samples; " in found
    assert "at least 65" in found


@pytest.mark.parametrize(
    "case",
    [
        ("log.npz", b"no archive", "log.format", "NumPy archive"),
        ("log.npz", b"PK\x03\x04 broken", "log.format", "NumPy archive"),
        ("log.npz", b"", "log.format", "NumPy archive"),
        ("log.npz", b"\x80\x04\x95random", "log.format", "numpy.savez"),
        ("log.csv", b"t,q1\n0," + b"1" * 140_000 + b"\n", "log.format", "table"),
        ("log.csv", b"t,q1,q2,tau1,tau2\n", "log.too-short", " 0 samples; "),
        ("log.csv", b"t,q1\n0,1_000\n", "log.not-a-number", "'1_000'"),
        ("log.mat", b"no matlab file at all, but long enough" * 10, "log.format", "MATLAB"),
        ("log.mat", b"", "log.format", "MATLAB"),
        ("log.csv", b"\xff\xfe\x00\x01\x00", "log.format", "text file"),
        ("log.csv", b"", "log.format", "no line"),
        ("log.csv", b"0,1\n1,2\n", "log.no-heading", "must name"),
        ("log.csv", b"t,q,q\n1,2,3\n", "log.duplicate-column", "named 'q'"),
        ("log.bag", b"", "log.unknown-suffix", ".mcap, or the folder of a ROS 2 bag, got '.bag'"),
        ("log", b"", "log.unknown-suffix", "got no suffix"),
    ],
    ids=range(15),
)
def test_files_that_are_no_logs(make_robot, tmp_path, case):
    name, content, code, text = case
    (tmp_path / name).write_bytes(content)
    assert text in problems(tmp_path / name, make_robot())[code]


@pytest.mark.parametrize(
    "case",
    [
        ("h5py", "log.h5", b"MATLAB 7.3".ljust(512) + HDF5, "not an HDF5 file"),
        ("h5py", "log.mat", b"MATLAB 7.3".ljust(512) + HDF5, "not an HDF5 file"),
        *(("pyarrow", "log.parquet", content, "not a Parquet file that can be read") for content in PARQUET),
        *(("rosbags", "log.db3", content, "not a ROS 2 bag") for content in BAGS),
        *(("rosbags", "log.mcap", content, "not a ROS 2 bag") for content in BAGS),
    ],
    ids=range(11),
)
def test_files_that_optional_packages_cannot_read(make_robot, tmp_path, case):
    package, name, content, text = case
    pytest.importorskip(package)
    (tmp_path / name).write_bytes(content)
    assert text in problems(tmp_path / name, make_robot())["log.format"]


@pytest.mark.parametrize("case", ["h5py h5 hdf5", "pyarrow parquet parquet", "rosbags.rosbag2 mcap ros"])
def test_a_missing_package_is_named_by_its_extra(make_robot, tmp_path, monkeypatch, case):
    package, suffix, extra = case.split()
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / f"log.{suffix}").write_bytes(b"")
    found = problems(tmp_path / f"log.{suffix}", make_robot())
    assert f"pip install 'symid[{extra}]'" in found[f"log.needs-{extra}"]


def test_files_that_are_not_there_or_a_single_array(make_robot, tmp_path):
    assert "no such file" in problems(tmp_path / "log.npz", make_robot())["log.no-such-file"]
    (tmp_path / "folder.mat").mkdir()
    assert "a folder" in problems(tmp_path / "folder.mat", make_robot())["log.unreadable"]
    with (tmp_path / "log.npz").open("wb") as stream:
        np.save(stream, np.zeros(3))
    assert "(.npy)" in problems(tmp_path / "log.npz", make_robot())["log.format"]


def test_cells_and_lines_that_are_wrong_are_named(make_robot, tmp_path):
    path = tmp_path / "log.csv"
    lines = ["t,q1,tau1"] + [f"{k},1,2" for k in range(9)]
    lines[3], lines[5] = '2,"1,5",2', "4,oops,2"
    path.write_text("\n".join(lines))
    with pytest.raises(LogError) as caught:
        read_recording(path, make_robot((JointKind.REVOLUTE,)))
    first, second = caught.value.notices
    assert (first.line, second.line) == (4, 6)
    assert first.code == second.code == "log.not-a-number"
    assert "column 'q1': '1,5'" in first.text
    path.write_text("t,q1,tau1\n0,1,2\n1,,2\n2,1,2\n3,1,2\n")
    found = problems(path, make_robot((JointKind.REVOLUTE,)))["log.not-finite"]
    assert "'q1' has 1 values" in found
    assert "sample 1 " in found
    path.write_text("t,q1,tau1\n" + "1,2\n" * 8)
    with pytest.raises(LogError) as caught:
        read_recording(path, make_robot((JointKind.REVOLUTE,)))
    assert [notice.line for notice in caught.value.notices] == [2, 3, 4, 5, 6, 0]
    assert [notice.code for notice in caught.value.notices[-2:]] == ["log.line-length", "log.more"]
    assert "3 more" in caught.value.notices[-1].text
