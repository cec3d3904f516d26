"""Output error of one axis: values with which its motion, simulated from the force, is the measured one.

Input: an `AxisRun` (position and force at every sample), an `AxisModel`. Output: `OutputErrorFit`.

    min over values of  sum over windows, sum over k > 20 of (x(k; values) - x_measured(k))^2

Each window is simulated without feedback from a start that its first 20 samples give: position and velocity
of a parabola through them, at the last. The error of a long run has many dips, for every moment of rest makes
one; values found with short windows are a good start for long ones.

Supported: any `AxisModel`; one run, cut into windows of any length.
Not supported: standard deviations, for errors of a simulated position are nothing like independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.errors import LogError, Notice
from symid.friction.axis_simulation import (
    AXIS_TERMS,
    AxisModel,
    find_axis_rates,
    find_force_columns,
    simulate_axis,
)

__all__ = [
    "GIVEN",
    "AxisRun",
    "OutputErrorFit",
    "Window",
    "find_axis_start",
    "find_output_error",
    "find_window_rmse",
    "fit_force",
    "fit_output_error",
    "split_windows",
]

GIVEN = 20
"""Samples that a simulation may look at."""
_FEWEST = 2 * GIVEN
_EVALUATIONS = 40
_TOLERANCE = 1e-7
_WORST = 1e3
"""Error in m or rad that stands for a simulation that left all bounds."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisRun:
    """A recording of one axis.

    Args:
        position: (N,) m or rad. force: (N,) N or N m. period: of the samples in s.
        begin: time of the first sample in s.
    """

    position: FloatArray
    force: FloatArray
    period: float
    begin: float = 0.0

    def __post_init__(self) -> None:
        """Copy the arrays, make them read-only, check them.

        Raises:
            LogError: arrays of different length, fewer than 40 samples, numbers that are not finite.
        """
        for name in ("position", "force"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        sizes = (self.position.shape, self.force.shape)
        if sizes[0] != sizes[1] or len(sizes[0]) != 1 or sizes[0][0] < _FEWEST:
            text = f"position {sizes[0]} and force {sizes[1]} must be alike, {_FEWEST} samples or more each"
            raise LogError(Notice(code="friction.axis-run", text=text))
        if not (np.all(np.isfinite(self.position)) and np.all(np.isfinite(self.force))):
            text = "position and force must be finite numbers throughout"
            raise LogError(Notice(code="friction.axis-run", text=text))


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Window:
    """Samples first .. last - 1 of a run."""

    first: int
    last: int


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputErrorFit:
    """Values of a model.

    Args:
        names, values: in the order of the model's `parameters`.
        rmse: of the simulated position over all windows, m or rad.
        windows: how many; evaluations: simulations of all of them, from all starts.
        converged: whether the search ended for its tolerance.
    """

    names: tuple[str, ...]
    values: tuple[float, ...]
    rmse: float
    windows: int
    evaluations: int
    converged: bool

    def find_value(self, name: str) -> float:
        """Return one of the values."""
        return self.values[self.names.index(name)]


def split_windows(windows: Sequence[Window], samples: float) -> tuple[Window, ...]:
    """Return the same samples in windows of equal length near `samples`, none across two of those given."""
    parts = []
    for window in windows:
        length = window.last - window.first
        count = max(1, min(round(length / samples), length // _FEWEST))
        edges = [window.first + round(k * length / count) for k in range(count + 1)]
        parts += [Window(first=a, last=b) for a, b in pairwise(edges)]
    return tuple(parts)


def find_axis_start(run: AxisRun, first: int) -> tuple[float, float, float]:
    """Return position, velocity and time at the last of the 20 samples from `first` on."""
    moments = run.period * (np.arange(GIVEN) - (GIVEN - 1))
    curve = np.polyfit(moments, run.position[first : first + GIVEN], 2)
    return float(curve[2]), float(curve[1]), run.begin + run.period * (first + GIVEN - 1)


def find_output_error(
    model: AxisModel,
    values: FloatArray,
    run: AxisRun,
    windows: Sequence[Window],
    left_out: Window | None = None,
) -> FloatArray:
    """Return simulated less measured position behind the first 20 samples of each window, m or rad.

    Samples of `left_out` are simulated, but their errors are not among those returned.
    """
    errors = []
    for window in windows:
        force = run.force[window.first + GIVEN - 1 : window.last]
        position, _ = simulate_axis(model, values, force, run.period, find_axis_start(run, window.first))
        error = position[1:] - run.position[window.first + GIVEN : window.last]
        errors.append(error[_find_counted(window, left_out)])
    return _bound(np.concatenate(errors))


def find_window_rmse(model: AxisModel, values: FloatArray, run: AxisRun, windows: Sequence[Window]) -> float:
    """Return the root mean square of `find_output_error`, m or rad."""
    return float(np.sqrt(np.mean(np.square(find_output_error(model, values, run, windows)))))


def _find_rates(
    model: AxisModel,
    values: FloatArray,
    run: AxisRun,
    windows: Sequence[Window],
    left_out: Window | None,
) -> FloatArray:
    parts = []
    for window in windows:
        force = run.force[window.first + GIVEN - 1 : window.last]
        _, rates = find_axis_rates(model, values, force, run.period, find_axis_start(run, window.first))
        parts.append(rates[1:][_find_counted(window, left_out)])
    return _bound(np.vstack(parts))


def _find_counted(window: Window, left_out: Window | None) -> NDArray[np.bool_]:
    """Return which samples behind the given ones of a window are not left out."""
    samples = np.arange(window.first + GIVEN, window.last)
    if left_out is None:
        return np.ones(len(samples), dtype=np.bool_)
    counted: NDArray[np.bool_] = (samples < left_out.first) | (samples >= left_out.last)
    return counted


def _bound(errors: FloatArray) -> FloatArray:
    bounded: FloatArray = np.clip(np.nan_to_num(errors, nan=_WORST), -_WORST, _WORST)
    return bounded


def fit_force(
    model: AxisModel,
    run: AxisRun,
    states: tuple[FloatArray, FloatArray, FloatArray],
    windows: Sequence[Window],
    shape: Sequence[float] = (),
) -> FloatArray:
    """Return the values with the least error of force: where a search for the least error of position begins.

    Args:
        model: of the axis.
        run: its recording.
        states: position, velocity, acceleration (N,) at the samples of the run.
        windows: samples used.
        shape: values of the law's shape.
    """
    rows = np.concatenate([np.arange(window.first, window.last) for window in windows])
    position, velocity, acceleration = (values[rows] for values in states)
    inputs = {
        "velocity": velocity,
        "position": position,
        "load": run.force[rows],
        "time": run.begin + run.period * rows,
    }
    columns = np.column_stack([acceleration, find_force_columns(model, inputs, shape)])
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    found, *_ = np.linalg.lstsq(columns / scale, run.force[rows], rcond=None)
    return np.concatenate([found / scale, np.asarray(shape, dtype=np.float64)])


def fit_output_error(
    model: AxisModel,
    run: AxisRun,
    windows: Sequence[Window],
    starts: Sequence[FloatArray],
    *,
    left_out: Window | None = None,
    evaluations: int = _EVALUATIONS,
) -> OutputErrorFit:
    """Return the values with the least error of position, the best from several starts.

    Args:
        model: of the axis.
        run: its recording.
        windows: simulated each from its own first samples.
        starts: values (p,) each.
        left_out: samples whose errors do not count.
        evaluations: simulations of all windows at most, for each start.

    Raises:
        LogError: a window has fewer than 40 samples.
    """
    from scipy.optimize import least_squares

    short = [window for window in windows if window.last - window.first < _FEWEST]
    if short or not windows:
        text = f"windows {short}: there must be one at least, and each must have {_FEWEST} samples or more"
        raise LogError(Notice(code="friction.axis-run", text=text))
    lower, upper = _find_bounds(model)
    fits = []
    for start in starts:
        scale = np.maximum(np.abs(start), 1e-3)
        room = 1e-6 * scale
        inside = np.clip(start, lower + room, upper - room)
        fits.append(
            least_squares(
                lambda values: find_output_error(model, values, run, windows, left_out),
                inside,
                jac=lambda values: _find_rates(model, values, run, windows, left_out),
                bounds=(lower, upper),
                x_scale="jac",
                xtol=_TOLERANCE,
                ftol=_TOLERANCE,
                gtol=None,
                max_nfev=evaluations,
            )
        )
    best = min(fits, key=lambda fit: float(fit.cost))
    return OutputErrorFit(
        names=model.parameters,
        values=tuple(float(value) for value in best.x),
        rmse=float(np.sqrt(np.mean(np.square(best.fun)))),
        windows=len(windows),
        evaluations=sum(int(fit.nfev) for fit in fits),
        converged=bool(best.status > 0),
    )


def _find_bounds(model: AxisModel) -> tuple[FloatArray, FloatArray]:
    """Return least and greatest values: of the law, of the terms, and a mass above zero."""
    terms = tuple(AXIS_TERMS[name].parameter for name in model.terms)
    parameters = (*model.law.linear, *terms, *model.law.shape)
    lower = np.array([0.0, *(parameter.lower for parameter in parameters)])
    upper = np.array([np.inf, *(parameter.upper for parameter in parameters)])
    return lower, upper
