"""Samples of friction: what they keep, what they refuse."""

import numpy as np
import pytest

from symid.errors import LogError
from symid.identification.friction.joint_fit import FrictionSamples, build_reduction, list_shaped_columns
from symid.identification.friction.selection import CANDIDATE_LAWS
from symid.joint_models import compute_columns, get_law
from symid.joint_models.friction_catalogue import FRICTION_LAWS
from symid.robot import Decimation


def build(**changes):
    fields = {
        "joint": "1",
        "time": np.arange(4.0),
        "velocity": np.ones(4),
        "torque": np.zeros(4),
        "extra": np.zeros((4, 0)),
    }
    return FrictionSamples(**(fields | changes))


def test_inputs_are_those_that_are_known_and_columns_pass_the_operator():
    assert set(build().inputs) == {"velocity"}
    given = ("load", "position", "temperature")
    assert set(build(**dict.fromkeys(given, np.ones(4))).inputs) == {"velocity", *given}
    columns = np.arange(8.0).reshape(4, 2)
    assert build().pass_columns(columns) is columns
    assert build(reduce=lambda values: values[::2]).pass_columns(columns).tolist() == [[0.0, 1.0], [4.0, 5.0]]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"velocity": np.ones(3)}, "shape"),
        ({"temperature": np.ones(3)}, r"temperature .*shape"),
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


@pytest.mark.parametrize("smoothing", [0.0, 0.02])
@pytest.mark.parametrize("name", [*FRICTION_LAWS, *CANDIDATE_LAWS])
def test_columns_that_depend_on_the_shape_are_those_that_change_with_it(name, smoothing):
    law = get_law(name, smoothing=smoothing)
    rng = np.random.default_rng(6)
    drawn = dict(zip(("velocity", "load", "temperature"), rng.normal(size=(3, 200)), strict=True))
    inputs = {**drawn, "position": np.zeros(200)}
    one, *others = (compute_columns(law, inputs, rng.uniform(0.1, 1.5, len(law.shape))) for _ in range(9))
    changed = np.any([np.any(one != other, axis=0) for other in others], axis=0)
    assert list_shaped_columns(law) == np.flatnonzero(changed).tolist()


def draw_long(count=5000):
    rng = np.random.default_rng(7)
    return FrictionSamples(
        joint="1",
        time=np.arange(count) * 1e-3,
        velocity=np.sin(np.arange(count) / 300.0) + 0.01 * rng.normal(size=count),
        torque=rng.normal(size=count),
        extra=rng.normal(size=(count, 2)),
        extra_names=("a", "b"),
        run=np.repeat([0, 1], [2000, count - 2000]),
        reduce=build_reduction([2000, count - 2000], Decimation(factor=10)),
    )


def test_columns_and_rows_that_are_kept_are_those_that_pass_the_operator():
    samples = draw_long()
    kept = np.random.default_rng(8).uniform(size=500) < 0.7
    then = np.arange(kept.sum()) % 3 > 0
    part = samples.select_rows(kept).select_rows(then)
    for name in (*CANDIDATE_LAWS, "stribeck+offset"):
        law = get_law(name)
        if "load" in law.inputs:
            continue
        for scale in (0.2, 0.5, 0.2):
            shape = [scale] * len(law.shape)
            passed = samples.pass_columns(compute_columns(law, samples.inputs, shape))
            np.testing.assert_array_equal(samples.pass_law(law, shape), passed)
            np.testing.assert_array_equal(part.pass_law(law, shape), passed[kept][then])
    whole, rows = samples.build_rows(), part.build_rows()
    np.testing.assert_array_equal(whole.torque, samples.pass_columns(samples.torque[:, None])[:, 0])
    np.testing.assert_array_equal(rows.extra, samples.pass_columns(samples.extra)[kept][then])
    assert set(rows.run.tolist()) == {0, 1}
    with pytest.raises(ValueError, match="read-only"):
        samples.pass_law(get_law("coulomb"), ())[0] = 1.0


def test_columns_pass_the_filter_once():
    calls = []
    samples = draw_long()
    names = ("joint", "time", "velocity", "torque", "extra", "extra_names")
    counted = FrictionSamples(
        **{name: getattr(samples, name) for name in names},
        reduce=lambda columns: calls.append(columns.shape[1]) or samples.reduce(columns),
    )
    for speed, passed in ((0.1, 4), (0.1, 4), (0.2, 5)):
        counted.pass_law(get_law("stribeck+offset"), [speed])
        assert sum(calls) == passed
