"""Which model predicts twelve elements, and does the automatic choice find it?

    python benchmarks/hysteresis.py [--truths NAME ...] [--seed 2] [--recordings ../shared/data]

Truths come from other integrators (`tests/hysteresis_truths.py`): 4000 samples, uneven times, 1 % noise, 12
bits, a sweep up to amplitude 1. Every model is fitted to it, and predicts other sweeps of amplitude 0.7 and
1.4: rms of the error over rms of the output, percent, means removed. The last columns: what the automatic
choice took, its errors, and over those of the best model.

With --recordings, the automatic choice on a banded friction damper (Coble et al. 2022): trained on 1 in,
tested on 1.5 in at 36 lb, first 3200 samples not counted; and by halves at 30 lb.
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import symid
from symid.notation import HYSTERESIS_MODELS
from tests.hysteresis_truths import TRUTHS, make_input, measure

AMPLITUDES = (0.7, 1.4)
TRAINING, HELD_OUT = 1, 3


def measure_damper(folder: Path) -> None:
    """Print what is left of the force of a friction damper, percent."""

    def read(name: str, rows: slice = slice(None)) -> tuple[np.ndarray, ...]:
        data = np.load(folder / f"tension_{name}.npz")["data"].astype(float)[rows]
        return data[:, 1], data[:, 2], data[:, 0]

    last = len(read("30lb_amplitude_1in")[0])
    halves = [slice(3200, (3200 + last) // 2), slice((3200 + last) // 2, None)]
    pairs = [("36lb_amplitude_1in", slice(None)), ("36lb_amplitude_1.5in", slice(None))]
    cases = [pairs, *([("30lb_amplitude_1in", part) for part in order] for order in (halves, halves[::-1]))]
    for passive in (None, True):
        for (name, part), (other, held) in cases:
            fit = symid.hysteresis.fit(*read(name, part), passive=passive)
            x, y, t = read(other, held)
            rows, record = slice(3200, None, 8), fit.record
            # The second half of a recording does not begin at rest: what it remembers is found from it.
            error = fit.validate(x, y, t).trial.error
            if other != name:
                error = 100.0 * np.std((fit.predict(x, t) - y)[rows]) / np.std(y[rows])
            print(
                f"{name} -> {other}{' by halves' * (other == name)}, passive {passive}: {error:.2f} %, "
                f"{record.model} {record.form} ({record.candidates[0].count}), passive {record.passive}",
                flush=True,
            )


def main() -> None:
    """Print a row for every truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--truths", nargs="*", default=list(TRUTHS))
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--recordings", type=Path)
    args = parser.parse_args()
    if args.recordings:
        measure_damper(args.recordings / "friction_damper")
        return
    print(f"{'truth':28}" + "".join(f"{name[:12]:>14}" for name in HYSTERESIS_MODELS) + "  auto")
    for name in args.truths:
        t, x = make_input(TRAINING)
        recording = (*measure(t, x, TRUTHS[name], args.seed), t)
        tests = [make_input(HELD_OUT, amplitude) for amplitude in AMPLITUDES]
        rows = [(x, TRUTHS[name](t, x), t) for t, x in tests]

        def score(fit: symid.hysteresis.ElementFit, rows: list[tuple] = rows) -> np.ndarray:
            return np.array([100.0 * np.std(fit.predict(x, t) - y) / np.std(y) for x, y, t in rows])

        scores = {model: score(symid.hysteresis.fit(*recording, model=model)) for model in HYSTERESIS_MODELS}
        chosen = symid.hysteresis.fit(*recording)
        own, best = score(chosen), np.min(list(scores.values()), axis=0)
        cells = "".join(f"{a:7.2f}{b:7.2f}" for a, b in scores.values())
        ratios = " ".join(f"{ratio:.2f}" for ratio in own / best)
        record = chosen.record
        print(
            f"{name:28}{cells}  {record.model} {record.form} ({record.candidates[0].count}) "
            f"{own[0]:.2f} {own[1]:.2f}, over the best {ratios}",
            flush=True,
        )


if __name__ == "__main__":
    main()
