"""An experiment with an elastic robot: motors under PD control along a trajectory, logged like a real one.

Input: robot, library with values, trajectory, options, a random generator.
Output: `ElasticRun`: the recording, and the truth behind it.

    tau = Kp (theta_d - theta_m) + Kd (dtheta_d - dtheta) + tau_d    each period, held until the next

with theta_m from the motor encoder and dtheta the true motor speed: a drive has its own observer, which sees
more than the log. By default theta_d = q_d + phi_0 and tau_d = g(q_d(0)), phi_0 being the torsion under the
robot's weight at the first pose: the robot starts at rest and nothing jumps. The logged torque holds from
the sample on.

Supported: torque limits of the robot file, references of one's own (feed-forward), values of one's own.
Not supported: control on link encoders, joints without elasticity beside elastic ones.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.library import Library
from symid.codegen.plant_orders import PlantLog, PlantOrder, PlantRobot
from symid.data.recording import Recording
from symid.errors import Notice, SolverError, UsageError
from symid.excitation.motion import Motion
from symid.robot.description import Robot
from symid.simulation.elastic_options import ElasticExperimentOptions, MotorReference
from symid.simulation.elastic_plant import PlantRun, find_substeps, simulate_plant
from symid.simulation.elastic_run import ElasticRun, observe
from symid.simulation.elastic_sensors import check_sensors, find_turns
from symid.simulation.elastic_values import ElasticValues, build_plant_robot, find_elastic_values
from symid.simulation.friction import check_speeds, find_curves
from symid.simulation.gains import SHIPPED_GAINS, Gains, find_gains
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
from symid.simulation.rest import Rest, find_rest

__all__ = ["simulate_elastic"]

_POSES = 50


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Task:
    """An experiment, everything known before it is run."""

    robot: Robot
    library: Library
    values: ElasticValues
    plant: PlantRobot
    timing: Timing
    time: FloatArray
    desired: FloatArray
    speed: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Hold:
    """At rest at the first pose: `weight` of the links (n,), `torque` of the motors (n,), N m or N."""

    weight: FloatArray
    torque: FloatArray


def simulate_elastic(
    robot: Robot,
    library: Library,
    trajectory: Motion,
    options: ElasticExperimentOptions,
    rng: np.random.Generator,
    *,
    values: ElasticValues | None = None,
    reference: MotorReference | None = None,
) -> ElasticRun:
    """Return the run of an elastic robot along `trajectory`, from rest at its start.

    Args:
        robot: names, limits.
        library: functions of its links.
        trajectory: of the links.
        options: how it is run.
        rng: of the torque noise.
        values: the truth; None for the robot file's.
        reference: what motors are told at the ticks; None for the trajectory, shifted by the first torsion.

    Raises:
        UsageError: sizes that do not fit, a value that the robot file does not state, options out of range.
        SolverError: the controlled robot is unstable, or its springs do not carry it.
    """
    task = _prepare(robot, library, trajectory, options, values)
    # Values that are tried, and not a robot's own, may push.
    curves = None if values else find_curves(library, find_speeds(robot))
    hold = _find_hold(task)
    rest = find_rest(task.plant, hold.weight, tuple(joint.name for joint in robot.axes))
    told = reference or _find_reference(task, hold, rest)
    order = _build_order(task, options, told, rest)
    ran = simulate_plant(library, task.plant, order)
    _check_motion(task, ran.log)
    if curves:
        check_speeds(curves, library.card.joints, ran.log.dtheta)
    notices = (*ran.notices, *find_saturation(robot, ran.log.torque, order.limit))
    run = _build_run(task, ran, notices, f"simulated: {robot.name}, {trajectory.source}")
    losses = (run.friction + run.spring).sum(axis=1)
    check_balance(run.kinetic + run.spin, run.potential, run.work.sum(axis=1), losses)
    return replace(run, recording=observe(run, options.sensors, rng))


def _prepare(
    robot: Robot,
    library: Library,
    trajectory: Motion,
    options: ElasticExperimentOptions,
    values: ElasticValues | None,
) -> _Task:
    stated = values or find_elastic_values(robot, library.card)
    shipped = SHIPPED_GAINS.get(robot.name)
    # A robot of one's own may have the name of a shipped one.
    own = shipped if shipped and len(shipped.damping) == robot.freedom else None
    gains = options.gains or own
    timing = Timing(
        duration=trajectory.duration if options.duration is None else options.duration,
        period=options.period,
        substeps=1,
        bandwidth=options.bandwidth,
        stiffness=gains.stiffness if gains else None,
        damping=gains.damping if gains else None,
    )
    check_timing(robot, library, trajectory, timing)
    check_sensors(options.sensors, robot.freedom)
    if not (options.step > 0.0 and options.parts >= 1 and (options.control_counts or 1.0) > 0.0):
        text = (
            f"step {options.step:g} s, parts {options.parts}, control counts {options.control_counts}: "
            "the step and the counts must be positive, with one part at least"
        )
        raise UsageError(Notice(code="usage.experiment", text=text))
    time = freeze(np.arange(round(timing.duration / timing.period) + 1) * timing.period)
    desired, speed = trajectory.evaluate_derivatives(time, 1)
    return _Task(
        robot=robot,
        library=library,
        values=stated,
        plant=build_plant_robot(stated),
        timing=timing,
        time=time,
        desired=freeze(desired),
        speed=speed,
    )


def _find_hold(task: _Task) -> _Hold:
    pose, values = task.desired[:1], task.values
    weight = task.library.evaluate("gravity", pose, values.beta)[0][0]
    drag = np.zeros_like(weight)
    if values.friction.size:
        drag = task.library.evaluate("friction", np.zeros_like(pose), values.friction)[0][0]
    return _Hold(weight=weight, torque=weight + drag)


def _find_reference(task: _Task, hold: _Hold, rest: Rest) -> MotorReference:
    """Return the trajectory as motors see it: ahead by the first torsion, carrying the weight."""
    torque = np.broadcast_to(hold.torque, task.desired.shape)
    return MotorReference(angle=task.desired + rest.phi, speed=task.speed, torque=torque)


def _build_order(
    task: _Task, options: ElasticExperimentOptions, told: MotorReference, rest: Rest
) -> PlantOrder:
    for name in ("angle", "speed", "torque"):
        if getattr(told, name).shape != task.desired.shape:
            text = (
                f"reference {name}: expected the shape {task.desired.shape}, got {getattr(told, name).shape}"
            )
            raise UsageError(Notice(code="usage.experiment", text=text))
    timing, start = task.timing, task.desired[0]
    poses = task.desired[np.linspace(0, len(task.desired) - 1, _POSES).astype(int)]
    gains = _choose_gains(task, poses)
    return PlantOrder(
        angle=told.angle,
        speed=told.speed,
        torque=told.torque,
        stiffness=np.array(gains.stiffness),
        damping=np.array(gains.damping),
        limit=find_limits(task.robot),
        step=find_turns(task.robot) / (options.control_counts or np.inf),
        period=timing.period,
        substeps=find_substeps(task.library, task.values, poses, period=timing.period, step=options.step),
        parts=options.parts,
        q=start,
        theta=start + rest.phi,
        play=rest.play,
    )


def _choose_gains(task: _Task, poses: FloatArray) -> Gains:
    """Return the gains asked for, or those by bandwidth; refuse links that move without inertia."""
    timing = task.timing
    (mass,) = task.library.evaluate("mass_matrix", poses, task.values.beta)
    if not np.all(np.linalg.eigvalsh(mass) > 0.0):
        raise SolverError(describe_massless(task.robot))
    if timing.stiffness is not None and timing.damping is not None:
        return Gains(stiffness=timing.stiffness, damping=timing.damping)
    return find_gains(mass, task.values.rotor, timing.bandwidth, timing.period)


def _check_motion(task: _Task, log: PlantLog) -> None:
    """Refuse a robot that ran away.

    Raises:
        SolverError: the text says when, and what helps.
    """
    reach = find_reach(task.robot, task.desired)
    far = np.any((np.abs(log.q) >= reach) | (np.abs(log.theta) >= reach), axis=1)
    gone = np.flatnonzero(far[: log.ticks])
    if gone.size or log.ticks < len(log.q):
        tick = int(gone[0]) if gone.size else log.ticks
        raise SolverError(describe_runaway(tick, task.timing))


def _build_run(task: _Task, ran: PlantRun, notices: tuple[Notice, ...], source: str) -> ElasticRun:
    log, values = ran.log, task.values
    kinetic, potential = task.library.evaluate("energy", log.q, log.dq, values.beta)
    return ElasticRun(
        recording=Recording(
            time=task.time, position=log.q, motor_position=log.theta, torque=log.torque, source=source
        ),
        time=task.time,
        q=log.q,
        dq=log.dq,
        theta=log.theta,
        dtheta=log.dtheta,
        desired=task.desired,
        torque=log.torque,
        joint_torque=log.spring,
        kinetic=kinetic.reshape(-1),
        potential=potential.reshape(-1),
        spin=0.5 * (values.rotor * log.dtheta**2).sum(axis=1),
        work=log.work,
        friction=log.friction,
        spring=log.elastic + log.damped,
        turn=find_turns(task.robot),
        values=values,
        backend=ran.backend,
        notices=notices,
    )
