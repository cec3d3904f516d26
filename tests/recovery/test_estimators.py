"""Every estimator brings back the truth from every kind of row; each does what it is there for."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.optimize import minimize

from symid.errors import UsageError
from symid.identification.estimators.least_squares import (
    estimate_noise_covariance,
    fit_gls,
    fit_ols,
    fit_wls,
    whiten_rows,
)
from symid.identification.estimators.linear_estimators import (
    ESTIMATORS,
    Prior,
    build_prior_of_card,
    build_prior_of_estimate,
    fit_huber,
    fit_ridge,
)
from symid.identification.regression.equations import ROW_KINDS, build_rows, select_rows, stack_rows
from symid.identification.regression.identifiability import analyse_identifiability
from symid.identification.rigid.fit import identify_parameters
from symid.robot.description import Decimation, Processing
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

PLAIN, TENTH = Processing(), Processing(decimation=Decimation(factor=10))
ROBOTS = {"one_axis": (build_one_axis(), ONE_AXIS_TRUTH), "two_link": (build_two_link(), TWO_LINK_TRUTH)}
FREE = tuple(name for name in ESTIMATORS if name not in {"ridge", "consistent"})
NOISE = (0.5, 0.2)


def build(*, seed=0, noise=None, samples=4001, kind="torque"):
    library = build_two_link()
    signals = build_signals(library, TWO_LINK_TRUTH, samples=samples, period=5e-3, seed=seed, noise=noise)
    return build_rows(kind, library, signals, PLAIN)


def score(fit):
    return (fit.values - TWO_LINK_TRUTH) / np.sqrt(np.diag(fit.covariance))


@pytest.mark.parametrize(
    ("estimator", "kind", "robot", "processing", "tolerance"),
    [
        *(
            (name, kind, robot, PLAIN, 1e-9)
            for name in ("ols", "wls")
            for kind in ROW_KINDS
            for robot in ROBOTS
        ),
        *((name, "torque", "two_link", PLAIN, 1e-7) for name in FREE),
        # The filter of order 8, in the form of a transfer function, rounds at 1e-9 of the largest column.
        ("ols", "torque", "two_link", TENTH, 1e-7),
    ],
)
def test_exact_rows_give_the_truth(estimator, kind, robot, processing, tolerance):
    library, truth = ROBOTS[robot]
    rows = build_rows(kind, library, build_signals(library, truth, samples=20001), processing)
    if processing is TENTH:
        assert len(rows.values) == pytest.approx(2 * 2000, abs=4)
    found = ESTIMATORS[estimator](rows, analyse_identifiability(rows)).values
    np.testing.assert_allclose(found, truth, rtol=tolerance, atol=tolerance)


def test_decimated_noise_still_has_an_honest_standard_deviation():
    library, scores = build_one_axis(), []
    for seed in range(60):
        signals = build_signals(library, ONE_AXIS_TRUTH, samples=10001, seed=seed, noise=(5.0,))
        rows = build_rows("torque", library, signals, TENTH)
        fit = fit_ols(rows, analyse_identifiability(rows))
        scores.append((fit.values - ONE_AXIS_TRUTH) / np.sqrt(np.diag(fit.covariance)))
    assert 0.8 < np.std(scores) < 1.25


def test_wls_beats_ols_where_joints_are_not_equally_noisy():
    errors = {fit_ols: [], fit_wls: []}
    for seed in range(30):
        rows = build(seed=seed, noise=(3.0, 0.03), samples=5001)
        for estimator, found in errors.items():
            found.append(estimator(rows, analyse_identifiability(rows)).values - TWO_LINK_TRUTH)
    spread = {estimator: np.std(found, axis=0)[3:6] for estimator, found in errors.items()}
    assert np.all(spread[fit_wls] < 0.2 * spread[fit_ols])


@pytest.mark.parametrize(
    ("estimator", "kind"),
    [*product(FREE, ("torque", "momentum", "filtered")), ("ols", "power"), ("ols", "energy")],
)
def test_deviations_cover_the_truth_as_often_as_they_say(estimator, kind):
    scores = []
    for seed in range(40):
        rows = build(seed=seed, noise=NOISE, samples=2001, kind=kind)
        scores.append(score(ESTIMATORS[estimator](rows, analyse_identifiability(rows))))
    # The mean square of 40 times 12 scores, in part dependent, scatters by about a tenth.
    assert 0.75 < np.mean(np.square(scores)) < 1.3


def draw_shared(counts, widths, seed=0, independent=1.0):
    """Return rows of joints of noise 3, 3/2, 1, ... with the first `widths` of parameters 1, 2, 3, ..."""
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(len(counts)), counts)
    truth = np.arange(1.0, max(widths) + 1.0)
    matrix = rng.normal(size=(len(group), len(truth))) * (truth <= np.array(widths)[group][:, None])
    values = matrix @ truth + rng.normal(size=len(group)) * 3.0 / (1.0 + group)
    return make_rows(matrix, values, group, independent=independent)


def test_joints_without_common_parameters_weigh_as_alone():
    rows = draw_shared((9, 30), (8, 8), independent=0.7)
    matrix = np.where(rows.group[:, None] == 0, np.arange(8) < 5, np.arange(8) >= 5) * rows.matrix
    rows = replace(rows, matrix=matrix)
    for freedom, part in (("band", 0.7), ("parameters", 1.0)):
        fit = fit_wls(rows, analyse_identifiability(rows), freedom)
        for joint, width in enumerate((5, 3)):
            own = rows.group == joint
            (square,) = np.linalg.lstsq(matrix[own][:, matrix[own].any(axis=0)], rows.values[own])[1]
            expected = np.sqrt((own.sum() - width / part) / square)
            np.testing.assert_allclose(fit.weights[own], expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("counts", "widths", "independent"),
    # As many rows of all joints as there are parameters, then of the first one.
    [
        *(((40, 30, 20), (8, 5, 3), b) for b in (1.0, 0.6)),
        ((8, 8, 8), (8, 5, 3), 1.0),
        ((8, 20), (8, 5), 1.0),
    ],
)
def test_weights_maximise_the_restricted_likelihood(counts, widths, independent):
    rows = draw_shared(counts, widths, independent=independent)
    fit = fit_wls(rows, analyse_identifiability(rows))
    found = np.array([fit.weights[rows.group == joint][0] for joint in range(len(counts))])
    sizes = independent * np.array(counts)

    def lose(logs):
        # -2 log of the likelihood of what no parameters can change (Harville 1974), b rows in place of one.
        weights = np.exp(logs)[rows.group]
        normal = (rows.matrix.T * weights**2) @ rows.matrix
        left = rows.values - rows.matrix @ np.linalg.solve(normal, rows.matrix.T @ (weights**2 * rows.values))
        return independent * np.sum((weights * left) ** 2) + np.linalg.slogdet(normal)[1] - 2.0 * sizes @ logs

    best = minimize(lose, np.zeros(len(counts)), method="BFGS", options={"gtol": 1e-9})
    np.testing.assert_allclose(found, np.exp(best.x), rtol=1e-5)


def test_a_joint_with_as_many_rows_as_parameters_does_not_run_away():
    """24 rows for 23 parameters, of which another joint has six: these are as with the true weights."""
    errors, ideal = [], []
    for seed in range(40):
        rows = draw_shared((24, 24), (23, 6), seed)
        known = (1.0 + rows.group) / 3.0
        errors.append(fit_wls(rows, analyse_identifiability(rows)).values - np.arange(1.0, 24.0))
        ideal.append(
            np.linalg.lstsq(rows.matrix * known[:, None], rows.values * known)[0] - np.arange(1.0, 24.0)
        )
    errors, ideal = (np.array(part)[:, :6] for part in (errors, ideal))
    assert np.linalg.norm(errors) < 1.1 * np.linalg.norm(ideal)


def draw_joint_noise(rows, rng, covariance):
    """Return noise that both joints share, for rows of equal times."""
    count = len(rows.values) // 2
    return (rng.normal(size=(count, 2)) @ np.linalg.cholesky(covariance).T).T.ravel()


def test_gls_knows_more_where_joints_share_their_noise():
    clean = build()
    seen = analyse_identifiability(clean)
    covariance = np.array([[0.25, 0.19], [0.19, 0.16]])
    errors = {fit_wls: [], fit_gls: []}
    scores = []
    for seed in range(40):
        noise = draw_joint_noise(clean, np.random.default_rng(seed), covariance)
        rows = replace(clean, values=clean.values + noise)
        for estimator, found in errors.items():
            fit = estimator(rows, seen)
            found.append(fit.values - TWO_LINK_TRUTH)
        scores.append(score(fit_gls(rows, seen)))
        found = estimate_noise_covariance(rows, fit_wls(rows, seen))
        np.testing.assert_allclose(found, covariance, rtol=0.1)
    spread = {estimator: np.std(found, axis=0) for estimator, found in errors.items()}
    assert np.mean(spread[fit_gls] / spread[fit_wls]) < 0.6
    assert 0.8 < np.mean(np.square(scores)) < 1.25


def test_gls_equals_the_formula_of_aitken():
    rows = build(noise=NOISE, samples=301)
    noise = np.array([[2.0, 0.7], [0.7, 1.0]])
    fit = fit_gls(rows, analyse_identifiability(rows), noise=noise)
    whole = np.linalg.inv(np.kron(noise, np.eye(len(rows.values) // 2)))
    normal = rows.matrix.T @ whole @ rows.matrix
    expected = np.linalg.solve(normal, rows.matrix.T @ whole @ rows.values)
    np.testing.assert_allclose(fit.values, expected, rtol=1e-7)
    e = rows.values - rows.matrix @ expected
    variance = e @ whole @ e / (len(e) - len(expected))
    np.testing.assert_allclose(fit.covariance, variance * np.linalg.inv(normal), rtol=1e-6)


def test_rows_without_their_fellows_are_whitened_on_their_own():
    rows = build(noise=NOISE, samples=101)
    keep = np.ones(len(rows.values), dtype=bool)
    keep[:10] = False
    cut = select_rows(rows, keep)
    noise = np.array([[4.0, 1.0], [1.0, 9.0]])
    white = whiten_rows(cut, noise)
    alone = np.flatnonzero((cut.group == 1) & np.isin(cut.time, rows.time[:10]))
    np.testing.assert_allclose(white.values[alone], cut.values[alone] / 3.0)


def test_outliers_hardly_move_the_robust_fit():
    clean = build(noise=NOISE)
    seen = analyse_identifiability(clean)
    rng = np.random.default_rng(5)
    hit = rng.random(len(clean.values)) < 0.05
    rows = replace(clean, values=clean.values + hit * 20.0 * rng.exponential(size=len(clean.values)))
    robust, plain = fit_huber(rows, seen), fit_ols(rows, seen)
    assert np.abs(score(robust)).max() < 4.5
    error = np.abs(robust.values - TWO_LINK_TRUTH)
    assert np.linalg.norm(error) < 0.3 * np.linalg.norm(plain.values - TWO_LINK_TRUTH)
    assert robust.report["outliers_percent"] > 4.0
    assert not robust.notices


def test_huber_is_stationary_for_its_loss():
    rows = build(noise=NOISE, samples=501)
    fit = fit_huber(rows, analyse_identifiability(rows))
    slope = rows.matrix.T @ (fit.weights**2 * fit.residuals)
    size = np.linalg.norm(rows.matrix, axis=0) * np.linalg.norm(fit.weights**2 * fit.residuals)
    assert np.abs(slope / size).max() < 1e-6


def test_huber_says_where_it_does_not_settle():
    """Three rows alone tell the second parameter, and the outer two nearly pull it past the middle one."""
    rng = np.random.default_rng(0)
    matrix = np.zeros((403, 2))
    matrix[:400, 0], matrix[400:, 1] = 1.0 + rng.random(400), (1.0, 1.95, 1.0)
    noise = np.concatenate([1e-3 * rng.normal(size=400), [0.0, 10.0, -10.0]])
    rows = make_rows(matrix, matrix @ np.array([2.0, 3.0]) + noise, time=1e-3 * np.arange(403))
    (notice,) = fit_huber(rows, analyse_identifiability(rows)).notices
    assert notice.code == "identify.huber-not-converged"
    assert "after 60 iterations" in notice.text
    calm = select_rows(rows, rows.time < 0.4)
    assert not fit_huber(calm, analyse_identifiability(calm)).notices


def test_ridge_of_weight_one_is_the_bayesian_answer():
    rows = build(noise=NOISE, samples=201)
    seen = analyse_identifiability(rows)
    deviations = 0.3 * np.abs(TWO_LINK_TRUTH)
    prior = Prior(
        names=rows.names, values=tuple(1.2 * TWO_LINK_TRUTH), deviations=tuple(deviations), source="test"
    )
    fit = fit_ridge(rows, seen, prior=prior, prior_weight=1.0)
    weights = fit_wls(rows, seen).weights
    design, target = rows.matrix * weights[:, None], rows.values * weights
    precision = design.T @ design + np.diag(deviations**-2)
    expected = np.linalg.solve(precision, design.T @ target + 1.2 * TWO_LINK_TRUTH / deviations**2)
    np.testing.assert_allclose(fit.values, expected, rtol=1e-8)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(precision), rtol=1e-6)
    none = fit_ridge(rows, seen, prior=prior, prior_weight=0.0)
    np.testing.assert_allclose(none.values, fit_wls(rows, seen).values, rtol=1e-8)


def test_cross_validation_believes_a_good_prior_and_not_a_bad_one():
    rows = build(noise=(3.0, 2.0), samples=401)
    seen = analyse_identifiability(rows)
    sizes = tuple(np.abs(TWO_LINK_TRUTH))
    weights = {}
    for factor in (1.0, 3.0):
        values = tuple(factor * TWO_LINK_TRUTH)
        prior = Prior(names=rows.names, values=values, deviations=sizes, source="test")
        fit = fit_ridge(rows, seen, prior=prior)
        weights[factor] = fit.report["prior_weight"]
        assert fit.report["prior_weight_chosen"]
    assert weights[1.0] >= 1.0
    assert weights[3.0] <= 10.0
    assert weights[3.0] < weights[1.0]


def test_priors_of_the_robot_file_and_of_estimates():
    library = build_two_link()
    card = build_prior_of_card(library.card, 0.2)
    values, deviations = card.arrange(("ZZR1", "nothing"))
    assert values[0] == TWO_LINK_TRUTH[0]
    assert deviations[0] == pytest.approx(0.2 * abs(TWO_LINK_TRUTH[0]))
    assert np.isinf(deviations[1])
    recording = build_recording(library, TWO_LINK_TRUTH)
    estimate = identify_parameters(library, [recording], PLAIN)
    again = build_prior_of_estimate(estimate, 2.0)
    assert again.deviations[0] == pytest.approx(2.0 * estimate.parameters[0].std)
    options = {"prior": again, "prior_weight": 1.0}
    near = identify_parameters(library, [recording], PLAIN, estimator="ridge", options=options)
    assert near.settings["fit"]["prior_weight"] == 1.0


def test_the_last_joint_is_known_from_its_own_rows():
    rows = build(noise=NOISE)
    seen = analyse_identifiability(rows)
    fit = ESTIMATORS["sequential"](rows, seen)
    second = rows.group == 1
    own = [k for k in range(len(rows.names)) if rows.matrix[second][:, k].any()]
    expected = np.linalg.lstsq(rows.matrix[second][:, own], rows.values[second], rcond=None)[0]
    np.testing.assert_allclose(fit.values[own], expected, rtol=1e-7)
    assert [entry["joint"] for entry in fit.report["order"]] == ["joint2", "joint1"]


@pytest.mark.parametrize(
    ("estimator", "kind", "code"),
    [
        ("ridge", "torque", "usage.no-prior"),
        ("consistent", "torque", "usage.no-bodies"),
        # Rows of all joints are no rows of one.
        ("sequential", "power", "usage.sequential-rows"),
    ],
)
def test_what_an_estimator_lacks_is_named(estimator, kind, code):
    rows = build(kind=kind)
    with raises(UsageError, code):
        ESTIMATORS[estimator](rows, analyse_identifiability(rows))


def test_a_file_without_values_is_no_prior_and_an_overlap_is_a_part():
    library = build_two_link()
    card = library.card
    bare = replace(card, beta=tuple(replace(entry, value=None) for entry in card.beta), friction=())
    with raises(UsageError, "usage.no-prior", match="'two_link'"):
        build_prior_of_card(bare, 0.2)
    signals = build_signals(library, TWO_LINK_TRUTH)
    with raises(UsageError, "usage.overlap"):
        build_rows("momentum", library, signals, PLAIN, overlap=1.0)


def test_runs_count_as_they_are_weighed():
    parts = [build(seed=1, noise=NOISE, samples=301), build(seed=2, noise=NOISE, samples=201)]
    weighed = stack_rows(parts, weights=(1.0, 4.0))
    fit = fit_ols(weighed, analyse_identifiability(weighed))
    twice = [parts[0].matrix, *[parts[1].matrix] * 4], [parts[0].values, *[parts[1].values] * 4]
    expected = np.linalg.lstsq(np.vstack(twice[0]), np.concatenate(twice[1]), rcond=None)[0]
    np.testing.assert_allclose(fit.values, expected, rtol=1e-8)
    assert set(weighed.run) == {0, 1}
    np.testing.assert_array_equal(weighed.weight, np.where(weighed.run == 1, 4.0, 1.0))
    library = build_two_link()
    recordings = [build_recording(library, TWO_LINK_TRUTH, seed=seed, source=str(seed)) for seed in (1, 2)]
    estimate = identify_parameters(library, recordings, PLAIN, weights=(1.0, 0.25))
    assert estimate.settings["weights"] == [1.0, 0.25]


@pytest.mark.parametrize("kind", ["momentum", "energy"])
def test_overlapping_windows_know_a_little_more_and_do_not_boast(kind):
    library = build_two_link()
    scores, errors = [], {0.0: [], 0.5: []}
    for seed in range(40):
        signals = build_signals(library, TWO_LINK_TRUTH, samples=4001, period=5e-3, seed=seed, noise=NOISE)
        for overlap, found in errors.items():
            rows = build_rows(kind, library, signals, PLAIN, window=0.2, overlap=overlap)
            fit = fit_wls(rows, analyse_identifiability(rows))
            found.append(fit.values - TWO_LINK_TRUTH)
            if overlap:
                scores.append(score(fit))
    assert np.mean(np.std(errors[0.5], axis=0) / np.std(errors[0.0], axis=0)) < 1.0
    assert 0.75 < np.mean(np.square(scores)) < 1.3
