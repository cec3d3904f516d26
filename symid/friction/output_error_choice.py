"""The choice of an axis model by its output error where it was not fitted.

Input: an `AxisRun`, models. Output: `AxisTrial` of each, the one chosen.

The run is cut into blocks. The errors of one block do not count while a model is fitted to the whole run;
then they tell how well it foretells: the simulation passes through that block without having seen it, as long
and as far from its start as it will be used. Of all models within one standard error of the best, the one
with the fewest values is taken (Breiman, Friedman, Olshen and Stone 1984; standard error over the blocks).

A fit to the whole run begins from fits in windows: short ones first, each from the one before.

Supported: one run, any models. Not supported: models compared on different blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.data.filters import differentiate, low_pass
from symid.friction.axis_simulation import AxisModel
from symid.friction.output_error import (
    AxisRun,
    OutputErrorFit,
    Window,
    find_output_error,
    fit_force,
    fit_output_error,
    split_windows,
)

__all__ = [
    "BLOCKS",
    "AxisTrial",
    "SearchPlan",
    "choose_axis_trial",
    "find_axis_states",
    "fit_in_windows",
    "fit_whole_run",
    "try_axis_model",
]

BLOCKS = 4
"""Into which a run is cut."""

AxisStates = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchPlan:
    """How a fit to a whole run is searched.

    Args:
        lengths: of windows that lead there, s, short ones first.
        shape: values of a law's shape to begin with.
        restarts: further starts, scattered about the values found in windows.
        scatter: standard deviation of that, relative.
    """

    lengths: tuple[float, ...]
    shape: tuple[float, ...] = ()
    restarts: int = 3
    scatter: float = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisTrial:
    """How a model did.

    Args:
        model: what was tried.
        held: root mean square error of the position in each block that did not count, m or rad.
    """

    model: AxisModel
    held: tuple[float, ...]

    @property
    def unknowns(self) -> int:
        """Return how many values were fitted."""
        return len(self.model.parameters)

    @property
    def rmse(self) -> float:
        """Return the root of the mean square over the blocks, m or rad."""
        return float(np.sqrt(np.mean(np.square(self.held))))

    @property
    def deviation(self) -> float:
        """Return the standard error of the mean square over the blocks, m^2 or rad^2."""
        return float(np.std(np.square(self.held), ddof=1) / np.sqrt(len(self.held)))


def find_axis_states(run: AxisRun, cutoff: float, order: int = 4) -> AxisStates:
    """Return position, velocity and acceleration (N,), low-passed forward and backward at `cutoff` Hz."""
    position = low_pass(run.position, period=run.period, cutoff=cutoff, order=order)
    velocity = differentiate(position, run.period)
    return position, velocity, differentiate(velocity, run.period)


def fit_in_windows(
    model: AxisModel,
    run: AxisRun,
    states: AxisStates,
    blocks: Sequence[Window],
    lengths: Sequence[float],
    *,
    shape: Sequence[float] = (),
) -> tuple[OutputErrorFit, ...]:
    """Return the fit in windows of each of `lengths`, begun from the fit before it; the first from forces.

    Args:
        model: of the axis.
        run: its recording.
        states: of `find_axis_states`.
        blocks: samples used.
        lengths: of windows in s, short ones first.
        shape: values of the law's shape to begin with.
    """
    fits: list[OutputErrorFit] = []
    start = fit_force(model, run, states, blocks, shape)
    for length in lengths:
        windows = split_windows(blocks, length / run.period)
        fits.append(fit_output_error(model, run, windows, [start]))
        start = np.array(fits[-1].values)
    return tuple(fits)


def fit_whole_run(
    model: AxisModel,
    run: AxisRun,
    states: AxisStates,
    plan: SearchPlan,
    *,
    left_out: Window | None = None,
    generator: np.random.Generator,
) -> OutputErrorFit:
    """Return the fit to a run simulated as one window, led there by fits in shorter ones.

    Args:
        model: of the axis.
        run: its recording.
        states: of `find_axis_states`.
        plan: of the search.
        left_out: samples that neither this fit nor those before it see.
        generator: of the scatter.
    """
    whole = Window(first=0, last=len(run.force))
    parts = [whole] if left_out is None else _cut_out(whole, left_out)
    fits = fit_in_windows(model, run, states, parts, plan.lengths, shape=plan.shape[: len(model.law.shape)])
    last = np.array(fits[-1].values)
    scatter = (plan.scatter * generator.standard_normal(len(last)) for _ in range(plan.restarts))
    starts = [last, *(last * (1.0 + part) for part in scatter)]
    return fit_output_error(model, run, [whole], starts, left_out=left_out)


def _cut_out(whole: Window, left_out: Window) -> list[Window]:
    sides = (
        Window(first=whole.first, last=left_out.first),
        Window(first=left_out.last, last=whole.last),
    )
    return [side for side in sides if side.last > side.first]


def try_axis_model(
    model: AxisModel,
    run: AxisRun,
    states: AxisStates,
    plan: SearchPlan,
    *,
    blocks: int = BLOCKS,
    generator: np.random.Generator,
) -> AxisTrial:
    """Return the error in each block of a fit to all others; the rest as in `fit_whole_run`."""
    whole = Window(first=0, last=len(run.force))
    held = []
    for block in split_windows([whole], len(run.force) / blocks):
        fit = fit_whole_run(model, run, states, plan, left_out=block, generator=generator)
        values = np.array(fit.values)
        seen = find_output_error(model, values, run, [whole], left_out=block)
        both = find_output_error(model, values, run, [whole])
        unseen = max(float(both @ both - seen @ seen), 0.0)
        held.append(float(np.sqrt(unseen / (len(both) - len(seen)))))
    return AxisTrial(model=model, held=tuple(held))


def choose_axis_trial(trials: Sequence[AxisTrial]) -> AxisTrial:
    """Return, of all trials within one standard error of the best, that of the fewest values.

    Among equally many, the one with the least error.
    """
    best = min(trials, key=lambda trial: trial.rmse)
    limit = best.rmse**2 + best.deviation
    near = [trial for trial in trials if trial.rmse**2 <= limit]
    return min(near, key=lambda trial: (trial.unknowns, trial.rmse))
