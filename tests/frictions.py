"""Samples with known friction: the protocols S1 and S2, a second truth, and motions that lack something."""

import numpy as np

from symid.identification.friction import FrictionOptions, build_estimate, build_problem
from symid.identification.friction.joint_fit import FrictionEstimate, FrictionSamples
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import FrictionLaw, compute_friction_torque
from symid.study.friction_protocols import search_friction

# fC, fS, vs, fV: hybrid row of Table 1, Zhang, Hu and Zou (2021).
TABLE_1 = (10.76, 19.68, 0.0385, 24.04)
# fC, fS, vs, fV, fP, dq0 of joints 1 to 3: Table 3; with the noise of protocol S2.
TABLE_3 = {
    1: (11.64, 23.19, 0.02767, 27.88, 0.47, 0.010),
    2: (39.93, 73.24, 0.01292, 89.24, -3.34, 0.005),
    3: (38.53, 53.78, 0.01557, 89.49, -4.74, 0.010),
}
NOISE_S2 = {1: 1.0, 2: 5.0, 3: 2.0}
# fC, fS, vs, fV and exponent of the Mitsubishi RV-2SQ, joints 1 to 4.
RV_2SQ = {
    1: (2.8503, 4.78, 0.025, 4.7618, 2.09),
    2: (7.7407, 7.97, 0.05, 13.4593, 2.78),
    3: (3.3459, 5.81, 0.05, 4.1019, 2.72),
    4: (1.6581, 2.15, 0.05, 1.3165, 1.60),
}


def draw_samples(
    law: FrictionLaw,
    physical: tuple[float, ...],
    velocity: np.ndarray,
    *,
    noise: float,
    seed: int = 0,
    **given: object,
) -> FrictionSamples:
    """Return samples of a law at velocities (N,), with white noise."""
    count = len(velocity)
    linear, shape = law.from_physical(physical)
    inputs = {"velocity": velocity}
    inputs |= {name: given[name] for name in ("load", "position", "temperature") if name in given}
    torque = compute_friction_torque(law, inputs, linear, shape)
    torque = torque + noise * np.random.default_rng(seed).standard_normal(count)
    given = {"extra": np.zeros((count, 0)), **given}
    return FrictionSamples(joint="1", time=1e-3 * np.arange(count), velocity=velocity, torque=torque, **given)


def fit_by(samples: FrictionSamples, law: FrictionLaw, estimator: str, seed: int = 0) -> FrictionEstimate:
    """Return the fit by an estimator of the study."""
    problem = build_problem(samples, law, FrictionOptions())
    return build_estimate(
        problem, search_friction(problem, estimator, np.random.default_rng(seed)), estimator
    )


def build_cosines(*peaks: float, count: int = 1000) -> np.ndarray:
    """Return velocities of cosine motions, one after the other, `count` samples each."""
    phase = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return np.concatenate([-peak * np.sin(phase) for peak in peaks])


def draw_s1(seed: int = 0, *, count: int = 500, peak: float = 0.5) -> tuple[FrictionSamples, FrictionLaw]:
    """Return protocol S1: half a period, one direction, plain Stribeck friction."""
    law = get_law("stribeck")
    velocity = peak * np.sin(np.pi * (np.arange(count) + 0.5) / count)
    return draw_samples(law, TABLE_1, velocity, noise=float(np.sqrt(251.0 / count)), seed=seed), law


def draw_s2(joint: int = 1, seed: int = 0) -> tuple[FrictionSamples, FrictionLaw]:
    """Return protocol S2: two cosines, improved Stribeck friction in the reading H1."""
    law = get_law("improved-stribeck")
    velocity = build_cosines(0.1, 1.0)
    return draw_samples(law, TABLE_3[joint], velocity, noise=NOISE_S2[joint], seed=seed), law
