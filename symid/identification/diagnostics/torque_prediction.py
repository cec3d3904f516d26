"""Measured and predicted torque of a log within a band of frequencies, and the residual there.

Parameters, the library of their model, a recording -> `TorquePrediction` -> `BandResidual`.

    e = L tau - L [Y | Yf] x,    relative residual of a joint: |e|_2 / |L tau|_2

L is a zero-phase Butterworth low-pass of order 4, applied at the full sample rate to the measured torque and
to the torque that the states predict, so that both are filtered alike. The states come from the position with
the filter of the fit: a filter of the band there too would smooth what dry friction does where a velocity
changes its sign, and judge another model. Half a second at either end is left out, where the filter
extrapolates, and joints with friction that do not move, because dry friction or a brake may hold any torque.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library
from symid.errors import LogError, Notice
from symid.identification.diagnostics.stretches import ENDS
from symid.identification.estimators import Residual, compute_mean_relative
from symid.identification.regression import (
    choose_filters,
    compute_payload_torque,
    evaluate_torques,
    hold_resting_joints,
    list_resting_joints,
)
from symid.logs import Recording, low_pass, prepare_signals
from symid.robot import Processing

_ORDER = 4
_FEWEST = 20
"""Samples that must be left."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TorquePrediction(FrozenArrays):
    """Measured and predicted torques of one log, both low-passed at `band` Hz; `time` (N,) in s.

    `measured` and `predicted` are (N, n), N m or N, joint side, the former without the torque of a known
    payload; `counted` are the indices of the joints whose torque counts.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    time: FloatArray
    measured: FloatArray
    predicted: FloatArray
    counted: tuple[int, ...]
    band: float


@dataclass(frozen=True, slots=True, kw_only=True)
class BandResidual:
    """The residual of a model on a log within a band in Hz, of each joint that counts.

    `std` of `joints` is the root mean square, `range_percent` that over the range of the measured torque;
    `stacked_percent` is the relative residual of all joints as one vector, None for one joint and
    where units differ.
    """

    joints: tuple[Residual, ...]
    range_percent: tuple[float, ...]
    band: float
    stacked_percent: float | None = None

    @property
    def mean_relative_percent(self) -> float:
        """Return the plain mean over joints of the relative residuals, in percent."""
        return compute_mean_relative(self.joints)


def predict_torques(
    values: FloatArray,
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    band: float,
    ends: float = ENDS,
) -> TorquePrediction:
    """Return measured and predicted torques of `recording`, both low-passed at `band` Hz.

    `values` (p,) are base parameters and friction, in the order of the library's card. Of `processing` the
    filter of the positions is used, chosen from the log if left open, and the samples cut at either end;
    `ends` s of what is left do not count, at either end.

    Raises:
        LogError: the band does not fit the sample rate, or too little is left of the log.
    """
    processing = choose_filters(processing, [recording]).processing
    resting = list_resting_joints(recording)
    signals = hold_resting_joints(prepare_signals(recording, processing), resting)
    left = round(ends / signals.period)
    if len(signals.time) < 2 * left + _FEWEST:
        text = (
            f"{len(signals.time) * signals.period:.3g} s are left of the log, too few for a comparison "
            f"within a band that leaves out {ends:g} s at either end; cut off less, or use a longer log"
        )
        raise LogError(Notice(code="validate.short-log", text=text, file=recording.source))
    kept = slice(left, len(signals.time) - left)
    first = processing.drop_first
    torque = recording.torque[first : first + len(signals.time)]
    load = compute_payload_torque(library, signals, recording)
    torque = torque if load is None else torque - load
    joints = library.card.joints
    counted = tuple(k for k, joint in enumerate(joints) if k not in resting or joint.friction == "none")
    measured, predicted = (
        low_pass(torques, period=signals.period, cutoff=band, order=_ORDER)[kept]
        for torques in (torque, evaluate_torques(library, signals, values))
    )
    return TorquePrediction(
        joints=tuple(joint.name for joint in joints),
        units=tuple(joint.torque_unit for joint in joints),
        time=signals.time[kept],
        measured=measured,
        predicted=predicted,
        counted=counted,
        band=band,
    )


def compute_band_residual(prediction: TorquePrediction) -> BandResidual:
    """Return the residual of every joint that counts."""
    joints, ranges = [], []
    for index in prediction.counted:
        measured = prediction.measured[:, index]
        error = measured - prediction.predicted[:, index]
        found = Residual.measure(prediction.joints[index], error, measured, prediction.units[index])
        spread = float(np.ptp(measured))
        joints.append(found)
        ranges.append(100.0 * found.std / spread if spread else float("inf"))
    counted = list(prediction.counted)
    whole = float(np.linalg.norm(prediction.measured[:, counted]))
    left = float(np.linalg.norm((prediction.measured - prediction.predicted)[:, counted]))
    alike = len(joints) > 1 and len({entry.unit for entry in joints}) == 1 and whole > 0.0
    return BandResidual(
        joints=tuple(joints),
        range_percent=tuple(ranges),
        band=prediction.band,
        stacked_percent=100.0 * left / whole if alike else None,
    )
