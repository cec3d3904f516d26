"""Rows of motors near rest: left out where friction there is another, and only there."""

from types import SimpleNamespace

import numpy as np
import pytest

from symid.identification.elastic.elimination import _SHARES, BandRows, choose_sliding_rows

CARD = SimpleNamespace(beta=("a", "v", "s", "g"), size=0, friction=())
TRUTH = np.array([2.0, 1.0, 0.5, 3.0])
COUNT = 400


def build_rows(levels, seed, stick=0.0):
    """Rows of a joint in recordings of these RMS speeds, tau = 2 ddq + dq + 0.5 sign dq + 3 sin q + noise."""
    rng = np.random.default_rng(seed)
    designs, speeds, torques = [], [], []
    for level in levels:
        phase = np.linspace(0.0, 40.0 * np.pi, COUNT)
        speed = level * np.sqrt(2.0) * np.cos(phase + rng.uniform(0.0, 6.0))
        place, bend = np.sin(1.0 + 0.1 * np.cumsum(speed)), -3.0 * level * np.sqrt(2.0) * np.sin(phase)
        designs.append(np.column_stack([bend, speed, np.sign(speed), place]))
        rest = stick * np.sign(speed) * np.exp(-((speed / 0.2) ** 2))
        torques.append(designs[-1] @ TRUTH + rest + 0.1 * rng.standard_normal(COUNT))
        speeds.append(speed)
    speed = np.concatenate(speeds)
    rms = np.sqrt(np.mean(speed**2))
    return BandRows(
        design=np.concatenate(designs),
        torque=np.concatenate(torques),
        group=np.repeat(np.arange(len(levels)), COUNT),
        time=np.zeros(len(speed)),
        slide=sum((np.abs(speed) > share * rms).astype(np.intp) for share in _SHARES),
    )


@pytest.mark.parametrize("levels", [(1.0,), (1.0, 1.0), (0.3, 1.0), (1.0, 0.3), (0.1, 1.0), (0.3, 1.0, 1.0)])
def test_rows_of_a_slow_recording_stay_where_friction_is_that_of_the_file(levels):
    shares = [choose_sliding_rows(CARD, build_rows(levels, seed))[1] for seed in range(12)]
    # One in a hundred comparisons may fail by chance.
    assert sorted(shares)[-2] == 0.0, shares


@pytest.mark.parametrize("levels", [(1.0,), (0.5, 1.0), (1.0, 0.5)])
def test_rows_near_rest_go_where_friction_there_is_another(levels):
    rows, share = choose_sliding_rows(CARD, build_rows(levels, 3, stick=1.0))
    assert 0.1 <= share <= 0.4
    assert rows.slide.min() == 1 + _SHARES.index(share)
