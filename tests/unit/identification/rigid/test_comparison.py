"""Two sets of values in deviations: closed forms, chance, and terms found only where they are."""

import numpy as np
import pytest
from scipy import stats

from symid.dynamics import OpenReading
from symid.identification.compare import (
    build_stated_values,
    compare_values,
    compute_grouped_values,
    list_shared_logs,
    try_readings,
)


def draw_covariance(rng, count, least=0.01):
    root = rng.normal(size=(count, 2 * count)) * rng.uniform(least, 10.0, (count, 1))
    return root @ root.T


def state(values, covariance):
    return build_stated_values(values, np.sqrt(np.diag(covariance)), covariance)


def test_two_correlated_values_by_hand():
    """Differences 1 and 2 with variances 1 + 3 and 4 and covariance 1: chi^2 = (4 - 4 + 16) / 15."""
    ours = state([1.0, 2.0], np.array([[1.0, 1.0], [1.0, 4.0]]))
    theirs = build_stated_values([0.0, 0.0], [np.sqrt(3.0), 0.0])
    found = compare_values(ours, theirs)
    np.testing.assert_allclose(found.deviations, [0.5, 1.0])
    assert found.chi_square.value == pytest.approx(16.0 / 15.0)
    assert found.chi_square.freedom == 2
    assert found.chi_square.stretch == pytest.approx(np.sqrt(8.0 / 15.0))
    assert found.chi_square.chance == pytest.approx(np.exp(-8.0 / 15.0))
    assert (found.judged, found.largest) == (2, 1.0)
    assert (found.count_within(0.7), found.list_farthest(0.4)) == (1, (1, 0))


def test_chi_square_does_not_depend_on_the_groups():
    """Both sides in other groups: single deviations change, all of them together do not."""
    rng = np.random.default_rng(2)
    ours = state(rng.normal(size=6), draw_covariance(rng, 6))
    theirs = state(rng.normal(size=6), draw_covariance(rng, 6))
    change = rng.normal(size=(6, 6))
    plain = compare_values(ours, theirs)
    other = compare_values(compute_grouped_values(change, ours), compute_grouped_values(change, theirs))
    assert other.chi_square.value == pytest.approx(plain.chi_square.value, rel=1e-8)
    difference = ours.values - theirs.values
    expected = difference @ np.linalg.solve(ours.covariance + theirs.covariance, difference)
    assert plain.chi_square.value == pytest.approx(expected, rel=1e-8)
    np.testing.assert_allclose(other.difference, change @ difference)


def test_true_deviations_give_what_chance_gives():
    rng = np.random.default_rng(3)
    first, second = draw_covariance(rng, 8), draw_covariance(rng, 8)
    truth = rng.normal(size=8)

    def draw(covariance):
        return state(rng.multivariate_normal(truth, covariance), covariance)

    found = [compare_values(draw(first), draw(second)) for _ in range(400)]
    within = np.mean([entry.count_within(2.0) for entry in found]) / 8
    assert within == pytest.approx(0.9545, abs=0.01)
    assert stats.kstest([entry.chi_square.chance for entry in found], "uniform").pvalue > 0.01


def test_deviations_that_are_not_known():
    ours = build_stated_values([1.0, 2.0, 3.0, 4.0], [0.1, None, float("inf"), 0.3])
    theirs = build_stated_values([1.1, 2.0, 3.0, 4.0], [None, None, 0.2, 0.0])
    found = compare_values(ours, theirs)
    np.testing.assert_allclose(found.deviations, [-1.0, np.nan, 0.0, 0.0], atol=1e-12)
    assert found.judged == 3
    assert found.chi_square.freedom == 3
    grouped = compute_grouped_values(np.array([[1.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 2.0]]), ours)
    np.testing.assert_allclose(grouped.values, [3.0, 9.0])
    np.testing.assert_allclose(grouped.std, [np.nan, np.sqrt(0.01 + 4 * 0.09)])


def test_where_nothing_or_all_is_known_nothing_is_judged():
    nothing = build_stated_values([1.0, 2.0], [None, None])
    found = compare_values(nothing, nothing)
    assert (found.judged, found.largest, found.chi_square, found.scale) == (0, 0.0, None, 1.0)
    assert found.list_farthest() == ()
    # Deviations that no number can square are not known.
    found = compare_values(
        build_stated_values([1.0, 2.0], [1e200, 0.1]), build_stated_values([1.0, 2.0], [None, 0.1])
    )
    assert found.judged == 1
    broken = build_stated_values([1.0, 2.0], [0.1, 0.1], [[1e250, 0.0], [0.0, -1.0]])
    with np.errstate(invalid="raise"):
        assert np.isnan(broken.std).all()
    assert compare_values(broken, build_stated_values([1.0, 2.0], [0.1, 0.1])).judged == 1
    # An exact combination has no chi square.
    one = state([1.0, 1.0], np.ones((2, 2)))
    assert compare_values(one, build_stated_values([0.0, 0.0], [0.0, 0.0])).chi_square is None


def build_case(rng, planted, count=12):
    """Return T of groups that are written without the terms they hold, and both sides."""
    # Of one size, so that every term is many deviations of every group.
    covariance = draw_covariance(rng, count, 5.0)
    spread = np.sqrt(np.diag(covariance))
    # No two values are alike: else one term would explain a group as well as another.
    truth = rng.permutation(np.arange(1, count + 1)) * rng.choice([-1.0, 1.0], count) * 400.0
    held = np.eye(count)
    for trial in planted:
        held[trial.group, trial.column] += trial.factor
    ours = state(rng.multivariate_normal(truth, covariance), covariance)
    other = held @ truth + rng.normal(size=count) * spread
    return np.eye(count), ours, build_stated_values(other, spread)


def list_trials(count=12):
    places = [(i, j) for i in range(4) for j in range(count) if i != j]
    return [OpenReading(name="", group=i, column=j, factor=s) for i, j in places for s in (1.0, -1.0)]


def test_terms_that_are_there_are_found_and_no_other():
    trials = list_trials()
    wrong = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        planted = [trials[k] for k in sorted(rng.choice(len(trials), 2, replace=False))]
        if len({trial.group for trial in planted}) < 2:
            planted = planted[:1]
        found = try_readings(*build_case(rng, planted), trials)
        assert len(found) == len(trials)
        decisive = [trials[entry.trial] for entry in found if entry.decisive]
        wrong += sorted(map(repr, decisive)) != sorted(map(repr, planted))
        assert all(abs(entry.after) < abs(entry.before) for entry in found if entry.decisive)
    assert wrong <= 1


def test_a_term_that_another_could_replace_has_a_rival():
    ours = build_stated_values([1.0, 1.05, 7.0], [0.01, 0.1, 0.01])
    theirs = build_stated_values([1.0, 1.05, 8.02], [0.01, 0.1, 0.01])
    trials = [OpenReading(name="", group=2, column=column, factor=1.0) for column in (0, 1)]
    (first, second) = try_readings(np.eye(3), ours, theirs, trials)
    assert (first.decisive, first.rivals, second.decisive) == (True, 1, False)
    trials[1] = OpenReading(name="", group=2, column=1, factor=-1)
    (alone, _) = try_readings(np.eye(3), ours, theirs, trials)
    assert (alone.trial, alone.decisive, alone.rivals) == (0, True, 0)


def test_the_ratio_is_that_of_normal_densities():
    """How likely theirs are, given ours: N(T x, T C T' + S), with the term and without it."""
    rng = np.random.default_rng(4)
    covariance, spread = draw_covariance(rng, 5), np.diag(rng.uniform(0.1, 3.0, 4))
    ours = state(rng.normal(size=5), covariance)
    theirs = state(rng.normal(size=4), spread)
    change = rng.normal(size=(4, 5))
    (found,) = try_readings(change, ours, theirs, [OpenReading(name="", group=1, column=3, factor=0.7)])
    held = change.copy()
    held[1, 3] += 0.7
    with_term, without = (
        stats.multivariate_normal(T @ ours.values, T @ covariance @ T.T + spread).logpdf(theirs.values)
        for T in (held, change)
    )
    assert compare_values(compute_grouped_values(change, ours), theirs).scale == 1.0
    assert found.log_ratio == pytest.approx(with_term - without, rel=1e-9)


def test_a_term_that_only_widens_explains_nothing():
    """A value of 0 +- 100 brings a group that is 3.5 deviations away near, whatever it is."""
    ours = build_stated_values([1.0, 5.0, 7.0, 0.0], [0.1, 0.1, 0.1, 100.0])
    theirs = build_stated_values([1.35, 5.0, 7.0], [1e-9, 1e-9, 1e-9])
    (found,) = try_readings(np.eye(3, 4), ours, theirs, [OpenReading(name="", group=0, column=3, factor=1.0)])
    assert found.before == pytest.approx(-3.5)
    assert found.gain == pytest.approx(3.5**2, rel=1e-4)
    assert found.gain / 2.0 > np.log(20.0)
    assert found.log_ratio == pytest.approx(found.gain / 2.0 - np.log(1000.0), abs=1e-5)
    assert not found.decisive


@pytest.mark.parametrize(("tight", "seeds"), [(1.0, range(100, 160)), (3.0, range(200, 230))])
def test_nothing_is_found_where_nothing_is(tight, seeds):
    """Nor where all deviations are stated too small: many differences are large, none by a missing term."""
    hits = 0
    for seed in seeds:
        change, *sides = build_case(np.random.default_rng(seed), [])
        sides = [
            build_stated_values(side.values, side.std / tight, side.covariance / tight**2) for side in sides
        ]
        hits += any(entry.decisive for entry in try_readings(change, *sides, list_trials()))
    assert hits <= 3


def test_shared_logs_by_path_and_by_content(tmp_path):
    first = [("a.npz", ""), ("b.npz", "beef"), ("c.npz", "cafe")]
    second = [("./a.npz", "feed"), ("copy.npz", "beef"), ("d.npz", "")]
    assert list_shared_logs(first, second) == ("a.npz", "b.npz")
    assert list_shared_logs(first, [("e.npz", "")]) == ()
    # The same name in another folder is another log.
    assert list_shared_logs(first, [("b.npz", "face"), ("c.npz", "")]) == ("c.npz",)
