"""What no experiment may do: start with sizes that do not fit, run away, or lose energy unseen.

Input: what an experiment is asked for and what it gave. Output: nothing, or an error with a remedy; a notice
where torque limits were reached.

Supported: rigid and elastic robots. Not supported: collisions.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.errors import Notice, SolverError, UsageError
from symid.excitation.motion import Motion
from symid.robot.description import Robot

__all__ = [
    "Timing",
    "check_balance",
    "check_timing",
    "describe_massless",
    "describe_runaway",
    "find_limits",
    "find_reach",
    "find_saturation",
    "find_speeds",
]

_RUNAWAY = 1e4
"""Positions in rad or m beyond this are no motion of a robot."""
_FAR = 10.0
"""Nor are positions beyond so many times the limits of the joint."""
_LARGEST_GAP = 1e-6
"""Of work, change of energy and dissipation, relative to the largest of them."""
_REMEDY = (
    "give links with mass an inertia, or lower the bandwidth or the gains, or shorten the control period"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """What of the options of an experiment can be wrong: times in s, bandwidth in Hz, gains per joint."""

    duration: float
    period: float
    substeps: int
    bandwidth: float
    stiffness: tuple[float, ...] | None
    damping: tuple[float, ...] | None


def check_timing(robot: Robot, library: Library, trajectory: Motion, timing: Timing) -> None:
    """Refuse sizes and times that do not fit.

    Raises:
        UsageError: all that is wrong.
    """
    size = robot.freedom
    problems = []
    if trajectory.size != size or library.card.size != size:
        problems.append(
            f"the robot has {size} joints, the trajectory {trajectory.size}, the library {library.card.size}"
        )
    for name in ("stiffness", "damping"):
        gains: tuple[float, ...] | None = getattr(timing, name)
        if gains is not None and len(gains) != size:
            problems.append(f"{name}: {len(gains)} numbers for {size} joints")
    duration = timing.duration
    finite = np.isfinite(duration) and np.isfinite(timing.period)
    if not (finite and timing.period > 0.0 and timing.substeps >= 1 and duration >= 2.0 * timing.period):
        problems.append(
            f"duration {duration:g} s, period {timing.period:g} s, substeps {timing.substeps}: "
            "the period must be positive, with one substep and two periods at least"
        )
    if problems:
        raise UsageError(*(Notice(code="usage.experiment", text=text) for text in problems))


def find_limits(robot: Robot) -> FloatArray:
    """Return the torque limits (n,) in N m or N, infinite where there are none."""
    limits = [joint.limits.torque for joint in robot.axes]
    return np.array([np.inf if limit is None else limit for limit in limits])


def find_speeds(robot: Robot) -> FloatArray:
    """Return the velocity limits (n,) in rad/s or m/s, infinite where there are none."""
    limits = [joint.limits.velocity for joint in robot.axes]
    return np.array([np.inf if limit is None else limit for limit in limits])


def find_reach(robot: Robot, desired: FloatArray) -> FloatArray:
    """Return the positions (n,) that no joint reaches unless it ran away."""
    bounds = [joint.limits.position for joint in robot.axes]
    reach = np.array([_FAR * max(map(abs, bound)) if bound else _RUNAWAY for bound in bounds])
    furthest: FloatArray = np.maximum(reach, 2.0 * np.abs(desired).max(axis=0))
    return furthest


def check_balance(
    kinetic: FloatArray, potential: FloatArray, work: FloatArray, dissipation: FloatArray
) -> None:
    """Refuse a run that is not finite, or whose energy balance does not close; (N,) J each.

    Raises:
        SolverError: the text says by how much, and what helps.
    """
    energy = kinetic + potential
    change = energy - energy[0]
    gap = float(np.abs(work - change - dissipation).max())
    largest = max(float(np.abs(part).max()) for part in (work, kinetic, change, dissipation))
    # What is lost in rounding of the potential is no gap.
    scale = largest + 1e-6 * float(np.abs(potential).max())
    if not np.isfinite(gap + scale):
        text = f"the simulated run holds values that are not finite; {_REMEDY}"
        raise SolverError(Notice(code="simulate.not-finite", text=text))
    if gap > _LARGEST_GAP * scale:
        text = (
            f"work, energy and dissipation of the run disagree by {gap / scale:.2g} of the largest, "
            f"{_LARGEST_GAP:g} at most are accepted: the motion is too fast for the steps; {_REMEDY}"
        )
        raise SolverError(Notice(code="simulate.energy", text=text))


def find_saturation(robot: Robot, torque: FloatArray, limit: FloatArray) -> tuple[Notice, ...]:
    """Return who was at the limits (n,) with `torque` (N, n), and for how long."""
    share = np.mean(np.abs(torque) >= limit, axis=0)
    return tuple(
        Notice(
            code="simulate.saturation",
            text=f"joint {joint.name!r} was at its torque limit during {100 * part:.1f} % of the run",
        )
        for joint, part in zip(robot.axes, share.tolist(), strict=True)
        if part
    )


def describe_massless(robot: Robot) -> Notice:
    """Return what is said of a robot whose mass matrix is singular."""
    text = (
        f"robot {robot.name!r} cannot be simulated: its mass matrix is singular, so a joint moves without "
        "inertia; give every moved link a mass with an inertia, or its drive a rotor_inertia"
    )
    return Notice(code="simulate.massless", text=text)


def describe_runaway(tick: int, timing: Timing) -> Notice:
    """Return what is said of a robot that ran away at a tick."""
    text = (
        f"the controlled robot ran away at t = {tick * timing.period:g} s: lower the bandwidth "
        f"({timing.bandwidth:g} Hz) or the gains, shorten the control period ({timing.period:g} s), "
        "or give links with mass an inertia"
    )
    return Notice(code="simulate.unstable", text=text)
