"""What speaks against an estimate: settings that blur, residuals that are no noise, impossible inertias.

Input: settings, rows and fit, the library. Output: notices in plain sentences, each with what to do.

Supported: one recording or several; torque and momentum rows for the pattern of the residual.
Not supported: naming the missing term; see `structure`.
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import Notice
from symid.estimators.estimate import ParameterEstimate
from symid.estimators.regression import Fit
from symid.estimators.statistics import find_inverse_root
from symid.robot.log_map import Processing
from symid.rows.identifiability import Identifiability
from symid.rows.rows import SCALAR_KINDS, Rows

__all__ = [
    "find_block_deviations",
    "warn_of_mass_matrix",
    "warn_of_pattern",
    "warn_of_processing",
    "warn_of_vague",
]

_LEAST_RATIO = 2.5
"""Of the position's cut-off to the highest frequency that decimation keeps."""
_BLOCKS = 100
_TOO_SMALL = 2.0
_POSES = 200
_VAGUE_PERCENT = 30.0


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


def find_block_deviations(rows: Rows, fit: Fit, seen: Identifiability) -> FloatArray:
    """Return standard deviations (p,) that hold for noise that is not independent from row to row.

    B G (sum_b F_b' e_b e_b' F_b) G B' with G = (F'F)^-1, F = A B, over blocks b of consecutive rows of one
    group: the clustered covariance (Liang and Zeger 1986).
    """
    design = (rows.matrix @ seen.basis) * fit.weights[:, None]
    errors = fit.residuals * fit.weights
    root = find_inverse_root(design)
    total = np.zeros((design.shape[1], design.shape[1]))
    for group in np.unique(rows.group):
        members = np.flatnonzero(rows.group == group)
        for block in np.array_split(members, min(_BLOCKS, len(members))):
            score = design[block].T @ errors[block]
            total += np.outer(score, score)
    left = seen.basis @ root @ root.T
    covariance = left @ total @ left.T
    deviations: FloatArray = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return deviations


def warn_of_pattern(rows: Rows, fit: Fit, seen: Identifiability) -> tuple[Notice, ...]:
    """Return a notice where the residual keeps a pattern, so that the stated deviations are too small."""
    learnt = seen.basis.shape[1]
    if rows.kind in SCALAR_KINDS or len(rows.values) < 20 * learnt:
        return ()
    stated = np.sqrt(np.diag(fit.covariance))
    blocks = find_block_deviations(rows, fit, seen)
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


def _find_mass_matrices(library: Library, poses: FloatArray, beta: FloatArray) -> FloatArray:
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
    mass = _find_mass_matrices(library, poses, values[: len(library.card.beta)])
    least = np.linalg.eigvalsh((mass + np.swapaxes(mass, 1, 2)) / 2.0)[:, 0]
    bad = int(np.sum(least <= 0.0))
    if not bad:
        return ()
    text = (
        f"at {bad} of {len(poses)} poses of the log the identified mass matrix is not positive definite: no "
        "robot has such inertias; the log excites them too little, or the model misses a term"
    )
    return (Notice(code="identify.impossible-mass", text=text),)


def warn_of_vague(parameters: Sequence[ParameterEstimate]) -> tuple[Notice, ...]:
    """Return a notice on parameters whose standard deviation is a large part of them."""
    vague = [entry.name for entry in parameters if entry.relative_std_percent > _VAGUE_PERCENT]
    if not vague:
        return ()
    text = (
        f"known to no better than {_VAGUE_PERCENT:g} % (one standard deviation): {', '.join(vague)}; "
        "they matter little in this log, or a motion that excites them is missing"
    )
    return (Notice(code="identify.vague", text=text),)
