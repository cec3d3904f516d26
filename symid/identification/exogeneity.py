"""Whether least squares of the same rows are biased by noise of the states: the test of Durbin, Wu, Hausman.

Input: measured rows and what instruments found. Output: `Exogeneity`.

    min |tau - Y x - V c|_W,     V = Y - Z (Z' W Z)^-1 Z' W Y     what instruments do not explain of Y
    F = (|e_wls|^2 - |e|^2) / k / (|e|^2 / (b m - r - k))         k columns of V that Y does not have

Where the noise of the torque is all there is, F is of the distribution F(k, b m - r - k), and instruments
and least squares differ by no more than chance. The numerator is the difference of both, weighed by the
difference of their covariances (Hausman 1978, Econometrica 46; Davidson and MacKinnon 1989).

A shift that the test can tell need not matter. Least squares are called biased where chance has less than
one in a hundred, and a parameter shifts by more than its deviation.

Supported: rows of any rank; weighed recordings.
Not supported: telling noise of the states from what the model misses, if that differs between both states.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.estimators.instrumental import InstrumentalSolution
from symid.estimators.regression import Fit, fit_weighted
from symid.rows.rows import Rows

__all__ = ["Exogeneity", "find_exogeneity"]

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


def find_exogeneity(rows: Rows, found: InstrumentalSolution, freedom: str = "band") -> Exogeneity:
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
    independent = rows.independent if freedom == "band" else 1.0
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


def _fit_usual(rows: Rows, found: InstrumentalSolution, freedom: str) -> Fit:
    """Return least squares in the directions that instruments see, with the same weights."""
    weights = np.ones(len(rows.group_names))
    ratio = found.fit.weights / np.sqrt(rows.weight)
    for index in range(len(weights)):
        members = np.flatnonzero(rows.group == index)
        weights[index] = ratio[members[0]] if len(members) else 1.0
    return fit_weighted(rows, found.seen, weights, freedom)


def _list_shifts(rows: Rows, found: InstrumentalSolution, usual: Fit) -> tuple[tuple[str, float], ...]:
    shift: FloatArray = usual.values - found.fit.values
    deviation = np.sqrt(np.maximum(np.diag(usual.covariance), 0.0))
    # A fit to the last bit leaves rounding in both.
    exact = np.abs(shift) <= 1e-12 * np.abs(found.fit.values)
    sizes = np.where(exact, 0.0, shift / np.where(deviation > 0.0, deviation, np.inf))
    return tuple((rows.names[k], float(sizes[k])) for k in np.flatnonzero(found.seen.learnable))
