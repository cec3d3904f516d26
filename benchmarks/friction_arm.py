"""Is the friction law of every joint found where a whole robot is identified? A simulated six-axis arm.

    python benchmarks/friction_arm.py [--truth six-laws] [--seeds 20] [--first 0] [--noise 0.01]
        [--friction auto] [--cache FOLDER] [--output RAW.json]
    python benchmarks/friction_arm.py --tables RAW.json    the summary of earlier results again
    python benchmarks/friction_arm.py --logs ...           simulates, prints where the logs are, fits nothing
    python benchmarks/friction_arm.py --check              accuracy of the simulation

Truths: `six-laws`, each joint with another law; `plain`, Coulomb and viscous friction everywhere;
`temperature`, the same with viscous friction of the elbow that falls with the logged temperature.
Every seed has two logs to identify and one held out, 60 s at 1 kHz, of other random motions and noise.

Prints for every seed the law found of each joint (`ok`, or what was found in place of the true one), then
residuals of the held-out log divided by those of an oracle: a least-squares fit that knows the laws and
their shape values. Both predict means over 20 ms from the same states; `all`: all rows; `moving`: without
rows in which the joint is slower than 0.02 rad/s, where it may stick. Below: how often all six laws were
found, and the share of 95 % intervals (1.96 stated deviations) that hold the truth, of base parameters and of
friction, the latter where the law is the true one. Needs gcc and `pip install pin`.
"""

import argparse
import json
import os
import time
from collections import Counter
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from friction_arm_truth import (
    ARM,
    CACHE,
    JOINTS,
    RATE,
    ROBOT,
    TRUTHS,
    Experiment,
    Truth,
    build_plant,
    check_plant,
    compute_rigid_regressor,
    compute_rigid_torques,
    list_columns,
    write_log,
)
from scipy.linalg import qr
from scipy.signal import butter, sosfiltfilt

import symid
from symid.errors import UsageError
from symid.joint_models import compute_friction_torque, get_law
from symid.notation import join_name

QUANTILE = 1.96
TRAINING, HELD_OUT = (0, 1), 2
CUTOFF = 40.0
"""Hz, of the positions."""
BLOCK = 20
"""Samples of which a row is the mean."""
ENDS = 300
"""Samples left out at either end, where the filter begins."""
SLOW = 0.02
"""rad/s below which a joint may stick."""


# What is tried.


@dataclass(frozen=True, kw_only=True)
class Found:
    """What an identification gives.

    Args:
        laws: of every joint, by the names of symid's catalogue.
        values: value and deviation of every parameter: base parameters under their names; linear and shape
            parameters of the laws under those of the catalogue with the number of the joint, as vs4.
        level: of the verdict.
    """

    laws: tuple[str, ...]
    values: dict[str, tuple[float, float]]
    level: str


def identify(robot, logs, friction):
    """Return what `robot.identify` finds with a law for all joints, or one for each of them."""
    fit = robot.identify(list(logs), friction=friction)
    values = {name: (fit[name].value, fit[name].std) for name in fit}
    return Found(laws=tuple(law.law for law in fit.estimate.laws), values=values, level=fit.verdict.level)


# True parameters.


@cache
def load():
    """Return the robot."""
    return symid.load(ROBOT)


@cache
def find_base():
    """Return the true base parameters: those that give the true torques at random states, to 1e-9."""
    plant = build_plant(ARM, TRUTHS["plain"].values)
    states = np.random.default_rng(0).uniform(-2.0, 2.0, (3, 400, len(JOINTS)))
    torque = compute_rigid_torques(plant, *states).ravel()
    matrix = np.asarray(load().compile().torque_regressor(*states)).reshape(torque.size, -1)
    values, _, rank, _ = np.linalg.lstsq(matrix, torque)
    error = np.abs(matrix @ values - torque).max() / np.abs(torque).max()
    if rank < len(values) or error > 1e-9:
        text = f"{ROBOT.name} has not the dynamics of the simulated arm: rank {rank}, error {error:.1e}"
        raise SystemExit(text)
    return dict(zip(load().base.names, map(float, values), strict=True))


def list_truth(truth: Truth) -> dict[str, float]:
    """Return all true values by name; offsets are zero."""
    found = dict(find_base())
    for joint, values in enumerate(truth.values, 1):
        found |= {join_name(name, joint): value for name, value in values.items()}
        found[f"offset{joint}"] = 0.0
        found[f"gamma{joint}"] = 2.0
    return found


def is_right(law: str, true: str, joint: int, values: dict[str, tuple[float, float]]) -> bool:
    """Return whether a law is the true one; an offset may be zero, an exponent two, by three deviations."""
    try:
        name = get_law(law).name
    except UsageError:
        name = law
    if name.endswith(("+offset", "-offset")):
        value, deviation = values.get(f"offset{joint}", (0.0, 0.0))
        name = name[: -len("+offset")]
        if abs(value) > 3.0 * deviation:
            return False
    if name.endswith("-exponent"):
        value, deviation = values.get(f"gamma{joint}", (2.0, 0.0))
        name = name.removesuffix("-exponent")
        if abs(value - 2.0) > 3.0 * deviation:
            return False
    return name == true


# Rows: means over blocks of samples, of the torque and of all that is compared with it.


@dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """A log and the states that both sides use: q, dq, ddq and tau (N, 6), temperature (N,)."""

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    tau: np.ndarray
    temperature: np.ndarray

    @property
    def states(self):
        """Return q, dq, ddq."""
        return self.q, self.dq, self.ddq

    def find_moving(self):
        """Return which blocks (M, 6) have no slow sample of the joint."""
        size = np.abs(self.dq)
        return size.reshape(-1, BLOCK, size.shape[1]).min(axis=1) > SLOW


def read_log(path: Path) -> Log:
    """Return a log whose positions have passed a low-pass without delay."""
    with np.load(path) as data:
        q, tau = data["q"], data["tau"]
        temperature = data["temperature"] if "temperature" in data else np.zeros(len(q))
    q = sosfiltfilt(butter(4, CUTOFF, fs=RATE, output="sos"), q, axis=0)
    dq = np.gradient(q, 1.0 / RATE, axis=0)
    ddq = np.zeros_like(q)
    ddq[1:-1] = (q[2:] - 2.0 * q[1:-1] + q[:-2]) * RATE**2
    count = (len(q) - 2 * ENDS) // BLOCK * BLOCK
    parts = (entry[ENDS : ENDS + count] for entry in (q, dq, ddq, tau, temperature))
    return Log(**dict(zip(("q", "dq", "ddq", "tau", "temperature"), parts, strict=True)))


def average(values: np.ndarray) -> np.ndarray:
    """Return the means over blocks: (N, ...) -> (N / BLOCK, ...)."""
    return values.reshape(-1, BLOCK, *values.shape[1:]).mean(axis=1)


# The oracle.


@cache
def find_independent():
    """Return which inertial parameters of the simulated arm have independent columns."""
    plant = build_plant(ARM, TRUTHS["plain"].values)
    states = np.random.default_rng(1).uniform(-2.0, 2.0, (3, 300, len(JOINTS)))
    rows = compute_rigid_regressor(plant, *states)
    triangle, order = qr(rows.reshape(-1, rows.shape[-1]), mode="r", pivoting=True)
    size = np.abs(np.diag(triangle))
    return np.sort(order[: int(np.sum(size > 1e-9 * size[0]))])


@dataclass(frozen=True, kw_only=True, eq=False)
class OracleRows:
    """Rows of a log: rigid columns (M, 6, b), friction of each joint (M, p), torques, moving rows (M, 6)."""

    rigid: np.ndarray
    friction: list[np.ndarray]
    torque: np.ndarray
    moving: np.ndarray

    def get_rows(self, joint):
        """Return the columns (M, b + p in all) of a joint."""
        own = [block if k == joint else np.zeros_like(block) for k, block in enumerate(self.friction)]
        return np.hstack([self.rigid[:, joint], *own])


def build_oracle_rows(log: Log, truth: Truth, rigid_values: np.ndarray | None) -> OracleRows:
    """Return the rows of a log with the true columns of friction; the load is that of `rigid_values` (b,)."""
    rows = compute_rigid_regressor(build_plant(ARM, truth.values), *log.states)[:, :, find_independent()]
    load = np.zeros_like(log.q) if rigid_values is None else rows @ rigid_values
    friction = []
    for joint, values in enumerate(truth.values):
        columns = list_columns(values, log.q[:, joint], log.dq[:, joint], load[:, joint], log.temperature)
        friction.append(average(np.column_stack(list(columns.values()))))
    return OracleRows(
        rigid=average(rows), friction=friction, torque=average(log.tau), moving=log.find_moving()
    )


def fit_oracle(logs: list[Log], truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """Return rigid values (b,) and all values of a weighted fit to moving rows with the true laws.

    The load of friction is that of the fit before; the weights are those of each joint's residual.
    """
    rigid, weights = None, np.ones(len(JOINTS))
    for _ in range(4):
        parts = [build_oracle_rows(log, truth, rigid) for log in logs]
        systems = []
        for joint in range(len(JOINTS)):
            matrix = np.vstack([part.get_rows(joint)[part.moving[:, joint]] for part in parts])
            torque = np.concatenate([part.torque[part.moving[:, joint], joint] for part in parts])
            systems.append((matrix, torque))
        whole = np.vstack([weight * matrix for weight, (matrix, _) in zip(weights, systems, strict=True)])
        right = np.concatenate(
            [weight * torque for weight, (_, torque) in zip(weights, systems, strict=True)]
        )
        scale = np.linalg.norm(whole, axis=0)
        scale[scale == 0.0] = 1.0
        values = np.linalg.lstsq(whole / scale, right)[0] / scale
        weights = np.array([1.0 / np.std(torque - matrix @ values) for matrix, torque in systems])
        rigid = values[: len(find_independent())]
    return rigid, values


def predict_oracle(log: Log, truth: Truth, fit: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the torques (M, 6) that the oracle predicts."""
    rows = build_oracle_rows(log, truth, fit[0])
    return np.column_stack([rows.get_rows(joint) @ fit[1] for joint in range(len(JOINTS))])


# Comparison.


def predict(found: Found, log: Log) -> np.ndarray:
    """Return the torques (M, 6) that an identification predicts; parameters without a value count as zero."""
    robot = load()

    def get(name, otherwise=0.0):
        return found.values.get(name, (otherwise, 0.0))[0]

    rows = np.asarray(robot.compile().torque_regressor(*log.states))
    load_torque = rows @ np.array([get(name) for name in robot.base.names])
    torque = load_torque.copy()
    for k, name in enumerate(found.laws):
        law = get_law(name)
        inputs = {"velocity": log.dq[:, k], "load": load_torque[:, k], "position": log.q[:, k]}
        inputs["temperature"] = log.temperature
        linear = [get(join_name(entry.name, k + 1)) for entry in law.linear]
        usual = {"vs": 0.05, "gamma": 2.0, "delta": 0.7, "dq0": 0.01, "g2": 1e2, "g3": 10.0, "g5": 1e2}
        shape = [get(join_name(entry.name, k + 1), usual.get(entry.name, 1.0)) for entry in law.shape]
        torque[:, k] += compute_friction_torque(law, inputs, linear, shape)
    return average(torque)


def measure_rms(log: Log, predicted: np.ndarray) -> dict[str, list[float]]:
    """Return the rms error of each joint in N m over all and over moving rows, and the torque's rms."""
    torque, moving = average(log.tau), log.find_moving()
    square = (torque - predicted) ** 2
    return {
        "all": np.sqrt(square.mean(axis=0)).tolist(),
        "moving": np.sqrt([np.mean(square[moving[:, k], k]) for k in range(len(JOINTS))]).tolist(),
        "torque": np.sqrt(np.mean(torque**2, axis=0)).tolist(),
    }


def run_seed(experiment: Experiment, folder: Path, friction: str) -> dict:
    """Return what one seed gives, in plain types."""
    truth, true_values = TRUTHS[experiment.truth], list_truth(TRUTHS[experiment.truth])
    paths = [write_log(replace(experiment, log=log), folder) for log in (*TRAINING, HELD_OUT)]
    start = time.process_time()
    result = {"seed": experiment.seed, "truth": experiment.truth}
    try:
        found = identify(load(), paths[:-1], friction)
    except symid.SymidError as error:
        return result | {"error": str(error)[:300], "seconds": time.process_time() - start}
    result |= {"seconds": time.process_time() - start, "level": found.level, "laws": list(found.laws)}
    logs = [read_log(path) for path in paths]
    fit = fit_oracle(logs[:-1], truth)
    right = [
        is_right(law, true, joint, found.values)
        for joint, (law, true) in enumerate(zip(found.laws, truth.laws, strict=True), 1)
    ]
    counted = set(find_base())
    for joint, law in enumerate(found.laws, 1):
        entries = get_law(law).linear + get_law(law).shape if right[joint - 1] else ()
        counted |= {join_name(entry.name, joint) for entry in entries}
    return result | {
        "right": right,
        "found": measure_rms(logs[-1], predict(found, logs[-1])),
        "oracle": measure_rms(logs[-1], predict_oracle(logs[-1], truth, fit)),
        "parameters": {
            name: [*found.values[name], true_values[name]] for name in sorted(counted & set(found.values))
        },
    }


# Tables.


def describe_seed(result: dict) -> str:
    """Return the line of one seed."""
    if "error" in result:
        return f"| {result['seed']} | {result['error']} |"
    laws = ["ok" if ok else law for ok, law in zip(result["right"], result["laws"], strict=True)]
    found, oracle = result["found"], result["oracle"]
    percent = 100.0 * np.mean(np.divide(found["all"], found["torque"]))
    cells = [str(result["seed"]), *laws, result["level"], f"{percent:.2f}"]
    for rows in ("all", "moving"):
        ratio = np.divide(found[rows], oracle[rows])
        cells.append(f"{np.mean(ratio):.3f} ({np.max(ratio):.3f} {JOINTS[int(np.argmax(ratio))]})")
    cells.append(f"{result['seconds']:.1f}")
    return f"| {' | '.join(cells)} |"


def print_heads(truth: str) -> None:
    """Print the true laws and the heads of the columns."""
    print(f"truth {truth}: {', '.join(map(' '.join, zip(JOINTS, TRUTHS[truth].laws, strict=True)))}")
    heads = ("seed", *JOINTS, "verdict", "held out, %", "of the oracle's, all", "moving", "s")
    print(f"| {' | '.join(heads)} |")
    print("|---" * len(heads) + "|")


def print_summary(results: list[dict]) -> None:
    """Print the counts, the residuals and the coverage of all seeds."""
    whole = [entry for entry in results if "error" not in entry]
    if not whole:
        print(f"no fit of {len(results)} ended with a result")
        return
    print(f"all six laws right: {sum(all(entry['right']) for entry in whole)} of {len(results)}")
    for joint, name in enumerate(JOINTS):
        laws = Counter(entry["laws"][joint] for entry in whole)
        right = sum(entry["right"][joint] for entry in whole)
        print(f"  {name}: {right} right; {', '.join(f'{law} {count}' for law, count in laws.most_common())}")
    for rows in ("all", "moving"):
        ratio = np.array([np.divide(entry["found"][rows], entry["oracle"][rows]) for entry in whole])
        means = ", ".join(f"{n} {v:.3f}" for n, v in zip(JOINTS, ratio.mean(axis=0), strict=True))
        print(
            f"held-out rms / oracle's, {rows} rows: mean {ratio.mean():.3f}, worst {ratio.max():.3f}; {means}"
        )
    base = set(find_base())
    for label, kinds in (("base parameters", {True}), ("friction", {False}), ("all", {True, False})):
        table = {}
        for entry in whole:
            for name, (value, deviation, true) in entry["parameters"].items():
                if (name in base) in kinds:
                    table.setdefault(name, []).append(abs(value - true) <= QUANTILE * deviation)
        if table:
            hits = [hit for entries in table.values() for hit in entries]
            least = min(table, key=lambda name: np.mean(table[name]))
            print(
                f"covered, {label}: {100 * np.mean(hits):.1f} % of {len(hits)}; least {least} "
                f"{100 * np.mean(table[least]):.0f} %"
            )
    print(f"processor time of an identification: {np.mean([entry['seconds'] for entry in whole]):.1f} s")


def read_arguments() -> argparse.Namespace:
    """Return the arguments of the call."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--truth", choices=tuple(TRUTHS), default="six-laws")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--noise", type=float, default=0.01)
    parser.add_argument("--friction", default="auto")
    parser.add_argument("--cache", type=Path, default=CACHE)
    parser.add_argument("--output", type=Path)
    parser.add_argument("--tables", type=Path)
    parser.add_argument("--logs", action="store_true")
    parser.add_argument("--check", action="store_true")
    return parser.parse_args()


def main() -> None:
    """Check the simulation, then fit and print, or only one of these."""
    given = read_arguments()
    if given.tables:
        print_summary(json.loads(given.tables.read_text(encoding="utf-8")))
        return
    errors = check_plant()
    find_base()
    if given.check:
        for name, error in errors.items():
            print(f"{name}: {error:.1e}")
        return
    seeds = range(given.first, given.first + given.seeds)
    experiments = [Experiment(truth=given.truth, seed=seed, noise=given.noise) for seed in seeds]
    if given.logs:
        print(ROBOT)
        for experiment in experiments:
            for log in (*TRAINING, HELD_OUT):
                print(write_log(replace(experiment, log=log), given.cache))
        return
    print_heads(given.truth)
    results = []
    try:
        for experiment in experiments:
            results.append(run_seed(experiment, given.cache, given.friction))
            print(describe_seed(results[-1]), flush=True)
    finally:
        # Also what a run gave that was interrupted.
        if given.output:
            given.output.write_text(json.dumps(results), encoding="utf-8")
    print_summary(results)


if __name__ == "__main__":
    main()
