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
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.codegen import Library, RigidExperiment
from symid.errors import Notice, SolverError, UsageError
from symid.excitation import ReferenceMotion
from symid.logs import Recording
from symid.robot import Controller, JointKind, Robot
from symid.simulation.rigid_plant import (
    RigidPlant,
    check_friction_at_speeds,
    quantise,
    simulate_rigid_plant,
)


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


def check_sensors(sensors: SensorOptions, size: int) -> None:
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


def add_torque_noise(torque: FloatArray, sensors: SensorOptions, rng: np.random.Generator) -> FloatArray:
    """Return `torque` (N, n) with white noise; absolute and relative noise are independent sources."""
    relative = np.array(sensors.relative_noise) * np.sqrt((torque**2).mean(axis=0))
    deviation = np.hypot(np.array(sensors.torque_noise), relative)
    noisy: FloatArray = torque + deviation * rng.normal(size=torque.shape)
    return noisy


BANDWIDTH, PERIOD, _VELOCITY_FILTER = 12.0, 1e-3, 150.0
"""Hz, s and Hz, of control where nobody states them."""
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


def build_times(
    robot: Robot,
    library: Library,
    trajectory: ReferenceMotion,
    *,
    duration: float | None,
    period: float,
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
    if not (finite and period > 0.0 and duration >= 2.0 * period):
        problems.append(
            f"duration {duration:g} s, period {period:g} s: the period must be positive, with two periods at "
            "least"
        )
    if problems:
        raise UsageError(*(Notice(code="usage.experiment", text=text) for text in problems))
    return freeze(np.arange(round(duration / period) + 1) * period)


def compute_inertias(robot: Robot, mass: FloatArray) -> FloatArray:
    """Return 1 / (M^-1)_jj (K, n) over M (K, n, n): what a joint feels, others free; refuse a singular M."""
    if not np.all(np.linalg.eigvalsh(mass) > 0.0):
        text = (
            f"robot {robot.name!r} cannot be simulated: its mass matrix is singular, a joint moves without "
            "inertia; give every moved link a mass with an inertia, or its drive a rotor_inertia"
        )
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


_NEAR_ENOUGH = (1.0, 0.5)
"""Rad and m by which a joint may miss its reference, however little it is asked to move."""


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
        bound = (
            f"its torque limit is {limit:g} {force}, reached during {100 * share:.1f} % of the run; raise it "
            "in the robot file, lighten the links, slow the motion down (--scale)"
        )
        weak = "its gains are too low for that; raise --bandwidth or --stiffness and --damping"
        text = (
            f"the controller did not hold joint {joint.name!r}: it was up to {gap[number]:.3g} {unit} from "
            f"its reference, which moves by {np.ptp(desired[:, number]):.3g} {unit}; its weight along the "
            f"reference takes up to {weight[number]:.3g} {force}, and {bound if share else weak}, or choose "
            "another motion (--trajectory)"
        )
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
    text = (
        f"the controlled robot became unstable at t = {tick * period:g} s, at joint "
        f"{', '.join(map(repr, names))}; lower {lower}the gains (--stiffness, --damping), shorten --period "
        f"({period:g} s), slow the motion down (--scale), or give links with mass an inertia{limited}"
    )
    return Notice(code="simulate.unstable", text=text)


_GAIN_SAMPLES = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentOptions:
    """How an experiment is run; times in s, frequencies in Hz.

    Args:
        duration: None for the trajectory's own.
        period: of control and log.
        bandwidth: of gains with critical damping at the joint's effective inertia; None for 12 Hz, or less
            where the sampled loops would not be stable, or for the gains of a shipped elastic robot.
        stiffness, damping: Kp, Kd of each joint in place of gains by bandwidth; both, or none, of motors.
        sensors: what controller and log read.
        controller: of a rigid robot, its gains, where neither they nor a bandwidth are given, and its filter;
            a constant torque that it does not state is the weight at the first pose.
        step: longest Runge-Kutta step of an elastic robot; fast springs shorten it. parts: into which it is
            cut where a spring changes its slope.
        control_counts: of the motor encoders in the loop, per turn; None for perfect ones.
    """

    duration: float | None = None
    period: float = PERIOD
    bandwidth: float | None = None
    stiffness: tuple[float, ...] | None = None
    damping: tuple[float, ...] | None = None
    sensors: SensorOptions = field(default_factory=SensorOptions)
    controller: Controller | None = None
    step: float = 1e-4
    parts: int = 16
    control_counts: float | None = None


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
        controller: what the robot was controlled by. backend: "c" or "python", of the plant.
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
    backend: str

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
        SolverError: the controlled robot is unstable or too light, is not held near its reference, chatters
            without end, or has friction that is too steep.
    """
    names = [joint.name for joint, elastic in zip(robot.axes, robot.elastic, strict=True) if elastic]
    if names:
        text = (
            f"robot {robot.name!r} has elastic joints ({', '.join(names)}); simulate it as an elastic robot"
        )
        raise UsageError(Notice(code="usage.elastic-robot", text=text))
    known = options.controller or options
    times = build_times(
        robot,
        library,
        trajectory,
        duration=options.duration,
        period=options.period,
        gains={
            "stiffness": options.stiffness or known.stiffness,
            "damping": options.damping or known.damping,
        },
    )
    plant = RigidPlant(library, speeds=get_limits(robot, "velocity"))
    check_sensors(options.sensors, robot.freedom)
    encoder = get_encoder_turns(robot) / (options.sensors.counts_per_turn or np.inf)
    desired, speeds, _ = trajectory.evaluate(times)
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
        measured=quantise(desired[0], encoder),
        velocity=np.zeros(plant.size),
    )
    while True:
        ran = simulate_rigid_plant(library, plant, order)
        log = ran.log
        if log.end == "away":
            far = np.abs(log.q[-1] - desired[len(log.q) - 1])
            gone = ~((far < order.reach) & np.isfinite(log.dq[-1]))
            raise SolverError(describe_runaway(robot, gone, len(log.q) - 1, order.period, bandwidth))
        kinetic, potential = (
            part.reshape(-1) for part in library.evaluate("energy", log.q, log.dq, plant.beta)
        )
        stored = np.zeros(len(log.q))
        if plant.bristles is not None:
            stored = plant.bristles.compute_energy(log.z)
        try:
            check_balance(kinetic, potential, log.work, log.lost + stored)
        except SolverError:
            if order.controlled or plant.is_checked:
                raise
            # Steps as long as their error allows.
            order = replace(order, controlled=True)
        else:
            break
    check_friction_at_speeds(plant.friction, library.card.joints, log.dq)
    torque = np.concatenate([log.torque[:-1], log.torque[-2:-1]])
    poses = desired[np.linspace(0, len(desired) - 1, _GAIN_SAMPLES).astype(np.int64)]
    weight = np.abs([plant.compute_weight(pose) for pose in poses]).max(axis=0)
    check_following(robot, log.q, desired, torque, weight)
    # The mean of the torques before and after each tick; nothing was held before the first.
    logged = torque.copy()
    logged[1:] = 0.5 * (torque[1:] + torque[:-1])
    return SimulationRun(
        recording=Recording(
            time=times,
            position=quantise(log.q, encoder),
            torque=add_torque_noise(logged, options.sensors, rng),
            reference=desired,
            reference_velocity=speeds,
            source=f"simulated: {robot.name}, {trajectory.source}",
            notices=(*notices, *ran.notices, *describe_saturation(robot, torque, order.limit)),
        ),
        q=log.q,
        dq=log.dq,
        desired=desired,
        torque=torque,
        kinetic=kinetic,
        potential=potential,
        work=log.work,
        dissipation=log.lost,
        stored=stored,
        events=log.events,
        controller=law,
        backend=ran.backend,
    )


def _compute_blend(law: Controller, period: float) -> float:
    cutoff = law.velocity_filter
    return 1.0 if cutoff is None else 1.0 - float(np.exp(-2.0 * np.pi * cutoff * period))


_MARGIN = 1.25
"""Factor on the gains with which every sampled loop must still be stable."""
_LOWER, _LEAST_BANDWIDTH = 0.8, 0.1


def _is_stable(plant: RigidPlant, mass: FloatArray, law: Controller, period: float) -> bool:
    """Return whether the sampled loops at M (K, n, n) are stable, with gains of `_MARGIN` times the law's."""
    blend, size, inverse = _compute_blend(law, period), plant.size, np.linalg.inv(mass)
    position, velocity, known, before = np.split(np.eye(4 * size), 4)
    raw = velocity if law.velocity_source == "sensor" else (position - before) / period
    filtered = blend * raw + (1.0 - blend) * known
    pull = np.diag(law.stiffness) @ position + np.diag(law.damping) @ filtered
    # Exact between ticks: M dv/dt = tau - D v, with D the viscous friction and tau held.
    flow = np.zeros((len(mass), 3 * size, 3 * size))
    flow[:, :size, size : 2 * size] = np.eye(size)
    flow[:, size : 2 * size, size : 2 * size] = -inverse * plant.friction.viscous[1:].min(axis=0)
    flow[:, size : 2 * size, 2 * size :] = inverse
    after = scipy.linalg.expm(period * flow)[:, : 2 * size]
    free, pulled = np.split(after, [2 * size], axis=2)
    moved = free @ np.eye(2 * size, 4 * size) - _MARGIN * pulled @ pull
    rest = np.broadcast_to(np.vstack([filtered, position]), (len(mass), 2 * size, 4 * size))
    return bool(np.abs(np.linalg.eigvals(np.concatenate([moved, rest], axis=1))).max() < 1.0)


def _complete_controller(
    robot: Robot, library: Library, plant: RigidPlant, desired: FloatArray, options: ExperimentOptions
) -> tuple[Controller, float | None, tuple[Notice, ...]]:
    """Return the law, its bandwidth (None of stated gains) and notices; others are of critical damping."""
    poses = desired[np.linspace(0, len(desired) - 1, _GAIN_SAMPLES).astype(np.int64)]
    (mass,) = library.evaluate("mass_matrix", poses, plant.beta)
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
    bandwidth, lowest = options.bandwidth or BANDWIDTH, inertias.min(axis=0)
    first = build(bandwidth, inertias.mean(axis=0), np.zeros(plant.size))
    if options.stiffness and options.damping:
        return first, None, ()
    if _is_stable(plant, mass, first, options.period):
        return first, bandwidth, ()
    viscous = plant.friction.viscous[1:].min(axis=0)
    found = build(bandwidth, lowest, viscous)
    while options.bandwidth is None and not _is_stable(plant, mass, found, options.period):
        bandwidth *= _LOWER
        if bandwidth < _LEAST_BANDWIDTH:
            return first, BANDWIDTH, ()
        found = build(bandwidth, lowest, viscous)
    stable = options.bandwidth is None or _is_stable(plant, mass, found, options.period)
    asked = options.bandwidth or BANDWIDTH
    joint = int(np.argmax(inertias.max(axis=0) / lowest))
    (before, after), name = ([law.stiffness[joint] for law in (first, found)], robot.axes[joint].name)
    change = (
        f"was lowered from {asked:g} Hz to {bandwidth:.3g} Hz" if bandwidth < asked else f"is {asked:g} Hz"
    )
    result = "at which the loops are stable at all poses of the motion"
    if not stable:
        result = "at which the loops may be unstable all the same at some pose of the motion"
    text = (
        f"the bandwidth of the controller {change}, with gains of the lowest inertia along the motion in "
        f"place of the mean, and of viscous friction, {result}: the inertia that joint {name!r} feels, "
        f"{lowest[joint]:.2g} to {inertias[:, joint].max():.2g} kg m^2 or kg, varies most, and its stiffness "
        f"is {after:.3g} instead of {before:.3g} N m/rad or N/m. A shorter --period allows more; --bandwidth "
        "or --stiffness and --damping set other gains"
    )
    notice = Notice(code="simulate.bandwidth", text=text)
    return found, bandwidth, (notice,)
