"""Why a log does not fit: single mistakes undone one after the other, and kept where the fit becomes right.

Library, recordings, settings -> `QuickLogs` -> `QuickResult`s -> `LikelyCause`, which may say that no single
mistake explains the result.

Every hypothesis is tried in fact: the samples are changed as if the mistake were undone, and fitted, by a
small model of the logs within the scoring band, in milliseconds. It counts if held-out stretches are
predicted clearly better, or those of one joint and no other is explained worse, or nothing impossible is left
while they are predicted as well; the one that leaves least is named. The fit of all samples must leave less,
too: with few samples fits of stretches are poor, and differ by chance.

    columns    evaluated along the low-passed states themselves (products of states are not low-passed again)
    held out   as for `stretches`: every stretch predicted by the others, joints alike
    impossible joints whose friction drives them, or whose inertia is negative

Friction of joint j drives it where mean(tau_f dq) < 0, its inertia is negative where mean(M_jj ddq^2) < 0,
both by more than five deviations of the jackknife and two percent of what the torque would do.

Supported: several logs, known payloads, joints at rest; signs, order and units of columns, a delay of all
torques, times scaled, a wrong zero of a joint.
Not supported: logs of different sample rates; two mistakes at once; what no torque can show (all torques
scaled, times by a few percent, the zero of a first vertical or a last joint), which needs a known mass,
payload or CAD value.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification.diagnostics.fit_warnings import evaluate_inertia_columns
from symid.identification.diagnostics.stretches import (
    ENDS,
    PART,
    compute_jackknife,
    count_stretches,
    solve_sums,
)
from symid.identification.regression import evaluate_columns, list_resting_joints, prepare_states
from symid.joint_models import REFERENCE_TEMPERATURE
from symid.logs import Recording, low_pass, mask_states
from symid.robot import Processing

_RATE = 4.0
"""Times the scoring band: rate of the samples that are kept."""
_MOST_SAMPLES = 3000
"""Samples of all logs together."""
_ORDER = 4
PARTS = 4
"""Of every held-out stretch, whose squares are compared."""
_SURELY_BAD = 5.0
_CLEAR = 0.02
_SLOW = 0.05
"""Of the top speed: rows below count for nothing where a joint has friction."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuickLogs:
    """Samples of all logs, one after the other.

    Args:
        q, dq, ddq, tau: (T, n); kept: (T, n) whether a joint's row counts.
        stretch: (T,) number of its stretch; run: (T,) of its log.
        period: s, between samples; friction: whether every joint gets viscous and dry friction of its own.
        transmission: (n, n) angles of the motors over those of the joints, None where each moves one joint.
    """

    library: Library
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau: FloatArray
    kept: NDArray[np.bool_]
    stretch: NDArray[np.intp]
    run: NDArray[np.intp]
    period: float
    friction: bool = False
    transmission: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuickResult:
    """A fit: parameters (p,), and those without each stretch (s, p).

    `moving` (k,) are the joints that have rows with a torque; `held_out`, `fitted` (k,) their residuals in
    percent of held-out and of all samples, `losses` (w, k) the squares of the parts of held-out stretches
    relative to the whole torque.
    """

    moving: tuple[int, ...]
    held_out: FloatArray
    fitted: FloatArray
    values: FloatArray
    folds: FloatArray
    losses: FloatArray

    @property
    def percent(self) -> float:
        """Return the mean over joints of what is left unexplained of held-out samples, in percent."""
        return float(np.mean(self.held_out))


def build_quick_logs(
    library: Library, recordings: Sequence[Recording], processing: Processing, scoring: float
) -> QuickLogs:
    """Return the samples of recordings within the `scoring` band in Hz; `processing` has its ends cut."""
    parts = []
    length = sum(entry.time[-1] - entry.time[0] for entry in recordings)
    rate = min(_RATE * scoring, _MOST_SAMPLES / max(length, 1e-9))
    each, count = count_stretches(len(recordings)), 0
    friction = np.array([joint.friction != "none" for joint in library.card.joints])
    for run, given in enumerate(recordings):
        cutoff = min(scoring, 0.4 / given.period)
        settings = replace(processing, filter_cutoff=cutoff, automatic=False)
        recording = replace(given, bad=mask_states(given, settings))
        signals = prepare_states(library, recording, settings)
        tau = low_pass(signals.tau, period=signals.period, cutoff=cutoff, order=_ORDER)
        step = max(1, round(1.0 / (rate * signals.period)))
        ends = round(min(ENDS / signals.period, PART * len(signals.time)))
        places = np.arange(ends, len(signals.time) - ends, step)
        speed = np.abs(signals.dq[places])
        slow = speed < _SLOW * np.quantile(speed, 0.99, axis=0)
        kept = ~(slow & friction)
        resting = np.isin(np.arange(library.card.size), list_resting_joints(recording)) & friction
        kept[:, resting] = False
        if signals.bad is not None:
            kept &= ~signals.bad[places]
        stretch = count + np.arange(len(places)) * each // max(len(places), 1)
        count += each
        table = [part[places] for part in (signals.q, signals.dq, signals.ddq, tau)]
        parts.append((*table, kept, stretch, np.full(len(places), run)))
    names = ("q", "dq", "ddq", "tau", "kept", "stretch", "run")
    columns: dict[str, Any] = dict(zip(names, map(np.concatenate, zip(*parts, strict=True)), strict=True))
    return QuickLogs(
        library=library,
        **columns,
        period=step * recordings[-1].period,
        transmission=recordings[0].transmission,
    )


def fit_quick(logs: QuickLogs) -> QuickResult:
    """Return the fit of all samples, and what fits without each stretch predict of it."""
    table = np.concatenate([_evaluate(logs), logs.tau[:, :, None]], axis=2) * logs.kept[:, :, None]
    count = int(logs.stretch.max()) + 1
    products = []
    for place in range(count):
        for part in np.array_split(np.flatnonzero(logs.stretch == place), PARTS):
            # (n, rows, p + 1)
            block = np.ascontiguousarray(np.swapaxes(table[part], 0, 1))
            products.append(np.swapaxes(block, 1, 2) @ block)
    # (s, parts, n, p + 1, p + 1)
    sums = np.stack(products).reshape(count, PARTS, *products[0].shape)
    stretches = sums.sum(axis=1)
    whole = stretches.sum(axis=0)
    size = np.where(whole[:, -1, -1] > 0.0, whole[:, -1, -1], 1.0)
    weights = 1.0 / size
    for _ in range(2):
        values = solve_sums(whole, weights)
        weights = 1.0 / np.maximum(_compute_left(values, whole), 1e-6 * size)
    values = solve_sums(whole, weights)
    folds = solve_sums(whole - stretches, weights)
    pairs = np.column_stack([folds, -np.ones(count)])[:, None, None]
    left = ((sums @ pairs[..., None])[..., 0] * pairs).sum(axis=-1)
    squares = np.maximum(left, 0.0).reshape(-1, sums.shape[2])
    moving = whole[:, -1, -1] > 0.0
    return QuickResult(
        moving=tuple(np.flatnonzero(moving).tolist()),
        held_out=100.0 * np.sqrt(squares.sum(axis=0) / size)[moving],
        fitted=100.0 * np.sqrt(np.maximum(_compute_left(values, whole), 0.0) / size)[moving],
        values=values,
        folds=folds,
        losses=(squares / size)[:, moving],
    )


def _evaluate(logs: QuickLogs) -> FloatArray:
    """Return the columns (T, n, p), of added friction too."""
    q, dq, ddq = (np.ascontiguousarray(part) for part in (logs.q, logs.dq, logs.ddq))
    columns = evaluate_columns(
        logs.library, q, dq, ddq, np.zeros_like(q), np.full_like(q, REFERENCE_TEMPERATURE)
    )
    if logs.friction:
        each = np.arange(dq.shape[1])
        added = np.zeros((*dq.shape, 2 * dq.shape[1]))
        added[:, each, each], added[:, each, each + len(each)] = dq, np.sign(dq)
        columns = np.concatenate([columns, added], axis=2)
    return columns


def _compute_left(values: FloatArray, sums: FloatArray) -> FloatArray:
    """Return the squares (n,) that parameters (p,) leave of sums (n, p + 1, p + 1)."""
    errors = np.append(values, -1.0)
    return np.asarray(np.einsum("k,jkl,l->j", errors, sums, errors))


_PROPORTIONAL = 1e-6
"""1 - |correlation| of two joints' speeds below which they move in proportion."""


def list_proportions(velocity: FloatArray, moving: Sequence[int]) -> tuple[tuple[int, int], ...]:
    """Return the pairs of `moving` joints whose velocities (T, n) are in proportion."""
    found = []
    turning = [joint for joint in moving if float(np.ptp(velocity[:, joint])) > 0.0]
    for first, second in combinations(turning, 2):
        pair = np.corrcoef(velocity[:, first], velocity[:, second])[0, 1]
        if 1.0 - abs(float(pair)) < _PROPORTIONAL:
            found.append((first, second))
    return tuple(found)


def mask_impossible(logs: QuickLogs, fit: QuickResult) -> NDArray[np.bool_]:
    """Return the joints (n,) that a fit of `logs` has driven by friction, or with a negative inertia."""
    columns, inertial = _evaluate(logs), len(logs.library.card.beta)
    found = np.zeros(columns.shape[1], dtype=np.bool_)
    inertias = evaluate_inertia_columns(logs.library, np.ascontiguousarray(logs.q))
    for joint, inertia in enumerate(inertias):
        kept = logs.kept[:, joint]
        if not kept.any():
            continue
        torque = float(np.sqrt(np.mean(logs.tau[kept, joint] ** 2))) or 1.0
        dq, ddq = logs.dq[kept, joint], logs.ddq[kept, joint]
        quantities = (
            (inertia[kept, joint, :inertial], ddq**2, ddq, slice(0, inertial)),
            (columns[kept, joint, inertial:], dq, dq, slice(inertial, None)),
        )
        for table, factor, motion, part in quantities:
            row = (table * factor[:, None]).mean(axis=0)
            scale = float(np.sqrt(np.mean(motion**2))) * torque or 1.0
            share = float(row @ fit.values[part]) / scale
            spread = np.sqrt(compute_jackknife((fit.folds[:, part] @ row)[:, None]))[0] / scale
            found[joint] |= share < -max(_CLEAR, _SURELY_BAD * float(spread))
    return found


_CLEARLY, _MOST = 0.7, 40.0
"""Times the held-out residual before, and percent: a mistake undone leaves less."""
_SURE = 4.0
"""Standard errors, over the stretches, by which it must leave less."""
_SAME = 1.1
"""Times the held-out residual before: what leaves no more predicts as well."""
_TURNED = frozenset(("log.torque-sign", "log.position-sign"))
"""Mistakes that make friction and inertia negative and may leave as much; others cure these by chance."""
_FITTED = 0.9
"""Times the residual of the fit, the mean of joints, that it leaves at most."""
_JOINT, _SURELY = 0.75, 3.5
"""Times the residuals of one joint, and standard errors, where it helps one."""
_WORSE, _MUCH_WORSE = 1.15, 1.3
"""Times the residual of the fit of any other joint, and the mean of what is held out, that it leaves then;
the second where the mean of the joints is explained better."""
_FLOOR = 0.02
"""Of a joint's mean loss: parts with less say nothing."""
_FEWEST = 8
_TURN = 0.5 * np.pi
_DELAYS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
_DELAYED = 0.1
"""Of the logs: delays beyond it leave too little of the torques."""
_TIMES = (3.0, 1.0 / 3.0, 2.0, 0.5, 1e3, 1e-3, 1.5, 1.0 / 1.5, 1.2, 1.0 / 1.2)
_TORQUES = (1e-3, 1e3, 1e-2, 1e2)
_ZEROS = (-0.3, 0.3, -0.8, 0.8, -_TURN, _TURN, 2.0 * _TURN)
_UNRELATED = 85.0
"""Percent left unexplained from which on torques have nothing to do with the motion."""


@dataclass(frozen=True, slots=True)
class LikelyCause:
    """The likeliest single cause: a code, a sentence, what to do, and percent that is left without it.

    `joint` names the one joint that undoing it helps, empty where it helps the mean of all; `leaves` are the
    percents left, of that joint or of the mean, with the mistake and without it.
    """

    code: str
    cause: str
    remedy: str
    percent: float
    joint: str = ""
    leaves: tuple[float, float] = (float("inf"), float("inf"))

    @property
    def effect(self) -> str:
        """Return in words what undoing it does to a quick fit."""
        before, after = self.leaves
        if after >= before:
            return "a quick fit has no negative inertia or friction"
        what = f"the held-out torque of {self.joint}" if self.joint else "held-out torque"
        return f"a quick fit leaves {after:.3g} % of {what}, not {before:.3g} %"


class Hypothesis(NamedTuple):
    """A mistake (code and sentence), its remedy, and the samples as they would be without it."""

    code: str
    cause: str
    remedy: str
    logs: QuickLogs


def find_cause(
    logs: QuickLogs,
    before: QuickResult,
    most: float = _MOST,
    *,
    cures: bool = True,
    held_out: FloatArray | None = None,
) -> LikelyCause:
    """Return the likeliest single cause of a wrong fit; its `percent` is infinite where none helps.

    A mistake undone must leave `most` percent or less, and 40; or clearly less of one joint, also than a fit
    leaves `held_out` (n,) in percent, where there is one; or, if `cures`, nothing impossible.
    """
    names = [joint.name for joint in logs.library.card.joints]
    wrong = mask_impossible(logs, before)
    best: tuple[int, float, LikelyCause] | None = None
    for trial in list_hypotheses(logs):
        try:
            found = fit_quick(trial.logs)
        except np.linalg.LinAlgError:
            continue
        percent, helped = found.percent, None
        better = (
            percent <= min(_CLEARLY * before.percent, most, _MOST)
            and _compare(before.losses.mean(axis=1), found.losses.mean(axis=1)) > _SURE
            and float(np.mean(found.fitted)) <= _FITTED * float(np.mean(before.fitted))
        )
        if not better and held_out is not None:
            helped = _find_helped_joint(before, found, held_out)
            better = helped is not None
        may_cure = cures and wrong.any() and trial.code in _TURNED and percent <= _SAME * before.percent
        if not (better or may_cure):
            continue
        rest = int(mask_impossible(trial.logs, found).sum())
        sound = (better and rest <= int(wrong.sum())) or (may_cure and not rest)
        if sound and (best is None or (rest, percent) < best[:2]):
            joint, leaves = "", (before.percent, percent)
            if helped is not None:
                joint = names[before.moving[helped]]
                leaves = float(before.held_out[helped]), float(found.held_out[helped])
            cause = LikelyCause(trial.code, trial.cause, trial.remedy, percent, joint, leaves)
            best = rest, percent, cause
    if best is not None:
        return best[2]
    # What to say where no single mistake helps.
    odd = [name for name, bad in zip(names, wrong, strict=True) if bad]
    code = "log.other-robot"
    said = "the model explains only part of the torque, and no single mistake in the log explains why"
    remedy = "check dimensions and gravity of the robot file, and that the log is of this robot"
    if before.percent >= _UNRELATED:
        code, said = "log.unrelated-torque", "the torques have nothing to do with this motion"
        remedy = "check that torque and position columns are of the same run and of this robot"
    elif odd:
        code = "log.impossible"
        said = f"inertia or friction of {', '.join(odd)} comes out negative, which no robot has"
        remedy = "check sign, unit and zero of position and torque of these joints, and the robot file"
    return LikelyCause(code, said, remedy, float("inf"))


def _find_helped_joint(before: QuickResult, after: QuickResult, held_out: FloatArray) -> int | None:
    """Return the joint of which much less is left, while no other is explained worse; None for none."""
    if before.moving != after.moving or after.percent > _WORSE * before.percent:
        return None
    ratios = after.fitted / np.maximum(before.fitted, np.finfo(float).tiny)
    joint = int(np.argmin(ratios))
    less = after.held_out[joint] <= _JOINT * min(before.held_out[joint], held_out[joint])
    most = _MUCH_WORSE if ratios.mean() <= _FITTED else _WORSE
    if not less or ratios[joint] > _JOINT or ratios.max() > most:
        return None
    return joint if _compare(before.losses[:, joint], after.losses[:, joint]) > _SURELY else None


def _compare(before: FloatArray, after: FloatArray) -> float:
    """Return the mean log of the ratio of losses (w,) in standard errors; tiny ones do not count."""
    floor = _FLOOR * float(before.mean())
    told = (before > floor) | (after > floor)
    if told.sum() < _FEWEST:
        return 0.0
    ratios = np.log((before[told] + floor) / (after[told] + floor))
    mean, error = float(ratios.mean()), float(np.std(ratios, ddof=1)) / np.sqrt(len(ratios))
    return mean / error if error else np.inf * np.sign(mean) if mean else 0.0


def list_hypotheses(logs: QuickLogs) -> Iterator[Hypothesis]:
    """Yield what the logs would be without each single mistake."""
    names = [joint.name for joint in logs.library.card.joints]
    count = len(names)
    units = np.eye(count)

    def scale_torque(factors: FloatArray | float) -> QuickLogs:
        return replace(logs, tau=logs.tau * factors)

    def scale_position(factors: FloatArray | float) -> QuickLogs:
        return replace(logs, q=logs.q * factors, dq=logs.dq * factors, ddq=logs.ddq * factors)

    if not logs.library.card.friction:
        yield Hypothesis(
            "robot.no-friction",
            "the robot file states no friction, and the joints have some",
            "give each joint a friction model ([joint.friction], or --friction coulomb-viscous-offset)",
            replace(logs, friction=True),
        )
    code, remedy = "log.torque-sign", "state a factor of -1 in [log.torque]"
    yield Hypothesis(code, "all torques have the wrong sign", remedy, scale_torque(-1.0))
    for unit, name in zip(units, names, strict=True):
        said = f"the torque of joint {name!r} has the wrong sign"
        remedy = "state its factor -1 in [log.torque], or turn its gear"
        yield Hypothesis(code, said, remedy, scale_torque(1.0 - 2.0 * unit))
        said, remedy = (
            f"the position of joint {name!r} has the wrong sign",
            "state its factor -1 in [log.position]",
        )
        yield Hypothesis("log.position-sign", said, remedy, scale_position(1.0 - 2.0 * unit))
    matrix = np.zeros((0, count)) if logs.transmission is None else logs.transmission
    for motor in range(len(matrix)):
        turn = np.linalg.solve(matrix, (1.0 - 2.0 * units[motor])[:, None] * matrix)
        # Where that turns no joint's torque alone.
        if not np.allclose(turn, np.diag(np.diag(turn))):
            moved = " and ".join(repr(names[joint]) for joint in np.flatnonzero(matrix[motor]))
            said = f"the torque of motor {motor + 1}, which moves {moved}, has the wrong sign"
            remedy = "state its factor -1 in [log.torque]"
            yield Hypothesis(code, said, remedy, replace(logs, tau=logs.tau @ turn))
    for first, second in combinations(range(count), 2):
        order = list(range(count))
        order[first], order[second] = second, first
        pair = f"{names[first]!r} and {names[second]!r}"
        tau = logs.tau[:, order]
        columns = {name: getattr(logs, name)[:, order] for name in ("q", "dq", "ddq", "kept")}
        swapped = (
            (f"the torques of {pair}", "[log.torque]", replace(logs, tau=tau)),
            (f"the positions of {pair}", "[log.position]", replace(logs, **columns)),
            (f"the joints {pair}", "[log]", replace(logs, **columns, tau=tau)),
        )
        for what, where, other in swapped:
            remedy = f"correct the order of columns in {where}"
            yield Hypothesis("log.swapped-joints", f"{what} are exchanged", remedy, other)
    code = "log.wrong-unit"
    for factor, what in ((np.pi / 180.0, "degrees"), (180.0 / np.pi, "radians")):
        remedy = f'state unit = "{what[:3]}" in [log.position]'
        yield Hypothesis(code, f"positions are in {what}", remedy, scale_position(factor))
        for unit, name in zip(units, names, strict=True):
            said, remedy = f"positions of joint {name!r} are in {what}", "state its factor in [log.position]"
            yield Hypothesis(code, said, remedy, scale_position(np.where(unit, factor, 1.0)))
    # A joint whose torque is made tiny is cut off from the others, which may help any wrong model.
    size = np.log(np.maximum(np.sqrt(np.mean(logs.tau**2, axis=0)), np.finfo(float).tiny))
    for factor, joint in product(_TORQUES, range(count)):
        away = size[joint] - float(np.mean(np.delete(size, joint))) if len(size) > 1 else 0.0
        if abs(away + np.log(factor)) < abs(away):
            said = f"the torque of joint {names[joint]!r} is about {1.0 / factor:g} times what it should be"
            remedy = "state its unit, factor or gear in [log.torque]"
            yield Hypothesis(code, said, remedy, scale_torque(np.where(units[joint], factor, 1.0)))
    for factor in _TIMES:
        said = f"the times of the log are about {1.0 / factor:.4g} times what they should be"
        remedy = f"multiply them by {factor:.4g} (unit of [log.time])"
        faster = replace(logs, dq=logs.dq / factor, ddq=logs.ddq / factor**2)
        yield Hypothesis("log.time-scale", said, remedy, faster)
    for delay in (entry for entry in _DELAYS if entry <= _DELAYED * logs.period * len(logs.tau)):
        for sign, side in ((1.0, "after"), (-1.0, "before")):
            said = f"torques are logged about {1e3 * delay:g} ms {side} the motion"
            remedy = "shift them in the log; `symid check` states the delay"
            # Rows without a torque so much later do not count.
            tau, kept = logs.tau.copy(), logs.kept.copy()
            for run in np.unique(logs.run):
                own = np.flatnonzero(logs.run == run)
                time = np.arange(len(own)) * logs.period
                later = time + sign * delay
                kept[own] &= ((later >= 0.0) & (later <= time[-1]))[:, None]
                for joint in range(count):
                    tau[own, joint] = np.interp(later, time, logs.tau[own, joint])
            yield Hypothesis("log.torque-delay", said, remedy, replace(logs, tau=tau, kept=kept))
    remedy = "state it as offset of [log.position], or correct theta of the robot file"
    for joint, zero in product(range(count), _ZEROS):
        said = f"the zero of joint {names[joint]!r} is off by about {zero:.2g} rad"
        yield Hypothesis("log.joint-zero", said, remedy, replace(logs, q=logs.q - zero * units[joint]))
