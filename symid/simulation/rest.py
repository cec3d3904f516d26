"""An elastic robot at rest: how far its springs give under its own weight.

Input: `PlantRobot`, the torques that the springs carry. Output: torsions and play states.

    S(v(phi)) = g,   v on the virgin curve: P_i = sign(phi) max(|phi| - r_i, 0)

Supported: springs loaded once from zero. Not supported: other histories.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.plant_orders import PlantRobot
from symid.errors import Notice, SolverError
from symid.simulation.elastic_numpy import Springs

__all__ = ["Rest", "find_rest"]

_GROWTH = 1.1
_MOST_TRIALS = 400
_BISECTIONS = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rest:
    """Springs under load: torsion `phi` (n,) rad or m, `play` P_i (n, m) rad or m."""

    phi: FloatArray
    play: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("phi", "play"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def find_rest(robot: PlantRobot, load: FloatArray, names: tuple[str, ...]) -> Rest:
    """Return torsions at which the springs carry `load` (n,) in N m or N, reached from zero.

    The first root on the curve is bracketed by trials that grow by a tenth, then halved to the last digit.

    Raises:
        SolverError: a spring carries no such load: it softens until it gives way.
    """
    springs = Springs(robot)
    phi = np.array([_find_torsion(springs, robot, joint, float(load[joint])) for joint in range(robot.size)])
    lost = [name for name, angle in zip(names, phi.tolist(), strict=True) if not np.isfinite(angle)]
    if lost:
        text = (
            f"the springs of {', '.join(lost)} cannot carry the weight of the robot; give them a stiffness "
            "and a cubic term that let their torque rise"
        )
        raise SolverError(Notice(code="simulate.weak-spring", text=text))
    return Rest(phi=phi, play=_find_virgin_play(robot, phi))


def _find_virgin_play(robot: PlantRobot, phi: FloatArray) -> FloatArray:
    play: FloatArray = np.sign(phi)[:, None] * np.maximum(np.abs(phi)[:, None] - robot.radius, 0.0)
    return play


def _find_torsion(springs: Springs, robot: PlantRobot, joint: int, load: float) -> float:
    """Return the torsion of one joint, not a number where there is none."""
    side = 1.0 if load > 0.0 else -1.0

    def find_excess(phi: float) -> float:
        play = _find_virgin_play(robot, np.full(robot.size, phi))
        return side * springs.find_torque(joint, phi, play) - abs(load)

    if not load:
        return 0.0
    high = abs(load) / float(robot.stiffness[joint] + robot.weight[joint].sum())
    for _ in range(_MOST_TRIALS):
        if find_excess(side * high) >= 0.0:
            break
        high *= _GROWTH
    else:
        return float("nan")
    low = 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if find_excess(side * middle) >= 0.0 else (middle, high)
    return side * high
