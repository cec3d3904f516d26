"""What identification reaches of the Cramer-Rao bound, and whether it knows how well it did.

Input: a robot, seeds. Output: `PrecisionStudy`.

    ratio_k = sqrt(mean over seeds of (x_k - truth_k)^2) / bound_k
    coverage = part of all |x_k - truth_k| <= 1.96 of the deviation stated

The equations do not change from seed to seed, only the noise does: rows are condensed once, and the values'
column of every triangle is made anew, with F' F the rows' own and F' (values) from A' y.

Supported: WLS on torque and momentum rows, the physically consistent fit.
Not supported: noise of the states.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.estimators.condensed_fit import CondensedFit, fit_condensed
from symid.estimators.consistent import solve_consistent
from symid.robot.description import Robot
from symid.rows.condensation import Condensed, condense_rows, find_square_sums, stack_condensed
from symid.rows.identifiability import find_spectrum
from symid.rows.quadrature import find_windows, integrate_windows
from symid.study.executor import run_tasks
from symid.study.precision_scene import PrecisionScene, build_scene

__all__ = ["PrecisionMethod", "PrecisionStudy", "fit_seeds", "study_precision"]

_SEEDS_PER_TASK = 20
_NORMAL_95 = 1.959963984540054


@dataclass(frozen=True, slots=True, kw_only=True)
class PrecisionMethod:
    """One method over all seeds.

    Args:
        method: its name.
        ratios: root-mean-square error over the bound, of every parameter.
        mean_ratio, worst_ratio: of these; worst: the parameter of the latter.
        coverage_percent: of intervals stated to hold 95 %.
        worst_price_percent: what the fit adds to the residual of the best one, at most.
        least_eigenvalue: smallest one of all pseudo-inertias of all seeds, SI; None where none were sought.
    """

    method: str
    ratios: tuple[float, ...]
    mean_ratio: float
    worst_ratio: float
    worst: str
    coverage_percent: float
    worst_price_percent: float = 0.0
    least_eigenvalue: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PrecisionStudy:
    """All methods; `condition` of the column-scaled regressor, `bound` the least deviations of `names`."""

    robot: str
    seeds: int
    samples: int
    condition: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    truth: tuple[float, ...]
    bound: tuple[float, ...]
    methods: tuple[PrecisionMethod, ...]


class _Draw(NamedTuple):
    """Errors (p,), deviations stated (p,), price in percent, least eigenvalue."""

    errors: FloatArray
    deviations: FloatArray
    price: float
    eigenvalue: float


@lru_cache(maxsize=1)
def _load_scene(robot: Robot, backend: str) -> PrecisionScene:
    from symid.codegen.cache import prepare_library

    return build_scene(robot, prepare_library(robot, backend=backend))


def study_precision(
    robot: Robot,
    seeds: Sequence[int],
    *,
    backend: str = "auto",
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> PrecisionStudy:
    """Return errors of all methods against the bound; the same for any number of processes.

    Args:
        robot: to be identified.
        seeds: of the noise.
        backend: what computes its functions; see `prepare_library`.
        jobs: processes; None for one a core.
        progress: told how many tasks are done, of how many.
    """
    tasks = [
        (robot, backend, tuple(seeds[start : start + _SEEDS_PER_TASK]))
        for start in range(0, len(seeds), _SEEDS_PER_TASK)
    ]
    found = [draw for part in run_tasks(fit_seeds, tasks, jobs=jobs, progress=progress) for draw in part]
    scene = _load_scene(robot, backend)
    rows = scene.rows["torque"]
    spectrum = find_spectrum(condense_rows(rows).factors[:, :, :-1].reshape(-1, len(rows.names))).singular
    return PrecisionStudy(
        robot=robot.name,
        seeds=len(seeds),
        samples=scene.samples,
        condition=float(spectrum[0] / spectrum[-1]),
        names=rows.names,
        units=rows.units,
        truth=tuple(scene.truth.tolist()),
        bound=tuple(scene.bound.tolist()),
        methods=tuple(_summarise(scene, name, [draws[name] for draws in found]) for name in found[0]),
    )


def fit_seeds(task: tuple[Robot, str, tuple[int, ...]]) -> list[dict[str, _Draw]]:
    """Return what every method finds under the noise of every seed."""
    robot, backend, seeds = task
    scene = _load_scene(robot, backend)
    return [_fit_seed(scene, seed) for seed in seeds]


def _fit_seed(scene: PrecisionScene, seed: int) -> dict[str, _Draw]:
    rng = np.random.default_rng(seed)
    excitations = int(scene.rows["torque"].run.max()) + 1
    shape = (excitations, scene.samples, len(scene.deviations))
    noise = rng.normal(size=shape) * scene.deviations
    torque = _draw(scene, "torque", noise.transpose(2, 0, 1).ravel())
    windows = find_windows(scene.samples, scene.period, scene.window)
    integrals = np.stack([integrate_windows(part, windows) for part in noise])
    momentum = _draw(scene, "momentum", integrals.transpose(2, 0, 1).ravel())
    weighted = fit_condensed(torque, np.eye(len(scene.truth)))
    return {
        "wls": _judge(scene, weighted),
        "momentum": _judge(scene, fit_condensed(momentum, np.eye(len(scene.truth)))),
        "consistent": _fit_bodies(scene, torque, weighted),
    }


def _draw(scene: PrecisionScene, kind: str, noise: FloatArray) -> Condensed:
    """Return the triangles of the equations with noise (m,) on their values.

    With F' F = A' A a column c = F x + F'^-1 A' noise has the right products with the others, and what is
    left of the noise stands below it.
    """
    rows = scene.rows[kind]
    plain = condense_rows(rows)
    factors = np.zeros_like(plain.factors)
    for group, factor in enumerate(plain.factors):
        members = rows.group == group
        part, matrix = noise[members], rows.matrix[members]
        live = np.flatnonzero(factor[:, :-1].any(axis=0))
        triangle = np.asarray(np.linalg.qr(factor[:, live], mode="r"), dtype=np.float64)
        inner = np.linalg.lstsq(triangle.T, matrix[:, live].T @ part, rcond=None)[0]
        size = len(inner)
        factors[group, :size, live] = triangle.T
        factors[group, :size, -1] = triangle @ scene.truth[live] + inner
        factors[group, size, -1] = np.sqrt(max(float(part @ part - inner @ inner), 0.0))
    return Condensed(factors=factors, counts=plain.counts, independent=plain.independent)


def _judge(scene: PrecisionScene, fit: CondensedFit) -> _Draw:
    return _Draw(fit.values - scene.truth, np.sqrt(np.diag(fit.covariance)), 0.0, np.inf)


def _fit_bodies(scene: PrecisionScene, torque: Condensed, weighted: CondensedFit) -> _Draw:
    triangle = stack_condensed(torque, weighted.weights) / np.sqrt(weighted.variance)
    found = solve_consistent(triangle, weighted.values, scene.bodies)
    whole = float(find_square_sums(torque, found.values) @ weighted.weights**2)
    best = float(weighted.squares @ weighted.weights**2)
    return _Draw(
        found.values - scene.truth,
        np.sqrt(np.diag(weighted.covariance)),
        100.0 * (float(np.sqrt(whole / best)) - 1.0),
        found.eigenvalue,
    )


def _summarise(scene: PrecisionScene, method: str, draws: Sequence[_Draw]) -> PrecisionMethod:
    errors = np.array([draw.errors for draw in draws])
    deviations = np.array([draw.deviations for draw in draws])
    ratios = np.sqrt(np.mean(errors**2, axis=0)) / scene.bound
    least = min(draw.eigenvalue for draw in draws)
    return PrecisionMethod(
        method=method,
        ratios=tuple(ratios.tolist()),
        mean_ratio=float(ratios.mean()),
        worst_ratio=float(ratios.max()),
        worst=scene.rows["torque"].names[int(np.argmax(ratios))],
        coverage_percent=100.0 * float(np.mean(np.abs(errors) <= _NORMAL_95 * deviations)),
        worst_price_percent=max(draw.price for draw in draws),
        least_eigenvalue=least if np.isfinite(least) else None,
    )
