"""How well symid judges logs: what it says of those that are right, wrong, and wrong in ways it cannot know.

    python benchmarks/judge.py cases       kinds of logs that failed before, and others of each kind
    python benchmarks/judge.py real        real recordings, and the numbers to meet on them
    python benchmarks/judge.py clean       40 clean logs: of three plants that are not symid's, and real stretches
    python benchmarks/judge.py corrupted   100 logs with a mistake, 40 with a fault that is none
    python benchmarks/judge.py alarms      how often tests reject what is true, beside their nominal level
    python benchmarks/judge.py coverage    how often 95 % intervals hold the truth
    python benchmarks/judge.py lengths     the same motion for longer, and other scoring bands

    --only TEXT      entries whose name contains TEXT       --processes N    logs at the same time
    --seed HEX       of all that is drawn                   --count N        of draws, where a part has draws
    --list           names, nothing is fitted               --tables         print what was stored before
    --resume         leave out what was stored before       --write FOLDER   robot files and logs, no fits
    --output FOLDER  raw results, PART.jsonl (build/judge)  --shared FOLDER  with data/ and cases/
    --verify         errors of the plants by independent formulas

Only the public calls of symid are used, so that every version can be measured; what differs between versions is
read by `describe` and `load_statistics` alone. Each log is one task: its robot file and its logs are written to
a folder and identified by default settings, as a user's would be.
"""

import argparse
import json
import os
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from friction_arm_truth import build_plant, compute_rigid_regressor
from judge_faults import corrupt, corrupt_otherwise, look, replace_by_noise, take_torque, turn_gravity
from judge_plants import (
    PLANTS,
    STRETCHES,
    Chain,
    Sample,
    Sensors,
    add_controller,
    build_case_arm,
    cut,
    draw_chain,
    draw_motion,
    draw_recipes,
    find_files,
    find_truth,
    follow,
    map_real,
    measure,
    read_robot_text,
    read_runs,
    run_own,
    simulate_arm,
    simulate_recipe,
    take_stretch,
    unpack,
    verify_plants,
    write_mjcf,
    write_toml,
)
from scipy.stats import binomtest, kstest
from simulated_arms import ARMS, HERE, Run, find_truth as find_arm_truth, furnish, write_arm_file

import symid

LEVELS = ("wrong", "doubtful", "usable", "good")
QUANTILE = 1.96


@dataclass(frozen=True, kw_only=True)
class Given:
    """What all tasks need: folders, the seed, the number of draws, 0 for that of the part."""

    shared: Path
    seed: int
    count: int = 0

    @property
    def data(self) -> Path:
        """Return the folder of real recordings."""
        return self.shared / "data"


# What symid says, in plain types.

NONE = r"no single mistake|log\.impossible|log\.other-robot|has no negative inertia"
FAMILIES = {
    "gravity": r"gravity|mounted|tilted",
    "order": r"swapped|exchanged|order of|\border\b",
    "torque sign": r"torque-sign|torque.*(wrong sign|sign)",
    "position sign": r"position-sign|position.*(wrong sign|sign)",
    "position unit": r"degrees|radians|position.*\bunit",
    "time": r"time-scale|times of the log|time stamps are|\btimes? scale",
    "delay": r"delay|logged about.* (after|before)|\blate\b|\bearly\b",
    "zero": r"joint-zero|\bzero\b",
    "payload": r"payload|contradict|logs differ|logs disagree|another robot",
    "spikes": r"spike|outlier|position-jump|jump",
    "wrap": r"wrap|position-jump|jump",
    "stuck": r"stuck|constant-position|same to the last bit",
    "repeats": r"repeat|held packets|retim|re-tim|fresh samples",
    "clipped": r"saturat|clip",
    "noise": r"unrelated|nothing to do with|\bnoise\b|unexplained|not explain|another motion|constant-torque",
    "torque unit": r"torque.*(times what|unit|factor|gear)|wrong-unit",
    "rotor": r"rotor",
    "friction": r"friction|law",
    "term": r"term",
}
"""Families of causes, by what their codes or sentences say; several may hold of a jump."""
NAMED = ("rotor", "friction", "term")
"""Families that speak of the model, not of a mistake in a log."""


def find_families(text: str) -> list[str]:
    """Return the families that a code or sentence may speak of, the likeliest first; none where it names none."""
    text = text.lower()
    if re.search(NONE, text):
        return []
    return [family for family, pattern in FAMILIES.items() if re.search(pattern, text)]


def describe(fit: symid.RigidFit, names: tuple[str, ...]) -> dict:
    """Return level, causes, warnings, residuals and parameters of a fit, of whatever version of symid."""
    told = fit.to_dict()
    verdict = fit.verdict
    evidence = told.get("evidence") or {}
    listed = told.get("causes") or told["verdict"].get("causes") or evidence.get("causes") or []
    if not listed and verdict.cause:
        listed = [{"code": evidence.get("code", ""), "text": verdict.cause}]
    causes = []
    for entry in listed:
        parts = {"text": entry} if isinstance(entry, str) else entry
        words = [
            str(parts[key])
            for key in ("code", "family", "kind", "name", "text", "cause", "sentence")
            if parts.get(key)
        ]
        joints = parts.get("joints") or ([parts["joint"]] if parts.get("joint") else [])
        said = " ".join(words)
        causes.append(
            {
                "families": find_families(said),
                "joints": list(map(str, joints)) or find_joints(said, names),
                "text": said,
            }
        )
    return {
        "level": verdict.level,
        "exit": int(not fit.accepted),
        "headline": verdict.headline,
        "causes": [cause for cause in causes if cause["families"]],
        "remedy": str(getattr(verdict, "remedy", "") or ""),
        "notices": [[entry.code, bool(entry.is_note), entry.text[:400]] for entry in fit.notices],
        "residual": {entry["joint"]: entry["held_out"] for entry in evidence.get("joints") or []}
        or {entry.joint: entry.relative_percent for entry in fit.residual},
        "parameters": {name: [fit[name].value, fit[name].std] for name in fit},
        "refused": sorted(fit.refused),
    }


def find_joints(text: str, names: tuple[str, ...]) -> list[str]:
    """Return the joints that a text speaks of."""
    return [name for name in names if re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", text)]


def identify(robot_file: Path, logs: list[Path], settings: object = None) -> tuple[dict, object]:
    """Return what identification says of logs, and the fit, None where it refuses."""
    start, fit, names = time.process_time(), None, ()
    found = {"level": "", "exit": 0, "headline": "", "causes": [], "remedy": "", "notices": []}
    found |= {"residual": {}, "parameters": {}, "refused": []}
    try:
        robot = symid.load(robot_file)
        names = tuple(joint.name for joint in robot.joints)
        fit = robot.identify(logs, settings=settings)
        found |= describe(fit, names)
    except symid.SymidError as error:
        texts = [[entry.code, bool(entry.is_note), entry.text[:400]] for entry in error.notices]
        causes = [
            {"families": find_families(f"{code} {text}"), "joints": find_joints(text, names), "text": text}
            for code, note, text in texts
            if not note and code.startswith("log.")
        ]
        found |= {"level": f"exit {error.exit_code}", "exit": error.exit_code, "notices": texts}
        found |= {"headline": texts[0][2], "causes": [entry for entry in causes if entry["families"]]}
    except Exception as error:  # noqa: BLE001 - what is not symid's own error is what this looks for
        found |= {"level": "bug", "exit": 70, "headline": f"{type(error).__name__}: {error}"[:300]}
    return found | {"joints": list(names), "seconds": time.process_time() - start}, fit


def list_mistakes(result: dict) -> list[str]:
    """Return the causes that claim a mistake in a log."""
    return [c["text"] for c in result["causes"] if not set(c["families"][:1]) <= set(NAMED)]


def speaks_of(result: dict, family: str, joints: Iterable[str] = (), *, warned: bool = False) -> bool:
    """Return whether a cause, or also a warning or note, is of a family, and of these joints where there are any."""
    entries = list(result["causes"])
    said = result["headline"], result["remedy"]
    if warned:
        entries += [
            {"families": find_families(text), "joints": find_joints(text, tuple(result["joints"]))}
            for text in re.split(r"(?<=[.;]) ", " ".join(said))
        ]
        entries += [
            {
                "families": find_families(f"{code} {text}"),
                "joints": find_joints(text, tuple(result["joints"])),
            }
            for code, _, text in result["notices"]
        ]
    wanted = set(joints)
    return any(family in e["families"] and (not wanted or wanted <= set(e["joints"])) for e in entries)


def rank(result: dict) -> int:
    """Return the place of a level among LEVELS; a refusal is as low as wrong."""
    return LEVELS.index(result["level"]) if result["level"] in LEVELS else 0


def summarise(result: dict) -> str:
    """Return level, mean residual and causes in a few words."""
    left = np.mean(list(result["residual"].values())) if result["residual"] else float("nan")
    words = "; ".join(c["text"] for c in result["causes"]) or (
        result["headline"] if not result["residual"] else ""
    )
    return f"{result['level']}, {left:.3g} %" + (f", {words[:110]}" if words else "")


def print_table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Print a table."""
    heads = list(heads)
    print(f"| {' | '.join(heads)} |")
    print("|---" * len(heads) + "|")
    for row in rows:
        print("| " + " | ".join(" ".join(str(cell).split()).replace("|", "/") for cell in row) + " |")
    print()


def print_gate(asked: str, reached: str, passed: bool) -> None:
    """Print what was asked of all logs of a part and what was reached."""
    print(f"{'met   ' if passed else 'MISSED'} asked: {asked}; reached: {reached}")


# Cases.


@dataclass(frozen=True, kw_only=True)
class Case:
    """A log, and what is right about it.

    Args:
        make: folder, what is given -> robot file, logs.
        levels: that are right; "refused" for exit codes 3 and 4.
        family: of the cause that must be named; "" where none may be, None where it does not matter.
        joints: that it must name. warned: a warning or note will do.
        truth: true values by name, within 4 deviations and `share` of them, or None.
        direction: of gravity, to be stated within 5 degrees. silent: words that nothing may say.
        held: log that must be predicted, and the percent that may be left.
    """

    make: Callable[[Path, Given], tuple[Path, list[Path]]]
    asked: str
    levels: tuple[str, ...] = ("good", "usable")
    family: str | None = ""
    joints: tuple[str, ...] = ()
    warned: bool = False
    truth: Callable[[Path], dict[str, float]] | None = None
    share: float | None = None
    direction: tuple[float, ...] = ()
    silent: str = ""
    held: tuple[str, float] | None = None


def check(case: Case, result: dict) -> list[str]:
    """Return what is not as it should be."""
    missed = []
    level = "refused" if result["level"] in {"exit 3", "exit 4"} else result["level"]
    if level not in case.levels:
        missed.append(f"level {result['level']}")
    if level == "refused" and level in case.levels:
        return missed
    if case.family == "" and list_mistakes(result):
        missed.append("a mistake is named")
    if case.family and not speaks_of(result, case.family, case.joints, warned=case.warned):
        missed.append(f"{' '.join((case.family, *case.joints))} not named")
    said = " ".join((result["headline"], result["remedy"], *(e["text"] for e in result["causes"])))
    said += " ".join(text for _, note, text in result["notices"] if not note)
    if case.direction and not any(angle < 5.0 for angle in list_angles(said, case.direction)):
        missed.append("direction not stated")
    if case.silent and re.search(case.silent, said):
        missed.append(f"says {case.silent!r}")
    if case.held and not result.get("held", np.inf) <= case.held[1]:
        missed.append(f"held out {result.get('held', np.nan):.3g} %")
    off = []
    for name, true in result.get("truth", {}).items():
        if name not in result["parameters"]:
            continue
        value, deviation = result["parameters"][name]
        z = (value - true) / max(deviation, 1e-300)
        far = case.share is not None and abs(value - true) > case.share * abs(true)
        if (abs(z) > 4.0 and abs(value - true) > 0.003 * abs(true)) or far:
            off.append((abs(z), f"{name} {value:.3g} for {true:.3g} (z {z:.1f})"))
    off.sort(reverse=True)
    if off:
        missed.append(
            f"{len(off)} of {len(result['truth'])} values off: {', '.join(text for _, text in off[:3])}"
        )
    return missed


def list_angles(text: str, direction: tuple[float, ...]) -> list[float]:
    """Return the angles in degrees between a direction and every triple of numbers in a text."""
    number = r"([-+]?\d+\.?\d*(?:e[-+]?\d+)?)"
    found = np.array(
        [list(map(float, m)) for m in re.findall(rf"[(\[]{number}, {number}, {number}[)\]]", text)]
    )
    found = found.reshape(-1, 3)
    sizes = np.linalg.norm(found, axis=1) * np.linalg.norm(direction)
    found, sizes = found[sizes > 0.0], sizes[sizes > 0.0]
    return np.degrees(np.arccos(np.clip(found @ np.array(direction) / sizes, -1.0, 1.0))).tolist()


def _given_case(log: str, robot: str) -> Callable[[Path, Given], tuple[Path, list[Path]]]:
    def make(folder: Path, given: Given) -> tuple[Path, list[Path]]:
        cases = given.shared / "cases"
        return cases / "robots" / robot, [unpack(cases / "logs" / f"{log}.csv.gz", folder)]

    return make


def list_given_cases() -> dict[str, Case]:
    """Return the logs of `cases/logs`."""

    def tell(**values: float) -> Callable[[Path], dict[str, float]]:
        return lambda _: values

    friction = tell(Fv1=6.0, Fv2=6.0, Fv3=3.0, Fc1=6.0, Fc2=5.0, Fc3=2.5)
    polled = tell(ZZR1=0.9, ZZ2=0.15, MXR1=2.0, MX2=0.5, Fv1=0.8, Fv2=0.3, Fc1=1.2, Fc2=0.5)
    bad = ("doubtful", "wrong")
    every = (*LEVELS, "refused")
    return {
        "wall": Case(
            make=_given_case("wall", "arm3.urdf"),
            asked="gravity named with its direction, and the true friction with it",
            levels=every,
            family="gravity",
            direction=(1.0, 0.0, 0.0),
        ),
        "tilted_10deg": Case(
            make=_given_case("tilted_10deg", "arm2.toml"),
            asked="the tilt named or said to be possible",
            family="gravity",
            warned=True,
        ),
        "acrobot": Case(
            make=_given_case("acrobot", "arm2.toml"), asked="good: a joint without torque counts nowhere"
        ),
        "polled_train": Case(
            make=_given_case("polled_train", "polled.toml"),
            asked="repeats noticed, values within 15 %, held out at most 1 %",
            family=None,
            truth=polled,
            share=0.15,
            held=("polled_valid", 1.0),
        ),
        "polled_slow": Case(
            make=_given_case("polled_slow", "polled.toml"),
            asked="within deviations, or refused",
            levels=(*LEVELS, "refused"),
            truth=tell(ZZR1=0.9, ZZ2=0.15, Fv1=0.8),
        ),
        "rigid3_250hz": Case(
            make=_given_case("rigid3_250hz", "rigid3.toml"),
            asked="good, friction right",
            levels=("good",),
            truth=friction,
        ),
        "rigid3_50hz": Case(
            make=_given_case("rigid3_50hz", "rigid3.toml"), asked="friction within deviations", truth=friction
        ),
        "noise_channel6": Case(
            make=_given_case("noise_channel6", "rigid6.toml"),
            asked="joint 6 named, not better than doubtful",
            levels=bad,
            family="noise",
            joints=("j6",),
            warned=True,
        ),
        "two_robots_joint3": Case(
            make=_given_case("two_robots_joint3", "rigid3.toml"),
            asked="joint 3 named, not better than doubtful",
            levels=bad,
            family="noise",
            joints=("j3",),
            warned=True,
        ),
        "mujoco6": Case(
            make=_given_case("mujoco6", "mujoco6.xml"), asked="no delay named", silent="(?i)delay"
        ),
    }


def make_case(build: Callable[[np.random.Generator], Sample], name: str):
    """Return what writes a sample drawn for a case."""

    def make(folder: Path, given: Given) -> tuple[Path, list[Path]]:
        return build(np.random.default_rng([21, given.seed, *name.encode()])).write(folder)

    return make


def poll(
    states_at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    logger: float,
    device: float,
    length: float,
) -> Run:
    """Return what a logger reads of a device that has a new row less often, or about as often."""
    time = np.arange(round(length * logger)) / logger
    fresh = np.floor(time * device + 1e-9) / device
    q, tau = states_at(fresh)
    return Run(time=time, q=q, tau=tau)


def list_own_cases(seed: int) -> dict[str, Case]:
    """Return cases of our own, by kind; what they are is drawn from the seed."""
    found: dict[str, Case] = {}

    def add(name: str, build: Callable[[np.random.Generator], Sample], asked: str, **more: object) -> None:
        found[name] = Case(make=make_case(build, name), asked=asked, **more)

    def true_of(
        build: Callable[[np.random.Generator], Sample], name: str, only: str = ""
    ) -> Callable[[Path], dict[str, float]]:
        def tell(path: Path) -> dict[str, float]:
            chain = build(np.random.default_rng([21, seed, *name.encode()])).chain
            return {k: v for k, v in find_truth(symid.load(path), chain).items() if re.match(only, k)}

        return tell

    def build_polled(logger: float, device: float, size: int, speed: float, length: float):
        def build(rng: np.random.Generator) -> Sample:
            chain = draw_chain(rng, size, planar=size == 2, width=0.002)
            motion = draw_motion(rng, size, length, speed=speed)
            noise = rng.standard_normal((round(length * device) + 2, size))

            def states_at(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                states = follow(chain, motion, at)
                rows = np.round(at * device).astype(int)
                tau = states.tau * 1.0
                tau += 0.02 * np.sqrt(np.mean(tau**2, axis=0)) * noise[rows]
                return np.round(states.q * 1e6) / 1e6, tau

            return Sample(
                text=write_toml(chain), chain=chain, runs=(poll(states_at, logger, device, length),)
            )

        return build

    for logger, device, size in ((500.0, 338.0, 2), (250.0, 200.0, 3), (1000.0, 700.0, 4)):
        name, build = f"polled {logger:g}/{device:g} Hz", build_polled(logger, device, size, 2.0, 15.0)
        add(
            name,
            build,
            "repeats noticed, values right",
            family="repeats",
            warned=True,
            truth=true_of(build, name),
        )
    for number, size in enumerate((2, 2, 3), 1):
        name, build = f"polled slowly {number}", build_polled(100.0, 98.0, size, 0.1, 100.0)
        levels = ("good", "usable", "doubtful", "refused")
        add(name, build, "values right, or refused", levels=levels, truth=true_of(build, name))

    def build_followed(
        size: int,
        *,
        planar: bool = False,
        rate: float = 250.0,
        length: float = 15.0,
        width: float = 0.002,
        **more,
    ):
        """Return what builds a log of an arm that follows its motion; `change` makes the motion another one."""

        def build(rng: np.random.Generator) -> Sample:
            chain = draw_chain(rng, size, planar=planar, width=width)
            motion = draw_motion(rng, size, length, more.get("kind", "waves"))
            times = np.arange(round(length * rate)) / rate
            states = follow(chain, motion, times)
            return Sample(
                text=write_toml(chain), chain=chain, runs=(measure(states, Sensors(rate=rate), rng),)
            )

        return build

    def build_jitter(share: float, size: int):
        def build(rng: np.random.Generator) -> Sample:
            sample = build_followed(size)(rng)
            (run,) = sample.runs
            wrong = run.time + share / 250.0 * np.clip(rng.standard_normal(len(run.time)), -2.5, 2.5)
            return replace(sample, runs=(replace(run, time=np.sort(wrong)),))

        return build

    for share, size in ((0.05, 3), (0.14, 2), (0.3, 4)):
        name, build = f"stamps off by {share:.0%}", build_jitter(share, size)
        add(name, build, "values right", truth=true_of(build, name))

    def build_resting(size: int, joint: int):
        def build(rng: np.random.Generator) -> Sample:
            chain = draw_chain(rng, size, planar=False, width=0.002)
            motion = draw_motion(rng, size, 15.0)
            times = np.arange(15 * 250) / 250.0
            # It trembles by some milliradians as the others move.
            hold = np.where(np.arange(size) == joint, 0.002, 1.0)
            parts = [hold * part for part in motion(times)]
            states = follow(chain, lambda _: tuple(parts), times)
            # The drive follows little of it.
            states.tau[:, joint] *= 0.02
            return Sample(text=write_toml(chain), chain=chain, runs=(measure(states, Sensors(), rng),))

        return build

    for size, joint in ((2, 1), (4, 3), (6, 4)):
        add(
            f"joint {joint + 1} of {size} at rest with little torque",
            build_resting(size, joint),
            "not wrong, no mistake named",
            levels=("good", "usable", "doubtful", "refused"),
        )

    def build_mounted(size: int, angle: float, axis: tuple[float, ...], *, planar: bool = False):
        def build(rng: np.random.Generator) -> Sample:
            chain = draw_chain(rng, size, planar=planar, width=0.002)
            turned = turn_gravity(chain, np.radians(angle), np.array(axis))
            states = run_own(add_controller(turned), draw_motion(rng, size, 15.0), 15.0)
            return Sample(text=write_toml(turned), chain=turned, runs=(measure(states, Sensors(), rng),))

        return build

    for name, size, angle, axis in (
        ("on a wall", 4, 90.0, (0.0, 1.0, 0.0)),
        ("on the ceiling", 3, 180.0, (1.0, 0.0, 0.0)),
        ("tilted by 5 degrees about x", 4, 5.0, (1.0, 0.0, 0.0)),
        ("tilted by 10 degrees about y", 6, 10.0, (0.0, 1.0, 0.0)),
        ("tilted by 20 degrees about x + y", 3, 20.0, (1.0, 1.0, 0.0)),
    ):
        down = np.array((0.0, 0.0, -1.0))
        unit = np.array(axis) / np.linalg.norm(axis)
        turn = np.radians(angle)
        direction = (
            down * np.cos(turn)
            + np.cross(unit, down) * np.sin(turn)
            + unit * (unit @ down) * (1 - np.cos(turn))
        )
        add(
            name,
            build_mounted(size, angle, axis),
            "gravity named with its direction" if angle >= 10.0 else "gravity said to be possible",
            levels=(*LEVELS, "refused"),
            family="gravity",
            warned=angle < 10.0,
            direction=tuple(direction) if angle >= 10.0 else (),
        )

    def build_torque(size: int, joint: int, *, noise: bool):
        def build(rng: np.random.Generator) -> Sample:
            sample = build_followed(size)(rng)
            if noise:
                change = replace_by_noise(joint, rng)
            else:
                states = follow(sample.chain, draw_motion(rng, size, 15.0), np.arange(15 * 250) / 250.0)
                change = take_torque(joint, states.tau[:, joint - 1])
            return replace(sample, runs=tuple(map(change, sample.runs)))

        return build

    for noise, word in ((True, "noise as torque"), (False, "torque of another motion at")):
        for size, joint in ((3, 1), (6, 2), (5, 4)):
            add(
                f"{word} {joint} of {size}",
                build_torque(size, joint, noise=noise),
                "the joint named, not better than doubtful",
                levels=("doubtful", "wrong"),
                family="noise",
                joints=(f"j{joint}",),
                warned=True,
            )

    def build_repeated(size: int, period: float):
        def build(rng: np.random.Generator) -> Sample:
            chain = draw_chain(rng, size, planar=False, width=0.002)
            motion = draw_motion(rng, size, 10.0, "series")
            times = np.arange(round(10.0 * period * 100.0)) / 100.0
            # The series has a period of 10 s; it is passed in `period` s.
            pace = 10.0 / period

            def faster(time: np.ndarray) -> tuple[np.ndarray, ...]:
                q, dq, ddq = motion(time * pace)
                return q, dq * pace, ddq * pace**2

            states = follow(chain, faster, times)
            return Sample(
                text=write_toml(chain), chain=chain, runs=(measure(states, Sensors(rate=100.0), rng),)
            )

        return build

    for size, period in ((2, 10.0), (3, 6.0), (5, 8.0)):
        name, build = f"one period of {period:g} s ten times, {size} joints", build_repeated(size, period)
        add(name, build, "usable, tested on this motion only", levels=("usable",), truth=true_of(build, name))

    def build_plant_case(plant: str, size: int, width: float, rate: float):
        def build(rng: np.random.Generator) -> Sample:
            chain = draw_chain(rng, size, planar=False, width=width)
            states = PLANTS[plant](chain, draw_motion(rng, size, 15.0), 15.0)
            run = measure(states, Sensors(rate=rate), rng)
            if plant == "mujoco":
                return Sample(text=write_mjcf(chain), suffix=".xml", chain=chain, runs=(run,))
            return Sample(text=write_toml(chain), chain=chain, runs=(run,))

        return build

    for size, rate in ((3, 250.0), (5, 500.0), (6, 200.0)):
        build = build_plant_case("mujoco", size, 0.03, rate)
        add(
            f"friction smooth to 30 mrad/s, {size} joints, {rate:g} Hz",
            build,
            "no delay named",
            silent="(?i)delay",
        )
    for size, rate in ((2, 100.0), (4, 250.0), (6, 500.0)):
        name = f"friction smooth to 5 mrad/s, {size} joints, {rate:g} Hz"
        build = build_plant_case("own", size, 0.005, rate)
        add(name, build, "friction within deviations", truth=true_of(build, name, "F"))

    def build_two(size: int, kind: str):
        def build(rng: np.random.Generator) -> Sample:
            chain = draw_chain(rng, size, planar=False, width=0.002)
            second = chain.add_payload(0.8 * chain.bodies[-1][0], (0.1, 0.05, 0.05))
            if kind == "another arm":
                other = draw_chain(rng, size, planar=False, width=0.002)
                second = replace(other, dh=chain.dh)
            chains = (chain, add_controller(second))
            runs = tuple(
                measure(run_own(entry, draw_motion(rng, size, 12.0), 12.0), Sensors(), rng)
                for entry in chains
            )
            return Sample(text=write_toml(chain), chain=chain, runs=runs)

        return build

    for size, kind in ((3, "a payload"), (5, "a payload"), (4, "another arm")):
        add(
            f"{kind} in the second log, {size} joints",
            build_two(size, kind),
            "the logs' contradiction named",
            levels=("usable", "doubtful", "wrong"),
            family="payload",
            warned=True,
        )
    return found


@cache
def list_cases(given: Given) -> dict[str, Case]:
    """Return all cases by name."""
    return list_given_cases() | list_own_cases(given.seed)


def run_case(name: str, given: Given, folder: Path) -> dict:
    """Return what is said of a case, the truth beside it, and what is missed."""
    case = list_cases(given)[name]
    robot, logs = case.make(folder, given)
    result, fit = identify(robot, logs)
    if case.truth and fit is not None:
        result["truth"] = case.truth(robot)
    if case.held and fit is not None:
        log = unpack(given.shared / "cases" / "logs" / f"{case.held[0]}.csv.gz", folder)
        result["held"] = fit.validate(log).mean_relative_percent
    return result | {"asked": case.asked, "missed": check(case, result)}


def show_cases(results: list[dict]) -> None:
    """Print a line a case."""
    rows = [(r["name"], r["asked"], summarise(r), "; ".join(r["missed"]) or "ok") for r in results]
    print_table(("case", "asked", "reached", "missed"), rows)
    met = sum(not r["missed"] for r in results)
    print_gate("every case", f"{met} of {len(results)}", met == len(results))


# Real recordings.

REAL: dict[str, tuple[str, float | None]] = {
    "TX40, first 60 % -> last 40 %, 10 Hz": ("tx40", 22.0),
    "KR300, A + B -> C, 10 Hz": ("kr300", 15.5),
    "EMPS, published settings": ("emps-published", None),
    "EMPS -> PULSES, 100 Hz": ("emps", 7.45),
    "double pendulum, 2 + 3 -> 1, 5 Hz": ("pendulum", 29.0),
    "UR10 bag, unit stated": ("ur10", None),
    "Panda bag": ("panda", None),
}
"""What is fitted and foretold, and the percent that may be left."""
PUBLISHED = {
    "M1": (95.1089, 0.1085),
    "Fv1": (203.5034, 1.1460),
    "Fc1": (20.3935, 0.1012),
    "offset1": (-3.1648, 0.0444),
}


def run_real(name: str, given: Given, folder: Path) -> dict:
    """Return what a real set reaches by the documented metric."""
    key, most = REAL[name]
    robot, logs = find_files(given.data)[key.split("-")[0]]
    settings = {"emps-published": "published", "ur10": "bag"}.get(key)
    fitted, held, band, test = logs[:1], None, None, None
    if key == "tx40":
        held, band, test = logs[0], 10.0, "60%:"
    elif key == "kr300":
        fitted, held, band = logs[:2], logs[2], 10.0
    elif key == "emps":
        held, band = logs[1], 100.0
    elif key == "pendulum":
        fitted, held, band = logs[1:3], logs[0], 5.0
    elif key in {"ur10", "panda"}:
        # Their files have kinematics alone: what a user adds first are rotors and friction.
        robot = folder / f"{key}.toml"
        robot.write_text(furnish(read_robot_text(given.data, key)), encoding="utf-8")
    if key == "tx40":
        # A part of a log that is fitted.
        fit = symid.load(robot).identify(fitted, train="0:60%")
        result = describe(fit, tuple(joint.name for joint in fit.robot.joints)) | {"seconds": 0.0}
    else:
        result, fit = identify(robot, fitted, settings)
    missed = [f"exit code {result['exit']}"] * bool(result["exit"])
    missed += [f"names: {text}" for text in list_mistakes(result)]
    if held is not None and fit is not None:
        left = fit.validate(held, test=test, band=band).residual
        result["left"] = float(np.mean([entry.relative_percent for entry in left]))
        squares = [(entry.norm, 100.0 * entry.norm / entry.relative_percent) for entry in left]
        result["stacked"] = float(100.0 * np.divide(*np.sqrt(np.sum(np.square(squares), axis=0))))
        missed += [f"{result['left']:.2f} % for {most:g}"] * (result["left"] > most)
    if key == "emps-published" and fit is not None:
        found = {k: (round(fit[k].value, 4), round(fit[k].std, 4)) for k in fit}
        wrong = [k for k, v in PUBLISHED.items() if found.get(k) != v]
        (entry,) = fit.residual
        wrong += ["residual"] * (
            (round(entry.norm, 4), round(entry.relative_percent, 4)) != (108.7569, 4.0834)
        )
        pulses = fit.validate(logs[1], settings=settings).residual[0]
        wrong += ["pulses"] * (
            (round(pulses.norm, 4), round(pulses.relative_percent, 4)) != (169.4876, 5.9824)
        )
        missed += [f"not the published digits: {', '.join(wrong)}"] * bool(wrong)
    return result | {"most": most, "missed": missed}


def show_real(results: list[dict]) -> None:
    """Print a line a set."""
    rows = [
        (
            r["name"],
            "exit 0, no mistake named" if r["most"] is None else f"at most {r['most']:g} %",
            f"{r['left']:.2f} % (stacked {r['stacked']:.2f} %), {r['level']}"
            if "left" in r
            else summarise(r),
            "; ".join(r["missed"]) or "ok",
        )
        for r in results
    ]
    print_table(("set", "asked", "reached", "missed"), rows)
    met = sum(not r["missed"] for r in results)
    print_gate("every set", f"{met} of {len(results)}", met == len(results))


# Clean logs.


@cache
def list_clean(given: Given) -> dict[str, Callable[[], Sample]]:
    """Return clean logs by name: twenty of the plants, twenty real ones."""
    found = {r.name: lambda r=r: simulate_recipe(r) for r in draw_recipes(given.seed)}
    return found | {name: lambda name=name: take_stretch(given.data, name) for name in STRETCHES}


def run_clean(name: str, given: Given, folder: Path) -> dict:
    """Return what is said of a clean log."""
    if name.endswith("bag"):
        return run_real({"UR10 bag": "UR10 bag, unit stated"}.get(name, name), given, folder)
    sample = list_clean(given)[name]()
    robot, logs = sample.write(folder)
    result, fit = identify(robot, logs)
    if sample.chain is not None and fit is not None:
        result["truth"] = find_truth(symid.load(robot), sample.chain)
    return result


def measure_scores(result: dict) -> np.ndarray:
    """Return errors over stated deviations of all parameters whose truth is known."""
    pairs = [
        (*result["parameters"][k], true)
        for k, true in result.get("truth", {}).items()
        if k in result["parameters"]
    ]
    return np.array([(value - true) / max(std, 1e-300) for value, std, true in pairs])


def show_clean(results: list[dict]) -> None:
    """Print a line a log, and the gates."""
    rows = []
    for r in results:
        scores = np.abs(measure_scores(r))
        within = f"{100 * np.mean(scores <= QUANTILE):.0f} %, {scores.max():.1f}" if len(scores) else ""
        named = list_mistakes(r)
        rows.append((r["name"], summarise(r), within, "; ".join(named) or "", f"{r['seconds']:.1f}"))
    print_table(("log", "reached", "95 % intervals hold, largest z", "mistakes named", "s"), rows)
    wrong = sum(r["exit"] != 0 for r in results)
    named = sum(bool(list_mistakes(r)) for r in results)
    fine = sum(r["level"] in {"good", "usable"} for r in results)
    print_gate("none wrong or refused", str(wrong), wrong == 0)
    print_gate("no mistake named", str(named), named == 0)
    print_gate("three quarters good or usable", f"{fine} of {len(results)}", 4 * fine >= 3 * len(results))


# Corrupted logs.


@cache
def list_corrupted(given: Given) -> tuple[tuple[str, str, int], ...]:
    """Return base, whether the fault is among the causes, and number of every corruption that is drawn."""
    rng = np.random.default_rng([31, given.seed])
    bases = [name for name in list_clean(given)]
    listed = given.count or 100
    other = round(0.4 * listed)
    return tuple(
        (str(rng.choice(bases)), "listed" if number < listed else "unlisted", number)
        for number in range(listed + other)
    )


def list_corrupted_names(given: Given) -> list[str]:
    """Return a name for every corruption; what it is turns out when its base is made."""
    return [f"{number:03d} {kind}: {base}" for base, kind, number in list_corrupted(given)]


def run_corrupted(name: str, given: Given, folder: Path) -> dict:
    """Return what is said of a corrupted log, what of the clean one, and what the logs show by other fits."""
    number = int(name[:3])
    base, kind, _ = list_corrupted(given)[number]
    rng = np.random.default_rng([32, given.seed, number])
    found = None
    while found is None:
        clean = list_clean(given)[base]()
        found = corrupt(base, clean, rng) if kind == "listed" else corrupt_otherwise(base, clean, rng)
    sight = asdict(look(found)) if kind == "listed" else {}
    robot, logs = found.wrong.write(folder / "wrong")
    result, _ = identify(robot, logs)
    before = identify(*found.clean.write(folder / "clean"))[0]
    joints = [result["joints"][joint - 1] for joint in found.joints] if result["joints"] else []
    return result | {
        "kind": kind,
        "what": found.name,
        "family": found.family,
        "touched": joints,
        "before": before,
        **sight,
    }


def judge_corrupted(r: dict) -> str:
    """Return "right", "false" or "set" for what is named, else "lower", "warned" or "SILENT"."""
    data = r["family"] in {"spikes", "wrap", "stuck", "repeats", "clipped", "noise"}
    if r["kind"] == "listed":
        before = {(code, text) for code, _, text in r["before"]["notices"]}
        new = [entry for entry in r["notices"] if (entry[0], entry[2]) not in before]
        if speaks_of(r | {"notices": new}, r["family"], r["touched"], warned=data):
            return "set" if len(r["causes"]) > 1 and not data else "right"
    if list_mistakes(r):
        return "false"
    if rank(r) < rank(r["before"]):
        return "lower"
    codes = {code for code, note, _ in r["before"]["notices"] if not note}
    return "warned" if any(not note and code not in codes for code, note, _ in r["notices"]) else "SILENT"


def show_corrupted(results: list[dict]) -> None:
    """Print a line a log, and the gates."""
    rows, counts = [], Counter()
    for r in results:
        outcome = judge_corrupted(r)
        if r["kind"] == "listed":
            visible = r["touched_falls"] >= 2.0 and r["pooled"] >= 1.5
            seen = ("visible" if visible else "hidden") + (
                ", unique" if r["ratio"] >= 2.0 else f", {r['rival']}"
            )
            falls = f"{r['clean']:.3g} -> {r['wrong']:.3g} %, {min(r['touched_falls'], 9999):.3g}, {min(r['pooled'], 9999):.3g}, {min(r['ratio'], 9999):.3g}"
            told = visible and r["ratio"] >= 2.0
        else:
            seen, falls, told = "", "", False
        counts[r["kind"], told, outcome] += 1
        rows.append((r["name"][:4] + r["what"], seen, falls, r["before"]["level"], outcome, summarise(r)))
    heads = (
        "log",
        "shown by other fits",
        "left; touched, pooled, rival times",
        "clean",
        "came out",
        "reached",
    )
    print_table(heads, rows)
    told = {key[2]: n for key, n in counts.items() if key[:2] == ("listed", True)}
    named = {
        word: sum(n for key, n in counts.items() if key[0] == "listed" and key[2] == word)
        for word in ("right", "false")
    }
    whole, rest = sum(told.values()), sum(n for key, n in counts.items() if key[0] == "unlisted")
    false = sum(n for key, n in counts.items() if key[0] == "unlisted" and key[2] == "false")
    right, names = told.get("right", 0), sum(named.values())
    print(
        f"{whole} of {sum(n for key, n in counts.items() if key[0] == 'listed')} are visible and unique: {told}"
    )
    print_gate("80 % of these named", f"{right} of {whole}", right >= 0.8 * whole)
    print_gate(
        "95 % of names right, of all that are listed",
        f"{named['right']} of {names}",
        named["right"] >= 0.95 * names,
    )
    silent = told.get("SILENT", 0)
    print_gate(
        "5 % of visible and unique ones silent at most", f"{silent} of {whole}", silent <= 0.05 * whole
    )
    print_gate("one cause named at most of faults that are not listed", f"{false} of {rest}", false <= 1)


# Alarm rates of the statistics.

NOMINAL = (0.01, 0.05, 0.1, 0.3)
DRAWS = 20
"""Of a task."""
ALARMS = ("compare, equal models", "compare, a column more", "agree, halves", "agree, slow rows")


def load_statistics() -> tuple[Callable[..., float], Callable[..., float]] | None:
    """Return the two statistics of this version of symid as functions to a p; None where it has none.

    compare(before, after) of losses (parts, joints): p of "after predicts better". agree(x, folds_x, other,
    folds_other, grams) of estimates (p,), those without each block (blocks, p), and grams (joints, p, p) of the
    regressor: p of "both say the same".
    """
    try:
        from symid.identification import judge
    except ImportError:
        return None
    return (lambda *given: float(judge.compare(*given).p)), (lambda *given: float(judge.agree(*given).p))


def draw_regression(
    rng: np.random.Generator, size: int, *, coloured: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return columns (T, n, p) of independent rigid parameters and friction, torques and velocities (T, n).

    The law is exact. The noise of the torques is 2 % of their rms, white or with a memory of 0.1 s.
    """
    chain = draw_chain(rng, size, planar=False, width=0.0)
    times = np.arange(40 * 25) / 25.0
    q, dq, ddq = draw_motion(rng, size, 40.0)(times)
    plant = build_plant(chain, chain.list_friction(), gravity=np.array(chain.gravity))
    rigid = compute_rigid_regressor(plant, q, dq, ddq)
    flat = rigid.reshape(-1, rigid.shape[2])
    basis = np.linalg.svd(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-12), full_matrices=False)
    rank_of = int(np.sum(1e-8 * basis.S[0] < basis.S))
    rigid = (basis.U[:, :rank_of] * np.sqrt(len(flat))).reshape(*q.shape, rank_of)
    each = np.arange(size)
    added = np.zeros((*q.shape, 2, size))
    added[:, each, 0, each], added[:, each, 1, each] = dq, np.sign(dq)
    columns = np.concatenate([rigid, added.reshape(*q.shape, -1)], axis=2)
    tau = chain.compute_torques(q, dq, ddq) + chain.compute_friction(dq)
    noise = rng.standard_normal(tau.shape)
    if coloured:
        keep = np.exp(-1.0 / 25.0 / 0.1)
        for row in range(1, len(noise)):
            noise[row] = keep * noise[row - 1] + np.sqrt(1.0 - keep**2) * noise[row]
    return columns, tau + 0.02 * np.sqrt(np.mean(tau**2, axis=0)) * noise, dq


def _solve(columns: np.ndarray, tau: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Return the least squares of rows `kept` (T, n), joints relative to their torques."""
    weight = kept / np.sqrt(np.mean(tau**2, axis=0))
    table = (columns * weight[:, :, None]).reshape(-1, columns.shape[2])
    return np.linalg.lstsq(table, (tau * weight).ravel())[0]


def draw_p(test: str, statistics: tuple[Callable[..., float], ...], rng: np.random.Generator) -> float:
    """Return the p of one draw in which nothing is to be found."""
    compare, agree = statistics
    size = int(rng.integers(2, 6))
    columns, tau, dq = draw_regression(rng, size, coloured=bool(rng.uniform() < 0.5))
    count = len(tau)
    kept = np.ones(tau.shape, dtype=bool)
    if test.startswith("compare"):

        def add_noise() -> np.ndarray:
            return np.concatenate([columns, rng.standard_normal((*tau.shape, 1))], axis=2)

        models = (add_noise() if test.endswith("equal models") else columns), add_noise()
        fold = np.arange(count) * 6 // count
        part = np.arange(count) * 24 // count
        losses = []
        for model in models:
            squares = np.empty(tau.shape)
            for k in range(6):
                values = _solve(model, tau, kept & (fold != k)[:, None])
                squares[fold == k] = (tau[fold == k] - model[fold == k] @ values) ** 2
            each = [squares[part == k].sum(axis=0) for k in range(24)]
            losses.append(np.array(each) / np.sum(tau**2, axis=0))
        return compare(*losses)
    blocks = np.arange(count) * 24 // count
    if test.endswith("halves"):
        first = (np.arange(count) < count // 2)[:, None] & kept
        rows = first, ~first
    else:
        rows = kept, np.abs(dq) > 0.05 * np.abs(dq).max(axis=0)
    given = []
    for own in rows:
        folds = [_solve(columns, tau, own & (blocks != k)[:, None]) for k in range(24)]
        given += [_solve(columns, tau, own), np.array(folds)]
    return agree(*given, np.einsum("tjk,tjl->jkl", columns, columns))


def list_alarms(given: Given) -> list[str]:
    """Return tests and numbers of tasks of DRAWS draws."""
    tasks = range((given.count or 200) // DRAWS or 1)
    return [f"{test} [{number}]" for test, number in product(ALARMS, tasks)]


def run_alarms(name: str, given: Given, folder: Path) -> dict:  # noqa: ARG001
    """Return p-values where nothing is to be found."""
    test, number = name[:-1].split(" [")
    statistics = load_statistics()
    if statistics is None:
        return {"test": test, "p": []}
    draws = range(min(DRAWS, given.count or DRAWS))
    return {
        "test": test,
        "p": [
            draw_p(test, statistics, np.random.default_rng([41, given.seed, int(number), k])) for k in draws
        ],
    }


def show_alarms(results: list[dict]) -> None:
    """Print rates of alarm beside nominal levels."""
    if not any(r["p"] for r in results):
        print("this version of symid has no compare and agree in symid.identification.judge")
        return
    rows, good = [], True
    for test in ALARMS:
        p = np.array([value for r in results if r["test"] == test for value in r["p"]])
        if not len(p):
            continue
        cells = []
        for level in NOMINAL:
            count = int(np.sum(p < level))
            side = "greater" if test.endswith("more") else "two-sided"
            chance = binomtest(count, len(p), level, alternative=side).pvalue
            cells.append(f"{100.0 * count / len(p):.1f} % (p {chance:.2g})")
            good &= chance > 0.001
        rows.append((test, len(p), *cells, f"{kstest(p, 'uniform').pvalue:.2g}"))
    print_table(("test", "draws", *(f"nominal {level:.0%}" for level in NOMINAL), "Kolmogorov p"), rows)
    print_gate("no rate differs from its nominal one (p 0.001)", str(good).lower(), good)


# Coverage.

COVERED = ("rigid3 250 Hz", "rigid3 50 Hz", "spatial4 200 Hz", "spatial4 50 Hz", "panda white")
SHARP = ("rigid3 250 Hz", "spatial4 200 Hz", "panda white")
"""Plants at 100 Hz or more; all have dry friction that is a sign, or smooth below 5 mrad/s."""


def list_coverage(given: Given) -> list[str]:
    """Return plants and seeds; cases and arms of `simulated_arms.py` are plants, too, by --only."""
    return [f"{plant} [{seed}]" for plant in COVERED for seed in range(given.count or 100)]


@cache
def build_covered(plant: str, seed: int) -> Chain:
    """Return the truth of a plant."""
    if plant.startswith("rigid3"):
        return build_case_arm()
    return draw_chain(np.random.default_rng([51, seed]), 4, planar=False, width=0.002)


def run_coverage(name: str, given: Given, folder: Path) -> dict:
    """Return what one draw gives, the truth beside it."""
    plant, number = name[:-1].split(" [")
    arm, case = plant.split()[:2]
    if arm in ARMS:
        sample = simulate_arm(arm, case, int(number))
        truth = find_arm_truth(arm, write_arm_file(ARMS[arm], folder))
    else:
        chain, rate = build_covered(plant, given.seed), float(case)
        rng = np.random.default_rng([52, given.seed, int(number)])
        length = 20.0
        states = run_own(chain, draw_motion(rng, chain.size, length), length)
        if rate == 50.0:
            # As it is read before a hold in place of about its middle.
            states = replace_torque_early(states, chain)
        run = measure(states, Sensors(rate=rate), rng)
        sample = Sample(text=write_toml(chain), chain=chain, runs=(run,))
        truth = {}
    robot, logs = sample.write(folder)
    result, fit = identify(robot, logs)
    if fit is not None:
        result["truth"] = truth or find_truth(symid.load(robot), sample.chain)
    result.pop("notices")
    return result | {"plant": plant}


def replace_torque_early(states, chain: Chain):
    """Return states whose torques are half a control period early: those of the next hold."""
    tau = np.vstack([states.tau[1:], states.tau[-1:]])
    return replace(states, tau=(states.tau + tau) / 2.0)


def show_coverage(results: list[dict]) -> None:
    """Print a line a plant, and the gates."""
    rows, gates = [], []
    for plant in dict.fromkeys(r["plant"] for r in results):
        part = [r for r in results if r["plant"] == plant]
        hits: dict[str, list[float]] = {}
        for r in part:
            for key, true in r.get("truth", {}).items():
                if key in r["parameters"]:
                    value, std = r["parameters"][key]
                    hits.setdefault(key, []).append(
                        ((value - true) / max(std, 1e-300), value / true if true else np.nan)
                    )
        if not hits:
            rows.append((plant, len(part), *[""] * 6, Counter(r["level"] for r in part)))
            continue
        shares = {
            key: 100.0 * float(np.mean([abs(z) <= QUANTILE for z, _ in entry])) for key, entry in hits.items()
        }
        pooled = 100.0 * float(np.mean([abs(z) <= QUANTILE for entry in hits.values() for z, _ in entry]))
        friction = 100.0 * float(
            np.mean(
                [
                    abs(z) <= QUANTILE
                    for key, entry in hits.items()
                    if key[:2] in {"Fc", "Fv"}
                    for z, _ in entry
                ]
            )
        )
        least = min(shares, key=shares.get)
        bias = {
            key: 100.0 * (float(np.mean([x for _, x in entry])) - 1.0)
            for key, entry in hits.items()
            if key[:2] == "Fc"
        }
        most = max(bias, key=lambda key: abs(bias[key]))
        fine = 100.0 * float(np.mean([r["level"] in {"good", "usable"} for r in part]))
        bold = sum(r["level"] == "good" and bool(np.any(np.abs(measure_scores(r)) > 4.0)) for r in part)
        levels = ", ".join(
            f"{level} {count}" for level, count in Counter(r["level"] for r in part).most_common()
        )
        seconds = np.mean([r["seconds"] for r in part])
        rows.append(
            (
                plant,
                len(part),
                f"{pooled:.1f}",
                f"{friction:.1f}",
                f"{shares[least]:.0f} {least}",
                f"{bias[most]:+.2f} {most}",
                levels,
                bold,
                f"{seconds:.1f}",
            )
        )
        slow = plant.endswith("50 Hz") and "250" not in plant
        checks = [
            (
                f"{plant}: friction at least {88 if slow else 90} %",
                f"{friction:.1f} %",
                friction >= (88 if slow else 90),
            )
        ]
        if slow:
            checks.append((f"{plant}: pooled at least 85 %", f"{pooled:.1f} %", pooled >= 85.0))
        else:
            checks.append((f"{plant}: pooled 92 to 98 %", f"{pooled:.1f} %", 92.0 <= pooled <= 98.0))
            checks.append(
                (f"{plant}: each at least 80 %", f"{shares[least]:.0f} % {least}", shares[least] >= 80.0)
            )
            checks.append(
                (f"{plant}: bias of Fc at most 1 %", f"{bias[most]:+.2f} % {most}", abs(bias[most]) <= 1.0)
            )
        checks.append((f"{plant}: good or usable in 95 %", f"{fine:.0f} %", fine >= 95.0))
        checks.append(
            (
                f"{plant}: good with any |z| > 4 in 5 % at most",
                f"{bold} of {len(part)}",
                bold <= 0.05 * len(part),
            )
        )
        gates += checks
    heads = (
        "plant",
        "fits",
        "pooled, %",
        "friction, %",
        "least, %",
        "largest bias of Fc, %",
        "verdicts",
        "good, |z| > 4",
        "s a fit",
    )
    print_table(heads, rows)
    for gate in gates:
        print_gate(*gate)


# Lengths and scoring bands.

SCORING = "processing.scoring_band"
"""Setting of the scoring band in Hz, where a version has one."""
LENGTHS = (10.0, 60.0, 3600.0)
LENGTHENED = ("planar 2R", "spatial 4R", "spatial 6R")
BANDED = {"TX40": "tx40", "KR300 A": "kr300", "pendulum 1": "pendulum", "EMPS": "emps"}


def list_lengths(given: Given) -> list[str]:  # noqa: ARG001
    """Return arms and lengths, real sets and shares of their lengths, and bands of both."""
    found = [f"{arm}, {length:g} s" for arm, length in product(LENGTHENED, LENGTHS)]
    found += [f"{name}, {share:.0%}" for name, share in product(BANDED, (0.33, 0.67, 1.0))]
    bases = (*(f"{arm}, 60 s" for arm in LENGTHENED), *(f"{name}, 100%" for name in BANDED))
    return found + [f"{base}, band {factor}" for base, factor in product(bases, ("halved", "doubled"))]


def run_lengths(name: str, given: Given, folder: Path) -> dict:
    """Return what a motion of some length gives, or what another scoring band does."""
    base, length, *factor = name.split(", ")
    if base in BANDED:
        run = read_runs(given.data, BANDED[base])[0]
        kept = slice(0, round(float(length[:-1]) / 100.0 * len(run.time)))
        sample = map_real(given.data, BANDED[base], (cut(run, kept),))
    else:
        size = int(base[-2])
        rng = np.random.default_rng([61, given.seed, size])
        chain = draw_chain(rng, size, planar="planar" in base, width=0.002)
        motion = draw_motion(rng, size, 60.0)
        states = follow(chain, motion, np.arange(round(float(length[:-2]) * 100.0)) / 100.0)
        sample = Sample(
            text=write_toml(chain), chain=chain, runs=(measure(states, Sensors(rate=100.0), rng),)
        )
    robot, logs = sample.write(folder)
    settings = None
    if factor:
        before = identify(robot, logs)[1]
        if before is None:
            return {"level": "refused", "settable": False, "seconds": 0.0}
        band = before.to_dict()["evidence"]["scoring"] * (0.5 if "halved" in factor[0] else 2.0)
        settings = {SCORING: band}
    result, fit = identify(robot, logs, settings)
    if fit is not None and sample.chain is not None:
        result["truth"] = find_truth(symid.load(robot), sample.chain)
    if fit is not None:
        evidence = fit.to_dict().get("evidence") or {}
        result["scoring"] = evidence.get("scoring")
    settable = not factor or not result["level"].startswith("exit 2")
    return result | {"settable": settable}


def show_lengths(results: list[dict]) -> None:
    """Print a line a log."""
    rows = []
    for r in results:
        if not r["settable"]:
            rows.append((r["name"], "", "the scoring band cannot be set", "", ""))
            continue
        scores = np.abs(measure_scores(r))
        within = f"{100 * np.mean(scores <= QUANTILE):.0f} %, {scores.max():.1f}" if len(scores) else ""
        rows.append((r["name"], f"{r.get('scoring') or 0:.3g}", summarise(r), within, f"{r['seconds']:.1f}"))
    print_table(("log", "scoring band, Hz", "reached", "95 % intervals hold, largest z", "s"), rows)


# Calls.

PARTS: dict[str, tuple[Callable, Callable, Callable]] = {
    "cases": (list_cases, run_case, show_cases),
    "real": (lambda _: REAL, run_real, show_real),
    "clean": (list_clean, run_clean, show_clean),
    "corrupted": (list_corrupted_names, run_corrupted, show_corrupted),
    "alarms": (list_alarms, run_alarms, show_alarms),
    "coverage": (list_coverage, run_coverage, show_coverage),
    "lengths": (list_lengths, run_lengths, show_lengths),
}


def run_one(part: str, name: str, given: Given) -> dict:
    """Return the result of one task."""
    with tempfile.TemporaryDirectory() as folder:
        return {"name": name} | PARTS[part][1](name, given, Path(folder))


def run_all(part: str, names: list[str], given: Given, processes: int) -> Iterator[dict]:
    """Yield results as they come."""
    if processes <= 1:
        yield from (run_one(part, name, given) for name in names)
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for task in as_completed([pool.submit(run_one, part, name, given) for name in names]):
            yield task.result()


def read_stored(path: Path) -> dict[str, dict]:
    """Return stored results by name, the last of each."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {entry["name"]: entry for entry in map(json.loads, lines)}


def read_arguments() -> argparse.Namespace:
    """Return the arguments of the call."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=tuple(PARTS), nargs="?")
    parser.add_argument("--only", default="")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--seed", type=lambda text: int(text, 16), default=0x51D)
    parser.add_argument("--count", type=int, default=0)
    for flag in ("--list", "--tables", "--resume", "--verify"):
        parser.add_argument(flag, action="store_true")
    parser.add_argument("--output", type=Path, default=HERE.parent / "build" / "judge")
    parser.add_argument("--shared", type=Path, default=HERE.parent.parent / "shared")
    return parser.parse_args()


def main() -> None:
    """Fit and print, or only one of both."""
    told = read_arguments()
    if told.verify:
        print(json.dumps(verify_plants(told.seed), indent=1))
        return
    given = Given(shared=told.shared.resolve(), seed=told.seed, count=told.count)
    make_names, _, show = PARTS[told.part]
    names = [name for name in make_names(given) if told.only in name]
    path = told.output / f"{told.part}.jsonl"
    stored = read_stored(path)
    if told.list:
        print("\n".join(names))
        return
    if not told.tables:
        path.parent.mkdir(parents=True, exist_ok=True)
        wanted = [name for name in names if not (told.resume and name in stored)]
        with path.open("a", encoding="utf-8") as file:
            for count, result in enumerate(run_all(told.part, wanted, given, told.processes), 1):
                stored[result["name"]] = result
                file.write(json.dumps(result) + "\n")
                file.flush()
                print(f"\r{count}/{len(wanted)}", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
    show([stored[name] for name in names if name in stored])


if __name__ == "__main__":
    main()
