"""A joint that moves slowly and turns back often: is friction with a memory found, and followed at all rows?

    python benchmarks/presliding.py [--draws 5] [--seed 1] [--processes 2]

The plant shares no code with symid: one link under gravity, a controller, and friction of bristles (LuGre) or
of elements that slip and are attracted to their level (generalised Maxwell-slip), Heun's steps of 50 us.
The encoder has 20 bits, the logged torque 1 % of noise. Each row tells what the law that was chosen leaves of
all rows, relative to what the true law leaves along the measured positions, and the same of static laws that
predict rows held out.
"""

import argparse
import concurrent.futures
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

import symid
from symid.identification.friction import extraction
from symid.joint_models import get_law

PERIOD, STEPS, DURATION = 1e-3, 20, 20.0
KINDS = ("lugre", "generalised-maxwell-slip")
ROBOT = """
name = "presliding"
convention = "modified"
gravity = [9.81, 0, 0]
[[joint]]
name = "joint"
kind = "revolute"
friction = { model = "coulomb-viscous" }
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """A link (kg m^2, N m of gravity) and its friction.

    Coulomb and static friction (N m), Stribeck velocity (rad/s), exponent, viscous friction (N m s/rad);
    stiffnesses (N m/rad) of elements and their shares; attraction (N m/s); damping of bristles (N m s/rad).
    """

    kind: str
    inertia: float
    weight: float
    coulomb: float
    static: float
    speed: float
    exponent: float
    viscous: float
    stiffness: np.ndarray
    share: np.ndarray
    attraction: float
    damping: float


class Row(NamedTuple):
    """A draw: the law taken, what it leaves of all rows relative to the true law, and the best static law."""

    kind: str
    draw: int
    law: str
    ratio: float
    static: float


def draw_joint(kind: str, rng: np.random.Generator) -> Joint:
    """Return a joint whose bristles bend by 0.5 to 5 mrad before they slip."""
    coulomb = rng.uniform(0.5, 2.0)
    count = 1 if kind == "lugre" else int(rng.integers(4, 9))
    share = rng.uniform(0.5, 1.5, count)
    share /= share.sum()
    # Deflections at which elements slip; they differ by a factor of twenty.
    bends = np.geomspace(0.4, 8.0, count) if count > 1 else np.ones(1)
    bend = 10.0 ** rng.uniform(-3.3, -2.3)
    return Joint(
        kind=kind,
        inertia=rng.uniform(0.02, 0.1),
        weight=rng.uniform(0.5, 2.0),
        coulomb=coulomb,
        static=coulomb * rng.uniform(1.0, 1.5),
        speed=rng.uniform(0.02, 0.1),
        exponent=rng.choice([1.0, 2.0]),
        viscous=rng.uniform(0.1, 0.5) * coulomb,
        stiffness=coulomb * share / (bend * bends),
        share=share,
        attraction=coulomb * rng.uniform(20.0, 100.0),
        damping=coulomb * rng.uniform(0.002, 0.02),
    )


def draw_reference(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity at the samples: slow sines of all sizes, and larger ones."""
    time = PERIOD * np.arange(round(DURATION / PERIOD))
    position, velocity = np.zeros((2, len(time)))
    for amplitude in 10.0 ** rng.uniform(-3.3, -0.5, 12):
        way = 2.0 * math.pi * min(rng.uniform(0.1, 1.0), rng.uniform(0.02, 0.6) / (2.0 * math.pi * amplitude))
        phase = rng.uniform(0.0, 2.0 * math.pi)
        # Each sine comes and goes.
        middle, width = rng.uniform(0.0, DURATION), rng.uniform(3.0, 8.0)
        hill = np.exp(-(((time - middle) / width) ** 2))
        slope = -2.0 * (time - middle) / width**2 * hill
        position += amplitude * hill * np.sin(way * time + phase)
        velocity += amplitude * (way * hill * np.cos(way * time + phase) + slope * np.sin(way * time + phase))
    # From rest at zero.
    rise = 1.0 - np.exp(-((time / 0.3) ** 3))
    return rise * position, rise * velocity + np.gradient(rise, PERIOD) * position


def compute_friction(joint: Joint, velocity: float, state: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the friction torque, and the rate of the state: deflection, or torques of the elements."""
    fall = math.exp(-((abs(velocity) / joint.speed) ** joint.exponent))
    level = joint.coulomb + (joint.static - joint.coulomb) * fall
    if joint.kind == "lugre":
        rate = velocity - joint.stiffness * abs(velocity) / level * state
        torque = float(joint.stiffness[0] * state[0] + joint.damping * rate[0])
        return torque + joint.viscous * velocity, rate
    most = joint.share * level
    direction = math.copysign(1.0, velocity)
    slips = state * direction >= most
    slipping = direction * joint.attraction * joint.share * (1.0 - state * direction / most)
    rate = np.where(slips, slipping, joint.stiffness * velocity)
    return float(state.sum()) + joint.viscous * velocity, rate


def simulate(joint: Joint, reference: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return position, velocity, torque of the drive and friction at the samples, (N, 4)."""
    found = np.empty((len(reference[0]), 4))
    q = dq = whole = 0.0
    state, step = np.zeros(len(joint.stiffness)), PERIOD / STEPS
    stiff = joint.coulomb / 2e-3
    calm = 2.0 * math.sqrt(stiff * joint.inertia)

    def move(q: float, dq: float, state: np.ndarray, push: float) -> tuple[float, float, np.ndarray]:
        friction, rate = compute_friction(joint, dq, state)
        return dq, (push - friction - joint.weight * math.sin(q)) / joint.inertia, rate

    for tick, (wanted, speed) in enumerate(zip(*map(np.ndarray.tolist, reference), strict=True)):
        whole += 20.0 * stiff * PERIOD * (wanted - q)
        push = stiff * (wanted - q) + calm * (speed - dq) + whole
        found[tick] = q, dq, push, compute_friction(joint, dq, state)[0]
        for _ in range(STEPS):
            one = move(q, dq, state, push)
            two = move(q + step * one[0], dq + step * one[1], state + step * one[2], push)
            q += 0.5 * step * (one[0] + two[0])
            dq += 0.5 * step * (one[1] + two[1])
            state = state + 0.5 * step * (one[2] + two[2])
    return found


def load_robot() -> "symid.Robot":
    """Return the robot that a user would describe: one joint, nothing known of its friction."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "presliding.toml"
        path.write_text(ROBOT, encoding="utf-8")
        return symid.load(path)


def measure_truth(joint: Joint, robot: "symid.Robot", log: "symid.Log") -> float:
    """Return the rms that the true law leaves of all rows, along the positions that were measured."""
    logs = extraction.prepare_joint_logs(robot.library, [log.recording], robot.description.processing)
    samples = extraction.extract_joint(logs, 0).whole
    friction, state, step = np.zeros(samples.count), np.zeros(len(joint.stiffness)), PERIOD / STEPS
    ways = np.diff(samples.position) / PERIOD
    for k, (mean, before, after) in enumerate(
        zip(ways, samples.velocity, samples.velocity[1:], strict=False)
    ):
        for part in range(STEPS):
            # A velocity that changes evenly, and leads to the next position.
            velocity = mean + (after - before) * ((part + 0.5) / STEPS - 0.5)
            _, rate = compute_friction(joint, velocity, state)
            _, later = compute_friction(joint, velocity, state + step * rate)
            state = state + 0.5 * step * (rate + later)
        friction[k + 1] = compute_friction(joint, after, state)[0]
    known = {"J": joint.inertia, "a": joint.weight, "b": 0.0}
    rigid = samples.rows.extra @ [known[name] for name in samples.extra_names]
    return float(np.std(samples.rows.torque - rigid - samples.pass_columns(friction[:, None])[:, 0]))


def observe(kind: str, seed: int, draw: int) -> tuple[Joint, np.ndarray, np.ndarray]:
    """Return a joint and what its sensors show: positions and torques, (N, 1) each."""
    rng = np.random.default_rng([seed, draw, KINDS.index(kind)])
    joint = draw_joint(kind, rng)
    truth = simulate(joint, draw_reference(rng))
    step = 2.0 * math.pi / 2**20
    position, torque = step * np.round(truth[:, :1] / step), truth[:, 2:3]
    return joint, position, torque + 0.01 * np.std(torque) * rng.standard_normal(torque.shape)


def run(kind: str, seed: int, draw: int) -> Row:
    """Return a row of the table."""
    joint, position, torque = observe(kind, seed, draw)
    robot, time = load_robot(), PERIOD * np.arange(len(torque))
    log = symid.build_log(robot, time=time, q=position, tau=torque)
    (found,) = robot.identify_friction([log]).estimate.joints
    static = min(
        (one.held_rms for one in found.selection.trials if one.held_rms and not get_law(one.law).memory),
        default=math.inf,
    )
    true = measure_truth(joint, robot, log)
    return Row(kind, draw, found.estimate.law, found.motion.whole / true, static / true)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, value in (("--draws", 5), ("--seed", 1), ("--processes", 2)):
        parser.add_argument(name, type=int, default=value)
    args = parser.parse_args()
    tasks = [(kind, args.seed, draw) for kind in KINDS for draw in range(args.draws)]
    with concurrent.futures.ProcessPoolExecutor(args.processes) as pool:
        rows = list(pool.map(run, *zip(*tasks, strict=True)))
    for row in rows:
        found = f"{row.ratio:7.3f} times the true law; static {row.static:6.1f}"
        print(f"{row.kind:25} {row.draw:3d}  {row.law:35} {found}")
    print(f"largest {max(row.ratio for row in rows):.3f}")


if __name__ == "__main__":
    main()
