"""Samples of friction: what they keep, what they refuse."""

import numpy as np
import pytest

from symid.errors import LogError
from symid.identification.friction.samples import FrictionSamples


def build(**changes):
    fields = {
        "joint": "1",
        "time": np.arange(4.0),
        "velocity": np.ones(4),
        "torque": np.zeros(4),
        "extra": np.zeros((4, 0)),
    }
    return FrictionSamples(**(fields | changes))


def test_arrays_are_copied_and_read_only():
    velocity = np.ones(4)
    samples = build(velocity=velocity)
    velocity[0] = 5.0
    assert samples.velocity[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        samples.velocity[0] = 2.0
    assert samples.run.tolist() == [0, 0, 0, 0]
    assert samples.count == 4


def test_inputs_are_those_that_are_known():
    assert set(build().inputs) == {"velocity"}
    assert set(build(load=np.ones(4), position=np.ones(4)).inputs) == {"velocity", "load", "position"}


def test_a_temperature_is_an_input_too():
    assert set(build(temperature=np.ones(4)).inputs) == {"velocity", "temperature"}
    with pytest.raises(LogError, match=r"temperature .*shape"):
        build(temperature=np.ones(3))


def test_columns_pass_the_operator():
    columns = np.arange(8.0).reshape(4, 2)
    assert build().pass_columns(columns) is columns
    assert build(reduce=lambda values: values[::2]).pass_columns(columns).tolist() == [[0.0, 1.0], [4.0, 5.0]]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"velocity": np.ones(3)}, "shape"),
        ({"torque": np.array([0.0, np.nan, 0.0, 0.0])}, "not finite"),
        ({"extra": np.zeros((4, 2))}, r"extra .*\(4, 2\)"),
        ({"extra": np.zeros((4, 1)), "extra_names": ("J",), "extra_units": ("a", "b")}, "extra_units"),
        ({"velocity": np.zeros(0)}, "no samples"),
    ],
)
def test_what_does_not_fit_is_refused(changes, word):
    with pytest.raises(LogError, match=word) as refused:
        build(**changes)
    assert {notice.code for notice in refused.value.notices} == {"friction.samples"}
