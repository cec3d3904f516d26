"""Output error of one axis: mass, friction and other forces fitted to the measured motion by simulation.

    M dv/dt = u - Phi(v, x, u; s) c,    dx/dt = v,    u constant between samples
    min over values of  sum over windows, sum over k > 20 of (x(k; values) - x_measured(k))^2

Each step is the exact solution of the equation linearised at its start, and ends where the velocity changes
its sign: exact to rounding for friction that is linear in the velocity by direction, to the third power of
the step for other laws. At rest the axis stays while the force lies between the friction on its two sides.
A window starts from a parabola through its first 20 samples. Values fitted in short windows are the start for
long ones, whose error has many local minima. Models are compared on held-out blocks of the run.

Supported: static laws, with the terms of `AXIS_TERMS`, but those whose slope at standstill is infinite
(power law, exponent below one); no standard deviations: errors of a simulated position are not independent.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import casadi
import numpy as np
from scipy.optimize import least_squares

from symid.arrays import FloatArray
from symid.identification.friction.joint_fit import FrictionEstimate, FrictionSamples, build_reduction
from symid.identification.friction.selection import predict_rows
from symid.identification.judge import POLICY, numerics
from symid.identification.regression import solve_scaled
from symid.identification.rigid import choose_plainest
from symid.joint_models import Carrier, FrictionLaw, build_casadi_carrier, build_numpy_carrier
from symid.logs import Recording, differentiate, low_pass, prepare_signals
from symid.robot import Processing

V = TypeVar("V")

_SERIES = 2e-2
"""Size of an argument below which a quotient is a series, whose derivative is as exact."""

AXIS_TERMS: dict[str, Callable[[Any, Mapping[str, Any]], Any]] = {
    "offset": lambda carrier, _: carrier.one,
    "drift": lambda _, inputs: inputs["time"],
    "spring": lambda _, inputs: inputs["position"],
    # Dry friction that changes with the position, and with its square.
    "slope": lambda carrier, inputs: carrier.mul(carrier.sign(inputs["velocity"]), inputs["position"]),
    "bend": lambda carrier, inputs: carrier.mul(AXIS_TERMS["slope"](carrier, inputs), inputs["position"]),
}
"""Forces beside the law, linear in one value each: columns from velocity, position and time."""


def compute_relative_residual(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> float:
    """Return the residual of an estimate on the rows of `samples`, in percent of their norm."""
    torque = samples.rows.torque
    left = torque - predict_rows(samples, law, estimate)
    return 100.0 * float(np.linalg.norm(left) / np.linalg.norm(torque))


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisModel:
    """A mass, a law of friction, and forces beside it (names of `AXIS_TERMS`)."""

    law: FrictionLaw
    terms: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Return the law's name and those of the terms."""
        return " + ".join((self.law.name, *self.terms))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of all values: the mass M, linear values, the law's shape."""
        linear = [parameter.name for parameter in self.law.linear]
        return ("M", *linear, *self.terms, *(parameter.name for parameter in self.law.shape))

    def list_columns(self, carrier: Carrier[V], inputs: Mapping[str, V], shape: Sequence[V]) -> tuple[V, ...]:
        """Return the columns of the law, then of the terms."""
        beside = (AXIS_TERMS[name](carrier, inputs) for name in self.terms)
        return (*self.law.columns(carrier, inputs, shape), *beside)


def compute_force_columns(
    model: AxisModel, inputs: Mapping[str, FloatArray], shape: Sequence[float] = ()
) -> FloatArray:
    """Return the columns (N, p) of the linear values without the mass, law first, then terms.

    `inputs` (N,) each: velocity, position, load and time; `shape`: values of the law.
    """
    lifted: list[FloatArray] = [np.asarray(value) for value in shape]
    columns = model.list_columns(build_numpy_carrier(), inputs, lifted)
    return np.column_stack([np.broadcast_to(column, inputs["velocity"].shape) for column in columns])


def simulate_axis(
    model: AxisModel,
    values: FloatArray,
    force: FloatArray,
    period: float,
    start: tuple[float, float, float],
    *,
    rates: bool = False,
) -> FloatArray:
    """Return positions and velocities at the samples of a force, and their derivatives: (2, N) or more.

    `values` (p,) are the model's `parameters`; `force` (N,) N m or N is held over each `period` (s); `start`:
    position, velocity and time at the first sample. `rates` adds exact derivatives: p rows of dx/dvalues, p
    of dv/dvalues.
    """
    state = np.zeros(2 * (1 + len(values)) if rates else 2)
    state[:2] = start[:2]
    if len(force) == 1:
        return state[:, None]
    inputs = np.vstack([force[:-1], start[2] + period * np.arange(len(force) - 1)])
    run = _build_run(model, len(inputs[0]), period, rates=rates)
    return np.column_stack([state, np.asarray(run(state, inputs, values))])


@lru_cache(maxsize=64)
def _build_run(model: AxisModel, steps: int, period: float, *, rates: bool) -> Any:  # a function of casadi
    count = len(model.parameters)
    state, inputs = casadi.SX.sym("z", 2), casadi.SX.sym("u", 2)
    values = casadi.SX.sym("p", count)
    # (v, x, u, t, values) -> all that brakes, and its derivative by v.
    own = {name: casadi.SX.sym(name) for name in ("velocity", "position", "load", "time")}
    linear = 1 + len(model.law.linear) + len(model.terms)
    shape = [values[k] for k in range(linear, count)]
    columns = model.list_columns(build_casadi_carrier(), own, shape)
    total = sum((values[1 + k] * column for k, column in enumerate(columns)), casadi.SX(0.0))
    slope = casadi.jacobian(total, own["velocity"])
    friction = casadi.Function("friction", [*own.values(), values], [total, slope])
    after = _move(friction, state, inputs[0], inputs[1], values, period)
    if not rates:
        return casadi.Function("step", [state, inputs, values], [after]).mapaccum("run", steps)
    by_values = casadi.SX.sym("s", 2, count)
    moved = casadi.jacobian(after, state) @ by_values + casadi.jacobian(after, values)
    pairs = ((state, by_values), (after, moved))
    whole, result = (casadi.vertcat(own, casadi.vec(rate.T)) for own, rate in pairs)
    step = casadi.Function("step", [whole, inputs, values], [casadi.densify(result)], {"cse": True})
    return step.mapaccum("run", steps)


def _move(friction: Any, state: Any, force: Any, time: Any, values: Any, period: float) -> Any:  # noqa: PLR0917  # expressions of casadi
    """Return the state after a step: one motion, or one up to rest and what follows."""
    position, speed = state[0], state[1]
    # Where the axis is halfway: forces of the position are right to the square of the step.
    half = position + 0.5 * period * speed
    moment = time + 0.5 * period

    def compute_side(place: Any) -> Any:
        above, _ = friction(numerics.EXACT, place, force, moment, values)
        below, _ = friction(-numerics.EXACT, place, force, moment, values)
        return (force > above) - (force < below)

    def compute_motion(speed: Any, side: Any, place: Any) -> tuple[Any, Any]:
        near = side * casadi.fmax(casadi.fabs(speed), numerics.EXACT)
        brake, slope = friction(near, place, force, moment, values)
        moving = casadi.fabs(side)
        return moving * (force - brake) / values[0], moving * slope / values[0]

    at_rest = speed == 0.0
    side = casadi.if_else(at_rest, compute_side(half), casadi.sign(speed))
    pull, rate = compute_motion(speed, side, half)
    gain, way = _compute_gains(rate, period)
    free_speed, free_position = speed + gain * pull, position + period * speed + way * pull
    stops = casadi.logic_and(casadi.logic_not(at_rest), free_speed * side < 0.0)
    # The root of speed + pull (1 - exp(-rate t)) / rate, by log1p(y) / y, y = rate speed / pull.
    plain = -speed / casadi.if_else(stops, pull, 1.0)
    y = casadi.if_else(stops, -rate * plain, 0.0)
    small = casadi.fabs(y) < _SERIES
    safe = casadi.if_else(small, 1.0, y)
    series = sum((-y) ** k / (k + 1) for k in range(9))
    root = plain * casadi.if_else(small, series, casadi.log1p(safe) / safe)
    moment_of_rest = casadi.if_else(stops, root, 0.0)
    _, way = _compute_gains(rate, moment_of_rest)
    rest = position + moment_of_rest * speed + way * pull
    left = period - moment_of_rest
    pull, rate = compute_motion(0.0, compute_side(rest), rest)
    gain, way = _compute_gains(rate, left)
    after = rest + way * pull, gain * pull
    return casadi.vertcat(*map(partial(casadi.if_else, stops), after, (free_position, free_speed)))


def _compute_gains(rate: Any, time: Any) -> tuple[Any, Any]:  # expressions of casadi
    """Return the integral of exp(-rate t) over a time, and the integral of that."""
    z = -rate * time
    small = casadi.fabs(z) < _SERIES
    safe = casadi.if_else(small, 1.0, z)
    series = 0.5 * (1 + z / 3 * (1 + z / 4 * (1 + z / 5 * (1 + z / 6 * (1 + z / 7)))))
    second = casadi.if_else(small, series, (casadi.expm1(safe) - safe) / (safe * safe))
    return (1 + z * second) * time, second * time * time


GIVEN = 20
"""Samples that a simulation may look at."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisRun:
    """A recording of one axis: position (N,) m or rad, force (N,) N or N m, times in s."""

    position: FloatArray
    force: FloatArray
    period: float
    begin: float


class Window(NamedTuple):
    """Samples first .. last - 1 of a run."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class OutputErrorFit:
    """Values of the model's `parameters`; RMS error, m or rad; simulations from all starts."""

    names: tuple[str, ...]
    values: tuple[float, ...]
    rmse: float
    evaluations: int
    converged: bool


def split_windows(windows: Sequence[Window], samples: float) -> tuple[Window, ...]:
    """Return the same samples in windows of equal length near `samples`, none across two of those given."""
    parts = []
    for window in windows:
        length = window.last - window.first
        count = max(1, min(round(length / samples), length // (2 * GIVEN)))
        edges = [window.first + round(k * length / count) for k in range(count + 1)]
        parts += [Window(first=a, last=b) for a, b in pairwise(edges)]
    return tuple(parts)


def compute_output_error(
    model: AxisModel,
    values: FloatArray,
    run: AxisRun,
    windows: Sequence[Window],
    left_out: Window | None = None,
    *,
    rates: bool = False,
) -> FloatArray:
    """Return simulated less measured position (M,) behind the first 20 samples of each window, m or rad.

    With `rates` the derivatives (M, p) by the values. Samples of `left_out` are simulated, but not returned.
    """
    parts, skipped = [], left_out or Window(0, 0)
    for window in windows:
        samples = np.arange(window.first + GIVEN, window.last)
        counted = (samples < skipped.first) | (samples >= skipped.last)
        force = run.force[window.first + GIVEN - 1 : window.last]
        moments = run.period * (np.arange(GIVEN) - (GIVEN - 1))
        curve = np.polyfit(moments, run.position[window.first : window.first + GIVEN], 2)
        start = float(curve[2]), float(curve[1]), run.begin + run.period * (window.first + GIVEN - 1)
        states = simulate_axis(model, values, force, run.period, start, rates=rates)[:, 1:]
        part = states[2 : 2 + len(values)].T if rates else states[0] - run.position[samples]
        parts.append(part[counted])
    # Of a simulation that diverged.
    worst = float(np.ptp(run.position)) / numerics.CONVERGED
    return np.asarray(np.clip(np.nan_to_num(np.concatenate(parts), nan=worst), -worst, worst))


def compute_window_rmse(model: AxisModel, values: FloatArray, run: AxisRun) -> float:
    """Return the root mean square of `compute_output_error` of the whole run, m or rad."""
    errors = compute_output_error(model, values, run, [Window(0, len(run.force))])
    return float(np.sqrt(np.mean(np.square(errors))))


def fit_output_error(
    model: AxisModel,
    run: AxisRun,
    windows: Sequence[Window],
    starts: Sequence[FloatArray],
    *,
    left_out: Window | None = None,
) -> OutputErrorFit:
    """Return the values with the least error of position, the best from several `starts` (p,) each.

    Errors of samples in `left_out` do not count.
    """
    linear, free, shape = model.law.linear, [np.inf] * len(model.terms), model.law.shape
    # The first value is the mass.
    lower = np.array([0.0, *(one.lower for one in linear), *np.negative(free), *(one.lower for one in shape)])
    upper = np.array([np.inf, *(one.upper for one in linear), *free, *(one.upper for one in shape)])
    compute = partial(compute_output_error, model, run=run, windows=windows, left_out=left_out)
    options = {"x_scale": "jac", "xtol": 1e-7, "ftol": 1e-7, "gtol": None, "max_nfev": 40}
    fits = []
    for start in starts:
        room = 1e-6 * np.maximum(np.abs(start), 1e-3)
        inside, bounds = np.clip(start, lower + room, upper - room), (lower, upper)
        fits.append(least_squares(compute, inside, partial(compute, rates=True), bounds, **options))
    best = min(fits, key=lambda fit: float(fit.cost))
    values, rmse = tuple(best.x.tolist()), float(np.sqrt(np.mean(np.square(best.fun))))
    count, converged = sum(int(fit.nfev) for fit in fits), bool(best.status > 0)
    return OutputErrorFit(model.parameters, values, rmse, count, converged)


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchPlan:
    """How a fit to a whole run is searched.

    A fit of forces with states low-passed at `cutoff` Hz comes first, from a law's `shape`; then windows of
    `lengths` s, short ones first; then `restarts` scattered by 2 % about the values found in windows.
    """

    cutoff: float
    lengths: tuple[float, ...]
    shape: tuple[float, ...] = ()
    restarts: int


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisTrial:
    """A model, and the RMS error of the position in each part of held-out blocks, m or rad."""

    model: AxisModel
    held: tuple[float, ...]

    @property
    def rmse(self) -> float:
        """Return the RMS over the parts, m or rad."""
        return float(np.sqrt(np.mean(np.square(self.held))))


def fit_whole_run(
    model: AxisModel,
    run: AxisRun,
    plan: SearchPlan,
    *,
    left_out: Window | None = None,
    generator: np.random.Generator,
) -> OutputErrorFit:
    """Return the fit to a run simulated as one window, started from a fit of forces, then of shorter windows.

    No fit uses the samples `left_out`; `generator` draws the restarts.
    """
    whole, skipped = Window(0, len(run.force)), left_out or Window(0, 0)
    sides = Window(0, skipped.first), Window(skipped.last, whole.last)
    parts = [side for side in sides if side.last > side.first]
    position = low_pass(run.position, period=run.period, cutoff=plan.cutoff, order=4)
    velocity = differentiate(position, run.period)
    # The values with the least error of force, for a law's shape.
    rows, shape = np.concatenate([np.arange(*side) for side in parts]), plan.shape[: len(model.law.shape)]
    inputs = {"velocity": velocity[rows], "position": position[rows], "load": run.force[rows]}
    inputs["time"] = run.begin + run.period * rows
    columns = [differentiate(velocity, run.period)[rows], compute_force_columns(model, inputs, shape)]
    start = np.append(solve_scaled(np.column_stack(columns), run.force[rows]), shape)
    for length in plan.lengths:
        windows = split_windows(parts, length / run.period)
        start = np.array(fit_output_error(model, run, windows, [start]).values)
    scatter = (0.02 * generator.standard_normal(len(start)) for _ in range(plan.restarts))
    starts = [start, *(start * (1.0 + part) for part in scatter)]
    return fit_output_error(model, run, [whole], starts, left_out=left_out)


def try_axis_model(
    model: AxisModel, run: AxisRun, plan: SearchPlan, *, generator: np.random.Generator
) -> AxisTrial:
    """Return the error in each block of a fit to all others, part by part; arguments as for `fit_whole_run`.

    The simulation passes through the block, as long and as far from its start as in use.
    """
    whole = Window(0, len(run.force))
    held = []
    for block in split_windows([whole], len(run.force) / POLICY.folds):
        fit = fit_whole_run(model, run, plan, left_out=block, generator=generator)
        errors = compute_output_error(model, np.array(fit.values), run, [whole])
        # The first samples are given: there is no error of them.
        inside = errors[max(block.first - GIVEN, 0) : block.last - GIVEN]
        held += [float(np.sqrt(np.mean(part**2))) for part in np.array_split(inside, POLICY.parts)]
    return AxisTrial(model=model, held=tuple(held))


def choose_axis_trial(trials: Sequence[AxisTrial]) -> AxisTrial:
    """Return the trial of the fewest values that the best one does not surely surpass."""
    models = [trial.model for trial in trials]
    counts = [(len(model.parameters), len(model.law.shape)) for model in models]
    choice = choose_plainest(np.square([trial.held for trial in trials]), *zip(*counts, strict=True))
    return trials[choice.taken]


def build_axis_samples(
    recording: Recording, processing: Processing, *, terms: Sequence[str] = ()
) -> FrictionSamples:
    """Return the samples of a prismatic axis, with its mass as unknown and `terms` beside it."""
    signals = prepare_signals(recording, processing)
    position, velocity = signals.q[:, 0], signals.dq[:, 0]
    inputs = {"velocity": velocity, "position": position, "time": signals.time}
    columns = (AXIS_TERMS[name](build_numpy_carrier(), inputs) for name in terms)
    beside = (np.broadcast_to(column, velocity.shape) for column in columns)
    return FrictionSamples(
        joint="axis",
        time=signals.time,
        velocity=velocity,
        torque=signals.tau[:, 0],
        extra=np.column_stack([signals.ddq[:, 0], *beside]),
        extra_names=("M", *terms),
        load=signals.tau[:, 0],
        position=position,
        reduce=build_reduction([len(velocity)], processing.decimation),
        prismatic=True,
    )


def build_axis_run(recording: Recording) -> AxisRun:
    """Return position and force of an axis as recorded."""
    position, force, begin = recording.position[:, 0], recording.torque[:, 0], float(recording.time[0])
    return AxisRun(position=position, force=force, period=recording.period, begin=begin)
