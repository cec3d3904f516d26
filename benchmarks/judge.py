"""How well symid judges logs: what it says of those that are right, wrong, and wrong in ways it cannot know.

    python benchmarks/judge.py cases       kinds of logs that failed before, and others of each kind
    python benchmarks/judge.py real        real recordings, and the numbers to meet on them
    python benchmarks/judge.py clean       40 clean logs: of three plants that are not symid's, and real ones
    python benchmarks/judge.py corrupted   100 logs with a mistake, 40 with a fault that is none
    python benchmarks/judge.py alarms      how often tests reject what is true, beside their nominal level
    python benchmarks/judge.py coverage    how often 95 % intervals hold the truth
    python benchmarks/judge.py lengths     the same motion for longer, and other scoring bands

    --only TEXT      entries whose name contains TEXT       --processes N    logs at the same time
    --seed HEX       of all that is drawn                   --count N        of draws, where a part has draws
    --list           names, nothing is fitted               --tables         print what was stored before
    --resume         leave out what was stored before       --verify         errors of the plants, see there
    --output FOLDER  raw results, PART.jsonl (build/judge)  --shared FOLDER  with data/ and cases/

But for alarm rates and lengths only public calls of symid are used, so that versions can be compared; what
differs between them is read by `describe` alone. Each log is one task: its robot file and its logs are
written to a folder and identified by default settings, as a user's would be.
"""

import argparse
import json
import os
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from friction_arm_truth import build_plant, compute_rigid_regressor
from judge_faults import corrupt, corrupt_otherwise, look, replace_by_noise, take_torque
from judge_plants import (
    STRETCHES,
    Recipe,
    Sample,
    build_chain,
    build_sample,
    draw_chain,
    draw_motion,
    draw_recipes,
    find_files,
    find_truth,
    read_robot_text,
    simulate_recipe,
    simulate_run,
    take_stretch,
    unpack,
    verify_plants,
)
from scipy.stats import binomtest, kstest
from simulated_arms import ARMS, CASES, HERE, find_truth as find_arm_truth, simulate, write_arm_file

import symid
from symid.codegen import Library
from symid.identification import judge, regression
from symid.identification.rigid import fit as rigid_fit, settings_choice
from symid.identification.rigid.settings_choice import SettingsStudy as Study

LEVELS = ("wrong", "doubtful", "usable", "good")
FINE = ("good", "usable")
REFUSED = ("exit 3", "exit 4")
QUANTILE = 1.96


@dataclass(frozen=True, kw_only=True)
class Given:
    """What all tasks need: the folder with data and cases, the seed, the number of draws (0: as usual)."""

    shared: Path
    seed: int
    count: int = 0


# What symid says, in plain types.

FAMILIES = {
    "gravity": r"gravity|mounted|tilted",
    "order": r"swapped|exchanged|\border\b",
    "torque sign": r"torque-sign|torque.*\bsign\b",
    "position sign": r"position-sign|position.*\bsign\b",
    "position unit": r"degrees|radians|position.*\bunit",
    "time": r"time-scale|times of the log|\btimes? scale",
    "delay": r"delay|logged about.* (after|before)|\blate\b|\bearly\b",
    "zero": r"joint-zero|\bzero\b",
    "payload": r"payload|contradict|logs differ|logs disagree|another robot",
    "spikes": r"spike|outlier|jump",
    "wrap": r"wrap|jump",
    "stuck": r"stuck|constant-position|same to the last bit",
    "repeats": r"repeat|held packets|re-?tim|fresh samples",
    "clipped": r"saturat|clip",
    "noise": r"unrelated|nothing to do with|\bnoise\b|unexplained|not explain|another motion|constant-torque",
    "torque unit": r"torque.*(times what|unit|factor|gear)|wrong-unit",
    "rotor": r"rotor",
    "friction": r"friction|law",
    "term": r"term",
}
"""Families of causes by what codes and sentences say: the first that fits; all that fit for a warning."""
NONE = r"no single mistake|log\.impossible|log\.other-robot"
MODEL = {"rotor", "friction", "term", "noise"}
"""Families that claim no mistake of a log that could be undone."""
DATA = {"spikes", "wrap", "stuck", "repeats", "clipped", "noise"}
"""Families that a warning or a note names as well as a cause."""


def read_text(text: str, names: Collection[str], joints: Iterable[str] = ()) -> dict:
    """Return the families and the joints that a code with a sentence speaks of; none if it names no cause."""
    low = text.lower()
    families = [key for key, pattern in FAMILIES.items() if re.search(pattern, low)]
    found = [name for name in names if re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", text)]
    return {
        "families": [] if re.search(NONE, low) else families,
        "joints": [str(joint) for joint in joints] or found,
        "text": text,
    }


def describe(fit: symid.RigidFit, names: Collection[str]) -> dict:
    """Return level, causes, notices, residuals and parameters of a fit, of whatever version of symid.

    Causes are a list of records or sentences under `causes`, or the one sentence of the verdict.
    """
    told, verdict = fit.to_dict(), fit.verdict
    evidence = told.get("evidence") or {}
    listed = next((part["causes"] for part in (told, told["verdict"], evidence) if part.get("causes")), [])
    if not listed and verdict.cause:
        listed = [{"code": evidence.get("code", ""), "text": verdict.cause}]
    causes = []
    for entry in listed:
        parts = {"text": entry} if isinstance(entry, str) else entry
        keys = ("code", "family", "kind", "name", "text", "cause", "sentence")
        joints = parts.get("joints") or [parts[key] for key in ("joint",) if parts.get(key)]
        causes.append(read_text(" ".join(str(parts[key]) for key in keys if parts.get(key)), names, joints))
    held = {entry["joint"]: entry["held_out"] for entry in evidence.get("joints") or []}
    return {
        "level": verdict.level,
        "exit": int(not fit.accepted),
        "headline": verdict.headline,
        "remedy": str(getattr(verdict, "remedy", "") or ""),
        "causes": [cause for cause in causes if cause["families"]],
        "notices": [[entry.code, bool(entry.is_note), entry.text[:400]] for entry in fit.notices],
        "residual": held or {entry.joint: entry.relative_percent for entry in fit.residual},
        "parameters": {name: [fit[name].value, fit[name].std] for name in fit},
        "scoring": evidence.get("scoring"),
    }


def identify(robot_file: Path, logs: list[Path], **options: object) -> tuple[dict, symid.RigidFit | None]:
    """Return what identification says of logs, and the fit where there is one."""
    start, fit, names = time.process_time(), None, ()
    found = {"exit": 0, "remedy": "", "causes": [], "notices": [], "residual": {}, "parameters": {}}
    try:
        robot = symid.load(robot_file)
        names = [joint.name for joint in robot.joints]
        fit = robot.identify(logs, **options)
        found |= describe(fit, names)
    except symid.SymidError as error:
        texts = [[entry.code, bool(entry.is_note), entry.text[:400]] for entry in error.notices]
        causes = [read_text(f"{code} {text}", names) for code, note, text in texts if not note]
        found |= {"level": f"exit {error.exit_code}", "exit": error.exit_code, "notices": texts}
        found |= {"headline": texts[0][2], "causes": [entry for entry in causes if entry["families"]]}
    except Exception as error:  # noqa: BLE001 - what is not symid's own error is what this looks for
        found |= {"level": "bug", "exit": 70, "headline": f"{type(error).__name__}: {error}"[:300]}
    return found | {"joints": list(names), "seconds": time.process_time() - start}, fit


def list_mistakes(result: dict) -> list[str]:
    """Return the causes of a fit that claim a mistake in its logs; a refusal states none."""
    given = [] if result["level"].startswith("exit") else result["causes"]
    return [cause["text"] for cause in given if cause["families"][0] not in MODEL]


def speaks_of(result: dict, family: str, joints: Collection[str] = (), *, warned: bool = False) -> bool:
    """Return whether a cause, or also headline, warning or note, is of a family and names these joints."""
    entries = [cause | {"families": cause["families"][:1]} for cause in result["causes"]]
    if warned:
        said = re.split(r"(?<=[.;]) ", f"{result['headline']} {result['remedy']}")
        said += [f"{code} {text}" for code, _, text in result["notices"]]
        entries += result["causes"] + [read_text(text, result["joints"]) for text in said]
    return any(family in entry["families"] and set(joints) <= set(entry["joints"]) for entry in entries)


def measure_scores(result: dict) -> np.ndarray:
    """Return errors over stated deviations of all parameters whose truth is known."""
    known, found = result.get("truth", {}), result["parameters"]
    return np.array([(found[k][0] - known[k]) / max(found[k][1], 1e-300) for k in known if k in found])


def summarise(result: dict) -> str:
    """Return level, mean residual and causes in a few words."""
    if not result["residual"]:
        return f"{result['level']}, {result['headline'][:110]}"
    said = "; ".join(cause["text"] for cause in result["causes"])
    return f"{result['level']}, {np.mean(list(result['residual'].values())):.3g} % {said[:110]}"


def show_scores(result: dict) -> str:
    """Return the share of intervals that hold the truth, and the largest error in deviations."""
    scores = np.abs(measure_scores(result))
    return f"{100 * np.mean(scores <= QUANTILE):.0f} %, {scores.max():.1f}" if len(scores) else ""


def print_table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Print a table."""
    heads = list(heads)
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for row in rows:
        print("| " + " | ".join(" ".join(str(cell).split()).replace("|", "/") for cell in row) + " |")
    print()


def print_gate(asked: str, reached: object, *, met: bool) -> None:
    """Print what was asked of all logs of a part and what was reached."""
    print(f"{'met   ' if met else 'MISSED'} asked: {asked}; reached: {reached}")


def show_missed(results: list[dict]) -> None:
    """Print a line an entry, with what is missed."""
    rows = [
        (r["name"], r["asked"], r.get("reached") or summarise(r), "; ".join(r["missed"]) or "ok")
        for r in results
    ]
    print_table(("entry", "asked", "reached", "missed"), rows)
    met = sum(not r["missed"] for r in results)
    print_gate("every entry", f"{met} of {len(results)}", met=met == len(results))


# Cases.


@dataclass(frozen=True, kw_only=True)
class Case:
    """A kind of log, and what is right about it.

    Args:
        source: a recipe, or log and robot of `cases`.
        spoilt: joint, from one, with another torque, and whether that is noise or of another motion.
        levels: that are right. family: of the cause that must be named; "" if none may be, None if any may.
        joints: that it must name. warned: a warning will do. direction: of gravity, which it must state.
        truth: values by name, or a pattern of the names that count: within four deviations, and `share`.
        silent: what nothing may speak of. held: log to predict, and the percent that may be left.
    """

    asked: str
    source: Recipe | tuple[str, str] = ("", "")
    spoilt: tuple[int, str] = (0, "")
    levels: tuple[str, ...] = FINE
    family: str | None = ""
    joints: tuple[str, ...] = ()
    warned: bool = False
    direction: tuple[float, ...] | str = ()
    truth: dict[str, float] | str | None = None
    share: float | None = None
    silent: str = ""
    held: tuple[str, float] | None = None


_ANY, _BAD = (*LEVELS, *REFUSED), ("doubtful", "wrong")
_SPOILT = Case(asked="joint named, doubtful or wrong", levels=_BAD, family="noise", warned=True)
_GRAVITY = Case(asked="gravity named, with its direction", levels=_ANY, family="gravity", direction="tilt")
_TILT = Case(asked="a tilt said to be possible", levels=_ANY, family="gravity", warned=True)
_POLLED = Case(asked="repeats noticed, values right", family="repeats", warned=True, truth="")
_SLOW = Case(asked="values right, or refused", levels=(*FINE, "doubtful", *REFUSED), truth="")
_JITTER = Case(asked="values right", truth="")
_REST = Case(asked="not wrong, no mistake named", levels=(*FINE, "doubtful", *REFUSED))
_PERIOD = Case(asked="usable: tested on this motion only", levels=("usable",), truth="")
_SMOOTH = Case(asked="no delay named", silent="delay")
_SHARP = Case(asked="friction right", truth="F")
_TWO = Case(asked="the contradiction of the logs named", levels=LEVELS[:3], family="payload", warned=True)
_FRICTION = {"Fv1": 6.0, "Fv2": 6.0, "Fv3": 3.0, "Fc1": 6.0, "Fc2": 5.0, "Fc3": 2.5}
_PLANAR = {"ZZR1": 0.9, "ZZ2": 0.15, "MXR1": 2.0, "MX2": 0.5, "Fv1": 0.8, "Fv2": 0.3, "Fc1": 1.2, "Fc2": 0.5}


@cache
def list_cases(_: Given) -> dict[str, Case]:
    """Return all cases by name: the logs of `cases`, then ours by kind."""
    found = {
        "wall": replace(
            _GRAVITY, source=("wall", "arm3.urdf"), direction=(1.0, 0.0, 0.0), truth={"Fv1": 0.8, "Fc1": 1.0}
        ),
        "tilted_10deg": replace(_TILT, source=("tilted_10deg", "arm2.toml")),
        "acrobot": Case(asked="good: a joint without torque counts nowhere", source=("acrobot", "arm2.toml")),
        "polled_train": replace(
            _POLLED,
            source=("polled_train", "polled.toml"),
            truth=_PLANAR,
            share=0.15,
            held=("polled_valid", 1.0),
        ),
        "polled_slow": replace(
            _SLOW,
            source=("polled_slow", "polled.toml"),
            truth={k: _PLANAR[k] for k in ("ZZR1", "ZZ2", "Fv1")},
        ),
        "rigid3_250hz": replace(
            _SHARP, source=("rigid3_250hz", "rigid3.toml"), levels=("good",), truth=_FRICTION
        ),
        "rigid3_50hz": replace(_SHARP, source=("rigid3_50hz", "rigid3.toml"), truth=_FRICTION),
        "noise_channel6": replace(_SPOILT, source=("noise_channel6", "rigid6.toml"), joints=("j6",)),
        "two_robots_joint3": replace(_SPOILT, source=("two_robots_joint3", "rigid3.toml"), joints=("j3",)),
        "mujoco6": replace(_SMOOTH, source=("mujoco6", "mujoco6.xml")),
    }

    def add(kind: Case, words: str, **given: object) -> None:
        found[words] = replace(kind, source=Recipe(**given))

    for rate, device, size in ((500.0, 338.0, 2), (250.0, 200.0, 3), (1000.0, 700.0, 4)):
        words = f"polled at {rate:g} Hz, new rows at {device:g} Hz"
        add(_POLLED, words, size=size, planar=size == 2, rate=rate, device=device)
    for size, planar in ((2, True), (2, False), (3, False)):
        words = f"2 % repeats, slow, {'planar' if planar else 'spatial'} {size}R"
        add(
            _SLOW,
            words,
            size=size,
            planar=planar,
            width=0.0,
            rate=100.0,
            device=98.0,
            speed=0.1,
            duration=100.0,
        )
    for share, size in ((0.05, 3), (0.14, 2), (0.3, 4)):
        add(_JITTER, f"stamps off by {share:.0%} rms", size=size, jitter=share)
    for size, joint in ((2, 2), (4, 4), (6, 5)):
        add(_REST, f"joint {joint} of {size} at rest, little torque", size=size, resting=joint)
    for words, size, tilt in (
        ("on a wall", 4, (90.0, 0, 1, 0)),
        ("on the ceiling", 3, (180.0, 1, 0, 0)),
        ("tilted by 5 degrees about x", 4, (5.0, 1, 0, 0)),
        ("tilted by 10 degrees about y", 6, (10.0, 0, 1, 0)),
        ("tilted by 20 degrees about x + y", 3, (20.0, 1, 1, 0)),
    ):
        add(_GRAVITY if tilt[0] > 10.0 else _TILT, words, plant="own", size=size, tilt=tilt)
    for what, (size, joint) in product(("noise", "another motion"), ((3, 1), (6, 2), (5, 4))):
        spoilt = replace(_SPOILT, spoilt=(joint, what), joints=(f"j{joint}",))
        add(spoilt, f"torque {joint} of {size} is {what}", size=size)
    for size, period in ((2, 10.0), (3, 6.0), (5, 8.0)):
        words, pace = f"a period of {period:g} s ten times, {size}R", 10.0 / period
        add(_PERIOD, words, size=size, rate=100.0, motion="series", pace=pace, duration=10.0 * period)
    for size, rate in ((3, 250.0), (5, 500.0), (6, 200.0)):
        words = f"friction smooth to 30 mrad/s (MuJoCo), {size}R, {rate:g} Hz"
        add(_SMOOTH, words, plant="mujoco", size=size, rate=rate, width=0.03)
    for size, rate in ((2, 100.0), (4, 250.0), (6, 500.0)):
        words = f"friction tanh(v / 5 mrad/s), {size}R, {rate:g} Hz"
        add(_SHARP, words, plant="own", size=size, rate=rate, width=0.005)
    for size, second in ((3, "payload"), (5, "payload"), (4, "arm")):
        add(_TWO, f"another {second} in the second log, {size}R", plant="own", size=size, second=second)
    return found


def make_case(name: str, case: Case, given: Given, folder: Path) -> tuple[Path, list[Path], Sample | None]:
    """Return robot file, logs, and what they were simulated from."""
    if isinstance(case.source, tuple):
        log, robot = case.source
        cases = given.shared / "cases"
        return cases / "robots" / robot, [unpack(cases / "logs" / f"{log}.csv.gz", folder)], None
    rng = np.random.default_rng([21, given.seed, *name.encode()])
    sample = simulate_recipe(case.source, rng)
    if joint := case.spoilt[0]:
        other = simulate_run(case.source, sample.chain, rng).tau[:, joint - 1]
        change = replace_by_noise(joint, rng) if case.spoilt[1] == "noise" else take_torque(joint, other)
        sample = replace(sample, runs=tuple(map(change, sample.runs)))
    return *sample.write(folder), sample


def run_case(name: str, given: Given, folder: Path) -> dict:
    """Return what is said of a case, the truth beside it, and what is missed."""
    case = list_cases(given)[name]
    robot, logs, sample = make_case(name, case, given, folder)
    result, fit = identify(robot, logs)
    if fit is not None and case.truth is not None:
        truth = case.truth if sample is None else find_truth(symid.load(robot), sample.chain)
        result["truth"] = {k: v for k, v in truth.items() if sample is None or re.match(case.truth, k)}
    if fit is not None and case.held:
        log = unpack(given.shared / "cases" / "logs" / f"{case.held[0]}.csv.gz", folder)
        result["held"] = fit.validate(log).mean_relative_percent
    direction = sample.chain.gravity if case.direction == "tilt" else case.direction
    return result | {"asked": case.asked, "missed": list(list_missed(case, result, direction))}


def list_missed(case: Case, result: dict, direction: tuple[float, ...]) -> Iterator[str]:
    """Yield what is not as it should be."""
    if result["level"] not in case.levels:
        yield f"level {result['level']}"
    if result["level"] in REFUSED:
        return
    if case.family == "" and list_mistakes(result):
        yield "a mistake is named"
    if case.family and not speaks_of(result, case.family, case.joints, warned=case.warned):
        yield f"{' '.join((case.family, *case.joints))} not named"
    warnings = [entry for entry in result["notices"] if not entry[1]]
    if case.silent and speaks_of(result | {"notices": warnings}, case.silent, warned=True):
        yield f"{case.silent} named"
    said = [result["headline"], result["remedy"], *(cause["text"] for cause in result["causes"])]
    said += [text for *_, text in result["notices"]]
    if direction and not any(is_along(text, direction) for text in said):
        yield "direction not stated"
    if case.held and not result.get("held", np.inf) <= case.held[1]:
        yield f"held out {result.get('held', np.nan):.3g} %"
    off = []
    for key, true in result.get("truth", {}).items():
        if key in result["parameters"]:
            value, std = result["parameters"][key]
            z, error = (value - true) / max(std, 1e-300), abs(value - true)
            if (abs(z) > 4.0 and error > 0.003 * abs(true)) or (
                case.share and error > case.share * abs(true)
            ):
                off.append((-abs(z), f"{key} {value:.3g} for {true:.3g} (z {z:.1f})"))
    if off:
        worst = ", ".join(text for _, text in sorted(off)[:3])
        yield f"{len(off)} of {len(result['truth'])} values off: {worst}"


def is_along(text: str, direction: tuple[float, ...]) -> bool:
    """Return whether a text has three numbers in brackets that are within 5 degrees of a direction."""
    number = r"([-+]?\d+\.?\d*(?:e[-+]?\d+)?)"
    for found in re.findall(rf"[(\[]{number}, {number}, {number}[)\]]", text):
        values = np.array(list(map(float, found)))
        size = np.linalg.norm(values) * np.linalg.norm(direction)
        if values @ np.array(direction) > np.cos(np.radians(5.0)) * size > 0.0:
            return True
    return False


# Real recordings.

REAL: dict[str, tuple[str, float]] = {
    "TX40, first 60 % -> last 40 %, 10 Hz": ("tx40", 22.0),
    "KR300, A + B -> C, 10 Hz": ("kr300", 15.5),
    "EMPS, published settings": ("emps-published", 0.0),
    "EMPS -> PULSES, 100 Hz": ("emps", 7.45),
    "double pendulum, 2 + 3 -> 1, 5 Hz": ("pendulum", 29.0),
    "UR10 bag, unit stated": ("ur10", 0.0),
    "Panda bag": ("panda", 0.0),
}
"""What is fitted and foretold, and the percent that may be left: mean over joints of |error| / |torque|."""
PUBLISHED = {
    "M1": (95.1089, 0.1085),
    "Fv1": (203.5034, 1.1460),
    "Fc1": (20.3935, 0.1012),
    "offset1": (-3.1648, 0.0444),
    "residual": (108.7569, 4.0834),
    "pulses": (169.4876, 5.9824),
}


def run_real(name: str, given: Given, folder: Path) -> dict:
    """Return what a real set reaches by the documented metric."""
    key, most = REAL[name]
    robot, logs = find_files(given.shared / "data")[key.split("-")[0]]
    options: dict[str, object] = {}
    if key in {"ur10", "panda"}:
        # Their files have kinematics alone: what a user adds first are rotors and friction.
        robot = folder / f"{key}.toml"
        robot.write_text(read_robot_text(given.shared / "data", key), encoding="utf-8")
        options = {"settings": "bag"} if key == "ur10" else {}
    elif key != "emps":
        options = {"tx40": {"train": "0:60%"}, "emps-published": {"settings": "published"}}.get(key, {})
    fitted = {"kr300": logs[:2], "pendulum": logs[1:3]}.get(key, logs[:1])
    result, fit = identify(robot, fitted, **options)
    missed = [f"exit code {result['exit']}"] * bool(result["exit"])
    missed += [f"names: {text}" for text in list_mistakes(result)]
    asked, reached = "exit 0, no mistake named", ""
    held, band, test = {
        "tx40": (logs[0], 10.0, "60%:"),
        "kr300": (logs[-1], 10.0, None),
        "emps": (logs[-1], 100.0, None),
        "pendulum": (logs[0], 5.0, None),
    }.get(key, (None, None, None))
    if held is not None and fit is not None:
        left = fit.validate(held, test=test, band=band).residual
        percent = float(np.mean([entry.relative_percent for entry in left]))
        sizes = [(entry.norm, 100.0 * entry.norm / entry.relative_percent) for entry in left]
        stacked = 100.0 * np.divide(*np.linalg.norm(sizes, axis=0))
        asked += f", at most {most:g} %"
        reached = f"{percent:.2f} % (joints stacked {stacked:.2f} %), {result['level']}"
        # Of the pendulum's joints one hardly needs a torque: they are published as one vector.
        percent = stacked if key == "pendulum" else percent
        missed += [f"{percent:.2f} %"] * bool(percent > most)
    if key == "emps-published" and fit is not None:
        (own,), (pulses,) = fit.residual, fit.validate(logs[1], **options).residual
        found = {k: (fit[k].value, fit[k].std) for k in fit}
        found |= {
            "residual": (own.norm, own.relative_percent),
            "pulses": (pulses.norm, pulses.relative_percent),
        }
        found = {k: tuple(round(x, 4) for x in pair) for k, pair in found.items()}
        asked, reached = "the published digits", str(found)
        missed += [f"{k} {found.get(k)}" for k, pair in PUBLISHED.items() if found.get(k) != pair]
    return result | {"asked": asked, "reached": reached, "missed": missed}


# Clean logs.


@cache
def list_clean(given: Given) -> dict[str, Recipe | tuple]:
    """Return clean logs by name: twenty of the plants, twenty real ones."""
    return draw_recipes(given.seed) | STRETCHES


@cache
def make_clean(name: str, given: Given) -> Sample:
    """Return a clean log by its name."""
    source = list_clean(given)[name]
    if isinstance(source, Recipe):
        return simulate_recipe(source, np.random.default_rng([12, given.seed, *name.encode()]))
    return take_stretch(given.shared / "data", *source)


def run_clean(name: str, given: Given, folder: Path) -> dict:
    """Return what is said of a clean log; bags are read as they are."""
    bags = {"UR10 bag": "UR10 bag, unit stated", "Panda bag": "Panda bag"}
    if name in bags:
        return run_real(bags[name], given, folder)
    sample = make_clean(name, given)
    robot, logs = sample.write(folder)
    result, fit = identify(robot, logs)
    if sample.chain is not None and fit is not None:
        result["truth"] = find_truth(symid.load(robot), sample.chain)
    return result


def show_clean(results: list[dict]) -> None:
    """Print a line a log, and the gates."""
    rows = [
        (r["name"], summarise(r), show_scores(r), "; ".join(list_mistakes(r)), f"{r['seconds']:.1f}")
        for r in results
    ]
    print_table(("log", "reached", "95 % intervals hold, largest z", "mistakes named", "s"), rows)
    wrong = [r["name"] for r in results if r["exit"]]
    named = [r["name"] for r in results if list_mistakes(r)]
    fine = sum(r["level"] in FINE for r in results)
    print_gate("none wrong or refused", wrong or "none", met=not wrong)
    print_gate("no mistake named", named or "none", met=not named)
    print_gate("three quarters good or usable", f"{fine} of {len(results)}", met=4 * fine >= 3 * len(results))


# Corrupted logs.


@cache
def list_corrupted(given: Given) -> dict[str, str]:
    """Return the base of every corruption by name; what it is turns out when its base is made."""
    rng, found = np.random.default_rng([31, given.seed]), {}
    listed = given.count or 100
    for number in range(listed + round(0.4 * listed)):
        base = str(rng.choice(list(list_clean(given))))
        found[f"{number:03d} {'listed' if number < listed else 'other'}: {base}"] = base
    return found


def run_corrupted(name: str, given: Given, folder: Path) -> dict:
    """Return what is said of a corrupted log, what of the clean one, and what the logs show by other fits."""
    base, listed = list_corrupted(given)[name], "listed" in name
    recipe, clean = list_clean(given)[base], make_clean(base, given)
    rng, found = np.random.default_rng([32, given.seed, int(name[:3])]), None

    def draw_log():
        return simulate_run(recipe, clean.chain, np.random.default_rng([33, given.seed, int(name[:3])]))

    while found is None:
        found = corrupt(base, clean, draw_log, rng) if listed else corrupt_otherwise(base, clean, rng)
    result, _ = identify(*found.wrong.write(folder / "wrong"))
    before, _ = identify(*found.clean.write(folder / "clean"))
    more = asdict(look(found)) if listed else {}
    joints = [before["joints"][joint - 1] for joint in found.joints]
    return result | more | {"what": found.name, "family": found.family, "touched": joints, "before": before}


def judge_corrupted(r: dict) -> str:
    """Return "right", "set" or "false" for what is named, else "lower", "warned" or "SILENT"."""
    before = {tuple(entry) for entry in r["before"]["notices"]}
    new = r | {"notices": [entry for entry in r["notices"] if tuple(entry) not in before]}
    mistakes = list_mistakes(r)
    if r["family"] and speaks_of(r, r["family"], r["touched"]):
        return "set" if len(r["causes"]) > 1 else "right"
    if r["family"] in DATA and not mistakes and speaks_of(new, r["family"], r["touched"], warned=True):
        return "right"
    if mistakes:
        return "false"
    rank = {level: number for number, level in enumerate(LEVELS)}
    if rank.get(r["level"], 0) < rank.get(r["before"]["level"], 0):
        return "lower"
    codes = {code for code, note, _ in r["before"]["notices"] if not note}
    return "warned" if any(not note and code not in codes for code, note, _ in r["notices"]) else "SILENT"


def show_corrupted(results: list[dict]) -> None:
    """Print a line a log, and the gates."""
    rows, told, named, other = [], Counter(), Counter(), Counter()
    for r in results:
        outcome, seen, falls = judge_corrupted(r), "", ""
        if r["family"]:
            visible = r["touched_falls"] >= 2.0 and r["pooled_falls"] >= 1.5
            unique = r["ratio"] >= 2.0
            seen = ("visible" if visible else "hidden") + (", unique" if unique else f", or {r['rival']}")
            sizes = (min(r[key], 9999.0) for key in ("touched_falls", "pooled_falls", "ratio"))
            falls = f"{r['clean']:.3g}, {r['wrong']:.3g}; " + ", ".join(f"{size:.3g}" for size in sizes)
            named[outcome] += 1
            told[outcome] += visible and unique
        else:
            other[outcome] += 1
        rows.append((r["name"][:4] + r["what"], seen, falls, r["before"]["level"], outcome, summarise(r)))
    heads = ("log", "shown by other fits", "left, %: clean, wrong; touched, pooled, rival: times")
    print_table((*heads, "clean", "came out", "reached"), rows)
    whole, names = sum(told.values()), named["right"] + named["false"]
    print(f"{whole} of {named.total()} mistakes are visible and unique: {dict(told)}; faults: {dict(other)}")
    print_gate("80 % of these named", f"{told['right']} of {whole}", met=told["right"] >= 0.8 * whole)
    print_gate("95 % of all names right", f"{named['right']} of {names}", met=named["right"] >= 0.95 * names)
    print_gate("5 % of these silent", f"{told['SILENT']} of {whole}", met=told["SILENT"] <= 0.05 * whole)
    print_gate("one fault named as a mistake", other["false"], met=other["false"] <= 1)


# Alarm rates of the statistics.

NOMINAL = (0.01, 0.05, 0.1, 0.3)
DRAWS = 20
"""Of a task."""
ALARMS = (
    "compare, equal models",
    "compare, noise more",
    "compare, friction more",
    "agree, halves",
    "agree, slow rows",
)
_FOLDS, _PARTS = 6, 24


def draw_regression(rng: np.random.Generator, size: int, *, coloured: bool) -> tuple[np.ndarray, ...]:
    """Return columns (T, n, p) of rigid parameters and friction, torques and velocities (T, n).

    The law is exact, the log 40 s at 25 Hz, the noise of the torques 2 % of their rms, white or with a memory
    of 0.1 s.
    """
    chain = draw_chain(rng, size, planar=False, width=0.0)
    q, dq, ddq = draw_motion(rng, size, 40.0)(np.arange(1000) / 25.0)
    plant = build_plant(chain, chain.list_friction(), gravity=np.array(chain.gravity))
    rigid = compute_rigid_regressor(plant, q, dq, ddq).reshape(q.size, -1)
    basis = np.linalg.svd(rigid / np.maximum(np.linalg.norm(rigid, axis=0), 1e-12), full_matrices=False)
    rigid = basis.U[:, 1e-8 * basis.S[0] < basis.S] * np.sqrt(q.size)
    friction = np.zeros((*q.shape, 2, size))
    each = np.arange(size)
    friction[:, each, 0, each], friction[:, each, 1, each] = dq, np.sign(dq)
    columns = np.hstack([rigid, friction.reshape(q.size, -1)]).reshape(*q.shape, -1)
    tau = chain.compute_torques(q, dq, ddq) + chain.compute_friction(dq)
    noise = rng.standard_normal(tau.shape)
    keep = np.exp(-1.0 / 25.0 / 0.1) if coloured else 0.0
    for row in range(1, len(noise)):
        noise[row] = keep * noise[row - 1] + np.sqrt(1.0 - keep**2) * noise[row]
    return columns, tau + 0.02 * np.sqrt(np.mean(tau**2, axis=0)) * noise, dq


def draw_p(test: str, rng: np.random.Generator) -> float:
    """Return the p of one draw in which nothing is to be found.

    Of `compare` each model has a column of noise, or the second alone has one, or a term of friction at every
    joint, which is zero in truth. Of `agree` the estimates are those of both halves, or of all rows and of
    those that are not slow, in the torque of one joint.
    """
    joints = int(rng.integers(2, 6))
    columns, tau, dq = draw_regression(rng, joints, coloured=bool(rng.uniform() < 0.5))
    part = np.arange(len(tau)) * _PARTS // len(tau)
    fold = np.arange(_PARTS) * _FOLDS // _PARTS
    motion = regression.ThinMotion(
        **dict.fromkeys(("q", "ddq"), np.zeros_like(tau)),
        dq=dq,
        tau=tau,
        kept=np.ones(tau.shape, dtype=bool),
        block=part,
        run=np.zeros(len(tau), dtype=np.intp),
        period=1.0 / 25.0,
    )
    plain = [0] * joints
    if test.startswith("compare"):
        more = [rng.standard_normal((*tau.shape, 1)) for _ in range(2)]
        if "friction" in test:
            more[1] = (np.sign(dq) * np.exp(-((dq / 0.1) ** 2)))[:, :, None] * np.eye(joints)
        wider = [np.concatenate([columns, added], axis=2) for added in more]
        losses = []
        for model in (wider[0] if "equal" in test else columns, wider[1]):
            sums = regression.sum_motion(model, motion, _PARTS)
            values = regression.fit_sums(sums, plain, fold).folds[fold]
            losses.append(regression.measure_left(sums, values)[:, :, 0].T / np.sum(tau**2, axis=0))
        return float(judge.compare(*losses).p_of_all)
    sums = regression.sum_motion(columns, motion, _PARTS)
    whole = regression.fit_sums(sums, plain, fold)
    if "halves" in test:
        halves = [fold < _FOLDS // 2, fold >= _FOLDS // 2]
        one, other = (regression.fit_sums(sums, plain, fold, half, whole.weights) for half in halves)
    else:
        kept = np.abs(dq) > 0.05 * np.abs(dq).max(axis=0)
        fast = regression.sum_motion(columns, replace(motion, kept=kept), _PARTS)
        one, other = whole, regression.fit_sums(fast, plain, fold, None, whole.weights)
    grams = np.einsum("tjk,tjl->jkl", columns, columns, optimize=True)
    found = judge.agree(one.values - other.values, one.changes - other.changes, grams, np.sum(tau**2, axis=0))
    return float(found[int(rng.integers(joints))].p)


def list_alarms(given: Given) -> list[str]:
    """Return tests and numbers of tasks of DRAWS draws."""
    return [
        f"{test} [{number}]" for test, number in product(ALARMS, range(max(1, (given.count or 200) // DRAWS)))
    ]


def run_alarms(name: str, given: Given, _: Path) -> dict:
    """Return p-values where nothing is to be found."""
    test, number = name[:-1].split(" [")
    draws = range(min(DRAWS, given.count or DRAWS))
    rngs = (np.random.default_rng([41, given.seed, ALARMS.index(test), int(number), k]) for k in draws)
    return {"test": test, "p": [draw_p(test, rng) for rng in rngs]}


def show_alarms(results: list[dict]) -> None:
    """Print rates of alarm beside nominal levels; a column more may alarm less often than that."""
    rows, odd = [], []
    for test in dict.fromkeys(r["test"] for r in results):
        p = np.array([value for r in results if r["test"] == test for value in r["p"]])
        cells = []
        for level in NOMINAL:
            count, side = int(np.sum(p < level)), "greater" if "more" in test else "two-sided"
            chance = binomtest(count, len(p), level, alternative=side).pvalue
            cells.append(f"{100.0 * count / len(p):.1f} % ({chance:.2g})")
            odd += [f"{test} at {level:.0%}"] * int(chance < 0.001)
        rows.append((test, len(p), *cells, f"{kstest(p, 'uniform').pvalue:.2g}"))
    print_table(("test", "draws", *(f"{level:.0%} (p)" for level in NOMINAL), "Kolmogorov p"), rows)
    print_gate("no rate differs from its nominal one (p 0.001)", odd or "none", met=not odd)


# Coverage.

COVERED: dict[str, Recipe | tuple[str, str]] = {
    "rigid3, 250 Hz": Recipe(plant="own", arm="rigid3", motion="fast", speed=4.5, duration=20.0),
    "rigid3, 50 Hz": Recipe(
        plant="own", arm="rigid3", motion="fast", speed=4.5, duration=20.0, rate=50.0, early=True
    ),
    "spatial 4R, 200 Hz": Recipe(plant="own", size=4, duration=20.0, rate=200.0),
    "spatial 4R, 50 Hz": Recipe(plant="own", size=4, duration=20.0, rate=50.0, early=True),
    "rigid3, Stribeck": Recipe(
        plant="own", arm="rigid3", motion="fast", speed=4.5, duration=20.0, excess=0.4
    ),
    "spatial 3R, Stribeck": Recipe(plant="own", duration=20.0, excess=0.4),
    **{f"{arm}, {case}": (arm, case) for arm, case in product(ARMS, CASES)},
}
"""Plants by name, or arm and case of `simulated_arms.py`; robot files state Coulomb and viscous friction."""
USUAL = ("rigid3, 250 Hz", "rigid3, 50 Hz", "spatial 4R, 200 Hz", "spatial 4R, 50 Hz", "panda, white")
USUAL += ("rigid3, Stribeck",)


def list_coverage(given: Given) -> list[str]:
    """Return plants and numbers of draws; gates are those of the usual plants."""
    return [f"{plant} [{number}]" for plant in COVERED for number in range(given.count or 100)]


def run_coverage(name: str, given: Given, folder: Path) -> dict:
    """Return what one draw gives, the truth beside it."""
    plant, number = name[:-1].split(" [")
    source = COVERED[plant]
    if isinstance(source, Recipe):
        chain = build_chain(source, np.random.default_rng([51, given.seed]))
        run = simulate_run(source, chain, np.random.default_rng([52, given.seed, int(number)]))
        robot, logs = build_sample(source, chain, [run]).write(folder)
        truth = find_truth(symid.load(robot), chain)
    else:
        arm = ARMS[source[0]]
        robot = write_arm_file(arm, folder)
        logs = [simulate(arm, CASES[source[1]], int(number)).write(folder / "log.npz")]
        truth = find_arm_truth(source[0], robot)
    result, _ = identify(robot, logs)
    return result | {"plant": plant, "truth": truth, "notices": []}


def show_coverage(results: list[dict]) -> None:
    """Print a line a plant, and the gates."""
    rows, gates = [], []
    for plant in dict.fromkeys(r["plant"] for r in results):
        part = [r for r in results if r["plant"] == plant]
        keys = [key for key in part[0]["truth"] if any(key in r["parameters"] for r in part)]
        hits, ratios = {}, {}
        for key in keys:
            pairs = [(*r["parameters"][key], r["truth"][key]) for r in part if key in r["parameters"]]
            value, std, true = np.array(pairs).T
            hits[key] = np.abs(value - true) <= QUANTILE * std
            ratios[key] = 100.0 * (np.mean(value) / true[0] - 1.0) if key[:2] == "Fc" else 0.0
        if not hits:
            rows.append((plant, len(part), *[""] * 4, Counter(r["level"] for r in part), "", ""))
            continue
        shares = {key: 100.0 * float(np.mean(entry)) for key, entry in hits.items()}
        pooled = 100.0 * float(np.mean(np.concatenate(list(hits.values()))))
        friction = 100.0 * float(np.mean(np.concatenate([hits[key] for key in keys if key[0] == "F"])))
        least, most = min(shares, key=shares.get), max(ratios, key=lambda key: abs(ratios[key]))
        levels = Counter(r["level"] for r in part)
        fine = sum(levels[level] for level in FINE)
        bold = sum(r["level"] == "good" and bool(np.any(np.abs(measure_scores(r)) > 4.0)) for r in part)
        cells = (
            f"{pooled:.1f}",
            f"{friction:.1f}",
            f"{shares[least]:.0f} {least}",
            f"{ratios[most]:+.2f} {most}",
        )
        seconds = f"{np.mean([r['seconds'] for r in part]):.1f}"
        rows.append(
            (plant, len(part), *cells, ", ".join(f"{n} {k}" for k, n in levels.items()), bold, seconds)
        )
        if plant not in USUAL:
            continue
        slow = plant.endswith(" 50 Hz")
        gates += [
            (
                plant,
                "pooled 85 % or more" if slow else "pooled 92 to 98 %",
                cells[0],
                pooled >= 85 if slow else 92 <= pooled <= 98,
            ),
            (plant, f"friction {88 if slow else 90} % or more", cells[1], friction >= (88 if slow else 90)),
            (plant, "each parameter 80 % or more", cells[2], slow or shares[least] >= 80),
            (plant, "bias of Fc 1 % or less", cells[3], slow or abs(ratios[most]) <= 1.0),
            (plant, "good or usable 95 % or more", f"{fine} of {len(part)}", fine >= 0.95 * len(part)),
            (plant, "good with any |z| > 4 in 5 % or less", bold, bold <= 0.05 * len(part)),
        ]
    heads = (
        "plant",
        "fits",
        "pooled, %",
        "friction, %",
        "least, %",
        "bias of Fc, %",
        "verdicts",
        "good, |z| > 4",
        "s",
    )
    print_table(heads, rows)
    for plant, asked, reached, met in gates:
        print_gate(f"{plant}: {asked}", reached, met=met)


# Lengths and scoring bands.

BASES: dict[str, Recipe | str] = {
    "planar 2R": Recipe(size=2, planar=True, rate=100.0),
    "spatial 4R": Recipe(size=4, rate=100.0),
    "spatial 6R": Recipe(size=6, rate=100.0),
    "TX40": "tx40",
    "KR300 A": "kr300",
    "pendulum 1": "pendulum",
    "EMPS": "emps",
}


def list_lengths(_: Given) -> list[str]:
    """Return pairs of what is compared: a motion and a longer one, a scoring band and another one."""
    found = []
    for base, source in BASES.items():
        longest = "100 %"
        if isinstance(source, Recipe):
            longest = "60 s"
            found += [f"{base}, {pair}" for pair in ("10 s, 60 s", "60 s, 3600 s")]
        found += [f"{base}, {longest}, band times {factor}" for factor in (0.5, 2)]
    return found


def study_length(base: str, length: str, factor: float, given: Given, folder: Path) -> tuple[dict, Study]:
    """Return what identification says of a motion of some length, and what it condensed and fitted.

    The scoring band is multiplied by `factor`.
    """
    source, size = BASES[base], float(length.partition(" ")[0])
    if isinstance(source, Recipe):
        sample = simulate_recipe(replace(source, duration=size), np.random.default_rng([61, given.seed]))
    else:
        sample = take_stretch(given.shared / "data", source, 0, 0.0, size / 100.0)
    folder.mkdir()
    robot, logs = sample.write(folder)
    measure, collect, studies = (
        settings_choice.measure_scoring_band,
        rigid_fit.collect_evidence,
        list[Study](),
    )

    def keep(library: Library, study: Study, *given: Any, **more: Any) -> Any:
        studies.append(study)
        return collect(library, study, *given, **more)

    with (
        patch.object(settings_choice, "measure_scoring_band", lambda logs: factor * measure(logs)),
        patch.object(rigid_fit, "collect_evidence", keep),
    ):
        result, fit = identify(robot, logs)
    if fit is not None and sample.chain is not None:
        result["truth"] = find_truth(symid.load(robot), sample.chain)
    return result, studies[-1]


def run_lengths(name: str, given: Given, folder: Path) -> dict:
    """Return what two identifications say of each other, in the torques of the longer log."""
    base, length, other = name.split(", ")
    factor = float(other.removeprefix("band times ")) if other.startswith("band") else 1.0
    result, one = study_length(base, length, 1.0, given, folder / "one")
    more, two = study_length(base, length if factor != 1.0 else other, factor, given, folder / "two")
    logs = one.logs if factor != 1.0 else two.logs
    if factor == 1.0:
        changes = np.vstack([one.fit.changes, -two.fit.changes])
    elif len(one.fit.changes) == len(two.fit.changes):
        changes = one.fit.changes - two.fit.changes
    else:
        changes = judge.compute_changes(one.fit.folds - two.fit.folds)
    moving = logs.torque > 0.0
    told = judge.agree(
        one.fit.values - two.fit.values, changes, logs.list_grams()[moving], logs.torque[moving]
    )
    chances = judge.adjust_chances([entry.p for entry in told])
    sure = [replace(entry, p=p).verdict for entry, p in zip(told, chances, strict=True)]
    differs, same = (judge.Agreement.DIFFERENT in sure), {*sure} == {judge.Agreement.SAME}
    return result | {
        "more": more,
        "told": (
            judge.Agreement.DIFFERENT if differs else judge.Agreement.SAME if same else judge.Agreement.OPEN
        ).value,
        "size": 100.0 * max(entry.size for entry in told),
        "bound": 100.0 * max(entry.bound for entry in told),
    }


def show_lengths(results: list[dict]) -> None:
    """Print a line a pair, and the gates."""
    rows = [
        (
            r["name"],
            *(f"{summarise(part)}, {part.get('scoring') or 0:.3g} Hz" for part in (r, r["more"])),
            f"{r['size']:.2g}, at most {r['bound']:.2g}",
            r["told"],
        )
        for r in results
    ]
    print_table(("compared", "first", "second", "differ in a joint's torque by, %", "say"), rows)
    told = Counter(r["told"] for r in results)
    print_gate(
        "17 of 20 the same", f"{told['same']} of {len(results)}", met=told["same"] >= 0.85 * len(results)
    )
    print_gate("one different at most", told["different"], met=told["different"] <= 1)


# Calls.

PARTS: dict[str, tuple[Callable, Callable, Callable]] = {
    "cases": (list_cases, run_case, show_missed),
    "real": (lambda _: REAL, run_real, show_missed),
    "clean": (list_clean, run_clean, show_clean),
    "corrupted": (list_corrupted, run_corrupted, show_corrupted),
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


def read_arguments() -> argparse.Namespace:
    """Return the arguments of the call."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=tuple(PARTS), nargs="?", default="cases")
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
    """Fit, store and print, or only one of these."""
    told = read_arguments()
    if told.verify:
        print(json.dumps(verify_plants(told.seed), indent=1))
        return
    given = Given(shared=told.shared.resolve(), seed=told.seed, count=told.count)
    make_names, _, show = PARTS[told.part]
    names = [name for name in make_names(given) if told.only in name]
    if told.list:
        print("\n".join(names))
        return
    path = told.output / f"{told.part}.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    stored = {entry["name"]: entry for entry in map(json.loads, lines)}
    if not told.tables:
        path.parent.mkdir(parents=True, exist_ok=True)
        wanted = [name for name in names if not (told.resume and name in stored)]
        with path.open("a", encoding="utf-8") as file:
            for count, result in enumerate(run_all(told.part, wanted, given, told.processes), 1):
                stored[result["name"]] = result
                print(json.dumps(result), file=file, flush=True)
                print(f"\r{count}/{len(wanted)}", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
    show([stored[name] for name in names if name in stored])


if __name__ == "__main__":
    main()
