"""Springs found from the gravity that bends them, against arms whose springs are known in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.elastic.stiffness import (
    StiffnessVerdict,
    estimate_stiffness,
    estimate_torsion_alignment,
)
from symid.logs.recording import Recording
from symid.robot.loading import locate_robot_file
from symid.robot.toml_reader import read_robot

STIFFNESS = np.array([5000.0, 1200.0])
BETA = {"ZZR1": 0.35, "MXR1": 0.9, "MY1": 0.0, "ZZ2": 0.06, "MX2": 0.25, "MY2": 0.0}
RATE = 500.0


@pytest.fixture(scope="module")
def arm():
    return read_robot(locate_robot_file("two_link_elastic"))


@pytest.fixture(scope="module")
def library(arm):
    return prepare_library(arm)


def move(time, seed):
    rng = np.random.default_rng(seed)
    w, phase = 2.0 * np.pi * rng.uniform(0.1, 1.2, (2, 4)), rng.uniform(0.0, 6.0, (2, 4))
    angle = w * time[:, None, None] + phase
    sums = (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle))
    return tuple(0.3 * part.sum(axis=2) for part in sums)


def record(library, seed, *, delay=0.0, offset=0.0, noise=0.0, compliance=1.0 / STIFFNESS):
    """Return a run of the arm: springs between rotor and link, friction and inertia before them."""
    time = np.arange(int(20 * RATE)) / RATE
    names = [card.name for card in library.card.beta]
    beta = np.array([BETA[name] for name in names])

    def bend(moment):
        states = tuple(map(np.ascontiguousarray, move(moment, seed)))
        (regressor,) = library.evaluate("torque_regressor", *states)
        return states, regressor @ beta

    (q, _, _), torque = bend(time)
    step = 1e-4
    theta, before, after = (
        states[0] + load * compliance for states, load in map(bend, (time, time - step, time + step))
    )
    speed, acceleration = (after - before) / (2.0 * step), (after - 2.0 * theta + before) / step**2
    drive = torque + np.array([0.25, 0.05]) * acceleration
    drive = drive + np.array([1.5, 0.6]) * np.tanh(speed / 0.01) + np.array([1.0, 0.5]) * speed
    rng = np.random.default_rng(seed)
    late = move(time - delay, seed)[0]
    return Recording(
        time=time,
        position=late - offset + noise * rng.normal(size=q.shape),
        motor_position=theta,
        torque=drive + 0.02 * rng.normal(size=q.shape),
        source=f"run{seed}",
    )


def test_springs_delay_and_offsets_together(library):
    offsets = (np.array([1e-3, -2e-3]), np.array([-5e-4, 1e-3]))
    recordings = [record(library, seed, delay=0.0017, offset=offsets[seed], noise=1e-6) for seed in range(2)]
    found = estimate_stiffness(library, recordings)
    assert found.alignment.delay == pytest.approx(0.0017, abs=2e-5)
    np.testing.assert_allclose(found.alignment.offsets, offsets, atol=1e-4)
    for entry, truth in zip(found.joints, STIFFNESS, strict=True):
        assert entry.verdict is StiffnessVerdict.IDENTIFIED
        assert entry.stiffness == pytest.approx(truth, rel=0.01)
        assert entry.interval[0] < entry.stiffness < entry.interval[1]
        assert entry.explained > entry.left
        assert entry.unit == "N m/rad"
    assert [notice.code for notice in found.notices] == ["log.aligned"] * 2
    alone = estimate_torsion_alignment(library, recordings)
    assert alone.delay == found.alignment.delay


def test_the_interval_holds_the_truth_under_noise(library):
    held = []
    for seed in range(5):
        joints = estimate_stiffness(library, [record(library, seed, noise=5e-5)]).joints
        spans = [entry.interval or (np.inf, -np.inf) for entry in joints]
        held += [low < truth < high for (low, high), truth in zip(spans, STIFFNESS, strict=True)]
    assert sum(held) >= 8
    # Nothing is said to be moved where nothing is.
    found = estimate_stiffness(library, [record(library, 0, noise=2e-4)])
    assert not found.alignment.late
    assert all("ms" not in notice.text for notice in found.notices)


def test_what_runs_do_not_tell_is_refused(library):
    """Torsion below the noise, runs that contradict each other, a joint without a link encoder."""
    found = estimate_stiffness(library, [record(library, 0, noise=3e-2)])
    for entry in found.joints:
        assert (entry.verdict, entry.stiffness, entry.interval) == (StiffnessVerdict.BELOW_NOISE, None, None)
        assert f"{entry.explained:.3g} rad" in entry.reason
        assert f"{entry.left:.3g} rad" in entry.reason
    runs = [record(library, seed, compliance=soft / STIFFNESS) for seed, soft in enumerate((1.0, 0.4))]
    found = estimate_stiffness(library, runs)
    assert {entry.verdict for entry in found.joints} == {StiffnessVerdict.INCONSISTENT}
    position = runs[0].position * np.array([1.0, 0.0])
    found = estimate_stiffness(library, [replace(runs[0], position=position)])
    assert found.joints[1].verdict is StiffnessVerdict.NO_ENCODER
    assert np.isnan(found.joints[1].compliance)


def test_without_gravity_there_is_no_stiffness(arm):
    flat = replace(arm, gravity=tuple(entry - entry for entry in arm.gravity), name="flat_arm")
    library = prepare_library(flat, backend="python")
    names = {card.name for card in library.card.beta}
    assert "MX1" not in names
    time = np.arange(int(20 * RATE)) / RATE
    q, dq, ddq = move(time, 4)
    torque = np.array([0.5, 0.06]) * ddq
    recording = Recording(
        time=time, position=q, motor_position=q + torque / STIFFNESS, torque=torque + dq, source="flat"
    )
    found = estimate_stiffness(library, [recording])
    assert {entry.verdict for entry in found.joints} == {StiffnessVerdict.NO_GRAVITY}
    assert f"{found.joints[0].left:.3g} rad" in found.joints[0].reason


def test_a_large_zero_offset_is_found_as_exactly_as_none(library):
    plain = record(library, 0, noise=1e-6)
    moved = replace(plain, position=plain.position - np.array([0.5, -0.5]))
    small, large = (estimate_torsion_alignment(library, [recording]) for recording in (plain, moved))
    np.testing.assert_allclose(large.offsets - small.offsets, [[0.5, -0.5]], atol=1e-6)
    assert large.delay == pytest.approx(small.delay, abs=1e-7)
    assert not large.unknown.any()
