"""Friction laws of one axis from plain to rich: what each leaves of a recording, and of another one.

Input: recordings of a robot with one joint, its processing. Output: `FrictionSamples` with the mass as the
column beside friction; `LadderRow` of each law.

    R u = R [ddq, Phi(dq; s), terms] (M, c),   relative residual |R u - R u_hat| / |R u|

R is the decimation that the force and all columns pass alike, after the same filter of the position.

Supported: all laws by name; terms beside them by the names of `AXIS_TERMS`.
Not supported: several joints, for which there is `extract_joint`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.data.recording import Recording
from symid.data.signals import prepare_signals
from symid.errors import LogError, Notice
from symid.friction.axis_simulation import find_axis_terms
from symid.friction.estimate import FrictionEstimate
from symid.friction.estimators import fit_friction
from symid.friction.output_error import AxisRun
from symid.friction.reduction import build_reduction, find_rows
from symid.friction.samples import FrictionSamples
from symid.friction.selection import predict_rows
from symid.joint.friction_laws import get_law
from symid.robot.log_map import Processing

__all__ = ["LadderRow", "build_axis_run", "build_axis_samples", "climb_ladder", "find_relative_residual"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LadderRow:
    """A law: its fit to one recording, and what it leaves of each recording, in percent of the force."""

    law: str
    estimate: FrictionEstimate
    fitted_percent: float
    unseen_percent: tuple[float, ...]

    @property
    def unknowns(self) -> int:
        """Return how many values were fitted."""
        estimate = self.estimate
        return len(estimate.linear) + len(estimate.shape) + len(estimate.other)


def build_axis_samples(
    recording: Recording, processing: Processing, *, joint: str = "axis", terms: Sequence[str] = ()
) -> FrictionSamples:
    """Return the samples of an axis that moves along itself, with its mass as unknown.

    Args:
        recording: of a robot with one joint.
        processing: filter, ends cut, decimation.
        joint: its name.
        terms: of `AXIS_TERMS`, columns beside the mass.

    Raises:
        LogError: the recording has another number of joints, or cannot be filtered.
    """
    _check_single(recording)
    signals = prepare_signals(recording, processing)
    position, velocity = signals.q[:, 0], signals.dq[:, 0]
    inputs = {"velocity": velocity, "position": position, "time": signals.time}
    return FrictionSamples(
        joint=joint,
        time=signals.time,
        velocity=velocity,
        torque=signals.tau[:, 0],
        extra=np.column_stack([signals.ddq[:, 0], *find_axis_terms(terms, inputs)]),
        extra_names=("M", *terms),
        load=signals.tau[:, 0],
        position=position,
        reduce=build_reduction([len(velocity)], processing.decimation),
        prismatic=True,
    )


def build_axis_run(recording: Recording) -> AxisRun:
    """Return position and force of an axis as they were recorded, for simulations.

    Raises:
        LogError: the recording has another number of joints.
    """
    _check_single(recording)
    return AxisRun(
        position=recording.position[:, 0],
        force=recording.torque[:, 0],
        period=recording.period,
        begin=float(recording.time[0]),
    )


def _check_single(recording: Recording) -> None:
    if recording.position.shape[1] != 1:
        text = f"the recording has {recording.position.shape[1]} joints; one is wanted"
        raise LogError(Notice(code="log.joints", text=text, file=recording.source))


def find_relative_residual(samples: FrictionSamples, law: str, estimate: FrictionEstimate) -> float:
    """Return what an estimate leaves of the rows of `samples`, in percent of their norm."""
    torque = find_rows(samples).torque
    left = torque - predict_rows(samples, get_law(law), estimate)
    return 100.0 * float(np.linalg.norm(left) / np.linalg.norm(torque))


def climb_ladder(
    fitted: FrictionSamples, unseen: Sequence[FrictionSamples], laws: Sequence[str]
) -> tuple[LadderRow, ...]:
    """Return a row for each law: fitted by variable projection to `fitted`, applied to each of `unseen`.

    Args:
        fitted: samples of the fit.
        unseen: samples that only meet the finished estimate.
        laws: names, from plain to rich.
    """
    rows = []
    for law in laws:
        estimate = fit_friction(fitted, get_law(law))
        rows.append(
            LadderRow(
                law=law,
                estimate=estimate,
                fitted_percent=find_relative_residual(fitted, law, estimate),
                unseen_percent=tuple(find_relative_residual(other, law, estimate) for other in unseen),
            )
        )
    return tuple(rows)
