"""What the plant of an elastic robot is told, and what it answers: plain arrays for C and NumPy alike.

Output: `PlantRobot` (the robot's numbers), `PlantOrder` (an experiment), `PlantLog` (what happened).

Supported: n joints with m stops and l knees each; what a joint lacks has a weight or slope of zero.
Not supported: anything that changes during an experiment but the references.
"""

from dataclasses import dataclass, fields

import numpy as np

from symid.arrays import FloatArray, freeze

__all__ = ["PlantLog", "PlantOrder", "PlantRobot", "freeze_fields"]


def freeze_fields(record: object) -> None:
    """Make the arrays of a frozen dataclass read-only copies; those that nobody can write to stay."""
    for field in fields(record):  # type: ignore[arg-type]  # a dataclass instance
        value = getattr(record, field.name)
        if isinstance(value, np.ndarray) and not _is_frozen(value):
            object.__setattr__(record, field.name, freeze(value))


def _is_frozen(array: FloatArray) -> bool:
    flags = array.flags
    return flags.owndata and flags.c_contiguous and not flags.writeable and array.dtype == np.float64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantRobot:
    """Numbers of an elastic robot, SI units.

    Args:
        beta: (p,). friction: (pf,). rotor: (n,) kg m^2 or kg.
        stiffness: k0 (n,). cubic: k3 (n,). damping: D (n,).
        radius: r_i (n, m), rad or m. weight: k_i (n, m), N m/rad or N/m.
        knee: R_j (n, l), N m or N, never 0. slope: s_j (n, l).
    """

    beta: FloatArray
    friction: FloatArray
    rotor: FloatArray
    stiffness: FloatArray
    cubic: FloatArray
    damping: FloatArray
    radius: FloatArray
    weight: FloatArray
    knee: FloatArray
    slope: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        freeze_fields(self)

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.rotor)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantOrder:
    """An experiment: what the motors are told at every tick, and where the robot starts, at rest.

        tau = clamp(Kp (angle - theta) + Kd (speed - dtheta) + torque, limit),   held until the next tick

    Args:
        angle, speed, torque: (N, n) references of the motors, joint side.
        stiffness: Kp (n,). damping: Kd (n,). limit: (n,), infinite for none.
        step: (n,) of the encoders in the loop, 0 for perfect ones.
        period: of a tick, s. substeps: Runge-Kutta steps a tick. parts: pieces of a step in which a spring
            bends.
        q, theta: (n,) at the start. play: P_i (n, m) there.
    """

    angle: FloatArray
    speed: FloatArray
    torque: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    limit: FloatArray
    step: FloatArray
    period: float
    substeps: int
    parts: int
    q: FloatArray
    theta: FloatArray
    play: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        freeze_fields(self)

    @property
    def ticks(self) -> int:
        """Return the number of ticks N."""
        return len(self.angle)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantLog:
    """The truth at every tick, (N, n) each; the last four in J since the start.

    Args:
        q, dq, theta, dtheta: link and motor, joint side. spring: tau_J. torque: held from each tick to the
            next; the last one does nothing.
        work: of the motors. friction: lost in it. elastic: int S(v) dphi, stored and lost.
        damped: int D dphi^2 dt.
        ticks: how many are valid; fewer than N where the state was no longer finite.

    The arrays are made read-only in place: whoever makes a log gives them away.
    """

    q: FloatArray
    dq: FloatArray
    theta: FloatArray
    dtheta: FloatArray
    spring: FloatArray
    torque: FloatArray
    work: FloatArray
    friction: FloatArray
    elastic: FloatArray
    damped: FloatArray
    ticks: int

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for field in fields(self):
            if field.name != "ticks":
                getattr(self, field.name).setflags(write=False)
