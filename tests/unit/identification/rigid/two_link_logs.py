"""Logs of the two-link arm in closed form: noisy encoders, joints that rest and stick, further friction."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from symid.logs.recording import Recording
from tests.recovery.closed_form import (
    TWO_LINK_TRUTH,
    build_recording,
    build_signals,
    build_two_link,
    find_friction,
    find_rigid,
)

LIBRARY = build_two_link()
NAMES = tuple(entry.name for entry in (*LIBRARY.card.beta, *LIBRARY.card.friction))
SAMPLES, PERIOD = 5001, 4e-3
Friction = Callable[[np.ndarray], np.ndarray]


def record(
    seed: int,
    *,
    encoder: float = 1e-6,
    torque: float = 0.1,
    samples: int = SAMPLES,
    truth: np.ndarray = TWO_LINK_TRUTH,
    friction: Friction | None = None,
) -> Recording:
    """Return a log with noise in rad and N m; `friction` of joint 2 (N,) beside that of the model."""
    options = {"samples": samples, "period": PERIOD, "seed": seed}
    clean = build_recording(LIBRARY, truth, source=f"made {seed}", **options)
    torques = clean.torque.copy()
    if friction is not None:
        torques[:, 1] += friction(build_signals(LIBRARY, truth, **options).dq[:, 1])
    rng = np.random.default_rng(seed)
    return replace(
        clean,
        position=clean.position + encoder * rng.normal(size=torques.shape),
        torque=torques + torque * rng.normal(size=torques.shape),
    )


def record_sticking(seed: int, encoder: float = 1e-5) -> tuple[Recording, np.ndarray]:
    """Return a log with stops, at which dry friction holds what it likes, and whether it rests (N,).

    The motion is q(s(t)) with ds/dt between 0 and 1, so that states are exact.
    """
    time = PERIOD * np.arange(SAMPLES)
    gate = np.clip(1.5 * np.sin(2.0 * np.pi * 0.23 * time + 0.4) + 0.9, 0.0, 1.0)
    pace = gate**2 * (3.0 - 2.0 * gate)
    place = np.concatenate([[0.0], np.cumsum((pace[1:] + pace[:-1]) / 2.0 * PERIOD)])
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.2, 0.5, (5, 2))
    omega = 2.0 * np.pi * np.array([0.1, 0.2, 0.3, 0.5, 0.7])[:, None] * rng.uniform(0.9, 1.1, (5, 2))
    angle = omega * place[:, None, None] + rng.uniform(0.0, 2.0 * np.pi, (5, 2))
    q = np.sum(size * np.sin(angle), axis=1)
    slope = np.sum(size * omega * np.cos(angle), axis=1)
    bend = -np.sum(size * omega**2 * np.sin(angle), axis=1)
    dq, ddq = slope * pace[:, None], bend * pace[:, None] ** 2 + slope * np.gradient(pace, PERIOD)[:, None]
    columns = np.concatenate([find_rigid(LIBRARY, q, dq, ddq), find_friction(dq)[0]], axis=2)
    resting = pace == 0.0
    held = np.sin(2.0 * np.pi * 0.4 * time + 1.0)[:, None] * TWO_LINK_TRUTH[[7, 10]]
    torque = columns @ TWO_LINK_TRUTH + np.where(resting[:, None], held, 0.0)
    log = Recording(
        time=time,
        position=q + encoder * rng.normal(size=q.shape),
        torque=torque + 0.05 * rng.normal(size=q.shape),
        source=f"sticking {seed}",
    )
    return log, resting


def score(values: np.ndarray, time: np.ndarray, band: float) -> tuple[np.ndarray, np.ndarray]:
    """Return values (m,) within a band (Hz) by SciPy's filter, and which of them are far from the ends."""
    sections = butter(4, 2.0 * band * float(np.median(np.diff(time))), output="sos")
    cut = min(0.5, 0.05 * float(np.ptp(time)))
    inner = (time >= time.min() + cut) & (time <= time.max() - cut)
    return sosfiltfilt(sections, values, padtype="odd", padlen=12), inner
