"""Pseudo-inertias: matrices that are positive definite if the body can exist; a prior.

Standard parameters (n, 10) -> pseudo-inertias (n, 4, 4), and back: P = [[S, MS], [MS', M]] with the second
moments S = tr(I) / 2 - I (Wensing, Kim and Slotine 2018). Robot, equations of its base values -> a prior, ten
standard parameters a link: what the robot file states, else a round body whose centre of mass lies half-way
to the joints it carries, with a quarter of the distance to the farthest of them as radius of gyration (of
the mean over all links, or 0.1 m, where it carries none), all of one mass, that nearest to the base values.

Supported: fixed bases, symbolic lengths with a value. Loads NumPy only.
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.robot import Robot

_REACH = 0.1
# Flat and thin bodies lie on the edge of what is possible: there the distance to them is infinite.
_ROUNDED = 1e-3


def build_pseudo_inertias(parameters: FloatArray) -> FloatArray:
    """Return the pseudo-inertias (n, 4, 4) of standard parameters (n, 10)."""
    xx, xy, xz, yy, yz, zz, mx, my, mz, mass = np.asarray(parameters, dtype=np.float64).T
    half = 0.5 * (xx + yy + zz)
    rows = [
        [half - xx, -xy, -xz, mx],
        [-xy, half - yy, -yz, my],
        [-xz, -yz, half - zz, mz],
        [mx, my, mz, mass],
    ]
    return np.array(rows, dtype=np.float64).transpose(2, 0, 1)


_UNITS = build_pseudo_inertias(np.eye(10)).reshape(10, 16)
# Symmetric V_k (10, 4, 4) with parameter k = tr(V_k P): entries are 0 (of no sign), 1/2 and 1.
PSEUDO_INERTIA_FORMS = 0.5 * np.rint(2.0 * np.linalg.pinv(_UNITS).T).reshape(10, 4, 4) + 0.0


def compute_standard_parameters(pseudo_inertias: FloatArray) -> FloatArray:
    """Return the standard parameters (n, 10) of pseudo-inertias (n, 4, 4)."""
    found: FloatArray = np.einsum("kab,nab->nk", PSEUDO_INERTIA_FORMS, pseudo_inertias)
    return found


def _build_round_bodies(robot: Robot) -> FloatArray:
    """Return the pseudo-inertias (n, 4, 4) of round bodies of unit mass."""
    symbols = dict(robot.symbols)
    # Positions of the joints that a link carries.
    spans: list[list[FloatArray]] = [[] for _ in robot.joints]
    for joint in robot.joints:
        if joint.parent >= 0:
            values = [value.to_float(symbols) for value in joint.placement.translation]
            spans[joint.parent].append(np.array(values))
    lengths = [max((float(np.linalg.norm(point)) for point in points), default=0.0) for points in spans]
    known = [length for length in lengths if length > 0]
    usual = sum(known) / len(known) if known else _REACH
    bodies = []
    for points, length in zip(spans, lengths, strict=True):
        centre = 0.5 * np.mean(points, axis=0) if points else np.zeros(3)
        extended = np.append(centre, 1.0)
        radius = (length or usual) / 4
        bodies.append(np.outer(extended, extended) + radius**2 * np.diag([1.0, 1.0, 1.0, 0.0]))
    return np.array(bodies)


def _round_off(stated: FloatArray, body: FloatArray) -> FloatArray | None:
    """Return a stated pseudo-inertia, made round where it is flat; None where no body has it."""
    mass = float(stated[3, 3])
    if mass <= 0:
        return None
    inverse = np.linalg.inv(np.linalg.cholesky(mass * body))
    smallest = float(np.linalg.eigvalsh(inverse @ stated @ inverse.T)[0])
    rounded = stated if smallest > _ROUNDED else stated + 2 * _ROUNDED * mass * body
    return None if smallest < -_ROUNDED else rounded


def build_prior(robot: Robot, grouping: FloatArray, values: Sequence[float] | FloatArray) -> FloatArray:
    """Return a consistent set of standard parameters (n, 10) to start from.

    `grouping` (m, 10 n): the equations' coefficients of the links' parameters; `values` (m,): their sums.
    """
    bodies = _build_round_bodies(robot)
    stated: list[FloatArray | None] = [
        None
        if joint.inertial is None
        else _round_off(build_pseudo_inertias(np.array([joint.inertial]))[0], body)
        for joint, body in zip(robot.joints, bodies, strict=True)
    ]
    known = np.array([np.zeros((4, 4)) if body is None else body for body in stated])
    unknown = np.array([body if one is None else 0 * body for body, one in zip(bodies, stated, strict=True)])
    unit = compute_standard_parameters(unknown).ravel()
    sizes = np.abs(grouping) @ np.abs(compute_standard_parameters(bodies).ravel())
    used = sizes > 0
    missing = (np.asarray(values) - grouping @ compute_standard_parameters(known).ravel())[used] / sizes[used]
    share = (grouping @ unit)[used] / sizes[used]
    mass = float(share @ missing) / float(share @ share) if np.any(share) else 0.0
    if mass <= 0:
        mass = float(np.abs(missing).max(initial=0.0)) or 1.0
    return compute_standard_parameters(known + mass * unknown)
