"""The equations of a payload: how base values change where a body is fixed to a link.

Input: a robot, base values with and without the body. Output: `System`, rows of unit variance, its solution.

    beta_loaded - beta_empty = K_link delta + noise,   noise of covariance C_loaded + C_empty.

Supported: base values that are known in part; a mass from a balance as one more row; frames of the file.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import EstimateError, Notice
from symid.notation import INERTIAL
from symid.parameters.base import BaseParameters
from symid.parameters.consistency_inputs import build_grouping
from symid.robot.description import Robot
from symid.robot.inertia import move_parameters

__all__ = [
    "BaseValues",
    "System",
    "build_base_values",
    "build_system",
    "find_whitening",
    "is_told",
    "select_values",
    "solve_system",
]

# A size for lengths, so that numbers of different units can be compared; no result depends on it.
_LENGTH = 0.1
_RANK = 1e-9
_SEEN = 1e-6
_WEIGHED = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BaseValues:
    """Values (p,) of base and friction parameters by name, SI, and their covariance (p, p)."""

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("values", "covariance"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class System:
    """Equations of unit variance for the ten parameters of the body, in the frame of the file.

    Args:
        names: the base parameters, and "mass" where a balance told it.
        rows: (m, 10) in units of `sizes` (10,); target: (m,).
        free: (10, k) what nothing shows, in the same units.
        lacking: whether the robot could show more of it than the values given do.
    """

    names: tuple[str, ...]
    rows: FloatArray
    target: FloatArray
    sizes: FloatArray
    free: FloatArray
    lacking: bool


def build_base_values(
    names: Sequence[str],
    values: Sequence[float],
    deviations: Sequence[float],
    covariance: Sequence[Sequence[float]] = (),
) -> BaseValues:
    """Return values of an estimate; without a covariance its deviations count as independent.

    Args:
        names: p names.
        values: (p,) SI.
        deviations: (p,) standard deviations.
        covariance: (p, p), or nothing.
    """
    known = np.array(covariance, dtype=np.float64) if len(covariance) else np.diag(np.square(deviations))
    return BaseValues(names=tuple(names), values=np.array(values, dtype=np.float64), covariance=known)


def select_values(given: BaseValues, names: Sequence[str]) -> BaseValues:
    """Return the values of some parameters."""
    places = [given.names.index(name) for name in names]
    return BaseValues(
        names=tuple(names), values=given.values[places], covariance=given.covariance[np.ix_(places, places)]
    )


def build_system(
    robot: Robot,
    base: BaseParameters,
    loaded: BaseValues,
    empty: BaseValues,
    *,
    link: int,
    mass: float | None,
) -> System:
    """Return the equations of the payload.

    Args:
        robot: the robot.
        base: its base parameters.
        loaded: base values with the payload.
        empty: base values without it.
        link: index of the joint whose link carries it.
        mass: kg, where it is known.

    Raises:
        EstimateError: the values share no base parameter, or have no deviations.
        RobotError: a symbolic length has no value.
    """
    wanted = [entry.name for entry in base.parameters]
    names = tuple(name for name in wanted if name in loaded.names and name in empty.names)
    if not names:
        text = "the two estimates share no base parameter, so nothing can be said of a payload"
        raise EstimateError(Notice(code="payload.nothing-shared", text=text))
    frame = _find_frame_change(robot, link)
    sizes = np.array([_LENGTH**2] * 6 + [_LENGTH] * 3 + [1.0])
    every = _find_columns(robot, base, wanted, link) @ frame * sizes
    rows = _find_columns(robot, base, names, link) @ frame * sizes
    after, before = select_values(loaded, names), select_values(empty, names)
    change = after.values - before.values
    white = find_whitening(after.covariance + before.covariance)
    matrix, target = white @ rows, white @ change
    if mass is not None:
        weighed = np.zeros((1, 10))
        weighed[0, 9] = 1.0
        every, rows = np.vstack([every, weighed]), np.vstack([rows, weighed])
        matrix = np.vstack([matrix, weighed / (_WEIGHED * mass)])
        target = np.append(target, 1.0 / _WEIGHED)
        names = (*names, "mass")
    free = _find_free(rows)
    return System(
        names=names,
        rows=matrix,
        target=target,
        sizes=sizes,
        free=free,
        lacking=free.shape[1] > _find_free(every).shape[1],
    )


def _find_columns(robot: Robot, base: BaseParameters, names: Sequence[str], link: int) -> FloatArray:
    """Return the columns (m, 10) of K that belong to the parameters of a link."""
    grouping = build_grouping(robot, base, tuple(names))
    return grouping.matrix[:, [grouping.labels.index((link, name)) for name in INERTIAL]]


def _find_frame_change(robot: Robot, link: int) -> FloatArray:
    """Return (10, 10) that takes parameters in the file's frame of a link to those in its link frame."""
    frame, symbols = robot.joints[link].frame, dict(robot.symbols)
    rotation = np.array([[entry.to_float() for entry in row] for row in frame.rotation])
    origin = np.array([entry.to_float(symbols) for entry in frame.translation])
    return np.array([move_parameters(unit, rotation, origin) for unit in np.eye(10).tolist()]).T


def find_whitening(covariance: FloatArray) -> FloatArray:
    """Return W with W C W' = 1.

    Raises:
        EstimateError: a deviation is missing.
    """
    deviations = np.sqrt(np.diag(covariance))
    if not np.all(np.isfinite(covariance)) or not np.all(deviations > 0):
        text = (
            "an estimate has no standard deviations, which say what a change means; identify by a method "
            "that gives them"
        )
        raise EstimateError(Notice(code="payload.no-deviations", text=text))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    # Rounding can make the smallest of them zero.
    kept = np.maximum(values, len(values) * np.finfo(float).eps * values[-1])
    white: FloatArray = (vectors / np.sqrt(kept)).T / deviations
    return white


def _find_free(rows: FloatArray) -> FloatArray:
    """Return an orthonormal basis (10, k) of what the rows do not show."""
    _, values, right = np.linalg.svd(np.vstack([rows, np.zeros((10, 10))]), full_matrices=False)
    return right[values <= _RANK * max(float(values[0]), 1e-300)].T


def solve_system(system: System) -> tuple[FloatArray, FloatArray]:
    """Return the least squares of smallest norm (10,), and its covariance where it is told (10, 10)."""
    _, values, right = np.linalg.svd(system.rows, full_matrices=False)
    rank = 10 - system.free.shape[1]
    factor = system.sizes[:, None] * right[:rank].T / values[:rank]
    found = np.linalg.lstsq(system.rows, system.target, rcond=float(values[rank - 1] / values[0] / 2))[0]
    return found * system.sizes, factor @ factor.T


def is_told(system: System, rates: FloatArray) -> bool:
    """Return whether a quantity with these derivatives (10,) changes with nothing that is free."""
    scaled = rates * system.sizes
    return float(np.linalg.norm(scaled @ system.free)) <= _SEEN * float(np.linalg.norm(scaled))
