"""Instrumental variables for equations with a noisy matrix, and a test whether least squares are biased.

Measured rows Y x = tau, instruments Z (the same rows along states without noise) -> InstrumentalSolution ->
Exogeneity.

    x = (Z' W Y)^-1 Z' W tau,     cov x = s^2 (Z' W Y)^-1 Z' W Z (Y' W Z)^-1,     s^2 = |e|^2_W / (b m - r)

with e = tau - Y x and W the inverse variances of the joints, iterated from e until they converge. Noise of
the states stands in Y and so in e; least squares multiply both, which does not average out. Z knows nothing
of the noise. No product is formed: of W^(1/2) Z = Q R only Q is needed, and x solves Q' W^(1/2) Y x = Q'
W^(1/2) tau, as well conditioned as least squares; with Z = Y it is least squares.

How much of Y the instruments explain is the least canonical correlation c between both: of r parameters and
m rows worth b m, F = c^2 / (1 - c^2) (b m - r) / r is the smallest statistic of the first stage (Cragg and
Donald 1993, Econometric Theory 9). Below ten the instruments are weak (Staiger and Stock 1997, Econometrica
65): the result leans towards that of least squares, and deviations are too small.

Whether least squares of the same rows are biased by noise of the states is the test of Durbin, Wu and
Hausman:

    min |tau - Y x - V c|_W,     V = Y - Z (Z' W Z)^-1 Z' W Y     what instruments do not explain of Y
    F = (|e_wls|^2 - |e|^2) / k / (|e|^2 / (b m - r - k))         k columns of V that Y does not have

Where the noise of the torque is all there is, F has the distribution F(k, b m - r - k). The numerator is
the difference of both fits, weighed by the difference of their covariances (Hausman 1978, Econometrica 46;
Davidson and MacKinnon 1989). Least squares are called biased where chance has less than one in a hundred,
and a parameter shifts by more than its standard deviation.

Supported: rank-deficient rows (directions that Y or Z do not see stay at zero); recordings of unequal
weight.
Not supported: rows of all joints together; more instruments than parameters; telling noise of the states
from what the model misses, if that differs between both states.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import IdentifiabilityError, Notice
from symid.identification.estimators.least_squares import RegressionFit, fit_weighted, iterate_weights
from symid.identification.regression import (
    Identifiability,
    RankRule,
    Rows,
    analyse_identifiability,
    compute_spectrum,
    condense_rows,
    count_freedom,
)

_BLIND = "identify.blind-instruments"
_BARELY = 1e-7
"""Smallest to largest singular value of Z' Y, columns scaled, below which it has no inverse."""
_WEAK = 10.0
"""F of the first stage below which instruments are called weak."""
_WHOLE = 1e-12
"""1 - c^2 is rounding below this."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InstrumentalSolution(FrozenArrays):
    """What instruments find.

    Args:
        fit: its residuals are those of the measured rows.
        seen: what Y and Z tell both.
        explained: (m, p) Z (Z' W Z)^-1 Z' W Y, the part of Y that instruments explain.
        correlation: c, from zero to one; strength: F, infinite where Z explains Y wholly.
    """

    fit: RegressionFit
    seen: Identifiability
    explained: FloatArray
    correlation: float
    strength: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _FirstStage:
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
    measured = analyse_identifiability(rows, rule)
    seen = _analyse_instruments(_cut_instruments(rows, measured, instruments), rule)
    used, independent = count_freedom(freedom, int(seen.basis.shape[1]), rows.independent)

    def solve(weights: FloatArray) -> FloatArray:
        return _solve_second_stage(
            _fit_first_stage(rows, instruments.matrix @ seen.basis, weights), seen.basis
        )[0]

    weights = iterate_weights(condense_rows(rows), solve, used)
    stage = _fit_first_stage(rows, instruments.matrix @ seen.basis, weights)
    values, root = _solve_second_stage(stage, seen.basis)
    residuals = rows.values - rows.matrix @ values
    weighted = residuals * stage.factors
    variance = float(weighted @ weighted) / (independent * len(weighted) - used)
    correlation, strength = _measure_strength(rows, stage, seen.basis)
    spectrum = compute_spectrum(stage.matrix)
    fit = RegressionFit(
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


def _analyse_instruments(instruments: Rows, rule: RankRule | None) -> Identifiability:
    try:
        return analyse_identifiability(instruments, rule)
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


def _fit_first_stage(rows: Rows, instruments: FloatArray, weights: FloatArray) -> _FirstStage:
    """Return the first stage with weights (g,) of the groups."""
    factors = weights[rows.group] * np.sqrt(rows.weight)
    frame, _ = np.linalg.qr(instruments * factors[:, None])
    return _FirstStage(
        factors=factors,
        frame=frame,
        matrix=frame.T @ (rows.matrix * factors[:, None]),
        values=frame.T @ (rows.values * factors),
    )


def _solve_second_stage(stage: _FirstStage, basis: FloatArray) -> tuple[FloatArray, FloatArray]:
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


def _measure_strength(rows: Rows, stage: _FirstStage, basis: FloatArray) -> tuple[float, float]:
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


_RANK = 1e-7
"""A direction of V shorter than this beside columns of length one is rounding."""
_CHANCE = 0.01
_MATTERS = 1.0
"""Shift in standard deviations of least squares above which it matters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exogeneity:
    """The verdict on least squares.

    Args:
        statistic: F, zero where there is nothing to test; freedom: of numerator and denominator.
        probability: of so large an F by chance.
        shifts: (name, shift) of learnable parameters: least squares less instruments, in standard deviations
            of least squares; zero where both are exact.
    """

    statistic: float
    freedom: tuple[int, float]
    probability: float
    shifts: tuple[tuple[str, float], ...]

    @property
    def told(self) -> bool:
        """Return whether more than chance lies between both."""
        return self.probability < _CHANCE

    @property
    def biased(self) -> tuple[tuple[str, float], ...]:
        """Return the shifts that matter, the largest first; none where chance explains them."""
        far = [entry for entry in self.shifts if self.told and abs(entry[1]) > _MATTERS]
        return tuple(sorted(far, key=lambda entry: -abs(entry[1])))


def assess_exogeneity(rows: Rows, found: InstrumentalSolution, freedom: str = "band") -> Exogeneity:
    """Return whether least squares of `rows`, weighted as the instruments' fit, differ by more than chance.

    Args:
        rows: measured.
        found: what instruments made of them.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
    """
    from scipy.special import fdtrc

    factors, basis = found.fit.weights, found.seen.basis
    usual = _fit_usual(rows, found, freedom)
    columns, _ = np.linalg.qr((rows.matrix @ basis) * factors[:, None])
    hidden = ((rows.matrix - found.explained) @ basis) * factors[:, None]
    hidden = hidden / np.linalg.norm((rows.matrix @ basis) * factors[:, None], axis=0)
    for _ in range(2):  # a second time for what rounding left
        hidden = hidden - columns @ (columns.T @ hidden)
    left, singular, _ = np.linalg.svd(hidden, full_matrices=False)
    apart = left[:, singular > _RANK]
    errors = usual.residuals * factors
    gained = float(np.sum((apart.T @ errors) ** 2))
    _, independent = count_freedom(freedom, basis.shape[1], rows.independent)
    count, learnt = apart.shape[1], basis.shape[1]
    free = independent * len(errors) - learnt - count
    rest = float(errors @ errors) - gained
    statistic, probability = 0.0, 1.0
    if count and free > 0.0 and rest > 0.0:
        statistic = gained / count / (rest / free)
        probability = float(fdtrc(count, free, statistic))
    return Exogeneity(
        statistic=statistic,
        freedom=(count, free),
        probability=probability,
        shifts=_list_shifts(rows, found, usual),
    )


def _fit_usual(rows: Rows, found: InstrumentalSolution, freedom: str) -> RegressionFit:
    """Return least squares in the directions that instruments see, with the same weights."""
    weights = np.ones(len(rows.group_names))
    ratio = found.fit.weights / np.sqrt(rows.weight)
    for index in range(len(weights)):
        members = np.flatnonzero(rows.group == index)
        weights[index] = ratio[members[0]] if len(members) else 1.0
    return fit_weighted(rows, found.seen, weights, freedom)


def _list_shifts(
    rows: Rows, found: InstrumentalSolution, usual: RegressionFit
) -> tuple[tuple[str, float], ...]:
    shift: FloatArray = usual.values - found.fit.values
    deviation = np.sqrt(np.maximum(np.diag(usual.covariance), 0.0))
    # A fit to the last bit leaves rounding in both.
    exact = np.abs(shift) <= 1e-12 * np.abs(found.fit.values)
    sizes = np.where(exact, 0.0, shift / np.where(deviation > 0.0, deviation, np.inf))
    return tuple((rows.names[k], float(sizes[k])) for k in np.flatnonzero(found.seen.learnable))
