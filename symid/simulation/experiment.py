"""Experiments: a robot under PD control along a trajectory, logged like a real one; and their checks.

Robot, Library with values, ReferenceMotion, ExperimentOptions, random generator -> SimulationRun, or
ElasticRun of a robot with elastic joints. Robot whose file states all values, SimulateOptions -> its run.

    rigid    tau = g(q_d(0)) + Kp (q_d - q_m) + Kd (dq_d - dq_f)    each period, held until the next
    elastic  tau = tau_d + Kp (theta_d - theta_m) + Kd (dtheta_d - dtheta)
             J = mean of 1 / ((M + B)^-1)_jj,   Kd = 2 w J, at most a share of B / T,   Kp = Kd^2 / (4 J)
             sum int tau_i dtheta_i = change of (T + V + 1/2 sum B_i dtheta_i^2)
                                      + sum int F_i dtheta_i + tau_Ji dphi_i

with q_m, theta_m from encoders, dq_f the low-passed difference of q_m, and dtheta the true motor speed; the
controller of a rigid robot's file may say otherwise. By default theta_d = q_d + phi_0 and tau_d = g(q_d(0)),
phi_0 being the torsion under the weight at the first pose. A torque held for T damps a motor of inertia B
only while Kd T / B < 2. The logged torque of a rigid robot at a sample is the mean of the torques before and
after the tick, as a sensor averages it; that of an elastic one holds from the sample on. Sensors round
positions to encoder steps, shift zeros, delay motor against link encoders (linear between true samples), and
add white noise to torques, absolute or relative to a joint's RMS.

Supported: joint PD with own gains, sensors, references and values; torque limits of the robot file.
Not supported: further feed-forward, motor-side logs of rigid robots, control on link encoders, robots that
are elastic in part, collisions; coloured noise, eccentric encoders, delays that vary.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.codegen import Library, PlantExperiment, RigidExperiment
from symid.errors import Notice, RobotError, SolverError, UsageError
from symid.excitation import ReferenceMotion
from symid.joint_models import NO_FRICTION
from symid.logs import Recording
from symid.options import SimulateOptions
from symid.robot import Controller, Coupling, Joint, JointKind, Robot, refuse_passive_joints
from symid.simulation import elastic_plant, rigid_plant


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOptions:
    """The sensors of a robot; a tuple holds one number for all joints or one for each.

    Args:
        counts_per_turn: of the encoder, or that of the links of an elastic robot, per turn of the joint (per
            metre, if prismatic); None for a perfect one. motor_counts: the same of motor encoders.
        motor_offset, link_offset: reading at position zero, rad or m, of elastic joints.
        delay: s; a link reading at t shows the link as it was at t - delay. Negative: motor readings are
            late.
        torque_noise: standard deviation, N m or N.
        relative_noise: standard deviation as a share of the RMS of that joint's torque in the run.
    """

    counts_per_turn: float | None = 2.0**20
    motor_counts: float | None = None
    motor_offset: tuple[float, ...] = (0.0,)
    link_offset: tuple[float, ...] = (0.0,)
    delay: float = 0.0
    torque_noise: tuple[float, ...] = (0.0,)
    relative_noise: tuple[float, ...] = (0.0,)


def get_encoder_turns(robot: Robot) -> FloatArray:
    """Return how far (n,) an encoder with one count turns: 2 pi rad, or 1 m of a prismatic joint."""
    return np.array([1.0 if joint.kind is JointKind.PRISMATIC else 2.0 * np.pi for joint in robot.axes])


def add_torque_noise(torque: FloatArray, sensors: SensorOptions, rng: Generator) -> FloatArray:
    """Return `torque` (N, n) with white noise; absolute and relative noise are independent sources."""
    relative = np.array(sensors.relative_noise) * np.sqrt((torque**2).mean(axis=0))
    deviation = np.hypot(np.array(sensors.torque_noise), relative)
    return np.asarray(torque + deviation * rng.normal(size=torque.shape))


_BANDWIDTH, _PERIOD, _VELOCITY_FILTER = 12.0, 1e-3, 150.0
"""Hz, s and Hz, of control where nobody states them."""
_MARGIN = 1.25
"""Factor on the gains with which every sampled loop must still be stable."""
_SLOWEST_DECAY = 1e-8
"""Least share of a velocity that friction takes in a period: less leaves no digits of what is carried."""
_LOWER, _LEAST_BANDWIDTH = 0.8, 0.1
"""Factor on a bandwidth that is too high, and the least one, Hz."""
_SHIPPED_GAINS = {"two_link_elastic": ((4000.0, 1500.0), (120.0, 40.0))}
"""Kp and Kd of shipped robots, by name."""
_DAMPING_SHARE, _PARTS = 0.4, 16
"""Of B / T, and into how many parts a step is cut where a spring changes its slope."""
_NOISE = 0.05
"""N m or N, of rigid robots; elastic ones have noise in proportion to their torques."""
_NEAR_ENOUGH = (1.0, 0.5)
"""Rad and m by which a joint may miss its reference, however little it is asked to move."""
_RUNAWAY = 1e4
"""Rad or m: largest position of a joint without limits."""
_FAR = 10.0
"""Largest position of a joint with limits, relative to them."""
_LARGEST_GAP = 1e-6
"""Of work, change of energy and dissipation, relative to the largest of them."""
_REMEDY = (
    "give links with mass an inertia, or lower --bandwidth or the gains (--stiffness, --damping), or shorten "
    "--period"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentOptions:
    """How an experiment is run; times in s, frequencies in Hz.

    Args:
        duration: None for the trajectory's own.
        period: of control and log.
        bandwidth: of gains with critical damping at the joint's effective inertia; None for 12 Hz, or less
            where the sampled loops would not be stable, or for the gains of a shipped elastic robot.
        stiffness, damping: Kp, Kd of each joint in place of gains by bandwidth; both, or none, of motors.
        sensors: what controller and log read; of an elastic robot the controller reads the motors' alone.
        controller: of a rigid robot, its gains, where neither they nor a bandwidth are given, and its filter;
            a constant torque that it does not state is the weight at the first pose.
    """

    duration: float | None = None
    period: float = _PERIOD
    bandwidth: float | None = None
    stiffness: tuple[float, ...] | None = None
    damping: tuple[float, ...] | None = None
    sensors: SensorOptions = field(default_factory=SensorOptions)
    controller: Controller | None = None


def build_times(
    robot: Robot,
    library: Library,
    trajectory: ReferenceMotion,
    options: ExperimentOptions,
    gains: Sequence[tuple[float, ...] | None],
) -> FloatArray:
    """Return the control ticks (N,) in s, or raise a UsageError with all sizes and times that do not fit.

    `gains` are Kp and Kd, None where they are still to be found.
    """
    size, problems = robot.freedom, []
    if trajectory.size != size or library.card.size != size:
        problems.append(
            f"the robot has {size} joints, the trajectory {trajectory.size}, the library {library.card.size}"
        )
    for name, values in zip(("stiffness", "damping"), gains, strict=True):
        if values is not None and len(values) != size:
            problems.append(f"{name}: {len(values)} numbers for {size} joints")
    duration, period = trajectory.duration if options.duration is None else options.duration, options.period
    finite = np.isfinite(duration) and np.isfinite(period)
    if not (finite and period > 0.0 and duration >= 2.0 * period):
        problems.append(
            f"duration {duration:g} s, period {period:g} s: the period must be positive, with two periods at "
            "least"
        )
    if problems:
        raise UsageError(*(Notice(code="usage.experiment", text=text) for text in problems))
    return freeze(np.arange(round(duration / period) + 1) * period)


def pick_poses(desired: FloatArray) -> FloatArray:
    """Return 50 poses of a motion (N, n), its first and its last one included."""
    return desired[np.linspace(0, len(desired) - 1, 50).astype(np.int64)]


def compute_inertias(robot: Robot, mass: FloatArray) -> FloatArray:
    """Return 1 / (M^-1)_jj (K, n) over M (K, n, n): what a joint feels, others free; refuse a singular M."""
    if not np.all(np.linalg.eigvalsh(mass) > 0.0):
        text = f"robot {robot.name!r} cannot be simulated: its mass matrix is singular, a joint moves "
        text += "without inertia; give every moved link a mass with an inertia, or its drive a rotor_inertia"
        raise SolverError(Notice(code="simulate.massless", text=text))
    return np.asarray(1.0 / np.diagonal(np.linalg.inv(mass), axis1=1, axis2=2))


def get_limits(robot: Robot, name: str) -> FloatArray:
    """Return the limits "torque" or "velocity" (n,) of the joints, SI units, infinite for none."""
    limits = [getattr(joint.limits, name) for joint in robot.axes]
    return np.array([np.inf if limit is None else limit for limit in limits])


def compute_reach(robot: Robot, desired: FloatArray) -> FloatArray:
    """Return the positions (n,) beyond which a joint is out of control; `desired` (N, n), rad or m."""
    bounds = [joint.limits.position for joint in robot.axes]
    reach = np.array([_FAR * max(map(abs, bound)) if bound else _RUNAWAY for bound in bounds])
    return np.asarray(np.maximum(reach, 2.0 * np.abs(desired).max(axis=0)))


def check_balance(
    kinetic: FloatArray, potential: FloatArray, stored: FloatArray, work: FloatArray, lost: FloatArray
) -> tuple[FloatArray, float]:
    """Return by what the energy balance of a run fails, or refuse it if that is too much or not finite.

    All are (N,) J, work and losses since the start; `stored` is in bristles or rotors. Beside the gap stands
    the largest one, relative to the most work done.
    """
    energy = kinetic + potential + stored
    change = energy - energy[0]
    gap: FloatArray = work - change - lost
    largest = max(float(np.abs(part).max()) for part in (work, kinetic + stored, change, lost))
    # Rounding of the potential is no gap.
    scale, most = largest + 1e-6 * float(np.abs(potential).max()), float(np.abs(gap).max())
    if not np.isfinite(most + scale):
        text = f"the simulated run has values that are not finite; {_REMEDY}"
        raise SolverError(Notice(code="simulate.not-finite", text=text))
    if most > _LARGEST_GAP * scale:
        text = f"the energy balance of the run has a relative error of {most / scale:.2g} (allowed "
        text += f"{_LARGEST_GAP:g}): the motion is too fast for the integration steps; {_REMEDY}"
        raise SolverError(Notice(code="simulate.energy", text=text))
    return gap, most / max(float(np.abs(work).max()), float(np.finfo(np.float64).tiny))


def describe_saturation(robot: Robot, torque: FloatArray, limit: FloatArray) -> tuple[Notice, ...]:
    """Return a notice for each joint that reached its limit (n,) with `torque` (N, n)."""
    shares = zip(robot.axes, np.mean(np.abs(torque) >= limit, axis=0).tolist(), strict=True)
    texts = (
        f"joint {joint.name!r} was at its torque limit during {100 * share:.1f} % of the run; slow down"
        for joint, share in shares
        if share
    )
    return tuple(Notice(code="simulate.saturation", text=text) for text in texts)


def check_following(
    robot: Robot, q: FloatArray, desired: FloatArray, torque: FloatArray, weight: FloatArray
) -> None:
    """Refuse a run in which a joint missed its reference by more than all that it was asked to move.

    `q`, `desired`, `torque` (N, n); `weight` (n,) is the most that carries a joint along the reference.
    """
    gap, limits, notices = np.abs(q - desired).max(axis=0), get_limits(robot, "torque"), []
    for number, joint in enumerate(robot.axes):
        slides = joint.kind is JointKind.PRISMATIC
        unit, force = ("m", "N") if slides else ("rad", "N m")
        if gap[number] <= max(float(np.ptp(desired[:, number])), _NEAR_ENOUGH[slides]):
            continue
        limit, share = limits[number], float(np.mean(np.abs(torque[:, number]) >= limits[number]))
        bound = f"its torque limit is {limit:g} {force}, reached during {100 * share:.1f} % of the run; "
        bound += "raise it in the robot file, lighten the links, slow the motion down (--scale)"
        weak = "its gains are too low for that; raise --bandwidth or --stiffness and --damping"
        text = f"the controller did not hold joint {joint.name!r}: it was up to {gap[number]:.3g} {unit} "
        text += f"from its reference, which moves by {np.ptp(desired[:, number]):.3g} {unit}; its weight "
        text += f"along the reference takes up to {weight[number]:.3g} {force}, and "
        text += f"{bound if share else weak}, or choose another motion (--trajectory)"
        notices.append(Notice(code="simulate.not-held", text=text))
    if notices:
        raise SolverError(*notices)


def describe_runaway(
    robot: Robot, gone: NDArray[np.bool_], tick: int, period: float, bandwidth: float | None
) -> Notice:
    """Return the notice on joints out of control, those in `gone` (n,), at a tick.

    The period is in s; the bandwidth in Hz, None for gains that are stated.
    """
    names = [joint.name for joint, lost in zip(robot.axes, gone, strict=True) if lost]
    limits = get_limits(robot, "torque")[gone]
    limited = " or raise its torque limit in the robot file" if np.any(np.isfinite(limits)) else ""
    lower = "" if bandwidth is None else f"--bandwidth ({bandwidth:.3g} Hz) or "
    text = f"the controlled robot became unstable at t = {tick * period:g} s, at joint "
    text += f"{', '.join(map(repr, names))}; lower {lower}the gains (--stiffness, --damping), shorten "
    text += f"--period ({period:g} s), slow the motion down (--scale), or give links with mass an "
    text += f"inertia{limited}"
    return Notice(code="simulate.unstable", text=text)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulationRun(FrozenArrays):
    """A recording and the truth behind it.

    Args:
        recording: the log.
        q, dq: (N, n) true states. torque: (N, n) held from each sample to the next; the last row repeats the
            one before.
        work, dissipation: (N,) J since the start.
        energy_gap: the largest |work - change of energy - dissipation|, relative to the most work done.
        events: how often a joint came to rest or turned.
        controller: what the robot was controlled by. backend: "c" or "python", of the plant.
    """

    recording: Recording
    q: FloatArray
    dq: FloatArray
    torque: FloatArray
    work: FloatArray
    dissipation: FloatArray
    energy_gap: float
    events: int
    controller: Controller
    backend: str


def simulate_experiment(
    robot: Robot, library: Library, trajectory: ReferenceMotion, options: ExperimentOptions, rng: Generator
) -> SimulationRun:
    """Return the run of `robot` along `trajectory`, from rest at its start.

    Raises:
        UsageError: sizes that do not fit, a value that the robot file does not state, options out of range,
            friction that drives a joint at its speeds, elastic joints.
        SolverError: the controlled robot is unstable or too light, is not held near its reference, chatters
            without end, or has friction that is too steep.
    """
    names = [joint.name for joint, elastic in zip(robot.axes, robot.elastic, strict=True) if elastic]
    if names:
        named = f"robot {robot.name!r} has elastic joints ({', '.join(names)})"
        text = f"{named}; simulate it as an elastic robot"
        raise UsageError(Notice(code="usage.elastic-robot", text=text))
    known = options.controller or options
    gains = (options.stiffness or known.stiffness, options.damping or known.damping)
    times = build_times(robot, library, trajectory, options, gains)
    plant = rigid_plant.RigidPlant(library, speeds=get_limits(robot, "velocity"))
    encoder = get_encoder_turns(robot) / (options.sensors.counts_per_turn or np.inf)
    desired, speeds = trajectory.evaluate(times, 1)
    law, bandwidth, notices = _complete_controller(robot, library, plant, desired, options)
    # What the plant is to do, from rest at the first pose.
    order = RigidExperiment(
        position=desired,
        speed=speeds * float(law.velocity == "error"),
        torque=np.broadcast_to(np.array(law.offset), desired.shape),
        stiffness=np.array(law.stiffness),
        damping=np.array(law.damping),
        limit=get_limits(robot, "torque"),
        step=encoder,
        reach=compute_reach(robot, desired),
        period=options.period,
        substeps=1,
        blend=_compute_blend(law, options.period),
        sensed=law.velocity_source == "sensor",
        q=desired[0],
        dq=np.zeros(plant.size),
        measured=rigid_plant.quantise(desired[0], encoder),
        velocity=np.zeros(plant.size),
    )
    while True:
        log = rigid_plant.simulate_rigid_plant(library, plant, order)
        if log.end == "away":
            far = np.abs(log.q[-1] - desired[len(log.q) - 1])
            gone = ~((far < order.reach) & np.isfinite(log.dq[-1]))
            raise SolverError(describe_runaway(robot, gone, len(log.q) - 1, order.period, bandwidth))
        kinetic, potential = map(np.ravel, library.evaluate("energy", log.q, log.dq, plant.beta))
        stored = plant.bristles.compute_energy(log.z)
        try:
            _, energy_gap = check_balance(kinetic, potential, stored, log.work, log.lost)
            break
        except SolverError:
            if order.controlled or plant.is_checked:
                raise
            # Steps as long as their error allows.
            order = replace(order, controlled=True)
    rigid_plant.check_friction_at_speeds(plant.friction, library.card.joints, log.dq)
    torque = np.concatenate([log.torque[:-1], log.torque[-2:-1]])
    weight = np.abs([plant.compute_weight(pose) for pose in pick_poses(desired)]).max(axis=0)
    check_following(robot, log.q, desired, torque, weight)
    # The mean of the torques before and after each tick; nothing was held before the first.
    logged = torque.copy()
    logged[1:] = 0.5 * (torque[1:] + torque[:-1])
    return SimulationRun(
        recording=Recording(
            time=times,
            position=rigid_plant.quantise(log.q, encoder),
            torque=add_torque_noise(logged, options.sensors, rng),
            reference=desired,
            reference_velocity=speeds,
            source=f"simulated: {robot.name}, {trajectory.source}",
            simulated=robot.values_signature,
            notices=(*notices, *plant.notices, *describe_saturation(robot, torque, order.limit)),
        ),
        q=log.q,
        dq=log.dq,
        torque=torque,
        work=log.work,
        dissipation=log.lost,
        energy_gap=energy_gap,
        events=log.events,
        controller=law,
        backend="python" if plant.code is None else "c",
    )


def _compute_blend(law: Controller, period: float) -> float:
    cutoff = law.velocity_filter
    return 1.0 if cutoff is None else 1.0 - float(np.exp(-2.0 * np.pi * cutoff * period))


def compute_flow(mass: FloatArray, viscous: FloatArray, period: float) -> tuple[FloatArray, FloatArray]:
    """Return what a period in s makes of (q, dq), (K, 2n, 2n), and of torques held in it, (K, 2n, n).

    M ddq = tau - D dq, exactly, with `mass` M (K, n, n) and D of `viscous` (n,); SI units.
    """
    # In coordinates in which M is one and D diagonal. So slow a decay is as good as none.
    factor = np.linalg.inv(np.linalg.cholesky(mass))
    rates, modes = np.linalg.eigh((factor * viscous) @ factor.swapaxes(1, 2))
    turn, x = factor.swapaxes(1, 2) @ modes, np.minimum(-period * rates, -_SLOWEST_DECAY)
    share = np.expm1(x) / x
    once, twice = period * share, period**2 * (share - 1.0) / x

    def carry(part: FloatArray, ways: FloatArray) -> FloatArray:
        return np.asarray(turn * part[:, None] @ ways)

    back, push = np.linalg.inv(turn), turn.swapaxes(1, 2)
    still = np.broadcast_to(np.eye(len(viscous)), mass.shape)
    free = np.block([[still, carry(once, back)], [0.0 * still, carry(np.exp(x), back)]])
    return free, np.concatenate([carry(twice, push), carry(once, push)], axis=1)


def _is_stable(plant: rigid_plant.RigidPlant, mass: FloatArray, law: Controller, period: float) -> bool:
    """Return whether the sampled loops at M (K, n, n) are stable, with gains of `_MARGIN` times the law's."""
    blend, size = _compute_blend(law, period), plant.size
    position, velocity, known, before = np.split(np.eye(4 * size), 4)
    raw = velocity if law.velocity_source == "sensor" else (position - before) / period
    filtered = blend * raw + (1.0 - blend) * known
    pull = np.diag(law.stiffness) @ position + np.diag(law.damping) @ filtered
    free, pulled = compute_flow(mass, plant.friction.viscous[1:].min(axis=0), period)
    moved = free @ np.eye(2 * size, 4 * size) - _MARGIN * pulled @ pull
    rest = np.broadcast_to(np.vstack([filtered, position]), (len(mass), 2 * size, 4 * size))
    return bool(np.abs(np.linalg.eigvals(np.concatenate([moved, rest], axis=1))).max() < 1.0)


def _complete_controller(
    robot: Robot,
    library: Library,
    plant: rigid_plant.RigidPlant,
    desired: FloatArray,
    options: ExperimentOptions,
) -> tuple[Controller, float | None, tuple[Notice, ...]]:
    """Return the law, its bandwidth (None of stated gains) and notices; others are of critical damping."""
    (mass,) = library.evaluate("mass_matrix", pick_poses(desired), plant.beta)
    inertias = compute_inertias(robot, mass)
    given = options.controller or Controller(stiffness=(), damping=(), velocity_filter=_VELOCITY_FILTER)
    weight = tuple(plant.compute_weight(desired[0]).tolist())
    law = replace(given, offset=weight if given.offset is None else given.offset, torque="average")

    def build(bandwidth: float, inertia: FloatArray, viscous: FloatArray) -> Controller:
        pole = 2.0 * np.pi * bandwidth
        return replace(
            law,
            stiffness=options.stiffness or tuple((pole**2 * inertia + pole * viscous).tolist()),
            damping=options.damping or tuple((2.0 * pole * inertia).tolist()),
        )

    if options.controller and options.bandwidth is None:
        stiffness, damping = options.stiffness or law.stiffness, options.damping or law.damping
        return replace(law, stiffness=stiffness, damping=damping), None, ()
    # J is the mean effective inertia. Where these sampled loops are not stable along the motion, J is the
    # lowest one, viscous friction D adds w D to Kp, and w is lowered until they are.
    bandwidth, lowest = options.bandwidth or _BANDWIDTH, inertias.min(axis=0)
    first = build(bandwidth, inertias.mean(axis=0), np.zeros(plant.size))
    if options.stiffness and options.damping:
        return first, None, ()
    if _is_stable(plant, mass, first, options.period):
        return first, bandwidth, ()
    viscous = plant.friction.viscous[1:].min(axis=0)
    found = build(bandwidth, lowest, viscous)
    while not (stable := _is_stable(plant, mass, found, options.period)) and options.bandwidth is None:
        bandwidth *= _LOWER
        if bandwidth < _LEAST_BANDWIDTH:
            return first, _BANDWIDTH, ()
        found = build(bandwidth, lowest, viscous)
    asked = options.bandwidth or _BANDWIDTH
    joint = int(np.argmax(inertias.max(axis=0) / lowest))
    (before, after), name = ([law.stiffness[joint] for law in (first, found)], robot.axes[joint].name)
    lowered = f"was lowered from {asked:g} Hz to {bandwidth:.3g} Hz"
    change = lowered if bandwidth < asked else f"is {asked:g} Hz"
    result = "at which the loops are stable at all poses of the motion"
    if not stable:
        result = "at which the loops may be unstable all the same at some pose of the motion"
    text = f"the bandwidth of the controller {change}, with gains of the lowest inertia along the motion in "
    text += f"place of the mean, and of viscous friction, {result}: the inertia that joint {name!r} feels, "
    text += f"{lowest[joint]:.2g} to {inertias[:, joint].max():.2g} kg m^2 or kg, varies most, and its "
    text += f"stiffness is {after:.3g} instead of {before:.3g} N m/rad or N/m. Shorten --period for more, or "
    text += "set --bandwidth, or --stiffness and --damping"
    return found, bandwidth, (Notice(code="simulate.bandwidth", text=text),)


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
    return ExperimentOptions(sensors=sensors)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticRun(FrozenArrays):
    """A recording and the truth behind it; position of links q, of motors theta, both joint side.

    Args:
        recording: the log; `position` is that of the links.
        q, dq, theta, dtheta: (N, n) true. desired: (N, n) reference of the links.
        torque: (N, n) of the motors, held from each sample to the next; the last one did nothing.
        joint_torque: tau_J (N, n).
        friction: (N, n) J since the start, into that of the motors (lost, and stored in bristles).
        gap: (N,) J, work less change of energy and losses since the start; energy_gap: the largest |gap|,
            relative to the most work done.
        turn: (n,) of an encoder with one count: 2 pi rad or 1 m.
        values: of all parameters. backend: "c" or "python".
    """

    recording: Recording
    q: FloatArray
    dq: FloatArray
    theta: FloatArray
    dtheta: FloatArray
    desired: FloatArray
    torque: FloatArray
    joint_torque: FloatArray
    friction: FloatArray
    gap: FloatArray
    energy_gap: float
    turn: FloatArray
    values: elastic_plant.ElasticValues
    backend: str

    @property
    def phi(self) -> FloatArray:
        """Return the true torsion (N, n), rad or m."""
        return self.theta - self.q


def observe(run: ElasticRun, sensors: SensorOptions, rng: Generator) -> Recording:
    """Return another log of the same run, whose motion stays."""
    time = run.recording.time

    def read(
        position: FloatArray, late: float, offset: tuple[float, ...], counts: float | None
    ) -> FloatArray:
        if late > 0.0:
            # The robot rested before the first sample.
            position = np.stack([np.interp(time - late, time, column) for column in position.T], axis=1)
        return rigid_plant.quantise(position + np.array(offset), run.turn / (counts or np.inf))

    return Recording(
        time=time,
        position=read(run.q, sensors.delay, sensors.link_offset, sensors.counts_per_turn),
        motor_position=read(run.theta, -sensors.delay, sensors.motor_offset, sensors.motor_counts),
        torque=add_torque_noise(run.torque, sensors, rng),
        source=run.recording.source,
        notices=run.recording.notices,
        simulated=run.recording.simulated,
    )


def simulate_elastic(
    robot: Robot,
    library: Library,
    trajectory: ReferenceMotion,
    options: ExperimentOptions,
    rng: Generator,
    *,
    reference: MotorReference | None = None,
) -> ElasticRun:
    """Return the run of an elastic robot along `trajectory`, from rest at its start.

    `library` has the functions of its links; `rng` is of the torque noise. `reference` is that of the motors
    at the ticks (None: the trajectory, shifted by the first torsion).

    Raises:
        UsageError: sizes that do not fit, a value that the robot file does not state, options out of range.
        SolverError: the controlled robot is unstable, is not held near its reference, or its springs do not
            carry it.
    """
    stated = elastic_plant.get_elastic_values(robot, library.card)
    gains: tuple[tuple[float, ...], tuple[float, ...]] | None = _SHIPPED_GAINS.get(robot.name)
    if options.stiffness is not None and options.damping is not None:
        gains = (options.stiffness, options.damping)
    elif options.bandwidth is not None or (gains and len(gains[0]) != robot.freedom):
        # Another robot may have the name of a shipped one.
        gains = None
    time = build_times(robot, library, trajectory, options, gains or (None, None))
    desired, speed = trajectory.evaluate(time, 1)
    curves = rigid_plant.build_curved_friction(library, get_limits(robot, "velocity"))
    pose = desired[:1]
    weight = library.evaluate("gravity", pose, stated.beta)[0][0]
    hold = weight
    if stated.friction.size:
        still = rigid_plant.gather_inputs(library.card, np.zeros_like(pose), pose, weight[None])
        hold = weight + library.evaluate("friction", *still, stated.friction)[0][0]
    plant = elastic_plant.build_plant_robot(stated)
    elements = elastic_plant.build_elements(stated)
    phi, play = elastic_plant.compute_rest(plant, weight, tuple(joint.name for joint in robot.axes), elements)
    # Motors follow the trajectory shifted by the first torsion, and carry the weight.
    torque = np.broadcast_to(hold, desired.shape)
    followed = reference or MotorReference(angle=desired + phi, speed=speed, torque=torque)
    poses = pick_poses(desired)
    (mass,) = library.evaluate("mass_matrix", poses, stated.beta)
    compute_inertias(robot, mass)
    bandwidth = None if gains else options.bandwidth or _BANDWIDTH
    if gains is None:
        # Critically damped joints; a motor's torque holds for a period.
        inertia = compute_inertias(robot, mass + np.diag(stated.rotor)).mean(axis=0)
        damping = 4.0 * np.pi * (bandwidth or 0.0) * inertia
        damping = np.minimum(damping, _DAMPING_SHARE * stated.rotor / options.period)
        stiffness = damping**2 / (4.0 * inertia)
    else:
        stiffness, damping = map(np.array, gains)
    turn = get_encoder_turns(robot)
    order = PlantExperiment(
        angle=followed.angle,
        speed=followed.speed,
        torque=followed.torque,
        stiffness=stiffness,
        damping=damping,
        limit=get_limits(robot, "torque"),
        step=turn / (options.sensors.motor_counts or np.inf),
        period=options.period,
        substeps=elastic_plant.count_substeps(library, stated, poses, options.period),
        parts=_PARTS,
        q=desired[0],
        theta=desired[0] + phi,
        play=play,
    )
    log, backend, notices = elastic_plant.simulate_plant(library, plant, order, elements)
    # Whether it went out of control.
    reach = compute_reach(robot, desired)
    lost = ~((np.abs(log.q) < reach) & (np.abs(log.theta) < reach))
    lost[log.ticks :] = True
    if np.any(lost):
        tick = int(np.flatnonzero(np.any(lost, axis=1))[0])
        raise SolverError(describe_runaway(robot, lost[tick], tick, options.period, bandwidth))
    if not reference:
        poses = desired[:: max(1, len(desired) // 50)]
        loads = np.abs(library.evaluate("gravity", poses, stated.beta)[0]).max(axis=0)
        check_following(robot, log.q, desired, log.torque, loads)
    if curves:
        rigid_plant.check_friction_at_speeds(curves, library.card.joints, log.dtheta)
    kinetic, potential = map(np.ravel, library.evaluate("energy", log.q, log.dq, stated.beta))
    spin, work = 0.5 * (stated.rotor * log.dtheta**2).sum(axis=1), log.work.sum(axis=1)
    losses = (log.friction + (log.elastic + log.damped)).sum(axis=1)
    gap, energy_gap = check_balance(kinetic, potential, spin, work, losses)
    run = ElasticRun(
        recording=Recording(
            time=time,
            position=log.q,
            motor_position=log.theta,
            torque=log.torque,
            source=f"simulated: {robot.name}, {trajectory.source}",
            simulated=robot.values_signature,
            notices=(*notices, *describe_saturation(robot, log.torque, order.limit)),
        ),
        q=log.q,
        dq=log.dq,
        theta=log.theta,
        dtheta=log.dtheta,
        desired=desired,
        torque=log.torque,
        joint_torque=log.spring,
        friction=log.friction,
        gap=gap,
        energy_gap=energy_gap,
        turn=turn,
        values=stated,
        backend=backend,
    )
    return replace(run, recording=observe(run, options.sensors, rng))


def check_sensor_options(robot: Robot, sensors: SimulateOptions) -> None:
    """Refuse, by a UsageError, a delay or an offset between encoders for a robot without elastic joints."""
    if not any(robot.elastic) and (sensors.delay or sensors.offset):
        text = f"--delay and --offset are between motor and link encoders, and {robot.name} has no elastic "
        text += "joint; leave them out"
        raise UsageError(Notice(code="usage.rigid-sensors", text=text))


def simulate_log(
    robot: Robot, library: Library, motion: ReferenceMotion, options: SimulateOptions, rng: Generator
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
    elastic = build_clean_options() if options.clean else build_noisy_options()
    order = replace(
        elastic if any(robot.elastic) else ExperimentOptions(controller=robot.controller),
        bandwidth=options.bandwidth,
        stiffness=None if options.stiffness is None else tuple(map(float, options.stiffness)),
        damping=None if options.damping is None else tuple(map(float, options.damping)),
    )
    order = replace(order, period=options.control_period or order.period)
    if not any(robot.elastic):
        noise = 0.0 if options.clean else _NOISE if options.noise is None else options.noise
        sensors = elastic.sensors if options.clean else SensorOptions(torque_noise=(noise,))
        run = simulate_experiment(robot, library, motion, replace(order, sensors=sensors), rng)
        return run, {"noise": noise, "controller": asdict(run.controller)}
    sensors = replace(order.sensors, delay=options.delay, link_offset=(options.offset,))
    if options.noise is not None and not options.clean:
        sensors = replace(sensors, torque_noise=(options.noise,), relative_noise=(0.0,))
    found = simulate_elastic(robot, library, motion, replace(order, sensors=sensors), rng)
    return found, {
        "noise": sensors.torque_noise[0],
        "relative_noise": sensors.relative_noise[0],
        "delay": options.delay,
        "offset": options.offset,
        "largest_torsion": abs(found.phi).max(axis=0).tolist(),
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
        UsageError: only some of its joints are elastic, or a joint has no motor.
    """
    refuse_passive_joints(robot, "no controller makes them follow a trajectory")
    if any(robot.elastic):
        elastic_plant.refuse_rigid_joints(robot)
    lacking = [f"joint '{joint.name}': {gap}" for joint in robot.joints for gap in _list_gaps(joint)]
    lacking += [f"coupling '{one.name}': {gap}" for one in robot.couplings for gap in _list_gaps(one)]
    if lacking:
        text = f"cannot be simulated, these values are not stated: {'; '.join(lacking)}"
        raise RobotError(Notice(code="robot.no-values", text=text, file=robot.path))
