"""What speaks for and against a fit: held-out prediction, impossible values, missing terms, a likely mistake.

Rows of a fit, slow ones too, what it kept, fits without each stretch -> `Evidence`.

    r = y - A x_(-s),    100 |L r| / |L y|

x_(-s) are the parameters without the stretch (or, of several logs, without the log) of the row; L is a
zero-phase Butterworth low-pass of order 4 at the scoring band. Every row counts; those in motion, at reversal
and at rest count apart as well.

A fit is suspicious where much is left unexplained, or a value is impossible: a negative friction or rotor
inertia, or a mass matrix that is not positive definite, by more than four deviations and two percent of a
joint's torque. Then single mistakes of the log are tried (`find_cause`).

Terms that the model lacks are added to one joint j in fact, and kept where held-out rows are better:

    min |L' (A x + C c - y)|_W     with all parameters free, without each stretch in turn
    gain = 1 - |L' (y_j - A_j x - C c)|^2 / |L' (y_j - A_j x_0)|^2     on stretches left out, x_0 without C

C are functions of the motion of joint j (`FAMILIES`). L' is a low-pass at twice the scoring band, ten Hz at
least: beyond, the noise of accelerations makes a residual that looks like a term of other joints. A term
counts where its gain exceeds five percent of the joint's squares, and is sure by three and a half standard
errors (see `measure_gain`).

Supported: rows of single joints at even times. Not supported: power and energy rows; two terms at once;
terms of several joints.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import Notice
from symid.identification.diagnostics import (
    FAMILIES,
    OTHER_VALUES,
    JointMotion,
    Stretches,
    build_quick_logs,
    describe_proportion,
    evaluate_inertia_columns,
    find_cause,
    fit_quick,
    fit_stretches,
    list_proportions,
    mask_inner,
    measure_gain,
    measure_scoring_band,
    smooth_rows,
)
from symid.identification.estimators import Evidence, JointEvidence, ModelTerm, RegressionFit, find_phases
from symid.identification.regression import (
    Identifiability,
    Rows,
    list_resting_joints,
    prepare_states,
    select_rows,
)
from symid.identification.rigid.plan import FitBasis
from symid.joint_models import is_braking
from symid.logs import undo_resampling

_LEAST_GAIN = 0.05
_SURE, _SURE_OF_LARGE = 3.5, 2.5
_LARGE = 0.4
"""Gain from which fewer standard errors are enough: chance gains little."""
_TINY = 1e-300
_FRICTION = ("velocity", "slow motion", "load")
"""Families that another friction law would have."""
_BAND, _LEAST_BAND = 2.0, 10.0
"""Times the scoring band, and Hz at least, up to which terms are looked for."""
_RATE = 4.0
"""Times that band: rate of the rows that are kept."""


def list_missing_terms(
    basis: FitBasis, rows: Rows, weights: FloatArray, values: FloatArray, scoring: float
) -> tuple[ModelTerm, ...]:
    """Return the terms that help, the largest gain first, one a joint.

    `weights` (g,) are those of the squared residuals of each joint, `values` (p,) those of the fit, `scoring`
    the band in Hz.
    """
    band = max(_BAND * scoring, _LEAST_BAND)
    motions = _list_motions(basis, rows, values)
    thin = _list_thin(rows, _RATE * band)
    table = smooth_rows(rows, np.column_stack([rows.matrix, rows.values]), band)
    smooth = select_rows(replace(rows, matrix=table[:, :-1], values=table[:, -1]), thin)
    stretches = fit_stretches(smooth, None, np.ones(len(smooth.values), dtype=np.bool_), weights)
    found = []
    for group in np.unique(rows.group).tolist():
        whole = np.flatnonzero(rows.group == group)
        own = np.flatnonzero(smooth.group == group)
        best: ModelTerm | None = None
        for name, family in FAMILIES.items():
            if name == OTHER_VALUES or (basis.plan.laws_chosen and name in _FRICTION):
                continue
            columns = np.vstack([_evaluate(family.build(motion)) for motion in motions[group]])
            if not columns.shape[1]:
                continue
            columns = smooth_rows(select_rows(rows, whole), columns, band)[thin[whole]]
            size = np.sqrt(np.mean(columns**2, axis=0))
            columns = columns[:, size > _TINY] / size[size > _TINY]
            gain, errors = measure_gain(stretches, smooth, own, columns)
            sure = errors > (_SURE if gain < _LARGE else _SURE_OF_LARGE)
            if gain > _LEAST_GAIN and sure and (best is None or 100.0 * gain > best.gain):
                best = ModelTerm(joint=rows.group_names[group], term=name, gain=100.0 * gain, errors=errors)
        if best is not None:
            found.append(best)
    return tuple(sorted(found, key=lambda entry: -entry.gain))


def _list_thin(rows: Rows, rate: float) -> NDArray[np.bool_]:
    """Return which rows (m,) to keep for about `rate` a second of each joint and log."""
    kept = np.zeros(len(rows.values), dtype=np.bool_)
    for run in np.unique(rows.run):
        for group in np.unique(rows.group):
            own = np.flatnonzero((rows.run == run) & (rows.group == group))
            if len(own) > 1:
                step = max(1, math.floor(1.0 / (rate * float(np.median(np.diff(rows.time[own]))))))
                kept[own[::step]] = True
    return kept


def _evaluate(columns: list[FloatArray]) -> FloatArray:
    return np.column_stack(columns) if columns else np.empty((0, 0))


def _list_motions(basis: FitBasis, rows: Rows, values: FloatArray) -> dict[int, list[JointMotion]]:
    """Return the motion of every joint at its rows, one entry for each log that has rows of it."""
    predicted, processing = rows.matrix @ values, basis.plan.processing
    found: dict[int, list[JointMotion]] = {}
    for group in np.unique(rows.group).tolist():
        found[group] = []
    # The same terms in all logs: a joint at rest in one of them has zeros there.
    resting = set.intersection(*(set(list_resting_joints(entry)) for entry in basis.recordings))
    for run in np.unique(rows.run).tolist():
        signals = prepare_states(basis.library, basis.recordings[run], processing)
        for group, motions in found.items():
            own = np.flatnonzero((rows.run == run) & (rows.group == group))
            if not len(own):
                continue
            places = np.searchsorted(signals.time, rows.time[own] - 0.5 * signals.period)
            q, dq, ddq = (part[places] for part in (signals.q, signals.dq, signals.ddq))
            others = [k for k in range(q.shape[1]) if k != group and k not in resting]
            motions.append(
                JointMotion(
                    time=rows.time[own],
                    q=q[:, group],
                    dq=dq[:, group],
                    ddq=ddq[:, group],
                    load=predicted[own],
                    others=[(dq[:, k], ddq[:, k]) for k in others],
                    period=float(np.median(np.diff(rows.time[own]))),
                )
            )
    return found


class FittedRows(NamedTuple):
    """Equations, what is identifiable from them, and their fit; notices on correlated residuals.

    `left` are all rows of a long log, slow ones too, and what the fit leaves of them; None in memory.
    """

    rows: Rows
    identifiability: Identifiability
    fit: RegressionFit
    pattern: tuple[Notice, ...] = ()
    left: tuple[Rows, FloatArray] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JudgedRows:
    """Rows of a fit.

    Args:
        rows: all of them, m; speed: (m,) of smooth positions, rad/s or m/s.
        kept: (m,) whether the fit has them; residuals: (m,) of the fit.
        smooth: the same along the states of the instruments, None where there are none.
    """

    rows: Rows
    speed: FloatArray
    kept: NDArray[np.bool_]
    residuals: FloatArray
    smooth: Rows | None = None


def list_joint_evidence(
    judged: JudgedRows, stretches: Stretches, scoring: float
) -> tuple[JointEvidence, ...]:
    """Return what is left unexplained of every joint within the `scoring` band in Hz."""
    rows = judged.rows
    errors = rows.values - stretches.predict(rows)
    # Near rest, noise turns the sign of a velocity: that is no friction of another kind.
    slow = errors if judged.smooth is None else rows.values - stretches.predict(judged.smooth)
    table = smooth_rows(rows, np.column_stack([rows.values, errors, judged.residuals, slow]), scoring)
    inner = mask_inner(rows)
    found = []
    for group in np.unique(rows.group):
        own = rows.group == group
        counted, phases = own & inner, np.full(len(own), -1)
        phases[own] = find_phases(rows.time[own], judged.speed[own], rows.run[own])
        torque = float(np.sqrt(np.mean(table[counted, 0] ** 2))) if counted.any() else 0.0

        def share(column: int, mask: NDArray[np.bool_], torque: float = torque) -> float:
            if not torque or not mask.any():
                return float("inf")
            return 100.0 * float(np.sqrt(np.mean(table[mask, column] ** 2))) / torque

        found.append(
            JointEvidence(
                joint=rows.group_names[group],
                fitted=share(2, counted & judged.kept),
                held_out=share(1, counted),
                moving=share(1, counted & (phases == 0)),
                reversing=share(3, counted & (phases == 1)),
                resting=share(3, counted & (phases == 2)),
                share=float(np.mean(~judged.kept[own])),
                torque=torque,
            )
        )
    return tuple(found)


_SURE = 4.0
"""Deviations beyond which an impossible value is no chance."""
_MATTERS = 0.02
"""Of the root mean square of a joint's torque: an impossible value that does less is no mistake."""
_SUSPICIOUS = 30.0
"""Percent of held-out torque left unexplained, from which causes are looked for."""
_HELPS = 0.7
"""Times the held-out residual: what must be left at most with a mistake undone."""
_POSES = 60


def collect_evidence(
    basis: FitBasis, judged: JudgedRows, fitted: FittedRows, stretches: Stretches
) -> Evidence:
    """Return the evidence for a fit in memory."""
    library, recordings, plan = basis.library, basis.recordings, basis.plan
    rows, fit = judged.rows, fitted.fit
    scoring = plan.choice.scoring if plan.choice is not None else measure_scoring_band(recordings)
    joints = list_joint_evidence(judged, stretches, scoring)
    whole = not fitted.identifiability.refused
    impossible = list_impossible(basis, fitted.rows, fit, whole=whole)
    found = Evidence(
        joints=joints,
        scoring=scoring,
        stretches=len(stretches.logs),
        logs=len(stretches.logwise),
        movement=plan.choice.chosen.movement if plan.choice is not None else 0.0,
        impossible=impossible,
    )
    if rows.kind == "torque" and found.unexplained <= _SUSPICIOUS:
        missing = list_missing_terms(basis, rows, stretches.weights, fit.values, scoring)
        found = replace(found, missing=missing)
    logs = build_quick_logs(library, recordings, plan.processing, scoring)
    quick = fit_quick(logs)
    names = [joint.name for joint in library.card.joints]
    alike = tuple((names[one], names[other]) for one, other in list_proportions(logs.dq, quick.moving))
    found = replace(found, in_proportion=alike)
    if any(recording.stamps is not None for recording in recordings):
        before = [undo_resampling(recording) for recording in recordings]
        other = fit_quick(build_quick_logs(library, before, plan.processing, scoring))
        found = replace(found, resampled=(quick.percent, other.percent))
    # A quick fit may itself be poor: undoing a mistake must leave less than the fit does.
    left = {entry.joint: entry.held_out for entry in joints}
    held_out = np.array([left.get(names[joint], np.inf) for joint in quick.moving])
    most = _HELPS * found.unexplained
    cause = find_cause(logs, quick, most, cures=bool(impossible), held_out=held_out)
    if not (np.isfinite(cause.percent) or found.unexplained > _SUSPICIOUS or impossible):
        return found
    return replace(
        found,
        code=cause.code,
        cause=cause.cause,
        remedy=cause.remedy,
        cured=cause.percent,
        effect=cause.effect,
    )


def describe_motion(evidence: Evidence) -> tuple[Notice, ...]:
    """Return warnings of joints that move in proportion, and a note on the effect of resampling."""
    found = tuple(describe_proportion(*pair) for pair in evidence.in_proportion)
    if not evidence.resampled:
        return found
    after, before = evidence.resampled
    text = (
        f"uneven logs were moved to even times: a quick fit leaves {after:.3g} % of held-out torque, "
        f"with the samples as they come {before:.3g} %"
    )
    return (*found, Notice(code="identify.resampled", text=text))


def list_impossible(
    basis: FitBasis, rows: Rows, fit: RegressionFit, *, whole: bool = True
) -> tuple[str, ...]:
    """Return in words what no robot can have; mass matrices count where the parameters are `whole`."""
    card, deviations = basis.library.card, np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    found = []
    sizes = np.zeros(len(rows.names))
    for group in np.unique(rows.group):
        own = rows.group == group
        torque = float(np.sqrt(np.mean(rows.values[own] ** 2))) or 1.0
        part = np.sqrt(np.mean((rows.matrix[own] * fit.values) ** 2, axis=0)) / torque
        sizes = np.maximum(sizes, part)
    for place, entry in enumerate((*card.beta, *card.friction)):
        friction = place >= len(card.beta) and is_braking(entry.name)
        rotor = place < len(card.beta) and entry.name.startswith("IA")
        surely = fit.values[place] < -_SURE * deviations[place] and sizes[place] > _MATTERS
        if (friction or rotor) and deviations[place] > 0.0 and surely:
            what = "friction drives the joint" if friction else "a rotor has a negative inertia"
            found.append(f"{entry.name} = {fit.values[place]:.3g} {entry.unit}: {what}")
    bad = _count_indefinite(basis, fit.values, fit.covariance) if whole else 0
    if bad:
        found.append(f"the mass matrix is not positive definite at {bad} of {_POSES} poses of the logs")
    return tuple(found)


def _count_indefinite(basis: FitBasis, values: FloatArray, covariance: FloatArray) -> int:
    """Return at how many poses the mass matrix is surely not positive definite, 0 if it does not matter."""
    positions = np.vstack([recording.position for recording in basis.recordings])
    places = np.linspace(0, len(positions) - 1, _POSES).astype(int)
    count = len(basis.library.card.beta)
    mass, least, vectors = _analyse_mass(basis.library, positions[places], values[:count])
    weakest = vectors[:, :, 0]
    row = np.einsum("ti,tijk,tj->tk", weakest, mass, weakest)
    deviation = np.sqrt(np.maximum(np.einsum("tk,kl,tl->t", row, covariance[:count, :count], row), 0.0))
    found = int(np.sum(least[:, 0] < -_SURE * deviation))
    return found if found and _measure_negative_torque(basis, values[:count]) > _MATTERS else 0


def _analyse_mass(
    library: Library, poses: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return dM/dbeta (t, n, n, p) at poses (t, n), and eigenvalues (t, n) and vectors (t, n, n) of M."""
    # (t, i, j, k): row i of column j of M at pose t.
    mass = np.stack(list(evaluate_inertia_columns(library, np.ascontiguousarray(poses))), axis=2)
    matrices = mass @ values
    least, vectors = np.linalg.eigh((matrices + matrices.swapaxes(1, 2)) / 2.0)
    return mass, least, vectors


def _measure_negative_torque(basis: FitBasis, values: FloatArray) -> float:
    """Return the largest part of a joint's torque, in root mean squares, that negative inertia takes."""
    most = 0.0
    for recording in basis.recordings:
        signals = prepare_states(basis.library, recording, basis.plan.processing)
        places = np.linspace(0, len(signals.time) - 1, _POSES).astype(int)
        _, least, vectors = _analyse_mass(basis.library, signals.q[places], values)
        negative = np.minimum(least, 0.0)
        torque = np.einsum("tij,tj,tkj,tk->ti", vectors, negative, vectors, signals.ddq[places])
        part, whole = (np.sqrt(np.mean(entry**2, axis=0)) for entry in (torque, signals.tau))
        most = max(most, float(np.max(part / np.where(whole > 0.0, whole, np.inf))))
    return most
