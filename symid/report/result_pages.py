"""The pages of results that are no fits of robots: checked logs, trajectory, payload, stiffness, comparison.

Result -> `FitVerdict`, `Page`: the first screen has the verdict, three numbers and a figure; tables follow.

    check        good: all parameters identifiable and nothing odd; doubtful: a warning that makes values
                 wrong; wrong: the logs are not enough
    trajectory   good: every limit kept, condition number at most 100; usable: at most 1000
    payload      usable: a quantity is missing; doubtful: something else changed between the logs
    stiffness    usable: a joint is missing; doubtful: all are
    comparison   good: differences as chance makes them, at 1 %; doubtful: larger

And a bare element with hysteresis as text, figures and page; and what it predicts of another recording:

    energy of a cycle      work int y dx from one reversal to the next but one
    Masing's rule          branches after reversals, moved to one point and turned, are one (Masing 1926)
    first-order reversal   branches that begin at reversals of any size and end at the largest input

Not supported: reversal curves of a recording without a swing that grows or shrinks.
"""

import math
import os
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from itertools import chain, pairwise
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from symid import joint_models
from symid.arrays import FloatArray
from symid.errors import SEVERE, Notice, merge_notices
from symid.identification import hysteresis
from symid.identification.estimators import ParameterEstimate
from symid.report import pages, texts
from symid.report.blocks import (
    Block,
    Drawing,
    Table,
    format_digits,
    format_pair,
    format_percent,
    write_minus,
    write_unit,
)
from symid.report.drawings import draw_excitation, draw_log, draw_robot, list_shares
from symid.report.figures import TIME, Line, Mark, build_curve_figure, build_line_figure, build_mark_figure
from symid.report.texts import show_comparison, show_stiffness
from symid.report.verdict import LEVELS, FitVerdict, rate_output
from symid.robot import Robot, name_for_commands

if TYPE_CHECKING:
    from symid.dynamics import Payload
    from symid.excitation import OptimisedExcitation
    from symid.identification import Compared, EstimateSide
    from symid.identification.elastic import StiffnessEstimate
    from symid.identification.rigid import LogsCheck

_WELL, _ENOUGH = 100.0, 1000.0
"""Condition numbers of a column-scaled regressor up to which a trajectory is good, and usable."""
_CHANCE = 0.01
_FAR = 3.0
"""Deviations between the nearest body and least squares beyond which something else changed."""
_MOST_MARKS = 30
_SKIPPED = "The first {} samples do not count: no initial state explains them like the rest."
_HELD_OUT = "residual of the output in held-out parts of the recording"
_POOR = 0.5
"""Of its value: a deviation beyond it leaves not even the first digit."""
_NORMAL = 1.96
_FEW = 3
_FEWEST_POINTS, _PLACES = 8, 60
_NEAR_TOP = 0.1
"""Of the range of the input."""
_STARTS = {
    "zero": "at rest at input zero, moved to the first sample",
    "fresh": "at rest at the first sample",
    "below": "come to the first sample from below",
    "above": "come to the first sample from above",
}


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
    poor = () if found is None else found.list_names("poorly identifiable", "not identifiable")
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


def build_check_page(robot: Robot, checked: "LogsCheck") -> pages.Page:
    """Return the page of a robot file and its logs, checked."""
    numbers: list[tuple[str, str]] = []
    found, several = checked.excitation, "s"[: len(checked.logs) > 1]
    blocks: tuple[Block, ...] = texts.show_robot_check(robot, checked)
    if found is not None:
        good, values = len(found.list_names("identifiable")), np.array(found.singular)
        numbers = [
            (f"{good} of {len(found.parameters)}", "parameters identifiable"),
            (format_digits(found.condition), "condition number (column-scaled)"),
        ]
        title = "What a fit to all these logs would identify."
        blocks = (
            "== Identifiability ==",
            texts.show_identifiable(found, "expected std", format_percent, title),
            build_line_figure(
                "How well are the parameters separated? Singular values of the scaled regressor; "
                f"the rank is {found.rank} of {len(found.singular)}.",
                ("number", "singular value"),
                [Line("singular value", "first", np.arange(1.0, len(values) + 1.0), values, markers=True)],
                logarithmic=bool(np.any(values > 0.0)),
                whole=True,
            ),
            "== Joints ==",
            *(texts.show_joints(entry.recording.source, entry.joints) for entry in checked.logs),
        )
    length = sum(entry.timing.duration for entry in checked.logs)
    numbers.append((f"{length:.4g} s", f"in {len(checked.logs)} log{several}"))
    sources = (entry.recording.source for entry in checked.logs)
    # The source of a recording in memory is any text.
    files = dict.fromkeys(source if os.path.isfile(source) else "LOG" for source in sources)  # noqa: PTH113
    command = ("symid", "identify", name_for_commands(robot), *files)
    return _build_page(
        robot.name,
        "check of logs" if checked.logs else "check of a robot file",
        judge_check(checked),
        draw_check(robot, checked),
        numbers=numbers if checked.logs else (),
        blocks=blocks,
        notices=(*robot.notices, *checked.notices),
        next_step=(shlex.join(command), "Identify the parameters") if checked.logs else None,
        settings=(("robot", texts.summarise_robot(robot)), ("file", str(robot.path))),
    )


def build_excitation_page(robot: Robot, found: "OptimisedExcitation") -> pages.Page:
    """Return the page of an optimised trajectory."""
    shares = list_shares(found.margins)
    kept = all(entry.kept for entry in found.margins)
    level = "good" if found.condition <= _WELL else "usable" if found.condition <= _ENOUGH else "doubtful"
    said = "All limits are kept" if kept else "A limit is exceeded"
    headline = f"{said}; the condition number is {found.condition:.4g}, "
    headline += f"{texts.describe_gain(found.factor)} than that of the best random trajectory."
    name, most = max(shares, key=lambda entry: entry[1], default=("no limit", 0.0))
    rows = [(run.start, run.condition, run.iterations, run.status) for run in found.runs]
    title = "The search from every start, the best first."
    starts = Table(("start", "condition", "iterations", "status"), rows, (3,), title)
    return _build_page(
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
            (format_percent(100.0 * most), f"of a limit used at most: {name}"),
            (f"{found.trajectory.duration:g} s", "period"),
        ),
        blocks=("== Limits and condition ==", *texts.show_excitation(found)),
        more=("== Search ==", starts),
        notices=found.notices,
        next_step=(
            f"symid simulate {shlex.quote(name_for_commands(robot))} --trajectory TRAJECTORY -o log.npz",
            "Simulate a log of it, or run it on the robot",
        ),
    )


def judge_payload(found: "Payload") -> FitVerdict:
    """Return what an identified payload is worth."""
    lost = [entry.name for entry in found.quantities if entry.value is None]
    friction = [entry.name for entry in found.friction]
    changed = found.moved > _FAR or bool(found.unexplained and found.doubtful)
    known, whole = len(found.quantities) - len(lost), len(found.quantities)
    lists = (("Not identifiable", lost), ("Friction changed", friction))
    return FitVerdict(
        level="doubtful" if changed else "usable" if lost else "good",
        headline=f"{known} of {whole} quantities of the payload are identified."
        + " But something else than a payload changed between the logs." * changed,
        details=(
            f"chi-square {found.chi2:.3g} over {found.freedom} degrees of freedom.",
            *(f"{what}: {', '.join(names)}." for what, names in lists if names),
        ),
    )


def build_payload_page(robot: str, found: "Payload", notices: Sequence[Notice]) -> pages.Page:
    """Return the page of a payload."""
    known = [
        ParameterEstimate(name=e.name, value=e.value, std=math.inf if e.std is None else e.std, unit=e.unit)
        for e in found.quantities
        if e.value is not None
    ]
    lost = [(entry.name, entry.reason) for entry in found.quantities if entry.value is None]
    mass = [entry for entry in known if entry.name == "mass"]
    places = [entry.value for entry in known if entry.name in {"cx", "cy", "cz"}]
    numbers = [(f"{format_pair(one.value, one.std)} kg", "mass") for one in mass]
    if len(places) == len("xyz"):
        numbers.append((f"{math.hypot(*places):.3g} m", "from the link frame to the centre of mass"))
    numbers.append(pages.count_significant(known))
    return _build_page(
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


def build_stiffness_page(found: "StiffnessEstimate", notices: Sequence[Notice]) -> pages.Page:
    """Return the page of joint stiffness."""
    known = [(entry, entry.stiffness, entry.interval) for entry in found.joints]
    told = [(entry, value, ends) for entry, value, ends in known if value is not None and ends is not None]
    level = "good" if len(told) == len(known) else "usable" if told else "doubtful"
    headline = f"The stiffness of {len(told)} of {len(known)} joints is identified."
    alignment, details = found.alignment, tuple(f"{entry.joint}: {entry.reason}." for entry in found.joints)
    marks = [
        Mark(f"{e.joint} ({write_unit(e.unit)})", value, f"{value:.4g}: {low:.4g} to {high:.4g}")
        for e, value, (low, high) in told
    ]
    caption = "How stiff is each joint? Values with 95 % intervals."
    delay = format_pair(1e3 * alignment.delay, 1e3 * alignment.delay_std)
    numbers = [
        (f"{len(told)} of {len(known)}", "joints with a stiffness"),
        (f"{delay} ms", "link encoders after motors"),
    ]
    if told:
        widest = max(0.5 * (high - low) / value for _, value, (low, high) in told)
        numbers.append((f"\N{PLUS-MINUS SIGN}{format_percent(100.0 * widest)}", "widest 95 % interval"))
    return _build_page(
        found.robot,
        "stiffness of joints",
        FitVerdict(level=level, headline=headline, details=details),
        (build_mark_figure(caption, "stiffness", marks),) if marks else (),
        numbers=numbers,
        blocks=("== Stiffness ==", *show_stiffness(found)[1:-1]),
        notices=notices,
        conventions="torsion is motor minus link position; a delay is positive where link encoders are late",
    )


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


def build_comparison_page(
    ours: "EstimateSide", found: "Sequence[Compared]", notices: Sequence[Notice]
) -> pages.Page:
    """Return the page of a comparison."""
    judged = sum(entry.comparison.judged for entry in found)
    within = sum(entry.comparison.count_within(2.0) for entry in found)
    largest = max(entry.comparison.largest for entry in found)
    numbers = [
        (f"{within} of {judged}", "groups within two standard deviations"),
        (format_digits(largest), "standard deviations: the largest difference"),
    ]
    total = found[0].comparison.chi_square if len(found) == 1 else None
    if total is not None:
        numbers.append((f"{total.value:.4g} / {total.freedom}", "chi-square over its degrees of freedom"))
    figures = []
    for entry in found:
        away = [(value.group, abs(value.deviations)) for value in entry.values]
        marks = [Mark(name, size, chosen=size > _FAR) for name, size in away if math.isfinite(size)]
        marks.sort(key=lambda mark: -mark.value)
        if not marks:
            continue
        beyond = sum(mark.chosen for mark in marks)
        rest = f" Shown are the {_MOST_MARKS} farthest." if len(marks) > _MOST_MARKS else ""
        caption = f"Which values differ? {beyond} of {len(marks)} by more than three deviations from "
        caption += f"{entry.other.source.name}, the dashed line.{rest}"
        label, shown = "difference, in standard deviations", marks[:_MOST_MARKS]
        figures.append(build_mark_figure(caption, label, shown, dense=True, limit=_FAR))
    return _build_page(
        ours.identified.robot.name,
        "comparison of values",
        judge_comparison(found),
        figures,
        numbers=numbers,
        blocks=("== Values ==", *show_comparison(ours, found)),
        notices=notices,
        settings=(("ours", str(ours.source)), ("others", ", ".join(str(e.other.source) for e in found))),
    )


def judge_element(record: hysteresis.HysteresisRecord) -> FitVerdict:
    """Return what an element is worth, from what it predicts of samples that were left out.

    What it does not show after reversals is not tested; it counts one class milder than what is left.
    """
    back = 100.0 * hysteresis.measure_return(record.trace.position)
    last = record.last_quarter
    left = rate_output(max(record.held_out, last))
    unseen = {"wrong": "doubtful", "doubtful": "usable"}.get(rate_output(100.0 - back), "good")
    spread = [entry for entry in record.parameters if entry.deviation > 0.0]
    vague = 2 * sum(entry.deviation > abs(entry.value) for entry in spread) > len(spread)
    level = min(left, unseen, "usable" if vague else "good", key=LEVELS.index)
    headline = f"{record.model} with {record.candidates[0].count} parameters: residual {record.fitted:.3g} % "
    headline += f"of the output, {record.held_out:.3g} % on held-out data."
    if last > record.held_out:
        headline += f" Of the last quarter, predicted from the rest: {last:.3g} %."
    if vague:
        headline += " Most standard deviations exceed their values."
    if unseen != "good":
        way = f"goes back over only {back:.3g} % of its range" if back else "never turns back"
        headline += f" But the input {way}: what follows a reversal is not tested."
    untimed = "No time was given: models that depend on the speed were not tried."
    remedy = "Record a motion that goes back and forth over the whole range."
    if left in {"doubtful", "wrong"}:
        remedy = "Plot output against input, and check columns, signs and units."
    return FitVerdict(
        level=level,
        headline=headline,
        details=(
            "Cross-validation over six parts of the recording.",
            *([_SKIPPED.format(record.skipped)] if record.skipped else []),
            *([] if record.timed else [untimed]),
        ),
        remedy="" if level in {"good", "usable"} else remedy,
    )


def judge_element_trial(trial: hysteresis.HysteresisTrial) -> FitVerdict:
    """Return what an element predicts of another recording."""
    headline = f"The residual is {trial.error:.3g} % of the output of this recording (means removed)."
    details = [_SKIPPED.format(trial.skipped)] if trial.skipped else []
    if trial.beyond > 0.0:
        share = f"{100.0 * trial.beyond:.3g} % of its samples"
        details.append(f"{share} lie beyond the input of the fit, where the element extrapolates.")
    if trial.inverse is not None:
        details.append(f"The error of the inverse is {trial.inverse:.3g} % of the input.")
    return FitVerdict(level=rate_output(trial.error), headline=headline, details=tuple(details))


def show_element(record: hysteresis.HysteresisRecord) -> tuple[Block, ...]:
    """Return the tables and sentences on an element."""
    shown = [entry for entry in record.parameters if not entry.name.endswith("least")]
    poor = [entry.name for entry in shown if entry.deviation > _POOR * abs(entry.value)]
    rows = []
    for entry in (one for one in shown if one.deviation > 0.0 and one.name not in poor):
        low, high = (entry.value + side * _NORMAL * entry.deviation for side in (-1.0, 1.0))
        unit = (joint_models.write_value_unit(entry.name, record.units),) if all(record.units) else ()
        numbers = (f"{entry.value:.5g}", f"{entry.deviation:.2g}", f"{low:.5g} to {high:.5g}")
        rows.append((entry.name, *numbers, *unit))
    fixed = [f"{entry.name} = {entry.value:g}" for entry in shown if not entry.deviation and entry.value]
    lists = (("Poorly identifiable, not shown", poor), ("Fixed", fixed))
    note = "\n".join(f"{head}: {', '.join(names)}." for head, names in lists if names)
    form = f" ({record.form})" if record.form else ""
    header: tuple[str, ...] = ("parameter", "value", "std", "95 % interval")
    header += ("unit",) if all(record.units) else ()
    table = Table(header, rows, title=f"{record.model}{form}", note=note)
    models = []
    for one in record.candidates:
        errors = (f"{one.fitted:.3g}", format_pair(one.held_out, one.spread))
        models.append((one.model, one.form, one.count, ("no", "yes")[one.passive], *errors))
    header = ("model", "form", "parameters", "passive", "fitted %", "held out %")
    tried = Table(header, models, (0, 1, 3), "Models that were tried", picked=0)
    reason = hysteresis.describe_inversion(record)
    inverse = f"There is none: {reason}." if reason else "It exists, for every output."
    passive = "no motion gets" if record.passive else "some motions may get"
    facts = f"Inverse: {inverse}\nPassivity: {passive} work out of the element.\nStart: "
    facts += f"{_STARTS[record.start]}."
    return (table, tried, facts)


def draw_element(record: hysteresis.HysteresisRecord) -> tuple[Drawing, ...]:
    """Return the figures of an element: loops, time, residuals, energy of cycles, branches."""
    labels, begun = _label_axes(record), -(-len(record.trace.time) * record.skipped // record.samples)
    # What does not count is not drawn.
    trace = hysteresis.ElementTrace(
        **{entry.name: getattr(record.trace, entry.name)[begun:] for entry in fields(record.trace)}
    )
    # Wide, so that it shows on both sides of the line that follows it.
    loops = [
        Line("measured", "wide", trace.position, trace.measured),
        Line("predicted", "predicted", trace.position, trace.predicted),
    ]
    curves = (("measured", trace.measured), ("predicted", trace.predicted))
    over_time = [Line(name, name, trace.time, y) for name, y in curves]
    error, (unit, own) = trace.measured - trace.predicted, record.units
    left = f"residual ({own or 'unit of the file'})"
    time, worst = TIME if record.timed else "sample", int(np.argmax(np.abs(error)))
    since = trace.time[worst] - trace.time[0]
    time_of_worst = f"{since:.4g} s" if record.timed else f"sample {trace.time[worst]:.0f}"
    first, last = (float(np.mean(part)) for part in np.array_split(error, 2))
    size = float(np.sqrt(np.mean(error**2)))
    drift = 100.0 * abs(last - first) / size if size else 0.0
    moved = f"Does it drift? From half to half the mean residual changes by {drift:.2g} % of its rms."
    caption = f"Output against input: does {record.model} follow the loops? Residual "
    caption += f"{format_percent(record.fitted)} of the output."
    place = f"{write_minus(f'{trace.position[worst]:.3g}')} {unit}".rstrip()
    where = f"Does the model miss at some inputs? Most at {place}."

    def draw_cloud(caption: str, label: str, x: FloatArray) -> Drawing:
        line = Line("residual", "cloud", x, error, joined=False)
        return build_curve_figure(caption, (label, left), [line], height=230.0)

    drawn = [
        build_curve_figure(caption, labels, loops),
        draw_cloud(where, labels[0], trace.position),
        build_line_figure(f"When does it miss? Most at {time_of_worst}.", (time, labels[1]), over_time),
        build_line_figure(moved, (time, left), [Line("residual", "residual", trace.time, error)]),
    ]
    if record.timed:
        rate = np.gradient(trace.position, trace.time)
        fast = np.abs(rate) > np.median(np.abs(rate))
        slow = float(np.mean(np.abs(error[~fast])))
        ratio = float(np.mean(np.abs(error[fast]))) / slow if fast.any() and slow else 1.0
        text = f"Does it depend on the speed? Fast samples miss {ratio:.2g} times as much as slow ones."
        rates = f"rate of {record.names[0]} ({record.units[0] or 'unit of the file'}/s)"
        drawn.append(draw_cloud(text, rates, rate))
    return (*drawn, *_draw_cycles(record), *_draw_branches(record))


def _label_axes(record: hysteresis.HysteresisRecord) -> tuple[str, str]:
    x, y = (
        f"{name} ({unit or 'unit of the file'})"
        for name, unit in zip(record.names, record.units, strict=True)
    )
    return x, y


def compute_cycles(trace: hysteresis.ElementTrace) -> FloatArray:
    """Return width, measured and predicted work (c, 3) of all cycles, from a reversal to the next but one."""
    strokes = hysteresis.find_strokes(trace.position)[1:-1]
    rows = []
    for (low, _), (_, high) in pairwise(strokes):
        part = slice(max(low - 1, 0), high)
        x, curves = trace.position[part], np.stack((trace.measured[part], trace.predicted[part]))
        # What the ends leave open is no loop: closed by the straight line between them.
        gap = 0.5 * (x[0] - x[-1]) * (curves[:, 0] + curves[:, -1])
        rows.append((np.ptp(x), *(scipy.integrate.trapezoid(curves, x) + gap)))
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _draw_cycles(record: hysteresis.HysteresisRecord) -> Iterator[Drawing]:
    cycles, (x, y) = compute_cycles(record.trace), record.units
    if len(cycles) < _FEW:
        return
    width, measured, predicted = cycles.T
    left = float(np.sqrt(np.mean((measured - predicted) ** 2)) / np.sqrt(np.mean(measured**2)))
    curves = (("measured", "link", measured), ("predicted", "predicted", predicted))
    yield build_curve_figure(
        f"Is the lost energy right? Work of a cycle against its width: rms error {100.0 * left:.2g} %.",
        (
            f"width of the cycle ({x or 'unit of the input'})",
            f"work ({f'{y} {x}' if x and y else 'units of input and output'})",
        ),
        [Line(name, style, width, y, markers=True, joined=False) for name, style, y in curves],
        height=260.0,
    )


def _draw_branches(record: hysteresis.HysteresisRecord) -> Iterator[Drawing]:
    """Yield branches after reversals moved to one point, and first-order reversal curves."""
    trace, (name, _), (unit, _) = record.trace, record.names, record.units
    strokes = hysteresis.find_strokes(trace.position)[1:-1]
    parts = [slice(low, high) for low, high in strokes if high - low >= _FEWEST_POINTS]
    if len(parts) < _FEW:
        return
    moved = []
    for part in parts:
        x, y = trace.position[part], trace.measured[part]
        side = 1.0 if x[-1] > x[0] else -1.0
        way, style = ("upwards", "link") if side > 0.0 else ("downwards", "final")
        moved.append(Line(way, style, side * (x - x[0]), side * (y - y[0])))
    # The rms of the branches about their mean curve, over the rms of that, where several have points.
    places = np.linspace(0.0, max(float(line.x[-1]) for line in moved), _PLACES)
    courses = (np.interp(places, np.maximum.accumulate(line.x), line.y) for line in moved)
    rows = np.array([np.where(places <= e.x.max(), y, np.nan) for e, y in zip(moved, courses, strict=True)])
    rows = rows[:, np.sum(np.isfinite(rows), axis=0) >= _FEW]
    mean = np.nanmean(rows, axis=0)
    size = float(np.sqrt(np.mean(mean**2))) if mean.size else 0.0
    spread = float(np.sqrt(np.nanmean((rows - mean) ** 2))) / size if size else 0.0
    yield build_curve_figure(
        "Masing's rule? Measured branches after reversals, moved to one point, those downwards turned: "
        f"{100.0 * spread:.2g} % of their rms is scatter.",
        (
            f"change of {name} since the reversal ({unit or 'unit of the file'})",
            f"change of {_label_axes(record)[1]}",
        ),
        moved,
        height=300.0,
    )
    top = float(trace.position.max()) - _NEAR_TOP * float(np.ptp(trace.position))
    curves = [part for part in parts if trace.position[part][-1] >= top]
    begins = [float(trace.position[part][0]) for part in curves]
    if len(curves) < _FEW or float(np.ptp(begins)) < _NEAR_TOP * float(np.ptp(trace.position)):
        return
    yield build_curve_figure(
        "First-order reversal curves: do they meet? Upward branches from reversals to the largest input.",
        _label_axes(record),
        [
            *(Line("measured", "cloud", trace.position[p], trace.measured[p], joined=False) for p in curves),
            *(Line("predicted", "predicted", trace.position[p], trace.predicted[p]) for p in curves),
        ],
        height=300.0,
    )


def build_element_page(record: hysteresis.HysteresisRecord, *, source: str = "") -> pages.Page:
    """Return the page of an element."""
    lead, below, *further = draw_element(record)
    table, tried, facts = show_element(record)
    free = [one for one in record.parameters if one.deviation > 0.0 and not one.name.endswith("least")]
    known = [entry for entry in free if entry.deviation <= _POOR * abs(entry.value)]
    (x, y), (unit, own) = record.names, record.units
    units = (unit or f"[{x}]", own or f"[{y}]")
    parameters = [
        ParameterEstimate(
            name=entry.name,
            value=entry.value,
            std=entry.deviation,
            unit=joint_models.write_value_unit(entry.name, units),
            reason=joint_models.describe_value(entry.name)[1],
        )
        for entry in known
    ]
    told = table if isinstance(table, Table) else Table((), ())
    words = ("--input", x, "--output", y)
    return _build_page(
        source or "element",
        "element with hysteresis",
        judge_element(record),
        (lead,),
        numbers=(
            (f"{record.held_out:.3g} %", _HELD_OUT),
            (f"{record.fitted:.3g} %", "in the fit itself"),
            (f"{len(known)} of {len(free)}", "parameters with a std of at most half their value"),
        ),
        next_step=(
            f"symid hysteresis {shlex.quote(source or 'FIT')} {shlex.join(words)} --validate FILE",
            "Test it on another recording",
        ),
        second=below,
        blocks=(
            "== Over time, cycles and branches ==",
            *further,
            "== Parameters ==",
            replace(pages.tabulate_parameters(parameters, formulas=False), title=told.title),
            *pages.draw_certainty(parameters),
            *filter(None, (told.note, str(facts))),
        ),
        more=("== Models that were tried ==", tried),
        settings=(
            ("model", record.model),
            ("samples", str(record.samples)),
            (record.names[0], f"{record.span[0]:g} to {record.span[1]:g} {record.units[0]}".rstrip()),
        ),
        conventions="work is that done on the element: output times change of the input",
        units="Units are those of the file",
    )
