"""Files that no honest program writes: each ends in a SymidError that says what, and where."""

import contextlib
import io
import json
import shutil
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
from scipy.io import savemat

import symid
from symid.environment import read_file
from symid.errors import EstimateError, LogError, RobotError, SymidError
from symid.identification.stored import read_fit
from symid.logs import files
from symid.logs.files import LARGEST_ARRAY
from symid.logs.reader import read_raw, read_recording
from symid.robot import read_robot
from symid.robot.loading import is_mjcf, override_robot
from symid.robot.toml_reader import parse_dh_table
from symid.robot.toml_values import parse_toml
from tests.mistakes import refuse

ROBOT = Path("robots/two_link.toml")
FITS = Path("tests/data/fits")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("x = " + "{a=" * 5000 + "1" + "}" * 5000, "nested too deeply"),
        ("x = " + "[" * 5000 + "]" * 5000, "nested too deeply"),
        ("x = " + "9" * 5000, "too many digits"),
        ("x = 1e" + "9" * 20, "too many digits"),
    ],
)
def test_tables_and_numbers_without_an_end_have_a_line(line, words):
    (notice,) = refuse(lambda: parse_toml(f'name = "arm"\n{line}\n', "arm.toml").finish())
    assert words in notice.text
    assert (notice.file, notice.line) == ("arm.toml", 2)


def test_settings_of_a_call_may_be_as_odd():
    robot = read_robot(ROBOT)
    for text in ("9" * 5000, "[" * 5000):
        with pytest.raises(SymidError):
            override_robot(robot, (("processing.filter_cutoff", text),))


def test_lengths_beyond_doubles_are_refused_at_their_cell():
    table = f"joint, alpha, a, d, theta\nfirst, 0, {'9' * 400}, 0, q\n"
    (notice,) = refuse(parse_dh_table, table, "modified", file="arm.csv")
    assert (notice.line, notice.column) == (2, 11)


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_names_that_no_file_can_have(tmp_path, suffix):
    with pytest.raises(LogError, match="too long"):
        read_raw(tmp_path / f"{'a' * 300}{suffix}")


def test_devices_that_never_end_are_no_files(tmp_path):
    for name in ("log.csv", "log.npz"):
        (tmp_path / name).symlink_to("/dev/zero")
        with pytest.raises(LogError, match="a device"):
            read_raw(tmp_path / name)
    (tmp_path / "arm.toml").symlink_to("/dev/zero")
    with pytest.raises(RobotError, match="larger than 64 MB"):
        read_robot(tmp_path / "arm.toml")
    assert not is_mjcf(tmp_path / "arm.toml")
    (tmp_path / "fit.json").symlink_to("/dev/zero")
    with pytest.raises(OSError, match="larger than 1 MB"):
        read_file(tmp_path / "fit.json", 10**6)


def write_archive(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)


def write_header(text):
    """Return a member that has this header and no numbers."""
    head = text.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head


def write_array(values):
    stream = io.BytesIO()
    np.save(stream, values)
    return stream.getvalue()


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (3",
        "(" * 300,
        "{'descr': 'x'",
        "\x00",
        "{}",
        "3L 'a",
    ],
)
def test_damaged_headers_of_arrays_are_damage(tmp_path, header):
    write_archive(tmp_path / "log.npz", {"t": write_header(header)})
    texts = []
    try:
        texts += read_raw(tmp_path / "log.npz").others
    except LogError as error:
        texts += [entry.text for entry in error.notices]
    assert texts == ["t"] or "NumPy archive" in texts[0]


def test_an_array_too_large_is_left_out_by_its_header_and_named_where_it_is_needed(tmp_path):
    count = LARGEST_ARRAY // 8 + 1
    large = write_header(f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({count},)}}")
    time = np.arange(100.0)
    members = {name: write_array(time) for name in ("t", "tau1", "tau2", "q1")}
    path = tmp_path / "log.npz"
    write_archive(path, {**members, "q2": write_array(time), "camera": large})
    found = read_raw(path)
    assert found.others == ("camera",)
    (notice,) = found.notices
    assert notice.code == "log.too-large"
    assert "'camera' (1 GB)" in notice.text
    write_archive(path, {**members, "q2": large})
    pairs = (
        *(("log.time.column", "t"), ("log.time.unit", "s")),
        *(("log.position.columns", '["q1", "q2"]'), ("log.position.unit", "rad")),
        *(("log.torque.columns", '["tau1", "tau2"]'), ("log.torque.unit", "N m")),
    )
    robot = override_robot(read_robot(ROBOT), pairs)
    with pytest.raises(LogError, match="position: not read"):
        read_recording(path, robot)


def test_an_hdf5_file_may_ask_for_more_than_there_is(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["t"] = np.arange(100.0)
        file.create_dataset("huge", (2**33,), "f8", chunks=(2**20,))
    assert path.stat().st_size < 100_000
    found = read_raw(path)
    assert (list(found.columns), found.others) == (["t"], ("huge",))
    assert "'huge' (68.7 GB)" in found.notices[0].text


def test_a_matlab_file_may_ask_for_more_than_there_is(tmp_path):
    path = tmp_path / "log.mat"
    savemat(path, {"t": np.arange(100.0)})
    whole = bytearray(path.read_bytes())
    # The size of the element that holds the numbers.
    place = whole.index(struct.pack("<II", 9, 800))
    whole[place + 4 : place + 8] = struct.pack("<I", 2**31)
    path.write_bytes(bytes(whole))
    with pytest.raises(LogError, match="not a MATLAB file that can be read"):
        read_raw(path)


@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_files_of_all_classes_have_sound_elements(tmp_path, compressed):
    path = tmp_path / "log.mat"
    content = {
        "t": np.arange(5.0),
        "short": np.array([1], dtype=np.int8),
        "text": "a word",
        "empty": np.zeros((0, 0)),
        "log": {"q": np.eye(3), "cell": np.array([1.0, "a", np.arange(3)], dtype=object)},
        "complex": np.array([1j]),
        "sparse": scipy.sparse.eye(3).tocsc(),
        "flag": np.array([True]),
    }
    savemat(path, content, do_compression=compressed)
    assert files._has_matlab_elements(path.read_bytes())
    assert {"t", "short", "log.q"} <= set(read_raw(path).columns)


def test_types_of_matlab_elements_that_do_not_exist_are_damage(tmp_path):
    """SciPy ends the process with them."""
    path = tmp_path / "log.mat"
    savemat(path, {"t": np.arange(4.0)})
    whole = path.read_bytes()
    place = whole.index(struct.pack("<II", 9, 32))
    for kind in (0, 8, 14, 19, 255):
        path.write_bytes(whole[:place] + struct.pack("<I", kind) + whole[place + 4 :])
        with pytest.raises(LogError, match="its elements are damaged"):
            read_raw(path)
    place = whole.index(struct.pack("<II", 5, 8)) + 4
    for size in (0, 1, 4, 6):
        path.write_bytes(whole[:place] + struct.pack("<I", size) + whole[place + 4 :])
        with pytest.raises(LogError, match="its elements are damaged"):
            read_raw(path)
    # Cut off anywhere, there is a column, or a reason.
    for size in range(128, len(whole)):
        path.write_bytes(whole[:size])
        with contextlib.suppress(LogError):
            assert set(read_raw(path).columns) <= {"t"}


@pytest.mark.parametrize(
    ("value", "place", "byte"),
    [(np.arange(4.0), 145, 8), ({"a": 1.0, "b": 2.0}, 160, 3), (np.array([1.0, "a"], dtype=object), 160, 40)],
    ids=["complex", "structure", "cell"],
)
def test_elements_that_a_matlab_matrix_lacks_are_damage(tmp_path, value, place, byte):
    """SciPy reads what comes behind as such, and may end the process with it."""
    path = tmp_path / "log.mat"
    savemat(path, {"t": value, "other": np.arange(3.0)})
    whole = bytearray(path.read_bytes())
    assert files._has_matlab_elements(bytes(whole))
    # A flag of an imaginary part; more structures, or cells, than there are.
    assert whole[place] < byte
    whole[place] = byte
    path.write_bytes(bytes(whole))
    with pytest.raises(LogError, match="its elements are damaged"):
        read_raw(path)


def test_trials_of_methods_have_a_value_a_parameter(tmp_path, elastic_fit):
    data = json.loads(elastic_fit.read_text(encoding="utf-8"))
    first = data["trials"][0]
    data["trials"] = [first, {**first, "values": first["values"][:-1]}]
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(EstimateError, match=r"expected \d+ values as of"):
        read_fit(path)


@pytest.fixture
def elastic_fit(tmp_path):
    return Path(shutil.copy(FITS / "elastic_1.json", tmp_path / "elastic.json"))


def test_findings_of_others(shared_data, tmp_path):
    """Files that once ended in a traceback."""
    folder = shared_data.parent / "fuzz_findings"
    if not folder.is_dir():
        pytest.skip("wants ../shared/fuzz_findings")
    robot, texts = symid.load("two_link"), []
    for path in sorted(folder.iterdir()):
        calls = {
            ".toml": [lambda path=path: symid.load(path), lambda path=path: robot.check(path)],
            ".json": [lambda path=path: symid.load_fit(path).report(tmp_path / "page.html")],
            ".csv": [
                lambda path=path: robot.check(path),
                lambda path=path: parse_dh_table(path.read_text(), "modified"),
            ],
        }.get(path.suffix, [lambda path=path: robot.check(path)])
        for call in calls:
            try:
                call()
            except SymidError as error:
                texts += [entry.text for entry in error.notices]
    assert all(texts)


@pytest.mark.parametrize("name", ["t", "q1", "tau2"])
def test_an_array_without_columns_is_refused_in_words(tmp_path, name):
    columns = dict.fromkeys(("t", "q1", "q2", "tau1", "tau2"), np.arange(40.0))
    np.savez(tmp_path / "log.npz", **{**columns, name: np.zeros((40, 0))})
    with pytest.raises(LogError, match=r"0 columns|differ in shape"):
        symid.read_log(tmp_path / "log.npz", symid.load("two_link"))


def _write_old_npz(path):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (40L,), }".ljust(117) + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("t", "q"):
            values = np.arange(40.0).tobytes()
            archive.writestr(
                f"{name}.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + values
            )


def _write_twice(path):
    savemat(path, {"t": np.arange(40.0)})
    content = path.read_bytes()
    path.write_bytes(content + content[128:])


def _write_vax(path):
    values = np.arange(40.0).tobytes()
    path.write_bytes(struct.pack("<5i", 2000, 40, 1, 0, 2) + b"t\0" + values)


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("old.npz", _write_old_npz, "created on Python 2"),
        ("twice.mat", _write_twice, 'Duplicate variable name "t"'),
        ("vax.mat", _write_vax, "VAX"),
    ],
)
def test_what_a_library_warns_of_is_a_notice_of_the_file(tmp_path, name, write, words):
    path = tmp_path / name
    write(path)
    # pytest turns a warning that gets out into an error.
    raw = read_raw(path)
    (notice,) = [entry for entry in raw.notices if entry.code == "log.doubted-file"]
    assert words in notice.text
    assert "; save the file anew" in notice.text
    assert notice.file == str(path)
    assert raw.columns["t"].shape == (40,)
