"""Delay between the torque and the motion of a log.

Input: `LogFit`. Output: `TorqueDelay`.

A torque channel that lags by d holds tau(t - d), so that, with rows A and the fitted torque s = A x,

    tau = A x - d ds/dt

is linear in x and d. The fit is repeated with the torque really shifted until d no longer changes. Standard
deviations come from leaving out each block of the log in turn (the jackknife).

Supported: any fraction of a sample, either sign; one delay for all joints, and one of each joint to compare.
Not supported: joints at rest; delays above 50 ms, which count as something else.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.logcheck.log_fit import LogFit, shift_torque, solve_rows

__all__ = ["TorqueDelay", "describe_delay", "find_torque_delay"]

_ROUNDS = 6
_SETTLED = 0.01
_LARGEST = 0.05
_SURE = 5.0
_SMALLEST = 0.1
"""Of a sample period: a delay as small as this does no harm."""
_RCOND = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueDelay:
    """Delay of the torque behind the motion in s, its standard deviation; of each moving joint alone."""

    delay: float
    std: float
    joints: tuple[float, ...]
    joint_stds: tuple[float, ...]
    period: float

    @property
    def late(self) -> bool:
        """Return whether there is a delay beyond doubt, of a size that matters."""
        return _LARGEST > abs(self.delay) > max(_SURE * self.std, _SMALLEST * self.period)


def find_torque_delay(fit: LogFit) -> TorqueDelay:
    """Return the delay of the torques of `fit` behind its motion."""
    weights = _find_weights(fit)
    delay, tau = 0.0, fit.tau
    for _ in range(_ROUNDS):
        values, replicates = _fit_delays(fit, tau, weights)
        stds = np.sqrt(_find_variances(replicates))
        shares = 1.0 / np.maximum(stds, 1e-9) ** 2
        shares /= shares.sum()
        step = float(shares @ values)
        delay += step
        if abs(step) < _SETTLED * fit.recording.period or abs(delay) > _LARGEST:
            break
        tau = shift_torque(fit, delay)
    # Joints that disagree by more than their own deviations say that these are too small (Birge 1932).
    excess = float(np.sum(((values - step) / np.maximum(stds, 1e-9)) ** 2)) / max(1, len(values) - 1)
    common = float(np.sqrt(_find_variances(replicates @ shares[:, None])[0]))
    return TorqueDelay(
        delay=delay,
        std=common * max(1.0, excess) ** 0.5,
        joints=tuple(float(delay - step + value) for value in values),
        joint_stds=tuple(map(float, stds)),
        period=fit.recording.period,
    )


def _find_weights(fit: LogFit) -> FloatArray:
    """Return 1 / scatter of every moving joint's residual."""
    joints = list(fit.moving)
    size = np.linalg.norm(fit.tau[:, joints], axis=0)
    weights = 1.0 / np.where(size > 0.0, size, 1.0)
    errors = _find_errors(fit, fit.tau, weights)
    scatter = np.linalg.norm(errors, axis=0) / weights
    result: FloatArray = 1.0 / np.maximum(scatter, 1e-6 * size + 1e-300)
    return result


def _find_errors(fit: LogFit, tau: FloatArray, weights: FloatArray) -> FloatArray:
    matrix, values = _stack(fit, tau, weights)
    errors = _list_kept(fit) * (values - matrix @ _solve_kept(fit, matrix, values))
    return errors.reshape(-1, len(fit.moving))


def _stack(fit: LogFit, tau: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return matrix and values of all moving joints, sample by sample."""
    joints = list(fit.moving)
    matrix = fit.rows[:, joints] * weights[:, None]
    return matrix.reshape(-1, fit.rows.shape[2]), (tau[:, joints] * weights).ravel()


def _solve_kept(fit: LogFit, matrix: FloatArray, values: FloatArray) -> FloatArray:
    """Return the solution of the rows of joints that move."""
    keep = _list_kept(fit)
    return solve_rows(matrix * keep[:, None], values * keep)


def _list_kept(fit: LogFit) -> FloatArray:
    return fit.keep[:, list(fit.moving)].ravel()


def _fit_delays(fit: LogFit, tau: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the delay of every moving joint (k,) in s, and those without each block (blocks, k)."""
    matrix, values = _stack(fit, tau, weights)
    count = len(fit.moving)
    smooth = (matrix @ _solve_kept(fit, matrix, values)).reshape(-1, count)
    slopes = np.zeros((len(smooth), count, count))
    for block in fit.blocks:
        slope = np.gradient(smooth[block], fit.period, axis=0)
        slopes[block, range(count), range(count)] = -slope
    design = np.column_stack([matrix, slopes.reshape(-1, count), values]) * _list_kept(fit)[:, None]
    lengths = np.linalg.norm(design, axis=0)
    scales = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    design *= scales
    grams = np.array([part.T @ part for part in _split(design, fit, count)])
    back = scales[-count - 1 : -1] / scales[-1]
    whole = grams.sum(axis=0)
    replicates = np.array([_solve(whole - gram, count) for gram in grams])
    return _solve(whole, count) * back, replicates * back


def _split(design: FloatArray, fit: LogFit, count: int) -> list[FloatArray]:
    return [design[block.start * count : block.stop * count] for block in fit.blocks]


def _solve(gram: FloatArray, count: int) -> FloatArray:
    solution = np.linalg.lstsq(gram[:-1, :-1], gram[:-1, -1], rcond=_RCOND)[0]
    return np.asarray(solution[-count:], dtype=np.float64)


def _find_variances(replicates: FloatArray) -> FloatArray:
    spread = replicates - replicates.mean(axis=0)
    variances: FloatArray = (len(replicates) - 1) / len(replicates) * np.sum(spread**2, axis=0)
    return variances


def describe_delay(found: TorqueDelay, file: str) -> tuple[Notice, ...]:
    """Return a notice where the torque is not on the motion's clock."""
    if not found.late:
        return ()
    side = "behind" if found.delay > 0.0 else "ahead of"
    text = (
        f"the torque is {1e3 * abs(found.delay):.4g} ms {side} the motion (standard deviation "
        f"{1e3 * found.std:.2g} ms, {abs(found.delay) / found.period:.3g} samples): channels of different "
        "age, which mixes friction and inertia; shift one of them, or filter far below its inverse"
    )
    return (Notice(code="log.torque-delay", text=text, file=file),)
