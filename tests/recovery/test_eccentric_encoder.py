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


def test_it_is_found_and_taken_off(fit, motion):
    (effect,) = find(fit.estimate)
    assert effect.joint == 0
    assert effect.values[1] == pytest.approx(OFF, rel=0.05)
    off = np.abs(np.subtract(effect.values, (0.0, OFF)))
    assert np.all(off < 4.0 * np.array(effect.deviations))
    for entry in fit.estimate.parameters:
        assert abs(entry.value - TRUTH[entry.name]) <= 4.0 * entry.std, entry
    assert fit.verdict.level == "good"
    (row,) = (entry for entry in fit.to_dict()["effects"] if entry["kind"] == "link-eccentricity")
    assert (row["joint"], row["unit"], row["order"]) == ("shoulder", "rad", 1.0)
    # The spring is that of the true torsion.
    time, motor, link, _ = motion
    phi, true = compute_spring_torque(motor, link)
    left = run_element(fit.springs[0].elasticity, phi, time).output - true
    assert np.std(left) < 0.02 * np.sqrt(np.mean(true**2))


@pytest.mark.parametrize("zero", [0.0, 0.3])
def test_none_is_found_where_there_is_none(mixed, motion, zero):
    """Gravity of a link that is turned, its zero not known, is a wave of one turn, too."""
    time, motor, link, torque = motion
    turned = link + np.array([zero, 0.0])
    assert not find(mixed.identify(build(mixed, (time, motor, turned, torque)), method="weighted").estimate)
