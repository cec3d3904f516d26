"""How well a robot followed a motion with each of several feed-forwards.

Input: tracking errors over time, one `TrackingRun` a feed-forward. Output: `TrackingSection`,
ready to print.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from symid.report.figures import build_line_figure
from symid.report.lines import STYLES, Line

if TYPE_CHECKING:  # this loads the simulator
    from symid.elastic.tracking import TrackingRun

__all__ = ["Tracking", "TrackingLine", "TrackingSection", "build_tracking"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracking:
    """Runs of one motion, and sentences on how they differ, for example with intervals of many runs."""

    runs: tuple["TrackingRun", ...]
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingLine:
    """A row of the table: a feed-forward and the RMS error of every joint."""

    name: str
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingSection:
    """The table of RMS errors, one figure a joint as SVG, and what else is said of them."""

    names: tuple[str, ...]
    lines: tuple[TrackingLine, ...]
    figures: tuple[tuple[str, str], ...]
    words: tuple[str, ...]


def build_tracking(tracking: Tracking | None, joints: Sequence[tuple[str, str]]) -> TrackingSection | None:
    """Return the section, None where nothing was run; `joints` are names and units of position."""
    if tracking is None or not tracking.runs:
        return None
    runs = tracking.runs
    return TrackingSection(
        names=tuple(f"{name} (m{unit})" for name, unit in joints),
        lines=tuple(
            TrackingLine(
                name=run.name,
                values=tuple(f"{1e3 * value:.4g}" for value in run.rms.tolist()),
            )
            for run in runs
        ),
        figures=tuple(
            (name, _draw_joint(index, name, unit, runs)) for index, (name, unit) in enumerate(joints)
        ),
        words=tracking.words,
    )


def _draw_joint(index: int, name: str, unit: str, runs: Sequence["TrackingRun"]) -> str:
    return build_line_figure(
        f"{name}: tracking error",
        f"Reached less desired position of {name} in m{unit} against time in s, for every feed-forward.",
        ("time (s)", f"tracking error (m{unit})"),
        [
            Line(
                label=run.name,
                style=STYLES[number % len(STYLES)],
                x=run.time,
                y=1e3 * run.error[:, index],
            )
            for number, run in enumerate(runs)
        ],
    )
