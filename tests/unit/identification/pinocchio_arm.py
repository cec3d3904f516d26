"""Logs of an arm with three joints whose torques are Pinocchio's, of motions known in closed form."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from symid.logs.recording import Recording
from tests.chains import build_chain, build_pinocchio

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

ROWS = [(0.0, 0.0, 0.0, "q"), (-np.pi / 2, 0.0, 0.0, "q"), (0.0, 0.43, 0.15, "q")]
"""Modified DH: an upright axis, a shoulder, an elbow."""
ARM = build_chain(ROWS, friction="coulomb-viscous-offset", name="arm")
FRICTION = np.array([[1.0, 1.5, 0.2], [1.4, 2.0, -0.3], [0.6, 0.8, 0.1]])
"""Fv, Fc, offset of every joint."""


def build_body(mass, com, inertia):
    """Return the ten parameters of a body about its frame's origin, `inertia` on axes through its com."""
    com = np.array(com)
    tensor = np.diag(inertia) + mass * (com @ com * np.eye(3) - np.outer(com, com))
    return [*tensor[0], *tensor[1, 1:], tensor[2, 2], *(mass * com), mass]


BODIES = np.array(
    [
        build_body(4.0, (0.0, 0.01, 0.05), (0.02, 0.02, 0.015)),
        build_body(6.0, (0.2, 0.01, 0.06), (0.02, 0.12, 0.12)),
        build_body(3.0, (0.15, -0.02, 0.03), (0.01, 0.05, 0.05)),
    ]
)


def draw_motion(seed, seconds=20.0, rate=200.0):
    """Return time (N,), q, dq, ddq (N, 3) of five sines a joint, up to 0.7 Hz."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate) + 1) / rate
    omega = 2.0 * np.pi * np.array([0.1, 0.2, 0.35, 0.5, 0.7])[:, None] * rng.uniform(0.9, 1.1, (5, 3))
    size, phase = rng.uniform(0.15, 0.45, (5, 3)), rng.uniform(0.0, 2.0 * np.pi, (5, 3))
    angle = omega * time[:, None, None] + phase
    q = np.sum(size * np.sin(angle), axis=1)
    dq = np.sum(size * omega * np.cos(angle), axis=1)
    ddq = -np.sum(size * omega**2 * np.sin(angle), axis=1)
    return time, q, dq, ddq


def follow_coulomb(dq):
    """Return the friction torque (N, 3) of velocities (N, 3): viscous, dry, an offset."""
    return FRICTION[:, 0] * dq + FRICTION[:, 1] * np.sign(dq) + FRICTION[:, 2]


def record_arm(
    seed: int,
    *,
    noise: float = 0.1,
    encoder: float = 1e-5,
    seconds: float = 20.0,
    friction: Callable[[np.ndarray], np.ndarray] = follow_coulomb,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
) -> Recording:
    """Return a log with white noise of the torques (N m) and positions (rad), under `gravity` in m/s^2."""
    time, q, dq, ddq = draw_motion(seed, seconds)
    model = build_pinocchio(ARM, BODIES)
    model.gravity.linear = np.array(gravity)
    data = model.createData()
    tau = np.array([pin.rnea(model, data, *state) for state in zip(q, dq, ddq, strict=True)]) + friction(dq)
    rng = np.random.default_rng(seed + 1000)
    return Recording(
        time=time,
        position=q + encoder * rng.normal(size=q.shape),
        torque=tau + noise * rng.normal(size=q.shape),
        source=f"arm {seed}",
    )
