"""Methods for elastic joints next to each other, over many seeds of noise.

Robot, datasets, seeds -> `ElasticStudy`: errors of every method on every dataset, against the known truth.

    parameters   largest |estimate - truth| / |truth| over the dynamic parameters whose truth is not zero
    hysteresis   joint by joint RMS(tau_J estimate - tau_J) / RMS(tau_J), on the true torsion of TC

Beside the methods of `identification.elastic` stands `independent`, a reconstruction of the published
procedures that find dynamics and hysteresis apart, no copy: dynamics from motions of all joints together; the
hysteresis of each joint from slow motions of that joint alone, its torque from the motor equation, its
torsion by the link encoder or, on the motor side (which needs gravity),

    phi <- phi + G' (G G' + mu 1)^-1 (link(theta - phi) - tau_J),  G = d gravity / dq

The Cramer-Rao bounds are those of the sum of both equations, where nothing is known of the springs, and
N (N' I N)^-1 N' where their form is, N the null space of the link equations, I the information of the motor
equations (Gorman and Hero 1990); S are the derivatives of the springs' torque by all their numbers w:

    motor   IA ddtheta + F(dtheta) f + S w = tau + noise
    link    Y beta - S w = 0                                     exact, as the states are

Clean: 5 kHz, perfect sensors. Noisy: 1 kHz, encoders with 2^20 steps a turn, torque noise of 2 % of each
joint's RMS. The motion is the same for all seeds, and all methods use the same recordings.

Robot, seeds -> `TrackingStudy`: how links follow TC in closed loop with feed-forward of each model.

    Case 1  from 10 x TA + TB with the noise of the seed, by the automatic choice
    Case 2  from the same logs, by the procedures that identify dynamics and hysteresis apart
    rigid   dynamics of Case 1, springs left out

Robot, library, seed -> `ManyJointsResult`, of any number of joints: the torque of a third random motion that
elimination of two others leaves unexplained. Energy rows separate the parameters of many joints badly: their
condition number stands beside that of elimination.

Not supported: in bounds, cubic springs, damping, noise of the encoders; noise in the control loop; robots
with other than two joints, or whose file lacks the truth.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache, partial
from operator import attrgetter

import numpy as np
import scipy

from symid import excitation, simulation
from symid.arrays import FloatArray, compute_triangle
from symid.codegen import Library, ModelCard, prepare_library
from symid.errors import Notice, UsageError
from symid.identification import elastic
from symid.identification.hysteresis import compute_slips, compute_spring_slopes, filter_smooth, read_weights
from symid.identification.judge import numerics
from symid.identification.regression import warn_of_energy
from symid.joint_models import Elasticity, compute_hysteresis_torque, compute_stop_basis
from symid.logs import Recording, differentiate, differentiate_smooth, low_pass
from symid.robot import Robot
from symid.serialization import HIDDEN, name_key, write_as
from symid.study.monte_carlo import (
    PairedDifference,
    Spread,
    compute_paired_difference,
    compute_spread,
    count_words,
    run_tasks,
)

_JOINTS = 2
TRAINING = "10 x TA + TB"
DATASETS = {"TA": ("TA",), "10 x TA": ("TA10",), "TB": ("TB1", "TB2"), TRAINING: ("TA10", "TB1", "TB2")}
"""Runs that are identified together."""
_TRAJECTORIES: Mapping[str, Callable[[], excitation.Trajectory]] = {
    "TA": excitation.build_ta,
    "TA10": lambda: excitation.scale_trajectory(excitation.build_ta(), 10.0),
    "TB1": lambda: excitation.build_tb(0),
    "TB2": lambda: excitation.build_tb(1),
    "TC": excitation.build_tc,
}
"""TA excites both joints for 20 s, TB1 and TB2 one of them for 50 s; TC, 20 s, is held out."""
AUTOMATIC = "automatic"
_ENCODER = "independent, link encoder"
_RIVALS = ("independent", _ENCODER)
STUDY_METHODS = (*elastic.AUTOMATIC_METHODS, *_RIVALS)
_METHODS = {
    "Case 1: identified together": AUTOMATIC,
    "Case 2: identified apart, motor side": "independent",
    "Case 2 with link encoder": _ENCODER,
}
CASES = (*_METHODS, elastic.RIGID)


_DAMPING = 0.1
"""mu relative to the largest squared singular value of G."""
_SLOW = 0.5
"""Hz; slow motions are below, the pendulums of arms above."""


def split_recordings(signals: Sequence[elastic.ElasticSignals]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the recordings in which all joints move, and the others; all twice where a kind is missing."""
    speeds = [elastic.compute_speeds([part]) for part in signals]
    everything = tuple(range(len(signals)))
    together = tuple(i for i in everything if np.all(speeds[i] > elastic.MOVES * speeds[i].max()))
    apart = tuple(i for i in everything if i not in together)
    return together or everything, apart or everything


def fit_independent(problem: elastic.ElasticProblem, *, encoder: bool = False) -> elastic.MethodFit:
    """Return the dynamics of the first procedure and the hysteresis of the second.

    With `encoder` the torsion is taken from the link encoder too, in place of motor-side samples alone.
    """
    together, apart = split_recordings(problem.signals)
    chi = elastic.solve_with_signs(problem.library.card, *problem.stack_filtered(together), problem.known)
    torsions = {
        number: problem.signals[number].phi if encoder else estimate_virtual_torsion(problem, number, chi)
        for number in apart
    }
    speeds = [elastic.compute_speeds([part]) for part in problem.signals]
    springs = []
    for joint in range(problem.sizes[1]):
        moves = [i for i in apart if speeds[i][joint] > elastic.MOVES * speeds[i].max()]
        used = moves or list(apart)
        signals, rows = [problem.signals[i] for i in used], [problem.filtered[i] for i in used]
        parts = [np.ascontiguousarray(torsions[number][:, joint]) for number in used]
        data = elastic.build_spring_data(problem.options, joint, parts, signals, rows)
        target = np.concatenate([part.compute_motor_side(chi)[:, joint] for part in rows])
        springs.append(problem.fit_spring(joint, data, target))
    fit = elastic.build_method_fit("independent", chi, problem.sizes, tuple(springs))
    return replace(fit, recordings=together)


def estimate_virtual_torsion(problem: elastic.ElasticProblem, number: int, chi: FloatArray) -> FloatArray:
    """Return the torsion (N, n) of recording `number` from motor-side samples and chi alone.

    First where gravity's gradient is large; the linear spring that this gives stands in elsewhere.
    """
    library, signals, rate = problem.library, problem.signals[number], problem.options.filter_rate
    beta = chi[: problem.sizes[0]]
    rows = elastic.build_filtered_rows(library, replace(signals, settled=0), rate)
    step = rows.keep.step
    theta, period, torque = signals.theta[::step], signals.period * step, rows.compute_motor_side(chi)
    # d g / dq (M, n, n) by central differences of the torque at rest.
    turn, rest, columns = 1e-4, np.zeros_like(theta), []
    for shift in turn * np.eye(theta.shape[1]):
        (ahead,) = library.evaluate("lagrange_regressor", theta + shift, rest)
        (behind,) = library.evaluate("lagrange_regressor", theta - shift, rest)
        columns.append((behind @ beta - ahead @ beta) / (2.0 * turn))
    gradient = np.stack(columns, axis=2)
    root = gradient.transpose(0, 2, 1)
    damping = _DAMPING * float(np.linalg.norm(gradient, ord=2, axis=(1, 2)).max()) ** 2
    gain = root @ np.linalg.inv(gradient @ root + damping * np.eye(problem.sizes[1]))
    phi = np.zeros_like(theta)
    sizes = np.maximum(np.linalg.norm(torque, axis=0), numerics.TINY)
    for prior in (False, True):
        if prior:
            # The linear springs that fit best, most of all where gravity's gradient is large.
            slopes = np.diagonal(gradient, axis1=1, axis2=2) ** 2
            moved = np.maximum(np.sum(slopes * torque**2, axis=0), numerics.TINY)
            phi = torque * np.maximum(np.sum(slopes * phi * torque, axis=0) / moved, 0.0)
        left = np.inf
        for _ in range(numerics.ROUNDS):
            q = theta - phi
            dq = differentiate_smooth(q, period)
            (momentum,) = library.evaluate("momentum_regressor", q, dq)
            (lagrange,) = library.evaluate("lagrange_regressor", q, dq)
            link = elastic.filter_derivative(momentum @ beta, rate, period)
            link -= filter_smooth(lagrange @ beta, rate, period)
            # Above a pendulum's frequency inertia outweighs gravity, and the fixed point would run away.
            error = low_pass(link - torque, period=period, cutoff=_SLOW, order=2)
            before, left = left, float(np.sum((error / sizes) ** 2))
            if left >= before:
                break
            phi = phi + np.einsum("kij,kj->ki", gain, error)
    full, grid = np.arange(len(signals.time)), np.arange(len(theta)) * step
    return np.column_stack([np.interp(full, grid, torsion) for torsion in phi.T])


class SensorCondition(Enum):
    """How good the sensors are."""

    CLEAN = "clean"
    NOISY = "noisy"

    def build_options(self) -> simulation.ExperimentOptions:
        """Return the options of a simulation with such sensors."""
        is_clean = self is SensorCondition.CLEAN
        return simulation.build_clean_options() if is_clean else simulation.build_noisy_options()


def simulate_runs(
    robot: Robot, library: Library, condition: SensorCondition
) -> Mapping[str, simulation.ElasticRun]:
    """Return all runs by name, without noise on the torque.

    Raises:
        UsageError: the robot has not two joints, or lacks values.
    """
    if robot.freedom != _JOINTS:
        text = f"these experiments are for robots with {_JOINTS} joints; {robot.name!r} has {robot.freedom}"
        raise UsageError(Notice(code="usage.study-robot", text=text))
    # The noise of these recordings is not used: each seed observes the runs anew.
    rng = np.random.default_rng(0)
    return {
        name: simulation.simulate_elastic(robot, library, build(), condition.build_options(), rng)
        for name, build in _TRAJECTORIES.items()
    }


def observe_runs(
    runs: Mapping[str, simulation.ElasticRun], names: Sequence[str], condition: SensorCondition, seed: int
) -> tuple[Recording, ...]:
    """Return recordings of the runs `names` with the sensors of `condition` and the noise of `seed`.

    A run has the same noise in whatever set it is identified.
    """
    sensors, order = condition.build_options().sensors, list(_TRAJECTORIES)
    return tuple(
        simulation.observe(runs[name], sensors, np.random.default_rng([seed, order.index(name)]))
        for name in names
    )


def get_true_parameters(card: ModelCard) -> FloatArray:
    """Return the true dynamic parameters [beta; rotors; friction] (p + n + pf,).

    Raises:
        UsageError: the robot file does not state all of them.
    """
    values = {entry.name: entry.value for entry in (*card.beta, *card.rotors, *card.friction)}
    beta, friction = ([entry.name for entry in part] for part in (card.beta, card.friction))
    # A joint whose file states no rotor has one nevertheless: chi has an entry for it.
    names = [*beta, *(f"IA{joint.number}" for joint in card.joints if card.elastic), *friction]
    unknown = [name for name in names if values.get(name) is None]
    if unknown:
        text = f"robot {card.robot!r} states no value for {', '.join(unknown)}; a study needs the truth"
        raise UsageError(Notice(code="usage.study-robot", text=text))
    return np.array([values[name] for name in names], dtype=np.float64)


def compute_parameter_error(fit: elastic.MethodFit, truth: FloatArray) -> float:
    """Return the parameter error of a fit in percent; `truth` (p + n + pf,)."""
    known = truth != 0.0
    return float(100.0 * np.max(np.abs(fit.chi[known] / truth[known] - 1.0)))


def compute_hysteresis_errors(fit: elastic.MethodFit, phi: FloatArray, torque: FloatArray) -> FloatArray:
    """Return the hysteresis error of each joint in percent (n,), nan where the method gives no spring.

    `torque` (N, n) is the true one, N m or N, of the torsion `phi` (N, n), rad or m.
    """
    if not fit.elasticity:
        return np.full(phi.shape[1], np.nan)
    left = np.linalg.norm(_compute_torques(fit.elasticity, phi) - torque, axis=0)
    return np.asarray(100.0 * left / np.linalg.norm(torque, axis=0))


def _compute_torques(springs: Sequence[Elasticity], phi: FloatArray) -> FloatArray:
    return np.column_stack(
        [compute_hysteresis_torque(spring, column) for spring, column in zip(springs, phi.T, strict=True)]
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodRun:
    """Errors of one method on one dataset with the noise of one seed, percent; nan where there is none.

    `hysteresis_error` and `excited_error` are those of the worse joint, on the held-out torsion and on the
    same scaled into what the logs excited: a spring cannot be known beyond that. `seconds` are of processor
    time, `chosen` is the method that the automatic choice took.
    """

    method: str
    parameter_error: float
    hysteresis_error: float
    excited_error: float
    outcome: str
    iterations: int
    seconds: float
    chosen: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticScene:
    """What all tasks of a process share: library, true parameters, runs."""

    library: Library
    truth: FloatArray
    runs: Mapping[str, simulation.ElasticRun]


@lru_cache(maxsize=4)
def prepare_elastic_scene(robot: Robot, condition: SensorCondition, backend: str) -> ElasticScene:
    """Return library, truth and runs of a robot; made once in every process."""
    library = prepare_library(robot, backend=backend)
    truth = get_true_parameters(library.card)
    return ElasticScene(library=library, truth=truth, runs=simulate_runs(robot, library, condition))


def fit_all_methods(
    library: Library, recordings: tuple[Recording, ...], methods: Sequence[str]
) -> tuple[dict[str, elastic.MethodFit], dict[str, float]]:
    """Return the fits of all `methods` to the same recordings, and their seconds of processor time.

    The equations that all share are included. Under `AUTOMATIC` stands the automatic choice among those that
    are no rivals, if one could be made.
    """
    begin = time.process_time()
    work = elastic.build_elastic_equations(library, recordings, elastic.ElasticOptions())
    shared = time.process_time() - begin
    fits, seconds = dict[str, elastic.MethodFit](), dict[str, float]()
    for method in methods:
        begin = time.process_time()
        if method in _RIVALS:
            fits[method] = fit_independent(work.problem, encoder=method == _ENCODER)
        else:
            fits[method] = elastic.fit_method(work, method)
        seconds[method] = shared + time.process_time() - begin
    begin = time.process_time()
    usable = [fit for name, fit in fits.items() if name not in _RIVALS and fit.outcome.usable]
    if usable:
        fits[AUTOMATIC] = elastic.choose_fit(work, usable).fit
        own = sum(seconds[fit.method] - shared for fit in usable)
        seconds[AUTOMATIC] = shared + own + time.process_time() - begin
    return fits, seconds


def run_study_task(
    task: tuple[Robot, str, Sequence[str], Sequence[str], SensorCondition, int],
) -> tuple[MethodRun, ...]:
    """Return the errors of every method, and of the automatic choice among them.

    The task has robot, backend, methods, runs that are identified together, sensors, seed of their noise.
    """
    robot, backend, methods, runs, condition, seed = task
    scene = prepare_elastic_scene(robot, condition, backend)
    recordings = observe_runs(scene.runs, runs, condition, seed)
    fits, seconds = fit_all_methods(scene.library, recordings, methods)
    held_out = scene.runs["TC"]
    reach = np.max([np.abs(scene.runs[name].phi).max(axis=0) for name in runs], axis=0)
    excited = held_out.phi * np.minimum(1.0, reach / np.abs(held_out.phi).max(axis=0))
    springs = [spring for spring in scene.library.card.elasticity if spring is not None]
    torque = _compute_torques(springs, excited)

    def choose_worst(fit: elastic.MethodFit, phi: FloatArray, torque: FloatArray) -> float:
        return float(np.max(compute_hysteresis_errors(fit, phi, torque))) if fit.outcome.usable else math.nan

    return tuple(
        MethodRun(
            method=method,
            parameter_error=compute_parameter_error(fit, scene.truth) if fit.outcome.usable else math.nan,
            hysteresis_error=choose_worst(fit, held_out.phi, held_out.joint_torque),
            excited_error=choose_worst(fit, excited, torque),
            outcome=fit.outcome.name.lower(),
            iterations=len(fit.history),
            seconds=seconds[method],
            chosen=fit.method if method == AUTOMATIC else "",
        )
        for method, fit in fits.items()
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodErrors:
    """One method on one dataset: spreads over the seeds, outcomes and choices with how often they came.

    `seconds` is the median processor time, nan where it was not asked for, `iterations` the largest number.
    """

    method: str
    parameter: Spread = field(metadata=name_key("parameter_error_percent"))
    hysteresis: Spread = field(metadata=name_key("hysteresis_error_percent"))
    excited: Spread = field(metadata=name_key("excited_error_percent"))
    seconds: float
    iterations: int
    outcomes: tuple[tuple[str, int], ...] = field(metadata=write_as(dict))
    choices: tuple[tuple[str, int], ...] = field(default=(), metadata=write_as(dict))


def compute_elimination_bound(
    library: Library, signals: Sequence[elastic.ElasticSignals], noise: Sequence[FloatArray]
) -> FloatArray:
    """Return the least covariance (p + n + pf, p + n + pf) that an unbiased estimate of chi can have.

    (sum_k Y_k' Sigma^-1 Y_k)^-1, Y the sum of motor and link equations: torque noise only, white, states
    exact, nothing known of the springs (with their form known the bound is lower).

    `signals` are the noise-free states of every recording, at the sample rate of the noisy ones, `noise` (n,)
    the standard deviation of the torque noise of each, N m or N.
    """
    pairs = zip(signals, noise, strict=True)
    weighted = np.concatenate([_build_exact(library, part) / sigma[:, None] for part, sigma in pairs])
    rows = weighted.reshape(-1, weighted.shape[2])
    information = rows.T @ rows
    scales = np.sqrt(np.maximum(np.diag(information), numerics.TINY))
    sizes = np.outer(scales, scales)
    return np.asarray(np.linalg.inv(information / sizes) / sizes)


def _build_exact(library: Library, part: elastic.ElasticSignals) -> FloatArray:
    """Return the columns (N, n, p + n + pf) at all samples of noise-free states."""
    return elastic.build_equations(library, part, partial(differentiate, period=part.period), np.asarray)


_NULL = 1e-4
"""Of the largest singular value of the link equations; integration leaves 1e-5, what is excited a hundred
times more."""


def compute_spring_bound(
    library: Library, signals: Sequence[elastic.ElasticSignals], noise: Sequence[FloatArray]
) -> FloatArray:
    """Return the least covariance (p + n + pf, p + n + pf) of chi where the form of the springs is known.

    Arguments as those of `compute_elimination_bound`; the card states the true springs of all joints.
    """
    card = library.card
    beta, count = len(card.beta), len(card.beta) + card.size + len(card.friction)
    springs = [read_weights(spring) for spring in card.elasticity if spring is not None]
    motor, link = [], []
    for part, sigma in zip(signals, noise, strict=True):
        # The derivatives (N, n, w) of the springs' torques by all their numbers.
        parts = []
        for joint, weights in enumerate(springs):
            basis = compute_stop_basis(part.phi[:, joint], weights.thresholds)
            slopes = compute_spring_slopes(basis, weights, compute_slips(basis, weights.thresholds))[:, :-1]
            parts.append(np.zeros((len(basis), len(springs), slopes.shape[1])))
            parts[-1][:, joint] = slopes
        torques = np.concatenate(parts, axis=2)
        drive = _build_exact(library, part)[:, :, beta:]
        motor.append(np.concatenate([drive, torques], axis=2) / sigma[:, None])
        # Of links and springs, integrated over windows.
        add = partial(scipy.integrate.cumulative_trapezoid, dx=part.period, axis=0, initial=0.0)
        ends = slice(None, None, max(1, round(elastic.ElasticOptions().window / part.period)))
        links = elastic.build_equations(library, part, np.asarray, add, ends)
        link.append(np.concatenate([links[:, :, :beta], -add(torques)[ends]], axis=2))
    motors, links = (
        np.concatenate([rows.reshape(-1, rows.shape[2]) for rows in side])
        for side in (motor, [np.diff(rows, axis=0) for rows in link])
    )
    # Directions of the null space, with columns scaled to one length.
    lengths = np.linalg.norm(links, axis=0)
    lengths = np.where(lengths > numerics.EXACT * float(lengths.max()), lengths, np.inf)
    _, singular, directions = np.linalg.svd(compute_triangle(links / lengths))
    hidden = directions[singular <= _NULL * singular[0]].T
    null_space = hidden / np.where(np.isfinite(lengths), lengths, 1.0)[:, None]
    # Columns: beta and springs as the link equations leave them, then rotors and friction.
    driven = count - beta
    ways = np.zeros((count + len(null_space) - beta, null_space.shape[1] + driven))
    ways[:beta, :-driven], ways[count:, :-driven] = null_space[:beta], null_space[beta:]
    ways[beta:count, -driven:] = np.eye(driven)
    rows = np.hstack([np.zeros((len(motors), beta)), motors])
    # The length that a column has unless its parts cancel: what cancels to rounding has no effect.
    lengths = np.linalg.norm(np.linalg.norm(rows, axis=0)[:, None] * ways, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    root = (ways[:count] / lengths) @ np.linalg.pinv(rows @ ways / lengths, rcond=numerics.CONVERGED)
    return root @ root.T


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetStudy:
    """All methods on one dataset in one condition.

    `bound` is the largest relative standard deviation of the parameters at the Cramer-Rao bound, in percent:
    torque noise only, states exact, nothing known of the springs; `spring_bound` the same where their form is
    known, as the one-shot problem knows it. Both are nan without noise.
    """

    dataset: str
    condition: SensorCondition = field(metadata=write_as(attrgetter("value")))
    seeds: int
    bound: float = field(metadata=name_key("bound_percent"))
    spring_bound: float = field(metadata=name_key("spring_bound_percent"))
    cells: tuple[MethodErrors, ...] = field(metadata=name_key("methods"))


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticStudy:
    """The whole comparison for one robot."""

    robot: str
    studies: tuple[DatasetStudy, ...]


def study_elastic(
    robot: Robot,
    seeds: Sequence[int],
    *,
    backend: str = "auto",
    datasets: Mapping[str, tuple[str, ...]] = DATASETS,
    methods: tuple[str, ...] = STUDY_METHODS,
    jobs: int | None = None,
    timed: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> ElasticStudy:
    """Return the errors of all methods, clean (one run) and noisy (one run a seed of the noise).

    `methods` are some of `STUDY_METHODS`; `timed`: whether their time is measured; `jobs` and `progress` as
    of `run_tasks`. A UsageError: the robot has not two joints, or its file states no truth.
    """
    kinds = ((SensorCondition.CLEAN, seeds[:1]), (SensorCondition.NOISY, seeds))
    groups = [(name, condition, numbers) for condition, numbers in kinds for name in datasets]
    tasks = [
        (robot, backend, methods, datasets[name], condition, seed)
        for name, condition, numbers in groups
        for seed in numbers
    ]
    # Made before the processes start, so that they do not all compile it.
    scene = prepare_elastic_scene(robot, SensorCondition.NOISY, backend)
    results = iter(run_tasks(run_study_task, tasks, jobs=jobs, progress=progress))
    studies = []
    for name, condition, numbers in groups:
        noisy = condition is SensorCondition.NOISY
        bounds = _compute_bounds(scene, datasets[name]) if noisy else (math.nan, math.nan)
        of = dict(zip(("bound", "spring_bound"), bounds, strict=True))
        cells = _summarise([next(results) for _ in numbers], timed=timed)
        study = DatasetStudy(dataset=name, condition=condition, seeds=len(numbers), cells=cells, **of)
        studies.append(study)
    return ElasticStudy(robot=scene.library.card.robot, studies=tuple(studies))


def _summarise(results: Sequence[tuple[MethodRun, ...]], *, timed: bool) -> tuple[MethodErrors, ...]:
    """Return a cell for every method; `results` has the runs of every seed."""
    return tuple(
        MethodErrors(
            method=runs[0].method,
            parameter=compute_spread([run.parameter_error for run in runs]),
            hysteresis=compute_spread([run.hysteresis_error for run in runs]),
            excited=compute_spread([run.excited_error for run in runs]),
            seconds=float(np.median([run.seconds for run in runs])) if timed else math.nan,
            iterations=max(run.iterations for run in runs),
            outcomes=count_words(run.outcome for run in runs),
            choices=count_words(run.chosen for run in runs),
        )
        for runs in zip(*results, strict=True)
    )


def _compute_bounds(scene: ElasticScene, runs: Sequence[str]) -> tuple[float, float]:
    """Return the largest relative standard deviation, percent, at the bound without and with springs."""
    states, signals, noise = ("q", "dq", "theta", "dtheta"), [], []
    for run in (scene.runs[name] for name in runs):
        exact = {name: getattr(run, name) for name in states}
        exact |= {"time": run.recording.time, "tau": run.torque, "period": run.recording.period}
        signals.append(elastic.ElasticSignals(**exact, settled=0, hold="zero"))
        noise.append(0.02 * np.sqrt(np.mean(run.torque**2, axis=0)))
    known = scene.truth != 0.0
    without, springs = (
        np.sqrt(np.diag(compute(scene.library, signals, noise)))[known] / np.abs(scene.truth[known])
        for compute in (compute_elimination_bound, compute_spring_bound)
    )
    return 100.0 * float(np.max(without)), 100.0 * float(np.max(springs))


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingDifference:
    """RMS of `first` less RMS of `second` at one joint, over the seeds, in the unit of its position."""

    joint: str
    first: str
    second: str
    difference: PairedDifference


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingStudy:
    """Tracking errors of all cases: `rms` of every case and joint, (case, spreads over the seeds).

    `comparisons` are of Case 1 with each other case, joint by joint.
    """

    robot: str
    joints: tuple[str, ...]
    seeds: int
    rms: tuple[tuple[str, tuple[Spread, ...]], ...]
    comparisons: tuple[TrackingDifference, ...]


def _run_seed(task: tuple[Robot, str, int]) -> dict[str, tuple[float, ...]]:
    robot, backend, seed = task
    scene = prepare_elastic_scene(robot, SensorCondition.NOISY, backend)
    recordings = observe_runs(scene.runs, DATASETS[TRAINING], SensorCondition.NOISY, seed)
    fits, _ = fit_all_methods(scene.library, recordings, STUDY_METHODS)
    models = {case: fits[method] for case, method in _METHODS.items()}
    runs = elastic.simulate_tracking(
        robot, scene.library, models, excitation.build_tc(), simulation.build_noisy_options()
    )
    return {run.name: tuple(run.rms.tolist()) for run in runs}


def study_tracking(
    robot: Robot,
    seeds: Sequence[int],
    *,
    backend: str = "auto",
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TrackingStudy:
    """Return the tracking errors of all cases; arguments and errors are those of `study_elastic`."""
    prepare_elastic_scene(robot, SensorCondition.NOISY, backend)
    results = run_tasks(_run_seed, [(robot, backend, seed) for seed in seeds], jobs=jobs, progress=progress)
    rms = {case: np.array([result[case] for result in results]) for case in CASES}
    joints, (first, *others) = tuple(joint.name for joint in robot.axes), CASES
    return TrackingStudy(
        robot=robot.name,
        joints=joints,
        seeds=len(seeds),
        rms=tuple((case, tuple(compute_spread(column) for column in rms[case].T)) for case in CASES),
        comparisons=tuple(
            TrackingDifference(
                joint=name, first=first, second=other, difference=compute_paired_difference(*pair)
            )
            for other in others
            for name, *pair in zip(joints, rms[first].T, rms[other].T, strict=True)
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """What one method leaves of the held-out torque, percent of its RMS, joint by joint.

    `floor` is the same with the true parameters: the noise of the sensors.
    """

    method: str
    residual: tuple[float, ...]
    floor: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ManyJointsResult:
    """One condition of the sensors; `parameters` counts the dynamic ones that were identified.

    `condition_elimination` and `condition_energy` are condition numbers of the column-scaled rows.
    """

    robot: str
    joints: tuple[str, ...]
    condition: SensorCondition = field(metadata=write_as(attrgetter("value")))
    parameters: int
    methods: tuple[HeldOut, ...]
    condition_elimination: float
    condition_energy: float
    notices: tuple[Notice, ...] = field(metadata=HIDDEN)


def study_many_joints(
    robot: Robot, library: Library, condition: SensorCondition, seed: int, *, duration: float = 20.0
) -> ManyJointsResult:
    """Return what elimination leaves of a held-out motion; `duration` of each in s.

    A UsageError: the robot file lacks values, or joints are not all elastic.
    """
    truth = get_true_parameters(library.card)
    rng, motion = np.random.default_rng(seed), excitation.FourierOptions(duration=duration)
    trajectories = [excitation.build_random_fourier(robot, rng, motion) for _ in range(3)]
    # The springs are not looked at: the coarsest will do.
    options, signals = elastic.ElasticOptions(refine=False, knees=0), list[elastic.ElasticSignals]()
    for trajectory in trajectories:
        run = simulation.simulate_elastic(robot, library, trajectory, condition.build_options(), rng)
        signals.append(elastic.prepare_elastic_signals(run.recording, options))
    problem = elastic.build_elastic_problem(library, signals[:-1], options)
    test = elastic.build_elastic_problem(library, signals[-1:], options)
    design, torque = test.stack_filtered()

    def compute_shares(chi: FloatArray) -> tuple[float, ...]:
        left = np.linalg.norm(torque - design @ chi, axis=0)
        return tuple((100.0 * left / np.linalg.norm(torque, axis=0)).tolist())

    rows, fit = problem.stack_filtered()[0].reshape(-1, len(truth)), elastic.fit_elimination(problem)
    return ManyJointsResult(
        robot=robot.name,
        joints=tuple(joint.name for joint in robot.axes),
        condition=condition,
        parameters=len(truth),
        methods=(HeldOut(method=fit.method, residual=compute_shares(fit.chi), floor=compute_shares(truth)),),
        condition_elimination=_compute_condition(rows),
        condition_energy=_compute_condition(problem.design),
        notices=warn_of_energy(library.card.size),
    )


def _compute_condition(matrix: FloatArray) -> float:
    lengths = np.linalg.norm(matrix, axis=0)
    return float(np.linalg.cond(matrix[:, lengths > 0.0] / lengths[lengths > 0.0]))
