"""Whether stated deviations of elastic joints hold: 95 % intervals of dynamics and springs, many seeds.

    python benchmarks/elastic_coverage.py [SEEDS [TRUTH ...]]

The planar arm of `symid study foreign`, its automatic choice, draws of the sensors. For each truth: how many
intervals hold, of all dynamic parameters, of the slopes of springs near zero, and of the least of all; then
the errors of each over their deviations.
"""

import sys
from collections.abc import Sequence

import numpy as np

from symid.codegen import prepare_library
from symid.identification import IdentifyOptions, TaskContext, prepare_elastic_methods
from symid.study.foreign_truths import ARMS, AUTOMATIC, _prepare_scene, observe_plant
from symid.study.monte_carlo import run_tasks

TRUTHS = ("family", "stribeck", "lugre", "ripple")
ARM = "2r"
BOUND = 1.96


def list_deviations(task: tuple[str, int]) -> dict[str, float]:
    """Return errors over stated deviations, by name; slopes of springs by their joints."""
    truth, seed = task
    scene = _prepare_scene(ARM, truth, 1.0, 1.0)
    logs = [
        observe_plant(run, scene.hidden, np.random.default_rng([seed, number]), source=name)
        for number, (name, run) in enumerate(zip(scene.names[:-1], scene.runs[:-1], strict=True))
    ]
    context = TaskContext(prepare=prepare_library, progress=lambda _: None)
    estimate = prepare_elastic_methods(scene.robot, logs, IdentifyOptions(), context)(AUTOMATIC).estimate
    found = {entry.name: entry for entry in estimate.parameters}
    ratios = {
        name: (found[name].value - value) / found[name].std
        for name, (value, _) in scene.values.items()
        if np.isfinite(found[name].std)
    }
    for spring, stiffness in zip(estimate.springs, ARMS[ARM].stiffness, strict=True):
        # Springs with branches have no slope near zero of their own.
        slope = spring.elasticity.initial_stiffness
        if slope is not None and spring.slope_std and not spring.elasticity.branches:
            ratios[f"slope of {spring.joint}"] = (slope - float(stiffness)) / spring.slope_std
    return ratios


def show(truth: str, runs: Sequence[dict[str, float]]) -> list[bool]:
    """Print the line of a truth; return which intervals hold."""
    names = list(dict.fromkeys(name for run in runs for name in run))
    held = {name: [abs(run[name]) <= BOUND for run in runs if name in run] for name in names}
    shares = {name: float(np.mean(entry)) for name, entry in held.items()}
    least = min(shares, key=lambda name: shares[name])
    parts = []
    for kind in (False, True):
        own = [value for name in names if name.startswith("slope") == kind for value in held[name]]
        parts.append(f"{100.0 * np.mean(own):5.1f} %" if own else "  none")
    print(
        f"{truth:10} dynamics {parts[0]}  springs {parts[1]}  least {100.0 * shares[least]:5.1f} % ({least})",
        flush=True,
    )
    for name in names:
        ratios = [run[name] for run in runs if name in run]
        print(f"    {name:16} mean {np.mean(ratios):6.2f}  rms {np.sqrt(np.mean(np.square(ratios))):5.2f}")
    return [value for entry in held.values() for value in entry]


def main() -> None:
    """Print the table."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    pooled: list[bool] = []
    for truth in sys.argv[2:] or TRUTHS:
        tasks = [(truth, seed) for seed in range(seeds)]
        pooled += show(truth, run_tasks(list_deviations, tasks, batch=max(1, seeds // 2)))
    print(f"pooled: {100.0 * np.mean(pooled):.1f} % of {len(pooled)} intervals hold")


if __name__ == "__main__":
    main()
