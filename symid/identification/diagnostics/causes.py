"""Why a log does not fit: single mistakes undone one after the other, and kept where the fit becomes right.

QuickLogs -> `LikelyCause`, or None where no single mistake explains the result.

Every hypothesis is tried in fact: the samples are changed as if the mistake were undone, and fitted. It
counts if held-out stretches are predicted clearly better, or those of one joint and no other is explained
worse, or nothing impossible is left while they are predicted as well; the one that leaves least is named. The
fit of all samples must leave less, too: with few samples fits of stretches are poor, and differ by chance.

Supported: signs, order and units of columns, a delay of all torques, times scaled, a wrong zero of a joint.
Not supported: two mistakes at once; what no torque can show (all torques scaled, times by a few percent, the
zero of a first vertical or a last joint), which needs a known mass, payload or CAD value.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.identification.diagnostics.quick_model import QuickLogs, QuickResult, fit_quick, mask_impossible

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


@dataclass(frozen=True, slots=True, kw_only=True)
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
        percent = found.percent
        better = percent <= min(_CLEARLY * before.percent, most, _MOST) and _is_certain(before, found)
        better = better and float(np.mean(found.fitted)) <= _FITTED * float(np.mean(before.fitted))
        helped = None
        if not better and held_out is not None:
            helped = _find_helped_joint(before, found, held_out)
        better = better or helped is not None
        may_cure = cures and wrong.any() and trial.code in _TURNED and percent <= _SAME * before.percent
        if not (better or may_cure):
            continue
        rest = int(mask_impossible(trial.logs, found).sum())
        sound = (better and rest <= int(wrong.sum())) or (may_cure and not rest)
        if sound and (best is None or (rest, percent) < best[:2]):
            leaves = before.percent, percent
            if helped is not None:
                leaves = float(before.held_out[helped]), float(found.held_out[helped])
            cause = LikelyCause(
                code=trial.code,
                cause=trial.cause,
                remedy=trial.remedy,
                percent=percent,
                joint="" if helped is None else names[before.moving[helped]],
                leaves=leaves,
            )
            best = rest, percent, cause
    return best[2] if best is not None else _describe_unexplained(names, before, wrong)


def _describe_unexplained(names: list[str], before: QuickResult, wrong: NDArray[np.bool_]) -> LikelyCause:
    """Return what to say where no single mistake helps; `wrong` (n,): joints with impossible values."""
    if before.percent >= _UNRELATED:
        return LikelyCause(
            code="log.foreign-torque",
            cause="the torques have nothing to do with this motion",
            remedy="check that torque and position columns are of the same run and of this robot",
            percent=float("inf"),
        )
    odd = [name for name, bad in zip(names, wrong, strict=True) if bad]
    if odd:
        return LikelyCause(
            code="log.impossible",
            cause=f"inertia or friction of {', '.join(odd)} comes out negative, which no robot has",
            remedy="check sign, unit and zero of position and torque of these joints, and the robot file",
            percent=float("inf"),
        )
    return LikelyCause(
        code="log.other-robot",
        cause="the model explains only part of the torque, and no single mistake in the log explains why",
        remedy="check dimensions and gravity of the robot file, and that the log is of this robot",
        percent=float("inf"),
    )


def _is_certain(before: QuickResult, after: QuickResult) -> bool:
    """Return whether held-out parts are predicted better throughout."""
    return _compare(before.losses.mean(axis=1), after.losses.mean(axis=1)) > _SURE


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
    if not logs.library.card.friction:
        yield Hypothesis(
            "robot.no-friction",
            "the robot file states no friction, and the joints have some",
            "give each joint a friction model ([joint.friction], or --friction coulomb-viscous-offset)",
            replace(logs, friction=True),
        )
    yield from _list_signs(logs, names)
    yield from _list_motor_signs(logs, names)
    yield from _list_exchanges(logs, names)
    yield from _list_units(logs, names)
    for factor in _TIMES:
        scaled = replace(logs, dq=logs.dq / factor, ddq=logs.ddq / factor**2)
        yield Hypothesis(
            "log.time-scale",
            f"the times of the log are about {1.0 / factor:.4g} times what they should be",
            f"multiply them by {factor:.4g} (unit of [log.time])",
            scaled,
        )
    for delay in _DELAYS:
        if delay > _DELAYED * logs.period * len(logs.tau):
            break
        for sign, side in ((1.0, "after"), (-1.0, "before")):
            moved = _shift(logs, sign * delay)
            yield Hypothesis(
                "log.torque-delay",
                f"torques are logged about {1e3 * delay:g} ms {side} the motion",
                "shift them in the log; `symid check` states the delay",
                moved,
            )
    for joint, name in enumerate(names):
        for zero in _ZEROS:
            yield Hypothesis(
                "log.joint-zero",
                f"the zero of joint {name!r} is off by about {zero:.2g} rad",
                "state it as offset of [log.position], or correct theta of the robot file",
                replace(logs, q=_change(logs.q, joint, lambda x, zero=zero: x - zero)),
            )


def _change(values: FloatArray, joint: int, change: object) -> FloatArray:
    changed = values.copy()
    changed[:, joint] = change(values[:, joint])  # type: ignore[operator]  # a function of a column
    return changed


def _scale_position(logs: QuickLogs, joints: list[int], factor: float) -> QuickLogs:
    scale = np.ones(logs.q.shape[1])
    scale[joints] = factor
    return replace(logs, q=logs.q * scale, dq=logs.dq * scale, ddq=logs.ddq * scale)


def _list_signs(logs: QuickLogs, names: list[str]) -> Iterator[Hypothesis]:
    yield Hypothesis(
        "log.torque-sign",
        "all torques have the wrong sign",
        "state a factor of -1 in [log.torque]",
        replace(logs, tau=-logs.tau),
    )
    for joint, name in enumerate(names):
        yield Hypothesis(
            "log.torque-sign",
            f"the torque of joint {name!r} has the wrong sign",
            "state its factor -1 in [log.torque], or turn its gear",
            replace(logs, tau=_change(logs.tau, joint, np.negative)),
        )
        yield Hypothesis(
            "log.position-sign",
            f"the position of joint {name!r} has the wrong sign",
            "state its factor -1 in [log.position]",
            _scale_position(logs, [joint], -1.0),
        )


def _list_motor_signs(logs: QuickLogs, names: list[str]) -> Iterator[Hypothesis]:
    """Yield the logs with the torque of one motor inverted, where that turns no joint's torque alone."""
    if logs.transmission is None:
        return
    matrix = logs.transmission
    for motor in range(len(matrix)):
        flip = np.eye(len(matrix))
        flip[motor, motor] = -1.0
        turn = np.linalg.solve(matrix, flip @ matrix)
        if np.allclose(turn, np.diag(np.diag(turn))):
            continue
        moved = " and ".join(repr(names[joint]) for joint in np.flatnonzero(matrix[motor]))
        yield Hypothesis(
            "log.torque-sign",
            f"the torque of motor {motor + 1}, which moves {moved}, has the wrong sign",
            "state its factor -1 in [log.torque]",
            replace(logs, tau=logs.tau @ turn),
        )


def _list_exchanges(logs: QuickLogs, names: list[str]) -> Iterator[Hypothesis]:
    for first, second in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[first], order[second] = second, first
        pair = f"{names[first]!r} and {names[second]!r}"
        turned = replace(logs, tau=logs.tau[:, order], kept=logs.kept)
        moved = replace(
            logs, q=logs.q[:, order], dq=logs.dq[:, order], ddq=logs.ddq[:, order], kept=logs.kept[:, order]
        )
        for what, other in (("torques", turned), ("positions", moved)):
            yield Hypothesis(
                "log.swapped-joints",
                f"the {what} of {pair} are exchanged",
                f"correct the order of columns in [log.{what[:-1]}]",
                other,
            )
        yield Hypothesis(
            "log.swapped-joints",
            f"the joints {pair} are exchanged",
            "correct the order of columns in [log]",
            replace(moved, tau=logs.tau[:, order]),
        )


def _list_units(logs: QuickLogs, names: list[str]) -> Iterator[Hypothesis]:
    everything = list(range(len(names)))
    for factor, said in ((np.pi / 180.0, "degrees"), (180.0 / np.pi, "radians")):
        yield Hypothesis(
            "log.wrong-unit",
            f"positions are in {said}",
            f'state unit = "{said[:3]}" in [log.position]',
            _scale_position(logs, everything, factor),
        )
        for joint, name in enumerate(names):
            yield Hypothesis(
                "log.wrong-unit",
                f"positions of joint {name!r} are in {said}",
                "state its factor in [log.position]",
                _scale_position(logs, [joint], factor),
            )
    # A joint whose torque is made tiny is cut off from the others, which may help any wrong model.
    size = np.log(np.maximum(np.sqrt(np.mean(logs.tau**2, axis=0)), np.finfo(float).tiny))
    for factor, joint in product(_TORQUES, everything):
        away = size[joint] - float(np.mean(np.delete(size, joint))) if len(size) > 1 else 0.0
        if abs(away + np.log(factor)) >= abs(away):
            continue
        yield Hypothesis(
            "log.wrong-unit",
            f"the torque of joint {names[joint]!r} is about {1.0 / factor:g} times what it should be",
            "state its unit, factor or gear in [log.torque]",
            replace(logs, tau=_change(logs.tau, joint, lambda x, factor=factor: factor * x)),
        )


def _shift(logs: QuickLogs, delay: float) -> QuickLogs:
    """Return the logs with torques taken `delay` s later; rows without such a torque do not count."""
    tau, kept = logs.tau.copy(), logs.kept.copy()
    for run in np.unique(logs.run):
        own = np.flatnonzero(logs.run == run)
        time = np.arange(len(own)) * logs.period
        there = (time + delay >= 0.0) & (time + delay <= time[-1])
        kept[own] &= there[:, None]
        for joint in range(tau.shape[1]):
            tau[own, joint] = np.interp(time + delay, time, logs.tau[own, joint])
    return replace(logs, tau=tau, kept=kept)
