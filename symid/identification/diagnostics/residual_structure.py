"""What a model leaves of a log: the terms that it misses, and the residual within a band of frequencies.

Parameters, the library of their model, recordings -> `JointResidual` of each joint that moves ->
`ResidualFinding`s; a recording and a band -> `BandResidual`.

For every joint, families of functions that the model does not have are tried on the residual, one at a time.
What the model's own columns at that joint explain is taken out of residual and functions first (e', C'), and
reported as "other values". A family is measured on held-out blocks of time:

    share = 1 - sum over blocks b of |e'_b - C'_b k(without b)|^2 / |e'|^2

Within a band, by a zero-phase Butterworth low-pass L of order 4,

    e = L tau - L [Y | Yf] x,    relative residual of a joint: |e|_2 / |L tau|_2

L is applied at the full sample rate to the measured torque and to the torque that the states predict, so that
both are filtered alike. The states come from the position with the filter of the fit: a filter of the band
there too would smooth what dry friction does where a velocity changes its sign, and judge another model. Half
a second at either end is left out, where the filter extrapolates, and joints with friction that do not move,
because dry friction or a brake may hold any torque.

Supported: logs of the fit or held out, of any length: the equations of one joint are in memory at a time.
Not supported: terms of several joints at once, products of functions, two families together; residuals of
momentum rows: whatever the fit, those of torque rows are used.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, compute_triangle
from symid.codegen import JointCard, Library
from symid.errors import LogError, Notice
from symid.identification import regression
from symid.identification.estimators import Residual, compute_mean_relative
from symid.identification.judge import POLICY, numerics
from symid.identification.regression import condensing
from symid.logs import (
    Recording,
    Signals,
    decimate,
    decimate_blocks,
    low_pass,
    mask_decimated,
    mask_states,
    prepare_signals,
)
from symid.robot import Decimation, Processing
from symid.serialization import HIDDEN, name_key


class JointMotion(NamedTuple):
    """The motion of a joint in one log: its states, and the predicted torque `load`: (N,).

    `others` are velocity and acceleration (N,) of each other joint; `period` in s.
    """

    time: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    load: FloatArray
    others: list[tuple[FloatArray, FloatArray]]
    period: float


def pick_motion(states: Sequence[FloatArray], joint: int, load: FloatArray, period: float) -> JointMotion:
    """Return the motion of a joint from time (N,), q, dq and ddq (N, n)."""
    time, q, dq, ddq = states
    others = [(dq[:, k], ddq[:, k]) for k in range(q.shape[1]) if k != joint]
    return JointMotion(time, q[:, joint], dq[:, joint], ddq[:, joint], load, others, period)


class Family(NamedTuple):
    """Functions of a motion, and what it means when they explain a residual."""

    build: Callable[[JointMotion], list[FloatArray]]
    advice: str


OTHER_VALUES = "other values"
"""What the model's own columns explain; it has no functions of its own."""
FAMILIES: dict[str, Family] = {
    OTHER_VALUES: Family(
        lambda _: [],
        "the other joints or logs contradict these values: a term is missing, a torque has a wrong factor, "
        "or the robot changed",
    ),
    "position": Family(
        lambda m: [m.q, m.q**2, np.sin(m.q), np.cos(m.q), np.sin(2.0 * m.q), np.cos(2.0 * m.q)],
        "check for a spring or counterbalance ([joint.spring]), a cable, the gravity vector and the zero of "
        "the angle",
    ),
    "velocity": Family(
        lambda m: [np.abs(m.dq) * m.dq, m.dq**3, np.abs(m.dq), np.sign(m.dq)],
        "the friction law is not the right one: --friction auto chooses one for each joint",
    ),
    "slow motion": Family(
        lambda m: [
            np.sign(m.dq) * np.exp(-((m.dq / (part * (float(np.abs(m.dq).max()) or 1.0))) ** 2))
            for part in (0.02, 0.08)
        ],
        "choose friction laws with --friction auto, or leave slow samples out (processing.standstill)",
    ),
    "load": Family(
        lambda m: [np.abs(m.load) * np.sign(m.dq), np.abs(m.load) * m.dq],
        "friction depends on the load of the gear: --friction auto tries such laws",
    ),
    "scale": Family(
        lambda m: [m.load], "the torque has a wrong factor: check torque constant and gear of this joint"
    ),
    "acceleration": Family(
        lambda m: [m.ddq], 'an inertia is missing: a rotor ([joint.drive] rotor_inertia = "unknown")'
    ),
    "delay": Family(
        lambda m: [np.gradient(m.load, m.period)],
        "torque and motion are not simultaneous: `symid check ROBOT LOG` estimates the delay",
    ),
    "other joints": Family(
        lambda m: [x for dq, ddq in m.others for x in (dq, np.sign(dq), ddq)],
        "a drive also turns with other joints ([[coupling]]), or torque channels influence each other",
    ),
    "time": Family(
        lambda m: [m.time - m.time[0], (m.time - m.time[0]) * np.sign(m.dq)],
        "friction or the torque offset drifts: warm the robot up first, or use shorter logs",
    ),
}
"""By name: functions of a joint's motion that its residual is tried on."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointResidual:
    """The residual of one joint.

    `error` (m,) is weighted and `plain` (m,) is not, `roots` (m,) are those of the weights, of mean square
    one; `model` (m, p) columns of the model, weighted; `blocks` (m,) number of the block of time of each row.
    `motions` of the logs are at full rate; rows are decimated, and one in `step` of them is taken.
    """

    error: FloatArray
    plain: FloatArray
    roots: FloatArray
    model: FloatArray
    blocks: NDArray[np.intp]
    motions: tuple[JointMotion, ...]
    decimation: Decimation
    step: int

    def evaluate(self, build: Callable[[JointMotion], list[FloatArray]]) -> FloatArray:
        """Return functions of the motions as rows (m, k), not weighted; (0, 0) if there are none."""
        parts = []
        for motion in self.motions:
            columns = [decimate(column, self.decimation)[:: self.step] for column in build(motion)]
            parts.append(np.column_stack(columns) if columns else np.empty((0, 0)))
        return np.vstack(parts)


def compute_joint_residuals(
    values: FloatArray,
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    weights: Sequence[float] | None = None,
    largest: float = numerics.LARGEST,
) -> Iterator[tuple[JointCard, JointResidual]]:
    """Yield every joint that moves in one of the logs, with its residual; as `analyse_residuals`."""
    processing = regression.choose_filters(processing, recordings).processing
    rows = sum(len(entry.time) for entry in recordings) / processing.decimation.factor
    step = max(1, math.ceil(8.0 * rows * (len(values) + 1) / largest))
    logs = []
    for recording, weight in zip(recordings, weights or [1.0] * len(recordings), strict=True):
        signals = regression.prepare_states(library, recording, processing)
        predicted = regression.evaluate_torques(library, signals, values)
        logs.append((signals, predicted, weight, regression.list_resting_joints(recording)))
    for joint, card in enumerate(library.card.joints):
        moving = [entry for entry in logs if joint not in entry[-1]]
        if not moving:
            continue
        tables = [_tabulate(library, entry[0], joint, processing.decimation, step) for entry in moving]
        lengths = [len(table) for table in tables]
        squares = np.repeat(np.asarray([weight for *_, weight, _ in moving], dtype=float), lengths)
        roots: FloatArray = np.sqrt(squares / squares.mean())
        plain = np.concatenate([table[:, -1] - table[:, :-1] @ values for table in tables])
        table = np.vstack(tables) * roots[:, None]
        error = plain * roots
        # Rounding has no structure.
        if float(error @ error) <= 1e-20 * float(table[:, -1] @ table[:, -1]):
            error = np.zeros_like(error)
        found = JointResidual(
            error=error,
            plain=plain,
            roots=roots,
            model=table[:, :-1],
            # All logs are cut alike, so that each block holds a part of every log.
            blocks=np.concatenate([np.arange(length) * _BLOCKS // length for length in lengths]),
            motions=tuple(
                pick_motion((one.time, one.q, one.dq, one.ddq), joint, predicted[:, joint], one.period)
                for one, predicted, *_ in moving
            ),
            decimation=processing.decimation,
            step=step,
        )
        yield card, found


def _tabulate(
    library: Library, signals: Signals, joint: int, decimation: Decimation, step: int
) -> FloatArray:
    """Return [Y | Yf] of a joint and its torque: (M, p + 1)."""

    def evaluate(part: slice) -> FloatArray:
        rows = regression.evaluate_columns(library, *signals.pick_states(part))
        return np.column_stack([rows[:, joint], signals.tau[part, joint]])

    blocks = decimate_blocks(evaluate, len(signals.time), decimation)
    table = np.vstack([rows[-part.start % step :: step] for part, rows in blocks])
    if signals.bad is not None:
        # Samples that are wrong have no residual.
        table[mask_decimated(signals.bad, decimation)[::step, joint]] = 0.0
    return table


_BLOCKS = POLICY.folds * POLICY.parts
"""Blocks of time that are held out in turn."""
_LEAST = 0.05
"""Part of a residual's square below which a family is not reported."""


@dataclass(frozen=True, slots=True)
class ResidualFinding:
    """A family of functions, key of `FAMILIES`, that explains part of a joint's residual.

    `share_percent` is on held-out blocks, of the square of what the model's own columns leave of the residual
    (of all of it for "other values"), `rms` of what it explains, in `unit`.
    """

    joint: str
    family: str = field(metadata=name_key("follows"))
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


@dataclass(frozen=True, slots=True, eq=False)
class JointProfiles:
    """The residual of a joint, in `unit`, against its position, its velocity and the predicted torque."""

    joint: str
    unit: str
    position_unit: str
    position: Profile
    velocity: Profile
    load: Profile


def analyse_residuals(
    values: FloatArray,
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    weights: Sequence[float] | None = None,
    largest: float = numerics.LARGEST,
) -> tuple[tuple[ResidualFinding, ...], tuple[JointProfiles, ...]]:
    """Return the families that explain at least 5 % of a joint's squared residual, and its profiles.

    `values` (p,) are base parameters and friction; `weights` those of each log's squared residuals, one if
    None. Where a joint's equations take more than `largest` bytes, one row in some is used.
    """
    residuals = compute_joint_residuals(
        values, library, recordings, processing, weights=weights, largest=largest
    )
    findings, profiles = [], []
    for card, residual in residuals:
        table = residual.evaluate(lambda motion: [motion.q, motion.dq, motion.load])
        drawn = [compute_profile(column, residual.plain) for column in table.T]
        profiles.append(JointProfiles(card.name, card.torque_unit, card.position_unit, *drawn))
        size = float(residual.error @ residual.error)
        if not size:
            continue
        # An orthonormal basis (m, r) of the model's columns.
        lengths = np.linalg.norm(residual.model, axis=0)
        alive = lengths > 1e-12 * max(lengths.max(initial=0.0), numerics.TINY)
        left, singular, _ = np.linalg.svd(residual.model[:, alive] / lengths[alive], full_matrices=False)
        span = left[:, singular > 1e-9 * max(singular.max(initial=0.0), numerics.TINY)]
        new = residual.error - span @ (span.T @ residual.error)
        gain = _measure_gain(span, residual.error, residual.blocks)
        # Family, share, squares explained.
        found = [(OTHER_VALUES, gain / size, gain)]
        for name, family in FAMILIES.items():
            functions = residual.evaluate(family.build)
            if not functions.shape[1]:
                continue
            functions *= residual.roots[:, None]
            lengths = np.linalg.norm(functions, axis=0)
            scaled = functions[:, lengths > numerics.TINY] / lengths[lengths > numerics.TINY]
            # What the model's columns do not explain, as an orthonormal set.
            left, singular, _ = np.linalg.svd(scaled - span @ (span.T @ scaled), full_matrices=False)
            gain = _measure_gain(left[:, singular**2 > numerics.CONVERGED], new, residual.blocks)
            if gain > POLICY.relevance * size:
                found.append((name, gain / float(new @ new), gain))
        for name, share, gain in sorted(found, key=lambda entry: -entry[2]):
            if share >= _LEAST:
                rms = float(np.sqrt(gain / len(residual.error)))
                findings.append(ResidualFinding(card.name, name, 100.0 * share, rms, card.torque_unit))
    return tuple(findings), tuple(profiles)


def _measure_gain(functions: FloatArray, error: FloatArray, blocks: NDArray[np.intp]) -> float:
    """Return the part of |error|^2 that the functions explain of held-out blocks."""
    if not functions.shape[1]:
        return 0.0
    table = np.column_stack([functions, error])
    # A triangle has the squares of its block, at a fraction of the size.
    triangles = [compute_triangle(table[blocks == block]) for block in range(_BLOCKS)]
    left = 0.0
    for held in range(_BLOCKS):
        others = np.vstack([triangles[block] for block in range(_BLOCKS) if block != held])
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


_ORDER = 4
_FEWEST = 20
"""Samples that must be left."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandResidual(FrozenArrays):
    """The residual of a model on a log within a band in Hz, of each joint that counts.

    `std` of `joints` is the root mean square, `range_percent` that over the range of the measured torque;
    `stacked_percent` is of all joints as one vector, None for one joint and where units differ. `measured`
    and `predicted` (N, n) are the torques behind it at `time` (N,) s, both low-passed, in N m or N on the
    joint side, the former without the torque of a known payload.
    """

    joints: tuple[Residual, ...]
    range_percent: tuple[float, ...]
    band: float
    stacked_percent: float | None = None
    time: FloatArray = field(metadata=HIDDEN)
    measured: FloatArray = field(metadata=HIDDEN)
    predicted: FloatArray = field(metadata=HIDDEN)

    @property
    def mean_relative_percent(self) -> float:
        """Return the plain mean over joints of the relative residuals, in percent."""
        return compute_mean_relative(self.joints)


def compute_band_residual(
    values: FloatArray, library: Library, recording: Recording, processing: Processing, *, band: float
) -> BandResidual:
    """Return what a model leaves of the torques of `recording` below `band` Hz.

    `values` (p,) are base parameters and friction. Of `processing` the filter of the positions is used,
    chosen from the log if left open, and the samples cut at either end.
    """
    processing = regression.choose_filters(processing, [recording]).processing
    resting = regression.list_resting_joints(recording)
    recording = replace(recording, bad=mask_states(recording, processing))
    signals = regression.hold_resting_joints(prepare_signals(recording, processing), resting)
    left = round(condensing.ENDS / signals.period)
    if len(signals.time) < 2 * left + _FEWEST:
        text = f"{len(signals.time) * signals.period:.3g} s are left of the log, too few for a comparison "
        text += f"within a band that leaves out {condensing.ENDS:g} s at either end; cut off less, or log "
        text += "longer"
        raise LogError(Notice(code="validate.short-log", text=text, file=recording.source))
    kept, cards = slice(left, len(signals.time) - left), library.card.joints
    torque = recording.torque[processing.drop_first :][: len(signals.time)]
    load = regression.compute_payload_torque(library, signals, recording)
    torque = torque if load is None else torque - load
    found = regression.evaluate_torques(library, signals, values)
    if signals.bad is not None:
        found = np.where(signals.bad, torque, found)
    measured, predicted = (
        low_pass(torques, period=signals.period, cutoff=band, order=_ORDER)[kept]
        for torques in (torque, found)
    )
    errors, joints, ranges = measured - predicted, list[Residual](), list[float]()
    counted = [k for k, card in enumerate(cards) if k not in resting or card.friction == "none"]
    for k in counted:
        spread, unit = float(np.ptp(measured[:, k])), cards[k].torque_unit
        joints.append(Residual.measure(cards[k].name, errors[:, k], measured[:, k], unit))
        ranges.append(100.0 * joints[-1].std / spread if spread else float("inf"))
    whole, rest = (float(np.linalg.norm(part[:, counted])) for part in (measured, errors))
    alike = len(joints) > 1 and len({entry.unit for entry in joints}) == 1 and whole > 0.0
    return BandResidual(
        joints=tuple(joints),
        range_percent=tuple(ranges),
        band=band,
        stacked_percent=100.0 * rest / whole if alike else None,
        time=signals.time[kept],
        measured=measured,
        predicted=predicted,
    )
