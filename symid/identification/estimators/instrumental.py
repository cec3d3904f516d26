"""Instrumental variables for equations with a noisy matrix, and a test whether least squares are biased.

Measured rows Y x = tau, instruments Z (along states without noise) -> InstrumentalSolution -> Exogeneity.

    x = (Z' W Y)^-1 Z' W tau,     cov x = s^2 (Z' W Y)^-1 Z' W Z (Y' W Z)^-1,     s^2 = |e|^2_W / (b m - r)

with e = tau - Y x and W the inverse variances of the joints, iterated from e until they converge. Only Q of
W^(1/2) Z = Q R is needed: x solves Q' W^(1/2) Y x = Q' W^(1/2) tau, as well conditioned as least squares. The
triangle of each joint's [Z Y tau] stands for its rows there: W is one number for all of them.

With c the least canonical correlation of Y and Z, F = c^2 / (1 - c^2) (b m - r) / r is the smallest statistic
of the first stage (Cragg and Donald 1993), and 1 / F about the part of the bias of least squares that
instruments leave (Staiger and Stock 1997): where it matters, they are weak. Bias is tested as by Durbin, Wu
and Hausman (Hausman 1978; Davidson and MacKinnon 1989):

    min |tau - Y x - V c|_W,     V = Y - Z (Z' W Z)^-1 Z' W Y     what instruments do not explain of Y
    F = (|e_wls|^2 - |e|^2) / k / (|e|^2 / (b m - r - k))         k columns of V that Y does not have

Supported: rank-deficient rows (unobservable directions stay at zero); recordings of unequal weight.
Not supported: rows of all joints together; more instruments than parameters.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import IdentifiabilityError, Notice
from symid.identification import regression
from symid.identification.estimators.least_squares import RegressionFit, fit_weighted, iterate_weights
from symid.identification.judge import POLICY, numerics
from symid.identification.regression import Identifiability, Rows

_BLIND = "identify.blind-instruments"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InstrumentalSolution(FrozenArrays):
    """The estimate by instruments, and what is identifiable from Y and Z together.

    `matrix` (k, p) Q' W^(1/2) Y, what instruments explain of Y in the frame Q (`frame`, (m, k)); `gain` (p,
    k), x = gain Q' W^(1/2) tau; `correlation` c, from zero to one; `strength` F, infinite where Z explains Y
    wholly.
    """

    fit: RegressionFit
    identifiability: Identifiability
    matrix: FloatArray
    frame: FloatArray
    gain: FloatArray
    correlation: float
    strength: float


def fit_instruments(
    rows: Rows,
    instruments: Rows,
    rule: regression.RankRule | None = None,
    freedom: str = "band",
    *,
    simulated: bool = True,
) -> InstrumentalSolution:
    """Return the parameters by instrumental variables.

    `rows` have the measured Y (m, p) and tau (m,), `instruments` Z (m, p) in the same order; `freedom` as in
    `Processing.noise_freedom`. States of the instruments are `simulated`, or measured and smooth.
    """
    measured = regression.analyse_identifiability(rows, rule)
    # What Z P identifies, P x = x in directions that Y observes and 0 in the others.
    seen, basis = instruments, measured.basis
    if basis.shape[1] < basis.shape[0]:
        projected, *_ = np.linalg.lstsq(rows.matrix @ basis, rows.matrix, rcond=None)
        seen = replace(instruments, matrix=instruments.matrix @ basis @ projected)
    try:
        identifiability = regression.analyse_identifiability(seen, rule)
    except IdentifiabilityError as error:
        text = "the simulated robot does not excite enough parameters: the reference of the log hardly "
        text += "moves, or the simulated robot does not follow it; check q_ref, its unit and [controller]"
        raise _refuse(text, *error.notices, simulated=simulated) from error
    basis = identifiability.basis
    count = int(basis.shape[1])
    condensed = regression.condense_weighted(rows, rows.weight, instruments.matrix)
    solve = partial(_solve_stages, condensed.factors, basis, simulated=simulated)
    weights = iterate_weights(regression.condense_rows(rows), solve, freedom)
    values, leverage, gain, matrix, triangle, correlation = solve(weights)
    factors = weights[rows.group] * np.sqrt(rows.weight)
    frame = instruments.matrix @ basis
    frame *= factors[:, None]
    frame = scipy.linalg.solve_triangular(triangle, frame.T, trans="T", overwrite_b=True).T
    spent, independent = regression.count_freedom(freedom, leverage, rows.independent)
    residuals = rows.values - rows.matrix @ values
    weighted = residuals * factors
    variance = float(weighted @ weighted) / (independent * (len(weighted) - float(spent.sum())))
    # F of the first stage.
    left, strength = 1.0 - correlation**2, np.inf
    if left >= numerics.EXACT:
        strength = correlation**2 / left * (rows.independent * len(rows.values) - count) / count
    singular = regression.compute_spectrum(matrix).singular
    notices = []
    hidden = np.flatnonzero(measured.identifiable & ~identifiability.identifiable)
    states = "simulated" if simulated else "smooth"
    if len(hidden):
        rests = ", or because a joint that moves in the log rests in the simulation" if simulated else ""
        text = f"the {states} states do not identify {', '.join(rows.names[k] for k in hidden)}, the "
        text += f"measured ones do: only by their noise{rests}; the other parameters may be biased"
        notices.append(Notice(code=_BLIND, text=text))
    if strength * POLICY.relevance < 1.0:
        cause = "the controller of the log" if simulated else "processing.instrument_cutoff"
        text = f"the instruments are weak (F of the first stage is {strength:.3g}): they leave about "
        text += f"{100.0 / max(strength, 1.0):.2g} % of the bias of wls, and the standard deviations are too "
        text += f"small; check {cause}, and the noise of the positions"
        notices.append(Notice(code="identify.weak-instruments", text=text))
    fit = RegressionFit(
        values=values,
        covariance=variance * (gain @ gain.T),
        residuals=residuals,
        spent=spent,
        condition=float(singular[0] / singular[count - 1]),
        weights=factors,
        notices=tuple(notices),
    )
    return InstrumentalSolution(
        fit=fit,
        identifiability=identifiability,
        matrix=matrix,
        frame=frame,
        gain=gain,
        correlation=correlation,
        strength=strength,
    )


def _refuse(text: str, *reasons: Notice, simulated: bool) -> IdentifiabilityError:
    """Return the error of instruments that see too little, in other words where they are smooth states."""
    if simulated:
        return IdentifiabilityError(Notice(code=_BLIND, text=text), *reasons)
    text = "the instruments, along positions below processing.instrument_cutoff, do not determine the "
    text += "parameters: state a higher one, or take another estimator (--estimator wls)"
    return IdentifiabilityError(Notice(code=_BLIND, text=text))


def _solve_stages(
    triangles: FloatArray, basis: FloatArray, weights: FloatArray, *, simulated: bool
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Return x (p,), leverage (g,), gain (p, k), Q' W^(1/2) Y (k, p), R (k, k), the least correlation.

    `triangles` (g, 2 p + 1, 2 p + 1) are those of [Z Y tau] of every group, `weights` (g,).
    """
    size = len(basis)
    stacked = triangles * weights[:, None, None]
    weighted = stacked[:, :, size:-1].reshape(-1, size)
    frame, triangle = np.linalg.qr(stacked[:, :, :size].reshape(-1, size) @ basis)
    matrix = frame.T @ weighted
    left, singular, right = np.linalg.svd(matrix @ basis, full_matrices=False)
    if singular[-1] <= regression.RankRule().singular * singular[0]:
        text = "simulated and measured states are uncorrelated in some direction: the reference belongs to "
        text += "another run, or the controller is not that of the log"
        raise _refuse(text, simulated=simulated)
    gain: FloatArray = basis @ (right.T / singular) @ left.T
    # The diagonal of W^(1/2) Y times the gain times Q', which takes the measured values to those of the fit.
    leverage = np.sum(((weighted @ gain) * frame).reshape(len(weights), -1), axis=1)
    # The least canonical correlation of instruments and columns.
    measured, _ = np.linalg.qr(weighted @ basis)
    correlation = min(1.0, float(np.linalg.svd(frame.T @ measured, compute_uv=False)[-1]))
    values = gain @ (frame.T @ stacked[:, :, -1].ravel())
    return values, leverage, gain, matrix, triangle, correlation


@dataclass(frozen=True, slots=True)
class Exogeneity:
    """The test of least squares for bias.

    `statistic` F is zero where there is nothing to test, `freedom` of numerator and denominator; `shifts` of
    identifiable parameters are least squares less instruments, in standard deviations of least squares.
    """

    statistic: float
    freedom: tuple[int, float]
    probability: float
    shifts: tuple[tuple[str, float], ...]

    @property
    def significant(self) -> bool:
        """Return whether both differ by more than chance."""
        return self.probability < POLICY.alarm

    @property
    def biased(self) -> tuple[tuple[str, float], ...]:
        """Return the shifts that matter, the largest first; none where chance explains them."""
        far = [entry for entry in self.shifts if self.significant and abs(entry[1]) > POLICY.printed]
        return tuple(sorted(far, key=lambda entry: -abs(entry[1])))


def assess_exogeneity(rows: Rows, found: InstrumentalSolution, freedom: str = "band") -> Exogeneity:
    """Return whether least squares of measured rows, weighted as the instruments' fit, are biased."""
    factors, basis = found.fit.weights, found.identifiability.basis
    weights = np.ones(len(rows.group_names))
    groups, first = np.unique(rows.group, return_index=True)
    weights[groups] = (factors / np.sqrt(rows.weight))[first]
    usual = fit_weighted(rows, found.identifiability, weights, freedom)
    weighted = (rows.matrix @ basis) * factors[:, None]
    columns, _ = np.linalg.qr(weighted)
    hidden = weighted - found.frame @ (found.matrix @ basis)
    hidden = hidden / np.linalg.norm(weighted, axis=0)
    for _ in range(2):  # a second time for what rounding left
        hidden = hidden - columns @ (columns.T @ hidden)
    left, singular, _ = np.linalg.svd(hidden, full_matrices=False)
    apart = left[:, singular > regression.RankRule().singular]
    errors = usual.residuals * factors
    gained = float(np.sum((apart.T @ errors) ** 2))
    _, independent = regression.count_freedom(freedom, usual.spent, rows.independent)
    count = apart.shape[1]
    free = independent * len(errors) - basis.shape[1] - count
    rest = float(errors @ errors) - gained
    statistic, probability = 0.0, 1.0
    if count and free > 0.0 and rest > 0.0:
        statistic = gained / count / (rest / free)
        probability = float(scipy.special.fdtrc(count, free, statistic))
    shift: FloatArray = usual.values - found.fit.values
    deviation = np.sqrt(np.maximum(np.diag(usual.covariance), 0.0))
    # A fit to the last bit leaves rounding in both.
    exact = np.abs(shift) <= numerics.EXACT * np.abs(found.fit.values)
    sizes = np.where(exact, 0.0, shift / np.where(deviation > 0.0, deviation, np.inf))
    places = np.flatnonzero(found.identifiability.identifiable)
    shifts = tuple((rows.names[k], float(sizes[k])) for k in places)
    return Exogeneity(statistic, (count, free), probability, shifts)
