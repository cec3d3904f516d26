"""Programs that are timed, how they are run, and what they said.

Input: compiled programs. Output: nanoseconds and instructions of a call.
"""

import os
import re
import shutil
import statistics
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from robots import SAMPLES
from symid.arrays import FloatArray

__all__ = ["Contender", "count_instructions", "read_result", "time_contenders"]

_TIMEOUT = 600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Contender:
    """A program, and under which names it has each function; where there are several, the fastest counts."""

    family: str
    compiler: str
    program: Path
    states: Path
    names: Mapping[str, tuple[str, ...]]
    environment: Mapping[str, str] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Return the name of its column."""
        return f"{self.family} {self.compiler}"

    def run(self, *arguments: str, before: Sequence[str] = ()) -> str:
        """Return what the program prints."""
        command = [*before, str(self.program), str(self.states), *arguments]
        environment = {**os.environ, **self.environment, "LC_ALL": "C"}
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=True, timeout=_TIMEOUT
        )
        return done.stdout


def read_result(contender: Contender, name: str) -> FloatArray:
    """Return the output of the entry `name` for all samples, flat."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.bin"
        contender.run("check", name, str(path))
        return np.fromfile(path, dtype=float)


def time_contenders(
    contenders: Sequence[Contender],
    functions: Sequence[str],
    *,
    rounds: int,
    milliseconds: float,
    progress: Callable[[str], None],
) -> dict[tuple[str, str], float]:
    """Return the median nanoseconds of a call by label and function.

    Each figure of a round is one process; the contenders of a function follow one another, so that what
    else the machine does meets all of them alike.
    """
    times: dict[tuple[str, str, str], list[float]] = {}
    for turn in range(rounds):
        progress(f"round {turn + 1} of {rounds}")
        for function in functions:
            for contender in contenders:
                for name in contender.names.get(function, ()):
                    found = float(contender.run("time", name, str(milliseconds)))
                    times.setdefault((contender.label, function, name), []).append(found)
    medians: dict[tuple[str, str], float] = {}
    for (label, function, _), values in times.items():
        median = statistics.median(values)
        medians[label, function] = min(median, medians.get((label, function), median))
    return medians


def count_instructions(contender: Contender, functions: Sequence[str]) -> dict[str, float]:
    """Return the instructions of a call by function, as valgrind counts them, those of the loop included."""
    names = [name for function in functions for name in contender.names.get(function, ())]
    folder = Path(tempfile.mkdtemp())
    try:
        tool = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder / 'out'}"]
        contender.run("count", *names, before=tool)
        # One file a function, in order.
        totals = [_read_total(folder / f"out.{k + 1}") for k in range(len(names))]
    finally:
        shutil.rmtree(folder)
    counts = dict(zip(names, totals, strict=True))
    return {
        function: min(counts[name] for name in contender.names[function]) / SAMPLES
        for function in functions
        if contender.names.get(function)
    }


def _read_total(path: Path) -> float:
    found = re.search(r"^summary: (\d+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        text = f"{path}: no summary"
        raise ValueError(text)
    return float(found[1])
