"""The report of friction: one HTML file that needs nothing else.

Input: `FrictionIdentification`. Output: a page with verdict; for each joint friction against velocity, its
law and parameters, how the law was chosen, what the poses say; settings.

Supported: printing, light and dark screens, readers that speak; no scripts, no network.
Not supported: more than one robot on a page; held-out logs besides the blocks that a choice held back.
"""

from dataclasses import dataclass, replace
from pathlib import Path

from symid import __version__
from symid.estimators.estimate import ParameterEstimate
from symid.friction.poses import PoseTest
from symid.friction.results import FrictionIdentification, JointFriction
from symid.friction.selection import LawSelection
from symid.identification.storage import write_file
from symid.report.figures import build_line_figure
from symid.report.friction_cloud import build_friction_figure
from symid.report.lines import Line
from symid.report.tables import ParameterLine, ResidualLine, list_settings, write_parameter, write_residual
from symid.report.templates import write_page
from symid.report.verdict import Verdict, weigh

__all__ = [
    "FrictionPage",
    "JointPage",
    "build_friction_report",
    "find_friction_verdict",
    "write_friction_report",
]

_TEMPLATE = "friction.html.jinja"
_LARGE, _HUGE = 10.0, 30.0
"""Percent of the torque left unexplained beyond which a law is not good, and poor."""
_SAME = 1.2


@dataclass(frozen=True, slots=True, kw_only=True)
class JointPage:
    """What the page shows of a joint; empty texts and tables where there is nothing to show."""

    joint: str
    law: str
    formula: str
    words: tuple[str, ...]
    cloud: str
    search: str
    parameters: tuple[ParameterLine, ...]
    rigid: tuple[ParameterLine, ...]
    refused: tuple[tuple[str, str], ...]
    residual: tuple[ResidualLine, ...]
    choice: str
    trials: tuple[tuple[str, ...], ...]
    pose_verdict: str
    pose_names: tuple[str, ...]
    pose_rows: tuple[tuple[str, ...], ...]
    pose_places: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionPage:
    """The context of the page: its fields are the template's variables."""

    robot: str
    verdict: Verdict
    joints: tuple[JointPage, ...]
    left_out: tuple[tuple[str, str], ...]
    settings: tuple[tuple[str, str], ...]
    notices: tuple[str, ...]
    origin: tuple[str, ...]


def write_friction_report(path: Path, found: FrictionIdentification) -> Path:
    """Write the page to `path`, at once or not at all, and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_file(path, write_page(_TEMPLATE, build_friction_report(found)))


def build_friction_report(found: FrictionIdentification) -> FrictionPage:
    """Return all that the page shows."""
    head = (
        ("law asked for", found.model),
        ("estimator", found.estimator),
        ("logs", ", ".join(found.sources)),
        ("signature of the model", found.signature),
    )
    return FrictionPage(
        robot=found.robot,
        verdict=find_friction_verdict(found),
        joints=tuple(map(_build_joint, found.joints)),
        left_out=found.refused,
        settings=head + tuple(list_settings(found.settings)),
        notices=tuple(dict.fromkeys(map(str, found.notices))),
        origin=(f"Written by symid {__version__}",),
    )


def _build_joint(entry: JointFriction) -> JointPage:
    estimate = entry.estimate
    ending = (
        f"{estimate.outcome.value[:1].upper()}{estimate.outcome.value[1:]}: {estimate.ended}; "
        f"{estimate.evaluations} evaluations of the objective, {estimate.solves} linear problems."
    )
    words = (
        f"{entry.rigid[:1].upper()}{entry.rigid[1:]}.",
        ending,
        f"AICc {estimate.aicc:.5g}, BIC {estimate.bic:.5g}, condition {estimate.condition:.3g}.",
    )
    poses = entry.poses
    return JointPage(
        joint=entry.joint,
        law=estimate.law,
        formula=entry.formula,
        words=words,
        cloud=build_friction_figure(entry),
        search=_draw_search(entry),
        parameters=tuple(write_parameter(_put_meaning(line)) for line in estimate.parameters),
        rigid=tuple(map(write_parameter, estimate.extra)),
        refused=estimate.refused,
        residual=(write_residual(entry.residual),),
        choice="" if entry.selection is None else entry.selection.verdict,
        trials=() if entry.selection is None else _list_trials(entry.selection),
        pose_verdict="" if poses is None else f"{poses.verdict[:1].upper()}{poses.verdict[1:]}.",
        pose_names=() if poses is None else _name_poses(poses),
        pose_rows=() if poses is None else _list_poses(poses),
        pose_places=() if poses is None else _place_poses(poses),
    )


def _put_meaning(entry: ParameterEstimate) -> ParameterEstimate:
    """Return the parameter with its meaning as words, not as a formula."""
    return replace(entry, expression="", reason="; ".join(filter(None, (entry.expression, entry.reason))))


def _draw_search(entry: JointFriction) -> str:
    """Return the least objective over the iterations; nothing where there were none."""
    history = [value for value in entry.estimate.history if value > 0.0]
    if len(history) < 3:
        return ""
    import numpy as np

    line = Line(
        label="least objective",
        style="final",
        x=np.arange(len(history), dtype=np.float64),
        y=np.array(history),
        markers=len(history) < 40,
    )
    return build_line_figure(
        f"{entry.joint}: the search",
        f"Least objective of the search for the law of {entry.joint} after each iteration or generation.",
        ("iteration or generation", f"objective (({entry.unit})²)"),
        (line,),
        logarithmic=True,
        whole=True,
    )


def _list_trials(selection: LawSelection) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (
            trial.law,
            str(trial.unknowns),
            _write(trial.fitted_percent, ".4f"),
            _write(trial.held_percent, ".4f"),
            _write(trial.held_rms, ".4g"),
            _write(trial.ratio, ".4f"),
            _write(trial.behind, ".1f"),
            "taken" if trial.law == selection.chosen else trial.reason,
        )
        for trial in selection.trials
    )


def _write(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _name_poses(poses: PoseTest) -> tuple[str, ...]:
    return ("name", *(f"pose {k}" for k in range(1, len(poses.poses) + 1)), "unit", "chance")


def _list_poses(poses: PoseTest) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (
            entry.name,
            *(f"{low:.4g} to {high:.4g}" for low, high in entry.intervals),
            entry.unit,
            f"{entry.chance:.2g}",
        )
        for entry in poses.parameters
    )


def _place_poses(poses: PoseTest) -> tuple[str, ...]:
    places = [
        f"pose {k}: {', '.join(f'{name} at {place:.3g}' for name, place in pose.others)}; "
        f"{', '.join(pose.sources)}"
        for k, pose in enumerate(poses.poses, start=1)
    ]
    return (*places, *(f"left out: {sources}: {reason}" for sources, reason in poses.skipped))


def find_friction_verdict(found: FrictionIdentification) -> Verdict:
    """Return what the result is worth: how well what was held back is predicted, what is not known."""
    tried = [entry for entry in found.joints if entry.selection is not None]
    names = ", ".join(f"{entry.joint}: {entry.estimate.law}" for entry in found.joints)
    level, headline = "fair", f"Laws of friction: {names}. Nothing that was held back has tested them."
    if tried and len(tried) == len(found.joints):
        ratio = max(map(_find_ratio, tried))
        same = ratio <= _SAME
        level = "good" if same else "fair"
        headline = (
            f"Laws of friction: {names}. Blocks held back are predicted "
            + ("as well as" if same else f"{ratio:.2g} times worse than")
            + " those fitted."
        )
    caps: list[tuple[str, str]] = []
    worst = max(entry.residual.relative_percent for entry in found.joints)
    if worst > _LARGE:
        cap = "poor" if worst > _HUGE else "fair"
        caps.append((cap, f"{worst:.3g} % of a torque is left unexplained"))
    lost = [f"{name} of {entry.joint}" for entry in found.joints for name, _ in entry.estimate.refused]
    if lost:
        caps.append(("fair", f"these logs do not tell {', '.join(lost)}"))
    details = [entry.selection.verdict for entry in tried if entry.selection is not None]
    details += [f"{entry.poses.verdict}." for entry in found.joints if entry.poses is not None]
    details += [f"{name}: {reason}." for name, reason in found.refused]
    return weigh(level, headline, details, caps)


def _find_ratio(entry: JointFriction) -> float:
    """Return the error held back over that fitted, of the law taken."""
    if entry.selection is None:
        return 1.0
    taken = next(trial for trial in entry.selection.trials if trial.law == entry.selection.chosen)
    if not taken.fitted_percent or taken.held_percent is None:
        return 1.0
    return taken.held_percent / taken.fitted_percent
