"""Recordings of cosine motions of a two-link arm written out by hand, with a friction law on joint 1."""

import numpy as np

from symid.excitation.trajectories import Trajectory
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_friction_torque
from symid.logs.recording import Recording
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import build_two_link

BETA = np.array([1.1, 2.3, 0.2, 0.35, 0.6, -0.1])
STRIBECK = {"fC": 1.8, "fS": 3.0, "vs": 0.05, "fV": 1.1, "offset": 0.25}
PLAIN = {"fC": 1.8, "fV": 1.1, "offset": 0.25}
RATE = 500.0
RAW = Processing(drop_first=20, drop_last=20)
DECIMATED = Processing(drop_first=20, drop_last=20, decimation=Decimation(factor=5))


def record(
    peak,
    *,
    law="stribeck+offset",
    values=None,
    pose=(0.3, 0.4),
    amplitude=0.5,
    periods=2.0,
    noise=0.05,
    seed=0,
):
    """Return the recording of a cosine of the first joint whose velocity reaches `peak`."""
    omega = peak / amplitude
    motion = Trajectory(
        centre=pose,
        amplitude=[[amplitude], [0.0]],
        frequency=[[omega], [omega]],
        phase=np.full((2, 1), 0.5 * np.pi),
        decay=np.zeros(2),
        ramp=1e-9,
        duration=1e-9 + periods * 2.0 * np.pi / omega,
        source="cosine of joint 1",
    )
    time = np.arange(round(motion.duration * RATE)) / RATE
    q, dq, ddq = motion.evaluate(time)
    # The first sample of a trajectory is at rest.
    q, dq, ddq, time = q[1:], dq[1:], ddq[1:], time[1:]
    return load_recording(
        time, q, dq, ddq, law=law, values=values, noise=noise, seed=seed, source=f"peak {peak:g}"
    )


def load_recording(time, q, dq, ddq, *, law, values=None, noise=0.05, seed=0, source="log"):
    """Return a recording of these states; the second joint has no friction and holds what it must."""
    library = build_two_link()
    (rigid,) = library.evaluate("torque_regressor", q, dq, ddq)
    torque = rigid @ BETA
    chosen = get_law(law)
    values = values or (STRIBECK if "stribeck" in law else PLAIN)
    linear, shape = chosen.from_physical([values[entry.name] for entry in chosen.physical])
    torque[:, 0] += compute_friction_torque(chosen, {"velocity": dq[:, 0]}, linear, shape)
    torque += noise * np.random.default_rng(seed).normal(size=torque.shape)
    return Recording(time=time, position=q, torque=torque, source=source)


def find_values(estimate):
    return {entry.name: entry.value for entry in estimate.parameters}


def assert_near_truth(estimate, truth, deviations=4.0):
    for entry in estimate.parameters:
        assert abs(entry.value - truth[entry.name]) < deviations * entry.std, entry
