"""Processor time and peak memory of whole identifications, this tree beside another one.

    python benchmarks/identify_cost.py [--other TREE] [--only TEXT] [--repeats N]

Each call is a process of its own, `python -m symid identify ROBOT LOG` with default settings, trees in turns;
the least processor time and memory of the repeats count. Logs are exact motions of random arms that are not
those of symid's simulator (`judge_plants.py`), with noise of 1 % in torques and a microradian in positions.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from judge_plants import draw_chain, draw_motion, follow, write_toml

HERE = Path(__file__).resolve().parent.parent
CASES = {
    "6 joints, 10 s at 500 Hz": (6, 10.0, 500.0),
    "7 joints, 60 s at 1 kHz": (7, 60.0, 1000.0),
    "7 joints, 1 h at 1 kHz": (7, 3600.0, 1000.0),
}
"""Joints, duration in s, rate in Hz."""
PIECE = 60.0


def write_case(folder: Path, size: int, duration: float, rate: float) -> tuple[Path, Path]:
    """Return the robot file and the log of an arm that is driven along sines."""
    rng = np.random.default_rng(1)
    chain = draw_chain(rng, size, planar=False, width=1e-3)
    motion = draw_motion(rng, size, min(duration, PIECE), "waves")
    parts = []
    for start in np.arange(0.0, duration, PIECE):
        time = start + np.arange(round(min(duration, PIECE) * rate)) / rate
        states = follow(chain, motion, time)
        tau = states.tau + 0.01 * np.std(states.tau, axis=0) * rng.standard_normal(states.tau.shape)
        parts.append((time, states.q + 1e-6 * rng.standard_normal(states.q.shape), tau))
    t, q, tau = (np.concatenate(part) for part in zip(*parts, strict=True))
    robot, log = folder / "chain.toml", folder / "log.npz"
    robot.write_text(write_toml(chain), encoding="utf-8")
    np.savez(log, t=t, q=q, tau=tau)
    return robot, log


def measure(tree: Path, robot: Path, log: Path) -> tuple[float, float, str]:
    """Return processor time in s and peak memory in MB of one call, and the first line of its answer."""
    command = (sys.executable, "-m", "symid", "identify", str(robot), str(log))
    alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(tree)}
    with tempfile.TemporaryFile("w+") as answer:
        options = {"stdout": answer, "stderr": subprocess.STDOUT, "env": {**os.environ, **alone}, "cwd": tree}
        process = subprocess.Popen(command, **options)
        _, _, used = os.wait4(process.pid, 0)
        answer.seek(0)
        first = next((line.strip() for line in answer if line.startswith(("verdict", "error"))), "")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0, first


def main() -> None:
    """Print a line a case and tree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--other", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    trees = [tree for tree in (given.other, HERE) if tree is not None]
    for case in (case for case in CASES if given.only in case):
        with tempfile.TemporaryDirectory() as folder:
            files = write_case(Path(folder), *CASES[case])
            # The first call compiles what is missing.
            found = [[measure(tree, *files) for tree in trees] for _ in range(given.repeats + 1)][1:]
        for place, tree in enumerate(trees):
            seconds, memory, said = zip(*(row[place] for row in found), strict=True)
            print(f"{case}: {tree.name}: {min(seconds):.2f} s, {min(memory):.0f} MB: {said[0]}", flush=True)


if __name__ == "__main__":
    main()
