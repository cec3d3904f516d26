"""What drives and links add to elastic joints, found from the sum of both sides, in which no spring stands.

    tau(t - lag) = Y chi + d dq + sum_N (a_N cos N theta + b_N sin N theta)

    lag      the torque acts later than its samples say: a loop of the current, a bus          one a robot
    d        viscous friction of the link's bearings, N m s/rad or N s/m                       one a joint
    ripple   torque of period 2 pi / N: teeth, poles, the wave generator of a harmonic drive   any joint
    gear     torsion = theta - q + a_N cos N theta + b_N sin N theta - offset                  any joint
    link     q = its encoder's reading - a cos q - b sin q: a disc that is not centred            revolute

All columns pass one zero-phase low-pass, rows of slow motors are left out. A term enters where blocks of
time, each predicted by a fit to the others, are predicted better: by three standard errors, and by one
percent of the variance. The lag is the coefficient of the torque's derivative, repeated with the torque moved
until it is zero. Orders N are peaks of the residual over theta. Errors of the gear are those of the torsion
that a spring of many stops leaves of the links' torque.

Supported: several recordings, for a lag of one rate; any gear, N need not be whole.
Not supported: ripple that grows with the load; encoders that run late (align the recordings first).
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library
from symid.errors import RobotError
from symid.identification.diagnostics import sum_block_scores
from symid.identification.elastic.elimination import compute_speeds, filter_band
from symid.identification.elastic.estimate import compute_covariance, list_spring_numbers, move_spring
from symid.identification.elastic.regression import (
    DriveEffect,
    ElasticProblem,
    ElasticSignals,
    compute_joint_torque,
    mark_sliding,
)
from symid.identification.hysteresis import filter_smooth
from symid.identification.regression import solve_scaled
from symid.joint_models import Elasticity, compute_stop_basis
from symid.logs import differentiate_smooth, low_pass, shift_channel

_BLOCKS = 8
_SURE, _GAIN = 3.0, 0.01
_AGREED, _LESS = 6.0, 2.0
"""Standard errors of the gain of an effect, and least gain; deviations (jackknife) of a number that blocks
agree on, and the standard errors that then do."""
_MOST = 10
"""Effects; a robot with more has another problem."""
_STILL = 0.1
"""Of a joint's RMS speed: slower rows hold friction that no law of the speed has."""
_ENOUGH = 20
"""Rows a parameter."""
_LAG_ROUNDS, _LEAST_LAG, _LONGEST_LAG = 6, 0.05, 0.01
"""The least of the sample period, the longest in s."""
_ORDER, _CUT = 4, 2.0
"""Of the low-pass; and periods of the signals' cut-off that are cut at both ends."""
_RANK = 1e-10
"""Relative singular value of what is not identifiable."""
_EXACT = 1e-8
"""Of the torque's mean square."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rows(FrozenArrays):
    """Rows of all recordings, design @ chi = torque, and where each stands.

    Args:
        design: (m, p); torque: (m,).
        group: (m,) recording and joint; joint: (m,); block: (m,) of its recording; theta: (m,).
        places: for each recording its samples and (M, n) which rows count.
    """

    signals: tuple[ElasticSignals, ...]
    edge: float
    design: FloatArray
    torque: FloatArray
    group: NDArray[np.intp]
    joint: NDArray[np.intp]
    block: NDArray[np.intp]
    theta: FloatArray
    places: tuple[tuple[slice, NDArray[np.bool_]], ...]

    def stack(self, columns: Sequence[FloatArray]) -> FloatArray:
        """Return the rows (m, k) of columns (N, n, k) of every recording, low-passed."""
        parts = []
        for part, (place, kept), values in zip(self.signals, self.places, columns, strict=True):
            smooth = low_pass(values, period=part.period, cutoff=self.edge, order=_ORDER)
            parts.append(smooth[place][kept])
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
        floor = 1e-9 * max(float(np.sqrt(np.mean(self.torque**2))), 1e-300)
        counts, weights = np.maximum(np.bincount(self.group), 1), np.ones(len(self.torque))
        for _ in range(3):
            values = solve_scaled(whole * weights[:, None], self.torque * weights, rcond=_RANK)
            errors = self.torque - whole @ values
            scatter = np.sqrt(np.bincount(self.group, errors**2) / counts)
            weights = 1.0 / np.maximum(scatter, floor)[self.group]
        return values, errors, weights

    def predict(self, extra: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean squared weighted errors (b,) of every block, predicted by a fit to the others.

        And the last coefficient (b,) of these fits.
        """
        whole = np.column_stack([self.design, extra, self.torque]) * weights[:, None]
        lengths = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
        whole /= lengths
        parts = [whole[self.block == number] for number in range(_BLOCKS)]
        grams = np.array([part.T @ part for part in parts])
        losses, last = np.empty((2, _BLOCKS))
        for number, left in enumerate(sum(grams) - grams):
            values = np.linalg.lstsq(left[:-1, :-1], left[:-1, -1], rcond=_RANK)[0]
            losses[number] = np.mean((parts[number][:, -1] - parts[number][:, :-1] @ values) ** 2)
            last[number] = values[-1] * lengths[-1] / lengths[-2]
        # What is left of exact logs is rounding, which no effect explains.
        return losses + _EXACT / len(whole), last


def _build_rows(library: Library, signals: Sequence[ElasticSignals], edge: float) -> _Rows:
    size, speeds, places = library.card.size, compute_speeds(signals), []
    parts: list[list[NDArray[Any]]] = []
    for number, part in enumerate(signals):
        place, design, torque = filter_band(library, part, edge)
        kept = mark_sliding(part, 1.0 / edge, _STILL * speeds)[place]
        time, joint = np.arange(len(kept))[:, None], np.broadcast_to(np.arange(size), kept.shape)
        block = np.broadcast_to(time * _BLOCKS // max(1, len(kept)), kept.shape)
        places.append((place, kept))
        columns = (design, torque, number * size + joint, joint, block, part.theta[place])
        parts.append([values[kept] for values in columns])
    names = ("design", "torque", "group", "joint", "block", "theta")
    rows = dict(zip(names, map(np.concatenate, zip(*parts, strict=True)), strict=True))
    return _Rows(signals=tuple(signals), edge=edge, places=tuple(places), **rows)


def measure_effects(
    library: Library, signals: Sequence[ElasticSignals], edge: float
) -> tuple[DriveEffect, ...]:
    """Return the effects that recordings show beyond doubt, with their values.

    `signals` are hardly filtered, without effects; rows reach up to `edge` Hz.
    """
    rows = _build_rows(library, signals, edge)
    if len(rows.torque) < _ENOUGH * rows.design.shape[1] or len(set(rows.block.tolist())) < _BLOCKS:
        return ()
    apart = np.concatenate([part.dtheta - part.dq for part in signals])
    speeds, apart = compute_speeds(signals), np.sqrt(np.mean(apart**2, axis=0))
    # Where motor and link move as one, their friction cannot be told apart: it is the motor's.
    shaken = (apart > _APART * speeds) & (speeds > _APART * float(np.max(speeds)))
    # Recordings of several rates are not late alike.
    periods = {part.period for part in signals}
    longest = max(periods)
    plain = [DriveEffect(kind="torque-lag")] if len(periods) == 1 else []
    plain += [DriveEffect(kind="link-friction", joint=joint) for joint in np.flatnonzero(shaken).tolist()]
    found: list[DriveEffect] = []
    extra = np.empty((len(rows.torque), 0))
    while len(found) < _MOST:
        _, errors, weights = rows.solve(extra)
        (before, _), tried = rows.predict(extra, weights), []
        candidates = [effect for effect in plain if effect not in found]
        for joint in range(len(speeds)):
            # The largest peak of the joint's errors.
            own = rows.joint == joint
            if order := _find_order(rows.theta[own], (errors * weights)[own]):
                candidates.append(DriveEffect(kind="torque-ripple", joint=joint, order=order))
        for effect in candidates:
            further = np.hstack([extra, rows.build(effect)])
            # A torque that is held acts hardly before its sample.
            if effect.kind == "torque-lag" and not (
                -0.75 * longest <= float(rows.solve(further)[0][-1]) <= _LONGEST_LAG
            ):
                continue
            after, values = rows.predict(further, weights)
            mean, error = _measure_gain(np.log(before / after))
            # Blocks gain unequally where motions differ: a number that all agree on needs less of it.
            deviation = np.sqrt(_BLOCKS - 1.0) * float(np.std(values))
            alone = further.shape[1] == extra.shape[1] + 1
            agreed = alone and abs(float(np.mean(values))) > _AGREED * deviation
            if mean > max(_GAIN, (_LESS if agreed else _SURE) * error):
                tried.append((mean, effect, further))
        if not tried:
            break
        _, best, extra = max(tried, key=lambda entry: entry[0])
        found.append(best)
    return tuple(_measure_values(rows, found))


def _measure_gain(gains: FloatArray) -> tuple[float, float]:
    """Return the mean of the gains (b,) of blocks, and its standard error."""
    return float(np.mean(gains)), float(np.std(gains, ddof=1)) / math.sqrt(len(gains))


_APART = 0.3
"""Of a motor's RMS speed, that of the torsion; of the fastest motor's, that of the joint."""
_LEAST_TURNS, _LARGEST_ORDER, _PEAK, _STEP = 10.0, 1000.0, 25.0, 0.25
"""Of ripple: periods within the range; a turn; power over the median; of orders, over the resolution."""


def _find_order(theta: FloatArray, errors: FloatArray, turns: float = _LEAST_TURNS) -> float:
    """Return the order of the largest peak of errors (m,) over positions (m,), 0 for none that stands out."""
    span = float(np.ptp(theta)) if len(theta) else 0.0
    if not span > 0.0:
        return 0.0
    width = 2.0 * np.pi / span
    orders = np.arange(turns * width, max(_LARGEST_ORDER, 2.0 * turns * width), _STEP * width)
    power = _compute_power(theta, errors, orders)
    best = int(np.argmax(power))
    if power[best] < _PEAK * float(np.median(power)):
        return 0.0
    near = orders[best] + width * np.linspace(-_STEP, _STEP, 41)
    order = float(near[np.argmax(_compute_power(theta, errors, near))])
    # Teeth and poles come in whole numbers, gears often do.
    return float(round(order)) if abs(order - round(order)) < _WHOLE * width else order


_WHOLE = 0.02
"""Of the resolution of orders."""


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
    late = any(effect.kind == "torque-lag" for effect in found)
    ordered = sorted(found, key=lambda effect: effect.kind != "torque-lag")
    lag, step, before, slope = 0.0, 0.0, 0.0, 1.0
    moved, base = rows, rows.design.shape[1]
    for number in range(_LAG_ROUNDS):
        parts = [moved.build(effect) for effect in ordered]
        values, _, weights = moved.solve(np.hstack(parts))
        if not late or number == _LAG_ROUNDS - 1:
            break
        # Noise in the derivative makes the coefficient small: the secant says by how much.
        left = float(values[base])
        if number:
            slope = float(np.clip((before - left) / step, _LEAST_SLOPE, 1.0)) if step else slope
        step, before = left / slope, left
        lag += step
        signals = tuple(replace(part, tau=shift_channel(part.time, part.tau, -lag)) for part in rows.signals)
        torques = replace(rows, signals=signals).stack([part.centred_torque[..., None] for part in signals])
        moved = replace(rows, signals=signals, torque=torques[:, 0])
    whole = np.hstack([moved.design, *parts]) * weights[:, None]
    lengths = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
    spread = np.sqrt(np.diag(np.linalg.pinv((whole / lengths).T @ (whole / lengths), rcond=_RANK))) / lengths
    # A torque that is held acts half a period after its sample, which the signals have already.
    total = lag + 0.5 * rows.signals[0].period
    if late and not -3.0 * spread[base] / slope <= total <= _LONGEST_LAG:
        yield from _measure_values(rows, [effect for effect in ordered if effect.kind != "torque-lag"])
        return
    ends = base + np.cumsum([0, *(columns.shape[1] for columns in parts)])
    for effect, start, end in zip(ordered, ends[:-1], ends[1:], strict=True):
        own, deviations = values[start:end], spread[start:end]
        if effect.kind == "torque-lag":
            if abs(lag) <= _LEAST_LAG * rows.signals[0].period:
                continue
            own, deviations = np.array([total]), deviations / slope
        yield replace(effect, values=tuple(own.tolist()), deviations=tuple(deviations.tolist()))


_LEAST_SLOPE = 0.02
_STOPS = 12
_SOFT = 0.1
_GEAR_ROUNDS, _MOST_ORDERS, _GEAR_TURNS, _GEAR_GAIN = 3, 3, 30.0, 0.1
"""Of the last: what a spring of stops misses can look like a wave of one percent."""


def measure_gears(
    library: Library, signals: Sequence[ElasticSignals], beta: FloatArray
) -> tuple[DriveEffect, ...]:
    """Return the kinematic errors of the gears, given the links' base parameters (p,)."""
    found: list[DriveEffect] = []
    loads = [compute_link_torque(library, part, beta) for part in signals]
    for joint, gives in enumerate(library.card.yielding):
        rows = _build_gear_rows(signals, loads, joint) if gives else []
        own: list[DriveEffect] = []
        while rows and len(own) < _MOST_ORDERS:
            _, errors = _fit_gear(rows, own)
            theta = np.concatenate([part.theta[part.kept] for part in rows])
            # What a spring of stops misses is long: a few waves within the range of the motion.
            order = _find_order(theta, np.concatenate(errors), _GEAR_TURNS)
            if not order:
                break
            trial = [*own, DriveEffect(kind="kinematic-error", joint=joint, order=order, values=(0.0, 0.0))]
            better, after = _fit_gear(rows, trial)
            squares = np.array(
                [
                    [np.mean(block**2) for part in side for block in np.array_split(part, _BLOCKS)]
                    for side in (errors, after)
                ]
            )
            mean, deviation = _measure_gain(np.log(squares[0] / squares[1]))
            if not mean > max(_GEAR_GAIN, _SURE * deviation):
                break
            own = better
        found += own
    return tuple(found)


def compute_link_torque(library: Library, signals: ElasticSignals, beta: FloatArray) -> FloatArray:
    """Return the torque (N, n) that moves the links, of base parameters (p,), N m or N."""
    (momentum,) = library.evaluate("momentum_regressor", signals.q, signals.dq)
    (lagrange,) = library.evaluate("lagrange_regressor", signals.q, signals.dq)
    torque: FloatArray = differentiate_smooth(momentum @ beta, signals.period) - lagrange @ beta
    return torque + signals.link_drag


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _GearRows(FrozenArrays):
    """One joint in one recording: motor position, torsion and torque (N,), and the samples that count."""

    theta: FloatArray
    phi: FloatArray
    torque: FloatArray
    kept: slice
    period: float
    cutoff: float

    @property
    def counted(self) -> FloatArray:
        """Return the torque (M,) of the samples that count."""
        return self.torque[self.kept]


def _build_gear_rows(
    signals: Sequence[ElasticSignals], loads: Sequence[FloatArray], joint: int
) -> list[_GearRows]:
    """Return the recordings in which a joint moves well."""
    spans = [float(np.ptp(part.theta[:, joint])) for part in signals]
    rows = []
    for part, load, span in zip(signals, loads, spans, strict=True):
        edge, step = 1, 1
        if part.cutoff:
            edge = int(np.ceil(_CUT / (part.cutoff * part.period)))
            step = max(1, round(0.5 / (part.cutoff * part.period)))
        if span > _MOVES * max(spans) and len(part.time) > 4 * edge:
            own = _GearRows(
                theta=part.theta[:, joint],
                phi=part.phi[:, joint],
                torque=load[:, joint],
                kept=slice(max(edge, part.settled), len(part.time) - edge, step),
                period=part.period,
                cutoff=part.cutoff,
            )
            rows.append(own)
    return rows


_MOVES = 0.1


def _fit_gear(
    rows: Sequence[_GearRows], effects: Sequence[DriveEffect]
) -> tuple[list[DriveEffect], list[FloatArray]]:
    """Return effects with better values, and the errors (M,) of the torsion in every recording."""
    found = list(effects)
    errors: list[FloatArray] = []
    for _ in range(_GEAR_ROUNDS if effects else 1):
        errors, steps, counts = [], [], []
        values = np.array([value for effect in found for value in effect.values])
        for part in rows:
            angles = np.outer(part.theta, [effect.order for effect in found])
            shapes = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(angles), -1)
            if part.cutoff and found:
                # As the signals were filtered.
                shapes = low_pass(shapes, period=part.period, cutoff=part.cutoff, order=_ORDER)
            basis = _build_spring_basis(part.phi + shapes @ values)[part.kept]
            torque = part.counted
            weights = solve_scaled(np.hstack([basis, shapes[part.kept]]), torque, rcond=_RANK)
            # Waves are short: the spring answers them with the stiffness it has after a reversal.
            slopes = weights[: _STOPS + 1]
            stiffness = max(float(np.sum(slopes)), _SOFT * float(np.max(np.abs(slopes)))) or 1.0
            errors.append((torque - basis @ solve_scaled(basis, torque, rcond=_RANK)) / stiffness)
            steps.append(weights[basis.shape[1] :] / stiffness * len(torque))
            counts.append(len(torque))
        values = values + sum(steps) / sum(counts)
        found = [
            replace(effect, values=tuple(values[2 * k : 2 * k + 2].tolist()))
            for k, effect in enumerate(found)
        ]
    # Waves are orthogonal to each other and to the rest: the mean square of each is one half.
    square = float(np.mean(np.concatenate(errors) ** 2))
    spread = float(np.sqrt(2.0 * square / sum(len(part) for part in errors)))
    return [replace(effect, deviations=(spread, spread)) for effect in found], errors


def measure_eccentricity(
    library: Library, signals: Sequence[ElasticSignals], beta: FloatArray
) -> tuple[DriveEffect, ...]:
    """Return the eccentricity of the links' encoders, given the links' base parameters (p,).

    Gravity bends a spring by a wave of one turn, too, and so does much that a spring has: what a spring of
    many stops leaves must be less by a share that such springs never reach.
    """
    found: list[DriveEffect] = []
    loads = [compute_link_torque(library, part, beta) for part in signals]
    for joint, card in enumerate(library.card.joints):
        turns = library.card.yielding[joint] and card.kind == "revolute"
        torsion = np.concatenate([part.phi[:, joint] for part in signals])
        # Where the link's zero is not known, it is turned, and the wave is that of wrong gravity.
        turned = abs(float(np.mean(torsion))) > float(np.ptp(torsion))
        rows = _build_gear_rows(signals, loads, joint) if turns and not turned else []
        waves = [np.column_stack([np.cos(part.theta), np.sin(part.theta)]) for part in rows]
        # A torque of the same form: a small wave of the torsion gives little more.
        bases = [_build_spring_basis(part.phi, part.period) for part in rows]
        wider = [np.hstack(pair) for pair in zip(bases, waves, strict=True)]
        gain = _compute_gain(_leave_torque(rows, bases), _leave_torque(rows, wider)) if rows else 0.0
        if gain < 0.5 * _DISC_GAIN:
            continue
        values, covariance, gain = _fit_disc(rows, waves)
        # Where a joint turns little, a wave far longer than its torsion would do for a spring.
        small = math.hypot(*values) < 0.5 * float(np.ptp(torsion))
        if small and gain > _DISC_GAIN and values @ np.linalg.pinv(covariance) @ values > _DISC_SURE:
            found.append(
                _state(DriveEffect(kind="link-eccentricity", joint=joint, order=1.0), values, covariance)
            )
    return tuple(found)


def _state(effect: DriveEffect, values: FloatArray, covariance: FloatArray) -> DriveEffect:
    """Return an effect with values (k,) of a covariance (k, k)."""
    deviations = np.sqrt(np.diag(covariance)).tolist()
    return replace(effect, values=tuple(values.tolist()), deviations=tuple(deviations))


def refine_eccentricity(
    problem: ElasticProblem, chi: FloatArray, discs: Sequence[DriveEffect]
) -> tuple[DriveEffect, ...]:
    """Return the eccentricities nearer to what springs with stops and knees leave least with.

    One step of Gauss and Newton for wave and spring together, in the torque of links with the dynamic
    parameters chi (p + n + pf,); `problem` is freed of `discs`.
    """
    springs = problem.fit_springs(problem.average_sides(chi))
    link = problem.compute_link_side(chi)
    refined = []
    for disc in discs:
        joint, spring = disc.joint, springs[disc.joint]

        def compute(
            spring: Elasticity, wave: Sequence[float] | FloatArray = (0.0, 0.0), joint: int = joint
        ) -> FloatArray:
            parts = []
            for signals, rows in zip(problem.signals, problem.filtered, strict=True):
                q, error = signals.q[:, joint], signals.phi - (signals.theta - signals.q)
                error[:, joint] += wave[0] * np.cos(q) + wave[1] * np.sin(q)
                torque = compute_joint_torque(spring, replace(signals, error=error), joint)
                parts.append(filter_smooth(torque, problem.options.rate, signals.period)[rows.keep])
            return np.concatenate(parts)

        left, step = link[:, joint] - compute(spring), _WAVE_STEP * math.hypot(*disc.values)
        columns = [(compute(spring, way) - compute(spring, -way)) / (2.0 * step) for way in step * np.eye(2)]
        for value, place in list_spring_numbers(spring):
            # At the edge of what springs can be, a number stays.
            with suppress(RobotError):
                above, below = (
                    compute(move_spring(spring, place, value * (1.0 + side * _WAVE_STEP)))
                    for side in (1.0, -1.0)
                )
                columns.append((above - below) / (2.0 * _WAVE_STEP * value))
        design = np.column_stack(columns)
        moved = solve_scaled(design, left, rcond=_RANK)
        errors = left - design @ moved
        covariance = compute_covariance(design, errors)[:2, :2]
        refined.append(_state(disc, np.array(disc.values) + moved[:2], covariance))
    return tuple(refined)


_WAVE_STEP = 1e-3
_DISC_SURE = 16.0
"""Chi^2 of two numbers: three in ten thousand by chance."""
_DISC_GAIN = 0.09
"""Logarithm of the ratio of mean squares: springs of eight other kinds gave 0.03 at most, and 0.07 where
encoders are exact; discs that are off by a thirtieth of the torsion gave 0.1 to 0.8."""


def _leave_torque(rows: Sequence[_GearRows], bases: Sequence[FloatArray]) -> FloatArray:
    """Return what columns of every recording leave of its torque (M,), each fitted alone."""
    errors = []
    for part, basis in zip(rows, bases, strict=True):
        columns = basis[part.kept]
        errors.append(part.counted - columns @ solve_scaled(columns, part.counted, rcond=_RANK))
    return np.concatenate(errors)


def _compute_gain(before: FloatArray, after: FloatArray) -> float:
    return float(np.log(max(float(before @ before), 1e-300) / max(float(after @ after), 1e-300)))


def _fit_disc(rows: Sequence[_GearRows], waves: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray, float]:
    """Return a, b (2,) of a wave of one turn, their covariance (2, 2), and its gain."""
    # As long as the motion, so that springs answer with all they have: they are fitted again for every trial.
    size = max(float(np.std(part.phi)) for part in rows)

    def leave(values: FloatArray) -> FloatArray:
        pairs = zip(rows, waves, strict=True)
        bases = [_build_spring_basis(part.phi + wave @ (size * values), part.period) for part, wave in pairs]
        return _leave_torque(rows, bases)

    before = leave(np.zeros(2))
    level = float(np.sqrt(np.mean(before**2))) or 1.0
    fit = scipy.optimize.least_squares(
        lambda values: leave(values) / level, np.zeros(2), diff_step=1e-4, x_scale=0.1
    )
    # What springs of stops leave is correlated.
    inverse = np.linalg.pinv(fit.jac.T @ fit.jac)
    scores, _ = sum_block_scores(fit.jac, fit.fun, np.zeros(len(fit.fun), dtype=np.intp), _STRETCHES)
    covariance = size**2 * (inverse @ scores @ inverse)
    return size * fit.x, covariance, _compute_gain(before, level * fit.fun)


def _build_spring_basis(torsion: FloatArray, period: float | None = None) -> FloatArray:
    """Return columns (N, c) of a spring of many stops; with a `period` in s, as behind knees and dampers."""
    grid = 0.5 * float(np.ptp(torsion)) * np.arange(1, _STOPS + 1) / (_STOPS + 1)
    stops = compute_stop_basis(torsion, grid)
    further = [torsion**3, np.ones_like(torsion)]
    if period is not None:
        part = torsion / max(float(np.max(np.abs(torsion))), 1e-300)
        some = stops[:, ::_HARD]
        further += [*(some.T * np.abs(part)), *(some.T * part**2), part**5, part * np.abs(part)]
        further += [filter_smooth(torsion, rate, period) for rate in _RELAXATIONS]
    return np.column_stack([stops, *further])


_HARD, _STRETCHES = 3, 30
"""Every third stop; of time, whose errors are correlated."""
_RELAXATIONS = (10.0, 40.0, 160.0)
"""1/s."""


def measure_offsets(
    library: Library, signals: Sequence[ElasticSignals], beta: FloatArray
) -> tuple[DriveEffect, ...]:
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
        offset = float(solve_scaled(design, torsion, rcond=_RANK)[0])
        if abs(offset - middle) < _MOST_APART * abs(middle):
            half = 0.5 * (high - low)
            found.append(
                DriveEffect(kind="torsion-offset", joint=joint, values=(middle,), deviations=(half,))
            )
    return tuple(found)


_MOST_APART = 0.2
"""Of a torsion's middle, what its load may explain of it."""
