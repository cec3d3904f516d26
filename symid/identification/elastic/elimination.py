"""Dynamics without the springs: motor and link equations added, so that the joint torque cancels.

    elimination  [Y_link | Y_motor] chi = F[tau]
    momentum     Delta(Yp beta) - int YL beta dt + IA Delta(dtheta) + int Yf f dt = int tau dt
    band         d/dt G[Yp] beta - G[YL] beta + IA d/dt G[dtheta] + G[Yf] f = G[tau],  G a zero-phase low-pass
    independent  dynamics from motions of all joints together; then the hysteresis of each joint from slow
                 motions of that joint alone: its torque from the motor equation, its torsion by the link
                 encoder or, on the motor side,
                 phi <- phi + G' (G G' + mu 1)^-1 (link(theta - phi) - tau_J),  G = d gravity / dq

The hysteresis is fitted afterwards on the joint torque that these dynamics leave. `independent` is a
reconstruction of published procedures, no copy.

Supported: both encoders; friction that is linear in its parameters; recordings of one kind only, which
then serve both steps of `independent`.
Not supported: encoder noise as large as torque noise within the band; the motor side without gravity.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library, ModelCard
from symid.errors import Notice
from symid.identification.elastic import regression
from symid.identification.elastic.estimate import MethodFit, build_method_fit, compute_covariance
from symid.identification.hysteresis import filter_smooth
from symid.identification.regression import choose_windows, integrate_windows
from symid.logs import Recording, differentiate_smooth, low_pass


def fit_elimination(problem: regression.ElasticProblem) -> MethodFit:
    """Return dynamics by elimination of the joint torque, and the springs that it then shows."""
    chi = regression.solve_with_signs(problem.library.card, *problem.stack_filtered(), problem.known)
    springs = problem.fit_springs(problem.compute_motor_side(chi))
    return build_method_fit("elimination", chi, problem.sizes, springs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandRows(FrozenArrays):
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
        parts = {name: getattr(self, name)[kept] for name in ("design", "torque", "group", "time", "slide")}
        return BandRows(**parts)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandFit:
    """chi (p + n + pf,) with its covariance, and the scatter of every group, N m or N.

    Parameters that the rows do not identify have infinite variances.
    """

    chi: FloatArray
    covariance: FloatArray
    scatter: FloatArray


def fit_band(
    card: ModelCard,
    rows: BandRows,
    rounds: int = 3,
    scatter: FloatArray | None = None,
    known: FloatArray | None = None,
) -> BandFit:
    """Return the weighted least-squares fit, weights 1 / scatter of each group, found in a few rounds.

    `scatter` (g,) N m or N: given, zero where a group is not known; those of the fit else. `known` is that of
    `solve_with_signs`.
    """
    design, torque, group = rows.design, rows.torque, rows.group
    floor = 1e-9 * max(float(np.sqrt(np.mean(torque**2))), 1e-300)
    members = np.maximum(np.bincount(group), 1)
    weights = np.ones(len(torque))
    for _ in range(rounds):
        chi = regression.solve_with_signs(card, design * weights[:, None], torque * weights, known)
        errors = torque - design @ chi
        found = np.maximum(np.sqrt(np.bincount(group, errors**2) / members), floor)
        if scatter is not None:
            stated = np.zeros(len(found))
            stated[: len(scatter)] = scatter[: len(found)]
            found = np.where(stated > 0.0, stated, found)
        weights = 1.0 / found[group]
    covariance = compute_covariance(design * weights[:, None], known=known)
    return BandFit(chi=chi, covariance=covariance, scatter=found)


def fit_momentum(problem: regression.ElasticProblem) -> MethodFit:
    """Return dynamics from momenta, and the springs that remain; raise UsageError if windows do not fit."""
    length = problem.options.window
    parts = [_integrate_equations(problem.library, signals, length) for signals in problem.signals]
    design, impulse = (np.concatenate(part) for part in zip(*parts, strict=True))
    rows = BandRows(
        design=design.reshape(-1, design.shape[2]),
        torque=impulse.reshape(-1),
        group=np.tile(np.arange(impulse.shape[1]), len(impulse)),
        time=np.zeros(impulse.size),
        slide=np.zeros(impulse.size, dtype=np.intp),
    )
    chi = fit_band(problem.library.card, rows, rounds=2, known=problem.known).chi
    springs = problem.fit_springs(problem.compute_motor_side(chi))
    return build_method_fit("momentum", chi, problem.sizes, springs)


_EDGE = 20.0
"""Hz; the band in which arms move, and in which white noise of the torque outweighs that of encoders."""
_LEAST_RATIO, _FAST_RATIO = 25.0, 15.0
"""Of the sample rate to the band's edge; and where the motion is that fast."""
_ORDER = 4
_CUT = 2.0
"""Periods of the band's edge that are cut at both ends."""
_STATES = 5.0
"""Of the cut-off of the states to the band's edge."""
_EFFECTS = 60.0
"""Hz; ripple is faster than motion."""


def _choose_edge(period: float, band: float) -> float:
    """Return the band's edge in Hz: above the motion, whose band is given."""
    return max(min(_EDGE, 1.0 / (_LEAST_RATIO * period)), min(band, 1.0 / (_FAST_RATIO * period)))


def get_effect_edge(period: float, band: float) -> float:
    """Return up to where effects of the drives are sought, Hz."""
    return min(max(_EFFECTS, band), 1.0 / (_FAST_RATIO * period))


def get_wide_cutoff(period: float, band: float = 0.0) -> float:
    """Return the cut-off of the states in Hz, for a sample period in s and motion up to `band` Hz."""
    return min(_STATES * _choose_edge(period, band), 0.4 / period)


def _integrate_equations(
    library: Library, signals: regression.ElasticSignals, length: float
) -> tuple[FloatArray, FloatArray]:
    """Return design (m, n, p + n + pf) and impulses (m, n) in N m s or N s of windows of `length` s."""
    first = signals.settled
    windows = choose_windows(len(signals.time) - first, signals.period, length)
    design = regression.build_equations(
        library,
        signals,
        lambda values: np.diff(values[first:][windows.ends], axis=0),
        lambda values: integrate_windows(values[first:], windows),
    )
    if signals.hold != "zero":
        return design, integrate_windows(signals.tau[first:], windows)
    # The integral of a held torque is exact.
    held = signals.tau[first:][: windows.count * windows.intervals]
    return design, windows.period * held.reshape(windows.count, windows.intervals, -1).sum(axis=1)


def filter_band(
    library: Library, signals: regression.ElasticSignals, edge: float
) -> tuple[slice, FloatArray, FloatArray]:
    """Return the samples of rows in the band below `edge` Hz, design (M, n, p + n + pf) and torque (M, n).

    Every column is made of hardly filtered states and then filtered exactly as the torque is, so that kinks
    of friction stay in place. Noise of the rows is nearly independent.
    """
    period, torque = signals.period, signals.centred_torque
    # Twice the edge, without the filters' ends.
    cut = int(np.ceil(_CUT / (edge * period)))
    keep = slice(cut, len(torque) - cut, max(1, round(0.5 / (edge * period))))
    low = partial(low_pass, period=period, cutoff=edge, order=_ORDER)
    design = regression.build_equations(
        library, signals, lambda values: differentiate_smooth(low(values), period), low, keep
    )
    return keep, design, low(torque - signals.link_drag)[keep]


def build_band_rows(
    library: Library, signals: Sequence[regression.ElasticSignals], band: float = 0.0
) -> BandRows:
    """Return the equations of all recordings; their signals should pass `get_wide_cutoff`, or no filter.

    The edge of their band lies above `band`, that of the motion in Hz.
    """
    joints, speeds = library.card.size, compute_speeds(signals)
    parts: list[tuple[NDArray[Any], ...]] = []
    for number, part in enumerate(signals):
        edge = _choose_edge(part.period, band)
        keep, design, torque = filter_band(library, part, edge)
        time = np.repeat(np.arange(len(part.time))[keep] / len(part.time), joints)
        slide = np.sum(
            [regression.mark_sliding(part, 1.0 / edge, share * speeds)[keep] for share in _SHARES], axis=0
        )
        group = np.broadcast_to(number * joints + np.arange(joints), torque.shape)
        parts.append(
            (design.reshape(-1, design.shape[2]), torque.ravel(), group.ravel(), time, slide.ravel())
        )
    names = ("design", "torque", "group", "time", "slide")
    return BandRows(**dict(zip(names, map(np.concatenate, zip(*parts, strict=True)), strict=True)))


def measure_torque_noise(recordings: Sequence[Recording], band: float = 0.0) -> FloatArray:
    """Return the noise (g,) of the torque in band rows, N m or N, as it is above the band of the motion.

    The power spectrum of every recording and joint is taken as that of white noise where it is least, by its
    median in parts of the frequencies: lines, resonances and the harmonics of friction do not move it. `band`
    is that of `build_band_rows`.
    """
    found = []
    for part in recordings:
        edge, torque = _choose_edge(part.period, band), part.torque
        frequency = np.fft.rfftfreq(len(torque), part.period)
        window = np.hanning(len(torque))[:, None]
        power = np.abs(np.fft.rfft((torque - torque.mean(axis=0)) * window, axis=0)) ** 2
        bounds = np.linspace(_ABOVE_BAND * edge, _HIGHEST / part.period, _PARTS + 1)
        parts = [power[(frequency >= low) & (frequency < high)] for low, high in pairwise(bounds)]
        levels = [np.median(values, axis=0) for values in parts if len(values)]
        density = np.min(levels, axis=0) / np.log(2.0) / float(np.sum(window**2))
        found.append(np.sqrt(2.0 * density * part.period * edge * _BANDWIDTH))
    return np.concatenate(found)


_ABOVE_BAND, _HIGHEST, _PARTS = 1.5, 0.45, 6
"""Times the edge, and of the sample rate: where noise is looked for, in so many parts."""
_BANDWIDTH = 0.875 * (np.pi / 8.0) / np.sin(np.pi / 8.0)
"""Of the low-pass of order four, forward and backward, over its edge: that of 1 / (1 + x^8)^2."""


def compute_speeds(signals: Sequence[regression.ElasticSignals]) -> FloatArray:
    """Return the RMS speeds (n,) of the motors over all recordings, rad/s or m/s."""
    return np.asarray(np.sqrt(np.mean(np.concatenate([part.dtheta for part in signals]) ** 2, axis=0)))


_SHARES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6)
"""Of a joint's RMS speed, below which rows may be left out."""
_AGREE = 0.999
"""Rows close in time share some of their noise, and many pairs are compared."""


def choose_sliding_rows(
    card: ModelCard, rows: BandRows, known: FloatArray | None = None
) -> tuple[BandRows, float]:
    """Return the rows without motors so slow that the estimate moves when they are left out, and the limit.

    Friction near rest is no function of the speed (presliding, Stribeck). The least limit is taken at which
    the estimate agrees with those of all larger ones (Hausman 1978); weights are those of the largest. It is
    a share of the joints' RMS speeds, 0 where all rows stay.
    """
    sets = [rows.select(rows.slide >= number) for number in range(len(_SHARES) + 1)]
    needed = _ENOUGH * rows.design.shape[1]
    # A recording that is slow beside the others keeps its rows: weights of groups come from the fastest set.
    sizes = [np.bincount(part.group, minlength=int(rows.group.max()) + 1) for part in sets]
    moving = sizes[1] >= _ENOUGH
    sets = [
        part
        for part, size in zip(sets, sizes, strict=True)
        if len(part.torque) >= needed and np.all(size[moving] >= _ENOUGH)
    ] or sets[:1]
    scatter = fit_band(card, sets[-1], known=known).scatter
    fits = [fit_band(card, part, scatter=scatter, known=known) for part in sets]
    agreed = (
        number for number, fit in enumerate(fits) if all(_agree(fit, other) for other in fits[number + 1 :])
    )
    number = next(agreed)
    return sets[number], (0.0, *_SHARES)[number]


_ENOUGH = 20
"""Rows a parameter, or a group that moves."""


def _agree(fit: BandFit, other: BandFit) -> bool:
    """Return whether a fit of more rows agrees with one of fewer."""
    known, own = (np.isfinite(np.diag(entry.covariance)) for entry in (other, fit))
    if np.any(own & ~known):
        return True
    known &= own
    apart = (fit.chi - other.chi)[known]
    both = np.ix_(known, known)
    spread = other.covariance[both] - fit.covariance[both]
    lengths = np.sqrt(np.maximum(np.diag(other.covariance)[known], 1e-300))
    values, vectors = np.linalg.eigh(spread / np.outer(lengths, lengths))
    # Directions that the rows left out told nothing of cannot disagree.
    open_ways = values > _OPEN
    moved = vectors.T[open_ways] @ (apart / lengths)
    limit = float(scipy.special.chdtri(max(1, np.count_nonzero(open_ways)), 1.0 - _AGREE))
    return float(np.sum(moved**2 / values[open_ways])) <= limit


_OPEN = 1e-3
_MOVING = 0.1
"""Of the fastest joint's RMS speed; slower joints count as held."""
_DRIVEN = 0.5
"""Of a joint's largest RMS speed over all recordings; slower ones do not serve its hysteresis."""
_TORSION_ROUNDS = 8
_DAMPING = 0.1
"""mu relative to the largest squared singular value of G."""
_SLOW = 0.5
"""Hz; slow motions are below, the pendulums of arms above."""
_STEEP = 0.5
"""Of the largest |G_jj| at which the torsion of joint j is trusted for its linear spring."""


def split_recordings(signals: Sequence[regression.ElasticSignals]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the recordings in which all joints move, and the others; all twice where a kind is missing."""
    speeds = [compute_speeds([part]) for part in signals]
    everything = tuple(range(len(signals)))
    together = tuple(i for i in everything if np.all(speeds[i] > _MOVING * speeds[i].max()))
    apart = tuple(i for i in everything if i not in together)
    return together or everything, apart or everything


def fit_independent(problem: regression.ElasticProblem, *, encoder: bool = False) -> MethodFit:
    """Return the dynamics of the first procedure and the hysteresis of the second.

    With `encoder` the torsion is taken from the link encoder too, in place of motor-side samples alone.
    """
    together, apart = split_recordings(problem.signals)
    chi = regression.solve_with_signs(problem.library.card, *problem.stack_filtered(together), problem.known)
    torsions = {
        number: problem.signals[number].phi if encoder else estimate_virtual_torsion(problem, number, chi)
        for number in apart
    }
    speeds = [compute_speeds([part]) for part in problem.signals]
    springs = []
    for joint in range(problem.sizes[1]):
        most = max(speeds[number][joint] for number in apart)
        used = [number for number in apart if speeds[number][joint] >= _DRIVEN * most]
        signals, rows = [problem.signals[i] for i in used], [problem.filtered[i] for i in used]
        parts = [np.ascontiguousarray(torsions[number][:, joint]) for number in used]
        data = regression.build_spring_data(problem.options, joint, parts, signals, rows)
        target = np.concatenate([part.compute_motor_side(chi)[:, joint] for part in rows])
        springs.append(problem.fit_spring(joint, data, target))
    fit = build_method_fit("independent", chi, problem.sizes, tuple(springs))
    if set(together) != set(apart):
        return fit
    text = (
        "the method independent needs motions of all joints together for the dynamics and slow motions of "
        "one joint at a time for the hysteresis; these logs are of one kind, which was used for both"
    )
    return replace(fit, notices=(Notice(code="elastic.one-kind", text=text),))


def estimate_virtual_torsion(problem: regression.ElasticProblem, number: int, chi: FloatArray) -> FloatArray:
    """Return the torsion (N, n) of recording `number` from motor-side samples and chi alone.

    First where gravity's gradient is large; the linear spring that this gives stands in elsewhere.
    """
    library, signals, rate = problem.library, problem.signals[number], problem.options.rate
    beta = chi[: problem.sizes[0]]
    rows = regression.build_filtered_rows(library, replace(signals, settled=0), rate)
    step = rows.keep.step
    theta, period, torque = signals.theta[::step], signals.period * step, rows.compute_motor_side(chi)
    # d g / dq (M, n, n) by central differences of the torque at rest.
    turn, rest, columns = 1e-4, np.zeros_like(theta), []
    for shift in turn * np.eye(theta.shape[1]):
        (ahead,) = library.evaluate("lagrange_regressor", theta + shift, rest)
        (behind,) = library.evaluate("lagrange_regressor", theta - shift, rest)
        columns.append((behind @ beta - ahead @ beta) / (2.0 * turn))
    gradient = np.stack(columns, axis=2)
    root = gradient.transpose(0, 2, 1)
    damping = _DAMPING * float(np.linalg.norm(gradient, ord=2, axis=(1, 2)).max()) ** 2
    gain = root @ np.linalg.inv(gradient @ root + damping * np.eye(problem.sizes[1]))
    phi = np.zeros_like(theta)
    for prior in (False, True):
        if prior:
            # The linear springs that fit best where gravity's gradient is large.
            slopes = np.abs(np.diagonal(gradient, axis1=1, axis2=2))
            steep = np.where(slopes >= _STEEP * slopes.max(axis=0), torque, 0.0)
            moved = np.maximum(np.sum(steep**2, axis=0), 1e-300)
            phi = torque * np.maximum(np.sum(phi * steep, axis=0) / moved, 0.0)
        for _ in range(_TORSION_ROUNDS):
            q = theta - phi
            dq = differentiate_smooth(q, period)
            (momentum,) = library.evaluate("momentum_regressor", q, dq)
            (lagrange,) = library.evaluate("lagrange_regressor", q, dq)
            link = regression.filter_derivative(momentum @ beta, rate, period)
            link -= filter_smooth(lagrange @ beta, rate, period)
            # Above a pendulum's frequency inertia outweighs gravity, and the fixed point would run away.
            error = low_pass(link - torque, period=period, cutoff=_SLOW, order=2)
            phi = phi + np.einsum("kij,kj->ki", gain, error)
    full, grid = np.arange(len(signals.time)), np.arange(len(theta)) * step
    return np.column_stack([np.interp(full, grid, torsion) for torsion in phi.T])
