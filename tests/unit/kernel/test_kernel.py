"""Errors, notation, provenance, arrays."""

from dataclasses import dataclass
from enum import Enum
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.environment import write_file
from symid.errors import Notice, RobotError, SymidError
from symid.notation import INERTIAL, SYMBOLS, get_unit
from symid.serialization import compute_signature, write_canonical, write_plain


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
