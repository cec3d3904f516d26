"""Rows of a joint that stands still are left out where the settings ask for it, and the result says so."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.regression import balance_cutoff
from symid.identification.rigid.fit import identify_parameters
from symid.robot.description import Processing
from symid.simulation.experiment import SensorOptions
from tests.recovery.rigid_runs import run_fourier

NOISE = 0.2


@pytest.fixture(scope="module")
def recordings(two_link, two_link_library):
    library, sensors = two_link_library, SensorOptions(torque_noise=(NOISE,))
    return library, [run_fourier(two_link, library, seed, sensors=sensors).recording for seed in range(8)]


def find_scores(two_link, recordings, standstill):
    """Return (value - truth) / std of all parameters for all seeds: (seeds, p)."""
    library, runs = recordings
    processing = replace(two_link.processing, standstill=standstill)
    estimates = [identify_parameters(library, (run,), processing) for run in runs]
    return np.array([[(p.value - p.truth) / p.std for p in e.parameters] for e in estimates]), estimates


def test_the_stated_deviations_are_honest_and_rows_of_sticking_joints_no_noise(two_link, recordings):
    scores, estimates = find_scores(two_link, recordings, two_link.processing.standstill)
    # 96 scores, correlated within a seed: their mean square is one, give or take a quarter.
    assert 0.7 < np.sqrt(np.mean(scores**2)) < 1.3
    assert np.abs(scores.mean(axis=0)).max() < 1.2
    assert {notice.code for notice in estimates[0].notices} == {"identify.slow-rows"}
    assert "= 0.1 were" in estimates[0].notices[0].text
    # Why the setting exists: with all rows the elbow's residual lies above the noise, without them at it.
    _, with_all = find_scores(two_link, recordings, 0.0)
    elbow = np.array([[estimate.residual[1].std for estimate in part] for part in (with_all, estimates)])
    assert np.all(elbow[0] > 1.05 * elbow[1])
    # White noise of 0.2 N m keeps 0.29 of itself behind the decimation filter.
    assert np.mean(elbow[1]) == pytest.approx(0.29 * NOISE, rel=0.05)
    assert with_all[0].samples > estimates[0].samples


def test_a_file_without_processing_still_gives_sound_results(two_link, recordings):
    library, runs = recordings
    sizes, errors = [], []
    for settings in (Processing(automatic=True), Processing(), two_link.processing):
        estimates = [identify_parameters(library, (run,), settings) for run in runs[:4]]
        found = np.array([[(p.value - p.truth, p.std) for p in e.parameters] for e in estimates])
        sizes.append(np.sqrt(np.mean((found[..., 0] / found[..., 1]) ** 2)))
        errors.append(np.sqrt(np.mean(found[..., 0] ** 2, axis=0)))
    # Deviations cover with whatever settings; raw differences are far off, and say so.
    assert 0.4 < sizes[0] < 1.3
    assert sizes[1] < 1.6
    assert np.median(errors[0] / errors[1]) < 0.3
    assert np.median(errors[0] / errors[2]) < 3.0
    estimate = identify_parameters(library, runs[:1], Processing(automatic=True))
    assert estimate.notices[0].code == "identify.automatic"
    cutoff = estimate.settings["processing"]["filter_cutoff"]
    assert cutoff == pytest.approx(balance_cutoff(runs[:1]), rel=5e-3)
    assert f"one sample in 5, positions pass a low-pass at {cutoff:g} Hz" in estimate.notices[0].text
    assert estimate.settings["chosen"] == ["filter_cutoff", "decimation.factor", "standstill"]
    low = replace(two_link.processing, filter_cutoff=50.0)
    codes = [notice.code for notice in identify_parameters(library, runs[:1], low).notices]
    assert "identify.low-cutoff" in codes
