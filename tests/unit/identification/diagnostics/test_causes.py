"""A single mistake in a log is named by undoing it, and a log without one names nothing."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.diagnostics.causes import build_quick_logs, find_cause, fit_quick, mask_impossible
from symid.identification.diagnostics.stretches import measure_scoring_band
from symid.identification.rigid.plan import cut_moving_ends
from symid.logs.signals import low_pass
from symid.robot.description import Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link
from tests.unit.identification.pinocchio_arm import ARM, record_arm

LATE = 20
"""Samples, 100 ms."""
ALL = slice(None)


@pytest.fixture(scope="module")
def library():
    return prepare_library(ARM)


@pytest.fixture(scope="module")
def logs():
    return [record_arm(seed) for seed in (1, 2)]


def diagnose(library, *recordings, held_out=None):
    """Return the quick fit of logs, the likeliest cause, and whether anything in the fit is impossible.

    `held_out` is what a better fit leaves.
    """
    scoring = measure_scoring_band(recordings)
    cutoff = min(scoring, 0.4 / recordings[0].period)
    settings = cut_moving_ends(Processing(filter_cutoff=cutoff), recordings)
    quick = build_quick_logs(library, recordings, settings, scoring)
    fit = fit_quick(quick)
    return fit, find_cause(quick, fit, held_out=held_out), mask_impossible(quick, fit).any()


def change(name, joint, function):
    """Return what changes one column of a channel."""

    def spoil(log):
        values = getattr(log, name).copy()
        values[:, joint] = function(values[:, joint])
        return replace(log, **{name: values})

    return spoil


def exchange(first, second, *names):
    def spoil(log):
        order = [0, 1, 2]
        order[first], order[second] = second, first
        return replace(log, **{name: getattr(log, name)[:, order] for name in names})

    return spoil


def delay(log):
    """Return the log with torques that come `LATE` after the motion."""
    return replace(log, time=log.time[:-LATE], position=log.position[LATE:], torque=log.torque[:-LATE])


def advance(log):
    return replace(log, time=log.time[:-LATE], position=log.position[:-LATE], torque=log.torque[LATE:])


SIGN, UNIT, SWAPPED = "log.torque-sign", "log.wrong-unit", "log.swapped-joints"
MISTAKES = {
    "all torques": (lambda log: replace(log, torque=-log.torque), SIGN, "all torques"),
    "torque 2": (change("torque", 1, np.negative), SIGN, "torque of joint 'joint2'"),
    "torque 3": (change("torque", 2, np.negative), SIGN, "torque of joint 'joint3'"),
    "position 2": (change("position", 1, np.negative), "log.position-sign", "position of joint 'joint2'"),
    "position 3": (change("position", 2, np.negative), "log.position-sign", "position of joint 'joint3'"),
    "torques 1 2": (exchange(0, 1, "torque"), SWAPPED, "torques of 'joint1' and 'joint2'"),
    "torques 2 3": (exchange(1, 2, "torque"), SWAPPED, "torques of 'joint2' and 'joint3'"),
    "positions 1 3": (exchange(0, 2, "position"), SWAPPED, "positions of 'joint1' and 'joint3'"),
    "joints 2 3": (exchange(1, 2, "position", "torque"), SWAPPED, "joints 'joint2' and 'joint3' are"),
    "degrees": (change("position", ALL, np.degrees), UNIT, "positions are in degrees"),
    "radians": (change("position", ALL, np.radians), UNIT, "positions are in radians"),
    "degrees 3": (change("position", 2, np.degrees), UNIT, "joint 'joint3' are in degrees"),
    "millinewton": (
        change("torque", 2, lambda x: 1e3 * x),
        UNIT,
        "torque of joint 'joint3' is about 1000 times",
    ),
    "slower": (lambda log: replace(log, time=2.0 * log.time), "log.time-scale", " 2 times "),
    "milliseconds": (lambda log: replace(log, time=1e3 * log.time), "log.time-scale", " 1000 times "),
    "late": (delay, "log.torque-delay", "about 100 ms after"),
    "early": (advance, "log.torque-delay", "about 100 ms before"),
    "zero": (change("position", 1, lambda x: x + 0.8), "log.joint-zero", "zero of joint 'joint2'"),
    "quarter turn": (
        change("position", 1, lambda x: x + np.pi / 2),
        "log.joint-zero",
        "'joint2' is off by about 1.6 rad",
    ),
}


@pytest.mark.parametrize(("place", "mistake"), list(enumerate(MISTAKES)))
def test_a_single_mistake_is_named(library, logs, place, mistake):
    spoil, code, words = MISTAKES[mistake]
    log = logs[place % 2]
    clean = diagnose(library, log)[0]
    found, cause, impossible = diagnose(library, spoil(log))
    assert (cause.code, words in cause.cause) == (code, True), cause.cause
    assert cause.remedy
    # Undone, the log is about as good as without the mistake.
    assert cause.percent < 0.6 * found.percent or impossible
    assert cause.percent < 1.6 * clean.percent


def test_a_mistake_that_hides_in_the_mean_is_named_by_the_joint_that_it_spoils(library, logs):
    """The torques of two joints are mostly noise, so that the mean of all changes little."""
    noise = np.random.default_rng(3).normal(size=(len(logs[0].time), 2))
    noise = low_pass(noise, period=logs[0].period, cutoff=1.0, order=4)
    torque = logs[0].torque.copy()
    torque[:, :2] += 1.3 * np.sqrt(np.mean(torque[:, :2] ** 2, axis=0)) * noise / np.std(noise, axis=0)
    log = replace(logs[0], torque=torque)
    poor = np.full(3, 100.0)
    clean, none, _ = diagnose(library, log, held_out=poor)
    assert none.joint == ""
    assert not np.isfinite(none.percent)
    spoiled = change("torque", 2, lambda x: 1e3 * x)(log)
    found, cause, _ = diagnose(library, spoiled, held_out=poor)
    assert cause.percent > 0.7 * found.percent
    assert cause.percent == pytest.approx(clean.percent, rel=0.01)
    assert (cause.code, cause.joint) == ("log.wrong-unit", "joint3")
    assert "torque of joint 'joint3' is about 1000 times" in cause.cause
    before, after = cause.leaves
    assert after < 0.3 * before
    assert "of the held-out torque of joint3, not" in cause.effect
    # A better fit that leaves as little has no need of the mistake; without one nothing is said.
    for better in (np.array([100.0, 100.0, after]), None):
        assert diagnose(library, spoiled, held_out=better)[1].joint == ""


def test_an_upright_first_axis_leaves_open_which_sign_is_wrong(library, logs):
    for name in ("torque", "position"):
        _, cause, _ = diagnose(library, change(name, 0, np.negative)(logs[0]))
        assert cause.code in {"log.torque-sign", "log.position-sign"}
        assert "of joint 'joint1' has the wrong sign" in cause.cause


def test_logs_without_a_mistake_name_none(library, logs):
    for recordings in ([logs[0]], [logs[1]], logs):
        found, cause, impossible = diagnose(library, *recordings)
        assert found.percent < 6.0
        assert not impossible
        # No mistake undone makes them better: all that could be said is that the model is not exact.
        assert (cause.code, cause.percent) == ("log.other-robot", float("inf"))
    # A zero of the upright axis, or of the last joint, no torque shows: it goes into the parameters.
    clean = diagnose(library, logs[0])[0]
    for joint in (0, 2):
        found, cause, _ = diagnose(library, change("position", joint, lambda x: x + 0.8)(logs[0]))
        assert cause.code == "log.other-robot"
        np.testing.assert_allclose(found.held_out, clean.held_out, rtol=1e-3)
    noise = np.random.default_rng(3).normal(size=logs[0].torque.shape)
    found, cause, _ = diagnose(library, replace(logs[0], torque=noise))
    assert np.all(found.held_out > 95.0)
    assert (cause.code, cause.percent) == ("log.unrelated-torque", float("inf"))


def test_a_delay_longer_than_the_log_explains_nothing():
    """Times a thousand times too small: 20 ms of motion, which no delay of 20 ms may undo."""
    library = build_two_link()
    log = build_recording(library, TWO_LINK_TRUTH, samples=4001, period=5e-3, seed=1)
    _, cause, _ = diagnose(library, replace(log, time=1e-3 * log.time))
    assert cause.code != "log.torque-delay"
    assert cause.code in {"log.time-scale", "log.other-robot"}
