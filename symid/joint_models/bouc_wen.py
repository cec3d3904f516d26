"""The Bouc-Wen spring, a hysteresis model without plays, for comparison.

    tau = a k phi + (1 - a) k z,   dz/dphi = A - |z|^n (gamma + b sign(z dphi))

The state depends on the path, not on time. A step is taken in two parts where z changes its sign; each part
is smooth and solved by Runge-Kutta steps that are short against 1 / (largest slope of the right-hand side).
Equations: Bouc 1967, Wen, Journal of the Engineering Mechanics Division 102 (1976) 249-263; bounds on the
parameters: Ikhouane and Rodellar, Systems with Hysteresis (2007).

Supported: n >= 1, |gamma| <= b, A > 0: passive, the state within (A / (b + gamma))^(1/n). Others are refused.
"""

import math
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, RobotError

_STEP = 0.05
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


@dataclass(frozen=True, slots=True, kw_only=True)
class BoucWen:
    """A Bouc-Wen spring.

    Args:
        stiffness: k, N m/rad or N/m, right after a reversal where A = 1.
        ratio: a, the share of the stiffness that is left when z no longer grows.
        scale: A; sharpness: n; loop: b and lean: gamma, in rad^-n or m^-n.
    """

    stiffness: float
    ratio: float
    sharpness: float = 1.0
    scale: float = 1.0
    loop: float
    lean: float = 0.0

    def __post_init__(self) -> None:
        """Refuse, by a RobotError, parameters outside the class that `Supported` names: not passive."""
        allowed = (
            (self.stiffness > 0, "the stiffness must be positive"),
            (0 <= self.ratio <= 1, "the ratio must lie between 0 and 1"),
            (self.sharpness >= 1, "the sharpness must be at least 1"),
            (self.scale > 0, "the scale must be positive"),
            (self.loop > 0 and abs(self.lean) <= self.loop, "the loop must be positive, |lean| no greater"),
        )
        mistakes = [text for kept, text in allowed if not kept]
        if mistakes:
            raise RobotError(*(Notice(code="robot.invalid-elasticity", text=text) for text in mistakes))


def compute_bouc_wen_torque(model: BoucWen, phi: FloatArray, state: float = 0.0) -> FloatArray:
    """Return the torque (N,) along the torsion phi (N,), rad or m, straight between samples.

    `state` is z at the first sample, rad or m.
    """
    phi = np.asarray(phi, dtype=np.float64)
    states = np.empty(phi.shape)
    for index, step in enumerate(np.diff(phi, prepend=phi[:1]).tolist()):
        state = _advance(model, state, step)
        states[index] = state
    elastic = model.ratio * model.stiffness * phi
    return elastic + (1.0 - model.ratio) * model.stiffness * states


def _advance(model: BoucWen, state: float, step: float) -> float:
    """Return z after the torsion has moved by `step`."""
    # Turned so that the torsion grows: then z grows too, or tends to its bound.
    sign = math.copysign(1.0, step)
    state, way = sign * state, abs(step)
    if state < 0.0:
        # The way until z has come to zero.
        points = -0.5 * state * (_NODES + 1.0)
        rates = model.scale + (model.loop - model.lean) * points**model.sharpness
        distance = float(-0.5 * state * np.sum(_WEIGHTS / rates))
        if way < distance:
            return sign * _integrate(model, state, way, model.lean - model.loop)
        state, way = 0.0, way - distance
    return sign * _integrate(model, state, way, model.lean + model.loop)


def _integrate(model: BoucWen, state: float, way: float, factor: float) -> float:
    """Return z after dz/dphi = A - factor |z|^n over `way`; z keeps its sign."""
    n, scale = model.sharpness, model.scale
    total = model.loop + model.lean
    bound = float(scale / total) ** (1.0 / n) if total > 0 else abs(state) + scale * way
    slope = n * abs(factor) * max(bound, abs(state)) ** (n - 1.0)
    count = max(1, math.ceil(way * slope / _STEP))
    step = way / count

    def rate(value: float) -> float:
        return scale - factor * float(abs(value) ** n)

    for _ in range(count):
        first = rate(state)
        second = rate(state + 0.5 * step * first)
        third = rate(state + 0.5 * step * second)
        fourth = rate(state + step * third)
        state += step / 6.0 * (first + 2.0 * (second + third) + fourth)
    return state
