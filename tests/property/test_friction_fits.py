"""Identities of a fit: scaled torques, shifted rigid columns, numbers whatever the motion."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.joint_fit import FrictionSamples
from symid.joint_models.friction_catalogue import FRICTION_LAWS, get_law
from symid.joint_models.friction_law import compute_friction_torque
from tests.frictions import build_cosines

LAWS = ("coulomb-viscous", "stribeck", "tustin", "lorentzian", "improved-stribeck", "cubic", "asymmetric")
NAMES = st.sampled_from(LAWS)
SEEDS = st.integers(0, 2**20)


def draw(name, seed):
    """Return samples of a law with drawn parameters, and the law."""
    rng = np.random.default_rng(seed)
    law = get_law(name)
    velocity = build_cosines(0.1, 1.0, count=300)
    ranges = [(0.02, 0.05) if entry.name == "vs" else (0.005, 0.015) for entry in law.shape]
    shape, linear = [rng.uniform(*ends) for ends in ranges], rng.uniform(5.0, 20.0, len(law.linear))
    torque = compute_friction_torque(law, {"velocity": velocity}, linear, shape)
    return build(velocity, torque + 0.3 * rng.standard_normal(600)), law


def build(velocity, torque, **given):
    fields = {"extra": np.zeros((len(velocity), 0)), "time": 1e-3 * np.arange(len(velocity)), **given}
    return FrictionSamples(joint="1", velocity=velocity, torque=torque, **fields)


@settings(max_examples=25)
@given(NAMES, SEEDS, st.floats(0.01, 100.0))
def test_scaled_torque_scales_the_linear_parameters(name, seed, factor):
    samples, law = draw(name, seed)
    fit = fit_friction(samples, law)
    scaled = fit_friction(build(samples.velocity, factor * samples.torque), law)
    np.testing.assert_allclose(scaled.shape, fit.shape, rtol=1e-5)
    largest = np.max(np.abs(fit.linear))
    np.testing.assert_allclose(np.array(scaled.linear) / factor, fit.linear, rtol=1e-5, atol=1e-6 * largest)
    assert scaled.objective == pytest.approx(factor**2 * fit.objective, rel=1e-9)


@settings(max_examples=15)
@given(NAMES, SEEDS, st.floats(-50.0, 50.0))
def test_what_stands_beside_friction_is_found_apart_from_it(name, seed, inertia):
    samples, law = draw(name, seed)
    acceleration = np.cos(np.linspace(0.0, 4.0 * np.pi, samples.count))
    beside = {"extra": acceleration[:, None], "extra_names": ("J",)}
    plain = fit_friction(build(samples.velocity, samples.torque, **beside), law)
    moved = fit_friction(build(samples.velocity, samples.torque + inertia * acceleration, **beside), law)
    assert moved.objective == pytest.approx(plain.objective, rel=1e-9)
    np.testing.assert_allclose(moved.shape, plain.shape, rtol=1e-5)
    assert moved.other[0] - plain.other[0] == pytest.approx(inertia, abs=1e-4)


@settings(max_examples=60)
@given(
    st.sampled_from(sorted(FRICTION_LAWS)),
    st.sampled_from(["noise", "constant", "one-sided", "two-speeds", "rests", "one-step"]),
    st.sampled_from([12, 30, 200]),
    st.tuples(st.floats(-4.0, 3.0), st.floats(-6.0, 4.0)),
    SEEDS,
)
def test_no_motion_gives_numbers_that_are_none(name, kind, count, sizes, seed):
    size, reach = sizes
    rng = np.random.default_rng(seed)
    steps = np.arange(count)
    motions = {
        "noise": rng.standard_normal(count),
        "constant": np.ones(count),
        "one-sided": np.abs(rng.standard_normal(count)),
        "two-speeds": np.where(steps < count // 2, 1.0, -1.0),
        "rests": np.sin(0.1 * steps) * (rng.random(count) > 0.5),
        "one-step": (steps == count - 1).astype(float),
    }
    velocity = 10.0**size * motions[kind]
    torque = 10.0**reach * (np.sign(velocity) + rng.standard_normal(count))
    inputs = {"load": rng.standard_normal(count), "position": rng.standard_normal(count)}
    if "temperature" in FRICTION_LAWS[name].inputs:
        inputs["temperature"] = 30.0 + 10.0 * rng.standard_normal(count)
    fit = fit_friction(build(velocity, torque, **inputs), FRICTION_LAWS[name])
    assert fit.solves <= 150
    entries = [number for entry in fit.parameters for number in (entry.value, entry.std)]
    assert np.all(np.isfinite([fit.objective, fit.sigma, *fit.linear, *fit.shape, *entries]))
    printed = {entry.name for entry in fit.parameters}
    assert printed | set(dict(fit.refused)) == {entry.name for entry in FRICTION_LAWS[name].physical}
    assert not printed & set(dict(fit.refused))
