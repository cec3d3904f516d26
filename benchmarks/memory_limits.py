"""Calls of symid in processes of limited address space (`ulimit -v`): how each of them ends.

    .venv/bin/python benchmarks/memory_limits.py FOLDER [--robot two_link] [--limits 30] [--seconds 60]

`identify` and `generate` begin with an empty cache of compiled code, so that compilers have the limit, too.
A call must end within --seconds, with 0, 3 or 5; if not with 0, its last line on stderr is the one that
begins with "error: ", and no line is a traceback's. After the table come calls of the smallest, a middle
and the largest limit that get SIGTERM at a random moment and must end within two seconds. Exit code 1 if one
misses.
"""

import argparse
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

CALLS = {
    "identify": "identify {robot} log.npz -o out.json --force",
    "generate": "generate {robot} --target c -o code --force",
    "report": "report fit.json -o page.html --force",
}
SMALLEST, LARGEST = 300, 1500
"""Limits in MB."""
MOST_SECONDS_AFTER_SIGTERM = 2.0
CODES = {0, 3, 5}


def start(call, folder, megabytes=None):
    """Start a call in a folder, with an empty cache."""
    shutil.rmtree(folder / "cache", ignore_errors=True)
    limited = "ulimit -v " + ("unlimited" if megabytes is None else str(megabytes << 10))
    return subprocess.Popen(
        ["/bin/sh", "-c", f'{limited}; exec "$@"', "sh", sys.executable, "-m", "symid", *call.split()],
        cwd=folder,
        env=os.environ | {"XDG_CACHE_HOME": str(folder / "cache")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process, seconds):
    """Return exit code (None: it had to be killed) and lines on stderr."""
    try:
        _, said = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        return None, process.communicate()[1].splitlines()
    return process.returncode, said.splitlines()


def read_processor_time():
    """Return what all calls that have ended have taken, in s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def judge(code, lines):
    """Return what is wrong with an ending, or nothing."""
    errors = [line for line in lines if line.startswith("error: ")]
    if code is None:
        return "no end"
    if code not in CODES:
        return f"exit code {code}"
    if any("Traceback" in line for line in lines):
        return "traceback"
    return "" if code == 0 or (len(errors) == 1 and lines[-1] == errors[0]) else "not one sentence"


def main():
    """Print exit codes and processor times, a row for each limit, and calls that get SIGTERM."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="a new one")
    parser.add_argument("--robot", default="two_link")
    parser.add_argument("--duration", type=float, default=5.0, help="of the log, in s")
    parser.add_argument("--limits", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=60.0, help="more where other work slows the machine")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    folder = given.folder.resolve()
    folder.mkdir(parents=True)
    calls = {name: call.format(robot=given.robot) for name, call in CALLS.items()}
    log = f"simulate {given.robot} --duration {given.duration} --seed 1 -o log.npz"
    for call in (log, f"identify {given.robot} log.npz -o fit.json"):
        code, lines = finish(start(call, folder), 600.0)
        if code:
            sys.exit("\n".join(lines))
    limits = [round(limit) for limit in np.linspace(SMALLEST, LARGEST, given.limits)]
    faults = []
    print(f"{'MB':>5}" + "".join(f"{name:>20}" for name in calls))
    for limit in limits:
        cells = []
        for name, call in calls.items():
            before = read_processor_time()
            code, lines = finish(start(call, folder, limit), given.seconds)
            wrong = judge(code, lines)
            faults += [f"{name} at {limit} MB: {wrong}: {lines[-3:]}"] if wrong else []
            cells.append(f"{code}, {read_processor_time() - before:.1f} s{' (!)' if wrong else ''}")
        print(f"{limit:5}" + "".join(f"{cell:>20}" for cell in cells), flush=True)
    rng = np.random.default_rng(given.seed)
    for limit in (limits[0], limits[len(limits) // 2], limits[-1]):
        for name, call in calls.items():
            process = start(call, folder, limit)
            time.sleep(rng.uniform(0.5, 4.0))
            began = time.monotonic()
            process.send_signal(signal.SIGTERM)
            code, _ = finish(process, given.seconds)
            passed = time.monotonic() - began
            print(f"{name} at {limit} MB: {code}, {passed:.2f} s after SIGTERM", flush=True)
            if code not in {130, *CODES} or passed > MOST_SECONDS_AFTER_SIGTERM:
                faults.append(f"{name} at {limit} MB: {code}, {passed:.1f} s after SIGTERM")
    print("\n".join(faults))
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
