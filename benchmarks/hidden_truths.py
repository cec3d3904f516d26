"""Robots that differ from their URDF, and logs of them: bodies, rotors and friction that no file states.

    python benchmarks/hidden_truths.py ARM.urdf MOTION.csv FOLDER EVERY     two logs, one sample in EVERY ms

URDF, seed -> bodies moved by 10 to 30 %, rotors, viscous and dry friction -> log under sampled control.

Dynamics are Pinocchio's (aba with armature); dry friction is solved here, implicitly, so that joints stick.
Supported: trees of revolute, continuous and prismatic joints on a fixed base, a part of them held at zero.
Not supported: floating bases, joints that follow others. Needs `pip install pin`.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

import symid

PERIOD = 1e-3
"""s, of the controller and of the log."""
STEPS = 4
"""Of the integrator in a period."""
SETTLING = 0.5
"""s, at the first pose, before the log begins."""
BANDWIDTH = 2.0 * np.pi * 8.0
DAMPING = 0.8
ENCODER = 2.0 * np.pi / 2**18
"""rad, a step; of a slide as many m."""
TORQUE_NOISE = 0.01
"""Of each joint's root mean square torque."""
SWEEPS = 200
STATES = 200
"""Random states, for sizes of rotors and friction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Dynamics:
    """Bodies by Pinocchio, and beside them rotors (kg m^2), viscous (N m s) and dry friction (N m), (n,)."""

    model: pin.Model
    rotor: np.ndarray
    viscous: np.ndarray
    dry: np.ndarray

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the joints' names in the order of q."""
        return tuple(self.model.names[1:])

    def compute_torques(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Return the torques (N, n) of states (N, n), friction included."""
        data = self.model.createData()
        rigid = [pin.rnea(self.model, data, self.place(a), b, c) for a, b, c in zip(q, dq, ddq, strict=True)]
        return np.array(rigid) + self.rotor * ddq + self.viscous * dq + self.dry * np.sign(dq)

    def place(self, q: np.ndarray) -> np.ndarray:
        """Return Pinocchio's configuration of angles; continuous joints have a cosine and a sine in it."""
        return pin.integrate(self.model, pin.neutral(self.model), np.asarray(q, dtype=float))


def read_model(path: Path, joints: tuple[str, ...]) -> pin.Model:
    """Return the model of a file whose other joints are held at zero."""
    model = pin.buildModelFromUrdf(str(path))
    held = [model.getJointId(name) for name in model.names[1:] if name not in joints]
    # Files with a joint and a link of one name cannot be reduced.
    model = pin.buildReducedModel(model, held, pin.neutral(model)) if held else model
    model.armature = np.zeros(model.nv)
    return model


def move_body(body: pin.Inertia, rng: np.random.Generator) -> pin.Inertia:
    """Return a body with all ten parameters changed by 10 to 30 % of its size, and possible as it was.

    U U' is the pseudo-inertia; U is multiplied by an upper triangle with exp(+-e) on its diagonal and +-e
    above, e in 0.05 .. 0.15, as inertias have the square of U (log-Cholesky: Rucker and Wensing 2022).
    """
    if body.mass <= 0.0:
        return body
    centre, local = np.eye(4), np.diag([0.0, 0.0, 0.0, body.mass])
    centre[:3, 3] = body.lever
    values, axes = np.linalg.eigh(np.trace(body.inertia) / 2.0 * np.eye(3) - body.inertia)
    # Files have bodies that cannot exist: the nearest one that can is moved.
    local[:3, :3] = axes @ np.diag(np.maximum(values, 1e-3 * max(values.max(), 1e-9))) @ axes.T
    flip = np.eye(4)[::-1]
    upper = centre @ flip @ np.linalg.cholesky(flip @ local @ flip) @ flip
    change = rng.uniform(0.05, 0.15, (4, 4)) * rng.choice((-1.0, 1.0), (4, 4))
    upper = upper @ (np.triu(change, 1) + np.diag(np.exp(np.diag(change))))
    pseudo = upper @ upper.T
    mass, lever = pseudo[3, 3], pseudo[:3, 3] / pseudo[3, 3]
    second = pseudo[:3, :3] - mass * np.outer(lever, lever)
    return pin.Inertia(mass, lever, np.trace(second) * np.eye(3) - second)


def hide_truth(path: Path, joints: tuple[str, ...], seed: int) -> Dynamics:
    """Return a robot that the file only resembles.

    Rotors are 5 to 20 % of a joint's mean inertia, dry friction and viscous friction at 1 rad/s 5 to 15 % of
    its root mean square torque at random states.
    """
    rng = np.random.default_rng([1, seed])
    model = read_model(path, joints)
    for number in range(1, model.njoints):
        model.inertias[number] = move_body(model.inertias[number], rng)
    zero = np.zeros(model.nv)
    bare = Dynamics(model=model, rotor=zero, viscous=zero, dry=zero)
    low, high = find_range(model)
    q = rng.uniform(low, high, (STATES, model.nv))
    torque = np.sqrt(np.mean(bare.compute_torques(q, *rng.uniform(-1.0, 1.0, (2, *q.shape))) ** 2, axis=0))
    data = model.createData()
    inertia = np.mean([np.diag(pin.crba(model, data, bare.place(row))) for row in q], axis=0)
    torque += inertia
    rotor = rng.uniform(0.05, 0.2, model.nv) * inertia
    viscous, dry = rng.uniform(0.05, 0.15, (2, model.nv)) * torque
    return replace(bare, rotor=rotor, viscous=viscous, dry=dry)


def find_range(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and largest position of each joint, +-pi where the file has none."""
    low, high = np.full(model.nv, -np.pi), np.full(model.nv, np.pi)
    for number in range(1, model.njoints):
        joint = model.joints[number]
        if joint.nq == 1 and model.lowerPositionLimit[joint.idx_q] < model.upperPositionLimit[joint.idx_q]:
            low[joint.idx_v] = max(-np.pi, model.lowerPositionLimit[joint.idx_q])
            high[joint.idx_v] = min(np.pi, model.upperPositionLimit[joint.idx_q])
    return low, high


def draw_motion(model: pin.Model, rng: np.random.Generator, *, duration: float = 10.0) -> np.ndarray:
    """Return q, dq, ddq (3, N, n) of a random series of five harmonics within nine tenths of the limits."""
    time = np.arange(round(duration / PERIOD) + 1) * PERIOD
    rate = 2.0 * np.pi / duration * np.arange(1, 6)
    low, high = find_range(model)
    speed = np.minimum(np.where(model.velocityLimit > 0.0, model.velocityLimit, 2.0), 2.0)
    turn = np.outer(time, rate)
    a, b = rng.standard_normal((2, model.nv, 5)) / np.arange(1, 6)
    # At rest at the start, where the log begins.
    a -= (a @ rate)[:, None] * rate / (rate @ rate)
    q = np.sin(turn) @ a.T + np.cos(turn) @ b.T
    dq = (np.cos(turn) * rate) @ a.T - (np.sin(turn) * rate) @ b.T
    ddq = -(np.sin(turn) * rate**2) @ a.T - (np.cos(turn) * rate**2) @ b.T
    middle = (q.max(axis=0) + q.min(axis=0)) / 2.0
    scale = 0.9 * np.minimum((high - low) / np.ptp(q, axis=0), speed / np.abs(dq).max(axis=0))
    return np.stack(((low + high) / 2.0 + scale * (q - middle), scale * dq, scale * ddq))


def simulate_log(truth: Dynamics, wanted: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time (N,), measured positions and torques (N, n) of the robot along q, dq (2, N, n).

    A controller with a position and a velocity gain reads the true state once a period and holds its torque;
    the torque that is measured at a sample is the mean of those before and behind it.
    """
    plant = _Plant(truth, wanted[0, 0])
    inertia = np.diag(pin.crba(plant.model, plant.data, plant.place))
    position, velocity = inertia * BANDWIDTH**2, inertia * 2.0 * DAMPING * BANDWIDTH
    start = np.repeat(wanted[:, :1], round(SETTLING / PERIOD), axis=1)
    start[1] = 0.0
    goal = np.concatenate((start, wanted), axis=1)
    states, torques = np.empty(goal.shape[1:]), np.empty(goal.shape[1:])
    for k, (q, dq) in enumerate(zip(*goal, strict=True)):
        states[k] = plant.q
        torques[k] = position * (q - plant.q) + velocity * (dq - plant.dq)
        plant.advance(torques[k])
    first = start.shape[1]
    measured = (torques[first - 1 : -1] + torques[first:]) / 2.0
    rng = np.random.default_rng([2, seed])
    noise = TORQUE_NOISE * np.sqrt(np.mean(measured**2, axis=0)) * rng.standard_normal(measured.shape)
    time = PERIOD * np.arange(len(measured))
    return time, ENCODER * np.round(states[first:] / ENCODER), measured + noise


class _Plant:
    """State of a robot; a step keeps dry friction within its cone at the end of the step (Moreau)."""

    def __init__(self, truth: Dynamics, q: np.ndarray) -> None:
        self.model = truth.model.copy()
        self.model.armature = truth.rotor
        self.data = self.model.createData()
        self.truth, self.q, self.dq = truth, np.array(q), np.zeros(self.model.nv)
        self.place = truth.place(self.q)
        self.dry = np.zeros(self.model.nv)

    def advance(self, torque: np.ndarray) -> None:
        """Go on by one period under a constant torque."""
        step = PERIOD / STEPS
        for _ in range(STEPS):
            driven = torque - self.truth.viscous * self.dq
            free = self.dq + step * pin.aba(self.model, self.data, self.place, self.dq, driven)
            inverse = pin.computeMinverse(self.model, self.data, self.place)
            inverse = step * (np.triu(inverse) + np.triu(inverse, 1).T)
            self.dq = self._rub(free, inverse)
            self.q = self.q + step * self.dq
            self.place = pin.integrate(self.model, self.place, step * self.dq)

    def _rub(self, free: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        """Return the velocity with dry friction, by projected Gauss-Seidel where joints stick or turn."""
        limit = self.truth.dry
        sliding = -limit * np.sign(self.dq)
        moved = free + inverse @ sliding
        if np.all(moved * sliding < 0.0):
            self.dry = sliding
            return moved
        for _ in range(SWEEPS):
            before = self.dry.copy()
            for k in range(len(limit)):
                speed = free[k] + inverse[k] @ self.dry
                self.dry[k] = min(max(self.dry[k] - speed / inverse[k, k], -limit[k]), limit[k])
            if np.all(np.abs(self.dry - before) <= 1e-9 * limit):
                break
        return free + inverse @ self.dry


def write_log(path: Path, run: tuple[np.ndarray, ...], kinds: list[str], every: int = 1) -> Path:
    """Write time, q, tau as CSV with the columns t, q1.., tau1.. and their units, one sample in `every`."""
    units = [("rad", "N m") if kind == "revolute" else ("m", "N") for kind in kinds]
    heads = ["t [s]", *(f"q{k} [{unit[0]}]" for k, unit in enumerate(units, 1))]
    heads += [f"tau{k} [{unit[1]}]" for k, unit in enumerate(units, 1)]
    table = np.column_stack(run)[::every]
    np.savetxt(path, table, fmt="%.7g", delimiter=",", header=",".join(heads), comments="")
    return path


def read_motion(path: Path) -> np.ndarray:
    """Return q, dq (2, N, n) of a file of `symid excite`."""
    table = np.loadtxt(path, delimiter=",", comments=("#", "t"))
    return np.stack(np.split(table[:, 1:], 3, axis=1)[:2])


def write_logs(
    path: Path, robot: symid.RobotModel, motion: Path, folder: Path, *, seed: int, every: int = 1
) -> tuple[Dynamics, np.ndarray]:
    """Write training.csv, along `motion`, and validation.csv; return truth and second motion (3, N, n).

    Joints of files are in the order of `robot`, those of what is returned in that of the truth.
    """
    names = tuple(joint.name for joint in robot.joints)
    truth = hide_truth(path, names, seed)
    there = [truth.joints.index(name) for name in names]
    kinds = [joint.kind.value for joint in robot.joints]
    wanted = read_motion(motion)[..., np.argsort(there)]
    other = draw_motion(truth.model, np.random.default_rng([3, seed]))
    for number, (name, goal) in enumerate((("training", wanted), ("validation", other[:2]))):
        time, q, tau = simulate_log(truth, goal, 10 * seed + number)
        write_log(folder / f"{name}.csv", (time, q[:, there], tau[:, there]), kinds, every)
    return truth, other


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    urdf, motion_file, target = map(Path, sys.argv[1:4])
    write_logs(urdf, symid.load(urdf), motion_file, target, seed=1, every=int(sys.argv[4]))
