"""Stiffness of joints from the gravity that bends them, with an interval, or the reason why there is none.

Input: a library of robot functions, recordings of both encoders. Output: `StiffnessEstimate`.

Only gravity gives the torque of a spring an absolute scale: torques of acceleration are those of rotor and
link in unknown shares, and friction takes its part before the spring. Torques of motion, accelerations,
velocities and directions have coefficients of their own (see `stiffness_fit`), so that errors of inertias,
of friction and of the delay do not reach the compliance. Those of the runs are averaged with the inverse of
their variances.

Standard deviations are those of the jackknife over blocks of a second, so that errors that last within a
block count as one; where runs differ by more than that, they are enlarged by the Birge ratio. The interval
holds with 95 %.

Supported: rigid and elastic robots; joints without a link encoder are refused by name.
Not supported: hysteresis and damping: a spring is all that is fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.functions import JointCard
from symid.codegen.library import Library
from symid.data.alignment import Alignment, align, keep_significant
from symid.data.recording import Recording
from symid.elastic.stiffness_fit import FLAT, SpringFits, fit_springs
from symid.elastic.torsion import build_rigid_rows, find_torsion_alignment, say_unknown
from symid.errors import Notice

__all__ = ["JointStiffness", "StiffnessEstimate", "Verdict", "find_stiffness"]

_LEVEL = 0.95
_DOUBT = 0.01
"""Runs that agree differ like theirs in less than this part of all cases."""


class Verdict(Enum):
    """What became of a joint's stiffness; the value says it in words."""

    IDENTIFIED = "identified"
    NO_ENCODER = "there is no link encoder"
    NO_GRAVITY = "gravity does not load this joint, or always alike"
    BELOW_NOISE = "the torsion that gravity explains is smaller than what it leaves"
    INCONSISTENT = "the runs contradict each other"
    VAGUE = "the interval holds a rigid joint"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointStiffness:
    """The spring of one joint.

    Args:
        joint, unit: its name, and the unit of a stiffness.
        verdict, reason: what became of it, with numbers.
        stiffness, interval: N m/rad or N/m where identified, else None.
        compliance, std: of all runs, rad/(N m) or m/N; NaN where nothing was fitted.
        runs, run_stds: of each run.
        explained, left: root mean square of the torsion that gravity explains and of what is left, rad or m.
    """

    joint: str
    unit: str
    verdict: Verdict
    reason: str
    stiffness: float | None = None
    interval: tuple[float, float] | None = None
    compliance: float = float("nan")
    std: float = float("nan")
    runs: FloatArray
    run_stds: FloatArray
    explained: float
    left: float

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("runs", "run_stds"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StiffnessEstimate:
    """Delay, offsets and the stiffness of every joint; `blocks` are those of the jackknife."""

    robot: str
    alignment: Alignment
    joints: tuple[JointStiffness, ...]
    blocks: int
    notices: tuple[Notice, ...] = ()


def find_stiffness(library: Library, recordings: Sequence[Recording]) -> StiffnessEstimate:
    """Return the stiffness of every joint that the recordings can tell, after aligning the encoders.

    Args:
        library: the robot's functions.
        recordings: of both encoders, each a run with zero offsets of its own.

    Raises:
        LogError: a recording has one encoder only, is uneven or too short, or no joint has both encoders.
    """
    alignment = find_torsion_alignment(library, recordings)
    kept = keep_significant(alignment)
    aligned = list(recordings)
    if kept is not None:
        aligned = [align(recording, kept, run=run) for run, recording in enumerate(recordings)]
    told = () if kept is None else tuple(recording.notices[-1] for recording in aligned)
    fits = fit_springs([build_rigid_rows(library, recording) for recording in aligned])
    return StiffnessEstimate(
        robot=library.card.robot,
        alignment=alignment,
        joints=tuple(
            _judge(fits, index, card) if alignment.present[index] else _refuse_blind(card, len(recordings))
            for index, card in enumerate(library.card.joints)
        ),
        blocks=len(fits.compliances) - 1,
        notices=(*told, *say_unknown(alignment, [card.name for card in library.card.joints])),
    )


def _find_unit(card: JointCard) -> str:
    return f"{card.torque_unit}/{card.position_unit}"


def _refuse_blind(card: JointCard, runs: int) -> JointStiffness:
    nothing = np.full(runs, np.nan)
    return JointStiffness(
        joint=card.name,
        unit=_find_unit(card),
        verdict=Verdict.NO_ENCODER,
        reason="its link encoder's channel is constant or a copy: there is no link encoder",
        runs=nothing,
        run_stds=nothing,
        explained=float("nan"),
        left=float("nan"),
    )


def _judge(fits: SpringFits, index: int, card: JointCard) -> JointStiffness:
    explained, left = float(fits.explained[index]), float(fits.left[index])
    if fits.loading[index] <= FLAT:
        nothing = np.full(fits.compliances.shape[1], np.nan)
        load = (
            "the torque of gravity on this joint does not change"
            if fits.steady[index] > FLAT
            else "gravity does not load this joint"
        )
        reason = (
            f"{load}, and torques of acceleration are shared by rotor and link in "
            f"unknown parts; {left:.3g} {card.position_unit} of its torsion are left (root mean square)"
        )
        return JointStiffness(
            joint=card.name,
            unit=_find_unit(card),
            verdict=Verdict.NO_GRAVITY,
            reason=reason,
            runs=nothing,
            run_stds=nothing,
            explained=0.0,
            left=left,
        )
    mean, std, run_stds, chance = _average(fits.compliances[:, :, index])
    low, high = _find_interval(mean, std, len(fits.compliances) - 1)
    against = [
        *_find_noise_doubt(explained, left, card.position_unit),
        *_find_run_doubt(chance),
        *_find_interval_doubt(low, high, _find_unit(card)),
    ]
    reason = "; ".join(text for _, text in against) or (
        f"gravity explains {explained:.3g} {card.position_unit} of the torsion and leaves {left:.3g} "
        f"{card.position_unit}; the 95 % interval is that of the jackknife over blocks of time"
    )
    return JointStiffness(
        joint=card.name,
        unit=_find_unit(card),
        verdict=against[0][0] if against else Verdict.IDENTIFIED,
        reason=reason,
        stiffness=None if against else 1.0 / mean,
        interval=None if against else (1.0 / high, 1.0 / low),
        compliance=mean,
        std=std,
        runs=fits.compliances[0, :, index],
        run_stds=run_stds,
        explained=explained,
        left=left,
    )


def _average(replicates: FloatArray) -> tuple[float, float, FloatArray, float]:
    """Return mean, deviation, deviations of the runs and the chance that runs that agree differ so much."""
    values, others = replicates[0], replicates[1:]
    n = len(others)
    spread = others - others.mean(axis=0)
    covariance = (n - 1) / n * spread.T @ spread
    stds = np.sqrt(np.diag(covariance))
    weights = 1.0 / np.maximum(stds, 1e-300) ** 2
    weights /= weights.sum()
    mean = float(weights @ values)
    std = float(np.sqrt(weights @ covariance @ weights))
    freedom = len(values) - 1
    if freedom == 0:
        return mean, std, stds, 1.0
    from scipy.stats import chi2

    excess = float(np.sum(((values - mean) / np.maximum(stds, 1e-300)) ** 2))
    return mean, std * max(1.0, excess / freedom) ** 0.5, stds, float(chi2.sf(excess, freedom))


def _find_interval(mean: float, std: float, blocks: int) -> tuple[float, float]:
    from scipy.stats import t

    half = float(t.ppf(0.5 + 0.5 * _LEVEL, max(1, blocks - 1))) * std
    return mean - half, mean + half


_Doubts = list[tuple[Verdict, str]]


def _find_noise_doubt(explained: float, left: float, unit: str) -> _Doubts:
    if explained > left:
        return []
    text = (
        f"the torsion that gravity explains, {explained:.3g} {unit}, is smaller than what it leaves, "
        f"{left:.3g} {unit} (root mean square)"
    )
    return [(Verdict.BELOW_NOISE, text)]


def _find_run_doubt(chance: float) -> _Doubts:
    if chance >= _DOUBT:
        return []
    text = f"the runs contradict each other: equal springs differ so much with a chance of {chance:.2g}"
    return [(Verdict.INCONSISTENT, text)]


def _find_interval_doubt(low: float, high: float, unit: str) -> _Doubts:
    if low > 0.0:
        return []
    text = (
        f"a rigid joint lies in the interval: with 95 % its compliance is from {low:.3g} to {high:.3g}, "
        f"the inverse of {unit}"
    )
    return [(Verdict.VAGUE, text)]
