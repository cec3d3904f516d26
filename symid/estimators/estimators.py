"""How equations become parameters: all estimators under their names.

Input: rows, what they can tell, options. Output: `Fit`.

Supported: any estimator with any kind of rows; what does not go together is refused in words.
"""

from collections.abc import Callable
from dataclasses import dataclass

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.estimators.bodies import Bodies
from symid.estimators.consistent import fit_consistent
from symid.estimators.gls import fit_gls
from symid.estimators.huber import fit_huber
from symid.estimators.prior import Prior
from symid.estimators.regression import Fit, fit_ols, fit_wls
from symid.estimators.ridge import fit_ridge
from symid.estimators.sequential import fit_sequential
from symid.rows.identifiability import Identifiability
from symid.rows.rows import Rows

__all__ = ["ESTIMATORS", "EstimatorOptions", "fit_rows"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EstimatorOptions:
    """What estimators need besides rows; each reads its own.

    `prior` and `prior_weight` (None to choose it) are those of ridge; `bodies` of consistent; `noise` (g, g)
    the covariance of the noise between joints for gls, None to estimate it.
    """

    prior: Prior | None = None
    prior_weight: float | None = None
    bodies: Bodies | None = None
    noise: FloatArray | None = None


def _fit_near_prior(rows: Rows, seen: Identifiability, freedom: str, options: EstimatorOptions) -> Fit:
    if options.prior is None:
        text = "the estimator ridge stays near a prior: name one, the robot file's values or an estimate"
        raise UsageError(Notice(code="usage.no-prior", text=text))
    return fit_ridge(rows, seen, freedom, prior=options.prior, weight=options.prior_weight)


def _fit_bodies(rows: Rows, seen: Identifiability, freedom: str, options: EstimatorOptions) -> Fit:
    if options.bodies is None:
        text = "the estimator consistent needs the bodies of the robot: give them in the options"
        raise UsageError(Notice(code="usage.no-bodies", text=text))
    return fit_consistent(rows, seen, freedom, bodies=options.bodies)


Fitting = Callable[[Rows, Identifiability, str, EstimatorOptions], Fit]

ESTIMATORS: dict[str, Fitting] = {
    "ols": lambda rows, seen, freedom, _: fit_ols(rows, seen, freedom),
    "wls": lambda rows, seen, freedom, _: fit_wls(rows, seen, freedom),
    "gls": lambda rows, seen, freedom, options: fit_gls(rows, seen, freedom, options.noise),
    "huber": lambda rows, seen, freedom, _: fit_huber(rows, seen, freedom),
    "ridge": _fit_near_prior,
    "consistent": _fit_bodies,
    "sequential": lambda rows, seen, freedom, _: fit_sequential(rows, seen, freedom),
}


def fit_rows(
    estimator: str,
    rows: Rows,
    seen: Identifiability,
    freedom: str = "band",
    options: EstimatorOptions | None = None,
) -> Fit:
    """Return the fit of the estimator called `estimator`, one of `ESTIMATORS`.

    Raises:
        UsageError: it does not fit the rows, or lacks an option.
        SolverError: it found no optimum.
    """
    return ESTIMATORS[estimator](rows, seen, freedom, options or EstimatorOptions())
