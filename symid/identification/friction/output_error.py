"""Output error of one axis: mass, friction and other forces that make its simulated motion the measured one.

AxisModel, force at every sample -> positions, velocities, their derivatives; AxisRun, AxisModel ->
OutputErrorFit.

    M dv/dt = u - Phi(v, x, u; s) c,    dx/dt = v,    u constant between samples
    min over values of  sum over windows, sum over k > 20 of (x(k; values) - x_measured(k))^2

Each step is the exact solution of the equation linearised at its start, and ends where the velocity
changes its sign: x and v follow from (exp(z) - 1) / z and its integral, the moment of rest from a
logarithm. Friction that is linear in the velocity by direction is exact to rounding; other laws to the
third power of the step. At rest the axis stays as long as the force lies between the friction on its two
sides. A window is simulated without feedback from a parabola through its first 20 samples. The error of a
long run has many dips, one for every moment of rest: values found with short windows are a good start for
long ones.

Supported: every static law, with offset, drift of the offset, a spring, and dry friction that changes
with the position; derivatives of the steps, moments of rest included; one run, cut into windows of any
length.
Not supported: laws whose slope at standstill is infinite (power law, exponent below one); elastic drives;
standard deviations, for errors of a simulated position are nothing like independent.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.errors import LogError, Notice, UsageError
from symid.joint_models import (
    FrictionCarrier,
    FrictionLaw,
    LawParameter,
    OperatorFriction,
    build_numpy_carrier,
)

V = TypeVar("V")

_AT_REST = 1e-12
"""Speed in m/s or rad/s at which a law tells its friction on either side of rest."""
_SERIES_FIRST = 1e-4
_SERIES_SECOND = 2e-2


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisTerm:
    """A force beside the law, linear in one parameter: its column from velocity, position and time."""

    parameter: LawParameter
    column: Callable[[FrictionCarrier[V], Mapping[str, V]], V]


def _build_term(
    name: str, latex: str, unit: tuple[str, str], meaning: str, column: Callable[..., Any]
) -> AxisTerm:
    parameter = LawParameter(name=name, latex=latex, unit=unit[0], unit_prismatic=unit[1], meaning=meaning)
    return AxisTerm(parameter=parameter, column=column)


def _compute_slope(carrier: FrictionCarrier[V], inputs: Mapping[str, V]) -> V:
    return carrier.mul(carrier.sign(inputs["velocity"]), inputs["position"])


def _compute_bend(carrier: FrictionCarrier[V], inputs: Mapping[str, V]) -> V:
    return carrier.mul(_compute_slope(carrier, inputs), inputs["position"])


AXIS_TERMS: dict[str, AxisTerm] = {
    term.parameter.name: term
    for term in (
        _build_term(
            "offset", r"\tau_0", ("N m", "N"), "constant force", lambda carrier, _inputs: carrier.one
        ),
        _build_term(
            "drift",
            r"\dot\tau_0",
            ("N m/s", "N/s"),
            "change of the offset with time",
            lambda _carrier, inputs: inputs["time"],
        ),
        _build_term(
            "spring",
            "k",
            ("N m/rad", "N/m"),
            "force in proportion to the position",
            lambda _carrier, inputs: inputs["position"],
        ),
        _build_term(
            "slope", "F_{C1}", ("N m/rad", "N/m"), "change of dry friction with the position", _compute_slope
        ),
        _build_term(
            "bend",
            "F_{C2}",
            ("N m/rad^2", "N/m^2"),
            "change of dry friction with the square of the position",
            _compute_bend,
        ),
    )
}


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisModel:
    """A mass, a law of friction, and forces beside it (names of `AXIS_TERMS`).

    Raises:
        UsageError: a term is not known, stands twice, or is the offset that the law already has.
    """

    law: FrictionLaw
    terms: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the terms."""
        taken = {parameter.name for parameter in self.law.linear}
        wrong = [
            name
            for k, name in enumerate(self.terms)
            if name not in AXIS_TERMS or name in taken or name in self.terms[:k]
        ]
        if wrong:
            text = f"terms {', '.join(wrong)}: each may stand once, in the law or beside it; there are "
            text += ", ".join(AXIS_TERMS)
            raise UsageError(Notice(code="usage.axis-term", text=text))

    @property
    def name(self) -> str:
        """Return the law's name and those of the terms."""
        return " + ".join((self.law.name, *self.terms))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of all values: the mass M, those the force is linear in, the law's shape."""
        linear = [parameter.name for parameter in self.law.linear]
        return ("M", *linear, *self.terms, *(parameter.name for parameter in self.law.shape))


def compute_force_columns(
    model: AxisModel, inputs: Mapping[str, FloatArray], shape: Sequence[float] = ()
) -> FloatArray:
    """Return the columns (N, p) that the force is linear in beside the mass, law first, then terms.

    `inputs` (N,) each: velocity, position, load and time; `shape`: values of the law.
    """
    lifted: list[FloatArray] = [np.asarray(value) for value in shape]
    columns = _list_columns(model, build_numpy_carrier(), inputs, lifted)
    return np.column_stack([np.broadcast_to(column, inputs["velocity"].shape) for column in columns])


def compute_axis_terms(terms: Sequence[str], inputs: Mapping[str, FloatArray]) -> tuple[FloatArray, ...]:
    """Return the columns (N,) of terms by name; `inputs` (N,) each: velocity, position and time."""
    carrier = build_numpy_carrier()
    shape = inputs["velocity"].shape
    return tuple(np.broadcast_to(AXIS_TERMS[name].column(carrier, inputs), shape) for name in terms)


def _list_columns(
    model: AxisModel, carrier: FrictionCarrier[V], inputs: Mapping[str, V], shape: Sequence[V]
) -> tuple[V, ...]:
    beside = (AXIS_TERMS[name].column(carrier, inputs) for name in model.terms)
    return (*model.law.columns(carrier, inputs, shape), *beside)


def simulate_axis(
    model: AxisModel,
    values: FloatArray,
    force: FloatArray,
    period: float,
    start: tuple[float, float, float],
    *,
    substeps: int = 1,
) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities (N,) at the samples of a force.

    Args:
        model: of the axis.
        values: (p,) in the order of its `parameters`.
        force: (N,) N m or N; held from its sample to the next.
        period: of the samples in s.
        start: position, velocity and time at the first sample.
        substeps: of each period; one is exact for laws that are linear by direction.
    """
    state = np.array(start[:2])
    if len(force) == 1:
        return state[:1].copy(), state[1:].copy()
    run = _build_run(model, len(force) - 1, period, substeps, rates=False)
    found = np.asarray(run(state, _build_inputs(force, period, start[2]), values))
    return np.concatenate([state[:1], found[0]]), np.concatenate([state[1:], found[1]])


def compute_axis_rates(
    model: AxisModel, values: FloatArray, force: FloatArray, period: float, start: tuple[float, float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return positions (N,) and their exact derivatives (N, p) by the values; see `simulate_axis`."""
    count = len(values)
    state = np.zeros(2 * (1 + count))
    state[:2] = start[:2]
    rates = np.zeros((len(force), count))
    if len(force) == 1:
        return state[:1].copy(), rates
    run = _build_run(model, len(force) - 1, period, 1, rates=True)
    found = np.asarray(run(state, _build_inputs(force, period, start[2]), values))
    rates[1:] = found[2 : 2 + count].T
    return np.concatenate([state[:1], found[0]]), rates


def _build_inputs(force: FloatArray, period: float, start: float) -> FloatArray:
    return np.vstack([force[:-1], start + period * np.arange(len(force) - 1)])


@lru_cache(maxsize=64)
def _build_run(model: AxisModel, steps: int, period: float, substeps: int, *, rates: bool) -> Any:  # noqa: ANN401  # a function of casadi
    """Return (state, inputs (2, steps), values) -> states (., steps); with `rates`, derivatives behind them.

    The state is (x, v), then dx/dvalues, then dv/dvalues.
    """
    step = _build_step(model, period, substeps, rates=rates)
    return step.mapaccum("run", steps)


@lru_cache(maxsize=64)
def _build_step(model: AxisModel, period: float, substeps: int, *, rates: bool) -> Any:  # noqa: ANN401  # a function of casadi
    import casadi

    count = len(model.parameters)
    state, inputs = casadi.SX.sym("z", 2), casadi.SX.sym("u", 2)
    values = casadi.SX.sym("p", count)
    friction = _build_friction(model)
    short = period / substeps
    after = state
    for k in range(substeps):
        after = _move(friction, after, inputs[0], inputs[1] + k * short, values, short)
    if not rates:
        return casadi.Function("step", [state, inputs, values], [after], {"allow_free": False})
    by_position, by_speed = casadi.SX.sym("sx", 1, count), casadi.SX.sym("sv", 1, count)
    jacobian = casadi.jacobian(after, state)
    moved = jacobian @ casadi.vertcat(by_position, by_speed) + casadi.jacobian(after, values)
    whole = casadi.vertcat(state, by_position.T, by_speed.T)
    result = casadi.vertcat(after, moved[0, :].T, moved[1, :].T)
    return casadi.Function("step", [whole, inputs, values], [casadi.densify(result)], {"cse": True})


def _build_carrier() -> OperatorFriction[Any]:
    import casadi

    return OperatorFriction(
        zero=casadi.SX(0.0),
        one=casadi.SX(1.0),
        exp=casadi.exp,
        tanh=casadi.tanh,
        sin=casadi.sin,
        cos=casadi.cos,
        sign=casadi.sign,
        absolute=casadi.fabs,
        maximum=casadi.fmax,
        minimum=casadi.fmin,
    )


def _build_friction(model: AxisModel) -> Any:  # noqa: ANN401  # a function of casadi
    """Return (v, x, u, t, values) -> all that brakes, and its derivative by v."""
    import casadi

    carrier = _build_carrier()
    names = ("velocity", "position", "load", "time")
    inputs = {name: casadi.SX.sym(name) for name in names}
    values = casadi.SX.sym("p", len(model.parameters))
    linear = len(model.law.linear) + len(model.terms)
    shape = [values[1 + linear + k] for k in range(len(model.law.shape))]
    columns = _list_columns(model, carrier, inputs, shape)
    total = sum((values[1 + k] * column for k, column in enumerate(columns)), casadi.SX(0.0))
    slope = casadi.jacobian(total, inputs["velocity"])
    return casadi.Function("friction", [*inputs.values(), values], [total, slope])


def _move(friction: Any, state: Any, force: Any, time: Any, values: Any, period: float) -> Any:  # noqa: ANN401, PLR0917  # expressions of casadi
    """Return the state after a step: one motion, or one up to rest and what follows."""
    import casadi

    position, speed = state[0], state[1]
    # Where the axis is halfway: forces of the position are right to the square of the step.
    half = position + 0.5 * period * speed
    moment = time + 0.5 * period

    def find_side(place: Any) -> Any:  # noqa: ANN401
        above, _ = friction(_AT_REST, place, force, moment, values)
        below, _ = friction(-_AT_REST, place, force, moment, values)
        return (force > above) - (force < below)

    def find_motion(speed: Any, side: Any, place: Any) -> tuple[Any, Any]:  # noqa: ANN401
        near = side * casadi.fmax(casadi.fabs(speed), _AT_REST)
        brake, slope = friction(near, place, force, moment, values)
        moving = casadi.fabs(side)
        return moving * (force - brake) / values[0], moving * slope / values[0]

    at_rest = speed == 0.0
    side = casadi.if_else(at_rest, find_side(half), casadi.sign(speed))
    pull, rate = find_motion(speed, side, half)
    gain, way = _compute_gains(rate, period)
    free_speed, free_position = speed + gain * pull, position + period * speed + way * pull
    stops = casadi.logic_and(casadi.logic_not(at_rest), free_speed * side < 0.0)
    moment_of_rest = _compute_time_to_rest(speed, pull, rate, stops)
    _, way = _compute_gains(rate, moment_of_rest)
    rest = position + moment_of_rest * speed + way * pull
    left = period - moment_of_rest
    pull, rate = find_motion(0.0, find_side(rest), rest)
    gain, way = _compute_gains(rate, left)
    return casadi.vertcat(
        casadi.if_else(stops, rest + way * pull, free_position),
        casadi.if_else(stops, gain * pull, free_speed),
    )


def _compute_gains(rate: Any, time: Any) -> tuple[Any, Any]:  # noqa: ANN401  # expressions of casadi
    """Return the integral of exp(-rate t) over a time, and the integral of that."""
    import casadi

    z = -rate * time
    small = casadi.fabs(z) < _SERIES_FIRST
    safe = casadi.if_else(small, 1.0, z)
    first = casadi.if_else(small, 1 + z / 2 * (1 + z / 3 * (1 + z / 4)), casadi.expm1(safe) / safe)
    little = casadi.fabs(z) < _SERIES_SECOND
    safe = casadi.if_else(little, 1.0, z)
    series = 0.5 * (1 + z / 3 * (1 + z / 4 * (1 + z / 5 * (1 + z / 6 * (1 + z / 7)))))
    second = casadi.if_else(little, series, (casadi.expm1(safe) - safe) / (safe * safe))
    return first * time, second * time * time


def _compute_time_to_rest(speed: Any, pull: Any, rate: Any, stops: Any) -> Any:  # noqa: ANN401  # expressions of casadi
    """Return when speed + pull (1 - exp(-rate t)) / rate is zero: -speed / pull log(1 + y) / y.

    y = rate speed / pull.
    """
    import casadi

    plain = -speed / casadi.if_else(stops, pull, 1.0)
    y = casadi.if_else(stops, -rate * plain, 0.0)
    small = casadi.fabs(y) < _SERIES_FIRST
    safe = casadi.if_else(small, 1.0, y)
    series = 1 - y / 2 + y * y / 3 - y * y * y / 4
    return casadi.if_else(stops, plain * casadi.if_else(small, series, casadi.log1p(safe) / safe), 0.0)


GIVEN = 20
"""Samples that a simulation may look at."""
_FEWEST = 2 * GIVEN
_EVALUATIONS = 40
_TOLERANCE = 1e-7
_WORST = 1e3
"""Error in m or rad that stands for a simulation that left all bounds."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisRun:
    """A recording of one axis.

    Args:
        position: (N,) m or rad. force: (N,) N or N m. period: of the samples in s.
        begin: time of the first sample in s.
    """

    position: FloatArray
    force: FloatArray
    period: float
    begin: float = 0.0

    def __post_init__(self) -> None:
        """Copy the arrays, make them read-only, check them.

        Raises:
            LogError: arrays of different length, fewer than 40 samples, numbers that are not finite.
        """
        for name in ("position", "force"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        sizes = (self.position.shape, self.force.shape)
        if sizes[0] != sizes[1] or len(sizes[0]) != 1 or sizes[0][0] < _FEWEST:
            text = f"position {sizes[0]} and force {sizes[1]} must be alike, {_FEWEST} samples or more each"
            raise LogError(Notice(code="friction.axis-run", text=text))
        if not (np.all(np.isfinite(self.position)) and np.all(np.isfinite(self.force))):
            text = "position and force must be finite numbers throughout"
            raise LogError(Notice(code="friction.axis-run", text=text))


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Window:
    """Samples first .. last - 1 of a run."""

    first: int
    last: int


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputErrorFit:
    """Values of a model.

    Args:
        names, values: in the order of the model's `parameters`.
        rmse: of the simulated position over all windows, m or rad.
        windows: how many; evaluations: simulations of all of them, from all starts.
        converged: whether the search ended for its tolerance.
    """

    names: tuple[str, ...]
    values: tuple[float, ...]
    rmse: float
    windows: int
    evaluations: int
    converged: bool

    def find_value(self, name: str) -> float:
        """Return one of the values."""
        return self.values[self.names.index(name)]


def split_windows(windows: Sequence[Window], samples: float) -> tuple[Window, ...]:
    """Return the same samples in windows of equal length near `samples`, none across two of those given."""
    parts = []
    for window in windows:
        length = window.last - window.first
        count = max(1, min(round(length / samples), length // _FEWEST))
        edges = [window.first + round(k * length / count) for k in range(count + 1)]
        parts += [Window(first=a, last=b) for a, b in pairwise(edges)]
    return tuple(parts)


def estimate_axis_start(run: AxisRun, first: int) -> tuple[float, float, float]:
    """Return position, velocity and time at the last of the 20 samples from `first` on."""
    moments = run.period * (np.arange(GIVEN) - (GIVEN - 1))
    curve = np.polyfit(moments, run.position[first : first + GIVEN], 2)
    return float(curve[2]), float(curve[1]), run.begin + run.period * (first + GIVEN - 1)


def compute_output_error(
    model: AxisModel,
    values: FloatArray,
    run: AxisRun,
    windows: Sequence[Window],
    left_out: Window | None = None,
) -> FloatArray:
    """Return simulated less measured position behind the first 20 samples of each window, m or rad.

    Samples of `left_out` are simulated, but their errors are not among those returned.
    """
    errors = []
    for window in windows:
        force = run.force[window.first + GIVEN - 1 : window.last]
        position, _ = simulate_axis(model, values, force, run.period, estimate_axis_start(run, window.first))
        error = position[1:] - run.position[window.first + GIVEN : window.last]
        errors.append(error[_mask_counted(window, left_out)])
    return _limit_errors(np.concatenate(errors))


def compute_window_rmse(
    model: AxisModel, values: FloatArray, run: AxisRun, windows: Sequence[Window]
) -> float:
    """Return the root mean square of `compute_output_error`, m or rad."""
    return float(np.sqrt(np.mean(np.square(compute_output_error(model, values, run, windows)))))


def _compute_rates(
    model: AxisModel,
    values: FloatArray,
    run: AxisRun,
    windows: Sequence[Window],
    left_out: Window | None,
) -> FloatArray:
    parts = []
    for window in windows:
        force = run.force[window.first + GIVEN - 1 : window.last]
        _, rates = compute_axis_rates(
            model, values, force, run.period, estimate_axis_start(run, window.first)
        )
        parts.append(rates[1:][_mask_counted(window, left_out)])
    return _limit_errors(np.vstack(parts))


def _mask_counted(window: Window, left_out: Window | None) -> NDArray[np.bool_]:
    """Return which samples behind the given ones of a window are not left out."""
    samples = np.arange(window.first + GIVEN, window.last)
    if left_out is None:
        return np.ones(len(samples), dtype=np.bool_)
    counted: NDArray[np.bool_] = (samples < left_out.first) | (samples >= left_out.last)
    return counted


def _limit_errors(errors: FloatArray) -> FloatArray:
    bounded: FloatArray = np.clip(np.nan_to_num(errors, nan=_WORST), -_WORST, _WORST)
    return bounded


def fit_force(
    model: AxisModel,
    run: AxisRun,
    states: tuple[FloatArray, FloatArray, FloatArray],
    windows: Sequence[Window],
    shape: Sequence[float] = (),
) -> FloatArray:
    """Return the values with the least error of force: where a search for the least error of position begins.

    Args:
        model: of the axis.
        run: its recording.
        states: position, velocity, acceleration (N,) at the samples of the run.
        windows: samples used.
        shape: values of the law's shape.
    """
    rows = np.concatenate([np.arange(window.first, window.last) for window in windows])
    position, velocity, acceleration = (values[rows] for values in states)
    inputs = {
        "velocity": velocity,
        "position": position,
        "load": run.force[rows],
        "time": run.begin + run.period * rows,
    }
    columns = np.column_stack([acceleration, compute_force_columns(model, inputs, shape)])
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    found, *_ = np.linalg.lstsq(columns / scale, run.force[rows], rcond=None)
    return np.concatenate([found / scale, np.asarray(shape, dtype=np.float64)])


def fit_output_error(
    model: AxisModel,
    run: AxisRun,
    windows: Sequence[Window],
    starts: Sequence[FloatArray],
    *,
    left_out: Window | None = None,
    evaluations: int = _EVALUATIONS,
) -> OutputErrorFit:
    """Return the values with the least error of position, the best from several starts.

    Args:
        model: of the axis.
        run: its recording.
        windows: simulated each from its own first samples.
        starts: values (p,) each.
        left_out: samples whose errors do not count.
        evaluations: simulations of all windows at most, for each start.

    Raises:
        LogError: a window has fewer than 40 samples.
    """
    from scipy.optimize import least_squares

    short = [window for window in windows if window.last - window.first < _FEWEST]
    if short or not windows:
        text = f"windows {short}: there must be one at least, and each must have {_FEWEST} samples or more"
        raise LogError(Notice(code="friction.axis-run", text=text))
    lower, upper = _list_bounds(model)
    fits = []
    for start in starts:
        scale = np.maximum(np.abs(start), 1e-3)
        room = 1e-6 * scale
        inside = np.clip(start, lower + room, upper - room)
        fits.append(
            least_squares(
                lambda values: compute_output_error(model, values, run, windows, left_out),
                inside,
                jac=lambda values: _compute_rates(model, values, run, windows, left_out),
                bounds=(lower, upper),
                x_scale="jac",
                xtol=_TOLERANCE,
                ftol=_TOLERANCE,
                gtol=None,
                max_nfev=evaluations,
            )
        )
    best = min(fits, key=lambda fit: float(fit.cost))
    return OutputErrorFit(
        names=model.parameters,
        values=tuple(float(value) for value in best.x),
        rmse=float(np.sqrt(np.mean(np.square(best.fun)))),
        windows=len(windows),
        evaluations=sum(int(fit.nfev) for fit in fits),
        converged=bool(best.status > 0),
    )


def _list_bounds(model: AxisModel) -> tuple[FloatArray, FloatArray]:
    """Return least and greatest values: of the law, of the terms, and a mass above zero."""
    terms = tuple(AXIS_TERMS[name].parameter for name in model.terms)
    parameters = (*model.law.linear, *terms, *model.law.shape)
    lower = np.array([0.0, *(parameter.lower for parameter in parameters)])
    upper = np.array([np.inf, *(parameter.upper for parameter in parameters)])
    return lower, upper
