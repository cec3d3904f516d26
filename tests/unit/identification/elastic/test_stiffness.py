"""Springs, delays and zeros of encoders from the gravity that bends springs known in closed form."""

import re
from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.elastic.stiffness import (
    StiffnessVerdict,
    estimate_stiffness,
    estimate_torsion_alignment,
    prepare_aligned,
)
from symid.joint_models import Elasticity, SlipSpring, Stop, invert_element
from symid.logs.recording import Recording
from symid.robot.loading import locate_robot_file
from symid.robot.toml_reader import read_robot

STIFFNESS = np.array([5000.0, 1200.0])
BETA = {"ZZR1": 0.35, "MXR1": 0.9, "MY1": 0.0, "ZZ2": 0.06, "MX2": 0.25, "MY2": 0.0}
RATE = 500.0


@pytest.fixture(scope="module")
def library():
    return prepare_library(read_robot(locate_robot_file("two_link_elastic")))


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


@pytest.mark.parametrize("offset", [0.0, 8e-4])
@pytest.mark.parametrize(
    ("stiffer", "share", "places"), [(0.35, 0.4, 1.0), (-0.3, 0.3, 0.6), (0.5, 0.25, 1.5)]
)
def test_a_spring_that_is_stiffer_on_one_side_moves_no_zero(library, stiffer, share, places, offset):
    """Its loops are wider on the softer side, which no even function of the torque is."""
    plain, springs = record(library, 3), []
    for stiffness in STIFFNESS:
        widths = places * np.array([0.4e-4, 0.9e-4, 2e-4])
        stops = tuple(Stop(threshold=width, stiffness=share / 3.0 * stiffness) for width in widths)
        ends = (min(stiffer, 0.0), 0.0, max(stiffer, 0.0))
        side = SlipSpring(deflections=(-10.0, 0.0, 10.0), forces=tuple(10.0 * stiffness * np.array(ends)))
        least = 1.0 - share
        springs.append(Elasticity(stiffness=least * stiffness, stops=stops, branches=(side,)))
    load = (plain.motor_position - plain.position) * STIFFNESS
    torsion = [invert_element(spring, own, plain.time) for spring, own in zip(springs, load.T, strict=True)]
    bent = replace(
        plain, motor_position=plain.position + np.column_stack(torsion), position=plain.position - offset
    )
    found = estimate_torsion_alignment(library, [bent])
    wrong = found.offsets[0] - offset
    assert np.all(np.abs(wrong) < 4.0 * found.offset_stds[0])
    assert np.all(np.abs(wrong) < 0.02 * np.ptp(torsion, axis=1))


def test_a_large_zero_offset_is_found_as_exactly_as_none(library):
    plain = record(library, 0, noise=1e-6)
    moved = replace(plain, position=plain.position - np.array([0.5, -0.5]))
    small, large = (estimate_torsion_alignment(library, [recording]) for recording in (plain, moved))
    np.testing.assert_allclose(large.offsets - small.offsets, [[0.5, -0.5]], atol=1e-6)
    assert large.delay == pytest.approx(small.delay, abs=1e-7)
    assert not large.unknown.any()


LIFT = """name = "lift"
convention = "modified"
gravity = [0, 0, -9.81]

[[joint]]
name = "carriage"
kind = "prismatic"

[joint.drive]
rotor_inertia = 0.25
rotor_inertia_side = "joint"

[joint.friction]
model = "coulomb-viscous"

[joint.elasticity]
stiffness = 4000
"""
SPRING, MASS, ROTOR = 4000.0, 2.5, 0.25


@pytest.fixture(scope="module")
def lift(tmp_path_factory):
    path = tmp_path_factory.mktemp("lift") / "lift.toml"
    path.write_text(LIFT, encoding="utf-8")
    return prepare_library(read_robot(path))


def raise_and_lower(gravity, *, offset=0.0, delay=0.0, noise=1e-6):
    """Return a carriage on a spring: force m (ddq + g), friction and rotor before the spring."""
    time = np.arange(10_000) * 2e-3
    w, phase = 2.0 * np.pi * np.array([0.3, 0.8, 1.7]), np.array([0.0, 1.0, 2.0])

    def move(at, order):
        sizes = 0.2 / w * w**order
        return (sizes * np.sin(w * at[:, None] + phase + 0.5 * np.pi * order)).sum(axis=1, keepdims=True)

    force = MASS * (move(time, 2) + gravity)
    theta = move(time, 0) + force / SPRING
    speed = move(time, 1) + MASS * move(time, 3) / SPRING
    acceleration = move(time, 2) + MASS * move(time, 4) / SPRING
    rng = np.random.default_rng(1)
    return Recording(
        time=time,
        position=move(time - delay, 0) - offset + noise * rng.normal(size=theta.shape),
        motor_position=theta,
        torque=force + ROTOR * acceleration + 1.5 * np.tanh(speed / 0.01) + speed,
        source="run",
    )


@pytest.mark.parametrize("offset", [0.0, 0.004])
def test_no_zero_is_invented_where_gravity_never_changes(lift, offset):
    recording = raise_and_lower(9.81, offset=offset, delay=0.003)
    found = estimate_torsion_alignment(lift, [recording])
    assert found.unknown.tolist() == [True]
    assert found.delay == pytest.approx(0.003, abs=2e-5)
    (moved,), kept, told = prepare_aligned(lift, [recording])
    assert {notice.code for notice in told} == {"log.aligned", "log.offset-unknown"}
    assert "'carriage'" in told[-1].text
    assert np.isnan(kept.offsets).all()
    gap = moved.motor_position - moved.position
    assert np.mean(gap) == pytest.approx(MASS * 9.81 / SPRING + offset, abs=1e-4)


def test_a_log_in_line_and_its_stiffness_say_that_gravity_never_changes(lift):
    _, _, told = prepare_aligned(lift, [raise_and_lower(9.81, noise=1e-4)])
    assert [notice.code for notice in told] == ["log.in-line", "log.offset-unknown"]
    # No number of an offset stands there: only the delay and its deviation.
    assert len(re.findall(r"[0-9.]+ ms", told[0].text)) == len(re.findall(r"[0-9.]+", told[0].text)) == 2
    found = estimate_stiffness(lift, [raise_and_lower(9.81)])
    (joint,) = found.joints
    assert joint.verdict is StiffnessVerdict.NO_GRAVITY
    assert joint.left > 0.0
    assert "log.offset-unknown" in {notice.code for notice in found.notices}


def test_files_of_earlier_versions_may_have_the_name_that_it_had():
    assert StiffnessVerdict["VAGUE"] is StiffnessVerdict.UNCERTAIN
    assert [verdict.name for verdict in StiffnessVerdict if "poorly" in verdict.value] == ["UNCERTAIN"]
