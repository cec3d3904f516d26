"""A small model of the logs within the scoring band, fitted in milliseconds, to try what-ifs on.

Library, recordings, settings -> `QuickLogs`: states and torques, low-passed and thinned -> `QuickResult`s.

    columns    evaluated along the low-passed states themselves (products of states are not low-passed again)
    held out   as for `stretches`: every stretch predicted by the others, joints alike
    impossible joints whose friction drives them, or whose inertia is negative

Friction of joint j drives it where mean(tau_f dq) < 0, its inertia is negative where mean(M_jj ddq^2) < 0,
both by more than five deviations of the jackknife and two percent of what the torque would do.

Supported: several logs, known payloads, joints at rest. Not supported: logs of different sample rates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification.diagnostics.stretches import (
    ENDS,
    PART,
    compute_jackknife,
    count_stretches,
    solve_sums,
)
from symid.identification.regression import evaluate_columns, list_resting_joints, prepare_states
from symid.joint_models import REFERENCE_TEMPERATURE
from symid.logs import Recording, low_pass
from symid.robot import Processing

_RATE = 4.0
"""Times the scoring band: rate of the samples that are kept."""
_MOST = 3000
"""Samples of all logs together."""
_ORDER = 4
PARTS = 4
"""Of every held-out stretch, whose squares are compared."""
_SURE = 5.0
_CLEAR = 0.02
_SLOW = 0.05
"""Of the top speed: rows below count for nothing where a joint has friction."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuickLogs:
    """Samples of all logs, one after the other.

    Args:
        q, dq, ddq, tau: (T, n); kept: (T, n) whether a joint's row counts.
        stretch: (T,) number of its stretch; run: (T,) of its log.
        period: s, between samples; friction: whether every joint gets viscous and dry friction of its own.
        transmission: (n, n) angles of the motors over those of the joints, None where each moves one joint.
    """

    library: Library
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau: FloatArray
    kept: NDArray[np.bool_]
    stretch: NDArray[np.intp]
    run: NDArray[np.intp]
    period: float
    friction: bool = False
    transmission: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuickResult:
    """A fit: parameters (p,), and those without each stretch (s, p).

    `moving` (k,) are the joints that have rows with a torque; `held_out`, `fitted` (k,) their residuals in
    percent of held-out and of all samples, `losses` (w, k) the squares of the parts of held-out stretches
    relative to the whole torque.
    """

    moving: tuple[int, ...]
    held_out: FloatArray
    fitted: FloatArray
    values: FloatArray
    folds: FloatArray
    losses: FloatArray

    @property
    def percent(self) -> float:
        """Return the mean over joints of what is left unexplained of held-out samples, in percent."""
        return float(np.mean(self.held_out))


def build_quick_logs(
    library: Library, recordings: Sequence[Recording], processing: Processing, scoring: float
) -> QuickLogs:
    """Return the samples of recordings within the `scoring` band in Hz; `processing` has its ends cut."""
    parts = []
    length = sum(entry.time[-1] - entry.time[0] for entry in recordings)
    rate = min(_RATE * scoring, _MOST / max(length, 1e-9))
    each, count = count_stretches(len(recordings)), 0
    friction = np.array([joint.friction != "none" for joint in library.card.joints])
    for run, recording in enumerate(recordings):
        cutoff = min(scoring, 0.4 / recording.period)
        settings = replace(processing, filter_cutoff=cutoff, automatic=False)
        signals = prepare_states(library, recording, settings)
        tau = low_pass(signals.tau, period=signals.period, cutoff=cutoff, order=_ORDER)
        step = max(1, round(1.0 / (rate * signals.period)))
        ends = round(min(ENDS / signals.period, PART * len(signals.time)))
        places = np.arange(ends, len(signals.time) - ends, step)
        speed = np.abs(signals.dq[places])
        slow = speed < _SLOW * np.quantile(speed, 0.99, axis=0)
        kept = ~(slow & friction)
        resting = np.isin(np.arange(library.card.size), list_resting_joints(recording)) & friction
        kept[:, resting] = False
        stretch = count + np.arange(len(places)) * each // max(len(places), 1)
        count += each
        table = [part[places] for part in (signals.q, signals.dq, signals.ddq, tau)]
        parts.append((*table, kept, stretch, np.full(len(places), run)))
    q, dq, ddq, tau, kept, stretch, runs = (np.concatenate(column) for column in zip(*parts, strict=True))
    return QuickLogs(
        library=library,
        q=q,
        dq=dq,
        ddq=ddq,
        tau=tau,
        kept=kept,
        stretch=stretch,
        run=runs,
        period=step * recordings[-1].period,
        transmission=recordings[0].transmission,
    )


def fit_quick(logs: QuickLogs) -> QuickResult:
    """Return the fit of all samples, and what fits without each stretch predict of it."""
    sums = _sum_parts(logs, _evaluate(logs))
    count, _, joints, _, _ = sums.shape
    stretches = sums.sum(axis=1)
    whole = stretches.sum(axis=0)
    size = np.where(whole[:, -1, -1] > 0.0, whole[:, -1, -1], 1.0)
    weights = 1.0 / size
    for _ in range(2):
        values = solve_sums(whole, weights)
        weights = 1.0 / np.maximum(_compute_left(values, whole), 1e-6 * size)
    values = solve_sums(whole, weights)
    folds = solve_sums(whole - stretches, weights)
    pairs = np.column_stack([folds, -np.ones(count)])[:, None, None]
    left = ((sums @ pairs[..., None])[..., 0] * pairs).sum(axis=-1)
    squares = np.maximum(left, 0.0).reshape(-1, joints)
    moving = whole[:, -1, -1] > 0.0
    return QuickResult(
        moving=tuple(np.flatnonzero(moving).tolist()),
        held_out=100.0 * np.sqrt(squares.sum(axis=0) / size)[moving],
        fitted=100.0 * np.sqrt(np.maximum(_compute_left(values, whole), 0.0) / size)[moving],
        values=values,
        folds=folds,
        losses=(squares / size)[:, moving],
    )


def _evaluate(logs: QuickLogs) -> FloatArray:
    """Return the columns (T, n, p), of added friction too."""
    q, dq, ddq = (np.ascontiguousarray(part) for part in (logs.q, logs.dq, logs.ddq))
    columns = evaluate_columns(
        logs.library, q, dq, ddq, np.zeros_like(q), np.full_like(q, REFERENCE_TEMPERATURE)
    )
    if logs.friction:
        each = np.arange(dq.shape[1])
        added = np.zeros((*dq.shape, 2 * dq.shape[1]))
        added[:, each, each], added[:, each, each + len(each)] = dq, np.sign(dq)
        columns = np.concatenate([columns, added], axis=2)
    return columns


def _sum_parts(logs: QuickLogs, columns: FloatArray) -> FloatArray:
    """Return the sums (s, parts, n, p + 1, p + 1) of products of columns and torque."""
    table = np.concatenate([columns, logs.tau[:, :, None]], axis=2) * logs.kept[:, :, None]
    count = int(logs.stretch.max()) + 1
    sums = []
    for place in range(count):
        for part in np.array_split(np.flatnonzero(logs.stretch == place), PARTS):
            # (n, rows, p + 1)
            block = np.ascontiguousarray(np.swapaxes(table[part], 0, 1))
            sums.append(np.swapaxes(block, 1, 2) @ block)
    return np.stack(sums).reshape(count, PARTS, *sums[0].shape)


def _compute_left(values: FloatArray, sums: FloatArray) -> FloatArray:
    """Return the squares (n,) that parameters (p,) leave of sums (n, p + 1, p + 1)."""
    errors = np.append(values, -1.0)
    return np.asarray(np.einsum("k,jkl,l->j", errors, sums, errors))


def mask_impossible(logs: QuickLogs, fit: QuickResult) -> NDArray[np.bool_]:
    """Return the joints (n,) that a fit of `logs` has driven by friction, or with a negative inertia."""
    columns, values, folds = _evaluate(logs), fit.values, fit.folds
    inertial, joints = len(logs.library.card.beta), columns.shape[1]
    still = np.zeros_like(logs.q)
    (weight,) = logs.library.evaluate("torque_regressor", np.ascontiguousarray(logs.q), still, still)
    found = np.zeros(joints, dtype=np.bool_)
    for joint in range(joints):
        kept = logs.kept[:, joint]
        if not kept.any():
            continue
        unit = still.copy()
        unit[:, joint] = 1.0
        (inertia,) = logs.library.evaluate("torque_regressor", np.ascontiguousarray(logs.q), still, unit)
        torque = float(np.sqrt(np.mean(logs.tau[kept, joint] ** 2))) or 1.0
        quantities = (
            ((inertia - weight)[kept, joint], logs.ddq[kept, joint] ** 2, logs.ddq[kept, joint], inertial, 0),
            (columns[kept, joint], logs.dq[kept, joint], logs.dq[kept, joint], None, inertial),
        )
        for table, factor, motion, stop, start in quantities:
            row = (table[:, start:stop] * factor[:, None]).mean(axis=0)
            scale = float(np.sqrt(np.mean(motion**2))) * torque or 1.0
            share = float(row @ values[start : start + len(row)]) / scale
            spread = (
                np.sqrt(compute_jackknife((folds[:, start : start + len(row)] @ row)[:, None]))[0] / scale
            )
            found[joint] |= share < -max(_CLEAR, _SURE * float(spread))
    return found
