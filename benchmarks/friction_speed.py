"""How long friction and long logs take: processor times of `identify_friction` and `identify`, side by side.

    python benchmarks/friction_speed.py [friction] [long] [--seconds S] [--hour] [--tree FOLDER]...

Makes a log of a simulated Panda at 1 kHz (Pinocchio's torques, another friction in every joint, 1.5 % noise),
and runs each fit in a process of its own, of this tree and of each other `--tree` (a checkout of symid) in
turn. Prints seconds of processor, the laws chosen, and how far results are from those of this tree.

    friction    100 s, law chosen for every joint, from the same rows in all trees
    long        600 s, or an hour with `--hour`: rigid parameters, block by block

Needs `pip install pin`. Regressors are compiled before anything is timed.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
RATE = 1000.0
LENGTHS = {"friction": 100.0, "long": 600.0}
NOISE = 0.015
"""Of each joint's rms torque."""
ENCODER = 2e-6
"""rad, noise of positions."""

_CHILD = """
import json, resource, sys, time
import symid
kind, robot, log = sys.argv[1:]
robot = symid.load(robot)
robot.library
begin = time.process_time()
if kind == "friction":
    fit = robot.identify_friction(log)
    estimates = [entry.estimate for entry in fit.estimate.joints]
    laws = [entry.law for entry in estimates]
    found = {f"{e.joint}.{p.name}": (p.value, p.std) for e in estimates for p in (*e.parameters, *e.extra)}
    trials = [entry.selection.trials for entry in fit.estimate.joints]
    held = [[(one.law, one.held_rms or 0.0) for one in entry] for entry in trials]
else:
    fit = robot.identify(log)
    laws, held = [], []
    found = {entry.name: (entry.value, entry.std) for entry in fit.estimate.parameters}
seconds = time.process_time() - begin
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
print(json.dumps({"seconds": seconds, "peak": peak, "laws": laws, "found": found, "held": held}))
"""

Friction = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _fall(velocity: np.ndarray) -> np.ndarray:
    return np.sign(velocity) * np.exp(-np.abs(velocity) / 0.1)


def list_frictions() -> list[Friction]:
    """Return the friction of each joint, N m, of velocity in rad/s and load in N m."""
    return [
        lambda v, _: 1.0 * v + 0.8 * np.sign(v),
        lambda v, _: np.where(v > 0.0, 0.9 * v + 1.2, 1.1 * v - 0.8) * (v != 0.0),
        lambda v, _: 0.8 * v + np.sign(v) * (0.7 + 0.5 * np.exp(-((v / 0.08) ** 2))) + 0.2,
        lambda v, _: 0.6 * v + np.sign(v) * (0.9 + 0.6 / (1.0 + (v / 0.05) ** 2)),
        lambda v, load: 0.4 * v + np.sign(v) * (0.5 + 0.08 * np.abs(load)),
        lambda v, _: np.sign(v) * (0.3 + 0.5 * np.abs(v) ** 0.6),
        lambda v, _: np.where(v > 0.0, 0.5 * v + 0.4, 0.3 * v - 0.3) + 0.15 * _fall(v),
    ]


_ROWS = """
[processing]
filter_cutoff = 200.0
decimation = {factor = 10, order = 8, ripple_db = 0.05, band = 0.8}
"""
"""Stated, as what is chosen differs between trees."""


def write_log(folder: Path, seconds: float, settings: str = "") -> tuple[Path, Path]:
    """Write robot file, with `settings` at its end, and log, and return their paths."""
    import simulated_arms as arms

    arm = arms.ARMS["panda"]
    robot = arms.write_arm_file(arm, folder)
    with robot.open("a", encoding="utf-8") as file:
        file.write(settings)
    one, two = (arms.draw_motion(arm, np.random.default_rng([5, seed])) for seed in range(2))
    rng, ratio = np.random.default_rng(7), 0.618
    time = np.arange(round(seconds * RATE)) / RATE
    q, dq, ddq, tau = (np.empty((len(time), len(arm.bodies))) for _ in range(4))
    for start in range(0, len(time), 100_000):
        part = slice(start, start + 100_000)
        # Two periods without a common multiple: the motion does not repeat.
        first, second = one.evaluate(time[part]), two.evaluate(ratio * time[part])
        pairs = zip((q, dq, ddq), first, second, strict=True)
        for order, (whole, left, right) in enumerate(pairs):
            whole[part] = 0.5 * left + 0.5 * ratio**order * right
        tau[part] = arms.compute_rigid_torques(arm, q[part], dq[part], ddq[part])
    for joint, friction in enumerate(list_frictions()):
        tau[:, joint] += friction(dq[:, joint], tau[:, joint])
    tau += NOISE * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    q += ENCODER * rng.standard_normal(q.shape)
    return robot, arms.Run(time=time, q=q, tau=tau).write(folder / "log.npz")


def run_fit(kind: str, tree: Path, robot: Path, log: Path) -> dict:
    """Return the answer of a child process that runs the symid of `tree`."""
    environment = os.environ | {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
    call = [sys.executable, "-c", _CHILD, kind, str(robot), str(log)]
    # The second process finds compiled functions.
    warm = [sys.executable, "-c", "import sys, symid; symid.load(sys.argv[1]).library", str(robot)]
    for command in (warm, call):
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if ended.returncode:
            raise SystemExit(ended.stderr)
    return json.loads(ended.stdout.splitlines()[-1])


def compare(mine: dict, other: dict) -> str:
    """Return how far the parameters of two answers are apart."""
    if mine["laws"] != other["laws"]:
        return f"other laws: {', '.join(other['laws'])}"
    if mine["found"].keys() != other["found"].keys():
        return "other parameters"
    pairs = [(mine["found"][name], other["found"][name]) for name in mine["found"]]
    value = max(abs(a[0] - b[0]) / max(abs(a[0]), a[1]) for a, b in pairs)
    std = max(abs(a[1] - b[1]) / max(a[1], 1e-300) for a, b in pairs)
    both = [(dict(a), dict(b)) for a, b in zip(mine["held"], other["held"], strict=True)]
    apart = [abs(a[law] / b[law] - 1.0) for a, b in both for law in a if a[law] and b[law]]
    text = f"parameters apart by {value:.1e}, deviations by {std:.1e}"
    return text + (f", held-out residuals by {max(apart):.1e}" if apart else "")


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("kinds", nargs="*", default=[*LENGTHS], choices=[*LENGTHS])
    parser.add_argument("--seconds", type=float, help="length of the log")
    parser.add_argument("--hour", action="store_true", help="the long log has 3600 s")
    parser.add_argument("--tree", type=Path, action="append", default=[], help="folder that holds symid/")
    parser.add_argument("--output", type=Path, help="file for all answers")
    given = parser.parse_args()
    sys.path.insert(0, str(HERE))
    answers = {}
    for kind in given.kinds:
        seconds = given.seconds or (3600.0 if given.hour and kind == "long" else LENGTHS[kind])
        with tempfile.TemporaryDirectory() as folder:
            robot, log = write_log(Path(folder), seconds, _ROWS if kind == "friction" else "")
            mine = None
            for tree in (HERE.parent, *given.tree):
                answer = answers[f"{kind} {tree}"] = run_fit(kind, tree.resolve(), robot, log)
                mine = mine or answer
                text = f"{kind}, {seconds:g} s, {tree}: {answer['seconds']:.1f} s of processor, "
                text += f"peak {answer['peak']:.0f} MB"
                if answer is not mine:
                    text += f"; {compare(mine, answer)}"
                elif answer["laws"]:
                    text += f"; {', '.join(answer['laws'])}"
                print(text, flush=True)
    if given.output:
        given.output.write_text(json.dumps(answers, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
