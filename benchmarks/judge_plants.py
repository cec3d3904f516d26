"""Arms drawn at random, plants that are not symid's, sensors, and the logs that `judge.py` identifies.

`Recipe`, generator -> `Chain` (truth), motion -> `States` by a plant -> sensors -> `Run` -> `Sample`.

    mujoco     MJCF, RK4, position servos, friction of its constraint solver (smooth to about the width)
    pinocchio  aba, RK4 in steps of half a millisecond, sampled PD with gravity, Fc tanh(dq / width)
    own        `friction_arm.c`: another recursion, RK4, the same controller; a width of 0 sticks and slips
    follow     inverse dynamics of the own recursion along a motion, at any times

Supported: revolute chains of one to seven joints, planar and spatial, on any mounting. Not supported: slides,
trees. Needs gcc, `pip install pin mujoco`.
"""

import gzip
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from friction_arm_truth import build_plant, compute_rigid_torques, run_plant
from simulated_arms import ROBOTS, Run, build_model, furnish, map_log, solve_base

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
        excess: N m, of static over dry friction; falls: rad/s, it vanishes as exp(-(dq / falls)^2).
        stiffness, damping: of the controller, N m/rad, N m s/rad.
        gravity: of the base frame in truth, m/s^2. stated: the same in the robot file.
    """

    dh: Rows
    bodies: Rows
    rotors: tuple[float, ...]
    viscous: tuple[float, ...]
    coulomb: tuple[float, ...]
    widths: tuple[float, ...]
    excess: tuple[float, ...] = ()
    falls: tuple[float, ...] = ()
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
        level = np.array(self.coulomb)
        if self.excess:
            level = level + np.array(self.excess) * np.exp(-((dq / np.array(self.falls)) ** 2))
        return np.array(self.viscous) * dq + level * rise

    def list_friction(self) -> tuple[dict[str, float], ...]:
        """Return the friction of every joint as `build_plant` reads it."""
        pairs = zip(self.viscous, self.coulomb, self.widths, strict=True)
        found = [{"Fv": viscous, "Fc": dry, "width": width} for viscous, dry, width in pairs]
        for joint, excess, fall in zip(found, self.excess, self.falls, strict=False):
            joint |= {"Fe": excess, "vs": fall}
        return tuple(found)

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

    Rotors are 10 to 50 % of a joint's mean inertia, dry friction and viscous friction at 1 rad/s 4 to 12 % of
    its root mean square torque at random states.
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


def turn_gravity(chain: Chain, angle: float, axis: np.ndarray) -> Chain:
    """Return the chain mounted otherwise: gravity turned by `angle` (rad) about `axis` of the base frame."""
    turn = pin.AngleAxis(angle, axis / np.linalg.norm(axis)).toRotationMatrix()
    return add_controller(replace(chain, gravity=tuple(map(float, turn @ np.array(chain.stated)))))


def build_case_arm() -> Chain:
    """Return the spatial arm of three joints of which two logs are among the cases: values as they are told.

    Told are kinematics, masses, rotors and friction; centres and tensors are invented.
    """
    bodies = (
        (10.0, 0.02, 0.01, -0.03, 0.12, 0.003, -0.002, 0.11, 0.004, 0.08),
        (8.0, 0.175, 0.01, 0.03, 0.03, 0.004, -0.006, 0.2, 0.002, 0.19),
        (4.0, 0.2, -0.02, 0.02, 0.015, 0.001, 0.002, 0.1, -0.001, 0.11),
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
MOTIONS = ("waves", "fast", "series", "moves")


def draw_motion(
    rng: np.random.Generator, size: int, duration: float, kind: str = "waves", *, speed: float = 2.0
) -> Motion:
    """Return a random motion within 0.7 to 1.3 rad of a pose, of 0.6 to 1 times `speed` (rad/s) at most.

    "waves" are five sines of 0.08 to 0.7 Hz without a common period, "fast" of 0.7 to 1.05 Hz, "series"
    harmonics of 0.1 Hz, "moves" go from pose to pose with the least jerk, at times with a rest.
    """
    centre, reach = rng.uniform(-0.5, 0.5, size), rng.uniform(0.7, 1.3, size)
    if kind == "moves":
        draft = _draw_moves(rng, size, duration)
    else:
        shape = (size, 5)
        harmonics = np.tile(0.1 * np.arange(1.0, 6.0), (size, 1))
        ends = np.log((0.7, 1.05) if kind == "fast" else (0.08, 0.7))
        frequency = harmonics if kind == "series" else np.exp(rng.uniform(*ends, shape))
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


class States(NamedTuple):
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


def run_own(chain: Chain, motion: Motion, duration: float, parts: int = 2) -> States:
    """Return what the own plant does at CONTROL Hz; `parts` steps of the integrator a sample."""
    time, reference = _refer(chain, motion, duration)
    plant = build_plant(chain, chain.list_friction(), gravity=np.array(chain.gravity))
    exact = run_plant(plant, reference, parts=parts, rate=CONTROL, held=True)
    return States(time, exact.q, exact.dq, exact.ddq, exact.torque)


def run_pinocchio(chain: Chain, motion: Motion, duration: float, parts: int = 2) -> States:
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
    return States(time, *out)


def run_mujoco(chain: Chain, motion: Motion, duration: float) -> States:
    """Return what MuJoCo does at CONTROL Hz; its servos act all the time, on positions held for half of that.

    Torques are the mean of those before and behind a new wanted position, accelerations differences of the
    velocities.
    """
    import mujoco
    from mujoco import rollout

    model = mujoco.MjModel.from_xml_string(write_mjcf(chain, plant=True))
    time = np.arange(round(duration * CONTROL)) / CONTROL
    fine = np.arange(len(time) * 2) / CONTROL / 2.0
    q, dq, _ = motion(fine)
    wanted = q + np.array(chain.damping) / np.array(chain.stiffness) * dq
    first = np.concatenate([[0.0], q[0], dq[0]])
    _, sensed = rollout.rollout(model, mujoco.MjData(model), first[None], wanted[None])
    position, speed, torque = np.split(sensed[0], 3, axis=1)
    torque[1:] -= np.array(chain.stiffness) * np.diff(wanted, axis=0) / 2.0
    return States(time, *(part[::2] for part in (position, speed, np.gradient(speed, fine, axis=0), torque)))


def follow(chain: Chain, motion: Motion, time: np.ndarray) -> States:
    """Return an arm that follows the motion exactly, at any times (N,)."""
    q, dq, ddq = motion(time)
    return States(time, q, dq, ddq, chain.compute_torques(q, dq, ddq) + chain.compute_friction(dq))


PLANTS = {"own": run_own, "pinocchio": run_pinocchio, "mujoco": run_mujoco}


def verify_plants(seed: int) -> dict[str, dict[str, float]]:
    """Return the errors of each plant by independent formulas, relative to the largest torque or rate.

    inverse: logged torques beside Pinocchio's inverse dynamics and friction by its formula (of MuJoCo 99 % of
    fast motion, where its friction is dry). power: energy by Pinocchio beside the work of torques less
    friction. rate: accelerations beside differences of velocities, the median. recursion: the own inverse
    dynamics beside Pinocchio's. halved: change of the torque by half the step.
    """
    found = {}
    for number, (name, run) in enumerate(PLANTS.items()):
        rng = np.random.default_rng([seed, number])
        chain, motion = draw_chain(rng, 4, planar=False, width=0.005), draw_motion(rng, 4, 4.0)
        _, q, dq, ddq, tau = run(chain, motion, 4.0)
        most, rigid = np.abs(tau).max(), compute_with_pinocchio(chain, q, dq, ddq)
        error = np.abs(tau - rigid - chain.compute_friction(dq))
        model = build_chain_model(chain)
        data = model.createData()
        energy = [
            pin.computePotentialEnergy(model, data, a) + b @ pin.crba(model, data, a) @ b / 2.0
            for a, b in zip(q, dq, strict=True)
        ]
        power = np.sum((tau - chain.compute_friction(dq)) * dq, axis=1)
        work = np.concatenate([[0.0], np.cumsum(power[1:] + power[:-1]) / 2.0 / CONTROL])
        rate = np.abs(np.gradient(dq, 1.0 / CONTROL, axis=0) - ddq)
        entry = {
            "inverse": error.max() / most,
            "power": np.abs(energy - energy[0] - work).max() / np.ptp(energy),
            "rate": np.median(rate) / np.abs(ddq).max(),
            "recursion": np.abs(chain.compute_torques(q, dq, ddq) - rigid).max() / most,
        }
        if name == "mujoco":
            entry["inverse"] = np.quantile(error[np.all(np.abs(dq) > 0.1, axis=1)], 0.99) / most
        else:
            halved = run(chain, motion, 1.0, parts=4).tau
            entry["halved"] = np.abs(halved - tau[: len(halved)]).max() / most
        found[name] = {key: float(value) for key, value in entry.items()}
    return found


# Robot files.


def write_toml(chain: Chain) -> str:
    """Return the robot file of what is known of a chain: kinematics, gravity as stated, and `[log]`."""
    lines = ['name = "chain"', 'convention = "modified"', f"gravity = [{', '.join(map(repr, chain.stated))}]"]
    for number, (alpha, a, d) in enumerate(chain.dh, 1):
        angle = {np.pi / 2.0: '"pi/2"', -np.pi / 2.0: '"-pi/2"'}.get(alpha, repr(float(alpha)))
        lines += ["", "[[joint]]", f'name = "j{number}"', 'kind = "revolute"']
        lines += [f"alpha = {angle}", f"a = {float(a)!r}", f"d = {float(d)!r}"]
    return map_log(furnish("\n".join(lines)))


def write_mjcf(chain: Chain, *, plant: bool = False) -> str:
    """Return the MJCF of a chain with its true values; of the `plant` with true gravity, servos and sensors.

    Friction of MuJoCo is full where the deceleration 2 dq / (0.9 t) of its constraint would need more.
    """
    body, servos, sensors = "", "", ""
    for k in reversed(range(chain.size)):
        name, ((x, y, z, roll, *_), _) = f"j{k + 1}", chain.placements[k]
        mass, cx, cy, cz, xx, xy, xz, yy, yz, zz = chain.bodies[k]
        inertia, kp = chain.stiffness[k] / BANDWIDTH**2, chain.stiffness[k]
        t = min(0.02, max(1e-3, 1.8 * chain.widths[k] * inertia / chain.coulomb[k]))
        rise = f' solreffriction="{t} 1"' if plant else ""
        body = (
            f'<body name="l{k + 1}" pos="{x} {y} {z}" quat="{np.cos(roll / 2)} {np.sin(roll / 2)} 0 0">\n'
            f'<inertial pos="{cx} {cy} {cz}" mass="{mass}" fullinertia="{xx} {yy} {zz} {xy} {xz} {yz}"/>\n'
            f'<joint name="{name}" type="hinge" axis="0 0 1" armature="{chain.rotors[k]}" '
            f'damping="{chain.viscous[k]}" frictionloss="{chain.coulomb[k]}"{rise}/>\n{body}</body>\n'
        )
        servos = f'<position joint="{name}" kp="{kp}" kv="{chain.damping[k]}"/>{servos}'
    for kind, joint in product(("jointpos", "jointvel", "jointactuatorfrc"), range(1, chain.size + 1)):
        sensors += f'<{kind} joint="j{joint}"/>'
    gravity = " ".join(map(str, chain.gravity if plant else chain.stated))
    tail = f"<actuator>{servos}</actuator><sensor>{sensors}</sensor>" if plant else ""
    return (
        f'<mujoco model="chain"><compiler angle="radian"/>'
        f'<option integrator="RK4" timestep="{0.5 / CONTROL}" gravity="{gravity}"/>\n'
        f"<worldbody>{body}</worldbody>{tail}</mujoco>"
    )


# Logs.


@dataclass(frozen=True, kw_only=True)
class Sample:
    """What is identified: a robot file's text and suffix, its logs, the chain in truth where there is one."""

    text: str
    runs: tuple[Run, ...]
    suffix: str = ".toml"
    chain: Chain | None = None

    def write(self, folder: Path) -> tuple[Path, list[Path]]:
        """Write robot file and logs, and return their paths."""
        folder.mkdir(parents=True, exist_ok=True)
        robot = folder / f"robot{self.suffix}"
        robot.write_text(self.text, encoding="utf-8")
        return robot, [run.write(folder / f"log_{number}.npz") for number, run in enumerate(self.runs, 1)]


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How a log is simulated.

    Args:
        plant: of `PLANTS`, or "follow". size, planar, width: of the chain, as for `draw_chain`.
        motion, speed, duration: as for `draw_motion`. pace: times as fast as that.
        rate: Hz. bits: of the encoders, a turn. noise: of the torques, share of their rms.
        early: whether torques are half a control period ahead.
        tilt: degrees, and the axis of the base about which it is mounted otherwise.
        resting: joint, from one, that trembles by milliradians with little torque; 0 for none.
        device: Hz at which there are new rows for a logger that reads at `rate`; 0 for every row.
        jitter: share of the period by which stamps are wrong, rms.
        second: "payload" or "arm", which is another one in a second log.
        arm: "drawn", or "rigid3", that of two logs among the cases.
        excess: of static friction, share of the dry one; of the own plant.
    """

    plant: str = "follow"
    size: int = 3
    planar: bool = False
    width: float = 0.002
    motion: str = "waves"
    speed: float = 2.0
    duration: float = 15.0
    pace: float = 1.0
    rate: float = 250.0
    bits: int = 19
    noise: float = 0.02
    early: bool = False
    tilt: tuple[float, ...] = ()
    resting: int = 0
    device: float = 0.0
    jitter: float = 0.0
    second: str = ""
    arm: str = "drawn"
    excess: float = 0.0

    @property
    def words(self) -> str:
        """Return what it is in a few words."""
        where = "planar" if self.planar else "spatial"
        return (
            f"{where} {self.size}R, {self.rate:g} Hz, {self.duration:g} s, {self.motion}, "
            f"{1e3 * self.width:g} mrad/s"
        )


def build_chain(recipe: Recipe, rng: np.random.Generator) -> Chain:
    """Return the arm of a recipe, on its mounting."""
    chain = build_case_arm()
    if recipe.arm == "drawn":
        chain = draw_chain(rng, recipe.size, planar=recipe.planar, width=recipe.width)
    if recipe.excess:
        falls = tuple(rng.uniform(0.05, 0.2, chain.size).tolist())
        chain = replace(chain, excess=tuple(recipe.excess * dry for dry in chain.coulomb), falls=falls)
    if recipe.tilt:
        chain = turn_gravity(chain, np.radians(recipe.tilt[0]), np.array(recipe.tilt[1:]))
    return chain


def simulate_run(recipe: Recipe, chain: Chain, rng: np.random.Generator) -> Run:
    """Return one log of an arm."""
    drawn = draw_motion(rng, chain.size, recipe.duration, recipe.motion, speed=recipe.speed)
    share = np.where(np.arange(chain.size) == recipe.resting - 1, 0.002, 1.0)

    def motion(time: np.ndarray) -> tuple[np.ndarray, ...]:
        q, dq, ddq = drawn(recipe.pace * time)
        return share * q, recipe.pace * share * dq, recipe.pace**2 * share * ddq

    if recipe.plant == "follow":
        rate = recipe.device or recipe.rate
        states = follow(chain, motion, np.arange(round(recipe.duration * rate)) / rate)
    else:
        states = PLANTS[recipe.plant](chain, motion, recipe.duration)
    if recipe.early:
        later = np.vstack([states.tau[1:], states.tau[-1:]])
        states = states._replace(tau=(states.tau + later) / 2.0)
    every = 1 if recipe.plant == "follow" else round(CONTROL / recipe.rate)
    time, *exact, tau = (part[::every] for part in states)
    step = 2.0 * np.pi / 2**recipe.bits
    tau = tau * np.where(np.arange(chain.size) == recipe.resting - 1, 0.02, 1.0)
    tau = tau + recipe.noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    run = Run(time=time, q=step * np.round(exact[0] / step), tau=tau, states=np.stack(exact))
    if recipe.device:
        read = np.arange(round(recipe.duration * recipe.rate)) / recipe.rate
        fresh = np.minimum(np.floor(read * recipe.device + 1e-9).astype(int), len(time) - 1)
        run = replace(cut(run, fresh), time=read)
    if recipe.jitter:
        wrong = recipe.jitter / recipe.rate * np.clip(rng.standard_normal(len(time)), -2.5, 2.5)
        run = replace(run, time=np.sort(time + wrong))
    return run


def simulate_recipe(recipe: Recipe, rng: np.random.Generator) -> Sample:
    """Return the logs of a recipe and their robot file."""
    chain = build_chain(recipe, rng)
    runs = [simulate_run(recipe, chain, rng)]
    if recipe.second:
        other = chain.add_payload(0.8 * chain.bodies[-1][0], (0.1, 0.05, 0.05))
        if recipe.second == "arm":
            other = replace(build_chain(recipe, rng), dh=chain.dh)
        runs.append(simulate_run(recipe, add_controller(other), rng))
    return build_sample(recipe, chain, runs)


def build_sample(recipe: Recipe, chain: Chain, runs: Sequence[Run]) -> Sample:
    """Return logs with the robot file of their plant."""
    if recipe.plant == "mujoco":
        return Sample(text=write_mjcf(chain), suffix=".xml", chain=chain, runs=tuple(runs))
    return Sample(text=write_toml(chain), chain=chain, runs=tuple(runs))


def draw_recipes(seed: int, count: int = 20) -> dict[str, Recipe]:
    """Return recipes of clean logs by name, the plants in turn."""
    rng, found = np.random.default_rng([11, seed]), {}
    widths = {"pinocchio": (0.001, 0.002, 0.005, 0.02), "own": (0.0, 0.001, 0.005), "mujoco": (0.01, 0.03)}
    for number in range(count):
        plant = tuple(PLANTS)[number % len(PLANTS)]
        size = 2 + (number // len(PLANTS) + 3 * int(rng.integers(2))) % 6
        most = 20.0 if plant == "pinocchio" else 60.0
        recipe = Recipe(
            plant=plant,
            size=size,
            planar=size <= 3 and bool(rng.uniform() < 0.4),
            width=float(rng.choice(widths[plant])),
            motion=str(rng.choice(MOTIONS)),
            duration=float(np.round(np.exp(rng.uniform(np.log(max(8.0, 2.5 * size)), np.log(most))))),
            rate=float(rng.choice((100.0, 125.0, 200.0, 250.0, 500.0, 1000.0))),
            bits=int(rng.integers(17, 21)),
            noise=float(rng.uniform(0.01, 0.03)),
        )
        found[f"{plant} {number}: {recipe.words}"] = recipe
    return found


def find_truth(robot: symid.RobotModel, chain: Chain) -> dict[str, float]:
    """Return the true values of all parameters by name: those that give Pinocchio's torques, to 1e-9."""
    stated = replace(chain, gravity=chain.stated)
    states = np.random.default_rng(0).uniform(-2.0, 2.0, (3, STATES, chain.size))
    rigid = solve_base(robot, states, compute_with_pinocchio(stated, *states))
    for joint, (viscous, dry) in enumerate(zip(chain.viscous, chain.coulomb, strict=True), 1):
        rigid |= {f"Fv{joint}": viscous, f"Fc{joint}": dry, f"offset{joint}": 0.0}
    for joint, (excess, fall) in enumerate(zip(chain.excess, chain.falls, strict=True), 1):
        rigid |= {f"Fe{joint}": excess, f"vs{joint}": fall}
    return rigid


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
    """Return the robot file of a real set with rotors and friction, columns named as in the UR10's bag."""
    text = furnish(find_files(data)[name][0].read_text(encoding="utf-8"))
    return text.replace('"__time"', '"/joint_states/time"') if name == "ur10" else text


@cache
def read_runs(data: Path, name: str) -> tuple[Run, ...]:
    """Return the logs of a real set, in SI units on the joint side."""
    path, logs = find_files(data)[name]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / path.name
        file.write_text(read_robot_text(data, name), encoding="utf-8")
        robot = symid.load(file, settings="bag" if name == "ur10" else None)
    read = [symid.read_log(log, robot, uneven=True) for log in logs]
    return tuple(Run(time=log.time, q=log.q, tau=log.tau, dq=log.dq) for log in read)


def cut(run: Run, kept: np.ndarray | slice) -> Run:
    """Return the samples `kept`."""
    dq = None if run.dq is None else run.dq[kept]
    states = None if run.states is None else run.states[:, kept]
    return Run(time=run.time[kept], q=run.q[kept], tau=run.tau[kept], dq=dq, states=states)


_PARTS = {"first half": (0.0, 1 / 2), "second half": (1 / 2, 1.0)}
_THIRDS = {"first third": (0.0, 1 / 3), "second third": (1 / 3, 2 / 3), "last third": (2 / 3, 1.0)}
STRETCHES: dict[str, tuple[str, int, float, float]] = {
    **{f"TX40 {part}": ("tx40", 0, *ends) for part, ends in (_PARTS | _THIRDS).items()},
    **{
        f"KR300 {name}, {part}": ("kr300", run, *ends)
        for (run, name), (part, ends) in product(enumerate("ABC"), _PARTS.items())
    },
    **{f"pendulum {run + 1}": ("pendulum", run, 0.0, 1.0) for run in (0, 1)},
    **{f"pendulum {run + 1}, {part}": ("pendulum", run, *_PARTS[part]) for run, part in enumerate(_PARTS)},
    **{f"EMPS {part}": ("emps", 0, *ends) for part, ends in _THIRDS.items()},
    "UR10 bag": ("ur10", 0, 0.0, 1.0),
    "Panda bag": ("panda", 0, 0.0, 1.0),
}
"""Clean stretches of real logs: set, log, begin and end as shares of it."""


def take_stretch(data: Path, key: str, number: int, begin: float, end: float) -> Sample:
    """Return a stretch of a real log; its robot file reads SI units on the joint side."""
    run = read_runs(data, key)[number]
    run = cut(run, slice(round(begin * len(run.time)), round(end * len(run.time))))
    text = map_log(read_robot_text(data, key), velocity=run.dq is not None, prismatic=key == "emps")
    return Sample(text=text, runs=(run,))


def unpack(path: Path, folder: Path) -> Path:
    """Return a file without its .gz, unpacked into `folder`."""
    target = folder / path.stem
    target.write_bytes(gzip.decompress(path.read_bytes()))
    return target
