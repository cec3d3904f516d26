"""An experiment: a rigid robot under PD control along a trajectory, logged like a real one; and its checks.

Robot, Library with values, ReferenceMotion, ExperimentOptions, random generator -> SimulationRun.

    tau = g(q_d(0)) + Kp (q_d - q_m) + Kd (dq_d - dq_f)    each period, held until the next

with q_m from the encoder and dq_f its low-passed difference; a robot file's controller may say otherwise. The
logged torque at a sample is the mean of the torques before and after the tick, as a sensor averages it. The
checks hold for elastic robots too. Sensors round positions to encoder steps, shift zeros, delay motor
against link encoders (linear between true samples), and add white noise to torques, absolute or relative to
a joint's RMS.

Supported: joint PD, torque limits of the robot file.
Not supported: further feed-forward, motor-side logs, elastic joints (see `elastic_experiment`), collisions;
coloured noise, eccentric encoders, delays that vary.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.codegen import Library
from symid.errors import Notice, SolverError, UsageError
from symid.excitation import ReferenceMotion
from symid.logs import Recording
from symid.robot import Controller, JointKind, Robot
from symid.simulation.rigid_plant import (
    RigidPlant,
    RigidPlantState,
    build_rest_state,
    check_friction_at_speeds,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOptions:
    """The sensors of a rigid robot.

    Args:
        counts_per_turn: of the encoder, per turn of the joint (per metre, if prismatic); None for a perfect
            one.
        torque_noise: standard deviation in N m or N, one for all joints or one for each.
    """

    counts_per_turn: float | None = 2.0**20
    torque_noise: tuple[float, ...] = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticSensors:
    """The sensors of an elastic robot; a tuple holds one number for all joints or one for each.

    Args:
        motor_counts, link_counts: per turn of the joint (per metre, if prismatic); None for perfect encoders.
        motor_offset, link_offset: reading at position zero, rad or m.
        delay: s; a link reading at t shows the link as it was at t - delay. Negative: motor readings are
            late.
        torque_noise: standard deviation, N m or N.
        relative_noise: standard deviation as a share of the RMS of that joint's torque in the run.
    """

    motor_counts: float | None = None
    link_counts: float | None = None
    motor_offset: tuple[float, ...] = (0.0,)
    link_offset: tuple[float, ...] = (0.0,)
    delay: float = 0.0
    torque_noise: tuple[float, ...] = (0.0,)
    relative_noise: tuple[float, ...] = (0.0,)


def check_sensors(sensors: SensorOptions | ElasticSensors, size: int) -> None:
    """Refuse numbers out of range, or not as many as the `size` joints."""
    mistakes = []
    for name, value in asdict(sensors).items():
        if "counts" in name and value is not None and not 0.0 < value < math.inf:
            mistakes.append(("counts", f"{name}: must be positive and finite, got {value:g}"))
        if name == "delay" and not math.isfinite(value):
            mistakes.append(("delay", f"delay: must be finite, got {value:g} s"))
        kind = name.rpartition("_")[2]
        if kind in {"offset", "noise"}:
            low, rule = (-math.inf, "finite") if kind == "offset" else (0.0, "finite and not negative")
            if len(value) not in {1, size} or not all(math.isfinite(one) and one >= low for one in value):
                expected = f"expected one number for all joints or {size} numbers, {rule}"
                mistakes.append((kind, f"{name}: {expected}; got {value}"))
    if mistakes:
        raise UsageError(*(Notice(code=f"usage.sensor-{kind}", text=text) for kind, text in mistakes))


def get_encoder_turns(robot: Robot) -> FloatArray:
    """Return how far (n,) an encoder with one count turns: 2 pi rad, or 1 m of a prismatic joint."""
    return np.array([1.0 if joint.kind is JointKind.PRISMATIC else 2.0 * np.pi for joint in robot.axes])


def quantise(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return `values` (..., n) rounded to whole encoder steps (n,); a step of 0 rounds nothing."""
    safe = np.where(step > 0.0, step, 1.0)
    rounded: FloatArray = np.where(step > 0.0, np.round(values / safe) * safe, values)
    return rounded


def add_torque_noise(
    torque: FloatArray, sensors: SensorOptions | ElasticSensors, rng: np.random.Generator
) -> FloatArray:
    """Return `torque` (N, n) with white noise; absolute and relative noise are independent sources."""
    deviation = np.array(sensors.torque_noise)
    if isinstance(sensors, ElasticSensors):
        rms = np.sqrt((torque**2).mean(axis=0))
        deviation = np.hypot(deviation, np.array(sensors.relative_noise) * rms)
    noisy: FloatArray = torque + deviation * rng.normal(size=torque.shape)
    return noisy


_RUNAWAY = 1e4
"""Rad or m: largest position of a joint without limits."""
_FAR = 10.0
"""Largest position of a joint with limits, relative to them."""
_LARGEST_GAP = 1e-6
"""Of work, change of energy and dissipation, relative to the largest of them."""
_REMEDY = (
    "give links with mass an inertia, or lower the bandwidth or the gains, or shorten the control period"
)


def build_times(
    robot: Robot,
    library: Library,
    trajectory: ReferenceMotion,
    *,
    duration: float | None,
    period: float,
    substeps: int = 1,
    gains: Mapping[str, tuple[float, ...] | None],
) -> FloatArray:
    """Return the control ticks (N,) in s, or raise a UsageError with all sizes and times that do not fit."""
    size = robot.freedom
    problems = []
    if trajectory.size != size or library.card.size != size:
        problems.append(
            f"the robot has {size} joints, the trajectory {trajectory.size}, the library {library.card.size}"
        )
    for name, values in gains.items():
        if values is not None and len(values) != size:
            problems.append(f"{name}: {len(values)} numbers for {size} joints")
    duration = trajectory.duration if duration is None else duration
    finite = np.isfinite(duration) and np.isfinite(period)
    if not (finite and period > 0.0 and substeps >= 1 and duration >= 2.0 * period):
        problems.append(
            f"duration {duration:g} s, period {period:g} s, substeps {substeps}: "
            "the period must be positive, with one substep and two periods at least"
        )
    if problems:
        raise UsageError(*(Notice(code="usage.experiment", text=text) for text in problems))
    return freeze(np.arange(round(duration / period) + 1) * period)


def compute_effective_inertia(mass: FloatArray) -> FloatArray:
    """Return the mean of 1 / (M^-1)_jj (n,) over M (K, n, n): what a joint feels, others free."""
    inertia: FloatArray = np.mean(1.0 / np.diagonal(np.linalg.inv(mass), axis1=1, axis2=2), axis=0)
    return inertia


def get_limits(robot: Robot, name: str) -> FloatArray:
    """Return the limits "torque" or "velocity" (n,) of the joints, SI units, infinite for none."""
    limits = [getattr(joint.limits, name) for joint in robot.axes]
    return np.array([np.inf if limit is None else limit for limit in limits])


def compute_reach(robot: Robot, desired: FloatArray) -> FloatArray:
    """Return the positions (n,) beyond which a joint is out of control; `desired` (N, n), rad or m."""
    bounds = [joint.limits.position for joint in robot.axes]
    reach = np.array([_FAR * max(map(abs, bound)) if bound else _RUNAWAY for bound in bounds])
    furthest: FloatArray = np.maximum(reach, 2.0 * np.abs(desired).max(axis=0))
    return furthest


def check_balance(
    kinetic: FloatArray, potential: FloatArray, work: FloatArray, dissipation: FloatArray
) -> None:
    """Refuse a run that is not finite, or whose energy balance does not close; (N,) J each."""
    energy = kinetic + potential
    change = energy - energy[0]
    gap = float(np.abs(work - change - dissipation).max())
    largest = max(float(np.abs(part).max()) for part in (work, kinetic, change, dissipation))
    # Rounding of the potential is no gap.
    scale = largest + 1e-6 * float(np.abs(potential).max())
    if not np.isfinite(gap + scale):
        text = f"the simulated run has values that are not finite; {_REMEDY}"
        raise SolverError(Notice(code="simulate.not-finite", text=text))
    if gap > _LARGEST_GAP * scale:
        text = (
            f"the energy balance of the run has a relative error of {gap / scale:.2g} (allowed "
            f"{_LARGEST_GAP:g}): the motion is too fast for the integration steps; {_REMEDY}"
        )
        raise SolverError(Notice(code="simulate.energy", text=text))


def describe_saturation(robot: Robot, torque: FloatArray, limit: FloatArray) -> tuple[Notice, ...]:
    """Return a notice for each joint that reached its limit (n,) with `torque` (N, n)."""
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
    """Return the notice on a robot whose mass matrix is singular."""
    text = (
        f"robot {robot.name!r} cannot be simulated: its mass matrix is singular, a joint moves without "
        "inertia; give every moved link a mass with an inertia, or its drive a rotor_inertia"
    )
    return Notice(code="simulate.massless", text=text)


def describe_runaway(tick: int, period: float, bandwidth: float) -> Notice:
    """Return the notice on a robot out of control at a tick; period in s, bandwidth of the gains in Hz."""
    text = (
        f"the controlled robot became unstable at t = {tick * period:g} s; lower the bandwidth "
        f"({bandwidth:g} Hz) or the gains, shorten the control period ({period:g} s), "
        "or give links with mass an inertia"
    )
    return Notice(code="simulate.unstable", text=text)


_GAIN_SAMPLES = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentOptions:
    """How an experiment is run; times in s, frequencies in Hz.

    Args:
        duration: None for the trajectory's own.
        period: of control and log; substeps: of the plant in a period.
        bandwidth: of gains with critical damping at the joint's mean effective inertia.
        velocity_filter: cut-off of the measured velocity.
        stiffness, damping: Kp, Kd of each joint in place of gains by bandwidth.
        sensors: what controller and log read.
        controller: replaces gains and filter; a constant torque that it does not state is the weight at the
            first pose.
    """

    duration: float | None = None
    period: float = 1e-3
    substeps: int = 1
    bandwidth: float = 12.0
    velocity_filter: float = 150.0
    stiffness: tuple[float, ...] | None = None
    damping: tuple[float, ...] | None = None
    sensors: SensorOptions = field(default_factory=SensorOptions)
    controller: Controller | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulationRun(FrozenArrays):
    """A recording and the truth behind it.

    Args:
        recording: the log.
        q, dq: (N, n) true states. desired: (N, n) reference positions. torque: (N, n) held from
            each sample to the next; the last row repeats the one before.
        kinetic, potential, work, dissipation: (N,) J; work and dissipation since the start.
        stored: (N,) J, in bristles of friction.
        events: how often a joint came to rest or turned.
        controller: what the robot was controlled by.
    """

    recording: Recording
    q: FloatArray
    dq: FloatArray
    desired: FloatArray
    torque: FloatArray
    kinetic: FloatArray
    potential: FloatArray
    work: FloatArray
    dissipation: FloatArray
    stored: FloatArray
    events: int
    controller: Controller

    @property
    def energy_gap(self) -> float:
        """Return the largest |work - change of energy - dissipation|, relative to the most work done."""
        energy = self.kinetic + self.potential + self.stored
        gap = np.abs(self.work - (energy - energy[0]) - self.dissipation)
        return float(gap.max() / max(float(np.abs(self.work).max()), np.finfo(np.float64).tiny))


def simulate_experiment(
    robot: Robot,
    library: Library,
    trajectory: ReferenceMotion,
    options: ExperimentOptions,
    rng: np.random.Generator,
) -> SimulationRun:
    """Return the run of `robot` along `trajectory`, from rest at its start.

    Raises:
        UsageError: sizes that do not fit, a value that the robot file does not state, options out of range,
            friction that drives a joint at its speeds, elastic joints.
        SolverError: the controlled robot is unstable or too light, chatters without end, or has friction that
            is too steep.
    """
    names = [joint.name for joint, elastic in zip(robot.axes, robot.elastic, strict=True) if elastic]
    if names:
        text = (
            f"robot {robot.name!r} has elastic joints ({', '.join(names)}); simulate it as an elastic robot"
        )
        raise UsageError(Notice(code="usage.elastic-robot", text=text))
    stated = options.controller or options
    times = build_times(
        robot,
        library,
        trajectory,
        duration=options.duration,
        period=options.period,
        substeps=options.substeps,
        gains={"stiffness": stated.stiffness, "damping": stated.damping},
    )
    plant = RigidPlant(library, speeds=get_limits(robot, "velocity"))
    check_sensors(options.sensors, robot.freedom)
    encoder = get_encoder_turns(robot) / (options.sensors.counts_per_turn or np.inf)
    desired, speeds, _ = trajectory.evaluate(times)
    law = _complete_controller(robot, library, plant, desired, options)
    states, torque = _run_control_loop(robot, plant, law, (desired, speeds), options, encoder=encoder)
    q, dq = np.array([state.q for state in states]), np.array([state.dq for state in states])
    check_friction_at_speeds(plant.friction, library.card.joints, dq)
    kinetic, potential = (part.reshape(-1) for part in library.evaluate("energy", q, dq, plant.beta))
    work = np.array([state.work for state in states])
    dissipation = np.array([state.dissipation for state in states])
    stored = np.array([plant.compute_stored(state) for state in states])
    check_balance(kinetic, potential, work, dissipation + stored)
    # The mean of the torques before and after each tick; nothing was held before the first.
    logged = torque.copy()
    logged[1:] = 0.5 * (torque[1:] + torque[:-1])
    recording = Recording(
        time=times,
        position=quantise(q, encoder),
        torque=add_torque_noise(logged, options.sensors, rng),
        reference=desired,
        reference_velocity=speeds,
        source=f"simulated: {robot.name}, {trajectory.source}",
        notices=describe_saturation(robot, torque, get_limits(robot, "torque")),
    )
    return SimulationRun(
        recording=recording,
        q=q,
        dq=dq,
        desired=desired,
        torque=torque,
        kinetic=kinetic,
        potential=potential,
        work=work,
        dissipation=dissipation,
        stored=stored,
        events=states[-1].events,
        controller=law,
    )


def _run_control_loop(
    robot: Robot,
    plant: RigidPlant,
    law: Controller,
    reference: tuple[FloatArray, FloatArray],
    options: ExperimentOptions,
    *,
    encoder: FloatArray,
) -> tuple[list[RigidPlantState], FloatArray]:
    """Return the states at every tick and the torques held from it (the last one repeats)."""
    desired, speeds = reference
    limit, reach = get_limits(robot, "torque"), compute_reach(robot, desired)
    stiffness, damping, offset = (np.array(part) for part in (law.stiffness, law.damping, law.offset))
    cutoff = law.velocity_filter
    blend = 1.0 if cutoff is None else 1.0 - float(np.exp(-2.0 * np.pi * cutoff * options.period))
    sensed, asked = law.velocity_source == "sensor", float(law.velocity == "error")
    state = build_rest_state(desired[0], plant.memory)
    states, torque = [state], np.zeros_like(desired)
    measured, velocity = quantise(state.q, encoder), np.zeros(plant.size)
    for k in range(len(desired) - 1):
        before, measured = measured, quantise(state.q, encoder)
        raw = state.dq if sensed else (measured - before) / options.period
        velocity = velocity + blend * (raw - velocity)
        demand = offset + stiffness * (desired[k] - measured) + damping * (asked * speeds[k] - velocity)
        torque[k] = np.minimum(np.maximum(demand, -limit), limit)
        state = plant.advance(state, torque[k], options.period, options.substeps)
        states.append(state)
        if not (np.all(np.abs(state.q) < reach) and np.all(np.isfinite(state.dq))):
            raise SolverError(describe_runaway(k, options.period, options.bandwidth))
    torque[-1] = torque[-2]
    return states, torque


def _complete_controller(
    robot: Robot, library: Library, plant: RigidPlant, desired: FloatArray, options: ExperimentOptions
) -> Controller:
    """Return the law with gains Kp = w^2 J, Kd = 2 w J, J the effective inertia, where none are stated."""
    samples = np.linspace(0, len(desired) - 1, _GAIN_SAMPLES).astype(int)
    (mass,) = library.evaluate("mass_matrix", desired[samples], plant.beta)
    try:
        inertia = compute_effective_inertia(mass)
    except np.linalg.LinAlgError as error:
        raise SolverError(describe_massless(robot)) from error
    if not (np.all(np.isfinite(inertia)) and np.all(inertia > 0.0)):
        raise SolverError(describe_massless(robot))
    pole = 2.0 * np.pi * options.bandwidth
    law = options.controller or Controller(
        stiffness=options.stiffness or tuple((pole**2 * inertia).tolist()),
        damping=options.damping or tuple((2.0 * pole * inertia).tolist()),
        velocity_filter=options.velocity_filter,
    )
    weight = plant.compute_weight(desired[0]).tolist()
    return replace(law, offset=tuple(weight) if law.offset is None else law.offset, torque="average")
