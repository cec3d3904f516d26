"""Dynamics, friction and springs of any kind at once, by Gauss and Newton from a fit that has both.

    motor   IA lambda (dtheta~ - F[dtheta~]) + F[Yf] f = F[tau] - F[tau_J(s)]      each over its scatter
    link    {lambda (Yp~ - F[Yp~]) - F[YL]} beta = F[tau_J(s)] - drag

The dynamics are linear and are eliminated: numbers s of springs minimise what is orthogonal to their columns
(variable projection, Golub and Pereyra 1973, in the form of Kaufman 1975), relative to where they begin. Both
equations together tell rotors from links as far as the springs can be trusted.

Supported: all numbers of springs that data decide; zeros of encoders that are off by little; rigid joints
beside elastic ones; known dynamics; motors near rest, whose equations do not count.
Not supported: numbers of stops and knees other than those at the start.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.errors import RobotError
from symid.identification.elastic.estimate import MethodFit, build_method_fit
from symid.identification.elastic.regression import ElasticProblem, compute_joint_torque, solve_with_signs
from symid.identification.elastic.uncertainty import (
    compute_covariance,
    list_spring_numbers,
    move_spring,
)
from symid.identification.hysteresis import filter_smooth
from symid.joint_models import Elasticity

_FLOOR = 1e-9
_ROUNDS, _EVALUATIONS = 3, 4
_STEP, _SAME = 1e-4, 1e-3
_LEAST, _MOST = 0.2, 5.0
"""Of a spring's numbers where they begin: how far they may go."""


class LinearRows(NamedTuple):
    """design @ chi = right, with the time of each row from 0 to 1 within its recording."""

    design: FloatArray
    right: FloatArray
    time: FloatArray


def list_row_times(problem: ElasticProblem, number: int) -> FloatArray:
    """Return the times (M,) of the filtered rows of recording `number`, from 0 to 1."""
    count = len(problem.signals[number].time)
    return np.arange(count)[problem.filtered[number].keep] / count


def filter_spring(problem: ElasticProblem, spring: Elasticity, joint: int) -> list[FloatArray]:
    """Return F[tau_J] (M,) of a spring at the filtered rows of every recording, N m or N."""
    return [
        filter_smooth(compute_joint_torque(spring, part, joint), problem.options.rate, part.period)[rows.keep]
        for part, rows in zip(problem.signals, problem.filtered, strict=True)
    ]


def compute_spring_torques(problem: ElasticProblem, fit: MethodFit) -> list[FloatArray]:
    """Return F[tau_J] (M, n) of the springs of `fit` at the filtered rows of every recording.

    That of a rigid joint is by the links.
    """
    joints = [filter_spring(problem, spring, joint) for joint, spring in enumerate(fit.elasticity)]
    return [
        np.where(problem.gives, np.column_stack(torques), rows.compute_link_side(fit.chi))
        for torques, rows in zip(zip(*joints, strict=True), problem.filtered, strict=True)
    ]


class _Sides(NamedTuple):
    """Both equations of one recording, motor before link: (M, 2, n, p + n + pf), (M, 2, n).

    `pulls` is what a spring's torque gives to the right sides, 0 where a row does not count.
    """

    design: FloatArray
    right: FloatArray
    pulls: FloatArray

    def weigh(self, scatter: FloatArray) -> "_Sides":
        """Return the equations over the scatter (2, n) of each."""
        return _Sides(self.design / scatter[..., None], self.right / scatter, self.pulls / scatter)

    def free(self, values: FloatArray) -> FloatArray:
        """Return right sides (M, 2, n, ...) without what a constant torque of each spring may give them."""
        pulls = self.pulls.reshape(*self.pulls.shape, *[1] * (values.ndim - 3))
        squares = np.sum(pulls**2, axis=(0, 1))
        shares = np.sum(pulls * values, axis=(0, 1)) / np.where(squares > 0.0, squares, 1.0)
        return np.asarray(values - pulls * shares)


def _build_sides(problem: ElasticProblem, fit: MethodFit) -> list[_Sides]:
    """Return motor and link equations with the springs' torques, each over its scatter about `fit`.

    Motors that are not trusted to slide have empty rows, and so have the links of rigid joints.
    """
    slides, start, gives, sides = problem.slides, 0, np.array(problem.gives), []
    for rows, spring in zip(problem.filtered, compute_spring_torques(problem, fit), strict=True):
        motor, link = rows.design.copy(), rows.design.copy()
        # The rows of a rigid joint's motor are those of both sides.
        motor[:, gives, : rows.bases], link[:, :, rows.bases :] = 0.0, 0.0
        kept = np.stack([slides[start : start + len(spring)], np.broadcast_to(gives, spring.shape)], axis=1)
        start += len(spring)
        passed = np.where(gives, spring, rows.drag)
        right = np.stack([rows.torque - passed, spring - rows.drag], axis=1)
        entry = _Sides(
            design=np.where(kept[..., None], np.stack([motor, link], axis=1), 0.0),
            right=np.where(kept, right, 0.0),
            pulls=np.where(kept & gives, np.array([[-1.0], [1.0]]), 0.0),
        )
        squares = np.sum((entry.right - entry.design @ fit.chi) ** 2, axis=0)
        floor = _FLOOR * max(float(np.sqrt(np.mean(rows.torque**2))), 1e-300)
        sides.append(entry.weigh(np.maximum(np.sqrt(squares / np.maximum(np.sum(kept, axis=0), 1)), floor)))
    return sides


def build_side_rows(problem: ElasticProblem, fit: MethodFit, *, zeros: bool = False) -> LinearRows:
    """Return motor and link equations with the torques of the springs of `fit`, each over its scatter.

    `zeros`: whether those of the encoders may be off, so that springs have an offset in every recording.
    """
    sides, size = _build_sides(problem, fit), problem.sizes[1]
    times = [np.repeat(list_row_times(problem, number), 2 * size) for number in range(len(sides))]
    return LinearRows(*_stack(sides, zeros=zeros), np.concatenate(times))


def _stack(sides: Sequence[_Sides], *, zeros: bool) -> tuple[FloatArray, FloatArray]:
    """Return design (M, p + n + pf) and right sides (M,) of all recordings; `zeros` as above."""
    parts = [(entry.design, entry.right) for entry in sides]
    if zeros:
        parts = [(entry.free(entry.design), entry.free(entry.right)) for entry in sides]
    designs, rights = zip(*parts, strict=True)
    design = np.concatenate([entry.reshape(-1, entry.shape[-1]) for entry in designs])
    return design, np.concatenate([entry.reshape(-1) for entry in rights])


def calm_torsions(wide: ElasticProblem, narrow: ElasticProblem, fit: MethodFit) -> ElasticProblem:
    """Return the problem `wide` with the torsions of `narrow` where springs explain links better with these.

    Noise that turns a torsion back moves springs with memory and no sharp thresholds a little every time;
    a cut-off that takes it away bends fast motion. `fit` has the springs, `narrow` the same recordings.
    """
    calmer = _measure_left(narrow, fit) < _measure_left(wide, fit)
    signals = []
    for part, other, better in zip(wide.signals, narrow.signals, calmer, strict=True):
        # A lower cut-off cuts more of the end.
        count = min(len(part.time), len(other.time))
        error = part.phi - (part.theta - part.q)
        error[:count] += np.where(better, other.phi[:count] - part.phi[:count], 0.0)
        signals.append(replace(part, error=error))
    return replace(wide, signals=tuple(signals))


def _measure_left(problem: ElasticProblem, fit: MethodFit) -> FloatArray:
    """Return the scatter (r, n) that springs leave of the links' torque in every recording, N m or N."""
    pairs = zip(compute_spring_torques(problem, fit), problem.filtered, strict=True)
    return np.array([np.std(torque - rows.compute_link_side(fit.chi), axis=0) for torque, rows in pairs])


def fit_simultaneous(wide: ElasticProblem, narrow: ElasticProblem, start: MethodFit) -> MethodFit:
    """Return dynamics and springs that explain both equations best, and the covariance of the dynamics.

    `start` has springs of the kinds wanted, and dynamics near the answer; for the problems see
    `calm_torsions`.
    """
    fit, problem = start, wide
    for _ in range(_ROUNDS):
        problem = calm_torsions(wide, narrow, fit)
        fit, moved = _improve(problem, fit)
        if moved < _SAME:
            break
    found = build_method_fit("simultaneous", fit.chi, wide.sizes, fit.elasticity)
    return replace(found, covariance=_measure_covariance(problem, found), notices=start.notices)


class _Number(NamedTuple):
    """A number of the spring of a joint: its place, and what it begins with."""

    joint: int
    place: tuple[str, int, str]
    value: float


def _list_numbers(springs: Sequence[Elasticity], gives: Sequence[bool]) -> list[_Number]:
    """Return what of the springs is moved."""
    return [
        _Number(joint, number.place, number.value)
        for joint, spring in enumerate(springs)
        if gives[joint]
        for number in list_spring_numbers(spring)
    ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Springs:
    """Right sides of all equations as the springs of `start` change by factors (k,) of their numbers.

    `begun` are their torques, F[tau_J], joint by joint and recording by recording.
    """

    problem: ElasticProblem
    start: tuple[Elasticity, ...]
    sides: Sequence[_Sides]
    numbers: Sequence[_Number]
    right: FloatArray
    begun: Sequence[Sequence[FloatArray]]

    def build(self, factors: FloatArray) -> tuple[Elasticity, ...]:
        springs = list(self.start)
        for number, factor in zip(self.numbers, factors.tolist(), strict=True):
            # At the edge of what springs can be, a number stays.
            with suppress(RobotError):
                springs[number.joint] = move_spring(
                    springs[number.joint], number.place, number.value * factor
                )
        return tuple(springs)

    def _change(self, joint: int, spring: Elasticity, before: Sequence[FloatArray]) -> FloatArray:
        """Return what another spring than that of `before` changes of the right sides."""
        parts = []
        for side, old, new in zip(
            self.sides, before, filter_spring(self.problem, spring, joint), strict=True
        ):
            moved = np.zeros_like(side.right)
            moved[:, :, joint] = side.pulls[:, :, joint] * (new - old)[:, None]
            parts.append(side.free(moved).reshape(-1))
        return np.concatenate(parts)

    def move(self, factors: FloatArray) -> FloatArray:
        """Return the right sides (M,)."""
        right = self.right
        for joint, spring in enumerate(self.build(factors)):
            if spring != self.start[joint]:
                right = right + self._change(joint, spring, self.begun[joint])
        return right

    def differentiate(self, factors: FloatArray) -> FloatArray:
        """Return their derivatives (M, k) by the factors."""
        springs, columns = self.build(factors), []
        before = [filter_spring(self.problem, spring, joint) for joint, spring in enumerate(springs)]
        for number, factor in zip(self.numbers, factors.tolist(), strict=True):
            column, joint = np.zeros_like(self.right), number.joint
            with suppress(RobotError):
                ahead = move_spring(springs[joint], number.place, number.value * (factor + _STEP))
                column = self._change(joint, ahead, before[joint]) / _STEP
            columns.append(column)
        return np.column_stack(columns)


def _follow_springs(problem: ElasticProblem, fit: MethodFit) -> tuple[FloatArray, _Springs]:
    """Return the design (M, p + n + pf) of both equations, and how springs move their right sides."""
    sides = _build_sides(problem, fit)
    design, right = _stack(sides, zeros=True)
    springs = _Springs(
        problem=problem,
        start=fit.elasticity,
        sides=sides,
        numbers=_list_numbers(fit.elasticity, problem.gives),
        right=right,
        begun=[filter_spring(problem, spring, joint) for joint, spring in enumerate(fit.elasticity)],
    )
    return design, springs


def _improve(problem: ElasticProblem, fit: MethodFit) -> tuple[MethodFit, float]:
    """Return a fit with less error for the scatter of both sides as it is about `fit`, and how far it is.

    The latter is the largest relative change of a number of the springs.
    """
    from scipy.optimize import least_squares

    design, springs = _follow_springs(problem, fit)
    free = np.isnan(problem.known)
    base: FloatArray = np.linalg.qr(design[:, free], mode="reduced")[0]
    given = design[:, ~free] @ problem.known[~free]

    def project(values: FloatArray) -> FloatArray:
        return np.asarray(values - base @ (base.T @ values))

    found = least_squares(
        lambda factors: project(springs.move(factors) - given),
        np.ones(len(springs.numbers)),
        lambda factors: project(springs.differentiate(factors)),
        bounds=(_LEAST, _MOST),
        max_nfev=_EVALUATIONS,
        ftol=_SAME**2,
        xtol=_SAME,
    )
    chi = solve_with_signs(problem.library.card, design, springs.move(found.x), problem.known)
    moved = float(np.max(np.abs(found.x - 1.0), initial=0.0))
    return build_method_fit(fit.method, chi, problem.sizes, springs.build(found.x)), moved


def _measure_covariance(problem: ElasticProblem, fit: MethodFit) -> FloatArray:
    """Return the covariance (p + n + pf, p + n + pf) of the dynamics, whatever the springs are."""
    design, springs = _follow_springs(problem, fit)
    count = len(springs.numbers)
    whole = np.hstack([design, -springs.differentiate(np.ones(count))])
    known = np.concatenate([problem.known, np.full(count, np.nan)])
    dynamics = slice(len(fit.chi))
    return compute_covariance(whole, springs.right - design @ fit.chi, known)[dynamics, dynamics]
