"""Faults of a log's samples, found, and repaired or masked, before anything is fitted.

Recording, joints -> Recording, whose `bad` samples count in no fit, with notices on what was done.

    repeats    rows that repeat the one before to the last bit although the robot moves: a slower robot was
               polled. New rows get the even times t0 + k T of its clock, or stay at their stamps
    resampled  uneven stamps: rows are put at even times whatever the stamps say, or moved there from them
    wraps      steps of 2 pi of a revolute joint, taken off exactly
    spikes     one or a few samples that stand out of a channel
    stuck      an encoder that repeats its value, and catches up
    jumps      steps of a position that no motion makes: samples are missing, or files were joined
    clipped    a torque that is cut off at its largest or smallest value

Ordinary in a channel are its second differences: a quantile of all that are not rounding, and the largest
beside a place. Samples stand out that lie on the same side of the line through the two samples before and of
that through the two after, farther from both than `level` times what is ordinary: kinks and steps lie on one
of the lines, and where all vibrates the neighbours do, too. Velocities that stand out are jumps. A torque
that returns is no spike if steps that stay are half as large (friction that turns twice), or a joint is
accelerated as suddenly.

Of time lines that one is taken along which positions are smoothest: the ordinary |x_k - p(t_k)|, p the cubic
through the two samples before and the two after, or, with a logged velocity v, the ordinary
|x_(k+1) - x_k - (t_(k+1) - t_k) (v_k + v_(k+1)) / 2|.

Bad positions are bridged by the cubic that continues values and slopes of both sides, so that filters see no
step. They are bad for all joints, whose torques depend on them.

Supported: any recording, several faults at once; in what was repaired nothing more is found.
Not supported: spikes in many per cent of the samples; positions that repeat while torques of the same rows
are new (see `checks`); a robot's clock that drifts, whose repeats are interpolated over.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from symid.arrays import FloatArray, find_runs, measure_top
from symid.errors import Notice
from symid.logs.recording import Recording
from symid.logs.sampling import Resampling, mask_onward, plan_resampling, resample_recording
from symid.logs.signals import describe_uneven
from symid.robot import Joint

Mask = NDArray[np.bool_]
Places = NDArray[np.intp]
FaultKind = Literal["repeats", "resampled", "wraps", "spikes", "stuck", "jumps", "clipped"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultLevels:
    """The numbers that decide, what they mean, and what half of each and twice as much do.

    Args:
        level: times what is ordinary: stands out. Gaussian noise reaches 2.7 in a million samples, clean
            recordings 4: half of it finds faults in some of them, twice as much misses small spikes.
        ordinary: the quantile. Half takes rare ticks of a resting encoder for spikes; at one none stands out.
        neighbours: on either side. Half finds spikes where vibrations begin; twice as many hide each other.
        longest: samples of a spike. One misses bursts; twice as many find pauses of slow logs.
        several: ticks, and times what steps differ by, that a joint must go on by beside a repeated row;
            spikes after which others as large need not stand alone; samples at the top of a torque for each
            one just below. Half finds repeats where joints turn; twice as many misses what is clipped a bit.
        off_line: poll periods by which stamps may be off the robot's clock. A poll alone makes one, three let
            clocks drift.
        uneven: RMS of the jitter from which times are looked at: less does no harm to accelerations.
    """

    level: float = 6.0
    ordinary: float = 0.75
    neighbours: int = 8
    longest: int = 3
    several: float = 4.0
    off_line: float = 1.5
    uneven: float = 0.03


LEVELS = FaultLevels()
_ROUNDING = 64.0 * float(np.finfo(np.float64).eps)
_LEAST = 16
"""Samples in which faults can be told from motion."""
_POSITIONS = ("position", "motor_position", "link_position")
_LEFT_OUT = "samples that they affect are left out of rigid and friction fits"
_TEXTS: Mapping[FaultKind, str] = {
    "wraps": "{where} wraps at 2 pi ({count} times): these steps were removed",
    "spikes": "{where} has spikes in {count} samples ({share:.2g} %), the first at {time:.6g} s: they were "
    f"bridged, and {_LEFT_OUT}; check cables, connectors and the bus",
    "stuck": "{where} repeats one value in {count} samples ({share:.2g} %), the first at {time:.6g} s, and "
    f"catches up, as a hanging encoder or bus does: they were bridged, and {_LEFT_OUT}; cut the log there",
    "jumps": "{where} jumps, the first time at {time:.6g} s: samples are missing, or files were joined. "
    f"{{count}} samples ({{share:.2g}} %) were bridged, and {_LEFT_OUT}; cut the log there",
    "clipped": "{where} is cut off at its extreme value in {count} samples ({share:.2g} %), by the drive or "
    f"the log: {_LEFT_OUT}; accelerate less, or log a wider range",
}


def repair_recording(recording: Recording, joints: Sequence[Joint]) -> Recording:
    """Return a recording with its faults repaired or masked, and notices, or the one given if it has none.

    `joints` (n,) are those of its columns. A LogError if times are uneven and too few samples are left
    between gaps.
    """
    log, told = _take_turns_off(recording, joints)
    if (plan := choose_times(log)) is not None:
        log, told = resample_recording(log, plan), [*told, plan.notice]
    while len(log.time) >= _LEAST:
        # What is ordinary changes with what was bridged.
        log, found = _repair_samples(log, joints)
        told += found
        if not found:
            break
    return replace(log, notices=(*log.notices, *told)) if told else recording


def _describe_fault(kind: FaultKind, name: str, joint: Joint, log: Recording, mask: Mask) -> Notice:
    """Return what to say of the wrong samples (N,) of a joint's channel."""
    where = f"the {name.replace('_', ' ')} of joint {joint.name!r}"
    count, share, time = int(np.sum(mask)), 100.0 * float(np.mean(mask)), float(log.time[np.argmax(mask)])
    text = _TEXTS[kind].format(where=where, count=count, share=share, time=time)
    return Notice(code=f"log.{kind}", text=text, file=log.source)


def _take_turns_off(log: Recording, joints: Sequence[Joint]) -> tuple[Recording, list[Notice]]:
    """Return the recording with positions that do not wrap, and references by as many turns."""
    found: list[Notice] = []
    for name in _POSITIONS:
        given = getattr(log, name)
        if given is None or np.all(measure_top(given, 1) <= np.pi):
            continue
        pairs = zip(joints, given.T, strict=True)
        whole = np.column_stack([values if joint.prismatic else unwrap(values) for joint, values in pairs])
        steps = np.pad(np.abs(np.diff(whole - given, axis=0)) > np.pi, ((1, 0), (0, 0)))
        told = zip(joints, steps.T, strict=True)
        found += (_describe_fault("wraps", name, joint, log, mask) for joint, mask in told if mask.any())
        changed: dict[str, Any] = {name: whole}
        if name == "position" and log.reference is not None:
            turns = np.where(steps.any(axis=0), np.round((whole - log.reference) / (2.0 * np.pi)), 0.0)
            changed["reference"] = log.reference + 2.0 * np.pi * turns
        log = replace(log, **changed)
    return log, found


def mask_repeats(channels: Sequence[FloatArray], position: FloatArray) -> Mask:
    """Return which rows of channels (N, m) repeat the one before although the robot moves: (N,).

    Some joint, at positions (N, n), must go on in the same direction, by several ticks, and by several times
    what its steps differ before and after. If it repeats longer than usual, it must catch up as well: joints
    that stop, turn, or are slower than their encoder explain that rows are equal; not where others repeat as
    often.
    """
    same = np.arange(len(position)) > 0
    for values in (column for channel in channels for column in channel.T):
        same[1:] &= values[1:] == values[:-1]
        if not same.any():
            return same
    if np.sum(~same) < 2:
        return np.zeros(len(position), dtype=np.bool_)
    fresh = np.flatnonzero(~same)
    steps, lengths = np.diff(position[fresh], axis=0), np.diff(np.append(fresh, len(position)))
    rounding = _ROUNDING * np.max(np.abs(position), axis=0)
    ticks = np.min(np.abs(steps), axis=0, initial=np.inf, where=np.abs(steps) > rounding)
    padded = np.pad(steps, ((2, 3), (0, 0)), mode="edge")
    before, into, out, after, later = (padded[k : k + len(fresh)] for k in range(5))
    least = LEVELS.several * np.maximum(ticks, np.maximum(np.abs(into - before), np.abs(later - after)))
    moves = (into * out > 0.0) & (into * after > 0.0) & (np.minimum(np.abs(into), np.abs(after)) > least)
    moves &= (lengths <= np.median(lengths) + 1)[:, None] | (np.abs(out) - np.abs(after) > least)
    longest = np.max(lengths, initial=1, where=np.any(moves, axis=1))
    return np.asarray(same & np.repeat(lengths <= longest, lengths))


def measure_roughness(time: FloatArray, position: FloatArray, velocity: FloatArray | None) -> FloatArray:
    """Return how far positions (N, n) at times (N,) are from a smooth motion, or that of a velocity: (n,)."""
    if velocity is not None and np.all(np.isfinite(velocity)):
        steps = np.diff(position, axis=0)
        error = np.abs(steps - 0.5 * np.diff(time)[:, None] * (velocity[1:] + velocity[:-1]))
        # A velocity in other units, or of another joint, says nothing.
        if 2.0 * np.sum(error) < np.sum(np.abs(steps)):
            return np.asarray(np.quantile(error, LEVELS.ordinary, axis=0))
    inner, places = slice(2, -2), [slice(k, len(time) - 4 + k) for k in (0, 1, 3, 4)]
    error = position[inner].copy()
    for own in places:
        # Lagrange's weight of a sample at the time of the middle one.
        weight = np.ones(len(error))
        for other in (entry for entry in places if entry is not own):
            weight *= (time[inner] - time[other]) / (time[own] - time[other])
        error -= weight[:, None] * position[own]
    return np.asarray(np.quantile(np.abs(error), LEVELS.ordinary, axis=0))


def _list_lines(time: FloatArray, poll: float) -> Iterator[FloatArray]:
    """Yield even times that stamps (K,) are near to: with no sample missing, and with some."""
    steps = np.diff(time)
    for places in (np.ones(len(steps)), np.maximum(np.round(steps / np.median(steps)), 1.0)):
        index = np.append(0.0, np.cumsum(places))
        # The first row may have been new for a while.
        slope, start = np.polyfit(index[1:], time[1:], 1)
        line = start + slope * index
        away = np.max(np.abs(line - time)[1:])
        # Stamps with some missing are no other times.
        other = np.all(places == 1.0) or away > _ROUNDING * np.max(np.abs(time))
        if other and away <= LEVELS.off_line * poll:
            yield line


def choose_times(recording: Recording) -> Resampling | None:
    """Return how to get rid of repeated rows and uneven times; None where there are none."""
    time, position, velocity = recording.time, recording.position, recording.velocity
    steps, onward = np.diff(time), mask_onward(time)
    even = len(steps) > 0 and onward.all() and describe_uneven(time) is None
    even = even and float(np.std(steps)) <= LEVELS.uneven * float(np.mean(steps))
    channels = [getattr(recording, name) for name in (*_POSITIONS, "torque", "velocity")]
    used = slice(None) if onward.all() else onward
    repeated = mask_repeats([values[used] for values in channels if values is not None], position[used])
    if even and not repeated.any():
        return None
    poll = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    kept = np.flatnonzero(onward)[~repeated]
    lines = [time[kept], *(_list_lines(time[kept], poll) if len(kept) >= _LEAST else ())]
    taken = 0
    if len(lines) > 1:
        rate = None if velocity is None else velocity[kept]
        rough = np.array([measure_roughness(line, position[kept], rate) for line in lines])
        scores = np.sum(np.log(rough[:, np.all(rough > 0.0, axis=0)]), axis=1)
        # Stamps that are a clock's, but that of a first row that was there before, are as smooth as it.
        exact = float(np.max(np.abs(lines[1] - lines[0])[1:])) <= _ROUNDING * float(np.max(np.abs(time)))
        taken = 1 if exact else int(np.argmin(scores))
    plan = plan_resampling(time, recording.source, kept, lines[taken])
    clock = f"at the even times of a clock, every {1e3 * (plan.after[1] - plan.after[0]):.6g} ms"
    clock += "" if plan.after is plan.before else ", some by interpolation"
    why = "positions are smoother there than at even times" if len(lines) > 1 else "they fit no clock"
    kind: FaultKind = "resampled"
    text = f"{plan.notice.text}; stamps are taken for true, as {why}"
    if repeated.any():
        kind = "repeats"
        others = f"put {clock}" if taken else "left at their stamps, which fit no clock, and interpolated"
        text = f"{100.0 * float(np.mean(repeated)):.3g} % of the samples repeat the one before to the last "
        text += "bit although the robot moves: it was polled faster than it answers. They were dropped, and "
        text += f"the others {others}; log each answer once, with the robot's own time"
    elif taken:
        text = f"time stamps are uneven, and positions smoother with the samples {clock}, where they were put"
    return replace(plan, notice=Notice(code=f"log.{kind}", text=text, file=recording.source))


def _repair_samples(log: Recording, joints: Sequence[Joint]) -> tuple[Recording, list[Notice]]:
    """Return the recording with samples of single channels repaired or masked, and what was new."""
    known = np.zeros((1, len(joints)), dtype=np.bool_) if log.bad is None else log.bad
    known = np.broadcast_to(known, log.position.shape)
    bad, found = known, list[Notice]()
    for name in (*_POSITIONS, "velocity", "torque", "load"):
        given = getattr(log, name)
        if given is None or not np.all(np.isfinite(given)):
            continue
        repaired = given
        sudden = None if name in _POSITIONS else _SuddenMotion(log.position)
        for index, joint in enumerate(joints):
            # A column of its own is read faster, many times.
            old, values = known[:, index], given[:, index].copy()
            for kind, whole in _find_faults(name, values, old, log, index, sudden).items():
                mask = whole & ~old
                if mask.any():
                    bad = bad if found else bad.copy()
                    repaired = given.copy() if repaired is given else repaired
                    found.append(_describe_fault(kind, name, joint, log, mask))
                    bad[mask, index if name in {"torque", "load"} else slice(None)] = True
                    if kind != "clipped":
                        repaired[:, index] = _bridge(repaired[:, index], mask)
        repaired.setflags(write=False)
        changed: dict[str, Any] = {name: repaired}
        log = replace(log, **changed)
    return replace(log, bad=bad) if found else log, found


def _find_faults(  # noqa: PLR0917 - a channel, and what is known of its log
    name: str, values: FloatArray, known: Mask, log: Recording, joint: int, sudden: "_SuddenMotion | None"
) -> dict[FaultKind, Mask]:
    """Return the wrong samples (N,) of a channel by kind; what is near `known` ones is not looked at."""
    curvature = _measure_curvature(values)
    if sudden is None:
        spikes = _mask_spikes(values, known.__getitem__, curvature)
        if spikes.any():
            values = _bridge(values, spikes)
            curvature = _measure_curvature(values)
        stuck = _mask_stuck(values, log.torque[:, joint], known, curvature)
        if stuck.any():
            values = _bridge(values, stuck)
            curvature = _measure_curvature(values)
        return {"spikes": spikes, "stuck": stuck, "jumps": _mask_jumps(values, known, curvature.ordinary)}

    def look(places: Places) -> Mask:
        return known[places] | sudden.mask(places)

    found: dict[FaultKind, Mask] = {"spikes": _mask_spikes(values, look, curvature, returning=True)}
    if name == "torque":
        found["clipped"] = _mask_clipped(values, log.position[:, joint])
    return found


class _Curvature(NamedTuple):
    """Sizes of second differences: what is ordinary, and `steep` (k,) samples that stand out, of `values`."""

    values: FloatArray
    ordinary: float
    steep: Places

    def measure(self, places: Places) -> FloatArray:
        """Return those at some samples, zero at the ends and beyond."""
        inner = np.clip(places, 1, len(self.values) - 2)
        before, here, after = (self.values[inner + k] for k in (-1, 0, 1))
        return np.where(inner == places, np.abs((after - here) - (here - before)), 0.0)

    def measure_most(self, places: Places, way: int) -> FloatArray:
        """Return the largest one of each of some samples (k,) and its neighbours before it or after it."""
        return np.asarray(self.measure(places[:, None] + way * np.arange(LEVELS.neighbours)).max(axis=1))


def _measure_curvature(values: FloatArray) -> _Curvature:
    curve = np.diff(values, n=2)
    np.abs(curve, out=curve)
    used = curve[curve > _ROUNDING * max(float(np.max(values)), -float(np.min(values)))]
    ordinary = float(np.quantile(used, LEVELS.ordinary, overwrite_input=True)) if len(used) else math.inf
    return _Curvature(values, ordinary, 1 + np.flatnonzero(curve > LEVELS.level * ordinary))


class _SuddenMotion:
    """Samples near which a joint, at positions (N, n), is accelerated as it is not before, or not after."""

    def __init__(self, position: FloatArray) -> None:
        self._position, self._curves = position, list[_Curvature]()

    def mask(self, places: Places) -> Mask:
        """Return whether some samples (...) are near such a motion."""
        self._curves = self._curves or [_measure_curvature(values) for values in self._position.T]
        beside, reach = np.arange(-LEVELS.longest, LEVELS.longest + 1), LEVELS.longest + 1
        last = len(self._position) - 1
        wide = np.clip(places[..., None] + beside, 0, last)
        samples, back = np.unique(wide, return_inverse=True)
        found = np.zeros(len(samples), dtype=np.bool_)
        for curve in self._curves:
            here = curve.measure(samples)
            own = np.flatnonzero(here > curve.ordinary)
            before = curve.measure_most(np.maximum(samples[own] - reach, 0), -1)
            after = curve.measure_most(np.minimum(samples[own] + reach, last), 1)
            found[own] |= here[own] > LEVELS.level * np.minimum(before, after)
        return np.asarray(found[back.reshape(wide.shape)].any(axis=-1))


def _stand_out(
    values: FloatArray, length: int, known: Callable[[Places], Mask], curvature: _Curvature
) -> tuple[Places, FloatArray, FloatArray]:
    """Return where blocks of `length` samples begin that may stand out, how far, and what is ordinary: (c,).

    A block near `known` samples, or with none on either side, does not. Nor does one whose first sample
    goes on from those before as is ordinary: no sample of a block is farther away than its first one.
    """
    places, last_place = np.append([0, 1], curvature.steep + 1), len(values) - 1
    around = places[:, None] + np.arange(-2, length + 2)
    inside = np.clip(around, 0, last_place)
    old, last, *block, next_, far = np.where(inside == around, values[inside], np.nan).T
    away = []
    for k, own in enumerate(block):
        left, right = own - last - (k + 1) * (last - old), own - next_ - (length - k) * (next_ - far)
        # At an end of the log one side is enough.
        away += [np.where(np.isnan(left), right, left), np.where(np.isnan(right), left, right)]
    table = np.nan_to_num(np.array(away))
    sizes = np.maximum(table.min(axis=0), 0.0) - np.minimum(table.max(axis=0), 0.0)
    before = curvature.measure_most(np.maximum(places - 2, 0), -1)
    after = curvature.measure_most(np.minimum(places + length + 1, last_place), 1)
    usual = np.maximum(curvature.ordinary, np.maximum(before, after))
    if np.any(sizes > LEVELS.level * usual):
        near = np.clip(places[:, None] + np.arange(-length - 2, length + 3), 0, last_place)
        sizes[known(near).any(axis=1)] = 0.0
    return places, sizes, usual


def _mask_spikes(
    values: FloatArray, known: Callable[[Places], Mask], curvature: _Curvature, *, returning: bool = False
) -> Mask:
    """Return the spikes (N,) of a channel; of a `returning` one those twice as large as steps that stay."""
    found, least = np.zeros(len(values), dtype=np.bool_), 0.0
    for length in range(1, LEVELS.longest + 1):
        places, sizes, usual = _stand_out(values, length, known, curvature)
        large = sizes > LEVELS.level * usual
        if returning and not least and large.any():
            least = 2.0 * _measure_stays(values)
        large &= sizes > least
        if np.sum(large) >= LEVELS.several:
            large |= sizes >= np.min(sizes[large])
        for start in places[large].tolist():
            found[start : start + length] = True
    return found


def _measure_stays(values: FloatArray) -> float:
    """Return the largest step that stays: between what is largest before and least after, or reversed."""
    span = LEVELS.longest + 1
    windows = sliding_window_view(values, len(values) - LEVELS.longest)
    low, high = windows.min(axis=0), windows.max(axis=0)
    return max(0.0, float(np.max(low[span:] - high[:-span])), float(np.max(low[:-span] - high[span:])))


def unwrap(values: FloatArray) -> FloatArray:
    """Return positions (N,) without steps of whole turns that leave steps as those beside them."""
    steps, turn = np.diff(values), 2.0 * np.pi
    turns = np.where(np.abs(steps) > np.pi, np.round(steps / turn), 0.0)
    if not turns.any() or float(np.quantile(np.abs(steps), LEVELS.ordinary)) > 0.5 * np.pi:
        return values
    rest = steps - turn * turns
    changes = np.pad(np.abs(np.diff(rest)), 1, constant_values=np.inf)
    usual = LEVELS.level * _measure_curvature(np.append(0.0, np.cumsum(rest))).ordinary
    turns[np.minimum(changes[1:], changes[:-1]) > usual] = 0.0
    return values - turn * np.append(0.0, np.cumsum(turns))


def _mask_stuck(values: FloatArray, torque: FloatArray, known: Mask, curvature: _Curvature) -> Mask:
    """Return where an encoder (N,) repeats its value and catches up, or repeats it until the log ends."""
    found, count = np.zeros(len(values), dtype=np.bool_), len(values)
    moves = np.pad(np.diff(values), 2)
    # Of the last sample, too, if it is alone.
    alone = np.full((int(moves[-3] != 0.0), 2), count - 1)
    starts, ends = np.vstack([find_runs(moves[2:-2] == 0.0), alone]).T
    # Steps into and out of each run of equal values, and those beside them.
    places = np.stack([starts, starts + 1, ends + 2, np.minimum(ends + 3, count + 2)])
    before, into, out, after = moves[places]
    # A slow motion makes rare steps, which are ordinary there.
    usual = np.maximum(curvature.ordinary, np.where(before == 0.0, np.abs(into), 0.0))
    usual = np.maximum(usual, curvature.measure_most(np.maximum(starts - 2, 0), -1))
    usual = LEVELS.level * np.maximum(usual, curvature.measure_most(np.minimum(ends + 3, count - 1), 1))
    stuck = (ends > starts) & (ends < count - 2) & (np.abs(out) - np.abs(after) > usual)
    # At the end of the log it was on its way: who stops between two samples goes a part of a step.
    going = abs(into[-1]) > max(usual[-1], abs(before[-1]) - usual[-1]) and np.ptp(torque[starts[-1] :]) > 0.0
    stuck[-1] |= going and ends[-1] - starts[-1] > LEVELS.longest
    for run in np.flatnonzero(stuck):
        # The first one is right, unless it is what stands out.
        first = starts[run] + int(starts[run] > 0 and abs(into[run] - before[run]) <= usual[run])
        found[first : ends[run] + 1] = not known[max(0, first - 2) : ends[run] + 3].any()
    return found


def _mask_jumps(values: FloatArray, known: Mask, ordinary: float) -> Mask:
    """Return so many samples (N,) about each jump that it is bridged by what curvature is ordinary."""
    found, steps, near = np.zeros(len(values), dtype=np.bool_), np.diff(values), known[:-1] | known[1:]
    places, sizes, usual = _stand_out(steps, 1, near.__getitem__, _measure_curvature(steps))
    large = sizes > LEVELS.level * np.maximum(usual, ordinary)
    for place, size in zip(places[large].tolist(), sizes[large].tolist(), strict=True):
        # A cubic at rest at both ends curves by six times its height over the square of its length.
        half = max(1, math.ceil(0.5 * math.sqrt(6.0 * size / ordinary)))
        found[max(0, place + 1 - half) : place + 1 + half] = True
    return found


def _mask_clipped(torque: FloatArray, position: FloatArray) -> Mask:
    """Return where the torque (N,) of a joint that moves, at positions (N,), is cut off."""
    found = np.zeros(len(torque), dtype=np.bool_)
    for values in (torque, -torque):
        top, highest = values == np.max(values), np.max(values)
        first, last = find_runs(top, LEVELS.longest).T
        if not len(first) or top.all():
            continue
        moved = np.abs(position[last - 1] - position[first])
        far = moved > LEVELS.level * _measure_curvature(position).ordinary
        first, last = first[far], last[far]
        # A coarse torque stays at its levels.
        finest = float(np.quantile(np.abs(np.diff(torque)), LEVELS.ordinary))
        if not len(first) or highest - (second := np.max(values[~top])) > finest:
            continue
        # Commands that step to a level and back are not cut off.
        padded = np.pad(values, 2, mode="edge")
        near, far = padded[np.stack([first + 1, last + 2])], padded[np.stack([first, last + 3])]
        reached = np.any(highest - near <= LEVELS.level * np.abs(near - far), axis=0)
        enough = np.sum(last - first) >= LEVELS.several * (1 + np.sum(values == second))
        found |= top & (enough and 2 * np.sum(reached) > len(first))
    return found


def _bridge(values: FloatArray, bad: Mask) -> FloatArray:
    """Return values (N,) with cubics that continue both sides for bad ones; at an end they come to rest."""
    found, count = values.copy(), len(values)
    # One sample alone has no slope.
    bad = bad | (np.append(bad[1:], False) & np.append(False, bad[:-1]))
    for first, last in find_runs(bad).tolist():
        if last - first == count:
            break
        length = last - first + 1
        start = values[first - 1] if first else values[last]
        end = values[last] if last < count else start
        left = values[first - 1] - values[first - 2] if first > 1 else 0.0
        right = values[last + 1] - values[last] if last + 1 < count else 0.0
        u = np.arange(1, length) / length
        found[first:last] = start + (end - start) * u**2 * (3.0 - 2.0 * u)
        found[first:last] += length * u * (1.0 - u) * (left * (1.0 - u) - right * u)
    return found
