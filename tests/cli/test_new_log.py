"""`symid new --log`: which column is what, what was taken for granted, and what is refused."""

import numpy as np
import pytest

import symid
from symid.logs.reader import read_recording
from symid.robot.description import Drive, Processing
from symid.robot.toml_reader import read_robot
from tests.calls import ask, call, do, list_codes, refuse

TABLE = "joint,alpha,a,d,theta\nshoulder,0,0,0,q\nelbow_joint,0,0.5,0,q\nslide,0,0.3,q,0\n"
SOURCE = ("--from-dh", "rows.csv", "--convention", "modified", "--gravity", "0,0,-9.81")
PLAIN = "time [s],shoulder pos [deg],elbow pos [deg],slide pos [mm],tau0 [N m],tau1 [N m],tau2 [N]"
TWICE = ("--columns", "velocity=tau0,tau1,tau2", "--units")
SI = np.array([np.pi / 180, np.pi / 180, 1e-3])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rows.csv").write_text(TABLE)
    return tmp_path


def write_log(folder, heading, name="log.csv", separator=","):
    time = np.arange(400) * 0.01
    moves = [np.sin((0.3 + 0.1 * number) * 6.0 * time) * 10.0 for number in range(heading.count(separator))]
    lines = [separator.join(f"{value:.6f}" for value in row) for row in zip(time, *moves, strict=True)]
    (folder / name).write_text("\n".join((heading, *lines)) + "\n")
    return np.array(moves).T


def order(*arguments, source=SOURCE, log="log.csv"):
    return ("new", "arm.toml", *source, "--log", log, *arguments)


def find_only(answer):
    (error,) = answer["errors"]
    return error


def test_columns_are_known_by_names_of_joints_and_by_numbers(folder):
    values = write_log(folder, PLAIN)
    answer = do(*order("--friction", "coulomb-viscous"))
    assert answer["result"]["log"] == {
        "file": "log.csv",
        "preset": None,
        "columns": {
            "time": ["time"],
            "position": ["shoulder pos", "elbow pos", "slide pos"],
            "torque": ["tau0", "tau1", "tau2"],
        },
        "units": {"time": "s", "position": "deg, deg, mm", "torque": "N m, N m, N"},
        "unused": [],
    }
    assert list_codes(answer) == ["new.assumed-order"]
    (told,) = answer["warnings"]
    assert told["text"].endswith(": 0 is 'shoulder', 1 is 'elbow_joint', 2 is 'slide'")
    assert (told["file"], told["line"]) == ("log.csv", 1)
    recording = read_recording(folder / "log.csv", read_robot(folder / "arm.toml"))
    np.testing.assert_allclose(recording.position, values[:, :3] * SI, atol=1e-6)
    np.testing.assert_allclose(recording.torque, values[:, 3:], atol=1e-5)


def test_what_was_assumed_stands_in_the_file(folder):
    write_log(folder, PLAIN)
    do(*order("--friction", "coulomb-viscous", "--gear", "50,-30,200", "--rotors"))
    text = " ".join((folder / "arm.toml").read_text().partition("name =")[0].replace("#", "").split())
    assert "0 is 'shoulder'" in text
    assert "positions and torques are assumed to be on the joint side" in text
    robot = read_robot(folder / "arm.toml")
    assert [joint.drive for joint in robot.joints] == [
        Drive(gear=gear, has_rotor=True) for gear in (50.0, -30.0, 200.0)
    ]
    assert {joint.friction.law for joint in robot.joints} == {"coulomb-viscous"}
    # What was found by hand for one log does not belong into a robot file: it is chosen from each log.
    assert robot.processing == Processing(automatic=True)
    assert "[processing]" not in (folder / "arm.toml").read_text()


def test_what_real_robots_have_is_asked_for(folder):
    write_log(folder, PLAIN)
    answer = do(*order("--gear", "50"))
    assert list_codes(answer) == ["new.no-friction", "new.no-rotor", "new.assumed-order", "new.assumed-side"]


def test_currents_need_torque_constants(folder):
    heading = "t [s],q1 [rad],q2 [rad],q3 [mm],motor current 1 [mA],motor current 2 [mA],motor current 3 [mA]"
    values = write_log(folder, heading)
    code, answer = ask(*order())
    assert code == 3
    assert find_only(answer)["code"] == "new.torque-constant"
    assert "give --torque-constant K1,K2,K3" in find_only(answer)["text"]
    assert not (folder / "arm.toml").exists()
    code, answer = ask(*order("--torque-constant", "0.1,0.2,0.05"))
    assert (code, find_only(answer)["code"]) == (3, "new.torque-constant")
    assert "no gear is stated of 'shoulder', 'elbow_joint', 'slide': " in find_only(answer)["text"]
    assert "--gear 1: direct drives" in find_only(answer)["text"]
    do(*order("--torque-constant", "0.1,0.2,0.05", "--gear", "1,1,400"))
    assert (folder / "arm.toml").read_text().count("\ngear = 1\n") == 2
    assert "factor" not in (folder / "arm.toml").read_text().partition("torque = {")[2]
    recording = read_recording(folder / "log.csv", read_robot(folder / "arm.toml"))
    np.testing.assert_allclose(recording.torque, values[:, 3:] * 1e-3 * [0.1, 0.2, 20.0], atol=1e-6)


def test_options_name_columns_and_units(folder):
    write_log(folder, "stamp [s],a,b,c,d [N m],e [N m],f [N],cmd position [deg]")
    options = ("--columns", "position=a,b,c", "--columns", "torque=d,e,f", "--units", "position=SI")
    answer = do(*order(*options))
    assert answer["result"]["log"]["columns"]["position"] == ["a", "b", "c"]
    assert answer["result"]["log"]["unused"] == ["cmd position"]
    assert "new.unused-columns" in list_codes(answer)


@pytest.mark.parametrize("name", ["dq", "ddq", "tau_ff"])
def test_channels_that_an_identification_reads_are_not_called_unused(folder, name):
    """What `new` calls unused is what `identify` calls so."""
    units = {"dq": ("rad/s", "m/s"), "ddq": ("rad/s^2", "m/s^2"), "tau_ff": ("N m", "N")}[name]
    extra = ",".join(f"{name}{k} [{units[k == 3]}]" for k in (1, 2, 3))
    write_log(folder, f"t [s],q1 [rad],q2 [rad],q3 [m],tau1 [N m],tau2 [N m],tau3 [N],{extra},room [degC]")
    answer = do(*order())
    recording = read_recording(folder / "log.csv", read_robot(folder / "arm.toml"))
    assert answer["result"]["log"]["unused"] == [*recording.extras] == ["room"]
    (told,) = (entry for entry in answer["warnings"] if entry["code"] == "new.unused-columns")
    assert told["text"].startswith("columns that are not used: room;")


def test_units_are_given_for_each_column(folder):
    values = write_log(folder, "time [s],q1,q2 [rad],q3,tau0 [N m],tau1 [N m],tau2 [N]")
    answer = do(*order("--units", "position=deg,deg,mm"))
    assert answer["result"]["log"]["units"]["position"] == "deg, deg, mm"
    recording = read_recording(folder / "log.csv", read_robot(folder / "arm.toml"))
    np.testing.assert_allclose(recording.position, values[:, :3] * SI, atol=1e-6)


@pytest.mark.parametrize(
    "case",
    [
        (
            "t [s],q1 [rad],q2 [rad],tau1 [N m],tau2 [N m],tau3 [N]",
            "new.unknown-column",
            "of joint 'shoulder'",
        ),
        (f"{PLAIN},shoulder angle [deg]", "new.ambiguous-column", "'shoulder pos' or 'shoulder angle'"),
        (PLAIN.replace("time", "x"), "new.unknown-column", "recognised as time"),
        (
            PLAIN.replace("time [s]", "x"),
            "new.unknown-column",
            "recognised as time: give --columns time=NAME",
        ),
        (f"{PLAIN},stamp [s]", "new.ambiguous-column", "time could be 'time' or 'stamp'"),
        (PLAIN.replace(" [deg]", ""), "new.no-unit", "for 'shoulder pos', 'elbow pos'; "),
        (PLAIN.replace("time [s]", "time"), "new.no-unit", "as in time [s], or give --units time="),
        (PLAIN.replace("deg", "gradians"), "new.wrong-unit", "unknown unit 'gradians'"),
        (PLAIN.replace("deg", "N m"), "new.wrong-unit", "a unit of torque; expected one of rad"),
        (PLAIN.replace("[mm]", "[deg]"), "new.wrong-unit", "a unit of angle; expected one of m, cm"),
        (PLAIN.replace("tau0 [N m]", "tau0 [%]"), "new.wrong-unit", "one count of 'tau0'"),
        (PLAIN.replace("tau0 [N m]", "tau0 [A]"), "new.torque-constant", "no torque constant"),
        (PLAIN.replace("tau2", "tau5"), "new.unknown-column", "torque of joint 'shoulder' or torque of"),
        (PLAIN.replace("slide", "wrist"), "new.unknown-column", "position of joint 'slide': give --columns"),
        (PLAIN.replace("slide", "wrist"), "new.unknown-column", "--tip LINK"),
        (PLAIN.replace("shoulder pos", "target shoulder pos"), "new.unknown-column", "of joint 'shoulder'"),
    ],
)
def test_what_is_not_certain_is_refused(folder, case):
    heading, code, words = case
    write_log(folder, heading)
    exit_code, answer = ask(*order())
    assert exit_code == 3
    texts = {entry["text"] for entry in answer["errors"] if entry["code"] == code}
    assert any(words in text for text in texts), answer["errors"]
    assert {(entry["file"], entry["line"]) for entry in answer["errors"]} == {("log.csv", 1)}
    assert not (folder / "arm.toml").exists()


def test_all_that_is_wrong_is_said_at_once(folder):
    write_log(folder, "x,q1,q2,q3,tau1 [N m],tau1b [N m],tau3 [N]")
    assert refuse(*order()) == (3, ["new.unknown-column", "new.no-unit", "new.unknown-column"])


@pytest.mark.parametrize(
    "case",
    [
        (("--columns", "position=a,b"), 3, "new.column-count", "2 columns; give one for each of 'shoulder'"),
        (("--columns", "time=time,time"), 3, "new.column-count", "2 columns; give one"),
        (("--columns", "time=tim"), 3, "new.no-column", "did you mean 'time'?"),
        ((*TWICE, "velocity=SI"), 3, "new.column-twice", "would be torque and velocity"),
        (("--columns", "position=tau0,tau1,tau2"), 3, "new.wrong-unit", "a unit of torque"),
        (("--units", "position=dgr"), 3, "new.wrong-unit", "did you mean deg"),
        (("--units", "position=deg,mm"), 3, "new.unit-count", "2 units for 'shoulder pos', 'elbow pos'"),
        (("--units", "position=deg,mm,mm"), 3, "new.wrong-unit", "'elbow pos' is in 'mm', a unit of length"),
        (("--units", "velocity=deg/s"), 3, "new.unit-of-nothing", "--units velocity: "),
        (("--torque-constant", "nan"), 2, "usage.numbers", "such as --torque-constant 0.12,0.12,0.05"),
        (("--columns", "posision=a"), 2, "usage.quantity", "did you mean position"),
        (("--columns", "position"), 2, "usage.quantity", "such as --columns position=NAME,NAME"),
        (("--units", "time=s", "--units", "time=ms"), 2, "usage.quantity", "given twice"),
        (("--gear", "100,x,3"), 2, "usage.numbers", "--gear 100,x,3: expected numbers other than 0"),
        (("--gear", "0"), 2, "usage.numbers", "other than 0"),
        (("--gear", "1,2"), 2, "usage.completion", "2 numbers for 3 joints (shoulder, elbow_joint, slide)"),
        (("--torque-constant", "1,2"), 2, "usage.completion", "--torque-constant: 2 numbers"),
    ],
)
def test_options_that_do_not_fit_are_refused(folder, case):
    options, exit_code, code, words = case
    write_log(folder, PLAIN)
    found, answer = ask(*order(*options))
    assert found == exit_code
    assert code in list_codes(answer, "errors")
    assert any(words in entry["text"] for entry in answer["errors"]), answer["errors"]
    assert not (folder / "arm.toml").exists()


def test_a_robot_file_is_copied_as_it_is(folder):
    write_log(folder, PLAIN)
    code, answer = ask(*order("--rotors", source=("--from", "scara")))
    assert code == 2
    assert find_only(answer)["code"] == "usage.copied"
    assert find_only(answer)["text"].startswith("--log, --rotors: a robot file is copied")
    assert not (folder / "arm.toml").exists()


def test_what_the_source_states_is_not_changed(folder, project):
    source = ("--from-urdf", str(project / "docs" / "own_robot" / "arm.urdf"))
    log = str(project / "docs" / "own_robot" / "training.csv")
    code, answer = ask(*order("--gear", "100", source=source, log=log))
    assert code == 2
    assert find_only(answer)["code"] == "usage.completion"
    assert "joint 'elbow' has the gear 80 in its source, not 100" in find_only(answer)["text"]


def test_a_rotor_of_the_source_wants_its_own_gear(folder):
    text = """<robot name="arm"><link name="base"/><link name="upper"/>
    <joint name="turn" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
    <transmission name="drive"><joint name="turn"/><actuator name="motor">
    <motorInertia>0.001</motorInertia></actuator></transmission></robot>"""
    (folder / "arm.urdf").write_text(text)
    code, out, _ = call("new", "arm.toml", "--from-urdf", "arm.urdf", "--gear", "50", "--json")
    assert (code, "has a rotor inertia in its source, but no gear" in out) == (2, True)


def test_the_log_is_an_input(folder):
    (folder / "log.toml").write_text("")
    assert refuse("new", "log.toml", *SOURCE, "--log", "log.toml", "--force") == (3, ["output.is-input"])


PRESETS = {
    "ur-rtde": [
        "timestamp",
        *(f"actual_q_{k}" for k in range(3)),
        *(f"actual_current_{k}" for k in range(3)),
    ],
    "franka": ["time", *(f"q[{k}]" for k in range(3)), *(f"tau_J[{k}]" for k in range(3))],
    "ros": ["%time", *(f"field.position{k}" for k in range(3)), *(f"field.effort{k}" for k in range(3))],
    "symid": ["t [s]", "q1 [rad]", "q2 [rad]", "q3 [m]", "tau1 [N m]", "tau2 [N m]", "tau3 [N]"],
}


@pytest.mark.parametrize("preset", PRESETS)
def test_logs_of_known_programs_are_known(folder, preset):
    heading = ",".join(PRESETS[preset])
    write_log(folder, heading)
    text = (folder / "log.csv").read_text().splitlines()
    if preset in {"ros", "franka"}:  # nanoseconds, milliseconds
        scale = 1e9 if preset == "ros" else 1e3
        rows = [line.split(",") for line in text[1:]]
        text[1:] = [",".join((f"{float(row[0]) * scale:.0f}", *row[1:])) for row in rows]
        (folder / "log.csv").write_text("\n".join(text) + "\n")
    constants = ("--torque-constant", "0.1,0.1,0.1", "--gear", "1") if preset == "ur-rtde" else ()
    answer = do(*order(*constants))
    assert answer["result"]["log"]["preset"] == preset
    robot = read_robot(folder / "arm.toml")
    assert (robot.log.preset, robot.log.position) == (preset, None)
    assert read_recording(folder / "log.csv", robot).period == pytest.approx(0.01)
    assert ("new.preset" in list_codes(answer)) == (preset != "symid")


@pytest.mark.parametrize(
    ("unit", "codes"), [("foo", ["new.wrong-unit"] * 2), ("A", ["new.mixed-units", "new.torque-constant"])]
)
def test_names_of_symid_with_other_units_are_read_as_any_others(folder, unit, codes):
    write_log(folder, ",".join(PRESETS["symid"]).replace("N m", unit))
    assert refuse(*order()) == (3, codes)


def test_a_known_name_with_a_unit_of_its_own_is_read_as_it_says(folder):
    heading = ",".join(name.replace("time", "time [s]").replace("2]", "2] [m]") for name in PRESETS["franka"])
    write_log(folder, heading)
    code, answer = ask(*order())
    assert code == 3
    assert "new.no-unit" in list_codes(answer, "errors")
    assert "for 'q[0]', 'q[1]'; " in answer["errors"][0]["text"]


def test_arrays_and_single_joints_need_no_numbers(folder):
    write_log(folder, PLAIN)
    time = np.arange(400) * 0.01
    moves = np.sin(time[:, None] * [1.0, 2.0, 3.0])
    units = np.array(["time [s]", "position [SI]", "effort [SI]"])
    np.savez(folder / "log.npz", time=time, position=moves, effort=moves, units=units)
    assert do(*order(log="log.npz"))["result"]["log"]["columns"]["torque"] == ["effort"]
    (folder / "rows.csv").write_text("\n".join(TABLE.splitlines()[:2]) + "\n")
    write_log(folder, "time [s],angle [deg],torque [N m]")
    (folder / "arm.toml").unlink()
    assert do(*order())["result"]["log"]["columns"]["position"] == ["angle"]


def test_a_wrong_unit_is_seen_at_once(folder, project):
    pages = project / "docs" / "own_robot"
    options = ("--units", "position=rad", "--torque-constant", "0.1")
    answer = do(
        *order(*options, source=("--from-urdf", str(pages / "arm.urdf")), log=str(pages / "training.csv"))
    )
    texts = [entry["text"] for entry in answer["warnings"] if "beyond its limits" in entry["text"]]
    assert len(texts) == 3
    assert "beyond its limits" not in (folder / "arm.toml").read_text()


@pytest.mark.parametrize("rows", [0, 1])
def test_a_log_without_enough_rows_is_refused(folder, rows):
    write_log(folder, PLAIN)
    lines = (folder / "log.csv").read_text().splitlines()
    (folder / "log.csv").write_text("\n".join(lines[: rows + 1]) + "\n")
    assert refuse(*order()) == (3, ["log.time-order"])
    assert not (folder / "arm.toml").exists()


def test_columns_apart_by_spaces_need_a_name_each(folder):
    (folder / "log.csv").write_text("time [s] q1 [rad]\n0 1.5 2\n1 2.5 3\n")
    code, answer = ask(*order())
    assert (code, list_codes(answer, "errors")) == (3, ["log.line-length"] * 2)
    assert "3 cells, the heading names 2 columns" in answer["errors"][0]["text"]


def name_joints(folder, *names):
    rows = [f"{name},0,0,0,q" for name in names]
    (folder / "rows.csv").write_text("\n".join(("joint,alpha,a,d,theta", *rows)) + "\n")


def test_the_name_of_a_joint_is_no_unit(folder):
    """Torques of the joint A, in N m or whatever, were taken for its current in ampere."""
    name_joints(folder, "A")
    write_log(folder, "stamp [s],pos_A [rad],tau_A")
    assert refuse(*order("--torque-constant", "0.1")) == (3, ["new.no-unit"])
    assert do(*order("--units", "torque=Nm"))["result"]["log"]["units"]["torque"] == "Nm"


def test_mixed_currents_are_refused(folder):
    write_log(folder, PLAIN.replace("tau0 [N m]", "tau0 [A]").replace("tau1 [N m]", "tau1 [mA]"))
    assert refuse(*order("--torque-constant", "0.1", "--gear", "1")) == (3, ["new.mixed-units"])


def test_a_urdf_reads_the_columns_that_a_new_file_would(folder, project):
    pages = project / "docs" / "own_robot"
    text = (pages / "training.csv").read_text().replace("current [A]", "torque [N m]")
    (folder / "log.csv").write_text(text)
    log = symid.read_log("log.csv", symid.load(pages / "arm.urdf"))
    assert log.q.shape[1] == 3
    assert "new.assumed-side" in {notice.code for notice in log.notices}
    found = refuse("check", pages / "arm.urdf", pages / "training.csv")
    assert found == (3, ["new.torque-constant", "log.no-map"])
