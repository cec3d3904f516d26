"""Does identification say what is wrong with a log? Corrupted copies of clean logs, and clean logs.

    python benchmarks/corrupted_logs.py [--data ../shared/data] [--processes 1] [--output RAW.json]
        [--only TEXT]       entries whose name contains TEXT
        [--kept]            the half that is not for design: names whose SHA-256 is odd
        [--drawn SEED]      forty others, drawn at random: kind, joints, size, arm
        [--clean]           twenty clean logs in place of corrupted ones
        [--list]            names and what is expected, nothing is fitted
        [--write FOLDER]    robot files and logs, nothing is fitted
    python benchmarks/corrupted_logs.py --tables RAW.json

Every log is made in memory, written to a temporary .npz in SI units on the joint side, and identified with
defaults by its robot file, so that readers and checks see what a user's file would give.

What is expected of an entry:
    seen        verdict `wrong` (exit code 1) or a refusal (3, 4)
    noticed     at least a lower verdict, or a warning, than the clean log gives
    either      so small that both answers are right; listed only
    unseen      no torque can show it: must not be called wrong or refused
    clean       likewise
What came out: `ok`, or `doubtful`, `warned` (a lower verdict or a new warning, but exit code 0 where `seen`
is expected), `SILENT`, `REFUSED`, `BASE` (refused as the clean log is, which says nothing), `BUG` (an
exception that is not symid's), `quiet` (no sign, where either is right).
"""

import argparse
import hashlib
import json
import os
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from simulated_arms import (
    ARMS,
    CASES,
    HERE,
    ROBOTS,
    Case,
    Run,
    couple_joints,
    draw_motion,
    furnish,
    hold_joint,
    map_log,
    scale_friction,
    simulate,
)

import symid

LEVELS = {"good": 0, "usable": 1, "fair": 1, "doubtful": 2, "poor": 2, "wrong": 3}
BASES = ("tx40", "kr300", "pendulum", "panda", "z1")
SENSORS = Case(position=(3e-5, 3e-5), torque=(0.02, 0.02))
"""Of the simulated logs that are corrupted."""
SEED = 100

Runs = tuple[Run, ...]
Change = Callable[[Run, np.random.Generator], Run]


@dataclass(frozen=True, kw_only=True)
class Base:
    """Clean logs of a robot: the text of its file, logs, and logs of other motions."""

    text: str
    runs: Runs
    foreign: Runs


Maker = Callable[[Base, np.random.Generator], Base]


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One corruption: what it does to logs and robot file, and what should come of it."""

    name: str
    base: str
    expected: str
    make: Maker

    @property
    def kept(self) -> bool:
        """Return whether it belongs to the half that is kept for the end."""
        return hashlib.sha256(self.name.encode()).digest()[-1] % 2 == 1


# Clean logs.


def find_files(data: Path) -> dict[str, tuple[Path, list[Path]]]:
    """Return the robot file and the logs of every real set."""
    return {
        "tx40": (ROBOTS / "tx40.toml", [data / "tx40" / "tx40.npz"]),
        "kr300": (ROBOTS / "kr300.toml", [data / "kr300" / f"run_{run}.npz" for run in "abc"]),
        "pendulum": (
            ROBOTS / "double_pendulum.toml",
            [data / "double_pendulum" / f"run_{run}.csv" for run in range(1, 5)],
        ),
        "emps": (ROBOTS / "emps.toml", [data / "emps" / f"DATA_EMPS{end}.mat" for end in ("", "_PULSES")]),
    }


@cache
def read_runs(data: Path, name: str) -> tuple[str, Runs]:
    """Return the robot file and the logs of a real set, in SI units on the joint side."""
    path, logs = find_files(data)[name]
    robot = symid.load(path)
    read = [symid.read_log(log, robot, uneven=True) for log in logs]
    runs = tuple(Run(time=log.time, q=log.q, tau=log.tau, dq=log.dq) for log in read)
    return path.read_text(encoding="utf-8"), runs


@cache
def load_base(data: Path, name: str) -> Base:
    """Return clean logs: TX40 whole, KR300 A and B, pendulum 1 and 2, or 10 s of a simulated arm."""
    if name in ARMS:
        arm, speed = ARMS[name], name == "z1"
        runs = tuple(simulate(arm, SENSORS, SEED + number, velocity=speed) for number in range(2))
        text = furnish(arm.robot.read_text(encoding="utf-8"))
        return Base(text=text, runs=runs[:1], foreign=runs[1:])
    text, runs = read_runs(data, name)
    if name == "tx40":
        return Base(text=text, runs=runs, foreign=())
    return Base(text=text, runs=runs[:2], foreign=runs[2:])


# Corruptions of one log; joints count from one.


def cut(run: Run, kept: np.ndarray | slice) -> Run:
    """Return the samples `kept`."""
    dq = None if run.dq is None else run.dq[kept]
    return replace(run, time=run.time[kept], q=run.q[kept], tau=run.tau[kept], dq=dq)


def join(first: Run, second: Run) -> Run:
    """Return two logs in one, stamps as they are."""
    dq = None if first.dq is None or second.dq is None else np.concatenate([first.dq, second.dq])
    time, q, tau = (
        np.concatenate([getattr(first, name), getattr(second, name)]) for name in ("time", "q", "tau")
    )
    return Run(time=time, q=q, tau=tau, dq=dq)


def get_period(run: Run) -> float:
    """Return the mean period, s."""
    return float((run.time[-1] - run.time[0]) / (len(run.time) - 1))


def map_torque(change: Callable[[np.ndarray, Run, np.random.Generator], np.ndarray]) -> Change:
    """Return a corruption of the torques alone."""
    return lambda run, rng: replace(run, tau=change(run.tau.copy(), run, rng))


def multiply(values: np.ndarray, joint: int | None, factor: float) -> np.ndarray:
    """Return values with one column, or all, times `factor`."""
    factors = np.ones(values.shape[1])
    factors[slice(None) if joint is None else joint - 1] = factor
    return values * factors


def scale_torque(joint: int | None, factor: float) -> Change:
    """Multiply one torque, or all."""
    return map_torque(lambda tau, *_: multiply(tau, joint, factor))


def scale_position(joint: int | None, factor: float) -> Change:
    """Multiply one position, or all, with their velocities."""

    def change(run: Run, _: np.random.Generator) -> Run:
        dq = None if run.dq is None else multiply(run.dq, joint, factor)
        return replace(run, q=multiply(run.q, joint, factor), dq=dq)

    return change


def exchange(what: str, one: int, other: int) -> Change:
    """Exchange columns of "torque", "position" or "both"."""

    def change(run: Run, _: np.random.Generator) -> Run:
        order = list(range(run.q.shape[1]))
        order[one - 1], order[other - 1] = order[other - 1], order[one - 1]
        tau = run.tau if what == "position" else run.tau[:, order]
        if what == "torque":
            return replace(run, tau=tau)
        return replace(run, q=run.q[:, order], tau=tau, dq=None if run.dq is None else run.dq[:, order])

    return change


def replace_by_noise(kind: str) -> Change:
    """Put noise of the same mean square in place of torques, white or below about 1 Hz."""

    def change(tau: np.ndarray, run: Run, rng: np.random.Generator) -> np.ndarray:
        noise = rng.standard_normal(tau.shape)
        if kind == "smooth":
            width = max(2, round(0.4 / get_period(run)))
            window = np.hanning(width + 2)
            noise = np.array([np.convolve(column, window, mode="same") for column in noise.T]).T
        return noise / np.sqrt(np.mean(noise**2, axis=0)) * np.sqrt(np.mean(tau**2, axis=0))

    return map_torque(change)


def shuffle(seconds: float) -> Change:
    """Shuffle torques in blocks."""

    def change(tau: np.ndarray, run: Run, rng: np.random.Generator) -> np.ndarray:
        width = max(1, round(seconds / get_period(run)))
        blocks = [tau[start : start + width] for start in range(0, len(tau), width)]
        order = np.roll(rng.permutation(len(blocks)), 1)
        return np.concatenate([blocks[number] for number in order])

    return map_torque(change)


def scale_time(factor: float) -> Change:
    """Multiply the stamps; velocities stay as logged."""
    return lambda run, _: replace(run, time=run.time[0] + factor * (run.time - run.time[0]))


def delay_torque(seconds: float) -> Change:
    """Log torques late, or early where negative; what is shifted out is lost."""

    def change(run: Run, _: np.random.Generator) -> Run:
        shift = round(abs(seconds) / get_period(run))
        early, late = slice(None, -shift), slice(shift, None)
        at, taken = (late, early) if seconds > 0.0 else (early, late)
        return replace(cut(run, at), tau=run.tau[taken])

    return change


def stick(joint: int, share: float) -> Change:
    """Hold an encoder from a share of the log on; its velocity is then zero."""

    def change(run: Run, _: np.random.Generator) -> Run:
        start = round(share * len(run.q))
        q, dq = run.q.copy(), None if run.dq is None else run.dq.copy()
        q[start:, joint - 1] = q[start, joint - 1]
        if dq is not None:
            dq[start:, joint - 1] = 0.0
        return replace(run, q=q, dq=dq)

    return change


def wrap(joint: int) -> Change:
    """Wrap an encoder: it jumps by a turn where the joint passes the middle of its range."""

    def change(run: Run, _: np.random.Generator) -> Run:
        q = run.q.copy()
        column = q[:, joint - 1]
        middle = (column.min() + column.max()) / 2.0
        q[:, joint - 1] = column - 2.0 * np.pi * (column > middle)
        return replace(run, q=q)

    return change


def shift_position(joint: int, offset: float) -> Change:
    """Add an offset to a position."""

    def change(run: Run, _: np.random.Generator) -> Run:
        q = run.q.copy()
        q[:, joint - 1] += offset
        return replace(run, q=q)

    return change


def shift_torque(joint: int, share: float) -> Change:
    """Add a share of its largest value to a torque."""

    def change(tau: np.ndarray, *_: object) -> np.ndarray:
        tau[:, joint - 1] += share * np.abs(tau[:, joint - 1]).max()
        return tau

    return map_torque(change)


def clip_torque(share: float) -> Change:
    """Clip torques at a share of their largest values."""

    def change(tau: np.ndarray, *_: object) -> np.ndarray:
        most = share * np.abs(tau).max(axis=0)
        return np.clip(tau, -most, most)

    return map_torque(change)


def round_torque(share: float) -> Change:
    """Round torques to steps of a share of their largest values."""

    def change(tau: np.ndarray, *_: object) -> np.ndarray:
        step = share * np.abs(tau).max(axis=0)
        return step * np.round(tau / step)

    return map_torque(change)


def round_position(bits: int) -> Change:
    """Round positions to encoder steps on the joint side."""
    step = 2.0 * np.pi / 2**bits
    return lambda run, _: replace(run, q=step * np.round(run.q / step))


def open_gaps(count: int, width: int, *, closed: bool = False) -> Change:
    """Remove stretches of samples; stamps stay true, or are closed up."""

    def change(run: Run, rng: np.random.Generator) -> Run:
        size = len(run.time)
        kept = np.ones(size, dtype=bool)
        for number in range(count):
            start = round(size * (number + rng.uniform(0.3, 0.7)) / count)
            kept[start : start + width] = False
        found = cut(run, kept)
        return replace(found, time=run.time[: len(found.time)]) if closed else found

    return change


def cut_time(seconds: float) -> Change:
    """Remove a stretch from the middle and close the stamps up."""
    return lambda run, rng: open_gaps(1, round(seconds / get_period(run)), closed=True)(run, rng)


def turn_back(step: int) -> Change:
    """Let a stamp in the middle repeat the one before (0), or fall behind by so many periods."""

    def change(run: Run, _: np.random.Generator) -> Run:
        times, middle = run.time.copy(), len(run.time) // 2
        times[middle] = times[middle - 1] - step * get_period(run)
        return replace(run, time=times)

    return change


def hold(share: float) -> Change:
    """Drop a share of the packets: all channels keep the last value."""

    def change(run: Run, rng: np.random.Generator) -> Run:
        fresh = rng.uniform(size=len(run.time)) >= share
        fresh[0] = True
        last = np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0))
        return replace(cut(run, last), time=run.time)

    return change


def shake(factor: float) -> Change:
    """Add white noise to positions, `factor` times their own (that of the third differences)."""

    def change(run: Run, rng: np.random.Generator) -> Run:
        rough = np.median(np.abs(np.diff(run.q, 3, axis=0)), axis=0) / 0.6745 / np.sqrt(20.0)
        own = np.maximum(rough, 1e-6)
        return replace(run, q=run.q + factor * own * rng.standard_normal(run.q.shape))

    return change


# The table.


class Table:
    """Entries, in the order in which they are added."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []

    def add(
        self, base: str, title: str, expected: str, make: Callable[[Base, np.random.Generator], Base]
    ) -> None:
        """Add an entry."""
        self.entries.append(Entry(name=f"{base}: {title}", base=base, expected=expected, make=make))

    def each(self, base: str, title: str, expected: str, change: Change) -> None:
        """Add an entry that changes every log of the base."""
        self.add(
            base,
            title,
            expected,
            lambda clean, rng: replace(clean, runs=tuple(change(run, rng) for run in clean.runs)),
        )

    def edit(self, base: str, title: str, expected: str, change: Callable[[str], str]) -> None:
        """Add an entry that changes the robot file."""
        self.add(base, title, expected, lambda clean, _: replace(clean, text=change(clean.text)))


def substitute(old: str, new: str) -> Callable[[str], str]:
    """Return a change of a robot file at the first place that the pattern `old` describes."""

    def change(text: str) -> str:
        found, count = re.subn(old, new, text, count=1)
        if not count:
            message = f"the robot file has no {old!r}; mend benchmarks/corrupted_logs.py"
            raise SystemExit(message)
        return found

    return change


def take_foreign(clean: Base, _: np.random.Generator) -> Base:
    """Return logs with the torques of other motions; of one log its later half in its first half."""
    runs = []
    for run, other in zip(clean.runs, clean.foreign or clean.runs, strict=False):
        size = min(len(run.tau), len(other.tau))
        at = slice(0, size) if clean.foreign else slice(0, size // 2)
        taken = at if clean.foreign else slice(size - size // 2, size)
        runs.append(replace(cut(run, at), tau=other.tau[taken]))
    return replace(clean, runs=tuple(runs))


def join_runs(clean: Base, _: np.random.Generator) -> Base:
    """Return two logs joined in one file: the time starts again in the middle."""
    first, second = (*clean.runs, *clean.foreign)[:2]
    return replace(clean, runs=(join(first, second),))


def repeat_log(change: Change) -> Callable[[Base, np.random.Generator], Base]:
    """Return the logs and a copy of the first one, changed a little."""
    return lambda clean, rng: replace(clean, runs=(*clean.runs, change(clean.runs[0], rng)))


def move_otherwise(name: str, change: Callable) -> Callable[[Base, np.random.Generator], Base]:
    """Return a log of a simulated arm along a changed motion."""

    def make(clean: Base, _: np.random.Generator) -> Base:
        motion = change(draw_motion(ARMS[name], np.random.default_rng([1, SEED])))
        return replace(
            clean, runs=(simulate(ARMS[name], SENSORS, SEED, motion=motion, velocity=name == "z1"),)
        )

    return make


def add_exchanged(table: Table) -> None:
    """Add torques of other runs, exchanged and inverted columns."""
    for base in BASES:
        table.add(base, "torque of another run", "seen", take_foreign)
    pairs = {
        "tx40": [(2, 3, "seen"), (5, 6, "noticed")],
        "kr300": [(2, 3, "seen"), (4, 5, "noticed")],
        "pendulum": [(1, 2, "seen")],
        "panda": [(2, 4, "seen"), (6, 7, "seen")],
        "z1": [(2, 3, "seen"), (4, 5, "seen")],
    }
    for base, found in pairs.items():
        for what in ("torque", "position"):
            for one, other, expected in found:
                table.each(
                    base, f"{what} columns {one} and {other} exchanged", expected, exchange(what, one, other)
                )
    for base, one, other in (
        ("tx40", 2, 3),
        ("kr300", 1, 2),
        ("pendulum", 1, 2),
        ("panda", 2, 4),
        ("z1", 2, 3),
    ):
        table.each(base, f"joints {one} and {other} exchanged", "seen", exchange("both", one, other))
    joints = {"tx40": (2, 5), "kr300": (1, 3), "pendulum": (2,), "panda": (1, 4, 7), "z1": (3,)}
    for base, numbers in joints.items():
        for joint in numbers:
            table.each(base, f"torque {joint} inverted", "seen", scale_torque(joint, -1.0))
    joints = {"tx40": (3,), "kr300": (2,), "pendulum": (1,), "panda": (1, 6), "z1": (5,)}
    for base, numbers in joints.items():
        for joint in numbers:
            table.each(base, f"position {joint} inverted", "seen", scale_position(joint, -1.0))
    for base in BASES:
        table.each(base, "all torques inverted", "seen", scale_torque(None, -1.0))
    for base in ("pendulum", "panda"):
        table.each(base, "all positions inverted", "seen", scale_position(None, -1.0))


def add_units(table: Table) -> None:
    """Add wrong units, factors and gears."""
    degrees = 180.0 / np.pi
    for base in BASES:
        table.each(base, "degrees for radians", "seen", scale_position(None, degrees))
    for base, joint in (("tx40", 4), ("kr300", 1), ("pendulum", 2), ("panda", 5), ("z1", 2)):
        table.each(base, f"degrees in joint {joint}", "seen", scale_position(joint, degrees))
    for base, joint in (("tx40", 2), ("kr300", 3), ("pendulum", 1), ("panda", 4), ("z1", 1)):
        table.each(base, f"torque {joint} in mN m", "seen", scale_torque(joint, 1e3))
    # The limits of the Panda's file show it.
    for base, expected in (("tx40", "unseen"), ("pendulum", "unseen"), ("panda", "noticed")):
        table.each(base, "all torques in mN m", expected, scale_torque(None, 1e3))
    for base in BASES:
        table.each(base, "all torques times 1.2", "unseen", scale_torque(None, 1.2))
    for base, factor, expected in (
        ("tx40", 1.2, "either"),
        ("panda", 1.2, "either"),
        ("tx40", 2.0, "either"),
        ("z1", 2.0, "either"),
    ):
        table.each(base, f"torque 2 times {factor:g}", expected, scale_torque(2, factor))
    gears = (
        ("tx40", 2, 32, "seen"),
        ("tx40", 6, 32, "noticed"),
        ("kr300", 2, 267.4, "seen"),
        ("pendulum", 1, 6, "seen"),
        ("panda", 4, 100, "seen"),
        ("z1", 2, 121, "seen"),
    )
    for base, joint, gear, expected in gears:
        table.each(base, f"gear of torque {joint} missing", expected, scale_torque(joint, 1.0 / gear))


def add_noise(table: Table) -> None:
    """Add noise, steps, clipping and offsets."""
    for base, kind in (
        *(("tx40", "white"), ("tx40", "smooth"), ("kr300", "smooth")),
        *(("pendulum", "white"), ("panda", "smooth"), ("z1", "white")),
    ):
        table.each(base, f"{kind} noise for torque", "seen", replace_by_noise(kind))
    for base, seconds in (("tx40", 1.0), ("tx40", 0.1), ("pendulum", 1.0), ("panda", 0.5), ("z1", 2.0)):
        table.each(base, f"torque shuffled in blocks of {seconds:g} s", "seen", shuffle(seconds))
    for base, bits, expected in (
        *(("tx40", 12, "either"), ("panda", 12, "either"), ("z1", 12, "either")),
        *(("kr300", 10, "noticed"), ("panda", 9, "noticed")),
    ):
        table.each(base, f"positions of {bits} bits", expected, round_position(bits))
    for base, share, expected in (
        *(("tx40", 0.1, "either"), ("z1", 0.1, "either"), ("panda", 0.3, "noticed")),
        *(("pendulum", 0.3, "noticed"), ("kr300", 0.3, "noticed")),
    ):
        table.each(base, f"torque in steps of {share:.0%}", expected, round_torque(share))
    for base in BASES:
        table.each(base, "position noise 10 times", "either", shake(10.0))
    # A low band makes up for it.
    for base in ("tx40", "panda", "z1"):
        table.each(base, "position noise 100 times", "either", shake(100.0))
    for base, share, expected in (
        *((base, 0.5, "noticed") for base in BASES),
        *(("panda", 0.8, "either"), ("z1", 0.25, "noticed")),
    ):
        table.each(base, f"torque clipped at {share:.0%}", expected, clip_torque(share))
    # An offset is a parameter of the TX40 and the KR300.
    for base, joint, expected in (
        *(("tx40", 6, "unseen"), ("kr300", 6, "unseen"), ("pendulum", 2, "noticed")),
        *(("panda", 7, "noticed"), ("z1", 6, "noticed")),
    ):
        table.each(base, f"offset of torque {joint} by 20 %", expected, shift_torque(joint, 0.2))


def add_times(table: Table) -> None:
    """Add what is wrong with time."""
    for factor, expected, bases in (
        (2.0, "seen", ("tx40", "kr300", "panda")),
        (2.0, "noticed", ("z1",)),
        (0.5, "seen", ("tx40", "pendulum", "panda")),
        (1.05, "unseen", ("tx40", "panda")),
        # Their logs have velocities.
        (1.05, "either", ("kr300", "pendulum", "z1")),
        (1000.0, "seen", ("tx40", "panda", "z1")),
        (0.001, "seen", ("pendulum", "kr300")),
    ):
        for base in bases:
            table.each(base, f"time times {factor:g}", expected, scale_time(factor))
    for seconds, expected, bases in (
        (0.005, "either", ("tx40", "panda")),
        (0.02, "noticed", ("tx40", "kr300")),
        (0.02, "either", ("pendulum", "z1")),
        (-0.02, "noticed", ("tx40",)),
        (0.1, "noticed", BASES),
        (1.0, "seen", BASES),
    ):
        for base in bases:
            word = "late" if seconds > 0.0 else "early"
            table.each(base, f"torque {abs(1e3 * seconds):g} ms {word}", expected, delay_torque(seconds))
    for base, count, width, expected in (
        *(("tx40", 1, 50, "either"), ("panda", 1, 50, "noticed"), ("kr300", 5, 50, "noticed")),
        *(("pendulum", 5, 50, "noticed"), ("z1", 5, 50, "noticed"), ("panda", 1, 500, "noticed")),
    ):
        table.each(base, f"{count} gaps of {width} samples", expected, open_gaps(count, width))
    for base in ("kr300", "pendulum", "panda", "z1"):
        table.add(base, "two logs joined, time runs back", "seen", join_runs)
    for base, step, expected in (("tx40", 0, "either"), ("panda", 0, "either"), ("z1", 3, "noticed")):
        title = "a stamp repeated" if not step else f"a stamp {step} periods back"
        table.each(base, title, expected, turn_back(step))
    for base in BASES:
        table.each(base, "1 s cut out, stamps closed up", "noticed", cut_time(1.0))
    for base in ("panda", "pendulum"):
        table.each(base, "0.1 s cut out, stamps closed up", "noticed", cut_time(0.1))
    for base, share, expected in (
        *(("tx40", 0.1, "either"), ("kr300", 0.3, "noticed"), ("pendulum", 0.3, "noticed")),
        *(("panda", 0.3, "noticed"), ("z1", 0.6, "noticed")),
    ):
        table.each(base, f"{share:.0%} of packets held", expected, hold(share))


def add_positions(table: Table) -> None:
    """Add encoders that stick, wrap or have an offset, and motions that tell too little."""
    for base, joint in (("tx40", 3), ("kr300", 2), ("pendulum", 2), ("panda", 4), ("z1", 5)):
        table.each(base, f"encoder {joint} stuck from the middle", "seen", stick(joint, 0.5))
    for base, joint in (("tx40", 3), ("panda", 4), ("z1", 2)):
        table.each(base, f"encoder {joint} stuck in the last tenth", "noticed", stick(joint, 0.9))
    for base, joint in (("tx40", 1), ("kr300", 4), ("pendulum", 1), ("panda", 3), ("z1", 6)):
        table.each(base, f"encoder {joint} wraps", "noticed", wrap(joint))
    # An offset turns the frame of the link, which its parameters make up for; it shows only by where the next
    # joint is and by what that one carries, which is little in the first three here.
    for base, joint, offset, expected in (
        *(("tx40", 3, 0.3, "either"), ("kr300", 3, 0.3, "either"), ("tx40", 3, 1.0, "either")),
        *(("panda", 4, 0.3, "noticed"), ("z1", 3, 0.3, "noticed"), ("panda", 4, 0.1, "either")),
        *(("pendulum", 1, 0.3, "noticed"), ("panda", 2, 1.0, "noticed"), ("z1", 3, 1.0, "noticed")),
        *(("tx40", 1, 0.3, "unseen"), ("kr300", 1, 0.3, "unseen"), ("panda", 1, 0.3, "unseen")),
        *(("tx40", 6, 0.3, "unseen"), ("kr300", 6, 0.3, "unseen"), ("pendulum", 2, 0.3, "unseen")),
        *(("panda", 7, 0.3, "unseen"), ("z1", 6, 0.3, "unseen")),
    ):
        table.each(base, f"position {joint} off by {offset:g} rad", expected, shift_position(joint, offset))
    for arm, joint in (("panda", 1), ("panda", 4), ("z1", 3), ("z1", 6)):
        move = move_otherwise(arm, lambda motion, joint=joint: hold_joint(motion, joint - 1))
        table.add(arm, f"joint {joint} at rest", "noticed", move)
    for arm, one, other in (("panda", 2, 4), ("z1", 2, 3), ("z1", 1, 5)):
        move = move_otherwise(arm, lambda motion, a=one, b=other: couple_joints(motion, a - 1, b - 1))
        table.add(arm, f"joint {other} moves in proportion to joint {one}", "noticed", move)
    for number in (0, 1):
        table.add(
            "pendulum",
            f"run {number + 3} alone",
            "either",
            lambda clean, _, number=number: replace(clean, runs=clean.foreign[number : number + 1]),
        )


def add_robots(table: Table) -> None:
    """Add wrong robots, and logs that are given twice."""
    wrong = {"tx40": "ur10", "kr300": "puma560", "pendulum": "two_link", "panda": "wam7", "z1": "kr30"}
    for base, robot in wrong.items():
        text = (ROBOTS / f"{robot}.toml").read_text(encoding="utf-8")
        # Settings for logs of the other robot are not what this is about.
        text = re.sub(r"(?ms)^\[processing\]$.*?(?=^\[|\Z)", "", text)
        table.edit(base, f"robot {robot}", "seen", lambda _, text=text: furnish(text))
    lengths = {
        "tx40": (r"a = 0\.225", "a = 0.2925"),
        "kr300": (r"a = 1\.15", "a = 1.495"),
        "pendulum": (r"(?m)^a = 0\.2$", "a = 0.26"),
        "panda": (r"d = 0\.316", "d = 0.4108"),
        "z1": (r"-0\.35\b", "-0.455"),
    }
    # A length shows by the coupling of joints alone, which is small beside gravity and the other parameters.
    for base, (old, new) in lengths.items():
        table.edit(base, "a link 30 % too long", "either", substitute(old, new))
    doubled = {
        "kr300": (r"a = 1\.15", "a = 2.3"),
        "pendulum": (r"(?m)^a = 0\.2$", "a = 0.4"),
        "panda": (r"d = 0\.316", "d = 0.632"),
        "z1": (r"-0\.35\b", "-0.7"),
    }
    for base, (old, new) in doubled.items():
        table.edit(base, "a link twice as long", "noticed", substitute(old, new))
    turned = {
        "tx40": (r"(?m)^gravity = .*$", "gravity = [0, 0, 9.81]"),
        "kr300": (r"(?m)^gravity = .*$", "gravity = [0, 0, -9.81]"),
        "panda": (r"(?m)^gravity = .*$", "gravity = [0, 0, 9.81]"),
        "z1": (r"(?m)^gravity = .*$", "gravity = [9.81, 0, 0]"),
    }
    for base, (old, new) in turned.items():
        table.edit(base, "gravity turned", "seen", substitute(old, new))
    table.edit(
        "tx40",
        "rows read as standard",
        "seen",
        substitute('convention = "modified"', 'convention = "standard"'),
    )
    table.edit(
        "kr300",
        "rows read as modified",
        "seen",
        substitute('convention = "standard"', 'convention = "modified"'),
    )
    for base in BASES:
        table.add(base, "a log given twice", "noticed", repeat_log(lambda run, _: run))
    for base in ("tx40", "panda"):
        change = repeat_log(lambda run, _: replace(run, q=np.round(run.q, 6), tau=np.round(run.tau, 4)))
        table.add(base, "a log given twice, rounded", "noticed", change)
    for base in ("pendulum", "z1"):
        change = repeat_log(lambda run, _: replace(run, time=run.time + 100.0))
        table.add(base, "a log given twice, later", "noticed", change)


@cache
def list_corrupted() -> tuple[Entry, ...]:
    """Return all corruptions."""
    table = Table()
    for add in (add_exchanged, add_units, add_noise, add_times, add_positions, add_robots):
        add(table)
    names = Counter(entry.name for entry in table.entries)
    if max(names.values()) > 1:
        message = f"names used twice: {[name for name, count in names.items() if count > 1]}"
        raise SystemExit(message)
    return tuple(table.entries)


DRAWN = 40
SIZES = {"tx40": 6, "kr300": 6, "pendulum": 2, "panda": 7, "z1": 6}
"""Joints of each arm."""


def draw_corruptions(seed: int) -> tuple[Entry, ...]:
    """Return corruptions of random kind, joints and size; their names end with the seed."""
    rng, table = np.random.default_rng([3, seed]), Table()
    kinds = (
        lambda one, other: ("torque columns {} and {} exchanged", exchange("torque", one, other)),
        lambda one, other: ("position columns {} and {} exchanged", exchange("position", one, other)),
        lambda one, other: ("joints {} and {} exchanged", exchange("both", one, other)),
        lambda one, _: ("torque {} inverted", scale_torque(one, -1.0)),
        lambda one, _: ("position {} inverted", scale_position(one, -1.0)),
        lambda one, _: ("degrees in joint {}", scale_position(one, 180.0 / np.pi)),
        lambda one, _: ("torque {} times {size:.3g}", scale_torque(one, size)),
        lambda *_: ("time times {pace:.3g}", scale_time(pace)),
        lambda *_: ("torque {late:.3g} s late", delay_torque(late)),
        lambda one, _: ("position {} off by {offset:.3g} rad", shift_position(one, offset)),
        lambda one, _: ("encoder {} stuck from {share:.3g}", stick(one, share)),
    )
    while len(table.entries) < DRAWN:
        base = str(rng.choice(BASES))
        one, other = sorted((1 + rng.permutation(SIZES[base])[:2]).tolist())
        size = float(10.0 ** (rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 3.0)))
        pace = float(np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.2)))
        late = float(rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(np.log(0.03), np.log(0.5))))
        offset = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5))
        share = float(rng.uniform(0.3, 0.7))
        kind = int(rng.integers(len(kinds)))
        text, change = kinds[kind](one, other)
        sizes = {"size": size, "pace": pace, "late": late, "offset": offset, "share": share}
        title = f"{text.format(one, other, **sizes)} [{seed}]"
        if f"{base}: {title}" not in {entry.name for entry in table.entries}:
            table.each(base, title, "seen" if kind not in (8, 9) else "noticed", change)
    return tuple(table.entries)


# Clean logs.

REAL = {
    "TX40": ("tx40", (0,)),
    "KR300 A": ("kr300", (0,)),
    "KR300 B": ("kr300", (1,)),
    "KR300 C": ("kr300", (2,)),
    "KR300 A + B": ("kr300", (0, 1)),
    "pendulum 1 + 2": ("pendulum", (0, 1)),
    "pendulum 2 + 3": ("pendulum", (1, 2)),
    "pendulum 1 to 4": ("pendulum", (0, 1, 2, 3)),
    "EMPS both": ("emps", (0, 1)),
}
"""Set and files, as they are."""
CUT = "TX40, first 60 %"
SIMULATED = {
    "panda, white": ("panda", "white", 201, 1.0),
    "panda, coloured": ("panda", "coloured", 202, 1.0),
    "panda, quantised": ("panda", "quantised", 203, 0.5),
    "panda, uneven": ("panda", "uneven", 204, 1.0),
    "panda, strong friction": ("panda", "white", 205, 3.0),
    "z1, white": ("z1", "white", 206, 1.0),
    "z1, coloured": ("z1", "coloured", 207, 0.5),
    "z1, quantised": ("z1", "quantised", 208, 1.0),
    "z1, uneven": ("z1", "uneven", 209, 0.25),
    "z1, strong friction": ("z1", "white", 210, 2.0),
}
"""Arm, case, seed, factor of friction."""


def list_names(given: argparse.Namespace) -> dict[str, str]:
    """Return the names that are asked for, with what is expected."""
    if given.clean:
        found = dict.fromkeys((*REAL, CUT, *SIMULATED), "clean")
    elif given.drawn is not None:
        found = {entry.name: entry.expected for entry in draw_corruptions(given.drawn)}
    else:
        found = {entry.name: entry.expected for entry in list_corrupted() if entry.kept == given.kept}
    return {name: expected for name, expected in found.items() if given.only in name}


def write_sample(base: Base, folder: Path) -> tuple[Path, list[Path]]:
    """Write a robot file and its logs, and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    speeds = all(run.dq is not None for run in base.runs)
    robot = folder / "robot.toml"
    robot.write_text(map_log(base.text, velocity=speeds), encoding="utf-8")
    logs = [run.write(folder / f"log_{number}.npz") for number, run in enumerate(base.runs, 1)]
    return robot, logs


def make_sample(name: str, data: Path, folder: Path) -> tuple[Path, list[Path]]:
    """Return robot file and logs of an entry by its name, or of the clean logs of a base."""
    if name in REAL:
        key, numbers = REAL[name]
        robot, logs = find_files(data)[key]
        return robot, [logs[number] for number in numbers]
    if name == CUT:
        clean = load_base(data, "tx40")
        run = clean.runs[0]
        return write_sample(replace(clean, runs=(cut(run, slice(0, round(0.6 * len(run.time)))),)), folder)
    if name in SIMULATED:
        arm, case, seed, friction = SIMULATED[name]
        run = simulate(scale_friction(ARMS[arm], friction), CASES[case], seed)
        text = furnish(ARMS[arm].robot.read_text(encoding="utf-8"))
        return write_sample(Base(text=text, runs=(run,), foreign=()), folder)
    if name in BASES:
        return write_sample(load_base(data, name), folder)
    drawn = re.search(r"\[(\d+)\]$", name)
    entries = draw_corruptions(int(drawn[1])) if drawn else list_corrupted()
    entry = next(entry for entry in entries if entry.name == name)
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
    return write_sample(entry.make(load_base(data, entry.base), np.random.default_rng(seed)), folder)


# Fits and tables.


def identify(name: str, data: Path) -> dict:
    """Return what identification says of an entry, in plain types."""
    found = {"name": name, "level": "", "exit": 0, "residual": None, "codes": [], "headline": "", "cause": ""}
    with tempfile.TemporaryDirectory() as folder:
        path, logs = make_sample(name, data, Path(folder))
        start = time.process_time()
        try:
            found |= describe(symid.load(path).identify(logs))
        except symid.SymidError as error:
            codes = sorted({notice.code for notice in error.notices})
            found |= {"exit": error.exit_code, "codes": codes, "cause": error.notices[0].text[:300]}
        except Exception as error:  # noqa: BLE001 - what is not symid's own error is what this looks for
            found |= {"exit": 70, "cause": f"{type(error).__name__}: {error}"[:300], "level": "bug"}
    return found | {"seconds": time.process_time() - start}


def describe(fit) -> dict:
    """Return verdict and warnings."""
    verdict = fit.verdict
    refused = verdict.level == "wrong" or not getattr(fit, "accepted", True)
    return {
        "level": verdict.level,
        "exit": int(refused),
        "residual": float(np.mean([entry.relative_percent for entry in fit.residual])),
        "codes": sorted({notice.code for notice in fit.notices if not notice.is_note}),
        "headline": verdict.headline,
        "cause": str(getattr(verdict, "cause", "") or ""),
        "remedy": str(getattr(verdict, "remedy", "") or ""),
    }


def judge(result: dict, clean: dict | None) -> str:
    """Return what came out, beside the clean log of the same base."""
    expected = result["expected"]
    if result["level"] == "bug":
        return "BUG"
    if clean and clean["exit"] and clean["exit"] == result["exit"] and clean["codes"] == result["codes"]:
        return "BASE"
    if expected in {"unseen", "clean"}:
        return "REFUSED" if result["exit"] else "ok"
    if result["exit"]:
        return "ok"
    level = LEVELS.get(result["level"], 0)
    before = LEVELS.get(clean["level"], 0) if clean else 0
    new = [code for code in result["codes"] if clean is None or code not in clean["codes"]]
    word = "SILENT"
    if level > before and level >= LEVELS["doubtful"]:
        word = "doubtful"
    elif level > before or new:
        word = "warned"
    if expected == "either":
        return "quiet" if word == "SILENT" else word
    return "ok" if word != "SILENT" and expected == "noticed" else word


def print_tables(results: list[dict]) -> None:
    """Print a line an entry, and how often what came out."""
    clean = {result["name"]: result for result in results if result["expected"] == "base"}
    print("| log | expected | came out | verdict | exit | residual, % | s | cause, or new warnings |")
    print("|---|---|---|---|---|---|---|---|")
    counts: Counter[tuple[str, str]] = Counter()
    for result in results:
        base = clean.get(result["name"].split(":")[0])
        outcome = "" if result["expected"] == "base" else judge(result, base)
        counts[result["expected"], outcome] += 1
        residual = "" if result["residual"] is None else f"{result['residual']:.3g}"
        new = [code for code in result["codes"] if not base or base is result or code not in base["codes"]]
        cause = " ".join((result["cause"] or ", ".join(new)).split()).replace("|", "/")
        print(
            f"| {result['name']} | {result['expected']} | {outcome} | {result['level']} | {result['exit']} "
            f"| {residual} | {result['seconds']:.1f} | {cause[:120]} |"
        )
    print()
    for (expected, outcome), count in sorted(counts.items()):
        if outcome:
            print(f"{expected}: {outcome} {count}")


def run_all(names: list[str], given: argparse.Namespace) -> Iterator[dict]:
    """Yield the result of every entry, in their order."""
    if given.processes <= 1:
        yield from map(identify, names, repeat(given.data))
        return
    with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(identify, names, repeat(given.data))


def read_arguments() -> argparse.Namespace:
    """Return the arguments of the call."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=HERE.parent.parent / "shared" / "data")
    parser.add_argument("--only", default="")
    parser.add_argument("--kept", action="store_true")
    parser.add_argument("--drawn", type=int)
    parser.add_argument("--clean", action="store_true")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--output", type=Path)
    parser.add_argument("--tables", type=Path)
    parser.add_argument("--write", type=Path)
    return parser.parse_args()


def main() -> None:
    """Fit and print, or only one of both."""
    given = read_arguments()
    if given.tables:
        print_tables(json.loads(given.tables.read_text(encoding="utf-8")))
        return
    names = list_names(given)
    if given.list or given.write:
        for name, expected in names.items():
            text = f"{expected:8} {name}"
            if given.write:
                robot, logs = make_sample(name, given.data, given.write / re.sub(r"\W+", "_", name))
                text = f"symid identify {robot} {' '.join(map(str, logs))}"
            print(text)
        return
    # The clean logs of every base come first, to compare with.
    used = (
        [] if given.clean else [base for base in BASES if any(name.startswith(f"{base}:") for name in names)]
    )
    expected = dict.fromkeys(used, "base") | names
    results = []
    for result in run_all(list(expected), given):
        results.append(result | {"expected": expected[result["name"]]})
        print(f"\r{len(results)}/{len(expected)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    if given.output:
        given.output.write_text(json.dumps(results, indent=1), encoding="utf-8")
    print_tables(results)


if __name__ == "__main__":
    main()
