"""Band, instruments, slow rows and source of states chosen from the logs, and what they are judged by.

Library, recordings, Processing -> `SettingsStudy`: condensed logs, `SettingsChoice`, the fit of the settings
taken.

    candidates   rows within bands B 2^k, least squares, or instruments along positions of a lower band
    as good      none predicts held-out stretches better, by more than chance and more than matters: a part of
                 the torque (`relevance`), or a multiple of its own squares (`fall`)
    consistent   torques that it predicts agree with those of the same rows and the lowest instruments
    taken        of those as good and consistent the widest rows, then the widest instruments that are precise
    slow rows    below a tenth of the top speed, of a joint, are used where friction surely is another there

Noise of the positions biases least squares, and instruments of a wide band; instruments of a low band are
consistent, whatever noise there is (Hausman 1978, Econometrica 46). Rows reach up to a tenth of the sample
rate and half of the positions' cut-off, at which noise and blur of the velocities are equal.

Supported: settings that are stated, the others are chosen around them.
Not supported: a band for each joint; logs of different sample rates.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, Notice
from symid.identification import judge
from symid.identification.estimators import Candidate, SettingsChoice
from symid.identification.regression import (
    BandSums,
    BlockFit,
    CondensedLogs,
    balance_cutoff,
    condensing,
    fit_sums,
    measure_scoring_band,
)
from symid.logs import STATES, Recording, has_states
from symid.robot import Processing

PASSED = 0.4
"""Of the rate of rows: what decimation passes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SettingsStudy:
    """Settings taken, and what they are judged by.

    `logs` are condensed, without their rows; `classes` (n,) of speed from which rows are used; `sums` of the
    pair of bands taken, `narrow` of rows of the band below, None where there is none; `fit` with these;
    `choice` what was tried; `cutoff` Hz, of the positions; `differences` as in `Processing`.
    """

    logs: CondensedLogs
    sums: BandSums
    narrow: BandSums | None
    classes: tuple[int, ...]
    fit: BlockFit
    choice: SettingsChoice
    cutoff: float | None
    differences: str

    def fit_blocks(self, blocks: NDArray[np.bool_] | None, classes: Sequence[int] | None = None) -> BlockFit:
        """Return the fit of some blocks (b,), or of rows from other classes (n,) of speed on."""
        return fit_sums(self.sums, classes or self.classes, self.logs.fold, blocks, self.fit.weights)


class BandTrial(NamedTuple):
    """A pair of levels, its fit, and losses (b, n) on held-out blocks."""

    level: int
    smooth: int
    fit: BlockFit
    losses: FloatArray


def choose_settings(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    instruments: tuple[bool, ...] = (False, True),
    moving: bool = False,
) -> SettingsStudy:
    """Return the settings that predict held-out stretches and are consistent; `processing` states some.

    `instruments` whether candidates have some, all of them, or none; `moving` whether slow rows are left out
    of all joints.
    """
    rate = 1.0 / recordings[0].period
    length = sum(len(entry.time) * entry.period for entry in recordings)
    # Ten rows a parameter, 2 B T of each joint.
    least = 5.0 * len(library.card.fitted) / (library.card.size * length)
    cutoff, factor = processing.filter_cutoff, processing.decimation.factor
    if "filter_cutoff" in processing.left_open:
        cutoff = min(balance_cutoff(recordings) or PASSED * rate, PASSED * rate)
        processing = replace(processing, differences="fourth-order")
    stated = None if "decimation.factor" in processing.left_open else PASSED * rate / max(1, factor)
    widest = min(PASSED * condensing.ROW_RATE, judge.POLICY.row_band * rate, 0.5 * (cutoff or rate))
    scoring = min(max(measure_scoring_band(recordings), least), stated or 0.5 * widest)
    # An octave apart, two below the scoring band and all above; the last one may be stated.
    above = max(0, math.floor(math.log2((stated or widest) / scoring) + 1e-9))
    bands = [scoring * 2.0**k for k in range(-condensing.SCORING, above + 1)]
    if stated is not None and abs(bands[-1] / stated - 1.0) > 1e-9:
        bands.append(stated)
    usable = [processing.states]
    if "filter_cutoff" in processing.left_open and processing.states == "position":
        alike = len({recording.velocity is None for recording in recordings}) == 1
        everywhere = (name for name in STATES if all(has_states(recording, name) for recording in recordings))
        usable = [name for name in everywhere if alike or name == "position"]
    best: tuple[CondensedLogs, BandTrial, BandSums, BandSums | None] | None = None
    candidates, place = list[Candidate](), 0
    for states in usable:
        logs = CondensedLogs(library, recordings, replace(processing, states=states), bands, cutoff)
        trials = _fit_trials(logs, instruments, stated=stated is not None)
        taken, found = _choose_trial(logs, trials, states)
        chance = None if best is None else judge.compare(best[1].losses, trials[taken].losses)
        if chance is None or (
            chance.p_of_all < judge.POLICY.caution
            and chance.fall_of_all > (1.0 + judge.POLICY.relevance) ** 2
        ):
            # Sums of all pairs would take much memory. Rows of the band below have the same instruments.
            level, smooth = trials[taken].level, trials[taken].smooth
            (sums,) = logs.sum_products([level], smooth)
            narrow = logs.sum_products([level - 1], min(smooth, level - 1))[0] if level > 1 else None
            best, place = (logs, trials[taken], sums, narrow), len(candidates) + taken
        logs.release()
        candidates += found
    if best is None:
        raise IdentifiabilityError(Notice(code="identify.nothing", text="the logs have no states to fit"))
    logs, trial, sums, narrow = best
    moving |= "standstill" not in processing.left_open
    classes = _choose_classes(library, logs, sums, trial.fit, moving=moving)
    fit = fit_sums(sums, classes, logs.fold)
    speeds = tuple(float(logs.limits[joint, share]) for joint, share in enumerate(classes))
    return SettingsStudy(
        logs=logs,
        sums=sums,
        narrow=narrow,
        classes=classes,
        fit=fit,
        choice=SettingsChoice(
            scoring=bands[condensing.SCORING], candidates=tuple(candidates), taken=place, standstill=speeds
        ),
        cutoff=cutoff,
        differences=processing.differences,
    )


def _fit_trials(logs: CondensedLogs, instruments: tuple[bool, ...], *, stated: bool) -> list[BandTrial]:
    """Return the fits of all pairs of bands, slow rows left out; a stated band is the last one."""
    last, found = len(logs.bands) - 1, list[BandTrial]()
    # Slow rows neither fit nor count: friction there may be another.
    share = logs.limits.shape[1] - 1
    for smooth in range(1, last + 1):
        levels = [
            level
            for level in range(max(smooth, last if stated else 1), last + 1)
            if (smooth < level) in instruments or (level, smooth) == (last, last)
        ]
        for level, sums in zip(levels, logs.sum_products(levels, smooth), strict=True):
            fit = fit_sums(sums, [share] * len(logs.limits), logs.fold)
            found.append(BandTrial(level, smooth, fit, logs.measure_losses(fit, share)))
    found.sort(key=lambda trial: (trial.level, trial.smooth))
    wanted = [trial for trial in found if (trial.smooth < trial.level) in instruments]
    return wanted or found


def _measure_share(losses: FloatArray) -> float:
    """Return the part of the torque that losses (b, n) in two bands leave: rms, mean of joints."""
    return float(np.mean(np.sqrt(0.5 * losses.sum(axis=0))))


def _choose_trial(
    logs: CondensedLogs, trials: Sequence[BandTrial], states: str
) -> tuple[int, list[Candidate]]:
    """Return the place of the trial taken, and all as candidates."""
    best = min(trials, key=lambda trial: float(trial.losses.sum()))
    lowest: dict[int, BandTrial] = {}
    for trial in trials:
        lowest.setdefault(trial.level, trial)
    moving = logs.torque > 0.0
    grams, torque, found = logs.list_grams()[moving], logs.torque[moving], []
    for trial in trials:
        compared, first = judge.compare(trial.losses, best.losses), lowest[trial.level]
        differences = trial.fit.values - first.fit.values, trial.fit.changes - first.fit.changes
        told = judge.agree(*differences, grams, torque)
        # None where no joint has a torque that counts.
        chances = judge.adjust_chances([entry.p for entry in told])
        found.append(
            Candidate(
                states=states,
                band=logs.bands[trial.level],
                instruments=logs.bands[trial.smooth] if trial.smooth < trial.level else 0.0,
                held_out=100.0 * _measure_share(trial.losses),
                fall=compared.fall_of_all,
                p=compared.p_of_all,
                consistent=1.0 if trial is first else min(chances, default=1.0),
            )
        )
    # Worse by no more than chance, or by little, of the torque and of the best residual: noise of a wide band
    # biases inertias long before it matters beside the torque. Of these, wide rows mix slow ones in least.
    limit = 100.0 * (_measure_share(best.losses) + judge.POLICY.relevance)
    worse = [one.held_out > limit or one.fall > judge.POLICY.fall for one in found]
    good = [k for k, entry in enumerate(found) if entry.p >= judge.POLICY.caution or not worse[k]]
    pool = [place for place in good if found[place].consistent > judge.POLICY.caution] or good
    level = max(trials[place].level for place in pool)
    widest = [place for place in pool if trials[place].level == level]
    changes = np.stack([trials[place].fit.changes for place in widest])
    spreads = np.einsum("tbk,jkl,tbl->tj", changes, grams, changes, optimize=True) @ (1.0 / torque)
    # Noise makes least squares less precise than instruments before a test tells of its bias.
    precise = np.flatnonzero(spreads <= (1.0 + judge.POLICY.relevance) * spreads.min())
    return max((widest[k] for k in precise), key=lambda place: trials[place].smooth), found


def _choose_classes(
    library: Library, logs: CondensedLogs, sums: BandSums, fit: BlockFit, *, moving: bool
) -> tuple[int, ...]:
    """Return from which class of speed on rows of each joint are used: those of slow motion are left out.

    Filters smear friction where a joint turns round. Only where friction there surely is another, by a part
    of the torque that matters, does no choice of rows make the law right: all rows count, as long as that
    predicts as well.
    """
    last, inertial = logs.limits.shape[1] - 1, len(library.card.beta)
    classes, grams = [last] * len(logs.limits), logs.list_grams()[:, inertial:, inertial:]
    losses = logs.measure_losses(fit)
    for joint, gram in enumerate(grams):
        if moving or not last:
            continue
        own = [0 if place == joint else last for place in range(len(classes))]
        other = fit_sums(sums, own, logs.fold)
        (found,) = judge.agree(
            (other.values - fit.values)[inertial:],
            (other.changes - fit.changes)[:, inertial:],
            gram[None],
            logs.torque[joint : joint + 1],
        )
        worse = judge.compare(logs.measure_losses(other), losses)
        if found.verdict is judge.Agreement.DIFFERENT and worse.p_of_all > judge.POLICY.caution:
            classes[joint] = 0
    return tuple(classes)
