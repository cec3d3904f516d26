"""Studies of rigid robots: precision as the theory foretells, and the table over cut-offs."""

import functools

import numpy as np
import pytest

from symid.identification.estimators.least_squares import fit_wls
from symid.identification.regression.identifiability import analyse_identifiability
from symid.identification.rigid.fit import identify_parameters
from symid.robot.description import Processing
from symid.robot.toml_reader import read_robot
from symid.study import rigid_methods as precision
from symid.study.rigid_methods import study_cutoff, study_precision
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link


@pytest.fixture(scope="module")
def robot(robots_folder):
    return read_robot(robots_folder / "two_link.toml")


def test_the_bound_is_reached_and_deviations_are_honest(robot, monkeypatch):
    # In this process, and some of the seeds again in two others.
    fit = functools.cache(precision._fit_seed)
    with monkeypatch.context() as patch:
        patch.setattr(precision, "run_tasks", lambda _, tasks, **__: tuple(map(fit, tasks)))
        found, few = (study_precision(robot, range(count)) for count in (60, 4))
    assert found.robot == "two_link"
    assert [entry.method for entry in found.methods] == ["wls", "momentum", "consistent"]
    for entry in found.methods:
        # Sixty draws scatter by a tenth.
        assert 0.85 < entry.mean_ratio < 1.2
        assert entry.worst_ratio == max(entry.ratios)
        assert abs(entry.coverage_percent - 95.0) < 3.5
    assert found.methods[2].least_eigenvalue > 0.0
    assert found.methods[2].worst_price_percent < 0.5
    monkeypatch.setattr(precision, "_BATCH", 2)
    assert study_precision(robot, range(4), jobs=2) == few


def test_a_seed_gives_the_fit_of_its_rows(robot):
    """Values made anew in the triangles, against a fit to the rows with that noise."""
    scene = precision._load_scene(robot, "auto")
    rows = scene.rows["torque"]
    rng = np.random.default_rng(7)
    noise = rng.normal(size=len(rows.values)) * scene.deviations[rows.group]
    fields = {name: getattr(rows, name) for name in type(rows).__dataclass_fields__}
    noisy = type(rows)(**{**fields, "values": rows.matrix @ scene.truth + noise})
    expected = fit_wls(noisy, analyse_identifiability(noisy))
    condensed = precision._condense_with_noise(scene, "torque", noise)
    found = precision.fit_condensed(condensed, np.eye(len(scene.truth)))
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-8)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-6, atol=1e-18)


def test_a_clean_log_is_foretold_with_any_cutoff_that_lets_motion_pass():
    library = build_two_link()
    recording = build_recording(library, TWO_LINK_TRUTH, samples=12001, source="made", noise=(0.05, 0.02))
    told, options = [], {"cutoffs": (20.0, 100.0, 1000.0), "progress": lambda *pair: told.append(pair)}
    found = study_cutoff(library, recording, Processing(automatic=True), **options)
    assert [line.cutoff for line in found.lines] == [20.0, 100.0]
    assert told == [(1, 2), (2, 2)]
    assert found.factor == 10
    assert max(max(line.decimated, line.plain, line.momentum) for line in found.lines) < 1.0
    estimate = identify_parameters(library, [recording], Processing(automatic=True))
    assert not estimate.refused
