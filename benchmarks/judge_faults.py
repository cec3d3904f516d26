"""Faults of logs: those that a judge can name, others that it cannot, and which of them a log shows at all.

Sample, generator -> `Corruption` (logs that are wrong, and what is) -> `Sight`: visible, unique.

What a log shows is asked without a judge: the clean log and the wrong one are fitted by plain weighted least
squares within the band of the motion (columns of the robot; viscous friction, dry friction and an offset at
every joint), and so is every other change that could be made to the wrong log. A mistake is

    visible    if undoing it leaves half the squares or less of the joints it touches, and two thirds of all
    unique     if no change of another family leaves less than twice the squares that undoing it leaves

Squares are those of stretches that were held out, relative to the torque as it is then, joint by joint.
"""

import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from judge_plants import Chain, Sample, cut, turn_gravity
from scipy.optimize import minimize, minimize_scalar
from scipy.signal import butter, sosfiltfilt
from simulated_arms import Run

import symid

Change = Callable[[Run], Run]

# Changes of one log; joints count from one, None for all.


def get_period(run: Run) -> float:
    """Return the mean period, s."""
    return float((run.time[-1] - run.time[0]) / (len(run.time) - 1))


def differentiate(run: Run) -> np.ndarray:
    """Return exact velocities (N, n), or those of positions below 10 Hz."""
    if run.states is not None:
        return run.states[1]
    return np.gradient(_smooth(run.q, get_period(run), 10.0), run.time, axis=0)


def _smooth(values: np.ndarray, period: float, cutoff: float) -> np.ndarray:
    sections = butter(4, min(cutoff, 0.4 / period), fs=1.0 / period, output="sos")
    return sosfiltfilt(sections, values, axis=0)


def _multiply(values: np.ndarray, joint: int | None, factor: float) -> np.ndarray:
    factors = np.ones(values.shape[1])
    factors[slice(None) if joint is None else joint - 1] = factor
    return values * factors


def scale_torque(joint: int | None, factor: float) -> Change:
    """Multiply one torque, or all."""
    return lambda run: replace(run, tau=_multiply(run.tau, joint, factor))


def scale_position(joint: int | None, factor: float) -> Change:
    """Multiply one position, or all, with their velocities."""

    def change(run: Run) -> Run:
        dq = None if run.dq is None else _multiply(run.dq, joint, factor)
        return replace(run, q=_multiply(run.q, joint, factor), dq=dq)

    return change


def exchange(what: str, one: int, other: int) -> Change:
    """Exchange columns of "torques", "positions" or "joints"."""

    def change(run: Run) -> Run:
        order = list(range(run.q.shape[1]))
        order[one - 1], order[other - 1] = order[other - 1], order[one - 1]
        tau = run.tau if what == "positions" else run.tau[:, order]
        if what == "torques":
            return replace(run, tau=tau)
        return replace(run, q=run.q[:, order], tau=tau, dq=None if run.dq is None else run.dq[:, order])

    return change


def scale_time(factor: float) -> Change:
    """Multiply the stamps; velocities stay as logged."""
    return lambda run: replace(run, time=run.time[0] + factor * (run.time - run.time[0]))


def delay_torque(seconds: float) -> Change:
    """Log torques late, or early where negative; what is shifted out is lost."""

    def change(run: Run) -> Run:
        shift = max(1, round(abs(seconds) / get_period(run)))
        early, late = slice(None, -shift), slice(shift, None)
        at, taken = (late, early) if seconds > 0.0 else (early, late)
        return replace(cut(run, at), tau=run.tau[taken])

    return change


def shift_position(joint: int, offset: float) -> Change:
    """Add an offset to a position."""
    return lambda run: replace(run, q=run.q + offset * (np.arange(run.q.shape[1]) == joint - 1))


def spike(joint: int, count: int, rng: np.random.Generator) -> Change:
    """Put single wrong samples of 0.2 to 2 rad into an encoder."""

    def change(run: Run) -> Run:
        q = run.q.copy()
        at = rng.choice(len(q), count, replace=False)
        q[at, joint - 1] += rng.choice((-1.0, 1.0), count) * rng.uniform(0.2, 2.0, count)
        return replace(run, q=q)

    return change


def wrap(joint: int) -> Change:
    """Wrap an encoder: it jumps by a turn where the joint passes the middle of its range."""

    def change(run: Run) -> Run:
        q = run.q.copy()
        column = q[:, joint - 1]
        q[:, joint - 1] = column - 2.0 * np.pi * (column > (column.min() + column.max()) / 2.0)
        return replace(run, q=q)

    return change


def stick(joint: int, share: float) -> Change:
    """Hold an encoder from a share of the log on; its velocity is then zero."""

    def change(run: Run) -> Run:
        start = round(share * len(run.q))
        q, dq = run.q.copy(), None if run.dq is None else run.dq.copy()
        q[start:, joint - 1] = q[start, joint - 1]
        if dq is not None:
            dq[start:, joint - 1] = 0.0
        return replace(run, q=q, dq=dq)

    return change


def repeat_rows(share: float, rng: np.random.Generator) -> Change:
    """Drop a share of the packets: all channels keep the last value, stamps go on."""

    def change(run: Run) -> Run:
        fresh = rng.uniform(size=len(run.time)) >= share
        fresh[0] = True
        last = np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0))
        return replace(cut(run, last), time=run.time)

    return change


def clip_torque(joint: int, share: float) -> Change:
    """Clip a torque at a share of its largest value."""

    def change(run: Run) -> Run:
        tau = run.tau.copy()
        most = share * np.abs(tau[:, joint - 1]).max()
        tau[:, joint - 1] = np.clip(tau[:, joint - 1], -most, most)
        return replace(run, tau=tau)

    return change


def take_torque(joint: int, other: np.ndarray) -> Change:
    """Put another torque (N,), of the same mean square, in place of one."""

    def change(run: Run) -> Run:
        tau = run.tau.copy()
        taken = np.resize(other, len(tau))
        tau[:, joint - 1] = taken * np.sqrt(np.mean(tau[:, joint - 1] ** 2) / np.mean(taken**2))
        return replace(run, tau=tau)

    return change


def replace_by_noise(joint: int, rng: np.random.Generator) -> Change:
    """Put white noise of the same mean square in place of a torque."""
    return lambda run: take_torque(joint, rng.standard_normal(len(run.tau)))(run)


# What is wrong with a sample.


@dataclass(frozen=True, kw_only=True)
class Corruption:
    """Logs that are wrong: what is right, what is identified, the family of the mistake and its joints.

    Joints count from one; none are named where all are touched, or no joint can be told.
    """

    name: str
    clean: Sample
    wrong: Sample
    family: str
    joints: tuple[int, ...] = ()


def carry(sample: Sample, number: int, other: Chain) -> Sample:
    """Return the sample whose log `number` has the torques of another chain along the same states."""
    run = sample.runs[number]
    tau = run.tau + other.compute_torques(*run.states) - sample.chain.compute_torques(*run.states)
    runs = (*sample.runs[:number], replace(run, tau=tau), *sample.runs[number + 1 :])
    return replace(sample, runs=runs)


FAMILIES = {
    "torque sign": "torque sign",
    "all torque signs": "torque sign",
    "position sign": "position sign",
    "all position signs": "position sign",
    "torques exchanged": "order",
    "positions exchanged": "order",
    "joints exchanged": "order",
    "position unit": "position unit",
    "all position units": "position unit",
    "torque unit": "torque unit",
    "all torque units": "torque unit",
    "gear": "torque unit",
    **{kind: kind for kind in ("time", "delay", "zero", "gravity", "payload", "spikes", "wrap", "stuck")},
    **{kind: kind for kind in ("repeats", "clipped", "noise")},
}
"""Kinds of mistakes, and the family of causes that each belongs to."""


def corrupt(
    base: str, clean: Sample, draw_log: Callable[[], Run], rng: np.random.Generator
) -> Corruption | None:
    """Return a corruption of random kind, joints and size; None where the kind cannot be made of the sample.

    `draw_log` simulates another log of the sample's arm.
    """
    kind, size = str(rng.choice(tuple(FAMILIES))), clean.runs[0].q.shape[1]
    one, other = (1 + rng.permutation(size)[:2]).tolist() if size > 1 else (1, 0)
    side = float(rng.choice((-1.0, 1.0)))
    share, log_share = float(rng.uniform()), float(np.exp(rng.uniform(np.log(0.01), np.log(0.3))))
    if (kind in {"gravity", "payload"} and clean.chain is None) or ("exchanged" in kind and not other):
        return None
    every = kind.startswith("all") or kind in {"time", "delay", "gravity", "payload", "repeats"}
    joints, words, made = () if every else (one,), kind if every else f"{kind} {one}", None
    target = None if every else one
    if kind == "payload":
        clean = replace(clean, runs=(*clean.runs, draw_log()))
        mass = (0.6 + 1.4 * share) * clean.chain.bodies[-1][0]
        wrong = carry(clean, 1, clean.chain.add_payload(mass, tuple(rng.uniform(-0.1, 0.15, 3))))
        words = f"payload {mass:.3g} kg in the second log"
    elif kind == "gravity":
        angle = np.pi * 0.045 ** (1.0 - share)
        wrong = carry(clean, 0, turn_gravity(clean.chain, angle, rng.standard_normal(3)))
        words = f"gravity turned by {np.degrees(angle):.3g} degrees"
    elif "sign" in kind:
        made = (scale_torque if "torque" in kind else scale_position)(target, -1.0)
    elif "exchanged" in kind:
        joints = min(one, other), max(one, other)
        made, words = exchange(kind.split(maxsplit=1)[0], *joints), f"{kind} {joints[0]} {joints[1]}"
    elif "position unit" in kind:
        made = scale_position(target, 180.0 / np.pi)
    elif kind in {"torque unit", "all torque units", "gear"}:
        factor = (5.0 * 32.0**share if kind == "gear" else 1e3) ** side
        made, words = scale_torque(target, factor), f"{words} times {factor:.3g}"
    elif kind == "time":
        factor = float(np.exp(side * (0.2 + 0.9 * share)))
        made, words = scale_time(factor), f"time times {factor:.3g}"
    elif kind == "delay":
        made, words = delay_torque(side * log_share), f"torque {1e3 * side * log_share:.3g} ms late"
    elif kind == "zero":
        offset = side * (0.1 + 1.4 * share)
        made, words = shift_position(one, offset), f"zero of {one} off by {offset:.3g} rad"
    elif kind == "spikes":
        made = spike(one, int(rng.integers(3, 40)), rng)
    elif kind == "wrap":
        made = wrap(one)
    elif kind == "stuck":
        made, words = stick(one, 0.3 + 0.6 * share), f"encoder {one} stuck from {0.3 + 0.6 * share:.0%}"
    elif kind == "repeats":
        made, words = repeat_rows(0.05 + 0.45 * share, rng), f"{0.05 + 0.45 * share:.0%} of the rows repeated"
    elif kind == "clipped":
        made, words = clip_torque(one, 0.3 + 0.5 * share), f"torque {one} clipped at {0.3 + 0.5 * share:.0%}"
    else:
        made = replace_by_noise(one, rng)
    if made is not None:
        wrong = replace(clean, runs=tuple(map(made, clean.runs)))
    return Corruption(name=f"{base}: {words}", clean=clean, wrong=wrong, family=FAMILIES[kind], joints=joints)


UNLISTED = (
    "torque low-passed",
    "torque saturated softly",
    "friction falls with temperature",
    "friction grows with load",
    "pull of a cable",
    "backlash",
    "contact for a stretch",
    "flexible joint",
    "hysteresis of the torque sensor",
)


def corrupt_otherwise(base: str, clean: Sample, rng: np.random.Generator) -> Corruption:
    """Return logs with a fault that is not among the causes, of random kind, joint and size."""
    kind, joint = str(rng.choice(UNLISTED)), int(rng.integers(clean.runs[0].q.shape[1]))
    size = float(rng.uniform(0.5, 1.0))

    def change(run: Run) -> Run:
        tau, q, period = run.tau.copy(), run.q.copy(), get_period(run)
        own, speed = tau[:, joint], differentiate(run)[:, joint]
        rms, reach = np.sqrt(np.mean(own**2)), np.ptp(q[:, joint])
        middle, time = (q[:, joint].max() + q[:, joint].min()) / 2.0, run.time - run.time[0]
        side = np.tanh(speed / max(0.02 * np.abs(speed).max(), 1e-9))
        if kind == UNLISTED[0]:
            keep = np.exp(-period / (0.1 * size))
            for row in range(1, len(own)):
                tau[row, joint] = keep * tau[row - 1, joint] + (1.0 - keep) * own[row]
        elif kind == UNLISTED[1]:
            most = (1.2 - 0.6 * size) * np.abs(own).max()
            tau[:, joint] = most * np.tanh(own / most)
        elif kind == UNLISTED[2]:
            tau[:, joint] -= 0.3 * size * rms * (1.0 - np.exp(-3.0 * time / time[-1])) * side
        elif kind == UNLISTED[3]:
            tau[:, joint] += 0.2 * size * np.abs(_smooth(own, period, 10.0)) * side
        elif kind == UNLISTED[4]:
            way = 2.0 * (q[:, joint] - middle) / reach
            tau[:, joint] += 0.4 * size * rms * (way + way**3)
        elif kind == UNLISTED[5]:
            q[:, joint] += 0.01 * size * np.tanh(_smooth(own, period, 10.0) / (0.1 * rms))
        elif kind == UNLISTED[6]:
            begin = 0.2 + 0.5 * (size - 0.5)
            during = (time > begin * time[-1]) & (time < (begin + 0.2) * time[-1])
            tau[:, joint] += 2.0 * size * rms * during * np.maximum(0.0, q[:, joint] - middle) / reach
        elif kind == UNLISTED[7]:
            q[:, joint] += 0.02 * size * _smooth(own, period, 20.0) / rms
        else:
            width, held = 0.2 * size * rms, own[0]
            for row, value in enumerate(own.copy()):
                held = min(max(held, value - width), value + width)
                tau[row, joint] = held
        return replace(run, tau=tau, q=q)

    wrong = replace(clean, runs=tuple(map(change, clean.runs)))
    name = f"{base}: {kind}, joint {joint + 1}, size {size:.2f}"
    return Corruption(name=name, clean=clean, wrong=wrong, family="", joints=(joint + 1,))


# What a log shows.


class Thinned(NamedTuple):
    """Samples within the band: q, dq, ddq, tau (T, n), whether rows count (T, n), log (T,), period (s)."""

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    tau: np.ndarray
    kept: np.ndarray
    run: np.ndarray
    period: float


MOST_SAMPLES = 2500
FOLDS = 6
SLOW = 0.05
"""Of the top speed: slower rows do not count."""


def find_band(run: Run) -> float:
    """Return twice the band of 99 % of the power of the velocities, Hz."""
    period = get_period(run)
    speed = np.gradient(_smooth(run.q, period, 0.1 / period), period, axis=0)
    power = np.abs(np.fft.rfft(speed * np.hanning(len(speed))[:, None], axis=0)) ** 2
    share = np.cumsum(power, axis=0) / np.sum(power, axis=0)
    frequency = np.fft.rfftfreq(len(speed), period)
    moving = np.ptp(run.q, axis=0) > 1e-3
    top = max(float(frequency[np.searchsorted(column, 0.99)]) for column in share.T[moving])
    return max(2.0 * top, 1.0)


def thin(runs: tuple[Run, ...], band: float) -> Thinned:
    """Return samples at four times the band, of positions and torques below it, without the ends."""
    parts = []
    length = sum(run.time[-1] - run.time[0] for run in runs)
    period = max(1.0 / (4.0 * band), length / MOST_SAMPLES)
    for number, run in enumerate(runs):
        order = np.argsort(run.time, kind="stable")
        fine = get_period(run)
        grid = np.arange(run.time.min(), run.time.max(), fine)
        table = np.hstack([run.q, run.tau])[order]
        even = np.column_stack([np.interp(grid, run.time[order], column) for column in table.T])
        even = _smooth(even, fine, min(band, 0.4 / fine))
        q, tau = np.split(even, 2, axis=1)
        dq = np.gradient(q, fine, axis=0)
        ddq = np.gradient(dq, fine, axis=0)
        ends = round(min(0.5 / fine, 0.05 * len(grid)))
        at = np.arange(ends, len(grid) - ends, max(1, round(period / fine)))
        speed = np.abs(dq[at])
        kept = speed > SLOW * np.quantile(speed, 0.99, axis=0)
        parts.append((q[at], dq[at], ddq[at], tau[at], kept, np.full(len(at), number)))
    return Thinned(*map(np.concatenate, zip(*parts, strict=True)), period)


OBLIQUE = np.array([[1.0, 0.5, 0.3], [0.4, 1.0, -0.6], [-0.5, 0.3, 1.0]])
"""Directions of gravity along no axis: they have one set of base parameters, that of any direction."""


class OwnModel:
    """Plain weighted least squares with the regressor of a robot, and with gravity as three unknowns."""

    def __init__(self, sample: Sample) -> None:
        """Compile the robot as its file has it, and with three oblique directions of gravity."""
        toml = sample.suffix == ".toml"
        pattern, frame, comma = r'gravity="[^"]*"', 'gravity="{}"', " "
        if toml:
            pattern, frame, comma = r"(?m)^gravity = .*$", "gravity = [{}]", ", "
        self.regressor = self._compile(sample.text, sample.suffix)
        found = re.search(pattern, sample.text)
        turned = [frame.format(comma.join(map(str, row))) for row in OBLIQUE] if found else []
        self.oblique = [self._compile(re.sub(pattern, text, sample.text), sample.suffix) for text in turned]

    @staticmethod
    def _compile(text: str, suffix: str) -> Callable[..., np.ndarray]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"robot{suffix}"
            path.write_text(text, encoding="utf-8")
            return symid.load(path).compile().torque_regressor

    def find_band(self, runs: tuple[Run, ...]) -> float:
        """Return the band of logs in Hz: that of the motion, or what five rows of a parameter need."""
        size = runs[0].q.shape[1]
        still = np.zeros((1, size))
        count = np.asarray(self.regressor(still, still, still)).shape[2] + 3 * size
        length = sum(run.time[-1] - run.time[0] for run in runs)
        least = 5.0 * count / size / (2.0 * length)
        return min(max([least, *map(find_band, runs)]), 0.1 / max(map(get_period, runs)))

    def evaluate(self, rows: Thinned) -> np.ndarray:
        """Return the columns (T, n, p): those of the robot, and friction and an offset at every joint."""
        states = (np.ascontiguousarray(part) for part in (rows.q, rows.dq, rows.ddq))
        return self._add_friction(np.asarray(self.regressor(*states)), rows)

    @staticmethod
    def _add_friction(columns: np.ndarray, rows: Thinned) -> np.ndarray:
        count, size = rows.dq.shape
        added = np.zeros((count, size, 3, size))
        each = np.arange(size)
        for k, values in enumerate((rows.dq, np.sign(rows.dq), np.ones_like(rows.dq))):
            added[:, each, k, each] = values
        return np.concatenate([columns, added.reshape(count, size, -1)], axis=2)

    def measure(self, rows: Thinned) -> np.ndarray:
        """Return held-out squares (n,) relative to those of the torque; zero of joints at rest."""
        return self._solve(rows, self.evaluate(rows))

    @staticmethod
    def _solve(rows: Thinned, columns: np.ndarray) -> np.ndarray:
        """Return what weighted fits without each stretch leave of it (n,), relative to the torque."""
        table = np.concatenate([columns, rows.tau[:, :, None]], axis=2) * rows.kept[:, :, None]
        parts = (np.ascontiguousarray(np.swapaxes(part, 0, 1)) for part in np.array_split(table, FOLDS))
        grams = np.stack([np.swapaxes(part, 1, 2) @ part for part in parts])
        whole = grams.sum(axis=0)
        size = np.where(whole[:, -1, -1] > 0.0, whole[:, -1, -1], 1.0)
        weights = (whole[:, -1, -1] > 0.0) / size

        def solve(sums: np.ndarray) -> np.ndarray:
            sums = np.einsum("j,...jkl->...kl", weights, sums)
            scale = np.sqrt(np.einsum("...kk->...k", sums))[..., :-1]
            scale = np.where(scale > 0.0, scale, 1.0)
            matrix = sums[..., :-1, :-1] / (scale[..., :, None] * scale[..., None, :])
            right = (sums[..., :-1, -1] / scale)[..., None]
            return (np.linalg.pinv(matrix, rcond=1e-5, hermitian=True) @ right)[..., 0] / scale

        for _ in range(2):
            errors = np.append(solve(whole), -1.0)
            left = np.einsum("k,jkl,l->j", errors, whole, errors)
            weights = (weights > 0.0) / np.maximum(left, 1e-8 * size)
        errors = np.hstack([solve(whole - grams), -np.ones((FOLDS, 1))])
        left = np.maximum(np.einsum("fk,fjkl,fl->j", errors, grams, errors), 0.0)
        return np.where(weights > 0.0, left / size, 0.0)

    def measure_gravity(self, rows: Thinned) -> np.ndarray:
        """Return the squares (n,) with gravity in the best direction; its size is that of the parameters.

        Columns are K + sum_k g_k P_k; those of three robots at rest give P.
        """
        still = [np.ascontiguousarray(rows.q), *np.zeros((2, *rows.q.shape))]
        rest = np.stack([np.asarray(regressor(*still)) for regressor in self.oblique])
        pulls = np.tensordot(np.linalg.inv(OBLIQUE), rest, axes=1)
        states = (np.ascontiguousarray(part) for part in (rows.q, rows.dq, rows.ddq))
        kinetic = self._add_friction(np.asarray(self.oblique[0](*states)) - rest[0], rows)

        def find_left(gravity: np.ndarray) -> np.ndarray:
            columns = kinetic.copy()
            columns[:, :, : pulls.shape[3]] += np.tensordot(gravity, pulls, axes=1)
            return self._solve(rows, columns)

        def price(gravity: np.ndarray) -> float:
            return float(find_left(9.81 * gravity / max(np.linalg.norm(gravity), 1e-9)).mean())

        starts = (np.array(start) for start in product((-1.0, 0.0, 1.0), repeat=3) if any(start))
        best = min(starts, key=price)
        found = minimize(price, best, method="Nelder-Mead", options={"maxfev": 80})
        return find_left(9.81 * found.x / np.linalg.norm(found.x))


def list_candidates(
    rows: Thinned,
) -> Iterator[tuple[str, str, Callable[[float], Thinned], tuple[float, ...]]]:
    """Yield family, key, what the rows would be without a mistake of some size, and sizes to try."""
    size = rows.q.shape[1]

    def scale(joint: int | None, name: str) -> Callable[[float], Thinned]:
        names = ("tau",) if name == "tau" else ("q", "dq", "ddq")
        joint = None if joint is None else joint + 1
        return lambda x: rows._replace(**{key: _multiply(getattr(rows, key), joint, x) for key in names})

    def shift(joint: int) -> Callable[[float], Thinned]:
        return lambda x: rows._replace(q=rows.q - x * (np.arange(size) == joint))

    def swap(names: tuple[str, ...], order: list[int]) -> Callable[[float], Thinned]:
        return lambda _: rows._replace(**{key: getattr(rows, key)[:, order] for key in names})

    def advance(x: float) -> Thinned:
        tau, kept = rows.tau.copy(), rows.kept.copy()
        for run in np.unique(rows.run):
            own = np.flatnonzero(rows.run == run)
            time = np.arange(len(own)) * rows.period
            kept[own] &= ((time + x >= 0.0) & (time + x <= time[-1]))[:, None]
            for joint in range(size):
                tau[own, joint] = np.interp(time + x, time, rows.tau[own, joint])
        return rows._replace(tau=tau, kept=kept)

    yield "torque sign", "all", scale(None, "tau"), (-1.0,)
    yield "position sign", "all", scale(None, "q"), (-1.0,)
    yield "position unit", "all", scale(None, "q"), (np.pi / 180.0, 180.0 / np.pi)
    for joint in range(size):
        yield "torque sign", str(joint), scale(joint, "tau"), (-1.0,)
        yield "position sign", str(joint), scale(joint, "q"), (-1.0,)
        yield "position unit", str(joint), scale(joint, "q"), (np.pi / 180.0, 180.0 / np.pi)
        factors = (1e-3, 1e-2, 0.03, 0.1, 0.3, 3.0, 10.0, 30.0, 1e2, 1e3)
        yield "torque unit", f"{joint}+", scale(joint, "tau"), factors
        yield "zero", f"{joint}+", shift(joint), (-0.3, 0.3, -0.8, 0.8, -1.4, 1.4, np.pi)
    for one, other in combinations(range(size), 2):
        order = list(range(size))
        order[one], order[other] = other, one
        places = ("q", "dq", "ddq", "kept")
        for names in (("tau",), places, (*places, "tau")):
            yield "order", f"{one} {other} {len(names)}", swap(names, order), (1.0,)
    yield "delay", "+", advance, (-0.3, -0.1, -0.03, -0.01, 0.01, 0.03, 0.1, 0.3)
    times = (1 / 3, 0.5, 0.7, 0.85, 1.2, 1.4, 2.0, 3.0)
    yield "time", "+", lambda x: rows._replace(dq=rows.dq / x, ddq=rows.ddq / x**2), times


@dataclass(frozen=True, kw_only=True)
class Sight:
    """What a log shows of a mistake.

    Factors by which undoing it makes the squares fall, of the joints touched and pooled; the best change of
    another family, and how many times the squares of the true one it leaves; the mean residuals in percent.
    """

    touched_falls: float
    pooled_falls: float
    rival: str
    ratio: float
    clean: float
    wrong: float


def look(corruption: Corruption) -> Sight:
    """Return what the logs of a corruption show, by fits of its own."""
    model = OwnModel(corruption.clean)
    band = model.find_band(corruption.clean.runs)
    before = model.measure(thin(corruption.clean.runs, band))
    rows = thin(corruption.wrong.runs, band)
    after = model.measure(rows)
    touched = [joint - 1 for joint in corruption.joints] or list(range(len(after)))
    true, best = float(before.mean()), (float(after.mean()), "as it is")
    for family, key, change, sizes in list_candidates(rows):
        if family == corruption.family:
            continue

        def price(x: float, change: Callable[[float], Thinned] = change) -> float:
            return float(model.measure(change(x)).mean())

        left = [price(x) for x in sizes]
        place = int(np.argmin(left))
        best = min(best, (left[place], f"{family} {key}"))
        # A change of any size is refined where it could be the best.
        if "+" in key and left[place] < 4.0 * best[0]:
            ends = sorted((sizes[place] * 0.5, sizes[place] * 1.6))
            found = minimize_scalar(price, bounds=ends, method="bounded", options={"maxiter": 12})
            best = min(best, (float(found.fun), f"{family} {key}"))
    others = []
    if corruption.family != "gravity" and model.oblique:
        others.append(("gravity", model.measure_gravity(rows)))
    if corruption.family != "payload" and len(corruption.wrong.runs) > 1:
        each = [model.measure(rows._replace(kept=rows.kept & (rows.run == run)[:, None])) for run in (0, 1)]
        others.append(("payload", np.mean(each, axis=0)))
    best = min([best, *((float(left.mean()), name) for name, left in others)])
    tiny = 1e-12
    return Sight(
        touched_falls=float(after[touched].sum() / max(before[touched].sum(), tiny)),
        pooled_falls=float(after.mean() / max(true, tiny)),
        rival=best[1],
        ratio=best[0] / max(true, tiny),
        clean=100.0 * float(np.mean(np.sqrt(before))),
        wrong=100.0 * float(np.mean(np.sqrt(after))),
    )
