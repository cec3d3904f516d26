"""Joint friction as a plant sees it: a straight line per direction of motion, a band at standstill.

Input: a library, which knows how friction parameters act on coordinates, and the values of its card.
Output: `FrictionLines`.

    dq > 0: tau_f = viscous_p dq + level_p;  dq < 0: tau_f = viscous_n dq + level_n
    dq = 0: any tau_f within [level_n, level_p] that holds the joint

Supported: none, viscous and Coulomb, with offset, asymmetric, of joints and of those that follow them.
Not supported: Stribeck, pre-sliding, friction of a drive that turns with several coordinates.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.functions import ModelCard, ParameterCard
from symid.codegen.library import Library
from symid.errors import Notice, UsageError

__all__ = ["FrictionLines", "find_friction_lines", "find_values"]

_SPEEDS = (1.0, 2.0, -1.0, -2.0)
_ROUNDING = 1e-12
"""Torques below this share of the largest are what rounding leaves of zero."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionLines:
    """The lines of all coordinates; rows: [standstill, positive, negative], so that mode -1 is the last.

    Args:
        viscous: (3, n) N m s/rad or N s/m. level: (3, n) N m or N; the first row of both is zero.
    """

    viscous: FloatArray
    level: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("viscous", "level"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def find_values(parameters: tuple[ParameterCard, ...], robot: str) -> FloatArray:
    """Return the values of parameters, (p,).

    Raises:
        UsageError: the robot file does not state all of them.
    """
    unknown = [parameter.name for parameter in parameters if parameter.value is None]
    if unknown:
        text = (
            f"robot {robot!r} cannot be simulated: its file states no value for {', '.join(unknown)}; "
            "give mass, centre of mass, inertia and friction of every link"
        )
        raise UsageError(Notice(code="usage.unknown-values", text=text))
    return np.array([parameter.value for parameter in parameters], dtype=np.float64)


def _find_columns(library: Library, values: FloatArray) -> FloatArray:
    """Return torque (n moved, 4 speeds, n felt, p) of each parameter, one coordinate moved at a time."""
    size = library.card.size
    dq = np.einsum("k,ij->ikj", np.array(_SPEEDS), np.eye(size)).reshape(-1, size)
    (columns,) = library.evaluate("friction_regressor", dq)
    return columns.reshape(size, len(_SPEEDS), size, -1) * values


def _find_shared(columns: FloatArray, rest: FloatArray) -> FloatArray:
    """Return which parameters (p,) make friction at a coordinate that depends on the speed of another.

    Drives that turn with several joints each do; terms in proportion to the speed may cancel between them.
    """
    least = _ROUNDING * np.abs(columns).max()
    once, twice, once_back, twice_back = columns.swapaxes(0, 1)
    ahead, back = twice - once, once_back - twice_back
    linear, bend = 0.5 * (ahead + back), 0.5 * (ahead - back)
    steps = (bend, 2.0 * once - twice - rest, 2.0 * once_back - twice_back - rest)
    others = ~np.eye(len(columns), dtype=bool)
    uncancelled = np.abs(linear.sum(axis=2)) * others > least
    felt = np.concatenate([linear[uncancelled], *(part[others] for part in steps)])
    shared: FloatArray = np.any(np.abs(felt) > least, axis=0)
    return shared


def _check_own(card: ModelCard, columns: FloatArray, rest: FloatArray) -> None:
    """Refuse friction at a coordinate that depends on the speed of another.

    Raises:
        UsageError: which parameters do that.
    """
    shared = _find_shared(columns, rest)
    names = [parameter.name for parameter, found in zip(card.friction, shared, strict=True) if found]
    if names:
        text = (
            f"robot {card.robot!r} has a drive that turns with several joints, whose friction "
            f"({', '.join(names)}) brakes one by the speed of another; simulation cannot make such joints "
            "stick: leave that friction out of the robot file"
        )
        raise UsageError(Notice(code="usage.shared-friction", text=text))


def find_friction_lines(library: Library) -> FrictionLines:
    """Return the friction lines of the library's coordinates, read from its friction regressor.

    Raises:
        UsageError: values are missing, or friction would push: level_p < level_n, or a negative slope;
            friction at a coordinate depends on the speed of another.
    """
    card = library.card
    viscous, level = np.zeros((3, card.size)), np.zeros((3, card.size))
    if not card.friction:
        return FrictionLines(viscous=viscous, level=level)
    values = find_values(card.friction, card.robot)
    columns = _find_columns(library, values)
    (rest,) = library.evaluate("friction_regressor", np.zeros((1, card.size)))
    _check_own(card, columns, rest[0] * values)
    own = np.arange(card.size)
    at = columns[own, :, own]
    # Parameter by parameter: one and two times a column are exact, sums of parameters need not be.
    for row, near, far, step in ((1, 0, 1, 1.0), (2, 2, 3, -1.0)):
        viscous[row] = step * (at[:, far] - at[:, near]).sum(axis=1)
        level[row] = (2.0 * at[:, near] - at[:, far]).sum(axis=1)
    _check_signs(card, viscous, level)
    return FrictionLines(viscous=viscous, level=level)


def _check_signs(card: ModelCard, viscous: FloatArray, level: FloatArray) -> None:
    slack = _ROUNDING * max(float(np.abs(viscous).max()), float(np.abs(level).max()))
    pushes = (level[1] < level[2] - slack) | np.any(viscous < -slack, axis=0)
    notices = [
        Notice(
            code="usage.negative-friction",
            text=f"joint {joint.name!r}: friction must oppose motion; its values must not be negative",
        )
        for joint, found in zip(card.joints, pushes.tolist(), strict=True)
        if found
    ]
    if notices:
        raise UsageError(*notices)
