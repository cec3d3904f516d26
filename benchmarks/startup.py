"""How long `symid --help`, `import symid` and `symid identify` take, and which heavy packages they load.

Run with the Python that symid is installed in: python benchmarks/startup.py [--python OTHER]
OTHER is the Python of another checkout's environment, which takes turns. The log of `identify` has five
seconds of a simulated arm of two links at 1 kHz; its library is built before anything is timed.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

RUNS = 7
HEAVY = ("numpy", "scipy", "sympy", "casadi", "click", "jinja2")
ROBOT = Path(__file__).resolve().parent.parent / "robots" / "two_link.toml"
AIMS = {"symid --help": 0.150, "import symid": 0.060}
"""Processor time in s."""


def list_calls(folder: Path) -> dict[str, tuple[str, ...]]:
    """Return what is called; `folder` has the log."""
    log, estimate = str(folder / "log.csv"), str(folder / "estimate.json")
    return {
        "symid --help": ("-m", "symid", "--help"),
        "import symid": ("-c", "import symid"),
        "symid identify": ("-m", "symid", "identify", str(ROBOT), log, "-o", estimate, "--force"),
        "python, nothing else": ("-c", ""),
    }


def run(command: tuple[str, ...]) -> str:
    """Run a command and return what it writes to the error stream; its byte code is kept."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment |= {"OMP_NUM_THREADS": "1"}
    # Python looks for packages in the folder that it is started in, before those of its environment.
    place = Path(command[0]).parent
    return subprocess.run(
        command, check=True, capture_output=True, text=True, env=environment, cwd=place
    ).stderr


def measure(command: tuple[str, ...]) -> float:
    """Return the processor time of one call in s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run(command)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def find_loaded(python: str, call: tuple[str, ...]) -> list[str]:
    """Return the heavy packages that a call imports."""
    lines = run((python, "-X", "importtime", *call)).splitlines()
    loaded = {line.rsplit("|", 1)[-1].strip().split(".")[0] for line in lines}
    return [name for name in HEAVY if name in loaded]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--python", action="append", default=[], metavar="OTHER")
    pythons = [sys.executable, *parser.parse_args().python]
    with tempfile.TemporaryDirectory() as scratch:
        calls = list_calls(Path(scratch))
        log = str(Path(scratch) / "log.csv")
        run((sys.executable, "-m", "symid", "simulate", str(ROBOT), "--duration", "5", "-o", log))
        for name, call in calls.items():
            for python in pythons:
                measure((python, *call))  # the first call writes the byte code, and builds a library
            turns = [[measure((python, *call)) for python in pythons] for _ in range(RUNS)]
            for python, times in zip(pythons, zip(*turns, strict=True), strict=True):
                aim = f" (aim {AIMS[name]:.3f} s)" if name in AIMS else ""
                print(
                    f"{name}, {python}, {RUNS} runs: median {statistics.median(times):.3f} s, "
                    f"least {min(times):.3f} s, most {max(times):.3f} s of processor time{aim}"
                )
                print(f"heavy packages loaded: {', '.join(find_loaded(python, call)) or 'none'}", flush=True)


if __name__ == "__main__":
    main()
