"""Linear couplings between a motor and a load, driven in three ways: is the spring found, and found linear?

    python benchmarks/couplings.py [--draws 20] [--seed 1] [--processes 2]

The plant shares no code with symid: two inertias, a linear spring and damper, dry friction of the motor,
Runge-Kutta steps of 50 us. Resonances lie between 50 and 200 Hz; encoders have 20 bits, the logged torque has
2 % of noise. Each row stands beside 30 lines of least squares on the same samples.
"""

import argparse
import concurrent.futures
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.signal

import symid

PERIOD, STEPS, DURATION = 4e-4, 8, 10.0
KINDS = ("chirp", "multisine", "steps")
TORSION = 0.02
"""rad, rms, that the torque is scaled for."""
ROBOT = """
name = "coupling"
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
name = "coupling"
kind = "revolute"
drive = { rotor_inertia = "unknown", rotor_inertia_side = "joint" }
friction = { model = "coulomb-viscous", smoothing = 0.01 }
elasticity = { stiffness = "unknown" }
"""


State = tuple[float, ...]
"""theta, q, dtheta, dq."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coupling:
    """Motor and load (kg m^2), spring (N m/rad, N m s/rad), friction (N m s/rad, N m), resonance (Hz)."""

    motor: float
    load: float
    stiffness: float
    damping: float
    viscous: float
    coulomb: float
    drag: float
    resonance: float


class Row(NamedTuple):
    """A draw: error and stated deviation of the stiffness, that of least squares, all in percent."""

    kind: str
    draw: int
    coupling: Coupling
    error: float
    deviation: float
    plain: float
    words: str
    linear: bool


def draw_coupling(rng: np.random.Generator) -> Coupling:
    """Return a coupling whose resonance lies between 50 and 200 Hz, damped by 0.5 to 3 %."""
    motor, load = 5e-3 * 3.0 ** rng.uniform(-1.0, 1.0, 2)
    resonance = rng.uniform(50.0, 200.0)
    common = motor * load / (motor + load)
    way = 2.0 * math.pi * resonance
    return Coupling(
        motor=motor,
        load=load,
        stiffness=way**2 * common,
        damping=2.0 * rng.uniform(0.005, 0.03) * way * common,
        viscous=way * common * rng.uniform(0.005, 0.03),
        coulomb=way**2 * common * TORSION * rng.uniform(0.0, 0.1),
        drag=way * common * rng.uniform(0.0, 0.01),
        resonance=resonance,
    )


def draw_torque(kind: str, coupling: Coupling, rng: np.random.Generator) -> np.ndarray:
    """Return a torque of unit size at the ticks of the control."""
    time = PERIOD * np.arange(round(DURATION / PERIOD))
    top = 2.5 * coupling.resonance
    if kind == "chirp":
        return scipy.signal.chirp(time, 3.0, DURATION, min(top, 400.0), "logarithmic")
    if kind == "multisine":
        lines = rng.choice(np.arange(5, round(min(top, 400.0))), 60, replace=False)
        return np.sin(2.0 * np.pi * np.outer(time, lines) + rng.uniform(0.0, 6.28, 60)).sum(axis=1)
    holds = rng.uniform(0.02, 0.1, round(DURATION / 0.02))
    ends = np.cumsum(holds)
    return rng.uniform(-1.0, 1.0, len(holds))[np.searchsorted(ends, time).clip(max=len(holds) - 1)]


def simulate(coupling: Coupling, torque: np.ndarray) -> np.ndarray:
    """Return theta, q (rad) and the torque (N m) with that of a control to the middle, (N, 3)."""
    found, now = np.empty((len(torque), 3)), (0.0, 0.0, 0.0, 0.0)
    motor, load = coupling.motor, coupling.load
    step = PERIOD / STEPS
    k, d, fv, fc = coupling.stiffness, coupling.damping, coupling.viscous, coupling.coulomb
    centring = 0.05 * k
    calming = math.sqrt(centring * (motor + load))

    def move(at: State, push: float) -> State:
        theta, q, dtheta, dq = at
        spring = k * (theta - q) + d * (dtheta - dq)
        drag = fv * dtheta + fc * math.tanh(dtheta / 0.01)
        return dtheta, dq, (push - drag - spring) / motor, (spring - coupling.drag * dq) / load

    def add(at: State, rate: State, by: float) -> State:
        return tuple(x + by * v for x, v in zip(at, rate, strict=True))

    for tick, push in enumerate(torque.tolist()):
        whole = push - centring * now[0] - calming * now[2]
        found[tick] = *now[:2], whole
        for _ in range(STEPS):
            one = move(now, whole)
            two = move(add(now, one, 0.5 * step), whole)
            three = move(add(now, two, 0.5 * step), whole)
            four = move(add(now, three, step), whole)
            mean = [
                (a + 2.0 * b + 2.0 * c + e) / 6.0 for a, b, c, e in zip(one, two, three, four, strict=True)
            ]
            now = add(now, mean, step)
    return found


def fit_least_squares(columns: np.ndarray, coupling: Coupling) -> float:
    """Return the stiffness (N m/rad) of both equations of motion, in thirty lines."""
    theta, q, tau = columns.T
    band = scipy.signal.butter(4, min(2.0 * coupling.resonance, 500.0), fs=1.0 / PERIOD, output="sos")

    def smooth(values: np.ndarray) -> np.ndarray:
        return scipy.signal.sosfiltfilt(band, values, axis=0)[500:-500]

    def differ(values: np.ndarray) -> np.ndarray:
        return np.gradient(values, PERIOD, edge_order=2)

    speed, load = differ(theta), differ(q)
    # A hold centres the torque half a period late.
    late = np.interp(np.arange(len(tau)) - 0.5, np.arange(len(tau)), tau)
    zero = np.zeros_like(tau)
    twist, rate = theta - q, speed - load
    motor = np.column_stack([differ(speed), zero, twist, rate, speed, np.tanh(speed / 0.01), zero])
    link = np.column_stack([zero, differ(load), -twist, -rate, zero, zero, load])
    rows, target = smooth(motor), smooth(late)
    other = smooth(link)
    size = np.sqrt(np.mean(target**2))
    beta = np.linalg.lstsq(np.vstack([rows, other]) / size, np.append(target, 0 * target) / size)[0]
    return float(beta[2])


def observe(kind: str, seed: int, draw: int) -> tuple[Coupling, np.ndarray]:
    """Return a coupling and what its sensors show: theta, q (rad) and torque (N m), (N, 3)."""
    rng = np.random.default_rng([seed, draw, KINDS.index(kind)])
    coupling = draw_coupling(rng)
    torque = draw_torque(kind, coupling, rng)
    # Two trials say what torque gives the torsion that is wanted.
    torque = torque * (TORSION * coupling.stiffness / np.std(torque))
    for _ in range(2):
        columns = simulate(coupling, torque)
        torque = torque * (TORSION / np.std(columns[:, 0] - columns[:, 1]))
    columns = simulate(coupling, torque)
    step = 2.0 * math.pi / 2**20
    columns[:, :2] = step * np.round(columns[:, :2] / step)
    columns[:, 2] += 0.02 * np.std(columns[:, 2]) * rng.standard_normal(len(columns))
    return coupling, columns


def identify(columns: np.ndarray) -> "symid.Fit":
    """Return what symid finds of the samples, with the options of a user who states none."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "coupling.toml"
        path.write_text(ROBOT, encoding="utf-8")
        robot = symid.load(path)
    sides = {name: columns[:, [k]] for k, name in enumerate(("theta", "q", "tau"))}
    return robot.identify([symid.build_log(robot, time=PERIOD * np.arange(len(columns)), **sides)])


def run(kind: str, seed: int, draw: int) -> Row:
    """Return a row of the table: errors in percent, the deviation, the words of the fit."""
    coupling, columns = observe(kind, seed, draw)
    plain = 100.0 * (fit_least_squares(columns, coupling) / coupling.stiffness - 1.0)
    try:
        fit = identify(columns)
    except symid.errors.SymidError as error:
        return Row(kind, draw, coupling, math.nan, math.nan, plain, f"refused: {error}", linear=False)
    (spring,) = fit.estimate.springs
    found = spring.elasticity
    off = 100.0 * (found.initial_stiffness / coupling.stiffness - 1.0)
    deviation = 100.0 * (spring.slope_std or math.inf) / coupling.stiffness
    linear = not (found.stops or found.knees or found.branches or found.cubic)
    words = f"{fit.verdict.level}, {fit.estimate.method}, {'linear' if linear else 'another kind'}"
    return Row(kind, draw, coupling, off, deviation, plain, words, linear=linear)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    print("excitation draw    Hz   N m/rad error/%  std/%  least squares/%")
    rows = []
    with concurrent.futures.ProcessPoolExecutor(given.processes) as pool:
        draws = range(given.draws)
        for task in [pool.submit(run, kind, given.seed, draw) for draw in draws for kind in KINDS]:
            rows.append(row := task.result())
            numbers = f"{row.error:8.2f}{row.deviation:7.2f}{row.plain:8.2f}"
            where = f"{row.kind:10}{row.draw:5}{row.coupling.resonance:7.1f}{row.coupling.stiffness:10.2f}"
            print(where, numbers, row.words, flush=True)
    near = [abs(row.error) <= max(2.0, 2.0 * row.deviation) for row in rows]
    curved = sum(not row.linear for row in rows)
    print(f"of {len(rows)}: {sum(near)} within 2 % or two deviations, {curved} with another kind of spring")
    for name in ("error", "plain"):
        sizes = np.abs([getattr(row, name) for row in rows])
        print(f"{name}: median {np.nanmedian(sizes):.2f} %, worst {np.nanmax(sizes):.2f} %")


if __name__ == "__main__":
    main()
