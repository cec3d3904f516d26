"""Dynamics, friction and hysteresis together, in one constrained problem: the one-shot reference.

ElasticProblem -> NlpFit.

    rows         linear parts once, knees and Stribeck friction as steps     (nlp_rows)
    unknowns     chi, weights k >= 0, slopes c > 0, Fs, vs                   (nlp_layout)
    rounds       minimise sum_b |r_b|^2 / sigma_b^2, then sigma_b <- rms r_b   (nlp_solver)
    places       those of a start move between rounds, by Gauss and Newton        (nlp_places)

Stops and knees that are given, or on a grid, stay where they are; knees of a grid follow the torque that the
springs reach, and where they are close to zero torque the cost can have several minima. What no motion shows
is said: stops beyond the torsion, knees beyond the torque.

Supported: energy, filtered and momentum rows; Stribeck friction; odd springs.
Not supported: joint damping, cubic springs; another number of stops and knees than that of the start.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.elimination import fit_elimination
from symid.elastic.fit import ElasticFit, HistoryEntry
from symid.elastic.iteration import fit_linear_spring
from symid.elastic.nlp_cost import NlpCost
from symid.elastic.nlp_covariance import find_nlp_covariance
from symid.elastic.nlp_layout import NlpLayout, build_spring, flatten_slopes
from symid.elastic.nlp_options import NlpOptions
from symid.elastic.nlp_places import REST, find_place_slopes, list_places, move_places
from symid.elastic.nlp_setting import NlpSetting, prepare_setting
from symid.elastic.nlp_solver import NlpRun, find_scales, optimise_nlp
from symid.elastic.nlp_starts import find_linear_sigmas, find_sigmas, find_start
from symid.elastic.problem import ElasticProblem, build_fit
from symid.errors import Notice
from symid.robot.elasticity import Elasticity

__all__ = ["NlpFit", "fit_nlp"]


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


def fit_nlp(
    problem: ElasticProblem, options: NlpOptions | None = None, start: ElasticFit | None = None
) -> NlpFit:
    """Return the optimum of the hysteresis-plus-friction problem.

    Args:
        problem: recordings, grids, window and filter.
        options: rows, friction, bounds, solver; None for the defaults.
        start: dynamics and springs to begin with, whose stops and knees move to better places near where the
            problem refines its grids. None for those of the elimination, or, where it does not, for linear
            springs on the grids.
    """
    options = options or NlpOptions()
    begin = start or _find_begin(problem)
    setting = prepare_setting(problem, options, begin)
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
        setting, layout, x = _carry_over(setting, replace(cost, sigmas=sigmas), run)
    run = replace(run, x=flatten_slopes(layout, run.x, run.certificate.undetermined))
    springs = _read_springs(layout, run.x, setting.stiffness)
    slopes = find_place_slopes(setting, cost, run.x, list_places(setting, cost, run.x))
    fit = build_fit(
        problem,
        "nlp",
        run.x[layout.dynamics],
        springs,
        history=tuple(history),
        outcome=run.outcome,
        covariance=find_nlp_covariance(cost, run.x, slopes),
    )
    fit = replace(fit, notices=tuple(_list_notices(run)))
    return NlpFit(fit=fit, run=run, cost=cost, scales=scales, stiffness=setting.stiffness)


def _find_begin(problem: ElasticProblem) -> ElasticFit:
    """Return dynamics and springs to begin with; refined stops and knees are those of the elimination."""
    if problem.options.refine and problem.options.thresholds is None:
        return fit_elimination(problem)
    return fit_linear_spring(problem)


def _carry_over(setting: NlpSetting, cost: NlpCost, run: NlpRun) -> tuple[NlpSetting, NlpLayout, FloatArray]:
    """Return setting, layout and start of the next round.

    Stops and knees are a step nearer to their best places; the knees of a grid follow the torque reached.
    """
    layout = cost.layout
    x = flatten_slopes(layout, run.x, run.certificate.undetermined)
    if setting.knees is not None:
        setting, x = move_places(setting, cost, x)
        return setting, setting.lay_out(()), x
    springs = _read_springs(layout, x, setting.stiffness)
    fresh = setting.lay_out(springs)
    start = find_start(fresh, x[layout.dynamics], springs)
    start[fresh.excess], start[fresh.speed] = x[layout.excess], x[layout.speed]
    return setting, fresh, start


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
        build_spring(spring, x, REST * whole) for spring, whole in zip(layout.springs, stiffness, strict=True)
    )
