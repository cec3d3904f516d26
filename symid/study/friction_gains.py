"""How much less error the improved Stribeck law leaves than simpler ones: protocol S3, Table 4 of the paper.

Input: joints of Table 3 in one slow cosine, seeds of the noise. Output: `GainStudy`.

    gain = 1 - J_improved / J_other,     in RMS 1 - sqrt(J_improved / J_other)

What is known and what is not: the noise of each joint was set so that the gain over Coulomb + viscous comes
out as printed, so that this column is no test. The gain over the original Stribeck law is a prediction, with
one choice behind it that all joints share: the peak of the cosine, the one of 0.03 to 1.5 rad/s with the
least miss.

Supported: fits to the recording that is judged, as a paper may do, and to another draw of the same motion.
Not supported: sums in (N m)^2 as a target; they grow with the number of samples, which is not printed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.friction.estimators import search_friction
from symid.friction.options import FrictionOptions
from symid.friction.problem import build_problem
from symid.joint.friction_law import find_torque
from symid.joint.friction_laws import get_law
from symid.study.friction_data import Scene, build_scene, build_whole_cosines, draw_samples
from symid.study.friction_paper import TABLE_3, TABLE_4, Gain

__all__ = ["LAWS", "PEAK", "GainDraw", "GainStudy", "MeanGain", "build_gain_scene", "find_gains", "fit_laws"]

LAWS = ("coulomb-viscous", "stribeck", "improved-stribeck")
"""In the order of the paper's columns; each is fitted again to every draw."""
PEAK = 0.117
"""Of the cosine, rad/s."""
SAMPLES = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class GainDraw:
    """Sums of squared errors of the laws, (N m)^2: of the fit, and on another draw of the same motion."""

    fitted: tuple[float, ...]
    held_out: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanGain:
    """A gain in percent over all draws, and its standard deviation from draw to draw.

    Args:
        mean, deviation: of sums of squares; rms: mean of the gain in RMS; held_out: mean on other draws.
        paper: as printed; miss: mean - paper, in points.
    """

    mean: float
    deviation: float
    rms: float
    held_out: float
    paper: float
    miss: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GainStudy:
    """A row of Table 4.

    Args:
        joint: its number; noise: N m; samples, draws: how many.
        sums: mean sums of squares in the order of `LAWS`, (N m)^2.
        scaled: the same with one factor for the row, so that the improved law has the paper's sum.
        paper: the printed sums.
        viscous: the gain over Coulomb + viscous, for which the noise was set.
        stribeck: the gain over the original Stribeck law, a prediction.
    """

    joint: str
    noise: float
    samples: int
    draws: int
    sums: tuple[float, ...]
    scaled: tuple[float, ...]
    paper: tuple[float, ...]
    viscous: MeanGain
    stribeck: MeanGain


def build_gain_scene(index: int) -> Scene:
    """Return joint `index` of Table 3, counted from zero, along one slow cosine."""
    row = TABLE_3[index]
    velocity = build_whole_cosines((PEAK,), SAMPLES)
    return build_scene(row.joint, row.law, row.values, velocity, TABLE_4[index].noise)


def fit_laws(task: tuple[Scene, Sequence[int]]) -> tuple[GainDraw, ...]:
    """Return the sums of squares of all laws for every seed's draw of a scene."""
    scene, seeds = task
    options, draws = FrictionOptions(), []
    for seed in seeds:
        samples = draw_samples(scene, np.random.default_rng(seed))
        other = draw_samples(scene, np.random.default_rng((seed, 2))).torque
        fitted, held_out = [], []
        for name in LAWS:
            law = get_law(name)
            problem = build_problem(samples, law, options)
            search = search_friction(problem, estimator="varpro", options=options)
            torque = find_torque(law, samples.inputs, list(search.linear), list(search.shape))
            fitted.append(search.objective)
            held_out.append(float(np.sum((other - torque) ** 2)))
        draws.append(GainDraw(fitted=tuple(fitted), held_out=tuple(held_out)))
    return tuple(draws)


def find_gains(index: int, draws: Sequence[GainDraw]) -> GainStudy:
    """Return what the draws, at least two, of joint `index` say together."""
    scene, row = build_gain_scene(index), TABLE_4[index]
    fitted = np.array([draw.fitted for draw in draws])
    held_out = np.array([draw.held_out for draw in draws])
    sums = np.mean(fitted, axis=0)

    def build_gain(column: int, paper: float) -> MeanGain:
        ratios = fitted[:, -1] / fitted[:, column]
        mean = float(100.0 * np.mean(1.0 - ratios))
        return MeanGain(
            mean=mean,
            deviation=float(100.0 * np.std(ratios, ddof=1)),
            rms=float(100.0 * np.mean(1.0 - np.sqrt(ratios))),
            held_out=float(100.0 * np.mean(1.0 - held_out[:, -1] / held_out[:, column])),
            paper=paper,
            miss=mean - paper,
        )

    printed: Gain = row.printed
    return GainStudy(
        joint=row.joint,
        noise=scene.noise,
        samples=len(scene.velocity),
        draws=len(draws),
        sums=tuple(map(float, sums)),
        scaled=tuple(map(float, sums * (row.sums[-1] / sums[-1]))),
        paper=row.sums,
        viscous=build_gain(0, printed.viscous),
        stribeck=build_gain(1, printed.stribeck),
    )
