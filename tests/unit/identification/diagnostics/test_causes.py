"""A single mistake in a log is found by undoing it, and a log without one names nothing."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from symid.codegen.cache import prepare_library
from symid.identification import judge
from symid.identification.diagnostics import causes
from symid.identification.diagnostics.causes import (
    TERM,
    FollowedLogs,
    Hypothesis,
    TriedFit,
    TriedHypothesis,
    evaluate_motion,
    find_causes,
    fit_motion,
    holds,
    list_mistakes,
    list_terms,
    mask_impossible,
    suspect_logs,
)
from symid.identification.rigid.log_check import judge_log, study_log
from symid.logs.signals import low_pass
from tests.recovery.closed_form import TWO_LINK_TRUTH
from tests.unit.identification.diagnostics.thin_logs import thin
from tests.unit.identification.pinocchio_arm import ARM, record_arm
from tests.unit.identification.rigid.two_link_logs import LIBRARY, record

LATE = 40
"""Samples, 200 ms: less than half of it is no other than a filter in a motion of 1 Hz."""
ALL = slice(None)


@pytest.fixture(scope="module")
def library():
    return prepare_library(ARM)


@pytest.fixture(scope="module")
def logs():
    return [record_arm(seed) for seed in (1, 2)]


def diagnose(library, log):
    return judge_log(library, study_log(library, log, ARM.processing), ARM)


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


def leave(library, log):
    """Return the largest percent of a joint's torque that a fit of the thinned log leaves when held out."""
    logs = thin(library, log)
    found = fit_motion(evaluate_motion(library, logs.motion), logs.motion, logs.fold)
    return 100.0 * np.sqrt(found.losses.sum(axis=0).max())


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
    "gear 2": (change("torque", 1, lambda x: 0.2 * x), UNIT, "torque of joint 'joint2' is about 0.2 times"),
    "millinewton": (change("torque", 2, lambda x: 1e3 * x), UNIT, "joint 'joint3' is about 1000 times"),
    "late": (delay, "log.torque-delay", " ms after"),
    "early": (advance, "log.torque-delay", " ms before"),
    "quarter turn": (
        change("position", 1, lambda x: x + np.pi / 2),
        "log.joint-zero",
        "'joint2' is off by about 1.6 rad",
    ),
}


@pytest.mark.parametrize(("place", "mistake"), list(enumerate(MISTAKES)))
def test_a_single_mistake_is_found(library, logs, place, mistake):
    spoil, code, words = MISTAKES[mistake]
    log = logs[place % 2]
    found = diagnose(library, spoil(log))
    named = [entry for entry in found.causes if entry.code == code and words in entry.cause]
    assert named, [entry.cause for entry in found.causes]
    if code == "log.joint-zero":
        # The log reads a quarter turn too much.
        line = re.search(r"offset = \[(.*?)\]", named[0].remedy)[1]
        np.testing.assert_allclose([float(part) for part in line.split(",")], [0, -np.pi / 2, 0], atol=0.05)
    (cause,) = named
    assert cause.remedy
    assert cause.p < 0.01 or found.impossible
    # Undone, the log is about as good as without the mistake, and others explain it hardly better.
    assert cause.after < 1.6 * leave(library, log)
    assert cause.after < 2.0 * found.causes[0].after
    assert len(found.causes) <= 3


def test_an_upright_first_axis_leaves_open_which_sign_is_wrong(library, logs):
    for name in ("torque", "position"):
        found = diagnose(library, change(name, 0, np.negative)(logs[0]))
        assert found.impossible
        assert {entry.code for entry in found.causes} == {SIGN, "log.position-sign"}
        assert all("of joint 'joint1' has the wrong sign" in entry.cause for entry in found.causes)


def test_logs_without_a_mistake_name_none(library, logs):
    clean = [diagnose(library, log) for log in logs]
    for found in clean:
        assert found.unexplained < 6.0
        assert (found.causes, found.impossible) == ((), ())
    # A zero of the upright axis, or of the last joint, no torque shows: it goes into the parameters.
    for joint in (0, 2):
        found = diagnose(library, change("position", joint, lambda x: x + 0.8)(logs[0]))
        assert found.causes == ()
        assert found.unexplained == pytest.approx(clean[0].unexplained, rel=0.05)
    noise = np.random.default_rng(3).normal(size=logs[0].torque.shape)
    found = diagnose(library, replace(logs[0], torque=noise))
    assert found.unexplained > 90.0
    assert found.causes == ()


@pytest.mark.parametrize("cutoff", [1.0, 4.0])
def test_a_low_pass_of_torques_is_no_delay(library, logs, cutoff):
    """As a delay it would explain most."""
    coefficients = butter(2, cutoff, fs=1.0 / logs[0].period)
    torque = lfilter(*coefficients, logs[0].torque - logs[0].torque[0], axis=0) + logs[0].torque[0]
    found = diagnose(library, replace(logs[0], torque=torque))
    assert found.unexplained > 6.0
    assert found.causes == ()


@pytest.mark.parametrize(("before", "named"), [(0.29, 1), (0.31, 0)])
def test_a_sign_cures_only_what_was_usable(monkeypatch, before, named):
    logs = thin(LIBRARY, record(0))
    motion, turned = logs.motion, replace(logs.motion, tau=-logs.motion.tau)

    def fit(columns, other, *rest):
        squares = np.full(2, (before if other is motion else 0.28) ** 2)
        return TriedFit(fit=None, losses=np.tile(squares / 24.0, (24, 1)), squares=squares)

    monkeypatch.setattr(causes, "fit_motion", fit)
    monkeypatch.setattr(causes, "mask_impossible", lambda *given: np.array([given[1] is motion] * 2))
    undone = Hypothesis("log.torque-sign", "sign", "a cause", "a remedy", turned)
    followed = FollowedLogs.follow(LIBRARY, motion, logs.fold)
    assert len(find_causes(followed, [undone], impossible=True)) == named


def find_all(logs):
    """Return the causes of thinned logs of two links, of all hypotheses."""
    followed = FollowedLogs.follow(LIBRARY, logs.motion, logs.fold)
    base = fit_motion(followed.columns, followed.motion, logs.fold)
    every = [*suspect_logs(followed), *list_mistakes(followed), *list_terms(followed, base.fit.values)]
    assert len(every) >= 36
    return find_causes(followed, every)


@pytest.mark.parametrize("seed", range(4))
def test_no_hypothesis_explains_a_clean_log(seed):
    """All are tried, whatever speaks for it."""
    assert find_all(thin(LIBRARY, record(seed, torque=0.5))) == ()


TERMS = {"velocity": lambda dq: 0.4 * np.abs(dq) + 0.15 * (dq > 0.0), "position": None}


@pytest.mark.parametrize("term", TERMS)
def test_a_term_that_the_model_lacks_is_named_at_its_joint(term):
    log = record(1, torque=0.05, friction=TERMS[term])
    if TERMS[term] is None:
        torque = log.torque.copy()
        torque[:, 1] += 2.0 * log.position[:, 1]
        log = replace(log, torque=torque)
    logs = thin(LIBRARY, log)
    followed = FollowedLogs.follow(LIBRARY, logs.motion, logs.fold)
    base = fit_motion(followed.columns, logs.motion, logs.fold)
    found = find_causes(followed, list_terms(followed, base.fit.values))
    assert found[0].family == f"{term} of joint2"
    assert found[0].joints == ("joint2",)
    assert found[0].after < 0.7 * found[0].before


def test_a_log_whose_joints_are_noise_still_shows_the_unit_of_another(library, logs):
    """The torques of two joints are mostly noise, so that the mean of all changes little."""
    noise = np.random.default_rng(3).normal(size=(len(logs[0].time), 2))
    noise = low_pass(noise, period=logs[0].period, cutoff=1.0, order=4)
    torque = logs[0].torque.copy()
    torque[:, :2] += 1.3 * np.sqrt(np.mean(torque[:, :2] ** 2, axis=0)) * noise / np.std(noise, axis=0)
    log = replace(logs[0], torque=torque)
    assert diagnose(library, log).causes == ()
    found = diagnose(library, change("torque", 2, lambda x: 1e3 * x)(log))
    assert found.causes == ()
    assert max(found.joints, key=lambda entry: entry.held_out).joint in {"joint1", "joint2"}


def test_joints_that_friction_drives_and_a_negative_inertia_are_impossible():
    logs = thin(LIBRARY, record(0), record(1))
    motion = logs.motion
    followed = FollowedLogs.follow(LIBRARY, motion, logs.fold)
    columns = followed.columns

    def find(tau):
        other = replace(motion, tau=tau)
        return mask_impossible(followed, other, fit_motion(columns, other, logs.fold).fit).tolist()

    for joint in (0, 1):
        turned = motion.tau.copy()
        turned[:, joint] *= -1.0
        assert find(turned)[joint]
    assert find(-motion.tau) == [True, True]
    assert find(motion.tau) == [False, False]
    # Torques of a body whose inertia is turned, with friction as before: only the inertia is negative.
    assert find(columns @ (TWO_LINK_TRUTH * np.array([1, 1, 1, -1, 1, 1, *[1] * 6]))) == [False, True]


def test_a_fit_of_thinned_logs_gives_the_truth_and_what_others_leave():
    logs = thin(LIBRARY, record(0, torque=0.5))
    motion, columns = logs.motion, evaluate_motion(LIBRARY, logs.motion)
    found = fit_motion(columns, motion, logs.fold)
    np.testing.assert_allclose(found.fit.values, TWO_LINK_TRUTH, rtol=0.1, atol=0.05)
    left, kept = np.zeros((len(logs.fold), 2)), motion.kept
    weights = found.fit.weights
    for fold in range(6):
        outside = logs.fold[motion.block] != fold
        rows = np.vstack([columns[outside & kept[:, k], k] * np.sqrt(weights[k]) for k in (0, 1)])
        tau = np.concatenate([motion.tau[outside & kept[:, k], k] * np.sqrt(weights[k]) for k in (0, 1)])
        values = np.linalg.lstsq(rows, tau)[0]
        np.testing.assert_allclose(found.fit.folds[fold], values, rtol=1e-5, atol=1e-5)
        errors = np.where(kept, motion.tau - columns @ values, 0.0)
        for block in np.flatnonzero(logs.fold == fold):
            left[block] = np.sum(errors[motion.block == block] ** 2, axis=0)
    sizes = np.sum(np.where(kept, motion.tau, 0.0) ** 2, axis=0)
    np.testing.assert_allclose(found.losses, left / sizes, rtol=1e-4)


@pytest.mark.parametrize("times", [3.0, 1e3])
def test_times_that_inertias_absorb_are_no_other_mistake(library, logs, times):
    """Inertias grow with their square, viscous friction with them: nothing that torques surely show."""
    found = diagnose(library, replace(logs[0], time=times * logs[0].time))
    assert {entry.code for entry in found.causes} <= {"log.time-scale"}


def test_a_robot_that_is_mounted_otherwise_than_its_file_says(library):
    found = diagnose(library, record_arm(1, gravity=(9.81, 0.0, 0.0)))
    assert found.causes[0].code == "robot.gravity"
    (gravity,) = (entry for entry in found.tests if entry.what == "gravity")
    assert gravity.verdict == "different"
    # A right angle, as percent of a radian.
    assert gravity.size == pytest.approx(100.0 * np.sqrt(2.0), rel=0.05)
    upright = diagnose(library, record_arm(1))
    assert {entry.verdict for entry in upright.tests if entry.what == "gravity"} <= {"same", "inconclusive"}


def test_no_mistake_is_blamed_for_a_joint_of_noise(library, logs):
    """Many explain such a joint better, and ruin the others."""
    rng = np.random.default_rng(5)
    found = diagnose(library, change("torque", 1, lambda x: np.std(x) * rng.normal(size=len(x)))(logs[0]))
    assert max(found.joints, key=lambda entry: entry.held_out).joint == "joint2"
    assert {entry.code for entry in found.causes} <= {TERM}


def test_a_rival_is_not_excluded_by_a_short_log(library, logs, monkeypatch):
    late = thin(library, delay(logs[0]))
    followed = FollowedLogs.follow(library, late.motion, late.fold)
    every = list_mistakes(followed)
    undone = next(entry for entry in every if "ms after" in entry.cause)
    rival = replace(undone, family="another")
    for first, named in ((0.0, 2), (0.5, 0)):
        monkeypatch.setattr(judge, "adjust_chances", lambda p, first=first: [first, *[0.5] * (len(p) - 1)])
        assert len(find_causes(followed, [undone, rival])) == named


def test_logs_of_different_robots_contradict_each_other():
    heavier = TWO_LINK_TRUTH * np.where(np.arange(len(TWO_LINK_TRUTH)) < 3, 1.3, 1.0)
    for truth, codes in ((heavier, ["identify.logs"]), (TWO_LINK_TRUTH, [])):
        logs = thin(LIBRARY, record(0, torque=0.02), record(1, torque=0.02, truth=truth))
        assert [entry.code for entry in find_all(logs)] == codes


def test_rows_that_a_delay_leaves_out_are_no_part_of_what_it_explains():
    """Torques are wrong at one end: without these rows, and with torques as they are, all is explained."""
    logs = thin(LIBRARY, record(0, torque=0.02))
    end = np.arange(len(logs.motion.q)) > 0.9 * len(logs.motion.q)
    motion = replace(logs.motion, tau=logs.motion.tau + np.where(end[:, None], 20.0, 0.0))
    shorter = replace(motion, kept=motion.kept & ~end[:, None])
    for code, count in (("log.time-scale", 1), ("log.torque-delay", 0)):
        undone = Hypothesis(code, code, "a cause", "a remedy", shorter)
        followed = FollowedLogs.follow(LIBRARY, motion, logs.fold)
        assert len(find_causes(followed, [undone])) == count


@pytest.mark.parametrize(("after", "kept"), [(0.022, True), (0.14, False)])
def test_a_joint_is_spoilt_by_what_matters_of_its_torque(after, kept):
    """One joint is explained, of the other hardly or much more is left."""
    before, found = (
        TriedFit(fit=None, losses=np.tile(np.square(left) / 24.0, (24, 1)), squares=np.square(left))
        for left in ([0.3, 0.014], [0.01, after])
    )
    undone = Hypothesis("log.joint-zero", "zero", "a cause", "a remedy", None)
    assert holds(TriedHypothesis(undone, before, found, 0.0, 2.0, 2.0), [0, 1]) == kept
    # The joint that it touches must be explained, not the mean alone.
    poor = replace(found, losses=np.tile(np.square([0.31, 0.01]) / 24.0, (24, 1)))
    assert holds(TriedHypothesis(undone, before, poor, 0.0, 2.0, 2.0), [0, 1])
    assert not holds(TriedHypothesis(replace(undone, joints=(0,)), before, poor, 0.0, 2.0, 2.0), [0, 1])
