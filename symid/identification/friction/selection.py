"""The choice of a friction law: which one predicts held-out blocks best.

FrictionSamples, laws -> LawSelection.

Each recording is cut into blocks of consecutive rows. A law is fitted to all blocks but one of each
recording and predicts the torques there, until every block was held out once; the law is taken by
`choose_held_out`, by its number of unknowns. Laws with parameters that are not identifiable are not taken.
Without a block, shape values are searched within a factor of four about those of the fit to all rows: only
these bounds use the block. Rows next to a block are left out, as they share its filter; random samples are
not held out, as their neighbours predict them.

Shapes of laws of the velocity alone are searched in a sketch of the rows: columns as their values at a few
speeds, times a table,

    R Phi(v; s) ~ (R H) Phi(v_k; s),   H: interpolation from the speeds v_k

of which the triangle of [R H, R tau], less their parts in R X, is enough for every law and every shape. What
is linear, and all errors, are of the rows themselves. Laws with kinks or many minima are searched in the rows
where they come near the best.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import IdentifiabilityError, Notice, SymidError
from symid.identification.diagnostics import choose_held_out, measure_behind
from symid.identification.estimators import LawSelection, LawTrial, MotionResidual, find_phases
from symid.identification.friction import joint_fit, problem as problems
from symid.identification.friction.estimators import build_estimate, check_search, fit_friction
from symid.identification.friction.searches import JUMPING, KINKED, search_by_projection
from symid.identification.regression import BLOCK, extend_triangle
from symid.joint_models import FrictionLaw, get_law

CANDIDATE_LAWS = (
    "coulomb-viscous",
    "coulomb-viscous-offset",
    "asymmetric",
    "tustin+offset",
    "stribeck+offset",
    "lorentzian+offset",
    "improved-stribeck",
    "asymmetric-stribeck",
    "cubic+offset",
    "power-law+offset",
    "stribeck+cubic+offset",
    "load-dependent+offset",
    "stribeck-exponent+offset",
    "makkar+offset",
)
"""Laws among which `auto` chooses, from plain to rich."""

BLOCKS = 5
"""Of each recording."""
_LEAST_ROWS = 10
"""Of a block."""
_NARROW = 4.0
"""Factor about the shape of the whole fit within which that of a part is searched."""
_WHOLE = problems.VariableProjectionOptions(grid=((12,), (5, 4), (4, 3, 3)), starts=2, solves=80)
_PART = problems.VariableProjectionOptions(grid=((3,), (3, 2), (2, 2, 2)), starts=1, solves=30)
"""Less effort than in a final fit: laws differ by far more than the last digits of an optimum."""
_SPEEDS, _POINTS, _PIECE = 96, 6, 8
"""Of a sketch: speeds in each direction, those that a sample is interpolated from, columns at a time."""
_LIMIT = 1e-9
"""Part of the top speed that is the slowest speed of a sketch."""
_NEAR, _ALIKE = 3.0, 1.05
"""Standard errors behind the best law, and times its loss, up to which a law may turn out as the best."""
_LEAST_SKETCHED, _MOST_NUMBERS = 20, 2e8
"""Rows for each column of a sketch, at least; numbers of all its rows, at most."""
_DEPENDENT = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Score:
    """A law: its fit to all rows, `final` if of full effort, squared errors of the held-out blocks (B,)."""

    law: FrictionLaw
    estimate: joint_fit.FrictionEstimate
    errors: FloatArray
    final: bool = False

    @property
    def unknowns(self) -> int:
        return len(self.law.linear) + len(self.law.shape)

    @property
    def refused(self) -> tuple[str, ...]:
        """Return the law's parameters that are not identifiable."""
        refused = dict(self.estimate.refused)
        return tuple(entry.name for entry in self.law.physical if entry.name in refused)

    @property
    def total(self) -> float:
        return float(self.errors.sum())


def assign_blocks(rows: joint_fit.FrictionRows, blocks: int = BLOCKS) -> NDArray[np.intp]:
    """Return the block of each row (M,): block k is the k-th part of every recording, -1 of one too short.

    Raises IdentifiabilityError where there are not rows enough for two blocks.
    """
    parts = [np.flatnonzero(rows.run == run) for run in np.unique(rows.run)]
    longest = max(len(part) for part in parts)
    blocks = min(blocks, longest // _LEAST_ROWS)
    if blocks < 2:
        text = (
            f"logs with {longest} rows cannot be cut into two parts of {_LEAST_ROWS}, so no data can be "
            "held out to choose a law. Name one with --model, or use longer logs"
        )
        raise IdentifiabilityError(Notice(code="friction.too-few-rows", text=text))
    number = np.full(len(rows.run), -1, dtype=np.intp)
    for index in parts:
        if len(index) >= blocks * _LEAST_ROWS:
            for block, part in enumerate(np.array_split(index, blocks)):
                number[part] = block
    return number


def predict_rows(
    samples: joint_fit.FrictionSamples, law: FrictionLaw, estimate: joint_fit.FrictionEstimate
) -> FloatArray:
    """Return the torques (M,) in N m or N that an estimate predicts of the rows of `samples`."""
    friction = samples.pass_law(law, estimate.shape) @ np.asarray(estimate.linear)
    return np.asarray(friction + samples.build_rows().extra @ np.asarray(estimate.other))


def measure_motion(
    samples: joint_fit.FrictionSamples,
    law: FrictionLaw,
    estimate: joint_fit.FrictionEstimate,
    *,
    unit: str,
    kept: NDArray[np.bool_],
) -> MotionResidual:
    """Return the residual of all rows in motion, at reversal and at rest; those not `kept` (m,) too."""
    rows = samples.build_rows()
    errors = rows.torque - predict_rows(samples, law, estimate)
    phases = find_phases(rows.time, rows.velocity, rows.run)
    return MotionResidual.measure(samples.joint, unit, errors, phases, int(np.sum(~kept)))


def compute_relative_residual(
    samples: joint_fit.FrictionSamples, law: FrictionLaw, estimate: joint_fit.FrictionEstimate
) -> float:
    """Return the residual of an estimate on the rows of `samples`, in percent of their norm."""
    torque = samples.build_rows().torque
    left = torque - predict_rows(samples, law, estimate)
    return 100.0 * float(np.linalg.norm(left) / np.linalg.norm(torque))


def select_law(
    samples: joint_fit.FrictionSamples,
    names: Sequence[str] = CANDIDATE_LAWS,
    *,
    smoothing: float = 0.0,
    options: problems.FrictionOptions | None = None,
    blocks: int = BLOCKS,
) -> tuple[LawSelection, joint_fit.FrictionEstimate | None]:
    """Return the choice among laws by their names, fitted by variable projection.

    With the fit of full effort to all rows that the law chosen has, where it needed one. `smoothing` is v0 in
    rad/s or m/s of all laws. Raises UsageError for an unknown law, IdentifiabilityError where no law can be
    fitted or there are too few rows to hold some out.
    """
    options = options or problems.FrictionOptions()
    rows = samples.build_rows()
    number = assign_blocks(rows, blocks)
    masks = [np.ones(len(number), dtype=np.bool_)]
    for block in range(int(number.max()) + 1):
        out = number == block
        free = ~out
        # Nor are two rows on either side of the block fitted.
        for shift in (1, 2):
            same = rows.run[shift:] == rows.run[:-shift]
            free[shift:] &= ~(out[:-shift] & same)
            free[:-shift] &= ~(out[shift:] & same)
        masks.append(free)
    fitted = tuple(samples.select_rows(free) for free in masks[1:])
    sketches = _draw_sketches(samples, masks)
    parts = _Parts(whole=samples, number=number, fitted=fitted, sketches=sketches)
    scores, failed = list[_Score](), list[LawTrial]()
    for law in [get_law(name, smoothing=smoothing) for name in names]:
        try:
            scores.append(_try_law(parts, law, options))
        except SymidError as error:
            unknowns = len(law.linear) + len(law.shape)
            failed.append(LawTrial(law=law.name, unknowns=unknowns, reason=error.notices[0].text))
    if not scores:
        reasons = "; ".join(dict.fromkeys(trial.reason for trial in failed))
        text = f"joint {samples.joint!r}: no law can be fitted to this log: {reasons}"
        raise IdentifiabilityError(Notice(code="friction.no-law", text=text))
    scores, best, chosen = _choose(samples, _try_in_rows(parts, scores, options), options)
    plain = (score for score in scores if score.law.name == "coulomb-viscous-offset" and score.total)
    baseline = next(plain, None)
    better = any(score.refused and score.total < best.total for score in scores)
    unit, count = "N" if samples.prismatic else "N m", int(np.sum(number >= 0))
    whole, held = (float(np.linalg.norm(rows.torque[mask])) for mask in (number >= -1, number >= 0))
    behind = measure_behind(np.stack([score.errors for score in scores]), scores.index(best))
    trials = [
        LawTrial(
            law=score.law.name,
            unknowns=score.unknowns,
            fitted_percent=100.0 * float(np.sqrt(score.estimate.objective)) / whole if whole else None,
            held_percent=100.0 * float(np.sqrt(score.total)) / held if held else None,
            held_rms=float(np.sqrt(score.total / count)),
            ratio=score.total / baseline.total if baseline is not None else None,
            behind=float(distance),
            aicc=score.estimate.aicc,
            reason=f"not identifiable: {', '.join(score.refused)}" if score.refused else "",
        )
        for score, distance in zip(scores, behind, strict=True)
    ]
    trials += failed
    selection = LawSelection(
        trials=tuple(
            sorted(trials, key=lambda one: np.inf if one.held_percent is None else one.held_percent)
        ),
        chosen=chosen.law.name,
        verdict=_write_verdict(chosen, best, baseline, among=better, held=count, unit=unit),
        blocks=int(number.max()) + 1,
    )
    return selection, chosen.estimate if chosen.final else None


def _try_in_rows(
    parts: "_Parts", scores: Sequence[_Score], options: problems.FrictionOptions
) -> list[_Score]:
    """Return the scores, those of laws that a sketch blurs from all rows where they may decide the choice."""
    found, tried = list(scores), set[int]()
    while parts.sketches:
        whole = [place for place, score in enumerate(found) if not score.refused]
        if not whole:
            break
        totals = np.array([found[place].total for place in whole])
        behind = measure_behind(np.stack([found[place].errors for place in whole]), int(np.argmin(totals)))
        near = (behind <= _NEAR) | (totals <= _ALIKE * totals.min())
        blurred = [place for place, close in zip(whole, near, strict=True) if close and place not in tried]
        # Laws with kinks or many minima, whose optimum in a sketch can be another one.
        shapes = {place: [entry.name for entry in found[place].law.shape] for place in blurred}
        blurred = [place for place, names in shapes.items() if len(names) > 2 or KINKED & set(names)]
        if not blurred:
            break
        tried |= set(blurred)
        for place in blurred:
            found[place] = _try_law(replace(parts, sketches=()), found[place].law, options)
    return found


def _choose(
    samples: joint_fit.FrictionSamples, scores: Sequence[_Score], options: problems.FrictionOptions
) -> tuple[list[_Score], _Score, _Score]:
    """Return the scores, the best among laws identifiable in a fit of full effort, and the one taken."""
    tried, checked = list(scores), set[str]()
    while True:
        whole = [score for score in tried if not score.refused]
        # Where no law is identifiable, the plainest one leaves least open.
        eligible = whole or [min(tried, key=lambda score: score.unknowns)]
        losses = np.stack([score.errors for score in eligible])
        choice = choose_held_out(losses, [score.unknowns for score in eligible])
        best, chosen = eligible[choice.best], eligible[choice.taken]
        # The best is what the others are compared with, so it is checked as well.
        unchecked = {score.law.name for score in (best, chosen) if score.law.shape and whole} - checked
        if not unchecked:
            return tried, best, chosen
        checked |= unchecked
        for place, score in enumerate(tried):
            if score.law.name in unchecked:
                estimate = fit_friction(samples, score.law, options=options)
                tried[place] = replace(score, estimate=estimate, final=True)


def _try_law(parts: "_Parts", law: FrictionLaw, options: problems.FrictionOptions) -> _Score:
    problem = problems.build_problem(parts.whole, law, options)
    whole = build_estimate(problem, parts.search(problem, 0, _WHOLE), "varpro")
    if law.shape:
        bounds = {
            entry.name: (max(entry.lower, value / _NARROW), min(entry.upper, value * _NARROW))
            for entry, value in zip(law.shape, whole.shape, strict=True)
            if value > 0.0
        }
        bounds |= dict(options.bounds)
        options = replace(options, bounds=tuple(bounds.items()))
    errors, rows = [], parts.whole.build_rows()
    for block, samples in enumerate(parts.fitted):
        part = problems.select_problem(problem, samples, options)
        found = parts.search(part, block + 1, _PART)
        check_search(found, samples.joint, "varpro")
        held = parts.number == block
        friction = parts.whole.pass_law(law, found.shape)[held] @ np.asarray(found.linear)
        beside = rows.extra[held] @ part.solve_beside(found.linear, found.shape)
        errors.append(float(np.sum((rows.torque[held] - friction - beside) ** 2)))
    return _Score(law=law, estimate=whole, errors=np.array(errors))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Parts:
    """Samples, the block of each row (M,), what is fitted without each, sketches of all and of these.

    A sketch is a few speeds as samples, whose R is the table (K, J) of a triangle; the torque behind it (K,).
    """

    whole: joint_fit.FrictionSamples
    number: NDArray[np.intp]
    fitted: tuple[joint_fit.FrictionSamples, ...]
    sketches: tuple[tuple[joint_fit.FrictionSamples, FloatArray], ...]

    def search(
        self, problem: problems.FrictionProblem, place: int, effort: problems.VariableProjectionOptions
    ) -> joint_fit.FrictionSearch:
        """Return the optimum of a problem; its shape is that of the sketch at `place`, where there is one."""
        names, law = {entry.name for entry in problem.law.shape}, problem.law
        if not self.sketches or not problem.is_free.any() or names & JUMPING or law.inputs != ("velocity",):
            return search_by_projection(problem, effort)
        samples, torque = self.sketches[place]
        basis = np.zeros((len(torque), 0))
        sketch = replace(problem, samples=samples, target=torque, basis=basis)
        found = search_by_projection(sketch, effort)
        exact = problems.Projector(problem, 1).project(problem.encode(found.shape))
        linear, shape = tuple(exact.linear.tolist()), tuple(exact.shape.tolist())
        return found._replace(linear=linear, shape=shape, objective=exact.objective)


def _draw_sketches(
    samples: joint_fit.FrictionSamples, masks: Sequence[NDArray[np.bool_]]
) -> tuple[tuple[joint_fit.FrictionSamples, FloatArray], ...]:
    """Return a sketch of the rows in each of `masks` (M,); none where there are few."""
    rows = samples.build_rows()
    if not samples.velocity.any():
        return ()
    # Speeds (J,) in each direction even in asinh(|v| / v0), fine near standstill, which is one of its own;
    # the interpolation (N, J) from them is by polynomials through neighbours.
    velocity, sizes = samples.velocity, np.abs(samples.velocity)
    fastest, finest = float(sizes.max()), problems.find_slowest(samples)
    step = np.arcsinh(fastest / finest) / (_SPEEDS - 1)
    places = np.arcsinh(sizes / finest) / step
    first = np.clip(places.astype(np.intp) - _POINTS // 2 + 1, 0, _SPEEDS - _POINTS)
    apart = (places - first)[:, None] - np.arange(_POINTS)
    weights = np.empty(apart.shape)
    for k in range(_POINTS):
        others = [j for j in range(_POINTS) if j != k]
        weights[:, k] = np.prod(apart[:, others], axis=1) / math.prod(k - j for j in others)
    column, rest = first + np.where(velocity < 0.0, _SPEEDS, 0), velocity == 0.0
    weights[rest], column[rest] = np.eye(1, _POINTS), 2 * _SPEEDS
    index = np.minimum(column[:, None] + np.arange(_POINTS), 2 * _SPEEDS)
    starts = np.arange(0, weights.size + 1, _POINTS)
    forward = finest * np.sinh(step * np.arange(_SPEEDS))
    # Friction jumps at zero velocity: the slowest speed is the limit from its side.
    forward[0] = _LIMIT * fastest
    speeds, shape = np.concatenate([forward, -forward, [0.0]]), (len(sizes), 2 * _SPEEDS + 1)
    spread = scipy.sparse.csr_matrix((weights.ravel(), index.ravel(), starts), shape=shape).tocsc()
    count, width = rows.extra.shape[1], rows.extra.shape[1] + len(speeds) + 1
    size = len(rows.torque)
    if size < _LEAST_SKETCHED * width or size * width > _MOST_NUMBERS:
        return ()
    table = np.empty((size, width))
    table[:, :count], table[:, -1] = rows.extra, rows.torque
    for start in range(0, len(speeds), _PIECE):
        piece = spread[:, start : start + _PIECE].toarray()
        table[:, count + start : count + start + piece.shape[1]] = samples.pass_columns(piece)
    # Rows that belong to the same parts are condensed once.
    kinds = np.sum([mask * 2**place for place, mask in enumerate(masks)], axis=0)
    empty, cells = np.zeros((0, width)), {}
    for kind in np.unique(kinds).tolist():
        members = np.flatnonzero(kinds == kind)
        blocks = (table[members[start : start + BLOCK]] for start in range(0, len(members), BLOCK))
        cells[kind] = extend_triangle(empty, blocks)
    sketches = []
    for place in range(len(masks)):
        inside = [cell for kind, cell in cells.items() if kind >> place & 1]
        triangle = extend_triangle(empty, [np.vstack(inside)])
        # Torque (K,) and columns (K, J) less their parts in those beside friction.
        beside, rows_left = triangle[:count, :count], triangle[:, count:].copy()
        lengths = np.linalg.norm(beside, axis=0)
        left, singular, _ = np.linalg.svd(beside / np.where(lengths > 0.0, lengths, 1.0))
        basis = left[:, singular > _DEPENDENT * singular.max(initial=0.0)]
        rows_left[:count] -= basis @ (basis.T @ rows_left[:count])
        left_over = rows_left[count if basis.shape[1] == count else 0 :]
        points = joint_fit.FrictionSamples(
            joint=samples.joint,
            time=np.zeros(len(speeds)),
            velocity=speeds,
            torque=np.zeros(len(speeds)),
            extra=np.zeros((len(speeds), 0)),
            reduce=partial(np.matmul, np.ascontiguousarray(left_over[:, :-1])),
        )
        sketches.append((points, left_over[:, -1]))
    return tuple(sketches)


def _write_verdict(
    chosen: _Score, best: _Score, baseline: _Score | None, *, among: bool, held: int, unit: str
) -> str:
    """Return why the law was taken; `among`: a law that is not identifiable predicted better."""

    def rms(score: _Score) -> float:
        return float(np.sqrt(score.total / held))

    if chosen.refused:
        return f"No law is identifiable from these logs; {chosen.law.name}, the simplest, is given in part."
    head = "Of the identifiable laws, " if among else ""
    text = f"{head}{best.law.name} predicts held-out data best, with "
    if chosen is best:
        text += f"{rms(chosen):.3g} {unit} RMS error"
    else:
        text += (
            f"{rms(best):.4g} {unit} RMS error. {chosen.law.name} was chosen: {rms(chosen):.4g} {unit} with "
            f"{chosen.unknowns} unknowns instead of {best.unknowns}, no worse within one standard error"
        )
    if baseline is not None and baseline is not chosen:
        squared = 100.0 * (1.0 - chosen.total / baseline.total)
        plain = 100.0 * (1.0 - rms(chosen) / rms(baseline))
        change = "less" if squared >= 0.0 else "more"
        text += (
            f"; compared with {baseline.law.name} {abs(plain):.3g} % {change} RMS error "
            f"({abs(squared):.3g} % {change} squared error)"
        )
    return f"{text}."
