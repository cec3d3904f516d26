"""Friction laws of one axis compared: by the force that each leaves, and by output error on held-out blocks.

Recordings of a robot with one joint -> FrictionSamples, AxisRun; laws -> residuals; AxisModel ->
AxisTrial.

    R u = R [ddq, Phi(dq; s), terms] (M, c),   relative residual |R u - R u_hat| / |R u|

R is the decimation that the force and all columns pass alike, after the same filter of the position. For
the output error the run is cut into blocks: the errors of one block do not count while a model is fitted
to the whole run, and then say how well it predicts; the simulation passes through that block as long and
as far from its start as it will be used. Of all models within one standard error of the best, the one
with the fewest values is taken (Breiman, Friedman, Olshen and Stone 1984). A fit to the whole run begins
from fits in windows, short ones first.

Supported: all laws by name; terms beside them by the names of `AXIS_TERMS`; one run.
Not supported: several joints (`extraction`); models compared on different blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.errors import LogError, Notice
from symid.identification.friction.estimate import FrictionEstimate
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.output_error import (
    AxisModel,
    AxisRun,
    OutputErrorFit,
    Window,
    compute_axis_terms,
    compute_output_error,
    fit_force,
    fit_output_error,
    split_windows,
)
from symid.identification.friction.samples import FrictionSamples, build_friction_rows, build_reduction
from symid.identification.friction.selection import predict_rows
from symid.joint_models import get_law
from symid.logs import Recording, differentiate, low_pass, prepare_signals
from symid.robot import Processing

AXIS_BLOCKS = 4
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


def compute_axis_states(run: AxisRun, cutoff: float, order: int = 4) -> AxisStates:
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
        states: of `compute_axis_states`.
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
        states: of `compute_axis_states`.
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
    blocks: int = AXIS_BLOCKS,
    generator: np.random.Generator,
) -> AxisTrial:
    """Return the error in each block of a fit to all others; the rest as in `fit_whole_run`."""
    whole = Window(first=0, last=len(run.force))
    held = []
    for block in split_windows([whole], len(run.force) / blocks):
        fit = fit_whole_run(model, run, states, plan, left_out=block, generator=generator)
        values = np.array(fit.values)
        seen = compute_output_error(model, values, run, [whole], left_out=block)
        both = compute_output_error(model, values, run, [whole])
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


@dataclass(frozen=True, slots=True, kw_only=True)
class LawResidual:
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
        extra=np.column_stack([signals.ddq[:, 0], *compute_axis_terms(terms, inputs)]),
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


def compute_relative_residual(samples: FrictionSamples, law: str, estimate: FrictionEstimate) -> float:
    """Return what an estimate leaves of the rows of `samples`, in percent of their norm."""
    torque = build_friction_rows(samples).torque
    left = torque - predict_rows(samples, get_law(law), estimate)
    return 100.0 * float(np.linalg.norm(left) / np.linalg.norm(torque))


def compare_laws(
    fitted: FrictionSamples, unseen: Sequence[FrictionSamples], laws: Sequence[str]
) -> tuple[LawResidual, ...]:
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
            LawResidual(
                law=law,
                estimate=estimate,
                fitted_percent=compute_relative_residual(fitted, law, estimate),
                unseen_percent=tuple(compute_relative_residual(other, law, estimate) for other in unseen),
            )
        )
    return tuple(rows)
