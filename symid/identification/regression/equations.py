"""Regression equations A x = y + noise of one recording, x = [beta; f], five kinds.

Library, Signals -> Rows (observation matrix A, right side y).

    torque    at every sample of every joint, decimated:  [Y | Yf] x = tau
    momentum  over windows [a, b] of every joint:         [Yp(b) - Yp(a) - int YL | int Yf] x = int tau
    filtered  at the ends of windows of every joint:      [F(dYp/dt) - F YL | F Yf] x = F tau, F = l / (s + l)
    energy    over windows, all joints together:          [h(b) - h(a) | int dq' Yf] x = int tau' dq
    power     at every sample, all joints together:       [dh/dt | dq' Yf] x = tau' dq

Momentum is the Lagrangian form d(dT/ddq)/dt - dL/dq = tau integrated once; filtered is that of Slotine and
Li (1987), energy the theorem of Gautier and Khalil (1988), h = hT + hV, power its rate (Gautier 1997). Only
torque rows need accelerations: F(dYp/dt) = l [Yp(b) - exp(-l W) Yp(a)] - l int l exp(-l (b - s)) Yp ds over
a window of W by parts, and earlier windows decay by exp(-l W). Integrals are taken by Simpson's rule.

Supported: rigid robots, friction that is linear in its parameters; windows of an even number of intervals
that share their ends, or overlap by equal parts.
Not supported: elastic joints; samples at uneven times.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid import logs
from symid.arrays import FloatArray, accumulate, freeze_fields
from symid.codegen import Library, ModelCard
from symid.errors import Notice, UsageError
from symid.identification.judge import numerics
from symid.joint_models import compute_column_derivatives, get_law
from symid.logs import SignalParts, Signals, mask_touched
from symid.notation import join_name
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

    The number of intervals is the even one next to `length / pieces / period`, for Simpson's rule. A
    UsageError where a window is shorter than two sample periods or longer than the log.
    """
    step = length / pieces
    intervals = 2 * round(step / (2.0 * period)) if step > 0.0 else 0
    count = (samples - 1) // intervals if intervals else 0
    if count < pieces:
        text = f"window of {length:g} s{f' (by the overlap one every {step:g} s)' if pieces > 1 else ''}: "
        text += f"must be at least two sample periods ({2 * period:g} s) and at most the log without its cut "
        text += f"ends ({(samples - 1) * period:g} "
        text += f"s){'; use longer windows or less overlap' if pieces > 1 else ''}"
        raise UsageError(Notice(code="usage.window", text=text))
    return Windows(count=count, intervals=intervals, period=period)


def integrate_windows(values: FloatArray, windows: Windows) -> FloatArray:
    """Return the integral of `values` (N, ...) over every window (count, ...), by Simpson's rule."""
    weights = np.full(windows.intervals + 1, 2.0)
    weights[1::2] = 4.0
    weights[[0, -1]] = 1.0
    return _weigh_windows(values, windows, weights) * (windows.period / 3.0)


def _weigh_windows(values: FloatArray, windows: Windows, weights: FloatArray) -> FloatArray:
    """Return the sum of weights (w + 1,) times the samples of every window; windows share their ends."""
    w, count = windows.intervals, windows.count
    inner = values[: count * w].reshape(count, w, *values.shape[1:])
    total = np.tensordot(inner, weights[:-1], axes=(1, 0))
    return np.asarray(total + weights[-1] * values[windows.ends][1:])


def _cut_windows(windows: Windows, pieces: int) -> Iterator[tuple[slice, Windows, slice]]:
    """Yield blocks of rows of `pieces` windows each: which rows, their windows, the samples of these."""
    rows, most = windows.count - pieces + 1, max(1, numerics.BLOCK // windows.intervals)
    for start in range(0, rows, most):
        stop = min(rows, start + most)
        block = replace(windows, count=stop - start + pieces - 1)
        first = start * windows.intervals
        yield slice(start, stop), block, slice(first, first + block.count * windows.intervals + 1)


_RATE = 2.0
"""Rate of the filter of `filtered` rows, times the window: rows share 2 % of their noise's variance."""


class EquationPart(NamedTuple):
    """Equations: matrix (M, n, p), values and velocity (M, n); one column in place of n for scalar equations.

    `time` (M,) s; `independent` rows of independent noise that they are worth, as a fraction; `bad` (M, n)
    those that bad samples are noticed in, None for none.
    """

    matrix: FloatArray
    values: FloatArray
    time: FloatArray
    velocity: FloatArray
    independent: float
    bad: NDArray[np.bool_] | None = None


def outline_part(
    kind: str, signals: Signals | SignalParts, processing: Processing, window: float, pieces: int
) -> EquationPart:
    """Return torque or momentum equations without their matrix.

    `pieces` windows begin within the length `window` (s) of one.
    """
    if kind == "torque":

        def evaluate(part: slice) -> FloatArray:
            own = signals.cut(part)
            return np.hstack([own.tau, own.dq])

        count, factor = len(signals.time), processing.decimation.factor
        blocks = logs.decimate_blocks(evaluate, count, processing.decimation)
        values, velocity = np.split(np.concatenate([rows for _, rows in blocks]), 2, axis=1)
        return EquationPart(
            matrix=np.empty((*values.shape, 0)),
            values=values,
            # Decimation keeps the last sample.
            time=signals.time[count - 1 - factor * (len(values) - 1) :: factor],
            velocity=velocity,
            independent=logs.compute_noise_bandwidth(processing, signals.period),
            bad=None if signals.bad is None else logs.mask_decimated(signals.bad, processing.decimation),
        )
    windows = choose_windows(len(signals.time), signals.period, window, pieces)
    span, found = windows.intervals * windows.period * pieces, []
    for _, block, part in _cut_windows(windows, pieces):
        own = signals.cut(part)
        found.append(_merge(integrate_windows(np.hstack([own.tau, own.dq]), block), pieces))
    values, velocity = np.split(np.concatenate(found), 2, axis=1)
    return _outline_windows(signals, windows, pieces, values, velocity / span)


def cut_matrix(
    kind: str,
    library: Library,
    signals: Signals | SignalParts,
    processing: Processing,
    *,
    window: float,
    pieces: int,
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield the matrix (k, n, p) of torque or momentum equations by blocks, with the rows of each.

    Of long logs columns of base parameters, which are smooth, are evaluated as `logs.choose_thinning` says.
    """
    if kind == "torque":

        def evaluate(part: slice) -> FloatArray:
            q, dq, ddq, *_ = signals.cut(part).pick_states(slice(None))
            (columns,) = library.evaluate("torque_regressor", q, dq, ddq)
            return columns

        def evaluate_friction(part: slice) -> FloatArray:
            states = signals.cut(part).pick_states(slice(None))
            found = _evaluate_friction(library, states)
            columns = found[0] if len(found) == 1 else np.concatenate(found, axis=2)
            return columns.reshape(len(columns), -1)

        thin = logs.choose_thinning(processing, signals.period)
        settings = len(signals.time), processing.decimation
        rigid = logs.decimate_blocks(evaluate, *settings, thin)
        if not library.card.friction and library.tangents is None:
            yield from rigid
            return
        friction = logs.decimate_blocks(evaluate_friction, *settings)
        for (rows, left), (_, right) in zip(rigid, friction, strict=True):
            yield rows, np.concatenate([left, right.reshape(*left.shape[:2], -1)], axis=2)
        return
    windows = choose_windows(len(signals.time), signals.period, window, pieces)
    for rows, block, part in _cut_windows(windows, pieces):
        states = signals.cut(part).pick_states(slice(None))
        q, dq, *_ = states
        (momentum,) = library.evaluate("momentum_regressor", q[block.ends], dq[block.ends])
        (lagrange,) = library.evaluate("lagrange_regressor", q, dq)
        columns = _evaluate_friction(library, states)
        matrix = integrate_windows(np.concatenate([-lagrange, *columns], axis=2), block)
        matrix[:, :, : momentum.shape[2]] += np.diff(momentum, axis=0)
        yield rows, _merge(matrix, pieces)


def evaluate_columns(  # noqa: PLR0917 - the states of a sample, in the order of `Signals.pick_states`
    library: Library,
    q: FloatArray,
    dq: FloatArray,
    ddq: FloatArray,
    load: FloatArray | None = None,
    temperature: FloatArray | None = None,
) -> FloatArray:
    """Return [Y | Yf] at states (N, n): (N, n, p); a UsageError where friction needs a load that is None."""
    # In blocks that stay in the cache, for new memory costs as much as the functions.
    result, count = np.empty((0, 0, 0)), len(q)
    for start in range(0, count, numerics.BLOCK):
        part = slice(start, start + numerics.BLOCK)
        force, warmth = (None if entry is None else entry[part] for entry in (load, temperature))
        states = q[part], dq[part], ddq[part], force, warmth
        columns = library.evaluate("torque_regressor", *states[:3])
        columns += _evaluate_friction(library, states)
        if not start:
            result = np.empty((count, dq.shape[1], sum(entry.shape[2] for entry in columns)))
        np.concatenate(columns, axis=2, out=result[part])
    return result


def evaluate_torques(library: Library, signals: Signals, values: FloatArray) -> FloatArray:
    """Return the torques (N, n) in N m or N that parameters (p,) predict at every sample.

    Of base parameters alone without friction.
    """
    torques, rigid = np.zeros(signals.q.shape), len(values) == len(library.card.beta)
    for start in range(0, len(torques), numerics.BLOCK):
        part, place = slice(start, start + numerics.BLOCK), 0
        states = signals.pick_states(part)
        columns = library.evaluate("torque_regressor", *states[:3])
        for entry in columns if rigid else (*columns, *_evaluate_friction(library, states)):
            torques[part] += entry @ values[place : place + entry.shape[2]]
            place += entry.shape[2]
    return torques


def _outline_windows(
    signals: Signals | SignalParts, windows: Windows, pieces: int, values: FloatArray, velocity: FloatArray
) -> EquationPart:
    ends, places = signals.time[windows.ends], np.arange(len(signals.time))[windows.ends]
    return EquationPart(
        matrix=np.empty((*values.shape, 0)),
        values=values,
        time=(ends[pieces:] + ends[:-pieces]) / 2.0,
        velocity=velocity,
        independent=1.0 / pieces,
        bad=None if signals.bad is None else mask_touched(signals.bad, places[:-pieces], places[pieces:] + 1),
    )


def _build_energy_part(library: Library, signals: Signals, length: float, pieces: int) -> EquationPart:
    windows = choose_windows(len(signals.time), signals.period, length, pieces)
    matrix = []
    for _, block, part in _cut_windows(windows, pieces):
        q, dq = signals.q[part], signals.dq[part]
        kinetic, potential = library.evaluate("energy_regressor", q[block.ends], dq[block.ends])
        friction = _evaluate_friction(library, signals.pick_states(part))
        work = (integrate_windows(np.einsum("ij,ijk->ik", dq, one), block) for one in friction)
        matrix.append(_merge(np.hstack([np.diff(kinetic + potential, axis=0), *work]), pieces))
    power = np.einsum("ij,ij->i", signals.tau, signals.dq)
    values = _merge(integrate_windows(power, windows), pieces)[:, None]
    outline = _outline_windows(signals, windows, pieces, values, np.zeros(values.shape))
    return outline._replace(matrix=np.concatenate(matrix)[:, None])


def _build_power_part(library: Library, signals: Signals, processing: Processing) -> EquationPart:
    """Return power equations at every sample, averaged over the two periods around it and decimated."""

    def average(values: FloatArray) -> FloatArray:
        return np.asarray((values[:-2] + 4.0 * values[1:-1] + values[2:]) / 6.0)

    def evaluate(inner: slice) -> FloatArray:
        part = slice(inner.start, inner.stop + 2)
        q, dq = signals.q[part], signals.dq[part]
        kinetic, potential = library.evaluate("energy_regressor", q, dq)
        energy = kinetic + potential
        columns = _evaluate_friction(library, signals.pick_states(part))
        friction = (average(np.einsum("ij,ijk->ik", dq, one)) for one in columns)
        supplied = average(np.einsum("ij,ij->i", signals.tau[part], dq))
        return np.column_stack([(energy[2:] - energy[:-2]) / (2.0 * signals.period), *friction, supplied])

    blocks = logs.decimate_blocks(evaluate, len(signals.time) - 2, processing.decimation)
    kept = np.vstack([rows for _, rows in blocks])
    factor = processing.decimation.factor
    band = logs.compute_noise_bandwidth(processing, signals.period)
    return EquationPart(
        matrix=kept[:, None, :-1],
        values=kept[:, -1:],
        time=signals.time[len(signals.time) - 2 - factor * (len(kept) - 1) : -1 : factor],
        velocity=np.zeros((len(kept), 1)),
        independent=band * 0.5 if factor == 1 else band,
        bad=None if signals.bad is None else logs.mask_decimated(signals.bad[1:-1], processing.decimation),
    )


def _build_filtered_part(library: Library, signals: Signals, length: float) -> EquationPart:
    """Return filtered equations: one a window of `length` s, the filter's time constant half of it."""
    windows = choose_windows(len(signals.time), signals.period, length)
    rate, keep = _RATE / (windows.intervals * windows.period), float(np.exp(-_RATE))
    # Weights (w + 1,) of the samples of a window in int l exp(-l (b - s)) y(s) ds. Over every two periods y
    # is the parabola through its samples; the integral of kernel times parabola is taken by Gauss's rule,
    # which is exact to rounding.
    nodes, shares = np.polynomial.legendre.leggauss(8)
    u = nodes + 1.0
    parabolas = np.array([(u - 1.0) * (u - 2.0) / 2.0, u * (2.0 - u), u * (u - 1.0) / 2.0])
    kernel = rate * np.exp(-rate * windows.period * (2.0 - u))
    three = windows.period * parabolas @ (shares * kernel)
    weights = np.zeros(windows.intervals + 1)
    for first in range(0, windows.intervals, 2):
        left = windows.intervals - first - 2
        weights[first : first + 3] += np.exp(-rate * windows.period * left) * three
    matrix = []
    for _, block, part in _cut_windows(windows, 1):
        q, dq = signals.q[part], signals.dq[part]
        (lagrange,) = library.evaluate("lagrange_regressor", q, dq)
        (inner,) = library.evaluate("momentum_regressor", q, dq)
        friction = _evaluate_friction(library, signals.pick_states(part))
        columns = np.concatenate([-lagrange - rate * inner, *friction], axis=2)
        steps, momentum = _weigh_windows(columns, block, weights), inner[block.ends]
        steps[:, :, : inner.shape[2]] += rate * (momentum[1:] - keep * momentum[:-1])
        matrix.append(steps)
    ends = np.arange(len(signals.time))[windows.ends]
    return EquationPart(
        matrix=accumulate(np.concatenate(matrix), keep),
        values=accumulate(_weigh_windows(signals.tau, windows, weights), keep),
        time=np.array(signals.time[windows.ends][1:]),
        velocity=accumulate(_weigh_windows(signals.dq, windows, weights), keep),
        independent=(1.0 - keep) / (1.0 + keep),
        # Of the window before the last one a seventh is left, of earlier ones 2 %.
        bad=None if signals.bad is None else mask_touched(signals.bad, np.append(0, ends[:-2]), ends[1:] + 1),
    )


def _evaluate_friction(library: Library, states: logs.States) -> tuple[FloatArray, ...]:
    """Return the columns of friction, and sum_k c_k dPhi_k / ds (N, n, s) of searched shape values s.

    The library's tangents stand last.
    """
    card, (q, dq, ddq, load, temperature) = library.card, states
    more = () if library.tangents is None else (library.tangents(q, dq, ddq),)
    if not card.friction:
        return more
    inputs = card.gather_friction_inputs(dq, q=q, load=load, temperature=temperature)
    columns = library.evaluate("friction_regressor", *inputs)
    laws = [one for one in card.searched if one.joint]
    if not laws:
        return (*columns, *more)
    named = {"velocity": dq, "position": q, "load": load, "temperature": temperature}
    given = {name: values for name, values in named.items() if values is not None}
    found, place = np.zeros((*dq.shape, len(laws))), 0
    for joint, entry in enumerate(card.joints):
        shape = [one.value or 0.0 for one in laws if one.joint == entry.name]
        if not shape:
            continue
        law = get_law(entry.friction, smoothing=entry.smoothing)
        known = {one.name: one.value or 0.0 for one in card.friction if one.joint == entry.name}
        linear = [known.get(join_name(part.name, entry.number), 0.0) for part in law.linear]
        own = {name: values[:, joint] for name, values in given.items()}
        rates = compute_column_derivatives(law, own, shape)
        found[:, joint, place : place + len(shape)] = np.einsum("nps,p->ns", rates, linear)
        place += len(shape)
    return (*columns, found, *more)


def _merge(values: FloatArray, pieces: int) -> FloatArray:
    """Return sums of `pieces` neighbours (M, ...), one beginning at every entry."""
    count = len(values) - pieces + 1
    return np.asarray(sum(values[shift : shift + count] for shift in range(pieces)))


ROW_KINDS = ("torque", "momentum", "filtered", "power", "energy")
SCALAR_KINDS = {"power": "W", "energy": "J"}
"""Kinds with one equation for all joints together, and its unit."""
BAD_ROWS = "identify.bad-rows"
"""Code of the notice on rows that bad samples have a part in."""
WINDOW = 0.1
"""Length of a window in s, unless another is asked for."""

_ENERGY_LIMIT = 3
_ARRAYS = ("matrix", "values", "group", "time", "velocity", "run", "weight")
"""Fields of `Rows` with an entry for each equation."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Rows:
    """Equations `matrix @ x = values`, ordered group by group.

    Args:
        kind: one of `ROW_KINDS`.
        matrix: (m, p); values: (m,), in the unit of the row's group.
        group: (m,) index of the joint, 0 throughout for scalar equations.
        time: (m,) s, of the sample or the middle of the window.
        velocity: (m,) of the joint in rad/s or m/s; of a window its mean; 0 for scalar equations.
        names, units: of the p parameters; group_names, group_units, velocity_units: of the groups.
        independent: rows of independent noise that the rows are worth, as a fraction of them.
        run: (m,) recording of a row, from zero; weight: (m,) what the square of its residual counts for.
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
    independent: float
    run: NDArray[np.intp]
    weight: FloatArray
    notices: tuple[Notice, ...] = ()

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
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

    `kind` is one of `ROW_KINDS`; `signals` are at full rate: torque and power rows are decimated. Windows of
    momentum, filtered and energy rows have the length `window` in s; those of momentum and energy share the
    part `overlap`, of which the nearest of 0, 1/2, 2/3, 3/4 and so on is taken. A UsageError where there is
    no such kind, windows do not fit into the log, or the overlap is no part.
    """
    if kind not in ROW_KINDS:
        text = f"rows {kind!r}: unknown; choose one of {', '.join(ROW_KINDS)}"
        raise UsageError(Notice(code="usage.unknown-rows", text=text))
    pieces, card = count_pieces(overlap), library.card
    match kind:
        case "torque" | "momentum":
            outline = outline_part(kind, signals, processing, window, pieces)
            # Joint by joint, as rows are, and read-only: it is the largest array, and is not copied.
            matrix = np.empty((*outline.values.T.shape, len(card.fitted)))
            for places, block in cut_matrix(kind, library, signals, processing, window=window, pieces=pieces):
                matrix[:, places] = block.swapaxes(0, 1)
            matrix.setflags(write=False)
            part = outline._replace(matrix=matrix.swapaxes(0, 1))
        case "filtered":
            part = _build_filtered_part(library, signals, window)
        case "power":
            part = _build_power_part(library, signals, processing)
        case _:
            part = _build_energy_part(library, signals, window, pieces)
    return assemble_rows(kind, card, part)


def count_pieces(overlap: float) -> int:
    """Return how many windows begin in the length of one; raise UsageError unless 0 <= overlap < 1."""
    if not 0.0 <= overlap < 1.0:
        text = f"overlap {overlap:g}: must be a fraction of the window, from 0 to less than 1"
        raise UsageError(Notice(code="usage.overlap", text=text))
    return max(1, round(1.0 / (1.0 - overlap)))


def assemble_rows(kind: str, card: ModelCard, part: EquationPart) -> Rows:
    """Return equations of a kind joint by joint, but bad ones, with the names and units of their model."""
    groups = part.values.shape[1]
    extra = " s" if kind == "momentum" else ""
    labels = [(one.name, one.torque_unit + extra, f"{one.position_unit}/s") for one in card.joints]
    if kind in SCALAR_KINDS:
        labels = [("all joints", SCALAR_KINDS[kind], "")]
    names, units, velocity_units = zip(*labels, strict=True)
    rows = Rows(
        kind=kind,
        matrix=np.swapaxes(part.matrix, 0, 1).reshape(-1, part.matrix.shape[2]),
        values=part.values.T.ravel(),
        group=np.repeat(np.arange(groups), len(part.values)),
        time=np.tile(part.time, groups),
        velocity=part.velocity.T.ravel(),
        names=tuple(parameter.name for parameter in card.fitted),
        units=tuple(parameter.unit for parameter in card.fitted),
        group_names=names,
        group_units=units,
        velocity_units=velocity_units,
        independent=part.independent,
        run=np.zeros(part.values.size, dtype=np.intp),
        weight=np.ones(part.values.size),
        notices=warn_of_energy(card.size, kind) if kind in SCALAR_KINDS else (),
    )
    if part.bad is None or not part.bad.any():
        return rows
    bad = np.any(part.bad, axis=1, keepdims=True) if kind in SCALAR_KINDS else part.bad
    told = (warn_of_bad(name, own) for name, own in zip(names, bad.T, strict=True) if own.any())
    return select_rows(replace(rows, notices=(*rows.notices, *told)), ~bad.T.ravel())


def warn_of_bad(name: str, bad: NDArray[np.bool_]) -> Notice:
    """Return the notice on the rows (M,) of a joint that are left out because they are `bad`."""
    text = f"{name}: {int(np.sum(bad))} of {len(bad)} samples, which bad samples of the log affect"
    return Notice(code=BAD_ROWS, text=f"{text}, were left out")


def warn_of_energy(joints: int, kind: str = "energy") -> tuple[Notice, ...]:
    """Return the warning that energy or power rows of so many joints deserve."""
    if joints <= _ENERGY_LIMIT:
        return ()
    text = f"{kind} equations sum the work of all joints: with more than {_ENERGY_LIMIT} joints (here "
    text += f"{joints}) small parameters of the last links are lost in noise. Use torque or momentum "
    text += "equations"
    return (Notice(code="identify.energy-rank", text=text),)


def stack_rows(parts: Sequence[Rows], weights: Sequence[float] | None = None) -> Rows:
    """Return the equations of several recordings of one robot as one set, group by group.

    `weights` are what the squares of each recording's residuals count for; one if None.
    """
    sizes = [len(part.values) for part in parts]
    arrays: dict[str, Any] = {}
    if len(parts) > 1:
        arrays = {k: np.concatenate([getattr(part, k) for part in parts]) for k in _ARRAYS}
    whole = replace(
        parts[0],
        **arrays,
        independent=sum(part.independent * len(part.values) for part in parts) / max(sum(sizes), 1),
        notices=tuple(dict.fromkeys(notice for part in parts for notice in part.notices)),
    )
    run = np.repeat(np.arange(len(parts)), sizes)
    weight = np.repeat(np.ones(len(parts)) if weights is None else np.asarray(weights, dtype=float), sizes)
    whole = replace(whole, run=run, weight=weight)
    # Those of one recording are in order.
    return whole if len(parts) == 1 else select_rows(whole, np.argsort(whole.group, kind="stable"))


def select_rows(rows: Rows, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Rows:
    """Return the equations for which `keep` (m,) holds, or those at its places."""
    chosen: dict[str, Any] = {name: getattr(rows, name)[keep] for name in _ARRAYS}
    for array in chosen.values():
        array.setflags(write=False)  # So that it is not copied once more.
    return replace(rows, **chosen)
