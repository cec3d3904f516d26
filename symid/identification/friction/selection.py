"""The choice of a friction law: which one predicts held-out blocks best.

FrictionSamples, laws -> LawSelection: a table, the law taken, and why.

Each recording is cut into blocks of consecutive rows. A law is fitted to all blocks but one of each
recording and predicts the torques there, until every block was held out once. Of all laws within one
standard error of the best (paired over the blocks), the one with the fewest unknowns is taken (Breiman,
Friedman, Olshen and Stone 1984). A law with parameters that the samples cannot identify is not taken,
however well it predicts. Without a block, shape values are searched within a factor of four about those
of the fit to all rows: only these bounds know of the block.

Supported: any laws, several recordings; rows next to a held-out block are left out, as they share its
filter.
Not supported: random samples held out, which neighbours give away.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import IdentifiabilityError, Notice, SymidError
from symid.identification.friction.estimate import FrictionEstimate
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.problem import FrictionOptions, VariableProjectionOptions
from symid.identification.friction.samples import (
    FrictionRows,
    FrictionSamples,
    build_friction_rows,
    select_friction_rows,
)
from symid.joint_models import FrictionLaw, compute_columns, get_law

CANDIDATE_LAWS = (
    "coulomb-viscous",
    "coulomb-viscous-offset",
    "asymmetric",
    "tustin+offset",
    "stribeck+offset",
    "lorentzian+offset",
    "improved-stribeck",
    "asymmetric-stribeck",
    "cubic+offset",
    "power-law+offset",
    "stribeck+cubic+offset",
    "load-dependent+offset",
    "stribeck-exponent+offset",
    "makkar+offset",
)
"""Laws among which `auto` chooses, from plain to rich."""

BLOCKS = 5
"""Of each recording."""
_GUARD = 2
"""Rows on either side of a held-back block that are not fitted either."""
_LEAST_ROWS = 10
"""Of a block."""
_NARROW = 4.0
"""Factor about the shape of the whole fit within which that of a part is searched."""
_WHOLE = VariableProjectionOptions(grid=((12,), (5, 4), (4, 3, 3)), starts=2, solves=80)
_PART = VariableProjectionOptions(grid=((3,), (3, 2), (2, 2, 2)), starts=1, solves=30)
"""Less effort than of a final fit: laws differ by far more than the last digits of an optimum."""
_BASELINE = "coulomb-viscous-offset"


@dataclass(frozen=True, slots=True, kw_only=True)
class LawTrial:
    """How a law did.

    Args:
        law: its name; `unknowns` the number of its parameters.
        fitted_percent: what the fit to all rows leaves of the torque, |e| / |tau| in percent.
        held_percent: the same of the rows held back, in percent; `held_rms` in N m or N.
        ratio: squared error of the rows held back, relative to Coulomb, viscous and constant friction.
        behind: mean difference of the squared error from the best law, in its standard errors.
        aicc: of the fit to all rows.
        reason: why it was not tried, or cannot be taken: parameters that the samples do not tell; else empty.
    """

    law: str
    unknowns: int
    fitted_percent: float | None = None
    held_percent: float | None = None
    held_rms: float | None = None
    ratio: float | None = None
    behind: float | None = None
    aicc: float | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LawSelection:
    """Trials of all laws; `chosen` is the law taken, `verdict` why, `blocks` how many there were."""

    trials: tuple[LawTrial, ...]
    chosen: str
    verdict: str
    blocks: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Score:
    """A law that was tried: its fit to all rows, squared errors held back, one a block."""

    law: FrictionLaw
    estimate: FrictionEstimate
    errors: FloatArray

    @property
    def unknowns(self) -> int:
        return len(self.law.linear) + len(self.law.shape)

    @property
    def untold(self) -> tuple[str, ...]:
        """Return the law's parameters that these samples cannot tell."""
        refused = dict(self.estimate.refused)
        return tuple(entry.name for entry in self.law.physical if entry.name in refused)


def assign_blocks(rows: FrictionRows, blocks: int = BLOCKS) -> NDArray[np.intp]:
    """Return which block each row (M,) belongs to: block k is the k-th part of every recording.

    A recording too short to be cut is always fitted, and never held back: its rows have -1.

    Raises:
        IdentifiabilityError: there are not rows enough for two blocks.
    """
    parts = [np.flatnonzero(rows.run == run) for run in np.unique(rows.run)]
    longest = max(len(part) for part in parts)
    blocks = min(blocks, longest // _LEAST_ROWS)
    if blocks < 2:
        text = (
            f"logs with {longest} rows cannot be cut into two parts of {_LEAST_ROWS}: nothing can be held "
            "back to choose a law by; name one with --model, or use longer logs"
        )
        raise IdentifiabilityError(Notice(code="friction.too-few-rows", text=text))
    number = np.full(len(rows.run), -1, dtype=np.intp)
    for index in parts:
        if len(index) >= blocks * _LEAST_ROWS:
            for block, part in enumerate(np.array_split(index, blocks)):
                number[part] = block
    return number


def predict_rows(samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate) -> FloatArray:
    """Return the torques (M,) in N m or N that an estimate foretells of the rows of `samples`."""
    columns = np.hstack([compute_columns(law, samples.inputs, estimate.shape), samples.extra])
    values = np.array([*estimate.linear, *estimate.other])
    found: FloatArray = samples.pass_columns(columns) @ values
    return found


def compute_relative_residual(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> float:
    """Return what an estimate leaves of the rows of `samples`, in percent of their norm."""
    torque = build_friction_rows(samples).torque
    left = torque - predict_rows(samples, law, estimate)
    return 100.0 * float(np.linalg.norm(left) / np.linalg.norm(torque))


def select_law(
    samples: FrictionSamples,
    names: Sequence[str] = CANDIDATE_LAWS,
    *,
    smoothing: float = 0.0,
    options: FrictionOptions | None = None,
    blocks: int = BLOCKS,
) -> LawSelection:
    """Return which of the laws foretells torques best that it was not fitted to.

    Args:
        samples: of one joint.
        names: of laws.
        smoothing: v0 in rad/s or m/s of all laws, 0 for the sign.
        options: of the estimator, which is variable projection.
        blocks: into which each recording is cut.

    Raises:
        UsageError: there is no law of such a name.
        IdentifiabilityError: no law can be fitted, or there are too few rows to hold some back.
    """
    options = options or FrictionOptions()
    rows = build_friction_rows(samples)
    number = assign_blocks(rows, blocks)
    scores: list[_Score] = []
    failed: dict[str, str] = {}
    for law in [get_law(name, smoothing=smoothing) for name in names]:
        try:
            scores.append(_try_law(samples, law, rows, number, options))
        except SymidError as error:
            failed[law.name] = error.notices[0].text
    if not scores:
        reasons = "; ".join(dict.fromkeys(failed.values()))
        text = f"joint {samples.joint!r}: no law can be fitted to this log: {reasons}"
        raise IdentifiabilityError(Notice(code="friction.no-law", text=text))
    scores, best, chosen = _choose(samples, scores, options)
    baseline = next((score for score in scores if score.law.name == _BASELINE), None)
    trials = [_describe(score, best, baseline, rows, number) for score in scores]
    for name, reason in failed.items():
        law = get_law(name)
        trials.append(LawTrial(law=name, unknowns=len(law.linear) + len(law.shape), reason=reason))
    trials.sort(key=lambda trial: np.inf if trial.held_percent is None else trial.held_percent)
    unit = "N" if samples.prismatic else "N m"
    return LawSelection(
        trials=tuple(trials),
        chosen=chosen.law.name,
        verdict=_write_verdict(scores, chosen, best, baseline, held=int(np.sum(number >= 0)), unit=unit),
        blocks=int(number.max()) + 1,
    )


def _choose(
    samples: FrictionSamples, scores: Sequence[_Score], options: FrictionOptions
) -> tuple[list[_Score], _Score, _Score]:
    """Return the scores, the best among laws that can be told, and the one taken.

    A law is taken only where a fit of full effort, too, can tell its parameters: a search of little effort
    may end where they look known.
    """
    tried = list(scores)
    surely: set[str] = set()
    while True:
        whole = [score for score in tried if not score.untold]
        # Where no law can be told whole, the plainest one shows best what is left.
        eligible = whole or [min(tried, key=lambda score: score.unknowns)]
        best = min(eligible, key=lambda score: float(score.errors.sum()))
        near = [score for score in eligible if _compute_distance(score, best) <= 1.0]
        chosen = min(near, key=lambda score: (score.unknowns, float(score.errors.sum())))
        # The best sets what the others are measured by, so that it must be known as surely.
        doubtful = {score.law.name for score in (best, chosen) if score.law.shape and whole} - surely
        if not doubtful:
            return tried, best, chosen
        surely |= doubtful
        for place, score in enumerate(tried):
            if score.law.name in doubtful:
                full = fit_friction(samples, score.law, options=options)
                tried[place] = replace(score, estimate=full)


def _try_law(
    samples: FrictionSamples,
    law: FrictionLaw,
    rows: FrictionRows,
    number: NDArray[np.intp],
    options: FrictionOptions,
) -> _Score:
    """Return how a law does on each block that it was not fitted to."""
    whole = fit_friction(samples, law, options=replace(options, variable_projection=_WHOLE))
    part = _narrow(law, whole, options)
    errors = []
    for block in range(int(number.max()) + 1):
        held = number == block
        fit = fit_friction(select_friction_rows(samples, _leave_guard(held, rows.run)), law, options=part)
        apart = select_friction_rows(samples, held)
        errors.append(float(np.sum((rows.torque[held] - predict_rows(apart, law, fit)) ** 2)))
    return _Score(law=law, estimate=whole, errors=np.array(errors))


def _narrow(law: FrictionLaw, whole: FrictionEstimate, options: FrictionOptions) -> FrictionOptions:
    """Return options for parts of the rows: a shape near that of the whole, found with less effort."""
    if not law.shape:
        return options
    bounds = {
        entry.name: (max(entry.lower, value / _NARROW), min(entry.upper, value * _NARROW))
        for entry, value in zip(law.shape, whole.shape, strict=True)
        if value > 0.0
    }
    bounds |= dict(options.bounds)
    return replace(options, bounds=tuple(bounds.items()), variable_projection=_PART)


def _leave_guard(held: NDArray[np.bool_], run: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which rows are fitted: those not held back, nor next to one that is."""
    free = ~held
    for shift in range(1, _GUARD + 1):
        same = run[shift:] == run[:-shift]
        free[shift:] &= ~(held[:-shift] & same)
        free[:-shift] &= ~(held[shift:] & same)
    return free


def _compute_distance(score: _Score, best: _Score) -> float:
    """Return by how many standard errors a law does worse than the best, over the blocks."""
    difference = score.errors - best.errors
    mean = float(np.mean(difference))
    if mean <= 0.0:
        return 0.0
    error = float(np.std(difference, ddof=1) / np.sqrt(len(difference)))
    return mean / error if error > 0.0 else float("inf")


def _describe(
    score: _Score, best: _Score, baseline: _Score | None, rows: FrictionRows, number: NDArray[np.intp]
) -> LawTrial:
    total, tried = (float(np.linalg.norm(rows.torque[mask])) for mask in (number >= -1, number >= 0))
    held = float(score.errors.sum())
    return LawTrial(
        law=score.law.name,
        unknowns=score.unknowns,
        fitted_percent=100.0 * float(np.sqrt(score.estimate.objective)) / total if total else None,
        held_percent=100.0 * float(np.sqrt(held)) / tried if tried else None,
        held_rms=float(np.sqrt(held / np.sum(number >= 0))),
        ratio=held / float(baseline.errors.sum()) if baseline is not None and baseline.errors.any() else None,
        behind=_compute_distance(score, best),
        aicc=score.estimate.aicc,
        reason=f"cannot be told: {', '.join(score.untold)}" if score.untold else "",
    )


def _write_verdict(
    scores: Sequence[_Score], chosen: _Score, best: _Score, baseline: _Score | None, *, held: int, unit: str
) -> str:
    """Return why the law was taken, in sentences."""
    untold = any(score.untold and score.errors.sum() < best.errors.sum() for score in scores)

    def rms(score: _Score) -> float:
        return float(np.sqrt(score.errors.sum() / held))

    if chosen.untold:
        return (
            f"these logs tell no law whole; {chosen.law.name}, the plainest, is shown with what can be told."
        )
    among = "Of the laws that these logs tell whole, " if untold else ""
    if chosen is best:
        text = (
            f"{among}{chosen.law.name} foretells the blocks held back best, to {rms(chosen):.3g} {unit} RMS"
        )
    else:
        text = (
            f"{among}{best.law.name} foretells the blocks held back best, to {rms(best):.4g} {unit} RMS; "
            f"{chosen.law.name} does so to {rms(chosen):.4g} {unit} with {chosen.unknowns} unknowns in place "
            f"of {best.unknowns}, and the difference is within its standard error over the blocks: taken"
        )
    if baseline is not None and baseline is not chosen and baseline.errors.any():
        squared = 1.0 - float(chosen.errors.sum() / baseline.errors.sum())
        plain = 1.0 - rms(chosen) / rms(baseline)
        way = "less" if squared >= 0.0 else "more"
        text += (
            f"; against {baseline.law.name} that is {100.0 * abs(squared):.3g} % {way} squared error, "
            f"{100.0 * abs(plain):.3g} % {way} RMS"
        )
    return f"{text}."
