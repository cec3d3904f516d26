"""Fleets that are stopped, crash, hang or refuse: each job is one row, and none is computed twice."""

import contextlib
import json
import os
import platform
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

import symid
from symid.errors import InputError, OutputError, SolverError, UsageError
from symid.fleet import FleetJob, running, view
from tests.refusals import raises

# In worker processes: what a job does follows from its name, and is written down.
ODD_JOBS = """
from types import SimpleNamespace
import os, signal, sys, time
import symid.fleet.running as running
from symid.errors import LogError, Notice

def identify(job, folder):
    with open(os.environ["SYMID_TEST_JOBS"], "a") as stream:
        stream.write(job.name + "\\n")
    match job.name.split()[0]:
        case "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "hang":
            open(os.environ["SYMID_TEST_JOBS"] + ".pid", "w").write(str(os.getpid()))
            time.sleep(1000)
        case "slow":
            time.sleep(0.2)
        case "memory":
            return bytearray(4 * 10**9)
        case "heap":
            sizes = [line.split() for line in open("/proc/self/status")]
            with open(os.environ["SYMID_TEST_JOBS"] + ".size", "a") as stream:
                stream.write(next(size[1] for size in sizes if size[0] == "VmData:") + "\\n")
            blocks = [bytearray(10**6) for _ in range(200)]
        case "exit":
            sys.exit(3)
        case "bug":
            return 1 / 0
        case "loud":
            os.write(1, b"a library prints\\n")
        case "refused":
            raise LogError(Notice(code="log.time", text="time does not increase", file="log.csv"))

def find_nothing(job, folder):
    identify(job, folder)
    return SimpleNamespace(parameters=(), residual=(), notices=(), verdict=SimpleNamespace(level=""))

running._identify = find_nothing
running.serve()
"""


@pytest.fixture
def odd(monkeypatch, tmp_path):
    """Let worker processes do what jobs are called; return the file with the names of those that ran."""
    monkeypatch.setattr(running, "_SERVE", ODD_JOBS)
    monkeypatch.setenv("SYMID_TEST_JOBS", str(tmp_path / "ran"))
    return tmp_path / "ran"


def make_jobs(*names):
    return [FleetJob(robot="two_link", logs=("no.csv",), name=name) for name in names]


def start_fleet(folder, names, workers, project):
    """Run a fleet of odd jobs in another process."""
    script = f"""
import symid.fleet.running as running
from symid.fleet import FleetJob, run
running._SERVE = {ODD_JOBS!r}
jobs = [FleetJob(robot="two_link", logs=("no.csv",), name=name) for name in {names!r}]
run(jobs, "out", workers={workers})
"""
    return subprocess.Popen(
        [sys.executable, "-c", script], cwd=folder, env=os.environ | {"PYTHONPATH": project}
    )


def wait_until(condition, seconds=30.0):
    """Return whether a condition holds within so many seconds."""
    end = time.monotonic() + seconds
    while not (found := condition()) and time.monotonic() < end:
        time.sleep(0.05)
    return found


def read_results(folder):
    return {path.name: path.read_bytes() for path in (folder / "results").iterdir()}


def test_all_that_can_happen_to_a_job_is_a_row(odd, tmp_path):
    jobs = make_jobs("good 1", "crash", "hang", "loud", "memory", "bug", "refused", "exit", "good 2")
    found = symid.fleet.run(jobs, tmp_path / "out", workers=2, seconds=3.0, megabytes=1500)
    ended = {row.job.name: (row.status, row.reason) for row in found.rows}
    assert list(ended) == [job.name for job in jobs]
    assert ended["good 1"] == ended["good 2"] == ended["loud"] == ("done", "")
    assert ended["crash"] == ("crashed", "the worker process was ended by SIGSEGV")
    assert ended["hang"] == ("time-out", "not ended after 3 s")
    assert ended["memory"] == ("memory", "the memory that a job may use ran out")
    assert ended["bug"] == (
        "failed",
        "a bug in symid, not in your files: ZeroDivisionError: division by zero",
    )
    assert ended["refused"] == ("refused", "log.csv: time does not increase")
    assert ended["exit"] == ("crashed", "the worker process ended with code 3")
    assert [notice.code for notice in (*found.notices, *found.errors)] == ["fleet.refused", "fleet.lost"]
    assert "5 of 9 jobs" in found.errors[0].text
    # Nothing is run twice, unless it is asked for; a refusal would be the same again.
    symid.fleet.run(jobs, tmp_path / "out", workers=2)
    assert sorted(odd.read_text().splitlines()) == sorted(job.name for job in jobs)
    symid.fleet.run(jobs, tmp_path / "out", workers=1, seconds=2.0, megabytes=1500, again=True)
    assert sorted(odd.read_text().splitlines()[len(jobs) :]) == ["bug", "crash", "exit", "hang", "memory"]


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="wants the sizes that Linux states")
def test_memory_that_a_job_leaves_free_counts_against_no_other_ones_limit(odd, tmp_path):
    jobs = make_jobs("heap 1", "heap 2", "heap 3")
    assert symid.fleet.run(jobs, tmp_path / "out", workers=1, megabytes=1500).counts == {"done": 3}
    first, *others = map(int, odd.with_name("ran.size").read_text().split())
    assert max(others) < first + 50_000


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="wants the C library of GNU")
def test_without_a_limit_a_job_finds_the_memory_of_the_one_before(odd, tmp_path, monkeypatch):
    # As Dask's workers are started.
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")
    symid.fleet.run(make_jobs("heap 1", "heap 2"), tmp_path / "out", workers=1)
    first, second = map(int, odd.with_name("ran.size").read_text().split())
    assert second > first + 150_000


def test_a_fleet_that_is_killed_goes_on_and_repeats_nothing(odd, tmp_path, project):
    names = [f"slow {k}" for k in range(16)]
    folder = tmp_path / "out" / "results"
    process = start_fleet(tmp_path, names, 2, project)
    wait_until(lambda: folder.is_dir() and len(list(folder.glob("*.json"))) >= 3)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = {path.stem for path in folder.glob("*.json")}
    assert 3 <= len(kept) < 16
    (folder / ".half.json.abc").write_text("{")
    with raises(InputError, "fleet.not-ended", match="run it again"):
        symid.fleet.load(tmp_path / "out")
    time.sleep(0.5)
    before = odd.read_text().splitlines()
    found = symid.fleet.run(make_jobs(*names), tmp_path / "out", workers=2)
    assert found.counts == {"done": 16}
    assert len(list((tmp_path / "out").rglob("*"))) == 1 + 16 + 2
    again = odd.read_text().splitlines()[len(before) :]
    assert len(again) == len(set(again)) == 16 - len(kept)
    assert {row.job.name for row in found.rows if row.key in kept}.isdisjoint(again)
    assert symid.fleet.load(tmp_path / "out").rows == found.rows


def test_worker_processes_end_with_the_fleet(odd, tmp_path, project):
    process = start_fleet(tmp_path, ["hang"], 1, project)
    pid = Path(f"{odd}.pid")
    wait_until(lambda: pid.exists() and pid.read_text())
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert wait_until(lambda: not Path(f"/proc/{pid.read_text()}").exists(), 10.0)


def test_a_job_at_its_limit_ends_its_compiler(tmp_path, monkeypatch):
    slow = tmp_path / "bin" / "cc"
    slow.parent.mkdir()
    text = f"sleep 100 & echo $! > {tmp_path}/pid; wait"
    slow.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo cc 1 && exit 0\n{text}\n')
    slow.chmod(0o755)
    monkeypatch.setenv("PATH", f"{slow.parent}:/usr/bin:/bin")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    job = FleetJob(robot="two_link", simulate={"duration": 1.0}, seed=1)
    found = symid.fleet.run([job], tmp_path / "out", workers=1, seconds=10.0)
    assert found.rows[0].status == "time-out"
    stat = Path(f"/proc/{(tmp_path / 'pid').read_text().strip()}/stat")
    # Gone, or waiting to be collected.
    assert not stat.exists() or stat.read_text().split()[2] == "Z"
    assert list((tmp_path / "tmp").iterdir()) == []
    assert [path.name for path in (tmp_path / "cache" / "symid").iterdir() if path.is_dir()] == []


def test_what_cannot_run_is_said_before_anything_runs(tmp_path, monkeypatch):
    with view._own_folder(tmp_path / "out"), raises(OutputError, "output.fleet-runs", match="another fleet"):
        symid.fleet.run([], tmp_path / "out")
    (tmp_path / "file").write_text("")
    with raises(OutputError, "output.folder", match="cannot be made"):
        symid.fleet.run([], tmp_path / "file" / "out")
    with raises(UsageError, "usage.serial-limits"):
        symid.fleet.run([], tmp_path / "out", executor="serial", seconds=1.0)
    monkeypatch.setattr(running, "_SERVE", "raise SystemExit(7)")
    with raises(SolverError, "fleet.no-worker", match="code 7"):
        symid.fleet.run(make_jobs("good"), tmp_path / "out", workers=1)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with raises(UsageError, "usage.no-dask", match="pip install"):
        symid.fleet.run([], tmp_path / "out", executor="dask")


def test_a_damaged_result_is_computed_again_and_a_list_of_others_is_refused(odd, tmp_path):
    (job,) = make_jobs("good")
    found = symid.fleet.run([job, job], tmp_path / "out", workers=1)
    assert len(found.rows) == 2
    (file,) = (tmp_path / "out" / "results").iterdir()
    content = file.read_bytes()
    file.write_bytes(content[:100])
    with raises(InputError, "fleet.damaged", match="damaged or missing"):
        symid.fleet.load(tmp_path / "out")
    symid.fleet.run([job], tmp_path / "out", workers=1)
    assert file.read_bytes() == content
    assert odd.read_text() == "good\ngood\n"


def test_no_more_jobs_are_taken_than_workers_need(odd, tmp_path):
    taken, most = [], 0

    def list_tasks():
        for k, job in enumerate(make_jobs(*(f"good {k}" for k in range(30)))):
            taken.append(k)
            yield str(k), job

    for done, _ in enumerate(running.run_processes(list_tasks(), 2, running.FleetLimits()), start=1):
        most = max(most, len(taken) - done)
    assert len(taken) == 30
    assert most <= 3


def test_progress_says_how_far_it_is_and_how_long_it_takes(odd, tmp_path, monkeypatch):
    monkeypatch.setattr(view, "_SECONDS_BETWEEN", 0.0)
    said = []
    jobs = make_jobs("slow 1", "refused", "slow 2")
    symid.fleet.run(jobs, tmp_path / "out", workers=1, progress=said.append)
    assert [text.split(" ")[0] for text in said] == ["1", "2", "3"]
    assert said[0].startswith("1 of 3 jobs, about ")
    assert said[2] == "3 of 3 jobs, 1 without a fit"
    assert len((tmp_path / "out" / "costs.csv").read_text().splitlines()) == 3


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Return a folder with logs of two robots, ROBOT/NIGHT.npz."""
    folder = tmp_path_factory.mktemp("logs")
    robot = symid.load("two_link")
    for seed, name in enumerate(("a/1", "a/2", "b/1"), start=1):
        (folder / name).parent.mkdir(exist_ok=True)
        robot.simulate(duration=1.5, seed=seed).save(folder / f"{name}.npz")
    (folder / "b" / "2.npz").write_bytes(b"no log")
    return folder


def test_serial_and_processes_give_the_same_bytes(logs, tmp_path, c_compiler):
    study = tmp_path / "study.toml"
    study.write_text(f'robot = "two_link"\nlogs = "{logs}/*/*.npz"\nestimator = "wls"\n')
    serial = symid.fleet.run(study, tmp_path / "serial", executor="serial")
    found = symid.fleet.run(study, tmp_path / "processes", workers=2)
    assert found.rows == serial.rows
    assert read_results(tmp_path / "processes") == read_results(tmp_path / "serial")
    assert [(row.job.name, row.job.night, row.status) for row in found.rows] == [
        ("a", "1", "done"),
        ("a", "2", "done"),
        ("b", "1", "done"),
        ("b", "2", "refused"),
    ]
    # What the front door gives for the same log.
    fit = symid.load("two_link").identify(logs / "a" / "1.npz", estimator="wls")
    values = {entry.name: entry.value for entry in found.rows[0].values if not entry.residual}
    assert values == fit.values
    assert found.rows[0].verdict == fit.verdict.level
    # Addresses are copied where they are read; the copies do not stay.
    remote = [replace(row.job, logs=tuple(f"file://{log}" for log in row.job.logs)) for row in found.rows[:1]]
    pytest.importorskip("fsspec")
    there = symid.fleet.run(remote, tmp_path / "remote", executor="serial")
    assert there.rows[0].values == found.rows[0].values


def test_dask_gives_the_same_bytes_as_this_process(tmp_path, c_compiler, project):
    pytest.importorskip("distributed")
    jobs = symid.fleet.read_study(write_study(tmp_path))
    symid.fleet.run(jobs, tmp_path / "serial", executor="serial")
    script = """
import symid
if __name__ == "__main__":
    found = symid.fleet.run("study.toml", "dask", executor="dask", workers=1, seconds=100.0, progress=print)
    print(found)
"""
    (tmp_path / "script.py").write_text(script)
    environment = os.environ | {"PYTHONPATH": str(project), "DASK_DISTRIBUTED__DASHBOARD__ENABLED": "False"}
    done = subprocess.run(
        [sys.executable, "script.py"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.splitlines()[-1] == "2 jobs: 2 done", done.stderr
    assert done.stdout.startswith("Dask's dashboard: http")
    assert read_results(tmp_path / "dask") == read_results(tmp_path / "serial")


def write_study(folder):
    path = folder / "study.toml"
    path.write_text('robot = "two_link"\nestimator = "wls"\nrepeats = 2\n[simulate]\nduration = 1.5\n')
    return path


def test_no_scheduler_is_said(tmp_path):
    pytest.importorskip("distributed")
    import dask

    with dask.config.set({"distributed.comm.timeouts.connect": "200ms"}), raises(UsageError, "usage.cluster"):
        symid.fleet.run([], tmp_path / "out", executor="dask", cluster="tcp://127.0.0.1:9")


def test_a_scheduler_that_is_lost_ends_the_fleet_and_keeps_what_is_done(tmp_path):
    distributed = pytest.importorskip("distributed")
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    file = tmp_path / "scheduler.json"
    quiet = {"stderr": subprocess.DEVNULL, "env": environment, "cwd": tmp_path, "start_new_session": True}
    tool = [sys.executable, "-m", "dask"]
    options = ["--port", "0", "--scheduler-file", str(file), "--no-dashboard"]
    scheduler = subprocess.Popen([*tool, "scheduler", *options], **quiet)
    worker = subprocess.Popen([*tool, "worker", "--scheduler-file", str(file), "--nthreads", "1"], **quiet)
    said = []

    def end_scheduler(text):
        said.append(text)
        if "of 40 jobs" in text:
            os.killpg(scheduler.pid, signal.SIGKILL)

    try:
        wait_until(file.exists, 60.0)
        address = json.loads(file.read_text())["address"]
        jobs = make_jobs(*map(str, range(40)))
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=60)
        with raises(SolverError, "solver.scheduler-lost"):
            symid.fleet.run(jobs, tmp_path / "out", executor="dask", cluster=address, progress=end_scheduler)
        kept = len(read_results(tmp_path / "out"))
        assert 1 <= kept < 40
    finally:
        for process in (scheduler, worker):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    assert symid.fleet.run(jobs, tmp_path / "out", executor="serial").counts == {"refused": 40}
