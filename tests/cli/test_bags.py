"""Bags of real robots, read, resampled where that is needed, and identified by one command."""

import sysconfig
from pathlib import Path

import numpy as np
import pytest

import symid
from tests.calls import do, find_texts

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

STATE = "sensor_msgs/msg/JointState"
ROBOTS = {
    "ur10": ("ur_description/urdf/ur10_robot.urdf", ()),
    "panda": ("panda_description/urdf/panda.urdf", ("--tip", "panda_link7")),
}
# What is chosen from logs takes long, and is the same for the same samples.
QUICK = ("--set", "processing.automatic=false", "--cutoff", "5", "--decimate", "15", "--estimator", "ols")


@pytest.fixture(params=ROBOTS)
def bag(request, shared_data):
    """Return the name of a robot, its URDF, options, and its bag, or skip."""
    folder = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
    urdf, options = ROBOTS[request.param]
    path = shared_data / "bags" / f"{request.param}.db3"
    if not path.exists() or not (folder / urdf).exists():
        pytest.skip("wants ../shared/data/bags and the package example-robot-data")
    return request.param, str(folder / urdf), options, path


def read_messages(path):
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with rosbag2.Reader(path) as reader:
        return [
            (received, data, store.deserialize_cdr(data, STATE)) for _, received, data in reader.messages()
        ]


def write_copies(folder, path):
    """Write the messages as arrays, and as another bag by the library's own writer."""
    found = read_messages(path)
    stamps = [message.header.stamp for *_, message in found]
    time = np.array([(stamp.sec * 10**9 + stamp.nanosec) / 1e9 for stamp in stamps])
    arrays = {
        key: np.array([getattr(message, field) for *_, message in found])
        for key, field in (("q", "position"), ("dq", "velocity"), ("tau", "effort"))
    }
    np.savez(folder / "copy.npz", t=time, **arrays)
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    plugin = rosbag2.StoragePlugin.MCAP
    with rosbag2.Writer(folder / "copy", version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/joint_states", STATE, typestore=store)
        for received, data, _ in found:
            writer.write(connection, received, data)
    return folder / "copy.npz", folder / "copy" / "copy.mcap"


def identify(urdf, log, *options):
    return do("identify", urdf, log, *options, *QUICK, "--accept", "--backend", "python")


def test_one_command_identifies_from_a_bag(bag, tmp_path):
    name, urdf, options, path = bag
    found = identify(urdf, path, *options)
    assert ("3441 messages" if name == "ur10" else "727 messages") in find_texts(found, "log.topic-read")
    parameters = found["result"]["parameters"]
    assert len(parameters) == {"ur10": 36, "panda": 57}[name]
    robot = symid.load(urdf, **({"tip": options[1]} if options else {}))
    log, copies = symid.read_log(path, robot), write_copies(tmp_path, path)
    for copy in copies:
        other = symid.read_log(copy, robot)
        for channel in ("time", "q", "dq", "tau"):
            np.testing.assert_array_equal(getattr(other, channel), getattr(log, channel), err_msg=str(copy))
    if name == "ur10":
        assert identify(urdf, copies[0], *options)["result"]["parameters"] == parameters
