"""What speaks against an estimate, and what a log cannot tell, is said; nothing is said of a sound one."""

import re
from dataclasses import replace

import numpy as np
import pytest

from symid.identification.diagnostics.fit_warnings import (
    compute_block_deviations,
    warn_of_correlated_residuals,
    warn_of_mass_matrix,
    warn_of_moving_ends,
    warn_of_processing,
)
from symid.identification.estimators.least_squares import fit_ols, fit_wls
from symid.identification.judge import POLICY
from symid.identification.regression.identifiability import analyse_identifiability
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.log_check import LogExcitation, ParameterVerdict, describe_excitation
from symid.logs import low_pass
from symid.logs.recording import Recording
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording
from tests.refusals import tell
from tests.unit.identification.rigid.two_link_logs import LIBRARY, NAMES
from tests.unit.identification.row_tables import make_rows

TENFOLD = Decimation(factor=10)


@pytest.fixture(scope="module")
def recording():
    return build_recording(LIBRARY, TWO_LINK_TRUTH)


@pytest.mark.parametrize(
    ("processing", "codes"),
    [
        (Processing(), ["identify.no-filter"]),
        (Processing(filter_cutoff=20.0), []),
        (Processing(filter_cutoff=64.0, decimation=TENFOLD), ["identify.low-cutoff"]),
        (Processing(filter_cutoff=66.0, decimation=TENFOLD), []),
        (Processing(filter_cutoff=100.0, filter_order=2, decimation=TENFOLD), ["identify.low-cutoff"]),
        (Processing(filter_cutoff=107.0, filter_order=2, decimation=TENFOLD), []),
    ],
)
def test_filters_that_bias_are_named(recording, processing, codes):
    """At 1 kHz, decimation by 10 keeps 40 Hz: there the filter may take 2 %."""
    assert recording.period == pytest.approx(1e-3)
    assert [notice.code for notice in warn_of_processing(processing, [recording])] == codes
    if processing.decimation.factor > 1:
        wave = np.sin(2.0 * np.pi * 40.0 * np.arange(20000) * 1e-3)
        passed = low_pass(wave, period=1e-3, cutoff=processing.filter_cutoff, order=processing.filter_order)
        assert (np.ptp(passed[9000:11000]) < (1.0 - POLICY.relevance) * np.ptp(wave)) == bool(codes)


def build_rows(errors, seed=0):
    rng = np.random.default_rng(seed)
    time = np.arange(2000) * 1e-2
    matrix = np.column_stack([np.sin(time), np.cos(0.7 * time), np.ones_like(time)])
    return make_rows(matrix, matrix @ [1.0, -2.0, 0.5] + errors(rng), time=time)


def draw_slow(rng):
    """First-order noise with a memory of fifty rows."""
    noise = np.zeros(2000)
    for k in range(1, 2000):
        noise[k] = 0.98 * noise[k - 1] + rng.normal(scale=0.1)
    return noise


@pytest.mark.parametrize("fit", [fit_ols, fit_wls])
def test_white_noise_is_no_pattern_and_slow_noise_is(fit):
    # A fit to the last bit raises no doubt either.
    exact, white = (lambda _: 0.0), (lambda rng: rng.normal(size=2000))
    for errors, codes in ((exact, []), (white, []), (draw_slow, ["identify.pattern"])):
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


def test_impossible_inertias_are_named(recording):
    assert warn_of_mass_matrix(LIBRARY, TWO_LINK_TRUTH, [recording]) == ()
    wrong = np.array(TWO_LINK_TRUTH)
    names = [parameter.name for parameter in LIBRARY.card.beta]
    wrong[names.index("ZZ2")] *= -1.0
    (notice,) = warn_of_mass_matrix(LIBRARY, wrong, [recording])
    assert notice.code == "identify.impossible-mass"
    assert " 60 of 60 poses" in notice.text


PROCESSING = Processing(filter_cutoff=40.0)


def find(estimate):
    return [notice.text for notice in estimate.notices if notice.code == "identify.moving-ends"]


def test_a_log_cut_out_of_a_motion_is_named_and_the_advice_helps():
    recording = build_recording(LIBRARY, TWO_LINK_TRUTH, samples=4001)
    whole = identify_parameters(LIBRARY, [recording], PROCESSING)
    (text,) = find(whole)
    # Without a filter there is nothing to say.
    assert warn_of_moving_ends(Processing(), [recording]) == ()
    assert " begins and ends " in text
    cut = {name: int(count) for name, count in re.findall(r"\bprocessing\.(\w+)=(\d+)", text)}
    assert cut == dict.fromkeys(("drop_first", "drop_last"), round(2.0 / 40.0 / recording.period))
    advised = identify_parameters(LIBRARY, [recording], replace(PROCESSING, **cut))
    assert find(advised) == []
    errors = [np.abs(estimate.assemble(NAMES) - TWO_LINK_TRUTH).max() for estimate in (whole, advised)]
    assert errors[1] < 0.3 * errors[0]


def test_ends_at_rest_are_not_named():
    time = 1e-3 * np.arange(5001)
    # From rest to rest, where accelerations begin and end at zero too, and a joint that never moves.
    position = np.column_stack([np.sin(3.0 * np.sin(np.pi * time / 5.0) ** 4), np.zeros(len(time))])
    recording = Recording(time=time, position=position, torque=np.zeros_like(position), source="log.npz")
    assert warn_of_moving_ends(PROCESSING, [recording]) == ()
    half = slice(0, 2000)
    cut = replace(recording, time=time[half], position=position[half], torque=recording.torque[half])
    (notice,) = warn_of_moving_ends(PROCESSING, [recording, cut])
    assert " ends " in notice.text
    assert " begins " not in notice.text
    assert warn_of_moving_ends(replace(PROCESSING, drop_last=50), [cut]) == ()


def make(*verdicts, condition=10.0, unknown=()):
    parameters = tuple(
        ParameterVerdict(name=f"P{index}", verdict=verdict, relative_std_percent=5.0, reason="none")
        for index, verdict in enumerate(verdicts)
    )
    return LogExcitation(
        parameters=parameters, singular=(1.0, 0.1), rank=2, condition=condition, unknown=unknown
    )


@pytest.mark.parametrize(
    ("lost", "unknown", "poor"),
    [(0, 0, False), (10, 0, False), (11, 0, True), (10, 20, False), (10, 21, True)],
)
def test_a_model_needs_three_quarters_with_values_and_a_quarter_known(lost, unknown, poor):
    verdicts = ["not identifiable"] * lost + ["poorly identifiable"] * (40 - lost)
    names = tuple(f"P{k}" for k in range(lost, lost + unknown))
    assert make(*verdicts, unknown=names).poor is poor


def test_what_a_log_does_not_tell_is_said_and_nothing_else():
    assert tell(describe_excitation(make("identifiable", "identifiable"))) == {}
    assert not make("identifiable", "not identifiable").empty
    assert not make("poorly identifiable", "not identifiable").empty
    assert make("poorly identifiable", "not identifiable", unknown=("P0",)).empty
    assert " 5e+03" in tell(describe_excitation(make("identifiable", condition=5e3)))["log.condition"]
    # Of many parameters the first eight are listed.
    for verdict, code in (
        ("not identifiable", "log.not-excited"),
        ("poorly identifiable", "log.faint-parameters"),
    ):
        text = tell(describe_excitation(make("identifiable", *[verdict] * 10)))[code]
        assert ("P1" in text, "P9" in text) == (True, False)
