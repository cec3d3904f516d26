"""The user's own robot survives the round trip: URDF -> logs of another truth -> URDF, loaded again.

    python benchmarks/round_trip.py                      the ten robots
    python benchmarks/round_trip.py z1 my_arm.urdf       some of them, or own files
        [--seed 1] [--folder FOLDER] [--output RAW.json]
    python benchmarks/round_trip.py --list               which ten, and from how many files five were drawn
    python benchmarks/round_trip.py --tables RAW.json... tables of earlier results again

Five robots are fixed, five are drawn from the other files of example-robot-data by a seed; whole files with
1 to 12 coordinates and no <mimic>, one of each folder. The command line runs as a newcomer would run it: new,
excite, simulate; then logs of a hidden truth (hidden_truths.py) along the computed trajectory and along a
random one; check, identify, validate, export in place. No option is given but --base, --tip, --friction and
--rotors. The URDF is loaded into Pinocchio and MuJoCo, and its torques are compared with the truth in states
of the second motion, joint by joint. Rotors that are identifiable alone are no part of links, and simulators
do not read them from a URDF: they are added, from transmissions or as estimated. A step that fails is
reported with what symid says; those that do not need it go on.

The second table is about the numbers: chi-square of the exported values in the covariance of the estimate,
that of the truth, and the largest move of a rotor in its standard deviation.
Needs `pip install pin mujoco example-robot-data`.
"""

import argparse
import importlib.metadata
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin
from hidden_truths import Dynamics, read_model, write_logs

import symid

FIRST = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", None, None),
    "z1": ("z1_description/urdf/z1.urdf", None, None),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", None, None),
    "panda": ("panda_description/urdf/panda.urdf", None, "panda_hand"),
    "kinova": ("kinova_description/robots/kinova.urdf", None, "j2s6s200_end_effector"),
}
"""File, base and tip; chosen before the first run."""
DRAWN = 5
DRAW_SEED = 2026
LARGEST = 12
FRICTION = "coulomb-viscous"
WORSE, FLOOR = 1.1, 0.5
"""An exported torque may be off by so much more than the identified one, or by so many percent."""
SNAPPED = 1e-4
"""Of the torques: what rounding of angles of nearly a quarter turn may leave."""
PROGRAMS = ("pinocchio", "mujoco")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


class StepFailedError(Exception):
    """A step of the chain that did not end as it should; the message is symid's own."""


@dataclass(kw_only=True)
class Trip:
    """One robot on its way: where its files are, and what is known so far."""

    name: str
    source: Path
    base: str | None
    tip: str | None
    folder: Path
    seed: int
    seconds: dict[str, float] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    found: dict[str, object] = field(default_factory=dict)

    @property
    def chain(self) -> list[str]:
        """Return the options that cut the chain out of the file."""
        pairs = (("--base", self.base), ("--tip", self.tip))
        return [text for option, link in pairs if link for text in (option, link)]

    def call(self, step: str, *arguments: str, accepted: tuple[int, ...] = (0,)) -> dict:
        """Run a verb in the robot's folder and return its result."""
        start = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "symid", *arguments, "--force", "--json"]
            if arguments[0] not in {"check", "validate"}
            else [sys.executable, "-m", "symid", *arguments, "--json"],
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=False,
        )
        self.seconds[step] = time.perf_counter() - start
        try:
            answer = json.loads(done.stdout)
        except json.JSONDecodeError:
            text = f"exit code {done.returncode}: {done.stderr.strip()[-300:]}"
            raise StepFailedError(text) from None
        if done.returncode not in accepted:
            texts = [entry["text"] for entry in answer.get("errors", [])]
            text = f"exit code {done.returncode}: {'; '.join(texts)}"
            raise StepFailedError(text)
        return answer.get("result", {})

    def attempt(self, step: str, action) -> object:
        """Return what `action` gives, or None where it fails, which is kept with its message."""
        try:
            return action()
        except StepFailedError as error:
            self.failures[step] = str(error)
        except Exception as error:  # noqa: BLE001 - a file that another program cannot load is a result
            self.failures[step] = f"{type(error).__name__}: {error}"
        return None


# Which robots.


def find_robots() -> Path:
    """Return the folder of the URDFs of example-robot-data."""
    for file in importlib.metadata.files("example-robot-data") or []:
        if file.suffix == ".urdf":
            path = Path(str(file.locate()))
            return next(folder for folder in path.parents[1:] if folder.name == "robots")
    sys.exit("example-robot-data is not installed: pip install example-robot-data")


def list_eligible(folder: Path) -> list[Path]:
    """Return files of 1 to LARGEST coordinates without followers, but for the folders of FIRST."""
    taken = {Path(entry[0]).parts[0] for entry in FIRST.values()}
    found = []
    for path in sorted(folder.rglob("*.urdf")):
        if path.relative_to(folder).parts[0] in taken or "<mimic" in path.read_text(encoding="utf-8"):
            continue
        try:
            count = pin.buildModelFromUrdf(str(path)).nv
        except ValueError:
            continue
        if 1 <= count <= LARGEST:
            found.append(path)
    return found


def draw_robots(folder: Path) -> dict[str, tuple[str, None, None]]:
    """Return the first DRAWN eligible files of a seeded shuffle, one of each folder."""
    files = list_eligible(folder)
    drawn: dict[str, Path] = {}
    for k in np.random.default_rng(DRAW_SEED).permutation(len(files)):
        drawn.setdefault(files[k].relative_to(folder).parts[0], files[k])
    return {path.stem: (str(path.relative_to(folder)), None, None) for path in list(drawn.values())[:DRAWN]}


# The chain.


def make_trip(trip: Trip) -> None:
    """Run the whole chain; what fails ends it, but for what nothing depends on."""
    urdf, toml = f"{trip.name}.urdf", f"{trip.name}.toml"
    (trip.folder / urdf).write_bytes(trip.source.read_bytes())
    options = ["--friction", FRICTION, "--rotors"]
    trip.call("new", "new", toml, "--from-urdf", urdf, *trip.chain, *options)
    if not (trip.folder / "training_motion.csv").exists():
        trip.call("excite", "excite", toml, "-o", "training_motion.csv")
    motion = ("--trajectory", "training_motion.csv", "-o", "simulated.csv")
    trip.attempt("simulate", lambda: trip.call("simulate", "simulate", urdf, *trip.chain, *motion))
    robot = symid.load(trip.folder / toml)
    start = time.perf_counter()
    motion_file = trip.folder / "training_motion.csv"
    truth, states = write_logs(trip.folder / urdf, robot, motion_file, trip.folder, seed=trip.seed)
    trip.seconds["truth"] = time.perf_counter() - start
    trip.attempt("check", lambda: trip.call("check", "check", toml, "training.csv"))
    fit = trip.call("identify", "identify", toml, "training.csv", "-o", "estimate.json", accepted=(0, 1))
    trip.found["verdict"] = fit["verdict"]["level"]
    trip.found["values"] = len(fit["parameters"])
    validation = ("validate", toml, "estimate.json", "validation.csv")
    judged = trip.attempt("validate", lambda: trip.call("validate", *validation, accepted=(0, 1)))
    trip.found["validated"] = judged["verdict"]["level"] if judged else "-"
    accept = ["--accept"] if trip.found["verdict"] == "wrong" else []
    export_urdf(trip, urdf, toml, accept)
    compare_torques(trip, robot, truth, states[:, ::20])


def export_urdf(trip: Trip, urdf: str, toml: str, accept: list[str]) -> None:
    """Write the values into a copy of the URDF; where that fails, which is noted, as a new file."""
    file, copy = trip.folder / urdf, trip.folder / "identified.urdf"
    arguments = ("export", toml, "estimate.json", *accept)
    done = trip.attempt("export", lambda: trip.call("export", *arguments, "--in-place"))
    if done is None:
        trip.call("export", *arguments, "-o", copy.name)
    else:
        copy.write_bytes(file.read_bytes())
        file.write_bytes(trip.source.read_bytes())
    trip.found["diff"] = compare_files(file, copy)


def compare_files(before: Path, after: Path) -> dict[str, int]:
    """Return how many lines of a kind differ: in numbers, by new attributes, added, comments, removed."""
    old, new = (path.read_text(encoding="utf-8").splitlines() for path in (before, after))
    masked = [[" ".join(NUMBER.sub("0", line).split()) for line in lines] for lines in (old, new)]
    found: Counter[str] = Counter()
    inside = False
    for kind, a, b, c, d in SequenceMatcher(None, *masked, autojunk=False).get_opcodes():
        if kind == "equal":
            found["numbers"] += sum(x != y for x, y in zip(old[a:b], new[c:d], strict=True))
            continue
        gone, come = list(range(a, b)), list(range(c, d))
        for k in list(gone):
            match = next((m for m in come if gains_attributes(old[k], new[m])), None)
            if match is not None:
                gone.remove(k)
                come.remove(match)
                found["attributes"] += 1
        found["removed"] += len(gone)
        for k in come:
            inside = inside or "<!--" in new[k]
            found["comments" if inside else "added"] += 1
            inside = inside and "-->" not in new[k]
    return {kind: count for kind, count in found.items() if count}


def gains_attributes(old: str, new: str) -> bool:
    """Return whether a line is the same element with more attributes, and other numbers."""
    (first, before), (second, after) = (
        (re.match(r"\s*<(\w+)", line), set(re.findall(r"(\w+)\s*=", line))) for line in (old, new)
    )
    return bool(first and second and first[1] == second[1] and before < after)


# Torques.


def compare_torques(trip: Trip, robot: symid.RobotModel, truth: Dynamics, states: np.ndarray) -> None:
    """Note what identified and exported torques are off, in percent of each joint's torque."""
    fit = symid.load_fit(trip.folder / "estimate.json", robot)
    functions = robot.compile()
    there = [truth.joints.index(joint.name) for joint in robot.joints]
    q, dq, ddq = states[..., there]
    wanted = truth.compute_torques(*states)[:, there]
    size = np.sqrt(np.mean(wanted**2, axis=0))

    def measure(torques: np.ndarray) -> list[float]:
        return [float(x) for x in 100.0 * np.sqrt(np.mean((torques - wanted) ** 2, axis=0)) / size]

    # What is not identifiable keeps the value of the file, as in an export.
    known = {name: value or 0.0 for name, value in robot.base.values.items()} | dict(fit.values)
    beta, f = ([known.get(name, 0.0) for name in names] for names in (robot.base.names, robot.base.friction))
    identified = np.asarray(functions.inverse_dynamics(q, dq, ddq, np.array(beta)))
    identified = identified + np.asarray(functions.friction(dq, np.array(f)))
    trip.found |= {"joints": [joint.name for joint in robot.joints], "identified": measure(identified)}
    zero = np.zeros(len(size))
    file = Dynamics(model=read_model(trip.source, truth.joints), rotor=zero, viscous=zero, dry=zero)
    trip.found["before"] = measure(file.compute_torques(*states)[:, there])
    exported = trip.attempt("pinocchio", lambda: load_exported(trip, robot, fit, truth.joints))
    if exported is None:
        return
    trip.found["pinocchio"] = measure(exported.compute_torques(*states)[:, there])
    torques = trip.attempt("mujoco", lambda: run_mujoco(trip, exported, truth.joints, states))
    if torques is not None:
        trip.found["mujoco"] = measure(torques[:, there])
    trip.attempt("numbers", lambda: compare_numbers(trip, robot, fit, truth, exported))


def load_exported(trip: Trip, robot: symid.RobotModel, fit: symid.Fit, joints: tuple[str, ...]) -> Dynamics:
    """Return the exported robot as Pinocchio reads it, with rotors beside it.

    Those that are identifiable alone: in transmissions of the file, else as estimated; others are in links.
    """
    path = trip.folder / "identified.urdf"
    model = read_model(path, joints)
    known, names = fit.values, enumerate((joint.name for joint in robot.joints), 1)
    rotors = {name: known.get(f"IA{number}", 0.0) for number, name in names}
    for transmission in ET.parse(path).getroot().iter("transmission"):  # noqa: S314 - our own file
        name, inertia = transmission.find("joint"), transmission.find(".//motorInertia")
        ratio = transmission.find(".//mechanicalReduction")
        if inertia is not None and name is not None and name.get("name") in rotors:
            gear = 1.0 if ratio is None else float(ratio.text)
            rotors[name.get("name")] = gear**2 * float(inertia.text)
    rotor = np.array([rotors[name] for name in model.names[1:]])
    return Dynamics(model=model, rotor=rotor, viscous=model.damping, dry=model.upperDryFrictionLimit)


def build_mujoco(path: Path) -> "mujoco.MjModel":
    """Return MuJoCo's model of a URDF.

    Without shapes, and without the inertia of the base, which does nothing, and which some files have wrong.
    """
    import mujoco

    tree = ET.parse(path)  # noqa: S314 - our own file
    carried = {child.get("link") for child in tree.getroot().iter("child")}
    for link in tree.getroot().findall("link"):
        dropped = {"visual", "collision"} | ({"inertial"} if link.get("name") not in carried else set())
        for part in [part for part in link if part.tag in dropped]:
            link.remove(part)
    held = {"balanceinertia": "false", "discardvisual": "false", "fusestatic": "false"}
    ET.SubElement(ET.SubElement(tree.getroot(), "mujoco"), "compiler", held)
    return mujoco.MjModel.from_xml_string(ET.tostring(tree.getroot(), encoding="unicode"))


def run_mujoco(trip: Trip, exported: Dynamics, joints: tuple[str, ...], states: np.ndarray) -> np.ndarray:
    """Return torques of the exported file by MuJoCo (N, n), in the order of `joints`; others are at zero."""
    import mujoco

    try:
        model = build_mujoco(trip.folder / "identified.urdf")
    except ValueError as error:
        try:
            build_mujoco(trip.source)
        except ValueError:
            text = f"it cannot read the file as it was either: {error}"
            raise StepFailedError(text) from None
        raise
    place = [model.joint(name).dofadr[0] for name in joints]
    # MuJoCo reads the file's friction; its dry friction is a soft constraint, so that both are added here.
    np.testing.assert_allclose(model.dof_damping[place], exported.viscous, rtol=1e-9)
    np.testing.assert_allclose(model.dof_frictionloss[place], exported.dry, rtol=1e-9)
    model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    torques = np.empty(states.shape[1:])
    for k, (q, dq, ddq) in enumerate(states.swapaxes(0, 1)):
        data.qpos[place], data.qvel[place], data.qacc[place] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        torques[k] = data.qfrc_inverse[place]
    return (
        torques
        + exported.rotor * states[2]
        + exported.viscous * states[1]
        + exported.dry * np.sign(states[1])
    )


# Numbers.


def find_values(robot: symid.RobotModel, dynamics: Dynamics, there: list[int]) -> dict[str, float]:
    """Return base and friction values that give these dynamics; but for what snapping moved."""
    rng = np.random.default_rng(0)
    states = rng.uniform(-1.5, 1.5, (3, 300, len(there)))
    zero = np.zeros(len(there))
    still = replace(dynamics, viscous=zero, dry=zero)
    order = np.argsort(there)
    torques = still.compute_torques(*states[..., order])[:, there].ravel()
    rows = np.asarray(robot.compile().torque_regressor(*states)).reshape(len(torques), -1)
    size = np.sqrt(np.mean(rows**2, axis=0))
    values = np.linalg.lstsq(rows / size, torques, rcond=1e-12)[0] / size
    left = np.abs(rows @ values - torques).max() / np.abs(torques).max()
    if left > SNAPPED:
        text = f"base values leave {left:.1e} of the torques"
        raise StepFailedError(text)
    found = dict(zip(robot.base.names, map(float, values), strict=True))
    for number, k in enumerate(there, 1):
        found |= {f"Fv{number}": float(dynamics.viscous[k]), f"Fc{number}": float(dynamics.dry[k])}
    return found


def compare_numbers(
    trip: Trip, robot: symid.RobotModel, fit: symid.Fit, truth: Dynamics, exported: Dynamics
) -> None:
    """Note chi-square of exported and true values about the estimate, and the largest move of a rotor."""
    there = [truth.joints.index(joint.name) for joint in robot.joints]
    names = list(fit)
    std = np.array([fit[name].std for name in names])
    inverse = np.linalg.inv(np.asarray(fit.covariance) / np.outer(std, std))
    pairs = (("exported", exported), ("true", truth))
    values = {key: find_values(robot, dynamics, there) for key, dynamics in pairs}
    trip.found["chi_square"] = {}
    for key, table in values.items():
        off = np.array([table[name] - fit[name].value for name in names]) / std
        trip.found["chi_square"][key] = float(off @ inverse @ off)
    rotors = {f"IA{number}": float(exported.rotor[k]) for number, k in enumerate(there, 1)}
    trip.found["rotors"] = {
        name: abs(inertia - fit[name].value) / fit[name].std
        for name, inertia in rotors.items()
        if name in names
    }


# Tables.


def pick_worst(entry: dict, key: str) -> float | None:
    """Return the largest error of a joint, in percent."""
    return max(entry["found"][key]) if key in entry["found"] else None


def judge(entry: dict) -> str:
    """Return what is missing for a trip that nothing is wrong with; empty where that is nothing."""
    found, wrong = entry["found"], sorted(entry["failures"])
    for program in PROGRAMS:
        if program in found:
            pairs = zip(found["identified"], found[program], strict=True)
            wrong += [f"torque in {program}"] * any(b > max(WORSE * a, FLOOR) for a, b in pairs)
    wrong += ["diff"] * ("removed" in found.get("diff", {}))
    return ", ".join(wrong)


def print_tables(entries: list[dict]) -> None:
    """Print both tables and the messages of steps that failed."""
    heads = ("robot", "coordinates", "values", "verdict, of validation", "identified, worst joint, %")
    heads += (
        "file before, %",
        "in Pinocchio, %",
        "in MuJoCo, %",
        "lines of the diff",
        "seconds",
        "not as it must be",
    )
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for entry in entries:
        found = entry["found"]
        worst = [pick_worst(entry, key) for key in ("identified", "before", *PROGRAMS)]
        cells = [entry["name"], len(found.get("joints", [])) or "-", found.get("values", "-")]
        cells.append(f"{found.get('verdict', '-')}, {found.get('validated', '-')}")
        cells += ["-" if value is None else f"{value:.3g}" for value in worst]
        cells.append(", ".join(f"{count} {kind}" for kind, count in found.get("diff", {}).items()) or "-")
        cells.append(", ".join(f"{step} {value:.0f}" for step, value in entry["seconds"].items()))
        print(f"| {' | '.join(map(str, [*cells, judge(entry) or 'nothing']))} |")
    print("\n| robot | values | chi-square, exported | chi-square, truth | largest move of a rotor, std |")
    print("|---" * 5 + "|")
    for entry in entries:
        found = entry["found"]
        if "chi_square" not in found:
            continue
        squares = found["chi_square"]
        moves = found["rotors"]
        move = f"{max(moves.values()):.2g} ({max(moves, key=moves.get)})" if moves else "-"
        numbers = f"{squares['exported']:.4g} | {squares['true']:.4g}"
        print(f"| {entry['name']} | {found['values']} | {numbers} | {move} |")
    for entry in entries:
        for step, text in entry["failures"].items():
            print(f"\n{entry['name']}: {step}: {text}")


def read_arguments() -> argparse.Namespace:
    """Return the arguments of the call."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("robots", nargs="*", metavar="ROBOT")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="keeps all files, and computes no motion that is there")
    parser.add_argument("--output", type=Path)
    parser.add_argument("--tables", type=Path, nargs="+")
    parser.add_argument("--list", action="store_true")
    return parser.parse_args()


def choose(given: argparse.Namespace) -> dict[str, tuple[Path, str | None, str | None]]:
    """Return the robots of the call."""
    folder = find_robots()
    listed = FIRST | draw_robots(folder)
    if given.list:
        print(
            f"{len(list_eligible(folder))} eligible files; drawn with seed {DRAW_SEED}: the last {DRAWN} of"
        )
        print(*(f"{name}: {entry[0]}" for name, entry in listed.items()), sep="\n")
        sys.exit()
    known = {name: (folder / path, base, tip) for name, (path, base, tip) in listed.items()}
    chosen = {}
    for name in given.robots or known:
        path = Path(name).resolve()
        if name not in known and not path.is_file():
            sys.exit(f"no robot {name!r}: a file, or one of {', '.join(known)}")
        chosen |= {name: known[name]} if name in known else {path.stem: (path, None, None)}
    return chosen


def main() -> None:
    """Run and print."""
    given = read_arguments()
    if given.tables:
        texts = [path.read_text(encoding="utf-8") for path in given.tables]
        print_tables([entry for text in texts for entry in json.loads(text)])
        return
    entries = []
    with tempfile.TemporaryDirectory() as scratch:
        for name, (source, base, tip) in choose(given).items():
            folder = (given.folder or Path(scratch)).resolve() / name
            folder.mkdir(parents=True, exist_ok=True)
            trip = Trip(name=name, source=source, base=base, tip=tip, folder=folder, seed=given.seed)
            trip.attempt("chain", lambda trip=trip: make_trip(trip))
            entry = {"name": name, "seconds": trip.seconds, "failures": trip.failures, "found": trip.found}
            print(f"{name}: {judge(entry) or 'as it must be'}", file=sys.stderr, flush=True)
            entries.append(entry)
            if given.output:
                given.output.write_text(json.dumps(entries, indent=1), encoding="utf-8")
    print_tables(entries)


if __name__ == "__main__":
    main()
