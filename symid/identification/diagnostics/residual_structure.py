"""Structure in the residual: which term the model misses, and where it acts.

Parameters, the library of their model, recordings -> `JointResidual` of each joint that moves ->
`ResidualFinding`s, notices.

For every joint, families of functions that a robot may have and its model has not are tried on the
residual, one family at a time: functions of the joint's position, velocity, load, acceleration, of the
other joints' motion, of time. What the model's own columns at that joint can make up for is taken out of
residual and functions first (e', C'), so that only what is new counts; how much the columns themselves
explain is told as "other values". The measure is the part of the residual's square that a family explains
of held-out stretches of time, so that a family of many functions is no better for it:

    share = 1 - sum over blocks b of |e'_b - C'_b k(without b)|^2 / |e'|^2

Supported: torque residuals of one log or several, of the fit or held out, of any length: the equations of
one joint are in memory at a time, and where they take too much of it only one in some of them.
Not supported: terms of several joints at once, products of functions, two families together; residuals of
momentum rows: whatever the fit, those of torque rows are looked at.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import JointCard, Library
from symid.errors import Notice
from symid.identification.regression import (
    choose_filters,
    evaluate_columns,
    evaluate_torques,
    hold_resting_joints,
    list_resting_joints,
    subtract_payload_torque,
)
from symid.logs import Recording, Signals, decimate, decimate_blocks, prepare_signals
from symid.robot import Decimation, Processing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointMotion:
    """Signals of one log at full rate, with the torque that the model predicts; `joint` is looked at."""

    signals: Signals
    predicted: FloatArray
    joint: int

    @property
    def q(self) -> FloatArray:
        """Return the position of the joint."""
        return self.signals.q[:, self.joint]

    @property
    def dq(self) -> FloatArray:
        """Return the velocity of the joint."""
        return self.signals.dq[:, self.joint]

    @property
    def load(self) -> FloatArray:
        """Return the torque foretold at the joint."""
        return self.predicted[:, self.joint]

    @property
    def others(self) -> list[int]:
        """Return the indices of the other joints."""
        return [k for k in range(self.signals.q.shape[1]) if k != self.joint]


@dataclass(frozen=True, slots=True)
class Family:
    """Functions of a motion, and what it means when they explain a residual."""

    build: Callable[[JointMotion], list[FloatArray]]
    advice: str


def _build_bumps(motion: JointMotion) -> list[FloatArray]:
    speed = np.abs(motion.dq)
    top = float(speed.max()) or 1.0
    return [np.sign(motion.dq) * np.exp(-((speed / (part * top)) ** 2)) for part in (0.02, 0.08)]


OTHER_VALUES = "other values"
"""What the model's own columns explain; it has no functions of its own."""
FAMILIES: dict[str, Family] = {
    OTHER_VALUES: Family(
        lambda _: [],
        "the model's own terms would explain it with other values, which other joints or logs contradict: a "
        "term is missing there, a torque is off by a factor, or the robot changed",
    ),
    "position": Family(
        lambda m: [m.q, m.q**2, np.sin(m.q), np.cos(m.q), np.sin(2.0 * m.q), np.cos(2.0 * m.q)],
        "a torque that depends on the joint's position: a spring or counterbalance ([joint.spring]), a "
        "cable, a wrong gravity vector or zero of the angle",
    ),
    "velocity": Family(
        lambda m: [np.abs(m.dq) * m.dq, m.dq**3, np.abs(m.dq), np.sign(m.dq)],
        'friction that is curved or differs with the direction: model = "cubic" or "asymmetric" of '
        "[joint.friction]; --rows friction --model auto compares laws",
    ),
    "slow motion": Family(
        _build_bumps,
        'friction that changes near standstill: model = "stribeck" of [joint.friction], or leave slow rows '
        "out (processing.standstill)",
    ),
    "load": Family(
        lambda m: [np.abs(m.load) * np.sign(m.dq), np.abs(m.load) * m.dq],
        "friction that grows with the load of the gear: no model of [joint.friction] has it; deviations are "
        "larger than stated, and loads beyond those of the log are foretold badly",
    ),
    "scale": Family(
        lambda m: [m.load],
        "torques off by a factor: check the torque constant or gear of this joint against the others",
    ),
    "acceleration": Family(
        lambda m: [m.signals.ddq[:, m.joint]],
        'an inertia that the model lacks: a rotor ([joint.drive] rotor_inertia = "unknown")',
    ),
    "delay": Family(
        lambda m: [np.gradient(m.load, m.signals.period)],
        "torque and motion are not simultaneous: `symid check ROBOT LOG` measures the delay",
    ),
    "other joints": Family(
        lambda m: [x[:, k] for k in m.others for x in (m.signals.dq, np.sign(m.signals.dq), m.signals.ddq)],
        "a drive that turns with other joints too ([[coupling]]), or a torque channel that sees another one",
    ),
    "time": Family(
        lambda m: [m.signals.time - m.signals.time[0], (m.signals.time - m.signals.time[0]) * np.sign(m.dq)],
        "a drift: the robot warms up, or the torque's zero moves; warm it up first, or use shorter logs",
    ),
}
"""By name: functions of a joint's motion that its residual is tried on."""


HELD_OUT_BLOCKS = 8
"""Stretches of time that are held out in turn."""
LARGEST = 2e8
"""Bytes of a joint's equations that are held in memory."""
_TINY = 1e-300


class _Thinning(NamedTuple):
    """How columns become fewer rows: decimated, and one in `step` of the rows taken."""

    decimation: Decimation
    step: int

    def apply(self, columns: Sequence[FloatArray]) -> FloatArray:
        """Return columns (N,), one after the other: (M, k)."""
        if not columns:
            return np.empty((0, 0))
        return np.column_stack([decimate(column, self.decimation)[:: self.step] for column in columns])


class _PredictedLog(NamedTuple):
    """Signals, the torque foretold at every sample (N, n), and what the squares of residuals count for."""

    library: Library
    signals: Signals
    predicted: FloatArray
    weight: float

    def tabulate(self, joint: int, thinning: _Thinning) -> FloatArray:
        """Return [Y | Yf] of a joint and its torque: (M, p + 1)."""

        def evaluate(part: slice) -> FloatArray:
            signals = self.signals
            rows = evaluate_columns(self.library, signals.q[part], signals.dq[part], signals.ddq[part])
            return np.column_stack([rows[:, joint], signals.tau[part, joint]])

        blocks = decimate_blocks(evaluate, len(self.signals.time), thinning.decimation)
        return np.vstack([rows[-part.start % thinning.step :: thinning.step] for part, rows in blocks])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointResidual:
    """What is left of one joint.

    Args:
        error: (m,) torque that is left, weighed; plain: (m,) not weighed.
        roots: (m,) of the weights, of mean square one.
        span: (m, r) orthonormal basis of the model's columns, weighed.
        blocks: (m,) stretch of time of each row, `HELD_OUT_BLOCKS` of them.
        motions: of the logs, at full rate; thinning: what made rows of them.
    """

    error: FloatArray
    plain: FloatArray
    roots: FloatArray
    span: FloatArray
    blocks: NDArray[np.intp]
    motions: tuple[JointMotion, ...]
    thinning: _Thinning

    def thin_out(self, build: Callable[[JointMotion], list[FloatArray]]) -> FloatArray:
        """Return functions of the motions as rows (m, k), not weighed."""
        return np.vstack([self.thinning.apply(build(motion)) for motion in self.motions])


def compute_joint_residuals(
    values: FloatArray,
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    weights: Sequence[float] | None = None,
    largest: float = LARGEST,
) -> Iterator[tuple[JointCard, JointResidual]]:
    """Yield every joint that moves in one of the logs, with what is left of its torque.

    Args:
        values: (p,) base parameters and friction, in the order of the library's card.
        library: the functions of the robot.
        recordings: logs, of the fit or held out.
        processing: filter and decimation.
        weights: what the squares of each log's residuals count for; one if None.
        largest: bytes of a joint's equations.
    """
    processing = choose_filters(processing, recordings).processing
    rows = sum(len(entry.time) for entry in recordings) / processing.decimation.factor
    step = max(1, math.ceil(8.0 * rows * (len(values) + 1) / largest))
    thinning = _Thinning(processing.decimation, step)
    logs = []
    for recording, weight in zip(recordings, weights or [1.0] * len(recordings), strict=True):
        resting = list_resting_joints(recording)
        signals = hold_resting_joints(prepare_signals(recording, processing), resting)
        signals = subtract_payload_torque(library, signals, recording)
        logs.append(
            (
                _PredictedLog(library, signals, evaluate_torques(library, signals, values), weight),
                set(resting),
            )
        )
    for joint, card in enumerate(library.card.joints):
        moving = [log for log, resting in logs if joint not in resting]
        if moving:
            yield card, _compute_joint_residual(values, moving, joint, thinning)


def _compute_joint_residual(
    values: FloatArray, logs: Sequence[_PredictedLog], joint: int, thinning: _Thinning
) -> JointResidual:
    parts = [log.tabulate(joint, thinning) for log in logs]
    roots = _compute_roots([log.weight for log in logs], [len(part) for part in parts])
    plain = np.concatenate([part[:, -1] - part[:, :-1] @ values for part in parts])
    table = np.vstack(parts) * roots[:, None]
    error = plain * roots
    # What rounding leaves has no structure.
    if float(error @ error) <= 1e-20 * float(table[:, -1] @ table[:, -1]):
        error = np.zeros_like(error)
    return JointResidual(
        error=error,
        plain=plain,
        roots=roots,
        span=_compute_span(table[:, :-1]),
        blocks=_number_blocks([len(part) for part in parts]),
        motions=tuple(JointMotion(signals=log.signals, predicted=log.predicted, joint=joint) for log in logs),
        thinning=thinning,
    )


def _compute_roots(weights: Sequence[float], lengths: Sequence[int]) -> FloatArray:
    """Return the roots of the logs' weights, row by row, scaled so that their mean square is one."""
    weight = np.repeat(np.asarray(weights, dtype=float), lengths)
    roots: FloatArray = np.sqrt(weight / weight.mean())
    return roots


def _compute_span(model: FloatArray) -> FloatArray:
    """Return an orthonormal basis (m, r) of the columns."""
    lengths = np.linalg.norm(model, axis=0)
    alive = lengths > 1e-12 * max(lengths.max(initial=0.0), _TINY)
    left, singular, _ = np.linalg.svd(model[:, alive] / lengths[alive], full_matrices=False)
    return np.asarray(left[:, singular > 1e-9 * max(singular.max(initial=0.0), _TINY)])


def _number_blocks(lengths: Sequence[int]) -> NDArray[np.intp]:
    """Return the block of each row, the logs cut alike, so that each block holds a part of every log."""
    return np.concatenate([np.arange(length) * HELD_OUT_BLOCKS // length for length in lengths])


_LEAST_PERCENT = 5.0
_LEAST_GAIN = 0.03
"""Part of the whole residual's square below which a family is not worth a word."""
_NEW = 1e-6
"""Squared part of a function that the model's columns must leave for it to count as new."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualFinding:
    """A family of functions that explains part of a joint's residual.

    Args:
        joint: name; family: key of `FAMILIES`.
        share_percent: on stretches not fitted, of the square of what the model's own columns leave of the
            residual; of all of it for "other values".
        rms: root mean square of what it explains, in `unit`.
    """

    joint: str
    family: str
    share_percent: float
    rms: float
    unit: str

    @property
    def advice(self) -> str:
        """Return what the family means, and what to do."""
        return FAMILIES[self.family].advice


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """A residual against another quantity: mean and deviation over equal numbers of samples."""

    centre: FloatArray
    mean: FloatArray
    deviation: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointProfiles:
    """The residual of a joint, in `unit`, against its position, its velocity and the torque foretold."""

    joint: str
    unit: str
    position_unit: str
    position: Profile
    velocity: Profile
    load: Profile


def analyse_structure(
    values: FloatArray,
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    weights: Sequence[float] | None = None,
    least_percent: float = _LEAST_PERCENT,
    largest: float = LARGEST,
) -> tuple[ResidualFinding, ...]:
    """Return the families that explain at least `least_percent` of a joint's residual, joint by joint.

    Args:
        values: (p,) base parameters and friction, in the order of the library's card.
        library: the functions of the robot.
        recordings: logs, of the fit or held out.
        processing: filter and decimation.
        weights: what the squares of each log's residuals count for; one if None.
        least_percent: of the residual's square.
        largest: bytes of a joint's equations; of longer logs, one in some of them is looked at.
    """
    found: list[ResidualFinding] = []
    residuals = compute_joint_residuals(
        values, library, recordings, processing, weights=weights, largest=largest
    )
    for card, residual in residuals:
        found += [
            ResidualFinding(
                joint=card.name,
                family=name,
                share_percent=100.0 * share,
                rms=float(np.sqrt(gain / len(residual.error))),
                unit=card.torque_unit,
            )
            for name, share, gain in _try_families(residual)
            if 100.0 * share >= least_percent
        ]
    return tuple(found)


def compute_profiles(
    values: FloatArray, library: Library, recordings: Sequence[Recording], processing: Processing
) -> tuple[JointProfiles, ...]:
    """Return the residual of every joint that moves against position, velocity and load.

    Arguments as for `analyse_structure`.
    """
    found = []
    for card, residual in compute_joint_residuals(values, library, recordings, processing):
        table = residual.thin_out(lambda motion: [motion.q, motion.dq, motion.load])
        position, velocity, load = (compute_profile(column, residual.plain) for column in table.T)
        found.append(
            JointProfiles(
                joint=card.name,
                unit=card.torque_unit,
                position_unit=card.position_unit,
                position=position,
                velocity=velocity,
                load=load,
            )
        )
    return tuple(found)


def _try_families(residual: JointResidual) -> list[tuple[str, float, float]]:
    """Return (family, share, squares explained), the most first."""
    size = float(residual.error @ residual.error)
    if not size:
        return []
    new = residual.error - residual.span @ (residual.span.T @ residual.error)
    gain = _measure_gain(residual.span, residual.error, residual.blocks)
    found = [(OTHER_VALUES, gain / size, gain)]
    for name, family in FAMILIES.items():
        functions = residual.thin_out(family.build)
        if not functions.shape[1]:
            continue
        functions *= residual.roots[:, None]
        gain = _measure_gain(_remove_model_columns(functions, residual.span), new, residual.blocks)
        if gain > _LEAST_GAIN * size:
            found.append((name, gain / float(new @ new), gain))
    return sorted(found, key=lambda entry: -entry[2])


def _remove_model_columns(functions: FloatArray, span: FloatArray) -> FloatArray:
    """Return what the model's columns cannot make up for, an orthogonal set scaled to length one."""
    lengths = np.linalg.norm(functions, axis=0)
    scaled = functions[:, lengths > _TINY] / lengths[lengths > _TINY]
    left, singular, _ = np.linalg.svd(scaled - span @ (span.T @ scaled), full_matrices=False)
    return np.asarray(left[:, singular**2 > _NEW])


def _measure_gain(functions: FloatArray, error: FloatArray, blocks: NDArray[np.intp]) -> float:
    """Return the part of |error|^2 that the functions explain of blocks they were not fitted to."""
    if not functions.shape[1]:
        return 0.0
    table = np.column_stack([functions, error])
    # A triangle has the squares of its block, at a fraction of the size.
    triangles = [
        np.asarray(np.linalg.qr(table[blocks == block], mode="r")) for block in range(HELD_OUT_BLOCKS)
    ]
    left = 0.0
    for held in range(HELD_OUT_BLOCKS):
        others = np.vstack([triangles[block] for block in range(HELD_OUT_BLOCKS) if block != held])
        factors = np.linalg.lstsq(others[:, :-1], others[:, -1], rcond=1e-10)[0]
        rest = triangles[held][:, -1] - triangles[held][:, :-1] @ factors
        left += float(rest @ rest)
    return max(0.0, float(error @ error) - left)


def compute_profile(x: FloatArray, error: FloatArray, bins: int = 24) -> Profile:
    """Return mean and deviation of `error` (N,) over `bins` groups of equal size, ordered by `x` (N,)."""
    groups = [group for group in np.array_split(np.argsort(x, kind="stable"), bins) if len(group)]
    return Profile(
        centre=np.array([x[group].mean() for group in groups]),
        mean=np.array([error[group].mean() for group in groups]),
        deviation=np.array([error[group].std() for group in groups]),
    )


def warn_of_structure(
    values: FloatArray,
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    weights: Sequence[float] | None = None,
) -> tuple[Notice, ...]:
    """Return a notice for every joint whose residual a missing term explains, naming the likeliest.

    Arguments as for `analyse_structure`.
    """
    first: dict[str, ResidualFinding] = {}
    found = analyse_structure(values, library, recordings, processing, weights=weights)
    # A term that is missing says more than values that do not fit, which may be its doing.
    for finding in sorted(found, key=lambda entry: entry.family == OTHER_VALUES):
        first.setdefault(finding.joint, finding)
    return tuple(
        Notice(
            code="identify.structure",
            text=f"joint {finding.joint!r}: {finding.share_percent:.3g} % of the square of "
            f"{'the residual' if finding.family == OTHER_VALUES else 'what the model cannot explain'} "
            f"({finding.rms:.3g} {finding.unit}) follows {finding.family}: {finding.advice}",
        )
        for finding in first.values()
    )
