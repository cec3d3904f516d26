"""What a fit is tested by: held-out logs, a diagnosis, values of others, as text and as objects.

`RigidValidation`, `ElasticValidation`, `FrictionValidation`, `Diagnosis`, `Compared` -> blocks,
dictionaries, figures for a notebook, warnings.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.environment import show_path
from symid.errors import Notice
from symid.identification import (
    AnyValidation,
    ElasticValidation,
    FrictionValidation,
    RigidValidation,
    TrackingComparison,
)
from symid.identification.elastic import ElasticTrial
from symid.report.blocks import Block, Drawing, Table, select_fields
from symid.report.elastic_page import draw_loops
from symid.report.fit_text import (
    describe_alignment,
    describe_band,
    describe_residual,
    describe_validation,
    show_band,
    show_residual,
)
from symid.report.identification_page import draw_prediction
from symid.robot import Robot

if TYPE_CHECKING:
    from symid.dynamics import OpenReading
    from symid.identification import Compared, EstimateSide
    from symid.identification.rigid import Diagnosis, TriedReading


def show_trial(found: AnyValidation) -> tuple[Block, ...]:
    """Return a headline, and tables of residuals."""
    match found:
        case RigidValidation():
            return _show_rigid(found)
        case FrictionValidation():
            return _show_friction(found)
        case ElasticValidation():
            followed = () if found.tracking is None else _show_tracking(found.robot, found.tracking)
            return (*_show_elastic(found.robot, found.trial), *followed)


def describe_trial(found: AnyValidation) -> dict[str, object]:
    """Return the trial as `symid validate --json` gives it, but for the gate."""
    match found:
        case RigidValidation():
            return {
                **describe_validation(found.validation),
                **({} if found.band is None else {"band": describe_band(found.band)}),
                "processing": {**asdict(found.settled.processing), "origin": dict(found.settled.origin)},
            }
        case FrictionValidation():
            return {**describe_validation(found.validation), "laws": dict(found.laws)}
        case ElasticValidation():
            return _describe_elastic(found)


def draw_trial(found: AnyValidation) -> tuple[Drawing, ...]:
    """Return measured and predicted torques against time; of elastic joints torque over torsion."""
    if isinstance(found, ElasticValidation):
        return tuple(
            Drawing(draw_loops(entry), f"{entry.joint}: joint torque over torsion")
            for entry in found.trial.joints
        )
    validation = found.validation
    return tuple(
        Drawing(draw_prediction(series, validation.rows), f"{series.joint}: measured and predicted")
        for series in validation.series
    )


def _show_rigid(found: RigidValidation) -> tuple[Block, ...]:
    """Return the headline with the processing, and the table of residuals."""
    kind = " (joints taken as rigid)" if any(found.robot.elastic) else ""
    within = "" if found.band is None else f" within {found.band.band:g} Hz"
    headline = (
        f"{found.robot.name}{kind} on {found.validation.source}{within}: mean relative residual "
        f"{found.mean_relative_percent:.4f} %"
    )
    table = show_residual(found.validation.residual) if found.band is None else show_band(found.band)
    return (f"{headline}\n{found.settled.tell()}", table)


def _show_friction(found: FrictionValidation) -> tuple[Block, ...]:
    """Return the headline, and the table of residuals with the laws."""
    validation = found.validation
    rows = [
        [
            entry.joint,
            found.laws[entry.joint],
            f"{entry.relative_percent:.4f}",
            entry.std,
            entry.unit,
            entry.samples,
        ]
        for entry in validation.residual
    ]
    head = (
        f"{found.robot.name}, friction and rigid part on {validation.source}: mean relative residual "
        f"{validation.mean_relative_percent:.4f} %"
    )
    return (head, Table(("joint", "law", "relative/%", "RMS", "unit", "rows"), rows, left=(0, 1, 4)))


def _show_elastic(robot: Robot, trial: ElasticTrial) -> tuple[Block, ...]:
    mean = trial.mean_relative_percent
    head = (
        f"{robot.name} on {trial.source}: mean relative residual {mean:.4f} %, by motors and links together"
    )
    if trial.means[1:]:
        head += f"; with the springs {max(trial.means[1:]):.4f} %"
    blocks: list[Block] = [head]
    for caption, entries in trial.residuals:
        blocks += [caption, show_residual(entries)]
    lacking = [joint.joint for joint in trial.joints if joint.final is None]
    if lacking:
        blocks.append(
            f"The estimate has no spring of {', '.join(lacking)}; what it would say of the log is not known, "
            "and the gate says nothing of it."
        )
    return tuple(blocks)


def _list_joints(robot: Robot) -> tuple[list[str], list[str]]:
    """Return the names of the joints, and the units of their positions."""
    units = ["m" if joint.kind.value == "prismatic" else "rad" for joint in robot.axes]
    return [joint.name for joint in robot.axes], units


def _show_tracking(robot: Robot, tracking: TrackingComparison) -> tuple[Block, ...]:
    """Return the table of tracking errors, root mean square and peak of each joint."""
    rows = [
        [joint, run.name, 1e3 * float(run.rms[index]), 1e3 * float(run.peak[index]), f"m{unit}"]
        for index, (joint, unit) in enumerate(zip(*_list_joints(robot), strict=True))
        for run in tracking.runs
    ]
    head = (
        f"How links follow {tracking.trajectory.source}: closed loop on the values of the robot file, which "
        "the feed-forward does not know. The rigid one has dynamics and friction of Case 1."
    )
    header = ("joint", "feed-forward", "rms", "peak", "unit")
    return (head, Table(header, rows, left=(0, 1, 4)))


def _describe_elastic(found: ElasticValidation) -> dict[str, object]:
    trial, (joints, _) = found.trial, _list_joints(found.robot)
    return {
        "robot": found.estimate.robot,
        "method": found.estimate.method,
        "log": trial.source,
        "samples": len(trial.joints[0].time),
        "residual": describe_residual(trial.residuals[0][1]),
        "mean_relative_percent": trial.mean_relative_percent,
        "tables": [
            {"caption": caption, "residual": describe_residual(entries), "mean_relative_percent": mean}
            for (caption, entries), mean in zip(trial.residuals, trial.means, strict=True)
        ],
        "alignment": None if found.alignment is None else describe_alignment(found.alignment, joints),
        "tracking": None if found.tracking is None else _describe_tracking(found.robot, found.tracking),
    }


def _describe_tracking(robot: Robot, tracking: TrackingComparison) -> dict[str, object]:
    joints: tuple[Sequence[str], Sequence[str]] = _list_joints(robot)
    return {
        "trajectory": tracking.trajectory.source,
        "duration": tracking.trajectory.duration,
        "seed": tracking.seed,
        "runs": [
            {
                "feed_forward": run.name,
                "method": tracking.methods.get(run.name),
                "joints": [
                    {"joint": joint, "rms": rms, "peak": peak, "unit": unit}
                    for joint, unit, rms, peak in zip(
                        *joints, run.rms.tolist(), run.peak.tolist(), strict=True
                    )
                ],
            }
            for run in tracking.runs
        ],
    }


def describe_diagnosis(diagnosis: "Diagnosis") -> dict[str, object]:
    """Return the diagnosis as `symid report --diagnose --json` gives it."""
    essential, bootstrap, drift = diagnosis.essential, diagnosis.bootstrap, diagnosis.drift
    spread = zip(bootstrap.names, bootstrap.deviations, bootstrap.low, bootstrap.high, strict=True)
    dropped, changed = "name deviations=ratio price_percent", "name values stds=deviations chance"
    return {
        **select_fields(diagnosis, "singular_values=singular rank"),
        "refit": None if diagnosis.refit is None else {"largest_difference_stds": diagnosis.refit},
        "correlated": [
            {"parameters": [first, second], "correlation": value}
            for first, second, value in diagnosis.correlated
        ],
        "essential": {
            **select_fields(essential, "kept price_percent"),
            "dropped": [select_fields(entry, dropped) for entry in essential.dropped],
        },
        "bootstrap": {
            **select_fields(bootstrap, "blocks replicates"),
            "parameters": [
                {"name": name, "std": float(std), "low": float(low), "high": float(high)}
                for name, std, low, high in spread
            ],
        },
        "drift": {
            "compared": drift.compared,
            "changed": [select_fields(entry, changed) for entry in drift.changed],
        },
        "structure": [
            select_fields(entry, "joint follows=family share_percent rms unit advice")
            for entry in diagnosis.structure
        ],
        "prices": [select_fields(entry, "what of percent") for entry in diagnosis.prices],
    }


def show_diagnosis(diagnosis: "Diagnosis") -> tuple[Block, ...]:
    """Return the diagnosis in a few sentences and a table of what the residual follows."""
    essential, drift = diagnosis.essential, diagnosis.drift
    whole = len(essential.kept) + len(essential.dropped)
    needed = (
        f"{len(essential.kept)} of {whole} parameters are essential; without the others the residual grows "
        f"by {essential.price_percent:.2g} %"
    )
    lines = [f"{diagnosis.rank} of {len(diagnosis.singular)} directions are seen", needed]
    if diagnosis.refit is not None:
        lines.append(f"fitted again, the logs give the estimate to {diagnosis.refit:.1g} standard deviations")
    if len(drift.runs) > 1:
        lines.append(f"{len(drift.changed)} of {drift.compared} parameters differ between the logs")
    lines += [f"price of {entry.what}: {entry.percent:+.3g} % {entry.of}" for entry in diagnosis.prices]
    if diagnosis.structure:
        rows = [
            [entry.joint, entry.family, f"{entry.share_percent:.3g}", entry.rms, entry.unit]
            for entry in diagnosis.structure
        ]
        table = Table(("joint", "residual follows", "share/%", "rms", "unit"), rows, left=(0, 1, 4))
        return ("\n".join(lines), table)
    return ("\n".join(lines),)


_WIDTH = 44
_TINY = 1e-12
_TOO_SURE = 0.999
_LIMITS = ((2.0, 0.9545), (3.0, 0.9973))
"""Numbers of deviations, and the share of normal errors within them."""


def show_comparison(ours: "EstimateSide", others: Sequence["Compared"]) -> tuple[Block, ...]:
    """Return for each other the table, counts, chi-square, the largest differences; others stand apart."""
    first, *rest = (_show_compared(ours, found) for found in others)
    return (*first, *(part for (head, *parts) in rest for part in (f"\n{head}", *parts)))


def _show_compared(ours: "EstimateSide", found: "Compared") -> tuple[Block, ...]:
    other, comparison = found.other, found.comparison
    columns = "" if other.columns is None else f", column {other.columns.value!r}"
    read = any(entry.read_as for entry in found.groups)
    rows = [
        [
            _shorten(value.group),
            _format_value(value.theirs),
            _format_value(value.theirs_std),
            _format_value(value.ours),
            _format_value(value.ours_std),
            _format_value(value.deviations, _choose_form(value.deviations, "+.2f")),
            *([_shorten(value.read_as)] if read else []),
        ]
        for value in found.values
    ]
    header = ["group", "other", "std", "ours", "std", "in std", *(["read as"] if read else [])]
    farthest = [_describe_difference(found, k) for k in comparison.list_farthest()]
    return (
        f"{ours.identified.robot.name}: {show_path(ours.source)} beside {show_path(other.source)}{columns}",
        Table(header, rows, left=(0, 6)),
        "\n".join(_summarise_agreement(found)),
        *(["largest differences\n" + "\n".join(f"  {text}" for text in farthest)] if farthest else []),
        "\n".join(_list_left_out(found)),
    )


def _shorten(text: str) -> str:
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}..."


def _format_value(value: float, form: str = ".5g") -> str:
    return format(value, form) if _is_known(value) else "-"


def _choose_form(value: float, form: str) -> str:
    """Return the form of a number of deviations: beyond a hundred thousand its size is enough."""
    return form if abs(value) < 1e5 else "+.2e" if form.startswith("+") else ".2e"


def _format_deviations(value: float) -> str:
    return format(abs(value), _choose_form(value, ".1f"))


def _is_known(value: float) -> bool:
    # NaN, what is not known, is not itself.
    return bool(value == value)  # noqa: PLR0124


def _summarise_agreement(found: "Compared") -> list[str]:
    """Return how many groups agree, and chi-square."""
    comparison = found.comparison
    judged = comparison.judged
    if not judged:
        return ["no deviation is known on either side: nothing can be judged"]
    counts = [
        f"{comparison.count_within(limit)} of {judged} within {limit:g} deviations "
        f"({share * judged:.0f} expected)"
        for limit, share in _LIMITS
    ]
    lines = [", ".join(counts)]
    total = comparison.chi_square
    if total is None:
        return [*lines, "no chi-square: the covariances make some combination exact"]
    text = f"chi-square {_format_deviations(total.value)} over {total.freedom} groups"
    if found.other.shared:
        text += "; with logs in common it has no probability"
    else:
        text += (
            f", probability {total.chance:.2g}" if total.chance > _TINY else f", probability below {_TINY:g}"
        )
        if total.chance > _TOO_SURE:
            text += "; that is less than independent errors give: both may come from the same log"
    if total.stretch > 1.0:
        text += f"; it would be as expected with deviations {total.stretch:.2g} times as large"
    return [*lines, text]


def _describe_difference(found: "Compared", place: int) -> str:
    """Return a difference in words."""
    comparison = found.comparison
    away = float(comparison.deviations[place])
    ours, theirs = float(comparison.ours.values[place]), float(comparison.theirs.values[place])
    share = f" ({100.0 * (ours - theirs) / abs(theirs):+.3g} %)" if theirs else ""
    side = "above" if away > 0 else "below"
    return (
        f"{_shorten(found.groups[place].text)}: ours {ours:.4g} is {_format_deviations(away)} deviations "
        f"{side} the other's {theirs:.4g}{share}"
    )


def _list_left_out(found: "Compared") -> list[str]:
    """Return what one side has and the other has not."""
    lines = []
    if found.absent:
        lines.append(f"ours, not in the other: {', '.join(found.absent)}")
    if found.neither:
        lines.append(f"in neither: {', '.join(found.neither)}")
    if found.lacking > 0:
        lines.append(f"besides, {found.lacking} combinations of ours are not told by the other")
    else:
        with_these = " with these" if found.absent or found.neither else ""
        lines.append(f"the groups of the other{with_these} span all base parameters, exactly")
    if found.not_ours:
        lines.append(f"the other's, refused in ours: {', '.join(found.not_ours)}")
    if found.other.strange:
        lines.append(f"the other's, of another model: {', '.join(found.other.strange)}")
    return lines


def describe_comparison(
    ours: "EstimateSide", others: Sequence["Compared"], gate: float | None, *, accepted: bool
) -> dict[str, object]:
    """Return the comparison as `symid compare --json` gives it."""
    return {
        "robot": ours.identified.robot.name,
        "estimate": show_path(ours.source),
        "others": [_describe_compared(found) for found in others],
        "gate": gate,
        "accepted": accepted,
    }


def _describe_compared(found: "Compared") -> dict[str, object]:
    comparison, other = found.comparison, found.other
    total = comparison.chi_square
    sides = "other=theirs other_std=theirs_std ours ours_std difference deviations"
    chance = None if total is None or other.shared else total.chance
    columns = other.columns
    return {
        "source": show_path(other.source),
        "columns": None if columns is None else select_fields(columns, "name value deviation percent"),
        "groups": [
            {
                **select_fields(value, f"group unit {sides}"),
                "line": value.line or None,
                "read_as": value.read_as or None,
            }
            for value in found.values
        ],
        "judged": comparison.judged,
        "within": {f"{limit:g}": comparison.count_within(limit) for limit, _ in _LIMITS},
        "largest": comparison.largest,
        "chi_square": None
        if total is None
        else {**select_fields(total, "value freedom"), "probability": chance},
        **select_fields(found, "absent neither lacking not_ours"),
        **select_fields(other, "other_model=strange shared_logs=shared"),
        "readings": [
            {
                "group": found.groups[reading.group].text,
                "read_as": _write_reading(found, reading),
                "coupling": reading.coupling or None,
                **select_fields(tried, "before after gain log_ratio decisive"),
            }
            for reading, tried in found.readings
        ],
    }


def _write_reading(found: "Compared", reading: "OpenReading") -> str:
    group = found.groups[reading.group]
    text, factor = group.read_as or group.text, str(reading.factor)
    sign = "-" if factor.startswith("-") else "+"
    size = factor.removeprefix("-")
    return f"{text} {sign} {reading.name if size == '1' else f'{size}*{reading.name}'}"


def warn_comparison(ours: "EstimateSide", others: Sequence["Compared"]) -> tuple[Notice, ...]:
    """Return what a reader must know: doubts of both sides, shared logs, terms that groups seem to hold."""
    # What was restored from one estimate says nothing of a comparison.
    notices = [note for note in ours.identified.robot.notices if note.code != "estimate.settings-differ"]
    for found in others:
        notices += [*ours.notices, *found.other.notices, *_warn_compared(found)]
    return tuple(dict.fromkeys(notices))


def _warn_compared(found: "Compared") -> tuple[Notice, ...]:
    file = str(found.other.source)
    notices = []
    if found.other.shared:
        text = (
            f"both estimates were fitted to {', '.join(found.other.shared)}, so that their errors are not "
            "independent: differences are of the methods, and should be smaller than the deviations say"
        )
        notices.append(Notice(code="compare.shared-logs", text=text, file=file))
    couplings = dict.fromkeys(reading.coupling for reading, _ in found.readings if reading.coupling)
    for coupling in couplings:
        entries = [entry for entry in found.readings if entry[0].coupling == coupling]
        if any(tried.decisive for _, tried in entries):
            notices.append(_warn_coupled(found, coupling, entries))
    for reading, tried in found.readings:
        if not reading.coupling:
            text = (
                f"{_describe_tried(found, reading, tried)}; nothing but the numbers speaks for it, which "
                f"chance may do too; to compare so: {_write_option(found, reading)}"
            )
            notices.append(Notice(code="compare.other-reading", text=text, file=file))
    return tuple(notices)


def _warn_coupled(
    found: "Compared", coupling: str, entries: Sequence[tuple["OpenReading", "TriedReading"]]
) -> Notice:
    """Return what the drive `coupling` explains."""
    sure = [entry for entry in entries if entry[1].decisive]
    rest = [entry for entry in entries if not entry[1].decisive]
    text = (
        f"{'; '.join(_describe_tried(found, *entry) for entry in sure)}: as where drive {coupling!r} is "
        "written with its cross terms alone, and what it adds to each joint by itself is counted to that "
        "joint. This is an inference; to compare so: "
        f"{' '.join(_write_option(found, reading) for reading, _ in sure)}"
    )
    if rest:
        undecided = "; ".join(
            f"{_write_option(found, reading)} changes chi-square by {-tried.gain:+.1f}"
            for reading, tried in rest
        )
        text += f". The same rule has more, on which the values do not decide: {undecided}"
    return Notice(code="compare.coupled-reading", text=text, file=str(found.other.source))


def _describe_tried(found: "Compared", reading: "OpenReading", tried: "TriedReading") -> str:
    name = found.groups[reading.group].text
    return (
        f"{name} is {_format_deviations(tried.before)} deviations away as it stands, and "
        f"{_format_deviations(tried.after)} if it holds {_write_term(reading)} too"
    )


def _write_term(reading: "OpenReading") -> str:
    factor = str(reading.factor)
    return {"1": reading.name, "-1": f"-{reading.name}"}.get(factor, f"{factor}*{reading.name}")


def _write_option(found: "Compared", reading: "OpenReading") -> str:
    group = found.groups[reading.group]
    return f'--read-as "{group.text} = {_write_reading(found, reading)}"'
