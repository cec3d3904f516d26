"""How long `symid --help` takes, and which heavy packages it loads.

Run with the Python that symid is installed in: python benchmarks/startup.py
"""

import statistics
import subprocess
import sys
import time

RUNS = 10
HEAVY = ("numpy", "scipy", "sympy", "casadi", "jinja2")
COMMAND = ("-m", "symid", "--help")


def measure() -> float:
    """Return the wall time of one call in s."""
    start = time.perf_counter()
    subprocess.run([sys.executable, *COMMAND], check=True, capture_output=True)
    return time.perf_counter() - start


def find_loaded() -> list[str]:
    """Return the heavy packages that a call imports."""
    command = [sys.executable, "-X", "importtime", *COMMAND]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stderr.splitlines()
    loaded = {line.rsplit("|", 1)[-1].strip().split(".")[0] for line in lines}
    return [name for name in HEAVY if name in loaded]


def main() -> None:
    """Print the table."""
    measure()  # the first call writes the byte code
    times = [measure() for _ in range(RUNS)]
    print(f"symid --help, {RUNS} runs: median {statistics.median(times):.3f} s, ", end="")
    print(f"fastest {min(times):.3f} s, slowest {max(times):.3f} s (aim 0.15 s)")
    print(f"heavy packages loaded: {', '.join(find_loaded()) or 'none'}")


if __name__ == "__main__":
    main()
