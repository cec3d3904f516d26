"""Elimination in a band: columns of states that are hardly filtered, low-passed with the torque, weighted.

Library, signals -> BandRows -> chi with its covariance.

    d/dt G[Yp] beta - G[YL] beta + IA d/dt G[dtheta] + G[Yf] f = G[tau]

The sum of motor and link equations, in which the joint torque cancels, through a zero-phase low-pass G. Every
column is made of states at a cut-off well above G's and then filtered exactly as the torque is, so that kinks
of friction stay where they are, and noise of the torque above the band is gone. Rows are taken at twice the
band's edge, where what is left of white noise is nearly independent, and are weighted by the scatter of each
joint in each recording.

Supported: both encoders; friction that is linear in its parameters.
Not supported: noise of the encoders as large as that of the torque within the band.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.codegen.functions import ModelCard
from symid.codegen.library import Library
from symid.data.filters import differentiate, low_pass
from symid.elastic.consistency import solve_consistent
from symid.elastic.covariance import find_covariance
from symid.elastic.signals import ElasticSignals

__all__ = ["BandFit", "BandRows", "build_band_rows", "find_wide_cutoff", "fit_band"]

_EDGE = 20.0
"""Hz; the band in which arms move, and in which white noise of the torque outweighs that of encoders."""
_LEAST_RATIO = 25.0
"""Of the sample rate to the band's edge."""
_ORDER = 4
_CUT = 2.0
"""Periods of the band's edge that are cut at both ends."""
_STATES = 5.0
"""Of the cut-off of the states to the band's edge."""
_ROUNDS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandRows:
    """Equations design @ chi = torque of all recordings.

    Args:
        design: (m, p + n + pf); torque: (m,) N m or N.
        group: (m,) which recording and joint; joints of one recording stand together.
        time: (m,) s since the start of the recording, as a part of its length.
    """

    design: FloatArray
    torque: FloatArray
    group: NDArray[np.intp]
    time: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("design", "torque", "time"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandFit:
    """chi (p + n + pf,) with its covariance, and the scatter of every group, N m or N.

    Parameters that the rows do not tell have infinite variances.
    """

    chi: FloatArray
    covariance: FloatArray
    scatter: FloatArray


def find_wide_cutoff(period: float) -> float:
    """Return the cut-off of the states in Hz, for a sample period in s."""
    return min(_STATES * _find_edge(period), 0.4 / period)


def build_band_rows(library: Library, signals: Sequence[ElasticSignals]) -> BandRows:
    """Return the equations of all recordings; their signals should pass `find_wide_cutoff`, or no filter."""
    designs, torques, groups, times = [], [], [], []
    for number, part in enumerate(signals):
        design, torque, time = _build_one(library, part)
        joints = torque.shape[1]
        designs.append(design.reshape(-1, design.shape[2]))
        torques.append(torque.reshape(-1))
        groups.append(np.tile(np.arange(joints), len(torque)) + joints * number)
        times.append(np.repeat(time, joints))
    return BandRows(
        design=np.vstack(designs),
        torque=np.concatenate(torques),
        group=np.concatenate(groups),
        time=np.concatenate(times),
    )


def fit_band(card: ModelCard, rows: BandRows, use: NDArray[np.bool_] | None = None) -> BandFit:
    """Return the weighted least-squares fit, weights 1 / scatter of each group, found in a few rounds.

    Args:
        card: names the parameters.
        rows: the equations.
        use: (m,) rows to fit; None for all.
    """
    chosen = np.ones(len(rows.torque), dtype=bool) if use is None else use
    design, torque, group = rows.design[chosen], rows.torque[chosen], rows.group[chosen]
    count = int(rows.group.max()) + 1
    floor = 1e-9 * max(float(np.sqrt(np.mean(torque**2))), 1e-300)
    weights = np.ones(len(torque))
    scatter = np.ones(count)
    for _ in range(_ROUNDS):
        chi = solve_consistent(card, design * weights[:, None], torque * weights)
        errors = torque - design @ chi
        total = np.bincount(group, errors**2, minlength=count)
        members = np.maximum(np.bincount(group, minlength=count), 1)
        scatter = np.maximum(np.sqrt(total / members), floor)
        weights = 1.0 / scatter[group]
    return BandFit(chi=chi, covariance=find_covariance(design * weights[:, None]), scatter=scatter)


def _find_edge(period: float) -> float:
    return min(_EDGE, 1.0 / (_LEAST_RATIO * period))


def _build_one(library: Library, signals: ElasticSignals) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return design (m, n, p + n + pf), torque (m, n) and time (m,) from 0 to 1 of one recording."""
    period = signals.period
    edge = _find_edge(period)

    def low(values: FloatArray) -> FloatArray:
        return low_pass(values, period=period, cutoff=edge, order=_ORDER)

    (momentum,) = library.evaluate("momentum_regressor", signals.q, signals.dq)
    (lagrange,) = library.evaluate("lagrange_regressor", signals.q, signals.dq)
    cut = int(np.ceil(_CUT / (edge * period)))
    keep = slice(cut, len(signals.time) - cut, max(1, round(0.5 / (edge * period))))
    rotor = differentiate(low(signals.dtheta), period)[keep]
    columns = [
        differentiate(low(momentum), period)[keep] - low(lagrange)[keep],
        rotor[:, :, None] * np.eye(library.card.size),
    ]
    if library.card.friction:
        (friction,) = library.evaluate("friction_regressor", signals.dtheta)
        columns.append(low(friction)[keep])
    tau = signals.tau
    if signals.hold == "zero":
        # The mean of the torques that meet at a sample is the held torque about that instant.
        tau = np.vstack([tau[:1], (tau[1:] + tau[:-1]) / 2.0])
    time = np.arange(len(signals.time))[keep] / len(signals.time)
    return np.concatenate(columns, axis=2), low(tau)[keep], time
