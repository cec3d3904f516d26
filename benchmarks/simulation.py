"""How fast rigid robots are simulated: the compiled plant and NumPy, as a multiple of real time, in one run.

    python benchmarks/simulation.py [SECONDS]      of simulated time, 10 by default

The arm is the UR5 of the package example-robot-data, with viscous and Coulomb friction in every joint, at 1
kHz with encoders; times are processor time of the plant alone, the smallest of three of the compiled one.
"""

import importlib.metadata
import re
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from symid import codegen, load
from symid.simulation import experiment, rigid_plant

FRICTION = '<dynamics damping="1.0" friction="2.0"/>'


def write_arm(folder):
    """Write the URDF with friction in every joint; return its path."""
    files = importlib.metadata.files("example-robot-data") or []
    source = next(file for file in files if str(file).endswith("ur_description/urdf/ur5_robot.urdf"))
    path = Path(folder) / "ur5.urdf"
    text = Path(str(source.locate())).read_text(encoding="utf-8")
    path.write_text(re.sub(r"<dynamics [^>]*/>", FRICTION, text), encoding="utf-8")
    return path


def measure(robot, seconds):
    """Return the processor time of the plant, the run, and what computed it."""
    spent = []

    def simulate(*arguments, **options):
        begin = time.process_time()
        found = rigid_plant.simulate_rigid_plant(*arguments, **options)
        spent.append((time.process_time() - begin, found))
        return found

    kept, experiment.simulate_rigid_plant = experiment.simulate_rigid_plant, simulate
    try:
        robot.simulate(duration=seconds)
    finally:
        experiment.simulate_rigid_plant = kept
    return spent[-1]


def main():
    """Print both plants."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    with tempfile.TemporaryDirectory() as folder:
        robot = load(write_arm(folder))
        # The first run compiles.
        times = [measure(robot, seconds) for _ in range(4)][1:]
        fast, compiled = min(times, key=lambda found: found[0])
        load_code, codegen.load_plant_code = codegen.load_plant_code, lambda *_: None
        slow, plain = measure(robot, seconds)
        codegen.load_plant_code = load_code
    gap = np.abs(compiled.q - plain.q).max()
    print(f"{seconds:g} s of six joints at 1 kHz, {compiled.events} stops")
    for name, used in (("compiled", fast), ("NumPy", slow)):
        rate = f"{seconds / used:8.3g} times real time {1e3 * used / seconds:8.3g} us a step"
        print(f"{name:10}{used:10.3g} s {rate}")
    print(f"ratio {slow / fast:.3g}, positions agree to {gap:.1g} rad")


if __name__ == "__main__":
    main()
