"""An elastic arm under control that shares no code with the models and simulators of symid: a foreign truth.

Arm, hidden models, motions -> `HiddenRun`: what sensors see of it, and the truth behind.

    M(q) ddq + c(q, dq) + dV/dq = tau_J         IA ddtheta + F + (1 + e') tau_J + r = tau
    phi = theta + e - q                         e = A sin(N theta), r = R sin(N theta), N = 100 a turn
    x = phi - clip(phi, -gap, gap)              what springs see

Mass matrix and potential come from the Jacobians of the links at 3 x 5^(n - 1) poses: both are trigonometric
polynomials, which these poses give exactly, and their derivatives with them. The integrator is a leapfrog:
positions, springs and bristles stand at the middles of steps, velocities at their ends, with dry friction by
the implicit midpoint rule.

Supported: serial arms of revolute joints; stops (Kuhnen 2003) with a slip that knows the speed (generalised
Maxwell-slip, Al-Bender, Lampaert and Swevers 2005), knees, a cubic term, backlash, a Maxwell branch, Bouc-Wen
springs (Wen 1976), asymmetric ones (Song and Der Kiureghian 2006); static friction with Stribeck's effect,
LuGre (Canudas de Wit et al. 1995), Dahl (1968); torque ripple, kinematic error, a lag of the torque.
Not supported: friction at the links, contact.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import product
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray, FrozenArrays

PERIOD = 1e-3
"""s, of control and logs."""
ENCODER_STEP = 2.0 * math.pi / 2**20
"""rad."""
WARMING = 30.0
"""s, in which a motor has lost 63 % of the friction that it loses while it warms up."""
_TEETH = 100.0
_BANDWIDTH = 2.0 * math.pi * 12.0
_NEWTON = 3
_LOGGED = ("q", "dq", "theta", "dtheta", "command", "joint_torque")
# The derivatives of 1, cos, sin, cos 2, sin 2: entry (i, j) is what term j gives to term i.
_SLOPE = np.zeros((5, 5))
_SLOPE[[2, 1, 4, 3], [1, 2, 3, 4]] = -1.0, 1.0, -2.0, 2.0
_LOADING, _UNLOADING = 0.75, 0.25
"""beta and gamma of Bouc-Wen: dz = dx (1 - z^2 (beta sign(z dx) + gamma + bias sign z)) / width."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arm(FrozenArrays):
    """A serial arm of revolute joints that hangs at rest at q = 0; SI units, on the joint side.

    Args:
        turn, shift: (n,) rad and m, alpha and a of the modified DH rows (d = theta = 0).
        mass, centre: (n,) kg and m, of each link, its centre on the x axis of its frame.
        inertia: (n, 3) kg m^2, moments about the centre.
        rotor, viscous, coulomb: (n,) IA, Fv and Fc. stiffness: (n,) N m/rad, of the joints.
    """

    name: str
    turn: FloatArray
    shift: FloatArray
    mass: FloatArray
    centre: FloatArray
    inertia: FloatArray
    rotor: FloatArray
    viscous: FloatArray
    coulomb: FloatArray
    stiffness: FloatArray
    gravity: float = 9.81

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.turn)


def _compute_basis(q: FloatArray) -> FloatArray:
    """Return products (B, 3 x 5^(n - 1)) of 1, cos, sin of the first angle, and of 1..sin 2 of the others."""
    waves = np.ones((5, *q.shape))
    waves[1], waves[2] = np.cos(q), np.sin(q)
    waves[3], waves[4] = 2.0 * waves[1] ** 2 - 1.0, 2.0 * waves[1] * waves[2]
    basis: FloatArray = waves[:3, :, 0]
    for k in range(1, q.shape[1]):
        basis = (basis[:, None, :] * waves[None, :, :, k]).reshape(-1, len(q))
    return basis.T


def _compute_pose(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the entries of M, then V, at one pose, from the Jacobians of the links."""
    turn: FloatArray = np.eye(3)
    place: FloatArray = np.zeros(3)
    axes, origins = np.zeros((2, arm.size, 3))
    mass, potential = np.zeros((arm.size, arm.size)), 0.0
    for k in range(arm.size):
        ca, sa, cq, sq = math.cos(arm.turn[k]), math.sin(arm.turn[k]), math.cos(q[k]), math.sin(q[k])
        place = place + turn[:, 0] * arm.shift[k]
        turn = turn @ [[cq, -sq, 0.0], [ca * sq, ca * cq, -sa], [sa * sq, sa * cq, ca]]
        axes[k], origins[k] = turn[:, 2], place
        centre = place + turn[:, 0] * arm.centre[k]
        moving = axes * (np.arange(arm.size) <= k)[:, None]
        linear = np.cross(moving, centre - origins)
        mass += arm.mass[k] * linear @ linear.T + moving @ turn * arm.inertia[k] @ (moving @ turn).T
        potential -= arm.mass[k] * arm.gravity * centre[0]
    return np.append(mass, potential)


def _build_links(arm: Arm) -> FloatArray:
    """Return W so that basis(q) @ W has M (n n), its Christoffel symbols (n n n), dV/dq (n) and V."""
    size = arm.size
    nodes = [2.0 * math.pi * np.arange(count) / count for count in (3, *[5] * (size - 1))]
    poses = np.array(list(product(*nodes)))
    values = np.array([_compute_pose(arm, pose) for pose in poses])
    weights = np.linalg.solve(_compute_basis(poses), values)
    slopes = []
    for joint in range(size):
        matrix: FloatArray = np.eye(1)
        for k in range(size):
            part = _SLOPE if k else _SLOPE[:3, :3]
            matrix = np.asarray(np.kron(matrix, part if k == joint else np.eye(len(part))), np.float64)
        slopes.append(matrix @ weights)
    rates = np.stack([slope[:, :-1].reshape(-1, size, size) for slope in slopes], axis=3)
    # c_ijk = (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) / 2
    symbols = 0.5 * (rates + rates.transpose(0, 1, 3, 2) - rates.transpose(0, 3, 1, 2))
    pull = np.stack([slope[:, -1] for slope in slopes], axis=1)
    columns = (weights[:, :-1], symbols.reshape(len(weights), -1), pull, weights[:, -1:])
    return np.hstack(columns)


def _compute_links(
    links: FloatArray, q: FloatArray, dq: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return M (B, n, n), c + dV/dq (B, n) and V (B,) at q, dq (B, n)."""
    count, size = q.shape
    found = _compute_basis(q) @ links
    square, cube = size**2, size**2 + size**3
    rates = (dq[:, :, None] * dq[:, None, :]).reshape(count, square, 1)
    bias = (found[:, square:cube].reshape(count, size, square) @ rates)[:, :, 0]
    return found[:, :square].reshape(count, size, size), bias + found[:, cube:-1], found[:, -1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HiddenJoints(FrozenArrays):
    """The hidden models of all joints, (n,) each, (n, 3) of stops; zero leaves a part out.

    Args:
        linear, cubic: N m/rad, N m/rad^3; sided: N m/rad, where torsion is positive. gap: rad, half the play.
        stops, thresholds: (n, 3) N m/rad and rad; rise, slip_speed: what the thresholds gain at rest, and the
            rate of torsion (rad/s) over which they lose it; attraction: 1/s, at which slipping stops tend to
            their threshold, infinite for at once.
        knee, slope: N m, and what the slope gains beyond it.
        hysteretic, width, bias: N m/rad and rad of a Bouc-Wen spring, and its asymmetry.
        branch, delay: N m/rad and s, of a Maxwell branch.
        viscous, coulomb, static, stribeck: Fv, Fc, Fs - Fc, and the Stribeck speed. smoothing: rad/s.
        meshing: of |tau_J|, what it adds to dry friction. warm: of dry friction, lost over `WARMING` s.
        bristle, damping: N m/rad and N m s/rad, LuGre in place of a static law where the first is not zero.
        ripple, kinematic: N m and rad, 100 periods a turn. lag: s, first order, of the torque.
        eccentricity: rad, of the link encoder, once a turn. encoder_lag: s, of the same.
    """

    linear: FloatArray
    cubic: FloatArray
    sided: FloatArray
    gap: FloatArray
    stops: FloatArray
    thresholds: FloatArray
    rise: FloatArray
    slip_speed: FloatArray
    attraction: FloatArray
    knee: FloatArray
    slope: FloatArray
    hysteretic: FloatArray
    width: FloatArray
    bias: FloatArray
    branch: FloatArray
    delay: FloatArray
    viscous: FloatArray
    coulomb: FloatArray
    static: FloatArray
    stribeck: FloatArray
    smoothing: FloatArray
    meshing: FloatArray
    warm: FloatArray
    bristle: FloatArray
    damping: FloatArray
    ripple: FloatArray
    kinematic: FloatArray
    lag: FloatArray
    eccentricity: FloatArray
    encoder_lag: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForeignMotion(FrozenArrays):
    """A motion at the ticks of the control: `time` (N,) s; `q`, `dq`, `ddq` (N, n), rad, /s, /s^2."""

    name: str
    time: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HiddenRun(FrozenArrays):
    """One motion of the plant at the ticks, without sensors; (N, n) each.

    Args:
        time: (N,) s. q, dq, theta, dtheta: rad, rad/s, links and motors.
        command: N m, held from each tick to the next. torsion, joint_torque: phi and tau_J, rad and N m.
        work, loss: (N,) J since the start, of the motors, and lost in springs and friction.
        stored: (N,) J, in springs, bristles and ripple.
        kinetic, potential: (N,) J, of links and rotors.
    """

    time: FloatArray
    q: FloatArray
    dq: FloatArray
    theta: FloatArray
    dtheta: FloatArray
    command: FloatArray
    torsion: FloatArray
    joint_torque: FloatArray
    work: FloatArray
    loss: FloatArray
    stored: FloatArray
    kinetic: FloatArray
    potential: FloatArray


class _Spring(NamedTuple):
    """Springs at the middle of a step: torsion, what reaches springs of it, stops, Bouc-Wen state, branch."""

    phi: FloatArray
    x: FloatArray
    stops: FloatArray
    inner: FloatArray
    stretch: FloatArray
    torque: FloatArray
    stored: FloatArray
    loss: FloatArray


def _advance_spring(plant: "_Plant", before: _Spring, phi: FloatArray) -> _Spring:
    """Return springs at the torsion `phi` (R, n), a step later; work = change of `stored` + `loss`.

    What stops hold when the torsion leaves the springs is friction across the gap.
    """
    p, has, step = plant.hidden, plant.has, plant.step
    x = phi - np.minimum(np.maximum(phi, -p.gap), p.gap) if "gap" in has else phi
    dx = x - before.x
    limit = p.thresholds
    if "rise" in has:
        limit = limit * (1.0 + p.rise * np.exp(-np.abs(dx) / (step * p.slip_speed)))[..., None]
    trial = before.stops + dx[..., None]
    level = np.minimum(np.maximum(trial, -limit), limit)
    stops = level + (trial - level) * plant.kept
    pulls, square = p.stops * stops, x * x
    torque, stiffness = p.linear * x, p.linear
    if "cubic" in has:
        torque, stiffness = torque + p.cubic * x**3, stiffness + 0.5 * p.cubic * square
    torque = torque + pulls.sum(axis=-1)
    slip = p.stops * (trial - stops)
    stored = 0.5 * square * stiffness + 0.5 * (pulls * stops).sum(axis=-1)
    loss = (slip * stops).sum(axis=-1)
    if "slope" in has:
        # int knee dx = knee^2 / (2 slope K) + int (knee / K) d(slip), K the stiffness of springs and stops.
        knee = p.slope * (torque - np.minimum(np.maximum(torque, -p.knee), p.knee))
        stored += 0.5 * knee * knee / (plant.whole * np.maximum(p.slope, 1e-9))
        loss += knee / plant.whole * slip.sum(axis=-1)
        torque = torque + knee
    if "sided" in has:
        torque = torque + p.sided * np.maximum(x, 0.0)
        stored += 0.5 * p.sided * np.maximum(x, 0.0) ** 2
    inner, stretch = before.inner, before.stretch
    if "hysteretic" in has:
        part, turning = dx / p.width, _LOADING * np.sign(dx)
        middle = inner + 0.5 * part * (1.0 - _bend(p, inner, turning))
        bent = _bend(p, middle, turning)
        inner = inner + part * (1.0 - bent)
        torque = torque + p.hysteretic * p.width * inner
        stored += 0.5 * p.hysteretic * (p.width * inner) ** 2
        loss += p.hysteretic * p.width * middle * dx * bent
    if "branch" in has:
        # It relaxes for half a step before dx, and for half a step after.
        decay = np.exp(-0.5 * step / p.delay)
        middle = stretch * decay + 0.5 * dx
        stretch = (middle + 0.5 * dx) * decay
        torque = torque + p.branch * stretch
        stored += 0.5 * p.branch * stretch**2
        loss += p.branch * middle**2 * step / p.delay
    if "gap" in has:
        loss += torque * (phi - before.phi - dx)
    return _Spring(phi, x, stops, inner, stretch, torque, stored, loss)


def _bend(p: HiddenJoints, z: FloatArray, turning: FloatArray) -> FloatArray:
    side = np.sign(z)
    bent: FloatArray = z * z * (turning * side + _UNLOADING + p.bias * side)
    return bent


class _Motor(NamedTuple):
    """Motors: speed and acceleration at the end of a step, bristle at its middle; energy lost and stored."""

    speed: FloatArray
    acceleration: FloatArray
    bristle: FloatArray
    mean: FloatArray
    stored: FloatArray
    loss: FloatArray


def _kick_motor(
    plant: "_Plant", before: _Motor, net: FloatArray, pull: FloatArray, time: FloatArray
) -> _Motor:
    """Return the motors after a step under the torque `net` (R, n) without friction, springs that `pull`."""
    p, has, step = plant.hidden, plant.has, plant.step
    speed = before.speed
    guess = speed + 0.5 * step * before.acceleration
    level = p.coulomb
    if "static" in has:
        level = level + p.static * np.exp(-((guess / p.stribeck) ** 2))
    if "meshing" in has:
        level = level + p.meshing * np.abs(pull)
    if "warm" in has:
        level = level * (1.0 - p.warm * (1.0 - np.exp(-time[:, None] / WARMING)))
    bristle, dry, rest = before.bristle, level, np.zeros_like(level)
    stored, lost = rest, rest
    if "bristle" in has:
        stiffness = np.maximum(p.bristle, 1.0)
        rate, steady = stiffness * np.abs(guess) / level, np.sign(speed) * level / stiffness
        # From the middle of the last step to that of this one: the speed at its start is the mean one.
        bristle = steady + (bristle - steady) * np.exp(-stiffness * np.abs(speed) / level * step)
        flow, force = guess - rate * bristle, p.bristle * bristle
        net = net - force - p.damping * flow
        stored, dry = 0.5 * force * bristle, np.where(p.bristle > 0.0, 0.0, level)
        lost = force * rate * bristle + p.damping * flow * guess
    start, drag = speed + plant.share * net, plant.share * dry
    mean = speed
    for _ in range(_NEWTON):
        bend = np.tanh(mean / p.smoothing)
        error = plant.brake * mean - start + drag * bend
        mean = mean - error / (plant.brake + drag * (1.0 - bend * bend) / p.smoothing)
    after = 2.0 * mean - speed
    lost = lost + (p.viscous * mean + dry * np.tanh(mean / p.smoothing)) * mean
    return _Motor(after, (after - speed) / step, bristle, mean, stored, lost * step)


class _PlantState(NamedTuple):
    """The plant at the end of a step; `pull` is ddq at its middle, `applied` the torque of the motors."""

    q: FloatArray
    dq: FloatArray
    pull: FloatArray
    theta: FloatArray
    applied: FloatArray
    spring: _Spring
    motor: _Motor
    sums: FloatArray
    held: FloatArray
    time: FloatArray


class _Plant(NamedTuple):
    """What does not change, of runs side by side.

    Args:
        links: see `_build_links`. step: s. has: which parts any joint of any run has, "teeth" for ripple or
            kinematic errors.
        late: (R, n), what a lag leaves of a torque in half a step; kept: (R, n, 3), what slipping stops keep
            of their excess in a step. whole: (R, n) N m/rad, springs and stops.
        share, brake: (R, n), h / (2 J) and 1 + Fv h / (2 J) of the motors.
    """

    links: FloatArray
    hidden: HiddenJoints
    has: frozenset[str]
    step: float
    late: FloatArray
    kept: FloatArray
    whole: FloatArray
    share: FloatArray
    brake: FloatArray


def _advance_plant(plant: _Plant, s: _PlantState, command: FloatArray) -> _PlantState:
    p, step = plant.hidden, plant.step
    theta = s.theta + 0.5 * step * s.motor.speed
    q: FloatArray = s.q + 0.5 * step * s.dq
    torque = command + (s.applied - command) * plant.late
    if "teeth" in plant.has:
        wave, swing = np.sin(_TEETH * theta), np.cos(_TEETH * theta)
        spring = _advance_spring(plant, s.spring, theta + p.kinematic * wave - q)
        net = torque - (1.0 + _TEETH * p.kinematic * swing) * spring.torque - p.ripple * wave
        held = spring.stored - p.ripple / _TEETH * swing
    else:
        spring = _advance_spring(plant, s.spring, theta - q)
        net, held = torque - spring.torque, spring.stored
    motor = _kick_motor(plant, s.motor, net, spring.torque, s.time)
    mass, bias, _ = _compute_links(plant.links, q, s.dq + 0.5 * step * s.pull)
    pull = np.asarray(np.linalg.solve(mass, (spring.torque - bias)[:, :, None])[:, :, 0], np.float64)
    dq = s.dq + step * pull
    return _PlantState(
        q=q + 0.5 * step * dq,
        dq=dq,
        pull=pull,
        theta=theta + 0.5 * step * motor.speed,
        applied=command + (torque - command) * plant.late,
        spring=spring,
        motor=motor,
        sums=s.sums + np.stack([step * torque * motor.mean, spring.loss + motor.loss]).sum(axis=2),
        held=(held + motor.stored).sum(axis=1),
        time=s.time + step,
    )


def simulate_plant_runs(
    arm: Arm, hidden: Sequence[HiddenJoints], motions: Sequence[ForeignMotion], *, substeps: int = 5
) -> tuple[HiddenRun, ...]:
    """Return runs along `motions`, each with its own `hidden` models, from rest at q = 0, computed together.

    The motors follow by tau = Kp (q_d - theta) + Kd (dq_d - dtheta) + rigid feed-forward, Kd = 2 w J and
    Kp = w^2 J with w = 2 pi 12 Hz, from an encoder of 20 bits, every millisecond of `substeps` steps.
    """
    ticks, step = max(len(motion.time) for motion in motions), PERIOD / substeps
    names = [entry.name for entry in fields(HiddenJoints)]
    p = HiddenJoints(**{name: np.stack([getattr(part, name) for part in hidden]) for name in names})
    share = 0.5 * step / arm.rotor
    has = {name for name in names if getattr(p, name).any()}
    has |= {"teeth"} if has & {"ripple", "kinematic"} else set()
    plant = _Plant(
        links=_build_links(arm),
        hidden=p,
        has=frozenset(has),
        step=step,
        late=np.where(p.lag > 0.0, np.exp(-0.5 * step / np.where(p.lag > 0.0, p.lag, 1.0)), 0.0),
        kept=np.exp(-p.attraction * step)[..., None],
        whole=p.linear + p.stops.sum(axis=-1),
        share=share,
        brake=1.0 + share * p.viscous,
    )
    rest = np.zeros((1, arm.size))
    effective = arm.rotor + np.diag(_compute_links(plant.links, rest, rest)[0][0])
    found = []
    for motion in motions:
        mass, bias, _ = _compute_links(plant.links, motion.q, motion.dq)
        torque = (mass @ motion.ddq[:, :, None])[:, :, 0] + bias
        torque += arm.rotor * motion.ddq + arm.viscous * motion.dq
        last = np.minimum(np.arange(ticks), len(motion.time) - 1)
        found.append((motion.q[last], motion.dq[last], torque[last]))
    # What the motors are asked for, (N, R, n); the last tick is repeated.
    angle, rate, feed = (np.stack(part, axis=1) for part in zip(*found, strict=True))
    zero = np.zeros(p.linear.shape)
    spring = _Spring(zero, zero, np.zeros(p.stops.shape), zero, zero, zero, zero, zero)
    held = -p.ripple.sum(axis=1) / _TEETH
    motor = _Motor(zero, zero, zero, zero, zero, zero)
    sums, shape = np.zeros((2, len(zero))), zero.shape
    begun = np.zeros(len(motions))
    state = _PlantState(zero, zero, zero, zero, zero, spring, motor, sums, held, begun)
    log, energy = np.zeros((6, ticks, *shape)), np.zeros((3, ticks, len(motions)))
    for tick in range(ticks):
        motor, lag = state.motor, angle[tick] - np.round(state.theta / ENCODER_STEP) * ENCODER_STEP
        command = _BANDWIDTH * effective * (_BANDWIDTH * lag + 2.0 * (rate[tick] - motor.speed)) + feed[tick]
        last = state.spring.torque
        log[:5, tick] = state.q, state.dq, state.theta, motor.speed, command
        energy[:2, tick], energy[2, tick] = state.sums, state.held
        state = _advance_plant(plant, state, command)
        # What stands at middles of steps is averaged over the two beside a tick.
        log[5, tick] = 0.5 * (last + state.spring.torque)
        energy[2, tick] = 0.5 * (energy[2, tick] + state.held)
        for _ in range(substeps - 1):
            state = _advance_plant(plant, state, command)
    runs = []
    for number, motion in enumerate(motions):
        ticks = len(motion.time)
        q, dq, theta, dtheta, *_ = log[:, :ticks, number]
        mass, _, potential = _compute_links(plant.links, q, dq)
        moving = (dq[:, None, :] @ mass @ dq[:, :, None])[:, 0, 0]
        run = HiddenRun(
            time=motion.time,
            **dict(zip(_LOGGED, log[:, :ticks, number], strict=True)),
            **dict(zip(("work", "loss", "stored"), energy[:, :ticks, number], strict=True)),
            torsion=theta + p.kinematic[number] * np.sin(_TEETH * theta) - q,
            kinetic=0.5 * (moving + (arm.rotor * dtheta**2).sum(axis=1)),
            potential=potential,
        )
        runs.append(run)
    return tuple(runs)
