"""Springs as others write them: catalogue values, springs behind dry friction."""

import numpy as np
import pytest

from symid.errors import RobotError
from symid.joint_models.hysteresis import (
    Elasticity,
    MaxwellElement,
    Stop,
    compute_catalogue_knees,
    convert_maxwell_elements,
)
from symid.joint_models.prandtl_ishlinskii import compute_hysteresis_torque
from tests.refusals import raises


@pytest.mark.parametrize("stiffness", [(1e4, 1.4e4, 1.9e4), (1e4, 1e4, 2e4), (2e4, 1e4, 1.5e4)])
def test_a_catalogue_gives_the_torsion_of_its_pieces(stiffness):
    first, second, third = stiffness
    low, high = 14.0, 48.0
    spring = Elasticity(stiffness=first, knees=compute_catalogue_knees(stiffness, (low, high)))
    torque = np.array([0.0, 5.0, low, 30.0, high, 100.0])
    torsion = np.minimum(torque, low) / first + np.clip(torque - low, 0, high - low) / second
    torsion += np.maximum(torque - high, 0.0) / third
    np.testing.assert_allclose(compute_hysteresis_torque(spring, torsion), torque, rtol=1e-13, atol=1e-12)
    np.testing.assert_allclose(compute_hysteresis_torque(spring, -torsion), -torque, rtol=1e-13, atol=1e-12)


def test_elements_are_stops():
    elements = [MaxwellElement(stiffness=4.0, force=2.0), MaxwellElement(stiffness=10.0, force=1.0)]
    stops = convert_maxwell_elements([*elements, MaxwellElement(stiffness=2.0, force=1.0)])
    assert stops == (Stop(threshold=0.1, stiffness=10.0), Stop(threshold=0.5, stiffness=6.0))
    spring = Elasticity(stiffness=1.0, stops=(*stops, Stop(threshold=0.9, stiffness=0.0)))
    # An element pulls with its stiffness until it holds no longer.
    phi = np.linspace(0, 2, 9)
    expected = phi + np.minimum(10.0 * phi, 1.0) + np.minimum(6.0 * phi, 3.0)
    np.testing.assert_allclose(compute_hysteresis_torque(spring, phi), expected, rtol=1e-14)


def test_what_is_refused():
    with pytest.raises(RobotError, match="force 0:"):
        convert_maxwell_elements([MaxwellElement(stiffness=1.0, force=0.0)])
    with raises(RobotError, *["robot.invalid-elasticity"] * 2) as caught:
        compute_catalogue_knees((1.0, -1.0, 1.0), (2.0, 1.0))
    assert all(name in str(caught.value) for name in ("K1", "K3", "T1", "T2"))
