"""What a fleet costs beyond its identifications: synthetic nights in Parquet, a bare loop, and the fleet.

    .venv/bin/python benchmarks/fleet.py FOLDER --jobs 10000 --workers 2 --executor dask

Each night is the same simulated motion (10 s, 250 Hz) with torque noise of its own. Bare loops, one for each
worker, call `robot.identify` for the first --bare nights; the fleet must give the same values. Overhead is
all processor time of the fleet, workers and their start included, against that of the loops. Logs stay in
FOLDER, so that a fleet that was stopped goes on.

With --kill SEED five workers of Dask and its scheduler are killed on the way and started again, and the
fleet is called again after the scheduler is lost. At the end each job must have one result and one line of
costs, and the first --serial jobs the same bytes as in a serial run. Anything else is exit code 1. Wants an
empty FOLDER/results.
"""

import argparse
import collections
import csv
import importlib.metadata
import multiprocessing
import os
import signal
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pyarrow as pa
from killed_cluster import KilledCluster
from pyarrow.parquet import write_table

import symid
from symid.environment import limit_to_one_thread
from symid.errors import SolverError

NIGHTS = 7
ESTIMATOR = "wls"
_MOST_CALLS = 10
"""Of a fleet whose scheduler is killed once."""


def find_ur5():
    """Return the URDF of the UR5 in example-robot-data."""
    for file in importlib.metadata.files("example-robot-data") or []:
        if file.name == "ur5_robot.urdf":
            return Path(file.locate()).resolve()
    sys.exit("example-robot-data is not installed: pip install example-robot-data")


def write_logs(robot, folder, jobs):
    """Write the nights that are not there yet: FOLDER/ROBOT/NIGHT.parquet."""
    run = robot.simulate(
        duration=10.0, clean=True, seed=1, options=symid.SimulateOptions(control_period=0.004)
    )
    base = symid.read_log(run.save(folder / "clean.npz"), robot)
    scale = 0.02 * np.sqrt(np.mean(base.tau**2, axis=0)) + 0.01
    for k in range(jobs):
        path = folder / f"r{k // NIGHTS:05}" / f"night{k % NIGHTS + 1}.parquet"
        if path.exists():
            continue
        path.parent.mkdir(exist_ok=True)
        noise = np.random.default_rng(k).standard_normal(base.tau.shape)
        columns = {"t": base.time}
        for j, (q, tau) in enumerate(zip(base.q.T, (base.tau + scale * noise).T, strict=True), start=1):
            columns |= {f"q{j}": q, f"tau{j}": tau}
        # Whole or not at all: what is there is not written again.
        write_table(pa.table(columns), path.with_suffix(".new"))
        path.with_suffix(".new").replace(path)


def run_bare_loop(path, jobs):
    """Return values of each night, wall and processor time of a plain loop; the first fit is not counted."""
    robot = symid.load(path)
    robot.identify(jobs[0].logs[0], estimator=ESTIMATOR, settings=jobs[0].settings)
    start, used, values = time.monotonic(), time.process_time(), {}
    for job in jobs:
        fit = robot.identify(job.logs[0], estimator=ESTIMATOR, settings=job.settings)
        values[job.name, job.night] = dict(fit.values)
    return values, time.monotonic() - start, time.process_time() - used


def time_bare_loops(robot, jobs, workers):
    """Return what as many loops find as there are workers, side by side as those are, and all their times.

    Two processes that share caches and memory are slower than one alone.
    """
    shares = [jobs[k::workers] for k in range(workers)]
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as executor:
        found = list(executor.map(run_bare_loop, [robot.path] * workers, shares))
    values = {key: value for part, _, _ in found for key, value in part.items()}
    return values, *(sum(entry[k] for entry in found) for k in (1, 2))


def sum_processor_time():
    """Return the processor time of this process and of all children that have ended."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def run_killed(jobs, folder, *, workers, seed):
    """Return the fleet, its killed cluster, and how often it was called."""
    cluster = KilledCluster(
        folder / "results" / "results", folder / "dask.log", workers=workers, jobs=len(jobs), seed=seed
    )
    # Processes of the cluster end with this one.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with cluster:
        for calls in range(1, _MOST_CALLS + 1):
            cluster.wait()
            try:
                fleet = symid.fleet.run(
                    jobs, folder / "results", executor="dask", cluster=cluster.address, progress=print
                )
            except SolverError as error:
                print(f"ended with exit code {error.exit_code}: {error}", flush=True)
                continue
            return fleet, cluster, calls
    return sys.exit(f"the fleet did not end in {_MOST_CALLS} calls")


def check_killed(fleet, cluster, calls, jobs, folder):
    """Print what became of the jobs of a killed fleet; return whether all is as it has to be."""
    kept = folder / "results" / "results"
    with (folder / "results" / "costs.csv").open(encoding="utf-8") as stream:
        lines = collections.Counter(row[0] for row in csv.reader(stream))
    names = sorted(path.name for path in kept.iterdir())
    serial = symid.fleet.run(jobs, folder / "serial", executor="serial")
    files = [f"{row.key}.json" for row in serial.rows]
    same = sum(
        (kept / file).read_bytes() == (folder / "serial" / "results" / file).read_bytes() for file in files
    )
    once, done = names == sorted(f"{row.key}.json" for row in fleet.rows), fleet.counts.get("done", 0)
    twice = sum(count != 1 for count in lines.values())
    print(f"killed: {', '.join(cluster.killed)}; the fleet was called {calls} times")
    print(f"each job has one result, and no other file is there: {once}; with a fit: {done} of {len(names)}")
    print(f"jobs whose result was written twice: {twice}; without costs: {len(names) - len(lines)}")
    print(f"equal to the serial run in every byte: {same} of {len(files)}")
    print(
        f"Dask's own processes: {cluster.processor:.1f} s, largest memory of a worker {cluster.memory:.0f} MB"
    )
    once = once and lines.keys() == {row.key for row in fleet.rows}
    whole = once and twice == 0 and done == len(names)
    return whole and same == len(files) and len(cluster.killed) == len(cluster.moments)


def parse_arguments():
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--robot", default="ur5", help="ur5 of example-robot-data, or a robot with all values"
    )
    parser.add_argument("--jobs", type=int, default=10_000)
    parser.add_argument("--bare", type=int, default=100)
    parser.add_argument("--serial", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--executor", default="dask", choices=("serial", "processes", "dask"))
    parser.add_argument("--cluster", default="local")
    parser.add_argument("--kill", type=int, metavar="SEED")
    given = parser.parse_args()
    if given.kill is not None and (given.executor, given.cluster) != ("dask", "local"):
        parser.error("--kill has a Dask cluster of its own")
    return given


def main():
    """Make the nights, run loop and fleet, and print what they took."""
    given = parse_arguments()
    robot = symid.load(find_ur5() if given.robot == "ur5" else given.robot)
    given.folder.mkdir(parents=True, exist_ok=True)
    write_logs(robot, given.folder, given.jobs)
    study = given.folder / "study.toml"
    study.write_text(
        f'robot = "{robot.path.resolve()}"\nlogs = "r*/*.parquet"\nestimator = "{ESTIMATOR}"\n'
        '[settings]\n"processing.filter_cutoff" = 25\n"processing.decimation.factor" = 10\n'
    )
    jobs = symid.fleet.read_study(study)[: given.jobs]
    values, wall, processor = time_bare_loops(robot, jobs[: given.bare], given.workers)
    count = min(given.bare, len(jobs))
    each = f"{wall / count:.3f} s wall, {processor / count:.3f} s processor each"
    print(f"bare loops, {given.workers} side by side: {count} fits, {each}")
    start, before, dask = time.monotonic(), sum_processor_time(), 0.0
    if given.kill is None:
        fleet = symid.fleet.run(
            jobs,
            given.folder / "results",
            executor=given.executor,
            workers=given.workers,
            cluster=given.cluster,
            progress=print,
        )
    else:
        fleet, cluster, calls = run_killed(jobs, given.folder, workers=given.workers, seed=given.kill)
        dask = cluster.processor
    passed, used = time.monotonic() - start, sum_processor_time() - before
    with (given.folder / "results" / "costs.csv").open(encoding="utf-8") as stream:
        costs = np.array([[float(cell) for cell in row[2:]] for row in csv.reader(stream)])
    print(fleet.summarise())
    print(f"fleet: {passed:.1f} s wall, {passed * given.workers / len(jobs):.3f} s of a worker a job")
    print(f"jobs: {costs[:, 1].mean():.3f} s processor each, median {np.median(costs[:, 1]):.3f}")
    # Processes of Dask's workers are no children of this one: theirs is the jobs' own time alone, and that of
    # the workers themselves where they were started here.
    if given.executor == "dask":
        used = costs[:, 1].sum() + dask
    more = used / len(jobs) * count / processor - 1.0
    print(f"all processes: {used / len(jobs):.3f} s a job, {100.0 * more:+.1f} %")
    print(f"largest memory of a worker: {costs[:, 2].max():.0f} MB")
    rows = {(row.job.name, row.job.night): row for row in fleet.rows}
    same = sum(
        values[key] == {entry.name: entry.value for entry in rows[key].values if not entry.residual}
        for key in values
    )
    print(f"equal to the bare loop in every digit: {same} of {len(values)}")
    if given.kill is not None:
        right = check_killed(fleet, cluster, calls, jobs[: given.serial], given.folder)
        sys.exit(0 if right else 1)


if __name__ == "__main__":
    # A worker of Dask's imports this script.
    limit_to_one_thread()
    main()
