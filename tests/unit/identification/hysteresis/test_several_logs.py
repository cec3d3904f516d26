"""Springs of joints from several logs, one after the other: each begins with an empty memory."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from symid.identification.hysteresis.families import BoucWenFamily, ElementPath, Stops
from symid.identification.hysteresis.fit import ElementData, choose_spring, predict_output
from symid.joint_models import Elasticity, Stop, run_element

PERIOD = 1e-3
SPRING = Elasticity(
    stiffness=300.0, stops=(Stop(threshold=0.2, stiffness=90.0), Stop(threshold=0.6, stiffness=60.0))
)


def build_path(*positions):
    whole = np.concatenate(positions)
    begins = np.cumsum([0, *map(len, positions)])[:-1]
    return ElementPath(
        position=whole,
        velocity=np.concatenate([np.gradient(part, PERIOD) for part in positions]),
        period=np.full(len(whole), PERIOD),
        begins=tuple(begins.tolist()),
    )


def draw_waves(seed, count=2, length=3000):
    rng = np.random.default_rng(seed)
    time = np.arange(length) * PERIOD

    def draw(frequency):
        return rng.uniform(0.1, 1.0) * np.sin(2.0 * np.pi * frequency * time + rng.uniform(0.0, 6.0))

    return [draw(0.7) + draw(1.9) for _ in range(count)]


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000))
def test_a_path_of_two_logs_is_followed_as_each_by_itself(seed):
    waves = draw_waves(seed)
    path, parts = build_path(*waves), [build_path(wave) for wave in waves]
    for family in (Stops(count=4, ratio=0.7), BoucWenFamily()):
        shape = family.list_starts(path)[0]
        joined = family.compute_columns(path, shape)
        apart = np.concatenate([family.compute_columns(part, shape) for part in parts])
        assert np.array_equal(joined, apart)
    time = np.arange(len(waves[0])) * PERIOD
    torque = np.concatenate([run_element(SPRING, wave, time).output for wave in waves])
    assert predict_output(SPRING, path) == pytest.approx(torque, abs=1e-9)


def test_a_log_that_begins_far_from_the_end_of_another_keeps_its_spring():
    # The second log moves little, so that nothing there erases what the first one would leave.
    large = 0.9 * np.sin(2.0 * np.pi * np.arange(4250) * PERIOD)
    small = 0.1 * np.sin(2.0 * np.pi * 2.0 * np.arange(6000) * PERIOD)
    torque = np.concatenate([run_element(SPRING, part).output for part in (large, small)])
    spring, name, left, before = choose(build_path(large, small), torque)
    assert (spring, name) == (SPRING, "")
    assert left == before < 1e-6


def choose(path, torque, known=SPRING):
    return choose_spring(path, torque, np.ones(len(torque), dtype=bool), known)


def test_stops_with_a_cubic_part_are_found():
    path = build_path(*draw_waves(3, length=20000))
    torque = predict_output(replace(SPRING, cubic=150.0), path)
    spring, name, left, before = choose(path, torque, replace(SPRING, stiffness=420.0))
    assert name.startswith("stops, ")
    assert "cubic" in name
    assert left < 0.5 < before
    assert spring.cubic == pytest.approx(150.0, rel=0.02)


def test_thinning_keeps_beginnings_and_turning_points():
    def thin(path):
        kept = np.ones(len(path.position), dtype=bool)
        return ElementData(path=path, output=path.position.copy(), kept=kept).thin(400, turns=True)

    waves = draw_waves(8, length=20000)
    path = build_path(*waves)
    thinned = thin(path).path
    assert [float(thinned.position[k]) for k in thinned.begins] == [float(wave[0]) for wave in waves]
    for wave in waves:
        inner = wave[1:-1]
        peaks = inner[(inner - wave[:-2]) * (inner - wave[2:]) > 0.0]
        assert len(peaks) > 20
        assert set(peaks.tolist()) <= set(thinned.position.tolist())
    assert np.sum(thinned.period[1:]) == pytest.approx(np.sum(path.period[1:]), rel=1e-2)
    assert len(thinned.position) < 700
    # Noise does not keep every sample.
    noise = np.random.default_rng(1).standard_normal(40000)
    assert len(thin(build_path(draw_waves(8, count=1, length=40000)[0] + 0.02 * noise)).output) < 850


def test_a_spring_of_another_scale_stays_of_its_kind():
    # What stops and knees were fitted to differs by a percent from the torque of the links.
    path = build_path(*draw_waves(3, length=8000))
    assert choose(path, 1.01 * predict_output(SPRING, path) + 2.0)[:2] == (SPRING, "")
