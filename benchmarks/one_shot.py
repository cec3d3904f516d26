"""Time of the one-shot problem of elastic joints: callbacks against CasADi expressions, from the same start.

    python benchmarks/one_shot.py [REPEATS]

Two joints, one log of 20 s at 1 kHz, the last round: rows, stops and weights are the same for both, and the
start is 5 % off. The forms take turns; least processor times are printed, with their ratio and the largest
relative difference of the two optima. Expressions include building them and their derivatives.
"""

import sys
import time
from dataclasses import replace

import numpy as np

from symid.codegen.cache import prepare_library
from symid.identification.elastic.methods import build_elastic_equations, fit_one_shot
from symid.identification.elastic.nlp import build_nlp_graph, compute_scales, optimise_nlp, solve_nlp_graph
from symid.identification.elastic.options import ElasticOptions, NlpOptions
from symid.robot.loading import locate_robot_file
from symid.robot.toml_reader import read_robot
from symid.study.elastic_methods import SensorCondition, observe_runs, simulate_runs

CASES = {
    "knees, energy and momentum rows": ElasticOptions(),
    "knees, filtered rows": ElasticOptions(nlp=NlpOptions(rows=("filtered",))),
    "no knees, energy and momentum rows": ElasticOptions(knees=0),
}


def main() -> None:
    """Print the table."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    robot = read_robot(locate_robot_file("two_link_elastic"))
    library = prepare_library(robot)
    runs = simulate_runs(robot, library, SensorCondition.NOISY)
    recordings = observe_runs(runs, ("TA10",), SensorCondition.NOISY, 1)
    print(f"{'':38}{'callbacks/s':>12}{'expressions/s':>15}{'ratio':>7}{'difference':>12}")
    for name, options in CASES.items():
        work = build_elastic_equations(library, recordings, options)
        found = fit_one_shot(work)
        cost, layout = found.cost, found.cost.layout
        start, scales = (
            np.clip(1.05 * found.run.x, layout.lower, layout.upper),
            compute_scales(cost, found.run.x),
        )
        times = []
        for _ in range(repeats):
            begin = time.process_time()
            run = optimise_nlp(cost, start, scales, options.nlp)
            middle = time.process_time()
            graph = build_nlp_graph(found, work.wide, options.nlp)
            entries = zip(graph.variables.items(), start.tolist(), strict=True)
            moved = {key: replace(entry, start=value) for (key, entry), value in entries}
            answer = solve_nlp_graph(replace(graph, variables=moved))
            times.append((middle - begin, time.process_time() - middle))
        least = np.min(times, axis=0)
        values = np.array(list(answer.values.values()))
        gap = np.max(np.abs(values - run.x) / np.maximum(np.abs(run.x), scales))
        print(f"{name:38}{least[0]:12.3f}{least[1]:15.3f}{least[1] / least[0]:7.1f}{gap:12.1e}")


if __name__ == "__main__":
    main()
