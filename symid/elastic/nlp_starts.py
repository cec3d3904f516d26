"""Where the hysteresis-plus-friction problem begins: given springs on its grid, and random feasible points.

ElasticFit, NlpLayout -> unknowns; NlpCost -> scales of its rows.

Supported: starts with linear springs, or with stops and knees at the problem's own places; random starts from
a generator that is passed in.
Not supported: starts outside the bounds.
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.nlp_cost import NlpCost
from symid.elastic.nlp_layout import NlpLayout
from symid.elastic.nlp_rows import NlpRecording
from symid.robot.elasticity import Elasticity

__all__ = ["find_linear_sigmas", "find_random_start", "find_sigmas", "find_start", "list_weights"]

_FIRST_SHARE = 0.7
"""Of a linear spring, for k0; the stops begin with equal parts of the rest."""
_LEAST_SIGMA = 1e-6
"""Of the size of a block's terms: no rows are trusted more."""


def list_weights(spring: Elasticity, thresholds: FloatArray) -> FloatArray:
    """Return k0 .. km (m + 1,) on the thresholds (m,); a linear spring is shared between them."""
    whole = spring.initial_stiffness or 0.0
    if len(thresholds) and not spring.stops:
        weights = np.full(len(thresholds) + 1, (1.0 - _FIRST_SHARE) * whole / len(thresholds))
        weights[0] = _FIRST_SHARE * whole
        return weights
    known = {stop.threshold: stop.stiffness or 0.0 for stop in spring.stops}
    return np.array([spring.stiffness or 0.0, *(known.get(float(value), 0.0) for value in thresholds)])


def find_start(layout: NlpLayout, chi: FloatArray, springs: Sequence[Elasticity]) -> FloatArray:
    """Return unknowns (x,) between their bounds: chi, the springs on the grid, no Stribeck friction yet.

    Args:
        layout: of the unknowns.
        chi: (p + n + pf,) dynamic parameters.
        springs: one a joint.
    """
    x = np.zeros(layout.size)
    x[layout.dynamics] = chi
    x[layout.speed] = np.sqrt(layout.lower[layout.speed] * layout.upper[layout.speed])
    for place, spring in zip(layout.springs, springs, strict=True):
        x[place.weights] = list_weights(spring, place.thresholds)
        changes = np.zeros(len(place.offset))
        slopes = [_find_local_slope(spring, knee) for knee in place.knees]
        changes[list(place.slots)] = slopes
        x[place.slopes] = changes
    return np.clip(x, layout.lower, layout.upper)


def find_random_start(layout: NlpLayout, x: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Return random unknowns (x,) between their bounds, around the size of the given ones but not close.

    Dynamic parameters between half and twice the given ones, springs likewise with random shares of their
    stops, slopes between 0.4 and 2.5, Stribeck velocities over their range.
    """
    start = np.array(x)
    count = layout.dynamics.stop
    start[layout.dynamics] *= 2.0 ** generator.uniform(-1.0, 1.0, size=count)
    for spring in layout.springs:
        whole = float(np.sum(x[spring.weights]))
        shares = generator.dirichlet(np.ones(len(spring.thresholds) + 1))
        start[spring.weights] = shares * whole * 2.0 ** generator.uniform(-1.0, 1.0)
        slopes = spring.slopes.stop - spring.slopes.start
        start[spring.slopes] = 2.5 ** generator.uniform(-1.0, 1.0, size=slopes)
    start[layout.speed] = np.exp(
        generator.uniform(np.log(layout.lower[layout.speed]), np.log(layout.upper[layout.speed]))
    )
    friction = float(np.max(np.abs(x[layout.dynamics]), initial=0.0))
    start[layout.excess] = generator.uniform(0.0, friction, size=layout.excess.stop - layout.excess.start)
    return np.clip(start, layout.lower, layout.upper)


def find_linear_sigmas(
    recordings: Sequence[NlpRecording], chi: FloatArray, stiffness: FloatArray
) -> tuple[float, ...]:
    """Return the rms residual of every block with linear springs, in the unit of its rows.

    Args:
        recordings: their rows.
        chi: (p + n + pf,) dynamic parameters.
        stiffness: (n,) of the springs.
    """
    sigmas = []
    for block in (block for part in recordings for block in part.blocks):
        residual = block.values - block.matrix @ chi
        for spring in block.springs:
            residual = residual - block.sign * stiffness[spring.joint] * spring.columns[:, 0]
        sigmas.append(_find_rms(residual, block.matrix @ chi))
    return tuple(sigmas)


def find_sigmas(cost: NlpCost, x: FloatArray) -> tuple[float, ...]:
    """Return the rms residual of every block at x, in the unit of its rows."""
    residuals = cost.find_state(x).residuals
    return tuple(
        _find_rms(residual, block.matrix @ x[cost.layout.dynamics])
        for residual, block in zip(residuals, cost.blocks, strict=True)
    )


def _find_rms(residual: FloatArray, loads: FloatArray) -> float:
    sizes = [float(np.sqrt(np.mean(values**2))) for values in (residual, loads)]
    return max(sizes[0], _LEAST_SIGMA * sizes[1], 1e-300)


def _find_local_slope(spring: Elasticity, torque: float) -> float:
    """Return the slope of the outer function just beyond `torque`, away from zero."""
    side = 1.0 if torque > 0.0 else -1.0
    passed = [
        knee.slope for knee in spring.knees if 0.0 < knee.threshold * side <= torque * side * (1 + 1e-12)
    ]
    return 1.0 + sum(passed)
