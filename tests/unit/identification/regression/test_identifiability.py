from dataclasses import replace

import numpy as np
import pytest

from symid.errors import IdentifiabilityError, LogError, UsageError
from symid.identification.estimators.least_squares import fit_ols, fit_wls
from symid.identification.regression.equations import build_rows
from symid.identification.regression.identifiability import (
    analyse_identifiability,
    hold_resting_joints,
    list_resting_joints,
)
from symid.identification.rigid.fit import identify_parameters
from symid.logs.recording import Recording
from symid.robot.description import Processing
from tests.recovery.closed_form import (
    ONE_AXIS_TRUTH,
    TWO_LINK_TRUTH,
    build_one_axis,
    build_recording,
    build_signals,
    build_two_link,
)
from tests.refusals import raises
from tests.unit.identification.row_tables import make_rows

PLAIN = Processing()
FILTERED = Processing(filter_cutoff=200.0)


def draw(m=60, p=4):
    rng = np.random.default_rng(5)
    return rng.normal(size=(m, p)) * [1, 1e3, 1e-3, 10], rng.normal(size=m)


@pytest.mark.parametrize("estimator", [fit_ols, fit_wls])
def test_one_group_gives_the_textbook_fit(estimator):
    matrix, values = draw()
    rows = make_rows(matrix, values)
    fit = estimator(rows, analyse_identifiability(rows))
    expected = np.linalg.lstsq(matrix, values, rcond=None)[0]
    e = values - matrix @ expected
    covariance = e @ e / 56 * np.linalg.inv(matrix.T @ matrix)
    np.testing.assert_allclose(fit.values, expected, rtol=1e-10)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-8)
    assert fit.condition == pytest.approx(np.linalg.cond(matrix / np.linalg.norm(matrix, axis=0)))


@pytest.mark.parametrize(("freedom", "rest"), [("band", 0.8 * 60 - 4), ("parameters", 56), ("one", 59)])
def test_the_variance_is_divided_as_asked(freedom, rest):
    rows = replace(make_rows(*draw()), independent=0.8)
    seen = analyse_identifiability(rows)
    fit = fit_ols(rows, seen, freedom)
    expected = fit.residuals @ fit.residuals / rest * np.linalg.inv(rows.matrix.T @ rows.matrix)
    np.testing.assert_allclose(fit.covariance, expected, rtol=1e-8)


def test_weights_are_the_scatter_that_their_own_fit_leaves():
    matrix, values = draw()
    group = np.repeat([0, 1], 30)
    values[group == 1] *= 50
    rows = make_rows(matrix, values, group)
    seen = analyse_identifiability(rows)
    fit = fit_wls(rows, seen)
    e = fit.residuals
    w = 1 / np.array([np.linalg.norm(e[group == j]) / np.sqrt(26) for j in (0, 1)])[group]
    expected = np.linalg.lstsq(matrix * w[:, None], values * w, rcond=None)[0]
    np.testing.assert_allclose(fit.values, expected, rtol=1e-5)
    np.testing.assert_allclose(fit.weights, w, rtol=1e-5)


def test_columns_that_tell_nothing_are_refused_without_harm_to_the_others():
    """A column of zeros, and columns in fixed proportion together."""
    matrix, values = draw()
    expected = np.linalg.lstsq(matrix[:, [0, 1, 3]], values, rcond=None)[0]
    matrix[:, 2] = 0
    rows = make_rows(matrix, values)
    seen = analyse_identifiability(rows)
    ((name, reason),) = seen.refused
    assert (name, "torque" in reason) == ("c", True)
    fit = fit_ols(rows, seen)
    np.testing.assert_allclose(fit.values[[0, 1, 3]], expected, rtol=1e-9)
    assert fit.values[2] == 0
    matrix[:, 2] = 3 * matrix[:, 0]
    rows = make_rows(matrix, values)
    seen = analyse_identifiability(rows)
    assert [name for name, _ in seen.refused] == ["a", "c"]
    assert "with c" in seen.refused[0][1]
    fit = fit_ols(rows, seen)
    np.testing.assert_allclose(fit.values[[1, 3]], expected[1:], rtol=1e-9)
    # The sum of both explains what the one column explained.
    assert fit.values[0] + 3 * fit.values[2] == pytest.approx(expected[0])
    assert np.isfinite(fit.condition)


@pytest.mark.parametrize(
    ("matrix", "values", "code", "named"),
    [
        (np.zeros((9, 2)), np.ones(9), "identify.nothing", r"^[^()]*$"),
        (np.ones((9, 2)), np.ones(9), "identify.nothing", r"\(a: .* b, .*; b: .* a, .*\)"),
        (np.eye(2), np.ones(2), "identify.too-few-rows", r"2 torque rows .* 2 parameters"),
        (np.eye(3)[:, :2], np.zeros(3), "identify.no-torque", "torque"),
    ],
)
def test_rows_without_an_identifiable_parameter_are_an_error(matrix, values, code, named):
    with pytest.raises(IdentifiabilityError, match=named) as caught:
        analyse_identifiability(make_rows(matrix, values))
    assert caught.value.exit_code == 4
    assert caught.value.notices[0].code == code


@pytest.mark.parametrize("kind", ["still", "flipping"])
def test_a_log_at_standstill_is_refused(kind):
    rng = np.random.default_rng(1)
    position = np.full((500, 1), 0.3) if kind == "still" else 0.3 + 1e-4 * rng.integers(0, 2, (500, 1))
    recording = Recording(
        time=1e-3 * np.arange(500), position=position, torque=rng.normal(size=(500, 1)), source="still.npz"
    )
    with raises(IdentifiabilityError, "identify.standstill", match=r"still\.npz"):
        identify_parameters(build_one_axis(), [recording], PLAIN)


def test_a_resting_joint_loses_its_rows_and_its_friction():
    library = build_two_link()
    signals = build_signals(library, TWO_LINK_TRUTH)
    q, tau = signals.q.copy(), signals.tau.copy()
    q[:, 1] = 0.7
    recording = Recording(time=signals.time, position=q, torque=tau, source="half.npz")
    assert list_resting_joints(recording) == (1,)
    held = hold_resting_joints(signals, (1,))
    assert not held.dq[:, 1].any()
    assert not held.ddq[:, 1].any()
    assert np.ptp(held.q[:, 1]) == 0
    assert held.dq[:, 0].any()
    estimate = identify_parameters(library, [recording], FILTERED)
    refused = dict(estimate.refused)
    assert {"Fv2", "Fc2", "offset2"} <= refused.keys()
    assert [entry.joint for entry in estimate.residual] == ["joint1"]
    codes = [notice.code for notice in estimate.notices]
    assert codes[0] == "identify.joint-at-rest"
    assert "joint 'joint2'" in estimate.notices[0].text
    assert codes.count("identify.refused") == len(refused)


def test_parameters_that_are_hardly_known_are_named():
    library = build_one_axis()
    recording = build_recording(library, ONE_AXIS_TRUTH, noise=(2000.0,))
    estimate = identify_parameters(library, [recording], replace(FILTERED, drop_first=10, drop_last=10))
    (notice,) = estimate.notices
    assert notice.code == "identify.poorly-identifiable"
    assert "offset1" in notice.text


def test_wrong_calls_name_what_is_allowed():
    library = build_one_axis()
    with pytest.raises(UsageError) as caught:
        identify_parameters(library, [], PLAIN, rows="impulse", estimator="magic")
    text = str(caught.value)
    codes = [notice.code for notice in caught.value.notices]
    assert codes == ["usage.unknown-rows", "usage.unknown-estimator", "usage.no-log"]
    assert "torque, momentum, filtered, power, energy" in text
    assert "ols, wls" in text
    with pytest.raises(UsageError, match="'impulse'"):
        build_rows("impulse", library, build_signals(library, ONE_AXIS_TRUTH), PLAIN)
    # Nor is a log of another robot.
    recording = build_recording(build_two_link(), TWO_LINK_TRUTH, source="two.npz")
    with raises(LogError, "log.joints", match=r"two\.npz: .* 2 joints.* 'one_axis' .* 1\b"):
        identify_parameters(library, [recording], PLAIN)


def test_energy_rows_warn_beyond_three_joints():
    library = build_one_axis()
    joints = library.card.joints * 4
    wide = replace(library, card=replace(library.card, joints=joints, friction=()))
    wide.functions["energy_regressor"] = lambda q, dq: (dq[:, :1] ** 2, 0 * q[:, :1])
    signals = build_signals(build_one_axis(), ONE_AXIS_TRUTH)
    four = {name: np.repeat(getattr(signals, name), 4, axis=1) for name in ("q", "dq", "ddq", "tau")}
    rows = build_rows("energy", wide, type(signals)(time=signals.time, period=1e-3, **four), PLAIN)
    assert [notice.code for notice in rows.notices] == ["identify.energy-rank"]
    assert build_rows("energy", build_one_axis(), signals, PLAIN).notices == ()


def test_logs_whose_rows_are_all_left_out_say_so():
    """Rows slower than `standstill` are left out, here all of them."""
    library = build_two_link()
    recording = build_recording(library, TWO_LINK_TRUTH, samples=501)
    processing = Processing(filter_cutoff=50.0, standstill=1e3)
    with pytest.raises(IdentifiabilityError, match=r"processing\.standstill") as caught:
        identify_parameters(library, [recording], processing)
    assert caught.value.notices[0].code == "identify.no-rows"
    assert "identify.slow-rows" in {entry.code for entry in caught.value.notices}
