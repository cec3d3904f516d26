"""Methods for rigid robots: precision against the Cramer-Rao bound, and the effect of the cut-off frequency.

Robot, seeds -> `PrecisionStudy`: x of random excitations with exact states and new noise for every seed,

    ratio_k = sqrt(mean over seeds of (x_k - truth_k)^2) / bound_k
    coverage = part of all |x_k - truth_k| <= 1.96 of the standard deviation stated

Library, recording, processing -> `CutoffStudy`: fits (WLS) to the first 60 % of a log, with every cut-off,
predict the torque of the rest: mean over joints of |tau - tau_hat| / |tau|, both low-passed alike.

Not supported: noise of the states; a choice of the cut-off by the result.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from symid import dynamics
from symid.arrays import FloatArray, compute_triangle, freeze
from symid.codegen import Library, prepare_library
from symid.errors import IdentifiabilityError
from symid.excitation import FourierOptions, build_random_fourier
from symid.identification import regression
from symid.identification.diagnostics import compute_band_residual
from symid.identification.estimators import Bodies, build_bodies, fit_condensed, solve_consistent
from symid.identification.rigid import identify_parameters
from symid.logs import Recording, Signals
from symid.robot import Decimation, Processing, Robot, build_pseudo_inertias
from symid.study.monte_carlo import run_tasks

EXCITATIONS = 5
DURATION = 10.0
"""Of each, in s; five harmonics of its inverse."""
NOISE = 0.01
"""Standard deviation of the noise over the root mean square of the joint's torque."""
_PERIOD = 2e-3
"""Of samples, in s."""
_WINDOW = 0.05
"""Of momentum rows, in s."""
_POINTS = 12
_HEAVY = 4.0
"""Mass of the first link in kg where the robot file states none."""
_BATCH = 20
"""Seeds of a task."""
_NORMAL_95 = 1.959963984540054
CUTOFFS = (10.0, 15.0, 20.0, 30.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0)
BAND = 10.0
"""Of the comparison of cut-offs, in Hz."""
_HIGHEST_CUTOFF = 0.45


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PrecisionScene:
    """Equations without noise: rows by kind, "torque" and "momentum", of all excitations.

    `truth` are (p,) parameters, `bodies` behind them, `deviations` (n,) those of the torque's noise, `bound`
    (p,) Cramer-Rao deviations from all samples; `samples` counts those of one excitation.
    """

    rows: dict[str, regression.Rows]
    truth: FloatArray
    bodies: Bodies
    deviations: FloatArray
    bound: FloatArray
    samples: int


@lru_cache(maxsize=1)
def _load_scene(robot: Robot, backend: str) -> PrecisionScene:
    """Return the scene; the same robot gives the same numbers."""
    library, bodies = prepare_library(robot, backend=backend), build_bodies(robot)
    stated = [entry.value for entry in (*library.card.beta, *library.card.friction)]
    known = [value for value in stated if value is not None]
    truth = np.array(known)
    if len(known) < len(stated):
        # Else the parameters of clouds of points about bodies of any mass.
        rng, clouds = np.random.default_rng(0), []
        for index, body in enumerate(build_pseudo_inertias(bodies.stated)):
            shape = body / body[3, 3]
            centre = shape[:3, 3]
            root = np.linalg.cholesky(shape[:3, :3] - np.outer(centre, centre))
            points = centre + rng.normal(size=(_POINTS, 3)) @ root.T
            extended = np.column_stack([points, np.ones(_POINTS)])
            mass = _HEAVY * (len(bodies.stated) - index) / len(bodies.stated)
            clouds.append(mass / _POINTS * extended.T @ extended)
        pi = dynamics.compute_standard_parameters(np.array(clouds))
        values: FloatArray = np.einsum("pnk,nk->p", bodies.links, pi)
        # Rotors as heavy as a tenth of a first link's; friction of one in its unit; no offsets.
        values = values + bodies.positive @ np.full(bodies.positive.shape[1], 0.1)
        truth = values + bodies.bounded @ np.ones(bodies.bounded.shape[1])
    time = freeze(_PERIOD * np.arange(round(DURATION / _PERIOD) + 1))
    plain = Processing()
    parts: dict[str, list[regression.Rows]] = {"torque": [], "momentum": []}
    for seed in range(EXCITATIONS):
        options = FourierOptions(duration=DURATION, base_frequency=1.0 / DURATION, ramp=0.0)
        trajectory = build_random_fourier(robot, np.random.default_rng(seed), options)
        q, dq, ddq = trajectory.evaluate(time)
        still = Signals(time=time, q=q, dq=dq, ddq=ddq, tau=np.zeros_like(q), period=_PERIOD)
        for kind, found in parts.items():
            found.append(regression.build_rows(kind, library, still, plain, window=_WINDOW))
    rows = {kind: regression.stack_rows(found) for kind, found in parts.items()}
    torque = rows["torque"].matrix @ truth
    groups = [rows["torque"].group == joint for joint in range(library.card.size)]
    deviations = np.array([NOISE * np.sqrt(np.mean(torque[members] ** 2)) for members in groups])
    # The roots of the diagonal of (A' S^-1 A)^-1.
    of_rows = deviations[rows["torque"].group]
    triangle = compute_triangle(rows["torque"].matrix / of_rows[:, None])
    return PrecisionScene(
        rows=rows,
        truth=truth,
        bodies=bodies,
        deviations=deviations,
        bound=np.linalg.norm(np.linalg.inv(triangle), axis=1),
        samples=len(time),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PrecisionMethod:
    """One method over all seeds.

    Args:
        ratios: root-mean-square error over the bound, of every parameter; worst: that of the largest.
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


class _SeedErrors(NamedTuple):
    """Errors (p,), deviations stated (p,), price in percent, least eigenvalue."""

    errors: FloatArray
    deviations: FloatArray
    price: float = 0.0
    eigenvalue: float = np.inf


def study_precision(
    robot: Robot,
    seeds: Sequence[int],
    *,
    backend: str = "auto",
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> PrecisionStudy:
    """Return errors of all methods against the bound; the same for any number of processes.

    `seeds` of the noise; `backend` as of `prepare_library`, `jobs` and `progress` as of `run_tasks`.
    """
    tasks = [(robot, backend, seed) for seed in seeds]
    found = run_tasks(_fit_seed, tasks, jobs=jobs, batch=_BATCH, progress=progress)
    scene = _load_scene(robot, backend)
    rows = scene.rows["torque"]
    design = regression.condense_rows(rows).factors[:, :, :-1].reshape(-1, len(rows.names))
    spectrum = regression.compute_spectrum(design).singular
    methods = []
    for name in found[0]:
        draws = [draw[name] for draw in found]
        errors, deviations = (np.array(part) for part in zip(*(draw[:2] for draw in draws), strict=True))
        ratios = np.sqrt(np.mean(errors**2, axis=0)) / scene.bound
        least = min(draw.eigenvalue for draw in draws)
        method = PrecisionMethod(
            method=name,
            ratios=tuple(ratios.tolist()),
            mean_ratio=float(ratios.mean()),
            worst_ratio=float(ratios.max()),
            worst=rows.names[int(np.argmax(ratios))],
            coverage_percent=100.0 * float(np.mean(np.abs(errors) <= _NORMAL_95 * deviations)),
            worst_price_percent=max(draw.price for draw in draws),
            least_eigenvalue=least if np.isfinite(least) else None,
        )
        methods.append(method)
    return PrecisionStudy(
        robot=robot.name,
        seeds=len(seeds),
        samples=scene.samples,
        condition=float(spectrum[0] / spectrum[-1]),
        names=rows.names,
        units=rows.units,
        truth=tuple(scene.truth.tolist()),
        bound=tuple(scene.bound.tolist()),
        methods=tuple(methods),
    )


def _fit_seed(task: tuple[Robot, str, int]) -> dict[str, _SeedErrors]:
    robot, backend, seed = task
    scene = _load_scene(robot, backend)
    rng = np.random.default_rng(seed)
    excitations = int(scene.rows["torque"].run.max()) + 1
    shape = (excitations, scene.samples, len(scene.deviations))
    noise = rng.normal(size=shape) * scene.deviations
    torque = _condense_with_noise(scene, "torque", noise.transpose(2, 0, 1).ravel())
    windows = regression.choose_windows(scene.samples, _PERIOD, _WINDOW)
    integrals = np.stack([regression.integrate_windows(part, windows) for part in noise])
    momentum = _condense_with_noise(scene, "momentum", integrals.transpose(2, 0, 1).ravel())
    identity = np.eye(len(scene.truth))
    weighted = fit_condensed(torque, identity)
    best = float(regression.compute_square_sums(torque, weighted.values) @ weighted.weights**2)
    variance = best / (torque.independent * float(torque.counts.sum() - weighted.spent.sum()))
    triangle = regression.stack_condensed(torque, weighted.weights) / np.sqrt(variance)
    consistent = solve_consistent(triangle, weighted.values, scene.bodies)
    whole = float(regression.compute_square_sums(torque, consistent.values) @ weighted.weights**2)
    price = 100.0 * (float(np.sqrt(whole / best)) - 1.0)
    errors = {
        name: _SeedErrors(fit.values - scene.truth, np.sqrt(np.diag(fit.covariance)))
        for name, fit in (("wls", weighted), ("momentum", fit_condensed(momentum, identity)))
    }
    deviations = errors["wls"].deviations
    found = _SeedErrors(consistent.values - scene.truth, deviations, price, consistent.eigenvalue)
    return {**errors, "consistent": found}


def _condense_with_noise(scene: PrecisionScene, kind: str, noise: FloatArray) -> regression.Condensed:
    """Return the triangles of the equations with noise (m,) on their values.

    With F' F = A' A a column c = F x + F'^-1 A' noise has the right products with the others, and what is
    left of the noise stands below it.
    """
    rows = scene.rows[kind]
    plain = regression.condense_rows(rows)
    factors = np.zeros_like(plain.factors)
    for group, factor in enumerate(plain.factors):
        members = rows.group == group
        part, matrix = noise[members], rows.matrix[members]
        live = np.flatnonzero(factor[:, :-1].any(axis=0))
        triangle = compute_triangle(factor[:, live])
        inner = np.linalg.lstsq(triangle.T, matrix[:, live].T @ part, rcond=None)[0]
        size = len(inner)
        factors[group, :size, live] = triangle.T
        factors[group, :size, -1] = triangle @ scene.truth[live] + inner
        factors[group, size, -1] = np.sqrt(max(float(part @ part - inner @ inner), 0.0))
    return regression.Condensed(factors=factors, counts=plain.counts, independent=plain.independent)


@dataclass(frozen=True, slots=True)
class CutoffLine:
    """One cut-off in Hz: held-out residuals in percent; None where nothing could be fitted."""

    cutoff: float
    decimated: float | None
    plain: float | None
    momentum: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class CutoffStudy:
    """All cut-offs; `factor` of the decimation, `chosen` cut-off of the log, `band` of the comparison."""

    robot: str
    source: str
    factor: int
    chosen: float
    band: float
    lines: tuple[CutoffLine, ...]


def study_cutoff(
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    cutoffs: Sequence[float] = CUTOFFS,
    progress: Callable[[int, int], None] | None = None,
) -> CutoffStudy:
    """Return how well fits with every one of `cutoffs` (Hz) predict the rest of the log.

    The states of the rest pass the log's own filter throughout, so that only the fit differs. `processing` is
    that of the robot file, its cut-off replaced; `progress` as of `run_tasks`.
    """
    settled = regression.choose_filters(processing, [recording]).processing
    if settled.filter_cutoff is None:
        settled = regression.choose_filters(replace(settled, automatic=True), [recording]).processing
    window = regression.choose_window("momentum", settled, recording.period)
    count = len(recording.time)
    middle = round(0.6 * count)
    rest = replace(settled, drop_first=max(settled.drop_first, middle))
    usable = [value for value in cutoffs if value < _HIGHEST_CUTOFF / recording.period]

    def predict(fitted: Processing, rows: str) -> float | None:
        span = window if rows == "momentum" else None
        try:
            fit = identify_parameters(library, [recording], fitted, rows=rows, estimator="wls", window=span)
        except IdentifiabilityError:
            return None
        names = tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
        found = compute_band_residual(fit.assemble(names), library, recording, rest, band=BAND)
        return found.mean_relative_percent

    lines, last = list[CutoffLine](), max(settled.drop_last, count - middle)
    for value in usable:
        filtered = replace(settled, filter_cutoff=value, drop_last=last)
        plain = replace(filtered, decimation=Decimation())
        kinds = ((filtered, "torque"), (plain, "torque"), (plain, "momentum"))
        lines.append(CutoffLine(value, *(predict(*kind) for kind in kinds)))
        if progress is not None:
            progress(len(lines), len(usable))
    return CutoffStudy(
        robot=library.card.robot,
        source=recording.source,
        factor=settled.decimation.factor,
        chosen=settled.filter_cutoff or 0.0,
        band=BAND,
        lines=tuple(lines),
    )
