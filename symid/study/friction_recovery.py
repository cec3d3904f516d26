"""Whether the parameters of a friction law come back from noisy torques: protocol S2, and a second robot.

Input: scenes whose truth is known, seeds of the noise. Output: `Recovery`: mean and standard deviation over
the draws next to the truth and the Cramer-Rao bound.

    ratio = deviation over the draws / bound,     bias = (mean - truth) / deviation over the draws

Supported: any law; the default estimator, which is run on every draw.
Not supported: draws in which a parameter is refused; all values are kept as they come.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.friction.covariance import find_cramer_rao
from symid.friction.estimators import search_friction
from symid.friction.options import FrictionOptions
from symid.friction.problem import build_problem
from symid.joint.friction_laws import get_law
from symid.study.friction_data import Scene, build_scene, build_whole_cosines, draw_samples
from symid.study.friction_paper import RECOVERY_NOISE, RECOVERY_PEAKS, RV_2SQ, TABLE_3

__all__ = [
    "UNTOLD",
    "Draw",
    "RecoveredParameter",
    "Recovery",
    "build_recovery_scene",
    "build_second_scene",
    "find_recovery",
    "fit_draws",
]

SAMPLES = 1000
"""Of each cosine."""
UNTOLD = 0.5
"""Cramer-Rao deviation over value from which on a parameter counts as not identifiable."""
_NOISE_SHARE = 0.02
_SLOW = 3.0
_FAST = 1.0
_BOUNDS = 3.0

Draw = tuple[tuple[float, ...], int]
"""Fitted parameters in the order of the law's `physical`, and how many linear problems that took."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecoveredParameter:
    """A parameter over all draws.

    Args:
        name, unit: as the law has them.
        truth, mean, deviation: of the draws; bound: Cramer-Rao deviation.
        ratio, bias: as in the module's equations.
        error: the largest |estimate - truth| / bound; inside: draws within three bounds.
        told: whether the bound allows to identify it at all.
    """

    name: str
    unit: str
    truth: float
    mean: float
    deviation: float
    bound: float
    ratio: float
    bias: float
    error: float
    inside: int
    told: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """A joint over all draws; `solves` is the largest number of linear problems of a fit.

    `slow` counts the samples slower than the edge of the zone, or than the Stribeck velocity without one.
    """

    joint: str
    law: str
    noise: float
    samples: int
    slow: int
    draws: int
    solves: int
    parameters: tuple[RecoveredParameter, ...]


def build_recovery_scene(index: int) -> Scene:
    """Return joint `index` of Table 3, counted from zero, along two cosines."""
    row = TABLE_3[index]
    velocity = build_whole_cosines(RECOVERY_PEAKS, SAMPLES)
    return build_scene(row.joint, row.law, row.values, velocity, RECOVERY_NOISE[index])


def build_second_scene(index: int) -> Scene:
    """Return joint `index` of the RV-2SQ, counted from zero: peaks 3 vs and 1 rad/s, noise 0.02 fC."""
    row = RV_2SQ[index]
    coulomb, _, stribeck, _ = row.values
    velocity = build_whole_cosines((_SLOW * stribeck, _FAST), SAMPLES)
    return build_scene(row.joint, row.law, row.values, velocity, _NOISE_SHARE * coulomb)


def fit_draws(task: tuple[Scene, Sequence[int]]) -> tuple[Draw, ...]:
    """Return the fit of every seed's draw of a scene."""
    scene, seeds = task
    law, options = get_law(scene.law), FrictionOptions()
    found = []
    for seed in seeds:
        samples = draw_samples(scene, np.random.default_rng(seed))
        search = search_friction(build_problem(samples, law, options), estimator="varpro", options=options)
        found.append((law.to_physical(list(search.linear), list(search.shape)), search.solves))
    return tuple(found)


def find_recovery(scene: Scene, found: Sequence[Draw]) -> Recovery:
    """Return what the draws of `fit_draws`, at least two, say together."""
    law = get_law(scene.law)
    samples = draw_samples(scene, np.random.default_rng(0))
    bounds = find_cramer_rao(samples, law, scene.physical, scene.noise)
    values = np.array([entry for entry, _ in found])
    truth = np.array(scene.physical)
    errors = np.abs(values - truth) / bounds
    means, deviations = np.mean(values, axis=0), np.std(values, axis=0, ddof=1)
    edges = {entry.name: value for entry, value in zip(law.physical, scene.physical, strict=True)}
    edge = edges.get("dq0", edges["vs"])
    return Recovery(
        joint=scene.joint,
        law=law.name,
        noise=scene.noise,
        samples=len(scene.velocity),
        slow=int(np.sum(np.abs(scene.velocity) < edge)),
        draws=len(found),
        solves=max(solves for _, solves in found),
        parameters=tuple(
            RecoveredParameter(
                name=entry.name,
                unit=entry.unit,
                truth=float(truth[k]),
                mean=float(means[k]),
                deviation=float(deviations[k]),
                bound=float(bounds[k]),
                ratio=float(deviations[k] / bounds[k]),
                bias=float((means[k] - truth[k]) / deviations[k]),
                error=float(np.max(errors[:, k])),
                inside=int(np.sum(errors[:, k] <= _BOUNDS)),
                told=bool(bounds[k] <= UNTOLD * abs(truth[k])),
            )
            for k, entry in enumerate(law.physical)
        ),
    )
