"""Sums of plays with weights of any sign (Prandtl-Ishlinskii), their inverse and their memory.

Input: weights and thresholds, or an elasticity. Output: `PlayModel`, the inverse model, the memory of the
inverse. See `hysteresis` for the equations.

    y = w_0 x + sum_i w_i P_i[x],   rises for W_i = w_0 + ... + w_i > 0

As torque of a torsion such a model is passive for w_i <= 0, i >= 1: then k_i = -w_i are stops. As torsion of
a torque (compliance) it is passive for w_i >= 0. The inverse turns one into the other.

Supported: weights of both signs, any memory that a history can leave.
Not supported: models that do not rise; they have no inverse and are refused.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, RobotError
from symid.joint.hysteresis import Plays, invert_plays, invert_plays_memory
from symid.joint.spring_numbers import FLOATS, find_spring_terms
from symid.robot.elasticity import Elasticity, Stop

__all__ = [
    "PlayModel",
    "build_stops",
    "find_memory_mistakes",
    "find_play_model",
    "invert_memory",
    "invert_pi",
]

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayModel:
    """A sum of plays.

    Args:
        weights: w_0 .. w_m.
        thresholds: r_1 .. r_m, positive and increasing, in the unit of the input.
    """

    weights: tuple[float, ...]
    thresholds: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check what the inverse relies on.

        Raises:
            RobotError: thresholds out of order, a count that does not fit, a sum that does not rise.
        """
        mistakes = []
        if len(self.weights) != len(self.thresholds) + 1:
            mistakes.append(f"{len(self.thresholds)} thresholds need {len(self.thresholds) + 1} weights")
        if any(not low < high for low, high in zip((0.0, *self.thresholds), self.thresholds, strict=False)):
            mistakes.append("the thresholds of plays must be positive and increase, each once")
        if not all(slope > 0 for slope in np.cumsum(self.weights)):
            mistakes.append("w_0 + ... + w_i must be positive for every i: else the model does not rise")
        if mistakes:
            raise RobotError(*(Notice(code="robot.invalid-elasticity", text=text) for text in mistakes))


def find_play_model(elasticity: Elasticity) -> PlayModel:
    """Return the plays of an elasticity, knees and cubic part left out: w_0 = k0 + sum k_i, w_i = -k_i.

    Raises:
        RobotError: a stiffness is not known, or the sum does not rise.
    """
    terms = find_spring_terms(elasticity)
    first = terms.stiffness + sum(weight for _, weight in terms.stops)
    return PlayModel(
        weights=(first, *(-weight for _, weight in terms.stops)),
        thresholds=tuple(threshold for threshold, _ in terms.stops),
    )


def build_stops(model: PlayModel) -> Elasticity:
    """Return the same model as an elasticity: k_i = -w_i, k0 = w_0 + ... + w_m."""
    pairs = zip(model.thresholds, model.weights[1:], strict=True)
    stops = tuple(Stop(threshold=threshold, stiffness=-weight) for threshold, weight in pairs)
    return Elasticity(stiffness=sum(model.weights), stops=stops)


def invert_pi(
    model: PlayModel, memory: Sequence[float] | FloatArray | None = None
) -> tuple[PlayModel, FloatArray]:
    """Return the inverse of a model, and the memory (m,) that the inverse has where the model has `memory`.

    w'_0 = 1 / w_0, w'_i = -w_i / (W_i W_{i-1}), r'_i = sum_{j <= i} w_j (r_i - r_j),
    P'_i = W_i P_i + sum_{j > i} w_j P_j.

    Raises:
        RobotError: no history leaves such a memory.
    """
    plays = invert_plays(FLOATS, Plays(weights=model.weights, thresholds=model.thresholds))
    start = np.zeros(len(model.thresholds)) if memory is None else np.asarray(memory, dtype=np.float64)
    return PlayModel(weights=plays.weights, thresholds=plays.thresholds), invert_memory(model, start)


def invert_memory(model: PlayModel, memory: Sequence[float] | FloatArray) -> FloatArray:
    """Return the memory (m,) of the inverse where the model has `memory` (m,).

    Raises:
        RobotError: no history leaves such a memory.
    """
    values = [float(entry) for entry in memory]
    mistakes = find_memory_mistakes(model.thresholds, values)
    if mistakes:
        raise RobotError(*(Notice(code="robot.impossible-memory", text=text) for text in mistakes))
    plays = Plays(weights=model.weights, thresholds=model.thresholds)
    return np.array(invert_plays_memory(FLOATS, plays, values))


def find_memory_mistakes(
    thresholds: Sequence[float] | FloatArray, memory: Sequence[float] | FloatArray
) -> tuple[str, ...]:
    """Return why no history leaves plays as in `memory`, in words; nothing where one does.

    |P_i - P_{i+1}| <= r_{i+1} - r_i, up to rounding.
    """
    radii, plays = np.asarray(thresholds, dtype=np.float64), np.asarray(memory, dtype=np.float64)
    if radii.shape != plays.shape:
        return (f"the memory has {plays.size} plays; there are {radii.size} thresholds",)
    apart, allowed = np.abs(np.diff(plays)), np.diff(radii)
    slack = _ROUNDING * float(np.max(np.abs(plays), initial=0.0) + np.max(radii, initial=0.0))
    return tuple(
        f"plays {index + 1} and {index + 2} are {apart[index]:g} apart; allowed is {allowed[index]:g}"
        for index in range(apart.size)
        if not apart[index] <= allowed[index] + slack
    )
