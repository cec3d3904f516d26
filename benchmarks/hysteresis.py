"""Which model predicts twelve elements, and does the automatic choice find it?

    python benchmarks/hysteresis.py [--truths NAME ...] [--seed 2]

Truths come from other integrators (`tests/hysteresis_truths.py`): 4000 samples, uneven times, 1 % noise, 12
bits, a sweep up to amplitude 1. Every model is fitted to it, and predicts other sweeps of amplitude 0.7 and
1.4: rms of the error over rms of the output, percent, means removed. The last columns: what the automatic
choice took, its errors, and over those of the best model.
"""

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import symid
from symid.notation import HYSTERESIS_MODELS
from tests.hysteresis_truths import TRUTHS, make_input, measure

AMPLITUDES = (0.7, 1.4)
TRAINING, HELD_OUT = 1, 3


def main() -> None:
    """Print a row for every truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--truths", nargs="*", default=list(TRUTHS))
    parser.add_argument("--seed", type=int, default=2)
    args = parser.parse_args()
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
