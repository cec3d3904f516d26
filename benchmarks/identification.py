"""How long base regressor and weighted least squares take, and how much memory long logs need.

    python benchmarks/identification.py [SAMPLES]

Prints, for a seven-joint arm: the stack of base regressors of 100 000 samples and its weighted solution, best
of five; then the same for SAMPLES (10 million by default) that come block by block, with the peak of memory.
"""

import resource
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from symid.codegen.cache import prepare_library
from symid.codegen.library import Library
from symid.excitation.trajectories import FourierOptions, build_random_fourier
from symid.identification.estimators.least_squares import fit_condensed
from symid.identification.regression.equations import evaluate_columns
from symid.identification.regression.identifiability import (
    BLOCK,
    Condensed,
    analyse_condensed,
    extend_triangle,
)
from symid.logs.recording import Signals
from symid.robot.description import Robot
from symid.robot.toml_reader import read_robot

ROBOT = Path(__file__).resolve().parent.parent / "robots" / "panda.toml"
PERIOD = 1e-3
PIECE = 100_000
REPEATS = 5
MANY = 10_000_000


def make_signals(robot: Robot, library: Library, seed: int) -> Signals:
    """Return exact states along a random series, and noisy torques of parameters that are all one."""
    rng = np.random.default_rng(seed)
    trajectory = build_random_fourier(robot, rng, FourierOptions(duration=PIECE * PERIOD, base_frequency=0.1))
    times = PERIOD * np.arange(PIECE, dtype=np.float64)
    q, dq, ddq = trajectory.evaluate(times)
    card = library.card
    (tau,) = library.evaluate("inverse_dynamics", q, dq, ddq, np.ones(len(card.beta)))
    tau = tau + 0.01 * rng.standard_normal(tau.shape)
    return Signals(time=times, q=q, dq=dq, ddq=ddq, tau=tau, period=PERIOD)


def find_peak() -> float:
    """Return the most memory this process had so far, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def condense_signals(library: Library, pieces: Iterable[Signals]) -> Condensed:
    """Return the torque equations of signals, condensed block by block; each is forgotten before the next."""
    card = library.card
    columns = len(card.beta) + len(card.friction) + 1
    factors, count = np.zeros((card.size, columns, columns)), 0
    for signals in pieces:
        for start in range(0, len(signals.time), BLOCK):
            part = slice(start, start + BLOCK)
            rows = evaluate_columns(library, signals.q[part], signals.dq[part], signals.ddq[part])
            table = np.concatenate([rows, signals.tau[part][:, :, None]], axis=2)
            for joint in range(card.size):
                factors[joint] = extend_triangle(factors[joint], [table[:, joint]])
        count += len(signals.time)
    return Condensed(factors=factors, counts=np.full(card.size, count, dtype=np.intp), independent=1.0)


def time_stack(library: Library, signals: Signals) -> None:
    """Print the best time of stack and solution."""
    best, names = np.inf, tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
    for _ in range(REPEATS):
        start = time.perf_counter()
        condensed = condense_signals(library, [signals])
        seen = analyse_condensed(condensed, "torque", names)
        fit = fit_condensed(condensed, seen.basis)
        best = min(best, time.perf_counter() - start)
    error = float(np.abs(fit.values - 1.0).max())
    print(
        f"{len(signals.time)} samples, {library.card.size} joints, {len(names)} parameters: "
        f"{best:.2f} s, largest error {error:.1e}"
    )


def stream(robot: Robot, library: Library, samples: int) -> Iterator[Signals]:
    """Yield pieces of a long log, made when they are asked for."""
    for seed in range(max(1, samples // PIECE)):
        yield make_signals(robot, library, seed)


def main() -> None:
    """Run both measurements."""
    robot = read_robot(ROBOT)
    library = prepare_library(robot)
    time_stack(library, make_signals(robot, library, 0))
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else MANY
    start = time.perf_counter()
    condensed = condense_signals(library, stream(robot, library, samples))
    fit = fit_condensed(condensed, np.eye(condensed.parameters))
    seconds = time.perf_counter() - start
    print(
        f"{int(condensed.counts[0])} samples in blocks: {seconds:.0f} s with making them, "
        f"peak {find_peak():.0f} MB, largest error {np.abs(fit.values - 1.0).max():.1e}"
    )


if __name__ == "__main__":
    main()
