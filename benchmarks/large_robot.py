"""Processor time and peak memory of the code of a large robot: derived, written, compiled and tested.

    python benchmarks/large_robot.py ROBOT

The humanoid G1 with 29 joints, for example, comes with the package example-robot-data as
robots/g1_description/urdf/g1_29dof_rev_1_0.urdf. Three phases run one after the other: the exact programs of
all functions, the C sources with reference values, and make with the self-test. Times are of this process and
all that it starts; memory is the peak of the largest process.
"""

import argparse
import resource
import tempfile
from pathlib import Path

import symid
from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.generation import run_selftest


def measure() -> tuple[float, int]:
    """Return the processor time in s and the largest peak in kB so far, children counted."""
    parts = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(p.ru_utime + p.ru_stime for p in parts), max(p.ru_maxrss for p in parts)


def main() -> None:
    """Print a line a phase."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("robot", help="a robot file, or a name of symid")
    robot, last = symid.load(parser.parse_args().robot).description, measure()[0]

    def report(phase: str) -> None:
        nonlocal last
        now, peak = measure()
        print(f"{phase:<24} {now - last:7.1f} s   peak so far {peak / 1024:6.0f} MB", flush=True)
        last = now

    functions = build_functions(robot)
    report("exact programs")
    sources = generate_c_library(functions)
    report("sources and references")
    with tempfile.TemporaryDirectory() as scratch:
        record = run_selftest(sources, Path(scratch), "c", "", lambda _: None)
    report(f"make, self-test {record.selftest}")
    print(f"{'all':<24} {measure()[0]:7.1f} s")


if __name__ == "__main__":
    main()
