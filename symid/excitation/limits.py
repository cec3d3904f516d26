"""What a motion may do: the limits of a robot, and how a series is kept within them at all times.

Input: a robot, fallbacks for limits that its file does not state. Output: `MotionLimits`; rows of linear
inequalities on a coarse grid that hold everywhere.

A trigonometric polynomial p of degree h sampled at M > 2 h equal steps of its period satisfies

    max_t |p(t)| <= max_i |p(t_i)| / cos(pi h / M)

(Ehlich and Zeller 1964), and max |dp/dt| <= h w max |p| (Bernstein). The first makes limits on the grid hold
between its points; the second finds the limits that can never be reached, whose rows are left out.

Supported: position, velocity, acceleration, jerk. Not supported: limits that depend on the pose; those of
torque, torsion and space are in `loads` and `workspace`.
"""

import math
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.excitation.fourier import SeriesSpace, find_grid
from symid.robot.description import Joint, JointKind, Robot

__all__ = [
    "LimitOptions",
    "LimitRows",
    "MotionLimits",
    "build_limit_rows",
    "find_motion_limits",
    "find_scales",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitOptions:
    """How far the limits are used, and what holds where a robot file states none.

    Args:
        share: of every limit that a motion may use.
        sweep: rad or m either side of zero. speed: rad/s or m/s. acceleration: rad/s^2 or m/s^2.
        jerk: rad/s^3 or m/s^3; None for none.
    """

    share: float = 0.95
    sweep: float = 1.0
    speed: float = 2.0
    acceleration: float = 10.0
    jerk: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionLimits:
    """Limits of all joints, in full; a motion uses `share` of them.

    Args:
        centre, half: (n,) rad or m: positions are within centre +- half.
        velocity, acceleration, jerk: (n,) rad or m, /s, /s^2, /s^3; infinite for none.
        torque: (n,) N m or N; infinite for none.
        assumed: what the robot file does not state, in words.
    """

    centre: FloatArray
    half: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    torque: FloatArray
    share: float
    assumed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("centre", "half", "velocity", "acceleration", "jerk", "torque"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    @property
    def bounds(self) -> FloatArray:
        """Return half, velocity, acceleration, jerk as (4, n)."""
        return np.array([self.half, self.velocity, self.acceleration, self.jerk])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitRows:
    """Linear inequalities -1 <= rows z + constant <= 1, joint by joint.

    Args:
        rows: for each joint (m_j, r). constants: for each joint (m_j,).
    """

    rows: tuple[FloatArray, ...]
    constants: tuple[FloatArray, ...]

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("rows", "constants"):
            object.__setattr__(self, name, tuple(map(freeze, getattr(self, name))))


def find_motion_limits(robot: Robot, options: LimitOptions | None = None) -> MotionLimits:
    """Return the limits of the robot's joints; those that its file does not state are the options'."""
    options = options or LimitOptions()
    assumed: list[str] = []
    ranges = [_find_range(joint, options, assumed) for joint in robot.axes]

    def find(name: str, fallback: float | None, unit: str) -> FloatArray:
        values = [getattr(joint.limits, name) for joint in robot.axes]
        if None in values and fallback is not None:
            which = ", ".join(
                joint.name for joint, value in zip(robot.axes, values, strict=True) if value is None
            )
            assumed.append(f"{name} {fallback:g} {unit} of {which}")
        other = math.inf if fallback is None else fallback
        return np.array([other if value is None else value for value in values])

    return MotionLimits(
        centre=np.array([centre for centre, _ in ranges]),
        half=np.array([half for _, half in ranges]),
        velocity=find("velocity", options.speed, "/s"),
        acceleration=find("acceleration", options.acceleration, "/s^2"),
        jerk=find("jerk", options.jerk, "/s^3"),
        torque=find("torque", None, ""),
        share=options.share,
        assumed=tuple(assumed),
    )


def _find_range(joint: Joint, options: LimitOptions, assumed: list[str]) -> tuple[float, float]:
    """Return centre and half of the positions that a joint may take."""
    if joint.limits.position is None:
        assumed.append(f"position +-{options.sweep:g} of {joint.name}")
        return 0.0, options.sweep
    low, high = joint.limits.position
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    if joint.kind is JointKind.REVOLUTE and half > math.pi:
        # A cable-bound axis may turn several times; an experiment need not.
        assumed.append(f"position +-pi about the middle of {joint.name}")
        half = math.pi
    return centre, half


def find_scales(limits: MotionLimits, harmonics: int, period: float) -> FloatArray:
    """Return the size (n, 2h + 1) in rad or m that centre, sines and cosines of a series may have."""
    speed = 2.0 * np.pi / period * np.arange(1, harmonics + 1)
    bounds = limits.share * limits.bounds[:, :, None] / speed ** np.arange(4)[:, None, None]
    waves = bounds.min(axis=0)
    return np.hstack([limits.share * limits.half[:, None], waves, waves])


def build_limit_rows(space: SeriesSpace, limits: MotionLimits, density: int) -> LimitRows:
    """Return rows under which a series keeps its limits at all times.

    Args:
        space: of the series.
        limits: of the joints.
        density: grid points per harmonic, 3 at least; with 20 of them the limits lose 1.2 % between.
    """
    points = density * space.harmonics
    sure = limits.share * math.cos(math.pi * space.harmonics / points)
    basis = find_grid(space, points, 4)
    fastest = 2.0 * math.pi * space.harmonics / space.period
    rows, constants = [], []
    for joint in range(space.size):
        offset = space.offset[joint].copy()
        offset[0] -= limits.centre[joint]
        kept = _find_active(limits.share * limits.bounds[:, joint], fastest)
        bounds = sure * limits.bounds[kept, joint]
        full = basis[kept] / bounds[:, None, None]
        rows.append((full @ space.maps[joint]).reshape(-1, space.maps.shape[2]))
        constants.append((full @ offset).reshape(-1))
    return LimitRows(rows=tuple(rows), constants=tuple(constants))


def _find_active(bounds: FloatArray, fastest: float) -> list[int]:
    """Return the orders of derivative whose limit does not follow from that of a lower one."""
    kept, reach = [], math.inf
    for order, bound in enumerate(bounds.tolist()):
        if bound < reach:
            kept.append(order)
            reach = bound
        reach *= fastest
    return kept
