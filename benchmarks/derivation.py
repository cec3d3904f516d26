"""How long derivation takes, and how many operations come out; imports apart.

    python benchmarks/derivation.py [ROBOT ...]

CPU seconds of one process: base parameters, exact energy regressors, all functions of the catalogue as
straight-line programs; then products and sums of the functions that controllers and identification call most.
"""

import sys
import time
from collections.abc import Callable
from typing import TypeVar

from symid.codegen.casadi_functions import build_functions
from symid.codegen.instructions import count_operations
from symid.codegen.program import build_program
from symid.dynamics.base import find_base_parameters
from symid.dynamics.lagrange import derive_energy
from symid.robot.locate import find_robot_file
from symid.robot.toml import read_robot

R = TypeVar("R")
COUNTED = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "torque_regressor", "energy_regressor")


def clock(action: Callable[[], R]) -> tuple[float, R]:
    """Return the CPU seconds that `action` took, and its result."""
    start = time.process_time()
    result = action()
    return time.process_time() - start, result


def main(names: list[str]) -> None:
    """Print one line a robot."""
    print(f"{'robot':12}{'joints':>7}{'beta':>6}{'base s':>9}{'energy s':>10}{'functions s':>13}", end="")
    print("".join(f"{name + ' mul/add':>26}" for name in COUNTED))
    for name in names:
        robot = read_robot(find_robot_file(name))
        base_time, base = clock(lambda robot=robot: find_base_parameters(robot))
        energy_time, _ = clock(lambda robot=robot: derive_energy(robot))

        def build(robot=robot):
            functions = build_functions(robot)
            return [
                build_program(function, spec)
                for function, spec in zip(functions.functions, functions.card.functions, strict=True)
            ]

        program_time, programs = clock(build)
        print(
            f"{robot.name:12}{robot.size:7}{base.count:6}{base_time:9.3f}{energy_time:10.3f}{program_time:13.2f}",
            end="",
        )
        counts = {program.spec.name: count_operations(program) for program in programs}
        print("".join(f"{f'{counts[c].mul}/{counts[c].add}':>26}" for c in COUNTED))


if __name__ == "__main__":
    main(sys.argv[1:] or ["emps", "two_link", "puma560", "panda"])
