"""Motions and torques that the tables of friction are made from."""

import numpy as np
import pytest

from symid.study.friction_protocols import (
    FrictionScene,
    build_half_cosine,
    build_whole_cosines,
    draw_samples,
)

PHYSICAL = (11.64, 23.19, 0.02767, 27.88, 0.47, 0.010)


def test_cosines_move_in_one_direction_or_in_both():
    velocity = build_half_cosine(0.5, 500)
    assert velocity.shape == (500,)
    assert velocity.min() > 0.0
    assert 0.4999 < velocity.max() <= 0.5
    # The mean square of a sine is a half, exactly so on a grid that is half a step off.
    assert np.mean(velocity**2) == pytest.approx(0.125, rel=1e-12)
    velocity = build_whole_cosines((0.1, 1.0), 1000)
    assert velocity.shape == (2000,)
    assert np.max(np.abs(velocity[:1000])) == pytest.approx(0.1, rel=1e-4)
    assert np.max(np.abs(velocity[1000:])) == pytest.approx(1.0, rel=1e-4)
    assert np.min(np.abs(velocity)) > 1e-5
    assert np.sum(velocity > 0.0) == 1000
    assert abs(np.sum(velocity)) < 1e-10


def test_samples_are_the_torque_of_the_law_and_white_noise():
    velocity = build_whole_cosines((0.1, 1.0), 50)
    scene = FrictionScene("1", "improved-stribeck", PHYSICAL, velocity, 1.0)
    coulomb, static, stribeck, viscous, bias, edge = PHYSICAL
    for v, torque in zip(velocity, scene.torque, strict=True):
        speed = max(abs(v), edge)
        g = coulomb + (static - coulomb) * np.exp(-((speed / stribeck) ** 2)) + viscous * speed
        side = np.sign(v) if abs(v) >= edge else v / edge
        assert torque == pytest.approx(bias + g * side, rel=1e-13)
    scene = FrictionScene("1", "improved-stribeck", PHYSICAL, build_whole_cosines((1.0,), 20000), 3.0)
    samples = draw_samples(scene, np.random.default_rng(3))
    noise = samples.torque - scene.torque
    assert np.std(noise) == pytest.approx(3.0, rel=0.02)
    assert abs(np.mean(noise[1:] * noise[:-1])) < 0.2
    assert np.array_equal(draw_samples(scene, np.random.default_rng(3)).torque, samples.torque)
    assert samples.extra.shape == (20000, 0)
