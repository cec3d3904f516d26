"""HDF5 and MATLAB 7.3: data sets by name, axes turned, units, and what is said without h5py."""

import numpy as np
import pytest

from symid.logs.reader import read_raw, read_recording
from tests.refusals import tell


def write_matlab(path, h5py, content):
    """Write as MATLAB does: axes reversed, the class in an attribute."""

    def put(group, name, value):
        if isinstance(value, dict):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, entry in value.items():
                put(inner, key, entry)
        elif isinstance(value, str):
            data = group.create_dataset(name, data=np.array([[ord(c)] for c in value], dtype=np.uint16))
            data.attrs["MATLAB_class"] = np.bytes_("char")
        else:
            data = group.create_dataset(name, data=np.atleast_2d(value).T)
            data.attrs["MATLAB_class"] = np.bytes_("double")

    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_group("#refs#")
        for name, value in content.items():
            put(file, name, value)
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124))


def test_structures_of_matlab(make_robot, columns, tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.mat"
    content = {"run": {"t": columns["t"][:, None], "q": columns["q"]}, "tau": columns["tau"], "name": "first"}
    write_matlab(path, h5py, content)
    robot = make_robot(time=(("run.t",), "s"), position=(("run.q",), "rad"))
    recording = read_recording(path, robot)
    np.testing.assert_array_equal(recording.time, columns["t"])
    np.testing.assert_array_equal(recording.position, columns["q"])
    np.testing.assert_array_equal(recording.torque, columns["tau"])
    assert "name" in tell(recording.notices)["log.unused-columns"]


@pytest.mark.parametrize("suffix", [".h5", ".hdf5"])
def test_plain_hdf5_states_units(make_robot, columns, tmp_path, suffix):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / f"log{suffix}"
    with h5py.File(path, "w") as file:
        file["t"] = columns["t"]
        file["q"] = np.degrees(columns["q"])
        file["q"].attrs["unit"] = "deg"
        file["tau"] = columns["tau"]
        file["a/b/c"] = columns["t"]
        file["words"] = np.bytes_("text")
        file["deep"] = np.zeros((2, 2, 2))
    raw = read_raw(path)
    assert set(raw.columns) == {"t", "q", "tau", "a.b.c"}
    assert (raw.units, set(raw.others)) == ({"q": "deg"}, {"words", "deep"})
    np.testing.assert_allclose(read_recording(path, make_robot()).position, columns["q"])
