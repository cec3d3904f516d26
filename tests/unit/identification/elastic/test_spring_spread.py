"""Deviations of springs, against many fits to noise that was drawn."""

import numpy as np
import pytest

from symid.identification.elastic.estimate import (
    list_spring_numbers,
    measure_spring_spread,
    move_spring,
)
from symid.joint_models import BoucWen, Elasticity, Knee, Stop, run_element

TIME = np.linspace(0.0, 12.0, 1200)
PHI = 0.01 * (np.sin(2.0 * np.pi * 0.5 * TIME) + 0.6 * np.sin(2.0 * np.pi * 1.3 * TIME + 1.0))
LEVER = np.cos(0.9 * TIME)


def follow(spring):
    return run_element(spring, PHI, TIME).output


def measure(spring, variance):
    """Return the spread of a spring's torque and slope; `variance` of the only parameter of the links."""
    zero = [np.zeros(len(PHI))]
    return measure_spring_spread(
        spring, lambda moved: [follow(moved)], [PHI[:, None]], zero, np.array([[variance]])
    )


def test_deviations_of_torque_and_slope_are_those_of_many_fits():
    # The torque of the links is the spring's; a parameter of theirs is known to 0.02, and noise is white.
    truth = Elasticity(stiffness=400.0, stops=(Stop(threshold=0.004, stiffness=150.0),))
    basis = np.stack(
        [PHI, follow(Elasticity(stiffness=1e-9, stops=(Stop(threshold=0.004, stiffness=1.0),)))], axis=1
    )
    rng = np.random.default_rng(2)
    draws = []
    for _ in range(2000):
        torque = basis @ [400.0, 150.0] + 0.02 * rng.standard_normal() * LEVER
        torque = torque + 0.1 * rng.standard_normal(len(TIME))
        draws.append(np.linalg.lstsq(basis, torque, rcond=None)[0])
    cases = np.cov(np.array(draws).T)
    slope = np.sqrt(np.sum(cases))
    torque = np.sqrt(np.mean(np.einsum("ij,jk,ik->i", basis, cases, basis)))
    errors = 0.1 * rng.standard_normal(len(TIME))
    # The threshold counts as well, so that the deviations are somewhat larger than with a known one.
    found = measure_spring_spread(
        truth, lambda spring: [follow(spring)], [LEVER[:, None]], [errors], np.array([[0.02**2]])
    )
    assert torque < found[0] < 1.8 * torque
    assert 0.8 * slope < found[1] < 2.5 * slope


@pytest.mark.parametrize(("torque", "added"), [(0.2, 0.008), (2.0, 0.0)])
def test_a_knee_near_zero_makes_the_slope_there_uncertain(torque, added):
    # tau = beta phi is followed by k phi: k has the relative deviation of beta, exactly; filtered reversals
    # add a thousandth of the slope.
    found = measure(Elasticity(stiffness=500.0), 9.0)
    assert found == pytest.approx((3.0 * np.sqrt(np.mean(PHI**2)), np.hypot(3.0, 0.5)))
    # The largest torque is 7.2 N m. Such knees are what noise makes of a stiffer beginning.
    knees = tuple(Knee(threshold=side * torque, slope=-0.008) for side in (-1.0, 1.0))
    found = measure(Elasticity(stiffness=500.0, knees=knees), 0.0)
    assert found[1] == pytest.approx(500.0 * np.hypot(0.001, added), rel=1e-6)


def test_every_number_of_a_spring_moves_by_itself():
    spring = Elasticity(
        stiffness=300.0,
        cubic=2.0,
        damping=1.0,
        stops=(Stop(threshold=0.1, stiffness=50.0),),
        branches=(BoucWen(level=2.0, length=0.01, skew=0.2),),
    )
    numbers = list_spring_numbers(spring)
    assert [value for value, _ in numbers] == [300.0, 2.0, 1.0, 0.1, 50.0, 2.0, 0.01, 1.0, 0.5, 0.2]
    assert all(move_spring(spring, place, value) == spring for value, place in numbers)
    assert len({move_spring(spring, place, 1.01 * value) for value, place in numbers}) == len(numbers)
    knees = Elasticity(stiffness=300.0, knees=(Knee(threshold=2.0, slope=0.5),))
    assert [value for value, _ in list_spring_numbers(knees)] == [300.0, 2.0, 0.5]


def test_numbers_at_the_edge_of_what_springs_can_be_move_to_one_side():
    # Beyond its knee the slope is 1e-5, less than a step of the knee's change: only upwards is a spring left.
    edge, free = (
        measure(Elasticity(stiffness=300.0, knees=(Knee(threshold=2.0, slope=slope),)), 9.0)
        for slope in (-0.99999, -0.9)
    )
    assert edge == pytest.approx(free, rel=0.2)
    assert edge[1] > 0.0
