"""Drift: whether several logs tell of the same robot.

Input: rows of several logs, the fit to all of them. Output: `Drift`.

Each log is fitted alone; a parameter that they tell differently, beyond what the noise of blocks allows,
has changed between the logs, or takes the blame for what the model misses. The mean residual of each joint
in each log, with its deviation, says where torque is missing that no parameter of the model makes up for.

Supported: parameters that at least two of the logs tell alone.
Not supported: changes within a log.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.errors import IdentifiabilityError, Notice
from symid.estimators.regression import Fit, fit_weighted
from symid.residuals.doubts import find_block_deviations
from symid.rows.identifiability import Identifiability, find_identifiability
from symid.rows.rows import SCALAR_KINDS, Rows, select_rows

__all__ = ["Change", "Drift", "LogFit", "LogFitter", "find_drift", "find_mean_weights", "warn_of_drift"]

_CHANCE = 0.01
"""Probability, over all parameters, that chance alone makes one of them drift."""
_BLOCKS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A parameter as each log tells it alone: values, deviations, and the chance of so much scatter."""

    name: str
    values: tuple[float, ...]
    deviations: tuple[float, ...]
    chance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """What differs between logs.

    Args:
        runs: numbers of the logs that were compared, from zero.
        changed: parameters that differ beyond chance, the least likely first.
        compared: how many parameters at least two logs tell alone.
        residual: (log, joint, mean residual, its deviation) of the fit to all logs.
    """

    runs: tuple[int, ...]
    changed: tuple[Change, ...]
    compared: int
    residual: tuple[tuple[int, str, float, float], ...]


class LogFit(NamedTuple):
    """What one log tells alone: parameters and deviations (p,), and which of them it tells."""

    values: FloatArray
    deviations: FloatArray
    seen: Identifiability


LogFitter = Callable[[int, FloatArray], LogFit | None]
"""From the number of a log and the weights of joints (g,) to what it tells alone, or None."""


def find_drift(rows: Rows, fit: Fit, freedom: str = "band", fit_log: LogFitter | None = None) -> Drift:
    """Return what the logs behind `rows` tell differently; nothing where there is only one.

    Args:
        rows: the equations of the fit.
        fit: its result.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
        fit_log: fits one log alone, where `rows` have no matrix.
    """
    runs = tuple(int(run) for run in np.unique(rows.run))
    residual = tuple(entry for run in runs for entry in _find_means(rows, fit, run))
    if len(runs) < 2:
        return Drift(runs=runs, changed=(), compared=0, residual=residual)
    weights = find_mean_weights(rows, fit)
    fit_log = fit_log or partial(_fit_alone, rows, freedom)
    alone = {run: found for run in runs if (found := fit_log(run, weights)) is not None}
    changes = []
    for index, name in enumerate(rows.names):
        told = [found for found in alone.values() if found.seen.learnable[index]]
        if len(told) < 2:
            continue
        values = np.array([found.values[index] for found in told])
        deviations = np.array([found.deviations[index] for found in told])
        changes.append(
            Change(
                name=name,
                values=tuple(map(float, values)),
                deviations=tuple(map(float, deviations)),
                chance=_find_chance(values, deviations),
            )
        )
    limit = _CHANCE / max(len(changes), 1)
    changed = sorted((entry for entry in changes if entry.chance < limit), key=lambda entry: entry.chance)
    return Drift(runs=tuple(alone), changed=tuple(changed), compared=len(changes), residual=residual)


def find_mean_weights(rows: Rows, fit: Fit) -> FloatArray:
    """Return what the fit multiplied residuals of each group by (g,), without the weights of the logs.

    Args:
        rows: the equations of the fit.
        fit: its result; where weights differ within a group their mean counts.
    """
    own = fit.weights / np.sqrt(rows.weight)
    return np.array(
        [
            float(own[rows.group == group].mean()) if np.any(rows.group == group) else 1.0
            for group in range(len(rows.group_names))
        ]
    )


def _fit_alone(rows: Rows, freedom: str, run: int, weights: FloatArray) -> LogFit | None:
    part = select_rows(rows, rows.run == run)
    part = replace(part, weight=np.ones(len(part.values)))
    try:
        seen = find_identifiability(part)
    except IdentifiabilityError:
        return None
    found = fit_weighted(part, seen, weights, freedom)
    stated = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    return LogFit(found.values, np.maximum(stated, find_block_deviations(part, found, seen)), seen)


def _find_chance(values: FloatArray, deviations: FloatArray) -> float:
    """Return the probability that equal values scatter as much: chi-squared with k - 1 degrees of freedom.

    The deviations rest on some tens of blocks, whence the F distribution in place of chi-squared.
    """
    from scipy.special import fdtrc

    safe = np.maximum(deviations, 1e-300)
    weights = 1.0 / safe**2
    mean = float(np.sum(weights * values) / np.sum(weights))
    freedom = len(values) - 1
    square = float(np.sum(((values - mean) / safe) ** 2))
    return float(fdtrc(freedom, _BLOCKS - 1, square / freedom))


def _find_means(rows: Rows, fit: Fit, run: int) -> list[tuple[int, str, float, float]]:
    found = []
    for group, name in enumerate(rows.group_names):
        members = np.flatnonzero((rows.group == group) & (rows.run == run))
        if len(members) < 2 * _BLOCKS:
            continue
        means = np.array([fit.residuals[block].mean() for block in np.array_split(members, _BLOCKS)])
        found.append((run, name, float(means.mean()), float(means.std(ddof=1) / np.sqrt(_BLOCKS))))
    return found


def warn_of_drift(
    rows: Rows,
    fit: Fit,
    names: Sequence[str],
    freedom: str = "band",
    *,
    fit_log: LogFitter | None = None,
) -> tuple[Notice, ...]:
    """Return a notice where the logs behind `rows` differ; `names` are theirs, by their number.

    Further arguments as for `find_drift`.
    """
    if len(names) < 2 or rows.kind in SCALAR_KINDS:
        return ()
    drift = find_drift(rows, fit, freedom, fit_log)
    if not drift.changed:
        return ()
    shown = ", ".join(entry.name for entry in drift.changed[:8])
    more = f" and {len(drift.changed) - 8} more" if len(drift.changed) > 8 else ""
    logs = ", ".join(names[run] for run in drift.runs)
    text = (
        f"{logs} tell {shown}{more} differently, beyond what their noise allows: the robot changed between "
        "them (temperature, payload, zero of the torque), or the model misses a term that acts differently "
        "in each; fit them apart and compare, or give each its own offsets"
    )
    return (Notice(code="identify.drift", text=text),)
