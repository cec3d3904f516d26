"""Suspicious properties of a recording, and a summary of every joint; nothing here stops an identification.

Recording, Robot -> notices; JointSummary of each joint: range, top speed, encoder step, standstill, torque.

Supported: uneven sampling, a velocity that is not the position's, constant channels, standstill, positions
beyond the joint's limits or in degrees, coarse or repeated samples of one joint, missing second encoders;
encoder steps of positions that are multiples of a step, with or without an offset.
Not supported: faults of samples (see `faults`); signs, swapped joints and delays (see
`identification.diagnostics`); delays between encoders (see `alignment`); the step of interpolated positions.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.logs.recording import Recording
from symid.logs.sampling import describe_timing
from symid.logs.signals import take_line_off
from symid.robot import Joint, JointKind, Robot

# Thresholds of warnings, not of refusals.
_REPEATED = 0.5
_STANDSTILL, _MOVE = 0.5, "inertia and friction are poorly identifiable. Move it more"
_MANY_TURNS = 4.0 * np.pi
_LEAST_WAY = 1e-2
"""Least range in rad or m of a joint whose velocity is compared."""
_UNLIKE = 0.9
_RATIO = 0.1
OVERLOAD, _MOMENT = 1.5, 0.01
"""Times its limit from which on a torque is far beyond it, as the judge has it; part of samples left out."""


def check_recording(recording: Recording, robot: Robot) -> tuple[Notice, ...]:
    """Return warnings on the recording."""
    found = [(notice.code, notice.text) for notice in describe_timing(recording.time)]
    summaries = summarise_joints(recording, robot)
    for index, (joint, summary) in enumerate(zip(robot.axes, summaries, strict=True)):
        found += _check_position(recording.position[:, index].copy(), joint)
        torque = recording.torque[:, index]
        if np.ptp(torque) == 0.0 and joint.actuated:
            text = f"the torque of joint {joint.name!r} is {torque[0]:.4g} throughout"
            found.append(("log.constant-torque", f"{text}: {_MOVE}, or check the column"))
        if summary.low < summary.high and summary.standstill > _STANDSTILL:
            text = f"joint {joint.name!r} is at standstill for {100 * summary.standstill:.0f} % of the log"
            found.append(("log.standstill", f"{text}; {_MOVE}"))
    beyond = find_overloads([recording], robot)
    limits = [(entry, entry.limits.torque) for entry in robot.axes]
    peaks = {
        joint.name: f"{joint.name!r} {summary.peak:.4g}, limit {most:.4g}"
        for (joint, most), summary in zip(limits, summaries, strict=True)
        if most is not None and summary.peak > most * (1.0 + 1e-6)
    }
    parts = [text for name, text in peaks.items() if name in beyond]
    if parts:
        text = (
            f"torques are far beyond the limits of the joints ({'; '.join(parts)}), which no drive delivers"
        )
        text += "; check unit, factor and gear, or the limits in the robot file"
        found.append(("log.torque-beyond-limit", text))
    parts = [text for name, text in peaks.items() if name not in beyond]
    if parts:
        text = f"peaks of torques are beyond the limits of the joints ({'; '.join(parts)}), as servos allow"
        found.append(("log.torque-peaks", f"{text} them for a moment"))
    side = get_second_encoder_side(recording)
    second = recording.motor_position if side == "motor" else recording.link_position
    if side is not None and second is not None:
        names = [repr(joint.name) for joint in robot.axes]
        # Rigid joints beside elastic ones have one position, which a log may give twice.
        asked = np.array(robot.elastic) | (not any(robot.elastic))
        still = (np.ptp(second, axis=0) == 0.0) & asked
        copied = np.all(second == recording.position, axis=0) & ~still & asked
        for mask, what in ((still, "is constant"), (copied, "repeats the position to the last bit")):
            if mask.any():
                joints = ", ".join(name for name, hit in zip(names, mask, strict=True) if hit)
                text = f"the channel of the {side} encoder {what} for {joints}: it is not an encoder"
                found.append(("log.no-second-encoder", f"{text}, and torsion is unknown; check the column"))
    if recording.velocity is not None and np.all(np.isfinite(recording.velocity)):
        # The integral of the logged velocity, which may have a small bias, against the position.
        steps = 0.5 * np.diff(recording.time)
        for index, joint in enumerate(robot.axes):
            moved, velocity = recording.position[:, index], recording.velocity[:, index]
            way = np.append(0.0, np.cumsum(steps * (velocity[1:] + velocity[:-1])))
            position, integral = map(take_line_off, (moved, way))
            sizes = float(np.linalg.norm(position)), float(np.linalg.norm(integral))
            if not min(sizes) or np.ptp(moved) < _LEAST_WAY:
                continue
            likeness = float(position @ integral) / (sizes[0] * sizes[1])
            ratio = sizes[1] / sizes[0] * np.sign(likeness)
            if abs(likeness) < _UNLIKE:
                text = f"the velocity of joint {joint.name!r} is not that of its position"
                found.append(("log.velocity-differs", f"{text}; check the order of the velocity columns"))
            elif abs(ratio - 1.0) > _RATIO:
                text = f"the velocity of joint {joint.name!r} is {ratio:.4g} times the rate of its position"
                found.append(("log.velocity-differs", f"{text}: {_explain_ratio(ratio, joint.drive.gear)}"))
    return tuple(Notice(code=code, text=text, file=recording.source) for code, text in found)


def find_overloads(recordings: Sequence[Recording], robot: Robot) -> dict[str, tuple[float, float]]:
    """Return torque and limit, N m or N, of joints whose torques are far beyond the limit, by name.

    The torque is that which all but one sample in a hundred stay below, of all recordings together.
    """
    found = {}
    for index, joint in enumerate(robot.axes):
        most = joint.limits.torque
        if most is not None and recordings:
            sizes = np.abs(np.concatenate([entry.torque[:, index] for entry in recordings]))
            torque = float(np.nanquantile(sizes, 1.0 - _MOMENT))
            if torque > OVERLOAD * most:
                found[joint.name] = (torque, most)
    return found


def get_second_encoder_side(recording: Recording) -> str | None:
    """Return the side of the second encoder, "motor" or "link"; None if there is none."""
    if recording.motor_position is not None:
        return "motor"
    return None if recording.link_position is None else "link"


def _explain_ratio(ratio: float, gear: float) -> str:
    """Return the likely cause of a velocity that is `ratio` times the rate of the position."""
    known = {
        -1.0: "one of them has the wrong sign",
        180.0 / np.pi: "the velocity looks like degrees per second",
        np.pi / 180.0: "the position looks like degrees",
        30.0 / np.pi: "the velocity looks like revolutions per minute",
        1e3: "one of them is in thousandths, or time is in milliseconds",
        1e-3: "one of them is in thousandths, or time is in milliseconds",
        gear: "the velocity looks like the motor's",
        1.0 / gear: "the position looks like the motor's",
    }
    hits = [text for value, text in known.items() if abs(ratio / value - 1.0) < _RATIO and value != 1.0]
    return f"{hits[0] if hits else 'their units or sides differ'}; state unit and side of both in [log]"


def _check_position(position: FloatArray, joint: Joint) -> Iterator[tuple[str, str]]:
    low, high = float(position.min()), float(position.max())
    if low == high:
        yield "log.constant-position", f"joint {joint.name!r} does not move in this log; {_MOVE}"
        return
    # The joint moves at more than a tenth of its median speed, over ten samples.
    span = min(10, len(position) - 1)
    travel = np.abs(position[span:] - position[:-span])
    moving = position[: len(travel)][travel > 0.1 * float(np.median(travel))]
    repeated = float(np.mean(np.diff(moving) == 0.0)) if len(moving) > 1 else 0.0
    if repeated > _REPEATED:
        share = f"{100 * repeated:.0f} % of its positions"
        text = f"joint {joint.name!r} moves, but {share} repeat the one before: the sensor is slow or coarse"
        yield "log.repeated-samples", f"{text}, which spoils accelerations. Log at its rate"
    limits = joint.limits.position
    unit = "m" if joint.kind is JointKind.PRISMATIC else "rad"
    if limits and (low < limits[0] or high > limits[1]):
        text = f"joint {joint.name!r} moves from {low:.4g} to {high:.4g} {unit}, beyond its limits"
        yield "log.beyond-limits", f"{text} {limits[0]:.4g} .. {limits[1]:.4g}; check unit and factor"
    elif joint.kind is JointKind.REVOLUTE and high - low > _MANY_TURNS:
        text = f"joint {joint.name!r} moves over {high - low:.4g} rad, more than two turns"
        gear = abs(joint.drive.gear)
        if gear != 1.0 and (high - low) / gear < _MANY_TURNS / 2.0:
            text += f" ({(high - low) / gear:.4g} rad by its gear ratio)"
        yield "log.looks-like-degrees", f"{text}; check whether the log is in degrees, or of the motor side"


_SAMPLES = 200_000
_TOLERANCE = 0.02
"""Allowed deviation of a difference from a whole number of steps, in steps."""
_SMALLEST = 1e-7
"""Smallest step, relative to the range; smaller ones are the rounding of the file."""
_LARGEST = 200.0
"""Largest difference in steps; rounding of the log hides whether larger ones are whole numbers."""


def estimate_encoder_step(position: FloatArray) -> float:
    """Return the step of which all differences of `position` (N,) are multiples, rad or m; 0 for none."""
    differences = np.abs(np.diff(position[:_SAMPLES]))
    floor = 64.0 * np.finfo(float).eps * float(np.max(np.abs(position), initial=0.0))
    differences = differences[differences > floor]
    if len(differences) < 3:
        return 0.0
    step = float(np.min(differences))
    near = differences[differences < _LARGEST * step]
    # The average over many steps has a smaller rounding error than the smallest difference.
    counts = np.round(near / step)
    step = float(near @ counts / (counts @ counts))
    if step <= _SMALLEST * float(np.ptp(position)):
        return 0.0
    counts = differences / step
    off = np.abs(counts - np.round(counts)) * np.minimum(1.0, _LARGEST / np.maximum(counts, 1.0))
    return step if float(np.quantile(off, 0.99)) < _TOLERANCE else 0.0


_SPAN = 0.1
"""Seconds over which a speed is computed, so that the steps of an encoder are no motion."""
_STILL = 1e-3
_PEAK = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSummary:
    """Summary of a joint in a log, in the unit of its position and SI torque.

    Args:
        low, high: range of the position; speed: its largest, over a tenth of a second.
        step: of the encoder, 0 where the log shows none.
        standstill: share of the time at less than a thousandth of the sweep, or of the top speed, per second.
        torque: root mean square; peak: largest size; saturated: share of the samples at the peak.
    """

    name: str
    unit: str
    low: float
    high: float
    speed: float
    step: float
    standstill: float
    torque: float
    peak: float
    saturated: float


def summarise_joints(recording: Recording, robot: Robot) -> tuple[JointSummary, ...]:
    """Return the summary of every joint."""
    found = []
    span = max(1, min(round(_SPAN / recording.period), len(recording.time) - 1))
    for index, joint in enumerate(robot.axes):
        # Columns of their own are read faster, many times.
        position, torque = recording.position[:, index].copy(), recording.torque[:, index].copy()
        speed = np.abs(position[span:] - position[:-span]) / (span * recording.period)
        top, sweep = float(speed.max()), float(np.ptp(position))
        peak = float(max(torque.max(), -torque.min()))
        found.append(
            JointSummary(
                name=joint.name,
                unit="m" if joint.kind is JointKind.PRISMATIC else "rad",
                low=float(position.min()),
                high=float(position.max()),
                speed=top,
                step=estimate_encoder_step(position),
                standstill=float(np.mean(speed <= _STILL * max(sweep, top))),
                torque=float(np.sqrt(np.mean(torque**2))),
                peak=peak,
                saturated=float(np.mean(np.abs(torque) >= peak * (1.0 - _PEAK))) if peak else 0.0,
            )
        )
    return tuple(found)
