"""Calls of symid killed at random moments: what is there afterwards, and whether the next run is right.

    .venv/bin/python benchmarks/kills.py FOLDER --kills 300 --seed 1

Each call works in FOLDER/work, with a cache and a folder of temporary files of its own, and gets SIGKILL
with its process group after a random share of its usual time: half of the calls with an empty cache, half
in place of an older output. All outputs are deterministic, so that "whole" is a comparison of bytes: after
a kill every file must be the old one or the new one (else it counts as torn), and no old one may be missing
(lost); a generated folder may have files of both calls, which the digests in its manifest show. The same call
is then made again, to its end: exit code 0 and every file as that of a call that was never killed (else
wrong), and no other name in folder, cache and temporary files (scratch). A demo takes so long that only
every fifth kill of one is followed by such a call (--demo-every); the others leave what they left to the
next. Exit code 1 if any count is not zero.
"""

import argparse
import contextlib
import hashlib
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

ROBOT = "two_link"
STUDY = 'robot = "two_link"\nlogs = "nights/*/*.npz"\nestimator = "{}"\n'
SCRATCH = (".", "symid-")
"""How names of symid's scratch begin, in its outputs and among temporary files."""


@dataclass(frozen=True)
class Verb:
    """A call: those that it needs, an older one with the same outputs, and the call itself."""

    name: str
    before: tuple[str, ...]
    older: str
    call: str


VERBS = (
    Verb(
        "generate",
        (),
        f"generate {ROBOT} --target c --constant -o code --force",
        f"generate {ROBOT} --target c -o code --force",
    ),
    Verb(
        "identify",
        (),
        f"identify {ROBOT} b.npz -o fit.json --page fit.html --force",
        f"identify {ROBOT} a.npz -o fit.json --page fit.html --force",
    ),
    Verb(
        "export",
        (f"identify {ROBOT} a.npz -o given.json", f"identify {ROBOT} b.npz -o other.json"),
        f"export {ROBOT} other.json -o robot.toml --force",
        f"export {ROBOT} given.json -o robot.toml --force",
    ),
    Verb(
        "report",
        (f"identify {ROBOT} a.npz -o given.json", f"identify {ROBOT} b.npz -o other.json"),
        "report other.json --validation a.npz -o page.html --force",
        "report given.json --validation b.npz -o page.html --force",
    ),
    Verb(
        "fleet",
        (),
        "fleet older.toml --workers 2 -o plant --table plant.csv --page plant.html --force",
        "fleet study.toml --workers 2 -o plant --table plant.csv --page plant.html --force",
    ),
    Verb("demo", (), "demo --seed 2 -o demo --force", "demo --seed 1 -o demo --force"),
)


@dataclass
class Counts:
    """What is in the table's row of a verb."""

    kills: int = 0
    next_runs: int = 0
    torn: int = 0
    lost: int = 0
    wrong: int = 0
    scratch: int = 0
    said: list[str] = field(default_factory=list)

    def add(self, kind, names, kill):
        """Count a fault once a kill, and keep its words."""
        if names:
            setattr(self, kind, getattr(self, kind) + 1)
            self.said.append(f"{kind}, kill {kill}: {', '.join(map(str, names[:4]))}")
            print(self.said[-1], flush=True)


class Place:
    """The folder in which a verb is called, with its cache and its temporary files."""

    def __init__(self, folder):
        self.work, self.cache, self.temporary = (folder / name for name in ("work", "cache", "tmp"))
        self.variables = os.environ | {"XDG_CACHE_HOME": str(self.cache), "TMPDIR": str(self.temporary)}
        self.variables |= {"OMP_NUM_THREADS": "1"}

    def prepare(self, source, cache=None):
        """Begin anew from a copy of a folder, and of a cache or an empty one."""
        for path in (self.work, self.cache, self.temporary):
            shutil.rmtree(path, ignore_errors=True)
        shutil.copytree(source, self.work)
        self.temporary.mkdir(parents=True)
        if cache is None:
            self.cache.mkdir()
        else:
            shutil.copytree(cache, self.cache)

    def start(self, call):
        """Start a call in a session of its own."""
        command = [sys.executable, "-m", "symid", *call.split()]
        return subprocess.Popen(
            command,
            cwd=self.work,
            env=self.variables,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )

    def run(self, call):
        """Return exit code and messages of a call that is not killed."""
        process = self.start(call)
        _, said = process.communicate()
        return process.returncode, said.decode(errors="replace")

    def list_scratch(self):
        """Return what has a name of scratch in folder and cache and among temporary files."""
        places = (self.work, self.cache, self.temporary)
        found = [path for place in places for path in place.rglob("*")]
        return [path.name for path in found if path.name.startswith(SCRATCH)]


def read_files(folder):
    """Return the digests of the files in a folder; scratch and a fleet's costs, which are times, left out."""
    found = {}
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        scratch = any(part.startswith(SCRATCH) for part in parts)
        if path.is_file() and not scratch and path.name != "costs.csv":
            found["/".join(parts)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def check_costs(folder):
    """Return lines of a fleet's costs that are not whole."""
    lines = [line for path in folder.rglob("costs.csv") for line in path.read_text().splitlines()]
    return [f"costs.csv: {line!r}" for line in lines if len(line.split(",")) != 5]


class Trial:
    """One verb: its inputs, its older and its new outputs, how long it takes, and its kills."""

    def __init__(self, verb, place, store, inputs):
        self.verb, self.place, self.counts = verb, place, Counts()
        self.inputs, self.older = store / f"{verb.name}-inputs", store / f"{verb.name}-older"
        self.caches = (None, store / f"{verb.name}-cache")
        self.pending, self.wanted = False, {}
        place.prepare(inputs)
        for call in verb.before:
            self._must(call)
        shutil.copytree(place.work, self.inputs)
        place.prepare(self.inputs)
        start = time.monotonic()
        self._must(verb.call)
        cold = time.monotonic() - start
        self.new, self.names = read_files(place.work), sorted(path.name for path in place.cache.rglob("*"))
        shutil.copytree(place.cache, self.caches[1])
        place.prepare(self.inputs, self.caches[1])
        self._must(verb.older)
        shutil.copytree(place.work, self.older)
        start = time.monotonic()
        self._must(verb.call)
        self.times = (cold, time.monotonic() - start)
        self.replaced = read_files(place.work)
        if any(self.replaced.get(name) != digest for name, digest in self.new.items()):
            sys.exit(f"{verb.name}: not the same bytes twice")
        print(
            f"{verb.name}: {self.times[0]:.1f} s with an empty cache, {self.times[1]:.1f} s after", flush=True
        )

    def _must(self, call):
        code, said = self.place.run(call)
        if code:
            sys.exit(f"symid {call} ended with {code}:\n{said}")

    def kill(self, rng, *, check):
        """Kill one call, look at what is there, and, if asked, call again and look at that."""
        warm, replacing = rng.integers(2, size=2)
        if not self.pending:
            self.place.prepare(self.older if replacing else self.inputs, self.caches[warm])
            self.wanted = self.replaced if replacing else self.new
        before = read_files(self.place.work)
        process = self.place.start(self.verb.call)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(rng.uniform(0.02, 1.0) * self.times[warm])
        killed = process.poll() is None
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        if killed:
            self.counts.kills += 1
            self._look(before)
        self.pending = not check
        if check:
            self._call_again()

    def _look(self, before):
        found = read_files(self.place.work)
        torn = [
            name for name, digest in found.items() if digest not in {before.get(name), self.new.get(name)}
        ]
        torn += check_costs(self.place.work)
        self.counts.add("torn", torn, self.counts.kills)
        lost = [name for name in before if name not in found and name in self.wanted]
        self.counts.add("lost", lost, self.counts.kills)

    def _call_again(self):
        code, said = self.place.run(self.verb.call)
        found = read_files(self.place.work)
        wrong = [f"exit code {code}: {said[-300:]}"] if code else []
        wrong += [name for name in {**self.wanted, **found} if found.get(name) != self.wanted.get(name)]
        self.counts.next_runs += 1
        self.counts.add("wrong", wrong, self.counts.kills)
        extra = {path.name for path in self.place.cache.rglob("*")} - set(self.names)
        self.counts.add("scratch", [*self.place.list_scratch(), *extra], self.counts.kills)


def make_inputs(place, folder):
    """Write the logs and the studies that calls read."""
    nights = folder / "nights"
    for k in range(4):
        (nights / f"r{k // 2}").mkdir(parents=True, exist_ok=True)
    place.prepare(folder)
    logs = ["a.npz", "b.npz", *(f"nights/r{k // 2}/night{k % 2}.npz" for k in range(4))]
    for seed, log in enumerate(logs, start=1):
        code, said = place.run(f"simulate {ROBOT} --duration 3 --seed {seed} -o {log}")
        if code:
            sys.exit(said)
    shutil.copytree(place.work, folder, dirs_exist_ok=True)
    for name, estimator in (("older", "ols"), ("study", "wls")):
        (folder / f"{name}.toml").write_text(STUDY.format(estimator), encoding="utf-8")


def main():
    """Kill calls in turn, and print a row for each verb."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="a new one")
    parser.add_argument("--kills", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--verbs", nargs="+", default=[verb.name for verb in VERBS])
    parser.add_argument("--demo-every", type=int, default=5)
    given = parser.parse_args()
    store = given.folder.resolve()
    (store / "inputs").mkdir(parents=True)
    place, rng = Place(store), np.random.default_rng(given.seed)
    make_inputs(place, store / "inputs")
    verbs = [verb for verb in VERBS if verb.name in given.verbs]
    trials = [Trial(verb, place, store, store / "inputs") for verb in verbs]
    for number, trial in enumerate(trials):
        share = given.kills // len(trials) + (number < given.kills % len(trials))
        while trial.counts.kills < share:
            last = trial.counts.kills + 1 >= share
            every = given.demo_every if trial.verb.name == "demo" else 1
            trial.kill(rng, check=last or (trial.counts.kills + 1) % every == 0)
        print(f"{trial.verb.name}: {trial.counts.kills} kills", flush=True)
    print(f"\n{'verb':10}{'kills':>7}{'next runs':>11}{'torn':>6}{'lost':>6}{'wrong':>7}{'scratch':>9}")
    for name, row in ((trial.verb.name, trial.counts) for trial in trials):
        print(f"{name:10}{row.kills:7}{row.next_runs:11}{row.torn:6}{row.lost:6}{row.wrong:7}{row.scratch:9}")
    said = [f"{trial.verb.name}: {text}" for trial in trials for text in trial.counts.said]
    print("\n".join(said))
    sys.exit(1 if said else 0)


if __name__ == "__main__":
    main()
