"""An experiment with an elastic robot: motors under PD control along a trajectory; and the log of any robot.

Robot, Library with values, ReferenceMotion, ExperimentOptions, random generator -> ElasticRun.

    tau = Kp (theta_d - theta_m) + Kd (dtheta_d - dtheta) + tau_d    each period, held until the next
    J = mean of 1 / ((M + B)^-1)_jj,   Kd = 2 w J, at most a share of B / T,   Kp = Kd^2 / (4 J)
    sum int tau_i dtheta_i = change of (T + V + 1/2 sum B_i dtheta_i^2) + sum int F_i dtheta_i + tau_Ji dphi_i

with theta_m from the motor encoder and dtheta the true motor speed. By default theta_d = q_d + phi_0 and
tau_d = g(q_d(0)), phi_0 being the torsion under the weight at the first pose. The logged torque holds from
the sample on. A torque held for T damps a motor of inertia B only while Kd T / B < 2.

Robot whose file states all values, rigid or elastic, SimulateOptions -> its run.

Supported: own gains, sensors, references and values; torque limits of the robot file.
Not supported: control on link encoders, robots that are elastic in part, logs without link encoders.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library, PlantExperiment
from symid.errors import Notice, RobotError, SolverError, UsageError
from symid.excitation import ReferenceMotion
from symid.joint_models import NO_FRICTION
from symid.logs import Recording
from symid.options import SimulateOptions
from symid.robot import Controller, Coupling, Joint, Robot
from symid.simulation import elastic_plant, experiment
from symid.simulation.experiment import (
    PERIOD,
    ExperimentOptions,
    SensorOptions,
    SimulationRun,
    add_torque_noise,
    check_sensors,
    get_encoder_turns,
    simulate_experiment,
)
from symid.simulation.rigid_plant import (
    build_curved_friction,
    check_friction_at_speeds,
    gather_inputs,
    quantise,
)

_DAMPING_SHARE = 0.4


SHIPPED_GAINS: Mapping[str, Controller] = MappingProxyType(
    {"two_link_elastic": Controller(stiffness=(4000.0, 1500.0), damping=(120.0, 40.0))}
)
"""Gains of shipped robots, by name."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotorReference(FrozenArrays):
    """Reference of the motors: `angle`, `speed`, `torque`, each (N, n) at the ticks, joint side, SI units."""

    angle: FloatArray
    speed: FloatArray
    torque: FloatArray


def build_clean_options() -> ExperimentOptions:
    """Return the options of a clean experiment: 5 kHz, nothing rounded, no noise."""
    return ExperimentOptions(period=2e-4, sensors=SensorOptions(counts_per_turn=None))


def build_noisy_options() -> ExperimentOptions:
    """Return the options of a noisy experiment: 1 kHz, 20 bit encoders, 2 % torque noise."""
    counts = 2.0**20
    sensors = SensorOptions(motor_counts=counts, counts_per_turn=counts, relative_noise=(0.02,))
    return ExperimentOptions(period=1e-3, control_counts=counts, sensors=sensors)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticRun(FrozenArrays):
    """A recording and the truth behind it; position of links q, of motors theta, both joint side.

    Args:
        recording: the log; `position` is that of the links.
        time: (N,) s.
        q, dq, theta, dtheta: (N, n) true. desired: (N, n) reference of the links.
        torque: (N, n) of the motors, held from each sample to the next; the last one did nothing.
        joint_torque: tau_J (N, n).
        kinetic, potential: (N,) J, of the links. spin: (N,) J, of the rotors.
        work, friction, spring: (N, n) J since the start: of the motors, into their friction (lost, and
            stored in bristles if it has a state), into the
            springs (int tau_J dphi, stored and lost together).
        turn: (n,) of an encoder with one count: 2 pi rad or 1 m.
        values: of all parameters. backend: "c" or "python".
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
    values: elastic_plant.ElasticValues
    backend: str

    @property
    def phi(self) -> FloatArray:
        """Return the true torsion (N, n), rad or m."""
        return self.theta - self.q

    @property
    def gap(self) -> FloatArray:
        """Return work less change of energy and losses, (N,) J since the start."""
        energy = self.kinetic + self.potential + self.spin
        losses = (self.friction + self.spring).sum(axis=1)
        gap: FloatArray = self.work.sum(axis=1) - (energy - energy[0]) - losses
        return gap

    @property
    def energy_gap(self) -> float:
        """Return the largest |gap|, relative to the most work done."""
        most = float(np.abs(self.work.sum(axis=1)).max())
        return float(np.abs(self.gap).max()) / max(most, float(np.finfo(np.float64).tiny))


def observe(run: ElasticRun, sensors: SensorOptions, rng: np.random.Generator) -> Recording:
    """Return another log of the same run, whose motion stays; a UsageError for sensors out of range."""
    check_sensors(sensors, run.q.shape[1])

    def read(
        position: FloatArray, late: float, offset: tuple[float, ...], counts: float | None
    ) -> FloatArray:
        if late > 0.0:
            # The robot rested before the first sample.
            columns = [np.interp(run.time - late, run.time, column) for column in position.T]
            position = np.stack(columns, axis=1)
        return quantise(position + np.array(offset), run.turn / (counts or np.inf))

    return Recording(
        time=run.time,
        position=read(run.q, sensors.delay, sensors.link_offset, sensors.counts_per_turn),
        motor_position=read(run.theta, -sensors.delay, sensors.motor_offset, sensors.motor_counts),
        torque=add_torque_noise(run.torque, sensors, rng),
        source=run.recording.source,
        notices=run.recording.notices,
    )


_POSES = 50


def simulate_elastic(
    robot: Robot,
    library: Library,
    trajectory: ReferenceMotion,
    options: ExperimentOptions,
    rng: np.random.Generator,
    *,
    values: elastic_plant.ElasticValues | None = None,
    reference: MotorReference | None = None,
) -> ElasticRun:
    """Return the run of an elastic robot along `trajectory`, from rest at its start.

    `robot` has names and limits, `library` functions of its links; `rng` is of the torque noise. `values` are
    the truth (None: the robot file's), `reference` that of the motors at the ticks (None: the trajectory,
    shifted by the first torsion).

    Raises:
        UsageError: sizes that do not fit, a value that the robot file does not state, options out of range.
        SolverError: the controlled robot is unstable, is not held near its reference, or its springs do not
            carry it.
    """
    stated = values or elastic_plant.get_elastic_values(robot, library.card)
    time, gains = _check_experiment(robot, library, trajectory, options)
    desired, speed = trajectory.evaluate_derivatives(time, 1)
    # Values that are tried, and not a robot's own, may have friction that drives a joint.
    curves = None if values else build_curved_friction(library, experiment.get_limits(robot, "velocity"))
    pose = desired[:1]
    weight = library.evaluate("gravity", pose, stated.beta)[0][0]
    hold = weight
    if stated.friction.size:
        still = gather_inputs(library.card, np.zeros_like(pose), pose, weight[None])
        hold = weight + library.evaluate("friction", *still, stated.friction)[0][0]
    plant = elastic_plant.build_plant_robot(stated)
    elements = elastic_plant.build_elements(stated)
    phi, play = elastic_plant.compute_rest(plant, weight, tuple(joint.name for joint in robot.axes), elements)
    # Motors follow the trajectory shifted by the first torsion, and carry the weight.
    torque = np.broadcast_to(hold, desired.shape)
    followed = reference or MotorReference(angle=desired + phi, speed=speed, torque=torque)
    for name in ("angle", "speed", "torque"):
        shape = getattr(followed, name).shape
        if shape != desired.shape:
            text = f"reference {name}: expected the shape {desired.shape}, got {shape}"
            raise UsageError(Notice(code="usage.experiment", text=text))
    poses = desired[np.linspace(0, len(desired) - 1, _POSES).astype(int)]
    (mass,) = library.evaluate("mass_matrix", poses, stated.beta)
    experiment.compute_inertias(robot, mass)
    bandwidth = None if gains else options.bandwidth or experiment.BANDWIDTH
    if gains is None:
        # Critically damped joints; a motor's torque holds for a period.
        inertia = experiment.compute_inertias(robot, mass + np.diag(stated.rotor)).mean(axis=0)
        damping = 4.0 * np.pi * (bandwidth or 0.0) * inertia
        damping = np.minimum(damping, _DAMPING_SHARE * stated.rotor / options.period)
        stiffness = damping**2 / (4.0 * inertia)
    else:
        stiffness, damping = np.array(gains.stiffness), np.array(gains.damping)
    order = PlantExperiment(
        angle=followed.angle,
        speed=followed.speed,
        torque=followed.torque,
        stiffness=stiffness,
        damping=damping,
        limit=experiment.get_limits(robot, "torque"),
        step=get_encoder_turns(robot) / (options.control_counts or np.inf),
        period=options.period,
        substeps=elastic_plant.count_substeps(
            library, stated, poses, period=options.period, step=options.step
        ),
        parts=options.parts,
        q=desired[0],
        theta=desired[0] + phi,
        play=play,
    )
    ran = elastic_plant.simulate_plant(library, plant, order, elements)
    log = ran.log
    # Whether it went out of control.
    reach = experiment.compute_reach(robot, desired)
    lost = ~((np.abs(log.q) < reach) & (np.abs(log.theta) < reach))
    lost[log.ticks :] = True
    if np.any(lost):
        tick = int(np.flatnonzero(np.any(lost, axis=1))[0])
        raise SolverError(experiment.describe_runaway(robot, lost[tick], tick, options.period, bandwidth))
    if not (values or reference):
        poses = desired[:: max(1, len(desired) // 50)]
        loads = np.abs(library.evaluate("gravity", poses, stated.beta)[0]).max(axis=0)
        experiment.check_following(robot, log.q, desired, log.torque, loads)
    if curves:
        check_friction_at_speeds(curves, library.card.joints, log.dtheta)
    kinetic, potential = (part.reshape(-1) for part in library.evaluate("energy", log.q, log.dq, stated.beta))
    run = ElasticRun(
        recording=Recording(
            time=time,
            position=log.q,
            motor_position=log.theta,
            torque=log.torque,
            source=f"simulated: {robot.name}, {trajectory.source}",
            notices=(*ran.notices, *experiment.describe_saturation(robot, log.torque, order.limit)),
        ),
        time=time,
        q=log.q,
        dq=log.dq,
        theta=log.theta,
        dtheta=log.dtheta,
        desired=desired,
        torque=log.torque,
        joint_torque=log.spring,
        kinetic=kinetic,
        potential=potential,
        spin=0.5 * (stated.rotor * log.dtheta**2).sum(axis=1),
        work=log.work,
        friction=log.friction,
        spring=log.elastic + log.damped,
        turn=get_encoder_turns(robot),
        values=stated,
        backend=ran.backend,
    )
    losses = (run.friction + run.spring).sum(axis=1)
    experiment.check_balance(run.kinetic + run.spin, run.potential, run.work.sum(axis=1), losses)
    return replace(run, recording=observe(run, options.sensors, rng))


def _check_experiment(
    robot: Robot, library: Library, trajectory: ReferenceMotion, options: ExperimentOptions
) -> tuple[FloatArray, Controller | None]:
    """Return the control ticks (N,) in s of an experiment that can be run, and gains that are stated."""
    shipped = SHIPPED_GAINS.get(robot.name)
    # Another robot may have the name of a shipped one.
    fits = shipped is not None and len(shipped.damping) == robot.freedom and options.bandwidth is None
    gains = shipped if fits else None
    if options.stiffness is not None and options.damping is not None:
        gains = Controller(stiffness=options.stiffness, damping=options.damping)
    time = experiment.build_times(
        robot,
        library,
        trajectory,
        duration=options.duration,
        period=options.period,
        gains={"stiffness": gains.stiffness, "damping": gains.damping} if gains else {},
    )
    check_sensors(options.sensors, robot.freedom)
    if not (options.step > 0.0 and options.parts >= 1 and (options.control_counts or 1.0) > 0.0):
        text = (
            f"step {options.step:g} s, parts {options.parts}, control counts {options.control_counts}: "
            "the step and the counts must be positive, with one part at least"
        )
        raise UsageError(Notice(code="usage.experiment", text=text))
    return time, gains


DEFAULT_NOISE = 0.05
"""N m or N, of rigid robots; elastic ones have noise in proportion to their torques."""


def check_sensor_options(robot: Robot, sensors: SimulateOptions) -> None:
    """Refuse, by a UsageError, a delay or an offset between encoders for a robot without elastic joints."""
    if not any(robot.elastic) and (sensors.delay or sensors.offset):
        text = (
            f"--delay and --offset are between motor and link encoders, and {robot.name} has no elastic "
            "joint; leave them out"
        )
        raise UsageError(Notice(code="usage.rigid-sensors", text=text))


def simulate_log(
    robot: Robot,
    library: Library,
    motion: ReferenceMotion,
    options: SimulateOptions,
    rng: np.random.Generator,
) -> tuple[SimulationRun | ElasticRun, Mapping[str, object]]:
    """Return the run of a robot with all values under PD control along `motion`; `rng` is of the noise.

    Beside it, in plain types, the noise, the controller of a rigid robot, the torsion of an elastic one.
    """
    texts = []
    if (options.stiffness is None) != (options.damping is None):
        texts.append("give --stiffness and --damping together, one number for each joint")
    if options.bandwidth is not None and options.stiffness is not None:
        texts.append("--bandwidth is that of gains that follow from the inertia; give it or the gains")
    for name in ("stiffness", "damping"):
        values = getattr(options, name) or ()
        if not all(0.0 <= value < np.inf for value in values):
            texts.append(f"--{name}: expected finite numbers of 0 or more, got {values}")
    if texts:
        raise UsageError(*(Notice(code="usage.gains", text=text) for text in texts))
    order = build_clean_options() if options.clean or not any(robot.elastic) else build_noisy_options()
    order = replace(
        order,
        bandwidth=options.bandwidth,
        period=options.control_period or (order.period if any(robot.elastic) else PERIOD),
        stiffness=None if options.stiffness is None else tuple(map(float, options.stiffness)),
        damping=None if options.damping is None else tuple(map(float, options.damping)),
    )
    if not any(robot.elastic):
        noise = DEFAULT_NOISE if options.noise is None else options.noise
        sensors = order.sensors if options.clean else SensorOptions(torque_noise=(noise,))
        order = replace(order, sensors=sensors, controller=robot.controller)
        run = simulate_experiment(robot, library, motion, order, rng)
        return run, {"noise": 0.0 if options.clean else noise, "controller": asdict(run.controller)}
    both = replace(order.sensors, delay=options.delay, link_offset=(options.offset,))
    if options.noise is not None and not options.clean:
        both = replace(both, torque_noise=(options.noise,), relative_noise=(0.0,))
    elastic = simulate_elastic(robot, library, motion, replace(order, sensors=both), rng)
    return elastic, {
        "noise": both.torque_noise[0],
        "relative_noise": both.relative_noise[0],
        "delay": options.delay,
        "offset": options.offset,
        "largest_torsion": abs(elastic.phi).max(axis=0).tolist(),
    }


def _list_gaps(part: Joint | Coupling) -> Iterator[str]:
    """Yield the values that a joint or a coupling does not state."""
    if isinstance(part, Coupling):
        if part.has_rotor and part.rotor_inertia is None:
            yield "the rotor_inertia"
    else:
        if part.inertial is None:
            yield "[joint.link] mass, com and inertia"
        if part.drive.has_rotor and part.drive.rotor_inertia is None:
            yield "the rotor_inertia of [joint.drive]"
        if part.spring is not None and None in (part.spring.stiffness, part.spring.rest):
            yield "stiffness and rest of [joint.spring]"
        if part.elasticity is not None and part.elasticity.initial_stiffness is None:
            yield "the stiffness of [joint.elasticity] and of its stops"
        if part.elasticity is not None and not part.drive.has_rotor:
            yield "the rotor_inertia of [joint.drive], which an elastic joint needs"
    if part.friction.law != NO_FRICTION and part.friction.values is None:
        yield f"the values of friction {part.friction.law}"


def check_stated_values(robot: Robot) -> None:
    """Refuse a robot that cannot be simulated before minutes go into its derivation.

    Raises:
        RobotError: its file lacks values.
        UsageError: only some of its joints are elastic.
    """
    if any(robot.elastic):
        elastic_plant.refuse_rigid_joints(robot)
    lacking = [f"joint '{joint.name}': {gap}" for joint in robot.joints for gap in _list_gaps(joint)]
    lacking += [f"coupling '{one.name}': {gap}" for one in robot.couplings for gap in _list_gaps(one)]
    if lacking:
        text = f"cannot be simulated, these values are not stated: {'; '.join(lacking)}"
        raise RobotError(Notice(code="robot.no-values", text=text, file=robot.path))
