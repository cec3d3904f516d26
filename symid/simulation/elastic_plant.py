"""The elastic plant at work: compiled where there is a compiler, in NumPy where there is none.

Input: a library of robot functions, values, an order. Output: `PlantLog`, and notices on how it came about.

Supported: any size; steps short enough for the fastest motion of the robot.
Not supported: dry friction that jumps (see `elastic_values`).
"""

import math
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.codegen.plant_code import CompiledPlant, has_addresses, load_plant_code
from symid.codegen.plant_orders import PlantLog, PlantOrder, PlantRobot
from symid.errors import GenerationError, Notice
from symid.simulation.elastic_numpy import simulate_in_numpy
from symid.simulation.elastic_values import ElasticValues

__all__ = ["PlantRun", "find_substeps", "simulate_plant"]

_SHARE = 0.5
"""Of the time constant of the fastest motion: a Runge-Kutta step, which is stable to 2.7 times it."""
_SMALL = 1e-9
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlantRun:
    """What happened, and what a user should know of how it was computed."""

    log: PlantLog
    backend: str
    notices: tuple[Notice, ...] = ()


def simulate_plant(
    library: Library, robot: PlantRobot, order: PlantOrder, *, compiler: str | None = None
) -> PlantRun:
    """Return what happens to the robot; a machine without a compiler takes much longer, and a notice says so.

    Args:
        library: the functions of the links.
        robot: all numbers.
        order: the experiment.
        compiler: command of the C compiler; None for the first that is found.

    Raises:
        OutputError: there is no place to keep the compiled plant.
    """
    if not has_addresses(library):
        return _simulate_slowly(library, robot, order, "the robot's functions are not compiled")
    try:
        plant: CompiledPlant | None = load_plant_code(compiler=compiler)
    except GenerationError as error:
        return _simulate_slowly(library, robot, order, str(error))
    if plant is None:
        return _simulate_slowly(library, robot, order, "there is no C compiler")
    return PlantRun(log=plant.run(library, robot, order), backend="c", notices=plant.notices)


def _simulate_slowly(library: Library, robot: PlantRobot, order: PlantOrder, reason: str) -> PlantRun:
    text = f"{reason}: the elastic robot is simulated in NumPy, with the same numbers but many times slower"
    notice = Notice(code="simulate.slow-plant", text=text)
    return PlantRun(log=simulate_in_numpy(library, robot, order), backend="python", notices=(notice,))


def find_substeps(
    library: Library, values: ElasticValues, poses: FloatArray, *, period: float, step: float
) -> int:
    """Return how many Runge-Kutta steps a tick takes.

    Args:
        library: the functions of the links.
        values: all numbers.
        poses: (K, n) along the way, rad or m.
        period: of a tick, s.
        step: the longest step wanted, s; fast springs, friction and damping shorten it.
    """
    rate = max(_find_spring_rate(library, values, poses), _find_friction_rate(library, values))
    longest = min(step, _SHARE / rate) if rate > 0.0 else step
    return max(1, math.ceil(period / longest - _ROUNDING))


def _find_spring_rate(library: Library, values: ElasticValues, poses: FloatArray) -> float:
    """Return the fastest rate in 1/s at which links and rotors swing against each other, or settle."""
    (mass,) = library.evaluate("mass_matrix", poses, values.beta)
    mobility = np.linalg.inv(mass) + np.diag(1.0 / values.rotor)
    stiffness = np.array([_find_stiffness(values, joint) for joint in range(len(values.rotor))])
    root, damping = np.sqrt(stiffness), np.array([spring.damping for spring in values.elasticity])
    swing = float(np.sqrt(np.linalg.eigvalsh(root[:, None] * mobility * root).max()))
    root = np.sqrt(damping)
    return max(swing, float(np.linalg.eigvalsh(root[:, None] * mobility * root).max()))


def _find_stiffness(values: ElasticValues, joint: int) -> float:
    """Return the largest slope of a spring whose cubic term is small at the torsions of use."""
    spring = values.elasticity[joint]
    sides = [sum(knee.slope for knee in spring.knees if knee.threshold * side > 0.0) for side in (1.0, -1.0)]
    return (spring.initial_stiffness or 0.0) * (1.0 + max(0.0, *sides))


def _find_friction_rate(library: Library, values: ElasticValues) -> float:
    """Return the fastest rate in 1/s at which friction stops a rotor."""
    if not values.friction.size:
        return 0.0
    speeds = _SMALL * np.vstack([np.eye(len(values.rotor)), -np.eye(len(values.rotor))])
    (drag,) = library.evaluate("friction", speeds, values.friction)
    ahead, back = np.split(np.asarray(drag), 2)
    slope = np.diagonal(ahead - back) / (2.0 * _SMALL)
    return float(np.max(slope / values.rotor))
