"""Warnings about a fit: unsuitable filters, residuals that are not noise, stiction, impossible inertias.

Settings, recordings, rows and fit, library -> notices, each with what to do.

A zero-phase filter continues the position beyond the ends of the log. Where a joint moves there, its
acceleration is not what the continuation supposes, and about two periods of the cut-off are wrong.

A joint that sticks holds any torque up to its break-away, which no function of velocity explains. Rows at
standstill that leave far more than those in motion pull at all parameters, and in a weighted fit they make
their joint look noisy.

Supported: one recording or several; torque and momentum rows for the pattern of the residual; torque,
momentum and filtered rows of joints with friction for stiction; ends of logs by their mean speed over one
period of the cut-off.
Not supported: naming the missing term (see `residual_structure`); accelerations at an end at rest, which
are wrong by less.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import Notice
from symid.identification.estimators import ParameterEstimate, RegressionFit, compute_inverse_root
from symid.identification.regression import SCALAR_KINDS, Identifiability, Rows
from symid.logs import Recording
from symid.robot import Processing

_LEAST_RATIO = 2.5
"""Of the position's cut-off to the highest frequency that decimation keeps."""
_BLOCKS = 100
_TOO_SMALL = 2.0
_POSES = 200
_POOR_PERCENT = 30.0


def warn_of_processing(processing: Processing, recordings: Sequence[Recording]) -> tuple[Notice, ...]:
    """Return what is wrong with the filters for these recordings."""
    if processing.filter_cutoff is None:
        text = (
            "no filter is set: velocities and accelerations are raw differences of the logged positions, "
            "and their noise biases the parameters; set processing.filter_cutoff, in Hz"
        )
        return (Notice(code="identify.no-filter", text=text),)
    decimation = processing.decimation
    period = min(recording.period for recording in recordings)
    kept = 0.5 / period / decimation.factor * (decimation.band if decimation.factor > 1 else 1.0)
    if decimation.factor == 1 or processing.filter_cutoff >= _LEAST_RATIO * kept:
        return ()
    text = (
        f"the position's low-pass at {processing.filter_cutoff:g} Hz damps accelerations that the torque "
        f"keeps: decimation lets pass what lies below {kept:.3g} Hz; raise processing.filter_cutoff to "
        f"{_LEAST_RATIO * kept:.3g} Hz or more, or decimate further"
    )
    return (Notice(code="identify.low-cutoff", text=text),)


def sum_block_scores(
    design: FloatArray, errors: FloatArray, groups: NDArray[np.intp], blocks: int
) -> tuple[FloatArray, int]:
    """Return sum_b F_b' e_b e_b' F_b (p, p) over blocks b of consecutive rows, and how many there are.

    Between (F'F)^-1 on either side it is the clustered covariance, for noise that is correlated within
    blocks (Liang and Zeger 1986).

    Args:
        design: F (m, p).
        errors: e (m,).
        groups: (m,) number of the group of each row: no block has rows of two groups.
        blocks: into which a group is cut at most.
    """
    total, count = np.zeros((design.shape[1], design.shape[1])), 0
    for group in np.unique(groups):
        members = np.flatnonzero(groups == group)
        parts = np.array_split(members, min(blocks, len(members)))
        count += len(parts)
        for part in parts:
            score = design[part].T @ errors[part]
            total += np.outer(score, score)
    return total, count


def compute_block_deviations(rows: Rows, fit: RegressionFit, seen: Identifiability) -> FloatArray:
    """Return standard deviations (p,) that hold for noise that is not independent from row to row.

    B G (sum_b F_b' e_b e_b' F_b) G B' with G = (F'F)^-1, F = A B, over blocks b of consecutive rows of one
    group: the clustered covariance (Liang and Zeger 1986).
    """
    design = (rows.matrix @ seen.basis) * fit.weights[:, None]
    errors = fit.residuals * fit.weights
    root = compute_inverse_root(design)
    total, _ = sum_block_scores(design, errors, rows.group, _BLOCKS)
    left = seen.basis @ root @ root.T
    covariance = left @ total @ left.T
    deviations: FloatArray = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return deviations


def warn_of_correlated_residuals(rows: Rows, fit: RegressionFit, seen: Identifiability) -> tuple[Notice, ...]:
    """Return a notice where the residual keeps a pattern, so that the stated deviations are too small."""
    learnt = seen.basis.shape[1]
    if rows.kind in SCALAR_KINDS or len(rows.values) < 20 * learnt:
        return ()
    stated = np.sqrt(np.diag(fit.covariance))
    blocks = compute_block_deviations(rows, fit, seen)
    scale = np.maximum(np.abs(fit.values).max(), 1e-300)
    # A fit to the last bit leaves rounding, whose pattern says nothing.
    far = [
        (rows.names[k], blocks[k] / stated[k])
        for k in np.flatnonzero(seen.learnable)
        if stated[k] > 1e-12 * scale and blocks[k] > _TOO_SMALL * stated[k]
    ]
    if not far:
        return ()
    names = ", ".join(name for name, _ in far)
    worst = max(ratio for _, ratio in far)
    text = (
        f"the residual is not noise but keeps a pattern: the standard deviations of {names} are up to "
        f"{worst:.2g} times too small; `symid report --diagnose` shows what it follows: a term is missing, "
        "a filter blurs, or a joint sticks (processing.standstill)"
    )
    return (Notice(code="identify.pattern", text=text),)


def _compute_mass_matrices(library: Library, poses: FloatArray, beta: FloatArray) -> FloatArray:
    """Return M at each pose (N, n, n), column k the torque of a unit acceleration of joint k at rest."""
    still = np.zeros_like(poses)
    (weight,) = library.evaluate("torque_regressor", poses, still, still)
    columns = []
    for joint in range(poses.shape[1]):
        unit = still.copy()
        unit[:, joint] = 1.0
        (regressor,) = library.evaluate("torque_regressor", poses, still, unit)
        columns.append((regressor - weight) @ beta)
    return np.stack(columns, axis=2)


def warn_of_mass_matrix(
    library: Library, values: FloatArray, recordings: Sequence[Recording]
) -> tuple[Notice, ...]:
    """Return a notice where the mass matrix is not positive definite at poses of the recordings."""
    positions = np.vstack([recording.position for recording in recordings])
    poses = np.ascontiguousarray(positions[:: max(1, len(positions) // _POSES)])
    mass = _compute_mass_matrices(library, poses, values[: len(library.card.beta)])
    least = np.linalg.eigvalsh((mass + np.swapaxes(mass, 1, 2)) / 2.0)[:, 0]
    bad = int(np.sum(least <= 0.0))
    if not bad:
        return ()
    text = (
        f"at {bad} of {len(poses)} poses of the log the identified mass matrix is not positive definite: no "
        "robot has such inertias; the log excites them too little, or the model misses a term"
    )
    return (Notice(code="identify.impossible-mass", text=text),)


def warn_of_poorly_identifiable(parameters: Sequence[ParameterEstimate]) -> tuple[Notice, ...]:
    """Return a notice on parameters whose standard deviation is a large part of them."""
    vague = [entry.name for entry in parameters if entry.relative_std_percent > _POOR_PERCENT]
    if not vague:
        return ()
    text = (
        f"known to no better than {_POOR_PERCENT:g} % (one standard deviation): {', '.join(vague)}; "
        "they matter little in this log, or a motion that excites them is missing"
    )
    return (Notice(code="identify.vague", text=text),)


def warn_of_fitted_log(source: str, what: str = "estimate") -> Notice:
    """Return a notice that a log is one of the fit, so that it tests nothing."""
    text = f"the {what} was fitted to this very log, which is no test of it; validate on another motion"
    return Notice(code="validate.fitted-log", text=text, file=source)


_PERIODS = 2.0
"""Of the cut-off that are wrong at an end."""
_MOVING = 0.05
"""Of the top speed, beyond which a joint moves."""


def warn_of_moving_ends(processing: Processing, recordings: Sequence[Recording]) -> tuple[Notice, ...]:
    """Return which logs begin or end in motion with nothing cut off there.

    Args:
        processing: as used, its cut-off in Hz and the samples cut at either end.
        recordings: of the fit.
    """
    if processing.filter_cutoff is None:
        return ()
    found = (_check_ends(processing, recording) for recording in recordings)
    return tuple(notice for notice in found if notice is not None)


def _check_ends(processing: Processing, recording: Recording) -> Notice | None:
    spoilt = math.ceil(_PERIODS / (processing.filter_cutoff or 1.0) / recording.period)
    span = max(1, round(spoilt / _PERIODS))
    speed = np.abs(recording.position[span:] - recording.position[:-span])
    if len(speed) == 0:
        return None
    moving = speed[[0, -1]] > _MOVING * speed.max(axis=0)
    ends = (
        ("begins", "drop_first", processing.drop_first, moving[0]),
        ("ends", "drop_last", processing.drop_last, moving[1]),
    )
    bad = [(verb, name) for verb, name, cut, moves in ends if cut < spoilt and np.any(moves)]
    if not bad:
        return None
    settings = " ".join(f"--set processing.{name}={spoilt}" for _, name in bad)
    text = (
        f"the log {' and '.join(verb for verb, _ in bad)} in motion, and the filter at "
        f"{processing.filter_cutoff:g} Hz does not know what was before or after: accelerations there are "
        f"wrong and spoil the fit; leave {spoilt} samples out, with {settings}"
    )
    return Notice(code="identify.moving-ends", text=text, file=recording.source)


_SLOW = 0.02
"""Of the top speed, below which a joint may stick."""
_TOP = 0.99
"""Quantile of the speed that is called the top one."""
_RATIO = 2.0
_FEWEST = 30


def warn_of_stiction(rows: Rows, fit: RegressionFit, library: Library) -> tuple[Notice, ...]:
    """Return a notice where joints leave more than twice as much at standstill as in motion.

    Args:
        rows: the equations; their velocities are those of joints, or means over windows.
        fit: its residuals.
        library: whose card says which joints have friction.
    """
    if rows.kind in SCALAR_KINDS:
        return ()
    braked = {joint.name for joint in library.card.joints if joint.friction != "none"}
    found = [
        (name, *told)
        for index, name in enumerate(rows.group_names)
        if name in braked and (told := _compare_speeds(rows, fit, index)) is not None
    ]
    if not found:
        return ()
    joints = ", ".join(f"{name} ({ratio:.1f} times)" for name, ratio, _ in found)
    speed = min(slow for _, _, slow in found)
    text = (
        f"rows slower than {100.0 * _SLOW:g} % of the top speed leave more than faster ones: {joints}; "
        "joints that stick hold torques that no friction model explains, and pull at all parameters; leave "
        f"such rows out with --set processing.standstill={speed:.2g} (rad/s or m/s, of all joints)"
    )
    return (Notice(code="identify.sticking", text=text),)


def _compare_speeds(rows: Rows, fit: RegressionFit, group: int) -> tuple[float, float] | None:
    """Return how much more a joint leaves at standstill, and the speed below which; None if it does not."""
    members = rows.group == group
    speed, residual = np.abs(rows.velocity[members]), fit.residuals[members]
    if len(speed) < 2 * _FEWEST:
        return None
    limit = _SLOW * float(np.quantile(speed, _TOP))
    slow = speed < limit
    if min(int(slow.sum()), int((~slow).sum())) < _FEWEST:
        return None
    still, moving = (float(np.sqrt(np.mean(residual[part] ** 2))) for part in (slow, ~slow))
    return (still / moving, limit) if still > _RATIO * moving > 0.0 else None
