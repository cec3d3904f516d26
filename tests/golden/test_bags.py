"""ROS 2 recordings of a UR10 and a Panda (inverse-dynamics-solver, BSD-3-Clause), read with named settings.

Their messages are written as a table first, as PlotJuggler does, a column a joint. First moments of the UR10
follow from masses and centres of mass that Universal Robots publish ("DH Parameters for calculations of
kinematics and dynamics"), in frames of standard DH.
"""

import json
import sqlite3
import struct

import numpy as np
import pytest

import symid
from symid.cli.main import run

# kg, and m along the links' x axes; joints 4 to 6 stand near the axis of joint 4.
UR10_MASSES = (7.1, 12.7, 4.27, 2.0, 2.0, 0.365)
UPPER_ARM, FOREARM, CENTRE_2, CENTRE_3 = -0.612, -0.5723, 0.38, 0.24


def read_joint_state(data):
    """Return names, positions, velocities and efforts of a sensor_msgs/JointState in CDR (little-endian)."""
    place = 4 + 8

    def read(kind, count=1):
        nonlocal place
        width = struct.calcsize(kind)
        place = 4 + -(-(place - 4) // width) * width
        values = struct.unpack_from(f"<{count}{kind}", data, place)
        place += count * width
        return values

    def read_text():
        return b"".join(read("c", *read("I"))).rstrip(b"\0").decode()

    read_text()
    names = [read_text() for _ in range(*read("I"))]
    return names, *(read("d", *read("I")) for _ in range(3))


def write_table(bag, path):
    """Write the messages of a bag as a table."""
    with sqlite3.connect(f"file:{bag}?mode=ro&immutable=1", uri=True) as base:
        messages = base.execute("select timestamp, data from messages order by timestamp").fetchall()
    rows = []
    for stamp, data in messages:
        names, *columns = read_joint_state(data)
        rows.append([1e-9 * stamp, *(value for column in columns for value in column)])
    kinds = ("position", "velocity", "effort")
    heading = ["__time", *(f"/joint_states/{name}/{kind}" for kind in kinds for name in names)]
    lines = [",".join(heading), *(",".join(map(repr, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def call_json(capsys, *arguments):
    capsys.readouterr()
    code = run([*map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.fixture
def table(shared_data, tmp_path):
    return lambda name: write_table(shared_data / "bags" / f"{name}.db3", tmp_path / f"{name}.csv")


def test_efforts_of_the_ur10_are_torques(capsys, table):
    log, options = table("ur10"), ["--settings", "bag", "--estimator", "wls", "--cutoff", "10"]
    options += ["--decimate", "6", "--friction", "viscous_coulomb_offset"]
    code, answer = call_json(capsys, "identify", "ur10", log, *options)
    assert code == 0
    found = {entry["name"]: entry["value"] for entry in answer["result"]["parameters"]}
    outer = sum(UR10_MASSES[2:])
    assert found["MXR2"] == pytest.approx(
        UR10_MASSES[1] * (UPPER_ARM + CENTRE_2) + UPPER_ARM * outer, rel=0.04
    )
    outer -= UR10_MASSES[2]
    assert found["MXR3"] == pytest.approx(UR10_MASSES[2] * (FOREARM + CENTRE_3) + FOREARM * outer, rel=0.04)
    # Read as motor currents, they are beyond what the joints can do.
    for settings, beyond in (("ros", True), ("bag", False)):
        _, answer = call_json(capsys, "check", "ur10", log, "--settings", settings)
        assert ("log.torque-beyond-limit" in {entry["code"] for entry in answer["warnings"]}) is beyond


@pytest.mark.parametrize(("robot", "settings"), [("ur10", "bag"), ("ur10", "ros"), ("panda", "ros")])
def test_a_bag_is_read_as_a_table_made_of_it(shared_data, table, robot, settings):
    model = symid.load(robot, settings=settings)
    bag = symid.read_log(shared_data / "bags" / f"{robot}.db3", model)
    made = symid.read_log(table(robot), model)
    assert np.array_equal(bag.q, made.q)
    assert np.array_equal(bag.tau, made.tau)
    assert np.allclose(np.diff(bag.time), np.diff(made.time), atol=1e-2)


def test_the_recording_of_the_panda_is_read(capsys, table):
    code, answer = call_json(capsys, "check", "panda", table("panda"), "--settings", "ros")
    assert code == 0
    assert answer["result"]["logs"][0]["samples"] == 727
    codes = {entry["code"] for entry in answer["warnings"]}
    assert not codes & {"log.torque-beyond-limit", "log.torque-sign", "log.swapped-joints"}
