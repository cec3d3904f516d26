"""Regression equations A x = y + noise of one recording, x = [beta; f], five kinds.

Input: a library of robot functions, filtered signals. Output: `Rows`, the observation matrix A with its
right side y.

    torque    at every sample of every joint, decimated:  [Y | Yf] x = tau
    momentum  over windows [a, b] of every joint:         [Yp(b) - Yp(a) - int YL | int Yf] x = int tau
    filtered  at the ends of windows of every joint:      [F(dYp/dt) - F YL | F Yf] x = F tau, F = l / (s + l)
    energy    over windows, all joints together:          [h(b) - h(a) | int dq' Yf] x = int tau' dq
    power     at every sample, all joints together:       [dh/dt | dq' Yf] x = tau' dq

Momentum is the Lagrangian form d(dT/ddq)/dt - dL/dq = tau integrated once; filtered is that of Slotine and
Li (1987); energy is the theorem of Gautier and Khalil (1988), h = hT + hV, and power its rate (Gautier
1997). Only torque rows need accelerations.

The filter of Slotine and Li takes the rate of the momentum without an acceleration: by parts,

    int l exp(-l (t - s)) dYp/ds ds = l [Yp(b) - exp(-l W) Yp(a)] - l int l exp(-l (b - s)) Yp ds

over a window of W; rows of later windows carry the former on with exp(-l W). In all kinds, what is known at
samples enters by Simpson's rule (with the kernel in it for `filtered`), the same on both sides.

Supported: rigid robots, friction that is linear in its parameters; regressors evaluated block by block;
windows of an even number of intervals that share their ends, or overlap by equal parts.
Not supported: elastic joints; samples at uneven times.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze_fields
from symid.codegen import Library, ModelCard
from symid.errors import Notice, UsageError
from symid.logs import Signals, compute_noise_bandwidth, decimate, decimate_blocks
from symid.robot import Processing


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """Consecutive windows: `count` of them, `intervals` sample periods each, `period` in s."""

    count: int
    intervals: int
    period: float

    @property
    def ends(self) -> slice:
        """Return the samples at which windows begin and end, `count + 1` of them."""
        return slice(0, self.count * self.intervals + 1, self.intervals)


def choose_windows(samples: int, period: float, length: float, pieces: int = 1) -> Windows:
    """Return the windows of about `length / pieces` s that fit into so many samples, `period` s apart.

    The number of intervals is the even one next to `length / pieces / period`, for Simpson's rule.

    Raises:
        UsageError: a window is shorter than two sample periods or longer than the log.
    """
    step = length / pieces
    intervals = 2 * round(step / (2.0 * period)) if step > 0.0 else 0
    count = (samples - 1) // intervals if intervals else 0
    if count < 1:
        begun = f", each begun {step:g} s after the last, as the overlap asks, and this" if pieces > 1 else ""
        text = (
            f"window of {length:g} s{begun or ':'} must be at least two sample periods ({2 * period:g} s) "
            f"and at most the log without its cut ends ({(samples - 1) * period:g} s)"
            f"{'; ask for longer windows, or for less overlap' if pieces > 1 else ''}"
        )
        raise UsageError(Notice(code="usage.window", text=text))
    return Windows(count=count, intervals=intervals, period=period)


def integrate_windows(values: FloatArray, windows: Windows) -> FloatArray:
    """Return the integral of `values` (N, ...) over every window: (count, ...).

    Composite Simpson's rule, h/3 (y0 + 4 y1 + 2 y2 + ... + 4 y[w-1] + yw), of fourth order.
    Both sides of a row pass through the same rule, so what jumps between samples, as dry
    friction does, costs no accuracy: its error is the same on both sides.
    """
    w, count = windows.intervals, windows.count
    weights = np.full(w, 2.0)
    weights[1::2] = 4.0
    weights[0] = 1.0
    inner = values[: count * w].reshape(count, w, *values.shape[1:])
    last = values[windows.ends][1:]
    total: FloatArray = np.tensordot(inner, weights, axes=(1, 0)) + last
    return total * (windows.period / 3.0)


_SAMPLES = 8192
"""Samples whose regressors are in memory at a time."""
_WINDOWS = 1024
"""Momentum equations of a joint that are in memory at a time."""
_RATE = 2.0
"""Of the filter of `filtered` rows, times the window: rows share 2 % of their noise's variance."""
_SIMPSON_WHITE = 0.5
"""Variance of white noise behind Simpson's rule over three samples."""


class EquationPart(NamedTuple):
    """Equations: matrix (M, n, p), values and velocity (M, n), with one joint for all where they are summed.

    `time` (M,) s; `independent` rows of independent noise that they are worth, as a fraction.
    """

    matrix: FloatArray
    values: FloatArray
    time: FloatArray
    velocity: FloatArray
    independent: float


def build_torque_part(library: Library, signals: Signals, processing: Processing) -> EquationPart:
    """Return torque equations, every column and the torque decimated alike."""
    outline = outline_torque_part(signals, processing)
    parameters = len(library.card.beta) + len(library.card.friction)
    matrix = np.empty((*outline.values.shape, parameters))
    for part, rows in cut_torque_matrix(library, signals, processing):
        matrix[part] = rows
    return outline._replace(matrix=matrix)


def outline_torque_part(signals: Signals, processing: Processing) -> EquationPart:
    """Return torque equations without their matrix."""
    values, velocity = (decimate(columns, processing.decimation) for columns in (signals.tau, signals.dq))
    return EquationPart(
        matrix=np.empty((*values.shape, 0)),
        values=values,
        time=_list_kept_times(signals.time, len(values), processing.decimation.factor),
        velocity=velocity,
        independent=compute_noise_bandwidth(processing, signals.period),
    )


def cut_torque_matrix(
    library: Library, signals: Signals, processing: Processing
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield the matrix (k, n, p) of torque equations block by block, and which rows a block holds."""

    def evaluate(part: slice) -> FloatArray:
        return evaluate_columns(library, signals.q[part], signals.dq[part], signals.ddq[part])

    return decimate_blocks(evaluate, len(signals.time), processing.decimation)


def evaluate_columns(library: Library, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
    """Return [Y | Yf] at states (N, n): (N, n, p)."""
    (rigid,) = library.evaluate("torque_regressor", q, dq, ddq)
    return np.concatenate([rigid, *_evaluate_friction(library, dq)], axis=2)


def evaluate_torques(library: Library, signals: Signals, values: FloatArray) -> FloatArray:
    """Return the torques (N, n) in N m or N that parameters (p,) foretell at every sample, block by block."""
    torques = []
    for start in range(0, len(signals.time), _SAMPLES):
        part = slice(start, start + _SAMPLES)
        columns = evaluate_columns(library, signals.q[part], signals.dq[part], signals.ddq[part])
        torques.append(columns @ values)
    return np.concatenate(torques)


def _list_kept_times(time: FloatArray, kept: int, factor: int) -> FloatArray:
    """Return the times of the samples that a decimation by `factor` keeps: the last is among them."""
    first = len(time) - 1 - factor * (kept - 1)
    return time[first::factor]


def build_momentum_part(library: Library, signals: Signals, length: float, pieces: int) -> EquationPart:
    """Return momentum equations over windows of `length` s; each begins a `pieces`th of it after the last."""
    windows = choose_windows(len(signals.time), signals.period, length, pieces)
    whole = slice(0, len(signals.time))
    matrix = _merge(_integrate_momentum(library, signals, windows, whole), pieces)
    return outline_momentum_part(signals, length, pieces)._replace(matrix=matrix)


def cut_momentum_matrix(
    library: Library, signals: Signals, length: float, pieces: int
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield the matrix (k, n, p) of momentum equations block by block, and which rows a block holds."""
    windows = choose_windows(len(signals.time), signals.period, length, pieces)
    rows, step = windows.count - pieces + 1, max(pieces, _WINDOWS)
    for start in range(0, rows, step):
        stop = min(rows, start + step)
        count = stop - start + pieces - 1
        block = Windows(count=count, intervals=windows.intervals, period=windows.period)
        first = start * windows.intervals
        samples = slice(first, first + count * windows.intervals + 1)
        yield slice(start, stop), _merge(_integrate_momentum(library, signals, block, samples), pieces)


def _integrate_momentum(library: Library, signals: Signals, windows: Windows, samples: slice) -> FloatArray:
    """Return the matrix (M, n, p) of windows that begin with the first of `samples`."""
    q, dq = signals.q[samples], signals.dq[samples]
    (momentum,) = library.evaluate("momentum_regressor", q[windows.ends], dq[windows.ends])

    def evaluate(part: slice) -> FloatArray:
        (lagrange,) = library.evaluate("lagrange_regressor", q[part], dq[part])
        return np.concatenate([-lagrange, *_evaluate_friction(library, dq[part])], axis=2)

    matrix = _integrate_blocks(evaluate, windows, integrate_windows)
    matrix[:, :, : momentum.shape[2]] += np.diff(momentum, axis=0)
    return matrix


def outline_momentum_part(signals: Signals, length: float, pieces: int) -> EquationPart:
    """Return momentum equations without their matrix."""
    windows = choose_windows(len(signals.time), signals.period, length, pieces)
    ends, span = windows.ends, windows.intervals * windows.period
    values = _merge(integrate_windows(signals.tau, windows), pieces)
    return EquationPart(
        matrix=np.empty((*values.shape, 0)),
        values=values,
        time=_compute_centres(signals.time[ends], pieces),
        velocity=_merge(integrate_windows(signals.dq, windows), pieces) / (span * pieces),
        independent=1.0 / pieces,
    )


def build_energy_part(library: Library, signals: Signals, length: float, pieces: int) -> EquationPart:
    """Return energy equations over windows, as `build_momentum_part`."""
    windows = choose_windows(len(signals.time), signals.period, length, pieces)
    ends = windows.ends
    kinetic, potential = library.evaluate("energy_regressor", signals.q[ends], signals.dq[ends])
    columns = [np.diff(kinetic + potential, axis=0)]
    if library.card.friction:
        columns.append(
            _integrate_blocks(
                lambda part: _compute_friction_power(library, signals.dq[part]), windows, integrate_windows
            )
        )
    power = np.einsum("ij,ij->i", signals.tau, signals.dq)
    values = _merge(integrate_windows(power, windows), pieces)
    return EquationPart(
        matrix=_merge(np.hstack(columns), pieces)[:, None],
        values=values[:, None],
        time=_compute_centres(signals.time[ends], pieces),
        velocity=np.zeros((len(values), 1)),
        independent=1.0 / pieces,
    )


def build_power_part(library: Library, signals: Signals, processing: Processing) -> EquationPart:
    """Return power equations at every sample, averaged over the two periods around it and decimated."""
    span = 2.0 * signals.period

    def evaluate(inner: slice) -> FloatArray:
        part = slice(inner.start, inner.stop + 2)
        q, dq = signals.q[part], signals.dq[part]
        kinetic, potential = library.evaluate("energy_regressor", q, dq)
        energy = kinetic + potential
        columns = [(energy[2:] - energy[:-2]) / span]
        if library.card.friction:
            columns.append(_average(_compute_friction_power(library, dq)))
        return np.column_stack([*columns, _average(np.einsum("ij,ij->i", signals.tau[part], dq))])

    blocks = decimate_blocks(evaluate, len(signals.time) - 2, processing.decimation)
    kept = np.vstack([rows for _, rows in blocks])
    factor = processing.decimation.factor
    band = compute_noise_bandwidth(processing, signals.period)
    return EquationPart(
        matrix=kept[:, None, :-1],
        values=kept[:, -1:],
        time=_list_kept_times(signals.time[1:-1], len(kept), factor),
        velocity=np.zeros((len(kept), 1)),
        independent=band * _SIMPSON_WHITE if factor == 1 else band,
    )


def build_filtered_part(library: Library, signals: Signals, length: float) -> EquationPart:
    """Return filtered equations: one a window of `length` s, the filter's time constant half of it."""
    windows = choose_windows(len(signals.time), signals.period, length)
    span = windows.intervals * windows.period
    rate, keep = _RATE / span, float(np.exp(-_RATE))
    weights = _compute_kernel_weights(windows, rate)
    ends = windows.ends
    (momentum,) = library.evaluate("momentum_regressor", signals.q[ends], signals.dq[ends])
    inertial = momentum.shape[2]

    def evaluate(part: slice) -> FloatArray:
        q, dq = signals.q[part], signals.dq[part]
        (lagrange,) = library.evaluate("lagrange_regressor", q, dq)
        (inner,) = library.evaluate("momentum_regressor", q, dq)
        return np.concatenate([-lagrange - rate * inner, *_evaluate_friction(library, dq)], axis=2)

    def convolve(values: FloatArray, part: Windows) -> FloatArray:
        return _weigh_windows(values, part, weights)

    matrix = _integrate_blocks(evaluate, windows, convolve)
    matrix[:, :, :inertial] += rate * (momentum[1:] - keep * momentum[:-1])
    return EquationPart(
        matrix=_carry_on(matrix, keep),
        values=_carry_on(convolve(signals.tau, windows), keep),
        time=np.array(signals.time[ends][1:]),
        velocity=_carry_on(convolve(signals.dq, windows), keep),
        independent=(1.0 - keep) / (1.0 + keep),
    )


def _evaluate_friction(library: Library, dq: FloatArray) -> tuple[FloatArray, ...]:
    return library.evaluate("friction_regressor", dq) if library.card.friction else ()


def _compute_friction_power(library: Library, dq: FloatArray) -> FloatArray:
    (friction,) = library.evaluate("friction_regressor", dq)
    power: FloatArray = np.einsum("ij,ijk->ik", dq, friction)
    return power


def _average(values: FloatArray) -> FloatArray:
    """Return Simpson's mean over the two periods around every inner sample."""
    mean: FloatArray = (values[:-2] + 4.0 * values[1:-1] + values[2:]) / 6.0
    return mean


def _integrate_blocks(
    evaluate: Callable[[slice], FloatArray],
    windows: Windows,
    integrate: Callable[[FloatArray, Windows], FloatArray],
) -> FloatArray:
    """Return the integrals over all windows of what `evaluate` gives at samples, block by block."""
    many = max(1, _SAMPLES // windows.intervals)
    parts = []
    for first in range(0, windows.count, many):
        count = min(many, windows.count - first)
        start = first * windows.intervals
        block = Windows(count=count, intervals=windows.intervals, period=windows.period)
        parts.append(integrate(evaluate(slice(start, start + count * windows.intervals + 1)), block))
    return np.concatenate(parts)


def _merge(values: FloatArray, pieces: int) -> FloatArray:
    """Return sums of `pieces` neighbours (M, ...), one beginning at every entry."""
    count = len(values) - pieces + 1
    total = values[:count].copy()
    for shift in range(1, pieces):
        total += values[shift : shift + count]
    return total


def _compute_centres(ends: FloatArray, pieces: int) -> FloatArray:
    centres: FloatArray = (ends[pieces:] + ends[:-pieces]) / 2.0
    return centres


def _compute_kernel_weights(windows: Windows, rate: float) -> FloatArray:
    """Return weights (w + 1,) of the samples of a window in int l exp(-l (b - s)) y(s) ds.

    Over every two periods y is the parabola through its samples; the integral of kernel times parabola is
    taken by Gauss's rule, which has all digits of it.
    """
    nodes, shares = np.polynomial.legendre.leggauss(8)
    u = nodes + 1.0
    parabolas = np.array([(u - 1.0) * (u - 2.0) / 2.0, u * (2.0 - u), u * (u - 1.0) / 2.0])
    kernel = rate * np.exp(-rate * windows.period * (2.0 - u))
    three = windows.period * parabolas @ (shares * kernel)
    weights = np.zeros(windows.intervals + 1)
    for first in range(0, windows.intervals, 2):
        left = windows.intervals - first - 2
        weights[first : first + 3] += np.exp(-rate * windows.period * left) * three
    return weights


def _weigh_windows(values: FloatArray, windows: Windows, weights: FloatArray) -> FloatArray:
    """Return the sum of weights (w + 1,) times the samples of every window, whose ends are shared."""
    w, count = windows.intervals, windows.count
    inner = values[: count * w].reshape(count, w, *values.shape[1:])
    total: FloatArray = np.tensordot(inner, weights[:-1], axes=(1, 0))
    whole: FloatArray = total + weights[-1] * values[windows.ends][1:]
    return whole


def _carry_on(steps: FloatArray, keep: float) -> FloatArray:
    """Return F_i = keep F_(i-1) + steps_i, from zero on."""
    total = steps.copy()
    for index in range(1, len(total)):
        total[index] += keep * total[index - 1]
    return total


ROW_KINDS = ("torque", "momentum", "filtered", "power", "energy")
SCALAR_KINDS = {"power": "W", "energy": "J"}
"""Kinds with one equation for all joints together, and its unit."""
WINDOW = 0.1
"""Length of a window in s, unless another is asked for."""

_ENERGY_LIMIT = 3
_MOST_SHARED = 0.95


def _make_empty() -> NDArray[np.intp]:
    return np.empty(0, dtype=np.intp)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Rows:
    """Equations `matrix @ x = values`, ordered group by group.

    Args:
        kind: one of `ROW_KINDS`.
        matrix: (m, p); values: (m,), in the unit of the row's group.
        group: (m,) index of the joint, 0 throughout for scalar equations.
        time: (m,) s, of the sample or the middle of the window.
        velocity: (m,) of the joint in rad/s or m/s; of a window its mean; 0 for scalar equations.
        names, units: of the p parameters.
        group_names, group_units, velocity_units: of the groups.
        independent: rows of independent noise that the rows are worth, as a fraction of them.
        run: (m,) which recording of the fit a row is of, from zero.
        weight: (m,) what the square of a row's residual counts for; one unless runs were weighed.
    """

    kind: str
    matrix: FloatArray
    values: FloatArray
    group: NDArray[np.intp]
    time: FloatArray
    velocity: FloatArray
    names: tuple[str, ...]
    units: tuple[str, ...]
    group_names: tuple[str, ...]
    group_units: tuple[str, ...]
    velocity_units: tuple[str, ...]
    independent: float = 1.0
    notices: tuple[Notice, ...] = ()
    run: NDArray[np.intp] = field(default_factory=_make_empty)
    weight: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only; rows without a run are of the first, and weigh one."""
        count = len(self.values)
        if len(self.weight) != count:
            object.__setattr__(self, "weight", np.ones(count))
        if len(self.run) != count:
            object.__setattr__(self, "run", np.zeros(count, dtype=np.intp))
        freeze_fields(self)
        for name in ("group", "run"):
            places = np.array(getattr(self, name), dtype=np.intp)
            places.setflags(write=False)
            object.__setattr__(self, name, places)


def build_rows(
    kind: str,
    library: Library,
    signals: Signals,
    processing: Processing,
    *,
    window: float = WINDOW,
    overlap: float = 0.0,
) -> Rows:
    """Return the equations of one recording.

    Args:
        kind: one of `ROW_KINDS`.
        library: the functions of the robot.
        signals: filtered states and torques at full rate.
        processing: its decimation is applied alike to every column and to the torque of torque
            and power rows; the integrals of the other kinds thin out by themselves.
        window: length of the windows in s, for momentum, filtered and energy.
        overlap: part of a window that the next one shares, of momentum and energy; the nearest of
            0, 1/2, 2/3, 3/4 and so on is taken.

    Raises:
        UsageError: there is no such kind, the windows do not fit into the log, or the overlap is no part.
    """
    if kind not in ROW_KINDS:
        text = f"rows {kind!r}: there is no such kind; allowed are {', '.join(ROW_KINDS)}"
        raise UsageError(Notice(code="usage.unknown-rows", text=text))
    pieces = count_pieces(overlap)
    builders = {
        "torque": lambda: build_torque_part(library, signals, processing),
        "momentum": lambda: build_momentum_part(library, signals, window, pieces),
        "filtered": lambda: build_filtered_part(library, signals, window),
        "power": lambda: build_power_part(library, signals, processing),
        "energy": lambda: build_energy_part(library, signals, window, pieces),
    }
    return assemble_rows(kind, library.card, builders[kind]())


def count_pieces(overlap: float) -> int:
    """Return how many windows begin within the length of one."""
    if not 0.0 <= overlap <= _MOST_SHARED:
        text = f"overlap {overlap:g}: must be a part of a window, from 0 to {_MOST_SHARED:g}"
        raise UsageError(Notice(code="usage.overlap", text=text))
    return max(1, round(1.0 / (1.0 - overlap)))


def assemble_rows(kind: str, card: ModelCard, part: EquationPart) -> Rows:
    """Return equations of a kind joint by joint, with the names and units of their model."""
    parameters = card.beta + card.friction
    scalar = kind in SCALAR_KINDS
    joints = () if scalar else card.joints
    groups = part.values.shape[1]
    factor = " s" if kind == "momentum" else ""
    return Rows(
        kind=kind,
        matrix=np.swapaxes(part.matrix, 0, 1).reshape(-1, part.matrix.shape[2]),
        values=part.values.T.ravel(),
        group=np.repeat(np.arange(groups), len(part.values)),
        time=np.tile(part.time, groups),
        velocity=part.velocity.T.ravel(),
        names=tuple(parameter.name for parameter in parameters),
        units=tuple(parameter.unit for parameter in parameters),
        group_names=("all joints",) if scalar else tuple(joint.name for joint in joints),
        group_units=(SCALAR_KINDS[kind],)
        if scalar
        else tuple(joint.torque_unit + factor for joint in joints),
        velocity_units=("",) if scalar else tuple(f"{joint.position_unit}/s" for joint in joints),
        independent=part.independent,
        notices=warn_of_energy(card.size, kind) if scalar else (),
    )


def warn_of_energy(joints: int, kind: str = "energy") -> tuple[Notice, ...]:
    """Return the warning that energy or power rows of so many joints deserve."""
    if joints <= _ENERGY_LIMIT:
        return ()
    text = (
        f"{kind} rows for {joints} joints: one scalar equation at a time adds up what every joint does, so "
        "that small parameters of the last links drown in the work of the first ones and the "
        f"matrix is nearly rank deficient beyond {_ENERGY_LIMIT} joints; torque or momentum rows "
        "keep the joints apart"
    )
    return (Notice(code="identify.energy-rank", text=text),)


def stack_rows(parts: Sequence[Rows], weights: Sequence[float] | None = None) -> Rows:
    """Return the equations of several recordings of one robot as one set, group by group.

    Args:
        parts: the equations of each recording.
        weights: what the squares of each recording's residuals count for, positive; one if None.
    """
    first = parts[0]
    sizes = [len(part.values) for part in parts]
    run = np.repeat(np.arange(len(parts)), sizes)
    weight = np.repeat(np.ones(len(parts)) if weights is None else np.asarray(weights, dtype=float), sizes)
    group = np.concatenate([part.group for part in parts])
    order = np.argsort(group, kind="stable")
    notices = tuple(dict.fromkeys(notice for part in parts for notice in part.notices))
    return replace(
        first,
        matrix=np.vstack([part.matrix for part in parts])[order],
        values=np.concatenate([part.values for part in parts])[order],
        group=group[order],
        time=np.concatenate([part.time for part in parts])[order],
        independent=sum(part.independent * len(part.values) for part in parts) / max(len(group), 1),
        velocity=np.concatenate([part.velocity for part in parts])[order],
        notices=notices,
        run=run[order],
        weight=weight[order],
    )


def drop_groups(rows: Rows, groups: Sequence[int]) -> Rows:
    """Return the equations without those of the given groups."""
    return select_rows(rows, ~np.isin(rows.group, list(groups)))


def select_rows(rows: Rows, keep: NDArray[np.bool_]) -> Rows:
    """Return the equations for which `keep` (m,) holds."""
    return replace(
        rows,
        matrix=rows.matrix[keep],
        values=rows.values[keep],
        group=rows.group[keep],
        time=rows.time[keep],
        velocity=rows.velocity[keep],
        run=rows.run[keep],
        weight=rows.weight[keep],
    )
