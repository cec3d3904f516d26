"""How long `symid --help` and `import symid` take, and which heavy packages they load.

Run with the Python that symid is installed in: python benchmarks/startup.py
"""

import statistics
import subprocess
import sys
import time

RUNS = 10
HEAVY = ("numpy", "scipy", "sympy", "casadi", "click", "jinja2")
CALLS = {
    "symid --help": (("-m", "symid", "--help"), 0.150),
    "import symid": (("-c", "import symid"), 0.060),
    "python, nothing else": (("-c", ""), None),
}
"""What is called, and the aim in s."""


def measure(command: tuple[str, ...]) -> float:
    """Return the wall time of one call in s."""
    start = time.perf_counter()
    subprocess.run([sys.executable, *command], check=True, capture_output=True)
    return time.perf_counter() - start


def find_loaded(command: tuple[str, ...]) -> list[str]:
    """Return the heavy packages that a call imports."""
    line = [sys.executable, "-X", "importtime", *command]
    lines = subprocess.run(line, check=True, capture_output=True, text=True).stderr.splitlines()
    loaded = {line.rsplit("|", 1)[-1].strip().split(".")[0] for line in lines}
    return [name for name in HEAVY if name in loaded]


def main() -> None:
    """Print the table."""
    for name, (command, aim) in CALLS.items():
        measure(command)  # the first call writes the byte code
        times = [measure(command) for _ in range(RUNS)]
        print(f"{name}, {RUNS} runs: median {statistics.median(times):.3f} s, ", end="")
        print(f"fastest {min(times):.3f} s, slowest {max(times):.3f} s", end="")
        print(f" (aim {aim:.3f} s)" if aim else "")
        print(f"heavy packages loaded: {', '.join(find_loaded(command)) or 'none'}")


if __name__ == "__main__":
    main()
