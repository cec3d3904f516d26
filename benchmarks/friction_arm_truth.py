"""A simulated six-axis arm, each of whose joints has another friction law; the truth is not symid's.

Truth, seed -> motion in time under a controller, with joints that stick and slip -> logs; true parameters.

`friction_arm.c` has the dynamics, the friction and the integrator; it is compiled by gcc when it is first
needed. Kinematics are those of the UR5; bodies, rotors, friction and gains are invented, of plausible size.
`check_plant` compares the rigid part with Pinocchio, the energy with the work done, a step with half of it.
Logs stay in a folder of the cache, so that they are simulated once. Needs gcc and `pip install pin`.
"""

import ctypes
import hashlib
import os
import subprocess
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from simulated_arms import build_model, read_bodies

HERE = Path(__file__).resolve().parent
SOURCE = HERE / "friction_arm.c"
ROBOT = HERE / "friction_arm.toml"
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "symid-friction-arm"
JOINTS = ("pan", "lift", "elbow", "wrist1", "wrist2", "wrist3")
SIZE = len(JOINTS)
RATE = 1000.0
DURATION = 60.0
PARTS = 2
"""Steps of the integrator a sample."""
STEP = 2.0 * np.pi / 2**20
"""rad, of the encoders."""
POSITION_NOISE = 1e-5
"""rad, rms."""
REFERENCE_TEMPERATURE = 40.0
"""Degrees Celsius at which viscous friction is Fv."""
GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Arm:
    """Rigid truth, with the fields that `simulated_arms.build_model` reads.

    Args:
        placements: x, y, z (m), roll, pitch, yaw (rad) of every joint on the link before, and its axis.
        bodies: mass (kg), centre of mass (m), tensor about it (xx xy xz yy yz zz, kg m^2), link axes.
        rotors: kg m^2 on the joint side.
        stiffness, damping: of the controller, N m/rad, N m s/rad.
        centre, reach: rad, middle and amplitude of the fast motion. speed: rad/s, its peak.
    """

    placements: tuple[tuple[tuple[float, ...], str], ...]
    bodies: tuple[tuple[float, ...], ...]
    rotors: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    centre: tuple[float, ...]
    reach: tuple[float, ...]
    speed: tuple[float, ...]


_HALF = np.pi / 2.0
ARM = Arm(
    placements=(
        ((0, 0, 0.0892, 0, 0, 0), "z"),
        ((0, 0, 0, _HALF, 0, 0), "z"),
        ((-0.425, 0, 0, 0, 0, 0), "z"),
        ((-0.39225, 0, 0.10915, 0, 0, 0), "z"),
        ((0, -0.09465, 0, _HALF, 0, 0), "z"),
        ((0, 0.0823, 0, -_HALF, 0, 0), "z"),
    ),
    # The last body is the flange with a tool beside its axis.
    bodies=read_bodies(
        """
        3.7 0.0 -0.021 -0.018 0.0102 0.0 0.0 0.0091 0.0004 0.0101
        8.4 -0.2095 0.001 0.113 0.0151 0.0003 0.0021 0.1334 0.0 0.1312
        2.6 -0.1871 0.002 0.021 0.0042 0.0001 -0.0012 0.0511 0.0 0.0508
        1.25 0.001 0.009 -0.011 0.0022 0.0 0.0 0.0013 0.0001 0.0021
        1.25 0.0 -0.011 -0.008 0.0021 0.0 0.0 0.0014 -0.0001 0.0022
        2.4 0.034 0.012 0.071 0.0081 0.0002 -0.0004 0.0079 0.0001 0.0046
        """
    ),
    rotors=(1.1, 1.3, 0.7, 0.18, 0.16, 0.14),
    stiffness=(14000.0, 18000.0, 6500.0, 1070.0, 900.0, 720.0),
    damping=(430.0, 540.0, 190.0, 32.0, 27.0, 22.0),
    centre=(0.0, 0.6, 0.4, 0.0, 0.5, 0.0),
    reach=(1.5, 1.3, 1.6, 1.8, 1.8, 2.8),
    speed=(1.8, 1.6, 2.0, 2.6, 3.0, 2.8),
)

Values = dict[str, float]
_PLAIN = ({"Fv": 9.0, "Fc": 6.2}, {"Fv": 11.0, "Fc": 7.4}, {"Fv": 7.0, "Fc": 4.2})
_PLAIN += ({"Fv": 1.5, "Fc": 1.3}, {"Fv": 1.4, "Fc": 1.1}, {"Fv": 1.1, "Fc": 0.9})


@dataclass(frozen=True)
class Truth:
    """The friction of all joints.

    Args:
        laws: of every joint by the names of symid's catalogue.
        values: of every joint; linear parameters and shape values of the law by symid's names, SI units on
            the joint side; Fvt (N m s/rad/K) is added to Fv for every kelvin above REFERENCE_TEMPERATURE.
    """

    laws: tuple[str, ...] = ("coulomb-viscous",) * SIZE
    values: tuple[Values, ...] = field(default=_PLAIN)


TRUTHS = {
    "six-laws": Truth(
        laws=(
            "asymmetric",
            "load-dependent",
            "load-dependent-stribeck",
            "stribeck",
            "cubic",
            "position-dependent",
        ),
        values=(
            {"Fvp": 9.5, "Fcp": 6.6, "Fvn": 8.5, "Fcn": 5.8},
            {"Fv": 11.0, "Fc": 6.4, "Fl": 0.03},
            {"Fv": 7.0, "Fc": 3.4, "Fl": 0.05, "Fe": 0.6, "Fle": 0.04, "vs": 0.08},
            {"Fv": 1.5, "Fc": 1.2, "Fe": 0.36, "vs": 0.07},
            {"Fv": 2.4, "Fc": 1.0, "Fvq": -1.2, "Fvc": 0.26},
            {"Fv": 1.1, "Fc": 0.9, "A1": 0.07, "B1": -0.06, "A2": 0.04, "B2": 0.05},
        ),
    ),
    "plain": Truth(),
    "temperature": Truth(
        laws=("coulomb-viscous", "coulomb-viscous", "temperature", *("coulomb-viscous",) * 3),
        values=(*_PLAIN[:2], {"Fv": 5.6, "Fc": 4.2, "Fvt": -0.14, "Fct": 0.0}, *_PLAIN[3:]),
    ),
}

# The plant as the C code sees it.

_FRICTION = (
    "bump",
    "speed",
    "load",
    "load_bump",
    "A1",
    "A2",
    "B1",
    "B2",
    "gear",
    "Fvq",
    "Fvc",
    "Fvt",
    "width",
)
_NAMES = {"bump": "Fe", "speed": "vs", "load": "Fl", "load_bump": "Fle"}
_DEFAULTS = {"vs": 1.0, "gear": 1.0}


def list_friction(values: Values) -> list[float]:
    """Return the numbers of one joint in the order of `Friction` in the C code."""
    numbers = [values.get(name, values.get(name[:2], 0.0)) for name in ("Fcp", "Fcn", "Fvp", "Fvn")]
    names = (_NAMES.get(name, name) for name in _FRICTION)
    return numbers + [values.get(name, _DEFAULTS.get(name, 0.0)) for name in names]


def build_plant(
    arm: Arm,
    values: tuple[Values, ...],
    *,
    temperature: tuple[float, float] = (30.0, 30.0),
    share: float = 1.0,
    gravity: np.ndarray = GRAVITY,
) -> np.ndarray:
    """Return the plant as the C code reads it; bodies and rotors times `share`.

    `temperature`: degrees Celsius at first and after a long time; the time constant is 40 s. `gravity` is
    that of the base frame, m/s^2; a width in rad/s among `values` makes a joint's friction smooth about rest.
    """
    numbers: list[float] = []
    for (place, _), body, rotor in zip(arm.placements, arm.bodies, arm.rotors, strict=True):
        turn = pin.rpy.rpyToMatrix(*map(float, place[3:]))
        mass, centre = body[0], np.array(body[1:4])
        xx, xy, xz, yy, yz, zz = body[4:]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        tensor += mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        inertial = [mass, *(mass * centre), *tensor[np.triu_indices(3)], rotor]
        numbers += [*turn.ravel(), *map(float, place[:3]), *(share * number for number in inertial)]
    for entry in values:
        numbers += list_friction(entry)
    return np.array([*numbers, *arm.stiffness, *arm.damping, *gravity, *temperature, 40.0])


@cache
def load_library(joints: int = SIZE) -> ctypes.CDLL:
    """Return the C code compiled for so many joints, from the cache where it is there."""
    name = hashlib.sha256(SOURCE.read_bytes()).hexdigest()[:16]
    library = CACHE / f"plant_{name}_{joints}.so"
    if not library.exists():
        CACHE.mkdir(parents=True, exist_ok=True)
        draft = library.with_suffix(f".{os.getpid()}")
        options = ("-O2", "-std=c11", "-ffp-contract=off", "-shared", "-fPIC", f"-DJOINTS={joints}")
        subprocess.run(["gcc", *options, "-o", str(draft), str(SOURCE), "-lm"], check=True)  # noqa: S607
        draft.replace(library)
    found = ctypes.CDLL(str(library))
    found.simulate.restype = ctypes.c_long
    return found


def _point(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _call(function: str, plant: np.ndarray, states: tuple[np.ndarray, ...], width: int) -> np.ndarray:
    q, dq, ddq = (np.ascontiguousarray(entry, dtype=np.float64) for entry in states)
    out = np.empty((len(q), width))
    call = getattr(load_library(q.shape[1]), function)
    call(_point(plant), ctypes.c_long(len(q)), _point(q), _point(dq), _point(ddq), _point(out))
    return out


def compute_rigid_torques(plant: np.ndarray, *states: np.ndarray) -> np.ndarray:
    """Return the torques (N, n) of bodies and rotors in N m, without friction; q, dq, ddq (N, n)."""
    return _call("find_inverse_dynamics", plant, states, states[0].shape[1])


def compute_rigid_regressor(plant: np.ndarray, *states: np.ndarray) -> np.ndarray:
    """Return these torques (N, n, 11 n) per unit of every inertial parameter and rotor."""
    size = states[0].shape[1]
    return _call("find_regressor", plant, states, size * size * 11).reshape(-1, size, size * 11)


# Motion.


def _sum_waves(phase: np.ndarray, waves: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return sum A sin(w phase + p) and two derivatives, (N, 6) each; waves (3, 6, k): w, A, p."""
    w, size, start = waves
    angle = w * phase[:, None, None] + start
    sine, cosine = np.sin(angle), np.cos(angle)
    return (size * sine).sum(-1), (size * w * cosine).sum(-1), (-size * w**2 * sine).sum(-1)


def _draw_waves(
    rng: np.random.Generator, frequency: np.ndarray, reach: np.ndarray, speed: np.ndarray
) -> np.ndarray:
    """Return random waves within `reach` (rad) and `speed` (rad/s), of which the stricter one is met."""
    shape = (SIZE, len(frequency))
    w = 2.0 * np.pi * frequency * rng.uniform(0.9, 1.1, shape)
    waves = np.stack([w, rng.uniform(0.3, 1.0, shape) / w, rng.uniform(0.0, 2.0 * np.pi, shape)])
    q, dq, _ = _sum_waves(np.arange(0.0, DURATION, 0.02), waves)
    waves[1] *= np.minimum(reach / np.abs(q).max(0), speed / np.abs(dq).max(0))[:, None]
    return waves


def draw_reference(arm: Arm, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return q, dq, ddq (N, 6) of a random motion: 12 s fast, then 8 s slow, and again.

    The slow motion never ends; the fast one begins and stops within a second.
    """
    time = np.arange(round(DURATION * RATE)) / RATE
    x = time % 20.0
    rise = np.clip(np.minimum(x, 12.0 - x), 0.0, 1.0)
    rate = rise**2 * (3.0 - 2.0 * rise)
    slope = 6.0 * rise * (1.0 - rise) * np.where(x < 6.0, 1.0, -1.0)
    phase = np.concatenate([[0.0], np.cumsum(rate[1:] + rate[:-1])]) / (2.0 * RATE)
    reach, speed = np.array(arm.reach), rng.uniform(0.85, 1.0, SIZE) * np.array(arm.speed)
    fast = _sum_waves(phase, _draw_waves(rng, np.array([0.1, 0.2, 0.31, 0.43, 0.57]), 0.95 * reach, speed))
    slowly = rng.uniform(0.12, 0.3, SIZE)
    slow = _sum_waves(time, _draw_waves(rng, np.array([0.19, 0.33, 0.53]), 0.2 * reach, slowly))
    rate, slope = rate[:, None], slope[:, None]
    centre = np.array(arm.centre) + rng.uniform(-0.2, 0.2, SIZE)
    q = centre + fast[0] + slow[0]
    return q, rate * fast[1] + slow[1], rate**2 * fast[2] + slope * fast[1] + slow[2]


# Logs.


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """What is simulated: the truth by its name, the seed, the log (from 0), noise of the torques (share)."""

    truth: str = "six-laws"
    seed: int = 0
    log: int = 0
    noise: float = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class Exact:
    """True signals, (N, 6) each: rad, rad/s, rad/s^2, N m; modes 1, -1, 0 of slipping and sticking.

    `temperature` (N,) in degrees Celsius; `energy`, `work` (N,) in J; `events`: how often a mode changed.
    """

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    torque: np.ndarray
    load: np.ndarray
    mode: np.ndarray
    temperature: np.ndarray
    energy: np.ndarray
    work: np.ndarray
    events: int


def simulate(
    experiment: Experiment, *, parts: int = PARTS, duration: float = DURATION, frictionless: bool = False
) -> Exact:
    """Return the true signals of an experiment; a step of the integrator is 1 / (RATE parts).

    The controller knows bodies a tenth too light and Coulomb and viscous friction a fifth too small.
    """
    truth = TRUTHS[experiment.truth]
    rng = np.random.default_rng([1, experiment.seed, experiment.log])
    count = round(duration * RATE)
    states = tuple(entry[:count] for entry in draw_reference(ARM, rng))
    cold = (21.0, 36.0, 28.0)[experiment.log % 3] + rng.uniform(-1.0, 1.0)
    values = tuple({"Fc": 0.0} for _ in JOINTS) if frictionless else truth.values
    plant = build_plant(ARM, values, temperature=(cold, 45.0))
    torque = compute_rigid_torques(build_plant(ARM, values, share=0.9), *states)
    for joint, entry in enumerate(_PLAIN):
        dq = states[1][:, joint]
        torque[:, joint] += 0.8 * (entry["Fv"] * dq + entry["Fc"] * np.tanh(dq / 0.01)) * (not frictionless)
    return run_plant(plant, np.hstack([*states[:2], torque]), parts=parts)


def run_plant(
    plant: np.ndarray, reference: np.ndarray, *, parts: int, rate: float = RATE, held: bool = False
) -> Exact:
    """Return the true signals of a plant along `reference` (N, 3 n): q, dq, torque of the feed-forward.

    Where `held`, the controller reads the state once a sample and holds its torque; a sample then has the
    mean of the torques before and behind it, and the acceleration under that mean.
    """
    reference = np.ascontiguousarray(reference)
    count, size = len(reference), reference.shape[1] // 3
    out = np.empty((count, 6 * size + 3))
    given = (ctypes.c_long(count), ctypes.c_int(parts), ctypes.c_double(1.0 / rate), ctypes.c_int(held))
    events = load_library(size).simulate(_point(plant), *given, _point(reference), _point(out))
    if events < 0 or not np.all(np.isfinite(out)):
        text = "the simulation failed"
        raise SystemExit(text)
    signals = np.split(out[:, : 6 * size], 6, axis=1)
    names = ("q", "dq", "ddq", "torque", "load", "mode")
    return Exact(
        **dict(zip(names, signals, strict=True)),
        **dict(zip(("temperature", "energy", "work"), out[:, 6 * size :].T, strict=True)),
        events=int(events),
    )


def write_log(experiment: Experiment, cache_folder: Path = CACHE) -> Path:
    """Return the log of an experiment as .npz with t, q, tau and, for that truth, temperature.

    It is simulated where the cache does not have it.
    """
    key = [SOURCE.read_bytes(), Path(__file__).read_bytes(), repr(experiment).encode()]
    name = hashlib.sha256(b"".join(key)).hexdigest()[:16]
    path = cache_folder / f"{experiment.truth}_{experiment.seed}_{experiment.log}_{name}.npz"
    if path.exists():
        return path
    exact = simulate(experiment)
    rng = np.random.default_rng([2, experiment.seed, experiment.log])
    shape = exact.q.shape
    q = STEP * np.round((exact.q + POSITION_NOISE * rng.standard_normal(shape)) / STEP)
    deviation = experiment.noise * np.sqrt(np.mean(exact.torque**2, axis=0))
    tau = exact.torque + deviation * rng.standard_normal(shape)
    more = {"temperature": exact.temperature} if experiment.truth == "temperature" else {}
    cache_folder.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(f".{os.getpid()}.npz")
    np.savez(draft, t=np.arange(len(q)) / RATE, q=q, tau=tau, **more)
    draft.replace(path)
    return path


# Checks.


def check_plant(duration: float = 20.0) -> dict[str, float]:
    """Return the errors of the plant, and stop where one is too large.

    rigid, regressor: largest error of torques beside Pinocchio, relative to the largest torque.
    load: the same of the torques at the gears in simulated states. energy: of the energy beside the work
    done, relative to the largest change. friction: torque less load less friction by its formula, N m.
    rest: what holds a joint at rest beyond the friction that it can have, N m. position, torque: largest
    change by half the step, rad and N m.
    """
    rng = np.random.default_rng(0)
    plant, model = build_plant(ARM, _PLAIN), build_model(ARM)
    data = model.createData()

    def compare(states: tuple[np.ndarray, ...], torque: np.ndarray) -> float:
        known = np.array([pin.rnea(model, data, *state) for state in zip(*states, strict=True)])
        known += np.array(ARM.rotors) * states[2]
        return float(np.abs(torque - known).max() / np.abs(known).max())

    states = tuple(rng.uniform(-2.0, 2.0, (3, 200, SIZE)))
    units = np.concatenate([plant[23 * k + 12 : 23 * k + 23] for k in range(SIZE)])
    experiment = Experiment(seed=12345)
    exact, halved = (simulate(experiment, parts=parts, duration=duration) for parts in (PARTS, 2 * PARTS))
    change = exact.energy - exact.energy[0]
    acting = exact.torque - exact.load
    at_rest = exact.mode == 0
    # Friction at the start of the motion that a joint at rest would begin.
    begun = replace(exact, dq=np.where(at_rest, 1e-300 * np.sign(acting), exact.dq))
    friction = compute_friction(TRUTHS["six-laws"], begun)
    moved = (exact.q, exact.dq, exact.ddq)
    found = {
        "rigid": compare(states, compute_rigid_torques(plant, *states)),
        "regressor": compare(states, compute_rigid_regressor(plant, *states) @ units),
        "load": compare(tuple(entry[::50] for entry in moved), exact.load[::50]),
        "energy": float(np.abs(change - exact.work + exact.work[0]).max() / np.ptp(change)),
        "friction": float(np.abs(acting - friction)[~at_rest].max()),
        "rest": float(np.max(np.abs(acting) - np.abs(friction), where=at_rest, initial=0.0)),
        "position": float(np.abs(exact.q - halved.q).max()),
        "torque": float(np.abs(exact.torque - halved.torque).max()),
    }
    bounds = (1e-9, 1e-9, 1e-9, 1e-6, 1e-9, 1e-8, 1e-7, 1e-3)
    for (name, error), bound in zip(found.items(), bounds, strict=True):
        if not error < bound:
            text = f"the simulated arm is wrong: {name} {error:.1e}, allowed {bound:.0e}"
            raise SystemExit(text)
    return found


def list_columns(
    values: Values, q: np.ndarray, dq: np.ndarray, load: np.ndarray, temperature: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the columns (N,) of one joint's friction by their linear parameters; not by symid's code."""
    sign = np.sign(dq)
    forward, backward = dq > 0.0, dq < 0.0
    fall = np.exp(-((dq / values.get("vs", 1.0)) ** 2))
    angle = values.get("gear", 1.0) * q
    every = {
        "Fv": dq,
        "Fc": sign,
        "Fvp": dq * forward,
        "Fcp": 1.0 * forward,
        "Fvn": dq * backward,
        "Fcn": -1.0 * backward,
        "Fe": fall * sign,
        "Fl": np.abs(load) * sign,
        "Fle": np.abs(load) * fall * sign,
        "Fvq": np.abs(dq) * dq,
        "Fvc": dq**3,
        "A1": np.cos(angle) * sign,
        "B1": np.sin(angle) * sign,
        "A2": np.cos(2.0 * angle) * sign,
        "B2": np.sin(2.0 * angle) * sign,
        "Fvt": (temperature - REFERENCE_TEMPERATURE) * dq,
        "Fct": (temperature - REFERENCE_TEMPERATURE) * sign,
    }
    return {name: every[name] for name in values if name in every}


def compute_friction(truth: Truth, exact: Exact) -> np.ndarray:
    """Return the friction (N, 6) in N m of joints that slip, by its formula."""
    friction = np.empty_like(exact.q)
    for joint, values in enumerate(truth.values):
        inputs = (exact.q[:, joint], exact.dq[:, joint], exact.load[:, joint])
        columns = list_columns(values, *inputs, exact.temperature)
        friction[:, joint] = sum(values[name] * column for name, column in columns.items())
    return friction
