"""A test rig for friction with a memory: one mass on bristles, pushed, pulled by a spring, or under control.

Values of Dahl or LuGre, mass, drive -> RigRun: samples of the motion with an energy balance.

    m dv/dt = F - tau_f,   dx/dt = v,   dw/dt of the drive
    dz/dt = v - sigma0 |v| / g(v) z,   g = fC + (fS - fC) exp(-|v / vs|^gamma), of Dahl fC
    tau_f = sigma0 z + sigma1 dz/dt + fV v
    force    F = F(t)
    spring   F = k (V t - x) + c (V - v)
    control  F = kp e + ki w - kd v,   e = target(t) - x,   dw/dt = e

Integrated by LSODA (Hindmarsh and Petzold): bristles make the equations stiff while the mass slips, and soft
while it sticks. Tolerances are relative, and absolute on the scale of the bristles.

Supported: revolute and prismatic axes alike (kg m^2 and rad, or kg and m).
Not supported: several masses; forces that jump faster than the sampling, unless `substep` is set.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import Notice, SolverError


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceDrive:
    """A force given over time (s -> N m or N)."""

    force: Callable[[float], float]

    def evaluate(self, time: float, state: Sequence[float]) -> tuple[float, float]:  # noqa: ARG002
        """Return F(t) and zero."""
        return self.force(time), 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SpringDrive:
    """A spring (N m/rad or N/m) with a damper (N m s/rad or N s/m) whose far end moves at `speed`."""

    stiffness: float
    speed: float
    damping: float = 0.0

    def evaluate(self, time: float, state: Sequence[float]) -> tuple[float, float]:
        """Return k (V t - x) + c (V - v) and zero."""
        position, velocity, *_ = state
        pull = self.stiffness * (self.speed * time - position)
        return pull + self.damping * (self.speed - velocity), 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionControl:
    """A PID controller of the position: gains in N m/rad, N m/(rad s), N m s/rad, or with m for rad.

    `target` gives the desired position over time: s -> rad or m.
    """

    proportional: float
    integral: float
    derivative: float
    target: Callable[[float], float]

    def evaluate(self, time: float, state: Sequence[float]) -> tuple[float, float]:
        """Return kp (target - x) + ki w - kd v and the error of the position."""
        position, velocity, _, memory = state
        error = self.target(time) - position
        return self.proportional * error + self.integral * memory - self.derivative * velocity, error


RigDrive = ForceDrive | SpringDrive | PositionControl
"""What pushes the mass: F, N m or N, and dw/dt at a time in s and a state (x, v, z, w)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """A mass (kg m^2 or kg) on friction; `values` by name: sigma0, fC; fS, vs, gamma; sigma1, fV."""

    values: Mapping[str, float]
    mass: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RigOptions:
    """How a rig is run: duration in s, sampling rate in Hz, start, relative tolerance of the integrator.

    `substep` in s is the longest step of the integrator; None for ten periods.
    """

    duration: float
    rate: float = 1000.0
    position: float = 0.0
    velocity: float = 0.0
    tolerance: float = 1e-9
    substep: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigRun(FrozenArrays):
    """What happened, (N,) each, in SI units; `friction` opposes motion where it is of the velocity's sign.

    Args:
        time, position, velocity, acceleration: of the mass.
        deflection: z of the bristles; force: of the drive; friction: tau_f.
        work: of the drive since the start, J; loss: what friction turned into heat, J;
        energy: kinetic, and elastic in the bristles, J: energy - energy[0] = work - loss.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    deflection: FloatArray
    force: FloatArray
    friction: FloatArray
    work: FloatArray
    loss: FloatArray
    energy: FloatArray


_RUNAWAY = 1e15
"""Largest position and speed, relative to those of the bristles."""


def compute_bristles(values: Mapping[str, float], velocity: float, deflection: float) -> tuple[float, float]:
    """Return dz/dt, rad/s or m/s, and tau_f, N m or N."""
    level = values["fC"]
    if "fS" in values:
        fall = math.exp(-((abs(velocity) / values["vs"]) ** values["gamma"]))
        level += (values["fS"] - level) * fall
    bent = values["sigma0"] * deflection
    rate = velocity - abs(velocity) * bent / level
    return rate, bent + values.get("sigma1", 0.0) * rate + values.get("fV", 0.0) * velocity


def simulate_friction_rig(rig: Rig, drive: RigDrive, options: RigOptions) -> RigRun:
    """Return the motion of the mass from straight bristles; a SolverError if it cannot be integrated."""
    count = math.floor(options.duration * options.rate * (1.0 + 1e-12)) + 1
    time = np.arange(count) / options.rate
    stiffness, coulomb = rig.values["sigma0"], rig.values["fC"]
    largest = max(coulomb, rig.values.get("fS", coulomb))
    bend = largest / stiffness
    speed = bend * math.sqrt(stiffness / rig.mass)
    scales = np.array([bend, speed, bend, bend * options.duration, largest * bend, largest * bend])

    def compute_rates(at: float, state: FloatArray) -> list[float]:
        """Return the rates of (x, v, z, w, work, loss), then the force and the friction."""
        position, velocity, deflection, _ = known = state[:4].tolist()
        # Beyond this the integrator would go on with ever smaller steps.
        if not (abs(velocity) < _RUNAWAY * speed and abs(position) < _RUNAWAY * bend):
            raise OverflowError
        force, memory_rate = drive.evaluate(at, known)
        rate, friction = compute_bristles(rig.values, velocity, deflection)
        loss = friction * velocity - stiffness * deflection * rate
        acceleration = (force - friction) / rig.mass
        return [velocity, acceleration, rate, memory_rate, force * velocity, loss, force, friction]

    with np.errstate(all="ignore"):
        try:
            solved = scipy.integrate.solve_ivp(
                lambda at, state: compute_rates(at, state)[:6],
                (0.0, time[-1]),
                [options.position, options.velocity, 0.0, 0.0, 0.0, 0.0],
                method="LSODA",
                t_eval=time,
                rtol=options.tolerance,
                atol=options.tolerance * scales,
                max_step=options.substep or 10.0 / options.rate,
            )
            reason = "" if solved.success and np.all(np.isfinite(solved.y)) else str(solved.message)
        except OverflowError:
            reason = "the motion grew without bound"
    if reason:
        text = f"the rig could not be simulated: {reason}; lower the gains or the tolerance"
        raise SolverError(Notice(code="simulate.friction-rig", text=text))
    position, velocity, deflection, _, work, loss = solved.y
    found = np.array([compute_rates(at, x) for at, x in zip(time.tolist(), solved.y.T, strict=True)])
    return RigRun(
        time=time,
        position=position,
        velocity=velocity,
        acceleration=found[:, 1],
        deflection=deflection,
        force=found[:, 6],
        friction=found[:, 7],
        work=work,
        loss=loss,
        energy=0.5 * rig.mass * velocity**2 + 0.5 * stiffness * deflection**2,
    )
