"""Calls that only Python can make: numbers of NumPy, logs in memory, options that have no meaning."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest

import symid
from symid import IdentifyOptions
from symid.identification.elastic.options import ElasticOptions
from symid.serialization import write_json
from tests.refusals import raises

FACTOR = IdentifyOptions(prior_factor=2.0)
PROJECT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def log(robot):
    return robot.simulate(seed=1, duration=5.0).log


@pytest.fixture(scope="module")
def fit(robot, log):
    return robot.identify(log)


def find_code(call, error=symid.UsageError):
    with pytest.raises(error) as caught:
        call()
    return caught.value.notices[0].code


def test_numbers_of_numpy_are_numbers(robot, log, tmp_path):
    half = IdentifyOptions(window=0.5)
    plain = robot.identify(log, rows="momentum", cutoff=40.0, decimate=2, options=half)
    half = IdentifyOptions(window=np.float32(0.5), cutoff=np.float32(40.0), decimate=np.int64(2))
    other = robot.identify(log, rows="momentum", options=half)
    assert other.settings["window"] == plain.settings["window"] == 0.5
    assert other.values == plain.values
    ridge = robot.identify(log, estimator="ridge", options=IdentifyOptions(prior_weight=np.float32(1.0)))
    assert ridge.save(tmp_path / "ridge.json").exists()
    for period in (np.int64(2), np.float32(2.0), np.array([2.0])):
        assert find_code(lambda period=period: robot.identify(log, period=period)) == "usage.mixed-options"
    law = robot.identify_friction(log, model="coulomb-viscous", smoothing=np.float32(0.01))
    assert law.save(tmp_path / "law.json").exists()
    assert write_json(robot.simulate(duration=np.float32(0.5), seed=np.int64(3)).to_dict())
    assert write_json({"x": np.float32(0.5), "y": np.bool_(1)}) == write_json({"x": 0.5, "y": True})


def test_torque_constants_may_be_an_array():
    urdf = PROJECT / "docs/own_robot/arm.urdf"
    joints = len(symid.load(urdf).joints)
    texts = {
        symid.new_robot(urdf=urdf, torque_constant=constant).text
        for constant in (0.125, np.float64(0.125), np.full(joints, 0.125))
    }
    assert [text.count("torque_constant = 0.125") for text in texts] == [joints]


def test_the_same_samples_are_not_counted_twice(robot, log):
    copied = symid.build_log(robot, time=log.time, q=log.q, tau=log.tau, source="copy")
    for logs in ([log, log], [log, copied]):
        assert find_code(lambda logs=logs: robot.identify(logs)) == "usage.same-log"
        assert find_code(lambda logs=logs: robot.payload(logs, log)) == "usage.same-log"


def test_a_log_of_another_robot_is_refused(fit, log):
    panda = symid.load("panda")
    for call in (panda.identify, panda.check):
        assert find_code(lambda call=call: call(log), symid.LogError) == "log.joints"
    zeros = np.zeros((100, 7))
    strange = symid.build_log(panda, time=np.arange(100.0), q=zeros, tau=zeros)
    assert find_code(lambda: fit.validate(strange), symid.LogError) == "log.joints"


def test_one_log_is_tried_at_a_time(robot, fit, log):
    for logs in ([log, log], []):
        assert find_code(lambda logs=logs: fit.validate(logs)) == "usage.one-log"
        assert find_code(lambda logs=logs: robot.study_cutoff(logs)) == "usage.one-log"


def test_how_a_log_is_read_is_said_before_it_is_read(robot, fit, log, tmp_path):
    settings = {"log.torque.factor": 2.0}
    for call in (
        lambda: robot.identify(log, settings=settings),
        lambda: fit.validate(log, settings=settings),
        lambda: fit.report(tmp_path / "page.html", validation=log, settings=settings),
    ):
        assert find_code(call) == "usage.read-before"


def test_options_without_a_meaning_are_refused(robot, fit, log, tmp_path):
    assert (
        find_code(lambda: robot.identify(log, options=IdentifyOptions(refine=False))) == "usage.mixed-options"
    )
    page = tmp_path / "page.html"
    unread = {"processing.filter_cutoff": 20}
    assert find_code(lambda: fit.report(page, settings=unread)) == "usage.no-validation"
    assert find_code(fit.compare) == "usage.no-other"
    assert find_code(lambda: robot.write("python", tmp_path / "code", functions=[])) == "usage.functions"
    assert not page.exists()


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (lambda robot, _: robot.identify("nowhere.csv", estimator="lasso"), "usage.unknown-estimator"),
        (lambda _, __: IdentifyOptions(prior_weight=-1.0), "usage.prior"),
        (lambda _, __: IdentifyOptions(prior_percent=0.0), "usage.prior"),
        (
            lambda robot, log: robot.identify_friction(log, model="coulomb", smoothing=-1.0),
            "usage.friction-smoothing",
        ),
        (lambda robot, _: robot.simulate(duration=-1.0), "usage.trajectory"),
        (lambda robot, _: robot.derive_base("power"), "usage.base-form"),
        (lambda robot, _: robot.export("two_link.h", precision="half"), "usage.export-precision"),
        (lambda robot, _: robot.export("two_link.h", name="tool a"), "usage.export-name"),
        (lambda robot, _: robot.export("two_link.urdf", name="tool_a"), "usage.export-name"),
        (lambda _, __: ElasticOptions(stops=2.5), "usage.elastic-option"),
        (lambda robot, _: robot.simulate(seed=-1), "usage.range"),
        (lambda robot, _: robot.simulate(noise=[0.1, 0.2]), "usage.range"),
        (lambda robot, _: robot.excite(seed=-1), "usage.range"),
        (lambda robot, _: robot.study_precision(seeds=0), "usage.range"),
        (lambda robot, _: robot.payload("a.npz", "b.npz", rows="power"), "usage.range"),
        (lambda robot, _: robot.payload("a.npz", "b.npz", estimator="gls"), "usage.range"),
        (lambda robot, _: robot.payload("a.npz", "b.npz", mass=float("inf")), "usage.range"),
    ],
)
def test_values_out_of_range_are_refused(robot, log, call, code):
    assert find_code(lambda: call(robot, log)) == code


def test_arrays_that_hold_no_numbers_are_refused(robot):
    times = ["now", "later"]
    wrong = (lambda: symid.build_log(robot, time=times, q=[[0, 0]] * 2, tau=[[0, 0]] * 2), symid.LogError)
    assert find_code(*wrong) == "log.arrays"


def test_what_made_a_log_may_be_any_text(robot, log):
    made = symid.build_log(robot, time=log.time, q=log.q, tau=log.tau, source="x" * 300)
    assert robot.identify(made).sources == ("x" * 300,)


def test_a_fit_to_a_log_in_memory_cannot_be_diagnosed(fit):
    assert find_code(fit.diagnose, symid.LogError) == "diagnosis.no-file"


def test_robots_and_fits_are_copied_and_pickled_after_use(robot, fit, log):
    assert robot.library.backend
    for again in (copy.deepcopy(fit), pickle.loads(pickle.dumps(fit))):  # noqa: S301  our own bytes
        assert again.values == fit.values
        assert again.validate(log).mean_relative_percent == fit.validate(log).mean_relative_percent
    assert pickle.loads(pickle.dumps(robot)).library.backend == robot.library.backend  # noqa: S301


def test_a_log_keeps_the_map_that_it_was_read_with(tmp_path):
    robot = symid.load("two_link")
    path = robot.simulate(seed=1, duration=3.0).save(tmp_path / "a.npz")
    columns = {"log.torque.columns": "tau", "log.torque.unit": "mN m"}
    other = robot.override(settings=columns)
    log = symid.read_log(path, other)
    fit = robot.identify(log)
    assert fit.settings["log"]["torque"]["unit"] == "mN m"
    assert fit.validate(path).mean_relative_percent == pytest.approx(
        fit.validate(log).mean_relative_percent, rel=1e-12
    )
    with raises(symid.UsageError, "usage.read-before"):
        robot.identify([log, symid.read_log(path, robot)])


def test_a_copy_of_a_log_without_a_file_is_refused(tmp_path):
    robot = symid.load("two_link")
    log = robot.simulate(duration=2.0).log
    with raises(symid.UsageError, "usage.no-file"):
        robot.check(log, resample=tmp_path / "even.npz")
