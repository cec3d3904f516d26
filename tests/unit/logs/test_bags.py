"""ROS 2 bags: the same samples from every container, joints by name, and which topic is the robot's."""

import shutil
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from symid.errors import LogError, UsageError
from symid.logs.bags import match_joints
from symid.logs.draft import draft_log_map
from symid.logs.reader import read_raw, read_recording
from symid.logs.runs import check_distinct, read_recordings
from symid.robot import parse_robot, write_robot
from symid.robot.description import LogMap
from tests.refusals import refuse, tell

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

STATE, DYNAMIC, ARRAY = (
    "sensor_msgs/msg/JointState",
    "control_msgs/msg/DynamicJointState",
    "std_msgs/msg/Float64MultiArray",
)
PLUGINS = {"db3": rosbag2.StoragePlugin.SQLITE3, "mcap": rosbag2.StoragePlugin.MCAP}
START = 1_700_000_000 * 10**9 + 250_000_000
NAMES = ("joint1", "joint2")


@pytest.fixture
def make_store():
    """Return the types that messages are written with."""
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    inner = "string[] interface_names\nfloat64[] values"
    outer = "std_msgs/Header header\nstring[] joint_names\nInterfaceValue[] interface_values"
    store.register(typesys.get_types_from_msg(inner, "control_msgs/msg/InterfaceValue"))
    store.register(typesys.get_types_from_msg(outer, DYNAMIC))
    return store


@pytest.fixture
def write_bag(tmp_path, make_store):
    """Return a writer of messages: topic, stamp in ns, time of recording, names, values by channel."""
    store = make_store
    types = store.types

    def header(stamp):
        time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return types["std_msgs/msg/Header"](stamp=time, frame_id="")

    def build(kind, stamp, names, *values):
        if kind == ARRAY:
            layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
            return types[ARRAY](layout=layout, data=np.array(values[0], dtype=np.float64))
        if kind == DYNAMIC:
            inner = types["control_msgs/msg/InterfaceValue"]
            rows = zip(*values, strict=True)
            states = [inner(interface_names=["position", "effort"], values=np.array(row)) for row in rows]
            return types[DYNAMIC](header=header(stamp), joint_names=list(names), interface_values=states)
        position, velocity, effort = (np.array(part, dtype=np.float64) for part in values)
        return types[STATE](
            header=header(stamp), name=list(names), position=position, velocity=velocity, effort=effort
        )

    def write(messages, plugin="db3", name="", kinds=()):
        path = tmp_path / (name or f"bag{len(list(tmp_path.iterdir()))}")
        kinds, connections = dict(kinds), {}
        with rosbag2.Writer(path, version=9, storage_plugin=PLUGINS[plugin]) as writer:
            for topic, stamp, received, *content in messages:
                kind = kinds.get(topic, STATE)
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                data = store.serialize_cdr(build(kind, stamp, *content), kind)
                writer.write(connections[topic], received, data)
        return path

    return write


@pytest.fixture
def messages(columns):
    """Return messages of the samples of `columns`, 10 ms apart, recorded 1 ms later."""
    rows = zip(np.arange(50), columns["q"], columns["tau"], strict=True)
    stamps = [(START + 10_000_000 * int(k), q, tau) for k, q, tau in rows]
    return [("/joint_states", at, at + 10**6, NAMES, q, q, tau) for at, q, tau in stamps]


problems = partial(refuse, LogError, read_recording)


@pytest.mark.parametrize("plugin", ["db3", "mcap"])
@pytest.mark.parametrize("form", ["folder", "file", "folder without metadata"])
def test_every_container_gives_the_same_samples(make_robot, columns, messages, write_bag, *, plugin, form):
    path = write_bag(messages, plugin)
    if form != "folder":
        (path / "metadata.yaml").unlink()
    if form == "file":
        (path,) = path.iterdir()
    recording = read_recording(path, make_robot())
    np.testing.assert_array_equal(recording.position, columns["q"])
    np.testing.assert_array_equal(recording.torque, columns["tau"])
    np.testing.assert_array_equal(recording.velocity, columns["q"])
    # Counted from a whole second, so that no digit of a stamp is lost.
    np.testing.assert_array_equal(recording.time, (250_000_000 + 10_000_000 * np.arange(50)) / 1e9)
    found = tell(recording.notices)
    assert (
        "50 messages; joints joint1, joint2; time is that of the headers, less 1700000000 s"
        in (found["log.topic-read"])
    )
    assert "steps of 0.01 s, the longest 0.01 s" in found["log.topic-read"]
    assert "does not state the unit of effort" in found["new.preset"]
    assert [notice.is_note for notice in recording.notices if notice.code == "log.topic-read"] == [True]


def test_split_bags_are_one_log_in_the_order_of_their_times(make_robot, columns, messages, write_bag):
    first, second = write_bag(messages[:30], name="a"), write_bag(messages[30:], name="b")
    shutil.copy(second / "b.db3", first / "b.db3")
    # Its metadata still lists one file, as that of a bag to which one was added.
    assert "one of 2 files of a bag" in tell(read_raw(first / "a.db3").notices)["log.part-of-bag"]
    (first / "metadata.yaml").unlink()
    recording = read_recording(first, make_robot())
    np.testing.assert_array_equal(recording.torque, columns["tau"])
    assert "log.part-of-bag" not in tell(recording.notices)
    first, second = write_bag(messages[:30], name="run_2"), write_bag(messages[30:], name="run_10")
    shutil.copy(second / "run_10.db3", first / "run_10.db3")
    (first / "metadata.yaml").unlink()
    np.testing.assert_array_equal(read_recording(first, make_robot()).torque, columns["tau"])


def test_a_folder_is_a_log_of_its_own(make_robot, messages, write_bag, tmp_path):
    path = write_bag(messages)
    shutil.copytree(path, tmp_path / "again")
    assert read_recordings((path,), make_robot())[0].source == str(path)
    with pytest.raises(UsageError, match="the same log as"):
        check_distinct((path, tmp_path / "again"))


def test_joints_are_found_by_name_whatever_their_order_and_beginning(
    make_robot, columns, messages, write_bag
):
    turned = [
        (*message[:3], NAMES[::-1], *(values[::-1] for values in message[4:])) if k % 3 else message
        for k, message in enumerate(messages)
    ]
    recording = read_recording(write_bag(turned), make_robot())
    np.testing.assert_array_equal(recording.position, columns["q"])
    np.testing.assert_array_equal(recording.torque, columns["tau"])
    assert "the order of joints changes" in tell(recording.notices)["log.topic-read"]
    renamed = [(*message[:3], ("fer_joint1", "fer_joint2"), *message[4:]) for message in messages]
    recording = read_recording(write_bag(renamed), make_robot())
    np.testing.assert_array_equal(recording.torque, columns["tau"])
    text = tell(recording.notices)["log.joint-names"]
    assert "'fer_joint1' is 'joint1', 'fer_joint2' is 'joint2'; check that it is" in text
    longer = [(*message[:3], ("joint1_motor", "joint2_motor"), *message[4:]) for message in messages]
    recording = read_recording(write_bag(longer), make_robot())
    np.testing.assert_array_equal(recording.torque, columns["tau"])
    found = tell(recording.notices)
    assert "log.joint-names" not in found
    assert "'joint1_motor' is 'joint1', 'joint2_motor' is 'joint2'" in found["log.joint-endings"]


def test_messages_with_a_part_of_the_joints_or_of_the_values(make_robot, columns, messages, write_bag):
    """A gripper speaks on the topic of the arm, and one message of the arm lacks a joint."""
    mixed = []
    for k, message in enumerate(messages):
        mixed.append((*message[:3], NAMES[:1], *(part[:1] for part in message[4:])) if k == 20 else message)
        at = message[1] + 3_000_000
        mixed.append(("/joint_states", at, at + 10**6, ("finger",), [0.1], [0.0], [1.0]))
    recording = read_recording(write_bag(mixed), make_robot(), uneven=True)
    np.testing.assert_array_equal(recording.torque, np.delete(columns["tau"], 20, axis=0))
    found = tell(recording.notices)
    assert "51 of 100 samples of topic /joint_states" in found["log.incomplete-messages"]
    assert "100 messages have a part of the joints only" in found["log.topic-read"]
    odd = [(*message[:6], message[6][:1]) if k == 5 else message for k, message in enumerate(messages)]
    recording = read_recording(write_bag(odd), make_robot(), uneven=True)
    assert "1 messages have names twice, or not as many values" in tell(recording.notices)["log.topic-read"]
    assert len(recording.time) == 49


def test_stamps_that_repeat_return_or_are_zero(make_robot, columns, messages, write_bag):
    halves = [
        (*message[:3], NAMES[k : k + 1], *(part[k : k + 1] for part in message[4:]))
        for message in messages
        for k in range(2)
    ]
    recording = read_recording(write_bag(halves), make_robot())
    np.testing.assert_array_equal(recording.torque, columns["tau"])
    assert "100 messages became 50 samples" in tell(recording.notices)["log.topic-read"]
    apart = [(topic, at + 10**6 * (k % 2), *rest) for k, (topic, at, *rest) in enumerate(halves)]
    text = problems(write_bag(apart), make_robot())["log.topic"]
    assert "100 of 100 samples of topic /joint_states lack" in text
    path = write_bag([*messages[:10], messages[9], *messages[10:]])
    assert "time must increase: sample 10" in problems(path, make_robot())["log.time-order"]
    path = write_bag([(topic, 0, *rest) for topic, _, *rest in messages])
    recording = read_recording(path, make_robot())
    assert recording.time[0] == 0.251
    text = tell(recording.notices)["log.topic-read"]
    assert "time is that of recording, because all stamps of the headers are zero" in text


def test_topics_in_doubt_are_asked_for(make_robot, columns, messages, write_bag):
    doubled = [("/mirror", *entry[1:4], *(2.0 * part for part in entry[4:])) for entry in messages]
    path = write_bag([*messages, *doubled])
    text = problems(path, make_robot())["log.topic"]
    assert "'/joint_states', '/mirror' have position and effort of every joint" in text
    assert "--set log.topic=" in text
    chosen = replace(make_robot(), log=LogMap(topic="/mirror"))
    np.testing.assert_array_equal(read_recording(path, chosen).torque, 2.0 * columns["tau"])
    wrong = problems(path, replace(make_robot(), log=LogMap(topic="/other")))["log.topic"]
    assert "there is no topic '/other'" in wrong
    path = write_bag([("/joint_states_desired", *message[1:]) for message in messages])
    assert "is a command by its name" in problems(path, make_robot())["log.topic"]
    chosen = replace(make_robot(), log=LogMap(topic="/joint_states_desired"))
    np.testing.assert_array_equal(read_recording(path, chosen).torque, columns["tau"])
    nameless = [("/nameless", *message[1:3], (), *message[4:]) for message in messages]
    path = write_bag([*messages, *nameless])
    np.testing.assert_array_equal(read_recording(path, make_robot()).torque, columns["tau"])
    assert read_raw(path).others == (f"/nameless ({STATE}, 50 messages, which name no joints)",)
    text = problems(write_bag(nameless), make_robot())["log.no-topic"]
    assert "/nameless" in text
    assert "which name no joints" in text


def test_topics_without_the_robot(make_robot, messages, write_bag):
    strangers = [(*message[:3], ("hip", "knee"), *message[4:]) for message in messages]
    text = problems(write_bag(strangers), make_robot())["log.topic"]
    assert "/joint_states lacks 'joint1', 'joint2' (it has 'hip', 'knee')" in text
    assert "--set log.position.columns=/joint_states/NAME/position,..." in text
    silent = [(*message[:6], []) for message in messages]
    text = problems(write_bag(silent), make_robot())["log.topic"]
    assert "/joint_states has no effort of 'joint1', 'joint2'" in text
    still = [(*message[:4], [], *message[5:]) for message in messages]
    text = problems(write_bag(still), make_robot())["log.topic"]
    assert "/joint_states has no position of 'joint1', 'joint2'" in text
    assert "no effort" not in text
    short = [(*message[:3], NAMES[:1], *(part[:1] for part in message[4:6]), []) for message in messages]
    text = problems(write_bag(short), make_robot())["log.topic"]
    assert "/joint_states lacks 'joint2' and has no effort of 'joint1'" in text


def test_topics_below_the_topic_keep_their_samples(make_robot, columns, messages, write_bag):
    """Left-out samples of /js are none of /js/raw, of joints or an array."""
    own = [("/js", *message[1:]) for message in messages]
    own[7] = (*own[7][:3], NAMES[:1], *(part[:1] for part in own[7][4:]))
    below = [("/js/raw", *message[1:3], ("x", "y"), *message[4:]) for message in messages[:30]]
    arrays = [("/js/more", 0, message[2], (), [1.0, 2.0]) for message in messages[:20]]
    path = write_bag([*own, *below, *arrays], kinds={"/js/more": ARRAY})
    recording = read_recording(path, make_robot(), uneven=True)
    np.testing.assert_array_equal(recording.torque, np.delete(columns["tau"], 7, axis=0))
    shapes = {name: len(values) for name, values in recording.extras.items()}
    assert (shapes["/js/raw/x/position"], shapes["/js/raw/time"]) == (30, 30)
    assert (shapes["/js/more/data"], shapes["/js/more/time"]) == (20, 20)


def test_times_are_counted_from_a_date_whatever_else_is_there(make_robot, messages, write_bag):
    simulated = [("/sim", at - START + 10**9, *rest) for _, at, *rest in messages]
    zero = [(messages[0][0], 0, *messages[0][2:]), *messages[1:]]
    path = write_bag([*zero, *simulated])
    found = read_raw(path)
    np.testing.assert_array_equal(
        found.columns["/joint_states/time"], (250_000_000 + 10_000_000 * np.arange(1, 50)) / 1e9
    )
    np.testing.assert_array_equal(found.columns["/sim/time"], (10**9 + 10_000_000 * np.arange(50)) / 1e9)
    texts = [notice.text for notice in found.notices]
    assert "1 more have a stamp that is zero, and were left out" in texts[0]
    assert "less 1700000000 s" in texts[0]
    assert "less" not in texts[1]


def test_other_messages(make_robot, columns, messages, write_bag):
    """States of controllers and arrays are read; other types, and arrays whose length changes, are named."""
    extra = [("/dynamic", at, received, names, q, tau) for _, at, received, names, q, _, tau in messages]
    arrays = [("/effort", 0, received, (), 3.0 * tau) for _, _, received, _, _, _, tau in messages]
    uneven = [("/odd", 0, messages[0][2] + k, (), [0.0] * k) for k in range(3)]
    kinds = {"/dynamic": DYNAMIC, "/effort": ARRAY, "/odd": ARRAY}
    path = write_bag([*extra, *arrays, *uneven], kinds=kinds)
    raw = read_raw(path)
    assert raw.others == ("/odd/data (arrays of 0 to 2 numbers)",)
    np.testing.assert_array_equal(raw.columns["/effort/data"], 3.0 * columns["tau"])
    np.testing.assert_array_equal(read_recording(path, make_robot()).torque, columns["tau"])
    only = write_bag(uneven[:0])
    assert (
        "the bag has no messages of sensor_msgs/msg/JointState"
        in problems(only, make_robot())["log.no-topic"]
    )


@pytest.mark.parametrize("kind", [STATE, DYNAMIC])
def test_names_twice_in_a_message(make_robot, messages, write_bag, kind):
    """Nothing is read of such a message, and its order is none."""
    twice = [
        (*message[:3], ("joint2", "joint1", "joint2"), *(np.r_[part, 9.0] for part in message[4:]))
        if k == 5
        else message
        for k, message in enumerate(messages)
    ]
    if kind == DYNAMIC:
        twice = [(*entry[:5], entry[6]) for entry in twice]
    path = write_bag(twice, kinds={"/joint_states": kind})
    recording = read_recording(path, make_robot(), uneven=True)
    assert len(recording.time) == 49
    assert not np.any(recording.position == 9.0)
    text = tell(recording.notices)["log.topic-read"]
    assert "1 messages have names twice" in text
    assert "the order of joints changes" not in text


@pytest.mark.parametrize(
    ("present", "wanted", "found"),
    [
        (("b", "a"), ("a", "b"), ("a", "b")),
        (("fer_joint2", "fer_joint1"), ("panda_joint1", "panda_joint2"), ("fer_joint1", "fer_joint2")),
        (("ur_elbow", "ur_wrist"), ("elbow", "wrist"), ("ur_elbow", "ur_wrist")),
        (("j1", "j2", "finger_j1"), ("arm_j1", "arm_j2"), ("j1", "j2")),
        # Two arms could be meant.
        (("left_j1", "left_j2", "right_j1", "right_j2"), ("arm_j1", "arm_j2"), ()),
        (("x1", "x2"), ("elbow", "wrist"), ()),
        # Beginnings are whole words, endings more than a number or a letter, and arms are not exchanged.
        (("right_joint1", "right_joint2"), ("left_joint1", "left_joint2"), ()),
        (("R_joint1", "R_joint2"), ("left_joint1", "left_joint2"), ()),
        (("left_fer_j1", "left_fer_j2"), ("left_arm_j1", "left_arm_j2"), ("left_fer_j1", "left_fer_j2")),
        (("joint1", "joint2"), ("left_joint1", "left_joint2"), ("joint1", "joint2")),
        (("finger1", "finger2"), ("joint1", "joint2"), ()),
        (("finger_1", "finger_2"), ("joint_1", "joint_2"), ()),
        (("x_a", "x_b"), ("y_a", "y_b"), ()),
        (("slide",), ("knee",), ()),
        (("myelbow", "mywrist"), ("elbow", "wrist"), ()),
        (("armElbow", "armWrist"), ("legElbow", "legWrist"), ("armElbow", "armWrist")),
        # An ending more or less, a whole word, of all joints, and only one.
        (("pan_joint", "lift_joint", "grip"), ("pan", "lift"), ("pan_joint", "lift_joint")),
        (("pan", "lift"), ("pan_joint", "lift_joint"), ("pan", "lift")),
        (("panJoint", "liftJoint"), ("pan", "lift"), ("panJoint", "liftJoint")),
        (("pan_joint", "lift"), ("pan", "lift"), ()),
        (("pan_joint", "lift_joint", "pan_motor", "lift_motor"), ("pan", "lift"), ()),
        (("j11", "j21"), ("j1", "j2"), ()),
        (("pan_1", "lift_1"), ("pan", "lift"), ()),
        (("panel", "liftel"), ("pan", "lift"), ()),
    ],
)
def test_names_of_joints(present, wanted, found):
    assert match_joints(present, wanted) == found


def test_damaged_bags_are_refused_or_read(make_robot, messages, write_bag):
    rng = np.random.default_rng(5)
    for plugin in PLUGINS:
        (path,) = (
            entry for entry in write_bag(messages, plugin, plugin).iterdir() if entry.suffix != ".yaml"
        )
        content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
        for _ in range(20):
            damaged = content.copy()
            damaged[rng.integers(len(damaged), size=20)] = rng.integers(256, size=20)
            path.write_bytes(damaged[: rng.integers(1, len(damaged) + 1)].tobytes())
            # Any other error than that of a log is a fault.
            with suppress(LogError):
                assert len(read_recording(path, make_robot(), uneven=True).time)


def test_efforts_that_are_currents_go_into_a_robot_file(make_robot, columns, messages, write_bag):
    robot = make_robot(gears=(100.0, 50.0), constants=(0.1, 0.2))
    doubled = [("/mirror", *entry[1:4], *(2.0 * part for part in entry[4:])) for entry in messages]
    path = write_bag([*messages, *doubled])
    draft = draft_log_map(robot, path, {"topic": "/mirror"}, {"torque": "A"})
    log = draft.robot.log
    assert (log.preset, log.topic, log.position, log.torque.unit) == ("ros", "/mirror", None, "A")
    assert draft.units["torque"] == ("A",)
    np.testing.assert_allclose(read_recording(path, draft.robot).torque, 20.0 * columns["tau"], rtol=1e-14)
    assert parse_robot(write_robot(draft.robot)).log == log
