"""Arms drawn at random, three plants that are not symid's, sensors, and the logs that `judge.py` identifies.

Generator -> `Chain` (truth) -> motion -> `States` by a plant -> sensors -> `Run`; with its robot file a `Sample`.

    mujoco     MJCF, RK4, position servos, friction of its constraint solver (smooth to about the width)
    pinocchio  aba, RK4 in steps of a quarter millisecond, sampled PD with gravity, friction Fc tanh(dq / width)
    own        `friction_arm.c`: another recursion, RK4, the same controller; a width of 0 sticks and slips
    follow     inverse dynamics of the own recursion along a motion, at any times: an arm that follows exactly

Supported: revolute chains of one to seven joints, planar and spatial, on any mounting. Not supported: slides,
trees. Needs gcc, `pip install pin mujoco`.
"""

import gzip
import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from friction_arm_truth import build_plant, compute_rigid_torques, run_plant
from simulated_arms import ARMS, CASES, HERE, ROBOTS, Run, build_model, furnish, map_log, simulate

import symid

CONTROL = 1000.0
"""Hz, of controllers and of what plants return."""
BANDWIDTH, DAMPING = 2.0 * np.pi * 8.0, 0.8
DOWN = (0.0, 0.0, -9.81)
STATES = 300
"""Random states: for sizes of rotors and friction, and for true base parameters."""

Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Chain:
    """Truth of an arm whose joints turn about the z axes of their links.

    Args:
        dh: modified Denavit-Hartenberg rows alpha (rad), a, d (m).
        bodies: mass (kg), centre of mass (m), tensor about it (xx xy xz yy yz zz, kg m^2), link axes.
        rotors: kg m^2 on the joint side. viscous: N m s/rad. coulomb: N m. widths: rad/s, 0 for a sign.
        stiffness, damping: of the controller, N m/rad, N m s/rad.
        gravity: of the base frame in truth, m/s^2. stated: the same in the robot file.
    """

    dh: Rows
    bodies: Rows
    rotors: tuple[float, ...]
    viscous: tuple[float, ...]
    coulomb: tuple[float, ...]
    widths: tuple[float, ...]
    stiffness: tuple[float, ...] = ()
    damping: tuple[float, ...] = ()
    gravity: tuple[float, ...] = DOWN
    stated: tuple[float, ...] = DOWN

    @property
    def placements(self) -> tuple[tuple[tuple[float, ...], str], ...]:
        """Return x, y, z, roll, pitch, yaw of every joint on the link before, and its axis."""
        return tuple(
            ((a, -np.sin(alpha) * d, np.cos(alpha) * d, alpha, 0.0, 0.0), "z") for alpha, a, d in self.dh
        )

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.dh)

    def compute_torques(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Return the torques (N, n) of bodies and rotors by the own recursion, without friction."""
        plant = build_plant(self, self.list_friction(), gravity=np.array(self.gravity))
        return compute_rigid_torques(plant, q, dq, ddq)

    def compute_friction(self, dq: np.ndarray) -> np.ndarray:
        """Return the friction (N, n)."""
        width = np.array(self.widths)
        rise = np.where(width > 0.0, np.tanh(dq / np.where(width > 0.0, width, 1.0)), np.sign(dq))
        return np.array(self.viscous) * dq + np.array(self.coulomb) * rise

    def list_friction(self) -> tuple[dict[str, float], ...]:
        """Return the friction of every joint as `build_plant` reads it."""
        pairs = zip(self.viscous, self.coulomb, self.widths, strict=True)
        return tuple({"Fv": viscous, "Fc": dry, "width": width} for viscous, dry, width in pairs)

    def add_payload(self, mass: float, centre: tuple[float, float, float]) -> "Chain":
        """Return the chain with a ball of `mass` (kg) and 3 cm at `centre` (m) of its last link."""
        last = build_body(self.bodies[-1]) + pin.Inertia(mass, np.array(centre), 4e-4 * mass * np.eye(3))
        body = (last.mass, *last.lever, *last.inertia[np.triu_indices(3)])
        return replace(self, bodies=(*self.bodies[:-1], tuple(map(float, body))))


def build_body(body: tuple[float, ...]) -> pin.Inertia:
    """Return Pinocchio's body of mass, centre and tensor."""
    xx, xy, xz, yy, yz, zz = body[4:]
    return pin.Inertia(body[0], np.array(body[1:4]), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def build_chain_model(chain: Chain) -> pin.Model:
    """Return Pinocchio's model with rotors."""
    model = build_model(chain)
    model.gravity.linear = np.array(chain.gravity)
    model.armature = np.array(chain.rotors)
    return model


def compute_with_pinocchio(chain: Chain, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Return the torques (N, n) of bodies and rotors by Pinocchio."""
    model = build_chain_model(chain)
    data = model.createData()
    return np.array([pin.rnea(model, data, *state) for state in zip(q, dq, ddq, strict=True)])


def draw_chain(rng: np.random.Generator, size: int, *, planar: bool, width: float) -> Chain:
    """Return an arm whose links get lighter; rotors and friction are parts of its inertias and torques.

    Rotors are 10 to 50 % of a joint's mean inertia, dry friction and viscous friction at 1 rad/s 4 to 12 % of its
    root mean square torque at random states.
    """
    dh = [(0.0, 0.0, 0.0 if planar else float(rng.uniform(0.1, 0.3)))]
    for _ in range(size - 1):
        turned = not planar and (dh[-1][0] == 0.0 or rng.uniform() < 0.6)
        alpha = float(rng.choice([-1.0, 1.0])) * np.pi / 2.0 if turned else 0.0
        length = float(rng.uniform(0.15, 0.4)) if not turned or rng.uniform() < 0.5 else 0.0
        dh.append((alpha, length, float(rng.uniform(-0.2, 0.3)) if turned else 0.0))
    bodies = []
    for joint in range(size):
        mass = float(rng.uniform(3.0, 6.0) * 0.68**joint)
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        second = turn @ np.diag(rng.uniform(0.02, 0.09, 3) ** 2) @ turn.T
        tensor = mass * (np.trace(second) * np.eye(3) - second)
        centre = rng.uniform((0.02, -0.06, -0.06), (0.15, 0.06, 0.06))
        bodies.append((mass, *centre.tolist(), *tensor[np.triu_indices(3)].tolist()))
    zero, gravity = (0.0,) * size, (0.0, -9.81, 0.0) if planar else DOWN
    plain = {"dh": tuple(dh), "bodies": tuple(bodies), "rotors": zero, "gravity": gravity, "stated": gravity}
    bare = Chain(**plain, viscous=zero, coulomb=zero, widths=zero)
    model = build_chain_model(bare)
    data = model.createData()
    states = rng.uniform(-1.0, 1.0, (3, STATES, size))
    inertia = np.mean([np.diag(pin.crba(model, data, row)) for row in states[0]], axis=0)
    # A planar arm whose axes are horizontal has gravity at every joint, a vertical first axis none.
    torque = np.sqrt(np.mean(compute_with_pinocchio(bare, *states) ** 2, axis=0)) + inertia
    rotor = rng.uniform(0.1, 0.5, size) * inertia
    viscous, dry = rng.uniform(0.04, 0.12, (2, size)) * torque
    found = replace(
        bare, rotors=tuple(rotor), viscous=tuple(viscous), coulomb=tuple(dry), widths=(width,) * size
    )
    return add_controller(found)


def add_controller(chain: Chain) -> Chain:
    """Return the chain with gains of BANDWIDTH and DAMPING for its mean inertias."""
    model = build_chain_model(chain)
    data = model.createData()
    states = np.random.default_rng(0).uniform(-1.5, 1.5, (STATES, chain.size))
    inertia = np.mean([np.diag(pin.crba(model, data, row)) for row in states], axis=0)
    gains = inertia * BANDWIDTH**2, inertia * 2.0 * DAMPING * BANDWIDTH
    return replace(chain, stiffness=tuple(gains[0]), damping=tuple(gains[1]))


def build_case_arm() -> Chain:
    """Return the spatial arm of three joints of which two logs are among the cases: values as they are told.

    Told are kinematics, masses, rotors and friction; centres and tensors are invented.
    """
    bodies = (
        (10.0, 0.02, 0.01, -0.03, 0.12, 0.003, -0.002, 0.11, 0.004, 0.08),
        (8.0, 0.19, 0.01, 0.03, 0.03, 0.004, -0.006, 0.16, 0.002, 0.15),
        (4.0, 0.16, -0.02, 0.02, 0.012, 0.001, 0.002, 0.06, -0.001, 0.055),
    )
    chain = Chain(
        dh=((0.0, 0.0, 0.0), (-np.pi / 2.0, 0.0, 0.1), (0.0, 0.4, 0.0)),
        bodies=bodies,
        rotors=(0.9, 0.8, 0.25),
        viscous=(6.0, 6.0, 3.0),
        coulomb=(6.0, 5.0, 2.5),
        widths=(0.005,) * 3,
    )
    return add_controller(chain)


# Motions.

Motion = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Times (N,) to q, dq, ddq (N, n)."""
MOTIONS = ("waves", "series", "moves")


def draw_motion(
    rng: np.random.Generator, size: int, duration: float, kind: str = "waves", *, speed: float = 2.0
) -> Motion:
    """Return a random motion within 0.7 to 1.3 rad of a pose, of 0.6 to 1 times `speed` (rad/s) at most.

    "waves" are five sines without a common period, "series" harmonics of 0.1 Hz, "moves" go from pose to pose
    with the least jerk, at times with a rest.
    """
    centre, reach = rng.uniform(-0.5, 0.5, size), rng.uniform(0.7, 1.3, size)
    if kind == "moves":
        draft = _draw_moves(rng, size, duration)
    else:
        shape = (size, 5)
        harmonics = np.tile(0.1 * np.arange(1.0, 6.0), (size, 1))
        frequency = harmonics if kind == "series" else np.exp(rng.uniform(np.log(0.08), np.log(0.7), shape))
        waves = rng.uniform(0.3, 1.0, shape) / frequency
        draft = _build_waves(2.0 * np.pi * frequency, waves, rng.uniform(0.0, 2.0 * np.pi, shape))
    q, dq, _ = draft(np.arange(0.0, duration, 0.02))
    least = np.minimum(reach / np.abs(q).max(0), rng.uniform(0.6, 1.0, size) * speed / np.abs(dq).max(0))

    def move(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        q, dq, ddq = draft(time)
        return centre + least * q, least * dq, least * ddq

    return move


def _build_waves(rate: np.ndarray, size: np.ndarray, start: np.ndarray) -> Motion:
    def move(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle = rate * time[:, None, None] + start
        sine, cosine = size * np.sin(angle), size * np.cos(angle)
        return sine.sum(-1), (rate * cosine).sum(-1), -(rate**2 * sine).sum(-1)

    return move


def _draw_moves(rng: np.random.Generator, size: int, duration: float) -> Motion:
    count = round(2.0 * duration) + 4
    poses = rng.uniform(-1.0, 1.0, (count + 1, size))
    width = rng.uniform(0.5, 1.4, count)
    rest = rng.uniform(0.0, 0.3, count) * (rng.uniform(size=count) < 0.3)
    begin = np.concatenate([[0.0], np.cumsum(width + rest)])[:-1]

    def move(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at = np.clip(np.searchsorted(begin, time, side="right") - 1, 0, count - 1)
        share = np.clip((time - begin[at]) / width[at], 0.0, 1.0)[:, None]
        step, pace = poses[at + 1] - poses[at], width[at][:, None]
        rise = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        slope = 30.0 * share**2 * (1.0 - share) ** 2 / pace
        bend = 60.0 * share * (1.0 - share) * (1.0 - 2.0 * share) / pace**2
        return poses[at] + rise * step, slope * step, bend * step

    return move


# Plants.


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """What a plant did: time (N,), exact q, dq, ddq, and tau at the joints (N, n)."""

    time: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    tau: np.ndarray


def _refer(chain: Chain, motion: Motion, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times, and q, dq and nine tenths of the gravity there: what a controller gets."""
    time = np.arange(round(duration * CONTROL)) / CONTROL
    q, dq, _ = motion(time)
    weight = chain.compute_torques(q, np.zeros_like(q), np.zeros_like(q))
    return time, np.hstack([q, dq, 0.9 * weight])


def run_own(chain: Chain, motion: Motion, duration: float, parts: int = 4) -> States:
    """Return what the own plant does at CONTROL Hz; `parts` steps of the integrator a sample."""
    time, reference = _refer(chain, motion, duration)
    plant = build_plant(chain, chain.list_friction(), gravity=np.array(chain.gravity))
    exact = run_plant(plant, reference, parts=parts, rate=CONTROL, held=True)
    return States(time=time, q=exact.q, dq=exact.dq, ddq=exact.ddq, tau=exact.torque)


def run_pinocchio(chain: Chain, motion: Motion, duration: float, parts: int = 4) -> States:
    """Return what Pinocchio's forward dynamics do at CONTROL Hz under the same controller."""
    time, reference = _refer(chain, motion, duration)
    model, size = build_chain_model(chain), chain.size
    data = model.createData()
    viscous, dry, width = map(np.array, (chain.viscous, chain.coulomb, chain.widths))
    stiffness, damping = np.array(chain.stiffness), np.array(chain.damping)
    step = 1.0 / CONTROL / parts

    def accelerate(q: np.ndarray, dq: np.ndarray, torque: np.ndarray) -> np.ndarray:
        return pin.aba(model, data, q, dq, torque - viscous * dq - dry * np.tanh(dq / width))

    q, dq = reference[0, :size].copy(), reference[0, size : 2 * size].copy()
    out, before = np.empty((4, len(time), size)), None
    for row, wanted in enumerate(reference):
        torque = (
            wanted[2 * size :] + stiffness * (wanted[:size] - q) + damping * (wanted[size : 2 * size] - dq)
        )
        mean = torque if before is None else (before + torque) / 2.0
        out[:, row] = q, dq, accelerate(q, dq, mean), mean
        before = torque
        for _ in range(parts):
            a1 = accelerate(q, dq, torque)
            v2 = dq + step / 2.0 * a1
            a2 = accelerate(q + step / 2.0 * dq, v2, torque)
            v3 = dq + step / 2.0 * a2
            a3 = accelerate(q + step / 2.0 * v2, v3, torque)
            v4 = dq + step * a3
            a4 = accelerate(q + step * v3, v4, torque)
            q = q + step / 6.0 * (dq + 2.0 * v2 + 2.0 * v3 + v4)
            dq = dq + step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return States(time=time, **dict(zip(("q", "dq", "ddq", "tau"), out, strict=True)))


def run_mujoco(chain: Chain, motion: Motion, duration: float) -> States:
    """Return what MuJoCo does at CONTROL Hz; its servos act all the time, on positions held for half a sample.

    Torques are the mean of those before and behind a new wanted position, accelerations central differences of
    the velocities.
    """
    import mujoco
    from mujoco import rollout

    model = mujoco.MjModel.from_xml_string(write_mjcf(chain, sensors=True))
    time = np.arange(round(duration * CONTROL)) / CONTROL
    fine = np.arange(len(time) * 2) / CONTROL / 2.0
    q, dq, _ = motion(fine)
    wanted = q + np.array(chain.damping) / np.array(chain.stiffness) * dq
    first = np.concatenate([[0.0], q[0], dq[0]])
    _, sensed = rollout.rollout(model, mujoco.MjData(model), first[None], wanted[None])
    position, speed, torque = np.split(sensed[0], 3, axis=1)
    torque[1:] -= np.array(chain.stiffness) * np.diff(wanted, axis=0) / 2.0
    found = position, speed, np.gradient(speed, fine, axis=0), torque
    return States(time=time, **{k: v[::2] for k, v in zip(("q", "dq", "ddq", "tau"), found, strict=True)})


def follow(chain: Chain, motion: Motion, time: np.ndarray) -> States:
    """Return an arm that follows the motion exactly, at any times (N,)."""
    q, dq, ddq = motion(time)
    tau = chain.compute_torques(q, dq, ddq) + chain.compute_friction(dq)
    return States(time=time, q=q, dq=dq, ddq=ddq, tau=tau)


PLANTS = {"own": run_own, "pinocchio": run_pinocchio, "mujoco": run_mujoco}


def verify_plants(seed: int = 1) -> dict[str, dict[str, float]]:
    """Return the errors of each plant by independent formulas, relative to the largest torque or rate.

    inverse: logged torques beside Pinocchio's inverse dynamics and friction (MuJoCo: in fast motion, where its
    friction is dry). power: energy by Pinocchio beside the work of torque less friction. rate: accelerations
    beside differences of the velocities, of median joints and times. halved: change of the torque by half the
    step. recursion: the own inverse dynamics beside Pinocchio's.
    """
    found = {}
    for number, (name, run) in enumerate(PLANTS.items()):
        rng = np.random.default_rng([seed, number])
        chain = draw_chain(rng, 4, planar=False, width=0.005)
        motion = draw_motion(rng, 4, 4.0)
        states = run(chain, motion, 4.0)
        q, dq, ddq, tau = states.q, states.dq, states.ddq, states.tau
        most = np.abs(tau).max()
        rigid = compute_with_pinocchio(chain, q, dq, ddq)
        dry = tau - rigid - np.array(chain.viscous) * dq
        rise = np.sign(dq) if name == "mujoco" else np.tanh(dq / np.array(chain.widths))
        error = np.abs(dry - np.array(chain.coulomb) * rise)
        fast = np.all(np.abs(dq) > 0.1, axis=1) if name == "mujoco" else np.ones(len(q), dtype=bool)
        model = build_chain_model(chain)
        data = model.createData()
        energy = np.array(
            [pin.computeMechanicalEnergy(model, data, a, b) for a, b in zip(q, dq, strict=True)]
        )
        energy += 0.5 * dq**2 @ model.armature * (not _counts_rotors(model))
        power = np.sum((tau - chain.compute_friction(dq)) * dq, axis=1)
        work = np.concatenate([[0.0], np.cumsum(power[1:] + power[:-1]) / 2.0 / CONTROL])
        entry = {
            "inverse": float(np.quantile(error[fast], 0.99 if name == "mujoco" else 1.0) / most),
            "power": float(np.abs(energy - energy[0] - work).max() / np.ptp(energy)),
            "rate": float(
                np.median(np.abs(np.gradient(dq, 1.0 / CONTROL, axis=0) - ddq)) / np.abs(ddq).max()
            ),
            "recursion": float(np.abs(chain.compute_torques(q, dq, ddq) - rigid).max() / most),
        }
        if name != "mujoco":
            halved = run(chain, motion, 1.0, parts=8)
            entry["halved"] = float(np.abs(halved.tau - tau[: len(halved.tau)]).max() / most)
        found[name] = entry
    return found


def _counts_rotors(model: pin.Model) -> bool:
    """Return whether Pinocchio's energy has the rotors in it, which depends on its version."""
    data, still = model.createData(), model.copy()
    still.armature = np.zeros(model.nv)
    q, dq = np.zeros(model.nq), np.ones(model.nv)
    return pin.computeKineticEnergy(model, data, q, dq) != pin.computeKineticEnergy(still, data, q, dq)


# Robot files.


def write_toml(chain: Chain) -> str:
    """Return the robot file of what is known of a chain: kinematics, gravity as stated, and `[log]`."""
    lines = ['name = "chain"', 'convention = "modified"', f"gravity = [{', '.join(map(repr, chain.stated))}]"]
    for number, (alpha, a, d) in enumerate(chain.dh, 1):
        angle = {np.pi / 2.0: '"pi/2"', -np.pi / 2.0: '"-pi/2"'}.get(alpha, repr(float(alpha)))
        lines += ["", "[[joint]]", f'name = "j{number}"', 'kind = "revolute"']
        lines += [f"alpha = {angle}", f"a = {float(a)!r}", f"d = {float(d)!r}"]
    return map_log(furnish("\n".join(lines)))


def write_mjcf(chain: Chain, *, sensors: bool = False) -> str:
    """Return the MJCF of a chain with its true values; gravity as stated, of what is simulated the true one."""
    joints = range(1, chain.size + 1)
    body = ""
    for number in reversed(joints):
        k = number - 1
        (x, y, z, roll, *_), _ = chain.placements[k]
        mass, cx, cy, cz, xx, xy, xz, yy, yz, zz = chain.bodies[k]
        body = (
            f'<body name="l{number}" pos="{x!r} {y!r} {z!r}" quat="{np.cos(roll / 2)!r} {np.sin(roll / 2)!r} 0 0">\n'
            f'<inertial pos="{cx!r} {cy!r} {cz!r}" mass="{mass!r}" fullinertia="{xx} {yy} {zz} {xy} {xz} {yz}"/>\n'
            f'<joint name="j{number}" type="hinge" axis="0 0 1" armature="{chain.rotors[k]!r}" '
            f'damping="{chain.viscous[k]!r}" frictionloss="{chain.coulomb[k]!r}"/>\n{body}</body>\n'
        )
    gravity = chain.gravity if sensors else chain.stated
    # Its friction is full where the deceleration 2 dq / (0.9 t) of its constraint would need more than that.
    times = [
        min(0.02, max(1e-3, 1.8 * width * kp / BANDWIDTH**2 / dry))
        for width, kp, dry in zip(chain.widths, chain.stiffness, chain.coulomb, strict=True)
    ]
    if sensors:
        for number, t in zip(joints, times, strict=True):
            body = body.replace(
                f'<joint name="j{number}"', f'<joint name="j{number}" solreffriction="{t!r} 1"'
            )
    head = f'<option integrator="RK4" timestep="{0.5 / CONTROL}" gravity="{" ".join(map(str, gravity))}"/>'
    tail = ""
    if sensors:
        servos = zip(joints, chain.stiffness, chain.damping, strict=True)
        made = "".join(f'<position joint="j{j}" kp="{kp!r}" kv="{kv!r}"/>' for j, kp, kv in servos)
        kinds = ("jointpos", "jointvel", "jointactuatorfrc")
        read = "".join(f'<{kind} joint="j{joint}"/>' for kind in kinds for joint in joints)
        tail = f"<actuator>{made}</actuator><sensor>{read}</sensor>"
    text = (
        f'<mujoco model="chain"><compiler angle="radian"/>{head}\n'
        f"<worldbody>{body}</worldbody>{tail}</mujoco>"
    )
    return re.sub(r"np\.float64\(([^)]*)\)", r"\1", text)


# Logs.


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """Encoder bits a turn, noise of positions (rad) and of torques (share of each joint's rms), log rate (Hz)."""

    rate: float = 250.0
    bits: int = 19
    position: float = 0.0
    torque: float = 0.02
    early: bool = False
    """Torques are those that begin at a sample, not the mean of those before and behind it."""


def measure(states: States, sensors: Sensors, rng: np.random.Generator) -> Run:
    """Return the log of a plant; its rate must divide that of `states`."""
    pace = (states.time[-1] - states.time[0]) / (len(states.time) - 1)
    every = max(1, round(1.0 / pace / sensors.rate))
    kept = slice(None, None, every)
    step = 2.0 * np.pi / 2**sensors.bits
    exact = np.stack([part[kept] for part in (states.q, states.dq, states.ddq)])
    q = step * np.round((exact[0] + sensors.position * rng.standard_normal(exact[0].shape)) / step)
    tau = states.tau[kept]
    noise = sensors.torque * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    return Run(time=states.time[kept], q=q, tau=tau + noise, states=exact)


@dataclass(frozen=True, kw_only=True)
class Sample:
    """What is identified: a robot file's text and suffix, its logs, the chain in truth where there is one.

    `foreign` are logs of other motions; `settings` are those of the call.
    """

    text: str
    runs: tuple[Run, ...]
    suffix: str = ".toml"
    chain: Chain | None = None
    foreign: tuple[Run, ...] = ()
    settings: str | None = None

    def write(self, folder: Path) -> tuple[Path, list[Path]]:
        """Write robot file and logs, and return their paths."""
        folder.mkdir(parents=True, exist_ok=True)
        robot = folder / f"robot{self.suffix}"
        robot.write_text(self.text, encoding="utf-8")
        return robot, [run.write(folder / f"log_{number}.npz") for number, run in enumerate(self.runs, 1)]


def find_truth(robot: symid.RobotModel, chain: Chain) -> dict[str, float]:
    """Return the true values of all parameters by name: those that give Pinocchio's torques, to 1e-9."""
    stated = replace(chain, gravity=chain.stated)
    states = np.random.default_rng(0).uniform(-2.0, 2.0, (3, STATES, chain.size))
    tau = compute_with_pinocchio(stated, *states)
    matrix = np.asarray(robot.compile().torque_regressor(*states)).reshape(tau.size, -1)
    values, _, rank, _ = np.linalg.lstsq(matrix, tau.ravel())
    error = np.abs(matrix @ values - tau.ravel()).max() / np.abs(tau).max()
    if rank < len(values) or error > 1e-9:
        text = f"the robot file has not the dynamics of the chain: rank {rank}, error {error:.1e}"
        raise SystemExit(text)
    truth = dict(zip(robot.base.names, map(float, values), strict=True))
    for joint, (viscous, dry) in enumerate(zip(chain.viscous, chain.coulomb, strict=True), 1):
        truth |= {f"Fv{joint}": viscous, f"Fc{joint}": dry, f"offset{joint}": 0.0}
    return truth


# Real logs.


def find_files(data: Path) -> dict[str, tuple[Path, list[Path]]]:
    """Return the robot file and the logs of every real set."""
    runs = [data / "double_pendulum" / f"run_{run}.csv" for run in range(1, 5)]
    return {
        "tx40": (ROBOTS / "tx40.toml", [data / "tx40" / "tx40.npz"]),
        "kr300": (ROBOTS / "kr300.toml", [data / "kr300" / f"run_{run}.npz" for run in "abc"]),
        "pendulum": (ROBOTS / "double_pendulum.toml", runs),
        "emps": (ROBOTS / "emps.toml", [data / "emps" / f"DATA_EMPS{end}.mat" for end in ("", "_PULSES")]),
        "ur10": (ROBOTS / "ur10.toml", [data / "bags" / "ur10.db3"]),
        "panda": (ROBOTS / "panda.toml", [data / "bags" / "panda.db3"]),
    }


def read_robot_text(data: Path, name: str) -> str:
    """Return the robot file of a real set; of the UR10's bag with the columns and the unit of its efforts."""
    text = find_files(data)[name][0].read_text(encoding="utf-8")
    return text.replace('"__time"', '"/joint_states/time"') if name == "ur10" else text


@cache
def read_runs(data: Path, name: str) -> tuple[Run, ...]:
    """Return the logs of a real set, in SI units on the joint side."""
    path, logs = find_files(data)[name]
    robot = symid.load(path)
    read = [symid.read_log(log, robot, uneven=True) for log in logs]
    return tuple(Run(time=log.time, q=log.q, tau=log.tau, dq=log.dq) for log in read)


def cut(run: Run, kept: np.ndarray | slice) -> Run:
    """Return the samples `kept`."""
    dq = None if run.dq is None else run.dq[kept]
    states = None if run.states is None else run.states[:, kept]
    return Run(time=run.time[kept], q=run.q[kept], tau=run.tau[kept], dq=dq, states=states)


def map_real(data: Path, name: str, runs: tuple[Run, ...], foreign: tuple[Run, ...] = ()) -> Sample:
    """Return logs of a real set with its robot file, which reads SI units on the joint side."""
    text = furnish(read_robot_text(data, name))
    speeds = all(run.dq is not None for run in runs)
    text = map_log(text, velocity=speeds, prismatic=name == "emps")
    return Sample(text=text, runs=runs, foreign=foreign)


STRETCHES: dict[str, tuple[str, int, float, float]] = {
    "TX40 first half": ("tx40", 0, 0.0, 0.5),
    "TX40 second half": ("tx40", 0, 0.5, 1.0),
    "TX40 first third": ("tx40", 0, 0.0, 1 / 3),
    "TX40 second third": ("tx40", 0, 1 / 3, 2 / 3),
    "TX40 last third": ("tx40", 0, 2 / 3, 1.0),
    **{
        f"KR300 {name}, {half} half": ("kr300", run, begin, begin + 0.5)
        for run, name in enumerate("ABC")
        for half, begin in (("first", 0.0), ("second", 0.5))
    },
    "pendulum 1": ("pendulum", 0, 0.0, 1.0),
    "pendulum 2": ("pendulum", 1, 0.0, 1.0),
    "pendulum 1, first half": ("pendulum", 0, 0.0, 0.5),
    "pendulum 2, second half": ("pendulum", 1, 0.5, 1.0),
    "EMPS first third": ("emps", 0, 0.0, 1 / 3),
    "EMPS second third": ("emps", 0, 1 / 3, 2 / 3),
    "EMPS last third": ("emps", 0, 2 / 3, 1.0),
    "UR10 bag": ("ur10", 0, 0.0, 1.0),
    "Panda bag": ("panda", 0, 0.0, 1.0),
}
"""Clean stretches of real logs: set, log, begin and end as shares of it."""


def take_stretch(data: Path, name: str) -> Sample:
    """Return a stretch by its name; bags are read as they are by `judge.py`."""
    key, number, begin, end = STRETCHES[name]
    run = read_runs(data, key)[number]
    size = len(run.time)
    return map_real(data, key, (cut(run, slice(round(begin * size), round(end * size))),))


# Simulated logs by name.


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How a clean log is simulated."""

    plant: str
    size: int
    planar: bool
    motion: str
    rate: float
    duration: float
    width: float
    seed: tuple[int, ...]
    sensors: Sensors

    @property
    def name(self) -> str:
        """Return what it is in a few words."""
        where, pace = "planar" if self.planar else "spatial", f"{self.rate:g} Hz"
        words = (
            f"{where} {self.size}R, {pace}, {self.duration:g} s, {self.motion}, {1e3 * self.width:g} mrad/s"
        )
        return f"{self.plant} {self.seed[-1]}: {words}"


def draw_recipes(seed: int, count: int = 20) -> tuple[Recipe, ...]:
    """Return recipes of clean logs, the plants in turn."""
    rng = np.random.default_rng([11, seed])
    found = []
    sizes = [2, 3, 4, 5, 6, 7]
    for number in range(count):
        plant = tuple(PLANTS)[number % len(PLANTS)]
        size = sizes[(number // len(PLANTS) + int(rng.integers(2)) * 3) % len(sizes)]
        planar = size <= 3 and bool(rng.uniform() < 0.4)
        longest = 20.0 if plant == "pinocchio" else 60.0
        duration = float(np.round(np.exp(rng.uniform(np.log(max(8.0, 2.5 * size)), np.log(longest)))))
        rate = float(rng.choice([100.0, 125.0, 200.0, 250.0, 500.0, 1000.0]))
        sensors = Sensors(rate=rate, bits=int(rng.integers(17, 21)), torque=float(rng.uniform(0.01, 0.03)))
        widths = {
            "pinocchio": [0.001, 0.002, 0.005, 0.02],
            "own": [0.0, 0.001, 0.005],
            "mujoco": [0.01, 0.03],
        }
        found.append(
            Recipe(
                plant=plant,
                size=size,
                planar=planar,
                motion=str(rng.choice(MOTIONS)),
                rate=rate,
                duration=duration,
                width=float(rng.choice(widths[plant])),
                seed=(12, seed, number),
                sensors=sensors,
            )
        )
    return tuple(found)


@cache
def simulate_recipe(recipe: Recipe) -> Sample:
    """Return the log of a recipe, and one of another motion among `foreign`."""
    rng = np.random.default_rng(recipe.seed)
    chain = draw_chain(rng, recipe.size, planar=recipe.planar, width=recipe.width)
    runs = []
    for _ in range(2):
        motion = draw_motion(rng, recipe.size, recipe.duration, recipe.motion)
        runs.append(measure(PLANTS[recipe.plant](chain, motion, recipe.duration), recipe.sensors, rng))
    if recipe.plant == "mujoco":
        return Sample(text=write_mjcf(chain), suffix=".xml", chain=chain, runs=(runs[0],), foreign=(runs[1],))
    return Sample(text=write_toml(chain), chain=chain, runs=(runs[0],), foreign=(runs[1],))


def unpack(path: Path, folder: Path) -> Path:
    """Return a file without its .gz, unpacked into `folder`."""
    target = folder / path.stem
    target.write_bytes(gzip.decompress(path.read_bytes()))
    return target


def simulate_arm(arm: str, case: str, seed: int) -> Sample:
    """Return 10 s of a published arm that follows its motion exactly (`simulated_arms.py`)."""
    text = map_log(furnish(ARMS[arm].robot.read_text(encoding="utf-8")))
    return Sample(text=text, runs=(simulate(ARMS[arm], CASES[case], seed),))


if __name__ == "__main__":
    print(json.dumps(verify_plants(), indent=1))
    print(HERE)
