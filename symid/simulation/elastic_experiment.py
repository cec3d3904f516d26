"""An experiment with an elastic robot: motors under PD control along a trajectory, logged like a real one.

Robot, Library with values, ReferenceMotion, ElasticExperimentOptions, random generator -> ElasticRun: the
recording, the truth behind it, its energies; `observe` gives other logs of the same truth, with other
sensors or other noise.

    tau = Kp (theta_d - theta_m) + Kd (dtheta_d - dtheta) + tau_d    each period, held until the next

with theta_m from the motor encoder and dtheta the true motor speed: a drive has its own observer, which
sees more than the log. By default theta_d = q_d + phi_0 and tau_d = g(q_d(0)), phi_0 being the torsion
under the robot's weight at the first pose: the robot starts at rest and nothing jumps. The logged torque
holds from the sample on. Gains by bandwidth:

    J = mean of 1 / ((M + B)^-1)_jj,   Kd = 2 w J, at most a share of B / T,   Kp = Kd^2 / (4 J)

A torque that is held for T damps a motor of inertia B only while Kd T / B < 2; springs leave the motor
alone with it at high frequency. Kp follows Kd, so that the loop stays critically damped. Energy balance
of a run:

    sum int tau_i dtheta_i = change of (T + V + 1/2 sum B_i dtheta_i^2) + sum int F_i dtheta_i + tau_Ji dphi_i

Supported: clean and noisy experiments ready made; torque limits of the robot file; gains, sensors,
references (feed-forward) and values of one's own; link and motor encoders, motor torque.
Not supported: control on link encoders, joints without elasticity beside elastic ones, logs without link
encoders, options that change during a run.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.codegen import Library, PlantExperiment, PlantLog, PlantRobot
from symid.errors import Notice, SolverError, UsageError
from symid.excitation import ReferenceMotion
from symid.logs import Recording
from symid.robot import Robot
from symid.simulation.elastic_plant import (
    ElasticValues,
    PlantRun,
    RestState,
    build_plant_robot,
    compute_rest,
    count_substeps,
    get_elastic_values,
    simulate_plant,
)
from symid.simulation.experiment import (
    build_times,
    check_balance,
    compute_effective_inertia,
    compute_reach,
    describe_massless,
    describe_runaway,
    describe_saturation,
    get_torque_limits,
    get_velocity_limits,
)
from symid.simulation.rigid_plant import build_curved_friction, check_friction_at_speeds
from symid.simulation.sensors import (
    ElasticSensors,
    add_motor_noise,
    check_elastic_sensors,
    compute_readings,
    get_encoder_turns,
)

_DAMPING_SHARE = 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorGains:
    """Kp `stiffness` (N m/rad or N/m) and Kd `damping` (N m s/rad or N s/m) of each joint."""

    stiffness: tuple[float, ...]
    damping: tuple[float, ...]


SHIPPED_GAINS: Mapping[str, MotorGains] = MappingProxyType(
    {"two_link_elastic": MotorGains(stiffness=(4000.0, 1500.0), damping=(120.0, 40.0))}
)
"""Gains that go with the values of a shipped robot; by the name of the robot."""


def compute_gains(mass: FloatArray, rotor: FloatArray, bandwidth: float, period: float) -> MotorGains:
    """Return gains with which every joint is critically damped.

    Args:
        mass: (K, n, n) kg m^2, at poses along the way.
        rotor: (n,) kg m^2.
        bandwidth: Hz.
        period: of the control loop, s.
    """
    inertia = compute_effective_inertia(mass + np.diag(rotor))
    damping = np.minimum(4.0 * np.pi * bandwidth * inertia, _DAMPING_SHARE * rotor / period)
    stiffness = damping**2 / (4.0 * inertia)
    return MotorGains(stiffness=tuple(stiffness.tolist()), damping=tuple(damping.tolist()))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotorReference(FrozenArrays):
    """What motors are told: `angle`, `speed`, `torque`, each (N, n) at the ticks, joint side, SI units."""

    angle: FloatArray
    speed: FloatArray
    torque: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticExperimentOptions:
    """How an experiment is run; times in s, frequencies in Hz.

    Args:
        duration: None for the trajectory's own.
        period: of control and log.
        step: longest Runge-Kutta step; fast springs shorten it.
        parts: into which a step is cut where a spring changes its slope.
        gains: of the motors' PD loops; None for those of a shipped robot, else by `bandwidth`.
        bandwidth: of loops with critical damping.
        control_counts: of the motor encoders in the loop, per turn; None for perfect ones.
        sensors: what the log sees.
    """

    duration: float | None = None
    period: float = 1e-3
    step: float = 1e-4
    parts: int = 16
    gains: MotorGains | None = None
    bandwidth: float = 12.0
    control_counts: float | None = None
    sensors: ElasticSensors = field(default_factory=ElasticSensors)


def build_clean_options() -> ElasticExperimentOptions:
    """Return the options of a clean experiment: 5 kHz, nothing rounded, no noise."""
    return ElasticExperimentOptions(period=2e-4)


def build_noisy_options() -> ElasticExperimentOptions:
    """Return the options of a noisy experiment: 1 kHz, 20 bit encoders, 2 % torque noise."""
    counts = 2.0**20
    sensors = ElasticSensors(motor_counts=counts, link_counts=counts, relative_noise=(0.02,))
    return ElasticExperimentOptions(period=1e-3, control_counts=counts, sensors=sensors)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticRun(FrozenArrays):
    """A recording and the truth behind it; position of links q, of motors theta, both joint side.

    Args:
        recording: what a log of this run holds; `position` is that of the links.
        time: (N,) s.
        q, dq, theta, dtheta: (N, n) true. desired: (N, n) reference of the links.
        torque: (N, n) of the motors, held from each sample to the next; the last one did nothing.
        joint_torque: tau_J (N, n).
        kinetic, potential: (N,) J, of the links. spin: (N,) J, of the rotors.
        work, friction, spring: (N, n) J since the start: of the motors, lost in their friction, into the
            springs (int tau_J dphi, stored and lost together).
        turn: (n,) of an encoder with one count: 2 pi rad or 1 m.
        values: of all parameters. backend: "c" or "python". notices: how the run came about.
    """

    recording: Recording
    time: FloatArray
    q: FloatArray
    dq: FloatArray
    theta: FloatArray
    dtheta: FloatArray
    desired: FloatArray
    torque: FloatArray
    joint_torque: FloatArray
    kinetic: FloatArray
    potential: FloatArray
    spin: FloatArray
    work: FloatArray
    friction: FloatArray
    spring: FloatArray
    turn: FloatArray
    values: ElasticValues
    backend: str
    notices: tuple[Notice, ...] = ()

    @property
    def phi(self) -> FloatArray:
        """Return the true torsion (N, n), rad or m."""
        return self.theta - self.q

    @property
    def gap(self) -> FloatArray:
        """Return the work that no energy and no loss accounts for, (N,) J since the start."""
        energy = self.kinetic + self.potential + self.spin
        losses = (self.friction + self.spring).sum(axis=1)
        gap: FloatArray = self.work.sum(axis=1) - (energy - energy[0]) - losses
        return gap

    @property
    def energy_gap(self) -> float:
        """Return the largest |gap| in J."""
        return float(np.abs(self.gap).max())

    @property
    def relative_gap(self) -> float:
        """Return the largest |gap|, relative to the most work done."""
        most = float(np.abs(self.work.sum(axis=1)).max())
        return self.energy_gap / max(most, float(np.finfo(np.float64).tiny))


def observe(run: ElasticRun, sensors: ElasticSensors, rng: np.random.Generator) -> Recording:
    """Return another log of the same truth: a study of noise needs one simulation only.

    What the control loop saw stays as it was; sensors that would change the motion want a run of their own.

    Raises:
        UsageError: sensors that cannot be.
    """
    check_elastic_sensors(sensors, run.q.shape[1])

    def read(
        position: FloatArray, late: float, offset: tuple[float, ...], counts: float | None
    ) -> FloatArray:
        step = np.zeros_like(run.turn) if counts is None else run.turn / counts
        return compute_readings(run.time, position, delay=max(late, 0.0), offset=offset, step=step)

    return Recording(
        time=run.time,
        position=read(run.q, sensors.delay, sensors.link_offset, sensors.link_counts),
        motor_position=read(run.theta, -sensors.delay, sensors.motor_offset, sensors.motor_counts),
        torque=add_motor_noise(run.torque, sensors, rng),
        source=run.recording.source,
        notices=run.notices,
    )


_POSES = 50


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ElasticTask:
    """An experiment, everything known before it is run."""

    robot: Robot
    library: Library
    values: ElasticValues
    plant: PlantRobot
    options: ElasticExperimentOptions
    gains: MotorGains | None
    time: FloatArray
    desired: FloatArray
    speed: FloatArray


def simulate_elastic(
    robot: Robot,
    library: Library,
    trajectory: ReferenceMotion,
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
    curves = None if values else build_curved_friction(library, get_velocity_limits(robot))
    pose, own = task.desired[:1], task.values
    hold = weight = library.evaluate("gravity", pose, own.beta)[0][0]
    if own.friction.size:
        hold = weight + library.evaluate("friction", np.zeros_like(pose), own.friction)[0][0]
    rest = compute_rest(task.plant, weight, tuple(joint.name for joint in robot.axes))
    # Motors see the trajectory ahead by the first torsion, and carry the weight.
    torque = np.broadcast_to(hold, task.desired.shape)
    followed = reference or MotorReference(angle=task.desired + rest.phi, speed=task.speed, torque=torque)
    order = _build_order(task, followed, rest)
    ran = simulate_plant(library, task.plant, order)
    _check_motion(task, ran.log)
    if curves:
        check_friction_at_speeds(curves, library.card.joints, ran.log.dtheta)
    notices = (*ran.notices, *describe_saturation(robot, ran.log.torque, order.limit))
    run = _build_run(task, ran, notices, f"simulated: {robot.name}, {trajectory.source}")
    losses = (run.friction + run.spring).sum(axis=1)
    check_balance(run.kinetic + run.spin, run.potential, run.work.sum(axis=1), losses)
    return replace(run, recording=observe(run, options.sensors, rng))


def _prepare(
    robot: Robot,
    library: Library,
    trajectory: ReferenceMotion,
    options: ElasticExperimentOptions,
    values: ElasticValues | None,
) -> _ElasticTask:
    stated = values or get_elastic_values(robot, library.card)
    shipped = SHIPPED_GAINS.get(robot.name)
    # A robot of one's own may have the name of a shipped one.
    own = shipped if shipped and len(shipped.damping) == robot.freedom else None
    gains = options.gains or own
    time = build_times(
        robot,
        library,
        trajectory,
        duration=options.duration,
        period=options.period,
        gains={"stiffness": gains.stiffness, "damping": gains.damping} if gains else {},
    )
    check_elastic_sensors(options.sensors, robot.freedom)
    if not (options.step > 0.0 and options.parts >= 1 and (options.control_counts or 1.0) > 0.0):
        text = (
            f"step {options.step:g} s, parts {options.parts}, control counts {options.control_counts}: "
            "the step and the counts must be positive, with one part at least"
        )
        raise UsageError(Notice(code="usage.experiment", text=text))
    desired, speed = trajectory.evaluate_derivatives(time, 1)
    return _ElasticTask(
        robot=robot,
        library=library,
        values=stated,
        plant=build_plant_robot(stated),
        options=options,
        gains=gains,
        time=time,
        desired=freeze(desired),
        speed=speed,
    )


def _build_order(task: _ElasticTask, told: MotorReference, rest: RestState) -> PlantExperiment:
    for name in ("angle", "speed", "torque"):
        if getattr(told, name).shape != task.desired.shape:
            text = (
                f"reference {name}: expected the shape {task.desired.shape}, got {getattr(told, name).shape}"
            )
            raise UsageError(Notice(code="usage.experiment", text=text))
    options, start = task.options, task.desired[0]
    poses = task.desired[np.linspace(0, len(task.desired) - 1, _POSES).astype(int)]
    (mass,) = task.library.evaluate("mass_matrix", poses, task.values.beta)
    if not np.all(np.linalg.eigvalsh(mass) > 0.0):
        raise SolverError(describe_massless(task.robot))
    gains = task.gains or compute_gains(mass, task.values.rotor, options.bandwidth, options.period)
    return PlantExperiment(
        angle=told.angle,
        speed=told.speed,
        torque=told.torque,
        stiffness=np.array(gains.stiffness),
        damping=np.array(gains.damping),
        limit=get_torque_limits(task.robot),
        step=get_encoder_turns(task.robot) / (options.control_counts or np.inf),
        period=options.period,
        substeps=count_substeps(task.library, task.values, poses, period=options.period, step=options.step),
        parts=options.parts,
        q=start,
        theta=start + rest.phi,
        play=rest.play,
    )


def _check_motion(task: _ElasticTask, log: PlantLog) -> None:
    """Refuse a robot that ran away.

    Raises:
        SolverError: the text says when, and what helps.
    """
    reach = compute_reach(task.robot, task.desired)
    far = np.any((np.abs(log.q) >= reach) | (np.abs(log.theta) >= reach), axis=1)
    gone = np.flatnonzero(far[: log.ticks])
    if gone.size or log.ticks < len(log.q):
        tick = int(gone[0]) if gone.size else log.ticks
        raise SolverError(describe_runaway(tick, task.options.period, task.options.bandwidth))


def _build_run(task: _ElasticTask, ran: PlantRun, notices: tuple[Notice, ...], source: str) -> ElasticRun:
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
        turn=get_encoder_turns(task.robot),
        values=values,
        backend=ran.backend,
        notices=notices,
    )
