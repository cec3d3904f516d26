"""How long derivation takes, how many operations come out, and how both grow; imports apart.

    python benchmarks/derivation.py [ROBOT ...]

CPU seconds of one process: exact base parameters, exact energy regressors, the whole catalogue (base
parameters, all routes built and counted, the best one as a straight-line program); then products and sums of
the functions that controllers and identification call most. Without names: the first two to seven joints of
panda, the shipped arms and trees, and trees of thirty joints and more made of arms and legs of them.
"""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

from symid.codegen.functions import list_robot_specs
from symid.codegen.programs import count_operations
from symid.codegen.routes import choose_route
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.lagrange import derive_energy
from symid.robot.description import Joint, Robot
from symid.robot.loading import locate_robot_file
from symid.robot.toml_reader import read_robot

R = TypeVar("R")
COUNTED = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "torque_regressor", "energy_regressor")
# Exact energies of long chains hold more terms than anyone can read.
LARGEST_ENERGY = 7


def clock(action: Callable[[], R]) -> tuple[float, R]:
    """Return the CPU seconds that `action` took, and its result."""
    start = time.process_time()
    result = action()
    return time.process_time() - start, result


def load(name: str) -> Robot:
    """Return a shipped robot, or one from a file."""
    return read_robot(locate_robot_file(name))


def join(name: str, trunk: Robot, branch: Robot, times: int) -> Robot:
    """Return `trunk` with `times` copies of `branch` on its last link."""
    joints: list[Joint] = list(trunk.joints)
    for copy in range(times):
        start, last = len(joints), len(trunk.joints) - 1
        for joint in branch.joints:
            parent = start + joint.parent if joint.parent >= 0 else last
            joints.append(replace(joint, name=f"{joint.name}_{copy}", parent=parent))
    return replace(trunk, name=name, joints=tuple(joints))


def list_robots() -> list[Robot]:
    """Return the robots of the table."""
    panda, puma, quadruped = load("panda"), load("puma560"), load("quadruped")
    chains = [replace(panda, name=f"panda_{n}r", joints=panda.joints[:n]) for n in range(2, 8)]
    shipped = [load(name) for name in ("two_link", "puma560", "ur5", "lwr4", "two_arms", "quadruped")]
    large = [
        join("puma_4_pumas", puma, puma, 4),
        join("panda_4_pandas", panda, panda, 4),
        join("panda_3_quadrupeds", panda, quadruped, 3),
    ]
    return [*chains, *shipped, *large]


def measure(robot: Robot) -> list[str]:
    """Return the cells of a robot's line."""
    base_time, base = clock(lambda: derive_base_parameters(robot))
    specs = list_robot_specs(robot, base)
    energy = "-"
    if robot.size <= LARGEST_ENERGY:
        energy = f"{clock(lambda: derive_energy(robot))[0]:.3f}"

    def build() -> list[tuple[str, str]]:
        programs = [choose_route(robot, base, spec).program for spec in specs]
        counts = [(program.spec.name, count_operations(program)) for program in programs]
        return [(name, f"{count.mul}/{count.add}") for name, count in counts]

    code_time, counts = clock(build)
    whole = base_time + code_time
    found = dict(counts)
    cells = [robot.name, str(robot.size), str(base.count), f"{base_time:.3f}", energy, f"{whole:.2f}"]
    return [*cells, f"{1000 * whole / robot.size:.0f}", *(found[name] for name in COUNTED)]


def show(rows: Sequence[Sequence[str]]) -> None:
    """Print lines in columns."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    for row in rows:
        cells = [
            text.ljust(w) if not k else text.rjust(w)
            for k, (text, w) in enumerate(zip(row, widths, strict=True))
        ]
        print("  ".join(cells), flush=True)


def main(names: list[str]) -> None:
    """Print one line a robot."""
    head = ["robot", "joints", "beta", "base s", "energy s", "catalogue s", "ms/joint", *COUNTED]
    robots = [load(name) for name in names] or list_robots()
    measure(robots[0])  # the first call pays for what Python loads late
    show([head, *(measure(robot) for robot in robots)])


if __name__ == "__main__":
    main(sys.argv[1:])
