"""Delay and offsets of link encoders, against signals of which both are known in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import LogError
from symid.logs.alignment import align, estimate_alignment, get_encoders, keep_significant, shift_link_channel
from symid.logs.recording import Recording
from tests.refusals import raises

RATE = 500.0
STIFFNESS = np.array([900.0, 300.0])


def move(time, seed):
    """Return a smooth motion and its first two derivatives, (N, 2) each."""
    rng = np.random.default_rng(seed)
    frequency, phase = rng.uniform(0.2, 1.5, (2, 4)), rng.uniform(0.0, 6.0, (2, 4))
    angle = 2.0 * np.pi * frequency * time[:, None, None] + phase
    w = 2.0 * np.pi * frequency
    return (
        0.2 * np.sin(angle).sum(axis=2),
        0.2 * (w * np.cos(angle)).sum(axis=2),
        -0.2 * (w**2 * np.sin(angle)).sum(axis=2),
    )


def record(seed, delay, offset, noise=0.0, side="motor_position"):
    """Return a recording with torsion, friction and rotor, and the torque that bends its joints."""
    time = np.arange(int(20 * RATE)) / RATE
    q, dq, ddq = move(time, seed)
    torque = 4.0 * np.sin(q) + 0.5 * ddq
    theta = q + torque / STIFFNESS
    late, _, _ = move(time - delay, seed)
    link = late - offset + noise * np.random.default_rng(seed).normal(size=q.shape)
    motor = torque + 1.5 * np.sign(dq) + 3.0 * dq + 0.3 * ddq
    pair = {"position": link, "motor_position": theta}
    if side == "link_position":
        pair = {"position": theta, "link_position": link}
    recording = Recording(time=time, torque=motor, source=f"run{seed}", **pair)
    columns = np.stack([torque, np.tanh(dq / 0.02), ddq], axis=2)
    return recording, columns


@pytest.mark.parametrize("delay", [0.003, 0.0, -0.0013])
@pytest.mark.parametrize("side", ["motor_position", "link_position"])
def test_delay_and_offsets_of_two_runs(delay, side):
    offsets = np.array([[1e-3, -2e-3], [2e-3, 0.5e-3]])
    made = [record(seed, delay, offsets[seed], side=side) for seed in range(2)]
    found = estimate_alignment([entry[0] for entry in made], [entry[1] for entry in made])
    assert found.delay == pytest.approx(delay, abs=2e-6)
    np.testing.assert_allclose(found.offsets, offsets, atol=3e-6)
    assert found.sources == ("run0", "run1")
    np.testing.assert_allclose(found.delays, delay, atol=5e-6)


def test_the_deviation_covers_the_error_that_noise_makes():
    errors = []
    for seed in range(6):
        recording, columns = record(seed, 0.002, 0.0, noise=2e-4)
        found = estimate_alignment([recording], [columns])
        errors.append((found.delay - 0.002) / found.delay_std)
    assert np.sqrt(np.mean(np.square(errors))) < 2.0
    assert np.max(np.abs(errors)) > 0.05


def test_what_is_aligned_has_neither_delay_nor_offset():
    recording, columns = record(3, 0.0031, np.array([1e-3, 2e-3]))
    found = estimate_alignment([recording], [columns])
    moved = align(recording, found, run=0)
    truth, _, _ = move(moved.time, 3)
    np.testing.assert_allclose(moved.position, truth, atol=1e-5)
    assert len(moved.time) == len(recording.time) - 2
    (notice,) = moved.notices
    assert notice.code == "log.aligned"
    assert "3.1 ms" in notice.text
    recording, columns = record(3, 0.09, 0.0)
    assert estimate_alignment([recording], [columns]).delay == pytest.approx(0.09, abs=1e-5)


def test_a_joint_without_a_link_encoder_stays_as_it_is():
    recording, columns = record(1, 0.002, 0.0)
    dead = recording.position.copy()
    dead[:, 1] = 0.0
    recording = replace(recording, position=dead, velocity=dead)
    assert get_encoders(recording).present.tolist() == [True, False]
    found = estimate_alignment([recording], [columns])
    assert found.delay == pytest.approx(0.002, abs=2e-6)
    assert np.isnan(found.offsets[0, 1])
    assert not align(recording, found, run=0).position[:, 1].any()


def test_what_may_be_zero_is_left_alone_and_not_spoken_of():
    recording, columns = record(2, 0.0, 0.0, noise=1e-3)
    assert keep_significant(estimate_alignment([recording], [columns])) is None
    recording, columns = record(2, 0.004, 0.0, noise=1e-4)
    kept = keep_significant(estimate_alignment([recording], [columns]))
    assert kept is not None
    assert kept.delay == pytest.approx(0.004, abs=1e-4)
    assert not kept.offsets.any()
    recording, columns = record(2, 0.0, np.array([4e-3, 4e-3]), noise=1e-4)
    kept = keep_significant(estimate_alignment([recording], [columns]))
    moved = align(recording, kept, run=0)
    assert not kept.late
    assert " ms" not in moved.notices[-1].text
    assert "cut off" not in moved.notices[-1].text
    assert "offsets of up to 0.004" in moved.notices[-1].text
    assert len(moved.time) == len(recording.time)
    # Exact signals give a delay of rounding size, sure by its own deviation: it moves nothing either.
    assert not replace(kept, delay=1e-9, delay_std=1e-12).late


def test_what_cannot_be_aligned_is_refused():
    recording, columns = record(0, 0.0, 0.0)
    time = recording.time + 1.0 * (np.arange(len(recording.time)) >= 4000)
    short = {
        name: getattr(recording, name)[:900] for name in ("time", "position", "motor_position", "torque")
    }
    for changes, code, match in (
        ({"motor_position": None}, "log.one-encoder", "one position"),
        (short, "log.short-alignment", None),
        ({"position": np.zeros_like(recording.position)}, "log.no-link-encoder", None),
        ({"time": time}, "log.gap", None),
    ):
        changed = replace(recording, **changes)
        with raises(LogError, code, match=match):
            estimate_alignment([changed], [columns[: len(changed.time)]])


@pytest.mark.parametrize(
    ("delay", "side", "end"), [(0.0031, "later", "end"), (-0.0031, "earlier", "beginning")]
)
def test_what_was_moved_is_said_with_its_direction(delay, side, end):
    recording, columns = record(3, delay, 0.0)
    found = estimate_alignment([recording], [columns])
    assert found.late
    text = align(recording, found, run=0).notices[-1].text
    assert "moved by 3.1 ms" in text
    assert f"are {side} than" in text
    assert f"at the {end} " in text


@pytest.mark.parametrize("delay", [0.11, 0.3, 1.0, -0.11, -0.5])
def test_a_delay_beyond_the_search_is_refused(delay):
    recording, columns = record(3, delay, 0.0)
    with raises(LogError, "log.delay-beyond", match="exceeds 100 ms"):
        estimate_alignment([recording], [columns])


def test_an_offset_that_looks_like_a_constant_torsion_is_left_alone():
    recording, columns = record(1, 0.002, np.array([1e-3, 2e-3]))
    constant = columns.copy()
    constant[:, 1, 0] = 30.0
    constant[:, 1, 2] = columns[:, 1, 0]
    found = estimate_alignment([recording], [constant])
    assert found.unknown.tolist() == [False, True]
    assert found.offsets[0, 0] == pytest.approx(1e-3, abs=3e-6)
    assert np.isnan(found.offsets[0, 1])
    assert np.isnan(found.offset_stds[0, 1])
    assert found.delay == pytest.approx(0.002, abs=2e-5)
    moved = shift_link_channel(recording, replace(found, delay=0.0), run=0)
    np.testing.assert_allclose(
        moved.position - recording.position, [[1e-3, 0.0]] * len(moved.time), atol=3e-6
    )
    other, varying = record(2, 0.002, np.array([1e-3, 2e-3]))
    assert not estimate_alignment([recording, other], [columns, varying]).unknown.any()
