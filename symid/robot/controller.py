"""The controller of a robot's joints, as its file states it.

Input: numbers and names, checked by the readers. Output: `Controller`, part of `Robot`.

    tau = o + tau_ff + Kp (q_ref - q) + Kd (dq_ref - v)    or, with velocity "measured", ... - Kd v

v is the joint's velocity as the controller knows it. A cascade with position gain kp (1/s) and velocity gain
kv (N m s/rad) is this controller with Kp = kp kv and Kd = kv: its velocity is "measured" where the velocity
loop has the position loop's output alone as its reference.

Supported: joints with a loop of their own. Not supported: integral parts, loops that are coupled.
"""

from dataclasses import dataclass

__all__ = ["Controller"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Controller:
    """Gains and structure, on the joint side.

    Args:
        stiffness: Kp (n,) N m/rad or N/m; damping: Kd (n,) N m s/rad or N s/m.
        velocity: what the damping acts on, "error" (dq_ref - v) or "measured" (-v).
        velocity_source: of v, "difference" (backward differences of the position) or "sensor" (dq itself).
        velocity_filter: cut-off in Hz of the low-pass of first order that v passes; None for no filter.
        offset: o (n,) N m or N, a constant torque; None where it is taken from the log.
        torque: what the log's torque is, the "command" that holds from its sample to the next, or the
            "average" of the periods before and after its sample, as of a sensor.
    """

    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    velocity: str = "error"
    velocity_source: str = "difference"
    velocity_filter: float | None = None
    offset: tuple[float, ...] | None = None
    torque: str = "command"
