"""The spring between a motor and its link: stiffness, hardening, hysteresis, damping.

    v = k0 phi + k3 phi^3 + sum_i k_i E_i[phi],   tau_J = v + sum_j s_j S_j(v) + D dphi

phi = theta - q is the torsion; E_i is the stop operator of threshold r_i (a spring k_i behind dry friction
k_i r_i); S_j is the one-sided dead zone that begins at torque R_j, max(v - R_j, 0) for R_j > 0 and min(v -
R_j, 0) for R_j < 0. With k_i >= 0 the element is passive. This is the modified Prandtl-Ishlinskii model
(Kuhnen 2003) in its passive form; the outer function has slope one at v = 0, so that v is in N m.

Supported: linear and cubic springs, any number of stops and knees, linear damping; catalogue values of
harmonic drives (slope K1 up to torque T1, K2 up to T2, K3 beyond, wave generator blocked) as knees.
Not supported: stiffness that depends on the position or the load of the joint; the catalogue's loss at the
reversal of torque (stops describe it).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from symid.errors import Notice, RobotError
from symid.serialization import Finite


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Stop:
    """A spring behind dry friction: it slips where its own torsion reaches `threshold` (rad or m).

    `stiffness` in N m/rad or N/m; None where it is to be identified.
    """

    threshold: Finite
    stiffness: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Knee:
    """A change of slope of the outer function: `slope` is added beyond the torque `threshold` (N m or N).

    A positive threshold acts above it, a negative one below it.
    """

    threshold: Finite
    slope: Finite


@dataclass(frozen=True, slots=True, kw_only=True)
class Elasticity:
    """The elastic element of a joint.

    Args:
        stiffness: k0, N m/rad or N/m: what is left when all stops slip; None where unknown.
        damping: D, N m s/rad or N s/m.
        cubic: k3, N m/rad^3 or N/m^3.
        stops: thresholds increasing.
        knees: thresholds increasing, negative ones first.
    """

    stiffness: float | None = None
    damping: float = 0.0
    cubic: float = 0.0
    stops: tuple[Stop, ...] = ()
    knees: tuple[Knee, ...] = ()

    def __post_init__(self) -> None:
        """Check what every later stage relies on.

        Raises:
            RobotError: thresholds that are not increasing, or zero; an outer function that does not rise.
        """
        stops = [stop.threshold for stop in self.stops]
        knees = [knee.threshold for knee in self.knees]
        mistakes = []
        if any(not threshold > 0 for threshold in stops) or stops != sorted(set(stops)):
            mistakes.append("the thresholds of stops must be positive and increase, each once")
        if any(not threshold for threshold in knees) or knees != sorted(set(knees)):
            mistakes.append("the thresholds of knees must differ from 0 and increase, each once")
        for side in (1.0, -1.0):
            slope = 1.0
            outer = [knee for knee in self.knees if knee.threshold * side > 0]
            for knee in sorted(outer, key=lambda knee: abs(knee.threshold)):
                slope += knee.slope
                if not slope > 0:
                    text = f"beyond {knee.threshold:g} the outer function's slope is {slope:g}"
                    mistakes.append(f"{text}; it must be positive")
        _refuse(mistakes)

    @property
    def initial_stiffness(self) -> float | None:
        """Return the stiffness right after a reversal, k0 + sum k_i; None where a part is unknown."""
        parts = [self.stiffness, *(stop.stiffness for stop in self.stops)]
        known = [part for part in parts if part is not None]
        return math.fsum(known) if len(known) == len(parts) else None


def _refuse(mistakes: Sequence[str]) -> None:
    if mistakes:
        raise RobotError(*(Notice(code="robot.invalid-elasticity", text=text) for text in mistakes))


def compute_catalogue_knees(stiffnesses: Sequence[float], torques: Sequence[float]) -> tuple[Knee, ...]:
    """Return the knees that make a spring K1 one of K2 beyond T1 and K3 beyond T2, on both sides.

    The outer function's argument is K1 phi: the second knee stands where it is T1 + (T2 - T1) K1 / K2.
    `stiffnesses` are K1, K2, K3 in N m/rad, `torques` T1 and T2 in N m.

    Raises:
        RobotError: a value is not positive, or the torques do not increase.
    """
    mistakes = [] if all(value > 0 for value in stiffnesses) else ["K1, K2 and K3 must be positive"]
    mistakes += [] if 0 < torques[0] < torques[1] else ["T1 and T2 must be positive and increase"]
    _refuse(mistakes)
    first, second, third = stiffnesses
    places = (torques[0], torques[0] + (torques[1] - torques[0]) * first / second)
    slopes = ((second - first) / first, (third - second) / first)
    above = [Knee(threshold=place, slope=slope) for place, slope in zip(places, slopes, strict=True) if slope]
    below = [Knee(threshold=-knee.threshold, slope=knee.slope) for knee in reversed(above)]
    return (*below, *above)
