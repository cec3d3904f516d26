"""What `consistency` is asked: base values, a prior, weights, checked; the grouping matrix in numbers.

Input: a robot, its base parameters, what the caller gives. Output: `Grouping`, values by name, arrays.

Supported: base values by name or in order; all, some, with friction or without.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from sympy import Symbol

from symid.algebra.exact import find_symbols
from symid.arrays import FloatArray
from symid.errors import Notice, RobotError, UsageError
from symid.notation import INERTIAL
from symid.parameters.base import BaseParameter, BaseParameters, Label
from symid.parameters.consistency_prior import build_pseudo_inertias
from symid.robot.description import Robot

__all__ = ["Grouping", "build_grouping", "read_deviations", "read_prior", "read_values", "read_weights"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Grouping:
    """K in numbers: `matrix` has a row for each of `parameters` and a column for each of `labels`."""

    parameters: tuple[BaseParameter, ...]
    labels: tuple[Label, ...]
    matrix: FloatArray


def build_grouping(robot: Robot, base: BaseParameters, names: Sequence[str] | None = None) -> Grouping:
    """Return the grouping matrix K in numbers.

    Args:
        robot: the robot, for the values of its symbols.
        base: its base parameters.
        names: the base parameters wanted, friction too; all of beta if None.

    Raises:
        RobotError: a symbolic length has no value.
    """
    missing = [name for name in find_symbols(robot) if name not in dict(robot.symbols)]
    if missing:
        text = (
            f"bodies need a value for the symbolic length {', '.join(missing)}: add it under [symbols], in m"
        )
        raise RobotError(Notice(code="robot.symbol-without-value", text=text, file=robot.path))
    symbols = {Symbol(name): value for name, value in robot.symbols}
    wanted = [p for p in (*base.parameters, *base.friction) if names is None or p.name in names]
    if names is None:
        wanted = list(base.parameters)
    column = {label: index for index, label in enumerate(base.labels)}
    matrix = np.zeros((len(wanted), len(base.labels)))
    for row, parameter in enumerate(wanted):
        for label, coefficient in parameter.terms:
            number = coefficient if coefficient.is_number else coefficient.subs(symbols)
            matrix[row, column[label]] = float(number)
    return Grouping(parameters=tuple(wanted), labels=base.labels, matrix=matrix)


def read_values(
    base: BaseParameters, values: Mapping[str, float] | Sequence[float] | FloatArray
) -> dict[str, float]:
    """Return the base values by name, in the order of the base set."""
    known = [parameter.name for parameter in (*base.parameters, *base.friction)]
    if not isinstance(values, Mapping):
        names = known if len(values) == len(known) else known[: base.count]
        if len(values) != len(names):
            text = f"{len(values)} base values given; there are {base.count} base parameters"
            raise UsageError(Notice(code="usage.base-values", text=f"{text}, {len(known)} with friction"))
        values = dict(zip(names, values, strict=True))
    unknown = [name for name in values if name not in known]
    if unknown:
        text = f"there is no base parameter called {', '.join(unknown)}; there are {', '.join(known)}"
        raise UsageError(Notice(code="usage.base-values", text=text))
    result = {name: float(values[name]) for name in known if name in values}
    bad = [name for name, value in result.items() if not np.isfinite(value)]
    if bad or not result:
        what = f"{', '.join(bad)} must be a finite number" if bad else "no base value is given"
        raise UsageError(Notice(code="usage.base-values", text=what))
    return result


def read_prior(robot: Robot, prior: FloatArray) -> FloatArray:
    """Return the pseudo-inertias of a given prior; bodies that do not exist are refused."""
    shape = np.shape(prior)
    if shape != (robot.size, len(INERTIAL)) or not np.all(np.isfinite(prior)):
        text = f"the prior must be ({robot.size}, {len(INERTIAL)}) finite numbers, and has the shape {shape}"
        raise UsageError(Notice(code="usage.prior", text=text))
    bodies = build_pseudo_inertias(prior)
    smallest = np.linalg.eigvalsh(bodies)[:, 0]
    refused = [joint.name for joint, value in zip(robot.joints, smallest, strict=True) if value <= 0]
    if refused:
        text = (
            f"the prior of the links of {', '.join(refused)} is no body: its pseudo-inertia must be positive"
        )
        raise UsageError(Notice(code="usage.prior", text=f"{text} definite; leave the prior out, or mend it"))
    return bodies


def read_weights(robot: Robot, weights: FloatArray | None) -> FloatArray:
    """Return the weights of the links."""
    if weights is None:
        return np.ones(robot.size)
    given = np.asarray(weights, dtype=np.float64)
    if given.shape != (robot.size,) or not np.all(np.isfinite(given)) or np.any(given <= 0):
        text = f"the weights must be {robot.size} positive numbers, one a link"
        raise UsageError(Notice(code="usage.consistency-weights", text=text))
    return given


def read_deviations(known: Mapping[str, float], deviations: Mapping[str, float] | None) -> FloatArray | None:
    """Return the standard deviations of the rows."""
    if deviations is None:
        return None
    given = np.array([deviations.get(name, np.nan) for name in known], dtype=np.float64)
    if not np.all(np.isfinite(given)) or np.any(given <= 0):
        text = "the deviations must be positive numbers, one for each base value given"
        raise UsageError(Notice(code="usage.consistency-weights", text=text))
    return given
