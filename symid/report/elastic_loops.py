"""Hysteresis loops on a log: torque of the joint against its torsion, measured and by the springs.

Input: `ElasticTrial`. Output: `TrialSection`, figures and tables ready to print.
"""

from dataclasses import dataclass

from symid.arrays import FloatArray
from symid.elastic.trial import ElasticTrial, JointTrial
from symid.report.figures import build_curve_figure, build_line_figure
from symid.report.lines import Line
from symid.report.tables import ResidualLine, write_residual

__all__ = ["LoopSection", "TrialSection", "build_trial"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopSection:
    """The figures of one joint, as SVG: loops, loops without their common slope, what the spring leaves.

    The last is empty where no spring was found.
    """

    joint: str
    loops: str
    opened: str
    error: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialSection:
    """One log: its figures, and tables of residuals, each with a caption."""

    source: str
    caption: str
    joints: tuple[LoopSection, ...]
    residuals: tuple[tuple[str, tuple[ResidualLine, ...]], ...]


def build_trial(trial: ElasticTrial) -> TrialSection:
    """Return the section of one log."""
    caption = "Held out: nothing was fitted here."
    if trial.fitted:
        caption = "A log of the fit: this is no test."
    return TrialSection(
        source=trial.source,
        caption=caption,
        joints=tuple(map(_draw_joint, trial.joints)),
        residuals=tuple((text, tuple(map(write_residual, lines))) for text, lines in trial.residuals),
    )


def _draw_joint(entry: JointTrial) -> LoopSection:
    slope = entry.straight
    stiffness = f"{slope:.4g} {entry.unit}/{entry.torsion_unit}"
    return LoopSection(
        joint=entry.joint,
        loops=_draw_loops(
            entry,
            0.0,
            f"{entry.joint}: hysteresis loops",
            f"Joint torque of {entry.joint} in {entry.unit} against its torsion: measured from the motor, "
            "from the link, and by the springs.",
            f"joint torque ({entry.unit})",
        ),
        opened=_draw_loops(
            entry,
            slope,
            f"{entry.joint}: hysteresis loops, opened",
            f"Joint torque of {entry.joint} less {stiffness} times its torsion, against its torsion.",
            f"torque less {stiffness} \N{MULTIPLICATION SIGN} torsion ({entry.unit})",
        ),
        error="" if entry.final is None else _draw_error(entry, entry.final),
    )


def _draw_loops(entry: JointTrial, slope: float, title: str, description: str, label: str) -> str:
    return build_curve_figure(
        title,
        description,
        (f"torsion (m{entry.torsion_unit})", label),
        [
            Line(label=name, style=style, x=1e3 * entry.torsion, y=values - slope * entry.torsion)
            for name, style, values in _list_ways(entry)
        ],
    )


def _list_ways(entry: JointTrial) -> list[tuple[str, str, FloatArray]]:
    """Return every way to the joint torque with its style, what is to lie on top last."""
    label, linear = _find_linear(entry)
    ways = (
        ("truth", "truth", entry.truth),
        ("measured, motor side", "measured", entry.motor),
        ("measured, link side", "link", entry.link),
        (label, "initial", linear),
        ("identified", "final", entry.final),
    )
    return [(label, style, values) for label, style, values in ways if values is not None]


def _find_linear(entry: JointTrial) -> tuple[str, FloatArray]:
    """Return the torque by the linear spring of the start, or else by the one that fits this log best."""
    if entry.initial is not None:
        return "linear start", entry.initial
    return "best linear spring", entry.straight * entry.torsion


def _draw_error(entry: JointTrial, final: FloatArray) -> str:
    label, linear = _find_linear(entry)
    lines = [
        Line(label=label, style="initial", x=entry.time, y=entry.motor - linear),
        Line(label="identified", style="final", x=entry.time, y=entry.motor - final),
    ]
    return build_line_figure(
        f"{entry.joint}: what the spring leaves",
        f"Joint torque of {entry.joint} by the motor equation less that of the springs, in {entry.unit}.",
        ("time (s)", f"difference ({entry.unit})"),
        lines,
    )
