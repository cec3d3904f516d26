"""A link's encoder whose disc is not centred, on an arm whose equations are written out in the tests."""

import numpy as np
import pytest

from symid.joint_models import run_element
from tests.recovery.written_out_arm import TRUTH, build, compute_spring_torque, simulate

OFF = 1.2e-3
"""Rad: the encoder reads q + OFF sin q, a twentieth of the torsion's range."""


@pytest.fixture(scope="module")
def motion():
    return simulate(20.0, 7)


@pytest.fixture(scope="module")
def fit(mixed, motion):
    time, motor, link, torque = motion
    wrong = link.copy()
    wrong[:, 0] += OFF * np.sin(link[:, 0])
    return mixed.identify(build(mixed, (time, motor, wrong, torque)))


def find(estimate):
    return [effect for effect in estimate.effects if effect.kind == "link-eccentricity"]


def test_it_is_found_and_taken_off(fit):
    (effect,) = find(fit.estimate)
    assert effect.joint == 0
    assert effect.values[1] == pytest.approx(OFF, rel=0.05)
    assert all(
        abs(value - true) < 4.0 * std
        for value, true, std in zip(effect.values, (0.0, OFF), effect.deviations, strict=True)
    )
    for entry in fit.estimate.parameters:
        assert abs(entry.value - TRUTH[entry.name]) <= 4.0 * entry.std, entry
    assert fit.verdict.level == "good"
    (row,) = (entry for entry in fit.to_dict()["effects"] if entry["kind"] == "link-eccentricity")
    assert (row["joint"], row["unit"], row["order"]) == ("shoulder", "rad", 1.0)


def test_the_spring_is_that_of_the_true_torsion(fit, motion):
    time, motor, link, _ = motion
    phi, true = compute_spring_torque(motor, link)
    left = run_element(fit.springs[0].elasticity, phi, time).output - true
    assert np.sqrt(np.mean((left - left.mean()) ** 2) / np.mean(true**2)) < 0.02


def test_none_is_found_where_there_is_none(mixed, motion):
    assert not find(mixed.identify(build(mixed, motion), method="weighted").estimate)


def test_a_link_whose_zero_is_not_known_is_not_taken_for_a_disc(mixed, motion):
    """Gravity of a link that is turned is a wave of one turn, too."""
    time, motor, link, torque = motion
    turned = link + np.array([0.3, 0.0])
    fit = mixed.identify(build(mixed, (time, motor, turned, torque)), method="weighted")
    assert not find(fit.estimate)
