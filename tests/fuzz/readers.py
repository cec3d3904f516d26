"""Fuzzing of all readers: whatever a file holds, only a SymidError comes out, in bounded time and memory.

    .venv/bin/python tests/fuzz/readers.py --seconds 600               every reader, one after the other
    .venv/bin/python tests/fuzz/readers.py npz urdf --seconds 60       of processor time

Inputs are found by atheris (coverage of symid and of Python's parsers) where it is installed, else by
random changes of the first inputs, which are written here. An input that breaks a rule is kept in --findings:
what it raises, longer than 20 s, more than 1 GB. `make test-fuzz` runs this.
"""

import argparse
import gzip
import importlib
import io
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np

PROJECT = Path(__file__).resolve().parents[2]
SECONDS, MEGABYTES, LONGEST = 20, 1000, 20_000
"""Limits of one input: time, memory; and the largest input in bytes."""
COLUMNS = ("t", "q1", "q2", "tau1", "tau2")
MEMBER = "t.npy"


def build_columns() -> dict[str, np.ndarray]:
    """Return a short log of an arm with two joints."""
    time_stamps = np.arange(40) * 0.01
    return {name: np.sin(k + time_stamps) if k else time_stamps for k, name in enumerate(COLUMNS)}


def write_npz(folder: Path) -> Iterator[bytes]:
    """Yield archives, and arrays that stand in one (see `call_member`)."""
    np.savez(folder / "seed.npz", **build_columns())
    yield (folder / "seed.npz").read_bytes()


def write_member(folder: Path) -> Iterator[bytes]:
    """Yield arrays as an archive has them."""
    for values in (np.arange(40) * 0.01, np.zeros((3, 2)), np.array(["a"]), np.array(3.0)):
        stream = io.BytesIO()
        np.save(stream, values)
        yield stream.getvalue()
    del folder


def write_csv(folder: Path) -> Iterator[bytes]:
    """Yield tables with and without units, and with missing cells."""
    columns = build_columns()
    rows = "\n".join(",".join(f"{value:.4g}" for value in row) for row in zip(*columns.values(), strict=True))
    yield f"{','.join(columns)}\n{rows}\n".encode()
    yield f"t (s);q1 [deg];q2;tau1;tau2\n{rows.replace(',', ';')}\n".encode()
    yield f"{','.join(columns)}\n{rows}\n".replace("0.05", "").encode("utf-16")
    german = rows.replace(",", ";").replace(".", ",")
    yield f"Versuch 3\nt;q1;q2;tau1;tau2\ns;\N{DEGREE SIGN};rad;Nm;N m\n{german}\n".encode("cp1252")
    dates = "".join(f"2024-05-01T12:00:0{k}.5+02:00 1 2 3 4\n" for k in range(9))
    yield f"# t q1 q2 tau1 tau2\n{dates}".encode()
    yield f"t,q1,q2,tau1,tau2\n{rows}\n{rows}\n".encode()
    del folder


def call_packed(path: Path) -> object:
    """Read a packed text, whose check sum is right."""
    packed = path.with_suffix(".csv.gz")
    packed.write_bytes(gzip.compress(path.read_bytes(), 1))
    return call_log(packed)


def write_packed(folder: Path) -> Iterator[bytes]:
    """Yield packed tables."""
    yield from (gzip.compress(content) for content in write_csv(folder))


def write_mat(folder: Path) -> Iterator[bytes]:
    """Yield files of MATLAB, with and without compression."""
    from scipy.io import savemat

    for compressed in (False, True):
        savemat(folder / "seed.mat", build_columns(), do_compression=compressed)
        yield (folder / "seed.mat").read_bytes()
    savemat(folder / "seed.mat", {"log": {"t": np.arange(3.0), "name": "x", "cell": [1, "a"]}})
    yield (folder / "seed.mat").read_bytes()


def write_hdf5(folder: Path) -> Iterator[bytes]:
    """Yield HDF5 files, one with groups, units and chunks."""
    import h5py

    with h5py.File(folder / "seed.h5", "w", libver="latest") as file:
        for name, values in build_columns().items():
            file[name] = values
    yield (folder / "seed.h5").read_bytes()
    with h5py.File(folder / "other.h5", "w") as file:
        for name, values in build_columns().items():
            file.create_dataset(f"log/{name}", data=values, chunks=(8,), compression="gzip")
            file[f"log/{name}"].attrs["unit"] = "rad"
    yield (folder / "other.h5").read_bytes()


def write_parquet(folder: Path) -> Iterator[bytes]:
    """Yield Parquet files."""
    import pyarrow as pa
    from pyarrow.parquet import write_table

    for compression in ("none", "snappy"):
        write_table(pa.table(build_columns()), folder / "seed.parquet", compression=compression)
        yield (folder / "seed.parquet").read_bytes()


def write_bag(folder: Path, name: str, *, packed: bool = False) -> Iterator[bytes]:
    """Yield a bag with joint states, its chunks packed or not."""
    from rosbags import rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["sensor_msgs/msg/JointState"]
    stamp, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    plugin = getattr(rosbag2.StoragePlugin, name)
    folder /= f"bag_{name}_{packed}"
    writer = rosbag2.Writer(folder, version=9, storage_plugin=plugin)
    if packed:
        writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/joint_states", kind.__msgtype__, typestore=store)
        for k in range(12):
            values = np.array([0.1 * k, -0.1 * k])
            message = kind(
                header=header(stamp=stamp(sec=0, nanosec=k * 10**7), frame_id=""),
                name=["shoulder", "elbow"],
                position=values,
                velocity=values,
                effort=values,
            )
            writer.write(connection, k * 10**7, store.serialize_cdr(message, kind.__msgtype__))
    (file,) = (path for path in folder.iterdir() if path.suffix != ".yaml")
    yield file.read_bytes()


def read_project(*patterns: str) -> Iterator[bytes]:
    """Yield files of this project that are short enough."""
    for pattern in patterns:
        for path in sorted(PROJECT.glob(pattern)):
            content = path.read_bytes()
            if len(content) <= LONGEST:
                yield content


URDF = b"""<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tip"/>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="2"/>
<dynamics damping="0.1" friction="0.2"/></joint>
<joint name="b" type="prismatic"><parent link="upper"/><child link="tip"/>
<origin xyz="0 0 0.2" rpy="1.5708 0 0"/>
<mimic joint="a" multiplier="2"/></joint>
<transmission name="t"><joint name="a"/>
<actuator name="m"><mechanicalReduction>50</mechanicalReduction></actuator></transmission></robot>"""
STUDY = (
    b'robot = "two_link"\nestimator = ["wls", "ols"]\nrepeats = 2\nseed = 3\n'
    b'[settings]\n"processing.filter_cutoff" = 5\n[simulate]\nduration = 1.0\n'
)
DH = b"joint, alpha, a, d, theta\nfirst, 0, 0, 0.5, q\nsecond, -pi/2, 1/3, 0, q+90deg\n"
RUNS = (
    b'[[run]]\nfile = "no.csv"\nweight = 2\ntrain = "0:60%"\noffset = 0.1\n'
    b"payload = { mass = 1.2, com = [0, 0, 0.05], inertia = { xx = 0.01 } }\n"
)
TABLE = b"robot,logs,name,night,seed\ntwo_link,a.csv;b.csv,r1,n1,3\n"


def call_log(path: Path) -> object:
    """Read a log, check its samples, and put them at even times."""
    import symid

    log = symid.read_log(path, get_robot())
    return log.notices


@cache
def get_robot() -> object:
    """Return the arm that logs are of."""
    import symid

    return symid.load(PROJECT / "robots" / "two_link.toml")


def call_member(path: Path) -> object:
    """Read an array within an archive whose check sums are right."""
    whole = path.with_suffix(".whole.npz")
    np.savez(path.with_suffix(".base.npz"), **build_columns())
    with zipfile.ZipFile(path.with_suffix(".base.npz")) as base, zipfile.ZipFile(whole, "w") as archive:
        for name in base.namelist():
            archive.writestr(name, path.read_bytes() if name == MEMBER else base.read(name))
    return call_log(whole)


def call_robot(path: Path) -> object:
    """Read a robot, and print its description."""
    from symid.robot import load_robot

    return repr(load_robot(str(path)))


def call_dh(path: Path) -> object:
    """Read a table of rows."""
    from symid.robot import read_dh_table

    return read_dh_table(path, "modified")


def call_runs(path: Path) -> object:
    """Read a file of runs."""
    from symid.logs import read_recordings

    return read_recordings([path], get_robot().description)


def call_fit(path: Path) -> object:
    """Read an estimate, and print it."""
    import symid

    fit = symid.load_fit(path)
    return fit.to_text(), fit.to_dict()


def call_study(path: Path) -> object:
    """Read a study."""
    import symid

    return symid.fleet.read_study(path)


def call_table(path: Path) -> object:
    """Read a study's table."""
    from symid.fleet.jobs import _read_table

    return _read_table(str(path), None)


READERS: dict[str, tuple[str, Callable[[Path], object], Callable[[Path], Iterator[bytes]]]] = {
    "csv": (".csv", call_log, write_csv),
    "gz": (".csv.gz", call_log, write_packed),
    "packed": (".csv", call_packed, write_csv),
    "npz": (".npz", call_log, write_npz),
    "npy": (".npy", call_member, write_member),
    "mat": (".mat", call_log, write_mat),
    "hdf5": (".h5", call_log, write_hdf5),
    "parquet": (".parquet", call_log, write_parquet),
    "mcap": (".mcap", call_log, lambda folder: write_bag(folder, "MCAP")),
    "zstd": (".mcap", call_log, lambda folder: write_bag(folder, "MCAP", packed=True)),
    "db3": (".db3", call_log, lambda folder: write_bag(folder, "SQLITE3")),
    "toml": (".toml", call_robot, lambda _: read_project("robots/*.toml")),
    "urdf": (".urdf", call_robot, lambda _: iter((URDF,))),
    "mjcf": (".xml", call_robot, lambda _: read_project("tests/data/robots/*.xml")),
    "dh": (".csv", call_dh, lambda _: iter((DH,))),
    "runs": (".toml", call_runs, lambda _: iter((RUNS,))),
    "json": (".json", call_fit, lambda _: read_project("tests/data/fits/*.json")),
    "study": (".toml", call_study, lambda _: iter((STUDY,))),
    "table": (".csv", call_table, lambda _: iter((TABLE,))),
}


def try_input(reader: str, folder: Path, content: bytes) -> None:
    """Call a reader with an input; anything but a result or a SymidError with a text comes out."""
    from symid.errors import SymidError

    suffix, call, _ = READERS[reader]
    path = folder / f"input{suffix}"
    path.write_bytes(content)
    start = time.process_time()
    # What NumPy finds odd is no concern of users.
    warnings.simplefilter("error", RuntimeWarning)
    try:
        call(path)
    except SymidError as error:
        if not error.notices or not all(notice.text for notice in error.notices) or error.exit_code == 70:
            raise RuntimeError("an error without a text, or a bug") from error  # noqa: EM101
    if time.process_time() - start > SECONDS:
        message = f"longer than {SECONDS} s"
        raise RuntimeError(message)


def fuzz(reader: str, folder: Path, seeds: list[bytes], seconds: int, findings: Path) -> None:
    """Try inputs in this process until the time is over, or one breaks a rule."""
    try:
        import atheris
    except ImportError:
        fuzz_at_random(reader, folder, seeds, seconds, findings)
        return
    packages = ["symid", "tomllib", "csv", "zipfile", "xml", "rosbags", "scipy.io"]
    rooms = ("symid.fleet", "symid.identification.stored", "symid.logs.runs", "symid.robot.loading")
    with atheris.instrument_imports(include=packages):
        for name in (
            *rooms,
            "symid.logs.bags",
            "symid.robot.toml_reader",
            "symid.robot.toml_reader",
            "scipy.io",
        ):
            importlib.import_module(name)
    corpus = folder / "corpus"
    corpus.mkdir()
    for number, content in enumerate(seeds):
        (corpus / str(number)).write_bytes(content)
    # Times of libFuzzer pass on a clock; on a machine that has other work they are only what ends a hang.
    options = [f"-max_len={LONGEST}", f"-timeout={10 * SECONDS}", "-rss_limit_mb=3000"]
    options += [f"-artifact_prefix={findings}/{reader}-", "-seed=1", str(corpus)]
    count = 0

    def try_in_time(content: bytes) -> None:
        nonlocal count
        if time.process_time() > seconds:
            print(f"stat::number_of_executed_units: {count}", file=sys.stderr, flush=True)
            os._exit(0)
        count += 1
        try_input(reader, folder, content)

    atheris.Setup([sys.argv[0], *options], try_in_time)
    atheris.Fuzz()


def fuzz_at_random(reader: str, folder: Path, seeds: list[bytes], seconds: int, findings: Path) -> None:
    """Try random changes of the seeds."""
    chance, count = random.Random(1), 0  # noqa: S311
    while time.process_time() < seconds:
        content = bytearray(chance.choice(seeds))
        for _ in range(chance.choice((1, 1, 2, 4, 16))):
            place = chance.randrange(len(content) + 1)
            length = chance.choice((0, 1, 1, 2, 4, 64))
            new = bytes(chance.choice((0, 255, 45, 48, 57, chance.randrange(256))) for _ in range(length))
            content[place : place + chance.choice((0, length, 64))] = new
        try:
            try_input(reader, folder, bytes(content))
        except BaseException:
            (findings / f"{reader}-random-{count}").write_bytes(content)
            raise
        count += 1
    print(f"stat::number_of_executed_units: {count}", file=sys.stderr)


def run_reader(reader: str, seconds: int, findings: Path) -> bool:
    """Fuzz a reader in a process of its own, print what came out, and return whether all is well."""
    with tempfile.TemporaryDirectory(prefix="symid-fuzz-") as folder:
        command = [sys.executable, __file__, "--only", reader, "--seconds", str(seconds), "--folder", folder]
        command += ["--findings", str(findings)]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    said = []
    for pattern, what in (
        (r"executed_units: (\d+)", "inputs"),
        (r"cov: (\d+)", "points covered"),
        (r"rss: (\d+)", "MB"),
    ):
        said += [f"{number} {what}" for number in re.findall(pattern, done.stderr)[-1:]]
    failed = f" FAILED with code {done.returncode}" if done.returncode else ""
    print(f"{reader}: {', '.join(said)}{failed}", flush=True)
    if failed:
        print("\n".join(done.stderr.splitlines()[-40:]))
    return not failed


def main() -> None:
    """Read the arguments, and fuzz."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("readers", nargs="*", default=list(READERS), help=", ".join(READERS))
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--findings", type=Path, default=Path("fuzz_findings"))
    parser.add_argument("--only", help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    given.findings.mkdir(exist_ok=True, parents=True)
    if given.only:
        # Memory that a reader asks for, beyond what Python and its packages have already.
        resource.setrlimit(resource.RLIMIT_DATA, (MEGABYTES * 10**6 + 10**9, resource.RLIM_INFINITY))
        seeds = list(READERS[given.only][2](given.folder))
        fuzz(given.only, given.folder, seeds, given.seconds, given.findings.resolve())
        return
    found = [run_reader(reader, given.seconds, given.findings) for reader in given.readers]
    if not any(given.findings.iterdir()):
        shutil.rmtree(given.findings)
    sys.exit(0 if all(found) else 1)


if __name__ == "__main__":
    sys.path.insert(0, str(PROJECT))
    main()
