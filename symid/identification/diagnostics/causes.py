"""Why a log does not fit: single mistakes undone one after the other, and terms that a model may lack.

Library, thinned logs -> hypotheses -> `Cause`s: the one that explains the log, or several that do so alike.

Every hypothesis is tried in fact, by a fit of the logs within the scoring band: as if the mistake were
undone, or with the columns of the term at one joint. It is accepted where

    held-out losses of its joint, or of all, fall by more than chance over all sizes tried (Holm 1979),
    their squares fall at least 2 times, those of all joints together at least 1.5 times

Of those accepted the one that leaves least is named alone if every hypothesis of another family leaves at
least 2 times as much of these joints; else all that leave less are named together, and no remedy is given.
None is named if a low-pass of torques, up to the second order, is among these, which is no mistake of a log;
if with that one a joint is surely worse; or if over 30 % is left of all torque or of its joints.
Where a fit that is usable has values that no robot has, a wrong sign that cures them is accepted, too.

Torque columns that change linearly (signs, order, units) are algebra on sums of products; zeros, signs and
order of positions, units, times and delays evaluate the regressor anew, along thinned logs.

Supported: several logs, known payloads, joints at rest; signs, order and units of columns, a delay of all
torques, times or one torque scaled, a wrong zero of a joint, no friction in the robot file; terms of one
joint; logs of different robots.
Not supported: two mistakes at once; what no torque can show (all torques scaled, times by a few percent, the
zero of a first vertical or a last joint), which needs a known mass, payload or CAD value.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification import judge, regression
from symid.identification.diagnostics.fit_warnings import evaluate_inertia_columns
from symid.identification.diagnostics.gravity import GravityEstimate, find_gravity
from symid.identification.diagnostics.residual_structure import FAMILIES, OTHER_VALUES, pick_motion
from symid.identification.estimators import Cause
from symid.identification.judge import POLICY
from symid.identification.regression import BlockFit, ThinMotion
from symid.joint_models import REFERENCE_TEMPERATURE
from symid.robot import Robot

_DECADES = 3
"""Powers of ten by which a unit is mistaken at most, either way."""
_STEPS = 8
"""Zeros in a turn, times in two decades, sizes of a torque that are searched; octaves of delays."""
NO_FRICTION, GRAVITY, TERM = "robot.no-friction", "robot.gravity", "identify.structure"
LOGS, DELAY = "identify.logs", "log.torque-delay"
FREE = (TERM, LOGS)  # codes of what has values of its own
TORQUE_SIGN, POSITION_SIGN = "log.torque-sign", "log.position-sign"


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A mistake undone, or a term added.

    `code`, `cause` and `remedy` as in `Cause`; none is named where one without a cause explains as much.
    `family` of hypotheses that are one mistake in several sizes, `tried` of them; `joints` are those whose
    torque it touches, none for all. `motion` the logs as they would be; `columns` (t, n, p) of the model
    along them, None to evaluate them; `sizes` (n,) squares of torque that losses are relative to, None for
    those of `motion`.
    """

    code: str
    family: str
    cause: str
    remedy: str
    motion: ThinMotion
    joints: tuple[int, ...] = ()
    columns: FloatArray | None = None
    sizes: FloatArray | None = None
    tried: int = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TriedFit:
    """A fit: losses (b, n) of held-out blocks, squares (n,) of all, over the torque's; 1 a joint at most."""

    fit: BlockFit
    losses: FloatArray
    squares: FloatArray


def fit_motion(
    columns: FloatArray, motion: ThinMotion, fold: NDArray[np.intp], sizes: FloatArray | None = None
) -> TriedFit:
    """Return the fit of `columns` (t, n, p); `fold` (b,) is each block's, `sizes` are as in `Hypothesis`."""
    sums = regression.sum_motion(columns, motion, len(fold))
    fit = regression.fit_sums(sums, [0] * columns.shape[1], fold)
    own = np.array([table[:, 0, -1, -1].sum() for table in sums.squares])
    safe = np.where(own > 0.0, own if sizes is None else sizes, np.inf)
    whole = np.broadcast_to(fit.values, (len(fold), len(fit.values)))
    losses = regression.measure_left(sums, fit.folds[fold])[:, :, 0].T / safe
    squares = regression.measure_left(sums, whole)[:, :, 0].sum(axis=1) / safe
    # What predicts worse than nothing explains nothing.
    most = np.maximum(losses.sum(axis=0), 1.0)
    return TriedFit(fit=fit, losses=losses / most, squares=np.minimum(squares, 1.0))


def evaluate_motion(library: Library, motion: ThinMotion) -> FloatArray:
    """Return the columns (t, n, p) of the model along a motion."""
    q, dq, ddq = map(np.ascontiguousarray, (motion.q, motion.dq, motion.ddq))
    load, warmth = np.zeros_like(q), np.full_like(q, REFERENCE_TEMPERATURE)
    return regression.evaluate_columns(library, q, dq, ddq, load, warmth)


class FollowedLogs(NamedTuple):
    """Thinned logs, the fold (b,) of each block, and the columns (t, n, p) of a model along them."""

    library: Library
    motion: ThinMotion
    fold: NDArray[np.intp]
    columns: FloatArray

    @classmethod
    def follow(cls, library: Library, motion: ThinMotion, fold: NDArray[np.intp]) -> "FollowedLogs":
        """Return thinned logs with the columns of their model."""
        return cls(library, motion, fold, evaluate_motion(library, motion))

    def evaluate(self, other: ThinMotion) -> FloatArray:
        """Return the columns along another motion, which are known where it moves the same."""
        alike = other.q is self.motion.q and other.dq is self.motion.dq
        return self.columns if alike else evaluate_motion(self.library, other)

    def fit(self, entry: Hypothesis) -> TriedFit:
        """Return the fit of the logs as a hypothesis has them."""
        columns = self.evaluate(entry.motion) if entry.columns is None else entry.columns
        return fit_motion(columns, entry.motion, self.fold, entry.sizes)


class TriedHypothesis(NamedTuple):
    """A hypothesis beside a fit of its rows without it: chance and falls of squares of its joints, of all."""

    hypothesis: Hypothesis
    before: TriedFit
    found: TriedFit
    p: float
    fall: float
    fall_of_all: float


def find_causes(
    logs: FollowedLogs, hypotheses: Iterable[Hypothesis], *, impossible: bool = False
) -> tuple[Cause, ...]:
    """Return the causes that explain logs, none where no hypothesis does; several explain it alike.

    `impossible` whether a fit of the logs has values that no robot has.
    """
    names, base = logs.library.card.joints, fit_motion(logs.columns, logs.motion, logs.fold)
    moving = np.flatnonzero(base.squares > 0.0).tolist()
    trials = []
    for hypothesis in hypotheses:
        found, bare = logs.fit(hypothesis), base
        own = [joint for joint in (hypothesis.joints or moving) if joint in moving]
        if not own:
            continue
        if hypothesis.code == DELAY:
            # Rows at one end that are left out are no part of what it explains.
            bare = fit_motion(logs.columns, replace(logs.motion, kept=hypothesis.motion.kept), logs.fold)
        pooled = _compare(bare, found, moving)
        # What a mistake at one joint spoils may be left at others: both are tried, which counts twice.
        touched = min(pooled, _compare(bare, found, own)) if hypothesis.joints else pooled
        p = min(1.0, touched[0] * hypothesis.tried * (2.0 if hypothesis.joints else 1.0))
        trials.append(TriedHypothesis(hypothesis, bare, found, p, touched[1], pooled[1]))
    chances = judge.adjust_chances([trial.p for trial in trials])
    trials = [trial._replace(p=p) for trial, p in zip(trials, chances, strict=True)]
    passed = [
        place
        for place, trial in enumerate(trials)
        if trial.p < POLICY.alarm and trial.fall >= POLICY.fall and trial.fall_of_all >= POLICY.fall_of_all
    ]
    if not passed and not impossible:
        return ()
    bad = mask_impossible(logs, logs.motion, base.fit)

    def mask_left(place: int) -> NDArray[np.bool_]:
        """Return the joints that are impossible with a hypothesis."""
        return mask_impossible(logs, trials[place].hypothesis.motion, trials[place].found.fit)

    def is_sound(place: int) -> bool:
        """Return whether no joint of a hypothesis is impossible with it, and no other one that was not."""
        return not np.any(mask_left(place) & (mask_joints(trials[place].hypothesis) | ~bad))

    def mask_joints(hypothesis: Hypothesis) -> NDArray[np.bool_]:
        return np.isin(np.arange(len(names)), hypothesis.joints or moving)

    cured = [
        place
        for place, trial in enumerate(trials)
        # By algebra a sign of torques leaves as much, before and after; of others a cure is chance.
        if place not in passed
        and trial.hypothesis.code in {TORQUE_SIGN, POSITION_SIGN}
        and np.any(bad & mask_joints(trial.hypothesis))
        and holds(trial, moving)
        and holds(trial._replace(found=trial.before), moving)
        and is_sound(place)
    ]
    passed = [*(place for place in passed if is_sound(place)), *cured] or passed
    if not passed:
        return ()

    def left(place: int, joints: Sequence[int]) -> float:
        return float(trials[place].found.losses[:, list(joints)].sum())

    best = min(passed, key=lambda place: left(place, moving))
    # What has values of its own explains less than a mistake that leaves as much.
    mistakes = [place for place in passed if trials[place].hypothesis.code not in FREE]
    if mistakes:
        plain = min(mistakes, key=lambda place: left(place, moving))
        if left(plain, moving) < POLICY.fall * left(best, moving):
            best = plain
    if not holds(trials[best], moving):
        return ()
    first = trials[best].hypothesis
    alike: dict[str, int] = {first.family: best}
    for place, trial in enumerate(trials):
        other = trial.hypothesis
        own = sorted({*(first.joints or moving), *(other.joints or moving)} & {*moving})
        # Few stretches may not tell a rival from chance, which does not exclude it.
        told = trial.p < POLICY.alarm or place in passed or trial.fall_of_all >= POLICY.fall_of_all
        rival = told and left(place, own) < POLICY.fall * left(best, own)
        if other.family == first.family or not rival or (other.code in FREE and first.code not in FREE):
            continue
        better = other.family not in alike or left(place, own) < left(alike[other.family], own)
        if better and mask_left(place)[own].sum() <= mask_left(best)[own].sum():
            alike[other.family] = place
    if not all(trials[place].hypothesis.cause for place in alike.values()):
        return ()
    causes = []
    for place in sorted(alike.values(), key=lambda place: left(place, moving)):
        entry = trials[place].hypothesis
        own = list(entry.joints or moving)
        before, after = (measure_percent(part.losses, own) for part in trials[place][1:3])
        said = {name: getattr(entry, name) for name in ("code", "family", "cause", "remedy")}
        joints = tuple(names[joint].name for joint in entry.joints)
        causes.append(Cause(**said, joints=joints, before=before, after=after, p=trials[place].p))
    return tuple(causes)


def holds(trial: TriedHypothesis, joints: list[int]) -> bool:
    """Return whether a hypothesis surely predicts no joint worse, and all joints and its own are usable."""
    after, before = trial.found.losses, trial.before.losses
    sure = np.array(judge.adjust_chances(judge.compare(after, before).p.tolist())) < POLICY.alarm
    more = np.sqrt(after.sum(axis=0)) - np.sqrt(before.sum(axis=0))
    spoilt = sure & (more > POLICY.relevance)
    own = [joint for joint in trial.hypothesis.joints or joints if joint in joints]
    return not spoilt.any() and max(measure_percent(after, part) for part in (joints, own)) <= POLICY.usable


def measure_percent(losses: FloatArray, joints: list[int]) -> float:
    """Return what losses (b, n) leave of the torque, in percent, 100 at most, on the mean of joints."""
    return 100.0 * float(np.mean(np.sqrt(np.minimum(losses[:, joints].sum(axis=0), 1.0))))


def _compare(base: TriedFit, found: TriedFit, joints: list[int]) -> tuple[float, float]:
    """Return the chance and the fall of the losses of joints; the fit to all rows must fall, too."""
    compared = judge.compare(base.losses[:, joints], found.losses[:, joints])
    left = float(found.squares[joints].sum())
    fall = float(base.squares[joints].sum()) / left if left > 0.0 else np.inf
    return compared.p_of_all, min(compared.fall_of_all, fall)


class JointShares(NamedTuple):
    """Shares (n, 2) of inertia and friction in each joint's torque, what blocks change (b, n, 2) of them.

    `inertia` (n,) is the mean of M_jj, in kg m^2 or kg.
    """

    values: FloatArray
    changes: FloatArray
    inertia: FloatArray


def measure_shares(library: Library, motion: ThinMotion, columns: FloatArray, fit: BlockFit) -> JointShares:
    """Return what inertia and friction of a fit do in `columns` (t, n, p) of a motion, see `log_check`."""
    inertial, count, width = len(library.card.beta), columns.shape[1], columns.shape[2]
    # A fit may have terms behind the columns of the model.
    values, changes = fit.values[:width], fit.changes[:, :width]
    rows, inertia = np.zeros((count, 2, width)), np.zeros(count)
    for joint, table in enumerate(evaluate_inertia_columns(library, np.ascontiguousarray(motion.q))):
        kept = motion.kept[:, joint]
        if not kept.any():
            continue
        own, dq, ddq = table[kept, joint, :inertial], motion.dq[kept, joint], motion.ddq[kept, joint]
        torque, rate, speed = (
            float(np.sqrt(np.mean(part**2))) or 1.0 for part in (motion.tau[kept, joint], ddq, dq)
        )
        rows[joint, 0, :inertial] = (ddq**2) @ own / (len(own) * rate * torque)
        rows[joint, 1, inertial:] = dq @ columns[kept, joint, inertial:] / (len(own) * speed * torque)
        inertia[joint] = own.mean(axis=0) @ values[:inertial]
    return JointShares(rows @ values, np.tensordot(changes, rows, axes=(1, 2)), inertia)


def mask_impossible(logs: FollowedLogs, motion: ThinMotion, fit: BlockFit) -> NDArray[np.bool_]:
    """Return the joints (n,) that a fit has surely driven by friction, or with a negative inertia."""
    shares = measure_shares(logs.library, motion, logs.evaluate(motion), fit)
    changes = shares.changes.reshape(len(shares.changes), -1).T
    found = [
        judge.agree_in_value(*pair, 1.0) for pair in zip(shares.values.ravel().tolist(), changes, strict=True)
    ]
    chances = judge.adjust_chances([one.p for one in found])
    told = [replace(one, p=p).verdict for one, p in zip(found, chances, strict=True)]
    sure = np.reshape([verdict is judge.Agreement.DIFFERENT for verdict in told], (-1, 2))
    return np.asarray(np.any(sure & (shares.values < 0.0), axis=1))


def list_terms(logs: FollowedLogs, values: FloatArray) -> Iterator[Hypothesis]:
    """Yield the terms that a model may lack at each joint; `values` (p,) are those of its fit."""
    motion, columns, predicted = logs.motion, logs.columns, logs.columns @ values
    time = np.asarray(np.arange(len(motion.q)) * motion.period, dtype=np.float64)
    # Of each log apart: slopes must not cross from one to the next.
    parts = [np.flatnonzero(motion.run == run) for run in np.unique(motion.run)]
    for joint, entry in enumerate(logs.library.card.joints):
        motions = []
        for own in parts:
            states = time[own], motion.q[own], motion.dq[own], motion.ddq[own]
            motions.append(pick_motion(states, joint, predicted[own, joint], motion.period))
        for name, family in FAMILIES.items():
            # No model lacks the size of a torque, or a delay: these are mistakes.
            if name in {OTHER_VALUES, "scale", "delay"}:
                continue
            built = [family.build(part) for part in motions]
            if not built[0]:
                continue
            added = np.vstack([np.column_stack(part) for part in built])
            sizes = np.sqrt(np.mean(added**2, axis=0))
            added = added[:, sizes > 0.0] / sizes[sizes > 0.0]
            whole = np.zeros((*columns.shape[:2], added.shape[1]))
            whole[:, joint] = added
            cause = f"joint {entry.name!r} lacks a term of {name}"
            wider = np.concatenate([columns, whole], axis=2)
            yield Hypothesis(TERM, f"{name} of {entry.name}", cause, family.advice, motion, (joint,), wider)


def _scale(motion: ThinMotion, names: Sequence[str], factors: FloatArray | float) -> ThinMotion:
    return replace(motion, **{name: getattr(motion, name) * factors for name in names})


_TORQUE, _POSITION = ("tau",), ("q", "dq", "ddq")
"""What changes with the factors of torques and positions."""


def list_mistakes(logs: FollowedLogs, transmission: FloatArray | None = None) -> Iterator[Hypothesis]:
    """Yield what the logs would be without each single mistake.

    `transmission` (n, n) are angles of the motors over those of the joints, None where each moves one.
    """
    names, motion = [joint.name for joint in logs.library.card.joints], logs.motion
    count, units = len(names), np.eye(len(names))
    if not logs.library.card.friction:
        each, dq = np.arange(count), motion.dq
        added = np.zeros((*dq.shape, 2 * count))
        added[:, each, each], added[:, each, each + count] = dq, np.sign(dq)
        cause = "the robot file states no friction, and the joints have some"
        remedy = "state friction of each joint (--friction coulomb-viscous-offset, or [joint.friction])"
        wider = np.concatenate([logs.columns, added], axis=2)
        yield Hypothesis(NO_FRICTION, "friction", cause, remedy, motion, (), wider)
    for code, what, parts in (TORQUE_SIGN, "torque", _TORQUE), (POSITION_SIGN, "position", _POSITION):
        cause, remedy = f"all {what}s have the wrong sign", f"state a factor of -1 in [log.{what}]"
        yield Hypothesis(code, f"sign of all {what}s", cause, remedy, _scale(motion, parts, -1.0))
        for joint, (unit, name) in enumerate(zip(units, names, strict=True)):
            cause = f"the {what} of joint {name!r} has the wrong sign"
            remedy = f"state its factor -1 in [log.{what}]"
            family, undone = f"sign of {what} {name}", _scale(motion, parts, 1.0 - 2.0 * unit)
            yield Hypothesis(code, family, cause, remedy, undone, (joint,))
    matrix = np.zeros((0, count)) if transmission is None else transmission
    for motor in range(len(matrix)):
        turn = np.linalg.solve(matrix, (1.0 - 2.0 * units[motor])[:, None] * matrix)
        # Where that turns no joint's torque alone.
        if not np.allclose(turn, np.diag(np.diag(turn))):
            driven = np.flatnonzero(matrix[motor]).tolist()
            moved = " and ".join(repr(names[joint]) for joint in driven)
            cause = f"the torque of motor {motor + 1}, which moves {moved}, has the wrong sign"
            remedy = "state its factor -1 in [log.torque]"
            family, undone = f"sign of motor {motor + 1}", replace(motion, tau=motion.tau @ turn)
            yield Hypothesis(TORQUE_SIGN, family, cause, remedy, undone, tuple(driven))
    for first, second in combinations(range(count), 2):
        order = list(range(count))
        order[first], order[second] = second, first
        pair = f"{names[first]!r} and {names[second]!r}"
        swapped = (
            ("torques of", "[log.torque]", _TORQUE),
            ("positions of", "[log.position]", (*_POSITION, "kept")),
            ("joints", "[log]", (*_POSITION, "kept", *_TORQUE)),
        )
        for what, where, channels in swapped:
            cause = f"the {what} {pair} are exchanged"
            remedy = f"correct the order of columns in {where}"
            other = replace(motion, **{name: getattr(motion, name)[:, order] for name in channels})
            yield Hypothesis("log.swapped-joints", f"{what} {pair}", cause, remedy, other, (first, second))
    yield from _list_sizes(logs, names)


def _list_sizes(logs: FollowedLogs, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield what the logs would be with other units, times, delays and zeros."""
    count, units, motion, search = len(names), np.eye(len(names)), logs.motion, partial(_search, logs)
    for factor, what in ((np.pi / 180.0, "degrees"), (180.0 / np.pi, "radians")):
        cause, remedy = f"positions are in {what}", f'state unit = "{what[:3]}" in [log.position]'
        family, undone = "unit of positions", _scale(motion, _POSITION, factor)
        yield Hypothesis("log.wrong-unit", family, cause, remedy, undone)
        for joint, (unit, name) in enumerate(zip(units, names, strict=True)):
            cause, remedy = f"positions of joint {name!r} are in {what}", "state its factor in [log.position]"
            family = f"unit of position {name}"
            undone = _scale(motion, _POSITION, np.where(unit, factor, 1.0))
            yield Hypothesis("log.wrong-unit", family, cause, remedy, undone, (joint,))
    powers = np.delete(np.linspace(-_DECADES, _DECADES, 2 * _STEPS + 1), _STEPS)
    for joint, unit in enumerate(units) if count > 1 else ():

        def scale_torque(power: float, unit: FloatArray = unit) -> ThinMotion:
            return _scale(motion, _TORQUE, np.where(unit, 10.0**power, 1.0))

        power = search(scale_torque, powers)
        size = np.format_float_positional(10.0**-power, 2, fractional=False, trim="-")
        cause = f"the torque of joint {names[joint]!r} is about {size} times what it should be"
        remedy = "state its unit, factor or gear in [log.torque]"
        family, undone = f"unit of torque {names[joint]}", scale_torque(power)
        yield Hypothesis("log.wrong-unit", family, cause, remedy, undone, (joint,), tried=len(powers))

    def scale_times(power: float) -> ThinMotion:
        factor = 10.0**power
        return replace(motion, dq=motion.dq / factor, ddq=motion.ddq / factor**2)

    # Within a decade, but for none.
    times = search(scale_times, np.delete(np.linspace(-1.0, 1.0, _STEPS + 1), _STEPS // 2))
    for power in (times, float(_DECADES), -float(_DECADES)):
        cause = f"the times of the log are about {10.0**-power:.3g} times what they should be"
        remedy = f"multiply them by {10.0**power:.3g} (unit of [log.time])"
        yield Hypothesis("log.time-scale", "times", cause, remedy, scale_times(power), tried=_STEPS)
    span = float(min(np.bincount(motion.run))) * motion.period
    delays = motion.period * 2.0 ** np.arange(-3.0, _STEPS)
    delays = delays[10.0 * delays <= span]
    for sign, side in ((1.0, "after"), (-1.0, "before")) if len(delays) else ():
        # All sizes are compared on the rows that the largest one leaves.
        inner = shift_torques(motion, sign * float(delays[-1])).kept

        def shift(size: float, sign: float = sign, inner: NDArray[np.bool_] = inner) -> ThinMotion:
            moved = shift_torques(motion, sign * size)
            return replace(moved, kept=moved.kept & inner)

        delay = search(shift, delays)
        cause = f"torques are logged about {1e3 * delay:.3g} ms {side} the motion"
        remedy = "shift them in the log; `symid check` states the delay"
        undone = shift_torques(motion, sign * delay)
        yield Hypothesis(DELAY, "delay", cause, remedy, undone, tried=len(delays))
    slopes = np.zeros((*motion.tau.shape, 2))
    for run in np.unique(motion.run) if len(delays) else ():
        own = np.flatnonzero(motion.run == run)
        time = np.arange(len(own)) * motion.period
        spline = CubicSpline(time, motion.tau[own])
        slopes[own] = np.stack([spline(time, 1), spline(time, 2)], axis=2)
    filtered = np.concatenate([logs.columns, slopes], axis=2)
    # A filter lags: tau + a dtau/dt + b d2tau/dt2, its input, has a > 0.
    if fit_motion(filtered, motion, logs.fold).fit.values[-2] < 0.0:
        yield Hypothesis(DELAY, "low-pass", "", "", motion, columns=filtered)
    # A whole turn changes nothing.
    zeros = np.linspace(-np.pi, np.pi, _STEPS + 1)[1:]
    for joint, unit in enumerate(units):

        def turn(zero: float, unit: FloatArray = unit) -> ThinMotion:
            return replace(motion, q=motion.q - zero * unit)

        zero = search(turn, zeros[zeros != 0.0], joint)
        cause = f"the zero of joint {names[joint]!r} is off by about {zero:.2g} rad"
        offsets = ", ".join(f"{-zero:.3g}" if place == joint else "0" for place in range(count))
        remedy = f"add offset = [{offsets}] to [log.position], or {-zero:.3g} to its theta in the robot "
        remedy += f'file; zeros = ["{names[joint]}"] there finds it with its standard deviation'
        family = f"zero of {names[joint]}"
        yield Hypothesis("log.joint-zero", family, cause, remedy, turn(zero), (joint,), tried=_STEPS)


def _search(
    logs: FollowedLogs, build: Callable[[float], ThinMotion], grid: FloatArray, joint: int | None = None
) -> float:
    """Return the size whose motion leaves least: the best of a grid, and between its neighbours."""
    # Of fits to all rows, one block says as much as many.
    single = np.zeros_like(logs.motion.block)

    def measure(size: float) -> float:
        other = replace(build(size), block=single)
        squares = fit_motion(logs.evaluate(other), other, single[:1]).squares
        return float(squares.sum() if joint is None else squares[joint])

    found = np.array([measure(size) for size in grid.tolist()])
    place = int(found.argmin())
    low, high = grid[max(place - 1, 0)], grid[min(place + 1, len(grid) - 1)]
    # An exact log tells sizes apart that a noisy one does not.
    close = {"xatol": judge.numerics.CONVERGED * float(high - low)}
    best = scipy.optimize.minimize_scalar(measure, bounds=(low, high), method="bounded", options=close)
    return float(best.x) if best.fun < found[place] else float(grid[place])


def shift_torques(motion: ThinMotion, delay: float) -> ThinMotion:
    """Return a motion with the torques of `delay` s later; rows without a torque so late do not count."""
    tau, kept = motion.tau.copy(), motion.kept.copy()
    for run in np.unique(motion.run):
        own = np.flatnonzero(motion.run == run)
        time = np.arange(len(own)) * motion.period
        later = time + delay
        kept[own] &= ((later >= 0.0) & (later <= time[-1]))[:, None]
        tau[own] = CubicSpline(time, motion.tau[own])(np.clip(later, 0.0, time[-1]))
    return replace(motion, tau=tau, kept=kept)


def suspect_logs(logs: FollowedLogs) -> Iterator[Hypothesis]:
    """Yield that each log has parameters of its own."""
    columns, run = logs.columns, logs.motion.run
    others = [np.where(run[:, None, None] == number, columns, 0.0) for number in np.unique(run)[1:]]
    if others:
        cause = "the logs contradict each other: another payload, robot or friction in some of them"
        remedy = "fit each log alone, and compare the parameters"
        wider = np.concatenate([columns, *others], axis=2)
        yield Hypothesis(LOGS, "logs", cause, remedy, logs.motion, (), wider)


def estimate_gravity(logs: FollowedLogs, robot: Robot) -> GravityEstimate:
    """Return the direction of gravity that logs show."""
    friction = logs.columns[:, :, len(logs.library.card.beta) :]
    return find_gravity(robot, logs.motion, logs.fold[logs.motion.block], friction)


def suspect_gravity(found: GravityEstimate, motion: ThinMotion) -> Hypothesis:
    """Return the hypothesis that gravity has the direction that was found."""
    vector = ", ".join(f"{value:.3g}" for value in found.direction)
    turn, deviation = np.degrees(found.turn), np.degrees(found.deviation)
    cause = f"gravity differs from the robot file's by {turn:.3g} degrees +- {deviation:.2g}"
    remedy = f"state gravity = [{vector}] in the robot file, if the robot is mounted so; with all parameters "
    remedy += 'it is found by gravity = "unknown" there'
    # The torque of a weight that the log does not have would be explained for nothing.
    sizes = np.sum(np.where(motion.kept, motion.tau, 0.0) ** 2, axis=0)
    return Hypothesis(GRAVITY, "gravity", cause, remedy, replace(motion, tau=found.tau), sizes=sizes)
