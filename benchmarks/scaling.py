"""Processor time and peak memory of generated code against the number of joints, with fitted exponents.

    python benchmarks/scaling.py [--sizes 5,10,20] [--shapes chain,tree] [--compile]

Chains, and trees of branches of five joints in which two branches begin where one ends. Each robot has a
process of its own: exact programs of all functions, C sources with reference values, and with --compile
make with the self-test. An exponent is the slope of the line through logarithms of time and joints.
"""

import argparse
import json
import math
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.generation import run_selftest
from symid.robot.description import Joint, JointKind, Robot
from symid.robot.geometry import Exact, build_exact_angle, place_modified_dh

# Modified Denavit-Hartenberg: turn about x, length along x, offset along z.
ROWS = (
    (0.0, "1/3", "1/10"),
    (0.5 * math.pi, "0", "1/5"),
    (-0.5 * math.pi, "3/10", "0"),
    (0.5 * math.pi, "1/4", "1/8"),
    (0.0, "1/5", "0"),
)
BRANCH = len(ROWS)


def build_robot(shape: str, size: int) -> Robot:
    """Return a chain or a tree of `size` revolute joints."""
    joints = []
    for index in range(size):
        alpha, length, offset = ROWS[index % BRANCH]
        branch, parent = index // BRANCH, index - 1
        if shape == "tree" and index % BRANCH == 0 and branch:
            parent = BRANCH * ((branch - 1) // 2) + BRANCH - 1
        placement = place_modified_dh(
            build_exact_angle(alpha), Exact.of(length), Exact.of(offset), build_exact_angle(0.0)
        )
        name = f"joint{index + 1}"
        joints.append(Joint(name=name, kind=JointKind.REVOLUTE, parent=parent, placement=placement))
    gravity = (Exact.of("0"), Exact.of("0"), Exact.of("-9.81"))
    return Robot(name=f"{shape}{size}", joints=tuple(joints), gravity=gravity)


def read_usage() -> tuple[float, float]:
    """Return processor time in s and peak in MB so far, children counted."""
    parts = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(p.ru_utime + p.ru_stime for p in parts), max(p.ru_maxrss for p in parts) / 1024.0


def measure(shape: str, size: int, *, compiled: bool) -> dict[str, float]:
    """Return seconds and MB of one robot in this process."""
    start, _ = read_usage()
    functions = build_functions(build_robot(shape, size))
    derived, derived_peak = read_usage()
    sources = generate_c_library(functions)
    written, written_peak = read_usage()
    found = {"derive s": derived - start, "derive MB": derived_peak}
    found |= {"write s": written - derived, "write MB": written_peak}
    found["operations"] = float(sum(len(program.instructions) for program in functions.programs))
    if compiled:
        with tempfile.TemporaryDirectory() as scratch:
            run_selftest(sources, Path(scratch), "c", "", lambda _: None)
        found["compile s"] = read_usage()[0] - written
    return found


def main() -> None:
    """Print a row a robot, and the exponents."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--sizes", default="5,10,20")
    parser.add_argument("--shapes", default="chain,tree")
    parser.add_argument("--compile", action="store_true", help="make and self-test too")
    parser.add_argument("--one", nargs=2, metavar=("SHAPE", "SIZE"), help="one robot, as JSON")
    order = parser.parse_args()
    if order.one:
        print(json.dumps(measure(order.one[0], int(order.one[1]), compiled=order.compile)))
        return
    sizes = [int(text) for text in order.sizes.split(",")]
    for shape in order.shapes.split(","):
        rows = []
        for size in sizes:
            call = [sys.executable, __file__, "--one", shape, str(size), *["--compile"] * order.compile]
            done = subprocess.run(call, check=True, capture_output=True, text=True)
            rows.append(json.loads(done.stdout))
            print(
                f"{shape} {size:3}", *(f"{name} {value:.3g}" for name, value in rows[-1].items()), flush=True
            )
        if len(sizes) > 1:
            for name in rows[0]:
                slope = np.polyfit(np.log(sizes), np.log([row[name] for row in rows]), 1)[0]
                print(f"{shape}, {name}: joints^{slope:.2f}", flush=True)


if __name__ == "__main__":
    main()
