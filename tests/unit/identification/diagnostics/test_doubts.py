"""What speaks against an estimate is said, and nothing is said of a sound one."""

import numpy as np
import pytest

from symid.identification.diagnostics.fit_warnings import (
    compute_block_deviations,
    warn_of_correlated_residuals,
    warn_of_mass_matrix,
    warn_of_processing,
)
from symid.identification.estimators.least_squares import fit_ols, fit_wls
from symid.identification.regression.equations import Rows
from symid.identification.regression.identifiability import analyse_identifiability
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link

TENFOLD = Decimation(factor=10)


@pytest.fixture(scope="module")
def recording():
    return build_recording(build_two_link(), TWO_LINK_TRUTH)


@pytest.mark.parametrize(
    ("processing", "codes"),
    [
        (Processing(), ["identify.no-filter"]),
        (Processing(filter_cutoff=20.0), []),
        (Processing(filter_cutoff=99.0, decimation=TENFOLD), ["identify.low-cutoff"]),
        (Processing(filter_cutoff=101.0, decimation=TENFOLD), []),
    ],
)
def test_filters_that_bias_are_named(recording, processing, codes):
    """At 1 kHz, decimation by 10 keeps 40 Hz: 2.5 times that is 100 Hz."""
    assert recording.period == pytest.approx(1e-3)
    assert [notice.code for notice in warn_of_processing(processing, [recording])] == codes


def build_rows(errors, seed=0):
    rng = np.random.default_rng(seed)
    time = np.arange(2000) * 1e-2
    matrix = np.column_stack([np.sin(time), np.cos(0.7 * time), np.ones_like(time)])
    return Rows(
        kind="torque",
        matrix=matrix,
        values=matrix @ [1.0, -2.0, 0.5] + errors(rng),
        group=np.zeros(2000, dtype=int),
        time=time,
        velocity=np.ones(2000),
        names=("a", "b", "c"),
        units=("1", "1", "1"),
        group_names=("one",),
        group_units=("N m",),
        velocity_units=("rad/s",),
    )


def draw_slow(rng):
    """First-order noise with a memory of fifty rows."""
    noise = np.zeros(2000)
    for k in range(1, 2000):
        noise[k] = 0.98 * noise[k - 1] + rng.normal(scale=0.1)
    return noise


@pytest.mark.parametrize("fit", [fit_ols, fit_wls])
def test_white_noise_is_no_pattern_and_slow_noise_is(fit):
    for errors, codes in ((lambda rng: rng.normal(size=2000), []), (draw_slow, ["identify.pattern"])):
        rows = build_rows(errors)
        seen = analyse_identifiability(rows)
        notices = warn_of_correlated_residuals(rows, fit(rows, seen), seen)
        assert [notice.code for notice in notices] == codes


def test_block_deviations_are_honest_for_slow_noise():
    """Over 200 draws the spread of the estimates is what the blocks say, not what white noise says."""
    values, blocks, stated = [], [], []
    for seed in range(200):
        rows = build_rows(draw_slow, seed)
        seen = analyse_identifiability(rows)
        fit = fit_ols(rows, seen)
        values.append(fit.values)
        blocks.append(compute_block_deviations(rows, fit, seen))
        stated.append(np.sqrt(np.diag(fit.covariance)))
    spread = np.std(values, axis=0)
    assert np.all(spread > 4.0 * np.mean(stated, axis=0))
    # Blocks of twenty rows are shorter than the memory: better by far, still on the small side.
    assert np.all(np.mean(blocks, axis=0) > 2.0 * np.mean(stated, axis=0))
    assert np.all(np.mean(blocks, axis=0) < 1.1 * spread)


def test_a_fit_to_the_last_bit_raises_no_doubt():
    rows = build_rows(lambda _: 0.0)
    seen = analyse_identifiability(rows)
    assert warn_of_correlated_residuals(rows, fit_ols(rows, seen), seen) == ()


def test_impossible_inertias_are_named(recording):
    library = build_two_link()
    assert warn_of_mass_matrix(library, TWO_LINK_TRUTH, [recording]) == ()
    wrong = np.array(TWO_LINK_TRUTH)
    names = [parameter.name for parameter in library.card.beta]
    wrong[names.index("ZZ2")] *= -1.0
    (notice,) = warn_of_mass_matrix(library, wrong, [recording])
    assert notice.code == "identify.impossible-mass"
    assert " 201 of 201 poses" in notice.text
