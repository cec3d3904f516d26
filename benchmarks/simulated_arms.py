"""Logs of simulated arms whose truth is not symid's: torques by Pinocchio, rotors and friction added here.

Arm, seed -> periodic random motion -> exact torques; with sensors of a case -> a log, true base parameters.

Bodies of the Panda are those of franka_description, of the Z1 those of z1_description (its gripper merged
into the last link), as in example-robot-data. Rotor inertias and friction are invented, of plausible size.
Needs `pip install pin`.
"""

import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

import symid

HERE = Path(__file__).resolve().parent
ROBOTS = HERE.parent / "robots"
RATE = 250.0
DURATION = 10.0
BASE_FREQUENCY = 0.1
HARMONICS = 5
STATES = 400
"""Random states for the true base parameters."""


@dataclass(frozen=True, kw_only=True)
class Arm:
    """Truth of a simulated arm.

    Args:
        robot: the file of its kinematics and limits.
        placements: x, y, z (m), roll, pitch, yaw (rad) of every joint on the link before, and its axis.
        bodies: mass (kg), centre of mass (m), tensor about it (xx xy xz yy yz zz, kg m^2), link axes.
        rotors: kg m^2 on the joint side. viscous: N m s/rad. coulomb: N m.
        lower, upper: rad. speed: rad/s.
    """

    robot: Path
    placements: tuple[tuple[tuple[float, ...], str], ...]
    bodies: tuple[tuple[float, ...], ...]
    rotors: tuple[float, ...]
    viscous: tuple[float, ...]
    coulomb: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    speed: tuple[float, ...]


def read_bodies(text: str) -> tuple[tuple[float, ...], ...]:
    """Return the numbers of a table, one body a line."""
    return tuple(tuple(map(float, line.split())) for line in text.strip().splitlines())


_HALF = np.pi / 2.0
ARMS = {
    "panda": Arm(
        robot=ROBOTS / "panda.toml",
        placements=(
            ((0, 0, 0.333, 0, 0, 0), "z"),
            ((0, 0, 0, -_HALF, 0, 0), "z"),
            ((0, -0.316, 0, _HALF, 0, 0), "z"),
            ((0.0825, 0, 0, _HALF, 0, 0), "z"),
            ((-0.0825, 0.384, 0, -_HALF, 0, 0), "z"),
            ((0, 0, 0, _HALF, 0, 0), "z"),
            ((0.088, 0, 0, _HALF, 0, 0), "z"),
        ),
        bodies=read_bodies(
            """
            4.97068 0.003875 0.002081 -0.04762 0.70337 -0.000139 0.006772 0.70661 0.019169 0.009117
            0.646926 -0.003141 -0.02872 0.003495 0.007962 -0.003925 0.010254 0.02811 0.000704 0.025995
            3.2286 0.027518 0.039252 -0.066502 0.037242 -0.004761 -0.011396 0.036155 -0.012805 0.01083
            3.5879 -0.05317 0.104419 0.027454 0.025853 0.007796 -0.001332 0.019552 0.008641 0.028323
            1.22595 -0.011953 0.041065 -0.038437 0.035549 -0.002117 -0.004037 0.029474 0.000229 0.008627
            1.66656 0.060149 -0.014117 -0.010517 0.001964 0.000109 -0.001158 0.004354 0.000341 0.005433
            1.46552 0.001756 0.001388 0.099156 0.016396 0.000395 -0.00071 0.013973 -0.001054 0.006675
            """
        ),
        rotors=(0.2, 0.2, 0.15, 0.15, 0.1, 0.08, 0.06),
        viscous=(1.0, 0.9, 0.8, 0.9, 0.7, 0.4, 0.4),
        coulomb=(0.55, 0.87, 0.64, 1.28, 0.84, 0.3, 0.56),
        lower=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
        upper=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
        speed=(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    ),
    "z1": Arm(
        robot=HERE / "z1.toml",
        placements=(
            ((0, 0, 0.0585, 0, 0, 0), "z"),
            ((0, 0, 0.045, 0, 0, 0), "y"),
            ((-0.35, 0, 0, 0, 0, 0), "y"),
            ((0.218, 0, 0.057, 0, 0, 0), "y"),
            ((0.07, 0, 0, 0, 0, 0), "z"),
            ((0.0492, 0, 0, 0, 0, 0), "x"),
        ),
        bodies=read_bodies(
            """
            0.673326 0.000002 -0.000252 0.023172 0.001283 0.0 0.0 0.000719 0.000001 0.000839
            1.19132 -0.110126 0.0024 0.001583 0.001021 0.000624 0.000005 0.024295 -0.000002 0.024661
            0.839409 0.106092 -0.005418 0.034764 0.001081 -0.000087 -0.002081 0.009542 -0.000013 0.008866
            0.564046 0.043667 0.003647 -0.001702 0.000316 0.000081 0.000041 0.00093 -0.000006 0.000979
            0.389385 0.031215 0.0 0.006463 0.000176 0.0 0.000057 0.000559 0.0 0.000539
            1.09101 0.082616 0.000988 -0.000619 0.00076 -0.000026 0.000024 0.002489 -0.000001 0.002553
            """
        ),
        rotors=(0.08, 0.12, 0.08, 0.05, 0.04, 0.03),
        viscous=(0.8, 1.2, 0.8, 0.5, 0.4, 0.3),
        coulomb=(1.0, 2.0, 1.0, 0.8, 0.6, 0.5),
        lower=(-2.6179, 0.0, -2.8797, -1.5184, -1.3439, -2.7925),
        upper=(2.6179, 2.967, 0.0, 1.5184, 1.3439, 2.7925),
        speed=(3.1415,) * 6,
    ),
}


# Robot files.

_DRIVE = '[joint.drive]\nrotor_inertia = "unknown"\n'
_FRICTION = '[joint.friction]\nmodel = "viscous_coulomb"\n'
_LOG = """[log]
time = { column = "t", unit = "s" }
position = { columns = ["q"], unit = "POSITION" }
torque = { columns = ["tau"], unit = "TORQUE" }
"""
_VELOCITY = 'velocity = { columns = ["dq"], unit = "POSITION/s" }\n'


def furnish(text: str) -> str:
    """Return a robot file with a rotor and dry and viscous friction at every joint that has none."""
    parts = re.split(r"(?m)^(?=\[)", text)
    blocks: list[list[str]] = [[]]
    for part in parts:
        if part.startswith("[joint."):
            blocks[-1].append(part)
        else:
            blocks.append([part])
    for block in blocks[1:]:
        if block[0].startswith("[[joint]]"):
            have = "".join(block)
            block += [wanted for wanted in (_DRIVE, _FRICTION) if wanted.split("\n", 1)[0] not in have]
    return "\n\n".join(part.strip() for block in blocks for part in block) + "\n"


def map_log(text: str, *, velocity: bool = False, prismatic: bool = False) -> str:
    """Return a robot file whose `[log]` reads t, q, tau (and dq) in SI units on the joint side."""
    parts = [part for part in re.split(r"(?m)^(?=\[)", text) if not re.match(r"\[log[\].]", part)]
    log = (_LOG + (_VELOCITY if velocity else "")).replace("POSITION", "m" if prismatic else "rad")
    return "".join(parts).rstrip() + "\n\n" + log.replace("TORQUE", "N" if prismatic else "N m")


def write_arm_file(arm: Arm, folder: Path) -> Path:
    """Write the robot file that identifies `arm`, with rotors, friction and `[log]`, and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / arm.robot.name
    path.write_text(map_log(furnish(arm.robot.read_text(encoding="utf-8"))), encoding="utf-8")
    return path


# Motion and torques.


@dataclass(frozen=True, eq=False)
class Motion:
    """A finite Fourier series of period 1 / BASE_FREQUENCY: centre (n,), sines and cosines (n, h), rad."""

    centre: np.ndarray
    sines: np.ndarray
    cosines: np.ndarray

    def evaluate(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, dq, ddq, each (N, n), at `time` (N,) s."""
        w = 2.0 * np.pi * BASE_FREQUENCY * np.arange(1, self.sines.shape[1] + 1)
        s, c = np.sin(np.outer(time, w)), np.cos(np.outer(time, w))
        q = self.centre + s @ self.sines.T + c @ self.cosines.T
        dq = (c * w) @ self.sines.T - (s * w) @ self.cosines.T
        return q, dq, -(s * w**2) @ self.sines.T - (c * w**2) @ self.cosines.T


def draw_motion(arm: Arm, rng: np.random.Generator) -> Motion:
    """Return a random series whose harmonics share the speed; it uses nine tenths of the limits."""
    shape = (len(arm.bodies), HARMONICS)
    weight = 1.0 / np.arange(1, HARMONICS + 1)
    sines, cosines = rng.standard_normal(shape) * weight, rng.standard_normal(shape) * weight
    lower, upper = np.array(arm.lower), np.array(arm.upper)
    draft = Motion(np.zeros(len(arm.bodies)), sines, cosines)
    q, dq, _ = draft.evaluate(np.arange(0.0, 1.0 / BASE_FREQUENCY, 0.01))
    share = np.minimum(
        (upper - lower) / 2.0 / np.abs(q).max(axis=0), np.array(arm.speed) / np.abs(dq).max(axis=0)
    )
    scale = 0.9 * share[:, None]
    return Motion((lower + upper) / 2.0, scale * sines, scale * cosines)


_JOINTS = {"x": pin.JointModelRX, "y": pin.JointModelRY, "z": pin.JointModelRZ}


def build_model(arm: Arm) -> pin.Model:
    """Return Pinocchio's model of the rigid bodies, without rotors."""
    model = pin.Model()
    for (values, axis), body in zip(arm.placements, arm.bodies, strict=True):
        place = pin.SE3(pin.rpy.rpyToMatrix(*map(float, values[3:])), np.array(values[:3], dtype=float))
        added = model.addJoint(model.njoints - 1, _JOINTS[axis](), place, f"joint{model.njoints}")
        xx, xy, xz, yy, yz, zz = body[4:]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        model.appendBodyToJoint(added, pin.Inertia(body[0], np.array(body[1:4]), tensor), pin.SE3.Identity())
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    return model


def compute_rigid_torques(arm: Arm, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Return the torques (N, n) of bodies and rotors, without friction, N m."""
    model = build_model(arm)
    data = model.createData()
    rigid = [pin.rnea(model, data, *state) for state in zip(q, dq, ddq, strict=True)]
    return np.array(rigid) + np.array(arm.rotors) * ddq


def compute_friction(arm: Arm, dq: np.ndarray, stribeck: float = 0.0, speed: float = 0.1) -> np.ndarray:
    """Return friction (N, n), N m; dry friction is higher by a share at rest, over `speed` rad/s."""
    dry = np.array(arm.coulomb) * (1.0 + stribeck * np.exp(-((dq / speed) ** 2)))
    return np.array(arm.viscous) * dq + dry * np.sign(dq)


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A log in SI units on the joint side: time (N,), q, tau and, where there is one, dq (N, n).

    `states` (3, N, n) are exact q, dq, ddq, which no log has.
    """

    time: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    dq: np.ndarray | None = None
    states: np.ndarray | None = None

    def write(self, path: Path) -> Path:
        """Write the log as .npz with the columns t, q, tau (and dq), and return the path."""
        more = {} if self.dq is None else {"dq": self.dq}
        np.savez(path, t=self.time, q=self.q, tau=self.tau, **more)
        return path


# Sensors.


@dataclass(frozen=True, kw_only=True)
class Case:
    """What the truth and its sensors are like; ranges are drawn from for every seed.

    Args:
        position: rad, white noise, drawn from this range evenly in its logarithm; (0, 0) for none.
        torque: share of each joint's rms, noise of the torque. memory: s, its time constant; (0, 0): white.
        torque_step: share of each joint's largest torque; encoder: bits a turn; 0 for none.
        jitter: rms share of the period by which stamps are off the grid; values are true at their stamps.
        stribeck: share by which dry friction is higher at rest.
    """

    position: tuple[float, float] = (0.0, 0.0)
    torque: tuple[float, float] = (0.0, 0.0)
    memory: tuple[float, float] = (0.0, 0.0)
    torque_step: tuple[float, float] = (0.0, 0.0)
    encoder: int = 0
    jitter: float = 0.0
    stribeck: float = 0.0


_WHITE = Case(position=(1e-5, 1e-4), torque=(0.01, 0.03))
CASES = {
    "white": _WHITE,
    "coloured": replace(_WHITE, memory=(0.02, 0.1)),
    "quantised": Case(torque_step=(0.007, 0.013), encoder=18),
    "uneven": replace(_WHITE, jitter=0.1),
    "stribeck": replace(_WHITE, stribeck=0.5),
}


def simulate(arm: Arm, case: Case, seed: int) -> Run:
    """Return a log of DURATION s at RATE Hz; the same seed has the same motion in every case."""
    rng = np.random.default_rng([2, seed])
    motion = draw_motion(arm, np.random.default_rng([1, seed]))
    count, size = round(RATE * DURATION), len(arm.bodies)
    time = np.arange(count) / RATE
    if case.jitter:
        time = time + np.clip(case.jitter * rng.standard_normal(count), -0.45, 0.45) / RATE
        time -= time[0]
    q, dq, ddq = motion.evaluate(time)
    tau = compute_rigid_torques(arm, q, dq, ddq) + compute_friction(arm, dq, case.stribeck)
    tau = tau + rng.uniform(*case.torque) * np.sqrt(np.mean(tau**2, axis=0)) * _draw_noise(
        rng, case, (count, size)
    )
    if case.torque_step[1]:
        step = rng.uniform(*case.torque_step) * np.abs(tau).max(axis=0)
        tau = step * np.round(tau / step)
    if case.position[1]:
        q = q + np.exp(rng.uniform(*np.log(case.position))) * rng.standard_normal((count, size))
    if case.encoder:
        step = 2.0 * np.pi / 2**case.encoder
        q = step * np.round(q / step)
    return Run(time=time, q=q, tau=tau)


def _draw_noise(rng: np.random.Generator, case: Case, shape: tuple[int, int]) -> np.ndarray:
    """Return noise of variance one, white or of the first order."""
    noise = rng.standard_normal(shape)
    if not case.memory[1]:
        return noise
    keep = np.exp(-1.0 / (RATE * rng.uniform(*case.memory)))
    fresh = np.sqrt(1.0 - keep**2)
    for row in range(1, shape[0]):
        noise[row] = keep * noise[row - 1] + fresh * noise[row]
    return noise


# True base parameters.


def solve_base(robot: symid.RobotModel, states: np.ndarray, tau: np.ndarray) -> dict[str, float]:
    """Return the base parameters that give torques (N, n) in states q, dq, ddq (3, N, n), to 1e-9."""
    matrix = np.asarray(robot.compile().torque_regressor(*states)).reshape(tau.size, -1)
    values, _, rank, _ = np.linalg.lstsq(matrix, tau.ravel())
    error = np.abs(matrix @ values - tau.ravel()).max() / np.abs(tau).max()
    if rank < len(values) or error > 1e-9:
        text = f"the robot file has not the dynamics of Pinocchio's arm: rank {rank}, error {error:.1e}"
        raise SystemExit(text)
    return dict(zip(robot.base.names, map(float, values), strict=True))


@cache
def find_truth(name: str, file: Path) -> dict[str, float]:
    """Return the true values of all parameters of an arm by name, SI units."""
    arm = ARMS[name]
    states = np.random.default_rng(0).uniform(-2.0, 2.0, (3, STATES, len(arm.bodies)))
    truth = solve_base(symid.load(file), states, compute_rigid_torques(arm, *states))
    for joint, (viscous, dry) in enumerate(zip(arm.viscous, arm.coulomb, strict=True), 1):
        truth |= {f"Fv{joint}": viscous, f"Fc{joint}": dry}
    return truth
