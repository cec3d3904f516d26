"""Friction with a memory, found again: LuGre and Dahl from a simulated rig, with noise of one per cent.

The data come from the rig's adaptive integrator, not from the step that the fit uses.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.friction_rig import PositionControl, Rig, RigOptions, simulate_friction_rig
from symid.errors import IdentifiabilityError, UsageError
from symid.identification.friction.joint_fit import FrictionSamples
from symid.identification.friction.presliding import build_path, fit_presliding
from symid.ipopt import Ending
from symid.joint_models.dynamic_friction import get_dynamic_law, simulate_dynamic_friction
from tests.refusals import raises

NOISE = 0.01
MASS = 2.0
LUGRE = get_dynamic_law("lugre")
TRUTHS = {
    "lugre": (1e4, 100.0, 10.0, 15.0, 0.01, 2.0, 25.0),
    "stiff": (1e5, 300.0, 40.0, 55.0, 0.005, 2.0, 60.0),
    "flat": (1e4, 100.0, 10.0, 10.0, 0.01, 2.0, 25.0),
    "dahl": (1e4, 10.0),
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
    law = get_dynamic_law("dahl" if name == "dahl" else "lugre")
    named = dict(zip(law.names, TRUTHS[name], strict=True))
    gain = 3.0 * named["sigma0"]
    control = PositionControl(
        proportional=gain,
        integral=0.0,
        derivative=1.4 * np.sqrt(gain * MASS),
        target=build_target(named["fC"] / named["sigma0"], named.get("vs", 0.01)),
    )
    rig, options = Rig(law=law, values=TRUTHS[name], mass=MASS), RigOptions(duration=10.0, rate=500.0)
    return law, named, simulate_friction_rig(rig, control, options)


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


@pytest.mark.parametrize("name", ["lugre", "stiff", "dahl"])
def test_all_parameters_come_back_within_five_per_cent(name):
    law, named, run = simulate(name)
    found = fit_presliding(build_samples(run, 1), law)
    assert found.outcome is Ending.CONVERGED
    assert (found.refused, found.notices) == ((), ())
    check_recovered(found, named)
    wanted = NOISE * np.sqrt(np.mean(run.friction**2))
    assert found.sigma == pytest.approx(wanted, rel=0.05)
    units = {entry.name: entry.unit for entry in found.parameters}
    assert units["sigma0"] == "N/m"
    assert found.samples == run.time.size
    if name == "lugre":
        # What is fixed is a choice.
        fixed = {"gamma": 2.0, "fC": 10.0, "fS": 15.0, "vs": 0.01, "fV": 25.0}
        for given in ({}, fixed):
            found = fit_presliding(build_samples(run, 1), law, fixed=given)
            assert [entry.name for entry in found.parameters] == [key for key in named if key not in given]
            assert found.get_value("sigma1") == pytest.approx(named["sigma1"], rel=0.05)
            assert dict(found.fixed) == given
    if name != "stiff":
        found = fit_presliding(build_samples(run, 2, with_mass=True), law)
        check_recovered(found, named)
        assert found.get_value("M") == pytest.approx(MASS, rel=0.01)


def test_an_exponent_that_the_data_want_beyond_its_bound_is_told():
    law, _, run = simulate("lugre")
    samples = build_samples(run, 1)
    wide = replace(law, parameters=tuple(replace(entry, upper=np.inf) for entry in law.parameters))
    values = (1e4, 100.0, 10.0, 15.0, 0.01, 9.0, 25.0)
    sharp = simulate_dynamic_friction(wide, values, build_path(samples)).torque
    noise = 0.1 * np.random.default_rng(1).normal(size=sharp.size)
    found = fit_presliding(build_samples(run, 1, torque=sharp + noise), law, fixed={})
    exponent = next(entry for entry in found.parameters if entry.name == "gamma")
    assert exponent.value == pytest.approx(4.0, rel=1e-4)
    assert exponent.reason.endswith("bound, 4")


def test_an_encoder_and_a_noisy_velocity_do_not_matter():
    # One micrometre, a thousandth of the presliding way; one per cent of the velocity's RMS.
    law, named, run = simulate("lugre")
    noise = np.random.default_rng(9).normal(size=run.time.size) * NOISE * np.sqrt(np.mean(run.velocity**2))
    position = np.round(run.position / 1e-6) * 1e-6
    found = fit_presliding(build_samples(run, 1, position=position, velocity=run.velocity + noise), law)
    for name in ("sigma0", "sigma1", "fC", "fS", "vs", "fV"):
        assert found.get_value(name) == pytest.approx(named[name], rel=0.05), name


def test_two_recordings_and_a_filter():
    law, named, run = simulate("dahl")
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
    found = fit_presliding(build_samples(run, 3, **twice), law)
    check_recovered(found, named)
    assert found.samples == half


def test_without_slip_the_law_of_slip_gets_a_sentence_and_no_number():
    law, named, run = simulate("lugre")
    short = slice(0, 400)
    small = 0.02 * run.position[short]
    # A spring and a damper, nothing else: what bristles far from slip are.
    speed = 0.02 * run.velocity[short]
    torque = named["sigma0"] * small + (named["sigma1"] + named["fV"]) * speed
    noise = 1e-2 * np.abs(torque).max() * np.random.default_rng(0).normal(size=400)
    changes = {"time": run.time[short], "velocity": speed, "position": small, "torque": torque + noise}
    found = fit_presliding(build_samples(run, 0, **changes, extra=np.zeros((400, 0))), law)
    refused = dict(found.refused)
    assert "vs" in refused
    assert found.get_value("fS") is None
    assert "vs" in refused["fS"]
    # Where nothing slips, fC may grow without end.
    assert found.outcome in {Ending.SOME_REFUSED, Ending.LIMIT}
    assert found.get_value("sigma0") == pytest.approx(named["sigma0"], rel=0.01)


def test_static_friction_that_equals_or_falls_below_coulomb_is_told():
    law, named, run = simulate("flat")
    found = fit_presliding(build_samples(run, 5), law)
    assert found.get_value("vs") is None
    assert "static" in dict(found.refused)["vs"]
    assert found.notices == ()
    for name in ("sigma0", "sigma1", "fC"):
        assert found.get_value(name) == pytest.approx(named[name], rel=0.05)
    law, named, run = simulate("lugre")
    rising = (1e4, 100.0, 10.0, 7.0, 0.01, 2.0, 25.0)
    samples = build_samples(run, 6)
    torque = simulate_dynamic_friction(law, rising, build_path(samples)).torque
    noise = 0.05 * np.random.default_rng(6).normal(size=torque.size)
    found = fit_presliding(build_samples(run, 6, torque=torque + noise), law)
    assert found.get_value("fS") == pytest.approx(7.0, rel=0.05)
    assert [notice.code for notice in found.notices] == ["friction.presliding-static"]
    assert "6.998" in found.notices[0].text
    assert named["fS"] == 15.0


@pytest.mark.parametrize(("step", "refused"), [(40, []), (100, ["sigma0"])])
def test_a_coarse_log_is_told_to_have_few_presliding_samples_or_refused(step, refused):
    law, _, run = simulate("dahl")
    coarse = slice(2000, None, step)
    changes = {name: getattr(run, name)[coarse] for name in ("time", "velocity", "position")}
    empty = np.zeros((len(run.time[coarse]), 0))
    samples = build_samples(run, 0, **changes, torque=run.friction[coarse], extra=empty)
    found = fit_presliding(samples, law)
    assert [name for name, _ in found.refused] == refused
    assert [notice.code for notice in found.notices] == ["friction.presliding-few"] * (not refused)


TIME = 1e-3 * np.arange(3000)


def follow(position, values=TRUTHS["lugre"]):
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
    torque = simulate_dynamic_friction(LUGRE, values, build_path(samples)).torque
    return replace(samples, torque=torque + 0.1 * np.random.default_rng(0).standard_normal(count))


@pytest.mark.parametrize(
    "position",
    [0.2 * TIME, 1e-7 * np.sin(6.0 * TIME), np.where(TIME > 2.5, 1e-2 * (TIME - 2.5), 0.0)],
    ids=["one speed", "less than noise", "rest, then one speed"],
)
def test_a_motion_that_shows_no_damping_gives_none(position):
    estimate = fit_presliding(follow(position), LUGRE)
    assert estimate.get_value("sigma1") is estimate.get_value("fV") is None
    assert {"sigma1", "fV"} <= dict(estimate.refused).keys()


def test_a_damping_of_zero_that_the_motion_shows_is_told():
    wide = 2e-3 * np.sin(2.0 * np.pi * TIME) + 0.02 * np.sin(np.pi * TIME) * (TIME > 1.5)
    estimate = fit_presliding(follow(wide, (1e4, 0.0, 10.0, 15.0, 0.01, 2.0, 25.0)), LUGRE)
    told = {entry.name: entry for entry in estimate.parameters}
    assert told["sigma1"].value == pytest.approx(0.0, abs=5.0)
    assert told["sigma1"].std < 5.0
    assert told["fV"].value == pytest.approx(25.0, abs=1.0)


@pytest.mark.parametrize("position", [None, np.ones(5001)], ids=["none", "constant"])
def test_what_cannot_be_fitted_is_refused(position):
    law, _, run = simulate("dahl")
    with raises(IdentifiabilityError, "friction.presliding-position", match=r"joint .*position"):
        fit_presliding(build_samples(run, 0, position=position), law)
    with raises(UsageError, "friction.presliding-time"):
        fit_presliding(build_samples(run, 0, time=np.zeros(run.time.size)), law)
    with raises(UsageError, "friction.presliding-options", match="'dahl'"):
        fit_presliding(build_samples(run, 0), law, fixed={"sigma0": 1e4, "fC": 10.0})
    with raises(IdentifiabilityError, "friction.few-rows"):
        fit_presliding(follow(np.array([0.0, 1e-3])), LUGRE)
