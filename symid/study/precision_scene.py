"""A robot of known truth along random excitations: the scene of the precision study.

Input: a robot, its library. Output: `PrecisionScene`: regressor, torque, windows, the Cramer-Rao bound.

The truth is what the robot file states, or bodies drawn once: clouds of points about the links, lighter
towards the tip. The excitations are random Fourier series within the robot's limits; their states are exact.
Noise of the torque is white, of one standard deviation a joint, a part of the root mean square of its torque.

Supported: rigid robots.
Not supported: noise of the states.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.library import Library
from symid.data.recording import Signals
from symid.estimators.bodies import Bodies, build_bodies
from symid.excitation.trajectories import FourierOptions, build_random_fourier
from symid.robot.description import Robot
from symid.robot.log_map import Processing
from symid.rows.rows import Rows, build_rows, stack_rows

__all__ = ["DURATION", "EXCITATIONS", "NOISE", "PrecisionScene", "build_scene"]

EXCITATIONS = 5
DURATION = 10.0
"""Of each, in s; five harmonics of its inverse."""
NOISE = 0.01
"""Standard deviation of the noise over the root mean square of the joint's torque."""
_PERIOD = 2e-3
_WINDOW = 0.05
_POINTS = 12
_HEAVY = 4.0
"""Mass of the first link in kg where the robot file states none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PrecisionScene:
    """Equations without noise.

    Args:
        rows: by kind, "torque" and "momentum", of all excitations.
        truth: (p,) parameters; bodies: behind them.
        deviations: (n,) of the torque's noise; bound: (p,) Cramer-Rao deviations from all samples.
        samples: of one excitation; period: s; window: s, of momentum rows.
    """

    rows: dict[str, Rows]
    truth: FloatArray
    bodies: Bodies
    deviations: FloatArray
    bound: FloatArray
    samples: int
    period: float
    window: float


def build_scene(robot: Robot, library: Library) -> PrecisionScene:
    """Return the scene; the same robot gives the same numbers."""
    bodies = build_bodies(robot)
    truth = _find_truth(library, bodies)
    time = freeze(_PERIOD * np.arange(round(DURATION / _PERIOD) + 1))
    plain = Processing()
    parts: dict[str, list[Rows]] = {"torque": [], "momentum": []}
    for seed in range(EXCITATIONS):
        options = FourierOptions(duration=DURATION, base_frequency=1.0 / DURATION, ramp=0.0)
        trajectory = build_random_fourier(robot, np.random.default_rng(seed), options)
        q, dq, ddq = trajectory.evaluate(time)
        still = Signals(time=time, q=q, dq=dq, ddq=ddq, tau=np.zeros_like(q), period=_PERIOD)
        for kind, found in parts.items():
            found.append(build_rows(kind, library, still, plain, window=_WINDOW))
    rows = {kind: stack_rows(found) for kind, found in parts.items()}
    torque = rows["torque"].matrix @ truth
    groups = [rows["torque"].group == joint for joint in range(library.card.size)]
    deviations = np.array([NOISE * np.sqrt(np.mean(torque[members] ** 2)) for members in groups])
    return PrecisionScene(
        rows=rows,
        truth=truth,
        bodies=bodies,
        deviations=deviations,
        bound=_find_bound(rows["torque"], deviations),
        samples=len(time),
        period=_PERIOD,
        window=_WINDOW,
    )


def _find_bound(rows: Rows, deviations: FloatArray) -> FloatArray:
    """Return the roots of the diagonal of (A' S^-1 A)^-1."""
    triangle = np.linalg.qr(rows.matrix / deviations[rows.group][:, None], mode="r")
    bound: FloatArray = np.linalg.norm(np.linalg.inv(triangle), axis=1)
    return bound


def _find_truth(library: Library, bodies: Bodies) -> FloatArray:
    stated = [entry.value for entry in (*library.card.beta, *library.card.friction)]
    known = [value for value in stated if value is not None]
    if len(known) == len(stated):
        return np.array(known)
    pi = _draw_bodies(bodies.stated)
    values: FloatArray = np.einsum("pnk,nk->p", bodies.links, pi)
    # Rotors as heavy as a tenth of a first link's; friction of one in its unit; no offsets.
    values = values + bodies.positive @ np.full(bodies.positive.shape[1], 0.1)
    return values + bodies.bounded @ np.ones(bodies.bounded.shape[1])


def _draw_bodies(expected: FloatArray) -> FloatArray:
    """Return standard parameters (n, 10) of clouds of points about expected bodies of any mass."""
    from symid.parameters.consistency_prior import build_pseudo_inertias, find_parameters

    rng = np.random.default_rng(0)
    count, bodies = len(expected), []
    for index, body in enumerate(build_pseudo_inertias(expected)):
        shape = body / body[3, 3]
        centre = shape[:3, 3]
        root = np.linalg.cholesky(shape[:3, :3] - np.outer(centre, centre))
        points = centre + rng.normal(size=(_POINTS, 3)) @ root.T
        extended = np.column_stack([points, np.ones(_POINTS)])
        mass = _HEAVY * (count - index) / count
        bodies.append(mass / _POINTS * extended.T @ extended)
    return find_parameters(np.array(bodies))
