"""Filtered rows: motor and link equations without accelerations, and their sum, which needs no spring.

ElasticSignals, Library -> FilteredRows.

With F(s) = lambda / (s + lambda), x~ = x - x(0), p = Yp beta and dL/dq = YL beta:

    link         {lambda (Yp~ - F[Yp~]) - F[YL]} beta = F[tau_J]
    motor        IA lambda (dtheta~ - F[dtheta~]) + F[Yf] f + F[tau_J] = F[tau]
    elimination  their sum: tau_J cancels, whatever the spring is

(Slotine and Li 1987 for the filter.) Each signal is filtered as it holds between samples.

Supported: torques held between samples, sampled smooth signals; friction that is linear in its parameters.
Not supported: friction on the link side.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.library import Library
from symid.elastic.signals import ElasticSignals

__all__ = ["FilteredRows", "build_filtered_rows", "filter_held", "filter_smooth"]

_ROW_RATE = 500.0
"""Rows a second in Hz: many times the band that the filter passes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilteredRows:
    """Motor and link equations of one recording, at the samples `keep`.

    Args:
        motor: (M, n, n + pf), columns [rotor | friction]; link: (M, n, p).
        torque: (M, n), F[tau] in N m or N.
        keep: the samples of the signals that rows belong to.
    """

    motor: FloatArray
    link: FloatArray
    torque: FloatArray
    keep: slice

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("motor", "link", "torque"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    @property
    def elimination(self) -> FloatArray:
        """Return the design (M, n, p + n + pf) of the sum of both equations; its right side is `torque`."""
        return np.concatenate([self.link, self.motor], axis=2)

    def find_motor_side(self, drive: FloatArray) -> FloatArray:
        """Return F[tau_J] (M, n) by the motor equation; `drive` = [rotor; friction]."""
        side: FloatArray = self.torque - self.motor @ drive
        return side

    def find_link_side(self, beta: FloatArray) -> FloatArray:
        """Return F[tau_J] (M, n) by the link equation."""
        side: FloatArray = self.link @ beta
        return side


def filter_held(values: FloatArray, rate: float, period: float) -> FloatArray:
    """Return F[values] (N, ...) of a signal that values[k] holds over [t_k, t_k+1], from rest.

    y_k = a y_k-1 + (1 - a) x_k-1, a = exp(-rate period); rate in rad/s, period in s.
    """
    from scipy.signal import lfilter

    decay = np.exp(-rate * period)
    result: FloatArray = lfilter([0.0, 1.0 - decay], [1.0, -decay], values, axis=0)
    return result


def filter_smooth(values: FloatArray, rate: float, period: float) -> FloatArray:
    """Return F[values] (N, ...) of a signal that is a straight line between samples, from rest.

    y_k = a y_k-1 + g x_k + (1 - a - g) x_k-1, g = 1 - (1 - a) / (rate period), a = exp(-rate period).
    """
    from scipy.signal import lfilter

    decay = np.exp(-rate * period)
    ahead = 1.0 - (1.0 - decay) / (rate * period)
    start = -ahead * values[:1]
    result: FloatArray = lfilter([ahead, 1.0 - decay - ahead], [1.0, -decay], values, axis=0, zi=start)[0]
    return result


def build_filtered_rows(library: Library, signals: ElasticSignals, rate: float) -> FilteredRows:
    """Return the filtered equations of one recording.

    Args:
        library: functions of the robot; those of q speak of the links, friction of the motors.
        signals: states and torque at full rate.
        rate: lambda in rad/s.
    """
    period = signals.period
    step = max(1, int(1.0 / (_ROW_RATE * period) + 1e-9))
    keep = slice(signals.settled, None, step)

    def low(values: FloatArray) -> FloatArray:
        return filter_smooth(values, rate, period)

    (momentum,) = library.evaluate("momentum_regressor", signals.q, signals.dq)
    (lagrange,) = library.evaluate("lagrange_regressor", signals.q, signals.dq)
    momentum = momentum - momentum[0]
    link = (rate * (momentum - low(momentum)) - low(lagrange))[keep]
    speed = signals.dtheta - signals.dtheta[0]
    rotor = (rate * (speed - low(speed)))[keep]
    motor = [rotor[:, :, None] * np.eye(library.card.size)]
    if library.card.friction:
        (friction,) = library.evaluate("friction_regressor", signals.dtheta)
        motor.append(low(friction)[keep])
    torque = filter_held(signals.tau, rate, period) if signals.hold == "zero" else low(signals.tau)
    return FilteredRows(motor=np.concatenate(motor, axis=2), link=link, torque=torque[keep], keep=keep)
