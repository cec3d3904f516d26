"""The direction of gravity that a log shows, in the base frame: is the robot mounted as its file says?

Robot, samples -> `GravityEstimate`. With the weight columns W_k of `dynamics` and the direction u of gravity,

    tau = (S + |g| sum_k u_k W_k) pi + F f,    S the columns of all standard parameters pi without gravity,

is linear in pi and f. They are fitted for every u, which follows by steps of Gauss and Newton (variable
projection, Kaufman 1975) from the file's direction and from all six axes. A joint is weighted by the inverse
of what is left of it. Unknowns have expected sizes: a parameter makes a hundred times the measured torque,
gravity is turned by a radian. So what the log does not show stays at zero, parameters as well as turns.

Of the ends of these searches the likeliest is taken, the range of directions around it counted in (Laplace's
approximation): planar arms hardly show whether gravity leaves their plane, and never to which side.

Supported: all joints, drives and springs; files without gravity, where it has 9.81 m/s^2.
Not supported: known payloads, whose torques were subtracted with the file's gravity.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid import dynamics
from symid.arrays import FloatArray
from symid.identification import judge
from symid.identification.judge import numerics
from symid.identification.regression import ThinMotion
from symid.notation import INERTIAL
from symid.robot import ZERO, Robot

_HALVINGS = 4
"""Of a step, tried until it helps."""
_ROUNDING = 1e-6
"""Of a joint's squares: no joint counts as explained better."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GravityEstimate:
    """The direction of gravity that explains a log best.

    `direction` (3,) is gravity in the base frame in m/s^2, of the length that the file states, `turn` (rad)
    away from the file's, 0 where it states none; `deviation` (rad) of what the log shows, by the jackknife
    over stretches, and `difference` from the file's. `left` and `left_before` (n,) are the squares of torque
    that are left with it, and with the file's; `tau` (T, n) the torques as they would be under the file's
    gravity: those of a stretch changed by the parameters of the others.
    """

    direction: FloatArray
    turn: float
    deviation: float
    difference: judge.Difference
    left: FloatArray
    left_before: FloatArray
    tau: FloatArray


class _Fit(NamedTuple):
    """At a direction (3,): unknowns (p,), squares that are left (n,), and the loss, which is to be least."""

    direction: FloatArray
    values: FloatArray
    left: FloatArray
    loss: float


class _Model(NamedTuple):
    """Sums (n, P + 1, P + 1) of products of all columns and the torque, `counts` (n,) of their rows.

    Unknowns x (p,) have the coefficients (P,) lift[0] x + sum_k u_k lift[1 + k] x, with lift (4, P, p);
    `before` (3,) is the file's direction.
    """

    sums: FloatArray
    counts: NDArray[np.intp]
    lift: FloatArray
    before: FloatArray

    @property
    def size(self) -> FloatArray:
        """Return the squares (n,) of the torque."""
        return self.sums[:, -1, -1]

    def weigh(self, left: FloatArray) -> FloatArray:
        """Return the weights (n,) of joints of which squares (n,) are left."""
        none = np.zeros(len(left))
        return np.divide(self.counts, left + _ROUNDING * self.size, out=none, where=self.size > 0.0)

    def build_equations(
        self, direction: FloatArray, weights: FloatArray, *more: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the columns of the unknowns, with `more` behind them, and their normal equations."""
        design = np.column_stack([np.tensordot((1.0, *direction), self.lift, 1), *more])
        whole = np.tensordot(weights, self.sums, 1)
        square = design.T @ whole[:-1, :-1] @ design + np.eye(design.shape[1])
        return design, square, design.T @ whole[:-1, -1]

    def fit(self, direction: FloatArray, weights: FloatArray) -> _Fit:
        """Return the fit at a direction."""
        design, square, right = self.build_equations(direction, weights)
        values = np.asarray(np.linalg.solve(square, right))
        errors = np.append(design @ values, -1.0)
        left: FloatArray = np.maximum(self.sums @ errors @ errors, 0.0)
        there = self.size > 0.0
        loss = float(self.counts[there] @ np.log(left[there] / self.size[there] + _ROUNDING))
        loss += float(values @ values + np.sum((direction - self.before) ** 2))
        return _Fit(direction, values, left, loss)

    def turn(self, fit: _Fit, weights: FloatArray) -> tuple[FloatArray, float]:
        """Return the direction after a step, and log det of the information on its two angles."""
        across = np.linalg.svd(fit.direction[None])[2][1:].T
        slopes = (self.lift[1:] @ fit.values).T @ across
        _, square, right = self.build_equations(fit.direction, weights, slopes)
        right[-2:] += across.T @ self.before
        found = np.linalg.solve(square, np.column_stack([right, np.eye(len(right))[:, -2:]]))[-2:]
        moved = fit.direction + across @ found[:, 0]
        return moved / np.linalg.norm(moved), -float(np.linalg.slogdet(found[:, 1:])[1])

    def search(self, start: FloatArray) -> tuple[float, _Fit]:
        """Return the fit where steps from `start` end, behind its loss and the information together."""
        best = self.fit(start, self.weigh(self.size))
        for _ in range(numerics.ROUNDS):
            weights = self.weigh(best.left)
            end, information = self.turn(best, weights)
            moved = (best.direction + share * (end - best.direction) for share in 0.5 ** np.arange(_HALVINGS))
            trials = (self.fit(place / np.linalg.norm(place), weights) for place in moved)
            better = next((trial for trial in trials if trial.loss < best.loss), best)
            step = np.linalg.norm(better.direction - best.direction)
            best = better
            if step < numerics.CONVERGED:
                break
        return best.loss + information, best


def _build_columns(
    robot: Robot, size: float, motion: ThinMotion, friction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the columns (T, n, P) S, |g| W_k and F, and how unknowns enter their coefficients, (4, P, p)."""
    keys = [(link, name) for link in range(robot.size) for name in INERTIAL]
    weighed = [place for place, (_, name) in enumerate(keys) if name in dynamics.WEIGHED]
    keys += dynamics.list_drive_parameters(robot)
    bare = replace(robot, gravity=(ZERO,) * 3)
    inertial = dynamics.evaluate_torque_regressor(bare, keys, motion.q, motion.dq, motion.ddq)
    weights = size * dynamics.evaluate_weight_columns(robot, motion.q)
    columns = np.concatenate([inertial, *weights, friction], axis=2)
    first, count, others = len(keys), len(weighed), friction.shape[2]
    lift = np.zeros((4, columns.shape[2], first + others))
    lift[0, :first, :first] = np.eye(first)
    lift[0, first + 3 * count :, first:] = np.eye(others)
    for axis in range(3):
        lift[1 + axis, first + axis * count + np.arange(count), weighed] = 1.0
    return columns, lift


def find_gravity(
    robot: Robot, motion: ThinMotion, stretch: NDArray[np.intp], friction: FloatArray
) -> GravityEstimate:
    """Return the direction of gravity that explains the samples (T,) of a motion best.

    `stretch` (T,) number of every sample's stretch, of two or more; `friction` (T, n, f) columns of friction.
    """
    gravity = np.array([value.to_float(dict(robot.symbols)) for value in robot.gravity])
    size = float(np.linalg.norm(gravity)) or 9.81
    columns, lift = _build_columns(robot, size, motion, friction)
    rows = np.concatenate([columns, motion.tau[:, :, None]], axis=2) * motion.kept[:, :, None]
    parts = (np.swapaxes(rows[stretch == place], 0, 1) for place in range(int(stretch.max()) + 1))
    sums = np.stack([np.swapaxes(part, 1, 2) @ part for part in parts])
    model = _Model(sums.sum(axis=0), motion.kept.sum(axis=0), lift, gravity / size)
    # A unit of every unknown makes a hundred times the measured torque, all directions of gravity together.
    squares = np.diagonal(np.tensordot(model.weigh(model.size), model.sums, 1))
    made = np.einsum("kij,i->j", lift**2, squares[:-1])
    model = model._replace(lift=lift * 100.0 * np.sqrt(squares[-1] / np.where(made > 0.0, made, np.inf)))

    starts = np.unique(np.vstack([model.before, np.eye(3), -np.eye(3)]) + 0.0, axis=0)
    best = min((model.search(start) for start in starts if start.any()), key=lambda found: found[0])[1]
    weights = model.weigh(best.left)
    others = [model._replace(sums=model.sums - own) for own in sums]
    folds = [rest.fit(best.direction, weights) for rest in others]
    ends = [rest.turn(fold, weights)[0] for rest, fold in zip(others, folds, strict=True)]
    back = np.tensordot(model.before - best.direction, model.lift[1:], 1)
    change = np.array([back @ fold.values for fold in folds])
    across, along = np.linalg.norm(np.cross(model.before, best.direction)), model.before @ best.direction
    before = model.fit(model.before, model.weigh(model.size))
    changes = judge.compute_changes(np.array(ends))
    (difference,) = judge.agree(best.direction - model.before, changes, np.eye(3)[None], np.ones(1))
    return GravityEstimate(
        direction=size * best.direction,
        turn=float(np.arctan2(across, along)),
        deviation=float(np.linalg.norm(changes)),
        difference=difference,
        left=best.left,
        left_before=model.fit(model.before, model.weigh(before.left)).left,
        tau=motion.tau + np.einsum("tjp,tp->tj", columns, change[stretch]),
    )
