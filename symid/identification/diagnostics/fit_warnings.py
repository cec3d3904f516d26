"""Warnings about fits: their texts, all in one table, and the checks of rigid fits that issue them.

Settings, recordings, rows and fit, library -> notices. Texts of elastic and friction fits stand here too.

A zero-phase filter extrapolates the position at the ends of a log: of a joint that moves there about two
periods of the cut-off are wrong. A joint that sticks holds any torque up to its break-away.
Not supported: naming the missing term (see `residual_structure`); accelerations at an end at rest.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import Notice, shorten_names
from symid.identification import regression
from symid.identification.estimators import ParameterEstimate, RegressionFit, measure_influence
from symid.identification.judge import POLICY, adjust_chances, numerics
from symid.logs import Recording
from symid.robot import Processing

FIT_WARNINGS = {
    "identify.no-filter": (
        "no filter is set: the noise of differentiated positions biases the parameters. Set "
        "processing.filter_cutoff, in Hz"
    ),
    "identify.low-cutoff": (
        "the low-pass of the positions at {cutoff:g} Hz damps accelerations that decimation passes (up to "
        "{kept:.3g} Hz), which biases inertias. Raise processing.filter_cutoff to {least:.3g} Hz, or decimate"
    ),
    "identify.pattern": (
        "the residuals are correlated: the standard deviations of {names} are up to {ratio:.2g} times too "
        "small. A term is missing, the filter smooths the reversal, or a joint sticks "
        "(processing.standstill): see `symid report --diagnose`"
    ),
    "friction.pattern": (
        "the residuals are correlated: the standard deviations of {names} are up to {ratio:.2g} times too "
        "small. The friction law is incomplete, the filter smooths the reversal, or the decimation is too "
        "low: try --model auto, or a larger --decimate"
    ),
    "identify.impossible-mass": (
        "the identified mass matrix is not positive definite at {bad} of {poses} poses of the logs, which "
        "is impossible for a robot. Record more excitation, add the missing term to the model, or use "
        "--estimator consistent"
    ),
    "identify.poorly-identifiable": (
        "poorly identifiable (standard deviation above {percent:g} %): {names}. They matter little in these "
        "logs; if their values count, record motions that excite them (`symid excite`)"
    ),
    "elastic.poorly-identifiable": (
        "poorly identifiable (standard deviation above {percent:g} %): {names}. Fast motions separate rotor "
        "from link inertias, and different poses identify gravity parameters: add such motions, or take "
        "rotor inertias from data sheets"
    ),
    "elastic.not-identifiable": (
        "not identifiable (standard deviation above the value): {names}. Move these joints, fast and "
        "slowly, alone and with the others"
    ),
    "elastic.outcome": "the method {method} ended early: {outcome}. Compare with another method",
    "identify.moving-ends": (
        "the log {ends} in motion, where the filter at {cutoff:g} Hz extrapolates: accelerations are wrong. "
        "Leave {spoilt} samples out with {settings}"
    ),
    "identify.tracking": (
        "simulated and measured positions differ by more than {limit:g} % of the tracking error (in "
        "brackets): {joints}; {effect}, and the controller does not explain {missed} of the torque at the "
        "measured positions. Check gains, velocity filter, integral part, feed-forward and the side of the "
        "gear"
    ),
    "identify.biased-wls": (
        "{verdict}. Fits of torque equations to this log are biased too: check processing.filter_cutoff, "
        "decimation and processing.standstill"
    ),
    "diagnosis.other-values": (
        "refitting the logs changes values by up to {refit:.3g} standard deviations. A log has changed, or "
        "the estimate was made with other options or another version: identify again"
    ),
    "validate.fitted-log": (
        "the {what} was fitted to this log, to {part}, so this is not a validation. Validate on another "
        "motion, or on a part of the log that was left out of the fit (--train, --test)"
    ),
}
"""What was found, then what to do, with places for values, by code."""


def build_warning(code: str, *, file: str = "", **values: object) -> Notice:
    """Return the warning of a code about a fit, or about one of its logs."""
    return Notice(code=code, text=FIT_WARNINGS[code].format(**values), file=file)


def warn_of_processing(processing: Processing, recordings: Sequence[Recording]) -> tuple[Notice, ...]:
    """Return what is wrong with the filters for these recordings.

    Forward and backward, a filter of order n takes x / (1 + x) of what lies at a frequency f of samples T s
    apart, x = (tan(pi f T) / tan(pi f_c T))^2n: at the highest f that decimation keeps, less than matters.
    """
    cutoff, decimation = processing.filter_cutoff, processing.decimation
    if cutoff is None:
        return (build_warning("identify.no-filter"),)
    period = min(recording.period for recording in recordings)
    kept = 0.5 * decimation.band / period / decimation.factor
    share = (POLICY.relevance / (1.0 - POLICY.relevance)) ** (0.5 / processing.filter_order)
    least = math.atan(math.tan(math.pi * kept * period) / share) / (math.pi * period)
    if decimation.factor == 1 or cutoff >= least:
        return ()
    return (build_warning("identify.low-cutoff", cutoff=cutoff, kept=kept, least=least),)


def sum_block_scores(
    design: FloatArray, errors: FloatArray, groups: NDArray[np.intp], blocks: int
) -> tuple[FloatArray, int]:
    """Return sum_b F_b' e_b e_b' F_b (p, p) over blocks b of consecutive rows, and how many there are.

    Between (F'F)^-1 on either side it is the clustered covariance (Liang and Zeger 1986). `design` is F (m,
    p), `errors` e (m,), `groups` (m,) the number of the group of each row: each is cut into `blocks` at most.
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


def compute_block_deviations(
    rows: regression.Rows, fit: RegressionFit, identifiability: regression.Identifiability
) -> FloatArray:
    """Return standard deviations (p,) from the clustered covariance over blocks of each group's rows."""
    found = measure_influence(rows, identifiability.basis, fit.weights, fit.residuals)
    total, _ = sum_block_scores(found.scores, found.residuals, rows.group, regression.BLOCKS)
    return np.asarray(np.sqrt(np.maximum(np.diag(found.left @ total @ found.left.T), 0.0)))


def warn_of_correlated_residuals(
    rows: regression.Rows, fit: RegressionFit, identifiability: regression.Identifiability
) -> tuple[Notice, ...]:
    """Return a notice where residuals are correlated, so that the stated deviations are too small.

    Were they not, the variance of each parameter over blocks would be the stated one times chi-squared.
    """
    if rows.kind in regression.SCALAR_KINDS:
        return ()
    stated = np.sqrt(np.diag(fit.covariance))
    blocks = compute_block_deviations(rows, fit, identifiability)
    # A fit to the last bit leaves rounding, whose correlation has no meaning.
    least = numerics.EXACT * np.abs(fit.values).max()
    known = np.flatnonzero(identifiability.identifiable & (stated > least))
    ratios = blocks[known] / stated[known]
    chances = adjust_chances(scipy.special.chdtrc(regression.BLOCKS, regression.BLOCKS * ratios**2).tolist())
    far = np.flatnonzero(np.array(chances) < POLICY.alarm)
    if not len(far):
        return ()
    names = ", ".join(rows.names[k] for k in known[far])
    return (build_warning("identify.pattern", names=names, ratio=ratios[far].max()),)


def evaluate_inertia_columns(library: Library, q: FloatArray) -> Iterator[FloatArray]:
    """Yield the regressor (N, n, p) of each column of M(q), q (N, n): a unit acceleration at rest."""
    still = np.zeros_like(q)
    (weight,) = library.evaluate("torque_regressor", q, still, still)
    for joint in range(q.shape[1]):
        unit = still.copy()
        unit[:, joint] = 1.0
        (regressor,) = library.evaluate("torque_regressor", q, still, unit)
        yield regressor - weight


def warn_of_mass_matrix(
    library: Library, values: FloatArray, recordings: Sequence[Recording]
) -> tuple[Notice, ...]:
    """Return a notice where M, of values (p,), is not positive definite at poses of the recordings."""
    positions = np.vstack([recording.position for recording in recordings])
    poses = positions[
        np.linspace(0, len(positions) - 1, min(regression.STATES, len(positions))).round().astype(int)
    ]
    beta = values[: len(library.card.beta)]
    mass = np.stack([column @ beta for column in evaluate_inertia_columns(library, poses)], axis=2)
    least = np.linalg.eigvalsh((mass + np.swapaxes(mass, 1, 2)) / 2.0)[:, 0]
    bad = int(np.sum(least <= 0.0))
    return (build_warning("identify.impossible-mass", bad=bad, poses=len(poses)),) if bad else ()


def warn_of_poorly_identifiable(parameters: Sequence[ParameterEstimate]) -> tuple[Notice, ...]:
    """Return a notice on parameters whose standard deviation is a large part of them."""
    wide = (entry.name for entry in parameters if entry.relative_std_percent > POLICY.uncertain)
    poor = shorten_names(wide)
    told = build_warning("identify.poorly-identifiable", percent=POLICY.uncertain, names=poor)
    return (told,) if poor else ()


def warn_of_moving_ends(processing: Processing, recordings: Sequence[Recording]) -> tuple[Notice, ...]:
    """Return which logs begin or end in motion with nothing cut off there; `processing` is the one used."""
    notices = []
    for recording in recordings:
        spoilt = regression.measure_moving_ends(processing, [recording])
        ends = zip(("begins", "ends"), ("drop_first", "drop_last"), spoilt, strict=True)
        bad = [(verb, name) for verb, name, least in ends if getattr(processing, name) < least]
        if bad:
            told: dict[str, object] = {"cutoff": processing.filter_cutoff, "spoilt": max(spoilt)}
            told["ends"] = " and ".join(verb for verb, _ in bad)
            told["settings"] = " ".join(f"--set processing.{name}={max(spoilt)}" for _, name in bad)
            notices.append(build_warning("identify.moving-ends", file=recording.source, **told))
    return tuple(notices)


def describe_proportion(first: str, second: str, file: str = "") -> Notice:
    """Return a notice on two joints that move in proportion."""
    text = f"joints {first!r} and {second!r} move in proportion throughout, so that their parameters "
    text += "cannot be separated: move each joint on its own as well"
    return Notice(code="log.in-proportion", text=text, file=file)
