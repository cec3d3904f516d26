"""What rows do not tell: finite values, infinite deviations, springs that are not written."""

import json
from dataclasses import replace

import numpy as np
import pytest

from symid.cli.main import run
from symid.identification.elastic.estimate import (
    compute_covariance,
    mark_unidentifiable,
    measure_identifiability,
)
from symid.identification.elastic.regression import solve_with_signs
from symid.identification.stored import name_friction, write_fit
from symid.joint_models import FrictionValues, list_value_names
from symid.robot.toml_reader import read_robot
from symid.robot.toml_settings import describe_settings
from tests.friction_forms import OLD_NAMES
from tests.recovery.elastic_runs import identify_elastic, prepare_arm, run_arm


@pytest.fixture(scope="module")
def arm(robots_folder):
    return prepare_arm(robots_folder)


@pytest.fixture(scope="module")
def estimate(arm):
    log = run_arm(*arm, duration=6.0).recording
    return identify_elastic(arm[1], [log], method="weighted", echo=describe_settings(arm[0]))


@pytest.fixture
def rows():
    rng = np.random.default_rng(0)
    return rng.normal(size=(300, 12)) * np.logspace(-3, 3, 12)


def test_the_covariance_of_full_rows_is_the_inverse_or_the_sandwich(rows):
    told, condition = measure_identifiability(rows)
    assert told.all()
    assert condition == pytest.approx(np.linalg.cond(rows / np.linalg.norm(rows, axis=0)))
    left = np.linalg.inv(rows.T @ rows)
    assert np.allclose(compute_covariance(rows), left, rtol=1e-6, atol=0.0)
    errors = np.random.default_rng(1).normal(size=len(rows))
    blocks = np.array_split(np.arange(len(rows)), 100)
    scores = np.stack([rows[block].T @ errors[block] for block in blocks])
    expected = left @ scores.T @ scores @ left
    found = compute_covariance(rows, errors)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.allclose(found / scale, expected / scale, atol=1e-8)


@pytest.mark.parametrize("size", [0.0, 1e-200, 1e-14])
def test_what_is_not_told_has_an_infinite_variance(rows, size):
    """A column of nothing, or of rounding, and two columns in a fixed proportion."""
    rows[:, 3] *= size
    rows[:, 7] = 2.0 * rows[:, 5]
    told, _ = measure_identifiability(rows)
    assert np.flatnonzero(~told).tolist() == [3, 5, 7]
    for covariance in (compute_covariance(rows), compute_covariance(rows, np.ones(len(rows)))):
        assert np.array_equal(np.isinf(np.diag(covariance)), ~told)
        kept = covariance[np.ix_(told, told)]
        assert np.all(np.isfinite(kept))
        assert not covariance[np.ix_(told, ~told)].any()
    inner = np.delete(rows, [3, 7], axis=1)
    expected = np.sqrt(np.diag(np.linalg.inv(inner.T @ inner)))[[0, 1, 2, 3, 5, 6, 7, 8, 9]]
    assert np.allclose(np.sqrt(np.diag(compute_covariance(rows))[told]), expected, rtol=1e-5)
    # Marks leave the rest as it is.
    marked = mark_unidentifiable(np.full((3, 3), 2.0), np.array([True, False, True]))
    assert marked.tolist() == [[2.0, 0.0, 2.0], [0.0, np.inf, 0.0], [2.0, 0.0, 2.0]]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_solutions_are_short_where_rows_do_not_tell(arm, rows, sign):
    """`sign` -1 asks for negative friction, so that bounds act."""
    card = arm[1].card
    truth = np.ones(12)
    truth[8:] = [1.0, 1.0, 1.0, sign]
    rows[:, 6] *= 1e-14
    rows[:, 1] = 3.0 * rows[:, 0]
    found = solve_with_signs(card, rows, rows @ truth)
    assert np.all(np.isfinite(found))
    assert abs(found[6]) < 1e-6
    assert np.all(found[6:] >= 0.0)
    if sign > 0:
        told = np.delete(np.arange(12), [0, 1, 6])
        assert found[told] == pytest.approx(truth[told], rel=1e-6)
        assert found[0] + 3.0 * found[1] == pytest.approx(4.0, rel=1e-6)
        assert max(abs(found[0]), abs(found[1])) < 4.0


def refuse(estimate):
    """Return the estimate with the second spring refused."""
    first, second = estimate.springs
    second = replace(second, identifiable=False, reason="it is for the test")
    return replace(estimate, springs=(first, second))


def test_a_refused_spring_is_not_exported(capsys, tmp_path, robots_folder, estimate):
    path, file = write_fit(refuse(estimate), tmp_path / "estimate.json"), tmp_path / "found.toml"
    code = run(["export", "two_link_elastic", str(path), "-o", str(file), "--json"])
    answer = json.loads(capsys.readouterr().out)
    assert code == 0, answer
    (text,) = (entry["text"] for entry in answer["warnings"] if entry["code"] == "export.spring")
    assert "'elbow'" in text
    assert "it is for the test" in text
    assert answer["result"]["not_identified"] == ["the spring of 'elbow'"]
    found, stated = read_robot(file), read_robot(robots_folder / "two_link_elastic.toml")
    assert found.joints[0].elasticity == estimate.springs[0].elasticity
    assert found.joints[1].elasticity == stated.joints[1].elasticity


@pytest.mark.parametrize("law", ["none", *OLD_NAMES.values()])
def test_parameters_tell_the_law_of_fits_from_before_it_was_stored(law):
    names = list_value_names(FrictionValues(law=law))
    numbered = [f"{name}{joint}" for joint in (1, 2) for name in names]
    assert name_friction(["ZZ1", "MX2", "IA1", "IA2", *numbered]) == (law, law)
    mixed = [*(f"{name}1" for name in names), "Fv2", "Fc2"]
    assert name_friction(["ZZ1", "IA1", "IA2", *mixed]) == (law, "coulomb-viscous")
    assert name_friction(["ZZ1", "IA1", "Fv1"]) == ()
