"""Answers of the command line, number by number: the calls, what is kept of an answer, and how two compare.

Run as a script it makes the calls with the `symid` that Python finds and says what differs from the stored
answers; with --accept it writes them anew, after a change of numbers that is meant:

    .venv/bin/python tests/golden/freeze.py [--accept] [NAME...]

NAME may be a pattern, such as 'base-*'. A call whose recordings are not there is left out, and said.
"""
# ruff: noqa: T201  as a script it prints what it finds

import argparse
import csv
import json
import math
import re
import shlex
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from fnmatch import fnmatch
from io import StringIO
from pathlib import Path

from symid import __version__
from symid.environment import limit_to_one_thread, locate_resource_folder

PROJECT = Path(__file__).resolve().parents[2]
DATA = PROJECT.parent / "shared" / "data"
ROBOTS = PROJECT / "robots"
ANSWERS = Path(__file__).resolve().parent / "answers"

TOLERANCE = 1e-9
"""Relative. A thousandth of it, times the largest number at the same place of a list's entries, is a floor;
of the numbers of a digest it is all of it, times the largest among them."""
LONGEST_LIST = 200
"""Numbers; of longer lists a digest is kept."""

DROPPED = (
    # (key, names of calls, why)
    ("backend", "*", "compiled code or NumPy, as the machine has a compiler or not"),
    ("runner", "generate*", "name and version of the machine's compiler"),
    ("flags", "generate*", "of the machine's compiler"),
    ("sizes", "generate*", "bytes that the machine's compiler makes"),
    ("log_digests", "two* runs* elastic* demo", "of logs made here: one last digit changes all of a digest"),
    ("sha256", "new", "that of a URDF with values identified here: likewise"),
)
"""What depends on the machine and is not compared. The robots' folder and the scratch folder are written as
`ROBOTS` and `HERE`, the version of symid as `VERSION`."""

COUNT = "one count of an encoder"
LOOSER = (
    # (names of calls, paths in the answer, relative, absolute, why). Measured: these alone differ where other
    # kernels of OpenBLAS (OPENBLAS_CORETYPE=Prescott) add in another order.
    ("*", "result.energy_gap", 0.0, 1e-9, "a difference of energies: rounding and steps of integration"),
    ("*export*", "result.largest_change", 0.0, 1e-12, "rounding alone: values written as found"),
    ("*-consistent", "result.settings.fit.gradient", 0.0, 1e-6, "what Newton's iteration leaves of it"),
    ("*-consistent", "result.settings.fit.price_percent", 1e-7, 1e-9, "a difference of nearly equal sums"),
    ("study-precision", "*.worst_price_percent", 0.0, 1e-9, "the same, of the consistent fits"),
    ("study-precision", "result.methods.*", 1e-7, 0.0, "Newton's iteration ends the consistent fits"),
    ("emps-instrumental", "result.settings.fit.changes.*", 1e-7, 0.0, "the last step of an iteration"),
    # The next ones differ between processors: one count of an encoder rounded to its other side, inside a
    # control loop, moves all that follows by far less than its noise.
    ("two-loaded", "file.tau.rms", 1e-6, 0.0, COUNT),
    ("two-payload*", "result.chi2 file*.payload.chi2", 0.05, 0.0, f"{COUNT}, and few degrees of freedom"),
    ("two-payload*", "result.moved file*.payload.moved", 0.02, 0.0, f"{COUNT}, in units of the deviation"),
    ("two-payload*", "result.* file.record.*", 1e-2, 2e-5, f"{COUNT}: a fiftieth of the deviation"),
    ("runs-identify", "result.parameters.*.value", 1e-5, 0.0, COUNT),
    ("runs-identify", "result.*", 5e-3, 0.0, f"{COUNT}, in noise and deviations"),
    ("two-compare", "result.others.*", 1e-4, 1e-9, "differences of two fits that agree"),
    ("kr300-*", "result.choice.candidates.*", 1e-6, 0.0, "a difference of two errors that are near"),
    ("*-check", "result.dynamics.*.torque_delay.*", 1e-7, 1e-12, "the end of an iteration"),
    ("tx40-*", "result.choice.candidates.*", 2e-3, 0.0, "the end of a search on a plateau"),
    ("excite", "file.*", 1e-7, 0.0, "the end of a search for a smooth optimum"),
    ("elastic-*", "file.covariance.*", 1e-7, 0.0, "the inverse of a matrix whose condition is large"),
    ("elastic-*", "*.springs.*.torque_std *.springs.*.slope_std", 1e-4, 0.0, "the same, of a spring"),
    ("elastic-*", "*.history.*.change", 1e-6, 0.0, "the change of a step of an iteration"),
    ("elastic-*", "*.history.*.norms.*", 1e-8, 0.0, "the same"),
    ("elastic-*", "*.elasticity.*", 1e-7, 0.0, "the end of a search for a smooth optimum, of a spring"),
    ("elastic-*", "*.relative_std_percent", 2e-7, 0.0, "of values that are zero but for noise"),
    ("demo", "*.relative_std_percent", 1e-8, 0.0, "the same"),
    ("demo", "*.history.*.change", 1e-6, 0.0, "the same"),
    ("demo", "*.springs.0.elasticity.stops.3.* *.springs.0.excited", 1e-6, 0.0, "the last stop"),
    ("demo", "result.tracking_rms.*", 1e-7, 0.0, "what it does to a motion"),
    ("kr300-stiffness", "result.joints.0.[rt]* file*.joints.0.left", 5e-3, 0.0, "a spring on a plateau"),
    ("kr300-stiffness", "*offset*", 2e-7, 0.0, "the end of this search"),
    ("kr300-stiffness", "*.run_*stds.*", 1e-8, 0.0, "the same"),
)
"""Tolerances other than `TOLERANCE`."""

EMPS, TX40, KR300 = (
    "data/emps/DATA_EMPS.mat",
    "data/tx40/tx40.npz",
    "data/kr300/run_a.npz data/kr300/run_b.npz",
)
KR300_C = "data/kr300/run_c.npz"
PUBLISHED, ROWS = "--settings published", ("momentum", "filtered", "power", "energy")
AXIS = f"identify emps {EMPS} {PUBLISHED}"
LAW = f"identify emps {EMPS} --rows friction {PUBLISHED}"
LOADED = "payload two_link two-loaded.npz --empty two.npz"
EXCITE = "excite two_link --harmonics 2 --period 2 --candidates 20 --starts 2 --rate 50"
ELASTIC = "identify two_link_elastic ta.npz tb.npz"
EXPORTS = {"toml": "toml", "urdf": "urdf", "mjcf": "xml", "header": "h", "json": "json"}

CALLS = {
    **{f"base-{path.stem}": f"base {path.stem}" for path in sorted(ROBOTS.glob("*.toml"))},
    "base-energy": "base two_link --of energy",
    "base-momentum": "base puma560 --of momentum",
    "base-gravity": "base tx40 --of gravity",
    "base-asymmetric": "base two_link --friction asymmetric",
    **{f"derive-{name}": f"derive {name}" for name in ("panda", "puma560", "quadruped", "two_link_elastic")},
    # Real recordings: estimators and kinds of rows.
    "emps-check": f"check emps {EMPS} {PUBLISHED}",
    "emps-ols": f"{AXIS} -o emps-ols.json",
    "emps-wls": f"{AXIS} --estimator wls --friction asymmetric -o emps-wls.json",
    **{f"emps-{name}": f"{AXIS} --estimator {name}" for name in ("gls", "huber", "consistent")},
    "emps-ridge": f"{AXIS} --estimator ridge --prior emps-ols.json",
    "emps-output-error": f"{AXIS} --estimator output-error --start emps-ols.json",
    "emps-instrumental": f"{AXIS} --estimator instrumental --start emps-ols.json",
    **{f"emps-{rows}": f"{AXIS} --rows {rows}" for rows in ROWS},
    "emps-settings": f"{AXIS} --cutoff 60 --decimate 5 --drop-last 20",
    "emps-validate": f"validate emps emps-ols.json data/emps/DATA_EMPS_PULSES.mat {PUBLISHED}",
    "emps-validate-gate": f"validate emps emps-wls.json data/emps/DATA_EMPS_PULSES.mat {PUBLISHED} --gate 1",
    "emps-cutoff": f"study cutoff emps {EMPS} {PUBLISHED}",
    "emps-friction": f"{LAW} -o emps-friction.json",
    "emps-friction-law": f"{LAW} --model stribeck+offset --known emps-ols.json",
    "emps-friction-validate": f"validate emps emps-friction.json data/emps/DATA_EMPS_PULSES.mat {PUBLISHED}",
    "emps-friction-export": "export emps emps-friction.json -o emps-friction.toml",
    "emps-export": "export emps emps-ols.json -o emps-ols.toml",
    "tx40-check": f"check tx40 {TX40}",
    "tx40-ols": f"identify tx40 {TX40} -o tx40-ols.json",
    "tx40-wls": f"identify tx40 {TX40} --estimator wls -o tx40-wls.json",
    "tx40-ridge": f"identify tx40 {TX40} --estimator ridge --prior tx40-wls.json",
    "tx40-consistent": f"identify tx40 {TX40} --estimator consistent",
    **{f"tx40-{rows}": f"identify tx40 {TX40} --rows {rows} --estimator wls" for rows in ROWS[:2]},
    **{f"tx40-{rows}": f"identify tx40 {TX40} --rows {rows}" for rows in ROWS[2:]},
    "tx40-compare": "compare tx40 tx40-ols.json data/tx40/published.csv --value ols",
    "tx40-compare-gate": "compare tx40 tx40-wls.json tx40-ols.json --gate 0.1",
    "tx40-report": "report tx40-wls.json --diagnose -o tx40-wls.html",
    "kr300-ols": f"identify kr300 {KR300}",
    "kr300-wls": f"identify kr300 {KR300} --estimator wls -o kr300-wls.json",
    **{
        f"kr300-{name}": f"identify kr300 {KR300} --estimator {name}"
        for name in ("gls", "huber", "sequential", "consistent")
    },
    "kr300-momentum": f"identify kr300 {KR300} --rows momentum --estimator wls --overlap 0.5",
    "kr300-energy": f"identify kr300 {KR300} --rows energy --estimator wls",
    "kr300-validate": f"validate kr300 kr300-wls.json {KR300_C} --band 10",
    "kr300-stiffness": f"identify kr300 {KR300} {KR300_C} --method stiffness -o kr300-springs.json",
    # A rigid arm, simulated: all verbs.
    "two-simulate": "simulate two_link --duration 6 -o two.npz",
    "two-held": "simulate two_link --duration 2 --seed 2 -o two-held.csv",
    "two-loaded": "simulate loaded.toml --duration 6 --seed 3 -o two-loaded.npz",
    "two-check": "check two_link two.npz",
    "two-ols": "identify two_link two.npz -o two-ols.json",
    "two-ridge": "identify two_link two.npz --estimator ridge",
    "two-consistent": "identify two_link two.npz --estimator consistent -o two-consistent.json",
    "two-poor": "identify two_link two.npz --drop-first 2900 --drop-last 2900",
    "two-friction": "identify two_link two.npz --rows friction --model stribeck -o two-friction.json",
    "two-validate": "validate two_link two-ols.json two-held.csv",
    "two-compare": "compare two_link two-ols.json two-consistent.json",
    "two-report": "report two-ols.json --diagnose --validation two-held.csv -o two-ols.html",
    "two-payload": f"{LOADED} -o two-payload.json",
    "two-payload-mass": f"{LOADED} --mass 1 --rows momentum --estimator ols",
    "runs-identify": "identify two_link runs.toml --estimator wls",
    **{
        f"two-export-{name}": f"export two_link two-consistent.json -o two-{name}.{ending}"
        for name, ending in EXPORTS.items()
    },
    "two-export-nearest": "export two_link two-ols.json -o two-nearest.toml",
    "two-export-truth": "export two_link -o two-truth.urdf",
    "generate": "generate two_link -o code",
    "generate-python": "generate puma560 --target python --parameters standard -o module",
    "excite": f"{EXCITE} --seed 3 -o motion.csv",
    "excite-moved": "simulate two_link --trajectory motion.csv --friction none --clean -o two-moved.csv",
    "new": "new two-new.toml --from-urdf two-urdf.urdf --log two.npz",
    "study-precision": "study precision two_link --seeds 5 --jobs 1",
    "study-cutoff": "study cutoff two_link two.npz",
    # An elastic arm, simulated.
    "elastic-ta": "simulate two_link_elastic --trajectory ta --scale 10 --duration 6 -o ta.npz",
    "elastic-tb": "simulate two_link_elastic --trajectory tb --duration 6 -o tb.npz",
    "elastic-tc": "simulate two_link_elastic --trajectory tc --duration 6 --delay 0.002 -o tc.npz",
    "elastic-automatic": f"{ELASTIC} -o elastic-automatic.json",
    "elastic-nlp": f"{ELASTIC} --method nlp",
    "elastic-two-step": f"{ELASTIC} --method two-step -o elastic-two-step.json",
    "elastic-grids": f"{ELASTIC} --method two-step --thresholds 4 --knees 2",
    "elastic-validate": "validate two_link_elastic elastic-automatic.json tc.npz",
    "elastic-tracking": "validate two_link_elastic elastic-two-step.json tc.npz --tracking",
    "elastic-report": "report elastic-automatic.json -o elastic.html",
    "elastic-export": "export two_link_elastic elastic-automatic.json -o elastic.toml",
    "demo": "demo -o demo",
    # What is refused, and how.
    "refuse-joint": f"{LOADED} --joint nose",
    "refuse-log": "identify two_link no_such_log.npz",
    "refuse-column": "compare tx40 tx40-ols.json data/tx40/published.csv --value OLS",
    "refuse-prior": f"identify emps {EMPS} --estimator ridge",
    "refuse-estimate": "validate two_link_harmonic two-ols.json two-held.csv",
    "refuse-overwrite": "identify two_link two.npz -o two.npz",
    "refuse-values": "export puma560 -o puma560.urdf",
    "refuse-option": "identify two_link two.npz --rows nothing",
}
"""By name. Files that another call writes with -o are there: that call is made before, once."""

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:e[-+]?\d+)?(?![\w.])")
_DIGEST = frozenset({"rms", "mean", "ramp", "least", "most"})
_Near = Callable[[float, float, tuple[object, ...]], bool]
_LIGHT, _HEAVY = "mass = 1.9", "mass = 2.9"
_RUNS = """
[[run]]
file = "two.npz"

[[run]]
file = "two-loaded.npz"
payload = { name = "more", joint = "elbow", mass = 1.0, com = [0.172, -0.008, 0.02], \
inertia = { xx = 0.001, yy = 0.001, zz = 0.001 } }
"""


def find_target(name: str) -> str:
    """Return the name of the file or folder that a call writes, "" for none."""
    words = CALLS[name].split()
    return words[1] if words[0] == "new" else CALLS[name].partition(" -o ")[2]


@dataclass
class Scratch:
    """A folder in which calls are made, and the answers of those that were made."""

    folder: Path
    made: dict[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if DATA.is_dir():
            (self.folder / "data").symlink_to(DATA)
        robot = (ROBOTS / "two_link.toml").read_text(encoding="utf-8")
        assert robot.count(_LIGHT) == 1
        (self.folder / "loaded.toml").write_text(robot.replace(_LIGHT, _HEAVY), encoding="utf-8")
        (self.folder / "runs.toml").write_text(_RUNS, encoding="utf-8")


def list_needs(name: str) -> list[str]:
    """Return the calls that write what this one reads; `runs.toml` names two logs."""
    writers = {find_target(other): other for other in CALLS if other != name and other[:7] != "refuse-"}
    words = CALLS[name].replace("runs.toml", "two.npz two-loaded.npz").split()
    return [writers[word] for word in words if word in writers]


def wants_data(name: str) -> bool:
    """Return whether a call reads real recordings, or what was found in them."""
    return "data/" in CALLS[name] or any(wants_data(need) for need in list_needs(name))


def find_answer(name: str, scratch: Scratch) -> object:
    """Return what is kept of the answer of a call, which is made now or was made before in this folder."""
    if name not in scratch.made:
        for need in list_needs(name):
            find_answer(need, scratch)
        scratch.made[name] = _make_call(name, scratch.folder)
    return scratch.made[name]


def _make_call(name: str, folder: Path) -> object:
    from symid.cli.main import run

    printed = StringIO()
    with chdir(folder), redirect_stdout(printed), redirect_stderr(StringIO()):
        code = run([*shlex.split(CALLS[name]), "--json"])
    answer = {"exit_code": code, **json.loads(printed.getvalue())}
    target = folder / find_target(name)
    if answer["ok"] and target.is_file() and target.suffix != ".html":
        answer["file"] = _read_file(target, answer["result"])
    return keep(answer, name, folder)


def _read_file(path: Path, result: dict[str, object]) -> object:
    """Return what a file says; of JSON what is in the result as well is not kept twice."""
    match path.suffix:
        case ".json":
            content = json.loads(path.read_text(encoding="utf-8"))
            return {
                k: "as in the result" if result.get(k) == entry else entry for k, entry in content.items()
            }
        case ".toml":
            return tomllib.loads(path.read_text(encoding="utf-8"))
        case ".npz":
            import numpy as np

            with np.load(path) as log:
                return {column: log[column].tolist() for column in sorted(log.files)}
        case ".csv":
            lines = path.read_text(encoding="utf-8").splitlines()
            head, *rows = csv.reader(line for line in lines if not line.startswith("#"))
            columns = zip(*([float(cell) for cell in row] for row in rows), strict=True)
            return dict(zip(head, map(list, columns), strict=True))
    # The digest of all values in a C header differs where the last digit of one does.
    return {"lines": re.sub(r"\b0x[0-9a-f]{8}\b", "DIGEST", path.read_text(encoding="utf-8")).splitlines()}


def keep(value: object, name: str = "", folder: Path = Path("HERE")) -> object:
    """Return what is kept: nothing of the machine, long lists as digests."""
    match value:
        case dict():
            dropped = {key for key, calls, _ in DROPPED if any(fnmatch(name, x) for x in calls.split())}
            return {key: keep(entry, name, folder) for key, entry in value.items() if key not in dropped}
        case list():
            numbers = [entry for _, entry in _walk(value, ())]
            if len(numbers) > LONGEST_LIST and all(type(entry) in {int, float} for entry in numbers):
                return _digest(numbers)
            return [keep(entry, name, folder) for entry in value]
        case str():
            for place, sign in ((str(folder), "HERE"), (str(locate_resource_folder("robots")), "ROBOTS")):
                value = value.replace(place, sign)
            return value.replace(f"symid {__version__}", "symid VERSION")
    return value


def _digest(numbers: list[float]) -> dict[str, object]:
    """Return what tells a long list from others; `ramp` tells the order of its numbers."""
    n = len(numbers)
    return {
        "numbers": n,
        "rms": math.sqrt(math.fsum(x * x for x in numbers) / n),
        "mean": math.fsum(numbers) / n,
        "ramp": math.fsum(k * x for k, x in enumerate(numbers, 1)) / n**2,
        "least": min(numbers),
        "most": max(numbers),
    }


def compare(stored: object, found: object, name: str = "") -> list[str]:
    """Return what differs: the path in the object, what is stored, what is found."""
    sizes: dict[str, float] = {}
    for path, value in _walk(stored, ()):
        if type(value) is float:
            place = _find_place(path)
            sizes[place] = max(sizes.get(place, 0.0), abs(value))

    def is_near(one: float, other: float, path: tuple[object, ...]) -> bool:
        place, where = _find_place(path), ".".join(map(str, path))
        looser = (
            (relative, absolute)
            for calls, paths, relative, absolute, _ in LOOSER
            if fnmatch(name, calls) and any(fnmatch(where, path) for path in paths.split())
        )
        relative, absolute = next(looser, (TOLERANCE, 0.0))
        floor = relative * sizes.get(place, 0.0) * (1.0 if place.endswith("#") else 1e-3)
        return abs(one - other) <= max(relative * abs(one), floor, absolute)

    return list(_compare(stored, found, (), is_near))


def _walk(value: object, path: tuple[object, ...]) -> Iterator[tuple[tuple[object, ...], object]]:
    """Give all that is no list and no object, with its path."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in inner:
        yield from _walk(entry, (*path, key))
    if not isinstance(value, dict | list):
        yield path, value


def _find_place(path: tuple[object, ...]) -> str:
    """Return the path without numbers: the same for all entries of a list, and for all of a digest."""
    *parents, last = ("*" if isinstance(key, int) else str(key) for key in ("", *path))
    return ".".join((*parents, "#" if last in _DIGEST else last))


def _compare(stored: object, found: object, path: tuple[object, ...], is_near: _Near) -> Iterator[str]:
    different = False
    match stored, found:
        case dict(), dict():
            # The entries of an object have no order in JSON.
            different = set(stored) != set(found)
            for key in (key for key in stored if key in found):
                yield from _compare(stored[key], found[key], (*path, key), is_near)
            stored, found = sorted(stored), sorted(found)
        case list(), list():
            different = len(stored) != len(found)
            for k, pair in enumerate(zip(stored, found, strict=False)):
                yield from _compare(*pair, (*path, k), is_near)
            stored, found = f"{len(stored)} entries", f"{len(found)} entries"
        case float(), float():
            different = not is_near(stored, found, path)
        case str(), str():
            different = not _is_same_text(stored, found, path, is_near)
        case _:
            different = type(stored) is not type(found) or stored != found
    if different:
        yield f"{'.'.join(map(str, path)) or 'answer'}: {stored!r} stored, {found!r} found"


def _is_same_text(stored: str, found: str, path: tuple[object, ...], is_near: _Near) -> bool:
    """Return whether words are the same and numbers among them near; columns may be wider."""
    one, other = (re.sub(" +", " ", _NUMBER.sub("#", text)) for text in (stored, found))
    if one != other:
        return False
    pairs = zip(_NUMBER.findall(stored), _NUMBER.findall(found), strict=True)
    return stored == found or all(is_near(float(a), float(b), path) for a, b in pairs)


def read_answer(name: str) -> object:
    """Return the stored answer of a call."""
    return json.loads((ANSWERS / f"{name}.json").read_text(encoding="utf-8"))


def write_text(value: object, indent: str = "") -> str:
    """Return JSON with what holds no further lists or objects on one line."""
    is_table = isinstance(value, dict)
    entries = list(value.values()) if is_table else value
    if not isinstance(entries, list) or not any(isinstance(entry, dict | list) for entry in entries):
        return json.dumps(value, ensure_ascii=False)
    inner = indent + " "
    names = (
        [f"{json.dumps(name, ensure_ascii=False)}: " for name in value] if is_table else [""] * len(entries)
    )
    parts = [f"\n{inner}{k}{write_text(entry, inner)}" for k, entry in zip(names, entries, strict=True)]
    opening, closing = "{}" if is_table else "[]"
    return f"{opening}{','.join(parts)}\n{indent}{closing}"


def main() -> int:
    """Make the calls; say what differs, or with --accept write their answers."""
    parser = argparse.ArgumentParser(description="Make the calls and compare with the stored answers.")
    parser.add_argument("--accept", action="store_true", help="write the answers found over those stored")
    parser.add_argument("names", nargs="*", default=["*"], metavar="NAME", help="calls, or patterns of them")
    arguments = parser.parse_args()
    names = [name for name in CALLS if any(fnmatch(name, pattern) for pattern in arguments.names)]
    if not names or not shutil.which("cc"):
        sys.exit("no such call" if not names else "wants a C compiler")
    different = 0
    with tempfile.TemporaryDirectory(prefix="symid-answers-") as folder:
        scratch = Scratch(Path(folder).resolve())
        for name in names:
            if wants_data(name) and not DATA.is_dir():
                print(f"{name}: left out, its recordings are not at {DATA}")
                continue
            answer, path = find_answer(name, scratch), ANSWERS / f"{name}.json"
            differences = compare(read_answer(name), answer, name) if path.exists() else ["no stored answer"]
            different += bool(differences)
            print(f"{name}: {len(differences)} differences", *differences[:20], sep="\n    ", flush=True)
            if arguments.accept and differences:
                path.write_text(write_text(answer) + "\n", encoding="utf-8")
    return 1 if different and not arguments.accept else 0


if __name__ == "__main__":
    limit_to_one_thread()
    sys.exit(main())
