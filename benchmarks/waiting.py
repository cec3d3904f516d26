"""Where people wait: processor time and peak memory of whole calls, this tree beside another one.

    python benchmarks/waiting.py [--other TREE] [--only TEXT] [--repeats N] [--cold]

Each call is a process of its own with one thread, trees in turns; the least of the repeats counts. Warm: what
the call compiles is in the cache; with --cold the cache is empty before each call. A row prints this tree,
and the other one behind a slash. Robots with masses come from the package `example-robot-data`, which must be
there; logs are simulated by this tree.
"""

import argparse
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent
UR5, PANDA, ELASTIC = (
    ("ur5.urdf", "--tip", "tool0"),
    ("panda.urdf", "--tip", "panda_link8"),
    ("two_link_elastic",),
)
LOGS = {
    "ur5.npz": (*UR5, "--duration", "10", "--period", "0.002"),
    "panda.npz": (*PANDA, "--duration", "60"),
    "elastic.npz": (*ELASTIC, "--duration", "60"),
}
COMPILE = "import symid, sys; symid.load('panda').compile()"
DERIVE = """
import symid
symid.load("g1.urdf", base="torso_link", tip="left_wrist_yaw_link").derivation()
"""
CALLS = {
    "identify UR5, 10 s at 500 Hz": ("-m", "symid", "identify", *UR5, "ur5.npz"),
    "identify Panda, 60 s at 1 kHz": ("-m", "symid", "identify", *PANDA, "panda.npz"),
    "identify UR5 --friction auto": ("-m", "symid", "identify", *UR5, "ur5.npz", "--friction", "auto"),
    "identify UR5 --rows friction": ("-m", "symid", "identify", *UR5, "ur5.npz", "--rows", "friction"),
    "identify two elastic joints, 60 s": ("-m", "symid", "identify", *ELASTIC, "elastic.npz"),
    "identify two elastic joints, one-shot": (
        "-m",
        "symid",
        "identify",
        *ELASTIC,
        "elastic.npz",
        "--method",
        "nlp",
    ),
    "simulate Panda, 1 s": ("-m", "symid", "simulate", *PANDA, "--duration", "1", "-o", "one.npz", "--force"),
    "compile() of a Panda": ("-c", COMPILE),
    "simulate Panda, 60 s": (
        "-m",
        "symid",
        "simulate",
        *PANDA,
        "--duration",
        "60",
        "-o",
        "long.npz",
        "--force",
    ),
    "generate panda": ("-m", "symid", "generate", "panda", "-o", "panda_c", "--force"),
    "derivation() of a G1's arm": ("-c", DERIVE),
    "excite panda": ("-m", "symid", "excite", "panda", "-o", "motion.csv", "--force"),
    "demo": ("-m", "symid", "demo", "--output", "demo", "--force"),
}


def run(tree: Path, folder: Path, call: tuple[str, ...]) -> tuple[float, float]:
    """Return processor time in s, children included, and peak memory in MB of one call."""
    names = {"PYTHONPATH": str(tree), "XDG_CACHE_HOME": str(folder / f"cache-{tree.name}")}
    names |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment = {**os.environ, **names}
    # Byte code is kept, as where symid is installed.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(
            (sys.executable, *call), stdout=said, stderr=subprocess.STDOUT, env=environment, cwd=folder
        )
        _, status, used = os.wait4(process.pid, 0)
        # One says that the log is not explained, which is an answer too.
        if os.waitstatus_to_exitcode(status) not in {0, 1}:
            said.seek(0)
            sys.exit(f"{tree}: {' '.join(call)}:\n{said.read()}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0


def copy_robots(folder: Path) -> None:
    """Write the URDFs of the calls into a folder."""
    robots = Path(sysconfig.get_path("purelib"), "cmeel.prefix/share/example-robot-data/robots")
    if not robots.is_dir():
        sys.exit("example-robot-data is missing: pip install example-robot-data")
    shutil.copy(robots / "ur_description/urdf/ur5_robot.urdf", folder / "ur5.urdf")
    shutil.copy(robots / "g1_description/urdf/g1_29dof_rev_1_0.urdf", folder / "g1.urdf")
    shutil.copy(robots / "panda_description/urdf/panda.urdf", folder / "panda.urdf")


def main() -> None:
    """Print a line a call."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--other", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--cold", action="store_true")
    given = parser.parse_args()
    trees = [HERE, *([given.other.resolve()] if given.other else [])]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        copy_robots(folder)
        for name, call in CALLS.items():
            if given.only not in name:
                continue
            for log in (log for log in LOGS if log in call and not (folder / log).exists()):
                run(HERE, folder, ("-m", "symid", "simulate", *LOGS[log], "-o", log))
            found = []
            # The first call of all compiles, unless that is measured.
            for _ in range(given.repeats + (not given.cold)):
                for tree in trees if given.cold else ():
                    shutil.rmtree(folder / f"cache-{tree.name}", ignore_errors=True)
                found.append([run(tree, folder, call) for tree in trees])
            each = [list(map(min, zip(*tree, strict=True))) for tree in zip(*found, strict=True)]
            figures = " / ".join(f"{seconds:.2f} s, {memory:.0f} MB" for seconds, memory in each)
            print(f"{name + (', cold' if given.cold else ''):45}{figures}", flush=True)


if __name__ == "__main__":
    main()
