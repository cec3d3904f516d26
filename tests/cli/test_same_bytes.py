"""The same inputs give the same bytes: any order of hashes, number of threads and of processes, folder, zone.

Two processes make all calls, each in a folder and with a cache of its own, so that each derives, compiles and
fits for itself. What they print and write is compared byte by byte. `generate` has its own such test in
test_generate_again, numbers of the other studies theirs in tests/unit/study.
"""

import json
import os
import subprocess
import sys
from typing import NamedTuple

import pytest

from symid.environment import THREAD_VARIABLES


class Caller(NamedTuple):
    """What must not matter: seed of the hashes, threads asked for, processes, where it is, its time zone."""

    hashes: str
    threads: str
    jobs: str
    folder: str
    zone: str


CALLERS = (Caller("1", "1", "1", "one", "UTC"), Caller("977", "4", "2", "other/place", "Asia/Tokyo"))
JOBS = "JOBS"
LIGHT, HEAVY = "mass = 1.9", "mass = 2.9"
# Sums of more than 10 000 numbers are those that OpenBLAS gives to several threads.
CALLS = {
    "base": "base two_link",
    "base-energy": "base two_link --of energy",
    "derive": "derive two_link",
    "simulate-npz": "simulate two_link --duration 12 -o log.npz",
    "simulate-csv": "simulate two_link --duration 1 --seed 2 -o held.csv",
    "simulate-loaded": "simulate loaded.toml --duration 3 --seed 3 -o loaded.npz",
    "simulate-elastic": "simulate two_link_elastic --trajectory ta --scale 10 --duration 5 -o elastic.npz",
    "check": "check two_link log.npz",
    "identify-ols": "identify two_link log.npz --estimator ols -o ols.json",
    "identify-wls": "identify two_link log.npz --estimator wls --decimate 1 -o wls.json",
    "identify-momentum": "identify two_link log.npz held.csv --rows momentum -o momentum.json",
    "identify-huber": "identify two_link log.npz --estimator huber --decimate 1 -o huber.json",
    "identify-consistent": "identify two_link log.npz --estimator consistent --decimate 1 -o consistent.json",
    "identify-elastic": "identify two_link_elastic elastic.npz --method nlp -o elastic.json",
    "identify-friction": "identify two_link log.npz --rows friction --model stribeck -o friction.json",
    "validate": "validate two_link ols.json held.csv",
    "compare": "compare two_link ols.json wls.json",
    "report": "report momentum.json --diagnose --validation held.csv -o page.html",
    "report-elastic": "report elastic.json -o elastic.html",
    "report-friction": "report friction.json -o friction.html",
    "export-toml": "export two_link consistent.json -o robot.toml",
    "export-urdf": "export two_link consistent.json -o robot.urdf",
    "export-mjcf": "export two_link consistent.json -o robot.xml",
    "export-header": "export two_link consistent.json -o robot.h",
    "export-json": "export two_link consistent.json -o robot.json",
    "payload": "payload two_link loaded.npz --empty log.npz -o payload.json",
    "excite": "excite two_link --harmonics 2 --period 2 --candidates 20 --starts 2 --rate 50 -o motion.csv",
    "simulate-file": "simulate two_link --trajectory motion.csv -o moved.csv",
    "study-precision": f"study precision two_link --seeds 21 --jobs {JOBS}",
    "study-cutoff": "study cutoff two_link log.npz",
}
"""By name; each starts from files of those above it."""
LONG_CALLS = {
    "study-friction": f"study friction-tables --seeds 2 --jobs {JOBS} -o tables.html",
    "study-tracking": f"study tracking --seeds 2 --jobs {JOBS}",
}

# As the installed command makes them: the first call asks for threads before NumPy is loaded.
SCRIPT = """
import contextlib, json, sys
from symid.cli.main import main

if __name__ == "__main__":
    codes = {}
    for name, words in json.load(open("calls.json")).items():
        sys.argv = ["symid", *words.split(), *([] if name == "derive" else ["--json"])]
        with open(name + ".out", "w") as out, contextlib.redirect_stdout(out):
            try:
                main()
            except SystemExit as end:
                codes[name] = end.code
    json.dump(codes, open("codes.json", "w"))
"""


def start(calls, caller, folder, project):
    """Start all calls of one caller in `folder`; return the process."""
    folder.mkdir(parents=True)
    calls = {name: call.replace(JOBS, caller.jobs) for name, call in calls.items()}
    (folder / "calls.json").write_text(json.dumps(calls))
    (folder / "calls.py").write_text(SCRIPT)
    robot = (project / "robots" / "two_link.toml").read_text(encoding="utf-8")
    assert robot.count(LIGHT) == 1
    (folder / "loaded.toml").write_text(robot.replace(LIGHT, HEAVY), encoding="utf-8")
    environment = {
        **os.environ,
        **dict.fromkeys(THREAD_VARIABLES, caller.threads),
        "PYTHONHASHSEED": caller.hashes,
        "TZ": caller.zone,
        "XDG_CACHE_HOME": str(folder / "cache"),
        "PYTHONPATH": str(project),
    }
    return subprocess.Popen(
        [sys.executable, "calls.py"], cwd=folder, env=environment, stderr=subprocess.PIPE, text=True
    )


def list_written(calls, folder):
    """Return the names of all files that the calls wrote or printed, none of them empty."""
    ours = {"calls.json", "calls.py", "codes.json", "loaded.toml"}
    found = {path.name for path in folder.iterdir() if path.is_file()} - ours
    printed = {f"{name}.out" for name in calls}
    written = {call.partition(" -o ")[2] for call in calls.values()} - {""}
    assert found == printed | written
    assert all((folder / name).stat().st_size for name in found)
    return found


def find_differences(calls, root, project):
    """Return the names of what differs between the callers."""
    folders = [root / caller.folder for caller in CALLERS]
    processes = [start(calls, *pair, project) for pair in zip(CALLERS, folders, strict=True)]
    for process, folder in zip(processes, folders, strict=True):
        _, said = process.communicate(timeout=300)
        assert process.returncode == 0, said
        assert json.loads((folder / "codes.json").read_text()) == dict.fromkeys(calls, 0), said
    one, other = folders
    names = list_written(calls, one)
    assert list_written(calls, other) == names
    return [name for name in sorted(names) if (one / name).read_bytes() != (other / name).read_bytes()]


def test_the_same_bytes_come_out_of_every_verb(tmp_path, project):
    assert find_differences(CALLS, tmp_path, project) == []


@pytest.mark.slow
def test_the_same_bytes_come_out_of_long_studies(tmp_path, project):
    assert find_differences(LONG_CALLS, tmp_path, project) == []


def test_the_command_asks_for_one_thread_before_numpy_is_loaded(project):
    script = (
        "import os, sys\n"
        "from symid.cli.main import main\n"
        "assert 'numpy' not in sys.modules\n"
        "sys.argv = ['symid', '--version']\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print([os.environ[name] for name in {THREAD_VARIABLES!r}])"
    )
    environment = {**os.environ, "OMP_NUM_THREADS": "4", "PYTHONPATH": str(project)}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == str(["1"] * len(THREAD_VARIABLES))
