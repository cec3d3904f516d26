"""Joint friction as a plant sees it: a line per direction of motion, straight or curved; a band at rest.

Input: a library, which knows how friction parameters act on coordinates, and the values of its card.
Output: `FrictionLines`.

    dq > 0: tau_f = viscous_p dq + level_p;  dq < 0: tau_f = viscous_n dq + level_n
    dq = 0: any tau_f within [level_n, level_p] that holds the joint
    curved: tau_f(dq) itself; level_p, level_n are its limits at standstill, viscous is zero

While a step looks for the instant at which a joint stops, a curve is continued beyond standstill by its own
mirror image about (0, level), so that the step is as smooth as on one side. A curved law that is continuous
at standstill (smoothed, Makkar, the improved one) has an empty band: such a joint creeps, and never sticks.

Friction opposes motion, but for a constant torque, which does no work over a way and back, where its least
value ahead is not below its largest one back. Lines show that by signs; curves are looked at over speeds.

Supported: all models of robot files, of joints and of those that follow them.
Not supported: pre-sliding, friction of a drive that turns with several coordinates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.codegen.functions import JointCard, ModelCard, ParameterCard
from symid.codegen.library import Library
from symid.errors import Notice, UsageError
from symid.joint.friction import FRICTION_MODELS

__all__ = ["FrictionLines", "check_speeds", "find_curves", "find_friction_lines", "find_values"]

_SPEEDS = (1.0, 2.0, -1.0, -2.0)
_STANDSTILL = 1e-300
"""A speed at which every law has its limit at standstill, powers of the speed included."""
_PROBES = (_STANDSTILL, 1e-4, 1e-2, 1.0)
_FASTEST, _SLOWEST, _SPEED_COUNT = 1e6, 1e-9, 1501
"""The speeds at which a curve is looked at: a hundred a decade, less for a joint that is never so fast."""
_ROUNDING = 1e-12
"""Torques below this share of the largest are what rounding leaves of zero."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionLines:
    """The lines of all coordinates; rows: [standstill, positive, negative], so that mode -1 is the last.

    Args:
        viscous: (3, n) N m s/rad or N s/m. level: (3, n) N m or N; the first row of both is zero.
        curved: (n,) which coordinates have a curve.
        curve: friction (n,) at velocities (n,); None where no coordinate is curved.
    """

    viscous: FloatArray
    level: FloatArray
    curved: NDArray[np.bool_]
    curve: Callable[[FloatArray], FloatArray] | None = None

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("viscous", "level"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    def find_drag(self, modes: Sequence[int], dq: FloatArray) -> FloatArray:
        """Return what sliding adds to the level of each mode, (n,) N m or N; zero at standstill."""
        rows, columns = np.array(modes), np.arange(len(modes))
        drag: FloatArray = self.viscous[rows, columns] * dq
        if self.curve is None:
            return drag
        ahead = self.curve(rows * np.abs(dq)) - self.level[rows, columns]
        side = np.where(rows * dq >= 0.0, 1.0, -1.0)
        moving = self.curved & (rows != 0) & (dq != 0.0)
        return np.where(moving, side * ahead, drag)


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


def _find_columns(library: Library, values: FloatArray, speeds: Sequence[float]) -> FloatArray:
    """Return torque (n moved, speeds, n felt, p) of each parameter, one coordinate moved at a time."""
    size = library.card.size
    dq = np.einsum("k,ij->ikj", np.array(speeds), np.eye(size)).reshape(-1, size)
    (columns,) = library.evaluate("friction_regressor", dq)
    return columns.reshape(size, len(speeds), size, -1) * values


def _find_shared(columns: FloatArray, rest: FloatArray) -> NDArray[np.bool_]:
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
    shared: NDArray[np.bool_] = np.any(np.abs(felt) > least, axis=0)
    return shared


def _check_own(card: ModelCard, columns: FloatArray, rest: FloatArray) -> None:
    """Refuse friction at a coordinate that depends on the speed of another.

    Raises:
        UsageError: which parameters do that.
    """
    _refuse_shared(card, _find_shared(columns, rest))


def _refuse_shared(card: ModelCard, shared: NDArray[np.bool_]) -> None:
    names = [parameter.name for parameter, found in zip(card.friction, shared, strict=True) if found]
    if names:
        text = (
            f"robot {card.robot!r} has a drive that turns with several joints, whose friction "
            f"({', '.join(names)}) brakes one by the speed of another; simulation cannot make such joints "
            "stick: leave that friction out of the robot file"
        )
        raise UsageError(Notice(code="usage.shared-friction", text=text))


def find_friction_lines(library: Library, speeds: FloatArray | None = None) -> FrictionLines:
    """Return the friction lines of the library's coordinates, read from its friction regressor.

    Args:
        library: the functions of the robot.
        speeds: (n,) rad/s or m/s, the largest that a curve is looked at; None or infinite for any.

    Raises:
        UsageError: values are missing, or friction would push: level_p < level_n, a negative slope, a curve
            that crosses zero; friction at a coordinate depends on the speed of another.
    """
    card = library.card
    viscous, level = np.zeros((3, card.size)), np.zeros((3, card.size))
    if not card.friction:
        return FrictionLines(viscous=viscous, level=level, curved=np.zeros(card.size, dtype=bool))
    values = find_values(card.friction, card.robot)
    columns = _find_columns(library, values, _SPEEDS)
    (rest,) = library.evaluate("friction_regressor", np.zeros((1, card.size)))
    _check_own(card, columns, rest[0] * values)
    own = np.arange(card.size)
    at = columns[own, :, own]
    # Parameter by parameter: one and two times a column are exact, sums of parameters need not be.
    for row, near, far, step in ((1, 0, 1, 1.0), (2, 2, 3, -1.0)):
        viscous[row] = step * (at[:, far] - at[:, near]).sum(axis=1)
        level[row] = (2.0 * at[:, near] - at[:, far]).sum(axis=1)
    curved = _find_curved(library)
    if not curved.any():
        _check_signs(card, viscous, level)
        return FrictionLines(viscous=viscous, level=level, curved=curved)
    start = _find_columns(library, values, (_STANDSTILL, -_STANDSTILL))
    moved = np.any(start != rest[0] * values, axis=1)
    _refuse_shared(card, np.any(moved[~np.eye(card.size, dtype=bool)], axis=0))
    viscous[:, curved] = 0.0
    for row, place in ((1, 0), (2, 1)):
        level[row, curved] = start[own, place, own].sum(axis=1)[curved]
    _check_signs(card, viscous * ~curved, level * ~curved)
    friction = library.bind("friction")

    def find_curve(dq: FloatArray) -> FloatArray:
        return friction(dq, values)[0].copy()

    lines = FrictionLines(viscous=viscous, level=level, curved=curved, curve=find_curve)
    fastest = np.full(card.size, np.inf) if speeds is None else speeds
    _check_curves(lines, card.joints, fastest, fastest)
    return lines


def find_curves(library: Library, speeds: FloatArray) -> FrictionLines | None:
    """Return the friction lines of motors, None where no friction is curved; speeds (n,) as above.

    Raises:
        UsageError: a curve would push, or depends on the speed of another motor.
    """
    known = library.card.friction and _find_curved(library).any()
    return find_friction_lines(library, speeds) if known else None


def check_speeds(lines: FrictionLines, joints: Sequence[JointCard], dq: FloatArray) -> None:
    """Refuse friction that drove a joint at velocities dq (N, n), rad/s or m/s.

    Raises:
        UsageError: which joints, and from what speed on.
    """
    _check_curves(lines, joints, np.maximum(-dq.min(axis=0), 0.0), np.maximum(dq.max(axis=0), 0.0))


def _check_curves(
    lines: FrictionLines, joints: Sequence[JointCard], back: FloatArray, ahead: FloatArray
) -> None:
    """Refuse curves that drive a joint at speeds up to `back` (n,) and `ahead` (n,), rad/s or m/s, positive.

    Raises:
        UsageError: which joints, and from what speed on.
    """
    notices = []
    for number in np.flatnonzero(lines.curved).tolist():
        speed = _find_push(lines, number, float(back[number]), float(ahead[number]))
        if speed is not None:
            joint = joints[number]
            start = (
                f"from about {speed:.2g} {joint.position_unit}/s on"
                if speed > _SLOWEST
                else "as motion begins"
            )
            text = (
                f"joint {joint.name!r}: friction must oppose motion, but it drives the joint {start}; "
                "correct its values, or keep the joint slower and state that as its velocity limit"
            )
            notices.append(Notice(code="usage.negative-friction", text=text))
    if notices:
        raise UsageError(*notices)


def _find_push(lines: FrictionLines, joint: int, back: float, ahead: float) -> float | None:
    """Return the least speed from which a coordinate's friction pushes, None if it never does."""
    if lines.curve is None:
        return None
    grid = np.geomspace(_SLOWEST, min(max(back, ahead, _SLOWEST), _FASTEST), _SPEED_COUNT)
    least, largest = lines.level[1, joint], lines.level[2, joint]
    dq = np.zeros(lines.curved.size)
    for speed in grid.tolist():
        for side, limit in ((1.0, ahead), (-1.0, back)):
            if speed <= limit:
                dq[joint] = side * speed
                torque = float(lines.curve(dq)[joint])
                least, largest = (
                    (min(least, torque), largest) if side > 0.0 else (least, max(largest, torque))
                )
        if least < largest - _ROUNDING * max(abs(least), abs(largest)):
            return float(speed)
    return None


def _find_curved(library: Library) -> NDArray[np.bool_]:
    """Return which coordinates (n,) feel friction whose column is curved."""
    card = library.card
    names = tuple(name for model in FRICTION_MODELS.values() for name in model.own if name != "Fc")
    bent = [bool(names) and parameter.name.startswith(names) for parameter in card.friction]
    if not any(bent):
        return np.zeros(card.size, dtype=bool)
    columns = _find_columns(library, np.array(bent, dtype=np.float64), _PROBES)
    felt: NDArray[np.bool_] = np.any(columns != 0.0, axis=(0, 1, 3))
    return felt


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
