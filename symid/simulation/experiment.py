"""An experiment: a robot under PD control along a trajectory, logged like a real one.

Input: robot, library with values, trajectory, options, a random generator.
Output: `SimulationRun`: the recording, and the truth behind it.

    tau = g(q_d(0)) + Kp (q_d - q_m) + Kd (dq_d - dq_f)    each period, held until the next

with q_m from the encoder and dq_f its low-passed difference; a robot file's controller may say otherwise. The
weight at the first pose is carried from the first tick on, so that no run begins with a fall. The logged
torque at a sample is that of a sensor that averages over the period around it: the mean of the torques before
and after the tick, so that it belongs to the same instant as the position. The log has the reference too.

Supported: joint PD, torque limits of the robot file. A run whose energy balance does not close, or that
leaves ten times the position limits, is an error and never a log.
Not supported: further feed-forward, motor-side logs, elastic joints (see `elastic_experiment`).
"""

from dataclasses import dataclass, field, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import Notice, SolverError, UsageError
from symid.excitation.motion import Motion
from symid.robot.controller import Controller
from symid.robot.description import Robot
from symid.simulation.guards import (
    Timing,
    check_balance,
    check_timing,
    describe_massless,
    describe_runaway,
    find_limits,
    find_reach,
    find_saturation,
    find_speeds,
)
from symid.simulation.plant import Plant, PlantState, start_state
from symid.simulation.sensors import SensorOptions, Sensors, add_torque_noise, build_sensors, quantise

__all__ = ["ExperimentOptions", "SimulationRun", "simulate_experiment"]

_GAIN_SAMPLES = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentOptions:
    """How an experiment is run; times in s, frequencies in Hz.

    `duration` None for the trajectory's own; `stiffness` (Kp) and `damping` (Kd) per joint, None for
    gains that give `bandwidth` with critical damping at the joint's mean effective inertia.
    `controller`, where there is one, takes the place of these gains and of `velocity_filter`; a constant
    torque that it does not state is the weight at the first pose.
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
class SimulationRun:
    """A recording and the truth behind it.

    Args:
        recording: what a log of this run holds.
        q, dq: (N, n) true states. desired: (N, n) reference positions. torque: (N, n) held from
            each sample to the next; the last row repeats the one before.
        kinetic, potential, work, dissipation: (N,) J; work and dissipation since the start.
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
    events: int
    controller: Controller

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("q", "dq", "desired", "torque", "kinetic", "potential", "work", "dissipation"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    @property
    def energy_gap(self) -> float:
        """Return the largest |work - change of energy - dissipation|, relative to the most work done."""
        energy = self.kinetic + self.potential
        gap = np.abs(self.work - (energy - energy[0]) - self.dissipation)
        return float(gap.max() / max(float(np.abs(self.work).max()), np.finfo(np.float64).tiny))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Control:
    """Gains (n,), constant torque (n,), pole of the velocity filter, limits (n,), positions run away (n,)."""

    law: Controller
    stiffness: FloatArray
    damping: FloatArray
    weight: FloatArray
    blend: float
    limit: FloatArray
    reach: FloatArray


def simulate_experiment(
    robot: Robot,
    library: Library,
    trajectory: Motion,
    options: ExperimentOptions,
    rng: np.random.Generator,
) -> SimulationRun:
    """Return the run of `robot` along `trajectory`, from rest at its start.

    Raises:
        UsageError: sizes that do not fit, a value that the robot file does not state, options out of range,
            friction that drives a joint at its speeds.
        SolverError: the controlled robot is unstable or too light, chatters without end, or has friction that
            is too steep.
    """
    timing = _find_timing(trajectory, options)
    _refuse_elastic(robot)
    check_timing(robot, library, trajectory, timing)
    plant = Plant(library, speeds=find_speeds(robot))
    sensors = build_sensors(robot, options.sensors)
    times = freeze(np.arange(round(timing.duration / options.period) + 1) * options.period)
    desired, speeds, _ = trajectory.evaluate(times)
    control = _build_control(robot, library, plant, desired, options)
    states, torque = _run(plant, sensors, control, (desired, speeds), timing)
    q, dq = np.array([state.q for state in states]), np.array([state.dq for state in states])
    plant.check_friction(dq)
    kinetic, potential = library.evaluate("energy", q, dq, plant.beta)
    work = np.array([state.work for state in states])
    dissipation = np.array([state.dissipation for state in states])
    check_balance(kinetic.reshape(-1), potential.reshape(-1), work, dissipation)
    # The mean of the torques before and after each tick; nothing was held before the first.
    logged = torque.copy()
    logged[1:] = 0.5 * (torque[1:] + torque[:-1])
    return SimulationRun(
        recording=Recording(
            time=times,
            position=quantise(q, sensors.step),
            torque=add_torque_noise(logged, sensors, rng),
            reference=desired,
            reference_velocity=speeds,
            source=f"simulated: {robot.name}, {trajectory.source}",
            notices=find_saturation(robot, torque, control.limit),
        ),
        q=q,
        dq=dq,
        desired=desired,
        torque=torque,
        kinetic=kinetic.reshape(-1),
        potential=potential.reshape(-1),
        work=work,
        dissipation=dissipation,
        events=states[-1].events,
        controller=control.law,
    )


def _run(
    plant: Plant,
    sensors: Sensors,
    control: _Control,
    reference: tuple[FloatArray, FloatArray],
    timing: Timing,
) -> tuple[list[PlantState], FloatArray]:
    """Return the states at every tick and the torques held from it (the last one repeats)."""
    desired, speeds = reference
    state = start_state(desired[0])
    states, torque = [state], np.zeros_like(desired)
    measured = quantise(state.q, sensors.step)
    velocity = np.zeros(plant.size)
    sensed = control.law.velocity_source == "sensor"
    asked = float(control.law.velocity == "error")
    for k in range(len(desired) - 1):
        before, measured = measured, quantise(state.q, sensors.step)
        raw = state.dq if sensed else (measured - before) / timing.period
        velocity = velocity + control.blend * (raw - velocity)
        error, slip = desired[k] - measured, asked * speeds[k] - velocity
        demand = control.weight + control.stiffness * error + control.damping * slip
        torque[k] = np.minimum(np.maximum(demand, -control.limit), control.limit)
        state = plant.advance(state, torque[k], timing.period, timing.substeps)
        states.append(state)
        if not (np.all(np.abs(state.q) < control.reach) and np.all(np.isfinite(state.dq))):
            raise SolverError(describe_runaway(k, timing))
    torque[-1] = torque[-2]
    return states, torque


def _build_control(
    robot: Robot, library: Library, plant: Plant, desired: FloatArray, options: ExperimentOptions
) -> _Control:
    """Return gains: Kp = w^2 J, Kd = 2 w J with J the mean of 1 / (M^-1)_jj along the trajectory.

    J is what a joint feels while the others are free, never more than M_jj; with it no mode of
    the coupled robot is faster than w sqrt(n).
    """
    samples = np.linspace(0, len(desired) - 1, _GAIN_SAMPLES).astype(int)
    (mass,) = library.evaluate("mass_matrix", desired[samples], plant.beta)
    try:
        inertia = np.mean(1.0 / np.diagonal(np.linalg.inv(mass), axis1=1, axis2=2), axis=0)
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
    cutoff = law.velocity_filter
    weight = plant.find_weight(desired[0]) if law.offset is None else np.array(law.offset)
    return _Control(
        law=replace(law, offset=tuple(weight.tolist()), torque="average"),
        stiffness=np.array(law.stiffness),
        damping=np.array(law.damping),
        blend=1.0 if cutoff is None else 1.0 - float(np.exp(-2.0 * np.pi * cutoff * options.period)),
        weight=weight,
        limit=find_limits(robot),
        reach=find_reach(robot, desired),
    )


def _find_timing(trajectory: Motion, options: ExperimentOptions) -> Timing:
    return Timing(
        duration=trajectory.duration if options.duration is None else options.duration,
        period=options.period,
        substeps=options.substeps,
        bandwidth=options.bandwidth,
        stiffness=options.controller.stiffness if options.controller else options.stiffness,
        damping=options.controller.damping if options.controller else options.damping,
    )


def _refuse_elastic(robot: Robot) -> None:
    names = [joint.name for joint, gives in zip(robot.axes, robot.elastic, strict=True) if gives]
    if names:
        text = (
            f"robot {robot.name!r} gives between motor and link ({', '.join(names)}); "
            "simulate it as an elastic robot"
        )
        raise UsageError(Notice(code="usage.elastic-robot", text=text))
