"""The same spring in other words: the scale of the outer function, springs behind dry friction.

Input: numbers as a paper or another model writes them. Output: `Elasticity`, or back.

    scale      (k, s, R) with outer slope a at zero is (a k, s / a, a R) with slope one
    Maxwell    a spring k behind dry friction f is a stop of threshold f / k, stiffness k (Maxwell-slip, Iwan)

Supported: outer functions with any positive slope at zero; elements with positive stiffness and force.
Not supported: elements in series with a damper.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from symid.errors import Notice, RobotError
from symid.robot.elasticity import Elasticity, Knee, Stop

__all__ = [
    "MaxwellElement",
    "find_maxwell_elements",
    "find_maxwell_stops",
    "find_normal_form",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class MaxwellElement:
    """A spring (N m/rad or N/m) in series with dry friction that holds up to `force` (N m or N)."""

    stiffness: float
    force: float


def find_normal_form(elasticity: Elasticity, outer_slope: float) -> Elasticity:
    """Return the spring with outer slope one that gives the same torque.

    Args:
        elasticity: stiffnesses and knees as they stand beside an outer function of slope `outer_slope` at
            zero: tau = outer_slope v + sum_j s_j S_j(v).
        outer_slope: positive.

    Raises:
        RobotError: the slope is not positive, or the result is no elasticity.
    """
    if not outer_slope > 0:
        text = f"the outer function's slope at zero is {outer_slope:g}; it must be positive"
        raise RobotError(Notice(code="robot.invalid-elasticity", text=text))
    knees = elasticity.knees
    return Elasticity(
        stiffness=_scale(elasticity.stiffness, outer_slope),
        damping=elasticity.damping,
        cubic=elasticity.cubic * outer_slope,
        stops=tuple(
            Stop(threshold=stop.threshold, stiffness=_scale(stop.stiffness, outer_slope))
            for stop in elasticity.stops
        ),
        knees=tuple(
            Knee(threshold=knee.threshold * outer_slope, slope=knee.slope / outer_slope) for knee in knees
        ),
    )


def _scale(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def find_maxwell_stops(elements: Sequence[MaxwellElement]) -> tuple[Stop, ...]:
    """Return the stops that are these elements, thresholds increasing; equal thresholds are one stop.

    Raises:
        RobotError: a stiffness or force is not positive.
    """
    stiffness: dict[float, float] = {}
    for element in elements:
        if not (element.stiffness > 0 and element.force > 0):
            text = f"stiffness {element.stiffness:g}, force {element.force:g}: both must be positive"
            raise RobotError(Notice(code="robot.invalid-elasticity", text=text))
        threshold = element.force / element.stiffness
        stiffness[threshold] = stiffness.get(threshold, 0.0) + element.stiffness
    return tuple(Stop(threshold=key, stiffness=value) for key, value in sorted(stiffness.items()))


def find_maxwell_elements(elasticity: Elasticity) -> tuple[MaxwellElement, ...]:
    """Return the stops of an elasticity as springs behind dry friction, those of no stiffness left out."""
    return tuple(
        MaxwellElement(stiffness=stop.stiffness, force=stop.stiffness * stop.threshold)
        for stop in elasticity.stops
        if stop.stiffness
    )
