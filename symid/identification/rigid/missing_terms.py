"""Terms that the model lacks: each is added to one joint in fact, and kept where held-out rows are better.

Rows of a fit and their states -> `ModelTerm`s.

    min |L (A x + C c - y)|_W     with all parameters free, without each stretch in turn
    gain = 1 - |L (y_j - A_j x - C c)|^2 / |L (y_j - A_j x_0)|^2     on stretches left out, x_0 without C

C are functions of the motion of joint j (`FAMILIES`). L is a low-pass at twice the scoring band, ten Hz at
least: beyond, the noise of accelerations makes a residual that looks like a term of other joints. All rows
count, slow ones too. A term counts where its gain exceeds five percent of the joint's squares, and is sure
by three and a half standard errors (see `measure_gain`).

Supported: torque rows of any estimator. Not supported: two terms at once; terms of several joints.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.identification.diagnostics import (
    FAMILIES,
    OTHER_VALUES,
    JointMotion,
    fit_stretches,
    measure_gain,
    smooth_rows,
)
from symid.identification.estimators import ModelTerm
from symid.identification.regression import Rows, list_resting_joints, prepare_states, select_rows
from symid.identification.rigid.plan import FitBasis

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
