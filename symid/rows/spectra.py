"""Up to which frequency a joint's position tells of its motion, and where noise takes over.

Input: a recording. Output: `JointBand` of every joint.

The power spectral density of the position (Welch's method, Hann windows of at least 2 s, half overlapped,
trends removed) falls with the motion's bandwidth until it meets the noise of the encoder, which is flat or
nearly so. The floor is the median of the density over the upper half of all frequencies. Twice differentiated
and cut off at b, that noise has the power

    floor (2 pi)^4 b^5 / 5,   the motion's acceleration   integral to b of (density - floor) (2 pi f)^4 df

The clean band ends where the former is a hundredth of the latter: noise in a column of the regressor moves
its parameter towards zero by that part.

Supported: joints that move; encoders whose noise is white, quantisation among it.
Not supported: positions that were filtered before they were logged: their noise is underestimated.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.data.recording import Recording

__all__ = ["NOISE_SHARE", "JointBand", "find_bands"]

NOISE_SHARE = 0.01
"""Part of the acceleration's power that noise may be."""
_SPAN = 2.0
_LEAST_SAMPLES = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class JointBand:
    """What a position holds.

    Args:
        floor: one-sided density of the noise, rad or m over the root of Hz.
        clean: Hz, up to which noise is less than `NOISE_SHARE` of the acceleration's power.
        noise: rad or m, standard deviation of such a noise over all frequencies.
    """

    floor: float
    clean: float
    noise: float


def find_bands(recording: Recording) -> tuple[JointBand, ...]:
    """Return noise and clean band of every joint of a recording."""
    from scipy.signal import welch

    rate = 1.0 / recording.period
    length = min(len(recording.time), max(_LEAST_SAMPLES, round(_SPAN * rate)))
    frequency, density = welch(recording.position, fs=rate, nperseg=length, detrend="linear", axis=0)
    return tuple(_find_band(frequency[1:], column[1:], rate) for column in density.T)


def _find_band(frequency: FloatArray, density: FloatArray, rate: float) -> JointBand:
    floor = float(np.median(density[frequency > 0.25 * rate]))
    steep = (2.0 * np.pi * frequency) ** 4
    motion = np.cumsum(np.maximum(density - floor, 0.0) * steep)
    clean = np.flatnonzero(np.cumsum(floor * steep) <= NOISE_SHARE * motion)
    return JointBand(
        floor=float(np.sqrt(floor)),
        clean=float(frequency[clean[-1]]) if len(clean) else 0.0,
        noise=float(np.sqrt(floor * rate / 2.0)),
    )
