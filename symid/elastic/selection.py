"""The automatic choice: which methods run, and which result is taken.

ElasticWork -> Selection.

Every candidate is scored on torques that were held out (`choice`); the surest of those that foretell best is
taken. The one-shot problem knows most, for its springs tie the torques of motors and links together, but only
where its springs are right. So it must first agree with the weighted elimination, which needs no springs
(Hausman 1978):

    (chi_nlp - chi_w)' C_w^-1 (chi_nlp - chi_w) <= chi^2_0.999(parameters),   C_w the covariance of chi_w

Supported: a machine without CasADi: the one-shot problem is left out, and a notice says so.
Not supported: a choice of springs apart from dynamics.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.elastic.choice import Score, choose_candidate
from symid.elastic.fit import ElasticFit
from symid.elastic.methods import ElasticWork, find_candidate, fit_method
from symid.errors import Notice

__all__ = ["CANDIDATES", "Selection", "choose_fit", "fit_candidates"]

CANDIDATES = ("linear-spring", "two-step", "elimination", "weighted", "nlp")
_LEVEL = 0.999


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Selection:
    """The fit taken, the scores of all that could be, why, and what a reader should know."""

    fit: ElasticFit
    scores: tuple[Score, ...]
    reason: str
    notices: tuple[Notice, ...] = ()


def fit_candidates(work: ElasticWork) -> tuple[tuple[ElasticFit, ...], tuple[Notice, ...]]:
    """Return the fits of all candidates that can run here, and which cannot."""
    if _has_casadi():
        return tuple(fit_method(work, method) for method in CANDIDATES), ()
    text = "CasADi is not installed: the method nlp was not among those compared"
    fits = tuple(fit_method(work, method) for method in CANDIDATES if method != "nlp")
    return fits, (Notice(code="elastic.no-casadi", text=text),)


def _has_casadi() -> bool:
    try:
        import casadi  # noqa: F401  # only whether it is there
    except ImportError:
        return False
    return True


def choose_fit(work: ElasticWork, fits: Sequence[ElasticFit]) -> Selection:
    """Return the choice among `fits`, at least one of which is usable."""
    usable = [fit for fit in fits if fit.outcome.usable and np.all(np.isfinite(fit.chi))]
    agreeing = [
        fit for fit in usable if fit.method != "nlp" or _find_distance(work, fit) <= _find_limit(work)
    ]
    kept = agreeing or usable
    candidates = [find_candidate(work, fit) for fit in kept]
    best, scores = choose_candidate(candidates, work.rows, work.band.scatter)
    taken = next(score for score in scores if score.name == best)
    close = sum(score.is_close(min(entry.error for entry in scores)) for score in scores)
    among = f"is the surest of the {close} that foretell" if close > 1 else "foretells"
    reason = (
        f"of {len(scores)} methods {best} {among} best the torques that dynamics were not fitted to, springs "
        f"held as found: mean squared error {taken.error:.4g} in units of the noise"
    )
    notices = tuple(_say_contradiction(work, fit) for fit in usable if fit not in kept)
    return Selection(
        fit=next(fit for fit in kept if fit.method == best), scores=scores, reason=reason, notices=notices
    )


def _find_distance(work: ElasticWork, fit: ElasticFit) -> float:
    """Return (chi - chi_w)' C_w^-1 (chi - chi_w)."""
    told = np.flatnonzero(np.isfinite(np.diag(work.band.covariance)))
    covariance = work.band.covariance[np.ix_(told, told)]
    lengths = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    inverse = np.linalg.pinv(covariance / np.outer(lengths, lengths), rcond=1e-12, hermitian=True)
    scaled = (fit.chi - work.band.chi)[told] / lengths
    return float(scaled @ inverse @ scaled)


def _find_limit(work: ElasticWork) -> float:
    from scipy.special import chdtri

    count = np.count_nonzero(np.isfinite(np.diag(work.band.covariance)))
    return float(chdtri(count, 1.0 - _LEVEL))


def _say_contradiction(work: ElasticWork, fit: ElasticFit) -> Notice:
    text = (
        f"the method {fit.method} contradicts what the motions show without springs (chi^2 "
        f"{_find_distance(work, fit):.3g}, limit {_find_limit(work):.3g}) and was left out of the choice: "
        "its springs do not describe these joints well enough"
    )
    return Notice(code="elastic.contradiction", text=text)
