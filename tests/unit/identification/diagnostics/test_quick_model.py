"""The quick model: its samples and fits against explicit ones, and what it calls impossible."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.diagnostics.causes import build_quick_logs, fit_quick, mask_impossible
from symid.identification.regression.equations import evaluate_columns
from symid.robot.description import Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link

BAND = 10.0
ENDS = Processing(drop_first=200, drop_last=200)
LIBRARY = build_two_link()


def record(seed, samples=20001, noise=None):
    return build_recording(LIBRARY, TWO_LINK_TRUTH, samples=samples, seed=seed, noise=noise)


def find_impossible(logs):
    return mask_impossible(logs, fit_quick(logs)).tolist()


@pytest.fixture(scope="module")
def quick():
    return build_quick_logs(LIBRARY, [record(0, noise=(0.1, 0.1)), record(1, noise=(0.1, 0.1))], ENDS, BAND)


def test_a_clean_log_gives_the_truth():
    logs = build_quick_logs(LIBRARY, [record(0)], ENDS, BAND)
    found = fit_quick(logs)
    # Dry friction jumps, which the low-pass blurs.
    assert found.percent < 2.0
    np.testing.assert_allclose(found.values, TWO_LINK_TRUTH, rtol=0.05, atol=0.02)
    assert not mask_impossible(logs, found).any()


def test_samples_are_thinned_cut_and_slow_ones_do_not_count(quick):
    # Forty a second, of 20 s less the ends, where filters extrapolate.
    assert len(quick.q) == pytest.approx(2 * 40.0 * 18.6, abs=4)
    assert quick.period == pytest.approx(0.025)
    assert np.unique(quick.stretch[quick.run == 1]).tolist() == [3, 4, 5]
    for run in (0, 1):
        speed = np.abs(quick.dq[quick.run == run])
        slow = speed < 0.05 * np.quantile(speed, 0.99, axis=0)
        assert np.array_equal(~slow, quick.kept[quick.run == run])
        assert 0.0 < slow.mean() < 0.2
    # Long logs have as many as allowed.
    logs = build_quick_logs(LIBRARY, [record(0, samples=60001)], ENDS, 40.0)
    assert 2400 < len(logs.q) <= 3000
    # A joint that stands still may stick: its torque says nothing.
    log = record(2)
    position = log.position.copy()
    position[:, 1] = 0.3
    rest = build_quick_logs(LIBRARY, [replace(log, position=position)], ENDS, BAND)
    assert not rest.kept[:, 1].any()
    assert len(fit_quick(rest).held_out) == 1


def test_what_is_held_out_is_predicted_by_fits_to_the_rest(quick):
    found = fit_quick(quick)
    columns = evaluate_columns(LIBRARY, quick.q, quick.dq, quick.ddq)
    kept, left = quick.kept, np.zeros((6, 2))
    # The weights are the inverse squares that the fit to all leaves of each joint.
    errors = np.where(kept, quick.tau - columns @ found.values, 0.0)
    weights = 1.0 / np.sum(errors**2, axis=0)
    for stretch in range(6):
        table, values = [], []
        for joint in (0, 1):
            own = kept[:, joint] & (quick.stretch != stretch)
            table.append(columns[own, joint] * np.sqrt(weights[joint]))
            values.append(quick.tau[own, joint] * np.sqrt(weights[joint]))
        fold = np.linalg.lstsq(np.vstack(table), np.concatenate(values))[0]
        # The fit's own weights are those of the iteration before its last.
        np.testing.assert_allclose(found.folds[stretch], fold, rtol=1e-3, atol=1e-4)
        held = quick.stretch == stretch
        left[stretch] = np.sum(np.where(kept, quick.tau - columns @ found.folds[stretch], 0.0)[held] ** 2, 0)
    whole = np.sum(np.where(kept, quick.tau, 0.0) ** 2, axis=0)
    np.testing.assert_allclose(found.held_out, 100.0 * np.sqrt(left.sum(axis=0) / whole), rtol=1e-6)
    np.testing.assert_allclose(found.losses.reshape(6, -1, 2).sum(axis=1), left / whole, rtol=1e-6)
    np.testing.assert_allclose(found.fitted, 100.0 * np.sqrt(np.sum(errors**2, axis=0) / whole), rtol=1e-6)
    assert found.percent == pytest.approx(found.held_out.mean())


def test_joints_that_friction_drives_and_a_negative_inertia_are_impossible(quick):
    for joint in (0, 1):
        tau = quick.tau.copy()
        tau[:, joint] *= -1.0
        assert find_impossible(replace(quick, tau=tau))[joint]
    assert all(find_impossible(replace(quick, tau=-quick.tau)))
    assert not any(find_impossible(quick))
    # Torques of a body whose inertia is turned, with friction as before: only the inertia is negative.
    truth = TWO_LINK_TRUTH * np.array([1, 1, 1, -1, 1, 1, *[1] * 6])
    turned = replace(quick, tau=evaluate_columns(LIBRARY, quick.q, quick.dq, quick.ddq) @ truth)
    assert find_impossible(turned) == [False, True]
    assert fit_quick(turned).values[3] == pytest.approx(truth[3], rel=1e-3)
