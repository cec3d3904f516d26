"""The equations K pi = beta, scaled by a prior: from base parameters to a `Problem`.

Input: a robot, the grouping, base values, a prior. Output: `Scales`, the prior of all parameters; `Problem`.

With the prior P0 = L L^T and P = L Q L^T a row k of K reads tr(X Q), X = L^T (sum k_i V_i) L, and the
distance to the prior is that of Q to one. Rotor inertias are scaled by their prior: what the robot file says,
else a tenth of the inertia of their link about the joint. Springs and friction count from what the file
says, else from 0, in units of their size.

Supported: links, rotors of joints and couplings, springs, friction.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.joint.friction import FRICTION_MODELS
from symid.notation import INERTIAL
from symid.parameters.base import Label
from symid.parameters.consistency_inputs import Grouping, read_prior
from symid.parameters.consistency_prior import FORMS, build_prior, build_pseudo_inertias, find_parameters
from symid.parameters.consistency_problem import Problem
from symid.robot.description import JointKind, Robot

__all__ = ["Scales", "build_problem", "find_scales"]

_ROTOR_SHARE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Scales:
    """The prior: pseudo-inertias and their factors, values of the positive and of the free parameters."""

    prior: FloatArray
    roots: FloatArray
    positive: Mapping[Label, float]
    free: Mapping[Label, tuple[float, float]]


def _find_known(robot: Robot, label: Label) -> float | None:
    """Return what the robot file states of a drive, spring or friction parameter."""
    index, name = label
    if index >= robot.size:
        coupling = robot.couplings[index - robot.size]
        rotor, friction, spring = coupling.rotor_inertia, coupling.friction, None
    else:
        joint = robot.joints[index]
        rotor, friction, spring = joint.drive.rotor_inertia, joint.friction, joint.spring
    if name == "IA":
        return rotor
    if name in ("KS", "KR"):
        stiffness = spring.stiffness if spring else None
        if name == "KS" or spring is None or stiffness is None or spring.rest is None:
            return stiffness if name == "KS" else None
        return -stiffness * spring.rest
    names = FRICTION_MODELS[friction.kind].parameters
    return None if friction.values is None else friction.values[names.index(name)]


def find_scales(robot: Robot, grouping: Grouping, target: FloatArray, prior: FloatArray | None) -> Scales:
    """Return the prior of everything; an unknown rotor has a tenth of the inertia of its link."""
    links = [index for index, (_, name) in enumerate(grouping.labels) if name in INERTIAL]
    bodies = (
        build_pseudo_inertias(build_prior(robot, grouping.matrix[:, links], target))
        if prior is None
        else read_prior(robot, prior)
    )
    parameters = find_parameters(bodies)
    positive: dict[Label, float] = {}
    free: dict[Label, tuple[float, float]] = {}
    for column, label in enumerate(grouping.labels):
        coefficients = grouping.matrix[:, column]
        index, name = label
        if name in INERTIAL or not np.any(coefficients):
            continue
        known = _find_known(robot, label)
        if name == "IA":
            joint = index if index < robot.size else robot.couplings[index - robot.size].terms[0][0]
            own = "ZZ" if robot.joints[joint].kind is JointKind.REVOLUTE else "M"
            usual = _ROTOR_SHARE * float(parameters[joint, INERTIAL.index(own)])
            positive[label] = known if known is not None and known > 0 else usual
        else:
            rows = np.flatnonzero(coefficients)
            size = float(np.abs(target[rows] / coefficients[rows]).max())
            free[label] = (known or 0.0, abs(known or 0.0) or size or 1.0)
    return Scales(
        prior=bodies,
        roots=np.asarray(np.linalg.cholesky(bodies), dtype=np.float64),
        positive=positive,
        free=free,
    )


def build_problem(
    robot: Robot, grouping: Grouping, target: FloatArray, scales: Scales, weights: FloatArray | None
) -> tuple[Problem, FloatArray]:
    """Return the problem with its rows scaled to one, and the sizes of the rows."""
    column = {label: index for index, label in enumerate(grouping.labels)}
    links = [[column[index, name] for name in INERTIAL] for index in range(robot.size)]
    forms = np.einsum("mnk,kab->mnab", grouping.matrix[:, links], FORMS)
    blocks = scales.roots.transpose(0, 2, 1) @ forms @ scales.roots
    units = np.array(list(scales.positive.values()))
    positive = grouping.matrix[:, [column[label] for label in scales.positive]] * units
    starts = np.array([start for start, _ in scales.free.values()])
    sizes = np.array([size for _, size in scales.free.values()])
    chosen = grouping.matrix[:, [column[label] for label in scales.free]]
    free, rest = chosen * sizes, target - chosen @ starts
    norms = np.sqrt((blocks**2).sum(axis=(1, 2, 3)) + (positive**2).sum(axis=1) + (free**2).sum(axis=1))
    others = np.ones(len(units) + len(sizes))
    return Problem(
        blocks=blocks / norms[:, None, None, None],
        positive=positive / norms[:, None],
        free=free / norms[:, None],
        target=rest / norms,
        slack=np.zeros(len(target)),
        weights=np.concatenate([np.ones(robot.size) if weights is None else weights, others]),
    ), norms
