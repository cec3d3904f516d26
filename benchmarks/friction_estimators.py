"""Estimators of friction and searches of a paper on the same samples: objective, evaluations, solves, time.

Protocol S1 (plain Stribeck friction, one direction, four unknowns) and S2 (improved Stribeck friction, both
directions, six unknowns), the same draws for all. Run: PYTHONPATH=. python benchmarks/friction_estimators.py
[draws]
"""

import statistics
import sys
import time

import numpy as np

from symid.errors import UsageError
from symid.identification.friction import FrictionOptions, build_problem
from symid.study.friction_protocols import ESTIMATORS, search_friction
from tests.frictions import draw_s1, draw_s2

DRAWS = 5
OPTIONS = FrictionOptions()


def measure(problem, estimator, seed):
    """Return the search and its CPU time in s."""
    generator = np.random.default_rng(seed)
    start = time.process_time()
    search = search_friction(problem, estimator, generator)
    return search, time.process_time() - start


def print_table(title, problems):
    """Print one row an estimator: the worst objective over the best of all, medians of the rest."""
    print(f"{title}, {len(problems)} draws")
    print("| estimator | J of draw 0 | worst J / best - 1 | evaluations | linear solves | CPU time, ms |")
    print("|---|---|---|---|---|---|")
    runs = {}
    for estimator in ESTIMATORS:
        try:
            measure(problems[0], estimator, 0)
        except UsageError as error:
            print(f"| {estimator} | - | {error.notices[0].text.split(';')[0]} | - | - | - |")
            continue
        runs[estimator] = [measure(problem, estimator, seed) for seed, problem in enumerate(problems)]
    best = [min(entries[k][0].objective for entries in runs.values()) for k in range(len(problems))]
    for estimator, entries in runs.items():
        excess = max(search.objective / least - 1.0 for (search, _), least in zip(entries, best, strict=True))
        evaluations = statistics.median(search.evaluations for search, _ in entries)
        solves = max(search.solves for search, _ in entries)
        spent = 1e3 * statistics.median(spent for _, spent in entries)
        first = entries[0][0].objective
        print(f"| {estimator} | {first:.6f} | {excess:.1e} | {evaluations:g} | {solves} | {spent:.1f} |")
    print()


def main() -> None:
    """Print the tables."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else DRAWS
    print_table("S1", [build_problem(*draw_s1(seed), OPTIONS) for seed in range(draws)])
    for joint in (1, 2, 3):
        problems = [build_problem(*draw_s2(joint, seed), OPTIONS) for seed in range(draws)]
        print_table(f"S2, joint {joint}", problems)


if __name__ == "__main__":
    main()
