"""What drives and links add to elastic joints, found from the sum of both sides, in which no spring stands.

    tau(t - lag) = Y chi + d dq + sum_N (a_N cos N theta + b_N sin N theta)

    lag      the torque acts later than its samples say: a loop of the current, a bus          one a robot
    d        viscous friction of the link's bearings, N m s/rad or N s/m                       one a joint
    ripple   torque of period 2 pi / N: teeth, poles, the wave generator of a harmonic drive   any joint
    gear     torsion = theta - q + a_N cos N theta + b_N sin N theta - offset                  any joint
    link     q = its encoder's reading - a cos q - b sin q: a disc that is not centred            revolute
    law      friction of the motor is Phi(dtheta, tau_J; s) c, or c changes with time             any joint

All columns pass one zero-phase low-pass, rows of slow motors are left out. A term
enters where stretches of time, each predicted by a fit to the others, are surely predicted better, by more
than what does no harm (`compare`). The lag is the coefficient of the torque's derivative, with the torque
moved until it is zero. Orders N are peaks of the residual over theta that white noise does not have. Errors
of the gear are those of the torsion that a spring of many stops leaves of the links' torque.

Supported: several recordings, for a lag of one rate; any gear, N need not be whole.
Not supported: ripple that grows with the load; encoders that run late (align the recordings first).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import compress
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification import rigid
from symid.identification.elastic.elimination import compute_speeds, filter_band, solve_weighted
from symid.identification.elastic.estimate import compute_covariance
from symid.identification.elastic.regression import (
    APART,
    MOVES,
    DriveEffect,
    ElasticProblem,
    ElasticSignals,
    build_spring_basis,
    count_edge,
    mark_sliding,
    pass_band,
)
from symid.identification.estimators import FittedLaw
from symid.identification.hysteresis import SAMPLES, STEP, differentiate_spring
from symid.identification.judge import POLICY, Gain, adjust_chances, compare, numerics
from symid.identification.regression import solve_scaled
from symid.joint_models import (
    NO_FRICTION,
    Elasticity,
    FrictionLaw,
    FrictionValues,
    compute_columns,
    get_law,
)
from symid.logs import differentiate_smooth, shift_channel

Effects = tuple[DriveEffect, ...]
_PARTS = POLICY.folds * POLICY.parts
_TURNS = 10.0
"""Periods of a wave within the range of a joint, at least: what friction and springs miss is longer."""


class _Rows(NamedTuple):
    """Rows of all recordings, design @ chi = torque, and where each stands.

    Args:
        design: (m, p); torque: (m,).
        group: (m,) recording and joint; joint: (m,); part: (m,) of all recordings; theta: (m,).
        places: for each recording its samples and (M, n) which rows count.
    """

    signals: tuple[ElasticSignals, ...]
    edge: float
    places: tuple[tuple[slice, NDArray[np.bool_]], ...]
    design: FloatArray
    torque: FloatArray
    group: NDArray[np.intp]
    joint: NDArray[np.intp]
    part: NDArray[np.intp]
    theta: FloatArray

    def stack(self, columns: Sequence[FloatArray]) -> FloatArray:
        """Return the rows (m, k) of columns (N, n, k) of every recording, low-passed."""
        parts = []
        for part, (place, kept), values in zip(self.signals, self.places, columns, strict=True):
            parts.append(pass_band(values, part.period, self.edge)[place][kept])
        return np.concatenate(parts)

    def build(self, effect: DriveEffect) -> FloatArray:
        """Return the columns (m, k) of an effect."""
        columns = []
        for part in self.signals:
            if effect.kind == "torque-lag":
                columns.append(differentiate_smooth(part.centred_torque, part.period)[..., None])
                continue
            angle = effect.order * part.theta[:, effect.joint]
            shape = np.column_stack([np.cos(angle), np.sin(angle)])
            if effect.kind == "link-friction":
                shape = part.dq[:, [effect.joint]]
            own = np.zeros((*part.dq.shape, shape.shape[1]))
            own[:, effect.joint] = shape
            columns.append(own)
        return self.stack(columns)

    def solve(self, extra: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return coefficients of [design, extra], errors (m,), and weights (m,) 1 / scatter of the group."""
        whole = np.hstack([self.design, extra])
        solve = partial(solve_scaled, rcond=numerics.RANK)
        values, errors, scatter = solve_weighted(solve, whole, self.torque, self.group)
        return values, errors, 1.0 / scatter[self.group]

    def predict(self, extra: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the errors of parts and joints, predicted by the other stretches, over torques, squared."""
        whole = np.column_stack([self.design, extra, self.torque]) * weights[:, None]
        lengths = np.maximum(np.linalg.norm(whole, axis=0), numerics.TINY)
        fold, errors = self.part % _PARTS // POLICY.parts, np.empty(len(whole))
        stretches = [whole[fold == number] / lengths for number in range(POLICY.folds)]
        grams = np.array([stretch.T @ stretch for stretch in stretches])
        for number, left in enumerate(sum(grams) - grams):
            values = np.linalg.lstsq(left[:-1, :-1], left[:-1, -1], rcond=numerics.RANK)[0]
            errors[fold == number] = stretches[number] @ np.append(values, -1.0)
        size = int(self.joint.max()) + 1
        squares = np.bincount(self.part * size + self.joint, (errors * lengths[-1] / weights) ** 2)
        table = np.pad(squares, (0, -len(squares) % size)).reshape(-1, size)
        return np.asarray(table / np.maximum(np.bincount(self.joint, self.torque**2), numerics.TINY))


def _build_rows(library: Library, parts: Sequence[ElasticSignals], edge: float, limits: FloatArray) -> _Rows:
    size, places = library.card.size, []
    columns: list[list[NDArray[Any]]] = []
    for number, own in enumerate(parts):
        place, design, torque = filter_band(library, own, edge)
        kept = mark_sliding(own, 1.0 / edge, limits)[place] | (limits == 0.0)
        time, joint = np.arange(len(kept))[:, None], np.broadcast_to(np.arange(size), kept.shape)
        part = np.broadcast_to(number * _PARTS + time * _PARTS // max(1, len(kept)), kept.shape)
        places.append((place, kept))
        values = (design, torque, number * size + joint, joint, part, own.theta[place])
        columns.append([entry[kept] for entry in values])
    whole = map(np.concatenate, zip(*columns, strict=True))
    return _Rows(tuple(parts), edge, tuple(places), *whole)


def measure_effects(
    library: Library, signals: Sequence[ElasticSignals], edge: float, limits: FloatArray
) -> Effects:
    """Return the effects that recordings show beyond doubt, with their values.

    `signals` are hardly filtered, without effects; rows reach up to `edge` Hz. Motors slide that are faster
    than `limits` (n,), rad/s or m/s.
    """
    rows = _build_rows(library, signals, edge, limits)
    # A row a parameter in each part.
    if len(rows.torque) < _PARTS * rows.design.shape[1]:
        return ()
    apart = np.concatenate([part.dtheta - part.dq for part in signals])
    speeds, apart = compute_speeds(signals), np.sqrt(np.mean(apart**2, axis=0))
    # Where motor and link move as one, their friction cannot be told apart: it is the motor's.
    shaken = (apart > APART * speeds) & (speeds > APART * float(np.max(speeds)))
    # Recordings of several rates are not late alike.
    periods = {part.period for part in signals}
    plain = [DriveEffect(kind="torque-lag")] if len(periods) == 1 else []
    plain += [DriveEffect(kind="link-friction", joint=joint) for joint in np.flatnonzero(shaken).tolist()]
    found: list[DriveEffect] = []
    extra = np.empty((len(rows.torque), 0))
    for _ in range(numerics.ROUNDS):
        _, errors, weights = rows.solve(extra)
        before, tried = rows.predict(extra, weights), []
        candidates = [effect for effect in plain if effect not in found]
        for joint in range(len(speeds)):
            # The largest peak of the joint's errors.
            own = rows.joint == joint
            if order := _find_order(rows.theta[own], (errors * weights)[own]):
                candidates.append(DriveEffect(kind="torque-ripple", joint=joint, order=order))
        for effect in candidates:
            further = np.hstack([extra, rows.build(effect)])
            # A torque that is held acts at its sample at the earliest.
            if effect.kind == "torque-lag" and rows.solve(further)[0][-1] < -max(periods):
                continue
            after = rows.predict(further, weights)
            gain = compare(before, after)
            p, fall = gain.p_of_all, gain.fall_of_all
            if effect.joint >= 0:
                p, fall = float(gain.p[effect.joint]), float(gain.fall[effect.joint])
            tried.append((float(after.sum()), p, fall, effect, further))
        chances = adjust_chances([entry[1] for entry in tried])
        # Squares fell surely, and by more than what does no harm.
        falls = (entry[2] * (1.0 - POLICY.relevance) for entry in tried)
        clear = [p < POLICY.alarm and fall > 1.0 for p, fall in zip(chances, falls, strict=True)]
        sure = list(compress(tried, clear))
        if not sure:
            break
        *_, best, extra = min(sure, key=lambda entry: entry[0])
        found.append(best)
    return tuple(_measure_values(rows, found))


def _find_order(theta: FloatArray, errors: FloatArray) -> float:
    """Return the order of the largest peak of errors (m,) over positions (m,), 0 for none that stands out.

    The power of white noise is exponential: it exceeds k times its median with the probability 2^-k.
    """
    span = float(np.ptp(theta)) if len(theta) else 0.0
    if not span > 0.0:
        return 0.0
    # Waves as short as twice the way between two rows.
    width, shortest = 2.0 * np.pi / span, float(np.median(np.abs(np.diff(theta))))
    highest = max(np.pi / max(shortest, span / len(theta)), 2.0 * _TURNS * width)
    orders = np.arange(_TURNS * width, highest, width / 4.0)
    power = _compute_power(theta, errors, orders)
    best, median = int(np.argmax(power)), float(np.median(power))
    if not median > 0.0 or len(orders) * 2.0 ** (-power[best] / median) >= POLICY.alarm:
        return 0.0
    near = orders[best] + width / 4.0 * np.linspace(-1.0, 1.0, 41)
    order = float(near[np.argmax(_compute_power(theta, errors, near))])
    # Teeth and poles come in whole numbers, gears often do.
    return float(round(order)) if abs(order - round(order)) < POLICY.relevance * width else order


def _compute_power(theta: FloatArray, errors: FloatArray, orders: FloatArray) -> FloatArray:
    """Return the power (k,) of errors (m,) over positions (m,) at orders (k,) that are evenly apart."""
    wave, turn = errors * np.exp(1j * theta * orders[0]), np.exp(1j * theta * (orders[1] - orders[0]))
    sums = np.empty(len(orders), dtype=np.complex128)
    for place in range(len(orders)):
        sums[place] = np.sum(wave)
        wave *= turn
    return np.abs(sums) ** 2


def _measure_values(rows: _Rows, found: Sequence[DriveEffect]) -> Iterator[DriveEffect]:
    """Yield effects with values and deviations; the torque is moved until no lag is left."""
    if not found:
        return
    ordered = sorted(found, key=lambda effect: effect.kind != "torque-lag")
    late, base = ordered[0].kind == "torque-lag", rows.design.shape[1]
    others = [rows.build(effect) for effect in ordered[late:]]

    def move(lag: float) -> tuple[_Rows, FloatArray]:
        if not late:
            return rows, np.hstack(others)
        signals = tuple(replace(part, tau=shift_channel(part.time, part.tau, -lag)) for part in rows.signals)
        moved = rows._replace(signals=signals)
        torque = moved.stack([part.centred_torque[..., None] for part in signals])[:, 0]
        return moved._replace(torque=torque), np.hstack([moved.build(ordered[0]), *others])

    def leave(lag: float) -> float:
        moved, extra = move(lag)
        return float(moved.solve(extra)[0][base])

    lag, slope = 0.0, 1.0
    if late and (first := leave(0.0)):
        # Noise in the derivative makes the coefficient small: the secant says by how much.
        lag = float(scipy.optimize.root_scalar(leave, method="secant", x0=0.0, x1=first).root)
        slope = first / lag if lag else slope
    moved, extra = move(lag)
    values, _, weights = moved.solve(extra)
    whole = np.hstack([moved.design, extra]) * weights[:, None]
    lengths = np.maximum(np.linalg.norm(whole, axis=0), numerics.TINY)
    inverse = np.linalg.pinv((whole / lengths).T @ (whole / lengths), rcond=numerics.RANK)
    spread = np.sqrt(np.diag(inverse)) / lengths
    # A torque that is held acts half a period after its sample, which the signals have already.
    period, deviation = rows.signals[0].period, float(spread[base]) / slope
    if late and not -POLICY.printed * deviation <= lag + 0.5 * period < np.inf:
        yield from _measure_values(rows, ordered[1:])
        return
    for effect in ordered:
        count = len(effect.values) or (2 if effect.kind == "torque-ripple" else 1)
        own, base = slice(base, base + count), base + count
        number, deviations = values[own], spread[own]
        if effect.kind == "torque-lag":
            if abs(lag) <= POLICY.relevance * period:
                continue
            number, deviations = np.array([lag + 0.5 * period]), np.array([deviation])
        yield replace(effect, values=tuple(number.tolist()), deviations=tuple(deviations.tolist()))


MOTOR_LAWS = tuple(
    name
    for name in rigid.CANDIDATES
    if set(get_law(name).inputs) <= {"velocity", "load"} and not get_law(name).shape
)
"""Laws that replace that of a robot file where it surely is another: those of rigid joints that speeds and
loads show. Shape values are of friction near rest, whose rows are left out."""


class MotorFriction(NamedTuple):
    """Laws of motors whose friction surely is none that a robot file states, and what drifts.

    Args:
        drifting: joints whose friction changes; drift: (N, n) of every recording, N m or N, how far it is
            from the mean.
        beta: (p,) base parameters that laws and drift leave.
    """

    laws: tuple[FittedLaw, ...]
    drifting: tuple[str, ...]
    drift: tuple[FloatArray, ...]
    beta: FloatArray


class _MotorRows(NamedTuple):
    """Rows of motors and links, and what columns of friction are made of at all samples.

    Args:
        rows: of all recordings; velocity: (N, n) of motors; clocks: (N,) by name, in which friction drifts.
        beta: (p,) base parameters, of the loads at first.
    """

    library: Library
    rows: _Rows
    velocity: FloatArray
    clocks: Mapping[str, FloatArray]
    beta: FloatArray

    def split(self, values: FloatArray) -> list[FloatArray]:
        """Return the samples (N, ...) of every recording."""
        return np.split(values, np.cumsum([len(part.time) for part in self.rows.signals])[:-1])

    def reduce(self, values: FloatArray, joint: int) -> FloatArray:
        """Return the rows (m, ...) of a joint of columns (N, ...)."""
        pieces = zip(self.split(values), self.rows.signals, self.rows.places, strict=True)
        edge = self.rows.edge
        return np.concatenate(
            [pass_band(one, part.period, edge)[at][kept[:, joint]] for one, part, (at, kept) in pieces]
        )

    def list_inputs(self, shared: FloatArray | None) -> list[Mapping[str, FloatArray]]:
        """Return the inputs of laws of each joint, with loads of the shared parameters found last."""
        beta = self.beta if shared is None else shared[: len(self.beta)]
        load = np.concatenate([compute_link_torque(self.library, part, beta) for part in self.rows.signals])
        pairs = zip(self.velocity.T, load.T, strict=True)
        return [{"velocity": speed, "load": own, **self.clocks} for speed, own in pairs]

    def search(
        self, wanted: Sequence[rigid.Wanted], speeds: Sequence[FloatArray], torque: FloatArray
    ) -> rigid.Search:
        """Return the laws of all joints that leave least of a torque (m,)."""
        count, shared = _PARTS * len(self.rows.signals), len(self.beta) + self.library.card.size
        fold, rows = np.arange(count) % _PARTS // POLICY.parts, self.rows

        def tabulate(laws: Sequence[rigid.Wanted], x: FloatArray | None) -> list[rigid.JointTable]:
            tables = []
            for joint, (own, inputs) in enumerate(zip(laws, self.list_inputs(x), strict=True)):
                mine = rows.joint == joint
                members = [np.flatnonzero(rows.part[mine] == number) for number in range(count)]
                beside = partial(self.reduce, joint=joint), rows.design[mine, :shared], torque[mine]
                tables.append(rigid.tabulate_rows(own, inputs, *beside, members, fold))
            return tables

        return rigid.search_laws(tabulate, wanted, speeds)


def choose_laws(
    library: Library,
    signals: Sequence[ElasticSignals],
    edge: float,
    beta: FloatArray,
    stated: Mapping[str, FrictionValues],
    *,
    candidates: Sequence[str] = MOTOR_LAWS,
) -> MotorFriction:
    """Return the friction of motors; joints keep the law that is `stated` where none surely is better.

    `signals` are hardly filtered, rows reach up to `edge` Hz; loads are those of links with `beta` (p,), then
    with what the laws leave. A drift changes all terms of a law by 1 - exp(-t / T), t in its log or in all.
    Nothing is found where a stated law has a state, or reads more than speed and load.
    """
    limits, cards = MOVES * compute_speeds(signals), library.card.joints
    rows, given = _build_rows(library, signals, edge, limits), [stated[card.name] for card in cards]
    known = [get_law(law.law) for law in given if law.law != NO_FRICTION]
    plain = [law for law in known if not law.memory and set(law.inputs) <= {"velocity", "load"}]
    if len(plain) < len(given) or len(rows.torque) < _PARTS * len(signals) * rows.design.shape[1]:
        return MotorFriction((), (), (), beta)
    velocity = np.concatenate([part.dtheta for part in signals])
    motors = _MotorRows(library, rows, velocity, _list_clocks(signals), beta)
    speeds = [own[own > limit] for own, limit in zip(np.abs(velocity).T, limits, strict=True)]
    wanted = []
    for law, fast in zip(given, speeds, strict=True):
        laws = [get_law(name, smoothing=law.smoothing) for name in dict.fromkeys((law.law, *candidates))]
        wanted.append([(one, shape) for one in laws for shape in rigid.list_shape_nodes(one, fast)])
    steady = rows.torque.copy()
    # A drift may look like another law: laws are chosen again without it.
    for _ in range(2):
        search, found, moving = motors.search(wanted, speeds, steady), [], list[rigid.Wanted]()
        tried = zip(cards, given, search.tables, search.trials, search.choices, strict=True)
        for card, law, table, trials, choice in tried:
            before, best = trials[0], trials[choice.taken]
            taken = best if _is_surely_better(before, best) else before
            own = get_law(taken.law.name, smoothing=law.smoothing)
            moving.append([(one, taken.shape) for one in (own, *(_let_drift(own, k) for k in motors.clocks))])
            if taken is not before:
                told = rigid.describe_choice(table, trials, choice, "the torque", card.torque_unit)
                name = own.name
                found.append(FittedLaw(joint=card.name, law=name, smoothing=law.smoothing, selection=told))
        again = motors.search(moving, [np.zeros(0)] * len(cards), rows.torque)
        drifting, drift = [], np.zeros_like(velocity)
        tested = zip(cards, again.trials, motors.list_inputs(again.shared), strict=True)
        for joint, (card, (before, *others), inputs) in enumerate(tested):
            best = min(others, key=lambda one: float(one.own.sum()))
            if _is_surely_better(before, best, len(others)):
                added = slice(len(before.law.linear), None)
                drift[:, joint] = compute_columns(best.law, inputs, best.shape)[:, added] @ best.linear[added]
                mine = rows.joint == joint
                steady[mine] = rows.torque[mine] - motors.reduce(drift[:, joint], joint)
                drifting.append(card.name)
        if not drifting:
            break
    return MotorFriction(tuple(found), tuple(drifting), tuple(motors.split(drift)), again.shared[: len(beta)])


def _list_clocks(signals: Sequence[ElasticSignals]) -> dict[str, FloatArray]:
    """Return 1 - exp(-t / T) (N,) less its mean, of times in each log or in all, for times T by name."""
    own, clocks = [part.time - part.time[0] for part in signals], dict[str, FloatArray]()
    begins = np.cumsum([0.0, *(time[-1] for time in own[:-1])])
    both = {"in its log": own, "in all logs": [time + begun for time, begun in zip(own, begins, strict=True)]}
    for name, times in both.items():
        time = np.concatenate(times)
        for power in range(-1, 4):
            change = -np.exp(-time * 2.0**power / time.max())
            clocks[f"{name}, {power}"] = change - change.mean()
    return clocks


def _let_drift(law: FrictionLaw, clock: str) -> FrictionLaw:
    """Return a law whose parameters change in proportion to one of the inputs."""

    def compute(carrier: Any, inputs: Any, shape: Any) -> tuple[Any, ...]:  # noqa: ANN401  of any carrier
        columns = law.columns(carrier, inputs, shape)
        return (*columns, *(carrier.mul(column, inputs[clock]) for column in columns))

    return replace(law, name=f"{law.name}, {clock}", linear=(*law.linear, *law.linear), columns=compute)


def _is_surely_better(before: rigid.Trial, after: rigid.Trial, tried: int = 1) -> bool:
    gain = compare(before.own[:, None], after.own[:, None])
    return tried * gain.p_of_all < POLICY.alarm and gain.fall_of_all > POLICY.fall_of_all


_WAVE = 1.09
"""Fall of the squares by a wave of the torsion, at least, as a spring of stops leaves waves, too: springs of
eight other kinds gave 1.07 at most, discs that are off by a thirtieth of the torsion 1.1 to 2.2."""


def measure_gears(library: Library, signals: Sequence[ElasticSignals], beta: FloatArray) -> Effects:
    """Return the kinematic errors of the gears, given the links' base parameters (p,)."""
    found: list[DriveEffect] = []
    for joint, rows in list_joint_rows(library, signals, beta, turns=True):
        own: list[DriveEffect] = []
        for _ in range(numerics.ROUNDS):
            _, errors = _fit_gear(rows, own)
            theta = np.concatenate([part.theta[part.kept] for part in rows])
            order = _find_order(theta, np.concatenate(errors))
            if not order:
                break
            trial = DriveEffect(kind="kinematic-error", joint=joint, order=order, values=tuple(np.zeros(2)))
            better, after = _fit_gear(rows, [*own, trial])
            gain = _compare_errors(errors, after)
            if not (gain.p_of_all < POLICY.alarm and gain.fall_of_all > _WAVE):
                break
            own = better
        found += own
    return tuple(found)


def _compare_errors(before: Sequence[FloatArray], after: Sequence[FloatArray]) -> Gain:
    """Return how much less errors (M,) of every recording became, part by part."""
    sides = ([part for own in errors for part in np.array_split(own, _PARTS)] for errors in (before, after))
    return compare(*(np.array([[np.mean(part**2)] for part in side]) for side in sides))


def compute_link_torque(library: Library, signals: ElasticSignals, beta: FloatArray) -> FloatArray:
    """Return the torque (N, n) that moves the links, of base parameters (p,), N m or N."""
    (momentum,) = library.evaluate("momentum_regressor", signals.q, signals.dq)
    (lagrange,) = library.evaluate("lagrange_regressor", signals.q, signals.dq)
    torque: FloatArray = differentiate_smooth(momentum @ beta, signals.period) - lagrange @ beta
    return torque + signals.link_drag


def measure_link_friction(library: Library, signals: Sequence[ElasticSignals], beta: FloatArray) -> Effects:
    """Return the viscous friction of links that springs show, given the links' base parameters (p,).

    Where motor and link move as one, the sum of both sides cannot tell whose friction it is: the torque of
    the links is that of the spring, less their friction.
    """
    found = []
    for joint, rows in list_joint_rows(library, signals, beta, turns=True):
        before, after, values = list[FloatArray](), list[FloatArray](), list[tuple[float, float]]()
        for part in rows:
            rate, speed = (
                differentiate_smooth(side, part.period) for side in (part.phi, part.theta - part.phi)
            )
            basis = np.column_stack([build_spring_basis(part.phi, part.kept, part.period), rate[part.kept]])
            whole, torque = np.column_stack([basis, -speed[part.kept]]), part.torque[part.kept]
            weights = solve_scaled(whole, torque, rcond=numerics.RANK)
            before.append(torque - basis @ solve_scaled(basis, torque, rcond=numerics.RANK))
            after.append(torque - whole @ weights)
            # Infinite where a joint does not move enough; zero would be no noise at all.
            variance = max(float(compute_covariance(whole, after[-1])[-1, -1]), numerics.TINY)
            values.append((float(weights[-1]), variance))
        if min(value for value, _ in values) < 0.0:
            continue
        gain, information = _compare_errors(before, after), sum(1.0 / variance for _, variance in values)
        if information > 0.0 and gain.p_of_all < POLICY.alarm and gain.fall_of_all > _WAVE:
            value = sum(value / variance for value, variance in values) / information
            spread = (information**-0.5,)
            found.append(DriveEffect(kind="link-friction", joint=joint, values=(value,), deviations=spread))
    return tuple(found)


class JointRows(NamedTuple):
    """A joint in one recording: motor's position, torsion, link's torque (N,), and the samples that count."""

    theta: FloatArray
    phi: FloatArray
    torque: FloatArray
    kept: slice
    period: float
    cutoff: float


def list_joint_rows(
    library: Library, signals: Sequence[ElasticSignals], beta: FloatArray, *, turns: bool = False
) -> Iterator[tuple[int, list[JointRows]]]:
    """Yield elastic joints and the recordings that bend, or turn, them well; `beta` (p,) are the links'."""
    loads = [compute_link_torque(library, part, beta) for part in signals]
    for joint in np.flatnonzero(library.card.yielding).tolist():
        spans, rows = [float(np.ptp((part.theta if turns else part.phi)[:, joint])) for part in signals], []
        for part, load, span in zip(signals, loads, spans, strict=True):
            edge = count_edge(part.period, part.cutoff)
            step = max(1, round(0.5 / (part.cutoff * part.period))) if part.cutoff else 1
            kept = slice(max(edge, part.settled), len(part.time) - edge, step)
            if span > MOVES * max(spans) and kept.start < kept.stop:
                theta, phi, torque = (values[:, joint] for values in (part.theta, part.phi, load))
                rows.append(JointRows(theta, phi, torque, kept, part.period, part.cutoff))
        if rows:
            yield joint, rows


_STEPS = 3
"""Of waves of the torsion: later ones follow what noise and friction make of stops, not the wave."""


def _fit_gear(
    rows: Sequence[JointRows], effects: Sequence[DriveEffect]
) -> tuple[list[DriveEffect], list[FloatArray]]:
    """Return effects with better values, and the errors (M,) of the torsion in every recording."""
    found = list(effects)
    values = np.array([value for effect in found for value in effect.values])
    for _ in range(_STEPS):
        errors, steps, counts = [], [], []
        for part in rows:
            angles = np.outer(part.theta, [effect.order for effect in found])
            shapes = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(angles), -1)
            if part.cutoff and found:
                # As the signals were filtered.
                shapes = pass_band(shapes, part.period, part.cutoff)
            basis = build_spring_basis(part.phi + shapes @ values, part.kept)
            torque = part.torque[part.kept]
            weights = solve_scaled(np.hstack([basis, shapes[part.kept]]), torque, rcond=numerics.RANK)
            # Waves are short: the spring answers them with the stiffness it has after a reversal.
            slopes = weights[: basis.shape[1] - 2]
            stiffness = max(float(np.sum(slopes)), MOVES * float(np.max(np.abs(slopes)))) or 1.0
            errors.append((torque - basis @ solve_scaled(basis, torque, rcond=numerics.RANK)) / stiffness)
            steps.append(weights[basis.shape[1] :] / stiffness * len(torque))
            counts.append(len(torque))
        values = values + sum(steps) / sum(counts)
    # Waves are orthogonal to each other and to the rest: the mean square of each is one half.
    square = float(np.mean(np.concatenate(errors) ** 2))
    spread = float(np.sqrt(2.0 * square / sum(len(part) for part in errors)))
    pairs = zip(found, values.reshape(-1, 2), strict=True)
    found = [replace(one, values=tuple(own.tolist()), deviations=(spread,) * 2) for one, own in pairs]
    return found, errors


def measure_eccentricity(library: Library, signals: Sequence[ElasticSignals], beta: FloatArray) -> Effects:
    """Return the eccentricity of the links' encoders, given the links' base parameters (p,).

    Gravity and springs have waves of one turn, too: what a spring of many stops leaves must be less by a
    share that such springs never reach. Deviations are open.
    """
    found: list[DriveEffect] = []
    for joint, rows in list_joint_rows(library, signals, beta, turns=True):
        torsion = np.concatenate([part.phi[:, joint] for part in signals])
        # Where the link's zero is not known, it is turned, and the wave is that of wrong gravity.
        turned = abs(float(np.mean(torsion))) > float(np.ptp(torsion))
        if turned or library.card.joints[joint].kind != "revolute":
            continue
        # Waves are as long as the motion, and springs answer with all they have: they are fitted each time.
        every = max(1, sum(len(part.theta[part.kept]) for part in rows) // SAMPLES)
        kept = [slice(part.kept.start, part.kept.stop, every * part.kept.step) for part in rows]
        few = [part._replace(kept=own) for part, own in zip(rows, kept, strict=True)]
        size = max(float(np.std(part.phi)) for part in rows)

        def leave(
            values: FloatArray, rows: Sequence[JointRows] = rows, size: float = size
        ) -> list[FloatArray]:
            errors = []
            for part in rows:
                wave = size * (values[0] * np.cos(part.theta) + values[1] * np.sin(part.theta))
                columns = build_spring_basis(part.phi + wave, part.kept, part.period)
                torque = part.torque[part.kept]
                errors.append(torque - columns @ solve_scaled(columns, torque, rcond=numerics.RANK))
            return errors

        before = leave(np.zeros(2))
        level = float(np.sqrt(np.mean(np.concatenate(before) ** 2))) or 1.0
        fit = scipy.optimize.least_squares(
            lambda values, leave=leave, few=few, level=level: np.concatenate(leave(values, few)) / level,
            np.zeros(2),
            diff_step=STEP,
            x_scale=0.1,
        )
        values, gain = size * fit.x, _compare_errors(before, leave(fit.x))
        # Where a joint turns little, a wave far longer than its torsion would do for a spring.
        small = math.hypot(*values) < 0.5 * float(np.ptp(torsion))
        if small and gain.p_of_all < POLICY.alarm and gain.fall_of_all > _WAVE:
            ends = tuple(values.tolist())
            found.append(DriveEffect(kind="link-eccentricity", joint=joint, order=1.0, values=ends))
    return tuple(found)


def refine_eccentricity(problem: ElasticProblem, chi: FloatArray, discs: Sequence[DriveEffect]) -> Effects:
    """Return the eccentricities nearer to what springs with stops and knees leave least with.

    One step of Gauss and Newton for wave and spring together, in the torque of links with the dynamic
    parameters chi (p + n + pf,); `problem` is freed of `discs`.
    """
    springs = problem.fit_springs(problem.average_sides(chi))
    link = problem.compute_link_side(chi)
    refined = []
    for disc in discs:
        joint, spring = disc.joint, springs[disc.joint]

        def compute(spring: Elasticity, wave: FloatArray | None = None, joint: int = joint) -> FloatArray:
            parts = []
            for signals, rows in zip(problem.signals, problem.filtered, strict=True):
                q, error = signals.q[:, joint], signals.phi - (signals.theta - signals.q)
                if wave is not None:
                    error[:, joint] += wave[0] * np.cos(q) + wave[1] * np.sin(q)
                moved = replace(signals, error=error)
                parts.append(rows.pass_spring(spring, moved, joint, problem.options.filter_rate))
            return np.concatenate(parts)

        left, step = link[:, joint] - compute(spring), STEP * math.hypot(*disc.values)
        columns = [(compute(spring, way) - compute(spring, -way)) / (2.0 * step) for way in step * np.eye(2)]
        design = np.column_stack([*columns, differentiate_spring(spring, compute)])
        moved = solve_scaled(design, left, rcond=numerics.RANK)
        deviations = np.sqrt(np.diag(compute_covariance(design, left - design @ moved)[:2, :2]))
        values = (np.array(disc.values) + moved[:2]).tolist()
        refined.append(replace(disc, values=tuple(values), deviations=tuple(deviations.tolist())))
    return tuple(refined)


def measure_offsets(library: Library, signals: Sequence[ElasticSignals], beta: FloatArray) -> Effects:
    """Return the offsets of torsions that lie beyond their own range: encoders with other zeros.

    A load of one sign bends a spring to one side, too: torsion = torque / k + offset is fitted, with the base
    parameters of the links (p,), and the offset counts where it is most of the mean.
    """
    found = []
    loads = np.concatenate([compute_link_torque(library, part, beta) for part in signals])
    for joint in range(library.card.size):
        torsion = np.concatenate([part.phi[:, joint] for part in signals])
        low, high = float(torsion.min()), float(torsion.max())
        middle = 0.5 * (low + high)
        if abs(middle) <= high - low:
            continue
        design = np.column_stack([np.ones_like(torsion), loads[:, joint]])
        offset = float(solve_scaled(design, torsion, rcond=numerics.RANK)[0])
        # The load explains no more than how far it is bent.
        if low <= offset <= high:
            half = 0.5 * (high - low)
            own = DriveEffect(kind="torsion-offset", joint=joint, values=(middle,), deviations=(half,))
            found.append(own)
    return tuple(found)
