"""Instrumental variables: equations whose matrix is noisy, solved with the help of one that is not.

Input: measured rows Y x = tau, and instruments Z, the same rows along states without noise. Output:
`InstrumentalSolution`.

    x = (Z' W Y)^-1 Z' W tau,     cov x = s^2 (Z' W Y)^-1 Z' W Z (Y' W Z)^-1,     s^2 = |e|^2_W / (b m - r)

with e = tau - Y x and W the inverse variances of the joints, taken from e until they settle. Noise of the
states stands in Y and so in e; least squares multiply both, and what they make of it does not average out. Z
knows nothing of the noise. No product is formed: of W^(1/2) Z = Q R only Q is needed, and x solves Q' W^(1/2)
Y x = Q' W^(1/2) tau, which is as well conditioned as least squares; with Z = Y it is least squares.

How much of Y the instruments explain is the least canonical correlation c between both: of r parameters and
m rows worth b m, F = c^2 / (1 - c^2) (b m - r) / r is the smallest statistic of the first stage (Cragg and
Donald 1993, Econometric Theory 9). Below ten the instruments are weak (Staiger and Stock 1997, Econometrica
65): the result leans towards that of least squares, and deviations are too small.

Supported: rank-deficient rows: directions that Y or Z do not see stay at zero; weighed recordings.
Not supported: rows of all joints together; more instruments than parameters.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import IdentifiabilityError, Notice
from symid.estimators.condensed_fit import settle_weights
from symid.estimators.regression import Fit
from symid.rows.condensation import condense_rows
from symid.rows.identifiability import (
    Identifiability,
    RankRule,
    find_identifiability,
    find_spectrum,
)
from symid.rows.rows import Rows

__all__ = ["InstrumentalSolution", "fit_instruments"]

_BLIND = "identify.blind-instruments"
_BARELY = 1e-7
"""Smallest to largest singular value of Z' Y, columns scaled, below which it has no inverse."""
_WEAK = 10.0
"""F of the first stage below which instruments are called weak."""
_WHOLE = 1e-12
"""1 - c^2 is rounding below this."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InstrumentalSolution:
    """What instruments find.

    Args:
        fit: its residuals are those of the measured rows.
        seen: what Y and Z tell both.
        explained: (m, p) Z (Z' W Z)^-1 Z' W Y, the part of Y that instruments explain.
        correlation: c, from zero to one; strength: F, infinite where Z explains Y wholly.
    """

    fit: Fit
    seen: Identifiability
    explained: FloatArray
    correlation: float
    strength: float

    def __post_init__(self) -> None:
        """Copy the array and make it read-only."""
        object.__setattr__(self, "explained", freeze(self.explained))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stage:
    """The first stage for given weights: row factors (m,), Q (m, k), Q' W^(1/2) Y (k, p) and tau (k,)."""

    factors: FloatArray
    frame: FloatArray
    matrix: FloatArray
    values: FloatArray


def fit_instruments(
    rows: Rows, instruments: Rows, rule: RankRule | None = None, freedom: str = "band"
) -> InstrumentalSolution:
    """Return the parameters that the instruments find.

    Args:
        rows: measured, Y (m, p) and tau (m,), in the rows' units.
        instruments: Z (m, p) of the same rows, in the same order.
        rule: when a parameter counts as not seen.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.

    Raises:
        IdentifiabilityError: nothing can be learnt from rows and instruments together.
    """
    measured = find_identifiability(rows, rule)
    seen = _see(_cut_instruments(rows, measured, instruments), rule)
    used = 1 if freedom == "one" else int(seen.basis.shape[1])

    def solve(weights: FloatArray) -> FloatArray:
        return _solve(_explain(rows, instruments.matrix @ seen.basis, weights), seen.basis)[0]

    weights = settle_weights(condense_rows(rows), solve, used)
    stage = _explain(rows, instruments.matrix @ seen.basis, weights)
    values, root = _solve(stage, seen.basis)
    residuals = rows.values - rows.matrix @ values
    weighted = residuals * stage.factors
    independent = rows.independent if freedom == "band" else 1.0
    variance = float(weighted @ weighted) / (independent * len(weighted) - used)
    correlation, strength = _find_strength(rows, stage, seen.basis)
    spectrum = find_spectrum(stage.matrix)
    fit = Fit(
        values=values,
        covariance=variance * (root @ root.T),
        residuals=residuals,
        spent=used,
        condition=float(spectrum.singular[0] / spectrum.singular[seen.basis.shape[1] - 1]),
        weights=stage.factors,
        notices=(*_warn_of_blindness(rows, measured, seen), *_warn_of_weakness(strength)),
    )
    explained = (stage.frame @ stage.matrix) / stage.factors[:, None]
    return InstrumentalSolution(
        fit=fit, seen=seen, explained=explained, correlation=correlation, strength=strength
    )


def _see(instruments: Rows, rule: RankRule | None) -> Identifiability:
    try:
        return find_identifiability(instruments, rule)
    except IdentifiabilityError as error:
        text = (
            "the simulated states tell too little, whatever the measured ones do: the reference of the log "
            "hardly moves, or the simulated robot does not follow it; check q_ref, its unit and [controller]"
        )
        raise IdentifiabilityError(Notice(code=_BLIND, text=text), *error.notices) from error


def _cut_instruments(rows: Rows, measured: Identifiability, instruments: Rows) -> Rows:
    """Return the instruments without what Y does not see: Z P, with P x = x where Y sees x, 0 where not."""
    basis = measured.basis
    if basis.shape[1] == basis.shape[0]:
        return instruments
    kept, *_ = np.linalg.lstsq(rows.matrix @ basis, rows.matrix, rcond=None)
    return replace(instruments, matrix=instruments.matrix @ basis @ kept)


def _explain(rows: Rows, instruments: FloatArray, weights: FloatArray) -> _Stage:
    """Return the first stage with weights (g,) of the groups."""
    factors = weights[rows.group] * np.sqrt(rows.weight)
    frame, _ = np.linalg.qr(instruments * factors[:, None])
    return _Stage(
        factors=factors,
        frame=frame,
        matrix=frame.T @ (rows.matrix * factors[:, None]),
        values=frame.T @ (rows.values * factors),
    )


def _solve(stage: _Stage, basis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return parameters (p,) in the span of `basis` (p, r), and the root of their covariance (p, r)."""
    left, singular, right = np.linalg.svd(stage.matrix @ basis, full_matrices=False)
    if singular[-1] <= _BARELY * singular[0]:
        text = (
            "in some direction the simulated states have nothing in common with the measured ones: the "
            "reference is of another run, or the controller is not the one of the log"
        )
        raise IdentifiabilityError(Notice(code=_BLIND, text=text))
    root = basis @ (right.T / singular)
    return root @ (left.T @ stage.values), root


def _find_strength(rows: Rows, stage: _Stage, basis: FloatArray) -> tuple[float, float]:
    """Return the least canonical correlation of instruments and columns, and F of the first stage."""
    columns, _ = np.linalg.qr((rows.matrix @ basis) * stage.factors[:, None])
    count = basis.shape[1]
    correlation = min(1.0, float(np.linalg.svd(stage.frame.T @ columns, compute_uv=False)[count - 1]))
    left = 1.0 - correlation**2
    if left < _WHOLE:
        return correlation, float("inf")
    worth = rows.independent * len(rows.values)
    return correlation, correlation**2 / left * (worth - count) / count


def _warn_of_blindness(rows: Rows, measured: Identifiability, seen: Identifiability) -> tuple[Notice, ...]:
    """Return a notice where Z cannot tell what Y can."""
    hidden = measured.learnable & ~seen.learnable
    if not hidden.any():
        return ()
    names = ", ".join(rows.names[k] for k in np.flatnonzero(hidden))
    text = (
        f"the simulated states cannot tell {names}, though the measured ones do: by their noise alone, or "
        "because a joint stands still in the simulation that moves in the log; then the others bear what "
        "is left out"
    )
    return (Notice(code=_BLIND, text=text),)


def _warn_of_weakness(strength: float) -> tuple[Notice, ...]:
    if strength >= _WEAK:
        return ()
    text = (
        "the instruments are weak: the simulated states say too little of the measured ones (F of the first "
        f"stage is {strength:.3g}, below {_WEAK:g}); the result leans towards that of wls, and its "
        "deviations are too small: the controller of the log is another one, or positions are hardly more "
        "than noise"
    )
    return (Notice(code="identify.weak-instruments", text=text),)
