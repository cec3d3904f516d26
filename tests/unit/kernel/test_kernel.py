"""Errors, notation, provenance, arrays, units, resources, progress."""

import math
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import symid.environment
from symid.arrays import FloatArray, FrozenArrays, accumulate, compute_triangle, freeze, measure_top
from symid.environment import locate_resource_folder, report_count, write_file
from symid.errors import InputError, Notice, RobotError, SymidError
from symid.notation import INERTIAL, SYMBOLS, UNITS, get_unit, get_unit_factor, suggest_units
from symid.serialization import compute_signature, keep_name, read_record, write_canonical, write_plain
from tests.refusals import raises


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ({}, "wrong"),
        ({"file": "a.toml"}, "a.toml: wrong"),
        ({"file": "a.toml", "line": 3}, "a.toml:3: wrong"),
        ({"file": "a.toml", "line": 3, "column": 9}, "a.toml:3:9: wrong"),
    ],
)
def test_a_notice_says_where(place, text):
    assert str(Notice(code="x.y", text="wrong", **place)) == text


def test_errors_carry_all_notices_and_symbols_have_no_doubles():
    first, second = Notice(code="a.b", text="one"), Notice(code="a.c", text="two")
    error = RobotError(first, second)
    assert error.notices == (first, second)
    assert str(error) == "one\ntwo"
    assert (error.exit_code, SymidError.exit_code) == (3, 70)
    names = [symbol.name for symbol in SYMBOLS]
    assert len(set(names)) == len(names)
    assert set(INERTIAL) <= set(names)
    assert (get_unit("q"), get_unit("q", prismatic=True)) == ("rad", "m")


class Colour(Enum):
    RED = "red"


@dataclass(frozen=True)
class Pair:
    left: int
    right: str


@dataclass(frozen=True)
class Other:
    left: int
    right: str


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text()
    | st.binary()
    | st.fractions(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@settings(max_examples=50)
@given(left=VALUES, right=VALUES)
def test_signatures_differ_exactly_when_values_do(left, right):
    same = repr(left) == repr(right)
    if same:
        assert compute_signature(left) == compute_signature(right)
    elif left != right:
        assert compute_signature(left) != compute_signature(right)


def test_signatures_are_of_types_shapes_and_bytes():
    values = [
        1,
        True,
        "1",
        b"1",
        1.0,
        None,
        (1,),
        {"1": 1},
        Pair(1, "1"),
        Other(1, "1"),
        Fraction(1, 2),
        Colour.RED,
    ]
    assert len({write_canonical(value) for value in values}) == len(values)
    assert compute_signature("ab", "c") != compute_signature("a", "bc")
    assert write_canonical({"b": 1, "a": 2}) == write_canonical({"a": 2, "b": 1})
    array = np.arange(4.0)
    assert compute_signature(Colour.RED) != compute_signature("red")
    assert compute_signature(array) != compute_signature((str(array.dtype), array.shape, array.tobytes()))
    with pytest.raises(TypeError, match="no canonical form"):
        write_canonical(np.array([object()]))
    assert compute_signature(array) == compute_signature(array.copy())
    assert compute_signature(array) != compute_signature(array.reshape(2, 2))
    assert compute_signature(array) != compute_signature(array.astype(np.float32))
    with pytest.raises(TypeError, match="no JSON for type"):
        write_plain(Notice)


@pytest.mark.parametrize("value", [{1, 2}, object()])
def test_what_has_no_order_has_no_signature(value):
    with pytest.raises(TypeError, match="no canonical form"):
        write_canonical(value)


def test_frozen_arrays_are_private_copies():
    source = np.arange(3.0)
    frozen = freeze(source)
    source[0] = 9.0
    assert frozen[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        frozen[0] = 1.0
    own = np.zeros(3)
    samples = _Samples(own, extra=None)
    own[0] = 1.0
    assert samples.values[0] == 0.0
    assert samples.extra is None
    with pytest.raises(ValueError, match="read-only"):
        samples.values[0] = 2.0
    # What is frozen already is not copied again.
    assert _Samples(samples.values).values is samples.values
    view = freeze(np.arange(6.0))[::2]
    assert _Samples(view).values is not view


@dataclass(frozen=True, slots=True, eq=False)
class _Samples(FrozenArrays):
    values: FloatArray
    extra: FloatArray | None = None
    count: int = 0


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    path = write_file(tmp_path / "a.txt", "old")

    def fail(stream):
        stream.write(b"half")
        raise KeyError

    with pytest.raises(KeyError):
        write_file(path, fail)
    assert path.read_text(encoding="utf-8") == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]


SHAPES = [(0, 3), (3, 0), (1, 1), (3, 7), (50, 4), (16001, 5), (40000, 12)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("order", ["C", "F"])
def test_a_triangle_has_the_squares_of_its_matrix(shape, order):
    matrix = np.array(np.random.default_rng(1).normal(size=shape), order=order)
    before = matrix.copy()
    triangle = compute_triangle(matrix)
    np.testing.assert_array_equal(matrix, before)
    expected = np.linalg.qr(matrix, mode="r")
    assert triangle.shape == expected.shape
    np.testing.assert_array_equal(triangle, np.triu(triangle))
    np.testing.assert_allclose(np.abs(triangle), np.abs(expected), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(triangle.T @ triangle, matrix.T @ matrix, rtol=1e-11, atol=1e-10)


@pytest.mark.parametrize("keep", [0.0, 0.3, 0.97, 1.0])
@pytest.mark.parametrize("shape", [(0, 2), (1, 3), (32, 1), (33,), (70, 0), (2500, 2, 3)])
def test_sums_that_forget_are_those_step_after_step(shape, keep):
    steps = np.random.default_rng(2).normal(size=shape)
    expected = np.zeros(shape)
    for place, step in enumerate(steps):
        expected[place] = keep * (expected[place - 1] if place else 0.0) + step
    np.testing.assert_allclose(accumulate(steps, keep), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("span", [0, 1, 7])
@pytest.mark.parametrize("count", [8, 4000, 4001, 12_007])
def test_the_largest_step_is_found_wherever_it_is(count, span):
    values = np.random.default_rng(count + span).uniform(-1.0, 1.0, (count, 3))
    # At the ends, and between two pieces.
    values[0, 0], values[-1, 1], values[min(count - 1, 3999 + span), 2] = -5.0, -6.0, 7.0
    steps = values[span:] - values[: count - span] if span else values
    np.testing.assert_array_equal(measure_top(values, span), np.abs(steps).max(axis=0))


def test_zero_columns_stay_zero_and_no_number_is_hidden():
    matrix = np.zeros((20000, 3))
    matrix[:, 1] = 2.0
    np.testing.assert_allclose(
        np.linalg.svd(compute_triangle(matrix))[1], [2.0 * 20000**0.5, 0.0, 0.0], atol=1e-9
    )
    matrix = np.ones((10, 2))
    matrix[3, 1] = np.nan
    assert np.isnan(compute_triangle(matrix)[:, 1]).any()


@pytest.mark.parametrize(
    ("name", "dimension", "factor"),
    [
        ("deg", "angle", math.pi / 180),
        ("rpm", "angular velocity", 2 * math.pi / 60),
        ("mm/s", "velocity", 1e-3),
        ("N*m", "torque", 1.0),
        (" N  m ", "torque", 1.0),
        ("N\N{MIDDLE DOT}m", "torque", 1.0),
        ("kg*m**2", "inertia", 1.0),
        ("degC", "temperature", 1.0),
        ("ms", "time", 1e-3),
    ],
)
def test_units_have_their_dimension_and_factor(name, dimension, factor):
    assert get_unit_factor(name) == (dimension, pytest.approx(factor, rel=1e-15))


def test_names_not_in_the_table_are_refused_with_the_nearest():
    for name in ("metre", "", "nm", "degF", "degc"):
        with pytest.raises(KeyError):
            get_unit_factor(name)
    assert suggest_units("NM")[0] in ("Nm", "mN")
    assert "Nm" in suggest_units("NM")
    assert suggest_units("degre")[0] == "deg"
    assert suggest_units("!!!!") == ()
    assert all(" ".join(name.split()) == name for name in UNITS)


def test_resources_stand_beside_the_package_or_inside_it(project, monkeypatch, tmp_path):
    assert locate_resource_folder("robots") == project / "robots"
    assert locate_resource_folder("templates") == project / "templates"
    monkeypatch.setattr(symid.environment, "_PACKAGE", tmp_path / "symid")
    with raises(SymidError, "symid.missing-resource", match="install"):
        locate_resource_folder("robots")
    (tmp_path / "robots").mkdir()
    inside = tmp_path / "symid" / "_data" / "robots"
    inside.mkdir(parents=True)
    monkeypatch.setattr(symid.environment, "_PACKAGE", tmp_path / "symid")
    assert locate_resource_folder("robots") == inside


@pytest.mark.parametrize(
    ("pace", "said"),
    [
        (0.1, "joint 1 of 4"),
        (10.0, "joint 1 of 4, 30 s left"),
        (100.0, "joint 1 of 4, 5 min left"),
        (3000.0, "joint 1 of 4, 2.5 h left"),
    ],
)
def test_what_is_left_is_the_rest_at_the_same_pace(pace, said, monkeypatch):
    heard, times = [], iter((5.0, 5.0 + pace))
    monkeypatch.setattr("symid.environment.time", SimpleNamespace(monotonic=lambda: next(times)))
    report_count(heard.append, "joint")(1, 4)
    assert heard == [said]


def test_nothing_is_left_at_the_end():
    heard = []
    report_count(heard.append)(4, 4)
    assert heard == ["4 of 4"]


@dataclass(frozen=True)
class _Spring:
    joint: str
    identifiable: bool = field(default=True, metadata=keep_name("told"))


@pytest.mark.parametrize("name", ["identifiable", "told"])
def test_a_field_is_read_by_the_name_of_earlier_files_too(name):
    assert read_record(_Spring, {"joint": "a", name: False}) == _Spring("a", identifiable=False)
    assert write_plain(_Spring("a")) == {"joint": "a", "identifiable": True}
    with pytest.raises(InputError, match="told is unknown"):
        read_record(_Spring, {"joint": "a", "told": False, "identifiable": True})
