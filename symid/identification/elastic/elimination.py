"""Dynamics without the springs: motor and link equations added, so that the joint torque cancels.

    elimination  [Y_link | Y_motor] chi = F[tau]
    band         d/dt G[Yp] beta - G[YL] beta + IA d/dt G[dtheta] + G[Yf] f = G[tau],  G a zero-phase low-pass

The hysteresis is fitted afterwards on the joint torque that these dynamics leave.

Supported: both encoders; friction that is linear in its parameters.
Not supported: encoder noise as large as torque noise within the band.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard
from symid.identification.elastic import regression
from symid.identification.elastic.estimate import MethodFit, build_method_fit, compute_covariance
from symid.identification.judge import POLICY, adjust_chances, numerics
from symid.logs import Recording, differentiate_smooth, estimate_density
from symid.robot import Processing


def fit_elimination(problem: regression.ElasticProblem) -> MethodFit:
    """Return dynamics by elimination of the joint torque, and the springs that it then shows."""
    chi = regression.solve_with_signs(problem.library.card, *problem.stack_filtered(), problem.known)
    springs = problem.fit_springs(problem.compute_motor_side(chi))
    return build_method_fit("elimination", chi, problem.sizes, springs)


class BandRows(NamedTuple):
    """Equations design @ chi = torque of all recordings.

    Args:
        design: (m, p + n + pf); torque: (m,) N m or N.
        group: (m,) which recording and joint; joints of one recording stand together.
        time: (m,) s since the start of the recording, as a part of its length.
        slide: (m,) how many limits of the speed the motor keeps.
    """

    design: FloatArray
    torque: FloatArray
    group: NDArray[np.intp]
    time: FloatArray
    slide: NDArray[np.intp]

    def select(self, kept: NDArray[np.bool_]) -> "BandRows":
        """Return the rows of a mask (m,)."""
        parts: list[Any] = [part[kept] for part in self]
        return BandRows(*parts)

    def weigh(self, scatter: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return design and torque over the `scatter` (g,) of their groups."""
        weights = 1.0 / scatter[self.group]
        return self.design * weights[:, None], self.torque * weights


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandFit:
    """chi (p + n + pf,) with its covariance, and the scatter of every group, N m or N.

    Parameters that the rows do not identify have infinite variances.
    """

    chi: FloatArray
    covariance: FloatArray
    scatter: FloatArray


def solve_weighted(
    solve: Callable[[FloatArray, FloatArray], FloatArray],
    design: FloatArray,
    torque: FloatArray,
    group: NDArray[np.intp],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return parameters (p,), errors (m,), and the scatter (g,) of groups, inverse to their weights."""
    floor = numerics.CONVERGED * max(float(np.sqrt(np.mean(torque**2))), numerics.TINY)
    members = np.maximum(np.bincount(group), 1)
    scatter = np.ones(len(members))
    for _ in range(numerics.ROUNDS):
        before, weights = scatter, 1.0 / scatter[group]
        values = solve(design * weights[:, None], torque * weights)
        errors = torque - design @ values
        scatter = np.maximum(np.sqrt(np.bincount(group, errors**2) / members), floor)
        if np.all(np.abs(scatter - before) <= numerics.CONVERGED * scatter):
            break
    return values, errors, scatter


def fit_band(
    card: ModelCard, rows: BandRows, known: FloatArray | None = None, scatter: FloatArray | None = None
) -> BandFit:
    """Return the least-squares fit over `scatter` (g,), its own where None; `known` as `solve_with_signs`."""
    solve = partial(regression.solve_with_signs, card, known=known)
    if scatter is None:
        chi, _, scatter = solve_weighted(solve, *rows[:3])
    else:
        chi = solve(*rows.weigh(scatter))
    covariance = compute_covariance(rows.weigh(scatter)[0], known=known)
    return BandFit(chi=chi, covariance=covariance, scatter=scatter)


_STATES = 5.0
"""Of the cut-off of the states to the band's edge: the rows' filter comes after kinks of friction."""


EFFECTS = 3.0
"""Of the edge up to where effects are sought to the band's: ripple is faster than motion, and the filter of
the states, which columns come after and torques before, must not weaken it."""


def get_wide_cutoff(period: float, band: float) -> float:
    """Return the cut-off of the states in Hz, for a sample period in s and motion up to `band` Hz."""
    return min(_STATES * regression.choose_edge(period, band), 0.4 / period)


def filter_band(
    library: Library, signals: regression.ElasticSignals, edge: float
) -> tuple[slice, FloatArray, FloatArray]:
    """Return the samples of rows in the band below `edge` Hz, design (M, n, p + n + pf) and torque (M, n).

    Every column is made of hardly filtered states and then filtered exactly as the torque is, so that kinks
    of friction stay in place. Noise of the rows is nearly independent.
    """
    period, torque = signals.period, signals.centred_torque
    # Twice the edge, without the filters' ends.
    cut = regression.count_edge(period, edge)
    keep = slice(cut, len(torque) - cut, max(1, round(0.5 / (edge * period))))
    low = partial(regression.pass_band, period=period, cutoff=edge)
    design = regression.build_equations(
        library, signals, lambda values: differentiate_smooth(low(values), period), low, keep
    )
    return keep, design, low(torque - signals.link_drag)[keep]


def build_band_rows(library: Library, signals: Sequence[regression.ElasticSignals], band: float) -> BandRows:
    """Return the equations of all recordings; their signals should pass `get_wide_cutoff`, or no filter.

    The edge of their band lies above `band`, that of the motion in Hz.
    """
    joints, speeds = library.card.size, compute_speeds(signals)
    parts: list[tuple[NDArray[Any], ...]] = []
    for number, part in enumerate(signals):
        edge = regression.choose_edge(part.period, band)
        keep, design, torque = filter_band(library, part, edge)
        time = np.repeat(np.arange(len(part.time))[keep] / len(part.time), joints)
        slides = [regression.mark_sliding(part, 1.0 / edge, share * speeds)[keep] for share in SHARES]
        slide = np.sum(slides, axis=0)
        group = np.broadcast_to(number * joints + np.arange(joints), torque.shape)
        whole = design.reshape(-1, design.shape[2])
        parts.append((whole, torque.ravel(), group.ravel(), time, slide.ravel()))
    return BandRows(*map(np.concatenate, zip(*parts, strict=True)))


def measure_torque_noise(recordings: Sequence[Recording], band: float) -> FloatArray:
    """Return the noise (g,) of the torque in band rows, N m or N, as it is far above the band of the motion.

    It is taken as white, of the median density of the upper half of all frequencies: lines, resonances and
    the harmonics of friction do not move that. `band` is that of `build_band_rows`.
    """
    found, corner = [], 0.5 * np.pi / Processing().filter_order
    # Of the low-pass, forward and backward, over its edge: that of 1 / (1 + x^(2 n))^2, n its order.
    bandwidth = (1.0 - corner / np.pi) * corner / np.sin(corner)
    for part in recordings:
        frequency, density = estimate_density(part.torque, 1.0 / part.period, len(part.torque))
        level = np.median(density[frequency > 0.25 / part.period], axis=0) / np.log(2.0)
        found.append(np.sqrt(level * regression.choose_edge(part.period, band) * bandwidth))
    return np.concatenate(found)


def compute_speeds(signals: Sequence[regression.ElasticSignals]) -> FloatArray:
    """Return the RMS speeds (n,) of the motors over all recordings, rad/s or m/s."""
    return np.asarray(np.sqrt(np.mean(np.concatenate([part.dtheta for part in signals]) ** 2, axis=0)))


_LIMITS = 8
SHARES = tuple(np.geomspace(POLICY.relevance, 1.0, _LIMITS, endpoint=False).tolist())
"""Of a joint's RMS speed, below which rows may be left out."""


def choose_sliding_rows(
    card: ModelCard, rows: BandRows, known: FloatArray | None = None
) -> tuple[BandRows, float]:
    """Return the rows without motors so slow that the estimate moves when they are left out, and the limit.

    Friction near rest is no function of the speed (presliding, Stribeck). The least limit is taken at which
    the estimate agrees with those of all larger ones in all directions (Hausman 1978); weights are those of
    the largest. It is a share of the joints' RMS speeds, 0 where all rows stay. What a motor that rests
    in a recording bears by friction is no number: such rows stay where only they identify something.
    """
    blocks = POLICY.folds * POLICY.parts
    moves = np.bincount(rows.group, rows.slide >= 1) >= blocks
    awake = rows.select(moves[rows.group])
    if len(awake.torque) < len(rows.torque):
        told, left = (np.isfinite(np.diag(fit_band(card, own, known).covariance)) for own in (rows, awake))
        rows = awake if np.all(left[told]) else rows
    sets = [rows.select(rows.slide >= level) for level in range(len(SHARES) + 1)]
    # A recording that is slow beside the others keeps its rows.
    sizes = [np.bincount(part.group, minlength=int(rows.group.max()) + 1) for part in sets]
    moving = sizes[1] >= blocks
    usable = [
        level
        for level, size in enumerate(sizes)
        # A row a block of each group that moves, and one a parameter in all.
        if size.sum() >= blocks * rows.design.shape[1] and np.all(size[moving] >= blocks)
    ] or [0]
    fast, whole = (fit_band(card, sets[level], known).scatter for level in (usable[-1], 0))
    fast = np.pad(fast, (0, len(whole) - len(fast)))
    scatter = np.where(sizes[usable[-1]] >= blocks, fast, whole)
    fits = [fit_band(card, sets[level], known, scatter) for level in usable]
    for number, fit in enumerate(fits):
        level, chances = usable[number], [_compute_chance(fit, other) for other in fits[number + 1 :]]
        if min(adjust_chances(chances), default=1.0) >= POLICY.alarm:
            break
    return sets[level], (0.0, *SHARES)[level]


def _compute_chance(fit: BandFit, other: BandFit) -> float:
    """Return the probability that a fit of fewer rows, `other`, is that far from one of more by chance."""
    known, own = (np.isfinite(np.diag(entry.covariance)) for entry in (other, fit))
    if np.any(own & ~known):
        return 1.0
    known &= own
    apart = (fit.chi - other.chi)[known]
    both = np.ix_(known, known)
    spread = other.covariance[both] - fit.covariance[both]
    lengths = np.sqrt(np.maximum(np.diag(other.covariance)[known], numerics.TINY))
    values, vectors = np.linalg.eigh(spread / np.outer(lengths, lengths))
    # Directions that the rows left out told nothing of cannot disagree.
    ways = values > _OPEN
    moved = vectors.T[ways] @ (apart / lengths)
    count = max(1, int(np.count_nonzero(ways)))
    return float(scipy.special.chdtrc(count, float(np.sum(moved**2 / values[ways]))))


_OPEN = 1e-3
"""Of a variance: what it is less by in a fit of more rows, below which these told nothing further."""
