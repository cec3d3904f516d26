"""How often stated intervals hold the truth, on simulated arms whose truth is not symid's.

    python benchmarks/coverage.py [--arms panda,z1] [--cases white,coloured,quantised,uneven,stribeck]
        [--seeds 20] [--first 0] [--processes 1] [--output RAW.json]
    python benchmarks/coverage.py --tables RAW.json     tables of earlier results again
    python benchmarks/coverage.py --write FOLDER ...    robot files, logs and truths instead of fits

Prints for every arm and case: share of 95 % intervals (1.96 stated deviations) that hold the truth, pooled
and of the least and the most covered parameter; median over parameters of rms error / rms stated deviation
(one where deviations are right); shares of verdict levels and refusals; residual; processor time of a fit.
Logs have 10 s at 250 Hz; every seed has another motion and other noise. Needs `pip install pin`.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from simulated_arms import ARMS, CASES, find_truth, simulate, write_arm_file

import symid

QUANTILE = 1.96


@cache
def load(arm, folder):
    """Return the robot of an arm, its file written anew, and the true values of its parameters."""
    path = write_arm_file(ARMS[arm], Path(folder))
    return symid.load(path), find_truth(arm, path)


def write_log(arm, case, seed, folder):
    """Write the log of one seed and return its path."""
    return simulate(ARMS[arm], CASES[case], seed).write(Path(folder) / f"{arm}_{case}_{seed}.npz")


def fit_one(task, folder):
    """Return what one log gives, in plain types."""
    arm, case, seed = task
    # Processes would write the robot file at the same time.
    robot, truth = load(arm, f"{folder}/{os.getpid()}")
    path = write_log(arm, case, seed, folder)
    found = {"arm": arm, "case": case, "seed": seed}
    start = time.process_time()
    try:
        fit = robot.identify(path)
        found |= describe(fit, truth)
    except symid.SymidError as error:
        codes = [notice.code for notice in error.notices]
        found |= {"level": f"exit {error.exit_code}", "headline": str(error)[:300], "codes": codes}
    except Exception as error:  # noqa: BLE001 - one log that fails must not end a long run; the table shows it
        found |= {"level": f"bug {type(error).__name__}", "headline": str(error)[:300]}
    finally:
        path.unlink()
    return found | {"seconds": time.process_time() - start}


def describe(fit, truth):
    """Return verdict, residual and every parameter beside its truth."""
    verdict = fit.verdict
    return {
        "level": verdict.level,
        "headline": verdict.headline,
        "cause": str(getattr(verdict, "cause", "") or ""),
        "residual": float(np.mean([entry.relative_percent for entry in fit.residual])),
        "codes": sorted({notice.code for notice in fit.notices if not notice.is_note}),
        "refused": sorted(fit.refused),
        "parameters": {name: [fit[name].value, fit[name].std, truth[name]] for name in fit},
    }


def measure(results):
    """Return coverage pooled, and of the least and most covered parameter with their names, in percent."""
    hits = {}
    for result in results:
        for name, (value, std, truth) in result.get("parameters", {}).items():
            hits.setdefault(name, []).append(abs(value - truth) <= QUANTILE * std)
    if not hits:
        return None
    shares = {name: 100.0 * float(np.mean(entries)) for name, entries in hits.items()}
    pooled = 100.0 * float(np.mean([hit for entries in hits.values() for hit in entries]))
    return pooled, min(shares.items(), key=lambda e: e[1]), max(shares.items(), key=lambda e: e[1])


def compute_scatter(results):
    """Return the median over parameters of rms error / rms stated deviation."""
    table = {}
    for result in results:
        for name, (value, std, truth) in result.get("parameters", {}).items():
            table.setdefault(name, []).append(((value - truth) ** 2, std**2))
    ratios = [np.sqrt(np.divide(*np.mean(entries, axis=0))) for entries in table.values()]
    return float(np.median(ratios)) if ratios else float("nan")


def print_tables(results):
    """Print one line an arm and case."""
    heads = ("arm", "case", "fits", "covered, %", "least", "most", "error / deviation", "verdicts")
    print(f"| {' | '.join((*heads, 'residual, %', 's a fit'))} |")
    print("|---" * (len(heads) + 2) + "|")
    for arm, case in dict.fromkeys((entry["arm"], entry["case"]) for entry in results):
        part = [entry for entry in results if (entry["arm"], entry["case"]) == (arm, case)]
        levels = Counter(entry["level"] for entry in part)
        shares = ", ".join(
            f"{level} {100 * count / len(part):.0f} %" for level, count in levels.most_common()
        )
        residual = np.mean([entry["residual"] for entry in part if "residual" in entry] or [np.nan])
        seconds = np.mean([entry["seconds"] for entry in part])
        found = measure(part)
        covered = "- | - | -"
        if found is not None:
            pooled, least, most = found
            covered = f"{pooled:.1f} | {least[1]:.0f} {least[0]} | {most[1]:.0f} {most[0]}"
        print(
            f"| {arm} | {case} | {len(part)} | {covered} | {compute_scatter(part):.2f} | {shares} "
            f"| {residual:.3g} | {seconds:.2f} |"
        )


def run(tasks, processes, folder):
    """Yield the result of every task, in their order."""
    if processes <= 1:
        yield from map(fit_one, tasks, repeat(folder))
        return
    # Every arm is compiled once, before processes ask for it.
    for arm in dict.fromkeys(task[0] for task in tasks):
        load(arm, folder)
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(fit_one, tasks, repeat(folder), chunksize=2)


def write_all(tasks, folder):
    """Write robot files, logs, and truths as JSON."""
    for arm, case, seed in tasks:
        _, truth = load(arm, str(folder))
        path = write_log(arm, case, seed, folder)
        (folder / f"{arm}_truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
        print(path)


def read_arguments():
    """Return the arguments of the call."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--arms", default=",".join(ARMS))
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--output", type=Path)
    parser.add_argument("--tables", type=Path)
    parser.add_argument("--write", type=Path)
    given = parser.parse_args()
    for option, allowed in (("arms", ARMS), ("cases", CASES)):
        names = getattr(given, option).split(",")
        if not set(names) <= set(allowed):
            parser.error(f"--{option}: there are {', '.join(allowed)}")
        setattr(given, option, names)
    return given


def main():
    """Fit and print, or only one of both."""
    given = read_arguments()
    if given.tables:
        print_tables(json.loads(given.tables.read_text(encoding="utf-8")))
        return
    seeds = range(given.first, given.first + given.seeds)
    tasks = [(arm, case, seed) for arm in given.arms for case in given.cases for seed in seeds]
    if given.write:
        given.write.mkdir(parents=True, exist_ok=True)
        write_all(tasks, given.write)
        return
    results = []
    try:
        with tempfile.TemporaryDirectory() as folder:
            for result in run(tasks, given.processes, folder):
                results.append(result)
                print(f"\r{len(results)}/{len(tasks)}", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
    finally:
        # Also what a run gave that was interrupted.
        if given.output:
            given.output.write_text(json.dumps(results), encoding="utf-8")
    print_tables(results)


if __name__ == "__main__":
    main()
