"""The pages of results that are no fits: check of logs, trajectory, payload, stiffness, comparison.

Result -> `FitVerdict`, `Page`: the first screen has the verdict, three numbers and a figure; tables follow.

    check        good: all parameters identifiable and nothing odd; doubtful: a warning that makes values
                 wrong; wrong: the logs are not enough
    trajectory   good: every limit kept, condition number at most 100; usable: at most 1000
    payload      usable: a quantity is missing; doubtful: something else changed between the logs
    stiffness    usable: a joint is missing; doubtful: all are
    comparison   good: differences as chance makes them, at 1 %; doubtful: larger

Not supported: other results, which have pages of their own.
"""

import math
import shlex
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np

from symid.errors import SEVERE, Notice, merge_notices
from symid.identification.estimators import ParameterEstimate
from symid.report import pages
from symid.report.blocks import Block, Drawing, Table
from symid.report.drawings import draw_excitation, draw_log, draw_robot, list_shares
from symid.report.figures import Line, Mark, build_line_figure, build_mark_figure
from symid.report.fit_text import show_stiffness
from symid.report.robot_text import (
    describe_gain,
    show_excitation,
    show_identifiable,
    show_joints,
    show_robot_check,
    summarise_robot,
)
from symid.report.validation_text import show_comparison
from symid.report.verdict import FitVerdict
from symid.robot import Robot, name_for_commands

if TYPE_CHECKING:
    from symid.dynamics import Payload
    from symid.excitation import OptimisedExcitation
    from symid.identification import Compared, EstimateSide
    from symid.identification.diagnostics import LogsCheck
    from symid.identification.elastic import StiffnessEstimate

_WELL, _ENOUGH = 100.0, 1000.0
"""Condition numbers of a column-scaled regressor up to which a trajectory is good, and usable."""
_CHANCE = 0.01
_FAR = 3.0
"""Deviations between the nearest body and least squares beyond which something else changed."""
_MOST_MARKS = 30


def _build_page(
    robot: str,
    subject: str,
    verdict: FitVerdict,
    figures: Sequence[Drawing],
    *,
    blocks: Sequence[Block],
    notices: Sequence[Notice] = (),
    **options: Any,  # noqa: ANN401  fields of the page
) -> pages.Page:
    """Return a page whose first figure stands beside its verdict, the others before the tables."""
    rest = figures[1:]
    options.setdefault("settings", (("robot", robot),))
    return pages.Page(
        robot=robot,
        subject=subject,
        verdict=verdict,
        lead=figures[0] if figures else None,
        blocks=(*(["== Figures =="] if rest else ()), *rest, *blocks),
        notices=tuple(map(str, merge_notices(notices))),
        **options,
    )


def judge_check(checked: "LogsCheck") -> FitVerdict:
    """Return what logs are worth for an identification."""
    severe = [entry for entry in checked.notices if entry.code in SEVERE]
    found = checked.excitation
    poor = () if found is None else found.list_names("poorly identifiable", "not identifiable", "refused")
    level, details = "usable", list(map(str, (*checked.errors, *severe)))
    if not checked.logs:
        level, headline, details = "good", "The robot file has no mistakes.", ["No log was given."]
    elif checked.errors:
        level, headline = "wrong", "The logs are not enough for a model of this robot."
    elif severe:
        count = f"{len(severe)} finding{'s'[: len(severe) > 1]}"
        level, headline = "doubtful", f"{count} would make values wrong: {severe[0].text}."
    elif found is None:
        headline = "Nothing odd was found in the log; what is identifiable was not analysed."
        details = ["Elastic joints, or no log."]
    elif poor:
        headline = f"{len(poor)} of {len(found.parameters)} parameters are poorly or not identifiable."
        details = [f"They are {', '.join(poor)}."]
    else:
        headline = f"All {len(found.parameters)} parameters are identifiable, and nothing odd was found."
        level, details = "good", [f"Condition number {found.condition:.3g}."]
    return FitVerdict(level=level, headline=headline, details=tuple(details))


def draw_check(robot: Robot, checked: "LogsCheck") -> tuple[Drawing, ...]:
    """Return the figures of checked logs, or of the robot where there is none."""
    drawn = (draw_log(entry.recording, robot, entry) for entry in checked.logs)
    return tuple(chain.from_iterable(drawn)) or (draw_robot(robot),)


def write_check_page(path: Path, robot: Robot, checked: "LogsCheck") -> Path:
    """Write the page of a robot file and its logs, checked; OutputError where it cannot be written."""
    numbers: list[tuple[str, str]] = []
    found, several = checked.excitation, "s"[: len(checked.logs) > 1]
    blocks: tuple[Block, ...] = show_robot_check(robot, checked)
    if found is not None:
        good, values = len(found.list_names("identifiable")), np.array(found.singular)
        numbers = [
            (f"{good} of {len(found.parameters)}", "parameters identifiable"),
            (pages.format_digits(found.condition), "condition number (column-scaled)"),
        ]
        title = "What a fit to all these logs would identify."
        blocks = (
            *("== Identifiability ==", show_identifiable(found, "expected std", pages.format_percent, title)),
            build_line_figure(
                "How well are the parameters separated? Singular values of the scaled regressor; "
                f"the rank is {found.rank} of {len(found.singular)}.",
                ("number", "singular value"),
                [Line("singular value", "first", np.arange(1.0, len(values) + 1.0), values, markers=True)],
                logarithmic=bool(np.any(values > 0.0)),
                whole=True,
            ),
            "== Joints ==",
            *(show_joints(entry.recording.source, entry.joints) for entry in checked.logs),
        )
    length = sum(entry.timing.duration for entry in checked.logs)
    numbers.append((f"{length:.4g} s", f"in {len(checked.logs)} log{several}"))
    sources = (entry.recording.source for entry in checked.logs)
    command = ("symid", "identify", name_for_commands(robot), *sources)
    page = _build_page(
        robot.name,
        "check of logs" if checked.logs else "check of a robot file",
        judge_check(checked),
        draw_check(robot, checked),
        numbers=numbers if checked.logs else (),
        blocks=blocks,
        notices=(*robot.notices, *checked.notices),
        next_step=(shlex.join(command), "Identify the parameters") if checked.logs else None,
        settings=(("robot", summarise_robot(robot)), ("file", str(robot.path))),
    )
    return pages.write_page(path, page)


def write_excitation_page(path: Path, robot: Robot, found: "OptimisedExcitation") -> Path:
    """Write the page of an optimised trajectory; OutputError where it cannot be written."""
    shares = list_shares(found.margins)
    kept = all(entry.kept for entry in found.margins)
    level = "good" if found.condition <= _WELL else "usable" if found.condition <= _ENOUGH else "doubtful"
    said = "All limits are kept" if kept else "A limit is exceeded"
    headline = (
        f"{said}; the condition number is {found.condition:.4g}, {describe_gain(found.factor)} than that "
        "of the best random trajectory."
    )
    name, most = max(shares, key=lambda entry: entry[1], default=("no limit", 0.0))
    rows = [(run.start, run.condition, run.iterations, run.status) for run in found.runs]
    title = "The search from every start, the best first."
    starts = Table(("start", "condition", "iterations", "status"), rows, (3,), title)
    page = _build_page(
        robot.name,
        "trajectory for identification",
        FitVerdict(
            level=level if kept else "wrong",
            headline=headline,
            details=(f"The limit that is used most is {name}: {100.0 * most:.3g} %.",),
        ),
        draw_excitation(found, robot),
        numbers=(
            (f"{found.condition:.4g}", "condition number (column-scaled)"),
            (pages.format_percent(100.0 * most), f"of a limit used at most: {name}"),
            (f"{found.trajectory.duration:g} s", "period"),
        ),
        blocks=("== Limits and condition ==", *show_excitation(found)),
        more=("== Search ==", starts),
        notices=found.notices,
        next_step=(
            f"symid simulate {shlex.quote(name_for_commands(robot))} --trajectory TRAJECTORY -o log.npz",
            "Simulate a log of it, or run it on the robot",
        ),
    )
    return pages.write_page(path, page)


def judge_payload(found: "Payload") -> FitVerdict:
    """Return what an identified payload is worth."""
    lost = [entry.name for entry in found.quantities if entry.value is None]
    friction = [entry.name for entry in found.friction]
    changed = found.moved > _FAR or bool(found.unexplained and found.doubtful)
    known = len(found.quantities) - len(lost)
    headline = f"{known} of {len(found.quantities)} quantities of the payload are identified."
    lists = (("Not identifiable", lost), ("Friction changed", friction))
    return FitVerdict(
        level="doubtful" if changed else "usable" if lost else "good",
        headline=headline + " But something else than a payload changed between the logs." * changed,
        details=(
            f"chi-square {found.chi2:.3g} over {found.freedom} degrees of freedom.",
            *(f"{what}: {', '.join(names)}." for what, names in lists if names),
        ),
    )


def write_payload_page(path: Path, robot: str, found: "Payload", notices: Sequence[Notice]) -> Path:
    """Write the page of a payload and return the path; OutputError where it cannot be written."""
    known = [
        ParameterEstimate(name=e.name, value=e.value, std=math.inf if e.std is None else e.std, unit=e.unit)
        for e in found.quantities
        if e.value is not None
    ]
    lost = [(entry.name, entry.reason) for entry in found.quantities if entry.value is None]
    mass = [entry for entry in known if entry.name == "mass"]
    places = [entry.value for entry in known if entry.name in {"cx", "cy", "cz"}]
    numbers = [(f"{pages.format_pair(one.value, one.std)} kg", "mass") for one in mass]
    if len(places) == len("xyz"):
        numbers.append((f"{math.hypot(*places):.3g} m", "from the link frame to the centre of mass"))
    numbers.append(pages.count_significant(known))
    page = _build_page(
        robot,
        f"payload on the link of joint {found.joint}",
        judge_payload(found),
        pages.draw_certainty(known),
        numbers=numbers,
        blocks=("== Payload ==", pages.tabulate_parameters(known), *pages.show_refused(lost)),
        notices=notices,
        next_step=("symid payload ... --for ur", "Print it as a controller takes it (ur, franka)"),
        conventions="in the frame that the robot file gives to the link; inertia about the centre of mass",
    )
    return pages.write_page(path, page)


def write_stiffness_page(path: Path, found: "StiffnessEstimate", notices: Sequence[Notice]) -> Path:
    """Write the page of joint stiffness and return the path; OutputError where it cannot be written."""
    known = [(entry, entry.stiffness, entry.interval) for entry in found.joints]
    told = [(entry, value, ends) for entry, value, ends in known if value is not None and ends is not None]
    level = "good" if len(told) == len(known) else "usable" if told else "doubtful"
    headline = f"The stiffness of {len(told)} of {len(known)} joints is identified."
    alignment, details = found.alignment, tuple(f"{entry.joint}: {entry.reason}." for entry in found.joints)
    marks = [
        Mark(
            f"{entry.joint} ({pages.write_unit(entry.unit)})", value, f"{value:.4g}: {low:.4g} to {high:.4g}"
        )
        for entry, value, (low, high) in told
    ]
    caption = "How stiff is each joint? Values with 95 % intervals."
    numbers = [
        (f"{len(told)} of {len(known)}", "joints with a stiffness"),
        (
            f"{pages.format_pair(1e3 * alignment.delay, 1e3 * alignment.delay_std)} ms",
            "link encoders after motors",
        ),
    ]
    if told:
        widest = max(0.5 * (high - low) / value for _, value, (low, high) in told)
        numbers.append((f"\N{PLUS-MINUS SIGN}{pages.format_percent(100.0 * widest)}", "widest 95 % interval"))
    page = _build_page(
        found.robot,
        "stiffness of joints",
        FitVerdict(level=level, headline=headline, details=details),
        (build_mark_figure(caption, "stiffness", marks),) if marks else (),
        numbers=numbers,
        blocks=("== Stiffness ==", *show_stiffness(found)[1:-1]),
        notices=notices,
        conventions="torsion is motor minus link position; a delay is positive where link encoders are late",
    )
    return pages.write_page(path, page)


def judge_comparison(found: "Sequence[Compared]") -> FitVerdict:
    """Return whether values agree within their deviations."""
    details, levels = [], set[str]()
    for entry in found:
        comparison, name = entry.comparison, entry.other.source.name
        if not comparison.judged:
            levels.add("usable")
            details.append(f"{name}: no deviations are stated, so agreement cannot be judged.")
            continue
        within = f"{comparison.count_within(2.0)} of {comparison.judged} groups within two deviations"
        bound = max(3.0, NormalDist().inv_cdf(1.0 - 0.5 * _CHANCE / comparison.judged))
        total = comparison.chi_square
        agrees = comparison.largest <= bound and (total is None or total.chance >= _CHANCE)
        levels.add("good" if agrees else "doubtful")
        chance = "" if total is None else f"; chi-square {total.value:.4g} over {total.freedom}"
        details.append(f"{name}: {within}, the largest difference {comparison.largest:.3g}{chance}.")
    headlines = {
        "doubtful": "The values differ by more than their standard deviations explain.",
        "usable": "The values cannot be compared in standard deviations.",
        "good": "The values agree within their standard deviations.",
    }
    level, headline = next(entry for entry in headlines.items() if entry[0] in levels)
    return FitVerdict(level=level, headline=headline, details=tuple(details))


def write_comparison_page(
    path: Path, ours: "EstimateSide", found: "Sequence[Compared]", notices: Sequence[Notice]
) -> Path:
    """Write the page of a comparison and return the path; OutputError where it cannot be written."""
    judged = sum(entry.comparison.judged for entry in found)
    within = sum(entry.comparison.count_within(2.0) for entry in found)
    largest = max(entry.comparison.largest for entry in found)
    numbers = [
        (f"{within} of {judged}", "groups within two standard deviations"),
        (pages.format_digits(largest), "standard deviations: the largest difference"),
    ]
    total = found[0].comparison.chi_square if len(found) == 1 else None
    if total is not None:
        numbers.append((f"{total.value:.4g} / {total.freedom}", "chi-square over its degrees of freedom"))
    figures = []
    for entry in found:
        values = [value for value in entry.values if math.isfinite(value.deviations)]
        values.sort(key=lambda value: -abs(value.deviations))
        if not values:
            continue
        beyond = sum(abs(value.deviations) > _FAR for value in values)
        marks = [
            Mark(value.group, abs(value.deviations), chosen=abs(value.deviations) > _FAR)
            for value in values[:_MOST_MARKS]
        ]
        rest = f" Shown are the {_MOST_MARKS} farthest." if len(values) > _MOST_MARKS else ""
        caption = (
            f"Which values differ? {beyond} of {len(values)} by more than three deviations from "
            f"{entry.other.source.name}, the dashed line.{rest}"
        )
        label = "difference, in standard deviations"
        figures.append(build_mark_figure(caption, label, marks, dense=True, limit=_FAR))
    page = _build_page(
        ours.identified.robot.name,
        "comparison of values",
        judge_comparison(found),
        figures,
        numbers=numbers,
        blocks=("== Values ==", *show_comparison(ours, found)),
        notices=notices,
        settings=(("ours", str(ours.source)), ("others", ", ".join(str(e.other.source) for e in found))),
    )
    return pages.write_page(path, page)
