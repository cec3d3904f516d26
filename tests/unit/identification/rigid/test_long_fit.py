"""Logs whose rows do not go into memory: the same estimate, notices included, as from rows in memory."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from symid.errors import IdentifiabilityError
from symid.identification.diagnostics.fit_warnings import compute_block_deviations
from symid.identification.diagnostics.residual_structure import analyse_residuals
from symid.identification.diagnostics.uncertainty import compute_mean_weights
from symid.identification.estimators.least_squares import fit_condensed, fit_wls
from symid.identification.regression.equations import stack_rows
from symid.identification.regression.identifiability import RankRule, analyse_identifiability
from symid.identification.regression.preparation import RowBuilder, condense_recordings
from symid.identification.rigid.fit import fit_long, identify_parameters, is_long
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link

LIBRARY = build_two_link()
PROCESSING = Processing(filter_cutoff=60.0, standstill=0.3, drop_first=120, decimation=Decimation(factor=7))


@pytest.fixture(autouse=True)
def short_blocks(monkeypatch):
    """Cut logs of this length in as many blocks as longer ones."""
    monkeypatch.setattr("symid.identification.judge.numerics.BLOCK", 512)
    monkeypatch.setattr("symid.logs.signals._BLOCK", 8192)


def record(seed, samples=12001, spring=0.0, friction=1.0):
    truth = TWO_LINK_TRUTH.copy()
    truth[6] *= friction
    clean = build_recording(LIBRARY, truth, samples=samples, seed=seed, source=f"made {seed}")
    torque = clean.torque + np.random.default_rng(seed).normal(size=clean.torque.shape)
    torque[:, 1] += spring * clean.position[:, 1]
    return replace(clean, torque=torque)


@pytest.fixture(scope="module")
def recordings():
    """Return logs that differ in length and in a spring that the model has not."""
    return [record(1), record(2, 24601, spring=40.0)]


def compare(one, other, *, deviations=True):
    """Compare two estimates to 1e-9 of their values, all else exactly.

    Deviations from held-out stretches are of rows in memory alone.
    """
    for first, second in zip(one.parameters, other.parameters, strict=True):
        assert first.name == second.name
        assert second.value == pytest.approx(first.value, rel=1e-9)
        if deviations:
            assert second.std == pytest.approx(first.std, rel=1e-9)
    for first, second in zip(one.residual, other.residual, strict=True):
        assert (first.joint, first.samples, first.unit) == (second.joint, second.samples, second.unit)
        for name in ("norm", "relative_percent", "std"):
            assert getattr(second, name) == pytest.approx(getattr(first, name), rel=1e-9)
    if deviations:
        np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-9, atol=1e-12)
    assert other.condition == pytest.approx(one.condition, rel=1e-9)
    # In memory deviations speak for these.
    apart = set() if deviations else {"identify.pattern", "identify.poorly-identifiable"}
    listed = ([entry for entry in found.notices if entry.code not in apart] for found in (one, other))
    assert next(listed) == next(listed)
    assert other.evidence.held_out == pytest.approx(one.evidence.held_out, rel=1e-9)
    same = ("samples", "settings", "refused", "outcome", "sources")
    assert [getattr(one, name) for name in same] == [getattr(other, name) for name in same]


@pytest.mark.parametrize("estimator", ["ols", "wls"])
@pytest.mark.parametrize("freedom", ["band", "parameters", "one"])
@pytest.mark.parametrize(
    "rows", [{"rows": "torque"}, {"rows": "momentum", "window": 0.04, "overlap": 0.75}], ids=str
)
def test_blocks_give_what_memory_gives(recordings, estimator, freedom, rows):
    processing = replace(PROCESSING, noise_freedom=freedom)
    call = (LIBRARY, recordings, processing)
    options = {"estimator": estimator, "weights": (1.0, 0.3), **rows}
    whole, blocks = (identify_parameters(*call, **options, largest=size) for size in (1e9, 0.0))
    compare(whole, blocks, deviations=freedom != "band")
    assert {"identify.slow-rows", "identify.pattern"} <= {notice.code for notice in blocks.notices}
    # A spring that the model has not: those that are too small in blocks are larger in memory.
    (pattern,) = (notice.text for notice in blocks.notices if notice.code == "identify.pattern")
    named = pattern.partition(" deviations of ")[2].partition(" are ")[0].split(", ")
    for first, second in zip(whole.parameters, blocks.parameters, strict=True):
        if freedom == "band" and first.name in named:
            assert first.std > second.std


@pytest.mark.parametrize("freedom", ["band", "one"])
@pytest.mark.parametrize("kind", ["torque", "momentum"])
def test_deviations_of_blocks(kind, freedom):
    """The friction of the first joint has grown by half between the logs."""
    recordings = [record(1), record(2, 24601, friction=1.5)]
    maker = RowBuilder(kind, LIBRARY, PROCESSING, 0.04, 0.5)
    rows = stack_rows([maker.prepare(entry) for entry in recordings], (1.0, 0.3))
    seen = analyse_identifiability(rows)
    fit = fit_wls(rows, seen, freedom)
    long = condense_recordings(maker, recordings, (1.0, 0.3))
    sketch, weights = long.sketch(), compute_mean_weights(rows, fit)
    found = fit_condensed(long.condense(), seen.basis, weights, freedom)
    np.testing.assert_allclose(np.diag(found.covariance), np.diag(fit.covariance), rtol=1e-9)
    left = sketch.values - sketch.matrix @ fit.values
    small = replace(fit, residuals=left, weights=weights[sketch.group])
    np.testing.assert_allclose(
        compute_block_deviations(sketch, small, seen), compute_block_deviations(rows, fit, seen), rtol=1e-9
    )


def test_every_sample_joints_at_rest_and_refused_parameters(recordings):
    """The second joint rests in one log, and the first in the other."""
    plain = replace(PROCESSING, decimation=Decimation(), filter_torque=True)
    call = (LIBRARY, recordings[:1], plain)
    compare(identify_parameters(*call), identify_parameters(*call, largest=0.0), deviations=False)
    logs = []
    for joint, log in enumerate(recordings):
        position = log.position.copy()
        position[:, joint] = 0.2
        logs.append(replace(log, position=position))
    for some in (logs, logs[:1]):
        whole = identify_parameters(LIBRARY, some, PROCESSING)
        assert "identify.joint-at-rest" in {notice.code for notice in whole.notices}
        compare(whole, identify_parameters(LIBRARY, some, PROCESSING, largest=0.0), deviations=False)
    with pytest.raises(IdentifiabilityError) as caught:
        identify_parameters(LIBRARY, logs[:1], PROCESSING, rule=RankRule(least=1.0), largest=0.0)
    assert "identify.poor-log" in {notice.code for notice in caught.value.notices}


def test_what_blocks_cannot_do_is_done_in_memory(recordings):
    maker = RowBuilder("torque", LIBRARY, PROCESSING, 0.1, 0.0)
    assert is_long(maker, recordings, "wls", 0.0)
    assert not is_long(maker, recordings, "huber", 0.0)
    assert not is_long(maker._replace(kind="energy"), recordings, "wls", 0.0)
    rows = sum(len(entry.time) for entry in recordings) / PROCESSING.decimation.factor * LIBRARY.card.size
    size = 8.0 * rows * (len(TWO_LINK_TRUTH) + 1)
    assert is_long(maker, recordings, "ols", 0.99 * size)
    assert not is_long(maker, recordings, "ols", 1.01 * size)
    # Too few equations for blocks: those of the second joint, which is slow.
    short = [record(3, 320)]
    assert condense_recordings(maker, short, None) is None
    whole, again = (identify_parameters(LIBRARY, short, PROCESSING, largest=size) for size in (1e9, 0.0))
    assert whole == again


def test_structure_of_very_long_logs_is_that_of_some_of_their_rows():
    recordings = [record(1, 20001), record(2, 41000, spring=40.0)]
    call = (TWO_LINK_TRUTH, LIBRARY, recordings, PROCESSING)
    whole = analyse_residuals(*call)[0]
    assert {(entry.joint, entry.family) for entry in whole} >= {("joint2", "position")}
    rows = sum(len(entry.time) for entry in recordings) / PROCESSING.decimation.factor
    size = 8.0 * rows * (len(TWO_LINK_TRUTH) + 1)
    some = analyse_residuals(*call, largest=size / 4.5)[0]
    found = {(entry.joint, entry.family): entry for entry in some}
    for entry in (entry for entry in whole if entry.share_percent > 10.0):
        other = found[entry.joint, entry.family]
        assert (other.share_percent, other.rms) == pytest.approx((entry.share_percent, entry.rms), rel=0.1)


class Wide:
    """A library of two joints with 80 parameters each, whatever they mean."""

    backend, notices, tangents, names = "numpy", (), None, tuple(f"B{index}" for index in range(160))

    def __init__(self):
        beta = tuple(replace(LIBRARY.card.beta[0], name=name) for name in self.names)
        self.card = replace(LIBRARY.card, beta=beta, friction=())

    def evaluate(self, name, q, _, ddq):
        assert name == "torque_regressor"
        found = np.zeros((len(q), 2, 160))
        for index in range(160):
            joint, k = divmod(index, 80)
            found[:, joint, index] = np.sin(k + k * q[:, joint]) * (ddq[:, joint] if k % 2 else 10.0)
        return (found,)


def test_memory_grows_by_the_log_and_not_by_its_matrix():
    maker = RowBuilder("torque", Wide(), replace(PROCESSING, decimation=Decimation()), 0.1, 0.0)
    peaks, samples = [], (15_000, 30_000)
    for count in samples:
        log = record(5, count)
        tracemalloc.start()
        found = fit_long(maker, [log], "wls", rule=RankRule())
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert found.samples > 0.8 * LIBRARY.card.size * count
    matrix = 8 * LIBRARY.card.size * len(Wide.names) * (samples[1] - samples[0])
    assert peaks[1] - peaks[0] < 0.3 * matrix
