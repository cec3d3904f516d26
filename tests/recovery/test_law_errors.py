"""Friction that a robot file states too simply: its values have deviations that hold.

The torque of a pendulum along a slow motion, in closed form; more friction in slow motion falls off as no law
of `symid` does.
"""

import numpy as np
import pytest

import symid

ROBOT = """
name = "pendulum"
convention = "modified"
gravity = [0, -9.81, 0]
[[joint]]
name = "pivot"
kind = "revolute"
[joint.friction]
model = "coulomb-viscous"
"""
COULOMB, VISCOUS, FALL = 1.1, 0.9, 0.2


def observe(robot, seed, excess):
    """Return a log of 30 s at 250 Hz; friction at rest is `excess` times more than Coulomb's."""
    rng = np.random.default_rng(seed)
    time, waves = np.arange(0.0, 30.0, 0.004), 2.0 * np.pi / 30.0 * rng.integers(2, 20, 6)
    phases, sizes = rng.uniform(0.0, 2.0 * np.pi, 6), rng.uniform(0.3, 1.0, 6) / waves
    q, dq, ddq = (
        np.sum(0.25 * sizes * waves**k * np.sin(time[:, None] * waves + phases + 0.5 * k * np.pi), axis=1)
        for k in range(3)
    )
    dry = np.tanh(dq / 0.005) * COULOMB * (1.0 + excess / np.cosh(dq / FALL))
    torque = 0.3 * ddq + 2.0 * np.cos(q) + dry + VISCOUS * dq + 0.03 * rng.normal(size=len(time))
    angle = q + 3e-6 * rng.normal(size=len(time))
    return symid.build_log(robot, time=time, q=angle[:, None], tau=torque[:, None])


@pytest.mark.parametrize("excess", [0.0, 0.5])
def test_deviations_count_what_slow_rows_say_of_another_law(excess, tmp_path):
    file = tmp_path / "pendulum.toml"
    file.write_text(ROBOT, encoding="utf-8")
    robot, told, scores, widths = symid.load(file), 0, [], []
    for seed in range(6):
        estimate = robot.identify([observe(robot, seed, excess)]).estimate
        told += any(notice.code == "identify.friction-law" for notice in estimate.notices)
        found = {entry.name: entry for entry in estimate.parameters}
        pairs = (found["Fc1"], COULOMB), (found["Fv1"], VISCOUS)
        scores.append([(entry.value - truth) / entry.std for entry, truth in pairs])
        widths.append([entry.std / truth for entry, truth in pairs])
    assert np.abs(scores).max() < 3.0
    # The values are tens of percent off with a law that is too plain, and right within one percent without.
    assert told == (6 if excess else 0)
    wide = np.min(widths, axis=0) if excess else np.max(widths, axis=0)
    assert np.all((wide > 0.05) == bool(excess))
