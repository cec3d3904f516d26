"""Logs in the shape in which programs write them: read right, or refused with what to do.

The shapes are those of the named sources; the numbers are ours. docs/logs.md has the same table.
"""

import gzip
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest
from scipy.io import savemat

from symid.errors import LogError
from symid.logs.reader import read_recording
from symid.logs.runs import describe_runs, measure_overlap, read_recorded_runs, read_recordings
from tests.refusals import refuse, tell

TIME = np.arange(60) * 0.004
Q = np.column_stack([np.sin(3.0 * TIME), 0.5 * np.cos(2.0 * TIME)])
TAU = np.column_stack([5.0 + TIME, -2.0 * np.sin(TIME)])
WHOLE = np.column_stack([TIME, Q, TAU])
OWN = "t", "q1", "q2", "tau1", "tau2"
DEGREES = 180.0 / np.pi
MAP = {"time": (("Name",), "ms"), "position": (("q1", "q2"), "rad"), "torque": (("tau1", "tau2"), "N m")}


def write_rows(values, separator=",", decimal="."):
    lines = (separator.join(f"{value:.9f}".replace(".", decimal) for value in row) for row in values)
    return "".join(f"{line}\n" for line in lines)


def scale(time=1.0, position=1.0, torque=1.0):
    return WHOLE * np.array([time, position, position, torque, torque])


def plot_juggler():
    names = (f"/joint_states/joint{k}/{part}" for part in ("position", "effort") for k in (1, 2))
    return f"__time,{','.join(names)}\n" + write_rows(scale() + np.array([1.7e9, 0, 0, 0, 0]))


def rostopic():
    names = "field.position0,field.position1,field.effort0,field.effort1"
    rows = "".join(f"{round(row[0] * 1e9)},{','.join(map(repr, row[1:].tolist()))}\n" for row in WHOLE)
    return f"%time,{names}\n{rows}"


def libfranka():
    """`logToCSV` of libfranka: the heading has a space after some commas, times are in ms."""
    names = (
        "time, success_rate, state.q[0], state.q[1],state.q_d[0], state.q_d[1],state.tau_J[0], state.tau_J[1]"
    )
    ones = np.ones(60)
    values = np.column_stack([1e3 * TIME, ones, Q, Q + 0.1, TAU])
    return f"{names}\n" + write_rows(values)


def rtde():
    """csv_writer of UR's RTDE client: spaces between columns; currents."""
    return "timestamp actual_q_0 actual_q_1 actual_current_0 actual_current_1\n" + write_rows(scale(), " ")


def twincat():
    """TwinCAT Scope: labels before each row of the heading, and times in ms below them."""
    head = "Name\tscope\nFile\tscope.csv\nStarttime of export\t132959733843760000\tMontag\t15:56:24.376\n\n\n"
    rows = (
        *(
            ("Name", "q1", "q2", "tau1", "tau2"),
            ("SymbolComment", "", "", "", ""),
            ("Data-Type", *["REAL64"] * 4),
        ),
        *(("SampleTime[ms]", *["4"] * 4), ("Port", *["851"] * 4), ("NetID", *["192.168.1.1.1.1"] * 4)),
        *(
            ("ScaleFactor", *["1"] * 4),
            ("Unit", "(None)", "(None)", "(None)", "(None)"),
            ("Unit Offset", *"0000"),
        ),
    )
    table = "".join("\t".join(row) + "\n" for row in rows)
    return head + table + "\n" + write_rows(scale(time=1e3), "\t", ",")


def labview():
    """LabVIEW measurement file: two headers, units in one of them, a column of comments."""
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        "Multi_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\n***End_of_Header***\t\n\t\n"
        "Channels\t4\t\t\t\t\nSamples\t60\t60\t60\t60\t\nY_Unit_Label\tdeg\tdeg\tNm\tNm\t\n"
        "X_Dimension\tTime\tTime\tTime\tTime\t\nX0\t0.0\t0.0\t0.0\t0.0\t\nDelta_X\t0.004\t0.004\t0.004\t0.004\t\n"
        "***End_of_Header***\t\t\t\t\t\nX_Value\tq1\tq2\ttau1\ttau2\tComment\n"
    )
    return head + write_rows(scale(position=DEGREES), "\t")


def german_excel():
    names = "Zeit [ms];Winkel q1 [°];Winkel q2 [°];Moment 1 [Nm];Moment 2 [Nm]"
    text = f"sep=;\r\n{names}\r\n{write_rows(scale(1e3, DEGREES), ';', ',')}"
    return text.encode("cp1252")


def asam():
    """Measurement tools of cars: names, units below them, and no decimal point where a number is whole."""
    return "time;q1;q2;tau1;tau2\ns;°;°;Nm;Nm\n" + write_rows(scale(position=DEGREES), ";")


def data_inspector():
    """Simulink's Data Inspector: rows of metadata below the names."""
    return (
        "time,q1,q2,tau1,tau2\n,Type: double,Type: double,Type: double,Type: double\n"
        ",Unit: deg,Unit: deg,Unit: N*m,Unit: N*m\n,Interp: zoh,Interp: zoh,Interp: zoh,Interp: zoh\n"
    ) + write_rows(scale(position=DEGREES))


def pandas():
    """DataFrame.to_csv: an index without a name."""
    rows = write_rows(WHOLE).splitlines()
    return f",{','.join(OWN)}\n" + "".join(f"{k},{row}\n" for k, row in enumerate(rows))


def pandas_dates():
    """The same with a DatetimeIndex: whole seconds have no digits behind the point."""
    start = datetime(2024, 5, 1, 12)  # noqa: DTZ001  as pandas writes it, without a zone
    stamps = [f"{start + timedelta(microseconds=round(1e6 * t))}" for t in TIME]
    rows = write_rows(WHOLE[:, 1:]).splitlines()
    return "time,q1,q2,tau1,tau2\n" + "".join(
        f"{stamp},{row}\n" for stamp, row in zip(stamps, rows, strict=True)
    )


def savetxt(tmp_path):
    np.savetxt(tmp_path / "text", WHOLE, header=" ".join(OWN))
    return (tmp_path / "text").read_bytes()


def spreadsheet():
    """SciDAVis, QtiPlot, Origin: names, tabs, a comment row."""
    return "\t".join(OWN) + "\n" + write_rows(WHOLE, "\t")


@pytest.mark.parametrize(
    "case",
    [
        ("plotjuggler.csv", plot_juggler, {}),
        ("echo.csv", rostopic, {}),
        ("franka.csv", libfranka, {}),
        ("robot_data.csv", rtde, {}),
        ("scope.csv", twincat, MAP),
        (
            "test.lvm",
            labview,
            {
                "time": (("X_Value",), "s"),
                "position": (("q1", "q2"), "deg"),
                "torque": (("tau1", "tau2"), "N m"),
            },
        ),
        (
            "Messung.csv",
            german_excel,
            {
                "time": (("Zeit",), "ms"),
                "position": (("Winkel q1", "Winkel q2"), "deg"),
                "torque": (("Moment 1", "Moment 2"), "N m"),
            },
        ),
        ("canape.csv", asam, {}),
        ("inspector.csv", data_inspector, {}),
        ("frame.csv", pandas, {}),
        ("dates.csv", pandas_dates, {}),
        ("table.dat", savetxt, {}),
        ("table.tsv", spreadsheet, {}),
    ],
    ids=lambda case: case[0],
)
@pytest.mark.parametrize("packed", [False, True], ids=["", "gz"])
def test_texts_of_programs(make_robot, tmp_path, case, packed):
    name, build, log = case
    content = build(tmp_path) if build is savetxt else build()
    content = content if isinstance(content, bytes) else content.encode()
    path = tmp_path / (f"{name}.gz" if packed else name)
    path.write_bytes(gzip.compress(content) if packed else content)
    recording = read_recording(path, make_robot(constants=(1.0, 1.0), direct=(True, True), **log))
    np.testing.assert_allclose(np.diff(recording.time), np.diff(TIME), atol=1e-6)
    np.testing.assert_allclose(recording.position, Q, atol=1e-7)
    np.testing.assert_allclose(recording.torque, TAU, atol=1e-7)


def dspace():
    """ControlDesk's .mat: X and Y of a capture are arrays of structures with names and data."""
    y = np.zeros((1, 4), dtype=[("Name", object), ("Data", object)])
    for k, values in enumerate((*Q.T, *TAU.T)):
        y[0, k] = f"channel {k}", values
    return {"capture": {"X": {"Name": "time", "Data": TIME}, "Y": y}}


@pytest.mark.parametrize(
    ("content", "log"),
    [
        (
            lambda: {
                "simout": {"time": TIME, "signals": {"values": np.hstack([Q, TAU])}},
                "q": Q,
                "tau": TAU,
            },
            {"time": (("simout.time",), "s")},
        ),
        (lambda: {"tout": TIME, "q": Q.T, "tau": TAU}, {"time": (("tout",), "s")}),
        (
            dspace,
            {
                "time": (("capture.X.Data",), "s"),
                "position": (("capture.Y[0].Data", "capture.Y[1].Data"), "rad"),
                "torque": (("capture.Y[2].Data", "capture.Y[3].Data"), "N m"),
            },
        ),
    ],
    ids=["to-workspace", "arrays", "dspace"],
)
def test_matlab_files_of_programs(make_robot, tmp_path, content, log):
    savemat(tmp_path / "log.mat", content())
    recording = read_recording(tmp_path / "log.mat", make_robot(**log))
    np.testing.assert_allclose(recording.position, Q)
    np.testing.assert_allclose(recording.torque, TAU)


@pytest.mark.parametrize("kind", [b"timetable", b"table", b"timeseries"])
def test_objects_of_matlab_are_refused_with_what_to_save(make_robot, tmp_path, kind):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        file["T"] = np.zeros((1, 6), dtype=np.uint32)
        file["T"].attrs["MATLAB_class"] = kind
    found = refuse(LogError, read_recording, tmp_path / "log.mat", make_robot())["log.format"]
    assert "in the MATLAB file, but 'T', as of a timetable" in found
    assert "save('log.mat', '-struct', 'log')" in found


@pytest.mark.parametrize(
    ("suffix", "remedy"),
    [
        (".bag", "rosbags-convert"),
        (".xlsx", "as .csv"),
        (".tdms", ".lvm"),
        (".mf4", "export it"),
        (".svdx", "TwinCAT"),
    ],
)
def test_files_of_other_programs_say_what_to_do(make_robot, tmp_path, suffix, remedy):
    (tmp_path / f"log{suffix}").write_bytes(b"content")
    found = refuse(LogError, read_recording, tmp_path / f"log{suffix}", make_robot())
    assert remedy in found["log.unknown-suffix"]


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        (
            "t;q1;q2\n0,0;1,234;2,345\n".replace("0,0", "1,000") * 1,
            "log.separator",
            "may have a decimal comma",
        ),
        ("t,q1\n0,0,1,5\n0,1,1,6\n", "log.separator", "semicolons or tabs"),
        ("t,q1,t\n0,1,0\n1,2,3\n", "log.duplicate-column", "'t'"),
        ("t;q1\n0;1\n1;1_0\n2;x\n", "log.not-a-number", "decimal point"),
        ("time,q1\n2024-05-01 12:00:00,1\n2024-05-01 12:00:99,1\n", "log.not-a-number", "there is no date"),
        ("time,q1\n" + 25 * "2024-05-01 12:00:00,1\n" + "1.5,1\n", "log.not-a-number", "no date as"),
        ("\x00\x01t,q\n", "log.format", "text"),
    ],
)
def test_tables_that_could_be_read_in_two_ways_are_refused(make_robot, tmp_path, text, code, words):
    (tmp_path / "log.csv").write_text(text)
    assert words in refuse(LogError, read_recording, tmp_path / "log.csv", make_robot())[code]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
@pytest.mark.parametrize("decimal", [".", ","])
def test_any_way_of_writing_a_table(make_robot, tmp_path, encoding, separator, decimal):
    if separator == decimal:
        pytest.skip("commas twice")
    names = ("t [ms]", "q1 [°]", "q2 [°]", "tau1 [NM]", "tau2 [NM]")
    lines = ["Prüfstand 3", "", separator.join(names), "# comment"]
    text = "\r\n".join(lines) + "\r\n" + write_rows(scale(1e3, DEGREES), separator, decimal)
    (tmp_path / "log.txt").write_bytes(text.encode(encoding))
    recording = read_recording(tmp_path / "log.txt", make_robot())
    np.testing.assert_allclose(recording.position, Q, atol=1e-9)
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
    said = [entry.text for entry in recording.notices if entry.code == "log.layout"]
    assert any("lines above the heading" in text for text in said)
    assert any("decimal commas" in text for text in said) == (decimal == ",")


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("rate", [50.0, 250.0, 2000.0])
@pytest.mark.parametrize("speed", [False, True])
def test_units_of_time_that_are_not_stated(make_robot, write_npz, unit, rate, speed):
    time = np.arange(2000) / rate
    q = np.column_stack([np.sin(2.0 * time), 0.3 * np.cos(5.0 * time)])
    scale = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[unit]
    dq = {"dq": np.column_stack([2.0 * np.cos(2.0 * time), -1.5 * np.sin(5.0 * time)])} if speed else {}
    path = write_npz(t=time * scale, q=q, tau=q, **dq)
    if (unit, rate, speed) == ("ms", 2000.0, False):
        # Steps of 0.5 could be seconds of a slow log.
        assert "its steps are 0.5" in refuse(LogError, read_recording, path, make_robot())["log.time-unit"]
        return
    recording = read_recording(path, make_robot())
    np.testing.assert_allclose(recording.time, time, rtol=1e-9)
    assert ("log.time-unit" in tell(recording.notices)) == (unit != "s")


@pytest.mark.parametrize(
    ("name", "size"),
    [
        *(("timestamp", 1.0), ("Time", 1.0), ("time_s", 1.0), ("timestamp_ms", 1e3), ("t_us", 1e6)),
        *(("Timestamp_ns", 1e9), ("time_usec", 1e6), ("clock_sec", 1.0), ("stamp [ms]", 1e3)),
    ],
)
def test_clocks_by_other_names(make_robot, write_npz, tmp_path, name, size):
    text = f"{name},q1,q2,tau1,tau2\n" + write_rows(WHOLE * [size, 1.0, 1.0, 1.0, 1.0], ",", ".")
    (tmp_path / "log.csv").write_text(text)
    np.testing.assert_allclose(read_recording(tmp_path / "log.csv", make_robot()).time, TIME, atol=1e-9)
    # Two of them could both be meant.
    found = refuse(LogError, read_recording, write_npz(Time=TIME, stamp=TIME, q=Q, tau=TAU), make_robot())
    assert "'Time' or 'stamp'" in found["new.ambiguous-column"]


def test_a_counter_or_a_time_of_several_units_is_asked_for(make_robot, write_npz):
    k = np.arange(1000.0)
    q = np.column_stack([np.sin(k / 300.0), np.cos(k / 300.0)])
    found = refuse(LogError, read_recording, write_npz(t=k, q=q, tau=q), make_robot())
    assert "--sample-rate HZ" in found["log.time-unit"]
    slow = np.column_stack([1e-6 * k, 1e-6 * k])
    found = refuse(LogError, read_recording, write_npz(t=80.0 * k, q=slow, tau=q), make_robot())
    assert "its steps are 80" in found["log.time-unit"]


@pytest.mark.parametrize("rate", [50.0, 333.0, 1000.0])
def test_times_by_a_sample_rate(make_robot, write_npz, rate):
    robot = make_robot()
    robot = replace(robot, log=replace(robot.log, sample_rate=rate))
    for own in ({}, {"t": np.zeros(60)}, {"time": np.arange(60.0)}):
        recording = read_recording(write_npz(q=Q, tau=TAU, **own), robot)
        np.testing.assert_allclose(recording.time, np.arange(60) / rate)
        assert f"at {rate:g} Hz" in tell(recording.notices)["log.sample-rate"]


@pytest.mark.parametrize("names", [["t"], ["q1"], ["tau2"], ["t", "q1"]])
@pytest.mark.parametrize("places", [[7], [0, 30], [59, 20, 21]])
@pytest.mark.parametrize("word", ["", "NaN", "#N/A", "null"])
def test_single_missing_values_are_gaps(make_robot, tmp_path, names, places, word):
    rows = [[f"{value:.9g}" for value in row] for row in WHOLE]
    for place in places:
        for name in names:
            rows[place][OWN.index(name)] = word
    text = "t [s],q1 [rad],q2 [rad],tau1 [N m],tau2 [N m]\n" + "".join(f"{','.join(row)}\n" for row in rows)
    (tmp_path / "log.csv").write_text(text)
    (recording,) = read_recordings([tmp_path / "log.csv"], make_robot())
    said = tell(recording.notices)["log.missing"]
    assert f"{len(places)} of 60 samples lack a value, the first is sample {min(places)}" in said
    time = recording.time
    moved = np.column_stack([np.sin(3.0 * time), 0.5 * np.cos(2.0 * time)])
    np.testing.assert_allclose(recording.position, moved, atol=1e-4)


@pytest.mark.parametrize("lengths", [(40, 50), (60, 20, 30), (17, 17, 17, 17)])
def test_episodes_of_a_file_are_logs(make_robot, write_npz, lengths):
    rng = np.random.default_rng(3)
    time = np.concatenate([np.arange(length) * 0.01 + 0.02 for length in lengths])
    q, tau = rng.normal(size=(2, sum(lengths), 2)).cumsum(axis=1)
    found = read_recordings([write_npz(t=time, q=q, tau=tau)], make_robot())
    assert [len(entry.time) for entry in found] == list(lengths)
    assert f"read as {len(lengths)} logs" in tell(found[0].notices)["log.episodes"]
    assert "log.episodes" not in tell(found[1].notices)
    np.testing.assert_array_equal(np.concatenate([entry.torque for entry in found])[:5], tau[:5])
    # Each is known by its place in the file, by which a result finds it again.
    sources, told = [entry.source for entry in found], describe_runs(found)
    again = read_recorded_runs(sources[::-1], {"log_digests": told["log_digests"][::-1]}, make_robot())
    assert [len(entry.time) for entry in again] == list(lengths[::-1])
    alone = describe_runs(found[1:2])
    overlaps = [measure_overlap(entry, sources[1:2], alone) for entry in found]
    assert [overlap > 0.0 for overlap in overlaps] == [k == 1 for k in range(len(found))]


@pytest.mark.parametrize("channel", ["q", "tau", "both"])
@pytest.mark.parametrize("size", [1e-310, 1e-200, 1e-150])
def test_values_beyond_any_sensor_are_refused(make_robot, write_npz, channel, size):
    q, tau = Q.copy(), TAU.copy()
    for name, values in (("q", q), ("tau", tau)):
        if channel in (name, "both"):
            values[:, 1] *= size
    found = refuse(LogError, read_recording, write_npz(t=TIME, q=q, tau=tau), make_robot())
    assert "state the unit or a factor" in found["log.too-small"]
