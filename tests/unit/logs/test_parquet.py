"""Parquet: columns, units of metadata and headings, lists, times, and what is said without pyarrow."""

import numpy as np
import pytest

from symid.errors import LogError
from symid.logs.reader import read_raw, read_recording

pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")


def write(path, columns, metadata=None):
    """Write columns (name -> pyarrow array), some with metadata."""
    fields = [
        pa.field(name, array.type, metadata=(metadata or {}).get(name)) for name, array in columns.items()
    ]
    parquet.write_table(pa.table(list(columns.values()), schema=pa.schema(fields)), path)
    return path


def test_units_stand_in_metadata_or_headings(make_robot, columns, tmp_path):
    names = {"t": columns["t"] * 1e3, "q1": columns["q"][:, 0], "q2": columns["q"][:, 1]}
    torques = {f"tau{k + 1} [N m]": columns["tau"][:, k] for k in range(2)}
    arrays = {name: pa.array(values) for name, values in (names | torques).items()}
    arrays["name"] = pa.array(["a"] * 50)
    metadata = {"t": {"unit": "ms"}, "q1": {"units": "deg"}, "q2": {"unit": "deg"}}
    path = write(tmp_path / "log.parquet", arrays, metadata)
    raw = read_raw(path)
    assert raw.units == {"t": "ms", "q1": "deg", "q2": "deg", "tau1": "N m", "tau2": "N m"}
    assert raw.others == ("name",)
    recording = read_recording(path, make_robot())
    np.testing.assert_allclose(recording.position, np.deg2rad(columns["q"]), rtol=1e-14)
    np.testing.assert_array_equal(recording.torque, columns["tau"])


def test_lists_structures_times_and_holes(make_robot, columns, tmp_path):
    stamps = pa.array((columns["t"] * 1e6).round().astype(int), pa.timestamp("us"))
    fixed = pa.FixedSizeListArray.from_arrays(pa.array(columns["q"].ravel()), 2)
    inner = pa.array([list(row) for row in columns["tau"]])
    holes = pa.array([None, *columns["t"][1:]])
    ragged = pa.array([[0.0] * (k % 3) for k in range(50)])
    counts = pa.array(range(50), pa.int32())
    arrays = {"t": stamps, "q": fixed, "state": pa.StructArray.from_arrays([inner, counts], ["tau", "k"])}
    path = write(tmp_path / "log.parquet", {**arrays, "holes": holes, "ragged": ragged})
    raw = read_raw(path)
    assert raw.units == {"t": "us"}
    assert raw.others == ("ragged",)
    np.testing.assert_array_equal(raw.columns["q"], columns["q"])
    np.testing.assert_array_equal(raw.columns["state.tau"], columns["tau"])
    np.testing.assert_array_equal(raw.columns["state.k"], np.arange(50))
    assert np.isnan(raw.columns["holes"][0])
    robot = make_robot(torque=(("state.tau",), "N*m"))
    np.testing.assert_array_equal(read_recording(path, robot).torque, columns["tau"])


@pytest.mark.parametrize("kind", [pa.duration("ns"), pa.timestamp("ns"), pa.time64("ns"), pa.duration("ms")])
def test_the_type_of_a_time_states_its_unit(make_robot, columns, tmp_path, kind):
    """Also against the name of the column and its metadata."""
    scale = 1e3 if kind.unit == "ms" else 1e9
    counts = pa.array((columns["t"] * scale).round().astype(int))
    arrays = {"time [s]": counts.cast(kind), "q": pa.array([list(row) for row in columns["q"]])}
    arrays["tau"] = pa.array([list(row) for row in columns["tau"]])
    path = write(tmp_path / "log.parquet", arrays, {"time [s]": {"unit": "s"}})
    assert read_raw(path).units == {"time": kind.unit}
    robot = make_robot(time=(("time",), kind.unit))
    np.testing.assert_allclose(read_recording(path, robot).time, columns["t"], atol=1e-12)


def test_rows_of_null_decimals_and_dates(tmp_path):
    rows = [[1.0, 2.0], None, [3.0, 4.0]]
    fixed = pa.array(rows, pa.list_(pa.float64(), 2))
    decimals = pa.array([1, 2, 3], pa.decimal128(12, 2))
    arrays = {"list": pa.array(rows), "fixed": fixed, "decimal": decimals}
    arrays["date"] = pa.array([1, 2, 3], pa.date32())
    raw = read_raw(write(tmp_path / "log.parquet", arrays))
    expected = [[1.0, 2.0], [np.nan, np.nan], [3.0, 4.0]]
    np.testing.assert_array_equal(raw.columns["list"], expected)
    np.testing.assert_array_equal(raw.columns["fixed"], expected)
    np.testing.assert_array_equal(raw.columns["decimal"], [1.0, 2.0, 3.0])
    assert raw.others == ("date",)


def test_columns_of_one_name_are_told(tmp_path):
    path = write(tmp_path / "log.parquet", {"q [rad]": pa.array([0.0]), "q [deg]": pa.array([0.0])})
    with pytest.raises(LogError, match="more than one column is named 'q'"):
        read_raw(path)
