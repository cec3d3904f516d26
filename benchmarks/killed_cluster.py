"""A Dask cluster of processes that are killed on the way and started again, for `benchmarks/fleet.py --kill`.

Scheduler and workers are what `dask scheduler` and `dask worker` start. Moments are drawn as shares of the
jobs that are done, so that they fall into the run however long it takes; SIGKILL comes up to half a second
later, in the middle of some job. A worker's jobs run in a process of their own, which nobody kills: it has
to end by itself.
"""

import contextlib
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

WORKERS_KILLED = 5
_PATIENCE = 20.0


class KilledCluster:
    """Scheduler and workers; `jobs` is how many results the folder will have in the end."""

    def __init__(self, results, log, *, workers, jobs, seed):
        self.results, self.log, self.jobs = results, log, jobs
        rng = np.random.default_rng(seed)
        self.moments = np.sort(rng.uniform(0.05, 0.9, WORKERS_KILLED + 1))
        self.scheduler_at = int(rng.integers(len(self.moments)))
        self.rng = rng
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.processes = dict.fromkeys(["scheduler", *(f"worker {k + 1}" for k in range(workers))])
        self.killed, self.memory, self.processor = [], 0.0, 0.0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch)

    @property
    def address(self):
        """Return where the scheduler answers; the same one after it was killed."""
        return f"tcp://127.0.0.1:{self.port}"

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._end.set()
        self._thread.join()
        # Workers first: one that is told to end while its scheduler ends may wait for ever.
        for name, process in reversed(self.processes.items()):
            if process is not None:
                process.terminate()
                self._wait_or_kill(name)
        spent = resource.getrusage(resource.RUSAGE_CHILDREN)
        self.processor = spent.ru_utime + spent.ru_stime - self.processor

    def _watch(self):
        spent = resource.getrusage(resource.RUSAGE_CHILDREN)
        self.processor = spent.ru_utime + spent.ru_stime
        while not self._end.wait(0.1):
            self._start_missing()
            self.memory = max([self.memory, *map(self._measure, self.processes)])
            done = self.count_results()
            if len(self.killed) < len(self.moments) and done >= self.moments[len(self.killed)] * self.jobs:
                time.sleep(self.rng.uniform(0.0, 0.5))
                self._kill_next(done)

    def _start_missing(self):
        for name, process in self.processes.items():
            if process is None or process.poll() is not None:
                self._start(name)

    def _start(self, name):
        options = ["scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard"]
        if name != "scheduler":
            options = ["worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        command = [sys.executable, "-m", "dask", *options]
        with self.log.open("ab") as log:
            self.processes[name] = subprocess.Popen(command, stderr=log, start_new_session=True)

    def _kill_next(self, done):
        workers = [name for name in self.processes if name != "scheduler"]
        name = str(self.rng.choice(workers))
        if len(self.killed) == self.scheduler_at:
            name = "scheduler"
        self._kill(name)
        self.killed.append(name)
        print(f"killed: {name}, with {done} of {self.jobs} jobs done", flush=True)
        if name == "scheduler":
            self._start(name)
            # Workers end when they lose it.
            for worker in workers:
                self._wait_or_kill(worker)

    def _kill(self, name):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.processes[name].pid, signal.SIGKILL)
        self.processes[name].wait()

    def _wait_or_kill(self, name):
        try:
            self.processes[name].wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            print(f"{name} did not end within {_PATIENCE:g} s, and was killed", flush=True)
            self._kill(name)

    def wait(self):
        """Wait until the scheduler answers."""
        while True:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1.0):
                return
            time.sleep(0.2)

    def count_results(self):
        """Return how many jobs have a result."""
        # Ten times a second, of 10 000: paths would take a third of a core.
        with contextlib.suppress(FileNotFoundError), os.scandir(self.results) as found:
            return sum(entry.name.endswith(".json") and entry.name[0] != "." for entry in found)
        return 0

    def _measure(self, name):
        """Return the largest memory of a worker's own process so far, in MB."""
        with contextlib.suppress(OSError, StopIteration):
            lines = Path(f"/proc/{self.processes[name].pid}/status").read_text(encoding="utf-8").splitlines()
            peak = next(line for line in lines if line.startswith("VmHWM"))
            return 1e-3 * float(peak.split()[1]) if name != "scheduler" else 0.0
        return 0.0
