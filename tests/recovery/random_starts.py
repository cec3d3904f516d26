"""Random starts of the hysteresis-plus-friction problem: do all of them end at one optimum?"""

import numpy as np

from symid.identification.elastic.nlp import compute_scales, optimise_nlp
from symid.identification.elastic.options import NlpOptions


def draw_start(layout, x, generator):
    """Return random unknowns (x,) between their bounds, around the size of the given ones but not close.

    Dynamic parameters between half and twice the given ones, springs likewise with random shares of their
    stops, slopes between 0.4 and 2.5, Stribeck velocities over their range.
    """
    start = np.array(x)
    start[layout.dynamics] *= 2.0 ** generator.uniform(-1.0, 1.0, size=layout.dynamics.stop)
    for spring in layout.springs:
        shares = generator.dirichlet(np.ones(len(spring.thresholds) + 1))
        start[spring.weights] = shares * np.sum(x[spring.weights]) * 2.0 ** generator.uniform(-1.0, 1.0)
        start[spring.slopes] = 2.5 ** generator.uniform(
            -1.0, 1.0, size=spring.slopes.stop - spring.slopes.start
        )
    limits = np.log(layout.lower[layout.speed]), np.log(layout.upper[layout.speed])
    start[layout.speed] = np.exp(generator.uniform(*limits))
    friction = float(np.max(np.abs(x[layout.dynamics]), initial=0.0))
    start[layout.excess] = generator.uniform(0.0, friction, size=layout.excess.stop - layout.excess.start)
    return np.clip(start, layout.lower, layout.upper)


def optimise_from_many(fit, count, generator, options=None):
    """Return `count` random feasible starts of the last problem of `fit`, and the runs from there."""
    starts = [draw_start(fit.cost.layout, fit.run.x, generator) for _ in range(count)]
    scales = compute_scales(fit.cost, fit.run.x)
    return [(start, optimise_nlp(fit.cost, start, scales, options or NlpOptions())) for start in starts]


def is_same(run, least):
    """Return whether the run converged to the optimum whose objective is `least`."""
    return run.converged and abs(run.objective - least) <= 1e-6 * abs(least)
