"""Tests of a fit as text, objects for JSON and figures: held-out logs, diagnosis, comparison with others."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.environment import show_path
from symid.errors import Notice
from symid.identification import AnyValidation, ElasticValidation, FrictionValidation, RigidValidation
from symid.report.blocks import Block, Drawing, Table, select_fields, tabulate
from symid.report.elastic_page import draw_loops
from symid.report.fit_text import (
    describe_alignment,
    describe_band,
    describe_band_metric,
    describe_residual,
    describe_validation,
    show_all_rows,
    show_band,
    show_motion,
    show_residual,
)
from symid.report.identification_page import describe_essential, describe_rank, draw_prediction
from symid.robot import Robot

if TYPE_CHECKING:
    from symid.dynamics import OpenReading
    from symid.identification import Compared, EstimateSide, TriedReading
    from symid.identification.rigid import Diagnosis


def show_trial(found: AnyValidation) -> tuple[Block, ...]:
    """Return a headline, and tables of residuals."""
    plain = True
    match found:
        case ElasticValidation():
            return _show_elastic(found)
        case RigidValidation():
            plain = found.band is None
            kind = " (joints taken as rigid)" if any(found.robot.elastic) else ""
            band = found.validation.scoring if found.band is None else found.band.band
            within = f" within {band:.3g} Hz" if band else ""
            table = show_residual(found.residual) if found.band is None else show_band(found.band)
            rows, band_residual = show_all_rows(found.validation), found.band
            metric = rows if band_residual is None else describe_band_metric(band_residual)
            more = "".join(f"\n{text}" for text in (found.settled.describe(), metric) if text)
        case FrictionValidation():
            kind, within, more, laws = ", friction and rigid part", "", "", found.laws
            columns = "joint; law; relative/%=relative_percent:.4f; RMS=std; unit; rows=samples"
            residual = found.validation.residual
            table = tabulate(residual, columns, (0, 1, 4), law=lambda entry: laws[entry.joint])
    headline = (
        f"{found.robot.name}{kind} on {found.validation.source}{within}: mean relative residual "
        f"{found.mean_relative_percent:.4f} %"
    )
    return (f"{headline}{more}", table, *show_motion(found.validation.motion if plain else ()))


def describe_trial(found: AnyValidation) -> dict[str, object]:
    """Return the trial as `symid validate --json` gives it, but for the gate."""
    match found:
        case RigidValidation():
            return {
                **describe_validation(found.validation),
                "mean_relative_percent": found.mean_relative_percent,
                "residual": describe_residual(found.residual),
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
        return tuple(map(draw_loops, found.trial.joints))
    return tuple(draw_prediction(series, found.validation.rows) for series in found.validation.series)


def _show_elastic(found: ElasticValidation) -> tuple[Block, ...]:
    trial, tracking = found.trial, found.tracking
    head = (
        f"{found.robot.name} on {trial.source}: mean relative residual {trial.mean_relative_percent:.4f} %, "
        "by motors and links together"
    )
    if trial.means[1:]:
        head += f"; with the springs {max(trial.means[1:]):.4f} %"
    blocks: list[Block] = [head]
    for caption, entries in trial.residuals:
        blocks += [caption, show_residual(entries)]
    lacking = [joint.joint for joint in trial.joints if joint.final is None]
    if lacking:
        blocks.append(
            f"The estimate has no spring of {', '.join(lacking)}: its spring torque cannot be predicted, and "
            "the gate does not test it."
        )
    if tracking is None:
        return tuple(blocks)
    rows = [
        [joint, run.name, 1e3 * float(run.rms[index]), 1e3 * float(run.peak[index]), f"m{unit}"]
        for index, (joint, unit) in enumerate(_list_joints(found.robot))
        for run in tracking.runs
    ]
    blocks += [
        (
            f"Tracking of {tracking.trajectory.source}: closed loop of the robot file's values, which the "
            "feed-forward does not use. The rigid feed-forward has dynamics and friction of Case 1."
        ),
        Table(("joint", "feed-forward", "rms", "peak", "unit"), rows, left=(0, 1, 4)),
    ]
    return tuple(blocks)


def _list_joints(robot: Robot) -> list[tuple[str, str]]:
    """Return the names of the joints, and the units of their positions."""
    return [(joint.name, "m" if joint.kind.value == "prismatic" else "rad") for joint in robot.axes]


def _describe_elastic(found: ElasticValidation) -> dict[str, object]:
    trial, tracking, joints = found.trial, found.tracking, _list_joints(found.robot)
    names = [name for name, _ in joints]
    return {
        **select_fields(found.estimate, "robot method"),
        "log": trial.source,
        "samples": len(trial.joints[0].time),
        "residual": describe_residual(trial.residuals[0][1]),
        "mean_relative_percent": trial.mean_relative_percent,
        "tables": [
            {"caption": caption, "residual": describe_residual(entries), "mean_relative_percent": mean}
            for (caption, entries), mean in zip(trial.residuals, trial.means, strict=True)
        ],
        "alignment": None if found.alignment is None else describe_alignment(found.alignment, names),
        "tracking": None
        if tracking is None
        else {
            **select_fields(tracking.trajectory, "trajectory=source duration"),
            "seed": tracking.seed,
            "runs": [
                {
                    "feed_forward": run.name,
                    "method": tracking.methods.get(run.name),
                    "joints": [
                        {"joint": joint, "rms": rms, "peak": peak, "unit": unit}
                        for (joint, unit), rms, peak in zip(
                            joints, run.rms.tolist(), run.peak.tolist(), strict=True
                        )
                    ],
                }
                for run in tracking.runs
            ],
        },
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
    """Return the diagnosis in a few sentences and a table of what the residual is a function of."""
    drift = diagnosis.drift
    lines = [describe_rank(diagnosis), describe_essential(diagnosis)]
    if diagnosis.refit is not None:
        moves = f"moves the estimate by {diagnosis.refit:.1g} standard deviations"
        same = diagnosis.refit < _SAME_FIT
        lines.append(f"Refitting the logs {'reproduces the stored estimate' if same else moves}.")
    if len(drift.runs) > 1:
        lines.append(f"{len(drift.changed)} of {drift.compared} parameters differ between the logs.")
    for entry in diagnosis.prices:
        verb = "lowers" if entry.percent < 0.0 else "raises"
        what = f"{entry.what[:1].upper()}{entry.what[1:]}"
        lines.append(f"{what} {verb} the {entry.of} by {abs(entry.percent):.3g} %.")
    columns = "joint; residual follows=family; share/%=share_percent:.3g; rms; unit"
    table = [tabulate(diagnosis.structure, columns, (0, 1, 4))] if diagnosis.structure else []
    return ("\n".join(lines), *table)


_SAME_FIT = 0.05
"""Standard deviations of a parameter below which a refit is the same."""
_WIDTH = 44
"""Letters of a group on one line of a table."""
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
            value.group,
            *(value.theirs, value.theirs_std, value.ours, value.ours_std),
            _format_deviations(value.deviations, "+", 2),
            *([value.read_as] if read else []),
        ]
        for value in found.values
    ]
    header = ["group", "other", "std", "ours", "std", "in std", *(["read as"] if read else [])]
    lines = ["largest differences"]
    for place in comparison.list_farthest():
        away = float(comparison.deviations[place])
        mine, theirs = float(comparison.ours.values[place]), float(comparison.theirs.values[place])
        share = f" ({100.0 * (mine - theirs) / abs(theirs):+.3g} %)" if theirs else ""
        lines.append(
            f"  {found.groups[place].text}: ours {mine:.4g} is {_format_deviations(abs(away))} "
            f"deviations {'above' if away > 0 else 'below'} the other's {theirs:.4g}{share}"
        )
    with_these = " with these" if found.absent or found.neither else ""
    span = f"the groups of the other{with_these} span all base parameters, exactly"
    if found.lacking > 0:
        span = f"besides, the other does not determine {found.lacking} combinations of ours"
    left_out = (
        ("ours, not in the other: ", found.absent),
        ("in neither: ", found.neither),
        ("", (span,)),
        ("the other's, refused in ours: ", found.not_ours),
        ("the other's, of another model: ", found.other.strange),
    )
    return (
        f"{ours.identified.robot.name}: {show_path(ours.source)} beside {show_path(other.source)}{columns}",
        Table(header, rows, left=(0, 6) if read else (0,), fold=_WIDTH),
        _summarise_agreement(found),
        *(["\n".join(lines)] if len(lines) > 1 else []),
        "\n".join(f"{head}{', '.join(names)}" for head, names in left_out if names),
    )


def _format_deviations(value: float, sign: str = "", digits: int = 1) -> str:
    """Return a number of deviations; beyond a hundred thousand its size is enough."""
    if math.isnan(value):
        return "-"
    return format(value, f"{sign}.{digits}f" if abs(value) < 1e5 else f"{sign}.2e")


def _summarise_agreement(found: "Compared") -> str:
    comparison = found.comparison
    judged, total = comparison.judged, comparison.chi_square
    if not judged:
        return "neither side states standard deviations: agreement cannot be judged"
    counts = ", ".join(
        f"{comparison.count_within(limit)} of {judged} within {limit:g} deviations "
        f"({share * judged:.0f} expected)"
        for limit, share in _LIMITS
    )
    if total is None:
        return f"{counts}\nno chi-square: the covariance of the differences is singular"
    text = f"chi-square {_format_deviations(total.value)} over {total.freedom} groups"
    if found.other.shared:
        text += "; no probability, because the estimates have logs in common"
    else:
        chance = f"{total.chance:.2g}" if total.chance > _TINY else f"below {_TINY:g}"
        text += f", probability {chance}"
        if total.chance > _TOO_SURE:
            text += "; too small for independent errors: both may come from the same log"
    if total.stretch > 1.0:
        text += f"; it would be as expected with deviations {total.stretch:.2g} times as large"
    return f"{counts}\n{text}"


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


def _write_term(reading: "OpenReading") -> str:
    factor = str(reading.factor)
    return {"1": reading.name, "-1": f"-{reading.name}"}.get(factor, f"{factor}*{reading.name}")


def _write_reading(found: "Compared", reading: "OpenReading") -> str:
    group, term = found.groups[reading.group], _write_term(reading)
    sign = "-" if term.startswith("-") else "+"
    return f"{group.read_as or group.text} {sign} {term.removeprefix('-')}"


def _write_option(found: "Compared", reading: "OpenReading") -> str:
    return f'--read-as "{found.groups[reading.group].text} = {_write_reading(found, reading)}"'


def _describe_tried(found: "Compared", reading: "OpenReading", tried: "TriedReading") -> str:
    return (
        f"{found.groups[reading.group].text} is {_format_deviations(abs(tried.before))} deviations away as "
        f"it stands, and {_format_deviations(abs(tried.after))} if it contains {_write_term(reading)} too"
    )


def warn_comparison(ours: "EstimateSide", others: Sequence["Compared"]) -> tuple[Notice, ...]:
    """Return the warnings of both sides, shared logs, terms that groups seem to contain."""
    # What was restored from one estimate says nothing of a comparison.
    notices = [note for note in ours.identified.robot.notices if note.code != "estimate.settings-differ"]
    for found in others:
        notices += [*ours.notices, *found.other.notices, *_warn_compared(found)]
    return tuple(dict.fromkeys(notices))


def _warn_compared(found: "Compared") -> Iterator[Notice]:
    file = str(found.other.source)
    if found.other.shared:
        text = (
            f"both estimates were fitted to {', '.join(found.other.shared)}: their errors are not "
            "independent, and differences should be smaller than the standard deviations"
        )
        yield Notice(code="compare.shared-logs", text=text, file=file)
    for coupling in dict.fromkeys(reading.coupling for reading, _ in found.readings if reading.coupling):
        entries = [entry for entry in found.readings if entry[0].coupling == coupling]
        sure = [entry for entry in entries if entry[1].decisive]
        if not sure:
            continue
        text = (
            f"{'; '.join(_describe_tried(found, *entry) for entry in sure)}. The other seems to count what "
            f"drive {coupling!r} adds to a single joint to that joint (an inference); to compare so: "
            f"{' '.join(_write_option(found, reading) for reading, _ in sure)}"
        )
        undecided = "; ".join(
            f"{_write_option(found, reading)} changes chi-square by {-tried.gain:+.1f}"
            for reading, tried in entries
            if not tried.decisive
        )
        if undecided:
            text += f". The same rule has more terms, on which the values do not decide: {undecided}"
        yield Notice(code="compare.coupled-reading", text=text, file=file)
    for reading, tried in found.readings:
        if not reading.coupling:
            text = (
                f"{_describe_tried(found, reading, tried)}. Only the numbers support this, it may be chance; "
                f"to compare so: {_write_option(found, reading)}"
            )
            yield Notice(code="compare.other-reading", text=text, file=file)
