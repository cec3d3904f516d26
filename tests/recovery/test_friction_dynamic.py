"""Friction with a memory, found again: LuGre and Dahl from a simulated rig, with noise of one per cent.

The data come from the rig's adaptive integrator, not from the step that the fit uses.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.friction_rig import PositionControl, Rig, RigOptions, simulate_friction_rig
from symid.errors import IdentifiabilityError, UsageError
from symid.identification.friction import fit_friction
from symid.identification.friction.joint_fit import FrictionSamples
from symid.ipopt import Ending
from symid.joint_models import build_memory_values, get_law, simulate_dynamic_friction
from tests.refusals import raises

NOISE = 0.01
MASS = 2.0
LUGRE = {"sigma0": 1e4, "sigma1": 100.0, "fC": 10.0, "fS": 15.0, "vs": 0.01, "gamma": 2.0, "fV": 25.0}
TRUTHS = {
    "lugre": LUGRE,
    "stiff": LUGRE | {"sigma0": 1e5, "sigma1": 300.0, "fC": 40.0, "fS": 55.0, "vs": 0.005, "fV": 60.0},
    "flat": LUGRE | {"fS": 10.0},
    "dahl": {"sigma0": 1e4, "fC": 10.0},
}


def build_target(bend, speed):
    """Return a motion: bristles bent slowly and fast without slip, then sines at 1.5 and 20 times `speed`."""
    pieces = [(1.5 * bend, 1.0), (1.5 * bend, 8.0)]
    pieces += [(1.5 * speed / (2.0 * np.pi * 0.5), 0.5), (20.0 * speed / (2.0 * np.pi), 1.0)]

    def target(time):
        amplitude, frequency = pieces[min(int(time / 2.0), len(pieces) - 1)]
        return amplitude * np.sin(2.0 * np.pi * frequency * time)

    return target


@cache
def simulate(name):
    named = TRUTHS[name]
    gain = 3.0 * named["sigma0"]
    control = PositionControl(
        proportional=gain,
        integral=0.0,
        derivative=1.4 * np.sqrt(gain * MASS),
        target=build_target(named["fC"] / named["sigma0"], named.get("vs", 0.01)),
    )
    options = RigOptions(duration=10.0, rate=500.0)
    return named, simulate_friction_rig(Rig(values=named, mass=MASS), control, options)


def build_samples(log, seed, *, with_mass=False, **changes):
    """Return what is measured: torque with noise of one per cent of its RMS."""
    noise = NOISE * np.sqrt(np.mean(log.friction**2)) * np.random.default_rng(seed).normal(size=log.time.size)
    fields = {
        "joint": "axis",
        "time": log.time,
        "velocity": log.velocity,
        "position": log.position,
        "torque": (log.force if with_mass else log.friction) + noise,
        "extra": log.acceleration[:, None] if with_mass else np.zeros((log.time.size, 0)),
        "extra_names": ("M",) if with_mass else (),
        "extra_units": ("kg",) if with_mass else (),
        "prismatic": True,
    }
    return FrictionSamples(**{**fields, **changes})


def check_recovered(found, named):
    for name, truth in named.items():
        if name == "gamma":
            continue
        assert found.get_value(name) == pytest.approx(truth, rel=0.05), name
        std = next(entry.std for entry in found.parameters if entry.name == name)
        assert abs(found.get_value(name) - truth) < 4.0 * std, name


def fit(samples, name="lugre", **options):
    return fit_friction(samples, get_law(name), **options)


@pytest.mark.parametrize("name", ["lugre", "stiff", "dahl"])
def test_all_parameters_come_back_within_five_per_cent(name):
    law = "dahl" if name == "dahl" else "lugre"
    named, run = simulate(name)
    found = fit(build_samples(run, 1), law)
    assert found.outcome is Ending.CONVERGED
    assert (found.refused, found.notices) == ((), ())
    check_recovered(found, named)
    wanted = NOISE * np.sqrt(np.mean(run.friction**2))
    assert found.sigma == pytest.approx(wanted, rel=0.05)
    units = {entry.name: entry.unit for entry in found.parameters}
    assert units["sigma0"] == "N/m"
    assert found.samples == run.time.size
    if name != "stiff":
        found = fit(build_samples(run, 2, with_mass=True), law)
        check_recovered(found, named)
        assert found.get_value("M") == pytest.approx(MASS, rel=0.01)


def test_an_encoder_and_a_noisy_velocity_do_not_matter():
    # One micrometre, a thousandth of the presliding way; one per cent of the velocity's RMS.
    named, run = simulate("lugre")
    noise = np.random.default_rng(9).normal(size=run.time.size) * NOISE * np.sqrt(np.mean(run.velocity**2))
    position = np.round(run.position / 1e-6) * 1e-6
    found = fit(build_samples(run, 1, position=position, velocity=run.velocity + noise))
    for name in ("sigma0", "sigma1", "fC", "fS", "vs", "fV"):
        assert found.get_value(name) == pytest.approx(named[name], rel=0.05), name


def test_two_recordings_and_a_filter():
    named, run = simulate("dahl")
    half = run.time.size
    twice = {
        "time": np.tile(run.time, 2),
        "velocity": np.tile(run.velocity, 2),
        "position": np.tile(run.position, 2),
        "torque": np.concatenate([build_samples(run, seed).torque for seed in (3, 4)]),
        "extra": np.zeros((2 * half, 0)),
        "run": np.repeat([0.0, 1.0], half),
        # Means of pairs: linear, and shorter.
        "reduce": lambda columns: 0.5 * (columns[0::2] + columns[1::2]),
    }
    found = fit(build_samples(run, 3, **twice), "dahl")
    check_recovered(found, named)
    assert found.samples == half


def test_static_friction_that_equals_coulomb_has_no_speed():
    named, run = simulate("flat")
    found = fit(build_samples(run, 5))
    assert "vs" in dict(found.refused)
    for name in ("sigma0", "fC"):
        assert found.get_value(name) == pytest.approx(named[name], rel=0.05)


TIME = 1e-3 * np.arange(3000)


def follow(position, values=LUGRE, law="lugre", noise=0.1):
    """Return samples at 1 kHz of the law itself along positions."""
    count = len(position)
    samples = FrictionSamples(
        joint="1",
        time=1e-3 * np.arange(count),
        velocity=np.gradient(position, 1e-3),
        torque=np.zeros(count),
        position=position,
        extra=np.zeros((count, 0)),
    )
    way, known = np.diff(position, prepend=position[:1]), build_memory_values(get_law(law), values)
    torque, _ = simulate_dynamic_friction(known, samples.velocity, way)
    return replace(samples, torque=torque + noise * np.random.default_rng(0).standard_normal(count))


@pytest.mark.parametrize(
    "position",
    [0.2 * TIME, 1e-7 * np.sin(6.0 * TIME), np.where(TIME > 2.5, 1e-2 * (TIME - 2.5), 0.0)],
    ids=["one speed", "less than noise", "rest, then one speed"],
)
def test_a_motion_that_shows_no_bristles_gives_none(position):
    try:
        found = fit(follow(position))
    except IdentifiabilityError as error:
        # A refusal as a whole is right, too.
        assert [notice.code for notice in error.notices] == ["friction.presliding-nothing"]  # noqa: PT017
    else:
        assert {"vs", "fS"} & dict(found.refused).keys()


def test_bristles_whose_damping_nothing_shows_have_none():
    wide = 2e-3 * np.sin(2.0 * np.pi * TIME) + 0.02 * np.sin(np.pi * TIME) * (TIME > 1.5)
    found = fit(follow(wide, LUGRE | {"sigma1": 0.0}))
    told = {entry.name: entry for entry in found.parameters}
    assert told["sigma1"].value == 0.0
    assert "zero" in told["sigma1"].reason
    assert told["fV"].value == pytest.approx(25.0, abs=1.0)


def test_elements_come_back_with_their_thresholds():
    rng, count = np.random.default_rng(4), 6000
    position = sum(
        size * np.sin(2.0 * np.pi * rate * 1e-3 * np.arange(count) + rng.uniform(0.0, 6.0))
        for size, rate in ((3e-3, 0.7), (2e-2, 0.23), (5e-4, 2.1))
    )
    stiffness, share = (800.0, 200.0, 50.0), (0.3, 0.3, 0.4)
    values = {"fC": 2.0, "fV": 0.5}
    for k, (spring, part) in enumerate(zip(stiffness, share, strict=True), start=1):
        values |= {f"stiffness{k}": spring, f"share{k}": part}
    found = fit(follow(position, values, "maxwell-slip", noise=0.02), "maxwell-slip")
    assert found.sigma == pytest.approx(0.02, rel=0.03)
    assert found.get_value("fC") == pytest.approx(2.0, rel=0.02)
    viscous = next(entry for entry in found.parameters if entry.name == "fV")
    assert abs(viscous.value - 0.5) < 4.0 * viscous.std < 0.2
    # Every true element is there; what else is found carries next to nothing.
    carried = {
        entry.value: found.get_value(entry.name.replace("stiffness", "share"))
        for entry in found.parameters
        if entry.name.startswith("stiffness")
    }
    for true, part in zip(stiffness, share, strict=True):
        near = min(carried, key=lambda value: abs(np.log(value / true)))
        assert near == pytest.approx(true, rel=0.1)
        assert carried.pop(near) == pytest.approx(part, abs=0.03)
    assert sum(carried.values()) < 0.03


@pytest.mark.parametrize("position", [None, np.ones(5001)], ids=["none", "constant"])
def test_what_cannot_be_fitted_is_refused(position):
    _, run = simulate("dahl")
    with raises(IdentifiabilityError, "friction.presliding-position", match=r"joint .*position"):
        fit(build_samples(run, 0, position=position), "dahl")
    with raises(UsageError, "usage.friction-state", match="'nlp'|varpro"):
        fit(build_samples(run, 0), "dahl", estimator="nlp")
    with raises(IdentifiabilityError, "friction.few-rows"):
        fit(follow(np.array([0.0, 1e-3])))
