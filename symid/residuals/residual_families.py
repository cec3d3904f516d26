"""What a residual may follow: families of functions of a joint's motion, and what each of them means.

Input: signals of a log with the torques that a model foretells. Output: columns, advice in words.

Supported: functions of one joint's position, velocity, load, acceleration, of other joints' motion, of time.
Not supported: products of these.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.data.recording import Signals

__all__ = ["FAMILIES", "OTHER_VALUES", "Family", "Motion"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Signals of one log at full rate, with the torque that the model predicts; `joint` is looked at."""

    signals: Signals
    predicted: FloatArray
    joint: int

    @property
    def q(self) -> FloatArray:
        """Return the position of the joint."""
        return self.signals.q[:, self.joint]

    @property
    def dq(self) -> FloatArray:
        """Return the velocity of the joint."""
        return self.signals.dq[:, self.joint]

    @property
    def load(self) -> FloatArray:
        """Return the torque foretold at the joint."""
        return self.predicted[:, self.joint]

    @property
    def others(self) -> list[int]:
        """Return the indices of the other joints."""
        return [k for k in range(self.signals.q.shape[1]) if k != self.joint]


@dataclass(frozen=True, slots=True)
class Family:
    """Functions of a motion, and what it means when they explain a residual."""

    build: Callable[[Motion], list[FloatArray]]
    advice: str


def _find_bumps(motion: Motion) -> list[FloatArray]:
    speed = np.abs(motion.dq)
    top = float(speed.max()) or 1.0
    return [np.sign(motion.dq) * np.exp(-((speed / (part * top)) ** 2)) for part in (0.02, 0.08)]


OTHER_VALUES = "other values"
"""What the model's own columns explain; it has no functions of its own."""
FAMILIES: dict[str, Family] = {
    OTHER_VALUES: Family(
        lambda _: [],
        "the model's own terms would explain it with other values, which other joints or logs contradict: a "
        "term is missing there, a torque is off by a factor, or the robot changed",
    ),
    "position": Family(
        lambda m: [m.q, m.q**2, np.sin(m.q), np.cos(m.q), np.sin(2.0 * m.q), np.cos(2.0 * m.q)],
        "a torque that depends on the joint's position: a spring or counterbalance ([joint.spring]), a "
        "cable, a wrong gravity vector or zero of the angle",
    ),
    "velocity": Family(
        lambda m: [np.abs(m.dq) * m.dq, m.dq**3, np.abs(m.dq), np.sign(m.dq)],
        'friction that is curved or differs with the direction: model = "cubic" or "asymmetric" of '
        "[joint.friction]; --rows friction --model auto compares laws",
    ),
    "slow motion": Family(
        _find_bumps,
        'friction that changes near standstill: model = "stribeck" of [joint.friction], or leave slow rows '
        "out (processing.standstill)",
    ),
    "load": Family(
        lambda m: [np.abs(m.load) * np.sign(m.dq), np.abs(m.load) * m.dq],
        "friction that grows with the load of the gear: no model of [joint.friction] has it; deviations are "
        "larger than stated, and loads beyond those of the log are foretold badly",
    ),
    "scale": Family(
        lambda m: [m.load],
        "torques off by a factor: check the torque constant or gear of this joint against the others",
    ),
    "acceleration": Family(
        lambda m: [m.signals.ddq[:, m.joint]],
        'an inertia that the model lacks: a rotor ([joint.drive] rotor_inertia = "unknown")',
    ),
    "delay": Family(
        lambda m: [np.gradient(m.load, m.signals.period)],
        "torque and motion are not simultaneous: `symid check ROBOT LOG` measures the delay",
    ),
    "other joints": Family(
        lambda m: [x[:, k] for k in m.others for x in (m.signals.dq, np.sign(m.signals.dq), m.signals.ddq)],
        "a drive that turns with other joints too ([[coupling]]), or a torque channel that sees another one",
    ),
    "time": Family(
        lambda m: [m.signals.time - m.signals.time[0], (m.signals.time - m.signals.time[0]) * np.sign(m.dq)],
        "a drift: the robot warms up, or the torque's zero moves; warm it up first, or use shorter logs",
    ),
}
"""By name: functions of a joint's motion that its residual is tried on."""
