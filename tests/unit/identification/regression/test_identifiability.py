"""What rows tell, triangles that stand for all of them, windows that integrate them."""

import gc
from dataclasses import replace

import numpy as np
import pytest

from symid.errors import IdentifiabilityError, UsageError
from symid.identification.estimators.least_squares import fit_condensed, fit_ols, fit_wls
from symid.identification.regression import identifiability as condensation
from symid.identification.regression.equations import (
    build_rows,
    choose_windows,
    integrate_windows,
    select_rows,
)
from symid.identification.regression.identifiability import (
    analyse_identifiability,
    compute_square_sums,
    condense_rows,
    condense_weighted,
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
        (np.eye(2), np.ones(2), "identify.too-few-rows", r"2 torque equations .* 2 parameters"),
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


def draw_rows():
    library = build_two_link()
    signals = build_signals(library, TWO_LINK_TRUTH, samples=9001, noise=(0.5, 0.2))
    return build_rows("torque", library, signals, PLAIN)


@pytest.fixture(scope="module")
def rows():
    return draw_rows()


def test_rows_in_any_order_condense_to_the_same_once(rows):
    order = np.random.default_rng(0).permutation(len(rows.values))
    names = ("matrix", "values", "group", "time", "velocity", "run", "weight")
    shuffled = replace(rows, **{name: getattr(rows, name)[order] for name in names})
    products = [f.transpose(0, 2, 1) @ f for f in (condense_rows(r).factors for r in (rows, shuffled))]
    np.testing.assert_allclose(products[0], products[1], rtol=1e-9, atol=1e-6)
    # Rows are factorised once and forgotten with them.
    fresh = draw_rows()
    assert condense_rows(fresh) is condense_rows(fresh)
    known = len(condensation._KNOWN)
    del fresh
    gc.collect()
    assert len(condensation._KNOWN) < known


def test_a_weight_of_zero_is_a_row_left_out(rows):
    keep = rows.time < 4.0
    cut = condense_rows(select_rows(rows, keep))
    zero = condense_weighted(rows, keep * 1.0)
    np.testing.assert_allclose(
        compute_square_sums(zero, TWO_LINK_TRUTH), compute_square_sums(cut, TWO_LINK_TRUTH), rtol=1e-10
    )
    np.testing.assert_array_equal(zero.counts, cut.counts)


@pytest.mark.parametrize("freedom", ["band", "one"])
def test_condensed_fits_are_those_of_the_rows(rows, freedom):
    seen = analyse_identifiability(rows)
    for fit, weights in ((fit_ols, np.ones(2)), (fit_wls, None)):
        expected = fit(rows, seen, freedom)
        found = fit_condensed(condense_rows(rows), seen.basis, weights, freedom)
        np.testing.assert_allclose(found.values, expected.values, rtol=1e-9)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-7, atol=1e-18)
        assert found.condition == pytest.approx(expected.condition)


def test_simpson_is_exact_for_cubics():
    time = np.linspace(0.0, 2.0, 41)
    windows = choose_windows(41, 0.05, 0.5)
    assert (windows.count, windows.intervals) == (4, 10)
    found = integrate_windows(np.column_stack([time**3, np.ones(41)]), windows)
    ends = time[windows.ends]
    np.testing.assert_allclose(found[:, 0], np.diff(ends**4) / 4, rtol=1e-13)
    np.testing.assert_allclose(found[:, 1], np.diff(ends), rtol=1e-13)
    # Samples that fill no window are left over.
    windows = choose_windows(100, 0.01, 0.1)
    assert windows.count == 9
    assert integrate_windows(np.ones((100, 2)), windows).shape == (9, 2)


def test_error_falls_with_the_fourth_power_of_the_period():
    errors = []
    for samples in (201, 401):
        time = np.linspace(0.0, 1.0, samples)
        total = integrate_windows(np.exp(3 * time), choose_windows(samples, time[1], 0.1)).sum()
        errors.append(abs(total - (np.exp(3) - 1) / 3))
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.05)


@pytest.mark.parametrize(
    ("length", "pieces", "words"),
    [
        *((length, 1, r"0\.02 s.*1 s") for length in (0.0, -1.0, 0.005, 100.0)),
        # Windows that overlap too much are told as they were asked for.
        (0.1, 10, r"0\.1 s.*0\.01 s.*overlap"),
    ],
)
def test_windows_that_do_not_fit_are_refused(length, pieces, words):
    with raises(UsageError, "usage.window", match=words):
        choose_windows(101, 0.01, length, pieces=pieces)
    assert choose_windows(101, 0.01, 0.4, pieces=10) == choose_windows(101, 0.01, 0.04)
