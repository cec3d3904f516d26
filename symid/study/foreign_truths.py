"""Identification of elastic joints on truths that are not those of symid, and how honest its results are.

Arm, truths, sizes, seeds -> `ForeignStudy`: every method and the automatic choice, on logs of the plant.

    worst   largest |estimate - truth| of beta and IA, in percent of the largest true value of its kind
            (inertias, first moments, rotor) on its link
    z       (estimate - truth) / stated deviation of the same parameters, rms and largest |z|
    spring  rms(torque of the identified spring at the true torsion, less tau_J) / rms(tau_J) along TC,
            percent, of the worse joint; its memory starts from rest

Logs: ten times TA, and TB of each joint (Zhang et al. 2023), 1 kHz, torque noise of 2 % of each joint's rms,
encoders of 20 bits. The identification gets a robot file as users write it, with nothing of the truth.

Not supported: robots other than the two arms of this file; a score of friction, which has other parameters.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import ModelCard, prepare_library
from symid.errors import Notice, SymidError, UsageError
from symid.identification import IdentifyOptions, TaskContext, prepare_elastic_methods
from symid.identification.elastic import AUTOMATIC_METHODS, ElasticEstimate
from symid.joint_models import run_element
from symid.logs import Recording
from symid.robot import Robot, parse_robot
from symid.serialization import HIDDEN, name_key, write_as
from symid.study.elastic_methods import fit_independent
from symid.study.foreign_plant import (
    ENCODER_STEP,
    PERIOD,
    Arm,
    ForeignMotion,
    HiddenJoints,
    HiddenRun,
    simulate_plant_runs,
)
from symid.study.monte_carlo import Spread, compute_spread, count_words, run_tasks

ARMS = {
    "2r": Arm(
        name="foreign_2r",
        turn=np.zeros(2),
        shift=np.array([0.0, 0.4]),
        mass=np.array([7.0, 4.0]),
        centre=np.array([0.2, 0.2]),
        inertia=np.array([[0.01, 0.24, 0.24], [0.01, 0.19, 0.19]]),
        rotor=np.array([0.8, 0.25]),
        viscous=np.array([6.0, 3.0]),
        coulomb=np.array([5.0, 2.5]),
        stiffness=np.array([6700.0, 2900.0]),
    ),
    "3r": Arm(
        name="foreign_3r",
        turn=np.array([0.0, 0.5 * math.pi, -0.5 * math.pi]),
        shift=np.array([0.0, 0.3, 0.3]),
        mass=np.array([6.0, 4.0, 2.5]),
        centre=np.array([0.15, 0.15, 0.15]),
        inertia=np.array([[0.02, 0.12, 0.12], [0.01, 0.08, 0.08], [0.005, 0.05, 0.05]]),
        rotor=np.array([0.8, 0.5, 0.2]),
        viscous=np.array([6.0, 4.0, 2.0]),
        coulomb=np.array([5.0, 3.5, 1.5]),
        stiffness=np.array([6700.0, 4500.0, 1800.0]),
    ),
}
"""A planar arm, and one whose axes cross; both hang along gravity at q = 0."""
_TOGETHER = ("asymmetric-bouc-wen", "viscoelastic", "lugre", "ripple", "delays", "eccentricity")
_TIMES = {"TA": 20.0, "TB": 50.0, "TC": 20.0}
_SINES = 2.0 * math.pi * np.array([[1.0, 0.5, 0.2], [0.2, 1.0, 0.5], [0.5, 0.2, 1.0]])
_PHASES = math.pi * np.array([[0.0, 1 / 6, 1 / 4], [0.0, 1 / 5, 1 / 2], [0.0, 1 / 3, 1 / 7]])
_NUDGE = 1e-3
_WAITING = 0.5
"""rad, of joints that TB does not move."""
AUTOMATIC = "automatic"
FOREIGN_METHODS = (*AUTOMATIC_METHODS, "simultaneous", "independent")
_NEAR = 1.2


def write_arm(arm: Arm, *, truth: bool = False) -> Robot:
    """Return the robot as a user writes it, or with the values of its links and rotors where `truth`."""
    lines = [f'name = "{arm.name}"', 'convention = "modified"', f"gravity = [{arm.gravity}, 0, 0]"]
    for k in range(arm.size):
        turn = {-1: "-pi/2", 0: "0 deg", 1: "pi/2"}[round(2.0 * arm.turn[k] / math.pi)]
        lines += ["[[joint]]", f'name = "joint{k + 1}"', 'kind = "revolute"']
        lines += [f'alpha = "{turn}"', f"a = {arm.shift[k]}"]
        if truth:
            xx, yy, zz = arm.inertia[k]
            lines += ["[joint.link]", f"mass = {arm.mass[k]}", f"com = [{arm.centre[k]}, 0, 0]"]
            lines += [f"inertia = {{ xx = {xx}, yy = {yy}, zz = {zz} }}"]
        rotor = arm.rotor[k] if truth else '"unknown"'
        lines += ["[joint.drive]", f"rotor_inertia = {rotor}", 'rotor_inertia_side = "joint"']
        lines += ["[joint.friction]", 'model = "coulomb-viscous"', "smoothing = 0.01"]
        lines += ["[joint.elasticity]", 'stiffness = "unknown"']
    return parse_robot("\n".join(lines), f"{arm.name}.toml")


def _build_family(arm: Arm, share: float = 0.4) -> dict[str, FloatArray]:
    """Return the values of stops and knees, `share` of the stiffness in the stops, and plain friction."""
    zero, one = np.zeros(arm.size), np.ones(arm.size)
    return dict.fromkeys(HiddenJoints.__dataclass_fields__, zero) | {
        "linear": (1.0 - share) * arm.stiffness,
        "stops": np.outer(arm.stiffness, share * np.array([0.4, 0.35, 0.25])),
        "thresholds": np.outer(one, [0.5e-3, 1.2e-3, 2.5e-3]),
        "knee": 4.0 * arm.coulomb,
        "slope": 0.3 * one,
        "slip_speed": one,
        "attraction": np.inf * one,
        "width": one,
        "delay": one,
        "viscous": arm.viscous,
        "coulomb": arm.coulomb,
        "stribeck": one,
        "smoothing": 0.01 * one,
    }


def _build_bouc_wen(arm: Arm, size: float, bias: float = 0.0) -> dict[str, FloatArray]:
    share, one = 0.4 * size / (0.6 + 0.4 * size), np.ones(arm.size)
    return {
        "linear": (1.0 - share) * arm.stiffness,
        "stops": np.zeros((arm.size, 3)),
        "slope": 0.0 * one,
        "hysteretic": share * arm.stiffness,
        "width": 1.5e-3 * one,
        "bias": bias * one,
    }


TRUTHS: Mapping[str, Callable[[Arm, float], dict[str, FloatArray]]] = {
    "family": lambda arm, size: {name: _build_family(arm, 0.4 * size)[name] for name in ("linear", "stops")},
    "bouc-wen": _build_bouc_wen,
    "asymmetric-bouc-wen": lambda arm, size: _build_bouc_wen(arm, size, 0.2),
    "backlash": lambda arm, size: {"gap": np.full(arm.size, 2e-4 * size)},
    "viscoelastic": lambda arm, size: {
        "branch": 0.15 * size * arm.stiffness,
        "delay": np.full(arm.size, 0.02),
    },
    "maxwell-slip": lambda arm, size: {
        "rise": np.full(arm.size, 0.4 * size),
        "slip_speed": np.full(arm.size, 0.01),
        "attraction": np.full(arm.size, 200.0),
        "slope": np.zeros(arm.size),
    },
    "cubic": lambda arm, size: {"cubic": 0.4 * size * arm.stiffness / 8e-3**2, "slope": np.zeros(arm.size)},
    "sided": lambda arm, size: {"sided": 0.35 * size * arm.stiffness, "slope": np.zeros(arm.size)},
    "lugre": lambda arm, size: {
        "static": 0.4 * arm.coulomb,
        "stribeck": np.full(arm.size, 0.1),
        "bristle": arm.coulomb / (1e-3 * size),
        "damping": 0.2 * np.sqrt(arm.coulomb / (1e-3 * size) * arm.rotor),
    },
    "dahl": lambda arm, size: {"bristle": arm.coulomb / (2e-3 * size)},
    "sharp-coulomb": lambda arm, size: {"smoothing": np.full(arm.size, 1e-3 / size)},
    "stribeck": lambda arm, size: {"static": 0.6 * size * arm.coulomb, "stribeck": np.full(arm.size, 0.1)},
    "load-dependent": lambda arm, size: {
        "meshing": np.full(arm.size, 0.1 * size),
        "warm": np.full(arm.size, 0.3 * size),
    },
    "ripple": lambda arm, size: {
        "ripple": 0.1 * size * arm.coulomb,
        "kinematic": np.full(arm.size, 1e-4 * size),
    },
    "eccentricity": lambda arm, size: {"eccentricity": np.full(arm.size, 5e-4 * size)},
    "delays": lambda arm, size: {
        "lag": np.full(arm.size, 1e-3 * size),
        "encoder_lag": np.full(arm.size, 0.5e-3 * size),
    },
    "all-together": lambda arm, size: {
        name: value for truth in _TOGETHER for name, value in TRUTHS[truth](arm, size).items()
    },
}
"""What differs from stops and knees with plain friction, by the size of the difference."""


def build_truth(arm: Arm, truth: str, size: float = 1.0) -> HiddenJoints:
    """Return the hidden models of a truth; `size` multiplies what is foreign in it."""
    return HiddenJoints(**(_build_family(arm) | TRUTHS[truth](arm, size)))


def build_motions(size: int, share: float = 1.0) -> tuple[ForeignMotion, ...]:
    """Return ten times TA, TB of each joint, and TC, for `size` joints; `share` of their 20, 50 and 20 s.

    TA and TB are those of Zhang et al. (2023), with a row of our own for a third joint; there the joints that
    TB does not move wait at 0.5 rad, so that gravity loads all. All begin at rest at q = 0, by a ramp of 2 s.
    Derivatives are central differences over 1 ms: the motors have to follow, not the reference.
    """
    found = []
    for name in ("TA", *(f"TB{k + 1}" for k in range(size)), "TC"):
        time = PERIOD * np.arange(round(_TIMES[name[:2]] * share / PERIOD), dtype=np.float64)
        before, here, after = (_write_motion(name, size, time + nudge) for nudge in (-_NUDGE, 0.0, _NUDGE))
        speed, acceleration = (after - before) / (2.0 * _NUDGE), (after - 2.0 * here + before) / _NUDGE**2
        found.append(ForeignMotion(name=name, time=time, q=here, dq=speed, ddq=acceleration))
    return tuple(found)


def _write_motion(name: str, size: int, time: FloatArray) -> FloatArray:
    t, joint = time[:, None, None], np.arange(size)
    if name == "TA":
        q = (math.pi / 6.0) * np.sin(_SINES[:size] * t + _PHASES[:size]).sum(axis=2)
    elif name == "TC":
        angle = 2.0 * math.pi * np.array([0.15, 0.45, 0.9]) * t + joint[:, None] + np.arange(3)
        q = 0.4 * np.sin(angle) @ np.array([1.0, 0.5, 0.25])
    else:
        wave = 0.5 * math.pi * (1.0 - 0.02 * time) * np.sin(0.2 * math.pi * time - 1.5 * math.pi)
        q = np.where(joint == int(name[2:]) - 1, wave[:, None], _WAITING if size > 2 else 0.0)
    s = np.clip(time / 2.0, 0.0, 1.0)
    return np.asarray((s**3 * (10.0 - 15.0 * s + 6.0 * s * s))[:, None] * q)


def observe_plant(
    run: HiddenRun, hidden: HiddenJoints, rng: np.random.Generator, *, source: str = ""
) -> Recording:
    """Return the log of a run: encoders of 20 bits, that of the link with its faults, 2 % torque noise."""
    late = [
        np.interp(run.time - lag, run.time, q) for lag, q in zip(hidden.encoder_lag, run.q.T, strict=True)
    ]
    q = np.stack(late, axis=1)
    q = q + hidden.eccentricity * np.sin(q)
    noise = 0.02 * np.sqrt(np.mean(run.command**2, axis=0)) * rng.standard_normal(q.shape)
    return Recording(
        time=run.time,
        position=np.round(q / ENCODER_STEP) * ENCODER_STEP,
        motor_position=np.round(run.theta / ENCODER_STEP) * ENCODER_STEP,
        torque=run.command + noise,
        source=source,
    )


class Judged(Protocol):
    """A verdict, whose `level` is "good", "usable", "doubtful" or "wrong"."""

    @property
    def level(self) -> str: ...  # noqa: D102


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Scene:
    """What all seeds of a truth share: the robot of the user, true values and their sizes by name, runs."""

    robot: Robot
    values: Mapping[str, tuple[float, float]]
    hidden: HiddenJoints
    names: tuple[str, ...]
    runs: tuple[HiddenRun, ...]


@lru_cache(maxsize=1)
def _prepare_scene(arm_name: str, truth: str, size: float, share: float) -> _Scene:
    arm = ARMS[arm_name]
    hidden, motions = build_truth(arm, truth, size), build_motions(arm.size, share)
    return _Scene(
        robot=write_arm(arm),
        values=list_true_values(prepare_library(write_arm(arm, truth=True)).card),
        hidden=hidden,
        names=tuple(motion.name for motion in motions),
        runs=simulate_plant_runs(arm, [hidden] * len(motions), motions),
    )


def list_true_values(card: ModelCard) -> dict[str, tuple[float, float]]:
    """Return the true value of beta and IA by name, and the largest of its kind on its link."""
    entries = [(entry, True) for entry in card.beta] + [(entry, False) for entry in card.rotors]
    kinds = {entry.name: (entry.joint, entry.unit, link) for entry, link in entries}
    values = {entry.name: float(entry.value or 0.0) for entry, _ in entries}
    return {
        name: (value, max(abs(values[other]) for other in values if kinds[other] == kinds[name]))
        for name, value in values.items()
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeignRun:
    """One method on the logs of one seed; nan and "refused" where it gave nothing.

    Errors are those of the module's equations, `chosen` is the method that the automatic choice took.
    """

    method: str
    worst: float
    spring: float
    z_rms: float
    z_most: float
    verdict: str
    chosen: str = ""


def _score(scene: _Scene, method: str, estimate: ElasticEstimate, verdict: Judged) -> ForeignRun:
    found = {entry.name: entry for entry in estimate.parameters}
    errors = {name: found[name].value - value for name, (value, _) in scene.values.items()}
    z = [error / found[name].std for name, error in errors.items() if 0.0 < found[name].std < math.inf]
    held, parts = scene.runs[-1], []
    for joint, spring in enumerate(estimate.springs):
        torque = run_element(spring.elasticity, held.torsion[:, joint], held.time).output
        true = held.joint_torque[:, joint]
        parts.append(float(np.linalg.norm(torque - true) / np.linalg.norm(true)))
    return ForeignRun(
        method=method,
        worst=100.0 * max(abs(error) / scene.values[name][1] for name, error in errors.items()),
        spring=100.0 * max(parts, default=math.nan),
        z_rms=float(np.sqrt(np.mean(np.square(z)))) if z else math.nan,
        z_most=max(map(abs, z), default=math.nan),
        verdict=verdict.level,
        chosen=estimate.method if method == AUTOMATIC else "",
    )


_Task = tuple[str, str, float, float, int, tuple[str, ...], Callable[[ElasticEstimate], Judged]]


def _run_task(task: _Task) -> tuple[ForeignRun, ...]:
    """Return the automatic choice and all methods on the logs of one seed."""
    arm, truth, size, share, seed, methods, judge = task
    scene = _prepare_scene(arm, truth, size, share)
    context = TaskContext(prepare=prepare_library, progress=lambda _: None)
    logs = [
        observe_plant(run, scene.hidden, np.random.default_rng([seed, number]), source=f"{truth}, {name}")
        for number, (name, run) in enumerate(zip(scene.names[:-1], scene.runs[:-1], strict=True))
    ]
    lost: dict[str, Any] = dict.fromkeys(("worst", "spring", "z_rms", "z_most"), math.nan)
    runs = {name: ForeignRun(method=name, verdict="refused", **lost) for name in (AUTOMATIC, *methods)}
    with suppress(SymidError):
        identify = prepare_elastic_methods(scene.robot, logs, IdentifyOptions(), context)
        for method in runs:
            with suppress(SymidError):
                found = identify(fit_independent if method == "independent" else method).estimate
                runs[method] = _score(scene, method, found, judge(found))
    return tuple(runs.values())


def try_foreign(
    truth: str, seed: int, judge: Callable[[ElasticEstimate], Judged], *, share: float = 1.0
) -> ForeignRun:
    """Return the automatic choice on the logs of the planar arm with hidden models of a truth.

    `seed` is that of the sensors, `share` that of the full length of the logs; `judge` as of `study_foreign`.
    """
    return _run_task(("2r", truth, 1.0, share, seed, (), judge))[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeignCell:
    """One method on one truth: spreads over the seeds, verdicts and choices with how often they came.

    `z_rms` is the median, `z_most` the largest |z| of all seeds.
    """

    method: str
    worst: Spread = field(metadata=name_key("parameter_error_percent"))
    spring: Spread = field(metadata=name_key("spring_error_percent"))
    z_rms: float
    z_most: float
    verdicts: tuple[tuple[str, int], ...] = field(metadata=write_as(dict))
    choices: tuple[tuple[str, int], ...] = field(metadata=write_as(dict))


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeignTruth:
    """All methods on one truth, the automatic choice first; `best` is the method of the least median.

    `ratio` is the worst parameter of the choice over the least one of all methods in the same run; `near`
    counts runs in which it is 1.2 at most, `near_best` those in which the choice is as near to `best`.
    """

    truth: str
    size: float
    seeds: int = field(metadata=HIDDEN)
    cells: tuple[ForeignCell, ...] = field(metadata=name_key("methods"))
    best: str
    ratio: Spread
    near: int
    near_best: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeignStudy:
    """All truths on one arm."""

    arm: str
    truths: tuple[ForeignTruth, ...]


def _summarise(truth: str, size: float, results: Sequence[tuple[ForeignRun, ...]]) -> ForeignTruth:
    cells = tuple(
        ForeignCell(
            method=runs[0].method,
            worst=compute_spread([run.worst for run in runs]),
            spring=compute_spread([run.spring for run in runs]),
            z_rms=float(np.median([run.z_rms for run in runs])),
            z_most=float(np.fmax.reduce([run.z_most for run in runs])),
            verdicts=count_words(run.verdict for run in runs),
            choices=count_words(run.chosen for run in runs),
        )
        for runs in zip(*results, strict=True)
    )
    errors = np.array([[run.worst for run in runs] for runs in results])
    chosen = errors[:, 0]
    ratios = chosen / np.fmin.reduce(errors[:, 1:], axis=1)
    place = min(range(1, len(cells)), key=lambda number: cells[number].worst.median)
    best = errors[:, place]
    return ForeignTruth(
        truth=truth,
        size=size,
        seeds=len(results),
        cells=cells,
        best=cells[place].method,
        ratio=compute_spread(ratios),
        near=int(np.sum(ratios <= _NEAR)),
        near_best=int(np.sum(chosen <= _NEAR * best)),
    )


def study_foreign(
    seeds: Sequence[int],
    judge: Callable[[ElasticEstimate], Judged],
    *,
    arm: str = "2r",
    truths: Sequence[str] = tuple(TRUTHS),
    sizes: Sequence[float] = (1.0,),
    methods: Sequence[str] = FOREIGN_METHODS,
    share: float = 1.0,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ForeignStudy:
    """Return the errors of all methods, and of the automatic choice, on truths that are not those of symid.

    `seeds` are those of the sensors; `judge`, a function of a module, gives the verdict on an estimate;
    `sizes` multiply what is foreign, `share` is that of the full length of the logs; `jobs` and `progress` as
    of `run_tasks`.

    Raises:
        UsageError: an unknown arm, truth or method, or a size or share out of range.
    """
    kinds = (("arm", [arm], ARMS), ("truth", truths, TRUTHS), ("method", methods, FOREIGN_METHODS))
    wrong = [
        f"unknown {kind} {name!r}: choose from {', '.join(known)}"
        for kind, names, known in kinds
        for name in names
        if name not in known
    ]
    wrong += [f"size {size:g}: must be positive and finite" for size in sizes if not 0.0 < size < math.inf]
    if not 0.0 < share <= 1.0:
        wrong.append(f"share {share:g}: must be positive, and 1 at most")
    if wrong:
        raise UsageError(*(Notice(code="usage.foreign-study", text=text) for text in wrong))
    groups = [(truth, size) for truth in truths for size in sizes]
    tasks = [
        (arm, truth, size, share, seed, tuple(methods), judge) for truth, size in groups for seed in seeds
    ]
    # A process gets all seeds of a truth, whose motion it computes once.
    results = run_tasks(_run_task, tasks, jobs=jobs, batch=len(seeds), progress=progress)
    parts = (results[k : k + len(seeds)] for k in range(0, len(results), len(seeds)))
    found = tuple(_summarise(*group, part) for group, part in zip(groups, parts, strict=True))
    return ForeignStudy(arm=ARMS[arm].name, truths=found)
