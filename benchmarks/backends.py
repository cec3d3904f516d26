"""What computes a robot's functions: C, CasADi and NumPy side by side, and the parameters that come out.

    python benchmarks/backends.py [FOLDER]      the folder that holds tx40/, for its identification

Prints microseconds a sample of the Panda's functions, one sample at a time (bind) and 4096 (evaluate),
and seconds of whole identifications with the largest relative difference of a parameter from that of C. The
backends take turns, and the smallest time of each counts.
"""

import sys
import time
from pathlib import Path

import numpy as np

from symid.codegen.cache import prepare_library
from symid.identification.elastic.identify import prepare_methods
from symid.identification.elastic.options import ElasticOptions
from symid.identification.rigid.fit import identify_parameters
from symid.logs.reader import read_recording
from symid.robot.loading import locate_robot_file
from symid.robot.toml_reader import read_robot
from symid.study.elastic_methods import SensorCondition, observe_runs, simulate_runs

# Name and what to ask for; without a compiler CasADi's virtual machine serves.
BACKENDS = {
    "c": {"backend": "c"},
    "casadi": {"backend": "casadi"},
    "casadi, no compiler": {"backend": "casadi", "compiler": "none"},
    "python": {"backend": "python"},
}
FUNCTIONS = ("inverse_dynamics", "torque_regressor")
SAMPLES, SINGLES, ROUNDS = 4096, 300, 7
LOGS = ("TA", "TA10", "TC")


def load(robot, names=None):
    """Return the library of every backend."""
    return {name: prepare_library(robot, names=names, **choice) for name, choice in BACKENDS.items()}


def measure(calls):
    """Return the smallest time of every call in seconds; they take turns."""
    times = {name: [] for name in calls}
    for _ in range(ROUNDS):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            times[name].append(time.perf_counter() - begin)
    return {name: min(found) for name, found in times.items()}


def show(title, times, note=""):
    """Print one row: a time a backend and how many times that of C it is."""
    ratios = "".join(f"{times[name]:12.3g} ({times[name] / times['c']:6.1f} x)" for name in BACKENDS)
    print(f"{title:34}{ratios}{note}")


def show_functions():
    """Print the times of calls."""
    libraries = load(read_robot(locate_robot_file("panda")), FUNCTIONS)
    print(f"{'Panda, us a sample':34}" + "".join(f"{name:>23}" for name in BACKENDS))
    rng = np.random.default_rng(0)
    for spec in libraries["c"].card.functions:
        batch = [rng.uniform(-1, 1, p.shape if p.shared else (SAMPLES, *p.shape)) for p in spec.inputs]
        one = [v if p.shared else v[0].copy() for p, v in zip(spec.inputs, batch, strict=True)]
        out = tuple(np.empty((SAMPLES, *p.shape)) for p in spec.outputs)

        def evaluate(library, name=spec.name, batch=batch, out=out):
            library.evaluate(name, *batch, out=out)

        def repeat(call, one=one):
            for _ in range(SINGLES):
                call(*one)

        bound = {name: library.bind(spec.name) for name, library in libraries.items()}
        singles = measure({name: lambda call=call: repeat(call) for name, call in bound.items()})
        batches = measure({name: lambda each=each: evaluate(each) for name, each in libraries.items()})
        show(f"{spec.name}, bind", {name: 1e6 * spent / SINGLES for name, spent in singles.items()})
        show(f"{spec.name}, evaluate", {name: 1e6 * spent / SAMPLES for name, spent in batches.items()})


def show_fits(title, libraries, identify):
    """Print the times of an identification and how far its parameters are from those found with C."""
    values, times = {}, {}
    for name, library in libraries.items():
        begin = time.perf_counter()
        values[name] = np.array([entry.value for entry in identify(library).parameters])
        times[name] = time.perf_counter() - begin
    differences = (np.max(np.abs(found - values["c"]) / np.abs(values["c"])) for found in values.values())
    show(title, times)
    print(f"{'  largest relative difference':34}" + "".join(f"{found:23.1e}" for found in differences))


def show_tx40(folder):
    """Print identifications of the TX40."""
    robot = read_robot(locate_robot_file("tx40"))
    recording = read_recording(folder / "tx40.npz", robot)
    libraries = load(
        robot, ("torque_regressor", "momentum_regressor", "lagrange_regressor", "friction_regressor")
    )

    def identify(library, rows):
        return identify_parameters(library, [recording], robot.processing, rows=rows, estimator="wls")

    # What is loaded at the first fit shall not count for one backend.
    identify(libraries["c"], "torque")
    for rows in ("torque", "momentum"):
        show_fits(f"TX40, {rows} rows, wls, s", libraries, lambda library, rows=rows: identify(library, rows))


def show_elastic():
    """Print the identification of the arm with elastic joints: all methods, and the choice among them."""
    robot = read_robot(locate_robot_file("two_link_elastic"))
    libraries = load(robot)
    runs = simulate_runs(robot, libraries["c"], SensorCondition.NOISY, LOGS)
    recordings = observe_runs(runs, LOGS, SensorCondition.NOISY, 0)
    options = ElasticOptions()
    show_fits(
        "elastic arm, all methods, s",
        libraries,
        lambda library: prepare_methods(library, recordings, options)("automatic"),
    )


def main() -> None:
    """Print the tables."""
    show_functions()
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/data") / "tx40"
    if folder.is_dir():
        show_tx40(folder)
    else:
        print(f"{folder}: not there, no TX40")
    show_elastic()


if __name__ == "__main__":
    main()
