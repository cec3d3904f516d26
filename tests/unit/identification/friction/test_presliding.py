"""Friction with a memory: what a motion does not show gets no number."""

import numpy as np
import pytest

from symid.errors import IdentifiabilityError
from symid.identification.friction.joint_fit import FrictionSamples
from symid.identification.friction.presliding import fit_presliding
from symid.joint_models.dynamic_friction import FrictionPath, get_dynamic_law, simulate_dynamic_friction

LUGRE = (1e4, 100.0, 10.0, 15.0, 0.01, 2.0, 25.0)
PERIOD = 1e-3
TIME = PERIOD * np.arange(3000)


def draw(position, values=LUGRE, noise=0.1):
    count = len(position)
    velocity = np.gradient(position, PERIOD)
    held = np.diff(position, prepend=position[:1]) / PERIOD
    period, start = np.full(count, PERIOD), np.zeros(count)
    period[0], start[0] = 0.0, 1.0
    path = FrictionPath(held=held, velocity=velocity, period=period, start=start)
    torque = simulate_dynamic_friction(get_dynamic_law("lugre"), values, path).torque
    torque = torque + noise * np.random.default_rng(0).standard_normal(count)
    return FrictionSamples(
        joint="1",
        time=PERIOD * np.arange(count),
        velocity=velocity,
        torque=torque,
        position=position,
        extra=np.zeros((count, 0)),
    )


@pytest.mark.parametrize(
    "position",
    [0.2 * TIME, 1e-7 * np.sin(6.0 * TIME), np.where(TIME > 2.5, 1e-2 * (TIME - 2.5), 0.0)],
    ids=["one speed", "less than noise", "rest, then one speed"],
)
def test_a_motion_that_shows_no_damping_gives_none(position):
    estimate = fit_presliding(draw(position), get_dynamic_law("lugre"))
    assert estimate.get_value("sigma1") is None
    assert estimate.get_value("fV") is None
    assert {"sigma1", "fV"} <= dict(estimate.refused).keys()


def test_a_damping_of_zero_that_the_motion_shows_is_told():
    values = (1e4, 0.0, 10.0, 15.0, 0.01, 2.0, 25.0)
    wide = 2e-3 * np.sin(2.0 * np.pi * TIME) + 0.02 * np.sin(np.pi * TIME) * (TIME > 1.5)
    estimate = fit_presliding(draw(wide, values), get_dynamic_law("lugre"))
    told = {entry.name: entry for entry in estimate.parameters}
    assert told["sigma1"].value == pytest.approx(0.0, abs=5.0)
    assert told["sigma1"].std < 5.0
    assert told["fV"].value == pytest.approx(25.0, abs=1.0)


def test_there_must_be_more_rows_than_unknowns():
    with pytest.raises(IdentifiabilityError) as caught:
        fit_presliding(draw(np.array([0.0, 1e-3])), get_dynamic_law("lugre"))
    assert caught.value.notices[0].code == "friction.few-rows"
