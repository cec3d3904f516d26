"""Motions given by samples: exact between them for polynomials, near for waves, held at the ends."""

import numpy as np
import pytest

from symid.excitation.reference_motion import SampledMotion, scale_samples, truncate_motion
from symid.excitation.trajectories import build_tc

TIMES = np.array([0.0, 0.2, 0.5, 0.9, 1.0, 1.6])


def sample(functions, times=TIMES):
    q, dq, ddq = (
        np.column_stack([f.deriv(k)(times) if k else f(times) for f in functions]) for k in range(3)
    )
    return SampledMotion(time=times, position=q, velocity=dq, acceleration=ddq, source="here")


def test_polynomials_and_waves_come_back_between_their_samples():
    rng = np.random.default_rng(1)
    functions = [np.polynomial.Polynomial(rng.normal(size=6)) for _ in range(2)]
    motion = sample(functions)
    t = np.linspace(0.01, 1.59, 77)
    found = motion.evaluate_derivatives(t, 6)
    for order, values in enumerate(found):
        wanted = np.column_stack([f.deriv(order)(t) if order else f(t) for f in functions])
        np.testing.assert_allclose(values, wanted, atol=1e-8 * 50**order)
    assert (motion.size, motion.duration) == (2, 1.6)
    wave = build_tc(size=3)
    t = np.linspace(0.0, 20.0, 2001)
    q, dq, ddq = wave.evaluate(t)
    motion = SampledMotion(time=t, position=q, velocity=dq, acceleration=ddq, source="tc")
    between = t[:-1] + 0.004
    for found, wanted, near in zip(
        motion.evaluate(between), wave.evaluate(between), (1e-9, 1e-7, 1e-4), strict=True
    ):
        np.testing.assert_allclose(found, wanted, atol=near)


def test_samples_are_exact_held_beyond_still_and_scaled():
    motion = sample([np.polynomial.Polynomial([1.0, 2.0, -3.0, 0.5])])
    q, dq, ddq = motion.evaluate(TIMES)
    np.testing.assert_allclose(q, motion.position, atol=1e-14)
    np.testing.assert_allclose(dq, motion.velocity, atol=1e-13)
    np.testing.assert_allclose(ddq, motion.acceleration, atol=1e-12)
    np.testing.assert_array_equal(
        motion.evaluate(np.array([-1.0, 9.0]))[0], motion.evaluate(TIMES[[0, -1]])[0]
    )
    still = np.full((6, 2), 1.0 / 3.0)
    motion = SampledMotion(
        time=TIMES, position=still, velocity=0 * still, acceleration=0 * still, source="still"
    )
    q, dq, ddq = motion.evaluate(np.linspace(0.0, 1.6, 33))
    assert np.all(q == 1.0 / 3.0)
    assert not dq.any()
    assert not ddq.any()
    motion = sample([np.polynomial.Polynomial([1.0, 2.0, -3.0])])
    scaled = scale_samples(motion, 0.5)
    t = np.linspace(0, 1.6, 20)
    np.testing.assert_allclose(scaled.evaluate(t)[0] - 1.0, 0.5 * (motion.evaluate(t)[0] - 1.0), atol=1e-13)
    assert scaled.source == "here, amplitudes times 0.5"
    assert scale_samples(motion, 1.0) is motion


@pytest.mark.parametrize(("duration", "count"), [(0.5, 3), (0.51, 4), (1.6, 6), (0.0, 2)])
def test_a_part_ends_at_the_next_sample(duration, count):
    part = truncate_motion(sample([np.polynomial.Polynomial([1.0, 2.0])]), duration)
    assert len(part.time) == len(part.position) == count
