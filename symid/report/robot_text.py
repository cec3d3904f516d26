"""Checked logs and exciting trajectories as text, for a terminal and a page."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from symid import logs
from symid.environment import show_path
from symid.report.blocks import Block, Table
from symid.robot import Robot

if TYPE_CHECKING:
    from symid.excitation import OptimisedExcitation
    from symid.identification.rigid import LogExcitation, LogsCheck
    from symid.logs import JointSummary

_SHOWN = 12
"""Singular values on either side of the rank."""
_VERDICTS = ("identifiable", "poorly identifiable", "not identifiable", "refused")


def summarise_robot(robot: Robot) -> str:
    """Return name, joints and convention."""
    others = {"urdf": "URDF", "mjcf": "MJCF", "origin": "frames by origin"}
    convention = others.get(robot.convention, f"{robot.convention} DH")
    return f"{robot.name}, {robot.size} joint{'s'[: robot.size != 1]}, {convention}"


def show_robot_check(robot: Robot, checked: "LogsCheck", *, brief: bool = False) -> tuple[Block, ...]:
    """Return what was read, the joints of every log, and the identifiability; if `brief` where it lacks."""
    head = f"{robot.path}: {summarise_robot(robot)}: no mistakes"
    if not checked.logs:
        return (head,)
    header = ("log", "samples", "duration/s", "period/s", "velocity", "second encoder")
    rows = list[Sequence[object]]()
    for log, timing in ((entry.recording, entry.timing) for entry in checked.logs):
        channels = (log.velocity is not None, logs.get_second_encoder_side(log))
        rows.append((log.source, timing.samples, timing.duration, log.period, *channels))
    blocks: list[Block] = [Table(header, rows, (0, 5), head)]
    blocks += [show_joints(log.recording.source, log.joints) for log in checked.logs]
    if checked.copy is not None:
        file, notice = checked.copy
        blocks.append(f"{show_path(file)}: {notice.text}")
    found = checked.excitation
    if found is not None:
        verdicts = [entry.verdict for entry in found.parameters]
        counts = ", ".join(f"{verdicts.count(name)} {name}" for name in _VERDICTS if name in verdicts)
        first = max(0, found.rank - _SHOWN // 2)
        shown = [f"{value:.2g}" for value in found.singular[first : first + _SHOWN]]
        shown.insert(found.rank - first, "|")
        text = (
            f"Identifiability: {counts}; condition {found.condition:.3g}\n"
            f"singular values of the scaled matrix about its rank {found.rank} of {len(found.singular)}: "
            f"{'... ' if first else ''}{' '.join(shown)}"
        )
        if brief:
            weak = tuple(entry for entry in found.parameters if entry.verdict != _VERDICTS[0])
            found = replace(found, parameters=weak)
        blocks += [text, *[show_identifiable(found, "std/%")] * bool(found.parameters)]
    return tuple(blocks)


def show_identifiable(
    found: "LogExcitation", name: str, write: Callable[[float], object] = float, title: str = ""
) -> Table:
    """Return the verdict on every parameter, with the deviation to expect, called `name`, and the reason."""
    rows = [(e.name, e.verdict, write(e.relative_std_percent), e.reason) for e in found.parameters]
    return Table(("parameter", "verdict", name, "why"), rows, (0, 1, 3), title)


def show_joints(source: str, joints: "tuple[JointSummary, ...]") -> Table:
    """Return the table of a log's joints."""
    header = ("joint", "from", "to", "top speed", "unit", "step", "still/%", "rms torque", "peak")
    rows = []
    for joint in joints:
        motion = (
            joint.low,
            joint.high,
            joint.speed,
            joint.unit,
            joint.step or None,
            100.0 * joint.standstill,
        )
        rows.append((joint.name, *motion, joint.torque, joint.peak, 100.0 * joint.saturated))
    return Table((*header, "at peak/%"), rows, (0, 4), source)


def describe_gain(factor: float) -> str:
    """Return how much smaller a condition number is than that of the best random trajectory."""
    return f"{factor:.2f} times smaller" if factor >= 1.0 else "no smaller"


def show_excitation(found: "OptimisedExcitation") -> tuple[Block, ...]:
    """Return the figures of a trajectory, the part of each limit that it uses, and clearances."""
    known = [margin for margin in found.margins if margin.share is not None]
    shares = {(margin.kind, margin.name): f"{margin.share:.1%}" for margin in known}
    kinds, names = (tuple(dict.fromkeys(key[place] for key in shares)) for place in (0, 1))
    rows = [[name, *(shares.get((kind, name)) for kind in kinds)] for name in names]
    head = (
        f"{found.trajectory.source}, {found.trajectory.duration:g} s\n"
        f"condition number of the regressor (column-scaled): {found.condition:.4g}\n"
        f"  best of the random feasible trajectories {found.random_condition:.4g}, their median "
        f"{found.random_median:.4g}; {describe_gain(found.factor)} than the best\n"
        f"information per parameter (mean logarithm): {found.information:.4g}, most of the random ones "
        f"{found.random_information:.4g}"
    )
    title = "part of each limit that is used, at most:"
    places = [[margin.name, margin.value] for margin in found.margins if margin.share is None]
    clearances = [Table(("place", "least clearance/m"), places)] if places else []
    return (head, Table(("joint", *kinds), rows, title=title), *clearances)
