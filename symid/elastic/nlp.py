"""Dynamics, friction and hysteresis together, in one constrained problem: the one-shot reference.

ElasticProblem -> NlpFit.

    rows         linear parts once, knees and Stribeck friction as steps     (nlp_rows)
    unknowns     chi, weights k >= 0, slopes c > 0, Fs, vs                   (nlp_layout)
    rounds       minimise sum_b |r_b|^2 / sigma_b^2, then sigma_b <- rms r_b   (nlp_solver)

Positions of stops and knees are fixed: those of a start that has them, or a grid, whose knees follow the
torque that the springs reach. With knees of a grid close to zero torque the cost can have several minima.
What no motion shows is said: stops beyond the torsion, knees beyond the torque.

Supported: energy, filtered and momentum rows; Stribeck friction; odd springs.
Not supported: joint damping, cubic springs, unknown positions of stops and knees.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.elastic.elimination import fit_elimination
from symid.elastic.fit import ElasticFit, HistoryEntry
from symid.elastic.iteration import fit_linear_spring
from symid.elastic.nlp_cost import NlpCost
from symid.elastic.nlp_covariance import find_nlp_covariance
from symid.elastic.nlp_layout import (
    NlpLayout,
    SpringGrid,
    SpringLayout,
    build_layout,
    build_spring,
    flatten_slopes,
)
from symid.elastic.nlp_options import NlpOptions
from symid.elastic.nlp_rows import NlpRecording, build_nlp_recording
from symid.elastic.nlp_solver import NlpRun, find_scales, optimise_nlp
from symid.elastic.nlp_starts import find_linear_sigmas, find_sigmas, find_start, list_weights
from symid.elastic.problem import ElasticProblem, build_fit
from symid.errors import Notice
from symid.robot.elasticity import Elasticity

__all__ = ["NlpFit", "fit_nlp"]

_SHIFT = 1e-4
"""Of the place of a stop or knee, for derivatives by it."""
_REST = 1e-9
"""Of the linear spring: weights below it are zero."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpFit:
    """What the problem gave.

    Args:
        fit: parameters and springs, outcome, one history entry a round.
        run: the last run, with its certificate.
        cost: of the last round; its `sigmas` are the row scales, its `layout` names the unknowns.
        scales: (x,) SI units per scaled unknown.
        stiffness: (n,) of the linear springs that bound the weights.
    """

    fit: ElasticFit
    run: NlpRun
    cost: NlpCost
    scales: FloatArray
    stiffness: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Setting:
    """What all rounds share; `knees` is None where they lie on a grid over the torque."""

    problem: ElasticProblem
    options: NlpOptions
    recordings: tuple[NlpRecording, ...]
    thresholds: tuple[FloatArray, ...]
    knees: tuple[tuple[float, ...], ...] | None
    stiffness: FloatArray

    def lay_out(self, springs: Sequence[Elasticity]) -> NlpLayout:
        """Return the unknowns, with knees for what `springs` reach."""
        knees = self.knees if self.knees is not None else _place_knees(self, springs)
        grids = []
        for joint, thresholds in enumerate(self.thresholds):
            grid = SpringGrid(
                thresholds=thresholds,
                knees=knees[joint],
                stiffness=float(self.stiffness[joint]),
                reach=max(float(np.abs(part.bases[joint][:, 0]).max()) for part in self.recordings),
            )
            grids.append(grid)
        return build_layout(self.problem.library.card, grids, self.options)


def fit_nlp(
    problem: ElasticProblem, options: NlpOptions | None = None, start: ElasticFit | None = None
) -> NlpFit:
    """Return the optimum of the hysteresis-plus-friction problem.

    Args:
        problem: recordings, grids, window and filter.
        options: rows, friction, bounds, solver; None for the defaults.
        start: dynamics and springs to begin with, whose stops and knees stay where they are. None for those
            of the elimination, or, where the problem does not refine its grids, for linear springs on them.
    """
    options = options or NlpOptions()
    begin = start or _find_begin(problem)
    setting = _prepare_setting(problem, options, begin)
    layout = setting.lay_out(begin.elasticity)
    x = find_start(layout, begin.chi, begin.elasticity)
    sigmas = find_linear_sigmas(setting.recordings, begin.chi, setting.stiffness)
    history: list[HistoryEntry] = []
    for number in range(options.rounds + 1):
        cost = NlpCost(
            recordings=setting.recordings, layout=layout, sigmas=sigmas, smoothing=options.smoothing
        )
        scales = find_scales(cost, x)
        run = optimise_nlp(cost, x, scales, options)
        history.append(_write_entry(cost, run, x))
        if number == options.rounds or not run.outcome.usable:
            break
        sigmas = find_sigmas(cost, run.x)
        layout, x = _carry_over(setting, layout, run)
    run = replace(run, x=flatten_slopes(layout, run.x, run.certificate.undetermined))
    springs = _read_springs(layout, run.x, setting.stiffness)
    fit = build_fit(
        problem,
        "nlp",
        run.x[layout.dynamics],
        springs,
        history=tuple(history),
        outcome=run.outcome,
        covariance=find_nlp_covariance(cost, run.x, _find_place_slopes(setting, cost, run.x)),
    )
    fit = replace(fit, notices=tuple(_list_notices(run)))
    return NlpFit(fit=fit, run=run, cost=cost, scales=scales, stiffness=setting.stiffness)


def _find_place_slopes(setting: _Setting, cost: NlpCost, x: FloatArray) -> list[list[FloatArray]]:
    """Return the derivatives of all residuals by the place of every stop and knee, one after the other."""
    springs = cost.layout.springs
    middle = replace(setting, knees=tuple(spring.knees for spring in springs))
    before = cost.find_state(x).residuals
    slopes = []
    for shifted, step in _list_shifted(middle, x, springs):
        layout = shifted.lay_out(())
        moved = replace(cost, recordings=shifted.recordings, layout=layout).find_state(x).residuals
        slopes.append([(after - now) / step for after, now in zip(moved, before, strict=True)])
    return slopes


def _list_shifted(
    setting: _Setting, x: FloatArray, springs: Sequence[SpringLayout]
) -> Iterator[tuple[_Setting, float]]:
    """Yield the setting with each place a little further out, and by how much; knees only where alone."""
    problem, options = setting.problem, setting.options
    for joint, spring in enumerate(springs):
        for stop, weight in enumerate(x[spring.weights][1:]):
            if weight <= _REST * setting.stiffness[joint]:
                continue
            grids = [grid.copy() for grid in setting.thresholds]
            step = _SHIFT * grids[joint][stop]
            grids[joint][stop] += step
            moved = tuple(map(freeze, grids))
            recordings = tuple(
                build_nlp_recording(problem, index, moved, options.rows)
                for index in range(len(setting.recordings))
            )
            yield replace(setting, thresholds=moved, recordings=recordings), float(step)
        for place in range(len(spring.knees) if setting.knees and not options.odd else 0):
            knees = [list(entries) for entries in setting.knees or ()]
            step = _SHIFT * abs(knees[joint][place])
            knees[joint][place] += step
            yield replace(setting, knees=tuple(map(tuple, knees))), step


def _find_begin(problem: ElasticProblem) -> ElasticFit:
    """Return dynamics and springs to begin with; refined stops and knees are those of the elimination."""
    if problem.options.refine and problem.options.thresholds is None:
        return fit_elimination(problem)
    return fit_linear_spring(problem)


def _prepare_setting(problem: ElasticProblem, options: NlpOptions, begin: ElasticFit) -> _Setting:
    springs = begin.elasticity
    placed = any(spring.stops or spring.knees for spring in springs)
    thresholds = problem.thresholds
    knees = problem.options.knee_torques
    if placed:
        thresholds = tuple(freeze([stop.threshold for stop in spring.stops]) for spring in springs)
        knees = tuple(tuple(knee.threshold for knee in spring.knees) for spring in springs)
    recordings = tuple(
        build_nlp_recording(problem, index, thresholds, options.rows) for index in range(len(problem.signals))
    )
    whole = np.array([spring.initial_stiffness or 0.0 for spring in springs])
    return _Setting(
        problem=problem,
        options=options,
        recordings=recordings,
        thresholds=thresholds,
        knees=knees,
        stiffness=np.maximum(whole, 1e-6 * max(float(whole.max()), 1e-6)),
    )


def _carry_over(setting: _Setting, layout: NlpLayout, run: NlpRun) -> tuple[NlpLayout, FloatArray]:
    """Return layout and start of the next round: the knees of a grid follow the torque that was reached."""
    x = flatten_slopes(layout, run.x, run.certificate.undetermined)
    if setting.knees is not None:
        return layout, x
    springs = _read_springs(layout, x, setting.stiffness)
    fresh = setting.lay_out(springs)
    start = find_start(fresh, x[layout.dynamics], springs)
    start[fresh.excess], start[fresh.speed] = x[layout.excess], x[layout.speed]
    return fresh, start


def _write_entry(cost: NlpCost, run: NlpRun, start: FloatArray) -> HistoryEntry:
    places = cost.layout.dynamics
    step = run.x[places] - start[places]
    size = np.maximum(np.abs(run.x[places]), 1e-3 * float(np.max(np.abs(run.x[places]))))
    state = cost.find_state(run.x)
    return HistoryEntry(
        merit=run.objective,
        change=float(np.max(np.abs(step) / size)),
        norms=tuple(float(np.linalg.norm(residual)) for residual in state.residuals),
    )


def _list_notices(run: NlpRun) -> Iterator[Notice]:
    if not run.converged:
        text = f"the problem was not solved: {run.reason}; parameters and springs are those of its last point"
        yield Notice(code="elastic.nlp-not-converged", text=text)
    unknown = run.certificate.undetermined
    if unknown:
        text = (
            f"the recordings do not show {', '.join(unknown)}: move farther, at other speeds or with more "
            "load, or leave these terms out"
        )
        yield Notice(code="elastic.nlp-undetermined", text=text)
    for bound in run.certificate.active:
        # Zero is a bound of nature; all others are ours.
        if bound.value != 0.0:
            text = f"{bound.name} is at its limit of {bound.value:g}: the recordings do not hold it"
            yield Notice(code="elastic.nlp-limit", text=text)


def _read_springs(layout: NlpLayout, x: FloatArray, stiffness: FloatArray) -> tuple[Elasticity, ...]:
    return tuple(
        build_spring(spring, x, _REST * whole)
        for spring, whole in zip(layout.springs, stiffness, strict=True)
    )


def _place_knees(setting: _Setting, springs: Sequence[Elasticity]) -> tuple[tuple[float, ...], ...]:
    """Return knees at (j - 1/2) / l of the greatest torque before the knees, on each side."""
    count = setting.problem.options.knees
    places = (np.arange(count) + 0.5) / max(count, 1)
    result = []
    for joint, spring in enumerate(springs):
        weights = list_weights(spring, setting.thresholds[joint])
        torque = np.concatenate([part.bases[joint] @ weights for part in setting.recordings])
        low, high = max(0.0, -float(torque.min())), max(0.0, float(torque.max()))
        if setting.options.odd:
            low = high = max(low, high)
        below = -places[::-1] * low if low else np.zeros(0)
        above = places * high if high else np.zeros(0)
        result.append(tuple(float(knee) for knee in (*below, *above)))
    return tuple(result)
