"""Stiffness as makers of harmonic drives give it, as knees of an elastic joint.

Input: slope K1 up to torque T1, K2 up to T2, K3 beyond, wave generator blocked. Output: knees.

Supported: three slopes, the same on both sides; K1 is the stiffness that the knees stand beside.
Not supported: the loss at the reversal of torque that catalogues give apart; stops describe it.
"""

from collections.abc import Sequence

from symid.errors import Notice, RobotError
from symid.robot.elasticity import Knee

__all__ = ["find_catalogue_knees", "find_catalogue_mistakes"]


def find_catalogue_mistakes(stiffnesses: Sequence[float], torques: Sequence[float]) -> tuple[str, ...]:
    """Return what is wrong with K1 K2 K3 and T1 T2, in words."""
    mistakes = []
    if not all(value > 0 for value in stiffnesses):
        mistakes.append("K1, K2 and K3 must be positive")
    if not 0 < torques[0] < torques[1]:
        mistakes.append("T1 and T2 must be positive and increase")
    return tuple(mistakes)


def find_catalogue_knees(stiffnesses: Sequence[float], torques: Sequence[float]) -> tuple[Knee, ...]:
    """Return the knees that make a spring K1 one of K2 beyond T1 and K3 beyond T2, on both sides.

    The outer function's argument is K1 phi: the second knee stands where it is T1 + (T2 - T1) K1 / K2.

    Args:
        stiffnesses: K1, K2, K3 in N m/rad.
        torques: T1, T2 in N m.

    Raises:
        RobotError: a value is not positive, or the torques do not increase.
    """
    mistakes = find_catalogue_mistakes(stiffnesses, torques)
    if mistakes:
        raise RobotError(*(Notice(code="robot.invalid-elasticity", text=text) for text in mistakes))
    first, second, third = stiffnesses
    places = (torques[0], torques[0] + (torques[1] - torques[0]) * first / second)
    slopes = ((second - first) / first, (third - second) / first)
    above = [Knee(threshold=place, slope=slope) for place, slope in zip(places, slopes, strict=True) if slope]
    below = [Knee(threshold=-knee.threshold, slope=knee.slope) for knee in reversed(above)]
    return (*below, *above)
