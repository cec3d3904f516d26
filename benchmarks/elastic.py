"""Time of one identification of elastic joints: 2 joints, 3 logs of 20 s at 1 kHz, 8 thresholds a joint.

    python benchmarks/elastic.py [REPEATS]

The methods take turns, so that what else the machine does meets all of them alike; the smallest and the
median time of each are printed. Derivation, compilation and simulation are not part of it.
"""

import statistics
import sys
import time

from symid.codegen.cache import prepare_library
from symid.identification.elastic.methods import AUTOMATIC_METHODS, build_elastic_equations, fit_method
from symid.identification.elastic.options import ElasticOptions
from symid.robot.loading import locate_robot_file
from symid.robot.toml_reader import read_robot
from symid.study.elastic_methods import SensorCondition, fit_independent, observe_runs, simulate_runs

METHODS = {**dict(zip(AUTOMATIC_METHODS, AUTOMATIC_METHODS, strict=True)), "independent": fit_independent}
LOGS = ("TA", "TA10", "TC")


def main() -> None:
    """Print the table."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    robot = read_robot(locate_robot_file("two_link_elastic"))
    library = prepare_library(robot)
    runs = simulate_runs(robot, library, SensorCondition.NOISY)
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in ("equations", *METHODS)}
    for seed in range(repeats + 1):
        recordings = observe_runs(runs, LOGS, SensorCondition.NOISY, seed)
        wall, own = time.perf_counter(), time.process_time()
        work = build_elastic_equations(library, recordings, ElasticOptions())
        shared = (time.perf_counter() - wall, time.process_time() - own)
        rows = [("equations", shared)]
        for method, maker in METHODS.items():
            wall, own = time.perf_counter(), time.process_time()
            fit_method(work, maker)
            spent = (time.perf_counter() - wall + shared[0], time.process_time() - own + shared[1])
            rows.append((method, spent))
        # The first round loads packages and is not counted.
        if seed:
            for name, spent in rows:
                times[name].append(spent)
    print(f"{repeats} rounds; equations are part of every method")
    print(f"{'method':15}{'wall/s: least':>14}{'median':>8}{'  processor/s: least':>20}{'median':>8}")
    for name, found in times.items():
        wall_times, own_times = zip(*found, strict=True)
        print(
            f"{name:15}{min(wall_times):14.2f}{statistics.median(wall_times):8.2f}"
            f"{min(own_times):20.2f}{statistics.median(own_times):8.2f}"
        )


if __name__ == "__main__":
    main()
