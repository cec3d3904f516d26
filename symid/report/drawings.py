"""Figures before anything is identified: a robot's skeleton, a log, a trajectory; axes of matplotlib.

Robot and pose, recording and its check, motion and its limits -> `Drawing`, each with a question and its
answer in the caption.

Figures with their data can also be drawn into axes of matplotlib, by methods of the axes, so that nothing of
it is imported.

Supported: trees, prismatic joints, joints that follow another. Not supported: shapes of links; in axes of
matplotlib skeletons and flow charts, which have no such data.
"""

from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from itertools import combinations
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.report import figures
from symid.report.blocks import Drawing, format_percent
from symid.robot import Placement, Robot, to_matrix

if TYPE_CHECKING:
    from symid.excitation import Margin, OptimisedExcitation, ReferenceMotion
    from symid.identification.rigid import CheckedLog
    from symid.logs import Recording


_HALF_METRE = 0.5
_THICKEST, _THINNEST = 0.055, 0.03
"""Radii of the first and the last drum, in parts of the arm's extent."""
_SAMPLES = 600
"""Of a trajectory that is drawn."""
_OFTEN, _PEAK = 0.01, 0.999
"""Share of the samples at the peak from which they are marked; size of those samples over the peak."""
_UNITS = {"position": ("rad", "m"), "velocity": ("rad/s", "m/s"), "torque": ("N m", "N")}
_NEEDED = ("plot", "fill", "axvline", "set_xlabel", "legend")


def place_arm(robot: Robot, pose: Sequence[float]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the links as lines (k, 3) from joint to joint and to tools, m, and the frames (4, 4) of joints.

    `pose` holds a coordinate for every joint that follows no other, rad or m.
    """
    values = {name: _HALF_METRE for joint in robot.joints for name in _list_symbols(joint.placement)}
    values |= dict(robot.symbols)
    angles = dict(zip(robot.coordinates, pose, strict=True))
    links, frames = list[FloatArray](), list[FloatArray]()
    for index, joint in enumerate(robot.joints):
        parent = np.eye(4) if joint.parent < 0 else frames[joint.parent]
        frame = parent @ to_matrix(joint.placement, values)
        start, axis, end = parent[:3, 3], frame[:3, 2], frame[:3, 3]
        along = ((end - start) @ axis) * axis
        mimic = joint.mimic
        q = angles[index] if mimic is None else float(mimic.multiplier) * angles[mimic.master]
        step = np.eye(4)
        if joint.prismatic:
            step[2, 3] = q
        else:
            step[:2, :2] = [[np.cos(q), -np.sin(q)], [np.sin(q), np.cos(q)]]
        frames.append(frame @ step)
        links.append(np.array([start, end - along, frames[-1][:3, 3]]))
    # Tools: the links of a file that move with a joint behind which no other follows.
    for index in sorted({*range(robot.size)} - {joint.parent for joint in robot.joints}):
        held = [to_matrix(entry.placement, values) for entry in robot.links if entry.joint == index]
        links.append(np.array([(frames[index] @ placed)[:3, 3] for placed in (np.eye(4), *held)]))
    return links, frames


def _list_symbols(placement: Placement) -> set[str]:
    return {name for entry in placement.translation for name, _ in entry.terms if name}


def draw_robot(robot: Robot, pose: Sequence[float] | Mapping[str, float] | None = None) -> Drawing:
    """Return the robot as a skeleton with the frames of its links.

    `pose` are coordinates of the joints that follow no other, rad or m, or those of some joints by name; else
    zero where the limits allow it.

    Raises:
        UsageError: there are more or fewer coordinates than the robot has.
    """
    if pose is None or isinstance(pose, Mapping):
        ranges = [(joint.name, *(joint.limits.position or (-inf, inf))) for joint in robot.axes]
        pose = [min(max((pose or {}).get(name, 0.0), low), high) for name, low, high in ranges]
    if len(pose) != robot.freedom:
        text = f"pose: {len(pose)} coordinates for {robot.freedom} joints; give one for each"
        raise UsageError(Notice(code="usage.pose", text=text))
    links, frames = place_arm(robot, pose)
    extent = float(np.max(np.ptp(np.vstack(links), axis=0))) or 1.0
    radii = extent * np.linspace(_THICKEST, _THINNEST, len(frames))
    # Joints that are near to one another share the label of the first.
    labels, places = [joint.name for joint in robot.joints], [frame[:3, 3] for frame in frames]
    for index, other in combinations(range(len(frames)), 2):
        if labels[index] and labels[other] and np.linalg.norm(places[other] - places[index]) < radii[-1]:
            labels[index], labels[other] = f"{labels[index]}, {labels[other]}", ""
    joints = [
        figures.ArmJoint(frame[:3, 3], frame[:3, 2], label, "second" if joint.prismatic else "first", radius)
        for joint, label, frame, radius in zip(robot.joints, labels, frames, radii.tolist(), strict=True)
    ]
    slides = sum(joint.prismatic for joint in robot.joints)
    counts = ((len(robot.joints) - slides, "revolute"), (slides, "prismatic"))
    moves = " and ".join(f"{count} {name}" for count, name in counts if count)
    moves += " joint" if len(robot.joints) == 1 else " joints"
    place = ", ".join(f"{value:.3g}" for value in pose)
    used = {name for entry in robot.joints for name in _list_symbols(entry.placement)}
    unknown = ", ".join(sorted(used - dict(robot.symbols).keys()))
    caption = f"Where are the joints of {robot.name}? {moves} at q = ({place}); z of each frame, blue, "
    caption += f"is the axis of its joint.{' Prismatic joints are orange.' if slides else ''}"
    caption += f"{f' {unknown}: no value, drawn as {_HALF_METRE} m.' if unknown else ''}"
    return figures.build_arm_figure(caption, links, joints, frames=frames)


def draw_log(log: "Recording", robot: Robot, checked: "CheckedLog | None" = None) -> tuple[Drawing, ...]:
    """Return positions and torques of a log over time, with what its check found marked in them.

    Marked are samples at the peak of a torque where they are many, positions beyond the limits of the robot
    file, and gaps between samples.
    """
    joints = [entry.name for entry in robot.axes]
    ranges = np.array([joint.limits.position or (-inf, inf) for joint in robot.axes])
    outside: NDArray[np.bool_] = (log.position < ranges[:, 0]) | (log.position > ranges[:, 1])
    bounds, gaps = np.full(len(joints), inf), 0
    if checked is not None:
        bounds = np.array([entry.peak if entry.saturated > _OFTEN else inf for entry in checked.joints])
        gaps = len(checked.timing.gaps)
    full: NDArray[np.bool_] = np.abs(log.torque) >= _PEAK * bounds
    beyond, held = (
        ", ".join(name for k, name in enumerate(joints) if marks[:, k].any()) for marks in (outside, full)
    )
    where = f"beyond the limits of the robot file: {beyond}" if beyond else "within all stated limits"
    went = f"Where did the joints go? {log.time[-1] - log.time[0]:.4g} s of {log.source}, {where}."
    took = f"held at its largest value, as if limited: {held}" if held else "none looks limited"
    took = f"What did it take? Torques: {took}{f'; {gaps} gaps between samples' if gaps else ''}."
    return (
        *_draw_channels(went, "position", robot, (log.time, log.position, outside)),
        *_draw_channels(took, "torque", robot, (log.time, log.torque, full)),
    )


def _draw_channels(
    caption: str, name: str, robot: Robot, course: tuple[FloatArray, FloatArray, NDArray[np.bool_] | None]
) -> Iterator[Drawing]:
    """Yield the joints' values over time, joints of one unit in one figure, seven at most.

    `course`: time (N,), values (N, n), and which of them are marked (N, n).
    """
    time, values, marked = course
    for prismatic, unit in enumerate(_UNITS[name]):
        rows = [k for k, joint in enumerate(robot.axes) if joint.prismatic == bool(prismatic)]
        for start in range(0, len(rows), len(figures.STYLES)):
            group = rows[start : start + len(figures.STYLES)]
            styled = zip(group, figures.STYLES, strict=False)
            lines = [figures.Line(robot.axes[k].name, style, time, values[:, k]) for k, style in styled]
            spots = [] if marked is None else [(time[marked[:, k]], values[marked[:, k], k]) for k in group]
            if sum(len(x) for x, _ in spots):
                x, y = (np.concatenate(part) for part in zip(*spots, strict=True))
                lines.append(figures.Line("found by the check", "found", x, y, joined=False))
            yield figures.build_line_figure(caption, (figures.TIME, f"{name} ({unit})"), lines)


def draw_motion(motion: "ReferenceMotion", robot: Robot) -> tuple[Drawing, ...]:
    """Return positions and velocities of a trajectory over time, and the used part of each stated limit."""
    shares, courses = list[tuple[str, float]](), motion.evaluate(np.linspace(0.0, motion.duration, _SAMPLES))
    for joint, x, v, a in zip(robot.axes, *(course.T for course in courses), strict=True):
        limits = joint.limits
        if limits.position is not None:
            low, high = limits.position
            middle = 0.5 * (low + high)
            shares.append((f"{joint.name} position", float(np.max(np.abs(x - middle))) / (high - middle)))
        rates = (("velocity", v, limits.velocity), ("acceleration", a, limits.acceleration))
        shares += [
            (f"{joint.name} {name}", float(np.max(np.abs(y))) / limit) for name, y, limit in rates if limit
        ]
    return (*_draw_courses(motion, robot), *draw_shares(shares))


def _draw_courses(motion: "ReferenceMotion", robot: Robot) -> Iterator[Drawing]:
    time = np.linspace(0.0, motion.duration, _SAMPLES)
    q, dq, _ = motion.evaluate(time)
    caption = f"Where does it go? {motion.source}, {motion.duration:.4g} s: positions."
    yield from _draw_channels(caption, "position", robot, (time, q, None))
    fastest = robot.axes[int(np.argmax(np.max(np.abs(dq), axis=0)))].name
    caption = f"How fast? Velocities; the fastest joint is {fastest}."
    yield from _draw_channels(caption, "velocity", robot, (time, dq, None))


def draw_shares(shares: Sequence[tuple[str, float]]) -> tuple[Drawing, ...]:
    """Return the used part of each limit, by its name; nothing where no limit is known."""
    if not shares:
        return ()
    name, most = max(shares, key=lambda entry: entry[1])
    marks = [figures.Mark(text, 100.0 * x, format_percent(100.0 * x), chosen=x > 1.0) for text, x in shares]
    caption = f"Does it keep its limits? {'Yes' if most <= 1.0 else 'No'}: {name} uses {100.0 * most:.3g} %."
    label, dense = "used part of the limit (%)", len(marks) > 8
    return (figures.build_mark_figure(caption, label, marks, dense=dense, limit=100.0),)


def draw_excitation(found: "OptimisedExcitation", robot: Robot) -> tuple[Drawing, ...]:
    """Return positions and velocities of an optimised trajectory, and the used part of all its limits."""
    return (*_draw_courses(found.trajectory, robot), *draw_shares(list_shares(found.margins)))


def list_shares(margins: Sequence["Margin"]) -> list[tuple[str, float]]:
    """Return name and used part of each limit but clearances."""
    return [(f"{entry.name} {entry.kind}", entry.share) for entry in margins if entry.share is not None]


def draw_into(axes: object, drawings: Sequence[Drawing]) -> None:
    """Draw the first figures that have data into axes, one into each; axes that are left over stay empty.

    `axes` are one, or a sequence or array of them.

    Raises:
        UsageError: they are none of matplotlib; the message says what to install where that is missing.
    """
    known_axes, waiting = list[Any](), [axes]
    while waiting:
        entry: Any = waiting.pop(0)
        inner = getattr(entry, "flat", entry)
        if inner is not entry or (isinstance(inner, Sequence) and not isinstance(inner, str)):
            waiting = [*inner, *waiting]
        else:
            known_axes.append(entry)
    if not (known_axes and all(hasattr(entry, name) for entry in known_axes for name in _NEEDED)):
        text = "expected axes of matplotlib, as `matplotlib.pyplot.subplots()` returns them"
        if find_spec("matplotlib") is None:
            text += "; matplotlib is not installed: pip install 'symid[plot]'"
        raise UsageError(Notice(code="usage.axes", text=f"ax: {text}"))
    shown = (entry.data for entry in drawings if isinstance(entry.data, figures.FigureData))
    for ax, data in zip(known_axes, shown, strict=False):
        known = set[str]()
        for line in data.lines:
            # A legend lists a label once.
            label = f"_{line.label}" if line.label in known else line.label
            known.add(line.label)
            if line.style == "area":
                ax.fill(line.x, line.y, alpha=0.2, label=label)
            else:
                marker = "o" if line.markers else None if line.joined else "."
                ax.plot(line.x, line.y, label=label, marker=marker, linestyle="-" if line.joined else "none")
        if data.marks:
            rows = range(len(data.marks))
            ax.plot([entry.value for entry in data.marks], rows, marker="o", linestyle="none")
            ax.set_yticks(rows, [entry.label for entry in data.marks])
            ax.invert_yaxis()
        if data.limit is not None:
            ax.axvline(data.limit, linestyle="--", color="gray")
        if data.logarithmic:
            (ax.set_xscale if data.marks else ax.set_yscale)("log")
        ax.set_xlabel(data.labels[0])
        ax.set_ylabel(data.labels[1])
        if len(known) > 1:
            ax.legend()
